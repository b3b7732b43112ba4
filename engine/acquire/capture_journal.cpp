#include "engine/acquire/capture_journal.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

#include "engine/base/file.h"
#include "engine/image/image_size.h"

namespace patina {
namespace {

constexpr std::uint64_t kMostBytes = std::uint64_t{64} << 20;

Error writeFailure(const std::filesystem::path& file) {
  const int code = errno;
  return Error{ErrorCode::WriteFailed,
               std::string("the capture's journal can't be written: ") + std::strerror(code), file.string(),
               code == ENOSPC ? "free some space on that disk; the photographs so far are kept"
                              : "check the disk and the permissions; the photographs so far are kept"};
}

}  // namespace

Result<CaptureJournal> CaptureJournal::open(const std::filesystem::path& file) {
  CaptureJournal journal;
  journal.file_ = file;
  std::error_code ignored;
  if (std::filesystem::exists(file, ignored)) {
    const Result<std::string> text = readFile(file, kMostBytes);
    if (!text) return text.error();
    std::size_t begin = 0;
    int line = 0;
    while (begin < text->size()) {
      const std::size_t end = text->find('\n', begin);
      if (end == std::string::npos) break;  // cut off by a crash
      ++line;
      nlohmann::json parsed =
          nlohmann::json::parse(text->begin() + static_cast<std::ptrdiff_t>(begin),
                                text->begin() + static_cast<std::ptrdiff_t>(end), nullptr, false);
      if (!parsed.is_object()) {
        // A power cut can leave the length of a last write without its bytes.
        if (text->find_first_not_of(std::string("\n\0", 2), end) == std::string::npos) break;
        return Error{ErrorCode::Malformed,
                     "line " + std::to_string(line) + " of the capture's journal is damaged", file.string(),
                     "restore that file, or start the capture anew in another folder"};
      }
      journal.lines_.push_back(std::move(parsed));
      begin = end + 1;
    }
    journal.length_ = begin;
  }
  journal.descriptor_ = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (journal.descriptor_ < 0) return writeFailure(file);
  if (::ftruncate(journal.descriptor_, static_cast<off_t>(journal.length_)) != 0 ||
      ::fsync(journal.descriptor_) != 0)
    return writeFailure(file);
  // The journal's own name must outlast a power cut too.
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  if (const int parent = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC); parent >= 0) {
    ::fsync(parent);
    ::close(parent);
  }
  return journal;
}

CaptureJournal::CaptureJournal(CaptureJournal&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)),
      length_(other.length_),
      file_(std::move(other.file_)),
      lines_(std::move(other.lines_)) {}

CaptureJournal& CaptureJournal::operator=(CaptureJournal&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(length_, other.length_);
  std::swap(file_, other.file_);
  std::swap(lines_, other.lines_);
  return *this;
}

CaptureJournal::~CaptureJournal() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

Status CaptureJournal::append(const nlohmann::json& line) {
  const std::string text = line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  std::size_t done = 0;
  while (done < text.size()) {
    const ssize_t count =
        ::pwrite(descriptor_, text.data() + done, text.size() - done, static_cast<off_t>(length_ + done));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) {
      const Error error = writeFailure(file_);
      // Half a line would hide what is written after it.
      if (::ftruncate(descriptor_, static_cast<off_t>(length_)) != 0) return error;
      return error;
    }
    done += static_cast<std::size_t>(count);
  }
  if (::fsync(descriptor_) != 0) return writeFailure(file_);
  length_ += text.size();
  lines_.push_back(line);
  return Done{};
}

void removeHalfWritten(const std::filesystem::path& folder) {
  std::error_code ignored;
  std::vector<std::filesystem::path> leftovers;
  for (std::filesystem::directory_iterator it(folder, ignored), end; !ignored && it != end;
       it.increment(ignored)) {
    const std::string name = it->path().filename().string();
    if (name.front() == '.' && name.find(".partial-") != std::string::npos) leftovers.push_back(it->path());
  }
  for (const std::filesystem::path& file : leftovers) std::filesystem::remove(file, ignored);
}

Result<CaptureJournal> beginCapture(const std::filesystem::path& folder, bool resume) {
  namespace fs = std::filesystem;
  std::error_code code;
  const bool hasJournal = fs::exists(folder / kCaptureJournal, code);
  if (hasJournal && !resume)
    return Error{ErrorCode::Refused, "a capture was begun in this folder", folder.string(),
                 "go on with it (--resume), or choose another folder"};
  if (!hasJournal && fs::exists(folder, code) &&
      (!fs::is_directory(folder, code) || !fs::is_empty(folder, code)))
    return Error{ErrorCode::Refused, "this folder holds something else", folder.string(),
                 "choose a new or an empty folder"};
  fs::create_directories(folder / "photos", code);
  if (code)
    return Error{ErrorCode::WriteFailed, "the capture's folder can't be made: " + code.message(),
                 folder.string(), "choose a folder that you may write to"};
  removeHalfWritten(folder);
  removeHalfWritten(folder / "photos");
  return CaptureJournal::open(folder / kCaptureJournal);
}

Result<std::string> fileHash(const std::filesystem::path& file) {
  const Result<std::string> bytes = readFile(file, kMaxImageFileBytes);
  if (!bytes) return bytes.error();
  char text[17];
  std::snprintf(text, sizeof text, "%016llx",
                static_cast<unsigned long long>(XXH3_64bits(bytes->data(), bytes->size())));
  return std::string(text);
}

}  // namespace patina
