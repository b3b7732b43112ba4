#include "tests/results/svg_chart.h"

#include <cmath>
#include <cstdio>

namespace patina::test {
namespace {

std::string number(double value, int digits = 1) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

}  // namespace

std::string svgChart(const std::string& title, const std::string& axisX, const std::string& axisY,
                     const std::vector<double>& ticksX, double topY, const std::vector<ChartLine>& lines) {
  constexpr double kLeft = 70, kTop = 46, kWidth = 520, kHeight = 330, kLegend = 250;
  const double lowX = ticksX.front(), highX = ticksX.back();
  // Numbers of images are told apart at the low end: a logarithmic axis.
  const auto atX = [&](double x) {
    return kLeft + kWidth * (highX > lowX ? std::log(x / lowX) / std::log(highX / lowX) : 0.5);
  };
  const auto atY = [&](double y) { return kTop + kHeight * (1 - std::min(y, topY) / topY); };
  std::string svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " +
                    number(kLeft + kWidth + kLegend, 0) + " " + number(kTop + kHeight + 60, 0) +
                    "\" font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" "
                    "fill=\"#fff\"/>\n"
                    "<text x=\"" +
                    number(kLeft) + "\" y=\"24\" font-size=\"16\">" + title + "</text>\n";
  const double step = topY <= 0.6 ? 0.1 : 0.2;
  for (double y = 0; y <= topY + 1e-9; y += step) {
    svg += "<line x1=\"" + number(kLeft) + "\" x2=\"" + number(kLeft + kWidth) + "\" y1=\"" + number(atY(y)) +
           "\" y2=\"" + number(atY(y)) + "\" stroke=\"#ddd\"/><text x=\"" + number(kLeft - 8) + "\" y=\"" +
           number(atY(y) + 4) + "\" text-anchor=\"end\">" + number(y) + "</text>\n";
  }
  for (const double x : ticksX) {
    svg += "<line x1=\"" + number(atX(x)) + "\" x2=\"" + number(atX(x)) + "\" y1=\"" +
           number(kTop + kHeight) + "\" y2=\"" + number(kTop + kHeight + 5) +
           "\" stroke=\"#555\"/><text x=\"" + number(atX(x)) + "\" y=\"" + number(kTop + kHeight + 20) +
           "\" text-anchor=\"middle\">" + number(x, 0) + "</text>\n";
  }
  svg += "<text x=\"" + number(kLeft + kWidth / 2) + "\" y=\"" + number(kTop + kHeight + 44) +
         "\" text-anchor=\"middle\">" + axisX + "</text>\n<text transform=\"translate(20 " +
         number(kTop + kHeight / 2) + ") rotate(-90)\" text-anchor=\"middle\">" + axisY + "</text>\n";
  double legend = kTop + 8;
  for (const ChartLine& line : lines) {
    std::string path;
    for (const auto& [x, y] : line.points)
      path += (path.empty() ? "M" : "L") + number(atX(x)) + " " + number(atY(y));
    const std::string stroke = "stroke=\"" + line.colour + "\" stroke-width=\"2\" fill=\"none\"" +
                               (line.dashed ? " stroke-dasharray=\"6 4\"" : "");
    svg += "<path d=\"" + path + "\" " + stroke + "/>\n";
    for (const auto& [x, y] : line.points) {
      // Beyond the top: an arrow instead of a dot.
      svg += y > topY ? "<path d=\"M" + number(atX(x) - 5) + " " + number(kTop + 9) + "l5 -9l5 9z\" fill=\"" +
                            line.colour + "\"/>\n"
                      : "<circle cx=\"" + number(atX(x)) + "\" cy=\"" + number(atY(y)) +
                            "\" r=\"3\" fill=\"" + line.colour + "\"/>\n";
    }
    const double left = kLeft + kWidth + 16;
    svg += "<path d=\"M" + number(left) + " " + number(legend) + "h26\" " + stroke + "/><text x=\"" +
           number(left + 34) + "\" y=\"" + number(legend + 4) + "\">" + line.name + "</text>\n";
    legend += 22;
  }
  return svg + "</svg>\n";
}

}  // namespace patina::test
