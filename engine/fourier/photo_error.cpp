#include <tbb/parallel_for.h>

#include <atomic>
#include <cmath>
#include <vector>

#include "engine/fourier/fit_state.h"
#include "engine/fourier/photo_prediction.h"
#include "engine/fourier/site_correction.h"

namespace patina {

Result<PhotoError> photoError(FourierFitState& state, bool holdout, const JobContext& job,
                              const MeasurementStorage& storage) {
  FourierMeasurements& m = state.measurements;
  if (holdout && m.heldOut.empty()) {
    const Status read = measureHeldOut(state.capture, m, job, storage, state.options.corrections.get());
    if (!read) return read.error();
  }
  const MeasurementStore& store = holdout ? m.heldOut : m.store;
  const std::vector<FrequencyGroup>& groups = holdout ? m.plan.heldOut : m.plan.fitted;
  PhotoPrediction prediction(state.frame, {state.capture.sampleWidthMm, state.capture.sampleHeightMm}, groups,
                             state.options.lobe, state.diffuseMethod(), m.noise, state.shape);
  prediction.variant = state.lobeVariant();
  // Errors stay those of the photographs as they were taken, whatever was corrected in them.
  const FourierCorrections none;
  const FourierCorrections& corrections = state.options.corrections ? *state.options.corrections : none;
  const PhotoCorrection recorded(corrections, state.capture);
  if (recorded.active()) prediction.compareRecorded(recorded, m.plan.window);
  const SiteCorrection correction(corrections, recorded, groups, holdout);
  constexpr std::size_t kChunk = 1024;  // sites a task: a millisecond, so that a stop is seen soon
  const std::size_t count = m.sites.size(), chunks = (count + kChunk - 1) / kChunk;
  std::vector<PredictionSums> sums(chunks);  // added up in order: the same figure for any number of threads
  std::atomic<std::int64_t> done{0};
  tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t chunk) {
    if (job.cancelled()) return;
    const std::size_t first = chunk * kChunk, end = std::min(count, first + kChunk);
    const SiteBlock block = store.block(first, end - first);
    std::vector<PredictionSite> sites, noWindow;
    std::vector<SiteCorrection::Extra> extras(corrections.extra ? end - first : 0);
    for (std::size_t s = first; s < end; ++s) {
      const TexelStatus status = state.siteStatus[s];
      if (status == TexelStatus::Failed || status == TexelStatus::Cancelled || status == TexelStatus::Clipped)
        continue;
      const bool window = !holdout && !m.windowClipped(s);
      (window || holdout ? sites : noWindow)
          .push_back({.geometry = state.geometry(s),
                      .pointMm = m.sites.pointMm[s],
                      .parameters = &state.sites[s],
                      .z = block.z(s),
                      .even = block.even(s),
                      .black = m.black.data() + s * 3,
                      .window = window ? m.window.data() + s * 3 : nullptr,
                      .pixelCount = static_cast<float>(m.sites.pixelCount[s]),
                      .droppedRows = store.droppedRows(s)});
      PredictionSite& site = (window || holdout ? sites : noWindow).back();
      if (prediction.hasRest)
        site.restMm = static_cast<float>(state.diffuse->restMm(m.sites.pointMm[s].cast<double>()));
      if (!extras.empty()) {
        SiteCorrection::Extra& extra = extras[s - first];
        correction.extraAt(s, extra);
        site.extraZ = extra.z.data();
        site.extraEven = extra.even.data();
        site.extraWindow = extra.window;
      }
    }
    sums[chunk] += prediction.compare(sites);
    sums[chunk] += prediction.compare(noWindow);
    done += static_cast<std::int64_t>(end - first);
    job.progress(holdout ? "holdout" : "predict", done, static_cast<std::int64_t>(count), "texels");
  });
  if (job.cancelled()) {
    if (holdout) m.heldOut = {};
    return Error{ErrorCode::Cancelled, "cancelled while predicting photographs", "", ""};
  }
  if (const auto failure = store.failure()) return *failure;
  PredictionSums all;
  for (const auto& part : sums) all += part;
  if (!(all.signal > 0)) return PhotoError{};
  return PhotoError{std::sqrt(all.error / all.signal), std::sqrt(all.noise / all.signal)};
}

}  // namespace patina
