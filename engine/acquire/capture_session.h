#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "engine/acquire/camera_device.h"
#include "engine/acquire/capture_checks.h"
#include "engine/acquire/capture_plan.h"
#include "engine/acquire/pattern_display.h"
#include "engine/acquire/photo_quality.h"
#include "engine/acquire/rig_description.h"
#include "engine/base/job.h"
#include "engine/base/result.h"

namespace patina {

struct CaptureOptions {
  CapturePlanOptions plan;
  PhotoQualityLimits limits;
  CheckOptions checks;
  bool check = true;     ///< the checklist before the first photograph
  double exposureS = 0;  ///< 0: chosen by the checklist
  double gain = 1;
  int framesAveraged = 1;  ///< frames a photograph. More: less noise, longer
  int bracket = 1;         ///< exposures a photograph, each a fourth of the one before, merged. 1: none
  int attempts = 3;        ///< of a photograph that isn't good, before it is kept with its faults marked
  std::vector<std::string> validate() const;
};

/// Where one photograph of the plan stands.
struct PhotoState {
  enum class Stage { Waiting, Taken, Flawed };  ///< Flawed: kept, but not good after all attempts
  Stage stage = Stage::Waiting;
  std::string file;  ///< in the bundle
  double exposureS = 0;
  PhotoQuality quality;
  int attempts = 0;
};

/// Hears what a capture does. Called on the job's thread; must be quick.
class CaptureObserver {
 public:
  virtual ~CaptureObserver() = default;
  virtual void checked(const Checklist&) {}
  /// What is now asked of the screen, and which photograph it is for (-1: none).
  virtual void showing(const ShownPicture&, int /*photo*/) {}
  /// A photograph (linear, per second) with its judgement; `kept`: it is on disk and counts.
  virtual void photographed(int /*photo*/, const Image&, const PhotoState&, bool /*kept*/) {}
  virtual void paused(bool) {}
};

/// A Fourier capture: takes the photographs of a plan through a camera and a display and writes a capture
/// bundle. A photograph counts when it and its hash are on disk; whatever happens in between (a crash, a
/// power cut, SIGKILL) costs at most the one in flight. In the folder: `photos/*.exr` (linear, per second of
/// exposure in full scale), `journal.jsonl` (what was taken, one line a photograph, flushed), and
/// `capture.json`, which is written when the capture is complete, and when it is cancelled with window and
/// black at hand, and which every reader of bundles accepts.
///
/// Threading: `run` and `retake` from one thread (a job's); `pause`, `photos` and the rest from any.
class CaptureSession {
 public:
  /// A new capture in `folder`, or (`resume`) one that was begun there. Errors: Invalid (rig, options);
  /// Refused (the folder holds something else; a capture is begun there and `resume` isn't set; or the rig,
  /// the plan or the settings are not those that it was begun with); WriteFailed.
  static Result<std::unique_ptr<CaptureSession>> open(const std::filesystem::path& folder,
                                                      const RigDescription& rig,
                                                      const CaptureOptions& options, bool resume);
  ~CaptureSession();

  const CapturePlan& plan() const;
  const std::filesystem::path& folder() const;
  std::vector<PhotoState> photos() const;
  /// Photographs that count.
  int taken() const;
  /// Sentences about what a resumed folder had lost.
  const std::vector<std::string>& remarks() const;

  struct Outcome {
    bool complete = false, cancelled = false;
    int taken = 0, total = 0, flawed = 0;
    std::vector<std::string> remarks;  ///< sentences for the person
  };
  /// Takes what is missing. Cancelled: what is finished stays, and the outcome says so. A camera or a display
  /// that fails ends it with its Error, nothing lost: run again with the same or another device. Progress:
  /// "check", "photograph" with `photos`.
  Result<Outcome> run(CameraDevice& camera, PatternDisplay& display, const JobContext& job,
                      CaptureObserver* observer = nullptr);
  /// Takes one photograph again at the next `run`; the old one counts until the new one does.
  Status retake(int photo);
  /// Holds before the next photograph until resumed.
  void pause(bool paused);
  bool isPaused() const;

 private:
  struct State;
  explicit CaptureSession(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace patina
