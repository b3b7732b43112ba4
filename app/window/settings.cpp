#include "app/window/settings.h"

#include <QCoreApplication>
#include <QDir>
#include <QStandardPaths>

namespace patina {

namespace {
constexpr int kRecentCount = 10;

QString defaultFile() {
  return QStandardPaths::writableLocation(QStandardPaths::GenericConfigLocation) +
         QStringLiteral("/patina/patina.ini");
}
}  // namespace

Settings::Settings(const QString& file)
    : store_(file.isEmpty() ? defaultFile() : file, QSettings::IniFormat) {}

QStringList Settings::recent() const {
  return store_.value(QStringLiteral("recent")).toStringList();
}

void Settings::addRecent(const QString& folder) {
  QStringList list = recent();
  list.removeAll(folder);
  list.prepend(folder);
  while (list.size() > kRecentCount) list.removeLast();
  store_.setValue(QStringLiteral("recent"), list);
}

void Settings::removeRecent(const QString& folder) {
  QStringList list = recent();
  list.removeAll(folder);
  store_.setValue(QStringLiteral("recent"), list);
}

void Settings::clearRecent() {
  store_.remove(QStringLiteral("recent"));
}

FourierFitOptions Settings::fitOptions() const {
  FourierFitOptions options;
  store_.beginGroup(QStringLiteral("fit"));
  options.size = store_.value(QStringLiteral("size"), options.size).toInt();
  options.lobe = store_.value(QStringLiteral("lobe")).toString() == QStringLiteral("paper-affine")
                     ? LobeMapping::PaperAffine
                     : LobeMapping::ExactMoments;
  options.weights = store_.value(QStringLiteral("weights")).toString() == QStringLiteral("paper-constant")
                        ? MeasurementWeights::PaperConstant
                        : MeasurementWeights::Noise;
  options.maxIterations = store_.value(QStringLiteral("max_iterations"), options.maxIterations).toInt();
  options.tolerance = store_.value(QStringLiteral("tolerance"), options.tolerance).toDouble();
  options.neighbourRestarts =
      store_.value(QStringLiteral("neighbour_restarts"), options.neighbourRestarts).toBool();
  options.poolNeighbours = store_.value(QStringLiteral("pool_neighbours"), options.poolNeighbours).toBool();
  options.schedule = store_.value(QStringLiteral("schedule")).toString() == QStringLiteral("paper")
                         ? FitSchedule::Paper
                         : FitSchedule::Independent;
  options.memoryLimitBytes =
      store_.value(QStringLiteral("memory_bytes"), QVariant::fromValue<qulonglong>(options.memoryLimitBytes))
          .toULongLong();
  store_.endGroup();
  // A file that somebody edited, or an older version's: start anew rather than refuse every fit.
  return options.validate().empty() ? options : FourierFitOptions{};
}

void Settings::setFitOptions(const FourierFitOptions& options) {
  store_.beginGroup(QStringLiteral("fit"));
  store_.setValue(QStringLiteral("size"), options.size);
  store_.setValue(QStringLiteral("lobe"), options.lobe == LobeMapping::PaperAffine
                                              ? QStringLiteral("paper-affine")
                                              : QStringLiteral("exact-moments"));
  store_.setValue(QStringLiteral("weights"), options.weights == MeasurementWeights::PaperConstant
                                                 ? QStringLiteral("paper-constant")
                                                 : QStringLiteral("noise"));
  store_.setValue(QStringLiteral("max_iterations"), options.maxIterations);
  store_.setValue(QStringLiteral("tolerance"), options.tolerance);
  store_.setValue(QStringLiteral("neighbour_restarts"), options.neighbourRestarts);
  store_.setValue(QStringLiteral("pool_neighbours"), options.poolNeighbours);
  store_.setValue(QStringLiteral("schedule"), options.schedule == FitSchedule::Paper
                                                  ? QStringLiteral("paper")
                                                  : QStringLiteral("independent"));
  store_.setValue(QStringLiteral("memory_bytes"), QVariant::fromValue<qulonglong>(options.memoryLimitBytes));
  store_.endGroup();
}

TwoShotChoices Settings::twoShotChoices() const {
  TwoShotChoices choices;
  store_.beginGroup(QStringLiteral("two_shot"));
  TwoShotFitOptions& fit = choices.fit;
  fit.eta = store_.value(QStringLiteral("eta"), fit.eta).toDouble();
  fit.chooseEta = store_.value(QStringLiteral("choose_eta"), fit.chooseEta).toBool();
  fit.rowsPerShot = store_.value(QStringLiteral("rows_per_shot"), fit.rowsPerShot).toInt();
  fit.noiseWeights = store_.value(QStringLiteral("noise_weights"), fit.noiseWeights).toBool();
  fit.clusters = store_.value(QStringLiteral("clusters"), fit.clusters).toInt();
  choices.basisFile = store_.value(QStringLiteral("basis_file")).toString();
  store_.endGroup();
  if (!fit.validate().empty()) fit = {};
  return choices;
}

void Settings::setTwoShotChoices(const TwoShotChoices& choices) {
  store_.beginGroup(QStringLiteral("two_shot"));
  store_.setValue(QStringLiteral("eta"), choices.fit.eta);
  store_.setValue(QStringLiteral("choose_eta"), choices.fit.chooseEta);
  store_.setValue(QStringLiteral("rows_per_shot"), choices.fit.rowsPerShot);
  store_.setValue(QStringLiteral("noise_weights"), choices.fit.noiseWeights);
  store_.setValue(QStringLiteral("clusters"), choices.fit.clusters);
  store_.setValue(QStringLiteral("basis_file"), choices.basisFile);
  store_.endGroup();
}

PlanOptions Settings::planOptions() const {
  PlanOptions options;
  store_.beginGroup(QStringLiteral("plan"));
  options.shots = store_.value(QStringLiteral("shots"), options.shots).toInt();
  options.fovDeg = store_.value(QStringLiteral("fov_deg"), options.fovDeg).toDouble();
  const QString setup = store_.value(QStringLiteral("setup")).toString();
  options.setup = setup == QStringLiteral("fixed-camera")  ? PlanSetup::FixedCamera
                  : setup == QStringLiteral("fixed-light") ? PlanSetup::FixedLight
                                                           : PlanSetup::Free;
  options.region =
      store_.value(QStringLiteral("trusted_only"), false).toBool() ? BasisRegion::Trusted : BasisRegion::All;
  options.poseErrorDeg = store_.value(QStringLiteral("pose_error_deg"), options.poseErrorDeg).toDouble();
  options.restarts = store_.value(QStringLiteral("restarts"), options.restarts).toInt();
  store_.endGroup();
  return options.validate().empty() ? options : PlanOptions{};
}

void Settings::setPlanOptions(const PlanOptions& options) {
  store_.beginGroup(QStringLiteral("plan"));
  store_.setValue(QStringLiteral("shots"), options.shots);
  store_.setValue(QStringLiteral("fov_deg"), options.fovDeg);
  store_.setValue(QStringLiteral("setup"),
                  options.setup == PlanSetup::FixedCamera  ? QStringLiteral("fixed-camera")
                  : options.setup == PlanSetup::FixedLight ? QStringLiteral("fixed-light")
                                                           : QStringLiteral("free"));
  store_.setValue(QStringLiteral("trusted_only"), options.region == BasisRegion::Trusted);
  store_.setValue(QStringLiteral("pose_error_deg"), options.poseErrorDeg);
  store_.setValue(QStringLiteral("restarts"), options.restarts);
  store_.endGroup();
}

std::map<std::string, double> Settings::stageSeconds(const QString& group) const {
  std::map<std::string, double> seconds;
  store_.beginGroup(group);
  for (const QString& key : store_.childKeys()) seconds[key.toStdString()] = store_.value(key).toDouble();
  store_.endGroup();
  return seconds;
}

void Settings::setStageSeconds(const std::map<std::string, double>& seconds, const QString& group) {
  store_.remove(group);
  store_.beginGroup(group);
  for (const auto& [stage, value] : seconds) store_.setValue(QString::fromStdString(stage), value);
  store_.endGroup();
}

}  // namespace patina
