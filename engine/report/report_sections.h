#pragma once

#include <string>

#include "engine/diagnosis/explanation.h"

namespace patina::report {

/// The report's parts, as well-formed elements; each is empty where the explanation has nothing for it.
std::string heading(const Explanation& explanation);
std::string addedEffects(const Explanation& explanation);
std::string photographPictures(const Explanation& explanation);
std::string whereItSits(const Explanation& explanation);
std::string photographTable(const Explanation& explanation);
std::string consideredEffects(const Explanation& explanation);
std::string apart(const Explanation& explanation);
std::string budget(const Explanation& explanation);
std::string remarks(const Explanation& explanation);

}  // namespace patina::report
