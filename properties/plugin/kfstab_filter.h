#ifndef KFSTAB_FILTER_H
#define KFSTAB_FILTER_H

/*
 * A Kalman filter as a shared library that kfstab can check: the five functions below, and nothing to link to.
 *
 *     cc -shared -fPIC -o my_filter.so my_filter.c
 *     kfstab check --plugin ./my_filter.so
 *
 * This file is all that is needed, and may be copied. It is C and C++. Whatever the library does - crash, hang, print,
 * allocate without end - it does in a process of its own.
 *
 *     x_{k+1} = A x_k + B w_k + D u_k,   y_k = C x_k + v_k,   E w w' = Q,   E v v' = R
 *
 * Matrices are arrays of double, row by row: A(i,j) is A[i * n + j]. Nothing that is passed in may be kept or written
 * to: it is valid during the call. Calls come one at a time. There may be more than one filter at once.
 */

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define KFSTAB_EXPORT __attribute__((visibility("default")))
#else
#define KFSTAB_EXPORT
#endif

/* What kfstab_filter_abi() returns: raised by a change that a library of before cannot live with. */
#define KFSTAB_FILTER_ABI 1

typedef struct kfstab_filter_description {
  const char* name; /* as reports call it */

  /* "update-predict": starts from x_{0|-1}, P_{0|-1}; each step takes y_k, predicts, and answers x_{k+1|k}, P_{k+1|k}.
   * "predict-update": starts from x_{0|0}, P_{0|0}; each step predicts with A, B, Q, D u, then takes the measurement with
   * C, R, y, and answers x_{k+1|k+1}, P_{k+1|k+1}. */
  const char* cycle;

  const char* gain; /* "predictor": A P C' Re^{-1}; "filter": P C' Re^{-1}; "none" */

  /* Systems that are not for it, as words with blanks between, or NULL: invertible-A, positive-definite-Q,
   * positive-definite-R, positive-definite-P0, time-invariant, measurement-every-step. */
  const char* needs;

  const char* precision; /* "double", which NULL means too, or "single" */
} kfstab_filter_description;

/* What a step takes. p may be another one at every step. */
typedef struct kfstab_filter_input {
  int n, m, p, inputs;
  const double* A; /* n x n */
  const double* B; /* n x m */
  const double* C; /* p x n */
  const double* Q; /* m x m */
  const double* R; /* p x p */
  const double* D; /* n x inputs; NULL without known input */
  const double* u; /* inputs;     NULL without known input */
  const double* y; /* p; NULL: there is no measurement at this step, and C and R mean nothing */
} kfstab_filter_input;

/* What a step answers. The arrays are there, and are to be filled. */
typedef struct kfstab_filter_answer {
  double* x; /* n */
  double* P; /* n x n */
  double* S; /* n x n, P = S S': from a filter that holds a root, instead of P, so that it is judged by what it holds */
  double* K; /* n x p */
  double loglik;   /* log p(y_k | y_0 ... y_{k-1}) */
  int has_S;       /* S was filled, and P was not */
  int has_K;       /* K was filled */
  int has_loglik;  /* loglik was set */
  const char* why; /* of a step that was refused, in words; may be left NULL */
} kfstab_filter_answer;

KFSTAB_EXPORT int kfstab_filter_abi(void); /* { return KFSTAB_FILTER_ABI; } */

KFSTAB_EXPORT const kfstab_filter_description* kfstab_filter_describe(void);

/* A new filter, at the start of a problem: x is n, P n x n; m and p are those of the first step. NULL if it cannot take
 * the problem on; then *why may be set to say so. */
KFSTAB_EXPORT void* kfstab_filter_create(int n, int m, int p, const double* x, const double* P, const char** why);

/* 0 if the step was done; anything else: the filter says that it cannot, which is no wrong answer. */
KFSTAB_EXPORT int kfstab_filter_step(void* filter, const kfstab_filter_input* input, kfstab_filter_answer* answer);

KFSTAB_EXPORT void kfstab_filter_destroy(void* filter);

#ifdef __cplusplus
}
#endif

#endif
