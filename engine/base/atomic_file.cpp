#include "engine/base/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <string>
#include <utility>

namespace patina {
namespace fs = std::filesystem;
namespace {

constexpr int kNameAttempts =
    100;  // each name is new to this process; more only if another made the same ones

Error writeFailure(const fs::path& path, int code) {
  switch (code) {
    case ENOSPC:
    case EDQUOT:
      return {ErrorCode::WriteFailed, "there is no space left to write this", path.string(),
              "free some space on that disk, or choose another folder"};
    case EFBIG:
      return {ErrorCode::WriteFailed, "the system refuses a file this large", path.string(),
              "raise the file size limit (ulimit -f), or choose another disk"};
    case EACCES:
    case EPERM:
      return {ErrorCode::WriteFailed, "there is no permission to write here", path.string(),
              "choose a folder that you may write to"};
    case EROFS:
      return {ErrorCode::WriteFailed, "this disk is read-only", path.string(), "choose another folder"};
    case ENOENT:
      return {ErrorCode::WriteFailed, "the folder to write into is not there", path.string(),
              "make the folder, or choose another"};
    case ENOTDIR:
      return {ErrorCode::WriteFailed, "a file stands where a folder is needed", path.string(),
              "choose another folder"};
    default:
      return {ErrorCode::WriteFailed, std::string("writing failed: ") + std::strerror(code), path.string(),
              "check the disk, or choose another folder"};
  }
}

/// A hidden name beside `path`, new at every call.
fs::path neighbour(const fs::path& parent, const fs::path& name) {
  static std::atomic<unsigned> counter{0};
  const auto now = std::chrono::steady_clock::now().time_since_epoch().count();
  std::string hidden = ".";
  hidden += name.string();
  hidden += ".partial-" + std::to_string(::getpid());
  hidden += "-" + std::to_string(static_cast<unsigned long long>(now) % 1000000);
  hidden += "-" + std::to_string(counter.fetch_add(1));
  return parent / hidden;
}

fs::path parentOf(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

/// Makes a rename last over a power cut. Not every file system can; that is no failure of ours.
void flushFolder(const fs::path& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  ::fsync(descriptor);
  ::close(descriptor);
}

/// 0, or the errno of the failure.
int writeAll(int descriptor, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t count = ::write(descriptor, bytes.data(), bytes.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return errno;
    bytes.remove_prefix(static_cast<std::size_t>(count));
  }
  return ::fsync(descriptor) == 0 || errno == EINVAL ? 0 : errno;
}

}  // namespace

Status writeFileAtomically(const fs::path& file, std::string_view bytes) {
  std::error_code ignored;
  fs::path target = file;
  if (fs::is_symlink(fs::symlink_status(file, ignored))) {
    target = fs::weakly_canonical(file, ignored);
    if (ignored || target.empty()) target = file;
  }

  mode_t mode = 0;
  bool keepMode = false;
  struct stat status {};
  if (::stat(target.c_str(), &status) == 0) {
    if (S_ISDIR(status.st_mode)) {
      return Error{ErrorCode::Refused, "a folder stands where the file should be written", file.string(),
                   "choose another name"};
    }
    if (!S_ISREG(status.st_mode)) {
      return Error{ErrorCode::Refused, "this is a device or a pipe, not a plain file", file.string(),
                   "choose another name"};
    }
    mode = status.st_mode & 07777;
    keepMode = true;
  }

  fs::path partial;
  int descriptor = -1;
  for (int attempt = 0; attempt < kNameAttempts && descriptor < 0; ++attempt) {
    partial = neighbour(parentOf(target), target.filename());
    descriptor = ::open(partial.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (descriptor < 0 && errno != EEXIST) return writeFailure(file, errno);
  }
  if (descriptor < 0) return writeFailure(file, EEXIST);

  int code = writeAll(descriptor, bytes);
  if (code == 0 && keepMode && ::fchmod(descriptor, mode) != 0) code = errno;
  if (::close(descriptor) != 0 && code == 0) code = errno;
  if (code == 0 && ::rename(partial.c_str(), target.c_str()) != 0) code = errno;
  if (code != 0) {
    ::unlink(partial.c_str());
    return writeFailure(file, code);
  }
  flushFolder(parentOf(target));
  return Done{};
}

Result<StagedFolder> StagedFolder::create(const fs::path& finalPath) {
  StagedFolder staged;
  std::error_code code;
  fs::path absolute = fs::absolute(finalPath, code).lexically_normal();
  if (code || finalPath.empty()) {
    return Error{ErrorCode::WriteFailed, "no folder to write into was named", finalPath.string(), "name one"};
  }
  if (!absolute.has_filename()) absolute = absolute.parent_path();  // "out/" means "out"
  staged.final_ = absolute;

  const fs::file_status there = fs::status(staged.final_, code);
  if (there.type() == fs::file_type::directory) {
    staged.finalExisted_ = true;
  } else if (there.type() != fs::file_type::not_found) {
    if (there.type() == fs::file_type::none) return writeFailure(staged.final_, code.value());
    return Error{ErrorCode::Refused, "this is not a folder, so nothing can be written into it",
                 staged.final_.string(), "choose another name, or move that file away"};
  }

  if (!staged.finalExisted_) {
    std::vector<fs::path> missing;
    for (fs::path parent = parentOf(staged.final_); !fs::exists(parent, code); parent = parentOf(parent)) {
      missing.push_back(parent);
      if (parent == parentOf(parent)) break;
    }
    for (auto parent = missing.rbegin(); parent != missing.rend(); ++parent) {
      if (::mkdir(parent->c_str(), 0777) == 0) {
        staged.madeParents_.push_back(*parent);
      } else if (errno != EEXIST) {
        return writeFailure(*parent, errno);
      }
    }
  }

  // Inside the final folder where there is one: it may be a mount point, or its parent may not be ours to
  // write to.
  const fs::path home = staged.finalExisted_ ? staged.final_ : parentOf(staged.final_);
  for (int attempt = 0; attempt < kNameAttempts; ++attempt) {
    fs::path candidate = neighbour(home, staged.final_.filename());
    if (::mkdir(candidate.c_str(), 0777) == 0) {
      staged.staging_ = std::move(candidate);
      return staged;
    }
    if (errno != EEXIST) return writeFailure(staged.final_, errno);
  }
  return writeFailure(staged.final_, EEXIST);
}

StagedFolder::StagedFolder(StagedFolder&& other) noexcept
    : staging_(std::exchange(other.staging_, {})),
      final_(std::exchange(other.final_, {})),
      madeParents_(std::exchange(other.madeParents_, {})),
      finalExisted_(other.finalExisted_) {}

StagedFolder& StagedFolder::operator=(StagedFolder&& other) noexcept {
  if (this != &other) {
    discard();
    staging_ = std::exchange(other.staging_, {});
    final_ = std::exchange(other.final_, {});
    madeParents_ = std::exchange(other.madeParents_, {});
    finalExisted_ = other.finalExisted_;
  }
  return *this;
}

StagedFolder::~StagedFolder() {
  discard();
}

void StagedFolder::discard() noexcept {
  std::error_code ignored;
  if (!staging_.empty()) fs::remove_all(staging_, ignored);
  for (auto parent = madeParents_.rbegin(); parent != madeParents_.rend(); ++parent) {
    ::rmdir(parent->c_str());  // fails, rightly, where somebody else has put something there meanwhile
  }
  staging_.clear();
  madeParents_.clear();
}

Status StagedFolder::commit() {
  if (staging_.empty()) {
    return Error{ErrorCode::WriteFailed, "this folder was committed already", final_.string(), ""};
  }
  if (finalExisted_) {
    Status merged = mergeInto();
    if (!merged) return merged;
  } else if (::rename(staging_.c_str(), final_.c_str()) != 0) {
    // Somebody made the folder while we worked. Their files stay.
    if (errno != ENOTEMPTY && errno != EEXIST) return writeFailure(final_, errno);
    Status merged = mergeInto();
    if (!merged) return merged;
  }
  flushFolder(parentOf(final_));
  madeParents_.clear();
  std::error_code ignored;
  fs::remove_all(staging_, ignored);  // after a merge: emptied folders and replaced files
  staging_.clear();
  return Done{};
}

Status StagedFolder::mergeInto() {
  std::error_code code;
  std::vector<fs::path> folders, files;
  for (fs::recursive_directory_iterator it(staging_, code), end; !code && it != end; it.increment(code)) {
    const fs::path relative = it->path().lexically_relative(staging_);
    (it->is_directory(code) ? folders : files).push_back(relative);
  }
  if (code) return writeFailure(staging_, code.value());
  std::sort(folders.begin(), folders.end());  // a parent sorts before its children
  // Files of the top level last: a summary there should not appear before what it sums up.
  const auto depth = [](const fs::path& path) { return std::distance(path.begin(), path.end()); };
  std::sort(files.begin(), files.end(), [&](const fs::path& a, const fs::path& b) {
    return depth(a) != depth(b) ? depth(a) > depth(b) : a < b;
  });

  // Everything that can be known to fail is looked at before anything is touched.
  for (const fs::path& folder : folders) {
    const auto type = fs::status(final_ / folder, code).type();
    if (type != fs::file_type::not_found && type != fs::file_type::directory) {
      return writeFailure(final_ / folder, ENOTDIR);
    }
  }
  for (const fs::path& file : files) {
    if (fs::is_directory(final_ / file, code)) {
      return Error{ErrorCode::Refused, "a folder stands where a file should be written",
                   (final_ / file).string(), "choose another folder, or move that one away"};
    }
  }

  const fs::path backup = staging_ / neighbour({}, "replaced");
  std::vector<fs::path> madeFolders, replaced, added;
  const auto undo = [&] {
    for (const fs::path& file : added) ::unlink((final_ / file).c_str());
    for (const fs::path& file : replaced) ::rename((backup / file).c_str(), (final_ / file).c_str());
    for (auto folder = madeFolders.rbegin(); folder != madeFolders.rend(); ++folder) ::rmdir(folder->c_str());
  };

  fs::create_directory(backup, code);
  for (const fs::path& folder : folders) {
    if (!code) fs::create_directory(backup / folder, code);
    if (!code && fs::create_directory(final_ / folder, code)) madeFolders.push_back(final_ / folder);
  }
  if (code) {
    undo();
    return writeFailure(final_, code.value());
  }
  for (const fs::path& file : files) {
    const fs::path target = final_ / file;
    // A second name for the old file, so that it is never absent; a file system without links has it moved
    // aside.
    bool saved = ::link(target.c_str(), (backup / file).c_str()) == 0;
    if (!saved && errno != ENOENT) saved = ::rename(target.c_str(), (backup / file).c_str()) == 0;
    if (saved) replaced.push_back(file);
    if (::rename((staging_ / file).c_str(), target.c_str()) != 0) {
      const int failure = errno;
      undo();
      return writeFailure(target, failure);
    }
    if (!saved) added.push_back(file);
  }
  for (const fs::path& folder : folders) flushFolder(final_ / folder);
  flushFolder(final_);
  return Done{};
}

}  // namespace patina
