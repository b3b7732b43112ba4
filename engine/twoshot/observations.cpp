#include "engine/twoshot/observations.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <queue>

#include "engine/twoshot/mapping.h"
#include "engine/twoshot/metric.h"

namespace patina {
namespace {

constexpr int kSectors = 6;
/// A block whose mapped values vary by less (standard deviation, natural-log units) is averaged as it is.
constexpr double kFlat = 0.02;
/// A cell with a smaller share of its pixels in use counts in proportion: a sliver is no measurement of it.
constexpr double kWholeCellShare = 0.05;
/// Blocks that the quadtree starts with, as a share of the rows.
constexpr double kFirstShare = 0.25;

/// What each pixel of the material that can be used weighs; 0 for the others.
std::vector<float> pixelWeights(const ReflectancePicture& picture, const std::vector<std::int8_t>* materialOf,
                                int material) {
  const SampleView& view = picture.view;
  const std::size_t pixels = picture.usable.size();
  double inside = 0;
  double areaMm2 = 0;
  Eigen::Vector2f low = Eigen::Vector2f::Constant(1e30f), high = -low;
  for (std::size_t i = 0; i < pixels; ++i) {
    if (!view.inside[i]) continue;
    inside += 1;
    areaMm2 += view.areaMm2[i];
    low = low.cwiseMin(view.positionMm[i]), high = high.cwiseMax(view.positionMm[i]);
  }
  std::vector<float> weights(pixels, 0.0f);
  if (!(areaMm2 > 0)) return weights;
  const double side = std::sqrt(areaMm2 / kEtaRows);
  const int columns = static_cast<int>((high - low).x() / side) + 1,
            rows = static_cast<int>((high - low).y() / side) + 1;
  struct Cell {
    double pixels = 0, used = 0;
  };
  std::vector<Cell> cells(static_cast<std::size_t>(columns) * rows);
  const auto cellOf = [&](std::size_t i) -> Cell& {
    const Eigen::Vector2f p = (view.positionMm[i] - low) / static_cast<float>(side);
    const int x = std::clamp(static_cast<int>(p.x()), 0, columns - 1),
              y = std::clamp(static_cast<int>(p.y()), 0, rows - 1);
    return cells[static_cast<std::size_t>(y) * columns + x];
  };
  const auto counts = [&](std::size_t i) {
    return picture.usable[i] && (!materialOf || (*materialOf)[i] == material);
  };
  for (std::size_t i = 0; i < pixels; ++i) {
    if (!view.inside[i]) continue;
    Cell& cell = cellOf(i);
    cell.pixels += 1;
    cell.used += counts(i);
  }
  for (std::size_t i = 0; i < pixels; ++i) {
    if (!view.inside[i] || !counts(i)) continue;
    const Cell& cell = cellOf(i);
    const double whole = std::min(1.0, cell.used / (kWholeCellShare * cell.pixels));
    weights[i] = static_cast<float>(kEtaRows * cell.pixels / inside * whole / cell.used);
  }
  return weights;
}

struct Block {
  int x = 0, y = 0, side = 1;
  double weight = 0, squaredWeight = 0, badness = 0;
  std::size_t pixels = 0;
  Eigen::Array3d brdf = Eigen::Array3d::Zero(), variance = Eigen::Array3d::Zero();
  Eigen::Vector2d positionMm = Eigen::Vector2d::Zero();
};

struct Quadtree {
  const ReflectancePicture& picture;
  const std::vector<float>& weights;
  std::vector<Eigen::Array3f> mapped;  ///< ln(f w + eps) of each pixel

  Quadtree(const ReflectancePicture& source, const std::vector<float>& pixelWeight)
      : picture(source), weights(pixelWeight), mapped(pixelWeight.size()) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, mapped.size(), 4096),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                        for (std::size_t i = range.begin(); i < range.end(); ++i) {
                          if (!(weights[i] > 0)) continue;
                          const DirectionPair pair =
                              directionsAt(picture, picture.view.positionMm[i].cast<double>());
                          const double w = mappingWeight(pair.toLight.z(), pair.toView.z());
                          for (int c = 0; c < 3; ++c) {
                            const double f = std::max(picture.brdf.samples()[3 * i + c], 0.0f);
                            mapped[i][c] = static_cast<float>(std::log(f * w + kMappingEpsilon));
                          }
                        }
                      });
  }

  Block measure(int x0, int y0, int side) const {
    const SampleView& view = picture.view;
    Block block;
    block.x = x0, block.y = y0, block.side = side;
    Eigen::Array3d sum = Eigen::Array3d::Zero(), squares = sum, noise = sum, white = sum;
    for (int y = y0; y < std::min(y0 + side, view.height); ++y) {
      for (int x = x0; x < std::min(x0 + side, view.width); ++x) {
        const std::size_t i = view.index(x, y);
        const double w = weights[i];
        if (!(w > 0)) continue;
        ++block.pixels;
        block.weight += w, block.squaredWeight += w * w;
        block.positionMm += w * view.positionMm[i].cast<double>();
        const Eigen::Array3d g = mapped[i].cast<double>();
        sum += w * g, squares += w * g * g;
        for (int c = 0; c < 3; ++c) {
          const double f = picture.brdf.samples()[3 * i + c], v = picture.variance.samples()[3 * i + c];
          block.brdf[c] += w * f;
          block.variance[c] += w * w * v;
          noise[c] += w * v;
          white[c] += w * picture.irradiance.relativeVariance.samples()[3 * i + c];
        }
      }
    }
    if (block.pixels == 0) return block;
    const double total = block.weight;
    block.brdf /= total, block.positionMm /= total;
    block.variance /= total * total;
    sum /= total, squares /= total, noise /= total, white /= total;
    // The white's noise was averaged over a neighbourhood already: only blocks larger than it average it
    // further.
    const double blocks = std::max(1.0, static_cast<double>(block.pixels) / picture.irradiance.smoothedOver);
    block.variance += block.brdf.square() * white / blocks;
    const DirectionPair pair = directionsAt(picture, block.positionMm);
    const double w = mappingWeight(pair.toLight.z(), pair.toView.z());
    const Eigen::Array3d slope = w / (block.brdf.max(0.0) * w + kMappingEpsilon);
    const double spread = (squares - sum.square() - noise * slope.square()).maxCoeff();
    if (side > 1 && spread > kFlat * kFlat) block.badness = total * spread;
    return block;
  }

  std::vector<Block> blocks(int rows) const {
    const SampleView& view = picture.view;
    std::size_t used = 0;
    for (const float w : weights) used += w > 0;
    int side = 1;
    while (static_cast<double>(used) / (side * side) > kFirstShare * rows) side *= 2;
    const auto worse = [](const Block& a, const Block& b) {
      // Ties by place, so that the result doesn't depend on the queue's inner order.
      if (a.badness != b.badness) return a.badness < b.badness;
      return a.y != b.y ? a.y > b.y : a.x > b.x;
    };
    std::priority_queue<Block, std::vector<Block>, decltype(worse)> queue(worse);
    std::vector<Block> done;
    std::size_t count = 0;
    const auto keep = [&](const Block& block) {
      if (block.pixels == 0) return;
      ++count;
      if (block.badness > 0) {
        queue.push(block);
      } else {
        done.push_back(block);
      }
    };
    for (int y = 0; y < view.height; y += side) {
      for (int x = 0; x < view.width; x += side) keep(measure(x, y, side));
    }
    while (!queue.empty() && count < static_cast<std::size_t>(rows)) {
      const Block block = queue.top();
      queue.pop();
      --count;
      const int half = block.side / 2;
      for (int q = 0; q < 4; ++q) keep(measure(block.x + q % 2 * half, block.y + q / 2 * half, half));
    }
    for (; !queue.empty(); queue.pop()) done.push_back(queue.top());
    std::sort(done.begin(), done.end(),
              [](const Block& a, const Block& b) { return a.y != b.y ? a.y < b.y : a.x < b.x; });
    return done;
  }
};

}  // namespace

Observations observe(const std::vector<ReflectancePicture>& pictures,
                     const std::vector<std::vector<std::int8_t>>& materialOf, int material,
                     int rowsPerPicture) {
  Observations rows;
  for (std::size_t p = 0; p < pictures.size(); ++p) {
    const ReflectancePicture& picture = pictures[p];
    const auto* labels = materialOf.empty() ? nullptr : &materialOf[p];
    const std::vector<float> weights = pixelWeights(picture, labels, material);
    std::size_t inside = 0, used = 0;
    for (std::size_t i = 0; i < weights.size(); ++i) {
      inside += picture.view.inside[i];
      used += weights[i] > 0;
    }
    rows.picturePixels.push_back(used);
    rows.pixels += used;
    if (used == 0) continue;
    // A material's share of the rows is its share of the sample, but never so few that it would be starved.
    const int budget = std::max(std::min(rowsPerPicture, 300),
                                static_cast<int>(static_cast<double>(rowsPerPicture) * used / inside));
    const Quadtree tree(picture, weights);
    const std::vector<Block> blocks = tree.blocks(budget);
    Eigen::Vector2d middle = Eigen::Vector2d::Zero();
    double total = 0;
    for (const Block& block : blocks) middle += block.weight * block.positionMm, total += block.weight;
    middle /= total;
    for (const Block& block : blocks) {
      rows.angles.push_back(anglesAt(picture, directionsAt(picture, block.positionMm)));
      rows.positionMm.push_back(block.positionMm);
      rows.brdf.push_back(block.brdf);
      rows.variance.push_back(block.variance);
      rows.weight.push_back(block.weight);
      rows.picture.push_back(static_cast<int>(p));
      const Eigen::Vector2d away = block.positionMm - middle;
      const double turn = std::atan2(away.y(), away.x()) / (2 * std::numbers::pi) + 0.5;
      const int sector = std::min(kSectors - 1, static_cast<int>(turn * kSectors));
      rows.fold.push_back(pictures.size() >= 3 ? static_cast<int>(p) : sector);
    }
  }
  return rows;
}

}  // namespace patina
