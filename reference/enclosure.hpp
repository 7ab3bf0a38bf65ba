#pragma once

#include <cstdint>
#include <memory>

#include <kfstab/reference/error.hpp>
#include <kfstab/reference/rational.hpp>
#include <kfstab/reference/trajectory.hpp>

/// An oracle: bounds that are proven.
namespace kfstab::reference {

/// The filter in interval arithmetic: each number is a pair of numbers of 60 digits, the lower rounded down and the
/// upper rounded up in every operation, so that the true value lies between them whatever rounding does. By theory
/// (1.2) with (2.2) as the trajectory computes it, but Kf by an LDL' factorisation of Re and P_{k|k} as the sum of its
/// two terms.
///
/// Intervals know nothing of how rounding errors depend on one another, so they widen by some digits a step, and most
/// where k(Re) is large: for some tens of steps of small systems. Where nothing can be proven any more, it says so.
class Enclosure {
 public:
  explicit Enclosure(const ExactProblem& problem, std::shared_ptr<const ExactData> data = nullptr);
  ~Enclosure();
  Enclosure(Enclosure&&) noexcept;
  Enclosure& operator=(Enclosure&&) noexcept;

  /// Step k = 0, 1, 2 ... Throws ReferenceError, naming the step, if a pivot of Re is not proven positive.
  void advance();
  std::int64_t k() const;

  /// Whether every entry of X lies within its interval, the ends included; false if the shapes differ.
  bool contains(Quantity quantity, const Matrix<Rational>& X) const;
  /// The largest width of an interval, relative to the largest modulus of an entry of the quantity; 0 if all are 0.
  double width(Quantity quantity) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace kfstab::reference
