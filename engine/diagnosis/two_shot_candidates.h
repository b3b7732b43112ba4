#pragma once

#include <functional>
#include <string>
#include <vector>

#include "engine/capture/two_shot_capture.h"
#include "engine/diagnosis/two_shot_data.h"

namespace patina {

/// One way of explaining photographs by an effect of the catalogue: parameters with priors, and what they do.
struct TwoShotCandidate {
  struct Parameter {
    std::string name, unit;     ///< as in explain.json
    double middle = 0, sd = 1;  ///< prior, in the units that are searched
    bool logarithm = false;     ///< what is searched is ln of what is reported
    std::string where;
  };
  std::string id;         ///< of the effect
  std::string variant;    ///< what sets it apart from others of the same effect; may be empty
  bool surface = false;   ///< a term of the material, not of the set-up
  bool heldOnly = false;  ///< of held-out photographs alone: found from those themselves
  bool free = false;      ///< has no name: tried when nothing else helps
  bool linear = true;     ///< zero means none: a score test at zero exists
  std::vector<Parameter> parameters;
  std::vector<Eigen::VectorXd> starts;  ///< where searches begin
  std::function<void(const Eigen::VectorXd&, TwoShotDeviation&)> apply;
  /// Empty where these photographs could show it, else why they can't, a sentence.
  std::string unobservable;
  double least = 0;       ///< smaller than this, in every parameter (searched units), is nobody's concern
  bool positive = false;  ///< the first parameter below zero makes no sense
};

/// All ways, for the photographs at hand.
std::vector<TwoShotCandidate> twoShotCandidates(const TwoShotCapture& capture, const DiagnosisData& data);

}  // namespace patina
