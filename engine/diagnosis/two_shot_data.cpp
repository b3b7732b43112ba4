#include "engine/diagnosis/two_shot_data.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "engine/twoshot/observations.h"
#include "engine/twoshot/photo_noise.h"

namespace patina {
namespace {

/// Pixels this near to the sample's outline belong to neither side: the edge mixes both.
constexpr int kMarginPx = 3;
constexpr int kSurroundingBlockPx = 10;
constexpr int kWhiteBlockPx = 16;
/// Brighter than this share of the tile, a pixel beside the sample shows the tile itself.
constexpr double kTileShare = 0.3;
/// Surroundings are taken as they are seen twice, up to this share: a sample throws light on them that the
/// tile doesn't, and the other way round.
constexpr double kSurroundingsDiffer = 0.01;
constexpr double kLightFromSample = 2e-4;  ///< the same, of the sample's own level

/// 1 where all pixels within the margin are off the sample.
std::vector<std::uint8_t> wellOutside(const SampleView& view) {
  std::vector<std::uint8_t> out(view.onSample.size(), 0);
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      bool clear = true;
      for (int j = -kMarginPx; j <= kMarginPx && clear; ++j) {
        for (int i = -kMarginPx; i <= kMarginPx && clear; ++i) {
          const int px = x + i, py = y + j;
          if (px < 0 || py < 0 || px >= view.width || py >= view.height) continue;
          clear = !view.onSample[view.index(px, py)];
        }
      }
      out[view.index(x, y)] = clear;
    }
  }
  return out;
}

const TwoShotPhoto* whiteOf(const TwoShotCapture& capture, const TwoShotPhoto& shot) {
  for (const TwoShotPhoto& white : capture.whiteShots)
    if (sameLight(white, shot) && sameCamera(white.camera, shot.camera)) return &white;
  return nullptr;
}

class Loader {
 public:
  Loader(const TwoShotCapture& capture, int rowsPerShot, const JobContext& job)
      : capture_(capture), rowsPerShot_(rowsPerShot), job_(job) {
    data_.shots.resize(capture.shots.size());
  }

  Result<DiagnosisData> run() {
    Result<LoadedCapture> fitted = loadFittedShots(capture_, job_);
    if (!fitted) return fitted.error();
    collect(*fitted, capture_, false);
    TwoShotCapture others = capture_;
    bool any = false;
    for (TwoShotPhoto& shot : others.shots) {
      shot.holdout = !shot.holdout;
      any |= !shot.holdout;
    }
    if (any && !job_.cancelled()) {
      JobContext quiet = job_;  // what can't be used among them was said by the fit
      quiet.logSink = nullptr, quiet.progressSink = nullptr;
      Result<LoadedCapture> held = loadFittedShots(others, quiet);
      if (!held && held.error().code == ErrorCode::Cancelled) return held.error();
      if (held) collect(*held, others, true);
    }
    if (job_.cancelled()) return Error{ErrorCode::Cancelled, "the diagnosis was cancelled", "", ""};
    return std::move(data_);
  }

 private:
  void collect(const LoadedCapture& loaded, const TwoShotCapture& capture, bool holdout) {
    for (std::size_t p = 0; p < loaded.pictures.size() && !job_.cancelled(); ++p)
      picture(loaded, loaded.pictures[p], capture, holdout);
  }

  void picture(const LoadedCapture& loaded, const ReflectancePicture& source, const TwoShotCapture& capture,
               bool holdout) {
    ReflectancePicture measured = source;
    for (std::size_t i = 0; i < measured.usable.size(); ++i) {
      const auto f = measured.brdf.samples().subspan(3 * i, 3);
      if (f[0] == 0 && f[1] == 0 && f[2] == 0) measured.usable[i] = 0;
    }
    std::vector<ReflectancePicture> one;
    one.push_back(std::move(measured));
    const Observations rows = observe(one, {}, 0, rowsPerShot_);
    const SampleView& view = source.view;
    for (const std::size_t s : source.shots) levels(loaded.shots[s].pixels, view, source, s, holdout);
    const std::size_t first = source.shots.front();
    const Camera& camera = capture.shots[first].camera;
    // Blurs are those of the longest exposure, in pixel units per second: it has the least noise.
    std::size_t longest = first;
    for (const std::size_t s : source.shots)
      if (capture.shots[s].exposureS > capture.shots[longest].exposureS) longest = s;
    const Image& pixels = loaded.shots[longest].pixels;
    const double seconds = capture.shots[longest].exposureS;
    std::array<Image, kBlurPx.size()> blurs;
    for (std::size_t b = 0; b < kBlurPx.size(); ++b) blurs[b] = blurredImage(pixels, kBlurPx[b]);

    for (std::size_t r = 0; r < rows.size(); ++r) {
      DiagnosisRow row;
      row.point.shot = first;
      row.point.toLight = source.toLight;
      row.point.cameraMm = view.cameraMm;
      row.point.positionMm = rows.positionMm[r];
      row.point.exposureS = capture.shots[first].exposureS;
      row.seen = rows.brdf[r], row.variance = rows.variance[r], row.weight = rows.weight[r];
      row.holdout = holdout;
      const auto pixel = camera.pixelFromWorld({rows.positionMm[r].x(), rows.positionMm[r].y(), 0});
      if (!pixel) continue;
      const int x = std::clamp(static_cast<int>(std::lround(pixel->x())), 0, view.width - 1);
      const int y = std::clamp(static_cast<int>(std::lround(pixel->y())), 0, view.height - 1);
      row.point.cornerShare = cornerShareOf(camera, pixel->x(), pixel->y());
      bool lit = true;
      for (int c = 0; c < 3; ++c) {
        const double rate = source.irradiance.rate.at(x, y, c);
        lit &= rate > 0;
        row.point.rate[c] = rate;
        for (std::size_t b = 0; b < kBlurPx.size() && rate > 0; ++b)
          row.blurred[b][c] = (blurs[b].at(x, y, c) - pixels.at(x, y, c)) / (seconds * rate);
        row.brightest = std::max<double>(row.brightest, pixels.at(x, y, c));
      }
      if (lit) (holdout ? data_.held : data_.fitted).push_back(row);
    }
    surroundings(pixels, loaded.shots[longest].noise, blurs, view, capture, longest);
  }

  void levels(const Image& pixels, const SampleView& view, const ReflectancePicture& source, std::size_t shot,
              bool holdout) {
    DiagnosisShot& found = data_.shots[shot];
    found.used = true, found.holdout = holdout;
    const double seconds = capture_.shots[shot].exposureS;
    for (int c = 0; c < 3; ++c) {
      std::vector<float> values, rates;
      for (std::size_t i = 0; i < view.inside.size(); ++i) {
        if (!view.inside[i]) continue;
        values.push_back(pixels.samples()[3 * i + c]);
        rates.push_back(source.irradiance.rate.samples()[3 * i + c]);
        found.largest = std::max<double>(found.largest, values.back());
      }
      if (values.empty()) continue;
      const auto median = [](std::vector<float>& v) {
        std::nth_element(v.begin(), v.begin() + v.size() / 2, v.end());
        return double{v[v.size() / 2]};
      };
      found.level[c] = median(values) / seconds;
      found.whiteLevel[c] = median(rates);
    }
  }

  void surroundings(const Image& pixels, const PhotoNoise& noise,
                    const std::array<Image, kBlurPx.size()>& blurs, const SampleView& view,
                    const TwoShotCapture& capture, std::size_t s) {
    const TwoShotPhoto& shot = capture.shots[s];
    const TwoShotPhoto* white = whiteOf(capture, shot);
    if (!white) return;
    const Result<Image> tile = readPhoto(capture, *white);
    if (!tile) return;
    const PhotoNoise tileNoise = estimateNoise({&*tile, &view.inside});
    whiteBlocks(*tile, tileNoise, view, *white, s);
    const std::vector<std::uint8_t> outside = wellOutside(view);
    std::array<Image, kBlurPx.size()> tileBlurs;
    for (std::size_t b = 0; b < kBlurPx.size(); ++b) tileBlurs[b] = blurredImage(*tile, kBlurPx[b]);
    // A tile that is larger than the sample covers what lies around it.
    const Eigen::Array3d tileLevel =
        kTileShare * data_.shots[s].whiteLevel * capture.whiteReflectance.array() / std::numbers::pi;
    for (int y0 = 0; y0 < view.height; y0 += kSurroundingBlockPx) {
      for (int x0 = 0; x0 < view.width; x0 += kSurroundingBlockPx) {
        SurroundingBlock block;
        block.shot = s, block.exposureS = shot.exposureS;
        Eigen::Array3d squares = Eigen::Array3d::Zero();
        double count = 0, mx = 0, my = 0;
        bool tileThere = false;
        for (int y = y0; y < std::min(y0 + kSurroundingBlockPx, view.height); ++y) {
          for (int x = x0; x < std::min(x0 + kSurroundingBlockPx, view.width); ++x) {
            if (!outside[view.index(x, y)]) continue;
            ++count, mx += x, my += y;
            for (int c = 0; c < 3; ++c) {
              const double a = pixels.at(x, y, c) / shot.exposureS, b = tile->at(x, y, c) / white->exposureS;
              tileThere |= b > tileLevel[c];
              block.beside[c] += a, block.white[c] += b, squares[c] += (a - b) * (a - b);
              for (std::size_t k = 0; k < kBlurPx.size(); ++k) {
                block.blurred[k][c] += blurs[k].at(x, y, c) / shot.exposureS - a -
                                       (tileBlurs[k].at(x, y, c) / white->exposureS - b);
              }
            }
          }
        }
        if (tileThere || count < kSurroundingBlockPx * kSurroundingBlockPx / 4) continue;
        block.beside /= count, block.white /= count;
        for (Eigen::Array3d& blur : block.blurred) blur /= count;
        const Eigen::Array3d spread =
            ((squares - count * (block.beside - block.white).square()) / (count - 1)).max(0.0);
        block.cornerShare = cornerShareOf(shot.camera, mx / count, my / count);
        const Eigen::Array3d differ =
            kSurroundingsDiffer * block.white.max(0.0) + kLightFromSample * data_.shots[s].level.max(0.0);
        block.variance = spread / count + differ.square();
        // A surrounding without any noise and light was never photographed.
        if ((block.variance > 0).all()) data_.surroundings.push_back(block);
      }
    }
    static_cast<void>(noise);
  }

  void whiteBlocks(const Image& tile, const PhotoNoise& noise, const SampleView& view,
                   const TwoShotPhoto& white, std::size_t s) {
    for (int y0 = 0; y0 < view.height; y0 += kWhiteBlockPx) {
      for (int x0 = 0; x0 < view.width; x0 += kWhiteBlockPx) {
        double count = 0, sum = 0, variance = 0, mx = 0, my = 0;
        Eigen::Vector2d position = Eigen::Vector2d::Zero();
        for (int y = y0; y < std::min(y0 + kWhiteBlockPx, view.height); ++y) {
          for (int x = x0; x < std::min(x0 + kWhiteBlockPx, view.width); ++x) {
            const std::size_t i = view.index(x, y);
            if (!view.inside[i]) continue;
            const double value = (tile.at(x, y, 0) + tile.at(x, y, 1) + tile.at(x, y, 2)) / 3;
            ++count, sum += value, variance += noise.variance(value) / 3, mx += x, my += y;
            position += view.positionMm[i].cast<double>();
          }
        }
        if (count < kWhiteBlockPx || !(sum > 0)) continue;
        WhiteBlock block;
        block.shot = s, block.toLight = white.toLight;
        block.positionMm = position / count;
        block.cornerShare = cornerShareOf(white.camera, mx / count, my / count);
        block.lnRate = std::log(sum / count);
        block.sd = std::sqrt(variance) / sum;
        data_.whites.push_back(block);
      }
    }
  }

  const TwoShotCapture& capture_;
  int rowsPerShot_;
  const JobContext& job_;
  DiagnosisData data_;
};

}  // namespace

Result<DiagnosisData> loadDiagnosisData(const TwoShotCapture& capture, int rowsPerShot,
                                        const JobContext& job) {
  return Loader(capture, rowsPerShot, job).run();
}

}  // namespace patina
