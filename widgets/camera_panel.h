#pragma once

#include <QWidget>
#include <vector>

#include "engine/acquire/camera_device.h"
#include "widgets/live_view.h"

class QComboBox;
class QDoubleSpinBox;
class QFormLayout;
class QLabel;
class QListWidget;
class QPushButton;
class QSlider;

namespace patina {

/// Bars of how many pixels have which value, R G B over each other, the clipped end marked.
class HistogramView : public QWidget {
  Q_OBJECT

 public:
  explicit HistogramView(QWidget* parent = nullptr);
  void setFrame(LiveFramePtr frame);
  QSize sizeHint() const override { return {260, 90}; }
  QSize minimumSizeHint() const override { return {120, 60}; }

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  LiveFramePtr frame_;
};

/// Cameras to choose from, the live picture of the one that is open, its formats and controls. Knows no
/// device: it is told what there is and says what the person wants.
class CameraPanel : public QWidget {
  Q_OBJECT

 public:
  explicit CameraPanel(QWidget* parent = nullptr);

  void setCameras(const std::vector<CameraInfo>& cameras, const QString& preselected);
  void setLooking(bool looking);
  /// The camera that is open; empty: none. `problem`: why it sends nothing.
  void setOpened(const QString& id, const QString& problem);
  void setFormats(const std::vector<FrameFormat>& formats, const FrameFormat& current);
  void setControls(const std::vector<CameraControl>& controls);
  void setFrame(LiveFramePtr frame);
  void setRemarks(const QStringList& sentences);

  LiveView* view() { return view_; }
  QListWidget* list() { return list_; }
  QPushButton* useButton() { return use_; }
  QDoubleSpinBox* spinBox(CameraControlId id) const;

 Q_SIGNALS:
  void lookRequested();
  void openRequested(QString id);
  void folderRequested();
  void rigFileRequested();
  void formatRequested(int index);
  void controlRequested(patina::CameraControlId id, double value);

 private:
  struct Row {
    CameraControl control;
    QDoubleSpinBox* spin = nullptr;
    QSlider* slider = nullptr;
    QLabel* readBack = nullptr;
  };
  Row makeRow(const CameraControl& control);
  void updateRow(Row& row, const CameraControl& control);
  void refreshUse();

  std::vector<CameraInfo> cameras_;
  QString opened_;
  QListWidget* list_;
  QPushButton *look_, *use_, *folder_, *rigFile_;
  LiveView* view_;
  HistogramView* histogram_;
  QLabel *clipped_, *remarks_, *noControls_;
  QComboBox* formats_;
  QWidget* controlsBox_;
  QFormLayout* controls_;
  std::vector<Row> rows_;
};

}  // namespace patina
