#pragma once

#include <memory>
#include <string>
#include <vector>

#include <kfstab/reference/rational.hpp>
#include <kfstab/reference/rounded.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::reference::detail {

/// What a trajectory is of: doubles in one of three parametrisations, or exact numbers. And what a step brings it.
using Source = std::variant<const AnyProblem<double>*, const ExactProblem*>;
using SourceData = std::variant<const StepData*, const StepDataOf<Rational>*>;

inline bool is_information(const Source& source) {
  const auto* doubles = std::get_if<const AnyProblem<double>*>(&source);
  return doubles && parametrisation(**doubles) == Parametrisation::information;
}

/// f(problem), whichever Problem it is.
template <class F>
auto visit_source(const Source& source, F&& f) {
  if (const auto* rational = std::get_if<const ExactProblem*>(&source)) return f(**rational);
  return std::visit(f, *std::get<const AnyProblem<double>*>(source));
}


/// The truth and its witness (Form) at neighbouring rungs, behind doubles. One source instantiates a few of them.
class Lockstep {
 public:
  virtual ~Lockstep() = default;

  /// One step of both. True if as many digits agree as are requested; else why() says what did not, and this pair is spent.
  /// Throws ReferenceError where no higher precision would help.
  virtual bool advance(const SourceData& data, const Request& request) = 0;
  virtual const std::string& why() const = 0;
  virtual void round_into(Truth& truth) const = 0;
  virtual Errors measure(const Metadata& metadata, const Step<double>& step) const = 0;
  virtual Errors measure(const Metadata& metadata, const Step<Rounded>& step) const = 0;
  virtual Matrix<double> entry_errors(const Metadata& metadata, const Step<double>& step) const = 0;
  virtual std::vector<Matrix<double>> expansion(Quantity quantity, int terms) const = 0;
  virtual std::vector<std::vector<std::string>> decimals(Quantity quantity, int most_digits) const = 0;
  virtual int certified_digits() const = 0;
  virtual int certified_digits(Quantity quantity) const = 0;
  virtual int lower_digits() const = 0;
  virtual int higher_digits() const = 0;
};

/// The ladder of precisions: what fits into 3, 4, 6, 10, 20, 40 and 80 limbs of 64 bits.
inline constexpr int rung_digits[] = {57, 76, 115, 192, 384, 770, 1540};
inline constexpr int pairs = 6;
/// What a run is given to lose before it has to climb.
inline constexpr int spare_digits = 15;

/// The pair of rung_digits[pair] and rung_digits[pair + 1].
std::unique_ptr<Lockstep> make_lockstep(int pair, const Source& source, bool with_data);

std::unique_ptr<Lockstep> make_low_lockstep(int pair, const Source& source, bool with_data);
std::unique_ptr<Lockstep> make_high_lockstep(int pair, const Source& source, bool with_data);

}  // namespace kfstab::reference::detail
