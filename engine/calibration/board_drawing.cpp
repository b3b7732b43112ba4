#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "engine/calibration/board.h"
#include "engine/calibration/markers.h"

namespace patina {
namespace {

constexpr double kMarginMm = 5;  // what desktop printers can't reach
constexpr double kRulerMm = 100;
constexpr double kRulerSpaceMm = 9;  // for the line, its ticks and the words
constexpr std::int64_t kMostPixels = std::int64_t{1} << 26;

struct Rectangle {
  double x = 0, y = 0, width = 0, height = 0;  ///< mm, y down
};

/// Everything that is black, from the board's top left corner. Cells of one row that touch are one rectangle.
std::vector<Rectangle> blackOf(const Board& board) {
  std::vector<Rectangle> black;
  const double s = board.squareMm;
  for (int row = 0; row < board.squaresY; ++row)
    for (int column = row % 2; column < board.squaresX; column += 2)
      black.push_back({column * s, row * s, s, s});
  if (board.kind != BoardKind::Charuco) return black;
  const MarkerDictionary& codes = *markerDictionary(board.dictionary);
  const int cells = codes.cells();
  const double cell = s * board.markerShare / cells, rim = s * (1 - board.markerShare) / 2;
  for (int row = 0; row < board.squaresY; ++row) {
    for (int column = 0; column < board.squaresX; ++column) {
      const int id = board.markerAt(column, row);
      if (id < 0) continue;
      for (int r = 0; r < cells; ++r) {
        const auto isBlack = [&](int c) {
          return r == 0 || c == 0 || r == cells - 1 || c == cells - 1 || !codes.white(id, r - 1, c - 1);
        };
        for (int c = 0, from = 0; c < cells; c = from) {
          while (c < cells && !isBlack(c)) ++c;
          for (from = c; from < cells && isBlack(from);) ++from;
          if (from > c)
            black.push_back({column * s + rim + c * cell, row * s + rim + r * cell, (from - c) * cell, cell});
        }
      }
    }
  }
  return black;
}

/// Where things go on the paper, mm from its top left.
struct Page {
  double left = 0, top = 0;  ///< of the board
  std::vector<Rectangle> black;
  std::string words;
  double wordsX = 0, wordsY = 0;  ///< of the text's base line
};

Result<Page> layOut(const Board& board, const PrintOptions& options) {
  std::string problems;
  for (const std::string& problem : board.validate()) problems += (problems.empty() ? "" : "; ") + problem;
  if (!problems.empty()) return Error{ErrorCode::Invalid, problems, "board", ""};
  const double ruler = options.withRuler ? kRulerSpaceMm : 0;
  const double needWidth = board.widthMm() + 2 * kMarginMm + 2 * ruler,
               needHeight = board.heightMm() + 2 * kMarginMm + 2 * ruler;
  if (!(options.paperWidthMm >= needWidth && options.paperHeightMm >= needHeight)) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "the board with its margins takes %.0f x %.0f mm and the paper has %.0f x %.0f mm",
                  needWidth, needHeight, options.paperWidthMm, options.paperHeightMm);
    return Error{ErrorCode::Invalid, text, "board", "smaller squares, fewer of them, or larger paper"};
  }
  Page page;
  page.left = (options.paperWidthMm - board.widthMm()) / 2;
  page.top = (options.paperHeightMm - board.heightMm()) / 2;
  page.black = blackOf(board);
  if (!options.withRuler) return page;
  constexpr double kLine = 0.3, kTick = 2.5;
  const double length =
      std::min({kRulerMm, std::floor(board.widthMm() / 10) * 10, std::floor(board.heightMm() / 10) * 10});
  const double y = board.heightMm() + 4, x = -4;
  page.black.push_back({0, y, length, kLine});
  page.black.push_back({x - kLine, 0, kLine, length});
  for (double at = 0; at <= length + 1e-9; at += 10) {
    const double size = std::lround(at) % 50 == 0 ? kTick : kTick / 2;
    page.black.push_back({at - kLine / 2, y, kLine, size});
    page.black.push_back({x - size, at - kLine / 2, size, kLine});
  }
  char text[200];
  std::snprintf(text, sizeof text,
                "%s. Print at 100 %%: the lines are %.0f mm long. Glue it to something flat.",
                board.inWords().c_str(), length);
  page.words = text;
  page.wordsX = std::min(length + 4, board.widthMm() / 3), page.wordsY = y + 3.2;
  return page;
}

std::string number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.5f", value);
  std::string digits = text;
  while (digits.back() == '0') digits.pop_back();
  if (digits.back() == '.') digits.pop_back();
  return digits == "-0" ? "0" : digits;
}

constexpr double kTextMm = 2.6;

}  // namespace

Result<std::string> drawBoardSvg(const Board& board, const PrintOptions& options) {
  const Result<Page> page = layOut(board, options);
  if (!page) return page.error();
  const std::string width = number(options.paperWidthMm), height = number(options.paperHeightMm);
  std::string svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + width + "mm\" height=\"" + height +
                    "mm\" viewBox=\"0 0 " + width + " " + height + "\">\n<rect width=\"" + width +
                    "\" height=\"" + height + "\" fill=\"#fff\"/>\n<path fill=\"#000\" d=\"";
  // One path: rectangles that touch show no seams then.
  for (const Rectangle& r : page->black)
    svg += "M" + number(page->left + r.x) + " " + number(page->top + r.y) + "h" + number(r.width) + "v" +
           number(r.height) + "h" + number(-r.width) + "z";
  svg += "\"/>\n";
  if (!page->words.empty())
    svg += "<text x=\"" + number(page->left + page->wordsX) + "\" y=\"" + number(page->top + page->wordsY) +
           "\" font-family=\"sans-serif\" font-size=\"" + number(kTextMm) + "\">" + page->words + "</text>\n";
  return svg + "</svg>\n";
}

Result<std::string> drawBoardPdf(const Board& board, const PrintOptions& options) {
  const Result<Page> page = layOut(board, options);
  if (!page) return page.error();
  constexpr double kPoints = 72 / 25.4;  // a millimetre
  const double height = options.paperHeightMm;
  std::string drawing = number(kPoints) + " 0 0 " + number(kPoints) + " 0 0 cm\n0 g\n";
  for (const Rectangle& r : page->black)
    drawing += number(page->left + r.x) + " " + number(height - page->top - r.y - r.height) + " " +
               number(r.width) + " " + number(r.height) + " re\n";
  drawing += "f\n";
  if (!page->words.empty()) {
    std::string words;
    for (const char c : page->words)
      words += (c == '(' || c == ')' || c == '\\') ? std::string("\\") + c : std::string(1, c);
    drawing += "BT /F1 " + number(kTextMm) + " Tf " + number(page->left + page->wordsX) + " " +
               number(height - page->top - page->wordsY) + " Td (" + words + ") Tj ET\n";
  }
  const std::string objects[] = {
      "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
      "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
      "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 " + number(options.paperWidthMm * kPoints) + " " +
          number(height * kPoints) + "] /Contents 4 0 R /Resources << /Font << /F1 5 0 R >> >> >>",
      "<< /Length " + std::to_string(drawing.size()) + " >>\nstream\n" + drawing + "endstream",
      "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>"};
  std::string pdf = "%PDF-1.4\n", table = "xref\n0 6\n0000000000 65535 f \n";
  int index = 1;
  for (const std::string& object : objects) {
    char entry[24];
    std::snprintf(entry, sizeof entry, "%010zu 00000 n \n", pdf.size());
    table += entry;
    pdf += std::to_string(index++) + " 0 obj\n" + object + "\nendobj\n";
  }
  const std::string start = std::to_string(pdf.size());
  return pdf + table + "trailer\n<< /Size 6 /Root 1 0 R >>\nstartxref\n" + start + "\n%%EOF\n";
}

Result<Image> drawBoardPixels(Board& board, int pixelsPerSquare, int marginPx) {
  std::string problems;
  for (const std::string& problem : board.validate()) problems += (problems.empty() ? "" : "; ") + problem;
  if (!problems.empty()) return Error{ErrorCode::Invalid, problems, "board", ""};
  const std::int64_t width = std::int64_t{board.squaresX} * pixelsPerSquare + 2 * std::int64_t{marginPx},
                     height = std::int64_t{board.squaresY} * pixelsPerSquare + 2 * std::int64_t{marginPx};
  if (pixelsPerSquare < 1 || marginPx < 0 || width > kMostPixels || height > kMostPixels ||
      width * height > kMostPixels)
    return Error{ErrorCode::Invalid, "the board has no sensible size in pixels", "board", ""};
  int cellPx = 0, cells = 1;
  const MarkerDictionary* codes = nullptr;
  if (board.kind == BoardKind::Charuco) {
    codes = markerDictionary(board.dictionary);
    cells = codes->cells();
    cellPx = static_cast<int>(std::lround(pixelsPerSquare * board.markerShare / cells));
    if (cellPx * cells > pixelsPerSquare * 0.85) --cellPx;
    if (cellPx < 1)
      return Error{ErrorCode::Invalid, "a marker's cells would be smaller than a pixel", "board",
                   "larger squares"};
    // The rim must be whole pixels on both sides.
    if ((pixelsPerSquare - cellPx * cells) % 2 != 0)
      return Error{ErrorCode::Invalid, "the markers can't be in the middle of their squares in whole pixels",
                   "board", "an even number of pixels a square"};
    board.markerShare = static_cast<double>(cellPx * cells) / pixelsPerSquare;
  }
  Image image(static_cast<int>(width), static_cast<int>(height), 1, 1.0f);
  const auto fill = [&](int x0, int y0, int side) {
    for (int y = y0; y < y0 + side; ++y)
      for (int x = x0; x < x0 + side; ++x) image.at(x, y) = 0;
  };
  for (int row = 0; row < board.squaresY; ++row) {
    for (int column = 0; column < board.squaresX; ++column) {
      const int x0 = marginPx + column * pixelsPerSquare, y0 = marginPx + row * pixelsPerSquare;
      if ((column + row) % 2 == 0) {
        fill(x0, y0, pixelsPerSquare);
        continue;
      }
      const int id = board.markerAt(column, row);
      if (id < 0) continue;
      const int rim = (pixelsPerSquare - cellPx * cells) / 2;
      for (int r = 0; r < cells; ++r)
        for (int c = 0; c < cells; ++c)
          if (r == 0 || c == 0 || r == cells - 1 || c == cells - 1 || !codes->white(id, r - 1, c - 1))
            fill(x0 + rim + c * cellPx, y0 + rim + r * cellPx, cellPx);
    }
  }
  return image;
}

}  // namespace patina
