#pragma once

#include <QObject>
#include <QStringList>
#include <functional>
#include <memory>

#include "app/window/services.h"
#include "app/window/settings.h"
#include "widgets/explain_pictures.h"

class QWidget;

namespace patina {

class ExplainPage;

/// What an explanation comes back with: itself, and its pictures made on the worker's thread.
struct Explained {
  ExplanationPtr explanation;
  ResidualViews views;
};

/// Closing the loop, for the window: the page, the bundles that are explained together, and what a job is
/// made of. The window runs the job, so that one fit runs at a time.
class ExplainController : public QObject {
  Q_OBJECT

 public:
  using Work = std::function<Result<Explained>(const JobContext&)>;

  /// `window`: parent of page and dialogs. `services` and `settings` must outlive this.
  ExplainController(const Services& services, Settings& settings, QWidget* window);

  ExplainPage* page() { return page_; }
  /// The bundle that is open; empty: none. Forgets what was found and the further bundles when it is another.
  void setBundle(const QString& folder, const QString& summary);
  const QString& bundle() const { return bundle_; }
  /// Explained together with the open one; the open one and those that are there already are left out.
  void addFurther(const QString& folder);
  void clearFurther();
  const QStringList& further() const { return further_; }
  void chooseFurther();

  /// For a worker, with what is chosen now.
  Work work() const;
  /// With one more effect than what was added.
  Work refitWork(const QString& id) const;
  std::function<Status(const JobContext&)> saveWork(const QString& folder) const;
  /// `after`: shown in place of what was there.
  void adopt(Explained found);
  ExplanationPtr explanation() const;
  bool saved() const { return saved_; }
  /// Notes that `explanation` is on disk, if it is still the one on show.
  void noteSaved(const ExplanationPtr& explanation);

  void restoreState();
  void keepState();

 private:
  std::vector<std::filesystem::path> bundles() const;

  const Services& services_;
  Settings& settings_;
  QWidget* window_;
  ExplainPage* page_;
  QString bundle_;
  QStringList further_;
  bool saved_ = true;
};

}  // namespace patina
