/* Newton's method for equations with one condition: to a point of their curve,
 * to a fold or to a peak. */
#ifndef BD_SOLVER_NEWTON_H
#define BD_SOLVER_NEWTON_H

#include "solver/equations.h"

typedef struct {
    enum { BD_LINEAR, BD_STATIONARY } kind;
    /* BD_LINEAR: (n + 1), normal of the plane through the initial point, in scaled unknowns */
    const double *row;
    /* BD_STATIONARY: (n), a peak of |x|, x = re . u + i im . u; NULL: a fold of the curve */
    const double *re, *im;
    /* of BD_STATIONARY: estimate of the derivative of phi along the curve, < 0 at a peak */
    double curvature;
    /* tolerance of the distance to the stationary point, in scaled unknowns */
    double tolerance;
    double max_step; /* largest step along the curve */
} bd_condition;

typedef struct {
    double tolerance; /* tolerance of the largest scaled residual */
    int max_iterations;
    /* of BD_LINEAR only: 1 halves a step until the residual decreases, 2 until the next step with
     * the same factors is shorter */
    int line_search;
    /* of BD_LINEAR only: a full Newton step shorter than this is the last; the tangent then belongs
     * to the factors of that step. 0: never */
    double step_tolerance;
    double accepted_residual; /* largest residual after such a last step; 0: no limit */
    /* longest Newton step in scaled unknowns; a longer one returns BD_NOT_CONVERGED. 0: no limit */
    double max_newton_step;
} bd_solver_options;

typedef struct {
    int iterations;
    double residual; /* largest scaled residual at the returned point */
    /* lengths of the first and last Newton step, in scaled unknowns */
    double first_step, last_step;
    bd_factored factored; /* data of the last factorisation */
    /* of BD_STATIONARY: phi at the returned point, and its latest secant */
    double slope, curvature;
} bd_solver_report;

/* y (n + 1) is the guess on entry and the solution on return. On BD_OK, tangent (n + 1, unit length
 * in z = y/scale) is the direction of the curve. For BD_LINEAR its sign agrees with the row; NULL
 * omits it. For BD_STATIONARY it is an estimate on entry. BD_OK requires that equations and
 * condition are satisfied. The search for a stationary point stops early if the point is not near,
 * lies at a corner, or has the opposite sign of curvature. */
bd_status bd_solve(bd_equations *equations, const bd_condition *condition,
                   const bd_solver_options *options, const double *scale, double *y,
                   double *tangent, bd_solver_report *report);

/* Derivative of ln |x| along a direction (n + 1) in scaled unknowns;
 * without x, of the parameter. */
double bd_slope(const bd_condition *condition, const double *y, const double *tangent,
                const double *scale, size_t n);

/* Gradient row (n + 1) of phi in scaled unknowns at a point of the curve with unit tangent t, and
 * the multipliers nu (n) of a change of [J C]: phi changes by row . dz - nu . d[J C] (scale t).
 * [J C] is differenced over +-step along t. */
bd_status bd_gradient(bd_equations *equations, const bd_condition *condition, const double *scale,
                      const double *y, const double *tangent, double step, double *row, double *nu);

#endif
