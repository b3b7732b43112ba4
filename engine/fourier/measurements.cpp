#include "engine/fourier/measurements.h"

#include <tbb/parallel_for.h>

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
  sites.cellsOnLongestSide = std::max(columns, rows);
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

}  // namespace patina
