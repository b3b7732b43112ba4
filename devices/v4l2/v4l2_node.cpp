#include "devices/v4l2/v4l2_node.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <map>

#include "engine/acquire/camera_device.h"

namespace patina::v4l2 {
namespace {

constexpr int kMostDevices = 128;

}  // namespace

int control(int descriptor, unsigned long request, void* argument) {
  for (;;) {
    if (::ioctl(descriptor, request, argument) >= 0) return 0;
    if (errno != EINTR) return errno;
  }
}

bool isGone(int code) {
  return code == ENODEV || code == ENXIO || code == ENOENT || code == EIO;
}

std::string textOf(const unsigned char* text, std::size_t size) {
  const auto* begin = reinterpret_cast<const char*>(text);
  return std::string(begin, strnlen(begin, size));
}

Descriptor::~Descriptor() {
  if (value_ >= 0) ::close(value_);
}

Result<Descriptor> openNode(const std::string& node) {
  const int descriptor = ::open(node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (descriptor >= 0) return Descriptor(descriptor);
  switch (errno) {
    case EBUSY:
      return cameraBusy(node);
    case EACCES:
    case EPERM:
      return Error{ErrorCode::Refused, "there is no permission to use this camera", node,
                   "add yourself to the group video (sudo adduser $USER video), then log in again"};
    default:
      return cameraUnplugged(node);
  }
}

std::vector<Node> nodes() {
  std::vector<Node> found;
  std::map<std::string, int> shared;
  for (int number = 0; number < kMostDevices; ++number) {
    const std::string path = "/dev/video" + std::to_string(number);
    const Descriptor descriptor(::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
    if (descriptor.get() < 0) continue;
    v4l2_capability capability{};
    if (control(descriptor.get(), VIDIOC_QUERYCAP, &capability) != 0) continue;
    const unsigned can =
        capability.capabilities & V4L2_CAP_DEVICE_CAPS ? capability.device_caps : capability.capabilities;
    if (!(can & V4L2_CAP_VIDEO_CAPTURE) || !(can & V4L2_CAP_STREAMING)) continue;
    Node node{path, textOf(capability.card, sizeof capability.card),
              textOf(capability.bus_info, sizeof capability.bus_info), ""};
    const int which = ++shared[node.bus];
    node.id =
        kIdPrefix + (node.bus.empty() ? path : node.bus + (which > 1 ? "#" + std::to_string(which) : ""));
    found.push_back(std::move(node));
  }
  return found;
}

}  // namespace patina::v4l2
