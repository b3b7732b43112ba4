#include "widgets/brdf_sphere_viewport.h"

#include <QCheckBox>
#include <QColorDialog>
#include <QComboBox>
#include <QDoubleSpinBox>
#include <QFileDialog>
#include <QSignalBlocker>
#include <numbers>

#include "engine/render/tone_map.h"
#include "widgets/brdf_sphere_canvas.h"
#include "widgets/certainty_bar.h"
#include "widgets/flow_layout.h"
#include "widgets/theme.h"

namespace patina {

namespace {

const QString kOpenEntry = QStringLiteral("open");
const QString kFileEntry = QStringLiteral("file");

/// A caption and its field as one thing that stays together when lines break.
QWidget* labelled(const QString& text, std::initializer_list<QWidget*> fields, QWidget* parent) {
  auto* group = new QWidget(parent);
  auto* line = new QHBoxLayout(group);
  line->setContentsMargins(0, 0, 0, 0);
  line->setSpacing(4);
  if (!text.isEmpty()) {
    auto* label = new QLabel(text, group);
    label->setFont(theme::captionFont());
    label->setProperty("role", "caption");
    label->setBuddy(*fields.begin());
    line->addWidget(label);
  }
  for (QWidget* field : fields) line->addWidget(field);
  return group;
}

}  // namespace

BrdfSphereViewport::BrdfSphereViewport(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("brdfSphere"));
  canvas_ = new BrdfSphereCanvas(openGlThere() ? this : nullptr);
  if (!openGlThere()) unseen_.reset(canvas_);
  bar_ = new CertaintyBar(this);
  bar_->hide();
  message_ = new QLabel(this);
  message_->setWordWrap(true);
  message_->setTextFormat(Qt::PlainText);
  message_->setContentsMargins(8, 4, 8, 4);
  message_->setStyleSheet(QStringLiteral("QLabel { color: %1; }").arg(theme::kWarning.name()));
  message_->hide();

  environment_ = new QComboBox(this);
  environment_->setAccessibleName(tr("Surroundings of the sphere"));
  environment_->setObjectName(QStringLiteral("sphereEnvironment"));
  for (const EnvironmentEntry& entry : builtInEnvironments()) {
    environment_->addItem(QString::fromStdString(entry.name), QString::fromStdString(entry.id));
    environment_->setItemData(environment_->count() - 1, QString::fromStdString(entry.note), Qt::ToolTipRole);
  }
  environment_->addItem(tr("None"), QString());
  environment_->setItemData(environment_->count() - 1, tr("Only the small light"), Qt::ToolTipRole);
  environment_->addItem(tr("Open a picture\u2026"), kOpenEntry);
  environment_->setItemData(environment_->count() - 1,
                            tr("A latitude-longitude picture of the whole sphere, OpenEXR, linear"),
                            Qt::ToolTipRole);
  environment_->setToolTip(
      tr("What surrounds the sphere and lights it. All are normalised: a white matt surface facing up is "
         "equally "
         "bright in each"));
  environment_->setSizeAdjustPolicy(QComboBox::AdjustToContents);

  light_ = new QCheckBox(tr("Light"), this);
  light_->setToolTip(
      tr("A small distant light as well; drag its lamp, or the highlight with the right button"));
  strength_ = new QDoubleSpinBox(this);
  strength_->setRange(0.05, 100);
  strength_->setDecimals(2);
  strength_->setStepType(QAbstractSpinBox::AdaptiveDecimalStepType);
  strength_->setValue(1);
  strength_->setAccessibleName(tr("Strength of the light"));
  strength_->setToolTip(
      tr("Strength of the light: at 1 it lights a surface that faces it as much as the surroundings light "
         "one that "
         "faces up (irradiance in units of \u03c0)"));
  swatch_ = new QToolButton(this);
  swatch_->setAccessibleName(tr("Colour of the light"));
  swatch_->setToolTip(tr("Colour of the light"));
  swatch_->setFocusPolicy(Qt::StrongFocus);
  exposure_ = new QDoubleSpinBox(this);
  exposure_->setRange(-8, 8);
  exposure_->setSingleStep(0.5);
  exposure_->setDecimals(1);
  exposure_->setSuffix(tr(" EV"));
  exposure_->setAccessibleName(tr("Exposure of the sphere"));
  exposure_->setToolTip(
      tr("Exposure in stops (EV): +1 doubles the brightness. At 0 a white matt sphere in this light would be "
         "just "
         "white"));
  surround_ = new QCheckBox(tr("Surroundings"), this);
  surround_->setChecked(true);
  surround_->setToolTip(tr("Show what surrounds the sphere behind it, out of focus; off: neutral grey"));
  overlay_ = new QCheckBox(tr("Certainty"), this);
  overlay_->setObjectName(QStringLiteral("sphereCertainty"));
  reset_ = new QToolButton(this);
  reset_->setIcon(theme::icon(QStringLiteral("reset")));
  reset_->setAccessibleName(tr("As at the start"));
  reset_->setToolTip(tr("Room, light and zoom as at the start (Home on the sphere, or a double click)"));
  reset_->setFocusPolicy(Qt::StrongFocus);

  controls_ = new QWidget(this);
  auto* flow = new FlowLayout(controls_, 8);
  flow->setContentsMargins(8, 6, 8, 6);
  flow->addWidget(environment_);
  flow->addWidget(labelled({}, {light_, strength_, swatch_}, controls_));
  flow->addWidget(labelled(tr("Exposure"), {exposure_}, controls_));
  flow->addWidget(overlay_);
  flow->addWidget(surround_);
  flow->addWidget(reset_);
  QSizePolicy policy(QSizePolicy::Preferred, QSizePolicy::Preferred);  // as high as its lines need
  policy.setHeightForWidth(true);
  controls_->setSizePolicy(policy);

  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(0);
  column->addWidget(unseen_ ? noOpenGlLabel(this) : canvas_, 1);
  column->addWidget(message_);
  column->addWidget(bar_);
  column->addWidget(controls_);

  chooseFile_ = [this] {
    return QFileDialog::getOpenFileName(this, tr("Open the surroundings' picture"), QString(),
                                        tr("OpenEXR pictures (*.exr);;All files (*)"));
  };
  shownEnvironment_ = environment_->currentData().toString();
  connect(environment_, &QComboBox::activated, this, &BrdfSphereViewport::chooseEnvironment);
  connect(light_, &QCheckBox::toggled, this, &BrdfSphereViewport::applyLight);
  connect(strength_, &QDoubleSpinBox::valueChanged, this, &BrdfSphereViewport::applyLight);
  connect(swatch_, &QToolButton::clicked, this, &BrdfSphereViewport::chooseLightColour);
  connect(exposure_, &QDoubleSpinBox::valueChanged, this, &BrdfSphereViewport::applyLook);
  connect(overlay_, &QCheckBox::toggled, this, &BrdfSphereViewport::applyLook);
  connect(surround_, &QCheckBox::toggled, canvas_, &BrdfSphereCanvas::setSurround);
  connect(reset_, &QToolButton::clicked, this, &BrdfSphereViewport::resetView);
  connect(canvas_, &BrdfSphereCanvas::rendered, this, &BrdfSphereViewport::rendered);
  connect(canvas_->worker(), &SphereWorker::environmentOpened, this, [this](EnvironmentPtr opened) {
    opened_ = std::move(opened);
    int at = environment_->findData(kFileEntry);
    if (at < 0) {
      at = environment_->findData(kOpenEntry);
      environment_->insertItem(at, QString(), kFileEntry);
    }
    environment_->setItemText(at, QString::fromStdString(opened_->name()));
    environment_->setItemData(
        at, tr("Your picture; its values were multiplied by %1").arg(opened_->scale(), 0, 'g', 3),
        Qt::ToolTipRole);
    say({});
    setEnvironment(kFileEntry);
  });
  connect(canvas_->worker(), &SphereWorker::environmentFailed, this, [this](const QString& sentence) {
    say(sentence);
    setEnvironment(shownEnvironment_);
    Q_EMIT failed(sentence);
  });
  canvas_->setEnvironment(shownEnvironment_.toStdString(), nullptr);
  applyLight();
  refresh();
}

BrdfSphereViewport::~BrdfSphereViewport() = default;

void BrdfSphereViewport::setMaterial(std::shared_ptr<const TabulatedBrdf> brdf,
                                     std::shared_ptr<const std::vector<float>> posteriorSd, double priorSd) {
  if (posteriorSd && posteriorSd->size() != MerlGrid::kCells) posteriorSd.reset();
  hasMaterial_ = brdf != nullptr;
  hasCertainty_ = hasMaterial_ && posteriorSd != nullptr;
  if (hasCertainty_) bar_->setPriorSd(priorSd);
  canvas_->setMaterial(std::move(brdf), std::move(posteriorSd), priorSd);
  refresh();
}

void BrdfSphereViewport::refresh() {
  for (QWidget* widget :
       {static_cast<QWidget*>(environment_), static_cast<QWidget*>(light_), static_cast<QWidget*>(exposure_),
        static_cast<QWidget*>(surround_), static_cast<QWidget*>(reset_)})
    widget->setEnabled(hasMaterial_);
  strength_->setEnabled(hasMaterial_ && light_->isChecked());
  swatch_->setEnabled(hasMaterial_ && light_->isChecked());
  overlay_->setEnabled(hasCertainty_);
  overlay_->setToolTip(
      hasCertainty_
          ? tr("Paint the sphere by how well the photographs determine what is seen: blue measured, orange "
               "extrapolated from other materials. Each place shows the directions that light it now")
          : tr("How well this material is determined is not known: it was not reconstructed here"));
  // The choice stays for the next material that has it.
  bar_->setVisible(hasCertainty_ && overlay_->isChecked());
  const int side = fontMetrics().height();
  QPixmap colour(side, side);
  colour.fill(swatch_->isEnabled() ? lightColour_ : theme::kControl);
  swatch_->setIcon(colour);
}

void BrdfSphereViewport::say(const QString& sentence) {
  message_->setText(sentence);
  message_->setVisible(!sentence.isEmpty());
}

QString BrdfSphereViewport::environment() const {
  return shownEnvironment_;
}

void BrdfSphereViewport::setEnvironment(const QString& id) {
  const int at = environment_->findData(id);
  if (at < 0 || id == kOpenEntry || (id == kFileEntry && !opened_)) return;
  const QSignalBlocker quiet(environment_);
  environment_->setCurrentIndex(at);
  shownEnvironment_ = id;
  canvas_->setEnvironment(id.toStdString(), opened_);
}

void BrdfSphereViewport::chooseEnvironment(int index) {
  const QString id = environment_->itemData(index).toString();
  if (id != kOpenEntry) {
    say({});
    return setEnvironment(id);
  }
  environment_->setCurrentIndex(environment_->findData(shownEnvironment_));
  const QString file = chooseFile_();
  if (!file.isEmpty()) openEnvironment(file);
}

void BrdfSphereViewport::openEnvironment(const QString& file) {
  say({});
  canvas_->worker()->openEnvironment(file);
}

bool BrdfSphereViewport::lightOn() const {
  return light_->isChecked();
}
void BrdfSphereViewport::setLightOn(bool on) {
  light_->setChecked(on);
}
Eigen::Vector3f BrdfSphereViewport::toLight() const {
  return canvas_->toLight();
}
void BrdfSphereViewport::setToLight(const Eigen::Vector3f& toLight) {
  canvas_->setToLight(toLight);
}
double BrdfSphereViewport::lightStrength() const {
  return strength_->value();
}
void BrdfSphereViewport::setLightStrength(double strength) {
  strength_->setValue(strength);
}
double BrdfSphereViewport::exposureEv() const {
  return exposure_->value();
}
void BrdfSphereViewport::setExposureEv(double stops) {
  exposure_->setValue(stops);
}
bool BrdfSphereViewport::overlayOn() const {
  return overlay_->isChecked();
}
void BrdfSphereViewport::setOverlayOn(bool on) {
  overlay_->setChecked(on);
}
void BrdfSphereViewport::resetView() {
  canvas_->resetView();
}

void BrdfSphereViewport::setLightColour(const QColor& colour) {
  if (!colour.isValid()) return;
  lightColour_ = colour;
  applyLight();
}

void BrdfSphereViewport::chooseLightColour() {
  const QColor chosen = QColorDialog::getColor(lightColour_, this, tr("Colour of the light"));
  if (chosen.isValid()) setLightColour(chosen);
}

void BrdfSphereViewport::applyLight() {
  Eigen::Array3f irradiance = Eigen::Array3f::Zero();
  if (light_->isChecked()) {
    irradiance = Eigen::Array3f(linearFromSrgb(lightColour_.redF()), linearFromSrgb(lightColour_.greenF()),
                                linearFromSrgb(lightColour_.blueF()));
    irradiance *= std::numbers::pi_v<float> * static_cast<float>(strength_->value());
  }
  canvas_->setLight(irradiance);
  refresh();
}

void BrdfSphereViewport::applyLook() {
  canvas_->setLook({exposure_->value(), overlay_->isChecked()});
  refresh();
}

}  // namespace patina
