#pragma once

#include <Eigen/Core>
#include <Eigen/LU>

/// The filter of the textbooks, to be run on both sides of a door: the two have to agree bit by bit.
namespace kfstab::properties::testing {

template <class Scalar>
struct Textbook {
  using M = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
  using V = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
  V x;
  M P, K;

  void update(const M& C, const M& R, const V& y) {
    const M PC = P * C.transpose();
    const M Re = C * PC + R;
    K = Re.transpose().partialPivLu().solve(PC.transpose()).transpose();
    const V innovation = y - C * x;
    x += K * innovation;
    P -= K * PC.transpose();
    symmetrise();
  }
  void predict(const M& A, const M& B, const M& Q) {
    x = (A * x).eval();
    P = (A * P * A.transpose() + B * Q * B.transpose()).eval();
    symmetrise();
  }
  void symmetrise() { P = ((P + P.transpose()) / Scalar(2)).eval(); }
};

}  // namespace kfstab::properties::testing
