#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/flash/solve_sheet.h"
#include "engine/surface/svbrdf_maps.h"

namespace patina {

/// Options of the flash fit.
struct FlashFitOptions {
  int size = 0;  ///< longest side of the maps, texels; 0: what the photographs resolve. Larger: finer maps,
                 ///< slower
  int materials = 0;        ///< groups of texels that share a lobe's shape, 1 to 8; 0: chosen by colour
  int sharedTexels = 2500;  ///< texels that shared numbers are fitted on. More: slower, steadier
  std::vector<FlashEffect> effects;  ///< beyond the standard model
  bool operator==(const FlashFitOptions&) const = default;
  /// Every problem with the values; empty when usable.
  std::vector<std::string> validate() const;
};

/// One photograph against its prediction.
struct FlashComparison {
  std::string file;
  bool holdout = false;
  double rms = -1;        ///< relative, decoded pixel values, prediction clipped as the camera clips; -1: no
                          ///< pixel
  double noiseFloor = 0;  ///< the same for a perfect model
  double squares = 0, noiseSquares = 0, values = 0;  ///< sums over pixels and channels
};

struct FlashFitStats {
  std::map<std::string, double> seconds;  ///< "read", "shared", "texels", "predict", "total"
  std::size_t texels = 0;
  double meanIterations = 0;
  double fitRms = -1, holdoutRms = -1, noiseFloorFit = 0, noiseFloorHoldout = 0;
  double noiseShot = 0, noiseRead = 0;
  std::map<std::string, std::size_t> statusCounts;
  std::size_t clippedSamples = 0;
  std::vector<std::string> remarks;
  bool cancelled = false;
};

/// A fitted sheet. Immutable.
struct FlashFit {
  FlashCapture capture;
  FlashFitOptions options;
  FlashModel model;  ///< shared numbers; materials' spreads and discrepancy as on the sample level
  FlashPalette palette;
  FlashGrid grid;
  FlashSolved texels;
  SvbrdfMaps maps;
  FlashNoise noise;
  std::array<float, 3> clip{0, 0, 0};
  std::vector<FlashComparison> comparisons;  ///< of all photographs
  FlashFitStats stats;
};

/// Fits a flash capture: per texel diffuse and specular albedo and normal, lobe shapes shared by texels that
/// look alike, and, where `options.effects` says so, what the bundle doesn't know about camera and flash.
/// Source: this program; the lobe is svbrdfBrdf, the prior on texels is learned from the texels (empirical
/// Bayes), clipped pixels are lower bounds, weights follow the measured noise and the model's own misfit.
/// Absolute albedos hang on the declared intensity. Held-out photographs are read for comparison only.
/// Progress: "read", "solve", "texels", "predict". Cancelled: the fit so far, marked, once every texel has a
/// value; before that ErrorCode::Cancelled. Errors: those of reading; Invalid. Threads: all, or job.threads.
Result<std::shared_ptr<const FlashFit>> fitFlash(const FlashCapture& capture, const FlashFitOptions& options,
                                                 const JobContext& job);
/// The same from photographs that were read already; shared numbers taken from `start` where given.
Result<std::shared_ptr<const FlashFit>> fitFlash(const FlashData& data, const FlashFitOptions& options,
                                                 const JobContext& job, const FlashModel* start = nullptr,
                                                 const FlashPalette* palette = nullptr);

/// The photograph as the fit predicts it, R G B, decoded values, clipped where the camera clips; 0 off the
/// sample. width, height: its pixels.
Image predictFlashPhoto(const FlashFit& fit, int photo, int width, int height);
/// Compares one photograph with its prediction.
FlashComparison compareFlashPhoto(const FlashFit& fit, int photo, const FlashPixels& pixels);

/// Maps that active effects add, by file stem: materials, anisotropy_ratio, anisotropy_angle,
/// third_lobe_share.
std::map<std::string, Image> flashEffectMaps(const FlashFit& fit);

/// Writes `folder`/maps/*.exr and `folder`/fit.json as the command-line contract says, all at once or not at
/// all. `writeMore` may add files to the folder under construction.
Status writeFlashFit(const std::filesystem::path& folder, const FlashFit& fit,
                     const std::function<Status(const std::filesystem::path&)>& writeMore = {});

}  // namespace patina
