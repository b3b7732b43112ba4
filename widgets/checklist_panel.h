#pragma once

#include <QWidget>
#include <vector>

#include "engine/acquire/capture_checks.h"

class QGridLayout;
class QLabel;
class QPushButton;

namespace patina {

/// The checklist as lines: state, what was found, how to mend it.
class ChecklistPanel : public QWidget {
  Q_OBJECT

 public:
  explicit ChecklistPanel(QWidget* parent = nullptr);
  /// `words`: exposure and such, under the list.
  void setChecklist(const Checklist& list, const QString& words);
  void clear(const QString& words);
  /// While the rig is looked at; `share`: how far, 0..1.
  void setChecking(bool checking, double share = 0);
  void setMayCheck(bool possible, const QString& whyNot);

  QPushButton* checkButton() { return check_; }
  int lines() const { return static_cast<int>(rows_.size()); }
  QString lineText(int line) const;

 Q_SIGNALS:
  void checkRequested();

 private:
  struct Row {
    QLabel *mark, *title, *found, *mend;
  };
  std::vector<Row> rows_;
  QWidget* list_;
  QGridLayout* grid_;
  QLabel* words_;
  QPushButton* check_;
  bool checking_ = false, checked_ = false;
};

}  // namespace patina
