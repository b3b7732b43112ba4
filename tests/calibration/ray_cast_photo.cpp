#include "tests/calibration/ray_cast_photo.h"

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace patina::test {
namespace {

struct Ray {
  Eigen::Vector3d from, to;
};

/// Distance along the ray, or infinity; the brightness there.
double hit(const FlatPicture& flat, const Ray& ray, double* brightness) {
  const Eigen::Vector3d normal = flat.rotation.col(2);
  const double towards = normal.dot(ray.to);
  const double t = normal.dot(flat.originMm - ray.from) / towards;
  if (!(t > 1e-6)) return std::numeric_limits<double>::infinity();
  const Eigen::Vector3d at = flat.rotation.transpose() * (ray.from + t * ray.to - flat.originMm);
  const double x = (at.x() / flat.widthMm + 0.5) * flat.picture.width(),
               y = (0.5 - at.y() / flat.heightMm) * flat.picture.height();
  if (!(x >= 0 && y >= 0 && x < flat.picture.width() && y < flat.picture.height()))
    return std::numeric_limits<double>::infinity();
  if (flat.facesOnly && towards > 0) {
    *brightness = 0.02;
    return t;
  }
  // Between the middles of the picture's pixels: an edge is a ramp about its true place, so that few rays a
  // pixel don't make it jump.
  const Image& image = flat.picture;
  const double px = std::clamp(x - 0.5, 0.0, image.width() - 1.0),
               py = std::clamp(y - 0.5, 0.0, image.height() - 1.0);
  const int x0 = std::min(static_cast<int>(px), image.width() - 2),
            y0 = std::min(static_cast<int>(py), image.height() - 2);
  const double a = px - x0, b = py - y0;
  *brightness = (1 - b) * ((1 - a) * image.at(x0, y0) + a * image.at(x0 + 1, y0)) +
                b * ((1 - a) * image.at(x0, y0 + 1) + a * image.at(x0 + 1, y0 + 1));
  return t;
}

double nearest(const std::vector<FlatPicture>& pictures, const Ray& ray, double* brightness) {
  double best = std::numeric_limits<double>::infinity();
  for (const FlatPicture& flat : pictures) {
    double here = 0;
    const double t = hit(flat, ray, &here);
    if (t < best) best = t, *brightness = here;
  }
  return best;
}

}  // namespace

FlatPicture boardPicture(Board* board, int pixelsPerSquare, double marginSquares) {
  const int margin = static_cast<int>(std::lround(marginSquares * pixelsPerSquare));
  const Result<Image> drawn = drawBoardPixels(*board, pixelsPerSquare, margin);
  if (!drawn) {
    ADD_FAILURE() << drawn.error().sentence();
    return {};
  }
  FlatPicture flat;
  flat.picture = *drawn;
  for (float& v : flat.picture.samples()) v = v > 0.5f ? 0.8f : 0.04f;
  flat.widthMm = drawn->width() * board->squareMm / pixelsPerSquare;
  flat.heightMm = drawn->height() * board->squareMm / pixelsPerSquare;
  return flat;
}

Image rayCast(const Camera& camera, const std::vector<FlatPicture>& pictures,
              const std::optional<FlatMirror>& mirror, const RayCastOptions& options) {
  const int n = options.samplesPerSide;
  // The blur is sampled with the pixel: rays are spread over the pixel and, at random, by the lens' Gaussian.
  Image photo(camera.width, camera.height, 3);
  const Eigen::Matrix3d worldFromCamera = camera.cameraFromWorld.transpose();
  const Eigen::Vector3d from = -worldFromCamera * camera.translationMm;
  const double fx = camera.intrinsics(0, 0), fy = camera.intrinsics(1, 1), cx = camera.intrinsics(0, 2),
               cy = camera.intrinsics(1, 2);
  const auto& k = camera.distortion;
  Image sharp(camera.width * n, camera.height * n, 1);
  tbb::parallel_for(0, sharp.height(), [&](int row) {
    for (int column = 0; column < sharp.width(); ++column) {
      const double u = ((column + 0.5) / n - 0.5 - cx) / fx, v = ((row + 0.5) / n - 0.5 - cy) / fy;
      double x = u, y = v;
      for (int i = 0; i < 12; ++i) {
        const double r2 = x * x + y * y, radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
        const double dx = 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
                     dy = k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y;
        x = (u - dx) / radial, y = (v - dy) / radial;
      }
      const Ray ray{from, worldFromCamera * Eigen::Vector3d(x, y, 1)};
      double brightness = options.background;
      const double t = nearest(pictures, ray, &brightness);
      if (mirror) {
        const double tm = (mirror->heightMm - ray.from.z()) / ray.to.z();
        const Eigen::Vector3d at = ray.from + tm * ray.to;
        const bool inside = std::abs(at.x() - mirror->centreMm.x()) < mirror->sizeMm.x() / 2 &&
                            std::abs(at.y() - mirror->centreMm.y()) < mirror->sizeMm.y() / 2;
        if (tm > 0 && tm < t && inside) {
          brightness = options.background;
          nearest(pictures, {at, Eigen::Vector3d(ray.to.x(), ray.to.y(), -ray.to.z())}, &brightness);
          brightness *= mirror->reflectance;
        }
      }
      sharp.at(column, row) = static_cast<float>(brightness);
    }
  });
  // Gaussian blur over the fine picture, one direction after the other, then the mean over each pixel.
  const double sigma = std::max(options.blurPx * n, 1e-3);
  const int reach = static_cast<int>(std::ceil(3 * sigma));
  std::vector<double> weight(2 * reach + 1);
  double sum = 0;
  for (int i = -reach; i <= reach; ++i) sum += weight[i + reach] = std::exp(-0.5 * i * i / (sigma * sigma));
  Image across(camera.width, sharp.height(), 1);
  tbb::parallel_for(0, sharp.height(), [&](int row) {
    std::vector<double> line(sharp.width());
    for (int column = 0; column < sharp.width(); ++column) {
      double v = 0;
      for (int i = -reach; i <= reach; ++i)
        v += weight[i + reach] * sharp.at(std::clamp(column + i, 0, sharp.width() - 1), row);
      line[column] = v / sum;
    }
    for (int column = 0; column < camera.width; ++column) {
      double v = 0;
      for (int i = 0; i < n; ++i) v += line[column * n + i];
      across.at(column, row) = static_cast<float>(v / n);
    }
  });
  tbb::parallel_for(0, camera.height, [&](int row) {
    std::mt19937_64 random(options.seed * 1000003 + row);
    std::normal_distribution<double> normal(0, options.noise);
    for (int column = 0; column < camera.width; ++column) {
      double v = 0;
      for (int s = 0; s < n; ++s)
        for (int i = -reach; i <= reach; ++i)
          v += weight[i + reach] * across.at(column, std::clamp(row * n + s + i, 0, sharp.height() - 1));
      v = v / sum / n + normal(random);
      if (options.encoded) v = std::round(255 * std::pow(std::clamp(v, 0.0, 1.0), 1 / 2.2)) / 255;
      for (int c = 0; c < 3; ++c) photo.at(column, row, c) = static_cast<float>(v);
    }
  });
  return photo;
}

Camera lookAt(Camera lens, const Eigen::Vector3d& positionMm, const Eigen::Vector3d& targetMm,
              double rollDeg) {
  const Eigen::Vector3d forward = (targetMm - positionMm).normalized();
  const Eigen::Vector3d hint =
      std::abs(forward.y()) > 0.95 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitY();
  const Eigen::Vector3d right = forward.cross(hint).normalized(), down = forward.cross(right);
  Eigen::Matrix3d rotation;
  rotation << right.transpose(), down.transpose(), forward.transpose();
  lens.cameraFromWorld =
      Eigen::AngleAxisd(rollDeg * std::numbers::pi / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix() *
      rotation;
  lens.translationMm = -lens.cameraFromWorld * positionMm;
  return lens;
}

}  // namespace patina::test
