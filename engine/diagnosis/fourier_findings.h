#pragma once

#include "engine/diagnosis/explanation.h"
#include "engine/diagnosis/fourier_corrections.h"
#include "engine/diagnosis/fourier_refit.h"

namespace patina {

/// An added effect's strengths in the catalogue's parameters, from a state; `last` gives standard deviations.
std::vector<EffectEstimate> effectParameters(const DiagnosisSession& session, std::string_view id,
                                             const RefitResult* refit);
/// "The highlights are 2.2 times as wide along 31 degrees as across": a sentence with the numbers.
std::string effectSentence(std::string_view id, const std::vector<EffectEstimate>& parameters);
/// Curves over the photographs of flicker, drift and offsets.
std::vector<PhotoCurve> effectCurves(const DiagnosisSession& session, std::string_view id);
/// Maps over the sample of a per-texel or per-material effect.
/// `corrected`: what each texel has by itself; may be null.
std::map<std::string, Image> effectMaps(const DiagnosisSession& session, std::string_view id,
                                        const CorrectedCapture* corrected);
/// Signal along an effect by spatial frequency: expected at the fitted strength, and seen. In standard
/// deviations of noise.
SignaturePlot signatureByFrequency(const DiagnosisSession& session, const ScoreTest& test,
                                   std::string_view id, const JobContext& job);
/// How large effects could be without having been seen.
std::vector<BudgetLine> effectBudget(const DiagnosisSession& session, const ScoreTest& test,
                                     const std::vector<std::string>& added, double phi);
/// Breakdowns by frequency, phase and time.
std::vector<ResidualBreakdown> residualBreakdowns(const DiagnosisCapture& capture, const ModelError& before,
                                                  const ModelError& after);
/// What is left: where and at which frequencies, in words.
std::string describeRest(const DiagnosisCapture& capture, const ModelError& after);

/// Every photograph's error before and after, worst first: `out.photos`.
void listPhotographs(const DiagnosisCapture& capture, const ModelError& before, const ModelError& after,
                     Explanation& out);
/// Where the residual lies, and a few photographs beside their predictions: `out.placeBefore`, `placeAfter`,
/// `pictures`. `out.photos` and the fits must be there. Nothing where the sheet has more than 150,000 points.
/// Parallel.
void drawResidual(const DiagnosisSession& before, const DiagnosisSession& after, Explanation& out,
                  const JobContext& job);

}  // namespace patina
