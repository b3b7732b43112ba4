#include "engine/flash/observations.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>

namespace patina {
namespace {

/// Coarser grids than this tell nothing about a texel's neighbourhood.
constexpr int kCoarsestSide = 48;
/// Photographs that noise is measured in: more would only repeat it.
constexpr std::size_t kNoisePhotos = 4;
/// Photographs that are kept in memory rather than read twice: these numbers at most, half a GiB.
constexpr std::size_t kKeptSamples = std::size_t{128} << 20;
constexpr int kMostSamplesASide = 16;

/// Decoded value from which on a pixel is clipped, in a photograph that says so itself: its largest code.
float clipOf(const FlashPixels& pixels, std::size_t channel, double declared) {
  float clip = 0;
  if (pixels.largest[channel] > 0) {
    const auto& values = pixels.valueOfCode[channel];
    clip = values.size() > 1 ? 0.5f * (values[254] + values[255]) : pixels.largest[channel] * 0.9999f;
  }
  if (declared > 0) {
    const auto said = static_cast<float>(declared * (1 - 1e-6));
    clip = clip > 0 ? std::min(clip, said) : said;
  }
  return clip;
}

/// Linear files don't say where they clip: where the largest value is met again and again.
float clipSeen(const Image& image, int channel) {
  float largest = 0;
  for (std::size_t i = static_cast<std::size_t>(channel); i < image.samples().size(); i += 3)
    largest = std::max(largest, image.samples()[i]);
  std::size_t there = 0;
  for (std::size_t i = static_cast<std::size_t>(channel); i < image.samples().size(); i += 3)
    there += image.samples()[i] >= largest * 0.9999f;
  return there >= std::max<std::size_t>(8, image.pixelCount() / 5000) ? largest * 0.9999f : 0.0f;
}

/// Photo pixels along a texel's side.
double footprint(const FlashCapture& capture, int photo, int width, int height, const FlashGrid& grid) {
  const Eigen::Vector2d centre = grid.pointMm(grid.width / 2, grid.height / 2);
  const Eigen::Vector2d here = pixelOf(capture, photo, width, height, centre);
  const Eigen::Vector2d right =
      pixelOf(capture, photo, width, height, centre + Eigen::Vector2d(grid.texelXMm, 0));
  const Eigen::Vector2d up =
      pixelOf(capture, photo, width, height, centre + Eigen::Vector2d(0, grid.texelYMm));
  return std::max((right - here).norm(), (up - here).norm());
}

FlashLevel halved(const FlashLevel& fine) {
  FlashLevel coarse;
  coarse.grid = fine.grid;
  coarse.grid.width = (fine.grid.width + 1) / 2, coarse.grid.height = (fine.grid.height + 1) / 2;
  coarse.grid.texelXMm *= 2, coarse.grid.texelYMm *= 2;
  coarse.pixelsPerTexel = 4 * fine.pixelsPerTexel;
  coarse.sheets.resize(fine.sheets.size());
  for (std::size_t k = 0; k < fine.sheets.size(); ++k) {
    const FlashSheet& from = fine.sheets[k];
    if (from.value.empty()) continue;
    FlashSheet& to = coarse.sheets[k];
    to.value = Image(coarse.grid.width, coarse.grid.height, 3);
    to.flags.assign(coarse.grid.size(), 0);
    for (int j = 0; j < coarse.grid.height; ++j) {
      for (int i = 0; i < coarse.grid.width; ++i) {
        std::uint8_t flags = 0;
        for (int d = 0; d < 4; ++d) {
          const int x = std::min(2 * i + d % 2, fine.grid.width - 1),
                    y = std::min(2 * j + d / 2, fine.grid.height - 1);
          flags |= from.flags[static_cast<std::size_t>(y) * fine.grid.width + x];
          for (int c = 0; c < 3; ++c) to.value.at(i, j, c) += 0.25f * from.value.at(x, y, c);
        }
        to.flags[static_cast<std::size_t>(j) * coarse.grid.width + i] = flags;
      }
    }
  }
  return coarse;
}

}  // namespace

Eigen::Vector2d pixelOf(const FlashCapture& capture, int photo, int width, int height,
                        const Eigen::Vector2d& pointMm) {
  const FlashPhoto& one = capture.photos[static_cast<std::size_t>(photo)];
  if (one.rectified || !one.camera) {
    return {(pointMm.x() / capture.widthMm + 0.5) * width - 0.5,
            (0.5 - pointMm.y() / capture.heightMm) * height - 0.5};
  }
  const auto pixel = one.camera->pixelFromWorld({pointMm.x(), pointMm.y(), 0});
  return pixel ? *pixel : Eigen::Vector2d(-1e9, -1e9);
}

FlashSheet sheetOf(const FlashCapture& capture, int photo, const FlashPixels& pixels, const FlashGrid& grid,
                   const std::array<float, 3>& clip) {
  const Image& image = pixels.linear;
  FlashSheet sheet;
  sheet.value = Image(grid.width, grid.height, 3);
  sheet.flags.assign(grid.size(), 0);
  const double side = footprint(capture, photo, image.width(), image.height(), grid);
  const int m = std::clamp(static_cast<int>(std::lround(side)), 1, kMostSamplesASide);
  tbb::parallel_for(0, grid.height, [&](int j) {
    for (int i = 0; i < grid.width; ++i) {
      std::uint8_t flags = 0;
      Eigen::Array3d sum = Eigen::Array3d::Zero();
      for (int s = 0; s < m * m; ++s) {
        const Eigen::Vector2d point =
            grid.pointMm(i, j) + Eigen::Vector2d(((s % m + 0.5) / m - 0.5) * grid.texelXMm,
                                                 -((s / m + 0.5) / m - 0.5) * grid.texelYMm);
        Eigen::Vector2d at = pixelOf(capture, photo, image.width(), image.height(), point);
        // Half a pixel beyond the outer centres still belongs to the picture.
        if (!(at.x() >= -0.501 && at.y() >= -0.501 && at.x() <= image.width() - 0.499 &&
              at.y() <= image.height() - 0.499)) {
          flags |= FlashSheet::kUnseen;
          break;
        }
        at = at.cwiseMax(0.0).cwiseMin(Eigen::Vector2d(image.width() - 1, image.height() - 1));
        const int x0 = std::min(static_cast<int>(at.x()), std::max(image.width() - 2, 0)),
                  y0 = std::min(static_cast<int>(at.y()), std::max(image.height() - 2, 0));
        const double fx = at.x() - x0, fy = at.y() - y0;
        for (int d = 0; d < 4; ++d) {
          const double weight = (d % 2 ? fx : 1 - fx) * (d / 2 ? fy : 1 - fy);
          if (weight < 1e-6) continue;
          const auto pixel =
              image.pixel(std::min(x0 + d % 2, image.width() - 1), std::min(y0 + d / 2, image.height() - 1));
          for (int c = 0; c < 3; ++c) {
            sum[c] += weight * pixel[c];
            const float limit = clip[static_cast<std::size_t>(c)];
            if (limit > 0 && pixel[c] >= limit) flags |= static_cast<std::uint8_t>(1 << c);
          }
        }
      }
      sheet.flags[static_cast<std::size_t>(j) * grid.width + i] = flags;
      if (flags & FlashSheet::kUnseen) continue;
      for (int c = 0; c < 3; ++c) sheet.value.at(i, j, c) = static_cast<float>(sum[c] / (m * m));
    }
  });
  return sheet;
}

Result<FlashData> readFlashData(const FlashCapture& capture, int size, const JobContext& job) {
  FlashData data;
  data.capture = capture;
  FlashLevel finest;
  finest.sheets.resize(capture.photos.size());
  std::vector<FlashPixels> kept;
  const auto total = static_cast<std::int64_t>(capture.photos.size());
  // Twice: the grid and the clipping level hang on all photographs, and they need not all be in memory.
  std::array<float, 3> clip{0, 0, 0};
  double finestSide = 0;
  std::size_t samples = 0;
  for (std::size_t k = 0; k < capture.photos.size(); ++k) {
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "reading the photographs was cancelled", "", ""};
    if (capture.photos[k].holdout) continue;
    Result<FlashPixels> pixels = readFlashPixels(capture, capture.photos[k]);
    if (!pixels) return pixels.error();
    const Image& image = pixels->linear;
    for (std::size_t c = 0; c < 3; ++c) {
      float here = clipOf(*pixels, c, capture.saturation);
      if (!(here > 0)) here = clipSeen(image, static_cast<int>(c));
      if (here > 0) clip[c] = clip[c] > 0 ? std::min(clip[c], here) : here;
    }
    FlashGrid unit;
    unit.width = unit.height = 1;
    unit.texelXMm = unit.texelYMm = std::max(capture.widthMm, capture.heightMm) / 64;
    unit.originXMm = -unit.texelXMm / 2, unit.originYMm = unit.texelYMm / 2;
    finestSide = std::max(finestSide,
                          64 * footprint(capture, static_cast<int>(k), image.width(), image.height(), unit));
    samples += image.samples().size();
    if (kept.size() < kNoisePhotos || samples < kKeptSamples) kept.push_back(std::move(*pixels));
    job.progress("read", static_cast<std::int64_t>(k) + 1, 2 * total, "photos");
  }
  data.clip = clip;
  data.noise = measureFlashNoise(std::span(kept).first(std::min(kept.size(), kNoisePhotos)), clip);
  const int side = size > 0 ? size : std::clamp(static_cast<int>(std::lround(finestSide)), 1, 4096);
  const double longest = std::max(capture.widthMm, capture.heightMm);
  FlashGrid& grid = finest.grid;
  grid.width = std::max(1, static_cast<int>(std::lround(side * capture.widthMm / longest)));
  grid.height = std::max(1, static_cast<int>(std::lround(side * capture.heightMm / longest)));
  grid.texelXMm = capture.widthMm / grid.width, grid.texelYMm = capture.heightMm / grid.height;
  grid.originXMm = -capture.widthMm / 2, grid.originYMm = capture.heightMm / 2;
  finest.pixelsPerTexel = std::max(1.0, (finestSide / side) * (finestSide / side));
  std::size_t seen = 0, next = 0;
  for (std::size_t k = 0; k < capture.photos.size(); ++k) {
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "reading the photographs was cancelled", "", ""};
    if (capture.photos[k].holdout) continue;
    Result<FlashPixels> pixels =
        next < kept.size() ? std::move(kept[next]) : readFlashPixels(capture, capture.photos[k]);
    ++next;
    if (!pixels) return pixels.error();
    finest.sheets[k] = sheetOf(capture, static_cast<int>(k), *pixels, grid, clip);
    for (const std::uint8_t flags : finest.sheets[k].flags) {
      if (flags & FlashSheet::kUnseen) continue;
      ++seen;
      for (int c = 0; c < 3; ++c) data.clippedSamples += (flags >> c) & 1;
    }
    job.progress("read", total + static_cast<std::int64_t>(k) + 1, 2 * total, "photos");
  }
  if (seen == 0) {
    return Error{ErrorCode::Invalid, "no photograph that may be fitted shows the sample",
                 (capture.folder / "capture.json").string(),
                 "check the cameras, and that the sample's size is in millimetres"};
  }
  data.levels.push_back(std::move(finest));
  while (std::max(data.levels.back().grid.width, data.levels.back().grid.height) > 2 * kCoarsestSide)
    data.levels.push_back(halved(data.levels.back()));
  return data;
}

FlashSite siteOf(const FlashData& data, const FlashLevel& level, int i, int j) {
  FlashSite site;
  site.pointMm = level.grid.pointMm(i, j);
  const std::size_t index = static_cast<std::size_t>(j) * level.grid.width + i;
  for (std::size_t k = 0; k < level.sheets.size(); ++k) {
    const FlashSheet& sheet = level.sheets[k];
    if (sheet.value.empty() || (sheet.flags[index] & FlashSheet::kUnseen)) continue;
    FlashObservation seen;
    seen.photo = static_cast<int>(k);
    seen.ray = flashRay(data.capture.photos[k], site.pointMm);
    seen.irradiance = data.capture.photos[k].lightIntensity.array() * seen.ray.inverseSquare;
    seen.clipped = sheet.flags[index] & 7;
    for (int c = 0; c < 3; ++c) {
      seen.value[c] = sheet.value.at(i, j, c);
      seen.variance[c] = data.noise.variance(seen.value[c], c) / level.pixelsPerTexel;
    }
    site.seen.push_back(seen);
  }
  return site;
}

}  // namespace patina
