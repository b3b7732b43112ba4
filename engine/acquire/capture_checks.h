#pragma once

#include <string>
#include <vector>

#include "engine/acquire/camera_device.h"
#include "engine/acquire/pattern_display.h"
#include "engine/acquire/rig_description.h"
#include "engine/base/job.h"

namespace patina {

enum class CheckId { Controls, Exposure, Clipping, Ambient, Movement, Focus, Flicker, Lighting, WarmUp };

/// One line of the checklist.
struct CheckItem {
  enum class State { Good, Warning, Bad, NotKnown };
  CheckId id = CheckId::Exposure;
  State state = State::NotKnown;
  double value = 0;      ///< what was measured
  std::string unit;      ///< of it: "% of the sample", "px", "%"
  std::string title;     ///< "Ambient light"
  std::string sentence;  ///< what was found
  std::string tryThis;   ///< how to mend it; empty where it is good
};

struct Checklist {
  std::vector<CheckItem> items;
  double exposureS = 0;  ///< chosen: a whole number of refresh periods; 0: the camera's own
  double gain = 1;
  double brightest = 0;  ///< of the window photograph at that exposure, share of full scale
  bool good() const;     ///< nothing Bad
};

struct CheckOptions {
  double fill = 0.8;         ///< share of full scale that the brightest percentile of the window may reach
  double longestS = 4;       ///< no longer exposure than this
  int flickerFrames = 6;     ///< frames of the window compared for flicker
  double warmUpSeconds = 2;  ///< the window's brightness is compared over this time
};

/// Looks at everything that would spoil a capture, with the screen showing black, the window, flat and fine
/// pictures: exposure (chosen here), clipping, ambient light, movement, focus, flicker, places of the sample
/// that are not lit, warm-up, automatics that can't be switched off. Progress: "check". Errors: those of
/// camera and display.
Result<Checklist> checkRig(CameraDevice& camera, PatternDisplay& display, const RigDescription& rig,
                           const CheckOptions& options, const JobContext& job);

}  // namespace patina
