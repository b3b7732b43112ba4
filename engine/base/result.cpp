#include "engine/base/result.h"

namespace patina {

std::string Error::sentence() const {
  std::string text = what;
  if (!where.empty()) text += " (" + where + ")";
  text += ".";
  if (!tryThis.empty()) text += " Try: " + tryThis + ".";
  return text;
}

}  // namespace patina
