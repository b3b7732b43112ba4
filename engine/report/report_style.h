#pragma once

namespace patina {

/// The report's style sheet and its script. Neither holds a character that XML would want escaped, so that
/// the page can be read by XML tools.
extern const char* const kReportStyle;
extern const char* const kReportScript;

}  // namespace patina
