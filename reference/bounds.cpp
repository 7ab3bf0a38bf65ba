#include <kfstab/reference/bounds.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::reference {
namespace {

/// X Y X'. By lazy products: these are small, and Eigen's blocked ones take ten times as long to compile.
Matrix<double> congruence(const Matrix<double>& X, const Matrix<double>& Y) {
  const Matrix<double> XY = X.lazyProduct(Y);
  return XY.lazyProduct(X.transpose());
}

}  // namespace

FirstOrderBound::FirstOrderBound(const Metadata& metadata, Dimensions dimensions, double roundoff)
    : held_(metadata.holds), instant_(metadata.instant), gain_(metadata.gain),
      constant_(roundoff * static_cast<double>(dimensions.n + dimensions.m + dimensions.p)),
      W_(Matrix<double>::Zero(dimensions.n, dimensions.n)) {}

double FirstOrderBound::advance(const Truth& truth) {
  const bool filtered = instant_ == Instant::filtered;
  const Matrix<double>& F = filtered ? truth.filtered_closed_loop : truth.closed_loop;
  const Matrix<double>& P = filtered ? truth.P_filtered : truth.P_next;
  const Index n = P.rows();

  Matrix<double> local = Matrix<double>::Identity(n, n);
  switch (held_) {
    case Held::covariance:
      local *= constant_ * truth.innovation_condition / (truth.cosine * truth.cosine) * two_norm(P);
      break;
    case Held::covariance_factor:
    case Held::covariance_root:
    case Held::ud_factors:
      local *= 2 * constant_ * (1 + std::sqrt(truth.innovation_condition)) / truth.cosine * two_norm(P);
      break;
    case Held::information_factor:
      local = 2 * constant_ * truth.information_loss.amplification() * two_norm(truth.information) * P.lazyProduct(P);
      break;
    case Held::information:  // what is a root there is squared here
      local = 2 * constant_ * truth.information_loss.amplification() * truth.information_loss.amplification() *
              two_norm(truth.information) * P.lazyProduct(P);
      break;
    case Held::gain: return std::numeric_limits<double>::quiet_NaN();
  }
  W_before_ = W_;
  const Matrix<double> carried = congruence(F, W_) + local;
  W_ = (carried + carried.transpose()) / 2;
  const double size = P.norm();
  return size > 0 ? W_.norm() / size : 0;
}

double FirstOrderBound::gain(const Truth& truth, const Matrix<double>& C) const {
  const bool root = holds_root(held_);
  if (!root && held_ != Held::covariance) return std::numeric_limits<double>::quiet_NaN();
  const bool predictor = gain_ == GainKind::predictor;
  const Matrix<double>& K = predictor ? truth.predictor_gain : truth.filter_gain;
  const double size = K.norm();
  if (size == 0) return 0;

  const Index n = K.rows();
  const Matrix<double> F = predictor ? truth.closed_loop
                                     : Matrix<double>(Matrix<double>::Identity(n, n) - K.lazyProduct(C));
  const double re = two_norm(truth.innovation), re_inverse = truth.innovation_condition / re;  // of Re and Re^{-1}
  const auto root_of_trace = [this](const Matrix<double>& X) {
    return std::sqrt(std::max(0.0, congruence(X, W_before_).trace()));
  };
  const double carried = re_inverse * root_of_trace(F) * root_of_trace(C);

  double local = truth.innovation_condition * size;
  if (root) {
    const double left = std::sqrt(two_norm(predictor ? truth.P_next : truth.P_filtered));  // ||S+||, or ||S_{k|k}||
    const double whole = std::sqrt(two_norm(truth.P_predicted));
    const double inverse_cosine = predictor ? 1 / truth.cosine : left > 0 ? std::max(1.0, whole / left) : 1;
    const double G = std::sqrt(two_norm(congruence(K, truth.innovation)));
    local = std::sqrt(re_inverse) *
            ((std::sqrt(truth.innovation_condition) + inverse_cosine) * left + std::sqrt(re) * G);
  }
  return (carried + constant_ * local) / size;
}

Matrix<double> asymmetry_map(Asymmetry form, bool one_triangle_of_Re, const Matrix<double>& A, const Matrix<double>& KC,
                             const Matrix<double>& F, const Matrix<double>& D) {
  const Matrix<double> open = congruence(A, D);
  const Matrix<double> closed = congruence(F, D);
  const Matrix<double> measured = congruence(KC, D);
  Matrix<double> image = Matrix<double>::Zero(D.rows(), D.cols());
  switch (form) {
    case Asymmetry::none: break;
    case Asymmetry::textbook:
      image = closed;
      if (one_triangle_of_Re) image -= measured;
      break;
    case Asymmetry::mixed:
      image = 2 * open - closed;
      if (one_triangle_of_Re) image += measured;
      break;
    case Asymmetry::gain:
      image = open;
      if (!one_triangle_of_Re) image -= measured;
      break;
    case Asymmetry::cp:
    case Asymmetry::downdate:
      image = open;
      if (!one_triangle_of_Re) image += measured;
      break;
  }
  // Rounding leaves a symmetric part, which the map may let grow faster than any antisymmetric one.
  return (image - image.transpose()) / 2;
}

double asymmetry_growth(Asymmetry form, bool one_triangle_of_Re, const Matrix<double>& A, const Matrix<double>& KC,
                        const Matrix<double>& F) {
  // The map's matrix on the basis e_i e_j' - e_j e_i', i > j.
  const Index n = A.rows(), size = n * (n - 1) / 2;
  Matrix<double> map(size, size);
  Matrix<double> D = Matrix<double>::Zero(n, n);
  Index column = 0;
  for (Index j = 0; j < n; ++j)
    for (Index i = j + 1; i < n; ++i, ++column) {
      D(i, j) = 1;
      D(j, i) = -1;
      const Matrix<double> image = asymmetry_map(form, one_triangle_of_Re, A, KC, F, D);
      D(i, j) = D(j, i) = 0;
      Index row = 0;
      for (Index l = 0; l < n; ++l)
        for (Index k = l + 1; k < n; ++k, ++row) map(row, column) = (image(k, l) - image(l, k)) / 2;
    }
  return spectral_radius(map);
}

}  // namespace kfstab::reference
