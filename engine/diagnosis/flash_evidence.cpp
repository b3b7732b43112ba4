#include "engine/diagnosis/flash_evidence.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>

namespace patina {
namespace {

/// One observation and channel, with both predictions.
struct Sight {
  const FlashSite* site;
  const FlashObservation* seen;
  int channel;
  double before, after;   ///< predicted, not clipped
  double slopeOverSigma;  ///< half-vector's slope against the normal, after
  bool clipped;
};

std::string number(const char* pattern, double a, double b = 0) {
  char text[96];
  std::snprintf(text, sizeof text, pattern, a, b);
  return text;
}

double slopeOf(const FlashObservation& seen, const TexelVector& x) {
  const Eigen::Vector3d normal = FlashTexel{x}.normal(), sum = seen.ray.toLight + seen.ray.toView;
  const double along = sum.dot(normal);
  return along > 0 ? (sum - along * normal).norm() / along : 10;
}

void forSights(const FlashTrial& trial, const JointState& before, const JointState& after,
               const std::function<void(const Sight&)>& each) {
  for (std::size_t s = 0; s < trial.sample.sites.size(); ++s) {
    const FlashSite& site = trial.sample.sites[s];
    const FlashLobe& lobe = after.model.materials[static_cast<std::size_t>(site.material)].lobe;
    for (const FlashObservation& seen : site.seen) {
      const SeenPrediction a = predictSeen(before.model, site.material, seen, before.x[s], false);
      const SeenPrediction b = predictSeen(after.model, site.material, seen, after.x[s], false);
      const double slope = slopeOf(seen, after.x[s]) / lobe.sigma();
      for (int c = 0; c < 3; ++c)
        each({&site, &seen, c, a.value[c], b.value[c], slope, ((seen.clipped >> c) & 1) != 0});
    }
  }
}

double noiseSquare(const Sight& sight, double predicted) {
  double d = predicted - sight.seen->value[sight.channel];
  if (sight.clipped && d > 0) d = 0;
  return d * d / sight.seen->variance[sight.channel];
}

/// Sums by bins with a name each.
ResidualBreakdown breakdown(const std::string& by, std::vector<std::string> labels, const FlashTrial& trial,
                            const JointState& before, const JointState& after,
                            const std::function<int(const Sight&)>& binOf) {
  ResidualBreakdown result;
  result.by = by;
  std::vector<double> count(labels.size(), 0.0), a(labels.size(), 0.0), b(labels.size(), 0.0);
  forSights(trial, before, after, [&](const Sight& sight) {
    const int bin = binOf(sight);
    if (bin < 0 || bin >= static_cast<int>(labels.size())) return;
    const auto at = static_cast<std::size_t>(bin);
    count[at] += 1, a[at] += noiseSquare(sight, sight.before), b[at] += noiseSquare(sight, sight.after);
  });
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (!(count[i] > 0)) continue;
    result.label.push_back(labels[i]);
    result.before.push_back(a[i] / count[i]), result.after.push_back(b[i] / count[i]);
  }
  return result;
}

double median(std::vector<double>& values) {
  const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), half, values.end());
  return *half;
}

Image shrunk(const Image& image, int side) {
  const int by = std::max(1, (std::max(image.width(), image.height()) + side - 1) / side);
  if (by == 1) return image;
  Image small(image.width() / by, image.height() / by, image.channels());
  for (int y = 0; y < small.height(); ++y) {
    for (int x = 0; x < small.width(); ++x) {
      for (int c = 0; c < small.channels(); ++c) {
        double sum = 0;
        for (int d = 0; d < by * by; ++d) sum += image.at(x * by + d % by, y * by + d / by, c);
        small.at(x, y, c) = static_cast<float>(sum / (by * by));
      }
    }
  }
  return small;
}

}  // namespace

std::vector<ResidualBreakdown> flashBreakdowns(const FlashTrial& trial, const JointState& before,
                                               const JointState& after) {
  std::vector<ResidualBreakdown> all;
  std::vector<std::string> photos;
  for (const FlashPhoto& photo : trial.data.capture.photos)
    photos.push_back(photo.file + (photo.holdout ? " (held out)" : ""));
  all.push_back(
      breakdown("photo", photos, trial, before, after, [](const Sight& s) { return s.seen->photo; }));
  all.push_back(breakdown("channel", {"red", "green", "blue"}, trial, before, after,
                          [](const Sight& s) { return s.channel; }));
  all.push_back(breakdown("image radius", {"0 to 5 degrees", "5 to 10", "10 to 15", "15 to 20", "above 20"},
                          trial, before, after, [](const Sight& s) {
                            const double degrees =
                                std::atan(std::sqrt(s.seen->ray.axisTan2)) * 180 / std::numbers::pi;
                            return std::min(4, static_cast<int>(degrees / 5));
                          }));
  all.push_back(breakdown("distance from the highlight",
                          {"0 to 1/2 sigma", "1/2 to 1", "1 to 2", "2 to 3", "3 to 5", "above 5"}, trial,
                          before, after, [](const Sight& s) {
                            const double u = s.slopeOverSigma;
                            return u < 0.5 ? 0 : u < 1 ? 1 : u < 2 ? 2 : u < 3 ? 3 : u < 5 ? 4 : 5;
                          }));
  all.push_back(breakdown(
      "brightness", {"below 0.01", "0.01 to 0.03", "0.03 to 0.1", "0.1 to 0.3", "0.3 to 1", "clipped"}, trial,
      before, after, [](const Sight& s) {
        const double v = s.seen->value[s.channel];
        return s.clipped ? 5 : v < 0.01 ? 0 : v < 0.03 ? 1 : v < 0.1 ? 2 : v < 0.3 ? 3 : 4;
      }));
  return all;
}

SignaturePlot flashPlot(FlashEffect effect, const FlashTrial& trial, const JointState& without,
                        const JointState& with) {
  SignaturePlot plot;
  plot.yLabel = "seen over predicted without it";
  std::function<double(const Sight&)> along;
  switch (effect) {
    case FlashEffect::CameraResponse:
      plot.title = "Brightness against what was predicted", plot.xLabel = "pixel value";
      along = [](const Sight& s) { return s.seen->value[s.channel]; };
      break;
    case FlashEffect::LightPower:
      plot.title = "Every photograph against what was predicted", plot.xLabel = "photograph";
      along = [](const Sight& s) { return static_cast<double>(s.seen->photo); };
      break;
    case FlashEffect::NearLight:
      plot.title = "Away from straight below the flash", plot.xLabel = "angle, degrees";
      along = [](const Sight& s) {
        return std::atan(s.seen->ray.lightSlope.norm()) * 180 / std::numbers::pi;
      };
      break;
    case FlashEffect::Vignetting:
      plot.title = "Away from the camera's axis", plot.xLabel = "angle, degrees";
      along = [](const Sight& s) {
        return std::atan(std::sqrt(s.seen->ray.axisTan2)) * 180 / std::numbers::pi;
      };
      break;
    case FlashEffect::StrayLight:
    case FlashEffect::BlackLevel:
      plot.title = "Dark places against what was predicted", plot.xLabel = "pixel value";
      along = [](const Sight& s) { return s.seen->value[s.channel]; };
      break;
    case FlashEffect::Anisotropy:
      plot.title = "Around the highlight", plot.xLabel = "direction of the half-vector, degrees";
      along = [](const Sight& s) {
        const Eigen::Vector3d half = s.seen->ray.toLight + s.seen->ray.toView;
        double angle = std::atan2(half.y(), half.x()) * 180 / std::numbers::pi;
        return angle < 0 ? angle + 180 : angle;
      };
      break;
    case FlashEffect::ThirdLobe:
    case FlashEffect::BasisDeviation:
      plot.title = "Away from the highlight", plot.xLabel = "slope of the half-vector over sigma";
      along = [](const Sight& s) { return std::min(s.slopeOverSigma, 12.0); };
      break;
  }
  std::vector<std::array<double, 3>> points;  // x, seen / without, with / without
  forSights(trial, without, with, [&](const Sight& s) {
    if (s.clipped || !(s.before > 1e-5) || !(s.seen->value[s.channel] > 1e-5)) return;
    points.push_back({along(s), s.seen->value[s.channel] / s.before, s.after / s.before});
  });
  if (points.size() < 50) return plot;
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a[0] < b[0]; });
  const bool byPhoto = effect == FlashEffect::LightPower;
  const std::size_t bins = byPhoto ? trial.data.capture.photos.size() : 14;
  for (std::size_t bin = 0; bin < bins; ++bin) {
    std::vector<double> x, seen, expected;
    if (byPhoto) {
      for (const auto& point : points)
        if (static_cast<std::size_t>(point[0]) == bin) seen.push_back(point[1]), expected.push_back(point[2]);
    } else {
      for (std::size_t i = bin * points.size() / bins; i < (bin + 1) * points.size() / bins; ++i)
        x.push_back(points[i][0]), seen.push_back(points[i][1]), expected.push_back(points[i][2]);
    }
    if (seen.size() < 5) continue;
    const double middle = median(seen);
    std::vector<double> off;
    for (const double value : seen) off.push_back(std::abs(value - middle));
    plot.x.push_back(byPhoto ? static_cast<double>(bin) : median(x));
    if (byPhoto) plot.xNames.push_back(trial.data.capture.photos[bin].file);
    plot.seen.push_back(middle);
    plot.expected.push_back(median(expected));
    // Of a median, from the median deviation; neighbours are taken for independent.
    plot.seenSd.push_back(1.253 * 1.4826 * median(off) / std::sqrt(static_cast<double>(seen.size())));
  }
  return plot;
}

Image flashPlaces(const FlashTrial& trial, const JointState& state) {
  const int side = 64;
  const double longest = std::max(trial.data.capture.widthMm, trial.data.capture.heightMm);
  const int width = std::max(1, static_cast<int>(std::lround(side * trial.data.capture.widthMm / longest)));
  const int height = std::max(1, static_cast<int>(std::lround(side * trial.data.capture.heightMm / longest)));
  Image places(width, height, 1), count(width, height, 1);
  forSights(trial, state, state, [&](const Sight& s) {
    const int x = std::clamp(
        static_cast<int>((s.site->pointMm.x() / trial.data.capture.widthMm + 0.5) * width), 0, width - 1);
    const int y = std::clamp(
        static_cast<int>((0.5 - s.site->pointMm.y() / trial.data.capture.heightMm) * height), 0, height - 1);
    places.at(x, y) += static_cast<float>(noiseSquare(s, s.after));
    count.at(x, y) += 1;
  });
  for (std::size_t i = 0; i < places.samples().size(); ++i)
    if (count.samples()[i] > 0) places.samples()[i] /= count.samples()[i];
  // A cell between the tried texels takes its neighbours' mean.
  Image filled = places;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (count.at(x, y) > 0) continue;
      double sum = 0, cells = 0;
      for (int d = 0; d < 9; ++d) {
        const int i = std::clamp(x + d % 3 - 1, 0, width - 1), j = std::clamp(y + d / 3 - 1, 0, height - 1);
        if (count.at(i, j) > 0) sum += places.at(i, j), cells += 1;
      }
      if (cells > 0) filled.at(x, y) = static_cast<float>(sum / cells);
    }
  }
  return filled;
}

Status addFlashPhotos(Explanation& explanation, const FlashFit& before, const FlashFit& after, int pictures,
                      int side, const JobContext& job) {
  std::vector<std::size_t> order;
  for (std::size_t k = 0; k < before.comparisons.size(); ++k) {
    const FlashPhoto& photo = before.capture.photos[k];
    PhotoResidual residual;
    residual.photo = static_cast<int>(k);
    residual.file = photo.file;
    residual.what = number("flash at %.0f, %.0f", photo.lightPositionMm.x(), photo.lightPositionMm.y()) +
                    number(", %.0f mm above", photo.lightPositionMm.z());
    residual.holdout = photo.holdout;
    residual.noise = before.comparisons[k].noiseFloor;
    residual.before = before.comparisons[k].rms;
    residual.after = k < after.comparisons.size() ? after.comparisons[k].rms : -1;
    explanation.photos.push_back(residual);
    order.push_back(k);
  }
  std::stable_sort(explanation.photos.begin(), explanation.photos.end(),
                   [](const PhotoResidual& a, const PhotoResidual& b) { return a.before > b.before; });
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const auto& x = before.comparisons[a];
    const auto& y = before.comparisons[b];
    return x.holdout != y.holdout ? x.holdout : x.rms > y.rms;
  });
  for (std::size_t i = 0; i < order.size() && static_cast<int>(i) < pictures; ++i) {
    if (job.cancelled()) return Done{};
    const std::size_t k = order[i];
    auto pixels = readFlashPixels(before.capture, before.capture.photos[k]);
    if (!pixels) return pixels.error();
    const int width = pixels->linear.width(), height = pixels->linear.height();
    ResidualPicture picture;
    picture.photo = static_cast<int>(k);
    picture.file = before.capture.photos[k].file;
    picture.predictedBefore = shrunk(predictFlashPhoto(before, static_cast<int>(k), width, height), side);
    picture.predictedAfter = shrunk(predictFlashPhoto(after, static_cast<int>(k), width, height), side);
    picture.captured = shrunk(pixels->linear, side);
    const double averaged = static_cast<double>(width) / picture.captured.width();
    picture.noiseSigma = Image(picture.captured.width(), picture.captured.height(), 3);
    for (std::size_t p = 0; p < picture.captured.samples().size(); ++p)
      picture.noiseSigma.samples()[p] = static_cast<float>(
          std::sqrt(before.noise.variance(picture.captured.samples()[p], static_cast<int>(p % 3))) /
          averaged);
    explanation.pictures.push_back(std::move(picture));
  }
  return Done{};
}

}  // namespace patina
