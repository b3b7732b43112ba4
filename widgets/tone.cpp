#include "widgets/tone.h"

#include <numbers>

#include "engine/fourier/maps.h"

namespace patina {

namespace {

constexpr int kCurveSteps = 16384;

/// The sRGB curve, tabulated in the square root of the linear value: there it is nearly straight, so that
/// dark values keep their resolution.
const std::array<std::uint8_t, kCurveSteps + 1>& srgbCurve() {
  static const auto table = [] {
    std::array<std::uint8_t, kCurveSteps + 1> values{};
    for (int i = 0; i <= kCurveSteps; ++i) {
      const double root = static_cast<double>(i) / kCurveSteps, linear = root * root;
      const double encoded =
          linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055;
      values[i] = static_cast<std::uint8_t>(std::lround(255.0 * encoded));
    }
    return values;
  }();
  return table;
}

QRgb fromOklch(double lightness, double chroma, double hueRad) {
  const double a = chroma * std::cos(hueRad), b = chroma * std::sin(hueRad);
  const double l = std::pow(lightness + 0.3963377774 * a + 0.2158037573 * b, 3);
  const double m = std::pow(lightness - 0.1055613458 * a - 0.0638541728 * b, 3);
  const double s = std::pow(lightness - 0.0894841775 * a - 1.2914855480 * b, 3);
  const auto encode = [](double linear) { return encodeSrgb8(static_cast<float>(linear)); };
  return qRgb(encode(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
              encode(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
              encode(-0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s));
}

/// The scalar ramp: OKLCh with lightness rising evenly from dark violet-blue through green to pale yellow, so
/// that equal steps of value look equally large and the ramp reads in grey too.
const std::array<QRgb, 256>& ramp() {
  static const auto table = [] {
    std::array<QRgb, 256> colours{};
    for (int i = 0; i < 256; ++i) {
      const double t = i / 255.0;
      const double lightness = 0.20 + 0.75 * t;
      const double hueRad = (285.0 - 185.0 * t) * std::numbers::pi / 180.0;
      const double chroma = 0.06 + 0.085 * std::sin(std::numbers::pi * std::min(1.0, 0.15 + 0.9 * t));
      colours[i] = fromOklch(lightness, chroma, hueRad);
    }
    return colours;
  }();
  return table;
}

/// The diverging ramp: dark and grey in the middle, lightness and chroma rising evenly to both ends, so that
/// the size of a difference reads in grey and its sign in hue.
const std::array<QRgb, 257>& divergingRamp() {
  static const auto table = [] {
    std::array<QRgb, 257> colours{};
    for (int i = 0; i <= 256; ++i) {
      const double t = (i - 128) / 128.0, size = std::abs(t);
      const double hueRad = (t < 0 ? 250.0 : 60.0) * std::numbers::pi / 180.0;
      colours[i] = fromOklch(0.27 + 0.55 * size, 0.135 * std::pow(size, 0.8), hueRad);
    }
    return colours;
  }();
  return table;
}

float percentile(std::vector<float>& values, double fraction) {
  if (values.empty()) return 0;
  const auto rank = static_cast<std::size_t>(fraction * (values.size() - 1));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[rank];
}

}  // namespace

int encodeSrgb8(float linear) {
  if (!(linear > 0)) return 0;
  if (linear >= 1) return 255;
  return srgbCurve()[static_cast<int>(std::sqrt(linear) * kCurveSteps + 0.5f)];
}

ToneMapper::ToneMapper(ToneStyle style, const ToneSettings& settings) : style_(style) {
  gain_ = style == ToneStyle::LinearRgb ? static_cast<float>(std::exp2(settings.exposureEv)) : 1.0f;
  low_ = static_cast<float>(settings.low);
  // An empty range would divide by zero; this keeps a flat picture flat.
  scale_ = 1.0f / std::max(1e-12f, static_cast<float>(settings.high - settings.low));
}

QRgb ToneMapper::operator()(std::span<const float> pixel) const {
  switch (style_) {
    case ToneStyle::LinearRgb: {
      const auto channel = [&](std::size_t i) {
        return encodeSrgb8((pixel[std::min(i, pixel.size() - 1)] * gain_ - low_) * scale_);
      };
      return qRgb(channel(0), channel(1), channel(2));
    }
    case ToneStyle::Scalar: {
      const float t = (pixel[0] - low_) * scale_;
      if (std::isnan(t)) return qRgb(96, 0, 96);
      return ramp()[static_cast<int>(std::clamp(t, 0.0f, 1.0f) * 255.0f + 0.5f)];
    }
    case ToneStyle::Normal: {
      const auto channel = [&](float component) {
        return static_cast<int>(std::clamp((component - low_) * scale_, 0.0f, 1.0f) * 255.0f + 0.5f);
      };
      return qRgb(channel(pixel[0]), channel(pixel[1]), pixel[2] > 0 ? 200 : 0);
    }
    case ToneStyle::Status:
      return statusColour(static_cast<int>(std::lround(pixel[0])));
    case ToneStyle::Diverging: {
      const float t = (pixel[0] - low_) * scale_;
      if (std::isnan(t)) return qRgb(56, 56, 56);  // the canvas: nothing there
      return divergingRamp()[static_cast<int>(std::clamp(t, 0.0f, 1.0f) * 256.0f + 0.5f)];
    }
  }
  return qRgb(0, 0, 0);
}

QRgb ToneMapper::atFraction(double fraction) const {
  const int index = static_cast<int>(std::clamp(fraction, 0.0, 1.0) * 255.0 + 0.5);
  if (style_ == ToneStyle::Scalar) return ramp()[index];
  if (style_ == ToneStyle::Diverging)
    return divergingRamp()[static_cast<int>(std::clamp(fraction, 0.0, 1.0) * 256.0 + 0.5)];
  const int grey = encodeSrgb8(static_cast<float>(std::clamp(fraction, 0.0, 1.0)));
  return qRgb(grey, grey, grey);
}

ToneSettings automaticTone(ToneStyle style, const Image& image, const Image* status, unsigned leftOut) {
  ToneSettings tone;
  if (style == ToneStyle::Status) {
    tone.high = kStatusCount - 1;
    return tone;
  }
  if (image.empty()) return tone;
  // About 2^17 samples say enough about a percentile; a stride that is odd does not lock onto columns.
  const std::size_t stride = std::max<std::size_t>(1, image.pixelCount() / 131072) | 1;
  std::vector<float> values;
  for (std::size_t i = 0; i < image.pixelCount(); i += stride) {
    const int x = static_cast<int>(i % image.width()), y = static_cast<int>(i / image.width());
    if (status && (leftOut >> (static_cast<unsigned>(status->at(x, y)) & 31u) & 1u)) continue;
    const auto pixel = image.pixel(x, y);
    if (style == ToneStyle::Normal) {
      values.push_back(std::hypot(pixel[0], pixel[1]));
    } else {
      for (const float sample : pixel) values.push_back(sample);
    }
  }
  std::erase_if(values, [](float value) { return !std::isfinite(value); });
  if (values.empty()) return tone;
  if (style == ToneStyle::Scalar) {
    tone.low = percentile(values, 0.01);
    tone.high = percentile(values, 0.99);
    if (!(tone.high - tone.low > 1e-6 * std::abs(tone.high))) {  // a flat map: show it in the middle
      const double middle = tone.low, margin = std::max(0.01, 0.1 * std::abs(middle));
      tone.low = middle - margin;
      tone.high = middle + margin;
    }
  } else if (style == ToneStyle::Normal) {
    tone.high = std::max(0.01f, percentile(values, 0.99));
    tone.low = -tone.high;
  } else if (style == ToneStyle::Diverging) {  // as much to either side, so that the middle is zero
    for (float& value : values) value = std::abs(value);
    tone.high = std::max(1e-6f, percentile(values, 0.98));
    tone.low = -tone.high;
  } else {
    tone.low = 0;
    tone.high = std::max(1e-6f, percentile(values, 0.995));
  }
  // Three figures: the range is read by people.
  const auto rounded = [](double value) {
    if (value == 0) return 0.0;
    const double step = std::pow(10.0, std::floor(std::log10(std::abs(value))) - 2);
    return std::round(value / step) * step;
  };
  tone.low = rounded(tone.low);
  tone.high = rounded(tone.high);
  return tone;
}

QRgb statusColour(int status) {
  switch (static_cast<TexelStatus>(status)) {
    case TexelStatus::NotMeasured:
      return qRgb(70, 70, 70);
    case TexelStatus::Converged:
      return qRgb(88, 150, 110);
    case TexelStatus::IterationLimit:
      return qRgb(226, 190, 90);
    case TexelStatus::MirrorOffScreen:
      return qRgb(92, 140, 206);
    case TexelStatus::Clipped:
      return qRgb(236, 236, 236);
    case TexelStatus::Failed:
      return qRgb(214, 84, 74);
    case TexelStatus::Cancelled:
      return qRgb(140, 108, 170);
  }
  return qRgb(255, 0, 255);
}

QString statusName(int status) {
  switch (static_cast<TexelStatus>(status)) {
    case TexelStatus::NotMeasured:
      return QStringLiteral("not measured");
    case TexelStatus::Converged:
      return QStringLiteral("converged");
    case TexelStatus::IterationLimit:
      return QStringLiteral("iteration limit");
    case TexelStatus::MirrorOffScreen:
      return QStringLiteral("mirror point off screen");
    case TexelStatus::Clipped:
      return QStringLiteral("clipped");
    case TexelStatus::Failed:
      return QStringLiteral("failed");
    case TexelStatus::Cancelled:
      return QStringLiteral("cancelled");
  }
  return QStringLiteral("unknown (%1)").arg(status);
}

QImage toneMapped(const Image& image, const ToneMapper& tone) {
  QImage out(image.width(), image.height(), QImage::Format_RGB32);
  for (int y = 0; y < image.height(); ++y) {
    auto* line = reinterpret_cast<QRgb*>(out.scanLine(y));
    for (int x = 0; x < image.width(); ++x) line[x] = tone(image.pixel(x, y));
  }
  return out;
}

}  // namespace patina
