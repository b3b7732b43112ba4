#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace patina {

/// A float raster, channels interleaved, row 0 first. Value type; moving is cheap.
/// Shape: height x width x channels. Units are the owner's business.
class Image {
 public:
  Image() = default;
  Image(int width, int height, int channels, float fill = 0.0f)
      : width_(width),
        height_(height),
        channels_(channels),
        samples_(static_cast<std::size_t>(width) * height * channels, fill) {}

  int width() const { return width_; }
  int height() const { return height_; }
  int channels() const { return channels_; }
  bool empty() const { return samples_.empty(); }
  std::size_t pixelCount() const { return static_cast<std::size_t>(width_) * height_; }

  float& at(int x, int y, int channel = 0) { return samples_[index(x, y) + channel]; }
  float at(int x, int y, int channel = 0) const { return samples_[index(x, y) + channel]; }
  std::span<float> pixel(int x, int y) {
    return {samples_.data() + index(x, y), static_cast<std::size_t>(channels_)};
  }
  std::span<const float> pixel(int x, int y) const {
    return {samples_.data() + index(x, y), static_cast<std::size_t>(channels_)};
  }
  std::span<float> samples() { return samples_; }
  std::span<const float> samples() const { return samples_; }

 private:
  std::size_t index(int x, int y) const { return (static_cast<std::size_t>(y) * width_ + x) * channels_; }

  int width_ = 0, height_ = 0, channels_ = 0;
  std::vector<float> samples_;
};

}  // namespace patina
