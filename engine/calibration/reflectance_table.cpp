#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/calibration/white_tile.h"

namespace patina {
namespace {

constexpr std::uint64_t kLargestTable = 16u << 20;
constexpr std::array<double, 3> kBandNm = {600, 540, 455};
constexpr double kBandSdNm = 25;

/// Numbers of a line; empty where it has text.
std::vector<double> numbersOf(std::string_view line) {
  std::vector<double> numbers;
  const char *at = line.data(), *end = at + line.size();
  const auto isGap = [](char c) {
    return c == ' ' || c == '\t' || c == ',' || c == ';' || c == '\r' || c == '%';
  };
  while (at < end) {
    if (isGap(*at)) {
      ++at;
      continue;
    }
    double value = 0;
    const auto [next, code] = std::from_chars(at, end, value);
    if (code != std::errc() || !std::isfinite(value) || (next < end && !isGap(*next))) return {};
    numbers.push_back(value);
    at = next;
  }
  return numbers;
}

}  // namespace

Result<CertifiedReflectance> parseReflectanceTable(std::string_view text, const std::string& where) {
  std::vector<std::pair<double, double>> table;
  std::size_t line = 0;
  bool inPercent = false;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view row = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    ++line;
    const std::vector<double> numbers = numbersOf(row);
    if (numbers.size() < 2) {
      if (table.empty() && row.find('%') != std::string_view::npos) inPercent = true;  // the header
      const std::size_t first = row.find_first_not_of(" \t\r");
      const bool words = first == std::string_view::npos || row[first] == '#' || numbers.empty();
      if (words && (table.empty() || first == std::string_view::npos || row[first] == '#')) continue;
      return Error{ErrorCode::Malformed, "a line has no wavelength and reflectance: " + inQuotes(row),
                   where + " line " + std::to_string(line), "two columns: nanometres, reflectance"};
    }
    if (!(numbers[0] >= 100 && numbers[0] <= 5000))
      return Error{ErrorCode::Malformed, "a wavelength is not in nanometres: " + inQuotes(row),
                   where + " line " + std::to_string(line), "two columns: nanometres, reflectance"};
    table.emplace_back(numbers[0], numbers[1]);
  }
  std::stable_sort(table.begin(), table.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  if (table.size() < 2)
    return Error{ErrorCode::Malformed, "there is no table of wavelengths and reflectances", where,
                 "two columns: nanometres, reflectance"};
  double largest = 0;
  for (const auto& [nm, value] : table) largest = std::max(largest, value);
  if (largest > 1.5) inPercent = true;
  CertifiedReflectance out;
  out.source = where;
  for (int c = 0; c < 3; ++c) {
    const double from = kBandNm[c] - 2 * kBandSdNm, to = kBandNm[c] + 2 * kBandSdNm;
    if (table.front().first > from || table.back().first < to)
      return Error{ErrorCode::Invalid,
                   "the table doesn't reach from " + std::to_string(std::lround(from)) + " to " +
                       std::to_string(std::lround(to)) + " nm",
                   where, "the certificate's values over visible light"};
    double sum = 0, squares = 0, weights = 0;
    std::size_t i = 0;
    for (double nm = from; nm <= to; nm += 1) {
      while (i + 2 < table.size() && table[i + 1].first < nm) ++i;
      const double span = table[i + 1].first - table[i].first;
      const double t = span > 0 ? std::clamp((nm - table[i].first) / span, 0.0, 1.0) : 0;
      const double value = ((1 - t) * table[i].second + t * table[i + 1].second) / (inPercent ? 100 : 1);
      const double w = std::exp(-0.5 * std::pow((nm - kBandNm[c]) / kBandSdNm, 2));
      sum += w * value, squares += w * value * value, weights += w;
    }
    out.rgb[c] = sum / weights;
    out.spread[c] = std::sqrt(std::max(0.0, squares / weights - out.rgb[c] * out.rgb[c]));
    if (!(out.rgb[c] > 0.01 && out.rgb[c] <= 1.05))
      return Error{ErrorCode::Invalid, "the table's reflectance is not between 0.01 and 1.05", where,
                   "reflectance as a share, or in percent with % in the header"};
  }
  return out;
}

Result<CertifiedReflectance> readReflectanceTable(const std::filesystem::path& file) {
  const Result<std::string> text = readFile(file, kLargestTable);
  if (!text) return text.error();
  return parseReflectanceTable(*text, file.string());
}

}  // namespace patina
