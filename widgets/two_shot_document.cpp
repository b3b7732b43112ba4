#include "widgets/two_shot_document.h"

#include <QUndoCommand>

namespace patina {

class TwoShotDocument::ChoicesCommand : public QUndoCommand {
 public:
  ChoicesCommand(TwoShotDocument* document, const TwoShotChoices& after)
      : document_(document), before_(document->choices()), after_(after) {
    setText(TwoShotDocument::tr("options of the reconstruction"));
  }
  void undo() override { document_->restoreChoices(before_); }
  void redo() override { document_->restoreChoices(after_); }

 private:
  TwoShotDocument* document_;
  TwoShotChoices before_, after_;
};

class TwoShotDocument::MaterialCommand : public QUndoCommand {
 public:
  MaterialCommand(TwoShotDocument* document, int after)
      : document_(document), before_(document->material()), after_(after) {
    setText(TwoShotDocument::tr("choice of material"));
  }
  void undo() override { document_->applyMaterial(before_); }
  void redo() override { document_->applyMaterial(after_); }

 private:
  TwoShotDocument* document_;
  int before_, after_;
};

class TwoShotDocument::FitCommand : public QUndoCommand {
 public:
  FitCommand(TwoShotDocument* document, std::shared_ptr<const TwoShotFit> after, const QString& text)
      : document_(document),
        before_(document->fit_),
        after_(std::move(after)),
        materialBefore_(document->material_) {
    setText(text);
  }
  void undo() override {
    if (!released_) document_->applyFit(before_, materialBefore_);
  }
  void redo() override {
    if (!released_) document_->applyFit(after_, 0);
  }
  /// Lets go of the fits: they are large.
  void release() {
    before_.reset();
    after_.reset();
    released_ = true;
    setObsolete(true);
  }

 private:
  TwoShotDocument* document_;
  std::shared_ptr<const TwoShotFit> before_, after_;
  int materialBefore_;
  bool released_ = false;
};

TwoShotDocument::TwoShotDocument(QObject* parent) : QObject(parent) {
  undo_.setUndoLimit(200);
}

const TwoShotMaterial* TwoShotDocument::shownMaterial() const {
  return fit_ && material_ < static_cast<int>(fit_->materials.size()) ? &fit_->materials[material_] : nullptr;
}

void TwoShotDocument::openCapture(std::shared_ptr<const TwoShotCapture> capture) {
  undo_.clear();
  capture_ = std::move(capture);
  fit_.reset();
  material_ = 0;
  Q_EMIT captureChanged();
  Q_EMIT fitChanged();
  Q_EMIT materialChanged();
}

void TwoShotDocument::setChoices(const TwoShotChoices& choices) {
  if (choices == choices_) return;
  undo_.push(new ChoicesCommand(this, choices));
}

void TwoShotDocument::setMaterial(int material) {
  if (!fit_ || material == material_ || material < 0 || material >= static_cast<int>(fit_->materials.size()))
    return;
  undo_.push(new MaterialCommand(this, material));
}

void TwoShotDocument::adoptFit(std::shared_ptr<const TwoShotFit> fit, const QString& how) {
  for (int i = 0; i < undo_.count(); ++i) {
    auto* older = const_cast<QUndoCommand*>(undo_.command(i));
    if (auto* command = dynamic_cast<FitCommand*>(older)) command->release();
  }
  undo_.push(new FitCommand(this, std::move(fit), how));
}

void TwoShotDocument::restoreChoices(const TwoShotChoices& choices) {
  choices_ = choices;
  Q_EMIT choicesChanged();
}

void TwoShotDocument::applyFit(std::shared_ptr<const TwoShotFit> fit, int material) {
  fit_ = std::move(fit);
  const int last = fit_ ? static_cast<int>(fit_->materials.size()) - 1 : 0;
  material_ = std::clamp(material, 0, std::max(0, last));
  Q_EMIT fitChanged();
  Q_EMIT materialChanged();
}

void TwoShotDocument::applyMaterial(int material) {
  const int last = fit_ ? static_cast<int>(fit_->materials.size()) - 1 : 0;
  material_ = std::clamp(material, 0, std::max(0, last));
  Q_EMIT materialChanged();
}

}  // namespace patina
