#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include <sys/types.h>

namespace kfstab::properties {

/// How far a foreign program may go.
struct Limits {
  std::chrono::milliseconds reply{10'000};    ///< until a line is answered
  std::chrono::milliseconds startup{60'000};  ///< until the first is: interpreters and compilers take their time
  /// Address space of each of its processes, in bytes; 0: as much as it likes.
  std::uint64_t memory = std::uint64_t{4} << 30;
  std::size_t output = std::size_t{16} << 20;  ///< bytes of one line, and of what nobody asked for
};

/// A program of somebody else's, which answers lines by lines, and which is not trusted.
///
/// Between it and us stands a guardian, a process that adopts whatever the program leaves behind, and kills it all when
/// the ChildProcess goes, or when we do, however we end: nothing that the program started outlives it, whatever signals
/// it ignores and into whatever session it moved. A program has a session of its own: Ctrl-C on the terminal is ours.
///
/// The first one to be started turns SIGPIPE from a death into an error, for the whole process, unless it is handled.
///
/// What the program does that no program may is thrown as SubjectFault, with a sentence that goes on after its name:
/// "died of signal 11 (Segmentation fault)". It is killed then, and of no more use.
class ChildProcess {
 public:
  /// Runs `/bin/sh -c command`. Throws std::system_error where there are no processes or pipes left.
  ChildProcess(const std::string& command, const Limits& limits);
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;
  /// Closes its input, leaves it a moment to end by itself, and kills what is left.
  ~ChildProcess();

  /// Sends a line, which ends in its newline, and waits for one. What is returned has no newline, and is valid until the
  /// next call. After a second of silence `on_silence` is called, once, if it is not null.
  std::string_view ask(std::string_view line, std::chrono::milliseconds limit, void (*on_silence)());
  /// Sends a line that nobody answers.
  void tell(std::string_view line);
  /// Whether more came with the line than the line.
  bool has_more() const { return buffer_.size() > given_; }
  /// Whether it has written what nobody asked for, which is thrown away. If it goes on and on, that is a fault.
  bool babbles();

  /// The end of what it wrote to its standard error: a few thousand characters at most.
  std::string last_words();

 private:
  using Clock = std::chrono::steady_clock;
  enum class Source { output, ended, nothing };

  void send(std::string_view text, Clock::time_point end);
  /// Waits for output, and keeps what it says on stderr.
  Source wait(Clock::time_point end, bool for_writing = false);
  bool read_output();
  void read_errors();
  /// How it ended, as the guardian says.
  std::string ending();
  [[noreturn]] void died();
  [[noreturn]] void hung(std::chrono::milliseconds limit);
  [[noreturn]] void flooded();
  void finish(std::chrono::milliseconds grace) noexcept;

  Limits limits_;
  pid_t guardian_ = -1;
  int input_ = -1, output_ = -1, errors_ = -1;  ///< of the program, our ends
  int control_ = -1;                            ///< closed, the guardian kills
  int status_ = -1;                             ///< where the guardian tells how it ended
  std::string buffer_;                          ///< what was read and not yet given out
  std::size_t given_ = 0;                       ///< of it, the line given out last
  std::string words_;
};

}  // namespace kfstab::properties
