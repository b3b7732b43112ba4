#include "widgets/shot_strip.h"

#include <QScrollBar>
#include <QStyledItemDelegate>

#include "widgets/theme.h"

namespace patina {

namespace {

constexpr int kPictureSide = 62;
constexpr int kPadding = 6;

/// A thumbnail from at most 16 samples a pixel, so that a photograph of any size costs the same.
QImage thumbnailOf(const Image& image, const ToneSettings& tone, int side) {
  const double scale = static_cast<double>(side) / std::max(image.width(), image.height());
  const int width = std::max(1, static_cast<int>(std::lround(image.width() * scale)));
  const int height = std::max(1, static_cast<int>(std::lround(image.height() * scale)));
  Image small(width, height, image.channels());
  constexpr int kSteps = 4;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int v = 0; v < kSteps; ++v)
        for (int u = 0; u < kSteps; ++u) {
          const int px =
              std::min(image.width() - 1, static_cast<int>((x + (u + 0.5) / kSteps) * image.width() / width));
          const int py = std::min(image.height() - 1,
                                  static_cast<int>((y + (v + 0.5) / kSteps) * image.height() / height));
          for (int c = 0; c < image.channels(); ++c)
            small.at(x, y, c) += image.at(px, py, c) / (kSteps * kSteps);
        }
  return toneMapped(small, ToneMapper(ToneStyle::LinearRgb, tone));
}

}  // namespace

class ShotStrip::Model : public QAbstractListModel {
 public:
  explicit Model(ShotStrip* strip) : QAbstractListModel(strip), strip_(strip) {}
  int rowCount(const QModelIndex& parent = {}) const override {
    return parent.isValid() ? 0 : strip_->count();
  }
  QVariant data(const QModelIndex& index, int role) const override {
    if (index.row() >= strip_->count()) return {};
    const ShotEntry& entry = strip_->entry(index.row());
    if (role == Qt::DisplayRole) return entry.title;
    if (role == Qt::AccessibleTextRole || role == Qt::ToolTipRole) {
      QString text = entry.title + QStringLiteral("  \u00b7  ") + QString::fromStdString(entry.shot->file);
      if (!entry.white)
        text += QStringLiteral("\n") + namedAnglesText(directionsOf(*entry.shot).centre(), 1) +
                tr(" at the sample's centre");
      text += tr("\nexposure %1 s").arg(entry.shot->exposureS, 0, 'g', 4);
      if (entry.white) text += tr("\nThe white tile in the sample's place: the pixels' units come from it");
      if (entry.shot->holdout && !entry.white) text += tr("\nHeld out: the reconstruction does not read it");
      if (entry.comparison && !entry.comparison->leftOut.empty())
        text += tr("\nLeft out: %1").arg(QString::fromStdString(entry.comparison->leftOut));
      if (entry.comparison && entry.comparison->rms >= 0) {
        text += tr("\nRMS %1 of the photograph's").arg(percentText(entry.comparison->rms));
        if (entry.comparison->noiseFloor > 0)
          text += tr("; noise alone %1").arg(percentText(entry.comparison->noiseFloor));
      }
      return text;
    }
    return {};
  }
  void reset() {
    beginResetModel();
    endResetModel();
  }
  void touch(int row) { Q_EMIT dataChanged(index(row), index(row)); }

 private:
  ShotStrip* strip_;
};

class ShotStrip::Delegate : public QStyledItemDelegate {
 public:
  explicit Delegate(ShotStrip* strip) : QStyledItemDelegate(strip), strip_(strip) {}

  QSize sizeHint(const QStyleOptionViewItem&, const QModelIndex&) const override {
    const QFontMetrics metrics(theme::captionFont());
    const int text = metrics.horizontalAdvance(QStringLiteral("88\u00b0 88\u00b0 180\u00b0")) + 6;
    return {2 * kPictureSide + 3 * kPadding + text + 8,
            std::max(kPictureSide, 3 * metrics.height() + 4) + 2 * kPadding};
  }

  void paint(QPainter* painter, const QStyleOptionViewItem& option, const QModelIndex& index) const override {
    if (index.row() >= strip_->count()) return;
    const ShotEntry& entry = strip_->entry(index.row());
    painter->save();
    painter->setRenderHint(QPainter::Antialiasing);
    painter->setRenderHint(QPainter::SmoothPixmapTransform);
    const QRectF card = QRectF(option.rect).adjusted(2, 1, -2, -1);
    const bool selected = option.state & QStyle::State_Selected,
               under = option.state & QStyle::State_MouseOver;
    if (selected || under) {
      painter->setPen(Qt::NoPen);
      painter->setBrush(selected ? theme::kAccentDeep : theme::kControl);
      painter->drawRoundedRect(card, 6, 6);
    }
    painter->setFont(theme::captionFont());
    const QFontMetrics metrics = painter->fontMetrics();
    const double top = option.rect.center().y() - kPictureSide / 2.0 + 0.5;
    const QRectF first(option.rect.left() + kPadding, top, kPictureSide, kPictureSide);
    const auto picture = [&](const QRectF& frame, const QImage& image, const QString& instead, bool bad) {
      painter->fillRect(frame, theme::kSunken);
      if (!image.isNull()) {
        const QSizeF size = QSizeF(image.size()).scaled(frame.size(), Qt::KeepAspectRatio);
        painter->drawImage(QRectF(frame.center() - QPointF(size.width(), size.height()) / 2, size), image);
        return;
      }
      painter->setPen(bad ? theme::kError : theme::kTextOff);
      painter->drawText(frame, Qt::AlignCenter | Qt::TextWordWrap, instead);
    };
    const bool failed = strip_->cache_->failed(entry.photo);
    const QImage rendered = strip_->renderedThumbnail(index.row());
    const auto own = strip_->captured_.find(index.row());
    picture(first, own != strip_->captured_.end() ? own->second : strip_->cache_->thumbnail(entry.photo),
            failed ? tr("cannot be read") : tr("\u2026"), failed);
    double left = first.right() + kPadding;
    if (!rendered.isNull()) {
      const QRectF second = first.translated(kPictureSide + 2, 0);
      picture(second, rendered, {}, false);
      left = second.right() + kPadding;
    }
    QRectF line(left, option.rect.center().y() - 1.5 * metrics.height(), option.rect.right() - left - 2,
                metrics.height());
    const auto write = [&](const QString& text, const QColor& colour) {
      painter->setPen(colour);
      painter->drawText(line, Qt::AlignLeft | Qt::AlignVCenter,
                        metrics.elidedText(text, Qt::ElideRight, static_cast<int>(line.width())));
      line.translate(0, metrics.height());
    };
    const QColor dim = selected ? QColor(225, 225, 225) : theme::kTextDim;
    write(entry.title, entry.shot->holdout && !entry.white && !selected ? theme::kWarning
                       : selected                                       ? QColor(Qt::white)
                                                                        : theme::kText);
    if (entry.white) {
      write(tr("reference"), dim);
      write(tr("%1 s").arg(entry.shot->exposureS, 0, 'g', 3), dim);
    } else {
      write(anglesText(directionsOf(*entry.shot).centre()), dim);
      if (entry.comparison && entry.comparison->rms >= 0)
        write(tr("RMS %1").arg(percentText(entry.comparison->rms)), dim);
      else
        write(tr("%1 s").arg(entry.shot->exposureS, 0, 'g', 3), dim);
    }
    if (option.state & QStyle::State_HasFocus) {
      painter->setPen(QPen(theme::kAccent, 1.5));
      painter->setBrush(Qt::NoBrush);
      painter->drawRoundedRect(card, 6, 6);
    }
    painter->restore();
  }

 private:
  ShotStrip* strip_;
};

ShotStrip::ShotStrip(TwoShotDocument* document, PhotoCache* cache, QWidget* parent)
    : QListView(parent), document_(document), cache_(cache) {
  setObjectName(QStringLiteral("shotStrip"));
  model_ = new Model(this);
  setModel(model_);
  setItemDelegate(new Delegate(this));
  setUniformItemSizes(true);
  setSelectionMode(QAbstractItemView::SingleSelection);
  setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  setVerticalScrollMode(QAbstractItemView::ScrollPerPixel);
  setFrameShape(QFrame::NoFrame);
  setMouseTracking(true);
  setAccessibleName(tr("Photographs of the bundle, and their predictions"));
  connect(cache_, &PhotoCache::thumbnailReady, this, [this](int photo) {
    for (int row = 0; row < count(); ++row)
      if (entries_[row].photo == photo) model_->touch(row);
  });
  connect(document_, &TwoShotDocument::captureChanged, this, &ShotStrip::rebuild);
  connect(document_, &TwoShotDocument::fitChanged, this, &ShotStrip::rebuild);
  connect(selectionModel(), &QItemSelectionModel::currentChanged, this, [this](const QModelIndex& current) {
    if (current.isValid()) Q_EMIT shotSelected(current.row());
  });
}

void ShotStrip::rebuild() {
  const int row = current();
  const int rowsBefore = count();
  const auto capture = document_->capture();
  entries_ = capture ? shotEntries(*capture, document_->fit().get()) : std::vector<ShotEntry>{};
  rendered_.clear();
  captured_.clear();
  model_->reset();
  Q_EMIT shotsChanged();
  if (count() > 0) setCurrent(count() == rowsBefore && row >= 0 ? row : 0);
}

void ShotStrip::setCurrent(int row) {
  const QModelIndex index = model_->index(row);
  if (!index.isValid()) return;
  setCurrentIndex(index);
  scrollTo(index);
}

QImage ShotStrip::renderedThumbnail(int row) {
  const ShotEntry& entry = entries_[row];
  if (!entry.comparison || entry.comparison->rendered.empty()) return {};
  const auto made = rendered_.find(row);
  if (made != rendered_.end()) return made->second;
  const ToneSettings tone = shotTone(entry.comparison->captured);
  captured_[row] = thumbnailOf(entry.comparison->captured, tone, 2 * kPictureSide);
  return rendered_[row] = thumbnailOf(entry.comparison->rendered, tone, 2 * kPictureSide);
}

QSize ShotStrip::sizeHint() const {
  return {itemDelegate()->sizeHint({}, {}).width() + 14, 500};
}

}  // namespace patina
