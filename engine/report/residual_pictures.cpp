#include "engine/report/residual_pictures.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include "engine/render/colour_map.h"
#include "engine/render/tone_map.h"

namespace patina {
namespace {

/// Behind what is off the sample: between the pages' light and dark ground.
constexpr float kGround = 0.35f;

struct Crop {
  int left = 0, top = 0, width = 0, height = 0;
  int step = 1;  ///< pixels of the photograph to one of the view, each way
  int viewWidth() const { return (width + step - 1) / step; }
  int viewHeight() const { return (height + step - 1) / step; }
};

/// The rectangle in which `inside` is true, and how far it must shrink.
template <typename Inside>
std::optional<Crop> cropOf(int width, int height, int longestSide, const Inside& inside) {
  int left = width, top = height, right = -1, bottom = -1;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (inside(x, y)) {
        left = std::min(left, x), right = std::max(right, x);
        top = std::min(top, y), bottom = std::max(bottom, y);
      }
  if (right < 0) return std::nullopt;
  Crop crop{left, top, right - left + 1, bottom - top + 1, 1};
  const int longest = std::max(crop.width, crop.height);
  crop.step = std::max(1, (longest + longestSide - 1) / std::max(1, longestSide));
  return crop;
}

/// Calls `pixel(x, y)` for what one pixel of the view is made of.
template <typename Pixel>
void eachPixel(const Crop& crop, int u, int v, const Pixel& pixel) {
  for (int y = crop.top + v * crop.step; y < std::min(crop.top + crop.height, crop.top + (v + 1) * crop.step);
       ++y)
    for (int x = crop.left + u * crop.step;
         x < std::min(crop.left + crop.width, crop.left + (u + 1) * crop.step); ++x)
      pixel(x, y);
}

bool sameShape(const Image& a, const Image& b) {
  return a.width() == b.width() && a.height() == b.height() && a.channels() == b.channels();
}

/// A colour for `sigmas` to either side of grey.
float shade(float sigmas) {
  const float value = 0.5f + 0.5f * sigmas / kResidualRangeSigmas;
  // Sixty-four steps are finer than the eye needs here, and halve the size of a picture of noise.
  return std::round(std::clamp(value, 0.0f, 1.0f) * 63.0f) / 63.0f;
}

}  // namespace

ResidualView residualView(const ResidualPicture& picture, int longestSide, std::uint64_t seed) {
  ResidualView view;
  const Image& captured = picture.captured;
  const Image& sigma = picture.noiseSigma;
  if (captured.empty() || captured.channels() != 3 || !sameShape(captured, sigma)) return view;
  const auto inside = [&](int x, int y) {
    for (int c = 0; c < 3; ++c)
      if (!(sigma.at(x, y, c) > 0) || !std::isfinite(sigma.at(x, y, c)) ||
          !std::isfinite(captured.at(x, y, c)))
        return false;
    return captured.at(x, y, 0) != 0 || captured.at(x, y, 1) != 0 || captured.at(x, y, 2) != 0;
  };
  const auto crop = cropOf(captured.width(), captured.height(), longestSide, inside);
  if (!crop) return view;

  const int width = crop->viewWidth(), height = crop->viewHeight();
  const auto has = [&](const Image& prediction) { return sameShape(captured, prediction); };
  const bool before = has(picture.predictedBefore), after = has(picture.predictedAfter);
  Image linear(width, height, 3), linearBefore(before ? width : 0, before ? height : 0, 3),
      linearAfter(after ? width : 0, after ? height : 0, 3);
  const auto grey = [&](bool there) { return there ? Image(width, height, 3, kGround) : Image(); };
  view.before = grey(before), view.after = grey(after), view.expected = grey(true);
  std::vector<unsigned char> seen(static_cast<std::size_t>(width) * height, 0);
  std::mt19937_64 random(seed);
  std::normal_distribution<float> noise;
  double sumBefore = 0, sumAfter = 0, count = 0;
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) {
      std::array<double, 3> photo{}, first{}, last{}, variance{};
      int n = 0;
      eachPixel(*crop, u, v, [&](int x, int y) {
        if (!inside(x, y)) return;
        ++n;
        for (int c = 0; c < 3; ++c) {
          photo[c] += captured.at(x, y, c);
          variance[c] += double{sigma.at(x, y, c)} * sigma.at(x, y, c);
          if (before) first[c] += picture.predictedBefore.at(x, y, c);
          if (after) last[c] += picture.predictedAfter.at(x, y, c);
        }
      });
      if (n == 0) continue;
      seen[static_cast<std::size_t>(v) * width + u] = 1;
      for (int c = 0; c < 3; ++c) {
        linear.at(u, v, c) = static_cast<float>(photo[c] / n);
        const double sd = std::sqrt(variance[c]);
        view.expected.at(u, v, c) = shade(noise(random));
        if (before) {
          const double residual = (photo[c] - first[c]) / sd;
          linearBefore.at(u, v, c) = static_cast<float>(first[c] / n);
          view.before.at(u, v, c) = shade(static_cast<float>(std::isfinite(residual) ? residual : 0));
          if (std::isfinite(residual)) sumBefore += residual * residual;
        }
        if (after) {
          const double residual = (photo[c] - last[c]) / sd;
          linearAfter.at(u, v, c) = static_cast<float>(last[c] / n);
          view.after.at(u, v, c) = shade(static_cast<float>(std::isfinite(residual) ? residual : 0));
          if (std::isfinite(residual)) sumAfter += residual * residual;
        }
        count += 1;
      }
    }
  if (before) view.rmsBefore = std::sqrt(sumBefore / count);
  if (after) view.rmsAfter = std::sqrt(sumAfter / count);
  const float exposure = autoExposure(linear);
  const auto finished = [&](const Image& image) {
    Image shown = toneMap(image, exposure);
    for (int v = 0; v < height; ++v)
      for (int u = 0; u < width; ++u)
        if (!seen[static_cast<std::size_t>(v) * width + u])
          for (float& sample : shown.pixel(u, v)) sample = kGround;
    return shown;
  };
  view.captured = finished(linear);
  if (before) view.predictedBefore = finished(linearBefore);
  if (after) view.predictedAfter = finished(linearAfter);
  return view;
}

Image placePicture(const Image& place, int longestSide, double low, double high) {
  if (place.empty() || place.channels() != 1) return {};
  const auto inside = [&](int x, int y) { return place.at(x, y) > 0 && std::isfinite(place.at(x, y)); };
  const auto crop = cropOf(place.width(), place.height(), longestSide, inside);
  if (!crop) return {};
  Image shown(crop->viewWidth(), crop->viewHeight(), 3, kGround);
  const double span = std::log(std::max(high, low * 1.01) / low);
  for (int v = 0; v < shown.height(); ++v)
    for (int u = 0; u < shown.width(); ++u) {
      double sum = 0;
      int n = 0;
      eachPixel(*crop, u, v, [&](int x, int y) {
        if (inside(x, y)) sum += place.at(x, y), ++n;
      });
      if (n == 0) continue;
      const auto colour = mapColour(ColourMap::Magma, static_cast<float>(std::log(sum / n / low) / span));
      for (int c = 0; c < 3; ++c) shown.at(u, v, c) = colour[static_cast<std::size_t>(c)];
    }
  return shown;
}

Image mapPicture(const Image& map, int longestSide, double* low, double* high) {
  *low = 0, *high = 1;
  if (map.empty() || (map.channels() != 1 && map.channels() != 3)) return {};
  const int longest = std::max(map.width(), map.height());
  const Crop crop{0, 0, map.width(), map.height(),
                  std::max(1, (longest + longestSide - 1) / std::max(1, longestSide))};
  Image small(crop.viewWidth(), crop.viewHeight(), map.channels());
  std::vector<float> values;
  for (int v = 0; v < small.height(); ++v)
    for (int u = 0; u < small.width(); ++u)
      for (int c = 0; c < map.channels(); ++c) {
        double sum = 0;
        int n = 0;
        eachPixel(crop, u, v, [&](int x, int y) {
          if (std::isfinite(map.at(x, y, c))) sum += map.at(x, y, c), ++n;
        });
        small.at(u, v, c) = n > 0 ? static_cast<float>(sum / n) : std::nanf("");
        if (n > 0) values.push_back(small.at(u, v, c));
      }
  if (map.channels() == 3) return toneMap(small, autoExposure(small));
  if (values.empty()) return {};
  const auto rank = [&](double share) {
    const auto at =
        values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
    std::ranges::nth_element(values, at);
    return double{*at};
  };
  *low = rank(0.02);
  *high = std::max(rank(0.98), *low + 1e-12);
  Image shown(small.width(), small.height(), 3, kGround);
  for (int v = 0; v < small.height(); ++v)
    for (int u = 0; u < small.width(); ++u) {
      if (!std::isfinite(small.at(u, v))) continue;
      const auto colour =
          mapColour(ColourMap::Viridis, static_cast<float>((small.at(u, v) - *low) / (*high - *low)));
      for (int c = 0; c < 3; ++c) shown.at(u, v, c) = colour[static_cast<std::size_t>(c)];
    }
  return shown;
}

}  // namespace patina
