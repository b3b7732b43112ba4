#include "engine/capture/capture_parts.h"

#include <algorithm>
#include <cctype>
#include <cmath>

#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/capture/bundle_path.h"
#include "engine/capture/encoding.h"
#include "engine/image/exr.h"
#include "engine/image/image_size.h"
#include "engine/image/png.h"

namespace patina::capture_parts {
namespace {

namespace fs = std::filesystem;

constexpr double kLongestFocalPx = 1e7;
constexpr double kLargestDistortion = 1e4;
constexpr double kSkewTolerance = 1e-9;  // pixels
constexpr std::size_t kLongestName = 1000;

bool endsLikePng(const std::string& file) {
  std::string extension = std::filesystem::path(file).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension == ".png";
}

/// Applies `linear`, a function of a pixel value, channel by channel.
template <typename Function>
void decode(Image* image, Function&& linear) {
  for (std::size_t i = 0; i < image->samples().size(); ++i) {
    image->samples()[i] = static_cast<float>(linear(image->samples()[i], i % 3));
  }
}

}  // namespace

void noteUnread(const JsonObject& object, const std::string& prefix, std::vector<std::string>* ignored) {
  for (const std::string& key : object.unread()) {
    std::string name = prefix.empty() ? key : prefix + "." + key;
    if (std::find(ignored->begin(), ignored->end(), name) == ignored->end())
      ignored->push_back(std::move(name));
  }
}

void requireType(JsonObject& object, const std::string& wanted) {
  const std::string type = object.text("type");
  if (type != wanted) {
    object.fail(ErrorCode::Unsupported, "type", inQuotes(type) + " is not a type that this version knows",
                "use " + inQuotes(wanted));
  }
}

Eigen::Vector2d vector2(JsonObject& object, const std::string& name, double low, double high) {
  const std::vector<double> values = object.numbers(name, 2, low, high);
  return {values[0], values[1]};
}

Eigen::Vector3d vector3(JsonObject& object, const std::string& name, double low, double high) {
  const std::vector<double> values = object.numbers(name, 3, low, high);
  return {values[0], values[1], values[2]};
}

std::string readHead(JsonObject& file) {
  const std::string format = file.text("format");
  if (format != "patina-capture") {
    file.fail(ErrorCode::Malformed, "format",
              "this is not a capture bundle: its format is " + inQuotes(format),
              "open a folder whose capture.json has the format 'patina-capture'");
  }
  const int version = file.integer("version", 0, 1 << 30);
  if (version != kVersion) {
    file.fail(ErrorCode::Unsupported, "version",
              "this bundle is of format version " + std::to_string(version) +
                  ", and this program reads version " + std::to_string(kVersion),
              version > kVersion ? "update Patina, or save the bundle as version 1"
                                 : "save the bundle as version 1");
  }
  return file.text("kind");
}

std::string readSampleName(JsonObject& sample) {
  std::string name = sample.text("name", "");
  if (name.size() > kLongestName) {
    sample.fail(ErrorCode::Invalid, "name", "the sample's name is longer than 1000 bytes", "shorten it");
  }
  return name;
}

Camera readCamera(JsonObject& object) {
  Camera camera;
  camera.width = object.integer("width", 1, kMaxImageSide);
  camera.height = object.integer("height", 1, kMaxImageSide);
  if (std::int64_t{camera.width} * camera.height > kMaxImagePixels) {
    object.fail(ErrorCode::Invalid, "width",
                "photographs of more than 2^28 pixels are too large for this program",
                "scale the photographs down, and K with them");
  }
  camera.intrinsics = object.matrix3("K", -kLongestFocalPx, kLongestFocalPx);
  const Eigen::Matrix3d& k = camera.intrinsics;
  if (!(k(0, 0) > 0 && k(1, 1) > 0)) {
    object.fail(ErrorCode::Invalid, "K", "the focal lengths K[0][0] and K[1][1] must be positive");
  }
  if (k(1, 0) != 0 || k(2, 0) != 0 || k(2, 1) != 0 || k(2, 2) != 1) {
    object.fail(ErrorCode::Invalid, "K", "K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]");
  }
  if (std::abs(k(0, 1)) > kSkewTolerance) {
    object.fail(ErrorCode::Unsupported, "K[0][1]", "pixels with skew are not supported",
                "calibrate the camera with K[0][1] = 0, as OpenCV does");
  }
  camera.intrinsics(0, 1) = 0;
  const std::vector<double> distortion =
      object.numbers("distortion", 5, -kLargestDistortion, kLargestDistortion);
  camera.distortion = Eigen::Map<const Eigen::Matrix<double, 5, 1>>(distortion.data());
  camera.cameraFromWorld = object.rotation("R");
  camera.translationMm = vector3(object, "t", -kFarthestMm, kFarthestMm);
  if (!(camera.positionMm().z() > 0)) {
    object.fail(ErrorCode::Invalid, "t",
                "this camera is not in front of the sample: its centre -R^T t has z <= 0",
                "check that R and t are camera-from-world, with the sample at z = 0 facing +z");
  }
  if (!(camera.translationMm.z() > 0)) {
    object.fail(ErrorCode::Invalid, "t", "this camera has the sample's centre behind it",
                "check that R and t are camera-from-world, with the camera looking along its +z");
  }
  return camera;
}

std::string readFileName(JsonObject& photo, const std::string& where) {
  std::string file = photo.text("file");
  Status allowed = checkBundlePath(file, where + ": " + photo.keyOf("file"));
  if (!allowed) throw JsonFault{allowed.error()};
  return file;
}

bool readHoldout(JsonObject& photo) {
  const std::string split = photo.text("split", "");
  if (split == "holdout") return true;
  if (!split.empty() && split != "fit") {
    photo.fail(ErrorCode::Malformed, "split", inQuotes(split) + " is not a split that this version knows",
               "use 'holdout' for a photograph that a fit must not read, or leave it out");
  }
  return false;
}

std::string readEncoding(JsonObject& photo, const std::string& where, const std::string& file) {
  const std::string text = photo.text("encoding", "");
  Result<PhotoEncoding> encoding = parseEncoding(text, where + ": " + photo.keyOf("encoding"));
  if (!encoding) throw JsonFault{encoding.error()};
  if (encoding->kind != PhotoEncoding::Kind::Linear) return text;
  if (endsLikePng(file)) {
    photo.fail(ErrorCode::Malformed, "encoding", "a PNG photograph needs its encoding, and none is given",
               "add 'encoding': 'srgb', 'gamma:2.2' or 'response:FILE.json'");
  }
  return "";
}

nlohmann::ordered_json jsonOf(const Eigen::Matrix3d& m) {
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  for (int row = 0; row < 3; ++row) rows.push_back({m(row, 0), m(row, 1), m(row, 2)});
  return rows;
}

nlohmann::ordered_json jsonOf(const Eigen::Vector2d& v) {
  return {v.x(), v.y()};
}
nlohmann::ordered_json jsonOf(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

nlohmann::ordered_json jsonOf(const Camera& camera) {
  return {{"width", camera.width},
          {"height", camera.height},
          {"K", jsonOf(camera.intrinsics)},
          {"distortion", std::vector<double>(camera.distortion.begin(), camera.distortion.end())},
          {"R", jsonOf(camera.cameraFromWorld)},
          {"t", jsonOf(camera.translationMm)}};
}

Result<fs::path> findDescription(const fs::path& named) {
  std::error_code code;
  const fs::file_status status = fs::status(named, code);
  if (status.type() == fs::file_type::not_found || status.type() == fs::file_type::none) {
    return Error{ErrorCode::NotFound, "there is no such bundle", named.string(),
                 "check the name, or whether the disk is connected"};
  }
  if (status.type() != fs::file_type::directory) {
    if (named.filename() == "capture.json") return named;
    return Error{ErrorCode::NotFound,
                 "this is not a capture bundle: a bundle is a folder that holds capture.json", named.string(),
                 "name the folder"};
  }
  if (fs::exists(named / "capture.json", code)) return named / "capture.json";
  std::string advice = "name the folder that holds capture.json";
  for (fs::directory_iterator it(named, code), end; !code && it != end; it.increment(code)) {
    std::error_code ignored;
    if (fs::exists(it->path() / "capture.json", ignored)) {
      advice = "the bundle inside it, " + it->path().string();
      break;
    }
  }
  return Error{ErrorCode::NotFound, "this folder is not a capture bundle: it holds no capture.json",
               named.string(), advice};
}

Status checkEncoding(const fs::path& folder, const std::string& text, const std::string& where) {
  Result<PhotoEncoding> encoding = parseEncoding(text, where);
  if (!encoding) return encoding.error();
  if (encoding->kind != PhotoEncoding::Kind::Response) return Done{};
  Result<fs::path> response = resolveInBundle(folder, encoding->responseFile, where);
  if (!response) return response.error();
  auto curves = readResponse(*response);
  if (!curves) return curves.error();
  return Done{};
}

Result<Image> readLinear(const fs::path& folder, const std::string& photo, const std::string& encodingText,
                         const Camera& camera, double scale) {
  return readLinear(folder, photo, encodingText, ImageSize{camera.width, camera.height}, scale);
}

Result<Image> readLinear(const fs::path& folder, const std::string& photo, const std::string& encodingText,
                         std::optional<ImageSize> size, double scale) {
  const std::string where = (folder / photo).string();
  Result<PhotoEncoding> encoding = parseEncoding(encodingText, where);
  if (!encoding) return encoding.error();
  Result<fs::path> file = resolveInBundle(folder, photo, where);
  if (!file) return file.error();
  Result<std::string> bytes = readFile(*file, kMaxImageFileBytes);
  if (!bytes) return bytes.error();

  const bool linear = encoding->kind == PhotoEncoding::Kind::Linear;
  Result<Image> image =
      linear ? readExrBytes(*bytes, where, {"R", "G", "B"}, size) : readPngBytes(*bytes, where, size);
  if (!image) return image;

  switch (encoding->kind) {
    case PhotoEncoding::Kind::Linear:
      break;
    case PhotoEncoding::Kind::Srgb:
      decode(&*image, [](float value, std::size_t) { return linearFromSrgbPixel(value); });
      break;
    case PhotoEncoding::Kind::Gamma:
      decode(&*image, [&](float value, std::size_t) { return std::pow(double{value}, encoding->gamma); });
      break;
    case PhotoEncoding::Kind::Response: {
      Result<fs::path> responseFile = resolveInBundle(folder, encoding->responseFile, where);
      if (!responseFile) return responseFile.error();
      auto curves = readResponse(*responseFile);
      if (!curves) return curves.error();
      decode(&*image, [&](float value, std::size_t c) { return linearFromResponse((*curves)[c], value); });
      break;
    }
  }
  if (scale != 1.0) {
    decode(&*image, [&](float value, std::size_t) { return value * scale; });
  }
  Status finite = requireFinite(*image, where);
  if (!finite) return finite.error();
  return image;
}

}  // namespace patina::capture_parts
