#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "engine/base/result.h"

namespace patina {

/// A run of sites, one after the other in the order of the image's rows.
struct SiteRun {
  std::size_t first = 0, count = 0;
  std::size_t end() const { return first + count; }
};

/// What the store holds of a run of sites. Zero-copy where the store is in memory (it must then not outlive
/// the store), a copy otherwise.
class SiteBlock {
 public:
  SiteBlock() = default;
  /// A look at records elsewhere: `stride` floats a site.
  SiteBlock(SiteRun run, std::size_t stride, const float* z, const float* even)
      : run_(run), stride_(stride), z_(z), even_(even) {}
  SiteRun run() const { return run_; }
  /// [frequency][re R G B, im R G B] of a site inside the run, numbered as everywhere.
  const float* z(std::size_t site) const { return z_ + (site - run_.first) * stride_; }
  /// [frequency][I0 + I2 R G B, I1 + I3 R G B], black level included.
  const float* even(std::size_t site) const { return even_ + (site - run_.first) * stride_; }

 private:
  friend class MeasurementStore;
  SiteRun run_;
  std::size_t stride_ = 0;
  const float *z_ = nullptr, *even_ = nullptr;
  std::vector<float> copy_;
};

/// Four photographs of every frequency at every site, as Z = (I1 - I3) - i (I0 - I2) and the two even sums
/// I0 + I2 and I1 + I3: the same information in other words, so that later stages never open a photograph
/// again. 48 bytes a site and frequency; in memory where that is allowed, else in a nameless scratch file
/// that is gone with the program, however it ends.
class MeasurementStore {
 public:
  enum Parts { kZ = 1, kEven = 2, kBoth = 3 };

  /// An empty store.
  MeasurementStore() = default;
  /// A store of zeros. In memory where it takes at most `memoryBytes` (and the system has them), else in a
  /// file in `scratchFolder` (empty: the system's folder for temporary files). Errors: WriteFailed where the
  /// disk has no room for it; it is taken at once, so that a full disk shows before any photograph is read.
  static Result<MeasurementStore> make(std::size_t siteCount, int frequencyCount, std::uint64_t memoryBytes,
                                       const std::filesystem::path& scratchFolder = {});
  /// What a store would take, in bytes.
  static std::uint64_t bytesFor(std::size_t siteCount, int frequencyCount) {
    return std::uint64_t{siteCount} * static_cast<std::uint64_t>(frequencyCount) * 12 * sizeof(float);
  }

  std::size_t siteCount() const { return siteCount_; }
  int frequencyCount() const { return frequencyCount_; }
  bool inMemory() const { return memory_ != nullptr; }
  bool empty() const { return siteCount_ == 0 || frequencyCount_ == 0; }

  /// The sites first .. first + count. Thread-safe. Where the scratch file can't be read, the block holds
  /// zeros and `failure` says why: stages ask for it at their end. `parts` saves reading what isn't needed.
  SiteBlock block(std::size_t first, std::size_t count, Parts parts = kBoth) const;
  SiteBlock block(SiteRun run, Parts parts = kBoth) const { return block(run.first, run.count, parts); }

  /// Replaces a run of sites: [site][frequency][6] each. Thread-safe for runs that don't overlap.
  Status write(SiteRun run, std::span<const float> z, std::span<const float> even);
  /// Direct access where the store is in memory, else null: [site][frequency][6].
  float* zInMemory() { return memory_.get(); }
  float* evenInMemory() { return memory_ ? memory_.get() + half() : nullptr; }

  /// The first read that failed.
  std::optional<Error> failure() const;

  /// Rows of a site that a saturated photograph spoils, ascending: 2 * frequency + {0: real part of Z and
  /// I1 + I3, 1: imaginary part and I0 + I2}. A row counts for all three channels: where one saturates, the
  /// others bleed. Empty for all but few sites. Cost: a binary search among the few.
  std::span<const std::uint16_t> droppedRows(std::size_t site) const;
  /// (site, row) pairs in any order; replaces what was there.
  void setDroppedRows(std::vector<std::pair<std::uint32_t, std::uint16_t>> rows);
  std::size_t droppedRowCount() const { return droppedRow_.size(); }

 private:
  std::size_t stride() const { return static_cast<std::size_t>(frequencyCount_) * 6; }
  std::size_t half() const { return siteCount_ * stride(); }
  void readFile(std::uint64_t at, float* to, std::size_t floats) const;

  struct Unmap {
    Unmap() : bytes(0) {}
    explicit Unmap(std::size_t mapped) : bytes(mapped) {}
    std::size_t bytes;
    void operator()(float* at) const;
  };
  struct File;

  std::size_t siteCount_ = 0;
  int frequencyCount_ = 0;
  std::unique_ptr<float[], Unmap> memory_;  ///< all z, then all even
  std::shared_ptr<File> file_;
  std::vector<std::uint32_t> droppedSite_;  ///< ascending
  std::vector<std::size_t> droppedFirst_;   ///< into droppedRow_; one more than droppedSite_
  std::vector<std::uint16_t> droppedRow_;
};

}  // namespace patina
