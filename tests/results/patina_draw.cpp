// Simulates one capture drawn at random, with one effect (or none) that its bundle doesn't declare.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <iostream>

#include "tests/results/closing_loop_draw.h"

int main(int argc, char** argv) {
  using namespace patina;
  using namespace patina::test;
  CLI::App app(
      "Simulates a capture drawn at random, with effects that its bundle doesn't declare (truth/ says them)");
  std::string effect, second, strength = "strong", out;
  std::uint64_t seed = 1;
  int pixels = 0, threads = 1;
  bool list = false;
  app.add_option("--effect", effect, "Id of the effect; left out or 'clean': none");
  app.add_option("--second", second, "Id of another");
  app.add_option("--strength", strength,
                 "strong, weak, or a number for the field that the seed picks [default: strong]");
  app.add_option("--seed", seed, "Of materials, rig, noise and the effect's shape [default: 1]");
  app.add_option("--pixels", pixels, "Side of the pictures; 0: 40 to 64, drawn [default: 0]");
  app.add_option("--threads", threads, "[default: 1]");
  app.add_option("--out", out, "The bundle's folder");
  app.add_flag("--list", list, "Print the effects that are drawn");
  CLI11_PARSE(app, argc, argv);
  if (list) {
    for (const auto& [name, which] :
         {std::pair{"strong", DrawStrength::Strong}, {"weak", DrawStrength::Weak}}) {
      std::cout << name << ":";
      for (const std::string& id : drawnEffects(which)) std::cout << " " << id;
      std::cout << "\n";
    }
    return 0;
  }
  if (out.empty()) {
    std::cerr << "--out is needed\n";
    return 2;
  }
  std::vector<std::string> effects;
  if (!effect.empty() && effect != "clean") effects.push_back(effect);
  if (!second.empty()) effects.push_back(second);
  char* end = nullptr;
  const double number = std::strtod(strength.c_str(), &end);
  DrawnCapture drawn;
  if (strength == "strong" || strength == "weak")
    drawn =
        drawCapture(seed, effects, strength == "weak" ? DrawStrength::Weak : DrawStrength::Strong, pixels);
  else if (end && *end == 0 && effects.size() == 1)
    drawn = drawCaptureWith(seed, effect, number, pixels);
  else {
    std::cerr << "--strength is strong, weak, or a number with one --effect\n";
    return 2;
  }
  if (drawn.options.effects.ids().size() != effects.size()) {
    std::cerr << "not every one of these effects is drawn at that strength; see --list\n";
    return 2;
  }
  JobContext job;
  job.threads = threads;
  if (const Status made = simulateDrawn(drawn, out, job); !made) {
    std::cerr << made.error().sentence() << "\n";
    return 1;
  }
  std::cout << out << ": " << drawn.summary << "\n";
  return 0;
}
