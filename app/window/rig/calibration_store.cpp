#include "app/window/rig/calibration_store.h"

#include <algorithm>
#include <cstdio>
#include <ctime>

#include "engine/image/exr.h"

namespace patina {

namespace fs = std::filesystem;

namespace {

/// "20260301-142305", UTC.
std::string stampOf(std::chrono::system_clock::time_point taken) {
  const std::time_t time = std::chrono::system_clock::to_time_t(taken);
  std::tm parts{};
  gmtime_r(&time, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y%m%d-%H%M%S", &parts);
  return text;
}

Error notWritten(const fs::path& where, const std::error_code& code) {
  return {ErrorCode::WriteFailed, "the calibration can't be kept: " + code.message(), where.string(),
          "choose a folder that can be written to"};
}

}  // namespace

Result<CalibrationRecord> CalibrationStore::inUse(const std::string& kind) const {
  return readCalibration(file(kind), kind);
}

std::vector<CalibrationStore::Entry> CalibrationStore::list(const std::string& kind) const {
  std::vector<Entry> entries;
  std::error_code code;
  for (const auto& found : fs::directory_iterator(folder_ / "earlier", code)) {
    const std::string name = found.path().filename().string();
    if (!name.starts_with(kind + "-") || found.path().extension() != ".json") continue;
    if (auto record = readCalibration(found.path(), kind); record)
      entries.push_back({found.path(), std::move(*record), false});
  }
  std::sort(entries.begin(), entries.end(),
            [](const Entry& a, const Entry& b) { return a.record.taken > b.record.taken; });
  if (auto record = inUse(kind); record)
    entries.insert(entries.begin(), {file(kind), std::move(*record), true});
  return entries;
}

Status CalibrationStore::setAside(const std::string& kind) const {
  std::error_code code;
  if (!fs::exists(file(kind), code)) return Done{};
  std::string stamp = "unreadable";
  std::string map;
  if (const auto record = inUse(kind); record) {
    stamp = stampOf(record->taken);
    if (const auto* tile = std::get_if<StoredWhiteTile>(&record->content)) map = tile->mapFile;
  }
  const fs::path earlier = folder_ / "earlier";
  fs::create_directories(earlier, code);
  if (code) return notWritten(earlier, code);
  std::string name = kind + "-" + stamp;
  for (int again = 2; fs::exists(earlier / (name + ".json"), code); ++again)
    name = kind + "-" + stamp + "-" + std::to_string(again);
  // A map keeps the name that its file gives it.
  if (!map.empty() && fs::exists(folder_ / map, code))
    fs::copy_file(folder_ / map, earlier / map, fs::copy_options::overwrite_existing, code);
  fs::copy_file(file(kind), earlier / (name + ".json"), code);
  if (code) return notWritten(earlier, code);
  return Done{};
}

Status CalibrationStore::keep(CalibrationRecord record, const Image* map) const {
  const std::string kind(kindOf(record.content));
  std::error_code code;
  fs::create_directories(folder_, code);
  if (code) return notWritten(folder_, code);
  if (Status aside = setAside(kind); !aside) return aside;
  if (auto* tile = std::get_if<StoredWhiteTile>(&record.content); tile && map) {
    // Under the date: the file that is in use still names the map before.
    tile->mapFile = kind + "-" + stampOf(record.taken) + ".exr";
    const Status written =
        writeExr(folder_ / tile->mapFile, *map, {"R", "G", "B"},
                 {{"what", "irradiance times the cosine of incidence, pixel units a second"}});
    if (!written) return written;
  }
  return writeCalibration(file(kind), record);
}

Status CalibrationStore::restore(const fs::path& earlier) const {
  auto record = readCalibration(earlier);
  if (!record) return record.error();
  std::error_code code;
  if (const auto* tile = std::get_if<StoredWhiteTile>(&record->content); tile && !tile->mapFile.empty()) {
    const fs::path map = earlier.parent_path() / tile->mapFile;
    if (fs::exists(map, code))
      fs::copy_file(map, folder_ / tile->mapFile, fs::copy_options::overwrite_existing, code);
  }
  return keep(std::move(*record));
}

std::string recordInWords(const CalibrationRecord& record, std::chrono::system_clock::time_point now) {
  char residual[48];
  std::snprintf(residual, sizeof residual, "%.2f %s", record.residual, record.residualUnit.c_str());
  std::string words = std::string(residual) + ", " + ageInWords(record.taken, now);
  if (!record.device.empty()) words += ", " + record.device;
  return words;
}

}  // namespace patina
