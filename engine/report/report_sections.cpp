#include "engine/report/report_sections.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "engine/base/text.h"
#include "engine/effect/effect_info.h"
#include "engine/report/explanation_words.h"
#include "engine/report/html.h"
#include "engine/report/svg_plots.h"

namespace patina::report {
namespace {

using html::escaped;

/// Rows shown before the rest is folded away.
constexpr std::size_t kOpenRows = 15;
constexpr std::size_t kMostBars = 24;

std::string width(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f%%", 100 * std::clamp(std::isfinite(share) ? share : 0.0, 0.0, 1.0));
  return text;
}

std::string track(double share, const char* kind, double mark = -1) {
  std::string html = "<div class=\"track\"><i class=\"fill-" + std::string(kind) +
                     "\" style=\"width:" + width(share) + "\"></i>";
  if (mark >= 0 && std::isfinite(mark)) html += "<b style=\"left:calc(" + width(mark) + " - 1px)\"></b>";
  return html + "</div>";
}

std::string paragraph(std::string text, const char* kind = "") {
  if (text.empty()) return {};
  for (std::size_t at = text.find(" %"); at != std::string::npos; at = text.find(" %", at))
    text.replace(at, 1, "\u00a0");  // no line begins with a percent sign
  return "<p" + (*kind ? " class=\"" + std::string(kind) + "\"" : std::string()) + ">" + escaped(text) +
         "</p>";
}

std::string section(const char* id, const std::string& title, const std::string& lead,
                    const std::string& body) {
  return "<section id=\"" + std::string(id) + "\"><h2>" + escaped(title) + "</h2>" + paragraph(lead, "lead") +
         body + "</section>\n";
}

std::string bundleNames(const Explanation& explanation) {
  std::string names;
  for (const auto& bundle : explanation.bundles) {
    const auto clean = bundle.lexically_normal();
    const std::string name = (clean.has_filename() ? clean : clean.parent_path()).filename().string();
    names += (names.empty() ? "" : ", ") + name;
  }
  return names;
}

std::string errorBars(const Explanation& explanation) {
  const ErrorSummary error = errorSummary(explanation);
  if (!(error.before >= 0) || !std::isfinite(error.before)) return {};
  const double most = std::max({error.before, error.after, error.noise, 1e-12}) * 1.04;
  const double mark = error.noise > 0 ? error.noise / most : -1;
  std::string rows;
  const auto row = [&](const std::string& name, double value, const char* kind) {
    if (!(value >= 0) || !std::isfinite(value)) return;
    rows += "<span class=\"name\">" + escaped(name) + "</span>" + track(value / most, kind, mark) +
            "<span class=\"number\">" + escaped(percent(value)) + "</span>";
  };
  row("before", error.before, "before");
  if (!explanation.effects.empty()) row("after", error.after, "after");
  if (error.noise > 0) row("noise alone", error.noise, "noise");
  return "<div class=\"panel\"><h4>" +
         escaped(error.holdout ? "Error on photographs that the fit never saw"
                               : "Error on the fitted photographs") +
         "</h4><div class=\"errors\">" + rows + "</div></div>";
}

std::string figure(const std::string& svg, const std::string& title) {
  if (svg.empty()) return {};
  return "<figure><h4>" + escaped(title) + "</h4>" + svg + "</figure>";
}

/// How far from nothing, what share of the residual, how sure.
std::string evidence(const EffectFinding& finding) {
  std::string rows;
  const auto row = [&](double share, const char* kind, const std::string& text) {
    rows += track(share, kind) + "<span>" + escaped(text) + "</span>";
  };
  if (finding.sigmas > 0 && std::isfinite(finding.sigmas)) {
    std::string text = "Evidence: " + evidenceWords(finding) + ", " + shortNumber(finding.sigmas) +
                       " standard deviations from none of it";
    if (finding.correctedP >= 0 && finding.correctedP < 1)
      text += finding.correctedP < 1e-12
                  ? "; by chance: less than once in 10\u00b9\u00b2"
                  : "; by chance, for all effects that were tried: " + shortNumber(finding.correctedP);
    row(evidenceShare(finding), "after", text);
  }
  if (finding.explained > 0)
    row(finding.explained, "after",
        "Explains " + wholePercent(finding.explained) + " of what is above the noise, by itself");
  if (finding.added && finding.confidence > 0)
    row(finding.confidence, "after",
        "Confidence that this is the right name: " + wholePercent(finding.confidence));
  if (finding.holdoutRmsWith >= 0 && finding.holdoutRmsWithout > 0)
    row(finding.holdoutRmsWith / finding.holdoutRmsWithout, "before",
        "Error of prediction without it " + percent(finding.holdoutRmsWithout) + ", with it " +
            percent(finding.holdoutRmsWith));
  return rows.empty() ? rows : "<div class=\"evidence\">" + rows + "</div>";
}

std::string cardOf(const EffectFinding& finding) {
  const EffectInfo* info = findEffect(finding.id);
  std::string html = "<article class=\"card panel\"><div class=\"head\"><h3>" +
                     escaped(effectTitle(finding.id)) + "</h3><code>" + escaped(finding.id) + "</code>";
  if (info) html += "<span class=\"tag\">" + std::string(stageName(info->stage)) + "</span>";
  html += "</div>";
  html += paragraph(finding.sentence, "say");
  if (info) html += paragraph(std::string(info->sentence));
  if (!finding.parameters.empty()) {
    html += "<ul>";
    for (const EffectEstimate& estimate : finding.parameters)
      html += "<li>" + escaped(estimateText(estimate)) + "</li>";
    html += "</ul>";
  }
  html += evidence(finding);
  html += paragraph(finding.verdict);
  std::string plots;
  for (const SignaturePlot& plot : finding.plots) plots += figure(signatureSvg(plot), plot.title);
  for (const PhotoCurve& curve : finding.curves)
    plots += figure(photoCurveSvg(curve), curve.name + " over the photographs");
  if (!plots.empty())
    html +=
        "<div class=\"key\"><span class=\"k-after\">expected from the effect</span>"
        "<span class=\"k-before\">seen in the photographs</span></div><div class=\"plots\">" +
        plots + "</div>";
  if (info) {
    html += "<p class=\"lead\">How it shows: " + escaped(info->signature) +
            "</p><p class=\"lead\">At the next capture: " + escaped(info->remedy) + "</p>";
  }
  return html + "</article>";
}

}  // namespace

std::string heading(const Explanation& explanation) {
  const ExplanationVerdict verdict = verdictOf(explanation);
  static constexpr const char* kMood[] = {"nothing", "found", "unnamed", "stopped"};
  std::string names = bundleNames(explanation);
  return "<header class=\"mood-" + std::string(kMood[static_cast<int>(verdict.mood)]) +
         "\"><p class=\"eyebrow\">" +
         escaped("Patina \u00b7 what the model lacks \u00b7 " + explanation.kind +
                 (names.empty() ? "" : " \u00b7 " + names)) +
         "</p><h1>" + escaped(verdict.headline) + "</h1>" + paragraph(verdict.detail, "detail") +
         errorBars(explanation) + "</header>\n";
}

std::string addedEffects(const Explanation& explanation) {
  if (explanation.effects.empty()) return {};
  std::string cards;
  for (const EffectFinding& effect : explanation.effects) cards += cardOf(effect);
  return section(
      "added",
      explanation.effects.size() == 1 ? "What was added to the model" : "What was added, strongest first", "",
      "<div class=\"cards\">" + cards + "</div>");
}

std::string whereItSits(const Explanation& explanation) {
  std::string plots;
  for (const ResidualBreakdown& breakdown : explanation.breakdowns) {
    std::size_t leftOut = 0;
    const std::string svg = breakdownSvg(breakdown, kMostBars, &leftOut);
    if (svg.empty()) continue;
    plots += "<figure><h4>" + escaped("By " + breakdown.by) + "</h4>" + svg;
    if (leftOut > 0)
      plots += "<figcaption>" +
               escaped("The worst " + std::to_string(kMostBars) + "; " + std::to_string(leftOut) +
                       " better ones are in explain.json.") +
               "</figcaption>";
    plots += "</figure>";
  }
  if (plots.empty()) return {};
  std::string lead =
      "Mean square of photograph minus prediction, in units of the noise's variance: 1 is as good as "
      "can be seen.";
  if (explanation.chi2Before > 0) {
    lead += " Over the tested points: " + shortNumber(explanation.chi2Before) + " before";
    if (!explanation.effects.empty() && explanation.chi2After > 0)
      lead += ", " + shortNumber(explanation.chi2After) + " after";
    lead += ".";
  }
  return section("where", "Where the residual sits", lead,
                 "<div class=\"panel\"><div class=\"key\"><span class=\"k-before\">before</span>"
                 "<span class=\"k-after\">after</span></div><div class=\"plots\">" +
                     plots + "</div></div>");
}

std::string photographTable(const Explanation& explanation) {
  if (explanation.photos.empty()) return {};
  const bool several = explanation.bundles.size() > 1, after = !explanation.effects.empty();
  double most = 1e-12;
  for (const PhotoResidual& photo : explanation.photos)
    for (const double value : {photo.before, photo.after})
      if (std::isfinite(value)) most = std::max(most, value);
  const auto table = [&](std::size_t from, std::size_t to) {
    std::string html =
        "<div class=\"scroll\"><table><thead><tr><th>photograph</th><th>what it shows</th><th></th>"
        "<th class=\"number\">noise</th><th class=\"number\">before</th>";
    if (after) html += "<th class=\"number\">after</th>";
    html += "<th></th></tr></thead><tbody>";
    for (std::size_t i = from; i < to; ++i) {
      const PhotoResidual& photo = explanation.photos[i];
      html += "<tr><td class=\"file\">" + escaped(photo.file) +
              (several ? " <span class=\"tag\">bundle " + std::to_string(photo.bundle + 1) + "</span>" : "") +
              "</td><td>" + escaped(photo.what) + "</td><td>" +
              (photo.holdout ? "<span class=\"tag\">held out</span>" : "") + "</td><td class=\"number\">" +
              escaped(percent(photo.noise)) + "</td><td class=\"number\">" + escaped(percent(photo.before)) +
              "</td>";
      if (after) html += "<td class=\"number\">" + escaped(percent(photo.after)) + "</td>";
      html += "<td>" + track(photo.before / most, "before", photo.noise / most);
      if (after) html += track(photo.after / most, "after", photo.noise / most);
      html += "</td></tr>";
    }
    return html + "</tbody></table></div>";
  };
  const std::size_t count = explanation.photos.size(), open = std::min(count, kOpenRows);
  std::string body = "<div class=\"panel\">" + table(0, open);
  if (count > open)
    body += "<details><summary>" + escaped("The other " + counted(count - open, "photograph")) +
            "</summary>" + table(open, count) + "</details>";
  return section(
      "photographs", "Photographs, worst predicted first",
      "Relative error of prediction over the sample; the line in a bar is the photograph's own noise.",
      body + "</div>");
}

std::string consideredEffects(const Explanation& explanation) {
  if (explanation.considered.empty()) return {};
  const auto row = [](const EffectFinding& finding) {
    std::string html = "<tr><td><b>" + escaped(effectTitle(finding.id)) + "</b><br/><code class=\"tag\">" +
                       escaped(finding.id) + "</code></td><td>" + track(evidenceShare(finding), "noise") +
                       escaped(evidenceWords(finding));
    if (finding.sigmas > 0 && std::isfinite(finding.sigmas))
      html += escaped(", " + shortNumber(finding.sigmas) + " standard deviations");
    html += "</td><td class=\"number\">" +
            escaped(finding.holdoutRmsWith >= 0 ? percent(finding.holdoutRmsWith) : "not refitted") +
            "</td><td>" + escaped(finding.verdict) + "</td></tr>";
    return html;
  };
  const auto table = [&](std::size_t from, std::size_t to) {
    std::string html =
        "<div class=\"scroll\"><table><thead><tr><th>effect</th><th>evidence by itself</th>"
        "<th class=\"number\">error with it</th><th>why it was not added</th></tr></thead><tbody>";
    for (std::size_t i = from; i < to; ++i) html += row(explanation.considered[i]);
    return html + "</tbody></table></div>";
  };
  const std::size_t count = explanation.considered.size(), open = std::min(count, kOpenRows);
  std::string body = "<div class=\"panel\">" + table(0, open);
  if (count > open)
    body += "<details><summary>" + escaped("The other " + std::to_string(count - open)) + "</summary>" +
            table(open, count) + "</details>";
  std::string plots;
  for (const EffectFinding& finding : explanation.considered)
    for (const SignaturePlot& plot : finding.plots)
      plots += figure(signatureSvg(plot), effectTitle(finding.id) + ": " + plot.title);
  if (!plots.empty())
    body += "<details><summary>Signatures, expected and seen</summary><div class=\"plots\">" + plots +
            "</div></details>";
  return section("considered", "Also considered", "", body + "</div>");
}

std::string apart(const Explanation& explanation) {
  if (explanation.confusable.empty() && explanation.suggest.empty()) return {};
  std::string items;
  for (const auto& group : explanation.confusable) {
    if (group.size() < 2) continue;
    std::string names;
    for (std::size_t i = 0; i < group.size(); ++i)
      names += (i == 0                  ? ""
                : i + 1 == group.size() ? " or "
                                        : ", ") +
               ("\u201c" + effectTitle(group[i]) + "\u201d");
    items += "<li class=\"panel\"><b>" + escaped("Not told apart by these photographs: " + names + ".") +
             "</b> " + escaped("The first is the one that was reported.") + "</li>";
  }
  for (const Suggestion& suggestion : explanation.suggest) {
    items += "<li class=\"panel\"><b>" +
             escaped("To tell \u201c" + effectTitle(suggestion.separatesA) + "\u201d from \u201c" +
                     effectTitle(suggestion.separatesB) + "\u201d: ") +
             "</b>" + escaped(suggestion.capture);
    if (suggestion.separationSigmas > 0)
      items += escaped(" (They would then be " + shortNumber(suggestion.separationSigmas) +
                       " standard deviations apart.)");
    items += "</li>";
  }
  if (items.empty()) return {};
  return section("apart", "What can't be told apart, and what would tell", "",
                 "<ul class=\"plain\">" + items + "</ul>");
}

std::string budget(const Explanation& explanation) {
  if (explanation.budget.empty()) return {};
  std::string html =
      "<div class=\"panel scroll\"><table><thead><tr><th>effect</th><th class=\"number\">as large as</th>"
      "<th>would shift the maps by (median)</th><th>in words</th></tr></thead><tbody>";
  for (const BudgetLine& line : explanation.budget) {
    html += "<tr><td><b>" + escaped(effectTitle(line.id)) + "</b><br/><code class=\"tag\">" +
            escaped(line.id) + "</code></td><td class=\"number\">" +
            escaped(amountText(line.parameter, line.largestUnseen, line.unit)) + "<br/><span class=\"tag\">" +
            escaped(parameterWords(line.parameter)) + "</span></td><td>";
    for (std::size_t i = 0; i < line.shifts.size(); ++i) {
      const BudgetLine::Shift& shift = line.shifts[i];
      html += (i > 0 ? "<br/>" : "") +
              escaped(shift.quantity + ": " + amountText(shift.quantity, shift.value, shift.unit));
    }
    html += "</td><td>" + escaped(line.sentence) + "</td></tr>";
  }
  return section(
      "budget", "What could hide in these photographs",
      "For each effect that was not found: how large it could be without being seen (95 %), and how far it "
      "would then move the result.",
      html + "</tbody></table></div>");
}

std::string remarks(const Explanation& explanation) {
  std::string items;
  if (!explanation.unexplained.description.empty() || explanation.unexplained.fraction > 0)
    items += "<li class=\"panel\"><b>" +
             escaped("Left over: " + percent(explanation.unexplained.fraction) +
                     " of what was above the noise. ") +
             "</b>" + escaped(explanation.unexplained.description) + "</li>";
  for (const std::string& remark : explanation.remarks)
    items += "<li class=\"panel\">" + escaped(remark) + "</li>";
  if (items.empty()) return {};
  return section("remarks", "What stays, and remarks", "", "<ul class=\"plain\">" + items + "</ul>");
}

}  // namespace patina::report
