#include "engine/twoshot/basis.h"

#include <cinttypes>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "app/cli/verbs.h"
#include "engine/base/text.h"
#include "engine/brdf/brdf_file.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

struct BasisArguments {
  std::vector<std::string> from;
  std::string out, file;
  bool json = false, allMaterials = false;
  BasisBuildOptions options;
};

template <typename... Values>
std::string formatted(const char* format, Values... values) {
  char buffer[512];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

/// Smallest number of components that hold a share of the variance.
int componentsFor(const Eigen::VectorXd& singularValues, double share) {
  const double all = singularValues.squaredNorm();
  double sum = 0;
  for (Eigen::Index i = 0; i < singularValues.size(); ++i) {
    sum += singularValues(i) * singularValues(i);
    if (sum >= share * all) return static_cast<int>(i) + 1;
  }
  return static_cast<int>(singularValues.size());
}

std::uint64_t sizeOf(const std::string& file) {
  std::error_code code;
  const std::uint64_t bytes = file.empty() ? 0 : fs::file_size(file, code);
  return code ? 0 : bytes;
}

void printInfo(const Basis& basis, std::uint64_t bytes, bool allMaterials, Context& context) {
  const auto say = [&](const std::string& line) { context.console.say(line); };
  say("Basis " + inQuotes(basis.name()) + ": " + counted(basis.materials().size(), "material") +
      formatted(", %d components of %d columns, checksum %016" PRIx64 " (verified)", basis.componentCount(),
                basis.columnCount(), basis.checksum()) +
      (bytes > 0 ? formatted(", %.1f MB", static_cast<double>(bytes) / 1e6) : std::string()) + ".");
  say("Source: " + basis.source());
  say(formatted("Cells: %zu of %zu of the MERL grid, %zu of them within %.0f degrees of the normal.",
                basis.cellCount(BasisRegion::All), MerlGrid::kCells, basis.cellCount(BasisRegion::Trusted),
                kTrustedAngleDeg));
  const Eigen::VectorXd& sigma = basis.singularValues();
  const double all = sigma.squaredNorm();
  say("Explained variance of the mapped columns:");
  double sum = 0;
  int next = 1;
  for (Eigen::Index i = 0; i < sigma.size(); ++i) {
    sum += sigma(i) * sigma(i);
    const int count = static_cast<int>(i) + 1;
    if (count != next && i + 1 != sigma.size()) continue;
    say(formatted("  %4d component%s %6.2f %%", count, count == 1 ? " " : "s", 100 * sum / all));
    next = next < 5 ? next + 1 : next * 2;
  }
  say(formatted("  95 %% need %d components, 99 %% need %d.", componentsFor(sigma, 0.95),
                componentsFor(sigma, 0.99)));
  std::map<std::string, int> formats;
  for (const BasisMaterial& material : basis.materials()) ++formats[material.format];
  std::string of;
  for (const auto& [format, count] : formats)
    of += (of.empty() ? "" : ", ") + std::to_string(count) + " " + (format.empty() ? "unnamed" : format);
  say("Materials (" + of + "):");
  if (allMaterials) {
    for (const BasisMaterial& material : basis.materials())
      say(formatted("  %016" PRIx64 " %12" PRIu64 " bytes  ", material.checksum, material.bytes) +
          material.name + " (" + material.format + ")" + (material.note.empty() ? "" : ": " + material.note));
    return;
  }
  std::string line = " ";
  for (const BasisMaterial& material : basis.materials()) {
    if (line.size() + material.name.size() > 100) {
      say(line);
      line = " ";
    }
    line += " " + material.name;
  }
  say(line);
}

void printJson(const Basis& basis, std::uint64_t bytes, Context& context) {
  using Json = nlohmann::ordered_json;
  Json json = {{"name", basis.name()},
               {"source", basis.source()},
               {"components", basis.componentCount()},
               {"columns", basis.columnCount()},
               {"cells", basis.cellCount(BasisRegion::All)},
               {"cells_trusted", basis.cellCount(BasisRegion::Trusted)},
               {"checksum", formatted("%016" PRIx64, basis.checksum())},
               {"checksum_verified", true}};
  if (bytes > 0) json["bytes"] = bytes;
  const Eigen::VectorXd& sigma = basis.singularValues();
  Json explained = Json::array();
  double sum = 0;
  for (Eigen::Index i = 0; i < sigma.size(); ++i)
    explained.push_back((sum += sigma(i) * sigma(i)) / sigma.squaredNorm());
  json["explained_variance"] = explained;
  json["materials"] = Json::array();
  for (const BasisMaterial& material : basis.materials())
    json["materials"].push_back({{"name", material.name},
                                 {"format", material.format},
                                 {"note", material.note},
                                 {"checksum", formatted("%016" PRIx64, material.checksum)},
                                 {"bytes", material.bytes}});
  context.console.say(json.dump(1, ' ', false, nlohmann::json::error_handler_t::replace));
}

/// The files that are named, and those in the folders that are.
Result<std::vector<fs::path>> filesFrom(const std::vector<std::string>& names) {
  std::vector<fs::path> files;
  for (const std::string& name : names) {
    std::error_code code;
    if (!fs::is_directory(name, code)) {
      if (!fs::exists(name, code))
        return Error{ErrorCode::NotFound, "there is nothing there", name,
                     "name folders of measured BRDFs, or the files themselves"};
      files.emplace_back(name);
      continue;
    }
    const Result<std::vector<fs::path>> found = listBrdfFiles(name);
    if (!found) return found.error();
    if (found->empty())
      return Error{ErrorCode::NotFound, "the folder holds no measured BRDF", name,
                   "a folder with files ending in .binary (MERL), .bsdf (RGL), .dat or .alta (ALTA)"};
    files.insert(files.end(), found->begin(), found->end());
  }
  return files;
}

int runBuild(BasisArguments& arguments, Context& context) {
  if (arguments.options.components < 0)
    return context.misuse("--components can't be negative; 0 keeps all. Try: --components 100.");
  const Result<std::vector<fs::path>> files = filesFrom(arguments.from);
  if (!files) return context.fail(files.error());
  if (arguments.options.name.empty()) arguments.options.name = fs::path(arguments.out).stem().string();
  const Result<BasisPtr> built = buildBasis(*files, arguments.out, arguments.options, context.job());
  context.console.finishProgress();
  if (!built) return context.fail(built.error());
  printInfo(**built, sizeOf(arguments.out), false, context);
  context.console.say("The basis is in " + arguments.out + "; use it with --basis.");
  return kDone;
}

int runInfo(const BasisArguments& arguments, Context& context) {
  const bool builtIn = arguments.file == "built-in";
  const Result<BasisPtr> basis = basisFor(builtIn ? std::string() : arguments.file, context.job());
  context.console.finishProgress();
  if (!basis) return context.fail(basis.error());
  const std::uint64_t bytes = builtIn ? 0 : sizeOf(arguments.file);
  if (arguments.json) {
    printJson(**basis, bytes, context);
  } else {
    printInfo(**basis, bytes, arguments.allMaterials, context);
  }
  return kDone;
}

}  // namespace

void addBasisVerb(CLI::App& program, Context& context) {
  CLI::App* verb =
      program.add_subcommand("basis", "Builds a basis from measured BRDFs, or tells what one holds");
  verb->set_help_flag("-h,--help", "Print this help; 'patina-cli basis build --help' says more");
  verb->require_subcommand(1);
  auto arguments = std::make_shared<BasisArguments>();

  CLI::App* build = verb->add_subcommand("build", "Builds a basis from folders of measured BRDFs");
  build->set_help_flag("-h,--help", "Print this help");
  build
      ->add_option("FOLDER", arguments->from,
                   "Folders (not below them) or files: MERL .binary, RGL .bsdf, ALTA .dat and .alta")
      ->required()
      ->option_text("...");
  build
      ->add_option("--out", arguments->out,
                   "File for the basis; an earlier one is replaced when this is whole")
      ->required()
      ->option_text("FILE");
  build->add_flag("--with-built-in", arguments->options.withBuiltIn,
                  "Add to the 100 built-in materials instead of replacing them");
  build
      ->add_option("--components", arguments->options.components,
                   "Components to keep; 0: all that matter. Fewer: a smaller file, a coarser basis\n"
                   "[default: 0]")
      ->option_text("K");
  build->add_option("--name", arguments->options.name, "Kept in the file [default: the file's]")
      ->option_text("NAME");
  addCommonOptions(*build, context);
  build->callback([arguments, &context] {
    context.run = [arguments, &context] { return runBuild(*arguments, context); };
  });

  CLI::App* info = verb->add_subcommand("info", "Tells what a basis holds, and checks it");
  info->set_help_flag("-h,--help", "Print this help");
  info->add_option("FILE", arguments->file, "A basis, or: built-in")
      ->required()
      ->option_text("FILE|built-in");
  info->add_flag("--materials", arguments->allMaterials, "List every material with its origin and checksum");
  info->add_flag("--json", arguments->json, "Print all of it as JSON");
  addCommonOptions(*info, context);
  info->callback([arguments, &context] {
    context.run = [arguments, &context] { return runInfo(*arguments, context); };
  });
}

}  // namespace patina::cli
