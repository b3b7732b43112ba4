#include "devices/simulated/bundle_folder.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

#include "engine/base/file.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

bool onlyNames(const fs::path& folder, const std::function<bool(const std::string&)>& ours) {
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    if (!ours(it->path().filename().string())) return false;
  return !error;
}

bool saysThatWeMadeIt(const fs::path& description) {
  constexpr std::uint64_t kMostBytes = std::uint64_t{64} << 20;  // thousands of photographs
  const Result<std::string> text = readFile(description, kMostBytes);
  if (!text) return false;
  const nlohmann::json json = nlohmann::json::parse(*text, nullptr, false);
  if (!json.is_object()) return false;
  const auto format = json.find("format"), maker = json.find("made_by");
  return format != json.end() && *format == "patina-capture" && maker != json.end() &&
         *maker == kMadeBySimulatedRig;
}

/// Whether nothing would be lost with the folder.
bool replaceable(const fs::path& folder) {
  std::error_code error;
  if (fs::symlink_status(folder, error).type() == fs::file_type::not_found) return true;
  if (!fs::is_directory(folder, error)) return false;
  if (fs::is_empty(folder, error)) return true;
  if (!saysThatWeMadeIt(folder / "capture.json")) return false;
  const bool truthIsOurs =
      !fs::exists(folder / "truth", error) ||
      onlyNames(folder / "truth", [](auto& name) { return name == "truth.json" || name.ends_with(".exr"); });
  return truthIsOurs && onlyNames(folder, [](const std::string& name) {
           const bool photo =
               name.starts_with("photo_") || name.starts_with("shot_") || name.starts_with("white_");
           return name == "capture.json" || name == "truth" ||
                  (photo && (name.ends_with(".exr") || name.ends_with(".png")));
         });
}

Error strangersFolder(const fs::path& folder) {
  return {ErrorCode::Refused,
          "the folder holds something that is not a simulated capture, so it is left alone", folder.string(),
          "name an empty or a new folder"};
}

/// A hidden name beside `folder` that nobody else uses.
fs::path hiddenNeighbour(const fs::path& folder, const char* what) {
  static std::atomic<unsigned> counter{0};
  const auto now = std::chrono::steady_clock::now().time_since_epoch().count();
  return folder.parent_path() / ("." + folder.filename().string() + what + std::to_string(::getpid()) + "-" +
                                 std::to_string(now) + "-" + std::to_string(counter++));
}

/// Puts the finished capture where an earlier one is: that one aside, this one in, and only then the earlier
/// one away. On failure the earlier one is back in its place.
Status replaceFolder(const fs::path& finished, const fs::path& target) {
  if (!replaceable(target)) return strangersFolder(target);  // changed while the work was going on
  const fs::path aside = hiddenNeighbour(target, ".replaced-");
  std::error_code error, ignored;
  fs::rename(target, aside, error);
  if (!error) {
    fs::rename(finished, target, error);
    if (error) fs::rename(aside, target, ignored);
  }
  if (error)
    return Error{ErrorCode::WriteFailed,
                 "the finished capture could not be moved into place: " + error.message(), target.string(),
                 "check the permissions"};
  fs::remove_all(aside, ignored);
  return Done{};
}

}  // namespace

Result<BundleFolder> BundleFolder::create(const fs::path& folder) {
  std::error_code error;
  const fs::path resolved = fs::weakly_canonical(fs::absolute(folder), error);  // through symbolic links
  BundleFolder bundle;
  bundle.target_ = resolved.has_filename() ? resolved : resolved.parent_path();  // "out/" means "out"
  if (error || bundle.target_.empty() || !replaceable(bundle.target_)) return strangersFolder(folder);
  bundle.existed_ = fs::exists(bundle.target_, error);
  // Not committed, it takes itself and the parents that it made away.
  bundle.finished_ = bundle.existed_ ? hiddenNeighbour(bundle.target_, ".new-") : bundle.target_;
  Result<StagedFolder> staged = StagedFolder::create(bundle.finished_);
  if (!staged) return staged.error();
  bundle.staged_.emplace(std::move(*staged));
  return bundle;
}

Status BundleFolder::commit() {
  if (const Status moved = staged_->commit(); !moved) return moved.error();
  if (!existed_) return Done{};
  const Status replaced = replaceFolder(finished_, target_);
  if (!replaced) {
    std::error_code ignored;
    fs::remove_all(finished_, ignored);
  }
  return replaced;
}

}  // namespace patina
