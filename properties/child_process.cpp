#include <kfstab/properties/child_process.hpp>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <system_error>
#include <utility>

#include <dirent.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fmt/format.h>

#include <kfstab/properties/subject.hpp>

namespace kfstab::properties {

namespace {

using std::chrono::milliseconds;

constexpr std::size_t most_words = 4096;

/// How the program ended, as its guardian tells.
struct Death {
  int status;
  long most_memory;  ///< resident, in KiB
};

struct Pipe {
  int read = -1, write = -1;

  Pipe() {
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) throw std::system_error(errno, std::generic_category(), "cannot make a pipe");
    read = ends[0];
    write = ends[1];
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  ~Pipe() {
    if (read >= 0) ::close(read);
    if (write >= 0) ::close(write);
  }
  static int release(int& end) { return std::exchange(end, -1); }
};

// --- the guardian: a fork of a process that may have threads, so that it keeps to system calls --------------------------

/// Closes what was inherited, or the guardian would keep other programs' pipes open.
void close_all_but(std::array<int, 5> kept) {
  std::sort(kept.begin(), kept.end());
  unsigned first = 0;
  for (const int descriptor : kept) {
    const auto next = static_cast<unsigned>(descriptor);
    if (next > first) ::close_range(first, next - 1, 0);
    first = next + 1;
  }
  ::close_range(first, ~0U, 0);
}

void limit(int resource, rlim_t most) {
  rlimit limits{};
  ::getrlimit(static_cast<__rlimit_resource_t>(resource), &limits);
  limits.rlim_cur = limits.rlim_max = std::min(most, limits.rlim_max);
  ::setrlimit(static_cast<__rlimit_resource_t>(resource), &limits);
}

[[noreturn]] void become(const char* command, int input, int output, int errors, std::uint64_t memory) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  ::setsid();
  // They are none of 0, 1 and 2, which the guardian has left open: a duplicate stays open over exec.
  ::dup2(input, STDIN_FILENO);
  ::dup2(output, STDOUT_FILENO);
  ::dup2(errors, STDERR_FILENO);
  limit(RLIMIT_CORE, 0);
  if (memory > 0) limit(RLIMIT_AS, memory);
  sigset_t none;
  ::sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  ::execl("/bin/sh", "sh", "-c", command, static_cast<char*>(nullptr));
  ::_exit(127);
}

/// The parent of a process, of the file /proc/PID/stat: "PID (any name) STATE PARENT ...".
pid_t parent_of(pid_t process) {
  char path[64], text[512];
  std::snprintf(path, sizeof path, "/proc/%d/stat", process);
  const int file = ::open(path, O_RDONLY | O_CLOEXEC);
  if (file < 0) return -1;
  const ssize_t length = ::read(file, text, sizeof text - 1);
  ::close(file);
  if (length <= 0) return -1;
  text[length] = '\0';
  const char* end = std::strrchr(text, ')');
  return end && std::strlen(end) > 4 ? static_cast<pid_t>(std::strtol(end + 4, nullptr, 10)) : -1;
}

/// Kills every child, and what each leaves behind, which becomes a child: until there is none.
void kill_all(pid_t program) {
  const pid_t self = ::getpid();
  for (int round = 0; round < 5000; ++round) {
    if (program > 0) ::kill(-program, SIGKILL);  // its session's processes at one go, if it is still there
    if (DIR* processes = ::opendir("/proc")) {
      while (const dirent* entry = ::readdir(processes)) {
        const auto process = static_cast<pid_t>(std::strtol(entry->d_name, nullptr, 10));  // 0 for what is no number
        if (process > 0 && parent_of(process) == self) ::kill(process, SIGKILL);
      }
      ::closedir(processes);
    }
    pid_t ended;
    while ((ended = ::waitpid(-1, nullptr, WNOHANG)) > 0)
      if (ended == program) program = -1;
    if (ended < 0 && errno == ECHILD) return;
    ::usleep(1000);
  }
}

void wake(int) {}

[[noreturn]] void guard(const char* command, std::uint64_t memory, int input, int output, int errors, int control,
                        int status) {
  ::setsid();
  ::prctl(PR_SET_CHILD_SUBREAPER, 1);
  for (int signal = 1; signal < NSIG; ++signal) ::signal(signal, SIG_DFL);
  sigset_t blocked, waiting;
  ::sigfillset(&blocked);
  ::sigprocmask(SIG_SETMASK, &blocked, nullptr);
  ::sigfillset(&waiting);
  ::sigdelset(&waiting, SIGCHLD);
  struct sigaction action {};
  action.sa_handler = wake;
  ::sigaction(SIGCHLD, &action, nullptr);
  close_all_but({input, output, errors, control, status});
  for (const int end : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (::fcntl(end, F_GETFD) < 0) ::open("/dev/null", O_RDWR);

  pid_t program = ::fork();
  if (program == 0) become(command, input, output, errors, memory);
  for (const int end : {input, output, errors}) ::close(end);
  if (program < 0) ::_exit(1);
  for (pid_t running = program;;) {
    pollfd told{control, POLLIN, 0};
    if (::ppoll(&told, 1, nullptr, &waiting) > 0) break;
    Death death{};
    rusage usage{};
    pid_t ended;
    while ((ended = ::wait4(-1, &death.status, WNOHANG, &usage)) > 0)
      if (ended == running) {
        death.most_memory = usage.ru_maxrss;
        [[maybe_unused]] const auto written = ::write(status, &death, sizeof death);
        running = program = -1;
      }
  }
  kill_all(program);
  ::_exit(0);
}

// --- our side -----------------------------------------------------------------------------------------------------------

/// A descriptor above those of the standard streams, which the program's are put in the place of.
void lift(int& end) {
  if (end > STDERR_FILENO) return;
  const int above = ::fcntl(end, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
  if (above < 0) throw std::system_error(errno, std::generic_category(), "cannot make a pipe");
  ::close(end);
  end = above;
}

void ignore_broken_pipes() {
  struct sigaction now {};
  if (::sigaction(SIGPIPE, nullptr, &now) == 0 && now.sa_handler == SIG_DFL) ::signal(SIGPIPE, SIG_IGN);
}

int remaining(std::chrono::steady_clock::time_point end) {
  const auto left = std::chrono::ceil<milliseconds>(end - std::chrono::steady_clock::now()).count();
  return static_cast<int>(std::clamp<std::int64_t>(left, 0, 1'000'000'000));
}

std::string seconds(milliseconds time) { return fmt::format("{} s", static_cast<double>(time.count()) / 1000); }

}  // namespace

ChildProcess::ChildProcess(const std::string& command, const Limits& limits) : limits_(limits) {
  ignore_broken_pipes();
  Pipe input, output, errors, control, status;
  for (Pipe* pipe : {&input, &output, &errors, &control, &status}) {
    lift(pipe->read);
    lift(pipe->write);
  }
  guardian_ = ::fork();
  if (guardian_ < 0) throw std::system_error(errno, std::generic_category(), "cannot start a process");
  if (guardian_ == 0)
    guard(command.c_str(), limits.memory, input.read, output.write, errors.write, control.read, status.write);
  input_ = Pipe::release(input.write);
  output_ = Pipe::release(output.read);
  errors_ = Pipe::release(errors.read);
  control_ = Pipe::release(control.write);
  status_ = Pipe::release(status.read);
  for (const int end : {input_, output_, errors_}) ::fcntl(end, F_SETFL, O_NONBLOCK);
}

ChildProcess::~ChildProcess() { finish(milliseconds(200)); }

void ChildProcess::finish(milliseconds grace) noexcept {
  if (guardian_ < 0) return;
  ::close(input_);
  if (grace.count() > 0) {
    pollfd ended{status_, POLLIN, 0};
    ::poll(&ended, 1, static_cast<int>(grace.count()));
  }
  ::close(control_);
  while (::waitpid(guardian_, nullptr, 0) < 0 && errno == EINTR) {
  }
  guardian_ = -1;
  for (int* end : {&output_, &errors_, &status_})
    if (*end >= 0) ::close(std::exchange(*end, -1));
}

void ChildProcess::tell(std::string_view line) { send(line, Clock::now() + limits_.reply); }

std::string_view ChildProcess::ask(std::string_view line, milliseconds limit, void (*on_silence)()) {
  const auto begin = Clock::now();
  const auto end = begin + limit, silence = begin + milliseconds(1000);
  buffer_.erase(0, given_);
  given_ = 0;
  std::size_t looked_at = 0;
  send(line, end);
  for (;;) {
    const auto newline = buffer_.find('\n', looked_at);
    if (newline != std::string::npos) {
      given_ = newline + 1;
      const std::size_t carriage = newline > 0 && buffer_[newline - 1] == '\r' ? 1 : 0;
      return std::string_view(buffer_).substr(0, newline - carriage);
    }
    looked_at = buffer_.size();
    if (looked_at > limits_.output) flooded();
    switch (wait(on_silence ? std::min(end, silence) : end)) {
      case Source::output:
        if (!read_output()) died();
        break;
      case Source::ended:
        // It may have answered before it died.
        if (!read_output() || buffer_.find('\n', looked_at) == std::string::npos) died();
        break;
      case Source::nothing:
        if (Clock::now() >= end) hung(limit);
        if (on_silence) std::exchange(on_silence, nullptr)();
        break;
    }
  }
}

bool ChildProcess::babbles() {
  buffer_.erase(0, given_);
  given_ = 0;
  const auto pending = [&] { return wait(Clock::now()) == Source::output && read_output(); };
  if (buffer_.empty() && !pending()) return false;
  // What stops within a moment is a line too many; what does not is a flood.
  const auto end = Clock::now() + milliseconds(50);
  while (Clock::now() < end && wait(end) == Source::output && read_output())
    if (buffer_.size() > limits_.output) flooded();
  buffer_.clear();
  return true;
}

void ChildProcess::send(std::string_view text, Clock::time_point end) {
  for (;;) {
    const ssize_t written = ::write(input_, text.data(), text.size());
    if (written >= 0) {
      text.remove_prefix(static_cast<std::size_t>(written));
      if (text.empty()) return;
    } else if (errno == EPIPE) {
      died();
    } else if (errno != EAGAIN && errno != EINTR) {
      throw std::system_error(errno, std::generic_category(), "cannot write to the filter");
    }
    // It may be stuck with an answer that we have to take first.
    if (wait(end, true) == Source::output && !read_output()) died();
    if (buffer_.size() > limits_.output) flooded();
    if (Clock::now() >= end) hung(limits_.reply);
  }
}

ChildProcess::Source ChildProcess::wait(Clock::time_point end, bool for_writing) {
  for (;;) {
    std::array<pollfd, 4> watched{
        {{output_, POLLIN, 0}, {errors_, POLLIN, 0}, {status_, POLLIN, 0}, {input_, POLLOUT, 0}}};
    const int ready = ::poll(watched.data(), for_writing ? 4 : 3, remaining(end));
    if (ready < 0 && errno != EINTR)
      throw std::system_error(errno, std::generic_category(), "cannot wait for the filter");
    if (ready < 0) continue;
    if (watched[1].revents != 0) read_errors();
    if (watched[0].revents != 0) return Source::output;
    if (watched[2].revents != 0) return Source::ended;
    if (for_writing && watched[3].revents != 0) return Source::nothing;
    if (Clock::now() >= end) return Source::nothing;
  }
}

/// False at the end of its output.
bool ChildProcess::read_output() {
  std::array<char, 65536> piece;
  const ssize_t length = ::read(output_, piece.data(), piece.size());
  if (length < 0) return errno == EAGAIN || errno == EINTR;
  buffer_.append(piece.data(), static_cast<std::size_t>(length));
  return length > 0;
}

void ChildProcess::read_errors() {
  std::array<char, 65536> piece;
  const ssize_t length = ::read(errors_, piece.data(), piece.size());
  if (length == 0) {
    // Closed: poll leaves out a negative descriptor.
    ::close(errors_);
    errors_ = -1;
  }
  if (length <= 0) return;
  words_.append(piece.data(), static_cast<std::size_t>(length));
  if (words_.size() > most_words) words_.erase(0, words_.size() - most_words);
}

std::string ChildProcess::last_words() {
  // What it wrote before it died is in the pipe.
  while (errors_ >= 0) {
    pollfd waiting{errors_, POLLIN, 0};
    if (::poll(&waiting, 1, 0) <= 0) break;
    read_errors();
  }
  return words_;
}

void ChildProcess::died() {
  // The end of its output comes a moment before the news of its death.
  pollfd ended{status_, POLLIN, 0};
  ::poll(&ended, 1, 1000);
  Death death{};
  std::string how = "closed its output";
  if (ended.revents != 0 && ::read(status_, &death, sizeof death) == sizeof death) {
    if (WIFSIGNALED(death.status))
      how = fmt::format("died of signal {} ({})", WTERMSIG(death.status), ::strsignal(WTERMSIG(death.status)));
    else if (const int code = WEXITSTATUS(death.status); code > 128 && code < 128 + NSIG)
      how = fmt::format("died, its shell says of signal {} ({})", code - 128, ::strsignal(code - 128));
    else
      how = fmt::format("ended with exit code {}", code);
  }
  const std::string words = last_words();
  finish(milliseconds(0));
  // A program that is refused memory says so, if it comes to say anything; one that had half of it has likely asked for
  // the other half.
  const auto says = [&](const char* text) { return words.find(text) != std::string::npos; };
  const bool memory =
      limits_.memory > 0 && death.status != 0 &&
      (static_cast<std::uint64_t>(death.most_memory) * 1024 > limits_.memory / 2 || says("bad_alloc") ||
       says("MemoryError") || says("out of memory") || says("Out of memory") || says("Cannot allocate memory"));
  if (memory)
    throw SubjectFault(SubjectFault::Kind::limit,
                       fmt::format("{}, out of memory: its limit is {} MiB", how, limits_.memory >> 20));
  throw SubjectFault(SubjectFault::Kind::died, how);
}

void ChildProcess::hung(milliseconds limit) {
  last_words();
  finish(milliseconds(0));
  throw SubjectFault(SubjectFault::Kind::hung, fmt::format("did not answer within {}", seconds(limit)));
}

void ChildProcess::flooded() {
  last_words();
  finish(milliseconds(0));
  throw SubjectFault(SubjectFault::Kind::flooded,
                     fmt::format("wrote more than {} MiB in one line, or unasked", limits_.output >> 20));
}

}  // namespace kfstab::properties
