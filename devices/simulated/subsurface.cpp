#include "devices/simulated/subsurface.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>

namespace patina {

namespace {
constexpr double kReach = 6;  ///< of l: 1.7 % of the light goes farther; the weights are made to sum to one
}

Subsurface::Subsurface(const Camera& camera, double meanRadiusMm, int patterns, int side)
    : width_(camera.width),
      height_(camera.height),
      lengthMm_(0.5 * meanRadiusMm),
      share_(1.0f / static_cast<float>(side * side)),
      light_(Eigen::MatrixXf::Zero(patterns, static_cast<Eigen::Index>(width_) * height_)),
      root_(Eigen::Matrix3Xf::Zero(3, light_.cols())),
      albedo_(Eigen::Matrix3Xf::Zero(3, light_.cols())),
      at_(2, light_.cols()) {
  const auto place = [&](double x, double y) -> Eigen::Vector2d {
    if (const auto point = camera.samplePlaneFromPixel({x, y})) return point->head<2>();
    return Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  };
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      at_.col(y * width_ + x) = place(x, y);
      Eigen::Matrix2d& pixel = pixel_.emplace_back();
      pixel << place(x + 0.5, y) - place(x - 0.5, y), place(x, y + 0.5) - place(x, y - 0.5);
    }
}

void Subsurface::add(int x, int y, const SheetPoint& material,
                     const Eigen::Ref<const Eigen::VectorXf>& response) {
  const Eigen::Index pixel = static_cast<Eigen::Index>(y) * width_ + x;
  light_.col(pixel) += share_ * response.head(light_.rows());
  root_.col(pixel) += share_ * material.diffuse.sqrt().cast<float>().matrix();
  albedo_.col(pixel) += share_ * material.diffuse.cast<float>().matrix();
}

Eigen::ArrayX3f Subsurface::change(int x, int y) const {
  const Eigen::Index here = static_cast<Eigen::Index>(y) * width_ + x;
  Eigen::ArrayX3f scattered = Eigen::ArrayX3f::Zero(light_.rows(), 3);
  double total = 0;
  for (Eigen::Index from = 0; from < light_.cols(); ++from) {
    const Eigen::Vector2d offset = at_.col(from) - at_.col(here);
    if (!(offset.norm() <= kReach * lengthMm_) && from != here) continue;
    const Eigen::Matrix2d& pixel = pixel_[static_cast<std::size_t>(from)];
    double weight = 0;
    // A grid that is even in the pixel and misses its centre, where the profile has its cusp.
    constexpr int kSide = 4;
    for (int j = 0; j < kSide; ++j)
      for (int i = 0; i < kSide; ++i) {
        const Eigen::Vector2d inPixel((i + 0.5) / kSide - 0.5, (j + 0.5) / kSide - 0.5);
        weight += std::exp(-(offset + pixel * inPixel).norm() / lengthMm_);
      }
    weight *= std::abs(pixel.determinant());
    total += weight;
    for (int c = 0; c < 3; ++c)
      scattered.col(c) += static_cast<float>(weight) * root_(c, from) * light_.col(from).array();
  }
  for (int c = 0; c < 3; ++c)
    scattered.col(c) = scattered.col(c) * (root_(c, here) / static_cast<float>(total)) -
                       albedo_(c, here) * light_.col(here).array();
  return scattered;
}

}  // namespace patina
