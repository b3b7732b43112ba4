#include "engine/base/cache_folder.h"

#include <cstdlib>

namespace patina {

std::filesystem::path cacheFolder() {
  namespace fs = std::filesystem;
  const auto fromEnvironment = [](const char* name) -> fs::path {
    const char* value = std::getenv(name);
    return value && *value ? fs::path(value) : fs::path();
  };
  if (fs::path folder = fromEnvironment("PATINA_CACHE"); !folder.empty()) return folder;
  if (fs::path folder = fromEnvironment("XDG_CACHE_HOME"); !folder.empty()) return folder / "patina";
  if (fs::path folder = fromEnvironment("HOME"); !folder.empty()) return folder / ".cache" / "patina";
  return {};
}

}  // namespace patina
