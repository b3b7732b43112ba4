#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/capture/two_shot_capture.h"
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
  int restarts = 8;         ///< whole searches from different random numbers; the best is kept
  double poseErrorDeg = 0;  ///< > 0: the error is averaged over directions off by this much (camera and
                            ///< light), which moves the optimum away from cliffs
  double maxAngleDeg = 85;  ///< camera and light no further than this from the normal, at the centre
  std::vector<ShotDirections>
      given;  ///< pictures that are already decided or taken; the search adds `shots` more. With a fixed
              ///< camera or light they share it, and the search keeps it
  /// Every problem with the values; empty when usable.
  std::vector<std::string> validate() const;
};

struct PlannedShot {
  ShotDirections directions;
  HalfDiffAngles angles;  ///< at the centre
};

struct Plan {
  PlanOptions options;
  std::vector<PlannedShot> shots;  ///< the given ones first; then what tells most after those before it
  ExpectedError expected;          ///< with 300 points a picture
  double poseTolerant =
      0;  ///< mean training error over the pose error (options.poseErrorDeg, else 1.5 degrees)
  double conditionNumber = 0;
  std::vector<double> errorAfterShot;  ///< training error with the first 1, 2, ... of `shots`
  std::vector<double> restartErrors;   ///< what each restart's search ended with, in the metric that it
                                       ///< minimised: `pointsPerShot` points, over the pose error where asked
  std::string basisName;
  std::vector<std::string> materials;  ///< of the basis: names for expected.unseenMaterial
  std::uint64_t seed = 0;              ///< of the search
  double seconds = 0;
  bool cancelled = false;
};

/// Finds directions. Source: two-shot paper, section 5: random candidates, then steps of 3, 2, 1 cells along
/// the numerical gradient of a randomly chosen picture until none improves; deterministic under job.seed,
/// whatever the number of threads. Where we differ: restarts (every other one starts from random sets of
/// pictures rather than one picture at a time); the pose error; the trusted region; a step is taken only
/// where it improves, and the last ones go along diagonals too; setups with a fixed camera or light move in
/// degrees of the directions instead of cells. Progress: "search". Cancelled: the best plan so far, marked;
/// with nothing yet, ErrorCode::Cancelled. Errors: Invalid (options). Threads: job.threads. Cost: two
/// pictures and 300 columns, some 2 s of one core a restart; a pose error multiplies the second half by 8.
Result<Plan> planDirections(const BasisPtr& basis, const PlanOptions& options, const JobContext& job);

/// What directions that were really used are expected to do.
Plan expectationOf(const BasisPtr& basis, const std::vector<ShotDirections>& shots, const NearFieldDisc& disc,
                   BasisRegion region, double eta);

/// One picture by the directions of its own pixels.
struct SeenPicture {
  ShotDirections centre;
  std::vector<HalfDiffAngles> directions;  ///< of pixels spread evenly over the sample
  int points = 0;  ///< asked for; more than `directions` where the camera misses a part of the sample
};

/// The directions of a photograph's own pixels: about `points` places in a sunflower layout over the disc or
/// the rectangle, those that the camera has in its picture, each with its view direction.
SeenPicture seenPicture(const TwoShotCapture& capture, const TwoShotPhoto& photo, int points = 300);
/// The pictures of a bundle that a fit may read. A bracket (same camera and light) is one picture.
std::vector<SeenPicture> seenPictures(const TwoShotCapture& capture, int points = 300);
/// What these pictures are expected to do; `options.fovDeg` of the result is that of a disc as large as the
/// sample.
Plan expectationOf(const BasisPtr& basis, const TwoShotCapture& capture, BasisRegion region, double eta);

/// Sentences for the person: what the expected error means in per cent, how far the directions may be off,
/// which materials are hardest, a camera that stands in its own light.
std::vector<std::string> planRemarks(const Plan& plan);
/// An error in natural-log units as a relative one, per cent: 100 (e^x - 1).
double percentFromLn(double lnUnits);

/// plan.json and back. Keys in docs/files.md. Not kept: expected.column. Errors: WriteFailed; NotFound,
/// Malformed, Invalid.
Status writePlan(const std::filesystem::path& file, const Plan& plan);
Result<Plan> readPlan(const std::filesystem::path& file);
/// The text of plan.json, and a plan from it; `where` names it in errors. `readPlan` refuses directions that
/// are not unit vectors above the sample; angles are worked out from the directions.
std::string planJson(const Plan& plan);
Result<Plan> parsePlan(std::string_view text, const std::string& where);
/// A drawing (SVG, from the side and from above, angles written beside) for the person at the bench.
std::string drawPlanSvg(const Plan& plan);

}  // namespace patina
