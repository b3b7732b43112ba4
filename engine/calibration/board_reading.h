#pragma once

#include <Eigen/Core>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "engine/calibration/board.h"
#include "engine/calibration/board_detection.h"
#include "engine/calibration/corner_finder.h"

namespace patina {

/// A grid of corners with places in the whole picture, before it is known which board it is of.
struct CornerGrid {
  std::map<std::pair<int, int>, Eigen::Vector2d> corners;  ///< by column and row
  bool evenDark = true;  ///< the square after (+column, +row of) a corner is dark where column + row is even

  bool has(int column, int row) const { return corners.contains({column, row}); }
  bool dark(int column, int row) const { return ((column + row) % 2 == 0) == evenDark; }
  /// Distance to the nearest neighbour in the grid, pixels; 0 without one.
  double spacing(int column, int row) const;
  /// Where that corner should be by its neighbours' lines; false where they don't tell.
  bool predict(int column, int row, Eigen::Vector2d* pixel) const;
};

/// Which corners of a board the grid's are.
struct GridReading {
  std::vector<BoardCorner> corners;  ///< ascending ids
  std::vector<int> markers;
  bool mirrored = false;
  double votes = 0;
};

/// The grid as a whole checkerboard, turned so that ids run as on the board; false: it isn't one.
bool readCheckerboard(const CornerGrid& grid, const Board& board, GridReading* reading);

/// Reads the markers in the grid's squares and finds the place that most of them agree on. `votes` 0: none.
GridReading readMarkers(const CornerGrid& grid, const GreyPicture& picture, const Board& board,
                        bool mirrored);

}  // namespace patina
