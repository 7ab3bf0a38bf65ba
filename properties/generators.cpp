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
#include <kfstab/properties/data.hpp>
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
    const auto rungs = static_cast<std::int64_t>(std::floor(std::log10(worst) / 2 + 1e-9));
    return std::pow(100.0, static_cast<double>(integer(0, std::max<std::int64_t>(rungs, 0))));
  }

  /// How ill-conditioned a system is to be: most are ordinary.
  double rung(double worst) {
    const auto eighth = integer(1, 8);
    return std::min(worst, eighth <= 4 ? 1e2 : eighth <= 6 ? 1e4 : eighth == 7 ? 1e8 : worst);
  }

  /// count numbers from 1 down to 1 / condition, as DLATMS makes them in its modes 1 to 5; both ends are there in mode 5 too.
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
        default: d(i) = std::pow(condition, i == 0 || i == count - 1 ? -part : -real(0, 1)); break;
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

/// Symmetric, of eigenvalues of both signs.
Matrix<double> symmetric(Draw& draw, Index n, double condition) {
  Vector<double> d = draw.spectrum(n, condition);
  for (Index i = 0; i < n; ++i)
    if (draw.one_in(2)) d(i) = -d(i);
  const Matrix<double> U = draw.frame(n, n);
  const Matrix<double> A = U * d.asDiagonal() * U.transpose();
  return A.selfadjointView<Eigen::Lower>();
}

/// States that no measurement sees, neither by itself nor through others.
using Unseen = std::vector<bool>;

Matrix<double> transition(Draw& draw, const Unseen& unseen, double worst, const Options& options) {
  const auto n = static_cast<Index>(unseen.size());
  if (n == 0) return Matrix<double>(0, 0);
  const bool all_seen = std::ranges::none_of(unseen, [](bool is) { return is; });
  const double condition = draw.condition(worst);
  const auto sixth = draw.integer(1, 6);
  Matrix<double> A = sixth == 1 && all_seen ? symmetric(draw, n, condition) : draw.general(n, n, condition);
  if (sixth == 2 && options.singular) {
    const Index i = draw.integer(0, n - 1), j = draw.integer(0, n - 1);
    if (i == j || !all_seen)
      A.col(i).setZero();  // as a delayed state has it
    else
      A.row(i) = A.row(j);
  }
  for (std::size_t i = 0; i < unseen.size(); ++i)
    for (std::size_t j = 0; j < unseen.size(); ++j)
      if (!unseen[i] && unseen[j]) A(static_cast<Index>(i), static_cast<Index>(j)) = 0;
  const bool unstable = draw.one_in(4) && options.largest_radius > 1;
  const double least = unstable ? 1 : 0.3,
               most = unstable ? options.largest_radius : std::min(1.0, options.largest_radius);
  const double radius = reference::spectral_radius(A);
  // Nearly nilpotent matrices stay as they are.
  if (radius > 1e-3) A *= draw.real(least, most) / radius;
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

struct Covariances {
  Draw& draw;
  const Options& options;
  double worst;  ///< condition number in the system
  bool varying;
  std::int64_t steps;

  /// Of P0, the condition is the system's worst itself.
  Covariance operator()(Index n, bool may_be_singular, bool is_P0 = false) {
    Covariance Q;
    Q.written = draw.one_in(2) ? Covariance::Written::covariance : Covariance::Written::root;
    Q.value = over_time(draw, varying && !is_P0, steps, [&] {
      const bool deficient = n > 0 && may_be_singular && draw.one_in(6);
      const double condition = is_P0 ? worst : draw.condition(worst);
      const Matrix<double> L = draw.root(n, deficient ? draw.integer(0, n - 1) : n, condition);
      if (Q.written == Covariance::Written::root) return L;
      // Rounded once: that keeps it within what admissible_covariance allows, whatever its rank.
      const Precise exact(L);
      return (exact * exact.transposed()).rounded();
    });
    return Q;
  }
};

constexpr double not_measured = std::numeric_limits<double>::quiet_NaN();

/// Takes whole steps or single entries out of y, one at least.
void leave_out(Draw& draw, Matrix<double>& y) {
  const Index p = y.rows(), steps = y.cols();
  const bool whole = p == 1 || draw.one_in(2);
  const Index i = draw.integer(0, p - 1), k = draw.integer(0, steps - 1);
  if (whole) {
    for (Index j = 0; j < steps; ++j)
      if (draw.one_in(3) || j == k) y.col(j).setConstant(not_measured);
  } else {
    for (Index j = 0; j < steps; ++j)
      for (Index r = 0; r < p; ++r)
        if (draw.one_in(4) || (r == i && j == k)) y(r, j) = not_measured;
  }
}

Vector<double> powers_of_two(Draw& draw, Index count, int largest) {
  Vector<double> s(count);
  const bool one = draw.one_in(2);
  const double common = draw.power_of_two(-largest, largest);
  for (Index i = 0; i < count; ++i) s(i) = one ? common : draw.power_of_two(-largest, largest);
  return s;
}

/// States and measurements in other units, T x and S y: a rounding nowhere.
void change_units(Draw& draw, System& system, Matrix<double>& y) {
  constexpr int largest = 20;
  const Vector<double> t = powers_of_two(draw, system.A.rows(), largest);
  const Vector<double> s = Vector<double>::Constant(system.C.rows(), draw.power_of_two(-largest, largest));
  const auto T = t.asDiagonal();
  const auto S = s.asDiagonal();
  const Vector<double> inverse = t.cwiseInverse();
  const auto scale = [](Covariance& Q, const auto& D) {
    for (Matrix<double>& X : Q.value.matrices)
      X = Q.written == Covariance::Written::root ? Matrix<double>(D * X) : Matrix<double>(D * X * D);
  };
  for (Matrix<double>& A : system.A.matrices) A = T * A * inverse.asDiagonal();
  for (Matrix<double>& B : system.B.matrices) B = T * B;
  for (Matrix<double>& C : system.C.matrices) C = S * C * inverse.asDiagonal();
  for (Matrix<double>& D : system.D.matrices) D = T * D;
  scale(system.R, S);
  scale(system.P0, T);
  system.x0 = T * system.x0;
  y = S * y;
}

System draw_system(const rc::Random& random, int growth, const Options& options) {
  Draw draw(random);
  const Index n = draw.size(options.n, growth), m = draw.size(options.m, growth), p = draw.size(options.p, growth);
  System system;
  system.name = "drawn";
  system.steps = draw.size({1, static_cast<Index>(options.most_steps)}, growth);
  const bool varying = options.time_varying && draw.one_in(4);
  const double worst = draw.rung(options.worst_condition);
  Unseen unseen(static_cast<std::size_t>(n));
  if (n > 1 && draw.one_in(6))
    for (Index left = draw.integer(1, n - 1); left > 0; --left)
      unseen[static_cast<std::size_t>(draw.integer(0, n - 1))] = true;

  system.A = over_time(draw, varying, system.steps, [&] { return transition(draw, unseen, worst, options); });
  const auto input = [&](Index rows, Index cols) {
    return Matrix<double>(draw.general(rows, cols, draw.condition(worst)) * draw.power_of_two(-3, 3));
  };
  system.B = over_time(draw, varying, system.steps, [&] { return input(n, m); });
  system.C = over_time(draw, varying, system.steps, [&] {
    Matrix<double> C = input(p, n);
    for (Index i = 0; i < n; ++i)
      if (unseen[static_cast<std::size_t>(i)]) C.col(i).setZero();
    return C;
  });
  Covariances covariance{draw, options, worst, varying, system.steps};
  system.Q = covariance(m, options.singular);
  system.R = covariance(p, false);
  system.P0 = covariance(n, options.singular, true);
  const auto magnitude = [&] { return draw.power_of_two(-10, 10); };
  system.x0 = Vector<double>::Zero(n);
  if (!draw.one_in(4)) system.x0 = draw.normal(n, 1) * magnitude();

  const bool with_data = options.data && !draw.one_in(8);
  const Index inputs = with_data && draw.one_in(3) ? draw.integer(1, 3) : 0;
  system.D = inputs == 0 ? Sequence(Matrix<double>(n, 0))
                         : over_time(draw, varying, system.steps, [&] { return input(n, inputs); });
  Matrix<double> y = draw.normal(p, system.steps) * magnitude(), u = draw.normal(inputs, system.steps) * magnitude();
  if (options.units && draw.one_in(8)) change_units(draw, system, y);
  if (options.missing && p > 0 && draw.one_in(4)) leave_out(draw, y);
  if (with_data) system.data = std::make_shared<Recorded>(std::move(y), std::move(u));
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

/// y and u of the system's steps, a step a column.
struct Series {
  Matrix<double> y, u;
};

Series series(const System& system) {
  Series all{Matrix<double>(system.C.rows(), system.steps), Matrix<double>(system.inputs(), system.steps)};
  const auto stream = system.data->open();
  for (Index k = 0; k < system.steps; ++k) {
    const StepData& step = stream->next();
    all.y.col(k) = step.y;
    if (step.u.size() > 0) all.u.col(k) = step.u;
  }
  return all;
}

/// The system with data that `change` makes of its own; as it is if it has none.
template <class Change>
void change_data(System& system, Change change) {
  if (!system.data) return;
  Series all = series(system);
  change(all);
  system.data = std::make_shared<Recorded>(std::move(all.y), std::move(all.u));
}

void remove_inputs(System& system) {
  change_data(system, [](Series& all) { all.u.resize(0, all.u.cols()); });
  system.D = Sequence(Matrix<double>(system.A.rows(), 0));
}

void remove_data(System& system) {
  remove_inputs(system);
  system.data = nullptr;
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

void remove_input(System& system, Index i) {
  change_data(system, [i](Series& all) { all.u = without_row(all.u, i); });
  remove(system.D, Side::column, i);
}

void remove_noise(System& system, Index i) {
  remove(system.B, Side::column, i);
  remove(system.Q.value, Side::both, i);
}

void remove_output(System& system, Index i) {
  change_data(system, [i](Series& all) { all.y = without_row(all.y, i); });
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

/// Entries of a whole matrix at once: 0, or the identity, or the diagonal alone.
void simplify_square(std::vector<Edit>& edits, const System& system, SequenceOf member) {
  const Sequence& sequence = system.*member;
  const auto edit = [&](std::size_t k, auto change) {
    edits.push_back([=](System& edited) { change((edited.*member).matrices[k]); });
  };
  for (std::size_t k = 0; k < sequence.matrices.size(); ++k) {
    const Matrix<double>& X = sequence.matrices[k];
    if (X.isZero(0) || X.rows() < 2) continue;
    edit(k, [](Matrix<double>& Y) { Y.setZero(); });
    if ((X.diagonal().array() != 0).all() && X != Matrix<double>::Identity(X.rows(), X.rows()))
      edit(k, [](Matrix<double>& Y) { Y.setIdentity(); });
    if (!X.isDiagonal(0)) edit(k, [](Matrix<double>& Y) { Y = Matrix<double>(Y.diagonal().asDiagonal()); });
  }
}

/// Data: nothing missing, all 0, entry by entry. There is simpler than missing.
void simplify_data(std::vector<Edit>& edits, const System& system) {
  const Series now = series(system);
  const auto edit = [&](auto change) { edits.push_back([=](System& edited) { change_data(edited, change); }); };
  const auto zeros = [](Matrix<double>& X) { X = X.array().isNaN().select(X, 0); };
  if (now.y.hasNaN()) edit([](Series& all) { all.y = all.y.array().isNaN().select(0, all.y); });
  const auto not_simple = [](const Matrix<double>& X) { return (!X.array().isNaN() && X.array() != 0).any(); };
  if (not_simple(now.y)) edit([zeros](Series& all) { zeros(all.y); });
  if (not_simple(now.u)) edit([zeros](Series& all) { zeros(all.u); });
  for (Matrix<double> Series::*member : {&Series::y, &Series::u}) {
    const Matrix<double>& X = now.*member;
    for (Index k = 0; k < X.cols(); ++k)
      for (Index i = 0; i < X.rows(); ++i)
        for (const double value : std::isnan(X(i, k)) ? std::vector<double>{0} : simpler(X(i, k), true))
          edit([=](Series& all) { (all.*member)(i, k) = value; });
  }
}

/// What a failing system is tried as next, the boldest first.
std::vector<Edit> edits_of(const System& system, const Options& options) {
  std::vector<Edit> edits;
  for (const std::int64_t steps : {std::int64_t{1}, system.steps / 2, system.steps - 1})
    if (steps >= 1 && steps < system.steps) edits.push_back([=](System& edited) { set_steps(edited, steps); });
  if (system.data) edits.push_back(remove_data);
  if (system.inputs() > 0) edits.push_back(remove_inputs);
  if (!system.time_invariant()) {
    edits.push_back([](System& edited) { for_each_sequence(edited, make_constant); });
    for (const SequenceOf member : sequences)
      if ((system.*member).matrices.size() > 1) edits.push_back([=](System& edited) { make_constant(edited.*member); });
    for (const CovarianceOf member : covariances)
      if ((system.*member).value.matrices.size() > 1) edits.push_back([=](System& edited) { make_constant((edited.*member).value); });
  }
  const Dimensions size = system.dimensions();
  // All that may go, all but one, then one by one.
  const auto remove_some = [&edits](Index count, Index least, auto one) {
    const auto all_but = [=](Index kept) {
      return [=](System& edited) {
        for (Index i = count - 1; i >= 0; --i)
          if (i < kept || i >= kept + least) one(edited, i);
      };
    };
    if (count <= least) return;
    edits.push_back(all_but(0));
    if (least > 0)
      for (Index kept = 1; kept + least <= count; ++kept) edits.push_back(all_but(kept));
    else if (count > 1)
      for (Index kept = 0; kept < count; ++kept)
        edits.push_back([=](System& edited) {
          for (Index i = count - 1; i >= 0; --i)
            if (i != kept) one(edited, i);
        });
    if (count > least + 1)
      for (Index i = 0; i < count; ++i) edits.push_back([=](System& edited) { one(edited, i); });
  };
  remove_some(size.p, options.p.least, remove_output);
  remove_some(size.m, options.m.least, remove_noise);
  remove_some(size.n, options.n.least, remove_state);
  remove_some(system.inputs(), 1, remove_input);
  if (!system.x0.isZero(0)) edits.push_back([](System& edited) { edited.x0.setZero(); });
  for (const CovarianceOf member : covariances)
    simplify_covariance(edits, system, member, member != &System::R && options.singular);
  simplify_square(edits, system, &System::A);
  for (const SequenceOf member : sequences) simplify_entries(edits, system, member);
  for (Index i = 0; i < system.x0.size(); ++i)
    for (const double value : simpler(system.x0(i), true))
      edits.push_back([=](System& edited) { edited.x0(i) = value; });
  if (system.data) simplify_data(edits, system);
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

std::pair<System, std::size_t> smallest_of(const System& failing, const Options& options,
                                           const std::function<bool(const System&)>& fails) {
  System smallest = failing;
  std::size_t shrinks = 0;
  std::vector<Edit> edits = edits_of(smallest, options);
  // Goes on where an edit was of use: what failed before it is tried again only when the rest has been.
  for (std::size_t next = 0, in_vain = 0; in_vain < edits.size(); next = next + 1 < edits.size() ? next + 1 : 0) {
    System edited = smallest;
    edits[next](edited);
    ++in_vain;
    if (!fails(edited)) continue;
    smallest = std::move(edited);
    ++shrinks;
    in_vain = 0;
    edits = edits_of(smallest, options);
    next = next > 0 ? next - 1 : edits.size();  // the same place in the new list
  }
  return {std::move(smallest), shrinks};
}

// --- words --------------------------------------------------------------------------------------------------------------

namespace {

Precise multiplied_out(const Covariance& Q) {
  const Precise X(Q.value.at(0));
  return Q.written == Covariance::Written::root ? X * X.transposed() : X;
}

bool diagonal(const Covariance& Q) {
  return std::ranges::all_of(Q.value.matrices, [](const Matrix<double>& X) { return X.isDiagonal(0); });
}

/// Singular to rounding, whatever the units.
bool singular(const Covariance& Q) {
  const Matrix<double> X = multiplied_out(Q).rounded();
  const Vector<double> deviations = X.diagonal().cwiseSqrt();
  if (X.rows() > 0 && deviations.minCoeff() == 0) return true;
  const auto inverse =
      Precise(deviations.cwiseInverse().asDiagonal() * X * deviations.cwiseInverse().asDiagonal()).inverse();
  return !inverse || inverse->norm() > 1e15;
}

/// |X| |X^{-1}| in the Frobenius norm, at least the condition number and at most n times it; 0 for a singular X.
double condition(const Precise& X) {
  const auto inverse = X.inverse();
  return inverse ? X.norm() * inverse->norm() : 0;
}

/// Some state reaches no measurement, neither by itself nor through others, at any time.
bool partially_observed(const System& system) {
  const Index n = system.A.rows();
  std::vector<bool> seen(static_cast<std::size_t>(n));
  const auto nonzero = [](const Sequence& sequence, Index i, Index j) {
    return std::ranges::any_of(sequence.matrices, [=](const Matrix<double>& X) { return X(i, j) != 0; });
  };
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < system.C.rows(); ++i)
      if (nonzero(system.C, i, j)) seen[static_cast<std::size_t>(j)] = true;
  for (Index round = 0; round < n; ++round)
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i)
        if (seen[static_cast<std::size_t>(i)] && nonzero(system.A, i, j)) seen[static_cast<std::size_t>(j)] = true;
  return std::ranges::find(seen, false) != seen.end();
}

bool far_from_1(const Covariance& Q) {
  const Matrix<double> X = multiplied_out(Q).rounded();
  if (X.rows() == 0 || X.isZero(0)) return false;
  return std::abs(std::log2(X.diagonal().maxCoeff())) > 12;
}

bool varies(const System& system) { return !system.time_invariant(); }

}  // namespace

std::vector<std::string> classes(const System& system) {
  std::vector<std::string> names;
  const auto count = [&names](const char* name, bool is) {
    if (is) names.emplace_back(name);
  };
  const auto [n, m, p] = system.dimensions();
  count("n = 1", n == 1);
  count("n = 2", n == 2);
  count("n >= 3", n >= 3);
  count("p < n", p < n);
  count("p = n", p == n);
  count("p > n", p > n);
  count("p = 0", p == 0);
  count("m = 0", m == 0);
  count("m != n", m != n);
  count("one step", system.steps == 1);
  count("time-varying", varies(system));

  const Matrix<double>& A = system.A.at(0);
  const bool singular_A = n > 0 && !Precise(A).inverse();
  count("non-symmetric A", A != A.transpose());
  count("non-normal A", n > 0 && (A * A.transpose() - A.transpose() * A).norm() > 1e-8 * A.squaredNorm());
  count("singular A", singular_A);
  count("unstable A", n > 0 && reference::spectral_radius(A) > 1);
  count("partially observed", p > 0 && partially_observed(system));

  const bool singular_Q = singular(system.Q), singular_P0 = singular(system.P0);
  count("correlated Q", !diagonal(system.Q));
  count("singular Q", m > 0 && singular_Q);
  count("correlated R", !diagonal(system.R));
  count("singular P0", n > 0 && singular_P0);
  double k = singular_A ? 0 : condition(A);
  k = std::max(k, condition(multiplied_out(system.R)));
  if (!singular_Q) k = std::max(k, condition(multiplied_out(system.Q)));
  if (!singular_P0) k = std::max(k, condition(multiplied_out(system.P0)));
  // Rungs are a hundred apart, so that a rounding of k, and n, are of no matter.
  count("k >= 1e4", k >= 0.9e4);
  count("k >= 1e8", k >= 0.9e8);
  count("k >= 1e12", k >= 0.9e12);
  count("units far from 1", far_from_1(system.R) || far_from_1(system.P0));

  count("x0 not 0", !system.x0.isZero(0));
  count("data", system.data != nullptr);
  count("known input", system.inputs() > 0);
  if (system.data) {
    const auto absent = series(system).y.array().isNaN().eval();
    const auto none = absent.colwise().all().eval(), some = absent.colwise().any().eval();
    count("steps without measurement", p > 0 && none.any());
    count("entries missing", p > 0 && (some != none).any());
  }
  return names;
}

std::vector<std::string> irrelevant(const System& drawn, const System& smallest) {
  std::vector<std::string> words;
  const auto say = [&words](bool is, std::string what) {
    if (is) words.push_back(std::move(what));
  };
  // What there were and are.
  const auto fewer = [&](std::int64_t were, std::int64_t are, const char* one, const char* many) {
    if (are >= were || are == 0) return;
    words.push_back(are == 1 ? std::string("one ") + one + " is enough"
                             : std::to_string(are) + " of " + std::to_string(were) + " " + many + " are enough");
  };
  const Dimensions was = drawn.dimensions(), is = smallest.dimensions();
  fewer(drawn.steps, smallest.steps, "step", "steps");
  fewer(was.n, is.n, "state", "states");
  fewer(was.p, is.p, "output", "outputs");
  fewer(was.m, is.m, "process noise", "process noises");
  say(was.m > 0 && is.m == 0, "B and Q do not matter");
  say(was.p > 0 && is.p == 0, "C and R do not matter");
  say(varies(drawn) && !varies(smallest), "nothing need change over time");
  const auto zero = [](const Sequence& X) {
    return std::ranges::all_of(X.matrices, [](const auto& Y) { return Y.isZero(0); });
  };
  say(!zero(drawn.A) && zero(smallest.A), "A does not matter");
  say(!zero(drawn.P0.value) && zero(smallest.P0.value), "P0 does not matter");
  for (const auto& [name, member] :
       {std::pair{"Q", &System::Q}, std::pair{"R", &System::R}, std::pair{"P0", &System::P0}})
    say(!diagonal(drawn.*member) && (smallest.*member).value.rows() > 1 && diagonal(smallest.*member),
        std::string("correlations in ") + name + " do not matter");
  if (!drawn.data) return words;
  if (!smallest.data) {
    words.emplace_back("no data needed");
    return words;
  }
  say(drawn.inputs() > 0 && smallest.inputs() == 0, "no known input needed");
  say(!drawn.x0.isZero(0) && smallest.x0.isZero(0), "x0 does not matter");
  say(measurements_missing(drawn) && !measurements_missing(smallest), "nothing need be missing");
  const auto nothing = [](const System& system) { return (series(system).y.array() == 0).all(); };
  say(is.p > 0 && !nothing(drawn) && nothing(smallest), "the values of y do not matter");
  return words;
}

System drawn_system(const rc::Gen<System>& gen, std::uint64_t seed, int number, int cases) {
  return draw_numbered(gen, seed, number, cases).value();
}

}  // namespace kfstab::properties
