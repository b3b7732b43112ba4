#pragma once

#include <span>
#include <vector>

#include "engine/fourier/diffuse_transform.h"
#include "engine/fourier/maps.h"
#include "engine/fourier/measurements.h"
#include "engine/fourier/options.h"
#include "engine/fourier/photo_correction.h"
#include "engine/surface/svbrdf_parameters.h"

namespace patina {

/// One solved site against its photographs.
struct PredictionSite {
  SiteGeometry geometry;
  Eigen::Vector2f pointMm;
  const SvbrdfParameters* parameters = nullptr;
  const float *z = nullptr, *even = nullptr;  ///< as in SiteBlock
  const float* black = nullptr;               ///< R G B
  const float* window = nullptr;              ///< R G B; null: not to be compared
  float pixelCount = 1;
  std::span<const std::uint16_t> droppedRows;  ///< their photographs are not compared
  float restMm = 0;                            ///< DiffuseTransform::restMm
  /// What was taken off z, even and window: part of the photographs. Null: nothing. All sites of a call have
  /// it, or none.
  const float *extraZ = nullptr, *extraEven = nullptr, *extraWindow = nullptr;
};

/// Sums over photographs, sites and channels.
struct PredictionSums {
  double error = 0;   ///< (model - photograph)^2
  double signal = 0;  ///< photograph^2
  double noise = 0;   ///< variance of the photograph
  PredictionSums& operator+=(const PredictionSums& other) {
    error += other.error, signal += other.signal, noise += other.noise;
    return *this;
  }
};

/// What sites share, prepared once: frequencies, their even harmonics, and the Lambertian term's transform at
/// those where it counts, as Chebyshev polynomials over the sample.
class PhotoPrediction {
 public:
  PhotoPrediction(const ScreenFrame& frame, Eigen::Vector2d sampleSizeMm,
                  const std::vector<FrequencyGroup>& groups, LobeMapping lobe, DiffuseMethod diffuse,
                  const NoiseModel& noise, const SheetShape& shape = {});

  /// Photographs are then what `recorded` makes of radiances: measurements are corrected ones, but error,
  /// signal and noise are those of the photographs as they were taken. Must outlive this. A call costs about
  /// three times as much.
  void compareRecorded(const PhotoCorrection& recorded, int windowPhoto);

  /// Predicts the four photographs of every frequency (and the window) at every site and compares. The series
  /// of the clipped sine goes to the 16th harmonic, as `patternRadiance` does. Sites go through in SIMD lanes
  /// of floats; the instruction set is chosen at run time. Thread-safe. Cost: about 2 us a site and core for
  /// 32 frequencies.
  PredictionSums compare(std::span<const PredictionSite> sites) const;

  /// One term of a polynomial: its place among the products of Chebyshev polynomials, and the coefficients of
  /// the transform's three components, re and im.
  struct Term {
    int product;
    float value[6];
  };
  /// The transform at one multiple of one frequency: terms first .. end.
  struct Polynomial {
    int first = 0, end = 0;
  };
  static constexpr int kNodes = 9;
  static constexpr int kHarmonics = 9;  ///< 1, 2, 4, ... 16 times the frequency

  float normalRows[3][3];
  float halfExtent[2];
  float halfSizeMm[2];
  LobeMapping lobe;
  LobeVariant variant;  ///< what sites have beyond the standard lobe; to be set before `compare`
  float noiseShot, noiseReadSquared;
  std::vector<Eigen::Vector2f> frequency;
  /// For a sheet with a second table (DiffuseTransform::hasRest) products go on: those that follow are for
  /// the derivative by height.
  bool hasRest = false;
  Polynomial zero;
  std::vector<Polynomial> polynomial;  ///< [frequency][kHarmonics]
  std::vector<Term> terms;
  const PhotoCorrection* recorded = nullptr;
  std::vector<std::array<int, 4>> photo;  ///< [frequency]: indices into capture.photos by phase
  int windowPhoto = -1;
};

}  // namespace patina
