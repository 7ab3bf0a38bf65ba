#include <kfstab/properties/failure_message.hpp>

#include <fmt/format.h>

#include <kfstab/properties/system_file.hpp>

namespace kfstab::properties {

std::string failure_message(const LawOutcome& outcome) {
  const Failure& failure = *outcome.failure;
  std::string text = fmt::format("{}: {}\n", outcome.law.id, outcome.law.statement);
  if (!failure.finding.what.empty()) text += failure.finding.what + "\n";
  if (failure.finding.step >= 0) text += fmt::format("at step {}, ", failure.finding.step);
  text += fmt::format("ratio {:.3g}, where rounding explains {}\n", failure.finding.ratio, largest_ratio);
  text +=
      fmt::format("{}\nThe smallest system on which it shows:\n{}", outcome.law.failure, write_system(failure.system));
  for (const std::string& one : failure.irrelevant) text += fmt::format("# {}\n", one);
  return text;
}

}  // namespace kfstab::properties
