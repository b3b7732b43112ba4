#pragma once

#include <QFrame>

#include "engine/base/result.h"

class QLabel;
class QToolButton;

namespace patina {

/// A strip over the window's content that says what went wrong, where, and what to try. Nothing is blocked;
/// it stays until it is closed or the next open succeeds.
class ErrorBanner : public QFrame {
  Q_OBJECT

 public:
  enum class Kind { Problem, Notice };
  explicit ErrorBanner(QWidget* parent = nullptr);
  /// `doing` says what was attempted: "Opening clean_laminate".
  void showError(const QString& doing, const Error& error);
  void showNotice(const QString& sentence);
  Kind kind() const { return kind_; }
  /// All of its text, for tests and the clipboard.
  QString text() const;

 private:
  void present(Kind kind);
  QLabel *what_, *where_, *tryThis_;
  QToolButton* close_;
  Kind kind_ = Kind::Notice;
};

}  // namespace patina
