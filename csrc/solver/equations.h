/* Equations R(y) = 0 in n unknowns and k free parameters, y = (u, lambda), as a table of functions.
 * A solver needs no knowledge of their origin or of their linear solver.
 *
 * With J = R_u and C = R_lambda, all operations use the bordered matrix
 *
 *     B = [J C] diag(scale)
 *         [  row          ]
 *
 * in scaled unknowns z = y/scale. B is regular at folds of a curve, although J is singular there.
 * The order of calls is evaluate, factor, solve. The functions bd_* below refuse any other order
 * with BD_BAD_STATE. After a failure they go back one stage, so that an incomplete factorisation is
 * never used.
 *
 * There are dense equations (balance/sector.h, balance/nonlinear_mode.h) and equations of a bladed
 * disk (bladed_disk/wheel_equations.h), all with one parameter. */
#ifndef BD_SOLVER_EQUATIONS_H
#define BD_SOLVER_EQUATIONS_H

#include "util/conventions.h"
#include "util/cost.h"

typedef struct bd_equations bd_equations;

typedef struct {
    const double *row;   /* (k, n + k), in scaled unknowns */
    const double *scale; /* (n + k) */
} bd_border;

typedef struct {
    /* estimate of the reciprocal condition of the matrix with rows of unit size */
    double condition;
    int rank;        /* n + k, or the rank in a least-norm solution */
    int orientation; /* sign of det B, 0 if unknown */
} bd_factored;

typedef struct {
    /* r; with derivative, C and the data for factor */
    bd_status (*evaluate)(bd_equations *, const double *y, int derivative);
    bd_status (*factor)(bd_equations *, const bd_border *); /* factors of B at the latest point */
    /* B x = b in place; iterative solvers stop at the tolerance */
    bd_status (*solve)(bd_equations *, double tolerance, double *b);
    bd_status (*solve_transposed)(bd_equations *, double *b); /* B^T x = b; NULL if not available */
    /* J x or J^T x; NULL if J is stored */
    bd_status (*product)(bd_equations *, int transposed, const double *x, double *out);
    void (*destroy)(bd_equations *); /* frees the object itself as well */
} bd_equations_type;

/* First member of each implementation, which allocates all of it on creation. */
struct bd_equations {
    const bd_equations_type *type;
    int n, k;
    /* (n) factor from residual to a value relative to excitation or static load */
    double *row_scale;
    double *r, *C; /* (n), (n) for each parameter */
    double *J;     /* (n, n) row-major, NULL if not stored */
    /* whether the data of the factors survive an evaluation with derivatives, so that a trial
     * computes those of its point as well */
    int derives_trials;
    double *scratch; /* (4, n + k) work of the solver and its callers */
    bd_factored factored;
    enum { BD_EMPTY, BD_EVALUATED, BD_DERIVED, BD_FACTORED } stage;
    bd_cost *cost; /* shared with equations that wrap others */
};

bd_status bd_evaluate(bd_equations *equations, const double *y, int derivative);
/* r, and with derives_trials C and the data for factor; the factors of the previous point
 * remain valid */
bd_status bd_trial(bd_equations *equations, const double *y);
/* (n) */
bd_status bd_product(bd_equations *equations, int transposed, const double *x, double *out);
bd_status bd_factor(bd_equations *equations, const bd_border *border);
bd_status bd_solve_linear(bd_equations *equations, double tolerance, double *b);
bd_status bd_solve_transposed(bd_equations *equations, double *b);
void bd_equations_destroy(bd_equations *equations); /* NULL is allowed */

#endif
