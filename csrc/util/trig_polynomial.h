/* Trigonometric polynomials: values, derivatives, roots in a period. */
#ifndef BD_UTIL_TRIG_POLYNOMIAL_H
#define BD_UTIL_TRIG_POLYNOMIAL_H

#include "util/conventions.h"

/* Values of the basis on a uniform grid over one period; constant after creation. */
typedef struct {
    int n_harm;
    int n_time;
    /* (n_coef, n_time) row-major: one row for each basis function, for vectorisation */
    double *basis;
} bd_trig_grid;

bd_status bd_trig_grid_create(bd_trig_grid *grid, int n_harm, int n_time);
void bd_trig_grid_destroy(bd_trig_grid *grid);

/* Values of x on the grid. */
void bd_trig_grid_values(const bd_trig_grid *grid, const double *x, double *value);

/* cos(n theta) and sin(n theta), n = 0..n_max, interleaved as [1, 1, cos, sin, cos 2, sin 2, ...].
 * Entry 1 is one instead of sin 0, so that power + 1 is the basis [1, cos, sin, ...]. */
void bd_trig_powers(int n_max, double theta, double *power);

/* The same from z = exp(i theta). */
void bd_trig_powers_of(int n_max, const double *z, double *power);

double bd_trig_value(int n_harm, const double *x, double theta);
void bd_trig_derivative(int n_harm, const double *x, double *dx);

/* Sum of the amplitudes of the harmonics, an upper bound of |x - x0|. */
double bd_trig_amplitude(int n_harm, const double *x);

/* Roots of f in [0, 2 pi), ascending. There are at most 2 n_harm of them, and their number is even:
 * a point in which f only touches zero yields no root or the same root twice.
 *
 * One harmonic has a closed form. Otherwise, sign changes of the samples `value` bracket the roots,
 * and the signs of the sampled derivative `slope` reveal a pair of roots inside one cell. value and
 * slope are not read if n_harm = 1. */
int bd_trig_roots(const bd_trig_grid *grid, const double *f, const double *value,
                  const double *slope, double *root);

/* The same, with z (2 n_harm, 2) the cosine and sine of each root. */
int bd_trig_roots_with_powers(const bd_trig_grid *grid, const double *f, const double *value,
                              const double *slope, double *root, double *z);

/* The root of f between a and b, if f(a) and f(b) differ in sign or one of them is zero. If
 * rounding makes the signs equal, the end with the smaller |f|. */
double bd_trig_bracketed_root(int n_harm, const double *f, double a, double b);

#endif
