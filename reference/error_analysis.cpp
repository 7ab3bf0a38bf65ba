#include <kfstab/reference/error_analysis.hpp>

#include <cmath>
#include <limits>

#include <kfstab/reference/definiteness.hpp>

namespace kfstab::reference {

void ErrorAnalysis::advance(const Truth& truth) {
  const Matrix<double>& F = truth.closed_loop;
  gamma_ = two_norm(F);
  innovation_condition_ = std::sqrt(truth.innovation_condition);
  cosine_ = truth.cosine;
  information_loss_ = truth.information_loss;

  // F is scaled first: its largest entries times those of the product might not fit a double.
  const int size_of_F = gamma_ > 0 ? std::ilogb(gamma_) : 0;
  Matrix<double> scaled = F;
  for (Index j = 0; j < F.cols(); ++j)
    for (Index i = 0; i < F.rows(); ++i) scaled(i, j) = std::ldexp(F(i, j), -size_of_F);
  product_ = product_.size() == 0 ? scaled : Matrix<double>(scaled.lazyProduct(product_));
  exponent_ += size_of_F;
  const double size = two_norm(product_);
  if (!(size > 0)) {
    log10_amplification_ = -std::numeric_limits<double>::infinity();
    return;
  }
  log10_amplification_ = 2 * (std::log10(size) + exponent_ * std::log10(2.0));
  const int shift = std::ilogb(size);
  for (Index j = 0; j < product_.cols(); ++j)
    for (Index i = 0; i < product_.rows(); ++i) product_(i, j) = std::ldexp(product_(i, j), -shift);
  exponent_ += shift;
}

}  // namespace kfstab::reference
