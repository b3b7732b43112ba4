// The guided Fourier capture: checklist, then the sequence.
#include "app/window/rig/rig_steps.h"

namespace patina {

void addFourierCaptureSteps(GuidePanel&, RigController&) {}

}  // namespace patina
