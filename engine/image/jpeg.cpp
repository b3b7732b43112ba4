#include "engine/image/jpeg.h"

#include <csetjmp>
#include <cstdio>
// after <cstdio>, which it needs
#include <jpeglib.h>

#include "engine/base/file.h"

namespace patina {
namespace {

struct Failure {
  jpeg_error_mgr manager;
  std::jmp_buf back;
  char sentence[JMSG_LENGTH_MAX] = "";
  bool warned = false;
};

void leave(j_common_ptr info) {
  auto* failure = reinterpret_cast<Failure*>(info->err);
  info->err->format_message(info, failure->sentence);
  std::longjmp(failure->back, 1);
}

/// A warning of the library's is data that was missing or damaged: the picture is not what was taken.
void noteWarning(j_common_ptr info, int level) {
  auto* failure = reinterpret_cast<Failure*>(info->err);
  if (level >= 0 || failure->warned) return;
  info->err->format_message(info, failure->sentence);
  failure->warned = true;
}

void saySilently(j_common_ptr) {}

/// The library's part, with nothing on the stack that has a destructor: errors jump over it. 0: done; 1: the
/// library failed; 2: another size; 3: the pixels are too many.
int decode(Failure& failure, std::string_view bytes, const std::optional<ImageSize>& expected,
           JpegPixels& out) {
  jpeg_decompress_struct info;
  info.err = jpeg_std_error(&failure.manager);
  failure.manager.error_exit = leave;
  failure.manager.emit_message = noteWarning;
  failure.manager.output_message = saySilently;
  if (setjmp(failure.back)) {
    jpeg_destroy_decompress(&info);
    return 1;
  }
  jpeg_create_decompress(&info);
  jpeg_mem_src(&info, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
  jpeg_read_header(&info, TRUE);
  out.size = {static_cast<int>(info.image_width), static_cast<int>(info.image_height)};
  int outcome = 0;
  if (expected && *expected != out.size) {
    outcome = 2;
  } else if (std::int64_t{out.size.width} * out.size.height > kMaxImagePixels) {
    outcome = 3;
  }
  if (outcome != 0) {
    jpeg_destroy_decompress(&info);
    return outcome;
  }
  info.out_color_space = JCS_RGB;
  info.dct_method = JDCT_ISLOW;
  jpeg_start_decompress(&info);
  const std::size_t row = static_cast<std::size_t>(out.size.width) * 3;
  out.rgb.resize(row * static_cast<std::size_t>(out.size.height));
  while (info.output_scanline < info.output_height) {
    JSAMPROW to = out.rgb.data() + row * info.output_scanline;
    jpeg_read_scanlines(&info, &to, 1);
  }
  jpeg_finish_decompress(&info);
  jpeg_destroy_decompress(&info);
  return failure.warned ? 1 : 0;
}

}  // namespace

Result<JpegPixels> decodeJpeg(std::string_view bytes, const std::string& where,
                              std::optional<ImageSize> expected) {
  JpegPixels pixels;
  Failure failure;
  switch (decode(failure, bytes, expected, pixels)) {
    case 0:
      return pixels;
    case 2:
      return wrongSize(pixels.size, *expected, where);
    case 3:
      return Error{ErrorCode::Malformed, "the picture is absurdly large", where, "check the file"};
    default:
      return Error{ErrorCode::Malformed, std::string("this JPEG can't be read: ") + failure.sentence, where,
                   "take or copy the photograph again"};
  }
}

Result<Image> readJpeg(const std::filesystem::path& file, std::optional<ImageSize> expected) {
  const Result<std::string> bytes = readFile(file, kMaxImageFileBytes);
  if (!bytes) return bytes.error();
  const Result<JpegPixels> pixels = decodeJpeg(*bytes, file.string(), expected);
  if (!pixels) return pixels.error();
  Image image(pixels->size.width, pixels->size.height, 3);
  for (std::size_t i = 0; i < pixels->rgb.size(); ++i)
    image.samples()[i] = static_cast<float>(pixels->rgb[i]) / 255.0f;
  return image;
}

}  // namespace patina
