#include "widgets/texel_inspector.h"

#include <QButtonGroup>
#include <QCheckBox>
#include <QComboBox>
#include <QHeaderView>
#include <QTabWidget>
#include <QTableWidget>
#include <algorithm>
#include <limits>
#include <numbers>

#include "engine/surface/svbrdf.h"
#include "widgets/elided_label.h"
#include "widgets/plot_widget.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr int kCurvePoints = 480;
constexpr int kLobePoints = 400;
/// Where DC stands on the logarithmic axis: left of frequency 1.
constexpr double kDcPlace = 0.6;

const QColor kChannelColours[3] = {QColor(238, 110, 100), QColor(120, 200, 124), QColor(110, 160, 245)};
const QColor kModelColour(236, 236, 236);

double wrapped(double phaseRad) {
  return std::remainder(phaseRad, 2 * std::numbers::pi);
}
double degrees(double rad) {
  return rad * 180 / std::numbers::pi;
}

Eigen::Vector2i directionOf(int index) {
  switch (index) {
    case 0:
      return {1, 0};
    case 1:
      return {0, 1};
    case 2:
      return {1, 1};
    default:
      return {1, -1};
  }
}

/// The multiple of `direction` that a frequency is; none where it lies elsewhere.
std::optional<int> multipleOf(const Eigen::Vector2i& frequency, const Eigen::Vector2i& direction) {
  const int k = direction.x() ? frequency.x() : frequency.y();
  if (frequency != k * direction) return std::nullopt;
  return k;
}

}  // namespace

TexelInspector::TexelInspector(Document* document, QWidget* parent) : QWidget(parent), document_(document) {
  setObjectName(QStringLiteral("texelInspector"));
  coalesce_.setSingleShot(true);
  coalesce_.setInterval(25);
  connect(&coalesce_, &QTimer::timeout, this, &TexelInspector::refresh);

  title_ = new ElidedLabel(this);
  title_->setObjectName(QStringLiteral("inspectorTitle"));
  title_->setMinimumWidth(40);
  follow_ = new QCheckBox(tr("Follow cursor"), this);
  follow_->setChecked(true);
  follow_->setToolTip(tr("Show the texel under the cursor while it is over a map; otherwise the picked one"));
  channels_ = new QButtonGroup(this);
  auto* channelRow = new QHBoxLayout;
  channelRow->setSpacing(2);
  for (int channel = 0; channel < 3; ++channel) {
    auto* button = new QToolButton(this);
    button->setText(QStringLiteral("RGB").mid(channel, 1));
    button->setCheckable(true);
    button->setFocusPolicy(Qt::StrongFocus);
    button->setToolTip(QStringList{tr("Red channel"), tr("Green channel"), tr("Blue channel")}[channel]);
    button->setStyleSheet(QStringLiteral("QToolButton { color: %1; font-weight: 600; padding: 3px 8px; }")
                              .arg(kChannelColours[channel].name()));
    channels_->addButton(button, channel);
    channelRow->addWidget(button);
  }
  channels_->button(1)->setChecked(true);
  direction_ = new QComboBox(this);
  direction_->addItems({tr("along x"), tr("along y"), tr("diagonal x = y"), tr("diagonal x = \u2212y")});
  direction_->setToolTip(tr("Direction of the slice through the frequency plane"));
  direction_->setAccessibleName(direction_->toolTip());
  aboutLobe_ = new QCheckBox(tr("about lobe"), this);
  aboutLobe_->setChecked(true);
  aboutLobe_->setToolTip(
      tr("Phases relative to the model's lobe centre: its place on the screen would otherwise turn the phase "
         "with frequency"));
  line_ = new QComboBox(this);
  line_->addItems({tr("horizontal"), tr("vertical")});
  line_->setToolTip(tr("Axis of the screen along which the lobe's profile is shown"));
  line_->setAccessibleName(line_->toolTip());

  magnitude_ = new PlotWidget(this);
  phase_ = new PlotWidget(this);
  phase_->setLegend(std::nullopt);
  magnitude_->setLegend(Qt::BottomLeftCorner);
  lobe_ = new PlotWidget(this);
  magnitude_->setAccessibleName(tr("Magnitude over frequency"));
  phase_->setAccessibleName(tr("Phase over frequency"));
  lobe_->setAccessibleName(tr("Lobe across the screen"));
  table_ = new QTableWidget(0, 3, this);
  table_->setHorizontalHeaderLabels({tr("Quantity"), tr("Value"), tr("Unit")});
  table_->verticalHeader()->hide();
  table_->setEditTriggers(QAbstractItemView::NoEditTriggers);
  table_->setSelectionBehavior(QAbstractItemView::SelectRows);
  table_->setShowGrid(false);
  table_->setAlternatingRowColors(true);
  table_->horizontalHeader()->setSectionResizeMode(0, QHeaderView::ResizeToContents);
  table_->horizontalHeader()->setSectionResizeMode(1, QHeaderView::ResizeToContents);
  table_->horizontalHeader()->setSectionResizeMode(2, QHeaderView::Stretch);
  table_->horizontalHeader()->setDefaultAlignment(Qt::AlignLeft);
  table_->setAccessibleName(tr("Parameters of the texel"));

  tabs_ = new QTabWidget(this);
  tabs_->setDocumentMode(true);
  const auto page = [this](std::initializer_list<QWidget*> tools,
                           std::initializer_list<std::pair<QWidget*, int>> plots) {
    auto* made = new QWidget(this);
    auto* column = new QVBoxLayout(made);
    column->setContentsMargins(4, 2, 4, 2);
    column->setSpacing(0);
    auto* row = new QHBoxLayout;
    for (QWidget* tool : tools) row->addWidget(tool);
    row->addStretch(1);
    column->addLayout(row);
    for (const auto& [plot, stretch] : plots) column->addWidget(plot, stretch);
    return made;
  };
  tabs_->addTab(page({direction_, aboutLobe_}, {{magnitude_, 5}, {phase_, 3}}), tr("Spectrum"));
  tabs_->addTab(page({line_}, {{lobe_, 1}}), tr("Lobe"));
  tabs_->addTab(table_, tr("Parameters"));
  tabs_->setTabToolTip(0, tr("Magnitude and phase over frequency: measured, model, and the model's parts"));
  tabs_->setTabToolTip(1,
                       tr("Reflected radiance over the screen: the measurements' Fourier sum and the model"));
  tabs_->setTabToolTip(2, tr("The fitted numbers, with units"));

  auto* head = new QHBoxLayout;
  head->setContentsMargins(10, 4, 8, 0);
  head->addWidget(title_, 1);
  head->addWidget(follow_);
  head->addSpacing(6);
  head->addLayout(channelRow);
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 0, 0, 2);
  column->setSpacing(2);
  column->addLayout(head);
  column->addWidget(tabs_, 1);

  connect(document_, &Document::fitChanged, this, &TexelInspector::refresh);
  connect(document_, &Document::pickChanged, this, &TexelInspector::refresh);
  connect(channels_, &QButtonGroup::idClicked, this, &TexelInspector::refresh);
  connect(direction_, &QComboBox::currentIndexChanged, this, &TexelInspector::refresh);
  connect(line_, &QComboBox::currentIndexChanged, this, &TexelInspector::refresh);
  connect(aboutLobe_, &QCheckBox::toggled, this, &TexelInspector::refresh);
  connect(follow_, &QCheckBox::toggled, this, &TexelInspector::refresh);
  connect(tabs_, &QTabWidget::currentChanged, this, &TexelInspector::refresh);
  refresh();
}

int TexelInspector::channel() const {
  return channels_->checkedId();
}
void TexelInspector::setChannel(int channel) {
  if (auto* button = channels_->button(std::clamp(channel, 0, 2))) button->setChecked(true);
  refresh();
}
int TexelInspector::direction() const {
  return direction_->currentIndex();
}
void TexelInspector::setDirection(int direction) {
  direction_->setCurrentIndex(std::clamp(direction, 0, 3));
}
bool TexelInspector::followsCursor() const {
  return follow_->isChecked();
}
void TexelInspector::setFollowsCursor(bool follows) {
  follow_->setChecked(follows);
}
bool TexelInspector::phaseAboutLobe() const {
  return aboutLobe_->isChecked();
}
void TexelInspector::setPhaseAboutLobe(bool about) {
  aboutLobe_->setChecked(about);
}
int TexelInspector::page() const {
  return tabs_->currentIndex();
}
void TexelInspector::setPage(int page) {
  tabs_->setCurrentIndex(std::clamp(page, 0, 2));
}

void TexelInspector::setHovered(std::optional<QPoint> texel) {
  hovered_ = texel;
  if (follow_->isChecked()) schedule();
}

std::optional<QPoint> TexelInspector::shownTexel() const {
  const auto fit = document_->fit();
  if (!fit) return std::nullopt;
  const auto texel = follow_->isChecked() && hovered_ ? hovered_ : document_->pickedTexel();
  if (!texel || !QRect(0, 0, fit->maps().width, fit->maps().height).contains(*texel)) return std::nullopt;
  return texel;
}

void TexelInspector::schedule() {
  // The latest texel wins; a fast cursor doesn't queue work.
  if (!coalesce_.isActive()) coalesce_.start();
}

void TexelInspector::refresh() {
  const auto fit = document_->fit();
  const auto texel = shownTexel();
  if (!fit || !texel) {
    title_->setText(tr("Texel"));
    const QString why = fit ? tr("Click a texel in a map to look at it.")
                            : tr("Fit the bundle (F5), then click a texel in a map.");
    for (PlotWidget* plot : {magnitude_, phase_, lobe_}) plot->clear();
    magnitude_->setEmptyText(why);
    lobe_->setEmptyText(why);
    table_->setRowCount(0);
    return;
  }
  const SvbrdfMaps& maps = fit->maps();
  const bool hovering = follow_->isChecked() && hovered_;
  title_->setText(tr("Texel (%1, %2)").arg(texel->x()).arg(texel->y()) + QStringLiteral("  \u00b7  ") +
                  (hovering ? tr("under the cursor") : tr("picked")));
  title_->setToolTip(tr("x %1 mm, y %2 mm from the sample's centre")
                         .arg(((texel->x() + 0.5) / maps.width - 0.5) * maps.widthMm, 0, 'f', 1)
                         .arg((0.5 - (texel->y() + 0.5) / maps.height) * maps.heightMm, 0, 'f', 1));
  switch (tabs_->currentIndex()) {
    case 0:
      refreshSpectrum(*fit, *texel);
      break;
    case 1:
      refreshLobe(*fit, *texel);
      break;
    default:
      refreshTable(*fit, *texel);
  }
}

void TexelInspector::refreshSpectrum(const FourierFit& fit, const QPoint& texel) {
  const int c = channel();
  const Eigen::Vector2i direction = directionOf(direction_->currentIndex());
  const auto samples = fit.spectrumAt(texel.x(), texel.y());
  if (samples.empty()) {
    magnitude_->clear();
    phase_->clear();
    return magnitude_->setEmptyText(tr("No photograph sees this texel."));
  }
  int largest = 1;
  for (const SpectrumSample& sample : samples)
    if (const auto k = multipleOf(sample.frequency, direction)) largest = std::max(largest, std::abs(*k));
  const auto curve =
      fit.modelSpectrumAt(texel.x(), texel.y(), direction.cast<double>(), largest * 1.15, kCurvePoints);

  // The lobe's place on the screen, from the slope of the specular part's phase at the origin.
  double placeRad = 0;
  if (aboutLobe_->isChecked() && curve.size() > 3) {
    const std::complex<double> a = curve[0].specular[c], b = curve[1].specular[c];
    if (std::abs(a) > 0 && std::abs(b) > 0)
      placeRad = -std::arg(b * std::conj(a)) / std::max(1e-9, curve[1].frequency - curve[0].frequency);
  }
  const auto phaseOf = [&](std::complex<double> value, double frequency) {
    return degrees(wrapped(std::arg(value) + placeRad * frequency));
  };

  PlotSeries measured{tr("measured"), kChannelColours[c], PlotSeries::Mark::Dots, {}, 1.5};
  PlotSeries held{tr("held out"), kChannelColours[c], PlotSeries::Mark::HollowDots, {}, 1.5};
  PlotSeries model{tr("model"), kModelColour, PlotSeries::Mark::Line, {}, 1.7};
  PlotSeries diffuse{tr("diffuse"), theme::kWarning, PlotSeries::Mark::DashedLine, {}, 1.4};
  PlotSeries specular{tr("specular"), theme::kAccent, PlotSeries::Mark::DashedLine, {}, 1.4};
  PlotSeries noise{tr("noise"), theme::kTextOff, PlotSeries::Mark::DottedLine, {}, 1.3};
  PlotSeries phaseMeasured = measured, phaseHeld = held, phaseModel = model;
  double low = 1e30, high = 1e-30;
  std::vector<QPointF> noiseLevels;
  for (const SpectrumSample& sample : samples) {
    const auto k = multipleOf(sample.frequency, direction);
    if (!k) continue;
    std::complex<double> value = sample.measured[c];
    if (*k < 0) value = std::conj(value);  // the spectrum of a real function
    const double place = *k == 0 ? kDcPlace : std::abs(*k);
    (sample.holdout ? held : measured).points.emplace_back(place, std::abs(value));
    (sample.holdout ? phaseHeld : phaseMeasured).points.emplace_back(place, phaseOf(value, std::abs(*k)));
    noiseLevels.emplace_back(place, sample.noiseSigma[c]);
    low = std::min({low, static_cast<double>(sample.noiseSigma[c]),
                    std::max(std::abs(value), 0.2 * sample.noiseSigma[c])});
    high = std::max(high, std::abs(value));
  }
  std::sort(noiseLevels.begin(), noiseLevels.end(),
            [](const QPointF& a, const QPointF& b) { return a.x() < b.x(); });
  noise.points = noiseLevels;
  double quietest = std::numeric_limits<double>::max();
  for (const QPointF& level : noiseLevels) quietest = std::min(quietest, level.y());
  double previous = 0;
  for (const SpectrumCurvePoint& point : curve) {
    if (point.frequency < 0.85 && point.frequency > 0)
      continue;  // between DC and the first frequency the axis is broken
    const double place = point.frequency == 0 ? kDcPlace : point.frequency;
    const std::complex<double> d = point.diffuse[c], s = point.specular[c];
    model.points.emplace_back(place, std::abs(d + s));
    diffuse.points.emplace_back(place, std::abs(d));
    specular.points.emplace_back(place, std::abs(s));
    high = std::max(high, std::abs(d + s));
    // Far below the noise the model's phase can't be compared with anything: the line would only flicker.
    const bool comparable = std::abs(d + s) > 0.3 * quietest;
    const double angle = comparable ? phaseOf(d + s, point.frequency) : std::nan("");
    if (!phaseModel.points.empty() && std::abs(angle - previous) > 180)
      phaseModel.points.emplace_back(place, std::nan(""));
    phaseModel.points.emplace_back(place, angle);
    previous = angle;
    if (point.frequency == 0)
      for (PlotSeries* series : {&model, &diffuse, &specular, &phaseModel})
        series->points.emplace_back(place, std::nan(""));
  }
  // DC has its own short piece of line, so that its model value is seen.
  for (PlotSeries* series : {&model, &diffuse, &specular, &phaseModel}) {
    if (series->points.empty() || series->points.front().x() != kDcPlace) continue;
    const double value = series->points.front().y();
    series->points.insert(
        series->points.begin(),
        {QPointF(kDcPlace * 0.91, value), QPointF(kDcPlace * 1.1, value), QPointF(kDcPlace, std::nan(""))});
  }

  if (!(low > 0) || low > high) low = high * 1e-4;
  PlotAxis across;
  across.logarithmic = true;
  across.low = kDcPlace * 0.82;
  across.high = largest * 1.15;
  across.title = QStringList{
      tr("\u03c9 along x (wavelengths over the screen's width)"),
      tr("\u03c9 along y (wavelengths over the screen's width)"),
      tr("\u03c9 = (k, k), k in wavelengths over the screen's width"),
      tr("\u03c9 = (k, \u2212k), k in wavelengths over the screen's width")}[direction_->currentIndex()];
  across.ticks = {{kDcPlace, QStringLiteral("0")}};
  for (const int tick : {1, 2, 3, 4, 6, 10, 20, 40, 80})
    if (tick <= across.high) across.ticks.emplace_back(tick, QString::number(tick));
  PlotAxis up;
  up.logarithmic = true;
  up.low = low * 0.6;
  up.high = high * 2;
  up.title = tr("|Z| (full white)");
  PlotAxis turn;
  turn.low = -190;
  turn.high = 190;
  turn.title = tr("phase (\u00b0)");
  turn.ticks = {{-180, QStringLiteral("\u2212180")}, {0, QStringLiteral("0")}, {180, QStringLiteral("180")}};
  PlotAxis below = across;
  across.title.clear();  // the phase plot below has it for both
  magnitude_->setAxes(across, up);
  phase_->setAxes(below, turn);
  magnitude_->setSeries({noise, diffuse, specular, model, measured, held});
  phase_->setSeries({phaseModel, phaseMeasured, phaseHeld});
}

void TexelInspector::refreshLobe(const FourierFit& fit, const QPoint& texel) {
  const int c = channel();
  const bool horizontal = line_->currentIndex() == 0;
  const LobeSlice slice = fit.lobeAt(texel.x(), texel.y(), horizontal, kLobePoints);
  if (slice.position.empty()) {
    lobe_->clear();
    return lobe_->setEmptyText(tr("No photograph sees this texel."));
  }
  const double unitMm = fit.capture().screen.unitMm();
  PlotSeries model{tr("model"), kModelColour, PlotSeries::Mark::Line, {}, 1.8};
  PlotSeries data{tr("Fourier sum of the data"), kChannelColours[c], PlotSeries::Mark::Line, {}, 1.3};
  double low = 0, high = 1e-12;
  for (std::size_t i = 0; i < slice.position.size(); ++i) {
    const double x = slice.position[i] * unitMm;
    if (i < slice.model.size()) model.points.emplace_back(x, slice.model[i][c]);
    if (i < slice.measured.size()) data.points.emplace_back(x, slice.measured[i][c]);
  }
  for (const PlotSeries* series : {&model, &data})
    for (const QPointF& point : series->points)
      if (std::isfinite(point.y())) {
        low = std::min(low, point.y());
        high = std::max(high, point.y());
      }
  PlotAxis across;
  across.low = slice.position.front() * unitMm;
  across.high = slice.position.back() * unitMm;
  across.title =
      horizontal ? tr("x on the screen (mm), summed over y") : tr("y on the screen (mm), summed over x");
  PlotAxis up;
  const double margin = 0.06 * (high - low);
  up.low = low - margin;
  up.high = high + margin;
  up.title = tr("f (full white per unit)");
  const double edge = (horizontal ? fit.capture().screen.widthMm : fit.capture().screen.heightMm) / 2;
  std::vector<std::pair<double, QString>> guides;
  if (across.low < -edge * 1.001) guides.emplace_back(-edge, tr("screen's edge"));
  if (across.high > edge * 1.001) guides.emplace_back(edge, tr("screen's edge"));
  lobe_->setAxes(across, up);
  lobe_->setGuides(guides);
  lobe_->setSeries({data, model});
}

void TexelInspector::refreshTable(const FourierFit& fit, const QPoint& texel) {
  const SvbrdfMaps& maps = fit.maps();
  const SvbrdfParameters parameters = fit.parametersAt(texel.x(), texel.y());
  const int x = texel.x(), y = texel.y();
  struct Row {
    QString name, value, unit;
  };
  // A value and, in a fit that has them, its standard deviation.
  const auto colour = [&](const Eigen::Array3f& v, const Image& sd) {
    QString text = QString::asprintf("%.4f   %.4f   %.4f", v[0], v[1], v[2]);
    if (!sd.empty())
      text += QString::asprintf("  \u00b1 %.2g", (sd.at(x, y, 0) + sd.at(x, y, 1) + sd.at(x, y, 2)) / 3);
    return text;
  };
  const auto number = [&](double value, int digits, const Image& sd) {
    QString text = QString::number(value, 'f', digits);
    if (!sd.empty()) text += QString::asprintf("  \u00b1 %.2g", sd.at(x, y));
    return text;
  };
  const Eigen::Vector3f n = parameters.normal;
  const double tilt = degrees(std::acos(std::clamp(n.z(), -1.0f, 1.0f)));
  const auto sigmas = svbrdfLobeSigmas(parameters.sigma, parameters.kurtosis);
  std::vector<Row> rows{
      {tr("Status"), statusName(static_cast<int>(std::lround(maps.status.at(x, y)))), {}},
      {tr("Place"),
       QString::asprintf("x %+.2f   y %+.2f", ((x + 0.5) / maps.width - 0.5) * maps.widthMm,
                         (0.5 - (y + 0.5) / maps.height) * maps.heightMm),
       tr("mm")},
      {tr("Diffuse"), colour(parameters.diffuse, maps.diffuseSd), tr("albedo R G B")},
      {tr("Specular"), colour(parameters.specular, maps.specularSd), tr("albedo R G B")},
      {tr("Sigma"), number(parameters.sigma, 5, maps.sigmaSd), tr("slope")},
      {tr("Kurtosis \u03b3"), number(parameters.kurtosis, 4, maps.kurtosisSd), tr("1 = Gaussian")},
      {tr("Narrow, wide lobe"), QString::asprintf("%.5f   %.5f", sigmas[0], sigmas[1]), tr("slope")},
      {tr("Normal"), QString::asprintf("%+.4f   %+.4f   %+.4f", n.x(), n.y(), n.z()), tr("X Y Z")},
      {tr("Tilt, towards"), QString::asprintf("%.2f   %.0f", tilt, degrees(std::atan2(n.y(), n.x()))),
       tr("\u00b0, \u00b0 from +x")},
      {tr("Direction \u00b1"),
       maps.normalSd.empty() ? tr("not known") : QString::asprintf("%.2g", maps.normalSd.at(x, y)),
       tr("\u00b0, of the normal")},
      {tr("Residual"), QString::number(maps.residual.at(x, y), 'f', 4), tr("relative RMS, fitted")},
  };
  double error = 0, energy = 0;
  int held = 0;
  const bool cancelled = fit.stats().cancelled;  // then at most a part of them was read
  const std::vector<SpectrumSample> spectrum = fit.spectrumAt(x, y);
  for (const SpectrumSample& sample : spectrum) {
    if (!sample.holdout || cancelled) continue;
    ++held;
    for (int c = 0; c < 3; ++c) {
      error += std::norm(sample.measured[c] - sample.diffuse[c] - sample.specular[c]);
      energy += std::norm(sample.measured[c]);
    }
  }
  const auto& photos = fit.capture().photos;
  const bool anyHeldOut =
      std::any_of(photos.begin(), photos.end(), [](const FourierPhoto& photo) { return photo.holdout; });
  const QString noError = spectrum.empty() ? tr("not measured here")
                          : held           ? tr("held-out photographs are black here")
                          : anyHeldOut     ? tr("held-out photographs were not read")
                                           : tr("none held out");
  rows.push_back({tr("Held-out error"),
                  held && energy > 0 ? QString::number(std::sqrt(error / energy), 'f', 4) : noError,
                  held ? tr("relative RMS, %1 frequencies").arg(held) : QString()});
  table_->setRowCount(static_cast<int>(rows.size()));
  for (int i = 0; i < static_cast<int>(rows.size()); ++i) {
    const QString texts[3] = {rows[i].name, rows[i].value, rows[i].unit};
    for (int column = 0; column < 3; ++column) {
      if (!table_->item(i, column)) table_->setItem(i, column, new QTableWidgetItem);
      table_->item(i, column)->setText(texts[column]);
      table_->item(i, column)->setToolTip(texts[column]);
      if (column == 1) table_->item(i, column)->setFont(theme::numberFont());
      if (column != 1) table_->item(i, column)->setForeground(theme::kTextDim);
    }
  }
  table_->verticalHeader()->setDefaultSectionSize(table_->fontMetrics().height() + 7);
}

}  // namespace patina
