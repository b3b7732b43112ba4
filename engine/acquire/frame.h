#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/image/image.h"
#include "engine/image/image_size.h"

namespace patina {

/// The clock of cameras and displays: frames and pictures are compared in it. CLOCK_MONOTONIC on real
/// hardware; the simulated rig may run its own, faster one.
using RigTime = std::chrono::steady_clock::time_point;

/// How the bytes of a frame hold pixels.
enum class PixelLayout {
  Bayer8,
  Bayer10,        ///< 16-bit little-endian words, 10 bits used
  Bayer12,        ///< 12 bits used
  Bayer16,        ///< all 16
  Bayer10Packed,  ///< MIPI CSI-2: four pixels in five bytes
  Bayer12Packed,  ///< two pixels in three bytes
  Grey8,
  Grey16,
  Yuyv,    ///< Y U Y V, BT.601, 16..235
  Mjpeg,   ///< a JPEG file a frame
  Rgb8,    ///< R G B, display-encoded
  Linear,  ///< `Frame::linear`, nothing to decode
};

/// Colours of the first two pixels of the first row, then of the second.
enum class BayerOrder { Rggb, Grbg, Gbrg, Bggr };

struct FrameFormat {
  PixelLayout layout = PixelLayout::Linear;
  BayerOrder bayer = BayerOrder::Rggb;
  ImageSize size;
  double framesPerSecond = 0;  ///< the fastest; 0: not said
  std::string name;            ///< for a person: "RG10 1920 x 1080, 30 a second"
  bool operator==(const FrameFormat&) const = default;
};

/// Whether pixel values are proportional to light before any calibration: raw, grey and float layouts.
bool isLinear(PixelLayout layout);
/// Bits that a sample of the layout uses; 32 for Linear.
int bitsOf(PixelLayout layout);
/// Least bytes of a row; 0 for Mjpeg and Linear.
std::size_t rowBytes(PixelLayout layout, int width);

/// What is known of one frame. Empty: the device doesn't say, which is not "as it was asked for".
struct FrameMetadata {
  std::uint64_t sequence = 0;       ///< counts lost frames too
  RigTime exposureStart{};          ///< when the sensor began to collect light for its first row
  std::optional<double> exposureS;  ///< really in force
  std::optional<double> gain;       ///< 1: none
  std::optional<double> redGain, blueGain;
  std::optional<double> focus;  ///< in the device's own unit
  bool damaged = false;         ///< the driver says that data is missing
};

/// One picture as it came from a camera.
struct Frame {
  FrameFormat format;
  std::size_t strideBytes = 0;      ///< from row to row; 0: rows follow each other
  std::vector<std::uint8_t> bytes;  ///< empty for Linear
  Image linear;                     ///< for Linear: R G B, of full scale
  double black = 0;                 ///< level that no light gives, share of full scale
  double white = 1;                 ///< level at which the sensor clips, share of full scale
  FrameMetadata metadata;
};

}  // namespace patina
