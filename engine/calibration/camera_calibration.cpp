#include "engine/calibration/camera_calibration.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <set>

#include "engine/base/text.h"
#include "engine/calibration/board_projection.h"

namespace patina {
namespace {

using board_projection::Projection;
using board_projection::Stand;

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kIterations = 100;
constexpr std::size_t kFewestViews = 3;

struct Problem {
  const Board& board;
  std::vector<const BoardView*> views;
  std::array<bool, kIntrinsicCount> free;
  bool oneFocalLength;
};

/// The lens' free unknowns as columns of the nine: with one focal length both move together.
Eigen::MatrixXd freeColumns(const Problem& problem) {
  std::vector<IntrinsicVector> columns;
  for (int k = 0; k < kIntrinsicCount; ++k) {
    if (!problem.free[k] || (problem.oneFocalLength && k == 1)) continue;
    IntrinsicVector column = IntrinsicVector::Unit(k);
    if (problem.oneFocalLength && k == 0) column[1] = 1;
    columns.push_back(column);
  }
  Eigen::MatrixXd matrix(kIntrinsicCount, static_cast<Eigen::Index>(columns.size()));
  for (std::size_t k = 0; k < columns.size(); ++k) matrix.col(static_cast<Eigen::Index>(k)) = columns[k];
  return matrix;
}

struct Solution {
  IntrinsicVector lens;
  std::vector<Stand> stands;
  double sum = 0;
  Eigen::MatrixXd lensNormal;  ///< J^T J of the free unknowns, the poses eliminated
  bool cancelled = false;
};

/// Levenberg-Marquardt over lens and poses; the poses' blocks are eliminated (Schur).
void solve(const Problem& problem, Solution* solution, const JobContext& job) {
  const Eigen::MatrixXd columns = freeColumns(problem);
  const Eigen::Index unknowns = columns.cols();
  const std::size_t count = problem.views.size();
  const auto evaluate = [&](const IntrinsicVector& lens, const std::vector<Stand>& stands,
                            std::vector<Projection>* out) {
    out->clear();
    double sum = 0;
    for (std::size_t i = 0; i < count; ++i) {
      out->push_back(board_projection::project(problem.board, *problem.views[i], lens, stands[i]));
      sum += out->back().residuals.squaredNorm();
    }
    return sum;
  };
  std::vector<Projection> at, there;
  solution->sum = evaluate(solution->lens, solution->stands, &at);
  double damping = 1e-3;
  const auto eliminate = [&](double lambda, Eigen::MatrixXd* reduced, Eigen::VectorXd* gradient,
                             std::vector<Eigen::MatrixXd>* back, std::vector<Eigen::VectorXd>* own) {
    *reduced = Eigen::MatrixXd::Zero(unknowns, unknowns);
    *gradient = Eigen::VectorXd::Zero(unknowns);
    back->clear(), own->clear();
    for (const Projection& p : at) {
      const Eigen::MatrixXd lens = p.byLens * columns;
      Eigen::MatrixXd block = lens.transpose() * lens;
      block.diagonal() *= 1 + lambda;
      *reduced += block;
      *gradient += lens.transpose() * p.residuals;
      Eigen::Matrix<double, 6, 6> pose = p.byStand.transpose() * p.byStand;
      pose.diagonal() *= 1 + lambda;
      const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> factors(pose);
      const Eigen::MatrixXd mixed = p.byStand.transpose() * lens;
      back->push_back(factors.solve(mixed));
      own->push_back(factors.solve(p.byStand.transpose() * p.residuals));
      *reduced -= mixed.transpose() * back->back();
      *gradient -= mixed.transpose() * own->back();
    }
  };
  Eigen::MatrixXd reduced;
  Eigen::VectorXd gradient;
  std::vector<Eigen::MatrixXd> back;
  std::vector<Eigen::VectorXd> own;
  int still = 0;
  for (int iteration = 0; iteration < kIterations && still < 2; ++iteration) {
    if (job.cancelled()) {
      solution->cancelled = true;
      return;
    }
    job.progress("lens", iteration, kIterations, "steps");
    eliminate(damping, &reduced, &gradient, &back, &own);
    const Eigen::VectorXd step = -reduced.ldlt().solve(gradient);
    if (!step.allFinite()) break;
    const IntrinsicVector lens = solution->lens + columns * step;
    std::vector<Stand> stands = solution->stands;
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Matrix<double, 6, 1> move = -own[i] - back[i] * step;
      stands[i].turn += move.head<3>();
      stands[i].shiftMm += move.tail<3>();
    }
    const double sum =
        lens[0] > 0 && lens[1] > 0 ? evaluate(lens, stands, &there) : std::numeric_limits<double>::infinity();
    if (std::isfinite(sum) && sum <= solution->sum) {
      still = solution->sum - sum <= 1e-10 * solution->sum ? still + 1 : 0;
      solution->lens = lens, solution->stands = std::move(stands), solution->sum = sum;
      std::swap(at, there);
      damping = std::max(damping * 0.1, 1e-10);
    } else {
      damping *= 10;
      if (damping > 1e8) break;
    }
  }
  eliminate(0, &solution->lensNormal, &gradient, &back, &own);
}

CalibratedView judged(const Board& board, const CalibrationView& view, const IntrinsicVector& lens,
                      const Stand& stand) {
  CalibratedView out;
  out.name = view.name;
  out.used = view.use;
  const Projection at = board_projection::project(board, view.view, lens, stand);
  double sum = 0;
  for (std::size_t i = 0; i < view.view.corners.size(); ++i) {
    const Eigen::Vector2d error = -at.residuals.segment<2>(static_cast<Eigen::Index>(2 * i));
    out.errorPx.push_back(error);
    sum += error.squaredNorm();
    out.worstPx = std::max(out.worstPx, error.norm());
  }
  out.rmsPx = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, view.view.corners.size())));
  out.cameraFromBoard = board_projection::cameraFromBoard(stand);
  out.translationMm = stand.shiftMm;
  out.distanceMm = stand.shiftMm.norm();
  const Eigen::Vector3d normal = out.cameraFromBoard.col(2), toCamera = -stand.shiftMm.normalized();
  out.tiltDeg = std::acos(std::clamp(normal.dot(toCamera), -1.0, 1.0)) / kDegree;
  // The nearer side is opposite to where the normal leans in the picture; y is down there.
  const Eigen::Vector3d lean = normal - normal.dot(toCamera) * toCamera;
  out.tiltTowardsDeg = std::atan2(lean.y(), -lean.x()) / kDegree;
  if (out.tiltTowardsDeg < 0) out.tiltTowardsDeg += 360;
  return out;
}

void flagOutliers(double factor, std::vector<CalibratedView>* views) {
  std::vector<double> errors;
  for (const CalibratedView& view : *views)
    if (view.used) errors.push_back(view.rmsPx);
  if (errors.size() < 4) return;
  std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2),
                   errors.end());
  const double median = errors[errors.size() / 2];
  for (CalibratedView& view : *views) {
    if (view.rmsPx > factor * median) {
      view.outlier = true;
      char text[160];
      std::snprintf(
          text, sizeof text,
          "fits %.1f times worse than the others (%.2f px): moved, blurred or badly detected; take it out",
          view.rmsPx / median, view.rmsPx);
      view.remark = text;
    } else if (view.worstPx > 6 * median && view.worstPx > 1) {
      char text[120];
      std::snprintf(text, sizeof text, "one corner is off by %.1f px: a reflection or a fold?", view.worstPx);
      view.remark = text;
    }
  }
}

/// Largest standard deviation of where the lens puts rays, over the parts of the picture that held corners.
double predictionSd(const Camera& camera, const IntrinsicMatrix& covariance,
                    const CalibrationCoverage& coverage) {
  double worst = 0;
  const IntrinsicVector lens = board_projection::intrinsicsOf(camera);
  constexpr int kColumns = CalibrationCoverage::kColumns, kRows = CalibrationCoverage::kRows;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      if (coverage.corners[row * kColumns + column] == 0) continue;
      const Eigen::Vector2d pixel((column + 0.5) / kColumns * camera.width - 0.5,
                                  (row + 0.5) / kRows * camera.height - 0.5);
      const Eigen::Vector3d ray = camera.rayFromPixel(pixel);
      if (!(ray.z() > 0.05)) continue;
      const double x = ray.x() / ray.z(), y = ray.y() / ray.z(), r2 = x * x + y * y;
      const double r4 = r2 * r2, r6 = r4 * r2, radial = 1 + lens[4] * r2 + lens[5] * r4 + lens[8] * r6;
      const double u = x * radial + 2 * lens[6] * x * y + lens[7] * (r2 + 2 * x * x),
                   v = y * radial + lens[6] * (r2 + 2 * y * y) + 2 * lens[7] * x * y;
      Eigen::Matrix<double, 2, kIntrinsicCount> by;
      by << u, 0, 1, 0, lens[0] * x * r2, lens[0] * x * r4, lens[0] * 2 * x * y, lens[0] * (r2 + 2 * x * x),
          lens[0] * x * r6, 0, v, 0, 1, lens[1] * y * r2, lens[1] * y * r4, lens[1] * (r2 + 2 * y * y),
          lens[1] * 2 * x * y, lens[1] * y * r6;
      const Eigen::Matrix2d spread = by * covariance * by.transpose();
      worst = std::max(worst, Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(spread).eigenvalues()[1]);
    }
  }
  return std::sqrt(std::max(worst, 0.0));
}

void advise(CalibrationCoverage* coverage, std::size_t views) {
  constexpr std::size_t kEnoughViews = 10;
  constexpr int kEnoughTilted = 2;
  auto& advice = coverage->advice;
  if (coverage->greatestTiltDeg < 20)
    advice.push_back(
        "tilt the board by 20 to 45 degrees: views that are all flat don't tell the focal length");
  static constexpr const char* kSides[4] = {"right", "top", "left", "bottom"};
  for (int k = 0; k < 4; ++k)
    if (coverage->tilts[k + 1] < (k < 2 ? kEnoughTilted : 1) && coverage->greatestTiltDeg >= 20)
      advice.push_back(std::string("tilt the board so that its ") + kSides[k] +
                       " side is nearer to the camera");
  // The picture in nine parts; corners of the picture decide about distortion.
  static constexpr const char* kParts[9] = {"top left", "top",         "top right", "left",        "middle",
                                            "right",    "bottom left", "bottom",    "bottom right"};
  for (const int part : {0, 2, 6, 8, 1, 3, 5, 7, 4}) {
    const int c0 = part % 3 == 0 ? 0 : part % 3 == 1 ? 2 : 6, c1 = part % 3 == 0 ? 2 : part % 3 == 1 ? 6 : 8;
    const int r0 = part / 3 * 2, r1 = r0 + 2;
    int filled = 0, cells = 0;
    for (int row = r0; row < r1; ++row)
      for (int column = c0; column < c1; ++column) {
        ++cells;
        filled += coverage->corners[row * CalibrationCoverage::kColumns + column] > 0;
      }
    if (2 * filled < cells)
      advice.push_back(std::string("bring the board to the ") + kParts[part] + " of the picture");
  }
  if (views < kEnoughViews)
    advice.push_back(counted(kEnoughViews - views, "further view") + ", each with another tilt and place");
}

}  // namespace

CalibrationCoverage coverageOf(const Board& board, const std::vector<CalibrationView>& views,
                               const Camera* camera) {
  CalibrationCoverage coverage;
  std::vector<const BoardView*> used;
  for (const CalibrationView& view : views)
    if (view.use && !view.view.corners.empty()) used.push_back(&view.view);
  Camera guess;
  if (!camera && !used.empty()) {
    guess.width = used[0]->imageWidth, guess.height = used[0]->imageHeight;
    double focal = board_projection::guessFocalLength(board, used);
    if (!(focal > 0))
      focal = 1.2 * std::max(guess.width, guess.height);  // a field of 45 degrees, as most have
    guess.intrinsics << focal, 0, 0.5 * (guess.width - 1), 0, focal, 0.5 * (guess.height - 1), 0, 0, 1;
    camera = &guess;
  }
  std::size_t count = 0;
  for (const BoardView* view : used) {
    if (view->imageWidth != camera->width || view->imageHeight != camera->height) continue;
    ++count;
    for (const BoardCorner& corner : view->corners) {
      const int column = std::clamp(
          static_cast<int>((corner.pixel.x() + 0.5) / camera->width * CalibrationCoverage::kColumns), 0,
          CalibrationCoverage::kColumns - 1);
      const int row =
          std::clamp(static_cast<int>((corner.pixel.y() + 0.5) / camera->height * CalibrationCoverage::kRows),
                     0, CalibrationCoverage::kRows - 1);
      ++coverage.corners[row * CalibrationCoverage::kColumns + column];
    }
    Stand stand;
    double rms = 0;
    if (!board_projection::findStand(board, *view, board_projection::intrinsicsOf(*camera), &stand, &rms))
      continue;
    const CalibratedView pose =
        judged(board, {"", *view, true}, board_projection::intrinsicsOf(*camera), stand);
    coverage.greatestTiltDeg = std::max(coverage.greatestTiltDeg, pose.tiltDeg);
    coverage.nearestMm =
        coverage.nearestMm == 0 ? pose.distanceMm : std::min(coverage.nearestMm, pose.distanceMm);
    coverage.farthestMm = std::max(coverage.farthestMm, pose.distanceMm);
    const int side = static_cast<int>(std::lround(pose.tiltTowardsDeg / 90)) % 4;
    ++coverage.tilts[pose.tiltDeg < 15 ? 0 : side + 1];
  }
  int filled = 0, rim = 0, rimFilled = 0;
  for (int row = 0; row < CalibrationCoverage::kRows; ++row) {
    for (int column = 0; column < CalibrationCoverage::kColumns; ++column) {
      const bool has = coverage.corners[row * CalibrationCoverage::kColumns + column] > 0;
      const bool edge = row == 0 || column == 0 || row == CalibrationCoverage::kRows - 1 ||
                        column == CalibrationCoverage::kColumns - 1;
      filled += has, rim += edge, rimFilled += edge && has;
    }
  }
  coverage.imageShare =
      filled / static_cast<double>(CalibrationCoverage::kColumns * CalibrationCoverage::kRows);
  coverage.edgeShare = rimFilled / static_cast<double>(rim);
  advise(&coverage, count);
  return coverage;
}

Result<CameraCalibration> calibrateCamera(const Board& board, const std::vector<CalibrationView>& views,
                                          const CameraCalibrationOptions& options, const JobContext& job) {
  const auto invalid = [](const std::string& what, const std::string& where, const std::string& tryThis) {
    return Error{ErrorCode::Invalid, what, where, tryThis};
  };
  if (const auto problems = board.validate(); !problems.empty())
    return invalid(problems.front(), "board", "");
  if (options.radialTerms < 0 || options.radialTerms > 3)
    return invalid("a lens has 0 to 3 radial terms", "radial terms", "");
  Problem problem{board, {}, {}, options.oneFocalLength};
  std::vector<std::size_t> usedAt;
  const BoardView* first = nullptr;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const CalibrationView& view = views[i];
    for (const BoardCorner& corner : view.view.corners)
      if (corner.id < 0 || corner.id >= board.cornerCount() || !corner.pixel.allFinite())
        return invalid("a corner is none of this board's", view.name, "detect the board again");
    if (!first) first = &view.view;
    if (view.view.imageWidth != first->imageWidth || view.view.imageHeight != first->imageHeight)
      return invalid("the photographs are not of one size: " + std::to_string(view.view.imageWidth) + " x " +
                         std::to_string(view.view.imageHeight) + " and " + std::to_string(first->imageWidth) +
                         " x " + std::to_string(first->imageHeight),
                     view.name, "photographs of one camera, upright or lying, not both");
    if (view.view.mirrored)
      return invalid("the board is seen in a mirror", view.name, "leave this photograph out");
    if (view.use && view.view.corners.size() >= 4) problem.views.push_back(&view.view), usedAt.push_back(i);
  }
  if (problem.views.size() < kFewestViews)
    return invalid("a lens needs at least " + std::to_string(kFewestViews) +
                       " views of the board, and there are " + std::to_string(problem.views.size()),
                   "", "10 to 20 views, tilted to all sides and in all parts of the picture");
  problem.free = {true,
                  true,
                  true,
                  true,
                  options.radialTerms > 0,
                  options.radialTerms > 1,
                  options.tangential,
                  options.tangential,
                  options.radialTerms > 2};

  const double focal = board_projection::guessFocalLength(board, problem.views);
  if (!(focal > 0))
    return invalid(
        "these views don't tell the focal length: the board is parallel to the picture in all of them", "",
        "views with the board tilted by 20 to 45 degrees");
  Solution solution;
  solution.lens << focal, focal, 0.5 * (first->imageWidth - 1), 0.5 * (first->imageHeight - 1), 0, 0, 0, 0, 0;
  for (std::size_t i = 0; i < problem.views.size(); ++i) {
    Stand stand;
    double rms = 0;
    if (!board_projection::findStand(board, *problem.views[i], solution.lens, &stand, &rms))
      return invalid("the corners that are seen are all on a line, or make no picture of a board",
                     views[usedAt[i]].name, "leave this photograph out");
    solution.stands.push_back(stand);
  }
  // First what every lens has: distortion's higher terms bend a bad start the wrong way.
  Problem simple = problem;
  for (int k = 2; k < kIntrinsicCount; ++k) simple.free[k] = k == 4 && problem.free[4];
  simple.oneFocalLength = true;
  solve(simple, &solution, job);
  if (!solution.cancelled) solve(problem, &solution, job);
  if (solution.cancelled) return Error{ErrorCode::Cancelled, "the calibration was cancelled", "", ""};

  CameraCalibration result;
  result.camera.width = first->imageWidth, result.camera.height = first->imageHeight;
  board_projection::setIntrinsics(solution.lens, &result.camera);
  std::size_t corners = 0;
  for (const BoardView* view : problem.views) corners += view->corners.size();
  result.rmsPx = std::sqrt(solution.sum / static_cast<double>(corners));
  const Eigen::MatrixXd columns = freeColumns(problem);
  const double freedom = 2.0 * static_cast<double>(corners) -
                         6.0 * static_cast<double>(problem.views.size()) -
                         static_cast<double>(columns.cols());
  // The unknowns differ by many orders; scaled by their own weight, singular means undetermined.
  const Eigen::VectorXd scale = solution.lensNormal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * solution.lensNormal * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> spectrum(scaled);
  if (!(freedom > 0) || !(spectrum.eigenvalues()[0] > 1e-12) || !std::isfinite(solution.sum))
    return invalid("these views don't determine the lens", "",
                   "more views, tilted to all sides; or fewer radial terms");
  result.cornerSdPx = std::sqrt(solution.sum / freedom);
  const Eigen::MatrixXd inverse = scale.asDiagonal() * spectrum.eigenvectors() *
                                  spectrum.eigenvalues().cwiseInverse().asDiagonal() *
                                  spectrum.eigenvectors().transpose() * scale.asDiagonal();
  result.covariance = columns * inverse * columns.transpose() * (result.cornerSdPx * result.cornerSdPx);
  result.sd = result.covariance.diagonal().cwiseMax(0).cwiseSqrt();

  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto at = std::find(usedAt.begin(), usedAt.end(), i);
    Stand stand;
    double rms = 0;
    if (at != usedAt.end()) {
      stand = solution.stands[static_cast<std::size_t>(at - usedAt.begin())];
    } else if (!board_projection::findStand(board, views[i].view, solution.lens, &stand, &rms)) {
      CalibratedView empty;
      empty.name = views[i].name, empty.used = false;
      empty.remark = "too few corners";
      result.views.push_back(std::move(empty));
      continue;
    }
    result.views.push_back(judged(board, views[i], solution.lens, stand));
  }
  flagOutliers(options.outlierFactor, &result.views);
  result.coverage = coverageOf(board, views, &result.camera);
  result.predictionSdPx = predictionSd(result.camera, result.covariance, result.coverage);

  char text[200];
  if (result.rmsPx > 1) {
    std::snprintf(text, sizeof text,
                  "corners miss their predictions by %.2f px: is the board flat, the right one, and was the "
                  "focus fixed?",
                  result.rmsPx);
    result.warnings.push_back(text);
  }
  if (result.predictionSdPx > 1) {
    std::snprintf(text, sizeof text,
                  "these views leave the lens uncertain by up to %.1f px; add the views that are advised",
                  result.predictionSdPx);
    result.warnings.push_back(text);
  }
  if (std::abs(result.camera.intrinsics(0, 2) / result.camera.width - 0.5) > 0.15 ||
      std::abs(result.camera.intrinsics(1, 2) / result.camera.height - 0.5) > 0.15)
    result.warnings.push_back(
        "the lens' axis is far from the middle of the picture: a cropped picture, or too few views");
  return result;
}

Result<BoardPose> poseOfBoard(const Camera& camera, const Board& board, const BoardView& view) {
  if (view.imageWidth != camera.width || view.imageHeight != camera.height)
    return Error{ErrorCode::Invalid,
                 "the photograph has " + std::to_string(view.imageWidth) + " x " +
                     std::to_string(view.imageHeight) + " pixels and the camera was calibrated with " +
                     std::to_string(camera.width) + " x " + std::to_string(camera.height),
                 "", "photograph at the calibration's resolution"};
  for (const BoardCorner& corner : view.corners)
    if (corner.id < 0 || corner.id >= board.cornerCount())
      return Error{ErrorCode::Invalid, "a corner is none of this board's", "", "detect the board again"};
  Stand stand;
  BoardPose pose;
  Eigen::Matrix<double, 6, 6> normal;
  if (!board_projection::findStand(board, view, board_projection::intrinsicsOf(camera), &stand, &pose.rmsPx,
                                   &normal))
    return Error{
        ErrorCode::Invalid,
        "the " + counted(view.corners.size(), "corner") + " that are seen don't tell where the board stands",
        "", "more of the board in the picture"};
  pose.cameraFromBoard = board_projection::cameraFromBoard(stand);
  pose.translationMm = stand.shiftMm;
  const double freedom = 2.0 * static_cast<double>(view.corners.size()) - 6;
  const double variance =
      freedom > 0 ? pose.rmsPx * pose.rmsPx * static_cast<double>(view.corners.size()) / freedom : 0;
  const Eigen::Matrix<double, 6, 6> covariance = variance * normal.inverse();
  const auto worst = [](const Eigen::Matrix3d& block) {
    return std::sqrt(std::max(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(block).eigenvalues()[2]));
  };
  pose.angleSdDeg = worst(covariance.topLeftCorner<3, 3>()) / kDegree;
  pose.positionSdMm = worst(covariance.bottomRightCorner<3, 3>());
  return pose;
}

Camera cameraOverBoard(const Camera& camera, const BoardPose& pose) {
  Camera placed = camera;
  placed.cameraFromWorld = pose.cameraFromBoard;
  placed.translationMm = pose.translationMm;
  return placed;
}

}  // namespace patina
