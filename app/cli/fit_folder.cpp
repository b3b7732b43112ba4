#include "app/cli/fit_folder.h"

#include "engine/base/atomic_file.h"

namespace patina::cli {

namespace fs = std::filesystem;

bool isInside(const fs::path& folder, const fs::path& bundle) {
  std::error_code code, ignored;
  const fs::path home = fs::canonical(bundle, code);
  if (code) return false;
  for (fs::path at = fs::weakly_canonical(fs::absolute(folder, ignored), ignored); !at.empty();
       at = at.parent_path()) {
    if (fs::equivalent(at, home, ignored)) return true;
    if (at == at.parent_path()) break;
  }
  return false;
}

int refuseInside(const std::string& folder, const fs::path& bundle, Context& context) {
  std::error_code ignored;
  const fs::path home = fs::canonical(bundle, ignored);
  return context.misuse("the bundle is never written to, and " + folder +
                        " is in it. Try: a folder beside it, such as " +
                        (home.parent_path() / (home.filename().string() + "-fit")).string() + ".");
}

Status checkWritable(const std::string& folder) {
  Result<StagedFolder> probe = StagedFolder::create(folder);
  if (!probe) return probe.error();
  return Done{};
}

}  // namespace patina::cli
