// What a step of the reference costs, beside what else one might use. Prints Markdown; given a file, puts it there
// between the markers.
//
//   kfstab_reference_benchmark [docs/performance.md]

#include <time.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <functional>
#include <iostream>
#include <limits>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <Eigen/Cholesky>
#include <boost/multiprecision/cpp_bin_float.hpp>
#include <boost/multiprecision/eigen.hpp>

#include <kfstab/properties/generators.hpp>
#include <kfstab/reference/detail/recursion.hpp>

#include "page.hpp"

#ifdef KFSTAB_ARB
#include <arb_mat.h>
#endif

namespace kfstab::reference {
namespace {

namespace mp = boost::multiprecision;

constexpr double absent = std::numeric_limits<double>::quiet_NaN();

// ---- the system ----

/// Dense, with n states and half as many noises and outputs; the same for everybody.
Problem<CovarianceModel<double>> random_problem(Index n) {
  std::mt19937_64 random(static_cast<std::uint64_t>(n));
  const auto matrix = [&](Index rows, Index cols, double scale) {
    Matrix<double> X(rows, cols);
    for (Index j = 0; j < cols; ++j)
      for (Index i = 0; i < rows; ++i) X(i, j) = scale * (static_cast<double>(random() >> 11) * 0x1p-52 - 1);
    return X;
  };
  const auto covariance = [&](Index size) {
    Matrix<double> X = matrix(size, size, 1);
    X = (X.lazyProduct(X.transpose()) + Matrix<double>::Identity(size, size)).eval();
    return Matrix<double>(X.selfadjointView<Eigen::Lower>());
  };
  const Index half = std::max<Index>(1, n / 2);
  CovarianceModel<double> model;
  model.A = matrix(n, n, 1.5 / std::sqrt(static_cast<double>(n)));
  model.B = matrix(n, half, 1);
  model.C = matrix(half, n, 1);
  model.D.resize(n, 0);
  model.Q = covariance(half);
  model.R = covariance(half);
  Problem<CovarianceModel<double>> problem;
  problem.models.push_back(model);
  problem.initial = covariance(n);
  problem.x0 = Vector<double>::Zero(n);
  return problem;
}

/// Multiply-adds of a step, symmetric products by one triangle.
double terms_of_step(Index n_, Index p_) {
  const auto n = static_cast<double>(n_), p = static_cast<double>(p_);
  const double n_triangle = n * (n + 1) / 2, p_triangle = p * (p + 1) / 2;
  return n * n * p          // P C'
         + p_triangle * n   // Re
         + p * p * p / 2    // L, L^{-1}, Re^{-1}
         + 2 * n * n * p    // Kf C, K C
         + n * p * p        // Kf
         + n * n * p        // K
         + n * n * n        // J P
         + n_triangle * n   // J P J'
         + n * p * p        // Kf R
         + n_triangle * p   // Kf R Kf'
         + n * n * n        // A P_{k|k}
         + n_triangle * n;  // A P_{k|k} A'
}

// ---- the contenders: each is made for one size, and does one step when called ----

using Contender = std::function<void()>;

/// What the reference's own run does.
template <class T>
Contender reference_step(const AnyProblem<double>& problem) {
  auto recursion = std::make_shared<detail::Recursion<T, detail::Form::joseph>>(detail::Source(&problem), false);
  return [recursion] { recursion->advance({}); };
}

/// What a caller pays for digits that are certified.
Contender certified_step(const AnyProblem<double>& problem, int digits) {
  auto trajectory = std::make_shared<Trajectory>(problem, nullptr, Request{digits});
  return [trajectory] { trajectory->advance(); };
}

/// As one writes it down with Eigen.
template <class T>
Contender eigen_step(const Problem<CovarianceModel<double>>& problem) {
  struct Run {
    Matrix<T> A, C, R, BQB, P, Re, Re_inverse, Kf, K, F, J, filtered;
  };
  auto run = std::make_shared<Run>();
  const auto& m = problem.models.front();
  run->A = m.A.cast<T>();
  run->C = m.C.cast<T>();
  run->R = m.R.cast<T>();
  run->BQB = m.B.cast<T>() * m.Q.cast<T>() * m.B.cast<T>().transpose();
  run->P = problem.initial.cast<T>();
  return [run] {
    Run& r = *run;
    const Matrix<T> PC = r.P * r.C.transpose();
    r.Re = r.R + r.C * PC;
    r.Re_inverse = r.Re.llt().solve(Matrix<T>::Identity(r.Re.rows(), r.Re.rows()));
    r.Kf = PC * r.Re_inverse;
    r.K = r.A * r.Kf;
    r.J = Matrix<T>::Identity(r.A.rows(), r.A.rows()) - r.Kf * r.C;
    r.filtered = r.J * r.P * r.J.transpose() + r.Kf * r.R * r.Kf.transpose();
    r.P = r.A * r.filtered * r.A.transpose() + r.BQB;
    r.F = r.A - r.K * r.C;
  };
}

/// As many multiplications and additions of mpfr, over numbers that lie in the cache.
template <class T>
Contender bare_step(double terms) {
  struct Run {
    std::array<T, 64> x, y;
    T sum, scratch;
    std::int64_t count;
  };
  auto run = std::make_shared<Run>();
  std::mt19937_64 random(1);
  for (auto* list : {&run->x, &run->y})
    for (T& x : *list) x = 1 / T(1 + random() % 1000000);
  run->sum = 0;
  run->count = static_cast<std::int64_t>(terms);
  return [run] {
    for (std::int64_t l = 0; l < run->count; ++l)
      detail::add_product(run->sum, run->x[l % 64], run->y[l % 64], run->scratch);
  };
}

#ifdef KFSTAB_ARB
/// The same recursion in balls. They grow, so each step starts from the same P.
class ArbStep {
 public:
  ArbStep(const Problem<CovarianceModel<double>>& problem, long bits)
      : n_(problem.initial.rows()), p_(problem.models.front().C.rows()), bits_(bits) {
    const auto& m = problem.models.front();
    const Matrix<double> BQB = m.B * m.Q * m.B.transpose();
    set(A_, m.A);
    set(A_transposed_, m.A.transpose());
    set(C_, m.C);
    set(C_transposed_, m.C.transpose());
    set(R_, m.R);
    set(BQB_, BQB);
    set(P_, problem.initial);
    for (auto* X : {&PC_, &Kf_, &K_, &KfR_}) arb_mat_init(*X, n_, p_);
    for (auto* X : {&Re_, &Re_inverse_}) arb_mat_init(*X, p_, p_);
    for (auto* X : {&J_, &J_transposed_, &F_, &W_, &filtered_, &next_, &product_}) arb_mat_init(*X, n_, n_);
    arb_mat_init(Kf_transposed_, p_, n_);
    // entries of full length
    for (int k = 0; k < 3; ++k) {
      step();
      arb_mat_get_mid(P_, next_);
    }
  }
  ArbStep(const ArbStep&) = delete;
  ~ArbStep() {
    for (auto* X : {&A_,
                    &A_transposed_,
                    &C_,
                    &C_transposed_,
                    &R_,
                    &BQB_,
                    &P_,
                    &PC_,
                    &Kf_,
                    &K_,
                    &KfR_,
                    &Re_,
                    &Re_inverse_,
                    &J_,
                    &J_transposed_,
                    &F_,
                    &W_,
                    &filtered_,
                    &next_,
                    &product_,
                    &Kf_transposed_})
      arb_mat_clear(*X);
  }

  void step() {
    arb_mat_mul(PC_, P_, C_transposed_, bits_);
    arb_mat_mul(Re_, C_, PC_, bits_);
    arb_mat_add(Re_, Re_, R_, bits_);
    arb_mat_spd_inv(Re_inverse_, Re_, bits_);
    arb_mat_mul(Kf_, PC_, Re_inverse_, bits_);
    arb_mat_mul(K_, A_, Kf_, bits_);
    arb_mat_mul(product_, Kf_, C_, bits_);
    arb_mat_one(J_);
    arb_mat_sub(J_, J_, product_, bits_);
    arb_mat_transpose(J_transposed_, J_);
    arb_mat_mul(W_, J_, P_, bits_);
    arb_mat_mul(filtered_, W_, J_transposed_, bits_);
    arb_mat_mul(KfR_, Kf_, R_, bits_);
    arb_mat_transpose(Kf_transposed_, Kf_);
    arb_mat_mul(product_, KfR_, Kf_transposed_, bits_);
    arb_mat_add(filtered_, filtered_, product_, bits_);
    arb_mat_mul(W_, A_, filtered_, bits_);
    arb_mat_mul(next_, W_, A_transposed_, bits_);
    arb_mat_add(next_, next_, BQB_, bits_);
    arb_mat_mul(product_, K_, C_, bits_);
    arb_mat_sub(F_, A_, product_, bits_);
  }

 private:
  static void set(arb_mat_t& to, const Matrix<double>& X) {
    arb_mat_init(to, X.rows(), X.cols());
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = 0; i < X.rows(); ++i) arb_set_d(arb_mat_entry(to, i, j), X(i, j));
  }

  Index n_, p_;
  long bits_;
  arb_mat_t A_, A_transposed_, C_, C_transposed_, R_, BQB_, P_, PC_, Kf_, K_, KfR_, Re_, Re_inverse_, J_, J_transposed_,
      F_, W_, filtered_, next_, product_, Kf_transposed_;
};
#endif

Contender arb_step([[maybe_unused]] const Problem<CovarianceModel<double>>& problem, [[maybe_unused]] long bits) {
#ifdef KFSTAB_ARB
  auto run = std::make_shared<ArbStep>(problem, bits);
  return [run] { run->step(); };
#else
  return {};
#endif
}

// ---- measuring ----

/// Of this thread: what else the machine does shall not count.
double processor_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double seconds_of(const Contender& contender, int times) {
  const double start = processor_seconds();
  for (int k = 0; k < times; ++k) contender();
  return processor_seconds() - start;
}

/// Microseconds a step, medians over rounds in which all take turns.
std::vector<double> measure(const std::vector<Contender>& contenders) {
  constexpr int rounds = 7;
  constexpr double seconds_of_a_turn = 0.005;
  std::vector<int> times;
  for (const Contender& contender : contenders) {
    if (contender) seconds_of(contender, 2);  // caches, and entries of full length
    const double once = contender ? seconds_of(contender, 1) : 1;
    times.push_back(std::clamp(static_cast<int>(seconds_of_a_turn / once), 1, 5000));
  }
  std::vector<std::vector<double>> all(contenders.size());
  for (int round = 0; round < rounds; ++round)
    for (std::size_t k = 0; k < contenders.size(); ++k)
      if (contenders[k]) all[k].push_back(1e6 * seconds_of(contenders[k], times[k]) / times[k]);
  std::vector<double> medians;
  for (auto& list : all) {
    std::sort(list.begin(), list.end());
    medians.push_back(list.empty() ? absent : list[list.size() / 2]);
  }
  return medians;
}

std::string cell(double microseconds) {
  if (std::isnan(microseconds)) return "not there";
  char text[32];
  std::snprintf(text, sizeof text, microseconds < 10 ? "%.2f" : microseconds < 100 ? "%.1f" : "%.0f", microseconds);
  return text;
}

template <unsigned digits>
void rows(std::ostream& out) {
  using T = Real<digits>;
  using Binary = mp::number<mp::cpp_bin_float<digits>, mp::et_off>;
  using Variable = mp::number<mp::mpfr_float_backend<0>, mp::et_off>;
  Variable::default_precision(digits);
  for (const Index n : {2, 4, 8, 16, 32, 64}) {
    const auto problem = random_problem(n);
    const AnyProblem<double> any = problem;
    const Index p = problem.models.front().C.rows();
    const long bits = mpfr_get_prec(T().backend().data());
    const std::vector<double> t =
        measure({reference_step<T>(any), certified_step(any, digits), eigen_step<Binary>(problem),
                 eigen_step<Variable>(problem), bare_step<T>(terms_of_step(n, p)), arb_step(problem, bits)});
    out << "| " << digits << " | " << n;
    for (const double cost : t) out << " | " << cell(cost);
    for (const std::size_t k : {2, 4, 5}) {
      char text[32];
      std::snprintf(text, sizeof text, "%.2f", t[k] / t[0]);
      out << " | " << (std::isnan(t[k]) ? "" : text);
    }
    out << " |\n" << std::flush;
  }
}

// ---- a product alone ----

template <class T>
Matrix<T> random_matrix(std::mt19937_64& random, Index n) {
  Matrix<T> X(n, n);
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < n; ++i) X(i, j) = (T(random() % 1000000) - 500000) / T(1 + random() % 1000000);
  return X;
}

/// Each entry by mpfr_mul and mpfr_add, one after the other.
template <class T>
Contender plain_product(const Matrix<T>& X, const Matrix<T>& Y) {
  return [=, Z = X, sum = T(), scratch = T()]() mutable {
    for (Index j = 0; j < Y.cols(); ++j)
      for (Index i = 0; i < X.rows(); ++i) {
        sum = 0;
        for (Index l = 0; l < X.cols(); ++l) detail::add_product(sum, X(i, l), Y(l, j), scratch);
        Z(i, j) = sum;
      }
  };
}

template <class T>
Contender product_by_dots(const Matrix<T>& X, const Matrix<T>& Y) {
  return [=, Z = X]() mutable {
    detail::multiply_by_dots(detail::results(Z), detail::Into::set, detail::entries(X), detail::entries(Y),
                             {X.rows(), X.cols(), Y.cols()}, detail::Structure::general);
  };
}

template <class T>
Contender product_by_splitting(const Matrix<T>& X, const Matrix<T>& Y, detail::Vectors vectors) {
  if (vectors > detail::widest_vectors()) return {};
  return [=, Z = X]() mutable {
    detail::multiply_by_splitting(detail::results(Z), detail::Into::set, detail::entries(X), detail::entries(Y),
                                  {X.rows(), X.cols(), Y.cols()}, detail::Structure::general, vectors);
  };
}

template <class T>
Contender product_by_arb([[maybe_unused]] const Matrix<T>& X, [[maybe_unused]] const Matrix<T>& Y) {
#ifdef KFSTAB_ARB
  struct Run {
    arb_mat_t X, Y, Z;
    ~Run() {
      for (auto* M : {&X, &Y, &Z}) arb_mat_clear(*M);
    }
  };
  auto run = std::make_shared<Run>();
  for (auto* M : {&run->X, &run->Y, &run->Z}) arb_mat_init(*M, X.rows(), X.rows());
  for (Index j = 0; j < X.rows(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      arf_set_mpfr(arb_midref(arb_mat_entry(run->X, i, j)), X(i, j).backend().data());
      arf_set_mpfr(arb_midref(arb_mat_entry(run->Y, i, j)), Y(i, j).backend().data());
    }
  const long bits = mpfr_get_prec(X(0, 0).backend().data());
  return [run, bits] { arb_mat_mul(run->Z, run->X, run->Y, bits); };
#else
  return {};
#endif
}

template <unsigned digits>
void product_rows(std::ostream& out) {
  using T = Real<digits>;
  std::mt19937_64 random(1);
  for (const Index n : {4, 8, 16, 32, 64}) {
    const Matrix<T> X = random_matrix<T>(random, n), Y = random_matrix<T>(random, n);
    const std::vector<double> t =
        measure({plain_product(X, Y), product_by_dots(X, Y), product_by_splitting(X, Y, detail::Vectors::of_2),
                 product_by_splitting(X, Y, detail::Vectors::of_4), product_by_splitting(X, Y, detail::Vectors::of_8),
                 product_by_arb(X, Y)});
    out << "| " << (mpfr_get_prec(X(0, 0).backend().data()) + 63) / 64 << " | " << n;
    for (const double cost : t) out << " | " << cell(1000 * cost / static_cast<double>(n * n * n));
    out << " |\n" << std::flush;
  }
}

/// Wall-clock seconds for the reference of 1000 random systems on two threads.
double seconds_of_random_systems() {
  constexpr int count = 1000;
  properties::Options options;
  options.n = {1, 8};
  std::vector<AnyProblem<double>> problems;
  const auto systems = properties::systems(options);
  for (int k = 0; k < count; ++k) {
    auto problem = properties::problem(properties::drawn_system(systems, 1, k, count), Parametrisation::covariance);
    problems.push_back(std::get<AnyProblem<double>>(std::move(problem)));
  }
  std::atomic<int> next = 0;
  const auto start = std::chrono::steady_clock::now();
  {
    const auto work = [&] {
      for (int k = next++; k < count; k = next++) {
        Trajectory trajectory(problems[static_cast<std::size_t>(k)], nullptr, Request{50});
        for (int step = 0; step < 20; ++step) trajectory.advance();
      }
    };
    const std::jthread one(work), two(work);
  }
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

std::string report() {
  std::ostringstream out;
  static constexpr const char* vectors[] = {"2", "4", "8"};
  out << "On " << performance::processor() << ", vectors of " << vectors[static_cast<int>(detail::widest_vectors())]
      << " doubles, mpfr " << mpfr_get_version() << ", gmp " << gmp_version
#ifdef KFSTAB_ARB
      << ", Arb " << arb_version
#endif
      << ".\n\nMicroseconds a step:\n\n| digits | n | reference | with certificate | cpp_bin_float | mpfr_float | bare "
         "| Arb | cpp_bin_float / "
         "reference | bare / reference | Arb / reference |\n|---|---|---|---|---|---|---|---|---|---|---|\n";
  rows<30>(out);
  rows<50>(out);
  rows<100>(out);
  char text[100];
  std::snprintf(text, sizeof text, "%.2f", seconds_of_random_systems());
  out << "\n1000 random systems (n <= 8), 20 steps each, 50 digits certified, on 2 threads: " << text
      << " s of wall clock.\n";
  out << "\nn x n matrices with entries of full length, nanoseconds a multiply-add:\n\n"
         "| limbs | n | mpfr_mul, mpfr_add | fused_dot | split, 2 doubles | split, 4 | split, 8 | Arb |\n"
         "|---|---|---|---|---|---|---|---|\n";
  product_rows<38>(out);
  product_rows<57>(out);
  product_rows<76>(out);
  product_rows<115>(out);
  product_rows<211>(out);
  return out.str();
}

}  // namespace
}  // namespace kfstab::reference

int main(int count, char** arguments) {
  const std::string text = kfstab::reference::report();
  std::cout << text;
  if (count > 1 && !performance::put_between_markers(arguments[1], "kfstab_reference_benchmark", text)) {
    std::cerr << arguments[1] << ": there are no markers\n";
    return 2;
  }
}
