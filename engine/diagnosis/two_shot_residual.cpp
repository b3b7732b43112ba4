#include "engine/diagnosis/two_shot_residual.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "engine/twoshot/photo_noise.h"
#include "engine/twoshot/reflectance_picture.h"

namespace patina {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr std::size_t kMostPictures = 6;

/// Mean squares by bin.
struct Bins {
  ResidualBreakdown breakdown;
  std::vector<double> before, after, count;
  Bins(std::string by, std::vector<std::string> labels)
      : before(labels.size()), after(before), count(before) {
    breakdown.by = std::move(by);
    breakdown.label = std::move(labels);
  }
  void add(std::size_t bin, double b, double a) { before[bin] += b, after[bin] += a, ++count[bin]; }
  ResidualBreakdown finish() {
    ResidualBreakdown out;
    out.by = breakdown.by;
    for (std::size_t i = 0; i < count.size(); ++i) {
      if (count[i] < 1) continue;
      out.label.push_back(breakdown.label[i]);
      out.before.push_back(before[i] / count[i]);
      out.after.push_back(after[i] / count[i]);
    }
    return out;
  }
};

std::vector<std::string> degreeLabels(const std::vector<double>& edges) {
  std::vector<std::string> labels;
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
    char text[40];
    std::snprintf(text, sizeof text, "%.0f to %.0f degrees", edges[i], edges[i + 1]);
    labels.emplace_back(text);
  }
  return labels;
}

std::size_t binOf(const std::vector<double>& edges, double value) {
  const auto it = std::upper_bound(edges.begin(), edges.end(), value);
  const auto at = static_cast<std::ptrdiff_t>(it - edges.begin()) - 1;
  return static_cast<std::size_t>(
      std::clamp<std::ptrdiff_t>(at, 0, static_cast<std::ptrdiff_t>(edges.size()) - 2));
}

std::size_t shotOf(const TwoShotCapture& capture, const std::string& file) {
  for (std::size_t s = 0; s < capture.shots.size(); ++s)
    if (capture.shots[s].file == file) return s;
  return 0;
}

const TwoShotComparison* comparisonOf(const TwoShotFit& fit, const std::string& file) {
  for (const TwoShotComparison& comparison : fit.comparisons)
    if (comparison.file == file) return &comparison;
  return nullptr;
}

}  // namespace

void describeResiduals(const TwoShotFit& before, const TwoShotFit& after, bool pictures,
                       Explanation* explanation) {
  const TwoShotCapture& capture = before.capture;
  explanation->before = {before.stats.fitRms, before.stats.holdoutRms};
  explanation->after = {after.stats.fitRms, after.stats.holdoutRms};
  explanation->noiseFloorFit = before.stats.noiseFloorFit;
  explanation->noiseFloorHoldout = before.stats.noiseFloorHoldout;

  const std::vector<double> radius{0, 0.2, 0.4, 0.6, 0.8, 1.01}, thetaH{0, 5, 10, 20, 35, 55, 91},
      thetaD{0, 10, 25, 45, 65, 91}, bright{0, 0.1, 0.3, 1, 3, 10, 1e9};
  std::vector<std::string> radiusLabels, files;
  for (std::size_t i = 0; i + 1 < radius.size(); ++i) {
    char text[40];
    std::snprintf(text, sizeof text, "%.1f to %.1f of the corner", radius[i], std::min(radius[i + 1], 1.0));
    radiusLabels.emplace_back(text);
  }
  for (const TwoShotPhoto& shot : capture.shots) files.push_back(shot.file);
  Bins byShot("photograph", files), byRadius("distance from the picture's middle", radiusLabels),
      byThetaH("half-vector's angle to the normal", degreeLabels(thetaH)),
      byThetaD("half of the angle between light and view", degreeLabels(thetaD)),
      byChannel("channel", {"red", "green", "blue"}),
      byBrightness("brightness",
                   {"below 0.1 of the median", "0.1 to 0.3", "0.3 to 1", "1 to 3", "3 to 10", "above 10"});

  double squaresBefore = 0, squaresAfter = 0, count = 0;
  std::vector<ResidualPicture> shown;
  for (const TwoShotComparison& first : before.comparisons) {
    const TwoShotComparison* second = comparisonOf(after, first.file);
    if (first.rendered.empty() || !second || second->rendered.empty()) continue;
    const std::size_t s = shotOf(capture, first.file);
    const TwoShotPhoto& shot = capture.shots[s];
    const SampleView view = viewOf(capture, shot.camera);
    const PhotoNoise noise = estimateNoise({&first.captured, &view.inside});
    PhotoResidual photo;
    photo.photo = static_cast<int>(s), photo.file = first.file, photo.holdout = first.holdout;
    char what[80];
    std::snprintf(what, sizeof what, "half-vector %.0f, difference %.0f degrees in the middle",
                  first.centre.thetaHRad / kDegree, first.centre.thetaDRad / kDegree);
    photo.what = what;
    photo.noise = first.noiseFloor, photo.before = first.rms, photo.after = second->rms;
    explanation->photos.push_back(photo);

    std::vector<float> values;
    for (std::size_t i = 0; i < view.inside.size(); ++i)
      if (view.inside[i]) values.push_back(first.captured.samples()[3 * i + 1]);
    if (values.empty()) continue;
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                     values.end());
    const double median = std::max<double>(values[values.size() / 2], 1e-12);
    double mean = 1e-12;
    for (const float value : values) mean += value / static_cast<double>(values.size());
    ResidualPicture picture;
    picture.photo = photo.photo, picture.file = first.file;
    if (pictures) picture.noiseSigma = Image(view.width, view.height, 3);
    const bool place = s == 0 && explanation->placeBefore.empty();
    if (place) {
      explanation->placeBefore = Image(view.width, view.height, 1);
      explanation->placeAfter = Image(view.width, view.height, 1);
    }
    for (int y = 0; y < view.height; ++y) {
      for (int x = 0; x < view.width; ++x) {
        const std::size_t i = view.index(x, y);
        if (!view.inside[i]) continue;
        const HalfDiffAngles angles = halfDiffFromDirections(shot.toLight, view.toView(i));
        const double r = std::sqrt(cornerShareOf(shot.camera, x, y));
        double pixelBefore = 0, pixelAfter = 0;
        for (int c = 0; c < 3; ++c) {
          const double seen = first.captured.at(x, y, c);
          // A noise of zero would make the sum endless: a sensor has a last digit.
          const double variance = std::max(noise.variance(seen), 1e-8 * (mean * mean + seen * seen));
          const double b = first.rendered.at(x, y, c) - seen, a = second->rendered.at(x, y, c) - seen;
          const double zb = b * b / variance, za = a * a / variance;
          pixelBefore += zb / 3, pixelAfter += za / 3;
          byShot.add(s, zb, za);
          byRadius.add(binOf(radius, r), zb, za);
          byThetaH.add(binOf(thetaH, angles.thetaHRad / kDegree), zb, za);
          byThetaD.add(binOf(thetaD, angles.thetaDRad / kDegree), zb, za);
          byChannel.add(static_cast<std::size_t>(c), zb, za);
          byBrightness.add(binOf(bright, seen / median), zb, za);
          if (pictures) picture.noiseSigma.at(x, y, c) = static_cast<float>(std::sqrt(variance));
        }
        squaresBefore += pixelBefore, squaresAfter += pixelAfter, ++count;
        if (place) {
          explanation->placeBefore.at(x, y) = static_cast<float>(pixelBefore);
          explanation->placeAfter.at(x, y) = static_cast<float>(pixelAfter);
        }
      }
    }
    if (pictures) {
      picture.captured = first.captured, picture.predictedBefore = first.rendered;
      picture.predictedAfter = second->rendered;
      shown.push_back(std::move(picture));
    }
  }
  if (count > 0)
    explanation->chi2Before = squaresBefore / count, explanation->chi2After = squaresAfter / count;
  std::stable_sort(explanation->photos.begin(), explanation->photos.end(),
                   [](const PhotoResidual& a, const PhotoResidual& b) { return a.before > b.before; });
  for (const PhotoResidual& photo : explanation->photos) {
    for (ResidualPicture& picture : shown) {
      if (picture.file == photo.file && explanation->pictures.size() < kMostPictures)
        explanation->pictures.push_back(std::move(picture));
    }
  }
  for (Bins* bins : {&byShot, &byRadius, &byThetaH, &byThetaD, &byChannel, &byBrightness})
    explanation->breakdowns.push_back(bins->finish());

  const bool held = before.stats.holdoutRms >= 0 && after.stats.holdoutRms >= 0;
  const double b = held ? before.stats.holdoutRms : before.stats.fitRms,
               a = held ? after.stats.holdoutRms : after.stats.fitRms,
               floor = held ? before.stats.noiseFloorHoldout : before.stats.noiseFloorFit;
  const double above = b * b - floor * floor, left = std::max(a * a - floor * floor, 0.0);
  explanation->unexplained.fraction = above > 0 ? std::min(left / above, 1.0) : 0.0;
  // Where what is left sits: the bin of each kind that stands out most.
  std::string where;
  for (const ResidualBreakdown& breakdown : explanation->breakdowns) {
    if (breakdown.after.size() < 2 || breakdown.by == "photograph") continue;
    std::size_t most = 0;
    double sum = 0;
    for (std::size_t i = 0; i < breakdown.after.size(); ++i) {
      sum += breakdown.after[i];
      if (breakdown.after[i] > breakdown.after[most]) most = i;
    }
    const double others = (sum - breakdown.after[most]) / static_cast<double>(breakdown.after.size() - 1);
    if (breakdown.after[most] > 2 * others && breakdown.after[most] > 3)
      where += (where.empty() ? "" : "; ") + breakdown.by + ": " + breakdown.label[most];
  }
  char text[300];
  if (a < 1.1 * floor) {
    explanation->unexplained.description = "Nothing beyond the sensor's noise.";
  } else {
    std::snprintf(
        text, sizeof text,
        "%s are predicted to %.1f %% where noise alone would leave %.1f %%: deviations of the material from "
        "the basis, smooth in its angles, that no effect explains%s",
        held ? "Held-out photographs" : "The photographs", 100 * a, 100 * floor,
        where.empty() ? "." : "; they are largest at ");
    explanation->unexplained.description = text + (where.empty() ? where : where + ".");
  }
}

}  // namespace patina
