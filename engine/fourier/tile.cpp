#include "engine/fourier/tile.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "engine/fourier/pooling.h"

namespace patina {
namespace {

constexpr double kParameters = 10;  // of a texel: four of the lobe, six albedos

/// Neighbours and their weights, the site itself first with weight one.
struct Pool {
  std::array<std::size_t, 9> site;
  std::array<double, 9> weight;
  int count = 0;
  void add(std::size_t s, double w) {
    site[static_cast<std::size_t>(count)] = s;
    weight[static_cast<std::size_t>(count++)] = w;
  }
};

constexpr double kNegligible = 0.02;  // weight of a neighbour

/// Squared distance of two sites' measurements in units of the difference's variance, and how many were
/// compared.
struct Distance {
  double q = 0, count = 0;
};

/// The squared distance beyond which a neighbour of so many measurements has no weight.
double mostAlike(double count) {
  return count + std::sqrt(2 * count) + kParameters * (1 / kNegligible - 1) / 2;
}

/// Incomplete beyond `mostAlike`.
Distance distanceBetween(const FourierMeasurements& m, const SiteBlock& block, std::size_t s, std::size_t n) {
  const std::size_t stride = static_cast<std::size_t>(m.frequencyCount()) * 6;
  const float *z = block.z(s), *zn = block.z(n);
  Distance distance{0, 3.0 * (2 * m.frequencyCount() + 1)};
  const auto here = m.droppedRows(s), there = m.droppedRows(n);
  double perVariance[3];
  for (int c = 0; c < 3; ++c) perVariance[c] = 1 / (m.variance(s, c) + m.variance(n, c));
  float sums[3];
  // Most neighbours on a glossy sheet are told apart by a part of the measurements.
  const std::size_t some = here.empty() && there.empty() ? stride / 4 / 48 * 48 : 0;
  double channel[3] = {0, 0, 0};
  if (some > 0) {
    squaredGaps(z, zn, some, sums);
    for (int c = 0; c < 3; ++c) distance.q += perVariance[c] * (channel[c] = sums[c]);
    if (distance.q > mostAlike(distance.count)) return distance;
    distance.q = 0;
  }
  squaredGaps(z + some, zn + some, stride - some, sums);
  for (int c = 0; c < 3; ++c) channel[c] += sums[c];
  const auto drop = [&](std::span<const std::uint16_t> rows, std::span<const std::uint16_t> already) {
    for (const auto row : rows) {
      if (std::find(already.begin(), already.end(), row) != already.end()) continue;
      const std::size_t at = static_cast<std::size_t>(row) * 3;
      for (std::size_t c = 0; c < 3; ++c) {
        const float gap = z[at + c] - zn[at + c];
        channel[c] = std::max(0.0, channel[c] - static_cast<double>(gap) * gap);
      }
      distance.count -= 3;
    }
  };
  if (!here.empty() || !there.empty()) drop(here, {}), drop(there, here);
  for (int c = 0; c < 3; ++c) {
    const double dc = m.dc[s * 3 + static_cast<std::size_t>(c)] - m.dc[n * 3 + static_cast<std::size_t>(c)];
    distance.q += channel[c] * perVariance[c] + dc * dc / (m.dcVariance(s, c) + m.dcVariance(n, c));
  }
  return distance;
}

Pool poolOf(const FourierMeasurements& m, const SiteBlock& block, std::size_t s) {
  Pool pool;
  pool.add(s, 1.0);
  const SiteSet& set = m.sites;
  if (set.grouped()) return pool;
  const int x = static_cast<int>(set.pixel[s].x()), y = static_cast<int>(set.pixel[s].y());
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      if ((dx == 0 && dy == 0) || x + dx < 0 || y + dy < 0 || x + dx >= set.imageWidth ||
          y + dy >= set.imageHeight)
        continue;
      const auto other =
          set.siteOfPixel[static_cast<std::size_t>(y + dy) * static_cast<std::size_t>(set.imageWidth) +
                          static_cast<std::size_t>(x + dx)];
      if (other < 0) continue;
      const auto n = static_cast<std::size_t>(other);
      const Distance distance = distanceBetween(m, block, s, n);
      const double excess = std::max(0.0, distance.q - distance.count - std::sqrt(2 * distance.count));
      const double weight = 1 / (1 + 2 * excess / kParameters);
      if (weight >= kNegligible) pool.add(n, weight);
    }
  }
  return pool;
}

/// Components that no site of the pool has.
std::vector<std::uint16_t> missingRows(const FourierMeasurements& m, const Pool& pool) {
  std::vector<std::uint16_t> missing;
  for (const auto row : m.droppedRows(pool.site[0])) {
    bool anywhere = false;
    for (int k = 1; k < pool.count; ++k) {
      const auto dropped = m.droppedRows(pool.site[static_cast<std::size_t>(k)]);
      anywhere |= !std::binary_search(dropped.begin(), dropped.end(), row);
    }
    if (!anywhere) missing.push_back(row);
  }
  return missing;
}

/// Rows that some site of the pool lacks get the mean over those that have them.
void mendRows(const FourierMeasurements& m, const SiteBlock& block, const Pool& pool, float* z) {
  for (int k = 0; k < pool.count; ++k) {
    for (const auto row : m.droppedRows(pool.site[static_cast<std::size_t>(k)])) {
      double total = 0, sum[3] = {0, 0, 0};
      for (int i = 0; i < pool.count; ++i) {
        const std::size_t n = pool.site[static_cast<std::size_t>(i)];
        const auto dropped = m.droppedRows(n);
        if (std::binary_search(dropped.begin(), dropped.end(), row)) continue;
        const double w = pool.weight[static_cast<std::size_t>(i)];
        total += w;
        for (std::size_t c = 0; c < 3; ++c) sum[c] += w * block.z(n)[static_cast<std::size_t>(row) * 3 + c];
      }
      for (std::size_t c = 0; c < 3; ++c)
        z[static_cast<std::size_t>(row) * 3 + c] = total > 0 ? static_cast<float>(sum[c] / total) : 0.0f;
    }
  }
}

}  // namespace

SiteData Tile::describe(const FourierFitState& state, const DiffuseTransform& transform, std::size_t site,
                        const Eigen::Vector2d& point, double varianceShare, const float* z, const float* dc,
                        float* diffuse) const {
  SiteData out;
  out.geometry = state.geometry(site, point);
  transform.at(point, diffuse);
  out.diffuse = diffuse;
  out.z = z;
  out.dc = dc;
  const FourierFitState::Weights weights = state.weights(site);
  const double share = state.options.weights == MeasurementWeights::Noise ? varianceShare : 1;
  for (int c = 0; c < 3; ++c) {
    out.weight[c] = static_cast<float>(weights.ac[c] / share);
    out.dcWeight[c] = static_cast<float>(weights.dc[c] / share);
  }
  return out;
}

Tile::Tile(const FourierFitState& state, std::span<const std::uint32_t> sites, bool poolNeighbours) {
  const FourierMeasurements& m = state.measurements;
  const auto frequencies = static_cast<std::size_t>(m.frequencyCount());
  const std::size_t stride = (frequencies + 1) * 6, zStride = frequencies * 6;
  const auto room = [&](bool needed, std::size_t floats) {
    return std::make_unique_for_overwrite<float[]>(needed ? sites.size() * floats : 0);
  };
  diffuse_ = room(true, stride);
  ownDiffuse_ = room(poolNeighbours, stride);
  z_ = room(poolNeighbours, zStride);
  // Measurements in memory stay where they are; those of a scratch file are gone with the next block.
  const bool inPlace = m.store.inMemory();
  ownZ_ = room(!inPlace, zStride);
  data.reserve(sites.size());
  own.reserve(sites.size());
  dc_.assign(sites.size() * 3, 0.0f);
  pooledDropped_.resize(sites.size());
  // Sites that lie together need only a part of the sheet, pooled with their neighbours or not.
  Eigen::AlignedBox2d box;
  for (const auto s : sites) box.extend(m.sites.pointMm[s].cast<double>());
  const Eigen::Vector2d margin = Eigen::Vector2d::Constant(2 * m.sites.finestPitchMm);
  const Eigen::Vector2d low = box.min() - margin, high = box.max() + margin;
  std::optional<DiffuseTransform> part;
  if (state.diffuse->partPays(low, high, (poolNeighbours ? 2 : 1) * sites.size()))
    part = state.diffuse->part(low, high);
  const DiffuseTransform& transform = part ? *part : *state.diffuse;
  // One block holds the sites that follow, as far as they lie close together, and their neighbours.
  constexpr std::size_t kFarApart = 4096;
  SiteBlock block;
  for (std::size_t i = 0; i < sites.size(); ++i) {
    const std::size_t s = sites[i];
    const SiteRun around = sitesAround(m.sites, {s, 1});
    if (around.first < block.run().first || around.end() > block.run().end()) {
      std::size_t last = s;
      for (std::size_t k = i + 1; k < sites.size() && sites[k] >= s && sites[k] < s + kFarApart; ++k)
        last = std::max<std::size_t>(last, sites[k]);
      block = m.store.block(sitesAround(m.sites, {s, last + 1 - s}), MeasurementStore::kZ);
    }
    const float* ownZ = block.z(s);
    if (!inPlace) ownZ = std::copy_n(ownZ, zStride, ownZ_.get() + i * zStride) - zStride;
    const Eigen::Vector2d here = m.sites.pointMm[s].cast<double>();
    const Pool pool = poolNeighbours ? poolOf(m, block, s) : Pool{{s}, {1.0}, 1};
    if (pool.count == 1) {
      data.push_back(
          describe(state, transform, s, here, 1, ownZ, m.dc.data() + s * 3, diffuse_.get() + i * stride));
      data.back().dropped = m.droppedRows(s);
      own.push_back(data.back());
      continue;
    }
    double total = 0, square = 0;
    for (int k = 0; k < pool.count; ++k) {
      const double w = pool.weight[static_cast<std::size_t>(k)];
      total += w, square += w * w;
    }
    Eigen::Vector2d point = Eigen::Vector2d::Zero();
    float* z = z_.get() + i * zStride;
    std::fill_n(z, zStride, 0.0f);
    float* dc = dc_.data() + i * 3;
    bool spoilt = false;
    for (int k = 0; k < pool.count; ++k) {
      const std::size_t n = pool.site[static_cast<std::size_t>(k)];
      const double w = pool.weight[static_cast<std::size_t>(k)] / total;
      point += w * m.sites.pointMm[n].cast<double>();
      addScaled(static_cast<float>(w), block.z(n), zStride, z);
      for (std::size_t c = 0; c < 3; ++c) dc[c] += static_cast<float>(w) * m.dc[n * 3 + c];
      spoilt |= !m.droppedRows(n).empty();
    }
    data.push_back(
        describe(state, transform, s, point, square / (total * total), z, dc, diffuse_.get() + i * stride));
    if (spoilt) {
      mendRows(m, block, pool, z);
      pooledDropped_[i] = missingRows(m, pool);
      data.back().dropped = pooledDropped_[i];
    }
    own.push_back(
        describe(state, transform, s, here, 1, ownZ, m.dc.data() + s * 3, ownDiffuse_.get() + i * stride));
    own.back().dropped = m.droppedRows(s);
  }
}

}  // namespace patina
