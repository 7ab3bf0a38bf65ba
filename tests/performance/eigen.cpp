// What a C++ user would write with Eigen.

#include <memory>

#include <Eigen/LU>
#include <Eigen/QR>

#include "contenders.hpp"

namespace performance {
namespace {

using Eigen::Dynamic;

template <int rows, int cols>
using Matrix = Eigen::Matrix<double, rows, cols>;

constexpr int sum(int x, int y) { return x == Dynamic || y == Dynamic ? Dynamic : x + y; }

template <int N, int H>
struct Model {
  Matrix<N, N> A, X;
  Matrix<N, H> B, K;
  Matrix<H, N> C;
  Matrix<H, H> Q, R;
};

template <int N, int H>
Model<N, H> model(const System& s, const std::vector<double>& Q, const std::vector<double>& R,
                  const std::vector<double>& initial) {
  const auto [n, m, p] = s.shape;
  const auto map = [](const std::vector<double>& numbers, int rows, int cols) {
    return Eigen::Map<const Eigen::MatrixXd>(numbers.data(), rows, cols);
  };
  return {map(s.A, n, n), map(initial, n, n), map(s.B, n, m), map(s.B, n, m),
          map(s.C, p, n), map(Q, m, m),       map(R, p, p)};
}

/// H noises, H outputs.
template <int N, int H>
Maybe qr(const System& s, bool gain) {
  struct Run {
    Model<N, H> m;
    Matrix<sum(N, sum(H, H)), sum(N, H)> pre;  // the pre-array, transposed
    Eigen::HouseholderQR<Matrix<sum(N, sum(H, H)), sum(N, H)>> qr;
  };
  const auto [n, m, p] = s.shape;
  auto run = std::make_shared<Run>();
  run->m = model<N, H>(s, s.Q_root, s.R_root, s.S0);
  run->pre.resize(p + n + m, p + n);
  return Contender{[run, gain, n = n, m = m, p = p] {
                     Model<N, H>& o = run->m;
                     auto& pre = run->pre;
                     pre.setZero();
                     pre.topLeftCorner(p, p) = o.R.transpose();
                     pre.block(p, 0, n, p).noalias() = (o.C * o.X).transpose();
                     pre.block(p, p, n, n).noalias() = (o.A * o.X).transpose();
                     pre.block(p + n, p, m, n).noalias() = (o.B * o.Q).transpose();
                     run->qr.compute(pre);
                     const auto& post = run->qr.matrixQR();
                     if (gain) {
                       o.K = post.block(0, p, p, n).transpose();
                       post.topLeftCorner(p, p)
                           .template triangularView<Eigen::Upper>()
                           .transpose()
                           .template solveInPlace<Eigen::OnTheRight>(o.K);
                     }
                     o.X = post.block(p, p, n, n).template triangularView<Eigen::Upper>().transpose();
                     return true;
                   },
                   [run] {
                     const Eigen::MatrixXd P = run->m.X * run->m.X.transpose();
                     return std::vector<double>(P.data(), P.data() + P.size());
                   }};
}

template <int N, int H>
Maybe textbook(const System& s) {
  auto run = std::make_shared<Model<N, H>>(model<N, H>(s, s.Q, s.R, s.P0));
  return Contender{[run] {
                     Model<N, H>& o = *run;
                     const Matrix<H, H> Re = o.C * o.X * o.C.transpose() + o.R;
                     const Matrix<N, H> Kf = o.X * o.C.transpose() * Re.inverse();
                     o.X = ((Matrix<N, N>::Identity(o.X.rows(), o.X.rows()) - Kf * o.C) * o.X).eval();
                     o.X = (o.A * o.X * o.A.transpose() + o.B * o.Q * o.B.transpose()).eval();
                     o.K = Kf;
                     return true;
                   },
                   [run] {
                     const Eigen::MatrixXd P = run->X;
                     return std::vector<double>(P.data(), P.data() + P.size());
                   }};
}

bool is_half(const Shape& shape) { return shape.m == shape.n / 2 && shape.p == shape.n / 2; }

}  // namespace

Maybe eigen_qr(const System& system, bool gain) { return qr<Dynamic, Dynamic>(system, gain); }

Maybe eigen_qr_fixed(const System& system, bool gain) {
  if (!is_half(system.shape)) return std::nullopt;
  switch (system.shape.n) {
    case 2: return qr<2, 1>(system, gain);
    case 4: return qr<4, 2>(system, gain);
    case 8: return qr<8, 4>(system, gain);
    case 16: return qr<16, 8>(system, gain);
    default: return std::nullopt;
  }
}

Maybe eigen_textbook(const System& system) { return textbook<Dynamic, Dynamic>(system); }

Maybe eigen_textbook_fixed(const System& system) {
  if (!is_half(system.shape)) return std::nullopt;
  switch (system.shape.n) {
    case 2: return textbook<2, 1>(system);
    case 4: return textbook<4, 2>(system);
    case 8: return textbook<8, 4>(system);
    case 16: return textbook<16, 8>(system);
    default: return std::nullopt;
  }
}

}  // namespace performance
