#include "engine/fourier/photo_prediction.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <vector>

#include "engine/fourier/point_model.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/fourier/photo_prediction.cpp"
#include <hwy/foreach_target.h>
// after foreach_target
#include <hwy/aligned_allocator.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace patina::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::ScalableTag<float>;
using Vec = hn::Vec<Tag>;
using Mask = hn::Mask<Tag>;

#include "engine/fourier/lanes.inc"
#include "engine/fourier/lobe_kernel.inc"

constexpr int kOrders = PhotoPrediction::kNodes * PhotoPrediction::kNodes;
constexpr int kProducts = 2 * kOrders;  // the second half for the derivative by height
constexpr float kMultiple[PhotoPrediction::kHarmonics] = {1, 2, 4, 6, 8, 10, 12, 14, 16};

/// One of the lobe's two Gaussians along one direction of the frequency plane: at k times the frequency the
/// transform is mass exp(-k^2 decay) (1 + k^4 bend) exp(i (k^3 skew - k phase)).
struct AlongDirection {
  Lanes mass, decay, phase, skew, bend;
};

class SiteLanes {
 public:
  SiteLanes(const PhotoPrediction& shared, std::span<const PredictionSite> sites)
      : shared_(shared), sites_(sites), lanes_(hn::Lanes(Tag())) {
    const auto gather = [&](auto get) {
      HWY_ALIGN float value[HWY_MAX_BYTES / sizeof(float)] = {};
      for (std::size_t lane = 0; lane < lanes_; ++lane)
        value[lane] = static_cast<float>(get(sites_[std::min(lane, sites_.size() - 1)]));
      return Lanes(hn::Load(Tag(), value));
    };
    using S = const PredictionSite&;
    used_ = Lanes(hn::IfThenElse(hn::FirstN(Tag(), sites.size()), hn::Set(Tag(), 1.0f), hn::Zero(Tag())));
    LobeSite<Lanes> site;
    site.distance = gather([](S s) { return s.geometry.distance; });
    site.viewX = gather([](S s) { return s.geometry.viewX; });
    site.viewY = gather([](S s) { return s.geometry.viewY; });
    site.viewZ = gather([](S s) { return s.geometry.viewZ; });
    site.lightMeanX = gather([](S s) { return s.geometry.lightMeanX; });
    site.lightMeanY = gather([](S s) { return s.geometry.lightMeanY; });
    site.lightPrecisionX = gather([](S s) { return s.geometry.lightPrecisionX; });
    site.lightPrecisionY = gather([](S s) { return s.geometry.lightPrecisionY; });
    site.lightPeak = gather([](S s) { return s.geometry.lightPeak; });
    const LobeVariant& variant = shared.variant;
    if (variant.skewedLight || variant.stretched) {
      site.lightPrecisionXY = gather([](S s) { return s.geometry.lightPrecisionXY; });
      site.shapeAlong = gather([](S s) { return lobeShape(s.geometry.lobe).along; });
      site.shapeMixed = gather([](S s) { return lobeShape(s.geometry.lobe).mixed; });
      site.shapeAcross = gather([](S s) { return lobeShape(s.geometry.lobe).across; });
    }
    weight_[0] = weight_[1] = Lanes(0.5f);
    Lanes thirdWidth(0.0f);
    if (variant.third) {
      lobes_ = 3;
      weight_[0] = weight_[1] = gather([](S s) { return 0.5f * (1 - s.geometry.lobe.thirdShare); });
      weight_[2] = gather([](S s) { return s.geometry.lobe.thirdShare; });
      thirdWidth = gather([](S s) { return s.parameters->sigma * s.geometry.lobe.thirdRatio; });
    }
    const Lanes footX = gather([](S s) { return s.geometry.footX; });
    const Lanes footY = gather([](S s) { return s.geometry.footY; });
    invPixels_ = gather([](S s) { return 1.0f / s.pixelCount; });
    for (int c = 0; c < 3; ++c) {
      diffuse_[c] = gather([c](S s) { return s.parameters->diffuse[c]; });
      specular_[c] = gather([c](S s) { return s.parameters->specular[c]; });
      black_[c] = gather([c](S s) { return s.black[c]; });
    }
    const Lanes slopeX = gather([](S s) { return s.parameters->normal.x() / s.parameters->normal.z(); });
    const Lanes slopeY = gather([](S s) { return s.parameters->normal.y() / s.parameters->normal.z(); });
    const NormalFrame<Lanes> frame = normalFromSlopes(slopeX, slopeY, shared.normalRows);
    for (int j = 0; j < 3; ++j) normal_[j] = frame.n[j];
    const Lanes gamma = gather([](S s) { return std::max(1.0f, s.parameters->kurtosis); });
    const Lanes scale = gather([](S s) {
      const double g = std::max(1.0, static_cast<double>(s.parameters->kurtosis));
      return s.parameters->sigma * std::sqrt(2 / (1 / (g * g) + g * g));
    });
    for (int l = 0; l < lobes_; ++l) {
      const Lanes width = l == 0 ? scale / gamma : l == 1 ? scale * gamma : thirdWidth;
      const bool exact = shared.lobe == LobeMapping::ExactMoments;
      lobe_[l] = !exact                ? lobeMomentsPaper(site, slopeX, slopeY, width, shared.normalRows)
                 : variant.stretched   ? lobeMoments<kShapedLobe>(site, frame, width)
                 : variant.skewedLight ? lobeMoments<kSkewedLight>(site, frame, width)
                                       : lobeMoments(site, frame, width);
      lit_[l] = exact ? litFraction(lobe_[l], footX, footY, shared.halfExtent[0], shared.halfExtent[1]).value
                      : Lanes(1.0f);
      lobe_[l].meanX = lobe_[l].meanX + footX;
      lobe_[l].meanY = lobe_[l].meanY + footY;
    }
    // Products of Chebyshev polynomials at the sites.
    Lanes t[2][PhotoPrediction::kNodes];
    t[0][1] = gather([&](S s) { return s.pointMm.x() / shared.halfSizeMm[0]; });
    t[1][1] = gather([&](S s) { return s.pointMm.y() / shared.halfSizeMm[1]; });
    for (auto& axis : t) {
      axis[0] = Lanes(1.0f);
      for (int k = 2; k < PhotoPrediction::kNodes; ++k)
        axis[k] = mulSub(Lanes(2.0f) * axis[1], axis[k - 1], axis[k - 2]);
    }
    for (int j = 0; j < PhotoPrediction::kNodes; ++j)
      for (int i = 0; i < PhotoPrediction::kNodes; ++i)
        hn::Store((t[0][i] * t[1][j]).v, Tag(),
                  product_ + static_cast<std::size_t>(j * PhotoPrediction::kNodes + i) * lanes_);
    if (shared.hasRest) {
      const Lanes rest = gather([](S s) { return s.restMm; });
      for (std::size_t k = 0; k < kOrders; ++k)
        hn::Store((rest * Lanes(hn::Load(Tag(), product_ + k * lanes_))).v, Tag(),
                  product_ + (kOrders + k) * lanes_);
    }
    dropped_ = std::ranges::any_of(sites, [](S s) { return !s.droppedRows.empty(); });
  }

  PredictionSums compare() {
    error_ = signal_ = noise_ = Lanes(0.0f);
    Lanes zeroDiffuse, unused;
    diffuseAt(shared_.zero, zeroDiffuse, unused, false);
    Lanes zeroLobe = weight_[0] * (lit_[0] * lobe_[0].mass + lit_[1] * lobe_[1].mass);
    if (lobes_ == 3) zeroLobe = mulAdd(weight_[2] * lit_[2], lobe_[2].mass, zeroLobe);
    recorded_ = {};
    if (sites_[0].window) compareWindow(zeroDiffuse, zeroLobe);
    constexpr float kInvPi = std::numbers::inv_pi_v<float>;
    for (std::size_t f = 0; f < shared_.frequency.size(); ++f) {
      Lanes diffuseRe, diffuseIm, lobeRe(0.0f), lobeIm(0.0f);
      // Response to |cos| (even multiples alternate in sign) and |sin|, which I1 + I3 and I0 + I2 see.
      Lanes sums[2][2];  // [diffuse, lobe][all plus, alternating]
      sums[0][0] = sums[0][1] = Lanes(2 * kInvPi) * zeroDiffuse;
      sums[1][0] = sums[1][1] = Lanes(2 * kInvPi) * zeroLobe;
      const PhotoPrediction::Polynomial* polynomial =
          shared_.polynomial.data() + f * PhotoPrediction::kHarmonics;
      diffuseAt(polynomial[0], diffuseRe, diffuseIm, true);
      AlongDirection along[3];
      for (int l = 0; l < lobes_; ++l) {
        along[l] = alongDirection(l, shared_.frequency[f]);
        lobeAt(along[l], 1.0f, true, lobeRe, lobeIm);
      }
      for (int m = 1; m < PhotoPrediction::kHarmonics; ++m) {
        const Lanes share(-4 * kInvPi / static_cast<float>(4 * m * m - 1));
        const Lanes turned(m % 2 ? 4 * kInvPi / static_cast<float>(4 * m * m - 1)
                                 : -4 * kInvPi / static_cast<float>(4 * m * m - 1));
        if (polynomial[m].first < polynomial[m].end) {
          Lanes re;
          diffuseAt(polynomial[m], re, unused, false);
          sums[0][0] = mulAdd(share, re, sums[0][0]);
          sums[0][1] = mulAdd(turned, re, sums[0][1]);
        }
        Lanes re(0.0f);
        bool any = false;
        for (int l = 0; l < lobes_; ++l) any |= lobeAt(along[l], kMultiple[m], false, re, unused);
        if (!any) continue;
        sums[1][0] = mulAdd(share, re, sums[1][0]);
        sums[1][1] = mulAdd(turned, re, sums[1][1]);
      }
      // Row 0: I1 - I3 = Re Z and I1 + I3; row 1: I2 - I0 = Im Z and I0 + I2.
      compareRow(f, 0, diffuseRe, lobeRe, sums[0][1], sums[1][1]);
      compareRow(f, 1, diffuseIm, lobeIm, sums[0][0], sums[1][0]);
    }
    if (shared_.recorded) return recorded_;
    return {total(error_), total(signal_), total(noise_)};
  }

 private:
  Lanes gatherFrom(const float* PredictionSite::*array, std::size_t at) const {
    HWY_ALIGN float value[HWY_MAX_BYTES / sizeof(float)] = {};
    for (std::size_t lane = 0; lane < lanes_; ++lane)
      value[lane] = (sites_[std::min(lane, sites_.size() - 1)].*array)[at];
    return Lanes(hn::Load(Tag(), value));
  }

  double total(Lanes sum) const {
    HWY_ALIGN float value[HWY_MAX_BYTES / sizeof(float)] = {};
    hn::Store(sum.v, Tag(), value);
    double all = 0;
    for (std::size_t lane = 0; lane < lanes_; ++lane) all += value[lane];
    return all;
  }

  /// n . v at one multiple of one frequency.
  HWY_INLINE void diffuseAt(const PhotoPrediction::Polynomial& polynomial, Lanes& re, Lanes& im,
                            bool imaginary) const {
    Lanes sum[6] = {Lanes(0.0f), Lanes(0.0f), Lanes(0.0f), Lanes(0.0f), Lanes(0.0f), Lanes(0.0f)};
    const int step = imaginary ? 1 : 2;
    for (int i = polynomial.first; i < polynomial.end; ++i) {
      const PhotoPrediction::Term& term = shared_.terms[static_cast<std::size_t>(i)];
      const Lanes product(hn::Load(Tag(), product_ + static_cast<std::size_t>(term.product) * lanes_));
      for (int k = 0; k < 6; k += step) sum[k] = mulAdd(product, Lanes(term.value[k]), sum[k]);
    }
    re = normal_[0] * sum[0] + normal_[1] * sum[2] + normal_[2] * sum[4];
    im = normal_[0] * sum[1] + normal_[1] * sum[3] + normal_[2] * sum[5];
  }

  HWY_INLINE AlongDirection alongDirection(int l, const Eigen::Vector2f& w) const {
    const LobeMoments<Lanes>& g = lobe_[l];
    const float x = w.x(), y = w.y();
    AlongDirection a;
    a.mass = weight_[l] * g.mass;
    a.decay = Lanes(0.5f * x * x) * g.xx + Lanes(x * y) * g.xy + Lanes(0.5f * y * y) * g.yy;
    a.phase = Lanes(x) * g.meanX + Lanes(y) * g.meanY;
    a.skew = Lanes(x * x * x / 6) * g.third[0] + Lanes(x * x * y / 2) * g.third[1] +
             Lanes(x * y * y / 2) * g.third[2] + Lanes(y * y * y / 6) * g.third[3];
    a.bend = Lanes(x * x * x * x / 24) * g.fourth[0] + Lanes(x * x * x * y / 6) * g.fourth[1] +
             Lanes(x * x * y * y / 4) * g.fourth[2] + Lanes(x * y * y * y / 6) * g.fourth[3] +
             Lanes(y * y * y * y / 24) * g.fourth[4];
    return a;
  }

  /// Adds a Gaussian's transform at a multiple; false where it has decayed in all lanes.
  HWY_INLINE bool lobeAt(const AlongDirection& a, float k, bool imaginary, Lanes& re, Lanes& im) const {
    constexpr float kDecayed = 20;  // 2e-9 of the peak
    const Lanes decay = Lanes(k * k) * a.decay;
    if (hn::AllTrue(Tag(), hn::Gt(decay.v, hn::Set(Tag(), kDecayed)))) return false;
    const Lanes bend = clampTo(Lanes(k * k * k * k) * a.bend, -kMostBend, kMostBend);
    const Lanes envelope = a.mass * vexp(-decay) * (Lanes(1.0f) + bend);
    Lanes sine, cosine;
    // Beyond a few thousand the angle means nothing to a float; those lanes have decayed.
    vsincos(clampTo(Lanes(k * k * k) * a.skew - Lanes(k) * a.phase, -7000.0f, 7000.0f), sine, cosine);
    re = mulAdd(envelope, cosine, re);
    if (imaginary) im = mulAdd(envelope, sine, im);
    return true;
  }

  void compareWindow(Lanes diffuse, Lanes lobe) {
    if (shared_.recorded) return compareWindowRecorded(diffuse, lobe);
    for (int c = 0; c < 3; ++c) {
      const Lanes measured = gatherFrom(&PredictionSite::window, static_cast<std::size_t>(c));
      const Lanes gap = black_[c] + diffuse_[c] * diffuse + specular_[c] * lobe - measured;
      error_ = mulAdd(used_ * gap, gap, error_);
      const Lanes photograph = sites_[0].extraWindow ? measured + gatherFrom(&PredictionSite::extraWindow,
                                                                             static_cast<std::size_t>(c))
                                                     : measured;
      signal_ = mulAdd(used_ * photograph, photograph, signal_);
      addNoise(used_, vmax(photograph, Lanes(0.0f)), 1.0f);
    }
  }

  HWY_INLINE void addNoise(Lanes used, Lanes radiance, float photographs) {
    noise_ =
        noise_ + used * invPixels_ *
                     (Lanes(shared_.noiseShot) * radiance + Lanes(photographs * shared_.noiseReadSquared));
  }

  /// Two photographs by their difference and sum: a^2 + b^2 = ((a + b)^2 + (a - b)^2) / 2.
  void compareRow(std::size_t f, std::size_t row, Lanes diffuse, Lanes lobe, Lanes diffuseSum,
                  Lanes lobeSum) {
    if (shared_.recorded) return compareRowRecorded(f, row, diffuse, lobe, diffuseSum, lobeSum);
    Lanes used = used_;
    if (dropped_) used = withoutDropped(static_cast<int>(2 * f + row));
    const Lanes half(0.5f), zero(0.0f), halfUsed = half * used;
    for (std::size_t c = 0; c < 3; ++c) {
      Lanes difference = gatherFrom(&PredictionSite::z, f * 6 + row * 3 + c);
      Lanes sum = gatherFrom(&PredictionSite::even, f * 6 + (row == 0 ? 3 : 0) + c);
      const Lanes gapDifference = diffuse_[c] * diffuse + specular_[c] * lobe - difference;
      const Lanes gapSum = Lanes(2.0f) * black_[c] + diffuse_[c] * diffuseSum + specular_[c] * lobeSum - sum;
      if (sites_[0].extraZ) {
        difference = difference + gatherFrom(&PredictionSite::extraZ, f * 6 + row * 3 + c);
        sum = sum + gatherFrom(&PredictionSite::extraEven, f * 6 + (row == 0 ? 3 : 0) + c);
      }
      error_ = mulAdd(halfUsed, gapDifference * gapDifference + gapSum * gapSum, error_);
      signal_ = mulAdd(halfUsed, difference * difference + sum * sum, signal_);
      addNoise(used, vmax(half * (sum + difference), zero) + vmax(half * (sum - difference), zero), 2.0f);
    }
  }

  /// One number a lane.
  struct Buffer {
    HWY_ALIGN float value[HWY_MAX_BYTES / sizeof(float)];
    explicit Buffer(Lanes lanes) { hn::Store(lanes.v, Tag(), value); }
  };

  /// One photograph at one site, through response, crosstalk, offset and gain.
  void addRecorded(int photo, std::size_t lane, const Eigen::Array3f& model, const Eigen::Array3f& measured,
                   const Eigen::Array3f& extra) {
    const PredictionSite& site = sites_[lane];
    const Eigen::Array3f black(site.black[0], site.black[1], site.black[2]);
    const auto predicted = shared_.recorded->record(photo, model + extra, black);
    const auto taken = shared_.recorded->record(photo, measured + extra, black);
    recorded_.error += (predicted.value - taken.value).square().sum();
    recorded_.signal += taken.value.square().sum();
    const Eigen::Array3f variance =
        (shared_.noiseShot * (measured + extra).max(0.0f) + shared_.noiseReadSquared) / site.pixelCount;
    recorded_.noise += (taken.derivative.array().square().matrix() * variance.matrix()).sum();
  }

  void compareWindowRecorded(Lanes diffuse, Lanes lobe) {
    const Buffer d(diffuse), l(lobe);
    for (std::size_t lane = 0; lane < std::min(lanes_, sites_.size()); ++lane) {
      const PredictionSite& site = sites_[lane];
      Eigen::Array3f model, measured, extra;
      for (int c = 0; c < 3; ++c) {
        model[c] = site.black[c] + site.parameters->diffuse[c] * d.value[lane] +
                   site.parameters->specular[c] * l.value[lane];
        measured[c] = site.window[c];
        extra[c] = site.extraWindow ? site.extraWindow[c] : 0.0f;
      }
      addRecorded(shared_.windowPhoto, lane, model, measured, extra);
    }
  }

  void compareRowRecorded(std::size_t f, std::size_t row, Lanes diffuse, Lanes lobe, Lanes diffuseSum,
                          Lanes lobeSum) {
    const Buffer d(diffuse), l(lobe), dSum(diffuseSum), lSum(lobeSum);
    // The row's difference is of photographs 1 and 3, or 2 and 0.
    const int photo[2] = {shared_.photo[f][row == 0 ? 1 : 2], shared_.photo[f][row == 0 ? 3 : 0]};
    const std::size_t z = f * 6 + row * 3, even = f * 6 + (row == 0 ? 3 : 0);
    for (std::size_t lane = 0; lane < std::min(lanes_, sites_.size()); ++lane) {
      const PredictionSite& site = sites_[lane];
      if (std::ranges::find(site.droppedRows, static_cast<int>(2 * f + row)) != site.droppedRows.end())
        continue;
      for (int side = 0; side < 2; ++side) {
        const float sign = side == 0 ? 0.5f : -0.5f;
        Eigen::Array3f model, measured, extra = Eigen::Array3f::Zero();
        for (std::size_t c = 0; c < 3; ++c) {
          const auto k = static_cast<Eigen::Index>(c);
          const float a = site.parameters->diffuse[k], b = site.parameters->specular[k];
          model[k] = 0.5f * (2 * site.black[c] + a * dSum.value[lane] + b * lSum.value[lane]) +
                     sign * (a * d.value[lane] + b * l.value[lane]);
          measured[k] = 0.5f * site.even[even + c] + sign * site.z[z + c];
          if (site.extraZ) extra[k] = 0.5f * site.extraEven[even + c] + sign * site.extraZ[z + c];
        }
        addRecorded(photo[side], lane, model, measured, extra);
      }
    }
  }

  Lanes withoutDropped(int row) const {
    HWY_ALIGN float value[HWY_MAX_BYTES / sizeof(float)] = {};
    for (std::size_t lane = 0; lane < lanes_; ++lane)
      value[lane] =
          lane < sites_.size() && !std::ranges::binary_search(sites_[lane].droppedRows, row) ? 1.0f : 0.0f;
    return Lanes(hn::Load(Tag(), value));
  }

  const PhotoPrediction& shared_;
  std::span<const PredictionSite> sites_;
  std::size_t lanes_;
  bool dropped_ = false;
  Lanes used_, invPixels_, diffuse_[3], specular_[3], black_[3], normal_[3], lit_[3], weight_[3];
  int lobes_ = 2;
  LobeMoments<Lanes> lobe_[3];
  Lanes error_, signal_, noise_;
  PredictionSums recorded_;
  HWY_ALIGN float product_[kProducts * HWY_MAX_BYTES / sizeof(float)];
};

PredictionSums ComparePhotos(const PhotoPrediction& shared, std::span<const PredictionSite> sites) {
  const std::size_t lanes = hn::Lanes(Tag());
  PredictionSums sums;
  for (std::size_t first = 0; first < sites.size(); first += lanes)
    sums += SiteLanes(shared, sites.subspan(first, std::min(lanes, sites.size() - first))).compare();
  return sums;
}

}  // namespace patina::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace patina {

HWY_EXPORT(ComparePhotos);

PredictionSums PhotoPrediction::compare(std::span<const PredictionSite> sites) const {
  return HWY_DYNAMIC_DISPATCH(ComparePhotos)(*this, sites);
}

PhotoPrediction::PhotoPrediction(const ScreenFrame& frame, Eigen::Vector2d sampleSizeMm,
                                 const std::vector<FrequencyGroup>& groups, LobeMapping mapping,
                                 DiffuseMethod diffuse, const NoiseModel& noise, const SheetShape& shape)
    : lobe(mapping),
      noiseShot(static_cast<float>(noise.shot)),
      noiseReadSquared(static_cast<float>(noise.read * noise.read)) {
  static_assert(kHarmonics == 1 + kEvenHarmonics);
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < 3; ++j) normalRows[k][j] = static_cast<float>(frame.screenFromWorld(j, k));
  for (int k = 0; k < 2; ++k) {
    halfExtent[k] = static_cast<float>(frame.halfExtent[k]);
    halfSizeMm[k] = static_cast<float>(sampleSizeMm[k] / 2);
  }

  // The distinct multiples at which the Lambertian term could count.
  constexpr int kHighest = 48;  // DiffuseTransform gives 0 beyond
  std::vector<Eigen::Vector2d> distinct = {Eigen::Vector2d::Zero()};
  std::map<std::pair<int, int>, std::size_t> indexOf;
  std::vector<std::size_t> wanted;  // [frequency][harmonic]; 0: none
  for (const auto& group : groups) {
    frequency.push_back(group.frequency.cast<float>());
    photo.push_back(group.photo);
    for (int h = 0; h < kHarmonics; ++h) {
      const Eigen::Vector2i w = group.frequency * (h == 0 ? 1 : 2 * h);
      if (w.cwiseAbs().maxCoeff() > kHighest) {
        wanted.push_back(0);
        continue;
      }
      const auto [at, fresh] = indexOf.try_emplace({w.x(), w.y()}, distinct.size());
      if (fresh) distinct.push_back(w.cast<double>());
      wanted.push_back(at->second);
    }
  }
  const DiffuseTransform transform(frame, sampleSizeMm, distinct, diffuse, shape);
  hasRest = transform.hasRest();
  // Values at Chebyshev points of the first kind, then coefficients by the discrete cosine transform.
  const auto angle = [](int k) { return std::numbers::pi * (k + 0.5) / kNodes; };
  const std::size_t stride = distinct.size() * 6;
  std::vector<float> values(static_cast<std::size_t>(kNodes * kNodes) * stride), byHeight;
  for (int j = 0; j < kNodes; ++j) {
    for (int i = 0; i < kNodes; ++i) {
      const Eigen::Vector2d point(std::cos(angle(i)) * sampleSizeMm.x() / 2,
                                  std::cos(angle(j)) * sampleSizeMm.y() / 2);
      float* at = values.data() + static_cast<std::size_t>(j * kNodes + i) * stride;
      transform.at(point, 0, at);
      if (!hasRest) continue;
      byHeight.resize(byHeight.size() + stride);
      float* higher = byHeight.data() + byHeight.size() - stride;
      transform.at(point, 1, higher);
      for (std::size_t k = 0; k < stride; ++k) higher[k] -= at[k];
    }
  }
  double cosine[kNodes][kNodes];
  for (int k = 0; k < kNodes; ++k)
    for (int i = 0; i < kNodes; ++i) cosine[k][i] = (k == 0 ? 1.0 : 2.0) / kNodes * std::cos(k * angle(i));
  double largest = 0;
  for (std::size_t k = 0; k < 6; ++k) largest = std::max(largest, std::abs(static_cast<double>(values[k])));
  // Far below float's resolution of the zero frequency: neither the polynomial's order nor the frequency
  // needs a term then.
  const double negligible = 1e-8 * largest;
  const auto addTerms = [&](const std::vector<float>& from, std::size_t d, int firstProduct) {
    // along x, then along y
    std::vector<double> rows(static_cast<std::size_t>(kNodes * kNodes) * 6, 0.0);
    for (int j = 0; j < kNodes; ++j)
      for (int a = 0; a < kNodes; ++a)
        for (int i = 0; i < kNodes; ++i)
          for (std::size_t k = 0; k < 6; ++k)
            rows[static_cast<std::size_t>(j * kNodes + a) * 6 + k] +=
                cosine[a][i] * from[static_cast<std::size_t>(j * kNodes + i) * stride + d * 6 + k];
    for (int b = 0; b < kNodes; ++b) {
      for (int a = 0; a < kNodes; ++a) {
        double sum[6] = {};
        for (int j = 0; j < kNodes; ++j)
          for (std::size_t k = 0; k < 6; ++k)
            sum[k] += cosine[b][j] * rows[static_cast<std::size_t>(j * kNodes + a) * 6 + k];
        Term term{firstProduct + b * kNodes + a, {}};
        bool counts = false;
        for (int k = 0; k < 6; ++k) {
          term.value[k] = static_cast<float>(sum[k]);
          counts |= std::abs(sum[k]) > negligible;
        }
        if (counts) terms.push_back(term);
      }
    }
  };
  std::vector<Polynomial> of(distinct.size());
  for (std::size_t d = 0; d < distinct.size(); ++d) {
    of[d].first = static_cast<int>(terms.size());
    addTerms(values, d, 0);
    if (hasRest) addTerms(byHeight, d, kNodes * kNodes);
    of[d].end = static_cast<int>(terms.size());
  }
  zero = of[0];
  for (const auto index : wanted) polynomial.push_back(index == 0 ? Polynomial{} : of[index]);
}

void PhotoPrediction::compareRecorded(const PhotoCorrection& correction, int window) {
  recorded = &correction;
  windowPhoto = window;
}

}  // namespace patina
#endif
