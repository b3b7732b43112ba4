#include "engine/fourier/solver.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "engine/fourier/frequency_plan.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/fourier/solver.cpp"
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
#include "engine/fourier/site_batch.inc"
#include "engine/fourier/site_system.inc"
#include "engine/fourier/site_uncertainty.inc"

/// (H + lambda diag H) step = -g, by LDL^T on four unknowns.
HWY_INLINE void dampedStep(const Evaluation& e, Lanes lambda, Lanes (&step)[4]) {
  Lanes l[4][4], d[4];
  const Lanes one(1.0f);
  for (int i = 0; i < 4; ++i) {
    Lanes diagonal = e.hessian[kUpper[i][i]] * (one + lambda);
    for (int k = 0; k < i; ++k) diagonal = diagonal - l[i][k] * l[i][k] * d[k];
    d[i] = vmax(diagonal, Lanes(1e-9f));
    for (int j = i + 1; j < 4; ++j) {
      Lanes sum = e.hessian[kUpper[i][j]];
      for (int k = 0; k < i; ++k) sum = sum - l[j][k] * l[i][k] * d[k];
      l[j][i] = sum / d[i];
    }
  }
  Lanes y[4];
  for (int i = 0; i < 4; ++i) {
    y[i] = -e.gradient[i];
    for (int k = 0; k < i; ++k) y[i] = y[i] - l[i][k] * y[k];
  }
  for (int i = 3; i >= 0; --i) {
    step[i] = y[i] / d[i];
    for (int k = i + 1; k < 4; ++k) step[i] = step[i] - l[k][i] * step[k];
  }
}

// Bounds that keep a lane finite; wider than any material or any camera could show.
constexpr float kLogSigmaRange[2] = {-6.5f, 0.7f};
constexpr float kLogKurtosisRange[2] = {-7.0f, 1.6f};
constexpr float kSlopeRange = 1.5f;

// Damping relative to the Gauss-Newton matrix's diagonal: at first, at least, and how fast it grows.
constexpr float kFirstDamping = 1e-3f, kLeastDamping = 1e-6f, kGrowth = 3.0f;

/// A number for one lane at a time.
struct Slots {
  HWY_ALIGN float value[HWY_MAX_BYTES / sizeof(float)] = {};
  Lanes lanes() const { return hn::Load(Tag(), value); }
  void take(Lanes from) { hn::Store(from.v, Tag(), value); }
};

/// A workspace for the calling thread.
float* workspaceFor(const FrequencyPlan& plan) {
  thread_local hwy::AlignedFreeUniquePtr<float[]> workspace;
  thread_local std::size_t held = 0;
  const std::size_t need = Batch::workspaceFloats(plan);
  if (held < need) workspace = hwy::AllocateAligned<float>(need), held = need;
  return workspace.get();
}

void clampStart(const LobeParameters& p, float (&out)[4]) {
  out[0] = std::clamp(p.logSigma, kLogSigmaRange[0], kLogSigmaRange[1]);
  out[1] = std::clamp(p.logKurtosis, kLogKurtosisRange[0], kLogKurtosisRange[1]);
  out[2] = std::clamp(p.slopeX, -kSlopeRange, kSlopeRange);
  out[3] = std::clamp(p.slopeY, -kSlopeRange, kSlopeRange);
}

/// Everything that a lane carries from step to step.
struct Search {
  Theta theta;
  Evaluation current;
  Lanes lambda, growth, iterations;
};

void SolveSites(const SolverSetup& setup, std::span<const SiteData> data,
                std::span<const LobeParameters> start, std::span<SiteSolution> out) {
  if (data.empty()) return;
  const Tag tag;
  const std::size_t lanes = hn::Lanes(tag);
  const FrequencyPlan plan(setup);
  Batch batch(setup, plan, workspaceFor(plan));
  const Lanes zero(0.0f), one(1.0f);
  const Lanes infinite(std::numeric_limits<float>::infinity());
  // What each lane works on; a lane whose site is done takes the next one in the queue.
  std::vector<std::ptrdiff_t> work(lanes, -1);
  std::size_t next = 0;
  Slots active, fresh, begin[4];
  Search search;
  search.theta = {zero, zero, zero, zero};
  search.lambda = search.iterations = zero;
  search.growth = one;
  search.current = {};
  search.current.cost = search.current.dataCost = infinite;
  for (auto& x : search.current.gradient) x = zero;
  for (auto& x : search.current.hessian) x = zero;
  for (int c = 0; c < 3; ++c) search.current.diffuse[c] = search.current.specular[c] = zero;

  auto refill = [&](std::size_t lane) {
    if (next >= data.size()) {
      work[lane] = -1;
      active.value[lane] = fresh.value[lane] = 0;
      return;
    }
    work[lane] = static_cast<std::ptrdiff_t>(next);
    batch.load(lane, data[next]);
    float at[4];
    clampStart(start[next], at);
    for (int i = 0; i < 4; ++i) begin[i].value[lane] = at[i];
    active.value[lane] = fresh.value[lane] = 1;
    ++next;
  };
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    refill(lane);
    if (work[lane] < 0) {  // idle lanes repeat the first site, so that their numbers are ordinary ones
      batch.load(lane, data[0]);
      float at[4];
      clampStart(start[0], at);
      for (int i = 0; i < 4; ++i) begin[i].value[lane] = at[i];
    }
  }
  batch.ready();
  search.theta = {begin[0].lanes(), begin[1].lanes(), begin[2].lanes(), begin[3].lanes()};
  Evaluation trial;
  Lanes step[4];
  for (auto& x : step) x = zero;
  while (true) {
    const Mask isActive = less(zero, active.lanes()), isFresh = less(zero, fresh.lanes());
    if (hn::AllFalse(tag, isActive)) break;
    const Lanes longestSlope = vmax(Lanes(0.04f), Lanes(1.5f) * vexp(search.theta.logSigma));
    const Lanes slopeLength = vsqrt(step[2] * step[2] + step[3] * step[3] + Lanes(1e-20f));
    Lanes scale = vmin(one, longestSlope / slopeLength);
    scale = vmin(scale, Lanes(0.7f) / vmax(Lanes(hn::Abs(step[0].v)), Lanes(1e-6f)));
    scale = vmin(scale, one / vmax(Lanes(hn::Abs(step[1].v)), Lanes(1e-6f)));
    // A fresh lane's first evaluation is at its start.
    auto move = [&](Lanes from, int i, float low, float high) {
      return select(isFresh, begin[i].lanes(), clampTo(from + scale * step[i], low, high));
    };
    const Theta ahead{move(search.theta.logSigma, 0, kLogSigmaRange[0], kLogSigmaRange[1]),
                      move(search.theta.logKurtosis, 1, kLogKurtosisRange[0], kLogKurtosisRange[1]),
                      move(search.theta.slopeX, 2, -kSlopeRange, kSlopeRange),
                      move(search.theta.slopeY, 3, -kSlopeRange, kSlopeRange)};
    // What the linear model promises for the step that is taken: -(2 g.s + s.H s).
    Lanes promised = zero;
    {
      const Lanes taken[4] = {ahead.logSigma - search.theta.logSigma,
                              ahead.logKurtosis - search.theta.logKurtosis,
                              ahead.slopeX - search.theta.slopeX, ahead.slopeY - search.theta.slopeY};
      for (int i = 0; i < 4; ++i) {
        Lanes curved = zero;
        for (int k = 0; k < 4; ++k)
          curved = mulAdd(search.current.hessian[kUpper[std::min(i, k)][std::max(i, k)]], taken[k], curved);
        promised =
            subMul(taken[i], search.current.gradient[i] + search.current.gradient[i] + curved, promised);
      }
    }
    batch.evaluate(ahead, trial);
    const Lanes before = search.current.cost;
    const Mask better = hn::AndNot(isFresh, less(trial.cost, before));  // false for NaN
    const Mask accept = hn::And(hn::Or(better, isFresh), isActive);
    auto take = [&](Lanes& to, Lanes from) { to = select(accept, from, to); };
    take(search.theta.logSigma, ahead.logSigma);
    take(search.theta.logKurtosis, ahead.logKurtosis);
    take(search.theta.slopeX, ahead.slopeX);
    take(search.theta.slopeY, ahead.slopeY);
    take(search.current.cost, trial.cost);
    take(search.current.dataCost, trial.dataCost);
    for (int c = 0; c < 3; ++c) {
      take(search.current.diffuse[c], trial.diffuse[c]);
      take(search.current.specular[c], trial.specular[c]);
    }
    for (int i = 0; i < 4; ++i) take(search.current.gradient[i], trial.gradient[i]);
    for (int i = 0; i < 10; ++i) take(search.current.hessian[i], trial.hessian[i]);
    search.iterations = select(isFresh, one, search.iterations + one);
    // Nielsen's damping: by how far the linear model kept its promise, and ever faster up where no step
    // gains.
    const Lanes ratio = (before - trial.cost) * vinv(vmax(promised, Lanes(1e-20f)));
    const Lanes off = clampTo(ratio + ratio - one, -1.0f, 1.0f);
    const Lanes relaxed =
        vmax(search.lambda * vmax(subMul(off * off, off, one), Lanes(0.1f)), Lanes(kLeastDamping));
    search.lambda =
        select(isFresh, Lanes(kFirstDamping), select(better, relaxed, search.lambda * search.growth));
    search.growth = select(hn::Or(isFresh, better), Lanes(kGrowth), search.growth * Lanes(kGrowth));

    // A lane has converged when an accepted step gained less than `tolerance` of the cost, when no step can
    // gain as much (what the linear model promises without damping: g^T H^-1 g), or when no step gains
    // anything.
    Lanes promise = zero;
    dampedStep(search.current, zero, step);
    for (int i = 0; i < 4; ++i) promise = subMul(search.current.gradient[i], step[i], promise);
    dampedStep(search.current, search.lambda, step);
    const Lanes enough = Lanes(setup.tolerance) * search.current.cost;
    const Mask small = hn::And(better, less(before - trial.cost, enough));
    const Mask settled = less(promise, enough);
    const Mask stuck = less(Lanes(1e5f), search.lambda);
    const Mask finite = less(search.current.cost, infinite);
    const Mask ended = hn::And(isActive, hn::Or(hn::Or(small, stuck), hn::Or(settled, hn::Not(finite))));
    const Mask late =
        hn::And(isActive, less(Lanes(static_cast<float>(setup.maxIterations) + 0.5f), search.iterations));
    const Mask leaving = hn::Or(ended, late);
    fresh.take(zero);
    if (hn::AllFalse(tag, leaving)) continue;

    Slots outcome, cost, dataCost, count, theta[4], albedo[6], covariance[10];
    outcome.take(select(ended, Lanes(2.0f), select(leaving, one, zero)));
    cost.take(search.current.cost), dataCost.take(search.current.dataCost), count.take(search.iterations);
    theta[0].take(search.theta.logSigma), theta[1].take(search.theta.logKurtosis);
    theta[2].take(search.theta.slopeX), theta[3].take(search.theta.slopeY);
    for (int c = 0; c < 3; ++c)
      albedo[c].take(search.current.diffuse[c]), albedo[3 + c].take(search.current.specular[c]);
    Lanes inverse[10];
    invert(search.current.hessian, inverse);
    for (int i = 0; i < 10; ++i) covariance[i].take(inverse[i]);
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      if (!(outcome.value[lane] > 0)) continue;
      SiteSolution& to = out[static_cast<std::size_t>(work[lane])];
      to.lobe = {theta[0].value[lane], theta[1].value[lane], theta[2].value[lane], theta[3].value[lane]};
      to.cost = cost.value[lane];
      to.dataCost = dataCost.value[lane];
      for (int i = 0; i < 10; ++i) to.lobeCovariance[i] = covariance[i].value[lane];
      for (int c = 0; c < 3; ++c)
        to.diffuse[c] = albedo[c].value[lane], to.specular[c] = albedo[3 + c].value[lane];
      to.iterations = static_cast<int>(count.value[lane]);
      to.outcome = !std::isfinite(to.cost)      ? SolveOutcome::Failed
                   : outcome.value[lane] > 1.5f ? SolveOutcome::Converged
                                                : SolveOutcome::IterationLimit;
      refill(lane);
    }
    batch.ready();
  }
}

/// Loads up to `lanes` sites, the last one repeated in idle lanes.
void loadAll(Batch& batch, std::span<const SiteData> data) {
  for (std::size_t lane = 0; lane < hn::Lanes(Tag()); ++lane)
    batch.load(lane, data[std::min(lane, data.size() - 1)]);
  batch.ready();
}

template <typename Of>
Theta gatherTheta(std::size_t count, Of lobeOf) {
  Slots slots[4];
  for (std::size_t lane = 0; lane < hn::Lanes(Tag()); ++lane) {
    float at[4];
    clampStart(lobeOf(std::min(lane, count - 1)), at);
    for (int i = 0; i < 4; ++i) slots[i].value[lane] = at[i];
  }
  return {slots[0].lanes(), slots[1].lanes(), slots[2].lanes(), slots[3].lanes()};
}

void RefitAlbedos(const SolverSetup& setup, std::span<const SiteData> data, std::span<SiteSolution> fitted) {
  const std::size_t lanes = hn::Lanes(Tag());
  const FrequencyPlan plan(setup);
  Batch batch(setup, plan, workspaceFor(plan));
  for (std::size_t first = 0; first < data.size(); first += lanes) {
    const std::size_t count = std::min(lanes, data.size() - first);
    loadAll(batch, data.subspan(first, count));
    const auto part = fitted.subspan(first, count);
    Evaluation at;
    batch.evaluate(gatherTheta(count, [&](std::size_t i) { return part[i].lobe; }), at);
    Lanes known[10], diffuseVariance[3], specularVariance[3];
    for (int i = 0; i < 10; ++i) {
      Slots entry;
      for (std::size_t lane = 0; lane < lanes; ++lane)
        entry.value[lane] = part[std::min(lane, count - 1)].lobeCovariance[i];
      known[i] = entry.lanes();
    }
    batch.uncertainty(at, known, diffuseVariance, specularVariance);
    Slots slots[4];
    slots[0].take(at.dataCost);
    for (std::size_t i = 0; i < count; ++i) {
      part[i].dataCost = slots[0].value[i];
    }
    for (int c = 0; c < 3; ++c) {
      slots[0].take(at.diffuse[c]);
      slots[1].take(at.specular[c]);
      slots[2].take(vsqrt(vmax(diffuseVariance[c], Lanes(0.0f))));
      slots[3].take(vsqrt(vmax(specularVariance[c], Lanes(0.0f))));
      for (std::size_t i = 0; i < count; ++i) {
        if (!std::isfinite(slots[0].value[i]) || !std::isfinite(slots[1].value[i])) continue;
        part[i].diffuse[c] = slots[0].value[i];
        part[i].specular[c] = slots[1].value[i];
        part[i].diffuseSd[c] = slots[2].value[i];
        part[i].specularSd[c] = slots[3].value[i];
      }
    }
  }
}

CostAndGradient EvaluateSite(const SolverSetup& setup, const SiteData& data, const LobeParameters& at) {
  const FrequencyPlan plan(setup);
  Batch batch(setup, plan, workspaceFor(plan));
  loadAll(batch, {&data, 1});
  Evaluation e;
  batch.evaluate(gatherTheta(1, [&](std::size_t) { return at; }), e);
  CostAndGradient out;
  out.cost = hn::GetLane(e.cost.v);
  for (int i = 0; i < 4; ++i) out.gradient[i] = hn::GetLane(e.gradient[i].v);
  return out;
}

void ModelColumns(const SolverSetup& setup, std::span<const SiteData> data,
                  std::span<const LobeParameters> at, float* out) {
  const std::size_t lanes = hn::Lanes(Tag()), rows = 2 * setup.frequency.size() + 1;
  const FrequencyPlan plan(setup);
  Batch batch(setup, plan, workspaceFor(plan));
  for (std::size_t first = 0; first < data.size(); first += lanes) {
    const std::size_t count = std::min(lanes, data.size() - first);
    loadAll(batch, data.subspan(first, count));
    batch.columnsOf(gatherTheta(count, [&](std::size_t i) { return at[first + i]; }), count,
                    out + first * rows * kModelColumns);
  }
}

int LaneCount() {
  return static_cast<int>(hn::Lanes(Tag()));
}
const char* TargetName() {
  return hwy::TargetName(HWY_TARGET);
}

}  // namespace patina::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace patina {

HWY_EXPORT(SolveSites);
HWY_EXPORT(EvaluateSite);
HWY_EXPORT(ModelColumns);
HWY_EXPORT(RefitAlbedos);
HWY_EXPORT(LaneCount);
HWY_EXPORT(TargetName);

void solveSites(const SolverSetup& setup, std::span<const SiteData> data,
                std::span<const LobeParameters> start, std::span<SiteSolution> out) {
  HWY_DYNAMIC_DISPATCH(SolveSites)(setup, data, start, out);
}
void refitAlbedos(const SolverSetup& setup, std::span<const SiteData> data, std::span<SiteSolution> fitted) {
  HWY_DYNAMIC_DISPATCH(RefitAlbedos)(setup, data, fitted);
}
CostAndGradient evaluateSite(const SolverSetup& setup, const SiteData& data, const LobeParameters& at) {
  return HWY_DYNAMIC_DISPATCH(EvaluateSite)(setup, data, at);
}
void modelColumns(const SolverSetup& setup, std::span<const SiteData> data,
                  std::span<const LobeParameters> at, float* out) {
  HWY_DYNAMIC_DISPATCH(ModelColumns)(setup, data, at, out);
}
int solverLanes() {
  return HWY_DYNAMIC_DISPATCH(LaneCount)();
}
const char* solverTarget() {
  return HWY_DYNAMIC_DISPATCH(TargetName)();
}

}  // namespace patina
#endif
