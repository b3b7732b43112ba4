#pragma once

#include <filesystem>
#include <string_view>
#include <vector>

#include "engine/base/result.h"

namespace patina {

/// Writes a file so that at every moment either the old content or the whole new content is there: into a
/// hidden neighbour, flushed to the disk, then renamed over `file`. A symbolic link is followed, an existing
/// file keeps its permissions, and the folder must exist. Errors: WriteFailed (no space, no permission, no
/// folder; nothing is left behind), Refused (a folder or a device stands there).
Status writeFileAtomically(const std::filesystem::path& file, std::string_view bytes);

/// A folder under construction. Write into `path()`, then `commit()`: the result appears at the final path.
/// Not committed, the destructor removes it and every parent folder that `create` had to make.
///
/// Where the final folder doesn't exist, it appears whole by one rename. Where it exists, the new files
/// replace those of the same name one by one (each atomically, files of the top level last) and other files
/// in it are left alone; if one can't be replaced, those already replaced are put back. Only the loss of
/// power between two renames can leave a mixture.
class StagedFolder {
 public:
  /// Starts one. Missing parents are made. Errors: WriteFailed, or Refused where `finalPath` is not a folder.
  static Result<StagedFolder> create(const std::filesystem::path& finalPath);

  StagedFolder(StagedFolder&& other) noexcept;
  StagedFolder& operator=(StagedFolder&& other) noexcept;
  StagedFolder(const StagedFolder&) = delete;
  StagedFolder& operator=(const StagedFolder&) = delete;
  ~StagedFolder();

  /// Where to write before `commit`.
  const std::filesystem::path& path() const { return staging_; }
  /// Makes it final. Once only; afterwards `path()` is empty. Errors: WriteFailed, with the final folder as
  /// it was.
  Status commit();

 private:
  StagedFolder() = default;
  Status mergeInto();
  void discard() noexcept;

  std::filesystem::path staging_, final_;
  std::vector<std::filesystem::path> madeParents_;  ///< outermost first
  bool finalExisted_ = false;
};

}  // namespace patina
