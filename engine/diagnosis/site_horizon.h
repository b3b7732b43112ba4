#pragma once

#include "engine/base/job.h"
#include "engine/diagnosis/fourier_columns.h"

namespace patina {

/// Chi-square that a horizon must take off a site to be believed: five for its own number, and what trying
/// several elevations finds in noise (the largest of a handful of chi-squares).
inline constexpr double kHorizonGain = 15;

/// Looks for the horizon that each site sees over its own relief: the elevation below which no light comes.
/// At none of it the derivative is nothing, so elevations from 20 to 64 degrees are tried, the site's other
/// parameters started from where they are and from a well-predicted site of the same material nearby (a lobe
/// that was cut has drawn the normal away); the best becomes the site's own and is free afterwards. Sites
/// that have one start from it. Sites of which photographs are predicted to their noise are left alone.
/// `seeds`: sites whose horizons are known; the nearest one's is tried instead of the elevations, which is
/// ten times quicker. Returns how many have one. Parallel.
std::size_t findHorizons(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const JobContext& job,
                         const std::vector<DiagnosisSite>* seeds = nullptr);

}  // namespace patina
