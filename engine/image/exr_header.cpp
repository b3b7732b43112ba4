#include "engine/image/exr_header.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <map>

namespace patina {
namespace {

constexpr std::uint32_t kMagic = 20000630;
constexpr std::uint32_t kMultiPart = 0x1000, kDeep = 0x800;
constexpr std::int64_t kFarthestOrigin = 1 << 24;  // a data window further away would overflow offsets
constexpr std::int64_t kMostChannels = 4096;       // of one part
constexpr std::int64_t kMostTilePixels = 1 << 26;
constexpr std::int64_t kMostLinesAtOnce = 256;  // DWAB, the most that any compression keeps in memory
constexpr std::int64_t kMostBytesAtOnce = std::int64_t{4} << 30;
constexpr std::int64_t kOffsetBytes = 8;  // of each block's entry in the table of offsets

/// Thrown and caught in this file.
struct BadHeader {
  std::string what;
};

/// Little-endian values one after the other; reading past the end is a BadHeader.
class Cursor {
 public:
  explicit Cursor(std::string_view bytes) : bytes_(bytes) {}

  std::uint8_t byte() { return static_cast<std::uint8_t>(take(1)[0]); }
  std::uint32_t word() {
    const std::string_view four = take(4);
    std::uint32_t value = 0;
    for (std::size_t i = 4; i-- > 0;) value = value << 8 | static_cast<std::uint8_t>(four[i]);
    return value;
  }
  std::int64_t integer() { return static_cast<std::int32_t>(word()); }
  std::string_view text() {
    const std::size_t end = bytes_.find('\0', at_);
    if (end == std::string_view::npos) throw BadHeader{"a name has no end"};
    const std::string_view name = bytes_.substr(at_, end - at_);
    at_ = end + 1;
    return name;
  }
  std::string_view take(std::size_t count) {
    if (count > bytes_.size() - at_) throw BadHeader{"the header ends too early"};
    at_ += count;
    return bytes_.substr(at_ - count, count);
  }
  bool atEnd() const { return at_ == bytes_.size(); }

 private:
  std::string_view bytes_;
  std::size_t at_ = 0;
};

/// Lengths of the attribute types that always have the same one.
const std::map<std::string_view, std::size_t>& fixedLengths() {
  static const std::map<std::string_view, std::size_t> lengths = {
      {"box2i", 16},      {"box2f", 16},   {"chromaticities", 32},
      {"compression", 1}, {"double", 8},   {"envmap", 1},
      {"float", 4},       {"int", 4},      {"keycode", 28},
      {"lineOrder", 1},   {"m33f", 36},    {"m33d", 72},
      {"m44f", 64},       {"m44d", 128},   {"rational", 8},
      {"tiledesc", 9},    {"timecode", 8}, {"v2i", 8},
      {"v2f", 8},         {"v2d", 16},     {"v3i", 12},
      {"v3f", 12},        {"v3d", 24},     {"deepImageState", 1}};
  return lengths;
}

/// What is gathered of one part.
struct Part {
  std::int64_t width = 0, height = 0, channels = 0;
  std::int64_t tileWidth = 0, tileHeight = 0;
};

std::int64_t countChannels(std::string_view value) {
  Cursor list(value);
  std::int64_t count = 0;
  while (!list.text().empty()) {
    list.take(16);  // type, linearity, sampling
    ++count;
  }
  if (!list.atEnd()) throw BadHeader{"the list of channels has a wrong length"};
  if (count > kMostChannels) throw BadHeader{"there are more than 4096 channels"};
  return count;
}

void readDataWindow(std::string_view value, Part* part) {
  Cursor box(value);
  const std::int64_t left = box.integer(), top = box.integer(), right = box.integer(), bottom = box.integer();
  part->width = right - left + 1;
  part->height = bottom - top + 1;
  if (part->width < 1 || part->height < 1 || part->width > kMaxImageSide || part->height > kMaxImageSide ||
      part->width * part->height > kMaxImagePixels) {
    throw BadHeader{"an image of " + std::to_string(part->width) + " x " + std::to_string(part->height) +
                    " pixels is not what this program reads"};
  }
  if (std::abs(left) > kFarthestOrigin || std::abs(top) > kFarthestOrigin) {
    throw BadHeader{"the data window lies absurdly far from its origin"};
  }
}

void checkAttribute(std::string_view name, std::string_view type, std::string_view value,
                    std::size_t fileBytes, Part* part) {
  const auto fixed = fixedLengths().find(type);
  if (fixed != fixedLengths().end() && value.size() != fixed->second) {
    throw BadHeader{"an attribute has the wrong length for its type"};
  }
  Cursor cursor(value);
  if (type == "chlist") {
    const std::int64_t count = countChannels(value);
    if (name == "channels") part->channels = count;
  } else if (type == "box2i" && name == "dataWindow") {
    readDataWindow(value, part);
  } else if (type == "tiledesc" && name == "tiles") {
    part->tileWidth = cursor.integer();
    part->tileHeight = cursor.integer();
    if (part->tileWidth < 1 || part->tileHeight < 1 || part->tileWidth > kMaxImageSide ||
        part->tileHeight > kMaxImageSide || part->tileWidth * part->tileHeight > kMostTilePixels) {
      throw BadHeader{"the tiles have an absurd size"};
    }
  } else if (type == "int" && name == "chunkCount") {
    const std::int64_t count = cursor.integer();
    if (count < 0 || count * kOffsetBytes > static_cast<std::int64_t>(fileBytes)) {
      throw BadHeader{"there are more blocks than the file has room for"};
    }
  } else if (type == "stringvector") {
    while (!cursor.atEnd()) cursor.take(cursor.word());
  } else if (type == "preview") {
    const std::uint64_t width = cursor.word(), height = cursor.word();
    if (width > kMaxImageSide || height > kMaxImageSide || width * height * 4 + 8 != value.size()) {
      throw BadHeader{"the preview picture has a wrong length"};
    }
  } else if (type == "floatvector" && value.size() % 4 != 0) {
    throw BadHeader{"a list of numbers has a wrong length"};
  } else if (type == "idmanifest") {
    throw BadHeader{"the image holds a manifest of object identities, which this program doesn't read"};
  }
}

/// One part's header. False for the empty one that ends the list of a multi-part file.
bool readPart(Cursor& cursor, std::size_t fileBytes, Part* part) {
  std::string_view name = cursor.text();
  if (name.empty()) return false;
  while (!name.empty()) {
    const std::string_view type = cursor.text();
    const std::string_view value = cursor.take(cursor.word());
    checkAttribute(name, type, value, fileBytes, part);
    name = cursor.text();
  }
  if (part->width == 0) throw BadHeader{"the header has no data window"};
  if (part->tileWidth > 0) {
    const std::int64_t across = (part->width + part->tileWidth - 1) / part->tileWidth;
    const std::int64_t down = (part->height + part->tileHeight - 1) / part->tileHeight;
    if (across * down * kOffsetBytes > static_cast<std::int64_t>(fileBytes)) {
      throw BadHeader{"there are more tiles than the file has room for"};
    }
  }
  const std::int64_t lines = std::min(part->height, std::max(kMostLinesAtOnce, part->tileHeight));
  if (part->width * lines * part->channels * 4 > kMostBytesAtOnce) {
    throw BadHeader{"the image has too many channels for its size"};
  }
  return true;
}

}  // namespace

Result<ImageSize> checkExrHeader(std::string_view bytes, const std::string& where,
                                 std::optional<ImageSize> expected, std::optional<std::uint64_t> fileBytes) {
  const auto malformed = [&](const std::string& what) {
    return Error{ErrorCode::Malformed, what, where, "save or copy the image again"};
  };
  if (bytes.empty()) return malformed("the file is empty");
  try {
    Cursor cursor(bytes);
    if (bytes.size() < 8 || cursor.word() != kMagic) return malformed("this is not an OpenEXR image");
    const std::uint32_t version = cursor.word();
    if (version & kDeep) return malformed("this is a deep OpenEXR image, which this program doesn't read");
    Part first;
    const std::size_t size = fileBytes ? static_cast<std::size_t>(*fileBytes) : bytes.size();
    if (!readPart(cursor, size, &first)) throw BadHeader{"the header is empty"};
    if (version & kMultiPart) {
      Part other;
      while (readPart(cursor, size, &other)) other = Part();
    }
    const ImageSize found{static_cast<int>(first.width), static_cast<int>(first.height)};
    if (expected && found != *expected) return wrongSize(found, *expected, where);
    return found;
  } catch (const BadHeader& bad) {
    return malformed("the OpenEXR image is truncated or damaged: " + bad.what);
  }
}

}  // namespace patina
