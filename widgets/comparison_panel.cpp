#include "widgets/comparison_panel.h"

#include <QDoubleSpinBox>
#include <QSignalBlocker>
#include <QSlider>
#include <QTabBar>

#include "widgets/colour_bar.h"
#include "widgets/elided_label.h"
#include "widgets/image_view.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr double kLargestEv = 8;
constexpr int kLabelsTab = 3;
/// A photograph darker than this part of its bright end is divided by it instead in the difference: noise.
constexpr float kDarkPart = 0.01f;

QToolButton* button(const QString& iconName, const QString& tip, QWidget* parent) {
  auto* made = new QToolButton(parent);
  made->setIcon(theme::icon(iconName));
  made->setToolTip(tip);
  made->setAccessibleName(tip);
  made->setFocusPolicy(Qt::StrongFocus);
  return made;
}

QString threeValues(std::span<const float> pixel) {
  QStringList values;
  for (const float value : pixel) values << QString::number(value, 'g', 3);
  return values.join(' ');
}

double meanOf(std::span<const float> pixel) {
  double sum = 0;
  for (const float value : pixel) sum += value;
  return sum / std::max<std::size_t>(1, pixel.size());
}

/// A picture that belongs to `owner`, kept alive with it.
std::shared_ptr<const Image> borrowed(const std::shared_ptr<const TwoShotFit>& owner, const Image& image) {
  return std::shared_ptr<const Image>(owner, &image);
}

}  // namespace

QColor materialColour(int material) {
  // The golden angle: however many there are, neighbours in number are far apart in hue.
  return QColor::fromHslF(std::fmod(0.58 + 0.381966 * material, 1.0), 0.5, 0.58);
}

ComparisonPanel::ComparisonPanel(TwoShotDocument* document, PhotoCache* cache, QWidget* parent)
    : QWidget(parent), document_(document), cache_(cache) {
  setObjectName(QStringLiteral("comparisonPanel"));
  tabs_ = new QTabBar(this);
  tabs_->setObjectName(QStringLiteral("comparisonTabs"));
  tabs_->setExpanding(false);
  tabs_->setAccessibleName(tr("How photograph and reconstruction are compared"));
  tabs_->addTab(tr("Wipe"));
  tabs_->addTab(tr("Side by Side"));
  tabs_->addTab(tr("Difference"));
  tabs_->addTab(tr("Materials"));
  view_ = new ComparisonView(this);
  view_->setToolTip(tr("Wheel: zoom. Drag: move. Drag the divider, or Left and Right: wipe."));
  labels_ = new ImageView(this);
  labels_->setObjectName(QStringLiteral("labelView"));
  labels_->setAccessibleName(tr("Map of materials"));
  labels_->hide();
  bar_ = new ColourBar(this);
  caption_ = new ElidedLabel(this);
  caption_->setObjectName(QStringLiteral("shotCaption"));
  caption_->setProperty("role", "caption");
  caption_->setFont(theme::captionFont());
  readout_ = new ElidedLabel(this);
  readout_->setObjectName(QStringLiteral("comparisonReadout"));
  readout_->setFont(theme::numberFont());
  readout_->setTextFormat(Qt::PlainText);
  zoom_ = new QLabel(this);
  zoom_->setFont(theme::numberFont());
  zoom_->setAlignment(Qt::AlignRight | Qt::AlignVCenter);
  zoom_->setMinimumWidth(zoom_->fontMetrics().horizontalAdvance(QStringLiteral("25600 %")));
  zoom_->setToolTip(tr("Zoom: screen pixels for one pixel of the photograph"));
  auto* exposureLabel = new QLabel(tr("Exposure"), this);
  exposureSlider_ = new QSlider(Qt::Horizontal, this);
  exposureSlider_->setRange(-static_cast<int>(kLargestEv) * 10, static_cast<int>(kLargestEv) * 10);
  exposureSlider_->setPageStep(10);
  exposureSlider_->setMinimumWidth(50);
  exposureSlider_->setAccessibleName(tr("Exposure in stops"));
  exposure_ = new QDoubleSpinBox(this);
  exposure_->setObjectName(QStringLiteral("comparisonExposure"));
  exposure_->setRange(-kLargestEv, kLargestEv);
  exposure_->setDecimals(1);
  exposure_->setSingleStep(0.5);
  exposure_->setSuffix(tr(" EV"));
  exposure_->setKeyboardTracking(false);
  exposureLabel->setBuddy(exposure_);
  rangeLabel_ = new QLabel(tr("Difference to \u00b1"), this);
  range_ = new QDoubleSpinBox(this);
  range_->setObjectName(QStringLiteral("differenceRange"));
  range_->setRange(1, 1000);
  range_->setDecimals(0);
  range_->setStepType(QAbstractSpinBox::AdaptiveDecimalStepType);
  range_->setSuffix(QStringLiteral(" %"));
  range_->setValue(50);
  range_->setKeyboardTracking(false);
  rangeLabel_->setBuddy(range_);
  reset_ = button(QStringLiteral("reset"), tr("Exposure 0, difference to \u00b150 %"), this);
  zoomFit_ = button(QStringLiteral("zoom-fit"), tr("Whole picture (0)"), this);
  zoomActual_ =
      button(QStringLiteral("zoom-actual"), tr("One screen pixel for one pixel of the photograph (1)"), this);

  auto* head = new QHBoxLayout;
  head->setContentsMargins(6, 0, 10, 0);
  head->addWidget(tabs_);
  head->addStretch(1);
  auto* captionRow = new QHBoxLayout;
  captionRow->setContentsMargins(12, 0, 8, 0);
  captionRow->addWidget(caption_);
  auto* middle = new QHBoxLayout;
  middle->setContentsMargins(0, 0, 0, 0);
  middle->setSpacing(0);
  middle->addWidget(view_, 1);
  middle->addWidget(labels_, 1);
  middle->addWidget(bar_);
  auto* foot = new QHBoxLayout;
  foot->setContentsMargins(10, 2, 8, 2);
  foot->addWidget(readout_, 1);
  foot->addWidget(zoom_);
  foot->addWidget(zoomFit_);
  foot->addWidget(zoomActual_);
  auto* tools = new QHBoxLayout;
  tools->setContentsMargins(10, 2, 8, 4);
  tools->setSpacing(6);
  tools->addWidget(exposureLabel);
  tools->addWidget(exposureSlider_, 1);
  tools->addWidget(exposure_);
  tools->addSpacing(8);
  tools->addWidget(rangeLabel_);
  tools->addWidget(range_);
  tools->addWidget(reset_);
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 4, 0, 0);
  column->setSpacing(3);
  column->addLayout(head);
  column->addLayout(captionRow);
  column->addLayout(middle, 1);
  column->addLayout(foot);
  column->addLayout(tools);

  connect(tabs_, &QTabBar::currentChanged, this, [this](int tab) {
    if (tab != kLabelsTab) view_->setMode(static_cast<ComparisonMode>(tab));
    refreshLabels();
    refreshTone();
    refreshReadout(std::nullopt);
    Q_EMIT modeChanged();
  });
  connect(exposureSlider_, &QSlider::valueChanged, this, [this](int tenths) {
    if (!updating_) setExposureEv(tenths / 10.0);
  });
  connect(exposure_, &QDoubleSpinBox::valueChanged, this, [this](double stops) {
    if (!updating_) setExposureEv(stops);
  });
  connect(range_, &QDoubleSpinBox::valueChanged, this, [this] { refreshTone(); });
  connect(reset_, &QToolButton::clicked, this, [this] {
    setExposureEv(0);
    setDifferenceRange(0.5);
  });
  connect(zoomFit_, &QToolButton::clicked, this, &ComparisonPanel::zoomToFit);
  connect(zoomActual_, &QToolButton::clicked, this, [this] {
    labelsShown() ? labels_->zoomTo(1 / devicePixelRatioF()) : view_->zoomTo(1 / devicePixelRatioF());
  });
  const auto showZoom = [this](double zoom) {
    zoom_->setText(QStringLiteral("%1 %").arg(zoom * devicePixelRatioF() * 100, 0, 'f', 0));
  };
  connect(view_, &ComparisonView::zoomChanged, this, showZoom);
  connect(labels_, &ImageView::zoomChanged, this, showZoom);
  connect(view_, &ComparisonView::hovered, this, &ComparisonPanel::refreshReadout);
  connect(labels_, &ImageView::hovered, this, &ComparisonPanel::refreshReadout);
  connect(labels_, &ImageView::clicked, this, [this](QPointF place) {
    if (!fit_ || fit_->labels.empty()) return;
    document_->setMaterial(
        static_cast<int>(fit_->labels.at(static_cast<int>(place.x()), static_cast<int>(place.y()))));
  });
  connect(document_, &TwoShotDocument::materialChanged, this, &ComparisonPanel::refreshLabels);
  connect(cache_, &PhotoCache::photoReady, this, [this](int photo, std::shared_ptr<const Image> image) {
    if (!shot_ || shot_->photo != photo || shot_->comparison) return;
    photo_ = std::move(image);
    refreshPictures();
  });
  connect(cache_, &PhotoCache::photoFailed, this, [this](int photo, const Error&) {
    if (shot_ && shot_->photo == photo && !shot_->comparison)
      view_->setEmptyText(tr("This photograph cannot be read."));
  });
  clear();
}

void ComparisonPanel::clear() {
  shot_.reset();
  capture_.reset();
  fit_.reset();
  photo_.reset();
  view_->setEmptyText({});
  refreshPictures();
}

void ComparisonPanel::setShot(const ShotEntry& entry) {
  const bool same = shot_ && shot_->photo == entry.photo && capture_ == document_->capture();
  capture_ = document_->capture();
  fit_ = document_->fit();
  shot_ = entry;
  if (!same) photo_.reset();
  view_->setEmptyText(tr("Reading %1\u2026").arg(QString::fromStdString(entry.shot->file)));
  const bool paired = entry.comparison && !entry.comparison->captured.empty();
  if (!paired) shot_->comparison = nullptr;
  refreshPictures();
  if (!paired && !photo_) cache_->requestPhoto(entry.photo);
}

void ComparisonPanel::refreshPictures() {
  std::shared_ptr<const Image> captured = photo_, rendered;
  QString caption;
  if (shot_) {
    caption = shot_->title + QStringLiteral("  \u00b7  ") + QString::fromStdString(shot_->shot->file);
    if (shot_->comparison) {
      captured = borrowed(fit_, shot_->comparison->captured);
      if (!shot_->comparison->rendered.empty()) rendered = borrowed(fit_, shot_->comparison->rendered);
      if (shot_->comparison->rms >= 0)
        caption += tr("  \u00b7  RMS %1").arg(percentText(shot_->comparison->rms));
    }
    if (!shot_->white)
      caption += QStringLiteral("  \u00b7  ") + namedAnglesText(directionsOf(*shot_->shot).centre());
    if (shot_->shot->holdout && !shot_->white) caption += tr("  \u00b7  not read by the reconstruction");
    if (shot_->comparison && !shot_->comparison->leftOut.empty())
      caption += tr("  \u00b7  left out: it could not be used");
    if (!fit_ && !shot_->white) caption += tr("  \u00b7  not reconstructed yet");
  }
  caption_->setText(caption);
  if (captured) {
    automatic_ = shot_ && shot_->white ? automaticTone(ToneStyle::LinearRgb, *captured) : shotTone(*captured);
    view_->setDarkFloor(kDarkPart * static_cast<float>(automatic_.high));
  }
  view_->setPictures(std::move(captured), std::move(rendered));
  refreshTabs();
  refreshLabels();
  refreshTone();
  refreshReadout(std::nullopt);
}

void ComparisonPanel::refreshTabs() {
  const bool paired = view_->rendered() != nullptr, labelled = fit_ && !fit_->labels.empty();
  const QStringList tips{
      tr("The photograph left of a divider, the reconstruction right of it (Ctrl+1)"),
      tr("Photograph and reconstruction, both whole (Ctrl+2)"),
      tr("How much too bright (orange) or too dark (blue) the reconstruction is (Ctrl+3)"),
      tr("Which material each pixel of the first shot is of; a click chooses one (Ctrl+4)")};
  const QString whyNot = shot_ && shot_->white ? tr("Not now: a white tile has no reconstruction.")
                                               : tr("Not now: nothing is reconstructed yet.");
  for (int tab = 0; tab < tabs_->count(); ++tab) {
    const bool possible = tab == kLabelsTab ? labelled : tab == 0 || paired;
    tabs_->setTabEnabled(tab, possible || tab == tabs_->currentIndex());
    tabs_->setTabToolTip(tab, possible            ? tips[tab]
                              : tab == kLabelsTab ? tips[tab] + QStringLiteral("\n") +
                                                        tr("Not now: the reconstruction has one material.")
                                                  : tips[tab] + QStringLiteral("\n") + whyNot);
  }
  if (tabs_->currentIndex() == kLabelsTab && !labelled) tabs_->setCurrentIndex(0);
}

void ComparisonPanel::refreshLabels() {
  const bool shown = labelsShown();
  labels_->setVisible(shown);
  view_->setVisible(!shown);
  if (!shown || !fit_ || fit_->labels.empty()) return;
  // In colours that stand for no number; the chosen material is bright, the others dim.
  auto picture = std::make_shared<Image>(fit_->labels.width(), fit_->labels.height(), 3);
  for (int y = 0; y < picture->height(); ++y)
    for (int x = 0; x < picture->width(); ++x) {
      const int label = static_cast<int>(fit_->labels.at(x, y));
      if (label < 0) continue;
      const QColor colour = materialColour(label);
      const float dim = label == document_->material() ? 1.0f : 0.28f;
      picture->at(x, y, 0) = dim * static_cast<float>(colour.redF());
      picture->at(x, y, 1) = dim * static_cast<float>(colour.greenF());
      picture->at(x, y, 2) = dim * static_cast<float>(colour.blueF());
    }
  labels_->setPicture(std::move(picture), ToneStyle::LinearRgb);
}

void ComparisonPanel::refreshTone() {
  ToneSettings tone = automatic_;
  tone.exposureEv = exposure_->value();
  view_->setTone(tone);
  view_->setDifferenceRange(range_->value() / 100);
  const bool difference = !labelsShown() && mode() == ComparisonMode::Difference && view_->rendered();
  bar_->setVisible(difference);
  ToneSettings scale;
  scale.low = -range_->value();
  scale.high = range_->value();
  bar_->setScale(ToneStyle::Diverging, scale, tr("% too bright"));
  // A control that rests says why.
  const QString exposureTip = tr("Brightness of photograph and reconstruction alike, in stops");
  const QString rangeTip =
      tr("Relative difference at either end of the colours. Of the mean of the channels; where the "
         "photograph is darker than 1 % of its bright end, relative to that 1 %.");
  range_->setToolTip(difference ? rangeTip : rangeTip + tr("\nNot now: the difference is not shown."));
  const bool toned = !difference && !labelsShown();
  exposure_->setToolTip(toned ? exposureTip
                              : exposureTip + tr("\nNot now: these colours are not brightnesses."));
  exposureSlider_->setToolTip(exposure_->toolTip());
  rangeLabel_->setEnabled(difference);
  range_->setEnabled(difference);
  exposure_->setEnabled(toned);
  exposureSlider_->setEnabled(exposure_->isEnabled());
}

void ComparisonPanel::refreshReadout(std::optional<QPoint> pixel) {
  if (!pixel || !shot_) return readout_->setText({});
  QString text = QStringLiteral("%1, %2").arg(pixel->x()).arg(pixel->y());
  if (labelsShown()) {
    const int label = fit_ ? static_cast<int>(fit_->labels.at(pixel->x(), pixel->y())) : -1;
    readout_->setText(text + (label < 0 ? tr("  beside the sample") : tr("  material %1").arg(label + 1)));
    return;
  }
  const auto angles =
      shot_->white ? std::nullopt : anglesAtPixel(*capture_, *shot_->shot, pixel->x(), pixel->y());
  const auto captured = view_->captured()->pixel(pixel->x(), pixel->y());
  if (!view_->rendered()) {
    text += QStringLiteral("  ") + threeValues(captured);
  } else {
    const auto rendered = view_->rendered()->pixel(pixel->x(), pixel->y());
    text += tr("  photo %1  recon. %2").arg(threeValues(captured), threeValues(rendered));
    if (meanOf(captured) > 0) text += tr("  ratio %1").arg(meanOf(rendered) / meanOf(captured), 0, 'f', 2);
  }
  if (angles)
    text += QStringLiteral("  ") + namedAnglesText(*angles, 1);
  else if (!shot_->white)
    text += tr("  beside the sample");
  readout_->setText(text);
}

ComparisonMode ComparisonPanel::mode() const {
  return view_->mode();
}

void ComparisonPanel::setMode(ComparisonMode mode) {
  tabs_->setCurrentIndex(static_cast<int>(mode));
}

bool ComparisonPanel::labelsShown() const {
  return tabs_->currentIndex() == kLabelsTab;
}

void ComparisonPanel::setLabelsShown(bool shown) {
  tabs_->setCurrentIndex(shown ? kLabelsTab : static_cast<int>(view_->mode()));
}

double ComparisonPanel::exposureEv() const {
  return exposure_->value();
}

void ComparisonPanel::setExposureEv(double stops) {
  updating_ = true;
  exposure_->setValue(stops);
  exposureSlider_->setValue(static_cast<int>(std::lround(10 * exposure_->value())));
  updating_ = false;
  refreshTone();
}

double ComparisonPanel::differenceRange() const {
  return range_->value() / 100;
}

void ComparisonPanel::setDifferenceRange(double range) {
  range_->setValue(100 * range);
}

QString ComparisonPanel::readout() const {
  return readout_->text();
}

void ComparisonPanel::zoomIn() {
  labelsShown() ? labels_->zoomBy(1.25, QPointF(labels_->rect().center()))
                : view_->zoomBy(1.25, QPointF(view_->rect().center()));
}

void ComparisonPanel::zoomOut() {
  labelsShown() ? labels_->zoomBy(0.8, QPointF(labels_->rect().center()))
                : view_->zoomBy(0.8, QPointF(view_->rect().center()));
}

void ComparisonPanel::zoomToFit() {
  labelsShown() ? labels_->zoomToFit() : view_->zoomToFit();
}

}  // namespace patina
