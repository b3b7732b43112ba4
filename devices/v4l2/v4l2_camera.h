#pragma once

#include <memory>
#include <string>
#include <vector>

#include "engine/acquire/camera_device.h"

namespace patina {

/// Video4Linux cameras: USB ones (UVC), raw sensors behind a simple driver. Ids: "v4l2:BUS" with the bus
/// information that the driver gives ("usb-0000:00:14.0-1"), where several devices share it "v4l2:BUS#2", or
/// "v4l2:/dev/videoN".
///
/// Settings act late and drivers say nothing of it in a frame: the metadata carry exposure and gain from the
/// `settleFrames`-th frame after a setting on (by sequence number, lost frames counted), and nothing before.
/// Exposure: V4L2_CID_EXPOSURE_ABSOLUTE (units of 0.1 ms, automatic off by V4L2_CID_EXPOSURE_AUTO); where it
/// is missing the older V4L2_CID_EXPOSURE, whose unit no driver defines: taken as lines is not possible, so
/// as 0.1 ms too, and said so in the control's name. Every setting is read back.
class V4l2Provider : public CameraProvider {
 public:
  /// `settleFrames`: until a setting acts; measured on USB cameras by others: 2 to 4.
  explicit V4l2Provider(int settleFrames = 4) : settleFrames_(settleFrames) {}
  std::string backend() const override { return "v4l2"; }
  Result<std::vector<CameraInfo>> list() override;
  Result<std::unique_ptr<CameraDevice>> open(const std::string& id) override;

 private:
  int settleFrames_;
};

}  // namespace patina
