#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/brdf/half_diff.h"
#include "engine/brdf/tabulated_brdf.h"
#include "engine/geometry/camera.h"
#include "engine/image/image.h"
#include "engine/twoshot/smooth_correction.h"

namespace patina {

/// One point of one photograph, as the bundle describes it.
struct PhotoPoint {
  std::size_t shot = 0;  ///< index into the capture's shots
  Eigen::Vector3d toLight = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d cameraMm = Eigen::Vector3d::Zero();
  Eigen::Vector2d positionMm = Eigen::Vector2d::Zero();
  double cornerShare = 0;  ///< squared distance from the picture's middle over that of its corner
  Eigen::Array3d rate = Eigen::Array3d::Ones();  ///< E cos(thetaI) by the white tile, pixel units per second
  double exposureS = 1;
};

/// A lobe that is added to what the basis says, R G B.
struct RetroLobe {
  Eigen::Array3d weight = Eigen::Array3d::Zero();  ///< BRDF towards the light at normal incidence, 1/sr
  double widthDeg = 3;   ///< angle between light and view at which it has fallen to 2^-tail
  double tail = 1;       ///< falls as the angle to the power of -2 tail
  double incidence = 2;  ///< exponent of cos(thetaH) by which it falls for oblique light
};
struct CoatLobe {
  double weight = 0;   ///< 1: a smooth dielectric's (F0 = 0.04) microfacet lobe
  double alpha = 0.1;  ///< GGX
};

/// How the photographs were taken other than the bundle says, and what the sample does other than an
/// isotropic material of the basis. All zero: nothing. The order in which light meets these: near light,
/// tilt, lobes, vignetting, stray light, gain, black level, response.
struct TwoShotDeviation {
  Eigen::Vector2d tiltDeg = Eigen::Vector2d::Zero();  ///< of the sample about world x, then y
  double heightMm = 0;   ///< of the sample above z = 0, as the view direction sees it
  double lightPerM = 0;  ///< 1 / distance of the light, 1/m; 0: distant
  bool whiteLitAlike =
      true;  ///< the white tile was lit by the same near light, so that its fall-off is divided out
  double vignetting = 0;  ///< share lost in the picture's corner, growing with the square of the radius
  double vignettingLate =
      0;  ///< share of light by which the loss half way out is smaller than that law's, times 4
  std::vector<Eigen::Array3d>
      stray;                   ///< each shot: light added to every pixel, pixel units per second; or empty
  std::vector<double> lnGain;  ///< each shot: ln of the true over the declared exposure times light; or empty
  Eigen::Array3d blackLevel = Eigen::Array3d::Zero();  ///< added to every pixel of the sample's photographs
  double lnResponse = 0;   ///< ln of the exponent: pixel = top (light / top)^exponent
  double responseTop = 1;  ///< pixel value that the response leaves alone
  double crosstalk = 0;    ///< share of the other two channels' mean that a channel takes on
  double glare = 0;        ///< share of light spread over `glarePx`
  double glarePx = 8;      ///< standard deviation, pixels
  double defocusPx = 0;    ///< standard deviation of the blur, pixels
  double saturation = 0;   ///< pixel value at which the sensor clips; 0: as the bundle says

  Eigen::Vector2d stretch =
      Eigen::Vector2d::Zero();  ///< anisotropy: thetaH grows by x cos 2phiH + y sin 2phiH
  std::optional<RetroLobe> retro;
  std::optional<CoatLobe> coat;
  double sheen = 0;    ///< 1/sr at grazing thetaD, times (1 - cos thetaD)^5
  double fresnel = 0;  ///< ln of the change at grazing thetaD, times (1 - cos thetaD)^5
  /// Colour that changes with thetaD: ln R - ln B and ln G - (ln R + ln B) / 2, linear and square in
  /// 1 - cos(thetaD).
  Eigen::Matrix2d tint = Eigen::Matrix2d::Zero();
  std::shared_ptr<const SmoothCorrection> correction;  ///< what has no name; null: none

  bool none() const;

  /// Light and view in the sample's own frame.
  DirectionPair directions(const PhotoPoint& point) const;
  /// Where the basis is looked up: half-angle coordinates, stretched by anisotropy.
  HalfDiffAngles angles(const DirectionPair& pair) const;
  /// What is added to the basis' BRDF, 1/sr.
  Eigen::Array3d added(const DirectionPair& pair) const;
  /// What it is multiplied by.
  Eigen::Array3d multiplied(const HalfDiffAngles& angles) const;
  /// Light that arrives, over light that the bundle's description lets expect.
  double gain(const PhotoPoint& point, const DirectionPair& pair) const;

  /// The BRDF of the basis behind a value that the white division gave, 1/sr; `slope`: its derivative. May be
  /// negative.
  Eigen::Array3d baseFromSeen(const Eigen::Array3d& seen, const PhotoPoint& point, const DirectionPair& pair,
                              Eigen::Array3d* slope = nullptr) const;
  /// The inverse: what the white division would give for a BRDF of the basis. Blurs and clipping left out.
  Eigen::Array3d seenFromBase(const Eigen::Array3d& base, const PhotoPoint& point,
                              const DirectionPair& pair) const;

  /// The same set-up with a plain material.
  TwoShotDeviation withoutSurfaceTerms() const;
  /// A photograph without its glare (to first order), and a prediction with glare and defocus.
  Image sharpened(const Image& photo) const;
  Image blurred(const Image& photo) const;

  /// A table with the terms of the surface (`added`, `multiplied`) put in; anisotropy can't be told there.
  /// The same table where there are none.
  std::shared_ptr<const TabulatedBrdf> withSurfaceTerms(std::shared_ptr<const TabulatedBrdf> table) const;
};

/// A photograph blurred by a Gaussian, edges repeated. Cost: independent of the width above 8 pixels.
Image blurredImage(const Image& image, double sigmaPx);
/// Squared distance of a pixel from the picture's middle over that of its corner.
double cornerShareOf(const Camera& camera, double x, double y);

}  // namespace patina
