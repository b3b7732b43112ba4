#include "widgets/brdf_slices_panel.h"

#include <QCheckBox>
#include <QComboBox>
#include <QFileDialog>
#include <QResizeEvent>
#include <limits>
#include <numbers>

#include "engine/image/png.h"
#include "engine/render/brdf_slices.h"
#include "widgets/certainty_bar.h"
#include "widgets/elided_label.h"
#include "widgets/flow_layout.h"
#include "widgets/plot_widget.h"
#include "widgets/slice_picture.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr ThetaHAxis kAxis = ThetaHAxis::Root;
constexpr int kBesideFromWidth = 620;  ///< pixels from which curves and picture stand side by side
constexpr double kMostDecades = 6;
/// Curves at grazing, at the paper's own two shots and between; the last button is what was clicked.
constexpr std::array kThetaDs{5.0, 30.0, 55.0, 75.0};
const std::array kCurveColours{QColor(104, 176, 250), QColor(122, 208, 150), QColor(250, 206, 96),
                               QColor(250, 132, 100), QColor(222, 222, 222)};
const std::array kChannelColours{QColor(240, 92, 84), QColor(100, 200, 104), QColor(92, 140, 250)};

enum Channel { kLuminance, kAllThree, kRed, kGreen, kBlue };

double channelOf(const Eigen::Array3d& value, int channel) {
  return channel == kLuminance ? 0.2126 * value[0] + 0.7152 * value[1] + 0.0722 * value[2]
                               : value[channel - kRed];
}

QString figures(double value) {
  if (!std::isfinite(value)) return QStringLiteral("\u2013");
  return QString::number(value, 'g', value != 0 && std::abs(value) < 1e-3 ? 2 : 3);
}

}  // namespace

BrdfSlicesPanel::BrdfSlicesPanel(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("brdfSlices"));
  plot_ = new PlotWidget(this);
  plot_->setAccessibleName(tr("Curves of the BRDF over theta h"));
  plot_->setEmptyText(tr("Curves of the reconstructed BRDF appear here"));
  plot_->setReadout([](const PlotSeries& series, const QPointF& point) {
    return tr("%1, \u03b8h %2\u00b0: %3 /sr")
        .arg(series.name)
        .arg(thetaHDegAt(point.x(), kAxis), 0, 'f', 1)
        .arg(figures(point.y()));
  });
  picture_ = new SlicePicture(this);
  channel_ = new QComboBox(this);
  channel_->setObjectName(QStringLiteral("sliceChannel"));
  channel_->addItems({tr("Luminance"), tr("Red, green, blue"), tr("Red"), tr("Green"), tr("Blue")});
  channel_->setAccessibleName(tr("Channel of the curves"));
  channel_->setToolTip(tr("What the curves show. Luminance: 0.21 red + 0.72 green + 0.07 blue"));
  look_ = new QComboBox(this);
  look_->setObjectName(QStringLiteral("sliceLook"));
  look_->addItems({tr("Logarithm"), tr("As seen"), tr("Certainty")});
  look_->setAccessibleName(tr("Colours of the picture"));
  look_->setToolTip(
      tr("Colours of the picture: the luminance's logarithm; as a photograph would show it, a white matt "
         "surface "
         "being white; or how well each direction is determined"));
  certainty_ = new QCheckBox(tr("Certainty"), this);
  certainty_->setChecked(true);
  dots_ = new QCheckBox(tr("Measured"), this);
  dots_->setChecked(true);
  dots_->setToolTip(
      tr("Dots where the photographs measured, as far as the slice at \u03c6d = 90\u00b0 can show it"));
  save_ = new QToolButton(this);
  save_->setIcon(theme::icon(QStringLiteral("save")));
  save_->setAccessibleName(tr("Save the slices"));
  save_->setToolTip(tr("Save the curves as a table (CSV), or the picture as PNG"));
  save_->setFocusPolicy(Qt::StrongFocus);
  readout_ = new ElidedLabel(this);
  readout_->setFont(theme::captionFont());
  readout_->setContentsMargins(8, 2, 8, 4);

  auto* controls = new QWidget(this);
  auto* flow = new FlowLayout(controls, 8);
  flow->setContentsMargins(8, 4, 8, 4);
  auto* angles = new QWidget(controls);
  auto* row = new QHBoxLayout(angles);
  row->setContentsMargins(0, 0, 0, 0);
  row->setSpacing(2);
  auto* caption = new QLabel(QStringLiteral("\u03b8d"), angles);
  caption->setProperty("role", "caption");
  row->addWidget(caption);
  for (std::size_t i = 0; i <= kThetaDs.size(); ++i) {
    auto* button = new QToolButton(angles);
    button->setCheckable(true);
    button->setFocusPolicy(Qt::StrongFocus);
    button->setFont(theme::captionFont());
    if (i < kThetaDs.size()) {
      button->setChecked(true);
      button->setText(QStringLiteral("%1\u00b0").arg(kThetaDs[i]));
      button->setAccessibleName(tr("Curve at theta d %1 degrees").arg(kThetaDs[i]));
      button->setToolTip(tr("Curve at \u03b8d = %1\u00b0").arg(kThetaDs[i]));
    } else {
      button->setObjectName(QStringLiteral("pickedThetaD"));
      button->hide();
    }
    connect(button, &QToolButton::toggled, this, &BrdfSlicesPanel::refreshCurves);
    row->addWidget(button);
    thetaD_.push_back(button);
  }
  flow->addWidget(angles);
  flow->addWidget(channel_);
  flow->addWidget(look_);
  flow->addWidget(certainty_);
  flow->addWidget(dots_);
  flow->addWidget(save_);
  QSizePolicy policy(QSizePolicy::Preferred, QSizePolicy::Preferred);  // as high as its lines need
  policy.setHeightForWidth(true);
  controls->setSizePolicy(policy);

  body_ = new QBoxLayout(QBoxLayout::TopToBottom);
  body_->setSpacing(4);
  body_->addWidget(plot_, 5);
  body_->addWidget(picture_, 4);
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(0);
  column->addLayout(body_, 1);
  column->addWidget(readout_);
  column->addWidget(controls);

  chooseFile_ = [this] {
    return QFileDialog::getSaveFileName(this, tr("Save the slices"), QStringLiteral("slices.csv"),
                                        tr("Curves as a table (*.csv);;Picture (*.png)"));
  };
  connect(channel_, &QComboBox::currentIndexChanged, this, &BrdfSlicesPanel::refreshCurves);
  connect(look_, &QComboBox::currentIndexChanged, this,
          [this](int index) { picture_->setLook(static_cast<SlicePicture::Look>(index)); });
  connect(certainty_, &QCheckBox::toggled, this, [this](bool on) {
    picture_->setContours(on);
    refreshCurves();
  });
  connect(dots_, &QCheckBox::toggled, this,
          [this](bool on) { picture_->setMeasured(on ? measured_ : std::vector<HalfDiffAngles>()); });
  connect(save_, &QToolButton::clicked, this, &BrdfSlicesPanel::save);
  connect(picture_, &SlicePicture::hovered, this, &BrdfSlicesPanel::readOut);
  connect(picture_, &SlicePicture::picked, this,
          [this](const HalfDiffAngles& at) { showCurveThrough(at.thetaDRad / kDegree); });
  refresh();
}

BrdfSlicesPanel::~BrdfSlicesPanel() = default;

void BrdfSlicesPanel::setMaterial(std::shared_ptr<const TabulatedBrdf> brdf,
                                  std::shared_ptr<const std::vector<float>> posteriorSd, double priorSd) {
  if (posteriorSd && posteriorSd->size() != MerlGrid::kCells) posteriorSd.reset();
  brdf_ = std::move(brdf);
  posteriorSd_ = brdf_ ? std::move(posteriorSd) : nullptr;
  priorSd_ = priorSd;
  picture_->setMaterial(brdf_, posteriorSd_, priorSd_);
  refresh();
}

void BrdfSlicesPanel::setReference(std::shared_ptr<const TabulatedBrdf> brdf, const QString& name) {
  reference_ = std::move(brdf);
  referenceName_ = !name.isEmpty() ? name
                   : !reference_   ? QString()
                                   : QString::fromStdString(reference_->origin().name);
  if (reference_ && referenceName_.isEmpty()) referenceName_ = tr("reference");
  refreshCurves();
}

void BrdfSlicesPanel::setMeasured(const std::vector<HalfDiffAngles>& angles) {
  measured_ = angles;
  dots_->setVisible(!measured_.empty());
  picture_->setMeasured(dots_->isChecked() ? measured_ : std::vector<HalfDiffAngles>());
}

QString BrdfSlicesPanel::readout() const {
  return readout_->text();
}

void BrdfSlicesPanel::refresh() {
  const bool shown = brdf_ != nullptr, known = posteriorSd_ != nullptr;
  for (QToolButton* button : thetaD_) button->setEnabled(shown);
  for (QWidget* widget :
       {static_cast<QWidget*>(channel_), static_cast<QWidget*>(look_), static_cast<QWidget*>(save_)})
    widget->setEnabled(shown);
  certainty_->setEnabled(known);
  certainty_->setToolTip(
      known ? tr("Bands of one standard deviation round the curves, its contours on the picture")
            : tr("How well this material is determined is not known: it was not reconstructed "
                 "here"));
  dots_->setVisible(!measured_.empty());
  if (!known && look_->currentIndex() == 2) look_->setCurrentIndex(0);
  if (known && look_->count() == 2) look_->addItem(tr("Certainty"));
  if (!known && look_->count() == 3) look_->removeItem(2);
  readOut(std::nullopt);
  refreshCurves();
}

std::vector<double> BrdfSlicesPanel::shownThetaDs() const {
  std::vector<double> shown;
  for (std::size_t i = 0; i < thetaD_.size(); ++i)
    if (thetaD_[i]->isChecked() && (i < kThetaDs.size() || pickedThetaDDeg_ >= 0))
      shown.push_back(i < kThetaDs.size() ? kThetaDs[i] : pickedThetaDDeg_);
  return shown;
}

void BrdfSlicesPanel::showCurveThrough(double thetaDDeg) {
  pickedThetaDDeg_ = std::clamp(std::round(thetaDDeg * 2) / 2, 0.0, 90.0);
  QToolButton* button = thetaD_.back();
  button->setText(QStringLiteral("%1\u00b0").arg(pickedThetaDDeg_));
  button->setAccessibleName(tr("Curve at theta d %1 degrees").arg(pickedThetaDDeg_));
  button->setToolTip(tr("Curve at \u03b8d = %1\u00b0, as clicked on the picture").arg(pickedThetaDDeg_));
  button->show();
  if (button->isChecked()) return refreshCurves();
  button->setChecked(true);
}

void BrdfSlicesPanel::refreshCurves() {
  if (!brdf_) {
    picture_->setCurves({});
    return plot_->clear();
  }
  const int channel = channel_->currentIndex();
  const bool band = posteriorSd_ && certainty_->isChecked();
  std::vector<PlotSeries> bands, lines;
  std::vector<std::pair<double, QColor>> marks;
  double low = std::numeric_limits<double>::infinity(), high = 0;
  const auto add = [&](const TabulatedBrdf& brdf, double thetaD, std::size_t index, bool reference) {
    const auto curve = sliceCurve(brdf, reference ? nullptr : posteriorSd_.get(), thetaD);
    const QColor own = kCurveColours[index];
    const std::vector<int> channels =
        channel == kAllThree ? std::vector<int>{kRed, kGreen, kBlue} : std::vector<int>{channel};
    for (const int each : channels) {
      PlotSeries line, area;
      line.name = reference ? QStringLiteral("%1 %2\u00b0").arg(referenceName_).arg(thetaD)
                            : QStringLiteral("\u03b8d %1\u00b0").arg(thetaD);
      if (channel == kAllThree)
        line.name += QStringLiteral(" ") +
                     std::array{tr("R"), tr("G"), tr("B")}[static_cast<std::size_t>(each - kRed)];
      line.colour = channel == kAllThree ? kChannelColours[static_cast<std::size_t>(each - kRed)] : own;
      // Lighter towards grazing, so that thetaD can be told where colour says the channel.
      if (channel == kAllThree) line.colour = line.colour.lighter(100 + 14 * static_cast<int>(index));
      line.mark = reference ? PlotSeries::Mark::DashedLine : PlotSeries::Mark::Line;
      line.penWidth = reference ? 1.2 : 1.7;
      // The legend says each thing once; the bubble at a line says all of it.
      const bool first = marks.empty() || (reference && marks.size() == 1);
      line.legend = reference              ? (first && each == channels.front() ? referenceName_ : QString())
                    : channel != kAllThree ? line.name
                                           : (first ? line.name.section(' ', -1) : QString());
      area.colour = line.colour;
      area.mark = PlotSeries::Mark::Band;
      std::vector<QPointF> below;
      for (const SlicePoint& point : curve) {
        const double x = partOfThetaH(point.thetaHDeg, kAxis), y = channelOf(point.brdf, each);
        const bool good = std::isfinite(y) && y > 0;
        line.points.emplace_back(x, good ? y : std::numeric_limits<double>::quiet_NaN());
        if (!good) continue;
        low = std::min(low, y);
        high = std::max(high, y);
        if (point.sd < 0) continue;
        area.points.emplace_back(x, y * std::exp(point.sd));
        below.emplace_back(x, y * std::exp(-point.sd));
      }
      area.points.insert(area.points.end(), below.rbegin(), below.rend());
      if (band && !reference && !area.points.empty()) bands.push_back(std::move(area));
      lines.push_back(std::move(line));
    }
    if (!reference) marks.emplace_back(thetaD, own);
  };
  for (std::size_t i = 0; i < thetaD_.size(); ++i) {
    if (!thetaD_[i]->isChecked() || (i == kThetaDs.size() && pickedThetaDDeg_ < 0)) continue;
    const double thetaD = i < kThetaDs.size() ? kThetaDs[i] : pickedThetaDDeg_;
    add(*brdf_, thetaD, i, false);
    if (reference_) add(*reference_, thetaD, i, true);
  }
  PlotAxis across, up;
  across.title = tr("\u03b8h, half-vector to normal (\u03c6d = 90\u00b0)");
  for (const double tick : {0.0, 1.0, 5.0, 15.0, 30.0, 60.0, 90.0})
    across.ticks.emplace_back(partOfThetaH(tick, kAxis), QStringLiteral("%1\u00b0").arg(tick));
  up.title = tr("BRDF (1/sr)");
  up.logarithmic = true;
  up.high = high > 0 ? high * 1.6 : 1;
  up.low =
      std::clamp(std::isfinite(low) ? low / 1.6 : 0.1, up.high * std::pow(10.0, -kMostDecades), up.high / 8);
  plot_->setAxes(across, up);
  bands.insert(bands.end(), lines.begin(), lines.end());
  plot_->setEmptyText(tr("Choose a \u03b8d below, or click on the picture"));
  plot_->setSeries(std::move(bands));
  picture_->setCurves(std::move(marks));
}

void BrdfSlicesPanel::readOut(const std::optional<HalfDiffAngles>& angles) {
  if (!brdf_ || !angles) {
    readout_->setText(brdf_ ? tr("Point at the picture to read a direction; click for its curve")
                            : QString());
    return;
  }
  const Eigen::Array3d value = brdf_->evaluate(*angles);
  QString text = tr("\u03b8h %1\u00b0, \u03b8d %2\u00b0: ")
                     .arg(angles->thetaHRad / kDegree, 0, 'f', 1)
                     .arg(angles->thetaDRad / kDegree, 0, 'f', 1);
  text += value.allFinite()
              ? tr("R %1  G %2  B %3 /sr").arg(figures(value[0]), figures(value[1]), figures(value[2]))
              : tr("not measured");
  if (posteriorSd_) text += QStringLiteral(", ") + certaintyText(posteriorSdAt(*posteriorSd_, *angles));
  if (reference_) {
    const Eigen::Array3d other = reference_->evaluate(*angles);
    if (other.allFinite())
      text += tr(";  %1: R %2  G %3  B %4")
                  .arg(referenceName_, figures(other[0]), figures(other[1]), figures(other[2]));
  }
  readout_->setText(text);
}

void BrdfSlicesPanel::save() {
  if (!brdf_) return;
  const QString file = chooseFile_();
  if (file.isEmpty()) return;
  const std::filesystem::path path = file.toStdString();
  Status written = Done{};
  if (path.extension() == ".png") {
    const QImage shown = picture_->grab().toImage().convertToFormat(QImage::Format_RGB888);
    Image picture(shown.width(), shown.height(), 3);
    for (int y = 0; y < shown.height(); ++y)
      for (int x = 0; x < 3 * shown.width(); ++x)
        picture.samples()[static_cast<std::size_t>(y) * 3 * static_cast<std::size_t>(shown.width()) + x] =
            static_cast<float>(shown.constScanLine(y)[x]) / 255;
    written = writePng(path, picture);
  } else {
    written = writeSlicesCsv(path, *brdf_, posteriorSd_.get(), shownThetaDs());
  }
  if (!written) {
    const QString sentence = QString::fromStdString(written.error().sentence());
    readout_->setText(sentence);
    Q_EMIT failed(sentence);
    return;
  }
  readout_->setText(tr("Saved %1").arg(file));
  Q_EMIT saved(file);
}

void BrdfSlicesPanel::resizeEvent(QResizeEvent* event) {
  QWidget::resizeEvent(event);
  body_->setDirection(width() >= kBesideFromWidth ? QBoxLayout::LeftToRight : QBoxLayout::TopToBottom);
}

}  // namespace patina
