#include "engine/brdf/neural_kernel.h"

#include <algorithm>
#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/brdf/neural_kernel.cpp"
#include <hwy/foreach_target.h>
// after foreach_target
#include <hwy/aligned_allocator.h>
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace patina::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::ScalableTag<float>;
using Vec = hn::Vec<Tag>;
using Shape = NeuralShape;

constexpr int kMostLanes = 64;  // of 4 bytes: 2048-bit vectors, more than any machine has
constexpr int kTurns = 4;       // phiD, -phiD, pi - phiD, phiD - pi
constexpr int kBlock = 3;       // units at a time: 3 x 4 sums, 3 weights and an input fill 16 registers

/// A layer's activations: `kTurns` vectors a unit.
using Activations = float[Shape::kHidden * kTurns * kMostLanes];

/// `kBlock` units from `unit` on: bias plus weights times the inputs. `sum`: unit by unit, the four turns
/// of each.
HWY_INLINE void weightedSums(const float* HWY_RESTRICT weights, const float* HWY_RESTRICT bias,
                             const float* HWY_RESTRICT input, int units, int unit,
                             Vec (&sum)[kBlock * kTurns]) {
  const Tag tag;
  const std::size_t lanes = hn::Lanes(tag);
  Vec s00 = hn::Set(tag, bias[unit]), s01 = s00, s02 = s00, s03 = s00;
  Vec s10 = hn::Set(tag, bias[unit + 1]), s11 = s10, s12 = s10, s13 = s10;
  Vec s20 = hn::Set(tag, bias[unit + 2]), s21 = s20, s22 = s20, s23 = s20;
  for (int k = 0; k < Shape::kHidden; ++k) {
    const float* row = weights + k * units + unit;
    const Vec w0 = hn::Set(tag, row[0]), w1 = hn::Set(tag, row[1]), w2 = hn::Set(tag, row[2]);
    const float* at = input + k * kTurns * lanes;
    Vec x = hn::Load(tag, at);
    s00 = hn::MulAdd(x, w0, s00);
    s10 = hn::MulAdd(x, w1, s10);
    s20 = hn::MulAdd(x, w2, s20);
    x = hn::Load(tag, at + lanes);
    s01 = hn::MulAdd(x, w0, s01);
    s11 = hn::MulAdd(x, w1, s11);
    s21 = hn::MulAdd(x, w2, s21);
    x = hn::Load(tag, at + 2 * lanes);
    s02 = hn::MulAdd(x, w0, s02);
    s12 = hn::MulAdd(x, w1, s12);
    s22 = hn::MulAdd(x, w2, s22);
    x = hn::Load(tag, at + 3 * lanes);
    s03 = hn::MulAdd(x, w0, s03);
    s13 = hn::MulAdd(x, w1, s13);
    s23 = hn::MulAdd(x, w2, s23);
  }
  sum[0] = s00, sum[1] = s01, sum[2] = s02, sum[3] = s03;
  sum[4] = s10, sum[5] = s11, sum[6] = s12, sum[7] = s13;
  sum[8] = s20, sum[9] = s21, sum[10] = s22, sum[11] = s23;
}

/// The first hidden layer: the four turns differ by the signs of two inputs only, and the second input is
/// always 0.
HWY_INLINE void firstLayer(const float* HWY_RESTRICT weights, Vec sinH, Vec cosH, Vec x, Vec y, Vec cosD,
                           float* HWY_RESTRICT hidden) {
  const Tag tag;
  const std::size_t lanes = hn::Lanes(tag);
  const Vec zero = hn::Zero(tag);
  const float* bias = weights + Shape::kBias0;
  const auto weight = [&](int input, int unit) {
    return hn::Set(tag, weights[Shape::kWeights0 + input * Shape::kHidden + unit]);
  };
  for (int unit = 0; unit < Shape::kHidden; ++unit) {
    Vec shared = hn::MulAdd(sinH, weight(0, unit), hn::Set(tag, bias[unit]));
    shared = hn::MulAdd(cosH, weight(2, unit), shared);
    shared = hn::MulAdd(cosD, weight(5, unit), shared);
    const Vec byX = hn::Mul(x, weight(3, unit)), byY = hn::Mul(y, weight(4, unit));
    const Vec plus = hn::Add(shared, byX), minus = hn::Sub(shared, byX);
    float* at = hidden + unit * kTurns * lanes;
    hn::Store(hn::Max(hn::Add(plus, byY), zero), tag, at);               // phiD
    hn::Store(hn::Max(hn::Sub(plus, byY), zero), tag, at + lanes);       // -phiD
    hn::Store(hn::Max(hn::Add(minus, byY), zero), tag, at + 2 * lanes);  // pi - phiD
    hn::Store(hn::Max(hn::Sub(minus, byY), zero), tag, at + 3 * lanes);  // phiD - pi
  }
}

/// Whether light and view are above the surface. In double precision: only asked where single precision
/// can't tell.
bool aboveSurface(const HalfDiffAngles& a) {
  return std::cos(a.thetaDRad) * std::cos(a.thetaHRad) >=
         std::abs(std::sin(a.thetaDRad) * std::cos(a.phiDRad) * std::sin(a.thetaHRad));
}

void EvaluateNetwork(std::span<const float> weights, std::span<const HalfDiffAngles> angles,
                     std::span<Eigen::Array3f> out) {
  const Tag tag;
  const std::size_t lanes = hn::Lanes(tag);
  HWY_ALIGN Activations hidden0, hidden1;
  HWY_ALIGN float thetaH[kMostLanes], thetaD[kMostLanes], phiD[kMostLanes];
  HWY_ALIGN float channels[Shape::kOutputs][kMostLanes], marginOf[kMostLanes];
  const float* w = weights.data();
  const Vec zero = hn::Zero(tag);

  for (std::size_t start = 0; start < angles.size(); start += lanes) {
    const std::size_t count = std::min(lanes, angles.size() - start);
    for (std::size_t lane = 0; lane < lanes; ++lane) {  // idle lanes repeat the last direction
      const HalfDiffAngles& a = angles[start + std::min(lane, count - 1)];
      thetaH[lane] = static_cast<float>(a.thetaHRad);
      thetaD[lane] = static_cast<float>(a.thetaDRad);
      phiD[lane] = static_cast<float>(a.phiDRad);
    }
    const Vec h = hn::Load(tag, thetaH), d = hn::Load(tag, thetaD), p = hn::Load(tag, phiD);
    const Vec sinH = hn::CallSin(tag, h), cosH = hn::CallCos(tag, h);
    const Vec sinD = hn::CallSin(tag, d), cosD = hn::CallCos(tag, d);
    const Vec x = hn::Mul(sinD, hn::CallCos(tag, p)), y = hn::Mul(sinD, hn::CallSin(tag, p));
    hn::Store(hn::Sub(hn::Mul(cosD, cosH), hn::Abs(hn::Mul(x, sinH))), tag, marginOf);

    firstLayer(w, sinH, cosH, x, y, cosD, hidden0);
    Vec sum[kBlock * kTurns];
    for (int unit = 0; unit < Shape::kHidden; unit += kBlock) {
      weightedSums(w + Shape::kWeights1, w + Shape::kBias1, hidden0, Shape::kHidden, unit, sum);
      for (int i = 0; i < kBlock * kTurns; ++i) {
        hn::Store(hn::Max(sum[i], zero), tag, hidden1 + (unit * kTurns + i) * lanes);
      }
    }
    weightedSums(w + Shape::kWeights2, w + Shape::kBias2, hidden1, Shape::kOutputs, 0, sum);
    const Vec most = hn::Set(tag, 80.0f);  // e^80 is near the largest float; no material comes near
    for (int channel = 0; channel < Shape::kOutputs; ++channel) {
      Vec total = zero;
      for (int turn = 0; turn < kTurns; ++turn) {
        const Vec output = hn::Min(sum[channel * kTurns + turn], most);
        // Below 0 the BRDF is clamped, and clamping the argument says the same.
        total = hn::Add(total, hn::CallExpm1(tag, hn::Max(output, zero)));
      }
      hn::Store(hn::Mul(total, hn::Set(tag, 1.0f / kTurns)), tag, channels[channel]);
    }

    for (std::size_t lane = 0; lane < count; ++lane) {
      constexpr float kCannotTell = 1e-5f;  // a hundred roundings of a cosine
      const bool above =
          std::abs(marginOf[lane]) > kCannotTell ? marginOf[lane] > 0 : aboveSurface(angles[start + lane]);
      if (above) {
        out[start + lane] = {channels[0][lane], channels[1][lane], channels[2][lane]};
      } else {
        out[start + lane].setConstant(std::numeric_limits<float>::quiet_NaN());
      }
    }
  }
}

const char* NeuralTargetName() {
  return hwy::TargetName(HWY_TARGET);
}

}  // namespace patina::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace patina {

HWY_EXPORT(EvaluateNetwork);
HWY_EXPORT(NeuralTargetName);

void evaluateNetwork(std::span<const float> weights, std::span<const HalfDiffAngles> angles,
                     std::span<Eigen::Array3f> out) {
  HWY_DYNAMIC_DISPATCH(EvaluateNetwork)(weights, angles, out);
}

const char* networkTarget() {
  return HWY_DYNAMIC_DISPATCH(NeuralTargetName)();
}

}  // namespace patina
#endif
