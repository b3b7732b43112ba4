#include "engine/calibration/board.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>
#include <set>

namespace patina {
namespace {

using testing::HasSubstr;

TEST(Board, NumbersCornersFromTheTopLeft) {
  const Board board{BoardKind::Checkerboard, 10, 7, 20};
  EXPECT_EQ(board.cornerCount(), 54);
  // Nine columns and six rows of corners about the middle.
  EXPECT_EQ(board.cornerMm(0), Eigen::Vector2d(-80, 50));
  EXPECT_EQ(board.cornerMm(8), Eigen::Vector2d(80, 50));
  EXPECT_EQ(board.cornerMm(53), Eigen::Vector2d(80, -50));
}

TEST(Board, PutsOneMarkerInEachWhiteSquare) {
  for (const auto& [columns, rows] : {std::pair(7, 5), {8, 6}, {9, 6}, {6, 7}}) {
    Board board;
    board.squaresX = columns, board.squaresY = rows, board.firstMarker = 3;
    std::set<int> ids;
    int last = 2;
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        const int id = board.markerAt(column, row);
        if ((row + column) % 2 == 0) {
          EXPECT_EQ(id, -1);
          continue;
        }
        EXPECT_EQ(id, ++last);
        ids.insert(id);
      }
    }
    EXPECT_EQ(static_cast<int>(ids.size()), board.markerCount());
  }
}

TEST(Board, IsReadFromItsText) {
  const Result<Board> board = parseBoard("charuco:7x5:30:0.5:6x6_250:17", "--board");
  ASSERT_TRUE(board.ok()) << board.error().sentence();
  EXPECT_EQ(board->squaresX, 7);
  EXPECT_EQ(board->markerShare, 0.5);
  EXPECT_EQ(board->firstMarker, 17);
  EXPECT_EQ(*parseBoard(boardText(*board), ""), *board);
  const Result<Board> checkers = parseBoard("checkerboard:10x7:25", "");
  ASSERT_TRUE(checkers.ok());
  EXPECT_EQ(boardText(*checkers), "checkerboard:10x7:25");
  for (const char* wrong :
       {"", "chess:3x3:1", "checkerboard:10:25", "checkerboard:2x7:25", "checkerboard:10x7:-1",
        "charuco:9x7:20:0.99", "charuco:9x7:20:0.6:6x6_25", "charuco:60x60:5", "checkerboard:10x7:25:1"})
    EXPECT_FALSE(parseBoard(wrong, "--board").ok()) << wrong;
  EXPECT_THAT(parseBoard("charuco:9x7:20:0.6:6x6-250", "--board").error().what, HasSubstr("6x6_250"));
}

TEST(Board, IsDrawnToScale) {
  const Board board{BoardKind::Checkerboard, 10, 7, 20};
  const Result<std::string> svg = drawBoardSvg(board);
  ASSERT_TRUE(svg.ok()) << svg.error().sentence();
  EXPECT_THAT(*svg, HasSubstr("width=\"297mm\" height=\"210mm\" viewBox=\"0 0 297 210\""));
  // The top left square is black, 200 x 140 mm in the middle of the paper: at (48.5, 35).
  EXPECT_THAT(*svg, HasSubstr("M48.5 35h20v20h-20z"));
  EXPECT_THAT(*svg, HasSubstr("M88.5 35h20v20h-20z"));
  EXPECT_THAT(*svg, HasSubstr("100 mm long"));
  const Result<std::string> pdf = drawBoardPdf(board);
  ASSERT_TRUE(pdf.ok());
  EXPECT_TRUE(pdf->starts_with("%PDF-1.4"));
  EXPECT_THAT(*pdf, HasSubstr("/MediaBox [0 0 841.88976 595.27559]"));
  EXPECT_THAT(*pdf, HasSubstr("48.5 155 20 20 re"));
  // The cross-reference table points at the objects.
  const std::size_t start = pdf->find("xref\n0 6\n");
  ASSERT_NE(start, std::string::npos);
  for (int object = 1; object <= 5; ++object) {
    const std::size_t at = std::stoul(pdf->substr(start + 9 + 20 * object, 10));
    EXPECT_EQ(pdf->substr(at, 7), std::to_string(object) + " 0 obj");
  }
  Board large = board;
  large.squareMm = 40;
  EXPECT_THAT(drawBoardPdf(large).error().what, HasSubstr("paper"));
}

TEST(Board, HasPixelsWithWholeCells) {
  Board board;
  const Result<Image> image = drawBoardPixels(board, 100, 20);
  ASSERT_TRUE(image.ok()) << image.error().sentence();
  EXPECT_EQ(image->width(), 940);
  EXPECT_EQ(image->height(), 740);
  EXPECT_EQ(board.markerShare, 0.64);  // eight cells of eight pixels
  EXPECT_EQ(image->at(0, 0), 1);
  EXPECT_EQ(image->at(20, 20), 0);
  EXPECT_EQ(image->at(119, 119), 0);
  EXPECT_EQ(image->at(120, 20), 1);
  EXPECT_EQ(image->at(120 + 18, 20 + 18), 0);  // the marker's border
  EXPECT_EQ(image->at(120 + 17, 20 + 17), 1);
  Board small;
  EXPECT_FALSE(drawBoardPixels(small, 6, 0).ok());
}

TEST(Board, TheOnesOfOneDeskShareNoMarkers) {
  std::set<int> ids;
  int count = 0;
  for (const Board& board : {Board::forCamera(), Board::forSamplePlane(), Board::forScreen(344, 194)}) {
    EXPECT_TRUE(board.validate().empty());
    for (int i = 0; i < board.markerCount(); ++i) ids.insert(board.firstMarker + i);
    count += board.markerCount();
  }
  EXPECT_EQ(static_cast<int>(ids.size()), count);
  EXPECT_TRUE(drawBoardPdf(Board::forCamera()).ok()) << "fits on A4";
}

}  // namespace
}  // namespace patina
