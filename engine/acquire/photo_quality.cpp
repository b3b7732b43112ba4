#include "engine/acquire/photo_quality.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>

#include "engine/acquire/picture_shift.h"

namespace patina {
namespace {

constexpr int kPlaces = 10;   ///< a side, over the sample
constexpr int kCellsX = 128;  ///< cells over the screen's width, at most
/// Lobes: sigma of the half-vector's slope, and where they lie (relief turns normals).
struct Lobe {
  double sigma, x, y;
};
constexpr std::array<Lobe, 7> kLobes{{{0.05, 0, 0},
                                      {0.13, 0, 0},
                                      {0.3, 0, 0},
                                      {0.07, 0.09, 0},
                                      {0.07, -0.09, 0},
                                      {0.07, 0, 0.09},
                                      {0.07, 0, -0.09}}};
constexpr int kParts = 1 + static_cast<int>(kLobes.size());
constexpr double kRidge = 2e-2;  ///< of the weights towards equal ones: what few photographs can't tell
constexpr int kFewPatterns = 8;  ///< before that brightness can't be predicted
constexpr double kPlain = 0.1;   ///< relative residual below which a prediction is good whatever others say
constexpr double kFarBetter =
    0.45;  ///< another picture explains the photograph so much better that it is the one
constexpr double kNotBlack = 0.4;  ///< of the window's light: no room that passed the checklist gives so much
constexpr double kDark = 0.04;     ///< of the window: a photograph that dark is black

using Weights = Eigen::Matrix<double, kParts, 1>;
using Products = Eigen::Matrix<double, kParts, kParts>;

struct Place {
  Eigen::Vector2i pixel;
  Eigen::Matrix<float, kParts, Eigen::Dynamic, Eigen::RowMajor>
      kernels;  ///< parts x cells, 1 under the window
  double window = 0, black = 0;
  Products products = Products::Zero();
  Weights right = Weights::Zero();
  Weights weights = Weights::Constant(1.0 / kParts);
};

/// Least squares with weights that aren't negative, by coordinates.
Weights solveNotNegative(const Products& products, const Weights& right, Weights start) {
  constexpr int kRounds = 80;  // four unknowns: converged to 1e-6
  for (int round = 0; round < kRounds; ++round)
    for (int i = 0; i < kParts; ++i) {
      const double left = right[i] - products.row(i).dot(start) + products(i, i) * start[i];
      start[i] = products(i, i) > 0 ? std::max(0.0, left / products(i, i)) : 0.0;
    }
  return start;
}

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*f %%", std::abs(share) < 0.1 ? 1 : 0, 100 * share);
  return text;
}

}  // namespace

std::string faultName(PhotoFault fault) {
  switch (fault) {
    case PhotoFault::Clipped:
      return "clipped";
    case PhotoFault::Shaken:
      return "shaken";
    case PhotoFault::WrongPattern:
      return "wrong pattern";
    case PhotoFault::BrightnessOff:
      return "brightness off";
  }
  return {};
}

struct PhotoWatch::State {
  RigDescription rig;
  PhotoQualityLimits limits;
  int cellsX = 0, cellsY = 0;
  std::vector<Place> places;
  Image mask;  ///< of the sample
  Image windowPhoto;
  bool hasWindow = false, hasBlack = false;
  int learnt = 0;
  // The phases of the frequency at hand that were accepted.
  Eigen::Vector2i frequency = Eigen::Vector2i::Zero();
  std::array<bool, 4> phases{};
  Image sum;  ///< of them, grey
  double brightnessSquares = 0;
  int brightnessCount = 0;
  mutable std::map<std::string, Eigen::VectorXf> patterns;  ///< by name, cell means

  const Eigen::VectorXf& cellMeans(const PatternSpec& spec) const {
    const std::string name = patternName(spec);
    if (const auto found = patterns.find(name); found != patterns.end()) return found->second;
    if (patterns.size() > 64) patterns.clear();
    // From the screen's own pixels: where they are few a pattern's sum isn't that of its formula.
    const Image image = patternImage(spec, rig.screen);
    Eigen::VectorXf means = Eigen::VectorXf::Zero(cellsX * cellsY), counts = means;
    for (int y = 0; y < image.height(); ++y)
      for (int x = 0; x < image.width(); ++x) {
        const int cell = y * cellsY / image.height() * cellsX + x * cellsX / image.width();
        means[cell] += image.at(x, y);
        counts[cell] += 1;
      }
    means = means.cwiseQuotient(counts.cwiseMax(1));
    return patterns.emplace(name, std::move(means)).first->second;
  }
  Weights features(const Place& place, const PatternSpec& spec) const {
    return (place.kernels * cellMeans(spec)).cast<double>();
  }
  double valueAt(const Image& photo, const Place& place) const {
    double sum = 0;
    int count = 0;
    for (int j = -1; j <= 1; ++j)
      for (int i = -1; i <= 1; ++i) {
        const int x = place.pixel.x() + i, y = place.pixel.y() + j;
        if (x < 0 || y < 0 || x >= photo.width() || y >= photo.height()) continue;
        for (int c = 0; c < photo.channels(); ++c) sum += photo.at(x, y, c);
        count += photo.channels();
      }
    return count > 0 ? sum / count : 0;
  }
  bool usable(const Place& place) const { return place.window > 1e-12; }
  /// Relative residual and brightness of a picture's prediction.
  struct Match {
    double residual = 1, brightness = 0;
  };
  Match match(const Image& photo, const PatternSpec& spec) const {
    double yy = 0, yp = 0, pp = 0, count = 0;
    for (const Place& place : places) {
      if (!usable(place)) continue;
      const double y = (valueAt(photo, place) - place.black) / place.window;
      const double predicted = features(place, spec).dot(place.weights);
      yy += y * y, yp += y * predicted, pp += predicted * predicted;
      ++count;
    }
    Match found;
    const double least = count * kDark * kDark;
    if (pp < 1e-9) {  // black is asked for: what is there is the residual
      found.residual = std::sqrt(yy / std::max(yy, least));
      if (yy < least) found.residual = 0.5 * std::sqrt(yy / least);
      found.brightness = 1;
      return found;
    }
    found.brightness = yp / pp;
    const double scale = std::clamp(found.brightness, 0.5, 2.0);
    found.residual = std::sqrt(std::max(0.0, yy - 2 * scale * yp + scale * scale * pp) / std::max(yy, least));
    return found;
  }
};

namespace {

void add(Image& sum, const Image& photo) {
  for (int y = 0; y < sum.height(); ++y)
    for (int x = 0; x < sum.width(); ++x) {
      float grey = 0;
      for (const float sample : photo.pixel(x, y)) grey += sample;
      sum.at(x, y) += grey / static_cast<float>(photo.channels());
    }
}

}  // namespace

PhotoWatch::PhotoWatch(const RigDescription& rig, const PhotoQualityLimits& limits)
    : state_(std::make_unique<State>()) {
  State& s = *state_;
  s.rig = rig;
  s.limits = limits;
  // Whole pixels a cell, as far as they divide.
  const int pixelsEach = std::max(1, (rig.screen.widthPx + kCellsX - 1) / kCellsX);
  s.cellsX = std::max(1, rig.screen.widthPx / pixelsEach);
  s.cellsY = std::max(1, rig.screen.heightPx / pixelsEach);
  const Camera& camera = rig.camera;
  s.mask = Image(camera.width, camera.height, 1);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x)
      if (const auto at = camera.samplePlaneFromPixel({x, y}))
        s.mask.at(x, y) =
            std::abs(at->x()) <= rig.sampleWidthMm / 2 && std::abs(at->y()) <= rig.sampleHeightMm / 2 ? 1.0f
                                                                                                      : 0.0f;

  PatternSpec windowSpec;
  windowSpec.kind = PatternSpec::Kind::Window;
  const Eigen::VectorXf& window = s.cellMeans(windowSpec);
  const Eigen::Vector3d eye = camera.positionMm(), screenNormal = rig.screen.worldFromScreen.col(2);
  for (int j = 0; j < kPlaces; ++j)
    for (int i = 0; i < kPlaces; ++i) {
      const Eigen::Vector3d point(((i + 0.5) / kPlaces - 0.5) * rig.sampleWidthMm,
                                  (0.5 - (j + 0.5) / kPlaces) * rig.sampleHeightMm, 0);
      const auto pixel = camera.pixelFromWorld(point);
      if (!pixel) continue;
      Place place;
      place.pixel = {static_cast<int>(std::lround(pixel->x())), static_cast<int>(std::lround(pixel->y()))};
      if (place.pixel.x() < 0 || place.pixel.y() < 0 || place.pixel.x() >= camera.width ||
          place.pixel.y() >= camera.height)
        continue;
      place.kernels.setZero(kParts, s.cellsX * s.cellsY);
      const Eigen::Vector3d toView = (eye - point).normalized();
      for (int cy = 0; cy < s.cellsY; ++cy)
        for (int cx = 0; cx < s.cellsX; ++cx) {
          const Eigen::Vector3d local(((cx + 0.5) / s.cellsX - 0.5) * rig.screen.widthMm,
                                      (0.5 - (cy + 0.5) / s.cellsY) * rig.screen.heightMm, 0);
          const Eigen::Vector3d to = rig.screen.originMm + rig.screen.worldFromScreen * local - point;
          const double distance = to.norm();
          const Eigen::Vector3d toLight = to / distance, sum = toLight + toView;
          const double away = -toLight.dot(screenNormal);
          if (toLight.z() <= 0 || away <= 0) continue;
          double base = toLight.z() * away / (distance * distance);
          if (rig.screen.emission) {
            const Eigen::Vector3d foot =
                rig.screen.worldFromScreen.transpose() * (point - rig.screen.originMm);
            const Eigen::Array2d q =
                ((local.head<2>() - foot.head<2>()) / foot.z() - rig.screen.emission->mean).array() /
                rig.screen.emission->sigma.array();
            base *= std::exp(-0.5 * q.square().sum());
          }
          const int cell = cy * s.cellsX + cx;
          place.kernels(0, cell) = static_cast<float>(base);
          const double slopeX = sum.x() / sum.z(), slopeY = sum.y() / sum.z();
          for (std::size_t k = 0; k < kLobes.size(); ++k) {
            const Lobe& lobe = kLobes[k];
            const double slope2 =
                (slopeX - lobe.x) * (slopeX - lobe.x) + (slopeY - lobe.y) * (slopeY - lobe.y);
            place.kernels(static_cast<int>(k) + 1, cell) =
                static_cast<float>(base / toLight.z() * std::exp(-0.5 * slope2 / (lobe.sigma * lobe.sigma)));
          }
        }
      for (int part = 0; part < kParts; ++part) {
        const float total = place.kernels.row(part).dot(window);
        if (total > 0) place.kernels.row(part) /= total;
      }
      s.places.push_back(std::move(place));
    }
}

PhotoWatch::~PhotoWatch() = default;
PhotoWatch::PhotoWatch(PhotoWatch&&) noexcept = default;

void PhotoWatch::learn(const Image& photo, const PatternSpec& pattern) {
  State& s = *state_;
  const bool window = pattern.kind == PatternSpec::Kind::Window;
  if (window && !s.hasWindow) {
    s.windowPhoto = photo;
    s.hasWindow = true;
    for (Place& place : s.places) place.window = s.valueAt(photo, place) - place.black;
  } else if (pattern.kind == PatternSpec::Kind::Black && !s.hasBlack) {
    s.hasBlack = true;
    for (Place& place : s.places) {
      place.black = s.valueAt(photo, place);
      if (s.hasWindow) place.window -= place.black;
    }
    return;
  }
  if (!s.hasWindow || !s.hasBlack || pattern.kind == PatternSpec::Kind::Black) return;
  if (pattern.kind == PatternSpec::Kind::Sine) {
    if (pattern.frequency != s.frequency || pattern.phase == 0) {
      s.frequency = pattern.frequency;
      s.phases = {};
      s.sum = Image(photo.width(), photo.height(), 1);
    }
    if (!s.phases[static_cast<std::size_t>(pattern.phase)]) add(s.sum, photo);
    s.phases[static_cast<std::size_t>(pattern.phase)] = true;
  }
  if (s.learnt >= kFewPatterns && !window) {
    const State::Match match = s.match(photo, pattern);
    s.brightnessSquares += (match.brightness - 1) * (match.brightness - 1);
    ++s.brightnessCount;
  }
  for (Place& place : s.places) {
    if (!s.usable(place)) continue;
    const Weights features = s.features(place, pattern);
    place.products += features * features.transpose();
    place.right += features * ((s.valueAt(photo, place) - place.black) / place.window);
    Products products = place.products;
    Weights right = place.right;
    const double ridge = kRidge * std::max(1.0, products.trace() / kParts);
    products.diagonal().array() += ridge;
    right.array() += ridge / kParts;
    place.weights = solveNotNegative(products, right, place.weights);
  }
  if (!window) ++s.learnt;
}

PhotoQuality PhotoWatch::judge(const Image& photo, const Image& clipped, const PatternSpec& asked,
                               const std::optional<PatternSpec>& before) const {
  const State& s = *state_;
  PhotoQuality quality;
  const auto fault = [&](PhotoFault what, const std::string& sentence) {
    quality.faults.push_back(what);
    quality.sentence += (quality.sentence.empty() ? "" : " ") + sentence;
  };
  if (!clipped.empty() && clipped.width() == s.mask.width() && clipped.height() == s.mask.height()) {
    double hit = 0, all = 0;
    for (std::size_t i = 0; i < s.mask.samples().size(); ++i)
      if (s.mask.samples()[i] > 0) ++all, hit += clipped.samples()[i] > 0 ? 1 : 0;
    quality.clippedShare = all > 0 ? hit / all : 0;
    if (quality.clippedShare > s.limits.clippedShare)
      fault(PhotoFault::Clipped,
            percent(quality.clippedShare) +
                " of the sample is brighter than the camera can hold: shorten the exposure.");
  }
  const bool same = photo.width() == s.windowPhoto.width() && photo.height() == s.windowPhoto.height();
  const bool dark = asked.kind == PatternSpec::Kind::Black;
  if (dark && s.hasWindow && same) {
    double black = 0, window = 0;
    for (const Place& place : s.places)
      black += s.valueAt(photo, place), window += s.valueAt(s.windowPhoto, place);
    if (black > kNotBlack * window)
      fault(PhotoFault::WrongPattern,
            "With the screen black the sample is " + percent(black / window) +
                " as bright as under the window: the screen shows something else, or the room is lit.");
  }
  const auto moved = [&](const PictureShift& shift) {
    if (!(shift.uncertaintyPx < 0.5 * s.limits.movedPx)) return false;
    quality.movedPx = shift.px.norm();
    if (!(*quality.movedPx > s.limits.movedPx && *quality.movedPx > 5 * shift.uncertaintyPx)) return false;
    char text[160];
    std::snprintf(
        text, sizeof text,
        "The picture has moved by %.1f pixels: nothing may touch the table, the camera or the sample.",
        *quality.movedPx);
    fault(PhotoFault::Shaken, text);
    return true;
  };
  if (s.hasWindow && same && !dark) moved(pictureShift(s.windowPhoto, photo, s.mask));
  if (!s.hasWindow || !s.hasBlack || !same || dark) return quality;

  const bool last = asked.kind == PatternSpec::Kind::Sine && asked.phase == 3 &&
                    asked.frequency == s.frequency && s.phases[0] && s.phases[1] && s.phases[2] &&
                    !s.phases[3];
  if (last && quality.faults.empty()) {
    Image sum = s.sum;
    add(sum, photo);
    quality.wholeSet = moved(pictureShift(s.windowPhoto, sum, s.mask));
    double seen = 0, predicted = 0;
    Eigen::VectorXf all = Eigen::VectorXf::Zero(s.cellsX * s.cellsY);
    for (int phase = 0; phase < 4; ++phase) {
      PatternSpec one = asked;
      one.phase = phase;
      all += s.cellMeans(one);
    }
    for (const Place& place : s.places) {
      if (!s.usable(place)) continue;
      seen += (s.valueAt(sum, place) - 4 * place.black) / place.window;
      predicted += (place.kernels * all).cast<double>().dot(place.weights);
    }
    if (predicted > 0) quality.setBrightness = seen / predicted;
    if (quality.setBrightness && std::abs(*quality.setBrightness - 1) > s.limits.setBrightness) {
      fault(PhotoFault::BrightnessOff,
            "The four photographs of this frequency are together " +
                percent(std::abs(*quality.setBrightness - 1)) +
                (*quality.setBrightness > 1 ? " brighter" : " darker") +
                " than they must be: did the room's light or the screen's brightness change?");
      quality.wholeSet = true;
    }
  }

  const State::Match expected = s.match(photo, asked);
  quality.expectedResidual = expected.residual;
  std::vector<PatternSpec> others;
  const auto consider = [&](const PatternSpec& other) {
    if (!(other == asked)) others.push_back(other);
  };
  if (before) consider(*before);
  PatternSpec window;
  window.kind = PatternSpec::Kind::Window;
  consider(window);
  consider(PatternSpec{});
  if (asked.kind == PatternSpec::Kind::Sine)
    for (int phase = 0; phase < 4; ++phase) {
      PatternSpec other = asked;
      other.phase = phase;
      consider(other);
    }
  for (const PatternSpec& other : others) {
    const State::Match match = s.match(photo, other);
    if (quality.alternativeResidual && match.residual >= *quality.alternativeResidual) continue;
    quality.alternativeResidual = match.residual;
    quality.alternative = patternName(other);
  }
  if (expected.residual > kPlain && quality.alternativeResidual &&
      *quality.alternativeResidual < kFarBetter * expected.residual) {
    fault(PhotoFault::WrongPattern,
          "The photograph shows " + quality.alternative + " instead of " + patternName(asked) +
              ": the screen was later than its measured latency. Measure the latency again.");
  } else if (s.learnt >= kFewPatterns) {
    quality.brightness = expected.brightness;
    // Of the window again all is known.
    const bool again = asked.kind == PatternSpec::Kind::Window;
    const double limit = again ? s.limits.setBrightness : s.limits.brightness;
    const double usual = std::sqrt(s.brightnessSquares / std::max(1, s.brightnessCount));
    if (quality.faults.empty() &&
        std::abs(expected.brightness - 1) > (again ? limit : std::max(limit, 4 * usual)))
      fault(PhotoFault::BrightnessOff,
            "The photograph is " + percent(std::abs(expected.brightness - 1)) +
                (expected.brightness > 1 ? " brighter" : " darker") +
                " than the others say: did the room's light or the screen's brightness change?");
  }
  return quality;
}

}  // namespace patina
