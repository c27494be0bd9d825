/* Equations with a dense bordered matrix, factorised as a whole. */
#ifndef BD_SOLVER_DENSE_H
#define BD_SOLVER_DENSE_H

#include "solver/equations.h"
#include "util/lapack.h"

/* Common part of dense equations with one parameter. An implementation begins with it, provides its
 * own evaluate, and uses the other functions from here. */
typedef struct {
    bd_equations base;
    bd_lapack lapack;
    /* (n + 1, n + 1) row-major bordered matrix with rows of unit size, and its factors */
    double *A, *LU;
    double *row; /* (n + 1) row equilibration */
    double *work;
    int *pivot, *iwork;
    int lwork;
    double *memory;
} bd_dense;

/* row_scale (n) is copied; NULL: ones. The caller owns cost. */
bd_status bd_dense_create(bd_dense *dense, const bd_equations_type *type, int n,
                          const double *row_scale, const bd_lapack *lapack, bd_cost *cost);
void bd_dense_destroy(bd_dense *dense); /* frees the arrays, not the object */
bd_status bd_dense_factor(bd_equations *equations, const bd_border *border);
bd_status bd_dense_solve(bd_equations *equations, double tolerance, double *b);
bd_status bd_dense_solve_transposed(bd_equations *equations, double *b);

#endif
