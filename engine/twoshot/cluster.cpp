#include "engine/twoshot/cluster.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "engine/brdf/half_diff.h"

namespace patina {
namespace {

constexpr std::size_t kMostSamples = 3'000;  // for the centres; every pixel is labelled afterwards
constexpr int kStarts = 5, kSteps = 40, kTrendRounds = 4;
constexpr double kLeastSeparation = 3.5, kLeastStep = 0.5;
constexpr int kStepPixels = 3;  // beyond what a lens blurs
constexpr std::size_t kFewestSteps = 20;
constexpr double kLeastDistance = 0.05;  // natural-log units
constexpr double kLeastShare = 0.01;
/// Added before the logarithm, as a share of the median: noise around black is one colour, not many.
constexpr double kFloorShare = 0.1;
constexpr double kNoisy = 0.05;
/// Of the pixels: what is looked at to find the colours.
constexpr double kFlatShare = 0.6;

using Features = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;
using Trend = Eigen::Matrix<double, Eigen::Dynamic, 5, Eigen::RowMajor>;

struct Clusters {
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> centres;
  std::vector<int> label;
  double cost = std::numeric_limits<double>::infinity();
};

int nearestCentre(const Clusters& clusters, const Eigen::RowVector3d& feature) {
  Eigen::Index best = 0;
  (clusters.centres.rowwise() - feature).rowwise().squaredNorm().minCoeff(&best);
  return static_cast<int>(best);
}

/// k-means: seeds far apart (k-means++), then Lloyd's steps.
Clusters kMeans(const Features& features, int count, std::mt19937_64& random) {
  const Eigen::Index n = features.rows();
  Clusters best;
  for (int start = 0; start < kStarts; ++start) {
    Clusters now;
    now.centres.resize(count, 3);
    // No std:: distributions: their results differ from library to library.
    const auto uniform = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
    now.centres.row(0) = features.row(static_cast<Eigen::Index>(uniform() * static_cast<double>(n)));
    Eigen::VectorXd away = Eigen::VectorXd::Constant(n, std::numeric_limits<double>::infinity());
    for (int k = 1; k < count; ++k) {
      away = away.cwiseMin((features.rowwise() - now.centres.row(k - 1)).rowwise().squaredNorm());
      double target = uniform() * away.sum();
      Eigen::Index chosen = 0;
      while (chosen + 1 < n && (target -= away[chosen]) > 0) ++chosen;
      now.centres.row(k) = features.row(chosen);
    }
    now.label.assign(n, -1);
    for (int step = 0; step < kSteps; ++step) {
      Features sums = Features::Zero(count, 3);
      Eigen::VectorXd sizes = Eigen::VectorXd::Zero(count);
      bool changed = false;
      now.cost = 0;
      for (Eigen::Index i = 0; i < n; ++i) {
        const int label = nearestCentre(now, features.row(i));
        changed |= label != now.label[i];
        now.label[i] = label;
        now.cost += (features.row(i) - now.centres.row(label)).squaredNorm();
        sums.row(label) += features.row(i);
        sizes[label] += 1;
      }
      if (!changed) break;
      for (int k = 0; k < count; ++k) {
        if (sizes[k] > 0) now.centres.row(k) = sums.row(k) / sizes[k];
      }
    }
    if (now.cost < best.cost) best = std::move(now);
  }
  return best;
}

/// Clusters and, in turn, the quadratic surface that they share in each channel.
Clusters clusterWithTrend(const Features& raw, const Trend& place, int count, std::uint64_t seed,
                          Eigen::Matrix<double, 5, 3>* trend) {
  std::mt19937_64 random(seed);
  const Eigen::Index n = raw.rows();
  trend->setZero();
  Clusters clusters;
  for (int round = 0; round < kTrendRounds; ++round) {
    const Features flat = raw - place * *trend;
    clusters = kMeans(flat, count, random);
    if (round + 1 == kTrendRounds) break;
    // Offsets of the clusters and the surface together: means within each cluster are taken off both.
    Features means = Features::Zero(count, 3);
    Trend placeMeans = Trend::Zero(count, 5);
    Eigen::VectorXd sizes = Eigen::VectorXd::Zero(count);
    for (Eigen::Index i = 0; i < n; ++i) {
      means.row(clusters.label[i]) += raw.row(i);
      placeMeans.row(clusters.label[i]) += place.row(i);
      sizes[clusters.label[i]] += 1;
    }
    for (int k = 0; k < count; ++k) {
      means.row(k) /= std::max(sizes[k], 1.0);
      placeMeans.row(k) /= std::max(sizes[k], 1.0);
    }
    Eigen::Matrix<double, 5, 5> normal =
        Eigen::Matrix<double, 5, 5>::Identity() * 1e-9 * static_cast<double>(n);
    Eigen::Matrix<double, 5, 3> right = Eigen::Matrix<double, 5, 3>::Zero();
    for (Eigen::Index i = 0; i < n; ++i) {
      const Eigen::Matrix<double, 1, 5> p = place.row(i) - placeMeans.row(clusters.label[i]);
      normal += p.transpose() * p;
      right += p.transpose() * (raw.row(i) - means.row(clusters.label[i]));
    }
    *trend = normal.ldlt().solve(right);
  }
  return clusters;
}

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The least distance between two centres over the spread within along the line between them, in standard
/// deviations; 0 where a cluster is too small or two are too near.
double separationOf(const Features& flat, const Clusters& clusters) {
  const int count = static_cast<int>(clusters.centres.rows());
  std::vector<std::vector<Eigen::Index>> members(count);
  for (std::size_t i = 0; i < clusters.label.size(); ++i)
    members[clusters.label[i]].push_back(static_cast<Eigen::Index>(i));
  double least = std::numeric_limits<double>::infinity();
  for (int a = 0; a < count; ++a) {
    if (static_cast<double>(members[a].size()) < kLeastShare * static_cast<double>(flat.rows())) return 0;
    for (int b = 0; b < a; ++b) {
      const Eigen::RowVector3d line = clusters.centres.row(a) - clusters.centres.row(b);
      const double distance = line.norm();
      if (distance < kLeastDistance) return 0;
      double variance = 0;
      for (const int c : {a, b}) {
        std::vector<double> off;
        for (const Eigen::Index i : members[c])
          off.push_back(std::abs((flat.row(i) - clusters.centres.row(c)).dot(line) / distance));
        const double sd = 1.4826 * median(off);
        variance = std::max(variance, sd * sd);
      }
      least = std::min(least, distance / std::sqrt(variance + 1e-12));
    }
  }
  return least;
}

/// What happens at the borders: for pixels three apart with different labels, the median of their difference
/// along the line between the centres, over the centres' distance; the least of all pairs of clusters that
/// meet. About 1 for materials that meet in a step, near 0 where a cluster ends on a gradient of one
/// material.
double stepAtBorders(const SampleView& view, const std::vector<std::size_t>& pixels,
                     const std::vector<Eigen::RowVector3d>& flat, const Clusters& clusters) {
  std::vector<std::int8_t> label(flat.size(), -1);
  for (const std::size_t i : pixels) label[i] = static_cast<std::int8_t>(nearestCentre(clusters, flat[i]));
  const auto count = static_cast<int>(clusters.centres.rows());
  std::vector<std::vector<double>> steps(static_cast<std::size_t>(count) * count);
  for (const std::size_t i : pixels) {
    const int x = static_cast<int>(i % view.width), y = static_cast<int>(i / view.width);
    for (const auto& [px, py] : {std::pair{x + kStepPixels, y}, std::pair{x, y + kStepPixels}}) {
      if (px >= view.width || py >= view.height) continue;
      const std::size_t j = view.index(px, py);
      if (label[j] < 0 || label[j] == label[i]) continue;
      const Eigen::RowVector3d line = clusters.centres.row(label[i]) - clusters.centres.row(label[j]);
      const int pair = std::min(label[i], label[j]) * count + std::max(label[i], label[j]);
      steps[pair].push_back((flat[i] - flat[j]).dot(line) / line.squaredNorm());
    }
  }
  double least = 1;
  for (std::vector<double>& pair : steps) {
    if (pair.size() >= kFewestSteps) least = std::min(least, median(pair));
  }
  return least;
}

/// How far a picture's pixels are from the mirror direction, mean thetaH.
double meanThetaH(const ReflectancePicture& picture) {
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < picture.usable.size(); i += 7) {  // a sample of them
    if (!picture.usable[i]) continue;
    sum += halfDiffFromDirections(picture.toLight, picture.view.toView(i)).thetaHRad;
    ++count;
  }
  return count > 0 ? sum / static_cast<double>(count) : 0;
}

/// ln(f + floor), of single pixels or, where noise is more than 5 % of the median, of means over 3 x 3.
std::vector<Eigen::RowVector3d> logColours(const ReflectancePicture& picture) {
  const SampleView& view = picture.view;
  Eigen::RowVector3d floor;
  bool noisy = false;
  for (int c = 0; c < 3; ++c) {
    std::vector<double> values, variances;
    for (std::size_t i = 0; i < picture.usable.size(); ++i) {
      if (!picture.usable[i]) continue;
      values.push_back(picture.brdf.samples()[3 * i + c]);
      variances.push_back(picture.variance.samples()[3 * i + c]);
    }
    const double middle = values.empty() ? 0 : median(values);
    floor[c] = std::max(kFloorShare * middle, 1e-6);
    noisy |= !variances.empty() && std::sqrt(median(variances)) > kNoisy * middle;
  }
  std::vector<Eigen::RowVector3d> colours(picture.usable.size(), Eigen::RowVector3d::Zero());
  const int radius = noisy ? 1 : 0;
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      if (!picture.usable[view.index(x, y)]) continue;
      Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
      int count = 0;
      for (int j = std::max(y - radius, 0); j <= std::min(y + radius, view.height - 1); ++j) {
        for (int i = std::max(x - radius, 0); i <= std::min(x + radius, view.width - 1); ++i) {
          if (!picture.usable[view.index(i, j)]) continue;
          for (int c = 0; c < 3; ++c) sum[c] += picture.brdf.at(i, j, c);
          ++count;
        }
      }
      colours[view.index(x, y)] = ((sum / count).cwiseMax(0.0) + floor).array().log();
    }
  }
  return colours;
}

/// The flattest part of the pixels: those that differ least from their neighbours. Pixels on a border mix two
/// materials and would look like a third.
std::vector<std::size_t> flattest(const SampleView& view, const std::vector<std::size_t>& pixels,
                                  const std::vector<std::uint8_t>& usable,
                                  const std::vector<Eigen::RowVector3d>& colours) {
  std::vector<double> slopes;
  for (const std::size_t i : pixels) {
    double slope = 0;
    // The sample's inside has neighbours on all sides.
    for (const std::size_t j : {i - 1, i + 1, i - view.width, i + view.width}) {
      if (usable[j]) slope = std::max(slope, (colours[i] - colours[j]).cwiseAbs().maxCoeff());
    }
    slopes.push_back(slope);
  }
  std::vector<double> sorted = slopes;
  const auto at =
      sorted.begin() + static_cast<std::ptrdiff_t>(kFlatShare * static_cast<double>(sorted.size()));
  if (at == sorted.end()) return pixels;
  std::nth_element(sorted.begin(), at, sorted.end());
  std::vector<std::size_t> flat;
  for (std::size_t i = 0; i < pixels.size(); ++i)
    if (slopes[i] <= *at) flat.push_back(pixels[i]);
  return flat;
}

Eigen::Matrix<double, 1, 5> placeOf(const Eigen::Vector2f& positionMm, double scaleMm) {
  const double x = positionMm.x() / scaleMm, y = positionMm.y() / scaleMm;
  Eigen::Matrix<double, 1, 5> place;
  place << x, y, x * x, x * y, y * y;
  return place;
}

}  // namespace

std::vector<std::int8_t> MaterialMap::labelsFor(const SampleView& view, bool certainOnly) const {
  const auto& source = certainOnly ? certain : label;
  std::vector<std::int8_t> labels(view.onSample.size(), -1);
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (!view.onSample[i]) continue;
    if (label.empty()) {
      labels[i] = 0;
      continue;
    }
    const auto pixel = camera.pixelFromWorld({view.positionMm[i].x(), view.positionMm[i].y(), 0});
    if (!pixel) continue;
    const int x = static_cast<int>(std::lround(pixel->x())), y = static_cast<int>(std::lround(pixel->y()));
    if (x < 0 || y < 0 || x >= camera.width || y >= camera.height) continue;
    labels[i] = source[static_cast<std::size_t>(y) * camera.width + x];
  }
  return labels;
}

MaterialMap clusterMaterials(const TwoShotCapture& capture, const std::vector<ReflectancePicture>& pictures,
                             int count, const JobContext& job) {
  MaterialMap map;
  if (count == 1) return map;
  double farthest = -1;
  for (std::size_t p = 0; p < pictures.size(); ++p) {
    const double theta = meanThetaH(pictures[p]);
    if (theta > farthest) farthest = theta, map.picture = p;
  }
  const ReflectancePicture& picture = pictures[map.picture];
  const SampleView& view = picture.view;
  map.camera = capture.shots[picture.shots.front()].camera;
  const double scaleMm = capture.disc ? capture.radiusMm : std::max(capture.widthMm, capture.heightMm) / 2;

  const std::vector<Eigen::RowVector3d> colours = logColours(picture);
  std::vector<std::size_t> pixels;
  for (std::size_t i = 0; i < colours.size(); ++i)
    if (picture.usable[i]) pixels.push_back(i);
  const std::vector<std::size_t> flatPixels = flattest(view, pixels, picture.usable, colours);
  const std::size_t stride = std::max<std::size_t>(1, flatPixels.size() / kMostSamples);
  const auto n = static_cast<Eigen::Index>((flatPixels.size() + stride - 1) / stride);
  Features raw(n, 3);
  Trend place(n, 5);
  for (Eigen::Index i = 0; i < n; ++i) {
    const std::size_t pixel = flatPixels[i * stride];
    raw.row(i) = colours[pixel];
    place.row(i) = placeOf(view.positionMm[pixel], scaleMm);
  }

  Clusters chosen;
  Eigen::Matrix<double, 5, 3> chosenTrend;
  const int first = count > 0 ? count : 2, last = count > 0 ? count : kMostMaterials;
  for (int k = first; k <= last && n > 10 * k && !job.cancelled(); ++k) {
    Eigen::Matrix<double, 5, 3> trend;
    Clusters clusters = clusterWithTrend(raw, place, k, job.seed, &trend);
    const double separation = separationOf(raw - place * trend, clusters);
    if (count == 0) {
      if (separation < kLeastSeparation) continue;
      std::vector<Eigen::RowVector3d> flat = colours;
      for (const std::size_t i : pixels) flat[i] -= placeOf(view.positionMm[i], scaleMm) * trend;
      if (stepAtBorders(view, pixels, flat, clusters) < kLeastStep) continue;
    }
    map.count = k, map.separation = separation;
    chosen = std::move(clusters), chosenTrend = trend;
  }
  if (map.count == 1) return map;

  // Largest first.
  std::vector<std::size_t> sizes(map.count, 0);
  for (const int label : chosen.label) ++sizes[label];
  std::vector<int> order(map.count), rank(map.count);
  for (int k = 0; k < map.count; ++k) order[k] = k;
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return sizes[a] > sizes[b]; });
  for (int k = 0; k < map.count; ++k) rank[order[k]] = k;

  std::vector<std::int8_t> label(colours.size(), -1);
  for (const std::size_t i : pixels) {
    label[i] = static_cast<std::int8_t>(
        rank[nearestCentre(chosen, colours[i] - placeOf(view.positionMm[i], scaleMm) * chosenTrend)]);
  }
  // Pixels of the sample that weren't used (clipped, at its rim) take the label of a labelled neighbour.
  for (int pass = 0; pass < 3; ++pass) {
    std::vector<std::int8_t> grown = label;
    for (int y = 1; y + 1 < view.height; ++y) {
      for (int x = 1; x + 1 < view.width; ++x) {
        const std::size_t i = view.index(x, y);
        if (label[i] >= 0 || !view.onSample[i]) continue;
        for (const std::size_t j : {i - 1, i + 1, i - view.width, i + view.width})
          if (label[j] >= 0) grown[i] = label[j];
      }
    }
    label = std::move(grown);
  }
  // Features are means over 3 x 3 pixels, so a pixel is certain where all within two agree.
  map.certain = label;
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const std::size_t i = view.index(x, y);
      for (int j = std::max(y - 2, 0); j <= std::min(y + 2, view.height - 1); ++j) {
        for (int k = std::max(x - 2, 0); k <= std::min(x + 2, view.width - 1); ++k) {
          const std::int8_t other = label[view.index(k, j)];
          if (other >= 0 && other != label[i]) map.certain[i] = -1;
        }
      }
    }
  }
  map.label = std::move(label);
  return map;
}

}  // namespace patina
