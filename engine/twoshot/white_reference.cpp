#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "engine/base/text.h"
#include "engine/twoshot/reflectance_picture.h"

namespace patina {
namespace {

constexpr int kRadius = 3;  // of the average: 7 x 7 pixels, over which a tile under a lamp is a plane
/// Further apart than this many standard deviations, the averages over 3 x 3 and 7 x 7 pixels differ by more
/// than noise, and the pixel itself is used.
constexpr double kTextureSigmas = 4;

/// The white photographs for a shot: all of one camera, the shot's own if it has any.
std::vector<const TwoShotPhoto*> whitesFor(const TwoShotCapture& capture, const TwoShotPhoto& shot) {
  const TwoShotPhoto* nearest = nullptr;
  double nearestMm = std::numeric_limits<double>::infinity();
  for (const TwoShotPhoto& white : capture.whiteShots) {
    if (!sameLight(white, shot)) continue;
    const double away = sameCamera(white.camera, shot.camera)
                            ? -1
                            : (white.camera.positionMm() - shot.camera.positionMm()).norm();
    if (away < nearestMm) nearest = &white, nearestMm = away;
  }
  std::vector<const TwoShotPhoto*> whites;
  for (const TwoShotPhoto& white : capture.whiteShots) {
    if (nearest && sameLight(white, shot) && sameCamera(white.camera, nearest->camera))
      whites.push_back(&white);
  }
  return whites;
}

struct RateImage {
  Image rate;  ///< 0 where unknown
  Image relativeVariance;
};

/// Exposures of the tile merged to radiance per second, times pi / reflectance.
Result<RateImage> mergedWhite(const TwoShotCapture& capture, const std::vector<const TwoShotPhoto*>& whites,
                              const SampleView& view) {
  std::vector<Image> images;
  std::vector<Eigen::Array3d> levels;
  std::vector<PhotoNoise> noise;
  for (const TwoShotPhoto* white : whites) {
    Result<Image> image = readPhoto(capture, *white);
    if (!image) return image.error();
    images.push_back(std::move(*image));
  }
  for (std::size_t i = 0; i < images.size(); ++i) {
    const MaskedPhoto photo{&images[i], &view.onSample};
    noise.push_back(estimateNoise(photo));
    const double limit = whites[i]->encoding.empty() ? std::numeric_limits<double>::infinity() : 1.0;
    levels.push_back(clipLevels(photo, capture.saturation, limit));
  }
  RateImage out{Image(view.width, view.height, 3), Image(view.width, view.height, 3)};
  tbb::parallel_for(tbb::blocked_range<int>(0, view.height), [&](const tbb::blocked_range<int>& range) {
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < view.width; ++x) {
        if (!view.onSample[view.index(x, y)]) continue;
        for (int c = 0; c < 3; ++c) {
          double sum = 0, seconds = 0;
          for (std::size_t e = 0; e < images.size(); ++e) {
            const double v = images[e].at(x, y, c);
            if (v >= levels[e][c]) continue;
            sum += v, seconds += whites[e]->exposureS;
          }
          if (!(sum > 0)) continue;
          double weights = 0, rate = 0;
          for (std::size_t e = 0; e < images.size(); ++e) {
            const double v = images[e].at(x, y, c), t = whites[e]->exposureS;
            if (v >= levels[e][c]) continue;
            const double w = t * t / noise[e].variance(sum / seconds * t);
            rate += w * v / t, weights += w;
          }
          rate /= weights;
          // Below three standard deviations a tile isn't lit: a quotient would be noise.
          if (!(rate > 3 / std::sqrt(weights))) continue;
          out.rate.at(x, y, c) = static_cast<float>(rate * std::numbers::pi / capture.whiteReflectance[c]);
          out.relativeVariance.at(x, y, c) = static_cast<float>(1 / (weights * rate * rate));
        }
      }
    }
  });
  return out;
}

/// Averages over 7 x 7 pixels where all are lit and the average over 3 x 3 agrees; 3 x 3 next to edges.
void smooth(RateImage* image) {
  const Image& rate = image->rate;
  const int width = rate.width(), height = rate.height();
  // Sums over the rectangle from the corner, one row and column of zeros before.
  std::vector<double> sums((static_cast<std::size_t>(width) + 1) * (height + 1));
  std::vector<int> lit(sums.size());
  Image smoothed = rate, variance = image->relativeVariance;
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < height; ++y) {
      double row = 0;
      int rowLit = 0;
      for (int x = 0; x < width; ++x) {
        const float v = rate.at(x, y, c);
        row += v, rowLit += v > 0;
        const std::size_t at = static_cast<std::size_t>(y + 1) * (width + 1) + x + 1;
        sums[at] = sums[at - width - 1] + row;
        lit[at] = lit[at - width - 1] + rowLit;
      }
    }
    const auto box = [&](const auto& table, int x, int y, int radius) {
      const std::size_t stride = width + 1;
      const std::size_t top = static_cast<std::size_t>(y - radius) * stride,
                        bottom = static_cast<std::size_t>(y + radius + 1) * stride;
      const int left = x - radius, right = x + radius + 1;
      return table[bottom + right] - table[bottom + left] - table[top + right] + table[top + left];
    };
    tbb::parallel_for(tbb::blocked_range<int>(0, height), [&](const tbb::blocked_range<int>& range) {
      for (int y = range.begin(); y < range.end(); ++y) {
        for (int x = 0; x < width; ++x) {
          const double centre = rate.at(x, y, c), relative = image->relativeVariance.at(x, y, c);
          if (!(centre > 0)) continue;
          const auto whole = [&](int radius) {
            const int side = 2 * radius + 1;
            return x >= radius && y >= radius && x + radius < width && y + radius < height &&
                   box(lit, x, y, radius) == side * side;
          };
          if (!whole(1)) continue;
          const double small = box(sums, x, y, 1) / 9;
          const double sd = std::sqrt(relative) * centre;
          if (std::abs(centre - small) > kTextureSigmas * sd) continue;
          smoothed.at(x, y, c) = static_cast<float>(small);
          variance.at(x, y, c) = static_cast<float>(relative / 9);
          if (!whole(kRadius)) continue;
          const double large = box(sums, x, y, kRadius) / 49;
          if (std::abs(large - small) > kTextureSigmas * sd / 3) continue;
          smoothed.at(x, y, c) = static_cast<float>(large);
          variance.at(x, y, c) = static_cast<float>(relative / 49);
        }
      }
    });
  }
  image->rate = std::move(smoothed);
  image->relativeVariance = std::move(variance);
}

/// Looked up bilinearly where the white's camera sees the points of `view`.
RateImage lookUp(const RateImage& white, const Camera& whiteCamera, const SampleView& view) {
  RateImage out{Image(view.width, view.height, 3), Image(view.width, view.height, 3)};
  tbb::parallel_for(tbb::blocked_range<int>(0, view.height), [&](const tbb::blocked_range<int>& range) {
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < view.width; ++x) {
        const std::size_t i = view.index(x, y);
        if (!view.onSample[i]) continue;
        const auto pixel = whiteCamera.pixelFromWorld({view.positionMm[i].x(), view.positionMm[i].y(), 0});
        if (!pixel) continue;
        const int left = static_cast<int>(std::floor(pixel->x())),
                  top = static_cast<int>(std::floor(pixel->y()));
        if (left < 0 || top < 0 || left + 1 >= white.rate.width() || top + 1 >= white.rate.height()) continue;
        const double u = pixel->x() - left, v = pixel->y() - top;
        for (int c = 0; c < 3; ++c) {
          double sum = 0, weights = 0, relative = 0;
          for (int k = 0; k < 4; ++k) {
            const int px = left + k % 2, py = top + k / 2;
            const double w = (k % 2 ? u : 1 - u) * (k / 2 ? v : 1 - v);
            if (!(white.rate.at(px, py, c) > 0)) continue;
            sum += w * white.rate.at(px, py, c), weights += w;
            relative += w * white.relativeVariance.at(px, py, c);
          }
          if (weights < 0.5) continue;  // mostly off the tile
          out.rate.at(x, y, c) = static_cast<float>(sum / weights);
          out.relativeVariance.at(x, y, c) = static_cast<float>(relative / weights);
        }
      }
    }
  });
  return out;
}

}  // namespace

Result<IrradiancePicture> irradianceOf(const TwoShotCapture& capture, const TwoShotPhoto& shot,
                                       const SampleView& view, std::vector<std::string>* remarks) {
  IrradiancePicture picture;
  if (shot.normalIrradiance) {
    picture.rate = Image(view.width, view.height, 3);
    picture.relativeVariance = Image(view.width, view.height, 3);
    for (std::size_t i = 0; i < view.onSample.size(); ++i) {
      for (int c = 0; c < 3 && view.onSample[i]; ++c) {
        picture.rate.samples()[3 * i + c] =
            static_cast<float>((*shot.normalIrradiance)[c] * shot.toLight.z());
      }
    }
    return picture;
  }
  const std::vector<const TwoShotPhoto*> whites = whitesFor(capture, shot);
  if (whites.empty()) {
    return Error{ErrorCode::Invalid, "no photograph of the white reference was taken under this shot's light",
                 (capture.folder / shot.file).string(), "add one to white_reference.shots"};
  }
  picture.otherCamera = !sameCamera(whites.front()->camera, shot.camera);
  std::optional<SampleView> otherView;
  if (picture.otherCamera) otherView = viewOf(capture, whites.front()->camera);
  Result<RateImage> white = mergedWhite(capture, whites, otherView ? *otherView : view);
  if (!white) return white.error();
  smooth(&*white);
  picture.smoothedOver = 49;
  if (picture.otherCamera) {
    *white = lookUp(*white, whites.front()->camera, view);
    if (remarks) {
      remarks->push_back(
          "The white photograph for " + inQuotes(shot.file) +
          " was taken by another camera or from elsewhere: it was looked up on the sample's plane, "
          "and the lens' darkening towards the corners is not removed.");
    }
  }
  picture.rate = std::move(white->rate);
  picture.relativeVariance = std::move(white->relativeVariance);
  return picture;
}

}  // namespace patina
