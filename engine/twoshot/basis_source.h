#pragma once

#include <string>

#include "engine/twoshot/basis.h"

namespace patina {

/// The materials that a basis is built from, opened one by one.
class BasisSource {
 public:
  virtual ~BasisSource() = default;
  virtual std::size_t count() const = 0;
  /// Material `i`; fills in what is known of it. Called from several threads.
  virtual Result<BrdfPtr> open(std::size_t i, BasisMaterial& material) const = 0;
  /// Origin and licence, a sentence.
  virtual std::string description() const = 0;
};

Result<BasisPtr> buildBasisFrom(const BasisSource& source, const std::filesystem::path& out,
                                const BasisBuildOptions& options, const JobContext& job);

/// Origin and licence of the built-in materials.
std::string builtInSource();

}  // namespace patina
