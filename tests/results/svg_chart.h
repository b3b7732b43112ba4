#pragma once

#include <string>
#include <utility>
#include <vector>

namespace patina::test {

/// A line of a chart. `dashed`: for what is compared against.
struct ChartLine {
  std::string name, colour;
  bool dashed = false;
  std::vector<std::pair<double, double>> points;  ///< sorted by x
};

/// A chart as SVG text: lines with markers, ticks at `ticksX`, y from 0 to `topY`, names at the right of
/// their last point or in a legend. Fonts are the viewer's.
std::string svgChart(const std::string& title, const std::string& axisX, const std::string& axisY,
                     const std::vector<double>& ticksX, double topY, const std::vector<ChartLine>& lines);

}  // namespace patina::test
