#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "engine/base/result.h"
#include "engine/fourier/maps.h"

namespace patina::test {

/// What a bundle made for tests says of its sample: maps over the sample rectangle, row 0 at +y. Read by
/// tests only.
struct TruthMaps {
  Image diffuse;   ///< R G B albedo
  Image specular;  ///< R G B lobe albedo at normal incidence
  Image normal;    ///< X Y Z, unit, world frame
  Image sigma;     ///< standard deviation of the half-vector's slope
  Image kurtosis;  ///< the paper's gamma
};

/// Reads bundle/truth. Errors: those of `readExr`; Invalid where the maps differ in size.
Result<TruthMaps> readTruth(const std::filesystem::path& bundle);

/// Median and 95th percentile over the compared texels.
struct ErrorSpread {
  double median = 0;
  double p95 = 0;
};

/// How far fitted maps are from the truth. Relative errors, |fitted - true| / true; for colours of the mean
/// over channels' absolute errors over the mean of the channels. Normals: the angle between them.
struct TruthErrors {
  ErrorSpread diffuse, specular, sigma, kurtosis, normalDeg;
  ErrorSpread diffuseAbsolute;  ///< |fitted - true| albedo, mean over channels
  std::size_t compared = 0;     ///< texels in the statistic
  std::size_t onEdge =
      0;  ///< left out: a border between materials is near, where photographs mix two of them
  std::size_t notMeasured = 0;  ///< left out: status is neither converged nor iteration limit
};

/// Compares at the fit's texel centres; truth is interpolated linearly where the resolutions differ. Left out
/// are texels that the fit itself doesn't call measured, and texels with a border between materials (a step
/// of true sigma or gamma) within `edgeTexels` of the fit's texels.
TruthErrors compareWithTruth(const SvbrdfMaps& fitted, const TruthMaps& truth, double edgeTexels = 2.0);

/// The value below which the fraction `p` of the values lies, linear between ranks; 0 for none. Sorts its
/// copy.
double percentile(std::vector<double> values, double p);

}  // namespace patina::test
