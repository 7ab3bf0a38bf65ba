#include "filters/plain_recursion.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <boost/multiprecision/mpfr.hpp>
#include <cmath>
#include <utility>

namespace kfstab::test {
namespace {

using Real =
    boost::multiprecision::number<boost::multiprecision::mpfr_float_backend<120, boost::multiprecision::allocate_stack>,
                                  boost::multiprecision::et_off>;

/// The least that the recursion needs, in loops: Eigen's products would cost more to compile than all the rest.
struct Dense {
  Index rows = 0, cols = 0;
  std::vector<Real> entries;

  Dense() = default;
  Dense(Index r, Index c) : rows(r), cols(c), entries(static_cast<std::size_t>(r * c), Real(0)) {}
  template <class Derived>
  Dense(const Eigen::MatrixBase<Derived>& X) : Dense(X.rows(), X.cols()) {
    for (Index j = 0; j < cols; ++j)
      for (Index i = 0; i < rows; ++i) (*this)(i, j) = Real(X(i, j));
  }

  Real& operator()(Index i, Index j) { return entries[static_cast<std::size_t>(i + j * rows)]; }
  const Real& operator()(Index i, Index j) const { return entries[static_cast<std::size_t>(i + j * rows)]; }

  Matrix<double> rounded() const {
    Matrix<double> X(rows, cols);
    for (Index j = 0; j < cols; ++j)
      for (Index i = 0; i < rows; ++i) X(i, j) = static_cast<double>((*this)(i, j));
    return X;
  }
};

Dense operator*(const Dense& X, const Dense& Y) {
  Dense Z(X.rows, Y.cols);
  for (Index j = 0; j < Y.cols; ++j)
    for (Index k = 0; k < X.cols; ++k)
      for (Index i = 0; i < X.rows; ++i) Z(i, j) += X(i, k) * Y(k, j);
  return Z;
}

Dense combined(const Dense& X, const Dense& Y, int sign) {
  Dense Z = X;
  for (std::size_t i = 0; i < Z.entries.size(); ++i) Z.entries[i] += sign * Y.entries[i];
  return Z;
}
Dense operator+(const Dense& X, const Dense& Y) { return combined(X, Y, 1); }
Dense operator-(const Dense& X, const Dense& Y) { return combined(X, Y, -1); }

Dense transposed(const Dense& X) {
  Dense Y(X.cols, X.rows);
  for (Index j = 0; j < X.cols; ++j)
    for (Index i = 0; i < X.rows; ++i) Y(j, i) = X(i, j);
  return Y;
}

Dense identity(Index n) {
  Dense X(n, n);
  for (Index i = 0; i < n; ++i) X(i, i) = 1;
  return X;
}

/// Gauss-Jordan with partial pivoting.
Dense inverse(Dense X) {
  Dense Y = identity(X.rows);
  for (Index k = 0; k < X.rows; ++k) {
    Index pivot = k;
    for (Index i = k + 1; i < X.rows; ++i)
      if (abs(X(i, k)) > abs(X(pivot, k))) pivot = i;
    for (Index j = 0; j < X.rows; ++j) {
      std::swap(X(k, j), X(pivot, j));
      std::swap(Y(k, j), Y(pivot, j));
    }
    const Real d = X(k, k);
    for (Index j = 0; j < X.rows; ++j) {
      X(k, j) /= d;
      Y(k, j) /= d;
    }
    for (Index i = 0; i < X.rows; ++i) {
      if (i == k) continue;
      const Real f = X(i, k);
      for (Index j = 0; j < X.rows; ++j) {
        X(i, j) -= f * X(k, j);
        Y(i, j) -= f * Y(k, j);
      }
    }
  }
  return Y;
}

/// Frobenius; an upper bound of the 2-norm.
double norm(const Dense& X) {
  Real s = 0;
  for (const Real& x : X.entries) s += x * x;
  return static_cast<double>(Real(sqrt(s)));
}

Dense lower_of(const Dense& X) {
  Dense L = X;
  for (Index j = 0; j < X.cols; ++j)
    for (Index i = 0; i < j; ++i) L(i, j) = 0;
  return L;
}
Dense upper_of(const Dense& X) { return transposed(lower_of(transposed(X))); }

/// Of a symmetric matrix given by its upper triangle.
Dense mirrored(const Dense& X) {
  Dense M = X;
  for (Index j = 0; j < X.cols; ++j)
    for (Index i = 0; i < j; ++i) M(j, i) = X(i, j);
  return M;
}

Dense sum(const Exact& parts) {
  Dense X(parts.front());
  for (std::size_t i = 1; i < parts.size(); ++i) X = X + Dense(parts[i]);
  return X;
}

/// One model, with Q and R as covariances whatever the problem takes.
struct Plain {
  Dense A, B, C, D, Q, R, w;

  explicit Plain(const CovarianceModel<double>& m)
      : A(m.A), B(m.B), C(m.C), D(m.D), Q(mirrored(m.Q)), R(mirrored(m.R)), w(m.B.cols(), 1) {}
  explicit Plain(const RootModel<double>& m) : A(m.A), B(m.B), C(m.C), D(m.D), w(m.B.cols(), 1) {
    const Dense q = lower_of(m.Q_root), r = lower_of(m.R_root);
    Q = q * transposed(q);
    R = r * transposed(r);
  }
  explicit Plain(const InformationModel<double>& m)
      : A(inverse(m.A_inverse)), B(A * Dense(m.A_inverse_B)), C(m.C), D(m.D), w(m.A_inverse_B.cols(), 1) {
    const Dense q = upper_of(m.Q_inverse_root), r = upper_of(m.R_inverse_root);
    Q = inverse(transposed(q) * q);
    R = inverse(transposed(r) * r);
    if (m.w_mean.size() > 0) w = Dense(m.w_mean);
  }
};

double trace(const Dense& X) {
  Real s = 0;
  for (Index i = 0; i < X.rows; ++i) s += X(i, i);
  return static_cast<double>(s);
}

double square(double x) { return x * x; }
double hypotenuse(double x, double y) { return std::sqrt(x * x + y * y); }

}  // namespace

struct PlainRecursion::Run {
  const Metadata& filter;
  double unit;  // u (n+m+p)
  std::vector<Plain> models;
  Dense P, x;            // predicted
  Dense Pf, xf, Kf, K;   // of the last step
  bool started = false;  // a step has been done
  Vector<double> last_u;

  // Bounds of the errors that the filter holds now: of P or of T'T, of the gain, of x.
  double e_held = 0, e_gain = 0, e_state = 0;
  double e_vector = 0;  // of d = Y x
  Real innovation_square = 0;
  double e_residual = 0;

  Run(const Metadata& judged, double roundoff) : filter(judged), unit(roundoff) {}

  bool predicts() const { return filter.instant == Instant::predicted; }

  const Plain& model(std::int64_t k) const { return models[static_cast<std::size_t>(k) % models.size()]; }

  void step(std::int64_t k, const Vector<double>* y, const Vector<double>* u) {
    const Plain& now = model(k);
    const Dense P_before = P, x_before = x, Pf_before = Pf, xf_before = xf;
    const Dense Re = now.R + now.C * P * transposed(now.C), Re_inverse = inverse(Re);
    Kf = P * transposed(now.C) * Re_inverse;
    K = now.A * Kf;
    Pf = P - Kf * now.C * P;
    Dense innovation(now.C.rows, 1);
    if (y) {
      innovation = Dense(*y) - now.C * x;
      xf = x + Kf * innovation;
      if (now.C.rows > 0) innovation_square = (transposed(innovation) * Re_inverse * innovation)(0, 0);
    }
    if (filter.holds == Held::information)
      normal_equation_bounds(k, Pf_before, xf_before, y);
    else if (filter.takes == Parametrisation::information)
      information_bounds(k, Pf_before, xf_before, y);
    else
      covariance_bounds(now, P_before, x_before, Re, Re_inverse, innovation, y, u);

    P = now.A * Pf * transposed(now.A) + now.B * now.Q * transposed(now.B);
    if (y) {
      x = now.A * xf + now.B * now.w;
      if (u) x = x + now.D * Dense(*u);
    }
    last_u = u ? *u : Vector<double>();
    started = true;
  }

  /// One step of the forms that take P or S. The errors that came in go through F = A - K C, and, where P may be
  /// unsymmetric, their antisymmetric part through the map of the coding: at most |A|^2 + |K C|^2 (gain, cp, downdate),
  /// twice |A|^2 and |F|^2 (mixed).
  void covariance_bounds(const Plain& now, const Dense& P0, const Dense& x0, const Dense& Re, const Dense& Re_inverse,
                         const Dense& innovation, const Vector<double>* y, const Vector<double>* u) {
    const double a = norm(now.A), c = norm(now.C), k = norm(K), f = norm(now.A - K * now.C);
    const double p = norm(P0), ire = norm(Re_inverse);
    const double kappa = std::max(1., norm(Re) * ire);  // of Re
    const double through_gain = a + k * c;              // >= |F|, and right for P and P' alike
    const double gain_in = through_gain * e_held * c * ire;

    double amplification = square(f);
    switch (filter.asymmetry) {
      case Asymmetry::none:
      case Asymmetry::textbook: break;
      case Asymmetry::mixed: amplification += 2 * square(a) + square(f); break;
      default: amplification += square(a) + square(norm(K * now.C));
    }

    const double b = norm(now.B), q = norm(now.Q), kf = norm(Kf);
    const double known = u ? norm(now.D) * u->norm() : 0;
    double gain_local, filter_gain_local, held_local;
    double state_local = y ? a * norm(x0) + (k + a * kf) * (y->norm() + c * norm(x0)) + known : 0;
    if (holds_root(filter.holds)) {
      // The pre-array's rows [A S  B Q^{1/2}] and its rows of Re^{1/2} are perturbed by u times their norm; the
      // triangular factor of the upper ones answers with its condition number, and so do the rows below, which follow
      // its rotation. It is no different where singular vectors take the place of that factor: the array of the second
      // decomposition has rows of (I - Kf C) S and Kf R^{1/2}, and |Kf C S| <= |S| (s1/sp).
      const Dense next = now.A * Pf * transposed(now.A) + now.B * now.Q * transposed(now.B);
      const double s = std::sqrt(trace(P0)), rows = hypotenuse(a * s, b * std::sqrt(trace(now.Q)));
      double loss = 1 + std::sqrt(kappa);
      gain_local = loss * std::sqrt(ire) * (rows + k * std::sqrt(norm(Re)));
      filter_gain_local = loss * std::sqrt(ire) * (s + kf * std::sqrt(norm(Re)));
      if (filter.needs.positive_definite_R) {
        // Scalar updates with the rows of Phi = R^{-1/2} C, whose whitening perturbs them by u k(R^{1/2}) |Phi|. With
        // Kw = Kf R^{1/2} = Pf Phi', and Sf a root of Pf, of the norms |Sf| <= |S|, |Sf' Phi'| <= 1:
        //   - dPhi changes Pf by Pf dPhi' Kw' and its transpose: |Sf| |S| (|Phi| |S|) u k(R^{1/2}), twice;
        //   - the rounding of one update, u |S| in the root, goes through I - Kw Phi of those that follow, whose norm
        //     is at most 1 + |S| |Phi|, against Sf.
        // So 1 + k(R^{1/2}) |Phi| |S| stands where k(Re^{1/2}) did, and R^{-1/2} where Re^{-1/2}. y and x enter by
        // y_w - Phi x, against Kw, and each x on the way is rounded too.
        const Dense R_inverse = inverse(now.R);
        const double r_inverse = std::sqrt(trace(R_inverse)), k_root = std::sqrt(trace(now.R)) * r_inverse;
        const double phi = std::sqrt(trace(transposed(now.C) * R_inverse * now.C));
        const double kw = std::sqrt(trace(Kf * now.R * transposed(Kf)));
        loss = 1 + k_root * phi * s;
        filter_gain_local = loss * s * r_inverse;
        gain_local = a * filter_gain_local;
        if (y) {
          const double on_the_way = norm(x0) + s * r_inverse * norm(innovation);
          const double residual = r_inverse * y->norm() + phi * on_the_way;
          state_local = a * ((1 + phi * s) * on_the_way + k_root * kw * residual) + known;
        }
      }
      held_local = 2 * loss * rows * std::sqrt(trace(next));  // d(S S') = dS S' + S dS'
    } else {
      // Re is rounded by u (|R| + |C|^2 |P|) and inverted; P+ is the difference of A P A' and K Re K'.
      const double re = norm(now.R) + square(c) * p;
      held_local = kappa * (square(a) * p + square(b) * q) + a * p * c * ire * re * ire * c * p * a;
      gain_local = k * kappa * (1 + re * ire) + a * p * c * ire;
      filter_gain_local = kf * kappa * (1 + re * ire) + p * c * ire;  // the same analysis without the factor A
    }
    const double e_predictor = gain_in + unit * gain_local;
    e_gain = e_predictor;
    if (filter.gain == GainKind::filter) e_gain = (1 + kf * c) * e_held * c * ire + unit * filter_gain_local;
    if (y) e_state = f * e_state + e_predictor * norm(innovation) + unit * state_local;
    e_held = amplification * e_held + unit * held_local;
  }

  /// One step of the forms that take T, in terms of Y = T'T. With N the columns of w of the pre-array, M those of x,
  /// and Z = (N'N)^{-1} N'M: the perturbation E of the array, u times its columns' norms, changes Y+ = M'M - M'N Z by
  /// (E [-Z; I])' [N M] [-Z; I] and its transpose, whose norm is at most |E| (|N| |Z| + |M|) |T+|, twice. x solves a
  /// least squares problem with the same array.
  void information_bounds(std::int64_t k, const Dense& Pf0, const Dense& xf0, const Vector<double>* y) {
    const Plain& now = model(k);
    const Dense Y = inverse(Pf), R_inverse = inverse(now.R);
    const double trace_Y = trace(Y), pf = norm(Pf);
    const double t_next = std::sqrt(trace_Y), c = norm(now.C), r_root = std::sqrt(trace(R_inverse));

    double amplification = 1, state_in = e_state, gain_of_information = 0;
    double column_w = 0, column_x, column_data = 0, z = 0, w_hat = 0;
    if (!started) {
      const double t = std::sqrt(trace(inverse(P)));
      column_x = hypotenuse(t, r_root * c);
      column_data = hypotenuse(t * norm(x), y ? r_root * y->norm() : 0);
    } else {
      const Plain& before = model(k - 1);
      const Dense A_inverse = inverse(before.A), AB = A_inverse * before.B, Y0 = inverse(Pf0);
      const Dense Q_inverse = inverse(before.Q), NM = transposed(AB) * Y0 * A_inverse;
      const Dense Qe_inverse = inverse(Q_inverse + transposed(AB) * Y0 * AB), Z = Qe_inverse * NM;
      const double t = std::sqrt(trace(Y0)), q_root = std::sqrt(trace(Q_inverse));
      const double known = norm(before.D) * last_u.norm();
      const double moved = norm(xf0) + norm(A_inverse) * known;
      z = norm(Z);
      column_w = hypotenuse(q_root, t * norm(AB));
      column_x = hypotenuse(t * norm(A_inverse), r_root * c);
      column_data = hypotenuse(hypotenuse(t * moved, q_root * norm(before.w)), y ? r_root * y->norm() : 0);
      w_hat = norm(Qe_inverse) * column_w * column_data + z * norm(xf);
      const Dense G = A_inverse - AB * Z;
      amplification = square(norm(G));
      state_in = norm((identity(Y.rows) - Kf * now.C) * before.A) * e_state;
      gain_of_information = pf * norm(G) * (moved + norm(A_inverse) * norm(xf) + norm(AB) * w_hat);
    }
    const double array = column_w * z + column_x;
    const double residual = column_w * w_hat + column_x * norm(xf) + column_data;
    if (y) {
      const double solved = t_next * std::sqrt(pf) * norm(xf);  // T+ x = xi by substitution
      e_state =
          state_in + gain_of_information * e_held + unit * (std::sqrt(pf) * residual + pf * array * residual + solved);
      // e changes by the perturbed array times the solution, and by the perturbed array's answer to e.
      const double e = std::sqrt(static_cast<double>(innovation_square));
      e_residual = 2 * e * unit * (residual + std::sqrt(pf) * array * e) + square(unit * residual);
    }
    e_held = amplification * e_held + unit * 2 * t_next * array;
    e_gain = square(pf) * e_held * c * square(r_root) + unit * (1 + trace_Y * pf) * pf * c * square(r_root);
  }

  /// One step of the form that holds Y = P^{-1} and d = Y x. With M = Q^{-1} + G'Y G, Z = M^{-1} G'Y and w the estimate
  /// of the noise, every product is rounded by u times its factors' norms: Y G against Z, twice, and M against Z on
  /// both sides, or against w.
  void normal_equation_bounds(std::int64_t k, const Dense& Pf0, const Dense& xf0, const Vector<double>* y) {
    const Plain& now = model(k);
    const Dense Y = inverse(Pf);
    const double c = norm(now.C), r = trace(inverse(now.R)), pf = norm(Pf), kappa = trace(Y) * pf;

    double amplification = 1, held_local, vector_in = e_vector, vector_local;
    if (!started) {
      held_local = trace(inverse(P));
      vector_local = held_local * norm(x);
    } else {
      const Plain& before = model(k - 1);
      const Dense A_inverse = inverse(before.A), G = A_inverse * before.B, Y0 = inverse(Pf0);
      const Dense Q_inverse = inverse(before.Q), M = Q_inverse + transposed(G) * Y0 * G, M_inverse = inverse(M);
      const Dense Z = M_inverse * transposed(G) * Y0, through = A_inverse - G * Z * A_inverse;
      Dense shift(Y.rows, 1);
      if (last_u.size() > 0) shift = A_inverse * before.D * Dense(last_u);
      const Dense d = Y0 * xf0, shifted = d + Y0 * shift;
      const Dense w = M_inverse * (Q_inverse * before.w - transposed(G) * shifted);

      const double a = norm(A_inverse), g = norm(G), z = norm(Z), y0 = trace(Y0), q = trace(Q_inverse);
      const double m = q + square(g) * y0;
      const double W = std::sqrt(trace(Y0 * G * Z)), s = std::sqrt(trace(transposed(w) * M * w));
      amplification = square(norm(through));
      held_local = square(a) * (y0 + 2 * z * y0 * g + square(z) * m);
      vector_in = norm(through) * (e_vector + e_held * (norm(shift) + g * norm(w)));
      const double known = norm(before.D) * last_u.norm(), right = q * norm(before.w) + g * norm(shifted);
      vector_local = a * (norm(d) + y0 * a * known + z * right + (y0 * g + z * m) * norm(w) + W * s);
    }
    e_held = amplification * e_held + unit * (held_local + square(c) * r);
    e_gain = square(pf) * e_held * c * r + unit * (1 + kappa) * pf * c * r;
    if (y) {
      e_vector = vector_in + unit * (vector_local + c * r * y->norm());
      e_state = pf * (e_vector + e_held * norm(xf)) + unit * kappa * norm(xf);
    }
  }
};

PlainRecursion::PlainRecursion(const AnyProblem<double>& problem, const Metadata& filter, double unit) {
  std::visit(
      [&](const auto& given) {
        const auto [n, m, p] = given.dimensions();
        run_ = std::make_unique<Run>(filter, unit * static_cast<double>(n + m + p));
        for (const auto& model : given.models) run_->models.emplace_back(model);
        run_->x = run_->xf = Dense(given.x0);
        switch (std::decay_t<decltype(given)>::Model::parametrisation) {
          case Parametrisation::covariance: run_->P = mirrored(given.initial); break;
          case Parametrisation::root: {
            const Dense S = lower_of(given.initial);
            run_->P = S * transposed(S);
            break;
          }
          case Parametrisation::information: {
            const Dense T = upper_of(given.initial);
            run_->P = inverse(transposed(T) * T);
          }
        }
        run_->Pf = run_->P;
      },
      problem);
}

PlainRecursion::~PlainRecursion() = default;

void PlainRecursion::step(std::int64_t k, const Vector<double>* y, const Vector<double>* u) { run_->step(k, y, u); }

Judgement PlainRecursion::judge(const Exact& held, const Exact& gain, const Exact& state) const {
  const Run& run = *run_;
  const Dense& P = run.predicts() ? run.P : run.Pf;
  Judgement result;
  const Dense X = held.empty() ? Dense() : sum(held);
  switch (run.filter.holds) {
    case Held::covariance: result.held.error = norm(X - P); break;
    case Held::covariance_factor: result.held.error = norm(lower_of(X) * transposed(lower_of(X)) - P); break;
    case Held::covariance_root: result.held.error = norm(X * transposed(X) - P); break;
    case Held::ud_factors: {
      Dense U = upper_of(X), D = identity(P.rows);
      for (Index i = 0; i < P.rows; ++i) {
        D(i, i) = U(i, i);
        U(i, i) = 1;
      }
      result.held.error = norm(U * D * transposed(U) - P);
      break;
    }
    case Held::information_factor: result.held.error = norm(transposed(upper_of(X)) * upper_of(X) - inverse(P)); break;
    case Held::information: result.held.error = norm(X - inverse(P)); break;
    case Held::gain: break;
  }
  result.held.bound = run.e_held;
  result.gain = {norm(sum(gain) - (run.filter.gain == GainKind::predictor ? run.K : run.Kf)), run.e_gain};
  if (!state.empty()) result.state = {norm(sum(state) - (run.predicts() ? run.x : run.xf)), run.e_state};
  return result;
}

Deviation PlainRecursion::judge_residual(double e_squared) const {
  return {std::abs(static_cast<double>(Real(e_squared) - run_->innovation_square)), run_->e_residual};
}

Matrix<double> PlainRecursion::covariance() const { return (run_->predicts() ? run_->P : run_->Pf).rounded(); }
Matrix<double> PlainRecursion::gain() const {
  return (run_->filter.gain == GainKind::predictor ? run_->K : run_->Kf).rounded();
}
Matrix<double> PlainRecursion::state() const { return (run_->predicts() ? run_->x : run_->xf).rounded(); }

// The recursion that judges the filters is itself judged by a step known in closed form: the ill-conditioned update of
// Dyer and McReynolds, P0 = I, A = I, B = 0, C = [1 1 1; 1 1 1+d], R = d^2 I, all exact in binary.
TEST(PlainRecursion, GivesTheDyerMcReynoldsStep) {
  for (const int exponent : {-3, -10, -25}) {
    const double d = std::ldexp(1., exponent);
    Problem<CovarianceModel<double>> problem;
    auto& model = problem.models.emplace_back();
    model.A = Matrix<double>::Identity(3, 3);
    model.B = Matrix<double>::Zero(3, 1);
    model.C = Matrix<double>::Ones(2, 3);
    model.C(1, 2) += d;
    model.D.resize(3, 0);
    model.Q = Matrix<double>::Identity(1, 1);
    model.R = d * d * Matrix<double>::Identity(2, 2);
    problem.initial = Matrix<double>::Identity(3, 3);
    problem.x0 = Vector<double>::Zero(3);

    const Metadata form{};
    PlainRecursion recursion(problem, form, std::ldexp(1., -53));
    recursion.step(0, nullptr, nullptr);

    const double e = 2 * d * (1 + d);
    Matrix<double> P(3, 3), K(3, 2);
    P << 5 + e, -3, -2 - d, -3, 5 + e, -2 - d, -2 - d, -2 - d, 4 + d * d;
    P /= 8 + e;
    K << 2 * d + 1, d - 1, 2 * d + 1, d - 1, d - 2, d * d + d + 2;
    K /= 2 * d * (d * d + d + 4);
    // Each entry of the closed form takes at most eight roundings of its own.
    EXPECT_LE((recursion.covariance() - P).cwiseAbs().maxCoeff(), 8 * std::ldexp(1., -53) * P.cwiseAbs().maxCoeff());
    EXPECT_LE((recursion.gain() - K).cwiseAbs().maxCoeff(), 8 * std::ldexp(1., -53) * K.cwiseAbs().maxCoeff());
  }
}

TEST(PlainRecursion, TakesAnyNumberExactly) {
  Matrix<long double> X(1, 2);
  X << 1.L / 3, -1e-3L;
  const Exact parts = exact(X);
  const Dense Y = sum(parts);
  for (Index j = 0; j < 2; ++j) EXPECT_EQ(static_cast<long double>(Y(0, j)), X(0, j));
  EXPECT_EQ(parts.size(), 2u);
}

}  // namespace kfstab::test
