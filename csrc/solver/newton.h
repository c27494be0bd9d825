/* Newton's method on equations and one condition: to a point of their curve, to a fold or to a peak on it. */
#ifndef BD_SOLVER_NEWTON_H
#define BD_SOLVER_NEWTON_H

#include "solver/equations.h"

typedef struct {
    enum { BD_LINEAR, BD_STATIONARY } kind;
    const double *row;     /* BD_LINEAR: (n + 1), the plane through the point on entry that is normal to it, in scaled */
                           /* unknowns */
    const double *re, *im; /* BD_STATIONARY: (n), a peak of |x|, x = re . u + i im . u; NULL: a fold of the curve */
    double curvature;      /* of BD_STATIONARY: an estimate of the derivative of phi along the curve, < 0 at a peak */
    double tolerance;      /* on the distance to the place, in scaled unknowns */
    double max_step;       /* along the curve at a time */
} bd_condition;

typedef struct {
    double tolerance; /* on the largest scaled residual */
    int max_iterations;
    int line_search; /* of BD_LINEAR alone: 1 halves a step that does not reduce the residual, 2 one that does not make the */
                     /* next step with the same factors shorter */
    double
        step_tolerance; /* of BD_LINEAR alone: a whole Newton step shorter than this counts as the last, 0: none does; the */
                        /* tangent is then that of the factors that gave the step */
    double accepted_residual; /* if it leads to a residual below this; 0: to any */
    double
        max_newton_step; /* a Newton step longer than this in scaled unknowns is not taken: BD_NOT_CONVERGED; 0: any is */
} bd_solver_options;

typedef struct {
    int iterations;
    double residual;              /* largest scaled residual at the returned point */
    double first_step, last_step; /* lengths of the first and last Newton step, in scaled unknowns */
    bd_factored factored;         /* of the last factorisation */
    double slope, curvature;      /* of BD_STATIONARY: phi at the returned point, and its latest secant */
} bd_solver_report;

/* y (n + 1) is the guess on entry and the point found on return.  On BD_OK tangent (n + 1, unit length in z = y/scale) is
 * the direction of the curve; one that is linear has it along the row, and NULL where it is not asked for; one that is
 * stationary takes an estimate on entry.  BD_OK only if equations and condition are met; a stationary point is given up
 * early where it is not near, lies at a corner, or is of the other sense than the curvature on entry. */
bd_status bd_solve(bd_equations *equations, const bd_condition *condition, const bd_solver_options *options,
                   const double *scale, double *y, double *tangent, bd_solver_report *report);

/* Derivative of ln |x| along a direction (n + 1) in scaled unknowns, or without x that of the parameter. */
double bd_slope(const bd_condition *condition, const double *y, const double *tangent, const double *scale, size_t n);

/* Gradient row (n + 1) of phi in scaled unknowns at a point of the curve with unit tangent t, and the multipliers nu (n) of
 * the equations with which a change of [J C] counts: phi changes by row . dz - nu . d[J C] (scale t).  [J C] is differenced
 * over `step` to both sides along t. */
bd_status bd_gradient(bd_equations *equations, const bd_condition *condition, const double *scale, const double *y,
                      const double *tangent, double step, double *row, double *nu);

#endif
