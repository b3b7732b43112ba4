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
  store_.endGroup();
}

std::map<std::string, double> Settings::stageSeconds() const {
  std::map<std::string, double> seconds;
  store_.beginGroup(QStringLiteral("stages"));
  for (const QString& key : store_.childKeys()) seconds[key.toStdString()] = store_.value(key).toDouble();
  store_.endGroup();
  return seconds;
}

void Settings::setStageSeconds(const std::map<std::string, double>& seconds) {
  store_.remove(QStringLiteral("stages"));
  store_.beginGroup(QStringLiteral("stages"));
  for (const auto& [stage, value] : seconds) store_.setValue(QString::fromStdString(stage), value);
  store_.endGroup();
}

}  // namespace patina
