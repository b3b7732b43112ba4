#include "engine/acquire/picture_shift.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace patina {
namespace {

constexpr int kSmoothReach = 3;  ///< pixels: what is smoother than this is light, not texture

bool counts(const Image& mask, int x, int y) {
  return mask.empty() || mask.at(x, y) > 0;
}

/// Box mean, 2 reach + 1 wide, edges repeated.
Image boxMean(const Image& image, int reach) {
  const int width = image.width(), height = image.height();
  const auto pass = [&](const Image& from, int dx, int dy) {
    Image to(width, height, 1);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        float sum = 0;
        for (int k = -reach; k <= reach; ++k)
          sum += from.at(std::clamp(x + k * dx, 0, width - 1), std::clamp(y + k * dy, 0, height - 1));
        to.at(x, y) = sum / static_cast<float>(2 * reach + 1);
      }
    return to;
  };
  return pass(pass(image, 1, 0), 0, 1);
}

Image minus(Image a, const Image& b) {
  for (std::size_t i = 0; i < a.samples().size(); ++i) a.samples()[i] -= b.samples()[i];
  return a;
}

/// Logarithm, floored at a hundredth of the mean: darker places are noise.
Image logOf(const Image& grey, const Image& mask) {
  double sum = 0, count = 0;
  for (int y = 0; y < grey.height(); ++y)
    for (int x = 0; x < grey.width(); ++x)
      if (counts(mask, x, y)) sum += grey.at(x, y), ++count;
  const auto floor = static_cast<float>(std::max(1e-12, 0.01 * sum / std::max(1.0, count)));
  Image out(grey.width(), grey.height(), 1);
  for (std::size_t i = 0; i < out.samples().size(); ++i)
    out.samples()[i] = std::log(std::max(floor, grey.samples()[i]));
  return out;
}

/// Whether everything within `reach` counts.
bool wellInside(const Image& mask, int width, int height, int x, int y, int reach) {
  if (x < reach || y < reach || x >= width - reach || y >= height - reach) return false;
  return counts(mask, x - reach, y - reach) && counts(mask, x + reach, y - reach) &&
         counts(mask, x - reach, y + reach) && counts(mask, x + reach, y + reach);
}

}  // namespace

Image greyOf(const Image& image) {
  Image grey(image.width(), image.height(), 1);
  const int channels = image.channels();
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x) {
      float sum = 0;
      for (int c = 0; c < channels; ++c) sum += image.at(x, y, c);
      grey.at(x, y) = sum / static_cast<float>(channels);
    }
  return grey;
}

PictureShift pictureShift(const Image& reference, const Image& photo, const Image& mask) {
  PictureShift shift;
  const int width = reference.width(), height = reference.height();
  if (photo.width() != width || photo.height() != height || width < 16 || height < 16) return shift;
  // A little smoothed, both: differences of neighbours are too flat for the finest texture.
  const Image logReference = boxMean(logOf(greyOf(reference), mask), 1);
  const Image difference = minus(boxMean(logOf(greyOf(photo), mask), 1), logReference);
  Image gx(width, height, 1), gy(width, height, 1);
  for (int y = 1; y + 1 < height; ++y)
    for (int x = 1; x + 1 < width; ++x) {
      gx.at(x, y) = 0.5f * (logReference.at(x + 1, y) - logReference.at(x - 1, y));
      gy.at(x, y) = 0.5f * (logReference.at(x, y + 1) - logReference.at(x, y - 1));
    }
  const Image r = minus(difference, boxMean(difference, kSmoothReach));
  const Image hx = minus(gx, boxMean(gx, kSmoothReach)), hy = minus(gy, boxMean(gy, kSmoothReach));
  // Least squares, twice more with what fits badly (highlights that the light moved) counting less.
  constexpr int kRounds = 3;
  constexpr double kOutlier = 1.5;  // of the residual's root mean square; Huber's weights beyond
  constexpr double kAlike = 9;      // residuals of neighbours are alike: a stretch of nine counts as one
  double scale = 1e9;
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix2d products = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    double squares = 0, count = 0;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        if (!wellInside(mask, width, height, x, y, kSmoothReach + 1)) continue;
        const Eigen::Vector2d g(hx.at(x, y), hy.at(x, y));
        const double miss = std::abs(r.at(x, y) + g.dot(shift.px));
        const double weight = miss > kOutlier * scale ? kOutlier * scale / miss : 1.0;
        products += weight * g * g.transpose();
        right += weight * g * r.at(x, y);
        squares += weight * r.at(x, y) * r.at(x, y);
        count += weight;
      }
    // Without texture the products are rounding.
    if (count < 50 || products.trace() < 1e-12 ||
        products.determinant() <= 1e-12 * products.trace() * products.trace())
      return PictureShift{};
    shift.px = -(products.inverse() * right);
    const double residual = std::max(0.0, squares + right.dot(shift.px)) / count;
    scale = std::sqrt(residual);
    shift.uncertaintyPx = std::sqrt(kAlike * residual * products.inverse().diagonal().maxCoeff());
  }
  return shift;
}

double sharpness(const Image& one, const Image& other, const Image& mask) {
  const int width = one.width(), height = one.height();
  if (width < 16 || height < 16) return -1;
  const Image a = logOf(greyOf(one), mask), b = logOf(greyOf(other), mask);
  const Image a1 = boxMean(a, 1), b1 = boxMean(b, 1), a2 = boxMean(a1, 2), b2 = boxMean(b1, 2);
  double fine = 0, coarse = 0, fineSquares = 0, count = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      if (!wellInside(mask, width, height, x, y, 4)) continue;
      const double fa = a.at(x, y) - a1.at(x, y), fb = b.at(x, y) - b1.at(x, y);
      fine += fa * fb;
      fineSquares += fa * fa * fb * fb;
      coarse += static_cast<double>(a1.at(x, y) - a2.at(x, y)) * (b1.at(x, y) - b2.at(x, y));
      ++count;
    }
  // Three standard deviations of what noise alone would give; 1e-6: texture of a thousandth.
  if (count < 50 || coarse / count < 1e-6) return -1;
  if (std::abs(fine) < 3 * std::sqrt(fineSquares)) return coarse > 10 * std::sqrt(fineSquares) ? 0.0 : -1;
  return fine / coarse;
}

}  // namespace patina
