#pragma once

#include <filesystem>
#include <string>

#include <kfstab/experiments/pages.hpp>
#include <kfstab/reports/document.hpp>

namespace kfstab::experiments {

/// Where a command's results go: a folder of files, and stdout, which is left to the JSON alone by `--json -`.
class Output {
 public:
  /// @param out  --out, or empty: then ./kfstab-out/NAME
  /// @param json  --json: a file, "-" for stdout, or empty
  /// @param rendering  --format and --for
  /// Throws reports::FileError at once, before any work, if the folder is not ours to write.
  Output(const std::string& out, const std::string& name, std::string json, Rendering rendering = {});

  const std::filesystem::path& folder() const { return folder_; }

  /// results.json, the report and every figure; the JSON to --json too.
  void write(const reports::Document& document, const std::string& json);

  /// To stdout, or to stderr if stdout is the JSON's.
  void print(const std::string& text) const;
  /// A table so, as text, or as Markdown if that alone was asked for.
  void print(const reports::Table& table) const;
  bool only_markdown() const { return rendering_.only_markdown(); }

  /// The report: what to open.
  std::filesystem::path report() const;

 private:
  std::filesystem::path folder_;
  std::string json_;
  Rendering rendering_;
};

}  // namespace kfstab::experiments
