#include "engine/fourier/measurements.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <numbers>

#include "engine/capture/encoding.h"
#include "engine/fourier/sensor_noise.h"

namespace patina {
namespace {

std::string photoName(const FourierCapture& capture, int index) {
  return "photos[" + std::to_string(index) + "], " + capture.photos[index].file;
}

Error cancelledError() {
  return {ErrorCode::Cancelled, "the fit was cancelled while reading photographs", "", ""};
}

/// Black level and ambient light as the black photograph shows them, less its noise: each pixel moves towards
/// the mean of its surroundings as far as the local variance is no more than noise (Lee's adaptive Wiener
/// filter, 1980, with the noise known). One photograph's noise would otherwise enter every prediction. Only
/// where each pixel is a site; groups have averaged already.
void denoiseBlack(FourierMeasurements& m) {
  const SiteSet& set = m.sites;
  if (std::ranges::any_of(set.pixelCount, [](auto count) { return count > 1; })) return;
  constexpr int kRadius = 4;  // 81 pixels: what is left of the noise is a ninth
  std::vector<float> out(m.black);
  tbb::parallel_for(0, set.imageHeight, [&](int y) {
    for (int x = 0; x < set.imageWidth; ++x) {
      const auto here = set.siteOfPixel[static_cast<std::size_t>(y) * set.imageWidth + x];
      if (here < 0) continue;
      double sum[3] = {}, square[3] = {};
      int count = 0;
      for (int j = std::max(0, y - kRadius); j <= std::min(set.imageHeight - 1, y + kRadius); ++j) {
        for (int i = std::max(0, x - kRadius); i <= std::min(set.imageWidth - 1, x + kRadius); ++i) {
          const auto there = set.siteOfPixel[static_cast<std::size_t>(j) * set.imageWidth + i];
          if (there < 0) continue;
          ++count;
          for (int c = 0; c < 3; ++c) {
            const double value = m.black[static_cast<std::size_t>(there) * 3 + c];
            sum[c] += value;
            square[c] += value * value;
          }
        }
      }
      for (int c = 0; c < 3; ++c) {
        const double mean = sum[c] / count, variance = square[c] / count - mean * mean;
        // Local variance of pure noise scatters by sqrt(2 / count); structure counts only beyond two of that.
        const double noise = m.noise.variance(mean) * (1 + 2 * std::sqrt(2.0 / count));
        const double keep = std::clamp(1 - noise / std::max(variance, 1e-30), 0.0, 1.0);
        const std::size_t at = static_cast<std::size_t>(here) * 3 + c;
        out[at] = static_cast<float>(mean + keep * (m.black[at] - mean));
      }
    }
  });
  for (std::size_t i = 0; i < out.size(); ++i) m.dc[i] += m.black[i] - out[i];
  m.black = std::move(out);
  m.blackVarianceShare = 1.0 / ((2 * kRadius + 1) * (2 * kRadius + 1));
}

/// Frequencies (larger component) from which on four times the frequency is beyond any lobe, or measured
/// itself.
constexpr int kEvenFrom = 10;

/// The sum of a frequency's four photographs is 4 black + 4/pi F(0) - 8/(15 pi) Re F(4w) - ...: the part that
/// the paper's Z discards holds the zero frequency over and over again. Joined with window - black by their
/// variances, it knows Z(0) several times better.
void sharpenZeroFrequency(FourierMeasurements& m, const std::vector<double>& evenSum, int evenGroups) {
  if (evenGroups == 0) return;
  const int frequencies = m.frequencyCount();
  std::vector<int> quadruple;  // fitted frequency that is four times another, where there is one
  for (const auto& group : m.plan.fitted) {
    if (group.frequency.cwiseAbs().maxCoeff() < kEvenFrom) continue;
    for (int f = 0; f < frequencies; ++f)
      if (m.plan.fitted[f].frequency == 4 * group.frequency) quadruple.push_back(f);
  }
  const SiteBlock block = m.store.block(0, m.sites.size());
  for (std::size_t s = 0; s < m.sites.size(); ++s) {
    for (int c = 0; c < 3; ++c) {
      const std::size_t i = s * 3 + c;
      double harmonic = 0;
      for (const int f : quadruple) harmonic += block.z(s)[f * 6 + c];
      const double sum = evenSum[i] / evenGroups + 8 / (15 * std::numbers::pi) * harmonic / evenGroups;
      const double even = std::numbers::pi / 4 * (sum - 4 * m.black[i]);
      const double pixels = m.sites.pixelCount[s];
      const double blackVariance = m.blackVarianceShare * m.noise.variance(m.black[i]) / pixels;
      const double scale = std::numbers::pi / 4 * std::numbers::pi / 4;
      const double evenVariance =
          scale * (4 * m.noise.variance(sum / 4) / pixels / evenGroups + 16 * blackVariance);
      const double windowVariance = m.windowVariance(s, c);
      const double weight = windowVariance / (windowVariance + evenVariance);
      m.dc[i] = static_cast<float>(m.dc[i] + weight * (even - m.dc[i]));
      m.dcVariances[i] = static_cast<float>(windowVariance * evenVariance / (windowVariance + evenVariance));
    }
  }
}

/// The radiance that a photograph's highest code value stands for, R G B; infinite for linear photographs,
/// whose bundle doesn't say where the sensor ends.
std::array<float, 3> clippingLevels(const FourierCapture& capture, const FourierPhoto& photo) {
  constexpr float kNever = std::numeric_limits<float>::infinity();
  std::array<float, 3> level{kNever, kNever, kNever};
  const auto encoding = parseEncoding(photo.encoding, photo.file);
  if (!encoding || encoding->kind == PhotoEncoding::Kind::Linear) return level;
  level.fill(static_cast<float>(capture.radianceScale));
  if (encoding->kind == PhotoEncoding::Kind::Response) {
    const auto curves = readResponse(capture.folder / encoding->responseFile);
    if (!curves) return level;  // readPhoto has the error
    for (int c = 0; c < 3; ++c)
      level[c] = static_cast<float>((*curves)[c].output.back() * capture.radianceScale);
  }
  return level;
}

}  // namespace

Result<MeasurementPlan> planMeasurements(const FourierCapture& capture, const JobContext& job) {
  MeasurementPlan plan;
  std::map<std::pair<int, int>, FrequencyGroup> fitted, heldOut;
  std::vector<std::pair<int, int>> fittedOrder, heldOutOrder;
  for (int i = 0; i < static_cast<int>(capture.photos.size()); ++i) {
    const FourierPhoto& photo = capture.photos[i];
    if (photo.holdout && photo.role != PhotoRole::Pattern) continue;
    if (photo.role == PhotoRole::Window || photo.role == PhotoRole::Black) {
      int& one = photo.role == PhotoRole::Window ? plan.window : plan.black;
      if (one >= 0)
        job.warn("more than one photograph of its role: " + photoName(capture, i) + " is used, " +
                 photoName(capture, one) + " is not");
      one = i;
    }
    if (photo.role != PhotoRole::Pattern) continue;
    if (photo.frequency.isZero()) {
      job.warn(photoName(capture, i) +
               " is a pattern of frequency zero and is left out; that is what the window photograph is for");
      continue;
    }
    const std::pair<int, int> key{photo.frequency.x(), photo.frequency.y()};
    auto& groups = photo.holdout ? heldOut : fitted;
    auto [it, fresh] = groups.try_emplace(key);
    if (fresh) {
      (photo.holdout ? heldOutOrder : fittedOrder).push_back(key);
      it->second.frequency = photo.frequency;
    }
    it->second.photo[photo.phase] = i;
  }
  auto keepComplete = [&](auto& groups, auto& order, std::vector<FrequencyGroup>& out) {
    for (const auto& key : order) {
      const FrequencyGroup& group = groups.at(key);
      if (std::ranges::all_of(group.photo, [](int p) { return p >= 0; })) {
        out.push_back(group);
      } else {
        job.warn("frequency (" + std::to_string(key.first) + ", " + std::to_string(key.second) +
                 ") lacks some of its four phases and is left out");
      }
    }
  };
  keepComplete(fitted, fittedOrder, plan.fitted);
  keepComplete(heldOut, heldOutOrder, plan.heldOut);

  auto undetermined = [&](std::string what, std::string tryThis) {
    return Error{ErrorCode::Invalid, std::move(what), (capture.folder / "capture.json").string() + ", photos",
                 std::move(tryThis)};
  };
  if (plan.window < 0 || plan.black < 0)
    return undetermined(std::string("the bundle has no photograph of role '") +
                            (plan.window < 0 ? "window" : "black") +
                            "' that the fit may read, so the zero frequency is unknown",
                        "photograph it, or remove \"split\": \"holdout\" from it");
  if (plan.fitted.size() < 4)
    return undetermined(
        "the patterns can't determine the model: only " + std::to_string(plan.fitted.size()) +
            " frequencies have all four phases, at least 4 are needed",
        "capture the paper's set, {1, 2, 3, 4, 6, 10, 20, 40} on both axes and both diagonals");
  bool spansPlane = false;
  for (const auto& group : plan.fitted) {
    for (const auto& other : plan.fitted)
      spansPlane |=
          other.frequency.x() * group.frequency.y() - other.frequency.y() * group.frequency.x() != 0;
  }
  if (!spansPlane)
    return undetermined(
        "the patterns can't determine the model: all frequencies lie along one line, so normals across it "
        "are unknown",
        "add frequencies on the other axis");
  return plan;
}

Result<SiteSet> makeSites(const FourierCapture& capture, int size) {
  const Camera& camera = capture.camera;
  SiteSet sites;
  sites.imageWidth = camera.width;
  sites.imageHeight = camera.height;
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * camera.height;
  sites.siteOfPixel.assign(pixels, -1);
  std::vector<Eigen::Vector2f> plane(pixels);
  std::vector<char> inside(pixels, 0);
  tbb::parallel_for(0, camera.height, [&](int y) {
    for (int x = 0; x < camera.width; ++x) {
      const auto point = camera.samplePlaneFromPixel({x, y});
      if (!point) continue;
      const std::size_t i = static_cast<std::size_t>(y) * camera.width + x;
      plane[i] = point->head<2>().cast<float>();
      inside[i] = std::abs(point->x()) <= capture.sampleWidthMm / 2 &&
                  std::abs(point->y()) <= capture.sampleHeightMm / 2;
    }
  });

  double finest = std::numeric_limits<double>::infinity(), coarsest = 0;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * camera.width + x;
      if (!inside[i]) continue;
      for (const std::size_t j : {i + 1, i + camera.width}) {
        if (j >= pixels || !inside[j] || (j == i + 1 && x + 1 == camera.width)) continue;
        const double pitch = (plane[j] - plane[i]).norm();
        finest = std::min(finest, pitch);
        coarsest = std::max(coarsest, pitch);
      }
    }
  }
  if (!std::isfinite(finest))
    return Error{ErrorCode::Invalid, "the camera doesn't see the sample rectangle",
                 (capture.folder / "capture.json").string() + ", camera",
                 "check camera.R and camera.t (x_cam = R X + t, millimetres) and sample.width_mm"};
  sites.finestPitchMm = finest;

  const double longest = std::max(capture.sampleWidthMm, capture.sampleHeightMm);
  const double texelMm = size > 0 ? longest / size : 0;
  // Below twice the coarsest pixel pitch, groups would hold one pixel or none: then every pixel is a site of
  // its own.
  const bool grouped = texelMm >= 2 * coarsest;
  const int columns =
      grouped ? std::max(1, static_cast<int>(std::lround(capture.sampleWidthMm / texelMm))) : 0;
  const int rows = grouped ? std::max(1, static_cast<int>(std::lround(capture.sampleHeightMm / texelMm))) : 0;
  std::vector<std::int32_t> siteOfCell(static_cast<std::size_t>(columns) * rows, -1);
  for (std::size_t i = 0; i < pixels; ++i) {
    if (!grouped && i % camera.width == 0)
      sites.firstSiteOfRow.push_back(static_cast<std::uint32_t>(sites.size()));
    if (!inside[i]) continue;
    std::int32_t site = -1;
    if (grouped) {
      const int cx = std::clamp(static_cast<int>((plane[i].x() / capture.sampleWidthMm + 0.5) * columns), 0,
                                columns - 1);
      const int cy =
          std::clamp(static_cast<int>((0.5 - plane[i].y() / capture.sampleHeightMm) * rows), 0, rows - 1);
      site = siteOfCell[static_cast<std::size_t>(cy) * columns + cx];
      if (site < 0)
        siteOfCell[static_cast<std::size_t>(cy) * columns + cx] = static_cast<std::int32_t>(sites.size());
    }
    if (site < 0) {
      site = static_cast<std::int32_t>(sites.size());
      sites.pointMm.emplace_back(0, 0);
      sites.pixel.emplace_back(0, 0);
      sites.pixelCount.push_back(0);
    }
    sites.siteOfPixel[i] = site;
    sites.pointMm[site] += plane[i];
    sites.pixel[site] +=
        Eigen::Vector2f(static_cast<float>(i % camera.width), static_cast<float>(i / camera.width));
    ++sites.pixelCount[site];
  }
  if (!grouped) sites.firstSiteOfRow.push_back(static_cast<std::uint32_t>(sites.size()));
  for (std::size_t s = 0; s < sites.size(); ++s) {
    sites.pointMm[s] /= static_cast<float>(sites.pixelCount[s]);
    sites.pixel[s] /= static_cast<float>(sites.pixelCount[s]);
  }
  return sites;
}

SiteRun sitesAround(const SiteSet& sites, SiteRun run, int rows) {
  if (sites.grouped() || run.count == 0) return run;
  const int top = static_cast<int>(sites.pixel[run.first].y());
  const int bottom = static_cast<int>(sites.pixel[run.end() - 1].y());
  const std::size_t first = sites.firstSiteOfRow[std::max(0, top - rows)];
  const std::size_t end = sites.firstSiteOfRow[std::min(sites.imageHeight - 1, bottom + rows) + 1];
  return {first, end - first};
}

int resolvedSize(const FourierCapture& capture, const SiteSet& sites) {
  const double longest = std::max(capture.sampleWidthMm, capture.sampleHeightMm);
  return std::clamp(static_cast<int>(std::lround(longest / sites.finestPitchMm)), 1, 16384);
}

std::vector<float> sampleSites(const SiteSet& sites, const Image& photo) {
  std::vector<float> out(sites.size() * 3, 0.0f);
  const auto samples = photo.samples();
  for (std::size_t i = 0; i < sites.siteOfPixel.size(); ++i) {
    const auto site = sites.siteOfPixel[i];
    if (site < 0) continue;
    for (int c = 0; c < 3; ++c) out[site * 3 + c] += samples[i * 3 + c];
  }
  for (std::size_t s = 0; s < sites.size(); ++s)
    for (int c = 0; c < 3; ++c) out[s * 3 + c] /= static_cast<float>(sites.pixelCount[s]);
  return out;
}

Result<FourierMeasurements> measure(const FourierCapture& capture, MeasurementPlan plan, SiteSet sites,
                                    const JobContext& job) {
  FourierMeasurements m;
  const std::size_t count = sites.size();
  const int frequencies = static_cast<int>(plan.fitted.size());
  auto store = MeasurementStore::make(count, frequencies, std::numeric_limits<std::uint64_t>::max());
  if (!store) return store.error();
  m.store = std::move(*store);
  m.brightness.assign(count * 3, 0.0f);
  m.clippedFraction.assign(count, 0.0f);
  const auto total = static_cast<std::int64_t>(frequencies) * 4 + 2;

  std::mutex mutex;  // guards everything below, brightness and clippedFraction
  std::optional<Error> failure;
  std::int64_t done = 0;
  NoiseSamples noiseSamples(frequencies);
  std::vector<double> evenSum(count * 3, 0.0);
  int evenGroups = 0;

  // A site with one saturated pixel in one photograph is marked: what its photographs add up to is no longer
  // light.
  auto readSites = [&](int index) -> std::optional<std::vector<float>> {
    if (job.cancelled()) return std::nullopt;
    auto photo = readPhoto(capture, capture.photos[index]);
    if (!photo) {
      std::scoped_lock lock(mutex);
      if (!failure) failure = photo.error();
      return std::nullopt;
    }
    std::vector<float> values = sampleSites(sites, *photo);
    const std::array<float, 3> level = clippingLevels(capture, capture.photos[index]);
    std::vector<std::int32_t> clipped;
    if (std::isfinite(level[0])) {
      const auto samples = photo->samples();
      for (std::size_t i = 0; i < sites.siteOfPixel.size(); ++i) {
        if (sites.siteOfPixel[i] < 0) continue;
        constexpr float kTop = 0.9995f;  // rounding of the decoded top code
        bool at = false;
        for (int c = 0; c < 3; ++c) at |= samples[i * 3 + c] >= kTop * level[c];
        if (at) clipped.push_back(sites.siteOfPixel[i]);
      }
    }
    std::scoped_lock lock(mutex);
    m.clippedSamples += clipped.size();
    for (const auto site : clipped)
      m.clippedFraction[site] += 1.0f / static_cast<float>(total * sites.pixelCount[site]);
    job.progress("read", ++done, total, "photos");
    return values;
  };

  tbb::parallel_for(0, frequencies + 1, [&](int f) {
    {
      std::scoped_lock lock(mutex);
      if (failure) return;
    }
    if (f == frequencies) {
      const auto window = readSites(plan.window);
      if (!window) return;
      auto black = readSites(plan.black);
      if (!black) return;
      m.dc.resize(count * 3);
      for (std::size_t i = 0; i < count * 3; ++i) m.dc[i] = (*window)[i] - (*black)[i];
      m.black = std::move(*black);
      return;
    }
    std::array<std::vector<float>, 4> photo;
    for (int k = 0; k < 4; ++k) {
      auto values = readSites(plan.fitted[f].photo[k]);
      if (!values) return;
      photo[k] = std::move(*values);
    }
    for (std::size_t s = 0; s < count; ++s) {
      float* z = m.store.zInMemory() + (s * frequencies + f) * 6;
      float* even = m.store.evenInMemory() + (s * frequencies + f) * 6;
      for (int c = 0; c < 3; ++c) {
        const std::size_t i = s * 3 + c;
        z[c] = photo[1][i] - photo[3][i];
        z[3 + c] = photo[2][i] - photo[0][i];
        even[c] = photo[0][i] + photo[2][i];
        even[3 + c] = photo[1][i] + photo[3][i];
      }
    }
    std::scoped_lock lock(mutex);
    for (std::size_t i = 0; i < count * 3; ++i)
      m.brightness[i] +=
          (photo[0][i] + photo[1][i] + photo[2][i] + photo[3][i]) / static_cast<float>(4 * frequencies);
    if (plan.fitted[f].frequency.cwiseAbs().maxCoeff() >= kEvenFrom) {
      ++evenGroups;
      for (std::size_t i = 0; i < count * 3; ++i)
        evenSum[i] += photo[0][i] + photo[1][i] + photo[2][i] + photo[3][i];
    }
    noiseSamples.add(f, plan.fitted[f].frequency, photo, sites.pixelCount);
  });
  if (failure) return *failure;
  if (job.cancelled()) return cancelledError();

  std::vector<float> sorted(m.dc);
  const auto at = static_cast<std::size_t>(0.999 * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(at), sorted.end());
  m.fullScale = sorted[at];
  if (!(m.fullScale > 0))
    return Error{ErrorCode::Invalid, "the window photograph is not brighter than the black one",
                 photoName(capture, plan.window),
                 "check that the two were not swapped and that the screen lit the sample"};
  m.noise = noiseSamples.estimate(m.fullScale);
  m.plan = std::move(plan);
  m.sites = std::move(sites);
  denoiseBlack(m);
  m.dcVariances.resize(count * 3);
  for (std::size_t s = 0; s < count; ++s)
    for (int c = 0; c < 3; ++c) m.dcVariances[s * 3 + c] = static_cast<float>(m.windowVariance(s, c));
  sharpenZeroFrequency(m, evenSum, evenGroups);
  return m;
}

}  // namespace patina
