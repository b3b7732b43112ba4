// What the shots' page shows, and what an operator of the simulated rig does.
#include <Eigen/Geometry>
#include <QDoubleSpinBox>
#include <QPushButton>
#include <numbers>

#include "app/window/rig/calibration_step.h"
#include "app/window/rig/shots_step.h"
#include "devices/simulated/live_rig.h"
#include "widgets/live_overlay.h"
#include "widgets/live_view.h"

namespace patina {

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kFarDeg = 15;       ///< off by which the arrow is as long as it gets
constexpr double kPinMm = 20;        ///< of the pin whose shadow is drawn
constexpr double kLampASecond = 18;  ///< full scales, of the simulated lamp on a white tile that faces it

QString polarWords(const Eigen::Vector3d& direction) {
  return QObject::tr("%1\u00b0 from the normal, azimuth %2\u00b0")
      .arg(std::acos(std::clamp(direction.z(), -1.0, 1.0)) / kDegree, 0, 'f', 1)
      .arg(std::round(10 * std::atan2(direction.y(), direction.x()) / kDegree) / 10 + 0.0, 0, 'f', 1);
}

}  // namespace

void ShotsStep::buildHands(QVBoxLayout* column, QWidget* parent) {
  auto* caption = new QLabel(tr("Simulated rig: what an operator would do"), parent);
  caption->setProperty("role", "caption");
  caption->setWordWrap(true);
  column->addWidget(caption);
  const auto hand = [&](const QString& text, const char* name, std::function<void()> handler) {
    auto* made = new QPushButton(text, parent);
    made->setObjectName(QLatin1String(name));
    column->addWidget(made, 0, Qt::AlignLeft);
    connect(made, &QPushButton::clicked, this, std::move(handler));
  };
  hand(tr("Lay Markers and Sample"), "hand-sample", [this] {
    act([markers = task_.markers(), radius = task_.radiusMm()](SimulatedHands& hands) {
      hands.layMarkers(markers, 1.15 * radius);
      hands.placeSample(false);
    });
  });
  hand(tr("Lay the Tile"), "hand-shot-tile",
       [this] { act([](SimulatedHands& hands) { hands.placeSample(true); }); });
  hand(tr("Move the Camera Roughly There"), "hand-camera", [this] {
    if (!session_) return;
    const Eigen::Vector3d wanted =
        session_->setup().shots[static_cast<std::size_t>(shot_)].directions.toCamera;
    // Some degrees beside, and too far away: as a person begins.
    const Eigen::Vector3d beside =
        Eigen::AngleAxisd(6 * kDegree, wanted.unitOrthogonal()).toRotationMatrix() * wanted;
    act([beside, distance = 1.08 * session_->setup().distanceMm](SimulatedHands& hands) {
      hands.moveCamera(beside, distance);
    });
  });
  hand(tr("Move the Camera as Told"), "hand-follow", [this] {
    if (!session_) return;
    // Near the plan, as well as a person does it.
    const Eigen::Vector3d wanted =
        session_->setup().shots[static_cast<std::size_t>(shot_)].directions.toCamera;
    const Eigen::Vector3d near =
        Eigen::AngleAxisd(0.6 * kDegree, wanted.unitOrthogonal()).toRotationMatrix() * wanted;
    act([near, distance = session_->setup().distanceMm + 2](SimulatedHands& hands) {
      hands.moveCamera(near, distance);
    });
  });
  hand(tr("Move the Lamp to the Angles"), "hand-lamp",
       [this] { act([to = toLight()](SimulatedHands& hands) { hands.moveLamp(to, kLampASecond); }); });
}

void ShotsStep::act(std::function<void(SimulatedHands&)> what) {
  const std::shared_ptr<LiveRig> simulation = task_.rig().simulation();
  if (!simulation || task_.rig().busy()) return;
  task_.rig().run<Done>(
      tr("Moving things in the simulated rig"),
      [simulation, what = std::move(what)](const JobContext&) -> Status {
        SimulatedHands hands(simulation);
        what(hands);
        return Done{};
      },
      [this](Status) { refresh(); });
}

void ShotsStep::refresh() {
  if (body_) {
    const bool begun = session_ != nullptr;
    const auto at = [&](TwoShotStep step) { return begun && step_ == step; };
    const bool camera = at(TwoShotStep::PlaceCamera), light = at(TwoShotStep::PlaceLight);
    const bool photo = at(TwoShotStep::PhotographSample) || at(TwoShotStep::PhotographTile);
    beginBox_->setVisible(!session_);
    begin_->setEnabled(!task_.shots().empty());
    cameraBox_->setVisible(camera);
    lightBox_->setVisible(light);
    photoBox_->setVisible(photo || at(TwoShotStep::PlaceTile));
    photo_->setVisible(photo);
    photo_->setEnabled(!working_);
    tile_->setVisible(at(TwoShotStep::PlaceTile));
    retake_->setEnabled(!working_);
    handsBox_->setVisible(task_.rig().simulation() != nullptr && !working_);
    workBox_->setVisible(working_);
    photo_->setText(at(TwoShotStep::PhotographTile) ? tr("Photograph the Tile")
                                                    : tr("Photograph the Sample"));
    QStringList lines;
    if (session_)
      for (int shot = 0; shot < static_cast<int>(session_->setup().shots.size()); ++shot) {
        const bool over = at(TwoShotStep::Done) || shot < shot_;
        const bool now = !at(TwoShotStep::Done) && shot == shot_;
        lines << tr("%1 Shot %2: camera %3")
                     .arg(over  ? QStringLiteral("\u2713")
                          : now ? QStringLiteral("\u2192")
                                : QStringLiteral("\u00b7"))
                     .arg(shot + 1)
                     .arg(polarWords(
                         session_->setup().shots[static_cast<std::size_t>(shot)].directions.toCamera));
      }
    where_->setText(lines.join(QLatin1Char('\n')));
    where_->setVisible(!lines.isEmpty());
    place_->setEnabled(guide_ && guide_->within);
    accept_->setEnabled(guide_ && !guide_->within && guide_->sampleInPicture);
    accept_->setText(guide_ && guide_->costPercent > 0
                         ? tr("Accept the Price: %1 % More Error").arg(guide_->costPercent, 0, 'f', 1)
                         : tr("Accept This Place"));
    if (guide_) {
      QString text = tr("%1\u00b0 beside the plan, %2 mm too %3; aimed %4\u00b0 beside the middle.")
                         .arg(guide_->offDeg, 0, 'f', 1)
                         .arg(std::abs(guide_->closerMm), 0, 'f', 0)
                         .arg(guide_->closerMm >= 0 ? tr("far") : tr("near"))
                         .arg(guide_->aimOffDeg, 0, 'f', 1);
      if (guide_->errorNow >= 0)
        text += tr("\nExpected error from here: %1 (planned %2).")
                    .arg(guide_->errorNow, 0, 'f', 3)
                    .arg(guide_->plannedError, 0, 'f', 3);
      numbers_->setText(text);
    } else {
      numbers_->setText(sighting_ && !sighting_->found.front().found
                            ? sightingInWords(sighting_->found.front(), task_.markers().board)
                            : tr("The markers are being looked for."));
    }
    placeLight_->setEnabled(lightGuide_ && lightGuide_->within);
    acceptLight_->setEnabled(lightGuide_ && !lightGuide_->within);
    if (session_ && light) {
      const ShotDirections& planned = session_->setup().shots[static_cast<std::size_t>(shot_)].directions;
      QString text = tr("Planned: %1.").arg(polarWords(planned.toLight));
      if (lightGuide_) {
        text += QLatin1Char('\n') + QString::fromStdString(lightGuide_->sentence);
        if (lightGuide_->costPercent > 0)
          text += tr("\nFrom there the error would be %1 % more.").arg(lightGuide_->costPercent, 0, 'f', 1);
      }
      lightWords_->setText(text);
    }
    photoWords_->setText(at(TwoShotStep::PlaceTile)
                             ? tr("Lay the tile so that its surface is where the sample's was.")
                             : tr("The exposure is chosen from the histogram; a wide range takes several."));
  }
  Q_EMIT changed();
}

void ShotsStep::drawOver(QPainter& painter, const QTransform& transform) {
  const QRectF within = view_->rect();
  if (sighting_ && (!session_ || step_ == TwoShotStep::PlaceCamera))
    live_overlay::drawBoard(painter, transform, task_.markers().board, sighting_->found.front());
  if (pose_) {
    // The part of the sample that counts.
    QPolygonF disc;
    for (int k = 0; k < 48; ++k) {
      const double at = 2 * std::numbers::pi * k / 48;
      const auto pixel =
          pose_->camera.pixelFromWorld(task_.radiusMm() * Eigen::Vector3d(std::cos(at), std::sin(at), 0));
      if (pixel) disc << QPointF(pixel->x() + 0.5, pixel->y() + 0.5);
    }
    live_overlay::drawGhost(painter, transform, disc);
    if (session_ && step_ == TwoShotStep::PlaceLight) {
      // A pin's shadow falls away from the lamp.
      const Eigen::Vector3d to = toLight();
      const Eigen::Vector3d tip = Eigen::Vector3d(-to.x(), -to.y(), 0) * (kPinMm / std::max(0.05, to.z()));
      const auto foot = pose_->camera.pixelFromWorld({0, 0, 0}), end = pose_->camera.pixelFromWorld(tip);
      if (foot && end)
        live_overlay::drawGhost(
            painter, transform,
            QPolygonF{QPointF(foot->x() + 0.5, foot->y() + 0.5), QPointF(end->x() + 0.5, end->y() + 0.5)});
    }
  }
  if (!session_ || step_ != TwoShotStep::PlaceCamera) return;
  if (guide_) {
    live_overlay::drawSentence(painter, within, QString::fromStdString(guide_->sentence), guide_->within);
    if (!guide_->within)
      live_overlay::drawArrow(painter, within, -guide_->leftDeg / kFarDeg, guide_->upDeg / kFarDeg);
  } else {
    live_overlay::drawSentence(painter, within, tr("The markers are not seen."), false);
  }
}

}  // namespace patina
