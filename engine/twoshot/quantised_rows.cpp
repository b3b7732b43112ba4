#include "engine/twoshot/quantised_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/twoshot/quantised_rows.cpp"
#include <hwy/foreach_target.h>  // includes this file once for every instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace patina::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::ScalableTag<float>;

// One vector of components as floats.
HWY_INLINE hn::Vec<Floats> load(const std::int16_t* from) {
  const hn::Rebind<std::int16_t, Floats> narrow;
  const hn::Rebind<std::int32_t, Floats> wide;
  return hn::ConvertTo(Floats(), hn::PromoteTo(wide, hn::LoadU(narrow, from)));
}

void DecodeComponents(const std::int16_t* HWY_RESTRICT from, std::size_t count, float* HWY_RESTRICT to) {
  const Floats d;
  const std::size_t lanes = hn::Lanes(d);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) hn::StoreU(load(from + i), d, to + i);
  for (; i < count; ++i) to[i] = static_cast<float>(from[i]);
}

void AddComponents(float weight, const std::int16_t* HWY_RESTRICT row, std::size_t count,
                   float* HWY_RESTRICT sum) {
  const Floats d;
  const std::size_t lanes = hn::Lanes(d);
  const auto w = hn::Set(d, weight);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    hn::StoreU(hn::MulAdd(w, load(row + i), hn::LoadU(d, sum + i)), d, sum + i);
  }
  for (; i < count; ++i) sum[i] += weight * static_cast<float>(row[i]);
}

float WeightedSquares(const float* HWY_RESTRICT row, const float* HWY_RESTRICT weights, std::size_t count) {
  const Floats d;
  const std::size_t lanes = hn::Lanes(d);
  auto sums = hn::Zero(d);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    const auto value = hn::LoadU(d, row + i);
    sums = hn::MulAdd(hn::Mul(value, value), hn::LoadU(d, weights + i), sums);
  }
  float sum = hn::GetLane(hn::SumOfLanes(d, sums));
  for (; i < count; ++i) sum += weights[i] * row[i] * row[i];
  return sum;
}

}  // namespace patina::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace patina {

HWY_EXPORT(DecodeComponents);
HWY_EXPORT(AddComponents);
HWY_EXPORT(WeightedSquares);

void decodeComponents(const std::int16_t* from, std::size_t count, float* to) {
  HWY_DYNAMIC_DISPATCH(DecodeComponents)(from, count, to);
}
void addComponents(float weight, const std::int16_t* row, std::size_t count, float* sum) {
  HWY_DYNAMIC_DISPATCH(AddComponents)(weight, row, count, sum);
}
float weightedSquares(const float* row, const float* weights, std::size_t count) {
  return HWY_DYNAMIC_DISPATCH(WeightedSquares)(row, weights, count);
}

}  // namespace patina
#endif
