#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/brdf/tabulated_brdf.h"
#include "engine/capture/two_shot_capture.h"
#include "engine/twoshot/basis.h"
#include "engine/twoshot/deviation.h"
#include "engine/twoshot/metric.h"

namespace patina {

/// Options of the reconstruction.
struct TwoShotFitOptions {
  double eta = kPaperEta;  ///< Tikhonov's weight for 300 rows a picture. Larger: closer to the basis' mean
  bool chooseEta = false;  ///< eta by cross-validation over parts of the pictures instead
  int rowsPerShot =
      4000;  ///< measurements a picture after averaging neighbouring pixels. More: slower, finer highlights
  bool noiseWeights = true;  ///< weigh rows by the sensor's noise; off: every row alike, as the paper
  int clusters = 1;          ///< materials on the sample, up to 8; 0: chosen from the pictures
  std::string basisFile;     ///< where the basis was opened from, kept so that a written fit can be loaded
                             ///< again; empty: the built-in one
  std::vector<std::string> validate() const;
  bool operator==(const TwoShotFitOptions&) const = default;
};

/// One material of the sample.
struct TwoShotMaterial {
  std::shared_ptr<const TabulatedBrdf> brdf;
  Eigen::MatrixXd coefficients;  ///< k x 3
  /// For each cell of the MERL grid: standard deviation, natural-log units, calibrated; -1 where uncovered.
  /// Small: measured; near that of the basis itself: extrapolated.
  std::shared_ptr<const std::vector<float>> posteriorSd;
  double priorSd =
      0;  ///< RMS of the basis' own spread over cells: what "knows nothing" means for posteriorSd
  Eigen::Vector3d eta = Eigen::Vector3d::Zero();         ///< used, R G B
  Eigen::Vector3d residualSd = Eigen::Vector3d::Zero();  ///< of the fitted rows, natural-log units
  ExpectedError expected;  ///< for the directions and pixels that this material really has
  double share = 1;        ///< of the sample's pixels
};

/// One photograph beside its prediction, over the photograph's own pixels.
struct TwoShotComparison {
  std::string file;
  bool holdout = false;
  std::string leftOut;    ///< why the fit couldn't use it, a sentence; empty where it did, or was not to
  Image captured;         ///< R G B, as the photograph, 0 off the sample
  Image rendered;         ///< the same units; empty where what lit a photograph that was left out is unknown
  double rms = -1;        ///< relative: sqrt(sum (rendered - captured)^2 / sum captured^2) over sample and
                          ///< channels; -1 where nothing can be compared
  double noiseFloor = 0;  ///< the same for a perfect model
  HalfDiffAngles centre;
};

struct TwoShotStats {
  std::map<std::string, double>
      seconds;  ///< "read", "observe", "solve", "unmap", "posterior", "predict", "total"
  double fitRms = -1, holdoutRms = -1, noiseFloorFit = 0, noiseFloorHoldout = 0;
  std::size_t pixels = 0, rows = 0, clippedPixels = 0, darkPixels = 0, unreachedPixels = 0;
  std::vector<std::string> remarks;  ///< sentences for the person: expected and achieved error, what is
                                     ///< extrapolated, which shot would help
  bool cancelled = false;
};

/// A finished reconstruction. Immutable.
struct TwoShotFit {
  TwoShotCapture capture;
  TwoShotFitOptions options;
  BasisPtr basis;
  std::vector<TwoShotMaterial> materials;  ///< largest share first; at least one
  Image labels;  ///< one channel over the first shot's pixels: material index, -1 off the sample; empty for
                 ///< one material
  std::vector<TwoShotComparison> comparisons;  ///< all shots: fitted, left out, held out
  TwoShotStats stats;
  /// What was taken out of the photographs before the fit and is in the predictions; null: nothing. The
  /// materials hold its terms of the surface.
  std::shared_ptr<const TwoShotDeviation> deviation;
};

/// Reconstructs the BRDF of a homogeneous sample, or of a few materials by cluster, from near-field
/// photographs. Source: two-shot paper, equations 2 to 4 and section 8. Differences in docs/two_shot.md.
/// Held-out shots are read for comparison only. Progress: "read", "solve", "posterior", "predict". Errors:
/// those of reading; Invalid (nothing usable on the sample, the reason named); Cancelled. Threads: all.
Result<std::shared_ptr<const TwoShotFit>> fitTwoShot(const TwoShotCapture& capture, const BasisPtr& basis,
                                                     const TwoShotFitOptions& options, const JobContext& job,
                                                     std::shared_ptr<const TwoShotDeviation> deviation = {});

/// Writes a fit: brdf.binary (one a material: brdf.binary, brdf_2.binary, ...), posterior_sd.exr (likewise),
/// coefficients.json, fit.json, labels.exr and labels.png where there are several materials,
/// rendered/NAME.exr for each photograph. All appears at once, and a failure leaves an earlier result as it
/// was. `writeMore` is called with the folder under construction and may add files (pictures, which this room
/// can't make). Errors: WriteFailed, Refused, those of `writeMore`.
Status writeTwoShotFit(const std::filesystem::path& folder, const TwoShotFit& fit,
                       const std::function<Status(const std::filesystem::path&)>& writeMore = {});
/// Brings a written fit back: from brdf.binary, posterior_sd.exr, coefficients.json, fit.json, the basis and
/// the bundle that it names; photographs are predicted again. Errors: NotFound, Malformed; Invalid where the
/// basis is another one now; those of reading the bundle; Cancelled.
Result<std::shared_ptr<const TwoShotFit>> loadTwoShotFit(const std::filesystem::path& folder,
                                                         const JobContext& job);

}  // namespace patina
