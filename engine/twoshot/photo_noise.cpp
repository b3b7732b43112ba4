#include "engine/twoshot/photo_noise.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace patina {
namespace {

constexpr int kBins = 16;
constexpr std::size_t kFewestPatches = 100;
/// Patches looked at: the variance of each bin is then known to about 2 %.
constexpr std::size_t kMostPatches = 60'000;
/// Median of a chi-squared variable of 3 degrees of freedom, over 3.
constexpr double kMedianOfVariance = 2.366 / 3;
constexpr std::size_t kSmallestPlateau = 16;
constexpr double kSmallestPlateauShare = 1e-4;
constexpr std::size_t kPlateauOverNext = 10;

struct Patch {
  double mean, variance;
};

/// What is left of a 3 x 3 patch after its quadratic fit; orthogonal polynomials on {-1, 0, 1}^2.
Patch residualOf(const Image& image, int x, int y, int channel) {
  double sum = 0, squares = 0, gx = 0, gy = 0, cx = 0, cy = 0, cross = 0;
  for (int j = -1; j <= 1; ++j) {
    for (int i = -1; i <= 1; ++i) {
      const double v = image.at(x + i, y + j, channel);
      sum += v, squares += v * v;
      gx += i * v, gy += j * v, cross += i * j * v;
      cx += (i * i - 2.0 / 3) * v, cy += (j * j - 2.0 / 3) * v;
    }
  }
  const double left =
      squares - sum * sum / 9 - (gx * gx + gy * gy) / 6 - (cx * cx + cy * cy) / 2 - cross * cross / 4;
  return {sum / 9, std::max(left, 0.0) / 3};
}

std::vector<Patch> collectPatches(const MaskedPhoto& photo) {
  const Image& image = *photo.image;
  const std::size_t stride = std::max<std::size_t>(1, image.pixelCount() / 9 * 3 / kMostPatches);
  std::vector<Patch> patches;
  std::size_t turn = 0;
  // A clipped patch has no noise left and would make the brightest look the best known.
  std::array<float, 3> largest{};
  for (std::size_t i = 0; i < image.pixelCount(); ++i) {
    if (!(*photo.mask)[i]) continue;
    for (int c = 0; c < 3; ++c) largest[c] = std::max(largest[c], image.samples()[3 * i + c]);
  }
  const auto clipped = [&](int x, int y, int c) {
    int at = 0;
    for (int j = -1; j <= 1; ++j) {
      for (int i = -1; i <= 1; ++i) at += image.at(x + i, y + j, c) >= largest[c];
    }
    return at >= 2;
  };
  const auto inside = [&](int x, int y) {
    for (int j = -1; j <= 1; ++j) {
      for (int i = -1; i <= 1; ++i) {
        if (!(*photo.mask)[static_cast<std::size_t>(y + j) * image.width() + x + i]) return false;
      }
    }
    return true;
  };
  for (int y = 1; y + 1 < image.height(); y += 3) {
    for (int x = 1; x + 1 < image.width(); x += 3) {
      if (turn++ % stride != 0 || !inside(x, y)) continue;
      for (int c = 0; c < 3; ++c) {
        if (!clipped(x, y, c)) patches.push_back(residualOf(image, x, y, c));
      }
    }
  }
  return patches;
}

}  // namespace

PhotoNoise estimateNoise(const MaskedPhoto& photo) {
  std::vector<Patch> patches = collectPatches(photo);
  double mean = 0;
  for (const Patch& patch : patches) mean += std::max(patch.mean, 0.0) / static_cast<double>(patches.size());
  const double smallest = std::max(1e-6 * mean, 1e-12);  // a rendering still has its file's digits
  if (patches.size() < kFewestPatches) return {0, std::max(0.01 * mean, smallest)};
  std::sort(patches.begin(), patches.end(), [](const Patch& a, const Patch& b) { return a.mean < b.mean; });

  std::array<double, kBins> value{}, variance{}, expected{};
  for (int b = 0; b < kBins; ++b) {
    const auto from = patches.begin() + static_cast<std::ptrdiff_t>(patches.size() * b / kBins);
    const auto to = patches.begin() + static_cast<std::ptrdiff_t>(patches.size() * (b + 1) / kBins);
    std::vector<double> variances;
    for (auto it = from; it != to; ++it) {
      value[b] += it->mean / static_cast<double>(to - from);
      variances.push_back(it->variance);
    }
    const auto middle = variances.begin() + static_cast<std::ptrdiff_t>(variances.size() / 2);
    std::nth_element(variances.begin(), middle, variances.end());
    variance[b] = *middle / kMedianOfVariance;
    expected[b] = variance[b];
  }
  // A bin's variance is known to a fixed relative error: weights one over the fitted value squared, iterated.
  double slope = 0, offset = 0;
  for (int iteration = 0; iteration < 5; ++iteration) {
    double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
    for (int b = 0; b < kBins; ++b) {
      const double w = 1 / std::max(expected[b] * expected[b], 1e-60), x = std::max(value[b], 0.0);
      s += w, sx += w * x, sy += w * variance[b], sxx += w * x * x, sxy += w * x * variance[b];
    }
    const double determinant = s * sxx - sx * sx;
    slope = determinant > 1e-12 * s * sxx ? (s * sxy - sx * sy) / determinant : 0;
    offset = (sy - slope * sx) / s;
    // Neither can be negative.
    if (offset < 0) offset = 0, slope = sxx > 0 ? sxy / sxx : 0;
    if (slope < 0) slope = 0, offset = sy / s;
    for (int b = 0; b < kBins; ++b) expected[b] = std::max(slope * value[b] + offset, smallest * smallest);
  }
  return {slope, std::max(std::sqrt(offset), smallest)};
}

Eigen::Array3d clipLevels(const MaskedPhoto& photo, double saturation, double limit) {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  // What is stored in 16 bits may be rounded by 2^-11 below the level, and a pixel that the limit cuts only
  // in part lies a little below it too.
  constexpr double kJustBelow = 0.995;
  if (saturation > 0) return Eigen::Array3d::Constant(kJustBelow * saturation);
  Eigen::Array3d levels = Eigen::Array3d::Constant(kNever);
  const Image& image = *photo.image;
  const std::size_t pixels = image.pixelCount();
  for (int c = 0; c < 3; ++c) {
    float largest = -std::numeric_limits<float>::infinity(), next = largest;
    std::size_t atLargest = 0, atNext = 0, masked = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      if (!(*photo.mask)[i]) continue;
      ++masked;
      const float v = image.samples()[3 * i + c];
      if (v > largest) {
        next = largest, atNext = atLargest;
        largest = v, atLargest = 1;
      } else if (v == largest) {
        ++atLargest;
      } else if (v > next) {
        next = v, atNext = 1;
      } else if (v == next) {
        ++atNext;
      }
    }
    if (masked == 0) continue;
    if (atLargest == masked) {
      if (largest >= limit) levels[c] = largest;
      continue;
    }
    const double share = static_cast<double>(atLargest) / static_cast<double>(masked);
    if (largest > 0 && atLargest >= kSmallestPlateau && share >= kSmallestPlateauShare &&
        atLargest >= kPlateauOverNext * atNext) {
      levels[c] = largest;
    }
  }
  return levels;
}

}  // namespace patina
