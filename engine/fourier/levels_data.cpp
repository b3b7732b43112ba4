#include "engine/fourier/levels_data.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace patina {
namespace {

constexpr std::size_t kRun = 8192;  // sites a task: some rows of an image, so that most texels are whole

/// A texel's running mean and sum of squared deviations.
struct TexelSums {
  std::uint32_t* count;
  Eigen::Vector2f* point;
  float *z, *dc, *variance, *dcVariance;
  std::uint32_t* rows;
  float *scatter, *dcScatter;  // null: not wanted
};

TexelSums sumsOf(LevelData& level, std::size_t texel) {
  const std::size_t stride = level.zStride();
  return {&level.siteCount[texel],
          &level.pointMm[texel],
          level.z.data() + texel * stride,
          level.dc.data() + texel * 3,
          level.siteVariance.data() + texel * 3,
          level.siteDcVariance.data() + texel * 3,
          level.rowCount.data() + texel * stride / 3,
          level.scatter.empty() ? nullptr : level.scatter.data() + texel * stride,
          level.dcScatter.empty() ? nullptr : level.dcScatter.data() + texel * 3};
}

void resize(LevelData& level, std::size_t texels, bool withScatter) {
  level.siteCount.assign(texels, 0);
  level.pointMm.assign(texels, Eigen::Vector2f::Zero());
  level.z.assign(texels * level.zStride(), 0);
  level.rowCount.assign(texels * level.zStride() / 3, 0);
  level.dc.assign(texels * 3, 0);
  level.siteVariance.assign(texels * 3, 0);
  level.siteDcVariance.assign(texels * 3, 0);
  if (!withScatter) return;
  level.scatter.assign(texels * level.zStride(), 0);
  level.dcScatter.assign(texels * 3, 0);
}

/// Joins `from` into `to` (Chan, Golub, LeVeque 1979: means and sums of squared deviations of two sets).
void join(const TexelSums& to, const TexelSums& from, std::size_t rows) {
  if (*from.count == 0) return;
  auto part = [](std::uint32_t a, std::uint32_t b) {
    return static_cast<float>(b) / static_cast<float>(a + b);
  };
  auto joinThree = [](float* mean, float* square, const float* otherMean, const float* otherSquare, float a,
                      float share) {
    for (int c = 0; c < 3; ++c) {
      const float gap = otherMean[c] - mean[c];
      mean[c] += share * gap;
      if (square) square[c] += otherSquare[c] + gap * gap * a * share;
    }
  };
  const float share = part(*to.count, *from.count), here = static_cast<float>(*to.count);
  joinThree(to.dc, to.dcScatter, from.dc, from.dcScatter, here, share);
  for (int c = 0; c < 3; ++c) {
    to.variance[c] += share * (from.variance[c] - to.variance[c]);
    to.dcVariance[c] += share * (from.dcVariance[c] - to.dcVariance[c]);
  }
  *to.point += share * (*from.point - *to.point);
  for (std::size_t row = 0; row < rows; ++row) {
    if (from.rows[row] == 0) continue;
    joinThree(to.z + row * 3, to.scatter ? to.scatter + row * 3 : nullptr, from.z + row * 3,
              to.scatter ? from.scatter + row * 3 : nullptr, static_cast<float>(to.rows[row]),
              part(to.rows[row], from.rows[row]));
    to.rows[row] += from.rows[row];
  }
  *to.count += *from.count;
}

/// One more value in running means (weight `share`) and, where wanted, sums of squared deviations (Welford
/// 1962).
void accumulate(float* __restrict mean, float* __restrict square, const float* __restrict value,
                std::size_t count, float share) {
  if (square) {
    for (std::size_t k = 0; k < count; ++k) {
      const float gap = value[k] - mean[k], next = mean[k] + share * gap;
      mean[k] = next;
      square[k] += gap * (value[k] - next);
    }
  } else {
    for (std::size_t k = 0; k < count; ++k) mean[k] += share * (value[k] - mean[k]);
  }
}

/// Sites of one run, averaged by texel.
struct Partial {
  std::vector<std::uint32_t> texel;
  LevelData sums;  // one entry for each of `texel`
};

Partial averageRun(const FourierFitState& state, const MirrorPhase& phase, const LevelData& grid,
                   std::size_t first, std::size_t count, bool withScatter) {
  const FourierMeasurements& m = state.measurements;
  const SiteRows sites(m, first, count);
  std::vector<std::uint64_t> order(count);  // texel, site
  for (std::size_t i = 0; i < count; ++i)
    order[i] = std::uint64_t{texelOf(grid, m.sites.pointMm[first + i])} << 32 | i;
  std::ranges::sort(order);
  Partial out;
  for (const auto key : order)
    if (out.texel.empty() || out.texel.back() != key >> 32)
      out.texel.push_back(static_cast<std::uint32_t>(key >> 32));
  out.sums.frequencyCount = grid.frequencyCount;
  resize(out.sums, out.texel.size(), withScatter);
  const std::size_t stride = grid.zStride(), rows = stride / 3;
  std::vector<float> turned(stride);
  std::vector<char> incomplete(out.texel.size(), 0);  // texels of which some sites dropped rows
  std::size_t at = 0;
  for (const auto key : order) {
    while (out.texel[at] != key >> 32) ++at;
    const std::size_t site = first + (key & 0xffffffffu);
    const TexelSums sums = sumsOf(out.sums, at);
    const float share = 1.0f / static_cast<float>(++*sums.count);
    for (int c = 0; c < 3; ++c) {
      const float gap = m.dc[site * 3 + c] - sums.dc[c];
      sums.dc[c] += share * gap;
      if (sums.dcScatter) sums.dcScatter[c] += gap * (m.dc[site * 3 + c] - sums.dc[c]);
      sums.variance[c] += share * (static_cast<float>(m.variance(site, c)) - sums.variance[c]);
      sums.dcVariance[c] += share * (static_cast<float>(m.dcVariance(site, c)) - sums.dcVariance[c]);
    }
    *sums.point += share * (m.sites.pointMm[site] - *sums.point);
    phase.turn(m.sites.pointMm[site], sites.z(site), turned.data());
    const auto dropped = sites.dropped(site);
    for (std::size_t row = 0; row < rows; ++row) ++sums.rows[row];
    // A turn mixes real and imaginary part: where one is spoilt, so is the other.
    for (std::size_t k = 0; k < dropped.size(); ++k) {
      const std::size_t even = dropped[k] & ~std::size_t{1};
      if (k > 0 && (dropped[k - 1] & ~std::size_t{1}) == even) continue;
      --sums.rows[even];
      --sums.rows[even + 1];
      std::copy_n(sums.z + even * 3, 6, turned.data() + even * 3);
      incomplete[at] = 1;
    }
    if (!incomplete[at]) {
      accumulate(sums.z, sums.scatter, turned.data(), stride, share);
    } else {
      for (std::size_t row = 0; row < rows; ++row)
        if (sums.rows[row] > 0)
          accumulate(sums.z + row * 3, sums.scatter ? sums.scatter + row * 3 : nullptr,
                     turned.data() + row * 3, 3, 1.0f / static_cast<float>(sums.rows[row]));
    }
  }
  return out;
}

}  // namespace

SiteRows::SiteRows(const FourierMeasurements& measurements, std::size_t first, std::size_t count)
    : measurements_(measurements), block_(measurements.store.block(first, count, MeasurementStore::kZ)) {}
const float* SiteRows::z(std::size_t site) const {
  return block_.z(site);
}
std::span<const std::uint16_t> SiteRows::dropped(std::size_t site) const {
  return measurements_.droppedRows(site);
}

MirrorPhase::MirrorPhase(const FourierFitState& state) : state_(state) {
  for (const auto& group : state.measurements.plan.fitted) {
    std::array<std::uint16_t, 2> index{};
    for (int axis = 0; axis < 2; ++axis) {
      auto& known = component_[axis];
      const auto value = static_cast<float>(std::abs(group.frequency[axis]));
      const auto found = std::ranges::find(known, value);
      index[axis] = static_cast<std::uint16_t>(found - known.begin());
      if (found == known.end()) known.push_back(value);
    }
    indices_.push_back(index);
  }
}

void MirrorPhase::apply(const Eigen::Vector2f& pointMm, const float* in, float* out, float sign) const {
  const SiteGeometry site =
      siteGeometry(state_.frame, {pointMm.x(), pointMm.y(), 0.0}, state_.capture.camera.positionMm());
  const Eigen::Vector2f mirror = mirrorOnScreen(state_.frame, site, Eigen::Vector3f::UnitZ());
  // exp(i w m) for the few distinct components; a frequency is a product of two.
  thread_local std::vector<std::complex<float>> factor;
  const std::size_t second = component_[0].size();
  factor.resize(second + component_[1].size());
  for (int axis = 0; axis < 2; ++axis)
    for (std::size_t k = 0; k < component_[axis].size(); ++k)
      factor[axis * second + k] = std::polar(1.0f, sign * component_[axis][k] * mirror[axis]);
  const auto& groups = state_.measurements.plan.fitted;
  for (std::size_t f = 0; f < indices_.size(); ++f) {
    std::complex<float> x = factor[indices_[f][0]], y = factor[second + indices_[f][1]];
    if (groups[f].frequency.x() < 0) x = std::conj(x);
    if (groups[f].frequency.y() < 0) y = std::conj(y);
    const float cosine = x.real() * y.real() - x.imag() * y.imag(),
                sine = x.real() * y.imag() + x.imag() * y.real();
    for (std::size_t c = f * 6; c < f * 6 + 3; ++c) {
      const float re = in[c], im = in[c + 3];
      out[c] = re * cosine - im * sine;
      out[c + 3] = re * sine + im * cosine;
    }
  }
}

LevelData emptyLevel(const FourierFitState& state, int width, int height) {
  LevelData level;
  level.width = width;
  level.height = height;
  level.widthMm = state.capture.sampleWidthMm;
  level.heightMm = state.capture.sampleHeightMm;
  level.frequencyCount = state.measurements.frequencyCount();
  return level;
}

std::uint64_t levelBytes(std::size_t texels, int frequencyCount, bool withScatter) {
  const std::uint64_t rows = 2 * static_cast<std::uint64_t>(frequencyCount);
  const std::uint64_t values = (rows * 3 + 3) * sizeof(float);  // z and dc, and their scatter
  return texels * (sizeof(std::uint32_t) + sizeof(Eigen::Vector2f) + values * (withScatter ? 2 : 1) +
                   rows * sizeof(std::uint32_t) + 6 * sizeof(float));
}

std::uint32_t texelOf(const LevelData& grid, const Eigen::Vector2f& pointMm) {
  const double x = (pointMm.x() / grid.widthMm + 0.5) * grid.width,
               y = (0.5 - pointMm.y() / grid.heightMm) * grid.height;
  const int i = std::clamp(static_cast<int>(std::floor(x)), 0, grid.width - 1),
            j = std::clamp(static_cast<int>(std::floor(y)), 0, grid.height - 1);
  return static_cast<std::uint32_t>(grid.index(i, j));
}

LevelData measureLevel(const FourierFitState& state, int width, int height, bool withScatter,
                       const JobContext& job) {
  LevelData level = emptyLevel(state, width, height);
  resize(level, level.size(), withScatter);
  const MirrorPhase phase(state);
  const std::size_t sites = state.measurements.sites.size();
  std::size_t next = 0;
  // Runs are averaged in any order and joined in theirs, so that the sums don't depend on the threads.
  tbb::parallel_pipeline(
      2 * static_cast<std::size_t>(std::max(1, tbb::this_task_arena::max_concurrency())),
      tbb::make_filter<void, std::size_t>(tbb::filter_mode::serial_in_order,
                                          [&](tbb::flow_control& flow) -> std::size_t {
                                            const std::size_t first = next;
                                            if (first >= sites || job.cancelled()) flow.stop();
                                            next += kRun;
                                            return first;
                                          }) &
          tbb::make_filter<std::size_t, Partial>(
              tbb::filter_mode::parallel,
              [&](std::size_t first) {
                return averageRun(state, phase, level, first, std::min(kRun, sites - first), withScatter);
              }) &
          tbb::make_filter<Partial, void>(tbb::filter_mode::serial_in_order, [&](Partial run) {
            for (std::size_t i = 0; i < run.texel.size(); ++i)
              join(sumsOf(level, run.texel[i]), sumsOf(run.sums, i), level.zStride() / 3);
          }));
  return level;
}

LevelData halved(const LevelData& fine) {
  LevelData level;
  level.width = (fine.width + 1) / 2;
  level.height = (fine.height + 1) / 2;
  level.widthMm = fine.widthMm;
  level.heightMm = fine.heightMm;
  level.frequencyCount = fine.frequencyCount;
  resize(level, level.size(), !fine.scatter.empty());
  auto& from = const_cast<LevelData&>(fine);  // sumsOf hands out pointers; `join` only reads these
  tbb::parallel_for(0, level.height, [&](int y) {
    for (int x = 0; x < level.width; ++x)
      for (int k = 0; k < 4; ++k) {
        const int i = 2 * x + k % 2, j = 2 * y + k / 2;
        if (i < fine.width && j < fine.height)
          join(sumsOf(level, level.index(x, y)), sumsOf(from, fine.index(i, j)), level.zStride() / 3);
      }
  });
  return level;
}

void finishScatter(LevelData& level) {
  tbb::parallel_for(std::size_t{0}, level.size(), [&](std::size_t texel) {
    const TexelSums sums = sumsOf(level, texel);
    if (!sums.scatter) return;
    auto finish = [](float& value, std::uint32_t count, float noise) {
      value = count > 1 ? std::max(0.0f, value / static_cast<float>(count - 1) - noise) : 0.0f;
    };
    for (std::size_t k = 0; k < level.zStride(); ++k)
      finish(sums.scatter[k], sums.rows[k / 3], sums.variance[k % 3]);
    for (int c = 0; c < 3; ++c) finish(sums.dcScatter[c], *sums.count, sums.dcVariance[c]);
  });
}

LevelTile::LevelTile(const FourierFitState& state, const MirrorPhase& phase, const LevelData& level,
                     std::span<const std::uint32_t> texels)
    : zStride_(level.zStride()) {
  const std::size_t stride = (static_cast<std::size_t>(level.frequencyCount) + 1) * 6,
                    rows = zStride_ / 3 + 1;
  diffuse_.resize(texels.size() * stride);
  z_.resize(texels.size() * zStride_);
  data.resize(texels.size());
  dropped_.resize(texels.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, texels.size(), 64), [&](const auto& range) {
    std::vector<float> weights(rows * 3);
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const std::uint32_t t = texels[i];
      const Eigen::Vector2f point = level.pointMm[t];
      SiteData& site = data[i];
      site.geometry = state.geometry(point.cast<double>());
      state.diffuse->at(point.cast<double>(), diffuse_.data() + i * stride);
      site.diffuse = diffuse_.data() + i * stride;
      phase.inPlace(point, level.z.data() + t * zStride_, z_.data() + i * zStride_);
      site.z = z_.data() + i * zStride_;
      for (std::size_t row = 0; row + 1 < rows; ++row)
        if (level.rowCount[t * (rows - 1) + row] == 0) dropped_[i].push_back(static_cast<std::uint16_t>(row));
      site.dropped = dropped_[i];
      site.dc = level.dc.data() + std::size_t{t} * 3;
      texelWeights(state, level, t, weights.data());
      for (int c = 0; c < 3; ++c) {
        double sum = 0;  // the solver has one weight a channel: the mean of the rows' own
        for (std::size_t row = 0; row + 1 < rows; ++row) sum += weights[row * 3 + c];
        site.weight[c] = static_cast<float>(sum / static_cast<double>(rows - 1));
        site.dcWeight[c] = weights[(rows - 1) * 3 + c];
      }
    }
  });
}

void texelWeights(const FourierFitState& state, const LevelData& level, std::uint32_t texel, float* out) {
  const std::size_t rows = level.zStride() / 3, t = texel;
  const FourierMeasurements& m = state.measurements;
  constexpr double kPaperWeight = 160;                   // App. E
  const double least = std::pow(1e-6 * m.fullScale, 2);  // of a capture without noise: no infinite weight
  const bool byNoise = state.options.weights == MeasurementWeights::Noise;
  const float* dc = level.dc.data() + t * 3;
  const double error = std::max({dc[0], dc[1], dc[2], 0.0f}) / kPaperWeight;
  for (std::size_t row = 0; row <= rows; ++row) {
    const std::uint32_t count = row < rows ? level.rowCount[t * rows + row] : level.siteCount[t];
    for (int c = 0; c < 3; ++c) {
      const bool zero = row == rows;
      double variance = std::pow(m.fullScale / kPaperWeight, 2);
      if (byNoise) {
        variance = (zero ? level.siteDcVariance : level.siteVariance)[t * 3 + c] / std::max(1u, count);
        if (!level.scatter.empty())
          variance +=
              error * error + (zero ? level.dcScatter[t * 3 + c] : level.scatter[(t * rows + row) * 3 + c]);
      }
      out[row * 3 + c] = count == 0 ? 0.0f : static_cast<float>(1 / std::max(variance, least));
    }
  }
}

}  // namespace patina
