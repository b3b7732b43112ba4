#include "widgets/brdf_slices_panel.h"

#include <QResizeEvent>

namespace patina {

// The curves come with the next commit; until then the widget only holds its place.
BrdfSlicesPanel::BrdfSlicesPanel(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("brdfSlices"));
}
BrdfSlicesPanel::~BrdfSlicesPanel() = default;
void BrdfSlicesPanel::setMaterial(std::shared_ptr<const TabulatedBrdf> brdf,
                                  std::shared_ptr<const std::vector<float>> posteriorSd, double priorSd) {
  brdf_ = std::move(brdf);
  posteriorSd_ = std::move(posteriorSd);
  priorSd_ = priorSd;
}
void BrdfSlicesPanel::setReference(std::shared_ptr<const TabulatedBrdf> brdf, const QString& name) {
  reference_ = std::move(brdf);
  referenceName_ = name;
}
void BrdfSlicesPanel::setMeasured(const std::vector<HalfDiffAngles>& angles) {
  measured_ = angles;
}
void BrdfSlicesPanel::resizeEvent(QResizeEvent* event) {
  QWidget::resizeEvent(event);
}

}  // namespace patina
