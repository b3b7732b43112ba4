// The first steps of every guided capture: which camera, which screen.
#include "app/window/rig/rig_steps.h"

namespace patina {

void addDeviceSteps(GuidePanel&, RigController&, bool) {}

}  // namespace patina
