#include "devices/simulated/spline_picture.h"

#include <array>
#include <cmath>

#include "devices/simulated/spline_levels.h"

namespace patina {

SplinePicture::SplinePicture(const Screen& screen, const Image& light, int finest) {
  const Eigen::Vector2d half = screen.halfExtent();
  levels_.resize(static_cast<std::size_t>(finest) + 1);
  for (int l = 0; l <= finest; ++l) {
    Level& level = levels_[static_cast<std::size_t>(l)];
    level.spacing = spacingOf(l);
    level.reachX = static_cast<int>(std::floor(half.x() / level.spacing)) + 3;
    level.reachY = static_cast<int>(std::floor(half.y() / level.spacing)) + 3;
    level.sums.assign(level.nodesX() * level.nodesY(), 0.0f);
  }
  Level& fine = levels_.back();
  const int width = light.width(), height = light.height();
  const double hx = 2 * half.x() / width, hy = 2 * half.y() / height;
  const auto area = static_cast<float>(hx * hy);
  struct Column {
    int node;
    std::array<float, 4> basis;
  };
  std::vector<Column> columns;
  for (int i = 0; i < width; ++i) {
    const double u = (-half.x() + (i + 0.5) * hx) / fine.spacing;
    columns.push_back({static_cast<int>(std::floor(u)) - 1, cubicBasis(u - std::floor(u))});
  }
  std::vector<float> row(fine.nodesX());
  for (int j = 0; j < height; ++j) {
    std::fill(row.begin(), row.end(), 0.0f);
    for (int i = 0; i < width; ++i) {
      const float lit = light.at(i, j) * area;
      const Column& column = columns[static_cast<std::size_t>(i)];
      float* to = row.data() + column.node + fine.reachX;
      for (int k = 0; k < 4; ++k) to[k] += column.basis[static_cast<std::size_t>(k)] * lit;
    }
    const double v = (half.y() - (j + 0.5) * hy) / fine.spacing;  // row 0 is at the top, +y
    const std::array<float, 4> basis = cubicBasis(v - std::floor(v));
    for (int k = 0; k < 4; ++k) {
      float* to = fine.sums.data() + fine.index(-fine.reachX, static_cast<int>(std::floor(v)) - 1 + k);
      for (std::size_t n = 0; n < row.size(); ++n) to[n] += basis[static_cast<std::size_t>(k)] * row[n];
    }
  }
  // A spline of the coarser grid is a sum of five of the finer one, (1 4 6 4 1) / 8 along each axis.
  constexpr std::array<float, 5> kTwoScale{0.125f, 0.5f, 0.75f, 0.5f, 0.125f};
  for (int l = finest; l > 0; --l) {
    const Level& from = levels_[static_cast<std::size_t>(l)];
    Level& to = levels_[static_cast<std::size_t>(l) - 1];
    for (int ky = -to.reachY; ky <= to.reachY; ++ky)
      for (int kx = -to.reachX; kx <= to.reachX; ++kx) {
        float sum = 0;
        for (int my = -2; my <= 2; ++my)
          for (int mx = -2; mx <= 2; ++mx) {
            const int fx = 2 * kx + mx, fy = 2 * ky + my;
            if (std::abs(fx) > from.reachX || std::abs(fy) > from.reachY)
              continue;  // off the screen: no light
            sum += kTwoScale[static_cast<std::size_t>(mx + 2)] * kTwoScale[static_cast<std::size_t>(my + 2)] *
                   from.sums[from.index(fx, fy)];
          }
        to.sums[to.index(kx, ky)] = sum;
      }
  }
  // Spline coefficients from a kernel's values, (-f[k-1] + 8 f[k] - f[k+1]) / 6, folded into the sums.
  for (Level& level : levels_) {
    const auto along = [&](std::size_t lines, std::size_t count, std::size_t lineStep, std::size_t step) {
      for (std::size_t line = 0; line < lines; ++line) {
        float* base = level.sums.data() + line * lineStep;
        float previous = 0;
        for (std::size_t k = 0; k < count; ++k) {
          const float here = base[k * step], next = k + 1 < count ? base[(k + 1) * step] : 0.0f;
          base[k * step] = (8 * here - previous - next) * (1.0f / 6);
          previous = here;
        }
      }
    };
    along(level.nodesY(), level.nodesX(), level.nodesX(), 1);
    along(level.nodesX(), level.nodesY(), 1, level.nodesX());
  }
}

float SplinePicture::dot(int level, int x0, int y0, int width, int height, const float* values) const {
  const Level& grid = levels_.at(static_cast<std::size_t>(level));
  float sum = 0;
  for (int j = 0; j < height; ++j) {
    const float* lights = grid.sums.data() + grid.index(x0, y0 + j);
    const float* row = values + static_cast<std::size_t>(j) * static_cast<std::size_t>(width);
    float part = 0;
    for (int i = 0; i < width; ++i) part += lights[i] * row[i];
    sum += part;
  }
  return sum;
}

}  // namespace patina
