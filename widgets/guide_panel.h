#pragma once

#include <QWidget>
#include <vector>

#include "widgets/guide_step.h"

class QLabel;
class QListWidget;
class QPushButton;
class QStackedWidget;

namespace patina {

/// Leads through steps in order: on the left all of them with their states, on the right what to do now. No
/// step begins before those before it let it.
class GuidePanel : public QWidget {
  Q_OBJECT

 public:
  /// `title`: of the whole task, over the list.
  explicit GuidePanel(const QString& title, QWidget* parent = nullptr);
  ~GuidePanel() override;

  /// Takes the step over.
  void addStep(GuideStep* step);
  const std::vector<GuideStep*>& steps() const { return steps_; }
  int current() const { return current_; }  ///< -1: none is entered
  /// Whether all before it let it begin.
  bool mayEnter(int step) const;
  /// Shows a step; false where it may not begin.
  bool goTo(int step);
  /// Shows the step it was at, or the first; leaves it. The window calls these as the page comes and goes.
  void enter();
  void leave();

  QListWidget* list() { return list_; }
  QPushButton* nextButton() { return next_; }
  QPushButton* backButton() { return back_; }
  QPushButton* closeButton() { return close_; }
  QString sentence() const;

 Q_SIGNALS:
  /// Next on the last step.
  void finished();
  void closeRequested();
  void stepChanged(int step);

 private:
  void refresh();
  void refreshList();

  std::vector<GuideStep*> steps_;
  std::vector<QWidget*> bodies_;  ///< null until first shown
  int current_ = -1, remembered_ = 0;
  bool shown_ = false;
  QListWidget* list_;
  QLabel *title_, *sentence_, *whyNot_;
  QStackedWidget* stack_;
  QPushButton *back_, *next_, *close_;
};

}  // namespace patina
