#include "widgets/two_shot_report.h"

#include <QHeaderView>
#include <QScrollArea>
#include <QTableWidget>
#include <QTextDocumentFragment>

#include "widgets/comparison_panel.h"
#include "widgets/shot_entry.h"
#include "widgets/theme.h"

namespace patina {

namespace {

QString escaped(const std::string& text) {
  return QString::fromStdString(text).toHtmlEscaped();
}

/// "22 % (0.20 in natural-log units)".
QString inWords(double lnUnits) {
  return TwoShotReport::tr("%1&nbsp;(%2 ln)").arg(logErrorText(lnUnits)).arg(lnUnits, 0, 'f', 2);
}

QString heading(const QString& text) {
  return QStringLiteral("<p style='margin:8px 0 2px 0; color:%1'>%2</p>").arg(theme::kTextDim.name(), text);
}

QString paragraph(const QString& text) {
  return QStringLiteral("<p style='margin:0 0 3px 0'>%1</p>").arg(text);
}

int heldOut(const TwoShotFit& fit) {
  return static_cast<int>(std::count_if(fit.capture.shots.begin(), fit.capture.shots.end(),
                                        [](const TwoShotPhoto& shot) { return shot.holdout; }));
}

QString bundleText(const TwoShotCapture& capture) {
  int fitted = 0, held = 0;
  QString directions;
  for (const ShotEntry& entry : shotEntries(capture, nullptr)) {
    if (entry.white) continue;
    ++(entry.shot->holdout ? held : fitted);
    if (entry.shot->holdout) continue;
    directions += paragraph(TwoShotReport::tr("%1: %2").arg(
        entry.title, namedAnglesText(directionsOf(*entry.shot).centre(), 1).toHtmlEscaped()));
  }
  QString text = paragraph(TwoShotReport::tr(
      "Not reconstructed yet. <b>Reconstruct</b> (F5) finds the reflectance of the sample in all directions "
      "from its photographs, and says how far to trust it."));
  text += heading(TwoShotReport::tr("The photographs"));
  text +=
      paragraph(TwoShotReport::tr("%1 to reconstruct from, %2 held out to measure the error of prediction, "
                                  "%3.")
                    .arg(fitted)
                    .arg(held)
                    .arg(capture.whiteShots.empty()
                             ? TwoShotReport::tr("the lights' irradiance known without a white tile")
                             : TwoShotReport::tr("%1 of the white tile").arg(capture.whiteShots.size())));
  text += heading(TwoShotReport::tr("Directions at the sample's centre"));
  text += directions;
  text += paragraph(TwoShotReport::tr("The sample subtends %1\u00b0 from the camera.")
                        .arg(discOf(capture).fovDeg, 0, 'f', 0));
  return text;
}

QString fitText(const TwoShotFit& fit, const TwoShotMaterial& material, int shown) {
  const TwoShotStats& stats = fit.stats;
  const QString which =
      fit.materials.size() > 1 ? TwoShotReport::tr(" (material %1)").arg(shown + 1) : QString();
  QString text = heading(TwoShotReport::tr("In short%1").arg(which));
  if (material.expected.unseen > 0)
    text +=
        paragraph(TwoShotReport::tr("Error to expect over all directions: <b>%1</b>; of ten materials one "
                                    "is worse than %2.")
                      .arg(inWords(material.expected.unseen), inWords(material.expected.unseenWorstTenth)));
  else if (material.expected.training > 0)
    text += paragraph(TwoShotReport::tr("Error to expect over all directions: <b>%1</b>, for a material like "
                                        "the basis' own.")
                          .arg(inWords(material.expected.training)));
  else
    text += paragraph(TwoShotReport::tr("The error to expect is not known for this reconstruction."));
  QStringList reached;
  const auto figure = [](const QString& what, double rms, double noise) {
    QString part = TwoShotReport::tr("<b>%1</b> %2").arg(percentText(rms), what);
    if (noise > 0) part += TwoShotReport::tr(" (noise alone %1)").arg(percentText(noise));
    return part;
  };
  if (stats.fitRms >= 0)
    reached << figure(TwoShotReport::tr("on the photographs it was made from"), stats.fitRms,
                      stats.noiseFloorFit);
  if (stats.holdoutRms >= 0)
    reached << figure(TwoShotReport::tr("on %1 held out").arg(heldOut(fit)), stats.holdoutRms,
                      stats.noiseFloorHoldout);
  if (!reached.isEmpty())
    text += paragraph(TwoShotReport::tr("RMS reached: %1.").arg(reached.join(QStringLiteral(", "))));
  if (stats.holdoutRms < 0)
    text += paragraph(
        TwoShotReport::tr("No photograph was held out, so the error of prediction is not measured here."));
  if (!stats.remarks.empty()) {
    text += heading(TwoShotReport::tr("Remarks"));
    for (const std::string& remark : stats.remarks)
      text += paragraph(QStringLiteral("\u2022&nbsp;") + escaped(remark));
  }
  text += heading(TwoShotReport::tr("What it rests on"));
  text += paragraph(TwoShotReport::tr("%L1 pixels on the sample, averaged to %L2 measurements.")
                        .arg(stats.pixels)
                        .arg(stats.rows));
  QStringList left;
  if (stats.clippedPixels > 0) left << TwoShotReport::tr("%L1 clipped").arg(stats.clippedPixels);
  if (stats.darkPixels > 0) left << TwoShotReport::tr("%L1 too dark").arg(stats.darkPixels);
  if (stats.unreachedPixels > 0)
    left << TwoShotReport::tr("%L1 in directions that the basis does not cover").arg(stats.unreachedPixels);
  text += paragraph(left.isEmpty() ? TwoShotReport::tr("No pixel was left out.")
                                   : TwoShotReport::tr("Left out: %1.").arg(left.join(QStringLiteral(", "))));
  const Eigen::Vector3d& eta = material.eta;
  if (eta.maxCoeff() > 0)
    text += paragraph(
        (eta.maxCoeff() - eta.minCoeff() < 1e-6 * eta.maxCoeff()
             ? TwoShotReport::tr("Weight of the basis: eta %1").arg(eta[0], 0, 'g', 3)
             : TwoShotReport::tr("Weight of the basis: eta %1 / %2 / %3 (R, G, B)")
                   .arg(eta[0], 0, 'g', 3)
                   .arg(eta[1], 0, 'g', 3)
                   .arg(eta[2], 0, 'g', 3)) +
        (fit.options.chooseEta ? TwoShotReport::tr(", chosen by cross-validation.") : QStringLiteral(".")));
  if (fit.basis)
    text += paragraph(TwoShotReport::tr("Basis: %1, %2 materials. %3")
                          .arg(escaped(fit.basis->name()))
                          .arg(fit.basis->materials().size())
                          .arg(escaped(fit.basis->source())));
  return text;
}

}  // namespace

TwoShotReport::TwoShotReport(TwoShotDocument* document, QWidget* parent)
    : QWidget(parent), document_(document) {
  setObjectName(QStringLiteral("twoShotReport"));
  words_ = new QLabel(this);
  words_->setObjectName(QStringLiteral("twoShotWords"));
  words_->setTextFormat(Qt::RichText);
  words_->setWordWrap(true);
  words_->setAlignment(Qt::AlignTop | Qt::AlignLeft);
  words_->setTextInteractionFlags(Qt::TextSelectableByMouse | Qt::TextSelectableByKeyboard);
  words_->setContentsMargins(12, 4, 12, 10);
  words_->setAccessibleName(tr("The reconstruction in words"));
  auto* scroll = new QScrollArea(this);
  scroll->setWidget(words_);
  scroll->setWidgetResizable(true);
  scroll->setFrameShape(QFrame::NoFrame);
  scroll->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  scroll->setAccessibleName(tr("The reconstruction in words"));
  materials_ = new QTableWidget(0, 3, this);
  materials_->setObjectName(QStringLiteral("materials"));
  materials_->setAccessibleName(tr("Materials of the sample"));
  materials_->setToolTip(tr("Choose the material that the sphere, the slices and the words are about"));
  materials_->setHorizontalHeaderLabels({tr("Material"), tr("Share"), tr("Expected error")});
  materials_->horizontalHeader()->setSectionResizeMode(QHeaderView::ResizeToContents);
  materials_->horizontalHeader()->setStretchLastSection(true);
  materials_->verticalHeader()->hide();
  materials_->verticalHeader()->setDefaultSectionSize(fontMetrics().height() + 8);
  materials_->setSelectionBehavior(QAbstractItemView::SelectRows);
  materials_->setSelectionMode(QAbstractItemView::SingleSelection);
  materials_->setEditTriggers(QAbstractItemView::NoEditTriggers);
  materials_->setShowGrid(false);
  auto* row = new QHBoxLayout(this);
  row->setContentsMargins(0, 0, 0, 0);
  row->setSpacing(0);
  row->addWidget(scroll, 3);
  row->addWidget(materials_, 2);
  connect(materials_, &QTableWidget::currentCellChanged, this, [this](int material) {
    if (!updating_ && material >= 0) document_->setMaterial(material);
  });
  connect(document_, &TwoShotDocument::captureChanged, this, &TwoShotReport::refresh);
  connect(document_, &TwoShotDocument::fitChanged, this, &TwoShotReport::refresh);
  connect(document_, &TwoShotDocument::materialChanged, this, &TwoShotReport::refresh);
  refresh();
}

void TwoShotReport::refresh() {
  const auto fit = document_->fit();
  const auto capture = document_->capture();
  const TwoShotMaterial* material = document_->shownMaterial();
  words_->setText(fit && material ? fitText(*fit, *material, document_->material())
                  : capture       ? bundleText(*capture)
                                  : QString());
  refreshMaterials();
}

void TwoShotReport::refreshMaterials() {
  const auto fit = document_->fit();
  const int count = fit && fit->materials.size() > 1 ? static_cast<int>(fit->materials.size()) : 0;
  materials_->setVisible(count > 0);
  updating_ = true;
  materials_->setRowCount(count);
  for (int i = 0; i < count; ++i) {
    const TwoShotMaterial& material = fit->materials[i];
    QPixmap swatch(fontMetrics().height(), fontMetrics().height());
    swatch.fill(materialColour(i));
    auto* name = new QTableWidgetItem(QIcon(swatch), tr("Material %1").arg(i + 1));
    materials_->setItem(i, 0, name);
    materials_->setItem(i, 1, new QTableWidgetItem(percentText(material.share)));
    materials_->setItem(
        i, 2,
        new QTableWidgetItem(material.expected.unseen > 0 ? logErrorText(material.expected.unseen)
                                                          : QStringLiteral("\u2013")));
  }
  if (count > 0) materials_->setCurrentCell(document_->material(), 0);
  updating_ = false;
}

QString TwoShotReport::text() const {
  return QTextDocumentFragment::fromHtml(words_->text()).toPlainText();
}

QString twoShotHealth(const TwoShotFit& fit) {
  const TwoShotStats& stats = fit.stats;
  const auto total = stats.seconds.find("total");
  QString text =
      stats.cancelled ? TwoShotReport::tr("Cancelled reconstruction") : TwoShotReport::tr("Reconstructed");
  if (total != stats.seconds.end()) text += TwoShotReport::tr(" in %1 s").arg(total->second, 0, 'f', 1);
  if (stats.fitRms >= 0)
    text += QStringLiteral("  \u00b7  ") + TwoShotReport::tr("fit RMS %1").arg(percentText(stats.fitRms));
  if (stats.holdoutRms >= 0)
    text += QStringLiteral("  \u00b7  ") +
            TwoShotReport::tr("held-out RMS %1").arg(percentText(stats.holdoutRms));
  if (!fit.materials.empty() && fit.materials.front().expected.unseen > 0)
    text += QStringLiteral("  \u00b7  ") +
            TwoShotReport::tr("expected error %1").arg(logErrorText(fit.materials.front().expected.unseen));
  return text;
}

}  // namespace patina
