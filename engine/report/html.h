#pragma once

#include <string>
#include <string_view>

#include "engine/base/result.h"
#include "engine/image/image.h"

namespace patina::html {

/// Text that may stand between tags and inside attributes, whatever it holds: markup characters as entities,
/// broken UTF-8 and control characters as U+FFFD.
std::string escaped(std::string_view text);
/// RFC 4648.
std::string base64(std::string_view bytes);
/// "data:image/png;base64,..." of a display-encoded picture.
Result<std::string> pictureUri(const Image& displayEncoded);

}  // namespace patina::html
