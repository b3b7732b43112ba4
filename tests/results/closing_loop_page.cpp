#include "tests/results/closing_loop_page.h"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "engine/image/png.h"
#include "engine/render/label.h"
#include "engine/report/explanation_words.h"
#include "engine/report/residual_pictures.h"

namespace patina::test {

namespace fs = std::filesystem;

std::vector<fs::path> foldersIn(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.is_directory()) found.push_back(entry.path());
  std::sort(found.begin(), found.end());
  return found;
}

std::string truthOf(const fs::path& bundle) {
  std::ifstream in(bundle / "truth/truth.json");
  const auto json = nlohmann::json::parse(in, nullptr, false);
  if (!json.is_object() || !json.contains("effects")) return "not known";
  std::string text;
  for (const auto& [name, value] : json.at("effects").items())
    text += (text.empty() ? "" : ", ") + name + " " + value.dump();
  std::replace(text.begin(), text.end(), '|', '/');
  return text.empty() ? "nothing" : text;
}

bool writePicture(const Explanation& e, const fs::path& file) {
  if (e.pictures.empty()) return false;
  constexpr int kSide = 110, kGap = 4, kHead = 14;
  const ResidualView view = residualView(e.pictures.front(), kSide);
  if (view.empty()) return false;
  const std::vector<std::pair<const char*, const Image*>> parts{{"PHOTOGRAPH", &view.captured},
                                                                {"BEFORE", &view.predictedBefore},
                                                                {"AFTER", &view.predictedAfter},
                                                                {"ERROR BEFORE", &view.before},
                                                                {"ERROR AFTER", &view.after}};
  const int width = view.captured.width(), height = view.captured.height();
  const int columns = static_cast<int>(parts.size());
  Image sheet(columns * (width + kGap) - kGap, height + kHead, 3, 1.0f);
  for (int k = 0; k < columns; ++k) {
    const Image& part = *parts[static_cast<std::size_t>(k)].second;
    if (part.width() != width || part.height() != height) continue;
    const int left = k * (width + kGap);
    drawLabel(sheet, left, 3, parts[static_cast<std::size_t>(k)].first, 1, {0.2f, 0.2f, 0.2f});
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) sheet.at(left + x, kHead + y, c) = part.at(x, y, c);
  }
  return writePng(file, sheet).ok();
}

std::string whatWasFound(const Explanation& e) {
  std::string text;
  for (const EffectFinding& effect : e.effects) {
    text += (text.empty() ? "" : "; ") + ("**" + effect.id + "**");
    std::string numbers;
    for (std::size_t i = 0; i < effect.parameters.size() && i < 3; ++i)
      numbers += (i ? ", " : "") + estimateText(effect.parameters[i]);
    if (!numbers.empty()) text += " (" + numbers + ")";
    for (const auto& group : e.confusable)
      if (group.size() > 1 && group.front() == effect.id) text += " or " + group[1];
  }
  return text.empty() ? "nothing" : text;
}

std::string evidence(const Explanation& e) {
  std::string text;
  for (const EffectFinding& effect : e.effects)
    text +=
        (text.empty() ? "" : " ") + effect.verdict + " Confidence " + wholePercent(effect.confidence) + ".";
  if (text.empty()) {
    // The candidate that came nearest.
    const auto best = std::find_if(e.considered.begin(), e.considered.end(),
                                   [](const EffectFinding& f) { return f.holdoutRmsWith >= 0; });
    text = best == e.considered.end() ? "no candidate" : "nearest: " + best->id + ". " + best->verdict;
  }
  std::replace(text.begin(), text.end(), '|', '/');
  return text;
}

std::string errorText(double rms, double noise) {
  return rms < 0 ? "none" : percent(rms) + " (" + percent(noise) + ")";
}

}  // namespace patina::test
