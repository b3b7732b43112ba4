#include "devices/simulated/screen_integrator.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kSchlickF0 = 0.06;
constexpr double kCoarsestSpacing = 0.25;  ///< pattern units; the screen is 2 pi wide
constexpr int kFinestLevel =
    6;  ///< spacing 0.0039: about a pixel of a full-HD screen; finer patterns don't exist there
constexpr double kMostBytes = 512e6;  ///< of one level's sums; the usual 166 photographs reach level 5
constexpr int kBumpSamples = 128;

/// Mean of |sin| over a cell as a function of sin at its centre. Away from a zero crossing |sin| is a sine
/// again and its mean is exactly sinc sinc |sin|; across one, the cell's mean of |u| for u linear in the cell
/// (error below (w h)^3 / 6).
class RectifiedMean {
 public:
  RectifiedMean(double phaseX, double phaseY) {
    const double a = std::abs(phaseX), b = std::abs(phaseY);
    attenuation_ = static_cast<float>(sinc(0.5 * a) * sinc(0.5 * b));
    const double reach = 0.5 * (a + b);
    edge_ = static_cast<float>(std::sin(std::min(reach, 0.5 * kPi)));
    for (int i = 0; i <= kBumpSamples; ++i)
      bump_[static_cast<std::size_t>(i)] = static_cast<float>(meanAbs(reach * i / kBumpSamples, a, b));
    toIndex_ = edge_ > 0 ? kBumpSamples / edge_ : 0.0f;
  }
  float operator()(float sine) const {
    const float size = std::abs(sine);
    if (size >= edge_) return attenuation_ * size;
    const float position = size * toIndex_;
    const int index = std::min(static_cast<int>(position), kBumpSamples - 1);
    const float t = position - static_cast<float>(index);
    return bump_[static_cast<std::size_t>(index)] * (1 - t) + bump_[static_cast<std::size_t>(index) + 1] * t;
  }

 private:
  static double sinc(double x) { return std::abs(x) < 1e-6 ? 1.0 : std::sin(x) / x; }
  /// Mean of |d + a r + b s| for r, s uniform in -1/2 to 1/2.
  static double meanAbs(double d, double a, double b) {
    if (a < b) std::swap(a, b);
    const auto once = [](double u) { return 0.5 * u * std::abs(u); };       // antiderivative of |u|
    const auto twice = [](double u) { return u * u * std::abs(u) / 6.0; };  // and its own
    if (a < 1e-9) return std::abs(d);
    if (b < 1e-6 * a)
      return (once(d + 0.5 * a) - once(d - 0.5 * a)) / a;  // below that the difference loses its digits
    return (twice(d + 0.5 * (a + b)) - twice(d + 0.5 * (a - b)) - twice(d - 0.5 * (a - b)) +
            twice(d - 0.5 * (a + b))) /
           (a * b);
  }
  float attenuation_ = 1, edge_ = 0, toIndex_ = 0;
  std::array<float, kBumpSamples + 1> bump_{};
};

/// The four cubic B-splines that touch a point at `t` in 0..1 between nodes 1 and 2 of the four.
std::array<float, 4> cubicBasis(double t) {
  const double s = 1 - t;
  return {static_cast<float>(s * s * s / 6), static_cast<float>((3 * t * t * t - 6 * t * t + 4) / 6),
          static_cast<float>((3 * s * s * s - 6 * s * s + 4) / 6), static_cast<float>(t * t * t / 6)};
}

double spacingOf(int level) {
  return kCoarsestSpacing / static_cast<double>(1 << level);
}

}  // namespace

ScreenIntegrator::ScreenIntegrator(const Screen& screen, std::vector<Eigen::Vector2i> frequencies,
                                   const IntegrationQuality& quality)
    : screen_(screen), frequencies_(std::move(frequencies)), quality_(quality) {
  stride_ = (static_cast<std::size_t>(patternCount()) + 3) / 4 * 4;
  const Eigen::Vector2d half = screen_.halfExtent();
  const auto bytes = [&](int level) {
    return 4 * half.x() * half.y() / (spacingOf(level) * spacingOf(level)) *
           static_cast<double>(stride_ * sizeof(float));
  };
  while (finestAllowed_ < kFinestLevel && bytes(finestAllowed_ + 1) <= kMostBytes) ++finestAllowed_;
}

// ---- where a point's nodes lie ----

ScreenIntegrator::Frame ScreenIntegrator::frameOf(const Eigen::Vector3d& pointMm,
                                                  const Eigen::Vector3d& toView,
                                                  const SheetPoint& material) const {
  const Eigen::Matrix3d screenFromWorld = screen_.worldFromScreen.transpose();
  Frame frame;
  frame.point = screenFromWorld * (pointMm - screen_.originMm) / screen_.unitMm();
  frame.view = screenFromWorld * toView;
  frame.normal = screenFromWorld * material.normal;
  frame.tangent = frame.normal.unitOrthogonal();
  frame.bitangent = frame.normal.cross(frame.tangent);
  frame.distance = frame.point.z();
  return frame;
}

ScreenIntegrator::Patch ScreenIntegrator::wholeScreen(double scale, double nodesPerScale) const {
  Patch patch;
  while (patch.level < finestAllowed_ && spacingOf(patch.level) * nodesPerScale > scale) ++patch.level;
  patch.resolved = spacingOf(patch.level) * nodesPerScale <= scale * 1.0001;
  const double h = spacingOf(patch.level);
  const Eigen::Vector2d half = screen_.halfExtent();
  patch.x1 = static_cast<int>(std::floor(half.x() / h)) + 3;
  patch.y1 = static_cast<int>(std::floor(half.y() / h)) + 3;
  patch.x0 = -patch.x1;
  patch.y0 = -patch.y1;
  return patch;
}

ScreenIntegrator::Patch ScreenIntegrator::diffusePatch(const Frame& frame) const {
  return wholeScreen(std::abs(frame.distance), quality_.nodesPerDistance);
}

double ScreenIntegrator::slopePerUnit(const Frame& frame, const Eigen::Vector2d& x) const {
  const Eigen::Vector3d offset(x.x() - frame.point.x(), x.y() - frame.point.y(), -frame.point.z());
  const double length = offset.norm();
  const Eigen::Vector3d toLight = offset / length, s = toLight + frame.view;
  const double along = s.dot(frame.normal);
  if (along <= 1e-3) return 0;  // at or behind the horizon: no light, no scale
  Eigen::Matrix2d slope;
  for (int k = 0; k < 2; ++k) {
    const Eigen::Vector3d change = (Eigen::Vector3d::Unit(k) - toLight * toLight[k]) / length;
    slope(0, k) =
        (change.dot(frame.tangent) - s.dot(frame.tangent) / along * change.dot(frame.normal)) / along;
    slope(1, k) =
        (change.dot(frame.bitangent) - s.dot(frame.bitangent) / along * change.dot(frame.normal)) / along;
  }
  return slope.jacobiSvd().singularValues()[0];
}

ScreenIntegrator::Patch ScreenIntegrator::lobePatch(const Frame& frame, double slopeSigma) const {
  const Eigen::Vector2d half = screen_.halfExtent();
  Eigen::Vector2d low = -half, high = half;
  const Eigen::Vector3d mirrored = 2 * frame.normal.dot(frame.view) * frame.normal - frame.view;
  // A lobe narrower than this reaches so few degrees that a box round its mirror point holds it; 1.4 covers
  // the perspective that makes the far side wider.
  const bool narrow = quality_.lobeReach * slopeSigma < 0.35;
  if (narrow && mirrored.z() < -0.05) {
    const double length = -frame.distance / mirrored.z();
    const Eigen::Vector2d mirror = frame.point.head<2>() + length * mirrored.head<2>();
    // The half-vector turns by half of what the light's direction does; that turns slowest where the screen
    // is foreshortened.
    const double slowest = 0.5 * -mirrored.z() / length;
    const double reach = 1.4 * quality_.lobeReach * slopeSigma / slowest;
    low = (mirror.array() - reach).matrix().cwiseMax(-half);
    high = (mirror.array() + reach).matrix().cwiseMin(half);
    if ((low.array() >= high.array()).any()) return Patch{0, 0, -1, 0, -1, true};  // misses the screen
  }
  double steepest = 0;
  for (int i = 0; i <= 4; ++i)
    for (int j = 0; j <= 4; ++j) {
      const Eigen::Vector2d t(i / 4.0, j / 4.0);
      steepest = std::max(steepest, slopePerUnit(frame, low + t.cwiseProduct(high - low)));
    }
  if (steepest <= 0) return Patch{0, 0, -1, 0, -1, true};
  Patch patch = wholeScreen(slopeSigma / steepest, quality_.nodesPerSigma);
  const double h = spacingOf(patch.level);
  patch.x0 = std::max(patch.x0, static_cast<int>(std::floor(low.x() / h)) - 3);
  patch.x1 = std::min(patch.x1, static_cast<int>(std::ceil(high.x() / h)) + 3);
  patch.y0 = std::max(patch.y0, static_cast<int>(std::floor(low.y() / h)) - 3);
  patch.y1 = std::min(patch.y1, static_cast<int>(std::ceil(high.y() / h)) + 3);
  return patch;
}

namespace {
/// The two Gaussians' widths. Source: frequency-domain paper, App. C.
std::array<double, 2> lobeSigmas(const SheetPoint& material) {
  const double g2 = material.kurtosis * material.kurtosis;
  const double c = std::sqrt(2.0 / (1.0 / g2 + g2));
  return {c * material.sigma / material.kurtosis, c * material.sigma * material.kurtosis};
}
}  // namespace

int ScreenIntegrator::finestLevel(const Eigen::Vector3d& pointMm, const Eigen::Vector3d& toView,
                                  const SheetPoint& material) const {
  const Frame frame = frameOf(pointMm, toView, material);
  int finest = diffusePatch(frame).level;
  if ((material.specular <= 0).all()) return finest;
  for (double sigma : lobeSigmas(material)) {
    const Patch patch = lobePatch(frame, sigma);
    if (!patch.resolved) return -1;
    finest = std::max(finest, patch.level);
  }
  return finest;
}

// ---- what depends on the patterns only ----

void ScreenIntegrator::fillFinest(Level& level, std::size_t firstFrequency, std::size_t endFrequency,
                                  const std::stop_token& stop) const {
  const Eigen::Vector2d half = screen_.halfExtent();
  const int cellsX = quality_.cellsAcross;
  const int cellsY = std::max(1, static_cast<int>(std::lround(cellsX * half.y() / half.x())));
  const double hx = 2 * half.x() / cellsX, hy = 2 * half.y() / cellsY;
  const std::size_t count = endFrequency - firstFrequency;
  const bool withWindow = firstFrequency == 0;
  const std::size_t values = 4 * count + (withWindow ? 1 : 0);

  std::vector<RectifiedMean> rectified;
  for (std::size_t f = firstFrequency; f < endFrequency; ++f)
    rectified.emplace_back(frequencies_[f].x() * hx, frequencies_[f].y() * hy);
  std::vector<float> sinX(count * cellsX), cosX(count * cellsX), windowX(cellsX);
  std::vector<int> firstNode(cellsX);
  std::vector<std::array<float, 4>> basisX(cellsX);
  for (int i = 0; i < cellsX; ++i) {
    const double x = -half.x() + (i + 0.5) * hx, u = x / level.spacing;
    windowX[i] =
        static_cast<float>(std::exp(-0.5 * x * x / (screen_.windowSigma.x() * screen_.windowSigma.x())));
    firstNode[i] = static_cast<int>(std::floor(u)) - 1;
    basisX[i] = cubicBasis(u - std::floor(u));
    for (std::size_t f = 0; f < count; ++f) {
      sinX[i * count + f] = static_cast<float>(std::sin(frequencies_[firstFrequency + f].x() * x));
      cosX[i * count + f] = static_cast<float>(std::cos(frequencies_[firstFrequency + f].x() * x));
    }
  }

  std::vector<float> row(level.nodesX() * values), cell(values), sinY(count), cosY(count);
  for (int j = 0; j < cellsY && !stop.stop_requested(); ++j) {
    const double y = -half.y() + (j + 0.5) * hy, v = y / level.spacing;
    const double windowY = std::exp(-0.5 * y * y / (screen_.windowSigma.y() * screen_.windowSigma.y()));
    for (std::size_t f = 0; f < count; ++f) {
      sinY[f] = static_cast<float>(std::sin(frequencies_[firstFrequency + f].y() * y));
      cosY[f] = static_cast<float>(std::cos(frequencies_[firstFrequency + f].y() * y));
    }
    std::fill(row.begin(), row.end(), 0.0f);
    for (int i = 0; i < cellsX; ++i) {
      const float lit = static_cast<float>(windowY * hx * hy) * windowX[i];
      for (std::size_t f = 0; f < count; ++f) {
        const float sx = sinX[i * count + f], cx = cosX[i * count + f];
        const float s = sx * cosY[f] + cx * sinY[f], c = cx * cosY[f] - sx * sinY[f];
        const float absS = rectified[f](s), absC = rectified[f](c);
        cell[4 * f] = 0.5f * lit * (absS + s);      // sin(w.x)
        cell[4 * f + 1] = 0.5f * lit * (absC + c);  // sin(w.x + pi/2)
        cell[4 * f + 2] = 0.5f * lit * (absS - s);
        cell[4 * f + 3] = 0.5f * lit * (absC - c);
      }
      if (withWindow) cell[4 * count] = lit;
      for (int k = 0; k < 4; ++k) {
        float* to = row.data() + static_cast<std::size_t>(firstNode[i] + k + level.reachX) * values;
        const float weight = basisX[i][static_cast<std::size_t>(k)];
        for (std::size_t p = 0; p < values; ++p) to[p] += weight * cell[p];
      }
    }
    const std::array<float, 4> basisY = cubicBasis(v - std::floor(v));
    for (int k = 0; k < 4; ++k) {
      const int node = static_cast<int>(std::floor(v)) - 1 + k + level.reachY;
      for (std::size_t n = 0; n < level.nodesX(); ++n) {
        float* to = level.sums.data() + (static_cast<std::size_t>(node) * level.nodesX() + n) * stride_;
        const float* from = row.data() + n * values;
        const float weight = basisY[static_cast<std::size_t>(k)];
        for (std::size_t p = 0; p < 4 * count; ++p) to[4 * firstFrequency + p] += weight * from[p];
        if (withWindow) to[4 * frequencies_.size()] += weight * from[4 * count];
      }
    }
  }
}

bool ScreenIntegrator::prepare(int finest, const std::stop_token& stop) {
  finest = std::clamp(finest, 0, finestAllowed_);
  const Eigen::Vector2d half = screen_.halfExtent();
  levels_.assign(static_cast<std::size_t>(finest) + 1, {});
  for (int l = 0; l <= finest; ++l) {
    Level& level = levels_[static_cast<std::size_t>(l)];
    level.spacing = spacingOf(l);
    level.reachX = static_cast<int>(std::floor(half.x() / level.spacing)) + 3;
    level.reachY = static_cast<int>(std::floor(half.y() / level.spacing)) + 3;
    level.sums.assign(level.nodesX() * level.nodesY() * stride_, 0.0f);
  }
  Level& fine = levels_.back();
  constexpr std::size_t kBlock = 7;
  const std::size_t blocks = std::max<std::size_t>(1, (frequencies_.size() + kBlock - 1) / kBlock);
  tbb::parallel_for(std::size_t{0}, blocks, [&](std::size_t b) {
    fillFinest(fine, b * kBlock, std::min(frequencies_.size(), (b + 1) * kBlock), stop);
  });
  if (stop.stop_requested()) return false;

  // A spline of the coarser grid is a sum of five of the finer one (1 4 6 4 1) / 8 along each axis.
  constexpr std::array<float, 5> kTwoScale{0.125f, 0.5f, 0.75f, 0.5f, 0.125f};
  for (int l = finest; l > 0; --l) {
    const Level& from = levels_[static_cast<std::size_t>(l)];
    Level& to = levels_[static_cast<std::size_t>(l) - 1];
    tbb::parallel_for(-to.reachY, to.reachY + 1, [&](int ky) {
      for (int kx = -to.reachX; kx <= to.reachX; ++kx) {
        float* sum = to.sums.data() + (static_cast<std::size_t>(ky + to.reachY) * to.nodesX() +
                                       static_cast<std::size_t>(kx + to.reachX)) *
                                          stride_;
        for (int my = -2; my <= 2; ++my)
          for (int mx = -2; mx <= 2; ++mx) {
            const int fx = 2 * kx + mx, fy = 2 * ky + my;
            if (std::abs(fx) > from.reachX || std::abs(fy) > from.reachY)
              continue;  // lies off the screen: no light
            const float weight =
                kTwoScale[static_cast<std::size_t>(mx + 2)] * kTwoScale[static_cast<std::size_t>(my + 2)];
            const float* part =
                from.sums.data() + (static_cast<std::size_t>(fy + from.reachY) * from.nodesX() +
                                    static_cast<std::size_t>(fx + from.reachX)) *
                                       stride_;
            for (std::size_t p = 0; p < stride_; ++p) sum[p] += weight * part[p];
          }
      }
    });
  }
  // Spline coefficients from values: (-f[k-1] + 8 f[k] - f[k+1]) / 6 (exact for cubics, error of fourth
  // order). Folded into the sums by its transpose, which is itself.
  for (Level& level : levels_) {
    const auto along = [&](std::size_t lines, std::size_t count, std::size_t lineStep, std::size_t step) {
      tbb::parallel_for(std::size_t{0}, lines, [&](std::size_t line) {
        float* base = level.sums.data() + line * lineStep * stride_;
        std::vector<float> previous(stride_, 0.0f), current(stride_);
        for (std::size_t k = 0; k < count; ++k) {
          float* here = base + k * step * stride_;
          const float* next = k + 1 < count ? here + step * stride_ : nullptr;
          std::copy(here, here + stride_, current.begin());
          for (std::size_t p = 0; p < stride_; ++p)
            here[p] = (8 * current[p] - previous[p] - (next ? next[p] : 0.0f)) * (1.0f / 6);
          std::swap(previous, current);
        }
      });
    };
    along(level.nodesY(), level.nodesX(), level.nodesX(), 1);
    along(level.nodesX(), level.nodesY(), 1, level.nodesX());
  }
  return !stop.stop_requested();
}

// ---- points ----

/// What multiplies the pattern along one row of nodes, for one point. slopeSigma 0: the Lambertian term.
/// Otherwise one of the lobe's two Gaussians, of weight 1/2.
class ScreenIntegrator::KernelRow {
 public:
  KernelRow(const ScreenIntegrator& owner, const Frame& frame, const Patch& patch, double spacing,
            double slopeSigma)
      : owner_(owner), frame_(frame), patch_(patch), spacing_(spacing), slopeSigma_(slopeSigma) {
    const int count = patch.x1 - patch.x0 + 1;
    lx_ = Eigen::ArrayXf::LinSpaced(count, f(patch.x0 * spacing), f(patch.x1 * spacing)) - f(frame.point.x());
    if (owner.screen_.emission) {
      const ScreenEmission& e = *owner.screen_.emission;
      const float d = f(frame.distance);
      emission_ = f(e.gain) * (-0.5f * ((lx_ / d - f(e.mean.x())) / f(e.sigma.x())).square()).exp();
    }
  }

  /// Writes the kernel at nodes x0 + first to x0 + last - 1 of row `ky` to `to`; the rest is zero.
  void evaluate(int ky, Eigen::ArrayXf& kernel, int& first, int& last) {
    const auto count = static_cast<int>(lx_.size());
    const Eigen::Vector3f o = frame_.view.cast<float>(), n = frame_.normal.cast<float>();
    const Eigen::Vector3f t1 = frame_.tangent.cast<float>(), t2 = frame_.bitangent.cast<float>();
    const float d = f(frame_.distance), nv = n.dot(o), lz = -d;
    const float ly = f(ky * spacing_ - frame_.point.y());
    invD_ = (lx_.square() + (ly * ly + lz * lz)).rsqrt();
    nl_ = ((lx_ * n.x() + (ly * n.y() + lz * n.z())) * invD_).max(0.0f);
    first = 0, last = count;
    if (slopeSigma_ <= 0) {
      kernel = nl_ * invD_.cube() * (d / f(kPi));  // n.l / pi, times cosine at the screen d / D, over D^2
    } else {
      const float gaussian = f(0.5 / (2 * kPi * slopeSigma_ * slopeSigma_));
      const float exponent = f(-0.5 / (slopeSigma_ * slopeSigma_));
      const float cut = f(-0.5 * owner_.quality_.lobeReach * owner_.quality_.lobeReach);
      c_ = (nl_ + nv).inverse();  // 1 / s.n
      a_ = ((lx_ * t1.x() + (ly * t1.y() + lz * t1.z())) * invD_ + t1.dot(o)) *
           c_;  // slope of the half-vector
      b_ = ((lx_ * t2.x() + (ly * t2.y() + lz * t2.z())) * invD_ + t2.dot(o)) * c_;
      kernel = (a_.square() + b_.square()) * exponent;
      // Only the part of the row that the lobe reaches. Beyond, numbers soon become denormal, which would
      // cost far more time than all the rest.
      while (first < last && !(kernel[first] > cut)) ++first;
      while (last > first && !(kernel[last - 1] > cut)) --last;
      if (first == last) return;
      const int length = last - first;
      const auto lx = lx_.segment(first, length), invD = invD_.segment(first, length),
                 nl = nl_.segment(first, length), c = c_.segment(first, length);
      auto k = kernel.segment(first, length);
      auto a = a_.segment(first, length), b = b_.segment(first, length);
      k = k.max(cut).exp() * gaussian;
      a = (2 + 2 * (lx * o.x() + (ly * o.y() + lz * o.z())) * invD).max(0.0f);  // |s|^2
      k *= (a * c.square()).square();                                           // (n.h)^-4
      b = (1 - 0.5f * a.sqrt()).max(0.0f);                                      // 1 - l.h
      k *= 1 + f((1 - kSchlickF0) / kSchlickF0) * b.square().square() * b;
      k *= invD.cube() * (d * 0.25f / nv);  // n.l / (4 n.l n.v), d / D^3
      k = (nl > 0).select(k, 0.0f);
    }
    if (owner_.screen_.emission) {
      const ScreenEmission& e = *owner_.screen_.emission;
      const float qy = (ly / d - f(e.mean.y())) / f(e.sigma.y());
      kernel.segment(first, last - first) *=
          emission_.segment(first, last - first) * std::exp(-0.5f * qy * qy);
    }
  }

 private:
  static float f(double value) { return static_cast<float>(value); }

  const ScreenIntegrator& owner_;
  const Frame& frame_;
  const Patch& patch_;
  double spacing_, slopeSigma_;
  Eigen::ArrayXf lx_, emission_, invD_, nl_, a_, b_, c_;
};

void ScreenIntegrator::accumulate(const std::vector<Frame>& frames, const std::vector<Patch>& patches,
                                  const std::vector<double>& slopeSigma, Eigen::MatrixXf& response) const {
  Eigen::MatrixXf kernels, sum;
  Eigen::ArrayXf row;
  std::vector<bool> done(frames.size(), false);
  for (std::size_t lead = 0; lead < frames.size(); ++lead) {
    if (done[lead]) continue;
    // All points on this level, over the rectangle that holds their patches.
    const double spacing = spacingOf(patches[lead].level);
    std::vector<KernelRow> kernelRows;
    std::vector<std::size_t> member;
    Patch all = patches[lead];
    for (std::size_t i = lead; i < frames.size(); ++i) {
      const Patch& patch = patches[i];
      if (patch.level != patches[lead].level) continue;
      done[i] = true;
      if (patch.x1 < patch.x0 || patch.y1 < patch.y0 || frames[i].distance <= 0)
        continue;  // off the screen, or behind it
      kernelRows.emplace_back(*this, frames[i], patch, spacing, slopeSigma[i]);
      if (member.empty()) all = patch;
      member.push_back(i);
      all.x0 = std::min(all.x0, patch.x0), all.x1 = std::max(all.x1, patch.x1);
      all.y0 = std::min(all.y0, patch.y0), all.y1 = std::max(all.y1, patch.y1);
    }
    if (member.empty()) continue;
    const Level& level =
        levels_.at(static_cast<std::size_t>(patches[lead].level));  // throws where `prepare` was forgotten
    const auto width = static_cast<Eigen::Index>(all.x1 - all.x0 + 1);
    const auto columns = static_cast<Eigen::Index>(member.size());
    sum.setZero(static_cast<Eigen::Index>(stride_), columns);
    for (int ky = all.y0; ky <= all.y1; ++ky) {
      kernels.setZero(width, columns);
      Eigen::Index begin = width, end = 0;
      for (std::size_t k = 0; k < member.size(); ++k) {
        const Patch& patch = patches[member[k]];
        if (ky < patch.y0 || ky > patch.y1) continue;
        int first = 0, last = 0;
        kernelRows[k].evaluate(ky, row, first, last);
        if (first == last) continue;
        const Eigen::Index at = patch.x0 - all.x0 + first;
        kernels.col(static_cast<Eigen::Index>(k)).segment(at, last - first) =
            row.segment(first, last - first).matrix();
        begin = std::min(begin, at), end = std::max(end, at + last - first);
      }
      if (begin >= end) continue;
      const float* sums = level.sums.data() + (static_cast<std::size_t>(ky + level.reachY) * level.nodesX() +
                                               static_cast<std::size_t>(all.x0 + begin + level.reachX)) *
                                                  stride_;
      const Eigen::Map<const Eigen::MatrixXf> block(sums, static_cast<Eigen::Index>(stride_), end - begin);
      sum.noalias() += block * kernels.middleRows(begin, end - begin);
    }
    for (std::size_t k = 0; k < member.size(); ++k)
      response.col(static_cast<Eigen::Index>(member[k])) += sum.col(static_cast<Eigen::Index>(k));
  }
}

void ScreenIntegrator::respond(const std::vector<Query>& group, GroupResponse& out) const {
  const auto points = static_cast<Eigen::Index>(group.size());
  out.diffuse.setZero(static_cast<Eigen::Index>(stride_), points);
  out.specular.setZero(static_cast<Eigen::Index>(stride_), points);
  std::vector<Frame> frames;
  std::vector<Patch> diffuse, lobe[2];
  std::vector<double> lambertian(group.size(), 0.0), sigma[2];
  constexpr Patch kNothing{0, 0, -1, 0, -1, true};
  for (const Query& query : group) {
    const Frame& frame = frames.emplace_back(frameOf(query.pointMm, query.toView, query.material));
    const bool seen = frame.normal.dot(frame.view) > 0;
    diffuse.push_back(seen && (query.material.diffuse > 0).any() ? diffusePatch(frame) : kNothing);
    const bool shiny = seen && (query.material.specular > 0).any();
    const std::array<double, 2> sigmas = lobeSigmas(query.material);
    for (std::size_t l = 0; l < 2; ++l) {
      sigma[l].push_back(sigmas[l]);
      lobe[l].push_back(shiny ? lobePatch(frame, sigmas[l]) : kNothing);
    }
  }
  accumulate(frames, diffuse, lambertian, out.diffuse);
  for (std::size_t l = 0; l < 2; ++l) accumulate(frames, lobe[l], sigma[l], out.specular);
}

PointResponse ScreenIntegrator::respond(const Eigen::Vector3d& pointMm, const Eigen::Vector3d& toView,
                                        const SheetPoint& material) const {
  GroupResponse response;
  respond({{pointMm, toView, material}}, response);
  return {response.diffuse.col(0).array(), response.specular.col(0).array()};
}

}  // namespace patina
