// The environments that ship, as formulas: radiance by direction, x right, y up, z to the eye.
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <mutex>
#include <numbers>

#include "engine/render/brdf_sphere.h"
#include "engine/render/environment.h"

namespace patina {
namespace {

using Eigen::Array3f;
using Eigen::Vector3f;

constexpr float kPi = std::numbers::pi_v<float>;

float smoothStep(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0f, 1.0f);
  return t * t * (3 - 2 * t);
}

Array3f mix(const Array3f& a, const Array3f& b, float t) {
  return a + (b - a) * t;
}

/// The grey studio of the fitted maps' sphere.
Array3f studio(const Vector3f& d) {
  return Array3f::Constant(studioRadiance(d));
}

/// What the ground sends up, given the irradiance on it over pi; darker towards the feet, where the object
/// and whoever holds it shade it.
Array3f ground(const Vector3f& d, const Array3f& albedo, float irradianceOverPi) {
  return albedo * irradianceOverPi * (1 - 0.45f * smoothStep(0.2f, 1.0f, -d.y()));
}

/// CIE's overcast sky: a third of the zenith's luminance at the horizon. Source: CIE S 011, type 16 (Moon and
/// Spencer). Its irradiance over pi is 7/9 of the zenith's luminance.
Array3f overcast(const Vector3f& d) {
  const Array3f sky = Array3f(0.94f, 1.0f, 1.07f) * ((1 + 2 * std::max(0.0f, d.y())) / 3);
  const Array3f below = ground(d, Array3f(0.21f, 0.2f, 0.18f), 7.0f / 9);
  return mix(below, sky, smoothStep(-0.015f, 0.015f, d.y()));
}

/// CIE's clear sky, luminance relative to an arbitrary unit. Source: CIE S 011 type 12 in Kittler's form;
/// gradation (1 - exp(-0.32 / sin h)), indicatrix 0.91 + 10 exp(-3 angle) + 0.45 cos^2 angle.
float clearSkyLuminance(const Vector3f& d, const Vector3f& toSun) {
  const float height = std::max(d.y(), 0.01f);  // the horizon itself would divide by zero
  const float cosine = std::clamp(d.dot(toSun), -1.0f, 1.0f), angle = std::acos(cosine);
  return (1 - std::exp(-0.32f / height)) * (0.91f + 10 * std::exp(-3 * angle) + 0.45f * cosine * cosine);
}

struct ClearSky {
  Vector3f toSun = Vector3f(-0.55f, 0.62f, 0.56f).normalized();
  float skyOverPi = 0;    ///< irradiance of the sky alone on a plane that faces up, over pi
  float sunRadiance = 0;  ///< of the disc
  static constexpr float kSunRadiusRad =
      kPi / 180;                         ///< a hazy sun: twice as wide as ours, so that it is a disc
  static constexpr float kSunToSky = 4;  ///< irradiance on a plane that faces up

  ClearSky() {
    constexpr int kRings = 96, kTurns = 192;
    for (int i = 0; i < kRings; ++i)
      for (int j = 0; j < kTurns; ++j) {
        const float y = (static_cast<float>(i) + 0.5f) / kRings, r = std::sqrt(1 - y * y);
        const float turn = (static_cast<float>(j) + 0.5f) * 2 * kPi / kTurns;
        skyOverPi +=
            y * clearSkyLuminance({r * std::cos(turn), y, r * std::sin(turn)}, toSun) * 2 / (kRings * kTurns);
      }
    const float solidAngle = 2 * kPi * (1 - std::cos(kSunRadiusRad));
    sunRadiance = kSunToSky * skyOverPi * kPi / (solidAngle * toSun.y());
  }
};

Array3f clearSky(const Vector3f& d) {
  static const ClearSky scene;
  const float cosine = std::clamp(d.dot(scene.toSun), -1.0f, 1.0f), angle = std::acos(cosine);
  const float height = std::max(0.0f, d.y());
  // Colours by eye, after photographs: pale at the horizon and round the sun, deep at a right angle to it.
  Array3f tint =
      mix(Array3f(0.86f, 0.99f, 1.22f), Array3f(0.46f, 0.92f, 2.35f), smoothStep(0.0f, 0.75f, height));
  tint = mix(tint, Array3f(1.0f, 1.0f, 0.98f), 0.8f * std::exp(-5 * angle));
  tint /= 0.2126f * tint[0] + 0.7152f * tint[1] + 0.0722f * tint[2];
  Array3f sky = tint * clearSkyLuminance(d, scene.toSun);
  const float disc = 1 - smoothStep(0.85f * ClearSky::kSunRadiusRad, 1.15f * ClearSky::kSunRadiusRad, angle);
  sky += Array3f(1.06f, 1.0f, 0.86f) * (scene.sunRadiance * disc);
  const Array3f below = ground(d, Array3f(0.2f, 0.18f, 0.12f), (1 + ClearSky::kSunToSky) * scene.skyOverPi);
  return mix(below, sky, smoothStep(-0.012f, 0.012f, d.y()));
}

/// A room, 6 m wide, 3 m high, 7 m deep, the object 1.2 m over the floor; one large window in the left wall.
Array3f roomWithWindow(const Vector3f& d) {
  const Array3f low(-2.4f, -1.2f, -3.5f), high(3.6f, 1.8f, 3.5f);
  float distance = 1e9f;
  int wall = 0;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(d[axis]) < 1e-6f) continue;
    const float t = (d[axis] > 0 ? high[axis] : low[axis]) / d[axis];
    if (t > 0 && t < distance) {
      distance = t;
      wall = 2 * axis + (d[axis] > 0);
    }
  }
  const Vector3f point = distance * d;
  // The window: two sashes with bars, in front of a bright grey sky and a darker street below it.
  const Vector3f centre(low[0], 0.35f, 0.9f);
  constexpr float kHalfWide = 1.05f, kHalfHigh = 0.95f, kFrame = 0.05f;
  if (wall == 0) {
    const float z = point.z() - centre.z(), y = point.y() - centre.y();
    if (std::abs(z) < kHalfWide && std::abs(y) < kHalfHigh) {
      const float bars = std::min({std::abs(z), std::abs(std::abs(z) - kHalfWide),
                                   std::abs(std::abs(y) - kHalfHigh), std::abs(y - 0.3f)});
      const float glass = smoothStep(kFrame - 0.012f, kFrame + 0.012f, bars);
      const Array3f outside =
          mix(Array3f(7.0f, 7.4f, 6.6f), Array3f(24.0f, 27.0f, 32.0f), smoothStep(-0.12f, 0.02f, d.y()));
      return mix(Array3f(0.55f, 0.53f, 0.5f), outside, glass);
    }
  }
  static const std::array<Array3f, 6> kPaint{Array3f(0.62f, 0.6f, 0.56f), Array3f(0.55f, 0.58f, 0.55f),
                                             Array3f(0.3f, 0.2f, 0.12f),  Array3f(0.8f, 0.79f, 0.76f),
                                             Array3f(0.6f, 0.56f, 0.5f),  Array3f(0.62f, 0.6f, 0.56f)};
  Array3f paint = kPaint[static_cast<std::size_t>(wall)];
  if (wall == 2) {  // boards along the room
    const float board = std::floor((point.x() + 10) / 0.14f);
    paint *= 0.85f + 0.3f * std::abs(std::sin(board * 12.9898f));
  }
  if (wall == 4 && std::abs(point.x() - 1.6f) < 0.45f && point.y() < 0.85f)
    paint = Array3f(0.22f, 0.13f, 0.08f);  // a door behind the object
  if (wall == 1 && std::abs(point.z()) < 0.8f && std::abs(point.y() - 0.4f) < 0.5f)
    paint = Array3f(0.5f, 0.22f, 0.14f);  // a picture on the right wall
  // The window's light by its centre (8 m^2 sr of it at most), and what the walls throw at each other.
  static const std::array<Vector3f, 6> kInward{Vector3f(1, 0, 0),  Vector3f(-1, 0, 0), Vector3f(0, 1, 0),
                                               Vector3f(0, -1, 0), Vector3f(0, 0, 1),  Vector3f(0, 0, -1)};
  const Vector3f away = centre - point;
  const float squared =
      away.squaredNorm() + 0.5f;  // the window is no point: nothing gets brighter than beside it
  const float facing = std::max(0.0f, kInward[static_cast<std::size_t>(wall)].dot(away)) / std::sqrt(squared);
  const float sends = std::abs(away.x()) / std::sqrt(squared);
  return paint * (24.0f * 4 * kHalfWide * kHalfHigh / kPi * facing * sends / squared + 0.45f);
}

/// Three strips and a small lamp in a dark room: what a highlight looks like, without anything else.
Array3f strips(const Vector3f& d) {
  float light = 0.01f;
  const auto strip = [&](float azimuthRad, float halfWidthRad, float lowest, float highest, float radiance) {
    const float turn = std::remainder(std::atan2(d.x(), d.z()) - azimuthRad, 2 * kPi);
    const float across = std::abs(turn) * std::sqrt(1 - d.y() * d.y());
    light += radiance * (1 - smoothStep(halfWidthRad - 0.006f, halfWidthRad + 0.006f, across)) *
             smoothStep(lowest - 0.01f, lowest + 0.01f, d.y()) *
             (1 - smoothStep(highest - 0.01f, highest + 0.01f, d.y()));
  };
  strip(-1.15f, 0.075f, -0.55f, 0.8f, 14);
  strip(0.45f, 0.022f, -0.6f, 0.75f, 22);
  strip(1.9f, 0.09f, -0.6f, 0.7f, 9);
  const Vector3f lamp = Vector3f(-0.25f, 0.8f, 0.55f).normalized();
  const float angle = std::acos(std::clamp(d.dot(lamp), -1.0f, 1.0f));
  light += 60 * (1 - smoothStep(0.05f, 0.06f, angle));
  return Array3f::Constant(light);
}

Array3f white(const Vector3f&) {
  return Array3f::Constant(1);
}

struct Scene {
  EnvironmentEntry entry;
  Array3f (*radiance)(const Vector3f&);
};
const std::array<Scene, 6>& scenes() {
  static const std::array<Scene, 6> all{{
      {{"studio", "Studio", "A grey room with two soft boxes, as a photographer lights a product"}, studio},
      {{"window", "Room with a window",
        "Daylight from one side, with a picture of the window in every gloss"},
       roomWithWindow},
      {{"overcast", "Overcast sky", "Soft light from above, without highlights of its own"}, overcast},
      {{"clear", "Clear sky and sun", "A small, very bright sun and a blue sky over the ground"}, clearSky},
      {{"strips", "Light strips", "Narrow lights in the dark: the highlight's shape and its haze"}, strips},
      {{"white", "Even white",
        "The same light from everywhere: a sphere shows its albedo, brighter or darker to the rim"},
       white},
  }};
  return all;
}

}  // namespace

const std::vector<EnvironmentEntry>& builtInEnvironments() {
  static const std::vector<EnvironmentEntry> entries = [] {
    std::vector<EnvironmentEntry> list;
    for (const Scene& scene : scenes()) list.push_back(scene.entry);
    return list;
  }();
  return entries;
}

EnvironmentPtr builtInEnvironment(const std::string& id) {
  static std::mutex mutex;
  static std::map<std::string, EnvironmentPtr> made;
  const std::scoped_lock lock(mutex);
  if (const auto found = made.find(id); found != made.end()) return found->second;
  for (const Scene& scene : scenes()) {
    if (scene.entry.id != id) continue;
    Image picture(Environment::kWidth, Environment::kHeight, 3);
    // No tasks of others inside, which might ask for an environment while this thread holds the lock.
    tbb::this_task_arena::isolate([&] {
      tbb::parallel_for(0, picture.height(), [&](int y) {
        const float fromUp = (static_cast<float>(y) + 0.5f) / static_cast<float>(picture.height()) * kPi;
        for (int x = 0; x < picture.width(); ++x) {
          const float turn =
              ((static_cast<float>(x) + 0.5f) / static_cast<float>(picture.width()) - 0.5f) * 2 * kPi;
          const Array3f light = scene.radiance(Vector3f(std::sin(fromUp) * std::sin(turn), std::cos(fromUp),
                                                        -std::sin(fromUp) * std::cos(turn)));
          for (int c = 0; c < 3; ++c) picture.at(x, y, c) = light[c];
        }
      });
    });
    EnvironmentPtr environment = tbb::this_task_arena::isolate(
        [&] { return std::make_shared<const Environment>(id, scene.entry.name, picture); });
    made.emplace(id, environment);
    return environment;
  }
  return nullptr;
}

}  // namespace patina
