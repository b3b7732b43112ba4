#pragma once

#include <QWidget>
#include <memory>
#include <vector>

#include "engine/diagnosis/explanation.h"
#include "widgets/explain_pictures.h"

class QLabel;
class QPushButton;
class QScrollArea;
class QSplitter;
class QStackedWidget;
class QTableWidget;

namespace patina {

class ElidedLabel;
class ExplainCard;
class ExplainDetails;

/// What the model lacks, for the bundle that is open: the verdict in a sentence, the photographs worst first,
/// residuals beside the noise to expect, the effects as cards, the budget. Before there is an explanation:
/// what it would do, and a button that starts it.
class ExplainPage : public QWidget {
  Q_OBJECT

 public:
  using ExplanationPtr = std::shared_ptr<const Explanation>;
  explicit ExplainPage(QWidget* parent = nullptr);

  /// What can be explained: a name for the person, and what it is ("62 photographs"). Empty: nothing is open.
  void setSubject(const QString& name, const QString& summary);
  /// Other bundles of the same rig or sample that are explained together with the open one.
  void setFurther(const QStringList& folders);
  /// While a job runs, nothing can be started here. `words`: what it does.
  void setRunning(bool running, const QString& words = {});
  /// Null takes the last one away. `views`: of its pictures, made by a worker. `mayRefit`: the engine can fit
  /// again with an effect of the person's choice.
  void setExplanation(ExplanationPtr explanation, ResidualViews views, bool mayRefit);
  ExplanationPtr explanation() const { return explanation_; }
  /// The window shows maps or pictures of the bundle that one can go back to.
  void setMayGoBack(bool possible);

  QString verdict() const;
  QString numbers() const;
  QTableWidget* photographs() { return table_; }
  ExplainPictures* pictures() { return pictures_; }
  ExplainDetails* details() { return details_; }
  std::vector<ExplainCard*> cards() const { return cards_; }
  QPushButton* startButton() { return start_; }
  QPushButton* againButton() { return again_; }
  QPushButton* saveButton() { return save_; }
  QPushButton* backButton() { return back_; }

  QByteArray saveLayout() const;
  void restoreLayout(const QByteArray& state);

 Q_SIGNALS:
  void startRequested();
  void backRequested();
  void saveRequested();
  void furtherRequested();  ///< another bundle is to be chosen
  void furtherCleared();
  void takeFitRequested();
  void refitRequested(QString id);

 private:
  void buildStart();
  void buildResult();
  void refreshHeader();
  void refreshTable();
  void refreshCards(bool mayRefit);
  void showRow(int row);

  ExplanationPtr explanation_;
  QString name_, summary_;
  bool running_ = false;

  QStackedWidget* pages_;
  QWidget *startPage_, *resultPage_;
  QLabel *invitation_, *furtherLabel_;
  QPushButton *start_, *further_, *clearFurther_, *startBack_;
  QLabel *verdict_, *numbers_;
  QPushButton *again_, *save_, *back_;
  QSplitter *columns_, *middle_;
  QTableWidget* table_;
  ExplainPictures* pictures_;
  ExplainDetails* details_;
  QScrollArea* scroll_;
  std::vector<ExplainCard*> cards_;
};

}  // namespace patina
