#include "app/window/explain_controller.h"

#include <QDir>
#include <QFileDialog>
#include <QFileInfo>

#include "widgets/explain_page.h"

namespace patina {

namespace {

std::filesystem::path pathOf(const QString& text) {
  return std::filesystem::path(text.toStdString());
}

/// Pictures are made where the work is done: the window's thread has no time for them.
Result<Explained> withViews(Result<ExplanationPtr> explained) {
  if (!explained) return explained.error();
  return Explained{*explained, residualViews(**explained)};
}

}  // namespace

ExplainController::ExplainController(const Services& services, Settings& settings, QWidget* window)
    : services_(services), settings_(settings), window_(window) {
  page_ = new ExplainPage(window);
  connect(page_, &ExplainPage::furtherRequested, this, &ExplainController::chooseFurther);
  connect(page_, &ExplainPage::furtherCleared, this, &ExplainController::clearFurther);
}

void ExplainController::setBundle(const QString& folder, const QString& summary) {
  page_->setSubject(folder.isEmpty() ? QString() : QFileInfo(folder).fileName(), summary);
  if (folder == bundle_) return;
  bundle_ = folder;
  saved_ = true;
  clearFurther();
  page_->setExplanation(nullptr, nullptr, false);
}

void ExplainController::addFurther(const QString& folder) {
  const QFileInfo file(folder);
  const QString clean = QDir::cleanPath(file.isFile() ? file.absolutePath() : file.absoluteFilePath());
  if (clean.isEmpty() || clean == QDir::cleanPath(bundle_) || further_.contains(clean)) return;
  further_ << clean;
  page_->setFurther(further_);
}

void ExplainController::clearFurther() {
  further_.clear();
  page_->setFurther(further_);
}

void ExplainController::chooseFurther() {
  const QString folder = QFileDialog::getExistingDirectory(
      window_, tr("Another Bundle of the Same Rig or Sample: the Folder with its capture.json"),
      settings_.text(QStringLiteral("last_folder")));
  if (!folder.isEmpty()) addFurther(folder);
}

std::vector<std::filesystem::path> ExplainController::bundles() const {
  std::vector<std::filesystem::path> all{pathOf(bundle_)};
  for (const QString& folder : further_) all.push_back(pathOf(folder));
  return all;
}

ExplainController::Work ExplainController::work() const {
  return [explain = services_.explain, bundles = bundles()](const JobContext& job) {
    return withViews(explain(bundles, {}, job));
  };
}

ExplainController::Work ExplainController::refitWork(const QString& id) const {
  std::vector<std::string> ids;
  if (const ExplanationPtr now = explanation())
    for (const EffectFinding& effect : now->effects) ids.push_back(effect.id);
  ids.push_back(id.toStdString());
  return [explain = services_.explainWith, bundles = bundles(), ids](const JobContext& job) {
    return withViews(explain(bundles, ids, {}, job));
  };
}

std::function<Status(const JobContext&)> ExplainController::saveWork(const QString& folder) const {
  return [write = services_.writeExplanation, explanation = explanation(), folder](const JobContext&) {
    return write(pathOf(folder), *explanation);
  };
}

void ExplainController::adopt(Explained found) {
  saved_ = false;
  // The engine fits with effects of the person's choice where screen patterns lit the sample.
  const bool mayRefit = services_.explainWith && found.explanation->kind == "fourier";
  page_->setExplanation(std::move(found.explanation), std::move(found.views), mayRefit);
}

ExplanationPtr ExplainController::explanation() const {
  return page_->explanation();
}

void ExplainController::noteSaved(const ExplanationPtr& explanation) {
  if (explanation == this->explanation()) saved_ = true;
}

void ExplainController::restoreState() {
  const QByteArray layout = settings_.bytes(QStringLiteral("explain_page/layout"));
  if (!layout.isEmpty()) page_->restoreLayout(layout);
}

void ExplainController::keepState() {
  settings_.set(QStringLiteral("explain_page/layout"), page_->saveLayout());
}

}  // namespace patina
