#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/result.h"
#include "engine/image/image.h"

namespace patina {

/// A camera's measured response for one channel: `output` (linear) over `input` (pixel value, 0..1), linear
/// in between.
struct ResponseCurve {
  std::vector<double> input;   ///< strictly rising, first 0, last 1
  std::vector<double> output;  ///< never falling, relative radiance
};

/// How a photograph's pixels become linear: the key `encoding` of a photo.
struct PhotoEncoding {
  enum class Kind { Linear, Srgb, Gamma, Response };
  Kind kind = Kind::Linear;
  double gamma = 1.0;        ///< linear = pixel ^ gamma; kind Gamma
  std::string responseFile;  ///< relative to the bundle; kind Response
};

/// Understands "", "linear", "srgb", "gamma:2.2" and "response:FILE.json". Errors: Malformed, `where` names
/// the key.
Result<PhotoEncoding> parseEncoding(const std::string& text, const std::string& where);

/// Curves for R, G, B from the text of a response file (docs/response_curves.md). Errors: Malformed, Invalid.
Result<std::array<ResponseCurve, 3>> parseResponse(std::string_view text, const std::string& where);

/// As `parseResponse`, from a file (16 MiB at most). Errors also: NotFound.
Result<std::array<ResponseCurve, 3>> readResponse(const std::filesystem::path& file);

/// sRGB's electro-optical curve, pixel value 0..1 to linear 0..1, not clamped. Source: IEC 61966-2-1.
double linearFromSrgbPixel(double value);

/// The curve's output at a pixel value, clamped to 0..1.
double linearFromResponse(const ResponseCurve& curve, double value);

}  // namespace patina
