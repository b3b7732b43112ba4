#include <string_view>

#include "engine/base/text.h"
#include "engine/brdf/analytic_brdf.h"
#include "engine/brdf/brdf_file.h"
#include "engine/brdf/neural_brdf.h"

namespace patina {

Result<BrdfPtr> openBrdf(const std::string& source) {
  constexpr std::string_view kAnalytic = "analytic:", kBuiltIn = "built-in:";
  if (source.starts_with(kAnalytic)) {
    return parseAnalyticBrdf(std::string_view(source).substr(kAnalytic.size()));
  }
  if (!source.starts_with(kBuiltIn)) return readBrdf(source);
  const std::string name = source.substr(kBuiltIn.size());
  for (const BrdfPtr& brdf : builtInNeuralBrdfs()) {
    if (brdf->origin().name == name) return brdf;
  }
  const std::string nearest = nearestWord(name, builtInNeuralNames());
  return Error{ErrorCode::Unsupported, inQuotes(name) + " is no built-in material", "",
               nearest.empty()
                   ? "a name of the MERL database, such as built-in:" + builtInNeuralNames().front()
                   : std::string(kBuiltIn) + nearest};
}

}  // namespace patina
