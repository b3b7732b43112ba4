#pragma once

#include <memory>

#include "engine/acquire/pose_source.h"
#include "engine/calibration/screen_pose.h"

namespace patina {

/// A board of markers on the sample plane as a pose source: ChArUco, of which the sample may hide the middle.
/// `lens`: calibrated; its pose is not read. `markers`: where the board lies, in the world.
/// `sampleHeightMm`: of the sample's surface over the board's print; the world's z = 0 is on the sample.
/// Each pose costs a detection, 20 to 60 ms a megapixel.
std::unique_ptr<PoseSource> boardPoseSource(const Camera& lens, const PlacedBoard& markers,
                                            double sampleHeightMm = 0);

/// The same from corners that were found already. Errors: as `poseOfBoard`; NotFound
/// where no pose explains the corners to 2 pixels.
Result<PoseEstimate> poseFromMarkers(const Camera& lens, const PlacedBoard& markers, double sampleHeightMm,
                                     const BoardView& view);

/// A board to lie round a sample of that radius: squares enough that two rings of them stay in sight.
Board boardRoundSample(double radiusMm);

}  // namespace patina
