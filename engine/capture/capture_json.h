#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "engine/base/result.h"
#include "engine/capture/capture.h"

namespace patina {

/// The description that the text of a capture.json gives, with everything checked that can be checked without
/// looking at a file. `folder` becomes `FourierCapture::folder`, `where` names the text in errors. Errors as
/// `readFourierCapture`. No text, however broken, throws or crashes (fuzzed).
Result<FourierCapture> parseFourierCapture(std::string_view text, const std::filesystem::path& folder,
                                           const std::string& where);

/// The text of capture.json for a description, indented, newline at the end. Numbers keep all their digits.
std::string fourierCaptureJson(const FourierCapture& capture);

}  // namespace patina
