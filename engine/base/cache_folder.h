#pragma once

#include <filesystem>

namespace patina {

/// Where things are kept that can be made again: $PATINA_CACHE, else $XDG_CACHE_HOME/patina, else
/// ~/.cache/patina; empty where none of them is set. Not made here.
std::filesystem::path cacheFolder();

}  // namespace patina
