// The window on a real fit: the whole road, with the event loop's latency measured while the fit runs.
#include <QAction>
#include <QElapsedTimer>
#include <QLabel>
#include <QProgressBar>
#include <QPushButton>
#include <QTimer>
#include <atomic>
#include <thread>

#include "tests/ui/ui_fixture.h"
#include "widgets/error_banner.h"
#include "widgets/image_view.h"
#include "widgets/map_panel.h"
#include "widgets/photo_strip.h"
#include "widgets/plot_widget.h"
#include "widgets/sheet_viewport.h"
#include "widgets/texel_inspector.h"
#include "widgets/viewport_panel.h"

namespace patina::test {
namespace {

/// A pause of 250 ms is when a person begins to call it a hang.
constexpr double kLatencyMs = 250;
/// Where the machine is so busy with other work that an idle window already pauses, that is not the fit's
/// doing.
constexpr double kOverIdle = 4;

/// Measures how long the event loop takes to come round, every 10 ms.
class LatencyProbe {
 public:
  LatencyProbe() {
    clock_.start();
    timer_.setInterval(10);
    QObject::connect(&timer_, &QTimer::timeout, &timer_, [this] {
      gaps_.push_back(clock_.nsecsElapsed() * 1e-6 - 10);
      clock_.restart();
    });
    timer_.start();
  }
  double percentile(double fraction) {
    if (gaps_.empty()) return 1e9;
    std::sort(gaps_.begin(), gaps_.end());
    return gaps_[static_cast<std::size_t>(fraction * (gaps_.size() - 1))];
  }
  std::size_t count() const { return gaps_.size(); }
  void stop() { timer_.stop(); }

 private:
  QTimer timer_;
  QElapsedTimer clock_;
  std::vector<double> gaps_;
};

/// Passes a fit's progress on, and holds the fit where its first texels are done until it is asked to stop:
/// however fast the machine, it can be cancelled half way.
struct HoldAtFirstTexels : ProgressSink {
  const JobContext& job;
  explicit HoldAtFirstTexels(const JobContext& passedOn) : job(passedOn) {}
  void progress(std::string_view stage, std::int64_t done, std::int64_t total,
                std::string_view unit) override {
    job.progress(stage, done, total, unit);
    for (int i = 0; i < 6000 && stage == "solve" && !job.cancelled(); ++i)  // a minute at most
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
};

/// The engine, but the first fit waits for its cancelling.
Services firstFitHeld() {
  Services services = Services::engine();
  services.fit = [fit = services.fit, first = std::make_shared<std::atomic<bool>>(true)](
                     const FourierCapture& capture, const FourierFitOptions& options, const JobContext& job) {
    if (!first->exchange(false)) return fit(capture, options, job);
    HoldAtFirstTexels hold(job);
    JobContext held = job;
    held.progressSink = &hold;
    return fit(capture, options, held);
  };
  return services;
}

TEST_F(WindowTest, FitsCancelsFitsAgainAndStaysAlive) {
  auto window = makeWindow(firstFitHeld());
  open(*window, largerBundle());
  ASSERT_TRUE(until([&] { return window->maps()->view()->picture() != nullptr; }));
  LatencyProbe idle;
  QTest::qWait(1500);
  const double idleMs = idle.percentile(0.98);
  idle.stop();
  LatencyProbe probe;

  window->action("fit")->trigger();
  EXPECT_TRUE(window->fitting());
  EXPECT_FALSE(window->action("fit")->isEnabled());
  auto* stage = window->findChild<QLabel*>("stage");
  auto* bar = window->findChild<QProgressBar*>("progress");
  EXPECT_TRUE(window->findChild<QWidget*>("progressPane")->isVisible());
  ASSERT_TRUE(until([&] { return stage->text().contains("Fitting texels") || !window->fitting(); }, 120000));
  ASSERT_TRUE(window->fitting()) << "the fit was over before it could be cancelled";
  EXPECT_GT(bar->value(), 0);
  QTest::mouseClick(window->findChild<QPushButton*>("cancelButton"), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return !window->fitting(); }, 20000));
  EXPECT_FALSE(window->findChild<QWidget*>("progressPane")->isVisible());
  ASSERT_NE(window->document()->fit(), nullptr) << "what was finished is gone";
  EXPECT_TRUE(window->document()->fit()->stats().cancelled);
  EXPECT_EQ(window->banner()->kind(), ErrorBanner::Kind::Notice);
  EXPECT_TRUE(window->findChild<QLabel*>("health")->text().contains("Cancelled"));
  const auto cancelled = window->document()->fit();

  window->action("fit")->trigger();
  ASSERT_TRUE(until([&] { return !window->fitting(); }, 240000));
  ASSERT_NE(window->document()->fit(), cancelled);
  const auto fit = window->document()->fit();
  EXPECT_FALSE(fit->stats().cancelled);
  EXPECT_GT(fit->stats().texels, 100u);
  std::printf(
      "event loop while fitting: median %.1f ms, 98th percentile %.1f ms, worst %.1f ms over %zu rounds; "
      "idle %.1f ms\n",
      probe.percentile(0.5), probe.percentile(0.98), probe.percentile(1.0), probe.count(), idleMs);
  EXPECT_LT(probe.percentile(0.98), std::max(kLatencyMs, kOverIdle * idleMs)) << "idle: " << idleMs << " ms";

  // A texel by a click on the map, its spectrum with measured dots on the model's line.
  ImageView* view = window->maps()->view();
  const QPoint texel(fit->maps().width / 3, fit->maps().height / 3);
  QTest::mouseClick(view, Qt::LeftButton, {},
                    view->widgetFromPicture(QPointF(texel) + QPointF(0.5, 0.5)).toPoint());
  EXPECT_EQ(window->document()->pickedTexel(), texel);
  window->inspector()->setPage(0);
  std::size_t dots = 0;
  for (const PlotSeries& series : window->inspector()->magnitudePlot()->series())
    if (series.mark == PlotSeries::Mark::Dots) dots += series.points.size();
  EXPECT_GE(dots, 9u);  // DC and eight frequencies
  window->inspector()->setPage(1);
  EXPECT_EQ(window->inspector()->lobePlot()->series().size(), 2u);
  window->inspector()->setPage(0);

  // Undo goes back over the pick to the cancelled fit, redo returns.
  window->action("undo")->trigger();
  EXPECT_NE(window->document()->pickedTexel(), texel);
  window->action("undo")->trigger();
  EXPECT_EQ(window->document()->fit(), cancelled);
  window->action("redo")->trigger();
  EXPECT_EQ(window->document()->fit(), fit);
}

TEST_F(WindowTest, AFitIsSavedAndOpenedAgain) {
  const QString folder = temporary_.filePath("kept");
  {
    auto window = makeWindow();
    open(*window, smallBundle());
    window->startFit();
    ASSERT_TRUE(until([&] { return !window->fitting(); }, 120000));
    ASSERT_NE(window->document()->fit(), nullptr);
    window->saveFitTo(folder);
    ASSERT_TRUE(until([&] { return !window->saving(); }));
    ASSERT_FALSE(window->banner()->isVisible()) << window->banner()->text().toStdString();
    EXPECT_TRUE(std::filesystem::exists(folder.toStdString() + "/fit.json"));
    EXPECT_TRUE(std::filesystem::exists(folder.toStdString() + "/maps/sigma.exr"));
  }
  auto window = makeWindow();
  window->openPath(folder);
  ASSERT_TRUE(until([&] { return !window->opening(); }, 60000));
  ASSERT_FALSE(window->banner()->isVisible()) << window->banner()->text().toStdString();
  ASSERT_NE(window->document()->fit(), nullptr);
  EXPECT_EQ(window->maps()->kind(), ViewKind::Diffuse);
  EXPECT_FALSE(window->inspector()->magnitudePlot()->series().empty())
      << "the measurements did not come back";
  EXPECT_GT(window->strip()->model()->rowCount(), 100);
}

// Pictures for people, in the build folder; the test itself checks that nothing is empty or pushed out of the
// window.
TEST_F(WindowTest, ScreenshotsAtThreeSizes) {
  std::filesystem::create_directories(PATINA_SCREENSHOT_DIR);
  auto window = makeWindow();
  window->resize(1440, 900);
  QTest::qWait(100);
  window->grab().save(PATINA_SCREENSHOT_DIR "/empty_1440x900.png");
  open(*window, largerBundle());
  window->startFit();
  ASSERT_TRUE(until([&] { return !window->fitting(); }, 240000));
  ASSERT_NE(window->document()->fit(), nullptr);
  for (const QSize& size : {QSize(1024, 700), QSize(1440, 900), QSize(2560, 1440)}) {
    window->resize(size);
    QTest::qWait(150);
    EXPECT_EQ(window->size(), size) << "the content needs more room than the smallest window that we promise";
    for (const auto& kind : viewKinds()) {
      window->maps()->setKind(kind.kind);
      window->inspector()->setPage(static_cast<int>(kind.kind) % 3);
      QTest::qWait(120);
      const QImage shot = window->grab().toImage();
      const QString name = QStringLiteral(PATINA_SCREENSHOT_DIR "/%1_%2x%3.png")
                               .arg(QString::fromUtf8(kind.id))
                               .arg(size.width())
                               .arg(size.height());
      EXPECT_TRUE(shot.save(name));
      for (QWidget* part :
           {static_cast<QWidget*>(window->maps()), static_cast<QWidget*>(window->strip()),
            static_cast<QWidget*>(window->inspector()), static_cast<QWidget*>(window->viewport())}) {
        EXPECT_TRUE(window->rect().contains(QRect(part->mapTo(window.get(), QPoint()), part->size())))
            << part->objectName().toStdString();
      }
      QSet<QRgb> colours;
      const QPoint corner = window->maps()->view()->mapTo(window.get(), QPoint());
      for (int y = 0; y < window->maps()->view()->height(); y += 7)
        for (int x = 0; x < window->maps()->view()->width(); x += 7)
          colours.insert(shot.pixel((corner + QPoint(x, y)) * shot.devicePixelRatio()));
      EXPECT_GT(colours.size(), 3) << kind.id << " is blank";
    }
  }
}

}  // namespace
}  // namespace patina::test
