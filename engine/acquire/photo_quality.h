#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/acquire/pattern_image.h"
#include "engine/acquire/rig_description.h"
#include "engine/image/image.h"

namespace patina {

enum class PhotoFault { Clipped, Shaken, WrongPattern, BrightnessOff };
/// "clipped", "shaken", "wrong pattern", "brightness off".
std::string faultName(PhotoFault fault);

/// What was seen of one photograph.
struct PhotoQuality {
  double clippedShare = 0;                 ///< of the sample's pixels
  std::optional<double> movedPx;           ///< against the window photograph; empty: nothing would tell
  std::optional<double> brightness;        ///< over what the photographs so far predict; empty: too few yet
  std::optional<double> expectedResidual;  ///< relative RMS of the prediction for the pattern asked for
  std::optional<double> alternativeResidual;  ///< and the smallest for another picture that may still have
                                              ///< been on the glass
  std::string alternative;                    ///< its name
  std::optional<double>
      setBrightness;  ///< of four phases together, with the last of them: over what they must add up to
  std::vector<PhotoFault> faults;
  bool wholeSet = false;  ///< a fault of the four phases together: take all of them again
  std::string sentence;   ///< for the person: what is wrong and how to mend it; empty where nothing is
  bool good() const { return faults.empty(); }
};

struct PhotoQualityLimits {
  double clippedShare = 1e-3;  ///< of the sample's pixels. Higher: more highlights may be lost
  double movedPx = 0.35;       ///< Higher: maps are blurred by so much
  double brightness =
      0.3;  ///< of one photograph, of which little is known beforehand. Higher: coarser slips pass
  double setBrightness = 0.03;  ///< of four phases together. Higher: more drift is let through
};

/// Watches the photographs of one capture.
///
/// One photograph. Each of some hundred places of the sample answers a picture linearly; how is learnt from
/// the photographs that were accepted (weights, not negative, of a Lambertian part and of seven lobes about
/// the mirror direction), and the next photograph is compared with what these say of the picture that it
/// should show, and of those that it might show by mistake: the one before, the other phases, the window,
/// black. Where the sample can't tell two pictures apart, neither is called wrong.
///
/// Four phases. |sin| + |cos| lies between 1 and the root of 2 everywhere: whatever the sample is, its four
/// photographs add up to nearly the window's times 4 / pi. What is missing there is brightness, and a shift
/// of the sum against the window is movement: the patterns' own light hides neither.
///
/// Not thread-safe. Cost: set-up some 0.2 s, a photograph some ten ms.
class PhotoWatch {
 public:
  /// `rig.screen` with the pixels of the screen that is really used.
  PhotoWatch(const RigDescription& rig, const PhotoQualityLimits& limits = {});
  ~PhotoWatch();
  PhotoWatch(PhotoWatch&&) noexcept;

  /// `photo`: linear R G B per second of exposure, black level off; `clipped`: its mask (may be empty).
  /// `before`: what was on the glass before.
  PhotoQuality judge(const Image& photo, const Image& clipped, const PatternSpec& asked,
                     const std::optional<PatternSpec>& before) const;
  /// An accepted photograph: later ones are judged with it. Window and black come first.
  void learn(const Image& photo, const PatternSpec& pattern);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace patina
