#include "engine/calibration/board_projection.h"

#include <Eigen/Cholesky>
#include <Eigen/SVD>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

namespace patina::board_projection {
namespace {

const Eigen::Matrix3d kTurnedOver = Eigen::Vector3d(1, -1, -1).asDiagonal();

/// Corners in the turned-over board frame of `Stand`; a mirrored board has its x the other way.
std::vector<cv::Point3d> pointsOf(const Board& board, const BoardView& view) {
  std::vector<cv::Point3d> points;
  for (const BoardCorner& corner : view.corners) {
    const Eigen::Vector2d mm = board.cornerMm(corner.id);
    points.emplace_back(view.mirrored ? -mm.x() : mm.x(), -mm.y(), 0);
  }
  return points;
}

cv::Matx33d matrixOf(const IntrinsicVector& lens) {
  return {lens[0], 0, lens[2], 0, lens[1], lens[3], 0, 0, 1};
}
std::vector<double> distortionOf(const IntrinsicVector& lens) {
  return {lens[4], lens[5], lens[6], lens[7], lens[8]};
}

}  // namespace

Stand standOf(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translationMm) {
  const Eigen::AngleAxisd turn(rotation * kTurnedOver);
  return {turn.angle() * turn.axis(), translationMm};
}

Eigen::Matrix3d cameraFromBoard(const Stand& stand) {
  const double angle = stand.turn.norm();
  if (angle == 0) return kTurnedOver;
  return Eigen::AngleAxisd(angle, stand.turn / angle).toRotationMatrix() * kTurnedOver;
}

IntrinsicVector intrinsicsOf(const Camera& camera) {
  IntrinsicVector values;
  values << camera.intrinsics(0, 0), camera.intrinsics(1, 1), camera.intrinsics(0, 2),
      camera.intrinsics(1, 2), camera.distortion;
  return values;
}

void setIntrinsics(const IntrinsicVector& values, Camera* camera) {
  camera->intrinsics << values[0], 0, values[2], 0, values[1], values[3], 0, 0, 1;
  camera->distortion = values.tail<5>();
}

Projection project(const Board& board, const BoardView& view, const IntrinsicVector& lens,
                   const Stand& stand) {
  Projection out;
  const auto count = static_cast<Eigen::Index>(view.corners.size());
  std::vector<cv::Point2d> pixels;
  cv::Mat jacobian;
  const cv::Vec3d turn(stand.turn.x(), stand.turn.y(), stand.turn.z()),
      shift(stand.shiftMm.x(), stand.shiftMm.y(), stand.shiftMm.z());
  cv::projectPoints(pointsOf(board, view), turn, shift, matrixOf(lens), distortionOf(lens), pixels, jacobian);
  out.residuals.resize(2 * count);
  out.byStand.resize(2 * count, 6);
  out.byLens.resize(2 * count, kIntrinsicCount);
  for (Eigen::Index i = 0; i < count; ++i) {
    out.residuals[2 * i] = pixels[i].x - view.corners[i].pixel.x();
    out.residuals[2 * i + 1] = pixels[i].y - view.corners[i].pixel.y();
  }
  for (Eigen::Index row = 0; row < 2 * count; ++row) {
    const double* values = jacobian.ptr<double>(static_cast<int>(row));
    for (int k = 0; k < 6; ++k) out.byStand(row, k) = values[k];
    for (int k = 0; k < kIntrinsicCount; ++k) out.byLens(row, k) = values[6 + k];
  }
  return out;
}

double settle(const Board& board, const BoardView& view, const IntrinsicVector& lens, Stand* stand,
              Eigen::Matrix<double, 6, 6>* normal) {
  Projection at = project(board, view, lens, *stand);
  double sum = at.residuals.squaredNorm(), damping = 1e-4;
  for (int iteration = 0; iteration < 50; ++iteration) {
    Eigen::Matrix<double, 6, 6> damped = at.byStand.transpose() * at.byStand;
    damped.diagonal() *= 1 + damping;
    const Eigen::Matrix<double, 6, 1> step = -damped.ldlt().solve(at.byStand.transpose() * at.residuals);
    const Stand trial{stand->turn + step.head<3>(), stand->shiftMm + step.tail<3>()};
    if (!step.allFinite()) break;
    const Projection there = project(board, view, lens, trial);
    const double trialSum = there.residuals.squaredNorm();
    if (std::isfinite(trialSum) && trialSum <= sum) {
      const bool still = sum - trialSum <= 1e-12 * sum;
      *stand = trial, at = there, sum = trialSum;
      damping = std::max(damping * 0.1, 1e-12);
      if (still) break;
    } else {
      damping *= 10;
      if (damping > 1e8) break;
    }
  }
  if (normal) *normal = at.byStand.transpose() * at.byStand;
  return std::sqrt(sum / static_cast<double>(view.corners.size()));
}

bool findStand(const Board& board, const BoardView& view, const IntrinsicVector& lens, Stand* stand,
               double* rmsPx, Eigen::Matrix<double, 6, 6>* normal) {
  const auto count = static_cast<Eigen::Index>(view.corners.size());
  if (count < 4) return false;
  Eigen::MatrixXd spread(count, 2);
  for (Eigen::Index i = 0; i < count; ++i) spread.row(i) = board.cornerMm(view.corners[i].id).transpose();
  spread.rowwise() -= spread.colwise().mean().eval();
  const Eigen::Vector2d singular = Eigen::JacobiSVD<Eigen::MatrixXd>(spread).singularValues();
  // On a line; the second direction must span a square at least for a pose to mean anything.
  if (!(singular[1] > 0.3 * board.squareMm)) return false;
  std::vector<cv::Point2d> pixels;
  for (const BoardCorner& corner : view.corners) pixels.emplace_back(corner.pixel.x(), corner.pixel.y());
  std::vector<cv::Mat> turns, shifts;
  try {
    cv::solvePnPGeneric(pointsOf(board, view), pixels, matrixOf(lens), distortionOf(lens), turns, shifts,
                        false, cv::SOLVEPNP_IPPE);
  } catch (const cv::Exception&) {
    return false;
  }
  *rmsPx = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < turns.size(); ++i) {
    Stand trial{{turns[i].at<double>(0), turns[i].at<double>(1), turns[i].at<double>(2)},
                {shifts[i].at<double>(0), shifts[i].at<double>(1), shifts[i].at<double>(2)}};
    if (!trial.turn.allFinite() || !trial.shiftMm.allFinite()) continue;
    Eigen::Matrix<double, 6, 6> here;
    const double rms = settle(board, view, lens, &trial, &here);
    // A board behind the camera, or seen from its back, is a solution of the equations and not of the world.
    if (!(trial.shiftMm.z() > 0) || !std::isfinite(rms)) continue;
    if (rms < *rmsPx) {
      *rmsPx = rms, *stand = trial;
      if (normal) *normal = here;
    }
  }
  return std::isfinite(*rmsPx);
}

double guessFocalLength(const Board& board, const std::vector<const BoardView*>& views) {
  // With w = (1/f^2, 1/f^2, 1) on the diagonal: h1.w.h2 = 0 and h1.w.h1 = h2.w.h2, linear in 1/f^2.
  double products = 0, squares = 0;
  for (const BoardView* view : views) {
    std::vector<cv::Point2d> from, to;
    for (const BoardCorner& corner : view->corners) {
      const Eigen::Vector2d mm = board.cornerMm(corner.id) / board.squareMm;
      from.emplace_back(mm.x(), -mm.y());
      to.emplace_back(corner.pixel.x() - 0.5 * (view->imageWidth - 1),
                      corner.pixel.y() - 0.5 * (view->imageHeight - 1));
    }
    if (from.size() < 4) continue;
    cv::Mat h;
    try {
      h = cv::findHomography(from, to);
    } catch (const cv::Exception&) {
      continue;
    }
    if (h.empty()) continue;
    const double size = std::max(view->imageWidth, view->imageHeight);
    double a[3], b[3];
    for (int k = 0; k < 3; ++k) {
      const double unit = k < 2 ? size : 1;
      a[k] = h.at<double>(k, 0) / unit, b[k] = h.at<double>(k, 1) / unit;
    }
    const double norm = std::hypot(std::hypot(a[0], a[1]), a[2]) * std::hypot(std::hypot(b[0], b[1]), b[2]);
    const double left[2] = {(a[0] * b[0] + a[1] * b[1]) / norm,
                            (a[0] * a[0] + a[1] * a[1] - b[0] * b[0] - b[1] * b[1]) / norm};
    const double right[2] = {-a[2] * b[2] / norm, (b[2] * b[2] - a[2] * a[2]) / norm};
    for (int k = 0; k < 2; ++k) products += left[k] * right[k], squares += left[k] * left[k];
  }
  if (views.empty() || !(squares > 0)) return 0;
  const double inverse = products / squares;  // (size / f)^2
  const double size = std::max(views[0]->imageWidth, views[0]->imageHeight);
  // Beyond these no lens: the views are parallel to the picture and tell nothing.
  if (!(inverse > 0.0025 && inverse < 100)) return 0;
  return size / std::sqrt(inverse);
}

}  // namespace patina::board_projection
