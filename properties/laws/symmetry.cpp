#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>

namespace kfstab::properties::laws::symmetry {

namespace {

/// What one step makes of the asymmetry D = P - P', to first order: theory 3. Re is taken as computed, unsymmetric.
Precise propagated(Asymmetry coding, const ObservedStep& s, const Precise& D) {
  const Precise A_D = s.A * D * s.A.transposed();
  const Precise KC = *s.gain * s.C;
  const Precise F = s.A - KC;
  const auto through = [&D](const Precise& X) { return X * D * X.transposed(); };
  switch (coding) {
    case Asymmetry::textbook: return through(F);
    case Asymmetry::mixed: return A_D + A_D - through(F);
    case Asymmetry::gain: return A_D - through(KC);
    case Asymmetry::cp:
    case Asymmetry::downdate: return A_D + through(KC);
    case Asymmetry::none: break;
  }
  return D - D;
}

/// The entry pair that is least alike.
std::string words(const Precise& P) {
  return largest_difference("P", P, P.transposed()) + ", the entry across the diagonal";
}

std::optional<Finding> look(const ObservedStep& s) {
  // P = SS' and P^{-1} = T'T are symmetric whatever S and T are.
  if (s.subject.holds != Held::covariance || s.size.n == 0) return std::nullopt;
  const Precise D_plus = s.P - s.P.transposed(), D = s.before - s.before.transposed();
  const auto coding = s.subject.asymmetry;
  std::optional<double> ratio;
  if (coding == Asymmetry::none) {
    ratio = s.ratio(D_plus.norm(), 1, s.P.norm());
  } else if (!coding) {
    // All that any coding makes of D: (3.i) to (3.v) and (3.8) with every sign that makes them larger.
    if (!s.update) return std::nullopt;
    const auto through = [&D](const Precise& X) { return (X * D * X.transposed()).norm(); };
    const Precise moved = s.predicts ? s.A : Precise::identity(s.size.n);
    const Precise KC = moved * s.update->Kf * s.C;
    const double carried = 2 * through(moved) + through(moved - KC) + through(KC);
    ratio = s.ratio(std::max(0.0, D_plus.norm() - carried), 1, s.amplification());
  } else {
    if (!s.gain) return std::nullopt;
    const double kappa = s.innovation_condition(), A = s.A.norm(), P = s.before.norm(), B = s.B.norm();
    // Beyond this D^2 counts, and the map is no longer what happens.
    if (!(D.norm() * kappa <= std::ldexp(P, -30))) return std::nullopt;
    // An error of the gain, u kappa K, enters P+ unsymmetrically by K C P A'.
    const double scale = A * A * P + B * B * s.Q.norm() + s.gain->norm() * s.C.norm() * P * A;
    ratio = s.ratio((D_plus - propagated(*coding, s, D)).norm(), kappa, scale);
  }
  if (!ratio) return std::nullopt;
  return Finding{*ratio, s.k, *ratio <= largest_ratio ? std::string() : words(s.P)};
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {
      .id = "symmetry",
      .statement =
          "P+ = P+'; where a coding lets P lose its symmetry: P+ - P+' is what the coding makes of P - P', by its "
          "formula (i) to (v), and no more than rounding besides; of an unknown coding, |P+ - P+'| <= 2 |A D A'| + |F "
          "D F'| "
          "+ |KC D (KC)'|, D = P - P', and rounding",
      .assumptions =
          "filters that hold P; of the unsymmetrised ones, steps with |P - P'| kappa <= 2^-30 |P|, where the formulas, "
          "of first order, hold",
      .source = "theory 3, after Verhaegen and Van Dooren 1986",
      .tolerance =
          "30 u (n+m+p) |P+|; unsymmetrised: 30 u (n+m+p) kappa (|A|^2 |P| + |B|^2 |Q| + |K| |C| |P| |A|), "
          "kappa = (|R| + |C|^2 |P|) |Re^{-1}|; of an unknown coding, that of one-step",
      .failure =
          "One half of P+ was computed in another way than the other, or a triangle was not copied. Of an "
          "unsymmetrised coding: it is not the coding that its metadata name.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::symmetry
