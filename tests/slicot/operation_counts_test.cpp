#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <functional>
#include <iterator>
#include <numeric>
#include <string>
#include <vector>

#include <Eigen/LU>

#include <kfstab/filters/counting.hpp>
#include <kfstab/filters/slicot/fb01rd.hpp>
#include <kfstab/filters/slicot/fb01td.hpp>
#include <kfstab/filters/slicot/fb01vd.hpp>

#include "slicot/fortran.hpp"

namespace kfstab::test {
namespace {

using Number = Counting<double>;
using Count = std::function<std::int64_t(int n, int m, int p)>;

/// The same numbers as countable ones.
std::vector<Number> counted(const Array& X) {
  std::vector<Number> values(X.values.size());
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = Number(X.values[i]);
  return values;
}

/// As what a routine changes, or as what it only reads.
struct Seen {
  std::vector<Number>& values;
  const Array& like;
  operator slicot::View<Number>() const { return slicot::view(values.data(), like.rows, like.cols, like.ld); }
  operator slicot::ConstView<Number>() const {
    return slicot::view(static_cast<const Number*>(values.data()), like.rows, like.cols, like.ld);
  }
};

Seen seen(std::vector<Number>& values, const Array& like) { return {values, like}; }

/// The monomials of total degree 3, n^3 first.
constexpr std::array<std::array<int, 3>, 10> monomials = {
    {{3, 0, 0}, {2, 1, 0}, {2, 0, 1}, {1, 2, 0}, {1, 1, 1}, {1, 0, 2}, {0, 3, 0}, {0, 2, 1}, {0, 1, 2}, {0, 0, 3}}};

/// Six times the coefficients of total degree 3 of a count that is a polynomial in n, m, p. The third difference of one
/// along (kn, km, kp), k = 2 ... 5, is six times its cubic part at (n, m, p): integers, and exact.
std::array<long, 10> leading(const Count& count) {
  std::vector<std::array<int, 3>> directions;
  for (int m = 1; m <= 4; ++m)
    for (int p = 1; p <= 4; ++p)
      if (m + p <= 5) directions.push_back({4, m, p});  // p, m <= n, and none of them the multiple of another
  Matrix<double> powers(10, 10);
  Vector<double> differences(10);
  for (int row = 0; row < 10; ++row) {
    const auto [n, m, p] = directions[static_cast<std::size_t>(row)];
    const auto at = [&, n = n, m = m, p = p](int k) { return count(k * n, k * m, k * p); };
    differences(row) = static_cast<double>(at(5) - 3 * at(4) + 3 * at(3) - at(2));
    for (int col = 0; col < 10; ++col) {
      const auto& power = monomials[static_cast<std::size_t>(col)];
      powers(row, col) = std::pow(n, power[0]) * std::pow(m, power[1]) * std::pow(p, power[2]);
    }
  }
  const Vector<double> solution = powers.fullPivLu().solve(differences);
  std::array<long, 10> coefficients{};
  for (int col = 0; col < 10; ++col) {
    coefficients[static_cast<std::size_t>(col)] = std::lround(solution(col));
    EXPECT_NEAR(solution(col), std::round(solution(col)), .1) << "no polynomial of degree 3";
  }
  return coefficients;
}

std::int64_t fb01qd(int n, int m, int p, bool has_product) {
  Dice dice(31);
  CovarianceStep call(dice, false, n, m, p);
  auto S = counted(call.S), A = counted(call.A), B = counted(call.B), Q = counted(call.Q), C = counted(call.C),
       R = counted(call.R), K = counted(call.K), work = std::vector<Number>(call.work.values.size());
  operations() = {};
  slicot::fb01qd<Number>(false, has_product, seen(S, call.S), seen(A, call.A), seen(B, call.B), seen(Q, call.Q),
                         seen(C, call.C), seen(R, call.R), seen(K, call.K), Number(0), work.data());
  return operations().multiplications;
}

std::int64_t fb01rd(int n, int m, int p) {
  Dice dice(32);
  CovarianceStep call(dice, true, n, m, p);
  auto S = counted(call.S), A = counted(call.A), B = counted(call.B), Q = counted(call.Q), C = counted(call.C),
       R = counted(call.R), K = counted(call.K), work = std::vector<Number>(call.work.values.size());
  operations() = {};
  slicot::fb01rd<Number>(false, true, seen(S, call.S), seen(A, call.A), seen(B, call.B), seen(Q, call.Q),
                         seen(C, call.C), seen(R, call.R), seen(K, call.K), Number(0), work.data());
  return operations().multiplications;
}

std::int64_t information(bool condensed, int n, int m, int p, bool has_RC) {
  using slicot::ConstVectorView;
  using slicot::VectorView;
  Dice dice(33);
  InformationStep call(dice, condensed, n, m, p);
  auto T = counted(call.T), A = counted(call.A_inverse), B = counted(call.B), R = counted(call.R_inverse_root),
       C = counted(call.C), Q = counted(call.Q_inverse_root), x = counted(call.x), y = counted(call.y),
       z = counted(call.z), e = counted(call.e), work = std::vector<Number>(call.work.values.size());
  const VectorView<Number> state(x.data(), n), residual(e.data(), p);
  const ConstVectorView<Number> output(y.data(), p), mean(z.data(), m);
  operations() = {};
  if (condensed)
    slicot::fb01td<Number>(false, has_RC, seen(T, call.T), seen(A, call.A_inverse), seen(B, call.B),
                           seen(R, call.R_inverse_root), seen(C, call.C), seen(Q, call.Q_inverse_root), state, output,
                           mean, residual, Number(0), work.data());
  else
    slicot::fb01sd<Number>(false, false, has_RC, seen(T, call.T), seen(A, call.A_inverse), seen(B, call.B),
                           seen(R, call.R_inverse_root), seen(C, call.C), seen(Q, call.Q_inverse_root), state, output,
                           mean, residual, Number(0), work.data());
  return operations().multiplications;
}

std::int64_t fb01vd(int n, int m, int p) {
  Dice dice(34);
  ConventionalStep call(dice, n, m, p);
  // Re = I, or the estimate of its condition would take now more solves, now fewer.
  call.C.fill(everything, [](int, int) { return 0; });
  call.R.fill(upper, [](int i, int j) { return i == j; });
  auto P = counted(call.P), A = counted(call.A), B = counted(call.B), C = counted(call.C), Q = counted(call.Q),
       R = counted(call.R), K = counted(call.K), work = std::vector<Number>(call.work.values.size());
  operations() = {};
  slicot::fb01vd<Number>(seen(P, call.P), seen(A, call.A), seen(B, call.B), seen(C, call.C), seen(Q, call.Q),
                         seen(R, call.R), seen(K, call.K), Number(0), work.data());
  return operations().multiplications;
}

// Six times the documented coefficients, in the order of `monomials`:   nnn nnm nnp nmm nmp npp mmm mmp mpp ppp
constexpr std::array<long, 10> fb01qd_documented = {7, 6, 15, 3, 0, 6, 0, 0, 0, 0};
constexpr std::array<long, 10> fb01sd_documented = {7, 21, 6, 6, 0, 3, 0, 0, 0, 0};
constexpr std::array<long, 10> fb01rd_documented = {1, 6, 9, 0, 0, 12, 0, 0, 0, 4};
constexpr std::array<long, 10> fb01td_documented = {1, 9, 6, 12, 0, 0, 4, 0, 0, 0};
constexpr std::array<long, 10> fb01vd_documented = {9, 3, 18, 0, 0, 0, 0, 0, 0, 0};

// 7/6 n^3 + n^2 (5p/2 + m) + n (p^2 + m^2/2).
TEST(OperationCounts, FB01QD) {
  EXPECT_EQ(leading([](int n, int m, int p) { return fb01qd(n, m, p, false); }), fb01qd_documented);
}

// B Q^{1/2} is n m^2/2 of them.
TEST(OperationCounts, FB01QDOfAProduct) {
  auto expected = fb01qd_documented;
  expected[3] = 0;
  EXPECT_EQ(leading([](int n, int m, int p) { return fb01qd(n, m, p, true); }), expected);
}

// 7/6 n^3 + n^2 (7m/2 + p) + n (p^2/2 + m^2).
TEST(OperationCounts, FB01SD) {
  EXPECT_EQ(leading([](int n, int m, int p) { return information(false, n, m, p, false); }), fb01sd_documented);
}

// 1/6 n^3 + n^2 (3p/2 + m) + 2 n p^2 + 2/3 p^3 are documented. The terms of lower order in n are fewer here.
TEST(OperationCounts, FB01RD) {
  const auto found = leading(fb01rd);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(found[i], fb01rd_documented[i]) << i;
  for (std::size_t i = 3; i < 10; ++i) EXPECT_LE(found[i], fb01rd_documented[i]) << i;
}

// 1/6 n^3 + n^2 (3m/2 + p) + 2 n m^2 + 2/3 m^3.
TEST(OperationCounts, FB01TD) {
  const auto found = leading([](int n, int m, int p) { return information(true, n, m, p, true); });
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(found[i], fb01td_documented[i]) << i;
  for (std::size_t i = 3; i < 10; ++i) EXPECT_LE(found[i], fb01td_documented[i]) << i;
}

// 3/2 n^3 + n^2 (3p + m/2) are documented; half of n^2 3p, and the terms that the text leaves out.
TEST(OperationCounts, FB01VD) {
  const auto found = leading(fb01vd);
  EXPECT_EQ(found[0], fb01vd_documented[0]);
  EXPECT_EQ(found[1], fb01vd_documented[1]);
  EXPECT_EQ(found[2], fb01vd_documented[2] / 2);
  EXPECT_EQ(found[3], 6);  // B Q
}

/// "7/6 n^3 + n^2 m", from six times the coefficients.
std::string polynomial(const std::array<long, 10>& six_times) {
  std::string text;
  for (std::size_t i = 0; i < monomials.size(); ++i) {
    const long c = six_times[i];
    if (c == 0) continue;
    const long divisor = std::gcd(c, 6L), numerator = c / divisor, denominator = 6 / divisor;
    text += text.empty() ? "" : " + ";
    if (denominator != 1 || numerator != 1) text += std::to_string(numerator);
    if (denominator != 1) text += "/" + std::to_string(denominator);
    if (denominator != 1 || numerator != 1) text += " ";
    const char* names = "nmp";
    std::string factors;
    for (std::size_t v = 0; v < 3; ++v)
      if (monomials[i][v] > 0)
        factors += (factors.empty() ? "" : " ") + std::string(1, names[v]) +
                   (monomials[i][v] > 1 ? "^" + std::to_string(monomials[i][v]) : "");
    text += factors;
  }
  return text;
}

std::string table() {
  struct Row {
    const char *routine, *mode;
    Count count;
    std::array<long, 10> documented;
  };
  const Row rows[] = {
      {"FB01QD", "no gain", [](int n, int m, int p) { return fb01qd(n, m, p, false); }, fb01qd_documented},
      {"FB01QD", "no gain, B Q^{1/2} given", [](int n, int m, int p) { return fb01qd(n, m, p, true); }, {}},
      {"FB01RD", "no gain, B Q^{1/2} given", fb01rd, fb01rd_documented},
      {"FB01SD", "no state", [](int n, int m, int p) { return information(false, n, m, p, false); }, fb01sd_documented},
      {"FB01SD", "no state, R^{-1/2} C given", [](int n, int m, int p) { return information(false, n, m, p, true); }, {}},
      {"FB01TD", "no state, R^{-1/2} C given", [](int n, int m, int p) { return information(true, n, m, p, true); },
       fb01td_documented},
      {"FB01VD", "", fb01vd, fb01vd_documented},
  };
  std::string text = "| routine | mode | counted here | documented |\n| --- | --- | --- | --- |\n";
  for (const Row& row : rows)
    text += "| `" + std::string(row.routine) + "` | " + row.mode + " | " + polynomial(leading(row.count)) + " | " +
            polynomial(row.documented) + " |\n";
  return text;
}

// The page's table is what is counted, to the letter. To renew it put what this test prints between the two marks.
TEST(OperationCounts, ThePageSaysWhatIsCounted) {
  std::ifstream file(KFSTAB_SOURCE_DIR "/docs/operation-counts.md");
  const std::string page((std::istreambuf_iterator<char>(file)), {});
  const std::string begin = "<!-- counts: begin -->\n", end = "<!-- counts: end -->";
  const auto from = page.find(begin), to = page.find(end);
  ASSERT_TRUE(from != std::string::npos && to != std::string::npos);
  EXPECT_EQ(page.substr(from + begin.size(), to - from - begin.size()), table()) << table();
}

}  // namespace
}  // namespace kfstab::test
