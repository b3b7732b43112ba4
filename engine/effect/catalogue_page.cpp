#include "engine/effect/catalogue_page.h"

#include <cmath>
#include <cstdio>

#include "engine/effect/effect_info.h"

namespace patina {
namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

std::string kindNames(unsigned kinds) {
  std::string names;
  const auto add = [&](unsigned kind, const char* name) {
    if (!(kinds & kind)) return;
    if (!names.empty()) names += ", ";
    names += name;
  };
  add(kFourierKind, "fourier");
  add(kTwoShotKind, "two-shot");
  add(kFlashKind, "flash");
  return names;
}

std::string capitalised(std::string word) {
  if (!word.empty() && word[0] >= 'a' && word[0] <= 'z') word[0] = static_cast<char>(word[0] - 'a' + 'A');
  return word;
}

/// A cell of a table: a bar would end it.
std::string cell(std::string_view text) {
  std::string safe;
  for (const char c : text) {
    if (c == '|') safe += '\\';
    safe += c;
  }
  return safe;
}

}  // namespace

std::string effectCataloguePage() {
  std::string page =
      "# Effects\n\n"
      "What light can do that the standard model leaves out, in the order of the stages that it passes. "
      "`patina-cli explain` looks for\n"
      "each of them. This page is made from the files `engine/<stage>/effects/<id>.cpp` "
      "(`engine/effect/catalogue_page.h`); don't edit it\n"
      "by hand. How the search works is in [explain.md](explain.md).\n";
  const EffectInfo* before = nullptr;
  for (const EffectInfo* effect : effectCatalogue()) {
    if (!before || before->stage != effect->stage)
      page += "\n## " + capitalised(stageName(effect->stage)) + "\n";
    before = effect;
    const auto line = [&](const char* name, std::string_view text) {
      page += "- " + std::string(name) + ": " + std::string(text) + "\n";
    };
    page += "\n### `" + std::string(effect->id) + "`: " + std::string(effect->title) + "\n\n";
    page += std::string(effect->sentence) + "\n\n";
    line("Shows itself by", effect->signature);
    line("At the next capture", effect->remedy);
    line("Kinds of capture", kindNames(effect->kinds));
    line("Source", effect->source);
    page += "\n| parameter | unit | from | to | typical | meaning |\n| --- | --- | --- | --- | --- | --- |\n";
    for (const EffectParameter& parameter : effect->parameters) {
      page += "| `" + std::string(parameter.name) + "` | " +
              (parameter.unit.empty() ? std::string("ratio") : cell(parameter.unit)) + " | " +
              number(parameter.least) + " | " + number(parameter.most) + " | " + number(parameter.typical) +
              " | " + cell(parameter.meaning) + " |\n";
    }
  }
  return page;
}

}  // namespace patina
