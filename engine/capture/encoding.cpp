#include "engine/capture/encoding.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/capture/bundle_path.h"
#include "engine/capture/json_reader.h"

namespace patina {
namespace {

constexpr double kSmallestGamma = 0.1, kLargestGamma = 10.0;
constexpr std::size_t kMostCurvePoints = 65536;  // one for each value of a 16-bit pixel
constexpr std::uint64_t kLargestResponseFile = 16u << 20;
constexpr double kLargestOutput = 1e6;

ResponseCurve readCurve(JsonObject& file, const std::string& channel) {
  JsonObject object = file.object(channel);
  ResponseCurve curve;
  const std::size_t count = object.list("input", 2, kMostCurvePoints).size();
  curve.input = object.numbers("input", count, 0.0, 1.0);
  curve.output = object.numbers("output", count, 0.0, kLargestOutput);
  if (curve.input.front() != 0.0 || curve.input.back() != 1.0) {
    object.fail(ErrorCode::Invalid, "input", "the pixel values must go from 0 to 1");
  }
  for (std::size_t i = 1; i < count; ++i) {
    const std::string index = "[" + std::to_string(i) + "]";
    if (!(curve.input[i] > curve.input[i - 1])) {
      object.fail(ErrorCode::Invalid, "input" + index, "the pixel values must rise from each to the next");
    }
    if (!(curve.output[i] >= curve.output[i - 1])) {
      object.fail(ErrorCode::Invalid, "output" + index, "a response never falls, and this one does");
    }
  }
  if (!(curve.output.back() > curve.output.front())) {
    object.fail(ErrorCode::Invalid, "output", "this response is the same for every pixel value");
  }
  return curve;
}

}  // namespace

Result<PhotoEncoding> parseEncoding(const std::string& text, const std::string& where) {
  PhotoEncoding encoding;
  if (text.empty() || text == "linear") return encoding;
  if (text == "srgb") {
    encoding.kind = PhotoEncoding::Kind::Srgb;
    return encoding;
  }
  constexpr std::string_view kGamma = "gamma:", kResponse = "response:";
  if (text.starts_with(kGamma)) {
    const char* first = text.data() + kGamma.size();
    const char* last = text.data() + text.size();
    const auto [end, code] = std::from_chars(first, last, encoding.gamma);
    if (code == std::errc() && end == last && encoding.gamma >= kSmallestGamma &&
        encoding.gamma <= kLargestGamma) {
      encoding.kind = PhotoEncoding::Kind::Gamma;
      return encoding;
    }
    return Error{ErrorCode::Malformed, inQuotes(text) + " is not a gamma between 0.1 and 10", where,
                 "write it like gamma:2.2"};
  }
  if (text.starts_with(kResponse)) {
    encoding.kind = PhotoEncoding::Kind::Response;
    encoding.responseFile = text.substr(kResponse.size());
    Status allowed = checkBundlePath(encoding.responseFile, where);
    if (!allowed) return allowed.error();
    return encoding;
  }
  return Error{ErrorCode::Malformed, inQuotes(text) + " is not an encoding that this program knows", where,
               "use srgb, gamma:2.2 or response:FILE.json, or leave it out for a linear OpenEXR image"};
}

Result<std::array<ResponseCurve, 3>> parseResponse(std::string_view text, const std::string& where) {
  try {
    const nlohmann::json json = parseJson(text, where);
    JsonObject file(json, where, "");
    if (file.text("format") != "patina-response") {
      file.fail(ErrorCode::Malformed, "format",
                "this is not a response file: its format is not 'patina-response'");
    }
    if (file.integer("version", 0, 1 << 30) != 1) {
      file.fail(ErrorCode::Unsupported, "version", "this response file is of another version than 1");
    }
    return std::array<ResponseCurve, 3>{readCurve(file, "R"), readCurve(file, "G"), readCurve(file, "B")};
  } catch (const JsonFault& fault) {
    return fault.error;
  } catch (const std::exception& failure) {
    return Error{ErrorCode::Malformed, std::string("the file can't be read: ") + failure.what(), where,
                 "write it again"};
  }
}

Result<std::array<ResponseCurve, 3>> readResponse(const std::filesystem::path& file) {
  Result<std::string> text = readFile(file, kLargestResponseFile);
  if (!text) return text.error();
  return parseResponse(*text, file.string());
}

double linearFromSrgbPixel(double value) {
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

double linearFromResponse(const ResponseCurve& curve, double value) {
  const double clamped = std::clamp(value, 0.0, 1.0);
  const auto above = std::upper_bound(curve.input.begin(), curve.input.end(), clamped);
  if (above == curve.input.end()) return curve.output.back();
  const std::size_t i =
      static_cast<std::size_t>(above - curve.input.begin());  // at least 1: the first input is 0
  const double share = (clamped - curve.input[i - 1]) / (curve.input[i] - curve.input[i - 1]);
  return curve.output[i - 1] + share * (curve.output[i] - curve.output[i - 1]);
}

}  // namespace patina
