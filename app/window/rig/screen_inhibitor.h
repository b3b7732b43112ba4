#pragma once

#include <QStringList>
#include <memory>

namespace patina {

/// Keeps screensaver and blanking away for as long as it lives, where the desktop listens: by D-Bus,
/// org.freedesktop.ScreenSaver (GNOME, KDE, Xfce and others). A bare X server and its own blanking (xset s,
/// DPMS) are not reached. Never waits for the desktop's answer.
class ScreenInhibitor {
 public:
  ScreenInhibitor();
  ~ScreenInhibitor();
  ScreenInhibitor(const ScreenInhibitor&) = delete;
  ScreenInhibitor& operator=(const ScreenInhibitor&) = delete;

 private:
  struct Asked;
  std::shared_ptr<Asked> asked_;
};

/// What the desktop says of its screens' colours that would spoil a measurement, as sentences: night light
/// that is on (GNOME, KDE); and what can't be found out from here.
QStringList desktopColourWarnings();

}  // namespace patina
