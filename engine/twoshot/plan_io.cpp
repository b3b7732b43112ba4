#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/capture/json_reader.h"
#include "engine/twoshot/plan.h"

namespace patina {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr const char* kFormat = "patina-plan";
constexpr std::uint64_t kMostBytes = std::uint64_t{16} << 20;  // a hundred times the largest plan
constexpr double kHuge = 1e12;                                 // beyond any figure of a plan

const char* nameOf(PlanSetup setup) {
  return setup == PlanSetup::FixedCamera  ? "fixed-camera"
         : setup == PlanSetup::FixedLight ? "fixed-light"
                                          : "free";
}
const char* nameOf(PlanMetric metric) {
  return metric == PlanMetric::ConditionNumber ? "condition-number" : "expected-error";
}
const char* nameOf(BasisRegion region) {
  return region == BasisRegion::Trusted ? "trusted" : "all";
}

Json vectorJson(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

/// Angles for the person beside the direction that counts.
Json directionJson(const Eigen::Vector3d& to) {
  return {{"angle_deg", std::acos(std::clamp(to.z(), -1.0, 1.0)) * kDegrees},
          {"azimuth_deg", std::atan2(to.y(), to.x()) * kDegrees},
          {"direction", vectorJson(to)}};
}

Json shotJson(const PlannedShot& shot, bool given) {
  Json json = {{"half_angle",
                {{"theta_h_deg", shot.angles.thetaHRad * kDegrees},
                 {"theta_d_deg", shot.angles.thetaDRad * kDegrees},
                 {"phi_d_deg", shot.angles.phiDRad * kDegrees}}},
               {"camera", directionJson(shot.directions.toCamera)},
               {"light", directionJson(shot.directions.toLight)}};
  if (given) json["given"] = true;
  return json;
}

/// One of a few words.
template <typename Value>
Value choice(JsonObject& object, const std::string& key, std::initializer_list<Value> values) {
  const std::string text = object.text(key);
  std::string known;
  for (const Value value : values) {
    if (text == nameOf(value)) return value;
    known += (known.empty() ? "" : ", ") + std::string(nameOf(value));
  }
  object.fail(ErrorCode::Invalid, key, "it is none of the words that it can be", "use one of: " + known);
}

Eigen::Vector3d directionFrom(JsonObject& shot, const std::string& key) {
  JsonObject object = shot.object(key);
  const std::vector<double> xyz = object.numbers("direction", 3, -2, 2);
  const Eigen::Vector3d to(xyz[0], xyz[1], xyz[2]);
  // 1e-4: what somebody who types four digits misses of unit length; then made exactly unit.
  if (std::abs(to.norm() - 1) > 1e-4)
    object.fail(ErrorCode::Invalid, "direction", "a direction must be a unit vector",
                "divide it by its length, " + std::to_string(to.norm()));
  if (to.z() <= 0)
    object.fail(ErrorCode::Invalid, "direction", "it points below the sample", "give a positive z");
  return to.normalized();
}

std::vector<double> numberList(JsonObject& object, const std::string& key, std::size_t most) {
  std::vector<double> values;
  const nlohmann::json& list = object.list(key, 0, most);
  for (const nlohmann::json& value : list) {
    if (!value.is_number()) object.fail(ErrorCode::Malformed, key, "a list of numbers is needed");
    values.push_back(value.get<double>());
  }
  return values;
}

Plan planFrom(const nlohmann::json& json, const std::string& where) {
  constexpr std::size_t kMostShots = 60, kMostMaterials = 100000;
  JsonObject root(json, where, "");
  if (root.text("format") != kFormat)
    root.fail(ErrorCode::Malformed, "format", "this is not a plan", "name a plan.json of patina-cli plan");
  if (root.integer("version", 1, std::numeric_limits<int>::max()) != 1)
    root.fail(ErrorCode::Unsupported, "version", "this version reads plans of version 1",
              "use a later version of Patina");
  Plan plan;
  PlanOptions& options = plan.options;
  JsonObject o = root.object("options");
  options.shots = o.integer("shots", 0, 60);
  options.fovDeg = o.number("fov_deg", 0, 180);
  options.setup = choice(o, "setup", {PlanSetup::Free, PlanSetup::FixedCamera, PlanSetup::FixedLight});
  options.metric = choice(o, "metric", {PlanMetric::ExpectedError, PlanMetric::ConditionNumber});
  options.region = choice(o, "region", {BasisRegion::All, BasisRegion::Trusted});
  options.eta = o.number("eta", 1e-12, kHuge);
  options.candidates = o.integer("candidates", 1, 1000000);
  options.pointsPerShot = o.integer("points_per_shot", 1, 1000000);
  options.restarts = o.integer("restarts", 1, 1000000);
  options.poseErrorDeg = o.number("pose_error_deg", 0, 90);
  options.maxAngleDeg = o.number("max_angle_deg", 0, 90);

  const nlohmann::json& shots = root.list("shots", 1, kMostShots);
  for (std::size_t i = 0; i < shots.size(); ++i) {
    JsonObject shot(shots[i], where, "shots[" + std::to_string(i) + "]");
    PlannedShot planned;
    planned.directions.toCamera = directionFrom(shot, "camera");
    planned.directions.toLight = directionFrom(shot, "light");
    planned.angles = planned.directions.centre();
    if (shots[i].contains("given") && shots[i]["given"] == true) options.given.push_back(planned.directions);
    plan.shots.push_back(planned);
  }

  JsonObject e = root.object("expected");
  ExpectedError& expected = plan.expected;
  for (const auto& [key, value] : {std::pair{"training", &expected.training},
                                   {"noise", &expected.noise},
                                   {"prior", &expected.prior},
                                   {"posterior", &expected.posterior},
                                   {"unseen", &expected.unseen},
                                   {"unseen_median", &expected.unseenMedian},
                                   {"unseen_worst_tenth", &expected.unseenWorstTenth}})
    *value = e.number(key, 0, kHuge);
  expected.unseenMaterial = numberList(e, "unseen_by_material", kMostMaterials);
  for (const nlohmann::json& name : e.list("materials", 0, kMostMaterials)) {
    if (!name.is_string()) e.fail(ErrorCode::Malformed, "materials", "a list of names is needed");
    plan.materials.push_back(name.get<std::string>());
  }
  plan.poseTolerant = root.number("pose_tolerant", 0, kHuge);
  // JSON has no infinity: null stands for it.
  plan.conditionNumber = json.contains("condition_number") && json["condition_number"].is_null()
                             ? std::numeric_limits<double>::infinity()
                             : root.number("condition_number", 0, std::numeric_limits<double>::max());
  plan.errorAfterShot = numberList(root, "error_after_shot", kMostShots);
  plan.restartErrors = numberList(root, "restart_errors", 1000000);
  plan.basisName = root.text("basis");
  const double seed = root.number("seed", 0, 18446744073709551615.0, 0);
  plan.seed = json.contains("seed") && json["seed"].is_number_unsigned() ? json["seed"].get<std::uint64_t>()
                                                                         : static_cast<std::uint64_t>(seed);
  plan.seconds = root.number("seconds", 0, kHuge, 0);
  plan.cancelled = json.contains("cancelled") && json["cancelled"] == true;
  return plan;
}

}  // namespace

std::string planJson(const Plan& plan) {
  const PlanOptions& options = plan.options;
  Json json = {{"format", kFormat}, {"version", 1}};
  json["basis"] = plan.basisName;
  json["options"] = {{"shots", options.shots},
                     {"fov_deg", options.fovDeg},
                     {"setup", nameOf(options.setup)},
                     {"metric", nameOf(options.metric)},
                     {"region", nameOf(options.region)},
                     {"eta", options.eta},
                     {"candidates", options.candidates},
                     {"points_per_shot", options.pointsPerShot},
                     {"restarts", options.restarts},
                     {"pose_error_deg", options.poseErrorDeg},
                     {"max_angle_deg", options.maxAngleDeg}};
  json["shots"] = Json::array();
  for (std::size_t i = 0; i < plan.shots.size(); ++i)
    json["shots"].push_back(shotJson(plan.shots[i], i < options.given.size()));
  const ExpectedError& expected = plan.expected;
  json["expected"] = {{"training", expected.training},
                      {"unseen", expected.unseen},
                      {"unseen_median", expected.unseenMedian},
                      {"unseen_worst_tenth", expected.unseenWorstTenth},
                      {"prior", expected.prior},
                      {"posterior", expected.posterior},
                      {"noise", expected.noise},
                      {"unseen_by_material", expected.unseenMaterial},
                      {"materials", plan.materials}};
  json["pose_tolerant"] = plan.poseTolerant;
  if (std::isfinite(plan.conditionNumber))
    json["condition_number"] = plan.conditionNumber;
  else
    json["condition_number"] = nullptr;
  json["error_after_shot"] = plan.errorAfterShot;
  json["restart_errors"] = plan.restartErrors;
  json["seed"] = plan.seed;
  json["seconds"] = plan.seconds;
  json["cancelled"] = plan.cancelled;
  return json.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

Status writePlan(const std::filesystem::path& file, const Plan& plan) {
  return writeFileAtomically(file, planJson(plan));
}

Result<Plan> parsePlan(std::string_view text, const std::string& where) {
  try {
    return planFrom(parseJson(text, where), where);
  } catch (const JsonFault& fault) {
    return fault.error;
  }
}

Result<Plan> readPlan(const std::filesystem::path& file) {
  const Result<std::string> text = readFile(file, kMostBytes);
  if (!text) return text.error();
  return parsePlan(*text, file.string());
}

}  // namespace patina
