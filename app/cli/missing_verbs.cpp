#include "app/cli/verbs.h"

namespace patina::cli {

void addMissingVerbs(CLI::App& program, Context& context) {
  struct Missing {
    const char* name;
    const char* does;
  };
  static constexpr Missing kMissing[] = {
#ifndef PATINA_HAS_EXPLAIN
      {"explain", "finding out which effect a fit misses"},
#endif
      {"render", "rendering a fit"},
      {"export", "exporting for other programs"}};
  for (const Missing& missing : kMissing) {
    CLI::App* verb = program.add_subcommand(missing.name, "");
    verb->group("");  // not listed
    verb->set_help_flag();
    verb->prefix_command();
    verb->callback([&context, missing] {
      context.run = [&context, missing] {
        return context.misuse(std::string("'") + missing.name + "' (" + missing.does +
                              ") is not in this version of patina-cli. 'patina-cli --help' lists what is.");
      };
    });
  }
}

}  // namespace patina::cli
