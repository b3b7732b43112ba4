#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/base/job.h"
#include "engine/fourier/fit_state.h"
#include "engine/fourier/levels.h"

namespace patina {

/// Measurements of a run of sites: the one place of the levels that knows how they are stored.
class SiteRows {
 public:
  SiteRows(const FourierMeasurements& measurements, std::size_t first, std::size_t count);
  /// [frequency][re R G B, im R G B] of a site of the run.
  const float* z(std::size_t site) const;
  /// Rows (2 * frequency + {re, im}) that a saturated photograph spoils.
  std::span<const std::uint16_t> dropped(std::size_t site) const;

 private:
  const FourierMeasurements& measurements_;
  SiteBlock block_;
};

/// Turns measurements by the phase of a flat mirror lying at their point, and back. Thread-safe.
class MirrorPhase {
 public:
  explicit MirrorPhase(const FourierFitState& state);
  /// out = z exp(+i w . m(point)); the lengths are those of a site's z. `out` may be `z`.
  void turn(const Eigen::Vector2f& pointMm, const float* z, float* out) const { apply(pointMm, z, out, 1); }
  /// The inverse.
  void inPlace(const Eigen::Vector2f& pointMm, const float* turned, float* out) const {
    apply(pointMm, turned, out, -1);
  }

 private:
  void apply(const Eigen::Vector2f& pointMm, const float* in, float* out, float sign) const;

  const FourierFitState& state_;
  std::vector<float> component_[2];                    ///< distinct |w_x| and |w_y|
  std::vector<std::array<std::uint16_t, 2>> indices_;  ///< of each frequency, into `component_`
};

/// A grid of `width` x `height` texels over the sample, without measurements.
LevelData emptyLevel(const FourierFitState& state, int width, int height);

/// What the arrays of a level's measurements take.
std::uint64_t levelBytes(std::size_t texels, int frequencyCount, bool withScatter);

/// The texel that a point of the sample lies in.
std::uint32_t texelOf(const LevelData& grid, const Eigen::Vector2f& pointMm);

/// Averages all sites over a grid of `width` x `height` texels. `withScatter`: `scatter` and `dcScatter` hold
/// sums of squared deviations until `finishScatter` makes variances of them. Reads the measurements once, in
/// the order of the sites. Deterministic. Cancelled: incomplete.
LevelData measureLevel(const FourierFitState& state, int width, int height, bool withScatter,
                       const JobContext& job);

/// A grid of half as many texels in each direction (even numbers, and before `finishScatter`): exactly what
/// `measureLevel` would give.
LevelData halved(const LevelData& fine);

/// Sums of squared deviations to variances of one site's value beyond its noise.
void finishScatter(LevelData& level);

/// The solver's input for some of a level's texels; owns what `data` points to, except the level's own dc.
class LevelTile {
 public:
  LevelTile(const FourierFitState& state, const MirrorPhase& phase, const LevelData& level,
            std::span<const std::uint32_t> texels);
  std::vector<SiteData> data;
  const float* z(std::size_t i) const { return z_.data() + i * zStride_; }

 private:
  std::size_t zStride_;
  std::vector<float> diffuse_, z_;
  std::vector<std::vector<std::uint16_t>> dropped_;
};

/// One over the variance that a texel's value counts with: [row][R G B], rows as in `modelColumns` (zero
/// frequency last); 0 where all sites dropped the row.
///
/// As the options weigh: noise of the mean, or App. E's constant. A regularised level (one with `scatter`)
/// adds, with noise weights, what a mean over unlike sites can't express: their scatter about it; and
/// App. E's 160th, of the texel's own zero frequency: without it the mean of a thousand sites would drown
/// every prior, although the model is no better than half a percent.
void texelWeights(const FourierFitState& state, const LevelData& level, std::uint32_t texel, float* out);

}  // namespace patina
