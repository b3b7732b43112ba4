#include "devices/libcamera_camera.h"

#include <libcamera/libcamera.h>
#include <sys/mman.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <map>
#include <mutex>

#include "engine/base/text.h"

namespace patina {
namespace {

namespace lc = libcamera;

constexpr const char* kPrefix = "libcamera:";

struct LayoutEntry {
  lc::PixelFormat format;
  PixelLayout layout;
  BayerOrder bayer;
};

const std::vector<LayoutEntry>& layouts() {
  using enum PixelLayout;
  using enum BayerOrder;
  static const std::vector<LayoutEntry> table{{lc::formats::SRGGB8, Bayer8, Rggb},
                                              {lc::formats::SGRBG8, Bayer8, Grbg},
                                              {lc::formats::SGBRG8, Bayer8, Gbrg},
                                              {lc::formats::SBGGR8, Bayer8, Bggr},
                                              {lc::formats::SRGGB10, Bayer10, Rggb},
                                              {lc::formats::SGRBG10, Bayer10, Grbg},
                                              {lc::formats::SGBRG10, Bayer10, Gbrg},
                                              {lc::formats::SBGGR10, Bayer10, Bggr},
                                              {lc::formats::SRGGB12, Bayer12, Rggb},
                                              {lc::formats::SGRBG12, Bayer12, Grbg},
                                              {lc::formats::SGBRG12, Bayer12, Gbrg},
                                              {lc::formats::SBGGR12, Bayer12, Bggr},
                                              {lc::formats::SRGGB16, Bayer16, Rggb},
                                              {lc::formats::SGRBG16, Bayer16, Grbg},
                                              {lc::formats::SGBRG16, Bayer16, Gbrg},
                                              {lc::formats::SBGGR16, Bayer16, Bggr},
                                              {lc::formats::SRGGB10_CSI2P, Bayer10Packed, Rggb},
                                              {lc::formats::SGRBG10_CSI2P, Bayer10Packed, Grbg},
                                              {lc::formats::SGBRG10_CSI2P, Bayer10Packed, Gbrg},
                                              {lc::formats::SBGGR10_CSI2P, Bayer10Packed, Bggr},
                                              {lc::formats::SRGGB12_CSI2P, Bayer12Packed, Rggb},
                                              {lc::formats::SGRBG12_CSI2P, Bayer12Packed, Grbg},
                                              {lc::formats::SGBRG12_CSI2P, Bayer12Packed, Gbrg},
                                              {lc::formats::SBGGR12_CSI2P, Bayer12Packed, Bggr},
                                              {lc::formats::R8, Grey8, Rggb},
                                              {lc::formats::YUYV, Yuyv, Rggb},
                                              {lc::formats::MJPEG, Mjpeg, Rggb},
                                              {lc::formats::BGR888, Rgb8, Rggb}};
  return table;
}

const LayoutEntry* entryOf(const lc::PixelFormat& format) {
  for (const LayoutEntry& entry : layouts())
    if (entry.format == format) return &entry;
  return nullptr;
}

class LibcameraCamera : public CameraDevice {
 public:
  LibcameraCamera(CameraInfo info, std::shared_ptr<void> manager, std::shared_ptr<lc::Camera> camera)
      : info_(std::move(info)), manager_(std::move(manager)), camera_(std::move(camera)) {}
  ~LibcameraCamera() override {
    stop();
    camera_->release();
  }

  Status begin() {
    if (const int code = camera_->acquire(); code != 0)
      return code == -EBUSY ? cameraBusy(info_.name) : cameraUnplugged(info_.name);
    // The sensor's own numbers where they can be had.
    for (const lc::StreamRole role : {lc::StreamRole::Raw, lc::StreamRole::StillCapture}) {
      std::unique_ptr<lc::CameraConfiguration> configuration = camera_->generateConfiguration({role});
      if (!configuration || configuration->empty()) continue;
      for (const lc::PixelFormat& pixels : configuration->at(0).formats().pixelformats()) {
        const LayoutEntry* entry = entryOf(pixels);
        if (!entry) continue;
        for (const lc::Size& size : configuration->at(0).formats().sizes(pixels)) {
          FrameFormat format;
          format.layout = entry->layout;
          format.bayer = entry->bayer;
          format.size = {static_cast<int>(size.width), static_cast<int>(size.height)};
          format.name = pixels.toString() + " " + size.toString();
          formats_.push_back(format);
          roles_.push_back(role);
        }
      }
    }
    if (formats_.empty())
      return Error{ErrorCode::Unsupported, "this camera offers no format that Patina reads", info_.name,
                   "use another camera"};
    std::size_t best = 0;
    for (std::size_t i = 1; i < formats_.size(); ++i) {
      const auto rank = [&](std::size_t k) {
        return std::tuple(isLinear(formats_[k].layout),
                          std::int64_t{formats_[k].size.width} * formats_[k].size.height);
      };
      if (rank(i) > rank(best)) best = i;
    }
    return setFormat(formats_[best]);
  }

  const CameraInfo& info() const override { return info_; }
  bool streaming() const override { return streaming_; }
  FrameFormat format() const override { return format_; }
  Result<std::vector<FrameFormat>> formats() override {
    std::vector<FrameFormat> sorted = formats_;
    std::ranges::stable_sort(sorted, [](const FrameFormat& a, const FrameFormat& b) {
      return isLinear(a.layout) && !isLinear(b.layout);
    });
    return sorted;
  }

  Status setFormat(const FrameFormat& wanted) override {
    if (streaming_)
      return Error{ErrorCode::Refused, "the format can't change while pictures come", info_.name,
                   "stop the live picture first"};
    const auto found = std::ranges::find(formats_, wanted);
    if (found == formats_.end())
      return Error{ErrorCode::Invalid, "this camera has no format " + inQuotes(wanted.name), info_.name,
                   "choose one that it lists"};
    configuration_ =
        camera_->generateConfiguration({roles_[static_cast<std::size_t>(found - formats_.begin())]});
    if (!configuration_ || configuration_->empty()) return cameraUnplugged(info_.name);
    lc::StreamConfiguration& stream = configuration_->at(0);
    for (const LayoutEntry& entry : layouts())
      if (entry.layout == wanted.layout && entry.bayer == wanted.bayer) stream.pixelFormat = entry.format;
    stream.size = {static_cast<unsigned>(wanted.size.width), static_cast<unsigned>(wanted.size.height)};
    const lc::PixelFormat asked = stream.pixelFormat;
    if (configuration_->validate() == lc::CameraConfiguration::Invalid || stream.pixelFormat != asked ||
        static_cast<int>(stream.size.width) != wanted.size.width ||
        static_cast<int>(stream.size.height) != wanted.size.height)
      return Error{ErrorCode::Refused, "the camera doesn't take the format " + inQuotes(wanted.name),
                   info_.name, "choose another"};
    if (camera_->configure(configuration_.get()) != 0) return cameraUnplugged(info_.name);
    format_ = wanted;
    return Done{};
  }

  Result<std::vector<CameraControl>> controls() override {
    std::vector<CameraControl> list;
    const lc::ControlInfoMap& known = camera_->controls();
    const std::lock_guard lock(mutex_);
    if (const auto found = known.find(&lc::controls::ExposureTime); found != known.end())
      list.push_back({CameraControlId::ExposureS, found->second.min().get<std::int32_t>() * 1e-6,
                      found->second.max().get<std::int32_t>() * 1e-6, 1e-6, exposureS_, true});
    if (const auto found = known.find(&lc::controls::AnalogueGain); found != known.end())
      list.push_back({CameraControlId::Gain, found->second.min().get<float>(),
                      found->second.max().get<float>(), 0, gain_, true});
    if (known.find(&lc::controls::ColourGains) != known.end()) {
      constexpr double kLeastGain = 0.1, kMostGain = 32;  // libcamera says no range of a pair
      list.push_back({CameraControlId::RedGain, kLeastGain, kMostGain, 0, redGain_, true});
      list.push_back({CameraControlId::BlueGain, kLeastGain, kMostGain, 0, blueGain_, true});
    }
    return list;
  }

  Result<double> set(CameraControlId id, double value) override {
    const Result<std::vector<CameraControl>> known = controls();
    const auto found = std::ranges::find(*known, id, &CameraControl::id);
    if (found == known->end())
      return Error{ErrorCode::Unsupported, "this camera's " + controlName(id) + " can't be set by a program",
                   info_.name, "use a camera with manual settings"};
    if (!(value >= found->least && value <= found->most))
      return Error{ErrorCode::Invalid, "the " + controlName(id) + " is out of this camera's range",
                   info_.name, "choose another value"};
    const std::lock_guard lock(mutex_);
    (id == CameraControlId::ExposureS ? exposureS_
     : id == CameraControlId::Gain    ? gain_
     : id == CameraControlId::RedGain ? redGain_
                                      : blueGain_) = value;
    return value;  // requests from now on carry it; the frames' metadata say from which on it is in force
  }

  Status start(FrameSink sink) override {
    stop();
    lc::Stream* stream = configuration_->at(0).stream();
    allocator_ = std::make_unique<lc::FrameBufferAllocator>(camera_);
    if (allocator_->allocate(stream) < 0)
      return Error{ErrorCode::Refused, "the camera has no memory for pictures", info_.name,
                   "choose a smaller format"};
    for (const std::unique_ptr<lc::FrameBuffer>& buffer : allocator_->buffers(stream)) {
      std::unique_ptr<lc::Request> request = camera_->createRequest();
      if (!request || request->addBuffer(stream, buffer.get()) != 0 || !map(*buffer)) {
        release();
        return cameraUnplugged(info_.name);
      }
      requests_.push_back(std::move(request));
    }
    sink_ = std::move(sink);
    camera_->requestCompleted.connect(this, &LibcameraCamera::completed);
    camera_->disconnected.connect(this, &LibcameraCamera::disconnected);
    lc::ControlList first(camera_->controls());
    setControls(first);
    if (const int code = camera_->start(&first); code != 0) {
      release();
      return code == -EBUSY ? cameraBusy(info_.name) : cameraUnplugged(info_.name);
    }
    streaming_ = true;
    for (const auto& request : requests_) {
      setControls(request->controls());
      camera_->queueRequest(request.get());
    }
    return Done{};
  }

  void stop() override {
    if (!streaming_) return;
    streaming_ = false;
    camera_->stop();  // requests in flight come back cancelled, before this returns
    release();
  }

 private:
  void release() {
    camera_->requestCompleted.disconnect(this);
    camera_->disconnected.disconnect(this);
    requests_.clear();
    for (const auto& [buffer, memory] : mapped_) ::munmap(memory.first, memory.second);
    mapped_.clear();
    allocator_.reset();
  }

  bool map(const lc::FrameBuffer& buffer) {
    const std::vector<lc::FrameBuffer::Plane>& planes = buffer.planes();
    if (planes.empty()) return false;
    const std::size_t length = planes[0].offset + planes[0].length;
    void* memory = ::mmap(nullptr, length, PROT_READ, MAP_SHARED, planes[0].fd.get(), 0);
    if (memory == MAP_FAILED) return false;
    mapped_[&buffer] = {memory, length};
    return true;
  }

  void setControls(lc::ControlList& list) {
    const lc::ControlInfoMap& known = camera_->controls();
    const std::lock_guard lock(mutex_);
    if (known.find(&lc::controls::AeEnable) != known.end()) list.set(lc::controls::AeEnable, false);
    if (known.find(&lc::controls::AwbEnable) != known.end()) list.set(lc::controls::AwbEnable, false);
    if (known.find(&lc::controls::ExposureTime) != known.end())
      list.set(lc::controls::ExposureTime, static_cast<std::int32_t>(std::lround(exposureS_ * 1e6)));
    if (known.find(&lc::controls::AnalogueGain) != known.end())
      list.set(lc::controls::AnalogueGain, static_cast<float>(gain_));
    if (known.find(&lc::controls::ColourGains) != known.end())
      list.set(lc::controls::ColourGains,
               lc::Span<const float, 2>({static_cast<float>(redGain_), static_cast<float>(blueGain_)}));
  }

  void disconnected() {
    if (sink_) sink_(cameraUnplugged(info_.name));
  }

  void completed(lc::Request* request) {
    if (request->status() == lc::Request::RequestCancelled) return;
    const lc::ControlList& said = request->metadata();
    for (const auto& [stream, buffer] : request->buffers()) {
      const lc::FrameMetadata& meta = buffer->metadata();
      Frame frame;
      frame.format = format_;
      frame.strideBytes = stream->configuration().stride;
      if (format_.layout == PixelLayout::Mjpeg) frame.strideBytes = 0;
      frame.metadata.sequence = meta.sequence;
      frame.metadata.damaged = meta.status == lc::FrameMetadata::FrameError;
      const auto found = mapped_.find(buffer);
      if (found != mapped_.end() && !meta.planes().empty()) {
        const std::size_t offset = buffer->planes()[0].offset;
        const auto* bytes = static_cast<const std::uint8_t*>(found->second.first) + offset;
        frame.bytes.assign(
            bytes, bytes + std::min<std::size_t>(meta.planes()[0].bytesused, found->second.second - offset));
      }
      if (said.contains(lc::controls::EXPOSURE_TIME))
        frame.metadata.exposureS = said.get(lc::controls::ExposureTime).value_or(0) * 1e-6;
      if (said.contains(lc::controls::ANALOGUE_GAIN))
        frame.metadata.gain = said.get(lc::controls::AnalogueGain).value_or(1.0f);
      if (const auto black = said.get(lc::controls::SensorBlackLevels)) frame.black = (*black)[0] / 65535.0;
      // SensorTimestamp: when the first row began; the buffer's: when the frame was there.
      if (const auto stamp = said.get(lc::controls::SensorTimestamp)) {
        frame.metadata.exposureStart = RigTime(std::chrono::nanoseconds(*stamp));
      } else {
        frame.metadata.exposureStart =
            RigTime(std::chrono::nanoseconds(meta.timestamp)) -
            std::chrono::nanoseconds(std::llround(1e9 * frame.metadata.exposureS.value_or(0)));
      }
      if (sink_) sink_(std::move(frame));
    }
    request->reuse(lc::Request::ReuseBuffers);
    setControls(request->controls());
    if (streaming_) camera_->queueRequest(request);
  }

  CameraInfo info_;
  std::shared_ptr<void> manager_;
  std::shared_ptr<lc::Camera> camera_;
  std::vector<FrameFormat> formats_;
  std::vector<lc::StreamRole> roles_;
  FrameFormat format_;
  std::unique_ptr<lc::CameraConfiguration> configuration_;
  std::unique_ptr<lc::FrameBufferAllocator> allocator_;
  std::vector<std::unique_ptr<lc::Request>> requests_;
  std::map<const lc::FrameBuffer*, std::pair<void*, std::size_t>> mapped_;
  FrameSink sink_;
  std::atomic<bool> streaming_{false};
  std::mutex mutex_;
  double exposureS_ = 0.01, gain_ = 1, redGain_ = 1, blueGain_ = 1;
};

}  // namespace

struct LibcameraProvider::State {
  std::shared_ptr<lc::CameraManager> manager;
  int failed = 0;
};

LibcameraProvider::LibcameraProvider() : state_(std::make_shared<State>()) {}
LibcameraProvider::~LibcameraProvider() = default;

Result<std::vector<CameraInfo>> LibcameraProvider::list() {
  if (!state_->manager) {
    // One manager a process is what the library allows; it logs to stderr by itself.
    static std::mutex mutex;
    static std::weak_ptr<lc::CameraManager> shared;
    const std::lock_guard lock(mutex);
    state_->manager = shared.lock();
    if (!state_->manager) {
      lc::logSetTarget(lc::LoggingTargetNone);
      state_->manager =
          std::shared_ptr<lc::CameraManager>(new lc::CameraManager, [](lc::CameraManager* manager) {
            manager->stop();
            delete manager;
          });
      if (const int code = state_->manager->start(); code != 0) {
        state_->manager.reset();
        return Error{ErrorCode::Refused, "libcamera can't be started: error " + std::to_string(-code), "",
                     "use V4L2 (v4l2:...) instead"};
      }
      shared = state_->manager;
    }
  }
  std::vector<CameraInfo> cameras;
  for (const std::shared_ptr<lc::Camera>& camera : state_->manager->cameras()) {
    const auto model = camera->properties().get(lc::properties::Model);
    cameras.push_back({kPrefix + camera->id(), model ? std::string(*model) : camera->id(), backend(), ""});
  }
  return cameras;
}

Result<std::unique_ptr<CameraDevice>> LibcameraProvider::open(const std::string& id) {
  const Result<std::vector<CameraInfo>> cameras = list();
  if (!cameras) return cameras.error();
  const auto found = std::ranges::find(*cameras, id, &CameraInfo::id);
  if (found == cameras->end())
    return Error{ErrorCode::NotFound, inQuotes(id) + " isn't there", "",
                 "plug it in, or choose another (patina-cli capture --list)"};
  auto camera = std::make_unique<LibcameraCamera>(
      *found, state_->manager, state_->manager->get(id.substr(std::string(kPrefix).size())));
  if (Status begun = camera->begin(); !begun) return begun.error();
  return std::unique_ptr<CameraDevice>(std::move(camera));
}

}  // namespace patina
