// The guided Fourier capture: checklist, then the sequence.
#include "app/window/rig/fourier_capture_step.h"
#include "app/window/rig/rig_steps.h"
#include "widgets/guide_panel.h"

namespace patina {

void addFourierCaptureSteps(GuidePanel& panel, RigController& rig) {
  auto* checklist = new ChecklistStep(rig);
  panel.addStep(checklist);
  panel.addStep(new FourierCaptureStep(rig, *checklist));
}

}  // namespace patina
