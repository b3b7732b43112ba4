#include "engine/flash/fit.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>

namespace patina {
namespace {

using Clock = std::chrono::steady_clock;

double since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

SvbrdfMaps mapsOf(const FlashFit& fit) {
  const FlashGrid& grid = fit.grid;
  SvbrdfMaps maps;
  maps.width = grid.width, maps.height = grid.height;
  maps.widthMm = fit.capture.widthMm, maps.heightMm = fit.capture.heightMm;
  for (Image* map : {&maps.diffuse, &maps.specular, &maps.normal, &maps.diffuseSd, &maps.specularSd})
    *map = Image(grid.width, grid.height, 3);
  for (Image* map : {&maps.sigma, &maps.kurtosis, &maps.residual, &maps.status, &maps.normalSd, &maps.sigmaSd,
                     &maps.kurtosisSd})
    *map = Image(grid.width, grid.height, 1);
  for (int j = 0; j < grid.height; ++j) {
    for (int i = 0; i < grid.width; ++i) {
      const std::size_t index = static_cast<std::size_t>(j) * grid.width + i;
      const FlashTexel texel{fit.texels.x[index].cast<double>()};
      const auto& sd = fit.texels.sd[index];
      const FlashLobe& lobe = fit.model.materials[fit.texels.material[index]].lobe;
      const Eigen::Vector3d normal = texel.normal();
      const Eigen::Array3d diffuse = texel.diffuse(), specular = texel.specular();
      for (int c = 0; c < 3; ++c) {
        maps.diffuse.at(i, j, c) = static_cast<float>(diffuse[c]);
        maps.specular.at(i, j, c) = static_cast<float>(specular[c]);
        maps.normal.at(i, j, c) = static_cast<float>(normal[c]);
        maps.diffuseSd.at(i, j, c) = static_cast<float>(diffuse[c]) * sd[2 + c];
        maps.specularSd.at(i, j, c) = static_cast<float>(specular[c]) * sd[5 + c];
      }
      maps.normalSd.at(i, j) = static_cast<float>(180 / std::numbers::pi) * sd.head<2>().norm();
      maps.sigma.at(i, j) = static_cast<float>(lobe.sigma());
      maps.kurtosis.at(i, j) = static_cast<float>(lobe.kurtosis());
      maps.residual.at(i, j) = fit.texels.residual[index];
      maps.status.at(i, j) = static_cast<float>(fit.texels.status[index]);
    }
  }
  return maps;
}

std::string number(const char* pattern, double a, double b = 0) {
  char text[256];
  std::snprintf(text, sizeof text, pattern, a, b);
  return text;
}

void addRemarks(FlashFit& fit) {
  std::vector<std::string>& remarks = fit.stats.remarks;
  remarks.push_back(
      "Albedos are relative to the declared intensity of the flash: if the flash was twice as bright as "
      "capture.json says, they are half of what the maps say.");
  double largest = 0;
  for (const FlashPhoto& photo : fit.capture.photos) {
    const FlashRay ray = flashRay(photo, {0, 0});
    largest = std::max(largest, std::acos(std::clamp(ray.toLight.dot(ray.toView), -1.0, 1.0)) / 2);
  }
  const double degrees = largest * 180 / std::numbers::pi;
  if (degrees < 20) {
    remarks.push_back(
        number("Camera and light are seen from the sample within %.1f degrees of each other: "
               "reflectance is measured towards the light only, and nothing is known about "
               "Fresnel's rise, grazing angles or retroreflection.",
               2 * degrees));
  }
  Eigen::Vector2d lean = Eigen::Vector2d::Zero();
  double count = 0, unmeasured = 0;
  for (std::size_t t = 0; t < fit.texels.x.size(); ++t) {
    if (fit.texels.status[t] == TexelStatus::MirrorOffScreen) ++unmeasured;
    if (fit.texels.status[t] != TexelStatus::Converged) continue;
    lean += fit.texels.x[t].head<2>().cast<double>(), count += 1;
  }
  if (count > 0) lean /= count;
  if (lean.norm() > 0.015) {
    double distance = 0;
    for (const FlashPhoto& photo : fit.capture.photos) distance += photo.lightPositionMm.z();
    distance /= static_cast<double>(fit.capture.photos.size());
    remarks.push_back(
        number("The normals lean by %.1f degrees on average: the sample was tilted by that much "
               "against its declared plane, or the flash sits about %.0f mm beside where "
               "capture.json says. Photographs of this kind can't tell which.",
               std::atan(lean.norm()) * 180 / std::numbers::pi, 2 * lean.norm() * distance));
  }
  if (unmeasured > 0.02 * static_cast<double>(fit.texels.x.size())) {
    remarks.push_back(
        number("On %.0f %% of the sample no photograph shows a highlight: gloss there is that of "
               "alike places elsewhere (status 3).",
               100 * unmeasured / static_cast<double>(fit.texels.x.size())));
  }
}

const char* nameOf(TexelStatus status) {
  switch (status) {
    case TexelStatus::NotMeasured:
      return "not_measured";
    case TexelStatus::Converged:
      return "converged";
    case TexelStatus::IterationLimit:
      return "iteration_limit";
    case TexelStatus::MirrorOffScreen:
      return "gloss_not_seen";
    case TexelStatus::Clipped:
      return "clipped";
    case TexelStatus::Failed:
      return "failed";
    case TexelStatus::Cancelled:
      break;
  }
  return "cancelled";
}

Status compareAll(FlashFit& fit, const JobContext& job) {
  double squares[2] = {0, 0}, noise[2] = {0, 0}, values[2] = {0, 0};
  for (std::size_t k = 0; k < fit.capture.photos.size(); ++k) {
    if (job.cancelled()) {
      fit.stats.cancelled = true;
      return Done{};
    }
    auto pixels = readFlashPixels(fit.capture, fit.capture.photos[k]);
    if (!pixels) return pixels.error();
    FlashComparison comparison = compareFlashPhoto(fit, static_cast<int>(k), *pixels);
    const int split = comparison.holdout;
    squares[split] += comparison.squares, noise[split] += comparison.noiseSquares;
    values[split] += comparison.values;
    fit.comparisons.push_back(std::move(comparison));
    job.progress("predict", static_cast<std::int64_t>(k) + 1,
                 static_cast<std::int64_t>(fit.capture.photos.size()), "photos");
  }
  if (values[0] > 0) {
    fit.stats.fitRms = std::sqrt(squares[0] / values[0]);
    fit.stats.noiseFloorFit = std::sqrt(noise[0] / values[0]);
  }
  if (values[1] > 0) {
    fit.stats.holdoutRms = std::sqrt(squares[1] / values[1]);
    fit.stats.noiseFloorHoldout = std::sqrt(noise[1] / values[1]);
  }
  return Done{};
}

Result<std::shared_ptr<const FlashFit>> fitData(const FlashData& data, const FlashFitOptions& options,
                                                const JobContext& job, const FlashModel* start,
                                                const FlashPalette* palette) {
  const auto begin = Clock::now();
  const std::vector<std::string> problems = options.validate();
  if (!problems.empty()) return Error{ErrorCode::Invalid, problems.front(), "options", ""};
  auto fit = std::make_shared<FlashFit>();
  fit->capture = data.capture, fit->options = options;
  fit->noise = data.noise, fit->clip = data.clip;
  fit->stats.noiseShot = data.noise.shot, fit->stats.noiseRead = data.noise.read;
  fit->stats.clippedSamples = data.clippedSamples;
  fit->grid = data.levels.front().grid;
  if (start && palette) {
    fit->model = *start, fit->palette = *palette;
  } else {
    const auto shared = Clock::now();
    FlashSample sample = drawSample(data, data.levels[sampleLevel(data)], options.sharedTexels);
    if (sample.sites.empty()) {
      return Error{ErrorCode::Invalid, "no texel of the sample is seen by any photograph",
                   data.capture.folder.string(), "check the cameras and the sample's size"};
    }
    std::vector<Eigen::Array3d> colours;
    for (const FlashSite& site : sample.sites) colours.push_back(darkColour(site));
    fit->palette = findMaterials(colours, options.materials);
    std::vector<char> photos;
    for (const FlashPhoto& photo : data.capture.photos) photos.push_back(!photo.holdout);
    fit->model = fitShared(data, sample, fit->palette, options.effects, photos, job).model;
    fit->stats.seconds["shared"] = since(shared);
  }
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "the fit was cancelled", "", ""};
  const auto texels = Clock::now();
  fit->texels = solveSheet(data, fit->palette, fit->model, job);
  fit->stats.seconds["texels"] = since(texels);
  fit->stats.texels = fit->texels.x.size();
  fit->stats.cancelled = job.cancelled();
  fit->stats.meanIterations =
      static_cast<double>(fit->texels.iterations) / static_cast<double>(fit->texels.x.size());
  for (const TexelStatus status : fit->texels.status) ++fit->stats.statusCounts[nameOf(status)];
  fit->maps = mapsOf(*fit);
  const auto predict = Clock::now();
  if (!fit->stats.cancelled) {
    if (Status compared = compareAll(*fit, job); !compared) return compared.error();
  }
  fit->stats.seconds["predict"] = since(predict);
  addRemarks(*fit);
  fit->stats.seconds["total"] = since(begin);
  return std::shared_ptr<const FlashFit>(std::move(fit));
}

}  // namespace

std::vector<std::string> FlashFitOptions::validate() const {
  std::vector<std::string> problems;
  if (size < 0 || size > 8192)
    problems.push_back("size must lie in 0..8192 texels (0: what the photographs resolve)");
  if (materials < 0 || materials > 8) problems.push_back("materials must lie in 0..8 (0: chosen by colour)");
  if (sharedTexels < 50 || sharedTexels > 100000) problems.push_back("sharedTexels must lie in 50..100000");
  return problems;
}

Result<std::shared_ptr<const FlashFit>> fitFlash(const FlashData& data, const FlashFitOptions& options,
                                                 const JobContext& job, const FlashModel* start,
                                                 const FlashPalette* palette) {
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::optional<Result<std::shared_ptr<const FlashFit>>> fit;
  arena.execute([&] { fit.emplace(fitData(data, options, job, start, palette)); });
  return std::move(*fit);
}

Result<std::shared_ptr<const FlashFit>> fitFlash(const FlashCapture& capture, const FlashFitOptions& options,
                                                 const JobContext& job) {
  const auto begin = Clock::now();
  const std::vector<std::string> problems = options.validate();
  if (!problems.empty()) return Error{ErrorCode::Invalid, problems.front(), "options", ""};
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::optional<Result<FlashData>> data;
  arena.execute([&] { data.emplace(readFlashData(capture, options.size, job)); });
  if (!*data) return data->error();
  const double read = since(begin);
  auto fit = fitFlash(**data, options, job);
  if (!fit) return fit;
  auto timed = std::make_shared<FlashFit>(**fit);
  timed->stats.seconds["read"] = read;
  timed->stats.seconds["total"] += read;
  return std::shared_ptr<const FlashFit>(std::move(timed));
}

}  // namespace patina
