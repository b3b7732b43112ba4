#pragma once

#include <functional>
#include <vector>

#include "engine/base/job.h"
#include "engine/fourier/measurements.h"
#include "engine/fourier/photo_correction.h"

namespace patina {

/// The part of FourierCorrections that acts on a site's measurements once photographs are reduced to them:
/// what black keeps of the photographs' gains, and `extra`.
class SiteCorrection {
 public:
  /// `groups` are plan.fitted, or plan.heldOut. Keeps references to all three.
  SiteCorrection(const FourierCorrections& corrections, const PhotoCorrection& photos,
                 const std::vector<FrequencyGroup>& groups, bool heldOut);
  bool active() const { return photos_.hasGain() || corrections_.extra; }

  /// Corrects a site's records in place. `black`: R G B, corrected. `window`: R G B of the window photograph
  /// (index `windowPhoto`), may be null. Thread-safe as far as `extra` is.
  void apply(std::size_t site, float* z, float* even, const float* black, float* window,
             int windowPhoto) const;

  /// What `extra` adds to a site: z and even as in SiteBlock, window R G B. All zero where there is nothing.
  struct Extra {
    std::vector<float> z, even;
    float window[3] = {0, 0, 0};
  };
  void extraAt(std::size_t site, Extra& out) const;

 private:
  const FourierCorrections& corrections_;
  const PhotoCorrection& photos_;
  const std::vector<FrequencyGroup>& groups_;
  bool heldOut_;
};

/// Calls `change` with runs of a store's records, [site][frequency][6] each, and keeps what it leaves there;
/// in parallel, in memory or on disk. Errors: WriteFailed; Cancelled.
Status changeStore(MeasurementStore& store, const JobContext& job,
                   const std::function<void(SiteRun run, float* z, float* even)>& change);

}  // namespace patina
