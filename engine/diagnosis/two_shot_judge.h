#pragma once

#include <string>
#include <vector>

#include "engine/diagnosis/two_shot_search.h"
#include "engine/diagnosis/two_shot_surface.h"

namespace patina {

/// What speaks for and against one way of explaining the photographs, as numbers: all that a decision rests
/// on.
struct TwoShotEvidence {
  std::string id, variant;
  bool surface = false;   ///< a term of the material
  bool lobe = false;      ///< one that was judged by the reconstruction alone
  bool free = false;      ///< the free-form correction
  bool heldOnly = false;  ///< of held-out photographs alone
  bool refined = false;   ///< the thorough fit was made, so that the ratios are known
  bool heldSees = true;   ///< held-out photographs look where a lobe is most of the light
  bool sensible = true;   ///< the strength makes sense
  double lnEvidence = 0, lnHeld = 0, lnAround = 0, reach = 0;  ///< as TrialOutcome
  double first = 0, firstSd = 0;                               ///< the first parameter, as it was searched
  double grain = 0, fine = 0, broad = 0;  ///< brightness: how far from the basis the material is with it
  /// Errors of the reconstruction with over without: fitted photographs, held-out ones (1 where there are
  /// none).
  double fitRatio = 1, heldRatio = 1;
  /// The same of the whole reconstruction, all pixels; 0: not made. Held-out photographs all together or one
  /// by one, whichever is kinder; all together; fitted ones all together.
  double wholeRatio = 0, wholeSumRatio = 0, wholeFitRatio = 0;
  bool held = false;  ///< there are held-out photographs
  /// Share of the held-out photographs that it makes better, and the largest ratio of one of them.
  double heldBetter = 0, heldWorst = 1;
};

/// What became of it.
struct TwoShotVerdict {
  bool passes = false;
  bool answers = false;  ///< it is an answer at all: these photographs can tell it, its strength makes sense
  double gain = 0;       ///< ln odds against "nothing is missing", calibrated (two_shot_odds.h)
  std::string text;
};

/// One effect that was tried, and what came of it.
struct Attempt {
  std::size_t candidate = 0;
  TrialOutcome outcome;         ///< of the Gaussian process; effects of the set-up
  SurfaceTrial::Errors errors;  ///< of the reconstruction with it
  Eigen::VectorXd value;
  TwoShotDeviation deviation;
  bool surface = false;
  TwoShotEvidence evidence;
  TwoShotVerdict verdict;
};

/// What all attempts of a round are judged by.
struct JudgedBy {
  std::size_t tried = 1;
  double falseAlarmRate = 0.01;
  int round = 0;
  double around = 0;  ///< the most that any of the round's attempts explains of the surroundings, ln odds
};

/// The numbers of an attempt. `without`: errors of the reconstruction as it stands.
TwoShotEvidence evidenceOf(const TwoShotCandidate& candidate, const Attempt& attempt,
                           const SurfaceTrial::Errors& without, const std::vector<DiagnosisShot>& shots);

/// Whether it may be added.
TwoShotVerdict judge(const TwoShotEvidence& evidence, const JudgedBy& by);

/// Whether these photographs can tell it at all, and its strength makes sense.
bool answerable(const TwoShotEvidence& evidence);

/// Takes a verdict back where the whole reconstruction is not better for it.
void verifyWhole(const TwoShotEvidence& evidence, TwoShotVerdict& verdict);

}  // namespace patina
