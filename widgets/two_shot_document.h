#pragma once

#include <QObject>
#include <QString>
#include <QUndoStack>
#include <memory>

#include "engine/capture/two_shot_capture.h"
#include "engine/twoshot/fit.h"

namespace patina {

/// What a person chooses for a reconstruction.
struct TwoShotChoices {
  TwoShotFitOptions fit;
  QString basisFile;  ///< empty: the built-in basis
  bool operator==(const TwoShotChoices&) const = default;
};

/// One open two-shot bundle, its reconstruction and how it is looked at. Options, the material on show and
/// the adopted fit go through the undo stack. Lives in the window's thread.
class TwoShotDocument : public QObject {
  Q_OBJECT

 public:
  explicit TwoShotDocument(QObject* parent = nullptr);

  /// Null until a bundle is open.
  std::shared_ptr<const TwoShotCapture> capture() const { return capture_; }
  /// Null until something was reconstructed.
  std::shared_ptr<const TwoShotFit> fit() const { return fit_; }
  const TwoShotChoices& choices() const { return choices_; }
  /// Index of the material on show; 0 where there is one only.
  int material() const { return material_; }
  /// The material on show; null without a fit.
  const TwoShotMaterial* shownMaterial() const;
  QUndoStack* undoStack() { return &undo_; }

  /// Takes a new bundle: forgets fit, material and history. Options stay.
  void openCapture(std::shared_ptr<const TwoShotCapture> capture);
  void close() { openCapture(nullptr); }

  // What follows can be undone.
  void setChoices(const TwoShotChoices& choices);
  void setMaterial(int material);
  /// Shows a new fit. Only the latest two are kept by the history, so that memory is bounded; undoing beyond
  /// them leaves the fit as it is.
  void adoptFit(std::shared_ptr<const TwoShotFit> fit, const QString& how);

  /// Outside the history: brought back from the settings, or from a fit that was opened.
  void restoreChoices(const TwoShotChoices& choices);

 Q_SIGNALS:
  void captureChanged();
  void fitChanged();
  void choicesChanged();
  void materialChanged();

 private:
  class ChoicesCommand;
  class MaterialCommand;
  class FitCommand;
  void applyFit(std::shared_ptr<const TwoShotFit> fit, int material);
  void applyMaterial(int material);

  std::shared_ptr<const TwoShotCapture> capture_;
  std::shared_ptr<const TwoShotFit> fit_;
  TwoShotChoices choices_;
  int material_ = 0;
  QUndoStack undo_;
};

}  // namespace patina
