#include "engine/calibration/board_reading.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <set>

#include "engine/calibration/markers.h"

namespace patina {
namespace {

/// A grid's place on the board: mirrored or not, turned by quarters, shifted.
struct Placement {
  bool mirrored = false;
  int quarters = 0, column = 0, row = 0;
  auto operator<=>(const Placement&) const = default;

  /// Twice the coordinates, so that middles of squares are whole numbers too.
  std::pair<int, int> doubled(int x, int y) const {
    if (mirrored) x = -x;
    for (int i = 0; i < quarters; ++i) {
      const int turned = -y;
      y = x;
      x = turned;
    }
    return {x + 2 * column, y + 2 * row};
  }
  std::pair<int, int> corner(int x, int y) const {
    const auto [c, r] = doubled(2 * x, 2 * y);
    return {c / 2, r / 2};
  }
};

/// How many cells of a marker may be read wrongly: far below half the dictionaries' smallest distance.
int allowedErrors(int bits) {
  return bits >= 6 ? 3 : bits == 5 ? 1 : 0;
}

/// Perspective map of the unit square to four points, in order (0,0), (1,0), (1,1), (0,1).
Eigen::Matrix3d squareTo(const std::array<Eigen::Vector2d, 4>& p) {
  const Eigen::Vector2d a = p[1] - p[2], b = p[3] - p[2], c = p[0] - p[1] + p[2] - p[3];
  const double determinant = a.x() * b.y() - b.x() * a.y();
  const double g = (c.x() * b.y() - b.x() * c.y()) / determinant,
               h = (a.x() * c.y() - c.x() * a.y()) / determinant;
  Eigen::Matrix3d m;
  m << p[1].x() - p[0].x() + g * p[1].x(), p[3].x() - p[0].x() + h * p[3].x(), p[0].x(),
      p[1].y() - p[0].y() + g * p[1].y(), p[3].y() - p[0].y() + h * p[3].y(), p[0].y(), g, h, 1;
  return m;
}

/// The marker in a square as it is seen; false where there is none.
bool readCode(const GreyPicture& picture, const std::array<Eigen::Vector2d, 4>& square, const Board& board,
              int bits, std::uint64_t* code) {
  const Eigen::Matrix3d map = squareTo(square);
  if (!map.allFinite()) return false;
  const auto value = [&](double u, double v) {
    const Eigen::Vector3d p = map * Eigen::Vector3d(u, v, 1);
    const double x = p.x() / p.z(), y = p.y() / p.z();
    if (!(x >= 0 && y >= 0 && x <= picture.width - 1 && y <= picture.height - 1))
      return std::numeric_limits<float>::quiet_NaN();
    return picture.at(x, y);
  };
  const int cells = bits + 2;
  const double share = board.markerShare, rim = (1 - share) / 2, cell = share / cells;
  std::vector<float> bright, dark;
  for (int i = 0; i < 4 * cells; ++i) {
    const int side = i / cells;
    const double along = rim + (i % cells + 0.5) * cell;
    const auto around = [&](double inside) {
      return side == 0   ? value(along, inside)
             : side == 1 ? value(1 - inside, along)
             : side == 2 ? value(along, 1 - inside)
                         : value(inside, along);
    };
    bright.push_back(around(rim / 2));
    dark.push_back(around(rim + cell / 2));
  }
  // What lies beyond the picture is nobody's guess.
  for (const float v : bright)
    if (std::isnan(v)) return false;
  std::vector<float> sortedBright = bright, sortedDark = dark;
  std::sort(sortedBright.begin(), sortedBright.end());
  std::sort(sortedDark.begin(), sortedDark.end());
  const float white = sortedBright[bright.size() / 2], black = sortedDark[dark.size() / 2];
  const float middle = 0.5f * (white + black);
  if (white - black < 0.03f) return false;
  // The border of a marker is dark all around; a tenth may be covered.
  if (sortedDark[dark.size() * 9 / 10] > middle) return false;
  *code = 0;
  for (int r = 0; r < bits; ++r) {
    for (int c = 0; c < bits; ++c) {
      float sum = 0;
      for (const double dv : {-0.2, 0.2})
        for (const double du : {-0.2, 0.2})
          sum += value(rim + (c + 1.5 + du) * cell, rim + (r + 1.5 + dv) * cell);
      if (sum / 4 > middle) *code |= std::uint64_t{1} << (r * bits + c);
    }
  }
  return true;
}

GridReading cornersAt(const CornerGrid& grid, const Board& board, const Placement& placement) {
  GridReading reading;
  reading.mirrored = placement.mirrored;
  for (const auto& [at, pixel] : grid.corners) {
    const auto [column, row] = placement.corner(at.first, at.second);
    if (column < 0 || row < 0 || column >= board.cornersX() || row >= board.cornersY()) continue;
    reading.corners.push_back({row * board.cornersX() + column, pixel});
  }
  std::sort(reading.corners.begin(), reading.corners.end(),
            [](const auto& a, const auto& b) { return a.id < b.id; });
  return reading;
}

}  // namespace

double CornerGrid::spacing(int column, int row) const {
  const auto here = corners.find({column, row});
  if (here == corners.end()) return 0;
  double nearest = 0;
  for (const auto& [dc, dr] : {std::pair(1, 0), {0, 1}, {-1, 0}, {0, -1}}) {
    const auto there = corners.find({column + dc, row + dr});
    if (there == corners.end()) continue;
    const double distance = (there->second - here->second).norm();
    if (nearest == 0 || distance < nearest) nearest = distance;
  }
  return nearest;
}

bool CornerGrid::predict(int column, int row, Eigen::Vector2d* pixel) const {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double weights = 0;
  const auto find = [&](int c, int r) {
    const auto at = corners.find({c, r});
    return at == corners.end() ? nullptr : &at->second;
  };
  const auto add = [&](const Eigen::Vector2d& p, double weight) { sum += weight * p, weights += weight; };
  for (const auto& [dc, dr] : {std::pair(1, 0), {0, 1}, {-1, 0}, {0, -1}}) {
    const Eigen::Vector2d *one = find(column + dc, row + dr), *two = find(column + 2 * dc, row + 2 * dr),
                          *three = find(column + 3 * dc, row + 3 * dr), *before = find(column - dc, row - dr);
    if (one && before) {
      add(0.5 * (*one + *before), 4);
    } else if (one && two && three) {
      add(3 * (*one - *two) + *three, 2);
    } else if (one && two) {
      add(2 * *one - *two, 1);
    }
  }
  for (const int dc : {-1, 1}) {
    for (const int dr : {-1, 1}) {
      const Eigen::Vector2d *side = find(column + dc, row), *over = find(column, row + dr),
                            *corner = find(column + dc, row + dr);
      if (side && over && corner) add(*side + *over - *corner, 1);
    }
  }
  if (weights == 0) return false;
  *pixel = sum / weights;
  return true;
}

bool readCheckerboard(const CornerGrid& grid, const Board& board, GridReading* reading) {
  const auto wanted = static_cast<std::size_t>(board.cornerCount());
  if (grid.corners.size() < wanted) return false;
  const Placement* best = nullptr;
  std::vector<Placement> placements;
  for (int quarters = 0; quarters < 4; ++quarters) {
    std::set<std::pair<int, int>> turned;
    for (const auto& [at, pixel] : grid.corners) {
      const Placement only{false, quarters, 0, 0};
      turned.insert(only.corner(at.first, at.second));
    }
    for (const auto& first : turned) {
      bool all = true;
      for (int row = 0; all && row < board.cornersY(); ++row)
        for (int column = 0; all && column < board.cornersX(); ++column)
          all = turned.contains({first.first + column, first.second + row});
      if (all) placements.push_back({false, quarters, -first.first, -first.second});
    }
  }
  double mostUpright = -std::numeric_limits<double>::infinity();
  for (const Placement& placement : placements) {
    // The square between the first corner and the one beside and below it is black, as the top left one is.
    std::pair<int, int> first{0, 0}, second{0, 0};
    for (const auto& [at, pixel] : grid.corners) {
      const auto corner = placement.corner(at.first, at.second);
      if (corner == std::pair(0, 0)) first = at;
      if (corner == std::pair(1, 1)) second = at;
    }
    if (!grid.dark(std::min(first.first, second.first), std::min(first.second, second.second))) continue;
    // Boards that look the same upside down: the one that stands upright in the picture.
    const double upright = (grid.corners.at(second) - grid.corners.at(first)).sum();
    if (upright > mostUpright) mostUpright = upright, best = &placement;
  }
  if (!best) return false;
  *reading = cornersAt(grid, board, *best);
  reading->votes = 1;
  return true;
}

GridReading readMarkers(const CornerGrid& grid, const GreyPicture& picture, const Board& board,
                        bool mirrored) {
  const MarkerDictionary& codes = *markerDictionary(board.dictionary);
  std::map<int, std::pair<int, int>> squareOf;
  for (int row = 0; row < board.squaresY; ++row)
    for (int column = 0; column < board.squaresX; ++column)
      if (const int id = board.markerAt(column, row); id >= 0) squareOf[id] = {column, row};

  std::set<std::pair<int, int>> cells;
  for (const auto& [at, pixel] : grid.corners)
    for (const int dc : {-1, 0})
      for (const int dr : {-1, 0})
        if (!grid.dark(at.first + dc, at.second + dr)) cells.insert({at.first + dc, at.second + dr});

  struct Vote {
    double weight = 0;
    bool exact = false;
    std::vector<int> markers;
  };
  std::map<Placement, Vote> votes;
  for (const auto& [column, row] : cells) {
    std::array<Eigen::Vector2d, 4> square;
    constexpr int kColumn[4] = {0, 1, 1, 0}, kRow[4] = {0, 0, 1, 1};
    bool known = true;
    for (int k = 0; k < 4 && known; ++k) {
      const auto corner = grid.corners.find({column + kColumn[k], row + kRow[k]});
      if (corner != grid.corners.end()) {
        square[k] = corner->second;
      } else {
        known = grid.predict(column + kColumn[k], row + kRow[k], &square[k]);
      }
    }
    std::uint64_t seen = 0;
    if (!known || !readCode(picture, square, board, codes.bits, &seen)) continue;
    if (mirrored) seen = mirroredCode(seen, codes.bits);
    for (int quarters = 0; quarters < 4; ++quarters, seen = turnedCode(seen, codes.bits)) {
      for (const auto& [id, place] : squareOf) {
        const int errors = std::popcount(seen ^ codes.codes[static_cast<std::size_t>(id)]);
        if (errors > allowedErrors(codes.bits)) continue;
        // Middle of the square, doubled, in the grid and on the board.
        Placement placement{mirrored, quarters, 0, 0};
        const auto [x, y] = placement.doubled(2 * column + 1, 2 * row + 1);
        placement.column = (2 * place.first - 1 - x) / 2;
        placement.row = (2 * place.second - 1 - y) / 2;
        Vote& vote = votes[placement];
        vote.weight += errors == 0 ? 1 : 0.5;
        vote.exact |= errors == 0;
        vote.markers.push_back(id);
      }
    }
  }
  const std::pair<const Placement, Vote>* best = nullptr;
  for (const auto& entry : votes)
    if (!best || entry.second.weight > best->second.weight) best = &entry;
  if (!best || !(best->second.exact || best->second.markers.size() > 1)) return {};
  GridReading reading = cornersAt(grid, board, best->first);
  reading.markers = best->second.markers;
  std::sort(reading.markers.begin(), reading.markers.end());
  reading.votes = best->second.weight;
  return reading;
}

}  // namespace patina
