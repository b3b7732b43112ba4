#pragma once

#include <string>

#include "engine/diagnosis/explanation.h"

namespace patina {

/// Plots as SVG elements for a page that has the report's style sheet (colours are its classes, so that they
/// follow light and dark). All text is escaped; values that are no numbers are left out.

/// What an effect predicts as a line, what was seen as dots with one standard deviation to either side.
/// Empty where nothing can be drawn.
std::string signatureSvg(const SignaturePlot& plot);
/// A value a photograph, with its standard deviation. Empty where nothing can be drawn.
std::string photoCurveSvg(const PhotoCurve& curve);
/// Bars of before and after for each label, with a line at 1, the noise. Logarithmic where the values span
/// much. At most `most` labels, the worst; `*leftOut` says how many are not shown.
std::string breakdownSvg(const ResidualBreakdown& breakdown, std::size_t most, std::size_t* leftOut);

/// Round values between `low` and `high`, about `count` of them.
std::vector<double> svgTicks(double low, double high, int count);

}  // namespace patina
