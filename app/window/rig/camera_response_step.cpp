#include "app/window/rig/camera_response_step.h"

#include <QPushButton>
#include <numeric>

namespace patina {

namespace {

constexpr int kExposures = 7, kMiddle = 3;  ///< of a bracket, each twice the one before
constexpr int kDarkFrames = 4;

/// Pixel values as the camera gives them, share of full scale: no curve and no black level undone.
FrameConversion asIs() {
  FrameConversion conversion;
  conversion.black = 0;
  const ResponseCurve straight{{0, 1}, {0, 1}};
  conversion.response = {straight, straight, straight};
  return conversion;
}

/// Photographs of one scene at exposures that double, around what the histogram asks for.
Result<std::vector<ExposedPhoto>> takeBracket(CameraDevice& camera, const FrameConversion& conversion,
                                              int count, const JobContext& job) {
  JobContext quiet = job;
  quiet.progressSink = nullptr;
  PhotographOptions options;
  options.conversion = conversion;
  const Result<Photograph> first = takePhotograph(camera, options, quiet);
  if (!first) return first.error();
  double least = 0, most = 0;
  const auto controls = camera.controls();
  if (!controls) return controls.error();
  for (const CameraControl& control : *controls)
    if (control.id == CameraControlId::ExposureS && control.writable)
      least = control.least, most = control.most;
  if (!(first->exposureS > 0) || !(most > least))
    return Error{
        ErrorCode::Unsupported, "this camera's exposure can't be set, so its response can't be measured so",
        camera.info().name, "photograph a bracket by hand, and give it to 'patina-cli calibrate response'"};
  std::vector<ExposedPhoto> photos;
  for (int k = 0; k < count; ++k) {
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "the bracket was cancelled", "", ""};
    job.progress("bracket", k, count, "photos");
    options.exposureS = first->exposureS * std::pow(2.0, k - kMiddle);
    if (*options.exposureS < least || *options.exposureS > most) continue;
    Result<Photograph> photo = takePhotograph(camera, options, quiet);
    if (!photo) return photo.error();
    char name[48];
    std::snprintf(name, sizeof name, "exposure of %.4g s", photo->exposureS);
    photos.push_back({name, std::move(photo->image), photo->exposureS});
  }
  return photos;
}

QString sentenceOf(const std::string& words) {
  QString text = QString::fromStdString(words);
  if (!text.isEmpty()) text[0] = text[0].toUpper();
  return text.endsWith(QLatin1Char('.')) ? text : text + QLatin1Char('.');
}

}  // namespace

CameraResponseStep::CameraResponseStep(RigController& rig) : CalibrationStep(rig, "camera-response") {}

QString CameraResponseStep::title() const {
  return tr("Camera's response");
}

bool CameraResponseStep::linear() const {
  return !rig().camera() || isLinear(rig().camera()->format().layout);
}

QString CameraResponseStep::sentence() const {
  if (linear())
    return tr(
        "This camera's format is linear in light: this step shows it, and measures the black level, but may "
        "be left out. Point the camera at a still scene of bright and dark parts.");
  return tr(
      "This camera's format is not linear in light, so its curve must be measured. Point the camera at a "
      "still scene of bright and dark parts and touch nothing; then cover the lens.");
}

bool CameraResponseStep::canGoOn() const {
  return !working() && (linear() || CalibrationStep::canGoOn());
}

QString CameraResponseStep::whyNot() const {
  if (working()) return CalibrationStep::whyNot();
  return tr("The format is not linear, and its curve is not known yet.");
}

void CameraResponseStep::buildControls(QVBoxLayout* column, QWidget* parent) {
  bracket_ = makeButton(parent, tr("Photograph a Bracket"), QStringLiteral("response-bracket"), true);
  column->addWidget(bracket_, 0, Qt::AlignLeft);
  connect(bracket_, &QPushButton::clicked, this, &CameraResponseStep::bracket);
  column->addWidget(makeCaption(parent, tr("Then, with the lens covered")));
  takeDark_ = makeButton(parent, tr("Photograph Dark Frames"), QStringLiteral("response-dark"), false);
  column->addWidget(takeDark_, 0, Qt::AlignLeft);
  connect(takeDark_, &QPushButton::clicked, this, &CameraResponseStep::darkFrames);
  addHand(tr("Lay Markers under a Lamp"), QStringLiteral("hand-scene"),
          [] { return [](SimulatedHands& hands) { hands.holdBoard(Board::forSamplePlane(), 0); }; });
  addHand(tr("Cover the Lens"), QStringLiteral("hand-cover"),
          [] { return [](SimulatedHands& hands) { hands.coverLens(true); }; });
  addHand(tr("Uncover It"), QStringLiteral("hand-uncover"),
          [] { return [](SimulatedHands& hands) { hands.coverLens(false); }; });
}

void CameraResponseStep::refreshControls() {
  if (!bracket_) return;
  bracket_->setEnabled(!working());
  takeDark_->setEnabled(!working());
}

void CameraResponseStep::bracket() {
  if (!mayPhotograph()) return;
  CameraDevice* camera = rig().camera();
  work<CameraResponse>(
      tr("Photographing a bracket"),
      [camera](const JobContext& job) -> Result<CameraResponse> {
        const auto photos = takeBracket(*camera, asIs(), kExposures, job);
        if (!photos) return photos.error();
        return recoverResponse(*photos, {}, job);
      },
      [this](CameraResponse found) {
        result_ = std::move(found);
        keepBoth();
      });
}

void CameraResponseStep::darkFrames() {
  if (!mayPhotograph()) return;
  CameraDevice* camera = rig().camera();
  work<DarkLevel>(
      tr("Photographing dark frames"),
      [camera](const JobContext& job) -> Result<DarkLevel> {
        std::vector<Image> frames;
        StillRequest request;
        request.frames = kDarkFrames;
        const auto taken = camera->still(request, job.stop);
        if (!taken) return taken.error();
        for (const Frame& frame : *taken) {
          Result<Image> image = linearImage(frame, asIs());
          if (!image) return image.error();
          frames.push_back(std::move(*image));
        }
        return measureDarkLevel(frames);
      },
      [this](DarkLevel found) {
        dark_ = std::move(found);
        keepBoth();
      });
}

void CameraResponseStep::keepBoth() {
  if (!result_) return tell();  // the file holds a curve; a black level alone is told
  StoredResponse stored;
  stored.curves = result_->curves;
  stored.dark = dark_;
  std::vector<std::string> remarks = result_->warnings;
  if (dark_) remarks.insert(remarks.end(), dark_->warnings.begin(), dark_->warnings.end());
  const double residual = std::accumulate(result_->residual.begin(), result_->residual.end(), 0.0) / 3;
  if (keep(stored, 100 * residual, "%", remarks)) tell();
}

void CameraResponseStep::tell() {
  QStringList lines;
  bool good = true;
  if (result_) {
    lines << sentenceOf(result_->linearity.sentence);
    lines << tr("Exposures disagree by %1 % of the light.").arg(100 * result_->residual[1], 0, 'f', 2);
    for (const std::string& warning : result_->warnings) lines << sentenceOf(warning);
    good = good && result_->warnings.empty();
  } else {
    lines << tr("The bracket is still to be photographed.");
  }
  if (dark_) {
    lines << tr("Black is at %1 % of full scale; a pixel's noise there is %2 %.")
                 .arg(100 * dark_->level.mean(), 0, 'f', 3)
                 .arg(100 * dark_->readNoise.mean(), 0, 'f', 3);
    for (const std::string& warning : dark_->warnings) lines << sentenceOf(warning);
    good = good && dark_->warnings.empty();
  }
  say(lines.join(QLatin1Char('\n')), good ? Tone::Good : Tone::Problem);
}

CalibrationStep::Rechecker CameraResponseStep::rechecker() const {
  return [](const CalibrationRecord& record, const Photograph&, CameraDevice& camera,
            const JobContext& job) -> Result<Recheck> {
    // Two exposures, linearised by what is kept, must agree.
    auto photos = takeBracket(camera, asIs(), kMiddle + 1, job);
    if (!photos) return photos.error();
    if (photos->size() > 2) photos->erase(photos->begin(), photos->end() - 2);
    return recheckResponse(record, *photos);
  };
}

QString CameraResponseStep::recheckHint() const {
  return tr("Point the camera at a still scene of bright and dark parts.");
}

}  // namespace patina
