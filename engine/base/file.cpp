#include "engine/base/file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace patina {
namespace {

Error openFailure(const std::filesystem::path& file, int code) {
  switch (code) {
    case ENOENT:
    case ENOTDIR:
      return {ErrorCode::NotFound, "there is no such file", file.string(), "check the name and the folder"};
    case EACCES:
    case EPERM:
      return {ErrorCode::Refused, "this file may not be read", file.string(), "check who may read the file"};
    default:
      return {ErrorCode::NotFound, std::string("the file can't be opened: ") + std::strerror(code),
              file.string(), "check the disk or the network folder it is on"};
  }
}

}  // namespace

Result<RandomAccessFile> RandomAccessFile::open(const std::filesystem::path& file, std::uint64_t maxBytes) {
  // Non-blocking, because opening a pipe would otherwise wait for somebody to write into it.
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return openFailure(file, errno);
  RandomAccessFile opened(descriptor, 0);  // closes it on every way out

  struct stat status {};
  if (::fstat(descriptor, &status) != 0) return openFailure(file, errno);
  if (S_ISDIR(status.st_mode)) {
    return Error{ErrorCode::NotFound, "this is a folder, and a file was expected", file.string(),
                 "name the file"};
  }
  if (!S_ISREG(status.st_mode)) {
    return Error{ErrorCode::Refused, "this is not a plain file", file.string(), "copy the data into a file"};
  }
  if (static_cast<std::uint64_t>(status.st_size) > maxBytes) {
    return Error{ErrorCode::Malformed,
                 "the file is " + std::to_string(status.st_size) + " bytes long, more than the " +
                     std::to_string(maxBytes) + " that make sense here",
                 file.string(), "check that this is the right file"};
  }
  opened.size_ = static_cast<std::uint64_t>(status.st_size);
  return opened;
}

RandomAccessFile::RandomAccessFile(RandomAccessFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), size_(other.size_) {}

RandomAccessFile& RandomAccessFile::operator=(RandomAccessFile&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(size_, other.size_);
  return *this;
}

RandomAccessFile::~RandomAccessFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

bool RandomAccessFile::read(std::uint64_t at, char* to, std::size_t count) const {
  while (count > 0) {
    const ssize_t done = ::pread(descriptor_, to, count, static_cast<off_t>(at));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return false;
    to += done;
    at += static_cast<std::uint64_t>(done);
    count -= static_cast<std::size_t>(done);
  }
  return true;
}

Result<std::string> readFile(const std::filesystem::path& file, std::uint64_t maxBytes) {
  const Result<RandomAccessFile> opened = RandomAccessFile::open(file, maxBytes);
  if (!opened) return opened.error();
  std::string bytes(static_cast<std::size_t>(opened->size()), '\0');
  if (opened->read(0, bytes.data(), bytes.size())) return bytes;
  return Error{ErrorCode::Malformed, "reading the file failed, or it became shorter meanwhile", file.string(),
               "check the disk or the network folder it is on"};
}

}  // namespace patina
