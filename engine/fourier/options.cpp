#include "engine/fourier/options.h"

namespace patina {

std::vector<std::string> FourierFitOptions::validate() const {
  std::vector<std::string> problems;
  if (size < 0 || size > 16384)
    problems.push_back("size must lie in 0..16384 texels (0: what the photographs resolve)");
  if (maxIterations < 1 || maxIterations > 1000) problems.push_back("maxIterations must lie in 1..1000");
  if (memoryLimitBytes < std::uint64_t{1} << 20)
    problems.push_back("memoryLimitBytes must be 1 MiB at least");
  if (!(tolerance > 0 && tolerance < 1)) problems.push_back("tolerance must lie between 0 and 1");
  return problems;
}

}  // namespace patina
