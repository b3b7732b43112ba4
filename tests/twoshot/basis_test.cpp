#include "engine/twoshot/basis.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "engine/base/file.h"
#include "engine/brdf/neural_brdf.h"
#include "engine/twoshot/basis_format.h"
#include "engine/twoshot/mapping.h"
#include "engine/twoshot/metric.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

// A component is rounded to 1/65534 of its range, and a few dozen add up.
constexpr double kStored = 2e-3;

// Eight materials, matte to glossy, built once for all tests.
class BasisOfEight : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::TempFolder();
    materials_ = new std::vector<BrdfPtr>();
    for (const int i : {0, 5, 13, 30, 44, 58, 71, 90}) materials_->push_back(builtInMaterials()[i]);
    Result<BasisPtr> built = buildBasis(*materials_, folder_->path() / "eight.basis", {}, {});
    ASSERT_TRUE(built.ok()) << built.error().sentence();
    basis_ = new BasisPtr(*built);
  }
  static void TearDownTestSuite() {
    delete basis_;
    delete materials_;
    delete folder_;
  }
  static fs::path file() { return folder_->path() / "eight.basis"; }

  static test::TempFolder* folder_;
  static std::vector<BrdfPtr>* materials_;
  static BasisPtr* basis_;
};
test::TempFolder* BasisOfEight::folder_ = nullptr;
std::vector<BrdfPtr>* BasisOfEight::materials_ = nullptr;
BasisPtr* BasisOfEight::basis_ = nullptr;

// Mapped values of all columns at a direction, from the materials themselves.
Eigen::VectorXd mappedHere(const std::vector<BrdfPtr>& materials, const HalfDiffAngles& angles) {
  std::vector<double> values;
  for (const BrdfPtr& brdf : materials) {
    Eigen::Array3f value;
    brdf->evaluateMany({&angles, 1}, {&value, 1});
    for (int c = 0; c < 3; ++c) values.push_back(value[c]);
  }
  std::vector<double> sorted = values;
  std::sort(sorted.begin(), sorted.end());
  const double median = (sorted[sorted.size() / 2] + sorted[sorted.size() / 2 - 1]) / 2;
  const double weight = mappingWeight(angles), reference = std::log(median * weight + kMappingEpsilon);
  Eigen::VectorXd mapped(static_cast<Eigen::Index>(values.size()));
  for (std::size_t i = 0; i < values.size(); ++i)
    mapped[static_cast<Eigen::Index>(i)] = mapBrdf(values[i], weight, reference);
  return mapped;
}

TEST_F(BasisOfEight, RowsAtCellCentresGiveBackEveryColumn) {
  const Basis& basis = **basis_;
  EXPECT_EQ(basis.columnCount(), 24);
  EXPECT_EQ(basis.componentCount(), 23);
  std::vector<HalfDiffAngles> angles;
  for (const std::size_t cell : {0, 123456, 300000, 610}) {
    if (foldedCellReachable(cell)) angles.push_back(foldedCentre(cell));
  }
  ASSERT_GE(angles.size(), 3u);
  const BasisRows rows = basis.rows(angles);
  ASSERT_EQ(rows.size(), static_cast<Eigen::Index>(angles.size()));
  for (std::size_t i = 0; i < angles.size(); ++i) {
    const Eigen::VectorXd truth = mappedHere(*materials_, angles[i]);
    const Eigen::VectorXd stored = (basis.columnCoefficients().transpose() *
                                    rows.components.row(static_cast<Eigen::Index>(i)).transpose())
                                       .array() +
                                   rows.mean[static_cast<Eigen::Index>(i)];
    EXPECT_LT((truth - stored).cwiseAbs().maxCoeff(), kStored);
  }
}

// The direction is between cells: linear interpolation of a smooth function.
TEST_F(BasisOfEight, RowsBetweenCellsFollowTheMaterials) {
  const double d = M_PI / 180;
  for (const HalfDiffAngles& angles :
       {HalfDiffAngles{20.3 * d, 31.4 * d, 45.7 * d}, HalfDiffAngles{41 * d, 20 * d, 170.2 * d},
        HalfDiffAngles{12.1 * d, 60.2 * d, -80 * d}}) {
    const BasisRows rows = (*basis_)->rows({&angles, 1});
    ASSERT_EQ(rows.size(), 1);
    for (int i = 0; i < 24; ++i) {
      const BrdfPtr& brdf = (*materials_)[i / 3];
      Eigen::Array3f value;
      brdf->evaluateMany({&angles, 1}, {&value, 1});
      const double here = mapBrdf(value[i % 3], rows.weight[0], rows.lnReference[0]);
      const double stored = rows.components.row(0) * (*basis_)->columnCoefficients().col(i) + rows.mean[0];
      EXPECT_NEAR(stored, here, 0.02) << brdf->origin().name;  // the fits' kinks, a degree apart
    }
  }
}

TEST_F(BasisOfEight, BelowTheSurfaceThereIsNoRow) {
  const double d = M_PI / 180;
  const std::vector<HalfDiffAngles> angles{{60 * d, 60 * d, 10 * d}, {10 * d, 30 * d, 90 * d}};
  std::vector<int> kept;
  EXPECT_EQ((*basis_)->rows(angles, &kept).size(), 1);
  EXPECT_EQ(kept, std::vector<int>{1});
}

TEST_F(BasisOfEight, ReconstructionOfAColumnIsTheMaterial) {
  const Basis& basis = **basis_;
  const auto brdf = basis.reconstruct(basis.columnCoefficients().middleCols(9, 3), {"again", "", "", ""}, {});
  std::size_t looked = 0;
  for (std::size_t cell = 37; cell < MerlGrid::kCells; cell += 4001) {
    const HalfDiffAngles angles = MerlGrid::centre(cell);
    const DirectionPair pair = directionsFromHalfDiff(angles);
    if (pair.toLight.z() <= 0 || pair.toView.z() <= 0) {
      EXPECT_FALSE(brdf->valid(cell));
      continue;
    }
    Eigen::Array3f truth;
    (*materials_)[3]->evaluateMany({&angles, 1}, {&truth, 1});
    const double w = mappingWeight(angles);
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(std::log(brdf->planes()[c][cell] * w + kMappingEpsilon),
                  std::log(std::max(0.0f, truth[c]) * w + kMappingEpsilon), kStored);
    }
    ++looked;
  }
  EXPECT_GT(looked, 200u);
}

TEST_F(BasisOfEight, SingularValuesAreTheColumnsSpread) {
  const Basis& basis = **basis_;
  // |Sigma c_i|^2 is the sum of squares of column i over the grid; by a thousandth of the cells, 3 % of
  // spread.
  double sum = 0;
  std::size_t looked = 0;
  for (std::size_t cell = 11; cell < kFoldedCells; cell += 977) {
    if (!foldedCellReachable(cell)) continue;
    const Eigen::VectorXd mapped = mappedHere(*materials_, foldedCentre(cell));
    sum += (mapped.array() - mapped.mean()).square().sum();
    ++looked;
  }
  const double expected = sum / looked * basis.cellCount(BasisRegion::All);
  EXPECT_NEAR(basis.singularValues().squaredNorm(), expected, 0.05 * expected);
  const Eigen::MatrixXd rebuilt =
      basis.gramRoot(BasisRegion::Trusted).transpose() * basis.gramRoot(BasisRegion::Trusted);
  EXPECT_LT((rebuilt - basis.gram(BasisRegion::Trusted)).norm(), 1e-9 * rebuilt.norm());
  EXPECT_LT(basis.cellCount(BasisRegion::Trusted), basis.cellCount(BasisRegion::All));
}

TEST_F(BasisOfEight, PosteriorOfNothingMeasuredIsThePriorAndShrinksWhereMeasured) {
  const Basis& basis = **basis_;
  const auto k = basis.componentCount();
  const double scale = 1.0 / basis.columnCount();
  const std::vector<float> prior = basis.posteriorSd(Eigen::MatrixXd(0, k), Eigen::MatrixXd(0, 0), scale, {});
  double sum = 0;
  std::size_t cells = 0;
  for (const float sd : prior) {
    if (sd >= 0) sum += sd * sd, ++cells;
  }
  EXPECT_EQ(cells, basis.cellCount(BasisRegion::All));
  const ErrorMetric metric(*basis_, BasisRegion::All);
  EXPECT_NEAR(std::sqrt(sum / cells), metric.expect(RowFactor{Eigen::MatrixXd(0, k)}).prior, 1e-3);

  const double d = M_PI / 180;
  const HalfDiffAngles seen = MerlGrid::centre(30, 40, 90);
  const BasisRows rows = basis.rows({&seen, 1});
  const Eigen::MatrixXd direction = rows.components.row(0).normalized();
  const double g = rows.components.row(0).squaredNorm(), eta = 1e-3;
  const std::vector<float> posterior =
      basis.posteriorSd(direction, Eigen::MatrixXd::Constant(1, 1, g / (g + eta)), scale, {});
  const std::size_t here = MerlGrid::cell(30, 40, 90);
  EXPECT_LT(posterior[here], 0.05 * prior[here]);
  for (std::size_t cell = 0; cell < posterior.size(); cell += 501)
    EXPECT_LE(posterior[cell], prior[cell] + 1e-5f);
  static_cast<void>(d);
}

TEST_F(BasisOfEight, IsTheSameFileWhateverTheThreads) {
  BasisBuildOptions named;
  named.name = "eight";
  Result<BasisPtr> again = buildBasis(*materials_, folder_->path() / "again.basis", named, {});
  ASSERT_TRUE(again.ok());
  EXPECT_EQ((*again)->checksum(), (*basis_)->checksum());
}

TEST_F(BasisOfEight, KeepsWhatItWasMadeFrom) {
  Result<BasisPtr> again = openBasis(file());
  ASSERT_TRUE(again.ok());
  ASSERT_EQ((*again)->materials().size(), 8u);
  EXPECT_EQ((*again)->materials()[2].name, (*materials_)[2]->origin().name);
  EXPECT_NE((*again)->materials()[2].checksum, (*again)->materials()[3].checksum);
  EXPECT_EQ((*again)->name(), "eight");
}

TEST_F(BasisOfEight, DamageIsNoticed) {
  const std::string whole = *readFile(file(), 1u << 30);
  const auto opens = [&](const std::string& bytes) {
    const fs::path damaged = folder_->path() / "damaged.basis";
    std::ofstream(damaged, std::ios::binary) << bytes;
    const Result<BasisPtr> opened = openBasis(damaged);
    if (!opened) {
      EXPECT_EQ(opened.error().code, ErrorCode::Malformed);
      EXPECT_FALSE(opened.error().what.empty());
      EXPECT_NE(opened.error().where.find("damaged.basis"), std::string::npos);
    }
    return opened.ok();
  };
  EXPECT_TRUE(opens(whole));
  EXPECT_FALSE(opens(""));
  EXPECT_FALSE(opens(whole.substr(0, 100)));
  EXPECT_FALSE(opens(whole.substr(0, whole.size() - 1)));
  EXPECT_FALSE(opens(whole + "x"));
  for (const std::size_t at :
       {std::size_t{3}, std::size_t{17}, std::size_t{60}, whole.size() / 2, whole.size() - 9}) {
    std::string flipped = whole;
    flipped[at] = static_cast<char>(flipped[at] ^ 4);
    EXPECT_FALSE(opens(flipped)) << at;
  }
  EXPECT_EQ(openBasis(folder_->path() / "none.basis").error().code, ErrorCode::NotFound);
  EXPECT_EQ(openBasis(folder_->path()).error().code, ErrorCode::Malformed);
}

TEST_F(BasisOfEight, CancelledLeavesNothingBehind) {
  std::stop_source stop;
  stop.request_stop();
  JobContext job;
  job.stop = stop.get_token();
  const test::TempFolder folder;
  const Result<BasisPtr> built = buildBasis(*materials_, folder.path() / "x.basis", {}, job);
  ASSERT_FALSE(built.ok());
  EXPECT_EQ(built.error().code, ErrorCode::Cancelled);
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST_F(BasisOfEight, RefusesWhatMakesNoBasis) {
  const test::TempFolder folder;
  const BrdfPtr one = materials_->front();
  EXPECT_EQ(buildBasis(std::vector<BrdfPtr>{one}, folder.path() / "x.basis", {}, {}).error().code,
            ErrorCode::Invalid);
  EXPECT_EQ(buildBasis(std::vector<BrdfPtr>{}, folder.path() / "x.basis", {}, {}).error().code,
            ErrorCode::Invalid);
  EXPECT_EQ(buildBasis(*materials_, folder.path() / "none" / "x.basis", {}, {}).error().code,
            ErrorCode::WriteFailed);
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST_F(BasisOfEight, FewerComponentsKeepTheLargest) {
  const test::TempFolder folder;
  BasisBuildOptions fewer;
  fewer.components = 5;
  Result<BasisPtr> small = buildBasis(*materials_, folder.path() / "x.basis", fewer, {});
  ASSERT_TRUE(small.ok());
  EXPECT_EQ((*small)->componentCount(), 5);
  EXPECT_NEAR((*small)->singularValues()[4], (*basis_)->singularValues()[4], 1e-6);
}

// The built-in basis: training error of given directions (two-shot-model: 0.327 and 0.194 on a stand-in
// corrected with measured slices, and "within a few percent" on the plain networks that ship). Ours is held
// to 2 %.
TEST(BuiltInBasis, KnownDirectionsHaveTheirError) {
  Result<BasisPtr> basis = builtInBasis({});
  ASSERT_TRUE(basis.ok()) << basis.error().sentence();
  EXPECT_EQ((*basis)->columnCount(), 300);
  const double d = M_PI / 180;
  const NearFieldDisc disc;
  const RowFactor one = rowsOfShot(**basis, shotFromHalfDiff({10 * d, 51.5 * d, 89.2 * d}), disc);
  const RowFactor a = rowsOfShot(**basis, shotFromHalfDiff({8 * d, 38.5 * d, 88.5 * d}), disc);
  const RowFactor b = rowsOfShot(**basis, shotFromHalfDiff({22 * d, 78.5 * d, 91.5 * d}), disc);
  const ErrorMetric metric(*basis, BasisRegion::All);
  EXPECT_NEAR(metric.training(one), 0.3392, 0.02 * 0.3392);
  EXPECT_NEAR(metric.training(stack({&a, &b})), 0.2003, 0.02 * 0.2003);
}

}  // namespace
}  // namespace patina
