#pragma once

#include <cstdint>
#include <vector>

#include "devices/simulated/simulated_effects.h"
#include "devices/simulated/simulated_sensor.h"
#include "engine/image/image.h"

namespace patina {

/// What happens to whole photographs between the sheet and the file: the effects of time, lens and sensor.
/// Immutable; may be used from several threads.
class PhotoEffects {
 public:
  /// `photos`: how many there are, in the order in which they are taken; the one numbered `blackPhoto` is of
  /// the black screen. `sheetAlbedo`: R G B diffuse albedo at each pixel, used where ambient light falls on
  /// the sheet; may be empty else. fullScale: of the sensor, radiance.
  PhotoEffects(const SimulatedEffects& effects, int photos, int blackPhoto, double blackLevel,
               double fullScale, Image sheetAlbedo, std::uint64_t seed);

  /// Light of the screen that came back from the sheet (R G B radiance) to what the sensor is hit by: drift,
  /// flicker, vignetting, defocus, glare, stray and ambient light, black level, mixed channels.
  void beforeSensor(Image& photo, int index) const;
  /// What the sensor gave to what the file says: its curve.
  void afterSensor(Image& photo) const;
  /// Where the sensor clips, radiance.
  double clipsAt() const { return fullScale_ * effects_.saturation.level; }
  /// Factor on the screen's light of one photograph: drift, flicker and a wrong exposure.
  double screenFactor(int index) const { return factor_[static_cast<std::size_t>(index)]; }
  /// Radiance that ambient light adds to one photograph.
  double ambient(int index) const { return ambient_[static_cast<std::size_t>(index)]; }
  /// Whether a photograph belongs to those of the other exposure.
  bool otherExposure(int index) const;

 private:
  SimulatedEffects effects_;
  int photos_, blackPhoto_;
  double blackLevel_, fullScale_;
  Image sheetAlbedo_;
  std::vector<double> factor_, ambient_;
};

/// The picture convolved with a Gaussian of that many pixels, edges repeated. Exact to 1e-4 of the brightest
/// difference: taps out to four standard deviations, each the mean of the Gaussian over its pixel.
Image blurred(const Image& picture, double sigmaPx);

}  // namespace patina
