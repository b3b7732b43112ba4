#include "engine/capture/capture.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/capture/bundle_path.h"
#include "engine/capture/capture_json.h"
#include "engine/capture/encoding.h"
#include "engine/image/exr.h"
#include "engine/image/png.h"

namespace patina {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t kLargestDescription = 64u << 20;  // bytes; 100000 photos take some 15 MB

/// Where capture.json is, for a folder or for the file itself.
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

/// Files that exist, and responses that can be understood.
Status checkFiles(const FourierCapture& capture, const std::string& where, const JobContext& job) {
  std::map<std::string, bool> responses;
  std::map<fs::path, std::size_t> files;
  for (std::size_t i = 0; i < capture.photos.size(); ++i) {
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "reading the bundle was cancelled", where, ""};
    const std::string photo = "photos[" + std::to_string(i) + "]";
    Result<fs::path> file =
        resolveInBundle(capture.folder, capture.photos[i].file, where + ": " + photo + ".file");
    if (!file) return file.error();
    const auto [other, isNew] = files.emplace(*file, i);
    if (!isNew) {
      job.warn("photos[" + std::to_string(other->second) + "] and " + photo + " name the same file, " +
               inQuotes(capture.photos[i].file));
    }
    Result<PhotoEncoding> encoding =
        parseEncoding(capture.photos[i].encoding, where + ": " + photo + ".encoding");
    if (!encoding) return encoding.error();
    if (encoding->kind != PhotoEncoding::Kind::Response ||
        !responses.emplace(encoding->responseFile, true).second) {
      continue;
    }
    Result<fs::path> response =
        resolveInBundle(capture.folder, encoding->responseFile, where + ": " + photo + ".encoding");
    if (!response) return response.error();
    auto curves = readResponse(*response);
    if (!curves) return curves.error();
  }
  return Done{};
}

/// Applies `linear`, a function of a pixel value, channel by channel.
template <typename Function>
void decode(Image* image, Function&& linear) {
  for (std::size_t i = 0; i < image->samples().size(); ++i) {
    image->samples()[i] = static_cast<float>(linear(image->samples()[i], i % 3));
  }
}

}  // namespace

Result<FourierCapture> readFourierCapture(const fs::path& folder, const JobContext& job) {
  Result<fs::path> description = findDescription(folder);
  if (!description) return description.error();
  Result<std::string> text = readFile(*description, kLargestDescription);
  if (!text) return text.error();
  const fs::path home = description->has_parent_path() ? description->parent_path() : fs::path(".");
  Result<FourierCapture> capture = parseFourierCapture(*text, home, description->string());
  if (!capture) return capture;
  Status files = checkFiles(*capture, description->string(), job);
  if (!files) return files.error();
  for (const std::string& key : capture->ignoredKeys) {
    job.info("The key " + inQuotes(key) + " in " + description->string() +
             " is not known to this version and was ignored.");
  }
  return capture;
}

Status writeFourierCapture(const FourierCapture& capture) {
  std::error_code code;
  fs::create_directories(capture.folder, code);
  if (code && !fs::is_directory(capture.folder)) {
    return Error{ErrorCode::WriteFailed, "the bundle's folder can't be made: " + code.message(),
                 capture.folder.string(), "choose another folder"};
  }
  return writeFileAtomically(capture.folder / "capture.json", fourierCaptureJson(capture));
}

Result<Image> readPhoto(const FourierCapture& capture, const FourierPhoto& photo) {
  const std::string where = (capture.folder / photo.file).string();
  Result<PhotoEncoding> encoding = parseEncoding(photo.encoding, where);
  if (!encoding) return encoding.error();
  Result<fs::path> file = resolveInBundle(capture.folder, photo.file, where);
  if (!file) return file.error();
  Result<std::string> bytes = readFile(*file, kMaxImageFileBytes);
  if (!bytes) return bytes.error();

  const ImageSize size{capture.camera.width, capture.camera.height};
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
      Result<fs::path> responseFile = resolveInBundle(capture.folder, encoding->responseFile, where);
      if (!responseFile) return responseFile.error();
      auto curves = readResponse(*responseFile);
      if (!curves) return curves.error();
      decode(&*image, [&](float value, std::size_t c) { return linearFromResponse((*curves)[c], value); });
      break;
    }
  }
  if (capture.radianceScale != 1.0) {
    decode(&*image, [&](float value, std::size_t) { return value * capture.radianceScale; });
  }
  Status finite = requireFinite(*image, where);
  if (!finite) return finite.error();
  return image;
}

}  // namespace patina
