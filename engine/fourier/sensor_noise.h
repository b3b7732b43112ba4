#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace patina {

struct NoiseModel;

/// Estimates shot and read noise from the capture itself.
///
/// The even combinations I0 + I2 and I1 + I3 of one frequency are the responses to |sin| and |cos|; these
/// differ only in harmonics 2w, 6w, ... of the pattern, which no lobe but the sharpest mirror passes at the
/// highest captured frequencies. So their difference there is noise: variance = shot * (I0 + I1 + I2 + I3) +
/// 4 read^2, whatever the material is.
class NoiseSamples {
 public:
  explicit NoiseSamples(int frequencyCount) : perFrequency_(frequencyCount) {}
  /// Sites' radiance in the four photographs, [site][R G B]. Averages over several pixels are scaled back to
  /// one. Not thread-safe.
  void add(int index, const Eigen::Vector2i& frequency, const std::array<std::vector<float>, 4>& photo,
           const std::vector<std::int32_t>& pixelCount);
  /// Robust fit (median absolute deviations in bins of brightness) over the highest frequencies. Falls back
  /// on a read noise of 1e-3 and shot noise of 1e-4 of full scale where there are too few samples (under
  /// 200).
  NoiseModel estimate(double fullScale) const;

 private:
  struct Sample {
    float difference, brightness;  ///< scaled to one pixel; sum of four photographs
  };
  struct Group {
    double frequency = 0;
    std::vector<Sample> samples;
  };
  std::vector<Group> perFrequency_;
};

}  // namespace patina
