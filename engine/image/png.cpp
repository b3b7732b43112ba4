#include "engine/image/png.h"

#include <png.h>

#include <array>
#include <bit>
#include <cmath>
#include <csetjmp>
#include <cstring>
#include <stdexcept>
#include <vector>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/base/text.h"

namespace patina {
namespace {

/// What libpng's callbacks share with us. libpng jumps over stack frames when something is wrong; nothing
/// that needs a destructor may therefore live in a function that calls setjmp.
struct Source {
  const unsigned char* bytes = nullptr;    ///< in memory,
  const RandomAccessFile* file = nullptr;  ///< or on disk
  std::uint64_t size = 0, at = 0;
  char message[160] = "";
};

struct Shape {
  png_uint_32 width = 0, height = 0;
  int bitDepth = 0;
};

void readBytes(png_structp png, png_bytep target, png_size_t count) {
  auto* source = static_cast<Source*>(png_get_io_ptr(png));
  if (count > source->size - source->at) png_error(png, "the file ends too early");
  if (source->bytes) {
    std::memcpy(target, source->bytes + source->at, count);
  } else if (!source->file->read(source->at, reinterpret_cast<char*>(target), count)) {
    png_error(png, "the file ends too early");
  }
  source->at += count;
}

void onError(png_structp png, png_const_charp message) {
  auto* source = static_cast<Source*>(png_get_error_ptr(png));
  std::strncpy(source->message, message, sizeof source->message - 1);
  png_longjmp(png, 1);
}

void onWarning(png_structp, png_const_charp) {}  // e.g. a colour profile that we don't use anyway

bool readShape(png_structp png, png_infop info, Shape* shape) {
  if (setjmp(png_jmpbuf(png))) return false;
  png_read_info(png, info);
  shape->width = png_get_image_width(png, info);
  shape->height = png_get_image_height(png, info);
  return true;
}

/// Asks for R, G, B of 8 or 16 bits (in the machine's order), without gamma or opacity.
bool chooseFormat(png_structp png, png_infop info, Shape* shape) {
  if (setjmp(png_jmpbuf(png))) return false;
  const int colour = png_get_color_type(png, info);
  if (colour == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png);
  if ((colour & PNG_COLOR_MASK_COLOR) == 0) {
    if (png_get_bit_depth(png, info) < 8) png_set_expand_gray_1_2_4_to_8(png);
    png_set_gray_to_rgb(png);
  }
  png_set_strip_alpha(png);
  if constexpr (std::endian::native == std::endian::little) {
    if (png_get_bit_depth(png, info) == 16) png_set_swap(png);
  }
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  shape->bitDepth = png_get_bit_depth(png, info);
  const std::size_t sampleBytes = shape->bitDepth == 16 ? 2 : 1;
  if (png_get_channels(png, info) != 3 || png_get_rowbytes(png, info) != shape->width * sampleBytes * 3) {
    png_error(png, "an unusual pixel format");
  }
  return true;
}

bool readRows(png_structp png, png_bytepp rows) {
  if (setjmp(png_jmpbuf(png))) return false;
  png_read_image(png, rows);
  png_read_end(png, nullptr);
  return true;
}

bool readSomeRows(png_structp png, png_bytep first, std::size_t rowBytes, std::size_t count) {
  if (setjmp(png_jmpbuf(png))) return false;
  for (std::size_t y = 0; y < count; ++y) png_read_row(png, first + y * rowBytes, nullptr);
  return true;
}

bool readEnd(png_structp png) {
  if (setjmp(png_jmpbuf(png))) return false;
  png_read_end(png, nullptr);
  return true;
}

Error damaged(const Source& source, const std::string& where) {
  return {ErrorCode::Malformed, "the PNG image is truncated or damaged: " + inQuotes(source.message), where,
          "save or copy the image again"};
}

/// Owns libpng's two structures.
struct Reader {
  png_structp png = nullptr;
  png_infop info = nullptr;
  explicit Reader(Source* source) {
    png = png_create_read_struct(PNG_LIBPNG_VER_STRING, source, onError, onWarning);
    if (png) info = png_create_info_struct(png);
    if (info) png_set_read_fn(png, source, readBytes);
  }
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
};

Result<Image> decode(std::string_view bytes, const std::string& where, std::optional<ImageSize> expected) {
  Source source{reinterpret_cast<const unsigned char*>(bytes.data()), nullptr, bytes.size(), 0, ""};
  Reader reader(&source);
  if (!reader.info) throw std::bad_alloc();
  png_set_user_limits(reader.png, kMaxImageSide, kMaxImageSide);

  Shape shape;
  if (!readShape(reader.png, reader.info, &shape)) return damaged(source, where);
  const ImageSize size{static_cast<int>(shape.width), static_cast<int>(shape.height)};
  if (std::int64_t{size.width} * size.height > kMaxImagePixels) {
    return Error{ErrorCode::Malformed,
                 "an image of " + std::to_string(size.width) + " x " + std::to_string(size.height) +
                     " pixels is more than this program reads",
                 where, "use a smaller image"};
  }
  if (expected && size != *expected) return wrongSize(size, *expected, where);
  if (!chooseFormat(reader.png, reader.info, &shape)) return damaged(source, where);

  const bool wide = shape.bitDepth == 16;
  const std::size_t rowBytes = std::size_t{shape.width} * 3 * (wide ? 2 : 1);
  std::vector<unsigned char> pixels(rowBytes * shape.height);
  std::vector<png_bytep> rows(shape.height);
  for (std::size_t y = 0; y < rows.size(); ++y) rows[y] = pixels.data() + y * rowBytes;
  if (!readRows(reader.png, rows.data())) return damaged(source, where);

  Image image(size.width, size.height, 3);
  const std::span<float> samples = image.samples();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (wide) {
      std::uint16_t value;
      std::memcpy(&value, pixels.data() + 2 * i, 2);
      samples[i] = static_cast<float>(value) / 65535.0f;
    } else {
      samples[i] = static_cast<float>(pixels[i]) / 255.0f;
    }
  }
  return image;
}

}  // namespace

Result<Image> readPngBytes(std::string_view bytes, const std::string& where,
                           std::optional<ImageSize> expected) {
  if (bytes.empty())
    return Error{ErrorCode::Malformed, "the file is empty", where, "save or copy the image again"};
  if (!bytes.starts_with("\x89PNG\r\n\x1a\n")) {
    return Error{ErrorCode::Malformed, "this is not a PNG image", where,
                 "save it as PNG, or leave 'encoding' out if it is a linear OpenEXR image"};
  }
  try {
    return decode(bytes, where, expected);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::Malformed, "there is not enough memory for this image", where,
                 "close other programs, or use a smaller image"};
  }
}

Result<Image> readPng(const std::filesystem::path& file, std::optional<ImageSize> expected) {
  Result<std::string> bytes = readFile(file, kMaxImageFileBytes);
  if (!bytes) return bytes.error();
  return readPngBytes(*bytes, file.string(), expected);
}

struct PngRows::State {
  std::filesystem::path file;
  std::string where;
  ImageSize size;
  Source source;
  Shape shape;
  std::unique_ptr<Reader> reader;
  int row = 0;
  bool interlaced = false;
  std::vector<unsigned char> rows;  ///< of one call; the whole picture where it is interlaced

  std::size_t rowBytes() const { return static_cast<std::size_t>(size.width) * 3 * (wide() ? 2 : 1); }
  bool wide() const { return shape.bitDepth == 16; }
};

PngRows::PngRows(std::unique_ptr<State> state) : state_(std::move(state)) {}
PngRows::PngRows(PngRows&&) noexcept = default;
PngRows& PngRows::operator=(PngRows&&) noexcept = default;
PngRows::~PngRows() = default;

Result<PngRows> PngRows::open(const std::filesystem::path& path, const std::string& where,
                              ImageSize expected) {
  const Result<RandomAccessFile> file = RandomAccessFile::open(path, kMaxImageFileBytes);
  if (!file) return file.error();
  if (file->size() == 0)
    return Error{ErrorCode::Malformed, "the file is empty", where, "save or copy the image again"};
  constexpr std::string_view kSignature = "\x89PNG\r\n\x1a\n";
  std::array<char, kSignature.size()> first{};
  if (!file->read(0, first.data(), first.size()) ||
      std::string_view(first.data(), first.size()) != kSignature) {
    return Error{ErrorCode::Malformed, "this is not a PNG image", where,
                 "save it as PNG, or leave 'encoding' out if it is a linear OpenEXR image"};
  }
  auto state = std::make_unique<State>();
  state->file = path;
  state->where = where;
  state->size = expected;
  Source& source = state->source;
  source.file = &*file;
  source.size = file->size();
  state->reader = std::make_unique<Reader>(&source);
  Reader& reader = *state->reader;
  if (!reader.info) throw std::bad_alloc();
  png_set_user_limits(reader.png, kMaxImageSide, kMaxImageSide);
  if (!readShape(reader.png, reader.info, &state->shape)) return damaged(source, where);
  const ImageSize size{static_cast<int>(state->shape.width), static_cast<int>(state->shape.height)};
  if (size != expected) return wrongSize(size, expected, where);
  state->interlaced = png_get_interlace_type(reader.png, reader.info) != PNG_INTERLACE_NONE;
  if (!chooseFormat(reader.png, reader.info, &state->shape)) return damaged(source, where);
  source.file = nullptr;
  return PngRows(std::move(state));
}

Status PngRows::next(std::span<std::uint16_t> out) {
  State& s = *state_;
  const std::size_t rowSamples = static_cast<std::size_t>(s.size.width) * 3;
  const std::size_t count = out.size() / rowSamples, rowBytes = s.rowBytes();
  if (out.size() % rowSamples != 0 || count > static_cast<std::size_t>(s.size.height - s.row)) {
    throw std::invalid_argument("PngRows: whole rows of the picture");
  }
  const Result<RandomAccessFile> file = RandomAccessFile::open(s.file, kMaxImageFileBytes);
  if (!file) return file.error();
  s.source.file = &*file;
  s.source.size = file->size();
  const unsigned char* from = nullptr;
  if (s.interlaced) {
    if (s.rows.empty()) {
      s.rows.resize(rowBytes * static_cast<std::size_t>(s.size.height));
      std::vector<png_bytep> rows(static_cast<std::size_t>(s.size.height));
      for (std::size_t y = 0; y < rows.size(); ++y) rows[y] = s.rows.data() + y * rowBytes;
      if (!readRows(s.reader->png, rows.data())) return damaged(s.source, s.where);
    }
    from = s.rows.data() + static_cast<std::size_t>(s.row) * rowBytes;
  } else {
    s.rows.resize(rowBytes * count);
    if (!readSomeRows(s.reader->png, s.rows.data(), rowBytes, count)) return damaged(s.source, s.where);
    from = s.rows.data();
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (s.wide()) {
      std::memcpy(&out[i], from + 2 * i, 2);
    } else {
      out[i] = static_cast<std::uint16_t>(from[i] * 257);
    }
  }
  s.row += static_cast<int>(count);
  if (!s.interlaced && s.row == s.size.height && !readEnd(s.reader->png)) return damaged(s.source, s.where);
  if (!s.interlaced || s.row == s.size.height) std::vector<unsigned char>().swap(s.rows);
  s.source.file = nullptr;
  return Done{};
}

Result<std::string> encodePng(const Image& displayEncoded) {
  if (displayEncoded.empty() || (displayEncoded.channels() != 1 && displayEncoded.channels() != 3)) {
    throw std::invalid_argument("encodePng: a picture of one or three channels");
  }
  std::vector<unsigned char> pixels(displayEncoded.samples().size());
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const float value = displayEncoded.samples()[i];
    const float clamped = value > 0.0f ? std::min(value, 1.0f) : 0.0f;  // a NaN compares false and becomes 0
    pixels[i] = static_cast<unsigned char>(std::lround(clamped * 255.0f));
  }
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(displayEncoded.width());
  image.height = static_cast<png_uint_32>(displayEncoded.height());
  image.format = displayEncoded.channels() == 3 ? PNG_FORMAT_RGB : PNG_FORMAT_GRAY;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::string bytes(size, '\0');
  const bool written =
      png_image_write_to_memory(&image, bytes.data(), &size, 0, pixels.data(), 0, nullptr) != 0;
  const std::string message = image.message;
  png_image_free(&image);
  if (!written) {
    return Error{ErrorCode::WriteFailed, "the image can't be made: " + inQuotes(message), "",
                 "free some memory"};
  }
  bytes.resize(size);
  return bytes;
}

Status writePng(const std::filesystem::path& file, const Image& displayEncoded) {
  auto bytes = encodePng(displayEncoded);
  if (!bytes) {
    Error error = bytes.error();
    error.where = file.string();
    return error;
  }
  return writeFileAtomically(file, *bytes);
}

}  // namespace patina
