#pragma once

#include <QElapsedTimer>
#include <QMainWindow>
#include <memory>
#include <optional>

#include "app/window/job_runner.h"
#include "app/window/progress_estimate.h"
#include "app/window/services.h"
#include "app/window/settings.h"
#include "widgets/document.h"

class QAction;
class QLabel;
class QMenu;
class QProgressBar;
class QPushButton;
class QSplitter;
class QStackedWidget;
class QToolBar;
class QUndoGroup;

namespace patina {

class CaptureGuides;
class EmptyState;
class ErrorBanner;
class ExplainController;
struct Explained;
class MapPanel;
class PhotoLibrary;
class PhotoStrip;
class TexelInspector;
class TwoShotController;
class ViewportPanel;

/// The window: one bundle of either kind, its photographs, its fit. Wires widgets to the engine's calls
/// through numbered jobs; never waits for one.
class MainWindow : public QMainWindow {
  Q_OBJECT

 public:
  /// `settingsFile`: where the state is kept; empty: the user's configuration folder.
  explicit MainWindow(Services services = Services::engine(), const QString& settingsFile = {},
                      QWidget* parent = nullptr);
  ~MainWindow() override;

  /// Opens a bundle or a saved fit: a folder, capture.json or fit.json. Returns at once; what is open is
  /// replaced when the new one is read.
  void openPath(const QString& path);
  /// Photographs a scene with the simulated rig and opens the bundle; returns at once. Kept in the user's
  /// data folder, replaced by the next capture of the same scene.
  void simulate(const std::string& scene);
  void startFit();
  /// Stops the fit, or the simulated capture, that is running.
  void cancelFit();
  /// What to do with a fit that is running or not saved, before it is lost.
  enum class Answer { Save, GoOn, Stay };
  using Ask =
      std::function<Answer(const QString& title, const QString& text, const QString& goOn, bool maySave)>;
  /// Replaces the question box (tests).
  void setAsk(Ask ask) { ask_ = std::move(ask); }
  /// Writes the fit into a folder.
  void saveFitTo(const QString& folder);

  /// Finds out what the model lacks, on the bundle that is open, and shows it; returns at once.
  void startExplain();
  /// Writes report, numbers and final fit into a folder.
  void saveExplanationTo(const QString& folder);
  /// The page that shows it, in place of maps or pictures.
  void showExplain(bool shown);
  bool explainShown() const;

  /// Leads through a capture with the rig, in place of what is open; `twoShot`: the other kind.
  void startCapture(bool twoShot);
  void leaveCapture();
  /// Made at first use.
  CaptureGuides* captureGuides();

  /// A Fourier bundle, or nothing while a two-shot bundle is open; and the other way round.
  Document* document() { return &document_; }
  TwoShotController* twoShot() { return twoShot_.get(); }
  ExplainController* explanation() { return explain_.get(); }
  PhotoLibrary* photos() { return library_; }
  PhotoStrip* strip() { return strip_; }
  MapPanel* maps() { return maps_; }
  TexelInspector* inspector() { return inspector_; }
  ViewportPanel* viewport() { return viewport_; }
  ErrorBanner* banner() { return banner_; }
  QAction* action(const QString& name) const;
  bool fitting() const { return fitJob_.running(); }
  bool opening() const { return openJob_.running(); }
  bool saving() const { return saveJob_.running(); }

 protected:
  void closeEvent(QCloseEvent* event) override;
  void dragEnterEvent(QDragEnterEvent* event) override;
  void dragLeaveEvent(QDragLeaveEvent* event) override;
  void dropEvent(QDropEvent* event) override;

 private:
  void buildContent();
  void buildActions();
  void buildStatusBar();
  void connectAll();
  QAction* addAction(QMenu* menu, const QString& name, const QString& text, const QKeySequence& key,
                     const QString& tip, std::function<void()> handler, const QString& iconName = {});
  /// Enables an action, or disables it and says why in its tooltip and status tip.
  void allow(const QString& name, bool possible, const QString& whyNot = {});
  void buildTwoShotViews();
  void refreshActions();
  void refreshTitle();
  void refreshRecent();
  void refreshHealth();
  void forget(const QString& path);  ///< takes it off the recent list
  /// What a job that opens something brings back: a capture, or a fit with the capture that it is of.
  struct Opened {
    std::shared_ptr<const FourierCapture> fourier;
    std::shared_ptr<const FourierFit> fourierFit;
    std::shared_ptr<const TwoShotCapture> twoShot;
    std::shared_ptr<const TwoShotFit> twoShotFit;
    std::shared_ptr<const FlashCapture> flash;
  };
  static Result<Opened> readBundle(const Services& services, const QString& path, const JobContext& job);
  static Result<Opened> readFit(const Services& services, const QString& folder, const JobContext& job);
  void take(const Opened& opened, const QString& path);
  void opened(std::shared_ptr<const FourierCapture> capture, const QString& path);
  void openedTwoShot(std::shared_ptr<const TwoShotCapture> capture, const QString& path);
  void openedFlash(std::shared_ptr<const FlashCapture> capture, const QString& path);
  void noteOpened(const QString& path, const std::vector<std::string>& ignoredKeys);
  void showOpenPage();
  bool somethingOpen() const;
  bool twoShotOpen() const;
  bool fitted() const;
  void fitDone(Result<std::shared_ptr<const FourierFit>> outcome);
  void twoShotFitDone(Result<std::shared_ptr<const TwoShotFit>> outcome);
  void connectExplain();
  void explainOrShow();
  void runExplain(std::function<Result<Explained>(const JobContext&)> work, const QString& words);
  void explainDone(Result<Explained> outcome);
  void takeExplainedFit();
  void chooseExplanationFolder();
  /// Folder of the bundle that is open, of whatever kind; empty: none.
  QString openBundle() const;
  void showPane(const QString& stage, const QString& cancelTip);
  void simulationDone();
  void showProgress(const QString& stage, qint64 done, qint64 total, const QString& unit);
  void restoreState();
  void keepState();
  /// True where nothing would be lost, or the person agrees. `doing`: "open another bundle".
  bool mayLoseFit(const QString& doing, const QString& goOn);
  void chooseBundle();
  void chooseFit();
  void chooseSaveFolder();
  void editOptions();
  void showAbout();
  void showShortcuts();
  void followTexel(std::optional<QPoint> texel);

  Services services_;
  Settings settings_;
  Document document_;
  std::unique_ptr<TwoShotController> twoShot_;
  std::unique_ptr<ExplainController> explain_;
  std::unique_ptr<CaptureGuides> guides_;
  std::shared_ptr<const FlashCapture> flash_;  ///< null unless such a bundle is open
  QUndoGroup* history_;
  PhotoLibrary* library_;

  QStackedWidget* pages_;
  EmptyState* empty_;
  ErrorBanner* banner_;
  QSplitter *columns_, *right_;
  QWidget* workspace_;
  MapPanel* maps_;
  PhotoStrip* strip_;
  ViewportPanel* viewport_;
  TexelInspector* inspector_;

  QToolBar* toolBar_;
  QLabel* bundleLabel_;
  QMenu *recentMenu_, *viewMenu_;
  QWidget* progressPane_;
  QLabel *stageLabel_, *leftLabel_, *healthLabel_;
  QProgressBar* progress_;
  QPushButton* cancelButton_;
  std::map<QString, QAction*> actions_;
  std::map<QString, QString> tips_;

  Ask ask_;
  std::optional<ProgressEstimate> estimate_;
  QString shownStage_;
  QElapsedTimer shownProgress_;
  QString openPath_, fitSavedTo_;
  bool fitIsSaved_ = true;
  bool simulating_ = false;     ///< what openJob_ is doing
  bool explainWanted_ = false;  ///< the page Explain instead of maps or pictures

  JobRunner openJob_, fitJob_,
      saveJob_;  ///< last: destroyed first, so that no job outlives what it reports to
};

}  // namespace patina
