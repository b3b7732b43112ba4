#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/brdf/merl_grid.h"
#include "engine/image/exr.h"
#include "engine/image/png.h"
#include "engine/twoshot/fit.h"
#include "engine/twoshot/photo_prediction.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::uint64_t kLargestJson = 64u << 20;
/// The posterior as a picture: a row for each thetaH and thetaD, a column for each phiD.
constexpr int kPosteriorWidth = MerlGrid::kPhiD, kPosteriorHeight = MerlGrid::kThetaH * MerlGrid::kThetaD;

/// "brdf.binary", "brdf_2.binary", ...
std::string numbered(const std::string& stem, std::size_t index, const std::string& ending) {
  return stem + (index == 0 ? "" : "_" + std::to_string(index + 1)) + ending;
}

std::string hex(std::uint64_t value) {
  char text[20];
  std::snprintf(text, sizeof text, "%016" PRIx64, value);
  return text;
}

Json list(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

/// A figure that was not measured is null.
Json measured(double value) {
  return value >= 0 ? Json(value) : Json(nullptr);
}

double degrees(double radians) {
  return radians * 180 / M_PI;
}

Json toJson(const ExpectedError& expected) {
  return {{"unseen", expected.unseen},
          {"unseen_median", expected.unseenMedian},
          {"unseen_worst_tenth", expected.unseenWorstTenth},
          {"training", expected.training},
          {"prior", expected.prior},
          {"posterior", expected.posterior}};
}

/// Where the prediction of each photograph goes, below the fit's folder: the photograph's own name and
/// folder, numbered where another has it already (`a.png` beside `a.exr`). Empty where there is no
/// prediction.
std::vector<std::string> renderedFiles(const TwoShotFit& fit) {
  std::vector<std::string> files;
  for (const TwoShotComparison& comparison : fit.comparisons) {
    if (comparison.rendered.empty()) {
      files.emplace_back();
      continue;
    }
    const fs::path photo = fs::path("rendered") / fs::path(comparison.file).lexically_normal();
    fs::path file = photo;
    file.replace_extension(".exr");
    for (int n = 2; std::find(files.begin(), files.end(), file.string()) != files.end(); ++n)
      file.replace_filename(photo.stem().string() + "_" + std::to_string(n) + ".exr");
    files.push_back(file.string());
  }
  return files;
}

Json toJson(const TwoShotFit& fit) {
  const TwoShotStats& stats = fit.stats;
  const TwoShotFitOptions& options = fit.options;
  Json json;
  json["kind"] = "two-shot";
  json["bundle"] = fs::absolute(fit.capture.folder).lexically_normal().string();
  json["seconds"] = stats.seconds;
  json["texels"] = stats.pixels;
  json["iterations"] = 1;  // a linear problem
  json["options"] = {{"eta", options.eta},
                     {"choose_eta", options.chooseEta},
                     {"rows_per_shot", options.rowsPerShot},
                     {"noise_weights", options.noiseWeights},
                     {"clusters", options.clusters},
                     {"effects", "none"}};
  json["basis"] = {
      {"name", fit.basis->name()},
      {"file", options.basisFile.empty() ? "" : fs::absolute(options.basisFile).lexically_normal().string()},
      {"checksum", hex(fit.basis->checksum())},
      {"components", fit.basis->componentCount()},
      {"columns", fit.basis->columnCount()}};
  json["cancelled"] = stats.cancelled;
  json["fit_rms"] = measured(stats.fitRms);
  json["holdout_rms"] = measured(stats.holdoutRms);
  json["noise_floor"] = measured(stats.holdoutRms >= 0 ? stats.noiseFloorHoldout
                                 : stats.fitRms >= 0   ? stats.noiseFloorFit
                                                       : -1);
  json["noise_floor_fit"] = measured(stats.fitRms >= 0 ? stats.noiseFloorFit : -1);
  json["noise_floor_holdout"] = measured(stats.holdoutRms >= 0 ? stats.noiseFloorHoldout : -1);
  double expected = 0, share = 0;
  for (const TwoShotMaterial& material : fit.materials) {
    if (!(material.expected.unseen > 0)) continue;  // too few pixels: nothing was measured of it
    expected += material.share * material.expected.unseen, share += material.share;
  }
  json["expected_error"] = share > 0 && expected > 0 ? Json(expected / share) : Json(nullptr);
  json["rows"] = stats.rows;
  json["clipped_pixels"] = stats.clippedPixels;
  json["dark_pixels"] = stats.darkPixels;
  json["unreached_rows"] = stats.unreachedPixels;
  json["materials"] = Json::array();
  for (std::size_t m = 0; m < fit.materials.size(); ++m) {
    const TwoShotMaterial& material = fit.materials[m];
    json["materials"].push_back({{"brdf", numbered("brdf", m, ".binary")},
                                 {"share", material.share},
                                 {"eta", list(material.eta)},
                                 {"residual_sd", list(material.residualSd)},
                                 {"prior_sd", material.priorSd},
                                 {"expected", toJson(material.expected)}});
  }
  json["shots"] = Json::array();
  const std::vector<std::string> rendered = renderedFiles(fit);
  for (std::size_t s = 0; s < fit.comparisons.size(); ++s) {
    const TwoShotComparison& comparison = fit.comparisons[s];
    json["shots"].push_back({{"file", comparison.file},
                             {"split", comparison.holdout ? "holdout" : "fit"},
                             {"rendered", rendered[s].empty() ? Json(nullptr) : Json(rendered[s])},
                             {"rms", measured(comparison.rms)},
                             {"noise_floor", measured(comparison.noiseFloor)},
                             {"theta_h_deg", degrees(comparison.centre.thetaHRad)},
                             {"theta_d_deg", degrees(comparison.centre.thetaDRad)},
                             {"phi_d_deg", degrees(comparison.centre.phiDRad)}});
    if (!comparison.leftOut.empty()) json["shots"].back()["left_out"] = comparison.leftOut;
  }
  json["remarks"] = stats.remarks;
  return json;
}

Json coefficientsJson(const TwoShotFit& fit) {
  Json json;
  json["basis"] = {{"name", fit.basis->name()}, {"checksum", hex(fit.basis->checksum())}};
  json["about"] = "mapped BRDF = mean + Q c; c for R, G, B, in the order of the basis' components";
  json["materials"] = Json::array();
  for (const TwoShotMaterial& material : fit.materials) {
    Json channels = Json::array();
    for (int c = 0; c < 3; ++c) {
      const Eigen::VectorXd column = material.coefficients.col(c);
      channels.push_back(std::vector<double>(column.begin(), column.end()));
    }
    json["materials"].push_back(std::move(channels));
  }
  return json;
}

Status writeJson(const fs::path& file, const Json& json) {
  return writeFileAtomically(file, json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

/// Labels as colours that can be told apart, also by those who see no red or green. Source: Okabe and Ito
/// 2008.
Image labelPicture(const Image& labels) {
  constexpr std::array<std::array<float, 3>, 8> kColours = {{{0.90f, 0.62f, 0.00f},
                                                             {0.34f, 0.71f, 0.91f},
                                                             {0.00f, 0.62f, 0.45f},
                                                             {0.94f, 0.89f, 0.26f},
                                                             {0.00f, 0.45f, 0.70f},
                                                             {0.84f, 0.37f, 0.00f},
                                                             {0.80f, 0.47f, 0.65f},
                                                             {0.60f, 0.60f, 0.60f}}};
  Image picture(labels.width(), labels.height(), 3);
  for (std::size_t i = 0; i < labels.pixelCount(); ++i) {
    const int label = static_cast<int>(labels.samples()[i]);
    for (int c = 0; c < 3 && label >= 0; ++c) picture.samples()[3 * i + c] = kColours[label % 8][c];
  }
  return picture;
}

Status makeFolder(const fs::path& folder) {
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (!failed) return Done{};
  return Error{ErrorCode::WriteFailed, "can't make a folder: " + failed.message(), folder.string(),
               "check the disk's space and permissions"};
}

Status writeInto(const fs::path& folder, const TwoShotFit& fit) {
  for (std::size_t m = 0; m < fit.materials.size(); ++m) {
    const TwoShotMaterial& material = fit.materials[m];
    if (auto status = writeMerl(folder / numbered("brdf", m, ".binary"), *material.brdf); !status)
      return status;
    if (!material.posteriorSd) continue;  // cancelled before it
    Image sd(kPosteriorWidth, kPosteriorHeight, 1);
    std::copy(material.posteriorSd->begin(), material.posteriorSd->end(), sd.samples().begin());
    auto status = writeExr(folder / numbered("posterior_sd", m, ".exr"), sd, {"Y"},
                           {{"units", "standard deviation, natural-log units; -1: not covered"},
                            {"axes", "column: phiD of the MERL grid; row: thetaH * 90 + thetaD"}},
                           true);
    if (!status) return status;
  }
  if (!fit.labels.empty()) {
    if (auto status = writeExr(folder / "labels.exr", fit.labels, {"Y"},
                               {{"units", "material, from 0; -1: off the sample"}});
        !status)
      return status;
    if (auto status = writePng(folder / "labels.png", labelPicture(fit.labels)); !status) return status;
  }
  if (!fit.comparisons.empty()) {
    if (auto status = makeFolder(folder / "rendered"); !status) return status;
  }
  const std::vector<std::string> rendered = renderedFiles(fit);
  for (std::size_t s = 0; s < fit.comparisons.size(); ++s) {
    if (rendered[s].empty()) continue;
    const TwoShotComparison& comparison = fit.comparisons[s];
    const fs::path file = folder / rendered[s];
    if (auto status = makeFolder(file.parent_path()); !status) return status;
    if (auto status = writeExr(file, comparison.rendered, {"R", "G", "B"},
                               {{"units", "as the photograph " + comparison.file}}, false);
        !status)
      return status;
  }
  if (auto status = writeJson(folder / "coefficients.json", coefficientsJson(fit)); !status) return status;
  return writeJson(folder / "fit.json", toJson(fit));
}

}  // namespace

Status writeTwoShotFit(const fs::path& folder, const TwoShotFit& fit,
                       const std::function<Status(const fs::path&)>& writeMore) {
  auto staged = StagedFolder::create(folder);
  if (!staged) return staged.error();
  if (auto status = writeInto(staged->path(), fit); !status) return status;
  if (writeMore) {
    if (auto status = writeMore(staged->path()); !status) return status;
  }
  return staged->commit();
}

namespace {

Error malformed(const fs::path& file, std::string what) {
  return {ErrorCode::Malformed, std::move(what), file.string(), "fit the bundle again"};
}

double numberOr(const Json& json, const char* key, double fallback) {
  return json.contains(key) && json.at(key).is_number() ? json.at(key).get<double>() : fallback;
}

Eigen::Vector3d vectorOf(const Json& json) {
  return {json.at(0).get<double>(), json.at(1).get<double>(), json.at(2).get<double>()};
}

/// Everything that fit.json holds, photographs aside; of these only which were left out, and why. Throws
/// nlohmann's exceptions.
void readFitJson(const Json& json, TwoShotFit* fit, fs::path* bundle, std::string* checksum,
                 std::map<std::string, std::string>* leftOut) {
  // Fits of earlier versions don't say it.
  for (const Json& shot : json.at("shots")) {
    if (shot.contains("left_out"))
      (*leftOut)[shot.at("file").get<std::string>()] = shot.at("left_out").get<std::string>();
  }
  *bundle = json.at("bundle").get<std::string>();
  const Json& options = json.at("options");
  fit->options.eta = options.at("eta").get<double>();
  fit->options.chooseEta = options.at("choose_eta").get<bool>();
  fit->options.rowsPerShot = options.at("rows_per_shot").get<int>();
  fit->options.noiseWeights = options.at("noise_weights").get<bool>();
  fit->options.clusters = options.at("clusters").get<int>();
  fit->options.basisFile = json.at("basis").at("file").get<std::string>();
  *checksum = json.at("basis").at("checksum").get<std::string>();
  TwoShotStats& stats = fit->stats;
  stats.seconds = json.at("seconds").get<std::map<std::string, double>>();
  stats.cancelled = json.at("cancelled").get<bool>();
  stats.pixels = json.at("texels").get<std::size_t>();
  stats.rows = json.at("rows").get<std::size_t>();
  stats.clippedPixels = json.at("clipped_pixels").get<std::size_t>();
  stats.darkPixels = json.at("dark_pixels").get<std::size_t>();
  stats.unreachedPixels = json.at("unreached_rows").get<std::size_t>();
  stats.fitRms = numberOr(json, "fit_rms", -1), stats.holdoutRms = numberOr(json, "holdout_rms", -1);
  stats.noiseFloorFit = numberOr(json, "noise_floor_fit", 0);
  stats.noiseFloorHoldout = numberOr(json, "noise_floor_holdout", 0);
  stats.remarks = json.at("remarks").get<std::vector<std::string>>();
  for (const Json& entry : json.at("materials")) {
    TwoShotMaterial& material = fit->materials.emplace_back();
    material.share = entry.at("share").get<double>();
    material.eta = vectorOf(entry.at("eta"));
    material.residualSd = vectorOf(entry.at("residual_sd"));
    material.priorSd = entry.at("prior_sd").get<double>();
    const Json& expected = entry.at("expected");
    material.expected.unseen = expected.at("unseen").get<double>();
    material.expected.unseenMedian = expected.at("unseen_median").get<double>();
    material.expected.unseenWorstTenth = expected.at("unseen_worst_tenth").get<double>();
    material.expected.training = expected.at("training").get<double>();
    material.expected.prior = expected.at("prior").get<double>();
    material.expected.posterior = expected.at("posterior").get<double>();
  }
}

Status readCoefficients(const fs::path& file, TwoShotFit* fit) {
  auto text = readFile(file, kLargestJson);
  if (!text) return text.error();
  const int k = fit->basis->componentCount();
  try {
    const Json json = Json::parse(*text);
    const Json& materials = json.at("materials");
    if (materials.size() != fit->materials.size())
      return malformed(file, "it holds another number of materials");
    for (std::size_t m = 0; m < materials.size(); ++m) {
      fit->materials[m].coefficients.resize(k, 3);
      for (int c = 0; c < 3; ++c) {
        const auto values = materials.at(m).at(c).get<std::vector<double>>();
        if (static_cast<int>(values.size()) != k)
          return malformed(file, "it holds another number of coefficients than the basis has");
        fit->materials[m].coefficients.col(c) = Eigen::Map<const Eigen::VectorXd>(values.data(), k);
      }
    }
  } catch (const nlohmann::json::exception& problem) {
    return malformed(file, std::string("it can't be understood: ") + problem.what());
  }
  return Done{};
}

/// The materials of the first shot's pixels, as the written label map has them.
Result<MaterialMap> readLabels(const fs::path& folder, TwoShotFit* fit) {
  MaterialMap map;
  map.count = static_cast<int>(fit->materials.size());
  if (map.count == 1) return map;
  map.camera = fit->capture.shots.front().camera;
  const fs::path file = folder / "labels.exr";
  auto labels = readExr(file, {"Y"}, ImageSize{map.camera.width, map.camera.height});
  if (!labels) return labels.error();
  fit->labels = std::move(*labels);
  for (const float value : fit->labels.samples()) {
    if (!(value >= -1 && value < static_cast<float>(map.count)))
      return malformed(file, "it holds a label that no material has");
    map.label.push_back(static_cast<std::int8_t>(value));
  }
  map.certain = map.label;
  return map;
}

Result<std::shared_ptr<const TwoShotFit>> load(const fs::path& folder, const JobContext& job) {
  const fs::path jsonFile = folder / "fit.json";
  auto text = readFile(jsonFile, kLargestJson);
  if (!text) return text.error();
  auto fit = std::make_shared<TwoShotFit>();
  fs::path bundle;
  std::string checksum;
  std::map<std::string, std::string> leftOutFiles;
  try {
    const Json json = Json::parse(*text);
    if (json.at("kind") != "two-shot") return malformed(jsonFile, "this is not a fit of kind two-shot");
    readFitJson(json, fit.get(), &bundle, &checksum, &leftOutFiles);
  } catch (const nlohmann::json::exception& problem) {
    return malformed(jsonFile, std::string("fit.json can't be understood: ") + problem.what());
  }
  if (!fit->options.validate().empty() || fit->materials.empty() || fit->materials.size() > kMostMaterials)
    return malformed(jsonFile, "fit.json holds impossible values");
  auto basis = basisFor(fit->options.basisFile, job);
  if (!basis) return basis.error();
  fit->basis = *basis;
  if (hex(fit->basis->checksum()) != checksum) {
    return Error{ErrorCode::Invalid, "the basis is not the one that this fit was made with any more",
                 fit->options.basisFile.empty() ? "the built-in basis" : fit->options.basisFile,
                 "put the basis back, or fit the bundle again"};
  }
  if (auto status = readCoefficients(folder / "coefficients.json", fit.get()); !status) return status.error();
  for (std::size_t m = 0; m < fit->materials.size(); ++m) {
    TwoShotMaterial& material = fit->materials[m];
    auto brdf = readMerl(folder / numbered("brdf", m, ".binary"));
    if (!brdf) return brdf.error();
    material.brdf = *brdf;
    const fs::path sdFile = folder / numbered("posterior_sd", m, ".exr");
    std::error_code ignored;
    // A material of too few pixels has none, and says so by a prior of zero; a cancelled fit may not have
    // come to it.
    if ((fit->stats.cancelled || !(material.priorSd > 0)) && !fs::exists(sdFile, ignored)) continue;
    auto sd = readExr(sdFile, {"Y"}, ImageSize{kPosteriorWidth, kPosteriorHeight});
    if (!sd) return sd.error();
    material.posteriorSd =
        std::make_shared<const std::vector<float>>(sd->samples().begin(), sd->samples().end());
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "opening the fit was cancelled", "", ""};
  }
  auto capture = readTwoShotCapture(bundle, job);
  if (!capture) {
    Error error = capture.error();
    error.what = "the fit's bundle can't be opened: " + error.what;
    error.tryThis = "put the bundle back where it was (" + bundle.string() + "), or fit it again";
    return error;
  }
  fit->capture = std::move(*capture);
  auto labels = readLabels(folder, fit.get());
  if (!labels) return labels.error();
  std::map<std::size_t, std::string> leftOut;
  for (std::size_t s = 0; s < fit->capture.shots.size(); ++s) {
    const auto reason = leftOutFiles.find(fit->capture.shots[s].file);
    if (reason != leftOutFiles.end() && !fit->capture.shots[s].holdout) leftOut[s] = reason->second;
  }
  ErrorSums sums;
  auto compared = compareShots(fit->capture, fit->materials, *labels, leftOut, job, &sums, &sums);
  if (!compared) return compared.error();
  fit->comparisons = std::move(*compared);
  return std::shared_ptr<const TwoShotFit>(std::move(fit));
}

}  // namespace

Result<std::shared_ptr<const TwoShotFit>> loadTwoShotFit(const fs::path& folder, const JobContext& job) {
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::optional<Result<std::shared_ptr<const TwoShotFit>>> fit;
  arena.execute([&] { fit.emplace(load(folder, job)); });
  return std::move(*fit);
}

}  // namespace patina
