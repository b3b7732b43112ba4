#pragma once

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "engine/capture/capture.h"
#include "engine/capture/capture_json.h"
#include "engine/image/exr.h"
#include "tests/base/temp_folder.h"

/// A capture bundle that a test writes and then breaks. The pixels follow no true material, only a smooth
/// spectrum.
namespace patina::test {

inline constexpr int kSmallSide = 12;  // pixels

inline FourierCapture smallCapture(const std::filesystem::path& folder, int frequencies,
                                   int side = kSmallSide) {
  FourierCapture capture;
  capture.folder = folder;
  capture.sampleWidthMm = capture.sampleHeightMm = 100;
  capture.sampleName = "test sheet";
  Camera& camera = capture.camera;
  camera.width = camera.height = side;
  const double focal = 3.75 * side, centre = (side - 1) / 2.0;
  camera.intrinsics << focal, 0, centre, 0, focal, centre, 0, 0, 1;
  const double s = std::sqrt(0.5);
  camera.cameraFromWorld << 1, 0, 0, 0, -s, -s, 0, s, -s;
  camera.translationMm = {0, 0, 450};
  Screen& screen = capture.screen;
  screen.widthMm = 345;
  screen.heightMm = 194.0625;
  screen.widthPx = 1920;
  screen.heightPx = 1080;
  screen.worldFromScreen << 1, 0, 0, 0, -s, -s, 0, s, -s;
  screen.originMm = {0, 200, 200};
  screen.emission = ScreenEmission{{0, 0}, {1.6, 1.3}, 1.0};
  capture.photos.push_back({"window.exr", PhotoRole::Window, 1.5, {0, 0}, 0, false, ""});
  capture.photos.push_back({"black.exr", PhotoRole::Black, 1.5, {0, 0}, 0, false, ""});
  for (int i = 0; i < frequencies; ++i) {
    const Eigen::Vector2i frequency(i / 2 % 4 + 1, i % 2 ? -(i / 8) : i / 8 + 1);
    for (int phase = 0; phase < 4; ++phase) {
      capture.photos.push_back({"photo_" + std::to_string(i) + "_" + std::to_string(phase) + ".exr",
                                PhotoRole::Pattern, 1.5, frequency, phase, false, ""});
    }
  }
  return capture;
}

/// The photograph's radiance everywhere: a Gaussian spectrum, black at 0.001.
inline float smallRadiance(const FourierPhoto& photo) {
  if (photo.role == PhotoRole::Black) return 0.001f;
  if (photo.role == PhotoRole::Window) return 0.041f;
  const double magnitude = 0.03 * std::exp(-0.1 * photo.frequency.squaredNorm());
  const double angle = 0.4 * photo.frequency.x() + photo.phase * M_PI / 2;
  return static_cast<float>(0.021 + 0.5 * magnitude * std::sin(angle));
}

/// Writes capture.json and every photograph.
inline FourierCapture writeSmallBundle(const std::filesystem::path& folder, int frequencies = 2,
                                       int side = kSmallSide) {
  const FourierCapture capture = smallCapture(folder, frequencies, side);
  if (!writeFourierCapture(capture)) throw std::runtime_error("the bundle can't be written");
  for (const FourierPhoto& photo : capture.photos) {
    Image image(side, side, 3, smallRadiance(photo));
    for (int y = 0; y < side; ++y) {
      for (int x = 0; x < side; ++x) image.at(x, y, 1) *= 1.0f + 0.002f * static_cast<float>((x + 2 * y) % 5);
    }
    if (!writeExr(folder / photo.file, image, {"R", "G", "B"})) throw std::runtime_error("no photograph");
  }
  return capture;
}

inline nlohmann::json readBundleJson(const std::filesystem::path& folder) {
  return nlohmann::json::parse(readText(folder / "capture.json"));
}

inline void writeBundleJson(const std::filesystem::path& folder, const nlohmann::json& json) {
  writeText(folder / "capture.json", json.dump(1));
}

}  // namespace patina::test
