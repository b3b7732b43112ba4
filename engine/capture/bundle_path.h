#pragma once

#include <filesystem>
#include <string>

#include "engine/base/result.h"

namespace patina {

/// Whether a path written in a bundle may be one: relative, without "..", without control characters. Looks
/// at no file. Errors: Malformed (empty, control characters), Refused (absolute, leaves the folder); `where`
/// names the key.
Status checkBundlePath(const std::string& relative, const std::string& where);

/// The real place of a file of a bundle, symbolic links followed. Errors: those of `checkBundlePath`;
/// NotFound; Refused where a link leads out of the folder or where it is not a plain file.
Result<std::filesystem::path> resolveInBundle(const std::filesystem::path& folder,
                                              const std::string& relative, const std::string& where);

}  // namespace patina
