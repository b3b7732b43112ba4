#include "engine/twoshot/reflectance_picture.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>

#include "engine/base/text.h"

namespace patina {
namespace {

/// An encoded photograph (PNG) can't hold more; linear files have no such limit.
double largestValue(const TwoShotPhoto& photo) {
  return photo.encoding.empty() ? std::numeric_limits<double>::infinity() : 1.0;
}

std::string nameOf(const TwoShotCapture& capture, std::size_t shot) {
  return (capture.folder / capture.shots[shot].file).string();
}

struct Merged {
  double rate = 0, variance = 0;
  bool clipped = false, dark = false;
};

/// Exposures of one pixel and channel, merged: weights are inverse variances of value / exposure, the
/// variance taken at the pooled rate (at the noisy values themselves the mean would be biased low).
template <typename Exposures, typename Value, typename Level, typename Noise>
Merged mergeExposures(const Exposures& exposures, std::size_t count, Value&& value, Level&& level,
                      Noise&& noise) {
  Merged merged;
  double sum = 0, seconds = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (value(i) >= level(i)) continue;
    sum += value(i), seconds += exposures(i);
  }
  if (seconds == 0) {
    merged.clipped = true;
    return merged;
  }
  const double pooled = sum / seconds;
  double weights = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (value(i) >= level(i)) continue;
    const double t = exposures(i), w = t * t / noise(i).variance(pooled * t);
    merged.rate += w * value(i) / t;
    weights += w;
  }
  merged.rate /= weights;
  merged.variance = 1 / weights;
  merged.dark = !(merged.rate > 0);
  return merged;
}

/// `unusable` becomes true where the photographs were read but hold nothing to fit.
Result<ReflectancePicture> makePicture(const TwoShotCapture& capture, std::vector<std::size_t> shots,
                                       const std::vector<LoadedShot>& loaded, SampleView view,
                                       std::vector<std::string>* remarks, bool* unusable) {
  ReflectancePicture picture;
  picture.shots = std::move(shots);
  picture.view = std::move(view);
  const SampleView& seen = picture.view;
  const TwoShotPhoto& first = capture.shots[picture.shots.front()];
  picture.toLight = first.toLight;
  const std::string where = nameOf(capture, picture.shots.front());
  if (std::find(seen.inside.begin(), seen.inside.end(), 1) == seen.inside.end()) {
    *unusable = true;
    return Error{ErrorCode::Invalid, "no pixel of this photograph looks at the sample", where,
                 "check the sample's size and the camera's K, R and t in capture.json"};
  }
  Result<IrradiancePicture> irradiance = irradianceOf(capture, first, seen, remarks);
  if (!irradiance) return irradiance.error();
  picture.irradiance = std::move(*irradiance);

  // One clipping level where several exposures share a sensor: a plateau in one tells about the others.
  std::vector<Eigen::Array3d> levels;
  std::vector<double> seconds;
  double limit = std::numeric_limits<double>::infinity();
  for (const std::size_t s : picture.shots) {
    limit = std::min(limit, largestValue(capture.shots[s]));
    const Eigen::Array3d level = clipLevels({&loaded[s].pixels, &seen.inside}, capture.saturation, limit);
    levels.push_back(level);
    seconds.push_back(capture.shots[s].exposureS);
  }
  Eigen::Array3d common = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity());
  for (const Eigen::Array3d& level : levels) common = common.min(level);
  for (Eigen::Array3d& level : levels) level = common;
  picture.brdf = Image(seen.width, seen.height, 3);
  picture.variance = Image(seen.width, seen.height, 3);
  picture.usable.assign(picture.brdf.pixelCount(), 0);
  std::vector<std::size_t> clipped(seen.height, 0), dark(seen.height, 0), unlit(seen.height, 0);
  tbb::parallel_for(tbb::blocked_range<int>(0, seen.height), [&](const tbb::blocked_range<int>& range) {
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < seen.width; ++x) {
        const std::size_t i = seen.index(x, y);
        if (!seen.inside[i]) continue;
        bool isClipped = false, isDark = false, isUnlit = false;
        for (int c = 0; c < 3; ++c) {
          const double rate = picture.irradiance.rate.at(x, y, c);
          const Merged merged = mergeExposures(
              [&](std::size_t e) { return seconds[e]; }, seconds.size(),
              [&](std::size_t e) { return double{loaded[picture.shots[e]].pixels.at(x, y, c)}; },
              [&](std::size_t e) { return levels[e][c]; },
              [&](std::size_t e) -> const PhotoNoise& { return loaded[picture.shots[e]].noise; });
          isClipped |= merged.clipped;
          isDark |= merged.dark && !merged.clipped;
          isUnlit |= !(rate > 0);
          if (!(rate > 0)) continue;
          picture.brdf.at(x, y, c) = static_cast<float>(merged.rate / rate);
          picture.variance.at(x, y, c) = static_cast<float>(merged.variance / (rate * rate));
        }
        clipped[y] += isClipped, dark[y] += isDark, unlit[y] += isUnlit;
        picture.usable[i] = !isClipped && !isUnlit;
      }
    }
  });
  std::size_t insidePixels = 0, usablePixels = 0, unlitPixels = 0;
  for (int y = 0; y < seen.height; ++y) {
    picture.clipped += clipped[y], picture.dark += dark[y], unlitPixels += unlit[y];
  }
  Eigen::Array3d sum = Eigen::Array3d::Zero(), variance = Eigen::Array3d::Zero();
  for (std::size_t i = 0; i < picture.usable.size(); ++i) {
    insidePixels += seen.inside[i];
    if (!picture.usable[i]) continue;
    ++usablePixels;
    for (int c = 0; c < 3; ++c) {
      sum[c] += picture.brdf.samples()[3 * i + c];
      variance[c] += picture.variance.samples()[3 * i + c];
    }
  }
  // An eighth of the sample, and eight pixels: less can't tell a highlight from a speck.
  if (usablePixels < 8 || usablePixels * 8 < insidePixels) {
    *unusable = true;
    if (picture.clipped * 2 > insidePixels) {
      return Error{
          ErrorCode::Invalid, "most of the sample is clipped in this photograph", where,
          "take it again with a shorter exposure, or add one to the bundle; if it isn't clipped, say "
          "'saturation' in capture.json"};
    }
    if (unlitPixels * 2 > insidePixels) {
      return Error{ErrorCode::Invalid, "the white reference is black where this photograph shows the sample",
                   where, "photograph the white tile again, in the sample's place, under the same light"};
    }
    return Error{ErrorCode::Invalid, "too few pixels of this photograph can be used", where,
                 "check the exposure, and the sample's size in capture.json"};
  }
  // Five standard deviations of the mean: a sample that is merely dark has a mean that stands out of the
  // noise.
  if ((sum <= 5 * variance.sqrt()).all()) {
    *unusable = true;
    return Error{ErrorCode::Invalid,
                 "this photograph is black on the sample: nothing stands out of its noise", where,
                 "check that the light was on and the lens open, and take it again"};
  }
  return picture;
}

/// An added lobe's shape is a guess: this share of it is not known.
constexpr double kLobeError = 0.1;

/// Takes a deviation out of a picture.
void undo(const TwoShotCapture& capture, const std::shared_ptr<const TwoShotDeviation>& deviation,
          ReflectancePicture& picture) {
  picture.deviation = deviation;
  const SampleView& view = picture.view;
  const std::size_t first = picture.shots.front();
  tbb::parallel_for(tbb::blocked_range<int>(0, view.height), [&](const tbb::blocked_range<int>& range) {
    PhotoPoint point;
    point.shot = first;
    point.toLight = picture.toLight, point.cameraMm = view.cameraMm;
    point.exposureS = capture.shots[first].exposureS;
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < view.width; ++x) {
        const std::size_t i = view.index(x, y);
        if (!picture.usable[i]) continue;
        point.positionMm = view.positionMm[i].cast<double>();
        point.cornerShare = cornerShareOf(capture.shots[first].camera, x, y);
        Eigen::Array3d seen, slope;
        for (int c = 0; c < 3; ++c) {
          point.rate[c] = picture.irradiance.rate.at(x, y, c);
          seen[c] = picture.brdf.at(x, y, c);
        }
        const DirectionPair pair = deviation->directions(point);
        const Eigen::Array3d base = deviation->baseFromSeen(seen, point, pair, &slope);
        const Eigen::Array3d lobe = kLobeError * deviation->added(pair);
        for (int c = 0; c < 3; ++c) {
          picture.brdf.at(x, y, c) = static_cast<float>(base[c]);
          float& variance = picture.variance.at(x, y, c);
          variance = static_cast<float>(variance * slope[c] * slope[c] + lobe[c] * lobe[c]);
        }
      }
    }
  });
}

}  // namespace

bool sameCamera(const Camera& a, const Camera& b) {
  constexpr double kRounding = 1e-9;  // of numbers written with nine digits or more
  const auto close = [](const auto& p, const auto& q) {
    return (p - q).norm() <= kRounding * std::max({1.0, p.norm(), q.norm()});
  };
  return a.width == b.width && a.height == b.height && close(a.intrinsics, b.intrinsics) &&
         close(a.distortion, b.distortion) && close(a.cameraFromWorld, b.cameraFromWorld) &&
         close(a.translationMm, b.translationMm);
}

SampleView viewOf(const TwoShotCapture& capture, const Camera& camera) {
  SampleView view;
  view.width = camera.width, view.height = camera.height;
  view.cameraMm = camera.positionMm();
  const std::size_t pixels = static_cast<std::size_t>(view.width) * view.height;
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  view.positionMm.assign(pixels, {kNone, kNone});
  view.areaMm2.assign(pixels, 0.0f);
  view.onSample.assign(pixels, 0);
  view.inside.assign(pixels, 0);
  const double focalSquared = camera.intrinsics(0, 0) * camera.intrinsics(1, 1);
  tbb::parallel_for(tbb::blocked_range<int>(0, view.height), [&](const tbb::blocked_range<int>& range) {
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < view.width; ++x) {
        const auto point = camera.samplePlaneFromPixel({x, y});
        if (!point) continue;
        const std::size_t i = view.index(x, y);
        view.positionMm[i] = {static_cast<float>(point->x()), static_cast<float>(point->y())};
        const Eigen::Vector3d toCamera = view.cameraMm - *point;
        const double depth = (camera.cameraFromWorld * *point + camera.translationMm).z();
        // The pixel's solid angle, (depth / distance)^3 / f^2, spread over the tilted plane.
        view.areaMm2[i] = static_cast<float>(depth * depth * depth / (focalSquared * toCamera.z()));
        view.onSample[i] = capture.onSample(point->x(), point->y());
      }
    }
  });
  for (int y = 1; y + 1 < view.height; ++y) {
    for (int x = 1; x + 1 < view.width; ++x) {
      bool all = true;
      for (int j = -1; j <= 1; ++j) {
        for (int i = -1; i <= 1; ++i) all &= view.onSample[view.index(x + i, y + j)] != 0;
      }
      view.inside[view.index(x, y)] = all;
    }
  }
  return view;
}

DirectionPair directionsAt(const ReflectancePicture& picture, const Eigen::Vector2d& positionMm) {
  if (!picture.deviation) {
    return {picture.toLight,
            (picture.view.cameraMm - Eigen::Vector3d(positionMm.x(), positionMm.y(), 0)).normalized()};
  }
  PhotoPoint point;
  point.shot = picture.shots.front();
  point.toLight = picture.toLight, point.cameraMm = picture.view.cameraMm, point.positionMm = positionMm;
  return picture.deviation->directions(point);
}

HalfDiffAngles anglesAt(const ReflectancePicture& picture, const DirectionPair& pair) {
  return picture.deviation ? picture.deviation->angles(pair)
                           : halfDiffFromDirections(pair.toLight, pair.toView);
}

Result<LoadedCapture> loadFittedShots(const TwoShotCapture& capture, const JobContext& job,
                                      const std::shared_ptr<const TwoShotDeviation>& deviation) {
  LoadedCapture loaded;
  loaded.shots.resize(capture.shots.size());
  std::vector<std::vector<std::size_t>> groups;
  std::int64_t total = 0, done = 0;
  for (std::size_t s = 0; s < capture.shots.size(); ++s) {
    const TwoShotPhoto& shot = capture.shots[s];
    if (shot.holdout) continue;
    ++total;
    const auto group = std::find_if(groups.begin(), groups.end(), [&](const std::vector<std::size_t>& g) {
      const TwoShotPhoto& other = capture.shots[g.front()];
      return sameLight(other, shot) && sameCamera(other.camera, shot.camera) &&
             other.normalIrradiance == shot.normalIrradiance;
    });
    if (group == groups.end()) {
      groups.push_back({s});
    } else {
      group->push_back(s);
    }
  }
  // A group is read by one thread, its white photographs too: decoding is most of the work.
  struct Read {
    std::optional<Result<ReflectancePicture>> picture;
    std::vector<std::string> remarks;
    bool unusable = false;
  };
  std::vector<Read> reads(groups.size());
  std::mutex progress;
  job.progress("read", 0, total, "photos");
  tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t g) {
    Read& read = reads[g];
    SampleView view = viewOf(capture, capture.shots[groups[g].front()].camera);
    for (const std::size_t s : groups[g]) {
      if (job.cancelled()) return;
      Result<Image> image = readPhoto(capture, capture.shots[s]);
      if (!image) {
        read.picture.emplace(image.error());
        return;
      }
      loaded.shots[s].pixels = std::move(*image);
      loaded.shots[s].noise = estimateNoise({&loaded.shots[s].pixels, &view.inside});
      if (deviation && deviation->glare != 0) {
        loaded.shots[s].asTaken = std::move(loaded.shots[s].pixels);
        loaded.shots[s].pixels = deviation->sharpened(loaded.shots[s].asTaken);
      }
      const std::lock_guard lock(progress);
      job.progress("read", ++done, total, "photos");
    }
    if (job.cancelled()) return;
    read.picture.emplace(
        makePicture(capture, groups[g], loaded.shots, std::move(view), &read.remarks, &read.unusable));
    if (deviation && *read.picture) undo(capture, deviation, **read.picture);
  });
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "the fit was cancelled", "", ""};
  std::optional<Error> unusable;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    Read& read = reads[g];
    for (std::string& remark : read.remarks) loaded.remarks.push_back(std::move(remark));
    Result<ReflectancePicture>& picture = *read.picture;
    if (picture) {
      loaded.pictures.push_back(std::move(*picture));
    } else if (read.unusable) {
      // One photograph that can't be used doesn't spoil the others, but it is said.
      unusable = picture.error();
      loaded.remarks.push_back("Left out: " + unusable->sentence());
      for (const std::size_t s : groups[g]) loaded.leftOut[s] = unusable->sentence();
    } else {
      return picture.error();
    }
  }
  if (loaded.pictures.empty()) return *unusable;
  for (const std::string& remark : loaded.remarks) job.warn(remark);
  job.progress("read", total, total, "photos");
  return loaded;
}

}  // namespace patina
