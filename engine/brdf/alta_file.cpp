#include "engine/brdf/alta_file.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <numbers>
#include <optional>
#include <span>
#include <vector>

#include "engine/base/text.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr double kLeastCosine = 1e-3;  // below, a value that holds the cosine says nothing
constexpr double kLightSlackRad = 0.5 * kPi / 180;
constexpr double kSameLightRad = 1e-6;  // rows of one light repeat its angle as text
constexpr double kLargestValue = 1e30;  // 1/sr; stays finite in single precision
constexpr std::size_t kNoteBytes = 400;

Eigen::Array3d unknown() {
  return Eigen::Array3d::Constant(kUnknown);
}

/// What the lines that begin with '#' say.
struct AltaHeader {
  std::string parametersIn, parametersOut, sample, note;
  int inputs = 0, outputs = 0;
  bool extraColumns = false;  ///< #VS: confidence columns behind the values
};

struct AltaRow {
  std::array<double, 3> in{};
  Eigen::Array3d value;
};

std::vector<std::string_view> words(std::string_view line) {
  std::vector<std::string_view> result;
  constexpr std::string_view kBlank = " \t\r\f\v";
  for (std::size_t at = line.find_first_not_of(kBlank); at != std::string_view::npos;) {
    const std::size_t end = std::min(line.find_first_of(kBlank, at), line.size());
    result.push_back(line.substr(at, end - at));
    at = line.find_first_not_of(kBlank, end);
  }
  return result;
}

std::optional<double> number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  double value = 0;
  const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (code != std::errc() || end != word.data() + word.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

void readHeaderLine(std::string_view line, AltaHeader& header) {
  line.remove_prefix(1);
  const std::vector<std::string_view> parts = words(line);
  if (parts.empty()) return;
  const auto integer = [&](std::size_t i) {
    const std::optional<double> value = i < parts.size() ? number(parts[i]) : std::nullopt;
    return value && *value >= 0 && *value < 1000 ? static_cast<int>(*value) : 0;
  };
  if (parts[0] == "DIM") {
    header.inputs = integer(1);
    header.outputs = integer(2);
  } else if (parts[0] == "PARAM_IN" && parts.size() > 1) {
    header.parametersIn = parts[1];
  } else if (parts[0] == "PARAM_OUT" && parts.size() > 1) {
    header.parametersOut = parts[1];
  } else if (parts[0] == "VS") {
    for (std::size_t i = 1; i < parts.size(); ++i) header.extraColumns |= integer(i) > 0;
  } else {
    if (parts[0] == "SAMPLE") {
      const std::size_t from = line.find('"'), to = line.rfind('"');
      if (from != std::string_view::npos && to > from) header.sample = line.substr(from + 1, to - from - 1);
    }
    if (header.note.size() < kNoteBytes) {
      header.note += (header.note.empty() ? "" : "; ") + std::string(line.substr(line.find(parts[0])));
    }
  }
}

/// The views of one light on a lattice over (thetaV cos dphi, thetaV sin dphi).
struct LightTable {
  double thetaLRad = 0;
  std::vector<double> x, y;            ///< ascending
  std::vector<Eigen::Array3d> values;  ///< x.size() rows of y.size(); NaN where not measured

  const Eigen::Array3d& at(std::size_t i, std::size_t j) const { return values[i * y.size() + j]; }

  /// Bilinear over the known corners; NaN beyond the lattice and where no corner is known.
  Eigen::Array3d evaluate(const Eigen::Vector3d& view) const {
    const double theta = std::acos(std::clamp(view.z(), -1.0, 1.0));
    const double length = std::hypot(view.x(), view.y());
    const double atX = length > 0 ? theta * view.x() / length : 0;
    const double atY = length > 0 ? theta * view.y() / length : 0;
    std::size_t i, j;
    double fx, fy;
    if (!locate(x, atX, i, fx) || !locate(y, atY, j, fy)) return unknown();
    Eigen::Array3d sum = Eigen::Array3d::Zero();
    double weights = 0;
    for (const std::size_t di : {0, 1}) {
      for (const std::size_t dj : {0, 1}) {
        const double weight = (di ? fx : 1 - fx) * (dj ? fy : 1 - fy);
        if (weight <= 0 || !at(i + di, j + dj).allFinite()) continue;
        sum += weight * at(i + di, j + dj);
        weights += weight;
      }
    }
    return weights > 0 ? Eigen::Array3d(sum / weights) : unknown();
  }

  /// Half a cell beyond the ends belongs to the outermost points.
  static bool locate(const std::vector<double>& nodes, double value, std::size_t& low, double& share) {
    const std::size_t last = nodes.size() - 1;
    if (value < nodes[0] - (nodes[1] - nodes[0]) / 2) return false;
    if (value > nodes[last] + (nodes[last] - nodes[last - 1]) / 2) return false;
    const auto above = std::upper_bound(nodes.begin() + 1, nodes.end() - 1, value);
    low = static_cast<std::size_t>(above - nodes.begin()) - 1;
    share = std::clamp((value - nodes[low]) / (nodes[low + 1] - nodes[low]), 0.0, 1.0);
    return true;
  }
};

class AltaLightsBrdf final : public Brdf {
 public:
  AltaLightsBrdf(std::vector<LightTable> lights, BrdfOrigin origin)
      : Brdf(std::move(origin)), lights_(std::move(lights)) {}

  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    if (toLight.z() < 0 || toView.z() < 0) return unknown();
    if (measured(angleOf(toLight))) return atLight(toLight, toView);
    if (measured(angleOf(toView))) return atLight(toView, toLight);
    return unknown();
  }

 private:
  static double angleOf(const Eigen::Vector3d& direction) {
    return std::acos(std::clamp(direction.z(), -1.0, 1.0));
  }
  bool measured(double thetaL) const {
    return thetaL >= lights_.front().thetaLRad - kLightSlackRad &&
           thetaL <= lights_.back().thetaLRad + kLightSlackRad;
  }

  Eigen::Array3d atLight(const Eigen::Vector3d& light, const Eigen::Vector3d& view) const {
    const double thetaL = angleOf(light);
    // The light's azimuth becomes +x. A light at the normal has none: then the view's is as good.
    const Eigen::Vector3d& reference = std::hypot(light.x(), light.y()) > 1e-9 ? light : view;
    const Eigen::Vector3d turned =
        Eigen::AngleAxisd(-std::atan2(reference.y(), reference.x()), Eigen::Vector3d::UnitZ()) * view;

    std::size_t high = 0;
    while (high < lights_.size() && lights_[high].thetaLRad < thetaL) ++high;
    if (high == 0 || high == lights_.size()) {  // within the slack beyond the outermost light
      const LightTable& outermost = high == 0 ? lights_.front() : lights_.back();
      return outermost.evaluate(carried(turned, thetaL, outermost.thetaLRad));
    }
    const LightTable &below = lights_[high - 1], &above = lights_[high];
    const double share = (thetaL - below.thetaLRad) / (above.thetaLRad - below.thetaLRad);
    if (share <= 0) return below.evaluate(turned);
    if (share >= 1) return above.evaluate(turned);
    return (1 - share) * below.evaluate(carried(turned, thetaL, below.thetaLRad)) +
           share * above.evaluate(carried(turned, thetaL, above.thetaLRad));
  }

  /// The view under a measured light that corresponds to `view` under the light at `from`.
  static Eigen::Vector3d carried(const Eigen::Vector3d& view, double from, double to) {
    const double inPlane = std::atan2(view.x(), view.z());  // -pi/2 .. pi/2, the light's side positive
    const double side = std::abs(inPlane);
    // 1 with slope 0 at the two peaks: there the view turns with the light and the peak keeps its shape.
    const double share = side < from ? std::sin(kPi / 2 * side / from)
                                     : std::cos(kPi / 2 * (side - from) / std::max(kPi / 2 - from, 1e-9));
    const double turn = (inPlane < 0 ? -share : share) * (to - from);
    return Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitY()) * view;
  }

  std::vector<LightTable> lights_;
};

class AltaCosineBrdf final : public Brdf {
 public:
  AltaCosineBrdf(std::vector<AltaRow> rows, BrdfOrigin origin)
      : Brdf(std::move(origin)), rows_(std::move(rows)) {}

  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    if (toLight.z() < 0 || toView.z() < 0) return unknown();
    const Eigen::Vector3d sum = toLight + toView;
    const double length = sum.norm();
    return at(length > 1e-12 ? std::min(sum.z() / length, 1.0) : 1.0);
  }

 private:
  Eigen::Array3d at(double cosine) const {
    const std::size_t last = rows_.size() - 1;
    const auto place = [&](std::size_t i) { return rows_[i].in[0]; };
    if (cosine < place(0) - (place(1) - place(0)) / 2) return unknown();
    if (cosine > place(last) + (place(last) - place(last - 1)) / 2) return unknown();
    const auto above = std::upper_bound(rows_.begin() + 1, rows_.end() - 1, cosine,
                                        [](double value, const AltaRow& row) { return value < row.in[0]; });
    const std::size_t low = static_cast<std::size_t>(above - rows_.begin()) - 1;
    const double share = std::clamp((cosine - place(low)) / (place(low + 1) - place(low)), 0.0, 1.0);
    return (1 - share) * rows_[low].value + share * rows_[low + 1].value;
  }

  std::vector<AltaRow> rows_;  ///< ascending, known values only
};

/// Rows of one light on a lattice, or nothing where they are scattered.
std::optional<LightTable> latticeOf(std::span<const AltaRow> rows) {
  LightTable table;
  table.thetaLRad = rows.front().in[0];
  for (const AltaRow& row : rows) {
    table.x.push_back(row.in[1]);
    table.y.push_back(row.in[2]);
  }
  for (std::vector<double>* nodes : {&table.x, &table.y}) {
    std::sort(nodes->begin(), nodes->end());
    nodes->erase(std::unique(nodes->begin(), nodes->end()), nodes->end());
  }
  // On a lattice the nodes are about as many as the rows; scattered points would need a node for each pair.
  constexpr std::size_t kMostEmpty = 4;
  if (table.x.size() < 2 || table.y.size() < 2 ||
      table.x.size() > kMostEmpty * rows.size() / table.y.size()) {
    return std::nullopt;
  }
  table.values.assign(table.x.size() * table.y.size(), unknown());
  for (const AltaRow& row : rows) {
    const auto index = [](const std::vector<double>& nodes, double value) {
      return static_cast<std::size_t>(std::lower_bound(nodes.begin(), nodes.end(), value) - nodes.begin());
    };
    table.values[index(table.x, row.in[1]) * table.y.size() + index(table.y, row.in[2])] = row.value;
  }
  return table;
}

Error malformed(std::string what, std::string where) {
  return {ErrorCode::Malformed, std::move(what), std::move(where),
          "correct the line, or fetch the file again"};
}

Result<BrdfPtr> makeLights(std::vector<AltaRow> rows, BrdfOrigin origin) {
  std::stable_sort(rows.begin(), rows.end(),
                   [](const AltaRow& a, const AltaRow& b) { return a.in[0] < b.in[0]; });
  std::vector<LightTable> lights;
  for (std::size_t start = 0; start < rows.size();) {
    std::size_t end = start;
    while (end < rows.size() && rows[end].in[0] - rows[start].in[0] < kSameLightRad) ++end;
    std::optional<LightTable> table = latticeOf(std::span(rows).subspan(start, end - start));
    if (!table) {
      return Error{ErrorCode::Unsupported,
                   "the points of the light at " + std::to_string(rows[start].in[0] * 180 / kPi) +
                       " degrees are scattered, and only lattices are read",
                   origin.file, "resample the measurement onto a regular lattice for each light"};
    }
    lights.push_back(std::move(*table));
    start = end;
  }
  origin.note += (origin.note.empty() ? "" : "; ") + counted(lights.size(), "measured light");
  return BrdfPtr(std::make_shared<AltaLightsBrdf>(std::move(lights), std::move(origin)));
}

Result<BrdfPtr> makeCosine(std::vector<AltaRow> rows, BrdfOrigin origin) {
  std::erase_if(rows, [](const AltaRow& row) { return !row.value.allFinite(); });
  std::stable_sort(rows.begin(), rows.end(),
                   [](const AltaRow& a, const AltaRow& b) { return a.in[0] < b.in[0]; });
  const auto twice = std::adjacent_find(
      rows.begin(), rows.end(), [](const AltaRow& a, const AltaRow& b) { return a.in[0] == b.in[0]; });
  if (twice != rows.end()) {
    return malformed("two rows are for the cosine " + std::to_string(twice->in[0]), origin.file);
  }
  if (rows.size() < 2) return malformed("fewer than two rows hold a measured value", origin.file);
  origin.note += std::string(origin.note.empty() ? "" : "; ") + "depends on theta_h alone";
  return BrdfPtr(std::make_shared<AltaCosineBrdf>(std::move(rows), std::move(origin)));
}

}  // namespace

Result<BrdfPtr> readAltaBytes(std::string_view text, const std::string& where) {
  AltaHeader header;
  std::vector<AltaRow> rows;
  bool lights = false, cosineFactor = false, checked = false;
  std::size_t lineNumber = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    ++lineNumber;
    const std::string at = where + ", line " + std::to_string(lineNumber);
    if (line.starts_with('#')) {
      readHeaderLine(line, header);
      continue;
    }
    const std::vector<std::string_view> parts = words(line);
    if (parts.empty()) continue;

    if (!checked) {
      checked = true;
      lights = header.parametersIn == "ISOTROPIC_TL_TV_PROJ_DPHI";
      if (!lights && header.parametersIn != "COS_TH") {
        return Error{ErrorCode::Unsupported,
                     header.parametersIn.empty()
                         ? "the table doesn't say its parametrisation (#PARAM_IN)"
                         : "the parametrisation " + inQuotes(header.parametersIn) + " is not read",
                     where, "convert it to ISOTROPIC_TL_TV_PROJ_DPHI or COS_TH"};
      }
      cosineFactor = header.parametersOut == "INV_STERADIAN_COSINE_FACTOR";
      if ((!cosineFactor && header.parametersOut != "INV_STERADIAN" && header.parametersOut != "RGB_COLOR") ||
          (cosineFactor && !lights)) {
        return Error{ErrorCode::Unsupported,
                     "values of the kind " + inQuotes(header.parametersOut) + " are not read here", where,
                     "convert them to INV_STERADIAN"};
      }
      if (header.inputs != (lights ? 3 : 1) || (header.outputs != 1 && header.outputs != 3)) {
        return Error{ErrorCode::Unsupported,
                     "a table of " + std::to_string(header.inputs) + " coordinates and " +
                         std::to_string(header.outputs) + " values (#DIM) is not read",
                     where,
                     "give one value, or three for R, G, B, and the coordinates of " + header.parametersIn};
      }
    }

    const std::size_t columns = header.inputs + header.outputs;
    if (parts.size() < columns || (parts.size() > columns && !header.extraColumns)) {
      return malformed("there are " + std::to_string(parts.size()) + " columns where " +
                           std::to_string(columns) + " are needed",
                       at);
    }
    AltaRow row;
    for (std::size_t i = 0; i < columns; ++i) {
      const std::optional<double> value = number(parts[i]);
      if (!value) return malformed(inQuotes(parts[i]) + " is not a finite number", at);
      if (i < static_cast<std::size_t>(header.inputs)) {
        row.in[i] = *value;
      } else {
        row.value[i - header.inputs] = *value;
      }
    }
    if (header.outputs == 1) row.value = Eigen::Array3d::Constant(row.value[0]);
    if ((row.value > kLargestValue).any()) return malformed("a value above 1e30 is no reflectance", at);
    if ((row.value < 0).any()) row.value = unknown();
    if (lights) {
      const double thetaV = std::hypot(row.in[1], row.in[2]);
      if (row.in[0] < 0 || row.in[0] > kPi / 2 || std::abs(row.in[1]) > kPi || std::abs(row.in[2]) > kPi) {
        return malformed("an angle is out of range (radians are expected)", at);
      }
      const double cosine = std::cos(thetaV);
      if (cosine < 0 || (cosineFactor && cosine < kLeastCosine)) row.value = unknown();
      if (cosineFactor) row.value /= cosine;
    } else if (row.in[0] < 0 || row.in[0] > 1) {
      return malformed("a cosine is out of range", at);
    }
    rows.push_back(row);
  }
  if (rows.empty()) return malformed("the table holds no rows", where);

  BrdfOrigin origin{header.sample.empty() ? std::filesystem::path(where).stem().string() : header.sample,
                    "alta", where, header.note};
  if (header.outputs == 1)
    origin.note += std::string(origin.note.empty() ? "" : "; ") + "one channel, shown grey";
  if (cosineFactor) origin.note += "; the outgoing cosine that the file's values hold was divided out";
  return lights ? makeLights(std::move(rows), std::move(origin))
                : makeCosine(std::move(rows), std::move(origin));
}

}  // namespace patina
