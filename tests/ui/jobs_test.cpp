#include <gtest/gtest.h>

#include <QTest>
#include <atomic>
#include <chrono>
#include <thread>

#include "app/window/job_runner.h"
#include "app/window/progress_estimate.h"

namespace patina {
namespace {

using namespace std::chrono_literals;

std::function<Result<int>(const JobContext&)> slow(int value, std::atomic<bool>* stopped = nullptr) {
  return [=](const JobContext& job) -> Result<int> {
    for (int i = 0; i < 500 && !job.cancelled(); ++i) {
      job.progress("solve", i, 500, "texels");
      std::this_thread::sleep_for(2ms);
    }
    if (stopped) *stopped = job.cancelled();
    return value;
  };
}

TEST(JobRunner, DeliversInTheStartersThread) {
  JobRunner runner;
  const auto here = std::this_thread::get_id();
  std::thread::id worked, delivered;
  int got = 0;
  runner.start<int>(
      [&](const JobContext&) -> Result<int> {
        worked = std::this_thread::get_id();
        return 7;
      },
      [&](Result<int> outcome) {
        delivered = std::this_thread::get_id();
        got = *outcome;
      });
  ASSERT_TRUE(QTest::qWaitFor([&] { return got == 7; }, 3000));
  EXPECT_NE(worked, here);
  EXPECT_EQ(delivered, here);
  EXPECT_FALSE(runner.running());
}

TEST(JobRunner, DropsWhatAnEarlierJobStillSays) {
  JobRunner runner;
  std::atomic<bool> firstStopped = false;
  std::vector<int> got;
  runner.start<int>(slow(1, &firstStopped), [&](Result<int> outcome) { got.push_back(*outcome); });
  QTest::qWait(30);
  runner.start<int>([](const JobContext&) -> Result<int> { return 2; },
                    [&](Result<int> outcome) { got.push_back(*outcome); });
  ASSERT_TRUE(QTest::qWaitFor([&] { return !got.empty() && firstStopped; }, 3000));
  QTest::qWait(50);
  EXPECT_EQ(got, std::vector<int>{2});
}

TEST(JobRunner, CancelKeepsWhatThereIs) {
  JobRunner runner;
  std::atomic<bool> stopped = false;
  int got = 0;
  runner.start<int>(slow(5, &stopped), [&](Result<int> outcome) { got = *outcome; });
  QTest::qWait(30);
  runner.cancel();
  EXPECT_TRUE(runner.cancelling());
  ASSERT_TRUE(QTest::qWaitFor([&] { return got == 5; }, 3000));
  EXPECT_TRUE(stopped);
}

TEST(JobRunner, AFaultOfOursIsAnErrorNotACrash) {
  JobRunner runner;
  std::string said;
  runner.start<int>([](const JobContext&) -> Result<int> { throw std::runtime_error("index out of range"); },
                    [&](Result<int> outcome) { said = outcome.ok() ? "" : outcome.error().what; });
  ASSERT_TRUE(QTest::qWaitFor([&] { return !said.empty(); }, 3000));
  EXPECT_NE(said.find("index out of range"), std::string::npos);
}

TEST(JobRunner, WhatIsNoStdExceptionIsAnErrorToo) {
  JobRunner runner;
  std::string said;
  runner.start<int>([](const JobContext&) -> Result<int> { throw 42; },
                    [&](Result<int> outcome) { said = outcome.ok() ? "" : outcome.error().what; });
  ASSERT_TRUE(QTest::qWaitFor([&] { return !said.empty(); }, 3000));
}

TEST(JobRunner, DestroyedWhileRunningStopsTheJob) {
  std::atomic<bool> stopped = false;
  bool delivered = false;
  {
    JobRunner runner;
    runner.start<int>(slow(1, &stopped), [&](Result<int>) { delivered = true; });
    QTest::qWait(20);
  }
  QTest::qWait(20);
  EXPECT_TRUE(stopped);
  EXPECT_FALSE(delivered);
}

TEST(ProgressEstimate, NeverFallsAndEndsNearOne) {
  const ProgressEstimate::Clock::time_point start{};
  ProgressEstimate estimate({}, start);
  double previous = 0;
  int second = 0;
  for (const char* stage :
       {"read", "geometry", "levels", "upsample", "solve", "rescue", "maps", "predict", "holdout"})
    for (int i = 0; i <= 10; ++i) {
      estimate.update(stage, i, 10, start + std::chrono::seconds(++second));
      EXPECT_GE(estimate.fraction(), previous);
      previous = estimate.fraction();
    }
  EXPECT_NEAR(previous, 1.0, 1e-9);
}

TEST(ProgressEstimate, LearnsFromTheLastRun) {
  const ProgressEstimate::Clock::time_point start{};
  // As a fit writes them. Reading took nine tenths: when it is half done, 45 % of the time is over.
  ProgressEstimate estimate({{"read", 9.0},
                             {"geometry", 0.0},
                             {"levels", 0.0},
                             {"solve", 0.5},
                             {"maps", 0.1},
                             {"predict", 0.3},
                             {"holdout", 0.1},
                             {"total", 10.0}},
                            start);
  estimate.update("read", 5, 10, start + 9s);
  EXPECT_NEAR(estimate.fraction(), 0.45, 1e-9);
  ASSERT_TRUE(estimate.left().has_value());
  EXPECT_EQ(estimate.left()->count(), 11);  // 9 s * 0.55 / 0.45
}

TEST(ProgressEstimate, CountsEverySecondOfTheLastRunOnce) {
  // A fit of 100 s: where each stage ends is known.
  ProgressEstimate estimate({{"read", 10.0},
                             {"geometry", 2.0},
                             {"levels", 0.0},
                             {"solve", 60.0},
                             {"maps", 3.0},
                             {"predict", 20.0},
                             {"holdout", 5.0},
                             {"total", 100.0}});
  estimate.update("read", 10, 10);
  EXPECT_NEAR(estimate.fraction(), 0.10, 1e-9);
  estimate.update("geometry", 1, 1);
  EXPECT_NEAR(estimate.fraction(), 0.12, 1e-9);
  estimate.update("solve", 10, 10);
  EXPECT_LT(estimate.fraction(), 0.72);  // its seconds hold those of the next
  estimate.update("rescue", 10, 10);
  EXPECT_NEAR(estimate.fraction(), 0.72, 1e-9);
  estimate.update("maps", 1, 1);
  EXPECT_NEAR(estimate.fraction(), 0.75, 1e-9);
  estimate.update("predict", 1, 2);
  EXPECT_NEAR(estimate.fraction(), 0.85, 1e-9);
  estimate.update("predict", 2, 2);
  EXPECT_NEAR(estimate.fraction(), 0.95, 1e-9);
  estimate.update("holdout", 1, 1);
  EXPECT_NEAR(estimate.fraction(), 1.0, 1e-9);
}

TEST(ProgressEstimate, AStageThatTheLastRunDidNotHaveStillMovesTheBar) {
  // The earlier bundle held nothing out; this one does.
  ProgressEstimate estimate(
      {{"read", 10.0}, {"geometry", 2.0}, {"solve", 60.0}, {"maps", 3.0}, {"predict", 20.0}});
  estimate.update("predict", 2, 2);
  const double before = estimate.fraction();
  EXPECT_LT(before, 0.99);
  estimate.update("holdout", 1, 2);
  EXPECT_GT(estimate.fraction(), before);
  estimate.update("holdout", 2, 2);
  EXPECT_NEAR(estimate.fraction(), 1.0, 1e-9);
}

TEST(ProgressEstimate, AnUnknownStageMovesTheBarAndStopsNoOther) {
  ProgressEstimate estimate;
  estimate.update("solve", 1, 2);
  double before = estimate.fraction();
  for (const char* stage : {"polish", "solve", "varnish", "holdout"}) {
    estimate.update(stage, 1, 4);
    EXPECT_GE(estimate.fraction(), before) << stage;
    const double quarter = estimate.fraction();
    estimate.update(stage, 4, 4);
    EXPECT_GT(estimate.fraction(), quarter) << stage;
    before = estimate.fraction();
  }
  EXPECT_NEAR(estimate.fraction(), 1.0, 1e-9);
}

TEST(ProgressEstimate, EveryStageOfAFitHasATitle) {
  for (const char* stage :
       {"read", "geometry", "levels", "upsample", "solve", "rescue", "maps", "predict", "holdout"})
    EXPECT_NE(ProgressEstimate::title(stage), stage);
  EXPECT_EQ(ProgressEstimate::title("solve"), "Fitting texels");
  EXPECT_EQ(ProgressEstimate::title("polish"), "polish");
}

}  // namespace
}  // namespace patina
