#include "widgets/sphere_worker.h"

#include <Eigen/Geometry>

#include "engine/render/tone_map.h"
#include "widgets/tone.h"

namespace patina {

namespace {

constexpr int kCoarseSize = 96, kCoarseSamples = 16;
constexpr int kMiddleSize = 256;
constexpr int kPartSamples = 32;
constexpr int kParts = 10;  ///< 320 samples: what is left of the grain is below a display's step
constexpr int kBackdropWidth = 256, kBackdropHeight = 128;

int byteOf(float encoded) {
  return static_cast<int>(std::clamp(encoded, 0.0f, 1.0f) * 255.0f + 0.5f);
}

QImage straightOpacity(const MeasuredSphere& sphere, const Image& shown) {
  const int size = shown.width();
  QImage out(size, size, QImage::Format_RGBA8888);
  const float radius = kMeasuredSphereRadius * static_cast<float>(size),
              middle = 0.5f * static_cast<float>(size);
  for (int y = 0; y < size; ++y) {
    auto* line = out.scanLine(y);
    for (int x = 0; x < size; ++x) {
      int fromX = x, fromY = y;
      const float covered = sphere.coverage.at(x, y);
      if (covered < 1) {
        // Beyond the rim the rim's own colour, unseen: what is interpolated there must not draw in black.
        const float dx = static_cast<float>(x) + 0.5f - middle, dy = static_cast<float>(y) + 0.5f - middle;
        const float far = std::sqrt(dx * dx + dy * dy), inside = (radius - 0.75f) / std::max(far, 1e-3f);
        if (inside < 1 && far < radius + 3) {
          fromX = std::clamp(static_cast<int>(middle + dx * inside), 0, size - 1);
          fromY = std::clamp(static_cast<int>(middle + dy * inside), 0, size - 1);
        }
      }
      const auto pixel = shown.pixel(fromX, fromY);
      for (int c = 0; c < 3; ++c)
        line[4 * x + c] = static_cast<uchar>(byteOf(pixel[static_cast<std::size_t>(c)]));
      line[4 * x + 3] = static_cast<uchar>(byteOf(covered));
    }
  }
  return out;
}

QImage blurredBackdrop(const Environment& environment, float exposure) {
  const Image& picture = environment.picture();
  Image small(kBackdropWidth, kBackdropHeight, 3);
  for (int y = 0; y < kBackdropHeight; ++y)
    for (int x = 0; x < kBackdropWidth; ++x) {
      const int x0 = x * picture.width() / kBackdropWidth,
                x1 = std::max(x0 + 1, (x + 1) * picture.width() / kBackdropWidth);
      const int y0 = y * picture.height() / kBackdropHeight,
                y1 = std::max(y0 + 1, (y + 1) * picture.height() / kBackdropHeight);
      for (int j = y0; j < y1; ++j)
        for (int i = x0; i < x1; ++i)
          for (int c = 0; c < 3; ++c)
            small.at(x, y, c) += picture.at(i, j, c) / static_cast<float>((x1 - x0) * (y1 - y0));
    }
  const Image shown = toneMap(small, exposure, Highlights::Shoulder);
  QImage out(kBackdropWidth, kBackdropHeight, QImage::Format_RGBA8888);
  for (int y = 0; y < kBackdropHeight; ++y) {
    auto* line = out.scanLine(y);
    for (int x = 0; x < kBackdropWidth; ++x) {
      for (int c = 0; c < 3; ++c) line[4 * x + c] = static_cast<uchar>(byteOf(shown.at(x, y, c)));
      line[4 * x + 3] = 255;
    }
  }
  return out;
}

}  // namespace

bool SphereScene::operator==(const SphereScene& other) const {
  return sameMaterial(other) && environmentId == other.environmentId && environment == other.environment &&
         yawRad == other.yawRad && pitchRad == other.pitchRad && toLight == other.toLight &&
         (lightIrradiance == other.lightIrradiance).all() && size == other.size;
}

Eigen::Matrix3f environmentFromView(float yawRad, float pitchRad) {
  return (Eigen::AngleAxisf(yawRad, Eigen::Vector3f::UnitY()) *
          Eigen::AngleAxisf(pitchRad, Eigen::Vector3f::UnitX()))
      .toRotationMatrix();
}

SphereWorker::SphereWorker(QObject* parent) : QObject(parent) {
  thread_ = std::thread([this] { run(); });
}

SphereWorker::~SphereWorker() {
  {
    const std::scoped_lock lock(mutex_);
    quitting_ = true;
    stop_.request_stop();
    quit_.request_stop();
  }
  wake_.notify_all();
  thread_.join();
}

std::uint64_t SphereWorker::request(const SphereScene& scene, const SphereLook& look) {
  std::uint64_t number = 0;
  {
    const std::scoped_lock lock(mutex_);
    number = ++number_;
    next_ = Request{scene, look, number};
    if (mayStop_) stop_.request_stop();
  }
  wake_.notify_all();
  return number;
}

void SphereWorker::abandon() {
  const std::scoped_lock lock(mutex_);
  next_.reset();
  stop_.request_stop();
  abandonedBefore_ = number_ + 1;
}

void SphereWorker::openEnvironment(const QString& file) {
  {
    const std::scoped_lock lock(mutex_);
    fileToOpen_ = file;
    if (mayStop_) stop_.request_stop();
  }
  wake_.notify_all();
}

bool SphereWorker::newerWaiting() {
  const std::scoped_lock lock(mutex_);
  return quitting_ || next_.has_value() || stop_.stop_requested() || !fileToOpen_.isEmpty();
}

void SphereWorker::run() {
  for (;;) {
    std::optional<Request> request;
    QString file;
    JobContext job;
    {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, [this] { return quitting_ || next_.has_value() || !fileToOpen_.isEmpty(); });
      if (quitting_) return;
      std::swap(file, fileToOpen_);
      if (file.isEmpty()) std::swap(request, next_);
      stop_ = std::stop_source();
      mayStop_ = false;
      job.stop = stop_.get_token();
    }
    try {
      if (!file.isEmpty()) {
        auto opened = loadEnvironment(file.toStdString());
        QMetaObject::invokeMethod(
            this,
            [this, opened = std::move(opened)] {
              if (opened)
                Q_EMIT environmentOpened(*opened);
              else
                Q_EMIT environmentFailed(QString::fromStdString(opened.error().sentence()));
            },
            Qt::QueuedConnection);
      } else {
        work(*request, job);
      }
    } catch (const std::exception& fault) {  // no memory: the window must survive it
      QMetaObject::invokeMethod(
          this,
          [this, what = QString::fromUtf8(fault.what())] {
            Q_EMIT environmentFailed(tr("The sphere could not be drawn: %1").arg(what));
          },
          Qt::QueuedConnection);
    }
  }
}

MeasuredSphereLighting SphereWorker::lightingOf(const SphereScene& scene) const {
  MeasuredSphereLighting lighting;
  lighting.environment =
      scene.environmentId == "file" ? scene.environment : builtInEnvironment(scene.environmentId);
  lighting.environmentFromView = environmentFromView(scene.yawRad, scene.pitchRad);
  lighting.toLight = scene.toLight;
  lighting.lightIrradiance = scene.lightIrradiance;
  return lighting;
}

float SphereWorker::exposureOf(const Request& request, const MeasuredSphereLighting& lighting) const {
  // As if nothing were turned, so that turning does not change the brightness.
  MeasuredSphereLighting straight = lighting;
  straight.environmentFromView.setIdentity();
  straight.toLight = Eigen::Vector3f(-0.3f, 0.5f, 0.8f);
  return static_cast<float>(exposureForWhite(straight) * std::exp2(request.look.exposureEv));
}

bool SphereWorker::coarse(const Request& request, const MeasuredSphereLighting& lighting, float exposure,
                          int size) {
  MeasuredSphereOptions options;
  options.size = size;
  options.samples = kCoarseSamples;
  JobContext job;
  if (size > kCoarseSize) {
    const std::scoped_lock lock(mutex_);
    job.stop = stop_.get_token();
  } else {
    job.stop = quit_.get_token();  // else nothing would be seen while requests follow one another quickly
  }
  const auto sphere = measuredSphere(*material_, lighting, options, job);
  if (!sphere) return false;
  deliver(request, *sphere, exposure, options.samples, false);
  const std::scoped_lock lock(mutex_);
  mayStop_ = true;
  return true;
}

void SphereWorker::work(const Request& request, const JobContext& job) {
  const SphereScene& scene = request.scene;
  if (!material_ || !scene.sameMaterial(materialOf_)) {
    material_.emplace(*scene.brdf, scene.posteriorSd.get(), scene.priorSd);
    materialOf_ = scene;
    finest_.reset();
  }
  const MeasuredSphereLighting lighting = lightingOf(scene);
  const float exposure = exposureOf(request, lighting);
  if (finest_ && finest_->scene == scene) {
    // Only the look is new.
    deliver(request, finest_->sphere, exposure, finest_->parts * kPartSamples, finest_->parts >= kParts);
    const std::scoped_lock lock(mutex_);
    mayStop_ = true;
  } else {
    finest_.reset();
    if (!coarse(request, lighting, exposure, std::min(scene.size, kCoarseSize)) || newerWaiting()) return;
    if (scene.size > kMiddleSize && (!coarse(request, lighting, exposure, kMiddleSize) || newerWaiting()))
      return;
  }
  MeasuredSphereOptions options;
  options.size = scene.size;
  options.samples = kPartSamples;
  // The small light is exact in every part; without an environment one is enough.
  const int parts = lighting.environment ? kParts : 1;
  for (int part = finest_ ? finest_->parts : 0; part < parts; ++part) {
    options.firstSample = part * kPartSamples;
    auto sphere = measuredSphere(*material_, lighting, options, job);
    if (!sphere) return;
    if (part == 0)
      finest_ = Finest{scene, std::move(*sphere), 1};
    else {
      accumulate(finest_->sphere, *sphere, part);
      finest_->parts = part + 1;
    }
    deliver(request, finest_->sphere, exposure, (part + 1) * kPartSamples, part + 1 == parts);
    if (newerWaiting()) return;
  }
}

void SphereWorker::deliver(const Request& request, const MeasuredSphere& sphere, float exposure, int samples,
                           bool finest) {
  ShownSphere result;
  Image display = toneMap(sphere.radiance, exposure, Highlights::Shoulder);
  if (request.look.certainty && !sphere.certainty.empty())
    display = certaintyPicture(display, sphere.certainty, request.scene.priorSd);
  result.picture = straightOpacity(sphere, display);
  if (!sphere.certainty.empty()) result.certainty = std::make_shared<const Image>(sphere.certainty);
  const EnvironmentPtr environment = lightingOf(request.scene).environment;
  bool lost = false;
  {
    const std::scoped_lock lock(mutex_);
    std::swap(lost, backdropLost_);
  }
  if (environment && (lost || environment != backdropOf_ || exposure != backdropExposure_)) {
    result.backdrop = blurredBackdrop(*environment, exposure);
    backdropOf_ = environment;
    backdropExposure_ = exposure;
  }
  result.request = request.number;
  result.samples = samples;
  result.finest = finest;
  QMetaObject::invokeMethod(
      this,
      [this, result = std::move(result)] {
        bool wanted = false;
        {
          const std::scoped_lock lock(mutex_);
          wanted = result.request >= abandonedBefore_;
          // A backdrop that nobody saw is sent again.
          if (!wanted) backdropLost_ = true;
        }
        if (wanted) Q_EMIT shown(result);
      },
      Qt::QueuedConnection);
}

}  // namespace patina
