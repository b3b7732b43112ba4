#include "engine/twoshot/deviation.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
/// Reflectance of a coat at normal incidence: a refractive index of 1.5.
constexpr double kCoatReflectance = 0.04;
/// A tint is a modest change of colour; beyond this it is a search that went astray.
constexpr double kSmallestTint = 1e-3;

/// (1 - cos)^5 without pow.
double schlick(double cosine) {
  const double x = std::clamp(1 - cosine, 0.0, 1.0), square = x * x;
  return square * square * x;
}

/// Height-correlated Smith's masking and shadowing over 4 cos cos (Heitz 2014), for GGX.
double visibility(double cosLight, double cosView, double alpha) {
  const double a2 = alpha * alpha;
  const double light = cosView * std::sqrt(a2 + (1 - a2) * cosLight * cosLight);
  const double view = cosLight * std::sqrt(a2 + (1 - a2) * cosView * cosView);
  return 0.5 / std::max(light + view, 1e-9);  // both at the horizon: the lobe is not defined there
}

double coatLobe(const CoatLobe& coat, const DirectionPair& pair) {
  if (!(pair.toLight.z() > 0 && pair.toView.z() > 0)) return 0;
  const Eigen::Vector3d half = (pair.toLight + pair.toView).normalized();
  const double a2 = coat.alpha * coat.alpha, z2 = half.z() * half.z();
  // 1 - z^2 from the half-vector itself: at alpha 0.01 the difference of squares has lost half of its digits.
  const double spread = half.head<2>().squaredNorm() + a2 * z2;
  const double distribution = a2 / (std::numbers::pi * spread * spread);
  const double fresnel = kCoatReflectance + (1 - kCoatReflectance) * schlick(pair.toLight.dot(half));
  return coat.weight * distribution * visibility(pair.toLight.z(), pair.toView.z(), coat.alpha) * fresnel;
}

Eigen::Array3d retroLobe(const RetroLobe& retro, const DirectionPair& pair) {
  const double apart =
      2 * std::atan2((pair.toLight - pair.toView).norm(), (pair.toLight + pair.toView).norm());
  const double x = apart / (retro.widthDeg * kDegree);
  const double cosH = std::max((pair.toLight + pair.toView).normalized().z(), 0.0);
  return retro.weight * (std::pow(1 + x * x, -retro.tail) * std::pow(cosH, retro.incidence));
}

Eigen::Matrix3d worldFromSample(const Eigen::Vector2d& tiltDeg) {
  return (Eigen::AngleAxisd(tiltDeg.y() * kDegree, Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(tiltDeg.x() * kDegree, Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

/// One pass of a running mean of 2 r + 1 samples along a line, its ends repeated.
void boxPass(std::vector<double>& line, std::vector<double>& out, int radius) {
  const int n = static_cast<int>(line.size());
  double sum = 0;
  const auto at = [&](int i) { return line[std::clamp(i, 0, n - 1)]; };
  for (int i = -radius; i <= radius; ++i) sum += at(i);
  for (int i = 0; i < n; ++i) {
    out[i] = sum / (2 * radius + 1);
    sum += at(i + radius + 1) - at(i - radius);
  }
  line.swap(out);
}

void gaussPass(std::vector<double>& line, std::vector<double>& out, double sigma) {
  const int n = static_cast<int>(line.size()), reach = static_cast<int>(std::ceil(3.5 * sigma));
  std::vector<double> kernel;
  double total = 0;
  for (int i = -reach; i <= reach; ++i) {
    kernel.push_back(std::exp(-0.5 * i * i / (sigma * sigma)));
    total += kernel.back();
  }
  for (int i = 0; i < n; ++i) {
    double sum = 0;
    for (int k = -reach; k <= reach; ++k) sum += kernel[k + reach] * line[std::clamp(i + k, 0, n - 1)];
    out[i] = sum / total;
  }
  line.swap(out);
}

void blurLine(std::vector<double>& line, std::vector<double>& scratch, double sigma) {
  if (sigma < 8) return gaussPass(line, scratch, sigma);
  // Three running means of the same length come within 10 % of the variance where it is as wide as this.
  const int radius = std::max(1, static_cast<int>(std::lround((std::sqrt(4 * sigma * sigma + 1) - 1) / 2)));
  for (int pass = 0; pass < 3; ++pass) boxPass(line, scratch, radius);
}

/// Each channel takes a share of the other two's mean.
Eigen::Array3d mixed(const Eigen::Array3d& value, double share) {
  const double sum = value.sum();
  return (1 - share) * value + share * (sum - value) / 2;
}

}  // namespace

Image blurredImage(const Image& image, double sigmaPx) {
  Image out = image;
  for (int c = 0; c < image.channels(); ++c) {
    tbb::parallel_for(0, image.height(), [&](int y) {
      std::vector<double> line(image.width()), scratch(image.width());
      for (int x = 0; x < image.width(); ++x) line[x] = out.at(x, y, c);
      blurLine(line, scratch, sigmaPx);
      for (int x = 0; x < image.width(); ++x) out.at(x, y, c) = static_cast<float>(line[x]);
    });
    tbb::parallel_for(0, image.width(), [&](int x) {
      std::vector<double> line(image.height()), scratch(image.height());
      for (int y = 0; y < image.height(); ++y) line[y] = out.at(x, y, c);
      blurLine(line, scratch, sigmaPx);
      for (int y = 0; y < image.height(); ++y) out.at(x, y, c) = static_cast<float>(line[y]);
    });
  }
  return out;
}

double cornerShareOf(const Camera& camera, double x, double y) {
  const double cx = 0.5 * (camera.width - 1), cy = 0.5 * (camera.height - 1);
  return ((x - cx) * (x - cx) + (y - cy) * (y - cy)) / std::max(cx * cx + cy * cy, 1.0);
}

bool TwoShotDeviation::none() const {
  return tiltDeg.isZero(0) && heightMm == 0 && lightPerM == 0 && vignetting == 0 && vignettingLate == 0 &&
         std::all_of(stray.begin(), stray.end(), [](const Eigen::Array3d& s) { return (s == 0).all(); }) &&
         std::all_of(lnGain.begin(), lnGain.end(), [](double g) { return g == 0; }) &&
         (blackLevel == 0).all() && lnResponse == 0 && crosstalk == 0 && glare == 0 && defocusPx == 0 &&
         saturation == 0 && stretch.isZero(0) && !retro && !coat && sheen == 0 && fresnel == 0 &&
         tint.isZero(0) && !correction;
}

DirectionPair TwoShotDeviation::directions(const PhotoPoint& point) const {
  const Eigen::Vector3d position(point.positionMm.x(), point.positionMm.y(), heightMm);
  DirectionPair pair{point.toLight, (point.cameraMm - position).normalized()};
  if (lightPerM != 0) pair.toLight = (point.toLight - position * (lightPerM / 1000)).normalized();
  if (!tiltDeg.isZero(0)) {
    const Eigen::Matrix3d sampleFromWorld = worldFromSample(tiltDeg).transpose();
    pair.toLight = sampleFromWorld * pair.toLight;
    pair.toView = sampleFromWorld * pair.toView;
  }
  return pair;
}

HalfDiffAngles TwoShotDeviation::angles(const DirectionPair& pair) const {
  HalfDiffAngles found = halfDiffFromDirections(pair.toLight, pair.toView);
  if (!stretch.isZero(0)) {
    const Eigen::Vector3d half = pair.toLight + pair.toView;
    const double twice = 2 * std::atan2(half.y(), half.x());
    const double scale = 1 + stretch.x() * std::cos(twice) + stretch.y() * std::sin(twice);
    found.thetaHRad = std::clamp(found.thetaHRad * scale, 0.0, std::numbers::pi / 2);
  }
  return found;
}

Eigen::Array3d TwoShotDeviation::added(const DirectionPair& pair) const {
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  if (retro) sum += retroLobe(*retro, pair);
  if (coat) sum += coatLobe(*coat, pair);
  if (sheen != 0) sum += sheen * schlick(pair.toLight.dot((pair.toLight + pair.toView).normalized()));
  return sum;
}

Eigen::Array3d TwoShotDeviation::multiplied(const HalfDiffAngles& angles) const {
  if (fresnel == 0 && tint.isZero(0) && !correction) return Eigen::Array3d::Ones();
  const double x = 1 - std::cos(angles.thetaDRad);
  const Eigen::Vector2d modes(x, x * x);
  const double redBlue = modes.dot(tint.row(0)), green = modes.dot(tint.row(1));
  Eigen::Array3d ln(redBlue / 2 - green / 3, 2 * green / 3, -redBlue / 2 - green / 3);
  ln += fresnel * schlick(1 - x);
  if (correction) ln += correction->lnFactor(angles);
  return ln.exp().max(kSmallestTint);
}

double TwoShotDeviation::gain(const PhotoPoint& point, const DirectionPair& pair) const {
  double factor =
      1 - vignetting * point.cornerShare - vignettingLate * point.cornerShare * (point.cornerShare - 1);
  if (!lnGain.empty()) factor *= std::exp(lnGain[point.shot]);
  if (!tiltDeg.isZero(0) || (lightPerM != 0 && !whiteLitAlike)) {
    // The white tile lies flat, under the same light or under one that was taken for distant.
    Eigen::Vector3d onTile = point.toLight;
    const Eigen::Vector3d toLight =
        point.toLight -
        Eigen::Vector3d(point.positionMm.x(), point.positionMm.y(), heightMm) * (lightPerM / 1000);
    if (whiteLitAlike) {
      onTile = toLight.normalized();
    } else {
      factor /= toLight.squaredNorm();
    }
    // Below the horizon there is no light; 0.02 keeps the logarithm of a grazing row finite.
    factor *= std::max(pair.toLight.z(), 0.02) / std::max(onTile.z(), 0.02);
  }
  return std::max(factor, 0.02);
}

Eigen::Array3d TwoShotDeviation::baseFromSeen(const Eigen::Array3d& seen, const PhotoPoint& point,
                                              const DirectionPair& pair, Eigen::Array3d* slope) const {
  Eigen::Array3d value = seen, derivative = Eigen::Array3d::Ones();
  if (lnResponse != 0) {
    const double exponent = std::exp(-lnResponse);
    const Eigen::Array3d pixel = (value * point.rate * point.exposureS / responseTop).max(1e-9);
    derivative *= exponent * pixel.pow(exponent - 1);
    value = responseTop * pixel.pow(exponent) / (point.rate * point.exposureS);
  }
  if ((blackLevel != 0).any()) value -= blackLevel / (point.rate * point.exposureS);
  if (!stray.empty()) value -= stray[point.shot] / point.rate;
  if (crosstalk != 0) {
    // The mixing matrix (1 - 1.5 s) I + 0.5 s J has the inverse below.
    const double own = 1 - 1.5 * crosstalk;
    const Eigen::Array3d pixel = value * point.rate;
    value = (pixel - 0.5 * crosstalk * pixel.sum()) / own / point.rate;
    derivative *= (1 - 0.5 * crosstalk) / own;
  }
  const double factor = gain(point, pair);
  value /= factor, derivative /= factor;
  value -= added(pair);
  const Eigen::Array3d times = multiplied(angles(pair));
  if (slope) *slope = derivative / times;
  return value / times;
}

Eigen::Array3d TwoShotDeviation::seenFromBase(const Eigen::Array3d& base, const PhotoPoint& point,
                                              const DirectionPair& pair) const {
  Eigen::Array3d value = base * multiplied(angles(pair)) + added(pair);
  value *= gain(point, pair);
  if (crosstalk != 0) value = mixed(value * point.rate, crosstalk) / point.rate;
  if (!stray.empty()) value += stray[point.shot] / point.rate;
  if ((blackLevel != 0).any()) value += blackLevel / (point.rate * point.exposureS);
  if (lnResponse != 0) {
    const Eigen::Array3d pixel = (value * point.rate * point.exposureS / responseTop).max(1e-9);
    value = responseTop * pixel.pow(std::exp(lnResponse)) / (point.rate * point.exposureS);
  }
  return value;
}

TwoShotDeviation TwoShotDeviation::withoutSurfaceTerms() const {
  TwoShotDeviation out = *this;
  out.retro.reset(), out.coat.reset();
  out.sheen = out.fresnel = 0;
  out.tint.setZero();
  out.correction.reset();
  return out;
}

Image TwoShotDeviation::sharpened(const Image& photo) const {
  Image out = photo;
  const auto takeOff = [&](double sigmaPx, double share) {
    const Image blurred = blurredImage(photo, sigmaPx);
    for (std::size_t i = 0; i < out.samples().size(); ++i)
      out.samples()[i] -= static_cast<float>(share * (blurred.samples()[i] - photo.samples()[i]));
  };
  if (glare != 0) takeOff(glarePx, glare);
  return out;
}

Image TwoShotDeviation::blurred(const Image& photo) const {
  Image out = photo;
  if (defocusPx > 0) out = blurredImage(out, defocusPx);
  if (glare != 0) {
    const Image wide = blurredImage(out, glarePx);
    for (std::size_t i = 0; i < out.samples().size(); ++i)
      out.samples()[i] += static_cast<float>(glare * (wide.samples()[i] - out.samples()[i]));
  }
  return out;
}

std::shared_ptr<const TabulatedBrdf> TwoShotDeviation::withSurfaceTerms(
    std::shared_ptr<const TabulatedBrdf> table) const {
  if (!retro && !coat && sheen == 0 && fresnel == 0 && tint.isZero(0) && !correction) return table;
  TabulatedBrdf::Planes planes = table->planes();
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, MerlGrid::kCells, 8192),
                    [&](const tbb::blocked_range<std::size_t>& range) {
                      for (std::size_t cell = range.begin(); cell < range.end(); ++cell) {
                        if (!table->valid(cell)) continue;
                        const HalfDiffAngles at = MerlGrid::centre(cell);
                        const Eigen::Array3d plus = added(directionsFromHalfDiff(at)), times = multiplied(at);
                        for (int c = 0; c < 3; ++c)
                          planes[c][cell] = std::max(planes[c][cell] * times[c] + plus[c], 0.0);
                      }
                    });
  return std::make_shared<const TabulatedBrdf>(std::move(planes), table->origin());
}

}  // namespace patina
