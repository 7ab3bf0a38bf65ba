#pragma once

#include <vector>

#include <kfstab/filters/kernels/batch_step.hpp>
#include <kfstab/filters/square_root_covariance.hpp>

namespace kfstab {

/// Many square-root covariance filters of one shape, independent of each other, in doubles: SquareRootCovarianceFilter for
/// each, at a fraction of the price of so many steps, as eight of them are done at once, one in each lane of a vector.
///
/// A filter that fails keeps what it held, and the others go on. One whose numbers the kernels do not dare to square is done
/// alone, as SquareRootCovarianceFilter does it. Numbers are held filter by filter innermost, so whatever is asked of one of
/// them is gathered, and a copy.
class SquareRootCovarianceBatch {
 public:
  using Model = RootModel<double>;

  /// @param count  how many    @param d  the shape of each
  /// @param tolerance  least reciprocal condition number of Re^{1/2} that counts as regular; <= 0 means p^2 u
  SquareRootCovarianceBatch(Index count, Dimensions d, double tolerance = 0);

  Index count() const { return static_cast<Index>(reports_.size()); }

  /// Takes S0 (n x n; the lower triangle is read), S0 S0' = P0, and x0 of filter i.
  void start(Index i, const Matrix<double>& S0, const Vector<double>& x0);
  /// The model of filter i, from the next step on. Q_root without rows says that B holds B Q^{1/2}.
  void set_model(Index i, const Model& model);
  /// y (p) and D u (n; null: 0) of filter i for the next step with data, after its model. They stay until others come.
  void set_data(Index i, const Vector<double>& y, const Vector<double>* Du = nullptr);

  /// One combined measurement and time update of each filter, from k|k-1 to k+1|k. Allocates nothing.
  /// @param with_data  states are computed, too
  void step(bool with_data = false, Wanted wanted = Wanted::all);

  /// How filter i ended the last step: the statuses of SquareRootCovarianceFilter. rcond is no estimate here but that of the
  /// 1-norm, which estimates exceed, seldom by more than a factor 3.
  const StepReport<double>& report(Index i) const { return reports_[static_cast<std::size_t>(i)]; }
  /// S, n x n, zero above the diagonal.
  Matrix<double> factor(Index i) const;
  /// K = A P C' Re^{-1}, n x p, of the last step that asked for it.
  Matrix<double> predictor_gain(Index i) const;
  /// Re^{1/2}, p x p, lower, zero above the diagonal, of the last step.
  Matrix<double> innovation_root(Index i) const;
  Vector<double> state(Index i) const;

 private:
  /// One matrix of every filter: those of eight filters after another.
  struct Numbers {
    Index rows = 0, cols = 0;
    std::vector<kernels::Eight> eights = {};

    Numbers(Index groups, Index rows_, Index cols_)
        : rows(rows_), cols(cols_), eights(static_cast<std::size_t>(groups * rows_ * cols_)) {}
    kernels::Eight* of(Index group) { return eights.data() + group * rows * cols; }
    const kernels::Eight* of(Index group) const { return eights.data() + group * rows * cols; }
    double& at(Index i, Index row, Index col) { return of(i / 8)[row + col * rows].lane[i % 8]; }
    double at(Index i, Index row, Index col) const { return of(i / 8)[row + col * rows].lane[i % 8]; }
    template <class MatrixType>
    void set(Index i, const MatrixType& X);
    template <class MatrixType>
    void get(Index i, MatrixType& X) const;
  };

  void step_alone(Index i, bool with_data, Wanted wanted);
  void keep(Index i);

  Dimensions d_;
  double tolerance_;
  Numbers A_, B_, C_, Q_, R_, S_, next_, Re_root_, next_Re_root_, gain_, next_gain_, x_, next_x_, y_, Du_;
  std::vector<kernels::Eight> kernel_work_;
  kernels::Eight rcond_;
  std::vector<StepReport<double>> reports_;
  // One filter, for those that are done alone; D u is the product of the identity with it.
  SquareRootCovarianceFilter<double> alone_;
  Model model_;
  Matrix<double> factor_;
  Vector<double> state_, output_, input_;
};

}  // namespace kfstab
