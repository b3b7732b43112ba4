#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/image/image.h"

namespace patina {

enum class BoardKind {
  Checkerboard,  ///< squares only: the whole of it must be seen
  Charuco,       ///< markers in the white squares: a part of it is enough, and a mirrored one is told apart
};

/// A flat board of squares, printed or shown on a screen. Board frame: x right and y up as drawn, origin in
/// the middle of the squares, +z out of the board towards who looks at it: laid on the sample plane it is the
/// world frame, shown in the middle of a screen it is the screen's. The square at the top left is black.
struct Board {
  BoardKind kind = BoardKind::Charuco;
  int squaresX = 9, squaresY = 7;      ///< squares, not corners; 3 to 64 each
  double squareMm = 20;                ///< side of a square
  double markerShare = 0.6;            ///< side of a marker (its black border included) over that of a square
  std::string dictionary = "6x6_250";  ///< one of `markerDictionaries()`
  int firstMarker = 0;                 ///< id of the marker in the first white square; then row by row
  int cornersX() const { return squaresX - 1; }
  int cornersY() const { return squaresY - 1; }
  int cornerCount() const { return cornersX() * cornersY(); }
  double widthMm() const { return squaresX * squareMm; }
  double heightMm() const { return squaresY * squareMm; }
  /// How many markers it has: one in each white square.
  int markerCount() const { return kind == BoardKind::Charuco ? squaresX * squaresY / 2 : 0; }
  /// Inner corner in the board's frame, mm. Ids run row by row from the top left.
  Eigen::Vector2d cornerMm(int id) const;
  /// Marker id of the square in that column and row from the top left; -1: a black square.
  int markerAt(int column, int row) const;
  /// Every problem with the values; empty when usable.
  std::vector<std::string> validate() const;
  /// "ChArUco board of 9 x 7 squares of 20.00 mm, markers 0 to 30 of 6x6_250".
  std::string inWords() const;

  /// The board that the program prints for the camera calibration (A4), the one that lies on the sample plane
  /// beside the mirror, and the one that is shown on the screen: their markers differ, so that one photograph
  /// can hold all of them.
  static Board forCamera();
  static Board forSamplePlane();
  static Board forScreen(double screenWidthMm, double screenHeightMm);
  bool operator==(const Board&) const = default;
};

/// "checkerboard:10x7:25" or "charuco:9x7:20", squares and the side in mm; then optionally
/// ":SHARE:DICTIONARY:FIRST". Errors: Invalid (each problem named), `where` names the option.
Result<Board> parseBoard(const std::string& text, const std::string& where);
/// The text that `parseBoard` reads.
std::string boardText(const Board& board);

/// "4x4_50" ... "7x7_250".
std::vector<std::string> markerDictionaries();

/// Paper to print on; margins are what is left around the board, at least 5 mm.
struct PrintOptions {
  double paperWidthMm = 297, paperHeightMm = 210;  ///< A4, lying
  bool withRuler = true;  ///< 100 mm lines along two sides, to check what the printer did with the scale, and
                          ///< a line that says what it is
};

/// The board to true scale, as SVG (sizes in mm) or PDF (vector, one page). Errors: Invalid (the board, or a
/// board that the paper doesn't hold).
Result<std::string> drawBoardSvg(const Board& board, const PrintOptions& options = {});
Result<std::string> drawBoardPdf(const Board& board, const PrintOptions& options = {});
/// The board as pixels, 0 or 1, one channel: `pixelsPerSquare` a side of a square and a white margin of
/// `marginPx` around it; each marker's side is rounded to a whole number of pixels a cell, and `board` is
/// given the share that it really has. For a screen. Errors: Invalid (the board; a marker cell under one
/// pixel; over 2^26 pixels).
Result<Image> drawBoardPixels(Board& board, int pixelsPerSquare, int marginPx);

}  // namespace patina
