#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/capture/capture.h"
#include "engine/fourier/measurement_store.h"
#include "engine/fourier/options.h"
#include "engine/fourier/solver.h"

namespace patina {

/// Solutions of finished runs of sites, kept in a file so that a fit that was cancelled or killed goes on
/// where it was. One file, written at its end alone: a header with the fit's fingerprint, then records, each
/// with a checksum. What a kill left of the last record is ignored and cut off. A file of another fit (other
/// photographs, options or program) is started afresh.
class FinishedTiles {
 public:
  static constexpr const char* kFileName = "tiles.bin";

  /// Keeps nothing.
  FinishedTiles();
  /// Opens or makes `folder`/tiles.bin. A folder that can't be written gives WriteFailed.
  static Result<FinishedTiles> open(const std::filesystem::path& folder, std::uint64_t fingerprint);
  FinishedTiles(FinishedTiles&&) noexcept;
  FinishedTiles& operator=(FinishedTiles&&) noexcept;
  ~FinishedTiles();

  /// Whether anything is kept at all.
  bool active() const { return file_ != nullptr; }
  /// Fills the solutions of a run that was saved before, of the same stage (a number of the caller's) and
  /// with the same first site and count; false where there is none. Thread-safe.
  bool load(int stage, SiteRun run, std::span<SiteSolution> solutions) const;
  /// Appends a run; a later one of the same stage and place replaces it. Thread-safe. A full disk isn't an
  /// error of the fit: nothing more is kept then, and `failure` says why.
  void save(int stage, SiteRun run, std::span<const SiteSolution> solutions);
  std::optional<Error> failure() const;

 private:
  struct File;
  std::unique_ptr<File> file_;
};

/// What decides whether kept solutions belong to this fit: the bytes of capture.json, name, size and time of
/// change of every photograph, the options that change solutions, the layout of a solution, and the
/// instruction set (lanes of another length end in other roundings).
std::uint64_t fitFingerprint(const FourierCapture& capture, const FourierFitOptions& options,
                             std::size_t siteCount);

}  // namespace patina
