// SLICOT 5.0, loaded when the program runs: who has not got it sees that in the table.

#include <dlfcn.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <memory>

#include <Eigen/Cholesky>

#include <kfstab/filters/slicot/slicot.h>
#include <kfstab/filters/matrix.hpp>

#include "contenders.hpp"

extern "C" {
void dgemm_(const char*, const char*, const int*, const int*, const int*, const double*, const double*, const int*,
            const double*, const int*, const double*, double*, const int*);
char* openblas_get_corename();
}

namespace performance {
namespace {

using Matrix = kfstab::Matrix<double>;

/// OpenBLAS may not know a processor that is younger than itself, and then takes its slowest kernels; or somebody's environment
/// names kernels for the oldest of many machines. What this machine has is said before the library is loaded.
void* load() {
  setenv("OPENBLAS_NUM_THREADS", "1", 1);
#if defined(__x86_64__)
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512vl"))
    setenv("OPENBLAS_CORETYPE", "SKYLAKEX", 1);
  else if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
    setenv("OPENBLAS_CORETYPE", "HASWELL", 1);
#endif
  return dlopen("libslicot.so.0", RTLD_NOW | RTLD_LOCAL);
}

void* library() {
  static void* const handle = load();
  return handle;
}

// Fortran adds the lengths of the letters at the end.
template <class... Arguments>
auto with_lengths(void (*)(Arguments...)) -> void (*)(Arguments..., std::size_t, std::size_t, std::size_t);

/// SLICOT's routine, or one of the BLAS that it is linked to, with the arguments of `like`.
template <class Routine>
auto routine(Routine* like, const char* symbol) {
  const auto call = reinterpret_cast<decltype(with_lengths(like))>(dlsym(library(), symbol));
  return [call](auto... arguments) { call(arguments..., std::size_t{1}, std::size_t{1}, std::size_t{1}); };
}

Matrix matrix(const std::vector<double>& numbers, int rows, int cols) {
  return Eigen::Map<const Matrix>(numbers.data(), rows, cols);
}

std::vector<double> numbers(const Matrix& X) { return {X.data(), X.data() + X.size()}; }

/// The arrays of one routine, and what it writes over.
struct Arrays {
  Matrix X, A, B, C, Q, R, changed, gain, U;
  kfstab::Vector<double> x, y, z, e, work;
  std::vector<int> integers;
  int length = 0, info = 0;
  double tolerance = 0;
};

std::shared_ptr<Arrays> arrays(const Shape& shape) {
  const auto [n, m, p] = shape;
  auto a = std::make_shared<Arrays>();
  a->gain.setZero(n, p);
  a->U.setIdentity(n, n);
  a->integers.resize(static_cast<std::size_t>(std::max(n, p)));
  const int size = n + m + p;
  a->length = 4 * size * (size + 4);  // more than any of them asks for
  a->work.setZero(a->length);
  return a;
}

Maybe fb01qd(const System& s, bool condensed, bool gain) {
  const auto [n, m, p] = s.shape;
  auto a = arrays(s.shape);
  a->X = matrix(s.S0, n, n);
  a->A = matrix(s.A, n, n);
  a->B = matrix(s.B, n, m);
  a->C = matrix(s.C, p, n);
  a->Q = matrix(s.Q_root, m, m);
  a->R = matrix(s.R_root, p, p);
  if (condensed) {  // A := U'AU, C := C U; P0 = I in all coordinates
    routine(tb01nd_, "tb01nd_")("I", "L", &n, &p, a->A.data(), &n, a->C.data(), &p, a->U.data(), &n, a->work.data(),
                                &a->info);
    a->B = (a->U.transpose() * a->B).eval();
  }
  const auto call = condensed ? routine(fb01rd_, "fb01rd_") : routine(fb01qd_, "fb01qd_");
  return Contender{[=, n = n, m = m, p = p] {
                     a->changed = a->R;  // Re^{1/2} takes its place
                     call(gain ? "K" : "N", "N", &n, &m, &p, a->X.data(), &n, a->A.data(), &n, a->B.data(), &n,
                          a->Q.data(), &m, a->C.data(), &p, a->changed.data(), &p, a->gain.data(), &n, &a->tolerance,
                          a->integers.data(), a->work.data(), &a->length, &a->info);
                     return a->info == 0;
                   },
                   [a] {
                     const Matrix S = a->U * Matrix(a->X.triangularView<Eigen::Lower>());
                     return numbers(S * S.transpose());
                   }};
}

Maybe fb01sd(const System& s, bool condensed) {
  const auto [n, m, p] = s.shape;
  auto a = arrays(s.shape);
  a->A = matrix(s.A_inverse, n, n);
  a->B = matrix(s.A_inverse_B, n, m);
  a->C = matrix(s.C, p, n);
  a->Q = matrix(s.Q_inverse_root, m, m);
  a->R = matrix(s.R_inverse_root, p, p);
  a->x = matrix(s.x0, n, 1);
  a->z.setZero(m);
  a->e.setZero(p);
  if (condensed) {  // F := U'FU, H := U'H
    routine(tb01md_, "tb01md_")("I", "U", &n, &m, a->A.data(), &n, a->B.data(), &n, a->U.data(), &n, a->work.data(),
                                &a->info);
    a->C = (a->C * a->U).eval();
    a->x = (a->U.transpose() * a->x).eval();
  }
  const Matrix T0 = matrix(s.T0_filtered, n, n) * a->U;
  a->X = Matrix(T0.transpose() * T0).llt().matrixU();
  const Matrix R_inverse_root = a->R.triangularView<Eigen::Upper>();
  a->y = R_inverse_root * matrix(s.y, p, 1);
  const auto step = [=, n = n, m = m, p = p](const auto& call, auto... multab) {
    a->changed = a->Q;  // Qe^{-1/2} takes its place
    call("X", multab..., "N", &n, &m, &p, a->X.data(), &n, a->A.data(), &n, a->B.data(), &n,
         a->R.data(), &p, a->C.data(), &p, a->changed.data(), &m, a->x.data(), a->y.data(), a->z.data(), a->e.data(),
         &a->tolerance, a->integers.data(), a->work.data(), &a->length, &a->info);
    return a->info == 0;
  };
  return Contender{[=, dense = routine(fb01sd_, "fb01sd_"), hessenberg = routine(fb01td_, "fb01td_")] {
                     return condensed ? step(hessenberg) : step(dense, "P");
                   },
                   [a] {
                     const Matrix T = Matrix(a->X.triangularView<Eigen::Upper>()) * a->U.transpose();
                     return numbers(T.transpose() * T);
                   }};
}

Maybe fb01vd(const System& s) {
  const auto [n, m, p] = s.shape;
  auto a = arrays(s.shape);
  a->X = matrix(s.P0, n, n);
  a->A = matrix(s.A, n, n);
  a->B = matrix(s.B, n, m);
  a->C = matrix(s.C, p, n);
  a->Q = matrix(s.Q, m, m);
  a->R = matrix(s.R, p, p);
  const auto call = routine(fb01vd_, "fb01vd_");
  return Contender{[=, n = n, m = m, p = p] {
                     a->changed = a->R;  // the Cholesky factor of Re takes its place
                     call(&n, &m, &p, a->X.data(), &n, a->A.data(), &n, a->B.data(), &n, a->C.data(), &p, a->Q.data(),
                          &m, a->changed.data(), &p, a->gain.data(), &n, &a->tolerance, a->integers.data(),
                          a->work.data(), &a->length, &a->info);
                     return a->info == 0;
                   },
                   [a] { return numbers(a->X.selfadjointView<Eigen::Upper>()); }};
}

}  // namespace

Maybe slicot(const std::string& name, const System& system, bool gain) {
  if (!library()) return std::nullopt;
  if (name == "FB01VD") return fb01vd(system);
  if (name == "FB01QD" || name == "FB01RD") return fb01qd(system, name == "FB01RD", gain);
  return fb01sd(system, name == "FB01TD");
}

Maybe dgemm() {
  if (!library()) return std::nullopt;
  struct Run {
    Matrix X = Matrix::Random(dgemm_order, dgemm_order), Y = X, Z = X;
  };
  return Contender{[run = std::make_shared<Run>(), call = routine(dgemm_, "dgemm_")] {
    constexpr int n = dgemm_order;
    constexpr double one = 1, zero = 0;
    call("N", "N", &n, &n, &n, &one, run->X.data(), &n, run->Y.data(), &n, &zero, run->Z.data(), &n);
    return true;
  }};
}

std::string blas() {
  if (!library()) return "SLICOT is not there (Debian: libslicot-dev)";
  void* const found = dlsym(library(), "dgemm_");
  Dl_info info{};
  std::string text = found && dladdr(found, &info) ? info.dli_fname : "an unknown BLAS";
  if (const auto name = reinterpret_cast<decltype(&openblas_get_corename)>(dlsym(library(), "openblas_get_corename")))
    text += std::string(", OpenBLAS's kernels for ") + name();
  else
    text += ", which is not OpenBLAS (Debian: libopenblas-dev)";
  return text;
}

}  // namespace performance
