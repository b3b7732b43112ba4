#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace patina {

struct NoiseModel;
class SiteBlock;

/// Estimates shot and read noise from the capture itself.
///
/// The even combinations I0 + I2 and I1 + I3 of one frequency are the responses to |sin| and |cos|; these
/// differ only in harmonics 2w, 6w, ... of the pattern, which no lobe but the sharpest mirror passes at the
/// highest captured frequencies. So their difference there is noise: variance = shot * (I0 + I1 + I2 + I3) +
/// 4 read^2, whatever the material is.
class NoiseSamples {
 public:
  NoiseSamples(const std::vector<Eigen::Vector2i>& frequencies, std::size_t siteCount);
  /// The sites of a block with their even sums; only some are looked at. Averages over several pixels are
  /// scaled back to one. Thread-safe for blocks that don't overlap.
  void add(const SiteBlock& block, const std::vector<std::int32_t>& pixelCount);
  /// Leaves out a site's sample of a frequency (a saturated photograph).
  void drop(std::size_t site, int frequency);
  /// Robust fit (median absolute deviations in bins of brightness) over the highest frequencies. Falls back
  /// on a read noise of 1e-3 and shot noise of 1e-4 of full scale where there are too few samples (under
  /// 200).
  NoiseModel estimate(double fullScale) const;

 private:
  struct Sample {
    float difference = 0, brightness = 0;  ///< scaled to one pixel; sum of four photographs
    bool kept = false;
  };
  struct Group {
    double frequency = 0;
    std::vector<Sample> samples;
  };
  std::size_t stride_ = 1;  ///< of [site][R G B]
  std::vector<Group> perFrequency_;
};

}  // namespace patina
