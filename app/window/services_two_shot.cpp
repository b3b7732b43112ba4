// The engine's two-shot calls, as the window makes them.
#include <QFile>
#include <QJsonDocument>
#include <QJsonObject>
#include <mutex>

#include "app/window/services.h"
#include "devices/simulated/two_shot_scenes.h"
#include "engine/base/atomic_file.h"
#include "engine/render/two_shot_pictures.h"

namespace patina {

namespace {

/// The basis that was used last stays open: its table is mapped from a file of hundreds of megabytes whose
/// checksum is verified at every opening.
class BasisKeeper {
 public:
  Result<BasisPtr> get(const std::filesystem::path& file, const JobContext& job) {
    const std::lock_guard lock(mutex_);
    std::error_code none;
    const auto written =
        file.empty() ? std::filesystem::file_time_type{} : std::filesystem::last_write_time(file, none);
    if (basis_ && file == file_ && written == written_) return basis_;
    auto opened = basisFor(file, job);
    if (!opened) return opened.error();
    basis_ = *opened;
    file_ = file;
    written_ = written;
    return basis_;
  }

 private:
  std::mutex mutex_;
  std::filesystem::path file_;
  std::filesystem::file_time_type written_;
  BasisPtr basis_;
};

std::string kindOfFit(const std::filesystem::path& folder) {
  QFile file(QString::fromStdString((folder / "fit.json").string()));
  if (!file.open(QIODevice::ReadOnly)) return {};
  return QJsonDocument::fromJson(file.readAll())
      .object()
      .value(QStringLiteral("kind"))
      .toString()
      .toStdString();
}

}  // namespace

void Services::addTwoShot() {
  const auto keeper = std::make_shared<BasisKeeper>();
  captureKind = [](const std::filesystem::path& folder) { return patina::captureKind(folder); };
  fitKind = kindOfFit;
  readTwoShot = [](const std::filesystem::path& folder, const JobContext& job) {
    return readTwoShotCapture(folder, job);
  };
  readTwoShotPhoto = [](const TwoShotCapture& capture, const TwoShotPhoto& photo) {
    return patina::readPhoto(capture, photo);
  };
  fitTwoShot = [keeper](const TwoShotCapture& capture, const std::filesystem::path& basisFile,
                        const TwoShotFitOptions& options, const JobContext& job) -> Result<TwoShotFitPtr> {
    const auto basis = keeper->get(basisFile, job);
    if (!basis) return basis.error();
    return patina::fitTwoShot(capture, *basis, options, job);
  };
  writeTwoShotFit = [](const std::filesystem::path& folder, const TwoShotFit& fit) {
    return patina::writeTwoShotFit(folder, fit, [&fit](const std::filesystem::path& staged) {
      return writeTwoShotPictures(staged, fit, {});
    });
  };
  loadTwoShotFit = [](const std::filesystem::path& folder, const JobContext& job) {
    return patina::loadTwoShotFit(folder, job);
  };
  plan = [keeper](const std::filesystem::path& basisFile, const PlanOptions& options,
                  const JobContext& job) -> Result<Plan> {
    const auto basis = keeper->get(basisFile, job);
    if (!basis) return basis.error();
    return planDirections(*basis, options, job);
  };
  expect = [keeper](const std::filesystem::path& basisFile, const std::vector<ShotDirections>& shots,
                    const NearFieldDisc& disc, BasisRegion region, double eta,
                    const JobContext& job) -> Result<Plan> {
    const auto basis = keeper->get(basisFile, job);
    if (!basis) return basis.error();
    return expectationOf(*basis, shots, disc, region, eta);
  };
  writePlan = [](const std::filesystem::path& file, const Plan& plan) -> Status {
    auto drawing = file;
    drawing.replace_extension(".svg");
    if (auto drawn = writeFileAtomically(drawing, drawPlanSvg(plan)); !drawn) return drawn;
    return patina::writePlan(file, plan);
  };
  simulateTwoShot = [](const std::string& name, const std::filesystem::path& folder,
                       const JobContext& job) -> Result<TwoShotCapture> {
    const auto scene = twoShotScene(name);
    if (!scene) return scene.error();
    const auto report = patina::simulateTwoShot(*scene, folder, job);
    if (!report) return report.error();
    return readTwoShotCapture(folder, job);
  };
  for (const std::string& name : twoShotSceneNames())
    twoShotScenes.emplace_back(name, twoShotSceneSummary(name));
}

}  // namespace patina
