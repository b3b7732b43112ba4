#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "engine/acquire/frame.h"
#include "engine/base/result.h"

namespace patina {

/// What of a camera can be set. The unit is the same for every backend.
enum class CameraControlId {
  ExposureS,         ///< seconds; setting it switches automatic exposure off
  Gain,              ///< factor, 1: none, where the device says; else its own numbers. Automatic gain off
  WhiteBalanceK,     ///< kelvin; automatic white balance off
  RedGain,           ///< factors on raw red and blue
  BlueGain,          ///<
  Focus,             ///< the device's own numbers; automatic focus off
  PowerLineHz,       ///< 0 (off), 50 or 60: what an automatic exposure avoids
  AutoExposure,      ///< 0 or 1
  AutoWhiteBalance,  ///<
  AutoFocus,         ///<
};
/// "exposure", "white balance": for sentences.
std::string controlName(CameraControlId id);
/// "s", "K", ""
std::string controlUnit(CameraControlId id);

struct CameraControl {
  CameraControlId id = CameraControlId::ExposureS;
  double least = 0, most = 0, step = 0;  ///< step 0: continuous
  double value = 0;                      ///< as read back
  bool writable = true;                  ///< false: read-only, or held by an automatic
};

/// A camera that is there, opened or not.
struct CameraInfo {
  std::string id;    ///< stable over restarts where the system allows: "v4l2:usb-...", "simulated:laminate"
  std::string name;  ///< for a person
  std::string backend;
  std::string remark;  ///< why it can't be used right now; empty: it can
};

/// Receives frames on a thread of the camera's; it must only queue. An Error is the last thing that comes:
/// the stream has ended (unplugged, no frame in time).
using FrameSink = std::function<void(Result<Frame>)>;

/// What a still photograph asks for.
struct StillRequest {
  std::optional<double> exposureS, gain;  ///< set where they differ from what is in force
  RigTime notBefore{};                    ///< exposure must begin at this time or later
  std::chrono::milliseconds timeout{0};   ///< for each frame; 0: five exposures and 3 s
  int frames = 1;                         ///< so many successive frames that meet the above
};

/// One camera, opened: nobody else has it meanwhile. (The pinhole camera of geometry is `Camera`.) Threading:
/// one thread at a time, but `stop` and `preview` may be called from any.
class CameraDevice {
 public:
  virtual ~CameraDevice() = default;

  virtual const CameraInfo& info() const = 0;
  /// Formats that it offers, those that are linear first.
  virtual Result<std::vector<FrameFormat>> formats() = 0;
  virtual FrameFormat format() const = 0;
  /// Chooses one of them; not while streaming.
  virtual Status setFormat(const FrameFormat& format) = 0;
  /// Those that it has, with what is in force.
  virtual Result<std::vector<CameraControl>> controls() = 0;
  /// Sets one, within its range, and returns what the device says is in force then. A late-acting setting is
  /// in force for frames whose metadata say so. Errors: Unsupported (no such control), Invalid (out of
  /// range), Refused (the device keeps another value: both are named).
  virtual Result<double> set(CameraControlId id, double value) = 0;
  /// Starts the stream. Errors: Refused (somebody else has the camera), NotFound (unplugged).
  virtual Status start(FrameSink sink) = 0;
  /// Ends it; no frame comes after it returned.
  virtual void stop() = 0;
  virtual bool streaming() const = 0;

  /// Photographs: sets exposure and gain, and drops frames until `StillRequest::frames` of them began late
  /// enough and have these settings by their metadata; a backend whose device has no metadata says in them
  /// what it vouches for. The default streams, and leaves the stream on for the next photograph (a stream of
  /// somebody else's is ended: look on by `preview`); a device that photographs otherwise overrides it.
  /// Errors: those of `set` and `start`, NotFound with "unplugged", Cancelled, Refused (no frame in time, or
  /// none with the settings).
  virtual Result<std::vector<Frame>> still(const StillRequest& request, const std::stop_token& stop);

  /// Also gives every frame that passes by during `still` to `sink` (on a thread of the camera's), for a live
  /// picture; null: no more.
  void preview(FrameSink sink);

 protected:
  /// For overrides of `still`.
  void showPreview(const Result<Frame>& frame);
  /// Sets what `request` asks for; what frames must have then is written back into it.
  Status apply(StillRequest& request);
  /// Whether a frame counts for an applied request.
  static bool meets(const FrameMetadata& metadata, const StillRequest& request);

 private:
  std::shared_ptr<class FrameQueue> stills_;
  std::mutex previewMutex_;
  FrameSink preview_;
};

/// One way to cameras: a backend.
class CameraProvider {
 public:
  virtual ~CameraProvider() = default;
  /// "v4l2", "libcamera", "folder", "simulated".
  virtual std::string backend() const = 0;
  /// Those that are there now; none is no failure.
  virtual Result<std::vector<CameraInfo>> list() = 0;
  /// Opens one by its id. Errors: NotFound, Refused (busy, no permission).
  virtual Result<std::unique_ptr<CameraDevice>> open(const std::string& id) = 0;
};

/// Frames between a camera's thread and whoever uses them: keeps the newest `capacity`.
class FrameQueue {
 public:
  explicit FrameQueue(std::size_t capacity = 4) : capacity_(capacity) {}
  FrameSink sink();  ///< the queue must outlive the stream
  void push(Result<Frame> frame);
  /// The oldest frame that is there, or the Error that ended the stream. Waits at most `timeout`; empty then.
  std::optional<Result<Frame>> next(std::chrono::milliseconds timeout, const std::stop_token& stop = {});
  /// Drops what is there.
  void clear();

 private:
  std::mutex mutex_;
  std::condition_variable_any ready_;
  std::deque<Result<Frame>> frames_;
  std::size_t capacity_;
};

/// The error of a camera that is gone, of one in other hands, and of one that sends nothing: one wording for
/// all backends.
Error cameraUnplugged(const std::string& camera);
Error cameraBusy(const std::string& camera);
Error noFrameInTime(const std::string& camera, std::chrono::milliseconds waited);

}  // namespace patina
