#include "tests/results/truth_compare.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "engine/image/exr.h"

namespace patina::test {
namespace {

// Steps between neighbouring texels, relative, that only a border between materials makes. Inside a material
// of the test bundles sigma changes by up to 0.03 a texel, and gamma not at all.
constexpr float kSigmaStep = 0.1f;
constexpr float kKurtosisStep = 0.005f;

Result<Image> readMap(const std::filesystem::path& file, int channels) {
  const std::vector<std::string> colour{"R", "G", "B"}, vector{"X", "Y", "Z"}, single{"Y"};
  if (channels == 1) return readExr(file, single);
  Result<std::vector<std::string>> names = exrChannels(file);
  if (!names) return names.error();
  const bool isVector = std::find(names->begin(), names->end(), "X") != names->end();
  return readExr(file, isVector ? vector : colour);
}

// Linear interpolation; coordinates are texels of the image, centres at integers, clamped to the image.
double sampleLinear(const Image& image, double x, double y, int channel) {
  x = std::clamp(x, 0.0, image.width() - 1.0);
  y = std::clamp(y, 0.0, image.height() - 1.0);
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, image.width() - 1), y1 = std::min(y0 + 1, image.height() - 1);
  const double fx = x - x0, fy = y - y0;
  const auto at = [&](int i, int j) { return static_cast<double>(image.at(i, j, channel)); };
  return (1 - fy) * ((1 - fx) * at(x0, y0) + fx * at(x1, y0)) +
         fy * ((1 - fx) * at(x0, y1) + fx * at(x1, y1));
}

bool steps(float a, float b, float allowed) {
  return std::abs(a - b) > allowed * std::min(a, b);
}

// Whether two neighbouring truth texels between (x, y) - reach and (x, y) + reach are of different materials.
bool nearOtherMaterial(const TruthMaps& truth, double x, double y, double reach) {
  const int x0 = std::max(0, static_cast<int>(std::floor(x - reach)));
  const int x1 = std::min(truth.sigma.width() - 1, static_cast<int>(std::ceil(x + reach)));
  const int y0 = std::max(0, static_cast<int>(std::floor(y - reach)));
  const int y1 = std::min(truth.sigma.height() - 1, static_cast<int>(std::ceil(y + reach)));
  const auto differ = [&](int i, int j, int k, int l) {
    return steps(truth.sigma.at(i, j), truth.sigma.at(k, l), kSigmaStep) ||
           steps(truth.kurtosis.at(i, j), truth.kurtosis.at(k, l), kKurtosisStep);
  };
  for (int j = y0; j <= y1; ++j) {
    for (int i = x0; i <= x1; ++i) {
      if (i < x1 && differ(i, j, i + 1, j)) return true;
      if (j < y1 && differ(i, j, i, j + 1)) return true;
    }
  }
  return false;
}

double relativeError(double fitted, double truth) {
  return std::abs(fitted - truth) / std::abs(truth);
}

double colourError(std::span<const float> fitted, const std::array<double, 3>& truth) {
  double difference = 0, sum = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    difference += std::abs(fitted[c] - truth[c]);
    sum += std::abs(truth[c]);
  }
  return difference / sum;
}

ErrorSpread spreadOf(const std::vector<double>& errors) {
  return {percentile(errors, 0.5), percentile(errors, 0.95)};
}

}  // namespace

double percentile(std::vector<double> values, double p) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const double rank = p * static_cast<double>(values.size() - 1);
  const std::size_t below = static_cast<std::size_t>(rank), above = std::min(below + 1, values.size() - 1);
  return values[below] + (rank - static_cast<double>(below)) * (values[above] - values[below]);
}

Result<TruthMaps> readTruth(const std::filesystem::path& bundle) {
  TruthMaps truth;
  const std::array<std::tuple<const char*, int, Image*>, 5> files{{{"diffuse", 3, &truth.diffuse},
                                                                   {"specular", 3, &truth.specular},
                                                                   {"normal", 3, &truth.normal},
                                                                   {"roughness", 1, &truth.sigma},
                                                                   {"kurtosis", 1, &truth.kurtosis}}};
  for (const auto& [name, channels, target] : files) {
    const std::filesystem::path file = bundle / "truth" / (std::string(name) + ".exr");
    Result<Image> image = readMap(file, channels);
    if (!image) return image.error();
    *target = std::move(*image);
    if (target->width() != truth.diffuse.width() || target->height() != truth.diffuse.height()) {
      return Error{ErrorCode::Invalid, "The truth maps differ in size", file.string(),
                   "make the bundle again"};
    }
  }
  return truth;
}

TruthErrors compareWithTruth(const SvbrdfMaps& fitted, const TruthMaps& truth, double edgeTexels) {
  TruthErrors errors;
  std::vector<double> diffuse, diffuseAbsolute, specular, sigma, kurtosis, normalDeg;
  const double scaleX = static_cast<double>(truth.sigma.width()) / fitted.width;
  const double scaleY = static_cast<double>(truth.sigma.height()) / fitted.height;
  const double reach = edgeTexels * std::max(scaleX, scaleY);
  for (int j = 0; j < fitted.height; ++j) {
    for (int i = 0; i < fitted.width; ++i) {
      const auto status = static_cast<TexelStatus>(std::lround(fitted.status.at(i, j)));
      if (status != TexelStatus::Converged && status != TexelStatus::IterationLimit) {
        ++errors.notMeasured;
        continue;
      }
      const double x = (i + 0.5) * scaleX - 0.5, y = (j + 0.5) * scaleY - 0.5;
      if (nearOtherMaterial(truth, x, y, reach)) {
        ++errors.onEdge;
        continue;
      }
      const auto colour = [&](const Image& map) {
        return std::array<double, 3>{sampleLinear(map, x, y, 0), sampleLinear(map, x, y, 1),
                                     sampleLinear(map, x, y, 2)};
      };
      const auto trueDiffuse = colour(truth.diffuse);
      double difference = 0;
      for (std::size_t c = 0; c < 3; ++c)
        difference += std::abs(fitted.diffuse.pixel(i, j)[c] - trueDiffuse[c]) / 3;
      diffuseAbsolute.push_back(difference);
      diffuse.push_back(colourError(fitted.diffuse.pixel(i, j), trueDiffuse));
      specular.push_back(colourError(fitted.specular.pixel(i, j), colour(truth.specular)));
      sigma.push_back(relativeError(fitted.sigma.at(i, j), sampleLinear(truth.sigma, x, y, 0)));
      kurtosis.push_back(relativeError(fitted.kurtosis.at(i, j), sampleLinear(truth.kurtosis, x, y, 0)));
      const std::array<double, 3> n = colour(truth.normal);
      const Eigen::Vector3d trueNormal = Eigen::Vector3d(n[0], n[1], n[2]).normalized();
      const auto f = fitted.normal.pixel(i, j);
      const Eigen::Vector3d fittedNormal = Eigen::Vector3d(f[0], f[1], f[2]).normalized();
      // atan2 instead of acos: acos loses all digits at the small angles that matter here.
      const double angleRad = std::atan2(trueNormal.cross(fittedNormal).norm(), trueNormal.dot(fittedNormal));
      normalDeg.push_back(angleRad * 180.0 / std::numbers::pi);
    }
  }
  errors.compared = sigma.size();
  errors.diffuse = spreadOf(diffuse);
  errors.diffuseAbsolute = spreadOf(diffuseAbsolute);
  errors.specular = spreadOf(specular);
  errors.sigma = spreadOf(sigma);
  errors.kurtosis = spreadOf(kurtosis);
  errors.normalDeg = spreadOf(normalDeg);
  return errors;
}

}  // namespace patina::test
