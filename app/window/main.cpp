// patina: the window.
#include <QApplication>
#include <QCommandLineParser>

#include "app/window/application.h"
#include "app/window/main_window.h"
#include "widgets/theme.h"

int main(int argc, char** argv) {
  patina::prepareApplication();
  QApplication application(argc, argv);
  QApplication::setApplicationName(QStringLiteral("patina"));
  QApplication::setApplicationDisplayName(QString());
  QApplication::setApplicationVersion(QStringLiteral(PATINA_VERSION));
  QApplication::setDesktopFileName(QStringLiteral("patina"));
  patina::theme::apply(application);

  QCommandLineParser parser;
  parser.setApplicationDescription(
      QApplication::translate("main", "Patina measures how materials reflect light."));
  parser.addHelpOption();
  parser.addVersionOption();
  parser.addPositionalArgument(
      QStringLiteral("bundle"),
      QApplication::translate(
          "main", "Folder of a capture bundle or of a saved fit, or its capture.json or fit.json."),
      QStringLiteral("[BUNDLE]"));
  parser.process(application);
  const QStringList named = parser.positionalArguments();
  if (named.size() > 1) {
    std::fprintf(stderr, "patina: one bundle at a time, but %d were named. Try: patina --help\n",
                 static_cast<int>(named.size()));
    return 2;
  }

  patina::MainWindow window;
  window.show();
  if (!named.isEmpty()) window.openPath(named.front());
  return QApplication::exec();
}
