#include "tests/devices/v4l2/fake_device.h"

#include <errno.h>
#include <sys/mman.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iterator>

namespace patina::test {
namespace {

const Format kFormats[] = {{V4L2_PIX_FMT_YUYV, "YUYV 4:2:2", 2, false},
                           {V4L2_PIX_FMT_SRGGB10, "10-bit Bayer RGRG/GBGB", 2, false},
                           {V4L2_PIX_FMT_SRGGB8, "8-bit Bayer RGRG/GBGB", 1, false},
                           {V4L2_PIX_FMT_SRGGB12, "12-bit Bayer RGRG/GBGB", 2, false},
                           {V4L2_PIX_FMT_SRGGB16, "16-bit Bayer RGRG/GBGB", 2, false},
                           {V4L2_PIX_FMT_GREY, "8-bit Greyscale", 1, false}};
const Size kSizes[] = {{64, 48}, {128, 96}};

const unsigned long kKnown[] = {VIDIOC_DQBUF,
                                VIDIOC_DQEVENT,
                                VIDIOC_ENUMINPUT,
                                VIDIOC_ENUM_FMT,
                                VIDIOC_ENUM_FRAMEINTERVALS,
                                VIDIOC_ENUM_FRAMESIZES,
                                VIDIOC_G_CTRL,
                                VIDIOC_G_EXT_CTRLS,
                                VIDIOC_G_FMT,
                                VIDIOC_G_INPUT,
                                VIDIOC_G_PARM,
                                VIDIOC_G_PRIORITY,
                                VIDIOC_QBUF,
                                VIDIOC_QUERYBUF,
                                VIDIOC_QUERYCAP,
                                VIDIOC_QUERYCTRL,
                                VIDIOC_QUERYMENU,
                                VIDIOC_QUERY_EXT_CTRL,
                                VIDIOC_REQBUFS,
                                VIDIOC_STREAMOFF,
                                VIDIOC_STREAMON,
                                VIDIOC_SUBSCRIBE_EVENT,
                                VIDIOC_S_CTRL,
                                VIDIOC_S_EXT_CTRLS,
                                VIDIOC_S_FMT,
                                VIDIOC_S_INPUT,
                                VIDIOC_S_PARM,
                                VIDIOC_S_PRIORITY,
                                VIDIOC_TRY_EXT_CTRLS,
                                VIDIOC_TRY_FMT,
                                VIDIOC_UNSUBSCRIBE_EVENT};

std::string words() {
  const char* text = getenv("PATINA_FAKE_CAMERA");
  return std::string(" ") + (text ? text : "") + " ";
}
}  // namespace

bool said(const char* word) {
  return words().find(std::string(" ") + word + " ") != std::string::npos;
}
int number(const char* key, int fallback) {
  const std::string all = words();
  const std::size_t at = all.find(std::string(" ") + key + "=");
  return at == std::string::npos ? fallback : atoi(all.c_str() + at + strlen(key) + 2);
}

Device::Device() {
  reset();
}

void Device::reset() {
  format = kFormats[0];
  size = kSizes[0];
  sequence = delivered = 0;
  pending.clear();
  subscribed.clear();
  events.clear();
  eventNumber.clear();
  priorities.clear();
  const bool old = said("old-exposure");
  controls = {
      {V4L2_CID_BRIGHTNESS, V4L2_CTRL_TYPE_INTEGER, "Brightness", 0, 255, 1, 128, 128},
      {V4L2_CID_AUTO_WHITE_BALANCE, V4L2_CTRL_TYPE_BOOLEAN, "White Balance, Automatic", 0, 1, 1, 1, 1},
      {V4L2_CID_GAIN, V4L2_CTRL_TYPE_INTEGER, "Gain", 1, 16, 1, 1, 1},
      {V4L2_CID_POWER_LINE_FREQUENCY, V4L2_CTRL_TYPE_MENU, "Power Line Frequency", 0, 2, 1, 1, 1},
      {V4L2_CID_WHITE_BALANCE_TEMPERATURE, V4L2_CTRL_TYPE_INTEGER, "White Balance Temperature", 2800, 6500,
       10, 4600, 4600}};
  if (old) controls.push_back({V4L2_CID_EXPOSURE, V4L2_CTRL_TYPE_INTEGER, "Exposure", 1, 5000, 1, 100, 100});
  if (!old) {
    controls.push_back({V4L2_CID_EXPOSURE_AUTO, V4L2_CTRL_TYPE_MENU, "Auto Exposure", 0, 3, 1, 3, 3});
    controls.push_back({V4L2_CID_EXPOSURE_ABSOLUTE, V4L2_CTRL_TYPE_INTEGER, "Exposure Time, Absolute", 1,
                        5000, 1, 100, 100});
  }
  controls.push_back({V4L2_CID_FOCUS_ABSOLUTE, V4L2_CTRL_TYPE_INTEGER, "Focus, Absolute", 0, 250, 5, 0, 0});
  controls.push_back(
      {V4L2_CID_FOCUS_AUTO, V4L2_CTRL_TYPE_BOOLEAN, "Focus, Automatic Continuous", 0, 1, 1, 1, 1});
  controls.push_back({V4L2_CID_USER_CLASS, V4L2_CTRL_TYPE_CTRL_CLASS, "User Controls", 0, 0, 0, 0, 0});
  controls.push_back({V4L2_CID_CAMERA_CLASS, V4L2_CTRL_TYPE_CTRL_CLASS, "Camera Controls", 0, 0, 0, 0, 0});
  std::sort(controls.begin(), controls.end(), [](const Control& a, const Control& b) { return a.id < b.id; });
  inForce = light();
}

Device& device() {
  static Device one;
  return one;
}

double now() {
  timespec time{};
  clock_gettime(CLOCK_MONOTONIC, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// ---- pictures ----

void paint(Device& d, Buffer& buffer) {
  const double light = d.inForce;
  const auto sample = [&](unsigned x, unsigned most) {
    const double ramp = 0.2 + 0.6 * x / (d.size.width - 1);
    return static_cast<unsigned>(std::lround(std::min(1.0, light * ramp) * most));
  };
  auto* bytes = static_cast<std::uint8_t*>(buffer.memory);
  for (unsigned y = 0; y < d.size.height; ++y)
    for (unsigned x = 0; x < d.size.width; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * d.size.width + x;
      unsigned most = 255;
      switch (d.format.code) {
        case V4L2_PIX_FMT_SRGGB10:
          most = 1023;
          break;
        case V4L2_PIX_FMT_SRGGB12:
          most = 4095;
          break;
        case V4L2_PIX_FMT_SRGGB16:
          most = 65535;
          break;
        default:
          break;
      }
      if (d.format.code == V4L2_PIX_FMT_YUYV) {
        bytes[2 * at] = static_cast<std::uint8_t>(16 + sample(x, 219));
        bytes[2 * at + 1] = 128;
      } else if (d.format.bytesPerPixel == 1) {
        bytes[at] = static_cast<std::uint8_t>(sample(x, 255));
      } else {
        const unsigned value = sample(x, most);
        bytes[2 * at] = static_cast<std::uint8_t>(value & 255);
        bytes[2 * at + 1] = static_cast<std::uint8_t>(value >> 8);
      }
    }
  buffer.used = static_cast<unsigned>(d.imageBytes());
}

/// Fills buffers for the frames whose time has come.
void produce(Device& d) {
  if (!d.streaming || said("no-frames")) return;
  const double period = static_cast<double>(d.intervalNumerator) / d.intervalDenominator;
  while (now() >= d.nextFrame && !d.unplugged()) {
    d.nextFrame += period;
    if (now() - d.nextFrame > 1) d.nextFrame = now();
    const unsigned number_ = d.sequence++;
    while (!d.pending.empty() && d.pending.front().first <= static_cast<int>(number_)) {
      d.inForce = d.pending.front().second;
      d.pending.pop_front();
    }
    const int lose = number("lose", 0), damage = number("damage", 0);
    if (lose > 0 && number_ % static_cast<unsigned>(lose) == static_cast<unsigned>(lose) - 1) continue;
    if (d.waiting.empty()) continue;  // nobody gave a buffer: the frame is lost
    Buffer& buffer = d.buffers[d.waiting.front()];
    d.waiting.pop_front();
    paint(d, buffer);
    buffer.sequence = number_;
    buffer.damaged =
        damage > 0 && number_ % static_cast<unsigned>(damage) == static_cast<unsigned>(damage) - 1;
    clock_gettime(CLOCK_MONOTONIC, &buffer.stamp);
    buffer.queued = false;
    buffer.done = true;
    ++d.delivered;
  }
}

int firstDone(Device& d) {
  int best = -1;
  for (std::size_t i = 0; i < d.buffers.size(); ++i)
    if (d.buffers[i].done &&
        (best < 0 || d.buffers[i].sequence < d.buffers[static_cast<std::size_t>(best)].sequence))
      best = static_cast<int>(i);
  return best;
}

void describe(Device& d, unsigned index, v4l2_buffer* out) {
  const Buffer& buffer = d.buffers[index];
  const v4l2_buf_type type = static_cast<v4l2_buf_type>(out->type);
  memset(out, 0, sizeof *out);
  out->index = index;
  out->type = type;
  out->memory = V4L2_MEMORY_MMAP;
  out->length = static_cast<unsigned>(buffer.length);
  out->m.offset = static_cast<unsigned>(index * buffer.length);
  out->field = V4L2_FIELD_NONE;
  out->flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC |
               (said("eof-stamps") ? V4L2_BUF_FLAG_TSTAMP_SRC_EOF : V4L2_BUF_FLAG_TSTAMP_SRC_SOE);
  if (buffer.mapped) out->flags |= V4L2_BUF_FLAG_MAPPED;
  if (buffer.queued) out->flags |= V4L2_BUF_FLAG_QUEUED;
  if (buffer.done) out->flags |= V4L2_BUF_FLAG_DONE;
  if (buffer.done || buffer.sequence > 0) {
    out->sequence = buffer.sequence;
    out->bytesused = buffer.used;
    out->timestamp.tv_sec = buffer.stamp.tv_sec;
    out->timestamp.tv_usec = buffer.stamp.tv_nsec / 1000;
    if (buffer.damaged) out->flags |= V4L2_BUF_FLAG_ERROR;
  }
}

void stopStreaming(Device& d) {
  d.streaming = false;
  d.waiting.clear();
  for (Buffer& buffer : d.buffers) buffer.queued = buffer.done = false;
}

void freeBuffers(Device& d) {
  stopStreaming(d);
  for (Buffer& buffer : d.buffers)
    if (buffer.memory) munmap(buffer.memory, buffer.length);
  d.buffers.clear();
  if (d.memory >= 0) ::close(d.memory);
  d.memory = -1;
  d.streamer = -1;
}

int makeBuffers(Device& d, int descriptor, unsigned count) {
  const std::size_t page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  const std::size_t length = (d.imageBytes() + page - 1) / page * page;
  const std::size_t first = d.buffers.size();
  if (d.memory < 0) d.memory = memfd_create("fake-video", MFD_CLOEXEC);
  if (d.memory < 0 || ftruncate(d.memory, static_cast<off_t>((first + count) * length)) != 0) return ENOMEM;
  for (std::size_t i = first; i < first + count; ++i) {
    Buffer buffer;
    buffer.length = length;
    buffer.memory =
        ::mmap(nullptr, length, PROT_READ | PROT_WRITE, MAP_SHARED, d.memory, static_cast<off_t>(i * length));
    if (buffer.memory == MAP_FAILED) return ENOMEM;
    d.buffers.push_back(buffer);
  }
  d.streamer = descriptor;
  return 0;
}

// ---- ioctls ----

const Format* formatOf(std::uint32_t code) {
  for (const Format& format : kFormats)
    if (format.code == code) return &format;
  return nullptr;
}

void tryFormat(v4l2_pix_format& pix, Format* chosen, Size* size) {
  const Format* format = formatOf(pix.pixelformat);
  if (!format) format = &kFormats[0];
  Size best = kSizes[0];
  for (const Size& one : kSizes)
    if (one.width <= std::max(pix.width, kSizes[0].width)) best = one;
  memset(&pix, 0, sizeof pix);
  pix.width = best.width;
  pix.height = best.height;
  pix.pixelformat = format->code;
  pix.field = V4L2_FIELD_NONE;
  pix.bytesperline = best.width * format->bytesPerPixel;
  pix.sizeimage = pix.bytesperline * best.height;
  pix.colorspace = format->code == V4L2_PIX_FMT_YUYV || format->code == V4L2_PIX_FMT_GREY
                       ? V4L2_COLORSPACE_SRGB
                       : V4L2_COLORSPACE_RAW;
  if (chosen) *chosen = *format;
  if (size) *size = best;
}

void arm(Device& d) {
  for (const int descriptor : d.descriptors) {
    itimerspec when{};
    if (d.streaming && descriptor == d.streamer && !said("no-frames")) {
      const double at = firstDone(d) >= 0 || d.unplugged() ? 1e-9 : d.nextFrame;
      when.it_value.tv_sec = static_cast<time_t>(at);
      when.it_value.tv_nsec = std::max(1L, static_cast<long>(1e9 * (at - std::floor(at))));
    }
    timerfd_settime(descriptor, TFD_TIMER_ABSTIME, &when, nullptr);
  }
}

bool knows(unsigned long request) {
  for (const unsigned long one : kKnown)
    if (one == request) return true;
  return false;
}

int answer(Device& d, int descriptor, unsigned long request, void* argument) {
  if (d.unplugged() && request != VIDIOC_STREAMOFF && request != VIDIOC_REQBUFS) return ENODEV;
  switch (request) {
    case VIDIOC_QUERYCAP: {
      auto* capability = static_cast<v4l2_capability*>(argument);
      memset(capability, 0, sizeof *capability);
      strcpy(reinterpret_cast<char*>(capability->driver), "patinafake");
      strcpy(reinterpret_cast<char*>(capability->card), "Patina Fake Camera");
      strcpy(reinterpret_cast<char*>(capability->bus_info), "platform:fake-90");
      capability->version = 6 << 16 | 1 << 8;
      capability->device_caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING | V4L2_CAP_EXT_PIX_FORMAT;
      capability->capabilities = capability->device_caps | V4L2_CAP_DEVICE_CAPS;
      return 0;
    }
    case VIDIOC_ENUM_FMT: {
      auto* description = static_cast<v4l2_fmtdesc*>(argument);
      if (description->type != V4L2_BUF_TYPE_VIDEO_CAPTURE || description->index >= std::size(kFormats))
        return EINVAL;
      const unsigned index = description->index;
      memset(description, 0, sizeof *description);
      description->index = index;
      description->type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
      description->pixelformat = kFormats[index].code;
      strcpy(reinterpret_cast<char*>(description->description), kFormats[index].name);
      return 0;
    }
    case VIDIOC_ENUM_FRAMESIZES: {
      auto* sizes = static_cast<v4l2_frmsizeenum*>(argument);
      if (!formatOf(sizes->pixel_format) || sizes->index >= std::size(kSizes)) return EINVAL;
      sizes->type = V4L2_FRMSIZE_TYPE_DISCRETE;
      sizes->discrete = {kSizes[sizes->index].width, kSizes[sizes->index].height};
      memset(sizes->reserved, 0, sizeof sizes->reserved);
      return 0;
    }
    case VIDIOC_ENUM_FRAMEINTERVALS: {
      auto* interval = static_cast<v4l2_frmivalenum*>(argument);
      if (!formatOf(interval->pixel_format) || interval->index > 0) return EINVAL;
      if (std::none_of(std::begin(kSizes), std::end(kSizes), [&](const Size& s) {
            return s.width == interval->width && s.height == interval->height;
          }))
        return EINVAL;
      interval->type = V4L2_FRMIVAL_TYPE_DISCRETE;
      interval->discrete = {1, 100};
      memset(interval->reserved, 0, sizeof interval->reserved);
      return 0;
    }
    case VIDIOC_G_FMT: {
      auto* format = static_cast<v4l2_format*>(argument);
      if (format->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
      format->fmt.pix.pixelformat = d.format.code;
      format->fmt.pix.width = d.size.width;
      tryFormat(format->fmt.pix, nullptr, nullptr);
      return 0;
    }
    case VIDIOC_TRY_FMT:
    case VIDIOC_S_FMT: {
      auto* format = static_cast<v4l2_format*>(argument);
      if (format->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
      Format chosen;
      Size size;
      tryFormat(format->fmt.pix, &chosen, &size);
      if (request == VIDIOC_TRY_FMT) return 0;
      if (!d.buffers.empty()) return EBUSY;
      d.format = chosen;
      d.size = size;
      return 0;
    }
    case VIDIOC_G_PARM:
    case VIDIOC_S_PARM: {
      auto* parameters = static_cast<v4l2_streamparm*>(argument);
      if (parameters->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
      memset(&parameters->parm, 0, sizeof parameters->parm);
      parameters->parm.capture.capability = V4L2_CAP_TIMEPERFRAME;
      parameters->parm.capture.timeperframe = {d.intervalNumerator, d.intervalDenominator};
      parameters->parm.capture.readbuffers = 0;
      return 0;
    }
    case VIDIOC_ENUMINPUT: {
      auto* input = static_cast<v4l2_input*>(argument);
      if (input->index > 0) return EINVAL;
      memset(input, 0, sizeof *input);
      strcpy(reinterpret_cast<char*>(input->name), "Camera");
      input->type = V4L2_INPUT_TYPE_CAMERA;
      return 0;
    }
    case VIDIOC_G_INPUT:
      *static_cast<int*>(argument) = 0;
      return 0;
    case VIDIOC_S_INPUT:
      return *static_cast<int*>(argument) == 0 ? 0 : EINVAL;
    case VIDIOC_G_PRIORITY:
      *static_cast<v4l2_priority*>(argument) = static_cast<v4l2_priority>(d.highestPriority());
      return 0;
    case VIDIOC_S_PRIORITY: {
      const int wanted = *static_cast<v4l2_priority*>(argument);
      if (wanted < V4L2_PRIORITY_BACKGROUND || wanted > V4L2_PRIORITY_RECORD) return EINVAL;
      if (d.priorityOf(descriptor) < d.highestPriority()) return EBUSY;
      d.priorities[descriptor] = wanted;
      return 0;
    }
    // ---- events ----
    case VIDIOC_SUBSCRIBE_EVENT: {
      const auto* subscription = static_cast<v4l2_event_subscription*>(argument);
      const Control* control = d.find(subscription->id);
      if (subscription->type != V4L2_EVENT_CTRL || !control) return EINVAL;
      d.subscribed[descriptor].insert(control->id);
      // A class has no value to tell of.
      if (subscription->flags & V4L2_EVENT_SUB_FL_SEND_INITIAL && control->type != V4L2_CTRL_TYPE_CTRL_CLASS)
        d.events[descriptor].push_back(eventOf(d, *control));
      return 0;
    }
    case VIDIOC_UNSUBSCRIBE_EVENT: {
      const auto* subscription = static_cast<v4l2_event_subscription*>(argument);
      if (subscription->type == V4L2_EVENT_ALL)
        d.subscribed.erase(descriptor);
      else
        d.subscribed[descriptor].erase(subscription->id);
      return 0;
    }
    case VIDIOC_DQEVENT: {
      std::deque<v4l2_event>& events = d.events[descriptor];
      if (events.empty()) return ENOENT;
      v4l2_event event = events.front();
      events.pop_front();
      event.pending = static_cast<unsigned>(events.size());
      event.sequence = d.eventNumber[descriptor]++;
      *static_cast<v4l2_event*>(argument) = event;
      return 0;
    }
    // ---- controls ----
    case VIDIOC_QUERYCTRL: {
      auto* description = static_cast<v4l2_queryctrl*>(argument);
      Control* control = nullptr;
      if (const int code = queryControl(d, description->id, &control)) return code;
      memset(description, 0, sizeof *description);
      description->id = control->id;
      description->type = control->type;
      strcpy(reinterpret_cast<char*>(description->name), control->name);
      description->minimum = control->least;
      description->maximum = control->most;
      description->step = control->step;
      description->default_value = control->standard;
      description->flags = flagsOf(d, *control);
      return 0;
    }
    case VIDIOC_QUERY_EXT_CTRL: {
      auto* description = static_cast<v4l2_query_ext_ctrl*>(argument);
      Control* control = nullptr;
      if (const int code = queryControl(d, description->id, &control)) return code;
      memset(description, 0, sizeof *description);
      description->id = control->id;
      description->type = control->type;
      strcpy(description->name, control->name);
      description->minimum = control->least;
      description->maximum = control->most;
      description->step = static_cast<unsigned>(control->step);
      description->default_value = control->standard;
      description->flags = flagsOf(d, *control);
      description->elem_size = 4;
      description->elems = 1;
      return 0;
    }
    case VIDIOC_QUERYMENU: {
      auto* item = static_cast<v4l2_querymenu*>(argument);
      const Control* control = d.find(item->id);
      if (!control || control->type != V4L2_CTRL_TYPE_MENU || static_cast<int>(item->index) > control->most ||
          !d.menuHas(*control, static_cast<int>(item->index)))
        return EINVAL;
      const std::uint32_t id = item->id, index = item->index;
      memset(item, 0, sizeof *item);
      item->id = id;
      item->index = index;
      snprintf(reinterpret_cast<char*>(item->name), sizeof item->name, "Item %u", index);
      return 0;
    }
    case VIDIOC_G_CTRL: {
      auto* value = static_cast<v4l2_control*>(argument);
      const Control* control = d.find(value->id);
      if (!control) return EINVAL;
      if (control->type == V4L2_CTRL_TYPE_CTRL_CLASS) return EACCES;
      value->value = control->value;
      return 0;
    }
    case VIDIOC_S_CTRL: {
      auto* value = static_cast<v4l2_control*>(argument);
      if (const int code = setControl(d, value->id, value->value, true)) return code;
      value->value = d.find(value->id)->value;
      return 0;
    }
    case VIDIOC_G_EXT_CTRLS:
    case VIDIOC_S_EXT_CTRLS:
    case VIDIOC_TRY_EXT_CTRLS:
      return extended(d, request, static_cast<v4l2_ext_controls*>(argument));
    // ---- buffers ----
    case VIDIOC_REQBUFS: {
      auto* wanted = static_cast<v4l2_requestbuffers*>(argument);
      if (wanted->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
      wanted->capabilities = V4L2_BUF_CAP_SUPPORTS_MMAP;
      wanted->flags = 0;
      if (wanted->memory != V4L2_MEMORY_MMAP) return EINVAL;
      if (d.streamer >= 0 && d.streamer != descriptor) return EBUSY;
      freeBuffers(d);
      wanted->count = std::min(wanted->count, 32u);
      if (wanted->count == 0) return 0;
      wanted->count = std::max(wanted->count, 2u);
      return makeBuffers(d, descriptor, wanted->count);
    }
    case VIDIOC_QUERYBUF: {
      auto* buffer = static_cast<v4l2_buffer*>(argument);
      if (buffer->type != V4L2_BUF_TYPE_VIDEO_CAPTURE || buffer->index >= d.buffers.size()) return EINVAL;
      describe(d, buffer->index, buffer);
      return 0;
    }
    case VIDIOC_QBUF: {
      auto* buffer = static_cast<v4l2_buffer*>(argument);
      if (d.streamer >= 0 && d.streamer != descriptor) return EBUSY;
      if (buffer->type != V4L2_BUF_TYPE_VIDEO_CAPTURE || buffer->memory != V4L2_MEMORY_MMAP ||
          buffer->index >= d.buffers.size())
        return EINVAL;
      if (buffer->flags & V4L2_BUF_FLAG_REQUEST_FD) return EBADR;
      Buffer& mine = d.buffers[buffer->index];
      if (mine.queued || mine.done) return EINVAL;
      mine.queued = true;
      mine.sequence = 0;
      d.waiting.push_back(buffer->index);
      describe(d, buffer->index, buffer);
      return 0;
    }
    case VIDIOC_DQBUF: {
      auto* buffer = static_cast<v4l2_buffer*>(argument);
      if (buffer->type != V4L2_BUF_TYPE_VIDEO_CAPTURE || buffer->memory != V4L2_MEMORY_MMAP) return EINVAL;
      if (d.streamer >= 0 && d.streamer != descriptor) return EBUSY;
      if (!d.streaming) return EINVAL;
      produce(d);
      const int index = firstDone(d);
      if (index < 0) return d.unplugged() ? ENODEV : EAGAIN;
      Buffer& mine = d.buffers[static_cast<std::size_t>(index)];
      describe(d, static_cast<unsigned>(index), buffer);
      buffer->flags &= ~static_cast<std::uint32_t>(V4L2_BUF_FLAG_DONE);
      mine.done = false;
      return 0;
    }
    case VIDIOC_STREAMON:
      if (*static_cast<int*>(argument) != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
      if (d.streamer >= 0 && d.streamer != descriptor) return EBUSY;
      if (d.buffers.empty()) return EINVAL;
      if (said("busy")) return EBUSY;
      if (!d.streaming) {
        d.streaming = true;
        d.sequence = 0;
        d.pending.clear();
        d.inForce = d.light();
        d.nextFrame = now() + 0.01;
      }
      return 0;
    case VIDIOC_STREAMOFF:
      if (*static_cast<int*>(argument) != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
      if (d.streamer >= 0 && d.streamer != descriptor) return EBUSY;
      stopStreaming(d);
      return 0;
    default:
      return ENOTTY;
  }
}

}  // namespace patina::test
