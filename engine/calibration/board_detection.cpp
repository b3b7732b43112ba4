#include "engine/calibration/board_detection.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "engine/base/text.h"
#include "engine/calibration/board_reading.h"
#include "engine/calibration/corner_finder.h"

namespace patina {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kMostSaddles = 1200;
constexpr std::ptrdiff_t kMostGrids = 12;  // largest first; a board is never many pieces
/// Longest side, pixels, of the pictures that are searched: small ones see large and blurred boards and are
/// quick.
constexpr int kSearchSides[] = {640, 1280, 2560};
// Of the square's side: a window that holds nothing but the two edges through a corner.
constexpr double kCheckerWindow = 0.28;
constexpr double kSmallestWindowPx = 2, kLargestWindowPx = 12;
constexpr double kDarkLevel = 0.02;  // of the range, where the square root would raise the noise

/// Brightness from 0 to 1 with dark parts raised, so that one threshold serves linear and encoded pictures;
/// corners are centres of symmetry and stay where they are.
cv::Mat greyOf(const Image& photo, cv::Mat* raw, double* clippedShare) {
  cv::Mat grey(photo.height(), photo.width(), CV_32F);
  const int channels = photo.channels();
  const std::span<const float> samples = photo.samples();
  std::vector<float> some;
  const std::size_t pixels = photo.pixelCount(), stride = std::max<std::size_t>(1, pixels / 50000);
  float* to = grey.ptr<float>();
  for (std::size_t i = 0; i < pixels; ++i) {
    float sum = 0;
    for (int c = 0; c < channels; ++c) sum += samples[i * channels + c];
    to[i] = std::isfinite(sum) ? sum / static_cast<float>(channels) : 0.0f;
    if (i % stride == 0) some.push_back(to[i]);
  }
  std::sort(some.begin(), some.end());
  const float low = some[some.size() / 500], high = some[some.size() - 1 - some.size() / 500];
  const float top = some.back();
  const auto atTop = some.end() - std::lower_bound(some.begin(), some.end(), top * 0.999f);
  *clippedShare = top > low ? static_cast<double>(atTop) / static_cast<double>(some.size()) : 0;
  *raw = grey.clone();
  const float scale = high > low ? 1 / (high - low) : 0;
  const float dark = static_cast<float>(kDarkLevel), root = std::sqrt(dark),
              whole = std::sqrt(1 + dark) - root;
  grey.forEach<float>([&](float& value, const int*) {
    value = (std::sqrt(std::clamp((value - low) * scale, 0.0f, 1.0f) + dark) - root) / whole;
  });
  return grey;
}

GreyPicture pictureOf(const cv::Mat& grey) {
  return {grey.cols, grey.rows, {grey.ptr<float>(), grey.total()}};
}

/// Moves each corner to where the brightness' gradient points past it on all sides (Foerstner and Guelch
/// 1987), in a window as large as its squares allow. Corners that wander off are taken out.
void refine(const cv::Mat& grey, double window, CornerGrid* grid) {
  std::map<std::pair<int, int>, Eigen::Vector2d> refined;
  for (const auto& [at, pixel] : grid->corners) {
    const double spacing = grid->spacing(at.first, at.second);
    const double half = std::clamp(window * spacing, kSmallestWindowPx, kLargestWindowPx);
    const int size = static_cast<int>(half);
    if (!(pixel.x() > size && pixel.y() > size && pixel.x() < grey.cols - 1 - size &&
          pixel.y() < grey.rows - 1 - size))
      continue;
    std::vector<cv::Point2f> point{{static_cast<float>(pixel.x()), static_cast<float>(pixel.y())}};
    cv::cornerSubPix(grey, point, {size, size}, {-1, -1},
                     {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.002});
    const Eigen::Vector2d moved(point[0].x, point[0].y);
    if (moved.allFinite() && (moved - pixel).norm() < std::max(2.0, half)) refined[at] = moved;
  }
  grid->corners = std::move(refined);
}

/// Corners inside of the grid that no edge led to (a reflection, a smudge): looked for where they should be.
void fillHoles(const cv::Mat& grey, double window, CornerGrid* grid) {
  if (grid->corners.empty()) return;
  int c0 = 1 << 30, c1 = -c0, r0 = c0, r1 = -c0;
  for (const auto& [at, pixel] : grid->corners) {
    c0 = std::min(c0, at.first), c1 = std::max(c1, at.first);
    r0 = std::min(r0, at.second), r1 = std::max(r1, at.second);
  }
  CornerGrid holes;
  for (int row = r0; row <= r1; ++row) {
    for (int column = c0; column <= c1; ++column) {
      Eigen::Vector2d expected;
      if (grid->has(column, row) || !grid->predict(column, row, &expected)) continue;
      CornerGrid alone;
      alone.corners[{column, row}] = expected;
      double spacing = 0;
      for (const auto& [dc, dr] : {std::pair(1, 0), {0, 1}, {-1, 0}, {0, -1}})
        if (grid->has(column + dc, row + dr)) {
          const double distance = (grid->corners.at({column + dc, row + dr}) - expected).norm();
          spacing = spacing == 0 ? distance : std::min(spacing, distance);
        }
      SaddlePoint saddle;
      saddle.pixel = expected;
      if (spacing < 12 || !describeSaddle(pictureOf(grey), &saddle)) continue;
      // The neighbour gives the window its size.
      alone.corners[{column + 1, row}] = expected + Eigen::Vector2d(spacing, 0);
      refine(grey, window, &alone);
      const auto found = alone.corners.find({column, row});
      if (found != alone.corners.end() && (found->second - expected).norm() < 0.15 * spacing)
        holes.corners.insert(*found);
    }
  }
  grid->corners.insert(holes.corners.begin(), holes.corners.end());
}

/// Takes out corners whose surroundings aren't the same turned by half a turn, as those of a corner are: half
/// covered ones, on the edge of a mirror for instance.
void dropLopsided(const cv::Mat& light, double window, CornerGrid* grid) {
  constexpr double kMostLopsided = 0.25;  // of the window's own contrast
  const GreyPicture picture = pictureOf(light);
  for (auto corner = grid->corners.begin(); corner != grid->corners.end();) {
    const auto& [at, pixel] = *corner;
    const double half =
        std::clamp(window * grid->spacing(at.first, at.second), kSmallestWindowPx, kLargestWindowPx);
    const int reach = static_cast<int>(half) + 1;
    double difference = 0, sum = 0, squares = 0, count = 0;
    for (int dy = -reach; dy <= reach; ++dy) {
      for (int dx = -reach; dx <= reach; ++dx) {
        const double a = picture.at(pixel.x() + dx, pixel.y() + dy),
                     b = picture.at(pixel.x() - dx, pixel.y() - dy);
        difference += 0.5 * (a - b) * (a - b), sum += a, squares += a * a, ++count;
      }
    }
    const double variance = squares / count - (sum / count) * (sum / count);
    corner = difference / count > kMostLopsided * kMostLopsided * variance ? grid->corners.erase(corner)
                                                                           : std::next(corner);
  }
}

/// The exponent of the picture's tone curve: in the middle of a corner the light is halfway between dark and
/// bright, whatever the blur. 1 where the corners don't tell.
double toneExponent(const cv::Mat& raw, const CornerGrid& grid) {
  const GreyPicture picture = pictureOf(raw);
  std::vector<double> exponents;
  for (const auto& [at, pixel] : grid.corners) {
    const double reach = 0.18 * grid.spacing(at.first, at.second);
    const auto east = grid.corners.find({at.first + 1, at.second}),
               south = grid.corners.find({at.first, at.second + 1});
    if (reach < 3 || east == grid.corners.end() || south == grid.corners.end()) continue;
    const Eigen::Vector2d u = (east->second - pixel).normalized() * reach,
                          v = (south->second - pixel).normalized() * reach;
    const auto value = [&](const Eigen::Vector2d& p) {
      return static_cast<double>(picture.at(p.x(), p.y()));
    };
    double a = 0.5 * (value(pixel + u + v) + value(pixel - u - v)),
           b = 0.5 * (value(pixel + u - v) + value(pixel - u + v));
    if (a > b) std::swap(a, b);
    const double middle = value(pixel) / b, dark = std::max(a / b, 1e-3);
    if (!(dark < 0.6 && middle > dark && middle < 1)) continue;
    double low = 0.4, high = 4;
    for (int i = 0; i < 30; ++i) {
      const double g = 0.5 * (low + high);
      (std::pow(middle, g) * 2 > std::pow(dark, g) + 1 ? low : high) = g;
    }
    exponents.push_back(low);
  }
  if (exponents.size() < 6) return 1;
  std::nth_element(exponents.begin(), exponents.begin() + static_cast<std::ptrdiff_t>(exponents.size() / 2),
                   exponents.end());
  return std::clamp(exponents[exponents.size() / 2], 0.6, 3.0);
}

/// The last digits of the corners, on linear light: a tone curve shifts sharp edges by amounts that depend on
/// where they fall in a pixel. A slight blur lets interpolation between pixels follow the edges.
void refineOnLight(const cv::Mat& raw, double window, CornerGrid* grid) {
  constexpr double kSmoothPx = 0.7;
  const double exponent = toneExponent(raw, *grid);
  if (grid->corners.empty()) return;
  // Only what lies around the grid: large pictures are mostly something else.
  Eigen::Vector2d low = grid->corners.begin()->second, high = low;
  for (const auto& [at, pixel] : grid->corners) low = low.cwiseMin(pixel), high = high.cwiseMax(pixel);
  const int margin = static_cast<int>(2 * kLargestWindowPx) + 4;
  const cv::Rect part =
      cv::Rect(cv::Point(static_cast<int>(low.x()) - margin, static_cast<int>(low.y()) - margin),
               cv::Point(static_cast<int>(high.x()) + margin + 1, static_cast<int>(high.y()) + margin + 1)) &
      cv::Rect(0, 0, raw.cols, raw.rows);
  const Eigen::Vector2d corner(part.x, part.y);
  cv::Mat light;
  cv::max(raw(part), 0, light);
  double top = 0;
  cv::minMaxLoc(light, nullptr, &top);
  if (!(top > 0)) return;
  light /= top;
  cv::pow(light, exponent, light);
  cv::GaussianBlur(light, light, {}, kSmoothPx);
  for (auto& [at, pixel] : grid->corners) pixel -= corner;
  refine(light, window, grid);
  dropLopsided(light, window, grid);
  for (auto& [at, pixel] : grid->corners) pixel += corner;
}

CornerGrid gridInWhole(const std::vector<GridCorner>& joined, const std::vector<SaddlePoint>& saddles,
                       double scale) {
  CornerGrid grid;
  int even = 0, odd = 0;
  for (const GridCorner& corner : joined) {
    const SaddlePoint& saddle = saddles[corner.saddle];
    grid.corners[{corner.column, corner.row}] = ((saddle.pixel.array() + 0.5) * scale - 0.5).matrix();
    // The sector between +column and +row is that after the edge which points along +column.
    const bool dark = !saddle.brightSector[(4 - corner.quarter) % 4];
    ((dark == ((corner.column + corner.row) % 2 == 0)) ? even : odd) += 1;
  }
  grid.evenDark = even >= odd;
  return grid;
}

/// Standard deviation of the edges' blur and the squares' contrast, medians over the grid.
void measureEdges(const GreyPicture& picture, const CornerGrid& grid, BoardDetection* detection) {
  std::vector<double> blur, contrast;
  for (const auto& [at, pixel] : grid.corners) {
    for (const auto& [dc, dr] : {std::pair(1, 0), {0, 1}}) {
      const auto next = grid.corners.find({at.first + dc, at.second + dr});
      if (next == grid.corners.end()) continue;
      const Eigen::Vector2d along = next->second - pixel, middle = 0.5 * (next->second + pixel);
      const double length = along.norm(), reach = std::min(0.15 * length, 8.0);
      if (reach < 2) continue;
      const Eigen::Vector2d across = Eigen::Vector2d(-along.y(), along.x()) / length;
      double steepest = 0;
      const auto value = [&](double t) {
        return static_cast<double>(picture.at(middle.x() + t * across.x(), middle.y() + t * across.y()));
      };
      const double a = value(-reach), b = value(reach);
      for (double t = -reach; t < reach - 0.5; t += 0.25)
        steepest = std::max(steepest, std::abs(value(t + 0.5) - value(t - 0.5)));
      const double step = std::abs(b - a);
      if (step < 0.02 || steepest <= 0) continue;
      // A blurred step's slope is step / (sqrt(2 pi) sigma); the difference over a pixel widens it by 1/12.
      const double sigma = step / (std::sqrt(2 * std::numbers::pi) * steepest);
      blur.push_back(std::sqrt(std::max(sigma * sigma - 1.0 / 12, 0.0)));
      contrast.push_back(step / std::max({a, b, 1e-6}));
    }
  }
  const auto median = [](std::vector<double>& values) {
    if (values.empty()) return 0.0;
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                     values.end());
    return values[values.size() / 2];
  };
  detection->sharpnessPx = median(blur);
  detection->contrast = median(contrast);
}

/// Everything that is known when the board wasn't found.
struct Evidence {
  std::size_t saddles = 0, largestGrid = 0;
  int readCorners = 0;
  bool otherSide = false, outOfTime = false;
  int gridColumns = 0, gridRows = 0;
  double brightest = 0;
};

std::string reasonFor(const Evidence& evidence, const Board& board, const BoardDetection& detection,
                      BoardSide side) {
  const std::string wanted = std::to_string(board.cornerCount());
  const std::string clipped =
      detection.clippedShare > 0.25 ? "; a large part of the picture is clipped: expose shorter" : "";
  if (evidence.brightest <= 0) return "the picture is black: is the lens covered, is there light?";
  if (evidence.otherSide)
    return side == BoardSide::Mirrored ? "the board is seen directly, not in the mirror"
                                       : "the board is seen in a mirror, not directly";
  if (evidence.readCorners > 0)
    return std::to_string(evidence.readCorners) + " of " + wanted +
           " corners are seen: too much of the board is cut off, covered or reflects light" + clipped;
  if (evidence.largestGrid >= 9 && board.kind == BoardKind::Charuco)
    return counted(evidence.largestGrid, "corner") +
           " of squares are seen and none of the board's markers can be read: another board, too far away, "
           "or "
           "blurred" +
           clipped;
  if (evidence.largestGrid >= 9) {
    const std::string grid = "a grid of " + std::to_string(evidence.gridColumns) + " x " +
                             std::to_string(evidence.gridRows) + " corners is seen, and this board has " +
                             std::to_string(board.cornersX()) + " x " + std::to_string(board.cornersY());
    if (static_cast<int>(evidence.largestGrid) >= board.cornerCount()) return grid + ": is it another board?";
    return grid + ", " + std::to_string(evidence.largestGrid) + " of " + wanted +
           " found: all of a checkerboard must be in the picture, free of glare and fingers" + clipped;
  }
  if (evidence.outOfTime) return "no board was found in the time given; the picture is full of detail";
  if (evidence.saddles >= 9)
    return "no squares of a board stand out: is it in the picture, in focus, at least 15 pixels a square?" +
           clipped;
  return "nothing like a board is in the picture: bring it in, focus, and light it evenly" + clipped;
}

}  // namespace

BoardDetection detectBoard(const Image& photo, const Board& board, const BoardDetectionOptions& options,
                           std::stop_token stop) {
  const Clock::time_point start = Clock::now();
  BoardDetection detection;
  detection.view.imageWidth = photo.width();
  detection.view.imageHeight = photo.height();
  const auto finish = [&](BoardDetection& result) {
    result.took = std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - start);
    return std::move(result);
  };
  if (const std::vector<std::string> problems = board.validate(); !problems.empty()) {
    detection.whyNot = "this is no board: " + problems.front();
    return finish(detection);
  }
  if (photo.width() < 48 || photo.height() < 48) {
    detection.whyNot = "the picture is too small";
    return finish(detection);
  }
  const bool charuco = board.kind == BoardKind::Charuco;
  cv::Mat raw;
  const cv::Mat grey = greyOf(photo, &raw, &detection.clippedShare);
  const GreyPicture whole = pictureOf(grey);
  const double window = charuco ? std::min(kCheckerWindow, 0.45 * (1 - board.markerShare)) : kCheckerWindow;

  Evidence evidence;
  for (const float v : photo.samples())
    evidence.brightest = std::max(evidence.brightest, static_cast<double>(v));
  GridReading best;
  CornerGrid bestGrid;
  const int longest = std::max(grey.cols, grey.rows);
  int lastSide = 0;
  for (const int wantedSide : kSearchSides) {
    const int side = std::min(wantedSide, longest);
    if (side == lastSide) break;
    if (lastSide != 0 && (Clock::now() - start > options.timeLimit || stop.stop_requested())) {
      evidence.outOfTime = true;
      break;
    }
    lastSide = side;
    const double scale = static_cast<double>(longest) / side;
    cv::Mat small = grey;
    if (scale > 1) cv::resize(grey, small, {}, 1 / scale, 1 / scale, cv::INTER_AREA);
    const GreyPicture picture = pictureOf(small);
    const std::vector<SaddlePoint> saddles = findSaddlePoints(picture, kMostSaddles, stop);
    const std::vector<std::vector<GridCorner>> joined = joinToGrids(picture, saddles, stop);
    evidence.saddles = std::max(evidence.saddles, saddles.size());
    const double scaleX = static_cast<double>(grey.cols) / small.cols;
    std::vector<Eigen::Vector2d> loose;
    for (const SaddlePoint& saddle : saddles)
      loose.push_back(((saddle.pixel.array() + 0.5) * scaleX - 0.5).matrix());
    for (const std::vector<GridCorner>& one : joined) {
      if (stop.stop_requested() || &one - joined.data() >= kMostGrids) break;
      if (charuco ? one.size() < 4 : one.size() * 2 < static_cast<std::size_t>(board.cornerCount())) {
        if (one.size() <= evidence.largestGrid) continue;
      }
      CornerGrid grid = gridInWhole(one, saddles, scaleX);
      refine(grey, window, &grid);
      fillHoles(grey, window, &grid);
      refineOnLight(raw, window, &grid);
      if (grid.corners.size() > evidence.largestGrid) {
        evidence.largestGrid = grid.corners.size();
        int c0 = 1 << 30, c1 = -c0, r0 = c0, r1 = -c0;
        for (const auto& [at, pixel] : grid.corners) {
          c0 = std::min(c0, at.first), c1 = std::max(c1, at.first);
          r0 = std::min(r0, at.second), r1 = std::max(r1, at.second);
        }
        evidence.gridColumns = std::max(c1 - c0, r1 - r0) + 1,
        evidence.gridRows = std::min(c1 - c0, r1 - r0) + 1;
      }
      GridReading reading;
      if (!charuco) {
        if (!readCheckerboard(grid, board, &reading)) continue;
      } else {
        if (options.side != BoardSide::Mirrored) reading = readMarkers(grid, whole, board, false);
        if (options.side != BoardSide::Direct && reading.votes == 0)
          reading = readMarkers(grid, whole, board, true);
        if (reading.votes == 0 && options.side != BoardSide::Either &&
            readMarkers(grid, whole, board, options.side == BoardSide::Direct).votes > 0)
          evidence.otherSide = true;
      }
      if (reading.corners.size() > best.corners.size()) best = reading, bestGrid = grid;
    }
    if (detection.loose.size() < loose.size()) detection.loose = std::move(loose);
    // A board of which most is seen isn't seen better at a finer scale.
    const int enough =
        charuco ? std::max(options.fewestCorners, board.cornerCount() / 2) : board.cornerCount();
    if (static_cast<int>(best.corners.size()) >= enough) break;
  }
  const int fewest =
      charuco ? std::min(std::max(options.fewestCorners, 4), board.cornerCount()) : board.cornerCount();
  detection.view.corners = best.corners;
  detection.view.mirrored = best.mirrored;
  detection.markers = best.markers;
  evidence.readCorners = static_cast<int>(best.corners.size());
  detection.found = evidence.readCorners >= fewest;
  if (detection.found) {
    std::erase_if(detection.loose, [&](const Eigen::Vector2d& p) {
      return std::any_of(best.corners.begin(), best.corners.end(),
                         [&](const BoardCorner& c) { return (c.pixel - p).norm() < 4 * longest / 640.0; });
    });
  } else {
    detection.whyNot = reasonFor(evidence, board, detection, options.side);
  }
  measureEdges(whole, bestGrid, &detection);
  return finish(detection);
}

}  // namespace patina
