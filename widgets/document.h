#pragma once

#include <Eigen/Core>
#include <QObject>
#include <QPoint>
#include <QUndoStack>
#include <array>
#include <memory>
#include <optional>

#include "engine/capture/capture.h"
#include "engine/fourier/fit.h"
#include "widgets/view_kind.h"

namespace patina {

/// The lamp over the sheet, world frame.
struct LampState {
  Eigen::Vector3d positionMm{40, 60, 160};
  double exposureEv = 0;  ///< of the viewport, stops
  bool operator==(const LampState&) const = default;
};

/// One open bundle, its fit and how it is looked at. Everything that a person changes goes through the undo
/// stack; changes of the same thing within a gesture are merged. Lives in the window's thread.
class Document : public QObject {
  Q_OBJECT

 public:
  explicit Document(QObject* parent = nullptr);

  /// Null until a bundle is open.
  std::shared_ptr<const FourierCapture> capture() const { return capture_; }
  /// Null until something was fitted. May be cancelled: see its stats.
  std::shared_ptr<const FourierFit> fit() const { return fit_; }
  const FourierFitOptions& fitOptions() const { return fitOptions_; }
  std::optional<QPoint> pickedTexel() const { return picked_; }
  const ToneSettings& tone(ViewKind kind) const { return tones_[static_cast<std::size_t>(kind)]; }
  const LampState& lamp() const { return lamp_; }
  QUndoStack* undoStack() { return &undo_; }

  /// Takes a new bundle: forgets fit, pick and history. Options and lamp stay.
  void openCapture(std::shared_ptr<const FourierCapture> capture);
  void close();

  // What follows can be undone.
  void setTone(ViewKind kind, const ToneSettings& tone);
  void setFitOptions(const FourierFitOptions& options);
  void pickTexel(std::optional<QPoint> texel);
  void setLamp(const LampState& lamp);
  /// Shows a new fit. Automatic ranges are set for its maps. Only the latest two fits are kept by the
  /// history, so that memory is bounded; undoing beyond them leaves the fit as it is.
  void adoptFit(std::shared_ptr<const FourierFit> fit, const QString& how);

  /// Ends a gesture: the next change of the same thing is a step of its own.
  void endGesture() { ++gesture_; }
  int gesture() const { return gesture_; }

  /// Outside the history: ranges and options brought back from the settings or set automatically.
  void restoreTone(ViewKind kind, const ToneSettings& tone);
  void restoreFitOptions(const FourierFitOptions& options);
  void restoreLamp(const LampState& lamp);

 Q_SIGNALS:
  void captureChanged();
  void fitChanged();
  void toneChanged(patina::ViewKind kind);
  void fitOptionsChanged();
  void pickChanged();
  void lampChanged();

 private:
  void applyFit(std::shared_ptr<const FourierFit> fit, const std::array<ToneSettings, kViewKindCount>& tones,
                std::optional<QPoint> picked);
  void applyPick(std::optional<QPoint> texel);
  void applyOptions(const FourierFitOptions& options);
  friend class ToneCommand;
  friend class OptionsCommand;
  friend class PickCommand;
  friend class LampCommand;
  friend class FitCommand;

  std::shared_ptr<const FourierCapture> capture_;
  std::shared_ptr<const FourierFit> fit_;
  FourierFitOptions fitOptions_;
  std::optional<QPoint> picked_;
  std::array<ToneSettings, kViewKindCount> tones_;
  LampState lamp_;
  QUndoStack undo_;
  int gesture_ = 0;
};

}  // namespace patina
