#include "devices/simulated/screen_integrator.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "devices/simulated/shown_pattern.h"
#include "devices/simulated/spline_levels.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kMostBytes = 512e6;  ///< of one level's sums; the usual 166 photographs reach level 5
constexpr int kBumpSamples = 128;

}  // namespace

ScreenIntegrator::ScreenIntegrator(const Screen& screen, std::vector<Eigen::Vector2i> frequencies,
                                   const IntegrationQuality& quality, const SimulatedEffects& effects)
    : screen_(screen), frequencies_(std::move(frequencies)), quality_(quality), effects_(effects) {
  stride_ = (static_cast<std::size_t>(patternCount()) + 3) / 4 * 4;
  const Eigen::Vector2d half = screen_.halfExtent();
  const auto bytes = [&](int level) {
    return 4 * half.x() * half.y() / (spacingOf(level) * spacingOf(level)) *
           static_cast<double>(stride_ * sizeof(float));
  };
  while (finestAllowed_ < kFinestLevel && bytes(finestAllowed_ + 1) <= kMostBytes) ++finestAllowed_;
}

// ---- where a point's nodes lie ----

ScreenIntegrator::Patch ScreenIntegrator::wholeScreen(double scale, double nodesPerScale) const {
  Patch patch;
  while (patch.level < finestAllowed_ && spacingOf(patch.level) * nodesPerScale > scale) ++patch.level;
  patch.resolved = spacingOf(patch.level) * nodesPerScale <= scale * 1.0001;
  const double h = spacingOf(patch.level);
  const Eigen::Vector2d half = screen_.halfExtent();
  patch.x1 = static_cast<int>(std::floor(half.x() / h)) + 3;
  patch.y1 = static_cast<int>(std::floor(half.y() / h)) + 3;
  patch.x0 = -patch.x1;
  patch.y0 = -patch.y1;
  return patch;
}

double ScreenIntegrator::nodesPerDistance(double smoothRad) const {
  double nodes = quality_.nodesPerDistance / std::min(1.0, smoothRad);
  // The horizon's edge needs two nodes and a half over its width.
  if (effects_.selfShadowing.horizonDeg > 0)
    nodes = std::max(nodes, 2.5 * 180 / (kPi * effects_.selfShadowing.softDeg));
  return nodes;
}

double ScreenIntegrator::slopePerUnit(const PointFrame& frame, const Eigen::Vector2d& x) const {
  const Eigen::Vector3d offset(x.x() - frame.point.x(), x.y() - frame.point.y(), -frame.point.z());
  const double length = offset.norm();
  const Eigen::Vector3d toLight = offset / length, s = toLight + frame.view;
  const double along = s.dot(frame.normal);
  if (along <= 1e-3) return 0;  // at or behind the horizon: no light, no scale
  Eigen::Matrix2d slope;
  for (int k = 0; k < 2; ++k) {
    const Eigen::Vector3d change = (Eigen::Vector3d::Unit(k) - toLight * toLight[k]) / length;
    slope(0, k) =
        (change.dot(frame.tangent) - s.dot(frame.tangent) / along * change.dot(frame.normal)) / along;
    slope(1, k) =
        (change.dot(frame.bitangent) - s.dot(frame.bitangent) / along * change.dot(frame.normal)) / along;
  }
  return slope.jacobiSvd().singularValues()[0];
}

ScreenIntegrator::Patch ScreenIntegrator::lobePatch(const PointFrame& frame, double widest,
                                                    double narrowest) const {
  const Eigen::Vector2d half = screen_.halfExtent();
  Eigen::Vector2d low = -half, high = half;
  const Eigen::Vector3d mirrored = 2 * frame.normal.dot(frame.view) * frame.normal - frame.view;
  // A lobe narrower than this reaches so few degrees that a box round its mirror point holds it; 1.4 covers
  // the perspective that makes the far side wider.
  const bool narrow = quality_.lobeReach * widest < 0.35;
  if (narrow && mirrored.z() < -0.05) {
    const double length = -frame.distance / mirrored.z();
    const Eigen::Vector2d mirror = frame.point.head<2>() + length * mirrored.head<2>();
    // The half-vector turns by half of what the light's direction does; that turns slowest where the screen
    // is foreshortened.
    const double slowest = 0.5 * -mirrored.z() / length;
    const double reach = 1.4 * quality_.lobeReach * widest / slowest;
    low = (mirror.array() - reach).matrix().cwiseMax(-half);
    high = (mirror.array() + reach).matrix().cwiseMin(half);
    if ((low.array() >= high.array()).any()) return Patch{0, 0, -1, 0, -1, true};  // misses the screen
  }
  double steepest = 0;
  for (int i = 0; i <= 4; ++i)
    for (int j = 0; j <= 4; ++j) {
      const Eigen::Vector2d t(i / 4.0, j / 4.0);
      steepest = std::max(steepest, slopePerUnit(frame, low + t.cwiseProduct(high - low)));
    }
  if (steepest <= 0) return Patch{0, 0, -1, 0, -1, true};
  double spacing = narrowest / steepest / quality_.nodesPerSigma;
  if (effects_.selfShadowing.horizonDeg > 0)
    spacing = std::min(spacing, std::abs(frame.distance) / nodesPerDistance(1));
  Patch patch = wholeScreen(spacing * quality_.nodesPerSigma, quality_.nodesPerSigma);
  const double h = spacingOf(patch.level);
  patch.x0 = std::max(patch.x0, static_cast<int>(std::floor(low.x() / h)) - 3);
  patch.x1 = std::min(patch.x1, static_cast<int>(std::ceil(high.x() / h)) + 3);
  patch.y0 = std::max(patch.y0, static_cast<int>(std::floor(low.y() / h)) - 3);
  patch.y1 = std::min(patch.y1, static_cast<int>(std::ceil(high.y() / h)) + 3);
  return patch;
}

ScreenIntegrator::Patch ScreenIntegrator::patchOf(const PointFrame& frame, const SurfacePart& part) const {
  using Kind = SurfacePart::Kind;
  switch (part.kind) {
    case Kind::Nothing:
      break;
    case Kind::Lambert:
    case Kind::Grazing:
      return wholeScreen(std::abs(frame.distance), nodesPerDistance(1));
    case Kind::Gaussian:
      return lobePatch(frame, std::max(part.sigmaAlong, part.sigmaAcross),
                       std::min(part.sigmaAlong, part.sigmaAcross));
    case Kind::Sheen:
      return wholeScreen(std::abs(frame.distance), nodesPerDistance(1.5 * part.width));
    case Kind::Retro:
      return wholeScreen(std::abs(frame.distance), nodesPerDistance(5 * part.width));
  }
  return Patch{0, 0, -1, 0, -1, true};
}

int ScreenIntegrator::finestLevel(const Eigen::Vector3d& pointMm, const Eigen::Vector3d& toView,
                                  const SheetPoint& material) const {
  const PointFrame frame = pointFrame(screen_, effects_, pointMm, toView, material.normal);
  const SurfaceParts parts = surfaceParts(material, effects_);
  SurfacePart lambert;
  lambert.kind = SurfacePart::Kind::Lambert;
  int finest = patchOf(frame, lambert).level;
  for (const auto* list : {&parts.specular, &parts.white})
    for (const SurfacePart& part : *list) {
      const Patch patch = patchOf(frame, part);
      if (!patch.resolved) return -1;
      finest = std::max(finest, patch.level);
    }
  return finest;
}

// ---- what depends on the patterns only ----

void ScreenIntegrator::fillFinest(Level& level, std::size_t firstFrequency, std::size_t endFrequency,
                                  const std::stop_token& stop) const {
  const Eigen::Vector2d half = screen_.halfExtent();
  const int cellsX = quality_.cellsAcross;
  const int cellsY = std::max(1, static_cast<int>(std::lround(cellsX * half.y() / half.x())));
  const double hx = 2 * half.x() / cellsX, hy = 2 * half.y() / cellsY;
  const std::size_t count = endFrequency - firstFrequency;
  const bool withWindow = firstFrequency == 0;
  const std::size_t values = 4 * count + (withWindow ? 1 : 0);
  const double gamma = effects_.screenResponse.gamma;  // of a product: of its factors
  const bool uneven = effects_.has("emission-spatial");
  const ShownValue shown(gamma);

  std::vector<RectifiedMean> rectified;
  for (std::size_t f = firstFrequency; f < endFrequency; ++f)
    rectified.emplace_back(frequencies_[f].x() * hx, frequencies_[f].y() * hy);
  std::vector<float> sinX(count * cellsX), cosX(count * cellsX), windowX(cellsX);
  std::vector<int> firstNode(cellsX);
  std::vector<std::array<float, 4>> basisX(cellsX);
  for (int i = 0; i < cellsX; ++i) {
    const double x = -half.x() + (i + 0.5) * hx, u = x / level.spacing;
    windowX[i] = static_cast<float>(
        std::exp(-0.5 * gamma * x * x / (screen_.windowSigma.x() * screen_.windowSigma.x())));
    firstNode[i] = static_cast<int>(std::floor(u)) - 1;
    basisX[i] = cubicBasis(u - std::floor(u));
    for (std::size_t f = 0; f < count; ++f) {
      sinX[i * count + f] = static_cast<float>(std::sin(frequencies_[firstFrequency + f].x() * x));
      cosX[i * count + f] = static_cast<float>(std::cos(frequencies_[firstFrequency + f].x() * x));
    }
  }

  std::vector<float> row(level.nodesX() * values), cell(values), sinY(count), cosY(count);
  for (int j = 0; j < cellsY && !stop.stop_requested(); ++j) {
    const double y = -half.y() + (j + 0.5) * hy, v = y / level.spacing;
    const double windowY =
        std::exp(-0.5 * gamma * y * y / (screen_.windowSigma.y() * screen_.windowSigma.y()));
    for (std::size_t f = 0; f < count; ++f) {
      sinY[f] = static_cast<float>(std::sin(frequencies_[firstFrequency + f].y() * y));
      cosY[f] = static_cast<float>(std::cos(frequencies_[firstFrequency + f].y() * y));
    }
    std::fill(row.begin(), row.end(), 0.0f);
    for (int i = 0; i < cellsX; ++i) {
      float lit = static_cast<float>(windowY * hx * hy) * windowX[i];
      if (uneven) lit *= static_cast<float>(backlight(effects_, half, -half.x() + (i + 0.5) * hx, y));
      for (std::size_t f = 0; f < count; ++f) {
        const float sx = sinX[i * count + f], cx = cosX[i * count + f];
        const float s = sx * cosY[f] + cx * sinY[f], c = cx * cosY[f] - sx * sinY[f];
        const float absS = rectified[f](s), absC = rectified[f](c);
        cell[4 * f] = 0.5f * lit * (absS + s);      // sin(w.x)
        cell[4 * f + 1] = 0.5f * lit * (absC + c);  // sin(w.x + pi/2)
        cell[4 * f + 2] = 0.5f * lit * (absS - s);
        cell[4 * f + 3] = 0.5f * lit * (absC - c);
        if (gamma != 1) {
          cell[4 * f] = lit * shown(0.5f * (absS + s));
          cell[4 * f + 1] = lit * shown(0.5f * (absC + c));
          cell[4 * f + 2] = lit * shown(0.5f * (absS - s));
          cell[4 * f + 3] = lit * shown(0.5f * (absC - c));
        }
      }
      if (withWindow) cell[4 * count] = lit;
      for (int k = 0; k < 4; ++k) {
        float* to = row.data() + static_cast<std::size_t>(firstNode[i] + k + level.reachX) * values;
        const float weight = basisX[i][static_cast<std::size_t>(k)];
        for (std::size_t p = 0; p < values; ++p) to[p] += weight * cell[p];
      }
    }
    const std::array<float, 4> basisY = cubicBasis(v - std::floor(v));
    for (int k = 0; k < 4; ++k) {
      const int node = static_cast<int>(std::floor(v)) - 1 + k + level.reachY;
      for (std::size_t n = 0; n < level.nodesX(); ++n) {
        float* to = level.sums.data() + (static_cast<std::size_t>(node) * level.nodesX() + n) * stride_;
        const float* from = row.data() + n * values;
        const float weight = basisY[static_cast<std::size_t>(k)];
        for (std::size_t p = 0; p < 4 * count; ++p) to[4 * firstFrequency + p] += weight * from[p];
        if (withWindow) to[4 * frequencies_.size()] += weight * from[4 * count];
      }
    }
  }
}

bool ScreenIntegrator::prepare(int finest, const std::stop_token& stop) {
  finest = std::clamp(finest, 0, finestAllowed_);
  const Eigen::Vector2d half = screen_.halfExtent();
  levels_.assign(static_cast<std::size_t>(finest) + 1, {});
  for (int l = 0; l <= finest; ++l) {
    Level& level = levels_[static_cast<std::size_t>(l)];
    level.spacing = spacingOf(l);
    level.reachX = static_cast<int>(std::floor(half.x() / level.spacing)) + 3;
    level.reachY = static_cast<int>(std::floor(half.y() / level.spacing)) + 3;
    level.sums.assign(level.nodesX() * level.nodesY() * stride_, 0.0f);
  }
  Level& fine = levels_.back();
  constexpr std::size_t kBlock = 7;
  const std::size_t blocks = std::max<std::size_t>(1, (frequencies_.size() + kBlock - 1) / kBlock);
  tbb::parallel_for(std::size_t{0}, blocks, [&](std::size_t b) {
    fillFinest(fine, b * kBlock, std::min(frequencies_.size(), (b + 1) * kBlock), stop);
  });
  if (stop.stop_requested()) return false;

  // A spline of the coarser grid is a sum of five of the finer one (1 4 6 4 1) / 8 along each axis.
  constexpr std::array<float, 5> kTwoScale{0.125f, 0.5f, 0.75f, 0.5f, 0.125f};
  for (int l = finest; l > 0; --l) {
    const Level& from = levels_[static_cast<std::size_t>(l)];
    Level& to = levels_[static_cast<std::size_t>(l) - 1];
    tbb::parallel_for(-to.reachY, to.reachY + 1, [&](int ky) {
      for (int kx = -to.reachX; kx <= to.reachX; ++kx) {
        float* sum = to.sums.data() + (static_cast<std::size_t>(ky + to.reachY) * to.nodesX() +
                                       static_cast<std::size_t>(kx + to.reachX)) *
                                          stride_;
        for (int my = -2; my <= 2; ++my)
          for (int mx = -2; mx <= 2; ++mx) {
            const int fx = 2 * kx + mx, fy = 2 * ky + my;
            if (std::abs(fx) > from.reachX || std::abs(fy) > from.reachY)
              continue;  // lies off the screen: no light
            const float weight =
                kTwoScale[static_cast<std::size_t>(mx + 2)] * kTwoScale[static_cast<std::size_t>(my + 2)];
            const float* part =
                from.sums.data() + (static_cast<std::size_t>(fy + from.reachY) * from.nodesX() +
                                    static_cast<std::size_t>(fx + from.reachX)) *
                                       stride_;
            for (std::size_t p = 0; p < stride_; ++p) sum[p] += weight * part[p];
          }
      }
    });
  }
  // Spline coefficients from values: (-f[k-1] + 8 f[k] - f[k+1]) / 6 (exact for cubics, error of fourth
  // order). Folded into the sums by its transpose, which is itself.
  for (Level& level : levels_) {
    const auto along = [&](std::size_t lines, std::size_t count, std::size_t lineStep, std::size_t step) {
      tbb::parallel_for(std::size_t{0}, lines, [&](std::size_t line) {
        float* base = level.sums.data() + line * lineStep * stride_;
        std::vector<float> previous(stride_, 0.0f), current(stride_);
        for (std::size_t k = 0; k < count; ++k) {
          float* here = base + k * step * stride_;
          const float* next = k + 1 < count ? here + step * stride_ : nullptr;
          std::copy(here, here + stride_, current.begin());
          for (std::size_t p = 0; p < stride_; ++p)
            here[p] = (8 * current[p] - previous[p] - (next ? next[p] : 0.0f)) * (1.0f / 6);
          std::swap(previous, current);
        }
      });
    };
    along(level.nodesY(), level.nodesX(), level.nodesX(), 1);
    along(level.nodesX(), level.nodesY(), 1, level.nodesX());
  }
  return !stop.stop_requested();
}

// ---- points ----

void ScreenIntegrator::accumulate(const std::vector<PointFrame>& frames,
                                  const std::vector<SurfacePart>& parts, Eigen::MatrixXf& response) const {
  Eigen::MatrixXf kernels, sum;
  Eigen::ArrayXf row;
  std::vector<bool> done(frames.size(), false);
  std::vector<Patch> patches;
  for (std::size_t i = 0; i < frames.size(); ++i) patches.push_back(patchOf(frames[i], parts[i]));
  for (std::size_t lead = 0; lead < frames.size(); ++lead) {
    if (done[lead]) continue;
    // All points on this level, over the rectangle that holds their patches.
    const double spacing = spacingOf(patches[lead].level);
    std::vector<LightKernel> kernelRows;
    std::vector<std::size_t> member;
    Patch all = patches[lead];
    for (std::size_t i = lead; i < frames.size(); ++i) {
      const Patch& patch = patches[i];
      if (patch.level != patches[lead].level) continue;
      done[i] = true;
      if (patch.x1 < patch.x0 || patch.y1 < patch.y0 || frames[i].distance <= 0)
        continue;  // off the screen, or behind it
      kernelRows.emplace_back(screen_, effects_, quality_.lobeReach, frames[i], parts[i], patch.x0, patch.x1,
                              spacing);
      if (member.empty()) all = patch;
      member.push_back(i);
      all.x0 = std::min(all.x0, patch.x0), all.x1 = std::max(all.x1, patch.x1);
      all.y0 = std::min(all.y0, patch.y0), all.y1 = std::max(all.y1, patch.y1);
    }
    if (member.empty()) continue;
    const Level& level =
        levels_.at(static_cast<std::size_t>(patches[lead].level));  // throws where `prepare` was forgotten
    const auto width = static_cast<Eigen::Index>(all.x1 - all.x0 + 1);
    const auto columns = static_cast<Eigen::Index>(member.size());
    sum.setZero(static_cast<Eigen::Index>(stride_), columns);
    for (int ky = all.y0; ky <= all.y1; ++ky) {
      kernels.setZero(width, columns);
      Eigen::Index begin = width, end = 0;
      for (std::size_t k = 0; k < member.size(); ++k) {
        const Patch& patch = patches[member[k]];
        if (ky < patch.y0 || ky > patch.y1) continue;
        int first = 0, last = 0;
        kernelRows[k].evaluate(ky, row, first, last);
        if (first == last) continue;
        const Eigen::Index at = patch.x0 - all.x0 + first;
        kernels.col(static_cast<Eigen::Index>(k)).segment(at, last - first) =
            row.segment(first, last - first).matrix();
        begin = std::min(begin, at), end = std::max(end, at + last - first);
      }
      if (begin >= end) continue;
      const float* sums = level.sums.data() + (static_cast<std::size_t>(ky + level.reachY) * level.nodesX() +
                                               static_cast<std::size_t>(all.x0 + begin + level.reachX)) *
                                                  stride_;
      const Eigen::Map<const Eigen::MatrixXf> block(sums, static_cast<Eigen::Index>(stride_), end - begin);
      sum.noalias() += block * kernels.middleRows(begin, end - begin);
    }
    for (std::size_t k = 0; k < member.size(); ++k)
      response.col(static_cast<Eigen::Index>(member[k])) += sum.col(static_cast<Eigen::Index>(k));
  }
}

void ScreenIntegrator::respond(const std::vector<Query>& group, GroupResponse& out) const {
  const auto points = static_cast<Eigen::Index>(group.size());
  std::vector<PointFrame> frames;
  std::vector<SurfaceParts> surfaces;
  std::size_t specular = 0, white = 0;
  for (const Query& query : group) {
    const PointFrame& frame = frames.emplace_back(
        pointFrame(screen_, effects_, query.pointMm, query.toView, query.material.normal));
    const bool seen = frame.normal.dot(frame.view) > 0;
    const SurfaceParts& parts =
        surfaces.emplace_back(seen ? surfaceParts(query.material, effects_) : SurfaceParts{});
    specular = std::max(specular, parts.specular.size());
    white = std::max(white, parts.white.size());
  }
  const auto add = [&](const auto& partOf, Eigen::MatrixXf& response) {
    std::vector<SurfacePart> parts;
    for (const SurfaceParts& surface : surfaces) parts.push_back(partOf(surface));
    accumulate(frames, parts, response);
  };
  const auto nth = [](const std::vector<SurfacePart>& list, std::size_t k) {
    return k < list.size() ? list[k] : SurfacePart{};
  };
  out.diffuse.setZero(static_cast<Eigen::Index>(stride_), points);
  out.specular.setZero(static_cast<Eigen::Index>(stride_), points);
  add([](const SurfaceParts& surface) { return surface.lambert; }, out.diffuse);
  for (std::size_t k = 0; k < specular; ++k)
    add([&](const SurfaceParts& surface) { return nth(surface.specular, k); }, out.specular);
  out.white.resize(white > 0 ? static_cast<Eigen::Index>(stride_) : 0, white > 0 ? points : 0);
  out.white.setZero();
  for (std::size_t k = 0; k < white; ++k)
    add([&](const SurfaceParts& surface) { return nth(surface.white, k); }, out.white);
}

PointResponse ScreenIntegrator::respond(const Eigen::Vector3d& pointMm, const Eigen::Vector3d& toView,
                                        const SheetPoint& material) const {
  GroupResponse response;
  respond({{pointMm, toView, material}}, response);
  PointResponse out{response.diffuse.col(0).array(), response.specular.col(0).array(), {}};
  if (response.white.size() > 0) out.white = response.white.col(0).array();
  return out;
}

}  // namespace patina
