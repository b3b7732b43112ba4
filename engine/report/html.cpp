#include "engine/report/html.h"

#include <cstdint>

#include "engine/image/png.h"

namespace patina::html {
namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";

/// Length and value of the well-formed UTF-8 character at `at`; length 0 where there is none.
std::size_t decode(std::string_view text, std::size_t at, std::uint32_t* value) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(at);
  std::size_t length = 1;
  std::uint32_t least = 0;
  *value = lead;
  if (lead >= 0x80) {
    if (lead >= 0xC2 && lead < 0xE0)
      length = 2, least = 0x80, *value = lead & 0x1F;
    else if (lead >= 0xE0 && lead < 0xF0)
      length = 3, least = 0x800, *value = lead & 0x0F;
    else if (lead >= 0xF0 && lead < 0xF5)
      length = 4, least = 0x10000, *value = lead & 0x07;
    else
      return 0;
  }
  if (at + length > text.size()) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(at + i) & 0xC0) != 0x80) return 0;
    *value = (*value << 6) | (byte(at + i) & 0x3F);
  }
  return *value >= least && *value <= 0x10FFFF ? length : 0;
}

/// What a page may hold: neither controls nor halves of pairs, nor what turns the direction of the text that
/// follows it.
bool mayStand(std::uint32_t c) {
  if (c == '\t' || c == '\n') return true;
  if (c < 0x20 || (c >= 0x7F && c < 0xA0)) return false;
  if (c >= 0xD800 && c <= 0xDFFF) return false;
  if ((c >= 0x202A && c <= 0x202E) || (c >= 0x2066 && c <= 0x2069)) return false;
  return (c & 0xFFFE) != 0xFFFE;
}

}  // namespace

std::string escaped(std::string_view text) {
  std::string safe;
  safe.reserve(text.size() + 16);
  for (std::size_t at = 0; at < text.size();) {
    std::uint32_t value = 0;
    const std::size_t length = decode(text, at, &value);
    if (length == 0 || !mayStand(value)) {
      safe += kReplacement;
      at += length > 0 ? length : 1;
      continue;
    }
    switch (value) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      case '"':
        safe += "&quot;";
        break;
      case '\'':
        safe += "&#39;";
        break;
      default:
        safe += text.substr(at, length);
    }
    at += length;
  }
  return safe;
}

std::string base64(std::string_view bytes) {
  static constexpr char kAlphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t at = 0; at < bytes.size(); at += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - at);
    std::uint32_t group = 0;
    for (std::size_t i = 0; i < 3; ++i)
      group = (group << 8) | (i < count ? static_cast<unsigned char>(bytes[at + i]) : 0u);
    for (std::size_t i = 0; i < 4; ++i) text += i <= count ? kAlphabet[(group >> (18 - 6 * i)) & 63] : '=';
  }
  return text;
}

Result<std::string> pictureUri(const Image& displayEncoded) {
  auto bytes = encodePng(displayEncoded);
  if (!bytes) return bytes.error();
  return "data:image/png;base64," + base64(*bytes);
}

}  // namespace patina::html
