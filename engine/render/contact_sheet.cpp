#include "engine/render/contact_sheet.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "engine/render/label.h"
#include "engine/render/relit_sheet.h"
#include "engine/render/tone_map.h"

namespace patina {
namespace {

constexpr std::array<float, 3> kPaper{0.11f, 0.115f, 0.125f};
constexpr std::array<float, 3> kInk{0.87f, 0.88f, 0.90f};
constexpr std::array<float, 3> kFaint{0.30f, 0.31f, 0.33f};
constexpr int kMargin = 16, kLabelScale = 2, kLabelHeight = 24, kBarHeight = 8;

TexelStatus statusAt(const SvbrdfMaps& maps, int x, int y) {
  return maps.status.empty() ? TexelStatus::Converged
                             : static_cast<TexelStatus>(static_cast<int>(maps.status.at(x, y)));
}

bool measured(TexelStatus status) {
  return status != TexelStatus::NotMeasured && status != TexelStatus::Failed;
}

std::array<float, 3> statusColour(TexelStatus status) {
  switch (status) {
    case TexelStatus::NotMeasured:
      return kFaint;
    case TexelStatus::Converged:
      return {0.20f, 0.55f, 0.42f};
    case TexelStatus::IterationLimit:
      return {0.90f, 0.75f, 0.25f};
    case TexelStatus::MirrorOffScreen:
      return {0.30f, 0.45f, 0.80f};
    case TexelStatus::Clipped:
      return {0.95f, 0.95f, 0.95f};
    case TexelStatus::Failed:
      return {0.85f, 0.20f, 0.20f};
    case TexelStatus::Cancelled:
      return {0.55f, 0.35f, 0.65f};
  }
  return kFaint;
}

void fillWith(Image& image, std::array<float, 3> colour) {
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x)
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = colour[static_cast<std::size_t>(c)];
}

void paste(Image& page, const Image& picture, int left, int top) {
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x) {
      if (left + x < 0 || top + y < 0 || left + x >= page.width() || top + y >= page.height()) continue;
      for (int c = 0; c < 3; ++c) page.at(left + x, top + y, c) = picture.at(x, y, c % picture.channels());
    }
}

/// Enlarged by repeating texels, or reduced by picking them: a map's own values, nothing in between.
template <typename Texel>
Image panel(const SvbrdfMaps& maps, int size, Texel&& texel) {
  const float scale = static_cast<float>(size) / static_cast<float>(std::max(maps.width, maps.height));
  Image image(std::max(1, static_cast<int>(std::lround(static_cast<float>(maps.width) * scale))),
              std::max(1, static_cast<int>(std::lround(static_cast<float>(maps.height) * scale))), 3);
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x) {
      const int tx = std::min(maps.width - 1, x * maps.width / image.width());
      const int ty = std::min(maps.height - 1, y * maps.height / image.height());
      const std::array<float, 3> colour = texel(tx, ty, x, y);
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = colour[static_cast<std::size_t>(c)];
    }
  return image;
}

std::string number(float value) {
  char text[24];
  std::snprintf(text, sizeof text, value < 0.1f ? "%.3f" : "%.2f", static_cast<double>(value));
  return text;
}

struct Panel {
  Image picture;
  std::string label;
  bool hasBar = false;
  ColourMap colours = ColourMap::Viridis;
  std::string low, high;
};

bool hatched(int x, int y) {
  return ((x + y) / 3) % 4 == 0;
}

Panel albedoPanel(const SvbrdfMaps& maps, const Image& albedo, const char* name, bool isGloss, int size) {
  float most = 0;
  for (int c = 0; c < 3; ++c) {
    Image one(maps.width, maps.height, 1);
    for (int y = 0; y < maps.height; ++y)
      for (int x = 0; x < maps.width; ++x) one.at(x, y) = albedo.at(x, y, c);
    most = std::max(most, mapPercentile(maps, one, 0.98f));
  }
  int brighter = 1;
  while (most > 0 && brighter < 64 && most * static_cast<float>(brighter) * 2 <= 0.9f) brighter *= 2;
  Panel made;
  made.picture = panel(maps, size, [&](int tx, int ty, int x, int y) {
    const TexelStatus status = statusAt(maps, tx, ty);
    if (!measured(status) || (isGloss && status == TexelStatus::MirrorOffScreen && hatched(x, y)))
      return kFaint;
    std::array<float, 3> colour{};
    for (int c = 0; c < 3; ++c)
      colour[static_cast<std::size_t>(c)] =
          srgbFromLinear(albedo.at(tx, ty, c) * static_cast<float>(brighter));
    return colour;
  });
  made.label = name;
  if (brighter > 1) made.label += " x" + std::to_string(brighter);
  return made;
}

Panel numberPanel(const SvbrdfMaps& maps, const Image& map, const char* name, bool isGloss, ColourMap colours,
                  int size) {
  const float low = mapPercentile(maps, map, 0.01f),
              high = std::max(mapPercentile(maps, map, 0.99f), low + 1e-6f);
  Panel made;
  made.picture = panel(maps, size, [&](int tx, int ty, int x, int y) {
    const TexelStatus status = statusAt(maps, tx, ty);
    if (!measured(status) || (isGloss && status == TexelStatus::MirrorOffScreen && hatched(x, y)))
      return kFaint;
    return mapColour(colours, (map.at(tx, ty) - low) / (high - low));
  });
  made.label = name;
  made.hasBar = true;
  made.colours = colours;
  made.low = number(low);
  made.high = number(high);
  return made;
}

std::vector<Panel> makePanels(const SvbrdfMaps& maps, const ContactSheetOptions& options) {
  const int size = options.panelSize;
  std::vector<Panel> panels;
  panels.push_back(albedoPanel(maps, maps.diffuse, "diffuse", false, size));
  panels.push_back(albedoPanel(maps, maps.specular, "specular", true, size));
  Panel normal;
  normal.label = "normal, slopes x4";
  normal.picture = panel(maps, size, [&](int tx, int ty, int, int) {
    if (!measured(statusAt(maps, tx, ty))) return kFaint;
    const float x = 4 * maps.normal.at(tx, ty, 0), y = 4 * maps.normal.at(tx, ty, 1);
    const float z = std::max(1e-3f, maps.normal.at(tx, ty, 2)), length = std::sqrt(x * x + y * y + z * z);
    return std::array<float, 3>{0.5f + 0.5f * x / length, 0.5f + 0.5f * y / length, 0.5f + 0.5f * z / length};
  });
  panels.push_back(std::move(normal));
  panels.push_back(numberPanel(maps, maps.sigma, "sigma", true, ColourMap::Viridis, size));
  panels.push_back(numberPanel(maps, maps.kurtosis, "kurtosis", true, ColourMap::Viridis, size));
  if (!maps.residual.empty())
    panels.push_back(numberPanel(maps, maps.residual, "residual", false, ColourMap::Magma, size));
  if (!maps.status.empty()) {
    Panel status;
    std::size_t good = 0;
    for (float s : maps.status.samples())
      good += static_cast<int>(s) == static_cast<int>(TexelStatus::Converged);
    status.picture =
        panel(maps, size, [&](int tx, int ty, int, int) { return statusColour(statusAt(maps, tx, ty)); });
    char text[48];
    std::snprintf(text, sizeof text, "status, %.1f%% converged",
                  100.0 * static_cast<double>(good) / static_cast<double>(maps.status.pixelCount()));
    status.label = text;
    panels.push_back(std::move(status));
  }
  if (options.withRelit) {
    SheetView view;
    const auto span = static_cast<float>(std::max(maps.widthMm, maps.heightMm));
    view.eyeMm = Eigen::Vector3f(0, -1.6f, 2.6f) * span;
    view.width = view.height = size;
    PointLight light;
    light.positionMm = Eigen::Vector3f(0.2f, 1.2f, 1.7f) * span;
    Panel relit;
    relit.picture = relitPicture(maps, light, view);
    relit.label = "relit";
    panels.push_back(std::move(relit));
  }
  return panels;
}

}  // namespace

float mapPercentile(const SvbrdfMaps& maps, const Image& map, float fraction) {
  std::vector<float> values;
  for (int y = 0; y < maps.height; ++y)
    for (int x = 0; x < maps.width; ++x)
      if (measured(statusAt(maps, x, y)) && std::isfinite(map.at(x, y))) values.push_back(map.at(x, y));
  if (values.empty()) return 0;
  const auto rank = static_cast<std::ptrdiff_t>(
      std::clamp(fraction, 0.0f, 1.0f) * static_cast<float>(values.size() - 1) + 0.5f);
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<std::size_t>(rank)];
}

Image colouredMap(const Image& map, float low, float high, ColourMap colours) {
  Image shown(map.width(), map.height(), 3);
  const float range = high > low ? high - low : 1;
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x) {
      const std::array<float, 3> colour = mapColour(colours, (map.at(x, y) - low) / range);
      for (int c = 0; c < 3; ++c) shown.at(x, y, c) = colour[static_cast<std::size_t>(c)];
    }
  return shown;
}

Image contactSheet(const SvbrdfMaps& maps, const ContactSheetOptions& options) {
  if (maps.width <= 0 || maps.height <= 0) return {};
  const std::vector<Panel> panels = makePanels(maps, options);
  const int columns = 4, rows = (static_cast<int>(panels.size()) + columns - 1) / columns;
  int panelWidth = 0, panelHeight = 0;
  for (const Panel& p : panels) {
    panelWidth = std::max(panelWidth, p.picture.width());
    panelHeight = std::max(panelHeight, p.picture.height());
  }
  const int cellWidth = panelWidth + kMargin, cellHeight = panelHeight + kLabelHeight + kMargin + 4;
  const int top = options.title.empty() ? kMargin : kMargin + 14 + kMargin;
  Image page(columns * cellWidth + kMargin, top + rows * cellHeight, 3);
  fillWith(page, kPaper);
  if (!options.title.empty()) drawLabel(page, kMargin, kMargin, options.title, kLabelScale, kInk);
  for (std::size_t i = 0; i < panels.size(); ++i) {
    const Panel& p = panels[i];
    const int left = kMargin + static_cast<int>(i % columns) * cellWidth,
              y = top + static_cast<int>(i / columns) * cellHeight;
    paste(page, p.picture, left, y);
    const int below = y + panelHeight + 8;
    drawLabel(page, left, below, p.label, kLabelScale, kInk);
    if (!p.hasBar) continue;
    const int highLeft = left + panelWidth - labelWidth(p.high, kLabelScale);
    const int barRight = highLeft - 6, barLeft = std::max(left + labelWidth(p.label, kLabelScale) + 12 +
                                                              labelWidth(p.low, kLabelScale) + 6,
                                                          barRight - 90);
    drawLabel(page, highLeft, below, p.high, kLabelScale, kInk);
    drawLabel(page, barLeft - 6 - labelWidth(p.low, kLabelScale), below, p.low, kLabelScale, kInk);
    for (int x = barLeft; x < barRight; ++x) {
      const auto colour = mapColour(p.colours, static_cast<float>(x - barLeft) /
                                                   static_cast<float>(std::max(1, barRight - barLeft - 1)));
      for (int v = 0; v < kBarHeight; ++v)
        for (int c = 0; c < 3; ++c)
          if (x < page.width() && below + 3 + v < page.height())
            page.at(x, below + 3 + v, c) = colour[static_cast<std::size_t>(c)];
    }
  }
  return page;
}

Image relitPicture(const SvbrdfMaps& maps, const PointLight& light, SheetView view) {
  view.background = 0;
  const Image dark = relitSheet(maps, light, view);
  // The sheet itself in the middle greys; where highlights take up much of it, less, so that they keep their
  // shape.
  const float exposure = std::min(autoExposure(dark, 0.6f, 0.25f), autoExposure(dark, 0.97f, 1.5f));
  view.background = linearFromSrgb(kPaper[0]) / exposure;
  return toneMap(relitSheet(maps, light, view), exposure);
}

Image labelledRow(const std::vector<Image>& pictures, const std::vector<std::string>& labels) {
  int width = kMargin, height = 0;
  for (const Image& picture : pictures) {
    width += picture.width() + kMargin;
    height = std::max(height, picture.height());
  }
  if (pictures.empty()) return {};
  Image page(width, height + 2 * kMargin + kLabelHeight, 3);
  fillWith(page, kPaper);
  int left = kMargin;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    paste(page, pictures[i], left, kMargin);
    if (i < labels.size()) drawLabel(page, left, kMargin + height + 8, labels[i], kLabelScale, kInk);
    left += pictures[i].width() + kMargin;
  }
  return page;
}

}  // namespace patina
