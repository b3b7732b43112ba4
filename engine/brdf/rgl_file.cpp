#include "engine/brdf/rgl_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <vector>

#include "engine/base/text.h"
#include "engine/brdf/tensor_file.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kLeastCosine = 1e-4;   // of the outgoing direction: the file stores the product with it
constexpr float kLargestEntry = 1e20f;  // of a table: sums and products of them stay finite
constexpr double kLargestValue = 1e30;  // keeps a BRDF of absurd factors finite in single precision

/// Numbers of one incident direction's slice, and how the slices around a direction share it.
struct SliceShare {
  std::array<std::size_t, 4> slice{};
  std::array<double, 4> weight{};
  int count = 0;
};

/// The interval of `values` around `at` and the share of its upper end; clamped. `values` ascend.
struct Bracket {
  std::size_t low = 0;
  double share = 0;
};
Bracket bracket(const std::vector<float>& values, double at) {
  if (values.size() < 2) return {};
  const auto above = std::upper_bound(values.begin() + 1, values.end() - 1, at);
  const std::size_t low = static_cast<std::size_t>(above - values.begin()) - 1;
  const double width = static_cast<double>(values[low + 1]) - values[low];
  return {low, std::clamp((at - values[low]) / width, 0.0, 1.0)};
}

/// A bilinear function over the unit square, one for each incident direction and channel.
class Slices {
 public:
  Slices() = default;
  Slices(std::vector<float> data, std::size_t rows, std::size_t columns)
      : data_(std::move(data)), rows_(rows), columns_(columns) {}

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }
  std::size_t sliceSize() const { return rows_ * columns_; }
  const std::vector<float>& data() const { return data_; }

  double at(const SliceShare& share, std::size_t row, std::size_t column) const {
    double sum = 0;
    for (int i = 0; i < share.count; ++i) {
      sum += share.weight[i] * data_[share.slice[i] * sliceSize() + row * columns_ + column];
    }
    return sum;
  }
  double bilinear(const SliceShare& share, double x, double y) const {
    const auto [column, fx] = cell(x, columns_);
    const auto [row, fy] = cell(y, rows_);
    return (1 - fy) * ((1 - fx) * at(share, row, column) + fx * at(share, row, column + 1)) +
           fy * ((1 - fx) * at(share, row + 1, column) + fx * at(share, row + 1, column + 1));
  }
  /// The cell of a grid of `nodes` that a coordinate of [0, 1] lies in, and where in it.
  static std::pair<std::size_t, double> cell(double coordinate, std::size_t nodes) {
    const double scaled = std::clamp(coordinate, 0.0, 1.0) * static_cast<double>(nodes - 1);
    const std::size_t low = std::min(static_cast<std::size_t>(scaled), nodes - 2);
    return {low, scaled - static_cast<double>(low)};
  }

 private:
  std::vector<float> data_;
  std::size_t rows_ = 0, columns_ = 0;
};

/// Maps the unit square so that the density of visible normals becomes uniform: the inverse of sampling a
/// row by the marginal and a column by the conditional distribution of a bilinear density.
class DensityWarp {
 public:
  DensityWarp() = default;
  explicit DensityWarp(Slices density) : density_(std::move(density)) {
    const std::size_t rows = density_.rows(), columns = density_.columns(), size = density_.sliceSize();
    const std::size_t slices = density_.data().size() / size;
    std::vector<float> values = density_.data(), conditional(values.size()), marginal(slices * rows);
    for (std::size_t s = 0; s < slices; ++s) {
      float* value = values.data() + s * size;
      float* along = conditional.data() + s * size;
      float* down = marginal.data() + s * rows;
      for (std::size_t r = 0; r < rows; ++r) {
        double sum = 0;
        for (std::size_t c = 0; c + 1 < columns; ++c) {
          sum += 0.5 * (static_cast<double>(value[r * columns + c]) + value[r * columns + c + 1]);
          along[r * columns + c + 1] = static_cast<float>(sum);
        }
      }
      double sum = 0;
      for (std::size_t r = 0; r + 1 < rows; ++r) {
        sum += 0.5 * (static_cast<double>(along[(r + 1) * columns - 1]) + along[(r + 2) * columns - 1]);
        down[r + 1] = static_cast<float>(sum);
      }
      // The slices are blended, so each must have the same total. One that is all zero stays so.
      const double scale = sum > 0 ? 1 / sum : 0;
      for (std::size_t i = 0; i < size; ++i) {
        value[i] = static_cast<float>(value[i] * scale);
        along[i] = static_cast<float>(along[i] * scale);
      }
      for (std::size_t r = 0; r < rows; ++r) down[r] = static_cast<float>(down[r] * scale);
    }
    density_ = Slices(std::move(values), rows, columns);
    conditional_ = Slices(std::move(conditional), rows, columns);
    marginal_ = Slices(std::move(marginal), rows, 1);
  }

  /// The place that is mapped to (x, y). Where a row holds no density, its left end.
  std::pair<double, double> invert(const SliceShare& share, double x, double y) const {
    const auto [column, fx] = Slices::cell(x, density_.columns());
    const auto [row, fy] = Slices::cell(y, density_.rows());
    const double left = (1 - fy) * density_.at(share, row, column) + fy * density_.at(share, row + 1, column);
    const double right =
        (1 - fy) * density_.at(share, row, column + 1) + fy * density_.at(share, row + 1, column + 1);
    const double before =
        (1 - fy) * conditional_.at(share, row, column) + fy * conditional_.at(share, row + 1, column);
    const std::size_t last = density_.columns() - 1;
    const double rowLow = conditional_.at(share, row, last), rowHigh = conditional_.at(share, row + 1, last);
    const double rowTotal = (1 - fy) * rowLow + fy * rowHigh;
    const double u = rowTotal > 0 ? (before + fx * (left + 0.5 * fx * (right - left))) / rowTotal : 0;
    const double v = marginal_.at(share, row, 0) + fy * (rowLow + 0.5 * fy * (rowHigh - rowLow));
    return {u, v};
  }

 private:
  Slices density_, conditional_, marginal_;
};

struct RglData {
  std::vector<float> phiI, thetaI;
  Slices ndf, sigma, rgb;
  DensityWarp vndf;
  bool isotropic = true;
  bool jacobian = true;
  int symmetry = 1;  ///< 2: phi and phi + pi are alike; 4: mirror images too
};

class RglBrdf final : public Brdf {
 public:
  RglBrdf(RglData data, BrdfOrigin origin) : Brdf(std::move(origin)), data_(std::move(data)) {}

  bool isotropic() const override { return data_.isotropic; }

  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    Eigen::Vector3d in = toLight, out = toView;
    const Eigen::Array3d unknown = Eigen::Array3d::Constant(std::numeric_limits<double>::quiet_NaN());
    if (in.z() < 0 || out.z() < kLeastCosine) return unknown;
    unfold(in, out);

    const Eigen::Vector3d half = (in + out).normalized();
    const double thetaI = std::acos(std::min(in.z(), 1.0)), phiI = std::atan2(in.y(), in.x());
    const double thetaM = std::acos(std::min(half.z(), 1.0)), phiM = std::atan2(half.y(), half.x());
    const double uI = toUnit(thetaI), vI = (phiI + kPi) / (2 * kPi);
    const double uM = toUnit(thetaM);
    double vM = ((data_.isotropic ? phiM - phiI : phiM) + kPi) / (2 * kPi);
    vM -= std::floor(vM);

    static constexpr SliceShare kOnly = {{0}, {1.0}, 1};
    double scale = 1 / out.z();
    if (data_.jacobian) {
      const double area = data_.sigma.bilinear(kOnly, uI, vI);
      if (!(area > 0)) return unknown;
      scale *= data_.ndf.bilinear(kOnly, uM, vM) / (4 * area);
    }
    const SliceShare share = shareOf(phiI, thetaI);
    const auto [u, v] = data_.vndf.invert(share, uM, vM);
    Eigen::Array3d value;
    for (int channel = 0; channel < 3; ++channel) {
      SliceShare plane = share;
      for (int i = 0; i < plane.count; ++i) plane.slice[i] = plane.slice[i] * 3 + channel;
      value[channel] = std::clamp(data_.rgb.bilinear(plane, u, v) * scale, 0.0, kLargestValue);
    }
    return value;
  }

 private:
  static double toUnit(double theta) { return std::sqrt(theta * (2 / kPi)); }

  /// Turns or mirrors a pair until the incident azimuth is one that the file holds.
  void unfold(Eigen::Vector3d& in, Eigen::Vector3d& out) const {
    if (data_.symmetry == 1) return;
    constexpr double kSlack = 1e-4;  // radians; the ends of the range are single-precision numbers
    const auto held = [&](double x, double y) {
      const double phi = std::atan2(y, x);
      for (const double turn : {0.0, 2 * kPi, -2 * kPi}) {
        if (phi + turn >= data_.phiI.front() - kSlack && phi + turn <= data_.phiI.back() + kSlack)
          return true;
      }
      return false;
    };
    static constexpr std::array<std::array<double, 2>, 4> kImages = {{{1, 1}, {-1, -1}, {-1, 1}, {1, -1}}};
    for (int i = 0; i < data_.symmetry; ++i) {
      const auto [signX, signY] = kImages[i];
      if (!held(signX * in.x(), signY * in.y())) continue;
      in.x() *= signX, in.y() *= signY;
      out.x() *= signX, out.y() *= signY;
      return;
    }
  }

  SliceShare shareOf(double phiI, double thetaI) const {
    const Bracket theta = bracket(data_.thetaI, thetaI);
    Bracket phi;
    if (!data_.isotropic) {
      // The range may begin anywhere; an azimuth is the same a full turn on.
      if (phiI < data_.phiI.front() && phiI + 2 * kPi <= data_.phiI.back()) phiI += 2 * kPi;
      if (phiI > data_.phiI.back() && phiI - 2 * kPi >= data_.phiI.front()) phiI -= 2 * kPi;
      phi = bracket(data_.phiI, phiI);
    }
    SliceShare share;
    const std::size_t thetas = data_.thetaI.size();
    for (const int p : {0, 1}) {
      for (const int t : {0, 1}) {
        const double weight = (p ? phi.share : 1 - phi.share) * (t ? theta.share : 1 - theta.share);
        if (weight <= 0) continue;
        share.slice[share.count] = (phi.low + p) * thetas + theta.low + t;
        share.weight[share.count++] = weight;
      }
    }
    return share;
  }

  RglData data_;
};

/// Takes typed, checked arrays out of the file, and keeps the first thing that is wrong.
class FieldReader {
 public:
  FieldReader(const std::map<std::string, TensorField, std::less<>>& fields, const std::string& where)
      : fields_(fields), where_(where) {}

  const std::optional<Error>& error() const { return error_; }
  bool has(std::string_view name) const { return fields_.find(name) != fields_.end(); }
  void fail(std::string what) {
    if (!error_)
      error_ = Error{ErrorCode::Malformed, std::move(what), where_, "fetch or copy the file again"};
  }

  const TensorField* field(std::string_view name, std::size_t rank, TensorField::Type type) {
    const auto found = fields_.find(name);
    if (found == fields_.end()) {
      fail("the field " + inQuotes(name) + " is missing");
      return nullptr;
    }
    if (found->second.type != type || found->second.shape.size() != rank) {
      fail("the field " + inQuotes(name) + " has another type or rank than in an RGL file");
      return nullptr;
    }
    return &found->second;
  }

  /// Single-precision numbers, all finite and at least `least`.
  std::vector<float> floats(std::string_view name, std::size_t rank, double least,
                            std::vector<std::size_t>* shape = nullptr) {
    const TensorField* found = field(name, rank, TensorField::Type::Float32);
    if (!found) return {};
    std::vector<float> values(found->count());
    std::memcpy(values.data(), found->bytes.data(), found->bytes.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (std::abs(values[i]) <= kLargestEntry && values[i] >= least) continue;
      fail("value " + std::to_string(i) + " of " + inQuotes(name) +
           (std::isfinite(values[i]) ? " is " + std::to_string(values[i]) + ", which can't be"
                                     : std::string(" is not a finite number")));
      return {};
    }
    if (shape) *shape = found->shape;
    return values;
  }

  /// A direction's coordinate: ascending, within [low, high].
  std::vector<float> ascending(std::string_view name, double low, double high) {
    std::vector<float> values = floats(name, 1, low);
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (values[i] > high || (i > 0 && !(values[i] > values[i - 1]))) {
        fail("the angles of " + inQuotes(name) + " don't ascend, or leave their range");
        return {};
      }
    }
    return values;
  }

 private:
  const std::map<std::string, TensorField, std::less<>>& fields_;
  const std::string& where_;
  std::optional<Error> error_;
};

std::string materialName(const std::string& where) {
  std::string name = std::filesystem::path(where).stem().string();
  constexpr std::string_view kEnding = "_rgb";
  if (name.size() > kEnding.size() && name.ends_with(kEnding)) name.resize(name.size() - kEnding.size());
  return name;
}

}  // namespace

Result<BrdfPtr> readRglBytes(std::string_view bytes, const std::string& where) {
  const auto fields = parseTensorFile(bytes, where);
  if (!fields) return fields.error();
  FieldReader reader(*fields, where);
  if (!reader.has("rgb")) {
    if (reader.has("spectra")) {
      return Error{ErrorCode::Unsupported, "this is a spectral RGL file, and only the RGB ones are read",
                   where, "fetch the file of the same material that ends in _rgb.bsdf"};
    }
    return Error{ErrorCode::Malformed, "a tensor file without the field 'rgb' is no RGB measurement", where,
                 "name a .bsdf file of the RGL database"};
  }

  constexpr double kAngleSlack = 1e-3;  // single-precision multiples of pi
  constexpr double kNoBound = -std::numeric_limits<double>::infinity();
  RglData data;
  data.phiI = reader.ascending("phi_i", -2 * kPi - kAngleSlack, 2 * kPi + kAngleSlack);
  data.thetaI = reader.ascending("theta_i", -kAngleSlack, kPi / 2 + kAngleSlack);
  std::vector<std::size_t> ndfShape, sigmaShape, vndfShape, rgbShape;
  std::vector<float> ndf = reader.floats("ndf", 2, 0, &ndfShape);
  std::vector<float> sigma = reader.floats("sigma", 2, 0, &sigmaShape);
  std::vector<float> vndf = reader.floats("vndf", 4, 0, &vndfShape);
  std::vector<float> rgb = reader.floats("rgb", 5, kNoBound, &rgbShape);
  if (reader.error()) return *reader.error();

  const auto alike = [&](const std::vector<std::size_t>& shape) {
    return shape[0] == data.phiI.size() && shape[1] == data.thetaI.size();
  };
  if (!alike(vndfShape) || !alike(rgbShape) || rgbShape[2] != 3) {
    reader.fail("'vndf' and 'rgb' don't have one slice for each incident direction");
  }
  for (const auto* shape : {&ndfShape, &sigmaShape, &vndfShape, &rgbShape}) {
    if (shape->back() < 2 || (*shape)[shape->size() - 2] < 2) {
      reader.fail("a table has fewer than 2 x 2 entries");
    }
  }
  if (reader.has("jacobian")) {
    const TensorField* flag = reader.field("jacobian", 1, TensorField::Type::UInt8);
    if (flag) data.jacobian = flag->bytes.front() != 0;
  }
  std::string description;
  if (reader.has("description")) {
    if (const TensorField* text = reader.field("description", 1, TensorField::Type::UInt8)) {
      description = std::string(text->bytes);
    }
  }
  if (reader.error()) return *reader.error();

  data.isotropic = data.phiI.size() <= 2;
  if (!data.isotropic) {
    const double range = static_cast<double>(data.phiI.back()) - data.phiI.front();
    data.symmetry = static_cast<int>(std::lround(std::min(2 * kPi / range, 1000.0)));
    if (data.symmetry != 1 && data.symmetry != 2 && data.symmetry != 4) {
      return Error{ErrorCode::Unsupported,
                   "the incident azimuths cover 1/" + std::to_string(data.symmetry) +
                       " of a turn; known are whole, half and quarter turns",
                   where, "name a file of the RGL database"};
    }
  }
  data.ndf = Slices(std::move(ndf), ndfShape[0], ndfShape[1]);
  data.sigma = Slices(std::move(sigma), sigmaShape[0], sigmaShape[1]);
  data.vndf = DensityWarp(Slices(std::move(vndf), vndfShape[2], vndfShape[3]));
  data.rgb = Slices(std::move(rgb), rgbShape[3], rgbShape[4]);

  std::string note = description.empty() ? "" : inQuotes(description) + "; ";
  note += std::string(data.isotropic ? "isotropic" : "anisotropic") + ", as measured: not exactly reciprocal";
  return BrdfPtr(std::make_shared<RglBrdf>(std::move(data),
                                           BrdfOrigin{materialName(where), "rgl", where, std::move(note)}));
}

}  // namespace patina
