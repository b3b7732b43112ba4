// Photographs of all kinds as frames.
#include <libraw/libraw.h>
#include <tiffio.h>

#include <algorithm>
#include <cctype>
#include <cstring>
#include <memory>

#include "devices/watched_folder/watched_folder.h"
#include "engine/base/file.h"
#include "engine/image/exr.h"
#include "engine/image/jpeg.h"
#include "engine/image/png.h"

namespace patina {
namespace fs = std::filesystem;
namespace {

enum class FileKind { None, Raw, Tiff, Png, Exr, Jpeg };

FileKind kindOf(const fs::path& file) {
  std::string ending = file.extension().string();
  std::ranges::transform(ending, ending.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (ending == ".exr") return FileKind::Exr;
  if (ending == ".png") return FileKind::Png;
  if (ending == ".tif" || ending == ".tiff") return FileKind::Tiff;
  if (ending == ".jpg" || ending == ".jpeg") return FileKind::Jpeg;
  for (const char* raw : {".cr2", ".cr3", ".nef", ".arw", ".dng", ".raf", ".rw2", ".orf", ".pef", ".srw",
                          ".3fr", ".iiq", ".raw"})
    if (ending == raw) return FileKind::Raw;
  return FileKind::None;
}

Error malformed(const std::string& what, const fs::path& file) {
  return Error{ErrorCode::Malformed, what, file.string(), "take or copy the photograph again"};
}

Frame linearFrame(Image image, const char* name) {
  Frame frame;
  frame.format.layout = PixelLayout::Linear;
  frame.format.size = {image.width(), image.height()};
  frame.format.name = name;
  frame.linear = std::move(image);
  return frame;
}

Frame encodedFrame(std::vector<std::uint8_t> rgb, ImageSize size, const char* name) {
  Frame frame;
  frame.format.layout = PixelLayout::Rgb8;
  frame.format.size = size;
  frame.format.name = name;
  frame.bytes = std::move(rgb);
  return frame;
}

// ---- RAW ----

Result<Frame> readRaw(const fs::path& file) {
  const auto reader = std::make_unique<LibRaw>();  // some 100 kB: not for the stack
  if (const int code = reader->open_file(file.c_str()); code != LIBRAW_SUCCESS)
    return malformed(std::string("this RAW photograph can't be opened: ") + libraw_strerror(code), file);
  if (const int code = reader->unpack(); code != LIBRAW_SUCCESS)
    return malformed(std::string("this RAW photograph can't be read: ") + libraw_strerror(code), file);
  const libraw_data_t& data = reader->imgdata;
  const bool bayer = data.idata.filters > 1000 && data.idata.colors == 3 && data.rawdata.raw_image;
  if (!bayer)
    return Error{ErrorCode::Unsupported, "this camera's sensor has no Bayer pattern", file.string(),
                 "convert its photographs to linear TIFF of 16 bits, and use those"};
  const libraw_image_sizes_t& sizes = data.sizes;
  const int width = sizes.width, height = sizes.height;
  if (width < 2 || height < 2 || sizes.left_margin + width > sizes.raw_width ||
      sizes.top_margin + height > sizes.raw_height)
    return malformed("this RAW photograph's size makes no sense", file);
  const auto& colour = data.color;
  // Black levels differ by colour and by place in a small pattern; what they differ by is taken off here.
  const auto blackAt = [&](int row, int column) {
    int level = static_cast<int>(colour.black) + static_cast<int>(colour.cblack[reader->COLOR(row, column)]);
    const unsigned rows = colour.cblack[4], columns = colour.cblack[5];
    if (rows > 0 && columns > 0 && rows * columns + 6 <= LIBRAW_CBLACK_SIZE)
      level += static_cast<int>(colour.cblack[6 + static_cast<unsigned>(row) % rows * columns +
                                              static_cast<unsigned>(column) % columns]);
    return level;
  };
  int least = blackAt(0, 0);
  for (int row = 0; row < 2; ++row)
    for (int column = 0; column < 2; ++column) least = std::min(least, blackAt(row, column));
  Frame frame;
  frame.format.layout = PixelLayout::Bayer16;
  frame.format.size = {width, height};
  frame.format.name = std::string("RAW of ") + data.idata.make + " " + data.idata.model;
  // COLOR counts R 0, G 1, B 2 and the second green 3.
  const auto channel = [&](int row, int column) {
    const int index = reader->COLOR(row, column);
    return index == 3 ? 1 : index;
  };
  const int first = channel(0, 0), second = channel(0, 1);
  frame.format.bayer = first == 0    ? BayerOrder::Rggb
                       : first == 2  ? BayerOrder::Bggr
                       : second == 0 ? BayerOrder::Grbg
                                     : BayerOrder::Gbrg;
  frame.bytes.resize(static_cast<std::size_t>(width) * height * 2);
  const std::size_t pitch = sizes.raw_pitch > 0 ? sizes.raw_pitch / 2 : sizes.raw_width;
  for (int y = 0; y < height; ++y) {
    const unsigned short* row =
        data.rawdata.raw_image + static_cast<std::size_t>(y + sizes.top_margin) * pitch + sizes.left_margin;
    for (int x = 0; x < width; ++x) {
      const int value = std::clamp(row[x] - (blackAt(y, x) - least), 0, 65535);
      std::uint8_t* to = frame.bytes.data() + 2 * (static_cast<std::size_t>(y) * width + x);
      to[0] = static_cast<std::uint8_t>(value & 255);
      to[1] = static_cast<std::uint8_t>(value >> 8);
    }
  }
  frame.black = least / 65535.0;
  frame.white = colour.maximum > static_cast<unsigned>(least) ? colour.maximum / 65535.0 : 1.0;
  if (data.other.shutter > 0) frame.metadata.exposureS = data.other.shutter;
  if (data.other.iso_speed > 0) frame.metadata.gain = data.other.iso_speed / 100;
  return frame;
}

// ---- TIFF ----

void silent(const char*, const char*, va_list) {}

Result<Frame> readTiff(const fs::path& file) {
  TIFFSetErrorHandler(silent);
  TIFFSetWarningHandler(silent);
  const std::unique_ptr<TIFF, void (*)(TIFF*)> tiff(TIFFOpen(file.c_str(), "r"), [](TIFF* open) {
    if (open) TIFFClose(open);
  });
  if (!tiff) return malformed("this TIFF can't be opened", file);
  std::uint32_t width = 0, height = 0;
  std::uint16_t bits = 1, channels = 1, planar = PLANARCONFIG_CONTIG, format = SAMPLEFORMAT_UINT,
                photometric = PHOTOMETRIC_MINISBLACK;
  TIFFGetField(tiff.get(), TIFFTAG_IMAGEWIDTH, &width);
  TIFFGetField(tiff.get(), TIFFTAG_IMAGELENGTH, &height);
  TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_BITSPERSAMPLE, &bits);
  TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_SAMPLESPERPIXEL, &channels);
  TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_PLANARCONFIG, &planar);
  TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_SAMPLEFORMAT, &format);
  TIFFGetField(tiff.get(), TIFFTAG_PHOTOMETRIC, &photometric);
  const bool isFloat = format == SAMPLEFORMAT_IEEEFP && bits == 32;
  const bool known = (isFloat || (format == SAMPLEFORMAT_UINT && (bits == 8 || bits == 16))) &&
                     (channels == 1 || channels == 3 || channels == 4) && planar == PLANARCONFIG_CONTIG &&
                     !TIFFIsTiled(tiff.get()) &&
                     (photometric == PHOTOMETRIC_RGB || photometric == PHOTOMETRIC_MINISBLACK);
  if (!known)
    return Error{ErrorCode::Unsupported, "this kind of TIFF is not read", file.string(),
                 "save it as RGB or grey of 8, 16 or 32 bits (float), in strips"};
  if (width == 0 || height == 0 || width > kMaxImageSide || height > kMaxImageSide ||
      std::int64_t{width} * height > kMaxImagePixels)
    return malformed("this TIFF's size makes no sense", file);
  const auto rowBytes = static_cast<std::size_t>(TIFFScanlineSize(tiff.get()));
  const std::size_t sampleBytes = bits / 8;
  if (rowBytes < sampleBytes * channels * width) return malformed("this TIFF's rows are too short", file);
  std::vector<std::uint8_t> row(rowBytes);
  Image image(static_cast<int>(width), static_cast<int>(height), 3);
  for (std::uint32_t y = 0; y < height; ++y) {
    if (TIFFReadScanline(tiff.get(), row.data(), y) < 0) return malformed("this TIFF is cut off", file);
    for (std::uint32_t x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) {
        const std::size_t at =
            (static_cast<std::size_t>(x) * channels + (channels >= 3 ? static_cast<std::size_t>(c) : 0)) *
            sampleBytes;
        float value = 0;
        if (isFloat) {
          std::memcpy(&value, row.data() + at, sizeof value);
        } else if (bits == 16) {
          std::uint16_t code = 0;
          std::memcpy(&code, row.data() + at, sizeof code);
          value = static_cast<float>(code) / 65535.0f;
        } else {
          value = row[at];
        }
        image.at(static_cast<int>(x), static_cast<int>(y), c) = value;
      }
  }
  if (bits > 8) {
    if (Status finite = requireFinite(image, file.string()); !finite) return finite.error();
    return linearFrame(std::move(image), "TIFF");
  }
  std::vector<std::uint8_t> rgb(image.samples().size());
  std::ranges::transform(image.samples(), rgb.begin(),
                         [](float value) { return static_cast<std::uint8_t>(value); });
  return encodedFrame(std::move(rgb), {static_cast<int>(width), static_cast<int>(height)}, "TIFF");
}

// ---- the others ----

Result<Frame> readPngFrame(const fs::path& file) {
  const Result<std::string> bytes = readFile(file, kMaxImageFileBytes);
  if (!bytes) return bytes.error();
  Result<Image> image = readPngBytes(*bytes, file.string());
  if (!image) return image.error();
  constexpr std::size_t kDepthAt = 24;  // of the header: signature, chunk's head, width, height
  if (bytes->size() > kDepthAt && (*bytes)[kDepthAt] == 16)
    return linearFrame(std::move(*image), "PNG, 16 bits");
  std::vector<std::uint8_t> rgb(image->samples().size());
  std::ranges::transform(image->samples(), rgb.begin(),
                         [](float value) { return static_cast<std::uint8_t>(value * 255.0f + 0.5f); });
  return encodedFrame(std::move(rgb), {image->width(), image->height()}, "PNG, 8 bits");
}

Result<Frame> readExrFrame(const fs::path& file) {
  Result<Image> image = readExr(file, {"R", "G", "B"});
  if (!image) return image.error();
  if (Status finite = requireFinite(*image, file.string()); !finite) return finite.error();
  return linearFrame(std::move(*image), "OpenEXR");
}

Result<Frame> readJpegFrame(const fs::path& file) {
  const Result<std::string> bytes = readFile(file, kMaxImageFileBytes);
  if (!bytes) return bytes.error();
  Result<JpegPixels> pixels = decodeJpeg(*bytes, file.string());
  if (!pixels) return pixels.error();
  return encodedFrame(std::move(pixels->rgb), pixels->size, "JPEG");
}

}  // namespace

bool isPhotograph(const fs::path& file) {
  return kindOf(file) != FileKind::None;
}

Result<Frame> readPhotograph(const fs::path& file) {
  std::error_code code;
  if (!fs::is_regular_file(file, code))
    return Error{ErrorCode::NotFound, "there is no such photograph", file.string(), "check the name"};
  switch (kindOf(file)) {
    case FileKind::Raw:
      return readRaw(file);
    case FileKind::Tiff:
      return readTiff(file);
    case FileKind::Png:
      return readPngFrame(file);
    case FileKind::Exr:
      return readExrFrame(file);
    case FileKind::Jpeg:
      return readJpegFrame(file);
    case FileKind::None:
      break;
  }
  return Error{ErrorCode::Unsupported, "this is no kind of photograph that Patina reads", file.string(),
               "RAW of the usual makers, TIFF, PNG, OpenEXR and JPEG are read"};
}

}  // namespace patina
