#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <functional>
#include <random>
#include <vector>

#include <kfstab/filters/slicot/slicot.h>
#include <kfstab/filters/matrix.hpp>

/// Calls of the routines as a Fortran program makes them: arrays with leading dimensions, workspace of the least
/// length. Whatever a routine may not read holds NaN, whatever it may not write is compared bit by bit.
namespace kfstab::test {

/// Random numbers from a stated seed, the same on every machine.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : engine_(seed) {}
  /// An integer of [low, high].
  int roll(int low, int high) { return low + static_cast<int>(engine_() % static_cast<std::uint64_t>(high - low + 1)); }
  /// Of [-1, 1).
  double number() { return static_cast<double>(engine_() >> 11) * 0x1p-52 - 1; }

 private:
  std::mt19937_64 engine_;
};

/// Which entries of an array a routine may touch.
using Pattern = std::function<bool(int i, int j)>;
inline const Pattern everything = [](int, int) { return true; };
inline const Pattern nothing = [](int, int) { return false; };
inline const Pattern lower = [](int i, int j) { return i >= j; };
inline const Pattern upper = [](int i, int j) { return i <= j; };

/// X(LD, *), NaN where nothing else was put.
struct Array {
  int rows = 0, cols = 0, ld = 1;
  std::vector<double> values;

  Array() = default;
  Array(int rows_, int cols_, int extra)
      : rows(rows_), cols(cols_), ld(std::max(1, rows_) + extra),
        values(static_cast<std::size_t>(ld) * static_cast<std::size_t>(std::max(1, cols_)), std::nan("")) {}

  double* data() { return values.data(); }
  double& operator()(int i, int j) { return values[static_cast<std::size_t>(i + j * ld)]; }
  double operator()(int i, int j) const { return values[static_cast<std::size_t>(i + j * ld)]; }

  Array& fill(const Pattern& where, const std::function<double(int, int)>& value) {
    for (int j = 0; j < cols; ++j)
      for (int i = 0; i < rows; ++i)
        if (where(i, j)) (*this)(i, j) = value(i, j);
    return *this;
  }

  /// The entries of the pattern, and zeros.
  Matrix<double> matrix(const Pattern& where = everything) const {
    Matrix<double> X = Matrix<double>::Zero(rows, cols);
    for (int j = 0; j < cols; ++j)
      for (int i = 0; i < rows; ++i)
        if (where(i, j)) X(i, j) = (*this)(i, j);
    return X;
  }
};

inline bool same_bits(const std::vector<double>& x, const std::vector<double>& y) {
  return x.size() == y.size() && (x.empty() || std::memcmp(x.data(), y.data(), x.size() * sizeof(double)) == 0);
}

/// Whether all but the pattern is what it was, bit by bit, the gaps between the columns too.
inline bool untouched_but(const Pattern& where, Array before, const Array& after) {
  for (int j = 0; j < before.cols; ++j)
    for (int i = 0; i < before.rows; ++i)
      if (where(i, j)) before(i, j) = after(i, j);
  return same_bits(before.values, after.values);
}

/// DWORK of the stated length, and a few numbers behind it that must stay.
struct Workspace {
  int length;
  std::vector<double> values;
  explicit Workspace(int length_ = 1)
      : length(length_), values(static_cast<std::size_t>(std::max(0, length_)) + 8, std::nan("")) {}
  bool kept_within() const {
    return std::all_of(values.end() - 8, values.end(), [](double x) { return x != x; });
  }
};

/// Random entries of size 1, those of a diagonal away from 0.
inline double entry(Dice& dice, int i, int j) {
  const double x = dice.number();
  return i == j ? x + (x < 0 ? -.5 : .5) : x;
}

inline Array random_array(Dice& dice, int rows, int cols, const Pattern& where = everything) {
  return Array(rows, cols, dice.roll(0, 2)).fill(where, [&](int i, int j) { return entry(dice, i, j); });
}

inline Array random_full(Dice& dice, int rows, int cols, const Pattern& where = everything) {
  return Array(rows, cols, dice.roll(0, 2)).fill(where, [&](int, int) { return dice.number(); });
}

/// One call of FB01QD or FB01RD.
struct CovarianceStep {
  bool condensed;
  char jobk = 'K', multbq = 'N';
  int n, m, p;
  Array S, A, B, Q, C, R, K;
  double tol = 0;
  std::vector<int> iwork;
  Workspace work;
  int info = 99;

  CovarianceStep(Dice& dice, bool condensed_, int n_, int m_, int p_)
      : condensed(condensed_), n(n_), m(m_), p(p_), S(random_array(dice, n, n, lower)),
        A(random_full(dice, n, n, pattern_A())), B(random_full(dice, n, m)), Q(random_array(dice, m, m, lower)),
        C(random_full(dice, p, n, pattern_C())), R(random_array(dice, p, p, lower)), K(n, p, dice.roll(0, 2)),
        iwork(static_cast<std::size_t>(std::max(1, p))), work(least_work()) {}

  Pattern pattern_A() const {
    return [this](int i, int j) { return !condensed || j <= i + p; };
  }
  Pattern pattern_C() const {
    return [this](int i, int j) { return !condensed || j <= i; };
  }
  int least_work() const {
    int least = std::max({1, n * (p + n) + 2 * p, n * (n + m + 2)});
    if (condensed) least = std::max(least, n * (p + n + 1));
    return jobk == 'N' || jobk == 'n' ? least : std::max({2, least, 3 * p});
  }
  template <class Routine>
  void run(Routine routine) {
    routine(&jobk, &multbq, &n, &m, &p, S.data(), &S.ld, A.data(), &A.ld, B.data(), &B.ld, Q.data(), &Q.ld, C.data(),
            &C.ld, R.data(), &R.ld, K.data(), &K.ld, &tol, iwork.data(), work.values.data(), &work.length, &info);
  }
  void run() { condensed ? run(fb01rd_) : run(fb01qd_); }
};

/// One call of FB01SD or FB01TD; B is A^{-1}B for the latter, and where multab is 'P'.
struct InformationStep {
  bool condensed;
  char jobx = 'X', multab, multrc = 'N';
  int n, m, p;
  Array T, A_inverse, B, R_inverse_root, C, Q_inverse_root, x, y, z, e;
  double tol = 0;
  std::vector<int> iwork;
  Workspace work;
  int info = 99;

  InformationStep(Dice& dice, bool condensed_, int n_, int m_, int p_)
      : condensed(condensed_), multab(condensed_ ? 'P' : 'N'), n(n_), m(m_), p(p_), T(random_array(dice, n, n, upper)),
        A_inverse(random_full(dice, n, n, pattern_A())), B(random_full(dice, n, m, pattern_B())),
        R_inverse_root(random_array(dice, p, p, upper)), C(random_full(dice, p, n)),
        Q_inverse_root(random_array(dice, m, m, upper)), x(random_full(dice, n, 1)), y(random_full(dice, p, 1)),
        z(random_full(dice, m, 1)), e(p, 1, 1), iwork(static_cast<std::size_t>(std::max(1, n))), work(least_work()) {}

  Pattern pattern_A() const {
    return [this](int i, int j) { return !condensed || i <= j + m; };
  }
  Pattern pattern_B() const {
    return [this](int i, int j) { return !condensed || i <= j; };
  }
  int least_work() const {
    const int least =
        std::max({1, n * (n + 2 * m) + 3 * m, (n + p) * (n + 1) + (condensed ? n + std::max(n - 1, m + 1) : 2 * n)});
    return jobx == 'N' || jobx == 'n' ? least : std::max({2, least, 3 * n});
  }
  template <class Dense, class Condensed>
  void run(Dense dense, Condensed hessenberg) {
    if (condensed)
      hessenberg(&jobx, &multrc, &n, &m, &p, T.data(), &T.ld, A_inverse.data(), &A_inverse.ld, B.data(), &B.ld,
                 R_inverse_root.data(), &R_inverse_root.ld, C.data(), &C.ld, Q_inverse_root.data(), &Q_inverse_root.ld,
                 x.data(), y.data(), z.data(), e.data(), &tol, iwork.data(), work.values.data(), &work.length, &info);
    else
      dense(&jobx, &multab, &multrc, &n, &m, &p, T.data(), &T.ld, A_inverse.data(), &A_inverse.ld, B.data(), &B.ld,
            R_inverse_root.data(), &R_inverse_root.ld, C.data(), &C.ld, Q_inverse_root.data(), &Q_inverse_root.ld,
            x.data(), y.data(), z.data(), e.data(), &tol, iwork.data(), work.values.data(), &work.length, &info);
  }
  void run() { run(fb01sd_, fb01td_); }
};

/// One call of FB01VD. P, Q, R are positive definite.
struct ConventionalStep {
  int n, m, l;
  Array P, A, B, C, Q, R, K;
  double tol = 0;
  std::vector<int> iwork;
  Workspace work;
  int info = 99;

  ConventionalStep(Dice& dice, int n_, int m_, int l_)
      : n(n_), m(m_), l(l_), P(covariance(dice, n)), A(random_full(dice, n, n)), B(random_full(dice, n, m)),
        C(random_full(dice, l, n)), Q(covariance(dice, m)), R(covariance(dice, l)), K(n, l, dice.roll(0, 2)),
        iwork(static_cast<std::size_t>(std::max(1, l))), work(least_work()) {}

  static Array covariance(Dice& dice, int size) {
    const Array root = random_array(dice, size, size);
    return Array(size, size, dice.roll(0, 2)).fill(upper, [&](int i, int j) {
      double s = 0;
      for (int k = 0; k < size; ++k) s += root(i, k) * root(j, k);
      return s;
    });
  }
  int least_work() const { return std::max({1, l * n + 3 * l, n * n, n * m}); }
  template <class Routine>
  void run(Routine routine) {
    routine(&n, &m, &l, P.data(), &P.ld, A.data(), &A.ld, B.data(), &B.ld, C.data(), &C.ld, Q.data(), &Q.ld, R.data(),
            &R.ld, K.data(), &K.ld, &tol, iwork.data(), work.values.data(), &work.length, &info);
  }
  void run() { run(fb01vd_); }
};

/// One call of MB04LD (m columns of A and B, r rows of B and C) or of its transpose, MB04KD.
struct Factorisation {
  bool transposed;
  char uplo;
  int n, m, r;
  Array L, A, B, C;
  Array tau;
  Workspace work;

  Factorisation(Dice& dice, bool transposed_, bool full, int n_, int m_, int r_)
      : transposed(transposed_), uplo(full          ? 'F'
                                      : transposed_ ? 'U'
                                                    : 'L'),
        n(n_), m(m_), r(r_), L(random_array(dice, n, n, pattern())),
        A(random_full(dice, flip(n, m), flip(m, n), pattern_A())), B(random_full(dice, flip(r, m), flip(m, r))),
        C(flip(r, n), flip(n, r), dice.roll(0, 2)), tau(n, 1, 2), work(n) {}

  int flip(int size, int size_transposed) const { return transposed ? size_transposed : size; }
  Pattern pattern() const { return transposed ? upper : lower; }
  Pattern pattern_A() const { return uplo == 'F' || uplo == 'f' ? everything : pattern(); }
  template <class Lq, class Qr>
  void run(Lq lq_routine, Qr qr_routine) {
    if (transposed)
      qr_routine(&uplo, &n, &r, &m, L.data(), &L.ld, A.data(), &A.ld, B.data(), &B.ld, C.data(), &C.ld, tau.data(),
                 work.values.data());
    else
      lq_routine(&uplo, &n, &m, &r, L.data(), &L.ld, A.data(), &A.ld, B.data(), &B.ld, C.data(), &C.ld, tau.data(),
                 work.values.data());
  }
  void run() { run(mb04ld_, mb04kd_); }
};

/// One call of TB01MD (B: n x m) or of TB01ND (B stands for C: m x n).
struct Reduction {
  bool observer;
  char jobu = 'I', uplo = 'U';
  int n, m;
  Array A, B, U;
  Workspace work;
  int info = 99;

  Reduction(Dice& dice, bool observer_, int n_, int m_)
      : observer(observer_), n(n_), m(m_), A(random_full(dice, n, n)),
        B(random_full(dice, observer_ ? m : n, observer_ ? n : m)), U(n, n, dice.roll(0, 2)),
        work(std::max({1, n, m - 1})) {}

  /// Entries that the form leaves other than 0.
  Pattern pattern_A() const {
    if (m == 0) return everything;
    return [this](int i, int j) { return uplo == 'U' ? i <= j + m : j <= i + m; };
  }
  Pattern pattern_B() const {
    if (!observer) return [this](int i, int j) { return uplo == 'U' ? i <= j : j <= i + m - n; };
    return [this](int i, int j) { return uplo == 'U' ? i <= j + m - n : j <= i; };
  }
  template <class Controller, class Observer>
  void run(Controller controller, Observer observe) {
    if (observer)
      observe(&jobu, &uplo, &n, &m, A.data(), &A.ld, B.data(), &B.ld, U.data(), &U.ld, work.values.data(), &info);
    else
      controller(&jobu, &uplo, &n, &m, A.data(), &A.ld, B.data(), &B.ld, U.data(), &U.ld, work.values.data(), &info);
  }
  void run() { run(tb01md_, tb01nd_); }
};

}  // namespace kfstab::test
