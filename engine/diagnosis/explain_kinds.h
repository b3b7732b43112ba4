#pragma once

#include "engine/diagnosis/explanation.h"

namespace patina {

/// `explain` for one kind of capture; the bundles are known to be of that kind.
Result<ExplanationPtr> explainFourier(const std::vector<std::filesystem::path>& bundles,
                                      const ExplainOptions& options, const JobContext& job);
Result<ExplanationPtr> explainTwoShot(const std::vector<std::filesystem::path>& bundles,
                                      const ExplainOptions& options, const JobContext& job);
Result<ExplanationPtr> explainFlash(const std::vector<std::filesystem::path>& bundles,
                                    const ExplainOptions& options, const JobContext& job);

Result<ExplanationPtr> explainFourierWith(const std::vector<std::filesystem::path>& bundles,
                                          const std::vector<std::string>& ids, const ExplainOptions& options,
                                          const JobContext& job);

}  // namespace patina
