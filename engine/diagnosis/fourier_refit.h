#pragma once

#include <string>
#include <vector>

#include "engine/diagnosis/model_error.h"
#include "engine/diagnosis/score_test.h"
#include "engine/diagnosis/site_fit.h"

namespace patina {

/// Captures under one set of effects: those of the rig are shared, materials and photographs are each
/// capture's own.
struct DiagnosisSession {
  std::vector<DiagnosisCapture> captures;
  std::vector<EffectState> states;  ///< one a capture
  EffectColumns columns;

  explicit DiagnosisSession(std::vector<DiagnosisCapture> all);
  int materialOffset(std::size_t capture) const;
};

/// How well a session predicts, over all captures.
struct SessionError {
  ModelError first;  ///< of the first capture
  double chi2 = 0, count = 0, heldChi2 = 0, heldCount = 0;
  std::vector<double> heldPatch;
  double noise = 0;  ///< chi2 of fitted and held-out photographs with noise alone as the unit
  double all() const { return chi2 + heldChi2; }
};
SessionError sessionError(const DiagnosisSession& session, const JobContext& job);

/// A session with fewer sites (every so-many-th).
DiagnosisSession thinned(const DiagnosisSession& session, std::size_t sites);

/// Fits the strengths of `effects` (those in the states already and new ones) and the sites' parameters
/// together: Gauss-Newton on the strengths with the sites eliminated, halved steps where it overshoots.
/// `session` is changed. Returns the last linear solution: estimates of the remaining step, standard
/// deviations.
struct RefitResult {
  SessionError error;
  ScoreResult last;
  std::vector<ScoreTest::Number> numbers;
  bool plausible = true;  ///< false: a strength went beyond what makes sense
  int iterations = 0;
};
RefitResult refitEffects(DiagnosisSession& session, const std::vector<std::string>& effects, int iterations,
                         const JobContext& job);

/// Adds `scale` times the estimates to the states.
void applyNumbers(DiagnosisSession& session, const std::vector<ScoreTest::Number>& numbers,
                  const Eigen::VectorXd& estimate, double scale);
/// Factors or offsets of the held-out photographs, which no other photograph can tell: from their own pixels,
/// one number each.
void estimateHeldOutPhotographs(DiagnosisSession& session, const JobContext& job);

/// Puts an effect to rest.
void resetEffect(DiagnosisSession& session, const std::string& id);

WantedColumns wantedFor(const std::vector<std::string>& effects);
/// The score test of a whole session.
ScoreTest scoreSession(DiagnosisSession& session, const WantedColumns& wanted, const JobContext& job);
void refineSession(DiagnosisSession& session, int steps, const JobContext& job, bool mayDrop = true);
/// Predicted neighbourhoods for every capture where lens effects are wanted.
std::vector<std::shared_ptr<const PredictedPictures>> sessionPictures(const DiagnosisSession& session,
                                                                      const JobContext& job);
/// The model of one capture under its state, with its predicted neighbourhoods where there are any.
FourierDiagnosisModel modelOf(const DiagnosisSession& session, std::size_t capture);

}  // namespace patina
