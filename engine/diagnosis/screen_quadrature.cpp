#include "engine/diagnosis/screen_quadrature.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/diagnosis/screen_quadrature.cpp"
#include <hwy/foreach_target.h>
// after foreach_target
#include <hwy/aligned_allocator.h>
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

#ifndef PATINA_SCREEN_QUADRATURE_SHARED
#define PATINA_SCREEN_QUADRATURE_SHARED
namespace patina::quadrature {

inline constexpr int kSide = 12;          // nodes of a lobe along each axis
inline constexpr double kSpacing = 0.72;  // of them, standard deviations: +-3.96 of them are covered
inline constexpr float kFinestPhase =
    4;                           // radians of a harmonic's phase per standard deviation: e^-8 is left of it
inline constexpr int kPad = 16;  // floats of the widest vector
inline constexpr int kLobeNodes = kSide * kSide;  // a multiple of kPad
inline constexpr int kMostGrid = 512;
inline constexpr float kHorizonWidth = 0.04f;  // of a trial horizon's logistic edge, in sines of elevation
inline constexpr float kGridHorizonWidth = 0.016f;  // of one over the lit area's own nodes
// What 24 and 16 Legendre nodes over the lit area resolve, pattern units.
inline constexpr float kBumpCentre[3] = {0.35f, 0.55f, 0.75f}, kBumpWidth = 0.15f;
inline constexpr float kMostAlongX = 9, kMostAlongY = 11;

/// Nodes of one peak: centre and factor of its covariance, both in pattern units, relative to the foot.
struct Peak {
  double x = 0, y = 0;
  double l11 = 1, l21 = 0, l22 = 1;  // lower Cholesky factor
  double weight = 0;                 // of a node
  bool onScreen = true;
};

/// The site with everything that its nodes share.
struct SiteFrame {
  Eigen::Vector3d n, dnX, dnY, t1, t2, view;
  double distance, footX, footY;
  double m11 = 1, m12 = 0, m22 = 1;  // exp(-stretch)
};

}  // namespace patina::quadrature
#endif

HWY_BEFORE_NAMESPACE();
namespace patina::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;
namespace q = patina::quadrature;

using Tag = hn::CappedTag<float, q::kPad>;
using Vec = hn::Vec<Tag>;
using Mask = hn::Mask<Tag>;

#include "engine/fourier/lanes.inc"
// after lanes.inc
#include "engine/diagnosis/screen_quadrature.inc"
}  // namespace patina::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace patina {

HWY_EXPORT(EvaluateSite);
HWY_EXPORT(FillGridRows);

namespace {

void legendreNodes(int count, std::vector<double>& node, std::vector<double>& weight) {
  // Eigenvalues of the Jacobi matrix (Golub and Welsch 1969).
  Eigen::MatrixXd jacobi = Eigen::MatrixXd::Zero(count, count);
  for (int i = 1; i < count; ++i) jacobi(i, i - 1) = jacobi(i - 1, i) = i / std::sqrt(4.0 * i * i - 1);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(jacobi);
  for (int i = 0; i < count; ++i) {
    node.push_back(solver.eigenvalues()[i]);
    weight.push_back(2 * solver.eigenvectors()(0, i) * solver.eigenvectors()(0, i));
  }
}

/// Mode and curvature of lobe times window times emission, by Newton's method on the Gaussian parts.
quadrature::Peak findPeak(const ScreenQuadrature& quad, const quadrature::SiteFrame& site, double sigma) {
  quadrature::Peak peak;
  const double on = site.view.dot(site.n);
  const Eigen::Vector3d mirror = 2 * on * site.n - site.view;
  const double down = std::max(-mirror.z(), 0.17);
  double x = mirror.x() / down * site.distance, y = mirror.y() / down * site.distance;
  const ScreenFrame& frame = quad.frame_;
  double p11 = 1, p12 = 0, p22 = 1;
  for (int step = 0; step < 7; ++step) {
    const double invD = 1 / std::sqrt(x * x + y * y + site.distance * site.distance);
    const Eigen::Vector3d light(x * invD, y * invD, -site.distance * invD);
    const Eigen::Vector3d s = light + site.view;
    const double sn = std::max(s.dot(site.n), 1e-3);
    const Eigen::Vector3d slope = s / sn - site.n;
    const double y1 = slope.dot(site.t1), y2 = slope.dot(site.t2);
    double d1[2], d2[2];
    for (int k = 0; k < 2; ++k) {
      const Eigen::Vector3d axis = k == 0 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY();
      const Eigen::Vector3d dLight = (axis - light * light[k]) * invD;
      const Eigen::Vector3d dSlope = (dLight - s * (dLight.dot(site.n) / sn)) / sn;
      d1[k] = dSlope.dot(site.t1);
      d2[k] = dSlope.dot(site.t2);
    }
    const double inv = 1 / (sigma * sigma);
    const auto product = [&](double a1, double a2, double b1, double b2) {
      return inv * (site.m11 * a1 * b1 + site.m12 * (a1 * b2 + a2 * b1) + site.m22 * a2 * b2);
    };
    const double e0 = frame.emissionPrecision.x() / (site.distance * site.distance),
                 e1 = frame.emissionPrecision.y() / (site.distance * site.distance);
    p11 = product(d1[0], d2[0], d1[0], d2[0]) + frame.windowPrecision.x() + e0;
    p12 = product(d1[0], d2[0], d1[1], d2[1]);
    p22 = product(d1[1], d2[1], d1[1], d2[1]) + frame.windowPrecision.y() + e1;
    const double g0 = product(y1, y2, d1[0], d2[0]) + frame.windowPrecision.x() * (x + site.footX) +
                      e0 * (x - site.distance * frame.emissionMean.x());
    const double g1 = product(y1, y2, d1[1], d2[1]) + frame.windowPrecision.y() * (y + site.footY) +
                      e1 * (y - site.distance * frame.emissionMean.y());
    const double det = p11 * p22 - p12 * p12;
    double dx = -(p22 * g0 - p12 * g1) / det, dy = -(p11 * g1 - p12 * g0) / det;
    const double length = std::hypot(dx, dy), longest = 1.5;
    if (length > longest) dx *= longest / length, dy *= longest / length;
    x += dx, y += dy;
    if (length < 1e-4) break;
  }
  const double det = p11 * p22 - p12 * p12;
  const double cxx = p22 / det, cxy = -p12 / det, cyy = p11 / det;
  peak.x = x, peak.y = y;
  peak.l11 = std::sqrt(cxx);
  peak.l21 = cxy / peak.l11;
  peak.l22 = std::sqrt(std::max(cyy - peak.l21 * peak.l21, 1e-18));
  peak.weight = peak.l11 * peak.l22 * quadrature::kSpacing * quadrature::kSpacing;
  // Three standard deviations inside the rim.
  peak.onScreen = std::abs(x + site.footX) + 3 * std::sqrt(cxx) < frame.halfExtent.x() &&
                  std::abs(y + site.footY) + 3 * std::sqrt(cyy) < frame.halfExtent.y();
  return peak;
}

}  // namespace

double quadrature::logEmission(const QuadratureState& state, double u, double v, double x, double y) {
  double sum = state.angular[0] * u * u + state.angular[1] * v * v + state.angular[2] * v;
  const double s = std::hypot(u, v);
  for (std::size_t k = 0; k < 3; ++k)
    sum += state.angular[3 + k] * std::exp(-0.5 * std::pow((s - kBumpCentre[k]) / kBumpWidth, 2));
  const double r2 = x * x + y * y;
  return sum + state.spatial[0] * x + state.spatial[1] * y + state.spatial[2] * x * x +
         state.spatial[3] * x * y + state.spatial[4] * y * y + state.spatial[5] * r2 * r2;
}

ScreenQuadrature::Harmonics ScreenQuadrature::harmonicsOf(double gamma) {
  Harmonics h;
  if (gamma == 1) {
    h.odd[0] = 0.5f;
    for (int m = 0; m < 25; ++m)
      h.even[static_cast<std::size_t>(m)] =
          static_cast<float>((m == 0 ? 1 : 2) * -std::numbers::inv_pi / (4.0 * m * m - 1));
    return h;
  }
  // Substituting t = u - sin(2 u) / 2 makes the integrand smooth at both ends, where |sin t|^gamma is not.
  constexpr int kNodes = 4000;
  std::array<double, 4> odd{};
  std::array<double, 25> even{};
  for (int i = 0; i < kNodes; ++i) {
    const double u = (i + 0.5) / kNodes * std::numbers::pi, t = u - 0.5 * std::sin(2 * u);
    const double weight = (1 - std::cos(2 * u)) * std::numbers::pi / kNodes,
                 value = std::pow(std::sin(t), gamma) * weight;
    for (std::size_t k = 0; k < 4; ++k) odd[k] += value * std::sin((2.0 * static_cast<double>(k) + 1) * t);
    for (std::size_t m = 0; m < 25; ++m) even[m] += value * std::cos(2.0 * static_cast<double>(m) * t);
  }
  for (std::size_t k = 0; k < 4; ++k) h.odd[k] = static_cast<float>(odd[k] / std::numbers::pi);
  for (std::size_t m = 0; m < 25; ++m)
    h.even[m] = static_cast<float>((m == 0 ? 0.5 : 1) * even[m] / std::numbers::pi);
  return h;
}

ScreenQuadrature::ScreenQuadrature(const ScreenFrame& frame, Eigen::Vector2d sampleSizeMm,
                                   const std::vector<Eigen::Vector2i>& frequencies,
                                   const QuadratureState& state)
    : frame_(frame), state_(state) {
  for (const auto& w : frequencies) frequency_.push_back(w.cast<float>());
  shown_ = harmonicsOf(state.screenGamma);
  constexpr double kStep = 1e-3;
  const Harmonics above = harmonicsOf(state.screenGamma + kStep),
                  below = harmonicsOf(state.screenGamma - kStep);
  for (std::size_t k = 0; k < 4; ++k)
    shownSlope_.odd[k] = (above.odd[k] - below.odd[k]) / static_cast<float>(2 * kStep);
  for (std::size_t m = 0; m < 25; ++m)
    shownSlope_.even[m] = (above.even[m] - below.even[m]) / static_cast<float>(2 * kStep);
  up_ = (frame.screenFromWorld * Eigen::Vector3d::UnitZ()).cast<float>();
  sampleX_ = (frame.screenFromWorld * Eigen::Vector3d::UnitX()).cast<float>();
  sampleY_ = (frame.screenFromWorld * Eigen::Vector3d::UnitY()).cast<float>();
  std::vector<double> nodeX, weightX, nodeY, weightY;
  legendreNodes(24, nodeX, weightX);
  legendreNodes(16, nodeY, weightY);
  for (std::size_t j = 0; j < nodeY.size(); ++j) {
    for (std::size_t i = 0; i < nodeX.size(); ++i) {
      const double x = nodeX[i] * frame.halfExtent.x(), y = nodeY[j] * frame.halfExtent.y();
      const double logWindow = -0.5 * (frame.windowPrecision.x() * x * x + frame.windowPrecision.y() * y * y);
      gridX_.push_back(static_cast<float>(x));
      gridY_.push_back(static_cast<float>(y));
      gridLogWindow_.push_back(static_cast<float>(logWindow));
      gridWeight_.push_back(static_cast<float>(weightX[i] * weightY[j] * frame.halfExtent.x() *
                                               frame.halfExtent.y() * std::exp(logWindow)));
    }
  }
  gridCount_ = static_cast<int>(gridX_.size());
  static_assert(24 * 16 % quadrature::kPad == 0 && 24 * 16 <= quadrature::kMostGrid);
  HWY_DYNAMIC_DISPATCH(FillGridRows)(*this);
  std::vector<Eigen::Vector2d> beyond;
  for (std::size_t f = 0; f < frequency_.size(); ++f) {
    if (std::abs(frequency_[f].x()) <= quadrature::kMostAlongX &&
        std::abs(frequency_[f].y()) <= quadrature::kMostAlongY)
      continue;
    beyondGrid_.push_back(static_cast<int>(f));
    beyond.push_back(frequency_[f].cast<double>());
  }
  if (!beyond.empty())
    rim_ = std::make_shared<DiffuseTransform>(frame, sampleSizeMm, beyond, DiffuseMethod::Quadrature);
}

bool ScreenQuadrature::evaluate(const QuadratureSite& site, quadrature::Want want, float* out) const {
  quadrature::SiteFrame at;
  const Eigen::Vector3d world = Eigen::Vector3d(site.slopeX, site.slopeY, 1).normalized();
  const double invLength = world.z();
  const auto turn = [&](const Eigen::Vector3d& v) -> Eigen::Vector3d {
    return (site.screenFromWorld ? *site.screenFromWorld : frame_.screenFromWorld) * v;
  };
  at.n = turn(world);
  at.dnX = turn((Eigen::Vector3d::UnitX() - world * world.x()) * invLength);
  at.dnY = turn((Eigen::Vector3d::UnitY() - world * world.y()) * invLength);
  // The sample's x axis laid into the tangent plane.
  const Eigen::Vector3d t1 = (Eigen::Vector3d::UnitX() - world * world.x()).normalized();
  at.t1 = turn(t1);
  at.t2 = turn(world.cross(t1));
  at.view = Eigen::Vector3d(site.geometry.viewX, site.geometry.viewY, site.geometry.viewZ);
  at.distance = site.geometry.distance;
  at.footX = site.geometry.footX;
  at.footY = site.geometry.footY;
  // exp(-A) of the traceless symmetric A, and its derivatives.
  const double a1 = site.stretch1, a2 = site.stretch2, r = std::hypot(a1, a2);
  const double ch = std::cosh(r), sh = r > 1e-6 ? std::sinh(r) / r : 1 + r * r / 6;
  const double dsh =
      r > 1e-3 ? (std::cosh(r) - std::sinh(r) / r) / (r * r) : 1.0 / 3;  // d (sinh r / r) / dr / r
  at.m11 = ch - sh * a1;
  at.m12 = -sh * a2;
  at.m22 = ch + sh * a1;
  const float dM1[3] = {static_cast<float>(sh * a1 - dsh * a1 * a1 - sh), static_cast<float>(-dsh * a1 * a2),
                        static_cast<float>(sh * a1 + dsh * a1 * a1 + sh)};
  const float dM2[3] = {static_cast<float>(sh * a2 - dsh * a2 * a1), static_cast<float>(-dsh * a2 * a2 - sh),
                        static_cast<float>(sh * a2 + dsh * a2 * a1)};

  const double logGamma = std::log(std::max(1.0, static_cast<double>(site.kurtosis)));
  const double g2 = std::exp(2 * logGamma), c = std::sqrt(2 / (1 / g2 + g2));
  const double sigma1 = c * site.sigma * std::exp(-logGamma), sigma2 = c * site.sigma * std::exp(logGamma);
  // d log c / d log gamma = -(g2 - 1/g2) / (g2 + 1/g2); the parameter is the square of log gamma. Below 0.05
  // the two Gaussians are one to any measurement, and the division would amplify rounding.
  const double dLogC = -(g2 - 1 / g2) / (g2 + 1 / g2), perSquare = 0.5 / std::max(logGamma, 0.05);
  const float kurtosisPart[2] = {static_cast<float>((dLogC - 1) * perSquare),
                                 static_cast<float>((dLogC + 1) * perSquare)};
  const double s = site.sigma;
  const float sigma[5] = {static_cast<float>(sigma1), static_cast<float>(sigma2), static_cast<float>(0.4 * s),
                          static_cast<float>(std::min(std::max(2.5 * s, 0.1), 0.6)),
                          static_cast<float>(std::min(std::max(5.0 * s, 0.25), 0.8))};
  quadrature::Peak peak[5];
  const int peaks = want == quadrature::kEverything ? 5 : 2;
  for (int k = 0; k < peaks; ++k) peak[k] = findPeak(*this, at, sigma[k]);
  const std::size_t rows = static_cast<std::size_t>(rowCount());
  const auto clear = [&](int first, int count) {
    std::fill(out + static_cast<std::size_t>(first) * rows,
              out + static_cast<std::size_t>(first + count) * rows, 0.0f);
  };
  if (want == quadrature::kEverything) {
    clear(0, quadrature::kColumns);
  } else {
    const bool one = want == quadrature::kPrediction;
    clear(0, one ? 1 : quadrature::kDiffuseLight);
    clear(quadrature::kSpecularStart, one ? 1 : quadrature::kStretch2 + 1);
  }
  HWY_DYNAMIC_DISPATCH(EvaluateSite)(*this, at, site, peak, sigma, kurtosisPart, dM1, dM2, want, out);
  if (rim_) {
    static thread_local std::vector<float> table;
    table.resize(beyondGrid_.size() * 6);
    rim_->at(site.pointMm.cast<double>(), table.data());
    // Z = (I1 - I3) - i (I0 - I2) = F of docs/fourier_fit.md, for the linear screen
    const double odd = 2 * shown_.odd[0];
    for (std::size_t k = 0; k < beyondGrid_.size(); ++k) {
      float* row = out + static_cast<std::size_t>(4 * beyondGrid_[k]);
      double re = 0, im = 0;
      for (int axis = 0; axis < 3; ++axis) {
        re += at.n[axis] * table[(k * 3 + static_cast<std::size_t>(axis)) * 2];
        im += at.n[axis] * table[(k * 3 + static_cast<std::size_t>(axis)) * 2 + 1];
      }
      row[0] -= static_cast<float>(0.5 * odd * im);
      row[2] += static_cast<float>(0.5 * odd * im);
      row[1] += static_cast<float>(0.5 * odd * re);
      row[3] -= static_cast<float>(0.5 * odd * re);
    }
  }
  return peak[0].onScreen && peak[1].onScreen;
}

}  // namespace patina
#endif
