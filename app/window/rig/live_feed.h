#pragma once

#include <QObject>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>

#include "engine/acquire/camera_device.h"
#include "widgets/live_view.h"

namespace patina {

/// Brings a camera's frames to the window: takes them on the camera's thread, turns the newest into light on
/// one of its own, and tells the window; frames that come faster than that are dropped.
class LiveFeed : public QObject {
  Q_OBJECT

 public:
  explicit LiveFeed(QObject* parent = nullptr);
  ~LiveFeed() override;
  /// Must outlive the stream that it is given to.
  FrameSink sink();
  /// Frames that are on their way are dropped: those of another camera.
  void forget();

 Q_SIGNALS:
  void arrived(patina::LiveFramePtr frame);
  /// The stream ended by itself.
  void ended(patina::Error error);

 private:
  void work(const std::stop_token& stop);

  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::optional<Frame> newest_;
  std::uint64_t era_ = 0;
  bool delivered_ = true;  ///< the window has taken the last one
  std::jthread thread_;    ///< last: destroyed first
};

}  // namespace patina
