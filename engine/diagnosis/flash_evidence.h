#pragma once

#include <vector>

#include "engine/diagnosis/explanation.h"
#include "engine/diagnosis/flash_trials.h"

namespace patina {

/// The residual's shares by photograph, channel, image radius, distance from the highlight and brightness:
/// mean square in units of the sensor's noise, fitted photographs and held-out ones together.
std::vector<ResidualBreakdown> flashBreakdowns(const FlashTrial& trial, const JointState& before,
                                               const JointState& after);
/// What was seen over what the model predicted without an effect, along the quantity that the effect acts by,
/// and what it predicts with it.
SignaturePlot flashPlot(FlashEffect effect, const FlashTrial& trial, const JointState& without,
                        const JointState& with);
/// Mean square residual in units of noise over the sample's rectangle, one channel.
Image flashPlaces(const FlashTrial& trial, const JointState& state);
/// A few photographs beside their predictions, no wider than `side`, worst first, held-out ones before fitted
/// ones; and every photograph's figures.
Status addFlashPhotos(Explanation& explanation, const FlashFit& before, const FlashFit& after, int pictures,
                      int side, const JobContext& job);

}  // namespace patina
