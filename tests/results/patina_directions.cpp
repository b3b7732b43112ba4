// Searches directions for the usual fields of view on the built-in basis and writes
// docs/two_shot_directions.md. Run by packaging/directions.
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <sstream>

#include "engine/base/atomic_file.h"
#include "engine/twoshot/plan.h"

namespace patina::test {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

struct Case {
  const char* name;  // of the photographs' setting; the same name: the same section of the page
  PlanOptions options;
};

std::string number(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

PlanOptions options(double fovDeg, int shots, int restarts) {
  PlanOptions made;
  made.fovDeg = fovDeg;
  made.shots = shots;
  made.restarts = restarts;
  return made;
}

std::vector<Case> cases(int restarts) {
  std::vector<Case> list;
  for (const int shots : {1, 2})
    for (const double fov : {15.0, 25.0, 35.0, 45.0})
      list.push_back({"Free camera and light", options(fov, shots, restarts)});
  const int fewer = std::max(1, restarts / 3);  // each costs several times more
  Case robust{"Free, robust: the error averaged over camera and light 1.5 degrees off",
              options(25, 2, fewer)};
  robust.options.poseErrorDeg = 1.5;
  list.push_back(robust);
  Case trusted{"Free, within the trusted directions (81 degrees of the normal), robust",
               options(25, 2, fewer)};
  trusted.options.poseErrorDeg = 1.5;
  trusted.options.region = BasisRegion::Trusted;
  list.push_back(trusted);
  trusted.options.shots = 3;
  list.push_back(trusted);
  for (const PlanSetup setup : {PlanSetup::FixedCamera, PlanSetup::FixedLight}) {
    Case fixed{setup == PlanSetup::FixedCamera ? "One camera position, two lights"
                                               : "One light position, two cameras",
               options(25, 2, restarts)};
    fixed.options.setup = setup;
    list.push_back(fixed);
  }
  return list;
}

std::string angles(const Eigen::Vector3d& to, bool withAzimuth) {
  const double azimuth = std::hypot(to.x(), to.y()) < 1e-9 ? 0 : std::atan2(to.y(), to.x()) * kDegrees;
  return number("%.1f", std::acos(to.z()) * kDegrees) + (withAzimuth ? " at " + number("%.1f", azimuth) : "");
}

void writeCase(std::ostream& out, const Plan& plan) {
  for (std::size_t i = 0; i < plan.shots.size(); ++i) {
    const PlannedShot& shot = plan.shots[i];
    if (i == 0) {
      out << "| " << plan.options.fovDeg << " | " << plan.shots.size() << " | ";
    } else {
      out << "| | | ";
    }
    out << number("(%.1f, ", shot.angles.thetaHRad * kDegrees)
        << number("%.1f, ", shot.angles.thetaDRad * kDegrees)
        << number("%.1f)", shot.angles.phiDRad * kDegrees) << " | " << angles(shot.directions.toCamera, true)
        << " | " << angles(shot.directions.toLight, true) << " | ";
    if (i == 0) {
      out << number("%.3f", plan.expected.training) << " | " << number("%.3f", plan.expected.unseen) << " ("
          << number("%.0f %%", percentFromLn(plan.expected.unseen)) << ") | "
          << number("%.3f", plan.expected.unseenWorstTenth) << " | " << number("%.3f", plan.poseTolerant)
          << " | " << number("%.2g", plan.conditionNumber) << " |\n";
    } else {
      out << "| | | | |\n";
    }
  }
}

int run(int argc, char** argv) {
  std::string path = std::string(PATINA_SOURCE_DIR) + "/docs/two_shot_directions.md";
  int restarts = 8, candidates = 500;
  CLI::App program("Writes the page of two-shot directions", "patina-directions");
  program.add_option("--out", path, "The page [default: docs/two_shot_directions.md]");
  program.add_option("--restarts", restarts, "Searches a plan, a third of them where robust [default: 8]")
      ->check(CLI::Range(1, 1000));
  program.add_option("--candidates", candidates, "Random directions a photograph [default: 500]")
      ->check(CLI::Range(1, 100000));
  CLI11_PARSE(program, argc, argv);

  const JobContext job;
  const Result<BasisPtr> basis = builtInBasis(job);
  if (!basis) {
    std::fprintf(stderr, "%s\n", basis.error().sentence().c_str());
    return 3;
  }
  std::ostringstream out;
  out << "# Directions for one to three photographs\n\n"
         "Made by `packaging/directions` from the built-in basis; `patina-cli plan` searches others. Angles "
         "in "
         "degrees. Half-angle coordinates are those\n"
         "of the sample's centre; camera and light are given by their angle from the normal and their "
         "azimuth, the "
         "camera's being 0 unless it is shared. The field\n"
         "of view is the angle that a disc of the sample subtends from straight above; the light is "
         "distant.\n\n"
         "Errors are RMS in natural-log units (in brackets what that means in per cent) over directions of "
         "the whole "
         "grid, or within 81 degrees of the normal\n"
         "where the heading says so: *training* of the basis' own 100 materials (the paper's equation 15), "
         "*left out* "
         "the mean over materials that are each left\n"
         "out of the basis, *worst tenth* their 90th percentile, *1.5° off* the training error with camera "
         "and light "
         "misplaced by 1.5 degrees. 300\n"
         "points a photograph. Seed 0; a processor with other vector instructions rounds differently "
         "and may "
         "end in a neighbouring optimum.\n";
  const char* section = "";
  for (const Case& item : cases(restarts)) {
    PlanOptions chosen = item.options;
    chosen.candidates = candidates;
    std::fprintf(stderr, "%s, %g degrees, %d ...", item.name, chosen.fovDeg, chosen.shots);
    const Result<Plan> plan = planDirections(*basis, chosen, job);
    if (!plan) {
      std::fprintf(stderr, "%s\n", plan.error().sentence().c_str());
      return 1;
    }
    std::fprintf(stderr, " %.3f, %.1f s\n", plan->expected.training, plan->seconds);
    if (std::string_view(section) != item.name) {
      section = item.name;
      out << "\n## " << section << "\n\n"
          << "| field of view | photographs | (θh, θd, φd) | camera | light | training | left out | worst "
             "tenth | "
             "1.5° off | condition number |\n"
             "| ---: | ---: | --- | --- | --- | ---: | ---: | ---: | ---: | ---: |\n";
    }
    writeCase(out, *plan);
  }
  const Status written = writeFileAtomically(path, out.str());
  if (!written) std::fprintf(stderr, "%s\n", written.error().sentence().c_str());
  return written ? 0 : 3;
}

}  // namespace
}  // namespace patina::test

int main(int argc, char** argv) {
  return patina::test::run(argc, argv);
}
