#pragma once

#include <QTabWidget>
#include <memory>

#include "engine/diagnosis/explanation.h"

class QLabel;
class QTableWidget;
class QVBoxLayout;

namespace patina {

/// Below the pictures: where the residual sits, what could hide in the photographs (the budget), and remarks.
class ExplainDetails : public QTabWidget {
  Q_OBJECT

 public:
  explicit ExplainDetails(QWidget* parent = nullptr);
  /// Null takes everything away.
  void setExplanation(std::shared_ptr<const Explanation> explanation);
  QTableWidget* budget() { return budget_; }
  QString remarks() const;

 private:
  void refreshBreakdowns();
  void refreshBudget();
  void refreshRemarks();

  std::shared_ptr<const Explanation> explanation_;
  QWidget* breakdowns_;
  QTableWidget* budget_;
  QLabel* remarks_;
};

}  // namespace patina
