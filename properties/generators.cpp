#include <kfstab/properties/generators.hpp>

// At -O3, g++ 12 cannot see that rapidcheck's Maybe reads its value only where there is one.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <boost/random/normal_distribution.hpp>
#include <boost/random/uniform_int_distribution.hpp>
#include <boost/random/uniform_real_distribution.hpp>
#include <rapidcheck/Random.h>
#include <rapidcheck/seq/Create.h>
#include <rapidcheck/seq/Transform.h>
#include <rapidcheck/shrinkable/Create.h>
#include <rapidcheck/shrinkable/Operations.h>

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/properties/frame.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::properties {

namespace {

// --- drawing ------------------------------------------------------------------------------------------------------------

/// rc::Random as Boost's distributions take their bits.
class Bits {
 public:
  using result_type = std::uint64_t;

  explicit Bits(const rc::Random& random) : random_(random) {}
  static constexpr result_type min() { return 0; }
  static constexpr result_type max() { return std::numeric_limits<result_type>::max(); }
  result_type operator()() { return random_.next(); }

 private:
  rc::Random random_;
};

class Draw {
 public:
  explicit Draw(const rc::Random& random) : bits_(random) {}

  std::int64_t integer(std::int64_t least, std::int64_t most) {
    return boost::random::uniform_int_distribution<std::int64_t>(least, most)(bits_);
  }
  Index size(Range range, int growth) {
    const Index span = range.most - range.least;
    return integer(range.least, range.least + (span * std::clamp(growth, 0, 100) + 99) / 100);
  }
  bool one_in(int count) { return integer(1, count) == 1; }
  double real(double least, double most) { return boost::random::uniform_real_distribution<double>(least, most)(bits_); }
  double normal() { return normal_(bits_); }
  double power_of_two(int least, int most) { return std::ldexp(1.0, static_cast<int>(integer(least, most))); }

  Matrix<double> normal(Index rows, Index cols) {
    Matrix<double> X(rows, cols);
    for (Index i = 0; i < rows; ++i)
      for (Index j = 0; j < cols; ++j) X(i, j) = normal();
    return X;
  }

  /// One of 1, 1e2, 1e4 ... worst.
  double condition(double worst) {
    const auto rungs = static_cast<std::int64_t>(std::floor(std::log10(worst) / 2));
    return std::pow(100.0, static_cast<double>(integer(0, std::max<std::int64_t>(rungs, 0))));
  }

  /// count numbers from 1 down to 1 / condition, as DLATMS makes them in its modes 1 to 5.
  Vector<double> spectrum(Index count, double condition) {
    Vector<double> d = Vector<double>::Ones(count);
    if (count < 2) return d;
    const double last = static_cast<double>(count - 1);
    const auto mode = integer(1, 5);
    for (Index i = 0; i < count; ++i) {
      const double part = static_cast<double>(i) / last;
      switch (mode) {
        case 1: d(i) = i == 0 ? 1 : 1 / condition; break;
        case 2: d(i) = i == count - 1 ? 1 / condition : 1; break;
        case 3: d(i) = std::pow(condition, -part); break;
        case 4: d(i) = 1 - part * (1 - 1 / condition); break;
        default: d(i) = std::pow(condition, -real(0, 1)); break;
      }
    }
    return d;
  }

  /// The first cols columns of a random orthogonal matrix, rows >= cols.
  Matrix<double> frame(Index rows, Index cols) {
    if (rows == 0 || cols == 0) return Matrix<double>(rows, cols);
    return orthonormal_frame(normal(rows, cols));
  }

  Matrix<double> general(Index rows, Index cols, double condition) {
    const Index rank = std::min(rows, cols);
    if (rank == 0) return Matrix<double>(rows, cols);
    return frame(rows, rank) * spectrum(rank, condition).asDiagonal() * frame(cols, rank).transpose();
  }

  /// A lower root, n x n, of a covariance of that rank; its columns from rank on are 0.
  Matrix<double> root(Index n, Index rank, double condition) {
    Matrix<double> L = Matrix<double>::Zero(n, n);
    if (rank == 0) return L;
    if (rank == n && one_in(3)) {
      const Vector<double> d = spectrum(n, condition);
      for (Index i = 0; i < n; ++i) L(i, i) = std::sqrt(d(i));
    } else {
      const Matrix<double> M = spectrum(rank, condition).cwiseSqrt().asDiagonal() * frame(n, rank).transpose();
      L.leftCols(rank) = lower_root_of_gram(M);
    }
    return L * power_of_two(-3, 3);
  }

 private:
  Bits bits_;
  boost::random::normal_distribution<double> normal_;
};

Matrix<double> transition(Draw& draw, Index n, const Options& options) {
  Matrix<double> A = draw.general(n, n, draw.condition(options.worst_condition));
  if (n == 0) return A;
  const double radius = reference::spectral_radius(A);
  // Nearly nilpotent matrices stay as they are.
  if (radius > 1e-3) A *= draw.real(0.3, options.largest_radius) / radius;
  if (options.singular && draw.one_in(6)) {
    const Index i = draw.integer(0, n - 1), j = draw.integer(0, n - 1);
    if (i == j)
      A.col(i).setZero();  // as a delayed state has it
    else
      A.row(i) = A.row(j);
  }
  return A;
}

/// Fills a sequence with draws: one, or some over time.
template <class One>
Sequence over_time(Draw& draw, bool varying, std::int64_t steps, One one) {
  if (!varying || draw.one_in(2)) return Sequence(one());
  const bool listed = draw.one_in(2);
  std::vector<Matrix<double>> matrices(static_cast<std::size_t>(listed ? steps : draw.integer(2, 4)));
  for (Matrix<double>& X : matrices) X = one();
  return {listed ? Sequence::Kind::list : Sequence::Kind::periodic, std::move(matrices)};
}

Covariance covariance(Draw& draw, Index n, const Options& options, bool may_be_singular, bool varying, std::int64_t steps) {
  Covariance Q;
  Q.written = draw.one_in(2) ? Covariance::Written::covariance : Covariance::Written::root;
  Q.value = over_time(draw, varying, steps, [&] {
    const bool deficient = n > 0 && may_be_singular && draw.one_in(6);
    const Matrix<double> L = draw.root(n, deficient ? draw.integer(0, n - 1) : n, draw.condition(options.worst_condition));
    if (Q.written == Covariance::Written::root) return L;
    // Rounded once: that keeps it within what admissible_covariance allows, whatever its rank.
    const Precise exact(L);
    return (exact * exact.transposed()).rounded();
  });
  return Q;
}

System draw_system(const rc::Random& random, int growth, const Options& options) {
  Draw draw(random);
  const Index n = draw.size(options.n, growth), m = draw.size(options.m, growth), p = draw.size(options.p, growth);
  System system;
  system.name = "drawn";
  system.steps = draw.size({1, static_cast<Index>(options.most_steps)}, growth);
  const bool varying = options.time_varying && draw.one_in(4);

  system.A = over_time(draw, varying, system.steps, [&] { return transition(draw, n, options); });
  const auto input = [&](Index rows, Index cols) {
    return Matrix<double>(draw.general(rows, cols, draw.condition(options.worst_condition)) * draw.power_of_two(-3, 3));
  };
  system.B = over_time(draw, varying, system.steps, [&] { return input(n, m); });
  system.C = over_time(draw, varying, system.steps, [&] { return input(p, n); });
  system.D = Sequence(Matrix<double>(n, 0));
  system.Q = covariance(draw, m, options, options.singular, varying, system.steps);
  system.R = covariance(draw, p, options, false, varying, system.steps);
  system.P0 = covariance(draw, n, options, options.singular, false, system.steps);
  system.x0 = draw.normal(n, 1);
  return system;
}

// --- shrinking ----------------------------------------------------------------------------------------------------------

using Edit = std::function<void(System&)>;
using SequenceOf = Sequence System::*;
using CovarianceOf = Covariance System::*;
constexpr SequenceOf sequences[] = {&System::A, &System::B, &System::C, &System::D};
constexpr CovarianceOf covariances[] = {&System::Q, &System::R, &System::P0};

template <class Function>
void for_each_sequence(System& system, Function function) {
  for (const SequenceOf member : sequences) function(system.*member);
  for (const CovarianceOf member : covariances) function((system.*member).value);
}

void make_constant(Sequence& sequence) {
  sequence.kind = Sequence::Kind::constant;
  sequence.matrices.resize(1);
}

void set_steps(System& system, std::int64_t steps) {
  system.steps = steps;
  for_each_sequence(system, [&](Sequence& sequence) {
    if (sequence.kind == Sequence::Kind::list) sequence.matrices.resize(static_cast<std::size_t>(steps));
    if (sequence.matrices.size() == 1) make_constant(sequence);
  });
}

Matrix<double> without_row(const Matrix<double>& X, Index removed) {
  Matrix<double> Y(X.rows() - 1, X.cols());
  for (Index i = 0; i < Y.rows(); ++i)
    for (Index j = 0; j < Y.cols(); ++j) Y(i, j) = X(i < removed ? i : i + 1, j);
  return Y;
}

enum class Side { row, column, both };

void remove(Sequence& sequence, Side side, Index i) {
  for (Matrix<double>& X : sequence.matrices) {
    if (side != Side::column) X = without_row(X, i);
    if (side != Side::row) X = without_row(X.transpose(), i).transpose().eval();
  }
}

// A covariance without a row and its column is one; so is a lower root without them a lower root, if of another matrix.

void remove_state(System& system, Index i) {
  remove(system.A, Side::both, i);
  remove(system.B, Side::row, i);
  remove(system.C, Side::column, i);
  remove(system.D, Side::row, i);
  remove(system.P0.value, Side::both, i);
  system.x0 = without_row(system.x0, i);
}

void remove_noise(System& system, Index i) {
  remove(system.B, Side::column, i);
  remove(system.Q.value, Side::both, i);
}

void remove_output(System& system, Index i) {
  remove(system.C, Side::row, i);
  remove(system.R.value, Side::both, i);
}

bool is_power_of_two(double x) {
  int exponent = 0;
  return std::frexp(std::abs(x), &exponent) == 0.5;
}

double nearest_power_of_two(double x) { return std::copysign(std::exp2(std::round(std::log2(std::abs(x)))), x); }

/// What an entry may become: each is simpler than the entry (0 before 1 before powers of two before the rest), so that
/// shrinking ends.
std::vector<double> simpler(double x, bool may_be_zero) {
  std::vector<double> values;
  if (x == 0) return values;
  if (may_be_zero) values.push_back(0);
  if (x == 1) return values;
  values.push_back(1);
  if (!is_power_of_two(x) && std::isnormal(x)) values.push_back(nearest_power_of_two(x));
  return values;
}

void simplify_entries(std::vector<Edit>& edits, const System& system, SequenceOf member) {
  const Sequence& sequence = system.*member;
  for (std::size_t k = 0; k < sequence.matrices.size(); ++k)
    for (Index i = 0; i < sequence.rows(); ++i)
      for (Index j = 0; j < sequence.cols(); ++j)
        for (const double value : simpler(sequence.matrices[k](i, j), true))
          edits.push_back([=](System& edited) { (edited.*member).matrices[k](i, j) = value; });
}

void simplify_covariance(std::vector<Edit>& edits, const System& system, CovarianceOf member, bool may_be_singular) {
  const Covariance& Q = system.*member;
  const Index n = Q.value.rows();
  if (n == 0) return;
  const auto edit = [&](std::size_t k, auto change) {
    edits.push_back([=](System& edited) { change((edited.*member).value.matrices[k]); });
  };
  const bool all_identity =
      std::ranges::all_of(Q.value.matrices, [](const Matrix<double>& X) { return X == Matrix<double>::Identity(X.rows(), X.cols()); });
  if (all_identity) {
    if (Q.written == Covariance::Written::root)
      edits.push_back([=](System& edited) { (edited.*member).written = Covariance::Written::covariance; });
    if (may_be_singular) edit(0, [](Matrix<double>& X) { X.setZero(); });
    return;
  }
  for (std::size_t k = 0; k < Q.value.matrices.size(); ++k) {
    const Matrix<double>& X = Q.value.matrices[k];
    if (X != Matrix<double>::Identity(n, n) && !X.isZero(0)) edit(k, [n](Matrix<double>& Y) { Y.setIdentity(n, n); });
    if (!X.isDiagonal(0)) edit(k, [](Matrix<double>& Y) { Y = Matrix<double>(Y.diagonal().asDiagonal()); });
  }
  // A single entry of a covariance is free only if it stands alone; those of a root are free.
  const bool all_diagonal = std::ranges::all_of(Q.value.matrices, [](const Matrix<double>& X) { return X.isDiagonal(0); });
  if (Q.written == Covariance::Written::covariance && !all_diagonal) {
    std::vector<Matrix<double>> roots;
    for (const Matrix<double>& X : Q.value.matrices) {
      Matrix<double> V = X;
      if (cholesky_upper(V) != 0) return;  // singular: stays as it is
      mirror_upper(V);
      roots.push_back(V.triangularView<Eigen::Lower>());
    }
    edits.push_back([=, roots = std::move(roots)](System& edited) {
      (edited.*member).written = Covariance::Written::root;
      (edited.*member).value.matrices = roots;
    });
    return;
  }
  for (std::size_t k = 0; k < Q.value.matrices.size(); ++k)
    for (Index i = 0; i < n; ++i)
      for (Index j = 0; j <= i; ++j)
        for (const double value : simpler(Q.value.matrices[k](i, j), may_be_singular || i != j))
          edit(k, [=](Matrix<double>& X) { X(i, j) = value; });
}

/// What a failing system is tried as next, the boldest first.
std::vector<Edit> edits_of(const System& system, const Options& options) {
  std::vector<Edit> edits;
  for (const std::int64_t steps : {std::int64_t{1}, system.steps / 2, system.steps - 1})
    if (steps >= 1 && steps < system.steps) edits.push_back([=](System& edited) { set_steps(edited, steps); });
  if (!system.time_invariant()) {
    edits.push_back([](System& edited) { for_each_sequence(edited, make_constant); });
    for (const SequenceOf member : sequences)
      if ((system.*member).matrices.size() > 1) edits.push_back([=](System& edited) { make_constant(edited.*member); });
    for (const CovarianceOf member : covariances)
      if ((system.*member).value.matrices.size() > 1) edits.push_back([=](System& edited) { make_constant((edited.*member).value); });
  }
  const Dimensions size = system.dimensions();
  if (size.p > options.p.least)
    for (Index i = 0; i < size.p; ++i) edits.push_back([=](System& edited) { remove_output(edited, i); });
  if (size.m > options.m.least)
    for (Index i = 0; i < size.m; ++i) edits.push_back([=](System& edited) { remove_noise(edited, i); });
  if (size.n > options.n.least)
    for (Index i = 0; i < size.n; ++i) edits.push_back([=](System& edited) { remove_state(edited, i); });
  if (!system.x0.isZero(0)) edits.push_back([](System& edited) { edited.x0.setZero(); });
  for (const CovarianceOf member : covariances)
    simplify_covariance(edits, system, member, member != &System::R && options.singular);
  for (const SequenceOf member : sequences) simplify_entries(edits, system, member);
  return edits;
}

struct Shrinks {
  Options options;

  rc::Seq<System> operator()(const System& system) const {
    return rc::seq::map(rc::seq::fromContainer(edits_of(system, options)), [system](const Edit& edit) {
      System edited = system;
      edit(edited);
      return edited;
    });
  }
};

rc::Shrinkable<System> draw_numbered(const rc::Gen<System>& gen, std::uint64_t seed, int number, int cases) {
  const int size = cases > 1 ? static_cast<int>(static_cast<std::int64_t>(rc::kNominalSize) * number / (cases - 1)) : rc::kNominalSize;
  return gen(rc::Random(rc::Random::Key{seed, static_cast<std::uint64_t>(number), 0, 0}), size);
}

}  // namespace

rc::Gen<System> systems(const Options& options) {
  return [options](const rc::Random& random, int size) {
    return rc::shrinkable::shrinkRecur(draw_system(random, size, options), Shrinks{options});
  };
}

std::optional<Counterexample> smallest_failure(const rc::Gen<System>& gen, const std::function<bool(const System&)>& fails,
                                               std::uint64_t seed, int cases) {
  for (int number = 0; number < cases; ++number) {
    const rc::Shrinkable<System> drawn = draw_numbered(gen, seed, number, cases);
    System system = drawn.value();
    if (!fails(system)) continue;
    auto [smallest, shrinks] = rc::shrinkable::findLocalMin(drawn, fails);
    return Counterexample{std::move(smallest), std::move(system), number, shrinks};
  }
  return std::nullopt;
}

std::pair<System, std::size_t> smallest_of(const System& failing, const Options& options,
                                           const std::function<bool(const System&)>& fails) {
  return rc::shrinkable::findLocalMin(rc::shrinkable::shrinkRecur(failing, Shrinks{options}), fails);
}

std::vector<std::string> classes(const System& system) {
  std::vector<std::string> names;
  const Dimensions size = system.dimensions();
  if (size.n == 1) names.emplace_back("n = 1");
  if (size.n >= 3) names.emplace_back("n >= 3");
  names.emplace_back(size.p < size.n ? "p < n" : size.p == size.n ? "p = n" : "p > n");
  return names;
}

System drawn_system(const rc::Gen<System>& gen, std::uint64_t seed, int number, int cases) {
  return draw_numbered(gen, seed, number, cases).value();
}

}  // namespace kfstab::properties
