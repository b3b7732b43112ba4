#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "engine/base/result.h"

namespace patina {

struct FourierCorrections;

/// Which approximation maps the specular lobe onto the screen.
enum class LobeMapping {
  PaperAffine,   ///< the paper's App. C: first-order map at the mirror point
  ExactMoments,  ///< a Gaussian with the product's mass, mean and covariance by Gauss-Hermite quadrature
};

/// How measurements are weighted against each other and against the priors.
enum class MeasurementWeights {
  Noise,          ///< one over the sensor's standard deviation, estimated from the photographs
  PaperConstant,  ///< App. E's 160, scaled to the capture's full scale
};

/// In which order a sheet is solved.
enum class FitSchedule {
  Independent,  ///< coarse levels, then every texel by itself at the photographs' full resolution
  Paper,        ///< section 7: coarse levels, independent texels at half the resolution, upsampling (7.2)
};

/// Options of the Fourier fit. One description (`describe`) feeds the command line, fit.json and the window's
/// form.
struct FourierFitOptions {
  int size = 0;  ///< longest side of the maps, texels; 0: what the photographs resolve. Larger: finer maps,
                 ///< no new detail
  LobeMapping lobe = LobeMapping::ExactMoments;
  MeasurementWeights weights = MeasurementWeights::Noise;
  int maxIterations = 80;         ///< per texel and start. More: slower, fewer texels stopped early
  double tolerance = 1e-5;        ///< relative decrease of the cost below which a texel has converged
  bool neighbourRestarts = true;  ///< offer each texel its neighbours' solutions; rescues stuck texels at a
                                  ///< few percent of the time

  bool poolNeighbours =
      true;  ///< average a point's measurements with those of neighbouring pixels that the noise can't tell
             ///< from it; off: every pixel alone, noisier where lobes are broad

  FitSchedule schedule = FitSchedule::Independent;
  std::uint64_t memoryLimitBytes = std::uint64_t{4}
                                   << 30;  ///< measurements beyond it wait in a file on disk; maps that would
                                           ///< not fit are made coarser, with a warning

  /// What else is known to act on this capture; null: nothing. Not written to fit.json.
  std::shared_ptr<const FourierCorrections> corrections;

  bool operator==(const FourierFitOptions&) const = default;
  /// Every problem with the values, not only the first; empty when usable.
  std::vector<std::string> validate() const;
};

}  // namespace patina
