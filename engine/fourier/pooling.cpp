#include "engine/fourier/pooling.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/fourier/pooling.cpp"
#include <hwy/foreach_target.h>
// after foreach_target
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace patina::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void SquaredGaps(const float* HWY_RESTRICT a, const float* HWY_RESTRICT b, std::size_t count,
                 float* HWY_RESTRICT out) {
  const hn::ScalableTag<float> d;
  constexpr std::size_t lanes = hn::MaxLanes(hn::ScalableTag<float>());
  // Three vectors hold every channel in the same lanes again.
  auto x = hn::Zero(d), y = x, z = x;
  std::size_t i = 0;
  for (; i + 3 * lanes <= count; i += 3 * lanes) {
    const auto gapX = hn::Sub(hn::LoadU(d, a + i), hn::LoadU(d, b + i));
    const auto gapY = hn::Sub(hn::LoadU(d, a + i + lanes), hn::LoadU(d, b + i + lanes));
    const auto gapZ = hn::Sub(hn::LoadU(d, a + i + 2 * lanes), hn::LoadU(d, b + i + 2 * lanes));
    x = hn::MulAdd(gapX, gapX, x);
    y = hn::MulAdd(gapY, gapY, y);
    z = hn::MulAdd(gapZ, gapZ, z);
  }
  HWY_ALIGN float sums[3 * lanes];
  hn::Store(x, d, sums);
  hn::Store(y, d, sums + lanes);
  hn::Store(z, d, sums + 2 * lanes);
  // halves of whole channels' triples, as long as there are two
  for (std::size_t half = 3 * lanes / 2; half >= 3; half /= 2)
    for (std::size_t k = 0; k < half; ++k) sums[k] += sums[k + half];
  for (; i < count; ++i) sums[i % 3] += (a[i] - b[i]) * (a[i] - b[i]);
  for (std::size_t c = 0; c < 3; ++c) out[c] = sums[c];
}

void AddScaled(float weight, const float* HWY_RESTRICT from, std::size_t count, float* HWY_RESTRICT to) {
  const hn::ScalableTag<float> d;
  const std::size_t lanes = hn::Lanes(d);
  const auto w = hn::Set(d, weight);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes)
    hn::StoreU(hn::MulAdd(w, hn::LoadU(d, from + i), hn::LoadU(d, to + i)), d, to + i);
  for (; i < count; ++i) to[i] += weight * from[i];
}

}  // namespace patina::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace patina {

HWY_EXPORT(SquaredGaps);
HWY_EXPORT(AddScaled);

void squaredGaps(const float* a, const float* b, std::size_t count, float (&out)[3]) {
  HWY_DYNAMIC_DISPATCH(SquaredGaps)(a, b, count, out);
}
void addScaled(float weight, const float* from, std::size_t count, float* to) {
  HWY_DYNAMIC_DISPATCH(AddScaled)(weight, from, count, to);
}

}  // namespace patina
#endif
