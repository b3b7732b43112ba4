#include "tests/bench/fourier_baseline.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace patina::bench {
namespace {

// The model, value only, on any number type: what docs/fourier_fit.md describes, written for a reader and not
// for a machine. Symbols as in engine/fourier/lobe_kernel.inc.

constexpr std::array<double, 5> kNode = {-2.8569700138728056, -1.3556261799742659, 0, 1.3556261799742659,
                                         2.8569700138728056};
/// Gauss-Hermite weights (probabilists') times exp(node^2 / 2).
constexpr std::array<double, 5> kNodeWeight = {0.66652612, 0.55663128, 0.53333333, 0.55663128, 0.66652612};
constexpr double kSchlickRise = (1 - 0.06) / 0.06;
constexpr double kSmallestCosine = 1e-3;
constexpr double kMostBend = 0.9;

template <typename T>
T atLeast(const T& value, double least) {
  return value < T(least) ? T(least) : value;
}

template <typename T>
T dot(const T (&a)[3], const T (&b)[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// A point of the screen as the lobe sees it.
template <typename T>
struct ScreenPoint {
  T light[3], s[3], slope[3], invD, sn, sLength2;

  ScreenPoint(const SiteGeometry& g, const T (&n)[3], const T& x, const T& y) {
    const double d = g.distance;
    invD = 1.0 / sqrt(x * x + y * y + d * d);
    light[0] = x * invD, light[1] = y * invD, light[2] = -d * invD;
    s[0] = light[0] + double{g.viewX}, s[1] = light[1] + double{g.viewY}, s[2] = light[2] + double{g.viewZ};
    sn = atLeast(dot(s, n), kSmallestCosine);
    for (int j = 0; j < 3; ++j) slope[j] = s[j] / sn - n[j];
    sLength2 = atLeast(dot(s, s), 1e-6);
  }
  T slope2() const { return dot(slope, slope); }
};

/// Gradient of the log of lobe times weight (without window and emission), and the lobe's precision.
template <typename T>
void lobeGradient(const SiteGeometry& g, const T (&n)[3], const T& invVariance, const T& x, const T& y,
                  T (&gradient)[2], T (&precision)[3]) {
  const ScreenPoint<T> at(g, n, x, y);
  const T view[3] = {T(g.viewX), T(g.viewY), T(g.viewZ)};
  T dLight[2][3], dSlope[2][3];
  for (int k = 0; k < 2; ++k) {
    for (int j = 0; j < 3; ++j) dLight[k][j] = -at.light[j] * at.light[k] * at.invD;
    dLight[k][k] += at.invD;
    const T dSn = dot(dLight[k], n);
    for (int j = 0; j < 3; ++j) dSlope[k][j] = (dLight[k][j] - (at.slope[j] + n[j]) * dSn) / at.sn;
  }
  const T length = sqrt(at.sLength2);
  const T m = atLeast(T(1.0 - 0.5 * length), 0);
  const T m4 = m * m * m * m;
  const T schlickLog = -5.0 * kSchlickRise * m4 / (1.0 + kSchlickRise * m4 * m);
  for (int k = 0; k < 2; ++k) {
    const T viewDl = dot(view, dLight[k]);
    gradient[k] = -dot(at.slope, dSlope[k]) * invVariance + schlickLog * 0.5 * viewDl / length -
                  4.0 * dot(n, dLight[k]) / at.sn + 4.0 * viewDl / at.sLength2 - 3.0 * at.light[k] * at.invD;
  }
  precision[0] = dot(dSlope[0], dSlope[0]) * invVariance;
  precision[1] = dot(dSlope[0], dSlope[1]) * invVariance;
  precision[2] = dot(dSlope[1], dSlope[1]) * invVariance;
}

/// One Gaussian of the lobe on the screen: mass, mean, covariance, third and fourth cumulants.
template <typename T>
struct Moments {
  T mass, mean[2], covariance[3], third[4], fourth[5];

  Moments(const SiteGeometry& g, const T (&n)[3], const T& sigma) {
    const T invVariance = 1.0 / (sigma * sigma);
    const T view[3] = {T(g.viewX), T(g.viewY), T(g.viewZ)};
    const double px = g.lightPrecisionX, py = g.lightPrecisionY;
    // The mode of lobe times everything that lights it, by Newton's steps from the mirror point.
    const T on = dot(view, n);
    const T down = atLeast(T(view[2] - 2.0 * on * n[2]), 0.17);
    T x = double{g.distance} * (2.0 * on * n[0] - view[0]) / down;
    T y = double{g.distance} * (2.0 * on * n[1] - view[1]) / down;
    T gradient[2], precision[3];
    for (int step = 0; step < 4; ++step) {
      lobeGradient(g, n, invVariance, x, y, gradient, precision);
      const T gx = gradient[0] - px * (x - double{g.lightMeanX});
      const T gy = gradient[1] - py * (y - double{g.lightMeanY});
      const T a = precision[0] + px, b = precision[1], c = precision[2] + py;
      const T det = atLeast(T(a * c - b * b), 1e-12);
      const T dx = (c * gx - b * gy) / det, dy = (a * gy - b * gx) / det;
      const T length = sqrt(dx * dx + dy * dy + 1e-12);
      const T scale = length > T(1.5) ? T(1.5 / length) : T(1.0);
      x += dx * scale, y += dy * scale;
    }
    lobeGradient(g, n, invVariance, x, y, gradient, precision);
    const T a = precision[0] + px, b = precision[1], c = precision[2] + py;
    const T det = atLeast(T(a * c - b * b), 1e-12);
    const T l11 = sqrt(c / det), l21 = -b / det / l11, l22 = 1.0 / sqrt(c);

    // Quadrature about it.
    T weight[25];
    T sum(0.0), mu(0.0), mv(0.0);
    for (int i = 0; i < 5; ++i) {
      for (int j = 0; j < 5; ++j) {
        const double u = kNode[i], v = kNode[j];
        const T qx = x + l11 * u, qy = y + l21 * u + l22 * v;
        const ScreenPoint<T> at(g, n, qx, qy);
        const T slope2 = at.slope2(), tilt = 1.0 + slope2;
        const T lx = qx - double{g.lightMeanX}, ly = qy - double{g.lightMeanY};
        const T exponent = -0.5 * (slope2 * invVariance + px * lx * lx + py * ly * ly);
        const T rim = atLeast(T(1.0 - 0.5 * sqrt(at.sLength2)), 0);
        const T fresnel = 1.0 + kSchlickRise * rim * rim * rim * rim * rim;
        T& w = weight[i * 5 + j];
        w = kNodeWeight[i] * kNodeWeight[j] * exp(atLeast(exponent, -80)) * tilt * tilt * at.invD * at.invD *
            at.invD * fresnel;
        sum += w, mu += w * u, mv += w * v;
      }
    }
    sum = atLeast(sum, 1e-30);
    mu /= sum, mv /= sum;
    T k[12];  // uu uv vv, uuu uuv uvv vvv, uuuu uuuv uuvv uvvv vvvv
    for (T& moment : k) moment = T(0.0);
    for (int i = 0; i < 5; ++i) {
      for (int j = 0; j < 5; ++j) {
        const T u = kNode[i] - mu, v = kNode[j] - mv;
        const T w = weight[i * 5 + j] / sum;
        const T uu = u * u, uv = u * v, vv = v * v;
        k[0] += w * uu, k[1] += w * uv, k[2] += w * vv;
        k[3] += w * uu * u, k[4] += w * uu * v, k[5] += w * u * vv, k[6] += w * vv * v;
        k[7] += w * uu * uu, k[8] += w * uu * uv, k[9] += w * uu * vv, k[10] += w * uv * vv;
        k[11] += w * vv * vv;
      }
    }
    k[7] -= 3.0 * k[0] * k[0];
    k[8] -= 3.0 * k[0] * k[1];
    k[9] -= k[0] * k[2] + 2.0 * k[1] * k[1];
    k[10] -= 3.0 * k[2] * k[1];
    k[11] -= 3.0 * k[2] * k[2];
    mass = sum * l11 * l22 * invVariance * double{g.distance} * double{g.lightPeak} * 0.25 /
           atLeast(on, kSmallestCosine);
    const T &p = l11, &q = l21, &r = l22;
    mean[0] = x + p * mu, mean[1] = y + q * mu + r * mv;
    covariance[0] = p * p * k[0];
    covariance[1] = p * (q * k[0] + r * k[1]);
    covariance[2] = q * q * k[0] + 2.0 * q * r * k[1] + r * r * k[2];
    third[0] = p * p * p * k[3];
    third[1] = p * p * (q * k[3] + r * k[4]);
    third[2] = p * (q * q * k[3] + 2.0 * q * r * k[4] + r * r * k[5]);
    third[3] = q * q * q * k[3] + 3.0 * q * q * r * k[4] + 3.0 * q * r * r * k[5] + r * r * r * k[6];
    fourth[0] = p * p * p * p * k[7];
    fourth[1] = p * p * p * (q * k[7] + r * k[8]);
    fourth[2] = p * p * (q * q * k[7] + 2.0 * q * r * k[8] + r * r * k[9]);
    fourth[3] = p * (q * q * q * k[7] + 3.0 * q * q * r * k[8] + 3.0 * q * r * r * k[9] + r * r * r * k[10]);
    fourth[4] = q * q * q * q * k[7] + 4.0 * q * q * q * r * k[8] + 6.0 * q * q * r * r * k[9] +
                4.0 * q * r * r * r * k[10] + r * r * r * r * k[11];
  }

  /// Transform at w: real and imaginary part.
  void transform(const SiteGeometry& g, double wx, double wy, T& re, T& im) const {
    const T decay = 0.5 * (wx * wx * covariance[0] + 2.0 * wx * wy * covariance[1] + wy * wy * covariance[2]);
    if (decay > T(16.0)) {  // 1e-7 of the peak
      re = im = T(0.0);
      return;
    }
    const T skew = (wx * wx * wx * third[0] + 3 * wx * wx * wy * third[1] + 3 * wx * wy * wy * third[2] +
                    wy * wy * wy * third[3]) /
                   6.0;
    T bend = (wx * wx * wx * wx * fourth[0] + 4 * wx * wx * wx * wy * fourth[1] +
              6 * wx * wx * wy * wy * fourth[2] + 4 * wx * wy * wy * wy * fourth[3] +
              wy * wy * wy * wy * fourth[4]) /
             24.0;
    if (bend > T(kMostBend)) bend = T(kMostBend);
    if (bend < T(-kMostBend)) bend = T(-kMostBend);
    const T envelope = mass * exp(-decay) * (1.0 + bend);
    const T phase = wx * (mean[0] + double{g.footX}) + wy * (mean[1] + double{g.footY}) - skew;
    re = envelope * cos(phase), im = -envelope * sin(phase);
  }

  /// The part of the mass that lies on the lit area: Sampford's bound for the four tails.
  T litFraction(const SiteGeometry& g, const float (&halfExtent)[2]) const {
    T lit(1.0);
    for (int axis = 0; axis < 2; ++axis) {
      const T sigma = sqrt(atLeast(covariance[2 * axis], 1e-12));
      const T centre = mean[axis] + double{axis == 0 ? g.footX : g.footY};
      for (const double direction : {1.0, -1.0}) {
        T t = atLeast(T((double{halfExtent[axis]} - direction * centre) / sigma), 0);
        if (t > T(12.0)) t = T(12.0);
        lit -= 4.0 * 0.39894228 * exp(-0.5 * t * t) / (3.0 * t + sqrt(t * t + 8.0));
      }
    }
    return lit;
  }
};

/// All residuals of a site.
struct SiteResiduals {
  const SolverSetup& setup;
  const SiteData& site;

  int count() const { return static_cast<int>(setup.frequency.size()) * 6 + 3 + 10; }

  template <typename T>
  bool operator()(const T* parameters, T* residual) const {
    const T *lobe = parameters, *diffuse = parameters + 4, *specular = parameters + 7;
    const SiteGeometry& g = site.geometry;
    const T inv = 1.0 / sqrt(1.0 + lobe[2] * lobe[2] + lobe[3] * lobe[3]);
    T n[3];
    for (int j = 0; j < 3; ++j)
      n[j] = (lobe[2] * double{setup.normalRows[0][j]} + lobe[3] * double{setup.normalRows[1][j]} +
              double{setup.normalRows[2][j]}) *
             inv;
    const T gamma = 1.0 + exp(lobe[1]);
    const T width = exp(lobe[0]) * sqrt(2.0 / (1.0 / (gamma * gamma) + gamma * gamma));
    const Moments<T> narrow(g, n, T(width / gamma)), broad(g, n, T(width * gamma));

    T* next = residual;
    for (std::size_t f = 0; f < setup.frequency.size(); ++f) {
      const double wx = setup.frequency[f].x(), wy = setup.frequency[f].y();
      T s[2], more[2];
      narrow.transform(g, wx, wy, s[0], s[1]);
      broad.transform(g, wx, wy, more[0], more[1]);
      const float* v = site.diffuse + (f + 1) * 6;
      for (int part = 0; part < 2; ++part) {
        bool dropped = false;
        for (const auto spoilt : site.dropped) dropped = dropped || spoilt == 2 * f + part;
        const T value = n[0] * double{v[part]} + n[1] * double{v[2 + part]} + n[2] * double{v[4 + part]};
        const T lobeValue = 0.5 * (s[part] + more[part]);
        for (int c = 0; c < 3; ++c) {
          *next++ =
              dropped ? T(0.0)
                      : T(std::sqrt(double{site.weight[c]}) * (diffuse[c] * value + specular[c] * lobeValue -
                                                               double{site.z[f * 6 + part * 3 + c]}));
        }
      }
    }
    const T dcValue =
        n[0] * double{site.diffuse[0]} + n[1] * double{site.diffuse[2]} + n[2] * double{site.diffuse[4]};
    const T dcLobe = 0.5 * (narrow.mass * narrow.litFraction(g, setup.halfExtent) +
                            broad.mass * broad.litFraction(g, setup.halfExtent));
    for (int c = 0; c < 3; ++c)
      *next++ = std::sqrt(double{site.dcWeight[c]}) *
                (diffuse[c] * dcValue + specular[c] * dcLobe - double{site.dc[c]});
    const FourierPriors& p = setup.priors;
    *next++ = (lobe[0] - double{p.logSigmaMean}) / double{p.logSigmaSigma};
    *next++ = (lobe[1] - double{p.logKurtosisMean}) / double{p.logKurtosisSigma};
    *next++ = lobe[2] / double{p.normalSigma};
    *next++ = lobe[3] / double{p.normalSigma};
    for (int c = 0; c < 3; ++c) *next++ = diffuse[c] / double{p.diffuseSigma};
    for (int c = 0; c < 3; ++c) *next++ = specular[c] / double{p.specularSigma};
    return true;
  }
};

}  // namespace

BaselineSolution solveWithCeres(const SolverSetup& setup, const SiteData& site, const LobeParameters& start) {
  auto* residuals = new SiteResiduals{setup, site};
  double x[10] = {start.logSigma, start.logKurtosis, start.slopeX, start.slopeY};
  // App. D: what the zero frequency shows, half of it each.
  for (int c = 0; c < 3; ++c) x[4 + c] = 0.5 * site.dc[c] / std::max(1e-6f, site.diffuse[4]);
  for (int c = 0; c < 3; ++c) x[7 + c] = 0.5 * std::max(0.0f, site.dc[c]);
  for (int i = 4; i < 10; ++i) x[i] = std::clamp(x[i], 0.01, 1.0);

  ceres::Problem problem;
  problem.AddResidualBlock(
      new ceres::AutoDiffCostFunction<SiteResiduals, ceres::DYNAMIC, 10>(residuals, residuals->count()),
      nullptr, x);
  for (int i = 4; i < 10; ++i) problem.SetParameterLowerBound(x, i, 0);
  // The ranges of the solver's own bounds.
  problem.SetParameterLowerBound(x, 0, -6.5), problem.SetParameterUpperBound(x, 0, 0.7);
  problem.SetParameterLowerBound(x, 1, -7.0), problem.SetParameterUpperBound(x, 1, 1.6);
  for (const int i : {2, 3}) {
    problem.SetParameterLowerBound(x, i, -1.5);
    problem.SetParameterUpperBound(x, i, 1.5);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = setup.maxIterations;
  options.function_tolerance = setup.tolerance;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  BaselineSolution found;
  found.lobe = {static_cast<float>(x[0]), static_cast<float>(x[1]), static_cast<float>(x[2]),
                static_cast<float>(x[3])};
  for (int c = 0; c < 3; ++c) found.diffuse[c] = x[4 + c], found.specular[c] = x[7 + c];
  found.cost = 2 * summary.final_cost;  // Ceres halves it
  found.iterations = static_cast<int>(summary.iterations.size());
  found.converged = summary.termination_type == ceres::CONVERGENCE;
  return found;
}

double baselineCost(const SolverSetup& setup, const SiteData& site, const SiteSolution& solution) {
  const SiteResiduals residuals{setup, site};
  double x[10] = {solution.lobe.logSigma, solution.lobe.logKurtosis, solution.lobe.slopeX,
                  solution.lobe.slopeY};
  for (int c = 0; c < 3; ++c) x[4 + c] = solution.diffuse[c], x[7 + c] = solution.specular[c];
  std::vector<double> values(static_cast<std::size_t>(residuals.count()));
  residuals(x, values.data());
  double cost = 0;
  for (const double value : values) cost += value * value;
  return cost;
}

void baselineColumns(const SolverSetup& setup, const SiteData& site, const LobeParameters& at, double* out) {
  SiteData plain = site;
  for (int c = 0; c < 3; ++c) plain.weight[c] = plain.dcWeight[c] = 1;
  const ceres::AutoDiffCostFunction<SiteResiduals, ceres::DYNAMIC, 10> function(
      new SiteResiduals{setup, plain}, SiteResiduals{setup, plain}.count());
  const std::size_t rows = 2 * setup.frequency.size() + 1;
  std::vector<double> values(static_cast<std::size_t>(function.num_residuals())),
      jacobian(values.size() * 10);
  // Unit albedos of one part at a time; the first channel's rows.
  for (const bool specular : {false, true}) {
    double x[10] = {at.logSigma, at.logKurtosis, at.slopeX, at.slopeY};
    for (int c = 0; c < 3; ++c) x[4 + c] = specular ? 0 : 1, x[7 + c] = specular ? 1 : 0;
    const double* parameters = x;
    double* derivatives = jacobian.data();
    function.Evaluate(&parameters, values.data(), &derivatives);
    for (std::size_t row = 0; row < rows; ++row) {
      const double* from = jacobian.data() + row * 3 * 10;
      double* to = out + row * kModelColumns;
      to[specular ? 1 : 0] = from[specular ? 7 : 4];
      if (specular)
        std::copy_n(from, 4, to + 4);
      else
        std::copy_n(from + 2, 2, to + 2);
    }
  }
}

}  // namespace patina::bench
