#pragma once

#include <cstdint>
#include <stop_token>
#include <string>
#include <string_view>

namespace patina {

/// Receives how far a job is. Called from any thread, often; must be quick and must not throw.
class ProgressSink {
 public:
  virtual ~ProgressSink() = default;
  /// `stage` is a stable id ("read", "guess", "solve", "maps"); `done` of `total`, counted in `unit`
  /// ("photos", "texels").
  virtual void progress(std::string_view stage, std::int64_t done, std::int64_t total,
                        std::string_view unit) = 0;
};

/// Receives sentences for the log. Called from any thread.
class LogSink {
 public:
  enum class Level { Info, Warning };
  virtual ~LogSink() = default;
  virtual void log(Level level, std::string_view sentence) = 0;
};

/// What a long operation is given by whoever started it. The engine polls `stop` at least every 100 ms.
/// Copies are cheap; the sinks must outlive the job. Null sinks are silent.
struct JobContext {
  std::stop_token stop{};
  ProgressSink* progressSink = nullptr;
  LogSink* logSink = nullptr;
  std::uint64_t seed = 0;
  int threads = 0;  ///< 0: all cores

  bool cancelled() const { return stop.stop_requested(); }
  void progress(std::string_view stage, std::int64_t done, std::int64_t total, std::string_view unit) const {
    if (progressSink) progressSink->progress(stage, done, total, unit);
  }
  void info(std::string_view sentence) const {
    if (logSink) logSink->log(LogSink::Level::Info, sentence);
  }
  void warn(std::string_view sentence) const {
    if (logSink) logSink->log(LogSink::Level::Warning, sentence);
  }
};

}  // namespace patina
