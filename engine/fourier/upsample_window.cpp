#include "engine/fourier/upsample_window.h"

#include <algorithm>
#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/fourier/upsample_window.cpp"
#include <hwy/foreach_target.h>
// after foreach_target
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace patina::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, 16>;
using Vec = hn::Vec<Tag>;
constexpr std::size_t kLanes = hn::MaxLanes(Tag()), kVectors = kWindowStride / kLanes;
// Rows at a time, so that their accumulators and a row of the window stay in registers.
constexpr std::size_t kRows = kVectors <= 2 ? 8 : kVectors <= 4 ? 2 : 1;

void Gram(const float* HWY_RESTRICT window, std::size_t dimensions, float* HWY_RESTRICT gram) {
  const Tag tag;
  for (std::size_t first = 0; first < kWindowStride; first += kRows) {
    if (first >= kWindowTexels) {
      std::fill_n(gram + first * kWindowStride, kRows * kWindowStride, 0.0f);
      continue;
    }
    Vec sum[kRows][kVectors];
    for (auto& row : sum)
      for (auto& s : row) s = hn::Zero(tag);
    for (std::size_t d = 0; d < dimensions; ++d) {
      const float* HWY_RESTRICT row = window + d * kWindowStride;
      Vec v[kVectors];
      for (std::size_t k = 0; k < kVectors; ++k) v[k] = hn::LoadU(tag, row + k * kLanes);
      for (std::size_t r = 0; r < kRows; ++r) {
        const Vec factor = hn::Set(tag, row[first + r]);
        for (std::size_t k = 0; k < kVectors; ++k) sum[r][k] = hn::MulAdd(factor, v[k], sum[r][k]);
      }
    }
    for (std::size_t r = 0; r < kRows; ++r)
      for (std::size_t k = 0; k < kVectors; ++k)
        hn::StoreU(sum[r][k], tag, gram + (first + r) * kWindowStride + k * kLanes);
  }
}

void Project(const float* HWY_RESTRICT window, std::size_t dimensions, const float* HWY_RESTRICT vector,
             float* HWY_RESTRICT out) {
  const Tag tag;
  Vec sum[2][kVectors];  // two chains, so that one's latency hides behind the other's
  for (auto& chain : sum)
    for (auto& s : chain) s = hn::Zero(tag);
  for (std::size_t d = 0; d < dimensions; ++d) {
    const Vec factor = hn::Set(tag, vector[d]);
    for (std::size_t k = 0; k < kVectors; ++k)
      sum[d % 2][k] =
          hn::MulAdd(factor, hn::LoadU(tag, window + d * kWindowStride + k * kLanes), sum[d % 2][k]);
  }
  for (std::size_t k = 0; k < kVectors; ++k) hn::StoreU(hn::Add(sum[0][k], sum[1][k]), tag, out + k * kLanes);
}

}  // namespace patina::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace patina {

HWY_EXPORT(Gram);
HWY_EXPORT(Project);

void windowGram(const float* window, std::size_t dimensions, float* gram) {
  HWY_DYNAMIC_DISPATCH(Gram)(window, dimensions, gram);
}
void windowProject(const float* window, std::size_t dimensions, const float* vector, float* out) {
  HWY_DYNAMIC_DISPATCH(Project)(window, dimensions, vector, out);
}

namespace {

/// The unknowns that are free to be positive, and the unconstrained optimum over them.
struct PassiveSet {
  int texel[kWindowTexels];
  int count = 0;

  void remove(int k) {
    for (int i = k; i + 1 < count; ++i) texel[i] = texel[i + 1];
    --count;
  }

  /// By Cholesky's factorisation, in double: columns of like texels are nearly parallel.
  bool solve(const float* gram, const float* b, double* out) const {
    double l[kWindowTexels][kWindowTexels], y[kWindowTexels];
    for (int i = 0; i < count; ++i) {
      const float* row = gram + texel[i] * kWindowStride;
      double right = b[texel[i]];
      for (int j = 0; j <= i; ++j) {
        double sum = row[texel[j]];
        for (int k = 0; k < j; ++k) sum -= l[i][k] * l[j][k];
        if (i == j) {
          if (!(sum > 0)) return false;
          l[i][i] = 1 / std::sqrt(sum);
        } else {
          l[i][j] = sum * l[j][j];
          right -= l[i][j] * y[j];
        }
      }
      y[i] = right * l[i][i];
    }
    for (int i = count - 1; i >= 0; --i) {
      double sum = y[i];
      for (int k = i + 1; k < count; ++k) sum -= l[k][i] * out[k];
      out[i] = sum * l[i][i];
    }
    return true;
  }
};

}  // namespace

bool nonNegativeWeights(const float* gram, const float* b, float significant, float* weights) {
  PassiveSet passive;
  bool isPassive[kWindowTexels] = {};
  for (int k = 0; k < kWindowTexels; ++k) {
    if (!(weights[k] > 0) || !(gram[k * kWindowStride + k] > 0)) {
      weights[k] = 0;
      continue;
    }
    passive.texel[passive.count++] = k;
    isPassive[k] = true;
  }
  // Each round adds one unknown or ends; the search needs no more than a few more than there are unknowns.
  for (int round = 0; round < 2 * kWindowTexels; ++round) {
    double optimum[kWindowTexels];
    while (passive.count > 0) {
      if (!passive.solve(gram, b, optimum)) return false;
      double length = 1;
      for (int i = 0; i < passive.count; ++i) {
        const double here = weights[passive.texel[i]];
        if (optimum[i] <= 0) length = std::min(length, here / std::max(here - optimum[i], 1e-30));
      }
      bool bounded = false;
      for (int i = passive.count - 1; i >= 0; --i) {
        const int k = passive.texel[i];
        const double next = weights[k] + length * (optimum[i] - weights[k]);
        weights[k] = static_cast<float>(std::max(next, 0.0));
        if (optimum[i] > 0 || next > 1e-9) continue;
        weights[k] = 0;
        isPassive[k] = false;
        passive.remove(i);
        bounded = true;
      }
      if (length >= 1) break;
      if (!bounded) return false;
    }
    float residual[kWindowTexels];
    std::copy_n(b, kWindowTexels, residual);
    for (int i = 0; i < passive.count; ++i) {
      const float w = weights[passive.texel[i]];
      const float* row = gram + passive.texel[i] * kWindowStride;
      for (int k = 0; k < kWindowTexels; ++k) residual[k] -= w * row[k];
    }
    int best = -1;
    float gain = significant;
    for (int k = 0; k < kWindowTexels; ++k) {
      const float diagonal = gram[k * kWindowStride + k];
      if (isPassive[k] || !(residual[k] > 0) || !(diagonal > 0)) continue;
      if (residual[k] * residual[k] > gain * diagonal) {
        gain = residual[k] * residual[k] / diagonal;
        best = k;
      }
    }
    if (best < 0) return true;
    passive.texel[passive.count++] = best;
    isPassive[best] = true;
  }
  return false;
}

}  // namespace patina
#endif
