#pragma once

#include <QImage>
#include <QObject>
#include <QString>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "engine/render/measured_sphere.h"

namespace patina {

/// What a sphere shows. Pictures of equal scenes may be added up.
struct SphereScene {
  std::shared_ptr<const TabulatedBrdf> brdf;
  std::shared_ptr<const std::vector<float>> posteriorSd;
  double priorSd = 0;
  std::string environmentId;   ///< "": none; "file": `environment`
  EnvironmentPtr environment;  ///< of "file"
  float yawRad = 0,
        pitchRad = 0;  ///< how the environment is turned: about the vertical, then towards the eye
  Eigen::Vector3f toLight = Eigen::Vector3f::UnitZ();
  Eigen::Array3f lightIrradiance = Eigen::Array3f::Zero();
  int size = 256;  ///< device pixels

  bool sameMaterial(const SphereScene& other) const {
    return brdf == other.brdf && posteriorSd == other.posteriorSd && priorSd == other.priorSd;
  }
  bool operator==(const SphereScene& other) const;
};

/// How it is shown.
struct SphereLook {
  double exposureEv = 0;  ///< 0: a white matt sphere in this light would be just white
  bool certainty = false;
  bool operator==(const SphereLook&) const = default;
};

/// A picture ready for the screen.
struct ShownSphere {
  QImage picture;  ///< RGBA8888, straight opacity
  std::shared_ptr<const Image> certainty;
  QImage backdrop;  ///< the environment, blurred; null where it is the one before
  std::uint64_t request = 0;
  int samples = 0;
  bool finest = false;
};

/// The rotation of a scene's environment.
Eigen::Matrix3f environmentFromView(float yawRad, float pitchRad);

/// Makes pictures of spheres on a thread of its own: the newest request only, coarse first (whatever happens,
/// so that something follows the cursor while it moves), then finer ones until the grain is gone. Lives in
/// the window's thread, which never waits for it, but for some milliseconds when it is destroyed.
class SphereWorker : public QObject {
  Q_OBJECT

 public:
  explicit SphereWorker(QObject* parent = nullptr);
  ~SphereWorker() override;

  /// Returns its number. Of an earlier request only the coarse picture may still come.
  std::uint64_t request(const SphereScene& scene, const SphereLook& look);
  /// Nothing is wanted any more.
  void abandon();
  void openEnvironment(const QString& file);

 Q_SIGNALS:
  void shown(const patina::ShownSphere& sphere);
  void environmentOpened(patina::EnvironmentPtr environment);
  void environmentFailed(QString sentence);

 private:
  struct Request {
    SphereScene scene;
    SphereLook look;
    std::uint64_t number = 0;
  };
  struct Finest {
    SphereScene scene;
    MeasuredSphere sphere;
    int parts = 0;
  };

  void run();
  void work(const Request& request, const JobContext& job);
  bool coarse(const Request& request, const MeasuredSphereLighting& lighting, float exposure, int size);
  void deliver(const Request& request, const MeasuredSphere& sphere, float exposure, int samples,
               bool finest);
  MeasuredSphereLighting lightingOf(const SphereScene& scene) const;
  float exposureOf(const Request& request, const MeasuredSphereLighting& lighting) const;
  bool newerWaiting();

  // Shared, under the mutex.
  std::mutex mutex_;
  std::condition_variable wake_;
  std::optional<Request> next_;
  QString fileToOpen_;
  bool quitting_ = false, mayStop_ = false, backdropLost_ = false;
  std::stop_source stop_;
  std::uint64_t number_ = 0, abandonedBefore_ = 0;

  // The worker's own.
  std::optional<SphereMaterial> material_;
  SphereScene materialOf_;
  std::optional<Finest> finest_;
  EnvironmentPtr backdropOf_;
  float backdropExposure_ = -1;
  std::stop_source quit_;

  std::thread thread_;
};

}  // namespace patina
