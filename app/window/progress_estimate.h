#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <string>

namespace patina {

/// Turns the stages of a fit into one fraction and a time left. Stages have shares of the whole, learned from
/// the last run.
class ProgressEstimate {
 public:
  using Clock = std::chrono::steady_clock;

  /// Which stages there are.
  enum class Work { FourierFit, TwoShotFit, Explain };

  /// `secondsByStage`: the seconds of an earlier run's stats; what is missing there has the share of a
  /// typical one.
  explicit ProgressEstimate(const std::map<std::string, double>& secondsByStage = {},
                            Clock::time_point start = Clock::now(), Work work = Work::FourierFit);

  /// Notes that `stage` has `done` of `total`. A stage that is not known moves the bar a little.
  void update(const std::string& stage, std::int64_t done, std::int64_t total,
              Clock::time_point now = Clock::now());

  /// 0..1, never falling.
  double fraction() const { return fraction_; }
  /// Empty until enough is known: a second and two percent.
  std::optional<std::chrono::seconds> left() const { return left_; }

  /// A stage's id as a person reads it: "solve" is "Fitting texels". An unknown id is returned as it is.
  static std::string title(const std::string& stage, Work work = Work::FourierFit);
  Work work() const { return work_; }

 private:
  Work work_;
  std::map<std::string, double> share_;
  Clock::time_point start_;
  std::string stage_;         ///< the one that last reported
  double from_ = 0, to_ = 0;  ///< the fractions between which it moves
  double fraction_ = 0;
  std::optional<std::chrono::seconds> left_;
};

}  // namespace patina
