#include "devices/simulated/flash_rig.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "devices/simulated/bundle_folder.h"
#include "engine/image/exr.h"
#include "engine/image/png.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;

/// Density of the microfacets' normals over solid angle, 1/sr: cos(tilt) times it integrates to one.
double normalDensity(const SheetPoint& point, const FlashSurface& surface, const Eigen::Vector3d& half) {
  const Eigen::Vector3d& n = point.normal;
  const double c = n.dot(half);
  if (!(c > 0)) return 0;
  const Eigen::Vector3d right = Eigen::Vector3d::UnitY().cross(n).normalized(), up = n.cross(right);
  double u = -half.dot(right) / c, v = -half.dot(up) / c;
  if (surface.anisotropy != 1) {
    const double a = surface.anisotropyAngleDeg * kDegree, stretch = std::sqrt(surface.anisotropy);
    const double along = u * std::cos(a) + v * std::sin(a), across = v * std::cos(a) - u * std::sin(a);
    u = along / stretch, v = across * stretch;
  }
  const double tan2 = u * u + v * v, cos4 = c * c * c * c;
  const auto gaussian = [&](double variance) {
    return std::exp(-tan2 / (2 * variance)) / (2 * kPi * variance * cos4);
  };
  const double variance = point.sigma * point.sigma;
  double density = 0;
  if (surface.heavyTails) {
    const double alpha2 = 2 * variance;
    density = 1 / (kPi * alpha2 * cos4 * (1 + tan2 / alpha2) * (1 + tan2 / alpha2));
  } else {
    // Two Gaussians whose variances have mean sigma^2 and ratio gamma^4.
    const double ratio = std::pow(point.kurtosis, 4), narrow = 2 * variance / (1 + ratio);
    density = 0.5 * (gaussian(narrow) + gaussian(narrow * ratio));
  }
  const double broad = variance * surface.thirdRatio * surface.thirdRatio;
  return (1 - surface.thirdShare) * density +
         (surface.thirdShare > 0 ? surface.thirdShare * gaussian(broad) : 0);
}

/// Light that leaves one point of the sheet towards the lens, before the camera.
Eigen::Array3d radianceAt(const FlashScene& scene, const SheetSampler& sheet, std::size_t photo,
                          const Eigen::Vector2d& at, double intensity) {
  const FlashPhone& phone = scene.phone;
  const Eigen::Vector3d place(at.x(), at.y(), 0), lens = scene.positionsMm[photo];
  const Eigen::Vector3d flash = lens + Eigen::Vector3d(phone.flashOffsetMm.x(), phone.flashOffsetMm.y(), 0);
  const Eigen::Vector3d down = place - flash, toLens = (lens - place).normalized();
  const double distance = down.norm();
  const Eigen::Vector3d toFlash = -down / distance;
  const SheetPoint point = sheet.at(at.x(), at.y());
  const double cosIn = point.normal.dot(toFlash), cosOut = point.normal.dot(toLens);
  Eigen::Array3d light = Eigen::Array3d::Zero();
  if (cosIn > 0 && cosOut > 0) {
    const Eigen::Vector3d half = (toFlash + toLens).normalized();
    // Schlick over its value at normal incidence; the albedo is quoted there.
    const double fresnel = (0.06 + 0.94 * std::pow(1 - toFlash.dot(half), 5)) / 0.06;
    const double gloss = normalDensity(point, scene.surface, half) * fresnel / (4 * cosIn * cosOut);
    double power = intensity / (distance * distance);
    if (!phone.power.empty()) power *= phone.power[photo];
    if (phone.beamExponent > 0) {
      const Eigen::Vector3d axis = Eigen::Vector3d(phone.beamAim.x(), phone.beamAim.y(), -1).normalized();
      power *= std::pow(std::max(0.0, axis.dot(down) / distance), phone.beamExponent);
    }
    light = (point.diffuse / kPi + point.specular * gloss) * (cosIn * power);
  }
  light += phone.ambient * point.diffuse / kPi;
  if (phone.vignetting > 0) {
    // Cosine of the field angle to a power that loses the asked share at the corner.
    const double corner = 0.5 * std::hypot(scene.sheet.widthMm, scene.sheet.heightMm);
    const double cornerCos = std::cos(std::atan2(corner, scene.positionsMm[0].z()));
    const double exponent = std::log(1 - phone.vignetting) / std::log(cornerCos);
    const double cosine = (-lens.normalized()).dot(-toLens);
    light *= std::pow(std::max(cosine, 1e-3), exponent);
  }
  return light;
}

double encodedSrgb(double linear) {
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}

}  // namespace

std::vector<std::string> FlashScene::validate() const {
  std::vector<std::string> problems = sheet.validate();
  if (positionsMm.empty()) problems.push_back("a flash scene needs photographs");
  for (const Eigen::Vector3d& position : positionsMm)
    if (!(position.z() > 1)) problems.push_back("every position must be in front of the sheet");
  if (!phone.power.empty() && phone.power.size() != positionsMm.size())
    problems.push_back("the phone's power needs one factor a photograph");
  if (pixels < 8 || pixels > 8192) problems.push_back("pixels must lie in 8..8192");
  if (samplesASide < 1 || samplesASide > 16) problems.push_back("samplesASide must lie in 1..16");
  if (!(phone.vignetting >= 0 && phone.vignetting < 1)) problems.push_back("vignetting must lie in [0, 1)");
  if (!(phone.toneGamma > 0)) problems.push_back("toneGamma must be positive");
  for (const int index : holdout)
    if (index < 0 || index >= static_cast<int>(positionsMm.size()))
      problems.push_back("holdout names a photograph that is not there");
  return problems;
}

std::vector<Eigen::Vector3d> flashPositions(double widthMm, double heightMm) {
  const double w = widthMm, h = heightMm, z = std::max(w, h);
  return {{0.15 * w, 0.04 * h, 2.44 * z},  {0.44 * w, 0.50 * h, 2.39 * z},   {-0.19 * w, -0.31 * h, 2.56 * z},
          {-0.31 * w, 0.21 * h, 2.74 * z}, {0.33 * w, -0.16 * h, 2.48 * z},  {0.13 * w, 0.41 * h, 2.52 * z},
          {0.08 * w, -0.26 * h, 2.61 * z}, {-0.36 * w, -0.12 * h, 2.75 * z}, {0.42 * w, 0.17 * h, 2.50 * z}};
}

Result<FlashSimulationReport> simulateFlash(const FlashScene& scene, const std::filesystem::path& folder,
                                            const JobContext& job) {
  std::string problems;
  for (const std::string& problem : scene.validate()) problems += (problems.empty() ? "" : "; ") + problem;
  if (!problems.empty()) return Error{ErrorCode::Invalid, problems, scene.name, "change the scene"};
  auto bundle = BundleFolder::create(folder);
  if (!bundle) return bundle.error();
  const SheetSampler sheet(scene.sheet);
  const double longest = std::max(scene.sheet.widthMm, scene.sheet.heightMm);
  const int width = std::max(1, static_cast<int>(std::lround(scene.pixels * scene.sheet.widthMm / longest)));
  const int height =
      std::max(1, static_cast<int>(std::lround(scene.pixels * scene.sheet.heightMm / longest)));
  const auto expose = [&](std::size_t photo, double intensity, int samples, int stride) {
    const int w = std::max(1, width / stride), h = std::max(1, height / stride);
    Image image(w, h, 3);
    tbb::parallel_for(0, h, [&](int y) {
      for (int x = 0; x < w; ++x) {
        Eigen::Array3d sum = Eigen::Array3d::Zero();
        for (int s = 0; s < samples * samples; ++s) {
          const double px = (x + (s % samples + 0.5) / samples) / w,
                       py = (y + (s / samples + 0.5) / samples) / h;
          sum += radianceAt(scene, sheet, photo,
                            {(px - 0.5) * scene.sheet.widthMm, (0.5 - py) * scene.sheet.heightMm}, intensity);
        }
        for (int c = 0; c < 3; ++c) image.at(x, y, c) = static_cast<float>(sum[c] / (samples * samples));
      }
    });
    return image;
  };

  FlashSimulationReport report;
  report.photos = scene.positionsMm.size();
  report.intensity = scene.intensity;
  if (!(report.intensity > 0)) {
    // Without the room's light, whose strength is absolute.
    std::vector<float> values;
    for (std::size_t k = 0; k < scene.positionsMm.size(); ++k) {
      const Image coarse = expose(k, 1.0, 1, 4);
      values.insert(values.end(), coarse.samples().begin(), coarse.samples().end());
    }
    const auto at =
        values.begin() + static_cast<std::ptrdiff_t>((1 - std::clamp(scene.clippedShare, 0.0, 0.9)) *
                                                     static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    if (!(*at > 0)) return Error{ErrorCode::Invalid, "the sheet is black", scene.name, "give it some albedo"};
    report.intensity = 1 / *at;
  }
  FlashCapture capture;
  capture.folder = bundle->path();
  capture.widthMm = scene.sheet.widthMm, capture.heightMm = scene.sheet.heightMm;
  capture.sampleName = scene.sheet.name, capture.madeBy = kMadeBySimulatedRig;
  if (!scene.eightBits) capture.saturation = 1;
  for (std::size_t k = 0; k < scene.positionsMm.size(); ++k) {
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "the simulation was cancelled", "", ""};
    Image image = expose(k, report.intensity, scene.samplesASide, 1);
    if (scene.withNoise) senseInPlace(image, scene.noise, 1.0, job.seed, k);
    for (float& sample : image.samples()) {
      const double light = std::max(0.0, static_cast<double>(sample)), s = scene.phone.toneShoulder;
      double value = std::pow(light, scene.phone.toneGamma);
      if (s > 0) value = value * (1 + s) / (1 + s * value);
      value += scene.phone.black;
      report.clippedSamples += value >= 1;
      sample = static_cast<float>(std::clamp(value, 0.0, 1.0));
      if (scene.eightBits) sample = static_cast<float>(encodedSrgb(sample));
    }
    FlashPhoto photo;
    char name[32];
    std::snprintf(name, sizeof name, "photo_%03zu.%s", k, scene.eightBits ? "png" : "exr");
    photo.file = name;
    photo.encoding = scene.eightBits ? "srgb" : "";
    photo.cameraPositionMm = photo.lightPositionMm = scene.positionsMm[k];
    photo.lightIntensity.setConstant(report.intensity);
    photo.holdout =
        std::find(scene.holdout.begin(), scene.holdout.end(), static_cast<int>(k)) != scene.holdout.end();
    Status written = scene.eightBits ? writePng(capture.folder / photo.file, image)
                                     : writeExr(capture.folder / photo.file, image, {"R", "G", "B"});
    if (!written) return written.error();
    capture.photos.push_back(photo);
    job.progress("expose", static_cast<std::int64_t>(k) + 1,
                 static_cast<std::int64_t>(scene.positionsMm.size()), "photos");
  }
  if (Status written = writeFlashCapture(capture); !written) return written.error();
  if (Status done = bundle->commit(); !done) return done.error();
  return report;
}

}  // namespace patina
