#pragma once

namespace patina {

class GuidePanel;
class RigController;

// Who registers which steps; each adds its own in the order in which they are done.

/// Camera; `screen`: and the screen that lights the sample.
void addDeviceSteps(GuidePanel& panel, RigController& rig, bool screen);
/// Checkerboard, mirror, screen response, white paper.
void addFourierCalibrationSteps(GuidePanel& panel, RigController& rig);
/// Checklist and capture.
void addFourierCaptureSteps(GuidePanel& panel, RigController& rig);
/// Checkerboard, plan, white tile, shots.
void addTwoShotSteps(GuidePanel& panel, RigController& rig);

}  // namespace patina
