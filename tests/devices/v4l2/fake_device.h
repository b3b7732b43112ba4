#pragma once

#include <linux/videodev2.h>
#include <time.h>

#include <algorithm>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace patina::test {

/// What the environment's PATINA_FAKE_CAMERA says, words between spaces: "no-manual" (its exposure menu has
/// only the automatic), "old-exposure" (the older control, by another number), "keeps-exposure" (a setting
/// has no effect), "no-frames", "busy" (streaming is refused), "eof-stamps", "lose=N" (every Nth frame never
/// comes), "damage=N" (every Nth is marked), "unplug=N" (gone after N frames), "late=N" (settings act N
/// frames later).
bool said(const char* word);
int number(const char* key, int fallback);

struct Format {
  std::uint32_t code;
  const char* name;
  unsigned bytesPerPixel;  // 0: compressed
  bool compressed;
};
struct Size {
  unsigned width, height;
};
struct Control {
  std::uint32_t id;
  v4l2_ctrl_type type;
  const char* name;
  int least, most, step, standard;
  int value;
};

struct Buffer {
  std::vector<std::uint8_t> unused;
  void* memory = nullptr;
  std::size_t length = 0;
  bool queued = false, done = false, mapped = false;
  unsigned sequence = 0, used = 0;
  bool damaged = false;
  timespec stamp{};
};

struct Device {
  std::recursive_mutex mutex;
  std::set<int> descriptors;  // open ones
  int streamer = -1;          // the descriptor that has the buffers
  Format format;
  Size size;
  int memory = -1;
  std::vector<Buffer> buffers;
  bool streaming = false;
  std::deque<unsigned> waiting;  // queued, in order
  unsigned sequence = 0, delivered = 0;
  double nextFrame = 0;
  std::vector<Control> controls;
  std::deque<std::pair<int, double>> pending;  // exposures by the frame from which they act
  double inForce = 0;
  unsigned intervalNumerator = 1, intervalDenominator = 100;

  Device();
  /// As if it had just been plugged in.
  void reset();
  Control* find(std::uint32_t id) {
    for (Control& control : controls)
      if (control.id == id) return &control;
    return nullptr;
  }
  int valueOf(std::uint32_t id, int fallback) {
    const Control* control = find(id);
    return control ? control->value : fallback;
  }
  /// Light of full scale that these settings collect: 0.1 s at gain 1 fills it.
  double light() {
    const int exposure = find(V4L2_CID_EXPOSURE_ABSOLUTE) ? valueOf(V4L2_CID_EXPOSURE_ABSOLUTE, 100)
                                                          : valueOf(V4L2_CID_EXPOSURE, 100);
    return exposure / 1000.0 * valueOf(V4L2_CID_GAIN, 1);
  }
  bool inactive(std::uint32_t id) {
    if (id == V4L2_CID_EXPOSURE_ABSOLUTE) return valueOf(V4L2_CID_EXPOSURE_AUTO, 1) != V4L2_EXPOSURE_MANUAL;
    if (id == V4L2_CID_WHITE_BALANCE_TEMPERATURE) return valueOf(V4L2_CID_AUTO_WHITE_BALANCE, 0) != 0;
    if (id == V4L2_CID_FOCUS_ABSOLUTE) return valueOf(V4L2_CID_FOCUS_AUTO, 0) != 0;
    return false;
  }
  bool menuHas(const Control& control, int index) {
    if (control.id == V4L2_CID_EXPOSURE_AUTO)
      return index == V4L2_EXPOSURE_APERTURE_PRIORITY ||
             (index == V4L2_EXPOSURE_MANUAL && !said("no-manual"));
    return index >= control.least && index <= control.most;
  }
  std::size_t imageBytes() const {
    return static_cast<std::size_t>(size.width) * size.height * format.bytesPerPixel;
  }
  // Of each descriptor.
  std::map<int, int> priorities;
  std::map<int, std::set<std::uint32_t>> subscribed;
  std::map<int, std::deque<v4l2_event>> events;
  std::map<int, unsigned> eventNumber;
  int priorityOf(int descriptor) const {
    const auto found = priorities.find(descriptor);
    return found != priorities.end() ? found->second : static_cast<int>(V4L2_PRIORITY_INTERACTIVE);
  }
  int highestPriority() const {
    int highest = V4L2_PRIORITY_UNSET;
    for (const int descriptor : descriptors) highest = std::max(highest, priorityOf(descriptor));
    return highest;
  }
  bool unplugged() const {
    return number("unplug", 0) > 0 && delivered >= static_cast<unsigned>(number("unplug", 0));
  }
};

// Of controls.
int setControl(Device& d, std::uint32_t id, int value, bool clampIt);
int queryControl(Device& d, std::uint32_t id, Control** found);
std::uint32_t flagsOf(Device& d, const Control& control);
v4l2_event eventOf(Device& d, const Control& control);
int extended(Device& d, unsigned long request, v4l2_ext_controls* list);

Device& device();
double now();
/// Fills buffers for the frames whose time has come. Samples are proportional to exposure times gain, over a
/// ramp along x from 0.2 to 0.8; 0.1 s at gain 1 would fill the sensor.
void produce(Device& d);
int firstDone(Device& d);
void freeBuffers(Device& d);
/// Sets the descriptors (timers) so that they become readable when the next frame does.
void arm(Device& d);
/// Whether it has such an ioctl.
bool knows(unsigned long request);
/// An ioctl on one of its descriptors: 0 or the errno.
int answer(Device& d, int descriptor, unsigned long request, void* argument);

}  // namespace patina::test
