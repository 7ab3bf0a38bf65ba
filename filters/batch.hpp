#pragma once

#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

#include <kfstab/filters/conventional.hpp>
#include <kfstab/filters/kernels.hpp>
#include <kfstab/filters/kernels/batch_covariance_kernel.hpp>
#include <kfstab/filters/square_root_covariance.hpp>
#include <kfstab/filters/square_root_information.hpp>

namespace kfstab::kernels {

/// All filters of a batch, where there are no kernels.
template <class BatchStep>
void give_up(const BatchStep& step) {
  for (Index group = 0; group < step.groups; ++group) step.gave_up[group] = 0xff;
}

#ifdef KFSTAB_FILTERS_LIBRARY
inline void run(const BatchArrayStep& step, const Kernels* chosen) {
  if (const Kernels* kernels = chosen ? chosen : in_use())
    kernels->batch_array_step(step);
  else
    give_up(step);
}

inline void run(const BatchCovarianceStep& step, const Kernels* chosen) {
  if (const Kernels* kernels = chosen ? chosen : in_use())
    kernels->batch_covariance_step(step);
  else
    give_up(step);
}
#else
struct Kernels;
#ifdef KFSTAB_KERNELS
inline void run(const BatchArrayStep& step, const Kernels*) { KFSTAB_KERNELS::batch_array_step(step); }
inline void run(const BatchCovarianceStep& step, const Kernels*) { KFSTAB_KERNELS::batch_covariance_step(step); }
#else
inline void run(const BatchArrayStep& step, const Kernels*) { give_up(step); }
inline void run(const BatchCovarianceStep& step, const Kernels*) { give_up(step); }
#endif
#endif

/// Whether a batch of filters of sizes that may be known has a kernel of its own, in the user's source. It is the library's
/// that is faster where that source is compiled for narrow vectors, and the machine may have wide ones.
template <int n, int m, int p>
constexpr bool batch_of_its_own() {
#ifdef KFSTAB_KERNELS
#ifdef KFSTAB_FILTERS_LIBRARY
  constexpr Index least_width = 4;
#else
  constexpr Index least_width = 1;
#endif
  if constexpr (n != Dynamic && m != Dynamic && p != Dynamic)
    return KFSTAB_KERNELS::width >= least_width && KFSTAB_KERNELS::fixed_batch_pays(n, m, p);
#endif
  return false;
}

/// run(step, chosen), or by a kernel of its own, n, m, p of the array.
template <bool of_its_own, int n, int m, int p, bool information>
void run_sized(const BatchArrayStep& step, const Kernels* chosen) {
#ifdef KFSTAB_KERNELS
  if constexpr (of_its_own) return KFSTAB_KERNELS::fixed_batch_array_step<n, m, p, information>(step);
#endif
  run(step, chosen);
}
template <bool of_its_own, int n, int m, int p>
void run_sized(const BatchCovarianceStep& step, const Kernels* chosen) {
#ifdef KFSTAB_KERNELS
  if constexpr (of_its_own) return KFSTAB_KERNELS::fixed_batch_covariance_step<n, m, p>(step);
#endif
  run(step, chosen);
}

}  // namespace kfstab::kernels

namespace kfstab {

/// Many filters of one shape, independent of each other, in doubles: a Filter for each, at a fraction of the price of so many
/// steps, as eight or sixteen of them are done at once, one in each lane of a vector.
///
///     Batch<SquareRootCovarianceFilter<double, 4, 2, 2>> batch(1000);
///     batch.start(i, S0, x0), batch.set_model(i, model)      for every i
///     batch.step();
///
/// A filter that fails keeps what it held, and the others go on. One whose numbers the kernels do not dare to square is done
/// alone, as Filter does it. Numbers are held filter by filter innermost, so whatever is asked of one of them is gathered,
/// and a copy.
///
/// @tparam Filter  ConventionalFilter, SquareRootCovarianceFilter or SquareRootInformationFilter of double. Where its sizes are
///   known and small, the kernel is compiled for them, in the user's source.
template <class Filter>
class Batch {
 public:
  using Model = typename Filter::Model;
  using Output = typename Filter::Output;
  static constexpr int N = Model::states, M = Model::noises, P = Model::outputs;
  static constexpr bool conventional = std::is_same_v<Filter, ConventionalFilter<double, N, M, P>>,
                        covariance_root = std::is_same_v<Filter, SquareRootCovarianceFilter<double, N, M, P>>,
                        information = std::is_same_v<Filter, SquareRootInformationFilter<double, N, M, P>>;
  static_assert(conventional || covariance_root || information, "there are no batches of this filter");
  /// Whether the kernel is one for these sizes, in the user's source. The array of the information form is that of the dual
  /// system.
  static constexpr bool of_its_own =
      information ? kernels::batch_of_its_own<N, P, M>() : kernels::batch_of_its_own<N, M, P>();

  /// @param count  how many    @param d  the shape of each
  /// @param tolerance  as the filter's, and <= 0 means the filter's own
  explicit Batch(Index count, Dimensions d = {N, M, P}, double tolerance = 0)
      : d_(d), tolerance_(tolerance > 0 ? tolerance : default_tolerance<double>(information ? d.n : d.p)),
        groups_((count + 15) / 16 * 2), A_(groups_, d.n, d.n), B_(groups_, d.n, d.m), C_(groups_, d.p, d.n),
        Q_(groups_, d.m, d.m), R_(groups_, d.p, d.p), w_(groups_, information ? d.m : 0, 1), held_(groups_, d.n, d.n),
        next_(held_), root_(groups_, covariance_root ? d.p : 0, covariance_root ? d.p : 0), next_root_(root_),
        gain_(groups_, d.n, d.p), next_gain_(gain_), x_(groups_, d.n, 1), next_x_(x_), y_(groups_, d.p, 1),
        Du_(groups_, d.n, 1), rcond_(groups_, 1, 1), gave_up_(static_cast<std::size_t>(groups_)),
        kernel_work_(static_cast<std::size_t>(work_size(d))), reports_(static_cast<std::size_t>(count)),
        alone_(d, tolerance), alone_held_(d.n, d.n), alone_x_(d.n), alone_y_(d.p), alone_Du_(d.n) {
    if constexpr (information) {
      model_.A_inverse.resize(d.n, d.n);
      model_.A_inverse_B.resize(d.n, d.m);
      model_.Q_inverse_root.resize(d.m, d.m);
      model_.R_inverse_root.resize(d.p, d.p);
      model_.w_mean.resize(d.m);
    } else {
      model_.A.resize(d.n, d.n);
      model_.B.resize(d.n, d.m);
      if constexpr (conventional) {
        model_.Q.resize(d.m, d.m);
        model_.R.resize(d.p, d.p);
      } else {
        model_.Q_root.resize(d.m, d.m);
        model_.R_root.resize(d.p, d.p);
      }
    }
    model_.C.resize(d.p, d.n);
    model_.D.setIdentity(d.n, d.n);
  }

  Index count() const { return static_cast<Index>(reports_.size()); }

  /// From now on steps are done by these kernels of the library, whatever is in use; null: by those in use, and by every filter
  /// alone where that is the plain text.
  void use(const kernels::Kernels* kernels) requires(!of_its_own) { chosen_ = kernels; }

  /// Takes what filter i holds at first, P0, S0 or T0, and x0, as Filter::start does.
  template <class InitialType, class X0Type>
  void start(Index i, const InitialType& initial, const X0Type& x0) {
    set<held_by>(held_, i, initial);
    x_.set(i, x0);
    gain_.set_zero(i);
  }

  /// The model of filter i, from the next step on.
  void set_model(Index i, const Model& model) requires(!information) {
    A_.set(i, model.A);
    B_.set(i, model.B);
    C_.set(i, model.C);
    if constexpr (conventional) {
      set<Part::upper>(Q_, i, model.Q);
      set<Part::upper>(R_, i, model.R);
    } else {
      if (model.Q_root.rows() == 0)  // B holds B Q^{1/2}
        Q_.set_identity(i);
      else
        set<Part::lower_alone>(Q_, i, model.Q_root);
      set<Part::lower_alone>(R_, i, model.R_root);
    }
  }
  /// The models of filter i, from the next step on, as SquareRootInformationFilter::step takes them.
  /// @param model  of step k: A, B, Q and the mean of w    @param next  of step k+1: C, R
  void set_model(Index i, const Model& model, const Model& next) requires(information) {
    A_.set(i, model.A_inverse);
    B_.set(i, model.A_inverse_B);
    set<Part::upper_alone>(Q_, i, model.Q_inverse_root);
    if (model.w_mean.size() > 0) {
      w_.set(i, model.w_mean);
      has_mean_ = true;
    } else {
      w_.set_zero(i);
    }
    C_.set(i, next.C);
    set<Part::upper_alone>(R_, i, next.R_inverse_root);
  }
  void set_model(Index i, const Model& model) requires(information) { set_model(i, model, model); }

  /// y (p) and D u (n; null: 0) of filter i for the next step with data. They stay until others come.
  void set_data(Index i, const Output& y, const Vector<double, N>* Du = nullptr) {
    y_.set(i, y);
    if (Du) {
      Du_.set(i, *Du);
      has_input_ = true;
    } else {
      Du_.set_zero(i);
    }
  }

  /// One combined step of each filter, as Filter::step does it. Allocates nothing.
  /// @param with_data  states are computed, too
  /// @param wanted  ConventionalFilter makes its gain and rcond always
  void step(bool with_data = false, Wanted wanted = Wanted::all) {
    if (covariance_root && wanted == Wanted::factor) with_data = false;
    const bool has_gain = conventional || (information ? wants_gain(wanted) : wanted != Wanted::factor),
               has_rcond = conventional || wants_rcond(wanted);
    run_kernel(with_data, has_gain, has_rcond);
    for (Index i = 0; i < count(); ++i) {
      if (gave_up_[static_cast<std::size_t>(i / 8)] >> i % 8 & 1) {
        step_alone(i, with_data, wanted);
        continue;
      }
      auto& report = reports_[static_cast<std::size_t>(i)];
      report = {Status::ok, std::numeric_limits<double>::quiet_NaN()};
      bool regular = true;
      if (has_rcond) {
        report.rcond = rcond_.at(i, 0, 0);
        regular = report.rcond >= tolerance_;
      } else if (information && has_gain && d_.p == 0 && !with_data) {
        // In all other cases the kernel has divided by what is singular, and given up.
        for (Index j = 0; j < d_.n; ++j) regular = regular && next_.at(i, j, j) != 0;
      }
      if (regular) continue;
      report.status = information ? Status::singular_information : Status::singular_innovation;
      keep(i);
    }
    held_.swap(next_);
    root_.swap(next_root_);
    if (has_gain) gain_.swap(next_gain_);
    if (with_data) x_.swap(next_x_);
  }

  /// How filter i ended the last step: the statuses of Filter. rcond is no estimate here but that of the 1-norm, which
  /// estimates exceed, seldom by more than a factor 3.
  const StepReport<double>& report(Index i) const { return reports_[static_cast<std::size_t>(i)]; }
  /// P, S or T, n x n: symmetric to the last bit, zero above the diagonal, zero below it.
  Matrix<double, N, N> held(Index i) const {
    Matrix<double, N, N> X(d_.n, d_.n);
    get<held_by>(held_, i, X);
    return X;
  }
  /// The predictor gain A P C' Re^{-1} of SquareRootCovarianceFilter, the filter gain of the others, n x p, of the last step
  /// that asked for it.
  Matrix<double, N, P> gain(Index i) const {
    Matrix<double, N, P> K(d_.n, d_.p);
    gain_.get(i, K);
    return K;
  }
  Vector<double, N> state(Index i) const {
    Vector<double, N> x(d_.n);
    x_.get(i, x);
    return x;
  }
  /// Re^{1/2}, p x p, lower, zero above the diagonal, of the last step.
  Matrix<double, P, P> innovation_root(Index i) const requires(covariance_root) {
    Matrix<double, P, P> Re_root(d_.p, d_.p);
    get<Part::lower_alone>(root_, i, Re_root);
    return Re_root;
  }

 private:
  /// What of a matrix is read and kept: a triangle, the other being zero, or all of it, symmetric, by its upper triangle.
  enum class Part { upper, lower_alone, upper_alone };
  static constexpr Part held_by = conventional ? Part::upper : covariance_root ? Part::lower_alone : Part::upper_alone;

  /// One matrix of every filter: those of eight filters after another.
  struct Numbers {
    Index rows = 0, cols = 0;
    std::vector<kernels::Eight> eights = {};

    Numbers(Index groups, Index rows_, Index cols_)
        : rows(rows_), cols(cols_), eights(static_cast<std::size_t>(groups * rows_ * cols_)) {}
    double& at(Index i, Index row, Index col) {
      return eights[static_cast<std::size_t>((i / 8 * cols + col) * rows + row)].lane[i % 8];
    }
    double at(Index i, Index row, Index col) const {
      return eights[static_cast<std::size_t>((i / 8 * cols + col) * rows + row)].lane[i % 8];
    }
    template <class MatrixType>
    void set(Index i, const MatrixType& X) {
      for (Index col = 0; col < cols; ++col)
        for (Index row = 0; row < rows; ++row) at(i, row, col) = X(row, col);
    }
    template <class MatrixType>
    void get(Index i, MatrixType& X) const {
      for (Index col = 0; col < cols; ++col)
        for (Index row = 0; row < rows; ++row) X(row, col) = at(i, row, col);
    }
    void set_zero(Index i) {
      for (Index col = 0; col < cols; ++col)
        for (Index row = 0; row < rows; ++row) at(i, row, col) = 0;
    }
    void set_identity(Index i) {
      for (Index col = 0; col < cols; ++col)
        for (Index row = 0; row < rows; ++row) at(i, row, col) = row == col ? 1 : 0;
    }
    void swap(Numbers& other) { eights.swap(other.eights); }
  };

  template <Part part, class MatrixType>
  static void set(Numbers& to, Index i, const MatrixType& X) {
    for (Index col = 0; col < to.cols; ++col)
      for (Index row = 0; row < to.rows; ++row) {
        const bool read = part == Part::lower_alone ? row >= col : row <= col;
        to.at(i, row, col) = read ? X(row, col) : part == Part::upper ? X(col, row) : 0;
      }
  }
  template <Part part, class MatrixType>
  static void get(const Numbers& from, Index i, MatrixType& X) {
    for (Index col = 0; col < from.cols; ++col)
      for (Index row = 0; row < from.rows; ++row) {
        const bool kept = part == Part::upper || (part == Part::lower_alone ? row >= col : row <= col);
        X(row, col) = kept ? from.at(i, row, col) : 0;
      }
  }

  static Index work_size(const Dimensions& d) {
    if (of_its_own) return 0;
    return conventional  ? kernels::batch_covariance_work(d.n, d.m, d.p)
           : information ? kernels::batch_array_work(d.n, d.p, d.m)
                         : kernels::batch_array_work(d.n, d.m, d.p);
  }

  void run_kernel(bool with_data, bool has_gain, bool has_rcond) {
    const kernels::Eight *x = with_data ? x_.eights.data() : nullptr, *Du = has_input_ ? Du_.eights.data() : nullptr;
    kernels::Eight *gain = has_gain ? next_gain_.eights.data() : nullptr,
                   *rcond = has_rcond ? rcond_.eights.data() : nullptr;
    if constexpr (conventional) {
      const kernels::BatchCovarianceStep step{.groups = groups_,
                                              .n = d_.n,
                                              .m = d_.m,
                                              .p = d_.p,
                                              .A = A_.eights.data(),
                                              .B = B_.eights.data(),
                                              .C = C_.eights.data(),
                                              .P = held_.eights.data(),
                                              .Q = Q_.eights.data(),
                                              .R = R_.eights.data(),
                                              .x = x,
                                              .y = y_.eights.data(),
                                              .Du = Du,
                                              .P_next = next_.eights.data(),
                                              .K = gain,
                                              .rcond = rcond,
                                              .x_next = next_x_.eights.data(),
                                              .gave_up = gave_up_.data(),
                                              .work = kernel_work_.data()};
      kernels::run_sized<of_its_own, N, M, P>(step, chosen_);
    } else {
      const kernels::BatchArrayStep step{.groups = groups_,
                                         .n = d_.n,
                                         .m = information ? d_.p : d_.m,
                                         .p = information ? d_.m : d_.p,
                                         .information = information,
                                         .A = A_.eights.data(),
                                         .B = (information ? C_ : B_).eights.data(),
                                         .C = (information ? B_ : C_).eights.data(),
                                         .S = held_.eights.data(),
                                         .Q = (information ? R_ : Q_).eights.data(),
                                         .R = (information ? Q_ : R_).eights.data(),
                                         .x = x,
                                         .y = y_.eights.data(),
                                         .Du = Du,
                                         .w = has_mean_ ? w_.eights.data() : nullptr,
                                         .S_next = next_.eights.data(),
                                         .Re = covariance_root ? next_root_.eights.data() : nullptr,
                                         .K = gain,
                                         .rcond = rcond,
                                         .x_next = next_x_.eights.data(),
                                         .gave_up = gave_up_.data(),
                                         .work = kernel_work_.data()};
      if constexpr (information)
        kernels::run_sized<of_its_own, N, P, M, true>(step, chosen_);
      else
        kernels::run_sized<of_its_own, N, M, P, false>(step, chosen_);
    }
  }

  /// What filter i holds becomes what it is to hold next.
  void keep(Index i) {
    for (auto [from, to] : {std::pair{&held_, &next_}, {&root_, &next_root_}, {&gain_, &next_gain_}, {&x_, &next_x_}})
      for (Index col = 0; col < from->cols; ++col)
        for (Index row = 0; row < from->rows; ++row) to->at(i, row, col) = from->at(i, row, col);
  }

  void step_alone(Index i, bool with_data, Wanted wanted) {
    get<held_by>(held_, i, alone_held_);
    x_.get(i, alone_x_);
    y_.get(i, alone_y_);
    Du_.get(i, alone_Du_);
    alone_.start(alone_held_, alone_x_);
    C_.get(i, model_.C);
    const Output* y = with_data ? &alone_y_ : nullptr;
    const Vector<double>* u = with_data ? &alone_Du_ : nullptr;  // D = I
    auto& report = reports_[static_cast<std::size_t>(i)];
    if constexpr (information) {
      A_.get(i, model_.A_inverse);
      B_.get(i, model_.A_inverse_B);
      Q_.get(i, model_.Q_inverse_root);
      R_.get(i, model_.R_inverse_root);
      w_.get(i, model_.w_mean);
      report = alone_.step(model_, model_, y, u, wanted);
    } else {
      A_.get(i, model_.A);
      B_.get(i, model_.B);
      if constexpr (conventional) {
        Q_.get(i, model_.Q);
        R_.get(i, model_.R);
        report = alone_.step(model_, y, u);
      } else {
        Q_.get(i, model_.Q_root);
        R_.get(i, model_.R_root);
        report = alone_.step(model_, y, u, wanted);
      }
    }
    if (!report) return keep(i);
    next_x_.set(i, alone_.state());
    if constexpr (conventional) {
      next_.set(i, alone_.covariance());
    } else if constexpr (covariance_root) {
      next_.set(i, alone_.factor());
      next_root_.set(i, alone_.innovation_root());
    } else {
      next_.set(i, alone_.information_factor());
    }
    if constexpr (covariance_root)
      next_gain_.set(i, alone_.predictor_gain());
    else
      next_gain_.set(i, alone_.filter_gain());
  }

  Dimensions d_;
  double tolerance_;
  Index groups_;  // of eight, an even number: kernels may take two at once
  Numbers A_, B_, C_, Q_, R_, w_, held_, next_, root_, next_root_, gain_, next_gain_, x_, next_x_, y_, Du_, rcond_;
  bool has_input_ = false, has_mean_ = false;
  std::vector<unsigned char> gave_up_;
  std::vector<kernels::Eight> kernel_work_;
  const kernels::Kernels* chosen_ = nullptr;
  std::vector<StepReport<double>> reports_;
  // One filter, for those that are done alone.
  Filter alone_;
  Model model_;
  Matrix<double, N, N> alone_held_;
  Vector<double, N> alone_x_;
  Output alone_y_;
  Vector<double> alone_Du_;
};

}  // namespace kfstab
