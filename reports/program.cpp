#include <kfstab/reports/program.hpp>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>
#include <system_error>
#include <thread>

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fmt/format.h>

namespace kfstab::reports {

namespace fs = std::filesystem;

std::optional<fs::path> find_program(std::string_view name) {
  const char* path = std::getenv("PATH");
  if (path == nullptr) return std::nullopt;
  std::istringstream folders(path);
  for (std::string folder; std::getline(folders, folder, ':');) {
    if (folder.empty()) continue;
    std::error_code unreadable;
    fs::path candidate = fs::absolute(fs::path(folder) / name, unreadable);
    if (fs::is_regular_file(candidate, unreadable) && ::access(candidate.c_str(), X_OK) == 0) return candidate;
  }
  return std::nullopt;
}

std::string run_program(const std::vector<std::string>& command, std::chrono::seconds limit) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const pid_t child = ::fork();
  if (child < 0) return std::generic_category().message(errno);
  if (child == 0) {
    ::setpgid(0, 0);
    const int nothing = ::open("/dev/null", O_RDWR);
    for (const int end : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) ::dup2(nothing, end);
    ::execv(arguments.front(), arguments.data());
    ::_exit(127);
  }
  const auto end = std::chrono::steady_clock::now() + limit;
  int status = 0;
  while (::waitpid(child, &status, WNOHANG) == 0) {
    if (std::chrono::steady_clock::now() > end) {
      ::kill(-child, SIGKILL);
      ::waitpid(child, &status, 0);
      return fmt::format("it had not ended after {} s", limit.count());
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  if (WIFSIGNALED(status)) return fmt::format("it died of signal {}", WTERMSIG(status));
  return WEXITSTATUS(status) == 0 ? "" : fmt::format("it ended with exit code {}", WEXITSTATUS(status));
}

std::string print_pdf(const fs::path& page, const fs::path& pdf) {
  std::optional<fs::path> browser;
  for (const char* name : {"chromium", "chromium-browser", "google-chrome"})
    if (!browser) browser = find_program(name);
  if (!browser) return "chromium was not found in PATH";

  std::error_code ignored;
  std::string profile = (fs::temp_directory_path(ignored) / "kfstab-browser-XXXXXX").string();
  if (::mkdtemp(profile.data()) == nullptr) return "no folder could be made for the browser's profile";
  fs::remove(pdf, ignored);
  // Without its sandbox, which it cannot set up in many containers: the page is ours, and asks for nothing.
  const std::string reason =
      run_program({browser->string(), "--headless", "--no-sandbox", "--disable-gpu", "--user-data-dir=" + profile,
                   "--no-pdf-header-footer", "--print-to-pdf-no-header", "--print-to-pdf=" + fs::absolute(pdf).string(),
                   "file://" + fs::absolute(page).string()},
                  std::chrono::seconds(120));
  fs::remove_all(profile, ignored);

  std::ifstream file(pdf, std::ios::binary);
  const std::string content{std::istreambuf_iterator<char>(file), {}};
  const bool whole = content.starts_with("%PDF") &&
                     content.find("%%EOF", content.size() - std::min<std::size_t>(content.size(), 16)) != content.npos;
  if (reason.empty() && whole) return "";
  fs::remove(pdf, ignored);
  return fmt::format("{} failed: {}", browser->filename().string(),
                     reason.empty() ? "it left no complete file" : reason);
}

}  // namespace kfstab::reports
