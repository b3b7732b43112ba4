// Explains every capture of kind "fourier" or "flash" of the test data, and for "fourier" every measured BRDF
// as a sheet under the simulated screen, and writes that part of docs/closing-the-loop.md. Run by
// packaging/closing-loop. Truth that lies beside a bundle is read here, to be printed beside the answer, and
// by nothing that gives the answer.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <iostream>

#include "devices/simulated/live_rig.h"
#include "engine/acquire/capture_session.h"
#include "engine/brdf/brdf_file.h"
#include "engine/flash/fit.h"
#include "engine/fourier/fit.h"
#include "engine/report/explanation_words.h"
#include "tests/base/temp_folder.h"
#include "tests/results/closing_loop_page.h"
#include "tests/results/page_part.h"
#include "tests/results/truth_compare.h"
#include "tests/test_data.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;

struct Plan {
  std::string kind = "fourier", only;
  fs::path data, page, images;
  int threads = 0;
  bool noBrdfs = false;
};

/// One subject of the page.
struct Subject {
  std::string name, truth;
  std::vector<fs::path> bundles;
  bool mayBeShown = false;
};

class Page {
 public:
  explicit Page(const Plan& plan) : plan_(plan) { job_.threads = plan.threads; }

  bool bundles() {
    std::vector<fs::path> folders = foldersIn(plan_.data / plan_.kind);
    for (const fs::path& folder : folders) {
      Subject subject{folder.filename().string(), truthOf(folder), {folder}};
      // Of what may be shown: made for this project, of materials under free licences.
      subject.mayBeShown = plan_.kind == "fourier";
      if (!row(subject)) return false;
    }
    // What belongs together, explained together: views of one sheet, and a sheet with its white paper.
    for (const fs::path& folder : folders) {
      const std::string name = folder.filename().string();
      const auto has = [&](const std::string& other) {
        return std::ranges::find(folders, folder.parent_path() / other) != folders.end();
      };
      std::string other;
      if (name.ends_with("_view_1")) other = name.substr(0, name.size() - 1) + "2";
      if (has(name + "_paper")) other = name + "_paper";
      if (other.empty() || !has(other)) continue;
      Subject subject{name + " with " + other, truthOf(folder), {folder, folder.parent_path() / other}};
      subject.mayBeShown = true;
      if (!row(subject)) return false;
    }
    text_ += plan_.kind == "fourier"
                 ? "### The bundles of the test data\n\nPhotographs by an independent simulator. "
                 : "### The photographs of the test data\n\nReal ones. ";
    text_ +=
        "`truth` is what was in them; the program didn't read it. Errors are of the photographs that were "
        "held out, relative; the noise alone is in brackets.\n\n" +
        table();
    return true;
  }

  /// Each measured BRDF as a sheet with a little relief, captured by the live rig.
  bool measured() {
    std::vector<fs::path> files;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(plan_.data / "measured/rgl", error))
      files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    rows_.clear(), pictures_.clear();
    for (const fs::path& file : files) {
      if (!wanted(file.stem().string())) continue;
      const auto brdf = readBrdf(file);
      const TempFolder folder;
      Subject subject{file.stem().string(), "measured", {folder / "b"}};
      if (!brdf) {
        skipped_.push_back(subject.name + ": " + brdf.error().sentence());
        continue;
      }
      LiveRigSetup setup = LiveRig::desk("laminate", 48, 960);
      setup.name = subject.name;
      for (SheetMaterial& material : setup.sheet.materials) material = setup.sheet.materials.front();
      setup.sheet.materials.resize(1);
      setup.sheet.pattern = SheetPattern::Uniform;
      setup.brdfs = {*brdf};
      if (const Status made = capture(setup, folder / "b"); !made) {
        skipped_.push_back(subject.name + ": " + made.error().sentence());
        continue;
      }
      subject.mayBeShown = true;
      if (!row(subject)) return false;
    }
    text_ +=
        "### Every measured BRDF under the screen\n\n"
        "A sheet of one material with a little relief, photographed by this program's live rig, which "
        "integrates the measured BRDF itself over the screen.\n\n" +
        table();
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
    std::string name, truth, before, found, after, maps, evidence, left;
  };

  bool wanted(const std::string& name) const {
    return plan_.only.empty() || name.find(plan_.only) != std::string::npos;
  }

  Status capture(const LiveRigSetup& setup, const fs::path& folder) {
    auto rig = LiveRig::create(setup);
    if (!rig) return rig.error();
    auto camera = (*rig)->openCamera();
    if (!camera) return camera.error();
    const auto display = (*rig)->openDisplay();
    auto session = CaptureSession::open(folder, (*rig)->description(), {}, false);
    if (!session) return session.error();
    const auto outcome = (*session)->run(**camera, *display, job_);
    if (!outcome) return outcome.error();
    return Done{};
  }

  /// Median errors against the maps that lie beside the bundle: normal in degrees, sigma relative.
  std::string mapErrors(const Explanation& e) const {
    const Result<TruthMaps> truth = readTruth(e.bundles.front());
    if (!truth || !e.fourierBefore) return "";
    std::string text;
    for (const auto& fit : {e.fourierBefore, e.fourierAfter}) {
      if (!fit || (fit == e.fourierBefore && !text.empty())) continue;
      const TruthErrors errors = compareWithTruth(fit->maps(), *truth);
      if (errors.compared == 0) return "";
      char part[80];
      std::snprintf(part, sizeof part, "%s%.2f degrees, %.1f %%", text.empty() ? "" : " to ",
                    errors.normalDeg.median, 100 * errors.sigma.median);
      text += part;
    }
    return text;
  }

  bool row(const Subject& subject) {
    if (!wanted(subject.name)) return true;
    std::cerr << subject.name << "\n";
    const auto explained = explain(subject.bundles, {}, job_);
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
    row.maps = mapErrors(e);
    row.left = wholePercent(e.unexplained.fraction) + ". " + e.unexplained.description;
    if (subject.mayBeShown && !e.effects.empty() && pictures_.size() < 4) {
      std::string file = "closing_loop_" + plan_.kind + "_" + subject.name + ".png";
      std::ranges::replace(file, ' ', '_');
      if (writePicture(e, plan_.images / file)) pictures_.push_back({subject.name, file});
    }
    std::cerr << "  " << row.before << " -> " << row.found << " -> " << row.after << "\n";
    rows_.push_back(std::move(row));
    return true;
  }

  std::string table() {
    const bool maps = std::ranges::any_of(rows_, [](const Row& r) { return !r.maps.empty(); });
    std::string text = std::string("| capture | truth | before | found | after |") +
                       (maps ? " normal, sigma against truth |" : "") + "\n| --- | --- | --- | --- | --- |" +
                       (maps ? " --- |" : "") + "\n";
    for (const Row& r : rows_)
      text += "| " + r.name + " | " + r.truth + " | " + r.before + " | " + r.found + " | " + r.after + " |" +
              (maps ? " " + r.maps + " |" : "") + "\n";
    text += "\n";
    for (const auto& [name, file] : pictures_)
      text += "![" + name + ": photograph, prediction before and after, residuals](images/" + file + ")\n\n";
    text += "Evidence, and what stays unexplained (share of the residual's energy above the noise):\n\n";
    for (const Row& r : rows_) text += "- " + r.name + ": " + r.evidence + " Unexplained: " + r.left + "\n";
    rows_.clear(), pictures_.clear();
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
  if (!fs::exists(plan.data / plan.kind)) {
    std::cerr << "no bundles of kind " << plan.kind << " in " << plan.data << ": set PATINA_TEST_DATA\n";
    return 77;
  }
  std::error_code error;
  fs::create_directories(plan.images, error);
  Page page(plan);
  if (!page.bundles()) return 1;
  const bool fourier = plan.kind == "fourier";
  if (fourier && !plan.noBrdfs && !page.measured()) return 1;
  const std::string text =
      (fourier ? std::string("## Fourier captures\n\nHow the search works: [explain.md](explain.md)")
               : std::string("## Flash photographs\n\nHow the search works: [flash.md](flash.md)")) +
      "; how often it is right: [results.md](results.md). Written by `packaging/closing-loop` "
      "(tests/results/maps_closing_loop.cpp).\n\n" +
      page.text();
  std::cout << text;
  if (!plan.only.empty()) return 0;
  return replacePagePart(plan.page, plan.kind, text) ? 0 : 1;
}

}  // namespace
}  // namespace patina::test

int main(int argc, char** argv) {
  using namespace patina::test;
  namespace fs = std::filesystem;
  Plan plan;
  plan.data = sharedData();
  plan.page = fs::path(PATINA_SOURCE_DIR) / "docs/closing-the-loop.md";
  plan.images = fs::path(PATINA_SOURCE_DIR) / "docs/images";
  CLI::App app("Explains captures of kind fourier or flash and writes what was found");
  app.add_option("--kind", plan.kind, "fourier or flash")->check(CLI::IsMember({"fourier", "flash"}));
  app.add_option("--data", plan.data, "Folder of the test data");
  app.add_option("--page", plan.page, "The page whose part is written");
  app.add_option("--images", plan.images, "Folder for its pictures");
  app.add_option("--only", plan.only, "Only subjects with this in their name; no page is written");
  app.add_flag("--no-brdfs", plan.noBrdfs, "Fourier captures: bundles only, no measured BRDFs as sheets");
  app.add_option("--threads", plan.threads, "0: one a core [default: 0]");
  CLI11_PARSE(app, argc, argv);
  return run(plan);
}
