#include "engine/fourier/measurement_store.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>

namespace patina {
namespace {

std::string gib(std::uint64_t bytes) {
  const auto tenths = (bytes * 10 + (std::uint64_t{1} << 30) - 1) >> 30;
  return std::to_string(tenths / 10) + "." + std::to_string(tenths % 10) + " GiB";
}

Error scratchError(int code, std::uint64_t bytes, const std::filesystem::path& folder) {
  const bool full = code == ENOSPC || code == EDQUOT || code == EFBIG;
  return {ErrorCode::WriteFailed,
          full ? "the disk is too full for the fit's scratch file of " + gib(bytes)
               : std::string("the fit's scratch file can't be written: ") + std::strerror(code),
          folder.string(),
          "free some space there, choose another folder for scratch files, or raise the memory limit"};
}

}  // namespace

struct MeasurementStore::File {
  int descriptor = -1;
  std::uint64_t bytes = 0;
  std::filesystem::path folder;
  std::mutex mutex;  // guards failure
  std::optional<Error> failure;
  ~File() {
    if (descriptor >= 0) ::close(descriptor);
  }
};

void MeasurementStore::Unmap::operator()(float* at) const {
  ::munmap(at, bytes);
}

Result<MeasurementStore> MeasurementStore::make(std::size_t siteCount, int frequencyCount,
                                                std::uint64_t memoryBytes,
                                                const std::filesystem::path& scratchFolder) {
  MeasurementStore store;
  store.siteCount_ = siteCount;
  store.frequencyCount_ = frequencyCount;
  const std::uint64_t bytes = bytesFor(siteCount, frequencyCount);
  if (bytes == 0) return store;
  if (bytes <= memoryBytes) {
    // Pages of zeros that the system provides when they are first touched, by whichever thread does.
    void* at = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (at != MAP_FAILED) {
      ::madvise(at, bytes, MADV_HUGEPAGE);
      store.memory_ = {static_cast<float*>(at), Unmap{bytes}};
      return store;
    }
  }
  auto file = std::make_shared<File>();
  std::error_code code;
  file->folder = scratchFolder.empty() ? std::filesystem::temp_directory_path(code) : scratchFolder;
  file->bytes = bytes;
  file->descriptor = ::open(file->folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (file->descriptor < 0) {  // a file system without nameless files
    std::string name = (file->folder / "patina-scratch-XXXXXX").string();
    file->descriptor = ::mkostemp(name.data(), O_CLOEXEC);
    if (file->descriptor < 0) return scratchError(errno, bytes, file->folder);
    ::unlink(name.c_str());
  }
  if (::fallocate(file->descriptor, 0, 0, static_cast<off_t>(bytes)) != 0) {
    if (errno != EOPNOTSUPP && errno != ENOSYS) return scratchError(errno, bytes, file->folder);
    if (::ftruncate(file->descriptor, static_cast<off_t>(bytes)) != 0)
      return scratchError(errno, bytes, file->folder);
  }
  store.file_ = std::move(file);
  return store;
}

void MeasurementStore::readFile(std::uint64_t at, float* to, std::size_t floats) const {
  char* target = reinterpret_cast<char*>(to);
  std::size_t left = floats * sizeof(float);
  while (left > 0) {
    const ssize_t got = ::pread(file_->descriptor, target, left, static_cast<off_t>(at));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      std::scoped_lock lock(file_->mutex);
      if (!file_->failure)
        file_->failure =
            Error{ErrorCode::Malformed,
                  std::string("the fit's scratch file can't be read: ") +
                      (got < 0 ? std::strerror(errno) : "it ends too early"),
                  file_->folder.string(), "check the disk, or choose another folder for scratch files"};
      std::memset(target, 0, left);
      return;
    }
    target += got;
    at += static_cast<std::uint64_t>(got);
    left -= static_cast<std::size_t>(got);
  }
}

SiteBlock MeasurementStore::block(std::size_t first, std::size_t count, Parts parts) const {
  SiteBlock block;
  block.run_ = {first, count};
  block.stride_ = stride();
  const std::size_t offset = first * stride(), floats = count * stride();
  if (memory_) {
    block.z_ = memory_.get() + offset;
    block.even_ = memory_.get() + half() + offset;
    return block;
  }
  if (!file_ || floats == 0) return block;
  block.copy_.resize(floats * (parts == kBoth ? 2 : 1));
  float* next = block.copy_.data();
  if (parts & kZ) {
    readFile(offset * sizeof(float), next, floats);
    block.z_ = next;
    next += floats;
  }
  if (parts & kEven) {
    readFile((half() + offset) * sizeof(float), next, floats);
    block.even_ = next;
  }
  return block;
}

Status MeasurementStore::write(SiteRun run, std::span<const float> z, std::span<const float> even) {
  const std::size_t offset = run.first * stride(), floats = run.count * stride();
  if (memory_) {
    std::copy_n(z.data(), floats, memory_.get() + offset);
    std::copy_n(even.data(), floats, memory_.get() + half() + offset);
    return Done{};
  }
  if (!file_) return Done{};
  const auto put = [&](std::uint64_t at, const float* from) -> int {
    const char* source = reinterpret_cast<const char*>(from);
    std::size_t left = floats * sizeof(float);
    while (left > 0) {
      const ssize_t done = ::pwrite(file_->descriptor, source, left, static_cast<off_t>(at));
      if (done < 0 && errno == EINTR) continue;
      if (done < 0) return errno;
      source += done;
      at += static_cast<std::uint64_t>(done);
      left -= static_cast<std::size_t>(done);
    }
    return 0;
  };
  if (const int code = put(offset * sizeof(float), z.data()))
    return scratchError(code, file_->bytes, file_->folder);
  if (const int code = put((half() + offset) * sizeof(float), even.data()))
    return scratchError(code, file_->bytes, file_->folder);
  return Done{};
}

std::optional<Error> MeasurementStore::failure() const {
  if (!file_) return std::nullopt;
  std::scoped_lock lock(file_->mutex);
  return file_->failure;
}

std::span<const std::uint16_t> MeasurementStore::droppedRows(std::size_t site) const {
  const auto at = std::ranges::lower_bound(droppedSite_, site);
  if (at == droppedSite_.end() || *at != site) return {};
  const auto i = static_cast<std::size_t>(at - droppedSite_.begin());
  return {droppedRow_.data() + droppedFirst_[i], droppedFirst_[i + 1] - droppedFirst_[i]};
}

void MeasurementStore::setDroppedRows(std::vector<std::pair<std::uint32_t, std::uint16_t>> rows) {
  std::ranges::sort(rows);
  rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  droppedSite_.clear();
  droppedFirst_.clear();
  droppedRow_.clear();
  for (const auto& [site, row] : rows) {
    if (droppedSite_.empty() || droppedSite_.back() != site) {
      droppedSite_.push_back(site);
      droppedFirst_.push_back(droppedRow_.size());
    }
    droppedRow_.push_back(row);
  }
  droppedFirst_.push_back(droppedRow_.size());
}

}  // namespace patina
