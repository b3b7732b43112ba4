#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/result.h"

namespace patina {

/// What a simulated rig does and its bundle doesn't say: the physics that a standard fit lacks. One group an
/// effect, named by the id of the command-line contract; the defaults are "none of it", and a capture without
/// effects is the same bit for bit as one made without this struct. Read by simulators and tests; nothing of
/// it is declared in a bundle. Units, ranges and meanings of all fields: `simulatedEffectFields`.
///
/// Order along the light: the panel's response makes the displayed value, spatial emission and drift scale
/// it, angular emission sends it, horizon and surface reflect it, subsurface spreads the diffuse part over
/// the sheet, defocus then glare blur the picture, stray light and ambient light are added, the sensor mixes
/// channels, clips and adds noise, and its curve comes last.
struct SimulatedEffects {
  // ---- screen ----
  struct EmissionAngular {
    double skirt = 0, skirtWidth = 2;    ///< share of a wider Gaussian, and how much wider it is
    double cosine = 0, cosinePower = 2;  ///< share of a cos^n panel
    double beyond = 0, beyondTan = 0.7;  ///< change of emission far outside a radius in tan(theta)
    double tiltX = 0, tiltY = 0;         ///< emission's centre is off by so much, in tan(theta)
  } emissionAngular;
  struct EmissionSpatial {
    double edges = 0;                           ///< share lost at the corners, as the radius squared
    double gradient = 0, gradientAngleDeg = 0;  ///< change from the centre to the edge in one direction
  } emissionSpatial;
  struct ScreenResponse {
    double gamma = 1;
  } screenResponse;
  struct ScreenDrift {
    double warmUp = 0, warmUpPhotos = 40;  ///< share missing at the first photograph, and its decay
    double linear = 0;                     ///< change from first to last
  } screenDrift;
  struct Flicker {
    double sd = 0;
  } flicker;
  // ---- geometry ----
  struct ScreenPose {
    double tiltXDeg = 0, tiltYDeg = 0, turnDeg = 0;        ///< about the screen's own axes, its centre fixed
    double shiftXMm = 0, shiftYMm = 0, alongNormalMm = 0;  ///< along the declared screen's axes
  } screenPose;
  struct SampleHeight {
    double bendMm = 0, bendAngleDeg = 0;    ///< cylinder: height of the edge over the centre
    double wavesMm = 0, waveLengthMm = 90;  ///< standard deviation of smooth waves
  } sampleHeight;
  struct SampleTilt {
    double aboutXDeg = 0, aboutYDeg = 0, liftMm = 0;
  } sampleTilt;
  // ---- surface; `material`: index of the only material that has it, -1: all ----
  struct Anisotropy {
    double ratio = 1, angleDeg = 0, material = -1;
  } anisotropy;
  struct ThirdLobe {
    double share = 0, sigma = 0.4;  ///< share of the lobe's energy in a further Gaussian
    double ggx = 0;                 ///< share of the lobe that has GGX's tails instead
    double material = -1;
  } thirdLobe;
  struct Fresnel {
    double power = 5, f0 = 0.06;
  } fresnel;
  struct Sheen {
    double albedo = 0, width = 0.8;  ///< Charlie's velvet
    double grazing = 0;              ///< Disney's: of (1 - l.h)^5
    double material = -1;
  } sheen;
  struct Retroreflection {
    double albedo = 0, widthDeg = 25, material = -1;
  } retroreflection;
  struct Clearcoat {
    double weight = 0, sigma = 0.03, material = -1;
  } clearcoat;
  struct Subsurface {
    double radiusMm = 0;
  } subsurface;
  struct SelfShadowing {
    double horizonDeg = 0, softDeg = 3;      ///< elevation over the sample's plane
    double sectorDeg = 360, azimuthDeg = 0;  ///< part of the horizon that has it, and its middle
  } selfShadowing;
  // ---- lens ----
  struct Glare {
    double share = 0, radiusPx = 4;
  } glare;
  struct Defocus {
    double sigmaPx = 0;
  } defocus;
  struct Vignetting {
    double corners = 0;
  } vignetting;
  // ---- sensor ----
  struct CameraResponse {
    double gamma = 1, compression = 0;
  } cameraResponse;
  struct BlackLevel {
    double offset = 0;
  } blackLevel;
  struct ChannelCrosstalk {
    double amount = 0;
  } channelCrosstalk;
  struct AmbientDrift {
    double perPhoto = 0, sd = 0, onSheet = 0;
  } ambientDrift;
  struct StrayLight {
    double share = 0;
  } strayLight;
  struct Saturation {
    double level = 1;
  } saturation;
  struct ExposureMismatch {
    double error = 0, share = 0.5;
  } exposureMismatch;

  /// Ids of what is switched on, in the order of `simulatedEffectFields`.
  std::vector<std::string> ids() const;
  bool none() const { return ids().empty(); }
  bool has(std::string_view id) const;
  /// Every problem with the values; empty when usable. `materials`: how many the sheet has.
  std::vector<std::string> validate(int materials = 1 << 20) const;
};

/// One number of an effect. The whole description: files, checks and pages follow it.
struct SimulatedEffectField {
  std::string_view id;    ///< of the effect
  std::string_view name;  ///< key in files: "ratio"
  std::string_view unit;  ///< "" for a ratio
  double none;            ///< where it does nothing; the default for a field that is no strength
  bool strength;          ///< the effect is on where a strength differs from `none`
  double least, most;
  std::string_view meaning;
  double& (*of)(SimulatedEffects&);
  double get(const SimulatedEffects& effects) const { return of(const_cast<SimulatedEffects&>(effects)); }
};
const std::vector<SimulatedEffectField>& simulatedEffectFields();

/// {"anisotropy": {"ratio": 1.2, "angleDeg": 30}}: the effects that are on, with all of their fields.
nlohmann::json simulatedEffectsJson(const SimulatedEffects& effects);
/// The reverse. Fields that are left out keep their defaults. Errors: Malformed (no JSON object of objects of
/// numbers), Invalid (unknown effect or field, nearest name suggested; a value out of range). `where` names
/// the file.
Result<SimulatedEffects> simulatedEffectsFromJson(std::string_view text, const std::string& where);

}  // namespace patina
