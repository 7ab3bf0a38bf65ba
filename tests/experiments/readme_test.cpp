// The README's tables are the tool's own output: they are made again here and compared, so none can go stale.

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include <gtest/gtest.h>
#include <unistd.h>

namespace {

/// What the tool prints on stdout.
std::string output_of(const std::string& arguments) {
  const std::string command = std::string(KFSTAB_TOOL_PATH) + " " + arguments + " 2>/dev/null";
  std::FILE* pipe = popen(command.c_str(), "r");
  std::string text;
  std::array<char, 4096> buffer;
  while (const std::size_t size = std::fread(buffer.data(), 1, buffer.size(), pipe)) text.append(buffer.data(), size);
  EXPECT_EQ(pclose(pipe), 0) << command;
  return text;
}

/// What stands in the README between the markers of that name.
std::string readme_table(const std::string& name) {
  std::ifstream file(std::string(KFSTAB_SOURCE_DIR) + "/README.md");
  std::stringstream text;
  text << file.rdbuf();
  const std::string begin = "<!-- " + name + ": begin -->\n", end = "<!-- " + name + ": end -->";
  const auto from = text.str().find(begin), to = text.str().find(end);
  if (from == std::string::npos || to == std::string::npos) return "no markers for " + name;
  return text.str().substr(from + begin.size(), to - from - begin.size());
}

TEST(Readme, HasTheTableOfFiltersAsTheToolPrintsIt) {
  EXPECT_EQ(readme_table("filters"), output_of("list filters --format markdown"));
}

TEST(Readme, HasTheTableOfClaimsAsTheToolMeasuresIt) {
  const auto folder = std::filesystem::temp_directory_path() / ("kfstab-readme-" + std::to_string(::getpid()));
  EXPECT_EQ(readme_table("claims"), output_of("claim --format markdown --out " + folder.string()));
  std::filesystem::remove_all(folder);
}

}  // namespace
