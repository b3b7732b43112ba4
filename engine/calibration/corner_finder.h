#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

namespace patina {

/// A one-channel picture at one scale, brightness 0 to 1, and how to sample it.
struct GreyPicture {
  int width = 0, height = 0;
  std::span<const float> samples;  ///< row by row
  /// Linear between centres; the rim's value beyond it.
  float at(double x, double y) const;
};

/// A point where four corners of dark and bright meet.
struct SaddlePoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  /// Directions along which the edges leave, radians, ascending in 0..2 pi in the picture (y down). The
  /// sector from `edgeRad[k]` to the next is bright where `brightSector[k]`.
  std::array<double, 4> edgeRad{};
  std::array<bool, 4> brightSector{};
  double contrast = 0;  ///< bright minus dark sectors
  double strength = 0;
};

/// Saddle points of the picture that look like corners of a chess board in a circle of five pixels, strongest
/// first, at most `most`.
std::vector<SaddlePoint> findSaddlePoints(const GreyPicture& picture, std::size_t most,
                                          const std::stop_token& stop);

/// Whether the brightness around `point->pixel` is that of a corner; its edges, sectors and contrast are
/// filled.
bool describeSaddle(const GreyPicture& picture, SaddlePoint* point);

/// A corner with its place in a grid. `quarter`: edgeRad[k] points along the grid's direction
/// (k + quarter) mod 4 of +column, +row, -column, -row.
struct GridCorner {
  int saddle = 0;
  int column = 0, row = 0;
  int quarter = 0;
};

/// Joins saddle points that an edge connects (dark on one side all along, bright on the other) to grids; the
/// largest first, those of fewer than four corners left out. Columns and rows turn as x and y of the picture
/// do: a grid seen in a mirror is one too, and only what stands in its squares can tell.
std::vector<std::vector<GridCorner>> joinToGrids(const GreyPicture& picture,
                                                 const std::vector<SaddlePoint>& saddles,
                                                 const std::stop_token& stop);

}  // namespace patina
