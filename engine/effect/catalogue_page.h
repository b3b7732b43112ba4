#pragma once

#include <string>

namespace patina {

/// The catalogue as a page of Markdown, docs/effects.md: every effect by stage with its sentence, signature,
/// remedy, source and parameters. Made from what the effects' files register; a test holds the page to it.
std::string effectCataloguePage();

}  // namespace patina
