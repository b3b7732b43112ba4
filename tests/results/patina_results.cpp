// Fits every Fourier bundle of the test data and writes docs/results.md. The only program that reads truth/.
#include <sys/utsname.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <optional>
#include <set>
#include <sstream>
#include <thread>

#include "engine/base/job.h"
#include "engine/capture/capture.h"
#include "engine/fourier/fit.h"
#include "tests/results/page_part.h"
#include "tests/results/truth_compare.h"
#include "tests/test_data.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;

// What the independent implementation of the model's specification reached, and the bound that tests hold.
struct Reference {
  const char* bundle;
  double diffuse, specular, sigma, normalDeg, heldOutOverNoise;                  ///< reached
  double diffuseBound, specularBound, sigmaBound, normalDegBound, heldOutBound;  ///< allowed
};
constexpr Reference kReferences[] = {
    {"clean_laminate", 0.0021, 0.017, 0.012, 0.059, 1.023, 0.004, 0.025, 0.018, 0.08, 1.035},
    {"clean_cardstock", 0.0147, 0.135, 0.092, 0.59, 1.0085, 0.02, 0.18, 0.12, 0.75, 1.02},
};

struct Row {
  std::string bundle;
  std::optional<Error> error;
  FourierFitStats stats;
  double seconds = 0;
  int mapWidth = 0, mapHeight = 0;
  std::optional<TruthErrors> truth;
};

Row fitOne(const fs::path& bundle, int threads, FitSchedule schedule) {
  Row row;
  row.bundle = bundle.filename().string();
  std::fprintf(stderr, "%s%s ...", row.bundle.c_str(),
               schedule == FitSchedule::Paper ? ", paper's schedule" : "");
  FourierFitOptions options;
  options.schedule = schedule;
  const auto start = std::chrono::steady_clock::now();
  JobContext job;
  job.threads = threads;
  const Result<FourierCapture> capture = readFourierCapture(bundle, job);
  if (!capture) {
    row.error = capture.error();
    return row;
  }
  const Result<std::shared_ptr<const FourierFit>> fit = fitFourier(*capture, options, job);
  row.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (!fit) {
    row.error = fit.error();
    return row;
  }
  row.stats = (*fit)->stats();
  row.mapWidth = (*fit)->maps().width;
  row.mapHeight = (*fit)->maps().height;
  if (row.bundle.starts_with("clean_")) {
    const Result<TruthMaps> truth = readTruth(bundle);
    if (!truth) {
      row.error = truth.error();
      return row;
    }
    row.truth = compareWithTruth((*fit)->maps(), *truth);
  }
  std::fprintf(stderr, " %.1f s, held out %.4f\n", row.seconds, row.stats.holdoutRms);
  return row;
}

std::string number(double value, int digits) {
  std::array<char, 48> text;
  std::snprintf(text.data(), text.size(), "%.*f", digits, value);
  return text.data();
}

// Processor and memory, without anything that names this machine.

void writeFits(std::ostream& out, const std::vector<Row>& rows) {
  out << "## Every bundle\n\n"
         "`fit rms` and `held-out rms` are relative: the root of the sum of squared differences between "
         "model and photograph, over\n"
         "the sum of squared photographs, over pixels inside the sample. The noise floor is the same figure "
         "for a perfect model,\n"
         "from the noise measured in the photographs. A ratio of 1 can't be improved on. Held-out "
         "photographs were not fitted.\n\n"
         "| bundle | maps | points solved | seconds | iterations | fit rms | held-out rms | noise floor | "
         "held-out / floor | failed |\n"
         "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n";
  for (const Row& row : rows) {
    if (row.error) {
      out << "| " << row.bundle << " | not fitted: " << row.error->sentence() << " |\n";
      continue;
    }
    const FourierFitStats& stats = row.stats;
    std::size_t failed = 0;
    for (const auto& [name, count] : stats.statusCounts) {
      std::string lower = name;
      std::transform(lower.begin(), lower.end(), lower.begin(),
                     [](unsigned char c) { return std::tolower(c); });
      if (lower == "failed") failed = count;
    }
    out << "| " << row.bundle << " | " << row.mapWidth << " x " << row.mapHeight << " | " << stats.texels
        << " | " << number(row.seconds, 1) << " | " << number(stats.meanIterations, 1) << " | "
        << number(stats.fitRms, 5) << " | ";
    if (stats.holdoutRms < 0) {
      out << "none held out | " << number(stats.noiseFloorFit, 5) << " (fit) | "
          << number(stats.fitRms / stats.noiseFloorFit, 3) << " (fit)";
    } else {
      out << number(stats.holdoutRms, 5) << " | " << number(stats.noiseFloorHoldout, 5) << " | "
          << number(stats.holdoutRms / stats.noiseFloorHoldout, 3);
    }
    out << " | " << failed << " |\n";
  }
}

void writeStatuses(std::ostream& out, const std::vector<Row>& rows) {
  std::set<std::string> names;
  for (const Row& row : rows) {
    for (const auto& entry : row.stats.statusCounts) names.insert(entry.first);
  }
  out << "\n## What became of the texels\n\nTexels of the maps, by status. What is not measured is marked, "
         "not invented.\n\n| bundle |";
  for (const std::string& name : names) out << " " << name << " |";
  out << "\n| --- |";
  for (std::size_t i = 0; i < names.size(); ++i) out << " ---: |";
  out << "\n";
  for (const Row& row : rows) {
    if (row.error) continue;
    out << "| " << row.bundle << " |";
    for (const std::string& name : names) {
      const auto found = row.stats.statusCounts.find(name);
      out << " " << (found == row.stats.statusCounts.end() ? 0 : found->second) << " |";
    }
    out << "\n";
  }
}

// True where every figure is within its bound.
bool writeTruth(std::ostream& out, const std::vector<Row>& rows) {
  bool within = true;
  out << "\n## Against the truth\n\n"
         "Bundles whose material is of the model's kind: errors of the maps, median / 95th percentile over "
         "texels. Diffuse: albedo,\n"
         "absolute, then relative; specular, sigma and gamma: relative; normals in degrees. Left out: texels "
         "within two texels of a border between materials, and texels "
         "that the fit itself\n"
         "marks as not measured. In brackets: the bound that the tests hold (on the median), then what an "
         "independent\n"
         "implementation of the same model reached.\n\n"
         "| bundle | texels compared | on a border | not measured | diffuse | diffuse, relative | specular | "
         "sigma | "
         "gamma | normal | held-out / floor |\n"
         "| --- | ---: | ---: | ---: | --- | --- | --- | --- | --- | --- | --- |\n";
  for (const Row& row : rows) {
    if (!row.truth) continue;
    const TruthErrors& errors = *row.truth;
    const Reference* reference = nullptr;
    for (const Reference& candidate : kReferences) {
      if (row.bundle == candidate.bundle) reference = &candidate;
    }
    const auto cell = [&](const ErrorSpread& spread, double Reference::*bound, double Reference::*reached) {
      std::string text = number(spread.median, 4) + " / " + number(spread.p95, 4);
      if (reference && bound) {
        text += " (" + number(reference->*bound, 3) + "; " + number(reference->*reached, 4) + ")";
        if (spread.median > reference->*bound) {
          text += " **beyond**";
          within = false;
        }
      }
      return text;
    };
    const double ratio = row.stats.holdoutRms / row.stats.noiseFloorHoldout;
    out << "| " << row.bundle << " | " << errors.compared << " | " << errors.onEdge << " | "
        << errors.notMeasured << " | "
        << cell(errors.diffuseAbsolute, &Reference::diffuseBound, &Reference::diffuse) << " | "
        << cell(errors.diffuse, nullptr, nullptr) << " | "
        << cell(errors.specular, &Reference::specularBound, &Reference::specular) << " | "
        << cell(errors.sigma, &Reference::sigmaBound, &Reference::sigma) << " | "
        << cell(errors.kurtosis, nullptr, nullptr) << " | "
        << cell(errors.normalDeg, &Reference::normalDegBound, &Reference::normalDeg) << " | "
        << number(ratio, 4);
    if (reference) {
      out << " (" << number(reference->heldOutBound, 3) << "; " << number(reference->heldOutOverNoise, 4)
          << ")";
      if (!(ratio <= reference->heldOutBound)) {
        out << " **beyond**";
        within = false;
      }
    }
    out << " |\n";
  }
  return within;
}

void writeStages(std::ostream& out, const std::vector<Row>& rows) {
  std::set<std::string> stages;
  for (const Row& row : rows) {
    for (const auto& entry : row.stats.seconds) stages.insert(entry.first);
  }
  out << "\n## Seconds by stage\n\n| bundle |";
  for (const std::string& stage : stages) out << " " << stage << " |";
  out << "\n| --- |";
  for (std::size_t i = 0; i < stages.size(); ++i) out << " ---: |";
  out << "\n";
  for (const Row& row : rows) {
    if (row.error) continue;
    out << "| " << row.bundle << " |";
    for (const std::string& stage : stages) {
      const auto found = row.stats.seconds.find(stage);
      out << " " << number(found == row.stats.seconds.end() ? 0.0 : found->second, 2) << " |";
    }
    out << "\n";
  }
}

/// The default, an independent solve of every texel at the photographs' resolution, beside the paper's own
/// schedule (section 7: independent texels at half the resolution, then upsampling), each figure the first's,
/// then the second's.
void writeSchedules(std::ostream& out, const std::vector<Row>& rows, const std::vector<Row>& paper) {
  out << "\n## Full-resolution solve against the paper's schedule\n\n"
         "Every texel solved by itself at the photographs' resolution (the default) beside the paper's "
         "schedule (`--schedule paper`: coarse levels, independent\n"
         "texels at half the resolution, upsampling); in each cell the default first. Lower is better; the "
         "better one is bold where they differ by a percent or more. Errors against truth: medians, as "
         "above.\n\n"
         "| bundle | held-out / floor | seconds | diffuse | specular | sigma | gamma | normal |\n"
         "| --- | --- | --- | --- | --- | --- | --- | --- |\n";
  constexpr double kDifferent = 0.01;
  const auto pair = [](double ours, double theirs, int digits) {
    std::string a = number(ours, digits), b = number(theirs, digits);
    if (ours < (1 - kDifferent) * theirs) a = "**" + a + "**";
    if (theirs < (1 - kDifferent) * ours) b = "**" + b + "**";
    return a + ", " + b;
  };
  const auto ratio = [](const FourierFitStats& stats) {
    return stats.holdoutRms >= 0 ? stats.holdoutRms / stats.noiseFloorHoldout
                                 : stats.fitRms / stats.noiseFloorFit;
  };
  int better = 0, worse = 0;
  for (std::size_t i = 0; i < rows.size() && i < paper.size(); ++i) {
    const Row &ours = rows[i], &theirs = paper[i];
    out << "| " << ours.bundle << " | ";
    if (ours.error || theirs.error) {
      out << "not fitted: " << (ours.error ? *ours.error : *theirs.error).sentence() << " |\n";
      continue;
    }
    const double a = ratio(ours.stats), b = ratio(theirs.stats);
    better += a < (1 - kDifferent) * b, worse += b < (1 - kDifferent) * a;
    out << pair(a, b, 3) << (ours.stats.holdoutRms < 0 ? " (fit)" : "") << " | " << number(ours.seconds, 1)
        << ", " << number(theirs.seconds, 1) << " |";
    if (ours.truth && theirs.truth) {
      const TruthErrors &x = *ours.truth, &y = *theirs.truth;
      out << " " << pair(x.diffuseAbsolute.median, y.diffuseAbsolute.median, 4) << " | "
          << pair(x.specular.median, y.specular.median, 4) << " | " << pair(x.sigma.median, y.sigma.median, 4)
          << " | " << pair(x.kurtosis.median, y.kurtosis.median, 4) << " | "
          << pair(x.normalDeg.median, y.normalDeg.median, 4) << " |\n";
    } else {
      out << " | | | | |\n";
    }
  }
  out << "\nOf " << rows.size() << " bundles the default predicts " << better
      << " better by a percent or more, the paper's schedule " << worse << ".\n";
}

int run(int argc, char** argv) {
  CLI::App app("Fits every Fourier bundle of the test data and writes the results page.");
  fs::path data = sharedData(), out = fs::path(PATINA_SOURCE_DIR) / "docs/results.md";
  std::vector<std::string> only;
  int threads = 0;
  app.add_option(
      "--data", data,
      "folder of the test data; default: PATINA_TEST_DATA, else ../shared/data beside the checkout");
  app.add_option("--out", out, "page to write");
  app.add_option("--threads", threads, "0: all cores");
  app.add_option("bundles", only, "names of bundles; default: all below data/fourier");
  CLI11_PARSE(app, argc, argv);

  std::vector<fs::path> bundles;
  std::error_code failure;
  for (const auto& entry : fs::directory_iterator(data / "fourier", failure)) {
    const bool wanted =
        only.empty() || std::find(only.begin(), only.end(), entry.path().filename()) != only.end();
    if (wanted && fs::exists(entry.path() / "capture.json")) bundles.push_back(entry.path());
  }
  std::sort(bundles.begin(), bundles.end());
  if (bundles.empty()) {
    std::cerr << "No bundles to fit (" << (data / "fourier").string()
              << "). Try: set PATINA_TEST_DATA, or name them with --data\n";
    return 3;
  }

  std::vector<Row> rows, paper;
  for (const fs::path& bundle : bundles) {
    for (const FitSchedule schedule : {FitSchedule::Independent, FitSchedule::Paper}) {
      std::vector<Row>& to = schedule == FitSchedule::Paper ? paper : rows;
      to.push_back(fitOne(bundle, threads, schedule));
      if (to.back().error) std::cerr << " " << to.back().error->sentence() << "\n";
    }
  }

  const int threadCount = threads > 0 ? threads : static_cast<int>(std::thread::hardware_concurrency());
  std::ostringstream page;
  page << "# Results\n\n"
          "Written by `packaging/results` (tests/results/patina_results.cpp), not by hand. It fits every "
          "capture bundle in\n"
          "`$PATINA_TEST_DATA/fourier` with the default options. To write this page again:\n\n"
          "```\nPATINA_TEST_DATA=<folder> packaging/results\n```\n\n"
          "Machine: "
       << machineDescription(threadCount) << ".\n\n";
  writeFits(page, rows);
  const bool within = writeTruth(page, rows);
  writeSchedules(page, rows, paper);
  writeStatuses(page, rows);
  writeStages(page, rows);

  fs::create_directories(fs::absolute(out).parent_path(), failure);
  if (!replacePagePart(out, "fourier", page.str())) {
    std::cerr << "The results could not be written (" << out.string() << "). Try: another --out\n";
    return 3;
  }
  std::cerr << "Written to " << out.string() << "\n";
  const bool allFitted =
      std::none_of(rows.begin(), rows.end(), [](const Row& row) { return row.error.has_value(); }) &&
      std::none_of(paper.begin(), paper.end(), [](const Row& row) { return row.error.has_value(); });
  if (!within) std::cerr << "Some errors are beyond their bounds; they are marked in the page.\n";
  return allFitted && within ? 0 : 1;
}

}  // namespace
}  // namespace patina::test

int main(int argc, char** argv) {
  return patina::test::run(argc, argv);
}
