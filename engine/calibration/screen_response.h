#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/calibration/white_tile.h"
#include "engine/image/image.h"

namespace patina {

/// What the screen sent for one grey value.
struct GreySample {
  double value = 0;                                 ///< sent to the screen, 0..1 of the largest code
  Eigen::Vector3d light = Eigen::Vector3d::Zero();  ///< R G B, linear, any unit
};

/// Grey values for a ramp: denser near black, where curves bend, each once; 0 and 1 are among them.
std::vector<double> greyRamp(int count);

/// Mean light of the region in a linear photograph, the largest and smallest twentieth left out.
Eigen::Vector3d meanLight(const Image& photo, const PixelRegion& region);

/// A screen's curve: light over value, R G B together (a pattern is grey).
struct ScreenCurve {
  std::vector<double> value, light;  ///< rising from (0, 0) to (1, 1): black's light taken off
  double blackShare = 0;             ///< light at black over light at white
  double exponent = 2.2;             ///< of the best power law
  double residual = 0;               ///< RMS of samples minus curve, of full white
  double channelSpread = 0;          ///< largest difference between the channels' own curves, of full white
  std::vector<std::string> warnings;

  /// Light (0..1) that a value gives, and the value that gives a light. Clamped.
  double lightOf(double sent) const;
  double valueFor(double wantedLight) const;
  /// Codes of an inverse table: entry i is the value to send for light i / (entries - 1).
  std::vector<double> inverseTable(int entries) const;
};

/// The curve through the samples: monotone (isotonic), piecewise cubic without overshoot between them.
/// Repeated values are averaged. Errors: Invalid (fewer than 5 values, none at black or white, light that
/// doesn't rise).
Result<ScreenCurve> fitScreenResponse(const std::vector<GreySample>& samples);

/// The paper's way around the curve (section 4.2): during one exposure the screen shows `frames` black and
/// white pictures, H(h - s), so that light adds up to h whatever the curve is. Picture `frame` of `frames`
/// for a pattern of 1 channel, 0..1: 1 where white. Thresholds (frame + 1/2) / frames: the mean is off by at
/// most 1 / (2 frames).
Image thresholdedFrame(const Image& pattern, int frame, int frames);
/// How many white frames a value is given, of `frames`.
int whiteFrames(double value, int frames);

}  // namespace patina
