#pragma once

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>

#include "engine/brdf/tabulated_brdf.h"

namespace patina::test {

/// A BRDF from a formula of a test's own.
class FormulaBrdf : public Brdf {
 public:
  using Formula =
      std::function<Eigen::Array3d(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView)>;
  explicit FormulaBrdf(Formula formula) : Brdf({"formula", "test", "", ""}), formula_(std::move(formula)) {}
  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    if (toLight.z() < 0 || toView.z() < 0)
      return Eigen::Array3d::Constant(std::numeric_limits<double>::quiet_NaN());
    return formula_(toLight, toView);
  }

 private:
  Formula formula_;
};

inline std::shared_ptr<const TabulatedBrdf> tabulated(FormulaBrdf::Formula formula) {
  auto table = tabulate(FormulaBrdf(std::move(formula)));
  EXPECT_TRUE(table.ok());
  return *table;
}

inline std::shared_ptr<const TabulatedBrdf> lambert(double red, double green, double blue) {
  return tabulated([=](const auto&, const auto&) {
    return Eigen::Array3d(Eigen::Array3d(red, green, blue) / std::numbers::pi);
  });
}

/// A matt base under a normalised Blinn lobe: less light leaves it than arrives (base + lobe at most one).
inline std::shared_ptr<const TabulatedBrdf> glossy(const Eigen::Array3d& base, double lobe, double exponent) {
  return tabulated([=](const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) {
    const Eigen::Vector3d half = (toLight + toView).normalized();
    const double shape = (exponent + 2) / (8 * std::numbers::pi) *
                         std::pow(std::max(0.0, half.z()), exponent) /
                         std::max({toLight.z(), toView.z(), 0.05});
    return Eigen::Array3d(base / std::numbers::pi + lobe * shape);
  });
}

}  // namespace patina::test
