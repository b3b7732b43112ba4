#include "devices/simulated/simulated_rig.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <mutex>
#include <numbers>
#include <optional>
#include <utility>

#include "devices/simulated/sheet_form.h"
#include "devices/simulated/subsurface.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kPixelsTogether = 16;  ///< of a row: near enough for their lobes to share most of their nodes

/// Rows are x right, y down, z forward of a camera at `from` that looks at `at` with +y of the world up.
Eigen::Matrix3d lookAt(const Eigen::Vector3d& from, const Eigen::Vector3d& at) {
  const Eigen::Vector3d forward = (at - from).normalized();
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Matrix3d rotation;
  rotation << right.transpose(), forward.cross(right).transpose(), forward.transpose();
  return rotation;
}

double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// What a pixel sees: points of the sheet, spread evenly over it.
std::vector<Eigen::Vector3d> pixelSamples(const Camera& camera, const SheetForm& form, int x, int y,
                                          int side) {
  std::vector<Eigen::Vector3d> points;
  for (int j = 0; j < side; ++j)
    for (int i = 0; i < side; ++i) {
      const Eigen::Vector2d at(x + (i + 0.5) / side - 0.5, y + (j + 0.5) / side - 0.5);
      if (const auto point = form.seenAt(camera, at)) points.push_back(*point);
    }
  return points;
}

Error invalid(std::string what, std::string where, std::string tryThis) {
  return Error{ErrorCode::Invalid, std::move(what), std::move(where), std::move(tryThis)};
}

Error cancelledError() {
  return Error{ErrorCode::Cancelled, "the simulated capture was stopped", "", ""};
}

}  // namespace

SimulatedRig SimulatedRig::desk(int pixels, double sheetWidthMm, double sheetHeightMm) {
  const double span = std::max(sheetWidthMm, sheetHeightMm);
  // 250 mm from the sheet's centre, 47 degrees up, turned by a little: nobody sets up a desk exactly square.
  const double screenUp = 47.0 * kPi / 180;
  return placed(pixels, sheetWidthMm, sheetHeightMm,
                Eigen::Vector3d(14.0, -300.0, 318.0) * std::max(1.0, span / 150.0),
                Eigen::Vector3d(6.0, 250.0 * std::cos(screenUp), 250.0 * std::sin(screenUp)), 0.7);
}

SimulatedRig SimulatedRig::placed(int pixels, double sheetWidthMm, double sheetHeightMm,
                                  const Eigen::Vector3d& cameraMm, const Eigen::Vector3d& screenMm,
                                  double screenTurnDeg) {
  SimulatedRig rig;
  Screen& screen = rig.screen;
  screen.widthMm = 345.0;
  screen.heightMm = 194.0625;
  screen.widthPx = 1920;
  screen.heightPx = 1080;
  screen.windowSigma = {1.0, 1.0 / screen.aspect()};
  screen.emission = ScreenEmission{{0.0, 0.0}, {1.6, 1.3}, 1.0};
  screen.originMm = screenMm;
  const Eigen::Vector3d normal = (Eigen::Vector3d(4.0, 0.0, 0.0) - screen.originMm).normalized();
  const Eigen::Vector3d up = (Eigen::Vector3d::UnitZ() - normal * normal.z()).normalized();
  screen.worldFromScreen << up.cross(normal), up, normal;
  screen.worldFromScreen =
      screen.worldFromScreen * Eigen::AngleAxisd(screenTurnDeg * kPi / 180, Eigen::Vector3d::UnitZ());

  Camera& camera = rig.camera;
  camera.width = camera.height = pixels;
  camera.cameraFromWorld = lookAt(cameraMm, Eigen::Vector3d::Zero());
  camera.translationMm = -camera.cameraFromWorld * cameraMm;
  camera.distortion << -0.06, 0.02, 0.0004, -0.0003, 0.0;
  camera.intrinsics << pixels, 0, 0.5 * (pixels - 1), 0, pixels, 0.5 * (pixels - 1), 0, 0, 1;
  double farthest = 0;  // of the sheet's corners from the picture's centre, at this focal length
  for (double x : {-0.5, 0.5})
    for (double y : {-0.5, 0.5})
      if (const auto at = camera.pixelFromWorld({x * sheetWidthMm, y * sheetHeightMm, 0}))
        farthest =
            std::max(farthest, (*at - Eigen::Vector2d::Constant(0.5 * (pixels - 1))).cwiseAbs().maxCoeff());
  const double focal = farthest > 0 ? pixels * 0.47 * pixels / farthest : pixels;
  camera.intrinsics(0, 0) = camera.intrinsics(1, 1) = focal;
  return rig;
}

std::vector<std::string> SimulatedRig::validate() const {
  std::vector<std::string> problems;
  const auto need = [&](bool good, const char* sentence) {
    if (!good) problems.emplace_back(sentence);
  };
  need(camera.width > 0 && camera.height > 0, "the camera has no pixels");
  need(camera.intrinsics(0, 0) > 0 && camera.intrinsics(1, 1) > 0,
       "the camera's focal length must be positive");
  need(camera.positionMm().z() > 0, "the camera must look at the sheet from above");
  need(screen.widthMm > 0 && screen.heightMm > 0, "the screen's size must be positive millimetres");
  need((screen.windowSigma.array() > 0).all(), "the window's widths must be positive");
  need(!screen.emission || (screen.emission->sigma.array() > 0).all(),
       "the emission's widths must be positive");
  need(noise.shot >= 0 && noise.read >= 0 && fullScale >= 0 && blackLevel >= 0 && exposureS > 0,
       "noise, full scale and black level can't be negative, and the exposure must be positive seconds");
  return problems;
}

// ---- the store of noise-free photographs ----

// Pages of an unlinked file beside the other temporary files: a megapixel capture is 2 GB, which the system
// may write out rather than keep. Small ones never reach the disk.
SimulatedExposure::SimulatedExposure(int width, int height, int photos)
    : width_(width), height_(height), photos_(photos) {
  constexpr std::size_t kKeepInMemory = std::size_t{512} << 20;
  int file = -1;
  int flags = MAP_PRIVATE | MAP_ANONYMOUS;
  if (bytes() > kKeepInMemory) {
    std::string name = (std::filesystem::temp_directory_path() / "patina-exposure-XXXXXX").string();
    file = mkstemp(name.data());
    if (file < 0) return;
    unlink(name.c_str());
    if (posix_fallocate(file, 0, static_cast<off_t>(bytes())) !=
        0) {  // else a full disk would be a bus error later
      close(file);
      return;
    }
    flags = MAP_SHARED;
  }
  void* pages = mmap(nullptr, bytes(), PROT_READ | PROT_WRITE, flags, file, 0);
  if (file >= 0) close(file);
  if (pages != MAP_FAILED) data_ = static_cast<float*>(pages);
}

SimulatedExposure::~SimulatedExposure() {
  if (data_) munmap(data_, bytes());
}

SimulatedExposure::SimulatedExposure(SimulatedExposure&& other) noexcept
    : width_(other.width_),
      height_(other.height_),
      photos_(other.photos_),
      data_(std::exchange(other.data_, nullptr)) {}

SimulatedExposure& SimulatedExposure::operator=(SimulatedExposure&& other) noexcept {
  std::swap(width_, other.width_);
  std::swap(height_, other.height_);
  std::swap(photos_, other.photos_);
  std::swap(data_, other.data_);
  return *this;
}

std::size_t SimulatedExposure::bytes() const {
  return sizeof(float) * 3 * static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_) *
         static_cast<std::size_t>(photos_);
}

float* SimulatedExposure::pixel(int photo, int x, int y) {
  return data_ + ((static_cast<std::size_t>(photo) * height_ + y) * width_ + x) * 3;
}
const float* SimulatedExposure::pixel(int photo, int x, int y) const {
  return data_ + ((static_cast<std::size_t>(photo) * height_ + y) * width_ + x) * 3;
}

Image SimulatedExposure::photo(int index) const {
  Image image(width_, height_, 3);
  const float* first = pixel(index, 0, 0);
  std::copy(first, first + image.samples().size(), image.samples().begin());
  return image;
}

// ---- exposing ----

Result<SimulatedExposure> exposeSheet(const SimulatedRig& rig, const SimulatedSheet& sheet,
                                      const SimulatedCaptureOptions& options, const JobContext& job,
                                      SimulatedCaptureReport* report) {
  std::vector<std::string> problems = rig.validate();
  for (std::string& problem : sheet.validate()) problems.push_back(std::move(problem));
  for (std::string& problem : options.effects.validate(static_cast<int>(sheet.materials.size())))
    problems.push_back(std::move(problem));
  if (options.samplesPerPixelSide < 1 || options.samplesPerPixelSide > 16)
    problems.emplace_back("samplesPerPixelSide must lie in 1 to 16");
  if (options.quality.cellsAcross < 200)
    problems.emplace_back("cellsAcross must be at least 200, or the patterns alias");
  if (!(options.quality.nodesPerSigma >= 1) || !(options.quality.nodesPerDistance >= 4) ||
      !(options.quality.lobeReach >= 4))
    problems.emplace_back("nodesPerSigma must be at least 1, nodesPerDistance 4 and lobeReach 4");
  if (!problems.empty()) {
    std::string all;
    for (const std::string& problem : problems) all += (all.empty() ? "" : "; ") + problem;
    return invalid("the simulated capture can't be taken: " + all, sheet.name, "correct these values");
  }

  std::vector<Eigen::Vector2i> frequencies = options.fitted;
  frequencies.insert(frequencies.end(), options.heldOut.begin(), options.heldOut.end());
  const int width = rig.camera.width, height = rig.camera.height, side = options.samplesPerPixelSide;
  const SheetSampler sampler(sheet);
  const Eigen::Vector3d eye = rig.camera.positionMm();
  const SheetForm form(options.effects, sheet);
  const auto materialAt = [&](const Eigen::Vector3d& point) {
    SheetPoint material = sampler.at(point.x(), point.y());
    material.normal = form.turned(material.normal, point.x(), point.y());
    return material;
  };
  ScreenIntegrator integrator(trueScreen(rig.screen, options.effects), frequencies, options.quality,
                              options.effects);
  SimulatedExposure exposure(width, height, 2 + static_cast<int>(4 * frequencies.size()));
  if (!exposure.valid())
    return Error{
        ErrorCode::WriteFailed, "there is no room to keep the simulated photographs while they are made",
        std::filesystem::temp_directory_path().string(), "free some disk space or take a smaller capture"};

  const auto start = std::chrono::steady_clock::now();
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::atomic<int> finest{0};
  std::atomic<bool> tooNarrow{false};
  bool prepared = false;
  arena.execute([&] {
    tbb::parallel_for(0, height, [&](int y) {
      for (int x = 0; x < width && !job.cancelled(); ++x)
        for (const Eigen::Vector3d& point : pixelSamples(rig.camera, form, x, y, side)) {
          const int level = integrator.finestLevel(point, (eye - point).normalized(), materialAt(point));
          if (level < 0) tooNarrow = true;
          for (int seen = finest; level > seen && !finest.compare_exchange_weak(seen, level);) {
          }
        }
    });
    if (!job.cancelled() && !tooNarrow) prepared = integrator.prepare(finest, job.stop);
  });
  if (tooNarrow)
    return invalid("the sheet's lobe is narrower than the simulator's finest grid resolves", sheet.name,
                   "raise sigma, or lower the kurtosis");
  if (!prepared) return cancelledError();
  const double prepareSeconds = secondsSince(start);

  const auto integrating = std::chrono::steady_clock::now();
  std::atomic<int> rowsDone{0};
  const int windowColumn = integrator.patternCount() - 1;
  std::optional<Subsurface> scattering;
  if (options.effects.subsurface.radiusMm > 0)
    scattering.emplace(rig.camera, options.effects.subsurface.radiusMm, integrator.patternCount(), side);
  arena.execute([&] {
    tbb::parallel_for(0, height, [&](int y) {
      Eigen::ArrayX3f light(integrator.patternCount(), 3);
      std::vector<ScreenIntegrator::Query> group;
      std::vector<int> pixelOf;
      ScreenIntegrator::GroupResponse response;
      for (int begin = 0; begin < width; begin += kPixelsTogether) {
        if (job.cancelled()) return;
        const int end = std::min(width, begin + kPixelsTogether);
        group.clear(), pixelOf.clear();
        for (int x = begin; x < end; ++x)
          for (const Eigen::Vector3d& point : pixelSamples(rig.camera, form, x, y, side)) {
            group.push_back({point, (eye - point).normalized(), materialAt(point)});
            pixelOf.push_back(x);
          }
        integrator.respond(group, response);
        std::size_t next = 0;
        for (int x = begin; x < end; ++x) {
          light.setZero();
          for (; next < group.size() && pixelOf[next] == x; ++next) {
            const SheetPoint& material = group[next].material;
            const auto column = static_cast<Eigen::Index>(next);
            for (int c = 0; c < 3; ++c)
              light.col(c) += (static_cast<float>(material.diffuse[c]) * response.diffuse.col(column) +
                               static_cast<float>(material.specular[c]) * response.specular.col(column))
                                  .head(integrator.patternCount())
                                  .array();
            if (response.white.size() > 0)
              light.colwise() += response.white.col(column).head(integrator.patternCount()).array();
            if (scattering) scattering->add(x, y, material, response.diffuse.col(column));
          }
          light *= 1.0f / static_cast<float>(side * side);
          for (int c = 0; c < 3; ++c) {
            exposure.pixel(0, x, y)[c] = light(windowColumn, c);
            exposure.pixel(1, x, y)[c] = 0.0f;
            for (int p = 0; p < windowColumn; ++p) exposure.pixel(2 + p, x, y)[c] = light(p, c);
          }
        }
      }
      job.progress("expose", ++rowsDone, height, "rows");
    });
  });
  if (job.cancelled()) return cancelledError();
  if (scattering)
    arena.execute([&] {
      tbb::parallel_for(0, height, [&](int y) {
        for (int x = 0; x < width && !job.cancelled(); ++x) {
          const Eigen::ArrayX3f change = scattering->change(x, y);
          for (int c = 0; c < 3; ++c) {
            exposure.pixel(0, x, y)[c] += change(windowColumn, c);
            for (int p = 0; p < windowColumn; ++p) exposure.pixel(2 + p, x, y)[c] += change(p, c);
          }
        }
      });
    });
  if (job.cancelled()) return cancelledError();
  if (report) {
    report->seconds["prepare"] = prepareSeconds;
    report->seconds["integrate"] = secondsSince(integrating);
    report->finestLevel = finest;
    report->photos = static_cast<std::size_t>(exposure.photos());
  }
  return exposure;
}

SheetTruth sheetTruth(const SimulatedSheet& sheet, int width, int height, int borderTexels) {
  SheetTruth truth{Image(width, height, 3), Image(width, height, 3), Image(width, height, 3),
                   Image(width, height, 1), Image(width, height, 1), Image(width, height, 1)};
  const SheetSampler sampler(sheet);
  const auto xAt = [&](double i) { return ((i + 0.5) / width - 0.5) * sheet.widthMm; };
  const auto yAt = [&](double j) { return (0.5 - (j + 0.5) / height) * sheet.heightMm; };
  for (int j = 0; j < height; ++j)
    for (int i = 0; i < width; ++i) {
      const SheetPoint point = sampler.at(xAt(i), yAt(j));
      for (int c = 0; c < 3; ++c) {
        truth.diffuse.at(i, j, c) = static_cast<float>(point.diffuse[c]);
        truth.specular.at(i, j, c) = static_cast<float>(point.specular[c]);
        truth.normal.at(i, j, c) = static_cast<float>(point.normal[c]);
      }
      truth.sigma.at(i, j) = static_cast<float>(point.sigma);
      truth.kurtosis.at(i, j) = static_cast<float>(point.kurtosis);
      const int here = sampler.materialAt(xAt(i), yAt(j));
      bool alone =
          true;  // looked up at half texels, so that a border between two texel centres is seen from both
      for (int v = -2 * borderTexels; v <= 2 * borderTexels && alone; ++v)
        for (int u = -2 * borderTexels; u <= 2 * borderTexels && alone; ++u)
          alone = sampler.materialAt(xAt(i + 0.5 * u), yAt(j + 0.5 * v)) == here;
      truth.material.at(i, j) = alone ? static_cast<float>(here) : -1.0f;
    }
  return truth;
}

}  // namespace patina
