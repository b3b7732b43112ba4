#pragma once

#include <Eigen/Core>
#include <complex>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/capture/capture.h"
#include "engine/fourier/maps.h"
#include "engine/fourier/options.h"
#include "engine/surface/svbrdf_parameters.h"

namespace patina {

/// One frequency of a texel's spectrum: what was measured and what the model says.
struct SpectrumSample {
  Eigen::Vector2i frequency;
  bool holdout = false;
  std::array<std::complex<float>, 3> measured;  ///< R G B, radiance in units of full white
  std::array<std::complex<float>, 3> diffuse;   ///< the model's diffuse part
  std::array<std::complex<float>, 3> specular;  ///< the model's specular part
  std::array<float, 3> noiseSigma;              ///< standard deviation of one component of `measured`
};

/// The model's spectrum between the measured frequencies, along a direction of the frequency plane.
struct SpectrumCurvePoint {
  double frequency;  ///< along the direction, pattern units
  std::array<std::complex<float>, 3> diffuse, specular;
};

/// The reflected lobe's profile over the screen, after the paper's Fig. 3: f'(x) integrated along the other
/// axis, which is what the frequencies on this axis determine (the paper shows a slice; that needs the whole
/// frequency plane). Radiance per pattern unit.
struct LobeSlice {
  bool horizontal = true;
  std::vector<double> position;                ///< pattern units
  std::vector<std::array<float, 3>> model;     ///< from eq. 10
  std::vector<std::array<float, 3>> measured;  ///< inverse transform of the few measurements: it rings
};

struct FourierFitStats {
  std::map<std::string, double>
      seconds;             ///< by stage: "read", "geometry", "solve", "maps", "predict", "holdout"; "total"
  std::size_t texels = 0;  ///< solved sites
  double meanIterations = 0;
  double fitRms = -1,
         holdoutRms = -1;  ///< relative, over photographs; < 0: not computed (cancelled, or none held out)
  double noiseFloorFit = 0, noiseFloorHoldout = 0;
  double noiseShot = 0, noiseRead = 0;              ///< variance = shot * radiance + read^2, radiance units
  std::map<std::string, std::size_t> statusCounts;  ///< maps' texels by status name
  std::size_t clippedSamples = 0;                   ///< pixels of photographs that saturate
  std::size_t droppedRows = 0;    ///< measurements (a frequency's real or imaginary part at a site) left out
                                  ///< for them
  std::size_t clippedSites = 0;   ///< sites where too little is left
  std::size_t resumedTexels = 0;  ///< of `texels`: taken over from an earlier, unfinished run
  bool measurementsOnDisk = false;
  bool coarserSites = false;  ///< pixels were grouped, because the memory limit asked for it
  bool cancelled = false;
  int threads = 0;
  std::size_t peakBytes = 0;  ///< of the process
};

/// A finished (or cancelled, marked) fit. Immutable; may be shared between threads. Keeps the measurements so
/// that a texel's spectrum can be looked at; `loadFourierFit` rebuilds them from the bundle.
class FourierFit {
 public:
  virtual ~FourierFit() = default;
  virtual const SvbrdfMaps& maps() const = 0;
  virtual const FourierFitStats& stats() const = 0;
  virtual const FourierCapture& capture() const = 0;
  virtual const FourierFitOptions& options() const = 0;

  /// Parameters of the measured point nearest to a map texel. Cheap.
  virtual SvbrdfParameters parametersAt(int texelX, int texelY) const = 0;
  /// Measured and predicted spectrum at that point; DC first, then in the capture's order, fitted then held
  /// out (the latter not for a cancelled fit, which never read them). Empty where no photograph sees the
  /// texel.
  virtual std::vector<SpectrumSample> spectrumAt(int texelX, int texelY) const = 0;
  /// The model along `direction` (e.g. (1, 0)) for 0 <= frequency <= maxFrequency.
  virtual std::vector<SpectrumCurvePoint> modelSpectrumAt(int texelX, int texelY, Eigen::Vector2d direction,
                                                          double maxFrequency, int count) const = 0;
  /// The lobe's profile along the screen's x (horizontal) or y axis at `count` >= 2 positions from rim to
  /// rim. Empty where no photograph sees the texel. About 10 ms.
  virtual LobeSlice lobeAt(int texelX, int texelY, bool horizontal, int count) const = 0;
};

/// Where a fit may leave things while it runs.
struct FourierFitStorage {
  /// Solutions of finished texels are kept here, so that the same fit, cancelled or killed, goes on where it
  /// was; empty: nowhere. The caller removes it when the result is safe (`removeUnfinished`).
  std::filesystem::path keepFolder;
  /// For measurements beyond the memory limit; empty: the system's folder for temporary files.
  std::filesystem::path scratchFolder;
};
/// Removes what a fit kept; nothing else that may lie in the folder.
void removeUnfinished(const std::filesystem::path& keepFolder);
/// A keep folder for fits that have no result folder yet: in the user's cache, one for each bundle. Empty
/// where there is no cache.
std::filesystem::path unfinishedInCache(const FourierCapture& capture);

/// Fits per-texel SVBRDF parameters to a capture of kind `fourier`.
/// Source: frequency-domain paper, equations 6 to 12, appendices B to E; departures in docs/fourier_fit.md.
/// Reads every photograph once; those marked holdout only for the error of prediction. Memory stays below
/// `options.memoryLimitBytes`: measurements go to a scratch file, and where that isn't enough pixels are
/// grouped to coarser sites, with a warning. Progress stages: "read", "levels", "upsample", "solve", "rescue"
/// (other starts, neighbours' offers), "maps", "predict", "holdout". Cancelled: the fit so far is returned
/// with stats().cancelled set, unless nothing was fitted yet (then ErrorCode::Cancelled). Errors: those of
/// `readPhoto`; Invalid where the patterns can't determine the model. Threads: all cores, or job.threads.
Result<std::shared_ptr<const FourierFit>> fitFourier(const FourierCapture& capture,
                                                     const FourierFitOptions& options, const JobContext& job,
                                                     const FourierFitStorage& storage = {});

/// Writes `folder`/maps/*.exr and `folder`/fit.json as the command-line contract says; everything is written
/// to a temporary folder beside it first, so that a failure leaves an earlier result as it was.
Status writeFourierFit(const std::filesystem::path& folder, const FourierFit& fit);

/// Brings back a written fit: maps and numbers from `fitFolder`, measurements from the bundle it names, read
/// again. Parameters of single points come from the maps. Errors: those of reading maps and bundle; Malformed
/// where fit.json is not one of ours; Cancelled.
Result<std::shared_ptr<const FourierFit>> loadFourierFit(const std::filesystem::path& fitFolder,
                                                         const JobContext& job);

}  // namespace patina
