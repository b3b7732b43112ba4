// The engine's diagnosis, as the window asks for it.
#include "app/window/services.h"
#include "engine/report/explanation_files.h"

namespace patina {

void Services::addExplain() {
  readFlash = [](const std::filesystem::path& folder, const JobContext& job) {
    return readFlashCapture(folder, job);
  };
  writeExplanation = [](const std::filesystem::path& folder, const Explanation& explanation) {
    return patina::writeExplanation(folder, explanation);
  };
}

}  // namespace patina
