// The engine's diagnosis, as the window asks for it.
#include "app/window/services.h"
#include "engine/report/explanation_files.h"

namespace patina {

void Services::addExplain() {
  readFlash = [](const std::filesystem::path& folder, const JobContext& job) {
    return readFlashCapture(folder, job);
  };
#ifdef PATINA_HAS_EXPLAIN
  explain = [](const std::vector<std::filesystem::path>& bundles, const ExplainOptions& options,
               const JobContext& job) { return patina::explain(bundles, options, job); };
  explainWith = [](const std::vector<std::filesystem::path>& bundles, const std::vector<std::string>& ids,
                   const ExplainOptions& options,
                   const JobContext& job) { return patina::explainWith(bundles, ids, options, job); };
#endif
  writeExplanation = [](const std::filesystem::path& folder, const Explanation& explanation) {
    return patina::writeExplanation(folder, explanation);
  };
}

}  // namespace patina
