#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include <kfstab/filters/conventional.hpp>
#include <kfstab/filters/square_root_covariance.hpp>
#include <kfstab/filters/square_root_information.hpp>

#include "filters/with_kernels.hpp"
#include "slicot/fortran.hpp"

namespace {
std::string refused;
int refused_argument = 0;
int refusals = 0;
}  // namespace

// The program's own: it wins over the library's, or nothing below would be counted.
extern "C" void xerbla_(const char* routine, const int* argument, size_t length) {
  refused.assign(routine, length);
  refused_argument = *argument;
  ++refusals;
}

namespace kfstab::test {
namespace {

template <class Call>
struct Mistake {
  int argument;
  std::function<void(Call&)> make;
};

template <class Call>
void resize_work(Call& call) {
  call.work = Workspace(call.least_work());
}

/// Each mistake alone is reported as INFO = -i and to XERBLA, and nothing is computed; without one all is well.
template <class Call>
void refuses(const char* routine, const Call& legal, const std::vector<Mistake<Call>>& mistakes) {
  SCOPED_TRACE(routine);
  for (const auto& mistake : mistakes) {
    SCOPED_TRACE("argument " + std::to_string(mistake.argument));
    Call call = legal;
    mistake.make(call);
    const Call before = call;
    refusals = 0;
    call.run();
    EXPECT_EQ(call.info, -mistake.argument);
    EXPECT_EQ(refusals, 1);
    EXPECT_EQ(refused, routine);
    EXPECT_EQ(refused_argument, mistake.argument);
    EXPECT_TRUE(same_bits(before.B.values, call.B.values));
    EXPECT_TRUE(same_bits(before.work.values, call.work.values));
  }
  refusals = 0;
  Call call = legal;
  call.run();
  EXPECT_EQ(call.info, 0);
  EXPECT_EQ(refusals, 0);
}

/// The first of two mistakes is the one that is reported.
template <class Call>
void reports_the_first(const Call& legal, const std::vector<Mistake<Call>>& mistakes) {
  for (const auto& one : mistakes)
    for (const auto& other : mistakes) {
      if (one.argument >= other.argument) continue;
      Call call = legal;
      other.make(call);
      one.make(call);
      call.run();
      EXPECT_EQ(call.info, -one.argument) << "and not -" << other.argument;
    }
}

std::vector<Mistake<CovarianceStep>> covariance_mistakes() {
  return {{1, [](auto& c) { c.jobk = 'X'; }},      {2, [](auto& c) { c.multbq = 'Q'; }},
          {3, [](auto& c) { c.n = -1; }},          {4, [](auto& c) { c.m = -1; }},
          {5, [](auto& c) { c.p = -1; }},          {7, [](auto& c) { c.S.ld = c.n - 1; }},
          {9, [](auto& c) { c.A.ld = c.n - 1; }},  {11, [](auto& c) { c.B.ld = c.n - 1; }},
          {13, [](auto& c) { c.Q.ld = c.m - 1; }}, {15, [](auto& c) { c.C.ld = c.p - 1; }},
          {17, [](auto& c) { c.R.ld = c.p - 1; }}, {19, [](auto& c) { c.K.ld = c.n - 1; }},
          {23, [](auto& c) { --c.work.length; }}};
}

std::vector<Mistake<InformationStep>> information_mistakes(bool condensed) {
  const int less = condensed ? 1 : 0;  // FB01TD has no MULTAB
  std::vector<Mistake<InformationStep>> mistakes = {{1, [](auto& c) { c.jobx = 'K'; }},
                                                    {3 - less, [](auto& c) { c.multrc = 'X'; }},
                                                    {4 - less, [](auto& c) { c.n = -1; }},
                                                    {5 - less, [](auto& c) { c.m = -1; }},
                                                    {6 - less, [](auto& c) { c.p = -1; }},
                                                    {8 - less, [](auto& c) { c.T.ld = c.n - 1; }},
                                                    {10 - less, [](auto& c) { c.A_inverse.ld = c.n - 1; }},
                                                    {12 - less, [](auto& c) { c.B.ld = c.n - 1; }},
                                                    {14 - less, [](auto& c) { c.R_inverse_root.ld = c.p - 1; }},
                                                    {16 - less, [](auto& c) { c.C.ld = c.p - 1; }},
                                                    {18 - less, [](auto& c) { c.Q_inverse_root.ld = c.m - 1; }},
                                                    {26 - less, [](auto& c) { --c.work.length; }}};
  if (!condensed) mistakes.insert(mistakes.begin() + 1, {2, [](auto& c) { c.multab = 'X'; }});
  return mistakes;
}

std::vector<Mistake<ConventionalStep>> conventional_mistakes() {
  return {{1, [](auto& c) { c.n = -1; }},          {2, [](auto& c) { c.m = -1; }},
          {3, [](auto& c) { c.l = -1; }},          {5, [](auto& c) { c.P.ld = c.n - 1; }},
          {7, [](auto& c) { c.A.ld = c.n - 1; }},  {9, [](auto& c) { c.B.ld = c.n - 1; }},
          {11, [](auto& c) { c.C.ld = c.l - 1; }}, {13, [](auto& c) { c.Q.ld = c.m - 1; }},
          {15, [](auto& c) { c.R.ld = c.l - 1; }}, {17, [](auto& c) { c.K.ld = c.n - 1; }},
          {21, [](auto& c) { --c.work.length; }}};
}

std::vector<Mistake<Reduction>> reduction_mistakes(bool observer) {
  std::vector<Mistake<Reduction>> mistakes = {
      {1, [](auto& c) { c.jobu = 'X'; }},     {2, [](auto& c) { c.uplo = 'F'; }},
      {3, [](auto& c) { c.n = -1; }},         {4, [](auto& c) { c.m = -1; }},
      {6, [](auto& c) { c.A.ld = c.n - 1; }}, {8, [](auto& c) { c.B.ld = (c.observer ? c.m : c.n) - 1; }},
      {10, [](auto& c) { c.U.ld = c.n - 1; }}};
  if (observer) mistakes.push_back({4, [](auto& c) { c.m = c.n + 1; }});
  return mistakes;
}

/// The columns of X as a vector.
Vector<double> column(const Array& X) { return Eigen::Map<const Vector<double>>(X.values.data(), X.rows); }

/// Over all sizes of 0 ... 3 and all spellings of the modes.
template <class Try>
void for_small_sizes(Try&& attempt) {
  std::uint64_t seed = 0;
  for (int n = 0; n <= 3; ++n)
    for (int m = 0; m <= 3; ++m)
      for (int p = 0; p <= 4; ++p) {
        SCOPED_TRACE("n=" + std::to_string(n) + " m=" + std::to_string(m) + " p=" + std::to_string(p));
        Dice dice(++seed);
        attempt(dice, n, m, p);
      }
}

bool all_finite(const Array& X, const Pattern& where = everything) { return kfstab::all_finite(X.matrix(where)); }

// ---- Illegal arguments

TEST(Arguments, AnIllegalOneIsReported) {
  Dice dice(1);
  for (const bool condensed : {false, true}) {
    refuses(condensed ? "FB01RD" : "FB01QD", CovarianceStep(dice, condensed, 4, 3, 2), covariance_mistakes());
    refuses(condensed ? "FB01TD" : "FB01SD", InformationStep(dice, condensed, 4, 3, 2),
            information_mistakes(condensed));
    refuses(condensed ? "TB01ND" : "TB01MD", Reduction(dice, condensed, 4, 3), reduction_mistakes(condensed));
  }
  refuses("FB01VD", ConventionalStep(dice, 4, 3, 2), conventional_mistakes());
}

TEST(Arguments, TheFirstIllegalOneIsReported) {
  Dice dice(2);
  for (const bool condensed : {false, true}) {
    // A negative size makes its leading dimensions legal and changes the workspace, but it comes first.
    reports_the_first(CovarianceStep(dice, condensed, 4, 3, 2), covariance_mistakes());
    reports_the_first(InformationStep(dice, condensed, 4, 3, 2), information_mistakes(condensed));
    reports_the_first(Reduction(dice, condensed, 4, 3), reduction_mistakes(condensed));
  }
  reports_the_first(ConventionalStep(dice, 4, 3, 2), conventional_mistakes());
}

// What a mode leaves unused may be a dummy array of leading dimension 1, but not of 0.
TEST(Arguments, DummyArrays) {
  Dice dice(3);
  for (const bool condensed : {false, true}) {
    CovarianceStep covariance(dice, condensed, 4, 3, 2);
    covariance.multbq = 'P';
    covariance.Q = Array(1, 1, 0);
    refuses(condensed ? "FB01RD" : "FB01QD", covariance, {{13, [](auto& c) { c.Q.ld = 0; }}});
    InformationStep information(dice, condensed, 4, 3, 2);
    information.multrc = 'P';
    information.R_inverse_root = Array(1, 1, 0);
    refuses(condensed ? "FB01TD" : "FB01SD", information,
            {{condensed ? 13 : 14, [](auto& c) { c.R_inverse_root.ld = 0; }}});
    Reduction reduction(dice, condensed, 4, 3);
    reduction.jobu = 'N';
    reduction.U = Array(1, 1, 0);
    refuses(condensed ? "TB01ND" : "TB01MD", reduction, {{10, [](auto& c) { c.U.ld = 0; }}});
  }
}

/// The documented least length is enough, and one less is refused.
template <class Call>
void needs_its_work(Call call, int argument) {
  call.work = Workspace(call.least_work());
  Call shorter = call;
  --shorter.work.length;
  shorter.run();
  EXPECT_EQ(shorter.info, -argument) << "least " << call.work.length;
  call.run();
  EXPECT_EQ(call.info, 0);
  EXPECT_TRUE(call.work.kept_within());
}

TEST(Arguments, TheLeastWorkspace) {
  for (int n = 0; n <= 5; ++n)
    for (int m = 0; m <= 5; ++m)
      for (int p = 0; p <= 5; ++p) {
        SCOPED_TRACE("n=" + std::to_string(n) + " m=" + std::to_string(m) + " p=" + std::to_string(p));
        Dice dice(5);
        needs_its_work(ConventionalStep(dice, n, m, p), 21);
        for (const bool condensed : {false, true})
          for (const bool all : {false, true}) {
            CovarianceStep covariance(dice, condensed, n, m, p);
            covariance.jobk = all ? 'K' : 'N';
            needs_its_work(covariance, 23);
            InformationStep information(dice, condensed, n, m, p);
            information.jobx = all ? 'X' : 'N';
            needs_its_work(information, condensed ? 25 : 26);
          }
      }
}

// Products of sizes that leave the range of INTEGER must not pass for a small workspace.
TEST(Arguments, WorkspaceThatNoIntegerCanCount) {
  Dice dice(4);
  CovarianceStep call(dice, false, 1, 1, 1);
  call.n = call.S.ld = call.A.ld = call.B.ld = call.K.ld = 65536;
  call.work.length = 1000;
  call.run();
  EXPECT_EQ(call.info, -23);
}

// ---- What is read and written, and the workspace: NaN stands wherever it may not be read

TEST(Arguments, CovarianceStepKeepsToItsTriangles) {
  for (const bool condensed : {false, true})
    for (const char jobk : {'K', 'N', 'k', 'n'})
      for (const char multbq : {'P', 'N', 'p', 'n'})
        for_small_sizes([&](Dice& dice, int n, int m, int p) {
          CovarianceStep call(dice, condensed, n, m, p);
          call.jobk = jobk;
          call.multbq = multbq;
          if (multbq == 'P' || multbq == 'p') call.Q = Array(1, 1, 0);
          resize_work(call);
          const CovarianceStep before = call;
          call.run();
          ASSERT_EQ(call.info, 0);
          EXPECT_TRUE(untouched_but(lower, before.S, call.S));
          EXPECT_TRUE(untouched_but(lower, before.R, call.R));
          EXPECT_TRUE(untouched_but(everything, before.K, call.K));
          EXPECT_TRUE(same_bits(before.A.values, call.A.values));
          EXPECT_TRUE(same_bits(before.B.values, call.B.values));
          EXPECT_TRUE(same_bits(before.C.values, call.C.values));
          EXPECT_TRUE(same_bits(before.Q.values, call.Q.values));
          EXPECT_TRUE(call.work.kept_within());
          EXPECT_TRUE(all_finite(call.S, lower));
          EXPECT_TRUE(all_finite(call.R, lower));
          EXPECT_TRUE(n == 0 || all_finite(call.K));
          EXPECT_GE(call.work.values[0], call.work.length);
          if (jobk == 'K' || jobk == 'k') {
            EXPECT_GT(call.work.values[1], 0);
            EXPECT_LE(call.work.values[1], 1 + 30 * unit_roundoff<double>());
          }
        });
}

TEST(Arguments, InformationStepKeepsToItsTriangles) {
  for (const bool condensed : {false, true})
    for (const char jobx : {'X', 'N', 'x', 'n'})
      for (const char multab : {'P', 'N', 'p', 'n'})
        for (const char multrc : {'P', 'N', 'p', 'n'})
          for_small_sizes([&](Dice& dice, int n, int m, int p) {
            InformationStep call(dice, condensed, n, m, p);
            call.jobx = jobx;
            call.multab = multab;
            call.multrc = multrc;
            if (multrc == 'P' || multrc == 'p') call.R_inverse_root = Array(1, 1, 0);
            resize_work(call);
            const InformationStep before = call;
            call.run();
            ASSERT_EQ(call.info, 0);
            EXPECT_TRUE(untouched_but(upper, before.T, call.T));
            EXPECT_TRUE(untouched_but(upper, before.Q_inverse_root, call.Q_inverse_root));
            EXPECT_TRUE(untouched_but(everything, before.x, call.x));
            EXPECT_TRUE(untouched_but(everything, before.e, call.e));
            EXPECT_TRUE(same_bits(before.A_inverse.values, call.A_inverse.values));
            EXPECT_TRUE(same_bits(before.B.values, call.B.values));
            EXPECT_TRUE(same_bits(before.C.values, call.C.values));
            EXPECT_TRUE(same_bits(before.R_inverse_root.values, call.R_inverse_root.values));
            EXPECT_TRUE(same_bits(before.y.values, call.y.values));
            EXPECT_TRUE(same_bits(before.z.values, call.z.values));
            EXPECT_TRUE(call.work.kept_within());
            EXPECT_TRUE(all_finite(call.T, upper));
            EXPECT_TRUE(all_finite(call.Q_inverse_root, upper));
            EXPECT_TRUE(all_finite(call.x));
            EXPECT_TRUE(all_finite(call.e));
            EXPECT_GE(call.work.values[0], call.work.length);
            if (jobx == 'X' || jobx == 'x') {
              EXPECT_GT(call.work.values[1], 0);
              EXPECT_LE(call.work.values[1], 1 + 30 * unit_roundoff<double>());
            }
          });
}

TEST(Arguments, ConventionalStepKeepsToItsTriangles) {
  for_small_sizes([](Dice& dice, int n, int m, int l) {
    ConventionalStep call(dice, n, m, l);
    const ConventionalStep before = call;
    call.run();
    ASSERT_EQ(call.info, 0);
    EXPECT_TRUE(untouched_but(upper, before.P, call.P));
    EXPECT_TRUE(untouched_but(everything, before.R, call.R));
    EXPECT_TRUE(untouched_but(everything, before.K, call.K));
    EXPECT_TRUE(same_bits(before.A.values, call.A.values));
    EXPECT_TRUE(same_bits(before.B.values, call.B.values));
    EXPECT_TRUE(same_bits(before.C.values, call.C.values));
    EXPECT_TRUE(same_bits(before.Q.values, call.Q.values));
    EXPECT_TRUE(call.work.kept_within());
    EXPECT_TRUE(all_finite(call.P, upper));
    EXPECT_TRUE(all_finite(call.K));
    for (int j = 0; j < l; ++j)
      for (int i = j + 1; i < l; ++i) EXPECT_EQ(call.R(i, j), 0);
    EXPECT_GT(call.work.values[0], 0);
    EXPECT_LE(call.work.values[0], 1 + 30 * unit_roundoff<double>());
  });
}

TEST(Arguments, FactorisationsKeepToTheirTriangles) {
  for (const bool transposed : {false, true})
    for (const char uplo : {'F', 'f', transposed ? 'U' : 'L', transposed ? 'u' : 'l'})
      for_small_sizes([&](Dice& dice, int n, int m, int r) {
        Factorisation call(dice, transposed, uplo == 'F' || uplo == 'f', n, m, r);
        call.uplo = uplo;
        const Factorisation before = call;
        call.run();
        EXPECT_TRUE(untouched_but(call.pattern(), before.L, call.L));
        EXPECT_TRUE(untouched_but(call.pattern_A(), before.A, call.A));
        EXPECT_TRUE(untouched_but(everything, before.B, call.B));
        EXPECT_TRUE(untouched_but(everything, before.C, call.C));
        EXPECT_TRUE(untouched_but(everything, before.tau, call.tau));
        EXPECT_TRUE(call.work.kept_within());
        EXPECT_TRUE(all_finite(call.L, call.pattern()));
        EXPECT_TRUE(all_finite(call.A, call.pattern_A()));
        EXPECT_TRUE(all_finite(call.B));
        EXPECT_TRUE(all_finite(call.C));  // where there is nothing to annihilate it is 0
        EXPECT_TRUE(all_finite(call.tau));
      });
}

TEST(Arguments, ReductionsKeepToTheirArrays) {
  for (const bool observer : {false, true})
    for (const char jobu : {'N', 'I', 'U', 'n', 'i', 'u'})
      for (const char uplo : {'U', 'L', 'u', 'l'})
        for_small_sizes([&](Dice& dice, int n, int m, int) {
          if (observer && m > n) return;
          Reduction call(dice, observer, n, m);
          call.jobu = jobu;
          call.uplo = uplo;
          const bool updates = jobu == 'U' || jobu == 'u', forms = updates || jobu == 'I' || jobu == 'i';
          if (updates) call.U.fill(everything, [](int i, int j) { return 1. + i + 10. * j; });
          const Reduction before = call;
          call.run();
          ASSERT_EQ(call.info, 0);
          EXPECT_TRUE(untouched_but(everything, before.A, call.A));
          EXPECT_TRUE(untouched_but(everything, before.B, call.B));
          EXPECT_TRUE(untouched_but(forms ? everything : nothing, before.U, call.U));
          EXPECT_TRUE(call.work.kept_within());
          EXPECT_TRUE(all_finite(call.A));
          EXPECT_TRUE(all_finite(call.B));
          if (forms) {
            EXPECT_TRUE(all_finite(call.U));
          }
          Reduction large = call;
          large.uplo = uplo == 'u' ? 'U' : uplo == 'l' ? 'L' : uplo;
          const Pattern kept_A = large.pattern_A(), kept_B = large.pattern_B();
          for (int j = 0; j < n; ++j)
            for (int i = 0; i < n; ++i)
              if (!kept_A(i, j)) {
                EXPECT_EQ(call.A(i, j), 0) << "A(" << i << "," << j << ")";
              }
          for (int j = 0; j < call.B.cols; ++j)
            for (int i = 0; i < call.B.rows; ++i)
              if (!kept_B(i, j)) {
                EXPECT_EQ(call.B(i, j), 0) << "B or C(" << i << "," << j << ")";
              }
        });
}

// ---- What the modes mean, by the filters of the library, which do the same operations in the same order

TEST(Arguments, CovarianceStepIsThatOfTheFilter) {
  const WithKernels with("plain");
  for_small_sizes([](Dice& dice, int n, int m, int p) {
    CovarianceStep call(dice, false, n, m, p);
    RootModel<double> model;
    model.A = call.A.matrix();
    model.B = call.B.matrix();
    model.C = call.C.matrix();
    model.D.resize(n, 0);
    model.Q_root = call.Q.matrix(lower);
    model.R_root = call.R.matrix(lower);
    SquareRootCovarianceFilter<double> filter(model.dimensions());
    filter.start(call.S.matrix(lower), Vector<double>::Zero(n).eval());
    const auto report = filter.step(model);
    ASSERT_TRUE(report);
    call.run();
    EXPECT_EQ(call.S.matrix(lower), filter.factor());
    if (n == 0) return;  // SLICOT's quick return
    EXPECT_EQ(call.K.matrix(), filter.predictor_gain());
    EXPECT_EQ(call.R.matrix(lower), filter.innovation_root());
    EXPECT_EQ(call.work.values[1], report.rcond);

    // MULTBQ = 'P' is the same with B Q^{1/2} for B.
    Dice again(17);
    CovarianceStep given(again, false, n, m, p), formed = given;
    Matrix<double> BQ(n, m);
    multiply_lower(given.B.matrix(), given.Q.matrix(lower), BQ);
    formed.B.fill(everything, [&](int i, int j) { return BQ(i, j); });
    formed.multbq = 'P';
    given.run();
    formed.run();
    EXPECT_TRUE(same_bits(given.S.values, formed.S.values));
    EXPECT_TRUE(same_bits(given.K.values, formed.K.values));
  });
}

TEST(Arguments, InformationStepIsThatOfTheFilter) {
  const WithKernels with("plain");
  for_small_sizes([](Dice& dice, int n, int m, int p) {
    InformationStep call(dice, false, n, m, p);
    InformationModel<double> model;
    model.A_inverse = call.A_inverse.matrix();
    model.A_inverse_B.noalias() = model.A_inverse.lazyProduct(call.B.matrix());
    model.C = call.C.matrix();
    model.D.resize(n, 0);
    model.Q_inverse_root = call.Q_inverse_root.matrix(upper);
    model.R_inverse_root = call.R_inverse_root.matrix(upper);
    model.w_mean = -column(call.z);
    const Vector<double> given = column(call.y);
    Vector<double> y(p);
    multiply_upper(model.R_inverse_root, given, y);
    call.y.fill(everything, [&](int i, int) { return y(i); });
    SquareRootInformationFilter<double> filter(model.dimensions());
    filter.start(call.T.matrix(upper), column(call.x));
    const auto report = filter.step(model, model, &given);
    ASSERT_TRUE(report);
    const InformationStep before = call;
    call.run();
    EXPECT_EQ(call.T.matrix(upper), filter.information_factor());
    EXPECT_EQ(column(call.x), filter.state());
    EXPECT_EQ(column(call.e), filter.residual());
    EXPECT_EQ(call.work.values[1], report.rcond);

    // MULTAB = 'P' and MULTRC = 'P' are the same with A^{-1}B for B and R^{-1/2}C for C.
    InformationStep formed = before;
    Matrix<double> RC(p, n);
    multiply_upper(model.R_inverse_root, model.C, RC);
    formed.B.fill(everything, [&](int i, int j) { return model.A_inverse_B(i, j); });
    formed.C.fill(everything, [&](int i, int j) { return RC(i, j); });
    formed.R_inverse_root = Array(1, 1, 0);
    formed.multab = formed.multrc = 'P';
    formed.run();
    EXPECT_TRUE(same_bits(call.T.values, formed.T.values));
    EXPECT_TRUE(same_bits(call.x.values, formed.x.values));
    EXPECT_TRUE(same_bits(call.e.values, formed.e.values));
  });
}

TEST(Arguments, ConventionalStepIsThatOfTheFilter) {
  const WithKernels with("plain");
  for_small_sizes([](Dice& dice, int n, int m, int l) {
    ConventionalStep call(dice, n, m, l);
    const auto symmetric = [](const Array& X) {
      Matrix<double> full = X.matrix(upper);
      mirror_upper(full);
      return full;
    };
    CovarianceModel<double> model;
    model.A = call.A.matrix();
    model.B = call.B.matrix();
    model.C = call.C.matrix();
    model.D.resize(n, 0);
    model.Q = symmetric(call.Q);
    model.R = symmetric(call.R);
    ConventionalFilter<double> filter(model.dimensions());
    filter.start(symmetric(call.P), Vector<double>::Zero(n).eval());
    const auto report = filter.step(model);
    ASSERT_TRUE(report);
    const ConventionalStep before = call;
    call.run();
    EXPECT_EQ(call.K.matrix(), filter.filter_gain());
    EXPECT_EQ(call.work.values[0], report.rcond);
    // Sums of n + m terms, A P A' first here and B Q B' first there. |P_{k|k}(i, j)|^2 <= P(i, i) P(j, j).
    Vector<double> d(n);
    for (int i = 0; i < n; ++i) d(i) = std::sqrt(before.P(i, i));
    const Vector<double> Ad = model.A.cwiseAbs().lazyProduct(d);
    const Matrix<double> BQ = model.B.cwiseAbs().lazyProduct(model.Q.cwiseAbs());
    const Matrix<double> size = Ad.lazyProduct(Ad.transpose()) + BQ.lazyProduct(model.B.cwiseAbs().transpose());
    for (int j = 0; j < n; ++j)
      for (int i = 0; i <= j; ++i)
        EXPECT_NEAR(call.P(i, j), filter.covariance()(i, j), 30 * unit_roundoff<double>() * (n + m + l) * size(i, j));
  });
}

// The condensed routine, whose zeros are put where the dense one reads them: it loses k = k(Re^{1/2}) of the array's
// size in S+, and of the gain k (1 + k) of that size over Re^{1/2}'s, theory (4).
TEST(Arguments, CondensedStepIsTheDenseOne) {
  for_small_sizes([](Dice& dice, int n, int m, int p) {
    if (n == 0) return;
    const auto zeros = [](Array& X) {
      for (double& x : X.values)
        if (x != x) x = 0;
    };
    CovarianceStep fast(dice, true, n, m, p), dense = fast;
    zeros(dense.A);
    zeros(dense.C);
    dense.condensed = false;
    resize_work(dense);
    fast.run();
    dense.run();
    const auto covariance = [](const Array& S) {
      const Matrix<double> L = S.matrix(lower);
      return Matrix<double>(L.lazyProduct(L.transpose()));
    };
    const Matrix<double> P = covariance(dense.S), K = dense.K.matrix(), Re_root = dense.R.matrix(lower);
    const double unit = 30 * unit_roundoff<double>() * (n + m + p), kappa = 1 / dense.work.values[1];
    const double array = P.trace() + K.lazyProduct(Re_root).squaredNorm();
    EXPECT_LE((covariance(fast.S) - P).norm(), unit * (1 + kappa) * array);
    if (p == 0) return;
    EXPECT_LE((fast.K.matrix() - K).norm(), unit * kappa * (1 + kappa) * std::sqrt(array) / Re_root.norm());
  });
}

// Likewise: T+ and what it is told of x lose k(Qe^{-1/2}) of the sizes of the array and of its right-hand side.
TEST(Arguments, CondensedInformationStepIsTheDenseOne) {
  for_small_sizes([](Dice& dice, int n, int m, int p) {
    InformationStep fast(dice, true, n, m, p);
    fast.jobx = 'N';
    resize_work(fast);
    InformationStep dense = fast;
    for (Array* X : {&dense.A_inverse, &dense.B})
      for (double& x : X->values)
        if (x != x) x = 0;
    dense.condensed = false;
    resize_work(dense);
    const InformationStep given = dense;
    fast.run();
    dense.run();
    const auto norm = [](const Array& X, const Pattern& where = everything) { return X.matrix(where).norm(); };
    const double array =
        norm(given.T, upper) * norm(given.A_inverse) + norm(given.R_inverse_root, upper) * norm(given.C);
    const double right =
        norm(given.T, upper) * norm(given.x) + norm(given.Q_inverse_root, upper) * norm(given.z) + norm(given.y);
    const Matrix<double> Qe = dense.Q_inverse_root.matrix(upper);
    Vector<double> work(m), sign(m);
    const double kappa = 1 + 1 / reciprocal_condition_triangular<Triangle::upper>(Qe, work, sign);
    const double unit = 30 * unit_roundoff<double>() * (n + m + p) * kappa;
    const Matrix<double> T = dense.T.matrix(upper), fast_T = fast.T.matrix(upper);
    EXPECT_LE((fast_T.transpose().lazyProduct(fast_T) - T.transpose().lazyProduct(T)).norm(), unit * array * array);
    EXPECT_LE((fast_T.transpose().lazyProduct(column(fast.x)) - T.transpose().lazyProduct(column(dense.x))).norm(),
              unit * array * right);
  });
}

// JOBU = 'U' multiplies the U that is given by the one that JOBU = 'I' returns.
TEST(Arguments, ReductionsUpdateTheTransformation) {
  for (const bool observer : {false, true})
    for_small_sizes([&](Dice& dice, int n, int m, int) {
      if (observer && m > n) return;
      Reduction fresh(dice, observer, n, m), updated = fresh;
      updated.jobu = 'U';
      updated.U.fill(everything, [&](int, int) { return dice.number(); });
      const Matrix<double> before = updated.U.matrix();
      fresh.run();
      updated.run();
      const Matrix<double> expected = before.lazyProduct(fresh.U.matrix());
      EXPECT_LE((updated.U.matrix() - expected).norm(), 30 * unit_roundoff<double>() * (n + m) * before.norm());
      EXPECT_TRUE(same_bits(fresh.A.values, updated.A.values));
    });
}

// ---- Failures

TEST(Arguments, SingularInnovationLeavesTheGainUndivided) {
  for (const bool condensed : {false, true})
    for (const double tol : {0., .5, -1.}) {
      Dice dice(23);
      CovarianceStep call(dice, condensed, 3, 2, 2);
      call.tol = tol;
      if (tol != .5) {  // the second output says nothing, and without noise
        call.R(1, 0) = call.R(1, 1) = 0;
        call.C.fill(call.pattern_C(), [&](int i, int j) { return i == 1 ? 0 : call.C(i, j); });
      } else {
        call.R(1, 1) *= 1e3;  // Re is regular, but not for that tolerance
      }
      CovarianceStep without = call;
      without.jobk = 'N';
      call.run();
      without.run();
      EXPECT_EQ(call.info, 1);
      EXPECT_EQ(without.info, 0);
      EXPECT_TRUE(same_bits(call.S.values, without.S.values));
      EXPECT_TRUE(same_bits(call.R.values, without.R.values));
      EXPECT_TRUE(same_bits(call.K.values, without.K.values));
      EXPECT_TRUE(all_finite(call.K));
    }
}

TEST(Arguments, TheGainIsTheUndividedOneByTheRoot) {
  for (const bool condensed : {false, true})
    for_small_sizes([&](Dice& dice, int n, int m, int p) {
      if (n == 0) return;
      CovarianceStep with(dice, condensed, n, m, p), without = with;
      without.jobk = 'N';
      resize_work(without);
      with.run();
      without.run();
      Matrix<double> K = without.K.matrix();
      const Matrix<double> Re_root = without.R.matrix(lower);
      solve_triangular_right<Triangle::lower, false>(Re_root, K);
      EXPECT_EQ(K, with.K.matrix());
    });
}

TEST(Arguments, SingularInformationLeavesXiUnsolved) {
  for (const bool condensed : {false, true})
    for (const double tol : {0., .999, -1.}) {
      Dice dice(24);
      InformationStep call(dice, condensed, 3, 2, 1);
      call.tol = tol;
      if (tol != .999) {  // nothing is known before, and one output is too little
        call.T.fill(upper, [](int, int) { return 0; });
      }
      InformationStep without = call;
      without.jobx = 'N';
      call.run();
      without.run();
      EXPECT_EQ(call.info, 1);
      EXPECT_EQ(without.info, 0);
      EXPECT_TRUE(same_bits(call.T.values, without.T.values));
      EXPECT_TRUE(same_bits(call.Q_inverse_root.values, without.Q_inverse_root.values));
      EXPECT_TRUE(same_bits(call.x.values, without.x.values));
      EXPECT_TRUE(same_bits(call.e.values, without.e.values));
      EXPECT_TRUE(all_finite(call.x));
    }
}

TEST(Arguments, ConventionalFailuresLeaveTheCovariance) {
  for (int minor = 1; minor <= 4; ++minor) {  // 4 = L + 1: positive, but singular to the tolerance
    Dice dice(25);
    ConventionalStep call(dice, 4, 2, 3), plain = call;
    if (minor <= 3)
      call.R(minor - 1, minor - 1) = -1e6;
    else
      call.tol = .9999;
    const ConventionalStep before = call;
    call.run();
    EXPECT_EQ(call.info, minor);
    EXPECT_TRUE(same_bits(before.P.values, call.P.values));
    EXPECT_TRUE(untouched_but(upper, before.R, call.R));
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 3; ++j) {
        double s = 0, size = 0;
        for (int k = 0; k < 4; ++k) {
          const double product = before.P(std::min(i, k), std::max(i, k)) * before.C(j, k);
          s += product;
          size += std::abs(product);
        }
        EXPECT_NEAR(call.K(i, j), s, 30 * 4 * unit_roundoff<double>() * size);
      }
    if (minor == 4) {
      plain.run();
      EXPECT_EQ(plain.info, 0);
      EXPECT_EQ(call.R.matrix(upper), plain.R.matrix(upper));
      EXPECT_EQ(call.work.values[0], plain.work.values[0]);
    }
  }
}

// Regular is what has an rcond above the tolerance (FB01VD: not below it); where there is no matrix, none is asked for.
TEST(Arguments, TheToleranceIsABound) {
  for (const bool condensed : {false, true})
    for (const double tol : {.9, 1., 2.}) {
      Dice dice(28);
      CovarianceStep covariance(dice, condensed, 2, 1, 1), no_output(dice, condensed, 2, 1, 0);
      covariance.C.fill(covariance.pattern_C(), [](int, int) { return 0; });
      covariance.R(0, 0) = 1;  // so Re^{1/2} = 1
      covariance.tol = no_output.tol = tol;
      covariance.run();
      no_output.run();
      EXPECT_EQ(covariance.info, tol < 1 ? 0 : 1);
      EXPECT_EQ(no_output.info, 0);
      InformationStep information(dice, condensed, 1, 0, 0), no_state(dice, condensed, 0, 1, 1);
      information.T(0, 0) = information.A_inverse(0, 0) = 1;  // T+ = 1
      information.tol = no_state.tol = tol;
      information.run();
      no_state.run();
      EXPECT_EQ(information.info, tol < 1 ? 0 : 1);
      EXPECT_EQ(no_state.info, 0);
    }
  for (const double tol : {.9, 1., 2.}) {
    Dice dice(29);
    ConventionalStep call(dice, 2, 1, 1);
    call.C.fill(everything, [](int, int) { return 0; });
    call.R(0, 0) = 1;
    call.tol = tol;
    call.run();
    EXPECT_EQ(call.info, tol <= 1 ? 0 : 2);
  }
}

// An infinite or undefined number never ends as INFO = 0 with a finite gain.
TEST(Arguments, NaNGivesNoGain) {
  for (const bool condensed : {false, true}) {
    Dice dice(26);
    CovarianceStep covariance(dice, condensed, 3, 2, 2);
    covariance.C(0, 0) = std::nan("");
    covariance.run();
    EXPECT_EQ(covariance.info, 1);
    InformationStep information(dice, condensed, 3, 2, 2);
    information.C(0, 0) = std::nan("");
    information.run();
    EXPECT_EQ(information.info, 1);
  }
  Dice dice(27);
  ConventionalStep conventional(dice, 3, 2, 2);
  conventional.C(1, 0) = std::nan("");
  conventional.run();
  EXPECT_EQ(conventional.info, 2);
}

}  // namespace
}  // namespace kfstab::test
