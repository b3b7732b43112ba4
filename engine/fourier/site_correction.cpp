#include "engine/fourier/site_correction.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <mutex>
#include <optional>

namespace patina {

SiteCorrection::SiteCorrection(const FourierCorrections& corrections, const PhotoCorrection& photos,
                               const std::vector<FrequencyGroup>& groups, bool heldOut)
    : corrections_(corrections), photos_(photos), groups_(groups), heldOut_(heldOut) {}

void SiteCorrection::extraAt(std::size_t site, Extra& out) const {
  out.z.assign(groups_.size() * 6, 0.0f);
  out.even.assign(groups_.size() * 6, 0.0f);
  std::fill_n(out.window, 3, 0.0f);
  if (corrections_.extra) corrections_.extra(site, heldOut_, out.z.data(), out.even.data(), out.window);
}

void SiteCorrection::apply(std::size_t site, float* z, float* even, const float* black, float* window,
                           int windowPhoto) const {
  if (photos_.hasGain()) {
    for (std::size_t f = 0; f < groups_.size(); ++f) {
      float share[4];
      for (std::size_t k = 0; k < 4; ++k) share[k] = photos_.blackShare(groups_[f].photo[k]);
      for (std::size_t c = 0; c < 3; ++c) {
        z[f * 6 + c] += black[c] * (share[1] - share[3]);
        z[f * 6 + 3 + c] += black[c] * (share[2] - share[0]);
        even[f * 6 + c] += black[c] * (share[0] + share[2]);
        even[f * 6 + 3 + c] += black[c] * (share[1] + share[3]);
      }
    }
    if (window)
      for (int c = 0; c < 3; ++c) window[c] += black[c] * photos_.blackShare(windowPhoto);
  }
  if (!corrections_.extra) return;
  thread_local Extra extra;
  extraAt(site, extra);
  for (std::size_t i = 0; i < groups_.size() * 6; ++i) z[i] -= extra.z[i], even[i] -= extra.even[i];
  if (window)
    for (int c = 0; c < 3; ++c) window[c] -= extra.window[c];
}

Status changeStore(MeasurementStore& store, const JobContext& job,
                   const std::function<void(SiteRun run, float* z, float* even)>& change) {
  constexpr std::size_t kChunk = 256;  // sites a task: their records stay in the processor's cache
  const std::size_t count = store.siteCount(), stride = static_cast<std::size_t>(store.frequencyCount()) * 6;
  std::mutex mutex;
  std::optional<Error> failure;
  tbb::parallel_for(std::size_t{0}, (count + kChunk - 1) / kChunk, [&](std::size_t chunk) {
    if (job.cancelled()) return;
    const SiteRun run{chunk * kChunk, std::min(kChunk, count - chunk * kChunk)};
    if (store.inMemory()) {
      change(run, store.zInMemory() + run.first * stride, store.evenInMemory() + run.first * stride);
      return;
    }
    const std::size_t floats = run.count * stride;
    std::vector<float> records(2 * floats);
    const SiteBlock before = store.block(run);
    std::copy_n(before.z(run.first), floats, records.data());
    std::copy_n(before.even(run.first), floats, records.data() + floats);
    change(run, records.data(), records.data() + floats);
    const Status written =
        store.write(run, std::span(records).first(floats), std::span(records).last(floats));
    if (written) return;
    std::scoped_lock lock(mutex);
    if (!failure) failure = written.error();
  });
  if (failure) return *failure;
  if (const auto unread = store.failure()) return *unread;
  if (job.cancelled())
    return Error{ErrorCode::Cancelled, "the fit was cancelled while correcting measurements", "", ""};
  return Done{};
}

}  // namespace patina
