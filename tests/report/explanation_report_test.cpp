#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>

#include "engine/effect/effect_info.h"
#include "engine/image/png.h"
#include "engine/report/explanation_files.h"
#include "engine/report/explanation_words.h"
#include "engine/report/html.h"
#include "engine/report/svg_plots.h"
#include "tests/base/temp_folder.h"
#include "tests/report/made_up_explanation.h"
#include "tests/report/well_formed.h"

namespace patina {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

std::string reportOf(const Explanation& explanation) {
  const auto report = explanationReport(explanation);
  EXPECT_TRUE(report.ok());
  return report.ok() ? *report : std::string();
}

int count(const std::string& text, const std::string& part) {
  int n = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++n;
  return n;
}

// ---- explain.json

TEST(ExplanationJson, HoldsExactlyWhatTheContractSays) {
  const json report = json::parse(explanationJson(test::madeUpExplanation()));
  EXPECT_EQ(report.at("kind"), "fourier");
  EXPECT_DOUBLE_EQ(report.at("noise_floor").at("holdout"), 0.0104);
  EXPECT_DOUBLE_EQ(report.at("before").at("fit_rms"), 0.021);
  EXPECT_DOUBLE_EQ(report.at("before").at("holdout_rms"), 0.0483);
  EXPECT_DOUBLE_EQ(report.at("after").at("holdout_rms"), 0.0112);
  ASSERT_EQ(report.at("effects").size(), 2u);
  const json& first = report.at("effects")[0];
  EXPECT_EQ(first.at("id"), "anisotropy");
  EXPECT_DOUBLE_EQ(first.at("parameters").at("ratio"), 1.32);
  EXPECT_DOUBLE_EQ(first.at("parameters").at("angleDeg"), 12.1);
  EXPECT_DOUBLE_EQ(first.at("holdout_rms_with"), 0.0131);
  EXPECT_DOUBLE_EQ(first.at("holdout_rms_without"), 0.0483);
  EXPECT_DOUBLE_EQ(first.at("confidence"), 0.98);
  ASSERT_EQ(report.at("considered").size(), 2u);
  EXPECT_EQ(report.at("considered")[0].at("id"), "screen-pose");
  EXPECT_DOUBLE_EQ(report.at("considered")[0].at("holdout_rms_with"), 0.046);
  EXPECT_TRUE(report.at("considered")[1].at("holdout_rms_with").is_null()) << "not refitted";
  EXPECT_FALSE(report.at("considered")[0].at("verdict").get<std::string>().empty());
  EXPECT_EQ(report.at("confusable"), json::parse(R"([["screen-pose", "sample-height"]])"));
  EXPECT_EQ(report.at("suggest")[0].at("separates"), json::parse(R"(["screen-pose", "sample-height"])"));
  EXPECT_THAT(report.at("suggest")[0].at("capture").get<std::string>(), HasSubstr("turned by 90"));
  EXPECT_DOUBLE_EQ(report.at("unexplained").at("fraction"), 0.04);
  EXPECT_THAT(report.at("unexplained").at("description").get<std::string>(), HasSubstr("blue"));
  EXPECT_EQ(report.at("budget").size(), 2u);
  EXPECT_EQ(report.at("residual").at("photos").size(), 40u);
  EXPECT_EQ(report.at("remarks").size(), 1u);
}

TEST(ExplanationJson, AnEmptyExplanationIsStillWhole) {
  const json report = json::parse(explanationJson(Explanation{}));
  for (const char* key : {"kind", "noise_floor", "before", "after", "effects", "considered", "confusable",
                          "suggest", "unexplained", "budget", "residual", "remarks"})
    EXPECT_TRUE(report.contains(key)) << key;
  EXPECT_TRUE(report.at("before").at("holdout_rms").is_null());
  EXPECT_TRUE(report.at("effects").is_array());
}

TEST(ExplanationJson, NumbersThatAreNoneBecomeNull) {
  const std::string text = explanationJson(test::hostileExplanation());
  const json report = json::parse(text);  // throws on nan, inf and broken UTF-8
  EXPECT_TRUE(report.at("before").at("holdout_rms").is_null());
  EXPECT_TRUE(report.at("effects")[0].at("parameters").at("ratio").is_null());
  EXPECT_TRUE(report.at("unexplained").at("fraction").is_null());
  EXPECT_THAT(text, Not(HasSubstr("nan")));
}

TEST(ExplanationJson, OneNameInSeveralPlacesKeepsTheFirstAndListsAll) {
  Explanation e = test::madeUpExplanation();
  e.effects.front().parameters = {{"ratio", "", 1.3, 0.1, ""}, {"ratio", "", 2.0, 0.1, "left half"}};
  const json effect = json::parse(explanationJson(e)).at("effects")[0];
  EXPECT_DOUBLE_EQ(effect.at("parameters").at("ratio"), 1.3);
  ASSERT_EQ(effect.at("estimates").size(), 2u);
  EXPECT_EQ(effect.at("estimates")[1].at("where"), "left half");
}

// ---- words

TEST(ExplanationVerdict, SaysInOneSentenceWhatIsMissing) {
  const auto found = verdictOf(test::madeUpExplanation());
  EXPECT_EQ(found.mood, ExplanationVerdict::Mood::Found);
  EXPECT_THAT(found.headline, HasSubstr("2 things"));
  EXPECT_THAT(found.headline,
              HasSubstr("Brushed or stretched highlights\u201d and \u201cThe screen flickers"));
  EXPECT_THAT(found.detail, HasSubstr("4.83 % before, 1.12 % after"));
  EXPECT_THAT(found.detail, HasSubstr("noise alone is 1.04 %"));

  const auto nothing = verdictOf(test::madeUpCleanExplanation());
  EXPECT_EQ(nothing.mood, ExplanationVerdict::Mood::Nothing);
  EXPECT_THAT(nothing.headline, HasSubstr("Nothing is missing"));
  EXPECT_THAT(nothing.detail, Not(HasSubstr("after")));

  Explanation unnamed = test::madeUpCleanExplanation();
  unnamed.chi2After = 4;
  unnamed.unexplained.fraction = 1;
  unnamed.unexplained.description = "The left edge, in blue.";
  EXPECT_EQ(verdictOf(unnamed).mood, ExplanationVerdict::Mood::Unnamed);
  EXPECT_THAT(verdictOf(unnamed).detail, HasSubstr("The left edge, in blue."));

  Explanation tied = test::madeUpExplanation();
  tied.effects.resize(1);
  tied.effects[0].id = "screen-pose";
  EXPECT_THAT(verdictOf(tied).headline, HasSubstr("can't tell which"));
  EXPECT_THAT(verdictOf(tied).headline, HasSubstr("the sample is not flat"));

  Explanation stopped = test::madeUpExplanation();
  stopped.cancelled = true;
  EXPECT_EQ(verdictOf(stopped).mood, ExplanationVerdict::Mood::Stopped);
}

TEST(ExplanationWords, NumbersAreShortAndNeverNonsense) {
  EXPECT_EQ(shortNumber(1.32), "1.32");
  EXPECT_EQ(shortNumber(12.10), "12.1");
  EXPECT_EQ(shortNumber(0), "0");
  EXPECT_EQ(shortNumber(1234.4), "1234");
  EXPECT_EQ(shortNumber(0.00123), "0.00123");
  EXPECT_EQ(shortNumber(0.00060), "0.0006");
  EXPECT_EQ(shortNumber(3e-9), "3e-9");
  EXPECT_EQ(shortNumber(-2.55e7), "-2.55e7");
  EXPECT_EQ(shortNumber(NAN), "?");
  EXPECT_EQ(amountText("edgeChange", 0.021, ""), "2.1 %");
  EXPECT_EQ(amountText("shiftMm", 1.2, "mm"), "1.2 mm");
  EXPECT_EQ(amountText("ratio", 1.32, ""), "1.32");
  EXPECT_EQ(estimateText({"edgeChange", "", 0.3, 0.02, "blue"}), "edge change 30 \u00b1 2 % (blue)");
  EXPECT_EQ(wholePercent(0.87), "87 %");
  EXPECT_EQ(percent(0.0483), "4.83 %");
  EXPECT_EQ(percent(-1), "not known");
  EXPECT_EQ(percent(NAN), "not known");
  EXPECT_EQ(parameterWords("distanceMm"), "distance");
  EXPECT_EQ(parameterWords("edgeChange"), "edge change");
}

// ---- report.html

TEST(ExplanationReport, IsWellFormedWhateverItHolds) {
  for (const Explanation& explanation : {Explanation{}, test::madeUpExplanation(),
                                         test::madeUpCleanExplanation(), test::hostileExplanation()}) {
    const std::string page = reportOf(explanation);
    EXPECT_EQ(test::whyNotWellFormed(page), "");
    EXPECT_THAT(page, Not(HasSubstr("nan")));
    EXPECT_THAT(page, Not(HasSubstr("inf%")));
  }
}

TEST(ExplanationReport, TheTestsReaderSeesWhatIsWrong) {
  for (const char* broken : {"<a><b></a></b>", "<a b=c></a>", "<a>&bad;</a>", "<a x=\"1\" x=\"2\"></a>",
                             "<a>", "<a/><b/>", "<a onclick=\"x\"/>", "<a>1 & 2</a>", ""})
    EXPECT_NE(test::whyNotWellFormed(broken), "") << broken;
  EXPECT_EQ(test::whyNotWellFormed("<!DOCTYPE html>\n<a x=\"1 &amp; 2\">t<b/></a>\n"), "");
}

TEST(ExplanationReport, NeedsNoNetwork) {
  const std::string page = reportOf(test::madeUpExplanation());
  EXPECT_THAT(page, Not(HasSubstr("http:")));
  EXPECT_THAT(page, Not(HasSubstr("https:")));
  EXPECT_THAT(page, Not(HasSubstr("@import")));
  EXPECT_THAT(page, Not(HasSubstr("url(")));
  const std::regex source("src=\"([^\"]{0,22})");
  int pictures = 0;
  for (std::sregex_iterator one(page.begin(), page.end(), source), end; one != end; ++one, ++pictures)
    EXPECT_EQ((*one)[1], "data:image/png;base64,");
  EXPECT_GE(pictures, 3 * 5 + 2) << "residuals, noise, photographs, where they sit";
}

TEST(ExplanationReport, SaysTheVerdictFirstAndEverythingThatWasFound) {
  const Explanation explanation = test::madeUpExplanation();
  std::string page = reportOf(explanation);
  for (std::size_t at; (at = page.find("\u00a0%")) != std::string::npos;) page.replace(at, 2, " ");
  const std::size_t verdict = page.find("<h1>");
  ASSERT_NE(verdict, std::string::npos);
  EXPECT_LT(verdict, page.find("<h2>"));
  for (const auto& finding : explanation.effects) {
    EXPECT_THAT(page, HasSubstr(html::escaped(std::string(findEffect(finding.id)->title))));
    EXPECT_THAT(page, HasSubstr(html::escaped(finding.sentence)));
  }
  for (const char* text : {"1.32", "12.1", "What could hide", "Not told apart", "turned by 90 degrees",
                           "0.21 degrees", "Three photographs are clipped", "wipe-range", "held out"})
    EXPECT_THAT(page, HasSubstr(text));
  // Worst photograph first, and all of them somewhere.
  EXPECT_LT(page.find("photo_0.exr</td>"), page.find("photo_1.exr</td>"));
  EXPECT_THAT(page, HasSubstr("photo_39.exr</td>"));
}

TEST(ExplanationReport, HostileNamesStayText) {
  const std::string page = reportOf(test::hostileExplanation());
  EXPECT_EQ(count(page, "<script>"), 1) << "ours only";
  EXPECT_EQ(count(page, "<style>"), 1);
  EXPECT_THAT(page, Not(HasSubstr("<img src=http")));
  EXPECT_THAT(page, HasSubstr("&lt;script&gt;alert"));
  EXPECT_THAT(page, Not(HasSubstr("\xE2\x80\xAE"))) << "turns the direction of what follows";
}

TEST(ExplanationReport, StaysSmallWithLargePhotographs) {
  Explanation explanation = test::madeUpExplanation();
  explanation.pictures = {test::madeUpPicture(1600, 1200, 3)};
  for (int i = 0; i < 9; ++i) explanation.pictures.push_back(explanation.pictures.front());
  EXPECT_LT(reportOf(explanation).size(), 12u << 20);
}

// ---- pieces

TEST(Html, EscapesMarkupAndBrokenCharacters) {
  EXPECT_EQ(html::escaped("a<b>&\"'"), "a&lt;b&gt;&amp;&quot;&#39;");
  EXPECT_EQ(html::escaped("gr\xc3\xbc\xc3\x9f"), "gr\xc3\xbc\xc3\x9f");
  EXPECT_EQ(html::escaped("\xff\xc3"), "\xEF\xBF\xBD\xEF\xBF\xBD");
  EXPECT_EQ(html::escaped(std::string("\x00\x1b", 2)), "\xEF\xBF\xBD\xEF\xBF\xBD");
  EXPECT_EQ(html::escaped("\xc0\xaf"), "\xEF\xBF\xBD\xEF\xBF\xBD") << "an overlong slash";
  EXPECT_EQ(html::base64("Man"), "TWFu");
  EXPECT_EQ(html::base64("Ma"), "TWE=");
  EXPECT_EQ(html::base64("M"), "TQ==");
  EXPECT_EQ(html::base64("\xff\xff\xff"), "////");
}

TEST(Html, APictureComesBackFromItsUri) {
  Image picture(3, 2, 3);
  picture.at(1, 1, 2) = 1;
  const auto bytes = encodePng(picture);
  ASSERT_TRUE(bytes.ok());
  const auto read = readPngBytes(*bytes, "memory");
  ASSERT_TRUE(read.ok());
  EXPECT_EQ(read->width(), 3);
  EXPECT_FLOAT_EQ(read->at(1, 1, 2), 1);
  EXPECT_FLOAT_EQ(read->at(0, 0, 2), 0);
  EXPECT_EQ(*html::pictureUri(picture), "data:image/png;base64," + html::base64(*bytes));
}

TEST(SvgPlots, TicksAreRoundAndInside) {
  EXPECT_THAT(svgTicks(0, 10, 5), testing::ElementsAre(0, 2, 4, 6, 8, 10));
  for (const auto& [low, high] :
       std::vector<std::pair<double, double>>{{-0.013, 0.047}, {1e-9, 3e-9}, {-4e6, 9e6}, {0.999, 1.001}}) {
    const auto ticks = svgTicks(low, high, 4);
    EXPECT_GE(ticks.size(), 2u) << low;
    EXPECT_LE(ticks.size(), 9u) << low;
    for (const double tick : ticks) EXPECT_TRUE(tick >= low - 1e-12 && tick <= high * (1 + 1e-9)) << tick;
  }
  EXPECT_TRUE(svgTicks(1, 1, 4).empty());
  EXPECT_TRUE(svgTicks(NAN, 1, 4).empty());
}

TEST(SvgPlots, NothingToDrawIsNothing) {
  EXPECT_EQ(signatureSvg({}), "");
  SignaturePlot plot;
  plot.x = {1, 2};
  plot.seen = {NAN, NAN};
  EXPECT_EQ(signatureSvg(plot), "");
  plot.seen = {NAN, 5};
  EXPECT_EQ(test::whyNotWellFormed(signatureSvg(plot)), "") << "a single point";
  std::size_t leftOut = 7;
  EXPECT_EQ(breakdownSvg({}, 5, &leftOut), "");
  EXPECT_EQ(leftOut, 0u);
}

TEST(SvgPlots, ABreakdownShowsItsWorstAndCountsTheRest) {
  ResidualBreakdown breakdown{"photo", {}, {}, {}};
  for (int i = 0; i < 50; ++i) {
    breakdown.label.push_back("n" + std::to_string(i) + ".");
    breakdown.before.push_back(i == 33 ? 90.0 : 1 + 0.01 * i);
  }
  std::size_t leftOut = 0;
  const std::string svg = breakdownSvg(breakdown, 10, &leftOut);
  EXPECT_EQ(leftOut, 40u);
  EXPECT_THAT(svg, HasSubstr(">n33.<"));
  EXPECT_THAT(svg, Not(HasSubstr(">n3.<")));
  EXPECT_THAT(svg, HasSubstr("logarithmic"));
}

// Written where PATINA_WRITE_REPORT says, to be looked at.
TEST(ExplanationReport, CanBeLookedAt) {
  const char* folder = std::getenv("PATINA_WRITE_REPORT");
  if (!folder) GTEST_SKIP() << "PATINA_WRITE_REPORT is not set";
  test::writeText(std::filesystem::path(folder) / "found.html", reportOf(test::madeUpExplanation()));
  test::writeText(std::filesystem::path(folder) / "clean.html", reportOf(test::madeUpCleanExplanation()));
  test::writeText(std::filesystem::path(folder) / "hostile.html", reportOf(test::hostileExplanation()));
}

}  // namespace
}  // namespace patina
