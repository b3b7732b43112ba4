#include "app/cli/stage_titles.h"

#include <map>

namespace patina::cli {

std::string stageTitle(std::string_view stage) {
  // A test holds that every id that the engine and the devices report is here.
  static const std::map<std::string_view, std::string> titles = {
      {"read", "Reading photographs"},
      {"geometry", "Working out the geometry"},
      {"levels", "Fitting coarse levels"},
      {"measure", "Measuring the BRDF"},
      {"solve", "Fitting"},
      {"texels", "Fitting texels"},
      {"rescue", "Retrying stuck texels"},
      {"upsample", "Refining the coarse solution"},
      {"maps", "Making the maps"},
      {"posterior", "Working out how far to trust it"},
      {"predict", "Predicting the photographs"},
      {"holdout", "Checking against held-out photographs"},
      {"expose", "Simulating photographs"},
      {"write", "Writing photographs"},
      {"search", "Searching directions"},
      {"built-in basis", "Preparing the built-in basis (once)"},
      {"map", "Mapping the materials"},
      {"components", "Computing the components"},
      {"tabulate", "Filling the table"},
      {"compare", "Comparing the BRDFs"},
      {"sphere", "Drawing the sphere"},
      {"dump", "Writing stage images"},
      {"fit", "Fitting the standard model"},
      {"residual", "Looking at what is left"},
      {"score", "Trying every effect on it"},
      {"refit", "Fitting again with the likely ones"},
      {"correct", "Taking out what was found"},
      {"report", "Writing the report"},
      {"check", "Checking the rig"},
      {"photograph", "Photographing"},
      {"latency", "Measuring the screen's latency"},
      {"boards", "Looking for boards"},
      {"lens", "Fitting the lens"},
      {"response", "Recovering the response"},
      {"emission", "Fitting the screen's emission"}};
  const auto found = titles.find(stage);
  return found != titles.end() ? found->second : std::string(stage);
}

}  // namespace patina::cli
