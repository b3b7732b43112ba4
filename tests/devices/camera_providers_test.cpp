#include "devices/camera_providers.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace patina {
namespace {

TEST(CameraProviders, EveryBackendListsWithoutAnyCameraThere) {
  const auto providers = cameraProviders();
  std::vector<std::string> backends;
  for (const auto& provider : providers) {
    backends.push_back(provider->backend());
    const auto cameras = provider->list();
    EXPECT_TRUE(cameras.ok()) << provider->backend() << ": " << cameras.error().sentence();
  }
  for (const char* wanted : {"v4l2", "folder", "simulated"})
    EXPECT_NE(std::ranges::find(backends, wanted), backends.end());
#ifdef PATINA_HAS_LIBCAMERA
  EXPECT_NE(std::ranges::find(backends, "libcamera"), backends.end());
#endif
}

TEST(CameraProviders, ASecondManagerOfABackendIsNoTrouble) {
  const auto first = cameraProviders(), second = cameraProviders();
  for (const auto* providers : {&first, &second})
    for (const auto& provider : *providers) EXPECT_TRUE(provider->list().ok());
}

TEST(CameraProviders, ACameraThatIsntThereIsASentence) {
  const auto providers = cameraProviders();
  for (const char* id :
       {"v4l2:nowhere", "libcamera:nowhere", "folder:/nowhere/at/all", "simulated:moon", "gphoto:1", ""}) {
    const auto camera = openCamera(providers, id);
    ASSERT_FALSE(camera.ok()) << id;
    EXPECT_EQ(camera.error().code, ErrorCode::NotFound) << id;
    EXPECT_FALSE(camera.error().tryThis.empty());
  }
  EXPECT_TRUE(openCamera(providers, "simulated:cardstock").ok());
}

TEST(CameraProviders, ListHoldsTheSimulatedRigs) {
  const auto cameras = listCameras(cameraProviders());
  EXPECT_NE(std::ranges::find(cameras, "simulated:laminate", &CameraInfo::id), cameras.end());
}

}  // namespace
}  // namespace patina
