#pragma once

#include <QWidget>
#include <vector>

#include "engine/acquire/capture_session.h"
#include "widgets/live_view.h"

class QLabel;
class QListWidget;
class QProgressBar;
class QPushButton;

namespace patina {

/// A Fourier capture as it goes on: plan, progress, the photograph that came last, and every photograph as a
/// thumbnail with its state.
class CapturePanel : public QWidget {
  Q_OBJECT

 public:
  enum class Mode { Ready, Running, Paused, Done };
  explicit CapturePanel(QWidget* parent = nullptr);

  /// The photographs to take; thumbnails are emptied.
  void setPlan(const CapturePlan& plan, const QString& words);
  void setMode(Mode mode, bool maybeResume);
  /// `whyNot`: why it can't be started; empty: it can.
  void setMayStart(const QString& whyNot);
  void setProgress(int taken, int total, const QString& now, const QString& left);
  /// A photograph came; `kept`: it counts. `picture` may be null (a photograph of an earlier session).
  void setPhoto(int photo, const PhotoState& state, LiveFramePtr picture, bool kept);
  void setWanted(int photo);  ///< will be taken again
  void setFolder(const QString& folder, const QString& words);

  QListWidget* strip() { return strip_; }
  QPushButton* startButton() { return start_; }
  QPushButton* pauseButton() { return pause_; }
  QPushButton* cancelButton() { return cancel_; }
  QPushButton* retakeButton() { return retake_; }
  QPushButton* folderButton() { return folder_; }
  QString planText() const;
  QString qualityText() const;

 Q_SIGNALS:
  void startRequested();
  void pauseRequested(bool paused);
  void cancelRequested();
  void retakeRequested(int photo);
  void folderRequested();

 private:
  void refreshSelected();
  void refreshButtons();
  struct Photo {
    QString name;
    PhotoState state;
    LiveFramePtr picture;
    bool wanted = false;
  };
  std::vector<Photo> photos_;
  Mode mode_ = Mode::Ready;
  bool resume_ = false;
  QString whyNot_;
  QLabel *plan_, *now_, *left_, *quality_, *folderWords_;
  QProgressBar* bar_;
  LiveView* view_;
  QListWidget* strip_;
  QPushButton *start_, *pause_, *cancel_, *retake_, *folder_;
};

}  // namespace patina
