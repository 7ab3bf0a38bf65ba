#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
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

/// The machine's processor: its name, with family and model where the system has them. One name may be that of processors which
/// are not alike.
inline std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  std::map<std::string, std::string> said;
  for (std::string line; std::getline(info, line) && !line.empty();)
    if (const auto colon = line.find(':'); colon != std::string::npos && colon + 2 <= line.size())
      said[line.substr(0, line.find_last_not_of(" \t", colon - 1) + 1)] = line.substr(colon + 2);
  if (!said.contains("model name")) return "an unknown processor";
  std::string name = said["model name"];
  if (said.contains("cpu family")) name += " (family " + said["cpu family"] + ", model " + said["model"] + ")";
  return name;
}

}  // namespace performance
