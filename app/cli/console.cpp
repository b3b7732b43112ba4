#include "app/cli/console.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "app/cli/stage_titles.h"

namespace patina::cli {
namespace {

constexpr auto kRedrawEvery =
    std::chrono::milliseconds(100);                    // quick enough to look alive, slow enough to read
constexpr auto kGuessAfter = std::chrono::seconds(2);  // a time left from less would jump about

std::string duration(double seconds) {
  char text[48];
  const long whole = std::max(1L, std::lround(seconds));
  if (whole < 60) {
    std::snprintf(text, sizeof text, "%ld s", whole);
  } else if (whole < 3600) {
    std::snprintf(text, sizeof text, "%ld min %02ld s", whole / 60, whole % 60);
  } else {
    std::snprintf(text, sizeof text, "%ld h %02ld min", whole / 3600, whole / 60 % 60);
  }
  return text;
}

std::size_t terminalWidth() {
  winsize size{};
  if (::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0) return size.ws_col;
  return 80;
}

}  // namespace

Console::Console() {
  const char* kind = std::getenv("TERM");
  terminal_ = ::isatty(STDERR_FILENO) == 1 && kind && std::string_view(kind) != "dumb";
}

void Console::useJson(bool json) {
  json_ = json;
}

void Console::progress(std::string_view stage, std::int64_t done, std::int64_t total, std::string_view unit) {
  const std::lock_guard lock(mutex_);
  const Clock::time_point now = Clock::now();
  const bool newStage = stage != stage_;
  if (newStage) {
    if (terminal_ && !json_) clearLine();
    stage_ = stage;
    stageStart_ = now;
    last_ = -1;
  }
  // Threads report in any order; what was done stays done, and no more than all.
  if (total > 0) done = std::min(done, total);
  if (done <= last_) return;
  last_ = done;
  const bool finished = total > 0 && done >= total;
  if (!newStage && !finished && now - lastShown_ < kRedrawEvery) return;
  lastShown_ = now;

  if (json_) {
    const nlohmann::ordered_json line = {
        {"stage", std::string(stage)}, {"done", done}, {"total", total}, {"unit", std::string(unit)}};
    std::fprintf(stderr, "%s\n", line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
  } else if (terminal_) {
    drawLine(done, total, unit, now);
  } else if (newStage) {
    const std::string of = total > 0 ? " (" + std::to_string(total) + " " + std::string(unit) + ")" : "";
    std::fprintf(stderr, "%s%s\n", stageTitle(stage).c_str(), of.c_str());
  }
}

void Console::drawLine(std::int64_t done, std::int64_t total, std::string_view unit, Clock::time_point now) {
  std::string line = stageTitle(stage_);
  if (total > 0) {
    const double share = std::clamp(static_cast<double>(done) / static_cast<double>(total), 0.0, 1.0);
    line += "  " + std::to_string(static_cast<int>(share * 100)) + " %  " + std::to_string(done) + " of " +
            std::to_string(total) + " " + std::string(unit);
    const double elapsed = std::chrono::duration<double>(now - stageStart_).count();
    if (now - stageStart_ > kGuessAfter && done > 0 && done < total) {
      line += "  about " + duration(elapsed * (1 - share) / share) + " left";
    }
  } else {
    line += "  " + std::to_string(done) + " " + std::string(unit);
  }
  line.resize(std::min(line.size(), terminalWidth() - 1));  // a wrapped line can't be rewritten
  std::fprintf(stderr, "\r\x1b[K%s", line.c_str());
  std::fflush(stderr);
  lineShown_ = true;
}

void Console::clearLine() {
  if (!lineShown_) return;
  std::fputs("\r\x1b[K", stderr);
  std::fflush(stderr);
  lineShown_ = false;
}

void Console::log(Level level, std::string_view sentence) {
  const std::lock_guard lock(mutex_);
  clearLine();
  std::fprintf(json_ ? stdout : stderr, "%s: %.*s\n", level == Level::Warning ? "Warning" : "Note",
               static_cast<int>(sentence.size()), sentence.data());
}

void Console::say(std::string_view line) {
  const std::lock_guard lock(mutex_);
  clearLine();
  std::fprintf(stdout, "%.*s\n", static_cast<int>(line.size()), line.data());
}

void Console::complain(std::string_view line) {
  complain("", Error{ErrorCode::Invalid, std::string(line), "", ""});
}

void Console::complain(std::string_view prefix, const Error& error) {
  const std::lock_guard lock(mutex_);
  clearLine();
  std::fflush(stdout);
  std::string line =
      std::string(prefix) + (error.where.empty() && error.tryThis.empty() ? error.what : error.sentence());
  if (json_) {
    const nlohmann::ordered_json object = {
        {"error", {{"what", error.what}, {"where", error.where}, {"try", error.tryThis}}}};
    line = object.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  }
  std::fprintf(stderr, "%s\n", line.c_str());
}

void Console::finishProgress() {
  const std::lock_guard lock(mutex_);
  clearLine();
}

}  // namespace patina::cli
