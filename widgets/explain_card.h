#pragma once

#include <QFrame>

#include "engine/diagnosis/explanation.h"

class QPushButton;

namespace patina {

/// What a card's button does, if it has one.
enum class ExplainCardAction {
  None,
  TakeFit,  ///< an added effect: the fit that holds it goes into the window
  Refit,    ///< another: fit again with it
};

/// One effect that was added or considered: its name, evidence as a bar, what was found in words, its
/// signature expected against seen, and a button.
class ExplainCard : public QFrame {
  Q_OBJECT

 public:
  ExplainCard(const EffectFinding& finding, ExplainCardAction action, QWidget* parent = nullptr);
  const std::string& id() const { return id_; }
  /// Null where the card has none.
  QPushButton* button() { return button_; }
  /// Everything that it says, for tests and for readers of the screen.
  QString text() const;

 Q_SIGNALS:
  void pressed();

 private:
  std::string id_;
  QPushButton* button_ = nullptr;
};

}  // namespace patina
