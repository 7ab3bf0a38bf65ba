#include <kfstab/filters/batch.hpp>

namespace kfstab {

template <class MatrixType>
void SquareRootCovarianceBatch::Numbers::set(Index i, const MatrixType& X) {
  for (Index col = 0; col < cols; ++col)
    for (Index row = 0; row < rows; ++row) at(i, row, col) = X(row, col);
}

template <class MatrixType>
void SquareRootCovarianceBatch::Numbers::get(Index i, MatrixType& X) const {
  for (Index col = 0; col < cols; ++col)
    for (Index row = 0; row < rows; ++row) X(row, col) = at(i, row, col);
}

SquareRootCovarianceBatch::SquareRootCovarianceBatch(Index count, Dimensions d, double tolerance)
    : d_(d), tolerance_(tolerance > 0 ? tolerance : default_tolerance<double>(d.p)), A_((count + 7) / 8, d.n, d.n),
      B_((count + 7) / 8, d.n, d.m), C_((count + 7) / 8, d.p, d.n), Q_((count + 7) / 8, d.m, d.m),
      R_((count + 7) / 8, d.p, d.p), S_((count + 7) / 8, d.n, d.n), next_(S_), Re_root_(R_), next_Re_root_(R_),
      gain_((count + 7) / 8, d.n, d.p), next_gain_(gain_), x_((count + 7) / 8, d.n, 1), next_x_(x_),
      y_((count + 7) / 8, d.p, 1), Du_(x_),
      kernel_work_(static_cast<std::size_t>(kernels::batch_step_work(d.n, d.m, d.p))),
      reports_(static_cast<std::size_t>(count)), alone_(d, tolerance), factor_(d.n, d.n), state_(d.n), output_(d.p),
      input_(d.n) {
  model_.A.resize(d.n, d.n);
  model_.B.resize(d.n, d.m);
  model_.C.resize(d.p, d.n);
  model_.D.setIdentity(d.n, d.n);
  model_.Q_root.resize(d.m, d.m);
  model_.R_root.resize(d.p, d.p);
}

void SquareRootCovarianceBatch::start(Index i, const Matrix<double>& S0, const Vector<double>& x0) {
  for (Index col = 0; col < d_.n; ++col)
    for (Index row = col; row < d_.n; ++row) S_.at(i, row, col) = S0(row, col);
  x_.set(i, x0);
  for (Index col = 0; col < d_.p; ++col)
    for (Index row = 0; row < d_.n; ++row) gain_.at(i, row, col) = 0;
}

void SquareRootCovarianceBatch::set_model(Index i, const Model& model) {
  A_.set(i, model.A);
  B_.set(i, model.B);
  C_.set(i, model.C);
  for (Index col = 0; col < d_.m; ++col)
    for (Index row = col; row < d_.m; ++row)
      Q_.at(i, row, col) = model.Q_root.rows() == 0 ? static_cast<double>(row == col) : model.Q_root(row, col);
  for (Index col = 0; col < d_.p; ++col)
    for (Index row = col; row < d_.p; ++row) R_.at(i, row, col) = model.R_root(row, col);
}

void SquareRootCovarianceBatch::set_data(Index i, const Vector<double>& y, const Vector<double>* Du) {
  y_.set(i, y);
  for (Index row = 0; row < d_.n; ++row) Du_.at(i, row, 0) = Du ? (*Du)(row) : 0;
}

void SquareRootCovarianceBatch::step(bool with_data, Wanted wanted) {
  if (wanted == Wanted::factor) with_data = false;
  for (Index first = 0; first < count(); first += 8) {
    const Index group = first / 8, in_group = std::min<Index>(8, count() - first);
    const unsigned gave_up = kernels::run({.n = d_.n,
                                           .m = d_.m,
                                           .p = d_.p,
                                           .A = A_.of(group),
                                           .B = B_.of(group),
                                           .C = C_.of(group),
                                           .S = S_.of(group),
                                           .Q = Q_.of(group),
                                           .R = R_.of(group),
                                           .x = with_data ? x_.of(group) : nullptr,
                                           .y = y_.of(group),
                                           .Du = Du_.of(group),
                                           .S_next = next_.of(group),
                                           .Re = next_Re_root_.of(group),
                                           .K = wanted == Wanted::factor ? nullptr : next_gain_.of(group),
                                           .rcond = wanted == Wanted::all ? &rcond_ : nullptr,
                                           .x_next = next_x_.of(group),
                                           .work = kernel_work_.data()});
    for (Index lane = 0; lane < in_group; ++lane) {
      const Index i = first + lane;
      if (gave_up >> lane & 1) {
        step_alone(i, with_data, wanted);
        continue;
      }
      auto& report = reports_[static_cast<std::size_t>(i)];
      report = {Status::ok, std::numeric_limits<double>::quiet_NaN()};
      if (wanted != Wanted::all) continue;  // a zero pivot made the gain infinite, and the kernel gave up
      report.rcond = rcond_.lane[lane];
      if (report.rcond >= tolerance_) continue;
      report.status = Status::singular_innovation;
      keep(i);
    }
  }
  S_.eights.swap(next_.eights);
  Re_root_.eights.swap(next_Re_root_.eights);
  if (wanted != Wanted::factor) gain_.eights.swap(next_gain_.eights);
  if (with_data) x_.eights.swap(next_x_.eights);
}

/// What filter i holds becomes what it is to hold next.
void SquareRootCovarianceBatch::keep(Index i) {
  for (auto [from, to] : {std::pair{&S_, &next_}, {&Re_root_, &next_Re_root_}, {&gain_, &next_gain_}, {&x_, &next_x_}})
    for (Index col = 0; col < from->cols; ++col)
      for (Index row = 0; row < from->rows; ++row) to->at(i, row, col) = from->at(i, row, col);
}

void SquareRootCovarianceBatch::step_alone(Index i, bool with_data, Wanted wanted) {
  A_.get(i, model_.A);
  B_.get(i, model_.B);
  C_.get(i, model_.C);
  Q_.get(i, model_.Q_root);
  R_.get(i, model_.R_root);
  S_.get(i, factor_);
  x_.get(i, state_);
  y_.get(i, output_);
  Du_.get(i, input_);
  alone_.start(factor_, state_);
  auto& report = reports_[static_cast<std::size_t>(i)];
  report = alone_.step(model_, with_data ? &output_ : nullptr, with_data ? &input_ : nullptr, wanted);
  if (!report) return keep(i);
  next_.set(i, alone_.factor());
  next_Re_root_.set(i, alone_.innovation_root());
  next_gain_.set(i, alone_.predictor_gain());
  next_x_.set(i, alone_.state());
}

Matrix<double> SquareRootCovarianceBatch::factor(Index i) const {
  Matrix<double> S = Matrix<double>::Zero(d_.n, d_.n);
  for (Index col = 0; col < d_.n; ++col)
    for (Index row = col; row < d_.n; ++row) S(row, col) = S_.at(i, row, col);
  return S;
}

Matrix<double> SquareRootCovarianceBatch::predictor_gain(Index i) const {
  Matrix<double> K(d_.n, d_.p);
  gain_.get(i, K);
  return K;
}

Matrix<double> SquareRootCovarianceBatch::innovation_root(Index i) const {
  Matrix<double> Re_root = Matrix<double>::Zero(d_.p, d_.p);
  for (Index col = 0; col < d_.p; ++col)
    for (Index row = col; row < d_.p; ++row) Re_root(row, col) = Re_root_.at(i, row, col);
  return Re_root;
}

Vector<double> SquareRootCovarianceBatch::state(Index i) const {
  Vector<double> x(d_.n);
  x_.get(i, x);
  return x;
}

}  // namespace kfstab
