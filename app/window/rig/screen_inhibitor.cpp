#include "app/window/rig/screen_inhibitor.h"

#include <QDBusConnection>
#include <QDBusConnectionInterface>
#include <QDBusMessage>
#include <QDBusPendingCallWatcher>
#include <QDBusPendingReply>
#include <QDBusVariant>
#include <QObject>
#include <optional>

namespace patina {

namespace {

const QString kSaver = QStringLiteral("org.freedesktop.ScreenSaver");
const QString kSaverPath = QStringLiteral("/org/freedesktop/ScreenSaver");
constexpr int kPatienceMs = 300;  ///< for a desktop's answer that a page waits for

QDBusMessage saverCall(const QString& method) {
  return QDBusMessage::createMethodCall(kSaver, kSaverPath, kSaver, method);
}

/// A property of a service that runs; invalid where there is none. Starts nothing.
QVariant propertyOf(const QString& service, const QString& path, const QString& interface,
                    const QString& name) {
  const QDBusConnection bus = QDBusConnection::sessionBus();
  if (!bus.isConnected() || !bus.interface()->isServiceRegistered(service)) return {};
  QDBusMessage get = QDBusMessage::createMethodCall(
      service, path, QStringLiteral("org.freedesktop.DBus.Properties"), QStringLiteral("Get"));
  get << interface << name;
  const QDBusMessage answer = bus.call(get, QDBus::Block, kPatienceMs);
  if (answer.type() != QDBusMessage::ReplyMessage || answer.arguments().isEmpty()) return {};
  return answer.arguments().front().value<QDBusVariant>().variant();
}

}  // namespace

struct ScreenInhibitor::Asked {
  bool over = false;  ///< given up before the answer came
  std::optional<uint> cookie;
};

ScreenInhibitor::ScreenInhibitor() : asked_(std::make_shared<Asked>()) {
  const QDBusConnection bus = QDBusConnection::sessionBus();
  if (!bus.isConnected()) return;
  QDBusMessage inhibit = saverCall(QStringLiteral("Inhibit"));
  inhibit << QStringLiteral("Patina") << QObject::tr("A screen shows patterns that are photographed");
  auto* watcher = new QDBusPendingCallWatcher(bus.asyncCall(inhibit));
  QObject::connect(watcher, &QDBusPendingCallWatcher::finished, watcher, [asked = asked_, watcher] {
    const QDBusPendingReply<uint> reply = *watcher;
    watcher->deleteLater();
    if (reply.isError()) return;
    if (!asked->over) {
      asked->cookie = reply.value();
      return;
    }
    QDBusMessage release = saverCall(QStringLiteral("UnInhibit"));
    release << reply.value();
    QDBusConnection::sessionBus().asyncCall(release);
  });
}

ScreenInhibitor::~ScreenInhibitor() {
  asked_->over = true;
  if (!asked_->cookie) return;
  QDBusMessage release = saverCall(QStringLiteral("UnInhibit"));
  release << *asked_->cookie;
  QDBusConnection::sessionBus().asyncCall(release);
}

QStringList desktopColourWarnings() {
  QStringList sentences;
  const QVariant gnome = propertyOf(
      QStringLiteral("org.gnome.SettingsDaemon.Color"), QStringLiteral("/org/gnome/SettingsDaemon/Color"),
      QStringLiteral("org.gnome.SettingsDaemon.Color"), QStringLiteral("NightLightActive"));
  const QVariant kde = propertyOf(QStringLiteral("org.kde.KWin"), QStringLiteral("/org/kde/KWin/NightLight"),
                                  QStringLiteral("org.kde.KWin.NightLight"), QStringLiteral("running"));
  const QVariant olderKde =
      propertyOf(QStringLiteral("org.kde.KWin"), QStringLiteral("/ColorCorrect"),
                 QStringLiteral("org.kde.kwin.ColorCorrect"), QStringLiteral("running"));
  if (gnome.toBool() || kde.toBool() || olderKde.toBool())
    sentences << QObject::tr(
        "The night light is on: switch it off, it changes the screen's colours by the hour.");
  else if (!gnome.isValid() && !kde.isValid() && !olderKde.isValid())
    sentences << QObject::tr("Whether a night light is on is not known here: see that it is off.");
  sentences << QObject::tr(
      "Whether HDR or a colour profile changes what is shown is not known here: switch both off while you "
      "measure.");
  return sentences;
}

}  // namespace patina
