#include "widgets/photo_strip.h"

#include <QScrollBar>
#include <QStyledItemDelegate>
#include <QWheelEvent>

#include "widgets/theme.h"

namespace patina {

namespace {
constexpr int kPictureSide = 84;
constexpr int kPadding = 6;

QString signedNumber(int value) {
  return value < 0 ? QStringLiteral("\u2212%1").arg(-value) : QString::number(value);
}
}  // namespace

QString roleName(PhotoRole role) {
  switch (role) {
    case PhotoRole::Pattern:
      return QStringLiteral("pattern");
    case PhotoRole::Window:
      return QStringLiteral("window");
    case PhotoRole::Black:
      return QStringLiteral("black");
    case PhotoRole::Geometry:
      return QStringLiteral("geometry");
  }
  return {};
}

QString photoTitle(const FourierPhoto& photo) {
  if (photo.role != PhotoRole::Pattern) return roleName(photo.role);
  return QStringLiteral("\u03c9 = (%1, %2)")
      .arg(signedNumber(photo.frequency.x()), signedNumber(photo.frequency.y()));
}

QString photoSummary(const FourierPhoto& photo) {
  QString text = QString::fromStdString(photo.file) + QStringLiteral("  \u00b7  ") + roleName(photo.role);
  if (photo.role == PhotoRole::Pattern)
    text += QStringLiteral("  \u00b7  %1 cycles over the screen's width  \u00b7  phase %2\u00b0 (k = %3)")
                .arg(photoTitle(photo))
                .arg(photo.phase * 90)
                .arg(photo.phase);
  if (photo.exposureS > 0) text += QStringLiteral("  \u00b7  exposure %1 s").arg(photo.exposureS, 0, 'g', 4);
  if (photo.holdout) text += QStringLiteral("  \u00b7  held out: the fit does not read it");
  return text;
}

class PhotoStrip::Model : public QAbstractListModel {
 public:
  Model(PhotoLibrary* library, QObject* parent) : QAbstractListModel(parent), library_(library) {}
  int rowCount(const QModelIndex& parent = {}) const override {
    const auto capture = library_->capture();
    return parent.isValid() || !capture ? 0 : static_cast<int>(capture->photos.size());
  }
  QVariant data(const QModelIndex& index, int role) const override {
    const auto capture = library_->capture();
    if (!capture || index.row() >= rowCount()) return {};
    const FourierPhoto& photo = capture->photos[index.row()];
    if (role == Qt::DisplayRole || role == Qt::AccessibleTextRole) return photoTitle(photo);
    if (role == Qt::ToolTipRole) return photoSummary(photo);
    return {};
  }
  void reset() {
    beginResetModel();
    endResetModel();
  }
  void touch(int row) {
    if (row < rowCount()) Q_EMIT dataChanged(index(row), index(row));
  }

 private:
  PhotoLibrary* library_;
};

class PhotoStrip::Delegate : public QStyledItemDelegate {
 public:
  Delegate(PhotoLibrary* library, QObject* parent) : QStyledItemDelegate(parent), library_(library) {}

  QSize sizeHint(const QStyleOptionViewItem&, const QModelIndex&) const override {
    const QFontMetrics metrics(theme::captionFont());
    const int text = metrics.horizontalAdvance(QStringLiteral("\u03c9 = (\u221240, \u221240)"));
    return {std::max(kPictureSide, text) + 2 * kPadding,
            kPictureSide + 2 * metrics.height() + 2 * kPadding + 4};
  }

  void paint(QPainter* painter, const QStyleOptionViewItem& option, const QModelIndex& index) const override {
    const auto capture = library_->capture();
    if (!capture || index.row() >= static_cast<int>(capture->photos.size())) return;
    const FourierPhoto& photo = capture->photos[index.row()];
    painter->save();
    painter->setRenderHint(QPainter::Antialiasing);
    painter->setRenderHint(QPainter::SmoothPixmapTransform);
    const QRectF card = QRectF(option.rect).adjusted(2, 2, -2, -2);
    const bool selected = option.state & QStyle::State_Selected,
               under = option.state & QStyle::State_MouseOver;
    if (selected || under) {
      painter->setPen(Qt::NoPen);
      painter->setBrush(selected ? theme::kAccentDeep : theme::kControl);
      painter->drawRoundedRect(card, 6, 6);
    }
    const QRectF frame(option.rect.center().x() - kPictureSide / 2.0 + 0.5, option.rect.top() + kPadding,
                       kPictureSide, kPictureSide);
    painter->fillRect(frame, theme::kSunken);
    const QImage picture = library_->thumbnail(index.row());
    painter->setFont(theme::captionFont());
    if (!picture.isNull()) {
      const QSizeF size = QSizeF(picture.size()).scaled(frame.size(), Qt::KeepAspectRatio);
      painter->drawImage(QRectF(frame.center() - QPointF(size.width(), size.height()) / 2, size), picture);
    } else {
      painter->setPen(library_->failed(index.row()) ? theme::kError : theme::kTextOff);
      painter->drawText(frame, Qt::AlignCenter | Qt::TextWordWrap,
                        library_->failed(index.row()) ? tr("cannot be read") : tr("\u2026"));
    }
    const QFontMetrics metrics = painter->fontMetrics();
    if (photo.holdout) {
      const QString badge = tr("held out");
      const double width = metrics.horizontalAdvance(badge) + 10;
      const QRectF tag(frame.right() - width - 3, frame.top() + 3, width, metrics.height() + 1);
      painter->setPen(Qt::NoPen);
      painter->setBrush(QColor(0, 0, 0, 170));
      painter->drawRoundedRect(tag, 4, 4);
      painter->setPen(theme::kWarning);
      painter->drawText(tag, Qt::AlignCenter, badge);
    }
    painter->setPen(selected ? QColor(Qt::white) : theme::kText);
    QRectF line(option.rect.left(), frame.bottom() + 3, option.rect.width(), metrics.height());
    painter->drawText(line, Qt::AlignCenter, photoTitle(photo));
    line.translate(0, metrics.height());
    painter->setPen(selected ? QColor(225, 225, 225) : theme::kTextDim);
    painter->drawText(line, Qt::AlignCenter,
                      photo.role == PhotoRole::Pattern ? tr("phase %1\u00b0").arg(photo.phase * 90)
                      : photo.exposureS > 0            ? tr("%1 s").arg(photo.exposureS, 0, 'g', 3)
                                                       : QString());
    if (option.state & QStyle::State_HasFocus) {
      painter->setPen(QPen(theme::kAccent, 1.5));
      painter->setBrush(Qt::NoBrush);
      painter->drawRoundedRect(card, 6, 6);
    }
    painter->restore();
  }

 private:
  PhotoLibrary* library_;
};

PhotoStrip::PhotoStrip(PhotoLibrary* library, QWidget* parent) : QListView(parent), library_(library) {
  model_ = new Model(library, this);
  setModel(model_);
  setItemDelegate(new Delegate(library, this));
  setFlow(QListView::LeftToRight);
  setWrapping(false);
  setUniformItemSizes(true);
  setSelectionMode(QAbstractItemView::SingleSelection);
  setVerticalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOn);
  setHorizontalScrollMode(QAbstractItemView::ScrollPerPixel);
  setFrameShape(QFrame::NoFrame);
  setMouseTracking(true);
  setSpacing(0);
  setAccessibleName(tr("Photographs of the bundle"));
  setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Fixed);
  connect(library_, &PhotoLibrary::thumbnailReady, this, [this](int photo) { model_->touch(photo); });
  connect(selectionModel(), &QItemSelectionModel::currentChanged, this, [this](const QModelIndex& current) {
    if (current.isValid()) Q_EMIT photoSelected(current.row());
  });
  connect(this, &QListView::clicked, this,
          [this](const QModelIndex& index) { Q_EMIT photoActivated(index.row()); });
  connect(this, &QListView::activated, this,
          [this](const QModelIndex& index) { Q_EMIT photoActivated(index.row()); });
}

void PhotoStrip::reload() {
  model_->reset();
  scrollToTop();
}

void PhotoStrip::setCurrentPhoto(int photo) {
  const QModelIndex index = model_->index(photo);
  if (!index.isValid()) return;
  setCurrentIndex(index);
  scrollTo(index);
}

QSize PhotoStrip::sizeHint() const {
  const int item = itemDelegate()->sizeHint({}, {}).height();
  return {800, item + 14};
}

void PhotoStrip::wheelEvent(QWheelEvent* event) {
  const QPoint turn = event->angleDelta();
  const int step = std::abs(turn.x()) > std::abs(turn.y()) ? turn.x() : turn.y();
  horizontalScrollBar()->setValue(horizontalScrollBar()->value() - step);
  event->accept();
}

}  // namespace patina
