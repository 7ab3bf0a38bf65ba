#pragma once

#include <memory>
#include <string>
#include <vector>

#include <kfstab/reference/trajectory.hpp>

namespace kfstab::reference::detail {

/// Two recursions at neighbouring rungs, behind doubles. One source instantiates a few of them.
class Lockstep {
 public:
  virtual ~Lockstep() = default;

  /// One step of both. True if at least `wanted` digits agree; else why() says what did not, and this pair is spent.
  /// Throws ReferenceError where no higher precision would help.
  virtual bool advance(const StepData* data, int wanted) = 0;
  virtual const std::string& why() const = 0;
  virtual void round_into(Truth& truth) const = 0;
  virtual Errors measure(const Metadata& metadata, const Step<double>& step) const = 0;
  virtual std::vector<Matrix<double>> expansion(Quantity quantity, int terms) const = 0;
  virtual int certified_digits() const = 0;
  virtual int lower_digits() const = 0;
  virtual int higher_digits() const = 0;
};

/// The ladder of precisions.
inline constexpr int rung_digits[] = {20, 50, 100, 200, 400, 800, 1600};
inline constexpr int pairs = 6;

/// The pair of rung_digits[pair] and rung_digits[pair + 1].
std::unique_ptr<Lockstep> make_lockstep(int pair, const AnyProblem<double>& problem, bool with_data);

std::unique_ptr<Lockstep> make_low_lockstep(int pair, const AnyProblem<double>& problem, bool with_data);
std::unique_ptr<Lockstep> make_high_lockstep(int pair, const AnyProblem<double>& problem, bool with_data);

}  // namespace kfstab::reference::detail
