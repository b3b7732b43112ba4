#include "engine/diagnosis/flash_words.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>

#include "engine/diagnosis/flash_evidence.h"
#include "engine/effect/effect_info.h"

namespace patina {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

std::string number(const char* pattern, double a, double b = 0, double c = 0) {
  char text[400];
  std::snprintf(text, sizeof text, pattern, a, b, c);
  return text;
}

/// tan of the angle from the middle of the sample to its corner, at the photographs' mean height.
double cornerTan(const FlashTrial& trial) {
  double height = 0;
  for (const FlashPhoto& photo : trial.data.capture.photos) height += photo.cameraPositionMm.z();
  height /= static_cast<double>(trial.data.capture.photos.size());
  return 0.5 * std::hypot(trial.data.capture.widthMm, trial.data.capture.heightMm) / height;
}

/// The flash's irradiance in the middle of the sample, mean over photographs.
double middleIrradiance(const FlashTrial& trial) {
  double sum = 0;
  for (const FlashPhoto& photo : trial.data.capture.photos)
    sum += photo.lightIntensity.mean() / photo.lightPositionMm.squaredNorm();
  return sum / static_cast<double>(trial.data.capture.photos.size());
}

std::string materialName(const FlashTrial& trial, std::size_t m) {
  if (trial.palette.logColour.size() == 1) return "";
  const Eigen::Array3d colour = trial.palette.logColour[m].exp();
  return "material " + std::to_string(m + 1) +
         number(" (diffuse about %.2g, %.2g, %.2g)", colour[0], colour[1], colour[2]);
}

double gammaOf(const FlashRig& rig) {
  // The mean slope over the three knots that hold most of a photograph.
  return std::exp(-(rig.toneLogSlope[1] + rig.toneLogSlope[2] + rig.toneLogSlope[3]) / 3);
}

/// How much darker full white is recorded than the middle of the curve would have it.
double compressionOf(const FlashRig& rig) {
  const ToneCurve tone(rig.toneLogSlope);
  const double straight = 0.2 * std::pow(tone.light(1.0) / 0.2, gammaOf(rig));
  return 1 - 1 / straight;
}

}  // namespace

EffectFinding flashFinding(FlashEffect effect, const FlashTrial& trial, const FlashTry& with,
                           const JointState& without) {
  EffectFinding finding;
  finding.id = flashEffectId(effect);
  const FlashRig& rig = with.state.model.rig;
  const FlashCapture& capture = trial.data.capture;
  const Eigen::VectorXd sd = unknownSd(with.state, trial.sample, capture, with.effects, effect, trial.fitted);
  const auto sdAt = [&](Eigen::Index i) { return i < sd.size() ? sd[i] : 0.0; };
  switch (effect) {
    case FlashEffect::CameraResponse: {
      const double gamma = gammaOf(rig), compression = compressionOf(rig);
      const double sdMean = std::sqrt(sdAt(1) * sdAt(1) + sdAt(2) * sdAt(2) + sdAt(3) * sdAt(3)) / 3;
      finding.parameters = {{"gamma", "", gamma, gamma * sdMean, ""},
                            {"compression", "", compression, 1.6 * sdAt(4), ""}};
      const ToneCurve tone(rig.toneLogSlope);
      finding.sentence = number(
          "Between light and decoded pixel the camera has a curve of its own: in the middle values go with "
          "the "
          "%.2f-th power of the light, and full white is %.0f %% ",
          gamma, std::abs(100 * compression));
      finding.sentence +=
          compression >= 0 ? "darker than that would give." : "brighter than that would give.";
      SignaturePlot curve;
      curve.title = "The camera's curve", curve.xLabel = "light", curve.yLabel = "decoded value";
      for (int i = 1; i <= 20; ++i) {
        curve.x.push_back(tone.light(0.05 * i));
        curve.expected.push_back(0.05 * i), curve.seen.push_back(tone.light(0.05 * i));
        curve.seenSd.push_back(0);
      }
      // expected: what was found; seen: a camera as declared.
      finding.plots.push_back(curve);
      break;
    }
    case FlashEffect::LightPower: {
      PhotoCurve curve;
      curve.name = "power of the flash", curve.unit = "of declared";
      double mean = 0, squares = 0, count = 0;
      Eigen::Index at = 0;
      for (std::size_t k = 0; k < capture.photos.size(); ++k) {
        if (!trial.fitted[k]) continue;
        mean += rig.logGain[k], count += 1;
      }
      mean /= std::max(count, 1.0);
      for (std::size_t k = 0; k < capture.photos.size(); ++k) {
        if (!trial.fitted[k]) continue;
        const double off = rig.logGain[k] - mean;
        squares += off * off;
        curve.photo.push_back(static_cast<int>(k));
        curve.value.push_back(std::exp(off)), curve.sd.push_back(std::exp(off) * sdAt(at++));
      }
      const double spread = std::sqrt(squares / std::max(count - 1, 1.0));
      finding.curves.push_back(curve);
      finding.parameters = {{"relativeChange", "", spread, spread / std::sqrt(std::max(2 * count, 1.0)), ""}};
      finding.sentence = number(
          "The flash (or the camera's exposure) wasn't the same in every photograph: its power varies by "
          "%.0f %% "
          "from one to the next.",
          100 * spread);
      break;
    }
    case FlashEffect::NearLight: {
      const double loss = 1 - std::exp(-rig.beamFallOff * cornerTan(trial) * cornerTan(trial));
      // exp(a.s - b s^2) is largest at s = a / 2b.
      const double aim =
          rig.beamFallOff > 0.1 ? std::atan(0.5 * rig.aim.norm() / rig.beamFallOff) * kDegrees : 90;
      finding.parameters = {{"beamFallOff", "", rig.beamFallOff, sdAt(0), ""},
                            {"aimX", "", rig.aim.x(), sdAt(1), ""},
                            {"aimY", "", rig.aim.y(), sdAt(2), ""}};
      finding.sentence = number(
          "The flash doesn't shine alike in all directions: straight below it the sample gets %.0f %% more "
          "light "
          "than in a direction %.0f degrees away, beyond the fall-off with distance",
          100 * (1 / std::max(1 - loss, 0.05) - 1), std::atan(cornerTan(trial)) * kDegrees);
      finding.sentence += aim < 60
                              ? number(", and its beam's middle is %.0f degrees beside straight down.", aim)
                              : ", and one side gets more than the other.";
      break;
    }
    case FlashEffect::Vignetting: {
      const double t2 = cornerTan(trial) * cornerTan(trial);
      const double loss = 1 - std::exp(-rig.vignetting * t2);
      finding.parameters = {{"cornerLoss", "", loss, (1 - loss) * t2 * sdAt(0), ""}};
      finding.sentence = number(
          "The lens loses light towards the corners: %.0f %% at %.0f degrees from its axis (the axis is "
          "taken to "
          "point at the sample's middle).",
          100 * loss, std::atan(cornerTan(trial)) * kDegrees);
      break;
    }
    case FlashEffect::StrayLight: {
      const double middle = middleIrradiance(trial), share = rig.ambient.mean() / middle;
      finding.parameters = {{"share", "", share, (sdAt(0) + sdAt(1) + sdAt(2)) / 3 / middle, ""}};
      finding.sentence =
          number("Beside the flash the room lit the sample: %.1f %% of the flash's light in the middle.",
                 100 * share);
      break;
    }
    case FlashEffect::BlackLevel:
      finding.parameters = {
          {"offset", "of full white", rig.black.mean(), (sdAt(0) + sdAt(1) + sdAt(2)) / 3, ""}};
      finding.sentence =
          number("Pixels that get no light say %.4f of full white instead of nothing.", rig.black.mean());
      break;
    case FlashEffect::Anisotropy: {
      double largest = 0;
      for (std::size_t m = 0; m < with.state.model.materials.size(); ++m) {
        const Eigen::Vector2d& stretch = with.state.model.materials[m].lobe.stretch;
        const std::string where = materialName(trial, m);
        const auto at = static_cast<Eigen::Index>(2 * m);
        const double ratio = std::exp(stretch.norm());
        finding.parameters.push_back({"ratio", "", ratio, ratio * sdAt(at), where});
        finding.parameters.push_back(
            {"angleDeg", "degrees", 0.5 * kDegrees * std::atan2(stretch.y(), stretch.x()),
             stretch.norm() > 0.01 ? 0.5 * kDegrees * sdAt(at) / stretch.norm() : 90, where});
        largest = std::max(largest, ratio);
      }
      finding.sentence = number(
          "Highlights are stretched: the surface's slope varies up to %.2f times as much in one direction as "
          "across "
          "it.",
          largest);
      break;
    }
    case FlashEffect::ThirdLobe: {
      double largest = 0, width = 0;
      Eigen::Index at = 0;
      for (std::size_t m = 0; m < with.state.model.materials.size(); ++m) {
        const FlashLobe& lobe = with.state.model.materials[m].lobe;
        const std::string where = materialName(trial, m);
        finding.parameters.push_back({"share", "", lobe.thirdShare, sdAt(at++), where});
        if (lobe.thirdShare > 0.01) {
          const double ratio = std::exp(lobe.logThirdRatio);
          finding.parameters.push_back({"sigmaRatio", "", ratio, ratio * sdAt(at++), where});
          if (lobe.thirdShare > largest) largest = lobe.thirdShare, width = ratio;
        }
      }
      finding.sentence = number(
          "Below the highlight lies a broader one: up to %.0f %% of the glossy light, %.1f times as wide.",
          100 * largest, width);
      break;
    }
    case FlashEffect::BasisDeviation: {
      double squares = 0, count = 0;
      for (const FlashMaterial& material : with.state.model.materials)
        for (const double d : material.lobe.deviation) squares += d * d, count += 1;
      const double rms = std::sqrt(squares / std::max(count, 1.0));
      finding.parameters = {{"relativeChange", "", std::expm1(rms), 0, ""}};
      finding.sentence = number(
          "The highlight's profile isn't the model's, and no effect of the catalogue explains how: a "
          "free-form "
          "factor over the half-vector's slope, %.0f %% in root mean square, predicts better.",
          100 * std::expm1(rms));
      break;
    }
  }
  finding.plots.insert(finding.plots.begin(), flashPlot(effect, trial, without, with.state));
  return finding;
}

BudgetLine flashBudget(FlashEffect effect, const FlashTrial& trial, const FlashTry& final) {
  BudgetLine line;
  line.id = flashEffectId(effect);
  const FlashCapture& capture = trial.data.capture;
  const EffectScore score =
      scoreEffect(final.state, trial.sample, capture, final.effects, effect, trial.fitted);
  const std::vector<FlashUnknown> own = effectUnknowns(effect, final.state.model, capture, trial.fitted);
  if (own.empty() || score.step.size() == 0) return line;
  // Each unknown's 95 % bound, no larger than what the prior holds possible at all.
  Eigen::VectorXd most(score.step.size());
  for (Eigen::Index i = 0; i < most.size(); ++i)
    most[i] =
        std::min(std::abs(score.step[i]) + 1.96 * score.sd[i], 3 * own[static_cast<std::size_t>(i)].priorSd);
  const double t2 = cornerTan(trial) * cornerTan(trial);
  switch (effect) {
    case FlashEffect::CameraResponse:
      line.parameter = "gamma", line.unit = "away from 1";
      line.largestUnseen = std::expm1(most.segment(1, 3).mean());
      break;
    case FlashEffect::LightPower:
      line.parameter = "relativeChange",
      line.largestUnseen = std::expm1(std::sqrt(most.squaredNorm() / static_cast<double>(most.size())));
      break;
    case FlashEffect::NearLight:
      line.parameter = "share at the corner", line.largestUnseen = -std::expm1(-most[0] * t2);
      break;
    case FlashEffect::Vignetting:
      line.parameter = "cornerLoss", line.largestUnseen = -std::expm1(-most[0] * t2);
      break;
    case FlashEffect::StrayLight:
      line.parameter = "share", line.largestUnseen = most.mean() / middleIrradiance(trial);
      break;
    case FlashEffect::BlackLevel:
      line.parameter = "offset", line.unit = "of full white", line.largestUnseen = most.mean();
      break;
    case FlashEffect::Anisotropy:
      line.parameter = "ratio", line.unit = "above 1", line.largestUnseen = std::expm1(most.mean());
      break;
    case FlashEffect::ThirdLobe:
      line.parameter = "share", line.largestUnseen = std::min(1.0, most.mean());
      break;
    case FlashEffect::BasisDeviation:
      line.parameter = "relativeChange", line.largestUnseen = std::expm1(most.mean());
      break;
  }
  const MapShift shift =
      shiftOf(final.state, trial.sample, capture, final.effects, effect, most, trial.fitted);
  line.shifts = {{"normal", "degrees", shift.normalDeg},
                 {"diffuse", "relative", shift.diffuse},
                 {"specular", "relative", shift.specular},
                 {"sigma", "relative", shift.sigma}};
  line.sentence = number("Up to %.2g", line.largestUnseen) + (line.unit.empty() ? "" : " " + line.unit) +
                  number(
                      " could hide in these photographs; it would turn normals by %.2g degrees and change "
                      "the diffuse albedo by %.0f %% and the specular one by %.0f %%.",
                      shift.normalDeg, 100 * shift.diffuse, 100 * shift.specular);
  return line;
}

void addFlashBlindSpots(Explanation& explanation, const FlashTrial& trial, const FlashTry& final) {
  double largest = 0, lean = 0;
  for (const FlashSite& site : trial.sample.sites)
    for (const FlashObservation& seen : site.seen)
      largest =
          std::max(largest, 0.5 * std::acos(std::clamp(seen.ray.toLight.dot(seen.ray.toView), -1.0, 1.0)));
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const TexelVector& x : final.state.x) sum += x.head<2>();
  sum /= std::max<double>(1, static_cast<double>(final.state.x.size()));
  lean = std::atan(sum.norm()) * kDegrees;
  const std::string coincide = number(
      "Camera and light are within %.1f degrees of each other, so the difference angle never leaves %.1f "
      "degrees: ",
      2 * largest * kDegrees, largest * kDegrees);
  const std::map<std::string, std::string> reasons = {
      {"fresnel", coincide + "Fresnel's rise begins above 45 and can't be seen here at all."},
      {"sheen", coincide + "sheen shows at grazing angles, which no photograph has."},
      {"retroreflection",
       coincide +
           "every photograph looks along the light, so a retroreflecting lobe is the same in all of them "
           "and is counted as diffuse albedo."},
      {"clearcoat",
       coincide +
           "a coat's own reflection falls together with the base's; a narrow one shows as third-lobe."},
      {"iridescence",
       coincide +
           "colours that change with the difference angle don't change; with the half-vector's slope they "
           "would show as a residual in one channel."},
      {"subsurface",
       "Light that comes out beside where it went in shows only at borders and edges; with photographs this "
       "few "
       "it is counted as diffuse albedo."},
      {"self-shadowing", coincide + "what the camera sees the flash lights: there is no shadow to see."},
      {"sample-tilt", number("A tilt common to the whole sample is absorbed by the normals, degree for "
                             "degree (they lean by %.1f "
                             "degrees on average); so is a flash that sits beside where the bundle says.",
                             lean)},
      {"exposure-mismatch",
       "An exposure that differs from photograph to photograph does exactly what light-power does."},
      {"saturation",
       "Clipped pixels are lower bounds in this fit, wherever the photographs show that they clip."},
      {"channel-crosstalk",
       "Light of one channel in another changes the albedos' colour and nothing else: it is absorbed."},
      {"glare",
       "Light spread around highlights isn't modelled for this kind of capture; a wide one looks like a "
       "third lobe."},
      {"defocus",
       "Blur isn't modelled for this kind of capture; it makes texels alike and is part of each "
       "material's discrepancy."},
      {"ambient-drift",
       "Room light that changes between photographs isn't told from the flash's power here."},
  };
  for (const EffectInfo* info : effectCatalogue()) {
    if (!(info->kinds & kFlashKind)) continue;
    const std::string id(info->id);
    const auto known = allFlashEffects();
    if (std::any_of(known.begin(), known.end(), [&](FlashEffect e) { return id == flashEffectId(e); }))
      continue;
    const auto reason = reasons.find(id);
    EffectFinding finding;
    finding.id = id;
    finding.verdict = reason != reasons.end()
                          ? reason->second
                          : "Not tried: this version has no term for it in flash captures.";
    explanation.considered.push_back(finding);
    BudgetLine line;
    line.id = id;
    line.parameter = info->parameters.empty() ? "" : std::string(info->parameters.front().name);
    line.unit = info->parameters.empty() ? "" : std::string(info->parameters.front().unit);
    // Not bounded by these photographs: as large as it can be.
    line.largestUnseen = info->parameters.empty() ? 0 : info->parameters.front().most;
    line.sentence = "Not bounded by these photographs. " + finding.verdict;
    if (id == "sample-tilt") {
      line.largestUnseen = lean;
      line.shifts = {{"normal", "degrees", lean}};
    }
    explanation.budget.push_back(line);
  }
}

}  // namespace patina
