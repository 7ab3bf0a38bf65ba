#include <kfstab/properties/mistakes.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include <kfstab/filters/linear_solve.hpp>

namespace kfstab::properties {

namespace {

using M = Matrix<double>;

/// By plain loops: blocked products take longer to compile than all that is here.
M times(const M& X, const M& Y) { return X.lazyProduct(Y); }
M times(const M& X, const M& Y, const M& Z) { return times(times(X, Y), Z); }
M congruence(const M& X, const M& Y) { return times(X, Y, X.transpose()); }

/// The lower Cholesky factor; nothing if X is not positive definite.
std::optional<M> root(const M& X) {
  M V = X;
  if (cholesky_upper(V) != 0) return std::nullopt;
  M L = M::Zero(X.rows(), X.cols());
  for (Index i = 0; i < X.rows(); ++i)
    for (Index j = 0; j <= i; ++j) L(i, j) = V(j, i);
  return L;
}

bool square_it(M& X) {
  X = times(X, X);
  return true;
}
bool root_it(M& X) {
  auto L = root(X);
  if (!L) return false;
  X = *std::move(L);
  return true;
}
bool diagonal_only(M& X) {
  X = M(X.diagonal().asDiagonal());
  return true;
}
template <class T>
bool late(T& now, const std::optional<T>& before) {
  if (before && before->rows() == now.rows() && before->cols() == now.cols()) now = *before;
  return true;
}
bool to_float(M& X) {
  X = X.cast<float>().cast<double>();
  return true;
}

/// Kf for a given Re; false if that is singular.
bool weigh(PlainFilter& f, M Re) {
  f.Kf = times(f.P_prior, f.C.transpose());
  Vector<int> pivots(Re.rows());
  if (!lu_transposed(Re, pivots)) return false;
  solve_lu_right(Re, pivots, f.Kf);
  return true;
}

/// P of k|k again, from the prior, in Joseph's form: for what changes the gain but not what is done with it.
bool update_by(PlainFilter& f, const M& Kf) {
  const M I = M::Identity(f.P.rows(), f.P.rows());
  f.P = times(I - times(Kf, f.C), f.P_prior);
  f.x = f.x_prior + Kf.lazyProduct(f.innovation);
  return true;
}

using F = PlainFilter;
using enum Moment;

// clang-format off: a line a mistake
constexpr Mistake all_mistakes[] = {
    // --- the initial condition
    {"p0-as-factor", "takes P0 for its factor: it starts from P0 P0'", start,
     [](F& f) {
       f.P = times(f.P, f.P.transpose());
       return true;
     }},
    {"p0-rooted", "starts from the Cholesky factor of P0 in the place of P0", start, [](F& f) { return root_it(f.P); }},
    {"p0-diagonal", "keeps only the diagonal of P0", start, [](F& f) { return diagonal_only(f.P); }},
    {"p0-identity", "starts from the identity whatever P0 is", start,
     [](F& f) {
       f.P.setIdentity();
       return true;
     }},
    {"p0-zero", "starts from 0 whatever P0 is", start,
     [](F& f) {
       f.P.setZero();
       return true;
     }},
    {"x0-zero", "starts from x = 0 whatever x0 is", start,
     [](F& f) {
       f.x.setZero();
       return true;
     }},

    // --- the model
    {"a-transposed", "uses A' where A belongs", given,
     [](F& f) {
       f.A.transposeInPlace();
       return true;
     }},
    {"a-late", "uses the A of the step before", given, [](F& f) { return late(f.A, f.last.A); }},
    {"b-late", "uses the B of the step before", given, [](F& f) { return late(f.B, f.last.B); }},
    {"c-late", "uses the C of the step before", given, [](F& f) { return late(f.C, f.last.C); }},
    {"q-late", "uses the Q of the step before", given, [](F& f) { return late(f.Q, f.last.Q); }},
    {"r-late", "uses the R of the step before", given, [](F& f) { return late(f.R, f.last.R); }},
    {"model-frozen", "goes on with the model of the first step", given,
     [](F& f) {
       return late(f.A, f.first.A) && late(f.B, f.first.B) && late(f.C, f.first.C) && late(f.Q, f.first.Q) &&
              late(f.R, f.first.R);
     }},
    {"q-squared", "takes Q for Q^{1/2}: it adds B Q Q' B'", given, [](F& f) { return square_it(f.Q); }},
    {"q-rooted", "takes the Cholesky factor of Q for Q", given, [](F& f) { return root_it(f.Q); }},
    {"q-diagonal", "keeps only the diagonal of Q", given, [](F& f) { return diagonal_only(f.Q); }},
    {"q-forgotten", "forgets the process noise", given,
     [](F& f) {
       f.Q.setZero();
       return true;
     }},
    {"q-identity", "adds B B' in the place of B Q B'", given,
     [](F& f) {
       f.Q.setIdentity();
       return true;
     }},
    {"q-doubled", "adds the process noise twice", given,
     [](F& f) {
       f.Q *= 2;
       return true;
     }},
    {"q-halved", "adds half of the process noise", given,
     [](F& f) {
       f.Q *= .5;
       return true;
     }},
    {"b-forgotten", "adds Q in the place of B Q B'", given,
     [](F& f) {
       if (f.B.rows() != f.B.cols()) return false;
       f.B.setIdentity();
       return true;
     }},
    {"b-transposed", "adds B' Q B in the place of B Q B'", given,
     [](F& f) {
       if (f.B.rows() != f.B.cols()) return false;
       f.B.transposeInPlace();
       return true;
     }},
    {"r-squared", "takes R for R^{1/2}: it uses R R' where R belongs", given, [](F& f) { return square_it(f.R); }},
    {"r-rooted", "uses the Cholesky factor of R where R belongs", given, [](F& f) { return root_it(f.R); }},
    {"r-diagonal", "keeps only the diagonal of R", given, [](F& f) { return diagonal_only(f.R); }},
    {"r-identity", "uses the identity where R belongs", given,
     [](F& f) {
       f.R.setIdentity();
       return true;
     }},
    {"r-doubled", "uses 2 R where R belongs", given,
     [](F& f) {
       f.R *= 2;
       return true;
     }},
    {"r-inverted", "uses R^{-1} where R belongs", given,
     [](F& f) {
       M inverse = M::Identity(f.R.rows(), f.R.cols());
       M LU = f.R;
       Vector<int> pivots(LU.rows());
       if (!lu_transposed(LU, pivots)) return false;
       solve_lu_right(LU, pivots, inverse);
       f.R = inverse;
       return true;
     }},
    {"u-forgotten", "forgets the known input", given,
     [](F& f) {
       f.u.setZero();
       return true;
     }},
    {"u-subtracted", "subtracts the known input", given,
     [](F& f) {
       f.u = -f.u;
       return true;
     }},
    {"u-late", "uses the input of the step before", given, [](F& f) { return late(f.u, f.last.u); }},
    {"y-late", "uses the measurement of the step before", given, [](F& f) { return late(f.y, f.last.y); }},
    {"scaled-a", "uses .99 A where A belongs", given,
     [](F& f) {
       f.A *= .99;
       return true;
     }},

    // --- missing measurements
    {"missing-as-zero", "takes a missing measurement for y = 0", given,
     [](F& f) {
       if (!f.measured) f.y.setZero();
       f.measured = true;
       return true;
     }},
    {"missing-repeats", "takes the last measurement again where one is missing", given,
     [](F& f) {
       if (!f.measured && f.last.y && f.last.y->size() == f.y.size()) {
         f.y = *f.last.y;
         f.measured = true;
       }
       return true;
     }},

    // --- the innovation and its covariance
    {"innovation-sign", "subtracts the correction K (y - C x)", innovated,
     [](F& f) {
       f.innovation = -f.innovation;
       return true;
     }},
    {"innovation-is-y", "corrects by K y in the place of K (y - C x)", innovated,
     [](F& f) {
       f.innovation = f.y;
       return true;
     }},
    {"innovation-with-u", "forms the innovation from the state without its prediction", innovated,
     [](F& f) {
       if (f.last.x) f.innovation = f.y - times(f.C, *f.last.x).col(0);
       return true;
     }},
    {"re-without-r", "leaves R out of the innovation covariance", innovated,
     [](F& f) {
       f.Re -= f.R;
       return true;
     }},
    {"re-minus-r", "subtracts R in the innovation covariance", innovated,
     [](F& f) {
       f.Re -= 2 * f.R;
       return true;
     }},
    {"re-diagonal", "inverts only the diagonal of the innovation covariance", innovated,
     [](F& f) { return diagonal_only(f.Re); }},
    {"re-identity", "leaves the inverse of the innovation covariance out of the gain", innovated,
     [](F& f) {
       f.Re.setIdentity();
       return true;
     }},
    {"re-jitter", "adds 1e-6 to the diagonal of the innovation covariance", innovated,
     [](F& f) {
       f.Re.diagonal().array() += 1e-6;
       return true;
     }},
    {"re-jitter-small", "adds 1e-9 to the diagonal of the innovation covariance", innovated,
     [](F& f) {
       f.Re.diagonal().array() += 1e-9;
       return true;
     }},
    {"re-float", "holds the innovation covariance in single precision", innovated, [](F& f) { return to_float(f.Re); }},
    {"gate", "ignores measurements beyond three standard deviations", innovated,
     [](F& f) {
       M LU = f.Re;
       Vector<int> pivots(LU.rows());
       if (!lu_transposed(LU, pivots)) return false;
       M weighed = f.innovation.transpose();
       solve_lu_right(LU, pivots, weighed);
       if (weighed.row(0).dot(f.innovation) > 9) f.Re.diagonal().array() = 1e300;
       return true;
     }},

    // --- the gain
    {"gain-frozen", "goes on with the gain of the first step", weighed, [](F& f) { return late(f.Kf, f.first.Kf); }},
    {"gain-stale", "uses the gain of the step before", weighed, [](F& f) { return late(f.Kf, f.last.Kf); }},
    {"gain-float", "holds the gain in single precision", weighed, [](F& f) { return to_float(f.Kf); }},
    {"gain-halved", "uses half of the gain", weighed,
     [](F& f) {
       f.Kf *= .5;
       return true;
     }},
    {"gain-at", "uses A K where K belongs: the predictor's gain in the measurement update", weighed,
     [](F& f) {
       f.Kf = times(f.A, f.Kf);
       return true;
     }},

    // --- the measurement update
    {"no-update", "does not subtract what the measurement tells: P_{k|k} = P_{k|k-1}", updated,
     [](F& f) {
       f.P = f.P_prior;
       return true;
     }},
    {"update-added", "adds K C P in the place of subtracting it", updated,
     [](F& f) {
       f.P = f.P_prior + times(f.Kf, f.C, f.P_prior);
       return true;
     }},
    {"update-twice", "subtracts K C P twice", updated,
     [](F& f) {
       f.P = f.P_prior - 2 * times(f.Kf, f.C, f.P_prior);
       return true;
     }},
    {"joseph-without-r", "leaves K R K' out of Joseph's form", updated,
     [](F& f) {
       const M I = M::Identity(f.P.rows(), f.P.rows());
       f.P = congruence(I - times(f.Kf, f.C), f.P_prior);
       return true;
     }},
    {"joseph-minus-r", "subtracts K R K' in Joseph's form", updated,
     [](F& f) {
       const M I = M::Identity(f.P.rows(), f.P.rows());
       f.P = congruence(I - times(f.Kf, f.C), f.P_prior) - congruence(f.Kf, f.R);
       return true;
     }},
    {"kkt-update", "subtracts K K' in the place of K Re K'", updated,
     [](F& f) {
       f.P = f.P_prior - times(f.Kf, f.Kf.transpose());
       return true;
     }},
    {"krk-update", "subtracts K R K' in the place of K Re K'", updated,
     [](F& f) {
       f.P = f.P_prior - congruence(f.Kf, f.R);
       return true;
     }},
    {"x-not-updated", "does not correct the state", updated,
     [](F& f) {
       f.x = f.x_prior;
       return true;
     }},
    {"x-predicted-gain", "corrects the predicted state by Kf where the predictor's gain belongs", predicted,
     [](F& f) {
       if (f.P_prior.size() == 0) return true;  // nothing was measured in this step yet
       f.x = times(f.A, f.x_prior).col(0) + times(f.Kf, f.innovation).col(0);
       if (f.u.size() > 0) f.x += times(f.D, f.u).col(0);
       return true;
     }},
    {"p-float", "holds P in single precision", updated, [](F& f) { return to_float(f.P); }},
    {"p-diagonal", "keeps only the diagonal of P", updated, [](F& f) { return diagonal_only(f.P); }},

    // --- the time update
    {"apa", "forms A P A without transposing the second A", predicted,
     [](F& f) {
       f.P = times(f.A, f.P_filtered, f.A) + congruence(f.B, f.Q);
       return true;
     }},
    {"atpa", "forms A' P A in the place of A P A'", predicted,
     [](F& f) {
       f.P = congruence(f.A.transpose(), f.P_filtered) + congruence(f.B, f.Q);
       return true;
     }},
    {"ap-only", "forms A P without the second A", predicted,
     [](F& f) {
       f.P = times(f.A, f.P_filtered) + congruence(f.B, f.Q);
       return true;
     }},
    {"q-subtracted", "subtracts B Q B'", predicted,
     [](F& f) {
       f.P = congruence(f.A, f.P_filtered) - congruence(f.B, f.Q);
       return true;
     }},
    {"q-through-a", "adds the process noise before the prediction: A (P + B Q B') A'", predicted,
     [](F& f) {
       f.P = congruence(f.A, f.P_filtered + congruence(f.B, f.Q));
       return true;
     }},
    {"no-prediction", "does not predict P", predicted,
     [](F& f) {
       f.P = f.P_filtered;
       return true;
     }},
    {"from-prior", "predicts from P_{k|k-1}: the measurement update of P is lost", predicted,
     [](F& f) {
       f.P = congruence(f.A, f.P_prior.size() > 0 ? f.P_prior : f.P_filtered) + congruence(f.B, f.Q);
       return true;
     }},
    {"x-not-predicted", "does not predict the state", predicted,
     [](F& f) {
       f.x = f.x_filtered;
       return true;
     }},
    {"jitter", "adds 1e-6 to the diagonal of P", predicted,
     [](F& f) {
       f.P.diagonal().array() += 1e-6;
       return true;
     }},
    {"jitter-small", "adds 1e-9 to the diagonal of P", predicted,
     [](F& f) {
       f.P.diagonal().array() += 1e-9;
       return true;
     }},
    {"symmetrised-by-sum", "symmetrises by P + P' without halving", predicted,
     [](F& f) {
       const M S = f.P + f.P.transpose();
       f.P = S;
       return true;
     }},
    {"one-triangle", "leaves the upper triangle of P at 0", predicted,
     [](F& f) {
       const M L = f.P.triangularView<Eigen::Lower>();
       f.P = L;
       return true;
     }},
    {"clamped", "does not let the variances exceed 1", predicted,
     [](F& f) {
       f.P.diagonal() = f.P.diagonal().cwiseMin(1.0);
       return true;
     }},

    // --- the answer
    {"answers-before-prediction", "answers P_{k|k} and x_{k|k} where P_{k+1|k} and x_{k+1|k} are asked for", answered,
     [](F& f) {
       if (f.P_filtered.size() > 0) {
         f.P = f.P_filtered;
         f.x = f.x_filtered;
       }
       return true;
     }},
    {"answers-prior", "answers what it had before the measurement", answered,
     [](F& f) {
       if (f.P_prior.size() > 0) {
         f.P = f.P_prior;
         f.x = f.x_prior;
       }
       return true;
     }},
    {"filter-gain", "answers P C' Re^{-1} for the predictor's gain A P C' Re^{-1}", answered,
     [](F& f) {
       if (f.gain == GainKind::predictor) f.K = f.Kf;
       return true;
     }},
    {"predictor-gain", "answers A P C' Re^{-1} for the filter's gain P C' Re^{-1}", answered,
     [](F& f) {
       if (f.gain == GainKind::filter) f.K = times(f.A, f.Kf);
       return true;
     }},
    {"gain-late", "answers the gain of the step before", answered, [](F& f) { return late(f.K, f.last.K); }},
    {"gain-sign", "answers -K", answered,
     [](F& f) {
       f.K = -f.K;
       return true;
     }},
};
// clang-format on

/// The plain filter's lines, with the mistakes at their moments.
class Reenactment {
 public:
  Reenactment(std::span<const Mistake* const> made, const Traits& traits, double disturbance)
      : made_(made), traits_(traits), disturbance_(disturbance) {}

  std::optional<std::vector<Answer>> run(const System& system, const Problem<CovarianceModel<double>>& given) {
    with_data_ = system.data != nullptr;
    f_.P = given.initial;
    f_.x = given.x0;
    f_.gain = traits_.gain.value_or(GainKind::predictor);
    if (!at(Moment::start)) return std::nullopt;
    const auto stream = system.data ? system.data->open() : nullptr;
    std::vector<Answer> answers;
    const bool answers_predicted = traits_.instant == Instant::predicted;
    std::optional<CovarianceModel<double>> last_model;
    Vector<double> last_u;
    for (f_.k = 0; f_.k < system.steps; ++f_.k) {
      const auto& model = given.model(f_.k);
      const StepData* data = stream ? &stream->next() : nullptr;
      const Vector<double> u = data && data->u.size() > 0 ? data->u : Vector<double>::Zero(model.D.cols());
      f_.A = model.A, f_.B = model.B, f_.C = model.C, f_.Q = model.Q, f_.R = model.R, f_.D = model.D;
      f_.u = u;
      f_.y = data ? data->y : Vector<double>::Zero(model.C.rows());
      f_.measured = true;
      f_.P_prior = f_.P_filtered = M();
      f_.Kf = M::Zero(model.A.rows(), model.C.rows());
      const Measured measured(f_.C, f_.R, f_.y);
      f_.measured = !measured.entries.empty();
      if (f_.measured) f_.C = measured.C, f_.R = measured.R, f_.y = measured.y;
      // What is late is late by the step before as it was given, not as a mistake made it.
      PlainFilter::Memory now{f_.A, f_.B,         f_.C,         f_.Q,
                              f_.R, std::nullopt, std::nullopt, f_.measured ? std::optional(f_.y) : f_.last.y,
                              f_.u, f_.x};
      if (!at(Moment::given)) return std::nullopt;
      if (answers_predicted) {
        if (!measure() || !predict()) return std::nullopt;
      } else {
        // One that starts predicted comes to step k by the dynamics of step k - 1.
        if (!traits_.starts_predicted || f_.k > 0) {
          if (traits_.starts_predicted) {
            std::swap(f_.A, last_model->A), std::swap(f_.B, last_model->B), std::swap(f_.Q, last_model->Q),
                std::swap(f_.D, last_model->D);
            std::swap(f_.u, last_u);
          }
          if (!predict()) return std::nullopt;
        }
        if (!measure()) return std::nullopt;
      }
      last_model = model;
      last_u = u;
      f_.K = answers_predicted && f_.gain == GainKind::predictor ? times(f_.A, f_.Kf) : f_.Kf;
      if (!answers_predicted && f_.gain == GainKind::predictor) f_.K = times(model.A, f_.Kf);
      now.Kf = f_.Kf;
      now.K = f_.K;
      if (f_.k == 0) f_.first = now;
      // A mistake of the answer leaves what is held as it is.
      const M held = f_.P;
      const Vector<double> state = f_.x;
      if (!at(Moment::answered)) return std::nullopt;
      Answer answer;
      answer.held = f_.P;
      if (traits_.gain && f_.measured) answer.gain = f_.K.cols() == std::ssize(measured.entries) ? measured.of_all(f_.K) : f_.K;
      if (with_data_) answer.state = f_.x;
      answers.push_back(std::move(answer));
      f_.P = held;
      f_.x = state;
      f_.last = now;
    }
    return answers;
  }

 private:
  bool at(Moment moment) {
    return std::ranges::all_of(made_,
                               [&](const Mistake* mistake) { return mistake->moment != moment || mistake->make(f_); });
  }

  bool measure() {
    f_.innovation.resize(0);
    if (!f_.measured) return true;
    f_.P_prior = f_.P;
    f_.x_prior = f_.x;
    f_.innovation = f_.y - times(f_.C, f_.x).col(0);
    f_.Re = f_.R + congruence(f_.C, f_.P);
    disturb(f_.Re);
    if (!at(Moment::innovated) || !weigh(f_, f_.Re) || !at(Moment::weighed)) return false;
    update_by(f_, f_.Kf);
    disturb(f_.P);
    disturb(f_.x);
    return at(Moment::updated);
  }

  bool predict() {
    f_.P_filtered = f_.P;
    f_.x_filtered = f_.x;
    f_.P = congruence(f_.A, f_.P) + congruence(f_.B, f_.Q);
    f_.x = times(f_.A, f_.x).col(0);
    if (f_.u.size() > 0) f_.x += times(f_.D, f_.u).col(0);
    disturb(f_.P);
    disturb(f_.x);
    return at(Moment::predicted);
  }

  /// Every entry up or down; those across the diagonal of a square matrix alike.
  template <class Derived>
  void disturb(Eigen::MatrixBase<Derived>& X) {
    if (disturbance_ == 0) return;
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = 0; i < X.rows(); ++i) {
        if (X.rows() == X.cols() && i < j) continue;
        chance_ = chance_ * 6364136223846793005u + 1442695040888963407u;
        const double factor = 1 + ((chance_ >> 63) != 0 ? disturbance_ : -disturbance_);
        X(i, j) *= factor;
        if (X.rows() == X.cols() && i != j) X(j, i) *= factor;
      }
  }

  std::span<const Mistake* const> made_;
  const Traits& traits_;
  double disturbance_;
  std::uint64_t chance_ = 1986;
  PlainFilter f_;
  bool with_data_ = false;
};

class MistakenFilter final : public Subject {
 public:
  MistakenFilter(Traits traits, std::vector<const Mistake*> made) : traits_(std::move(traits)), made_(std::move(made)) {
    traits_.holds = Held::covariance;
    traits_.takes = Parametrisation::covariance;
    traits_.asymmetry.reset();  // whatever the subject's coding is, it is not this one's
  }

  const Traits& traits() const override { return traits_; }
  Ending run(const System& system, const std::function<bool(std::int64_t, const Answer&)>& each) override {
    const auto numbers = covariance_numbers(system);
    const auto answers = numbers ? reenact(system, *numbers, traits_, made_) : std::nullopt;
    if (!answers) return {Ending::Kind::refused, -1, "does not fit"};
    for (std::size_t k = 0; k < answers->size(); ++k)
      if (!each(static_cast<std::int64_t>(k), (*answers)[k])) break;
    return {};
  }

 private:
  Traits traits_;
  std::vector<const Mistake*> made_;
};

}  // namespace

std::span<const Mistake> mistakes() { return all_mistakes; }

std::optional<Problem<CovarianceModel<double>>> covariance_numbers(const System& system) {
  auto converted = problem(system, Parametrisation::covariance);
  auto* numbers = std::get_if<AnyProblem<double>>(&converted);
  if (!numbers) return std::nullopt;
  return std::get<Problem<CovarianceModel<double>>>(std::move(*numbers));
}

std::optional<std::vector<Answer>> reenact(const System& system, const Problem<CovarianceModel<double>>& numbers,
                                           const Traits& traits, std::span<const Mistake* const> made,
                                           double disturbance) {
  return Reenactment(made, traits, disturbance).run(system, numbers);
}

std::unique_ptr<Subject> mistaken(Traits traits, std::vector<const Mistake*> made) {
  return std::make_unique<MistakenFilter>(std::move(traits), std::move(made));
}

}  // namespace kfstab::properties
