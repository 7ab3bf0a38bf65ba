#include <kfstab/experiments/check_report.hpp>

#include <algorithm>
#include <cmath>
#include <tuple>

#include <fmt/core.h>
#include <nlohmann/json.hpp>

#include <kfstab/properties/system_file.hpp>
#include <kfstab/reports/document.hpp>
#include <kfstab/reports/markdown.hpp>
#include <kfstab/reports/number.hpp>
#include <kfstab/reports/terminal.hpp>

namespace kfstab::experiments {
namespace {

using nlohmann::ordered_json;
using properties::largest_ratio;
using properties::LawOutcome;
using LawStatus = CheckedSubject::Status;

bool is_bad(LawStatus status) { return status == LawStatus::fail || status == LawStatus::unexpected_pass; }

/// JSON has no infinity: the word stands beside a null.
ordered_json number(double value) { return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr); }

std::string ratio_text(double ratio) { return std::isinf(ratio) ? "inf" : reports::short_number(ratio, 2); }

std::string size_text(const properties::System& system) {
  const Dimensions d = system.dimensions();
  return fmt::format("n = {}, m = {}, p = {}, {} step{}", d.n, d.m, d.p, system.steps, system.steps == 1 ? "" : "s");
}

/// Which failure to show: on the smallest system; of those, of a law that asks no reference.
const LawOutcome* most_telling(const CheckedSubject& subject) {
  const LawOutcome* best = nullptr;
  const auto weight = [](const LawOutcome& outcome) {
    const properties::System& system = outcome.failure->system;
    const Dimensions d = system.dimensions();
    return std::tuple(d.n + d.m + d.p + system.steps, outcome.law.reference, outcome.failure->finding.what.empty());
  };
  for (std::size_t i = 0; i < subject.report.laws.size(); ++i) {
    const LawOutcome& outcome = subject.report.laws[i];
    if (subject.status(i) == LawStatus::fail && (!best || weight(outcome) < weight(*best))) best = &outcome;
  }
  return best;
}

/// The system without what says nothing: TOML, indented.
std::string system_text(const properties::System& system, const std::string& indent) {
  std::string text;
  std::string line;
  const std::string toml = properties::write_system(system);
  for (const char c : toml) {
    if (c != '\n') {
      line += c;
      continue;
    }
    const bool says_nothing =
        line.empty() || line.starts_with("name =") || line.starts_with("description =") || line.starts_with("source =");
    if (!says_nothing) text += indent + line + "\n";
    line.clear();
  }
  return text;
}

std::string again(const CheckedSubject& subject, const LawOutcome& outcome, const std::string& file) {
  const std::string how = file.empty() ? fmt::format("--seed {} --cases {}", subject.report.seed, subject.report.asked)
                                       : fmt::format("--replay {}", file);
  return fmt::format("kfstab check {} --laws '^{}$' {}", subject.selected_by, outcome.law.id, how);
}

std::string wrapped(const std::string& text, std::size_t indent, std::size_t width = 100) {
  std::string result(indent, ' ');
  std::size_t column = indent;
  std::size_t from = 0;
  while (from < text.size()) {
    std::size_t to = text.find(' ', from);
    if (to == std::string::npos) to = text.size();
    const std::size_t length = reports::display_width(text.substr(from, to - from));
    if (column > indent && column + 1 + length > width) {
      result += "\n" + std::string(indent, ' ');
      column = indent;
    }
    if (column > indent) {
      result += ' ';
      ++column;
    }
    result += text.substr(from, to - from);
    column += length;
    from = to + 1;
  }
  return result + "\n";
}

std::string summary(const CheckedSubject& subject) {
  const properties::CheckReport& r = subject.report;
  std::string text = fmt::format("{}: {} of {} cases, seed {}, {} steps, {:.1f} s", r.subject.name, r.cases, r.asked,
                                 r.seed, r.steps, r.seconds);
  if (r.out_of_time) text += "; out of time: the rest was not tried";
  if (r.interrupted) text += "; interrupted";
  if (r.not_sent > 0) text += fmt::format("; {} outside of what it needs", r.not_sent);
  return text;
}

/// "it declined 12 of 200 systems: singular_innovation (12)"
std::string refusals(const properties::CheckReport& report) {
  if (report.refused == 0) return {};
  std::string text = fmt::format("it declined {} of {} systems", report.refused, report.cases);
  const char* between = ": ";
  for (const auto& [reason, count] : report.reasons) {
    text += fmt::format("{}{} ({})", between, reason, count);
    between = ", ";
  }
  return text;
}

std::string names(const CheckedSubject& subject, LawStatus wanted) {
  std::string text;
  for (std::size_t i = 0; i < subject.report.laws.size(); ++i)
    if (subject.status(i) == wanted)
      text += fmt::format("{}{}", text.empty() ? "" : ", ", subject.report.laws[i].law.id);
  return text;
}

/// Beside what JSON cannot say, the word for it.
ordered_json numbers(const std::vector<double>& values) {
  ordered_json array = ordered_json::array();
  for (const double value : values) {
    if (std::isfinite(value))
      array.push_back(value);
    else
      array.push_back(std::isnan(value) ? "nan" : "inf");
  }
  return array;
}

ordered_json slope_json(const Line& line) {
  if (std::isnan(line.slope)) return nullptr;
  return {{"slope", line.slope}, {"half_width", number(line.half_width)}, {"points", line.points}};
}

ordered_json fingerprint_json(const Fingerprint& f) {
  ordered_json json;
  json["sentence"] = sentence(f);
  json["like"] = ordered_json::array();
  for (const Metadata* one : f.alike()) json["like"].push_back(one->id);
  json["precision"] = f.precision();
  json["roundoff"] = number(f.roundoff);
  json["ordinary_error"] = number(f.ordinary_error);
  json["answers_floats"] = f.answers_floats;
  json["steps"] = f.steps;
  json["ladders"] = ordered_json::array();
  const auto optional = [](const std::optional<double>& value) {
    return value ? ordered_json(*value) : ordered_json(nullptr);
  };
  for (const Climb& climb : f.climbs)
    json["ladders"].push_back({{"id", climb.id},
                               {"difficulty", climb.symbol},
                               {"at", numbers(climb.at)},
                               {"P", numbers(climb.P)},
                               {"K", numbers(climb.K)},
                               {"P_slope", slope_json(climb.P_slope)},
                               {"K_slope", slope_json(climb.K_slope)},
                               {"indefinite_from", optional(climb.indefinite)},
                               {"breaks_down_at", optional(climb.broken)},
                               {"refused", climb.refused ? ordered_json(*climb.refused) : ordered_json(nullptr)}});
  json["asymmetry"] = ordered_json::array();
  for (const AsymmetryRun& run : f.asymmetries)
    json["asymmetry"].push_back({{"id", run.id}, {"growth", number(run.growth)}, {"l1_l2", run.product}});
  json["neighbours"] = ordered_json::array();
  for (const Neighbour& one : f.neighbours)
    json["neighbours"].push_back({{"filter", one.filter->id}, {"decades", one.distance}});
  return json;
}

ordered_json subject_json(const CheckedSubject& subject) {
  const properties::CheckReport& r = subject.report;
  ordered_json json;
  json["subject"] = r.subject.name;
  json["verdict"] = subject.all_well() ? "pass" : "fail";
  json["seed"] = r.seed;
  json["cases"] = {{"asked", r.asked}, {"tried", r.cases}, {"not_sent", r.not_sent}, {"declined", r.refused}};
  json["steps"] = r.steps;
  json["seconds"] = r.seconds;
  json["complete"] = !r.interrupted && !r.out_of_time && !subject.fault;
  if (subject.fault) json["fault"] = {{"kind", subject.fault->kind}, {"what", subject.fault->what}};
  json["declined"] = ordered_json::object();
  for (const auto& [reason, count] : r.reasons) json["declined"][reason] = count;
  json["classes"] = ordered_json::object();
  for (const auto& [one, count] : r.classes) json["classes"][one] = count;
  json["laws"] = ordered_json::array();
  for (std::size_t i = 0; i < r.laws.size(); ++i) {
    const LawOutcome& outcome = r.laws[i];
    ordered_json law{{"id", outcome.law.id},      {"status", name(subject.status(i))},
                     {"cases", outcome.cases},    {"max_ratio", number(outcome.max_ratio)},
                     {"counterexample", nullptr}, {"hint", nullptr}};
    if (!std::isfinite(outcome.max_ratio)) law["max_ratio_word"] = "inf";
    if (outcome.failure) {
      const properties::Failure& failure = *outcome.failure;
      law["counterexample"] = {
          {"system", properties::write_system(failure.system)},
          {"ratio", number(failure.finding.ratio)},
          {"step", failure.finding.step},
          {"what", failure.finding.what},
          {"case", failure.number},
          {"shrinks", failure.shrinks},
          {"irrelevant", failure.irrelevant},
          {"file",
           subject.files.empty() || subject.files[i].empty() ? ordered_json(nullptr) : ordered_json(subject.files[i])},
          {"command", again(subject, outcome, subject.files.empty() ? "" : subject.files[i])}};
      law["hint"] = outcome.law.failure;
    }
    json["laws"].push_back(std::move(law));
  }
  json["diagnosis"] = ordered_json::array();
  for (const properties::Diagnosis& one : subject.diagnosis) {
    ordered_json names = ordered_json::array();
    for (const properties::Mistake* mistake : one.mistakes) names.push_back(mistake->id);
    json["diagnosis"].push_back({{"mistake", one.mistakes.size() == 1 ? names.front() : names},
                                 {"confidence", one.confidence()},
                                 {"digits", one.digits},
                                 {"right_digits", one.right_digits},
                                 {"systems", one.systems},
                                 {"sentence", one.sentence()}});
  }
  json["candidates"] = ordered_json::array();
  for (const properties::Candidate& one : subject.candidates)
    json["candidates"].push_back({{"mistake", one.mistake->id},
                                  {"likeness", one.likeness},
                                  {"laws_alike", one.alike},
                                  {"laws_either", one.either},
                                  {"systems", one.systems},
                                  {"digits", one.digits},
                                  {"right_digits", one.right_digits},
                                  {"sentence", one.sentence()}});
  json["fingerprint"] = subject.fingerprint ? fingerprint_json(*subject.fingerprint) : ordered_json(nullptr);
  return json;
}

/// How candidates are announced.
constexpr const char* guess = "No mistake known here explains its answers. A guess, it is like a filter that";

std::string xml(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&': escaped += "&amp;"; break;
      case '<': escaped += "&lt;"; break;
      case '>': escaped += "&gt;"; break;
      case '"': escaped += "&quot;"; break;
      // XML 1.0 has no other control characters, not even escaped.
      case '\n':
      case '\t': escaped += c; break;
      default: escaped += static_cast<unsigned char>(c) < 0x20 ? '?' : c;
    }
  }
  return escaped;
}

std::string failure_text(const CheckedSubject& subject, std::size_t i) {
  const LawOutcome& outcome = subject.report.laws[i];
  const properties::Failure& failure = *outcome.failure;
  std::string text = fmt::format("{}\n", outcome.law.statement);
  text += fmt::format("ratio {} where {} is allowed{}, on {}\n", ratio_text(failure.finding.ratio), largest_ratio,
                      failure.finding.step >= 0 ? fmt::format(", at step {}", failure.finding.step) : "",
                      size_text(failure.system));
  if (!failure.finding.what.empty()) text += failure.finding.what + "\n";
  text += system_text(failure.system, "  ");
  text += fmt::format("{}\nagain: {}\n", outcome.law.failure,
                      again(subject, outcome, subject.files.empty() ? "" : subject.files[i]));
  return text;
}

}  // namespace

const char* name(LawStatus status) {
  switch (status) {
    case LawStatus::pass: return "pass";
    case LawStatus::fail: return "fail";
    case LawStatus::not_applicable: return "not-applicable";
    case LawStatus::expected_failure: return "expected-failure";
    case LawStatus::unexpected_pass: return "unexpected-pass";
  }
  return "";
}

CheckedSubject::Status CheckedSubject::status(std::size_t law) const {
  const LawOutcome& outcome = report.laws[law];
  const bool expected_to_fail = expected.contains(std::string(outcome.law.id));
  if (outcome.failure) return expected_to_fail ? LawStatus::expected_failure : LawStatus::fail;
  // A check that was cut short has not tried everything: it cannot say that a law begins to hold.
  const bool complete = !fault && !report.interrupted && !report.out_of_time;
  if (expected_to_fail && complete) return LawStatus::unexpected_pass;
  return outcome.cases == 0 ? LawStatus::not_applicable : LawStatus::pass;
}

int CheckedSubject::passed() const {
  int count = 0;
  for (std::size_t i = 0; i < report.laws.size(); ++i)
    count += status(i) == LawStatus::pass || status(i) == LawStatus::expected_failure;
  return count;
}

int CheckedSubject::failed() const {
  int count = 0;
  for (std::size_t i = 0; i < report.laws.size(); ++i) count += is_bad(status(i));
  return count;
}

std::string check_text(const CheckedSubject& subject, bool color) {
  const properties::CheckReport& r = subject.report;
  std::string text = summary(subject) + "\n";
  if (const auto said = refusals(r); !said.empty()) text += "  " + said + "\n";
  if (subject.fingerprint) text += wrapped(sentence(*subject.fingerprint), 2);
  if (subject.fingerprint_left_out) text += "  out of time: no fingerprint was taken\n";
  if (subject.fault)
    text += fmt::format("\n{}{}{}\n", color ? "\033[31m" : "", subject.fault->what, color ? "\033[0m" : "");

  if (subject.failed() > 0) {
    reports::Table table{"", {"law", "cases", "worst ratio", "fails on", "at step"}, {}, {}};
    using enum reports::Alignment;
    table.alignment = {left, right, right, left, right};
    for (std::size_t i = 0; i < r.laws.size(); ++i) {
      const LawOutcome& outcome = r.laws[i];
      if (subject.status(i) == LawStatus::unexpected_pass)
        table.rows.push_back({std::string(outcome.law.id), fmt::format("{}", outcome.cases),
                              ratio_text(outcome.max_ratio), "none, although --expect says so", ""});
      if (subject.status(i) != LawStatus::fail) continue;
      const properties::Failure& failure = *outcome.failure;
      table.rows.push_back({std::string(outcome.law.id), fmt::format("{}", outcome.cases),
                            ratio_text(outcome.max_ratio), size_text(failure.system),
                            failure.finding.step < 0 ? "" : fmt::format("{}", failure.finding.step)});
    }
    text += "\n" + reports::render_text(table);
  }
  for (const properties::Diagnosis& one : subject.diagnosis)
    text += fmt::format("\n{}{}", &one == &subject.diagnosis.front() ? "" : "or: ", wrapped(one.sentence(), 0));
  if (!subject.candidates.empty()) {
    text += std::string("\n") + guess + ":\n";
    for (const properties::Candidate& one : subject.candidates) text += wrapped(one.sentence(), 2);
  }
  if (const LawOutcome* shown = most_telling(subject)) {
    const properties::Failure& failure = *shown->failure;
    const auto i = static_cast<std::size_t>(shown - r.laws.data());
    text += fmt::format("\n{}{}{} does not hold:\n", color ? "\033[31m" : "", shown->law.id, color ? "\033[0m" : "");
    text += wrapped(std::string(shown->law.statement), 2);
    text += fmt::format("  on this system ({}{}):\n\n",
                        failure.number < 0 ? "replayed" : fmt::format("case {}", failure.number),
                        failure.shrinks > 0 ? fmt::format(", made smaller {} times", failure.shrinks) : "");
    text += system_text(failure.system, "    ") + "\n";
    if (!failure.finding.what.empty()) text += wrapped(failure.finding.what, 2);
    text += fmt::format("  ratio {}, where rounding explains {}\n", ratio_text(failure.finding.ratio), largest_ratio);
    text += wrapped(std::string(shown->law.failure), 2);
    if (!failure.irrelevant.empty()) {
      std::string list;
      for (const std::string& one : failure.irrelevant) list += (list.empty() ? "" : "; ") + one;
      text += wrapped("does not matter: " + list, 2);
    }
    text += fmt::format("  again: {}\n", again(subject, *shown, subject.files.empty() ? "" : subject.files[i]));
  }
  text += "\n";
  for (const auto& [status, words] : {std::pair(LawStatus::not_applicable, "do not apply"),
                                      std::pair(LawStatus::expected_failure, "fail as expected")})
    if (const auto list = names(subject, status); !list.empty()) text += wrapped(fmt::format("{}: {}", words, list), 0);
  return text + fmt::format("{} passed, {} failed\n", subject.passed(), subject.failed());
}

std::string check_json(const std::vector<CheckedSubject>& subjects, const Context& context) {
  ordered_json json;
  json["schema"] = "kfstab.check/1";
  ordered_json where = ordered_json::object();
  for (const auto& [key, value] : context) where[key] = value;
  if (subjects.size() == 1) {
    json.update(subject_json(subjects.front()));
    json["context"] = where;
  } else {
    json["verdict"] =
        std::ranges::all_of(subjects, [](const CheckedSubject& s) { return s.all_well(); }) ? "pass" : "fail";
    json["context"] = where;
    json["checks"] = ordered_json::array();
    for (const CheckedSubject& subject : subjects) json["checks"].push_back(subject_json(subject));
  }
  return json.dump(2, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

std::string check_junit(const std::vector<CheckedSubject>& subjects) {
  std::string text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n";
  for (const CheckedSubject& subject : subjects) {
    const properties::CheckReport& r = subject.report;
    const auto skipped = static_cast<int>(r.laws.size()) - subject.passed() - subject.failed();
    text += fmt::format(
        "  <testsuite name=\"kfstab.{}\" tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"{}\" time=\"{:.3f}\">\n",
        xml(r.subject.name), r.laws.size() + (subject.fault ? 1 : 0), subject.failed(), subject.fault ? 1 : 0, skipped,
        r.seconds);
    for (std::size_t i = 0; i < r.laws.size(); ++i) {
      const LawOutcome& outcome = r.laws[i];
      text +=
          fmt::format("    <testcase classname=\"kfstab.{}\" name=\"{}\"", xml(r.subject.name), xml(outcome.law.id));
      const LawStatus status = subject.status(i);
      if (status == LawStatus::pass || status == LawStatus::expected_failure) {
        text += "/>\n";
      } else if (status == LawStatus::not_applicable) {
        text += "><skipped message=\"does not apply to what was tried\"/></testcase>\n";
      } else if (status == LawStatus::unexpected_pass) {
        text += "><failure message=\"holds, although it is expected to fail\"/></testcase>\n";
      } else {
        const std::string message =
            outcome.failure->finding.what.empty() ? std::string(outcome.law.statement) : outcome.failure->finding.what;
        text += fmt::format("><failure message=\"{}\">{}</failure></testcase>\n", xml(message),
                            xml(failure_text(subject, i)));
      }
    }
    if (subject.fault)
      text += fmt::format(
          "    <testcase classname=\"kfstab.{}\" name=\"runs\"><error type=\"{}\" message=\"{}\"/></testcase>\n",
          xml(r.subject.name), subject.fault->kind, xml(subject.fault->what));
    text += "  </testsuite>\n";
  }
  return text + "</testsuites>\n";
}

std::string check_markdown(const std::vector<CheckedSubject>& subjects) {
  std::string text;
  for (std::size_t s = 0; s < subjects.size(); ++s) {
    const CheckedSubject& subject = subjects[s];
    text += fmt::format("{}## {}: {}\n\n{}\n\n", s > 0 ? "\n" : "", subject.report.subject.name,
                        subject.all_well() ? "pass" : "**fail**", summary(subject));
    if (const auto said = refusals(subject.report); !said.empty()) text += said + "\n\n";
    if (subject.fault) text += fmt::format("**{}**: {}\n\n", subject.fault->kind, subject.fault->what);
    for (const properties::Diagnosis& one : subject.diagnosis) text += one.sentence() + "\n\n";
    if (!subject.candidates.empty()) {
      text += std::string(guess) + ":\n\n";
      for (const properties::Candidate& one : subject.candidates) text += fmt::format("- {}\n", one.sentence());
      text += "\n";
    }
    if (subject.fingerprint)
      text += fmt::format("{} {}.\n\n", subject.report.subject.name, sentence(*subject.fingerprint));
    reports::Table table{"", {"law", "verdict", "cases", "worst ratio"}, {}, {}};
    using enum reports::Alignment;
    table.alignment = {left, left, right, right};
    for (std::size_t i = 0; i < subject.report.laws.size(); ++i) {
      const LawOutcome& outcome = subject.report.laws[i];
      table.rows.push_back({std::string(outcome.law.id), name(subject.status(i)), fmt::format("{}", outcome.cases),
                            outcome.cases > 0 ? ratio_text(outcome.max_ratio) : ""});
    }
    text += reports::render_markdown(table);
    // What was tried is as much of a result as what held.
    reports::Table drawn{"", {"systems tried", "cases", "share"}, {}, {}};
    drawn.alignment = {left, right, right};
    for (const auto& [one, count] : subject.report.classes)
      drawn.rows.push_back(
          {one, fmt::format("{}", count), fmt::format("{:.0f} %", 100.0 * count / subject.report.cases)});
    if (!drawn.rows.empty()) text += "\n" + reports::render_markdown(drawn);
    for (std::size_t i = 0; i < subject.report.laws.size(); ++i)
      if (subject.status(i) == LawStatus::fail)
        text += fmt::format("\n### {}\n\n```\n{}```\n", subject.report.laws[i].law.id, failure_text(subject, i));
  }
  return text;
}

}  // namespace kfstab::experiments
