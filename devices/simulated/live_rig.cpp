#include "devices/simulated/live_rig.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "devices/simulated/live_rig_state.h"
#include "devices/simulated/photo_effects.h"
#include "devices/simulated/sheet_form.h"
#include "devices/simulated/shown_pattern.h"
#include "devices/simulated/simulated_rig.h"
#include "engine/acquire/pattern_image.h"

namespace patina {
namespace {

using Seconds = std::chrono::duration<double>;

constexpr int kDriftPhotos = 170;  ///< pictures over which the effects of time run their course
constexpr double kRiseEnds = 10;   ///< rise times after which a picture is wholly there
constexpr std::size_t kCached = 6, kRemembered = 8;

double seconds(std::chrono::nanoseconds time) {
  return Seconds(time).count();
}

/// Mean over start..end of 1 - exp(-(t - from) / rise), 0 before `from` and 1 from kRiseEnds rises on;
/// seconds.
double risen(double start, double end, double from, double rise) {
  const auto integral = [&](double t) {  // from `from` to t
    if (t <= 0) return 0.0;
    if (rise <= 0) return t;
    const double last = std::min(t, kRiseEnds * rise);
    return last - rise * (1 - std::exp(-last / rise)) + (t - last);
  };
  return (integral(end - from) - integral(start - from)) / (end - start);
}

}  // namespace

std::vector<std::string> LiveRigSetup::validate() const {
  std::vector<std::string> problems = sheet.validate();
  for (std::string& problem : effects.validate(static_cast<int>(sheet.materials.size())))
    problems.push_back(std::move(problem));
  const auto need = [&](bool good, const char* sentence) {
    if (!good) problems.emplace_back(sentence);
  };
  need(camera.width > 0 && camera.height > 0 && camera.width <= 2048 && camera.height <= 2048,
       "the camera must have 1 to 2048 pixels a side");
  need(screen.widthPx > 0 && screen.heightPx > 0 && screen.widthMm > 0 && screen.heightMm > 0,
       "the screen must have pixels and a size");
  need(noise.shot >= 0 && noise.read >= 0, "noise can't be negative");
  need(gamma >= 0.2 && gamma <= 5, "gamma must lie in 0.2 to 5");
  need(refreshHz >= 1 && refreshHz <= 1000, "refreshHz must lie in 1 to 1000");
  need(flickerDepth >= 0 && flickerDepth < 1, "flickerDepth must lie in 0 to 1, without 1");
  need(latencyMs >= 0 && riseMs >= 0 && readoutMs >= 0, "times can't be negative");
  need(fullScaleSecond >= 0 && ambient >= 0, "light can't be negative");
  need(pedestal >= 0 && pedestal < 0.5, "pedestal must lie in 0 to 0.5");
  need(leastExposureS > 0 && mostExposureS > leastExposureS && mostGain >= 1,
       "exposures must be positive and their range not empty, and mostGain at least 1");
  need(settleFrames >= 0 && settleFrames <= 30, "settleFrames must lie in 0 to 30");
  for (const BrdfPtr& brdf : brdfs) need(brdf != nullptr, "one of the sample's BRDFs is missing");
  return problems;
}

LiveRigSetup LiveRig::desk(const std::string& scene, int pixels, int screenPx) {
  LiveRigSetup setup;
  setup.name = scene;
  setup.sheet = simulatedScene(scene);
  const SimulatedRig rig = SimulatedRig::desk(pixels, setup.sheet.widthMm, setup.sheet.heightMm);
  setup.camera = rig.camera;
  setup.screen = rig.screen;
  setup.screen.widthPx = screenPx;
  setup.screen.heightPx = static_cast<int>(std::lround(screenPx / setup.screen.aspect()));
  return setup;
}

LiveRig::LiveRig(std::unique_ptr<State> state) : state_(std::move(state)) {}
LiveRig::~LiveRig() = default;

Result<std::shared_ptr<LiveRig>> LiveRig::create(const LiveRigSetup& setup) {
  if (const std::vector<std::string> problems = setup.validate(); !problems.empty()) {
    std::string all;
    for (const std::string& problem : problems) all += (all.empty() ? "" : "; ") + problem;
    return Error{ErrorCode::Invalid, "the simulated rig can't be built: " + all, setup.name,
                 "correct these values"};
  }
  auto state = std::make_unique<State>();
  state->setup = setup;
  const double gamma = setup.gamma * setup.effects.screenResponse.gamma;
  state->panel = ScreenResponse::gamma(gamma);
  // Any time will do, but none so near the clock's zero that subtracting would wrap.
  state->clock = RigTime(std::chrono::hours(1));
  LiveSceneSetup& scene = state->sceneSetup;
  scene.camera = setup.camera;
  scene.screen = trueScreen(setup.screen, setup.effects);
  scene.sheet = setup.sheet;
  scene.brdfs = setup.brdfs;
  scene.effects = setup.effects;
  state->fullScaleSecond = setup.fullScaleSecond;
  if (!(state->fullScaleSecond > 0)) {
    Result<LiveScene> made = LiveScene::create(scene, JobContext{});
    if (!made) return made.error();
    state->scene.emplace(std::move(*made));
    PatternSpec window;
    window.kind = PatternSpec::Kind::Window;
    double brightest = 0;
    const Image light = state->scene->radiance(patternImage(window, setup.screen));
    for (const float sample : light.samples()) brightest = std::max<double>(brightest, sample);
    state->fullScaleSecond = brightest > 0 ? 0.1 * brightest : 1;
  } else if (Status ready = state->prepareScene(); !ready) {
    return ready.error();
  }
  return std::shared_ptr<LiveRig>(new LiveRig(std::move(state)));
}

const LiveRigSetup& LiveRig::setup() const {
  return state_->setup;
}

RigDescription LiveRig::description() const {
  const std::lock_guard lock(state_->mutex);
  RigDescription rig;
  rig.camera = state_->sceneSetup.camera;
  rig.screen = state_->setup.screen;
  rig.sampleWidthMm = state_->setup.sheet.widthMm;
  rig.sampleHeightMm = state_->setup.sheet.heightMm;
  rig.sampleName = state_->setup.sheet.name;
  rig.radianceOfFullScaleSecond = state_->fullScaleSecond;
  rig.screenResponse = ScreenResponse::gamma(state_->setup.gamma);
  return rig;
}

Camera LiveRig::camera() const {
  const std::lock_guard lock(state_->mutex);
  return state_->sceneSetup.camera;
}

void LiveRig::moveCamera(const Camera& camera) {
  const std::lock_guard lock(state_->mutex);
  state_->sceneSetup.camera = camera;
  state_->sceneChanged();
}

void LiveRig::exchangeScreen(int widthPx, int heightPx) {
  const std::lock_guard lock(state_->mutex);
  Screen& screen = state_->setup.screen;
  if (screen.widthPx == widthPx && screen.heightPx == heightPx) return;
  for (Screen* one : {&screen, &state_->sceneSetup.screen}) {
    one->widthPx = widthPx;
    one->heightPx = heightPx;
    one->heightMm = one->widthMm * heightPx / widthPx;
  }
  state_->glass.clear();
  state_->sceneChanged();
}

void LiveRig::moveSample(const Eigen::Vector2d& toMm, double turnDeg) {
  const std::lock_guard lock(state_->mutex);
  state_->sceneSetup.sampleShiftMm = toMm;
  state_->sceneSetup.sampleTurnDeg = turnDeg;
  state_->sceneChanged();
}

void LiveRig::put(OnTable what) {
  const std::lock_guard lock(state_->mutex);
  state_->sceneSetup.onTable = what;
  state_->sceneChanged();
}

void LiveRig::show(std::vector<LivePrint> prints) {
  const std::lock_guard lock(state_->mutex);
  state_->sceneSetup.prints = std::move(prints);
  state_->sceneChanged();
}

void LiveRig::light(const std::optional<LiveLamp>& lamp) {
  const std::lock_guard lock(state_->mutex);
  state_->lamp = lamp;
  state_->lampLight.reset();
}

RigTime LiveRig::now() const {
  const std::lock_guard lock(state_->mutex);
  return state_->now();
}

bool LiveRig::waitUntil(RigTime when, const std::stop_token& stop) {
  std::unique_lock lock(state_->mutex);
  if (!state_->setup.realTime) {
    state_->clock = std::max(state_->clock, when);
    return !stop.stop_requested();
  }
  state_->changed.wait_until(lock, stop, when, [] { return false; });
  return !stop.stop_requested();
}

std::uint64_t LiveRig::picturesShown() const {
  const std::lock_guard lock(state_->mutex);
  return state_->pictures;
}

void LiveRig::unplug() {
  const std::lock_guard lock(state_->mutex);
  state_->unplugged = true;
}
void LiveRig::plugIn() {
  const std::lock_guard lock(state_->mutex);
  state_->unplugged = state_->frozen = false;
}
void LiveRig::loseFrames(int frames) {
  const std::lock_guard lock(state_->mutex);
  state_->lost = frames;
}
void LiveRig::damageFrames(int frames) {
  const std::lock_guard lock(state_->mutex);
  state_->damaged = frames;
}
void LiveRig::freeze() {
  const std::lock_guard lock(state_->mutex);
  state_->frozen = true;
}
void LiveRig::missPictures(int pictures) {
  const std::lock_guard lock(state_->mutex);
  state_->missed = pictures;
}
void LiveRig::dim(double share) {
  const std::lock_guard lock(state_->mutex);
  state_->dimmed = share;
}

void LiveRig::glassShows(const std::string&, const ShownPicture& picture, RigTime swapped) {
  const std::lock_guard lock(state_->mutex);
  if (state_->missed > 0) {
    --state_->missed;
    return;
  }
  State::Shown shown;
  shown.picture = picture;
  shown.hash = picture.hash();
  shown.light = swapped + std::chrono::microseconds(std::lround(1000 * state_->setup.latencyMs));
  shown.number = ++state_->pictures;
  state_->glass.push_back(std::move(shown));
  if (state_->glass.size() > kRemembered) state_->glass.pop_front();
}

// ---- inside ----

CameraInfo LiveRig::State::info() const {
  return {"simulated:" + setup.name, "Simulated camera over " + setup.name, "simulated",
          opened ? "in use" : ""};
}

Status LiveRig::State::prepareScene() {
  // Until the screen shows something, its light needs no paths: boards and lamps cost a fraction then.
  if (scene && !sceneSetup.screenLit && !glass.empty()) scene.reset();
  if (!scene) {
    sceneSetup.screenLit = !glass.empty();
    Result<LiveScene> made = LiveScene::create(sceneSetup, JobContext{});
    if (!made) return made.error();
    scene.emplace(std::move(*made));
    cache.clear();
  }
  if (lamp && !lampLight) lampLight = scene->underLamp(*lamp);
  return Done{};
}

const Image& LiveRig::State::radianceOf(const Shown& shown) {
  for (auto it = cache.begin(); it != cache.end(); ++it)
    if (it->hash == shown.hash && it->version == sceneVersion) {
      cache.splice(cache.begin(), cache, it);
      return cache.front().radiance;
    }
  Image light = lightOf(shown.picture, panel);
  const Screen& screen = sceneSetup.screen;
  if (light.width() != screen.widthPx || light.height() != screen.heightPx) {
    // A window of another size shows the picture in its corner, unscaled; the rest is black.
    Image whole(screen.widthPx, screen.heightPx, 1);
    for (int y = 0; y < std::min(light.height(), whole.height()); ++y)
      for (int x = 0; x < std::min(light.width(), whole.width()); ++x) whole.at(x, y) = light.at(x, y);
    light = std::move(whole);
  }
  if (setup.effects.has("emission-spatial")) {
    const Eigen::Vector2d half = screen.halfExtent();
    for (int y = 0; y < light.height(); ++y)
      for (int x = 0; x < light.width(); ++x)
        light.at(x, y) *=
            static_cast<float>(backlight(setup.effects, half, half.x() * ((2.0 * x + 1) / light.width() - 1),
                                         half.y() * (1 - (2.0 * y + 1) / light.height())));
  }
  cache.push_front({shown.hash, sceneVersion, scene->radiance(light)});
  if (cache.size() > kCached) cache.pop_back();
  return cache.front().radiance;
}

Frame LiveRig::State::expose(RigTime start, double exposure, double gainInForce) {
  const Camera& camera = sceneSetup.camera;
  Image light(camera.width, camera.height, 3);
  // Every picture that gave light during the exposure: the newer ones rise as the older ones fall.
  double left = 1;
  std::uint64_t number = 0, hash = 0;
  for (auto shown = glass.rbegin(); shown != glass.rend() && left > 0; ++shown) {
    const double from = seconds(shown->light - start);
    const double share = std::min(left, risen(0, exposure, from, setup.riseMs / 1000));
    if (!(share > 0)) continue;
    if (number == 0) number = shown->number, hash = shown->hash;
    const Image& radiance = radianceOf(*shown);
    const auto weight = static_cast<float>(share);
    for (std::size_t i = 0; i < light.samples().size(); ++i)
      light.samples()[i] += weight * radiance.samples()[i];
    left -= share;
  }
  // The backlight's ripple, averaged over the exposure.
  double factor = dimmed;
  if (setup.flickerDepth > 0) {
    const double turn = 2 * std::numbers::pi * setup.refreshHz, from = seconds(start.time_since_epoch());
    const double begin = std::fmod(from * setup.refreshHz, 1.0) / setup.refreshHz;
    factor *= 1 + setup.flickerDepth * (std::cos(turn * begin) - std::cos(turn * (begin + exposure))) /
                      (turn * exposure);
  }
  const Image& albedo = scene->albedo();
  for (std::size_t i = 0; i < light.samples().size(); ++i) {
    float& sample = light.samples()[i];
    sample = static_cast<float>(sample * factor + setup.ambient * albedo.samples()[i]);
    if (lampLight) sample += lampLight->samples()[i];
  }
  // To full scale; effects of lens and sensor in these units.
  const double toFull = exposure * gainInForce / fullScaleSecond * (1 - setup.pedestal);
  for (float& sample : light.samples()) sample = static_cast<float>(sample * toFull);
  std::optional<PhotoEffects> effects;
  const int index = static_cast<int>(std::min<std::uint64_t>(number, kDriftPhotos - 1));
  if (!setup.effects.none()) {
    SimulatedEffects acting = setup.effects;
    acting.exposureMismatch = {};
    effects.emplace(acting, kDriftPhotos, -1, 0.0, 1.0, albedo, setup.seed);
    effects->beforeSensor(light, index);
  }
  for (float& sample : light.samples()) sample += static_cast<float>(setup.pedestal);
  if (number != pictureOfFrames) {
    pictureOfFrames = number;
    framesOfPicture = 0;
  }
  // Noise by picture, exposure and how many frames of it there were: the same capture twice is the same.
  const std::uint64_t seed =
      setup.seed ^ hash ^ static_cast<std::uint64_t>(std::llround(exposure * 1e9)) * 0x9E3779B97F4A7C15ull;
  SensorNoise noise = setup.noise;
  noise.shot *= gainInForce;
  noise.read *= gainInForce;
  senseInPlace(light, noise, 1.0, seed, framesOfPicture++, effects ? effects->clipsAt() : 1.0);
  if (effects) effects->afterSensor(light);

  Frame frame;
  frame.format.size = {camera.width, camera.height};
  frame.black = setup.pedestal;
  frame.white = effects ? effects->clipsAt() : 1.0;
  if (setup.bayer12) {
    frame.format.layout = PixelLayout::Bayer12;
    frame.format.name = "12-bit Bayer";
    frame.bytes.resize(2 * light.pixelCount());
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x) {
        const int channel = (x & 1) + (y & 1);  // R G / G B
        const auto code =
            static_cast<unsigned>(std::clamp(std::lround(4095 * light.at(x, y, channel)), 0L, 4095L));
        const std::size_t at = 2 * (static_cast<std::size_t>(y) * camera.width + x);
        frame.bytes[at] = static_cast<std::uint8_t>(code & 255);
        frame.bytes[at + 1] = static_cast<std::uint8_t>(code >> 8);
      }
  } else {
    frame.format.name = "linear";
    frame.linear = std::move(light);
  }
  frame.metadata.sequence = sequence;
  frame.metadata.exposureStart = start;
  frame.metadata.exposureS = exposure;
  frame.metadata.gain = gainInForce;
  frame.metadata.redGain = frame.metadata.blueGain = 1.0;
  if (damaged > 0) {
    --damaged;
    frame.metadata.damaged = true;
  }
  return frame;
}

// ---- poses ----

namespace {

class LivePoses : public PoseSource {
 public:
  LivePoses(std::shared_ptr<LiveRig> rig, double errorDeg, double errorMm)
      : rig_(std::move(rig)), errorDeg_(errorDeg), errorMm_(errorMm) {}
  Result<PoseEstimate> poseIn(const Image&) override {
    PoseEstimate estimate;
    estimate.camera = rig_->camera();
    std::normal_distribution<double> normal;
    const Eigen::Vector3d turn = Eigen::Vector3d(normal(random_), normal(random_), normal(random_)) *
                                 errorDeg_ * std::numbers::pi / 180;
    const Eigen::Vector3d shift =
        Eigen::Vector3d(normal(random_), normal(random_), normal(random_)) * errorMm_;
    // About the sample's centre: what a board of markers gets wrong.
    if (turn.norm() > 0) {
      const Eigen::Matrix3d by = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
      estimate.camera.cameraFromWorld = estimate.camera.cameraFromWorld * by;
    }
    estimate.camera.translationMm += shift;
    estimate.tiltUncertaintyDeg = errorDeg_;
    estimate.distanceUncertaintyMm = errorMm_;
    return estimate;
  }

 private:
  std::shared_ptr<LiveRig> rig_;
  double errorDeg_, errorMm_;
  std::mt19937_64 random_{1};
};

}  // namespace

std::unique_ptr<PoseSource> LiveRig::poses(double errorDeg, double errorMm) {
  return std::make_unique<LivePoses>(shared_from_this(), errorDeg, errorMm);
}

std::unique_ptr<PatternDisplay> LiveRig::openDisplay() {
  return makeLiveDisplay(shared_from_this(), *state_);
}

Result<std::unique_ptr<CameraDevice>> LiveRig::openCamera() {
  {
    const std::lock_guard lock(state_->mutex);
    if (state_->unplugged) return cameraUnplugged(state_->info().name);
    if (state_->opened) return cameraBusy(state_->info().name);
    state_->opened = true;
  }
  return makeLiveCamera(shared_from_this(), *state_);
}

}  // namespace patina
