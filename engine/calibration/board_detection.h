#pragma once

#include <Eigen/Core>
#include <chrono>
#include <stop_token>
#include <string>
#include <vector>

#include "engine/calibration/board.h"
#include "engine/image/image.h"

namespace patina {

/// A corner of a board in a photograph.
struct BoardCorner {
  int id = 0;                                       ///< Board::cornerMm
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  ///< centres at whole numbers
};

/// Where a photograph shows a board.
struct BoardView {
  int imageWidth = 0, imageHeight = 0;
  std::vector<BoardCorner> corners;  ///< ascending ids
  bool mirrored = false;             ///< seen in a mirror: left and right are swapped
};

/// What to look for beside the board as it is.
enum class BoardSide {
  Direct,    ///< not in a mirror
  Mirrored,  ///< in a mirror only
  Either,    ///< whichever is there, the direct one first
};

struct BoardDetectionOptions {
  BoardSide side = BoardSide::Direct;        ///< checkerboards: Direct only
  std::chrono::milliseconds timeLimit{500};  ///< no further attempt starts after it; more finds smaller or
                                             ///< dimmer boards. A first attempt always runs (about 30 ms)
  int fewestCorners = 8;                     ///< of a ChArUco board; fewer are not called found
};

/// What was found, or why not, in words that tell what to do.
struct BoardDetection {
  bool found = false;
  BoardView view;                      ///< where not found: what there is of it, for drawing
  std::vector<Eigen::Vector2d> loose;  ///< corners of squares that belong to nothing, for drawing
  std::vector<int> markers;            ///< ids that were read
  std::string whyNot;  ///< "12 of 54 corners are seen: the board is cut off or covered"; empty where found
  double sharpnessPx = 0;   ///< standard deviation of the edges' blur, median; 0: not known
  double contrast = 0;      ///< white minus black of the squares over white; 0: not known
  double clippedShare = 0;  ///< share of the picture at its largest value
  std::chrono::milliseconds took{0};
};

/// Looks for the board in a photograph: linear or encoded alike (corners don't move with the tone curve), 1
/// or 3 channels, any scale. Saddle points of the brightness are found, joined to a grid, its squares read;
/// each corner is then refined where the brightness is symmetric about it (0.02 to 0.1 pixels, by sharpness).
/// Never fails: a photograph without a board is an answer. Threading: any. Cost: 20 to 60 ms a megapixel;
/// `timeLimit` and `stop` are looked at between attempts and rows.
BoardDetection detectBoard(const Image& photo, const Board& board, const BoardDetectionOptions& options = {},
                           std::stop_token stop = {});

}  // namespace patina
