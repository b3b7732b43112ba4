// The guided calibration of a rig, and the guided two-shot capture.
#include "app/window/rig/rig_steps.h"

namespace patina {

void addFourierCalibrationSteps(GuidePanel&, RigController&) {}

void addTwoShotSteps(GuidePanel&, RigController&) {}

}  // namespace patina
