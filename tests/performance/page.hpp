#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

namespace performance {

/// Puts a text between `<!-- NAME -->` and the next `<!-- end -->` of a page; false if they are not there.
inline bool put_between_markers(const std::filesystem::path& page, const std::string& name, const std::string& text) {
  const std::string begin = "<!-- " + name + " -->\n", end = "<!-- end -->\n";
  std::ifstream in(page);
  std::string content{std::istreambuf_iterator<char>(in), {}};
  const auto from = content.find(begin);
  const auto to = content.find(end, from == std::string::npos ? 0 : from);
  if (from == std::string::npos || to == std::string::npos) return false;
  content.replace(from + begin.size(), to - from - begin.size(), "\n" + text + "\n");
  std::ofstream(page) << content;
  return true;
}

/// The model's name of the machine's processor.
inline std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "an unknown processor";
}

}  // namespace performance
