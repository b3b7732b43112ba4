#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/twoshot/metric.h"

namespace patina {

enum class PlanSetup {
  Free,         ///< every picture has its own camera and light
  FixedCamera,  ///< one camera direction, a light for each picture
  FixedLight,   ///< one light direction, a camera for each picture
};

enum class PlanMetric { ExpectedError, ConditionNumber };

/// Options of the search for directions.
struct PlanOptions {
  int shots = 2;       ///< pictures, 1 to 30
  double fovDeg = 25;  ///< 0: point samples. Wider: each picture tells more
  PlanSetup setup = PlanSetup::Free;
  PlanMetric metric = PlanMetric::ExpectedError;
  BasisRegion region =
      BasisRegion::All;     ///< where the error counts; Trusted also keeps pictures within the trusted angles
  double eta = kPaperEta;   ///< Tikhonov's weight
  int candidates = 500;     ///< random directions tried for each new picture (the paper's t)
  int pointsPerShot = 150;  ///< of the disc while searching
  int restarts = 4;         ///< whole searches from different random numbers; the best is kept
  double poseErrorDeg = 0;  ///< > 0: the error is averaged over directions off by this much (camera and
                            ///< light), which moves the optimum away from cliffs
  double maxAngleDeg = 85;  ///< camera and light no further than this from the normal, at the centre
  std::vector<ShotDirections>
      given;  ///< pictures that are already decided or taken; the search adds `shots` more
  std::vector<std::string> validate() const;
};

struct PlannedShot {
  ShotDirections directions;
  HalfDiffAngles angles;  ///< at the centre
};

struct Plan {
  PlanOptions options;
  std::vector<PlannedShot> shots;  ///< the given ones first
  ExpectedError expected;          ///< with 300 points a picture
  double poseTolerant =
      0;  ///< mean training error over the pose error (options.poseErrorDeg, else 1.5 degrees)
  double conditionNumber = 0;
  std::vector<double>
      errorAfterShot;  ///< training error with the first 1, 2, ... pictures as the search found them
  std::vector<double> restartErrors;  ///< final training error of each restart
  std::string basisName;
  double seconds = 0;
  bool cancelled = false;
};

/// Finds directions. Source: two-shot paper, section 5: random candidates, then steps of 3, 2, 1 cells along
/// the numerical gradient of a randomly chosen picture until none improves; deterministic under job.seed.
/// Where we differ: restarts, the pose error, the trusted region; a step is taken only where it improves.
/// Progress: "restart", "search". Cancelled: the best plan so far, marked; with nothing yet,
/// ErrorCode::Cancelled. Errors: Invalid (options).
Result<Plan> planDirections(const BasisPtr& basis, const PlanOptions& options, const JobContext& job);

/// What directions that were really used are expected to do.
Plan expectationOf(const BasisPtr& basis, const std::vector<ShotDirections>& shots, const NearFieldDisc& disc,
                   BasisRegion region, double eta);

/// plan.json and back. Keys in docs/files.md. Errors: WriteFailed; NotFound, Malformed, Invalid.
Status writePlan(const std::filesystem::path& file, const Plan& plan);
Result<Plan> readPlan(const std::filesystem::path& file);
/// A drawing (SVG, from the side and from above, angles written beside) for the person at the bench.
std::string drawPlanSvg(const Plan& plan);

}  // namespace patina
