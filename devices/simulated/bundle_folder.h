#pragma once

#include <filesystem>
#include <optional>

#include "engine/base/atomic_file.h"
#include "engine/base/result.h"

namespace patina {

/// What capture.json says of bundles that a simulated rig made, under the key `made_by`.
inline constexpr const char* kMadeBySimulatedRig = "patina simulated rig";

/// A simulated capture under construction. Write into `path()`, then `commit()`; not committed, nothing is
/// left and an earlier capture stays. An existing folder is replaced only where it is empty or holds a
/// capture that a simulated rig made (of any kind), and nothing that a simulated rig doesn't write.
class BundleFolder {
 public:
  /// Errors: Refused (the folder holds something else), WriteFailed.
  static Result<BundleFolder> create(const std::filesystem::path& folder);
  const std::filesystem::path& path() const { return staged_->path(); }
  /// Moves the finished capture to its place, once. Errors: Refused (somebody put something else there in the
  /// meantime), WriteFailed.
  Status commit();

 private:
  BundleFolder() = default;
  std::optional<StagedFolder> staged_;
  std::filesystem::path finished_, target_;
  bool existed_ = false;
};

}  // namespace patina
