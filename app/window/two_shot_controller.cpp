#include "app/window/two_shot_controller.h"

#include <QFileInfo>

#include "app/window/progress_estimate.h"
#include "widgets/brdf_slices_panel.h"
#include "widgets/brdf_sphere_viewport.h"
#include "widgets/comparison_panel.h"
#include "widgets/plan_dialog.h"
#include "widgets/shot_entry.h"
#include "widgets/two_shot_options_dialog.h"
#include "widgets/two_shot_page.h"
#include "widgets/two_shot_report.h"

namespace patina {

namespace {

std::filesystem::path pathOf(const QString& text) {
  return std::filesystem::path(text.toStdString());
}

}  // namespace

TwoShotController::TwoShotController(const Services& services, Settings& settings, QWidget* window)
    : services_(services), settings_(settings), window_(window) {
  page_ = new TwoShotPage(&document_, services_.readTwoShotPhoto, window);
  connect(page_->sphere(), &BrdfSphereViewport::failed, this, &TwoShotController::noticed);
  connect(page_->slices(), &BrdfSlicesPanel::failed, this, &TwoShotController::noticed);
  connect(page_->slices(), &BrdfSlicesPanel::saved, this, &TwoShotController::saved);
  connect(&document_, &TwoShotDocument::captureChanged, this, [this] {
    if (plan_) plan_->setCapture(document_.capture());
  });
  connect(&planJob_, &JobRunner::progressed, this,
          [this](const QString& stage, qint64 done, qint64 total, const QString&) {
            showPlanProgress(stage, done, total);
          });
  connect(&planJob_, &JobRunner::finished, this, [this] {
    if (plan_) plan_->setRunning(false);
  });
}

TwoShotController::~TwoShotController() {
  document_.disconnect();
  document_.undoStack()->disconnect();
  planJob_.disconnect();
}

std::function<Result<TwoShotController::FitPtr>(const JobContext&)> TwoShotController::fitWork() const {
  TwoShotFitOptions options = document_.choices().fit;
  options.basisFile = document_.choices().basisFile.toStdString();  // so that a saved fit finds it again
  return [fit = services_.fitTwoShot, capture = document_.capture(),
          options](const JobContext& job) -> Result<FitPtr> {
    return fit(*capture, options.basisFile, options, job);
  };
}

std::function<Status(const JobContext&)> TwoShotController::saveWork(const QString& folder) const {
  return [write = services_.writeTwoShotFit, fit = document_.fit(), folder](const JobContext&) {
    return write(pathOf(folder), *fit);
  };
}

void TwoShotController::adopt(FitPtr fit, const QString& how) {
  document_.adoptFit(std::move(fit), how);
}

void TwoShotController::open(FitPtr fit) {
  TwoShotChoices choices;
  choices.fit = fit->options;
  choices.basisFile = QString::fromStdString(choices.fit.basisFile);
  choices.fit.basisFile.clear();  // kept in one place
  document_.adoptFit(std::move(fit), tr("open fit"));
  document_.restoreChoices(choices);
  document_.undoStack()->clear();  // opening is not a step
}

void TwoShotController::editOptions() {
  TwoShotOptionsDialog dialog(document_.choices(), window_);
  if (dialog.exec() == QDialog::Accepted) document_.setChoices(dialog.choices());
}

// ---- planning
// --------------------------------------------------------------------------------------------------

PlanDialog* TwoShotController::planDialog() {
  if (plan_) return plan_;
  plan_ = new PlanDialog(window_);
  plan_->setOptions(settings_.planOptions());
  plan_->setBasisFile(document_.choices().basisFile);
  plan_->setCapture(document_.capture());
  const QByteArray geometry = settings_.bytes(QStringLiteral("plan/geometry"));
  if (!geometry.isEmpty()) plan_->restoreGeometry(geometry);
  connect(plan_, &PlanDialog::planRequested, this, [this] { startPlan(true); });
  connect(plan_, &PlanDialog::judgeRequested, this, [this] { startPlan(false); });
  connect(plan_, &PlanDialog::cancelRequested, &planJob_, &JobRunner::cancel);
  connect(plan_, &PlanDialog::saveRequested, this, &TwoShotController::savePlan);
  connect(plan_, &QDialog::finished, this, [this] {
    planJob_.abandon();  // nobody is there to see it
    settings_.setPlanOptions(plan_->options());
    settings_.set(QStringLiteral("plan/geometry"), plan_->saveGeometry());
  });
  return plan_;
}

void TwoShotController::showPlan() {
  planDialog()->show();
  planDialog()->raise();
  planDialog()->activateWindow();
}

void TwoShotController::startPlan(bool search) {
  if (planJob_.running()) return;
  std::vector<ShotDirections> reached;
  NearFieldDisc disc;
  if (const auto capture = document_.capture()) {
    disc = discOf(*capture);
    for (const TwoShotPhoto& shot : capture->shots)
      if (!shot.holdout) reached.push_back(directionsOf(shot));
  }
  const PlanOptions options = plan_->options();
  plan_->setRunning(true);
  planJob_.start<PlanOutcome>(
      [plan = services_.plan, expect = services_.expect, basis = pathOf(plan_->basisFile()), options, search,
       reached, disc](const JobContext& job) -> Result<PlanOutcome> {
        PlanOutcome outcome;
        if (search) {
          auto found = plan(basis, options, job);
          if (!found) return found.error();
          outcome.plan = std::move(*found);
        }
        if (!reached.empty() && !job.cancelled()) {
          auto judged = expect(basis, reached, disc, options.region, options.eta, job);
          if (!judged) return judged.error();
          outcome.reached = std::move(*judged);
        }
        return outcome;
      },
      [this](Result<PlanOutcome> outcome) {
        if (outcome) return plan_->setOutcome(*outcome);
        if (outcome.error().code == ErrorCode::Cancelled)
          return plan_->say(tr("Cancelled before anything was found."));
        plan_->say(QString::fromStdString(outcome.error().sentence()), true);
      });
}

void TwoShotController::showPlanProgress(const QString& stage, qint64 done, qint64 total) {
  if (!plan_ || planJob_.cancelling()) return;
  plan_->setProgress(QString::fromStdString(ProgressEstimate::title(stage.toStdString())),
                     total > 0 ? static_cast<double>(done) / static_cast<double>(total) : 0);
}

void TwoShotController::savePlan(const QString& file) {
  if (!plan_ || !plan_->outcome().plan) return;
  // A few kilobytes: no job.
  const auto written = services_.writePlan(pathOf(file), *plan_->outcome().plan);
  if (!written) return plan_->say(QString::fromStdString(written.error().sentence()), true);
  plan_->say(tr("Saved as %1, with a drawing of the same name as .svg.").arg(file));
  Q_EMIT saved(file);
}

// ---- what the window says
// -------------------------------------------------------------------------------------

QString TwoShotController::summary() const {
  const auto capture = document_.capture();
  if (!capture) return {};
  const auto held = std::count_if(capture->shots.begin(), capture->shots.end(),
                                  [](const TwoShotPhoto& shot) { return shot.holdout; });
  QString text = tr("%1 shots").arg(static_cast<qint64>(capture->shots.size()) - held);
  if (held > 0) text += tr(", %1 held out").arg(held);
  text += QStringLiteral("&nbsp;\u00b7&nbsp;");
  text += capture->disc
              ? tr("disc of %1 mm").arg(2 * capture->radiusMm, 0, 'g', 4)
              : tr("%1 \u00d7 %2 mm").arg(capture->widthMm, 0, 'g', 4).arg(capture->heightMm, 0, 'g', 4);
  return text;
}

QString TwoShotController::health(bool fitting) const {
  if (const auto fit = document_.fit()) return twoShotHealth(*fit);
  return fitting ? tr("Reconstructing") : tr("Not reconstructed yet. Press F5 to reconstruct.");
}

QString TwoShotController::healthTip() const {
  const auto fit = document_.fit();
  if (!fit) return {};
  QString tip =
      tr("Relative RMS of reconstruction minus photograph, over the sample's pixels and all channels.\n"
         "Expected error: of the reflectance in all directions, for a material that the basis does "
         "not hold.");
  for (const auto& [stage, seconds] : fit->stats.seconds)
    if (stage != "total")
      tip +=
          QStringLiteral("\n%1: %2 s")
              .arg(QString::fromStdString(ProgressEstimate::title(stage, ProgressEstimate::Work::TwoShotFit)))
              .arg(seconds, 0, 'f', 2);
  return tip;
}

// ---- state kept between starts
// --------------------------------------------------------------------------------

void TwoShotController::restoreState() {
  document_.restoreChoices(settings_.twoShotChoices());
  const QByteArray layout = settings_.bytes(QStringLiteral("two_shot_page/layout"));
  if (!layout.isEmpty()) page_->restoreLayout(layout);
  const auto number = [this](const char* key, double otherwise) {
    bool good = false;
    const double value = settings_.text(QStringLiteral("two_shot_page/") + key).toDouble(&good);
    return good && std::isfinite(value) ? value : otherwise;
  };
  ComparisonPanel* comparison = page_->comparison();
  comparison->setMode(static_cast<ComparisonMode>(
      std::clamp(settings_.number(QStringLiteral("two_shot_page/comparison"), 0), 0, 2)));
  comparison->setExposureEv(number("exposure_ev", 0));
  comparison->setDifferenceRange(number("difference_range", 0.5));
  BrdfSphereViewport* sphere = page_->sphere();
  const QString environment = settings_.text(QStringLiteral("two_shot_page/environment"));
  const QString none = QStringLiteral("none");  // an empty text is a settings file without the key
  if (!environment.isEmpty()) sphere->setEnvironment(environment == none ? QString() : environment);
  sphere->setLightOn(settings_.flag(QStringLiteral("two_shot_page/light"), sphere->lightOn()));
  sphere->setLightStrength(number("light_strength", sphere->lightStrength()));
  sphere->setExposureEv(number("sphere_exposure_ev", sphere->exposureEv()));
  sphere->setOverlayOn(settings_.flag(QStringLiteral("two_shot_page/certainty"), sphere->overlayOn()));
  document_.undoStack()->clear();
}

void TwoShotController::keepState() {
  settings_.setTwoShotChoices(document_.choices());
  settings_.set(QStringLiteral("two_shot_page/layout"), page_->saveLayout());
  ComparisonPanel* comparison = page_->comparison();
  settings_.set(QStringLiteral("two_shot_page/comparison"), static_cast<int>(comparison->mode()));
  settings_.set(QStringLiteral("two_shot_page/exposure_ev"), comparison->exposureEv());
  settings_.set(QStringLiteral("two_shot_page/difference_range"), comparison->differenceRange());
  const BrdfSphereViewport* sphere = page_->sphere();
  // A picture of the person's own is not opened again: it may be large, or gone.
  if (sphere->environment() != QStringLiteral("file"))
    settings_.set(QStringLiteral("two_shot_page/environment"),
                  sphere->environment().isEmpty() ? QStringLiteral("none") : sphere->environment());
  settings_.set(QStringLiteral("two_shot_page/light"), sphere->lightOn());
  settings_.set(QStringLiteral("two_shot_page/light_strength"), sphere->lightStrength());
  settings_.set(QStringLiteral("two_shot_page/sphere_exposure_ev"), sphere->exposureEv());
  settings_.set(QStringLiteral("two_shot_page/certainty"), sphere->overlayOn());
  if (plan_) {
    settings_.setPlanOptions(plan_->options());
    settings_.set(QStringLiteral("plan/geometry"), plan_->saveGeometry());
  }
}

}  // namespace patina
