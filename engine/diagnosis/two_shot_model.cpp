#include "engine/diagnosis/two_shot_model.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "engine/base/dense.h"
#include "engine/twoshot/mapping.h"
#include "engine/twoshot/metric.h"

namespace patina {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The extra lobes' shapes are guesses, off by this share of them, smoothly and in all channels alike; and by
/// the second share from row to row.
constexpr double kLobeError = 0.12, kLobeGrain = 0.01;
/// Cosines of light and view below which rows are left out: measured BRDFs are not to be trusted there.
constexpr double kSmallestCosine = 0.15;
/// Prior of the deviations' sizes: medians (materials left out of the built-in basis), one standard deviation
/// of their logarithm.
constexpr double kPriorSpread = 1.2;
constexpr BasisDeviation::Part kBrightnessMedian{0.012, 0.03, 0.08}, kColourMedian{0.008, 0.012, 0.03};
constexpr double kSmallestPart = 1e-4, kLargestPart = 2;
/// What a photograph's own value is off by, relative: averages over blocks, the grid's interpolation, 16-bit
/// files.
constexpr double kPixelError = 0.004;
/// Sizes where a search may begin: white, rough and smooth deviations explain a misfit nearly alike, so that
/// a search from one of them ends there.
constexpr std::array<BasisDeviation::Part, 5> kPlaces{
    {{0.002, 0.01, 0.3}, {0.002, 0.02, 1}, {0.01, 0.1, 0.5}, {0.005, 0.4, 0.3}, {0.03, 0.01, 0.3}}};
/// The broad deviations' reach over that of the fine ones.
constexpr double kFineFaster = 3;
/// Share of what was seen below which the rest beside a lobe is not taken by its logarithm any more.
constexpr double kSmallestShare = 0.05;

/// Accuracy, natural-log units, to which the other materials are asked to give each of the basis' own, of
/// kEtaRows independent directions.
constexpr double kMissedAccuracy = 0.05;
/// Share of the typical deviation that is expected everywhere.
constexpr double kUnlikeFloor = 0.3;

/// Covariance of the deviations between two sets of rows; `column`: 0 brightness, 1 colour. Matern of order
/// 3/2 over the broad reach, of order 1/2 over the fine one, no white part.
MatrixXd deviationCovariance(const MappedRows& a, const MappedRows& b, Index column,
                             const BasisDeviation::Part& part) {
  MatrixXd out(a.size(), b.size());
  const double broad = part.broad * part.broad, fine = part.fine * part.fine;
  tbb::parallel_for(Index{0}, b.size(), [&](Index j) {
    for (Index i = 0; i < a.size(); ++i) {
      const double far = (a.place.row(i) - b.place.row(j)).norm();
      double sum = 0;
      if (broad > 0) sum += broad * (1 + std::sqrt(3.0) * far) * std::exp(-std::sqrt(3.0) * far);
      if (fine > 0) sum += fine * std::exp(-kFineFaster * far);
      out(i, j) = sum * a.unlike(i, column) * b.unlike(j, column);
    }
  });
  return out;
}

/// Variance of what is white in the deviations.
VectorXd grainVariance(const MappedRows& rows, Index column, const BasisDeviation::Part& part) {
  return (part.grain * rows.unlike.col(column).array()).square();
}

VectorXd noiseOf(const MappedRows& rows, Index column) {
  if (column == 0) return rows.noise.col(0);
  return rows.noise.rightCols(2).rowwise().mean();
}

MatrixXd lobeOf(const MappedRows& rows, Index column) {
  MatrixXd out = rows.lobe;
  if (out.size() > 0) out = rows.lobe.middleCols(column, column == 0 ? 1 : 2).eval();
  return out;
}

/// Adds the covariance that the guessed shape of an added lobe brings: smooth over a half of the broad reach.
void addLobeCovariance(const MatrixXd& place, const MatrixXd& lobe, MatrixXd& out) {
  if (lobe.size() == 0) return;
  const double share = kLobeError * kLobeError / static_cast<double>(lobe.cols());
  tbb::parallel_for(Index{0}, place.rows(), [&](Index j) {
    for (Index i = 0; i < place.rows(); ++i) {
      const double far = (place.row(i) - place.row(j)).squaredNorm();
      if (far < 15) out(i, j) += share * lobe.row(i).dot(lobe.row(j)) * std::exp(-2 * far);
    }
  });
}

/// `column`: 0 brightness, 1 colour.
MatrixXd covariance(const MappedRows& rows, Index column, bool withLobe, const BasisDeviation::Part& part) {
  MatrixXd out = deviationCovariance(rows, rows, column, part);
  if (withLobe) addLobeCovariance(rows.place, lobeOf(rows, column), out);
  const MatrixXd& root = column == 0 ? rows.brightness : rows.colour;
  multiply(root, false, root, true, out, 1, 1);
  out.diagonal() += noiseOf(rows, column) + grainVariance(rows, column, part);
  return out;
}

double lnDeterminant(const MatrixXd& lower) {
  double sum = 0;
  for (Index i = 0; i < lower.rows(); ++i) sum += 2 * std::log(lower(i, i));
  return sum;
}

/// ln likelihood of the columns of y, all with one covariance; the factor and the solutions are kept.
bool likelihood(MatrixXd matrix, const MatrixXd& y, MatrixXd* factor, MatrixXd* solved, double* ln) {
  if (!choleskyInPlace(matrix)) return false;
  MatrixXd z = y;
  solveLowerInPlace(matrix, false, z);
  const auto columns = static_cast<double>(y.cols());
  *ln += -0.5 * z.squaredNorm() - 0.5 * columns * lnDeterminant(matrix) -
         0.5 * columns * static_cast<double>(y.rows()) * std::log(2 * std::numbers::pi);
  if (solved) {
    solveLowerInPlace(matrix, true, z);
    *solved = std::move(z);
  }
  if (factor) *factor = std::move(matrix);
  return std::isfinite(*ln);
}

double lnPriorOf(const BasisDeviation::Part& part, const BasisDeviation::Part& median) {
  const auto one = [](double value, double middle) {
    const double x = std::log(value / middle) / kPriorSpread;
    return -0.5 * x * x;
  };
  return one(part.grain, median.grain) + one(part.fine, median.fine) + one(part.broad, median.broad);
}

}  // namespace

TwoShotModel::TwoShotModel(BasisPtr basis) : basis_(std::move(basis)) {
  const MatrixXd& columns = basis_->columnCoefficients();
  const Index materials = columns.cols() / 3;
  const Eigen::Matrix3d& mix = channelCombinations();
  const double root = 1 / std::sqrt(static_cast<double>(materials));
  const auto mixed = [&](const MatrixXd& source, MatrixXd& brightness, MatrixXd& colour) {
    brightness.resize(source.rows(), materials), colour.resize(source.rows(), 2 * materials);
    for (Index m = 0; m < materials; ++m) {
      const MatrixXd three = source.middleCols(3 * m, 3) * mix.transpose() * root;
      brightness.col(m) = three.col(0);
      // Which of the two differences a material deviates in is its hue's accident: both have the same
      // covariance.
      colour.middleCols(2 * m, 2) = three.rightCols(2) / std::sqrt(2.0);
    }
  };
  mixed(columns, brightness_, colour_);

  // What the others miss of material j: with P = (Y^T Y + eta I)^-1 it is Y P_j P_jj^-1, the columns j being
  // the material's three channels (block inverse of the ridge without them).
  const MatrixXd& gram = basis_->gram(BasisRegion::All);
  const auto cells = static_cast<double>(basis_->cellCount(BasisRegion::All));
  MatrixXd normal = columns.transpose() * (gram * columns);
  normal.diagonal().array() +=
      kMissedAccuracy * kMissedAccuracy * static_cast<double>(columns.cols()) * cells / kEtaRows;
  const MatrixXd inverse = normal.ldlt().solve(MatrixXd::Identity(normal.rows(), normal.cols()));
  MatrixXd missed(columns.rows(), columns.cols());
  for (Index m = 0; m < materials; ++m)
    missed.middleCols(3 * m, 3) =
        columns * inverse.middleCols(3 * m, 3) * inverse.block<3, 3>(3 * m, 3 * m).inverse();
  mixed(missed, missedBrightness_, missedColour_);
  for (MatrixXd* part : {&missedBrightness_, &missedColour_}) {
    const double square = (part->array() * (gram * *part).array()).sum() / cells;
    if (square > 0) *part /= std::sqrt(square);
  }
}

std::vector<DiagnosisRow> TwoShotModel::usable(const std::vector<DiagnosisRow>& rows) const {
  std::vector<DiagnosisRow> chosen;
  std::vector<HalfDiffAngles> angles;
  const TwoShotDeviation none;
  for (const DiagnosisRow& row : rows) {
    const DirectionPair pair = none.directions(row.point);
    if (pair.toLight.z() < kSmallestCosine || pair.toView.z() < kSmallestCosine) continue;
    chosen.push_back(row);
    angles.push_back(none.angles(pair));
  }
  std::vector<int> kept;
  static_cast<void>(basis_->rows(angles, &kept));
  std::vector<DiagnosisRow> covered;
  for (const int i : kept) covered.push_back(chosen[i]);
  return covered;
}

MappedRows TwoShotModel::map(const std::vector<DiagnosisRow>& rows, const TwoShotDeviation& deviation,
                             const MappedRows* like) const {
  const auto n = static_cast<Index>(rows.size());
  MappedRows out;
  out.value.resize(n, 3), out.noise.resize(n, 3), out.place.resize(n, 3);
  if (deviation.retro || deviation.coat || deviation.sheen != 0) out.lobe.resize(n, 3);
  std::vector<DirectionPair> pairs;
  for (const DiagnosisRow& row : rows) {
    pairs.push_back(deviation.directions(row.point));
    out.angles.push_back(deviation.angles(pairs.back()));
  }
  const auto same = [](const HalfDiffAngles& a, const HalfDiffAngles& b) {
    return a.thetaHRad == b.thetaHRad && a.thetaDRad == b.thetaDRad && a.phiDRad == b.phiDRad;
  };
  const bool reuse = like && like->size() == n &&
                     std::equal(out.angles.begin(), out.angles.end(), like->angles.begin(), same);
  out.anglesTakenOver = reuse;
  if (reuse) {
    out.weight = like->weight, out.offset = like->offset;
    out.brightness = like->brightness, out.colour = like->colour, out.place = like->place;
    out.unlike = like->unlike;
  } else {
    std::vector<int> kept;
    BasisRows basisRows = basis_->rows(out.angles, &kept);
    if (basisRows.size() != n) {
      // The deviation took a row across the basis' border: it stays where the bundle says it is.
      std::vector<char> known(rows.size(), 0);
      for (const int i : kept) known[i] = 1;
      const TwoShotDeviation none;
      for (std::size_t i = 0; i < rows.size(); ++i)
        if (!known[i]) out.angles[i] = none.angles(none.directions(rows[i].point));
      basisRows = basis_->rows(out.angles);
    }
    out.weight = basisRows.weight, out.offset = basisRows.lnReference + basisRows.mean;
    out.brightness = product(basisRows.components, false, brightness_, false);
    out.colour = product(basisRows.components, false, colour_, false);
    out.unlike.resize(n, 2);
    const auto field = [&](const MatrixXd& missed) -> VectorXd {
      const MatrixXd here = product(basisRows.components, false, missed, false);
      return (here.rowwise().squaredNorm().array() + kUnlikeFloor * kUnlikeFloor).sqrt();
    };
    out.unlike.col(0) = field(missedBrightness_), out.unlike.col(1) = field(missedColour_);
    for (Index i = 0; i < n; ++i) out.place.row(i) = smoothPlace(out.angles[i]);
  }
  const Eigen::Matrix3d& mix = channelCombinations();
  const Eigen::Matrix3d squares = mix.array().square().matrix();
  for (Index i = 0; i < n; ++i) {
    const DiagnosisRow& row = rows[static_cast<std::size_t>(i)];
    Eigen::Array3d seen = row.seen, slope;
    if (deviation.glare != 0) {
      std::size_t nearest = 0;
      for (std::size_t b = 1; b < kBlurPx.size(); ++b)
        if (std::abs(std::log(kBlurPx[b] / deviation.glarePx)) <
            std::abs(std::log(kBlurPx[nearest] / deviation.glarePx)))
          nearest = b;
      seen -= deviation.glare * row.blurred[nearest];
    }
    if (deviation.defocusPx != 0)
      seen -=
          deviation.defocusPx * std::abs(deviation.defocusPx) / (kBlurPx[0] * kBlurPx[0]) * row.blurred[0];
    const Eigen::Array3d base = deviation.baseFromSeen(seen, row.point, pairs[i], &slope);
    const Eigen::Array3d lobes = deviation.added(pairs[i]);
    const double w = out.weight[i];
    Eigen::Vector3d value, variance, lobeSlope;
    for (int c = 0; c < 3; ++c) {
      // Where an added lobe leaves little or nothing of what was seen, the logarithm goes on as its tangent:
      // a lobe that is a little too high must not send a row to minus infinity, and a search must feel which
      // way is up.
      const double f = base[c], floor = std::max(kSmallestShare * (f + lobes[c]), lobes[c] > 0 ? 1e-6 : 0.0);
      const double at = std::max(f, floor), mapped = w / (at * w + kMappingEpsilon);
      value[c] = std::log(at * w + kMappingEpsilon) + (f - at) * mapped - out.offset[i];
      lobeSlope[c] = lobes[c] * mapped;
      const double lobe = kLobeGrain * lobes[c], pixel = kPixelError * seen[c] * slope[c];
      variance[c] = (row.variance[c] * slope[c] * slope[c] + lobe * lobe + pixel * pixel) * mapped * mapped;
      out.lnJacobian += std::log(std::max(std::abs(slope[c]), 1e-12) * mapped);
    }
    out.value.row(i) = (mix * value).transpose();
    out.noise.row(i) = (squares * variance).transpose();
    if (out.lobe.size() > 0) out.lobe.row(i) = (mix * lobeSlope).transpose();
  }
  return out;
}

ConditionedRows TwoShotModel::condition(const MappedRows& rows, const BasisDeviation& basis) const {
  ConditionedRows out;
  MatrixXd solvedBrightness, solvedColour;
  double ln[2] = {0, 0};
  bool ok[2] = {false, false};
  tbb::parallel_for(0, 2, [&](int part) {
    if (part == 0) {
      ok[0] = likelihood(covariance(rows, 0, true, basis.brightness), rows.value.leftCols(1),
                         &out.factorBrightness, &solvedBrightness, &ln[0]);
    } else {
      ok[1] = likelihood(covariance(rows, 1, true, basis.colour), rows.value.rightCols(2), &out.factorColour,
                         &solvedColour, &ln[1]);
    }
  });
  out.ok = ok[0] && ok[1];
  if (!out.ok) {
    out.lnLikelihood = -std::numeric_limits<double>::infinity();
    return out;
  }
  out.lnLikelihood = ln[0] + ln[1] + rows.lnJacobian;
  out.solved.resize(rows.size(), 3);
  out.solved.leftCols(1) = solvedBrightness;
  out.solved.rightCols(2) = solvedColour;
  return out;
}

MatrixXd TwoShotModel::predict(const MappedRows& seen, const ConditionedRows& conditioned,
                               const MappedRows& there, const BasisDeviation& basis) const {
  MatrixXd out(there.size(), 3);
  const MatrixXd solvedColour = conditioned.solved.rightCols(2);
  out.leftCols(1) = there.brightness * (seen.brightness.transpose() * conditioned.solved.col(0)) +
                    deviationCovariance(there, seen, 0, basis.brightness) * conditioned.solved.col(0);
  out.rightCols(2) = there.colour * (seen.colour.transpose() * solvedColour) +
                     deviationCovariance(there, seen, 1, basis.colour) * solvedColour;
  return out;
}

MatrixXd TwoShotModel::predictedCovariance(const MappedRows& seen, const ConditionedRows& conditioned,
                                           const MappedRows& there, const BasisDeviation& basis) const {
  MatrixXd across = deviationCovariance(seen, there, 0, basis.brightness);
  multiply(seen.brightness, false, there.brightness, true, across, 1, 1);
  solveLowerInPlace(conditioned.factorBrightness, false, across);
  MatrixXd own = covariance(there, 0, false, basis.brightness);
  multiply(across, true, across, false, own, -1, 1);
  return own;
}

std::shared_ptr<const SmoothCorrection> TwoShotModel::correction(const MappedRows& seen,
                                                                 const BasisDeviation& basis) const {
  // A correction must be smooth, and the same kind of function everywhere: deviations of the mean size.
  BasisDeviation sizes = basis;
  MatrixXd weight(seen.size(), 3);
  for (const Index column : {Index{0}, Index{1}}) {
    BasisDeviation::Part& part = column == 0 ? sizes.brightness : sizes.colour;
    const double mean = std::sqrt(seen.unlike.col(column).squaredNorm() / static_cast<double>(seen.size()));
    part.grain *= mean, part.fine *= mean, part.broad *= mean;
    const MatrixXd& root = column == 0 ? seen.brightness : seen.colour;
    MatrixXd matrix = smoothCovariance(seen.place, seen.place, part);
    multiply(root, false, root, true, matrix, 1, 1);
    matrix.diagonal() += noiseOf(seen, column);
    matrix.diagonal().array() += part.grain * part.grain;
    const Index first = column, count = column == 0 ? 1 : 2;
    MatrixXd y = seen.value.middleCols(first, count);
    if (!choleskyInPlace(matrix)) return nullptr;
    solveLowerInPlace(matrix, false, y);
    solveLowerInPlace(matrix, true, y);
    weight.middleCols(first, count) = y;
  }
  return std::make_shared<const SmoothCorrection>(seen.place, weight, sizes);
}

double TwoShotModel::lnPrior(const BasisDeviation& basis) {
  return lnPriorOf(basis.brightness, kBrightnessMedian) + lnPriorOf(basis.colour, kColourMedian);
}

BasisDeviation TwoShotModel::fitDeviation(const MappedRows& rows, const BasisDeviation& start,
                                          const JobContext& job, double firstStep) const {
  BasisDeviation best = start;
  tbb::parallel_for(0, 2, [&](int which) {
    BasisDeviation::Part& part = which == 0 ? best.brightness : best.colour;
    const BasisDeviation::Part& median = which == 0 ? kBrightnessMedian : kColourMedian;
    const MatrixXd& root = which == 0 ? rows.brightness : rows.colour;
    const VectorXd noise = noiseOf(rows, which), grain = grainVariance(rows, which, {1, 0, 0});
    const MatrixXd y = rows.value.middleCols(which, which == 0 ? 1 : 2);
    MatrixXd basisPart = product(root, false, root, true);
    addLobeCovariance(rows.place, lobeOf(rows, which), basisPart);
    const MatrixXd broad = deviationCovariance(rows, rows, which, {0, 0, 1}),
                   fine = deviationCovariance(rows, rows, which, {0, 1, 0});
    const auto value = [&](const BasisDeviation::Part& tried) {
      MatrixXd matrix = basisPart + (tried.broad * tried.broad) * broad + (tried.fine * tried.fine) * fine;
      matrix.diagonal() += noise + (tried.grain * tried.grain) * grain;
      double ln = 0;
      if (!likelihood(std::move(matrix), y, nullptr, nullptr, &ln))
        return -std::numeric_limits<double>::infinity();
      return ln + lnPriorOf(tried, median);
    };
    double at = value(part);
    std::vector<BasisDeviation::Part> places{median};
    if (firstStep >= 1) places.insert(places.end(), kPlaces.begin(), kPlaces.end());
    for (const BasisDeviation::Part& place : places)
      if (const double there = value(place); there > at) at = there, part = place;
    // In steps that halve, each size by itself, and white against rough: the two stand for each other.
    constexpr std::array<std::array<double, 3>, 8> kMoves{
        {{1, 0, 0}, {-1, 0, 0}, {0, 0, 1}, {0, 0, -1}, {0, 1, 0}, {0, -1, 0}, {-1, 0.5, 0}, {1, -0.5, 0}}};
    for (double step = firstStep; step > 0.12 && !job.cancelled(); step /= 2) {
      bool moved = true;
      for (int round = 0; round < 8 && moved; ++round) {
        moved = false;
        for (const std::array<double, 3>& move : kMoves) {
          const auto within = [&](double size, double by) {
            return std::clamp(size * std::exp(by * step), kSmallestPart, kLargestPart);
          };
          const BasisDeviation::Part tried{within(part.grain, move[0]), within(part.fine, move[1]),
                                           within(part.broad, move[2])};
          if (const double found = value(tried); found > at + 0.01) at = found, part = tried, moved = true;
        }
      }
    }
  });
  return best;
}

}  // namespace patina
