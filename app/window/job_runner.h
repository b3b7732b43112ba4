#pragma once

#include <QObject>
#include <QString>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"

namespace patina {

/// Runs one long operation at a time on a thread of its own and brings its outcome back to the window's
/// thread. Jobs are numbered; what an earlier job still says after a later one was started is dropped. Never
/// waits, except when destroyed.
class JobRunner : public QObject {
  Q_OBJECT

 public:
  explicit JobRunner(QObject* parent = nullptr);
  ~JobRunner() override;

  /// Starts `work`; `done` is called in this object's thread unless another job was started or `abandon`
  /// called meanwhile.
  template <typename Value>
  std::uint64_t start(std::function<Result<Value>(const JobContext&)> work,
                      std::function<void(Result<Value>)> done) {
    using Outcome = std::shared_ptr<Result<Value>>;
    return launch([work = std::move(work),
                   done = std::move(done)](const JobContext& job) -> std::function<void()> {
      Outcome outcome;
      try {
        outcome.reset(new Result<Value>(work(job)));
      } catch (const std::exception& fault) {  // our own bug, or no memory: what is open must survive it
        outcome.reset(new Result<Value>(Error{
            ErrorCode::Invalid, std::string("A fault of this program stopped the work: ") + fault.what(), "",
            "Try again with smaller maps, and please report this"}));
      } catch (...) {
        outcome.reset(new Result<Value>(Error{ErrorCode::Invalid, "A fault of this program stopped the work",
                                              "", "Try again with smaller maps, and please report this"}));
      }
      return [outcome, done] { done(std::move(*outcome)); };
    });
  }

  /// Asks the running job to stop; its outcome (what it has so far) is still delivered.
  void cancel();
  /// Asks the running job to stop and drops its outcome.
  void abandon();
  /// The same, and waits until no thread of it is left: for whoever is about to take away what jobs use.
  void abandonAndWait();
  bool running() const { return current_ != nullptr; }
  bool cancelling() const { return cancelling_; }
  std::uint64_t number() const { return number_; }

 Q_SIGNALS:
  void started();
  void progressed(QString stage, qint64 done, qint64 total, QString unit);
  void warned(QString sentence);
  void finished();

 private:
  struct Running;
  std::uint64_t launch(std::function<std::function<void()>(const JobContext&)> work);
  void reap();
  void joinRetired();

  std::uint64_t number_ = 0;
  bool cancelling_ = false;
  std::shared_ptr<Running> current_;
  std::vector<std::shared_ptr<Running>> retired_;  ///< stopping, not yet over
};

}  // namespace patina
