#pragma once

#include <string>
#include <string_view>

namespace patina::test {

/// Reads a page as XML would (tags closed in order, attributes quoted and named once, entities known, no bare
/// markup); "" where it is well-formed, else what is wrong and where. A reader of its own, so that the test
/// shares nothing with what wrote the page.
std::string whyNotWellFormed(std::string_view page);

}  // namespace patina::test
