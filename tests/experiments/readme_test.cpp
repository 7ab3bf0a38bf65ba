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
  std::stringstream words;  // g++ 12 warns of strings that are added up here, wrongly
  words << KFSTAB_TOOL_PATH << ' ' << arguments << " 2>/dev/null";
  const std::string command = words.str();
  std::FILE* pipe = popen(command.c_str(), "r");
  std::string text;
  std::array<char, 4096> buffer;
  while (const std::size_t size = std::fread(buffer.data(), 1, buffer.size(), pipe)) text.append(buffer.data(), size);
  EXPECT_EQ(pclose(pipe), 0) << command;
  return text;
}

/// What stands in the README, or in another page, between the markers of that name.
std::string readme_table(const std::string& name, const std::string& page_name = "README.md") {
  std::ifstream file(std::string(KFSTAB_SOURCE_DIR "/") + page_name);
  std::stringstream text;
  text << file.rdbuf();
  const std::string page = text.str(), mark = "<!-- " + name;
  const auto begin = page.find(mark + ": begin -->"), end = page.find(mark + ": end -->");
  if (begin == std::string::npos || end == std::string::npos) return "no markers for " + name;
  const auto from = page.find('\n', begin) + 1;
  return page.substr(from, end - from);
}

TEST(Readme, HasTheTableOfFiltersAsTheToolPrintsIt) {
  EXPECT_EQ(readme_table("filters"), output_of("list filters --format markdown"));
}

TEST(Laws, HaveTheirTableAsTheToolPrintsIt) {
  EXPECT_EQ(readme_table("laws", "docs/laws.md"), output_of("list laws --format markdown"));
}

TEST(Readme, HasTheTableOfClaimsAsTheToolMeasuresIt) {
  const auto folder = std::filesystem::temp_directory_path() / ("kfstab-readme-" + std::to_string(::getpid()));
  std::string arguments = "claim --format markdown --out ";
  arguments += folder.string();
  EXPECT_EQ(readme_table("claims"), output_of(arguments));
  std::filesystem::remove_all(folder);
}

}  // namespace
