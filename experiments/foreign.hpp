#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <kfstab/filters/any_filter.hpp>
#include <kfstab/properties/protocol.hpp>
#include <kfstab/properties/subject.hpp>

/// Filters of somebody else's beside those of the registry: `run` and `compare` drive both in the same way.
namespace kfstab::experiments {

/// What a foreign filter answers instead of a step: it says no, or what it says is no answer.
struct ForeignStop : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// One foreign filter: what there is to say of it, and as many of it as are run at once.
class Foreign {
 public:
  /// Opens the first at once and runs it through one step of one state, to see whether it holds a root. Throws as `open`.
  /// taken: ids that are another's.
  Foreign(std::function<std::unique_ptr<properties::StepwiseFilter>()> open,
          const std::vector<std::string_view>& taken);
  ~Foreign();

  /// id: its name, as a word of letters, digits, '.' and '-'. It has no operations: nobody counted them.
  const Metadata& metadata() const { return metadata_; }
  /// u of its arithmetic.
  double roundoff() const { return roundoff_; }
  /// It has done what no filter may: from now on it is not run any more, and the command ends with exit code 4.
  void give_up(const properties::SubjectFault& fault);
  std::optional<std::string> fault() const;
  /// Why it does not apply to the system, or is not run any more; or nothing.
  std::optional<properties::Refusal> refusal(const properties::System& system) const;

  /// A filter that is driven as AnyFilter is: step k processes y_k. One that predicts first is asked, for step 0, to predict
  /// with A = I and no noise, so that it starts from x_{0|-1}, P_{0|-1} as all others do; its step k ends with k|k.
  ///
  /// Its steps throw ForeignStop, and SubjectFault. It must not outlive the Foreign.
  std::unique_ptr<AnyFilter<double>> make();

 private:
  class Driven;
  std::unique_ptr<properties::StepwiseFilter> take();

  std::function<std::unique_ptr<properties::StepwiseFilter>()> open_;
  properties::Traits traits_;
  std::string id_, title_;
  Metadata metadata_;
  double roundoff_;
  mutable std::mutex mutex_;
  std::optional<std::string> fault_;
  std::vector<std::unique_ptr<properties::StepwiseFilter>> idle_;
};

/// What --exec, --plugin and their limits say.
struct ForeignArguments {
  std::vector<std::string> commands;  ///< of the shell
  std::vector<std::string> plugins;   ///< shared libraries
  double timeout = 10;                ///< seconds until a step is answered
  double memory = 4096;               ///< MiB of address space; 0: no limit

  bool any() const { return !commands.empty() || !plugins.empty(); }
  properties::Limits limits() const;
};

/// What all of them have done that no filter may, told on stderr. Whether there was anything.
bool report_faults(const std::vector<std::unique_ptr<Foreign>>& foreign);

/// The filters that are meant, the commands first. Throws InputError and SubjectFault.
std::vector<std::unique_ptr<Foreign>> open_foreign(const ForeignArguments& arguments);

}  // namespace kfstab::experiments
