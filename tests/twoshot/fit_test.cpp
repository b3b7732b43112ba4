#include "engine/twoshot/fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
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
  // The table's unmapping and the posterior's can't be interrupted: their time is the bound, with other
  // programs on the machine.
  constexpr double kSoonS = 3;
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
  EXPECT_FALSE(writeTwoShotFit(out / "fit", **made, [](const std::filesystem::path&) -> Status {
                 return Error{ErrorCode::WriteFailed, "no", "", ""};
               }).ok());
  EXPECT_FALSE(std::filesystem::exists(out / "fit"));
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

TEST(Posterior, CoversTheErrorsOfMaterialsLeftOut) {
  // A normal distribution has 0.68 and 0.95. Errors of a material go together and some materials are much
  // worse than others, so what is asked is that the statement isn't boastful, and not empty either.
  constexpr double kOneSd = 0.68, kTwoSd = 0.92, kNotEmpty = 0.95;
  const LeftOut out;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(out.rows.factor.transpose() * out.rows.factor);
  const Eigen::MatrixXd directions = eigen.eigenvectors().rowwise().reverse();
  const Eigen::VectorXd values = eigen.eigenvalues().reverse().cwiseMax(0);
  // Directions over the whole grid.
  std::vector<HalfDiffAngles> angles;
  for (std::size_t cell = 0; cell < MerlGrid::kCells; cell += 977) {
    const DirectionPair pair = directionsFromHalfDiff(MerlGrid::centre(cell));
    if (pair.toLight.z() > 0.1 && pair.toView.z() > 0.1) angles.push_back(MerlGrid::centre(cell));
  }
  const BasisRows rows = basis()->rows(angles);
  std::size_t one = 0, two = 0, all = 0;
  for (Eigen::Index i = 0; i < out.left.error.cols(); ++i) {
    const Posterior posterior =
        makePosterior(*basis(), directions, values, kPaperEta, out.left, out.left.residual[i]);
    const Eigen::VectorXd error = rows.components * out.left.error.col(i);
    const Eigen::MatrixXd seen = rows.components * posterior.observed.transpose();
    for (Eigen::Index r = 0; r < rows.size(); ++r) {
      const double variance = posterior.scale * (rows.components.row(r).squaredNorm() -
                                                 seen.row(r).dot(seen.row(r) * posterior.shrunk));
      const double z = std::abs(error[r]) / std::sqrt(variance);
      one += z <= 1, two += z <= 2, ++all;
    }
  }
  const double within1 = static_cast<double>(one) / static_cast<double>(all),
               within2 = static_cast<double>(two) / static_cast<double>(all);
  RecordProperty("within_one_sd", std::to_string(within1));
  RecordProperty("within_two_sd", std::to_string(within2));
  EXPECT_GE(within1, kOneSd);
  EXPECT_LE(within1, kNotEmpty);
  EXPECT_GE(within2, kTwoSd);
}

TEST(Remarks, SayErrorsAsAPersonWould) {
  EXPECT_EQ(logErrorInWords(0.2), "about 22 %");
  EXPECT_EQ(logErrorInWords(0.05), "about 5.1 %");
  EXPECT_EQ(logErrorInWords(1), "a factor of 2.7");
}

}  // namespace
}  // namespace patina
