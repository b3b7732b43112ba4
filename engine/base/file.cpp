#include "engine/base/file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

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

Result<std::string> readFile(const std::filesystem::path& file, std::uint64_t maxBytes) {
  // Non-blocking, because opening a pipe would otherwise wait for somebody to write into it.
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return openFailure(file, errno);
  struct Closer {
    int descriptor;
    ~Closer() { ::close(descriptor); }
  } closer{descriptor};

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

  std::string bytes(static_cast<std::size_t>(status.st_size), '\0');
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t count = ::read(descriptor, bytes.data() + done, bytes.size() - done);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) {
      return Error{ErrorCode::Malformed, std::string("reading the file failed: ") + std::strerror(errno),
                   file.string(), "check the disk or the network folder it is on"};
    }
    if (count == 0) break;  // it became shorter while we read; the parser will say what is missing
    done += static_cast<std::size_t>(count);
  }
  bytes.resize(done);
  return bytes;
}

}  // namespace patina
