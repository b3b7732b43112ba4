#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <numbers>
#include <numeric>

#include "engine/twoshot/plan.h"

namespace patina {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

constexpr double kWidth = 960, kPanelHeight = 300, kHeaderHeight = 98;
constexpr double kReach = 150;  // of camera and light from the sample's centre, in the drawing
constexpr const char* kCamera = "#1b5e9e";
constexpr const char* kLight = "#b8650a";
constexpr const char* kInk = "#222222";
constexpr const char* kFaint = "#9a9a9a";
constexpr const char* kSample = "#6b6b6b";

std::string text(const char* format, ...) __attribute__((format(printf, 1, 2)));
std::string text(const char* format, ...) {
  char buffer[600];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(buffer, sizeof buffer, format, arguments);
  va_end(arguments);
  return buffer;
}

/// The words in lines that fit the drawing.
std::vector<std::string> wrapped(const std::string& words) {
  constexpr std::size_t kMostBytes = 124;  // of 13 px type in the drawing's width
  std::vector<std::string> lines(1);
  for (std::size_t at = 0; at < words.size();) {
    const std::size_t end = std::min(words.find(' ', at), words.size());
    if (!lines.back().empty() && lines.back().size() + 1 + end - at > kMostBytes) lines.emplace_back();
    if (!lines.back().empty()) lines.back() += ' ';
    lines.back() += words.substr(at, end - at);
    at = end + 1;
  }
  return lines;
}

std::string escaped(const std::string& words) {
  std::string out;
  for (const char c : words) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (static_cast<unsigned char>(c) >= 32 || c == '\t')
      out += c;
  }
  return out;
}

struct At {
  double x, y;
};

std::string line(At a, At b, const char* colour, double width, const char* extra = "") {
  return text(
      "<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" stroke-width=\"%.1f\" %s/>\n", a.x,
      a.y, b.x, b.y, colour, width, extra);
}

std::string label(At at, const std::string& words, const char* colour, double size,
                  const char* anchor = "start", const char* extra = "") {
  return text("<text x=\"%.1f\" y=\"%.1f\" fill=\"%s\" font-size=\"%.0f\" text-anchor=\"%s\" %s>", at.x, at.y,
              colour, size, anchor, extra) +
         escaped(words) + "</text>\n";
}

/// A camera at `at` whose lens points along `towardsDeg` (of the screen, clockwise from +x).
std::string cameraIcon(At at, double towardsDeg) {
  return text("<g transform=\"translate(%.1f %.1f) rotate(%.1f)\">", at.x, at.y, towardsDeg) +
         text("<rect x=\"-15\" y=\"-10\" width=\"20\" height=\"20\" rx=\"3\" fill=\"%s\"/>", kCamera) +
         text("<path d=\"M5,-5 L13,-8 L13,8 L5,5 Z\" fill=\"%s\"/></g>\n", kCamera);
}

std::string lightIcon(At at) {
  std::string icon = text("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"8\" fill=\"%s\"/>", at.x, at.y, kLight);
  for (int i = 0; i < 8; ++i) {
    const double a = i * std::numbers::pi / 4;
    icon += line({at.x + 11 * std::cos(a), at.y + 11 * std::sin(a)},
                 {at.x + 16 * std::cos(a), at.y + 16 * std::sin(a)}, kLight, 2);
  }
  return icon;
}

double thetaDeg(const Eigen::Vector3d& to) {
  return std::acos(std::clamp(to.z(), -1.0, 1.0)) * kDegrees;
}
double azimuthDeg(const Eigen::Vector3d& to) {
  // Straight above there is no azimuth; rounding must not invent one, nor a "-0.0".
  const double azimuth = std::hypot(to.x(), to.y()) < 1e-9 ? 0 : std::atan2(to.y(), to.x()) * kDegrees;
  return std::abs(azimuth) < 0.05 ? 0 : azimuth;
}

/// Camera and light each turned into the plane of the drawing: the light on the camera's side where its
/// azimuth is within a quarter turn of the camera's.
std::string sideView(const ShotDirections& shot, double fovDeg, At centre) {
  const double between = std::remainder(azimuthDeg(shot.toLight) - azimuthDeg(shot.toCamera), 360);
  const double cameraSide = 1, lightSide = std::abs(between) <= 90 ? 1 : -1;
  const double cameraTheta = thetaDeg(shot.toCamera) / kDegrees,
               lightTheta = thetaDeg(shot.toLight) / kDegrees;
  const auto place = [&](double theta, double side, double reach) {
    return At{centre.x + side * reach * std::sin(theta), centre.y - reach * std::cos(theta)};
  };
  std::string out =
      label({centre.x, centre.y + 44}, "from the side: angles from the normal", kInk, 13, "middle");
  out += text(
      "<path d=\"M%.1f,%.1f A%.0f,%.0f 0 0 1 %.1f,%.1f\" fill=\"none\" stroke=\"%s\" stroke-width=\"1\"/>\n",
      centre.x - kReach, centre.y, kReach, kReach, centre.x + kReach, centre.y, "#d8d8d8");
  for (int tick = -60; tick <= 60; tick += 30) {
    const double t = tick / kDegrees;
    out += line(place(std::abs(t), tick < 0 ? -1 : 1, kReach - 4),
                place(std::abs(t), tick < 0 ? -1 : 1, kReach + 4), kFaint, 1);
  }
  out += line(centre, {centre.x, centre.y - kReach - 14}, kFaint, 1, "stroke-dasharray=\"5 4\"");
  // Left of the normal, where no icon is in its way.
  if (lightSide > 0 || lightTheta * kDegrees > 22)
    out += label({centre.x - 4, centre.y - kReach + 14}, "normal", kFaint, 11, "end");

  const double radius = kReach * std::tan(fovDeg / kDegrees / 2);
  const At camera = place(cameraTheta, cameraSide, kReach), light = place(lightTheta, lightSide, kReach);
  if (radius > 0)
    out += text("<path d=\"M%.1f,%.1f L%.1f,%.1f L%.1f,%.1f Z\" fill=\"%s\" fill-opacity=\"0.12\"/>\n",
                camera.x, camera.y, centre.x - radius, centre.y, centre.x + radius, centre.y, kCamera);
  out += line(camera, centre, kCamera, 1.6);
  out += line(light, centre, kLight, 1.6);
  // A distant light's rays are parallel.
  const At far = place(lightTheta, lightSide, kReach);
  for (const double shift : {-0.7 * radius, 0.7 * radius})
    if (radius > 0)
      out +=
          line({far.x + shift, far.y}, {centre.x + shift, centre.y}, kLight, 0.7, "stroke-opacity=\"0.6\"");
  const double half = std::max(radius, 6.0);
  out += line({centre.x - kReach - 12, centre.y + 6}, {centre.x + kReach + 12, centre.y + 6}, "#cccccc", 1);
  out += text("<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"6\" fill=\"%s\"/>\n", centre.x - half,
              centre.y, 2 * half, kSample);
  const auto arc = [&](double theta, double side, double r, const char* colour) {
    if (theta * kDegrees < 1) return std::string();
    const At from{centre.x, centre.y - r}, to = place(theta, side, r);
    return text("<path d=\"M%.1f,%.1f A%.1f,%.1f 0 0 %d %.1f,%.1f\" fill=\"none\" stroke=\"%s\"/>\n", from.x,
                from.y, r, r, side > 0 ? 1 : 0, to.x, to.y, colour);
  };
  // Different radii, so that two angles on one side can be told apart.
  const bool oneSide = cameraSide == lightSide;
  out += arc(cameraTheta, cameraSide, 52, kCamera) + arc(lightTheta, lightSide, oneSide ? 78 : 52, kLight);
  const auto angleText = [&](double theta, double side, double r, const char* colour) {
    const At at = place(theta, side, r);
    return label({at.x, at.y + 4}, text("%.1f°", theta * kDegrees), colour, 12, "middle",
                 "paint-order=\"stroke\" stroke=\"white\" stroke-width=\"4\"");
  };
  // Beyond the icons, further out where the two would meet.
  const bool meet = oneSide && std::abs(cameraTheta - lightTheta) * kDegrees < 14;
  out += angleText(cameraTheta, cameraSide, kReach + 29, kCamera) +
         angleText(lightTheta, lightSide, kReach + (meet ? 48 : 29), kLight);
  out += lightIcon(light);
  out += cameraIcon(camera, std::atan2(centre.y - camera.y, centre.x - camera.x) * kDegrees);
  return out;
}

std::string topView(const ShotDirections& shot, double fovDeg, At centre) {
  std::string out = label({centre.x, centre.y + 134}, "from above: azimuths", kInk, 13, "middle");
  constexpr double kRadius = 110;
  for (const double ring : {30.0, 60.0, 90.0}) {
    const double r = kRadius * std::sin(ring / kDegrees);
    out += text("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" fill=\"none\" stroke=\"#d8d8d8\"/>\n", centre.x,
                centre.y, r);
    if (ring < 90) out += label({centre.x + 3, centre.y + r - 3}, text("%.0f°", ring), kFaint, 10);
  }
  out += line(centre, {centre.x + kRadius + 10, centre.y}, kFaint, 1, "stroke-dasharray=\"5 4\"");
  out += label({centre.x + kRadius + 13, centre.y + 4}, "0°", kFaint, 11);
  out += label({centre.x, centre.y - kRadius - 6}, "90°", kFaint, 11, "middle");
  out += label({centre.x - kRadius - 6, centre.y + 4}, "180°", kFaint, 11, "end");
  const double radius = std::max(3.0, kRadius * std::tan(fovDeg / kDegrees / 2));
  out += text("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" fill=\"%s\" fill-opacity=\"0.45\"/>\n", centre.x,
              centre.y, radius, kSample);
  const auto place = [&](const Eigen::Vector3d& to) {
    return At{centre.x + kRadius * to.x(), centre.y - kRadius * to.y()};
  };
  const At camera = place(shot.toCamera), light = place(shot.toLight);
  out += line(centre, camera, kCamera, 1.6) + line(centre, light, kLight, 1.6);
  out += lightIcon(light);
  const double facing = std::hypot(camera.x - centre.x, camera.y - centre.y) < 1
                            ? 180
                            : std::atan2(centre.y - camera.y, centre.x - camera.x) * kDegrees;
  out += cameraIcon(camera, facing);
  return out;
}

std::string angles(const char* what, const Eigen::Vector3d& to) {
  return text("%s: %.1f° from the normal, azimuth %.1f°", what, thetaDeg(to), azimuthDeg(to));
}

std::string panel(const Plan& plan, std::size_t index, double top) {
  const PlannedShot& shot = plan.shots[index];
  const double fov = plan.options.fovDeg;
  std::string out = line({20, top}, {kWidth - 20, top}, "#dddddd", 1);
  out += sideView(shot.directions, fov, {195, top + 226});
  out += topView(shot.directions, fov, {515, top + 136});
  const double left = 690;
  double y = top + 46;
  const auto say = [&](const std::string& words, const char* colour, double size, double advance,
                       const char* extra = "") {
    out += label({left, y}, words, colour, size, "start", extra);
    y += advance;
  };
  const bool given = index < plan.options.given.size();
  say(text("Photograph %zu%s", index + 1, given ? " (given)" : ""), kInk, 17, 28, "font-weight=\"bold\"");
  for (const auto& [what, colour, to] : {std::tuple{"Camera", kCamera, &shot.directions.toCamera},
                                         {"Light", kLight, &shot.directions.toLight}}) {
    say(what, colour, 14, 19, "font-weight=\"bold\"");
    say(text("%.1f° from the normal", thetaDeg(*to)), kInk, 14, 18);
    say(text("azimuth %.1f°", azimuthDeg(*to)), kInk, 14, 18);
    say(text("height %.3f, aside %.3f × distance", to->z(), std::hypot(to->x(), to->y())), kFaint, 12, 25);
  }
  say("Half-angle coordinates", kInk, 14, 19, "font-weight=\"bold\"");
  say(text("θh %.1f°   θd %.1f°   φd %.1f°", shot.angles.thetaHRad * kDegrees,
           shot.angles.thetaDRad * kDegrees, shot.angles.phiDRad * kDegrees),
      kInk, 14, 18);
  out +=
      "<title>" +
      escaped(angles("Camera", shot.directions.toCamera) + "; " + angles("light", shot.directions.toLight)) +
      "</title>\n";
  return "<g>\n" + out + "</g>\n";
}

}  // namespace

double percentFromLn(double lnUnits) {
  return 100 * std::expm1(lnUnits);
}

std::vector<std::string> planRemarks(const Plan& plan) {
  std::vector<std::string> remarks;
  const ExpectedError& expected = plan.expected;
  const bool leftOut = !expected.unseenMaterial.empty();
  if (leftOut)
    remarks.push_back(
        text("Expected error of a material that the basis doesn't hold: %.3f in natural-log units, "
             "about %.0f %%; of the worst tenth %.3f or more, about %.0f %%.",
             expected.unseen, percentFromLn(expected.unseen), expected.unseenWorstTenth,
             percentFromLn(expected.unseenWorstTenth)));
  remarks.push_back(
      text("Of the basis' own materials: %.3f, about %.0f %%; nothing measured would leave %.2f.",
           expected.training, percentFromLn(expected.training), expected.prior));
  if (leftOut && plan.materials.size() == expected.unseenMaterial.size() && plan.materials.size() >= 10) {
    std::vector<std::size_t> order(plan.materials.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) {
      return expected.unseenMaterial[a] > expected.unseenMaterial[b];
    });
    std::string hardest;
    for (std::size_t i = 0; i < 4; ++i)
      hardest +=
          (i ? ", " : "") + plan.materials[order[i]] + text(" %.2f", expected.unseenMaterial[order[i]]);
    remarks.push_back("Hardest to tell from these photographs: " + hardest + ".");
  }
  const double poseErrorDeg = plan.options.poseErrorDeg > 0 ? plan.options.poseErrorDeg : 1.5;
  if (plan.poseTolerant > 0)
    remarks.push_back(text("With camera and light off by %.3g degrees: %.3f instead of %.3f%s.", poseErrorDeg,
                           plan.poseTolerant, expected.training,
                           plan.poseTolerant > 1.1 * expected.training
                               ? "; set them up with care, or plan with a pose error"
                               : ""));
  for (std::size_t i = 0; i < plan.shots.size(); ++i) {
    const ShotDirections& shot = plan.shots[i].directions;
    const double apart = std::acos(std::clamp(shot.toLight.dot(shot.toCamera), -1.0, 1.0)) * kDegrees;
    // A camera some 50 mm across at 300 mm hides 10 degrees of the sky.
    constexpr double kInTheWayDeg = 10;
    if (apart < kInTheWayDeg)
      remarks.push_back(
          text("Photograph %zu: camera and light are only %.0f degrees apart; the camera may stand in "
               "the light.",
               i + 1, apart));
    if (plan.options.region == BasisRegion::All &&
        std::max(thetaDeg(shot.toCamera), thetaDeg(shot.toLight)) > kTrustedAngleDeg)
      remarks.push_back(
          text("Photograph %zu lies beyond %.0f degrees from the normal, where measured BRDFs are "
               "rarely to be trusted.",
               i + 1, kTrustedAngleDeg));
  }
  return remarks;
}

std::string drawPlanSvg(const Plan& plan) {
  std::vector<std::string> remarks;
  for (const std::string& remark : planRemarks(plan))
    for (std::string& words : wrapped(remark)) remarks.push_back(std::move(words));
  const double panels = kPanelHeight * static_cast<double>(plan.shots.size());
  const double height = kHeaderHeight + panels + 24 + 20 * static_cast<double>(remarks.size()) + 12;
  std::string out = text(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%.0f\" height=\"%.0f\" viewBox=\"0 0 %.0f %.0f\" "
      "font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\">\n",
      kWidth, height, kWidth, height);
  out += text("<rect width=\"%.0f\" height=\"%.0f\" fill=\"white\"/>\n", kWidth, height);
  const std::size_t count = plan.shots.size();
  const char* setup = plan.options.setup == PlanSetup::FixedCamera  ? ", one camera position"
                      : plan.options.setup == PlanSetup::FixedLight ? ", one light position"
                                                                    : "";
  const std::string view = plan.options.fovDeg > 0 ? text("field of view %.1f°", plan.options.fovDeg)
                                                   : std::string("point samples");
  out += label({24, 36}, text("%zu photograph%s, %s%s", count, count == 1 ? "" : "s", view.c_str(), setup),
               kInk, 21, "start", "font-weight=\"bold\"");
  out +=
      label({24, 60},
            "The camera looks at the sample's centre; the light is distant. Basis: " + plan.basisName + ".",
            kInk, 13);
  if (plan.options.fovDeg > 0)
    out += label({24, 79},
                 text("The sample is a disc with a radius of %.3f of the camera's distance.",
                      std::tan(plan.options.fovDeg / kDegrees / 2)),
                 kInk, 13);
  for (std::size_t i = 0; i < count; ++i)
    out += panel(plan, i, kHeaderHeight + kPanelHeight * static_cast<double>(i));
  double y = kHeaderHeight + panels + 24;
  out += line({20, y - 20}, {kWidth - 20, y - 20}, "#dddddd", 1);
  for (const std::string& remark : remarks) {
    out += label({24, y}, remark, kInk, 13);
    y += 20;
  }
  return out + "</svg>\n";
}

}  // namespace patina
