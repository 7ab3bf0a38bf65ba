#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <kfstab/experiments/foreign.hpp>
#include <kfstab/experiments/pages.hpp>

/// The commands, one file each; main.cpp reads the command line. Each returns its exit code (docs/conventions.md) and
/// throws for what main.cpp turns into one: properties::InputError and reports::FileError 2, NothingSelected 5.
namespace kfstab::experiments {

struct Exit {
  static constexpr int ok = 0, failed = 1, usage = 2, fault = 3, foreign = 4, nothing = 5, interrupted = 130;
};

/// `--set name=value`, as written.
using SetArguments = std::map<std::string, std::string>;

struct RunArguments {
  std::vector<std::string> systems;
  std::string filters;
  ForeignArguments foreign;
  std::optional<std::int64_t> steps;
  std::optional<std::uint64_t> seed;
  int jobs = 0;  ///< 0: one a core
  int digits = 30;
  SetArguments set;
  std::string out;
  std::string json;
  Rendering rendering;
};
int run_command(const RunArguments& arguments);

struct ReferenceArguments {
  std::string system;
  std::optional<std::int64_t> steps;
  std::optional<std::uint64_t> seed;
  int digits = 30;
  SetArguments set;
  std::string json;
  std::string cache;
};
int reference_command(const ReferenceArguments& arguments);

struct CompareArguments {
  std::string system;
  std::string filters;
  ForeignArguments foreign;
  std::vector<std::string> scans;
  std::optional<std::int64_t> steps;
  std::optional<std::uint64_t> seed;
  double accurate = 3;
  int jobs = 0;
  SetArguments set;
  std::string out;
  std::string json;
  Rendering rendering;
};
int compare_command(const CompareArguments& arguments);

struct ExplainArguments {
  std::string subject;  ///< a system, or a results.json of `run` or its folder
  std::string filters;
  std::optional<std::int64_t> steps;
  std::optional<std::uint64_t> seed;
  SetArguments set;
  std::string out;
  std::string json;
  Rendering rendering;
};
int explain_command(const ExplainArguments& arguments);

struct ClaimArguments {
  std::string claims;
  SetArguments set;
  bool quick = false;  ///< with fewer frames and steps
  int jobs = 0;        ///< 0: one a core
  int seeds = 0;       ///< over so many, how often each check holds; 0: the claims once, and their report
  std::string out;
  std::string json;
  Rendering rendering;
};
int claim_command(const ClaimArguments& arguments);

struct CheckArguments {
  std::optional<std::string> filters;
  bool batch = false;  ///< these in batches, as far as there are any
  ForeignArguments foreign;
  std::string laws;
  int cases = 200;
  std::uint64_t seed = 1986;
  double budget = 0;  ///< seconds; 0: as long as it takes
  int jobs = 0;       ///< 0: one a core
  std::string replay;       ///< a system file: nothing else is tried
  std::string regressions;  ///< a folder of them: tried first, and where failing systems go
  std::string expect;       ///< a file of laws that are known to fail
  std::string json, junit, markdown;  ///< files; - for stdout
  bool fingerprint = true;            ///< of what kind each filter is
  std::string out;                    ///< a folder for the page of the fingerprints; none if empty
  Rendering rendering;
};
int check_command(const CheckArguments& arguments);

struct ReportArguments {
  std::vector<std::string> results;  ///< one results.json to render again, or two to compare
  std::string out;
  Rendering rendering;
};
int report_command(const ReportArguments& arguments);

int demo_command(const std::string& out);

/// what: "systems", "filters" or "claims"; all of them if it is empty. markdown: as tables for a README, not for a terminal.
int list_command(const std::string& what, const std::string& format);

}  // namespace kfstab::experiments
