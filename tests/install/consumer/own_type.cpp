// A project of somebody else's: a filter of its own type under all laws, and the header of those that are shared libraries.
#include <Eigen/LU>

#include <kfstab/properties/googletest.hpp>
#include <kfstab_filter.h>

namespace {

using kfstab::Matrix;
using kfstab::Vector;

struct MyFilter {
  void start(const Vector<double>& x, const Matrix<double>& P) {
    x_ = x;
    P_ = P;
  }
  bool step(const kfstab::properties::StepInput& in) {
    if (in.y) {
      const Matrix<double> PC = P_ * in.C.transpose();
      const Matrix<double> Re = in.R + in.C * PC;
      const Eigen::FullPivLU<Matrix<double>> lu(Re.transpose());
      if (!lu.isInvertible()) return false;
      Kf_ = lu.solve(PC.transpose()).transpose();
      x_ += Kf_ * (*in.y - in.C * x_);
      P_ -= Kf_ * PC.transpose();
    }
    x_ = in.A * x_;
    if (in.u) x_ += *in.D * *in.u;
    P_ = in.A * P_ * in.A.transpose() + in.B * in.Q * in.B.transpose();
    P_ = (P_ + P_.transpose()).eval() / 2;
    return true;
  }
  Vector<double> state() const { return x_; }
  Matrix<double> covariance() const { return P_; }
  Matrix<double> filter_gain() const { return Kf_; }

 private:
  Vector<double> x_;
  Matrix<double> P_, Kf_;
};

}  // namespace

KFSTAB_CHECK(MyFilter);

static_assert(KFSTAB_FILTER_ABI == 1);
