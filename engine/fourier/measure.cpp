// Photographs to measurements.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <numbers>
#include <optional>

#include "engine/fourier/sensor_noise.h"
#include "engine/fourier/site_correction.h"
#include "engine/fourier/site_reader.h"

namespace patina {
namespace {

constexpr std::size_t kChunk = 256;  // sites a task: their records stay in the processor's cache

/// Black level and ambient light as the black photograph shows them, less its noise: each pixel moves towards
/// the mean of its surroundings as far as the local variance is no more than noise (Lee's adaptive Wiener
/// filter, 1980, with the noise known). One photograph's noise would otherwise enter every prediction. Only
/// where each pixel is a site; groups have averaged already.
void denoiseBlack(FourierMeasurements& m) {
  const SiteSet& set = m.sites;
  if (std::ranges::any_of(set.pixelCount, [](auto count) { return count > 1; })) return;
  constexpr int kRadius = 4;  // 81 pixels: what is left of the noise is a ninth
  std::vector<float> out(m.black);
  tbb::parallel_for(0, set.imageHeight, [&](int y) {
    for (int x = 0; x < set.imageWidth; ++x) {
      const auto here = set.siteOfPixel[static_cast<std::size_t>(y) * set.imageWidth + x];
      if (here < 0) continue;
      double sum[3] = {}, square[3] = {};
      int count = 0;
      for (int j = std::max(0, y - kRadius); j <= std::min(set.imageHeight - 1, y + kRadius); ++j) {
        for (int i = std::max(0, x - kRadius); i <= std::min(set.imageWidth - 1, x + kRadius); ++i) {
          const auto there = set.siteOfPixel[static_cast<std::size_t>(j) * set.imageWidth + i];
          if (there < 0) continue;
          ++count;
          for (int c = 0; c < 3; ++c) {
            const double value = m.black[static_cast<std::size_t>(there) * 3 + c];
            sum[c] += value;
            square[c] += value * value;
          }
        }
      }
      for (int c = 0; c < 3; ++c) {
        const double mean = sum[c] / count, variance = square[c] / count - mean * mean;
        // Local variance of pure noise scatters by sqrt(2 / count); structure counts only beyond two of that.
        const double noise = m.noise.variance(mean) * (1 + 2 * std::sqrt(2.0 / count));
        const double keep = std::clamp(1 - noise / std::max(variance, 1e-30), 0.0, 1.0);
        const std::size_t at = static_cast<std::size_t>(here) * 3 + c;
        out[at] = static_cast<float>(mean + keep * (m.black[at] - mean));
      }
    }
  });
  for (std::size_t i = 0; i < out.size(); ++i) m.dc[i] += m.black[i] - out[i];
  m.black = std::move(out);
  m.blackVarianceShare = 1.0 / ((2 * kRadius + 1) * (2 * kRadius + 1));
}

/// Frequencies (larger component) from which on four times the frequency is beyond any lobe, or measured
/// itself.
constexpr int kEvenFrom = 10;

/// Reduces records of four photographs to what the fit needs of all frequencies together.
class Reducer {
 public:
  explicit Reducer(FourierMeasurements& m) : m_(m), noise_(frequenciesOf(m.plan), m.sites.size()) {
    m.brightness.assign(m.sites.size() * 3, 0.0f);
    evenMean_.assign(m.sites.size() * 3, 0.0f);
    for (int f = 0; f < m.frequencyCount(); ++f) {
      const auto& frequency = m.plan.fitted[static_cast<std::size_t>(f)].frequency;
      if (frequency.cwiseAbs().maxCoeff() < kEvenFrom) continue;
      int quadruple = -1;
      for (int g = 0; g < m.frequencyCount(); ++g)
        if (m.plan.fitted[static_cast<std::size_t>(g)].frequency == 4 * frequency) quadruple = g;
      even_.push_back({f, quadruple});
    }
  }

  /// A block of finished sites. Thread-safe for blocks that don't overlap.
  void add(const SiteBlock& block) {
    noise_.add(block, m_.sites.pixelCount);
    for (std::size_t s = block.run().first; s < block.run().end(); ++s) reduce(s, block, {});
  }

  /// After all sites: those with dropped rows once more, without these.
  void leaveOutDropped() {
    if (m_.store.droppedRowCount() == 0) return;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, m_.sites.size(), kChunk), [&](const auto& range) {
      for (std::size_t s = range.begin(); s < range.end(); ++s) {
        const auto dropped = m_.droppedRows(s);
        if (dropped.empty()) continue;
        reduce(s, m_.store.block(s, 1), dropped);
        for (const auto row : dropped) noise_.drop(s, row / 2);
      }
    });
  }

  NoiseModel noise() const { return noise_.estimate(m_.fullScale); }

  /// The sum of a frequency's four photographs is 4 black + 4/pi F(0) - 8/(15 pi) Re F(4w) - ...: the part
  /// that the paper's Z discards holds the zero frequency over and over again. Joined with window - black by
  /// their variances, it knows Z(0) several times better.
  void sharpenZeroFrequency() {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, m_.sites.size(), 4096), [&](const auto& range) {
      for (std::size_t s = range.begin(); s < range.end(); ++s) {
        const bool window = !m_.windowClipped(s);
        const std::size_t used = evenCount(m_.droppedRows(s));
        if (!window && used == 0) m_.clipped[s] = 1;
        if (used > 0) sharpen(s, window, used);
      }
    });
  }

 private:
  struct Even {
    int frequency, quadruple;  ///< -1: not measured
  };

  static std::vector<Eigen::Vector2i> frequenciesOf(const MeasurementPlan& plan) {
    std::vector<Eigen::Vector2i> frequencies;
    for (const auto& group : plan.fitted) frequencies.push_back(group.frequency);
    return frequencies;
  }

  static bool usable(const Even& even, std::span<const std::uint16_t> dropped) {
    return std::ranges::none_of(dropped, [&](const int row) {
      return row / 2 == even.frequency || (even.quadruple >= 0 && row == 2 * even.quadruple);
    });
  }
  std::size_t evenCount(std::span<const std::uint16_t> dropped) const {
    return static_cast<std::size_t>(
        std::ranges::count_if(even_, [&](const Even& even) { return usable(even, dropped); }));
  }

  void reduce(std::size_t s, const SiteBlock& block, std::span<const std::uint16_t> dropped) {
    const int frequencies = m_.frequencyCount();
    const float *z = block.z(s), *sums = block.even(s);
    float bright[3] = {0, 0, 0};
    int rows = 2 * frequencies;
    if (dropped.empty()) {
      for (int f = 0; f < frequencies; ++f)
        for (int c = 0; c < 3; ++c) bright[c] += sums[f * 6 + c] + sums[f * 6 + 3 + c];
    } else {
      rows -= static_cast<int>(dropped.size());
      for (int row = 0; row < 2 * frequencies; ++row) {
        if (std::ranges::binary_search(dropped, row)) continue;
        // The real part is of I1 and I3, whose sum stands second.
        for (int c = 0; c < 3; ++c) bright[c] += sums[row / 2 * 6 + (row % 2 == 0 ? 3 : 0) + c];
      }
    }
    double mean[3] = {0, 0, 0};
    int used = 0;
    for (const Even& even : even_) {
      if (!dropped.empty() && !usable(even, dropped)) continue;
      ++used;
      for (int c = 0; c < 3; ++c) {
        mean[c] += sums[even.frequency * 6 + c] + sums[even.frequency * 6 + 3 + c];
        if (even.quadruple >= 0)
          mean[c] += 8 / (15 * std::numbers::pi) * static_cast<double>(z[even.quadruple * 6 + c]);
      }
    }
    for (std::size_t c = 0; c < 3; ++c) {
      m_.brightness[s * 3 + c] = bright[c] / static_cast<float>(2 * std::max(rows, 1));
      evenMean_[s * 3 + c] = static_cast<float>(used ? mean[c] / used : 0);
    }
  }

  void sharpen(std::size_t s, bool window, std::size_t used) {
    for (int c = 0; c < 3; ++c) {
      const std::size_t i = s * 3 + static_cast<std::size_t>(c);
      const double sum = evenMean_[i];
      const double even = std::numbers::pi / 4 * (sum - 4 * m_.black[i]);
      const double pixels = m_.sites.pixelCount[s];
      const double blackVariance = m_.blackVarianceShare * m_.noise.variance(m_.black[i]) / pixels;
      const double scale = std::numbers::pi / 4 * std::numbers::pi / 4;
      const double evenVariance =
          scale * (4 * m_.noise.variance(sum / 4) / pixels / static_cast<double>(used) + 16 * blackVariance);
      const double windowVariance = m_.windowVariance(s, c);
      const double weight = window ? windowVariance / (windowVariance + evenVariance) : 1.0;
      m_.dc[i] = static_cast<float>(m_.dc[i] + weight * (even - m_.dc[i]));
      m_.dcVariances[i] = static_cast<float>(
          window ? windowVariance * evenVariance / (windowVariance + evenVariance) : evenVariance);
    }
  }

  FourierMeasurements& m_;
  NoiseSamples noise_;
  std::vector<Even> even_;       ///< frequencies whose even sums hold the zero frequency
  std::vector<float> evenMean_;  ///< [site][R G B]: their mean, less what is known of the harmonics
};

/// Puts a strip's photographs (four of each frequency, by phase) into the store and calls `finished` with
/// every run of sites that is complete; groups of pixels never are, before the end.
template <typename Finished>
Status storeStrip(MeasurementStore& store, const SiteStrip& strip, bool grouped, Finished finished) {
  const int frequencies = store.frequencyCount();
  const std::size_t stride = static_cast<std::size_t>(frequencies) * 6;
  std::mutex mutex;
  std::optional<Error> failure;
  const tbb::blocked_range<std::size_t> all(strip.run.first, strip.run.end(), kChunk);
  tbb::parallel_for(all, [&](const auto& range) {
    for (std::size_t first = range.begin(); first < range.end(); first += kChunk) {
      const SiteRun run{first, std::min(kChunk, range.end() - first)};
      std::vector<float> records;
      float *z = nullptr, *even = nullptr;
      if (store.inMemory()) {
        z = store.zInMemory() + first * stride;
        even = store.evenInMemory() + first * stride;
      } else {
        records.resize(run.count * stride * 2);
        z = records.data();
        even = z + run.count * stride;
        if (grouped) {
          const SiteBlock before = store.block(run);
          std::copy_n(before.z(first), run.count * stride, z);
          std::copy_n(before.even(first), run.count * stride, even);
        }
      }
      for (int f = 0; f < frequencies; ++f) {
        const float* photo[4];
        for (int k = 0; k < 4; ++k)
          photo[k] = strip.values[static_cast<std::size_t>(f * 4 + k)].data() + (first - strip.run.first) * 3;
        for (std::size_t s = 0; s < run.count; ++s) {
          float* to = z + s * stride + f * 6;
          float* sums = even + s * stride + f * 6;
          const std::size_t i = s * 3;
          for (std::size_t c = 0; c < 3; ++c) {
            const float values[4] = {photo[0][i + c], photo[1][i + c], photo[2][i + c], photo[3][i + c]};
            to[c] += values[1] - values[3];
            to[3 + c] += values[2] - values[0];
            sums[c] += values[0] + values[2];
            sums[3 + c] += values[1] + values[3];
          }
        }
      }
      if (!store.inMemory()) {
        const Status written = store.write(run, {z, run.count * stride}, {even, run.count * stride});
        if (!written) {
          std::scoped_lock lock(mutex);
          if (!failure) failure = written.error();
          return;
        }
      }
      if (!grouped) finished(SiteBlock(run, stride, z, even));
    }
  });
  if (failure) return *failure;
  return Done{};
}

using DroppedRow = std::pair<std::uint32_t, std::uint16_t>;

void noteDropped(const SiteStrip& strip, int frequencies, std::vector<DroppedRow>& rows) {
  for (int p = 0; p < 4 * frequencies; ++p) {
    // I1 and I3 make the real part
    const int row = 2 * (p / 4) + (p % 2 == 1 ? 0 : 1);
    for (const auto site : strip.clipped[static_cast<std::size_t>(p)]) {
      const DroppedRow dropped{site, static_cast<std::uint16_t>(row)};
      if (rows.empty() || rows.back() != dropped) rows.push_back(dropped);
    }
  }
}

std::vector<int> photosOf(const std::vector<FrequencyGroup>& groups) {
  std::vector<int> photos;
  for (const auto& group : groups) photos.insert(photos.end(), group.photo.begin(), group.photo.end());
  return photos;
}

void markClipped(FourierMeasurements& m) {
  constexpr double kFewestRows = 8;  // four frequencies, as planMeasurements asks of a whole capture
  constexpr double kSmallestShare = 0.6;
  if (m.store.droppedRowCount() == 0) return;
  const double rows = 2.0 * m.frequencyCount();
  for (std::size_t s = 0; s < m.sites.size(); ++s) {
    const double left = rows - static_cast<double>(m.droppedRows(s).size());
    if (left < std::max(kFewestRows, kSmallestShare * rows)) m.clipped[s] = 1;
  }
}

}  // namespace

Result<FourierMeasurements> measure(const FourierCapture& capture, MeasurementPlan plan, SiteSet sites,
                                    const JobContext& job, const MeasurementStorage& storage,
                                    const FourierCorrections* corrections) {
  const FourierCorrections none;
  const PhotoCorrection photoCorrection(corrections ? *corrections : none, capture);
  FourierMeasurements m;
  m.plan = std::move(plan);
  m.sites = std::move(sites);
  const std::size_t count = m.sites.size();
  const int frequencies = m.frequencyCount();
  auto store =
      MeasurementStore::make(count, frequencies, storage.memoryLimitBytes / 2, storage.scratchFolder);
  if (!store) return store.error();
  m.store = std::move(*store);
  if (!m.store.inMemory())
    job.info("the measurements don't fit into half of the memory limit and go to a scratch file");
  m.window.assign(count * 3, 0.0f);
  m.black.assign(count * 3, 0.0f);
  m.clippedFraction.assign(count, 0.0f);
  m.clipped.assign(count, 0);
  Reducer reducer(m);
  const SiteCorrection siteCorrection(corrections ? *corrections : none, photoCorrection, m.plan.fitted,
                                      false);

  std::vector<int> photos = photosOf(m.plan.fitted);
  const std::size_t window = photos.size(), black = window + 1;
  photos.push_back(m.plan.window);
  photos.push_back(m.plan.black);
  std::vector<DroppedRow> dropped;
  const auto take = [&](const SiteStrip& strip) -> Status {
    for (std::size_t i = 0; i < strip.run.count * 3; ++i) {
      m.window[strip.run.first * 3 + i] += strip.values[window][i];
      m.black[strip.run.first * 3 + i] += strip.values[black][i];
    }
    for (const auto& clipped : strip.clipped) {
      m.clippedSamples += clipped.size();
      for (const auto s : clipped)
        m.clippedFraction[s] +=
            1.0f / static_cast<float>(photos.size() * static_cast<std::size_t>(m.sites.pixelCount[s]));
    }
    noteDropped(strip, frequencies, dropped);
    m.noWindow.insert(m.noWindow.end(), strip.clipped[window].begin(), strip.clipped[window].end());
    for (const auto s : strip.clipped[black]) m.clipped[s] = 1;
    return storeStrip(m.store, strip, m.sites.grouped(), [&](const SiteBlock& block) {
      if (!siteCorrection.active()) reducer.add(block);
    });
  };
  const Status read = readSites(capture, m.sites, photos, storage, "read", job, &photoCorrection, take);
  if (!read) return read.error();
  if (siteCorrection.active()) {
    const std::size_t stride = static_cast<std::size_t>(frequencies) * 6;
    const Status changed = changeStore(m.store, job, [&](SiteRun run, float* z, float* even) {
      for (std::size_t s = run.first; s < run.end(); ++s)
        siteCorrection.apply(s, z + (s - run.first) * stride, even + (s - run.first) * stride,
                             m.black.data() + s * 3, m.window.data() + s * 3, m.plan.window);
      reducer.add(SiteBlock(run, stride, z, even));
    });
    if (!changed) return changed.error();
  } else if (m.sites.grouped()) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kChunk),
                      [&](const auto& range) { reducer.add(m.store.block(range.begin(), range.size())); });
  }
  m.store.setDroppedRows(std::move(dropped));
  std::ranges::sort(m.noWindow);
  reducer.leaveOutDropped();
  markClipped(m);

  m.dc.resize(count * 3);
  for (std::size_t i = 0; i < count * 3; ++i) m.dc[i] = m.window[i] - m.black[i];
  {
    std::vector<float> sorted(m.dc);
    const auto at = static_cast<std::size_t>(0.999 * static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(at), sorted.end());
    m.fullScale = sorted[at];
  }
  if (!(m.fullScale > 0))
    return Error{ErrorCode::Invalid, "the window photograph is not brighter than the black one",
                 "photos[" + std::to_string(m.plan.window) + "], " +
                     capture.photos[static_cast<std::size_t>(m.plan.window)].file,
                 "check that the two were not swapped and that the screen lit the sample"};
  m.noise = reducer.noise();
  denoiseBlack(m);
  m.dcVariances.resize(count * 3);
  for (std::size_t s = 0; s < count; ++s)
    for (int c = 0; c < 3; ++c)
      m.dcVariances[s * 3 + static_cast<std::size_t>(c)] = static_cast<float>(m.windowVariance(s, c));
  reducer.sharpenZeroFrequency();
  if (const auto failure = m.store.failure()) return *failure;
  return m;
}

Status measureHeldOut(const FourierCapture& capture, FourierMeasurements& measurements, const JobContext& job,
                      const MeasurementStorage& storage, const FourierCorrections* corrections) {
  const FourierCorrections none;
  const PhotoCorrection photoCorrection(corrections ? *corrections : none, capture);
  const auto& groups = measurements.plan.heldOut;
  const std::uint64_t limit = storage.memoryLimitBytes / 2;
  const std::uint64_t taken =
      measurements.store.inMemory()
          ? MeasurementStore::bytesFor(measurements.sites.size(), measurements.frequencyCount())
          : 0;
  auto store = MeasurementStore::make(measurements.sites.size(), static_cast<int>(groups.size()),
                                      limit - std::min(limit, taken), storage.scratchFolder);
  if (!store) return store.error();
  std::vector<DroppedRow> dropped;
  const std::vector<int> photos = photosOf(groups);
  const auto take = [&](const SiteStrip& strip) -> Status {
    noteDropped(strip, store->frequencyCount(), dropped);
    return storeStrip(*store, strip, measurements.sites.grouped(), [](const SiteBlock&) {});
  };
  const Status read =
      readSites(capture, measurements.sites, photos, storage, "holdout", job, &photoCorrection, take);
  if (!read) return read;
  const SiteCorrection siteCorrection(corrections ? *corrections : none, photoCorrection, groups, true);
  if (siteCorrection.active()) {
    const std::size_t stride = static_cast<std::size_t>(store->frequencyCount()) * 6;
    const Status changed = changeStore(*store, job, [&](SiteRun run, float* z, float* even) {
      for (std::size_t s = run.first; s < run.end(); ++s)
        siteCorrection.apply(s, z + (s - run.first) * stride, even + (s - run.first) * stride,
                             measurements.black.data() + s * 3, nullptr, -1);
    });
    if (!changed) return changed;
  }
  store->setDroppedRows(std::move(dropped));
  measurements.heldOut = std::move(*store);
  return Done{};
}

}  // namespace patina
