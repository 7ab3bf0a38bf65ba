#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>

namespace kfstab::properties::laws::gain_innovation {

namespace {

std::optional<Finding> of_covariance(const ObservedStep& s) {
  // Where P is not quite symmetric, P C' and (C P)' are two things: (ii) and (iv) take the gain from the second, and
  // (ii) its Re as well.
  const auto coding = s.subject.asymmetry;
  const bool transposed_gain = coding == Asymmetry::mixed || coding == Asymmetry::cp;
  const Precise P = transposed_gain ? s.prior.transposed() : s.prior;
  const Precise Re = coding == Asymmetry::mixed ? s.Re.transposed() : s.Re;
  const bool predictor = s.subject.gain == GainKind::predictor;
  const Precise PC = P * s.C.transposed();
  const double A = s.A.norm(), B = s.B.norm(), C = s.C.norm();
  const double moved = A * A * s.before.norm() + B * B * s.Q.norm();
  const double p = s.predicts && !s.answers_predicted() ? moved : s.before.norm();  // what the prior is made of
  const double innovation = s.R.norm() + C * C * p, state = predictor ? moved : p;
  double gain = s.gain->norm(), allowed = 0;
  if (coding == Asymmetry::downdate || (!coding && predictor)) {
    // (v) comes to K by A Kf, which may cancel.
    const auto inverse = Re.inverse();
    if (!inverse) return std::nullopt;
    gain = A * (PC * *inverse).norm();
  }
  if (!coding) allowed = s.asymmetric() * C;
  // What whitens takes C for another, by k(R^{1/2}) u, and so is its residual.
  double scale = s.whitening() * (gain * innovation + std::sqrt(state * innovation));
  // Nobody knows whether a foreign filter has formed Re^{-1}: that times Re is off from I by k(Re) u, and K Re from P C' by
  // |P C'| times that.
  if (!coding) scale = std::max(scale, (predictor ? A : 1) * PC.norm() * Re.condition());
  // A foreign filter that holds P^{-1} has its gain from it.
  if (s.holds_information()) scale = std::max(scale, s.gain_amplification() * s.Re.norm());
  return s.compare(predictor ? "K Re" : "Kf Re", *s.gain * Re, predictor ? s.A * PC : PC, scale, allowed);
}

std::optional<Finding> of_information(const ObservedStep& s) {
  const auto R_inverse = s.R.inverse();
  if (!R_inverse) return std::nullopt;
  const double scale = std::sqrt(static_cast<double>(s.size.n)) * s.information->norm() * s.gain->norm() +
                       s.C.norm() * R_inverse->norm();
  return s.compare("P_{k|k}^-1 Kf", *s.information * *s.gain, s.C.transposed() * *R_inverse, scale);
}

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.p == 0 || s.size.n == 0 || !s.gain) return std::nullopt;
  return s.information ? of_information(s) : of_covariance(s);
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {
      .id = "gain-innovation",
      .statement =
          "K Re = A P C', Re = R + C P C' (Kf Re = P C' for a filter gain); of an information filter, which holds "
          "P_{k|k}, the same law as P_{k|k}^{-1} Kf = C' R^{-1}",
      .assumptions =
          "none; a residual, so k(Re) does not enter where Re is solved with: even a gain that is wrong by k(Re) u fulfils it",
      .source = "theory 2; the definition of the gain",
      .tolerance =
          "30 u (n+m+p) (|K| r + (a r)^{1/2}), r = |R| + |C|^2 |P|, a = |A|^2 |P| + |B|^2 |Q| (a = |P| for a filter "
          "gain; |A| |Kf| for |K| in coding (v), and in one that nobody knows), times k(R^{1/2}) of a form that whitens by "
          "R^{-1/2}; at least |A| |P C'| k(Re) of a coding that nobody knows, which may have formed Re^{-1}; "
          "30 u (n+m+p) (n^{1/2} |Y| |Kf| + |C| |R^{-1/2}|^2) for an information filter",
      .failure =
          "The gain does not belong to P: taken after the update instead of before, R used where its root is meant, a "
          "factor of A too many or too few.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::gain_innovation
