#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>

namespace kfstab::experiments {

/// One line on stderr that says how far a long piece of work has come: only on a terminal, only after the first half
/// second, at most four times a second. Safe to call from several threads.
class Progress {
 public:
  /// @param what  "run double-integrator"    @param total  units of work, 0 if not known
  Progress(std::string what, std::int64_t total);
  ~Progress();

  /// So many more units are done.
  void advance(std::int64_t units = 1);

 private:
  void show(std::chrono::steady_clock::time_point now);

  std::string what_;
  std::int64_t total_;
  std::int64_t done_ = 0;
  bool terminal_;
  bool shown_ = false;
  std::chrono::steady_clock::time_point start_, last_;
  std::mutex mutex_;
};

}  // namespace kfstab::experiments
