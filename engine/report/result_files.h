#pragma once

#include <filesystem>
#include <string>

namespace patina {

/// Where an added effect's map stands below the result's folder: "maps/anisotropy_ratio.exr". What doesn't
/// belong into a file's name is replaced.
std::filesystem::path effectMapFile(const std::string& stem);

}  // namespace patina
