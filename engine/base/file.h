#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "engine/base/result.h"

namespace patina {

/// The whole content of a regular file. Errors: NotFound (nothing there, or a folder), Malformed (over
/// `maxBytes`), Refused (a device or pipe, which might never end, or no permission). Threading: any. Cost:
/// one read.
Result<std::string> readFile(const std::filesystem::path& file, std::uint64_t maxBytes);

}  // namespace patina
