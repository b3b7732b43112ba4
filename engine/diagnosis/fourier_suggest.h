#pragma once

#include <string>

#include "engine/diagnosis/explanation.h"
#include "engine/diagnosis/fourier_refit.h"

namespace patina {

/// The cheapest further capture that would tell two effects apart, found by simulating both in each capture
/// that an operator could take: a white paper in the sample's place, the sample turned by 90 degrees, the
/// camera moved aside, the window photograph at half the exposure time. `separationSigmas`: by how much the
/// photographs so far and the new ones together would refuse effect b where a is the truth at its estimated
/// strength (or a where b is: the smaller), sites' parameters shared by both. First order, from `session`'s
/// state, which must hold neither effect yet. Source: docs/explain.md, "What to photograph next".
///
/// `test`: the score test of that state, for the strengths. Where no capture reaches five standard
/// deviations the best one is named all the same and the sentence says so. Cost: some 60 sites times the
/// captures.
Suggestion suggestCapture(const DiagnosisSession& session, const ScoreTest& test, const std::string& a,
                          const std::string& b, const JobContext& job);

}  // namespace patina
