#pragma once

#include <QLabel>

namespace patina {

/// A label of plain text that gives up its end, not its neighbours' room, where space is short; the whole
/// text is then its tooltip.
class ElidedLabel : public QLabel {
  Q_OBJECT

 public:
  using QLabel::QLabel;
  QSize minimumSizeHint() const override { return {40, QLabel::minimumSizeHint().height()}; }

 protected:
  void paintEvent(QPaintEvent* event) override;
};

}  // namespace patina
