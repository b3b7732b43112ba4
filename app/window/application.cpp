#include "app/window/application.h"

#include <QSurfaceFormat>
#include <cstdlib>

namespace patina {

void prepareApplication() {
  // Debian's VTK speaks GLX: under Wayland it needs Xwayland, which is there wherever DISPLAY is.
  if (!std::getenv("QT_QPA_PLATFORM") && std::getenv("DISPLAY")) qputenv("QT_QPA_PLATFORM", "xcb");
  QSurfaceFormat format;
  format.setRenderableType(QSurfaceFormat::OpenGL);
  format.setVersion(3, 2);
  format.setProfile(QSurfaceFormat::CoreProfile);
  format.setSwapBehavior(QSurfaceFormat::DoubleBuffer);
  format.setDepthBufferSize(24);
  format.setStencilBufferSize(8);
  format.setAlphaBufferSize(8);
  format.setSamples(0);
  QSurfaceFormat::setDefaultFormat(format);
}

}  // namespace patina
