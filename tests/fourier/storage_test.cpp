// Large captures: measurements on disk, photographs in strips, saturated samples, memory limits.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>

#include "devices/simulated/simulated_rig.h"
#include "engine/fourier/fit.h"
#include "engine/fourier/levels.h"
#include "engine/fourier/measurements.h"
#include "engine/image/exr.h"
#include "tests/base/temp_folder.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;

/// A capture of 70 x 70 pixels, made once.
class Storage : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TempFolder();
    const SimulatedSheet sheet = simulatedScene("laminate");
    SimulatedCaptureOptions options;
    options.samplesPerPixelSide = 1;
    const auto report =
        simulateCapture(folder_->path() / "bundle", SimulatedRig::desk(70, sheet.widthMm, sheet.heightMm),
                        sheet, options, {});
    ASSERT_TRUE(report.ok()) << report.error().sentence();
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }
  static FourierCapture capture(const char* name = "bundle") {
    auto read = readFourierCapture(folder_->path() / name);
    EXPECT_TRUE(read.ok());
    return *read;
  }
  static FourierMeasurements measured(const FourierCapture& capture, int size,
                                      const MeasurementStorage& storage) {
    auto plan = planMeasurements(capture, {});
    auto sites = makeSites(capture, size);
    EXPECT_TRUE(plan.ok() && sites.ok());
    auto m = measure(capture, std::move(*plan), std::move(*sites), {}, storage);
    EXPECT_TRUE(m.ok()) << m.error().sentence();
    EXPECT_TRUE(measureHeldOut(capture, *m, {}, storage).ok());
    return std::move(*m);
  }
  static inline TempFolder* folder_ = nullptr;
};

constexpr std::uint64_t kTiny = 1 << 20;  // 16 rows at a time, and a scratch file

void expectSame(const MeasurementStore& a, const MeasurementStore& b, double tolerance) {
  ASSERT_EQ(a.siteCount(), b.siteCount());
  ASSERT_EQ(a.frequencyCount(), b.frequencyCount());
  const SiteBlock blockA = a.block(0, a.siteCount()), blockB = b.block(0, b.siteCount());
  for (std::size_t s = 0; s < a.siteCount(); ++s) {
    for (int k = 0; k < 6 * a.frequencyCount(); ++k) {
      ASSERT_NEAR(blockA.z(s)[k], blockB.z(s)[k], tolerance) << s << " " << k;
      ASSERT_NEAR(blockA.even(s)[k], blockB.even(s)[k], tolerance) << s << " " << k;
    }
  }
}

TEST_F(Storage, StripsAndTheDiskChangeNothing) {
  const FourierMeasurements all = measured(capture(), 0, {}), strips = measured(capture(), 0, {kTiny, {}});
  ASSERT_TRUE(all.store.inMemory());
  ASSERT_FALSE(strips.store.inMemory());
  expectSame(all.store, strips.store, 0);
  expectSame(all.heldOut, strips.heldOut, 0);
  EXPECT_EQ(all.dc, strips.dc);
  EXPECT_EQ(all.dcVariances, strips.dcVariances);
  EXPECT_EQ(all.black, strips.black);
  EXPECT_EQ(all.window, strips.window);
  EXPECT_EQ(all.brightness, strips.brightness);
  EXPECT_EQ(all.noise.shot, strips.noise.shot);
  EXPECT_EQ(all.noise.read, strips.noise.read);
}

TEST_F(Storage, GroupsThatLieInSeveralStripsAreWhole) {
  const FourierMeasurements all = measured(capture(), 12, {}), strips = measured(capture(), 12, {kTiny, {}});
  ASSERT_TRUE(all.sites.grouped());
  expectSame(all.store, strips.store, 1e-6 * all.fullScale);
  for (std::size_t i = 0; i < all.dc.size(); ++i) ASSERT_NEAR(all.dc[i], strips.dc[i], 1e-6 * all.fullScale);
  // A group is the mean of its pixels.
  const FourierMeasurements pixels = measured(capture(), 0, {});
  const SiteBlock block = pixels.store.block(0, pixels.sites.size()), mean = all.store.block(0, 1);
  double sum = 0;
  int count = 0;
  for (std::size_t i = 0; i < all.sites.siteOfPixel.size(); ++i) {
    if (all.sites.siteOfPixel[i] != 0) continue;
    sum += block.z(static_cast<std::size_t>(pixels.sites.siteOfPixel[i]))[4];
    ++count;
  }
  EXPECT_EQ(count, all.sites.pixelCount[0]);
  EXPECT_NEAR(mean.z(0)[4], sum / count, 1e-6 * all.fullScale);
}

TEST_F(Storage, SitesAroundARunHoldItsNeighbours) {
  const auto sites = makeSites(capture(), 0);
  ASSERT_TRUE(sites.ok());
  const SiteRun run{sites->size() / 3, 40};
  const SiteRun around = sitesAround(*sites, run);
  for (std::size_t s = run.first; s < run.end(); ++s) {
    const int x = static_cast<int>(sites->pixel[s].x()), y = static_cast<int>(sites->pixel[s].y());
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        if (x + dx < 0 || y + dy < 0 || x + dx >= sites->imageWidth || y + dy >= sites->imageHeight) continue;
        const auto n = sites->siteOfPixel[static_cast<std::size_t>((y + dy) * sites->imageWidth + x + dx)];
        if (n < 0) continue;
        ASSERT_GE(static_cast<std::size_t>(n), around.first);
        ASSERT_LT(static_cast<std::size_t>(n), around.end());
      }
    }
  }
  EXPECT_LT(around.count, sites->size() / 4);
}

/// The bundle again, its sensor ending at `level`.
FourierCapture clippedCopy(const fs::path& from, const fs::path& to, float level, bool declare) {
  fs::copy(from, to, fs::copy_options::recursive);
  auto capture = readFourierCapture(to);
  EXPECT_TRUE(capture.ok());
  for (const auto& photo : capture->photos) {
    auto image = readExr(to / photo.file, {"R", "G", "B"});
    EXPECT_TRUE(image.ok());
    for (float& sample : image->samples()) sample = std::min(sample, level);
    EXPECT_TRUE(writeExr(to / photo.file, *image, {"R", "G", "B"}).ok());
  }
  if (declare) capture->saturation = level;
  EXPECT_TRUE(writeFourierCapture(*capture).ok());
  auto again = readFourierCapture(to);
  EXPECT_TRUE(again.ok());
  EXPECT_FLOAT_EQ(static_cast<float>(again->saturation), declare ? level : 0.0f);
  return *again;
}

TEST_F(Storage, SaturatedSamplesAreLeftOutOneByOne) {
  const FourierMeasurements free = measured(capture(), 0, {});
  // A level that a quarter of the brightest photographs reach.
  const auto cap = capture();
  std::vector<float> peaks(free.sites.size(), 0);
  const SiteBlock block = free.store.block(0, free.sites.size());
  for (std::size_t s = 0; s < peaks.size(); ++s)
    for (int f = 0; f < free.frequencyCount(); ++f)
      for (int c = 0; c < 3; ++c) {
        const float *z = block.z(s) + f * 6, *even = block.even(s) + f * 6;
        peaks[s] =
            std::max({peaks[s], (even[3 + c] + std::abs(z[c])) / 2, (even[c] + std::abs(z[3 + c])) / 2});
      }
  std::ranges::sort(peaks);
  const float level = peaks[peaks.size() * 3 / 4];
  const auto clipped = clippedCopy(folder_->path() / "bundle", folder_->path() / "clipped", level, true);
  const FourierMeasurements m = measured(clipped, 0, {}), tiny = measured(clipped, 0, {kTiny, {}});
  ASSERT_GT(m.clippedSamples, 0u);
  ASSERT_GT(m.store.droppedRowCount(), 0u);
  EXPECT_EQ(m.store.droppedRowCount(), tiny.store.droppedRowCount());
  std::size_t sitesWithDrops = 0;
  const SiteBlock cut = m.store.block(0, m.sites.size());
  for (std::size_t s = 0; s < m.sites.size(); ++s) {
    const auto dropped = m.droppedRows(s);
    ASSERT_TRUE(std::ranges::equal(dropped, tiny.droppedRows(s)));
    sitesWithDrops += !dropped.empty();
    for (int row = 0; row < 2 * m.frequencyCount(); ++row) {
      // Row by row: dropped where one of its two photographs reaches the level in some channel, and as
      // without clipping elsewhere.
      const int f = row / 2, zAt = f * 6 + (row % 2) * 3, evenAt = f * 6 + (row % 2 == 0 ? 3 : 0);
      float brightest = 0;
      for (int c = 0; c < 3; ++c)
        brightest = std::max(brightest, (block.even(s)[evenAt + c] + std::abs(block.z(s)[zAt + c])) / 2);
      const bool isDropped = std::ranges::binary_search(dropped, row);
      if (brightest > 1.001f * level) {
        ASSERT_TRUE(isDropped) << s << " " << row;
      }
      if (brightest < 0.999f * level) {
        ASSERT_FALSE(isDropped) << s << " " << row;
      }
      if (isDropped) continue;
      for (int c = 0; c < 3; ++c) ASSERT_EQ(cut.z(s)[zAt + c], block.z(s)[zAt + c]);
    }
    if (m.clipped[s]) continue;
    // Z(0) stays what it was, within six of its own standard deviations (4,000 sites, three channels).
    for (int c = 0; c < 3; ++c)
      ASSERT_NEAR(m.dc[s * 3 + static_cast<std::size_t>(c)], free.dc[s * 3 + static_cast<std::size_t>(c)],
                  6 * std::sqrt(m.dcVariance(s, c) + free.dcVariance(s, c)))
          << s;
  }
  EXPECT_GT(sitesWithDrops, m.sites.size() / 10);
  EXPECT_LT(sitesWithDrops, m.sites.size() / 2);
}

TEST_F(Storage, ADeclaredSaturationSavesTheFit) {
  const auto free = fitFourier(capture(), {}, {});
  ASSERT_TRUE(free.ok());
  const auto m = measured(capture(), 0, {});
  const auto level = static_cast<float>(0.8 * m.fullScale);
  const auto declared =
      fitFourier(clippedCopy(folder_->path() / "bundle", folder_->path() / "said", level, true), {}, {});
  const auto silent =
      fitFourier(clippedCopy(folder_->path() / "bundle", folder_->path() / "silent", level, false), {}, {});
  ASSERT_TRUE(declared.ok() && silent.ok());
  EXPECT_GT((*declared)->stats().clippedSamples, 0u);
  EXPECT_GT((*declared)->stats().droppedRows, 0u);
  EXPECT_EQ((*silent)->stats().clippedSamples, 0u);
  // The photographs that are left are explained down to their noise; unknown clipping isn't.
  EXPECT_LT((*declared)->stats().fitRms / (*declared)->stats().noiseFloorFit,
            1.1 * (*free)->stats().fitRms / (*free)->stats().noiseFloorFit);
  EXPECT_GT((*silent)->stats().fitRms / (*silent)->stats().noiseFloorFit,
            1.3 * (*declared)->stats().fitRms / (*declared)->stats().noiseFloorFit);
}

/// Keeps warnings.
class Warnings : public LogSink {
 public:
  void log(Level level, std::string_view sentence) override {
    std::scoped_lock lock(mutex_);
    if (level == Level::Warning) all += std::string(sentence) + "\n";
  }
  std::string all;

 private:
  std::mutex mutex_;
};

TEST_F(Storage, AFitFromDiskIsTheFitFromMemory) {
  FourierFitOptions small;
  small.memoryLimitBytes = std::uint64_t{4} << 20;
  const auto memory = fitFourier(capture(), {}, {}), disk = fitFourier(capture(), small, {});
  ASSERT_TRUE(memory.ok() && disk.ok());
  EXPECT_FALSE((*memory)->stats().measurementsOnDisk);
  EXPECT_TRUE((*disk)->stats().measurementsOnDisk);
  EXPECT_FALSE((*disk)->stats().coarserSites);
  EXPECT_TRUE(std::ranges::equal((*memory)->maps().sigma.samples(), (*disk)->maps().sigma.samples()));
  EXPECT_TRUE(std::ranges::equal((*memory)->maps().diffuse.samples(), (*disk)->maps().diffuse.samples()));
  EXPECT_EQ((*memory)->stats().fitRms, (*disk)->stats().fitRms);
  EXPECT_EQ((*memory)->stats().holdoutRms, (*disk)->stats().holdoutRms);
  EXPECT_EQ((*memory)->spectrumAt(5, 5)[7].measured, (*disk)->spectrumAt(5, 5)[7].measured);
}

TEST_F(Storage, TooLittleMemoryGivesCoarserMapsAndSaysSo) {
  FourierFitOptions tiny;
  tiny.memoryLimitBytes = 1400u << 10;
  Warnings warnings;
  JobContext job;
  job.logSink = &warnings;
  const auto fit = fitFourier(capture(), tiny, job);
  ASSERT_TRUE(fit.ok()) << fit.error().sentence();
  EXPECT_TRUE((*fit)->stats().coarserSites);
  EXPECT_LT((*fit)->maps().width, 60);
  EXPECT_THAT(warnings.all, testing::HasSubstr("--memory"));
  // and comes back with the same points
  const fs::path out = folder_->path() / "coarse";
  ASSERT_TRUE(writeFourierFit(out, **fit).ok());
  const auto loaded = loadFourierFit(out, {});
  ASSERT_TRUE(loaded.ok()) << loaded.error().sentence();
  EXPECT_EQ((*loaded)->options(), tiny);
  EXPECT_EQ((*loaded)->spectrumAt(4, 4)[3].measured, (*fit)->spectrumAt(4, 4)[3].measured);
}

TEST_F(Storage, HalfTheResolutionCountsAgainstTheMemoryLimit) {
  const auto cap = capture();
  const auto plan = planMeasurements(cap, {});
  const auto sites = makeSites(cap, 0);
  ASSERT_TRUE(plan.ok() && sites.ok());
  const double aspect =
      std::min(cap.sampleWidthMm, cap.sampleHeightMm) / std::max(cap.sampleWidthMm, cap.sampleHeightMm);
  const auto grid =
      paperScheduleBytes(resolvedSize(cap, *sites), aspect, static_cast<int>(plan->fitted.size()));
  // A limit that every point just fits into, found from below in steps of a fiftieth of the grid.
  FourierFitOptions all, paper;
  paper.schedule = FitSchedule::Paper;
  const auto coarser = [&](FourierFitOptions options, std::uint64_t limit) {
    options.memoryLimitBytes = limit;
    const auto fit = fitFourier(cap, options, {});
    EXPECT_TRUE(fit.ok()) << fit.error().sentence();
    return fit.ok() && (*fit)->stats().coarserSites;
  };
  std::uint64_t low = std::uint64_t{1} << 20, high = std::uint64_t{4} << 20;
  ASSERT_TRUE(coarser(all, low));
  ASSERT_FALSE(coarser(all, high));
  while (high - low > grid / 50) {
    const auto middle = (low + high) / 2;
    (coarser(all, middle) ? low : high) = middle;
  }
  EXPECT_TRUE(coarser(paper, high));
  // An eighth of the limit is for strips of photographs: the grid's own bytes and a seventh more.
  EXPECT_TRUE(coarser(paper, high + grid));
  EXPECT_FALSE(coarser(paper, high + grid * 8 / 7 + grid / 20));
}

TEST_F(Storage, FitsOfEarlierVersionsStillLoad) {
  FourierFitOptions options;
  options.schedule = FitSchedule::Paper;
  options.memoryLimitBytes = std::uint64_t{3} << 30;
  const auto fit = fitFourier(capture(), options, {});
  ASSERT_TRUE(fit.ok());
  const fs::path out = folder_->path() / "earlier";
  ASSERT_TRUE(writeFourierFit(out, **fit).ok());
  auto loaded = loadFourierFit(out, {});
  ASSERT_TRUE(loaded.ok());
  EXPECT_EQ((*loaded)->options(), options);
  auto json = nlohmann::json::parse(std::ifstream(out / "fit.json"));
  for (const char* key : {"schedule", "memory_bytes"}) json["options"].erase(key);
  for (const char* key :
       {"clipped_points", "dropped_measurements", "resumed_texels", "measurements_on_disk", "coarser_points"})
    json.erase(key);
  std::ofstream(out / "fit.json") << json.dump();
  loaded = loadFourierFit(out, {});
  ASSERT_TRUE(loaded.ok()) << loaded.error().sentence();
  EXPECT_EQ((*loaded)->options(), FourierFitOptions{});
}

/// Bytes that this process has asked the system to read.
std::uint64_t bytesRead() {
  std::ifstream io("/proc/self/io");
  std::string name;
  std::uint64_t value = 0;
  while (io >> name >> value)
    if (name == "rchar:") return value;
  return 0;
}

TEST_F(Storage, PhotographsAreReadOnce) {
  if (bytesRead() == 0) GTEST_SKIP() << "this system doesn't count what a process reads";
  const FourierCapture bundle = capture();
  std::uint64_t photographs = 0, beginnings = 0;
  for (const FourierPhoto& photo : bundle.photos) {
    const std::uint64_t bytes = fs::file_size(bundle.folder / photo.file);
    photographs += bytes, beginnings += std::min<std::uint64_t>(bytes, 1 << 16);
  }
  for (const std::uint64_t memory : {std::uint64_t{4} << 30, std::uint64_t{128} << 20}) {
    FourierFitOptions options;
    options.memoryLimitBytes = memory;
    const std::uint64_t before = bytesRead();
    const auto fit = fitFourier(bundle, options, {});
    ASSERT_TRUE(fit.ok()) << fit.error().sentence();
    EXPECT_GE(bytesRead() - before, photographs);  // else this test sees nothing
    // A file's first 64 KiB are read once more, where its header is checked before the library gets it.
    EXPECT_LT(bytesRead() - before, 1.25 * static_cast<double>(photographs) + static_cast<double>(beginnings))
        << memory;
  }
}

}  // namespace
}  // namespace patina::test
