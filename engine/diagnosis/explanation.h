#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/image/image.h"

namespace patina {

class FourierFit;
struct TwoShotFit;
struct FlashFit;

/// Relative RMS over photographs, as the command-line contract defines it; -1 where there is none.
struct SplitErrors {
  double fitRms = -1, holdoutRms = -1;
};

/// A parameter of an added effect.
struct EffectEstimate {
  std::string name, unit;  ///< as EffectParameter
  double value = 0, sd = 0;
  std::string where;  ///< the part of the sample or channel that it holds for; empty: everywhere
};

/// A curve with what was seen and what the effect predicts, for plots.
struct SignaturePlot {
  std::string title, xLabel, yLabel;
  std::vector<double> x, expected, seen, seenSd;
  std::vector<std::string> xNames;  ///< instead of numbers, where x are categories
};

/// A curve over photographs (time).
struct PhotoCurve {
  std::string name, unit;
  std::vector<int> photo;  ///< index into the bundle's photographs
  std::vector<double> value, sd;
};

/// An effect that was tried, added or not.
struct EffectFinding {
  std::string id;
  std::string verdict;   ///< one sentence: why it was added, or why not
  std::string sentence;  ///< what was found, in words, with numbers; for added effects
  bool added = false;
  double sigmas =
      0;  ///< score test: how far the photographs depart from "none of it", in standard deviations
  double correctedP =
      1;  ///< probability of as large a score without any effect, for the number of effects tried
  double explained = 0;   ///< share of the residual above noise that it explains by itself, 0 .. 1
  double confidence = 0;  ///< that this is the right answer, calibrated
  double holdoutRmsWith = -1, holdoutRmsWithout = -1;  ///< -1: not refitted
  std::vector<EffectEstimate> parameters;
  std::vector<SignaturePlot> plots;
  std::vector<PhotoCurve> curves;
  std::map<std::string, Image> maps;  ///< by file stem: "anisotropy_ratio"; over the sample rectangle
};

/// How large an effect could be without being seen, and what it would then do to the maps.
struct BudgetLine {
  std::string id, parameter, unit;
  double largestUnseen = 0;  ///< 95 %
  struct Shift {
    std::string quantity, unit;  ///< "normal", "degrees"
    double value = 0;            ///< median over the sample
  };
  std::vector<Shift> shifts;
  std::string sentence;
};

/// One photograph, before and after.
struct PhotoResidual {
  int bundle = 0, photo = 0;
  std::string file, what;  ///< what: "pattern (4, -4) phase 2"
  bool holdout = false;
  double noise = 0, before = 0, after = 0;  ///< relative RMS
};

/// A share of the residual: by frequency, phase, channel, place, time.
struct ResidualBreakdown {
  std::string by;  ///< "frequency", "phase", "channel", "order in time", "height of highlight", ...
  std::vector<std::string> label;
  std::vector<double> before, after;  ///< mean square in units of the noise's variance
};

/// A photograph beside its prediction, for pictures: R G B, linear; 0 off the sample.
struct ResidualPicture {
  int bundle = 0, photo = 0;
  std::string file;
  Image captured, predictedBefore, predictedAfter;
  Image noiseSigma;  ///< R G B, standard deviation of a pixel's noise
};

struct Suggestion {
  std::string separatesA, separatesB;
  std::string capture;          ///< a sentence: which photographs to take
  double separationSigmas = 0;  ///< by how much they would tell the two apart
};

/// What closing the loop found.
struct Explanation {
  std::string kind;  ///< "fourier", "two-shot", "flash"
  std::vector<std::filesystem::path> bundles;
  double noiseFloorFit = 0, noiseFloorHoldout = 0;
  SplitErrors before, after;              ///< of the first bundle
  double chi2Before = 0, chi2After = 0;   ///< mean square residual in units of noise, texels that were tested
  std::vector<EffectFinding> effects;     ///< added, strongest first
  std::vector<EffectFinding> considered;  ///< the others, by evidence
  std::vector<std::vector<std::string>> confusable;
  std::vector<Suggestion> suggest;
  struct {
    double fraction = 0;  ///< of the residual's energy above the noise floor that is left
    std::string description;
  } unexplained;
  std::vector<BudgetLine> budget;
  std::vector<PhotoResidual> photos;  ///< worst before first
  std::vector<ResidualBreakdown> breakdowns;
  std::vector<ResidualPicture> pictures;  ///< a few, worst first
  Image placeBefore, placeAfter;          ///< one channel over the first bundle's camera picture: mean square
                                          ///< residual in units of noise; 0 off the sample
  std::vector<std::string> remarks;
  std::map<std::string, double> seconds;
  bool cancelled = false;

  std::shared_ptr<const FourierFit> fourierBefore, fourierAfter;  ///< kind fourier
  std::shared_ptr<const TwoShotFit> twoShotBefore, twoShotAfter;
  std::shared_ptr<const FlashFit> flashBefore, flashAfter;
};

struct ExplainOptions {
  int size = 0;                  ///< as FourierFitOptions::size
  int testedTexels = 800;        ///< of the score test and refits. More: slower, finer
  int maxEffects = 4;            ///< added at most
  double falseAlarmRate = 0.01;  ///< over the whole catalogue, for data without any effect
  bool pictures = true;          ///< keep pictures of photographs for the report
  std::vector<std::string> validate() const;
};

using ExplanationPtr = std::shared_ptr<const Explanation>;

/// Closes the loop on one bundle, or on several of one rig or one sample: fit, residual, cause, added effect,
/// refit, before and after. Kind by the first bundle; all must be of the same. Source: docs/explain.md.
/// Errors: those of reading and fitting; Invalid (bundles that don't belong together); Cancelled. Progress
/// stages: "fit", "residual", "score", "refit", "maps", "report".
Result<ExplanationPtr> explain(const std::vector<std::filesystem::path>& bundles,
                               const ExplainOptions& options, const JobContext& job);

/// The same with given effects added, none looked for: what a fit that is told the effects reaches. Ids of
/// the catalogue. Errors: as `explain`; Unsupported for kinds or effects that can't be fitted.
Result<ExplanationPtr> explainWith(const std::vector<std::filesystem::path>& bundles,
                                   const std::vector<std::string>& ids, const ExplainOptions& options,
                                   const JobContext& job);

}  // namespace patina
