#include "engine/fourier/node_sum.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/fourier/node_sum.cpp"
#include <hwy/foreach_target.h>
// after foreach_target
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace patina::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void WeightedNodeSum(const float* HWY_RESTRICT table, const float* HWY_RESTRICT weight, std::size_t nodes,
                     std::size_t stride, float* HWY_RESTRICT out) {
  const hn::ScalableTag<float> d;
  const std::size_t lanes = hn::Lanes(d);
  std::size_t i = 0;
  // eight sums at a time, then four, so that one multiply-add need not wait for the last
  for (; i + 8 * lanes <= stride; i += 8 * lanes) {
    auto a = hn::Zero(d), b = a, c = a, e = a, f = a, g = a, h = a, k = a;
    for (std::size_t n = 0; n < nodes; ++n) {
      const auto w = hn::Set(d, weight[n]);
      const float* from = table + n * stride + i;
      a = hn::MulAdd(w, hn::LoadU(d, from), a);
      b = hn::MulAdd(w, hn::LoadU(d, from + lanes), b);
      c = hn::MulAdd(w, hn::LoadU(d, from + 2 * lanes), c);
      e = hn::MulAdd(w, hn::LoadU(d, from + 3 * lanes), e);
      f = hn::MulAdd(w, hn::LoadU(d, from + 4 * lanes), f);
      g = hn::MulAdd(w, hn::LoadU(d, from + 5 * lanes), g);
      h = hn::MulAdd(w, hn::LoadU(d, from + 6 * lanes), h);
      k = hn::MulAdd(w, hn::LoadU(d, from + 7 * lanes), k);
    }
    hn::StoreU(a, d, out + i);
    hn::StoreU(b, d, out + i + lanes);
    hn::StoreU(c, d, out + i + 2 * lanes);
    hn::StoreU(e, d, out + i + 3 * lanes);
    hn::StoreU(f, d, out + i + 4 * lanes);
    hn::StoreU(g, d, out + i + 5 * lanes);
    hn::StoreU(h, d, out + i + 6 * lanes);
    hn::StoreU(k, d, out + i + 7 * lanes);
  }
  for (; i + 4 * lanes <= stride; i += 4 * lanes) {
    auto a = hn::Zero(d), b = a, c = a, e = a;
    for (std::size_t n = 0; n < nodes; ++n) {
      const auto w = hn::Set(d, weight[n]);
      const float* from = table + n * stride + i;
      a = hn::MulAdd(w, hn::LoadU(d, from), a);
      b = hn::MulAdd(w, hn::LoadU(d, from + lanes), b);
      c = hn::MulAdd(w, hn::LoadU(d, from + 2 * lanes), c);
      e = hn::MulAdd(w, hn::LoadU(d, from + 3 * lanes), e);
    }
    hn::StoreU(a, d, out + i);
    hn::StoreU(b, d, out + i + lanes);
    hn::StoreU(c, d, out + i + 2 * lanes);
    hn::StoreU(e, d, out + i + 3 * lanes);
  }
  for (; i + lanes <= stride; i += lanes) {
    auto a = hn::Zero(d);
    for (std::size_t n = 0; n < nodes; ++n)
      a = hn::MulAdd(hn::Set(d, weight[n]), hn::LoadU(d, table + n * stride + i), a);
    hn::StoreU(a, d, out + i);
  }
  for (; i < stride; ++i) {
    float sum = 0;
    for (std::size_t n = 0; n < nodes; ++n) sum += weight[n] * table[n * stride + i];
    out[i] = sum;
  }
}

}  // namespace patina::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace patina {

HWY_EXPORT(WeightedNodeSum);

void weightedNodeSum(const float* table, const float* weight, std::size_t nodes, std::size_t stride,
                     float* out) {
  HWY_DYNAMIC_DISPATCH(WeightedNodeSum)(table, weight, nodes, stride, out);
}

}  // namespace patina
#endif
