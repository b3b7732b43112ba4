#pragma once

#include <QByteArray>
#include <QSettings>
#include <QStringList>
#include <map>
#include <string>

#include "engine/fourier/options.h"
#include "engine/twoshot/plan.h"
#include "widgets/two_shot_document.h"

namespace patina {

/// What is kept between starts. In the user's configuration folder, or in the named file (tests).
class Settings {
 public:
  explicit Settings(const QString& file = {});

  QStringList recent() const;
  /// Puts a folder first; at most ten are kept.
  void addRecent(const QString& folder);
  void removeRecent(const QString& folder);
  void clearRecent();

  FourierFitOptions fitOptions() const;
  void setFitOptions(const FourierFitOptions& options);
  TwoShotChoices twoShotChoices() const;
  void setTwoShotChoices(const TwoShotChoices& choices);
  /// What directions were planned with; the pictures given are not kept.
  PlanOptions planOptions() const;
  void setPlanOptions(const PlanOptions& options);
  /// Seconds by stage of the last finished fit: what the time left is judged by. `group` tells kinds of fits
  /// apart.
  std::map<std::string, double> stageSeconds(const QString& group = QStringLiteral("stages")) const;
  void setStageSeconds(const std::map<std::string, double>& seconds,
                       const QString& group = QStringLiteral("stages"));

  QByteArray bytes(const QString& key) const { return store_.value(key).toByteArray(); }
  QString text(const QString& key) const { return store_.value(key).toString(); }
  int number(const QString& key, int otherwise) const { return store_.value(key, otherwise).toInt(); }
  bool flag(const QString& key, bool otherwise) const { return store_.value(key, otherwise).toBool(); }
  void set(const QString& key, const QVariant& value) { store_.setValue(key, value); }
  void sync() { store_.sync(); }

 private:
  mutable QSettings store_;
};

}  // namespace patina
