/*
 * A textbook Kalman filter as a shared library that kfstab can load (kfstab_filter.h). C99, nothing but libc.
 *
 *     cc -O2 -shared -fPIC -I ../properties/plugin -o textbook.so textbook.c
 *     kfstab check --plugin ./textbook.so
 *
 * Copy it, and put your own filter in the place of `update` and `predict`. Matrices are row by row.
 */
#include <kfstab_filter.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
  int n;
  double *x, *P;
} filter;

/* ---- A little linear algebra ---- */

static double* zeros(int rows, int cols) { return calloc((size_t)rows * (size_t)cols + 1, sizeof(double)); }

/* Z = X Y, (rows x inner) (inner x cols). */
static void multiply(double* Z, const double* X, const double* Y, int rows, int inner, int cols) {
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < cols; ++j) {
      double sum = 0;
      for (int k = 0; k < inner; ++k) sum += X[i * inner + k] * Y[k * cols + j];
      Z[i * cols + j] = sum;
    }
}

/* Z = X Y', (rows x inner) (cols x inner)'. */
static void multiply_transposed(double* Z, const double* X, const double* Y, int rows, int inner, int cols) {
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < cols; ++j) {
      double sum = 0;
      for (int k = 0; k < inner; ++k) sum += X[i * inner + k] * Y[j * inner + k];
      Z[i * cols + j] = sum;
    }
}

static void symmetrise(double* P, int n) {
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < i; ++j) P[i * n + j] = P[j * n + i] = (P[i * n + j] + P[j * n + i]) / 2;
}

/* X := M^{-1} X by elimination with pivots; X is size x cols, and M is lost. 0 if M is singular. */
static int solve(double* M, double* X, int size, int cols) {
  for (int k = 0; k < size; ++k) {
    int pivot = k;
    for (int i = k + 1; i < size; ++i)
      if (fabs(M[i * size + k]) > fabs(M[pivot * size + k])) pivot = i;
    if (M[pivot * size + k] == 0) return 0;
    for (int j = 0; j < size; ++j) {
      const double t = M[k * size + j];
      M[k * size + j] = M[pivot * size + j];
      M[pivot * size + j] = t;
    }
    for (int j = 0; j < cols; ++j) {
      const double t = X[k * cols + j];
      X[k * cols + j] = X[pivot * cols + j];
      X[pivot * cols + j] = t;
    }
    for (int i = k + 1; i < size; ++i) {
      const double factor = M[i * size + k] / M[k * size + k];
      for (int j = k; j < size; ++j) M[i * size + j] -= factor * M[k * size + j];
      for (int j = 0; j < cols; ++j) X[i * cols + j] -= factor * X[k * cols + j];
    }
  }
  for (int k = size - 1; k >= 0; --k)
    for (int j = 0; j < cols; ++j) {
      for (int i = k + 1; i < size; ++i) X[k * cols + j] -= M[k * size + i] * X[i * cols + j];
      X[k * cols + j] /= M[k * size + k];
    }
  return 1;
}

/* ---- The filter ---- */

/* From x_{k|k-1}, P_{k|k-1} to x_{k|k}, P_{k|k}; Kf = P C' Re^{-1}, n x p. 0 if Re = R + C P C' is singular. */
static int update(filter* f, int p, const double* C, const double* R, const double* y, double* Kf) {
  const int n = f->n;
  double *CP = zeros(p, n), *Re = zeros(p, p), *KfT = zeros(p, n), *KCP = zeros(n, n), *e = zeros(p, 1);
  multiply(CP, C, f->P, p, n, n);
  multiply_transposed(Re, CP, C, p, n, p);
  for (int i = 0; i < p * p; ++i) Re[i] += R[i];
  memcpy(KfT, CP, (size_t)(p * n) * sizeof(double));
  const int regular = solve(Re, KfT, p, n);
  if (regular) {
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < p; ++j) Kf[i * p + j] = KfT[j * n + i];
    multiply(e, C, f->x, p, n, 1);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < p; ++j) f->x[i] += Kf[i * p + j] * (y[j] - e[j]);
    multiply(KCP, Kf, CP, n, p, n);
    for (int i = 0; i < n * n; ++i) f->P[i] -= KCP[i];
    symmetrise(f->P, n);
  }
  free(CP), free(Re), free(KfT), free(KCP), free(e);
  return regular;
}

/* From x_{k|k}, P_{k|k} to x_{k+1|k}, P_{k+1|k}. */
static void predict(filter* f, const kfstab_filter_input* in) {
  const int n = f->n, m = in->m;
  double *x = zeros(n, 1), *AP = zeros(n, n), *BQ = zeros(n, m), *noise = zeros(n, n);
  multiply(x, in->A, f->x, n, n, 1);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < in->inputs; ++j) x[i] += in->D[i * in->inputs + j] * in->u[j];
  memcpy(f->x, x, (size_t)n * sizeof(double));
  multiply(AP, in->A, f->P, n, n, n);
  multiply_transposed(f->P, AP, in->A, n, n, n);
  multiply(BQ, in->B, in->Q, n, m, m);
  multiply_transposed(noise, BQ, in->B, n, m, n);
  for (int i = 0; i < n * n; ++i) f->P[i] += noise[i];
  symmetrise(f->P, n);
  free(x), free(AP), free(BQ), free(noise);
}

/* ---- What kfstab calls ---- */

int kfstab_filter_abi(void) { return KFSTAB_FILTER_ABI; }

const kfstab_filter_description* kfstab_filter_describe(void) {
  static const kfstab_filter_description description = {"textbook (C)", "update-predict", "filter", NULL, NULL};
  return &description;
}

void* kfstab_filter_create(int n, int m, int p, const double* x, const double* P, const char** why) {
  (void)m, (void)p, (void)why; /* it takes on any problem */
  filter* f = malloc(sizeof *f);
  f->n = n;
  f->x = zeros(n, 1);
  f->P = zeros(n, n);
  memcpy(f->x, x, (size_t)n * sizeof(double));
  memcpy(f->P, P, (size_t)(n * n) * sizeof(double));
  return f;
}

int kfstab_filter_step(void* self, const kfstab_filter_input* in, kfstab_filter_answer* out) {
  filter* f = self;
  if (in->y) {
    out->has_K = 1;
    if (!update(f, in->p, in->C, in->R, in->y, out->K)) {
      out->why = "the innovations covariance is singular";
      return 1;
    }
  }
  predict(f, in);
  memcpy(out->x, f->x, (size_t)f->n * sizeof(double));
  memcpy(out->P, f->P, (size_t)(f->n * f->n) * sizeof(double));
  return 0;
}

void kfstab_filter_destroy(void* self) {
  filter* f = self;
  free(f->x), free(f->P), free(f);
}
