/* Bordered harmonic balance equations, solved through the motion at few contact points.
 *
 * If the modes move few components of contact points, all modal coordinates follow from the motion
 * x = U q of these, harmonic by harmonic. Only x and a few coordinates remain. The solutions agree
 * with the dense factors up to rounding. */
#ifndef BD_BALANCE_CONDENSATION_H
#define BD_BALANCE_CONDENSATION_H

#include "balance/harmonic_balance.h"
#include "solver/dense.h"

/* Equations R(y) = 0 with a Jacobian [J C] of the form
 *
 *     [ R J_hbm S   columns ]      R, S: 1 for the mean, 1/a and a for the vibration
 *     [ rows        0       ]
 *
 * where columns and rows belong to extra unknowns and equations (none for a sector). */
typedef struct {
    bd_dense *dense; /* the equations, and their dense factors if condensation fails */
    bd_jacobian_parts parts;
    const bd_hbm *hbm;
    int n_extra, n_border; /* number of extra unknowns; with the parameter */
    double amplitude;      /* a at the latest derivative; 1 for a sector */
    double *extra_column;  /* (n_extra, n) in the rows of the equations */
    double *extra_row;     /* (n_extra, n) */
    int uses_dense;        /* whether the latest factors are the dense ones */

    int n_motion;                     /* entries of x: components times coefficients */
    int n_kept, most_kept;            /* number of kept coordinates, and its limit */
    int n_reduced;                    /* x, kept coordinates, border */
    int *kept;                        /* (most_kept) kept unknowns */
    unsigned char *is_kept;           /* (n) */
    double *column, *row;             /* (n_border, n) border in the unknowns of the hbm */
    double *corner;                   /* (n_border, n_border) */
    double *border_row;               /* (n_all) row of the border, for the dense factors */
    double *border_scale;             /* (n_all) */
    double *A, *LU;                   /* reduced matrix, scaled, and its factors */
    double *column_scale, *row_scale; /* of the reduced matrix */
    double *reduced;                  /* right-hand side and solution of the reduced equations */
    double *force;                    /* (n_motion) */
    double *q, *given;                /* (n) work of an elimination, (n_all) its right-hand side */
    double *residual, *right, *product; /* (n_all) work of a refinement */
    double *dense_J;                    /* (n_equations, n_equations) */
    double *memory;
    int *pivot;
    double *condition_work;
    int *condition_iwork;
} bd_condensation;

typedef enum { BD_BY_SIZE, BD_FULL, BD_CONDENSED } bd_elimination;

/* Whether the work falls by condensation. */
int bd_condensation_pays(const bd_hbm *hbm);

/* dense are created equations whose J is then no longer stored; hbm must outlive the condensation.
 * n_extra is the number of their unknowns beyond those of hbm. */
bd_status bd_condensation_create(bd_condensation **condensation, bd_dense *dense, const bd_hbm *hbm,
                                 int n_extra);
void bd_condensation_destroy(bd_condensation *condensation); /* NULL is allowed */

/* The functions of bd_equations_type. */
bd_status bd_condensation_factor(bd_condensation *condensation, const bd_border *border);
bd_status bd_condensation_solve(bd_condensation *condensation, int transposed, double *b);
void bd_condensation_product(bd_condensation *condensation, int transposed, const double *x,
                             double *out);

#endif
