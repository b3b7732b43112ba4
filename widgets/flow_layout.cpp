#include "widgets/flow_layout.h"

#include <QWidget>

namespace patina {

FlowLayout::FlowLayout(QWidget* parent, int spacing) : QLayout(parent), gap_(spacing) {}

FlowLayout::~FlowLayout() {
  for (QLayoutItem* item : items_) delete item;
}

void FlowLayout::addItem(QLayoutItem* item) {
  items_.push_back(item);
}

QLayoutItem* FlowLayout::itemAt(int index) const {
  return index >= 0 && index < count() ? items_[static_cast<std::size_t>(index)] : nullptr;
}

QLayoutItem* FlowLayout::takeAt(int index) {
  QLayoutItem* item = itemAt(index);
  if (item) items_.erase(items_.begin() + index);
  return item;
}

int FlowLayout::heightForWidth(int width) const {
  return arrange(QRect(0, 0, width, 0), false);
}

QSize FlowLayout::sizeHint() const {
  const QMargins margins = contentsMargins();
  int width = 0, height = 0;
  for (QLayoutItem* item : items_) {
    if (item->isEmpty()) continue;
    width += item->sizeHint().width() + gap_;
    height = std::max(height, item->sizeHint().height());
  }
  return {width + margins.left() + margins.right(), height + margins.top() + margins.bottom()};
}

QSize FlowLayout::minimumSize() const {
  const QMargins margins = contentsMargins();
  QSize size;
  for (QLayoutItem* item : items_)
    if (!item->isEmpty()) size = size.expandedTo(item->minimumSize());
  return size + QSize(margins.left() + margins.right(), margins.top() + margins.bottom());
}

void FlowLayout::setGeometry(const QRect& area) {
  QLayout::setGeometry(area);
  arrange(area, true);
}

int FlowLayout::arrange(const QRect& area, bool move) const {
  const QRect inside = area.marginsRemoved(contentsMargins());
  int y = inside.top();
  for (std::size_t first = 0; first < items_.size();) {
    // A line: as many as fit, centred on its height.
    int x = 0, height = 0;
    std::size_t last = first;
    for (; last < items_.size(); ++last) {
      if (items_[last]->isEmpty()) continue;
      const QSize size = items_[last]->sizeHint();
      const int wide = std::min(size.width(), inside.width());
      if (x > 0 && x + gap_ + wide > inside.width()) break;
      x += (x > 0 ? gap_ : 0) + wide;
      height = std::max(height, size.height());
    }
    if (move) {
      int at = inside.left();
      for (std::size_t i = first; i < last; ++i) {
        if (items_[i]->isEmpty()) continue;
        const QSize size = items_[i]->sizeHint();
        const int wide = std::min(size.width(), inside.width());
        items_[i]->setGeometry(QRect(at, y + (height - size.height()) / 2, wide, size.height()));
        at += wide + gap_;
      }
    }
    if (height > 0) y += height + (last < items_.size() ? gap_ : 0);
    first = std::max(last, first + 1);
  }
  return y - area.top() + contentsMargins().bottom();
}

}  // namespace patina
