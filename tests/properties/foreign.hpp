#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include <Eigen/LU>

#include <kfstab/properties/subject.hpp>

/// Filters as somebody else writes them: plain expressions of Eigen, of a coding that nobody declares.
namespace kfstab::properties::testing {

/// What such filters differ in.
struct Style {
  std::string name;
  bool starts_predicted = true;  ///< update, then predict; else predict, then update
  bool joseph = false;           ///< P_{k|k} by Joseph's form; else (I - Kf C) P
  bool symmetrises = false;
  std::optional<GainKind> gain = GainKind::filter;
  bool answers_root = false;  ///< S, P = S S'
  bool state = true;
  bool inverts = false;  ///< the gain by Re^{-1}, formed; else Re is solved with
};

/// One filter, driven step by step; computes in Scalar. Its parts may be replaced, by wrong ones.
template <class Scalar>
class Foreign final : public StepwiseFilter {
 public:
  using M = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
  using V = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;

  /// What a step is made of, as it goes on.
  struct Work {
    M A, B, C, Q, R, D;
    V u, y;
    bool measured = false;
    std::int64_t k = 0;
    V x;
    M P, Kf;  ///< Kf is answered and used
    Scalar loglik = 0;
  };
  using Change = std::function<void(Work&)>;

  explicit Foreign(Style style) : style_(std::move(style)) {
    traits_.name = style_.name;
    traits_.starts_predicted = style_.starts_predicted;
    traits_.instant = style_.starts_predicted ? Instant::predicted : Instant::filtered;
    traits_.gain = style_.gain;
    traits_.holds = style_.answers_root ? Held::covariance_root : Held::covariance;
    traits_.asymmetry = std::nullopt;
    traits_.roundoff = unit_roundoff<Scalar>();
  }

  Change before;        ///< of the step's numbers, before anything is done
  Change of_gain;       ///< after Kf was computed
  Change after_update;  ///< of x and P
  Change after_predict;
  Change after_all;
  std::function<void(Work&, const V& e)> update_state;  ///< x by Kf and e
  std::function<void(Answer&, std::int64_t k)> answered;

  const Traits& traits() const override { return traits_; }
  Traits& traits() { return traits_; }

  std::optional<Ending> start(const Dimensions&, const Vector<double>& x, const Matrix<double>& P) override {
    work_ = {};
    work_.x = x.cast<Scalar>();
    work_.P = P.cast<Scalar>();
    work_.k = -1;
    return std::nullopt;
  }

  std::variant<Answer, Ending> step(const StepInput& in) override {
    Work& w = work_;
    ++w.k;
    w.A = in.A.cast<Scalar>(), w.B = in.B.cast<Scalar>(), w.C = in.C.cast<Scalar>();
    w.Q = in.Q.cast<Scalar>(), w.R = in.R.cast<Scalar>();
    w.D = in.u ? M(in.D->cast<Scalar>()) : M::Zero(w.A.rows(), 0);
    w.u = in.u ? V(in.u->cast<Scalar>()) : V(0);
    w.measured = in.y != nullptr;
    w.y = in.y ? V(in.y->cast<Scalar>()) : V::Zero(w.C.rows());
    w.loglik = 0;
    call(before);
    if (!style_.starts_predicted) predict();
    update();
    if (style_.starts_predicted) predict();
    call(after_all);

    Answer answer;
    answer.holds = traits_.holds;
    if (style_.answers_root) {
      const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic> P = w.P.template cast<double>();
      answer.held = root(P);
    } else {
      answer.held = w.P.template cast<double>();
    }
    if (style_.gain) answer.gain = M(style_.gain == GainKind::filter ? w.Kf : M(w.A * w.Kf)).template cast<double>();
    if (style_.state) answer.state = w.x.template cast<double>();
    if (w.measured && style_.state) answer.log_likelihood = static_cast<double>(w.loglik);
    if (answered) answered(answer, w.k);
    return answer;
  }

 private:
  void call(const Change& change) {
    if (change) change(work_);
  }

  static Matrix<double> root(const Matrix<double>& P) {
    // Lower, pivots no less than 0.
    Matrix<double> L = Matrix<double>::Zero(P.rows(), P.cols());
    for (Index j = 0; j < P.rows(); ++j) {
      L(j, j) = std::sqrt(std::max(0.0, P(j, j) - L.row(j).head(j).squaredNorm()));
      for (Index i = j + 1; i < P.rows() && L(j, j) > 0; ++i)
        L(i, j) = (P(i, j) - L.row(i).head(j).dot(L.row(j).head(j))) / L(j, j);
    }
    return L;
  }

  void predict() {
    Work& w = work_;
    w.P = w.A * w.P * w.A.transpose() + w.B * w.Q * w.B.transpose();
    w.x = w.A * w.x + w.D * w.u;
    if (style_.symmetrises) w.P = ((w.P + w.P.transpose()) / 2).eval();
    call(after_predict);
  }

  void update() {
    Work& w = work_;
    w.Kf = M::Zero(w.A.rows(), w.C.rows());
    if (!w.measured || w.C.rows() == 0) return;
    const M Re = w.R + w.C * w.P * w.C.transpose();
    const Eigen::PartialPivLU<M> lu(M(Re.transpose()));
    if (style_.inverts)
      w.Kf = w.P * w.C.transpose() * Re.inverse();
    else
      w.Kf = lu.solve(M((w.P * w.C.transpose()).transpose())).transpose();
    call(of_gain);
    const V e = w.y - w.C * w.x;
    const V z = lu.solve(e);
    w.loglik =
        -(static_cast<Scalar>(static_cast<double>(e.size()) * std::log(2 * std::numbers::pi)) + std::log(lu.determinant()) + e.dot(z)) / 2;
    if (update_state)
      update_state(w, e);
    else
      w.x += w.Kf * e;
    const M F = M::Identity(w.P.rows(), w.P.rows()) - w.Kf * w.C;
    w.P = style_.joseph ? M(F * w.P * F.transpose() + w.Kf * w.R * w.Kf.transpose()) : M(F * w.P);
    if (style_.symmetrises) w.P = ((w.P + w.P.transpose()) / 2).eval();
    call(after_update);
  }

  Style style_;
  Traits traits_;
  Work work_;
};

}  // namespace kfstab::properties::testing
