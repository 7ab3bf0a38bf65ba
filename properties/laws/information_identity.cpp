#include <kfstab/properties/law.hpp>

namespace kfstab::properties::laws::information_identity {

namespace {

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || !s.update || !s.first_order() || s.amplification() < underflow(s.subject)) return std::nullopt;
  const auto R_inverse = s.R.inverse();
  if (!R_inverse) return std::nullopt;
  const Precise gained = s.C.transposed() * *R_inverse * s.C * s.prior;
  const double enlarged = 1 + gained.norm();
  if (!s.answers_predicted())
    return s.compare("P_{k|k} + P_{k|k} C' R^-1 C P", s.P + s.P * gained, s.prior, s.amplification() * enlarged,
                     s.asymmetric() * enlarged);
  const auto back = s.A.transposed().inverse();
  if (!back) return std::nullopt;
  const Precise AP = (s.P - s.B * s.Q * s.B.transposed()) * *back;  // A P_{k|k}
  return s.compare("A P_{k|k} + A P_{k|k} C' R^-1 C P", AP + AP * gained, s.A * s.prior,
                   s.amplification() * back->norm() * enlarged, s.asymmetric() * back->norm() * enlarged);
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {.id = "information-identity",
          .statement =
              "P_{k|k}^{-1} = P_{k|k-1}^{-1} + C' R^{-1} C, without the inverses: P_{k|k} (I + C' R^{-1} C P_{k|k-1}) "
              "= P_{k|k-1}; P_{k|k} = A^{-1} (P+ - B Q B') A^{-T} where P+ is answered",
          .assumptions =
              "R regular, and A too where P+ is answered; steps whose Re is positive definite and within the reach of "
              "first-order bounds",
          .source = "theory (2.11); the matrix inversion lemma",
          .tolerance = "that of one-step, times 1 + |C' R^{-1} C P|, and |A^{-1}| where P+ is answered",
          .failure =
              "The update takes more or less out of the measurement than there is in it: R squared, halved or taken as "
              "its root, a row of C used twice or not at all.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::information_identity
