#include "widgets/camera_panel.h"

#include <QComboBox>
#include <QDoubleSpinBox>
#include <QFormLayout>
#include <QListWidget>
#include <QPushButton>
#include <QScrollArea>
#include <QSlider>
#include <QStyle>

#include "widgets/theme.h"

namespace patina {

namespace {

constexpr int kSliderSteps = 1000;
constexpr double kLogFrom =
    50;  ///< a range that spans this factor is a slider of factors, not of differences

bool logarithmic(const CameraControl& control) {
  return control.least > 0 && control.most / control.least > kLogFrom;
}

int sliderOf(const CameraControl& control, double value) {
  if (!(control.most > control.least)) return 0;
  const double share = logarithmic(control)
                           ? std::log(value / control.least) / std::log(control.most / control.least)
                           : (value - control.least) / (control.most - control.least);
  return static_cast<int>(std::lround(kSliderSteps * std::clamp(share, 0.0, 1.0)));
}

double valueOf(const CameraControl& control, int slider) {
  const double share = static_cast<double>(slider) / kSliderSteps;
  return logarithmic(control) ? control.least * std::pow(control.most / control.least, share)
                              : control.least + share * (control.most - control.least);
}

QString nameOf(CameraControlId id) {
  QString name = QString::fromStdString(controlName(id));
  if (!name.isEmpty()) name[0] = name[0].toUpper();
  return name;
}

}  // namespace

// ---- histogram ----

HistogramView::HistogramView(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("histogram"));
  setAccessibleName(tr("Histogram of the live picture"));
  setToolTip(tr("How many pixels have which value, dark on the left; the last bar is what the sensor clips"));
}

void HistogramView::setFrame(LiveFramePtr frame) {
  frame_ = std::move(frame);
  update();
}

void HistogramView::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.fillRect(rect(), theme::kSunken);
  if (!frame_) return;
  // Square root of the counts: a few clipped pixels must show beside a dark background.
  double most = 1;
  for (const auto& channel : frame_->histogram)
    for (const int count : channel) most = std::max(most, std::sqrt(static_cast<double>(count)));
  painter.setCompositionMode(QPainter::CompositionMode_Plus);
  const QColor inks[] = {QColor(150, 50, 44), QColor(40, 120, 56), QColor(48, 84, 160)};
  const std::size_t bins = frame_->histogram[0].size();
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < bins; ++i) {
      const double tall = (height() - 2) * std::sqrt(static_cast<double>(frame_->histogram[c][i])) / most;
      const double left = static_cast<double>(i) * width() / static_cast<double>(bins);
      painter.fillRect(QRectF(left, height() - tall, static_cast<double>(width()) / bins, tall), inks[c]);
    }
  painter.setCompositionMode(QPainter::CompositionMode_SourceOver);
  if (frame_->clippedShare > 0) painter.fillRect(QRect(width() - 3, 0, 3, height()), theme::kError);
}

// ---- panel ----

CameraPanel::CameraPanel(QWidget* parent) : QWidget(parent) {
  list_ = new QListWidget(this);
  list_->setObjectName(QStringLiteral("cameraList"));
  list_->setAccessibleName(tr("Cameras"));
  list_->setWordWrap(true);
  list_->setSpacing(2);
  list_->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  use_ = new QPushButton(tr("Use This Camera"), this);
  use_->setObjectName(QStringLiteral("useCamera"));
  look_ = new QPushButton(tr("Look Again"), this);
  look_->setObjectName(QStringLiteral("lookForCameras"));
  look_->setToolTip(tr("Cameras that were plugged in meanwhile"));
  folder_ = new QPushButton(tr("A Folder\u2026"), this);
  folder_->setToolTip(
      tr("Photographs that another program puts into a folder: tethered shooting, or a finished set"));
  rigFile_ = new QPushButton(tr("A Rig File\u2026"), this);
  rigFile_->setToolTip(tr("A simulated rig that a JSON file describes, for training"));
  auto* buttons = new QHBoxLayout;
  buttons->addWidget(look_);
  buttons->addWidget(folder_);
  buttons->addWidget(rigFile_);
  auto* left = new QVBoxLayout;
  left->addWidget(list_, 1);
  left->addWidget(use_);
  left->addLayout(buttons);

  view_ = new LiveView(this);
  view_->setEmptyText(tr("Choose a camera to see its picture"));
  histogram_ = new HistogramView(this);
  histogram_->setFixedHeight(72);
  clipped_ = new QLabel(this);
  clipped_->setObjectName(QStringLiteral("clippedShare"));
  clipped_->setProperty("role", "caption");
  auto* middle = new QVBoxLayout;
  middle->addWidget(view_, 1);
  middle->addWidget(histogram_);
  middle->addWidget(clipped_);

  formats_ = new QComboBox(this);
  formats_->setObjectName(QStringLiteral("cameraFormat"));
  formats_->setAccessibleName(tr("Format"));
  formats_->setToolTip(tr("How the camera sends its pictures: those that are linear in light come first"));
  formats_->setSizeAdjustPolicy(QComboBox::AdjustToMinimumContentsLengthWithIcon);
  controlsBox_ = new QWidget(this);
  controls_ = new QFormLayout(controlsBox_);
  controls_->setContentsMargins(0, 0, 6, 0);
  controls_->setRowWrapPolicy(QFormLayout::WrapAllRows);
  noControls_ = new QLabel(this);
  noControls_->setWordWrap(true);
  noControls_->setProperty("role", "caption");
  remarks_ = new QLabel(this);
  remarks_->setObjectName(QStringLiteral("cameraRemarks"));
  remarks_->setWordWrap(true);
  remarks_->setStyleSheet(QStringLiteral("color: %1;").arg(theme::kWarning.name()));
  auto* scroll = new QScrollArea(this);
  scroll->setWidget(controlsBox_);
  scroll->setWidgetResizable(true);
  scroll->setFrameShape(QFrame::NoFrame);
  scroll->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  auto* right = new QVBoxLayout;
  auto* caption = new QLabel(tr("Format"), this);
  caption->setBuddy(formats_);
  right->addWidget(caption);
  right->addWidget(formats_);
  right->addWidget(noControls_);
  right->addWidget(scroll, 1);
  right->addWidget(remarks_);

  auto* row = new QHBoxLayout(this);
  row->setContentsMargins(0, 0, 0, 0);
  row->setSpacing(14);
  row->addLayout(left, 5);
  row->addLayout(middle, 9);
  row->addLayout(right, 5);

  connect(look_, &QPushButton::clicked, this, &CameraPanel::lookRequested);
  connect(folder_, &QPushButton::clicked, this, &CameraPanel::folderRequested);
  connect(rigFile_, &QPushButton::clicked, this, &CameraPanel::rigFileRequested);
  const auto open = [this] {
    if (QListWidgetItem* item = list_->currentItem(); item && item->flags().testFlag(Qt::ItemIsEnabled))
      Q_EMIT openRequested(item->data(Qt::UserRole).toString());
  };
  connect(use_, &QPushButton::clicked, this, open);
  connect(list_, &QListWidget::itemActivated, this, open);
  connect(list_, &QListWidget::currentRowChanged, this, [this] { refreshUse(); });
  connect(formats_, &QComboBox::activated, this, &CameraPanel::formatRequested);
  setControls({});
  setFormats({}, {});
  refreshUse();
}

void CameraPanel::setCameras(const std::vector<CameraInfo>& cameras, const QString& preselected) {
  const QString kept =
      list_->currentItem() ? list_->currentItem()->data(Qt::UserRole).toString() : preselected;
  cameras_ = cameras;
  list_->clear();
  for (const CameraInfo& camera : cameras_) {
    QString text =
        QString::fromStdString(camera.name) + QLatin1Char('\n') + QString::fromStdString(camera.backend);
    const QString id = QString::fromStdString(camera.id);
    if (!camera.remark.empty() && id != opened_)
      text += QStringLiteral(": ") + QString::fromStdString(camera.remark);
    auto* item = new QListWidgetItem(text, list_);
    item->setData(Qt::UserRole, id);
    item->setToolTip(id);
    if (id == (opened_.isEmpty() ? kept : opened_)) list_->setCurrentItem(item);
  }
  if (!list_->currentItem() && list_->count() > 0) list_->setCurrentRow(0);
  refreshUse();
}

void CameraPanel::setLooking(bool looking) {
  look_->setEnabled(!looking);
  look_->setText(looking ? tr("Looking\u2026") : tr("Look Again"));
}

void CameraPanel::setOpened(const QString& id, const QString& problem) {
  opened_ = id;
  view_->setEmptyText(!problem.isEmpty() ? problem
                      : id.isEmpty()     ? tr("Choose a camera to see its picture")
                                         : tr("Waiting for the first picture"));
  if (id.isEmpty() || !problem.isEmpty()) setFrame(nullptr);
  refreshUse();
}

void CameraPanel::refreshUse() {
  const QListWidgetItem* item = list_->currentItem();
  const bool same = item && !opened_.isEmpty() && item->data(Qt::UserRole).toString() == opened_;
  use_->setEnabled(item != nullptr);
  use_->setText(same ? tr("Open It Again") : tr("Use This Camera"));
  use_->setProperty("primary", item && !same);
  use_->style()->unpolish(use_);  // has the property looked at again
  use_->style()->polish(use_);
}

void CameraPanel::setFormats(const std::vector<FrameFormat>& formats, const FrameFormat& current) {
  const QSignalBlocker quiet(formats_);
  formats_->clear();
  for (const FrameFormat& format : formats) {
    QString text = QString::fromStdString(format.name);
    if (!text.contains(QString::number(format.size.width)) && format.size.width > 0)
      text += QStringLiteral(", %1 \u00d7 %2").arg(format.size.width).arg(format.size.height);
    if (!isLinear(format.layout)) text += tr(" (not linear)");
    formats_->addItem(text);
    if (format == current) formats_->setCurrentIndex(formats_->count() - 1);
  }
  formats_->setEnabled(formats.size() > 1);
}

void CameraPanel::setControls(const std::vector<CameraControl>& controls) {
  std::vector<CameraControl> numbers;
  for (const CameraControl& control : controls)
    if (control.id != CameraControlId::AutoExposure && control.id != CameraControlId::AutoWhiteBalance &&
        control.id != CameraControlId::AutoFocus)
      numbers.push_back(control);
  noControls_->setText(opened_.isEmpty() ? QString()
                       : numbers.empty() ? tr("This camera's settings can't be made from here: set exposure, "
                                              "white balance and focus by hand, and leave them.")
                                         : QString());
  noControls_->setVisible(!noControls_->text().isEmpty());
  const bool same = numbers.size() == rows_.size() &&
                    std::equal(numbers.begin(), numbers.end(), rows_.begin(),
                               [](const CameraControl& a, const Row& b) { return a.id == b.control.id; });
  if (!same) {
    while (controls_->rowCount() > 0) controls_->removeRow(0);
    rows_.clear();
    for (const CameraControl& control : numbers) rows_.push_back(makeRow(control));
  }
  for (std::size_t i = 0; i < numbers.size(); ++i) updateRow(rows_[i], numbers[i]);
}

CameraPanel::Row CameraPanel::makeRow(const CameraControl& control) {
  Row row;
  row.control = control;
  const CameraControlId id = control.id;
  auto* box = new QWidget(controlsBox_);
  row.slider = new QSlider(Qt::Horizontal, box);
  row.slider->setRange(0, kSliderSteps);
  row.slider->setAccessibleName(nameOf(id));
  row.spin = new QDoubleSpinBox(box);
  row.spin->setObjectName(QStringLiteral("control-%1").arg(static_cast<int>(id)));
  row.spin->setAccessibleName(nameOf(id));
  row.spin->setKeyboardTracking(false);
  row.spin->setDecimals(id == CameraControlId::ExposureS ? 5 : control.step >= 1 ? 0 : 3);
  row.spin->setRange(control.least, control.most);
  row.spin->setStepType(logarithmic(control) ? QAbstractSpinBox::AdaptiveDecimalStepType
                                             : QAbstractSpinBox::DefaultStepType);
  if (control.step > 0) row.spin->setSingleStep(control.step);
  const QString unit = QString::fromStdString(controlUnit(id));
  if (!unit.isEmpty()) row.spin->setSuffix(QLatin1Char(' ') + unit);
  row.readBack = new QLabel(box);
  row.readBack->setProperty("role", "caption");
  auto* line = new QHBoxLayout(box);
  line->setContentsMargins(0, 0, 0, 0);
  line->addWidget(row.slider, 1);
  line->addWidget(row.spin);
  auto* label = new QLabel(nameOf(id), controlsBox_);
  auto* heading = new QWidget(controlsBox_);
  auto* headings = new QHBoxLayout(heading);
  headings->setContentsMargins(0, 6, 0, 0);
  headings->addWidget(label);
  headings->addStretch(1);
  headings->addWidget(row.readBack);
  label->setBuddy(row.spin);
  controls_->addRow(heading);
  controls_->addRow(box);
  connect(row.spin, &QDoubleSpinBox::valueChanged, this,
          [this, id](double value) { Q_EMIT controlRequested(id, value); });
  connect(row.slider, &QSlider::valueChanged, this, [this, id](int at) {
    for (const Row& one : rows_)
      if (one.control.id == id) Q_EMIT controlRequested(id, valueOf(one.control, at));
  });
  return row;
}

void CameraPanel::updateRow(Row& row, const CameraControl& control) {
  row.control = control;
  const QSignalBlocker quietSpin(row.spin), quietSlider(row.slider);
  row.spin->setRange(control.least, control.most);
  row.spin->setValue(control.value);
  if (!row.slider->isSliderDown()) row.slider->setValue(sliderOf(control, control.value));
  row.spin->setEnabled(control.writable);
  row.slider->setEnabled(control.writable);
  const QString unit = QString::fromStdString(controlUnit(control.id));
  row.readBack->setText(!control.writable ? tr("held by the camera")
                                          : tr("in force: %1%2")
                                                .arg(control.value, 0, 'g', 4)
                                                .arg(unit.isEmpty() ? QString() : QLatin1Char(' ') + unit));
  row.spin->setToolTip(tr("From %1 to %2%3")
                           .arg(control.least, 0, 'g', 4)
                           .arg(control.most, 0, 'g', 4)
                           .arg(unit.isEmpty() ? QString() : QLatin1Char(' ') + unit));
}

QDoubleSpinBox* CameraPanel::spinBox(CameraControlId id) const {
  for (const Row& row : rows_)
    if (row.control.id == id) return row.spin;
  return nullptr;
}

void CameraPanel::setFrame(LiveFramePtr frame) {
  view_->setFrame(frame);
  histogram_->setFrame(frame);
  if (!frame) return clipped_->setText(QString());
  QString text = tr("%1 \u00d7 %2").arg(frame->linear.width()).arg(frame->linear.height());
  if (const auto exposure = frame->metadata.exposureS) text += tr(", %1 s").arg(*exposure, 0, 'g', 3);
  if (const auto gain = frame->metadata.gain) text += tr(", gain %1").arg(*gain, 0, 'g', 3);
  text += frame->clippedShare > 0
              ? tr(". Clipped: %1 % of the picture, in red").arg(100 * frame->clippedShare, 0, 'g', 2)
              : tr(". Nothing is clipped");
  clipped_->setText(text);
}

void CameraPanel::setRemarks(const QStringList& sentences) {
  remarks_->setText(sentences.join(QLatin1Char('\n')));
  remarks_->setVisible(!sentences.isEmpty());
}

}  // namespace patina
