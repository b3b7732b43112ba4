#include "app/window/rig/screen_response_step.h"

#include <QPushButton>
#include <QSpinBox>

#include "widgets/live_overlay.h"

namespace patina {

namespace {

constexpr int kFramesAveraged = 3;

/// The middle third of the picture: it must show the screen or what the screen lights.
PixelRegion middleOf(int width, int height) {
  return {width / 3, height / 3, width - width / 3, height - height / 3};
}

ShownPicture greyPicture(const ScreenInfo& screen, double value) {
  ShownPicture picture;
  picture.name = "grey";
  picture.width = screen.widthPx;
  picture.height = screen.heightPx;
  picture.pixels = std::make_shared<const std::vector<std::uint8_t>>(
      static_cast<std::size_t>(screen.widthPx) * static_cast<std::size_t>(screen.heightPx),
      static_cast<std::uint8_t>(std::lround(255 * value)));
  return picture;
}

}  // namespace

ScreenResponseStep::ScreenResponseStep(RigController& rig) : CalibrationStep(rig, "screen-response") {}

QString ScreenResponseStep::title() const {
  return tr("Screen's response");
}

QString ScreenResponseStep::sentence() const {
  if (state() == State::Done || state() == State::Reused)
    return tr("The screen's curve is known, and patterns are drawn through its inverse.");
  return tr(
      "Lay white paper in the sample's place and switch off all lamps. The screen shows greys from black to "
      "white, and the framed part of the picture tells how much light each gives. Without this step a "
      "power of 2.2 is taken.");
}

void ScreenResponseStep::buildControls(QVBoxLayout* column, QWidget* parent) {
  steps_ = new QSpinBox(parent);
  steps_->setObjectName(QStringLiteral("grey-steps"));
  steps_->setAccessibleName(tr("Greys"));
  steps_->setRange(5, 65);
  steps_->setValue(17);
  auto* row = new QHBoxLayout;
  row->addWidget(new QLabel(tr("Greys"), parent));
  row->addWidget(steps_);
  row->addStretch(1);
  column->addLayout(row);
  take_ = makeButton(parent, tr("Show and Photograph the Greys"), QStringLiteral("grey-take"), true);
  column->addWidget(take_, 0, Qt::AlignLeft);
  connect(take_, &QPushButton::clicked, this, &ScreenResponseStep::measure);
  addHand(tr("Lay the Paper"), QStringLiteral("hand-paper-grey"),
          [] { return [](SimulatedHands& hands) { hands.layPaper(); }; });
  view()->setOverlay(
      [this](QPainter& painter, const QTransform& transform) { drawOver(painter, transform); });
}

void ScreenResponseStep::refreshControls() {
  if (take_) take_->setEnabled(!working());
}

std::string ScreenResponseStep::deviceName() const {
  return rig().screen() ? rig().screen()->name : std::string();
}

void ScreenResponseStep::measure() {
  if (!mayPhotograph()) return;
  const auto display = rig().display();
  if (!display) return say(sentencesOf(display.error()), Tone::Problem);
  PhotographOptions options;
  options.refreshHz = rig().screen()->refreshHz;
  options.conversion = conversion();
  CameraDevice* camera = rig().camera();
  work<ScreenCurve>(
      tr("Photographing greys"),
      [camera, shown = *display, screen = *rig().screen(), options,
       count = steps_->value()](const JobContext& job) -> Result<ScreenCurve> {
        JobContext quiet = job;
        quiet.progressSink = nullptr;
        const auto photographOf = [&](double value, const PhotographOptions& how) -> Result<Photograph> {
          const Result<OnGlass> glass = shown->show(greyPicture(screen, value), job.stop);
          if (!glass) return glass.error();
          PhotographOptions when = how;
          when.notBefore = glass->since;
          return takePhotograph(*camera, when, quiet);
        };
        // White decides the exposure of all.
        const Result<Photograph> white = photographOf(1, options);
        if (!white) return white.error();
        PhotographOptions fixed = options;
        fixed.frames = kFramesAveraged;
        if (white->exposureS > 0) fixed.exposureS = white->exposureS;
        const PixelRegion region = middleOf(white->image.width(), white->image.height());
        std::vector<GreySample> samples;
        const std::vector<double> greys = greyRamp(count);
        for (const double grey : greys) {
          if (job.cancelled()) return Error{ErrorCode::Cancelled, "the greys were cancelled", "", ""};
          job.progress("greys", static_cast<std::int64_t>(samples.size()),
                       static_cast<std::int64_t>(greys.size()), "greys");
          const double code = std::lround(255 * grey) / 255.0;  // what is really sent
          const Result<Photograph> photo = photographOf(code, fixed);
          if (!photo) return photo.error();
          samples.push_back({code, meanLight(photo->image, region)});
        }
        return fitScreenResponse(samples);
      },
      [this](ScreenCurve curve) {
        rig().closeDisplay();
        result_ = curve;
        if (!keep(StoredScreenResponse{curve}, 100 * curve.residual, "%", curve.warnings)) return;
        QString text =
            tr("About value to the power of %1; black is %2 % of white; greys are %3 % of white from the "
               "curve.")
                .arg(curve.exponent, 0, 'f', 3)
                .arg(100 * curve.blackShare, 0, 'f', 3)
                .arg(100 * curve.residual, 0, 'f', 3);
        for (const std::string& warning : curve.warnings) {
          QString sentence = QString::fromStdString(warning);
          if (!sentence.isEmpty()) sentence[0] = sentence[0].toUpper();
          text += QStringLiteral("\n") + sentence + QLatin1Char('.');
        }
        say(text, curve.warnings.empty() ? Tone::Good : Tone::Problem);
      });
}

void ScreenResponseStep::drawOver(QPainter& painter, const QTransform& transform) {
  const LiveFramePtr frame = view()->frame();
  if (!frame) return;
  const PixelRegion region = middleOf(frame->linear.width(), frame->linear.height());
  live_overlay::drawGhost(
      painter, transform,
      QPolygonF(QRectF(region.x0, region.y0, region.x1 - region.x0, region.y1 - region.y0)));
}

}  // namespace patina
