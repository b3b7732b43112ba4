#include "engine/diagnosis/two_shot_words.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>

namespace patina {
namespace {

template <typename... Values>
std::string written(const char* format, Values... values) {
  char text[400];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

double valueOf(const std::vector<EffectEstimate>& estimates, const std::string& name) {
  for (const EffectEstimate& e : estimates)
    if (e.name == name) return e.value;
  return 0;
}

/// The estimate that is farthest from nothing, in its own standard deviations.
const EffectEstimate& strongest(const std::vector<EffectEstimate>& estimates) {
  return *std::max_element(estimates.begin(), estimates.end(), [](const auto& a, const auto& b) {
    return std::abs(a.value) < std::abs(b.value);
  });
}

}  // namespace

std::vector<EffectEstimate> estimatesOf(const TwoShotCandidate& candidate, const Eigen::VectorXd& value,
                                        const Eigen::VectorXd& sd) {
  std::vector<EffectEstimate> out;
  const auto n = static_cast<Eigen::Index>(candidate.parameters.size());
  for (Eigen::Index i = 0; i < n && i < value.size(); ++i) {
    const TwoShotCandidate::Parameter& parameter = candidate.parameters[static_cast<std::size_t>(i)];
    EffectEstimate estimate{parameter.name, parameter.unit, value[i], i < sd.size() ? sd[i] : 0.0,
                            parameter.where};
    if (parameter.logarithm) {
      estimate.value = std::exp(value[i]);
      estimate.sd *= estimate.value;
    }
    out.push_back(std::move(estimate));
  }
  // The names of the catalogue come first.
  const auto first = [&out](EffectEstimate estimate) { out.insert(out.begin(), std::move(estimate)); };
  const std::string& id = candidate.id;
  if (id == "sample-tilt") {
    // The normal's own direction is what one sees and turns back: about +x it goes to -y.
    const EffectEstimate aboutX = out[0], aboutY = out[1];
    out[0] = {"towardsXDeg", "degrees", aboutY.value, aboutY.sd, ""};
    out[1] = {"towardsYDeg", "degrees", -aboutX.value, aboutX.sd, ""};
    first({"tiltDeg", "degrees", std::hypot(out[0].value, out[1].value), std::max(out[0].sd, out[1].sd), ""});
  } else if (id == "near-light") {
    const double per = std::max(std::abs(out[0].value), 1e-6);
    first({"distanceMm", "mm", 1000 / per, 1000 / per * out[0].sd / per, ""});
  } else if (id == "exposure-mismatch") {
    for (EffectEstimate& estimate : out) {
      estimate.name = "relativeChange", estimate.unit = "";
      estimate.sd *= std::exp(estimate.value);
      estimate.value = std::expm1(estimate.value);
    }
    if (candidate.heldOnly) std::erase_if(out, [](const EffectEstimate& e) { return e.value == 0; });
  } else if (id == "stray-light") {
    double sum = 0, square = 0, count = 0;
    for (const EffectEstimate& one : out)
      if (one.name.rfind("stray", 0) == 0) sum += one.value, square += one.sd * one.sd, ++count;
    first({"share", "", sum / std::max(count, 1.0), std::sqrt(square) / std::max(count, 1.0), ""});
  } else if (id == "black-level") {
    first({"offset", "of the mean level", (out[0].value + out[1].value + out[2].value) / 3, out[1].sd, ""});
  } else if (id == "camera-response") {
    first({"gamma", "", std::exp(out[0].value), out[0].sd * std::exp(out[0].value), ""});
  } else if (id == "defocus") {
    const double px = std::sqrt(std::max(out[0].value, 0.0));
    first({"sigmaPx", "pixels", px, px > 0 ? out[0].sd / (2 * px) : 0, ""});
  } else if (id == "clearcoat") {
    // The catalogue's: albedo at normal incidence of a coat of index 1.5, and the slope's standard deviation.
    const EffectEstimate weight = out[0], alpha = out[1];
    first({"sigma", "", alpha.value / std::numbers::sqrt2, alpha.sd / std::numbers::sqrt2, ""});
    first({"strength", "", 0.04 * weight.value, 0.04 * weight.sd, ""});
  } else if (id == "retroreflection") {
    first({"strength", "1/sr", (out[0].value + out[1].value + out[2].value) / 3, out[1].sd, ""});
  } else if (id == "anisotropy") {
    const double size = std::hypot(out[0].value, out[1].value);
    const double deg = 0.5 * std::atan2(out[1].value, out[0].value) * 180 / std::numbers::pi;
    const double sd = std::max(out[0].sd, out[1].sd);
    first({"angleDeg", "degrees", deg + 90, size > 0 ? sd / (2 * size) * 180 / std::numbers::pi : 90, ""});
    first({"ratio", "", (1 + size) / std::max(1 - size, 0.05), 2 * sd, ""});
  }
  return out;
}

std::string sentenceOf(const std::string& id, const std::vector<EffectEstimate>& e) {
  if (e.empty()) return "";
  if (id == "sample-tilt") {
    const double x = valueOf(e, "towardsXDeg"), y = valueOf(e, "towardsYDeg");
    return written(
        "The sample lay tilted by %.2f degrees: its normal leans %.2f degrees towards +x and %.2f towards "
        "+y, so that "
        "highlights sit where a flat sample can't have them.",
        std::hypot(x, y), x, y);
  }
  if (id == "sample-height")
    return written("The sample's surface was %.1f mm %s where the calibration has it.", std::abs(e[0].value),
                   e[0].value > 0 ? "above" : "below");
  if (id == "near-light")
    return written(
        "The light was not distant but about %.0f mm from the sample, so that its direction and strength "
        "change over "
        "it.",
        valueOf(e, "distanceMm"));
  if (id == "vignetting")
    return written(
        "The lens darkened the photographs of the sample towards the corners, by %.0f %% in the corner "
        "itself, and the "
        "white reference doesn't show it.",
        100 * e[0].value);
  if (id == "stray-light")
    return written(
        "Light that didn't come by way of the sample lies over its photographs: on the mean %.1f %% of their "
        "level.",
        100 * valueOf(e, "share"));
  if (id == "black-level")
    return written(
        "The sensor's black is not zero: %.1f %% of the photographs' mean level, whatever the exposure.",
        100 * valueOf(e, "offset"));
  if (id == "exposure-mismatch") {
    const EffectEstimate* most = &e[0];
    for (const EffectEstimate& one : e)
      if (std::abs(one.value) > std::abs(most->value)) most = &one;
    return written(
        "Exposure times or light don't agree between photographs and their white references: %s is %.3f "
        "times as bright "
        "as it says.",
        most->where.c_str(), 1 + most->value);
  }
  if (id == "camera-response")
    return written("The camera isn't linear: its values go with the power %.3f of the light.",
                   valueOf(e, "gamma"));
  if (id == "channel-crosstalk")
    return written("The colour channels mix: %.1f %% of each comes from the other two.", 100 * e[0].value);
  if (id == "glare")
    return written("The lens spreads %.1f %% of the light around bright places.", 100 * e[0].value);
  if (id == "defocus") return written("The photographs are blurred, by %.1f pixels.", valueOf(e, "sigmaPx"));
  if (id == "retroreflection")
    return written(
        "The sample sends light back to where it came from: a lobe of %.2g per steradian towards the light "
        "that falls "
        "off within %.1f degrees, which no material of the basis has.",
        valueOf(e, "strength"), valueOf(e, "widthDeg"));
  if (id == "clearcoat")
    return written(
        "A smooth coat lies over the material: a colourless highlight of alpha %.3f and %.2f times the "
        "strength of a "
        "clear varnish.",
        valueOf(e, "alpha"), valueOf(e, "weight"));
  if (id == "anisotropy")
    return written("The highlight is stretched: %.2f times as long along %.0f degrees as across.",
                   valueOf(e, "ratio"), valueOf(e, "angleDeg"));
  if (id == "basis-deviation")
    return written(
        "The material reflects as none of the known ones: a smooth correction of %.0f %% on the mean, which "
        "has no "
        "name, makes the photographs that were held out better.",
        100 * valueOf(e, "relativeChange"));
  if (id == "iridescence") return "The colour changes with the angle between light and view.";
  if (id == "saturation")
    return written(
        "The sensor clips at %.4g, which the bundle doesn't say: clipped pixels tell nothing but \"at "
        "least\".",
        e[0].value);
  const EffectEstimate& most = strongest(e);
  return written("%s: %.3g %s.", most.name.c_str(), most.value, most.unit.c_str());
}

std::string decidingCapture(const std::string& a, const std::string& b) {
  const auto is = [&](const char* x, const char* y) { return (a == x && b == y) || (a == y && b == x); };
  if (is("stray-light", "black-level"))
    return "One of the shots again with a quarter of the exposure time: stray light becomes a quarter, a "
           "black level "
           "stays.";
  if (is("exposure-mismatch", "light-power"))
    return "The white tile again, directly before and after one shot of the sample, with the same exposure "
           "time: only "
           "a lamp that drifts changes the tile.";
  if (is("near-light", "sample-height") || is("near-light", "sample-tilt"))
    return "The white tile photographed with the sample's exposure in the sample's place: a near lamp lights "
           "it "
           "unevenly, a sample that lies elsewhere doesn't.";
  if (is("sample-tilt", "anisotropy") || is("sample-tilt", "sample-height"))
    return "One of the shots near the mirror direction again with the sample turned by 90 degrees in its "
           "plane: a tilt "
           "of the table stays, what belongs to the sample turns with it.";
  if (a == "retroreflection" || b == "retroreflection")
    return "One photograph with the light beside the lens, within 3 degrees of the view.";
  if (a == "clearcoat" || b == "clearcoat")
    return "One photograph with the highlight in the picture's middle at another angle (15 and 60 degrees "
           "differ most).";
  return "One more photograph with the highlight in the picture's middle, and one with it outside of the "
         "picture, both "
         "held out.";
}

BudgetLine budgetLine(const TwoShotCandidate& candidate, Eigen::Index p, double sd, double absorbed) {
  const TwoShotCandidate::Parameter& parameter = candidate.parameters[static_cast<std::size_t>(p)];
  BudgetLine line;
  line.id = candidate.id;
  line.parameter = parameter.name + (parameter.where.empty() ? "" : " of " + parameter.where);
  line.unit = parameter.unit;
  // 95 %, and not more than four of the prior's own standard deviations: nobody would overlook that.
  line.largestUnseen = std::min(1.96 * sd, 4 * parameter.sd);
  const double shift = line.largestUnseen * absorbed;
  line.shifts.push_back({"BRDF where it was measured", "natural log", shift});
  char text[240];
  std::snprintf(text, sizeof text, "Up to %.3g %s would not be seen, and would change the BRDF by %.1f %%.",
                line.largestUnseen, parameter.unit.c_str(), 100 * std::expm1(shift));
  line.sentence = text;
  return line;
}

void addBasisRemedy(Explanation& explanation) {
  const bool held = explanation.after.holdoutRms >= 0;
  const double left = held ? explanation.after.holdoutRms : explanation.after.fitRms,
               floor = held ? explanation.noiseFloorHoldout : explanation.noiseFloorFit;
  if (left <= 3 * floor || left <= 0.1) return;
  explanation.remarks.push_back(
      "The basis holds no material like this one in the directions that no photograph saw. Measured BRDFs of "
      "similar materials, added with 'patina-cli basis build', help more here than any term would; so does "
      "one more photograph.");
}

}  // namespace patina
