// The first steps of every guided capture: which camera, which screen.
#include "app/window/rig/camera_step.h"
#include "app/window/rig/rig_steps.h"
#include "app/window/rig/screen_step.h"
#include "widgets/guide_panel.h"

namespace patina {

void addDeviceSteps(GuidePanel& panel, RigController& rig, bool screen) {
  panel.addStep(new CameraStep(rig));
  if (screen) panel.addStep(new ScreenStep(rig));
}

}  // namespace patina
