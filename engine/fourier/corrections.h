#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include "engine/fourier/site_geometry.h"
#include "engine/surface/svbrdf_parameters.h"

namespace patina {

/// What the standard model lacks and something else has found out (closing the loop): undone in the
/// measurements, or added to the light, so that the fit itself runs as without. Everything empty or zero:
/// nothing is changed. Undone in this order: response, crosstalk, offset, gain, extra. Functions are called
/// from several threads at once.
struct FourierCorrections {
  /// Linear radiance (one channel) from what the photograph says; empty: the same. Must increase, and be
  /// finite. Tabulated once.
  std::function<float(float)> linearFromPhoto;
  /// R G B light that reached the sensor from R G B that it recorded.
  Eigen::Matrix3f unmix = Eigen::Matrix3f::Identity();
  /// By index into capture.photos: radiance added to the photograph; empty: none.
  std::vector<Eigen::Array3f> photoOffset;
  /// By index into capture.photos: factor on everything but black; empty: 1.
  std::vector<float> photoGain;
  /// Photographs are clipped at this radiance (as they say it), whatever the bundle says; 0: as it says.
  /// Samples within 2 % of it count as clipped: noise may have come after the clipping.
  double saturation = 0;

  /// Natural logarithm of a factor on the screen's radiance: point of the screen and the seen-from point's
  /// foot on it, pattern units, and its distance from the screen, pattern units. Smooth. Empty: 0.
  std::function<double(const Eigen::Vector2d& screenPoint, const Eigen::Vector2d& foot, double distance)>
      logEmission;
  /// The site's solution so far; [site]. Where the factor's second-order expansion is made for its lobe, and
  /// where the search begins: there are no coarse levels then. Null, or of another length: levels, and with
  /// logEmission the sheet is solved twice.
  std::shared_ptr<const std::vector<SvbrdfParameters>> sites;

  /// What lobes have beyond the standard model: [site], or one element for all of them; null: nothing.
  std::shared_ptr<const std::vector<LobeTerms>> lobeTerms;

  /// What an effect adds to a site's measurements beyond the model, to be taken off them before the fit and
  /// in the comparison with photographs. z: [frequency][re R G B, im R G B], even: [frequency][I0 + I2 R G B,
  /// I1 + I3 R G B], window: [R G B]; to be added to. heldOut: of plan.heldOut's frequencies. Thread-safe.
  std::function<void(std::size_t site, bool heldOut, float* z, float* even, float* window)> extra;

  /// Height (world z, mm) of the sample's surface where a photograph's pixel that would see `pointMm` of the
  /// plane z = 0 sees it: the pixel's ray is followed to that height. Empty: 0.
  std::function<double(const Eigen::Vector2d& pointMm)> heightMm;
};

}  // namespace patina
