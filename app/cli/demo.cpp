#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <optional>

#include "app/cli/fit_report.h"
#include "app/cli/verbs.h"
#include "devices/simulated/simulated_rig.h"
#include "engine/base/text.h"
#include "engine/fourier/fit.h"
#include "engine/image/png.h"
#include "engine/render/brdf_sphere.h"
#include "engine/render/contact_sheet.h"
#include "engine/render/relit_sheet.h"
#include "engine/render/tone_map.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kPixels =
    96;  ///< a side of the simulated photographs: small, so that the demo is a matter of seconds
constexpr int kBorderTexels = 2;  ///< texels this near a border between materials are left out of the errors

struct DemoArguments {
  std::string out, scene = "laminate";
};

double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

std::string seconds(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f s", value);
  return text;
}

std::string joined(const std::vector<std::string>& words, const char* between) {
  std::string all;
  for (const std::string& word : words) all += (all.empty() ? "" : between) + word;
  return all;
}

double median(std::vector<double>& values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

/// Median errors of the fitted maps, a line a material. Computed here, from the sheet that the simulator
/// photographed; the fit knows nothing of it.
void printErrors(const SvbrdfMaps& maps, const SimulatedSheet& sheet, Context& context) {
  const SheetTruth truth = sheetTruth(sheet, maps.width, maps.height, kBorderTexels);
  context.console.say("Median errors against the simulator's own sheet (which the fit never sees):");
  context.console.say("  material  sigma   texels   diffuse  specular  sigma   kurtosis  normal");
  for (std::size_t m = 0; m < sheet.materials.size(); ++m) {
    std::vector<double> diffuse, specular, sigma, kurtosis, normalDeg;
    for (int y = 0; y < maps.height; ++y)
      for (int x = 0; x < maps.width; ++x) {
        const auto status = static_cast<TexelStatus>(static_cast<int>(maps.status.at(x, y)));
        if (status != TexelStatus::Converged && status != TexelStatus::IterationLimit) continue;
        if (static_cast<int>(truth.material.at(x, y)) != static_cast<int>(m)) continue;
        double diffuseError = 0, diffuseSum = 0, specularError = 0, specularSum = 0, cosine = 0;
        for (int c = 0; c < 3; ++c) {
          diffuseError += std::abs(maps.diffuse.at(x, y, c) - truth.diffuse.at(x, y, c));
          diffuseSum += truth.diffuse.at(x, y, c);
          specularError += std::abs(maps.specular.at(x, y, c) - truth.specular.at(x, y, c));
          specularSum += truth.specular.at(x, y, c);
          cosine += static_cast<double>(maps.normal.at(x, y, c)) * truth.normal.at(x, y, c);
        }
        diffuse.push_back(diffuseError / std::max(diffuseSum, 1e-6));
        specular.push_back(specularError / std::max(specularSum, 1e-6));
        sigma.push_back(std::abs(maps.sigma.at(x, y) / truth.sigma.at(x, y) - 1));
        kurtosis.push_back(std::abs(maps.kurtosis.at(x, y) / truth.kurtosis.at(x, y) - 1));
        normalDeg.push_back(std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi);
      }
    char line[160];
    std::snprintf(line, sizeof line,
                  "  %-8zu  %.3f  %7zu   %5.1f %%   %5.1f %%  %5.1f %%   %5.1f %%  %.2f deg", m + 1,
                  sheet.materials[m].sigma, sigma.size(), 100 * median(diffuse), 100 * median(specular),
                  100 * median(sigma), 100 * median(kurtosis), median(normalDeg));
    context.console.say(line);
  }
}

struct Picture {
  std::string file, shows;
  Image image;
};

/// A texel of the material's own, far from its borders; empty where there is none.
std::optional<std::pair<int, int>> typicalTexel(const SvbrdfMaps& maps, const SheetTruth& truth,
                                                std::size_t material) {
  std::optional<std::pair<int, int>> best;
  double nearest = 1e9;  // to the sheet's centre: seen best
  for (int y = 0; y < maps.height; ++y)
    for (int x = 0; x < maps.width; ++x) {
      if (static_cast<int>(truth.material.at(x, y)) != static_cast<int>(material)) continue;
      if (static_cast<TexelStatus>(static_cast<int>(maps.status.at(x, y))) != TexelStatus::Converged)
        continue;
      const double distance = std::hypot(x - 0.5 * maps.width, y - 0.5 * maps.height);
      if (distance < nearest) {
        nearest = distance;
        best = {x, y};
      }
    }
  return best;
}

std::vector<Picture> drawPictures(const FourierFit& fit, const SimulatedSheet& sheet) {
  const SvbrdfMaps& maps = fit.maps();
  std::vector<Picture> pictures;
  ContactSheetOptions options;
  options.title = sheet.name + ": fitted maps";
  pictures.push_back({"maps.png", "all fitted maps on one page", contactSheet(maps, options)});

  const auto span = static_cast<float>(std::max(maps.widthMm, maps.heightMm));
  SheetView view;
  view.eyeMm = Eigen::Vector3f(0.1f, -1.9f, 2.3f) * span;
  view.width = 420;
  view.height = 400;
  std::vector<Image> relit;
  const std::vector<std::string> lights{"light behind", "light left", "light right, low"};
  for (const Eigen::Vector3f& at : {Eigen::Vector3f(0.05f, 1.7f, 2.0f), Eigen::Vector3f(-1.5f, 0.9f, 1.5f),
                                    Eigen::Vector3f(1.9f, 0.5f, 0.8f)}) {
    PointLight light;
    light.positionMm = at * span;
    relit.push_back(relitPicture(maps, light, view));
  }
  pictures.push_back({"relit.png", "the fitted sheet under three lights that it was never photographed with",
                      labelledRow(relit, lights)});

  std::vector<Image> spheres;
  std::vector<std::string> labels;
  const SheetTruth truth = sheetTruth(sheet, maps.width, maps.height, kBorderTexels);
  for (std::size_t m = 0; m < sheet.materials.size(); ++m) {
    const auto texel = typicalTexel(maps, truth, m);
    if (!texel) continue;
    const SvbrdfParameters parameters =
        parametersFromMaps(maps, (static_cast<float>(texel->first) + 0.5f) / static_cast<float>(maps.width),
                           (static_cast<float>(texel->second) + 0.5f) / static_cast<float>(maps.height));
    char label[64];
    std::snprintf(label, sizeof label, "texel %d,%d sigma %.3f", texel->first, texel->second,
                  static_cast<double>(parameters.sigma));
    labels.emplace_back(label);
    spheres.push_back(toneMap(brdfSphere(parameters, 340, {}, 96, 0.012f), 1.0f));
  }
  if (!spheres.empty())
    pictures.push_back({"spheres.png", "a sphere of each material, from one texel's parameters",
                        labelledRow(spheres, labels)});
  return pictures;
}

int runDemo(const DemoArguments& arguments, Context& context) {
  const SimulatedSheet sheet = simulatedScene(arguments.scene);
  const std::vector<std::string> scenes = simulatedSceneNames();
  if (std::ranges::find(scenes, arguments.scene) == scenes.end())
    return context.misuse(inQuotes(arguments.scene) + " is not a scene. Try: " + joined(scenes, ", ") + ".");
  const auto start = std::chrono::steady_clock::now();
  JobContext job = context.job();
  job.seed = sheet.seed;
  const fs::path out = arguments.out, bundle = out / "capture", fitted = out / "fit";

  context.console.say("Scene " + sheet.name + ": " + simulatedSceneSummary(sheet.name) + ".");
  const SimulatedRig rig = SimulatedRig::desk(kPixels, sheet.widthMm, sheet.heightMm);
  const auto taken = simulateCapture(bundle, rig, sheet, SimulatedCaptureOptions{}, job);
  context.console.finishProgress();
  if (!taken) return context.fail(taken.error());
  context.console.say("Photographed: " + std::to_string(taken->photos) + " photographs of " +
                      std::to_string(kPixels) + " x " + std::to_string(kPixels) +
                      " pixels by the simulated rig, " + seconds(secondsSince(start)) + ".");
  context.console.say(
      "Calibration, explanation and export are not in this version: the rig's geometry is declared in the "
      "bundle, "
      "and the maps are left as they are fitted.");

  const auto fitting = std::chrono::steady_clock::now();
  const auto capture = readFourierCapture(bundle, job);
  if (!capture) return context.fail(capture.error());
  const auto result = fitFourier(*capture, FourierFitOptions{}, job);
  context.console.finishProgress();
  if (!result) return context.fail(result.error());
  const FourierFit& fit = **result;
  if (const Status written = writeFourierFit(fitted, fit); !written) return context.fail(written.error());
  context.console.say("Fitted in " + seconds(secondsSince(fitting)) + ":");
  printSummary(fit, context);
  if (context.common.stats) printStats(fit.stats(), context);
  if (fit.stats().cancelled) {
    context.console.complain("Cancelled: " + fitted.string() +
                             " holds what was fitted until then, marked; no pictures were made.");
    return kCancelled;
  }

  printErrors(fit.maps(), sheet, context);
  std::string look;
  for (const Picture& picture : drawPictures(fit, sheet)) {
    if (const Status written = writePng(out / picture.file, picture.image); !written)
      return context.fail(written.error());
    look += "\n  " + (out / picture.file).string() + ": " + picture.shows;
  }
  context.console.say("Done in " + seconds(secondsSince(start)) + ". Look at:" + look + "\n  " +
                      (fitted / "maps").string() + ": the maps themselves (OpenEXR), numbers in " +
                      (fitted / "fit.json").string() + "\n  " + bundle.string() +
                      ": the capture bundle; patina opens it, patina-cli fit takes it");
  return kDone;
}

}  // namespace

void addDemoVerb(CLI::App& program, Context& context) {
  CLI::App* verb = program.add_subcommand(
      "demo", "Photographs a simulated sample, fits it and makes pictures: no hardware needed");
  verb->set_help_flag("-h,--help", "Print this help");
  auto arguments = std::make_shared<DemoArguments>();
  verb->add_option(
          "--out", arguments->out,
          "Folder for capture/ (the bundle), fit/ (maps and numbers) and pictures; made if missing;\n"
          "an earlier demo's files in it are replaced")
      ->required()
      ->option_text("DIR");
  std::string scenes;
  for (const std::string& name : simulatedSceneNames())
    scenes += "\n  " + name + ": " + simulatedSceneSummary(name);
  verb->add_option("--scene", arguments->scene, "The simulated sample [default: laminate]:" + scenes)
      ->option_text("NAME");
  addCommonOptions(*verb, context);
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runDemo(*arguments, context); };
  });
}

}  // namespace patina::cli
