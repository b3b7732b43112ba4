#include "engine/calibration/corner_finder.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <queue>

namespace patina {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kBlurPx = 1.2;  // what second derivatives of a noisy picture need
constexpr double kCirclePx = 5;  // beyond the blur of usable photographs, within small squares
constexpr int kCircleSamples = 40;
constexpr double kLeastContrast = 0.04;   // of the picture's range; below: noise
constexpr double kLeastSectorRad = 0.35;  // 20 degrees: a board seen under 70 degrees still has more
constexpr double kOppositeRad = 0.45;     // how far opposite edges may be from one line; blur and curvature
constexpr double kConeRad = 0.24;         // an edge's direction is that well known from a circle of 5 pixels
constexpr double kBackRad = 0.4;
constexpr int kEdgeSamples = 9;

double wrapped(double rad) {  // to -pi..pi
  return std::remainder(rad, kTurn);
}

/// Whether one edge runs from a to b: bright on one side all along, dark on the other.
bool edgeBetween(const GreyPicture& picture, const SaddlePoint& a, const SaddlePoint& b) {
  const Eigen::Vector2d along = b.pixel - a.pixel;
  const double length = along.norm();
  const Eigen::Vector2d across = Eigen::Vector2d(-along.y(), along.x()) / length;
  const double aside = std::clamp(0.12 * length, 2.0, 6.0);
  const float enough = 0.3f * static_cast<float>(std::min(a.contrast, b.contrast));
  int sign = 0;
  for (int i = 0; i < kEdgeSamples; ++i) {
    const Eigen::Vector2d at = a.pixel + along * (0.2 + 0.6 * i / (kEdgeSamples - 1));
    const Eigen::Vector2d left = at - aside * across, right = at + aside * across;
    const float step = picture.at(right.x(), right.y()) - picture.at(left.x(), left.y());
    if (std::abs(step) < enough) return false;
    const int here = step > 0 ? 1 : -1;
    if (sign != 0 && here != sign) return false;
    sign = here;
  }
  return true;
}

struct Link {
  int to = -1, arrives = 0;  ///< the edge of the other that points back
};

}  // namespace

float GreyPicture::at(double x, double y) const {
  x = std::clamp(x, 0.0, width - 1.0), y = std::clamp(y, 0.0, height - 1.0);
  const int x0 = std::min(static_cast<int>(x), width - 2), y0 = std::min(static_cast<int>(y), height - 2);
  const float u = static_cast<float>(x - x0), v = static_cast<float>(y - y0);
  const float* p = samples.data() + static_cast<std::size_t>(y0) * width + x0;
  return (p[0] * (1 - u) + p[1] * u) * (1 - v) + (p[width] * (1 - u) + p[width + 1] * u) * v;
}

bool describeSaddle(const GreyPicture& picture, SaddlePoint* point) {
  std::array<float, kCircleSamples> value;
  float lowest = 1e9f, highest = -1e9f;
  for (int i = 0; i < kCircleSamples; ++i) {
    const double angle = kTurn * i / kCircleSamples;
    value[i] = picture.at(point->pixel.x() + kCirclePx * std::cos(angle),
                          point->pixel.y() + kCirclePx * std::sin(angle));
    lowest = std::min(lowest, value[i]), highest = std::max(highest, value[i]);
  }
  // Halfway between dark and bright, not the mean: sectors of a tilted board are of unequal size.
  std::array<float, kCircleSamples> sorted = value;
  std::sort(sorted.begin(), sorted.end());
  const float dark = sorted[kCircleSamples / 8], bright = sorted[kCircleSamples - 1 - kCircleSamples / 8];
  if (bright - dark < kLeastContrast) return false;
  const float middle = 0.5f * (dark + bright);
  int crossings = 0;
  for (int i = 0; i < kCircleSamples; ++i) {
    const float a = value[i] - middle, b = value[(i + 1) % kCircleSamples] - middle;
    if ((a > 0) == (b > 0)) continue;
    if (crossings == 4) return false;
    point->edgeRad[crossings] = kTurn * (i + a / (a - b)) / kCircleSamples;
    point->brightSector[crossings] = b > 0;
    ++crossings;
  }
  if (crossings != 4) return false;
  for (int k = 0; k < 4; ++k) {
    double sector = point->edgeRad[(k + 1) % 4] - point->edgeRad[k];
    if (sector < 0) sector += kTurn;
    if (sector < kLeastSectorRad) return false;
  }
  for (int k = 0; k < 2; ++k)
    if (std::abs(wrapped(point->edgeRad[k + 2] - point->edgeRad[k] - std::numbers::pi)) > kOppositeRad)
      return false;
  point->contrast = bright - dark;
  return true;
}

std::vector<SaddlePoint> findSaddlePoints(const GreyPicture& picture, std::size_t most,
                                          const std::stop_token& stop) {
  std::vector<SaddlePoint> found;
  if (picture.width < 24 || picture.height < 24) return found;
  const cv::Mat grey(picture.height, picture.width, CV_32F, const_cast<float*>(picture.samples.data()));
  cv::Mat smooth, xx, yy, xy;
  cv::GaussianBlur(grey, smooth, {}, kBlurPx);
  cv::Sobel(smooth, xx, CV_32F, 2, 0, 3, 0.25);
  cv::Sobel(smooth, yy, CV_32F, 0, 2, 3, 0.25);
  cv::Sobel(smooth, xy, CV_32F, 1, 1, 3, 0.25);
  if (stop.stop_requested()) return found;
  cv::Mat response = xy.mul(xy) - xx.mul(yy), highest;
  cv::dilate(response, highest, cv::Mat::ones(5, 5, CV_8U));
  // A step of the least contrast, blurred by kBlurPx and the lens, bends by about contrast / (8 blur^2).
  constexpr double kBend = kLeastContrast / (8 * (kBlurPx * kBlurPx + 2));
  constexpr float kThreshold = static_cast<float>(kBend * kBend);
  const GreyPicture blurred{picture.width,
                            picture.height,
                            {smooth.ptr<float>(), static_cast<std::size_t>(picture.width) * picture.height}};
  const int rim = static_cast<int>(kCirclePx) + 1;
  std::vector<std::pair<float, cv::Point>> peaks;
  for (int y = rim; y < picture.height - rim; ++y) {
    const float *r = response.ptr<float>(y), *h = highest.ptr<float>(y);
    for (int x = rim; x < picture.width - rim; ++x)
      if (r[x] > kThreshold && r[x] == h[x]) peaks.emplace_back(r[x], cv::Point(x, y));
  }
  std::sort(peaks.begin(), peaks.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  for (const auto& [strength, at] : peaks) {
    if (found.size() >= most || stop.stop_requested()) break;
    SaddlePoint point;
    point.strength = strength;
    // Where the gradient vanishes, by the second derivatives.
    const float gx = 0.5f * (smooth.at<float>(at.y, at.x + 1) - smooth.at<float>(at.y, at.x - 1)),
                gy = 0.5f * (smooth.at<float>(at.y + 1, at.x) - smooth.at<float>(at.y - 1, at.x));
    const float a = xx.at<float>(at), b = xy.at<float>(at), c = yy.at<float>(at), determinant = a * c - b * b;
    const double dx = -(c * gx - b * gy) / determinant, dy = -(a * gy - b * gx) / determinant;
    if (!(std::abs(dx) < 1.5 && std::abs(dy) < 1.5)) continue;
    point.pixel = {at.x + dx, at.y + dy};
    if (describeSaddle(blurred, &point)) found.push_back(point);
  }
  return found;
}

std::vector<std::vector<GridCorner>> joinToGrids(const GreyPicture& picture,
                                                 const std::vector<SaddlePoint>& saddles,
                                                 const std::stop_token& stop) {
  const int count = static_cast<int>(saddles.size());
  const double farthest = 0.4 * std::hypot(picture.width, picture.height);
  std::vector<std::array<Link, 4>> links(saddles.size());
  for (int i = 0; i < count; ++i) {
    if (stop.stop_requested()) return {};
    std::array<std::vector<std::pair<double, int>>, 4> ahead;
    for (int j = 0; j < count; ++j) {
      const Eigen::Vector2d away = saddles[j].pixel - saddles[i].pixel;
      const double distance = away.norm();
      if (j == i || distance > farthest || distance < 4) continue;
      const double angle = std::atan2(away.y(), away.x());
      for (int k = 0; k < 4; ++k)
        if (std::abs(wrapped(angle - saddles[i].edgeRad[k])) < kConeRad) ahead[k].emplace_back(distance, j);
    }
    for (int k = 0; k < 4; ++k) {
      std::sort(ahead[k].begin(), ahead[k].end());
      // Something small beside the edge may look like a corner; the board's next one comes soon after it.
      for (std::size_t n = 0; n < std::min<std::size_t>(ahead[k].size(), 6) && links[i][k].to < 0; ++n) {
        const int j = ahead[k][n].second;
        const Eigen::Vector2d back = saddles[i].pixel - saddles[j].pixel;
        const double angle = std::atan2(back.y(), back.x());
        for (int e = 0; e < 4; ++e) {
          // Going along, the bright side stays on the same hand: the sector after edge k here is the one
          // before edge e there.
          if (std::abs(wrapped(angle - saddles[j].edgeRad[e])) < kBackRad &&
              saddles[j].brightSector[(e + 3) % 4] == saddles[i].brightSector[k] &&
              edgeBetween(picture, saddles[i], saddles[j]))
            links[i][k] = {j, e};
        }
      }
    }
  }

  constexpr int kStepColumn[4] = {1, 0, -1, 0}, kStepRow[4] = {0, 1, 0, -1};
  std::vector<char> taken(saddles.size(), 0);
  std::vector<std::vector<GridCorner>> grids;
  for (int seed = 0; seed < count; ++seed) {
    if (taken[seed]) continue;
    std::vector<GridCorner> grid;
    std::map<std::pair<int, int>, int> occupied;
    std::queue<GridCorner> next;
    next.push({seed, 0, 0, 0});
    taken[seed] = 1;
    occupied[{0, 0}] = seed;
    while (!next.empty()) {
      const GridCorner corner = next.front();
      next.pop();
      grid.push_back(corner);
      for (int k = 0; k < 4; ++k) {
        const Link& link = links[corner.saddle][k];
        // Both must agree that they are neighbours.
        if (link.to < 0 || taken[link.to] || links[link.to][link.arrives].to != corner.saddle) continue;
        const int direction = (k + corner.quarter) % 4;
        GridCorner other{link.to, corner.column + kStepColumn[direction], corner.row + kStepRow[direction],
                         (direction + 2 - link.arrives + 8) % 4};
        if (!occupied.emplace(std::pair(other.column, other.row), other.saddle).second) continue;
        taken[link.to] = 1;
        next.push(other);
      }
    }
    if (grid.size() >= 4) grids.push_back(std::move(grid));
  }
  std::stable_sort(grids.begin(), grids.end(),
                   [](const auto& a, const auto& b) { return a.size() > b.size(); });
  return grids;
}

}  // namespace patina
