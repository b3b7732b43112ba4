#include "engine/render/environment.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "engine/image/exr.h"
#include "engine/render/quick_atan.h"

namespace patina {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;

/// Part of the samples that goes to the whole sphere evenly, whatever the picture shows: keeps the density
/// away from zero, where a sample's weight would be without bound.
constexpr double kEvenPart = 0.02;

double luminance(std::span<const float> pixel) {
  return 0.2126 * pixel[0] + 0.7152 * pixel[1] + 0.0722 * pixel[2];
}

/// The direction at a place of the table, u and v in 0 to 1.
Eigen::Vector3f directionAt(float u, float v) {
  const float turn = (u - 0.5f) * 2 * kPi, fromUp = v * kPi, r = std::sin(fromUp);
  return {r * std::sin(turn), std::cos(fromUp), -r * std::cos(turn)};
}

/// The average of each block of a larger picture, edges of blocks cut where they fall.
Image averagedTo(const Image& from, int width, int height) {
  Image to(width, height, 3);
  tbb::parallel_for(0, height, [&](int y) {
    const double y0 = static_cast<double>(y) * from.height() / height,
                 y1 = static_cast<double>(y + 1) * from.height() / height;
    for (int x = 0; x < width; ++x) {
      const double x0 = static_cast<double>(x) * from.width() / width,
                   x1 = static_cast<double>(x + 1) * from.width() / width;
      std::array<double, 3> sum{};
      double area = 0;
      for (int j = static_cast<int>(y0); j < std::min(from.height(), static_cast<int>(std::ceil(y1))); ++j)
        for (int i = static_cast<int>(x0); i < std::min(from.width(), static_cast<int>(std::ceil(x1))); ++i) {
          const double part = (std::min(y1, j + 1.0) - std::max(y0, 1.0 * j)) *
                              (std::min(x1, i + 1.0) - std::max(x0, 1.0 * i));
          area += part;
          for (int c = 0; c < 3; ++c) sum[static_cast<std::size_t>(c)] += part * from.at(i, j, c);
        }
      for (int c = 0; c < 3; ++c)
        to.at(x, y, c) = static_cast<float>(sum[static_cast<std::size_t>(c)] / std::max(area, 1e-12));
    }
  });
  return to;
}

using Nine = Eigen::Array<double, 9, 1>;
Nine harmonicsAt(const Eigen::Vector3d& d) {
  Nine y;
  y << 0.282095, 0.488603 * d.y(), 0.488603 * d.z(), 0.488603 * d.x(), 1.092548 * d.x() * d.y(),
      1.092548 * d.y() * d.z(), 0.315392 * (3 * d.z() * d.z() - 1), 1.092548 * d.x() * d.z(),
      0.546274 * (d.x() * d.x() - d.y() * d.y());
  return y;
}

}  // namespace

Environment::Environment(std::string id, std::string name, const Image& latLong)
    : id_(std::move(id)), name_(std::move(name)) {
  if (latLong.channels() != 3 || latLong.width() < 2 || latLong.height() < 2)
    throw std::invalid_argument("an environment needs three channels and at least 2 x 2 pixels");
  for (const float value : latLong.samples())
    if (!std::isfinite(value) || value < 0)
      throw std::invalid_argument("an environment needs finite values that are not negative");
  picture_ = latLong.width() > kWidth ? averagedTo(latLong, kWidth, kHeight) : latLong;

  double all = 0, up = 0, solidAngle = 0;
  for (int y = 0; y < picture_.height(); ++y) {
    const float fromUp = (static_cast<float>(y) + 0.5f) / static_cast<float>(picture_.height()) * kPi;
    const double ring = std::sin(fromUp), cosine = std::max(0.0f, std::cos(fromUp));
    for (int x = 0; x < picture_.width(); ++x) {
      const double light = ring * luminance(picture_.pixel(x, y));
      all += light;
      up += light * cosine;
    }
    solidAngle += ring * picture_.width();
  }
  if (!(all > 0)) throw std::invalid_argument("an environment needs some light");
  const double mean = all / solidAngle, overPi = 4 * up / solidAngle;
  scale_ = 1 / (overPi > 0.01 * mean ? overPi : mean);
  for (float& value : picture_.samples()) value *= static_cast<float>(scale_);
  prepareSampling();
  prepareIrradiance();
}

Eigen::Vector2f Environment::place(const Eigen::Vector3f& direction) const {
  const float turn = quickAtan2(direction.x(), -direction.z());
  const float across = std::sqrt(direction.x() * direction.x() + direction.z() * direction.z());
  return {(turn / (2 * kPi) + 0.5f) * static_cast<float>(picture_.width()),
          quickAtan2(across, direction.y()) / kPi * static_cast<float>(picture_.height())};
}

Environment::Seen Environment::look(const Eigen::Vector3f& direction) const {
  const Eigen::Vector2f corner = place(direction), at = corner.array() - 0.5f;
  const int width = picture_.width(), height = picture_.height();
  const int x0 = static_cast<int>(std::floor(at.x())), y0 = static_cast<int>(std::floor(at.y()));
  const float fx = at.x() - static_cast<float>(x0), fy = at.y() - static_cast<float>(y0);
  const int left = x0 < 0 ? x0 + width : x0, right = x0 + 1 >= width ? x0 + 1 - width : x0 + 1;
  const int above = std::clamp(y0, 0, height - 1), below = std::clamp(y0 + 1, 0, height - 1);
  const auto value = [&](int x, int y) {
    return Eigen::Map<const Eigen::Array3f>(picture_.pixel(x, y).data());
  };
  Seen seen;
  seen.radiance = (1 - fy) * ((1 - fx) * value(left, above) + fx * value(right, above)) +
                  fy * ((1 - fx) * value(left, below) + fx * value(right, below));
  seen.density = texelDensity(std::clamp(static_cast<int>(corner.x()), 0, width - 1),
                              std::clamp(static_cast<int>(corner.y()), 0, height - 1),
                              std::sqrt(direction.x() * direction.x() + direction.z() * direction.z()));
  return seen;
}

float Environment::texelDensity(int x, int y, float sinFromUp) const {
  const std::size_t texel = static_cast<std::size_t>(y) * picture_.width() + x;
  // A texel is 2 pi / width by pi / height, its solid angle that times the sine; at the poles' rows the sine
  // stays that of half a row.
  const float least = 0.5f * kPi / static_cast<float>(picture_.height());
  return chance_[texel] * static_cast<float>(picture_.pixelCount()) /
         (2 * kPi * kPi * std::max(sinFromUp, least));
}

void Environment::prepareSampling() {
  const int width = picture_.width(), height = picture_.height();
  std::vector<double> weight(picture_.pixelCount());
  double total = 0, even = 0;
  for (int y = 0; y < height; ++y) {
    const double ring = std::sin((y + 0.5) / height * std::numbers::pi);
    const int above = std::max(0, y - 1), below = std::min(height - 1, y + 1);
    for (int x = 0; x < width; ++x) {
      // Bilinear look-up carries light up to a texel over its edges and corners: the neighbours count, or a
      // sun's fringe would be chosen too rarely for its brightness.
      const int left = (x + width - 1) % width, right = (x + 1) % width;
      double light = 0;
      for (const auto& [row, part] : {std::pair(above, 0.25), std::pair(y, 0.5), std::pair(below, 0.25)})
        light +=
            part * (0.25 * luminance(picture_.pixel(left, row)) + 0.5 * luminance(picture_.pixel(x, row)) +
                    0.25 * luminance(picture_.pixel(right, row)));
      weight[static_cast<std::size_t>(y) * width + x] = light * ring;
      total += light * ring;
      even += ring;
    }
  }
  std::vector<double> rows(static_cast<std::size_t>(height) + 1, 0.0), columns(weight.size() + height, 0.0);
  chance_.resize(weight.size());
  for (int y = 0; y < height; ++y) {
    const double ring = std::sin((y + 0.5) / height * std::numbers::pi);
    const std::size_t line = static_cast<std::size_t>(y) * width;
    double* sums = columns.data() + static_cast<std::size_t>(y) * (width + 1);
    for (int x = 0; x < width; ++x) {
      const double chance = (1 - kEvenPart) * weight[line + x] / total + kEvenPart * ring / even;
      chance_[line + x] = static_cast<float>(chance);
      sums[x + 1] = sums[x] + chance;
    }
    rows[static_cast<std::size_t>(y) + 1] = rows[static_cast<std::size_t>(y)] + sums[width];
  }

  samples_.resize(kSamples);
  tbb::parallel_for(0, kSamples, [&](int s) {
    // Source: the plastic number's additive recurrence, evenly spread over every stretch of it.
    const double u = std::fmod(0.5 + 0.7548776662466927 * s, 1.0),
                 v = std::fmod(0.5 + 0.5698402909980532 * s, 1.0);
    const auto find = [](const double* sums, int count, double part, double& inside) {
      const double wanted = part * sums[count];
      const auto above = std::upper_bound(sums + 1, sums + count, wanted);
      const int index = static_cast<int>(above - sums) - 1;
      inside = std::clamp((wanted - sums[index]) / std::max(sums[index + 1] - sums[index], 1e-300), 0.0, 1.0);
      return index;
    };
    double insideRow = 0, insideColumn = 0;
    const int y = find(rows.data(), height, v, insideRow);
    const int x = find(columns.data() + static_cast<std::size_t>(y) * (width + 1), width, u, insideColumn);
    Sample& sample = samples_[static_cast<std::size_t>(s)];
    const float fromUp = static_cast<float>((y + insideRow) / height);
    sample.direction = directionAt(static_cast<float>((x + insideColumn) / width), fromUp).normalized();
    sample.density = texelDensity(x, y, std::sin(fromUp * kPi));
    sample.radiance = radiance(sample.direction);
  });
}

void Environment::prepareIrradiance() {
  // Over blocks of the picture: nine smooth functions don't need every texel.
  const int width = std::min(128, picture_.width()), height = std::min(64, picture_.height());
  const Image coarse = averagedTo(picture_, width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const float v = (static_cast<float>(y) + 0.5f) / static_cast<float>(height);
      const Eigen::Vector3d direction =
          directionAt((static_cast<float>(x) + 0.5f) / static_cast<float>(width), v).cast<double>();
      const double solidAngle =
          2 * kPi / width *
          (std::cos(y * std::numbers::pi / height) - std::cos((y + 1) * std::numbers::pi / height));
      for (int c = 0; c < 3; ++c)
        harmonics_.col(c) += harmonicsAt(direction) * (solidAngle * coarse.at(x, y, c));
    }
  // Lambert's cosine damps the orders by pi, 2 pi / 3, pi / 4; over pi.
  harmonics_.middleRows<3>(1) *= 2.0 / 3;
  harmonics_.middleRows<5>(4) *= 0.25;
}

Eigen::Array3d Environment::irradianceOverPi(const Eigen::Vector3d& normal) const {
  const Nine at = harmonicsAt(normal);
  Eigen::Array3d sum;
  for (int c = 0; c < 3; ++c) sum[c] = (harmonics_.col(c) * at).sum();
  return sum.max(0.0);
}

Result<EnvironmentPtr> loadEnvironment(const std::filesystem::path& file) {
  auto read = readExr(file, {"R", "G", "B"});
  if (!read) return read.error();
  Image picture = std::move(*read);
  const std::string shape = "Use a latitude-longitude picture of the whole sphere, twice as wide as high";
  if (picture.height() < 8 || std::abs(picture.width() - 2.0 * picture.height()) > 0.01 * picture.width())
    return Error{ErrorCode::Invalid,
                 "The picture is " + std::to_string(picture.width()) + " x " +
                     std::to_string(picture.height()) + " pixels, which is not a view of the whole sphere",
                 file.string(), shape};
  if (const Status finite = requireFinite(picture, file.string()); !finite) return finite.error();
  bool lit = false;
  for (float& value : picture.samples()) {
    value = std::max(value, 0.0f);
    lit = lit || value > 0;
  }
  if (!lit)
    return Error{ErrorCode::Invalid, "The picture is black: there is no light in it", file.string(), shape};
  return EnvironmentPtr(std::make_shared<Environment>("file", file.stem().string(), picture));
}

}  // namespace patina
