#include "widgets/document.h"

#include <QUndoCommand>

namespace patina {

namespace {
enum CommandId { kToneId = 100, kPickId = 200, kLampId = 201 };
}

class ToneCommand : public QUndoCommand {
 public:
  ToneCommand(Document* document, ViewKind kind, const ToneSettings& after)
      : document_(document),
        kind_(kind),
        before_(document->tone(kind)),
        after_(after),
        gesture_(document->gesture()) {
    setText(QObject::tr("range of %1").arg(QString::fromUtf8(info(kind).title).toLower()));
  }
  void undo() override { document_->restoreTone(kind_, before_); }
  void redo() override { document_->restoreTone(kind_, after_); }
  int id() const override { return kToneId + static_cast<int>(kind_); }
  bool mergeWith(const QUndoCommand* other) override {
    const auto* next = static_cast<const ToneCommand*>(other);
    if (next->gesture_ != gesture_) return false;
    after_ = next->after_;
    setObsolete(after_ == before_);
    return true;
  }

 private:
  Document* document_;
  ViewKind kind_;
  ToneSettings before_, after_;
  int gesture_;
};

class OptionsCommand : public QUndoCommand {
 public:
  OptionsCommand(Document* document, const FourierFitOptions& after)
      : document_(document), before_(document->fitOptions()), after_(after) {
    setText(QObject::tr("fit options"));
  }
  void undo() override { document_->applyOptions(before_); }
  void redo() override { document_->applyOptions(after_); }

 private:
  Document* document_;
  FourierFitOptions before_, after_;
};

class PickCommand : public QUndoCommand {
 public:
  PickCommand(Document* document, std::optional<QPoint> after)
      : document_(document), before_(document->pickedTexel()), after_(after), gesture_(document->gesture()) {
    setText(QObject::tr("texel pick"));
  }
  void undo() override { document_->applyPick(before_); }
  void redo() override { document_->applyPick(after_); }
  int id() const override { return kPickId; }
  bool mergeWith(const QUndoCommand* other) override {
    const auto* next = static_cast<const PickCommand*>(other);
    if (next->gesture_ != gesture_) return false;
    after_ = next->after_;
    return true;
  }

 private:
  Document* document_;
  std::optional<QPoint> before_, after_;
  int gesture_;
};

class LampCommand : public QUndoCommand {
 public:
  LampCommand(Document* document, const LampState& after)
      : document_(document), before_(document->lamp()), after_(after), gesture_(document->gesture()) {
    setText(QObject::tr("light"));
  }
  void undo() override { document_->restoreLamp(before_); }
  void redo() override { document_->restoreLamp(after_); }
  int id() const override { return kLampId; }
  bool mergeWith(const QUndoCommand* other) override {
    const auto* next = static_cast<const LampCommand*>(other);
    if (next->gesture_ != gesture_) return false;
    after_ = next->after_;
    return true;
  }

 private:
  Document* document_;
  LampState before_, after_;
  int gesture_;
};

class FitCommand : public QUndoCommand {
 public:
  FitCommand(Document* document, std::shared_ptr<const FourierFit> after, const QString& text)
      : document_(document),
        before_(document->fit_),
        after_(std::move(after)),
        tonesBefore_(document->tones_),
        tonesAfter_(document->tones_),
        pickedBefore_(document->picked_),
        pickedAfter_(document->picked_) {
    setText(text);
    const SvbrdfMaps& maps = after_->maps();
    for (const auto& kind : viewKinds()) {
      const Image* map = mapOf(maps, kind.kind);
      if (map)
        tonesAfter_[static_cast<std::size_t>(kind.kind)] =
            automaticTone(kind.style, *map, &maps.status, unmeasuredStates(kind.kind));
    }
    // A pick made on maps of another size would be somewhere else.
    if (pickedAfter_ && before_ &&
        (before_->maps().width != maps.width || before_->maps().height != maps.height))
      pickedAfter_.reset();
    if (!pickedAfter_) pickedAfter_ = QPoint(maps.width / 2, maps.height / 2);
  }
  void undo() override {
    if (!released_) document_->applyFit(before_, tonesBefore_, pickedBefore_);
  }
  void redo() override {
    if (!released_) document_->applyFit(after_, tonesAfter_, pickedAfter_);
  }
  /// Lets go of the fits: they are large.
  void release() {
    before_.reset();
    after_.reset();
    released_ = true;
    setObsolete(true);
  }

 private:
  Document* document_;
  std::shared_ptr<const FourierFit> before_, after_;
  std::array<ToneSettings, kViewKindCount> tonesBefore_, tonesAfter_;
  std::optional<QPoint> pickedBefore_, pickedAfter_;
  bool released_ = false;
};

Document::Document(QObject* parent) : QObject(parent) {
  undo_.setUndoLimit(200);
}

void Document::openCapture(std::shared_ptr<const FourierCapture> capture) {
  undo_.clear();
  capture_ = std::move(capture);
  fit_.reset();
  picked_.reset();
  Q_EMIT captureChanged();
  Q_EMIT fitChanged();
  Q_EMIT pickChanged();
}

void Document::close() {
  openCapture(nullptr);
}

void Document::setTone(ViewKind kind, const ToneSettings& tone) {
  if (tone == this->tone(kind)) return;
  undo_.push(new ToneCommand(this, kind, tone));
}

void Document::setFitOptions(const FourierFitOptions& options) {
  if (options == fitOptions_) return;
  undo_.push(new OptionsCommand(this, options));
}

void Document::pickTexel(std::optional<QPoint> texel) {
  if (texel == picked_) return;
  undo_.push(new PickCommand(this, texel));
}

void Document::setLamp(const LampState& lamp) {
  if (lamp == lamp_) return;
  undo_.push(new LampCommand(this, lamp));
}

void Document::adoptFit(std::shared_ptr<const FourierFit> fit, const QString& how) {
  for (int i = 0; i < undo_.count(); ++i) {
    auto* older = const_cast<QUndoCommand*>(undo_.command(i));
    if (auto* command = dynamic_cast<FitCommand*>(older)) command->release();
  }
  undo_.push(new FitCommand(this, std::move(fit), how));
}

void Document::restoreTone(ViewKind kind, const ToneSettings& tone) {
  tones_[static_cast<std::size_t>(kind)] = tone;
  Q_EMIT toneChanged(kind);
}

void Document::restoreFitOptions(const FourierFitOptions& options) {
  applyOptions(options);
}

void Document::restoreLamp(const LampState& lamp) {
  lamp_ = lamp;
  Q_EMIT lampChanged();
}

void Document::applyOptions(const FourierFitOptions& options) {
  fitOptions_ = options;
  Q_EMIT fitOptionsChanged();
}

void Document::applyPick(std::optional<QPoint> texel) {
  picked_ = texel;
  Q_EMIT pickChanged();
}

void Document::applyFit(std::shared_ptr<const FourierFit> fit,
                        const std::array<ToneSettings, kViewKindCount>& tones, std::optional<QPoint> picked) {
  fit_ = std::move(fit);
  tones_ = tones;
  picked_ = picked;
  for (const auto& kind : viewKinds()) Q_EMIT toneChanged(kind.kind);
  Q_EMIT fitChanged();
  Q_EMIT pickChanged();
}

}  // namespace patina
