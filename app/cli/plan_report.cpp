#include "app/cli/plan_report.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace patina::cli {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

template <typename... Values>
std::string formatted(const char* format, Values... values) {
  char buffer[512];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

double angleDeg(const Eigen::Vector3d& to) {
  return std::acos(std::clamp(to.z(), -1.0, 1.0)) * kDegrees;
}

double azimuthDeg(const Eigen::Vector3d& to) {
  const double azimuth = std::hypot(to.x(), to.y()) < 1e-9 ? 0 : std::atan2(to.y(), to.x()) * kDegrees;
  return std::abs(azimuth) < 0.05 ? 0 : azimuth;  // no "-0.0"
}

}  // namespace

std::string lnAndPercent(double lnUnits) {
  return formatted("%.3f (%.0f %%)", lnUnits, percentFromLn(lnUnits));
}

std::string problemsOf(const PlanOptions& options) {
  std::string sentence;
  for (const std::string& problem : options.validate()) sentence += (sentence.empty() ? "" : "; ") + problem;
  return sentence;
}

void printPlan(const Plan& plan, Context& context) {
  context.console.say(
      " photograph   theta_h theta_d   phi_d |  camera: from normal, azimuth |   light: from normal, azimuth "
      "|  "
      "error so far");
  for (std::size_t i = 0; i < plan.shots.size(); ++i) {
    const PlannedShot& shot = plan.shots[i];
    const bool given = i < plan.options.given.size();
    context.console.say(formatted(
        " %2zu%-10s %7.1f %7.1f %7.1f |          %8.1f  %8.1f   |          %8.1f  %8.1f   |  %.3f", i + 1,
        given ? " (given)" : "", shot.angles.thetaHRad * kDegrees, shot.angles.thetaDRad * kDegrees,
        shot.angles.phiDRad * kDegrees, angleDeg(shot.directions.toCamera),
        azimuthDeg(shot.directions.toCamera), angleDeg(shot.directions.toLight),
        azimuthDeg(shot.directions.toLight), i < plan.errorAfterShot.size() ? plan.errorAfterShot[i] : 0.0));
  }
  context.console.say(
      " (degrees; error so far: of the basis' own materials with the photographs up to this one, natural-log "
      "units)");
  const ExpectedError& expected = plan.expected;
  context.console.say("Expected error, natural-log units (relative), over " +
                      std::string(plan.options.region == BasisRegion::Trusted
                                      ? "directions within 81 degrees of the normal"
                                      : "all directions") +
                      ":");
  if (!expected.unseenMaterial.empty())
    context.console.say("  a material that the basis doesn't hold: mean " + lnAndPercent(expected.unseen) +
                        ", median " + lnAndPercent(expected.unseenMedian) + ", worst tenth above " +
                        lnAndPercent(expected.unseenWorstTenth));
  context.console.say("  the basis' own materials:               mean " + lnAndPercent(expected.training) +
                      formatted("; with nothing measured %.2f", expected.prior));
  context.console.say(formatted("  condition number %.4g", plan.conditionNumber));
  for (const std::string& remark : planRemarks(plan))
    if (!remark.starts_with("Expected error of") && !remark.starts_with("Of the basis'"))
      context.console.say(remark);
}

std::optional<MorePhotographs> oneMore(const BasisPtr& basis, const Plan& plan, const JobContext& job) {
  PlanOptions options = plan.options;
  options.given.clear();
  for (const PlannedShot& shot : plan.shots) options.given.push_back(shot.directions);
  options.shots = 1;
  // A hint, not the plan: a quarter of the candidates finds it within a few hundredths.
  options.candidates = std::min(options.candidates, 125);
  options.restarts = 2;
  options.poseErrorDeg = 0;
  if (!problemsOf(options).empty()) return std::nullopt;
  JobContext quiet = job;
  quiet.progressSink = nullptr;
  Result<Plan> found = planDirections(basis, options, quiet);
  if (!found || found->cancelled) return std::nullopt;
  MorePhotographs more;
  more.shot = found->shots.back();
  more.with = std::move(*found);
  return more;
}

void printOneMore(const Plan& plan, const MorePhotographs& more, Context& context) {
  const ExpectedError &before = plan.expected, &after = more.with.expected;
  const HalfDiffAngles& angles = more.shot.angles;
  context.console.say(
      formatted("One more photograph, at (%.0f, %.0f, %.0f), would lower the expected error of an "
                "unseen material from %.3f to %.3f, and of the worst tenth from %.3f to %.3f.",
                angles.thetaHRad * kDegrees, angles.thetaDRad * kDegrees, angles.phiDRad * kDegrees,
                before.unseen, after.unseen, before.unseenWorstTenth, after.unseenWorstTenth));
  const std::size_t count = plan.materials.size();
  if (count < 10 || before.unseenMaterial.size() != count || after.unseenMaterial.size() != count) return;
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto gain = [&](std::size_t i) { return before.unseenMaterial[i] - after.unseenMaterial[i]; };
  std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) { return gain(a) > gain(b); });
  std::string names;
  for (std::size_t i = 0; i < 4; ++i)
    names += (i ? ", " : "") + plan.materials[order[i]] +
             formatted(" %.2f to %.2f", before.unseenMaterial[order[i]], after.unseenMaterial[order[i]]);
  // A tenth less of the worst tenth's error: about what the choice of directions itself is worth.
  const bool worth = after.unseenWorstTenth < 0.9 * before.unseenWorstTenth;
  context.console.say(std::string(worth ? "It is worth taking for materials like those that gain most: "
                                        : "It changes little; most for: ") +
                      names + ". Plan it with --given.");
}

}  // namespace patina::cli
