#include "engine/calibration/white_tile.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include "engine/base/text.h"

namespace patina {
namespace {

constexpr int kBlocks = 56;             // across the longer side: enough for order 6, quick
constexpr double kMostClipped = 0.001;  // of the samples
constexpr double kDarkest = 0.1;        // of full scale: below, noise and black level count
constexpr double kMostUneven = 0.5;     // lowest over highest light
constexpr double kShadowDepth = 0.03;   // a dip that noise and the polynomial don't make
constexpr double kMostShaded = 0.01;    // of the tile
constexpr double kNoisiest = 0.05;      // of one pixel; beyond, something is not a tile
constexpr std::int64_t kFewestPixels = 100;
constexpr int kReweightings = 20;

/// Legendre polynomials P_0 to P_order at x.
Eigen::VectorXd legendre(double x, int order) {
  Eigen::VectorXd p(order + 1);
  p[0] = 1;
  if (order > 0) p[1] = x;
  for (int k = 2; k <= order; ++k) p[k] = ((2 * k - 1) * x * p[k - 1] - (k - 1) * p[k - 2]) / k;
  return p;
}

/// Products P_i(u) P_j(v), i + j up to the order.
Eigen::VectorXd basisAt(double u, double v, int order) {
  const Eigen::VectorXd pu = legendre(u, order), pv = legendre(v, order);
  Eigen::VectorXd basis((order + 1) * (order + 2) / 2);
  Eigen::Index at = 0;
  for (int i = 0; i <= order; ++i)
    for (int j = 0; i + j <= order; ++j) basis[at++] = pu[i] * pv[j];
  return basis;
}

struct Block {
  double u = 0, v = 0, mean = 0, variance = 0;  ///< variance of the mean
  int pixels = 0;
};

struct SmoothLight {
  Eigen::VectorXd coefficients;
  Eigen::MatrixXd covariance;
  std::vector<double> deviation;  ///< of each block, relative
  double spread = 0;              ///< robust standard deviation of them
};

double medianOf(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Weighted polynomial through the blocks, those that stick out (dust, shadows) given no weight: Tukey's
/// biweight, its scale from the median deviation.
bool fitLight(const std::vector<Block>& blocks, int order, SmoothLight* light) {
  const auto rows = static_cast<Eigen::Index>(blocks.size());
  const Eigen::Index terms = (order + 1) * (order + 2) / 2;
  if (rows < 2 * terms) return false;
  Eigen::MatrixXd design(rows, terms);
  Eigen::VectorXd value(rows), weight = Eigen::VectorXd::Ones(rows);
  for (Eigen::Index i = 0; i < rows; ++i) {
    design.row(i) = basisAt(blocks[i].u, blocks[i].v, order).transpose();
    value[i] = blocks[i].mean;
    weight[i] = blocks[i].pixels;
  }
  const Eigen::VectorXd full = weight;
  Eigen::MatrixXd normal;
  for (int pass = 0; pass < kReweightings; ++pass) {
    normal = design.transpose() * weight.asDiagonal() * design;
    light->coefficients = normal.ldlt().solve(design.transpose() * (weight.asDiagonal() * value));
    const Eigen::VectorXd model = design * light->coefficients;
    light->deviation.assign(static_cast<std::size_t>(rows), 0);
    std::vector<double> size;
    for (Eigen::Index i = 0; i < rows; ++i) {
      if (!(model[i] > 0)) return false;
      light->deviation[i] = value[i] / model[i] - 1;
      size.push_back(std::abs(light->deviation[i]));
    }
    light->spread = std::max(1.4826 * medianOf(size), 1e-7);
    // First gently, so that a shadow over a third of the tile doesn't become the rule.
    const double reach = (pass < 8 ? 6.0 : 4.7) * light->spread;
    for (Eigen::Index i = 0; i < rows; ++i) {
      const double t = light->deviation[i] / reach;
      weight[i] = std::abs(t) < 1 ? full[i] * (1 - t * t) * (1 - t * t) : 0;
    }
  }
  double sum = 0, weights = 0;
  const Eigen::VectorXd model = design * light->coefficients;
  for (Eigen::Index i = 0; i < rows; ++i) {
    sum += weight[i] * (value[i] - model[i]) * (value[i] - model[i]);
    weights += weight[i] > 0;
  }
  const double variance = sum / std::max(1.0, weights - static_cast<double>(terms));
  light->covariance = variance * normal.ldlt().solve(Eigen::MatrixXd::Identity(terms, terms));
  return light->coefficients.allFinite();
}

std::string percent(double share, int digits = 1) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*f %%", digits, 100 * share);
  return text;
}

}  // namespace

bool WhiteTileCalibration::passed() const {
  return std::all_of(checks.begin(), checks.end(), [](const TileCheck& check) { return check.passed; });
}

Result<WhiteTileCalibration> calibrateWhiteTile(const Image& photo, const CertifiedReflectance& reflectance,
                                                const WhiteTileOptions& options, const JobContext& job) {
  const auto invalid = [](const std::string& what, const std::string& where, const std::string& tryThis) {
    return Error{ErrorCode::Invalid, what, where, tryThis};
  };
  if (photo.channels() != 3) return invalid("the photograph has no three channels", "tile", "");
  if (!(options.exposureS > 0 && std::isfinite(options.exposureS)))
    return invalid("the exposure is not positive", "exposure", "seconds, as the camera was set");
  if (options.smoothOrder < 0 || options.smoothOrder > 6)
    return invalid("the light's polynomial has order 0 to 6", "order", "4");
  for (int c = 0; c < 3; ++c)
    if (!(reflectance.rgb[c] > 0.01 && reflectance.rgb[c] <= 1.05))
      return invalid("a tile reflects 0.01 to 1.05 of the light", "reflectance",
                     "what its certificate says, 0.99 for instance");
  PixelRegion region = options.region;
  if (region.whole()) region = {0, 0, photo.width(), photo.height()};
  if (region.x0 < 0 || region.y0 < 0 || region.x1 > photo.width() || region.y1 > photo.height())
    return invalid(
        "the region leaves the picture", "region",
        "x0,y0,x1,y1 within " + std::to_string(photo.width()) + " x " + std::to_string(photo.height()));
  const int width = region.x1 - region.x0, height = region.y1 - region.y0;
  if (static_cast<std::int64_t>(width) * height < kFewestPixels)
    return invalid("the region has fewer than 100 pixels", "region", "");

  // Where the sensor clips: said, or a plateau at the largest value.
  double largest = 0;
  std::size_t atLargest = 0;
  for (int y = region.y0; y < region.y1; ++y)
    for (int x = region.x0; x < region.x1; ++x)
      for (int c = 0; c < 3; ++c) {
        const double v = photo.at(x, y, c);
        if (!std::isfinite(v)) return invalid("a pixel is no number", "tile", "");
        if (v > largest) largest = v, atLargest = 0;
        atLargest += v == largest;
      }
  const double samples = 3.0 * width * height;
  const bool plateau = static_cast<double>(atLargest) > std::max(4.0, 0.0005 * samples);
  // What was said may have lost its last digits in a float picture.
  const double clipAt = options.saturation > 0 ? options.saturation * (1 - 1e-5)
                        : plateau              ? largest
                                               : INFINITY;

  WhiteTileCalibration result;
  result.region = region;
  result.reflectance = reflectance;
  result.irradiance = Image(photo.width(), photo.height(), 3);
  std::size_t clipped = 0;
  const int step = std::max(1, (std::max(width, height) + kBlocks - 1) / kBlocks);
  double shaded = 0, lowest = INFINITY, highest = 0, noise = 0, brightness = 0, residual = 0;
  for (int c = 0; c < 3; ++c) {
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "the calibration was cancelled", "", ""};
    std::vector<Block> blocks;
    for (int y0 = region.y0; y0 < region.y1; y0 += step) {
      for (int x0 = region.x0; x0 < region.x1; x0 += step) {
        const int x1 = std::min(x0 + step, region.x1), y1 = std::min(y0 + step, region.y1);
        Block block;
        double sum = 0, squares = 0;
        for (int y = y0; y < y1; ++y)
          for (int x = x0; x < x1; ++x) {
            const double v = photo.at(x, y, c);
            if (v >= clipAt) {
              ++clipped;
              continue;
            }
            sum += v, squares += v * v, ++block.pixels;
          }
        // Where some clip, the rest are the dim ones.
        if (block.pixels < (x1 - x0) * (y1 - y0) * 0.95) continue;
        block.mean = sum / block.pixels - options.blackLevel[c];
        block.variance = std::max(0.0, squares / block.pixels - (sum / block.pixels) * (sum / block.pixels));
        block.u = (0.5 * (x0 + x1 - 1) - region.x0) / std::max(1, width - 1) * 2 - 1;
        block.v = (0.5 * (y0 + y1 - 1) - region.y0) / std::max(1, height - 1) * 2 - 1;
        blocks.push_back(block);
      }
    }
    SmoothLight light;
    int order = options.smoothOrder;
    while (order > 0 && static_cast<std::size_t>((order + 1) * (order + 2)) > blocks.size()) --order;
    if (!fitLight(blocks, order, &light))
      return invalid("the tile is black or clipped nearly everywhere", "tile",
                     "expose so that the tile reaches two thirds of full scale");
    const double toIrradiance = std::numbers::pi / (reflectance.rgb[c] * options.exposureS);
    // P_i(u) of each column once; a row then is a polynomial in u alone.
    Eigen::MatrixXd columns(order + 1, width);
    for (int x = 0; x < width; ++x) columns.col(x) = legendre(x / std::max(1.0, width - 1.0) * 2 - 1, order);
    const Eigen::VectorXd columnSums = columns.rowwise().sum();
    Eigen::VectorXd meanBasis = Eigen::VectorXd::Zero(light.coefficients.size()), along(order + 1);
    double sum = 0, squares = 0, counted = 0;
    const double middleLight = std::max(1e-30, light.coefficients[0]);
    for (int y = 0; y < height; ++y) {
      if (job.cancelled()) return Error{ErrorCode::Cancelled, "the calibration was cancelled", "", ""};
      const Eigen::VectorXd across = legendre(y / std::max(1.0, height - 1.0) * 2 - 1, order);
      along.setZero();
      Eigen::Index at = 0;
      for (int i = 0; i <= order; ++i)
        for (int j = 0; i + j <= order; ++j, ++at) {
          along[i] += light.coefficients[at] * across[j];
          meanBasis[at] += columnSums[i] * across[j];
        }
      for (int x = 0; x < width; ++x) {
        const double model = std::max(0.0, columns.col(x).dot(along));
        sum += model;
        lowest = std::min(lowest, model / middleLight);
        highest = std::max(highest, model / middleLight);
        result.irradiance.at(region.x0 + x, region.y0 + y, c) = static_cast<float>(model * toIrradiance);
        const double v = photo.at(region.x0 + x, region.y0 + y, c);
        const double off = (v - options.blackLevel[c]) / std::max(model, 1e-30) - 1;
        if (v < clipAt && std::abs(off) < 0.5) squares += off * off, ++counted;
      }
    }
    const double pixels = static_cast<double>(width) * height;
    result.mean[c] = sum / pixels * toIrradiance;
    meanBasis /= pixels;
    // The standard deviation of the light at a place, in the middle of the tile, not of its mean alone.
    const Eigen::VectorXd middle = basisAt(0, 0, order);
    const double variance =
        std::max(middle.dot(light.covariance * middle), meanBasis.dot(light.covariance * meanBasis));
    result.relativeSd[c] = std::sqrt(std::max(0.0, variance)) / std::max(1e-30, sum / pixels);
    if (counted > 0) residual += squares / counted / 3;
    noise = std::max(noise, counted > 0 ? std::sqrt(squares / counted) : 0);
    brightness = std::max(brightness, sum / pixels);
    double below = 0;
    const double depth = std::max(kShadowDepth, 5 * light.spread);
    for (const double d : light.deviation) below += d < -depth;
    shaded = std::max(shaded, below / static_cast<double>(light.deviation.size()));
  }
  result.residual = std::sqrt(residual);

  const double clippedShare = static_cast<double>(clipped) / samples;
  result.checks.push_back({"clipped", clippedShare <= kMostClipped, clippedShare,
                           percent(clippedShare) + " of the tile is clipped" +
                               (clippedShare <= kMostClipped ? "" : ": expose shorter")});
  const double scale = std::isfinite(clipAt) ? clipAt : 0;
  const double share = scale > 0 ? brightness / scale : 1;
  result.checks.push_back(
      {"dark", share >= kDarkest, share,
       scale > 0 ? "the tile reaches " + percent(share, 0) + " of full scale" +
                       (share >= kDarkest ? "" : ": expose longer")
                 : std::string("where the sensor clips was not said, so the brightness was not judged")});
  const double even = highest > 0 ? lowest / highest : 0;
  result.checks.push_back(
      {"uneven", even >= kMostUneven, even,
       "the darkest place has " + percent(even, 0) + " of the brightest one's light" +
           (even >= kMostUneven ? "" : ": move the light farther away, or take a smaller region")});
  result.checks.push_back(
      {"shadow", shaded <= kMostShaded, shaded,
       percent(shaded) + " of the tile lies in shadow or is dirty" +
           (shaded <= kMostShaded ? ""
                                  : ": look for what stands in the light, clean the tile, or take "
                                    "a smaller region")});
  result.checks.push_back(
      {"noise", noise <= kNoisiest, noise,
       "pixels scatter by " + percent(noise) +
           (noise <= kNoisiest ? "" : ": expose longer or average; is the whole region tile?")});
  return result;
}

}  // namespace patina
