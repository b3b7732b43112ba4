// Finished pictures of measured spheres, for files.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/base/text.h"
#include "engine/render/contact_sheet.h"
#include "engine/render/measured_sphere.h"
#include "engine/render/tone_map.h"

namespace patina {
namespace {

/// Tone-mapped, then laid over the background: the rim's pixels blend what is shown, which keeps bright rims
/// free of steps.
Image shownOver(const MeasuredSphere& sphere, float exposure, float background) {
  Image shown = toneMap(sphere.radiance, exposure, Highlights::Shoulder);
  const float behind = srgbFromLinear(background);
  for (int y = 0; y < shown.height(); ++y)
    for (int x = 0; x < shown.width(); ++x)
      for (int c = 0; c < 3; ++c)
        shown.at(x, y, c) = behind + sphere.coverage.at(x, y) * (shown.at(x, y, c) - behind);
  return shown;
}

/// A material looks as light or dark as it is, but for dark ones, which would sink: up to three times
/// brighter, as long as nine tenths of the sphere stay below half of the display's light.
float exposureOf(const MeasuredSphere& sphere, const MeasuredSphereLighting& lighting) {
  const float white = exposureForWhite(lighting);
  return std::clamp(autoExposure(sphere.radiance, 0.9f, 0.5f), white, 3 * white);
}

MeasuredSphereOptions optionsOf(const SpherePictureOptions& options) {
  MeasuredSphereOptions own;
  own.size = options.size;
  own.samples = options.samples;
  return own;
}

}  // namespace

float exposureForWhite(const MeasuredSphereLighting& lighting) {
  constexpr int kSide = 24;
  const Eigen::Array3d weights(0.2126, 0.7152, 0.0722);
  double brightest = 0;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const double u = (x + 0.5) * 2 / kSide - 1, v = (y + 0.5) * 2 / kSide - 1;
      if (u * u + v * v >= 1) continue;
      const Eigen::Vector3d normal(u, v, std::sqrt(1 - u * u - v * v));
      double light = 0;
      if (lighting.environment)
        light +=
            (lighting.environment->irradianceOverPi(lighting.environmentFromView.cast<double>() * normal) *
             weights)
                .sum();
      const double cosine = normal.dot(lighting.toLight.cast<double>().normalized());
      light += (lighting.lightIrradiance.cast<double>() * weights).sum() / std::numbers::pi *
               std::max(0.0, cosine);
      brightest = std::max(brightest, light);
    }
  return brightest > 0 ? static_cast<float>(1 / brightest) : 1.0f;
}

std::array<float, 3> certaintyColour(float sdOverPrior) {
  // Blue, light grey, orange; display-encoded.
  static constexpr std::array<std::array<float, 3>, 3> kKeys{
      {{0.18f, 0.50f, 0.86f}, {0.82f, 0.82f, 0.82f}, {0.93f, 0.49f, 0.10f}}};
  const float at = std::isnan(sdOverPrior) ? 2.0f : std::clamp(sdOverPrior, 0.0f, 1.0f) * 2;
  const std::size_t first = at < 1 ? 0 : 1;
  const float t = at - static_cast<float>(first);
  std::array<float, 3> colour{};
  for (std::size_t c = 0; c < 3; ++c)
    colour[c] = kKeys[first][c] + (kKeys[first + 1][c] - kKeys[first][c]) * t;
  return colour;
}

Image certaintyPicture(const Image& shown, const Image& certainty, double priorSd) {
  Image painted = shown;
  for (int y = 0; y < shown.height(); ++y)
    for (int x = 0; x < shown.width(); ++x) {
      const auto pixel = painted.pixel(x, y);
      const float light = 0.2126f * pixel[0] + 0.7152f * pixel[1] + 0.0722f * pixel[2];
      const float sd = certainty.at(x, y);
      if (sd < 0) {
        for (float& value : pixel) value = 0.16f;
        continue;
      }
      const auto colour = certaintyColour(priorSd > 0 ? static_cast<float>(sd / priorSd) : 0.0f);
      // Shape remains readable, and the darkest lit pixel still shows its hue.
      for (std::size_t c = 0; c < 3; ++c) pixel[c] = colour[c] * (0.45f + 0.55f * light);
    }
  return painted;
}

Result<Image> spherePicture(const TabulatedBrdf& brdf, const SpherePictureOptions& options,
                            const JobContext& job) {
  MeasuredSphereLighting lighting;
  lighting.environment = builtInEnvironment(options.environment);
  if (!lighting.environment) {
    std::vector<std::string> ids;
    for (const EnvironmentEntry& entry : builtInEnvironments()) ids.push_back(entry.id);
    const std::string nearest = nearestWord(options.environment, ids);
    std::string all;
    for (const std::string& id : ids) all += (all.empty() ? "" : ", ") + id;
    return Error{ErrorCode::Invalid, "There is no environment " + inQuotes(options.environment), "",
                 nearest.empty() ? "Use one of: " + all : "Did you mean " + inQuotes(nearest) + "?"};
  }
  auto sphere = measuredSphere(SphereMaterial(brdf), lighting, optionsOf(options), job);
  if (!sphere) return sphere.error();
  return shownOver(*sphere, exposureOf(*sphere, lighting), options.background);
}

Result<Image> sphereSheet(const TabulatedBrdf& brdf, const std::vector<float>* posteriorSd, double priorSd,
                          const SpherePictureOptions& options, const JobContext& job) {
  const SphereMaterial material(brdf, posteriorSd, priorSd);
  std::vector<Image> pictures;
  std::vector<std::string> labels;
  for (const std::string id : {"studio", "window", "clear"}) {
    MeasuredSphereLighting lighting;
    lighting.environment = builtInEnvironment(id);
    auto sphere = measuredSphere(material, lighting, optionsOf(options), job);
    if (!sphere) return sphere.error();
    pictures.push_back(shownOver(*sphere, exposureOf(*sphere, lighting), options.background));
    labels.push_back(lighting.environment->name());
  }
  MeasuredSphereLighting alone;
  alone.lightIrradiance.setConstant(std::numbers::pi_v<float>);
  auto sphere = measuredSphere(material, alone, optionsOf(options), job);
  if (!sphere) return sphere.error();
  pictures.push_back(shownOver(*sphere, exposureOf(*sphere, alone), options.background));
  labels.push_back("Small light");
  if (posteriorSd) {
    const Image shown = toneMap(sphere->radiance, exposureOf(*sphere, alone), Highlights::Shoulder);
    Image colours = certaintyPicture(shown, sphere->certainty, priorSd);
    const float behind = srgbFromLinear(options.background);
    for (int y = 0; y < colours.height(); ++y)
      for (int x = 0; x < colours.width(); ++x)
        for (int c = 0; c < 3; ++c)
          colours.at(x, y, c) = behind + sphere->coverage.at(x, y) * (colours.at(x, y, c) - behind);
    pictures.push_back(std::move(colours));
    labels.push_back("Blue measured, orange not");
  }
  return labelledRow(pictures, labels);
}

}  // namespace patina
