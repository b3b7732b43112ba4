#include "engine/fourier/tile.h"

#include <algorithm>
#include <cmath>

namespace patina {
namespace {

constexpr double kParameters = 10;  // of a texel: four of the lobe, six albedos

/// Neighbours and their weights, the site itself first with weight one.
struct Pool {
  std::vector<std::size_t> site;
  std::vector<double> weight;
};

Pool poolOf(const FourierMeasurements& m, const SiteBlock& block, std::size_t s) {
  Pool pool{{s}, {1.0}};
  const SiteSet& set = m.sites;
  if (set.grouped()) return pool;
  const int frequencies = m.frequencyCount();
  const int x = static_cast<int>(set.pixel[s].x()), y = static_cast<int>(set.pixel[s].y());
  const double count = 3.0 * (2 * frequencies + 1), spread = std::sqrt(2 * count);
  const float* z = block.z(s);
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      if ((dx == 0 && dy == 0) || x + dx < 0 || y + dy < 0 || x + dx >= set.imageWidth ||
          y + dy >= set.imageHeight)
        continue;
      const auto other = set.siteOfPixel[static_cast<std::size_t>(y + dy) * set.imageWidth + x + dx];
      if (other < 0) continue;
      const auto n = static_cast<std::size_t>(other);
      const float* zn = block.z(n);
      double q = 0;
      for (int c = 0; c < 3; ++c) {
        double sum = 0;
        for (int f = 0; f < frequencies; ++f) {
          const double re = z[f * 6 + c] - zn[f * 6 + c], im = z[f * 6 + 3 + c] - zn[f * 6 + 3 + c];
          sum += re * re + im * im;
        }
        const double dc = m.dc[s * 3 + c] - m.dc[n * 3 + c];
        q +=
            sum / (m.variance(s, c) + m.variance(n, c)) + dc * dc / (m.dcVariance(s, c) + m.dcVariance(n, c));
      }
      const double excess = std::max(0.0, q - count - spread);
      const double weight = 1 / (1 + 2 * excess / kParameters);
      constexpr double kNegligible = 0.02;
      if (weight < kNegligible) continue;
      pool.site.push_back(n);
      pool.weight.push_back(weight);
    }
  }
  return pool;
}

}  // namespace

Tile::Tile(const FourierFitState& state, std::span<const std::uint32_t> sites, bool poolNeighbours) {
  const FourierMeasurements& m = state.measurements;
  const int frequencies = m.frequencyCount();
  const std::size_t stride = static_cast<std::size_t>(frequencies + 1) * 6,
                    zStride = static_cast<std::size_t>(frequencies) * 6;
  diffuse_.resize(sites.size() * stride);
  z_.resize(sites.size() * zStride);
  dc_.resize(sites.size() * 3);
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
    const Pool pool = poolNeighbours ? poolOf(m, block, s) : Pool{{s}, {1.0}};
    double total = 0, square = 0;
    for (const double w : pool.weight) total += w, square += w * w;
    Eigen::Vector2d point = Eigen::Vector2d::Zero();
    float* z = z_.data() + i * zStride;
    float* dc = dc_.data() + i * 3;
    for (std::size_t k = 0; k < pool.site.size(); ++k) {
      const std::size_t n = pool.site[k];
      const auto w = static_cast<float>(pool.weight[k] / total);
      point += w * m.sites.pointMm[n].cast<double>();
      const float* from = block.z(n);
      for (std::size_t j = 0; j < zStride; ++j) z[j] += w * from[j];
      for (int c = 0; c < 3; ++c) dc[c] += w * m.dc[n * 3 + c];
    }
    const double varianceShare = square / (total * total);
    SiteData site;
    site.geometry = siteGeometry(state.frame, {point.x(), point.y(), 0}, state.capture.camera.positionMm());
    state.diffuse->at(point, diffuse_.data() + i * stride);
    site.diffuse = diffuse_.data() + i * stride;
    site.z = z;
    site.dc = dc;
    const FourierFitState::Weights weights = state.weights(s);
    const bool byNoise = state.options.weights == MeasurementWeights::Noise;
    for (int c = 0; c < 3; ++c) {
      site.weight[c] = static_cast<float>(weights.ac[c] / (byNoise ? varianceShare : 1));
      site.dcWeight[c] = static_cast<float>(weights.dc[c] / (byNoise ? varianceShare : 1));
    }
    data.push_back(site);
  }
}

}  // namespace patina
