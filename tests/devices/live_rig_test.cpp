#include "devices/simulated/live_rig.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <chrono>
#include <cmath>
#include <numbers>

#include "devices/simulated/live_scene.h"
#include "devices/simulated/simulated_rig.h"
#include "engine/acquire/frame_image.h"
#include "engine/acquire/latency.h"
#include "engine/brdf/analytic_brdf.h"

namespace patina {
namespace {

using std::chrono::milliseconds;

PatternSpec sine(int fx, int fy, int phase) {
  PatternSpec spec;
  spec.kind = PatternSpec::Kind::Sine;
  spec.frequency = {fx, fy};
  spec.phase = phase;
  return spec;
}
PatternSpec window() {
  PatternSpec spec;
  spec.kind = PatternSpec::Kind::Window;
  return spec;
}

LiveRigSetup quiet(const std::string& scene, int pixels) {
  LiveRigSetup setup = LiveRig::desk(scene, pixels);
  setup.noise = {0, 0};
  setup.ambient = 0;
  setup.flickerDepth = 0;
  return setup;
}

double meanOf(const Image& image) {
  double sum = 0;
  for (const float sample : image.samples()) sum += sample;
  return sum / static_cast<double>(image.samples().size());
}

std::unique_ptr<CameraDevice> opened(const std::shared_ptr<LiveRig>& rig) {
  return rig->openCamera().value();
}

Result<Image> photograph(CameraDevice& camera, double exposureS, RigTime notBefore = {}) {
  StillRequest request;
  request.exposureS = exposureS;
  request.notBefore = notBefore;
  Result<std::vector<Frame>> frames = camera.still(request, {});
  if (!frames) return frames.error();
  return linearImage(frames->front());
}

TEST(LiveScene, SeesWhatTheIntegratingSimulatorSees) {
  // The other simulator sums the pattern's cells beforehand; here the light comes from the picture's pixels.
  constexpr int kPixels = 20;
  LiveRigSetup setup = quiet("laminate", kPixels);
  SimulatedRig rig = SimulatedRig::desk(kPixels, setup.sheet.widthMm, setup.sheet.heightMm);
  SimulatedCaptureOptions options;
  options.samplesPerPixelSide = 1;
  options.fitted = {{1, 0}, {3, -3}, {0, 10}, {20, 20}};
  options.heldOut.clear();
  const Result<SimulatedExposure> expected = exposeSheet(rig, setup.sheet, options, {});
  ASSERT_TRUE(expected.ok());
  LiveSceneSetup sceneSetup;
  sceneSetup.camera = setup.camera;
  sceneSetup.screen = setup.screen;
  sceneSetup.screen.widthPx = 1600;  // the other one's cells
  sceneSetup.screen.heightPx = 900;
  sceneSetup.sheet = setup.sheet;
  const Result<LiveScene> scene = LiveScene::create(sceneSetup, {});
  ASSERT_TRUE(scene.ok()) << scene.error().sentence();
  float brightest = 0;
  const Image reference = expected->photo(0);
  for (const float sample : reference.samples()) brightest = std::max(brightest, sample);
  std::vector<PatternSpec> patterns{window(), PatternSpec{}};
  for (const Eigen::Vector2i& f : options.fitted)
    for (int phase = 0; phase < 4; ++phase) patterns.push_back(sine(f.x(), f.y(), phase));
  for (std::size_t p = 0; p < patterns.size(); ++p) {
    const Image got = scene->radiance(patternImage(patterns[p], sceneSetup.screen));
    const Image want = expected->photo(static_cast<int>(p));
    for (int y = 0; y < kPixels; ++y)
      for (int x = 0; x < kPixels; ++x) {
        const auto point = setup.camera.samplePlaneFromPixel({x, y});
        if (!point || std::abs(point->x()) > setup.sheet.widthMm / 2 ||
            std::abs(point->y()) > setup.sheet.heightMm / 2)
          continue;
        // A thousandth of the brightest is what either promises.
        for (int c = 0; c < 3; ++c)
          EXPECT_NEAR(got.at(x, y, c), want.at(x, y, c), 1.5e-3 * brightest) << p << " at " << x << ' ' << y;
      }
  }
}

TEST(LiveScene, MeasuredBrdfIsTheSumOverTheScreensPixels) {
  LiveSceneSetup setup;
  const LiveRigSetup desk = quiet("cardstock", 6);
  setup.camera = desk.camera;
  setup.screen = desk.screen;
  setup.screen.widthPx = 480;
  setup.screen.heightPx = 270;
  setup.sheet = desk.sheet;
  setup.sheet.slopeRms = 0;
  AnalyticBrdfParameters parameters;
  parameters.alphaX = parameters.alphaY = 0.25;
  parameters.diffuse = {0.4, 0.2, 0.1};
  const Result<BrdfPtr> brdf = makeAnalyticBrdf("ggx", parameters);
  ASSERT_TRUE(brdf.ok());
  setup.brdfs = {*brdf};
  const Result<LiveScene> scene = LiveScene::create(setup, {});
  ASSERT_TRUE(scene.ok()) << scene.error().sentence();
  const Image light = patternImage(sine(2, 1, 1), setup.screen);
  const Image got = scene->radiance(light);
  const Screen& screen = setup.screen;
  for (const auto& [x, y] : {std::pair{2, 2}, {3, 4}}) {
    const Eigen::Vector3d point = *setup.camera.samplePlaneFromPixel({x, y});
    const Eigen::Vector3d toView = (setup.camera.positionMm() - point).normalized();
    Eigen::Array3d sum = Eigen::Array3d::Zero();
    for (int j = 0; j < screen.heightPx; ++j)
      for (int i = 0; i < screen.widthPx; ++i) {
        const Eigen::Vector3d local(((i + 0.5) / screen.widthPx - 0.5) * screen.widthMm,
                                    (0.5 - (j + 0.5) / screen.heightPx) * screen.heightMm, 0);
        const Eigen::Vector3d to = screen.originMm + screen.worldFromScreen * local - point;
        const double distance = to.norm();
        const Eigen::Vector3d toLight = to / distance;
        const Eigen::Vector3d foot = screen.worldFromScreen.transpose() * (point - screen.originMm);
        const Eigen::Array2d q =
            ((local.head<2>() - foot.head<2>()) / foot.z()).array() / screen.emission->sigma.array();
        const double area = screen.widthMm / screen.widthPx * screen.heightMm / screen.heightPx;
        sum += (*brdf)->evaluate(toLight, toView) *
               (toLight.z() * -toLight.dot(screen.worldFromScreen.col(2)) * area / (distance * distance) *
                std::exp(-0.5 * q.square().sum()) * light.at(i, j));
      }
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(got.at(x, y, c) / sum[c], 1, 4e-3);  // a node and a quarter a sigma
  }
}

TEST(LiveRig, SeesTheScreensPixelsAndNotThePicturesName) {
  const Result<std::shared_ptr<LiveRig>> rig = LiveRig::create(quiet("laminate", 16));
  ASSERT_TRUE(rig.ok());
  Result<std::unique_ptr<CameraDevice>> camera = (*rig)->openCamera();
  ASSERT_TRUE(camera.ok());
  const auto display = (*rig)->openDisplay();
  const Screen& screen = (*rig)->setup().screen;
  const ScreenResponse response = ScreenResponse::gamma(2.2);
  ShownPicture right = shownPattern(sine(2, 0, 0), screen, response),
               lying = shownPattern(sine(2, 0, 2), screen, response);
  lying.name = right.name;
  const auto take = [&](const ShownPicture& picture) {
    const Result<OnGlass> shown = display->show(picture, {});
    return *photograph(**camera, 0.05, shown->since);
  };
  const Image a = take(right), b = take(lying), again = take(right);
  double difference = 0, same = 0;
  for (std::size_t i = 0; i < a.samples().size(); ++i) {
    difference += std::abs(a.samples()[i] - b.samples()[i]);
    same += std::abs(a.samples()[i] - again.samples()[i]);
  }
  EXPECT_GT(difference / static_cast<double>(a.samples().size()), 0.1 * meanOf(a));
  EXPECT_EQ(same, 0);
}

TEST(LiveRig, LightComesLateAndRises) {
  LiveRigSetup setup = quiet("laminate", 8);
  setup.latencyMs = 40;
  setup.riseMs = 5;
  setup.readoutMs = 0.5;
  const auto rig = *LiveRig::create(setup);
  auto camera = opened(rig);
  const auto display = rig->openDisplay();
  display->setLatency(std::chrono::microseconds(0));
  const ScreenResponse response = ScreenResponse::gamma(2.2);
  ASSERT_TRUE(display->show(shownPattern(window(), setup.screen, response), {}).ok());
  ASSERT_TRUE(display->wait(milliseconds(500), {}));
  const double full = meanOf(*photograph(*camera, 0.001));
  ASSERT_TRUE(display->show(shownPattern({}, setup.screen, response), {}).ok());
  ASSERT_TRUE(display->wait(milliseconds(500), {}));
  const Result<OnGlass> shown = display->show(shownPattern(window(), setup.screen, response), {});
  ASSERT_TRUE(shown.ok());
  StillRequest request;
  request.exposureS = 0.001;
  request.frames = 70;
  const auto frames = camera->still(request, {});
  ASSERT_TRUE(frames.ok());
  for (const Frame& frame : *frames) {
    const double t =
        std::chrono::duration<double>(frame.metadata.exposureStart - shown->swapped).count() * 1000 - 40 +
        0.5;  // ms, middle
    const double expected = t < 0 ? 0 : 1 - std::exp(-t / 5);
    EXPECT_NEAR(meanOf(*linearImage(frame)) / full, expected, 0.08)
        << t;  // an exposure of a millisecond: a fifth of a rise, halved
  }
}

TEST(Latency, IsFoundToAFrame) {
  LiveRigSetup setup = LiveRig::desk("laminate", 12);
  setup.latencyMs = 47;
  setup.riseMs = 3;
  setup.readoutMs = 1;
  const auto rig = *LiveRig::create(setup);
  auto camera = opened(rig);
  const auto display = rig->openDisplay();
  constexpr double kExposureS = 1.0 / 60;
  const Result<LatencyMeasurement> found = measureLatency(*camera, *display, kExposureS, 4, {});
  ASSERT_TRUE(found.ok()) << found.error().sentence();
  // Until 97 % of a whole exposure is new: the latency and some rises, and at most a frame more.
  const double ms = static_cast<double>(found->latency.count()) / 1000;
  EXPECT_GE(ms, 47);
  EXPECT_LE(ms, 47 + 10 * 3 + 1000 * kExposureS + 1 + 0.1);
  // A black lens cap: nothing flashes.
  rig->dim(0);
  EXPECT_FALSE(measureLatency(*camera, *display, kExposureS, 2, {}).ok());
}

TEST(LiveRig, WholeRefreshesSeeNoFlickerAndOthersDo) {
  LiveRigSetup setup = quiet("laminate", 8);
  setup.flickerDepth = 0.3;
  setup.readoutMs = 3.7;
  const auto rig = *LiveRig::create(setup);
  auto camera = opened(rig);
  const auto display = rig->openDisplay();
  ASSERT_TRUE(display->show(shownPattern(window(), setup.screen, ScreenResponse::gamma(2.2)), {}).ok());
  const auto spread = [&](double exposureS) {
    StillRequest request;
    request.exposureS = exposureS;
    request.frames = 12;
    request.notBefore = rig->now() + milliseconds(500);
    double least = 1e9, most = 0;
    const Result<std::vector<Frame>> frames = camera->still(request, {});
    for (const Frame& frame : frames.value()) {
      const double level = meanOf(*linearImage(frame));
      least = std::min(least, level), most = std::max(most, level);
    }
    return most / least - 1;
  };
  EXPECT_LT(spread(2.0 / 60), 1e-5);
  EXPECT_GT(spread(1.5 / 60), 0.05);
}

TEST(LiveRig, SettingsActLateAndTheMetadataSaySo) {
  LiveRigSetup setup = quiet("laminate", 8);
  setup.settleFrames = 3;
  const auto rig = *LiveRig::create(setup);
  auto camera = opened(rig);
  const auto display = rig->openDisplay();
  const Result<OnGlass> shown =
      display->show(shownPattern(window(), setup.screen, ScreenResponse::gamma(2.2)), {});
  const double once = meanOf(*photograph(*camera, 0.02, shown->since));
  ASSERT_TRUE(camera->set(CameraControlId::ExposureS, 0.04).ok());
  StillRequest anything;
  anything.frames = 5;
  const auto frames = camera->still(anything, {});
  ASSERT_TRUE(frames.ok());
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ((*frames)[i].metadata.exposureS, i < 3 ? 0.02 : 0.04);
    EXPECT_NEAR(meanOf(*linearImage((*frames)[i])) / once, i < 3 ? 1 : 2, 1e-4);
  }
  const double twice = meanOf(*photograph(*camera, 0.02));
  EXPECT_NEAR(twice / once, 1, 1e-5);  // waited for its own setting
}

TEST(LiveRig, CameraIsOneAtATimeAndCanBeUnpluggedFrozenAndLossy) {
  const auto rig = *LiveRig::create(quiet("laminate", 8));
  {
    auto camera = opened(rig);
    const auto second = rig->openCamera();
    ASSERT_FALSE(second.ok());
    EXPECT_EQ(second.error().code, ErrorCode::Refused);
    rig->loseFrames(3);
    const auto first = camera->still({}, {});
    ASSERT_TRUE(first.ok());
    EXPECT_EQ(first->front().metadata.sequence, 4u);  // three never came, and are counted
    rig->damageFrames(2);
    const auto good = camera->still({}, {});
    ASSERT_TRUE(good.ok());
    EXPECT_FALSE(good->front().metadata.damaged);
    rig->freeze();
    const auto never = camera->still({}, {});
    ASSERT_FALSE(never.ok());
    EXPECT_NE(never.error().what.find("no picture came"), std::string::npos);
    rig->unplug();
    const auto gone = camera->still({}, {});
    ASSERT_FALSE(gone.ok());
    EXPECT_EQ(gone.error().code, ErrorCode::NotFound);
  }
  rig->plugIn();
  EXPECT_TRUE(rig->openCamera().ok());
}

TEST(LiveRig, StreamsLive) {
  const auto rig = *LiveRig::create(quiet("laminate", 8));
  auto camera = opened(rig);
  FrameQueue queue;
  ASSERT_TRUE(camera->start(queue.sink()).ok());
  for (int i = 0; i < 3; ++i) {
    const auto frame = queue.next(milliseconds(3000));
    ASSERT_TRUE(frame && frame->ok());
  }
  rig->unplug();
  bool ended = false;
  for (int i = 0; i < 20 && !ended; ++i) {
    const auto frame = queue.next(milliseconds(1000));
    ended = frame && !frame->ok() && frame->error().code == ErrorCode::NotFound;
  }
  EXPECT_TRUE(ended);
}

TEST(LiveRig, MirrorShowsTheScreenAndPrintsCoverTheTable) {
  LiveRigSetup setup = quiet("laminate", 48);
  const auto rig = *LiveRig::create(setup);
  auto camera = opened(rig);
  const auto display = rig->openDisplay();
  rig->put(OnTable::Mirror);
  PatternSpec patch;
  patch.kind = PatternSpec::Kind::Patch;
  Result<OnGlass> shown = display->show(shownPattern(patch, setup.screen, ScreenResponse::gamma(2.2)), {});
  const Image image = *photograph(*camera, 1e-3, shown->since);
  // Where the screen's middle appears in the mirror: its mirror image, seen straight.
  const Eigen::Vector3d mirrored = setup.screen.originMm.cwiseProduct(Eigen::Vector3d(1, 1, -1));
  const Eigen::Vector3d eye = setup.camera.positionMm(), along = mirrored - eye;
  const Eigen::Vector3d onMirror = eye - along * (eye.z() / along.z());
  const auto pixel = setup.camera.pixelFromWorld(onMirror);
  ASSERT_TRUE(pixel);
  ASSERT_LT(std::abs(onMirror.x()), setup.sheet.widthMm / 2);
  ASSERT_LT(std::abs(onMirror.y()), setup.sheet.heightMm / 2);
  const int x = static_cast<int>(std::lround(pixel->x())), y = static_cast<int>(std::lround(pixel->y()));
  EXPECT_GT(image.at(x, y, 1), 0.05);
  EXPECT_LT(image.at(2, 2, 1), 0.01 * image.at(x, y, 1));

  // A print half black, half white, over the middle of the table.
  LivePrint print;
  print.albedo = Image(2, 1, 1);
  print.albedo.at(0, 0) = 0.05f;
  print.albedo.at(1, 0) = 0.8f;
  print.widthMm = print.heightMm = 80;
  rig->put(OnTable::Sheet);
  rig->show({print});
  shown = display->show(shownPattern(window(), setup.screen, ScreenResponse::gamma(2.2)), {});
  const Image printed = *photograph(*camera, 0.1, shown->since);
  const auto left = *setup.camera.pixelFromWorld({-20, 0, 0}),
             right = *setup.camera.pixelFromWorld({20, 0, 0});
  const float dark = printed.at(static_cast<int>(left.x()), static_cast<int>(left.y()), 1);
  const float bright = printed.at(static_cast<int>(right.x()), static_cast<int>(right.y()), 1);
  EXPECT_NEAR(bright / dark, 16, 3);  // but for the light's fall over 40 mm
}

TEST(LiveRig, LampLightsTileAsLambert) {
  LiveRigSetup setup = quiet("laminate", 12);
  const auto rig = *LiveRig::create(setup);
  auto camera = opened(rig);
  rig->put(OnTable::WhiteTile);
  const Eigen::Vector3d toLight = Eigen::Vector3d(0.3, 0.2, 0.9).normalized();
  const double full = rig->description().radianceOfFullScaleSecond;
  rig->light(LiveLamp{toLight, Eigen::Array3d::Constant(full)});
  const Image image = *photograph(*camera, 0.5);
  EXPECT_NEAR(image.at(6, 6, 1), 0.5 * 0.990 / std::numbers::pi * toLight.z(), 1e-4);
}

TEST(LiveRig, BayerFramesShowTheSamePicture) {
  LiveRigSetup setup = quiet("cardstock", 24);
  const auto plain = *LiveRig::create(setup);
  setup.bayer12 = true;
  const auto bayer = *LiveRig::create(setup);
  Image images[2];
  for (int k = 0; k < 2; ++k) {
    const auto& rig = k == 0 ? plain : bayer;
    auto camera = opened(rig);
    const auto display = rig->openDisplay();
    const auto shown = display->show(shownPattern(window(), setup.screen, ScreenResponse::gamma(2.2)), {});
    images[k] = *photograph(*camera, 0.05, shown->since);
  }
  double difference = 0, level = 0;
  for (int y = 6; y < 18; ++y)
    for (int x = 6; x < 18; ++x)
      for (int c = 0; c < 3; ++c) {
        difference += std::abs(images[0].at(x, y, c) - images[1].at(x, y, c));
        level += images[0].at(x, y, c);
      }
  EXPECT_LT(difference / level, 0.06);  // what interpolation between colours loses of a picture this small
  EXPECT_GT(difference, 0);
}

TEST(LiveRig, FilesAreUnderstoodAndSlipsAreNamed) {
  const Result<LiveRigSetup> setup = LiveRig::fromJson(
      R"({"scene": "cardstock", "pixels": 32, "latencyMs": 12, "effects": {"glare": {"share": 0.1}}, "bayer12": true})",
      "rig.json");
  ASSERT_TRUE(setup.ok()) << setup.error().sentence();
  EXPECT_EQ(setup->camera.width, 32);
  EXPECT_EQ(setup->latencyMs, 12);
  EXPECT_EQ(setup->effects.glare.share, 0.1);
  EXPECT_TRUE(setup->bayer12);
  for (const char* bad : {"[]", R"({"latencyms": 3})", R"({"scene": "moon"})", R"({"pixels": 3000})",
                          R"({"gamma": 9})", R"({"gamma": "x"})", R"({"effects": {"nonsense": {}}})",
                          R"({"brdfs": ["no-such-file"]})", R"({"noise": {"shot": 1}})"}) {
    const Result<LiveRigSetup> refused = LiveRig::fromJson(bad, "rig.json");
    ASSERT_FALSE(refused.ok()) << bad;
    EXPECT_FALSE(refused.error().what.empty());
  }
  EXPECT_NE(LiveRig::fromJson(R"({"latencyms": 3})", "f").error().tryThis.find("latencyMs"),
            std::string::npos);
}

TEST(LiveRigProvider, ListsScenesAndCameraAndDisplayOfAnIdBelongTogether) {
  LiveRigProvider provider;
  const auto cameras = provider.list();
  ASSERT_TRUE(cameras.ok());
  EXPECT_GE(cameras->size(), 3u);
  EXPECT_FALSE(provider.open("simulated:moon").ok());
  const auto a = provider.rig("simulated:laminate"), b = provider.rig("simulated:laminate");
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_EQ(a->get(), b->get());
}

}  // namespace
}  // namespace patina
