#include "app/window/rig/white_paper_step.h"

#include <QDoubleSpinBox>
#include <QGridLayout>
#include <QPushButton>

#include "app/window/settings.h"
#include "devices/simulated/live_rig.h"
#include "engine/acquire/capture_session.h"
#include "engine/acquire/rig_assembly.h"

namespace patina {

namespace {

const QString kAlbedo = QStringLiteral("rig/paper_albedo");
// As the checklist keeps them.
const QString kWidth = QStringLiteral("rig/sample_width_mm"),
              kHeight = QStringLiteral("rig/sample_height_mm");

/// Few and low: paper answers to nothing finer.
CapturePlanOptions paperPlan() {
  CapturePlanOptions plan;
  plan.fitted = {{1, 0}, {0, 1}, {1, 1}, {1, -1}, {2, 0}, {0, 2}, {3, 0}, {0, 3}};
  plan.heldOut.clear();
  plan.windowAgain = false;
  return plan;
}

struct PaperOutcome {
  EmissionCalibration emission;
  std::vector<std::string> remarks;
};

}  // namespace

WhitePaperStep::WhitePaperStep(RigController& rig) : CalibrationStep(rig, "emission") {}

QString WhitePaperStep::title() const {
  return tr("White paper");
}

QString WhitePaperStep::sentence() const {
  if (state() == State::Done || state() == State::Reused)
    return tr("The screen's light is known. Its brightness must stay as it is from here on.");
  return tr(
      "Lay matt white paper flat in the sample's place, larger than the sample, and switch off all lamps. "
      "A short series of patterns tells how the screen shines and how bright a pixel is.");
}

void WhitePaperStep::buildControls(QVBoxLayout* column, QWidget* parent) {
  const auto number = [parent](const QString& name, const QString& words, double least, double most,
                               double value, int decimals, const QString& suffix) {
    auto* box = new QDoubleSpinBox(parent);
    box->setObjectName(name);
    box->setAccessibleName(words);
    box->setToolTip(words);
    box->setRange(least, most);
    box->setDecimals(decimals);
    box->setSingleStep(decimals > 1 ? 0.01 : 5);
    box->setValue(value);
    box->setSuffix(suffix);
    return box;
  };
  double width = rig().settings().text(kWidth).toDouble(), height = rig().settings().text(kHeight).toDouble();
  if (rig().simulation()) {
    width = rig().simulation()->setup().sheet.widthMm;
    height = rig().simulation()->setup().sheet.heightMm;
  }
  width_ = number(QStringLiteral("paper-width"), tr("Width of the sample's area, along x"), 1, 2000,
                  width > 0 ? width : 120, 1, tr(" mm"));
  height_ = number(QStringLiteral("paper-height"), tr("Height of the sample's area, along y"), 1, 2000,
                   height > 0 ? height : 120, 1, tr(" mm"));
  const QStringList albedo = rig().settings().text(kAlbedo).split(QLatin1Char(','));
  const QStringList channels = {tr("red"), tr("green"), tr("blue")};
  for (int c = 0; c < 3; ++c) {
    const double value = albedo.value(c).toDouble();
    albedo_[static_cast<std::size_t>(c)] =
        number(QStringLiteral("paper-albedo-%1").arg(c), tr("Albedo of the paper in %1").arg(channels[c]),
               0.1, 1, value > 0 ? value : 0.87, 3, QString());
  }
  column->addWidget(makeCaption(parent, tr("The sample's area round the middle")));
  auto* size = new QHBoxLayout;
  size->addWidget(width_);
  size->addWidget(new QLabel(QStringLiteral("\u00d7"), parent));
  size->addWidget(height_);
  size->addStretch(1);
  column->addLayout(size);
  column->addWidget(
      makeCaption(parent, tr("Albedo of the paper, R G B. It sets the scale of all albedos: office "
                             "paper has 0.85 to 0.9, what the maker says is better.")));
  auto* row = new QHBoxLayout;
  for (QDoubleSpinBox* box : albedo_) row->addWidget(box);
  row->addStretch(1);
  column->addLayout(row);
  take_ = makeButton(parent, tr("Photograph the Paper"), QStringLiteral("paper-take"), true);
  column->addWidget(take_, 0, Qt::AlignLeft);
  connect(take_, &QPushButton::clicked, this, &WhitePaperStep::capture);
  addHand(tr("Lay the Paper"), QStringLiteral("hand-paper"),
          [] { return [](SimulatedHands& hands) { hands.layPaper(); }; });
}

void WhitePaperStep::refreshControls() {
  if (take_) take_->setEnabled(!working());
}

void WhitePaperStep::capture() {
  if (!mayPhotograph()) return;
  const auto parts = readRigParts(rig().folder());
  if (!parts) {
    say(tr("Where screen and camera stand is not known.\nTry: the step Mirror first."), Tone::Problem);
    return;
  }
  auto description = rigFromParts(*parts, width_->value(), height_->value(), "white paper");
  if (!description) return say(sentencesOf(description.error()), Tone::Problem);
  // The unit of this capture is the camera's own: it is what is measured here.
  description->radianceOfFullScaleSecond = 0;
  description->screen.emission.reset();
  const auto display = rig().display();
  if (!display) return say(sentencesOf(display.error()), Tone::Problem);
  rig().settings().set(kWidth, width_->value());
  rig().settings().set(kHeight, height_->value());
  rig().settings().set(
      kAlbedo,
      QStringLiteral("%1,%2,%3").arg(albedo_[0]->value()).arg(albedo_[1]->value()).arg(albedo_[2]->value()));
  CaptureOptions options;
  options.plan = paperPlan();
  EmissionOptions emission;
  emission.albedo = {albedo_[0]->value(), albedo_[1]->value(), albedo_[2]->value()};
  CameraDevice* camera = rig().camera();
  work<PaperOutcome>(
      tr("Photographing the paper"),
      [camera, shown = *display, rig = *description, options, emission,
       folder = store().folder() / "paper"](const JobContext& job) -> Result<PaperOutcome> {
        std::error_code code;
        std::filesystem::remove_all(folder, code);  // the last paper's; its result is kept
        auto session = CaptureSession::open(folder, rig, options, false);
        if (!session) return session.error();
        const Result<CaptureSession::Outcome> taken = (*session)->run(*camera, *shown, job);
        if (!taken) return taken.error();
        if (taken->cancelled || !taken->complete)
          return Error{ErrorCode::Cancelled, "the capture of the paper was cancelled", "", ""};
        const Result<FourierCapture> capture = readFourierCapture(folder, job);
        if (!capture) return capture.error();
        Result<EmissionCalibration> found = calibrateEmission(*capture, emission, job);
        if (!found) return found.error();
        PaperOutcome outcome;
        outcome.emission = std::move(*found);
        if (taken->flawed > 0)
          outcome.remarks.push_back(std::to_string(taken->flawed) + " photographs of the paper are not good");
        return outcome;
      },
      [this](PaperOutcome outcome) {
        rig().closeDisplay();
        const EmissionCalibration& found = outcome.emission;
        result_ = found;
        std::vector<std::string> remarks = found.warnings;
        remarks.insert(remarks.end(), outcome.remarks.begin(), outcome.remarks.end());
        const StoredEmission stored{found.emission,    found.meanSd, found.sigmaSd,      found.gainSd,
                                    found.channelGain, found.albedo, found.radianceScale};
        if (!keep(stored, 100 * found.residual, "%", remarks)) return;
        QStringList sentences;
        for (const std::string& remark : remarks) {
          QString sentence = QString::fromStdString(remark);
          if (!sentence.isEmpty()) sentence[0] = sentence[0].toUpper();
          sentences << sentence + QLatin1Char('.');
        }
        tell(found, sentences);
      });
}

void WhitePaperStep::tell(const EmissionCalibration& found, const QStringList& remarks) {
  const ScreenEmission& emission = found.emission;
  QString text = tr("Width of the light: %1 \u00b1 %2 across, %3 \u00b1 %4 up; its middle %5 \u00b1 %6 up.\n"
                    "The model leaves %7 % of the light (noise alone %8 %), at %9 places.")
                     .arg(emission.sigma.x(), 0, 'f', 3)
                     .arg(found.sigmaSd.x(), 0, 'f', 3)
                     .arg(emission.sigma.y(), 0, 'f', 3)
                     .arg(found.sigmaSd.y(), 0, 'f', 3)
                     .arg(emission.mean.y(), 0, 'f', 3)
                     .arg(found.meanSd.y(), 0, 'f', 3)
                     .arg(100 * found.residual, 0, 'f', 2)
                     .arg(100 * found.noise, 0, 'f', 2)
                     .arg(found.points);
  if (!remarks.isEmpty()) text += QStringLiteral("\n") + remarks.join(QLatin1Char('\n'));
  say(text, remarks.isEmpty() ? Tone::Good : Tone::Problem);
}

}  // namespace patina
