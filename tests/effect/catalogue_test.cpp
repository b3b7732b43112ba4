#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <string>

#include "engine/effect/catalogue_page.h"
#include "engine/effect/effect_info.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

const fs::path kSource = PATINA_SOURCE_DIR;

// The command-line contract's ids, and the stage that each belongs to.
const std::map<std::string, EffectStage> kContract = {
    {"emission-angular", EffectStage::Screen},
    {"emission-spatial", EffectStage::Screen},
    {"screen-response", EffectStage::Screen},
    {"screen-drift", EffectStage::Screen},
    {"flicker", EffectStage::Screen},
    {"near-light", EffectStage::Light},
    {"light-power", EffectStage::Light},
    {"screen-pose", EffectStage::Geometry},
    {"sample-height", EffectStage::Geometry},
    {"sample-tilt", EffectStage::Geometry},
    {"anisotropy", EffectStage::Surface},
    {"third-lobe", EffectStage::Surface},
    {"fresnel", EffectStage::Surface},
    {"sheen", EffectStage::Surface},
    {"retroreflection", EffectStage::Surface},
    {"clearcoat", EffectStage::Surface},
    {"iridescence", EffectStage::Surface},
    {"subsurface", EffectStage::Surface},
    {"self-shadowing", EffectStage::Surface},
    {"basis-deviation", EffectStage::Surface},
    {"glare", EffectStage::Lens},
    {"defocus", EffectStage::Lens},
    {"vignetting", EffectStage::Lens},
    {"camera-response", EffectStage::Sensor},
    {"black-level", EffectStage::Sensor},
    {"channel-crosstalk", EffectStage::Sensor},
    {"ambient-drift", EffectStage::Sensor},
    {"stray-light", EffectStage::Sensor},
    {"exposure-mismatch", EffectStage::Sensor},
    {"saturation", EffectStage::Sensor},
};

std::string text(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

bool isPlainText(std::string_view words) {
  return std::ranges::all_of(words, [](unsigned char c) { return c >= 32 && c < 127; });
}

// A sentence for a person: begins with a capital, ends with a full stop, has neither double blanks nor a
// line that somebody forgot to finish.
void expectSentence(std::string_view sentence, const std::string& where) {
  ASSERT_GE(sentence.size(), 30u) << where;
  EXPECT_LE(sentence.size(), 220u) << where << ": too long for a card";
  EXPECT_TRUE(std::isupper(static_cast<unsigned char>(sentence.front()))) << where << ": " << sentence;
  EXPECT_EQ(sentence.back(), '.') << where << ": " << sentence;
  EXPECT_EQ(sentence.find("  "), std::string_view::npos) << where << ": " << sentence;
  EXPECT_TRUE(isPlainText(sentence)) << where << ": " << sentence;
}

TEST(EffectCatalogue, HoldsEveryIdOfTheContractOnceAndAtItsStage) {
  ASSERT_GE(effectCatalogue().size(), kContract.size())
      << "effects register themselves: linked as a static library they would be dropped silently";
  std::set<std::string> seen;
  for (const EffectInfo* effect : effectCatalogue()) {
    const std::string id(effect->id);
    EXPECT_TRUE(seen.insert(id).second) << id << " is registered twice";
    const auto contract = kContract.find(id);
    ASSERT_NE(contract, kContract.end()) << id << " is not in the contract";
    EXPECT_EQ(effect->stage, contract->second) << id;
    EXPECT_EQ(findEffect(id), effect);
  }
  for (const auto& [id, stage] : kContract) EXPECT_TRUE(seen.contains(id)) << id << " is missing";
  EXPECT_EQ(findEffect("no-such-effect"), nullptr);
}

TEST(EffectCatalogue, IsOrderedByStageThenId) {
  const auto& all = effectCatalogue();
  EXPECT_TRUE(
      std::ranges::is_sorted(all, {}, [](const EffectInfo* e) { return std::pair(e->stage, e->id); }));
}

TEST(EffectCatalogue, EachStandsInAFileOfItsOwnBesideItsStage) {
  for (const EffectInfo* effect : effectCatalogue()) {
    std::string stem(effect->id);
    std::ranges::replace(stem, '-', '_');
    const fs::path file = kSource / "engine" / stageName(effect->stage) / "effects" / (stem + ".cpp");
    ASSERT_TRUE(fs::exists(file)) << file;
    EXPECT_NE(text(file).find('"' + std::string(effect->id) + '"'), std::string::npos) << file;
  }
}

TEST(EffectCatalogue, TellsAPersonInSentences) {
  std::set<std::string_view> titles, sentences, signatures;
  for (const EffectInfo* effect : effectCatalogue()) {
    const std::string id(effect->id);
    expectSentence(effect->sentence, id + ", sentence");
    expectSentence(effect->signature, id + ", signature");
    expectSentence(effect->remedy, id + ", remedy");
    EXPECT_GE(effect->title.size(), 10u) << id;
    EXPECT_LE(effect->title.size(), 70u) << id;
    EXPECT_TRUE(std::isupper(static_cast<unsigned char>(effect->title.front()))) << id;
    EXPECT_NE(effect->title.back(), '.') << id;
    EXPECT_TRUE(effect->source == "this program" || effect->source.find('(') != std::string_view::npos)
        << id << ": a source has its year: " << effect->source;
    EXPECT_TRUE(isPlainText(effect->source)) << id;
    EXPECT_TRUE(titles.insert(effect->title).second) << id << ": somebody else's title";
    EXPECT_TRUE(sentences.insert(effect->sentence).second) << id << ": somebody else's sentence";
    EXPECT_TRUE(signatures.insert(effect->signature).second) << id << ": somebody else's signature";
    EXPECT_NE(effect->kinds & (kFourierKind | kTwoShotKind | kFlashKind), 0u) << id;
  }
}

TEST(EffectCatalogue, ParametersWearTheirUnitsAndHaveSaneRanges) {
  const std::map<std::string, std::string> kSuffix = {{"degrees", "Deg"}, {"mm", "Mm"}, {"pixels", "Px"}};
  for (const EffectInfo* effect : effectCatalogue()) {
    ASSERT_FALSE(effect->parameters.empty()) << effect->id;
    std::set<std::string_view> names;
    for (const EffectParameter& parameter : effect->parameters) {
      const std::string where = std::string(effect->id) + "." + std::string(parameter.name);
      EXPECT_TRUE(names.insert(parameter.name).second) << where;
      ASSERT_FALSE(parameter.name.empty()) << where;
      EXPECT_TRUE(std::islower(static_cast<unsigned char>(parameter.name.front()))) << where;
      EXPECT_TRUE(std::ranges::all_of(parameter.name, [](unsigned char c) { return std::isalnum(c); }))
          << where;
      EXPECT_EQ(parameter.name.find("oughness"), std::string_view::npos) << where;
      EXPECT_TRUE(std::isfinite(parameter.least) && std::isfinite(parameter.most)) << where;
      EXPECT_LT(parameter.least, parameter.most) << where;
      EXPECT_GE(parameter.typical, parameter.least) << where;
      EXPECT_LE(parameter.typical, parameter.most) << where;
      EXPECT_NE(parameter.typical, 0) << where << ": a typical strength is the scale of a prior";
      EXPECT_GE(parameter.meaning.size(), 10u) << where;
      EXPECT_TRUE(isPlainText(parameter.meaning)) << where;
      for (const auto& [unit, suffix] : kSuffix)
        EXPECT_EQ(parameter.unit == unit, parameter.name.ends_with(suffix)) << where;
    }
  }
}

TEST(EffectCatalogue, EveryKindOfCaptureHasEffectsOfSeveralStages) {
  for (const unsigned kind : {kFourierKind, kTwoShotKind, kFlashKind}) {
    std::set<EffectStage> stages;
    for (const EffectInfo* effect : effectCatalogue())
      if (effect->kinds & kind) stages.insert(effect->stage);
    EXPECT_GE(stages.size(), 4u) << kind;
    EXPECT_TRUE(stages.contains(EffectStage::Surface)) << kind;
  }
}

// docs/effects.md is written by this test where PATINA_WRITE_PAGES is set, and held to the catalogue
// otherwise.
TEST(EffectCatalogue, ThePageInTheDocsIsCurrent) {
  const fs::path page = kSource / "docs" / "effects.md";
  if (std::getenv("PATINA_WRITE_PAGES") != nullptr)
    std::ofstream(page, std::ios::binary) << effectCataloguePage();
  EXPECT_EQ(text(page), effectCataloguePage())
      << "run this test once with PATINA_WRITE_PAGES=1 and commit docs/effects.md";
}

}  // namespace
}  // namespace patina
