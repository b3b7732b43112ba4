#include <cstdio>

#include "engine/report/explanation_files.h"
#include "engine/report/explanation_words.h"
#include "engine/report/html.h"
#include "engine/report/report_sections.h"
#include "engine/report/report_style.h"

namespace patina {
namespace {

std::string contents(const std::string& body) {
  struct Entry {
    const char* id;
    const char* name;
  };
  static constexpr Entry kEntries[] = {{"added", "Added"},
                                       {"pictures", "Pictures"},
                                       {"where", "Where it sits"},
                                       {"photographs", "Photographs"},
                                       {"considered", "Also considered"},
                                       {"apart", "Not told apart"},
                                       {"budget", "What could hide"},
                                       {"remarks", "Remarks"}};
  std::string links;
  for (const Entry& entry : kEntries)
    if (body.find("<section id=\"" + std::string(entry.id) + "\"") != std::string::npos)
      links += "<a href=\"#" + std::string(entry.id) + "\">" + entry.name + "</a>";
  return links.empty() ? links : "<nav aria-label=\"Contents\">" + links + "</nav>\n";
}

std::string footer(const Explanation& explanation) {
  std::string text = "Made by Patina. The numbers of this page are in explain.json beside it.";
  double total = 0;
  std::string stages;
  for (const auto& [stage, seconds] : explanation.seconds) {
    if (stage == "total") {
      total = seconds;
      continue;
    }
    char part[32];
    std::snprintf(part, sizeof part, " %.1f s", seconds);
    stages += (stages.empty() ? "" : ", ") + stage + part;
  }
  if (!stages.empty()) text += " Time: " + stages;
  if (total > 0) {
    char part[48];
    std::snprintf(part, sizeof part, "%s%.1f s in all", stages.empty() ? " Time: " : "; ", total);
    text += part;
  }
  return "<footer>" + html::escaped(text + (stages.empty() && !(total > 0) ? "" : ".")) + "</footer>\n";
}

}  // namespace

Result<std::string> explanationReport(const Explanation& explanation) {
  const std::string body = report::addedEffects(explanation) + report::photographPictures(explanation) +
                           report::whereItSits(explanation) + report::photographTable(explanation) +
                           report::consideredEffects(explanation) + report::apart(explanation) +
                           report::budget(explanation) + report::remarks(explanation);
  std::string page =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/><title>" +
      html::escaped(verdictOf(explanation).headline) + "</title><style>" + kReportStyle +
      "</style></head>\n<body><div class=\"page\">\n" + report::heading(explanation) + contents(body) +
      "<main>\n" + body + "</main>\n" + footer(explanation) + "</div><script>" + kReportScript +
      "</script></body></html>\n";
  return page;
}

}  // namespace patina
