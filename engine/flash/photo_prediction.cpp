#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/flash/fit.h"

namespace patina {
namespace {

/// A pixel's point on the sample; false off it.
bool pointOf(const FlashCapture& capture, int photo, int width, int height, int x, int y,
             Eigen::Vector2d* pointMm) {
  const FlashPhoto& one = capture.photos[static_cast<std::size_t>(photo)];
  if (one.rectified || !one.camera) {
    *pointMm = {((x + 0.5) / width - 0.5) * capture.widthMm, (0.5 - (y + 0.5) / height) * capture.heightMm};
    return true;
  }
  const auto point = one.camera->samplePlaneFromPixel(Eigen::Vector2d(x, y));
  if (!point) return false;
  *pointMm = point->head<2>();
  return std::abs(pointMm->x()) <= capture.widthMm / 2 && std::abs(pointMm->y()) <= capture.heightMm / 2;
}

/// Index of the texel that holds a point; -1: none that was solved.
std::ptrdiff_t texelAt(const FlashFit& fit, const Eigen::Vector2d& pointMm) {
  const int i = std::clamp(static_cast<int>((pointMm.x() - fit.grid.originXMm) / fit.grid.texelXMm), 0,
                           fit.grid.width - 1),
            j = std::clamp(static_cast<int>((fit.grid.originYMm - pointMm.y()) / fit.grid.texelYMm), 0,
                           fit.grid.height - 1);
  const std::ptrdiff_t index = static_cast<std::ptrdiff_t>(j) * fit.grid.width + i;
  const TexelStatus status = fit.texels.status[static_cast<std::size_t>(index)];
  return status == TexelStatus::NotMeasured || status == TexelStatus::Failed ? -1 : index;
}

Eigen::Array3d predictAt(const FlashFit& fit, int photo, const Eigen::Vector2d& pointMm, std::size_t texel) {
  const FlashRay ray = flashRay(fit.capture.photos[static_cast<std::size_t>(photo)], pointMm);
  const FlashLobe& lobe = fit.model.materials[fit.texels.material[texel]].lobe;
  const FlashTexel x{fit.texels.x[texel].cast<double>()};
  const Eigen::Array3d light = flashLight(fit.capture, fit.model.rig, photo, ray, lobe, x);
  Eigen::Array3d value;
  for (int c = 0; c < 3; ++c) {
    value[c] = std::max(0.0, fit.model.tone.value(light[c]) + fit.model.rig.black[c]);
    const float clip = fit.clip[static_cast<std::size_t>(c)];
    if (clip > 0) value[c] = std::min(value[c], static_cast<double>(clip));
  }
  return value;
}

}  // namespace

Image predictFlashPhoto(const FlashFit& fit, int photo, int width, int height) {
  Image predicted(width, height, 3);
  tbb::parallel_for(0, height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      Eigen::Vector2d point;
      if (!pointOf(fit.capture, photo, width, height, x, y, &point)) continue;
      const std::ptrdiff_t texel = texelAt(fit, point);
      if (texel < 0) continue;
      const Eigen::Array3d value = predictAt(fit, photo, point, static_cast<std::size_t>(texel));
      for (int c = 0; c < 3; ++c) predicted.at(x, y, c) = static_cast<float>(value[c]);
    }
  });
  return predicted;
}

FlashComparison compareFlashPhoto(const FlashFit& fit, int photo, const FlashPixels& pixels) {
  const Image& image = pixels.linear;
  FlashComparison comparison;
  comparison.file = fit.capture.photos[static_cast<std::size_t>(photo)].file;
  comparison.holdout = fit.capture.photos[static_cast<std::size_t>(photo)].holdout;
  std::vector<std::array<double, 3>> rows(static_cast<std::size_t>(image.height()), {0, 0, 0});
  tbb::parallel_for(0, image.height(), [&](int y) {
    auto& row = rows[static_cast<std::size_t>(y)];
    for (int x = 0; x < image.width(); ++x) {
      Eigen::Vector2d point;
      if (!pointOf(fit.capture, photo, image.width(), image.height(), x, y, &point)) continue;
      const std::ptrdiff_t texel = texelAt(fit, point);
      if (texel < 0) continue;
      const Eigen::Array3d value = predictAt(fit, photo, point, static_cast<std::size_t>(texel));
      for (int c = 0; c < 3; ++c) {
        const float clip = fit.clip[static_cast<std::size_t>(c)];
        const bool clipped = clip > 0 && image.at(x, y, c) >= clip;
        const double seen = clipped ? clip : image.at(x, y, c);
        row[0] += (value[c] - seen) * (value[c] - seen);
        row[1] += clipped ? 0 : fit.noise.variance(seen, c);
        row[2] += seen * seen;
      }
    }
  });
  for (const auto& row : rows)
    comparison.squares += row[0], comparison.noiseSquares += row[1], comparison.values += row[2];
  if (comparison.values > 0) {
    comparison.rms = std::sqrt(comparison.squares / comparison.values);
    comparison.noiseFloor = std::sqrt(comparison.noiseSquares / comparison.values);
  }
  return comparison;
}

std::map<std::string, Image> flashEffectMaps(const FlashFit& fit) {
  std::map<std::string, Image> maps;
  const auto perMaterial = [&](const char* name, auto&& value) {
    Image map(fit.grid.width, fit.grid.height, 1);
    for (std::size_t t = 0; t < fit.texels.material.size(); ++t)
      map.samples()[t] = static_cast<float>(value(fit.texels.material[t]));
    maps.emplace(name, std::move(map));
  };
  const auto lobe = [&](int m) -> const FlashLobe& {
    return fit.model.materials[static_cast<std::size_t>(m)].lobe;
  };
  perMaterial("materials", [](int m) { return m; });
  for (const FlashEffect effect : fit.options.effects) {
    if (effect == FlashEffect::Anisotropy) {
      perMaterial("anisotropy_ratio", [&](int m) { return std::exp(lobe(m).stretch.norm()); });
      perMaterial("anisotropy_angle", [&](int m) {
        return 90 / std::numbers::pi * std::atan2(lobe(m).stretch.y(), lobe(m).stretch.x());
      });
    } else if (effect == FlashEffect::ThirdLobe) {
      perMaterial("third_lobe_share", [&](int m) { return lobe(m).thirdShare; });
      perMaterial("third_lobe_sigma",
                  [&](int m) { return lobe(m).sigma() * std::exp(lobe(m).logThirdRatio); });
    }
  }
  return maps;
}

}  // namespace patina
