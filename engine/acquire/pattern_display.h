#pragma once

#include <chrono>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "engine/acquire/frame.h"
#include "engine/acquire/pattern_image.h"
#include "engine/base/result.h"

namespace patina {

/// A screen that can show patterns, in physical pixels.
struct ScreenInfo {
  std::string id;    ///< "HDMI-1", "simulated"
  std::string name;  ///< for a person: maker and model, place in the arrangement
  int widthPx = 0, heightPx = 0;
  double widthMm = 0, heightMm = 0;   ///< of the lit area, from EDID; 0: not said
  double refreshHz = 0;               ///< 0: not said
  std::vector<std::string> warnings;  ///< night light, HDR, a colour profile, a fractional scale: sentences
};

/// When a picture is known to be on the glass.
struct OnGlass {
  RigTime swapped{};  ///< the frame that holds it was handed over and shown
  RigTime since{};    ///< swapped, plus the measured latency: every pixel shows it from now on
};

/// Sees what a display shows, as a camera before it would: the simulated rig does.
class GlassObserver {
 public:
  virtual ~GlassObserver() = default;
  /// Pixel for pixel what the screen `screenId` was given, from the time of the swap on. Called on the
  /// display's thread; must be quick.
  virtual void glassShows(const std::string& screenId, const ShownPicture& picture, RigTime swapped) = 0;
  /// The clock that swaps are told in and that the display waits in: real time, unless what looks is a
  /// simulation with a clock of its own. Any thread.
  virtual RigTime now() const { return std::chrono::steady_clock::now(); }
  /// False where stopped.
  virtual bool waitUntil(RigTime when, const std::stop_token& stop);
};

/// A screen in use: pictures full-screen, not resampled, no cursor, no blanking. Implemented by the window
/// (a window on that monitor) and by the simulated rig (no window). Threading: `show` is called from a job's
/// thread and blocks it; implementations hand over to their own.
class PatternDisplay {
 public:
  virtual ~PatternDisplay() = default;
  virtual ScreenInfo screen() const = 0;
  /// Shows a picture of the screen's own size in pixels and returns when it is known to be on the glass: the
  /// swap was confirmed, and the latency has passed since. Errors: Refused (the person left with Esc, the
  /// monitor is gone or changed its mode), Invalid (a picture of another size), Cancelled.
  virtual Result<OnGlass> show(const ShownPicture& picture, const std::stop_token& stop) = 0;
  /// From swap to light, measured (`measureLatency`) or guessed.
  virtual void setLatency(std::chrono::microseconds latency) = 0;
  virtual std::chrono::microseconds latency() const = 0;
  /// Waits in the display's clock: real time, or the simulated rig's. False where stopped.
  virtual bool wait(std::chrono::microseconds time, const std::stop_token& stop) = 0;
};

}  // namespace patina
