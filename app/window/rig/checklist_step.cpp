#include "app/window/rig/checklist_step.h"

#include <QDoubleSpinBox>
#include <QFormLayout>
#include <QLineEdit>
#include <QPushButton>

#include "app/window/rig/simulated_hands.h"
#include "app/window/settings.h"
#include "devices/simulated/live_rig.h"
#include "engine/acquire/rig_assembly.h"
#include "widgets/checklist_panel.h"

namespace patina {

namespace {

const QString kName = QStringLiteral("rig/sample_name");
const QString kWidth = QStringLiteral("rig/sample_width_mm"),
              kHeight = QStringLiteral("rig/sample_height_mm");

}  // namespace

ChecklistStep::ChecklistStep(RigController& rig) : rig_(rig) {
  connect(&rig_, &RigController::cameraChanged, this, [this] { forget(tr("The camera is another one.")); });
  connect(&rig_, &RigController::screenChanged, this, [this] { forget(tr("The screen has changed.")); });
  connect(&rig_, &RigController::calibrationChanged, this,
          [this] { forget(tr("A calibration has changed.")); });
  connect(&rig_.job(), &JobRunner::started, this, &ChecklistStep::refresh);
  connect(&rig_.job(), &JobRunner::finished, this, &ChecklistStep::refresh);
  connect(&rig_.job(), &JobRunner::progressed, this,
          [this](const QString& stage, qint64 done, qint64 total, const QString&) {
            if (checking_ && stage == QStringLiteral("check") && total > 0)
              panel_->setChecking(true, static_cast<double>(done) / static_cast<double>(total));
          });
}

QString ChecklistStep::title() const {
  return tr("Checklist");
}

QString ChecklistStep::sentence() const {
  if (checking_)
    return tr("The screen shows test pictures, and the camera looks at the sample. Touch nothing.");
  if (checklist_ && !checklist_->good()) return tr("Mend what is marked, and check again.");
  if (checklist_) return tr("The rig is ready. What is marked with ! can still be mended; then check again.");
  return tr(
      "Lay the sample in its place, say how large the part to measure is, dim the room, and have the rig "
      "checked.");
}

QWidget* ChecklistStep::body(QWidget* parent) {
  if (body_) return body_;
  body_ = new QWidget(parent);
  name_ = new QLineEdit(rig_.settings().text(kName), body_);
  name_->setObjectName(QStringLiteral("sampleName"));
  name_->setPlaceholderText(tr("what it is"));
  const auto length = [this](const QString& name, const QString& key) {
    auto* spin = new QDoubleSpinBox(body_);
    spin->setObjectName(name);
    spin->setRange(0, 2000);
    spin->setDecimals(1);
    spin->setSuffix(tr(" mm"));
    spin->setSpecialValueText(tr("not said"));
    spin->setKeyboardTracking(false);
    spin->setValue(rig_.settings().text(key).toDouble());
    return spin;
  };
  width_ = length(QStringLiteral("sampleWidth"), kWidth);
  height_ = length(QStringLiteral("sampleHeight"), kHeight);
  if (rig_.simulation()) {  // what a ruler would say
    const SimulatedSheet& sheet = rig_.simulation()->setup().sheet;
    if (name_->text().isEmpty()) name_->setText(QString::fromStdString(sheet.name));
    width_->setValue(sheet.widthMm);
    height_->setValue(sheet.heightMm);
  }
  const auto caption = [this](const QString& text, QWidget* buddy) {
    auto* label = new QLabel(text, body_);
    label->setBuddy(buddy);
    return label;
  };
  auto* form = new QHBoxLayout;
  form->addWidget(caption(tr("&Sample"), name_));
  form->addWidget(name_, 2);
  form->addSpacing(12);
  form->addWidget(caption(tr("&Width"), width_));
  form->addWidget(width_);
  form->addWidget(caption(tr("&Height"), height_));
  form->addWidget(height_);
  form->addStretch(1);
  hand_ = new QPushButton(tr("Lay the Sample"), body_);
  hand_->setObjectName(QStringLiteral("hand-sample"));
  hand_->setToolTip(tr("What an operator would do, done to the simulated rig"));
  form->addWidget(hand_);
  connect(hand_, &QPushButton::clicked, this, [this] {
    const auto simulated = rig_.simulation();
    if (!simulated) return;
    forget({});
    rig_.run<Done>(
        tr("Laying the sample"),
        [simulated](const JobContext&) -> Status {
          SimulatedHands(simulated).laySample();
          return Done{};
        },
        [](const Status&) {});
  });
  remarks_ = new QLabel(body_);
  remarks_->setWordWrap(true);
  remarks_->setProperty("role", "caption");
  panel_ = new ChecklistPanel(body_);
  auto* column = new QVBoxLayout(body_);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(10);
  column->addLayout(form);
  column->addWidget(remarks_);
  column->addWidget(panel_, 1);
  connect(panel_, &ChecklistPanel::checkRequested, this, &ChecklistStep::check);
  connect(name_, &QLineEdit::textChanged, this, &ChecklistStep::sampleChanged);
  for (QDoubleSpinBox* spin : {width_, height_})
    connect(spin, &QDoubleSpinBox::valueChanged, this, &ChecklistStep::sampleChanged);
  refresh();
  return body_;
}

void ChecklistStep::enter() {
  refresh();
}

void ChecklistStep::leave() {
  if (!rig_.busy()) rig_.closeDisplay();
}

void ChecklistStep::sampleChanged() {
  rig_.settings().set(kName, name_->text());
  rig_.settings().set(kWidth, width_->value());
  rig_.settings().set(kHeight, height_->value());
  forget({});
}

void ChecklistStep::forget(const QString& why) {
  const bool had = checklist_.has_value();
  checklist_.reset();
  description_.reset();
  if (panel_) panel_->clear(had && !why.isEmpty() ? why + QLatin1Char(' ') + tr("Check again.") : QString());
  refresh();
}

void ChecklistStep::check() {
  if (!rig_.camera() || rig_.busy()) return;
  const QString doing = tr("Checking the rig");
  const Result<RigParts> parts = readRigParts(rig_.folder());
  if (!parts) return Q_EMIT rig_.failed(doing, parts.error());
  const Result<RigDescription> description =
      rigFromParts(*parts, width_->value(), height_->value(), name_->text().toStdString());
  if (!description) return Q_EMIT rig_.failed(doing, description.error());
  QStringList remarks;
  for (const std::string& remark : parts->remarks) remarks << QString::fromStdString(remark);
  remarks_->setText(remarks.join(QLatin1Char(' ')));
  // For the command line, and for whoever wants to know what a capture was taken with.
  if (const Status written = writeRigDescription(rig_.file("rig"), *description); !written)
    Q_EMIT rig_.failed(tr("Keeping the rig's description"), written.error());
  const auto display = rig_.display();
  if (!display) return Q_EMIT rig_.failed(tr("The pattern window"), display.error());
  checklist_.reset();
  description_.reset();
  checking_ = true;
  panel_->setChecking(true);
  CameraDevice* camera = rig_.camera();
  rig_.run<Checklist>(
      doing,
      [camera, shown = *display, rig = *description](const JobContext& job) {
        return checkRig(*camera, *shown, rig, {}, job);
      },
      [this, rig = *description](Result<Checklist> outcome) {
        checking_ = false;
        rig_.closeDisplay();
        if (outcome) {
          checklist_ = *outcome;
          description_ = rig;
          panel_->setChecklist(*outcome, outcome->exposureS > 0
                                             ? tr("Photographs will be exposed %1 s each, with gain %2.")
                                                   .arg(outcome->exposureS, 0, 'g', 3)
                                                   .arg(outcome->gain, 0, 'g', 3)
                                             : tr("Photographs will be exposed as the camera is set."));
        }
        refresh();
      });
  refresh();
}

void ChecklistStep::refresh() {
  if (panel_) {
    panel_->setChecking(checking_);
    const QString why = !rig_.camera() || !rig_.cameraProblem().isEmpty() ? tr("Not now: no camera is open.")
                        : !rig_.screen() ? tr("Not now: no screen is chosen.")
                        : width_->value() <= 0 || height_->value() <= 0
                            ? tr("First say how large the sample is.")
                        : rig_.busy() ? tr("Not now: the camera is in use.")
                                      : QString();
    panel_->setMayCheck(why.isEmpty(), why);
    hand_->setVisible(rig_.simulation() != nullptr);
    hand_->setEnabled(!rig_.busy());
  }
  Q_EMIT changed();
}

GuideStep::State ChecklistStep::state() const {
  if (!checklist_) return State::ToDo;
  return checklist_->good() ? State::Done : State::Failed;
}

QString ChecklistStep::note() const {
  if (!checklist_) return {};
  int warnings = 0, bad = 0;
  for (const CheckItem& item : checklist_->items) {
    warnings += item.state == CheckItem::State::Warning ? 1 : 0;
    bad += item.state == CheckItem::State::Bad ? 1 : 0;
  }
  if (bad > 0) return tr("%1 to mend").arg(bad);
  return warnings > 0 ? tr("%1 warnings").arg(warnings) : tr("all good");
}

QString ChecklistStep::whyNot() const {
  if (checking_) return tr("The rig is being checked.");
  if (width_ && (width_->value() <= 0 || height_->value() <= 0))
    return tr("First say how large the sample is.");
  if (!checklist_) return tr("The rig has not been checked yet.");
  return tr("What is marked must be mended first.");
}

}  // namespace patina
