#include <kfstab/experiments/output.hpp>

#include <cstdio>

#include <fmt/core.h>

#include <kfstab/reports/files.hpp>
#include <kfstab/reports/markdown.hpp>
#include <kfstab/reports/terminal.hpp>

namespace kfstab::experiments {

Output::Output(const std::string& out, const std::string& name, std::string json, Rendering rendering)
    : json_(std::move(json)), rendering_(rendering) {
  if (!out.empty()) {
    folder_ = out;
  } else {
    // What users write may stand in a name: only what any file system takes is kept of it.
    std::string safe;
    for (const char c : name)
      safe += std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '+' || c == '.' ? c : '_';
    folder_ = std::filesystem::path("kfstab-out") / safe.substr(0, 100);
  }
  reports::Folder{folder_};
}

void Output::write(const reports::Document& document, const std::string& json) {
  write_results(document, json, folder_, rendering_);
  if (json_ == "-") {
    fmt::print("{}", json);
    if (std::fflush(stdout) != 0) throw reports::FileError("write", "standard output", "it cannot be written");
  } else if (!json_.empty()) {
    reports::write_file(json_, json);
  }
}

void Output::print(const std::string& text) const { fmt::print(json_ == "-" ? stderr : stdout, "{}", text); }

void Output::print(const reports::Table& table) const {
  print(only_markdown() ? reports::render_markdown(table) : reports::render_text(table));
}

std::filesystem::path Output::report() const {
  return folder_ / (rendering_.html ? "index.html" : rendering_.pdf ? "report.pdf" : "report.md");
}

}  // namespace kfstab::experiments
