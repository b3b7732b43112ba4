#include "engine/acquire/camera_device.h"

#include <algorithm>
#include <cmath>

namespace patina {
namespace {

constexpr double kSameSetting = 0.02;  ///< relative: devices round exposures to lines of the sensor
constexpr int kMostDropped = 120;      ///< frames that a setting may take to act: four seconds at 30 a second

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

bool same(double a, double b) {
  return std::abs(a - b) <= kSameSetting * std::max(std::abs(a), std::abs(b)) + 1e-12;
}

}  // namespace

std::string controlName(CameraControlId id) {
  switch (id) {
    case CameraControlId::ExposureS:
      return "exposure";
    case CameraControlId::Gain:
      return "gain";
    case CameraControlId::WhiteBalanceK:
      return "white balance";
    case CameraControlId::RedGain:
      return "red gain";
    case CameraControlId::BlueGain:
      return "blue gain";
    case CameraControlId::Focus:
      return "focus";
    case CameraControlId::PowerLineHz:
      return "power line frequency";
    case CameraControlId::AutoExposure:
      return "automatic exposure";
    case CameraControlId::AutoWhiteBalance:
      return "automatic white balance";
    case CameraControlId::AutoFocus:
      return "automatic focus";
  }
  return {};
}

std::string controlUnit(CameraControlId id) {
  switch (id) {
    case CameraControlId::ExposureS:
      return "s";
    case CameraControlId::WhiteBalanceK:
      return "K";
    case CameraControlId::PowerLineHz:
      return "Hz";
    default:
      return {};
  }
}

Error cameraUnplugged(const std::string& camera) {
  return Error{ErrorCode::NotFound, "the camera was unplugged, or has stopped answering", camera,
               "plug it in again and go on: the photographs taken so far are kept"};
}

Error cameraBusy(const std::string& camera) {
  return Error{ErrorCode::Refused, "another program is using this camera", camera,
               "close the other program (a video call, a browser tab), then try again"};
}

Error noFrameInTime(const std::string& camera, std::chrono::milliseconds waited) {
  return Error{
      ErrorCode::Refused,
      "no picture came from the camera within " + number(static_cast<double>(waited.count()) / 1000) + " s",
      camera, "check the cable, choose a smaller format, or plug the camera in again, then go on"};
}

// ---- queue ----

FrameSink FrameQueue::sink() {
  return [this](Result<Frame> frame) { push(std::move(frame)); };
}

void FrameQueue::push(Result<Frame> frame) {
  {
    const std::lock_guard lock(mutex_);
    if (frames_.size() >= capacity_) frames_.pop_front();
    frames_.push_back(std::move(frame));
  }
  ready_.notify_all();
}

std::optional<Result<Frame>> FrameQueue::next(std::chrono::milliseconds timeout,
                                              const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  if (!ready_.wait_for(lock, stop, timeout, [this] { return !frames_.empty(); })) return {};
  Result<Frame> frame = std::move(frames_.front());
  frames_.pop_front();
  return frame;
}

void FrameQueue::clear() {
  const std::lock_guard lock(mutex_);
  frames_.clear();
}

// ---- stills ----

void CameraDevice::preview(FrameSink sink) {
  const std::lock_guard lock(previewMutex_);
  preview_ = std::move(sink);
}

void CameraDevice::showPreview(const Result<Frame>& frame) {
  const std::lock_guard lock(previewMutex_);
  if (preview_) preview_(frame);
}

bool CameraDevice::meets(const FrameMetadata& metadata, const StillRequest& request) {
  if (metadata.damaged || metadata.exposureStart < request.notBefore) return false;
  if (request.exposureS && !(metadata.exposureS && same(*metadata.exposureS, *request.exposureS)))
    return false;
  return !request.gain || (metadata.gain && same(*metadata.gain, *request.gain));
}

Status CameraDevice::apply(StillRequest& request) {
  if (!request.exposureS && !request.gain) return Done{};
  const Result<std::vector<CameraControl>> known = controls();
  if (!known) return known.error();
  for (const auto& [id, wanted] : {std::pair{CameraControlId::ExposureS, &request.exposureS},
                                   std::pair{CameraControlId::Gain, &request.gain}}) {
    if (!*wanted) continue;
    const auto control = std::ranges::find(*known, id, &CameraControl::id);
    if (control == known->end()) {
      // A gain of one is what a camera without gain has anyway.
      if (id == CameraControlId::Gain && **wanted == 1) {
        wanted->reset();
        continue;
      }
      return Error{ErrorCode::Unsupported, "this camera's " + controlName(id) + " can't be set by a program",
                   info().name,
                   "set it on the camera itself, or use a camera with a manual " + controlName(id)};
    }
    if (same(control->value, **wanted)) {
      *wanted = control->value;
      continue;
    }
    const Result<double> inForce = set(id, **wanted);
    if (!inForce) return inForce.error();
    *wanted = *inForce;
  }
  return Done{};
}

Result<std::vector<Frame>> CameraDevice::still(const StillRequest& asked, const std::stop_token& stop) {
  StillRequest request = asked;
  if (Status applied = apply(request); !applied) return applied.error();
  if (!streaming() || !stills_) {
    if (streaming()) this->stop();
    stills_ = std::make_shared<FrameQueue>();
    const std::shared_ptr<FrameQueue> queue = stills_;
    if (Status started = start([this, queue](Result<Frame> frame) {
          showPreview(frame);
          queue->push(std::move(frame));
        });
        !started) {
      stills_.reset();
      return started.error();
    }
  }
  const double exposureS = request.exposureS.value_or(0.2);
  const auto patience = request.timeout.count() > 0
                            ? request.timeout
                            : std::chrono::milliseconds(3000 + static_cast<int>(5000 * exposureS));
  std::vector<Frame> frames;
  int dropped = 0;
  while (static_cast<int>(frames.size()) < request.frames) {
    std::optional<Result<Frame>> next = stills_->next(patience, stop);
    if (stop.stop_requested()) return Error{ErrorCode::Cancelled, "the photograph was cancelled", "", ""};
    if (!next) {
      this->stop();
      stills_.reset();
      return noFrameInTime(info().name, patience);
    }
    if (!*next) {
      this->stop();
      stills_.reset();
      return next->error();
    }
    if (meets((*next)->metadata, request)) {
      frames.push_back(std::move(**next));
    } else if (++dropped > kMostDropped) {
      return Error{ErrorCode::Refused,
                   "the camera does not take the exposure of " + number(exposureS) +
                       " s: " + std::to_string(dropped) + " pictures came without it",
                   info().name, "choose another exposure, or another format of this camera"};
    }
  }
  return frames;
}

}  // namespace patina
