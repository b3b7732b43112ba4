#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <random>
#include <string>
#include <vector>

#include "engine/brdf/brdf.h"
#include "engine/image/image.h"

namespace patina {

/// What happens on the simulated near-field rig and isn't written into the bundle. Formulas of this folder's
/// own: the diagnosis that looks for these shares none of them. All zero: nothing.
struct TwoShotEffects {
  Eigen::Vector2d normalLeansDeg =
      Eigen::Vector2d::Zero();    ///< of the sample, towards +x and +y; its outline stays
  double heightMm = 0;            ///< of the sample, as the view direction sees it; its outline stays
  double lightDistanceMm = 0;     ///< of a lamp from the sample's centre; 0: distant
  bool tileUnderSameLamp = true;  ///< false: the tile was photographed under a distant light
  double vignetting = 0;  ///< share lost at the picture's sides' middle, as the square; not on the tile
  double strayShare =
      0;  ///< of the photograph's median over the sample, grey, added everywhere; not on the tile
  std::vector<double> exposureFactors;  ///< of each pose's photographs of the sample; empty: 1
  double gamma = 1;                     ///< pixel = full scale (light / full scale)^gamma
  double blackShare = 0;                ///< of the photographs' mean level over the sample
  double crosstalk = 0;                 ///< share of each channel that goes to each of the other two
  double glareShare = 0, glarePx = 10;  ///< spread by an exponential kernel
  double defocusPx = 0;                 ///< radius of a disc
  double clipShare = 0;  ///< of the brightest value, at which the sensor clips without the bundle saying so
  double surroundings = 0;  ///< BRDF-like level of what lies around sample and tile, 1/sr

  bool any() const;
};

/// Light at a point of the sample: direction in the sample's frame, cosine times irradiance over that of the
/// distant light head-on.
struct LampAtPoint {
  Eigen::Vector3d toLight, toView;
  double cosineGain = 0;
};
LampAtPoint lampAt(const TwoShotEffects& effects, const Eigen::Vector3d& toDistantLight,
                   const Eigen::Vector3d& eyeMm, const Eigen::Vector3d& pointMm, bool tile);

/// What lens and sensor do to one photograph of the sample before noise, in place. `onSample`: 1 where the
/// pixel shows the sample. `fullScale`: of the sensor.
void distortPhoto(const TwoShotEffects& effects, std::size_t pose, const std::vector<char>& onSample,
                  double meanLevel, double fullScale, Image& photo);

/// A material under a smooth colourless coat (Cook and Torrance with Beckmann's distribution and the exact
/// Fresnel equations), `weight` times; and one that sends light back, a Gaussian in the angle between light
/// and view.
BrdfPtr coatedBrdf(BrdfPtr base, double weight, double alpha);
BrdfPtr retroreflectingBrdf(BrdfPtr base, const Eigen::Array3d& peak, double widthDeg);
/// The same with its highlight stretched along a direction: the half-vector's slope is scaled.
BrdfPtr stretchedBrdf(BrdfPtr base, double ratio, double directionDeg);
/// The same under fibres that glow towards grazing: the half-vector's sine to the power of 1 / `width`
/// (Estevez and Kulla 2017), without shadowing, grey, `weight` times.
BrdfPtr fibrousBrdf(BrdfPtr base, double weight, double width);
/// The same behind a thin film: each channel is multiplied by 1 + `contrast` cos(phase), the phase being that
/// of a film of `opticalNm` at wavelengths of 610, 540 and 460 nm, less its mean over all angles.
BrdfPtr filmedBrdf(BrdfPtr base, double contrast, double opticalNm);

/// Ids of the effects that `drawEffect` knows.
std::vector<std::string> drawnEffectIds();
/// One effect of random strength, `scale` 1 being what one meets; changes `effects` and perhaps the material.
void drawEffect(const std::string& id, double scale, std::mt19937_64& random, std::size_t poses,
                TwoShotEffects& effects, BrdfPtr& material);

}  // namespace patina
