#include "engine/fourier/finished_tiles.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <map>
#include <optional>
#include <type_traits>

#include "engine/base/file.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace patina {
namespace {

constexpr std::uint64_t kMagic = 0x31656c6974746150;  // "Pattile1"
/// Raise when a solution's meaning changes though its size does not.
constexpr std::uint64_t kLayout = 1;

struct Header {
  std::uint64_t magic = kMagic, fingerprint = 0, checksum = 0;
  std::uint64_t expected() const { return XXH3_64bits(this, 2 * sizeof(std::uint64_t)); }
};

struct Record {
  std::uint64_t stage = 0, first = 0, count = 0, checksum = 0;
};

static_assert(std::is_trivially_copyable_v<SiteSolution>);

/// Of a record's head and body.
std::uint64_t checksumOf(const Record& record, const void* body) {
  const std::uint64_t seed = XXH3_64bits(&record, 3 * sizeof(std::uint64_t));
  return XXH3_64bits_withSeed(body, record.count * sizeof(SiteSolution), seed);
}

bool writeAll(int descriptor, std::uint64_t at, const void* from, std::size_t count) {
  const char* source = static_cast<const char*>(from);
  while (count > 0) {
    const ssize_t done = ::pwrite(descriptor, source, count, static_cast<off_t>(at));
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) return false;
    source += done;
    at += static_cast<std::uint64_t>(done);
    count -= static_cast<std::size_t>(done);
  }
  return true;
}

bool readAll(int descriptor, std::uint64_t at, void* to, std::size_t count) {
  char* target = static_cast<char*>(to);
  while (count > 0) {
    const ssize_t done = ::pread(descriptor, target, count, static_cast<off_t>(at));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return false;
    target += done;
    at += static_cast<std::uint64_t>(done);
    count -= static_cast<std::size_t>(done);
  }
  return true;
}

Error writeError(const std::filesystem::path& file, int code) {
  return {ErrorCode::WriteFailed,
          code == ENOSPC || code == EDQUOT
              ? std::string("the disk is full: finished texels are no longer kept")
              : std::string("finished texels can't be kept: ") + std::strerror(code),
          file.string(), "free some space there; the fit itself goes on"};
}

}  // namespace

struct FinishedTiles::File {
  std::filesystem::path path;
  int descriptor = -1;
  mutable std::mutex mutex;  // guards all below
  std::uint64_t end = 0;
  std::map<std::pair<std::uint64_t, std::uint64_t>, std::pair<std::uint64_t, std::uint64_t>>
      records;  ///< (stage, first) to (count, place of the body)
  std::optional<Error> failure;
  ~File() {
    if (descriptor >= 0) ::close(descriptor);
  }

  /// The records that are whole. The first that isn't ends them: what follows was never finished.
  void readRecords(std::uint64_t size) {
    end = sizeof(Header);
    std::vector<char> body;
    Record record;
    while (size - end >= sizeof(Record) && readAll(descriptor, end, &record, sizeof(Record))) {
      const std::uint64_t left = size - end - sizeof(Record);
      if (record.count > left / sizeof(SiteSolution)) return;
      body.resize(record.count * sizeof(SiteSolution));
      if (!readAll(descriptor, end + sizeof(Record), body.data(), body.size())) return;
      if (record.checksum != checksumOf(record, body.data())) return;
      records[{record.stage, record.first}] = {record.count, end + sizeof(Record)};
      end += sizeof(Record) + body.size();
    }
  }
};

FinishedTiles::FinishedTiles() = default;
FinishedTiles::FinishedTiles(FinishedTiles&&) noexcept = default;
FinishedTiles& FinishedTiles::operator=(FinishedTiles&&) noexcept = default;
FinishedTiles::~FinishedTiles() = default;

Result<FinishedTiles> FinishedTiles::open(const std::filesystem::path& folder, std::uint64_t fingerprint) {
  auto file = std::make_unique<File>();
  file->path = folder / kFileName;
  std::error_code code;
  std::filesystem::create_directories(folder, code);
  file->descriptor = ::open(file->path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644);
  if (file->descriptor < 0) return writeError(file->path, errno);
  // Two fits into one folder would mix their records; the second keeps nothing.
  if (::flock(file->descriptor, LOCK_EX | LOCK_NB) != 0)
    return Error{ErrorCode::WriteFailed, "another fit keeps its finished texels there", file->path.string(),
                 "wait for it, or choose another folder"};
  struct stat status {};
  Header header;
  const bool known = ::fstat(file->descriptor, &status) == 0 && S_ISREG(status.st_mode) &&
                     static_cast<std::uint64_t>(status.st_size) >= sizeof(Header) &&
                     readAll(file->descriptor, 0, &header, sizeof(Header)) && header.magic == kMagic &&
                     header.checksum == header.expected() && header.fingerprint == fingerprint;
  if (known) {
    file->readRecords(static_cast<std::uint64_t>(status.st_size));
    if (::ftruncate(file->descriptor, static_cast<off_t>(file->end)) != 0)
      return writeError(file->path, errno);
  } else {
    header = {};
    header.fingerprint = fingerprint;
    header.checksum = header.expected();
    if (::ftruncate(file->descriptor, 0) != 0 || !writeAll(file->descriptor, 0, &header, sizeof(Header)))
      return writeError(file->path, errno);
    file->end = sizeof(Header);
  }
  FinishedTiles tiles;
  tiles.file_ = std::move(file);
  return tiles;
}

bool FinishedTiles::load(int stage, SiteRun run, std::span<SiteSolution> solutions) const {
  if (!file_ || solutions.size() != run.count) return false;
  std::uint64_t at = 0;
  {
    std::scoped_lock lock(file_->mutex);
    const auto found = file_->records.find({static_cast<std::uint64_t>(stage), run.first});
    if (found == file_->records.end() || found->second.first != run.count) return false;
    at = found->second.second;
  }
  std::vector<SiteSolution> read(run.count);
  if (!readAll(file_->descriptor, at, read.data(), run.count * sizeof(SiteSolution))) return false;
  std::copy(read.begin(), read.end(), solutions.begin());
  return true;
}

void FinishedTiles::save(int stage, SiteRun run, std::span<const SiteSolution> solutions) {
  if (!file_ || solutions.size() != run.count) return;
  Record record{static_cast<std::uint64_t>(stage), run.first, run.count, 0};
  record.checksum = checksumOf(record, solutions.data());
  std::scoped_lock lock(file_->mutex);
  if (file_->failure) return;
  // The body first: a record's head without its body would be taken for a torn one anyway, but costs a read.
  const std::uint64_t body = file_->end + sizeof(Record);
  if (!writeAll(file_->descriptor, body, solutions.data(), solutions.size_bytes()) ||
      !writeAll(file_->descriptor, file_->end, &record, sizeof(Record))) {
    file_->failure = writeError(file_->path, errno);
    return;
  }
  file_->records[{record.stage, record.first}] = {record.count, body};
  file_->end = body + solutions.size_bytes();
}

std::optional<Error> FinishedTiles::failure() const {
  if (!file_) return std::nullopt;
  std::scoped_lock lock(file_->mutex);
  return file_->failure;
}

std::uint64_t fitFingerprint(const FourierCapture& capture, const FourierFitOptions& options,
                             std::size_t siteCount) {
  std::string text;
  const auto add = [&](const auto& value) { text += std::to_string(value) + '\n'; };
  add(kLayout);
  add(sizeof(SiteSolution));
  text += solverTarget();
  text += '\n';
  constexpr std::uint64_t kLargestDescription = 64u << 20;
  if (const auto bytes = readFile(capture.folder / "capture.json", kLargestDescription)) text += *bytes;
  for (const auto& photo : capture.photos) {
    std::error_code code;
    const auto file = capture.folder / photo.file;
    text += '\n' + photo.file + '\n';
    add(std::filesystem::file_size(file, code));
    add(std::filesystem::last_write_time(file, code).time_since_epoch().count());
  }
  add(options.size);
  add(static_cast<int>(options.lobe));
  add(static_cast<int>(options.weights));
  add(static_cast<int>(options.schedule));
  add(options.maxIterations);
  text += std::to_string(options.tolerance * 1e9) + '\n';
  add(options.neighbourRestarts);
  add(options.poolNeighbours);
  add(siteCount);  // groups of pixels follow from the memory limit, too
  return XXH3_64bits(text.data(), text.size());
}

}  // namespace patina
