#include "engine/report/svg_plots.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>

#include "engine/report/explanation_words.h"
#include "engine/report/html.h"

namespace patina {
namespace {

constexpr double kWidth = 420, kHeight = 230;
constexpr double kLeft = 58, kRight = 12, kTop = 12, kBottom = 44;

std::string coordinate(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

/// Enough of a text to know what it is.
std::string shortened(const std::string& text, std::size_t most) {
  if (text.size() <= most) return text;
  std::size_t cut = most - 1;
  while (cut > 0 && (static_cast<unsigned char>(text[cut]) & 0xC0) == 0x80) --cut;  // not within a character
  return text.substr(0, cut) + "\u2026";
}

std::string svgText(double x, double y, const char* anchor, const char* kind, const std::string& text) {
  return "<text x=\"" + coordinate(x) + "\" y=\"" + coordinate(y) + "\" text-anchor=\"" + anchor +
         "\" class=\"" + kind + "\">" + html::escaped(text) + "</text>";
}

std::string svgLine(double x1, double y1, double x2, double y2, const char* kind) {
  return "<line x1=\"" + coordinate(x1) + "\" y1=\"" + coordinate(y1) + "\" x2=\"" + coordinate(x2) +
         "\" y2=\"" + coordinate(y2) + "\" class=\"" + kind + "\"/>";
}

struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -std::numeric_limits<double>::infinity();
  void take(double value) {
    if (!std::isfinite(value)) return;
    low = std::min(low, value), high = std::max(high, value);
  }
  bool known() const { return low <= high; }
  void widen(double share) {
    double room = (high - low) * share;
    if (!(room > 0)) room = low != 0 ? std::abs(low) * 0.1 : 1;
    low -= room, high += room;
  }
  double part(double value) const { return (value - low) / (high - low); }
};

/// Axes with their ticks and titles; x as numbers, or as names of places 0, 1, 2, ...
struct Axes {
  Range x, y;
  double placeX(double value) const { return kLeft + x.part(value) * (kWidth - kLeft - kRight); }
  double placeY(double value) const { return kHeight - kBottom - y.part(value) * (kHeight - kTop - kBottom); }

  std::string draw(const std::string& xLabel, const std::string& yLabel,
                   const std::vector<std::string>& names) const {
    std::string svg;
    for (const double tick : svgTicks(y.low, y.high, 4)) {
      svg += svgLine(kLeft, placeY(tick), kWidth - kRight, placeY(tick), tick == 0 ? "zero" : "grid");
      svg += svgText(kLeft - 6, placeY(tick) + 4, "end", "tick", shortNumber(tick));
    }
    if (names.empty()) {
      for (const double tick : svgTicks(x.low, x.high, 5))
        svg += svgText(placeX(tick), kHeight - kBottom + 16, "middle", "tick", shortNumber(tick));
    } else {
      // All of a few, cut to what fits; of many, some.
      constexpr double kCharacter = 6.4, kLeast = 44;
      const double room = kWidth - kLeft - kRight;
      const auto fit = static_cast<std::size_t>(room / kLeast);
      const std::size_t stride = (names.size() + fit - 1) / fit;
      const double each = room * static_cast<double>(stride) / static_cast<double>(names.size());
      const auto characters = static_cast<std::size_t>(std::max(3.0, (each - 6) / kCharacter));
      for (std::size_t i = 0; i < names.size(); i += stride)
        svg += svgText(placeX(static_cast<double>(i)), kHeight - kBottom + 16, "middle", "tick",
                       shortened(names[i], characters));
    }
    svg += svgLine(kLeft, kHeight - kBottom, kWidth - kRight, kHeight - kBottom, "axis");
    svg += svgText((kLeft + kWidth - kRight) / 2, kHeight - 10, "middle", "label", shortened(xLabel, 60));
    svg += "<text transform=\"translate(13," + coordinate((kTop + kHeight - kBottom) / 2) +
           ") rotate(-90)\" text-anchor=\"middle\" class=\"label\">" + html::escaped(shortened(yLabel, 36)) +
           "</text>";
    return svg;
  }
};

std::string opening(double width, double height, const std::string& title) {
  return "<svg class=\"plot\" viewBox=\"0 0 " + coordinate(width) + " " + coordinate(height) +
         "\" role=\"img\" aria-label=\"" + html::escaped(title) + "\">";
}

std::string dot(const Axes& axes, double x, double value, double sd) {
  std::string svg;
  const double at = axes.placeX(x);
  if (sd > 0 && std::isfinite(sd))
    svg += svgLine(at, axes.placeY(std::max(axes.y.low, value - sd)), at,
                   axes.placeY(std::min(axes.y.high, value + sd)), "bar");
  return svg + "<circle cx=\"" + coordinate(at) + "\" cy=\"" + coordinate(axes.placeY(value)) +
         "\" r=\"3\" class=\"seen\"/>";
}

std::string line(const Axes& axes, const std::vector<double>& x, const std::vector<double>& y) {
  std::string path;
  bool pen = false;
  for (std::size_t i = 0; i < std::min(x.size(), y.size()); ++i) {
    if (!std::isfinite(x[i]) || !std::isfinite(y[i])) {
      pen = false;
      continue;
    }
    path += (pen ? " L" : " M") + coordinate(axes.placeX(x[i])) + " " + coordinate(axes.placeY(y[i]));
    pen = true;
  }
  return path.empty() ? path : "<path d=\"" + path.substr(1) + "\" class=\"expected\"/>";
}

}  // namespace

std::vector<double> svgTicks(double low, double high, int count) {
  std::vector<double> ticks;
  if (!(high > low) || !std::isfinite(low) || !std::isfinite(high) || count < 1) return ticks;
  const double rough = (high - low) / count;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  double step = power;
  for (const double factor : {1.0, 2.0, 5.0, 10.0})
    if (factor * power >= rough * 0.999) {
      step = factor * power;
      break;
    }
  if (!(step > 0) || !std::isfinite(step)) return ticks;
  const double first = std::ceil(low / step - 1e-9);
  for (int i = 0; i <= 2 * count + 2; ++i) {
    const double tick = (first + i) * step;
    if (tick > high + 1e-9 * step) break;
    ticks.push_back(std::abs(tick) < 1e-9 * step ? 0.0 : tick);
  }
  return ticks;
}

std::string signatureSvg(const SignaturePlot& plot) {
  std::vector<double> x = plot.x;
  if (!plot.xNames.empty()) {
    x.resize(plot.xNames.size());
    std::iota(x.begin(), x.end(), 0.0);
  }
  Axes axes;
  const auto sdAt = [&](std::size_t i) { return i < plot.seenSd.size() ? plot.seenSd[i] : 0.0; };
  for (std::size_t i = 0; i < x.size(); ++i) {
    const bool hasSeen = i < plot.seen.size() && std::isfinite(plot.seen[i]);
    const bool hasExpected = i < plot.expected.size() && std::isfinite(plot.expected[i]);
    if (!hasSeen && !hasExpected) continue;
    axes.x.take(x[i]);
    if (hasExpected) axes.y.take(plot.expected[i]);
    if (!hasSeen) continue;
    axes.y.take(plot.seen[i] - std::max(0.0, sdAt(i)));
    axes.y.take(plot.seen[i] + std::max(0.0, sdAt(i)));
    axes.y.take(plot.seen[i]);
  }
  if (!axes.x.known() || !axes.y.known()) return {};
  if (plot.xNames.empty())
    axes.x.widen(0.04);
  else
    axes.x.low -= 0.5, axes.x.high += 0.5;
  axes.y.widen(0.08);
  std::string svg = opening(kWidth, kHeight, plot.title + ": expected and seen");
  svg += axes.draw(plot.xLabel, plot.yLabel, plot.xNames);
  if (plot.xNames.empty()) {
    svg += line(axes, x, plot.expected);
  } else {
    // Between categories there is nothing: a level each.
    for (std::size_t i = 0; i < std::min(x.size(), plot.expected.size()); ++i)
      if (std::isfinite(plot.expected[i]))
        svg += svgLine(axes.placeX(x[i] - 0.3), axes.placeY(plot.expected[i]), axes.placeX(x[i] + 0.3),
                       axes.placeY(plot.expected[i]), "level");
  }
  for (std::size_t i = 0; i < std::min(x.size(), plot.seen.size()); ++i)
    if (std::isfinite(x[i]) && std::isfinite(plot.seen[i])) svg += dot(axes, x[i], plot.seen[i], sdAt(i));
  return svg + "</svg>";
}

std::string photoCurveSvg(const PhotoCurve& curve) {
  SignaturePlot plot;
  plot.title = curve.name;
  plot.xLabel = "photograph, in the bundle's order";
  plot.yLabel = curve.unit.empty() ? curve.name : curve.name + ", " + curve.unit;
  for (const int photo : curve.photo) plot.x.push_back(photo);
  plot.seen = curve.value;
  plot.seenSd = curve.sd;
  return signatureSvg(plot);
}

std::string breakdownSvg(const ResidualBreakdown& breakdown, std::size_t most, std::size_t* leftOut) {
  *leftOut = 0;
  const auto at = [](const std::vector<double>& values, std::size_t i) {
    return i < values.size() && std::isfinite(values[i]) && values[i] >= 0 ? values[i] : -1.0;
  };
  std::vector<std::size_t> shown;
  for (std::size_t i = 0; i < breakdown.label.size(); ++i)
    if (at(breakdown.before, i) >= 0 || at(breakdown.after, i) >= 0) shown.push_back(i);
  if (shown.empty()) return {};
  if (shown.size() > most) {
    *leftOut = shown.size() - most;
    std::ranges::stable_sort(shown, std::greater{}, [&](std::size_t i) { return at(breakdown.before, i); });
    shown.resize(most);
    std::ranges::sort(shown);  // in their own order again
  }
  double highest = 1, lowest = 1;
  for (const std::size_t i : shown)
    for (const double value : {at(breakdown.before, i), at(breakdown.after, i)})
      if (value >= 0) highest = std::max(highest, value), lowest = std::min(lowest, std::max(value, 0.1));
  const bool logarithmic = highest > 12;
  const double low = logarithmic ? std::log10(std::min(0.5, lowest)) : 0;
  const double high = (logarithmic ? std::log10(highest * 1.15) : highest * 1.08);
  constexpr double kLabels = 128, kRow = 24, kEnd = 46;
  const double height = 30 + kRow * static_cast<double>(shown.size());
  const auto place = [&](double value) {
    const double scaled = logarithmic ? std::log10(std::max(value, 1e-3)) : value;
    return kLabels + std::clamp((scaled - low) / (high - low), 0.0, 1.0) * (kWidth - kLabels - kEnd);
  };
  std::string svg = opening(kWidth, height, "residual by " + breakdown.by);
  double y = 8;
  for (const std::size_t i : shown) {
    svg += svgText(kLabels - 8, y + 13, "end", "tick", shortened(breakdown.label[i], 19));
    const auto bar = [&](double value, double top, const char* kind) {
      if (value < 0) return;
      svg += "<rect x=\"" + coordinate(kLabels) + "\" y=\"" + coordinate(top) + "\" width=\"" +
             coordinate(std::max(0.5, place(value) - kLabels)) + "\" height=\"8\" rx=\"1.5\" class=\"" +
             kind + "\"/>";
    };
    const double before = at(breakdown.before, i), after = at(breakdown.after, i);
    bar(before, y, "before");
    bar(after, y + 9, "after");
    const double value = std::max(before, after);
    svg += svgText(place(value) + 5, y + 13, "start", "tick", shortNumber(value));
    y += kRow;
  }
  svg += svgLine(place(1), 2, place(1), height - 20, "noise");
  svg += svgText(place(1), height - 6, "middle", "label",
                 logarithmic ? "1: noise alone (logarithmic)" : "1: noise alone");
  return svg + "</svg>";
}

}  // namespace patina
