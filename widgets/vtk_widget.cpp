#include "widgets/vtk_widget.h"

#include <vtkCallbackCommand.h>
#include <vtkCommand.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkOpenGLFramebufferObject.h>
#include <vtkOpenGLState.h>
#include <vtkRenderer.h>

#include <QOpenGLContext>
#include <QOpenGLFunctions>

namespace patina {

bool openGlThere() {
  static const bool there = [] {
    QOpenGLContext context;
    return context.create();
  }();
  return there;
}

QWidget* noOpenGlLabel(QWidget* parent) {
  auto* label = new QLabel(VtkWidget::tr("This display has no OpenGL: 3D views are left out."), parent);
  label->setAlignment(Qt::AlignCenter);
  label->setWordWrap(true);
  label->setProperty("role", "caption");
  return label;
}

VtkWidget::VtkWidget(QWidget* parent) : QOpenGLWidget(parent) {
  renderer_ = vtkSmartPointer<vtkRenderer>::New();
  observer_ = vtkSmartPointer<vtkCallbackCommand>::New();
  observer_->SetCallback(&VtkWidget::onWindowEvent);
  observer_->SetClientData(this);
}

VtkWidget::~VtkWidget() {
  makeCurrent();
  release();
  doneCurrent();
}

void VtkWidget::release() {
  if (!window_) return;
  window_->Finalize();
  window_->RemoveObserver(observer_);
  window_->RemoveRenderer(renderer_);
  window_ = nullptr;
}

void VtkWidget::initializeGL() {
  // A widget that moves to another top-level window gets a new context: what VTK made in the old one is gone
  // with it.
  release();
  connect(context(), &QOpenGLContext::aboutToBeDestroyed, this, [this] {
    makeCurrent();
    release();
    doneCurrent();
  });
  const QSurfaceFormat format = context()->format();
  if (context()->isOpenGLES() || format.version() < std::pair(3, 2)) {
    failure_ = tr("The 3D view needs OpenGL 3.2; this display offers %1.%2.")
                   .arg(format.majorVersion())
                   .arg(format.minorVersion());
    Q_EMIT becameUnusable();
    return;
  }
  window_ = vtkSmartPointer<vtkGenericOpenGLRenderWindow>::New();
  window_->AddObserver(vtkCommand::WindowMakeCurrentEvent, observer_);
  window_->AddObserver(vtkCommand::WindowIsCurrentEvent, observer_);
  window_->SetReadyForRendering(true);
  window_->SetOwnContext(0);
  window_->SetMultiSamples(0);
  window_->SetFrameBlitModeToNoBlit();
  window_->AddRenderer(renderer_);
  window_->OpenGLInitContext();
  window_->SetSize(static_cast<int>(width() * devicePixelRatioF()),
                   static_cast<int>(height() * devicePixelRatioF()));
}

void VtkWidget::resizeGL(int width, int height) {
  if (!window_) return;
  window_->SetSize(static_cast<int>(std::lround(width * devicePixelRatioF())),
                   static_cast<int>(std::lround(height * devicePixelRatioF())));
}

void VtkWidget::paintGL() {
  QOpenGLFunctions* gl = context()->functions();
  if (!window_) {
    gl->glClearColor(0.11f, 0.11f, 0.11f, 1);
    gl->glClear(GL_COLOR_BUFFER_BIT);
    return;
  }
  vtkOpenGLState* state = window_->GetState();
  state->Reset();
  state->Push();
  window_->Render();
  gl->glBindFramebuffer(GL_DRAW_FRAMEBUFFER, defaultFramebufferObject());
  window_->BlitDisplayFramebuffer();
  // VTK leaves alpha at 0 where nothing was drawn; the widget would be composed as transparent there.
  gl->glBindFramebuffer(GL_FRAMEBUFFER, defaultFramebufferObject());
  gl->glDisable(GL_SCISSOR_TEST);
  gl->glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_TRUE);
  gl->glClearColor(0, 0, 0, 1);
  gl->glClear(GL_COLOR_BUFFER_BIT);
  gl->glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  state->Pop();
}

void VtkWidget::onWindowEvent(vtkObject*, unsigned long event, void* self, void* data) {
  auto* widget = static_cast<VtkWidget*>(self);
  if (event == vtkCommand::WindowMakeCurrentEvent) {
    // On this very surface: the widget's own makeCurrent() would bind another framebuffer behind VTK's back.
    if (widget->context()) widget->context()->makeCurrent(widget->context()->surface());
  } else if (event == vtkCommand::WindowIsCurrentEvent) {
    auto* answer = static_cast<bool*>(data);
    QOpenGLContext* current = QOpenGLContext::currentContext();
    *answer = current && current == widget->context() && current->surface() == widget->context()->surface();
  }
}

}  // namespace patina
