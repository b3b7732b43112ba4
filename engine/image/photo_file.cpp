#include "engine/image/photo_file.h"

#include <algorithm>
#include <array>
#include <string_view>

#include "engine/base/file.h"
#include "engine/image/exr.h"
#include "engine/image/jpeg.h"
#include "engine/image/png.h"

namespace patina {
namespace {

constexpr std::string_view kPng("\x89PNG\r\n\x1a\n", 8), kJpeg("\xff\xd8\xff", 3),
    kExr("\x76\x2f\x31\x01", 4);

/// The byte after the length of a PNG's first block, IHDR: bits a sample.
constexpr std::size_t kPngDepthAt = 24;

Result<Image> readExrPhoto(const std::filesystem::path& file) {
  const Result<std::vector<std::string>> channels = exrChannels(file);
  if (!channels) return channels.error();
  const auto has = [&](const char* name) {
    return std::find(channels->begin(), channels->end(), name) != channels->end();
  };
  if (has("R") || !has("Y")) return readExr(file, {"R", "G", "B"});
  return readExr(file, {"Y", "Y", "Y"});
}

}  // namespace

Result<PhotoFile> readPhotoFile(const std::filesystem::path& file) {
  const Result<RandomAccessFile> opened = RandomAccessFile::open(file, kMaxImageFileBytes);
  if (!opened) return opened.error();
  std::array<char, kPngDepthAt + 1> head{};
  opened->read(0, head.data(), std::min<std::uint64_t>(head.size(), opened->size()));
  const std::string_view start(head.data(), head.size());
  PhotoFile photo;
  Result<Image> image = Image();
  if (start.starts_with(kPng)) {
    image = readPng(file);
    photo.codes = head[kPngDepthAt] == 16 ? 65535 : 255;
  } else if (start.starts_with(kJpeg)) {
    image = readJpeg(file);
    photo.codes = 255;
  } else if (start.starts_with(kExr)) {
    image = readExrPhoto(file);
    photo.linear = true;
  } else {
    return Error{ErrorCode::Unsupported, "this is neither a PNG nor a JPEG nor an OpenEXR picture",
                 file.string(), "convert the photograph to 16-bit PNG or OpenEXR"};
  }
  if (!image) return image.error();
  if (const Status finite = requireFinite(*image, file.string()); !finite) return finite.error();
  photo.image = std::move(*image);
  return photo;
}

}  // namespace patina
