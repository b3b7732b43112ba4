#include "engine/calibration/camera_response.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>

#include "engine/base/atomic_file.h"
#include "engine/calibration/monotone.h"

namespace patina {
namespace {

constexpr int kCandidates = 40000;  // places that are looked at before some are chosen
constexpr int kBrightnessBins = 40;
constexpr int kRounds = 6;              // of reweighting
constexpr double kExponentStep = 0.01;  // what the curve's exponent may change by over 1/255, at smoothness 1
constexpr double kLeastNoise = 0.0005;  // of a pixel value: a perfect bracket must not divide by zero
constexpr double kSmallestSlope = 0.2;  // exponents below are plateaus, where a value says little
constexpr int kFewestPlaces = 60;

struct Reading {
  int photo = 0;
  double value = 0;
};
/// One place of the picture in one channel, with the exposures in which it is neither black nor clipped.
struct Place {
  std::vector<Reading> readings;
  double brightness = 0, unevenness = 0;
};

struct Patch {
  double mean = 0, spread = 0;
  bool usable = true;  ///< all of it
};

/// 3 x 3 pixels. One of them clipped would pull the mean.
Patch around(const Image& image, int x, int y, int channel, const ResponseOptions& options) {
  Patch patch;
  double squares = 0;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      const double v = image.at(x + dx, y + dy, channel);
      patch.mean += v / 9, squares += v * v / 9;
      patch.usable &= v >= options.lowest && v <= options.highest;
    }
  patch.spread = std::sqrt(std::max(0.0, squares - patch.mean * patch.mean));
  return patch;
}

/// Even places of all brightnesses: bins by brightness, in each the most even ones.
std::vector<Place> choosePlaces(const std::vector<ExposedPhoto>& photos, int channel,
                                const ResponseOptions& options) {
  const Image& first = photos[0].image;
  const double area = static_cast<double>(first.width() - 2) * (first.height() - 2);
  const double step = std::max(1.0, std::sqrt(area / kCandidates));
  std::vector<Place> places;
  for (double py = 1; py < first.height() - 1; py += step) {
    for (double px = 1; px < first.width() - 1; px += step) {
      Place place;
      const int x = static_cast<int>(px), y = static_cast<int>(py);
      for (std::size_t j = 0; j < photos.size(); ++j) {
        const Patch patch = around(photos[j].image, x, y, channel, options);
        place.brightness += patch.mean;
        if (!patch.usable) continue;
        place.readings.push_back({static_cast<int>(j), patch.mean});
        place.unevenness = std::max(place.unevenness, patch.spread / (patch.mean + 0.05));
      }
      if (place.readings.size() >= 2) places.push_back(std::move(place));
    }
  }
  std::sort(places.begin(), places.end(),
            [](const Place& a, const Place& b) { return a.brightness < b.brightness; });
  if (static_cast<int>(places.size()) <= options.samplesPerChannel) return places;
  std::vector<Place> chosen;
  const std::size_t each = std::max(1, options.samplesPerChannel / kBrightnessBins);
  const double low = places.front().brightness, high = places.back().brightness;
  std::size_t from = 0;
  for (int bin = 1; bin <= kBrightnessBins; ++bin) {
    const double edge = low + (high - low) * bin / kBrightnessBins;
    std::size_t to = from;
    while (to < places.size() && (places[to].brightness <= edge || bin == kBrightnessBins)) ++to;
    std::sort(places.begin() + static_cast<std::ptrdiff_t>(from),
              places.begin() + static_cast<std::ptrdiff_t>(to),
              [](const Place& a, const Place& b) { return a.unevenness < b.unevenness; });
    for (std::size_t i = from; i < std::min(to, from + each); ++i) chosen.push_back(std::move(places[i]));
    from = to;
  }
  return chosen;
}

struct Curve {
  Eigen::VectorXd logLight;  ///< at knots 1 .. knots - 1 (value k / (knots - 1)); that at 0 is minus infinity
  double residual = 0, from = 0, to = 0;
  std::vector<double> exposureError;  ///< of each photo, ln
};

/// Debevec and Malik's equation 3 with every place's radiance eliminated. Their curve is smooth in the pixel
/// value; here the local exponent d ln light / d ln value is, so that a power law, linear cameras among them,
/// is bent by nothing.
Curve solveCurve(const std::vector<Place>& places, const std::vector<double>& logTime, std::size_t photos,
                 const ResponseOptions& options, const JobContext& job) {
  const int knots = options.knots, unknowns = knots - 1;
  const auto logKnot = [&](int k) { return std::log(static_cast<double>(k + 1) / (knots - 1)); };
  struct Row {
    int knot;
    double share;  ///< of the next knot
  };
  const auto rowOf = [&](double value) {
    const double position = std::max(value * (knots - 1) - 1, 0.0);
    const int knot = std::min(static_cast<int>(position), unknowns - 2);
    // Linear in the logarithm of the value, as power laws are.
    const double share = std::clamp(
        (std::log(std::max(value, 1e-6)) - logKnot(knot)) / (logKnot(knot + 1) - logKnot(knot)), 0.0, 1.0);
    return Row{knot, share};
  };
  Curve curve;
  curve.logLight.resize(unknowns);
  for (int k = 0; k < unknowns; ++k) curve.logLight[k] = 2.0 * logKnot(k);  // between linear and encoded
  const double prior = options.smoothness / kExponentStep * ((knots - 1) / 255.0);
  double noise = 0.01;
  std::vector<double> covered;
  for (int round = 0; round < kRounds && !job.cancelled(); ++round) {
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(unknowns, unknowns);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(unknowns);
    const auto exponentAt = [&](double value) {
      const Row row = rowOf(value);
      return std::max(kSmallestSlope, (curve.logLight[row.knot + 1] - curve.logLight[row.knot]) /
                                          (logKnot(row.knot + 1) - logKnot(row.knot)));
    };
    const auto lightAt = [&](double value) {
      const Row row = rowOf(value);
      return (1 - row.share) * curve.logLight[row.knot] + row.share * curve.logLight[row.knot + 1];
    };
    std::vector<double> errors;  // in pixel values
    double sum = 0, count = 0;
    std::vector<std::vector<double>> byPhoto(photos);
    for (const Place& place : places) {
      double mean = 0, weights = 0;
      std::vector<double> weight;
      for (const Reading& reading : place.readings) {
        const double perValue = exponentAt(reading.value) / reading.value;  // d ln light / d value
        weight.push_back(1 / (noise * noise * perValue * perValue));
        mean += weight.back() * (lightAt(reading.value) - logTime[reading.photo]);
        weights += weight.back();
      }
      mean /= weights;
      for (std::size_t i = 0; i < place.readings.size(); ++i) {
        const Reading& reading = place.readings[i];
        const double off = lightAt(reading.value) - logTime[reading.photo] - mean;
        const double inValues = off * reading.value / exponentAt(reading.value);
        errors.push_back(std::abs(inValues));
        byPhoto[reading.photo].push_back(off);
        const double huber = 2.5 * noise;
        if (round > 0 && std::abs(inValues) > huber) weight[i] *= huber / std::abs(inValues);
        sum += weight[i] * off * off, count += weight[i];
      }
      // Rows of this place minus their weighted mean: the radiance is gone.
      weights = 0;
      double time = 0;
      std::map<int, double> meanRow;
      for (std::size_t i = 0; i < place.readings.size(); ++i) {
        const Row row = rowOf(place.readings[i].value);
        meanRow[row.knot] += weight[i] * (1 - row.share);
        meanRow[row.knot + 1] += weight[i] * row.share;
        time += weight[i] * logTime[place.readings[i].photo];
        weights += weight[i];
      }
      for (std::size_t i = 0; i < place.readings.size(); ++i) {
        std::map<int, double> row;
        const Row own = rowOf(place.readings[i].value);
        row[own.knot] += 1 - own.share;
        row[own.knot + 1] += own.share;
        for (const auto& [knot, value] : meanRow) row[knot] -= value / weights;
        const double target = logTime[place.readings[i].photo] - time / weights;
        for (const auto& [a, va] : row) {
          right[a] += weight[i] * va * target;
          for (const auto& [b, vb] : row) normal(a, b) += weight[i] * va * vb;
        }
      }
    }
    for (int k = 1; k + 1 < unknowns; ++k) {
      const double before = 1 / (logKnot(k) - logKnot(k - 1)), after = 1 / (logKnot(k + 1) - logKnot(k));
      const double row[3] = {before, -(before + after), after};
      for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) normal(k - 1 + a, k - 1 + b) += prior * prior * row[a] * row[b];
    }
    // The scale is free: light 1 at value 1.
    normal(unknowns - 1, unknowns - 1) += normal.diagonal().mean() + 1;
    curve.residual = count > 0 ? std::sqrt(sum / count) : 0;
    curve.exposureError.assign(photos, 0);
    for (std::size_t j = 0; j < photos; ++j) {
      if (byPhoto[j].size() < 10) continue;
      const auto middle = byPhoto[j].begin() + static_cast<std::ptrdiff_t>(byPhoto[j].size() / 2);
      std::nth_element(byPhoto[j].begin(), middle, byPhoto[j].end());
      curve.exposureError[j] = *middle;
    }
    if (round == kRounds - 1) break;  // the curve that these errors are of
    const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
    std::nth_element(errors.begin(), middle, errors.end());
    if (round > 0) noise = std::max(1.4826 * *middle, kLeastNoise);
    curve.logLight = normal.ldlt().solve(right);
    const double top = curve.logLight[unknowns - 1];
    curve.logLight.array() -= top;
  }
  std::vector<double> all;
  for (const Place& place : places)
    for (const Reading& reading : place.readings) all.push_back(reading.value);
  std::sort(all.begin(), all.end());
  curve.from = all[all.size() / 200], curve.to = all[all.size() - 1 - all.size() / 200];
  return curve;
}

Linearity linearityOf(const ResponseCurve& curve, double from, double to) {
  Linearity out;
  double xy = 0, xx = 0, top = 0, bottom = 0;
  for (std::size_t i = 0; i < curve.input.size(); ++i) {
    const double x = curve.input[i], y = curve.output[i];
    if (x < from || x > to) continue;
    xy += x * y, xx += x * x;
    if (y > 0 && x > 0) {
      const double w = y;
      top += w * std::log(x) * std::log(y), bottom += w * std::log(x) * std::log(x);
    }
  }
  const double slope = xx > 0 ? xy / xx : 1;
  for (std::size_t i = 0; i < curve.input.size(); ++i)
    if (curve.input[i] >= from && curve.input[i] <= to)
      out.largestDeviation =
          std::max(out.largestDeviation, std::abs(curve.output[i] - slope * curve.input[i]) / slope);
  if (bottom > 0) out.exponent = top / bottom;
  char text[200];
  if (out.largestDeviation < 0.01) {
    std::snprintf(text, sizeof text, "the camera is linear within %.2f %% of full scale",
                  100 * out.largestDeviation);
  } else {
    std::snprintf(
        text, sizeof text,
        "the camera is not linear (up to %.1f %% of full scale; about value to the power of %.2f): its "
        "photographs need this curve",
        100 * out.largestDeviation, out.exponent);
  }
  out.sentence = text;
  return out;
}

}  // namespace

Status checkExposures(const std::vector<ExposedPhoto>& photos) {
  for (const ExposedPhoto& photo : photos) {
    const Image& first = photos[0].image;
    if (photo.image.width() != first.width() || photo.image.height() != first.height() ||
        photo.image.channels() != 3)
      return Error{ErrorCode::Invalid, "the photographs are not of one size", photo.name,
                   "photographs of one camera at one resolution"};
    if (!(photo.exposureS > 0 && std::isfinite(photo.exposureS)))
      return Error{ErrorCode::Invalid, "the exposure is not positive", photo.name,
                   "seconds, as the camera was set"};
  }
  return Done{};
}

Result<CameraResponse> recoverResponse(const std::vector<ExposedPhoto>& photos,
                                       const ResponseOptions& options, const JobContext& job) {
  const auto invalid = [](const std::string& what, const std::string& where, const std::string& tryThis) {
    return Error{ErrorCode::Invalid, what, where, tryThis};
  };
  if (photos.size() < 3)
    return invalid(
        "a response curve needs at least three exposures, and there are " + std::to_string(photos.size()), "",
        "5 to 9 photographs of one still scene, each with twice the exposure of the one before");
  if (options.knots < 16 || options.knots > 1024 || !(options.smoothness > 0) ||
      options.samplesPerChannel < kFewestPlaces)
    return invalid("the options make no sense", "response options", "");
  if (const Status usable = checkExposures(photos); !usable) return usable.error();
  const Image& first = photos[0].image;
  std::vector<double> logTime;
  for (const ExposedPhoto& photo : photos) logTime.push_back(std::log(photo.exposureS));
  if (first.width() < 8 || first.height() < 8)
    return invalid("the photographs are too small", photos[0].name, "");
  const auto [shortest, longest] = std::minmax_element(logTime.begin(), logTime.end());
  if (*longest - *shortest < std::log(2.0))
    return invalid("the exposures are all nearly alike", "",
                   "exposures from short to long, each twice the one before");

  CameraResponse response;
  std::vector<std::vector<double>> exposureError;
  for (int c = 0; c < 3; ++c) {
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "the calibration was cancelled", "", ""};
    job.progress("response", c, 3, "channels");
    const std::vector<Place> places = choosePlaces(photos, c, options);
    if (static_cast<int>(places.size()) < kFewestPlaces)
      return invalid("only " + std::to_string(places.size()) +
                         " places are neither black nor clipped in two exposures at least",
                     std::string("channel ") + "RGB"[c],
                     "exposures closer to each other, and a scene with bright and dark parts");
    const Curve solved = solveCurve(places, logTime, photos.size(), options, job);
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "the calibration was cancelled", "", ""};
    ResponseCurve& curve = response.curves[c];
    curve.input.push_back(0), curve.output.push_back(0);
    std::vector<double> logs(solved.logLight.begin(), solved.logLight.end());
    const std::vector<double> rising = isotonic(logs, std::vector<double>(logs.size(), 1.0));
    for (std::size_t k = 0; k < rising.size(); ++k) {
      curve.input.push_back(static_cast<double>(k + 1) / (options.knots - 1));
      curve.output.push_back(std::exp(rising[k] - rising.back()));
    }
    curve.input.back() = 1;
    response.residual[c] = solved.residual;
    response.coveredFrom[c] = solved.from, response.coveredTo[c] = solved.to;
    exposureError.push_back(solved.exposureError);
  }
  job.progress("response", 3, 3, "channels");
  response.linearity = linearityOf(response.curves[1], response.coveredFrom[1], response.coveredTo[1]);
  char text[220];
  for (std::size_t j = 0; j < photos.size(); ++j) {
    const double off = (exposureError[0][j] + exposureError[1][j] + exposureError[2][j]) / 3;
    response.exposureFactor.push_back(std::exp(off));
    if (std::abs(off) > 0.1) {
      std::snprintf(text, sizeof text,
                    "%.80s is %.0f %% %s than its exposure says: is the time right, did the light change?",
                    photos[j].name.c_str(), 100 * std::abs(std::expm1(off)), off > 0 ? "brighter" : "darker");
      response.warnings.push_back(text);
    }
  }
  for (int c = 0; c < 3; ++c) {
    if (response.coveredTo[c] < 0.9 || response.coveredFrom[c] > 0.1) {
      std::snprintf(
          text, sizeof text,
          "channel %c: photographs decide the curve from %.2f to %.2f only; beyond, it is continued",
          "RGB"[c], response.coveredFrom[c], response.coveredTo[c]);
      response.warnings.push_back(text);
    }
    if (response.residual[c] > 0.15) {
      std::snprintf(text, sizeof text,
                    "channel %c: exposures disagree by %.0f %%: did something move, did the light flicker?",
                    "RGB"[c], 100 * response.residual[c]);
      response.warnings.push_back(text);
    }
  }
  return response;
}

Result<DarkLevel> measureDarkLevel(const std::vector<Image>& photos) {
  const auto invalid = [](const std::string& what, const std::string& tryThis) {
    return Error{ErrorCode::Invalid, what, "dark frames", tryThis};
  };
  if (photos.empty()) return invalid("there are no photographs with the lens covered", "two or more");
  const Image& first = photos[0];
  const std::size_t pixels = first.pixelCount();
  DarkLevel dark;
  for (const Image& photo : photos)
    if (photo.width() != first.width() || photo.height() != first.height() || photo.channels() != 3)
      return invalid("the photographs are not of one size", "");
  if (pixels < 100) return invalid("the photographs are too small", "");
  std::size_t zeros = 0, hot = 0;
  double pattern = 0;
  for (int c = 0; c < 3; ++c) {
    std::vector<double> mean(pixels), spread;
    for (std::size_t i = 0; i < pixels; ++i) {
      for (const Image& photo : photos) {
        const double v = photo.samples()[i * 3 + c];
        mean[i] += v / static_cast<double>(photos.size());
        zeros += v <= 0;
      }
      if (photos.size() > 1)
        spread.push_back(std::abs(photos[0].samples()[i * 3 + c] - photos[1].samples()[i * 3 + c]));
    }
    const auto medianOf = [](std::vector<double> values) {
      const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
      std::nth_element(values.begin(), middle, values.end());
      return *middle;
    };
    const double typical = medianOf(mean);
    if (typical > 0.2)
      return invalid("the picture isn't dark: its level is " + std::to_string(typical),
                     "cover the lens, in a dark room");
    std::vector<double> away;
    for (const double m : mean) away.push_back(std::abs(m - typical));
    const double overPicture = 1.4826 * medianOf(away);
    // Quantised to few codes a median may be 0; the mean absolute difference is not.
    double noise = overPicture;
    if (!spread.empty()) {
      double sum = 0;
      for (const double s : spread) sum += s;
      noise = sum / static_cast<double>(spread.size()) * std::sqrt(std::numbers::pi) /
              2;  // of a difference of two: 2 sd / sqrt(pi)
    }
    dark.readNoise[c] = noise;
    double sum = 0, squares = 0, count = 0;
    const double limit = typical + 8 * std::max({noise, overPicture, 1e-6});
    for (const double m : mean) {
      if (m > limit) {
        ++hot;
        continue;
      }
      sum += m, squares += m * m, ++count;
    }
    dark.level[c] = sum / count;
    const double variance =
        std::max(0.0, squares / count - dark.level[c] * dark.level[c]) -
        (photos.size() > 1 ? noise * noise / static_cast<double>(photos.size()) : noise * noise);
    pattern = std::max(pattern, std::sqrt(std::max(0.0, variance)));
  }
  dark.pattern = pattern;
  dark.hotShare = static_cast<double>(hot) / (3.0 * static_cast<double>(pixels));
  const double zeroShare = static_cast<double>(zeros) / (3.0 * static_cast<double>(pixels * photos.size()));
  dark.clippedAtZero = zeroShare > 0.2;
  char text[200];
  if (dark.clippedAtZero) {
    std::snprintf(text, sizeof text,
                  "%.0f %% of the samples are exactly zero: the camera cuts off at black, so neither black "
                  "level nor noise "
                  "can be told; use raw photographs",
                  100 * zeroShare);
    dark.warnings.push_back(text);
  }
  if (dark.hotShare > 0.001) {
    std::snprintf(text, sizeof text, "%.2f %% of the pixels are hot: a cooler camera, or a shorter exposure",
                  100 * dark.hotShare);
    dark.warnings.push_back(text);
  }
  if (photos.size() < 2)
    dark.warnings.push_back("one dark frame only: its noise can't be told from a pattern; take two or more");
  return dark;
}

std::string responseJson(const std::array<ResponseCurve, 3>& curves) {
  nlohmann::ordered_json json = {{"format", "patina-response"}, {"version", 1}};
  for (int c = 0; c < 3; ++c)
    json[std::string(1, "RGB"[c])] = {{"input", curves[c].input}, {"output", curves[c].output}};
  return json.dump(1) + "\n";
}

Status writeResponse(const std::filesystem::path& file, const std::array<ResponseCurve, 3>& curves) {
  return writeFileAtomically(file, responseJson(curves));
}

}  // namespace patina
