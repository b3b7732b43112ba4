// Writes the two-shot part of docs/results.md, its chart and its pictures. Like patina-results, it reads
// truth/.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <thread>

#include "tests/results/page_part.h"
#include "tests/results/two_shot_sections.h"
#include "tests/test_data.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;

int run(int argc, char** argv) {
  CLI::App app("Plans, photographs, reconstructs, and writes the two-shot part of the results page.");
  TwoShotPage page;
  page.data = sharedData();
  page.images = fs::path(PATINA_SOURCE_DIR) / "docs/images";
  fs::path out = fs::path(PATINA_SOURCE_DIR) / "docs/results.md";
  std::vector<std::string> only;
  app.add_option("--data", page.data,
                 "folder of the test data; default: PATINA_TEST_DATA, else ../shared/data");
  app.add_option("--out", out, "page to write");
  app.add_option("--images", page.images, "folder for the chart and the pictures");
  app.add_flag("--quick", page.quick, "a few cases only, to try this program");
  app.add_option("sections", only, "images, leave-out, measured, bundles; default: all");
  CLI11_PARSE(app, argc, argv);
  const auto wanted = [&](const char* name) {
    return only.empty() || std::find(only.begin(), only.end(), name) != only.end();
  };
  if (!fs::exists(page.data / "measured")) {
    std::cerr << "No test data in " << page.data.string() << ". Try: set PATINA_TEST_DATA, or --data\n";
    return 77;  // what ctest takes for skipped
  }
  try {
    Result<BasisPtr> basis = builtInBasis({});
    if (!basis) throw std::runtime_error(basis.error().sentence());
    page.basis = *basis;
    fs::create_directories(page.images);
    const auto section = [&](const char* name, void (*write)(TwoShotPage&)) {
      if (!wanted(name)) return true;
      page.text.str({});
      write(page);
      return replacePagePart(out, std::string("two-shot ") + name, page.text.str());
    };
    if (!replacePagePart(out, "two-shot",
                         "# Two-shot captures\n\nWritten by `packaging/results` "
                         "(tests/results/two_shot_results.cpp), not by hand. "
                         "Basis: the built-in one, fits of the 100\nMERL materials. Errors of logarithms: "
                         "0.2 is about 22 %. "
                         "Machine: " +
                             machineDescription(static_cast<int>(std::thread::hardware_concurrency())) +
                             ".\n") ||
        !section("images", writeErrorAgainstImages) || !section("leave-out", writeLeaveOut) ||
        !section("measured", writeMeasuredMaterials) || !section("bundles", writeTwoShotBundles)) {
      throw std::runtime_error("the results could not be written (" + out.string() + ")");
    }
  } catch (const std::exception& failure) {
    std::cerr << "\n" << failure.what() << "\n";
    return 3;
  }
  if (!page.within) std::cerr << "Some errors are beyond their bounds; they are marked in the page.\n";
  return page.within ? 0 : 1;
}

}  // namespace
}  // namespace patina::test

int main(int argc, char** argv) {
  return patina::test::run(argc, argv);
}
