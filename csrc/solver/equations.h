/* Equations R(y) = 0 in n unknowns and k free parameters, y = (u, lambda), as a table of functions: whoever solves them
 * knows neither where they come from nor how their linear equations are solved.
 *
 * With J = R_u and C = R_lambda, everything is asked of the bordered matrix
 *
 *     B = [J C] diag(scale)
 *         [  row          ]
 *
 * in scaled unknowns z = y/scale, which is regular at folds of a curve where J is not.  The order is evaluate, factor,
 * solve: the functions bd_* below refuse any other with BD_BAD_STATE, and go back a stage where a step fails, so that no
 * half of an old factorisation is used.
 *
 * There are dense ones (bd_dense.h) and those of a whole wheel (bd_wheel.h), all with one parameter. */
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
    double condition; /* reciprocal condition of the matrix with rows of unit size, as far as it was asked for */
    int rank;         /* n + k, or what a solution by least norm found */
    int orientation;  /* sign of det B, 0 where it is not known */
} bd_factored;

typedef struct {
    bd_status (*evaluate)(bd_equations *, const double *y, int derivative); /* r; if asked, what factor needs, and C */
    bd_status (*factor)(bd_equations *, const bd_border *);                 /* B at the point evaluated last; factored */
    bd_status (*solve)(bd_equations *, double tolerance, double *b);        /* B x = b in place; an iterative one to the */
                                                                            /* tolerance */
    bd_status (*solve_transposed)(bd_equations *, double *b);               /* B^T x = b; NULL where there is none */
    bd_status (*product)(bd_equations *, int transposed, const double *x, double *out); /* J x or J^T x; NULL where J is */
                                                                                        /* formed */
    void (*destroy)(bd_equations *); /* with the memory of the object itself */
} bd_equations_type;

/* First member of each implementation, which allocates all of it when it is created. */
struct bd_equations {
    const bd_equations_type *type;
    int n, k;
    double *row_scale; /* (n) residual -> relative to excitation or static load */
    double *r, *C;     /* (n), (n) for each parameter */
    double *J;         /* (n, n) row-major, NULL where it is not formed */
    double *scratch;   /* (4, n + k) of bd_solver and of its callers */
    bd_factored factored;
    enum { BD_EMPTY, BD_EVALUATED, BD_DERIVED, BD_FACTORED } stage;
    bd_cost *cost; /* shared by equations that wrap others */
};

bd_status bd_evaluate(bd_equations *equations, const double *y, int derivative);
bd_status bd_trial_residual(bd_equations *equations, const double *y); /* r alone; factors stay those of the point before */
bd_status bd_product(bd_equations *equations, int transposed, const double *x, double *out); /* (n) */
bd_status bd_factor(bd_equations *equations, const bd_border *border);
bd_status bd_solve_linear(bd_equations *equations, double tolerance, double *b);
bd_status bd_solve_transposed(bd_equations *equations, double *b);
void bd_equations_destroy(bd_equations *equations); /* NULL does no harm */

#endif
