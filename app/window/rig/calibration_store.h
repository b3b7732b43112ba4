#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/calibration/calibration_file.h"

namespace patina {

/// The calibrations that are kept of a rig: one file a kind that is in use, and those that it replaced. Holds
/// nothing but the folder; any number may look at one.
class CalibrationStore {
 public:
  explicit CalibrationStore(std::filesystem::path folder) : folder_(std::move(folder)) {}

  struct Entry {
    std::filesystem::path file;
    CalibrationRecord record;
    bool inUse = false;  ///< else one that was replaced
  };

  const std::filesystem::path& folder() const { return folder_; }
  /// FOLDER/KIND.json, whether there is one or not.
  std::filesystem::path file(const std::string& kind) const { return folder_ / (kind + ".json"); }
  /// The one in use. Errors: NotFound, and those of reading it.
  Result<CalibrationRecord> inUse(const std::string& kind) const;
  /// All of a kind, the one in use first, then the newest; files that can't be read are left out.
  std::vector<Entry> list(const std::string& kind) const;
  /// Makes the folder, moves what is in use to FOLDER/earlier/KIND-DATE.json, and puts this in its place.
  /// `map`: a white tile's irradiance, written beside as KIND.exr and named in the record; null: none.
  /// Errors: WriteFailed; what was in use then still is.
  Status keep(CalibrationRecord record, const Image* map = nullptr) const;
  /// Puts an earlier one back in use. Errors: those of reading and writing.
  Status restore(const std::filesystem::path& earlier) const;

 private:
  Status setAside(const std::string& kind) const;
  std::filesystem::path folder_;
};

/// "0.18 px, 3 days ago, USB camera": for lists.
std::string recordInWords(const CalibrationRecord& record, std::chrono::system_clock::time_point now);

}  // namespace patina
