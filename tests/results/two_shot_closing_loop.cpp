// Explains every two-shot bundle and every measured BRDF of the test data and writes the part "two-shot" of
// docs/closing-the-loop.md. Run by packaging/closing-loop. Truth that lies beside a bundle is read here, to
// be printed beside the answer, and by nothing that gives the answer.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <numbers>

#include "devices/simulated/two_shot_rig.h"
#include "engine/brdf/brdf_file.h"
#include "engine/brdf/brdf_summary.h"
#include "engine/diagnosis/two_shot_explain.h"
#include "engine/report/explanation_words.h"
#include "engine/twoshot/fit.h"
#include "tests/base/temp_folder.h"
#include "tests/results/closing_loop_page.h"
#include "tests/results/page_part.h"
#include "tests/test_data.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;
constexpr double kDegree = std::numbers::pi / 180;

struct Plan {
  fs::path data, page, images;
  std::string only;
  int threads = 0;
};

/// One subject of the page: a bundle, or a measured BRDF that is photographed first.
struct Subject {
  std::string name, truth;
  fs::path bundle;
  BrdfPtr brdf;  ///< the true one, where it is known
  bool mayBeShown = false;
};

/// What one shot more or less shows: the plan for glossy samples, a shot towards the light, four held out.
TwoShotScene sceneOf(const BrdfPtr& brdf, bool towardsLight) {
  TwoShotScene scene;
  scene.name = brdf->origin().name;
  scene.brdfs = {brdf};
  scene.pixels = 120;
  scene.samplesPerPixelSide = 2;
  const auto pose = [&](double h, double d, double p, bool holdout) {
    TwoShotPose made;
    made.directions = shotFromHalfDiff({h * kDegree, d * kDegree, p * kDegree});
    made.holdout = holdout;
    scene.poses.push_back(made);
  };
  pose(6, 15, 37.5, false), pose(16, 67, 89, false), pose(42, 25, 60, false);
  if (towardsLight) pose(30, 3, 60, false);
  pose(4, 40, 90, true), pose(25, 30, 20, true), pose(35, 45, 50, true), pose(12, 8, 60, true);
  scene.noise.shot = 2e-5, scene.noise.read = 1e-4;
  scene.effects.surroundings = 2e-3;
  return scene;
}

class Page {
 public:
  explicit Page(const Plan& plan) : plan_(plan) { job_.threads = plan.threads; }

  bool bundles() {
    rows_.clear(), pictures_.clear();
    for (const fs::path& folder : foldersIn(plan_.data / "two-shot")) {
      Subject subject;
      subject.name = folder.filename().string(), subject.truth = truthOf(folder), subject.bundle = folder;
      // Pictures of what may be shown: made for this project, of materials under free licences.
      subject.mayBeShown =
          subject.name.starts_with("measured_") && subject.name.find("tape") == std::string::npos;
      if (wanted(subject.name) && !row(subject)) return false;
    }
    text_ +=
        "### The bundles of the test data\n\n"
        "Photographs by an independent simulator. `truth` is what was in them; the program didn't read it. "
        "Errors are of the photographs that were held out, relative; the noise alone is in brackets.\n\n" +
        table(false);
    return true;
  }

  bool measured() {
    rows_.clear(), pictures_.clear();
    std::vector<fs::path> files;
    for (const char* folder : {"rgl", "retro"}) {
      std::error_code error;
      for (const auto& entry : fs::directory_iterator(plan_.data / "measured" / folder, error))
        files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) {
      if (!wanted(file.stem().string())) continue;
      const auto brdf = readBrdf(file);
      if (!brdf) {
        skipped_.push_back(file.filename().string() + ": " + brdf.error().sentence());
        continue;
      }
      const bool retro = file.parent_path().filename() == "retro";
      const TempFolder folder;
      JobContext job = job_;
      job.seed = 1;
      Subject subject;
      subject.name = file.stem().string(), subject.truth = "measured", subject.bundle = folder / "b";
      subject.brdf = *brdf, subject.mayBeShown = !retro;
      // One more towards the light, as a person would take who sees the sample glow beside his lamp.
      if (const auto made = simulateTwoShot(sceneOf(*brdf, retro), folder / "b", job); !made) {
        skipped_.push_back(subject.name + ": " + made.error().sentence());
        continue;
      }
      if (!row(subject)) return false;
    }
    text_ +=
        "### Every measured BRDF\n\n"
        "Photographed by this program's simulated rig, which evaluates the measured BRDF itself: three "
        "photographs, with one more towards the light for the retroreflectors, four held out, a noise of 1 "
        "%. "
        "`BRDF` is the error of the reconstructed BRDF against the measured one, RMS in natural-log units "
        "over the directions "
        "of a comparison.\n\n" +
        table(true);
    if (!skipped_.empty()) {
      text_ += "Not photographed:\n\n";
      for (const std::string& line : skipped_) text_ += "- " + line + "\n";
      text_ += "\n";
    }
    return true;
  }

  const std::string& text() const { return text_; }

 private:
  struct Row {
    std::string name, truth, found, evidence, after, before, left, brdf;
  };

  bool wanted(const std::string& name) const {
    return plan_.only.empty() || name.find(plan_.only) != std::string::npos;
  }

  std::string brdfError(const std::shared_ptr<const TwoShotFit>& fit, const Brdf& truth) const {
    if (!fit || fit->materials.empty() || !fit->materials[0].brdf) return "";
    const auto compared = compareBrdfs(*fit->materials[0].brdf, truth, job_);
    if (!compared) return "";
    char text[40];
    std::snprintf(text, sizeof text, "%.3f", compared->all.logRms);
    return text;
  }

  bool row(const Subject& subject) {
    std::cerr << subject.name << "\n";
    const auto explained = explain({subject.bundle}, {}, job_);
    if (!explained) {
      std::cerr << subject.name << ": " << explained.error().sentence() << "\n";
      return false;
    }
    const Explanation& e = **explained;
    Row row;
    row.name = subject.name, row.truth = subject.truth;
    row.found = whatWasFound(e), row.evidence = evidence(e);
    const ErrorSummary summary = errorSummary(e);
    row.before = errorText(summary.before, summary.noise);
    row.after = e.effects.empty() ? "the same" : errorText(summary.after, summary.noise);
    row.left = wholePercent(e.unexplained.fraction) + ". " + e.unexplained.description;
    if (subject.brdf) {
      row.brdf = brdfError(e.twoShotBefore, *subject.brdf);
      if (!e.effects.empty()) row.brdf += " to " + brdfError(e.twoShotAfter, *subject.brdf);
    }
    if (subject.mayBeShown && !e.effects.empty() && pictures_.size() < 4) {
      const std::string file = "closing_loop_" + subject.name + ".png";
      if (writePicture(e, plan_.images / file)) pictures_.push_back({subject.name, file});
    }
    rows_.push_back(std::move(row));
    return true;
  }

  std::string table(bool brdf) const {
    std::string text = brdf
                           ? "| material | before | found | after | BRDF |\n| --- | --- | --- | --- | --- |\n"
                           : "| bundle | truth | before | found | after |\n| --- | --- | --- | --- | --- |\n";
    for (const Row& r : rows_)
      text += "| " + r.name + " | " + (brdf ? "" : r.truth + " | ") + r.before + " | " + r.found + " | " +
              r.after + (brdf ? " | " + r.brdf : "") + " |\n";
    text += "\n";
    for (const auto& [name, file] : pictures_)
      text += "![" + name + ": photograph, prediction before and after, residuals](images/" + file + ")\n\n";
    text += "Evidence, and what stays unexplained (share of the residual's energy above the noise):\n\n";
    for (const Row& r : rows_) text += "- " + r.name + ": " + r.evidence + " Unexplained: " + r.left + "\n";
    return text + "\n";
  }

  const Plan& plan_;
  JobContext job_;
  std::string text_;
  std::vector<Row> rows_;
  std::vector<std::pair<std::string, std::string>> pictures_;
  std::vector<std::string> skipped_;
};

int run(const Plan& plan) {
  if (!fs::exists(plan.data / "two-shot")) {
    std::cerr << "no two-shot bundles in " << plan.data << ": set PATINA_TEST_DATA\n";
    return 77;
  }
  std::error_code error;
  fs::create_directories(plan.images, error);
  Page page(plan);
  if (!page.bundles() || !page.measured()) return 1;
  const std::string text =
      "## Two-shot captures\n\n"
      "Written by `packaging/closing-loop` (tests/results/two_shot_closing_loop.cpp). How the search works: "
      "[two_shot.md](two_shot.md); how often it is right: [results.md](results.md).\n\n" +
      page.text();
  std::cout << text;
  if (!plan.only.empty()) return 0;
  return replacePagePart(plan.page, "two-shot", text) ? 0 : 1;
}

}  // namespace
}  // namespace patina::test

int main(int argc, char** argv) {
  using namespace patina::test;
  Plan plan;
  plan.data = sharedData();
  plan.page = fs::path(PATINA_SOURCE_DIR) / "docs/closing-the-loop.md";
  plan.images = fs::path(PATINA_SOURCE_DIR) / "docs/images";
  CLI::App app("Explains two-shot bundles and measured BRDFs and writes what was found");
  app.add_option("--data", plan.data, "Folder of the test data");
  app.add_option("--page", plan.page, "The page whose part is written");
  app.add_option("--images", plan.images, "Folder for its pictures");
  app.add_option("--only", plan.only, "Only subjects with this in their name; no page is written");
  app.add_option("--threads", plan.threads, "0: one a core [default: 0]");
  CLI11_PARSE(app, argc, argv);
  return run(plan);
}
