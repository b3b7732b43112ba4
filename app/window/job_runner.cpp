#include "app/window/job_runner.h"

#include <QMetaObject>
#include <atomic>
#include <mutex>

namespace patina {

/// One job: its thread and the sink that it reports to. Progress may come thousands of times a second from
/// any thread; at most one message is on its way to the window at any moment, with the latest figures.
struct JobRunner::Running : ProgressSink, LogSink {
  JobRunner* runner = nullptr;
  std::uint64_t number = 0;
  std::atomic<bool> over = false;
  std::atomic<bool> posted = false;
  std::mutex mutex;
  std::string stage, unit;
  std::int64_t done = 0, total = 0;
  std::jthread thread;

  void progress(std::string_view newStage, std::int64_t newDone, std::int64_t newTotal,
                std::string_view newUnit) override {
    {
      const std::lock_guard lock(mutex);
      stage = newStage;
      unit = newUnit;
      done = newDone;
      total = newTotal;
    }
    if (posted.exchange(true)) return;
    QMetaObject::invokeMethod(
        runner,
        [this, owner = runner, mine = number] {
          if (mine != owner->number_ || !owner->current_) return;  // stale: `this` may be gone
          posted = false;
          QString stageNow, unitNow;
          qint64 doneNow, totalNow;
          {
            const std::lock_guard lock(mutex);
            stageNow = QString::fromStdString(stage);
            unitNow = QString::fromStdString(unit);
            doneNow = done;
            totalNow = total;
          }
          Q_EMIT owner->progressed(stageNow, doneNow, totalNow, unitNow);
        },
        Qt::QueuedConnection);
  }

  void log(Level level, std::string_view sentence) override {
    if (level != Level::Warning) return;
    QMetaObject::invokeMethod(
        runner,
        [owner = runner, mine = number,
         text = QString::fromUtf8(sentence.data(), static_cast<int>(sentence.size()))] {
          if (mine == owner->number_) Q_EMIT owner->warned(text);
        },
        Qt::QueuedConnection);
  }
};

JobRunner::JobRunner(QObject* parent) : QObject(parent) {}

JobRunner::~JobRunner() {
  if (current_) retired_.push_back(std::move(current_));
  joinRetired();
}

void JobRunner::joinRetired() {
  for (auto& job : retired_) job->thread.request_stop();
  for (auto& job : retired_)
    if (job->thread.joinable()) job->thread.join();
  retired_.clear();
}

void JobRunner::abandonAndWait() {
  abandon();
  joinRetired();
}

std::uint64_t JobRunner::launch(std::function<std::function<void()>(const JobContext&)> work) {
  abandon();
  reap();
  auto job = std::make_shared<Running>();
  job->runner = this;
  job->number = ++number_;
  cancelling_ = false;
  current_ = job;
  job->thread = std::jthread(
      [this, raw = job.get(), number = job->number, work = std::move(work)](std::stop_token stop) {
        JobContext context;
        context.stop = stop;
        context.progressSink = raw;
        context.logSink = raw;
        std::function<void()> deliver = work(context);
        raw->over = true;
        QMetaObject::invokeMethod(
            this,
            [this, number, deliver = std::move(deliver)] {
              if (number != number_ || !current_) return reap();
              retired_.push_back(std::move(current_));
              current_.reset();
              cancelling_ = false;
              deliver();
              Q_EMIT finished();
              reap();
            },
            Qt::QueuedConnection);
      });
  Q_EMIT started();
  return number_;
}

void JobRunner::cancel() {
  if (!current_) return;
  cancelling_ = true;
  current_->thread.request_stop();
}

void JobRunner::abandon() {
  if (!current_) return;
  current_->thread.request_stop();
  retired_.push_back(std::move(current_));
  current_.reset();
  cancelling_ = false;
  ++number_;
  Q_EMIT finished();
}

void JobRunner::reap() {
  // `over` is set just before a thread's last post, so joining it takes no time.
  std::erase_if(retired_, [](const std::shared_ptr<Running>& job) {
    if (!job->over) return false;
    if (job->thread.joinable()) job->thread.join();
    return true;
  });
}

}  // namespace patina
