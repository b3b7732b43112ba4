#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace patina {

/// `text` between single quotes, with control characters and broken UTF-8 shown as `\xNN` and anything after
/// 200 bytes cut off: what a stranger's file says may be repeated in a message without playing tricks on the
/// terminal.
std::string inQuotes(std::string_view text);

/// The candidate most like `word` (edit distance with swaps, letter case and `-` against `_` free), or empty
/// when none is within a third of the word's length. Cost: sum of the lengths times the word's length.
std::string nearestWord(std::string_view word, const std::vector<std::string>& candidates);

/// "1 photo", "3 photos": the number with its noun, plural by `s`.
std::string counted(std::size_t count, std::string_view noun);

}  // namespace patina
