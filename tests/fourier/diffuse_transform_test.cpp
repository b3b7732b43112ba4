#include "engine/fourier/diffuse_transform.h"

#include <gtest/gtest.h>

#include <complex>
#include <numbers>

#include "tests/fourier/rig.h"

namespace patina::test {
namespace {

using Complex = std::complex<double>;

/// Lambertian radiance for albedo 1, by the midpoint rule over the lit rectangle.
Complex bruteForce(const Rig& rig, const Eigen::Vector3d& pointMm, const Eigen::Vector3d& n,
                   const Eigen::Vector2d& w) {
  constexpr int kSteps = 600;
  const Screen& screen = rig.screen;
  const double hx = screen.halfExtent().x(), hy = screen.halfExtent().y();
  const Eigen::Vector3d screenNormal = screen.worldFromScreen.col(2);
  const Eigen::Vector2d foot =
      (screen.worldFromScreen.leftCols<2>().transpose() * (pointMm - screen.originMm)) / screen.unitMm();
  Complex sum = 0;
  for (int j = 0; j < kSteps; ++j) {
    for (int i = 0; i < kSteps; ++i) {
      const Eigen::Vector2d x(hx * (2 * (i + 0.5) / kSteps - 1), hy * (2 * (j + 0.5) / kSteps - 1));
      const Eigen::Vector3d gap =
          (screen.originMm + screen.worldFromScreen * Eigen::Vector3d(x.x(), x.y(), 0) * screen.unitMm() -
           pointMm) /
          screen.unitMm();
      const double d2 = gap.squaredNorm(), height = -gap.dot(screenNormal);
      const Eigen::Array2d q =
          ((x - foot) / height - screen.emission->mean).array() / screen.emission->sigma.array();
      const Eigen::Array2d window = x.array() / screen.windowSigma.array();
      const double light =
          screen.emission->gain * std::exp(-0.5 * (q.square().sum() + window.square().sum()));
      sum += gap.dot(n) * height / (d2 * d2) / std::numbers::pi * light * std::polar(1.0, -w.dot(x));
    }
  }
  return sum * (2 * hx / kSteps) * (2 * hy / kSteps);
}

double worstError(DiffuseMethod method) {
  const Rig rig;
  const std::vector<Eigen::Vector2d> frequencies = {{0, 0},  {1, 0}, {0, -1}, {2, 2},
                                                    {3, -3}, {6, 0}, {20, 0}};
  const DiffuseTransform transform(rig.frame, {120, 120}, frequencies, method);
  double worst = 0;
  for (const Eigen::Vector2d& point :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(57, -41), Eigen::Vector2d(-60, 60)}) {
    const Eigen::Vector3d normal = Eigen::Vector3d(0.1, -0.15, 1).normalized(),
                          onScreen = rig.frame.screenFromWorld * normal;
    std::vector<float> v(frequencies.size() * 6);
    transform.at(point, v.data());
    const double dc = std::abs(bruteForce(rig, {point.x(), point.y(), 0}, normal, frequencies[0]));
    for (std::size_t f = 0; f < frequencies.size(); ++f) {
      Complex value = 0;
      for (int axis = 0; axis < 3; ++axis)
        value += onScreen[axis] * Complex(v[(f * 3 + axis) * 2], v[(f * 3 + axis) * 2 + 1]);
      worst = std::max(
          worst, std::abs(value - bruteForce(rig, {point.x(), point.y(), 0}, normal, frequencies[f])) / dc);
    }
  }
  return worst;
}

TEST(DiffuseTransform, QuadratureMatchesBruteForce) {
  // single precision of the table, and the midpoint rule's own error at 600 steps
  EXPECT_LT(worstError(DiffuseMethod::Quadrature), 2e-5);
}

TEST(DiffuseTransform, PaperMixtureIsWithinItsKnownError) {
  // three Gaussians for 1/D^4 and a screen without an end: 0.2 to 0.3 % by the paper's own fit
  EXPECT_LT(worstError(DiffuseMethod::PaperMixture), 6e-3);
}

TEST(DiffuseTransform, PointAndTableAgree) {
  const Rig rig;
  const std::vector<Eigen::Vector2d> frequencies = {{0, 0}, {1, 1}, {4, 0}};
  const DiffuseTransform table(rig.frame, {120, 80}, frequencies, DiffuseMethod::Quadrature);
  std::vector<float> interpolated(frequencies.size() * 6);
  table.at({33, -27}, interpolated.data());
  const auto exact = DiffuseTransform::atPoint(rig.frame, {33, -27}, frequencies, DiffuseMethod::Quadrature);
  for (std::size_t i = 0; i < exact.size(); ++i)
    EXPECT_NEAR(interpolated[i], exact[i], 2e-6 * std::abs(exact[4])) << i;
}

TEST(DiffuseTransform, APartAgreesWithTheWhole) {
  const Rig rig;
  std::vector<Eigen::Vector2d> frequencies = {{0, 0}};
  for (const int w : {1, 2, 3, 4, 6, 10, 20})
    for (const auto& direction : {Eigen::Vector2d(1, 0), Eigen::Vector2d(0, 1), Eigen::Vector2d(1, -1)})
      frequencies.push_back(w * direction);
  const Eigen::Vector2d size(120, 80);
  const DiffuseTransform whole(rig.frame, size, frequencies, DiffuseMethod::Quadrature);
  std::vector<float> a(frequencies.size() * 6), b(a.size());
  // From a sheet's whole row to a few pixels of it, in its middle and at its corner.
  for (const double share : {1.0, 0.3, 0.1, 0.05, 0.02, 0.004, 0.002, 0.0}) {
    for (const Eigen::Vector2d& corner : {Eigen::Vector2d(-60, -40), Eigen::Vector2d(5, 20)}) {
      const Eigen::Vector2d high = (corner + share * size).cwiseMin(size / 2), extent = high - corner;
      const DiffuseTransform part = whole.part(corner, high);
      for (const double u : {0.0, 0.13, 0.5, 0.77, 1.0}) {
        const Eigen::Vector2d at = corner + Eigen::Vector2d(u, 1 - u * u).cwiseProduct(extent);
        whole.at(at, a.data());
        part.at(at, b.data());
        for (std::size_t i = 0; i < a.size(); ++i)
          ASSERT_NEAR(b[i], a[i], 1e-6 * std::abs(a[4])) << share << " " << u << " " << i;
      }
    }
  }
}

}  // namespace
}  // namespace patina::test
