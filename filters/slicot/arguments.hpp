#pragma once

#include <initializer_list>

#include <kfstab/filters/matrix.hpp>

/// What the routines of this folder share: how they see a caller's arrays, and how they refuse an argument.
namespace kfstab::slicot {

/// A Fortran array X(LDX,*): the leading rows x cols part of it, columns LDX apart.
template <class S>
using View = Eigen::Map<Matrix<S>, Eigen::Unaligned, Eigen::OuterStride<>>;
template <class S>
using ConstView = Eigen::Map<const Matrix<S>, Eigen::Unaligned, Eigen::OuterStride<>>;
template <class S>
using VectorView = Eigen::Map<Vector<S>>;
template <class S>
using ConstVectorView = Eigen::Map<const Vector<S>>;

template <class S>
View<S> view(S* X, Index rows, Index cols, Index leading) {
  return View<S>(X, rows, cols, Eigen::OuterStride<>(leading));
}

template <class S>
ConstView<S> view(const S* X, Index rows, Index cols, Index leading) {
  return ConstView<S>(X, rows, cols, Eigen::OuterStride<>(leading));
}

/// A piece of the workspace, without gaps.
template <class S>
View<S> packed(S* work, Index rows, Index cols) {
  return view(work, rows, cols, rows);
}

/// INFO, and the reciprocal condition number that goes with it.
template <class S>
struct Result {
  int info = 0;
  S rcond = S(1);
};

/// Whether a caller's letter is this one, in either case.
inline bool is(const char* given, char letter) { return *given == letter || *given == letter - 'A' + 'a'; }

/// One argument, by its place in the list, and whether it may be so.
struct Check {
  int argument;
  bool legal;
};

/// Reports the first illegal argument, i, as INFO = -i and by a call of XERBLA. All are legal: INFO = 0, and false.
bool refuse(const char* routine, std::initializer_list<Check> checks, int* info);

}  // namespace kfstab::slicot
