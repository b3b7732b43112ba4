#pragma once

#include <Eigen/Dense>
#include <random>

#include "engine/twoshot/basis.h"

namespace patina::test {

/// A small basis in double precision over made-up cells, its principal components by a plain SVD: what the
/// formulas of the paper are tried on literally. Direction i of `rows` is cell i: angles don't matter.
class DirectBasis : public Basis {
 public:
  /// `columns`: p x m mapped values.
  explicit DirectBasis(const Eigen::MatrixXd& columns) : mean_(columns.rowwise().mean()) {
    centred_ = columns.colwise() - mean_;
    const Eigen::BDCSVD<Eigen::MatrixXd> svd(centred_, Eigen::ComputeThinU | Eigen::ComputeThinV);
    Eigen::Index k = 0;
    while (k < svd.singularValues().size() && svd.singularValues()[k] > 1e-9 * svd.singularValues()[0]) ++k;
    singular_ = svd.singularValues().head(k);
    q_ = svd.matrixU().leftCols(k) * singular_.asDiagonal();
    coefficients_ = svd.matrixV().leftCols(k).transpose();
    gram_ = q_.transpose() * q_;
    root_ = singular_.asDiagonal();
    materials_.resize(columns.cols() / 3);
  }
  const Eigen::MatrixXd& q() const { return q_; }
  const Eigen::MatrixXd& centred() const { return centred_; }

  int componentCount() const override { return static_cast<int>(q_.cols()); }
  int columnCount() const override { return static_cast<int>(coefficients_.cols()); }
  std::size_t cellCount(BasisRegion) const override { return q_.rows(); }
  const std::vector<BasisMaterial>& materials() const override { return materials_; }
  const std::string& name() const override { return name_; }
  const std::string& source() const override { return name_; }
  std::uint64_t checksum() const override { return 0; }
  const Eigen::VectorXd& singularValues() const override { return singular_; }
  const Eigen::MatrixXd& columnCoefficients() const override { return coefficients_; }
  const Eigen::MatrixXd& gram(BasisRegion) const override { return gram_; }
  const Eigen::MatrixXd& gramRoot(BasisRegion) const override { return root_; }
  BasisRows rows(std::span<const HalfDiffAngles>, std::vector<int>*) const override { return {}; }
  std::shared_ptr<const TabulatedBrdf> reconstruct(const Eigen::MatrixXd&, BrdfOrigin,
                                                   const std::stop_token&) const override {
    return nullptr;
  }
  std::vector<float> posteriorSd(const Eigen::MatrixXd&, const Eigen::MatrixXd&, double,
                                 const std::stop_token&) const override {
    return {};
  }

  Eigen::MatrixXd rowsAt(const std::vector<int>& cells) const { return q_(cells, Eigen::all); }

  /// p x m values that look like mapped BRDFs: a few smooth modes with falling weight, and a little of
  /// everything.
  static Eigen::MatrixXd madeUpColumns(int cells, int columns, unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    Eigen::MatrixXd modes(cells, 12), weights(12, columns), rest(cells, columns);
    for (int j = 0; j < 12; ++j) {
      const double frequency = 1 + 2 * j + normal(random), phase = normal(random);
      for (int i = 0; i < cells; ++i) modes(i, j) = std::sin(frequency * i / cells * 3 + phase);
      for (int i = 0; i < columns; ++i) weights(j, i) = normal(random) * 3 / (1 + j);
    }
    for (int i = 0; i < rest.size(); ++i) rest.data()[i] = 0.05 * normal(random);
    return modes * weights + rest;
  }

 private:
  Eigen::VectorXd mean_, singular_;
  Eigen::MatrixXd centred_, q_, coefficients_, gram_, root_;
  std::vector<BasisMaterial> materials_;
  std::string name_ = "direct";
};

}  // namespace patina::test
