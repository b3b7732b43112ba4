// What is kept of a rig, and the dialog that prints boards.
#include "app/window/rig/calibration_store.h"

#include <gmock/gmock.h>

#include <QDoubleSpinBox>
#include <QFile>
#include <QLabel>
#include <QPushButton>
#include <QTemporaryDir>
#include <QTest>

#include "engine/image/exr.h"
#include "widgets/board_chooser.h"
#include "widgets/board_print_dialog.h"
#include "widgets/board_watcher.h"

namespace patina::test {
namespace {

using testing::HasSubstr;

CalibrationRecord curveTaken(int hoursAgo, double residual) {
  ScreenCurve curve;
  curve.value = {0, 0.5, 1};
  curve.light = {0, 0.2, 1};
  CalibrationRecord record;
  record.content = StoredScreenResponse{curve};
  record.device = "Screen";
  record.taken = std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now()) -
                 std::chrono::hours(hoursAgo);
  record.residual = residual;
  record.residualUnit = "%";
  record.madeBy = "test";
  return record;
}

TEST(CalibrationStore, KeepsWhatItReplacesAndPutsItBack) {
  const QTemporaryDir folder;
  const CalibrationStore store(std::filesystem::path(folder.path().toStdString()) / "new" / "rig");
  EXPECT_EQ(store.inUse("screen-response").error().code, ErrorCode::NotFound);
  EXPECT_TRUE(store.list("screen-response").empty());
  for (const int hours : {48, 24, 0}) ASSERT_TRUE(store.keep(curveTaken(hours, 0.1 * hours + 0.3)).ok());
  auto entries = store.list("screen-response");
  ASSERT_EQ(entries.size(), 3u);
  EXPECT_TRUE(entries[0].inUse);
  EXPECT_DOUBLE_EQ(entries[0].record.residual, 0.3);
  EXPECT_FALSE(entries[1].inUse);
  EXPECT_DOUBLE_EQ(entries[1].record.residual, 2.7) << "the newest of those that were replaced";
  ASSERT_TRUE(store.restore(entries[2].file).ok());
  EXPECT_DOUBLE_EQ(store.inUse("screen-response")->residual, 5.1);
  EXPECT_EQ(store.list("screen-response").size(), 4u) << "what was in use then is kept too";
  EXPECT_TRUE(store.list("camera").empty());
}

TEST(CalibrationStore, AWhiteTileTakesItsMapAlong) {
  const QTemporaryDir folder;
  const CalibrationStore store(folder.path().toStdString());
  CalibrationRecord record = curveTaken(5, 0.2);
  StoredWhiteTile tile;
  tile.irradiance = {1, 2, 3};
  record.content = tile;
  const Image first(4, 3, 3, 1.5f), second(4, 3, 3, 2.5f);
  ASSERT_TRUE(store.keep(record, &first).ok());
  record.taken += std::chrono::hours(1);
  ASSERT_TRUE(store.keep(record, &second).ok());
  const auto mapOf = [](const CalibrationStore::Entry& entry) {
    return readExr(entry.file.parent_path() / std::get<StoredWhiteTile>(entry.record.content).mapFile,
                   {"R", "G", "B"});
  };
  const auto entries = store.list("white-tile");
  ASSERT_EQ(entries.size(), 2u);
  for (int k = 0; k < 2; ++k) {
    const auto map = mapOf(entries[static_cast<std::size_t>(k)]);
    ASSERT_TRUE(map.ok()) << map.error().sentence();
    EXPECT_EQ(map->at(0, 0, 0), k == 0 ? 2.5f : 1.5f);
  }
}

TEST(CalibrationStore, SaysWhereItCantWrite) {
  const QTemporaryDir folder;
  QFile file(folder.filePath("a file"));
  ASSERT_TRUE(file.open(QIODevice::WriteOnly));
  file.close();
  const Status kept = CalibrationStore(folder.filePath("a file/rig").toStdString()).keep(curveTaken(0, 0.1));
  ASSERT_FALSE(kept.ok());
  EXPECT_THAT(kept.error().sentence(), HasSubstr("can't be kept"));
}

TEST(BoardPrintDialog, SavesToScaleAndTakesThePrintersScaleIn) {
  const QTemporaryDir folder;
  BoardPrintDialog dialog(Board::forCamera());
  const QString file = folder.filePath("board.svg");
  dialog.setChooseFile([file] { return file; });
  dialog.show();
  QTest::mouseClick(dialog.findChild<QPushButton*>("printSave"), Qt::LeftButton);
  QFile saved(file);
  ASSERT_TRUE(saved.open(QIODevice::ReadOnly)) << dialog.said()->text().toStdString();
  EXPECT_EQ(saved.readAll().toStdString(), drawBoardSvg(Board::forCamera())->c_str());
  ASSERT_TRUE(dialog.saveTo(folder.filePath("board.pdf")).ok());
  dialog.measured()->setValue(98.5);
  EXPECT_NEAR(dialog.board().squareMm, 0.985 * 22, 1e-9);
  EXPECT_THAT(dialog.said()->text().toStdString(), HasSubstr("-1.5 %"));
  // Larger than its paper: said, and nothing can be saved.
  dialog.chooser()->side()->setValue(40);
  EXPECT_FALSE(dialog.findChild<QPushButton*>("printSave")->isEnabled());
}

TEST(StillnessJudge, WaitsForABoardThatStandsStillAndAveragesIt) {
  StillnessJudge judge(3, 0.5);
  const auto viewAt = [](double x) {
    BoardView view;
    view.imageWidth = view.imageHeight = 100;
    for (int id = 0; id < 6; ++id) view.corners.push_back({id, {x + 5 * id, 10}});
    return view;
  };
  EXPECT_FALSE(judge.add(viewAt(0)));
  EXPECT_FALSE(judge.add(viewAt(0.3)));
  EXPECT_FALSE(judge.add(viewAt(3))) << "it moved";
  EXPECT_FALSE(judge.add(viewAt(3.2)));
  EXPECT_TRUE(judge.add(viewAt(3.4)));
  EXPECT_NEAR(judge.mean().corners[2].pixel.x(), 13.2, 1e-9);
}

}  // namespace
}  // namespace patina::test
