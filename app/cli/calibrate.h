#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "app/cli/verbs.h"
#include "engine/calibration/calibration_file.h"
#include "engine/image/photo_file.h"

/// What the parts of `patina-cli calibrate` share.
namespace patina::cli {

/// What all of them take.
struct CalibrateArguments {
  std::vector<std::string> photos;
  std::string out, device;
};

/// Adds PHOTO..., --out and --device, and the options of every verb.
void addCalibrateOptions(CLI::App& verb, CalibrateArguments* arguments, Context& context, const char* photos);

/// A record of now, with what the arguments say; `residual` in `unit`.
CalibrationRecord recordNow(const CalibrateArguments& arguments, StoredCalibration content, double residual,
                            const char* unit, const std::vector<std::string>& remarks);
/// Fails before any work where --out can't be written.
Status checkCalibrationOut(const std::string& out);
/// Writes it and says so; exit status.
int finishCalibration(const CalibrateArguments& arguments, const CalibrationRecord& record, Context& context);

/// The photograph: PNG, JPEG, OpenEXR; and RAW and TIFF as the cameras' folder reads them.
Result<PhotoFile> readPhotoOrRaw(const std::string& file);
/// The photograph, with `encoding` ("srgb", "gamma:2.2", "response:FILE") undone; a linear one must have
/// none.
Result<Image> readLinearPhoto(const std::string& file, const std::string& encoding);
/// Numbers between commas; false where it is anything else.
bool readNumbers(const std::string& text, std::vector<double>* numbers);

void addCalibrateCamera(CLI::App& verb, Context& context);    // calibrate.cpp
void addCalibrateBoard(CLI::App& verb, Context& context);     // calibrate.cpp
void addCalibrateScreen(CLI::App& verb, Context& context);    // calibrate_screen.cpp
void addCalibrateWhite(CLI::App& verb, Context& context);     // calibrate_white.cpp
void addCalibrateResponse(CLI::App& verb, Context& context);  // calibrate_response.cpp
void addCalibrateRecheck(CLI::App& verb, Context& context);   // calibrate_recheck.cpp
void addCalibrateMerge(CLI::App& verb, Context& context);     // calibrate_recheck.cpp

template <typename... Values>
std::string worded(const char* format, Values... values) {
  char buffer[512];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

}  // namespace patina::cli
