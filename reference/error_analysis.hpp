#pragma once

#include <kfstab/reference/trajectory.hpp>

namespace kfstab::reference {

/// What a system does to an error, whichever filter made it: of one step, and of all steps so far. Stepped beside a
/// Trajectory, it holds one product and no history.
class ErrorAnalysis {
 public:
  /// Takes the step that the truth is of; steps must be given in order from the first.
  void advance(const Truth& truth);

  /// gamma_k = ||F_k||_2. One step multiplies a symmetric error of P by gamma^2 at most, theory (3.1); powers of it
  /// bound nothing tightly.
  double gamma() const { return gamma_; }
  /// log10 ||F_k ... F_0||_2^2, theory (3.4): the true amplification of an error of P_{0|-1} up to P_{k+1|k}, in the
  /// worst direction. Its logarithm, for it may be far beyond the range of double; -infinity where nothing is left.
  /// The product is formed in double, so it is right to about k u times the ratio of the product of the gammas and
  /// itself.
  double log10_amplification() const { return log10_amplification_; }
  /// k(Re^{1/2}) = s1/sp: what a form that holds S loses in one step, (4.2). One that holds P loses its square, (4.1).
  double innovation_condition() const { return innovation_condition_; }
  /// cos of the post-array: 1/cos is what a form that holds S loses, its square what one that holds P loses.
  double cosine() const { return cosine_; }
  /// What the step costs an information form, (4.3).
  const InformationLoss& information_loss() const { return information_loss_; }

 private:
  double gamma_ = 1, log10_amplification_ = 0, innovation_condition_ = 1, cosine_ = 1;
  InformationLoss information_loss_;
  Matrix<double> product_;  ///< F_k ... F_0 2^{-exponent_}, of size 1
  double exponent_ = 0;
};

}  // namespace kfstab::reference
