#include "engine/twoshot/basis_subset.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include "engine/base/dense.h"

namespace patina {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

class SubsetBasis : public Basis {
 public:
  SubsetBasis(BasisPtr whole, const std::vector<int>& left) : whole_(std::move(whole)) {
    const std::set<int> without(left.begin(), left.end());
    const auto count = static_cast<int>(whole_->materials().size());
    if (!without.empty() && (*without.begin() < 0 || *without.rbegin() >= count)) {
      throw std::invalid_argument("basisWithout: no such material");
    }
    const auto kept = count - static_cast<int>(without.size());
    if (kept < 2) throw std::invalid_argument("basisWithout: fewer than two materials are left");
    const MatrixXd& all = whole_->columnCoefficients();
    MatrixXd columns(all.rows(), 3 * kept);
    for (int i = 0; i < count; ++i) {
      if (without.contains(i)) continue;
      columns.middleCols(3 * static_cast<Index>(materials_.size()), 3) = all.middleCols(3 * i, 3);
      materials_.push_back(whole_->materials()[i]);
    }
    shift_ = columns.rowwise().mean();
    columns.colwise() -= shift_;
    // Q D = V (Sigma D) = (V U) S W^T: the others' own decomposition, with Q' = Q Sigma^-1 U S.
    const VectorXd& sigma = whole_->singularValues();
    const MatrixXd turned = sigma.asDiagonal() * columns;
    // By the smaller Gram matrix, whose rounding (1e-16 of the largest value's square) leaves seven digits of
    // the smallest singular value that a file keeps.
    const SymmetricEigen eigen = eigenOfSymmetric(gramOfColumns(turned));
    const VectorXd values = eigen.values.reverse();
    Index k = 0;
    // The mean was taken out: one value is zero to rounding.
    while (k < std::min<Index>(values.size() - 1, turned.rows()) && values[k] > 1e-14 * values[0]) ++k;
    singular_ = values.head(k).cwiseSqrt();
    const MatrixXd v = eigen.vectors.rowwise().reverse().leftCols(k);
    coefficients_ = v.transpose();
    // U S = (Sigma D) W.
    turn_ = sigma.cwiseInverse().asDiagonal() * product(turned, false, v, false);
    gram_[0] = singular_.array().square().matrix().asDiagonal();
    root_[0] = singular_.asDiagonal();
    root_[1] = product(whole_->gramRoot(BasisRegion::Trusted), false, turn_, false);
    gram_[1] = gramOfColumns(root_[1]);
  }

  const MatrixXd& turn() const { return turn_; }
  const VectorXd& shift() const { return shift_; }

  int componentCount() const override { return static_cast<int>(singular_.size()); }
  int columnCount() const override { return static_cast<int>(coefficients_.cols()); }
  std::size_t cellCount(BasisRegion region) const override { return whole_->cellCount(region); }
  const std::vector<BasisMaterial>& materials() const override { return materials_; }
  const std::string& name() const override { return whole_->name(); }
  const std::string& source() const override { return whole_->source(); }
  std::uint64_t checksum() const override { return whole_->checksum(); }
  const VectorXd& singularValues() const override { return singular_; }
  const MatrixXd& columnCoefficients() const override { return coefficients_; }
  const MatrixXd& gram(BasisRegion region) const override { return gram_[region == BasisRegion::Trusted]; }
  const MatrixXd& gramRoot(BasisRegion region) const override {
    return root_[region == BasisRegion::Trusted];
  }

  BasisRows rows(std::span<const HalfDiffAngles> angles, std::vector<int>* kept) const override {
    BasisRows rows = whole_->rows(angles, kept);
    rows.mean += rows.components * shift_;
    rows.components = product(rows.components, false, turn_, false);
    return rows;
  }

  std::shared_ptr<const TabulatedBrdf> reconstruct(const MatrixXd& c, BrdfOrigin origin,
                                                   const std::stop_token& stop) const override {
    const MatrixXd whole = (turn_ * c).colwise() + shift_;
    return whole_->reconstruct(whole, std::move(origin), stop);
  }

  std::vector<float> posteriorSd(const MatrixXd& b, const MatrixXd& w, double scale,
                                 const std::stop_token& stop) const override {
    // q' = T^T q: T (I - B^T W B) T^T = I - N with N = I - T T^T + T B^T W B T^T, which is positive.
    const MatrixXd turned = product(b, false, turn_, true);  // B T^T
    MatrixXd missing = MatrixXd::Identity(turn_.rows(), turn_.rows()) - product(turn_, false, turn_, true);
    if (b.rows() > 0) missing += turned.transpose() * w * turned;
    const SymmetricEigen eigen = eigenOfSymmetric(missing);
    Index small = 0;
    while (small < missing.rows() && eigen.values[small] < 1e-9) ++small;
    const Index rank = missing.rows() - small;
    const MatrixXd directions = eigen.vectors.rightCols(rank).transpose();
    const MatrixXd weights = eigen.values.tail(rank).asDiagonal();
    return whole_->posteriorSd(directions, weights, scale, stop);
  }

 private:
  BasisPtr whole_;
  std::vector<BasisMaterial> materials_;
  VectorXd shift_, singular_;
  MatrixXd turn_, coefficients_;
  MatrixXd gram_[2], root_[2];
};

}  // namespace

BasisPtr basisWithout(const BasisPtr& basis, const std::vector<int>& left) {
  return std::make_shared<SubsetBasis>(basis, left);
}

std::vector<double> errorsOfLeftOut(const BasisPtr& basis, const std::vector<int>& left,
                                    const RowFactor& rows, const std::vector<int>& materials,
                                    BasisRegion region, double eta) {
  const SubsetBasis others(basis, left);
  const MatrixXd& t = others.turn();
  const MatrixXd f = product(rows.factor, false, t, false);
  MatrixXd system = gramOfRows(f);
  system.diagonal().array() += eta;
  const Eigen::LLT<MatrixXd> solve(system);
  std::vector<double> errors;
  for (const int material : materials) {
    const MatrixXd missed =
        basis->columnCoefficients().middleCols(3 * material, 3).colwise() - others.shift();
    const MatrixXd estimate = t * (f.transpose() * solve.solve(rows.factor * missed));
    const MatrixXd error = basis->gramRoot(region) * (missed - estimate);
    errors.push_back(error.colwise().norm().mean() /
                     std::sqrt(static_cast<double>(basis->cellCount(region))));
  }
  return errors;
}

}  // namespace patina
