#include "widgets/brdf_sphere_viewport.h"

#include <QResizeEvent>

namespace patina {

// The picture comes with the next commit; until then the widget only holds its place.
BrdfSphereViewport::BrdfSphereViewport(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("brdfSphere"));
}
BrdfSphereViewport::~BrdfSphereViewport() = default;
void BrdfSphereViewport::setMaterial(std::shared_ptr<const TabulatedBrdf> brdf,
                                     std::shared_ptr<const std::vector<float>> posteriorSd, double) {
  hasMaterial_ = brdf != nullptr;
  hasCertainty_ = posteriorSd != nullptr;
}
void BrdfSphereViewport::resizeEvent(QResizeEvent* event) {
  QWidget::resizeEvent(event);
}

}  // namespace patina
