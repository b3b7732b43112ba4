#include "engine/capture/bundle_path.h"

#include <algorithm>

#include "engine/base/text.h"

namespace patina {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kLongestPath = 1024;  // bytes; file systems stop at 255 a name

Error leaves(const std::string& relative, const std::string& where) {
  return {ErrorCode::Refused,
          "the path " + inQuotes(relative) + " leads out of the bundle's folder, and is not opened", where,
          "copy the file into the bundle and name it there"};
}

}  // namespace

Status checkBundlePath(const std::string& relative, const std::string& where) {
  if (relative.empty()) {
    return Error{ErrorCode::Malformed, "the name of a file is empty", where, "name the file"};
  }
  const bool control = std::any_of(relative.begin(), relative.end(),
                                   [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; });
  if (control || relative.size() > kLongestPath) {
    return Error{ErrorCode::Malformed, "this can't be the name of a file: " + inQuotes(relative), where,
                 "use a plain, short name"};
  }
  const fs::path path(relative);
  if (path.is_absolute()) return leaves(relative, where);
  for (const fs::path& part : path) {
    if (part == "..") return leaves(relative, where);
  }
  return Done{};
}

Result<fs::path> resolveInBundle(const fs::path& folder, const std::string& relative,
                                 const std::string& where) {
  Status allowed = checkBundlePath(relative, where);
  if (!allowed) return allowed.error();
  std::error_code code;
  const fs::path home = fs::canonical(folder, code);
  if (code) {
    return Error{ErrorCode::NotFound, "the bundle's folder is not there", folder.string(),
                 "check the name, or whether the disk is connected"};
  }
  const fs::path file = fs::canonical(home / relative, code);
  if (code) {
    // A link that leads nowhere may still lead out; either way there is nothing to open.
    return Error{ErrorCode::NotFound, "the file " + inQuotes(relative) + " is not in the bundle", where,
                 "copy it into " + folder.string() + ", or correct its name in the file"};
  }
  const auto [homeEnd, fileAt] = std::mismatch(home.begin(), home.end(), file.begin(), file.end());
  if (homeEnd != home.end()) return leaves(relative, where);
  if (!fs::is_regular_file(file, code)) {
    return Error{ErrorCode::Refused, inQuotes(relative) + " is not a plain file", where, "name a file"};
  }
  return file;
}

}  // namespace patina
