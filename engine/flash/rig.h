#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "engine/capture/flash_capture.h"

namespace patina {

/// What the bundle doesn't say about a phone in somebody's hand, and what the standard lobe lacks: blocks of
/// unknowns that are off by default. Each is an effect of the catalogue.
enum class FlashEffect {
  CameraResponse,  ///< the camera's tone curve beyond the declared encoding
  LightPower,      ///< the flash's power, photograph by photograph
  NearLight,       ///< where the flash aims, and how its beam falls off
  Vignetting,      ///< the lens loses light towards the corners
  StrayLight,      ///< light of the room on the sample
  BlackLevel,      ///< an offset of the decoded values
  Anisotropy,      ///< stretched highlights, for each material
  ThirdLobe,       ///< a broad lobe below the other two, for each material
  BasisDeviation   ///< free-form change of the lobe over the half-vector's slope, for each material
};
inline constexpr int kFlashEffects = 9;
/// Its id in the catalogue, and back (empty: none).
const char* flashEffectId(FlashEffect effect);
std::vector<FlashEffect> allFlashEffects();

/// From light to decoded value: v = T(L), smooth and strictly rising. Parameters: natural logarithm of the
/// slope d ln L / d ln v at five values of v; between them linear over ln v; L(0.2) = 0.2. All zero: v = L.
/// A constant h is a gamma of exp(-h); a slope that grows towards 1 is a camera that compresses highlights.
/// Source: this program; the slope's logarithm keeps the curve monotone whatever the parameters are.
class ToneCurve {
 public:
  static constexpr int kKnots = 5;
  static const std::array<double, kKnots>& knotValues();
  explicit ToneCurve(const std::array<double, kKnots>& logSlope = {});
  /// v for light L; below zero the curve is odd.
  double value(double light) const;
  double light(double value) const;
  /// dv/dL.
  double slopeAt(double light) const;
  bool identity() const { return identity_; }

 private:
  bool identity_ = true;
  std::vector<double> logLight_;  ///< over a uniform grid of ln v
  std::vector<double> logValue_;  ///< over a uniform grid of ln L
  double firstLogLight_ = 0, logLightStep_ = 1;
};

/// What was found about camera, flash and surroundings; as declared where everything is zero.
struct FlashRig {
  std::array<double, ToneCurve::kKnots> toneLogSlope{};
  std::vector<double> logGain;  ///< for each photograph: natural logarithm of the flash's power over declared
  double beamFallOff = 0;       ///< exp(-beamFallOff tan^2) off the axis that looks straight at the sample's
                                ///< plane
  /// exp(aim . slope), slope of the ray from the light: the beam's middle is beside straight down.
  Eigen::Vector2d aim = Eigen::Vector2d::Zero();
  std::vector<Eigen::Vector2d> photoAim;  ///< the same for each photograph, beside `aim`; empty: none
  double vignetting = 0;                  ///< exp(-vignetting tan^2) off the camera's axis
  Eigen::Array3d ambient = Eigen::Array3d::Zero();  ///< irradiance of the room's light, pixel units
  Eigen::Array3d black = Eigen::Array3d::Zero();    ///< added to the decoded value
  bool operator==(const FlashRig&) const = default;
};

/// The lobe's shape that alike texels share.
struct FlashLobe {
  double logSigma = -1.9;                             ///< ln of the slope's standard deviation
  double logKurtosis = 0.25;                          ///< ln gamma; its sign is free
  Eigen::Vector2d stretch = Eigen::Vector2d::Zero();  ///< ln ratio times (cos 2 phi, sin 2 phi)
  double thirdShare = 0;                              ///< of the lobe's light in a third Gaussian
  double logThirdRatio = 1.1;                         ///< ln of its width over sigma
  static constexpr int kDeviations = 5;
  std::array<double, kDeviations> deviation{};  ///< ln of a factor at slope / sigma = 0.5 1 2 3 5

  double sigma() const;
  double kurtosis() const;
};

/// One photograph's light and camera as seen from a point of the sample.
struct FlashRay {
  Eigen::Vector3d toLight, toView;  ///< unit
  double inverseSquare = 0;         ///< 1 / distance^2, mm^-2
  Eigen::Vector2d lightSlope;       ///< of the ray from the light, against straight down
  double axisTan2 = 0;              ///< tan^2 of the angle between the camera's axis and the ray
};
/// Where a rectified photograph's camera looked is not known: at the sample's centre.
FlashRay flashRay(const FlashPhoto& photo, const Eigen::Vector2d& pointMm);

/// What multiplies specular albedo: lobe times cosine (1/sr). Source: svbrdfBrdf (engine/surface/svbrdf.h),
/// with the additions of FlashLobe. normal: unit.
double flashLobeTimesCos(const FlashLobe& lobe, const FlashRay& ray, const Eigen::Vector3d& normal);
/// The factor of flash and lens on the declared irradiance: gain, beam, vignetting.
double flashRigFactor(const FlashRig& rig, int photo, const FlashRay& ray);

/// What a texel has of its own: slopes of the normal, logarithms of the albedos.
struct FlashTexel {
  static constexpr int kParameters = 8;
  Eigen::Matrix<double, kParameters, 1> x = Eigen::Matrix<double, kParameters, 1>::Zero();
  Eigen::Vector3d normal() const { return Eigen::Vector3d(x[0], x[1], 1).normalized(); }
  Eigen::Array3d diffuse() const { return x.segment<3>(2).array().exp(); }
  Eigen::Array3d specular() const { return x.segment<3>(5).array().exp(); }
};

/// The light that the photograph's pixel receives before the tone curve, R G B.
Eigen::Array3d flashLight(const FlashCapture& capture, const FlashRig& rig, int photo, const FlashRay& ray,
                          const FlashLobe& lobe, const FlashTexel& texel);

}  // namespace patina
