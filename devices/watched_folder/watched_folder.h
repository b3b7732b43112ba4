#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "engine/acquire/camera_device.h"

namespace patina {

/// A photograph from a file as a camera's frame: RAW by LibRaw (the sensor's own numbers, linear, black and
/// white level of the file), EXR (linear), TIFF (16-bit and float linear, 8-bit display-encoded), PNG (16-bit
/// linear, 8-bit display-encoded), JPEG (display-encoded). Exposure from the RAW's own record. Errors:
/// NotFound, Unsupported (another ending, or a sensor that is no Bayer one), Malformed.
Result<Frame> readPhotograph(const std::filesystem::path& file);
/// Whether `readPhotograph` knows the ending.
bool isPhotograph(const std::filesystem::path& file);

/// A folder as a camera, "folder:PATH": whoever shoots (a tethering program, a card reader) puts files into
/// it. `still` waits for files that were not there when it was opened, in order of their names where several
/// come, and until each is whole (its size is at rest, nobody has it open for writing as far as its lock
/// says, and it can be read). Settings are the camera's own: no controls. With "?existing" at the id's end
/// the files that are there already count too, in order: a finished set.
class WatchedFolderProvider : public CameraProvider {
 public:
  std::string backend() const override { return "folder"; }
  /// None: any folder can be one.
  Result<std::vector<CameraInfo>> list() override { return std::vector<CameraInfo>{}; }
  Result<std::unique_ptr<CameraDevice>> open(const std::string& id) override;
};

}  // namespace patina
