#include "devices/watched_folder/watched_folder.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>
#include <set>
#include <thread>

namespace patina {
namespace fs = std::filesystem;
namespace {

using std::chrono::milliseconds;

constexpr const char* kPrefix = "folder:";
constexpr const char* kExisting = "?existing";
constexpr milliseconds kLook{100};     ///< between looks into the folder
constexpr milliseconds kAtRest{300};   ///< a file that hasn't grown for so long may be whole
constexpr milliseconds kGiveUp{5000};  ///< one that hasn't for so long and can't be read never will be
constexpr milliseconds kPatience{10 * 60 * 1000};  ///< for somebody who shoots by hand

class WatchedFolder : public CameraDevice {
 public:
  WatchedFolder(CameraInfo info, fs::path folder, bool existing)
      : info_(std::move(info)), folder_(std::move(folder)) {
    if (!existing)
      for (const fs::path& file : photographs()) used_.insert(file);
  }
  ~WatchedFolder() override { stop(); }

  const CameraInfo& info() const override { return info_; }
  FrameFormat format() const override { return format_; }
  Result<std::vector<FrameFormat>> formats() override { return std::vector<FrameFormat>{format_}; }
  Status setFormat(const FrameFormat&) override { return Done{}; }
  Result<std::vector<CameraControl>> controls() override { return std::vector<CameraControl>{}; }
  Result<double> set(CameraControlId id, double) override {
    return Error{ErrorCode::Unsupported,
                 "the " + controlName(id) + " of this camera is set on the camera itself", info_.name,
                 "set it by hand, to manual, and leave it"};
  }
  bool streaming() const override { return thread_.joinable(); }

  /// Every photograph that comes is a frame.
  Status start(FrameSink sink) override {
    stop();
    thread_ = std::jthread([this, sink = std::move(sink)](const std::stop_token& token) {
      while (!token.stop_requested()) {
        Result<Frame> frame = next(kPatience, token);
        if (token.stop_requested()) return;
        const bool failed = !frame;
        sink(std::move(frame));
        if (failed) return;
      }
    });
    return Done{};
  }
  void stop() override { thread_ = {}; }

  Result<std::vector<Frame>> still(const StillRequest& asked, const std::stop_token& stop) override {
    this->stop();
    StillRequest request = asked;
    if (Status applied = apply(request); !applied) return applied.error();
    std::vector<Frame> frames;
    while (static_cast<int>(frames.size()) < request.frames) {
      Result<Frame> frame = next(asked.timeout.count() > 0 ? asked.timeout : kPatience, stop);
      if (!frame) return frame.error();
      // Whoever shoots sees the screen: what comes from now on was taken after the picture was on the glass.
      frame->metadata.exposureStart = std::max(std::chrono::steady_clock::now(), asked.notBefore);
      showPreview(*frame);
      frames.push_back(std::move(*frame));
    }
    return frames;
  }

 private:
  std::vector<fs::path> photographs() const {
    std::vector<fs::path> found;
    std::error_code code;
    for (fs::directory_iterator it(folder_, code), end; !code && it != end; it.increment(code))
      if (it->path().filename().string().front() != '.' && isPhotograph(it->path()))
        found.push_back(it->path());
    std::ranges::sort(found);
    return found;
  }

  Result<Frame> next(milliseconds patience, const std::stop_token& stop) {
    using Clock = std::chrono::steady_clock;
    struct Growing {
      std::uintmax_t size = 0;
      Clock::time_point since;
    };
    std::map<fs::path, Growing> growing;
    std::mutex mutex;
    std::condition_variable_any wake;
    const auto until = Clock::now() + patience;
    while (!stop.stop_requested()) {
      std::error_code code;
      if (!fs::is_directory(folder_, code))
        return Error{ErrorCode::NotFound, "the folder of the photographs is gone", folder_.string(),
                     "plug the disk in again, or make the folder"};
      const auto now = Clock::now();
      for (const fs::path& file : photographs()) {
        if (used_.contains(file)) continue;
        const std::uintmax_t size = fs::file_size(file, code);
        if (code) continue;
        const auto [known, isNew] = growing.try_emplace(file, Growing{size, now});
        if (!isNew && known->second.size != size) known->second = {size, now};
        const auto atRest = now - known->second.since;
        if (size == 0 || atRest < kAtRest) break;  // wait for this one: photographs come in their order
        Result<Frame> frame = readPhotograph(file);
        if (!frame && atRest < kGiveUp) break;
        used_.insert(file);
        if (!frame) return frame.error();
        frame->metadata.sequence = sequence_++;
        format_ = frame->format;
        return frame;
      }
      if (now >= until) return noFrameInTime(info_.name, patience);
      std::unique_lock lock(mutex);
      wake.wait_for(lock, stop, kLook, [] { return false; });
    }
    return Error{ErrorCode::Cancelled, "waiting for a photograph was cancelled", "", ""};
  }

  CameraInfo info_;
  fs::path folder_;
  FrameFormat format_;
  std::set<fs::path> used_;
  std::uint64_t sequence_ = 0;
  std::jthread thread_;
};

}  // namespace

Result<std::unique_ptr<CameraDevice>> WatchedFolderProvider::open(const std::string& id) {
  std::string path = id.starts_with(kPrefix) ? id.substr(std::string(kPrefix).size()) : id;
  const bool existing = path.ends_with(kExisting);
  if (existing) path.resize(path.size() - std::string(kExisting).size());
  std::error_code code;
  if (!fs::is_directory(path, code))
    return Error{ErrorCode::NotFound, "there is no such folder", path,
                 "make it, and let the camera's program put photographs there"};
  return std::unique_ptr<CameraDevice>(std::make_unique<WatchedFolder>(
      CameraInfo{id, "Photographs in " + path, backend(), ""}, fs::path(path), existing));
}

}  // namespace patina
