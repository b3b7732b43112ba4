#include "app/window/rig/white_tile_step.h"

#include <QDoubleSpinBox>
#include <QFileDialog>
#include <QPushButton>
#include <numbers>

#include "widgets/live_overlay.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr int kFramesAveraged = 8;
constexpr double kInside = 0.9;      ///< of the disc's radius: its rim is no tile
constexpr double kLampASecond = 18;  ///< of full scale, of the simulated lamp
constexpr double kLampTilt = 0.5;    ///< radians, of the simulated lamp

}  // namespace

std::optional<PixelRegion> regionInDisc(const Camera& camera, double radiusMm) {
  // An axis-parallel rectangle in the convex outline of the disc: grown from the middle alike on all sides.
  const auto middle = camera.pixelFromWorld({0, 0, 0});
  if (!middle) return std::nullopt;
  const auto inside = [&](const Eigen::Vector2d& pixel) {
    if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() > camera.width - 1 || pixel.y() > camera.height - 1)
      return false;
    const auto at = camera.samplePlaneFromPixel(pixel);
    return at && at->head<2>().norm() <= kInside * radiusMm;
  };
  double right = 0, down = 0;
  while (inside(*middle + Eigen::Vector2d(right + 1, 0)) && inside(*middle - Eigen::Vector2d(right + 1, 0)))
    ++right;
  while (inside(*middle + Eigen::Vector2d(0, down + 1)) && inside(*middle - Eigen::Vector2d(0, down + 1)))
    ++down;
  // Of an ellipse the largest rectangle has 1 / sqrt 2 of both half axes.
  const double share = 1 / std::numbers::sqrt2;
  PixelRegion region;
  region.x0 = static_cast<int>(std::ceil(middle->x() - share * right));
  region.x1 = static_cast<int>(std::floor(middle->x() + share * right)) + 1;
  region.y0 = static_cast<int>(std::ceil(middle->y() - share * down));
  region.y1 = static_cast<int>(std::floor(middle->y() + share * down)) + 1;
  if (region.whole()) return std::nullopt;
  return region;
}

QString tileInWords(const WhiteTileCalibration& tile) {
  QStringList bad;
  for (const TileCheck& check : tile.checks) {
    if (check.passed) continue;
    QString sentence = QString::fromStdString(check.sentence);
    if (!sentence.isEmpty()) sentence[0] = sentence[0].toUpper();
    bad << (sentence.endsWith(QLatin1Char('.')) ? sentence : sentence + QLatin1Char('.'));
  }
  QString text = QObject::tr(
                     "Irradiance R G B %1, %2, %3 full scales a second, known to %4 %; the tile's "
                     "photograph is %5 % from smooth light.")
                     .arg(tile.mean[0], 0, 'g', 4)
                     .arg(tile.mean[1], 0, 'g', 4)
                     .arg(tile.mean[2], 0, 'g', 4)
                     .arg(100 * tile.relativeSd.maxCoeff(), 0, 'f', 2)
                     .arg(100 * tile.residual, 0, 'f', 2);
  return bad.isEmpty() ? text : bad.join(QLatin1Char('\n')) + QLatin1Char('\n') + text;
}

WhiteTileStep::WhiteTileStep(TwoShotTask& task) : CalibrationStep(task.rig(), "white-tile"), task_(task) {
  connect(&watcher_, &BoardWatcher::seen, this, [this](const BoardSightingPtr& sighting) {
    if (!entered()) return;
    sighting_ = sighting;
    seen_.reset();
    if (const auto lens = task_.lens(); lens && sighting->found.front().found) {
      const auto pose =
          poseFromMarkers(*lens, task_.markers(), task_.sampleHeightMm(), sighting->found.front().view);
      if (pose) seen_ = regionInDisc(pose->camera, task_.radiusMm());
    }
    view()->update();
  });
}

QString WhiteTileStep::title() const {
  return tr("White tile");
}

QString WhiteTileStep::sentence() const {
  return tr(
      "Enter what the tile's certificate says. Then lay the tile in the sample's place, under the lamp, and "
      "photograph it: dust, shadows and uneven light show here. It is photographed again with every shot.");
}

void WhiteTileStep::buildControls(QVBoxLayout* column, QWidget* parent) {
  column->addWidget(makeCaption(parent, tr("Certified reflectance, R G B")));
  auto* row = new QHBoxLayout;
  const QStringList channels = {tr("red"), tr("green"), tr("blue")};
  for (int c = 0; c < 3; ++c) {
    auto* box = new QDoubleSpinBox(parent);
    box->setObjectName(QStringLiteral("tile-reflectance-%1").arg(c));
    box->setAccessibleName(tr("Reflectance in %1").arg(channels[c]));
    box->setRange(0.05, 1.05);
    box->setDecimals(4);
    box->setSingleStep(0.001);
    box->setValue(task_.reflectance().rgb[c]);
    connect(box, &QDoubleSpinBox::valueChanged, this, [this] { task_.setReflectance(certified()); });
    reflectance_[static_cast<std::size_t>(c)] = box;
    row->addWidget(box);
  }
  column->addLayout(row);
  auto* load = makeButton(parent, tr("Load a Certificate\u2026"), QStringLiteral("tile-load"), false);
  load->setToolTip(tr("A table of wavelength in nm and reflectance"));
  column->addWidget(load, 0, Qt::AlignLeft);
  connect(load, &QPushButton::clicked, this, [this] {
    const QString file = choose_
                             ? choose_()
                             : QFileDialog::getOpenFileName(view()->window(), tr("Load a Certificate"), {},
                                                            tr("Tables (*.csv *.txt *.dat);;All files (*)"));
    if (!file.isEmpty()) loadCertificate(file);
  });
  source_ = makeCaption(parent, {});
  source_->hide();
  column->addWidget(source_);
  take_ = makeButton(parent, tr("Photograph the Tile"), QStringLiteral("tile-take"), true);
  column->addWidget(take_, 0, Qt::AlignLeft);
  connect(take_, &QPushButton::clicked, this, &WhiteTileStep::measure);
  addHand(tr("Lay Markers and Tile under the Lamp"), QStringLiteral("hand-tile"), [this] {
    return [markers = task_.markers(), radius = task_.radiusMm(),
            distance = task_.distanceMm()](SimulatedHands& hands) {
      hands.layMarkers(markers, 1.15 * radius);
      hands.placeSample(true);
      hands.moveCamera(Eigen::Vector3d(0.1, -0.35, 1).normalized(), distance);
      hands.moveLamp(Eigen::Vector3d(-std::sin(kLampTilt), 0.3, std::cos(kLampTilt)), kLampASecond);
    };
  });
  view()->setOverlay(
      [this](QPainter& painter, const QTransform& transform) { drawOver(painter, transform); });
}

void WhiteTileStep::enter() {
  CalibrationStep::enter();
  watcher_.setBoards({{task_.markers().board, BoardSide::Direct}});
}

void WhiteTileStep::frameCame(const LiveFramePtr& frame) {
  watcher_.look(frame);
}

void WhiteTileStep::refreshControls() {
  if (take_) take_->setEnabled(!working());
}

CertifiedReflectance WhiteTileStep::certified() const {
  CertifiedReflectance reflectance = table_;
  for (int c = 0; c < 3; ++c) {
    const double value = reflectance_[static_cast<std::size_t>(c)]->value();
    // The table's digits, unless somebody entered others.
    if (table_.source.empty() || std::abs(value - table_.rgb[c]) > 5e-5) {
      reflectance.rgb[c] = value;
      reflectance.source = "entered";
    }
  }
  if (reflectance.source.empty()) reflectance.source = "entered";
  return reflectance;
}

void WhiteTileStep::loadCertificate(const QString& file) {
  const auto table = readReflectanceTable(file.toStdString());
  if (!table) return say(sentencesOf(table.error()), Tone::Problem);
  table_ = *table;
  for (int c = 0; c < 3; ++c) reflectance_[static_cast<std::size_t>(c)]->setValue(table_.rgb[c]);
  task_.setReflectance(certified());
  source_->setText(tr("From %1; it varies by %2 over a channel's colours.")
                       .arg(QString::fromStdString(table_.source))
                       .arg(table_.spread.maxCoeff(), 0, 'f', 4));
  source_->show();
}

PixelRegion WhiteTileStep::region() const {
  if (seen_) return *seen_;
  const LiveFramePtr frame = view()->frame();
  if (!frame) return {};
  const int width = frame->linear.width(), height = frame->linear.height();
  return {2 * width / 5, 2 * height / 5, width - 2 * width / 5, height - 2 * height / 5};
}

void WhiteTileStep::measure() {
  if (!mayPhotograph()) return;
  PhotographOptions options;
  options.frames = kFramesAveraged;
  options.conversion = conversion();
  const PixelRegion where = region();
  CameraDevice* camera = rig().camera();
  const CertifiedReflectance reflectance = certified();
  task_.setReflectance(reflectance);
  work<WhiteTileCalibration>(
      tr("Photographing the tile"),
      [camera, options, where, reflectance](const JobContext& job) -> Result<WhiteTileCalibration> {
        const Result<Photograph> photo = takePhotograph(*camera, options, job);
        if (!photo) return photo.error();
        WhiteTileOptions how;
        how.region = where;
        how.exposureS = photo->exposureS > 0 ? photo->exposureS : 1;
        how.saturation = 1;
        return calibrateWhiteTile(photo->image, reflectance, how, job);
      },
      [this](WhiteTileCalibration tile) {
        result_ = tile;
        std::vector<std::string> remarks;
        for (const TileCheck& check : tile.checks)
          if (!check.passed) remarks.push_back(check.sentence);
        const StoredWhiteTile stored{tile.reflectance, tile.mean, tile.relativeSd, tile.region, ""};
        if (!keep(stored, 100 * tile.residual, "%", remarks, &result_->irradiance)) return;
        say(tileInWords(tile), tile.passed() ? Tone::Good : Tone::Problem);
        view()->update();
      });
}

CalibrationStep::Rechecker WhiteTileStep::rechecker() const {
  return [](const CalibrationRecord& record, const Photograph& photo, CameraDevice&, const JobContext&) {
    WhiteTileOptions options;
    options.region = std::get<StoredWhiteTile>(record.content).region;
    options.exposureS = photo.exposureS > 0 ? photo.exposureS : 1;
    options.saturation = 1;
    return recheckWhiteTile(record, photo.image, options);
  };
}

QString WhiteTileStep::recheckHint() const {
  return tr("Lay the tile where it lay, under the same lamp, with the camera where it stood.");
}

void WhiteTileStep::drawOver(QPainter& painter, const QTransform& transform) {
  if (sighting_) live_overlay::drawBoard(painter, transform, task_.markers().board, sighting_->found.front());
  const PixelRegion where = region();
  if (where.whole()) return;
  live_overlay::drawGhost(painter, transform,
                          QPolygonF(QRectF(where.x0, where.y0, where.x1 - where.x0, where.y1 - where.y0)));
}

}  // namespace patina
