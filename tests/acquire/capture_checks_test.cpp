#include "engine/acquire/capture_checks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "tests/acquire/live_session.h"

namespace patina {
namespace {

using test::LiveSession;

std::map<CheckId, CheckItem> check(LiveSession& live, Checklist* whole = nullptr) {
  const Result<Checklist> list = checkRig(*live.camera, *live.display, live.rig->description(), {}, {});
  EXPECT_TRUE(list.ok()) << list.error().sentence();
  std::map<CheckId, CheckItem> items;
  for (const CheckItem& item : list->items) {
    items[item.id] = item;
    EXPECT_FALSE(item.sentence.empty());
    EXPECT_EQ(item.tryThis.empty(), item.state == CheckItem::State::Good);
  }
  if (whole) *whole = *list;
  return items;
}

TEST(CaptureChecks, AGoodRigIsGoodAndTheExposureIsWholeRefreshesAndFilled) {
  LiveSession live(LiveRig::desk("laminate", 48));
  Checklist list;
  const auto items = check(live, &list);
  for (const auto& [id, item] : items)
    EXPECT_EQ(item.state, CheckItem::State::Good) << item.title << ": " << item.sentence;
  EXPECT_TRUE(list.good());
  EXPECT_NEAR(list.exposureS * 60, std::round(list.exposureS * 60), 1e-9);
  EXPECT_GT(list.brightest, 0.6);
  EXPECT_LT(list.brightest, 0.95);
}

TEST(CaptureChecks, ALitRoomIsNoticed) {
  LiveRigSetup setup = LiveRig::desk("laminate", 32);
  setup.ambient = 0.01;
  LiveSession some(setup);
  EXPECT_EQ(check(some)[CheckId::Ambient].state, CheckItem::State::Warning);
  setup.ambient = 0.1;
  LiveSession much(setup);
  Checklist list;
  EXPECT_EQ(check(much, &list)[CheckId::Ambient].state, CheckItem::State::Bad);
  EXPECT_FALSE(list.good());
}

TEST(CaptureChecks, ABlurredLensIsNoticed) {
  LiveRigSetup setup = LiveRig::desk("laminate", 64);
  setup.effects.defocus.sigmaPx = 2.5;
  LiveSession live(setup);
  EXPECT_NE(check(live)[CheckId::Focus].state, CheckItem::State::Good);
}

TEST(CaptureChecks, TooDarkEvenWithTheLongestExposureIsNoticed) {
  LiveRigSetup setup = LiveRig::desk("laminate", 32);
  setup.mostExposureS = 0.017;
  setup.fullScaleSecond = 5;
  LiveSession live(setup);
  EXPECT_NE(check(live)[CheckId::Exposure].state, CheckItem::State::Good);
}

TEST(CaptureChecks, AWrongSizeAndAMissingSampleAreRefused) {
  LiveSession live(LiveRig::desk("laminate", 32));
  RigDescription rig = live.rig->description();
  rig.camera.width = 64;
  EXPECT_FALSE(checkRig(*live.camera, *live.display, rig, {}, {}).ok());
  live.rig->unplug();
  const auto gone = checkRig(*live.camera, *live.display, live.rig->description(), {}, {});
  ASSERT_FALSE(gone.ok());
  EXPECT_EQ(gone.error().code, ErrorCode::NotFound);
}

TEST(CaptureChecks, CancelledItStops) {
  LiveSession live(LiveRig::desk("laminate", 32));
  std::stop_source stop;
  stop.request_stop();
  JobContext job;
  job.stop = stop.get_token();
  EXPECT_EQ(checkRig(*live.camera, *live.display, live.rig->description(), {}, job).error().code,
            ErrorCode::Cancelled);
}

}  // namespace
}  // namespace patina
