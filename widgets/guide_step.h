#pragma once

#include <QObject>
#include <QString>

class QWidget;

namespace patina {

/// One step of a guided task: what the person does now, the widgets for it, and whether it is done. Lives in
/// the window's thread.
class GuideStep : public QObject {
  Q_OBJECT

 public:
  enum class State {
    ToDo,
    Done,    ///< done now; `note` says how well
    Reused,  ///< from an earlier session, and it passed its recheck
    Failed,  ///< tried, and what is wrong is on the page
  };
  using QObject::QObject;

  /// Short, for the list: "Checkerboard".
  virtual QString title() const = 0;
  /// What to do now, in a sentence or two; may change as the step goes on.
  virtual QString sentence() const = 0;
  /// The step's widgets, made at the first call as children of `parent`; the same ones afterwards.
  virtual QWidget* body(QWidget* parent) = 0;
  /// The step comes on show, or goes: live pictures and displays are started and stopped here.
  virtual void enter() {}
  virtual void leave() {}
  virtual State state() const = 0;
  /// Residual and date, for the list: "0.18 px, today". Empty: nothing to say.
  virtual QString note() const { return {}; }
  /// Whether what comes after may begin. A step that is of use but not needed says true always.
  virtual bool canGoOn() const { return state() == State::Done || state() == State::Reused; }
  /// Why not, in a sentence; empty where `canGoOn`.
  virtual QString whyNot() const = 0;
  /// What the button that goes on is called; empty: "Next".
  virtual QString goOnText() const { return {}; }

 Q_SIGNALS:
  /// Anything of the above is different now.
  void changed();
};

}  // namespace patina
