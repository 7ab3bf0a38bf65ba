#include <kfstab/experiments/progress.hpp>

#include <unistd.h>

#include <cstdio>

#include <fmt/core.h>

namespace kfstab::experiments {

using namespace std::chrono;

Progress::Progress(std::string what, std::int64_t total)
    : what_(std::move(what)), total_(total), terminal_(isatty(STDERR_FILENO) != 0), start_(steady_clock::now()),
      last_(start_ + milliseconds(250)) {}

Progress::~Progress() {
  if (shown_) fmt::print(stderr, "\r\x1b[K");
}

void Progress::advance(std::int64_t units) {
  const std::lock_guard lock(mutex_);
  done_ += units;
  if (!terminal_) return;
  const auto now = steady_clock::now();
  if (now - last_ < milliseconds(250)) return;
  last_ = now;
  show(now);
}

void Progress::show(steady_clock::time_point now) {
  shown_ = true;
  const double elapsed = duration<double>(now - start_).count();
  if (total_ > 0 && done_ > 0) {
    const double left = elapsed / static_cast<double>(done_) * static_cast<double>(total_ - done_);
    fmt::print(stderr, "\r\x1b[K{}: {} of {} ({:.1f} %), about {:.0f} s left", what_, done_, total_,
               100.0 * static_cast<double>(done_) / static_cast<double>(total_), left);
  } else {
    fmt::print(stderr, "\r\x1b[K{}: {}, {:.0f} s", what_, done_, elapsed);
  }
  std::fflush(stderr);
}

}  // namespace kfstab::experiments
