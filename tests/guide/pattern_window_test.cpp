#include "app/window/rig/pattern_window.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <QGuiApplication>
#include <QScreen>
#include <QTest>
#include <QWindow>
#include <future>

#include "app/window/rig/screen_numbers.h"
#include "app/window/rig/screen_step.h"

namespace patina {
namespace {

/// Every pixel different from its neighbours: a shift or a scale of anything would show.
ShownPicture busyPicture(int width, int height) {
  auto pixels = std::make_shared<std::vector<std::uint8_t>>();
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) pixels->push_back(static_cast<std::uint8_t>((37 * x + 101 * y) & 255));
  ShownPicture picture;
  picture.name = "busy";
  picture.width = width;
  picture.height = height;
  picture.pixels = pixels;
  return picture;
}

struct Watcher : GlassObserver {
  void glassShows(const std::string& screenId, const ShownPicture& picture, RigTime swapped) override {
    id = screenId;
    hash = picture.hash();
    at = swapped;
    ++count;
  }
  std::string id;
  std::uint64_t hash = 0;
  RigTime at{};
  int count = 0;
};

QWindow* patternWindow() {
  for (QWindow* window : QGuiApplication::topLevelWindows())
    if (window->objectName() == QStringLiteral("patternWindow") && window->isVisible()) return window;
  return nullptr;
}

/// `show` blocks a job's thread; the window's goes on meanwhile.
Result<OnGlass> showFromAJob(PatternDisplay& display, const ShownPicture& picture,
                             const std::stop_token& stop = {}) {
  auto shown = std::async(std::launch::async, [&] { return display.show(picture, stop); });
  while (shown.wait_for(std::chrono::milliseconds(0)) != std::future_status::ready) QTest::qWait(5);
  return shown.get();
}

TEST(PatternWindow, ListsEveryScreenInItsOwnPixels) {
  const std::vector<ScreenInfo> screens = screensThere();
  ASSERT_EQ(screens.size(), 2u);
  EXPECT_EQ(screens[0].id, "laptop");
  EXPECT_EQ(screens[1].id, "monitor");
  EXPECT_EQ(screens[1].widthPx, 960);
  EXPECT_EQ(screens[1].heightPx, 540);
}

TEST(PatternWindow, DrawsPixelForPixelOnTheScreenThatWasChosen) {
  Watcher watcher;
  auto display = openPatternWindow("monitor", &watcher, {});
  ASSERT_TRUE(display.ok()) << display.error().sentence();
  (*display)->setLatency(std::chrono::milliseconds(30));
  const ShownPicture picture = busyPicture(960, 540);
  const RigTime before = std::chrono::steady_clock::now();
  const Result<OnGlass> shown = showFromAJob(**display, picture);
  ASSERT_TRUE(shown.ok()) << shown.error().sentence();
  EXPECT_GE(shown->swapped, before);
  EXPECT_EQ(shown->since - shown->swapped, std::chrono::milliseconds(30));
  EXPECT_GE(std::chrono::steady_clock::now(), shown->since);
  EXPECT_EQ(watcher.id, "monitor");
  EXPECT_EQ(watcher.hash, picture.hash());
  EXPECT_EQ(watcher.at, shown->swapped);

  QWindow* window = patternWindow();
  ASSERT_NE(window, nullptr);
  EXPECT_EQ(window->geometry(), QRect(1920, 0, 960, 540));
  EXPECT_EQ(window->cursor().shape(), Qt::BlankCursor);
  const QImage seen = window->screen()->grabWindow(window->winId()).toImage();
  ASSERT_EQ(seen.size(), QSize(960, 540));
  int wrong = 0;
  for (int y = 0; y < 540; ++y)
    for (int x = 0; x < 960; ++x) {
      const int value = (*picture.pixels)[static_cast<std::size_t>(y) * 960 + static_cast<std::size_t>(x)];
      wrong += seen.pixel(x, y) != qRgb(value, value, value) ? 1 : 0;
    }
  EXPECT_EQ(wrong, 0);
  display->reset();
  EXPECT_EQ(patternWindow(), nullptr);
}

TEST(PatternWindow, EscLeavesAndWhatShowsIsRefused) {
  std::optional<Error> left;
  auto display = openPatternWindow("monitor", nullptr, [&](const Error& error) { left = error; });
  ASSERT_TRUE(display.ok());
  (*display)->setLatency(std::chrono::milliseconds(0));
  ASSERT_TRUE(showFromAJob(**display, busyPicture(960, 540)).ok());
  QTest::keyClick(patternWindow(), Qt::Key_Escape);
  EXPECT_EQ(patternWindow(), nullptr);
  ASSERT_TRUE(left.has_value());
  EXPECT_EQ(left->code, ErrorCode::Refused);
  const Result<OnGlass> shown = showFromAJob(**display, busyPicture(960, 540));
  ASSERT_FALSE(shown.ok());
  EXPECT_EQ(shown.error().code, ErrorCode::Refused);
  EXPECT_THAT(shown.error().sentence(), testing::HasSubstr("Esc"));
}

TEST(PatternWindow, RefusesOtherSizesAndStopsWaiting) {
  auto display = openPatternWindow("monitor", nullptr, {});
  ASSERT_TRUE(display.ok());
  const Result<OnGlass> other = showFromAJob(**display, busyPicture(320, 180));
  ASSERT_FALSE(other.ok());
  EXPECT_EQ(other.error().code, ErrorCode::Invalid);
  (*display)->setLatency(std::chrono::seconds(20));
  std::stop_source stop;
  auto shown = std::async(std::launch::async,
                          [&] { return (*display)->show(busyPicture(960, 540), stop.get_token()); });
  QTest::qWait(100);
  stop.request_stop();
  ASSERT_EQ(shown.wait_for(std::chrono::seconds(2)), std::future_status::ready);
  const Result<OnGlass> stopped = shown.get();
  ASSERT_FALSE(stopped.ok());
  EXPECT_EQ(stopped.error().code, ErrorCode::Cancelled);
  EXPECT_FALSE(openPatternWindow("no such screen", nullptr, {}).ok());
}

TEST(ScreenNumbers, EveryScreenShowsItsOwn) {
  const ScreenNumbers numbers;
  ASSERT_EQ(numbers.windows().size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    const QWidget& window = *numbers.windows()[i];
    EXPECT_TRUE(window.isVisible());
    EXPECT_TRUE(
        QGuiApplication::screens()[static_cast<qsizetype>(i)]->geometry().contains(window.geometry()));
  }
}

TEST(RulerPicture, BarsAreAsLongAsItSays) {
  const RulerPicture ruler = rulerPicture(960, 540);
  int left = 960, right = -1, top = 540, bottom = -1;
  for (int y = 0; y < 540; ++y)
    for (int x = 0; x < 960; ++x)
      if ((*ruler.picture.pixels)[static_cast<std::size_t>(y) * 960 + static_cast<std::size_t>(x)] > 0) {
        left = std::min(left, x), right = std::max(right, x);
        top = std::min(top, y), bottom = std::max(bottom, y);
      }
  EXPECT_EQ(right - left + 1, ruler.acrossPx);
  EXPECT_EQ(bottom - top + 1, ruler.downPx);
}

}  // namespace
}  // namespace patina
