#include "widgets/map_panel.h"

#include <QDoubleSpinBox>
#include <QSignalBlocker>
#include <QSlider>
#include <QTabBar>

#include "widgets/colour_bar.h"
#include "widgets/elided_label.h"
#include "widgets/image_view.h"
#include "widgets/photo_strip.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr int kGestureMs = 700;  ///< changes closer together than this are one step of undo
constexpr double kLargestEv = 8;

/// Steps of about a fiftieth of the value, and figures to match.
class RangeSpin : public QDoubleSpinBox {
 public:
  explicit RangeSpin(QWidget* parent) : QDoubleSpinBox(parent) {
    setRange(-1e6, 1e6);
    setDecimals(6);
    setStepType(QAbstractSpinBox::AdaptiveDecimalStepType);
    setKeyboardTracking(false);
    setMinimumWidth(fontMetrics().horizontalAdvance(QStringLiteral("-0.00000")) + 30);
  }
  QString textFromValue(double value) const override { return QString::number(value, 'g', 4); }
  QSize minimumSizeHint() const override {
    return {minimumWidth(), QDoubleSpinBox::minimumSizeHint().height()};
  }
  QSize sizeHint() const override { return minimumSizeHint(); }
};

QToolButton* button(const QString& iconName, const QString& tip, QWidget* parent) {
  auto* made = new QToolButton(parent);
  made->setIcon(theme::icon(iconName));
  made->setToolTip(tip);
  made->setAccessibleName(tip);
  made->setFocusPolicy(Qt::StrongFocus);
  return made;
}

}  // namespace

MapPanel::MapPanel(Document* document, PhotoLibrary* library, QWidget* parent)
    : QWidget(parent), document_(document), library_(library) {
  setObjectName(QStringLiteral("mapPanel"));
  gesture_.setSingleShot(true);
  gesture_.setInterval(kGestureMs);
  connect(&gesture_, &QTimer::timeout, document_, &Document::endGesture);

  tabs_ = new QTabBar(this);
  tabs_->setObjectName(QStringLiteral("mapTabs"));
  tabs_->setExpanding(false);
  tabs_->setUsesScrollButtons(true);
  tabs_->setAccessibleName(tr("Photographs and maps"));
  for (const auto& kind : viewKinds()) {
    if (isUncertainty(kind.kind)) continue;
    const int index = tabs_->addTab(QString::fromUtf8(kind.title));
    tabs_->setTabToolTip(index, tr("%1 (Ctrl+%2)").arg(QString::fromUtf8(kind.meaning)).arg(index + 1));
  }
  view_ = new ImageView(this);
  view_->setObjectName(QStringLiteral("mapView"));
  bar_ = new ColourBar(this);
  caption_ = new ElidedLabel(this);
  caption_->setProperty("role", "caption");
  caption_->setFont(theme::captionFont());
  caption_->setMinimumWidth(50);
  readout_ = new ElidedLabel(this);
  readout_->setObjectName(QStringLiteral("readout"));
  readout_->setFont(theme::numberFont());
  readout_->setMinimumWidth(50);
  readout_->setTextFormat(Qt::PlainText);
  zoom_ = new QLabel(this);
  zoom_->setFont(theme::numberFont());
  zoom_->setAlignment(Qt::AlignRight | Qt::AlignVCenter);
  zoom_->setMinimumWidth(zoom_->fontMetrics().horizontalAdvance(QStringLiteral("25600 %")));
  zoom_->setToolTip(tr("Zoom: screen pixels for one pixel of the picture"));

  exposureLabel_ = new QLabel(tr("Exposure"), this);
  exposureSlider_ = new QSlider(Qt::Horizontal, this);
  exposureSlider_->setRange(-static_cast<int>(kLargestEv) * 10, static_cast<int>(kLargestEv) * 10);
  exposureSlider_->setPageStep(10);
  exposureSlider_->setMinimumWidth(60);
  exposureSlider_->setAccessibleName(tr("Exposure in stops"));
  exposure_ = new QDoubleSpinBox(this);
  exposure_->setRange(-kLargestEv, kLargestEv);
  exposure_->setDecimals(1);
  exposure_->setSingleStep(0.5);
  exposure_->setSuffix(tr(" EV"));
  exposure_->setKeyboardTracking(false);
  exposure_->setObjectName(QStringLiteral("exposure"));
  exposureLabel_->setBuddy(exposure_);
  lowLabel_ = new QLabel(tr("Range"), this);
  highLabel_ = new QLabel(tr("to"), this);
  low_ = new RangeSpin(this);
  low_->setObjectName(QStringLiteral("rangeLow"));
  high_ = new RangeSpin(this);
  high_->setObjectName(QStringLiteral("rangeHigh"));
  low_->setAccessibleName(tr("Low end of the range"));
  high_->setAccessibleName(tr("High end of the range"));
  auto_ = button(QStringLiteral("auto-range"), tr("Range from the picture's values (Ctrl+R)"), this);
  reset_ = button(QStringLiteral("reset"), tr("Exposure 0, range from the picture's values"), this);
  zoomFit_ = button(QStringLiteral("zoom-fit"), tr("Whole picture (0)"), this);
  zoomActual_ =
      button(QStringLiteral("zoom-actual"), tr("One screen pixel for one pixel of the picture (1)"), this);

  uncertainty_ = new QToolButton(this);
  uncertainty_->setObjectName(QStringLiteral("uncertainty"));
  uncertainty_->setText(QStringLiteral("\u00b1"));
  uncertainty_->setCheckable(true);
  uncertainty_->setAutoRaise(true);
  uncertainty_->setFocusPolicy(Qt::StrongFocus);
  uncertainty_->setAccessibleName(tr("Show standard deviations"));

  auto* tools = new QHBoxLayout;
  tools->setContentsMargins(10, 2, 8, 2);
  tools->setSpacing(6);
  tools->addWidget(exposureLabel_);
  tools->addWidget(exposureSlider_, 1);
  tools->addWidget(exposure_);
  tools->addSpacing(8);
  tools->addWidget(lowLabel_);
  tools->addWidget(low_);
  tools->addWidget(highLabel_);
  tools->addWidget(high_);
  tools->addWidget(auto_);
  tools->addWidget(reset_);
  tools->addStretch(0);

  auto* middle = new QHBoxLayout;
  middle->setContentsMargins(0, 0, 0, 0);
  middle->setSpacing(0);
  middle->addWidget(view_, 1);
  middle->addWidget(bar_);

  auto* foot = new QHBoxLayout;
  foot->setContentsMargins(10, 2, 8, 4);
  foot->addWidget(readout_, 1);
  foot->addWidget(zoom_);
  foot->addWidget(zoomFit_);
  foot->addWidget(zoomActual_);

  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 4, 0, 0);
  column->setSpacing(3);
  auto* tabRow = new QHBoxLayout;
  tabRow->setContentsMargins(6, 0, 6, 0);
  tabRow->addWidget(tabs_, 1);
  column->addLayout(tabRow);
  auto* captionRow = new QHBoxLayout;
  captionRow->setContentsMargins(12, 0, 8, 0);
  captionRow->addWidget(caption_, 1);
  captionRow->addWidget(uncertainty_);
  column->addLayout(captionRow);
  column->addLayout(middle, 1);
  column->addLayout(foot);
  column->addLayout(tools);

  connect(tabs_, &QTabBar::currentChanged, this,
          [this](int index) { setKind(static_cast<ViewKind>(index)); });
  connect(uncertainty_, &QToolButton::toggled, this, &MapPanel::showUncertainty);
  connect(exposureSlider_, &QSlider::valueChanged, this, [this](int tenths) {
    if (updating_) return;
    ToneSettings tone = document_->tone(kind_);
    tone.exposureEv = tenths / 10.0;
    applyTone(tone);
  });
  connect(exposure_, &QDoubleSpinBox::valueChanged, this, [this](double stops) {
    if (updating_) return;
    ToneSettings tone = document_->tone(kind_);
    tone.exposureEv = stops;
    applyTone(tone);
  });
  connect(low_, &QDoubleSpinBox::valueChanged, this, [this](double value) {
    if (updating_) return;
    ToneSettings tone = document_->tone(kind_);
    tone.low = value;
    if (kind_ == ViewKind::Normal) tone.high = std::max(1e-4, -value), tone.low = -tone.high;
    if (tone.high <= tone.low) tone.high = tone.low + std::max(1e-6, 1e-3 * std::abs(tone.low));
    applyTone(tone);
  });
  connect(high_, &QDoubleSpinBox::valueChanged, this, [this](double value) {
    if (updating_) return;
    ToneSettings tone = document_->tone(kind_);
    tone.high = value;
    if (kind_ == ViewKind::Normal) tone.high = std::max(1e-4, value), tone.low = -tone.high;
    if (tone.high <= tone.low) tone.low = tone.high - std::max(1e-6, 1e-3 * std::abs(tone.high));
    applyTone(tone);
  });
  connect(auto_, &QToolButton::clicked, this, &MapPanel::automaticRange);
  connect(reset_, &QToolButton::clicked, this, &MapPanel::resetTone);
  connect(zoomFit_, &QToolButton::clicked, view_, &ImageView::zoomToFit);
  connect(zoomActual_, &QToolButton::clicked, this,
          [this] { view_->zoomTo(1 / view_->devicePixelRatioF()); });
  connect(view_, &ImageView::zoomChanged, this, [this](double zoom) {
    zoom_->setText(QStringLiteral("%1 %").arg(zoom * view_->devicePixelRatioF() * 100, 0, 'f', 0));
  });
  connect(view_, &ImageView::hovered, this, [this](std::optional<QPoint> pixel) {
    refreshReadout(pixel);
    Q_EMIT texelHovered(pixel ? texelAt(QPointF(*pixel) + QPointF(0.5, 0.5)) : std::nullopt);
  });
  connect(view_, &ImageView::clicked, this, [this](QPointF place) {
    if (const auto texel = texelAt(place)) {
      document_->endGesture();
      document_->pickTexel(texel);
      document_->endGesture();
    }
  });
  connect(view_, &ImageView::stepRequested, this, [this](QPoint step) {
    const auto fit = document_->fit();
    const auto picked = document_->pickedTexel();
    if (!fit || !picked) return;
    gesture_.start();
    document_->pickTexel(QPoint(std::clamp(picked->x() + step.x(), 0, fit->maps().width - 1),
                                std::clamp(picked->y() + step.y(), 0, fit->maps().height - 1)));
  });
  connect(document_, &Document::fitChanged, this, [this] { refreshPicture(); });
  connect(document_, &Document::captureChanged, this, [this] {
    photo_ = -1;
    photoImage_.reset();
    refreshPicture();
  });
  connect(document_, &Document::toneChanged, this, [this](ViewKind kind) {
    if (kind == kind_) refreshTone();
  });
  connect(document_, &Document::pickChanged, this, [this] { refreshMarker(); });
  connect(library_, &PhotoLibrary::photoReady, this, [this](int photo, std::shared_ptr<const Image> image) {
    if (photo != photo_) return;
    photoImage_ = std::move(image);
    if (kind_ == ViewKind::Photo) refreshPicture();
  });
  connect(library_, &PhotoLibrary::toneReady, this,
          [this](ToneSettings tone) { document_->restoreTone(ViewKind::Photo, tone); });
  refreshPicture();
}

void MapPanel::showUncertainty(bool shown) {
  if (shown == uncertaintyShown_) return;
  uncertaintyShown_ = shown;
  {
    const QSignalBlocker block(uncertainty_);
    uncertainty_->setChecked(shown);
  }
  setKind(parameterOf(kind_));
  refreshPicture();  // the button's tip, where the kind has no standard deviation
  Q_EMIT uncertaintyShownChanged(shown);
}

void MapPanel::setKind(ViewKind kind) {
  // A tab stands for its parameter or for that one's standard deviation.
  if (isUncertainty(kind)) {
    if (!uncertaintyShown_) {
      uncertaintyShown_ = true;
      const QSignalBlocker block(uncertainty_);
      uncertainty_->setChecked(true);
      Q_EMIT uncertaintyShownChanged(true);
    }
  } else if (uncertaintyShown_) {
    kind = uncertaintyOf(kind).value_or(kind);
  }
  if (kind == kind_) return;
  kind_ = kind;
  document_->endGesture();
  const QSignalBlocker block(tabs_);
  tabs_->setCurrentIndex(static_cast<int>(parameterOf(kind)));
  refreshPicture();
  Q_EMIT kindChanged(kind);
}

void MapPanel::showPhoto(int photo) {
  if (photo != photo_) {
    photo_ = photo;
    library_->requestPhoto(photo);
  }
  if (kind_ == ViewKind::Photo)
    refreshPicture();
  else
    setKind(ViewKind::Photo);
}

void MapPanel::refreshPicture() {
  const auto fit = document_->fit();
  const auto capture = document_->capture();
  std::shared_ptr<const Image> picture;
  QPolygonF outline;
  QString caption;
  if (kind_ == ViewKind::Photo) {
    // The photograph before stays until the next is read: no flicker while stepping through the strip.
    picture = photoImage_;
    if (capture && photo_ >= 0) caption = photoSummary(capture->photos[photo_]);
    if (capture && picture) {
      const double x = capture->sampleWidthMm / 2, y = capture->sampleHeightMm / 2;
      for (const auto& [cornerX, cornerY] :
           {std::pair(-x, y), std::pair(x, y), std::pair(x, -y), std::pair(-x, -y)})
        if (const auto pixel = capture->camera.pixelFromWorld({cornerX, cornerY, 0}))
          outline << QPointF(pixel->x() + 0.5, pixel->y() + 0.5);
    }
    view_->setEmptyText(capture ? tr("Choose a photograph in the strip below.") : tr("No bundle is open."));
  } else {
    const Image* map = fit ? mapOf(fit->maps(), kind_) : nullptr;
    if (map) picture = std::shared_ptr<const Image>(fit, map);
    caption = QString::fromUtf8(info(kind_).meaning);
    if (fit)
      caption += QStringLiteral("  \u00b7  %1 \u00d7 %2 texels%3")
                     .arg(fit->maps().width)
                     .arg(fit->maps().height)
                     .arg(fit->stats().cancelled ? tr("  \u00b7  fit was cancelled") : QString());
    view_->setEmptyText(
        fit ? tr("This fit was written by an earlier version, without standard deviations.\nFit \u2192 Fit "
                 "(F5) "
                 "again to have them.")
            : tr("There is no fit yet.\nFit \u2192 Fit (F5) makes the %1 map from the photographs.")
                  .arg(QString::fromUtf8(info(parameterOf(kind_)).title).toLower()));
  }
  const bool hasSd = isUncertainty(kind_) || uncertaintyOf(kind_).has_value();
  uncertainty_->setToolTip(hasSd ? tr("How sure the map is: standard deviations from the photographs' noise "
                                      "alone, not from what the model "
                                      "lacks (Ctrl+U)")
                                 : tr("This picture has no standard deviation; the other maps show theirs "
                                      "while this is on (Ctrl+U)"));
  caption_->setText(caption);
  caption_->setToolTip(caption);
  view_->setPicture(picture, info(kind_).style);
  view_->setOutline(outline);
  if (fit && kind_ != ViewKind::Photo)
    view_->setMask(std::shared_ptr<const Image>(fit, &fit->maps().status), unmeasuredStates(kind_));
  else
    view_->setMask(nullptr, 0);
  bar_->setVisible(picture != nullptr);
  if (fit && kind_ == ViewKind::Status) {
    std::array<std::size_t, kStatusCount> counts{};
    for (const float status : fit->maps().status.samples()) {
      const int index = static_cast<int>(std::lround(status));
      if (index >= 0 && index < kStatusCount) ++counts[index];
    }
    bar_->setStatusCounts(counts);
  }
  refreshTone();
  refreshMarker();
  refreshReadout(std::nullopt);
}

void MapPanel::refreshTone() {
  const ToneSettings& tone = document_->tone(kind_);
  const ViewKindInfo& kind = info(kind_);
  view_->setTone(tone);
  bar_->setScale(kind.style, tone, QString::fromUtf8(kind.unit));
  updating_ = true;
  exposureSlider_->setValue(static_cast<int>(std::lround(tone.exposureEv * 10)));
  exposure_->setValue(tone.exposureEv);
  low_->setValue(tone.low);
  high_->setValue(tone.high);
  updating_ = false;

  const bool shown = view_->picture() != nullptr;
  const bool pictureLike = kind.style == ToneStyle::LinearRgb, ranged = kind.style != ToneStyle::Status;
  const QString nothing = tr("There is no picture to adjust yet");
  const auto allow = [&](QWidget* widget, bool usable, const QString& why, const QString& tip) {
    widget->setEnabled(shown && usable);
    widget->setToolTip(!shown ? nothing : usable ? tip : why);
  };
  const QString noExposure = tr("Exposure is for photographs and colour maps; use the range for this map");
  const QString noRange = tr("States have no range; see the legend");
  for (QWidget* widget : std::initializer_list<QWidget*>{exposureLabel_, exposureSlider_, exposure_})
    allow(widget, pictureLike, noExposure, tr("Brightness in stops (EV): +1 doubles it"));
  const QString unit = *kind.unit ? tr(", in %1").arg(QString::fromUtf8(kind.unit)) : QString();
  allow(low_, ranged, noRange, tr("Value shown by the colour bar's lower end%1").arg(unit));
  allow(high_, ranged, noRange, tr("Value shown by the colour bar's upper end%1").arg(unit));
  allow(auto_, ranged, noRange, tr("Range from the picture's values (Ctrl+R)"));
  allow(reset_, ranged, noRange, tr("Exposure 0, range from the picture's values"));
  lowLabel_->setEnabled(shown && ranged);
  highLabel_->setEnabled(shown && ranged);
}

void MapPanel::refreshMarker() {
  const auto fit = document_->fit();
  const auto picked = document_->pickedTexel();
  if (!fit || !picked) return view_->setMarker(std::nullopt);
  if (kind_ != ViewKind::Photo) return view_->setMarker(QPointF(*picked));
  const SvbrdfMaps& maps = fit->maps();
  const double x = ((picked->x() + 0.5) / maps.width - 0.5) * maps.widthMm;
  const double y = (0.5 - (picked->y() + 0.5) / maps.height) * maps.heightMm;
  const auto pixel = fit->capture().camera.pixelFromWorld({x, y, 0});
  view_->setMarker(pixel ? std::optional(QPointF(pixel->x(), pixel->y())) : std::nullopt, true);
}

std::optional<QPoint> MapPanel::texelFromPhoto(const QPointF& place) const {
  const auto fit = document_->fit();
  if (!fit) return std::nullopt;
  const SvbrdfMaps& maps = fit->maps();
  const auto point = fit->capture().camera.samplePlaneFromPixel({place.x() - 0.5, place.y() - 0.5});
  if (!point) return std::nullopt;
  const QPoint texel(static_cast<int>(std::floor((point->x() / maps.widthMm + 0.5) * maps.width)),
                     static_cast<int>(std::floor((0.5 - point->y() / maps.heightMm) * maps.height)));
  if (!QRect(0, 0, maps.width, maps.height).contains(texel)) return std::nullopt;
  return texel;
}

std::optional<QPoint> MapPanel::texelAt(const QPointF& place) const {
  if (kind_ == ViewKind::Photo) return texelFromPhoto(place);
  if (!document_->fit()) return std::nullopt;
  return QPoint(static_cast<int>(std::floor(place.x())), static_cast<int>(std::floor(place.y())));
}

QString MapPanel::placeText(const QPoint& pixel) const {
  if (kind_ == ViewKind::Photo) {
    const auto capture = document_->capture();
    if (!capture) return {};
    QString text = tr("pixel (%1, %2)").arg(pixel.x()).arg(pixel.y());
    if (const auto point = capture->camera.samplePlaneFromPixel({double(pixel.x()), double(pixel.y())}))
      text += QString::asprintf("  x %+.1f mm  y %+.1f mm", point->x(), point->y());
    return text;
  }
  const SvbrdfMaps& maps = document_->fit()->maps();
  return tr("texel (%1, %2)").arg(pixel.x()).arg(pixel.y()) +
         QString::asprintf("  x %+.1f mm  y %+.1f mm", ((pixel.x() + 0.5) / maps.width - 0.5) * maps.widthMm,
                           (0.5 - (pixel.y() + 0.5) / maps.height) * maps.heightMm);
}

void MapPanel::refreshReadout(std::optional<QPoint> pixel) {
  const Image* picture = view_->picture();
  if (!picture) return readout_->setText({});
  if (!pixel) return readout_->setText(tr("Move over the picture to read values"));
  QString text =
      placeText(*pixel) + QStringLiteral("   ") + valueText(kind_, picture->pixel(pixel->x(), pixel->y()));
  if (const auto fit = document_->fit(); fit && kind_ != ViewKind::Photo && kind_ != ViewKind::Status) {
    const int status = static_cast<int>(fit->maps().status.at(pixel->x(), pixel->y()));
    if (status != static_cast<int>(TexelStatus::Converged))
      text += QStringLiteral("   (%1)").arg(statusName(status));
  }
  readout_->setText(text);
}

void MapPanel::applyTone(const ToneSettings& tone) {
  gesture_.start();
  document_->setTone(kind_, tone);
}

void MapPanel::automaticRange() {
  const Image* picture = view_->picture();
  if (!picture || kind_ == ViewKind::Status) return;
  const auto fit = document_->fit();
  ToneSettings tone =
      automaticTone(info(kind_).style, *picture,
                    kind_ != ViewKind::Photo && fit ? &fit->maps().status : nullptr, unmeasuredStates(kind_));
  tone.exposureEv = document_->tone(kind_).exposureEv;
  document_->endGesture();
  document_->setTone(kind_, tone);
  document_->endGesture();
}

void MapPanel::resetTone() {
  const Image* picture = view_->picture();
  if (!picture || kind_ == ViewKind::Status) return;
  const auto fit = document_->fit();
  document_->endGesture();
  document_->setTone(kind_, automaticTone(info(kind_).style, *picture,
                                          kind_ != ViewKind::Photo && fit ? &fit->maps().status : nullptr,
                                          unmeasuredStates(kind_)));
  document_->endGesture();
}

}  // namespace patina
