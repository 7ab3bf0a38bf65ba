#pragma once

#include <cmath>

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/state_space.hpp>
#include <kfstab/filters/step_report.hpp>
#include <kfstab/filters/structured_lq.hpp>
#include <kfstab/filters/symmetric_eigen.hpp>

namespace kfstab {

/// What is known of the initial covariance.
enum class InitialCovariance {
  any,         ///< P0 = S0 S0'; 0 is recognised
  stationary,  ///< P0 = A P0 A' + B Q B': the state is as it is after a long time without measurements
};

/// The square-root Chandrasekhar filter: it propagates the increments of P, not P,
///
///     P_{k+1} - P_k = L_k Sig L_k',   Sig = diag(I, -I),
///
///     [ Re_k^{1/2}  C L_k ]           [ Re_{k+1}^{1/2}  0       ]
///     [                   ]  Theta =  [                         ],   Theta (I + Sig) Theta' = I + Sig     theory (2.5)
///     [ G_k         A L_k ]           [ G_{k+1}         L_{k+1} ]
///
/// with G_k = A P_k C' Re_k^{-T/2} and K_k = G_k Re_k^{-1/2}. L has as many columns as P_1 - P_0 has rank, alpha, from
/// first to last, so a step costs O(alpha n^2). It is for time-invariant systems, and it forgets nothing: what
/// rounding does to G and Re stays in them for ever, and Theta is no orthogonal matrix: its condition number enlarges
/// errors. It is at its best where P0 = 0, with Theta orthogonal.
///
/// The first step factors P_1 - P_0, by its eigenvalues; those below n u (|P_1| + |P_0|), which is what they are known
/// to, count as 0. P0 = 0 gives L_0 = B Q^{1/2}, a stationary P0 L_0 = G_0 with Sig = -I, without rounding.
///
/// Rows are annihilated one by one: a reflector takes the + columns into the pivot, a second one the - columns into the
/// first of them, a hyperbolic rotation joins pivot and that, in its mixed form: the second column from the new first,
/// which loses less than both from the old.
///
/// Source: Morf, Sidhu, Kailath, IEEE TAC 19 (1974); Kailath, Sayed, Hassibi, Linear Estimation (2000), 11; the mixed
/// rotation: Bojanczyk, Brent, Van Dooren, De Hoog, SIAM J. Sci. Stat. Comput. 8 (1987).
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class ChandrasekharFilter {
 public:
  using Scalar = S;
  using Model = RootModel<S, N, M, P>;
  using Output = Vector<S, P>;
  using Input = Vector<S>;

  /// @param tolerance  least reciprocal condition number of Re^{1/2} that counts as regular; <= 0 means p^2 u
  explicit ChandrasekharFilter(Dimensions d = {N, M, P}, S tolerance = S(0))
      : tolerance_(tolerance > S(0) ? tolerance : default_tolerance<S>(d.p)),
        S0_(d.n, d.n), L_(d.n, d.n), next_L_(d.n, d.n), eigenvectors_(d.n, d.n), AS_BQ_(d.n, d.n + d.m), CL_(d.p, d.n),
        Re_root_(d.p, d.p), next_Re_root_(d.p, d.p), G_(d.n, d.p), next_G_(d.n, d.p), gain_(d.n, d.p),
        next_gain_(d.n, d.p), tau_(std::max(d.n, d.p)), x_(d.n), next_x_(d.n), innovation_(d.p), work_(d.p),
        sign_(d.p), column_(d.n + d.p) {
    system_.A.resize(d.n, d.n);
    system_.B.resize(d.n, d.m);
    system_.C.resize(d.p, d.n);
    system_.Q_root.resize(d.m, d.m);
    system_.R_root.resize(d.p, d.p);
    S0_.setZero();
    L_.setZero();
    Re_root_.setZero();
    G_.setZero();
    gain_.setZero();
    x_.setZero();
  }

  /// Takes S0 (n x n; the lower triangle is read), S0 S0' = P0, and x0 of the predicted state. That P0 is stationary is
  /// believed, not tested.
  template <class S0Type, class X0Type>
  void start(const S0Type& S0, const X0Type& x0, InitialCovariance kind = InitialCovariance::any) {
    copy_lower(S0, S0_);
    x_ = x0;
    gain_.setZero();
    kind_ = kind;
    started_ = arrays_given_ = false;
  }

  /// Takes the arrays of theory (2.5) themselves: Re_0^{1/2} (p x p; the lower triangle is read), G_0 (n x p), L_0 (n x
  /// alpha, alpha <= n), of whose columns the first `growing` have the sign +, and x0 of the predicted state. So a run is
  /// taken up where another was left, or disturbed.
  template <class ReType, class GType, class LType, class X0Type>
  void start(const ReType& Re_root, const GType& G, const LType& L, Index growing, const X0Type& x0) {
    copy_lower(Re_root, Re_root_);
    G_ = G;
    L_.leftCols(L.cols()) = L;
    plus_ = growing;
    minus_ = L.cols() - growing;
    x_ = x0;
    gain_.setZero();
    started_ = false;
    arrays_given_ = true;
  }

  /// One combined measurement and time update: x from k|k-1 to k+1|k, the increments from k to k+1.
  /// @param y  p, or null: no state is computed, and x stays what it was
  /// @param u  as many as D has columns, or null for none
  /// Statuses: time_varying_model (its numbers are not those of the first step), singular_innovation (of Re^{1/2}),
  /// hyperbolic_breakdown (Re of the next step would not be definite), non_finite_input, overflow.
  StepReport<S> step(const Model& model, const Output* y = nullptr, const Input* u = nullptr) {
    if (started_ && !model.same_system(system_)) return failed(Status::time_varying_model, S(0), model, y, u);
    if (!started_ && !begin(model)) return failed(Status::overflow, S(0), model, y, u);

    const S rcond = reciprocal_condition_triangular<Triangle::lower>(Re_root_, work_, sign_);
    if (!(rcond >= tolerance_)) return failed(Status::singular_innovation, rcond, model, y, u);
    next_gain_ = G_;
    solve_triangular_right<Triangle::lower, false>(Re_root_, next_gain_);
    if (y) {
      innovation_ = *y;
      innovation_.noalias() -= model.C.lazyProduct(x_);
      next_x_.noalias() = model.A.lazyProduct(x_);
      next_x_.noalias() += next_gain_.lazyProduct(innovation_);
      if (u) next_x_.noalias() += model.D.lazyProduct(*u);
    }
    S condition(1);
    if (!propagate(model, condition)) return failed(Status::hyperbolic_breakdown, rcond, model, y, u);
    if (!all_finite(next_Re_root_) || !all_finite(next_G_) || !all_finite(next_L_.leftCols(plus_ + minus_)) ||
        !all_finite(next_gain_) || (y && !all_finite(next_x_)))
      return failed(Status::overflow, rcond, model, y, u);

    if (!started_) keep(model);
    Re_root_.swap(next_Re_root_);
    G_.swap(next_G_);
    L_.swap(next_L_);
    gain_.swap(next_gain_);
    if (y) x_.swap(next_x_);
    rotation_condition_ = condition;
    return {Status::ok, rcond};
  }

  /// K_k = A P_k C' Re_k^{-1}, n x p, of the last step.
  const Matrix<S, N, P>& predictor_gain() const { return gain_; }
  const Vector<S, N>& state() const { return x_; }
  /// G_{k+1} = A P_{k+1} C' Re_{k+1}^{-T/2}, n x p, after step k.
  const Matrix<S, N, P>& normalised_gain() const { return G_; }
  /// Re_{k+1}^{1/2}, p x p, lower, after step k.
  const Matrix<S, P, P>& innovation_root() const { return Re_root_; }
  /// L_{k+1}, n x alpha, after step k: first the columns of P's growth, then those of its decrease.
  auto increment() const { return L_.leftCols(plus_ + minus_); }
  /// How many columns of increment() are of each sign; known from the first step on.
  Index growing() const { return plus_; }
  Index decreasing() const { return minus_; }
  /// A bound of k_2(Theta) of the last step: the product of (1 + |t|) / (1 - |t|) over its rotations. 1: orthogonal.
  const S& rotation_condition() const { return rotation_condition_; }

 private:
  static constexpr int columns = N == Dynamic || M == Dynamic ? Dynamic : N + M;

  void keep(const Model& model) {
    system_.A = model.A;
    system_.B = model.B;
    system_.C = model.C;
    system_.Q_root = model.Q_root;
    system_.R_root = model.R_root;
    started_ = true;
  }

  /// Re_0, G_0 and L_0 from S0, by one step of the square-root covariance filter; false if they are not finite.
  bool begin(const Model& model) {
    if (arrays_given_) return true;
    const Index n = S0_.rows(), m = model.B.cols();
    auto AS = AS_BQ_.leftCols(n);
    auto BQ = AS_BQ_.rightCols(m);
    multiply_lower(model.A, S0_, AS);
    model.process_noise_root(BQ);
    multiply_lower(model.C, S0_, CL_);
    copy_lower(model.R_root, Re_root_);
    structured_lq(Shape::full, Re_root_, CL_, AS, G_, tau_);
    if (!all_finite(Re_root_) || !all_finite(G_)) return false;

    plus_ = minus_ = 0;
    if (kind_ == InitialCovariance::stationary) {
      minus_ = compressed(G_);
      return true;
    }
    bool zero = true;
    for (Index j = 0; j < n; ++j)
      for (Index i = j; i < n; ++i) zero = zero && S0_(i, j) == S(0);
    if (zero) {
      plus_ = compressed(BQ);
      return all_finite(L_.leftCols(plus_));
    }
    lq(AS_BQ_, tau_);
    copy_lower(AS_BQ_, next_L_);
    // P_1 - P_0, and how large both are.
    S size(0);
    for (Index j = 0; j < n; ++j)
      for (Index i = j; i < n; ++i) {
        S sum(0), sum0(0);
        for (Index k = 0; k <= j; ++k) {
          sum += next_L_(i, k) * next_L_(j, k);
          sum0 += S0_(i, k) * S0_(j, k);
        }
        if (i == j) size += sum + sum0;
        L_(i, j) = L_(j, i) = sum - sum0;
      }
    if (!symmetric_eigen(L_, eigenvectors_)) return false;
    const S negligible = S(static_cast<int>(n)) * unit_roundoff<S>() * size;
    for (Index j = 0; j < n; ++j) column_(j) = L_(j, j);
    for (const int sign : {1, -1})
      for (Index j = 0; j < n; ++j) {
        const S lambda = sign > 0 ? column_(j) : S(-column_(j));
        if (!(lambda > negligible)) continue;
        using std::sqrt;
        const S root = sqrt(lambda);
        const Index to = plus_ + minus_;
        for (Index i = 0; i < n; ++i) L_(i, to) = eigenvectors_(i, j) * root;
        ++(sign > 0 ? plus_ : minus_);
      }
    return true;
  }

  /// L := X, or, if X has more than n columns, the lower L with L L' = X X'. Returns how many columns L has.
  template <class XType>
  Index compressed(const XType& X) {
    const Index n = X.rows(), c = X.cols();
    if (c <= n) {
      for (Index j = 0; j < c; ++j)
        for (Index i = 0; i < n; ++i) L_(i, j) = X(i, j);
      return c;
    }
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i) L_(i, j) = S(0);
    for (Index j = 0; j < c; ++j) annex(X, j);
    return n;
  }

  /// Lower L with L L' + x x' = L+ L+', x column j of X.
  template <class XType>
  void annex(const XType& X, Index j) {
    using std::sqrt;
    const Index n = L_.rows();
    for (Index i = 0; i < n; ++i) column_(i) = X(i, j);
    for (Index k = 0; k < n; ++k) {
      if (column_(k) == S(0)) continue;
      const auto reflector = make_reflector(S(L_(k, k)), 1, [&](Index) -> S& { return column_(k); });
      const S v = column_(k);
      L_(k, k) = reflector.beta;
      for (Index i = k + 1; i < n; ++i) {
        const S w = reflector.tau * (L_(i, k) + v * column_(i));
        L_(i, k) -= w;
        column_(i) -= w * v;
      }
    }
  }

  /// [Re^{1/2} C L; G A L] Theta into next_; false where a hyperbolic rotation does not exist.
  bool propagate(const Model& model, S& condition) {
    const Index n = G_.rows(), p = G_.cols(), alpha = plus_ + minus_;
    next_Re_root_ = Re_root_;
    next_G_ = G_;
    auto CL = CL_.leftCols(alpha);
    auto AL = next_L_.leftCols(alpha);
    CL.noalias() = model.C.lazyProduct(L_.leftCols(alpha));
    AL.noalias() = model.A.lazyProduct(L_.leftCols(alpha));

    // One reflector, or rotation, acts on every row below row i: those of Re, and those of G.
    for (Index i = 0; i < p; ++i) {
      const auto up = make_reflector(S(next_Re_root_(i, i)), plus_, [&](Index j) -> S& { return CL(i, j); });
      next_Re_root_(i, i) = up.beta;
      const auto take = [&](S& head, auto&& row) {
        S w = head;
        for (Index j = 0; j < plus_; ++j) w += row(j) * CL(i, j);
        w *= up.tau;
        head -= w;
        for (Index j = 0; j < plus_; ++j) row(j) -= w * CL(i, j);
      };
      for (Index k = i + 1; k < p; ++k) take(next_Re_root_(k, i), [&](Index j) -> S& { return CL(k, j); });
      for (Index k = 0; k < n; ++k) take(next_G_(k, i), [&](Index j) -> S& { return AL(k, j); });
      if (minus_ == 0) continue;

      const auto gather =
          make_reflector(S(CL(i, plus_)), minus_ - 1, [&](Index j) -> S& { return CL(i, plus_ + 1 + j); });
      const auto collect = [&](auto&& row) {
        S w = row(0);
        for (Index j = 1; j < minus_; ++j) w += row(j) * CL(i, plus_ + j);
        w *= gather.tau;
        row(0) -= w;
        for (Index j = 1; j < minus_; ++j) row(j) -= w * CL(i, plus_ + j);
      };
      for (Index k = i + 1; k < p; ++k) collect([&](Index j) -> S& { return CL(k, plus_ + j); });
      for (Index k = 0; k < n; ++k) collect([&](Index j) -> S& { return AL(k, plus_ + j); });

      const S pivot = next_Re_root_(i, i), t = gather.beta / pivot;
      using std::abs;
      using std::sqrt;
      if (gather.beta == S(0)) continue;
      if (!(abs(t) < S(1))) return false;
      condition *= (S(1) + abs(t)) / (S(1) - abs(t));
      const S c = sqrt(S((S(1) - t) * (S(1) + t)));
      next_Re_root_(i, i) = pivot * c;  // (pivot - t beta) / c
      const auto rotate = [&](S& first, S& second) {
        first = (first - t * second) / c;
        second = c * second - t * first;
      };
      for (Index k = i + 1; k < p; ++k) rotate(next_Re_root_(k, i), CL(k, plus_));
      for (Index k = 0; k < n; ++k) rotate(next_G_(k, i), AL(k, plus_));
    }
    return true;
  }

  S tolerance_;
  InitialCovariance kind_ = InitialCovariance::any;
  bool started_ = false, arrays_given_ = false;
  Index plus_ = 0, minus_ = 0;
  S rotation_condition_ = S(1);
  Model system_;
  Matrix<S, N, N> S0_, L_, next_L_, eigenvectors_;
  Matrix<S, N, columns> AS_BQ_;
  Matrix<S, P, N> CL_;
  Matrix<S, P, P> Re_root_, next_Re_root_;
  Matrix<S, N, P> G_, next_G_, gain_, next_gain_;
  Vector<S> tau_;
  Vector<S, N> x_, next_x_;
  Vector<S, P> innovation_, work_, sign_;
  Vector<S> column_;
};

}  // namespace kfstab
