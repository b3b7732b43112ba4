// The store in memory and on disk, finished tiles, and what a kill or a full disk leaves.
#include "engine/fourier/measurement_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>

#include <filesystem>
#include <fstream>

#include "engine/fourier/finished_tiles.h"
#include "tests/base/temp_folder.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::uint64_t kAll = std::uint64_t{1} << 40;

void fill(MeasurementStore& store, SiteRun run) {
  const std::size_t stride = static_cast<std::size_t>(store.frequencyCount()) * 6;
  std::vector<float> z(run.count * stride), even(run.count * stride);
  for (std::size_t i = 0; i < z.size(); ++i) {
    z[i] = static_cast<float>(run.first * stride + i);
    even[i] = -z[i] - 1;
  }
  ASSERT_TRUE(store.write(run, z, even).ok());
}

TEST(MeasurementStore, DiskHoldsWhatMemoryHolds) {
  TempFolder folder;
  auto memory = MeasurementStore::make(100, 5, kAll), disk = MeasurementStore::make(100, 5, 0, folder.path());
  ASSERT_TRUE(memory.ok() && disk.ok());
  EXPECT_TRUE(memory->inMemory());
  EXPECT_FALSE(disk->inMemory());
  EXPECT_TRUE(fs::is_empty(folder.path())) << "the scratch file must have no name";
  for (auto* store : {&*memory, &*disk}) {
    for (const SiteRun run : {SiteRun{0, 10}, SiteRun{40, 60}, SiteRun{10, 30}}) fill(*store, run);
    for (const auto parts : {MeasurementStore::kZ, MeasurementStore::kEven, MeasurementStore::kBoth}) {
      const SiteBlock block = store->block(33, 20, parts);
      for (std::size_t s = 33; s < 53; ++s) {
        for (std::size_t k = 0; k < 30; ++k) {
          const auto value = static_cast<float>(s * 30 + k);
          if (parts & MeasurementStore::kZ) {
            ASSERT_EQ(block.z(s)[k], value);
          }
          if (parts & MeasurementStore::kEven) {
            ASSERT_EQ(block.even(s)[k], -value - 1);
          }
        }
      }
    }
    EXPECT_FALSE(store->failure());
  }
}

TEST(MeasurementStore, FreshSitesAreZero) {
  TempFolder folder;
  for (const std::uint64_t memory : {kAll, std::uint64_t{0}}) {
    const auto store = MeasurementStore::make(7, 2, memory, folder.path());
    ASSERT_TRUE(store.ok());
    const SiteBlock block = store->block(0, 7);
    for (int k = 0; k < 12; ++k) ASSERT_EQ(block.even(6)[k], 0.0f);
  }
}

TEST(MeasurementStore, DroppedRowsAreSortedAndUnique) {
  auto store = MeasurementStore::make(10, 4, kAll);
  ASSERT_TRUE(store.ok());
  EXPECT_THAT(store->droppedRows(3), IsEmpty());
  store->setDroppedRows({{7, 5}, {3, 2}, {7, 1}, {3, 2}});
  EXPECT_THAT(store->droppedRows(3), ElementsAre(2));
  EXPECT_THAT(store->droppedRows(7), ElementsAre(1, 5));
  for (const std::size_t none : {0u, 4u, 9u}) EXPECT_THAT(store->droppedRows(none), IsEmpty());
  EXPECT_EQ(store->droppedRowCount(), 3u);
}

TEST(MeasurementStore, AFolderThatIsNotThereIsNamed) {
  TempFolder folder;
  const auto store = MeasurementStore::make(10, 4, 0, folder.path() / "nowhere");
  ASSERT_FALSE(store.ok());
  EXPECT_EQ(store.error().code, ErrorCode::WriteFailed);
  EXPECT_THAT(store.error().where, testing::HasSubstr("nowhere"));
}

TEST(MeasurementStore, AFullDiskIsSaidBeforeAnythingIsRead) {
  TempFolder folder;
  const fs::path disk = folder.path() / "disk";
  fs::create_directories(disk);
  if (::mount("none", disk.c_str(), "tmpfs", 0, "size=1m") != 0) GTEST_SKIP() << "no right to mount";
  const auto store = MeasurementStore::make(10'000, 32, 0, disk);
  ::umount(disk.c_str());
  ASSERT_FALSE(store.ok());
  EXPECT_THAT(store.error().what, testing::HasSubstr("too full"));
  EXPECT_THAT(store.error().tryThis, testing::HasSubstr("free some space"));
}

class Tiles : public testing::Test {
 protected:
  static std::vector<SiteSolution> solutions(std::size_t count, float sigma) {
    std::vector<SiteSolution> out(count);
    for (std::size_t i = 0; i < count; ++i) {
      out[i].lobe.logSigma = sigma + static_cast<float>(i);
      out[i].outcome = SolveOutcome::Converged;
    }
    return out;
  }
  FinishedTiles open(std::uint64_t fingerprint = 42) {
    auto tiles = FinishedTiles::open(folder_.path(), fingerprint);
    EXPECT_TRUE(tiles.ok());
    return std::move(*tiles);
  }
  bool has(const FinishedTiles& tiles, int stage, SiteRun run, float sigma) {
    std::vector<SiteSolution> read(run.count);
    if (!tiles.load(stage, run, read)) return false;
    for (std::size_t i = 0; i < run.count; ++i)
      EXPECT_EQ(read[i].lobe.logSigma, sigma + static_cast<float>(i));
    return true;
  }
  fs::path file() const { return folder_.path() / FinishedTiles::kFileName; }
  TempFolder folder_;
};

TEST_F(Tiles, ComeBack) {
  {
    FinishedTiles tiles = open();
    EXPECT_TRUE(tiles.active());
    tiles.save(0, {0, 64}, solutions(64, 1));
    tiles.save(1, {0, 64}, solutions(64, 2));
    tiles.save(0, {64, 10}, solutions(10, 3));
    tiles.save(0, {0, 64}, solutions(64, 4));  // replaces
    EXPECT_TRUE(has(tiles, 0, {0, 64}, 4));
  }
  const FinishedTiles tiles = open();
  EXPECT_TRUE(has(tiles, 0, {0, 64}, 4));
  EXPECT_TRUE(has(tiles, 1, {0, 64}, 2));
  EXPECT_TRUE(has(tiles, 0, {64, 10}, 3));
  EXPECT_FALSE(has(tiles, 0, {64, 11}, 3));
  EXPECT_FALSE(has(tiles, 2, {0, 64}, 2));
}

TEST_F(Tiles, KeepNothingWithoutAFolder) {
  FinishedTiles tiles;
  tiles.save(0, {0, 2}, solutions(2, 1));
  EXPECT_FALSE(tiles.active());
  EXPECT_FALSE(has(tiles, 0, {0, 2}, 1));
}

TEST_F(Tiles, OfAnotherFitAreForgotten) {
  open(42).save(0, {0, 8}, solutions(8, 1));
  EXPECT_FALSE(has(open(43), 0, {0, 8}, 1));
  EXPECT_FALSE(has(open(42), 0, {0, 8}, 1));
}

TEST_F(Tiles, ATornRecordIsIgnoredWhereverItWasTorn) {
  open().save(0, {0, 8}, solutions(8, 1));
  const auto whole = fs::file_size(file());
  open().save(0, {8, 8}, solutions(8, 2));
  const auto both = fs::file_size(file());
  std::string bytes(both, '\0');
  std::ifstream(file(), std::ios::binary).read(bytes.data(), static_cast<std::streamsize>(both));
  for (auto length = whole; length < both; length += 13) {
    std::ofstream(file(), std::ios::binary | std::ios::trunc)
        .write(bytes.data(), static_cast<std::streamsize>(length));
    FinishedTiles tiles = open();
    EXPECT_TRUE(has(tiles, 0, {0, 8}, 1)) << length;
    EXPECT_FALSE(has(tiles, 0, {8, 8}, 2)) << length;
    tiles.save(0, {8, 8}, solutions(8, 5));  // goes where the torn one was
    tiles = FinishedTiles();
    EXPECT_TRUE(has(open(), 0, {8, 8}, 5)) << length;
  }
}

TEST_F(Tiles, DamageIsNoticed) {
  open().save(0, {0, 8}, solutions(8, 1));
  const auto size = fs::file_size(file());
  for (std::uintmax_t at = 0; at < size; at += 11) {
    std::string bytes(size, '\0');
    std::ifstream(file(), std::ios::binary).read(bytes.data(), static_cast<std::streamsize>(size));
    const std::string before = bytes;
    bytes[at] = static_cast<char>(bytes[at] ^ 0x10);
    std::ofstream(file(), std::ios::binary | std::ios::trunc)
        .write(bytes.data(), static_cast<std::streamsize>(size));
    EXPECT_FALSE(has(open(), 0, {0, 8}, 1)) << at;
    std::ofstream(file(), std::ios::binary | std::ios::trunc)
        .write(before.data(), static_cast<std::streamsize>(size));
  }
}

TEST_F(Tiles, TwoFitsDontShareAFile) {
  const FinishedTiles first = open();
  EXPECT_FALSE(FinishedTiles::open(folder_.path(), 42).ok());
}

}  // namespace
}  // namespace patina::test
