#include "engine/render/two_shot_pictures.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "engine/image/png.h"
#include "engine/render/colour_map.h"
#include "engine/render/contact_sheet.h"
#include "engine/render/measured_sphere.h"
#include "engine/render/tone_map.h"

namespace patina {

namespace fs = std::filesystem;

namespace {

/// Small photographs twice, three times, ... as large, so that a label fits below.
Image enlarged(const Image& small) {
  constexpr int kLeastWidth = 300;
  const int times = std::max(1, (kLeastWidth + small.width() - 1) / small.width());
  Image large(small.width() * times, small.height() * times, small.channels());
  for (int y = 0; y < large.height(); ++y) {
    for (int x = 0; x < large.width(); ++x) {
      for (int c = 0; c < large.channels(); ++c) large.at(x, y, c) = small.at(x / times, y / times, c);
    }
  }
  return large;
}

/// Captured, predicted and their difference for one photograph, side by side; the difference in colours from
/// 0 to half of the brightness shown as white.
Image comparisonRow(const TwoShotComparison& comparison) {
  const float exposure = autoExposure(comparison.captured);
  const char* role = comparison.holdout           ? ", held out"
                     : comparison.leftOut.empty() ? ", fitted"
                                                  : ", left out";
  if (comparison.rendered.empty())
    return labelledRow({enlarged(toneMap(comparison.captured, exposure))}, {comparison.file + role});
  Image difference(comparison.captured.width(), comparison.captured.height(), 3);
  for (std::size_t i = 0; i < difference.pixelCount(); ++i) {
    float off = 0;
    for (int c = 0; c < 3; ++c) {
      off +=
          std::abs(comparison.captured.samples()[3 * i + c] - comparison.rendered.samples()[3 * i + c]) / 3;
    }
    const auto colour = mapColour(ColourMap::Magma, 2 * exposure * off);
    for (int c = 0; c < 3; ++c) difference.samples()[3 * i + c] = colour[c];
  }
  char error[64] = "difference";
  if (comparison.rms >= 0)
    std::snprintf(error, sizeof error, "difference, RMS %.1f %%", 100 * comparison.rms);
  return labelledRow({enlarged(toneMap(comparison.captured, exposure)),
                      enlarged(toneMap(comparison.rendered, exposure)), enlarged(difference)},
                     {comparison.file + role, "predicted", error});
}

Image stacked(const std::vector<Image>& rows) {
  int width = 0, height = 0;
  for (const Image& row : rows) width = std::max(width, row.width()), height += row.height();
  if (width == 0) return {};
  Image page(width, height, 3, 0.13f);
  int top = 0;
  for (const Image& row : rows) {
    for (int y = 0; y < row.height(); ++y) {
      for (int x = 0; x < row.width(); ++x) {
        for (int c = 0; c < 3; ++c) page.at(x, top + y, c) = row.at(x, y, c);
      }
    }
    top += row.height();
  }
  return page;
}

}  // namespace

Image comparisonPicture(const TwoShotFit& fit) {
  std::vector<Image> rows;
  for (const TwoShotComparison& comparison : fit.comparisons) rows.push_back(comparisonRow(comparison));
  return stacked(rows);
}

Status writeTwoShotPictures(const fs::path& folder, const TwoShotFit& fit, const JobContext& job) {
  for (std::size_t m = 0; m < fit.materials.size(); ++m) {
    const TwoShotMaterial& material = fit.materials[m];
    Result<Image> sheet = sphereSheet(*material.brdf, material.posteriorSd.get(), material.priorSd,
                                      SpherePictureOptions{.size = 320}, job);
    if (!sheet) return sheet.error();
    const std::string name = m == 0 ? "sphere.png" : "sphere_" + std::to_string(m + 1) + ".png";
    if (Status written = writePng(folder / name, *sheet); !written) return written;
  }
  const Image comparison = comparisonPicture(fit);
  if (comparison.empty()) return Done{};
  return writePng(folder / "comparison.png", comparison);
}

}  // namespace patina
