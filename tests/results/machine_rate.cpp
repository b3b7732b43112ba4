#include "tests/results/machine_rate.h"

#include <time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <thread>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/results/machine_rate.cpp"
#include <hwy/foreach_target.h>
// after foreach_target
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace patina::test::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Independent chains: a unit starts two multiply-adds a cycle and each takes four or five, so that ten would
/// do; twelve fit into the sixteen registers of the older instruction sets.
constexpr int kChains = 12;

/// `rounds` multiply-adds in each lane of each chain; returns a number so that nothing is optimised away.
HWY_NOINLINE float Spin(std::size_t rounds) {
  const hn::ScalableTag<float> tag;
  const auto factor = hn::Set(tag, 0.999999f), term = hn::Set(tag, 1e-6f);
  // Each from another number: a compiler sees that equal chains are one.
  const auto from = [&](int chain) { return hn::Set(tag, 1.0f + 0.125f * static_cast<float>(chain)); };
  auto a = from(0), b = from(1), c = from(2), d = from(3), e = from(4), f = from(5), g = from(6), h = from(7),
       i = from(8), j = from(9), k = from(10), l = from(11);
  for (std::size_t r = 0; r < rounds; ++r) {
    a = hn::MulAdd(a, factor, term), b = hn::MulAdd(b, factor, term), c = hn::MulAdd(c, factor, term);
    d = hn::MulAdd(d, factor, term), e = hn::MulAdd(e, factor, term), f = hn::MulAdd(f, factor, term);
    g = hn::MulAdd(g, factor, term), h = hn::MulAdd(h, factor, term), i = hn::MulAdd(i, factor, term);
    j = hn::MulAdd(j, factor, term), k = hn::MulAdd(k, factor, term), l = hn::MulAdd(l, factor, term);
  }
  auto sum = hn::Add(hn::Add(hn::Add(a, b), hn::Add(c, d)), hn::Add(hn::Add(e, f), hn::Add(g, h)));
  sum = hn::Add(sum, hn::Add(hn::Add(i, j), hn::Add(k, l)));
  return hn::GetLane(hn::SumOfLanes(tag, sum));
}

int LaneCount() {
  return static_cast<int>(hn::Lanes(hn::ScalableTag<float>()));
}
const char* TargetName() {
  return hwy::TargetName(HWY_TARGET);
}

}  // namespace patina::test::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace patina::test {

HWY_EXPORT(Spin);
HWY_EXPORT(LaneCount);
HWY_EXPORT(TargetName);

namespace {

constexpr int kChainCount = 12;

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Runs `work(thread)` on so many threads, all at once; seconds from the first start to the last end.
template <typename Work>
double together(int threads, const Work& work) {
  const double start = now();
  std::vector<std::jthread> others;
  for (int t = 1; t < threads; ++t) others.emplace_back([&, t] { work(t); });
  work(0);
  others.clear();
  return now() - start;
}

std::atomic<float> sink{0};

/// Processor time of the calling thread: others on the machine don't count.
double threadSeconds() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Of all threads together; the median of several runs.
double multiplyAdds(int threads) {
  constexpr int kRuns = 15;
  std::vector<double> rates;
  for (int run = 0; run < kRuns; ++run) {
    std::vector<double> rate(static_cast<std::size_t>(threads));
    together(threads, [&](int t) { rate[static_cast<std::size_t>(t)] = multiplyAddRate(); });
    rates.push_back(threads * *std::ranges::min_element(rate));
  }
  std::ranges::nth_element(rates, rates.begin() + kRuns / 2);
  return rates[kRuns / 2];
}

double memoryBytes(int threads) {
  constexpr std::size_t kFloats = std::size_t{48} << 20;  // 192 MiB an array
  std::vector<float> from(kFloats, 1.0f), to(kFloats, 0.0f);
  double best = 0;
  for (int attempt = 0; attempt < 3; ++attempt) {
    const double seconds = together(threads, [&](int t) {
      const std::size_t begin = kFloats * t / threads, end = kFloats * (t + 1) / threads;
      float *a = to.data(), *b = from.data();
      for (std::size_t i = begin; i < end; ++i) a[i] += 0.5f * b[i];
    });
    best = std::max(best, 3.0 * sizeof(float) * kFloats / seconds);
  }
  sink = sink + to[kFloats / 2];
  return best;
}

}  // namespace

double multiplyAddRate() {
  constexpr std::size_t kRounds = 4'000'000;
  const double start = threadSeconds();
  sink = sink + HWY_DYNAMIC_DISPATCH(Spin)(kRounds);
  return static_cast<double>(kRounds) * kChainCount * HWY_DYNAMIC_DISPATCH(LaneCount)() /
         (threadSeconds() - start);
}

MachineRate measureMachine(int threads) {
  MachineRate rate;
  rate.lanes = HWY_DYNAMIC_DISPATCH(LaneCount)();
  rate.instructions = HWY_DYNAMIC_DISPATCH(TargetName)();
  rate.multiplyAddsPerSecond = multiplyAdds(1);
  rate.allCoresMultiplyAddsPerSecond = multiplyAdds(threads);
  rate.bytesPerSecond = memoryBytes(threads);
  return rate;
}

}  // namespace patina::test
#endif
