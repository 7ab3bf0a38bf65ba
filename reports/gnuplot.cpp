#include <kfstab/reports/gnuplot.hpp>

#include <cstdlib>
#include <exception>
#include <fstream>
#include <sstream>

#include <unistd.h>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#include <gnuplot-iostream.h>
#pragma GCC diagnostic pop

#include <kfstab/reports/program.hpp>

namespace kfstab::reports {
namespace {

namespace fs = std::filesystem;

std::string shell_string(std::string_view text) {
  std::string quoted = "'";
  for (char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

/// What gnuplot said on stderr, without the lines that only point at a column, on one line.
std::string in_one_line(std::istream& messages) {
  std::string text, line;
  while (std::getline(messages, line)) {
    const std::size_t first = line.find_first_not_of(" \t^");
    if (first == std::string::npos) continue;
    if (!text.empty()) text += "; ";
    text += line.substr(first);
  }
  constexpr std::size_t longest = 400;
  if (text.size() > longest) text = text.substr(0, longest) + "...";
  return text;
}

}  // namespace

std::optional<fs::path> find_gnuplot() { return find_program("gnuplot"); }

std::string run_gnuplot(const fs::path& folder, std::string_view script) {
  const auto program = find_gnuplot();
  if (!program) return "gnuplot was not found in PATH";

  std::error_code error;
  const fs::path temporary = fs::temp_directory_path(error);
  std::string messages = (temporary / "kfstab-gnuplot-XXXXXX").string();
  const int descriptor = error ? -1 : ::mkstemp(messages.data());
  if (descriptor < 0) return "no file could be made for gnuplot's messages: " + messages;
  ::close(descriptor);

  // The shell's answer is always success, and it reads what gnuplot left unread: the library would print its own
  // message about the one, and a gnuplot that ends early would kill us by SIGPIPE in the other.
  const std::string log = shell_string(messages);
  const std::string command = shell_string(program->string()) + " -d >/dev/null 2>" + log + " || echo \"exit code $?\" >>" + log +
                              "; while read -r rest; do :; done";
  try {
    Gnuplot gnuplot(command);
    gnuplot << "cd " << gnuplot_string(fs::absolute(folder).string()) << "\nload " << gnuplot_string(script) << "\n";
  } catch (const std::exception& failure) {
    ::unlink(messages.c_str());
    return std::string("gnuplot could not be started: ") + failure.what();
  }
  std::ifstream file(messages);
  std::string reason = in_one_line(file);
  ::unlink(messages.c_str());
  const bool failed = reason.find("exit code ") != std::string::npos;  // otherwise these are mere warnings
  return failed ? "gnuplot failed: " + reason : "";
}

std::string gnuplot_string(std::string_view text) {
  std::string quoted = "'";
  for (char c : text) {
    if (c == '\'') quoted += "''";
    else quoted += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return quoted + "'";
}

}  // namespace kfstab::reports
