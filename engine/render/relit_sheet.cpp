#include "engine/render/relit_sheet.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace patina {
namespace {

bool measured(const SvbrdfMaps& maps, float u, float v) {
  if (maps.status.empty()) return true;
  const int x = std::clamp(static_cast<int>(u * static_cast<float>(maps.width)), 0, maps.width - 1);
  const int y = std::clamp(static_cast<int>(v * static_cast<float>(maps.height)), 0, maps.height - 1);
  const auto status = static_cast<TexelStatus>(static_cast<int>(maps.status.at(x, y)));
  return status != TexelStatus::NotMeasured && status != TexelStatus::Failed;
}

}  // namespace

SvbrdfParameters parametersFromMaps(const SvbrdfMaps& maps, float u, float v) {
  const float fx =
      std::clamp(u * static_cast<float>(maps.width) - 0.5f, 0.0f, static_cast<float>(maps.width - 1));
  const float fy =
      std::clamp(v * static_cast<float>(maps.height) - 0.5f, 0.0f, static_cast<float>(maps.height - 1));
  const int x0 = static_cast<int>(fx), y0 = static_cast<int>(fy);
  const int x1 = std::min(x0 + 1, maps.width - 1), y1 = std::min(y0 + 1, maps.height - 1);
  const float tx = fx - static_cast<float>(x0), ty = fy - static_cast<float>(y0);
  const auto mix = [&](const Image& image, int c) {
    const float top = image.at(x0, y0, c) * (1 - tx) + image.at(x1, y0, c) * tx;
    const float bottom = image.at(x0, y1, c) * (1 - tx) + image.at(x1, y1, c) * tx;
    return top * (1 - ty) + bottom * ty;
  };
  SvbrdfParameters parameters;
  for (int c = 0; c < 3; ++c) {
    parameters.diffuse[c] = std::max(0.0f, mix(maps.diffuse, c));
    parameters.specular[c] = std::max(0.0f, mix(maps.specular, c));
    parameters.normal[c] = mix(maps.normal, c);
  }
  const float length = parameters.normal.norm();
  parameters.normal = length > 0 ? Eigen::Vector3f(parameters.normal / length) : Eigen::Vector3f::UnitZ();
  parameters.sigma = std::max(1e-4f, mix(maps.sigma, 0));
  parameters.kurtosis = std::max(1.0f, mix(maps.kurtosis, 0));
  return parameters;
}

Image relitSheet(const SvbrdfMaps& maps, const PointLight& light, const SheetView& view) {
  Image picture(std::max(1, view.width), std::max(1, view.height), 3, view.background);
  if (maps.width <= 0 || maps.height <= 0) return picture;
  const float halfW = 0.5f * static_cast<float>(maps.widthMm),
              halfH = 0.5f * static_cast<float>(maps.heightMm);
  const Eigen::Vector3f eye = view.eyeMm, forward = (-eye).normalized();
  const Eigen::Vector3f reference = std::abs(forward.z()) > 0.999f
                                        ? Eigen::Vector3f(Eigen::Vector3f::UnitY())
                                        : Eigen::Vector3f(Eigen::Vector3f::UnitZ());
  const Eigen::Vector3f right = forward.cross(reference).normalized(), up = right.cross(forward);
  // Frame the sheet: project its corners, then scale and shift the picture to hold them with a margin of 4 %.
  Eigen::Array2f low = Eigen::Array2f::Constant(std::numeric_limits<float>::max()), high = -low;
  for (float x : {-halfW, halfW})
    for (float y : {-halfH, halfH}) {
      const Eigen::Vector3f offset = Eigen::Vector3f(x, y, 0) - eye;
      const float depth = offset.dot(forward);
      if (depth <= 0) continue;
      const Eigen::Array2f at(offset.dot(right) / depth, offset.dot(up) / depth);
      low = low.min(at);
      high = high.max(at);
    }
  const Eigen::Array2f centre = 0.5f * (low + high), extent = high - low;
  const auto width = static_cast<float>(picture.width()), height = static_cast<float>(picture.height());
  const float perPixel = 1.08f * std::max(extent.x() / width, extent.y() / height);
  const int side = std::clamp(view.samplesPerPixelSide, 1, 8);

  tbb::parallel_for(0, picture.height(), [&](int py) {
    for (int px = 0; px < picture.width(); ++px) {
      Eigen::Array3f sum = Eigen::Array3f::Zero();
      for (int j = 0; j < side; ++j)
        for (int i = 0; i < side; ++i) {
          const float sx = (static_cast<float>(px) +
                            (static_cast<float>(i) + 0.5f) / static_cast<float>(side) - 0.5f * width);
          const float sy = (static_cast<float>(py) +
                            (static_cast<float>(j) + 0.5f) / static_cast<float>(side) - 0.5f * height);
          const Eigen::Vector3f ray =
              forward + (centre.x() + sx * perPixel) * right + (centre.y() - sy * perPixel) * up;
          Eigen::Array3f radiance = Eigen::Array3f::Constant(view.background);
          if (ray.z() < 0) {
            const Eigen::Vector3f point = eye - ray * (eye.z() / ray.z());
            const float u = 0.5f + 0.5f * point.x() / halfW, v = 0.5f - 0.5f * point.y() / halfH;
            if (u >= 0 && u <= 1 && v >= 0 && v <= 1 && measured(maps, u, v)) {
              const Eigen::Vector3f toLight = light.positionMm - point;
              const float distanceSquared =
                  std::max(1.0f, toLight.squaredNorm());  // a light in the sheet would blow up
              radiance = svbrdfBrdfTimesCos(toLight / std::sqrt(distanceSquared), (eye - point).normalized(),
                                            parametersFromMaps(maps, u, v)) *
                         light.intensity / distanceSquared;
            }
          }
          sum += radiance;
        }
      for (int c = 0; c < 3; ++c) picture.at(px, py, c) = sum[c] / static_cast<float>(side * side);
    }
  });
  return picture;
}

}  // namespace patina
