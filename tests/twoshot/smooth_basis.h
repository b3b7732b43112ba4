#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <cmath>
#include <random>

#include "engine/brdf/merl_grid.h"
#include "engine/twoshot/basis.h"

namespace patina::test {

/// A small basis whose rows are smooth functions of the angles, a highlight and Fresnel-like ones among them:
/// quick to search, and with an optimum worth finding. Its Gram matrices are those of a subset of the grid.
class SmoothBasis : public Basis {
 public:
  static constexpr int kFunctions = 14, kMaterialCount = 12, kColumns = 3 * kMaterialCount;

  explicit SmoothBasis(unsigned seed = 3) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    Eigen::MatrixXd mix(kFunctions, kColumns);
    // Materials differ most in the highlight and least in the finer functions.
    for (int j = 0; j < kFunctions; ++j)
      for (int i = 0; i < kColumns; ++i) mix(j, i) = normal(random) * 2 / (1 + 0.3 * j);
    mix.colwise() -= mix.rowwise().mean().eval();
    std::vector<Eigen::VectorXd> all, trusted;
    const double lowest = std::cos(kTrustedAngleDeg * kDegree);
    for (int h = 0; h < 90; h += 4)
      for (int d = 0; d < 90; d += 4)
        for (int p = 0; p < 180; p += 9) {
          const HalfDiffAngles angles = MerlGrid::centre(h, d, p);
          const DirectionPair pair = directionsFromHalfDiff(angles);
          if (pair.toLight.z() <= 0 || pair.toView.z() <= 0) continue;
          all.push_back(functions(angles));
          if (pair.toLight.z() >= lowest && pair.toView.z() >= lowest) trusted.push_back(all.back());
        }
    cells_[0] = all.size();
    cells_[1] = trusted.size();
    Eigen::MatrixXd columns(static_cast<Eigen::Index>(all.size()), kColumns);
    for (std::size_t i = 0; i < all.size(); ++i)
      columns.row(static_cast<Eigen::Index>(i)) = all[i].transpose() * mix;
    const Eigen::BDCSVD<Eigen::MatrixXd> svd(columns, Eigen::ComputeThinV);
    sigma_ = svd.singularValues().head(kFunctions);
    const Eigen::MatrixXd v = svd.matrixV().leftCols(kFunctions);
    coefficients_ = v.transpose();
    toRow_ = mix * v;
    gram_[0] = sigma_.array().square().matrix().asDiagonal();
    root_[0] = sigma_.asDiagonal();
    gram_[1] = Eigen::MatrixXd::Zero(kFunctions, kFunctions);
    for (const Eigen::VectorXd& row : trusted) {
      const Eigen::VectorXd q = toRow_.transpose() * row;
      gram_[1] += q * q.transpose();
    }
    root_[1] = Eigen::MatrixXd(Eigen::LLT<Eigen::MatrixXd>(gram_[1]).matrixU());
    for (int i = 0; i < kMaterialCount; ++i)
      materials_.push_back({"material <" + std::to_string(i) + ">", "test", "", 0, 0});
  }

  int componentCount() const override { return kFunctions; }
  int columnCount() const override { return kColumns; }
  std::size_t cellCount(BasisRegion region) const override { return cells_[region == BasisRegion::Trusted]; }
  const std::vector<BasisMaterial>& materials() const override { return materials_; }
  const std::string& name() const override { return name_; }
  const std::string& source() const override { return name_; }
  std::uint64_t checksum() const override { return 1; }
  const Eigen::VectorXd& singularValues() const override { return sigma_; }
  const Eigen::MatrixXd& columnCoefficients() const override { return coefficients_; }
  const Eigen::MatrixXd& gram(BasisRegion region) const override {
    return gram_[region == BasisRegion::Trusted];
  }
  const Eigen::MatrixXd& gramRoot(BasisRegion region) const override {
    return root_[region == BasisRegion::Trusted];
  }
  BasisRows rows(std::span<const HalfDiffAngles> angles, std::vector<int>* kept) const override {
    BasisRows rows;
    const auto n = static_cast<Eigen::Index>(angles.size());
    rows.components.resize(n, kFunctions);
    rows.mean = rows.lnReference = Eigen::VectorXd::Zero(n);
    rows.weight = Eigen::VectorXd::Ones(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      rows.components.row(i) = functions(angles[static_cast<std::size_t>(i)]).transpose() * toRow_;
      if (kept) kept->push_back(static_cast<int>(i));
    }
    return rows;
  }
  std::shared_ptr<const TabulatedBrdf> reconstruct(const Eigen::MatrixXd&, BrdfOrigin,
                                                   const std::stop_token&) const override {
    return nullptr;
  }
  std::vector<float> posteriorSd(const Eigen::MatrixXd&, const Eigen::MatrixXd&, double,
                                 const std::stop_token&) const override {
    return {};
  }

 private:
  static constexpr double kDegree = 3.14159265358979323846 / 180;

  static Eigen::VectorXd functions(const HalfDiffAngles& angles) {
    const double h = angles.thetaHRad, d = angles.thetaDRad, p = angles.phiDRad;
    const auto lobe = [&](double widthDeg) { return std::exp(-std::pow(h / (widthDeg * kDegree), 2)); };
    Eigen::VectorXd f(kFunctions);
    f << 1, lobe(30), lobe(12), lobe(6), std::cos(d), std::pow(1 - std::cos(d), 4), std::cos(h),
        std::sin(h) * std::cos(2 * p) * std::sin(d), lobe(30) * std::sin(d),
        lobe(12) * std::pow(std::sin(d), 3), std::cos(3 * d), std::cos(3 * h),
        std::cos(2 * d) * std::cos(2 * h), std::sin(2 * d) * std::cos(2 * p);
    return f;
  }

  std::string name_ = "smooth & small";
  std::size_t cells_[2] = {0, 0};
  std::vector<BasisMaterial> materials_;
  Eigen::VectorXd sigma_;
  Eigen::MatrixXd coefficients_, toRow_, gram_[2], root_[2];
};

}  // namespace patina::test
