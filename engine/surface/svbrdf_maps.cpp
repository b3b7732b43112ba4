#include "engine/surface/svbrdf_maps.h"

#include <map>
#include <string>
#include <vector>

#include "engine/image/exr.h"

namespace patina {
namespace {

struct MapFile {
  const char* name;
  Image SvbrdfMaps::*image;
  std::vector<std::string> channels;
  const char* meaning;
  bool optional = false;
};

const std::vector<MapFile>& mapFiles() {
  static const std::vector<MapFile> files = {
      {"diffuse", &SvbrdfMaps::diffuse, {"R", "G", "B"}, "diffuse albedo"},
      {"specular",
       &SvbrdfMaps::specular,
       {"R", "G", "B"},
       "specular lobe's albedo at normal incidence (Schlick, F0 = 0.06)"},
      {"normal",
       &SvbrdfMaps::normal,
       {"X", "Y", "Z"},
       "unit normal, world frame: x right, y up, z out of the sample"},
      {"sigma", &SvbrdfMaps::sigma, {"Y"}, "standard deviation of the half-vector's slope"},
      {"kurtosis", &SvbrdfMaps::kurtosis, {"Y"}, "gamma: ratio of the two lobes' widths to their mean"},
      {"residual", &SvbrdfMaps::residual, {"Y"}, "relative RMS of model minus measurement, noise-weighted"},
      {"status",
       &SvbrdfMaps::status,
       {"Y"},
       "0 not measured, 1 converged, 2 iteration limit, 3 mirror point off the screen, 4 clipped, 5 failed, "
       "6 cancelled"},
      {"diffuse_sd",
       &SvbrdfMaps::diffuseSd,
       {"R", "G", "B"},
       "standard deviation of the diffuse albedo, from noise and priors",
       true},
      {"specular_sd",
       &SvbrdfMaps::specularSd,
       {"R", "G", "B"},
       "standard deviation of the specular albedo, from noise and priors",
       true},
      {"normal_sd",
       &SvbrdfMaps::normalSd,
       {"Y"},
       "standard deviation of the normal's direction, degrees, from noise and priors",
       true},
      {"sigma_sd", &SvbrdfMaps::sigmaSd, {"Y"}, "standard deviation of sigma, from noise and priors", true},
      {"kurtosis_sd",
       &SvbrdfMaps::kurtosisSd,
       {"Y"},
       "standard deviation of gamma, from noise and priors",
       true},
  };
  return files;
}

}  // namespace

Status writeMaps(const std::filesystem::path& folder, const SvbrdfMaps& maps) {
  for (const auto& file : mapFiles()) {
    if (file.optional && (maps.*file.image).width() == 0) continue;
    const std::map<std::string, std::string> attributes = {
        {"patina:meaning", file.meaning},
        {"patina:rectangle_mm",
         std::to_string(maps.widthMm) + " x " + std::to_string(maps.heightMm) + ", row 0 at +y"}};
    auto status =
        writeExr(folder / (std::string(file.name) + ".exr"), maps.*file.image, file.channels, attributes);
    if (!status) return status;
  }
  return Done{};
}

Result<SvbrdfMaps> readMaps(const std::filesystem::path& folder) {
  SvbrdfMaps maps;
  for (const auto& file : mapFiles()) {
    const auto path = folder / (std::string(file.name) + ".exr");
    std::error_code missing;
    if (file.optional && !std::filesystem::exists(path, missing)) continue;
    auto image = readExr(path, file.channels);
    if (!image) return image.error();
    if (maps.width == 0) maps.width = image->width(), maps.height = image->height();
    if (image->width() != maps.width || image->height() != maps.height)
      return Error{ErrorCode::Invalid, "the maps of a fit have different sizes", path.string(),
                   "fit the bundle again"};
    maps.*file.image = std::move(*image);
  }
  return maps;
}

}  // namespace patina
