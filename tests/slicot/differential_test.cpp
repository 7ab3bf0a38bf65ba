#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <iostream>
#include <limits>
#include <map>
#include <string>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

#include "slicot/fortran.hpp"
#include "tolerance.hpp"

// SLICOT 5.0 copies arrays onto themselves by LAPACK's DLACPY, a memcpy that AddressSanitizer would stop at.
extern "C" const char* __asan_default_suppressions() { return "interceptor_via_lib:liblapack\n"; }

/// Our routines against those of SLICOT itself, called alike, on random systems. Factors are compared as what they are
/// roots of, everything else entry by entry.
namespace kfstab::test {
namespace {

constexpr int systems = 4000;  // a routine
constexpr double unit = 0x1p-53;

template <class... Arguments>
auto with_lengths(void (*)(Arguments...)) -> void (*)(Arguments..., std::size_t, std::size_t, std::size_t);

/// SLICOT's shared library. It has the same symbols as ours, which the linker does not export from a program: so each
/// calls its own.
class Peer {
 public:
  Peer() : library_(dlopen("libslicot.so.0", RTLD_NOW | RTLD_LOCAL)) {}

  bool found() const { return library_ != nullptr; }
  template <class Routine>
  auto routine(Routine* like, const char* symbol) const {
    const auto call = reinterpret_cast<decltype(with_lengths(like))>(dlsym(library_, symbol));
    return [call](auto... arguments) { call(arguments..., 1, 1, 1); };
  }

 private:
  void* library_;
};

const Peer& peer() {
  static const Peer slicot;
  return slicot;
}

#define KFSTAB_NEEDS_PEER() \
  if (!peer().found())      \
  GTEST_SKIP() << "libslicot.so.0 is not installed (Debian: libslicot-dev): nothing to compare with"

void run_peer(CovarianceStep& call) {
  if (call.condensed)
    call.run(peer().routine(fb01rd_, "fb01rd_"));
  else
    call.run(peer().routine(fb01qd_, "fb01qd_"));
}
void run_peer(InformationStep& call) {
  call.run(peer().routine(fb01sd_, "fb01sd_"), peer().routine(fb01td_, "fb01td_"));
}
void run_peer(ConventionalStep& call) { call.run(peer().routine(fb01vd_, "fb01vd_")); }
void run_peer(Factorisation& call) { call.run(peer().routine(mb04ld_, "mb04ld_"), peer().routine(mb04kd_, "mb04kd_")); }
void run_peer(Reduction& call) { call.run(peer().routine(tb01md_, "tb01md_"), peer().routine(tb01nd_, "tb01nd_")); }

/// The worst ratios, by output, and counts; printed at the end.
class Findings {
 public:
  explicit Findings(std::string routine) : routine_(std::move(routine)) {}
  ~Findings() {
    std::cout << routine_ << ": " << counts_["systems"] << " systems";
    for (const auto& [what, count] : counts_)
      if (what != "systems") std::cout << ", " << count << ' ' << what;
    std::cout << "; worst ratios";
    for (const auto& [output, ratio] : worst_) std::cout << ' ' << output << ' ' << ratio;
    std::cout << std::endl;
  }
  void count(const std::string& what) { ++counts_[what]; }
  int counted(const std::string& what) { return counts_[what]; }

  /// difference / (u size scale), scale = kappa times the size of what is compared.
  void expect(const std::string& output, double difference, int size, double scale) {
    const double ratio = difference == 0 ? 0 : difference / (unit * size * scale);
    double& worst = worst_[output];
    if (!(ratio <= worst)) worst = ratio;
    EXPECT_LE(ratio, threshold) << output << ": difference " << difference << ", scale " << scale;
  }

 private:
  std::string routine_;
  std::map<std::string, int> counts_;
  std::map<std::string, double> worst_;
};

Matrix<double> absolute(const Matrix<double>& X) { return X.cwiseAbs(); }
Matrix<double> product(const Matrix<double>& X, const Matrix<double>& Y) { return X.lazyProduct(Y); }
Matrix<double> beside(const Matrix<double>& X, const Matrix<double>& Y) {
  Matrix<double> both(X.rows(), X.cols() + Y.cols());
  both << X, Y;
  return both;
}
Matrix<double> above(const Matrix<double>& X, const Matrix<double>& Y) {
  Matrix<double> both(X.rows() + Y.rows(), X.cols());
  both << X, Y;
  return both;
}

/// X X', in long double: its own rounding does not count.
Matrix<long double> gram(const Matrix<double>& X) {
  const Matrix<long double> wide = X.cast<long double>();
  return wide.lazyProduct(wide.transpose());
}

/// Largest of |x_ij - y_ij| / (s_i s_j).
double scaled_difference(const Matrix<long double>& X, const Matrix<long double>& Y, const Vector<double>& s) {
  double worst = 0;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      const double difference = static_cast<double>(std::abs(X(i, j) - Y(i, j)));
      if (difference == 0) continue;
      const double scaled = difference / (s(i) * s(j));
      if (!(scaled <= worst)) worst = scaled;
    }
  return worst;
}

double difference(const Matrix<double>& X, const Matrix<double>& Y) { return (X - Y).norm(); }

/// The norm of L^{-1}, L lower triangular; infinite if L is singular.
double inverse_norm(const Matrix<double>& L) {
  if (L.rows() == 0) return 0;
  if ((L.diagonal().array() == 0).any()) return std::numeric_limits<double>::infinity();
  const Matrix<double> inverse = L.triangularView<Eigen::Lower>().solve(Matrix<double>::Identity(L.rows(), L.rows()));
  const double norm = inverse.norm();
  return norm == norm ? norm : std::numeric_limits<double>::infinity();
}

/// |L| |L^{-1}|, infinite for a singular L, 0 where there is none.
double condition(const Matrix<double>& L) {
  const double inverse = inverse_norm(L);
  return inverse <= std::numeric_limits<double>::max() ? L.norm() * inverse : inverse;
}

/// What rounding does to S S', S what orthogonal transformations leave of an array: S is lost to k times the array's
/// norm, theory (4), and S S' to twice |S| that, or its square where nothing is left.
double loss_of_square(double kappa, double root, double array, int size) {
  const double loss = (1 + kappa) * array;
  return array == 0 ? 0 : loss * (root + unit * size * loss);
}

double one_norm_rcond(const Matrix<double>& L) {
  if (L.rows() == 0) return 1;
  if ((L.diagonal().array() == 0).any()) return 0;
  const Matrix<double> inverse = L.triangularView<Eigen::Lower>().solve(Matrix<double>::Identity(L.rows(), L.rows()));
  return 1 / (L.cwiseAbs().colwise().sum().maxCoeff() * inverse.cwiseAbs().colwise().sum().maxCoeff());
}

/// Where the signs of two diagonals differ, column j of X changes its sign.
Matrix<double> aligned(Matrix<double> X, const Matrix<double>& ours, const Matrix<double>& theirs) {
  for (Index j = 0; j < X.cols(); ++j)
    if (ours(j, j) * theirs(j, j) < 0) X.col(j) *= -1;
  return X;
}

bool same_signs(const Matrix<double>& X, const Matrix<double>& Y) {
  return (X.diagonal().array() * Y.diagonal().array() > 0).all();
}

/// The same outcome, unless the matrix is as nearly singular as the tolerance says, within a factor of ten.
bool same_outcome(Findings& findings, int ours, int theirs, double rcond, double tol, int order) {
  const double tolerance = tol > 0 ? tol : order * order * unit;
  if (ours != theirs) {
    findings.count("borderline");
    EXPECT_TRUE(rcond < 10 * tolerance && rcond > tolerance / 10)
        << "INFO = " << ours << " and " << theirs << ", rcond " << rcond << ", tolerance " << tolerance;
    return false;
  }
  if (ours != 0) findings.count("INFO > 0");
  return true;
}

/// Both are estimates, of matrices that differ by rounding: rcond by `rounding`.
void expect_rcond(double ours, double theirs, double rounding = 0) {
  EXPECT_LE(ours, 3 * theirs + rounding);
  EXPECT_LE(theirs, 3 * ours + rounding);
}

/// Most systems are small, some have 40 states; p and m are anything from 0 to beyond n.
struct Sizes {
  int n, m, p;
  explicit Sizes(Dice& dice) {
    const int kind = dice.roll(1, 100);
    n = kind <= 3 ? 0 : kind <= 80 ? dice.roll(1, 8) : kind <= 97 ? dice.roll(9, 20) : dice.roll(21, 40);
    m = dice.roll(0, 4) == 0 ? 0 : dice.roll(0, n + 2);
    const int outputs = dice.roll(1, 10);
    p = outputs == 1 ? n : outputs == 2 ? n + dice.roll(1, 3) : outputs == 3 ? 0 : dice.roll(0, n);
  }
  int size() const { return n + m + p; }
};

double power_of_ten(Dice& dice, int least, int most) { return std::pow(10., dice.roll(least, most)); }

/// Zeros where entries may be, now and then: a column of A, all columns of B alike, an output that sees nothing.
void degenerate(Dice& dice, Array& A, Array& B) {
  if (dice.roll(1, 4) == 1 && A.cols > 0) {
    const int j = dice.roll(0, A.cols - 1);
    for (int i = 0; i < A.rows; ++i)
      if (A(i, j) == A(i, j)) A(i, j) = 0;
  }
  if (dice.roll(1, 4) == 1)
    for (int j = 1; j < B.cols; ++j)
      for (int i = 0; i < B.rows; ++i)
        if (B(i, j) == B(i, j) && B(i, 0) == B(i, 0)) B(i, j) = 2 * B(i, 0);
}

double random_tolerance(Dice& dice) { return dice.roll(1, 3) > 1 ? 0 : power_of_ten(dice, -14, -1); }

// ---- FB01QD, FB01RD

void compare(Findings& findings, const CovarianceStep& given, const CovarianceStep& ours,
             const CovarianceStep& theirs) {
  const int size = given.n + given.m + given.p;
  for (const CovarianceStep* call : {&ours, &theirs}) {
    EXPECT_TRUE(untouched_but(lower, given.S, call->S));
    EXPECT_TRUE(untouched_but(lower, given.R, call->R));
    EXPECT_TRUE(untouched_but(everything, given.K, call->K));
    EXPECT_TRUE(call->work.kept_within());
  }
  if (given.n == 0) {
    EXPECT_EQ(ours.info, theirs.info);
    EXPECT_EQ(ours.R.matrix(lower), theirs.R.matrix(lower));
    return;
  }
  const Matrix<double> Re_root = ours.R.matrix(lower), peer_Re_root = theirs.R.matrix(lower);
  const double rcond = one_norm_rcond(Re_root);
  if (!same_outcome(findings, ours.info, theirs.info, rcond, given.tol, given.p)) return;

  // The pre-array, without the cancellation in its products: what rounding is relative to.
  const Matrix<double> S = absolute(given.S.matrix(lower)), B = absolute(given.B.matrix());
  const Matrix<double> top =
      beside(absolute(given.R.matrix(lower)), product(absolute(given.C.matrix(given.pattern_C())), S));
  const Matrix<double> bottom = beside(product(absolute(given.A.matrix(given.pattern_A())), S),
                                       given.multbq == 'P' ? B : product(B, absolute(given.Q.matrix(lower))));

  const Matrix<double> root = ours.S.matrix(lower), peer_root = theirs.S.matrix(lower);
  const Matrix<double> K = ours.K.matrix(), peer_K = theirs.K.matrix();
  const bool divided = given.jobk == 'K' && ours.info == 0;
  const Matrix<double> G = divided ? product(K, Re_root) : K, peer_G = divided ? product(peer_K, peer_Re_root) : peer_K;

  // The Gram matrix of the post-array is that of the pre-array: k = 1. K times Re^{1/2} has rounded once more.
  Vector<double> rows(given.p + given.n);
  rows << top.rowwise().norm(), bottom.rowwise().norm();
  if (divided) rows.tail(given.n) += product(absolute(K), absolute(Re_root)).rowwise().norm();
  const auto post = [&](const Matrix<double>& R_, const Matrix<double>& G_, const Matrix<double>& S_) {
    return above(beside(R_, Matrix<double>::Zero(given.p, given.n)), beside(G_, S_));
  };
  findings.expect("array",
                  scaled_difference(gram(post(Re_root, G, root)), gram(post(peer_Re_root, peer_G, peer_root)), rows),
                  size, 1);

  const double inverse = inverse_norm(Re_root), kappa = condition(Re_root);
  findings.expect("P", static_cast<double>((gram(root) - gram(peer_root)).norm()), size,
                  loss_of_square(kappa, root.norm(), bottom.norm(), size));
  if (divided) {
    // Least squares: K minimises the distance of the lower rows from K times the upper ones, and S+ is what remains.
    findings.expect("K", difference(K, peer_K), size,
                    inverse * (bottom.norm() + K.norm() * top.norm()) + root.norm() * top.norm() * inverse * inverse);
    expect_rcond(ours.work.values[1], theirs.work.values[1]);
  } else {
    findings.expect("G", difference(G, aligned(peer_G, Re_root, peer_Re_root)), size, (1 + kappa) * bottom.norm());
  }
}

void covariance_steps(const char* routine, bool condensed, int steps) {
  Findings findings(routine);
  Dice dice(condensed ? 101 : 100);
  while (findings.counted("systems") < systems) {
    const Sizes size(dice);
    SCOPED_TRACE("system " + std::to_string(findings.counted("systems")) + " n=" + std::to_string(size.n) +
                 " m=" + std::to_string(size.m) + " p=" + std::to_string(size.p));
    Array S;
    for (int step = 0; step < steps; ++step) {
      CovarianceStep given(dice, condensed, size.n, size.m, size.p);
      if (step > 0) given.S = S;  // the same for both, so that each step is measured by itself
      given.jobk = "KKKN"[dice.roll(0, 3)];
      given.multbq = "NP"[dice.roll(0, 1)];
      given.tol = random_tolerance(dice);
      degenerate(dice, given.A, given.B);
      if (dice.roll(1, 3) == 1) {  // nearly or wholly singular Re
        const double small = dice.roll(1, 5) == 1 ? 0 : power_of_ten(dice, -18, -1);
        given.R.fill(lower, [&](int i, int j) { return small * given.R(i, j); });
        for (int i = 1; i < given.p; ++i)
          for (int j = 0; j < given.n; ++j)
            if (given.pattern_C()(i - 1, j)) given.C(i, j) = given.C(i - 1, j) + small * given.C(i, j);
      }
      if (dice.roll(1, 8) == 1 && given.n > 0) given.S.fill(lower, [](int, int) { return 0; });
      given.K.fill(everything, [](int, int) { return 0; });  // SLICOT leaves some of it alone, see below
      given.work = Workspace(given.least_work());
      CovarianceStep ours = given, theirs = given;
      ours.run();
      run_peer(theirs);
      compare(findings, given, ours, theirs);
      findings.count("steps");
      S = ours.S;
      if (::testing::Test::HasFailure()) return;
    }
    findings.count("systems");
  }
}

// ---- FB01SD, FB01TD

void compare(Findings& findings, const InformationStep& given, const InformationStep& ours,
             const InformationStep& theirs) {
  const int size = given.n + given.m + given.p;
  for (const InformationStep* call : {&ours, &theirs}) {
    EXPECT_TRUE(untouched_but(upper, given.T, call->T));
    EXPECT_TRUE(untouched_but(upper, given.Q_inverse_root, call->Q_inverse_root));
    EXPECT_TRUE(call->work.kept_within());
  }
  const Matrix<double> T = ours.T.matrix(upper).transpose(), peer_T = theirs.T.matrix(upper).transpose();
  if (!same_outcome(findings, ours.info, theirs.info, one_norm_rcond(ours.T.matrix(upper).transpose()), given.tol,
                    given.n))
    return;

  // The pre-array, without the cancellation in its products. Its first block column, its second, its right-hand side.
  const Matrix<double> T0 = given.T.matrix(upper), A = given.A_inverse.matrix(given.pattern_A());
  Matrix<double> B = given.B.matrix(given.pattern_B()), absolute_B = absolute(B);
  if (given.multab == 'N') {
    absolute_B = product(absolute(A), absolute_B);
    B = product(A, B);
  }
  const Matrix<double> Q = given.Q_inverse_root.matrix(upper), C = given.C.matrix();
  const Matrix<double> R =
      given.multrc == 'P' ? Matrix<double>::Identity(given.p, given.p) : given.R_inverse_root.matrix(upper);
  const Matrix<double> none_B = Matrix<double>::Zero(given.p, given.m), none_A = Matrix<double>::Zero(given.m, given.n);
  const Matrix<double> first = above(above(absolute(Q), product(absolute(T0), absolute_B)), none_B);
  const Matrix<double> second = above(product(absolute(T0), absolute(A)), product(absolute(R), absolute(C)));
  const Matrix<double> right =
      above(above(product(absolute(Q), absolute(given.z.matrix())), product(absolute(T0), absolute(given.x.matrix()))),
            absolute(given.y.matrix()));

  const Matrix<double> Qe = ours.Q_inverse_root.matrix(upper).transpose(),
                       peer_Qe = theirs.Q_inverse_root.matrix(upper).transpose();
  findings.expect("Qe", scaled_difference(gram(Qe), gram(peer_Qe), first.colwise().norm().transpose()), size, 1);
  const double kappa = condition(Qe);
  findings.expect("T'T", static_cast<double>((gram(T) - gram(peer_T)).norm()), size,
                  loss_of_square(kappa, T.norm(), second.norm(), size));

  const bool solved = given.jobx == 'X' && ours.info == 0;
  const Matrix<double> x = ours.x.matrix(), peer_x = theirs.x.matrix(), e = ours.e.matrix(), peer_e = theirs.e.matrix();
  // T'xi is what the right-hand side says of x, after the noise has been taken out of both.
  if (!solved)
    findings.expect("T'xi", difference(product(T, x), product(peer_T, peer_x)), size,
                    (1 + kappa) * second.norm() * right.norm());

  // Least squares with the whole array: k, and k^2 for the residual, of all of it.
  const Matrix<double> whole =
      beside(above(above(Q, product(T0, B)), none_B), above(above(none_A, product(T0, A)), product(R, C)));
  if (whole.cols() == 0) return;
  const Eigen::HouseholderQR<Matrix<double>> qr(whole);
  const Matrix<double> factor = qr.matrixQR().topRows(whole.cols()).triangularView<Eigen::Upper>().transpose();
  const double norm = beside(first, above(none_A, second)).norm(), inverse = inverse_norm(factor), k = norm * inverse;
  if (same_signs(Qe, peer_Qe) && same_signs(T, peer_T)) {
    findings.expect("e", difference(e, peer_e), size, k * right.norm());
  } else {
    findings.count("other signs");
    findings.expect("|e|", std::abs(e.norm() - peer_e.norm()), size, k * right.norm());
  }
  if (solved) {
    // All unknowns, w too.
    const Matrix<double> data =
        above(above(product(Q, given.z.matrix()), product(T0, given.x.matrix())), given.y.matrix());
    const double unknowns = qr.solve(data).norm();
    findings.expect("x", difference(x, peer_x), size, k * (unknowns + inverse * e.norm()) + inverse * right.norm());
    expect_rcond(ours.work.values[1], theirs.work.values[1]);
  }
}

void information_steps(const char* routine, bool condensed, int steps) {
  Findings findings(routine);
  Dice dice(condensed ? 201 : 200);
  while (findings.counted("systems") < systems) {
    const Sizes size(dice);
    SCOPED_TRACE("system " + std::to_string(findings.counted("systems")) + " n=" + std::to_string(size.n) +
                 " m=" + std::to_string(size.m) + " p=" + std::to_string(size.p));
    Array T;
    for (int step = 0; step < steps; ++step) {
      InformationStep given(dice, condensed, size.n, size.m, size.p);
      if (step > 0) given.T = T;
      given.jobx = "XXXN"[dice.roll(0, 3)];
      if (!condensed) given.multab = "NP"[dice.roll(0, 1)];
      given.multrc = "NP"[dice.roll(0, 1)];
      given.tol = random_tolerance(dice);
      degenerate(dice, given.A_inverse, given.B);
      if (dice.roll(1, 4) == 1) {  // a weak prior, and outputs that say much the same
        const double small = dice.roll(1, 5) == 1 ? 0 : power_of_ten(dice, -18, -1);
        given.T.fill(upper, [&](int i, int j) { return small * given.T(i, j); });
        for (int i = 1; i < given.p; ++i)
          for (int j = 0; j < given.n; ++j) given.C(i, j) = given.C(0, j) + small * given.C(i, j);
      }
      given.work = Workspace(given.least_work());
      InformationStep ours = given, theirs = given;
      ours.run();
      run_peer(theirs);
      compare(findings, given, ours, theirs);
      findings.count("steps");
      T = ours.T;
      if (::testing::Test::HasFailure()) return;
    }
    findings.count("systems");
  }
}

// ---- FB01VD

Matrix<double> symmetric(const Array& X) {
  const Matrix<double> triangle = X.matrix(upper);
  return triangle.selfadjointView<Eigen::Upper>();
}

void compare(Findings& findings, const ConventionalStep& given, const ConventionalStep& ours,
             const ConventionalStep& theirs) {
  const int size = given.n + given.m + given.l;
  for (const ConventionalStep* call : {&ours, &theirs}) {
    // SLICOT leaves its scratch in the other triangle of P. Of Q it halves and doubles the diagonal.
    EXPECT_TRUE(untouched_but(call == &ours ? upper : everything, given.P, call->P));
    EXPECT_TRUE(same_bits(given.Q.values, call->Q.values));
    EXPECT_TRUE(untouched_but(call == &theirs || call->info == 0 ? everything : upper, given.R, call->R));
    EXPECT_TRUE(call->work.kept_within());
  }
  const Matrix<double> A = absolute(given.A.matrix()), B = absolute(given.B.matrix()), C = absolute(given.C.matrix());
  const Matrix<double> P = absolute(symmetric(given.P)), Q = absolute(symmetric(given.Q)), CP = product(C, P);
  const Matrix<double> Re = absolute(symmetric(given.R)) + product(CP, C.transpose());

  if (ours.info != theirs.info || (ours.info > 0 && ours.info <= given.l)) {
    // Whether a minor is positive, and whether Re is regular, is decided by its last digits.
    Matrix<double> exact = symmetric(given.R);
    exact += product(product(given.C.matrix(), symmetric(given.P)), given.C.matrix().transpose());
    const Eigen::SelfAdjointEigenSolver<Matrix<double>> eigen(exact, Eigen::EigenvaluesOnly);
    const double tolerance = given.tol > 0 ? given.tol : given.l * given.l * unit;
    const double rcond = eigen.eigenvalues()(0) / eigen.eigenvalues().cwiseAbs().maxCoeff();
    if (ours.info != theirs.info) {
      findings.count("borderline");
      const double blur = std::max(10 * tolerance, threshold * size * unit * Re.norm() / exact.norm()) * given.l;
      EXPECT_LE(std::abs(rcond), blur) << "INFO = " << ours.info << " and " << theirs.info;
      return;
    }
  }
  const bool done = ours.info == 0, factored = done || ours.info == given.l + 1;
  findings.count(done ? "INFO = 0" : factored ? "INFO = L + 1" : "INFO = k");
  const Matrix<double> K = ours.K.matrix(), peer_K = theirs.K.matrix();
  if (!done) {
    EXPECT_TRUE(same_bits(given.P.values, ours.P.values));
    findings.expect("PC'", difference(K, peer_K), size, CP.norm());
  }
  if (!factored) return;
  const Matrix<double> U = ours.R.matrix(upper).transpose(), peer_U = theirs.R.matrix(upper).transpose();
  findings.expect("U'U", static_cast<double>((gram(U) - gram(peer_U)).norm()), size, Re.norm());
  const double blur = given.l == 0 ? 0 : threshold * unit * size * Re.norm() / product(U, U.transpose()).norm();
  expect_rcond(ours.work.values[0], theirs.work.values[0], blur);
  if (!done) return;
  EXPECT_EQ(ours.R.matrix(), ours.R.matrix(upper));
  EXPECT_EQ(theirs.R.matrix(), theirs.R.matrix(upper));
  const double inverse = std::pow(inverse_norm(U), 2), dK = inverse * (CP.norm() + K.norm() * Re.norm());
  findings.expect("K", difference(K, peer_K), size, dK);
  // P_{k|k} = P - K C P, K as computed.
  const double filtered = P.norm() + 2 * K.norm() * CP.norm() + K.squaredNorm() * Re.norm() + dK * CP.norm();
  findings.expect("P", difference(symmetric(ours.P), symmetric(theirs.P)), size,
                  A.squaredNorm() * filtered + product(product(B, Q), B.transpose()).norm());
}

// ---- MB04LD, MB04KD

void compare(Findings& findings, const Factorisation& given, const Factorisation& ours, const Factorisation& theirs) {
  const int size = given.n + given.m + given.r;
  for (const Factorisation* call : {&ours, &theirs}) {
    EXPECT_TRUE(untouched_but(given.pattern(), given.L, call->L));
    EXPECT_TRUE(untouched_but(given.pattern_A(), given.A, call->A));
    EXPECT_TRUE(untouched_but(everything, given.B, call->B));
    EXPECT_TRUE(untouched_but(everything, given.C, call->C));
  }
  const auto standing = [&](const Matrix<double>& X) { return given.transposed ? Matrix<double>(X.transpose()) : X; };
  const auto L = [&](const Factorisation& call) { return standing(call.L.matrix(given.pattern())); };
  const auto A = [&](const Factorisation& call) { return standing(call.A.matrix(given.pattern_A())); };
  const auto B = [&](const Factorisation& call) { return standing(call.B.matrix()); };
  const auto C = [&](const Factorisation& call) { return standing(call.C.matrix()); };
  const Matrix<double> top = beside(L(given), A(given));
  Vector<double> rows(given.n + given.r);
  rows << top.rowwise().norm(), B(given).rowwise().norm();
  const auto post = [&](const Factorisation& call) {
    return above(beside(L(call), Matrix<double>::Zero(given.n, given.m)), beside(C(call), B(call)));
  };
  findings.expect("array", scaled_difference(gram(post(ours)), gram(post(theirs)), rows), size, 1);
  if (!same_signs(L(ours), L(theirs))) {
    findings.count("other signs");
    return;
  }
  const double kappa = 1 + top.norm() * inverse_norm(L(ours));
  findings.expect("L", difference(L(ours), L(theirs)), size, kappa * top.norm());
  findings.expect("v", difference(A(ours), A(theirs)), size, kappa);
  findings.expect("tau", difference(ours.tau.matrix(), theirs.tau.matrix()), size, kappa);
  findings.expect("C", difference(C(ours), C(theirs)), size, kappa * B(given).norm());
  findings.expect("D", difference(B(ours), B(theirs)), size, kappa * B(given).norm());
}

void factorisations(const char* routine, bool transposed) {
  Findings findings(routine);
  Dice dice(transposed ? 401 : 400);
  for (; findings.counted("systems") < systems; findings.count("systems")) {
    const Sizes size(dice);
    SCOPED_TRACE("n=" + std::to_string(size.n) + " m=" + std::to_string(size.m) + " p=" + std::to_string(size.p));
    Factorisation given(dice, transposed, dice.roll(0, 1) == 0, size.n, size.m, size.p);
    degenerate(dice, given.A, given.B);
    if (dice.roll(1, 4) == 1) {
      const double small = power_of_ten(dice, -12, 12);
      given.L.fill(given.pattern(), [&](int i, int j) { return small * given.L(i, j); });
    }
    // SLICOT leaves alone what no reflector touches, see below.
    given.C.fill(everything, [](int, int) { return 0; });
    given.tau.fill(everything, [](int, int) { return 0; });
    Factorisation ours = given, theirs = given;
    ours.run();
    run_peer(theirs);
    compare(findings, given, ours, theirs);
    if (::testing::Test::HasFailure()) return;
  }
}

// ---- TB01MD, TB01ND

Matrix<double> outcome(const Reduction& call) {
  Matrix<double> all =
      beside(call.A.matrix(), call.observer ? Matrix<double>(call.B.matrix().transpose()) : call.B.matrix());
  return call.jobu == 'N' ? all : beside(all, call.U.matrix());
}

/// How far the form itself moves when A and B do: random changes of relative size 2^-30, as the root of the number of
/// entries times what they do on average; infinite beyond the first order.
double sensitivity(Dice& dice, const Reduction& given, const Reduction& result) {
  const Matrix<double> form = outcome(result);
  double mean = 0;
  const double norm =
      beside(given.A.matrix(), given.observer ? Matrix<double>(given.B.matrix().transpose()) : given.B.matrix()).norm();
  for (int sample = 0; sample < 3; ++sample) {
    Reduction moved = given;
    double change = 0;
    for (Array* X : {&moved.A, &moved.B})
      X->fill(everything, [&](int i, int j) {
        const double delta = 0x1p-30 * norm * dice.number();
        change += delta * delta;
        return (*X)(i, j) + delta;
      });
    run_peer(moved);
    const double moved_by = (outcome(moved) - form).norm();
    if (moved_by > .01 * form.norm()) return std::numeric_limits<double>::infinity();
    mean += moved_by / std::sqrt(change) / 3;
  }
  return mean * std::sqrt(given.n * (given.n + given.m));
}

void reductions(const char* routine, bool observer) {
  Findings findings(routine);
  Dice dice(observer ? 501 : 500);
  for (; findings.counted("systems") < systems; findings.count("systems")) {
    const Sizes size(dice);
    const int n = size.n, m = observer ? std::min(size.m, n) : size.m;
    SCOPED_TRACE("n=" + std::to_string(n) + " m=" + std::to_string(m));
    Reduction given(dice, observer, n, m);
    given.jobu = "NIU"[dice.roll(0, 2)];
    given.uplo = "UL"[dice.roll(0, 1)];
    // Where there is no reflector, SLICOT 5.0 forgets to begin with the identity, see below.
    if (given.jobu == 'I' && m == 0) given.U.fill(everything, [](int i, int j) { return i == j; });
    if (given.jobu == 'U') given.U.fill(everything, [&](int, int) { return dice.number(); });
    if (dice.roll(1, 3) == 1) degenerate(dice, given.A, given.B);
    Reduction ours = given, theirs = given;
    ours.run();
    run_peer(theirs);
    EXPECT_EQ(ours.info, 0);
    EXPECT_EQ(theirs.info, 0);
    if (n == 0) continue;

    // Backward: U is orthogonal, and turns the given pair into the returned one.
    Reduction identity = given;
    identity.jobu = 'I';
    identity.run();
    const Matrix<double> U = identity.U.matrix(), A = given.A.matrix(), B = given.B.matrix();
    findings.expect("U'U - I", (product(U.transpose(), U) - Matrix<double>::Identity(n, n)).norm(), n + m, 1);
    findings.expect("U'AU", difference(product(product(U.transpose(), A), U), ours.A.matrix()), n + m, A.norm());
    findings.expect("U'B", difference(observer ? product(B, U) : product(U.transpose(), B), ours.B.matrix()), n + m,
                    B.norm() + 1e-300);
    EXPECT_EQ(ours.A.matrix(), identity.A.matrix());

    // Forward: as far as the form is determined.
    const double kappa = sensitivity(dice, given, theirs);
    if (kappa == std::numeric_limits<double>::infinity()) findings.count("undetermined");
    findings.expect("form", difference(outcome(ours), outcome(theirs)), n + m,
                    (1 + kappa) * beside(A, observer ? Matrix<double>(B.transpose()) : B).norm());
    if (::testing::Test::HasFailure()) return;
  }
}

}  // namespace

// If the program exported them, SLICOT would call our routines in place of its own.
TEST(Slicot, IsItself) {
  KFSTAB_NEEDS_PEER();
  for (const char* symbol : {"fb01qd_", "mb04ld_", "mb04kd_", "tb01md_"})
    EXPECT_EQ(dlsym(RTLD_DEFAULT, symbol), nullptr) << symbol;
}

TEST(Slicot, FB01QD) {
  KFSTAB_NEEDS_PEER();
  covariance_steps("FB01QD", false, 2);
}
TEST(Slicot, FB01RD) {
  KFSTAB_NEEDS_PEER();
  covariance_steps("FB01RD", true, 1);
}
TEST(Slicot, FB01SD) {
  KFSTAB_NEEDS_PEER();
  information_steps("FB01SD", false, 2);
}
TEST(Slicot, FB01TD) {
  KFSTAB_NEEDS_PEER();
  information_steps("FB01TD", true, 1);
}
TEST(Slicot, FB01VD) {
  KFSTAB_NEEDS_PEER();
  Findings findings("FB01VD");
  Dice dice(300);
  while (findings.counted("systems") < systems) {
    const Sizes size(dice);
    SCOPED_TRACE("system " + std::to_string(findings.counted("systems")) + " n=" + std::to_string(size.n) +
                 " m=" + std::to_string(size.m) + " l=" + std::to_string(size.p));
    Array P;
    for (int step = 0; step < 2; ++step) {
      ConventionalStep given(dice, size.n, size.m, size.p);
      if (step > 0) given.P = P;
      given.tol = random_tolerance(dice);
      degenerate(dice, given.A, given.B);
      const int kind = dice.roll(1, 8);
      if (kind <= 2) {  // nearly singular Re
        const double small = power_of_ten(dice, -18, -1);
        given.R.fill(upper, [&](int i, int j) { return small * given.R(i, j); });
        for (int i = 1; i < given.l; ++i)
          for (int j = 0; j < given.n; ++j) given.C(i, j) = given.C(0, j) + std::sqrt(small) * given.C(i, j);
      } else if (kind == 3 && given.l > 0) {  // indefinite R
        const int i = dice.roll(0, given.l - 1);
        given.R(i, i) = -power_of_ten(dice, -2, 4);
      }
      given.K.fill(everything, [](int, int) { return 0; });
      ConventionalStep ours = given, theirs = given;
      ours.run();
      run_peer(theirs);
      compare(findings, given, ours, theirs);
      findings.count("steps");
      P = ours.P;
      if (HasFailure()) return;
    }
    findings.count("systems");
  }
}
TEST(Slicot, MB04LD) {
  KFSTAB_NEEDS_PEER();
  factorisations("MB04LD", false);
}
TEST(Slicot, MB04KD) {
  KFSTAB_NEEDS_PEER();
  factorisations("MB04KD", true);
}
TEST(Slicot, TB01MD) {
  KFSTAB_NEEDS_PEER();
  reductions("TB01MD", false);
}
TEST(Slicot, TB01ND) {
  KFSTAB_NEEDS_PEER();
  reductions("TB01ND", true);
}

// What its documentation does not say, and what we do otherwise: docs/slicot.md.

// JOBU = 'I', and no reflector: U is not initialised (corrected after 5.0).
TEST(Slicot, ForgetsTheIdentity) {
  KFSTAB_NEEDS_PEER();
  for (const bool observer : {false, true}) {
    Dice dice(602);
    Reduction ours(dice, observer, 3, 0), theirs = ours;
    ours.run();
    run_peer(theirs);
    EXPECT_EQ(ours.U.matrix(), (Matrix<double>::Identity(3, 3)));
    EXPECT_NE(theirs.U(0, 0), theirs.U(0, 0));
  }
}

// "The strictly lower triangular part is not set."
TEST(Slicot, WritesOnTheLowerTriangleOfP) {
  KFSTAB_NEEDS_PEER();
  Dice dice(603);
  const ConventionalStep given(dice, 3, 2, 2);
  ConventionalStep ours = given, theirs = given;
  ours.run();
  run_peer(theirs);
  EXPECT_TRUE(untouched_but(upper, given.P, ours.P));
  EXPECT_FALSE(untouched_but(upper, given.P, theirs.P));
}

// Where a row has nothing to be annihilated SLICOT skips the reflector, and with it C(:, i): what the array held stays.
// So the gain of an output that sees nothing is whatever stood there; in truth, and here, it is zero.
TEST(Slicot, LeavesTheGainOfABlindOutputUnset) {
  KFSTAB_NEEDS_PEER();
  for (const bool condensed : {false, true}) {
    Dice dice(600);
    CovarianceStep ours(dice, condensed, 3, 2, 2);
    for (int j = 0; j < 3; ++j)
      if (ours.pattern_C()(0, j)) ours.C(0, j) = 0;
    ours.K.fill(everything, [](int, int) { return 7; });
    ours.jobk = 'N';
    CovarianceStep theirs = ours;
    ours.run();
    run_peer(theirs);
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(ours.K(i, 0), 0);
      EXPECT_EQ(theirs.K(i, 0), 7);
    }
  }
  Dice dice(601);
  const Factorisation given(dice, false, true, 2, 0, 3);
  Factorisation ours = given, theirs = given;
  ours.run();
  run_peer(theirs);
  EXPECT_EQ(ours.C.matrix(), (Matrix<double>::Zero(3, 2)));
  EXPECT_TRUE(untouched_but(nothing, given.C, theirs.C));
}

}  // namespace kfstab::test
