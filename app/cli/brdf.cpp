#include <sys/resource.h>

#include <chrono>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "app/cli/verbs.h"
#include "engine/base/text.h"
#include "engine/brdf/brdf_file.h"
#include "engine/brdf/brdf_summary.h"
#include "engine/brdf/tabulated_brdf.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr const char* kSources =
    "A MERL .binary file, an RGL _rgb.bsdf file, an ALTA table,\n"
    "built-in:NAME (a material of the MERL database, from its published fit), or\n"
    "analytic:MODEL?key=value&key=value with MODEL lambert, blinn, beckmann, ggx,\n"
    "ggx-anisotropic or ward and the keys diffuse, specular (one number or r,g,b),\n"
    "alpha, alphaX, alphaY, exponent";

struct BrdfArguments {
  std::vector<std::string> sources;
  std::string out, to = "merl";
  bool json = false;
  int azimuths = 16;
};

std::string format(const char* pattern, ...) __attribute__((format(printf, 1, 2)));
std::string format(const char* pattern, ...) {
  char buffer[512];
  va_list values;
  va_start(values, pattern);
  std::vsnprintf(buffer, sizeof buffer, pattern, values);
  va_end(values);
  return buffer;
}

double degrees(double radians) {
  return radians * 180 / std::numbers::pi;
}

ordered_json triple(const Eigen::Array3d& a) {
  return {a[0], a[1], a[2]};
}

/// One text for the whole answer, so that a program can parse it. Names come from strangers' files.
void sayJson(const ordered_json& json, Context& context) {
  context.console.say(json.dump(2, ' ', false, ordered_json::error_handler_t::replace));
}

void sayInfo(const Brdf& brdf, const BrdfSummary& summary, Context& context) {
  const auto say = [&](const char* name, const std::string& text) {
    context.console.say(format("  %-13s ", name) + text);
  };
  const BrdfOrigin& origin = brdf.origin();
  context.console.say(inQuotes(origin.name));
  say("format", origin.format + (origin.file.empty() ? "" : ", " + origin.file));
  if (!origin.note.empty()) say("note", origin.note);
  say("symmetry", brdf.isotropic()
                      ? std::string("isotropic")
                      : "anisotropic: RMS over azimuths " + format("%.3f ln", summary.azimuthLogRms));
  say("known", format("%.1f %% of the directions above the surface", 100 * summary.knownShare));
  for (const BrdfSummary::Albedo& albedo : summary.albedo) {
    std::string text = format("%.4f %.4f %.4f", albedo.value[0], albedo.value[1], albedo.value[2]);
    if (albedo.knownShare < 0.9995) {
      text += format(", of the %.1f %% of the views that are known", 100 * albedo.knownShare);
    }
    say(format("albedo %g deg", albedo.lightDeg).c_str(), text);
  }
  for (const BrdfSummary::Albedo& albedo : summary.albedo) {
    constexpr double kBeyondDoubt = 1.02;  // the quadrature errs by less
    if (!(albedo.value.maxCoeff() > kBeyondDoubt)) continue;
    say("warning",
        format("more light leaves than arrives at %g degrees: a wrong scale, or errors of the measurement",
               albedo.lightDeg));
  }
  say("reciprocity",
      format("RMS %.4f ln between a direction pair and its reverse", summary.reciprocityLogRms));
  say("range", format("%.3g to %.3g 1/sr", summary.least.minCoeff(), summary.largest.maxCoeff()));
}

ordered_json jsonOf(const BrdfOrigin& origin) {
  return {{"name", origin.name}, {"format", origin.format}, {"file", origin.file}, {"note", origin.note}};
}

ordered_json infoJson(const Brdf& brdf, const BrdfSummary& summary) {
  ordered_json json = jsonOf(brdf.origin());
  json["isotropic"] = brdf.isotropic();
  json["azimuth_log_rms"] = summary.azimuthLogRms;
  json["known_share"] = summary.knownShare;
  for (const BrdfSummary::Albedo& albedo : summary.albedo) {
    json["albedo"].push_back(
        {{"light_deg", albedo.lightDeg}, {"rgb", triple(albedo.value)}, {"known_share", albedo.knownShare}});
  }
  json["reciprocity_log_rms"] = summary.reciprocityLogRms;
  json["least_per_sr"] = triple(summary.least);
  json["largest_per_sr"] = triple(summary.largest);
  return json;
}

/// --stats. Beside JSON nothing else may stand on stdout.
void sayStats(const BrdfArguments& arguments, std::chrono::steady_clock::duration took, Context& context) {
  struct rusage usage {};
  ::getrusage(RUSAGE_SELF, &usage);
  const std::string line = format("%.2f s, peak memory %.0f MiB", std::chrono::duration<double>(took).count(),
                                  usage.ru_maxrss / 1024.0);
  if (arguments.json) {
    context.console.complain(line);
  } else {
    context.console.say(line);
  }
}

int runInfo(const BrdfArguments& arguments, Context& context) {
  int status = kDone;
  ordered_json all = ordered_json::array();
  for (const std::string& source : arguments.sources) {
    const Result<BrdfPtr> brdf = openBrdf(source);
    if (!brdf) {
      status = context.fail(brdf.error());
      continue;  // the others are still worth knowing
    }
    const Result<BrdfSummary> summary = summariseBrdf(**brdf, context.job());
    if (!summary) return context.fail(summary.error());
    context.console.finishProgress();
    if (arguments.json) {
      all.push_back(infoJson(**brdf, *summary));
    } else {
      sayInfo(**brdf, *summary, context);
    }
  }
  if (arguments.json) sayJson(all, context);
  return status;
}

int runConvert(const BrdfArguments& arguments, Context& context) {
  const std::string& source = arguments.sources.front();
  std::error_code ignored;
  if (fs::equivalent(source, arguments.out, ignored)) {
    return context.misuse(arguments.out + " is the file that is read. Try: another name after --out.");
  }
  const Result<BrdfPtr> brdf = openBrdf(source);
  if (!brdf) return context.fail(brdf.error());
  // A table is a MERL table already: nothing is to be sampled, and nothing is lost.
  std::shared_ptr<const TabulatedBrdf> table = std::dynamic_pointer_cast<const TabulatedBrdf>(*brdf);
  if (!table) {
    Result<std::shared_ptr<const TabulatedBrdf>> sampled =
        tabulate(**brdf, context.job(), arguments.azimuths);
    if (!sampled) return context.fail(sampled.error());
    table = madeReciprocal(**sampled);
  }
  context.console.finishProgress();
  const Status written = writeMerl(arguments.out, *table);
  if (!written) return context.fail(written.error());
  std::string sentence = arguments.out + " holds " + inQuotes(table->origin().name) + " as a MERL table";
  if (!(*brdf)->isotropic()) {
    sentence += ", averaged over " + std::to_string(arguments.azimuths) +
                " azimuths: the format has no anisotropy, and turning the sample is lost";
  }
  context.console.say(sentence + ".");
  const std::string& note = table->origin().note;
  if (note != (*brdf)->origin().note) context.console.say("Note: " + note + ".");
  return kDone;
}

constexpr const char* kRegionNames[] = {"highlight", "diffuse", "grazing"};
constexpr const char* kChannelNames[] = {"red", "green", "blue"};

void sayComparison(const Brdf& first, const Brdf& second, const BrdfComparison& c, Context& context) {
  context.console.say(inQuotes(second.origin().name) + " against " + inQuotes(first.origin().name));
  const auto say = [&](const char* name, const BrdfComparison::Part& part) {
    context.console.say(part.directions == 0 ? format("  %-10s nothing to compare", name)
                                             : format("  %-10s RMS %.4f ln, mean difference %+.4f ln", name,
                                                      part.logRms, part.logBias));
  };
  say("all", c.all);
  for (int i = 0; i < kBrdfRegions; ++i) say(kRegionNames[i], c.region[i]);
  for (int i = 0; i < 3; ++i) say(kChannelNames[i], c.channel[i]);
  context.console.say(
      format("  %-10s %.3f ln in %s at theta_h %.1f, theta_d %.1f, phi_d %.0f degrees: %.4g, then %.4g 1/sr",
             "largest", c.largest, kChannelNames[c.largestChannel], degrees(c.largestAt.thetaHRad),
             degrees(c.largestAt.thetaDRad), degrees(c.largestAt.phiDRad), c.firstThere[c.largestChannel],
             c.secondThere[c.largestChannel]));
  context.console.say(format("  %-10s %.1f %% of the directions, both cosines above %g", "compared",
                             100 * c.comparedShare, kLeastComparedCosine));
}

ordered_json comparisonJson(const Brdf& first, const Brdf& second, const BrdfComparison& c) {
  const auto part = [](const BrdfComparison::Part& p) {
    return ordered_json{{"log_rms", p.logRms}, {"log_bias", p.logBias}, {"directions", p.directions}};
  };
  ordered_json json;
  json["first"] = jsonOf(first.origin());
  json["second"] = jsonOf(second.origin());
  json["all"] = part(c.all);
  for (int i = 0; i < kBrdfRegions; ++i) json["regions"][kRegionNames[i]] = part(c.region[i]);
  for (int i = 0; i < 3; ++i) json["channels"][kChannelNames[i]] = part(c.channel[i]);
  json["largest"] = {{"log", c.largest},
                     {"channel", kChannelNames[c.largestChannel]},
                     {"theta_h_deg", degrees(c.largestAt.thetaHRad)},
                     {"theta_d_deg", degrees(c.largestAt.thetaDRad)},
                     {"phi_d_deg", degrees(c.largestAt.phiDRad)},
                     {"first_per_sr", triple(c.firstThere)},
                     {"second_per_sr", triple(c.secondThere)}};
  json["compared_share"] = c.comparedShare;
  return json;
}

int runCompare(const BrdfArguments& arguments, Context& context) {
  if (arguments.sources.size() < 2) {
    return context.misuse("two BRDFs are needed to compare. Try: patina-cli brdf compare A B.");
  }
  std::vector<BrdfPtr> brdfs;
  for (const std::string& source : arguments.sources) {
    const Result<BrdfPtr> brdf = openBrdf(source);
    if (!brdf) return context.fail(brdf.error());
    brdfs.push_back(*brdf);
  }
  ordered_json all = ordered_json::array();
  for (std::size_t i = 1; i < brdfs.size(); ++i) {
    const Result<BrdfComparison> comparison = compareBrdfs(*brdfs[0], *brdfs[i], context.job());
    if (!comparison) return context.fail(comparison.error());
    context.console.finishProgress();
    if (arguments.json) {
      all.push_back(comparisonJson(*brdfs[0], *brdfs[i], *comparison));
    } else {
      sayComparison(*brdfs[0], *brdfs[i], *comparison, context);
    }
  }
  if (arguments.json) sayJson(all, context);
  return kDone;
}

}  // namespace

void addBrdfVerb(CLI::App& program, Context& context) {
  CLI::App* verb = program.add_subcommand("brdf", "Reads, converts and compares measured BRDFs");
  verb->set_help_flag("-h,--help", "Print this help");
  verb->require_subcommand(1);
  auto arguments = std::make_shared<BrdfArguments>();
  const auto sub = [&](const char* name, const char* does, int (*run)(const BrdfArguments&, Context&)) {
    CLI::App* action = verb->add_subcommand(name, does);
    action->set_help_flag("-h,--help", "Print this help");
    action->callback([&context, arguments, run] {
      context.run = [&context, arguments, run] {
        const auto start = std::chrono::steady_clock::now();
        const int status = run(*arguments, context);
        if (context.common.stats) sayStats(*arguments, std::chrono::steady_clock::now() - start, context);
        return status;
      };
    });
    return action;
  };
  const auto addJson = [&](CLI::App* action) {
    action->add_flag("--json", arguments->json,
                     "Print the result as JSON, an array with one object a result");
  };

  CLI::App* info = sub("info", "Format, symmetry, known directions, albedo, reciprocity, range", runInfo);
  info->add_option("FILE", arguments->sources, kSources)->required()->option_text("...");
  info->footer(
      "Albedos are those under a light at 0, 45 and 75 degrees from the normal. Logarithms are natural, of f "
      "w +\n"
      "0.001 with w the larger cosine and f in 1/sr, RMS over directions spread uniformly over the MERL grid "
      "with\n"
      "both cosines above 0.15.");
  addJson(info);
  addCommonOptions(*info, context);

  CLI::App* convert = sub("convert", "Writes a BRDF in another format", runConvert);
  convert->add_option("FILE", arguments->sources, kSources)->required()->expected(1)->option_text(" ");
  convert->add_option("--to", arguments->to, "Format to write: merl, a MERL .binary table [default: merl]")
      ->check(CLI::IsMember({"merl"}))
      ->option_text("FORMAT");
  convert
      ->add_option("--out", arguments->out,
                   "The file to write; replaced if it is there, and only when the new one is whole")
      ->required()
      ->option_text("FILE");
  convert
      ->add_option(
          "--azimuths", arguments->azimuths,
          "Azimuths of the half-vector that an anisotropic BRDF is averaged over, 1 to 720 [default: 16]")
      ->check(CLI::Range(1, 720))
      ->option_text("N");
  convert->footer(
      "Cells that no pair of directions reaches or that aren't known become -1. The format is reciprocal: a "
      "BRDF that\n"
      "isn't quite is averaged over swapping light and view. A MERL file is written as it was read.");
  addCommonOptions(*convert, context);

  CLI::App* compare = sub("compare", "How far BRDFs are from the first one", runCompare);
  compare->add_option("FILE", arguments->sources, std::string("Two or more. ") + kSources)
      ->required()
      ->option_text("A B ...");
  compare->footer(
      "Differences are ln(b w + 0.001) - ln(a w + 0.001), w the larger cosine, b and a in 1/sr, over "
      "directions\n"
      "spread uniformly over the MERL grid with both cosines above 0.15. Grazing: light or view beyond 70 "
      "degrees;\n"
      "highlight: theta_h below 15 degrees and not grazing; diffuse: the rest.");
  addJson(compare);
  addCommonOptions(*compare, context);
}

}  // namespace patina::cli
