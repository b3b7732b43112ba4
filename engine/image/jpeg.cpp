#include "engine/image/jpeg.h"

#include <csetjmp>
#include <cstdint>
#include <cstdio>
#include <vector>
// jpeglib.h needs stdio before it.
#include <jpeglib.h>

#include "engine/base/file.h"
#include "engine/base/text.h"

namespace patina {
namespace {

/// libjpeg jumps over stack frames when something is wrong; nothing that needs a destructor may live in a
/// function that calls setjmp.
struct Reader {
  jpeg_decompress_struct info{};
  jpeg_error_mgr manager{};
  std::jmp_buf jump{};
  char message[JMSG_LENGTH_MAX] = "";
  bool made = false;
  ~Reader() {
    if (made) jpeg_destroy_decompress(&info);
  }
};

void onError(j_common_ptr info) {
  auto* reader = static_cast<Reader*>(info->client_data);
  info->err->format_message(info, reader->message);
  std::longjmp(reader->jump, 1);
}

/// Warnings too: "premature end of file" is one, and what follows would be grey.
void onMessage(j_common_ptr info, int level) {
  if (level < 0) onError(info);
}

bool readHeader(Reader* reader, std::string_view bytes) {
  reader->info.err = jpeg_std_error(&reader->manager);
  reader->manager.error_exit = onError;
  reader->manager.emit_message = onMessage;
  reader->info.client_data = reader;
  if (setjmp(reader->jump)) return false;
  jpeg_create_decompress(&reader->info);
  reader->made = true;
  jpeg_mem_src(&reader->info, reinterpret_cast<const unsigned char*>(bytes.data()),
               static_cast<unsigned long>(bytes.size()));
  jpeg_read_header(&reader->info, TRUE);
  return true;
}

bool start(Reader* reader) {
  if (setjmp(reader->jump)) return false;
  reader->info.out_color_space = JCS_RGB;
  jpeg_start_decompress(&reader->info);
  return true;
}

bool readRow(Reader* reader, unsigned char* row) {
  if (setjmp(reader->jump)) return false;
  JSAMPROW rows[1] = {row};
  return jpeg_read_scanlines(&reader->info, rows, 1) == 1;
}

Error damaged(const Reader& reader, const std::string& where) {
  return {ErrorCode::Malformed, "the JPEG image is truncated or damaged: " + inQuotes(reader.message), where,
          "save or copy the image again"};
}

}  // namespace

Result<JpegPixels> decodeJpeg(std::string_view bytes, const std::string& where,
                              std::optional<ImageSize> expected) {
  Reader reader;
  if (!readHeader(&reader, bytes)) return damaged(reader, where);
  const ImageSize size{static_cast<int>(reader.info.image_width), static_cast<int>(reader.info.image_height)};
  if (static_cast<std::int64_t>(size.width) * size.height > kMaxImagePixels)
    return Error{ErrorCode::Malformed,
                 "the JPEG image says it has " + std::to_string(size.width) + " x " +
                     std::to_string(size.height) + " pixels",
                 where, "check the file"};
  if (expected && size != *expected) return wrongSize(size, *expected, where);
  if (reader.info.jpeg_color_space == JCS_CMYK || reader.info.jpeg_color_space == JCS_YCCK)
    return Error{ErrorCode::Unsupported, "the JPEG image is in printing colours (CMYK)", where,
                 "save it as RGB"};
  if (!start(&reader)) return damaged(reader, where);
  if (reader.info.output_components != 3)
    return Error{ErrorCode::Unsupported, "the JPEG image is neither grey nor RGB", where, "save it as RGB"};
  JpegPixels pixels;
  pixels.size = size;
  const std::size_t row = static_cast<std::size_t>(size.width) * 3;
  pixels.rgb.resize(row * static_cast<std::size_t>(size.height));
  for (std::size_t y = 0; y < static_cast<std::size_t>(size.height); ++y)
    if (!readRow(&reader, pixels.rgb.data() + row * y)) return damaged(reader, where);
  return pixels;
}

Result<Image> readJpegBytes(std::string_view bytes, const std::string& where,
                            std::optional<ImageSize> expected) {
  const Result<JpegPixels> pixels = decodeJpeg(bytes, where, expected);
  if (!pixels) return pixels.error();
  Image image(pixels->size.width, pixels->size.height, 3);
  for (std::size_t i = 0; i < pixels->rgb.size(); ++i)
    image.samples()[i] = static_cast<float>(pixels->rgb[i]) / 255.0f;
  return image;
}

Result<Image> readJpeg(const std::filesystem::path& file, std::optional<ImageSize> expected) {
  const Result<std::string> bytes = readFile(file, kMaxImageFileBytes);
  if (!bytes) return bytes.error();
  return readJpegBytes(*bytes, file.string(), expected);
}

}  // namespace patina
