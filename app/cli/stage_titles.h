#pragma once

#include <string>
#include <string_view>

namespace patina::cli {

/// What a person reads for one of the engine's stage ids, for all verbs; the id itself where there is nothing
/// better to say. `--progress json` keeps the ids.
std::string stageTitle(std::string_view stage);

}  // namespace patina::cli
