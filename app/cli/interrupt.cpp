#include "app/cli/interrupt.h"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <thread>

#include "app/cli/verbs.h"

namespace patina::cli {
namespace {

std::atomic<bool> silent{false};

void tell(const char* text, std::size_t length) {
  if (silent) return;
  if (::write(STDERR_FILENO, text, length) < 0) return;  // nobody is listening any more
}

volatile int wakeUp = -1;

void onSignal(int) {
  const int before = errno;
  const char byte = 1;
  if (::write(wakeUp, &byte, 1) < 0) {
    // Full: there is a byte for the reader already.
  }
  errno = before;
}

}  // namespace

void sayNothingOnInterrupt(bool nothing) {
  silent = nothing;
}

std::stop_token stopOnInterrupt() {
  // A full disk or quota and a closed pipe become error codes, which have sentences, instead of sudden
  // deaths.
  ::signal(SIGXFSZ, SIG_IGN);
  ::signal(SIGPIPE, SIG_IGN);

  // A handler may do next to nothing, so it writes a byte to a pipe, and a thread of our own reads it, where
  // everything is allowed. (Blocking the signals and waiting for them is not enough: libraries start threads
  // before main, without the mask.)
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return {};
  wakeUp = ends[1];
  const auto handle = [](int number) {
    struct sigaction before {};
    ::sigaction(number, nullptr, &before);
    if (before.sa_handler == SIG_IGN) return;  // nohup wants SIGHUP ignored
    struct sigaction action {};
    action.sa_handler = onSignal;
    action.sa_flags = SA_RESTART;
    ::sigaction(number, &action, nullptr);
  };
  handle(SIGINT);
  handle(SIGTERM);
  handle(SIGHUP);

  // Never destroyed: the thread may still use it while the process ends.
  static std::stop_source& source = *new std::stop_source;
  std::thread([from = ends[0]] {
    constexpr char first[] = "\nCancelling; what is finished is kept. Once more ends at once.\n";
    constexpr char second[] = "\nEnded at once. A hidden folder named *.partial-* may be left over.\n";
    char byte = 0;
    for (;;) {
      const ssize_t got = ::read(from, &byte, 1);
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) return;
      if (source.stop_requested()) {
        tell(second, sizeof second - 1);
        ::_exit(kCancelled);
      }
      tell(first, sizeof first - 1);
      source.request_stop();
    }
  }).detach();
  return source.get_token();
}

}  // namespace patina::cli
