/* Table of the LAPACK functions in use (Fortran calling convention, int integers).
 *
 * The extension module fills the table from SciPy's capsules. A build with -Dlapack=system links
 * the functions instead. */
#ifndef BD_UTIL_LAPACK_H
#define BD_UTIL_LAPACK_H

typedef struct {
    void (*dgetrf)(int *m, int *n, double *a, int *lda, int *ipiv, int *info);
    void (*dgetrs)(char *trans, int *n, int *nrhs, double *a, int *lda, int *ipiv, double *b,
                   int *ldb, int *info);
    void (*dgecon)(char *norm, int *n, double *a, int *lda, double *anorm, double *rcond,
                   double *work, int *iwork, int *info);
    void (*dgelsy)(int *m, int *n, int *nrhs, double *a, int *lda, double *b, int *ldb, int *jpvt,
                   double *rcond, int *rank, double *work, int *lwork, int *info);
} bd_lapack;

#ifdef BD_SYSTEM_LAPACK
void dgetrf_(int *, int *, double *, int *, int *, int *);
void dgetrs_(char *, int *, int *, double *, int *, int *, double *, int *, int *);
void dgecon_(char *, int *, double *, int *, double *, double *, double *, int *, int *);
void dgelsy_(int *, int *, int *, double *, int *, double *, int *, int *, double *, int *,
             double *, int *, int *);

static inline bd_lapack bd_lapack_system(void) {
    bd_lapack table = {dgetrf_, dgetrs_, dgecon_, dgelsy_};
    return table;
}
#endif

#endif
