#pragma once

#include <QImage>
#include <QString>
#include <optional>
#include <span>

#include "engine/image/image.h"

namespace patina {

/// How the samples of a picture become colours.
enum class ToneStyle {
  LinearRgb,  ///< radiance or albedo, R G B, shown through the sRGB curve
  Scalar,     ///< one number, shown through a colour ramp that is monotonic in lightness
  Normal,     ///< unit vectors: X in red, Y in green, zero in the middle
  Status,     ///< a TexelStatus
  Diverging,  ///< one signed number: blue below zero, orange above, dark in the middle; NaN: nothing there
};

/// What a person has set for a picture: exposure (LinearRgb only) and the range of values that the colours
/// span.
struct ToneSettings {
  double exposureEv = 0;  ///< stops; +1 doubles the brightness
  double low = 0;         ///< value at the ramp's lower end
  double high = 1;        ///< value at the ramp's upper end
  bool operator==(const ToneSettings&) const = default;
};

/// Turns samples into display colours (sRGB). Cheap to copy; all tables are built once.
class ToneMapper {
 public:
  ToneMapper(ToneStyle style, const ToneSettings& settings);
  QRgb operator()(std::span<const float> pixel) const;
  /// Colour of a place on the colour bar, 0 at the low end, 1 at the high end.
  QRgb atFraction(double fraction) const;

 private:
  ToneStyle style_;
  float gain_ = 1, low_ = 0, scale_ = 1;
};

/// sRGB's transfer curve, 0..1 to 0..255, clamped; NaN gives 0.
int encodeSrgb8(float linear);

/// A sensible range for a picture: the 1st to 99th percentile for scalars, 0 to the 99.5th for colours,
/// symmetric for normals. `status`, where given, has one channel of the same
/// size; texels whose state is among `leftOut` (bit i: state i) don't count.
ToneSettings automaticTone(ToneStyle style, const Image& image, const Image* status = nullptr,
                           unsigned leftOut = 1u);

/// Colour and name of a TexelStatus value, for the status map and its legend.
QRgb statusColour(int status);
QString statusName(int status);
inline constexpr int kStatusCount = 7;

/// The whole picture as an 8-bit image, for thumbnails and exports.
QImage toneMapped(const Image& image, const ToneMapper& tone);

}  // namespace patina
