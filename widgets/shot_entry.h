#pragma once

#include <QString>
#include <optional>
#include <vector>

#include "engine/capture/two_shot_capture.h"
#include "engine/twoshot/fit.h"
#include "engine/twoshot/near_field.h"
#include "widgets/tone.h"

namespace patina {

/// One photograph of a two-shot bundle as the window lists it. The pointers live as long as the capture and
/// the fit that it was made from.
struct ShotEntry {
  int photo = 0;  ///< in the bundle's PhotoCache: its shots, then its white photographs
  const TwoShotPhoto* shot = nullptr;
  bool white = false;
  const TwoShotComparison* comparison = nullptr;  ///< null for white tiles and without a fit
  QString title;                                  ///< "Shot 1", "Held out 2", "White 1"
};

/// Fitted shots, then held-out ones, then white tiles.
std::vector<ShotEntry> shotEntries(const TwoShotCapture& capture, const TwoShotFit* fit);

/// Directions at the sample's centre.
ShotDirections directionsOf(const TwoShotPhoto& shot);
/// What the sample subtends from the camera at its distance, degrees, averaged over the shots that are
/// fitted: of a rectangle, the disc of the same area.
NearFieldDisc discOf(const TwoShotCapture& capture);

/// How bright a photograph of the sample is shown: up to its highlight where it has one; an even one in the
/// middle of the display's range, not at its upper end.
ToneSettings shotTone(const Image& photograph);

/// "6° 38° 90°": thetaH, thetaD and phiD in 0 to 180 degrees.
QString anglesText(const HalfDiffAngles& angles, int decimals = 0);
/// The same with their names.
QString namedAnglesText(const HalfDiffAngles& angles, int decimals = 0);
/// "12.3 %"; a dash where negative.
QString percentText(double fraction);
/// An error in natural-log units as a person reads it: 0.2 is "22 %", exp(0.2) - 1.
QString logErrorText(double lnUnits);

/// The half-angle coordinates that a pixel of a photograph measures; none beside the sample.
std::optional<HalfDiffAngles> anglesAtPixel(const TwoShotCapture& capture, const TwoShotPhoto& shot, double x,
                                            double y);

}  // namespace patina
