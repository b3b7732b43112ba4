#include "tests/ui/ui_fixture.h"

#include <QElapsedTimer>
#include <thread>

#include "devices/simulated/simulated_rig.h"
#include "tests/test_data.h"
#include "tests/ui/fake_fit.h"

namespace patina::test {

WindowTest::WindowTest() = default;

std::unique_ptr<MainWindow> WindowTest::makeWindow(Services services) {
  auto window = std::make_unique<MainWindow>(std::move(services), settingsFile());
  window->setAsk(
      [](const QString&, const QString&, const QString&, bool) { return MainWindow::Answer::GoOn; });
  window->resize(1280, 860);
  window->show();
  EXPECT_TRUE(QTest::qWaitForWindowExposed(window.get()));
  return window;
}

namespace {

std::filesystem::path simulatedBundle(const char* name, int pixels) {
  static QTemporaryDir folder;
  const std::filesystem::path bundle = std::filesystem::path(folder.path().toStdString()) / name;
  const SimulatedSheet sheet = simulatedScene("laminate");
  const auto outcome =
      simulateCapture(bundle, SimulatedRig::desk(pixels, sheet.widthMm, sheet.heightMm), sheet, {}, {});
  EXPECT_TRUE(outcome.ok()) << (outcome.ok() ? "" : outcome.error().sentence());
  return bundle;
}

}  // namespace

std::filesystem::path WindowTest::smallBundle() {
  static const std::filesystem::path made = simulatedBundle("small sheet", 28);
  return made;
}

std::filesystem::path WindowTest::largerBundle() {
  const auto shared = sharedData() / "fourier" / "clean_laminate";
  if (std::filesystem::exists(shared / "capture.json")) return shared;
  static const std::filesystem::path made = simulatedBundle("larger sheet", 96);
  return made;
}

std::filesystem::path WindowTest::spoilableBundle(const char* name) {
  const auto copy = temporary() / name;
  std::filesystem::copy(smallBundle(), copy, std::filesystem::copy_options::recursive);
  return copy;
}

bool WindowTest::until(const std::function<bool()>& condition, int milliseconds) {
  return QTest::qWaitFor(condition, milliseconds);
}

void WindowTest::open(MainWindow& window, const std::filesystem::path& bundle) {
  window.openPath(QString::fromStdString(bundle.string()));
  ASSERT_TRUE(until([&] { return !window.opening(); }));
  ASSERT_NE(window.document()->capture(), nullptr);
}

Services fakeServices(int delayMs, int width, int height) {
  Services services = Services::engine();
  services.fit = [=](const FourierCapture& capture, const FourierFitOptions&,
                     const JobContext& job) -> Result<std::shared_ptr<const FourierFit>> {
    QElapsedTimer timer;
    timer.start();
    while (timer.elapsed() < delayMs && !job.cancelled()) {
      job.progress("solve", timer.elapsed(), delayMs, "texels");
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return std::shared_ptr<const FourierFit>(
        std::make_shared<FakeFit>(capture, width, height, job.cancelled()));
  };
  return services;
}

}  // namespace patina::test
