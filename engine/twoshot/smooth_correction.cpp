#include "engine/twoshot/smooth_correction.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr double kDegree = std::numbers::pi / 180;
/// Reach of the smooth deviations: thetaH in cells of the MERL grid (90 sqrt(thetaH / 90 degrees)), thetaD in
/// degrees.
constexpr double kBroadCells = 16, kBroadDeg = 22, kFineCells = 5, kFineDeg = 8;
/// Weight of phiD's coordinate, in units of the broad reach.
constexpr double kPhiWeight = 2;
/// The table's nodes along thetaH, thetaD and phiD: two or more a reach of the fine deviations.
constexpr int kNodesH = 46, kNodesD = 31, kNodesP = 17;
constexpr double kLargestH = 90 / kBroadCells, kLargestD = 90 / kBroadDeg, kLargestP = kPhiWeight;
/// A correction beyond e^3 is a guess that went astray.
constexpr double kLargestLn = 3;

std::size_t node(int h, int d, int p) {
  return (static_cast<std::size_t>(h) * kNodesD + static_cast<std::size_t>(d)) * kNodesP +
         static_cast<std::size_t>(p);
}

}  // namespace

Eigen::RowVector3d smoothPlace(const HalfDiffAngles& angles) {
  const double cells = 90 * std::sqrt(std::max(angles.thetaHRad, 0.0) / (90 * kDegree));
  return {
      cells / kBroadCells, angles.thetaDRad / (kBroadDeg * kDegree),
      kPhiWeight * std::sin(angles.thetaHRad) * std::sin(angles.thetaDRad) * std::cos(2 * angles.phiDRad)};
}

MatrixXd smoothCovariance(const MatrixXd& a, const MatrixXd& b, const BasisDeviation::Part& part) {
  MatrixXd out(a.rows(), b.rows());
  const double broad = part.broad * part.broad, fine = part.fine * part.fine;
  const double rh = kBroadCells / kFineCells, rd = kBroadDeg / kFineDeg;
  tbb::parallel_for(Index{0}, b.rows(), [&](Index j) {
    for (Index i = 0; i < a.rows(); ++i) {
      const double h = a(i, 0) - b(j, 0), d = a(i, 1) - b(j, 1), p = a(i, 2) - b(j, 2);
      const double far = h * h + d * d + p * p, near = h * h * rh * rh + d * d * rd * rd + 4 * p * p;
      // Beyond 60 an exponential adds less than rounding.
      double sum = 0;
      if (broad > 0 && far < 60) sum += broad * std::exp(-0.5 * far);
      if (fine > 0 && near < 60) sum += fine * std::exp(-0.5 * near);
      out(i, j) = sum;
    }
  });
  return out;
}

const Eigen::Matrix3d& channelCombinations() {
  static const Eigen::Matrix3d matrix = [] {
    Eigen::Matrix3d m;
    m << 1 / std::sqrt(3.0), 1 / std::sqrt(3.0), 1 / std::sqrt(3.0),  //
        1 / std::sqrt(2.0), 0, -1 / std::sqrt(2.0),                   //
        1 / std::sqrt(6.0), -2 / std::sqrt(6.0), 1 / std::sqrt(6.0);
    return m;
  }();
  return matrix;
}

SmoothCorrection::SmoothCorrection(const MatrixXd& place, const MatrixXd& weight, const BasisDeviation& basis)
    : table_(std::size_t{kNodesH} * kNodesD * kNodesP) {
  MatrixXd nodes(static_cast<Index>(table_.size()), 3);
  for (int h = 0; h < kNodesH; ++h)
    for (int d = 0; d < kNodesD; ++d)
      for (int p = 0; p < kNodesP; ++p)
        nodes.row(static_cast<Index>(node(h, d, p))) << kLargestH * h / (kNodesH - 1),
            kLargestD * d / (kNodesD - 1), kLargestP * (2.0 * p / (kNodesP - 1) - 1);
  // In slices: the covariance of all nodes with all rows would be some 100 MB.
  constexpr Index kSlice = 2048;
  for (Index from = 0; from < nodes.rows(); from += kSlice) {
    const Index count = std::min(kSlice, nodes.rows() - from);
    const MatrixXd there = nodes.middleRows(from, count);
    MatrixXd mixed(count, 3);
    mixed.leftCols(1) = smoothCovariance(there, place, basis.brightness) * weight.leftCols(1);
    mixed.rightCols(2) = smoothCovariance(there, place, basis.colour) * weight.rightCols(2);
    const MatrixXd ln = mixed * channelCombinations();
    for (Index i = 0; i < count; ++i)
      table_[static_cast<std::size_t>(from + i)] =
          ln.row(i).transpose().array().max(-kLargestLn).min(kLargestLn).cast<float>();
  }
}

Eigen::Array3d SmoothCorrection::lnFactor(const HalfDiffAngles& angles) const {
  const Eigen::RowVector3d at = smoothPlace(angles);
  std::array<int, 3> low{};
  std::array<double, 3> t{};
  const std::array<double, 3> x{at[0] / kLargestH * (kNodesH - 1), at[1] / kLargestD * (kNodesD - 1),
                                (at[2] / kLargestP + 1) / 2 * (kNodesP - 1)};
  const std::array<int, 3> nodes{kNodesH, kNodesD, kNodesP};
  for (std::size_t i = 0; i < 3; ++i) {
    const double clamped = std::clamp(x[i], 0.0, nodes[i] - 1.0);
    low[i] = std::min(static_cast<int>(clamped), nodes[i] - 2);
    t[i] = clamped - low[i];
  }
  Eigen::Array3f sum = Eigen::Array3f::Zero();
  for (int corner = 0; corner < 8; ++corner) {
    const int h = corner & 1, d = (corner >> 1) & 1, p = corner >> 2;
    const double share = (h ? t[0] : 1 - t[0]) * (d ? t[1] : 1 - t[1]) * (p ? t[2] : 1 - t[2]);
    sum += static_cast<float>(share) * table_[node(low[0] + h, low[1] + d, low[2] + p)];
  }
  return sum.cast<double>();
}

}  // namespace patina
