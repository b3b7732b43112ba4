#pragma once

#include <string>
#include <utility>
#include <vector>

#include "engine/base/result.h"

/// Device nodes of V4L2. For this folder only.
namespace patina::v4l2 {

inline constexpr const char* kIdPrefix = "v4l2:";

/// ioctl that goes on after a signal. 0, or the errno.
int control(int descriptor, unsigned long request, void* argument);
/// Whether an errno means that the device isn't there any more.
bool isGone(int code);
std::string textOf(const unsigned char* text, std::size_t size);

class Descriptor {
 public:
  explicit Descriptor(int value = -1) : value_(value) {}
  ~Descriptor();
  Descriptor(Descriptor&& other) noexcept : value_(std::exchange(other.value_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(value_, other.value_);
    return *this;
  }
  int get() const { return value_; }

 private:
  int value_;
};

/// Errors: busy, no permission, unplugged.
Result<Descriptor> openNode(const std::string& node);

struct Node {
  std::string path, name, bus;
  std::string id;
};
/// The nodes among /dev/video* that capture and stream, in the order of their numbers.
std::vector<Node> nodes();

}  // namespace patina::v4l2
