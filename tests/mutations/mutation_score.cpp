// Tests the check by bugs: each of catalogue.toml is made in a copy of the filters, compiled alone as a plug-in, and
// checked. Verdicts: killed by the laws, by the reference, by the fingerprint; crashed, hung; survived; build error.
//
//   kfstab_mutation_score [--only REGEX] [--cases N] [--markdown FILE] [--jobs N]      exit 0 if none survived that should not
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <optional>
#include <regex>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <fmt/core.h>
#include <unistd.h>

#include <kfstab/experiments/fingerprint.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/check.hpp>
#include <kfstab/properties/node.hpp>
#include <kfstab/properties/plugin_host.hpp>
#include <kfstab/properties/protocol.hpp>
#include <kfstab/reports/files.hpp>
#include <kfstab/reports/markdown.hpp>

namespace {

namespace fs = std::filesystem;
using namespace kfstab;
using namespace kfstab::properties;

struct Mutation {
  std::string id, filter, file, why, old_text, new_text;
  std::string equivalent;
};

enum class Verdict { laws, reference, fingerprint, crashed, hung, survived, build_error };

const char* name(Verdict verdict) {
  switch (verdict) {
    case Verdict::laws: return "laws";
    case Verdict::reference: return "reference";
    case Verdict::fingerprint: return "fingerprint";
    case Verdict::crashed: return "crashed";
    case Verdict::hung: return "hung";
    case Verdict::survived: return "survived";
    case Verdict::build_error: return "build error";
  }
  return "";
}

struct Outcome {
  Verdict verdict = Verdict::survived;
  std::string by;  ///< the laws that failed, or what went wrong
};

std::string read(const fs::path& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

std::vector<Mutation> catalogue() {
  const fs::path path = fs::path(KFSTAB_SOURCE_DIR) / "tests/mutations/catalogue.toml";
  const Node root = parse_toml(read(path), path.string());
  std::vector<Mutation> all;
  for (const auto& [key, list] : *root.table()) {
    if (key != "mutation") throw std::runtime_error("catalogue.toml: unknown key " + key);
    for (const Node& table : *list.list()) {
      Mutation mutation;
      std::map<std::string, std::string*> fields{{"id", &mutation.id},
                                                 {"filter", &mutation.filter},
                                                 {"file", &mutation.file},
                                                 {"why", &mutation.why},
                                                 {"old", &mutation.old_text},
                                                 {"new", &mutation.new_text},
                                                 {"equivalent", &mutation.equivalent}};
      for (const auto& [field, value] : *table.table()) {
        if (!fields.contains(field)) throw std::runtime_error("catalogue.toml: unknown key " + field);
        *fields.at(field) = *value.text();
      }
      all.push_back(std::move(mutation));
    }
  }
  return all;
}

/// Header and class of each filter: the registry names them.
struct Source {
  std::string header, type;
};
const std::map<std::string, Source>& sources() {
  static const auto table = [] {
    std::map<std::string, Source> made;
    auto next = filters().begin();
#define KFSTAB_FILTER(header, Type, ...) made[std::string((next++)->id)] = {#header, #Type};
#include <kfstab/filters/registry.inc>
#undef KFSTAB_FILTER
    return made;
  }();
  return table;
}

int run(const std::string& command) { return std::system(command.c_str()); }

/// A folder of its own, gone at the end.
class Workshop {
 public:
  Workshop() {
    std::string pattern = (fs::temp_directory_path() / "kfstab-mutation-XXXXXX").string();
    if (!::mkdtemp(pattern.data())) throw std::runtime_error("no temporary folder");
    path_ = pattern;
  }
  ~Workshop() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

std::optional<std::string> build(const Mutation& mutation, const fs::path& folder, const fs::path& library) {
  const fs::path original = fs::path(KFSTAB_SOURCE_DIR) / "filters", copy = folder / "kfstab/filters";
  fs::create_directories(copy.parent_path());
  fs::copy(original, copy, fs::copy_options::recursive);
  std::string text = read(copy / mutation.file);
  const auto at = text.find(mutation.old_text);
  if (at == std::string::npos || text.find(mutation.old_text, at + 1) != std::string::npos)
    return fmt::format("the old text does not stand exactly once in {}", mutation.file);
  text.replace(at, mutation.old_text.size(), mutation.new_text);
  std::ofstream(copy / mutation.file) << text;
  const Source& source = sources().at(mutation.filter);
  const Metadata& metadata = *find_filter(mutation.filter);
  const char* scalar = metadata.asymmetry == Asymmetry::none ? "long double" : "double";
  const std::string command = fmt::format(
      "{} -std=c++20 -O0 -w -shared -fPIC -ffp-contract=off -I '{}' -isystem '{}' -I '{}/properties/plugin' "
      "-DKFSTAB_HEADER='<kfstab/filters/{}.hpp>' "
      "-DKFSTAB_CLASS={} -DKFSTAB_SCALAR='{}' -DKFSTAB_ID='\"{}\"' -o '{}' '{}/tests/mutations/plugin.cpp' >'{}/log' "
      "2>&1",
      KFSTAB_COMPILER, folder.string(), KFSTAB_EIGEN, KFSTAB_SOURCE_DIR, source.header, source.type, scalar,
      mutation.filter, library.string(), KFSTAB_SOURCE_DIR, folder.string());
  if (run(command) != 0) return read(folder / "log").substr(0, 2000);
  return std::nullopt;
}

Outcome judge(const Mutation& mutation, int cases) {
  const Workshop workshop;
  const fs::path library = workshop.path() / "filter.so";
  if (auto error = build(mutation, workshop.path(), library)) return {Verdict::build_error, *error};
  const auto subject = plugin_subject(library);
  CheckReport report;
  CheckOptions options;
  options.cases = cases;
  options.shrinking = 0;
  try {
    check(*subject, options, report);
    std::string laws, reference;
    for (const LawOutcome& outcome : report.laws) {
      if (outcome.holds()) continue;
      std::string& list = outcome.law.reference ? reference : laws;
      list += fmt::format("{}{}", list.empty() ? "" : ", ", outcome.law.id);
    }
    if (!laws.empty()) return {Verdict::laws, laws};
    if (!reference.empty()) return {Verdict::reference, reference};
    // The laws see nothing: does it lose digits as the filter does that it claims to be?
    const auto print = experiments::fingerprint(*subject);
    const auto alike = print ? print->alike() : std::vector<const Metadata*>();
    std::string names;
    bool itself = false;
    for (const Metadata* one : alike) {
      names += fmt::format("{}{}", names.empty() ? "" : ", ", one->id);
      itself = itself || one->id == mutation.filter;
    }
    if (!itself) return {Verdict::fingerprint, names.empty() ? "like no filter" : "like " + names};
  } catch (const SubjectFault& fault) {
    return {fault.kind == SubjectFault::Kind::hung ? Verdict::hung : Verdict::crashed, fault.what()};
  }
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && std::string_view(argv[1]) == "plugin-host") return serve_plugin(argv[2]);
  std::string only = ".", markdown;
  int cases = 200;
  unsigned jobs = std::max(1u, std::thread::hardware_concurrency());
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string_view option = argv[i];
    if (option == "--only")
      only = argv[i + 1];
    else if (option == "--cases")
      cases = std::atoi(argv[i + 1]);
    else if (option == "--markdown")
      markdown = argv[i + 1];
    else if (option == "--jobs")
      jobs = static_cast<unsigned>(std::max(1, std::atoi(argv[i + 1])));
    else {
      fmt::print(stderr, "usage: {} [--only REGEX] [--cases N] [--markdown FILE] [--jobs N]\n", argv[0]);
      return 2;
    }
  }
  reports::ignore_file_signals();
  const std::regex selects(only);
  std::vector<Mutation> selected;
  for (Mutation& mutation : catalogue())
    if (std::regex_search(mutation.id, selects)) selected.push_back(std::move(mutation));
  if (selected.empty()) {
    fmt::print(stderr, "no mutation matches '{}'\n", only);
    return 5;
  }

  std::vector<Outcome> outcomes(selected.size());
  std::atomic<std::size_t> next{0};
  std::mutex printing;
  std::vector<std::jthread> workers;
  for (unsigned w = 0; w < jobs; ++w)
    workers.emplace_back([&] {
      for (std::size_t i = next++; i < selected.size(); i = next++) {
        outcomes[i] = judge(selected[i], cases);
        const std::scoped_lock lock(printing);
        fmt::print("{:<32} {:<12} {}\n", selected[i].id, name(outcomes[i].verdict), outcomes[i].by);
        std::fflush(stdout);
      }
    });
  workers.clear();

  std::map<Verdict, int> count;
  int wrong = 0;
  reports::Table table{"", {"mutation", "filter", "bug", "noticed by", ""}, {}, {}};
  for (std::size_t i = 0; i < selected.size(); ++i) {
    const Mutation& mutation = selected[i];
    const Outcome& outcome = outcomes[i];
    ++count[outcome.verdict];
    const bool missed = outcome.verdict == Verdict::survived || outcome.verdict == Verdict::build_error;
    wrong += missed && mutation.equivalent.empty();
    table.rows.push_back({mutation.id, mutation.filter, mutation.why, name(outcome.verdict),
                          missed && !mutation.equivalent.empty() ? mutation.equivalent : outcome.by});
  }
  std::string summary;
  for (const auto& [verdict, number] : count)
    summary += fmt::format("{}{} {}", summary.empty() ? "" : ", ", number, name(verdict));
  fmt::print("{} mutations: {}\n{} passed, {} failed\n", selected.size(), summary,
             static_cast<int>(selected.size()) - wrong, wrong);
  if (!markdown.empty())
    reports::write_file(
        markdown, fmt::format("{} mutations: {}.\n\n{}", selected.size(), summary, reports::render_markdown(table)));
  return wrong == 0 ? 0 : 1;
}
