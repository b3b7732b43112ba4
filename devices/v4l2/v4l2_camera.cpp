#include "devices/v4l2/v4l2_camera.h"

#include <linux/videodev2.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <map>
#include <optional>
#include <thread>

#include "devices/v4l2/v4l2_formats.h"
#include "devices/v4l2/v4l2_node.h"
#include "engine/base/text.h"

namespace patina {

using namespace v4l2;

namespace {

constexpr unsigned kBuffers = 4;
constexpr double kAbsoluteUnitS = 1e-4;  ///< V4L2_CID_EXPOSURE_ABSOLUTE: a ten-thousandth of a second
constexpr auto kFirstFrame = std::chrono::seconds(8);  ///< a camera that wakes up takes a while
constexpr int kMostFormats = 64, kMostSizes = 64;

/// A V4L2 control behind one of ours.
struct Known {
  CameraControlId id;
  std::uint32_t cid;
  double unit;  ///< ours = theirs * unit
};

class V4l2Camera : public CameraDevice {
 public:
  V4l2Camera(CameraInfo info, Descriptor descriptor, int settleFrames)
      : info_(std::move(info)),
        descriptor_(std::move(descriptor)),
        settleFrames_(settleFrames),
        wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}
  ~V4l2Camera() override { stop(); }

  const CameraInfo& info() const override { return info_; }
  bool streaming() const override { return thread_.joinable(); }
  FrameFormat format() const override { return format_; }

  Status begin() {
    const Result<std::vector<FrameFormat>> all = formats();
    if (!all) return all.error();
    if (all->empty())
      return Error{ErrorCode::Unsupported, "this camera offers no format that Patina reads", info_.name,
                   "use another camera; raw Bayer, grey, YUYV and motion JPEG are understood"};
    findControls();
    return setFormat(all->front());
  }

  Result<std::vector<FrameFormat>> formats() override {
    std::vector<FrameFormat> all;
    for (unsigned index = 0; index < kMostFormats; ++index) {
      v4l2_fmtdesc description{};
      description.index = index;
      description.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
      if (const int code = control(descriptor_.get(), VIDIOC_ENUM_FMT, &description); code != 0) {
        if (code != EINVAL) return failure(code, "listing its formats");
        break;
      }
      const auto layout = layoutOfPixelFormat(description.pixelformat);
      if (!layout) continue;
      for (unsigned size = 0; size < kMostSizes; ++size) {
        v4l2_frmsizeenum sizes{};
        sizes.index = size;
        sizes.pixel_format = description.pixelformat;
        if (control(descriptor_.get(), VIDIOC_ENUM_FRAMESIZES, &sizes) != 0) break;
        FrameFormat format;
        format.layout = layout->layout;
        format.bayer = layout->bayer;
        const bool discrete = sizes.type == V4L2_FRMSIZE_TYPE_DISCRETE;
        format.size = discrete ? ImageSize{static_cast<int>(sizes.discrete.width),
                                           static_cast<int>(sizes.discrete.height)}
                               : ImageSize{static_cast<int>(sizes.stepwise.max_width),
                                           static_cast<int>(sizes.stepwise.max_height)};
        format.framesPerSecond = fastest(description.pixelformat, format.size);
        format.name = textOf(description.description, sizeof description.description) + " " +
                      std::to_string(format.size.width) + " x " + std::to_string(format.size.height);
        all.push_back(format);
        if (!discrete) break;
      }
    }
    // Linear ones first, of these the finest, then the largest.
    std::ranges::stable_sort(all, [](const FrameFormat& a, const FrameFormat& b) {
      const auto rank = [](const FrameFormat& f) {
        const int kind = isLinear(f.layout) ? 2 : f.layout == PixelLayout::Yuyv ? 1 : 0;
        return std::tuple(kind, kind == 2 ? bitsOf(f.layout) : 0, std::int64_t{f.size.width} * f.size.height);
      };
      return rank(a) > rank(b);
    });
    return all;
  }

  Status setFormat(const FrameFormat& wanted) override {
    if (streaming())
      return Error{ErrorCode::Refused, "the format can't change while pictures come", info_.name,
                   "stop the live picture first"};
    v4l2_format request{};
    request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    request.fmt.pix.width = static_cast<unsigned>(wanted.size.width);
    request.fmt.pix.height = static_cast<unsigned>(wanted.size.height);
    request.fmt.pix.pixelformat = pixelFormatOfLayout(wanted.layout, wanted.bayer);
    request.fmt.pix.field = V4L2_FIELD_NONE;
    if (const int code = control(descriptor_.get(), VIDIOC_S_FMT, &request); code != 0)
      return failure(code, "choosing a format");
    const v4l2_pix_format& got = request.fmt.pix;
    const auto layout = layoutOfPixelFormat(got.pixelformat);
    if (!layout || layout->layout != wanted.layout || layout->bayer != wanted.bayer ||
        static_cast<int>(got.width) != wanted.size.width ||
        static_cast<int>(got.height) != wanted.size.height)
      return Error{ErrorCode::Refused, "the camera doesn't take the format " + inQuotes(wanted.name),
                   info_.name, "choose one that it lists"};
    format_ = wanted;
    stride_ = wanted.layout == PixelLayout::Mjpeg ? 0 : got.bytesperline;
    return Done{};
  }

  Result<std::vector<CameraControl>> controls() override {
    std::vector<CameraControl> list;
    for (const Known& known : known_) {
      const Result<CameraControl> one = read(known);
      if (!one) {
        if (one.error().code == ErrorCode::NotFound) return one.error();
        continue;
      }
      list.push_back(*one);
    }
    return list;
  }

  Result<double> set(CameraControlId id, double value) override {
    const auto known = std::ranges::find(known_, id, &Known::id);
    if (known == known_.end())
      return Error{ErrorCode::Unsupported, "this camera's " + controlName(id) + " can't be set by a program",
                   info_.name, "set it on the camera itself, or use a camera that can"};
    if (Status off = switchOffAutomatic(id); !off) return off.error();
    const Result<CameraControl> before = read(*known);
    if (!before) return before.error();
    if (!(value >= before->least - 1e-9 && value <= before->most + 1e-9)) {
      char text[160];
      std::snprintf(text, sizeof text, "the %s must lie in %.6g to %.6g %s, and %.6g was asked for",
                    controlName(id).c_str(), before->least, before->most, controlUnit(id).c_str(), value);
      return Error{ErrorCode::Invalid, text, info_.name, "choose a value in that range"};
    }
    const Result<double> kept = write(*known, value);
    if (!kept) return kept;
    const double slack = std::max(before->step, 0.02 * std::abs(value)) + 1e-12;
    if (std::abs(*kept - value) > slack) {
      char text[200];
      std::snprintf(text, sizeof text, "the camera keeps its %s at %.6g %s, and %.6g was asked for",
                    controlName(id).c_str(), *kept, controlUnit(id).c_str(), value);
      return Error{
          ErrorCode::Refused, text, info_.name,
          "switch its automatic off (perhaps by its own program), or use a camera with manual settings"};
    }
    const std::lock_guard lock(settingMutex_);
    settledFrom_ = sequence_ + static_cast<std::uint64_t>(settleFrames_) + 1;
    return *kept;
  }

  Status start(FrameSink sink) override {
    stop();
    v4l2_requestbuffers request{};
    request.count = kBuffers;
    request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    request.memory = V4L2_MEMORY_MMAP;
    if (const int code = control(descriptor_.get(), VIDIOC_REQBUFS, &request); code != 0)
      return failure(code, "asking for buffers");
    if (request.count < 2)
      return Error{ErrorCode::Refused, "the camera has no memory for pictures", info_.name,
                   "choose a smaller format"};
    for (unsigned i = 0; i < request.count; ++i) {
      v4l2_buffer buffer = emptyBuffer(i);
      int code = control(descriptor_.get(), VIDIOC_QUERYBUF, &buffer);
      void* memory = MAP_FAILED;
      if (code == 0) {
        memory = ::mmap(nullptr, buffer.length, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor_.get(),
                        buffer.m.offset);
        if (memory == MAP_FAILED) code = errno;
      }
      if (code != 0) {
        release();
        return failure(code, "mapping its pictures");
      }
      mapped_.push_back({memory, buffer.length});
      buffer = emptyBuffer(i);
      if (code = control(descriptor_.get(), VIDIOC_QBUF, &buffer); code != 0) {
        release();
        return failure(code, "queueing a buffer");
      }
    }
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    if (const int code = control(descriptor_.get(), VIDIOC_STREAMON, &type); code != 0) {
      release();
      return failure(code, "starting");
    }
    // What is in force now: the first frames of a new stream may still be older.
    readInForce();
    {
      const std::lock_guard lock(settingMutex_);
      sequence_ = 0;
      settledFrom_ = static_cast<std::uint64_t>(settleFrames_);
    }
    thread_ =
        std::jthread([this, sink = std::move(sink)](const std::stop_token& token) { run(token, sink); });
    return Done{};
  }

  void stop() override {
    if (!thread_.joinable()) return;
    thread_.request_stop();
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t woken = ::write(wake_.get(), &one, sizeof one);
    thread_.join();
    thread_ = {};
    std::uint64_t drained = 0;
    [[maybe_unused]] const ssize_t emptied = ::read(wake_.get(), &drained, sizeof drained);
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    control(descriptor_.get(), VIDIOC_STREAMOFF, &type);
    release();
  }

 private:
  struct Mapped {
    void* memory;
    std::size_t length;
  };

  static v4l2_buffer emptyBuffer(unsigned index) {
    v4l2_buffer buffer{};
    buffer.index = index;
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = V4L2_MEMORY_MMAP;
    return buffer;
  }

  void release() {
    for (const Mapped& mapped : mapped_) ::munmap(mapped.memory, mapped.length);
    mapped_.clear();
    v4l2_requestbuffers request{};
    request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    request.memory = V4L2_MEMORY_MMAP;
    control(descriptor_.get(), VIDIOC_REQBUFS, &request);
  }

  Error failure(int code, const std::string& doing) const {
    if (code == EBUSY) return cameraBusy(info_.name);
    if (isGone(code)) return cameraUnplugged(info_.name);
    return Error{ErrorCode::Refused, "the camera's driver fails at " + doing + ": " + std::strerror(code),
                 info_.name, "plug the camera in again, or choose another format"};
  }

  double fastest(std::uint32_t pixelFormat, ImageSize size) const {
    v4l2_frmivalenum interval{};
    interval.pixel_format = pixelFormat;
    interval.width = static_cast<unsigned>(size.width);
    interval.height = static_cast<unsigned>(size.height);
    double best = 0;
    for (unsigned i = 0; i < kMostSizes; ++i) {
      interval.index = i;
      if (control(descriptor_.get(), VIDIOC_ENUM_FRAMEINTERVALS, &interval) != 0) break;
      const bool discrete = interval.type == V4L2_FRMIVAL_TYPE_DISCRETE;
      const v4l2_fract& shortest = discrete ? interval.discrete : interval.stepwise.min;
      if (shortest.numerator > 0)
        best = std::max(best, static_cast<double>(shortest.denominator) / shortest.numerator);
      if (!discrete) break;
    }
    return best;
  }

  // ---- controls ----

  std::optional<v4l2_queryctrl> query(std::uint32_t cid) const {
    v4l2_queryctrl description{};
    description.id = cid;
    if (control(descriptor_.get(), VIDIOC_QUERYCTRL, &description) != 0 ||
        description.flags & V4L2_CTRL_FLAG_DISABLED)
      return {};
    return description;
  }
  void findControls() {
    known_.clear();
    const auto add = [&](CameraControlId id, std::uint32_t cid, double unit) {
      const bool have = std::ranges::any_of(known_, [&](const Known& known) { return known.id == id; });
      if (!have && query(cid)) known_.push_back({id, cid, unit});
    };
    add(CameraControlId::ExposureS, V4L2_CID_EXPOSURE_ABSOLUTE, kAbsoluteUnitS);
    add(CameraControlId::ExposureS, V4L2_CID_EXPOSURE, kAbsoluteUnitS);
    add(CameraControlId::Gain, V4L2_CID_ANALOGUE_GAIN, 1);
    add(CameraControlId::Gain, V4L2_CID_GAIN, 1);
    add(CameraControlId::WhiteBalanceK, V4L2_CID_WHITE_BALANCE_TEMPERATURE, 1);
    add(CameraControlId::RedGain, V4L2_CID_RED_BALANCE, 1);
    add(CameraControlId::BlueGain, V4L2_CID_BLUE_BALANCE, 1);
    add(CameraControlId::Focus, V4L2_CID_FOCUS_ABSOLUTE, 1);
    add(CameraControlId::PowerLineHz, V4L2_CID_POWER_LINE_FREQUENCY, 1);
    add(CameraControlId::AutoExposure, V4L2_CID_EXPOSURE_AUTO, 1);
    add(CameraControlId::AutoWhiteBalance, V4L2_CID_AUTO_WHITE_BALANCE, 1);
    add(CameraControlId::AutoFocus, V4L2_CID_FOCUS_AUTO, 1);
  }

  double fromDevice(const Known& known, int value) const {
    if (known.id == CameraControlId::PowerLineHz)
      return value == V4L2_CID_POWER_LINE_FREQUENCY_50HZ   ? 50
             : value == V4L2_CID_POWER_LINE_FREQUENCY_60HZ ? 60
                                                           : 0;
    if (known.id == CameraControlId::AutoExposure)
      return value == V4L2_EXPOSURE_MANUAL || value == V4L2_EXPOSURE_SHUTTER_PRIORITY ? 0 : 1;
    return value * known.unit;
  }
  /// Where a value in our unit has no counterpart in theirs: none.
  std::optional<int> toDevice(const Known& known, double value) const {
    if (known.id == CameraControlId::PowerLineHz) {
      if (value == 50) return V4L2_CID_POWER_LINE_FREQUENCY_50HZ;
      if (value == 60) return V4L2_CID_POWER_LINE_FREQUENCY_60HZ;
      return value == 0 ? std::optional<int>(V4L2_CID_POWER_LINE_FREQUENCY_DISABLED) : std::nullopt;
    }
    if (known.id == CameraControlId::AutoExposure) {
      // The menu need not have every mode: take the first that means it.
      for (const int mode : value > 0
                                ? std::vector<int>{V4L2_EXPOSURE_AUTO, V4L2_EXPOSURE_APERTURE_PRIORITY}
                                : std::vector<int>{V4L2_EXPOSURE_MANUAL, V4L2_EXPOSURE_SHUTTER_PRIORITY}) {
        v4l2_querymenu item{};
        item.id = known.cid;
        item.index = static_cast<unsigned>(mode);
        if (control(descriptor_.get(), VIDIOC_QUERYMENU, &item) == 0) return mode;
      }
      return {};
    }
    return static_cast<int>(std::lround(value / known.unit));
  }

  Result<CameraControl> read(const Known& known) const {
    v4l2_queryctrl description{};
    description.id = known.cid;
    if (const int code = control(descriptor_.get(), VIDIOC_QUERYCTRL, &description); code != 0)
      return failure(code, "reading its " + controlName(known.id));
    v4l2_control value{};
    value.id = known.cid;
    if (const int code = control(descriptor_.get(), VIDIOC_G_CTRL, &value); code != 0)
      return failure(code, "reading its " + controlName(known.id));
    CameraControl one;
    one.id = known.id;
    one.value = fromDevice(known, value.value);
    const bool menu = known.id == CameraControlId::PowerLineHz || known.id == CameraControlId::AutoExposure;
    one.least = menu ? 0 : description.minimum * known.unit;
    one.most = known.id == CameraControlId::PowerLineHz ? 60 : menu ? 1 : description.maximum * known.unit;
    one.step = menu ? 0 : description.step * known.unit;
    one.writable =
        !(description.flags & (V4L2_CTRL_FLAG_READ_ONLY | V4L2_CTRL_FLAG_INACTIVE | V4L2_CTRL_FLAG_GRABBED));
    return one;
  }

  Result<double> write(const Known& known, double value) {
    const std::optional<int> theirs = toDevice(known, value);
    if (!theirs)
      return Error{ErrorCode::Unsupported, "this camera has no such setting of its " + controlName(known.id),
                   info_.name,
                   known.id == CameraControlId::AutoExposure
                       ? "use a camera with manual exposure, or lock the exposure by the camera's own program"
                       : "leave it as it is"};
    v4l2_control setting{};
    setting.id = known.cid;
    setting.value = *theirs;
    if (const int code = control(descriptor_.get(), VIDIOC_S_CTRL, &setting); code != 0 && code != ERANGE) {
      if (code == EBUSY || isGone(code)) return failure(code, "setting its " + controlName(known.id));
      return Error{ErrorCode::Refused,
                   "the camera refuses to set its " + controlName(known.id) + ": " + std::strerror(code),
                   info_.name, "switch its automatic off, or use a camera with manual settings"};
    }
    v4l2_control back{};
    back.id = known.cid;
    if (const int code = control(descriptor_.get(), VIDIOC_G_CTRL, &back); code != 0)
      return failure(code, "reading back its " + controlName(known.id));
    const double inForce = fromDevice(known, back.value);
    const std::lock_guard lock(settingMutex_);
    if (known.id == CameraControlId::ExposureS) exposureS_ = inForce;
    if (known.id == CameraControlId::Gain) gain_ = inForce;
    return inForce;
  }

  /// Some automatics must be off before the value that they move can be set.
  Status switchOffAutomatic(CameraControlId id) {
    CameraControlId automatic;
    switch (id) {
      case CameraControlId::ExposureS:
      case CameraControlId::Gain:
        automatic = CameraControlId::AutoExposure;
        break;
      case CameraControlId::WhiteBalanceK:
      case CameraControlId::RedGain:
      case CameraControlId::BlueGain:
        automatic = CameraControlId::AutoWhiteBalance;
        break;
      case CameraControlId::Focus:
        automatic = CameraControlId::AutoFocus;
        break;
      default:
        return Done{};
    }
    if (id == CameraControlId::Gain && query(V4L2_CID_AUTOGAIN)) {
      v4l2_control off{};
      off.id = V4L2_CID_AUTOGAIN;
      if (const int code = control(descriptor_.get(), VIDIOC_S_CTRL, &off); isGone(code))
        return failure(code, "switching automatic gain off");
    }
    const auto known = std::ranges::find(known_, automatic, &Known::id);
    if (known == known_.end()) return Done{};
    const Result<double> off = write(*known, 0);
    if (!off) return off.error();
    if (*off != 0)
      return Error{ErrorCode::Refused, "the camera doesn't switch its " + controlName(automatic) + " off",
                   info_.name, "use a camera with manual settings"};
    return Done{};
  }

  void readInForce() {
    for (const Known& known : known_) {
      const Result<CameraControl> one = read(known);
      const std::lock_guard lock(settingMutex_);
      if (one && known.id == CameraControlId::ExposureS) exposureS_ = one->value;
      if (one && known.id == CameraControlId::Gain) gain_ = one->value;
    }
  }

  // ---- frames ----

  void run(const std::stop_token& token, const FrameSink& sink) {
    while (!token.stop_requested()) {
      double exposureS = 0;
      {
        const std::lock_guard lock(settingMutex_);
        exposureS = exposureS_.value_or(0.5);
      }
      const auto patience = kFirstFrame + std::chrono::milliseconds(static_cast<int>(3000 * exposureS));
      pollfd sources[2] = {{descriptor_.get(), POLLIN, 0}, {wake_.get(), POLLIN, 0}};
      const int ready =
          ::poll(sources, 2,
                 static_cast<int>(std::chrono::duration_cast<std::chrono::milliseconds>(patience).count()));
      if (token.stop_requested()) return;
      if (ready < 0 && errno == EINTR) continue;
      if (ready == 0) {
        sink(noFrameInTime(info_.name, std::chrono::duration_cast<std::chrono::milliseconds>(patience)));
        return;
      }
      v4l2_buffer buffer = emptyBuffer(0);
      const int code = control(descriptor_.get(), VIDIOC_DQBUF, &buffer);
      if (code == EAGAIN) {
        if (sources[0].revents & (POLLERR | POLLHUP)) {
          sink(cameraUnplugged(info_.name));
          return;
        }
        continue;
      }
      if (code != 0) {
        sink(failure(code, "sending a picture"));
        return;
      }
      sink(frameOf(buffer));
      v4l2_buffer again = emptyBuffer(buffer.index);
      if (const int queued = control(descriptor_.get(), VIDIOC_QBUF, &again); queued != 0) {
        sink(failure(queued, "queueing a buffer"));
        return;
      }
    }
  }

  Frame frameOf(const v4l2_buffer& buffer) {
    Frame frame;
    frame.format = format_;
    frame.strideBytes = stride_;
    const Mapped& mapped = mapped_[std::min<std::size_t>(buffer.index, mapped_.size() - 1)];
    const auto* bytes = static_cast<const std::uint8_t*>(mapped.memory);
    frame.bytes.assign(bytes, bytes + std::min<std::size_t>(buffer.bytesused, mapped.length));
    frame.metadata.damaged = buffer.flags & V4L2_BUF_FLAG_ERROR;
    const std::lock_guard lock(settingMutex_);
    sequence_ = buffer.sequence;
    frame.metadata.sequence = buffer.sequence;
    if (buffer.sequence >= settledFrom_) {
      frame.metadata.exposureS = exposureS_;
      frame.metadata.gain = gain_;
    }
    const bool monotonic = (buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    RigTime stamp = monotonic ? RigTime(std::chrono::seconds(buffer.timestamp.tv_sec) +
                                        std::chrono::microseconds(buffer.timestamp.tv_usec))
                              : std::chrono::steady_clock::now();
    // A stamp of the exposure's beginning is that; one of the frame's end lies an exposure and its readout
    // later.
    if (!monotonic || (buffer.flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) != V4L2_BUF_FLAG_TSTAMP_SRC_SOE) {
      const double readoutS = format_.framesPerSecond > 0 ? 1 / format_.framesPerSecond : 0;
      stamp -= std::chrono::nanoseconds(std::llround(1e9 * (exposureS_.value_or(0) + readoutS)));
    }
    frame.metadata.exposureStart = stamp;
    return frame;
  }

  CameraInfo info_;
  Descriptor descriptor_;
  int settleFrames_;
  Descriptor wake_;
  FrameFormat format_;
  std::size_t stride_ = 0;
  std::vector<Known> known_;
  std::vector<Mapped> mapped_;
  std::jthread thread_;

  std::mutex settingMutex_;
  std::optional<double> exposureS_, gain_;
  std::uint64_t sequence_ = 0, settledFrom_ = 0;
};

}  // namespace

Result<std::vector<CameraInfo>> V4l2Provider::list() {
  std::vector<CameraInfo> cameras;
  for (const Node& node : nodes())
    cameras.push_back({node.id, node.name + " (" + node.path + ")", backend(), ""});
  return cameras;
}

Result<std::unique_ptr<CameraDevice>> V4l2Provider::open(const std::string& id) {
  std::string path;
  std::string name = id;
  if (id.starts_with(std::string(kIdPrefix) + "/dev/")) path = id.substr(std::string(kIdPrefix).size());
  for (const Node& node : nodes())
    if (node.id == id || node.path == path) {
      path = node.path;
      name = node.name;
    }
  if (path.empty())
    return Error{ErrorCode::NotFound, inQuotes(id) + " isn't plugged in", "",
                 "plug it in, or choose another (patina-cli capture --list)"};
  Result<Descriptor> descriptor = openNode(path);
  if (!descriptor) return descriptor.error();
  auto camera = std::make_unique<V4l2Camera>(CameraInfo{id, name, backend(), ""}, std::move(*descriptor),
                                             settleFrames_);
  if (Status begun = camera->begin(); !begun) return begun.error();
  return std::unique_ptr<CameraDevice>(std::move(camera));
}

}  // namespace patina
