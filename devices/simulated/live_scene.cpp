#include "devices/simulated/live_scene.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <numbers>

#include "devices/simulated/sheet_form.h"
#include "devices/simulated/spline_levels.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kEdgeSamples = 4;  ///< a pixel, squared, where it sees prints or the screen itself
constexpr double kSheetBeyond =
    1.04;                         ///< the sheet's size over the sample's: no pixel of the sample sees its rim
constexpr double kTable = 0.05;   ///< albedo of the table
constexpr double kMirror = 0.92;  ///< of a mirror
constexpr std::size_t kMostValues = std::size_t{250} << 20;  ///< a gigabyte of kernels

/// Density of the half-vector's slope, times what makes a BRDF of it. Source: frequency-domain paper, App. C;
/// fourier-model, "Definitions settled".
double lobe(double sigma, const Eigen::Vector3d& n, const Eigen::Vector3d& toLight,
            const Eigen::Vector3d& toView) {
  const Eigen::Vector3d s = toLight + toView;
  const double along = s.dot(n), nl = n.dot(toLight), nv = n.dot(toView);
  if (nl <= 0 || nv <= 0) return 0;
  const double slope2 = (s.squaredNorm() - along * along) / (along * along);
  const double cosine2 = along * along / s.squaredNorm();
  const double lh = 0.5 * s.norm();
  const double fresnel = 1 + (1 - 0.06) / 0.06 * std::pow(std::max(0.0, 1 - lh), 5);
  return std::exp(-0.5 * slope2 / (sigma * sigma)) / (2 * kPi * sigma * sigma) * fresnel /
         (cosine2 * cosine2 * 4 * nl * nv);
}

Eigen::Array3d microfacets(const SheetPoint& material, const Eigen::Vector3d& toLight,
                           const Eigen::Vector3d& toView) {
  const double g2 = material.kurtosis * material.kurtosis, c = std::sqrt(2 / (1 / g2 + g2));
  const double lobes = 0.5 * (lobe(c * material.sigma / material.kurtosis, material.normal, toLight, toView) +
                              lobe(c * material.sigma * material.kurtosis, material.normal, toLight, toView));
  return material.diffuse / kPi + material.specular * lobes;
}

/// The angle of the half-vector over which a BRDF's highlight falls to half, as a Gaussian's sigma.
double smoothness(const Brdf& brdf) {
  constexpr double kWidest = 0.5;
  const double view = 40 * kPi / 180;
  const Eigen::Vector3d toView(std::sin(view), 0, std::cos(view));
  const auto at = [&](double turned) {
    const Eigen::Vector3d half(std::sin(turned), 0, std::cos(turned));
    const Eigen::Vector3d toLight = 2 * half.dot(toView) * half - toView;
    const Eigen::Array3d value = brdf.evaluate(toLight, toView);
    return value.isFinite().all() ? value.mean() : 0.0;
  };
  const double peak = at(0), floor = at(-0.3);
  for (double turned = 0.0025; turned < kWidest; turned *= 1.1)
    if (at(-turned) - floor < 0.6 * (peak - floor)) return std::max(turned, 0.0025);
  return kWidest;
}

struct Ray {
  Eigen::Vector3d from, along;
};

/// Distance along the ray to a plane through `at`, only from its front; negative: none.
double frontHit(const Ray& ray, const Eigen::Vector3d& at, const Eigen::Vector3d& normal) {
  const double towards = ray.along.dot(normal);
  if (towards > -1e-9) return -1;
  return (at - ray.from).dot(normal) / towards;
}

/// Where a ray meets the lit side of the screen: its pixel and what of its white goes that way; -1: nowhere.
int screenPixel(const Screen& screen, const Ray& ray, float& emitted) {
  const Eigen::Vector3d normal = screen.worldFromScreen.col(2);
  const double t = frontHit(ray, screen.originMm, normal);
  if (t <= 0) return -1;
  const Eigen::Vector3d local =
      screen.worldFromScreen.transpose() * (ray.from + t * ray.along - screen.originMm);
  const double u = local.x() / screen.widthMm + 0.5, v = 0.5 - local.y() / screen.heightMm;
  if (u < 0 || u >= 1 || v < 0 || v >= 1) return -1;
  emitted = 1;
  if (screen.emission) {
    const Eigen::Vector3d eye = screen.worldFromScreen.transpose() * (ray.from - screen.originMm);
    const Eigen::Vector2d q = (local.head<2>() - eye.head<2>()) / eye.z();
    const ScreenEmission& e = *screen.emission;
    emitted =
        static_cast<float>(e.gain * std::exp(-0.5 * ((q - e.mean).array() / e.sigma.array()).square().sum()));
  }
  return static_cast<int>(v * screen.heightPx) * screen.widthPx + static_cast<int>(u * screen.widthPx);
}

}  // namespace

Eigen::Array3d whitePaperAlbedo() {
  return {0.87, 0.865, 0.85};
}

Eigen::Array3d whiteTileReflectance() {
  return {0.991, 0.990, 0.987};
}

Result<LiveScene> LiveScene::create(const LiveSceneSetup& setup, const JobContext& job) {
  LiveScene scene;
  scene.setup_ = setup;
  const Camera& camera = setup.camera;
  scene.width_ = camera.width;
  scene.height_ = camera.height;
  scene.pixels_.resize(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
  scene.values_.resize(static_cast<std::size_t>(camera.height));
  scene.albedo_ = Image(camera.width, camera.height, 3);

  const SheetSampler sampler(setup.sheet);
  const SheetForm form(setup.effects, setup.sheet);
  const Eigen::Vector3d eye = camera.positionMm();
  const Eigen::Rotation2Dd turn(setup.sampleTurnDeg * kPi / 180);
  const ScreenIntegrator integrator(setup.screen, {}, setup.quality, setup.effects);
  std::vector<double> smooth;
  for (const BrdfPtr& brdf : setup.brdfs) smooth.push_back(smoothness(*brdf));
  const bool mirror = setup.onTable == OnTable::Mirror;
  std::atomic<bool> tooNarrow{false}, tooMany{false};
  std::atomic<std::size_t> valueCount{0};
  std::atomic<int> finest{0};

  const auto addKernel = [&](Pixel& pixel, std::vector<float>& values, ScreenIntegrator::NodeKernel&& kernel,
                             const Eigen::Array3f& colour) {
    if (!kernel.resolved) tooNarrow = true;
    if (kernel.values.empty()) return;
    if ((valueCount += kernel.values.size()) > kMostValues) {
      tooMany = true;
      return;
    }
    for (int seen = finest; kernel.level > seen && !finest.compare_exchange_weak(seen, kernel.level);) {
    }
    pixel.terms.push_back(
        {kernel.level, kernel.x0, kernel.y0, kernel.width, kernel.height, values.size(), colour});
    values.insert(values.end(), kernel.values.begin(), kernel.values.end());
  };
  const auto addLambert = [&](Pixel& pixel, std::vector<float>& values, const Eigen::Vector3d& point,
                              const Eigen::Vector3d& normal, const Eigen::Array3d& albedo) {
    SurfacePart part;
    part.kind = SurfacePart::Kind::Lambert;
    ScreenIntegrator::Query query{point, (eye - point).normalized(), {}};
    query.material.normal = normal;
    if (setup.screenLit) addKernel(pixel, values, integrator.kernelOf(query, part), albedo.cast<float>());
    pixel.lambert = albedo;
    pixel.normal = normal;
    pixel.toView = query.toView;
    pixel.seen = true;
  };
  const auto addMeasured = [&](Pixel& pixel, std::vector<float>& values, const ScreenIntegrator::Query& query,
                               const Brdf& brdf, double smoothRad) {
    ScreenIntegrator::NodeKernel nodes = integrator.nodesFor(query, smoothRad);
    if (nodes.width == 0) return;
    const Screen& screen = setup.screen;
    const Eigen::Vector3d n = query.material.normal;
    const Eigen::Vector3d tangent = (Eigen::Vector3d::UnitX() - n.x() * n).normalized();
    Eigen::Matrix3d localFromWorld;
    localFromWorld << tangent.transpose(), n.cross(tangent).transpose(), n.transpose();
    const Eigen::Vector3d toView = localFromWorld * query.toView;
    const Eigen::Vector3d at =
        screen.worldFromScreen.transpose() * (query.pointMm - screen.originMm) / screen.unitMm();
    const double h = spacingOf(nodes.level);
    ScreenIntegrator::NodeKernel channel[3] = {nodes, nodes, nodes};
    for (auto& one : channel) one.values.assign(static_cast<std::size_t>(nodes.width) * nodes.height, 0.0f);
    for (int j = 0; j < nodes.height; ++j)
      for (int i = 0; i < nodes.width; ++i) {
        const Eigen::Vector3d to = Eigen::Vector3d((nodes.x0 + i) * h, (nodes.y0 + j) * h, 0) - at;
        const double distance = to.norm();
        const Eigen::Vector3d toLight = localFromWorld * (screen.worldFromScreen * (to / distance));
        if (toLight.z() <= 0) continue;
        const Eigen::Array3d value = brdf.evaluate(toLight, toView);
        if (!value.isFinite().all()) continue;
        double weight = toLight.z() * at.z() / (distance * distance * distance);
        if (screen.emission) {
          const Eigen::Array2d q =
              (to.head<2>() / at.z() - screen.emission->mean).array() / screen.emission->sigma.array();
          weight *= screen.emission->gain * std::exp(-0.5 * q.square().sum());
        }
        for (int c = 0; c < 3; ++c)
          channel[c].values[static_cast<std::size_t>(j) * nodes.width + i] =
              static_cast<float>(value[c] * weight);
      }
    for (int c = 0; c < 3; ++c)
      addKernel(pixel, values, std::move(channel[c]), Eigen::Array3f(c == 0, c == 1, c == 2));
  };

  const auto lookAt = [&](int x, int y) {
    Pixel& pixel = scene.pixels_[static_cast<std::size_t>(y) * camera.width + x];
    std::vector<float>& values = scene.values_[static_cast<std::size_t>(y)];
    // What covers how much of the pixel: prints first, then the screen itself, then the table.
    double printed = 0, printedShare = 0, tableShare = 0;
    const LivePrint* print = nullptr;
    std::map<int, float> glass;
    constexpr double kShare = 1.0 / (kEdgeSamples * kEdgeSamples);
    for (int j = 0; j < kEdgeSamples; ++j)
      for (int i = 0; i < kEdgeSamples; ++i) {
        const Eigen::Vector2d at(x + (i + 0.5) / kEdgeSamples - 0.5, y + (j + 0.5) / kEdgeSamples - 0.5);
        Ray ray{eye, camera.rayFromPixel(at)};
        double nearest = frontHit(ray, Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ());
        if (nearest <= 0) nearest = 1e12;
        bool hit = false;
        for (const LivePrint& one : setup.prints) {
          const double t =
              frontHit(ray, one.worldFromPrint.translation(), one.worldFromPrint.linear().col(2));
          if (t <= 0 || t > nearest + 1e-6) continue;
          const Eigen::Vector3d local = one.worldFromPrint.inverse() * (ray.from + t * ray.along);
          const double u = local.x() / one.widthMm + 0.5, v = 0.5 - local.y() / one.heightMm;
          if (u < 0 || u >= 1 || v < 0 || v >= 1) continue;
          const float albedo = one.albedo.at(static_cast<int>(u * one.albedo.width()),
                                             static_cast<int>(v * one.albedo.height()));
          if (!std::isfinite(albedo)) continue;
          printed += kShare * albedo;
          printedShare += kShare;
          print = &one;
          nearest = t;
          hit = true;
          break;
        }
        if (hit) continue;
        float emitted = 0;
        const Eigen::Vector3d normal = setup.screen.worldFromScreen.col(2);
        const double screenT = frontHit(ray, setup.screen.originMm, normal);
        if (screenT > 0 && screenT < nearest) {
          if (const int index = screenPixel(setup.screen, ray, emitted); index >= 0) {
            glass[index] += static_cast<float>(kShare) * emitted;
            continue;
          }
        }
        if (nearest >= 1e12) continue;  // the dark room
        if (mirror) {
          const Eigen::Vector3d point = ray.from + nearest * ray.along;
          if (std::abs(point.x()) < 0.5 * setup.sheet.widthMm &&
              std::abs(point.y()) < 0.5 * setup.sheet.heightMm) {
            const Ray back{point, {ray.along.x(), ray.along.y(), -ray.along.z()}};
            // The emission counts for the eye's mirror image, as far away as the whole path is long.
            const Ray from{{eye.x(), eye.y(), -eye.z()}, back.along};
            if (const int index = screenPixel(setup.screen, from, emitted); index >= 0)
              glass[index] += static_cast<float>(kShare * kMirror) * emitted;
            continue;
          }
        }
        tableShare += kShare;
      }
    for (const auto& [index, weight] : glass) pixel.glass.push_back({index, weight});
    if (printedShare > 0) {
      const Ray ray{eye, camera.rayFromPixel(Eigen::Vector2d(x, y))};
      const Eigen::Vector3d normal = print->worldFromPrint.linear().col(2);
      const double t = frontHit(ray, print->worldFromPrint.translation(), normal);
      if (t > 0)
        addLambert(pixel, values, ray.from + t * ray.along, normal, Eigen::Array3d::Constant(printed));
    }
    if (!(tableShare > 0)) return;
    const auto point = form.seenAt(camera, Eigen::Vector2d(x, y));
    if (!point) return;
    const Eigen::Vector2d onIt = turn.inverse() * (point->head<2>() - setup.sampleShiftMm);
    const bool onSheet = std::abs(onIt.x()) <= 0.5 * kSheetBeyond * setup.sheet.widthMm &&
                         std::abs(onIt.y()) <= 0.5 * kSheetBeyond * setup.sheet.heightMm;
    if (setup.onTable != OnTable::Sheet || !onSheet || mirror) {
      const bool white = setup.onTable == OnTable::WhitePaper || setup.onTable == OnTable::WhiteTile;
      // Paper and tile cover more than the sample.
      const Eigen::Array3d albedo =
          white ? (setup.onTable == OnTable::WhitePaper ? whitePaperAlbedo() : whiteTileReflectance())
                : Eigen::Array3d::Constant(kTable);
      addLambert(pixel, values, *point, form.turned(Eigen::Vector3d::UnitZ(), point->x(), point->y()),
                 tableShare * albedo);
      return;
    }
    ScreenIntegrator::Query query{*point, (eye - *point).normalized(), sampler.at(onIt.x(), onIt.y())};
    query.material.normal.head<2>() = turn * Eigen::Vector2d(query.material.normal.head<2>());
    query.material.normal = form.turned(query.material.normal, point->x(), point->y());
    pixel.material = query.material;
    pixel.toView = query.toView;
    pixel.normal = query.material.normal;
    pixel.sheet = pixel.seen = true;
    if (!setup.brdfs.empty()) {
      const std::size_t which = static_cast<std::size_t>(query.material.material) % setup.brdfs.size();
      pixel.brdf = setup.brdfs[which].get();
      if (!setup.screenLit) return;
      addMeasured(pixel, values, query, *setup.brdfs[which], smooth[which]);
      return;
    }
    if (!setup.screenLit) return;
    const SurfaceParts parts = surfaceParts(query.material, setup.effects);
    if (parts.lambert.kind != SurfacePart::Kind::Nothing)
      addKernel(pixel, values, integrator.kernelOf(query, parts.lambert),
                query.material.diffuse.cast<float>());
    for (const SurfacePart& part : parts.specular)
      addKernel(pixel, values, integrator.kernelOf(query, part), query.material.specular.cast<float>());
    for (const SurfacePart& part : parts.white)
      addKernel(pixel, values, integrator.kernelOf(query, part), Eigen::Array3f::Ones());
  };

  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  arena.execute([&] {
    tbb::parallel_for(0, camera.height, [&](int y) {
      for (int x = 0; x < camera.width && !job.cancelled() && !tooMany; ++x) lookAt(x, y);
    });
  });
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "the simulated rig was stopped", "", ""};
  if (tooNarrow || tooMany)
    return Error{
        ErrorCode::Invalid,
        tooMany ? "the live simulated rig has too many light paths for the memory: the camera has too many "
                  "pixels for highlights this narrow"
                : "the sample's highlight is narrower than the simulated screen's grid resolves",
        setup.sheet.name, "choose a smaller camera or a sample with a broader highlight"};
  scene.finest_ = finest;
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const Pixel& pixel = scene.pixels_[static_cast<std::size_t>(y) * camera.width + x];
      const Eigen::Array3d albedo = !pixel.seen ? Eigen::Array3d::Zero()
                                    : pixel.sheet && setup.brdfs.empty()
                                        ? Eigen::Array3d(pixel.material.diffuse + pixel.material.specular)
                                    : pixel.sheet ? Eigen::Array3d(Eigen::Array3d::Constant(0.3))
                                                  : pixel.lambert;
      for (int c = 0; c < 3; ++c) scene.albedo_.at(x, y, c) = static_cast<float>(albedo[c]);
    }
  return scene;
}

Image LiveScene::radiance(const Image& light) const {
  const SplinePicture picture(setup_.screen, light, finest_);
  Image image(width_, height_, 3);
  tbb::parallel_for(0, height_, [&](int y) {
    for (int x = 0; x < width_; ++x) {
      const Pixel& pixel = pixels_[static_cast<std::size_t>(y) * width_ + x];
      Eigen::Array3f sum = Eigen::Array3f::Zero();
      for (const Term& term : pixel.terms)
        sum += term.colour * picture.dot(term.level, term.x0, term.y0, term.width, term.height,
                                         values_[static_cast<std::size_t>(y)].data() + term.first);
      for (const Glass& glass : pixel.glass)
        sum += glass.weight * light.samples()[static_cast<std::size_t>(glass.index)];
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = sum[c];
    }
  });
  return image;
}

Image LiveScene::underLamp(const LiveLamp& lamp) const {
  Image image(width_, height_, 3);
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      const Pixel& pixel = pixels_[static_cast<std::size_t>(y) * width_ + x];
      const double cosine = pixel.normal.dot(lamp.toLight);
      if (!pixel.seen || cosine <= 0) continue;
      Eigen::Array3d brdf = pixel.lambert / kPi;
      if (pixel.sheet && pixel.brdf) {
        const Eigen::Vector3d n = pixel.normal, tangent = (Eigen::Vector3d::UnitX() - n.x() * n).normalized();
        Eigen::Matrix3d localFromWorld;
        localFromWorld << tangent.transpose(), n.cross(tangent).transpose(), n.transpose();
        brdf = pixel.brdf->evaluate(localFromWorld * lamp.toLight, localFromWorld * pixel.toView);
        if (!brdf.isFinite().all()) brdf.setZero();
      } else if (pixel.sheet) {
        brdf = microfacets(pixel.material, lamp.toLight, pixel.toView);
      }
      for (int c = 0; c < 3; ++c)
        image.at(x, y, c) = static_cast<float>(brdf[c] * cosine * lamp.irradiance[c]);
    }
  return image;
}

}  // namespace patina
