#include "widgets/viewport_panel.h"

#include <QCheckBox>
#include <QDoubleSpinBox>
#include <QTimer>

#include "widgets/sheet_viewport.h"
#include "widgets/sphere_view.h"
#include "widgets/theme.h"

namespace patina {

ViewportPanel::ViewportPanel(Document* document, QWidget* parent) : QWidget(parent), document_(document) {
  sheet_ = new SheetViewport(document, openGlThere() ? this : nullptr);
  if (!openGlThere()) unseen_.reset(sheet_);
  sphere_ = new SphereView(this);
  sphere_->setObjectName(QStringLiteral("sphereView"));
  studio_ = new QCheckBox(tr("In a room"), this);
  studio_->setToolTip(
      tr("Light the sphere by a grey room with two soft boxes as well: shows gloss as a photographer would"));
  connect(studio_, &QCheckBox::toggled, sphere_, &SphereView::setStudio);
  lampText_ = new QLabel(this);
  lampText_->setFont(theme::captionFont());
  lampText_->setProperty("role", "caption");
  lampText_->setToolTip(tr("Where the lamp stands over the sample's centre, in mm, world frame"));
  exposure_ = new QDoubleSpinBox(this);
  exposure_->setRange(-8, 8);
  exposure_->setSingleStep(0.5);
  exposure_->setDecimals(1);
  exposure_->setSuffix(tr(" EV"));
  exposure_->setToolTip(
      tr("Exposure of sheet and sphere in stops (EV): +1 doubles the brightness. At 0 a white matt sheet "
         "right below the lamp shows white"));
  exposure_->setAccessibleName(tr("Exposure of the 3D view"));
  height_ = new QDoubleSpinBox(this);
  height_->setRange(5, 5000);
  height_->setSingleStep(10);
  height_->setDecimals(0);
  height_->setSuffix(tr(" mm"));
  height_->setToolTip(tr("Height of the lamp over the sheet (mm)"));
  height_->setAccessibleName(tr("Lamp height"));
  const auto button = [this](const QString& text, const QString& tip) {
    auto* made = new QToolButton(this);
    made->setText(text);
    made->setToolTip(tip);
    made->setFocusPolicy(Qt::StrongFocus);
    made->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Fixed);
    made->setFont(theme::captionFont());
    made->setStyleSheet(QStringLiteral("QToolButton { background: #3e3e3e; padding: 3px 2px; }"));
    return made;
  };
  QToolButton* camera =
      button(tr("Camera"), tr("Look from where the capture's camera stood (C in the 3D view)"));
  QToolButton* above = button(tr("Above"), tr("Look straight down (T in the 3D view)"));
  QToolButton* reset = button(tr("Reset"), tr("Put the lamp back to where it starts"));

  auto* controls = new QWidget(this);
  controls_ = controls;

  auto* column = new QVBoxLayout(controls);
  column->setContentsMargins(8, 4, 8, 4);
  column->setSpacing(4);
  column->addWidget(sphere_, 1);
  column->addWidget(studio_, 0, Qt::AlignHCenter);
  column->addWidget(lampText_);
  const auto row = [&](const QString& text, QWidget* field) {
    auto* line = new QHBoxLayout;
    auto* label = new QLabel(text, controls);
    label->setFont(theme::captionFont());
    line->addWidget(label);
    line->addWidget(field, 1);
    column->addLayout(line);
  };
  row(tr("Height"), height_);
  row(tr("Exposure"), exposure_);
  auto* views = new QHBoxLayout;
  views->setSpacing(4);
  views->addWidget(camera);
  views->addWidget(above);
  views->addWidget(reset);
  column->addLayout(views);

  auto* across = new QHBoxLayout(this);
  across->setContentsMargins(0, 0, 0, 0);
  across->setSpacing(0);
  across->addWidget(unseen_ ? noOpenGlLabel(this) : sheet_, 1);
  across->addWidget(controls);

  auto* gesture = new QTimer(this);
  gesture->setSingleShot(true);
  gesture->setInterval(700);
  connect(gesture, &QTimer::timeout, document_, &Document::endGesture);
  connect(exposure_, &QDoubleSpinBox::valueChanged, this, [this, gesture](double stops) {
    if (updating_) return;
    LampState lamp = document_->lamp();
    lamp.exposureEv = stops;
    gesture->start();
    document_->setLamp(lamp);
  });
  connect(height_, &QDoubleSpinBox::valueChanged, this, [this, gesture](double mm) {
    if (updating_) return;
    LampState lamp = document_->lamp();
    lamp.positionMm.z() = mm;
    gesture->start();
    document_->setLamp(lamp);
  });
  connect(camera, &QToolButton::clicked, sheet_, &SheetViewport::viewFromCamera);
  connect(above, &QToolButton::clicked, sheet_, &SheetViewport::viewFromAbove);
  connect(reset, &QToolButton::clicked, sheet_, &SheetViewport::resetLamp);
  connect(document_, &Document::lampChanged, this, &ViewportPanel::refresh);
  connect(document_, &Document::fitChanged, this, [this, camera, above, reset] {
    const bool fitted = document_->fit() != nullptr;
    for (QWidget* widget :
         {static_cast<QWidget*>(camera), static_cast<QWidget*>(above), static_cast<QWidget*>(reset),
          static_cast<QWidget*>(exposure_), static_cast<QWidget*>(height_)})
      widget->setEnabled(fitted);
    setTexel(fitted ? document_->pickedTexel() : std::nullopt);
    refresh();
  });
  for (QWidget* widget :
       {static_cast<QWidget*>(camera), static_cast<QWidget*>(above), static_cast<QWidget*>(reset),
        static_cast<QWidget*>(exposure_), static_cast<QWidget*>(height_)})
    widget->setEnabled(false);
  refresh();
}

void ViewportPanel::resizeEvent(QResizeEvent*) {
  // The sphere grows with the window, the numbers below it don't need to.
  const int least = std::max(164, fontMetrics().averageCharWidth() * 24);
  controls_->setFixedWidth(std::clamp(std::min(width() / 4, height() - 150), least, 2 * least));
}

void ViewportPanel::setTexel(std::optional<QPoint> texel) {
  texel_ = texel;
  const auto fit = document_->fit();
  if (!fit || !texel || !QRect(0, 0, fit->maps().width, fit->maps().height).contains(*texel))
    return sphere_->setMaterial(std::nullopt);
  sphere_->setMaterial(static_cast<TexelStatus>(static_cast<int>(
                           fit->maps().status.at(texel->x(), texel->y()))) == TexelStatus::NotMeasured
                           ? std::nullopt
                           : std::optional(fit->parametersAt(texel->x(), texel->y())));
}

bool ViewportPanel::studio() const {
  return studio_->isChecked();
}
void ViewportPanel::setStudio(bool studio) {
  studio_->setChecked(studio);
}

void ViewportPanel::refresh() {
  const LampState& lamp = document_->lamp();
  updating_ = true;
  exposure_->setValue(lamp.exposureEv);
  height_->setValue(lamp.positionMm.z());
  updating_ = false;
  sphere_->setExposure(lamp.exposureEv);
  lampText_->setText(!document_->fit() ? tr("Lamp")
                                       : tr("Lamp at x %1, y %2 mm")
                                             .arg(lamp.positionMm.x(), 0, 'f', 0)
                                             .arg(lamp.positionMm.y(), 0, 'f', 0));
}

}  // namespace patina
