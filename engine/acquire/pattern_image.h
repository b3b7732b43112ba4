#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/capture/capture.h"
#include "engine/capture/encoding.h"
#include "engine/image/image.h"
#include "engine/screen/screen.h"

namespace patina {

/// What a screen can be asked to show for a measurement.
struct PatternSpec {
  enum class Kind {
    Sine,    ///< window(x) * max(0, sin(frequency . x + phase pi / 2))
    Window,  ///< the window alone
    Black,
    Flat,   ///< grey of `level` all over
    Patch,  ///< a square of `level` in the middle, a fifth of the height wide, on black
  };
  Kind kind = Kind::Black;
  Eigen::Vector2i frequency = Eigen::Vector2i::Zero();  ///< waves over the screen's width
  int phase = 0;                                        ///< 0..3
  double level = 1;                                     ///< linear, of full white
  bool operator==(const PatternSpec&) const = default;
};
PatternSpec patternOf(const FourierPhoto& photo);

/// The picture in linear light, one channel, 0 to 1, row 0 at the top, a value a physical pixel: the pattern
/// at the pixel's centre. Source: frequency-domain paper, section 4.3, and the capture format (x from -pi to
/// pi over the width, y up, phase k pi / 2). `screen`: its pixels, aspect (of its millimetres) and window.
Image patternImage(const PatternSpec& spec, const Screen& screen);

/// The linear light that a screen's 8-bit values give: measured, or a guess. `level[v]`: of full white, never
/// falling, level[255] = 1.
struct ScreenResponse {
  std::array<double, 256> level{};
  static ScreenResponse linear();
  static ScreenResponse gamma(double exponent);
  /// From a measured curve, value 0..1 to light. Errors: Invalid (falling, or no light at full white).
  static Result<ScreenResponse> fromCurve(const ResponseCurve& curve);
};

/// A picture as a window draws it, one value a physical pixel, unscaled. Copies share their pixels.
struct ShownPicture {
  std::string name;  ///< for a person and the log: "frequency 3, -3, phase 2"
  int width = 0, height = 0, channels = 1;
  std::shared_ptr<const std::vector<std::uint8_t>> pixels;  ///< row 0 at the top, channels interleaved
  std::uint64_t hash() const;                               ///< of size and pixels
};

/// The picture with 8 bits a value: each pixel takes one of the two values whose light lies round what is
/// wanted, by error diffusion (Floyd and Steinberg 1976, rows in turn left and right): its mean over any
/// few pixels is the wanted light. Deterministic.
ShownPicture shownPicture(const Image& linear, const ScreenResponse& response, std::string name);
/// Both in one; named.
ShownPicture shownPattern(const PatternSpec& spec, const Screen& screen, const ScreenResponse& response);
/// "frequency 3, -3, phase 2", "window", "black".
std::string patternName(const PatternSpec& spec);

/// The light of a shown picture, one channel (the mean of three), 0 to 1.
Image lightOf(const ShownPicture& picture, const ScreenResponse& response);

/// The black and white picture that the paper shows at a share of the exposure (section 4.2): 1 where the
/// pattern exceeds it. Shown one after another over an exposure they add up to the pattern, whatever the
/// screen's response.
ShownPicture thresholdPicture(const Image& linear, double share, std::string name);

}  // namespace patina
