#include <unistd.h>

#include <mutex>

#include "engine/base/cache_folder.h"
#include "engine/brdf/neural_brdf.h"
#include "engine/twoshot/basis.h"
#include "engine/twoshot/basis_format.h"
#include "engine/twoshot/basis_source.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

/// Raised whenever what is made from the same weights changes (grid, mapping, file layout).
constexpr int kRecipe = 1;

/// The cached file's name: another set of weights or another recipe is another file.
std::string cacheName() {
  const std::span<const std::byte> weights = builtInNeuralWeights();
  const std::uint64_t checksum =
      contentChecksum({reinterpret_cast<const char*>(weights.data()), weights.size()});
  return "built-in-" + std::to_string(kRecipe) + "-" + checksumText(checksum) + ".basis";
}

class BuiltInSource : public BasisSource {
 public:
  std::size_t count() const override { return builtInMaterials().size(); }
  Result<BrdfPtr> open(std::size_t i, BasisMaterial& material) const override {
    const BrdfPtr& brdf = builtInMaterials()[i];
    material = {brdf->origin().name, brdf->origin().format, brdf->origin().note, 0, 0};
    return brdf;
  }
  std::string description() const override { return builtInSource(); }
};

/// Whether a file can be made in a folder that exists.
bool writable(const fs::path& folder) {
  return ::access(folder.c_str(), W_OK | X_OK) == 0;
}

Result<BasisPtr> makeBuiltIn(const JobContext& job) {
  BasisBuildOptions options;
  options.name = "built-in";
  std::error_code code;
  const fs::path folder = cacheFolder();
  if (!folder.empty()) {
    const fs::path file = folder / cacheName();
    if (fs::exists(file, code)) {
      Result<BasisPtr> cached = openBasis(file, job);
      if (cached || cached.error().code == ErrorCode::Cancelled) return cached;
      job.warn("The kept copy of the built-in basis is damaged and is made again (" +
               cached.error().sentence() + ")");
    }
    fs::create_directories(folder, code);
    if (!code && writable(folder)) {
      job.info("Making the built-in basis in " + folder.string() + " (once; some ten seconds)");
      Result<BasisPtr> built = buildBasisFrom(BuiltInSource(), file, options, job);
      if (built || built.error().code != ErrorCode::WriteFailed) return built;
      job.warn(built.error().sentence());
    }
  }
  // Nowhere to keep it: a temporary file, whose name goes at once and whose content when the last user does.
  const fs::path temporary = fs::temp_directory_path(code);
  if (code) return Error{ErrorCode::WriteFailed, "There is no folder for temporary files", {}, "set TMPDIR"};
  job.warn("The built-in basis can't be kept" + (folder.empty() ? std::string() : " in " + folder.string()) +
           " and is made for this run only; set PATINA_CACHE to a folder with 1 GB free");
  const fs::path file = temporary / ("patina-" + std::to_string(::getpid()) + "-" + cacheName());
  Result<BasisPtr> built = buildBasisFrom(BuiltInSource(), file, options, job);
  fs::remove(file, code);
  return built;
}

}  // namespace

const std::vector<BrdfPtr>& builtInMaterials() {
  return builtInNeuralBrdfs();
}

std::string builtInSource() {
  return "the 100 materials of the MERL BRDF database (Matusik et al. 2003) as fitted by neural networks "
         "(Sztrajman, "
         "Rainer, Ritschel, Weyrich: Neural BRDF Representation and Importance Sampling, 2021; weights under "
         "the MIT "
         "licence)";
}

Result<BasisPtr> builtInBasis(const JobContext& job) {
  // Made once a process, kept while someone holds it; a failure is tried again.
  static std::mutex mutex;
  static std::weak_ptr<const Basis> kept;
  const std::lock_guard lock(mutex);
  if (BasisPtr basis = kept.lock()) return basis;
  Result<BasisPtr> made = makeBuiltIn(job);
  if (made) kept = *made;
  return made;
}

Result<BasisPtr> basisFor(const fs::path& file, const JobContext& job) {
  return file.empty() ? builtInBasis(job) : openBasis(file, job);
}

}  // namespace patina
