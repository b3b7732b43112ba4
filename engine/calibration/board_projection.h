#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "engine/calibration/camera_calibration.h"

/// Corners of a board through a lens, with derivatives. For this folder only.
namespace patina::board_projection {

/// Where a board stands: camera = rotation(turn) * (x, -y, 0) + shiftMm, so that a board that is looked at
/// straight has no rotation at all (and not half a turn, where rotation vectors are ambiguous).
struct Stand {
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();  ///< rotation vector
  Eigen::Vector3d shiftMm = Eigen::Vector3d::Zero();
};
Stand standOf(const Eigen::Matrix3d& cameraFromBoard, const Eigen::Vector3d& translationMm);
Eigen::Matrix3d cameraFromBoard(const Stand& stand);

IntrinsicVector intrinsicsOf(const Camera& camera);
void setIntrinsics(const IntrinsicVector& values, Camera* camera);

/// Predicted minus seen, u and v in turn; derivatives by turn and shift, and by the nine of the lens.
struct Projection {
  Eigen::VectorXd residuals;
  Eigen::Matrix<double, Eigen::Dynamic, 6> byStand;
  Eigen::Matrix<double, Eigen::Dynamic, kIntrinsicCount> byLens;
};
Projection project(const Board& board, const BoardView& view, const IntrinsicVector& lens,
                   const Stand& stand);

/// Least squares over the stand alone; RMS distance in pixels. `normal` (null: not wanted) becomes J^T J.
double settle(const Board& board, const BoardView& view, const IntrinsicVector& lens, Stand* stand,
              Eigen::Matrix<double, 6, 6>* normal = nullptr);

/// The stand with the least error of the two that a plane's closed form gives. False: corners on a line.
bool findStand(const Board& board, const BoardView& view, const IntrinsicVector& lens, Stand* stand,
               double* rmsPx, Eigen::Matrix<double, 6, 6>* normal = nullptr);

/// Focal length by Zhang's constraints (2000, section 3.1) with square pixels and the principal point in the
/// middle; 0 where the views don't tell.
double guessFocalLength(const Board& board, const std::vector<const BoardView*>& views);

}  // namespace patina::board_projection
