#pragma once

#include <vtkCallbackCommand.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkSmartPointer.h>

#include <QOpenGLWidget>

class vtkObject;

namespace patina {

/// Whether this display can draw with OpenGL at all. Where it can't, a window that holds a VtkWidget could
/// not even draw its other parts: leave it without a parent, and put `noOpenGlLabel` in its place.
bool openGlThere();
QWidget* noOpenGlLabel(QWidget* parent);

/// VTK in a Qt 6 widget. Owns a render window that draws into a framebuffer of its own; paintGL copies the
/// picture onto the widget's. Events are the subclass's: there is no VTK interactor.
class VtkWidget : public QOpenGLWidget {
  Q_OBJECT

 public:
  explicit VtkWidget(QWidget* parent = nullptr);
  ~VtkWidget() override;

  vtkRenderer* renderer() const { return renderer_; }
  /// False where the display has no usable OpenGL; `failure` says what is missing.
  bool usable() const { return failure_.isEmpty(); }
  QString failure() const { return failure_; }

 Q_SIGNALS:
  void becameUnusable();

 protected:
  void initializeGL() override;
  void resizeGL(int width, int height) override;
  void paintGL() override;

 private:
  void release();
  static void onWindowEvent(vtkObject* caller, unsigned long event, void* self, void* data);

  vtkSmartPointer<vtkGenericOpenGLRenderWindow> window_;
  vtkSmartPointer<vtkRenderer> renderer_;
  vtkSmartPointer<vtkCallbackCommand> observer_;
  QString failure_;
};

}  // namespace patina
