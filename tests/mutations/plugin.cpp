// One filter of the registry, or a copy of it with a bug, as a plug-in of kfstab_filter.h. Compiled with
//   -DKFSTAB_HEADER='<kfstab/filters/NAME.hpp>' -DKFSTAB_CLASS=TheClass -DKFSTAB_ID='"id"'
// Filters that have kernels for double are taken in long double, for which their plain text stands.
#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <type_traits>

#include KFSTAB_HEADER
#include <kfstab_filter.h>

namespace {

using namespace kfstab;

using Filter = KFSTAB_CLASS<KFSTAB_SCALAR>;
using Scalar = Filter::Scalar;
using Model = Filter::Model;
constexpr Parametrisation takes = Model::parametrisation;
constexpr bool information = takes == Parametrisation::information;
template <class F>
constexpr bool has_predictor_gain = requires(F f) {
  f.predictor_gain();
};
constexpr bool answers_filter_gain = !has_predictor_gain<Filter>;

Matrix<Scalar> matrix(const double* entries, Index rows, Index cols) {
  Matrix<Scalar> X(rows, cols);
  for (Index i = 0; i < rows; ++i)
    for (Index j = 0; j < cols; ++j) X(i, j) = entries[i * cols + j];
  return X;
}

Vector<Scalar> vector(const double* entries, Index size) { return matrix(entries, size, 1).col(0); }

/// Lower L, LL' = X; nothing if X is not positive definite.
std::optional<Matrix<Scalar>> lower_root(const Matrix<Scalar>& X) {
  const Index n = X.rows();
  Matrix<Scalar> L = Matrix<Scalar>::Zero(n, n);
  for (Index j = 0; j < n; ++j) {
    for (Index i = j; i < n; ++i) {
      Scalar s = X(i, j);
      for (Index k = 0; k < j; ++k) s -= L(i, k) * L(j, k);
      if (i == j && !(s > 0)) return std::nullopt;
      L(i, j) = i == j ? std::sqrt(s) : s / L(j, j);
    }
  }
  return L;
}

/// U^{-1} of an upper U.
Matrix<Scalar> inverse_upper(const Matrix<Scalar>& U) {
  const Index n = U.rows();
  Matrix<Scalar> X = Matrix<Scalar>::Zero(n, n);
  for (Index j = 0; j < n; ++j)
    for (Index i = j; i >= 0; --i) {
      Scalar s = i == j ? 1 : 0;
      for (Index k = i + 1; k <= j; ++k) s -= U(i, k) * X(k, j);
      X(i, j) = s / U(i, i);
    }
  return X;
}

/// Upper T, T'T = X^{-1}.
std::optional<Matrix<Scalar>> information_root(const Matrix<Scalar>& X) {
  const auto L = lower_root(X.reverse());
  if (!L) return std::nullopt;
  return inverse_upper(L->reverse());
}

/// A^{-1} by Gauss and Jordan, with pivots.
std::optional<Matrix<Scalar>> inverse(Matrix<Scalar> A) {
  const Index n = A.rows();
  Matrix<Scalar> X = Matrix<Scalar>::Identity(n, n);
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    for (Index i = k; i < n; ++i)
      if (std::abs(A(i, k)) > std::abs(A(pivot, k))) pivot = i;
    if (A(pivot, k) == 0) return std::nullopt;
    A.row(k).swap(A.row(pivot));
    X.row(k).swap(X.row(pivot));
    const Scalar d = A(k, k);
    A.row(k) /= d;
    X.row(k) /= d;
    for (Index i = 0; i < n; ++i) {
      if (i == k) continue;
      const Scalar f = A(i, k);
      A.row(i) -= f * A.row(k);
      X.row(i) -= f * X.row(k);
    }
  }
  return X;
}

struct Instance {
  Instance(Dimensions d) : filter(d) {}
  Filter filter;
};

/// The numbers of a step in the filter's parametrisation.
template <class M>
std::optional<M> model_of(const kfstab_filter_input& in) {
  M model;
  const Matrix<Scalar> A = matrix(in.A, in.n, in.n), B = matrix(in.B, in.n, in.m), Q = matrix(in.Q, in.m, in.m),
                       R = matrix(in.R, in.p, in.p);
  model.C = matrix(in.C, in.p, in.n);
  model.D = in.D ? matrix(in.D, in.n, in.inputs) : Matrix<Scalar>(in.n, 0);
  if constexpr (takes == Parametrisation::covariance) {
    model.A = A, model.B = B, model.Q = Q, model.R = R;
  } else if constexpr (takes == Parametrisation::root) {
    const auto Q_root = lower_root(Q), R_root = lower_root(R);
    if (!Q_root || !R_root) return std::nullopt;
    model.A = A, model.B = B, model.Q_root = *Q_root, model.R_root = *R_root;
  } else {
    const auto A_inverse = inverse(A);
    const auto Q_root = information_root(Q), R_root = information_root(R);
    if (!A_inverse || !Q_root || !R_root) return std::nullopt;
    model.A_inverse = *A_inverse, model.A_inverse_B = A_inverse->lazyProduct(B);
    model.Q_inverse_root = *Q_root, model.R_inverse_root = *R_root;
  }
  return model;
}

template <class X>
void store(const X& from, double* to) {
  for (Index i = 0; i < from.rows(); ++i)
    for (Index j = 0; j < from.cols(); ++j) to[i * from.cols() + j] = static_cast<double>(from(i, j));
}

/// What the filter holds, as P or as a root of it.
template <class F>
void answer_held(const F& filter, kfstab_filter_answer& answer) {
  if constexpr (requires { filter.covariance(); }) {
    store(filter.covariance(), answer.P);
  } else if constexpr (requires { filter.information(); }) {
    const auto root = information_root(filter.information());  // T'T = Y^{-1} = P
    if (root)
      store(Matrix<Scalar>(root->transpose()), answer.S);
    else
      std::fill(answer.S, answer.S + filter.information().size(), std::nan(""));
    answer.has_S = 1;
  } else {
    if constexpr (requires { filter.factor(); }) store(filter.factor(), answer.S);
    if constexpr (requires { filter.covariance_root(); }) store(filter.covariance_root(), answer.S);
    if constexpr (requires { filter.information_factor(); })
      store(inverse_upper(filter.information_factor()), answer.S);
    if constexpr (requires { filter.ud_factors(); }) {
      Matrix<Scalar> S = filter.ud_factors();
      for (Index j = 0; j < S.cols(); ++j) {
        const Scalar d = std::sqrt(S(j, j));
        S(j, j) = 1;
        S.col(j) *= d;
      }
      store(S, answer.S);
    }
    answer.has_S = 1;
  }
}

template <class F>
int advance(F& f, const kfstab_filter_input& in, kfstab_filter_answer& answer) {
  const auto model = model_of<typename F::Model>(in);
  if (!model) {
    answer.why = "a matrix is not positive definite, or A is singular";
    return 1;
  }
  const Vector<Scalar> y = in.y ? vector(in.y, in.p) : Vector<Scalar>::Zero(in.p);
  const Vector<Scalar> u = in.u ? vector(in.u, in.inputs) : Vector<Scalar>();
  const Vector<Scalar>* input = in.u ? &u : nullptr;
  StepReport<Scalar> report;
  if constexpr (information)
    report = f.step(*model, *model, &y, input);
  else
    report = f.step(*model, &y, input);
  if (!report) {
    answer.why = name(report.status);
    return 1;
  }
  store(f.state(), answer.x);
  answer_held(f, answer);
  if constexpr (has_predictor_gain<F>)
    store(f.predictor_gain(), answer.K);
  else
    store(f.filter_gain(), answer.K);
  answer.has_K = 1;
  return 0;
}

}  // namespace

extern "C" {

int kfstab_filter_abi() { return KFSTAB_FILTER_ABI; }

const kfstab_filter_description* kfstab_filter_describe() {
  static const kfstab_filter_description description{
      KFSTAB_ID, information ? "predict-update" : "update-predict", answers_filter_gain ? "filter" : "predictor",
      takes == Parametrisation::covariance ? "measurement-every-step"
      : information ? "measurement-every-step invertible-A positive-definite-Q positive-definite-R positive-definite-P0"
                    : "measurement-every-step positive-definite-Q positive-definite-R positive-definite-P0",
      nullptr};
  return &description;
}

void* kfstab_filter_create(int n, int m, int p, const double* x, const double* P, const char** why) {
  auto instance = std::make_unique<Instance>(Dimensions{n, m, p});
  Matrix<Scalar> initial = matrix(P, n, n);
  if constexpr (takes != Parametrisation::covariance) {
    const auto root = information ? information_root(initial) : lower_root(initial);
    if (!root) {
      *why = "P0 is not positive definite";
      return nullptr;
    }
    initial = *root;
  }
  instance->filter.start(initial, vector(x, n));
  return instance.release();
}

int kfstab_filter_step(void* filter, const kfstab_filter_input* in, kfstab_filter_answer* answer) {
  return advance(static_cast<Instance*>(filter)->filter, *in, *answer);
}

void kfstab_filter_destroy(void* filter) { delete static_cast<Instance*>(filter); }
}
