#pragma once

#include <cstdint>
#include <filesystem>

#include "engine/base/result.h"
#include "engine/image/image.h"

namespace patina {

/// What became of a texel. Stored as a number in maps/status.exr; keep the values.
enum class TexelStatus : std::uint8_t {
  NotMeasured = 0,  ///< no photograph sees it
  Converged = 1,
  IterationLimit = 2,   ///< the best so far is kept
  MirrorOffScreen = 3,  ///< the mirror point leaves the lit area: gloss, width and kurtosis are not measured
  Clipped = 4,          ///< too many photographs saturate here
  Failed = 5,           ///< no finite solution
  Cancelled = 6,        ///< stopped before its turn: the coarse solution where there is one
};

/// A fitted sheet: maps over the sample rectangle, row 0 at +y, column 0 at -x, texel (i, j) centred on
/// x = ((i + 0.5) / width - 0.5) widthMm, y = (0.5 - (j + 0.5) / height) heightMm.
struct SvbrdfMaps {
  int width = 0, height = 0;
  double widthMm = 0, heightMm = 0;
  Image diffuse;   ///< R G B albedo, relative to the screen's white
  Image specular;  ///< R G B lobe albedo at normal incidence
  Image normal;    ///< X Y Z, unit, world frame
  Image sigma;     ///< standard deviation of the half-vector's slope
  Image kurtosis;  ///< the paper's gamma, >= 1
  Image residual;  ///< relative RMS of (model - measurement) over the fitted frequencies and channels
  Image status;    ///< TexelStatus as a float
  // Standard deviations from noise and priors alone; empty in maps that an earlier version wrote.
  Image diffuseSd, specularSd;  ///< R G B
  Image normalSd;               ///< degrees: both slopes together
  Image sigmaSd, kurtosisSd;
};

/// Writes folder/{diffuse,specular,normal,sigma,kurtosis,residual,status}.exr as the command-line contract
/// says, and {diffuse,specular,normal,sigma,kurtosis}_sd.exr.
Status writeMaps(const std::filesystem::path& folder, const SvbrdfMaps& maps);
/// Reads what `writeMaps` wrote; standard deviations may be missing.
Result<SvbrdfMaps> readMaps(const std::filesystem::path& folder);

}  // namespace patina
