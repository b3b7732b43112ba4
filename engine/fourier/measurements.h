#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/capture/capture.h"
#include "engine/fourier/measurement_store.h"

namespace patina {

struct FourierCorrections;

/// Four photographs of one frequency: indices into capture.photos by phase.
struct FrequencyGroup {
  Eigen::Vector2i frequency = Eigen::Vector2i::Zero();
  std::array<int, 4> photo = {-1, -1, -1, -1};
};

/// Which photographs make which measurement.
struct MeasurementPlan {
  int window = -1, black = -1;          ///< indices into capture.photos
  std::vector<FrequencyGroup> fitted;   ///< complete, in the capture's order
  std::vector<FrequencyGroup> heldOut;  ///< complete
};

/// Sorts a capture's photographs. Invalid where they can't determine the model: no window or black outside
/// the held-out set, fewer than four complete frequencies, or all of them along one line of the frequency
/// plane. Incomplete frequencies are left out with a warning.
Result<MeasurementPlan> planMeasurements(const FourierCapture& capture, const JobContext& job);

/// The points of the sample that are measured: single pixels of the photographs, or groups of them where the
/// maps are much coarser. Pixels are never interpolated: each keeps its own place on the sample and its own
/// noise.
struct SiteSet {
  int imageWidth = 0, imageHeight = 0;
  std::vector<std::int32_t> siteOfPixel;  ///< imageWidth x imageHeight; -1: outside the sample
  std::vector<Eigen::Vector2f> pointMm;   ///< centroid on the sample, z = 0
  std::vector<std::int32_t> pixelCount;
  std::vector<Eigen::Vector2f> pixel;  ///< centroid in the image
  double finestPitchMm = 0;            ///< smallest distance on the sample between neighbouring pixels
  /// The first site of each image row, and the count at the end: sites go through the image row by row. Empty
  /// where sites are groups of pixels, which have no rows.
  std::vector<std::uint32_t> firstSiteOfRow;
  int cellsOnLongestSide = 0;  ///< of the grid that groups pixels; 0 where they are single
  std::size_t size() const { return pointMm.size(); }
  bool grouped() const { return firstSiteOfRow.empty(); }
};

/// The sites on the image rows of `run` and on `rows` rows above and below it: contiguous, holds every
/// neighbour of the run's sites. Groups have no neighbours: the run itself.
SiteRun sitesAround(const SiteSet& sites, SiteRun run, int rows = 1);

/// `size`: longest side of the maps in texels, 0 for what the photographs resolve. Returns the sites; empty
/// set gives Invalid.
Result<SiteSet> makeSites(const FourierCapture& capture, int size);
/// The size that 0 stands for.
int resolvedSize(const FourierCapture& capture, const SiteSet& sites);

/// The sensor's noise: variance = shot * radiance + read^2, one pixel, one photograph, radiance units of the
/// capture.
struct NoiseModel {
  double shot = 0, read = 0;
  double variance(double radiance) const { return shot * std::max(radiance, 0.0) + read * read; }
};

/// Z(w) = (I1 - I3) - i (I0 - I2) at every site, Z(0) from window - black and from the even sums of all high
/// frequencies, and how sure they are.
struct FourierMeasurements {
  MeasurementPlan plan;
  SiteSet sites;
  MeasurementStore store;              ///< Z and the even sums of plan.fitted
  MeasurementStore heldOut;            ///< of plan.heldOut; empty until `photoError` reads them
  std::vector<float> dc;               ///< [site][R G B]
  std::vector<float> dcVariances;      ///< [site][R G B]
  std::vector<float> black;            ///< [site][R G B]
  std::vector<float> brightness;       ///< [site][R G B]: mean radiance of the pattern photographs
  std::vector<float> clippedFraction;  ///< [site]: share of its samples that saturate
  NoiseModel noise;
  double blackVarianceShare = 1;        ///< of one photograph's variance that is left in `black`
  double fullScale = 1;                 ///< 99.9th percentile of window minus black
  std::vector<float> window;            ///< [site][R G B]: the window photograph, black level included
  std::vector<std::uint32_t> noWindow;  ///< sites whose window photograph saturates, ascending
  std::vector<std::uint8_t> clipped;    ///< [site]: 1 where saturated photographs leave too little
  std::size_t clippedSamples = 0;       ///< pixels of photographs that saturate

  int frequencyCount() const { return static_cast<int>(plan.fitted.size()); }
  /// Whether the window photograph saturates there: Z(0) then comes from the patterns alone.
  bool windowClipped(std::size_t site) const {
    return std::binary_search(noWindow.begin(), noWindow.end(), static_cast<std::uint32_t>(site));
  }
  /// Rows of Z that a saturated photograph spoils: see MeasurementStore::droppedRows. Those of Z and the even
  /// sums are numbers that mean nothing; leave them out.
  std::span<const std::uint16_t> droppedRows(std::size_t site) const { return store.droppedRows(site); }
  /// Variance of one component of Z, and of Z(0), at a site: the pair's mean brightness stands for both
  /// photographs, so that weights don't follow the noise.
  double variance(std::size_t site, int channel) const {
    return 2 * noise.variance(brightness[site * 3 + channel]) / sites.pixelCount[site];
  }
  double dcVariance(std::size_t site, int channel) const { return dcVariances[site * 3 + channel]; }
  /// Variance of window - black alone.
  double windowVariance(std::size_t site, int channel) const {
    const float level = black[site * 3 + channel];
    return (noise.variance(dc[site * 3 + channel] + level) + blackVarianceShare * noise.variance(level)) /
           sites.pixelCount[site];
  }
};

/// How much memory measurements may take, and where they go beyond it.
struct MeasurementStorage {
  std::uint64_t memoryLimitBytes = std::uint64_t{4} << 30;  ///< the store half of it, strips an eighth
  std::filesystem::path scratchFolder;                      ///< empty: the system's for temporary files
};

/// Reads the fitted photographs, once each, in strips of rows, several at a time, and reduces them to
/// measurements. Samples that saturate are left out: where a pattern's photograph does, its row of Z (see
/// droppedRows) and what else it enters; where the window does, Z(0) comes from the patterns' even sums. A
/// site counts as clipped where less than 60 % of its rows are left, fewer than eight, or no Z(0).
/// `corrections` (null: none): what acts on photographs and measurements is undone first, and the noise is
/// that of the corrected data. Errors: those of readPhoto; WriteFailed (scratch file); Cancelled.
Result<FourierMeasurements> measure(const FourierCapture& capture, MeasurementPlan plan, SiteSet sites,
                                    const JobContext& job, const MeasurementStorage& storage = {},
                                    const FourierCorrections* corrections = nullptr);

/// Reads the held-out photographs into `measurements.heldOut`, which stays empty on failure. Errors as
/// `measure`. Progress stage: "holdout".
Status measureHeldOut(const FourierCapture& capture, FourierMeasurements& measurements, const JobContext& job,
                      const MeasurementStorage& storage = {},
                      const FourierCorrections* corrections = nullptr);

}  // namespace patina
