#include "engine/calibration/board.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>

#include "engine/base/text.h"
#include "engine/calibration/markers.h"

namespace patina {
namespace {

constexpr int kFewestSquares = 3, kMostSquares = 64;
constexpr double kSmallestSquareMm = 0.1, kLargestSquareMm = 10000;
// A marker needs a white rim to be told from the black squares, and cells large enough to be read.
constexpr double kSmallestShare = 0.3, kLargestShare = 0.85;

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts;
  std::size_t from = 0;
  for (std::size_t to; (to = text.find(at, from)) != std::string::npos; from = to + 1)
    parts.push_back(text.substr(from, to - from));
  parts.push_back(text.substr(from));
  return parts;
}

bool readNumber(const std::string& text, double* out) {
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), *out);
  return code == std::errc() && end == text.data() + text.size() && std::isfinite(*out);
}
bool readInteger(const std::string& text, int* out) {
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), *out);
  return code == std::errc() && end == text.data() + text.size();
}

/// Shortest text that reads back as the same number.
std::string shortest(double value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

}  // namespace

Eigen::Vector2d Board::cornerMm(int id) const {
  const int column = id % cornersX(), row = id / cornersX();
  return {(column + 1 - 0.5 * squaresX) * squareMm, (0.5 * squaresY - (row + 1)) * squareMm};
}

int Board::markerAt(int column, int row) const {
  if (kind != BoardKind::Charuco || (column + row) % 2 == 0) return -1;
  // Black squares are those whose column and row add up to an even number.
  const int before = row * squaresX + column;
  // White ones among the first n squares, row by row: of whole rows alternately floor and ceiling of half.
  int count = 0;
  if (squaresX % 2 == 0) {
    count = row * (squaresX / 2) + column / 2;
  } else {
    count = before / 2;
  }
  return firstMarker + count;
}

std::vector<std::string> Board::validate() const {
  std::vector<std::string> problems;
  if (std::min(squaresX, squaresY) < kFewestSquares || std::max(squaresX, squaresY) > kMostSquares)
    problems.push_back("a board has 3 to 64 squares a side");
  if (!(squareMm >= kSmallestSquareMm && squareMm <= kLargestSquareMm))
    problems.push_back("squares are 0.1 to 10000 mm wide");
  if (kind != BoardKind::Charuco) return problems;
  if (!(markerShare >= kSmallestShare && markerShare <= kLargestShare))
    problems.push_back("markers are 0.3 to 0.85 of a square wide");
  const MarkerDictionary* codes = markerDictionary(dictionary);
  if (!codes) {
    const std::string nearest = nearestWord(dictionary, markerDictionaries());
    problems.push_back("there is no marker dictionary " + inQuotes(dictionary) +
                       (nearest.empty() ? "" : "; do you mean " + nearest + "?"));
  } else if (firstMarker < 0 || firstMarker + static_cast<std::int64_t>(markerCount()) >
                                    static_cast<std::int64_t>(codes->codes.size())) {
    problems.push_back("the dictionary " + dictionary + " has " + std::to_string(codes->codes.size()) +
                       " markers, and " + std::to_string(markerCount()) + " from number " +
                       std::to_string(firstMarker) + " on are needed");
  }
  return problems;
}

std::string Board::inWords() const {
  char text[160];
  if (kind == BoardKind::Checkerboard) {
    std::snprintf(text, sizeof text, "checkerboard of %d x %d squares of %.2f mm", squaresX, squaresY,
                  squareMm);
    return text;
  }
  std::snprintf(text, sizeof text, "ChArUco board of %d x %d squares of %.2f mm, markers %d to %d of %.20s",
                squaresX, squaresY, squareMm, firstMarker, firstMarker + markerCount() - 1,
                dictionary.c_str());
  return text;
}

Board Board::forCamera() {
  Board board;
  board.squaresX = 11, board.squaresY = 8, board.squareMm = 22;
  return board;
}

Board Board::forSamplePlane() {
  Board board;
  board.squaresX = 7, board.squaresY = 5, board.squareMm = 12;
  board.firstMarker = 64;
  return board;
}

Board Board::forScreen(double screenWidthMm, double screenHeightMm) {
  Board board;
  board.squaresX = 12, board.squaresY = 7;
  board.firstMarker = 128;
  // Half a square is left around it: the rim of the lit area would hide the outer edge.
  board.squareMm = std::min(screenWidthMm / (board.squaresX + 1), screenHeightMm / (board.squaresY + 1));
  return board;
}

Result<Board> parseBoard(const std::string& text, const std::string& where) {
  const auto wrong = [&](const std::string& what) {
    return Error{ErrorCode::Invalid, what, where + " " + inQuotes(text),
                 "checkerboard:10x7:25 or charuco:9x7:20 (squares, millimetres)"};
  };
  const std::vector<std::string> parts = split(text, ':');
  Board board;
  if (parts[0] == "checkerboard") {
    board.kind = BoardKind::Checkerboard;
  } else if (parts[0] != "charuco") {
    return wrong("a board is a checkerboard or charuco");
  }
  if (parts.size() < 3 || parts.size() > (board.kind == BoardKind::Charuco ? 6u : 3u))
    return wrong("a board is told by its kind, its squares and their size");
  const std::vector<std::string> squares = split(parts[1], 'x');
  if (squares.size() != 2 || !readInteger(squares[0], &board.squaresX) ||
      !readInteger(squares[1], &board.squaresY))
    return wrong("the number of squares is not two whole numbers");
  if (!readNumber(parts[2], &board.squareMm)) return wrong("the size of a square is not a number");
  if (parts.size() > 3 && !readNumber(parts[3], &board.markerShare))
    return wrong("the markers' share of a square is not a number");
  if (parts.size() > 4) board.dictionary = parts[4];
  if (parts.size() > 5 && !readInteger(parts[5], &board.firstMarker))
    return wrong("the first marker is not a whole number");
  std::string problems;
  for (const std::string& problem : board.validate()) problems += (problems.empty() ? "" : "; ") + problem;
  if (!problems.empty()) return wrong(problems);
  return board;
}

std::string boardText(const Board& board) {
  std::string text = board.kind == BoardKind::Checkerboard ? "checkerboard:" : "charuco:";
  text +=
      std::to_string(board.squaresX) + "x" + std::to_string(board.squaresY) + ":" + shortest(board.squareMm);
  if (board.kind == BoardKind::Charuco)
    text +=
        ":" + shortest(board.markerShare) + ":" + board.dictionary + ":" + std::to_string(board.firstMarker);
  return text;
}

}  // namespace patina
