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

constexpr float kRise = (1.0f - 0.06f) / 0.06f;  // (1 - F0) / F0 of the standard model

HWY_INLINE Lanes load(const float* at) {
  return Lanes(hn::LoadU(Tag(), at));
}
HWY_INLINE void store(Lanes v, float* at) {
  hn::StoreU(v.v, Tag(), at);
}
HWY_INLINE float sumOf(Vec v) {
  return hn::GetLane(hn::SumOfLanes(Tag(), v));
}
HWY_INLINE Lanes vlog(Lanes x) {
  return Lanes(hn::Log(Tag(), vmax(x, Lanes(1e-30f)).v));
}
HWY_INLINE Lanes dot3(const Lanes (&a)[3], const float (&b)[3]) {
  return a[0] * Lanes(b[0]) + a[1] * Lanes(b[1]) + a[2] * Lanes(b[2]);
}

HWY_INLINE Lanes dotVector(const Lanes (&a)[3], const Eigen::Vector3f& b) {
  return a[0] * Lanes(b[0]) + a[1] * Lanes(b[1]) + a[2] * Lanes(b[2]);
}

/// One of the three bumps over the sine of the emission angle; `sine2` its square.
HWY_INLINE Lanes angularBump(Lanes sine2, int k) {
  const Lanes gap = vsqrt(sine2) - Lanes(q::kBumpCentre[k]);
  return vexp(gap * gap * Lanes(-0.5f / (q::kBumpWidth * q::kBumpWidth)));
}

/// Light of one screen point: direction, falloff, emission, and the factors on it.
struct LightAt {
  Lanes toLight[3], invD;
  Lanes gain;  ///< everything but BRDF, sample's cosine and the node's weight; 0 off the screen
  Lanes sineU, sineV, placeX, placeY, logWindow, horizonSlope;
};

struct Shared {
  const ScreenQuadrature& quadrature;
  const q::SiteFrame& site;
  float n[3], dnX[3], dnY[3], t1[3], t2[3], view[3], up[3];
};

/// x, y: relative to the foot. `window`: the node's window is a factor already.
HWY_INLINE LightAt lightAt(const Shared& shared, Lanes x, Lanes y, bool windowDone) {
  const ScreenQuadrature& quad = shared.quadrature;
  const QuadratureState& state = quad.state_;
  const float d = static_cast<float>(shared.site.distance);
  LightAt at;
  at.invD = vrsqrt(x * x + y * y + Lanes(d * d));
  at.toLight[0] = x * at.invD;
  at.toLight[1] = y * at.invD;
  at.toLight[2] = Lanes(-d) * at.invD;
  const Lanes px = x + Lanes(static_cast<float>(shared.site.footX));
  const Lanes py = y + Lanes(static_cast<float>(shared.site.footY));
  const ScreenFrame& frame = quad.frame_;
  at.logWindow = Lanes(-0.5f) * (Lanes(static_cast<float>(frame.windowPrecision.x())) * px * px +
                                 Lanes(static_cast<float>(frame.windowPrecision.y())) * py * py);
  const Lanes ex = x * Lanes(1 / d) - Lanes(static_cast<float>(frame.emissionMean.x()));
  const Lanes ey = y * Lanes(1 / d) - Lanes(static_cast<float>(frame.emissionMean.y()));
  Lanes exponent = Lanes(-0.5f) * (Lanes(static_cast<float>(frame.emissionPrecision.x())) * ex * ex +
                                   Lanes(static_cast<float>(frame.emissionPrecision.y())) * ey * ey);
  exponent = mulAdd(Lanes(windowDone ? state.screenGamma - 1 : state.screenGamma), at.logWindow, exponent);
  at.sineU = at.toLight[0];
  at.sineV = at.toLight[1];
  const float hx = static_cast<float>(frame.halfExtent.x()), hy = static_cast<float>(frame.halfExtent.y());
  at.placeX = px * Lanes(1 / hx);
  at.placeY = py * Lanes(1 / hy);
  const Lanes u2 = at.sineU * at.sineU, v2 = at.sineV * at.sineV;
  const Lanes x2 = at.placeX * at.placeX, y2 = at.placeY * at.placeY;
  exponent = exponent + Lanes(state.angular[0]) * u2 + Lanes(state.angular[1]) * v2 +
             Lanes(state.angular[2]) * at.sineV;
  if (state.angular[3] != 0 || state.angular[4] != 0 || state.angular[5] != 0)
    for (std::size_t k = 0; k < 3; ++k)
      exponent = mulAdd(Lanes(state.angular[3 + k]), angularBump(u2 + v2, static_cast<int>(k)), exponent);
  exponent = exponent + Lanes(state.spatial[0]) * at.placeX + Lanes(state.spatial[1]) * at.placeY +
             Lanes(state.spatial[2]) * x2 + Lanes(state.spatial[3]) * at.placeX * at.placeY +
             Lanes(state.spatial[4]) * y2 + Lanes(state.spatial[5]) * (x2 + y2) * (x2 + y2);
  at.gain = Lanes(static_cast<float>(frame.emissionGain) * d) * vexp(exponent) * at.invD * at.invD * at.invD;
  const Mask lit = hn::And(hn::Le(hn::Abs(at.placeX.v), hn::Set(Tag(), 1.0f)),
                           hn::Le(hn::Abs(at.placeY.v), hn::Set(Tag(), 1.0f)));
  at.gain = Lanes(hn::IfThenElseZero(lit, at.gain.v));
  at.horizonSlope = Lanes(0.0f);
  if (state.horizon) {
    // A soft edge: the nodes could not integrate a hard one, and real relief has none.
    const float inv = 1 / state.horizonWidth;
    const Lanes height = dotVector(at.toLight, quad.horizonNormal_) - Lanes(state.horizonSine);
    const Lanes passed = vinv(Lanes(1.0f) + vexp(clampTo(height * Lanes(-inv), -30, 30)));
    at.horizonSlope = Lanes(inv) * (Lanes(1.0f) - passed);
    at.gain = at.gain * passed;
  }
  return at;
}

/// d log gain / d (every light effect), to columns `stride` apart.
HWY_INLINE void lightColumns(const Shared& shared, const LightAt& at, Lanes f, float* out,
                             std::size_t stride) {
  const Lanes u2 = at.sineU * at.sineU, v2 = at.sineV * at.sineV;
  const Lanes x2 = at.placeX * at.placeX, y2 = at.placeY * at.placeY;
  const auto put = [&](int k, Lanes factor) {
    store(f * factor, out + static_cast<std::size_t>(k) * stride);
  };
  put(q::kAngularAt, u2);
  put(q::kAngularAt + 1, v2);
  put(q::kAngularAt + 2, at.sineV);
  for (int k = 0; k < 3; ++k) put(q::kAngularAt + 3 + k, angularBump(u2 + v2, k));
  put(q::kSpatialAt, at.placeX);
  put(q::kSpatialAt + 1, at.placeY);
  put(q::kSpatialAt + 2, x2);
  put(q::kSpatialAt + 3, at.placeX * at.placeY);
  put(q::kSpatialAt + 4, y2);
  put(q::kSpatialAt + 5, (x2 + y2) * (x2 + y2));
  const ScreenQuadrature& quad = shared.quadrature;
  if (quad.state_.horizon) {
    put(q::kHorizonAt, at.horizonSlope * dotVector(at.toLight, quad.horizonByX_));
    put(q::kHorizonAt + 1, at.horizonSlope * dotVector(at.toLight, quad.horizonByY_));
    put(q::kHorizonAt + 2, -at.horizonSlope);
  } else {
    // All round at 27 degrees; flanks of 50 degrees towards the sample's +x and -x.
    constexpr float kSine = 0.454f, kFlankUp = 0.643f, kFlankAside = 0.766f;
    const Lanes up = dotVector(at.toLight, quad.up_), aside = dotVector(at.toLight, quad.sampleX_);
    const Lanes height[3] = {up - Lanes(kSine), Lanes(kFlankUp) * up - Lanes(kFlankAside) * aside,
                             Lanes(kFlankUp) * up + Lanes(kFlankAside) * aside};
    for (int k = 0; k < 3; ++k) {
      const Lanes e = vexp(clampTo(height[k] * Lanes(-1 / 0.04f), -30, 30));
      put(q::kHorizonAt + k, -(e * vinv(Lanes(1.0f) + e)));
    }
  }
  put(q::kWindowAt, at.logWindow);
}

/// The half-vector at a node against the site's normal.
struct HalfAt {
  Lanes s[3], sn, invSn, length2, cosineD, y1, y2, slope[3];
};
HWY_INLINE HalfAt halfAt(const Shared& shared, const LightAt& light) {
  HalfAt at;
  for (int j = 0; j < 3; ++j) at.s[j] = light.toLight[j] + Lanes(shared.view[j]);
  at.sn = vmax(dot3(at.s, shared.n), Lanes(1e-3f));
  at.invSn = Lanes(1.0f) / at.sn;
  for (int j = 0; j < 3; ++j) at.slope[j] = at.s[j] * at.invSn - Lanes(shared.n[j]);
  at.length2 = at.s[0] * at.s[0] + at.s[1] * at.s[1] + at.s[2] * at.s[2];
  at.cosineD = Lanes(0.5f) * vsqrt(at.length2);
  at.y1 = dot3(at.slope, shared.t1);
  at.y2 = dot3(at.slope, shared.t2);
  return at;
}

/// Everything of the microfacet lobe but its density, the cosines included. Source: docs/fourier_fit.md.
HWY_INLINE Lanes lobeWeight(const Shared& shared, const HalfAt& half, float fresnelPower,
                            Lanes& fresnelSlope) {
  const float on = shared.view[0] * shared.n[0] + shared.view[1] * shared.n[1] + shared.view[2] * shared.n[2];
  const Lanes invSn2 = half.invSn * half.invSn;
  const Lanes miss = vmax(Lanes(1.0f) - half.cosineD, Lanes(1e-9f));
  const Lanes logMiss = vlog(miss);
  const Lanes rise = Lanes(kRise) * vexp(Lanes(fresnelPower) * logMiss);
  const Lanes fresnel = Lanes(1.0f) + rise;
  fresnelSlope = rise * logMiss / fresnel;
  return fresnel * half.length2 * half.length2 * invSn2 * invSn2 * Lanes(0.25f / on);
}

/// Sums of columns times row functions. rows: [4 or 8][nodes]; columns `first` .. `first + count` at
/// `stride`. out[column * rowStride + row] += ...
HWY_INLINE void addSums(const float* rows, int rowFunctions, const float* columns, int count,
                        std::size_t stride, int nodes, float* out, std::size_t outStride) {
  const int lanes = static_cast<int>(hn::Lanes(Tag()));
  for (int c = 0; c < count; c += 2) {
    const float* a = columns + static_cast<std::size_t>(c) * stride;
    const bool two = c + 1 < count;
    const float* b = two ? a + stride : a;
    for (int r = 0; r < rowFunctions; r += 4) {
      Vec sum[8];
      for (auto& s : sum) s = hn::Zero(Tag());
      const float* row = rows + static_cast<std::size_t>(r) * static_cast<std::size_t>(nodes);
      for (int i = 0; i < nodes; i += lanes) {
        const Vec va = hn::LoadU(Tag(), a + i), vb = hn::LoadU(Tag(), b + i);
        for (int k = 0; k < 4; ++k) {
          const Vec p = hn::LoadU(Tag(), row + k * nodes + i);
          sum[k] = hn::MulAdd(p, va, sum[k]);
          sum[4 + k] = hn::MulAdd(p, vb, sum[4 + k]);
        }
      }
      for (int k = 0; k < 4; ++k) {
        out[static_cast<std::size_t>(c) * outStride + static_cast<std::size_t>(r + k)] += sumOf(sum[k]);
        if (two)
          out[static_cast<std::size_t>(c + 1) * outStride + static_cast<std::size_t>(r + k)] +=
              sumOf(sum[4 + k]);
      }
    }
  }
}

/// Row functions of one frequency at given phases: photographs of phase 0 to 3 of the shown pattern; with
/// `slope` also of its derivative by gamma. `most`: the highest harmonic that the nodes resolve.
HWY_INLINE void rowFunctions(const ScreenQuadrature& quad, Lanes phase, float most, bool slope, float* out,
                             int nodes, int at) {
  Lanes s, c;
  vsincos(clampTo(phase, -7000, 7000), s, c);
  const Lanes cos2 = Lanes(2.0f) * c * c - Lanes(1.0f), twice = Lanes(2.0f) * cos2;
  for (int set = 0; set < (slope ? 2 : 1); ++set) {
    const ScreenQuadrature::Harmonics& h = set == 0 ? quad.shown_ : quad.shownSlope_;
    // odd: sin(m t) and, a quarter turn on, sin(m (t + pi / 2)) = +-cos(m t)
    Lanes oddS = Lanes(h.odd[0]) * s, oddC = Lanes(h.odd[0]) * c;
    if (most >= 3 && (h.odd[1] != 0 || h.odd[2] != 0)) {
      Lanes sPrevious = -s, cPrevious = c, sNow = s, cNow = c;  // of -1 and 1
      for (int k = 1; k < 4 && static_cast<float>(2 * k + 1) <= most; ++k) {
        const Lanes sNext = mulSub(twice, sNow, sPrevious), cNext = mulSub(twice, cNow, cPrevious);
        sPrevious = sNow, cPrevious = cNow, sNow = sNext, cNow = cNext;
        oddS = mulAdd(Lanes(h.odd[static_cast<std::size_t>(k)]), sNow, oddS);
        oddC = mulAdd(Lanes(k % 2 ? -h.odd[static_cast<std::size_t>(k)] : h.odd[static_cast<std::size_t>(k)]),
                      cNow, oddC);
      }
    }
    Lanes evenS(h.even[0]), evenC(h.even[0]);
    Lanes previous(1.0f), now = cos2;
    for (int m = 1; m < 25 && static_cast<float>(2 * m) <= most; ++m) {
      const float share = h.even[static_cast<std::size_t>(m)];
      evenS = mulAdd(Lanes(share), now, evenS);
      evenC = mulAdd(Lanes(m % 2 ? -share : share), now, evenC);
      const Lanes next = mulSub(twice, now, previous);
      previous = now, now = next;
    }
    float* to = out + set * 4 * nodes + at;
    store(evenS + oddS, to);
    store(evenC + oddC, to + nodes);
    store(evenS - oddS, to + 2 * nodes);
    store(evenC - oddC, to + 3 * nodes);
  }
}

void FillGridRows(ScreenQuadrature& quad) {
  const int lanes = static_cast<int>(hn::Lanes(Tag()));
  quad.gridRows_.resize(quad.frequency_.size());
  for (std::size_t f = 0; f < quad.frequency_.size(); ++f) {
    const Eigen::Vector2f w = quad.frequency_[f];
    // What 24 and 16 Legendre nodes over the lit area resolve.
    const float most =
        std::min(11.0f / std::max(std::abs(w.x()), 1e-3f), 13.0f / std::max(std::abs(w.y()), 1e-3f));
    std::vector<float>& rows = quad.gridRows_[f];
    rows.resize(static_cast<std::size_t>(8 * quad.gridCount_));
    for (int i = 0; i < quad.gridCount_; i += lanes) {
      const Lanes phase =
          Lanes(w.x()) * load(quad.gridX_.data() + i) + Lanes(w.y()) * load(quad.gridY_.data() + i);
      rowFunctions(quad, phase, most, true, rows.data(), quad.gridCount_, i);
      if (most < 1) {  // not even the first: what is left is the mean
        for (int set = 0; set < 2; ++set)
          for (int k = 0; k < 4; ++k)
            store(Lanes(set == 0 ? quad.shown_.even[0] : quad.shownSlope_.even[0]),
                  rows.data() + (set * 4 + k) * quad.gridCount_ + i);
      }
    }
  }
}

/// Sums of a node set for all frequencies and the window: out[column * rowCount + row] +=.
void sumPeak(const ScreenQuadrature& quad, const q::Peak& peak, const float* x, const float* y,
             const float* columns, int count, bool slope, float* out, float* shapeOut) {
  const int lanes = static_cast<int>(hn::Lanes(Tag())), nodes = q::kLobeNodes;
  const std::size_t rowCount = static_cast<std::size_t>(quad.rowCount());
  HWY_ALIGN float rows[8 * q::kLobeNodes];
  for (std::size_t f = 0; f < quad.frequency_.size(); ++f) {
    const Eigen::Vector2f w = quad.frequency_[f];
    const double along = w.x() * peak.l11 + w.y() * peak.l21, across = w.y() * peak.l22;
    const float spread = static_cast<float>(std::sqrt(along * along + across * across));
    const float most = q::kFinestPhase / std::max(spread, 1e-3f);
    float sums[64 * 8];
    for (int i = 0; i < nodes; i += lanes) {
      const Lanes phase = Lanes(w.x()) * load(x + i) + Lanes(w.y()) * load(y + i);
      rowFunctions(quad, phase, most, slope, rows, nodes, i);
      if (most < 1)
        for (int set = 0; set < (slope ? 2 : 1); ++set)
          for (int k = 0; k < 4; ++k)
            store(Lanes(set == 0 ? quad.shown_.even[0] : quad.shownSlope_.even[0]),
                  rows + (set * 4 + k) * nodes + i);
    }
    std::fill(sums, sums + count * 8, 0.0f);
    addSums(rows, 4, columns, count, static_cast<std::size_t>(nodes), nodes, sums, 8);
    if (slope) addSums(rows + 4 * nodes, 4, columns, 1, static_cast<std::size_t>(nodes), nodes, sums + 4, 8);
    for (int c = 0; c < count; ++c)
      for (int k = 0; k < 4; ++k)
        out[static_cast<std::size_t>(c) * rowCount + 4 * f + static_cast<std::size_t>(k)] += sums[c * 8 + k];
    if (slope)
      for (int k = 0; k < 4; ++k) shapeOut[4 * f + static_cast<std::size_t>(k)] += sums[4 + k];
  }
  for (int c = 0; c < count; ++c) {
    Vec sum = hn::Zero(Tag());
    for (int i = 0; i < nodes; i += lanes) sum = hn::Add(sum, hn::LoadU(Tag(), columns + c * nodes + i));
    out[static_cast<std::size_t>(c) * rowCount + rowCount - 1] += sumOf(sum);
  }
}

void sumGrid(const ScreenQuadrature& quad, const float* columns, int count, bool slope, float* out,
             float* shapeOut) {
  const int lanes = static_cast<int>(hn::Lanes(Tag())), nodes = quad.gridCount_;
  const std::size_t rowCount = static_cast<std::size_t>(quad.rowCount());
  for (std::size_t f = 0; f < quad.frequency_.size(); ++f) {
    float sums[64 * 8];
    std::fill(sums, sums + count * 8, 0.0f);
    const float* rows = quad.gridRows_[f].data();
    addSums(rows, 4, columns, count, static_cast<std::size_t>(q::kMostGrid), nodes, sums, 8);
    if (slope)
      addSums(rows + 4 * nodes, 4, columns, 1, static_cast<std::size_t>(q::kMostGrid), nodes, sums + 4, 8);
    for (int c = 0; c < count; ++c)
      for (int k = 0; k < 4; ++k)
        out[static_cast<std::size_t>(c) * rowCount + 4 * f + static_cast<std::size_t>(k)] += sums[c * 8 + k];
    if (slope)
      for (int k = 0; k < 4; ++k) shapeOut[4 * f + static_cast<std::size_t>(k)] += sums[4 + k];
  }
  for (int c = 0; c < count; ++c) {
    Vec sum = hn::Zero(Tag());
    for (int i = 0; i < nodes; i += lanes)
      sum = hn::Add(sum, hn::LoadU(Tag(), columns + static_cast<std::size_t>(c) * q::kMostGrid + i));
    out[static_cast<std::size_t>(c) * rowCount + rowCount - 1] += sumOf(sum);
  }
}

/// Density of a Gaussian lobe of slopes about the normal, with its exponent.
HWY_INLINE Lanes lobeDensity(const Shared& shared, const HalfAt& half, float sigma, Lanes& exponentQ) {
  const q::SiteFrame& f = shared.site;
  const float inv = 1 / (sigma * sigma);
  exponentQ = (Lanes(static_cast<float>(f.m11)) * half.y1 * half.y1 +
               Lanes(static_cast<float>(2 * f.m12)) * half.y1 * half.y2 +
               Lanes(static_cast<float>(f.m22)) * half.y2 * half.y2) *
              Lanes(inv);
  return Lanes(inv / (2 * std::numbers::pi_v<float>)) * vexp(Lanes(-0.5f) * exponentQ);
}

struct LobeInput {
  float sigma;         ///< of this Gaussian
  float kurtosisPart;  ///< d log sigma of it / d (log gamma)^2
  float share;         ///< of the lobe
  float fresnelPower;
  std::array<float, 3> freeForm;
  float dM1[3], dM2[3];  ///< d (m11, m12, m22) / d stretch
};

/// One Gaussian of the lobe: nodes, columns, sums.
void AddLobe(const ScreenQuadrature& quad, const q::SiteFrame& site, const Shared& shared,
             const q::Peak& peak, const LobeInput& lobe, q::Want want, float* out, float* shapeOut) {
  const int lanes = static_cast<int>(hn::Lanes(Tag())), nodes = q::kLobeNodes;
  HWY_ALIGN float x[q::kLobeNodes], y[q::kLobeNodes];
  HWY_ALIGN float columns[q::kSpecularCount * q::kLobeNodes];
  for (int j = 0; j < q::kSide; ++j) {
    for (int i = 0; i < q::kSide; ++i) {
      const double a = (i - (q::kSide - 1) / 2.0) * q::kSpacing, b = (j - (q::kSide - 1) / 2.0) * q::kSpacing;
      x[j * q::kSide + i] = static_cast<float>(peak.x + peak.l11 * a);
      y[j * q::kSide + i] = static_cast<float>(peak.y + peak.l21 * a + peak.l22 * b);
    }
  }
  const float weight = static_cast<float>(peak.weight) * lobe.share;
  for (int i = 0; i < nodes; i += lanes) {
    const LightAt light = lightAt(shared, load(x + i), load(y + i), false);
    const HalfAt half = halfAt(shared, light);
    Lanes fresnelSlope, exponentQ;
    const Lanes m = lobeWeight(shared, half, lobe.fresnelPower, fresnelSlope);
    const Lanes density = lobeDensity(shared, half, lobe.sigma, exponentQ);
    const Lanes cosine = dot3(light.toLight, shared.n);
    Lanes f = Lanes(weight) * density * m * light.gain;
    f = Lanes(hn::IfThenElseZero(hn::Gt(cosine.v, hn::Zero(Tag())), f.v));
    const Lanes free1 = vexp(Lanes(-0.5f) * exponentQ),
                free2 = Lanes(0.25f) * exponentQ * vexp(Lanes(-0.25f) * exponentQ),
                free3 = exponentQ * vinv(Lanes(4.0f) + exponentQ);
    if (lobe.freeForm[0] != 0 || lobe.freeForm[1] != 0 || lobe.freeForm[2] != 0)
      f = f * vexp(Lanes(lobe.freeForm[0]) * free1 + Lanes(lobe.freeForm[1]) * free2 +
                   Lanes(lobe.freeForm[2]) * free3);
    const auto put = [&](int k, Lanes value) { store(value, columns + k * nodes + i); };
    put(q::kSpecular, f);
    if (want == q::kPrediction) continue;
    put(q::kSpecularLogSigma, f * (exponentQ - Lanes(2.0f)));
    put(q::kSpecularKurtosis, f * (exponentQ - Lanes(2.0f)) * Lanes(lobe.kurtosisPart));
    // Normal: y = s / (s.n) - n, so dy = -s (s.dn) / (s.n)^2 - dn.
    const float inv = 1 / (lobe.sigma * lobe.sigma);
    const Lanes my1 =
        (Lanes(static_cast<float>(site.m11)) * half.y1 + Lanes(static_cast<float>(site.m12)) * half.y2) *
        Lanes(inv);
    const Lanes my2 =
        (Lanes(static_cast<float>(site.m12)) * half.y1 + Lanes(static_cast<float>(site.m22)) * half.y2) *
        Lanes(inv);
    const Lanes s1 = dot3(half.s, shared.t1), s2 = dot3(half.s, shared.t2);
    for (int axis = 0; axis < 2; ++axis) {
      const float(&dn)[3] = axis == 0 ? shared.dnX : shared.dnY;
      const float on =
          shared.view[0] * shared.n[0] + shared.view[1] * shared.n[1] + shared.view[2] * shared.n[2];
      const float odn = shared.view[0] * dn[0] + shared.view[1] * dn[1] + shared.view[2] * dn[2];
      const float dn1 = dn[0] * shared.t1[0] + dn[1] * shared.t1[1] + dn[2] * shared.t1[2];
      const float dn2 = dn[0] * shared.t2[0] + dn[1] * shared.t2[1] + dn[2] * shared.t2[2];
      const Lanes sdn = dot3(half.s, dn) * half.invSn;
      const Lanes dy1 = -(s1 * half.invSn) * sdn - Lanes(dn1), dy2 = -(s2 * half.invSn) * sdn - Lanes(dn2);
      put(axis == 0 ? q::kSpecularSlopeX : q::kSpecularSlopeY,
          f * (-(my1 * dy1 + my2 * dy2) - Lanes(4.0f) * sdn - Lanes(odn / on)));
    }
    const auto stretched = [&](const float(&dM)[3]) {
      return Lanes(-0.5f * inv) * (Lanes(dM[0]) * half.y1 * half.y1 + Lanes(2 * dM[1]) * half.y1 * half.y2 +
                                   Lanes(dM[2]) * half.y2 * half.y2);
    };
    put(q::kStretch1, f * stretched(lobe.dM1));
    put(q::kStretch2, f * stretched(lobe.dM2));
    if (want == q::kParameters) continue;
    lightColumns(shared, light, f, columns + q::kSpecularLight * nodes + i, static_cast<std::size_t>(nodes));
    put(q::kFresnelPower, f * fresnelSlope);
    put(q::kIridescence, f * half.cosineD);
    put(q::kFreeForm, f * free1);
    put(q::kFreeForm + 1, f * free2);
    put(q::kFreeForm + 2, f * free3);
  }
  // Pattern coordinates for the phases.
  const Lanes footX(static_cast<float>(site.footX)), footY(static_cast<float>(site.footY));
  for (int i = 0; i < nodes; i += lanes) {
    store(load(x + i) + footX, x + i);
    store(load(y + i) + footY, y + i);
  }
  const int count = want == q::kPrediction   ? 1
                    : want == q::kParameters ? q::kStretch2 + 1
                                             : q::kSpecularCount;
  sumPeak(quad, peak, x, y, columns, count, want == q::kEverything, out, shapeOut);
}

/// A plain Gaussian lobe as a further term: one column.
void AddTermLobe(const ScreenQuadrature& quad, const q::SiteFrame& site, const Shared& shared,
                 const q::Peak& peak, float sigma, float* out) {
  const LobeInput lobe{sigma, 0, 1, 5, {}, {}, {}};
  AddLobe(quad, site, shared, peak, lobe, q::kPrediction, out, nullptr);
}

/// The diffuse part and the broad terms, over the whole lit area.
void AddGrid(const ScreenQuadrature& quad, const q::SiteFrame& site, const Shared& shared, q::Want want,
             const float (&gridSigma)[2], float* out) {
  const int lanes = static_cast<int>(hn::Lanes(Tag())), nodes = quad.gridCount_;
  const std::size_t rowCount = static_cast<std::size_t>(quad.rowCount());
  static thread_local hwy::AlignedFreeUniquePtr<float[]> memory;
  constexpr int kGridColumns = q::kDiffuseCount + 4;
  if (!memory) memory = hwy::AllocateAligned<float>(static_cast<std::size_t>(kGridColumns) * q::kMostGrid);
  float* columns = memory.get();
  const Lanes footX(static_cast<float>(site.footX)), footY(static_cast<float>(site.footY));
  constexpr float kInvPi = std::numbers::inv_pi_v<float>;
  for (int i = 0; i < nodes; i += lanes) {
    const Lanes x = load(quad.gridX_.data() + i) - footX, y = load(quad.gridY_.data() + i) - footY;
    const LightAt light = lightAt(shared, x, y, true);
    const Lanes cosine = dot3(light.toLight, shared.n);
    const Lanes lit = Lanes(hn::IfThenElseZero(hn::Gt(cosine.v, hn::Zero(Tag())),
                                               (light.gain * load(quad.gridWeight_.data() + i)).v));
    const Lanes bare = Lanes(kInvPi) * lit, f = bare * cosine;
    const auto put = [&](int k, Lanes value) {
      store(value, columns + static_cast<std::size_t>(k) * q::kMostGrid + i);
    };
    put(q::kDiffuse, f);
    if (want == q::kPrediction) continue;
    put(q::kDiffuseSlopeX, bare * dot3(light.toLight, shared.dnX));
    put(q::kDiffuseSlopeY, bare * dot3(light.toLight, shared.dnY));
    if (want == q::kParameters) continue;
    lightColumns(shared, light, f, columns + static_cast<std::size_t>(q::kDiffuseLight) * q::kMostGrid + i,
                 q::kMostGrid);
    const HalfAt half = halfAt(shared, light);
    Lanes slope, exponentQ;
    const Lanes m = lobeWeight(shared, half, 5, slope);
    for (int k = 0; k < 2; ++k)
      put(q::kDiffuseCount + k,
          gridSigma[k] > 0 ? lit * m * lobeDensity(shared, half, gridSigma[k], exponentQ) : Lanes(0.0f));
    // Sheen: fibres reflect where the half-vector grazes; sine of its angle to the cube (Estevez and Kulla
    // 2017, exponent for their alpha of 1/3), normalised by its value range only.
    const Lanes cosineH = half.sn * vrsqrt(half.length2);
    const Lanes sine2 = vmax(Lanes(1.0f) - cosineH * cosineH, Lanes(0.0f));
    put(q::kDiffuseCount + 2, f * sine2 * vsqrt(sine2));
    // Back towards the light: a Gaussian of 8 degrees about the view direction, peak 1.
    const Lanes back = dot3(light.toLight, shared.view);
    put(q::kDiffuseCount + 3, lit * cosine * vexp((back - Lanes(1.0f)) * Lanes(1 / (0.14f * 0.14f))));
  }
  const bool all = want == q::kEverything;
  sumGrid(quad, columns,
          want == q::kPrediction   ? 1
          : want == q::kParameters ? q::kDiffuseLight
                                   : q::kDiffuseCount,
          all, out, out + static_cast<std::size_t>(q::kShapeStart + q::kShapeDiffuse) * rowCount);
  if (!all) return;
  const auto term = [&](int column, int to) {
    sumGrid(quad, columns + static_cast<std::size_t>(column) * q::kMostGrid, 1, false,
            out + static_cast<std::size_t>(q::kTermStart + to) * rowCount, nullptr);
  };
  if (gridSigma[0] > 0) term(q::kDiffuseCount, q::kThirdLobe);
  if (gridSigma[1] > 0) term(q::kDiffuseCount + 1, q::kThirdLobeBroad);
  term(q::kDiffuseCount + 2, q::kSheen);
  term(q::kDiffuseCount + 3, q::kRetro);
}

/// Everything of a site; peaks: the lobe's two Gaussians, the clearcoat's, the third lobes' (used where not
/// on the grid).
void EvaluateSite(const ScreenQuadrature& quad, const q::SiteFrame& site, const QuadratureSite& parameters,
                  const q::Peak (&peak)[5], const float (&sigma)[5], const float (&kurtosisPart)[2],
                  const float (&dM1)[3], const float (&dM2)[3], q::Want want, float* out) {
  const std::size_t rowCount = static_cast<std::size_t>(quad.rowCount());
  Shared shared{quad, site, {}, {}, {}, {}, {}, {}, {}};
  for (int j = 0; j < 3; ++j) {
    shared.n[j] = static_cast<float>(site.n[j]);
    shared.dnX[j] = static_cast<float>(site.dnX[j]);
    shared.dnY[j] = static_cast<float>(site.dnY[j]);
    shared.t1[j] = static_cast<float>(site.t1[j]);
    shared.t2[j] = static_cast<float>(site.t2[j]);
    shared.view[j] = static_cast<float>(site.view[j]);
    shared.up[j] = quad.up_[j];
  }
  constexpr float kGridFrom = 0.12f;  // slopes: from here on the grid resolves a lobe
  const float gridSigma[2] = {sigma[3] >= kGridFrom ? sigma[3] : 0, sigma[4] >= kGridFrom ? sigma[4] : 0};
  AddGrid(quad, site, shared, want, gridSigma, out);
  for (int l = 0; l < 2; ++l) {
    LobeInput lobe{sigma[l], kurtosisPart[l], 0.5f, parameters.fresnelPower, parameters.freeForm, {}, {}};
    for (int k = 0; k < 3; ++k) lobe.dM1[k] = dM1[k], lobe.dM2[k] = dM2[k];
    AddLobe(quad, site, shared, peak[l], lobe, want,
            out + static_cast<std::size_t>(q::kSpecularStart) * rowCount,
            out + static_cast<std::size_t>(q::kShapeStart + q::kShapeSpecular) * rowCount);
  }
  if (want != q::kEverything) return;
  AddTermLobe(quad, site, shared, peak[2], sigma[2],
              out + static_cast<std::size_t>(q::kTermStart + q::kClearcoat) * rowCount);
  for (int k = 0; k < 2; ++k)
    if (gridSigma[k] == 0)
      AddTermLobe(quad, site, shared, peak[3 + k], sigma[3 + k],
                  out + static_cast<std::size_t>(q::kTermStart + q::kThirdLobe + k) * rowCount);
}

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
  {
    const Eigen::Vector3d v(-state.horizonTiltX, -state.horizonTiltY, 1), m = v.normalized();
    const auto slope = [&](const Eigen::Vector3d& e) -> Eigen::Vector3d {
      return (e - m * m.dot(e)) / v.norm();
    };
    horizonNormal_ = (frame.screenFromWorld * m).cast<float>();
    horizonByX_ = (frame.screenFromWorld * slope(-Eigen::Vector3d::UnitX())).cast<float>();
    horizonByY_ = (frame.screenFromWorld * slope(-Eigen::Vector3d::UnitY())).cast<float>();
  }
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
