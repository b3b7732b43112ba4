#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "engine/acquire/pattern_display.h"
#include "engine/base/result.h"

namespace patina {

/// Every screen that is there, in physical pixels, with what speaks against measuring on it.
std::vector<ScreenInfo> screensThere();

/// A pattern window over one of them: full-screen, pixel for pixel, no cursor; it stays until the last copy
/// is gone. Call it on the window's thread; the last copy may go away on any. `observer` (may be null, else
/// outlives it) is given everything that is drawn, and its clock is kept. `left`: called on the window's
/// thread when the window ends by itself, with why: the person pressed Esc, the monitor is gone or changed
/// its mode; `show` is Refused from then on. Errors: NotFound (no such screen).
Result<std::shared_ptr<PatternDisplay>> openPatternWindow(const std::string& screenId,
                                                          GlassObserver* observer,
                                                          std::function<void(const Error&)> left);

}  // namespace patina
