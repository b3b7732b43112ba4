#include "engine/twoshot/fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include "devices/simulated/two_shot_rig.h"
#include "engine/brdf/neural_brdf.h"
#include "engine/image/exr.h"
#include "engine/twoshot/posterior.h"
#include "engine/twoshot/remarks.h"
#include "tests/base/temp_folder.h"
#include "tests/twoshot/truth_error.h"

// Reconstruction of simulated bundles, with the built-in basis.
namespace patina {
namespace {

using testing::HasSubstr;

const BasisPtr& basis() {
  static const BasisPtr kept = [] {
    auto built = builtInBasis({});
    if (!built) throw std::runtime_error(built.error().sentence());
    return *built;
  }();
  return kept;
}

BrdfPtr network(const std::string& name) {
  for (const BrdfPtr& brdf : builtInNeuralBrdfs())
    if (brdf->origin().name == name) return brdf;
  throw std::runtime_error("no " + name);
}

constexpr double kDegree = M_PI / 180;

/// The robust pair of directions, and one more that is held out.
TwoShotScene scene(const std::string& material = "blue-rubber") {
  TwoShotScene made;
  made.name = "sample";
  made.brdfs = {network(material)};
  made.pixels = 64;
  made.samplesPerPixelSide = 2;
  made.halfFloats = false;
  made.poses = {{shotFromHalfDiff({6 * kDegree, 15 * kDegree, 37.5 * kDegree}), {1.0}, false},
                {shotFromHalfDiff({16 * kDegree, 67 * kDegree, 89 * kDegree}), {1.0}, false},
                {shotFromHalfDiff({42 * kDegree, 25 * kDegree, 60 * kDegree}), {1.0}, true}};
  return made;
}

struct Bundle {
  test::TempFolder folder;
  TwoShotCapture capture;

  explicit Bundle(const TwoShotScene& made) {
    auto simulated = simulateTwoShot(made, folder / "b", {});
    if (!simulated) throw std::runtime_error(simulated.error().sentence());
    reread();
  }
  void reread() {
    auto read = readTwoShotCapture(folder / "b");
    if (!read) throw std::runtime_error(read.error().sentence());
    capture = *read;
  }
  /// Changes every pixel of a photograph.
  template <typename Change>
  void repaint(const TwoShotPhoto& photo, Change&& change) {
    auto image = readPhoto(capture, photo);
    ASSERT_TRUE(image.ok());
    for (float& v : image->samples()) v = static_cast<float>(change(v));
    ASSERT_TRUE(writeExr(capture.folder / photo.file, *image, {"R", "G", "B"}).ok());
  }
};

Result<std::shared_ptr<const TwoShotFit>> fit(const TwoShotCapture& capture,
                                              const TwoShotFitOptions& options = {}) {
  return fitTwoShot(capture, basis(), options, {});
}

TEST(TwoShotFit, FindsAMaterialOfTheBasisAndPredictsTheHeldOutShot) {
  const Bundle bundle(scene());
  const auto found = fit(bundle.capture);
  ASSERT_TRUE(found.ok()) << found.error().sentence();
  const TwoShotFit& result = **found;
  // Twice what the two clean shared bundles reach at worst; the basis holds this material.
  EXPECT_LT(test::logRms(*result.materials[0].brdf, *network("blue-rubber")), 0.37);
  EXPECT_LT(result.stats.fitRms, 0.2);
  EXPECT_GT(result.stats.fitRms, 0);
  ASSERT_EQ(result.comparisons.size(), 3u);
  EXPECT_TRUE(result.comparisons[2].holdout);
  EXPECT_LT(result.stats.holdoutRms, 0.3);
  EXPECT_GT(result.stats.noiseFloorHoldout, 0);
  EXPECT_LT(result.stats.noiseFloorHoldout, result.stats.holdoutRms);
  EXPECT_GT(result.materials[0].expected.unseen, 0.1);
  ASSERT_TRUE(result.materials[0].posteriorSd);
  EXPECT_EQ(result.materials[0].posteriorSd->size(), MerlGrid::kCells);
  for (const char* stage : {"read", "observe", "solve", "unmap", "posterior", "predict", "total"})
    EXPECT_TRUE(result.stats.seconds.contains(stage)) << stage;
}

TEST(TwoShotFit, UnitsOfPhotographAndWhiteCancel) {
  constexpr double kRounding = 1e-3;  // of 32-bit files, in coefficients of order 0.1
  Bundle bundle(scene());
  const auto before = fit(bundle.capture);
  ASSERT_TRUE(before.ok());
  const auto difference = [&] {
    const auto after = fit(bundle.capture);
    if (!after) throw std::runtime_error(after.error().sentence());
    return ((*before)->materials[0].coefficients - (*after)->materials[0].coefficients).norm() /
           (*before)->materials[0].coefficients.norm();
  };
  EXPECT_EQ(difference(), 0) << "twice the same input, to the last bit";
  // Pixels and exposure of one shot together.
  bundle.repaint(bundle.capture.shots[0], [](double v) { return 4 * v; });
  bundle.capture.shots[0].exposureS *= 4;
  bundle.capture.saturation = 0;
  EXPECT_LT(difference(), kRounding);
  // A brighter lamp: sample and tile together.
  bundle.repaint(bundle.capture.shots[1], [](double v) { return 7 * v; });
  bundle.repaint(bundle.capture.whiteShots[1], [](double v) { return 7 * v; });
  EXPECT_LT(difference(), kRounding);
  // A tile twice as bright, known to be.
  for (const TwoShotPhoto& white : bundle.capture.whiteShots)
    bundle.repaint(white, [](double v) { return 0.5 * v; });
  bundle.capture.whiteReflectance *= 0.5;
  EXPECT_LT(difference(), kRounding);
}

TEST(TwoShotFit, OneShotWorksAndIsExpectedToBeWorse) {
  TwoShotScene one = scene();
  one.poses.erase(one.poses.begin() + 1);
  const Bundle single(one), two(scene());
  const auto a = fit(single.capture), b = fit(two.capture);
  ASSERT_TRUE(a.ok()) << a.error().sentence();
  ASSERT_TRUE(b.ok());
  EXPECT_GT((*a)->materials[0].expected.unseen, 1.1 * (*b)->materials[0].expected.unseen);
}

TEST(TwoShotFit, ResolutionAndRowsChangeLittle) {
  constexpr double kSame = 0.06;  // ln: a third of the error itself
  TwoShotScene fine = scene();
  fine.pixels = 160;
  const Bundle small(scene()), large(fine);
  const auto a = fit(small.capture), b = fit(large.capture);
  TwoShotFitOptions few;
  few.rowsPerShot = 500;
  const auto c = fit(large.capture, few);
  ASSERT_TRUE(a.ok() && b.ok() && c.ok());
  EXPECT_LT(test::logRms(*(*a)->materials[0].brdf, *(*b)->materials[0].brdf), kSame);
  EXPECT_LT(test::logRms(*(*c)->materials[0].brdf, *(*b)->materials[0].brdf), kSame);
}

TEST(TwoShotFit, ClippedPixelsAreLeftOutAndABracketBringsThemBack) {
  TwoShotScene clipped = scene("red-plastic");
  clipped.statesSaturation = false;  // the plateau has to be seen
  double brightest = 0;
  for (const TwoShotPose& pose : clipped.poses) {
    const auto truth = exposeTwoShot(clipped, pose.directions, false, {});
    ASSERT_TRUE(truth.ok());
    for (const float v : truth->samples()) brightest = std::max(brightest, double{v});
  }
  clipped.fullScale = 0.5 * brightest;
  const Bundle short_(clipped);
  const auto without = fit(short_.capture);
  ASSERT_TRUE(without.ok()) << without.error().sentence();
  EXPECT_GT((*without)->stats.clippedPixels, 0u);
  for (TwoShotPose& pose : clipped.poses)
    if (!pose.holdout) pose.exposuresS = {1.0, 0.25};
  const Bundle bracket(clipped);
  const auto with = fit(bracket.capture);
  ASSERT_TRUE(with.ok()) << with.error().sentence();
  EXPECT_EQ((*with)->stats.clippedPixels, 0u);
}

TEST(TwoShotFit, BlackPhotographsAreLeftOutOrRefusedWithTheReason) {
  Bundle bundle(scene());
  bundle.repaint(bundle.capture.shots[1], [](double) { return 0; });
  const auto one = fit(bundle.capture);
  ASSERT_TRUE(one.ok()) << one.error().sentence();
  EXPECT_THAT((*one)->stats.remarks, testing::Contains(HasSubstr("is black on the sample")));
  bundle.repaint(bundle.capture.shots[0], [](double) { return 0; });
  const auto none = fit(bundle.capture);
  ASSERT_FALSE(none.ok());
  EXPECT_THAT(none.error().what, HasSubstr("black"));
  EXPECT_THAT(none.error().where, HasSubstr("shot_"));
}

const TwoShotComparison& comparisonOf(const TwoShotFit& found, const std::string& file) {
  for (const TwoShotComparison& comparison : found.comparisons)
    if (comparison.file == file) return comparison;
  throw std::runtime_error("no comparison of " + file);
}

TEST(TwoShotFit, AShotThatIsLeftOutIsListedWithTheReasonAndAPredictionWhereItsLightIsKnown) {
  Bundle bundle(scene());
  const TwoShotPhoto used = bundle.capture.shots[0], unused = bundle.capture.shots[1];
  const auto whole = fit(bundle.capture);
  ASSERT_TRUE(whole.ok());
  for (const TwoShotComparison& comparison : (*whole)->comparisons) EXPECT_EQ(comparison.leftOut, "");

  bundle.repaint(unused, [](double) { return 0; });
  const auto black = fit(bundle.capture);
  ASSERT_TRUE(black.ok()) << black.error().sentence();
  ASSERT_EQ((*black)->comparisons.size(), 3u);
  EXPECT_EQ(comparisonOf(**black, used.file).leftOut, "");
  const TwoShotComparison& listed = comparisonOf(**black, unused.file);
  EXPECT_THAT(listed.leftOut, HasSubstr("black on the sample"));
  ASSERT_FALSE(listed.rendered.empty());
  EXPECT_GT(*std::max_element(listed.rendered.samples().begin(), listed.rendered.samples().end()), 0);
  // What was not fitted is no part of how well the fit reproduces what was.
  EXPECT_EQ((*black)->stats.fitRms, comparisonOf(**black, used.file).rms);

  // Its white photograph is black too: there is nothing to predict it with.
  bundle.repaint(bundle.capture.whiteShots[1], [](double) { return 0; });
  const auto dark = fit(bundle.capture);
  ASSERT_TRUE(dark.ok()) << dark.error().sentence();
  const TwoShotComparison& alone = comparisonOf(**dark, unused.file);
  EXPECT_NE(alone.leftOut, "");
  EXPECT_TRUE(alone.rendered.empty());
  EXPECT_EQ(alone.rms, -1);
  EXPECT_FALSE(alone.captured.empty());

  // And so it is after writing and loading.
  test::TempFolder out;
  ASSERT_TRUE(writeTwoShotFit(out / "fit", **dark).ok());
  EXPECT_FALSE(std::filesystem::exists((out / "fit" / "rendered" / unused.file).replace_extension(".exr")));
  const auto loaded = loadTwoShotFit(out / "fit", {});
  ASSERT_TRUE(loaded.ok()) << loaded.error().sentence();
  EXPECT_EQ(comparisonOf(**loaded, unused.file).leftOut, alone.leftOut);
  EXPECT_TRUE(comparisonOf(**loaded, unused.file).rendered.empty());
}

TEST(TwoShotFit, PhotographsOfOneNameHaveAPredictionEach) {
  const Bundle bundle(scene());
  const auto made = fit(bundle.capture);
  ASSERT_TRUE(made.ok());
  TwoShotFit same = **made;
  same.comparisons[0].file = "a/shot.exr", same.comparisons[1].file = "b/shot.exr";
  same.comparisons[2].file = "a/shot.png";
  test::TempFolder out;
  ASSERT_TRUE(writeTwoShotFit(out / "fit", same).ok());
  const char* files[] = {"rendered/a/shot.exr", "rendered/b/shot.exr", "rendered/a/shot_2.exr"};
  const std::string json = test::readText(out / "fit" / "fit.json");
  for (std::size_t i = 0; i < 3; ++i) {
    const auto written = readExr(out / "fit" / files[i], {"R", "G", "B"});
    ASSERT_TRUE(written.ok()) << written.error().sentence();
    const auto all = same.comparisons[i].rendered.samples();
    const float brightest = *std::max_element(all.begin(), all.end());
    EXPECT_NEAR(*std::max_element(written->samples().begin(), written->samples().end()), brightest,
                1e-3 * brightest)  // half floats
        << files[i];
    EXPECT_THAT(json, HasSubstr(files[i]));
  }
}

TEST(TwoShotFit, BlackWhiteReferenceIsRefused) {
  Bundle bundle(scene());
  for (const TwoShotPhoto& white : bundle.capture.whiteShots) bundle.repaint(white, [](double) { return 0; });
  const auto none = fit(bundle.capture);
  ASSERT_FALSE(none.ok());
  EXPECT_THAT(none.error().what, HasSubstr("white reference is black"));
}

TEST(TwoShotFit, ANumberThatIsNoneIsRefusedWithItsPixel) {
  Bundle bundle(scene());
  bundle.repaint(bundle.capture.shots[0], [](double) { return NAN; });
  const auto none = fit(bundle.capture);
  ASSERT_FALSE(none.ok());
  EXPECT_THAT(none.error().sentence(), HasSubstr("NaN"));
}

TEST(TwoShotFit, ImpossibleOptionsAreAllNamed) {
  TwoShotFitOptions options;
  options.eta = -1, options.rowsPerShot = 0, options.clusters = 99;
  EXPECT_EQ(options.validate().size(), 3u);
  EXPECT_TRUE(TwoShotFitOptions{}.validate().empty());
}

TEST(TwoShotFit, StopsSoonWhereverItIs) {
  // 100 ms are promised; the rest is for a machine that has other things to do.
  constexpr double kSoonS = 0.3;
  const Bundle bundle(scene());
  basis();
  for (const int afterMs : {0, 20, 100, 400, 1000}) {
    std::stop_source stop;
    JobContext job;
    job.stop = stop.get_token();
    std::chrono::steady_clock::time_point asked;
    std::jthread other([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(afterMs));
      asked = std::chrono::steady_clock::now();
      stop.request_stop();
    });
    const auto result = fitTwoShot(bundle.capture, basis(), {}, job);
    const auto ended = std::chrono::steady_clock::now();
    other.join();
    if (asked < ended) {
      EXPECT_LT(std::chrono::duration<double>(ended - asked).count(), kSoonS) << afterMs;
    }
    if (result) {
      EXPECT_TRUE((*result)->stats.cancelled || ended <= asked) << afterMs;
      EXPECT_TRUE((*result)->materials[0].brdf);
    } else {
      EXPECT_EQ(static_cast<int>(result.error().code), static_cast<int>(ErrorCode::Cancelled));
    }
  }
}

TEST(Basis, UnmappingAndPosteriorStopHalfWay) {
  constexpr double kSoonS = 0.3;  // 100 ms are promised; a slab of cells takes some milliseconds
  const Eigen::Index k = basis()->componentCount();
  const auto stopped = [&](const auto& work) {
    std::stop_source stop;
    std::chrono::steady_clock::time_point asked;
    std::jthread other([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));  // all of it takes hundreds
      asked = std::chrono::steady_clock::now();
      stop.request_stop();
    });
    const bool whole = work(stop.get_token());
    const auto ended = std::chrono::steady_clock::now();
    other.join();
    EXPECT_FALSE(whole) << "it ended before it was stopped, or didn't look";
    EXPECT_LT(std::chrono::duration<double>(ended - asked).count(), kSoonS);
  };
  stopped([&](const std::stop_token& stop) {
    return basis()->reconstruct(Eigen::MatrixXd::Zero(k, 3), {}, stop) != nullptr;
  });
  const Eigen::MatrixXd all = Eigen::MatrixXd::Identity(k, k);
  stopped([&](const std::stop_token& stop) { return !basis()->posteriorSd(all, all, 1, stop).empty(); });
}

TEST(TwoShotFit, IsWrittenAndLoaded) {
  const Bundle bundle(scene());
  const auto made = fit(bundle.capture);
  ASSERT_TRUE(made.ok());
  test::TempFolder out;
  bool called = false;
  ASSERT_TRUE(writeTwoShotFit(out / "fit", **made, [&](const std::filesystem::path& folder) -> Status {
                called = std::filesystem::exists(folder / "fit.json");
                return Done{};
              }).ok());
  EXPECT_TRUE(called);
  const auto loaded = loadTwoShotFit(out / "fit", {});
  ASSERT_TRUE(loaded.ok()) << loaded.error().sentence();
  const TwoShotFit &a = **made, &b = **loaded;
  EXPECT_EQ(a.materials[0].coefficients, b.materials[0].coefficients);
  EXPECT_EQ(a.stats.remarks, b.stats.remarks);
  EXPECT_EQ(a.options, b.options);
  EXPECT_EQ(a.stats.fitRms, b.stats.fitRms);
  ASSERT_EQ(a.comparisons.size(), b.comparisons.size());
  for (std::size_t i = 0; i < a.comparisons.size(); ++i)
    EXPECT_NEAR(a.comparisons[i].rms, b.comparisons[i].rms, 1e-6);
  EXPECT_LT(test::logRms(*a.materials[0].brdf, *b.materials[0].brdf), 1e-6);
  EXPECT_NEAR((*a.materials[0].posteriorSd)[700000], (*b.materials[0].posteriorSd)[700000], 1e-3);

  // What doesn't hold together is refused.
  std::string json = test::readText(out / "fit" / "fit.json");
  const auto at = json.find("\"checksum\": \"") + 13;
  json[at] = json[at] == '0' ? '1' : '0';
  test::writeText(out / "fit" / "fit.json", json);
  const auto refused = loadTwoShotFit(out / "fit", {});
  ASSERT_FALSE(refused.ok());
  EXPECT_THAT(refused.error().what, HasSubstr("basis"));
}

TEST(TwoShotFit, AFailureOfThePicturesLeavesAnEarlierResult) {
  const Bundle bundle(scene());
  const auto made = fit(bundle.capture);
  ASSERT_TRUE(made.ok());
  test::TempFolder out;
  const auto failing = [](const std::filesystem::path&) -> Status {
    return Error{ErrorCode::WriteFailed, "no", "", ""};
  };
  EXPECT_FALSE(writeTwoShotFit(out / "fit", **made, failing).ok());
  EXPECT_FALSE(std::filesystem::exists(out / "fit"));

  ASSERT_TRUE(writeTwoShotFit(out / "fit", **made).ok());
  const std::string before = test::readText(out / "fit" / "fit.json");
  TwoShotFit other = **made;
  other.stats.remarks = {"another fit"};
  EXPECT_FALSE(writeTwoShotFit(out / "fit", other, failing).ok());
  EXPECT_EQ(test::readText(out / "fit" / "fit.json"), before);
  EXPECT_TRUE(loadTwoShotFit(out / "fit", {}).ok());
  std::size_t entries = 0;
  for (const auto& entry : std::filesystem::directory_iterator(out.path())) {
    EXPECT_EQ(entry.path().filename(), "fit");
    ++entries;
  }
  EXPECT_EQ(entries, 1u) << "something half-written stayed behind";
}

/// Rows of the robust pair, and every material left out of the basis.
struct LeftOut {
  RowFactor rows;
  LeaveOneOut left;
  LeftOut() {
    const NearFieldDisc disc;
    const TwoShotScene pair = scene();
    const RowFactor a = rowsOfShot(*basis(), pair.poses[0].directions, disc);
    const RowFactor b = rowsOfShot(*basis(), pair.poses[1].directions, disc);
    rows = stack({&a, &b});
    left = leaveOneOut(*basis(), rows, 2 * kEtaRows, kPaperEta, BasisRegion::All, {}, {});
  }
};

TEST(LeaveOneOut, AgreesWithTheExpectedErrorOfUnseenMaterials) {
  const LeftOut out;
  const ExpectedError expected = ErrorMetric(basis(), BasisRegion::All).expect(out.rows);
  ASSERT_EQ(expected.unseenMaterial.size() * 3, out.left.rms.size());
  for (std::size_t j = 0; j < expected.unseenMaterial.size(); ++j) {
    const double mean = (out.left.rms[3 * j] + out.left.rms[3 * j + 1] + out.left.rms[3 * j + 2]) / 3;
    EXPECT_NEAR(mean, expected.unseenMaterial[j], 1e-6 * (1 + mean)) << j;
  }
}

/// How often the errors of materials that were left out lie within one and two standard deviations of the
/// posterior, over the whole grid.
struct Coverage {
  double within1 = 0, within2 = 0;
};

/// `calibrated`: the materials that the posterior is calibrated on; `judged`: those whose errors are counted.
Coverage coverage(const LeftOut& out, const std::vector<bool>& calibrated, const std::vector<bool>& judged) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(out.rows.factor.transpose() * out.rows.factor);
  const Eigen::MatrixXd directions = eigen.eigenvectors().rowwise().reverse();
  const Eigen::VectorXd values = eigen.eigenvalues().reverse().cwiseMax(0);
  std::vector<HalfDiffAngles> angles;
  for (std::size_t cell = 0; cell < MerlGrid::kCells; cell += 977) {
    const DirectionPair pair = directionsFromHalfDiff(MerlGrid::centre(cell));
    if (pair.toLight.z() > 0.1 && pair.toView.z() > 0.1) angles.push_back(MerlGrid::centre(cell));
  }
  const BasisRows rows = basis()->rows(angles);
  LeaveOneOut known = out.left;  // an entry of 0 is one that nothing is known of
  for (std::size_t i = 0; i < known.rms.size(); ++i)
    if (!calibrated[i / 3]) known.rms[i] = known.residual[i] = 0;
  std::size_t one = 0, two = 0, all = 0;
  for (Eigen::Index i = 0; i < out.left.error.cols(); ++i) {
    if (!judged[static_cast<std::size_t>(i) / 3]) continue;
    const Posterior posterior =
        makePosterior(*basis(), directions, values, kPaperEta, known, out.left.residual[i]);
    const Eigen::VectorXd error = rows.components * out.left.error.col(i);
    const Eigen::MatrixXd seen = rows.components * posterior.observed.transpose();
    for (Eigen::Index r = 0; r < rows.size(); ++r) {
      const double variance = posterior.scale * (rows.components.row(r).squaredNorm() -
                                                 seen.row(r).dot(seen.row(r) * posterior.shrunk));
      const double z = std::abs(error[r]) / std::sqrt(variance);
      one += z <= 1, two += z <= 2, ++all;
    }
  }
  return {static_cast<double>(one) / static_cast<double>(all),
          static_cast<double>(two) / static_cast<double>(all)};
}

TEST(Posterior, CalibratedOnHalfOfTheMaterialsItCoversTheErrorsOfTheOtherHalf) {
  // A normal distribution has 0.68 and 0.95. Errors of a material go together and some materials are much
  // worse than others, so what is asked is that the statement isn't boastful, and not empty either.
  constexpr double kOneSd = 0.68, kTwoSd = 0.92, kNotEmpty = 0.95;
  const LeftOut out;
  // Every other material of the list, which is sorted by name, both ways round; and once in another order.
  for (const int split : {0, 1, 2}) {
    std::vector<bool> calibrated, judged;
    for (std::size_t m = 0; m < basis()->materials().size(); ++m) {
      calibrated.push_back(split == 2 ? m < 50 : static_cast<int>(m % 2) == split);
      judged.push_back(!calibrated.back());
    }
    const Coverage found = coverage(out, calibrated, judged);
    RecordProperty("within_one_sd_" + std::to_string(split), std::to_string(found.within1));
    RecordProperty("within_two_sd_" + std::to_string(split), std::to_string(found.within2));
    EXPECT_GE(found.within1, kOneSd) << split;
    EXPECT_LE(found.within1, kNotEmpty) << split;
    EXPECT_GE(found.within2, kTwoSd) << split;
  }
}

TEST(Remarks, SayErrorsAsAPersonWould) {
  EXPECT_EQ(logErrorInWords(0.2), "about 22 %");
  EXPECT_EQ(logErrorInWords(0.05), "about 5.1 %");
  EXPECT_EQ(logErrorInWords(1), "a factor of 2.7");
}

}  // namespace
}  // namespace patina
