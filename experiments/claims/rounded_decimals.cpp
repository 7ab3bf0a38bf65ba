#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/reference/definiteness.hpp>

namespace kfstab::experiments::claims::rounded_decimals {
namespace {

// Numbers are counted in units of the last decimal, 1/1000: then A P A' + Q is exact in double, R = 1, and storing is
// rounding to an integer.

using Plane = Matrix<double, 2, 2>;

double half_up(double x) { return std::floor(x + .5); }
Plane stored(const Plane& P) { return P.unaryExpr(&half_up); }

Plane predicted(const Plane& P) {
  const Plane A{{1., 1.}, {0., 1.}}, Q{{.25, .5}, {.5, 1.}};
  return A * P * A.transpose() + Q;
}

constexpr double R = 1;

enum class Update { textbook, downdate, joseph };
constexpr std::array<std::pair<Update, const char*>, 3> updates = {
    {{Update::textbook, "P - Kf C P"}, {Update::downdate, "P - Kf Re Kf'"}, {Update::joseph, "Joseph's form"}}};

Plane updated(const Plane& P, Update update) {
  const double Re = P(0, 0) + R;
  const Vector<double, 2> Kf = P.col(0) / Re;
  Plane rest = Plane::Identity();
  rest.col(0) -= Kf;
  switch (update) {
    case Update::textbook: return rest * P;
    case Update::downdate: return P - Re * Kf * Kf.transpose();
    case Update::joseph: break;
  }
  return rest * P * rest.transpose() + R * Kf * Kf.transpose();
}

/// S, upper, with S S' = P.
Plane upper_root(const Plane& P) {
  const double d = std::sqrt(P(1, 1)), c = P(0, 1) / d;
  return Plane{{std::sqrt(P(0, 0) - c * c), c}, {0., d}};
}

/// k_2 of a 2 x 2 matrix, infinite if its determinant is 0; the integers here have exact determinants.
double condition(const Plane& X) {
  const double size = X.squaredNorm(), det = std::abs(X(0, 0) * X(1, 1) - X(0, 1) * X(1, 0));
  if (det == 0) return infinity;
  const double sum = std::sqrt(size + 2 * det), difference = std::sqrt(std::max(0., size - 2 * det));
  return (sum + difference) * (sum + difference) / (4 * det);
}

/// What is stored at the times T = 1, 2 ... : P_{k|k} by an update formula.
std::vector<Plane> covariances(Update update, int last) {
  std::vector<Plane> P{1e4 * Plane::Identity()};
  for (int T = 2; T <= last; ++T) P.push_back(stored(updated(predicted(P.back()), update)));
  return P;
}

/// The same with the upper root stored: S in units of 1/1000, so S S' is in units of 1e-6.
std::vector<Plane> roots(int last) {
  constexpr double unit = 1000;
  std::vector<Plane> S{stored(unit * std::sqrt(10.) * Plane::Identity())};
  for (int T = 2; T <= last; ++T) {
    const Plane P = predicted(Plane(S.back() * S.back().transpose() / unit));
    // Carlson's update, of the root and by no difference, of [a c; 0 d] measured by its first component.
    const Plane root = upper_root(P);
    const double Re = P(0, 0) + R, c = root(0, 1), below = R + root(0, 0) * root(0, 0);
    Plane next;
    next << root(0, 0) * std::sqrt(R / below), c * R / std::sqrt(below * Re), 0, root(1, 1) * std::sqrt(below / Re);
    S.push_back(stored(std::sqrt(unit) * next));
  }
  return S;
}

Findings measure(const Settings& set) {
  const int last = static_cast<int>(set("steps"));
  Findings findings;
  reports::Figure figure;
  figure.id = "rounded-decimals-condition";
  figure.title = "P with three decimals is singular at T = 4; its root with three decimals never";
  figure.caption = fmt::format(
      "What does it take to lose a covariance? P_{{k|k}} of a kinematic state, all arithmetic in double but that P is "
      "stored with three decimals. All update formulas store the same P, their curves lie on one another: singular at "
      "T = 4 (the gap), .001 I from then on, the correlation gone for good. Stored as a root with three decimals it is "
      "regular to T = {}. Dashed: what was published, and k(P) if all of its digits are stored.",
      last);
  figure.x = {"time T", false};
  figure.y = {"condition number of the stored matrix", true};

  const double golden = (7 + 3 * std::sqrt(5.)) / 2;
  for (const auto& [update, name] : updates) {
    const auto P = covariances(update, last);
    reports::Curve curve{fmt::format("P-{}", static_cast<int>(update)),
                         fmt::format("P by {}", name),
                         {},
                         {},
                         reports::CurveRole::measured_line,
                         static_cast<int>(update)};
    double singular_at = NaN;
    for (int T = 1; T <= last; ++T) {
      const Plane& X = P[static_cast<std::size_t>(T - 1)];
      if (std::isnan(singular_at) && !reference::is_positive_definite(Matrix<double>((X + X.transpose()) / 2)))
        singular_at = T;
      curve.x.push_back(T);
      curve.y.push_back(condition(X));
    }
    // A 2 x 2 matrix of integers below 2^26: its condition number is right to a few u k.
    findings.checks.push_back(check_close(fmt::format("{}: k(P) at T = 2", name), 5001, condition(P[1]), 1e-11));
    findings.checks.push_back(check_close(fmt::format("{}: k(P) at T = 3", name), golden, condition(P[2]), 1e-14));
    findings.checks.push_back(
        check_within(fmt::format("{}: T at which the stored P is definite no more", name), 4, singular_at, 0));
    findings.checks.push_back(check_within(fmt::format("{}: largest entry of P - .001 [1 1; 1 1] at T = 4", name), 0,
                                           (P[3] - Plane::Ones()).cwiseAbs().maxCoeff() / 1000, 0));
    double distance = 0;
    for (std::size_t T = 5; T <= P.size(); ++T)
      distance = std::max(distance, (P[T - 1] - Plane::Identity()).cwiseAbs().maxCoeff() / 1000);
    findings.checks.push_back(
        check_within(fmt::format("{}: largest entry of P - .001 I from T = 5 on", name), 0, distance, 0));
    figure.curves.push_back(std::move(curve));
  }

  const auto S = roots(last);
  reports::Curve curve{"root", "upper root of P", {}, {}, reports::CurveRole::measured_line, 3};
  int definite = 0;
  for (int T = 1; T <= last; ++T) {
    const Plane& X = S[static_cast<std::size_t>(T - 1)];
    curve.x.push_back(T);
    curve.y.push_back(condition(X));
    definite += X(0, 0) > 0 && X(1, 1) > 0;
  }
  findings.checks.push_back(check_close("root: k(S) at T = 2", 69.875, condition(S[1]), 1e-11));
  findings.checks.push_back(check_close("root: k(S) at T = 3", 2.47950642702487, condition(S[2]), 1e-14));
  findings.checks.push_back(check_within("root: times at which the stored S is regular", last, definite, 0));
  figure.curves.push_back(std::move(curve));
  figure.curves.push_back({"theory-P", "published: P", {2, 3}, {5001, golden}, reports::CurveRole::theory, -1});
  figure.curves.push_back(
      {"theory-S", "published: root", {2, 3}, {69.875, 2.47950642702487}, reports::CurveRole::theory, -1});
  reports::Curve whole{"theory-whole", "all digits of P stored", {}, {}, reports::CurveRole::theory, -1};
  Plane P = 1e4 * Plane::Identity();
  for (int T = 1; T <= last; ++T, P = updated(predicted(P), Update::joseph)) {
    whole.x.push_back(T);
    whole.y.push_back(condition(P));
  }
  figure.curves.push_back(std::move(whole));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "rounded-decimals",
      .number = 17,
      .title = "A covariance stored with three decimals is singular after three steps, a root so stored never",
      .statement =
          "Where P_{k|k} is stored with three decimals it becomes exactly singular at T = 4, whatever update formula "
          "computes it; the triangular root, stored with as many decimals, stays regular.",
      .source = "Evangelidis and Parker, FM 2019; the root form after Carlson and Schmidt",
      .setup =
          "A = [1 1; 0 1], Q = .001 [.25 .5; .5 1], C = [1 0], R = .001, P = 10 I at T = 1. Each T predicts, updates "
          "and stores P_{k|k}, rounded half-up to three decimals. Singular is decided exactly.",
      .prediction =
          "k(P) = 5001 at T = 2, (7 + 3 5^1/2)/2 at T = 3, P = .001 [1 1; 1 1] at T = 4 and .001 I from T = 5 on; k(S) "
          "= 69.875 and 2.47950642702487, and S regular to the end.",
      .meaning = "In fixed point, or with few digits, store a root: definiteness is then no question of digits.",
      .parameters = {{"steps", 20, "the last T", 5, 10000}},
      .measure = measure,
      .mathematics =
          "P_{k|k} = (I - Kf C) P,  P+ = A P_{k|k} A' + B Q B'\n"
          "P_{k|k} := 10^-3 floor(10^3 P_{k|k} + 1/2)\n"
          "P_{4|4} = 10^-3 [1, 1; 1, 1],  det P_{4|4} = 0\n"
          "P_{k|k} = S S':  det S != 0  for S so stored"};
}

}  // namespace kfstab::experiments::claims::rounded_decimals
