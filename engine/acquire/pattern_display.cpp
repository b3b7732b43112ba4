#include "engine/acquire/pattern_display.h"

#include <condition_variable>
#include <mutex>

namespace patina {

bool GlassObserver::waitUntil(RigTime when, const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any never;
  std::unique_lock lock(mutex);
  never.wait_until(lock, stop, when, [] { return false; });
  return !stop.stop_requested();
}

}  // namespace patina
