#include "app/cli/interrupt.h"

#include <signal.h>
#include <unistd.h>

#include <atomic>
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

}  // namespace

void sayNothingOnInterrupt(bool nothing) {
  silent = nothing;
}

std::stop_token stopOnInterrupt() {
  // A full disk or quota and a closed pipe become error codes, which have sentences, instead of sudden
  // deaths.
  ::signal(SIGXFSZ, SIG_IGN);
  ::signal(SIGPIPE, SIG_IGN);

  // Signals are taken by a thread of their own, where everything is allowed. All later threads inherit the
  // mask.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  struct sigaction hangup {};
  ::sigaction(SIGHUP, nullptr, &hangup);
  if (hangup.sa_handler != SIG_IGN) sigaddset(&signals, SIGHUP);  // nohup wants it ignored
  ::pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  // Never destroyed: the thread may still use it while the process ends.
  static std::stop_source& source = *new std::stop_source;
  std::thread([signals] {
    constexpr char first[] = "\nCancelling; what is finished is kept. Once more ends at once.\n";
    constexpr char second[] = "\nEnded at once. A hidden folder named *.partial-* may be left over.\n";
    int signal = 0;
    while (::sigwait(&signals, &signal) == 0) {
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
