#include "devices/simulated/photo_effects.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace patina {
namespace {

/// Standard normal from raw bits: the standard's distributions differ between libraries.
double normal(std::mt19937_64& bits) {
  const auto uniform = [&] { return (static_cast<double>(bits() >> 11) + 0.5) * 0x1.0p-53; };
  const double u = uniform(), v = uniform();
  return std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * v);
}

}  // namespace

Image blurred(const Image& picture, double sigmaPx) {
  if (!(sigmaPx > 0)) return picture;
  const int reach = static_cast<int>(std::ceil(4 * sigmaPx)) + 1, width = picture.width(),
            height = picture.height(), channels = picture.channels();
  std::vector<double> taps;
  double total = 0;
  for (int i = -reach; i <= reach; ++i) {
    const auto below = [&](double x) { return 0.5 * std::erfc(-x / (sigmaPx * std::numbers::sqrt2)); };
    taps.push_back(below(i + 0.5) - below(i - 0.5));
    total += taps.back();
  }
  for (double& tap : taps) tap /= total;
  const auto pass = [&](const Image& from, bool along) {
    Image to(width, height, channels);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < channels; ++c) {
          double sum = 0;
          for (int i = -reach; i <= reach; ++i)
            sum += taps[static_cast<std::size_t>(i + reach)] *
                   (along ? from.at(std::clamp(x + i, 0, width - 1), y, c)
                          : from.at(x, std::clamp(y + i, 0, height - 1), c));
          to.at(x, y, c) = static_cast<float>(sum);
        }
    return to;
  };
  return pass(pass(picture, true), false);
}

PhotoEffects::PhotoEffects(const SimulatedEffects& effects, int photos, int blackPhoto, double blackLevel,
                           double fullScale, Image sheetAlbedo, std::uint64_t seed)
    : effects_(effects),
      photos_(photos),
      blackPhoto_(blackPhoto),
      blackLevel_(blackLevel),
      fullScale_(fullScale),
      sheetAlbedo_(std::move(sheetAlbedo)) {
  std::mt19937_64 flicker(seed * 0x9E3779B97F4A7C15ull + 101), room(seed * 0x9E3779B97F4A7C15ull + 202);
  for (int i = 0; i < photos; ++i) {
    const SimulatedEffects::ScreenDrift& drift = effects.screenDrift;
    double factor = 1 - drift.warmUp * std::exp(-i / drift.warmUpPhotos);
    factor *= 1 + drift.linear * (photos > 1 ? static_cast<double>(i) / (photos - 1) : 0.0);
    factor *= std::max(0.0, 1 + effects.flicker.sd * normal(flicker));
    if (otherExposure(i)) factor *= 1 + effects.exposureMismatch.error;
    factor_.push_back(factor);
    ambient_.push_back(fullScale *
                       (effects.ambientDrift.perPhoto * i + effects.ambientDrift.sd * normal(room)));
  }
}

bool PhotoEffects::otherExposure(int index) const {
  return effects_.exposureMismatch.error != 0 &&
         index >= std::lround((1 - effects_.exposureMismatch.share) * photos_);
}

void PhotoEffects::beforeSensor(Image& photo, int index) const {
  const int width = photo.width(), height = photo.height();
  if (const double factor = screenFactor(index); factor != 1)
    for (float& sample : photo.samples()) sample = static_cast<float>(sample * factor);
  if (effects_.vignetting.corners != 0) {
    const double cx = 0.5 * (width - 1), cy = 0.5 * (height - 1), corner = std::max(1e-9, cx * cx + cy * cy);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (float& sample : photo.pixel(x, y))
          sample *= static_cast<float>(1 - effects_.vignetting.corners *
                                               ((x - cx) * (x - cx) + (y - cy) * (y - cy)) / corner);
  }
  if (effects_.defocus.sigmaPx > 0) photo = blurred(photo, effects_.defocus.sigmaPx);
  if (effects_.glare.share > 0) {
    const Image spread = blurred(photo, effects_.glare.radiusPx);
    const auto share = static_cast<float>(effects_.glare.share);
    for (std::size_t i = 0; i < photo.samples().size(); ++i)
      photo.samples()[i] += share * (spread.samples()[i] - photo.samples()[i]);
  }
  if (effects_.strayLight.share > 0) {
    Eigen::Array3d sum = Eigen::Array3d::Zero();
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) sum[c] += photo.at(x, y, c);
    sum *= effects_.strayLight.share / static_cast<double>(photo.pixelCount());
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) photo.at(x, y, c) += static_cast<float>(sum[c]);
  }
  for (float& sample : photo.samples()) sample += static_cast<float>(blackLevel_);
  if (effects_.blackLevel.offset != 0 && index != blackPhoto_)
    for (float& sample : photo.samples())
      sample += static_cast<float>(effects_.blackLevel.offset * fullScale_);
  if (const double added = ambient(index); added != 0) {
    const double onSheet = sheetAlbedo_.empty() ? 0 : effects_.ambientDrift.onSheet;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c)
          photo.at(x, y, c) += static_cast<float>(
              added * (1 - onSheet + (onSheet > 0 ? onSheet * sheetAlbedo_.at(x, y, c) : 0.0)));
  }
  if (const double a = effects_.channelCrosstalk.amount; a != 0)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const std::span<float> rgb = photo.pixel(x, y);
        const double sum = static_cast<double>(rgb[0]) + rgb[1] + rgb[2];
        for (float& sample : rgb) sample = static_cast<float>((1 - 3 * a) * sample + a * sum);
      }
}

void PhotoEffects::afterSensor(Image& photo) const {
  const double gamma = effects_.cameraResponse.gamma, c = effects_.cameraResponse.compression;
  if (gamma == 1 && c == 0) return;
  const double full = clipsAt();
  for (float& sample : photo.samples()) {
    double u = std::abs(sample) / full;  // noise round zero keeps its sign
    if (gamma != 1) u = std::pow(u, gamma);
    u = (1 + c) * u / (1 + c * u);
    sample = static_cast<float>(std::copysign(u * full, sample));
  }
}

}  // namespace patina
