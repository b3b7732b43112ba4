#include "engine/acquire/pattern_image.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace patina {

PatternSpec patternOf(const FourierPhoto& photo) {
  PatternSpec spec;
  switch (photo.role) {
    case PhotoRole::Pattern:
      spec.kind = PatternSpec::Kind::Sine;
      spec.frequency = photo.frequency;
      spec.phase = photo.phase;
      break;
    case PhotoRole::Window:
      spec.kind = PatternSpec::Kind::Window;
      break;
    case PhotoRole::Black:
      spec.kind = PatternSpec::Kind::Black;
      break;
    case PhotoRole::Geometry:
      spec.kind = PatternSpec::Kind::Patch;
      break;
  }
  return spec;
}

std::string patternName(const PatternSpec& spec) {
  switch (spec.kind) {
    case PatternSpec::Kind::Sine:
      return "frequency " + std::to_string(spec.frequency.x()) + ", " + std::to_string(spec.frequency.y()) +
             ", phase " + std::to_string(spec.phase);
    case PatternSpec::Kind::Window:
      return "window";
    case PatternSpec::Kind::Black:
      return "black";
    case PatternSpec::Kind::Flat:
      return "grey of " + std::to_string(std::lround(100 * spec.level)) + " %";
    case PatternSpec::Kind::Patch:
      return "patch of " + std::to_string(std::lround(100 * spec.level)) + " %";
  }
  return {};
}

Image patternImage(const PatternSpec& spec, const Screen& screen) {
  const int width = screen.widthPx, height = screen.heightPx;
  Image image(width, height, 1);
  const Eigen::Vector2d half = screen.halfExtent();
  const auto level = static_cast<float>(std::clamp(spec.level, 0.0, 1.0));
  switch (spec.kind) {
    case PatternSpec::Kind::Black:
      return image;
    case PatternSpec::Kind::Flat:
      std::ranges::fill(image.samples(), level);
      return image;
    case PatternSpec::Kind::Patch: {
      const int side = std::max(1, height / 5), x0 = (width - side) / 2, y0 = (height - side) / 2;
      for (int y = std::max(0, y0); y < std::min(height, y0 + side); ++y)
        for (int x = std::max(0, x0); x < std::min(width, x0 + side); ++x) image.at(x, y) = level;
      return image;
    }
    default:
      break;
  }
  const bool isSine = spec.kind == PatternSpec::Kind::Sine;
  // sin(a + b) from the sines and cosines of columns and rows: a large screen has millions of pixels.
  const double offset = spec.phase * 0.5 * std::numbers::pi;
  struct Column {
    double window, sine, cosine;
  };
  std::vector<Column> columns;
  for (int i = 0; i < width; ++i) {
    const double x = half.x() * ((2.0 * i + 1) / width - 1), wave = spec.frequency.x() * x;
    columns.push_back(
        {std::exp(-0.5 * std::pow(x / screen.windowSigma.x(), 2)), std::sin(wave), std::cos(wave)});
  }
  for (int j = 0; j < height; ++j) {
    const double y = half.y() * (1 - (2.0 * j + 1) / height), wave = spec.frequency.y() * y + offset;
    const double windowY = std::exp(-0.5 * std::pow(y / screen.windowSigma.y(), 2));
    const double sine = std::sin(wave), cosine = std::cos(wave);
    for (int i = 0; i < width; ++i) {
      const Column& column = columns[static_cast<std::size_t>(i)];
      const double value = isSine ? std::max(0.0, column.sine * cosine + column.cosine * sine) : 1.0;
      image.at(i, j) = static_cast<float>(column.window * windowY * value);
    }
  }
  return image;
}

ScreenResponse ScreenResponse::linear() {
  return gamma(1);
}

ScreenResponse ScreenResponse::gamma(double exponent) {
  ScreenResponse response;
  for (std::size_t v = 0; v < 256; ++v) response.level[v] = std::pow(static_cast<double>(v) / 255, exponent);
  return response;
}

Result<ScreenResponse> ScreenResponse::fromCurve(const ResponseCurve& curve) {
  const double white = linearFromResponse(curve, 1);
  if (!(white > 0))
    return Error{ErrorCode::Invalid, "the screen's response gives no light at full white", "",
                 "measure the screen's response again"};
  ScreenResponse response;
  for (std::size_t v = 0; v < 256; ++v) {
    response.level[v] = linearFromResponse(curve, static_cast<double>(v) / 255) / white;
    if (v > 0 && response.level[v] < response.level[v - 1])
      return Error{ErrorCode::Invalid, "the screen's response falls at value " + std::to_string(v), "",
                   "measure the screen's response again"};
  }
  return response;
}

std::uint64_t ShownPicture::hash() const {
  const std::uint64_t size = static_cast<std::uint64_t>(width) << 32 |
                             static_cast<std::uint64_t>(height) << 2 | static_cast<unsigned>(channels);
  return pixels ? XXH3_64bits_withSeed(pixels->data(), pixels->size(), size) : size;
}

ShownPicture shownPicture(const Image& linear, const ScreenResponse& response, std::string name) {
  const int width = linear.width(), height = linear.height();
  const std::array<double, 256>& level = response.level;
  auto pixels = std::make_shared<std::vector<std::uint8_t>>(linear.pixelCount());
  // Light still owed to the pixels of this row and the next, with a margin on both sides.
  std::vector<double> here(static_cast<std::size_t>(width) + 2, 0.0), next(here.size(), 0.0);
  for (int y = 0; y < height; ++y) {
    const int step = y % 2 == 0 ? 1 : -1;
    for (int k = 0; k < width; ++k) {
      const int x = step > 0 ? k : width - 1 - k;
      const auto at = static_cast<std::size_t>(x + 1);
      // Beyond what the screen can do nothing is owed: it could never be paid back.
      const double wanted = std::clamp<double>(linear.at(x, y) + here[at], level[0], level[255]);
      auto above = static_cast<std::size_t>(std::ranges::lower_bound(level, wanted) - level.begin());
      above = std::min<std::size_t>(above, 255);
      std::size_t chosen = above;
      if (above > 0 && wanted - level[above - 1] < level[above] - wanted) chosen = above - 1;
      const double owed = wanted - level[chosen];
      (*pixels)[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)] =
          static_cast<std::uint8_t>(chosen);
      const auto ahead = static_cast<std::size_t>(x + 1 + step),
                 behind = static_cast<std::size_t>(x + 1 - step);
      here[ahead] += owed * 7 / 16;
      next[behind] += owed * 3 / 16;
      next[at] += owed * 5 / 16;
      next[ahead] += owed * 1 / 16;
    }
    std::swap(here, next);
    std::ranges::fill(next, 0.0);
  }
  return ShownPicture{std::move(name), width, height, 1, std::move(pixels)};
}

ShownPicture shownPattern(const PatternSpec& spec, const Screen& screen, const ScreenResponse& response) {
  return shownPicture(patternImage(spec, screen), response, patternName(spec));
}

Image lightOf(const ShownPicture& picture, const ScreenResponse& response) {
  Image light(picture.width, picture.height, 1);
  const auto channels = static_cast<std::size_t>(picture.channels);
  for (std::size_t i = 0; i < light.pixelCount(); ++i) {
    double sum = 0;
    for (std::size_t c = 0; c < channels; ++c) sum += response.level[(*picture.pixels)[i * channels + c]];
    light.samples()[i] = static_cast<float>(sum / static_cast<double>(channels));
  }
  return light;
}

ShownPicture thresholdPicture(const Image& linear, double share, std::string name) {
  auto pixels = std::make_shared<std::vector<std::uint8_t>>(linear.pixelCount());
  for (std::size_t i = 0; i < pixels->size(); ++i)
    (*pixels)[i] = linear.samples()[i] > share ? std::uint8_t{255} : std::uint8_t{0};
  return ShownPicture{std::move(name), linear.width(), linear.height(), 1, std::move(pixels)};
}

}  // namespace patina
