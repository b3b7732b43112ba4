#pragma once

#include <QPointer>
#include <memory>

#include "app/window/rig/calibration_store.h"
#include "app/window/rig/photograph.h"
#include "app/window/rig/rig_controller.h"
#include "app/window/rig/simulated_hands.h"
#include "widgets/board_watcher.h"
#include "widgets/guide_step.h"

class QComboBox;
class QLabel;
class QProgressBar;
class QPushButton;
class QVBoxLayout;

namespace patina {

/// What all calibration steps share: the live picture on the left; on the right what is kept from earlier,
/// the step's own controls, what a simulated rig's operator can do, and the result in words. A result is kept
/// by `keep`, an earlier one is used again after a recheck against one fresh photograph.
class CalibrationStep : public GuideStep {
  Q_OBJECT

 public:
  ~CalibrationStep() override;
  QWidget* body(QWidget* parent) override;
  void enter() override;
  void leave() override;
  State state() const override { return state_; }
  QString note() const override;
  QString whyNot() const override;

  LiveView* view() const { return view_; }
  /// What the step says of its last work: result, or what is wrong and what to try.
  QString said() const;
  /// A button by its object name, for tests: "KIND-reuse", "KIND-cancel" and the step's own.
  QPushButton* button(const QString& name) const;
  const std::string& kind() const { return kind_; }
  /// The calibration that this session uses; null: none yet.
  const CalibrationRecord* record() const { return record_ ? &*record_ : nullptr; }

 protected:
  /// `kind`: of the file that it gives, as `kindOf` says.
  CalibrationStep(RigController& rig, std::string kind);

  /// Adds the step's own controls.
  virtual void buildControls(QVBoxLayout* column, QWidget* parent) = 0;
  /// What stands under the live picture; null: nothing.
  virtual QWidget* belowPicture(QWidget*) { return nullptr; }
  /// A live frame came while the step is on show.
  virtual void frameCame(const LiveFramePtr&) {}
  /// Whether the live picture's exposure is set by the step where it is too dark or clipped.
  virtual bool setsExposure() const { return true; }
  /// Judges an earlier one by a fresh photograph; on a worker thread. Empty function: one photograph can't
  /// tell, and it is used with that said.
  using Rechecker = std::function<Result<Recheck>(const CalibrationRecord&, const Photograph&, CameraDevice&,
                                                  const JobContext&)>;
  virtual Rechecker rechecker() const { return {}; }
  /// What a recheck needs on the screen or the table first; empty: nothing.
  virtual QString recheckHint() const { return {}; }
  /// Shows on the screen what the recheck needs.
  virtual void prepareRecheck() {}
  /// Called when a job of the step begins or ends, and when anything changed that buttons depend on.
  virtual void refreshControls() {}

  RigController& rig() const { return rig_; }
  /// How the camera's frames become light: with its response, where one is kept.
  FrameConversion conversion() const;
  CalibrationStore store() const { return CalibrationStore(rig_.folder()); }
  bool entered() const { return entered_; }
  bool working() const { return working_; }
  /// Whether a photograph can be taken now; else the sentence is said.
  bool mayPhotograph();

  /// Runs a job of the step: its progress is shown and it can be cancelled; what fails is said in the step.
  template <typename Value>
  void work(const QString& doing, std::function<Result<Value>(const JobContext&)> task,
            std::function<void(Value)> done) {
    if (rig_.busy()) return say(tr("Wait until the work that is going on is over."), Tone::Problem);
    beginWork(doing);
    const bool started =
        rig_.run<Value>(doing, std::move(task), [this, done = std::move(done)](Result<Value> outcome) {
          endWork(outcome.ok() ? nullptr : &outcome.error());
          if (outcome) done(std::move(*outcome));
          refresh();
        });
    if (!started) endWork(nullptr);
  }
  /// Photographs with the camera, then `done` in the window's thread.
  void photograph(const QString& doing, const PhotographOptions& options,
                  std::function<void(Photograph)> done);

  enum class Tone { Plain, Good, Problem };
  void say(const QString& text, Tone tone = Tone::Plain);
  /// Keeps a result: the step is done. False, and said, where it can't be written.
  bool keep(StoredCalibration content, double residual, const char* unit,
            const std::vector<std::string>& remarks, const Image* map = nullptr);
  void setFailed();
  void setToDo();
  /// The device that the calibration is of: the camera's name.
  virtual std::string deviceName() const;

  /// A button; `name`: its object name.
  static QPushButton* makeButton(QWidget* parent, const QString& text, const QString& name, bool primary);
  static QLabel* makeCaption(QWidget* parent, const QString& text);
  /// What an operator would do at a real rig; runs on a worker thread.
  using HandAct = std::function<void(SimulatedHands&)>;
  /// A button for it, on show with a simulated rig only. `make`: called in the window's thread at each click.
  void addHand(const QString& text, const QString& name, std::function<HandAct()> make);
  /// The same at once, where the rig is simulated.
  void doByHand(HandAct act);
  void refresh();

 private:
  void beginWork(const QString& doing);
  void endWork(const Error* error);
  void showProgress(qint64 done, qint64 total);
  void reuse();
  void fillKept();
  void judgeExposure(const LiveFramePtr& frame);

  RigController& rig_;
  std::string kind_;
  State state_ = State::ToDo;
  std::optional<CalibrationRecord> record_;
  bool entered_ = false, working_ = false;
  int exposureTries_ = 0;
  QPointer<QWidget> body_;
  LiveView* view_ = nullptr;
  QWidget *keptBox_ = nullptr, *handsBox_ = nullptr, *workBox_ = nullptr;
  QVBoxLayout* hands_ = nullptr;
  QComboBox* kept_ = nullptr;
  QLabel *said_ = nullptr, *doing_ = nullptr, *keptHint_ = nullptr;
  QPushButton *reuse_ = nullptr, *cancel_ = nullptr;
  QProgressBar* progress_ = nullptr;
};

/// A line about the corners of a board, for under the live picture.
QString sightingInWords(const BoardDetection& found, const Board& board);
/// An error as sentences for a person: what, where, what to try.
QString sentencesOf(const Error& error);

}  // namespace patina
