#ifndef KFSTAB_FILTERS_SLICOT_SLICOT_H
#define KFSTAB_FILTERS_SLICOT_SLICOT_H

#include <stddef.h>

/* The routines of SLICOT's Kalman filters under their own names and argument lists, for Fortran and C. The arguments
   are those of SLICOT's documentation; docs/slicot.md says where a result may differ. INTEGER is int. A Fortran compiler
   adds the lengths of the letters at the end; nothing reads them. */
#ifdef __cplusplus
extern "C" {
#endif

/* Square-root covariance filter, one combined step. */
void fb01qd_(const char* jobk, const char* multbq, const int* n, const int* m, const int* p, double* s, const int* lds,
             const double* a, const int* lda, const double* b, const int* ldb, const double* q, const int* ldq,
             const double* c, const int* ldc, double* r, const int* ldr, double* k, const int* ldk, const double* tol,
             int* iwork, double* dwork, const int* ldwork, int* info);

/* The same for (A, C) in lower observer-Hessenberg form. */
void fb01rd_(const char* jobk, const char* multbq, const int* n, const int* m, const int* p, double* s, const int* lds,
             const double* a, const int* lda, const double* b, const int* ldb, const double* q, const int* ldq,
             const double* c, const int* ldc, double* r, const int* ldr, double* k, const int* ldk, const double* tol,
             int* iwork, double* dwork, const int* ldwork, int* info);

/* Square-root information filter, one combined step. */
void fb01sd_(const char* jobx, const char* multab, const char* multrc, const int* n, const int* m, const int* p,
             double* sinv, const int* ldsinv, const double* ainv, const int* ldainv, const double* b, const int* ldb,
             const double* rinv, const int* ldrinv, const double* c, const int* ldc, double* qinv, const int* ldqinv,
             double* x, const double* rinvy, const double* z, double* e, const double* tol, int* iwork, double* dwork,
             const int* ldwork, int* info);

/* The same for (A^{-1}, A^{-1} B) in upper controller-Hessenberg form. */
void fb01td_(const char* jobx, const char* multrc, const int* n, const int* m, const int* p, double* sinv,
             const int* ldsinv, const double* ainv, const int* ldainv, const double* ainvb, const int* ldainb,
             const double* rinv, const int* ldrinv, const double* c, const int* ldc, double* qinv, const int* ldqinv,
             double* x, const double* rinvy, const double* z, double* e, const double* tol, int* iwork, double* dwork,
             const int* ldwork, int* info);

/* Conventional filter, one combined step. */
void fb01vd_(const int* n, const int* m, const int* l, double* p, const int* ldp, const double* a, const int* lda,
             const double* b, const int* ldb, const double* c, const int* ldc, const double* q, const int* ldq,
             double* r, const int* ldr, double* k, const int* ldk, const double* tol, int* iwork, double* dwork,
             const int* ldwork, int* info);

/* LQ and QR factorisations of structured matrices. */
void mb04ld_(const char* uplo, const int* n, const int* m, const int* p, double* l, const int* ldl, double* a,
             const int* lda, double* b, const int* ldb, double* c, const int* ldc, double* tau, double* dwork);
void mb04kd_(const char* uplo, const int* n, const int* m, const int* p, double* r, const int* ldr, double* a,
             const int* lda, double* b, const int* ldb, double* c, const int* ldc, double* tau, double* dwork);

/* Controller-Hessenberg form of (B, A), observer-Hessenberg form of (A, C). */
void tb01md_(const char* jobu, const char* uplo, const int* n, const int* m, double* a, const int* lda, double* b,
             const int* ldb, double* u, const int* ldu, double* dwork, int* info);
void tb01nd_(const char* jobu, const char* uplo, const int* n, const int* p, double* a, const int* lda, double* c,
             const int* ldc, double* u, const int* ldu, double* dwork, int* info);

/* Called, where the program or LAPACK defines it, with the routine's name and the number of the argument that it refuses.
   Not defined here. */
void xerbla_(const char* routine, const int* argument, size_t length);

#ifdef __cplusplus
}
#endif

#endif
