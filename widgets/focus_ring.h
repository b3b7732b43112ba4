#pragma once

#include <QFocusEvent>
#include <QPainter>
#include <QWidget>

#include "widgets/theme.h"

namespace patina {

/// Draws where the keyboard is, but only for those who got there by keyboard: after a click the cursor says
/// it.
class FocusRing {
 public:
  void focusChanged(const QFocusEvent& event) {
    shown_ = event.gotFocus() &&
             (event.reason() == Qt::TabFocusReason || event.reason() == Qt::BacktabFocusReason ||
              event.reason() == Qt::ShortcutFocusReason);
  }
  bool shown() const { return shown_; }
  void paint(QPainter& painter, const QWidget& widget) const {
    if (!shown_) return;
    painter.save();
    painter.setRenderHint(QPainter::Antialiasing, false);
    painter.setPen(theme::kAccent);
    painter.setBrush(Qt::NoBrush);
    painter.drawRect(widget.rect().adjusted(0, 0, -1, -1));
    painter.restore();
  }

 private:
  bool shown_ = false;
};

}  // namespace patina
