#pragma once

#include <stop_token>

namespace patina::cli {

/// A token that Ctrl-C, SIGTERM and a closed terminal stop. The first one asks the work to end in order; a
/// second ends the program at once with status 4. Call once, at the start of `main`, before any thread
/// exists.
std::stop_token stopOnInterrupt();

/// Whether the signals' own sentences on stderr are left out, where programs read it.
void sayNothingOnInterrupt(bool silent);

}  // namespace patina::cli
