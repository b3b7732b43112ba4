#pragma once

#include <QByteArray>
#include <QSettings>
#include <QStringList>
#include <map>
#include <string>

#include "engine/fourier/options.h"

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
  /// Seconds by stage of the last finished fit: what the time left is judged by.
  std::map<std::string, double> stageSeconds() const;
  void setStageSeconds(const std::map<std::string, double>& seconds);

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
