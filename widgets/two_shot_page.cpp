#include "widgets/two_shot_page.h"

#include <QDataStream>
#include <QIODevice>
#include <QSplitter>

#include "widgets/brdf_slices_panel.h"
#include "widgets/brdf_sphere_viewport.h"
#include "widgets/comparison_panel.h"
#include "widgets/shot_strip.h"
#include "widgets/theme.h"
#include "widgets/two_shot_report.h"

namespace patina {

namespace {

/// Directions that a capture's fitted photographs measure, a few thousand at most: every pixel of a coarse
/// grid over the sample.
std::vector<HalfDiffAngles> measuredDirections(const TwoShotCapture& capture) {
  constexpr int kAcross = 24;
  const double x = capture.disc ? capture.radiusMm : capture.widthMm / 2;
  const double y = capture.disc ? capture.radiusMm : capture.heightMm / 2;
  std::vector<HalfDiffAngles> angles;
  for (const TwoShotPhoto& shot : capture.shots) {
    if (shot.holdout) continue;
    const Eigen::Vector3d camera = shot.camera.positionMm();
    for (int j = 0; j < kAcross; ++j)
      for (int i = 0; i < kAcross; ++i) {
        const Eigen::Vector3d place((2 * (i + 0.5) / kAcross - 1) * x, (2 * (j + 0.5) / kAcross - 1) * y, 0);
        if (capture.onSample(place.x(), place.y()))
          angles.push_back(halfDiffFromDirections(shot.toLight, (camera - place).normalized()));
      }
  }
  return angles;
}

}  // namespace

TwoShotPage::TwoShotPage(TwoShotDocument* document, Reader reader, QWidget* parent)
    : QWidget(parent), document_(document), reader_(std::move(reader)) {
  setObjectName(QStringLiteral("twoShotPage"));
  cache_ = new PhotoCache(this);
  // Before the strip listens: it asks the cache for photographs of the bundle that is opened.
  connect(document_, &TwoShotDocument::captureChanged, this, [this] {
    PhotoCache::Source source;
    if (const auto capture = document_->capture()) {
      for (const TwoShotPhoto& shot : capture->shots) source.names.push_back(shot.file);
      for (const TwoShotPhoto& shot : capture->whiteShots) source.names.push_back(shot.file);
      source.tone = [shots = static_cast<int>(capture->shots.size())](int photo, const Image& image) {
        return photo < shots ? shotTone(image) : automaticTone(ToneStyle::LinearRgb, image);
      };
      source.read = [read = reader_, capture](int photo) {
        const auto shots = static_cast<int>(capture->shots.size());
        return read(*capture, photo < shots ? capture->shots[photo] : capture->whiteShots[photo - shots]);
      };
    }
    cache_->open(std::move(source));
    slices_->setMeasured(document_->capture() ? measuredDirections(*document_->capture())
                                              : std::vector<HalfDiffAngles>{});
  });
  strip_ = new ShotStrip(document_, cache_, this);
  comparison_ = new ComparisonPanel(document_, cache_, this);
  report_ = new TwoShotReport(document_, this);
  sphere_ = new BrdfSphereViewport(this);
  slices_ = new BrdfSlicesPanel(this);

  const auto splitter = [this](Qt::Orientation orientation) {
    auto* made = new QSplitter(orientation, this);
    made->setHandleWidth(3);
    made->setChildrenCollapsible(false);
    return made;
  };
  middle_ = splitter(Qt::Vertical);
  middle_->addWidget(comparison_);
  middle_->addWidget(report_);
  middle_->setStretchFactor(0, 3);
  middle_->setStretchFactor(1, 1);
  middle_->setSizes({560, 210});
  right_ = splitter(Qt::Vertical);
  right_->addWidget(sphere_);
  right_->addWidget(slices_);
  right_->setStretchFactor(0, 1);
  right_->setStretchFactor(1, 1);
  right_->setSizes({370, 430});
  columns_ = splitter(Qt::Horizontal);
  columns_->addWidget(strip_);
  columns_->addWidget(middle_);
  columns_->addWidget(right_);
  columns_->setStretchFactor(0, 0);
  columns_->setStretchFactor(1, 6);
  columns_->setStretchFactor(2, 5);
  columns_->setSizes({strip_->sizeHint().width(), 620, 520});
  auto* row = new QHBoxLayout(this);
  row->setContentsMargins(0, 0, 0, 0);
  row->addWidget(columns_);

  connect(strip_, &ShotStrip::shotSelected, this,
          [this](int shot) { comparison_->setShot(strip_->entry(shot)); });
  connect(strip_, &ShotStrip::shotsChanged, this, [this] {
    if (strip_->count() == 0) comparison_->clear();
  });
  connect(document_, &TwoShotDocument::fitChanged, this, &TwoShotPage::refreshMaterial);
  connect(document_, &TwoShotDocument::materialChanged, this, &TwoShotPage::refreshMaterial);
}

void TwoShotPage::refreshMaterial() {
  const TwoShotMaterial* material = document_->shownMaterial();
  sphere_->setMaterial(material ? material->brdf : nullptr, material ? material->posteriorSd : nullptr,
                       material ? material->priorSd : 0);
  slices_->setMaterial(material ? material->brdf : nullptr, material ? material->posteriorSd : nullptr,
                       material ? material->priorSd : 0);
}

void TwoShotPage::setSphereShown(bool shown) {
  sphere_->setVisible(shown);
  right_->setVisible(shown || slices_->isVisibleTo(right_));
}

void TwoShotPage::setSlicesShown(bool shown) {
  slices_->setVisible(shown);
  right_->setVisible(shown || sphere_->isVisibleTo(right_));
}

void TwoShotPage::setStripShown(bool shown) {
  strip_->setVisible(shown);
}

void TwoShotPage::setReportShown(bool shown) {
  report_->setVisible(shown);
}

QByteArray TwoShotPage::saveLayout() const {
  QByteArray state;
  QDataStream stream(&state, QIODevice::WriteOnly);
  stream << columns_->saveState() << middle_->saveState() << right_->saveState();
  return state;
}

void TwoShotPage::restoreLayout(const QByteArray& state) {
  QDataStream stream(state);
  for (QSplitter* splitter : {columns_, middle_, right_}) {
    QByteArray one;
    stream >> one;
    if (stream.status() != QDataStream::Ok) return;
    splitter->restoreState(one);
  }
}

}  // namespace patina
