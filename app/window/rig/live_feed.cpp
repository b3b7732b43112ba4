#include "app/window/rig/live_feed.h"

#include <QMetaObject>

#include "engine/acquire/frame_image.h"

namespace patina {

LiveFeed::LiveFeed(QObject* parent)
    : QObject(parent), thread_([this](const std::stop_token& stop) { work(stop); }) {}

LiveFeed::~LiveFeed() {
  thread_.request_stop();
  thread_.join();
}

FrameSink LiveFeed::sink() {
  return [this](Result<Frame> frame) {
    if (!frame) {
      std::uint64_t era = 0;
      {
        const std::lock_guard lock(mutex_);
        era = era_;
      }
      QMetaObject::invokeMethod(
          this,
          [this, era, error = frame.error()] {
            {
              const std::lock_guard lock(mutex_);
              if (era != era_) return;
            }
            Q_EMIT ended(error);
          },
          Qt::QueuedConnection);
      return;
    }
    {
      const std::lock_guard lock(mutex_);
      newest_ = std::move(*frame);
    }
    changed_.notify_one();
  };
}

void LiveFeed::forget() {
  const std::lock_guard lock(mutex_);
  newest_.reset();
  ++era_;
  delivered_ = true;
}

void LiveFeed::work(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    Frame frame;
    std::uint64_t era = 0;
    {
      std::unique_lock lock(mutex_);
      if (!changed_.wait(lock, stop, [this] { return newest_.has_value() && delivered_; })) return;
      frame = std::move(*newest_);
      newest_.reset();
      era = era_;
      delivered_ = false;
    }
    // A live picture needs no more than one pixel of each cell of a Bayer sensor, but boards are found in it.
    Result<Image> linear = linearImage(frame);
    LiveFramePtr live;
    if (linear && !linear->empty()) live = makeLiveFrame(std::move(*linear), frame.format, frame.metadata);
    QMetaObject::invokeMethod(
        this,
        [this, era, live] {
          {
            const std::lock_guard lock(mutex_);
            if (era != era_) return;
            delivered_ = true;
          }
          changed_.notify_one();
          if (live) Q_EMIT arrived(live);
        },
        Qt::QueuedConnection);
  }
}

}  // namespace patina
