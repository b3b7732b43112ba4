#include "engine/twoshot/plan_search.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "engine/base/dense.h"

namespace patina {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kThetaHCells = 90, kThetaDCells = 90, kPhiDCells = 180;  // of the MERL grid

Eigen::Vector3d direction(double thetaDeg, double azimuthDeg) {
  const double theta = thetaDeg * kDegree, azimuth = azimuthDeg * kDegree;
  return {std::sin(theta) * std::cos(azimuth), std::sin(theta) * std::sin(azimuth), std::cos(theta)};
}

int below(std::mt19937_64& random, int count) {
  // The remainder's bias is 1e-17; the standard's distributions differ between libraries.
  return static_cast<int>(random() % static_cast<std::uint64_t>(count));
}

/// `value` reflected into 0 .. count - 1, as a mirror-symmetric angle is.
int reflected(int value, int count) {
  if (value < 0) value = -1 - value;
  if (value >= count) value = 2 * count - 1 - value;
  return std::clamp(value, 0, count - 1);
}

std::uint64_t mixed(std::uint64_t value) {
  value += 0x9E3779B97F4A7C15ull;
  value = (value ^ (value >> 30)) * 0xBF58476D1CE4E5B9ull;
  value = (value ^ (value >> 27)) * 0x94D049BB133111EBull;
  return value ^ (value >> 31);
}

Eigen::Vector3d turned(const Eigen::Vector3d& from, double byDeg, double towardsDeg) {
  const Eigen::Vector3d side = std::abs(from.z()) > 1 - 1e-9
                                   ? Eigen::Vector3d::UnitX()
                                   : Eigen::Vector3d(Eigen::Vector3d::UnitZ().cross(from).normalized());
  const Eigen::Vector3d up = from.cross(side);
  const double towards = towardsDeg * kDegree, by = byDeg * kDegree;
  return std::cos(by) * from + std::sin(by) * (std::cos(towards) * side + std::sin(towards) * up);
}

}  // namespace

ShotDirections offBy(const IndexedShot& shot, double errorDeg, int pose, PlanSetup setup) {
  // Camera and light of each picture go round in their own order (odd multiples visit all of 8), so that
  // errors are not alike; what is shared is off by the same.
  const auto angle = [&](bool camera) {
    const bool shared =
        (camera && setup == PlanSetup::FixedCamera) || (!camera && setup == PlanSetup::FixedLight);
    const int index = shared ? 0 : shot.index;
    const int stride = 2 * ((2 * index + (camera ? 0 : 1)) % (kPoseErrors / 2)) + 1;
    return 360.0 / kPoseErrors * ((stride * pose + index + (camera ? 0 : 2)) % kPoseErrors);
  };
  return {turned(shot.directions.toLight, errorDeg, angle(false)),
          turned(shot.directions.toCamera, errorDeg, angle(true))};
}

// ---- the lattice ----

PlanSpace::PlanSpace(const PlanOptions& options)
    : setup_(options.setup),
      point_(options.fovDeg <= 0),
      discRadius_(std::tan(options.fovDeg * kDegree / 2)),
      maxAngleDeg_(options.maxAngleDeg),
      trustedAngleDeg_(options.region == BasisRegion::Trusted ? kTrustedAngleDeg : 90) {
  if (shared() && !options.given.empty())
    sharedGiven_ = setup_ == PlanSetup::FixedCamera ? options.given[0].toCamera : options.given[0].toLight;
}

ShotDirections PlanSpace::shot(const Place& place, int shot) const {
  if (!shared()) {
    const Block& cell = place[static_cast<std::size_t>(shot)];
    const double thetaHDeg = (cell[0] + 0.5) * (cell[0] + 0.5) / kThetaHCells;
    return shotFromHalfDiff({thetaHDeg * kDegree, (cell[1] + 0.5) * kDegree, (cell[2] + 0.5) * kDegree});
  }
  const Eigen::Vector3d common = sharedGiven_ ? *sharedGiven_ : direction(place[0][0], 0);
  const Block& own = place[static_cast<std::size_t>(shot) + 1];
  const Eigen::Vector3d other = direction(own[0], own[1]);
  return setup_ == PlanSetup::FixedCamera ? ShotDirections{other, common} : ShotDirections{common, other};
}

bool PlanSpace::validLight(const Eigen::Vector3d& toLight) const {
  return toLight.z() >= std::cos(std::min(maxAngleDeg_, trustedAngleDeg_) * kDegree) - 1e-12;
}

bool PlanSpace::validCamera(const Eigen::Vector3d& toCamera) const {
  if (!validLight(toCamera)) return false;
  if (trustedAngleDeg_ >= 90) return true;
  // The point of the disc that the camera sees most obliquely is the far end of its rim.
  const double across = std::hypot(toCamera.x(), toCamera.y()) + discRadius_;
  return std::atan2(across, toCamera.z()) <= trustedAngleDeg_ * kDegree;
}

bool PlanSpace::valid(const ShotDirections& directions) const {
  return validLight(directions.toLight) && validCamera(directions.toCamera);
}

bool PlanSpace::valid(const Place& place) const {
  const int shots = static_cast<int>(place.size()) - (shared() ? 1 : 0);
  for (int i = 0; i < shots; ++i)
    if (!valid(shot(place, i))) return false;
  return true;
}

PlanSpace::Block PlanSpace::randomShot(std::mt19937_64& random, const Place& place) const {
  // Some third of all cells is valid; the bound is for options that leave none.
  constexpr int kMostTries = 100000;
  Block block{};
  for (int i = 0; i < kMostTries; ++i) {
    Place tried = place;
    if (!shared()) {
      block = {below(random, kThetaHCells), below(random, kThetaDCells),
               below(random, point_ ? kPhiDCells / 2 : kPhiDCells)};
      tried = {block};
    } else {
      const int most = static_cast<int>(std::floor(maxAngleDeg_));
      // The mirror image does as well: half of the azimuths, unless a given picture has broken the symmetry.
      block = {below(random, most + 1), below(random, sharedGiven_ ? 360 : 181), 0};
      tried = {place[0], block};
    }
    if (valid(tried)) return block;
  }
  return block;
}

PlanSpace::Block PlanSpace::randomShared(std::mt19937_64& random) const {
  int most = static_cast<int>(std::floor(std::min(maxAngleDeg_, trustedAngleDeg_)));
  const auto allowed = [&](int angle) {
    const Eigen::Vector3d to = direction(angle, 0);
    return setup_ == PlanSetup::FixedCamera ? validCamera(to) : validLight(to);
  };
  while (most > 0 && !allowed(most)) --most;
  return {below(random, most + 1), 0, 0};
}

PlanSpace::Block PlanSpace::moved(std::size_t block, const Block& from, const Block& by) const {
  Block to = {from[0] + by[0], from[1] + by[1], from[2] + by[2]};
  if (!shared()) {
    to[0] = reflected(to[0], kThetaHCells);
    to[1] = reflected(to[1], kThetaDCells);
    // Beyond a quarter turn a point sample repeats itself, a disc only beyond half a turn: its camera is
    // near, its light is not.
    to[2] = reflected(to[2], point_ ? kPhiDCells / 2 : kPhiDCells);
  } else {
    to[0] = std::abs(to[0]);
    if (block == 0) to[1] = to[2] = 0;
  }
  return to;
}

// ---- the metric ----

PlanObjective::PlanObjective(const BasisPtr& basis, const PlanOptions& options)
    : basis_(basis),
      options_(options),
      disc_{options.fovDeg, options.pointsPerShot},
      rootCells_(std::sqrt(static_cast<double>(basis->cellCount(options.region)))) {
  start_ = weigh(basis_->columnCoefficients());
}

MatrixXd PlanObjective::weigh(const MatrixXd& x) const {
  if (options_.region == BasisRegion::All) return basis_->singularValues().asDiagonal() * x;
  return product(basis_->gramRoot(options_.region), false, x, false);
}

RowFactor PlanObjective::factor(const std::vector<IndexedShot>& shots, int pose, bool tolerant) const {
  std::vector<RowFactor> factors;
  for (const IndexedShot& shot : shots) {
    const ShotDirections directions =
        tolerant ? offBy(shot, options_.poseErrorDeg, pose, options_.setup) : shot.directions;
    factors.push_back(rowsOfShot(*basis_, directions, disc_, kSearchTolerance));
  }
  if (factors.size() == 1) return std::move(factors[0]);
  std::vector<const RowFactor*> all;
  for (const RowFactor& one : factors) all.push_back(&one);
  RowFactor stacked = stack(all);
  return stacked.rank() > basis_->componentCount() ? reduceRows(stacked.factor, 1.0, kExactTolerance)
                                                   : stacked;
}

MatrixXd PlanObjective::rawRows(const std::vector<IndexedShot>& shots, int pose, bool tolerant) const {
  MatrixXd all(0, basis_->componentCount());
  for (const IndexedShot& shot : shots) {
    const ShotDirections directions =
        tolerant ? offBy(shot, options_.poseErrorDeg, pose, options_.setup) : shot.directions;
    const MatrixXd rows = basis_->rows(discDirections(directions, disc_)).components;
    all.conservativeResize(all.rows() + rows.rows(), Eigen::NoChange);
    all.bottomRows(rows.rows()) = rows;
  }
  return all;
}

PlanObjective::Staying PlanObjective::stay(const std::vector<IndexedShot>& shots, bool tolerant) const {
  tolerant = tolerant && hasPoseError();
  Staying staying;
  staying.poses.resize(tolerant ? kPoseErrors : 1);
  for (std::size_t p = 0; p < staying.poses.size(); ++p) {
    Staying::Pose& pose = staying.poses[p];
    if (options_.metric == PlanMetric::ConditionNumber) {
      pose.rows = rawRows(shots, static_cast<int>(p), tolerant);
      continue;
    }
    const MatrixXd& c = basis_->columnCoefficients();
    if (shots.empty()) continue;
    const MatrixXd f = factor(shots, static_cast<int>(p), tolerant).factor;
    MatrixXd system = gramOfRows(f);
    system.diagonal().array() += options_.eta;
    const MatrixXd solved = Eigen::LLT<MatrixXd>(system).solve(f);
    pose.residual = product(f, true, solved, false) * -1;
    pose.residual.diagonal().array() += 1;
    pose.seen = product(pose.residual, false, c, false);
    pose.error = weigh(pose.seen);
  }
  return staying;
}

double PlanObjective::poseValue(const Staying::Pose& pose, const std::vector<IndexedShot>& moving, int index,
                                bool tolerant) const {
  if (options_.metric == PlanMetric::ConditionNumber) {
    MatrixXd rows = rawRows(moving, index, tolerant);
    const Index before = pose.rows.rows();
    rows.conservativeResize(rows.rows() + before, Eigen::NoChange);
    rows.bottomRows(before) = pose.rows;
    if (rows.rows() <= 64) return conditionNumber(rows);
    // Eigenvalues of the smaller product: squares lose what lies below 1e-8 of the largest singular value,
    // where one near-field set is as bad as another.
    const MatrixXd gram = rows.rows() < rows.cols() ? gramOfRows(rows) : gramOfColumns(rows);
    const Eigen::VectorXd values =
        Eigen::SelfAdjointEigenSolver<MatrixXd>(gram, Eigen::EigenvaluesOnly).eigenvalues();
    const double largest = values(values.size() - 1);
    return std::sqrt(largest / std::max(values(0), 1e-16 * largest));
  }
  const bool fresh = pose.residual.size() == 0;
  const MatrixXd f = factor(moving, index, tolerant).factor;
  const MatrixXd& seen = fresh ? basis_->columnCoefficients() : pose.seen;
  MatrixXd error = fresh ? start_ : pose.error;
  if (f.rows() > 0) {
    // With R of what stays: R' = R - R F^T (F R F^T + eta I)^-1 F R.
    const MatrixXd inner = fresh ? f : product(f, false, pose.residual, false);  // F R, r x k
    MatrixXd system = fresh ? gramOfRows(f) : product(inner, false, f, true);
    system.diagonal().array() += options_.eta;
    MatrixXd inside = product(f, false, seen, false);  // F R C, r x m
    Eigen::LLT<MatrixXd>(system).solveInPlace(inside);
    multiply(weigh(inner.transpose()), false, inside, false, error, -1, 1);
  }
  return error.colwise().norm().mean() / rootCells_;
}

double PlanObjective::value(const Staying& staying, const std::vector<IndexedShot>& moving) const {
  const bool tolerant = staying.poses.size() > 1;
  double sum = 0;
  for (std::size_t p = 0; p < staying.poses.size(); ++p)
    sum += poseValue(staying.poses[p], moving, static_cast<int>(p), tolerant);
  return sum / static_cast<double>(staying.poses.size());
}

double PlanObjective::value(const std::vector<IndexedShot>& shots, bool tolerant) const {
  return value(stay({}, tolerant), shots);
}

// ---- the walk ----

namespace {

class Walk {
 public:
  Walk(const PlanObjective& objective, const PlanOptions& options, int restart, const JobContext& job)
      : objective_(objective),
        options_(options),
        job_(job),
        space_(options),
        random_(mixed(mixed(job.seed) + static_cast<std::uint64_t>(restart))),
        // Pictures that are best together are not always found one after the other.
        joint_(restart % 2 == 1 && options.shots > 1 && options.shots <= 3) {}

  SearchEnd run(const std::function<void()>& step) {
    if (space_.shared()) place_.push_back({});
    if (joint_) {
      startJointly();
      for (int i = 0; i < options_.shots; ++i) step();
      descend();
      for (int i = 0; i < options_.shots; ++i) step();
    } else {
      for (int i = 0; i < options_.shots && !job_.cancelled(); ++i) {
        addShot(i);
        step();
        descend();
        step();
      }
    }
    SearchEnd end;
    if (shotCount() < options_.shots) return end;
    for (int i = 0; i < options_.shots; ++i) end.shots.push_back(space_.shot(place_, i));
    end.value = objective_.value(all(place_), true);
    return end;
  }

 private:
  using Block = PlanSpace::Block;
  using Place = PlanSpace::Place;

  int shotCount() const { return static_cast<int>(place_.size()) - (space_.shared() ? 1 : 0); }

  std::vector<IndexedShot> given() const {
    std::vector<IndexedShot> shots;
    for (const ShotDirections& directions : options_.given)
      shots.push_back({static_cast<int>(shots.size()), directions});
    return shots;
  }
  IndexedShot indexed(const Place& place, int shot) const {
    return {static_cast<int>(options_.given.size()) + shot, space_.shot(place, shot)};
  }
  std::vector<IndexedShot> searched(const Place& place) const {
    std::vector<IndexedShot> shots;
    const int count = static_cast<int>(place.size()) - (space_.shared() ? 1 : 0);
    for (int i = 0; i < count; ++i) shots.push_back(indexed(place, i));
    return shots;
  }
  std::vector<IndexedShot> all(const Place& place) const {
    std::vector<IndexedShot> shots = given();
    for (const IndexedShot& shot : searched(place)) shots.push_back(shot);
    return shots;
  }

  /// The value of every proposal; infinite where the job was stopped first.
  std::vector<double> values(const PlanObjective::Staying& staying,
                             const std::vector<std::vector<IndexedShot>>& proposals) const {
    std::vector<double> found(proposals.size(), std::numeric_limits<double>::infinity());
    tbb::parallel_for(std::size_t{0}, proposals.size(), [&](std::size_t i) {
      if (!job_.cancelled()) found[i] = objective_.value(staying, proposals[i]);
    });
    return found;
  }

  /// The best of many: without the pose error, then the better ones with it.
  std::optional<std::size_t> bestOf(const std::vector<IndexedShot>& staying,
                                    const std::vector<std::vector<IndexedShot>>& proposals) const {
    constexpr std::size_t kSecondRound = 24;
    const std::vector<double> first = values(objective_.stay(staying, false), proposals);
    if (job_.cancelled()) return std::nullopt;
    std::vector<std::size_t> order(proposals.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) { return first[a] < first[b]; });
    if (!objective_.hasPoseError()) return order[0];
    order.resize(std::min(order.size(), kSecondRound));
    std::vector<std::vector<IndexedShot>> better;
    for (const std::size_t i : order) better.push_back(proposals[i]);
    const std::vector<double> second = values(objective_.stay(staying, true), better);
    if (job_.cancelled()) return std::nullopt;
    return order[static_cast<std::size_t>(std::ranges::min_element(second) - second.begin())];
  }

  void addShot(int shot) {
    std::vector<Place> places;
    std::vector<std::vector<IndexedShot>> proposals;
    const bool withShared = shot == 0 && space_.sharedMoves();
    for (int i = 0; i < options_.candidates; ++i) {
      Place place = place_;
      if (withShared) place[0] = space_.randomShared(random_);
      place.push_back(space_.randomShot(random_, place));
      proposals.push_back({indexed(place, shot)});
      places.push_back(std::move(place));
    }
    if (const auto best = bestOf(all(place_), proposals)) place_ = places[*best];
  }

  void startJointly() {
    std::vector<Place> places;
    std::vector<std::vector<IndexedShot>> proposals;
    for (int i = 0; i < options_.candidates; ++i) {
      Place place = place_;
      if (space_.sharedMoves()) place[0] = space_.randomShared(random_);
      for (int s = 0; s < options_.shots; ++s) place.push_back(space_.randomShot(random_, place));
      proposals.push_back(searched(place));
      places.push_back(std::move(place));
    }
    if (const auto best = bestOf(given(), proposals)) place_ = places[*best];
  }

  void descend() {
    if (shotCount() == 0 || job_.cancelled()) return;
    current_ = objective_.value(all(place_), true);
    for (int step = 3; step >= 1; --step) {
      std::vector<std::size_t> order;
      for (std::size_t b = space_.shared() && !space_.sharedMoves() ? 1 : 0; b < place_.size(); ++b)
        order.push_back(b);
      // Moves a round are bounded by the lattice: every one of them lowers the value.
      for (bool improved = true; improved && !job_.cancelled();) {
        improved = false;
        for (std::size_t i = order.size(); i > 1; --i)
          std::swap(order[i - 1], order[static_cast<std::size_t>(below(random_, static_cast<int>(i)))]);
        for (const std::size_t block : order) improved = walk(block, step) || improved;
      }
    }
  }

  /// Moves one block while it improves, other pictures staying.
  bool walk(std::size_t block, int step) {
    const bool everything = space_.shared() && block == 0;
    std::vector<IndexedShot> rest = given();
    const int own = static_cast<int>(block) - (space_.shared() ? 1 : 0);
    if (!everything)
      for (int i = 0; i < shotCount(); ++i)
        if (i != own) rest.push_back(indexed(place_, i));
    const PlanObjective::Staying staying = objective_.stay(rest, true);
    const auto proposal = [&](const Block& to) -> std::optional<std::vector<IndexedShot>> {
      Place place = place_;
      place[block] = to;
      if (to == place_[block] || !space_.valid(place)) return std::nullopt;
      if (everything) return searched(place);
      return std::vector<IndexedShot>{indexed(place, own)};
    };
    // Takes the best of these steps if it improves; the value of each (infinite where it leaves the lattice).
    const auto attempt = [&](const std::vector<Block>& steps, std::vector<double>* valueOf) {
      std::vector<Block> to;
      std::vector<std::size_t> from;
      std::vector<std::vector<IndexedShot>> proposals;
      for (std::size_t i = 0; i < steps.size(); ++i) {
        const Block block2 = space_.moved(block, place_[block], steps[i]);
        if (auto shots = proposal(block2)) {
          to.push_back(block2);
          from.push_back(i);
          proposals.push_back(std::move(*shots));
        }
      }
      const std::vector<double> found = values(staying, proposals);
      if (valueOf) {
        valueOf->assign(steps.size(), std::numeric_limits<double>::infinity());
        for (std::size_t i = 0; i < found.size(); ++i) (*valueOf)[from[i]] = found[i];
      }
      const auto best = std::ranges::min_element(found);
      // 1e-9: steps within rounding of each other must not go round in circles.
      if (best == found.end() || job_.cancelled() || !(*best < current_ * (1 - 1e-9))) return false;
      current_ = *best;
      place_[block] = to[static_cast<std::size_t>(best - found.begin())];
      return true;
    };

    const int axes = space_.coordinates(block);
    bool moved = false;
    while (!job_.cancelled()) {
      std::vector<Block> along;
      for (int axis = 0; axis < axes; ++axis)
        for (int sign : {-step, step}) {
          Block by{};
          by[static_cast<std::size_t>(axis)] = sign;
          along.push_back(by);
        }
      const Block before = place_[block];
      const double was = current_;
      std::vector<double> valueOf;
      if (attempt(along, &valueOf)) {
        moved = true;
        // The gradient's own direction: every coordinate that improved alone, together.
        Block gradient{};
        int improving = 0;
        for (int axis = 0; axis < axes; ++axis) {
          const double down = valueOf[2 * static_cast<std::size_t>(axis)];
          const double up = valueOf[2 * static_cast<std::size_t>(axis) + 1];
          if (std::min(down, up) >= was) continue;
          gradient[static_cast<std::size_t>(axis)] = down < up ? -step : step;
          ++improving;
        }
        if (improving > 1) {
          const Block target = space_.moved(block, before, gradient);
          const Block by = {target[0] - place_[block][0], target[1] - place_[block][1],
                            target[2] - place_[block][2]};
          attempt({by}, nullptr);
        }
        continue;
      }
      // Valleys that no axis follows: the last, finest steps try the diagonals as well.
      if (step > 1 || axes == 1) break;
      std::vector<Block> diagonals;
      for (int a = -1; a <= 1; ++a)
        for (int b = -1; b <= 1; ++b)
          for (int c = axes > 2 ? -1 : 0; c <= (axes > 2 ? 1 : 0); ++c)
            if (std::abs(a) + std::abs(b) + std::abs(c) > 1) diagonals.push_back({a, b, c});
      if (!attempt(diagonals, nullptr)) break;
      moved = true;
    }
    return moved;
  }

  const PlanObjective& objective_;
  const PlanOptions& options_;
  const JobContext& job_;
  PlanSpace space_;
  std::mt19937_64 random_;
  bool joint_;
  Place place_;
  double current_ = 0;
};

}  // namespace

SearchEnd searchDirections(const PlanObjective& objective, const PlanOptions& options, int restart,
                           const JobContext& job, const std::function<void()>& step) {
  return Walk(objective, options, restart, job).run(step);
}

}  // namespace patina
