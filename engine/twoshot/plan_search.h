#pragma once

// Inside of planDirections: what is walked (PlanSpace), what is minimised (PlanObjective), and the walk.

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <random>
#include <vector>

#include "engine/twoshot/plan.h"

namespace patina {

/// One picture of a set, and which of the set it is (the pose errors of two pictures are not the same).
struct IndexedShot {
  int index = 0;
  ShotDirections directions;
};

/// The lattice of directions. Free pictures are cells of the MERL grid (the paper's); where camera or light
/// is shared, whole degrees of the directions.
class PlanSpace {
 public:
  using Block = std::array<int, 3>;  ///< coordinates that move together; unused ones stay 0
  using Place = std::vector<Block>;  ///< Free: one a picture. Else: the shared direction, then one a picture

  explicit PlanSpace(const PlanOptions& options);

  bool shared() const { return setup_ != PlanSetup::Free; }
  /// Whether block 0 is a direction that all pictures share and that may move.
  bool sharedMoves() const { return shared() && !sharedGiven_; }
  int blockCount(int shots) const { return shots + (shared() ? 1 : 0); }
  int coordinates(std::size_t block) const { return !shared() ? 3 : block == 0 ? 1 : 2; }
  ShotDirections shot(const Place& place, int shot) const;
  bool valid(const ShotDirections& directions) const;
  bool valid(const Place& place) const;
  bool validLight(const Eigen::Vector3d& toLight) const;
  bool validCamera(const Eigen::Vector3d& toCamera) const;
  /// A picture within bounds, uniform over the cells (degrees).
  Block randomShot(std::mt19937_64& random, const Place& place) const;
  Block randomShared(std::mt19937_64& random) const;
  /// The block a step away, reflected where the coordinate ends.
  Block moved(std::size_t block, const Block& from, const Block& by) const;

 private:
  PlanSetup setup_;
  bool point_;
  double discRadius_;
  double maxAngleDeg_, trustedAngleDeg_;
  std::optional<Eigen::Vector3d> sharedGiven_;
};

/// What a search minimises, with what stays while some pictures move worked out once.
class PlanObjective {
 public:
  PlanObjective(const BasisPtr& basis, const PlanOptions& options);

  /// The pictures that stay: for each pose of the rig, R and what follows from it.
  struct Staying {
    struct Pose {
      Eigen::MatrixXd residual;  ///< R, k x k; empty: nothing stays
      Eigen::MatrixXd seen;      ///< R C, k x m
      Eigen::MatrixXd error;     ///< L R C, k x m
      Eigen::MatrixXd rows;      ///< for the condition number: n x k
    };
    std::vector<Pose> poses;
  };
  /// `tolerant`: over the pose error, where one is asked for.
  Staying stay(const std::vector<IndexedShot>& shots, bool tolerant) const;
  /// The metric for `staying` and `moving` together. Threading: any number of calls at a time.
  double value(const Staying& staying, const std::vector<IndexedShot>& moving) const;
  /// Both in one.
  double value(const std::vector<IndexedShot>& shots, bool tolerant) const;
  bool hasPoseError() const { return options_.poseErrorDeg > 0; }

 private:
  RowFactor factor(const std::vector<IndexedShot>& shots, int pose, bool tolerant) const;
  Eigen::MatrixXd rawRows(const std::vector<IndexedShot>& shots, int pose, bool tolerant) const;
  Eigen::MatrixXd weigh(const Eigen::MatrixXd& x) const;
  double poseValue(const Staying::Pose& pose, const std::vector<IndexedShot>& moving, int index,
                   bool tolerant) const;

  BasisPtr basis_;
  PlanOptions options_;
  NearFieldDisc disc_;
  double rootCells_;
  Eigen::MatrixXd start_;  ///< L C, k x m
};

/// How many ways of being off by the pose error are averaged.
inline constexpr int kPoseErrors = 8;
/// The picture when camera and light are off by `errorDeg`, in direction `pose` of kPoseErrors.
ShotDirections offBy(const IndexedShot& shot, double errorDeg, int pose, PlanSetup setup);

/// Where one restart ended.
struct SearchEnd {
  std::vector<ShotDirections>
      shots;  ///< without the given ones; empty where it was stopped before it had all
  double value = 0;
};
/// One restart. `step` is called after each part of the work, 2 * options.shots times if not stopped.
SearchEnd searchDirections(const PlanObjective& objective, const PlanOptions& options, int restart,
                           const JobContext& job, const std::function<void()>& step);

}  // namespace patina
