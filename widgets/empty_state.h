#pragma once

#include <QStringList>
#include <QWidget>

class QLabel;
class QPushButton;
class QVBoxLayout;

namespace patina {

/// What the window shows while nothing is open: what to do, and what was open lately.
class EmptyState : public QWidget {
  Q_OBJECT

 public:
  explicit EmptyState(QWidget* parent = nullptr);
  void setRecent(const QStringList& folders);
  /// Something that can be opened is held over the window.
  void setDropHint(bool held);
  void setBusy(const QString& what);

 Q_SIGNALS:
  void openRequested();
  void openFitRequested();
  void simulateRequested();
  void captureRequested(bool twoShot);
  void recentRequested(QString folder);

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  QLabel *title_, *text_, *recentTitle_;
  QPushButton* open_;
  QPushButton* openFit_;
  QPushButton* simulate_;
  QPushButton *capture_, *captureTwoShot_;
  QVBoxLayout* recent_;
  QWidget* card_;
  bool held_ = false;
};

}  // namespace patina
