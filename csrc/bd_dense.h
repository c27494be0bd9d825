/* Dense equations: the bordered matrix is factorised as a whole.  The harmonic balance of a sector, and the same eased. */
#ifndef BD_DENSE_H
#define BD_DENSE_H

#include "bd_equations.h"
#include "bd_lapack.h"

/* What dense equations with one parameter have in common: an implementation begins with it, sets its own evaluate, and
 * takes the other functions from here. */
typedef struct {
    bd_equations base;
    bd_lapack lapack;
    double *A, *LU; /* (n + 1, n + 1) row-major bordered system with rows of unit size, and its factors */
    double *row;    /* (n + 1) row equilibration */
    double *work;
    int *pivot, *iwork;
    int lwork;
    double *memory;
} bd_dense;

/* row_scale (n) is copied; NULL: ones.  cost stays with the caller. */
bd_status bd_dense_create(bd_dense *dense, const bd_equations_type *type, int n, const double *row_scale,
                          const bd_lapack *lapack, bd_cost *cost);
void bd_dense_destroy(bd_dense *dense); /* what it has allocated, not the object */
bd_status bd_dense_factor(bd_equations *equations, const bd_border *border);
bd_status bd_dense_solve(bd_equations *equations, double tolerance, double *b);
bd_status bd_dense_solve_transposed(bd_equations *equations, double *b);

/* The harmonic balance of one sector, lambda = omega. */
typedef struct {
    bd_dense dense;
    bd_hbm hbm;
} bd_sector;

bd_status bd_sector_create(bd_sector **sector, const bd_hbm_input *input, const double *row_scale, const bd_lapack *lapack);

/* The same at fixed omega with a factor s, lambda = s, on the part `ramp` (n) of the excitation.  With support (n, n)
 * row-major, not NULL, s also fades out this linear force beside the excitation.  Both are copied; the sector is not, and
 * outlives this. */
bd_status bd_eased_create(bd_equations **eased, bd_sector *sector, double omega, const double *ramp, const double *support);

#endif
