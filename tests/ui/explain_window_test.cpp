// The page Explain, driven, with a made-up explanation in the engine's place.
#include <QAction>
#include <QElapsedTimer>
#include <QLabel>
#include <QPushButton>
#include <QTableWidget>
#include <fstream>
#include <thread>

#include "app/window/explain_controller.h"
#include "app/window/two_shot_controller.h"
#include "engine/report/explanation_words.h"
#include "tests/report/made_up_explanation.h"
#include "tests/ui/fake_fit.h"
#include "tests/ui/two_shot_fake.h"
#include "tests/ui/ui_fixture.h"
#include "widgets/comparison_view.h"
#include "widgets/error_banner.h"
#include "widgets/explain_card.h"
#include "widgets/explain_details.h"
#include "widgets/explain_page.h"
#include "widgets/image_view.h"
#include "widgets/plot_widget.h"

namespace patina::test {
namespace {

using Paths = std::vector<std::filesystem::path>;

/// What the fakes were asked.
struct Asked {
  Paths bundles;
  std::vector<std::string> ids;
  int times = 0;
};

struct FakeExplainOptions {
  int delayMs = 0;
  bool mayRefit = true;
  bool fails = false;
  bool clean = false;
};

Services explainServices(const std::shared_ptr<Asked>& asked, const FakeExplainOptions& fake = {}) {
  Services services = fakeServices();
  const auto explained = [asked, fake](const Paths& bundles, const std::vector<std::string>& ids,
                                       const JobContext& job) -> Result<ExplanationPtr> {
    asked->bundles = bundles;
    asked->ids = ids;
    ++asked->times;
    QElapsedTimer timer;
    timer.start();
    for (const char* stage : {"fit", "residual", "score", "refit"})
      while (timer.elapsed() < fake.delayMs && !job.cancelled()) {
        job.progress(stage, timer.elapsed(), fake.delayMs, "texels");
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
      }
    if (fake.fails)
      return Error{ErrorCode::Invalid, "the bundles don't belong together", bundles.front().string(),
                   "explain them one by one"};
    auto made = std::make_shared<Explanation>(fake.clean ? madeUpCleanExplanation() : madeUpExplanation());
    made->bundles = bundles;
    made->cancelled = job.cancelled();
    if (!ids.empty()) {
      // What the person asked for is in the model now.
      EffectFinding chosen;
      for (std::size_t i = 0; i < made->considered.size(); ++i)
        if (made->considered[i].id == ids.back()) {
          chosen = made->considered[i];
          made->considered.erase(made->considered.begin() + static_cast<std::ptrdiff_t>(i));
          break;
        }
      chosen.added = true;
      made->effects.push_back(chosen);
    }
    if (const auto capture = readFourierCapture(bundles.front()))
      made->fourierBefore = made->fourierAfter = std::make_shared<const FakeFit>(*capture, 24, 16);
    return ExplanationPtr(made);
  };
  services.explain = [explained](const Paths& bundles, const ExplainOptions&, const JobContext& job) {
    return explained(bundles, {}, job);
  };
  services.explainWith = nullptr;
  if (fake.mayRefit)
    services.explainWith = [explained](const Paths& bundles, const std::vector<std::string>& ids,
                                       const ExplainOptions&,
                                       const JobContext& job) { return explained(bundles, ids, job); };
  return services;
}

class ExplainTest : public WindowTest {
 protected:
  std::unique_ptr<MainWindow> explainedWindow(const FakeExplainOptions& fake = {}) {
    auto window = makeWindow(explainServices(asked_, fake));
    open(*window, smallBundle());
    window->action("explain")->trigger();
    EXPECT_TRUE(until([&] { return !window->fitting(); }));
    return window;
  }
  static ExplainPage* pageOf(MainWindow& window) { return window.explanation()->page(); }
  static ExplainCard* cardOf(MainWindow& window, const std::string& id) {
    for (ExplainCard* card : pageOf(window)->cards())
      if (card->id() == id) return card;
    return nullptr;
  }
  std::shared_ptr<Asked> asked_ = std::make_shared<Asked>();
};

TEST_F(ExplainTest, CtrlEExplainsTheOpenBundleAndShowsWhatWasFound) {
  auto window = explainedWindow();
  EXPECT_EQ(window->action("explain")->shortcut(), QKeySequence(Qt::CTRL | Qt::Key_E));
  ASSERT_TRUE(window->explainShown());
  EXPECT_EQ(asked_->bundles, Paths{smallBundle()});
  ExplainPage* page = pageOf(*window);
  ASSERT_NE(page->explanation(), nullptr);
  EXPECT_EQ(page->verdict().toStdString(), verdictOf(*page->explanation()).headline);
  EXPECT_TRUE(page->numbers().contains("4.83 % before, 1.12 % after")) << page->numbers().toStdString();
  // Worst first, held-out ones marked.
  QTableWidget* table = page->photographs();
  ASSERT_EQ(table->rowCount(), 40);
  EXPECT_TRUE(table->item(0, 2)->text().startsWith("9.00"));
  EXPECT_TRUE(table->item(0, 0)->toolTip().contains("Held out"));
  EXPECT_FALSE(table->isColumnHidden(3));
  EXPECT_EQ(page->pictures()->shown(), 0);
  // What a card says.
  ASSERT_GE(page->cards().size(), 4u);
  EXPECT_EQ(page->cards().front()->id(), "anisotropy");
  const QString card = page->cards().front()->text();
  for (const char* words :
       {"Brushed or stretched highlights", "overwhelming", "214", "confidence 98 %", "ratio 1.32",
        "Highlights are 1.32 times longer", "4.83 % without it, 1.31 % with it"})
    EXPECT_TRUE(card.contains(words)) << words << "\n" << card.toStdString();
  EXPECT_EQ(page->cards().front()->findChildren<PlotWidget*>().size(), 2);
  EXPECT_EQ(page->details()->budget()->rowCount(), 2);
  EXPECT_EQ(page->details()->budget()->item(1, 1)->text(), "shift 1.2 mm");
  EXPECT_TRUE(page->details()->remarks().contains("turned by 90 degrees"));
  // A second time the key only shows the page.
  window->action("explain-back")->trigger();
  EXPECT_FALSE(window->explainShown());
  window->action("explain")->trigger();
  EXPECT_TRUE(window->explainShown());
  EXPECT_EQ(asked_->times, 1);
  QTest::mouseClick(page->againButton(), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return !window->fitting(); }));
  EXPECT_EQ(asked_->times, 2);
}

TEST_F(ExplainTest, SaysWhyNotWhereNothingIsOpen) {
  auto window = makeWindow(explainServices(asked_));
  EXPECT_FALSE(window->action("explain")->isEnabled());
  EXPECT_TRUE(window->action("explain")->toolTip().contains("no bundle is open"));
  EXPECT_FALSE(window->action("explain-save")->isEnabled());
  window->action("explain")->trigger();
  EXPECT_FALSE(window->explainShown());
  EXPECT_EQ(asked_->times, 0);
}

TEST_F(ExplainTest, PicturesFollowTheListAndTheTabs) {
  auto window = explainedWindow();
  ExplainPage* page = pageOf(*window);
  ExplainPictures* pictures = page->pictures();
  ASSERT_NE(pictures->comparison()->captured(), nullptr);
  ASSERT_NE(pictures->comparison()->rendered(), nullptr) << "before and after under a wipe";
  ASSERT_NE(pictures->expected()->picture(), nullptr);
  EXPECT_TRUE(pictures->expected()->isVisible());
  EXPECT_TRUE(pictures->caption().contains("times the noise")) << pictures->caption().toStdString();
  const Image first = *pictures->comparison()->captured();

  page->photographs()->setFocus();
  QTest::keyClick(page->photographs(), Qt::Key_Down);
  EXPECT_EQ(pictures->shown(), 1);
  const Image* second = pictures->comparison()->captured();
  ASSERT_NE(second, nullptr);
  EXPECT_FALSE(std::ranges::equal(first.samples(), second->samples()));
  QTest::keyClick(page->photographs(), Qt::Key_End, Qt::ControlModifier);
  EXPECT_EQ(pictures->shown(), -1) << "no picture of the best was kept";
  EXPECT_EQ(pictures->comparison()->captured(), nullptr);
  EXPECT_FALSE(pictures->expected()->isVisible());
  QTest::keyClick(page->photographs(), Qt::Key_Home, Qt::ControlModifier);

  pictures->setMode(ExplainPictures::Mode::Photograph);
  ASSERT_NE(pictures->comparison()->rendered(), nullptr);
  EXPECT_FALSE(pictures->expected()->isVisible());
  pictures->setMode(ExplainPictures::Mode::Place);
  ASSERT_NE(pictures->comparison()->captured(), nullptr);
  EXPECT_TRUE(pictures->caption().contains("noise alone is 1"));

  // The wipe by keyboard.
  pictures->setMode(ExplainPictures::Mode::Residual);
  pictures->comparison()->setFocus();
  QTest::keyClick(pictures->comparison(), Qt::Key_End);
  EXPECT_DOUBLE_EQ(pictures->comparison()->divider(), 1);
  QTest::keyClick(pictures->comparison(), Qt::Key_Left);
  EXPECT_LT(pictures->comparison()->divider(), 1);
}

TEST_F(ExplainTest, ACleanBundleHasNoAfter) {
  FakeExplainOptions fake;
  fake.clean = true;
  auto window = explainedWindow(fake);
  ExplainPage* page = pageOf(*window);
  EXPECT_TRUE(page->verdict().startsWith("Nothing is missing"));
  EXPECT_TRUE(page->photographs()->isColumnHidden(3));
  EXPECT_EQ(page->pictures()->comparison()->rendered(), nullptr);
  EXPECT_EQ(cardOf(*window, "anisotropy"), nullptr);
}

TEST_F(ExplainTest, TheFitWithTheEffectsGoesIntoTheWindowAndBackOut) {
  auto window = explainedWindow();
  EXPECT_EQ(window->document()->fit(), nullptr) << "looking at an explanation changes nothing";
  ExplainCard* card = cardOf(*window, "flicker");
  ASSERT_NE(card, nullptr);
  ASSERT_NE(card->button(), nullptr);
  EXPECT_EQ(card->button()->text(), "Show the fit with it");
  QTest::mouseClick(card->button(), Qt::LeftButton);
  EXPECT_EQ(window->document()->fit(), pageOf(*window)->explanation()->fourierAfter);
  EXPECT_FALSE(window->explainShown());
  EXPECT_TRUE(window->windowTitle().contains("not saved"));
  window->action("undo")->trigger();
  EXPECT_EQ(window->document()->fit(), nullptr);
}

TEST_F(ExplainTest, AddAndRefitAsksForWhatWasAddedAndTheOneMore) {
  auto window = explainedWindow();
  ExplainCard* card = cardOf(*window, "screen-pose");
  ASSERT_NE(card, nullptr);
  ASSERT_NE(card->button(), nullptr);
  EXPECT_EQ(card->button()->text(), "Add and refit");
  QTest::keyClick(card->button(), Qt::Key_Space);
  ASSERT_TRUE(until([&] { return !window->fitting(); }));
  EXPECT_EQ(asked_->ids, (std::vector<std::string>{"anisotropy", "flicker", "screen-pose"}));
  card = cardOf(*window, "screen-pose");
  ASSERT_NE(card, nullptr);
  EXPECT_TRUE(card->text().contains("added")) << card->text().toStdString();
  EXPECT_EQ(card->button()->text(), "Show the fit with it");
}

TEST_F(ExplainTest, WithoutARefitThereIsNoButtonForIt) {
  FakeExplainOptions fake;
  fake.mayRefit = false;
  auto window = explainedWindow(fake);
  ASSERT_NE(cardOf(*window, "screen-pose"), nullptr);
  EXPECT_EQ(cardOf(*window, "screen-pose")->button(), nullptr);
  EXPECT_NE(cardOf(*window, "anisotropy")->button(), nullptr);
}

TEST_F(ExplainTest, CancelKeepsWhatWasFoundAndMarksIt) {
  FakeExplainOptions fake;
  fake.delayMs = 20000;
  auto window = makeWindow(explainServices(asked_, fake));
  open(*window, smallBundle());
  window->action("explain")->trigger();
  ASSERT_TRUE(window->fitting());
  EXPECT_FALSE(pageOf(*window)->startButton()->isEnabled());
  EXPECT_FALSE(window->action("fit")->isEnabled());
  auto* stage = window->findChild<QLabel*>("stage");
  ASSERT_TRUE(until([&] { return stage->text().contains("Fitting the standard model"); }))
      << stage->text().toStdString();
  window->action("cancel")->trigger();
  ASSERT_TRUE(until([&] { return !window->fitting(); }, 3000));
  ASSERT_NE(pageOf(*window)->explanation(), nullptr);
  EXPECT_TRUE(pageOf(*window)->verdict().startsWith("Stopped before the end"));
  EXPECT_TRUE(pageOf(*window)->againButton()->isEnabled());
}

TEST_F(ExplainTest, AFailureIsToldInTheBanner) {
  FakeExplainOptions fake;
  fake.fails = true;
  auto window = explainedWindow(fake);
  EXPECT_EQ(window->banner()->kind(), ErrorBanner::Kind::Problem);
  EXPECT_TRUE(window->banner()->text().contains("don't belong together"));
  EXPECT_EQ(pageOf(*window)->explanation(), nullptr);
  EXPECT_TRUE(pageOf(*window)->startButton()->isEnabled()) << "one can try again";
}

TEST_F(ExplainTest, FurtherBundlesAreExplainedTogether) {
  auto window = makeWindow(explainServices(asked_));
  open(*window, smallBundle());
  window->showExplain(true);
  ASSERT_TRUE(window->explainShown());
  const auto other = spoilableBundle("other view");
  window->explanation()->addFurther(QString::fromStdString(other.string()));
  window->explanation()->addFurther(QString::fromStdString((other / "capture.json").string()));
  window->explanation()->addFurther(QString::fromStdString(smallBundle().string()));
  EXPECT_EQ(window->explanation()->further().size(), 1) << "neither twice nor the open one";
  QTest::mouseClick(pageOf(*window)->startButton(), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return !window->fitting(); }));
  EXPECT_EQ(asked_->bundles, (Paths{smallBundle(), other}));
  // Another bundle is another rig: nothing of the last one stays.
  open(*window, other);
  EXPECT_FALSE(window->explainShown());
  EXPECT_EQ(pageOf(*window)->explanation(), nullptr);
  EXPECT_TRUE(window->explanation()->further().isEmpty());
}

TEST_F(ExplainTest, TheReportIsSavedAndNeverIntoTheBundle) {
  auto window = explainedWindow();
  const QString folder = temporary_.filePath("report");
  window->saveExplanationTo(folder);
  ASSERT_TRUE(until([&] { return !window->saving(); }));
  EXPECT_FALSE(window->banner()->isVisible()) << window->banner()->text().toStdString();
  for (const char* file : {"report.html", "explain.json", "fit.json", "maps/diffuse.exr"})
    EXPECT_TRUE(std::filesystem::exists(std::filesystem::path(folder.toStdString()) / file)) << file;
  EXPECT_TRUE(window->explanation()->saved());
  window->saveExplanationTo(QString::fromStdString(smallBundle().string()));
  ASSERT_TRUE(until([&] { return !window->saving(); }));
  EXPECT_EQ(window->banner()->kind(), ErrorBanner::Kind::Problem);
  EXPECT_FALSE(std::filesystem::exists(smallBundle() / "report.html"));
}

TEST_F(ExplainTest, AnUnsavedReportIsAskedAbout) {
  auto window = explainedWindow();
  QString asked;
  window->setAsk([&](const QString& title, const QString&, const QString&, bool) {
    asked = title;
    return MainWindow::Answer::Stay;
  });
  window->close();
  EXPECT_TRUE(window->isVisible());
  EXPECT_TRUE(asked.contains("report")) << asked.toStdString();
}

TEST_F(ExplainTest, ATwoShotBundleIsExplainedToo) {
  const auto bundle = temporary() / "two";
  simulateTwoShotBundle(bundle);
  Services services = explainServices(asked_);
  services.fitTwoShot = fakeTwoShotServices().fitTwoShot;
  auto window = makeWindow(services);
  window->openPath(QString::fromStdString(bundle.string()));
  ASSERT_TRUE(until([&] { return !window->opening(); }));
  ASSERT_TRUE(window->twoShot()->isOpen());
  window->action("explain")->trigger();
  ASSERT_TRUE(until([&] { return !window->fitting(); }));
  EXPECT_TRUE(window->explainShown());
  EXPECT_EQ(asked_->bundles, Paths{bundle});
  // Views of a reconstruction have nothing to show before there is one; the way back is there.
  EXPECT_FALSE(window->action("view-wipe")->isEnabled());
  window->action("explain-back")->trigger();
  EXPECT_FALSE(window->explainShown());
  window->action("fit")->trigger();
  ASSERT_TRUE(until([&] { return !window->fitting(); }));
  ASSERT_TRUE(window->twoShot()->fitted()) << window->banner()->text().toStdString();
  window->action("explain")->trigger();
  ASSERT_TRUE(window->explainShown());
  EXPECT_EQ(asked_->times, 1) << "what was found is shown again";
  ASSERT_TRUE(window->action("view-wipe")->isEnabled());
  window->action("view-wipe")->trigger();
  EXPECT_FALSE(window->explainShown()) << "a view of the reconstruction is asked for";
}

TEST_F(ExplainTest, FlashPhotographsOpenOnThePage) {
  const auto bundle = temporary() / "flash";
  FlashCapture capture;
  capture.folder = bundle;
  capture.widthMm = 80, capture.heightMm = 60;
  FlashPhoto photo;
  photo.file = "photo_0.png";
  photo.encoding = "srgb";
  photo.cameraPositionMm = photo.lightPositionMm = {0, 0, 300};
  capture.photos = {photo};
  std::filesystem::create_directories(bundle);
  std::ofstream(bundle / "photo_0.png") << "not read here";
  ASSERT_TRUE(writeFlashCapture(capture).ok());
  auto window = makeWindow(explainServices(asked_));
  window->openPath(QString::fromStdString(bundle.string()));
  ASSERT_TRUE(until([&] { return !window->opening(); }));
  ASSERT_TRUE(window->explainShown()) << window->banner()->text().toStdString();
  EXPECT_FALSE(window->action("fit")->isEnabled());
  EXPECT_FALSE(window->action("explain-back")->isEnabled());
  QTest::mouseClick(pageOf(*window)->startButton(), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return !window->fitting(); }));
  EXPECT_EQ(asked_->bundles, Paths{bundle});
  ASSERT_NE(pageOf(*window)->explanation(), nullptr);
  EXPECT_EQ(cardOf(*window, "anisotropy")->button(), nullptr) << "no maps in the window for it";
  open(*window, smallBundle());
  EXPECT_FALSE(window->explainShown());
  EXPECT_TRUE(window->action("fit")->isEnabled());
}

TEST_F(ExplainTest, TakesAnyExplanation) {
  for (const Explanation& made : {Explanation{}, hostileExplanation()}) {
    ExplainPage page;
    page.resize(900, 600);
    page.show();
    const auto shared = std::make_shared<const Explanation>(made);
    page.setExplanation(shared, residualViews(made), true);
    for (const auto mode :
         {ExplainPictures::Mode::Residual, ExplainPictures::Mode::Photograph, ExplainPictures::Mode::Place}) {
      page.pictures()->setMode(mode);
      page.grab();
    }
    for (int row = 0; row < page.photographs()->rowCount(); ++row) page.photographs()->setCurrentCell(row, 0);
  }
}

TEST_F(ExplainTest, LooksRightAtThreeSizes) {
  QDir().mkpath(PATINA_SCREENSHOT_DIR);
  auto window = explainedWindow();
  for (const QSize size : {QSize(1040, 700), QSize(1440, 900), QSize(1920, 1080)}) {
    window->resize(size);
    QTest::qWait(150);
    const QString file = QStringLiteral(PATINA_SCREENSHOT_DIR "/explain_%1.png").arg(size.width());
    ASSERT_TRUE(window->grab().save(file));
    ExplainPage* page = pageOf(*window);
    // Nothing is squeezed to nothing, nothing sticks out.
    for (QWidget* part :
         {static_cast<QWidget*>(page->photographs()), static_cast<QWidget*>(page->pictures()),
          static_cast<QWidget*>(page->details()), static_cast<QWidget*>(page->pictures()->comparison())}) {
      EXPECT_GE(part->width(), 150) << size.width();
      EXPECT_GE(part->height(), 90) << size.width();
      EXPECT_TRUE(window->rect().contains(QRect(part->mapTo(window.get(), QPoint()), part->size())))
          << size.width();
    }
    for (ExplainCard* card : page->cards()) EXPECT_GE(card->width(), 200);
  }
}

}  // namespace
}  // namespace patina::test
