#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include <kfstab/experiments/context.hpp>
#include <kfstab/experiments/fingerprint.hpp>
#include <kfstab/properties/diagnosis.hpp>

/// What `check` says: on the terminal, as JSON (schema kfstab.check/1), as JUnit XML and as Markdown.
namespace kfstab::experiments {

/// A filter that was checked.
struct CheckedSubject {
  properties::CheckReport report;
  /// The filter did what no filter may: the check ended there.
  struct Fault {
    std::string kind;  ///< "died", "hung", "flooded" or "limit"
    std::string what;
  };
  std::optional<Fault> fault;
  /// Laws of --expect: known not to hold.
  std::set<std::string> expected;
  /// The command line that selects this filter alone: "--filters '^ckf$'".
  std::string selected_by;
  /// What mistake it makes, where laws fail: the best first.
  std::vector<properties::Diagnosis> diagnosis;
  /// Guesses, where no mistake explains what it answers: the likeliest first.
  std::vector<properties::Candidate> candidates;
  /// Of what kind it is, if that was asked for and there was time.
  std::optional<Fingerprint> fingerprint;
  bool fingerprint_left_out = false;  ///< there was no time
  /// The file of each failure's system, in the order of report.laws; empty where it was not written.
  std::vector<std::string> files;

  enum class Status {
    pass,
    fail,
    not_applicable,    ///< to none of the systems
    expected_failure,  ///< does not hold, as --expect says
    unexpected_pass,   ///< holds, although --expect says that it does not
  };
  Status status(std::size_t law) const;
  /// Laws that did as they should, and those that did not; what does not apply is neither.
  int passed() const;
  int failed() const;
  bool all_well() const { return !fault && failed() == 0; }
};

/// "pass", "fail", "not-applicable", "expected-failure", "unexpected-pass".
const char* name(CheckedSubject::Status status);

/// For a terminal: what failed on the smallest system, and what it means; one screen.
std::string check_text(const CheckedSubject& subject, bool color = false);
/// One subject: its object, as docs/protocol.md has it; several: {"schema", "verdict", "context", "checks": [...]}.
std::string check_json(const std::vector<CheckedSubject>& subjects, const Context& context);
std::string check_junit(const std::vector<CheckedSubject>& subjects);
std::string check_markdown(const std::vector<CheckedSubject>& subjects);

}  // namespace kfstab::experiments
