/* Trigonometric polynomials.
 *
 * The polynomial x(theta) = x0 + sum_l c_l cos(l theta) + s_l sin(l theta) has the derivative
 * coefficients c'_l = l s_l, s'_l = -l c_l. Values follow from the powers of z = exp(i theta): one
 * sine, one cosine and a complex recurrence yield all harmonics.
 *
 * Roots. A polynomial of degree H has at most 2 H roots in a period. For H = 1,
 *     x0 + A cos(theta - phi) = 0  <=>  theta = phi +- acos(-x0/A).
 * For H > 1 the period is divided into cells. A sign change over a cell brackets a root. A cell
 * without a sign change may hide a pair of roots if the polynomial has an extremum inside that
 * crosses zero. Such a cell has a slope towards zero at its left end and away from zero at its
 * right end. The extremum is the bracketed root of the derivative; the sign of the polynomial there
 * decides.
 *
 * A sample that is a root except for rounding has no reliable sign. It counts as a root, and the
 * slope determines the signs in the adjacent cells.
 *
 * Newton's method refines a bracketed root; bisection confines it to a shrinking bracket. */
#include "util/trig_polynomial.h"

#include <math.h>
#include <stdlib.h>

bd_status bd_trig_grid_create(bd_trig_grid *grid, int n_harm, int n_time) {
    const int n_coef = bd_n_coef(n_harm);
    grid->n_harm = n_harm;
    grid->n_time = n_time;
    grid->basis = malloc(sizeof(double) * (size_t)n_coef * (size_t)n_time);
    if (!grid->basis) return BD_NO_MEMORY;
    /* basis (n_coef, n_time): 1, cos theta, sin theta, cos 2 theta, ... at the nodes */
    for (int k = 0; k < n_time; ++k) {
        for (int i = 0; i < n_coef; ++i) {
            const int harmonic = (i + 1) / 2;
            /* an integer reduction of the argument makes the grid exact for every harmonic */
            const long reduced = (long)harmonic * k % n_time;
            const double angle = BD_TWO_PI * (double)reduced / n_time;
            double *entry = grid->basis + (size_t)i * (size_t)n_time + (size_t)k;
            if (i == 0)
                *entry = 1.0;
            else
                *entry = i % 2 ? cos(angle) : sin(angle);
        }
    }
    return BD_OK;
}

void bd_trig_grid_destroy(bd_trig_grid *grid) {
    if (!grid) return;
    free(grid->basis);
    grid->basis = NULL;
}

void bd_trig_grid_values(const bd_trig_grid *grid, const double *x, double *restrict value) {
    const int n_time = grid->n_time, n_coef = bd_n_coef(grid->n_harm);
    for (int k = 0; k < n_time; ++k) value[k] = x[0];
    for (int i = 1; i < n_coef; ++i) {
        const double xi = x[i];
        const double *restrict b = grid->basis + (size_t)i * (size_t)n_time;
        if (xi == 0.0) continue;
        for (int k = 0; k < n_time; ++k) value[k] += xi * b[k];
    }
}

void bd_trig_powers(int n_max, double theta, double *power) {
    const double z[2] = {cos(theta), sin(theta)};
    bd_trig_powers_of(n_max, z, power);
}

void bd_trig_powers_of(int n_max, const double *z, double *power) {
    const double c = z[0], s = z[1];
    double re = 1.0, im = 0.0; /* z^n */
    /* a second 1, so that both parts of z^n are at 2n and 2n + 1 */
    power[0] = 1.0;
    power[1] = 1.0;
    for (int n = 1; n <= n_max; ++n) {
        const double re_next = re * c - im * s;
        im = re * s + im * c;
        re = re_next;
        power[2 * n] = re;
        power[2 * n + 1] = im;
    }
}

/* Return the value of the polynomial x at the angle theta with exp(i theta) = z; set its
 * derivative by theta. */
static double value_and_slope_at(int n_harm, const double *x, const double *z, double *slope) {
    const double c = z[0], s = z[1];
    double re = c, im = s; /* cos and sin(l theta) */
    double value = x[0], d = 0.0;
    for (int l = 1; l <= n_harm; ++l) {
        const double cosine = x[2 * l - 1], sine = x[2 * l]; /* coefficients of harmonic l */
        value += cosine * re + sine * im;
        d += l * (sine * re - cosine * im);
        const double re_next = re * c - im * s;
        im = re * s + im * c;
        re = re_next;
    }
    *slope = d;
    return value;
}

static double value_and_slope(int n_harm, const double *x, double theta, double *slope) {
    const double z[2] = {cos(theta), sin(theta)};
    return value_and_slope_at(n_harm, x, z, slope);
}

double bd_trig_value(int n_harm, const double *x, double theta) {
    double slope;
    return value_and_slope(n_harm, x, theta, &slope);
}

void bd_trig_derivative(int n_harm, const double *x, double *dx) {
    dx[0] = 0.0;
    for (int l = 1; l <= n_harm; ++l) {
        dx[2 * l - 1] = l * x[2 * l];
        dx[2 * l] = -l * x[2 * l - 1];
    }
}

double bd_trig_amplitude(int n_harm, const double *x) {
    double sum = 0.0;
    for (int l = 1; l <= n_harm; ++l) {
        const double cosine = x[2 * l - 1], sine = x[2 * l];
        sum += sqrt(cosine * cosine + sine * sine);
    }
    return sum;
}

/* Root of the trigonometric polynomial f (n_coef) between a and b, at which its signs differ:
 * Newton's method inside the bracket, which shrinks with each value. A step that leaves the bracket
 * is replaced by bisection. */
double bd_trig_bracketed_root(int n_harm, const double *f, double a, double b) {
    double slope;
    double fa = value_and_slope(n_harm, f, a, &slope);
    const double fb = value_and_slope(n_harm, f, b, &slope);
    if (fa == 0.0) return a;
    if (fb == 0.0) return b;
    /* one end is the root except for rounding */
    if ((fa < 0.0) == (fb < 0.0)) return fabs(fa) <= fabs(fb) ? a : b;
    /* the secant is a good start on a small cell */
    double x = a + (b - a) * (fa / (fa - fb));
    if (!(x > a && x < b)) x = 0.5 * (a + b);
    for (int i = 0; i < 100; ++i) {
        const double fx = value_and_slope(n_harm, f, x, &slope);
        if (fx == 0.0) return x;
        if ((fx < 0.0) == (fa < 0.0)) {
            a = x;
            fa = fx;
        } else {
            b = x;
        }
        double next = x - fx / slope;
        /* A step below rounding ends the search: next may then be an end of the bracket, which must
         * not cause a bisection. */
        if (fabs(next - x) <= 2e-16 * (1.0 + fabs(x))) return x;
        if (!(next > a && next < b)) next = 0.5 * (a + b);
        const double step = fabs(next - x);
        x = next;
        if (step <= 1e-15 * (1.0 + fabs(x)) || b - a <= 2e-16 * (1.0 + fabs(x))) break;
    }
    return x;
}

/* ---- roots over a period ---- */

/* z = exp(i (theta_k + delta)) for a grid node and a small delta. */
static void rotate(const bd_trig_grid *grid, int k, double delta, double *z) {
    /* rows of the basis after that of the mean */
    const double *cosines = grid->basis + (size_t)grid->n_time;
    const double *sines = cosines + (size_t)grid->n_time;
    const double c = cosines[k], s = sines[k];
    const double d = delta * delta;
    double dc, ds; /* cosine and sine of delta */
    /* For |delta| < 0.2 by their Taylor series, exact to rounding and faster than the functions. In
     * the nested form a term is the previous term times -d/(n (n + 1)): n = 1, 3, 5 ... for the
     * cosine, n = 2, 4, 6 ... for the sine. */
    if (d < 0.04) {
        dc = 1.0 -
             d / 2.0 *
                 (1.0 -
                  d / 12.0 *
                      (1.0 - d / 30.0 * (1.0 - d / 56.0 * (1.0 - d / 90.0 * (1.0 - d / 132.0)))));
        ds = delta *
             (1.0 -
              d / 6.0 * (1.0 - d / 20.0 * (1.0 - d / 42.0 * (1.0 - d / 72.0 * (1.0 - d / 110.0)))));
    } else {
        dc = cos(delta);
        ds = sin(delta);
    }
    z[0] = c * dc - s * ds;
    z[1] = s * dc + c * ds;
}

/* Root between 0 and 1 of the cubic with values f0, f1 and slopes m0, m1 at 0 and 1, by three
 * Newton steps from the secant. */
static double root_of_cubic(double f0, double f1, double m0, double m1) {
    /* f0 + m0 t + a2 t^2 + a3 t^3 */
    const double a3 = 2.0 * (f0 - f1) + m0 + m1;
    const double a2 = 3.0 * (f1 - f0) - 2.0 * m0 - m1;
    double t = f0 / (f0 - f1);
    for (int i = 0; i < 3; ++i) {
        const double value = f0 + t * (m0 + t * (a2 + t * a3));
        const double slope = m0 + t * (2.0 * a2 + 3.0 * t * a3);
        const double next = t - value / slope;
        if (!(next > 0.0 && next < 1.0)) break;
        t = next;
    }
    return t;
}

/* Return the bracketed root of a cell as distance from its left node. The start is the root of the
 * cubic through the values f0, f1 and slopes d0, d1 at the ends. Newton's method squares the error,
 * so the size of the step after the next is predictable. */
static double refine(const bd_trig_grid *grid, const double *f, int k, double f0, double f1,
                     double d0, double d1) {
    const double h = BD_TWO_PI / grid->n_time;
    double x = h * root_of_cubic(f0, f1, h * d0, h * d1);
    double a = 0.0, b = h;
    double last = 0.0; /* latest Newton step; 0 after a bisection */
    for (int i = 0; i < 100; ++i) {
        double slope, z[2];
        rotate(grid, k, x, z);
        const double fx = value_and_slope_at(grid->n_harm, f, z, &slope);
        if (fx == 0.0) return x;
        if ((fx < 0.0) == (f0 < 0.0))
            a = x;
        else
            b = x;
        double next = x - fx / slope;
        const double newton = fabs(next - x);
        if (newton <= 1e-16) return x;
        if (!(next > a && next < b)) next = 0.5 * (a + b);
        const double step = fabs(next - x);
        x = next;
        if (step <= 1e-16 || b - a <= 2e-16) break;

        const int was_bisection = step != newton;
        if (was_bisection) {
            last = 0.0;
            continue;
        }
        /* the ratio of successive steps squares: the next one is step ratio^2 */
        const int converges = last > 0.0 && step < 1e-3 * last;
        if (converges && step * (step / last) * (step / last) < 1e-17) break;
        last = step;
    }
    return x;
}

/* Angle from 0 to 2 pi for one from -2 pi to 4 pi. */
static double into_period(double theta) {
    if (theta < 0.0) theta += BD_TWO_PI;
    return theta >= BD_TWO_PI ? theta - BD_TWO_PI : theta;
}

/* Return the number of roots of f[0] + f[1] cos(theta) + f[2] sin(theta), 0 or 2; set the ascending
 * angles root (2) and z (2, 2) = exp(i root). With the amplitude A and the phase phi, f[1] = A
 * cos(phi) and f[2] = A sin(phi), the roots are phi -+ alpha with cos(alpha) = -f[0]/A. */
static int roots_of_one_harmonic(const double *f, double *root, double *z) {
    const double square = f[1] * f[1] + f[2] * f[2];
    if (!(square > f[0] * f[0])) return 0; /* a double root is not a crossing */
    const double amplitude = sqrt(square);
    const double c = f[1] / amplitude, s = f[2] / amplitude; /* cosine and sine of phi */
    const double k = -f[0] / amplitude;                      /* cosine and sine of alpha */
    const double m = sqrt(fmax((1.0 - k) * (1.0 + k), 0.0));

    /* exp(i theta) = (c + i s)(k -+ i m) */
    const double z0[2] = {c * k + s * m, s * k - c * m};
    const double z1[2] = {c * k - s * m, s * k + c * m};
    const double r0 = into_period(atan2(z0[1], z0[0]));
    /* without a mean the roots are half a period apart */
    const double r1 = into_period(k == 0.0 ? r0 + BD_PI : atan2(z1[1], z1[0]));
    if (r0 == r1) return 0;

    /* places of both roots in ascending order */
    const int first = r0 > r1, second = !first;
    root[first] = r0;
    root[second] = r1;
    for (int i = 0; i < 2; ++i) {
        z[2 * first + i] = z0[i];
        z[2 * second + i] = z1[i];
    }
    return 2;
}

/* Store root number n, at the distance delta behind node k, and its exp(i theta). */
static void append_root(const bd_trig_grid *grid, int k, double delta, double *root, double *z,
                        int n) {
    root[n] = k * (BD_TWO_PI / grid->n_time) + delta;
    rotate(grid, k, delta, z + 2 * n);
}

/* Add a pair of roots inside cell k to n roots, if the polynomial has the same sign at both ends
 * but crosses zero between them; return the new number of roots. */
static int hidden_pair(const bd_trig_grid *grid, const double *f, int k, double sign, double *root,
                       double *z, int n) {
    const int n_harm = grid->n_harm;
    const double h = BD_TWO_PI / grid->n_time;
    const double a = k * h, b = (k + 1) * h;
    double df[BD_MAX_COEF];
    bd_trig_derivative(n_harm, f, df);
    const double extremum = bd_trig_bracketed_root(n_harm, df, a, b);
    const int crosses = sign * bd_trig_value(n_harm, f, extremum) < 0.0;
    if (!crosses) return n;
    const double before = bd_trig_bracketed_root(n_harm, f, a, extremum);
    const double after = bd_trig_bracketed_root(n_harm, f, extremum, b);
    append_root(grid, k, before - a, root, z, n);
    append_root(grid, k, after - a, root, z, n + 1);
    return n + 2;
}

/* Return whether a sample is a simple root except for rounding; its sign is then meaningless. */
static int crosses_here(double value, double slope, double size) {
    return fabs(value) <= 1e-14 * size && fabs(slope) > 1e-6 * size;
}

/* Distance of the root in cell k, with different signs just inside its ends, from the left node.
 * zero0, zero1: the left or right end is a root itself; the search then begins inside the cell. */
static double root_in_cell(const bd_trig_grid *grid, const double *f, const double *value,
                           const double *slope, int k, int next, int zero0, int zero1) {
    const double h = BD_TWO_PI / grid->n_time;
    if (zero0 || zero1) {
        const double a = (k + (zero0 ? 1e-6 : 0.0)) * h;
        const double b = (k + 1 - (zero1 ? 1e-6 : 0.0)) * h;
        return bd_trig_bracketed_root(grid->n_harm, f, a, b) - k * h;
    }
    if (value[k] == 0.0) return 0.0;
    if (value[next] == 0.0) return h;
    return refine(grid, f, k, value[k], value[next], slope[k], slope[next]);
}

/* Move a root at the very end of the period to its beginning. */
static void move_last_root(int n, double *root, double *z) {
    if (n == 0 || !(root[n - 1] >= BD_TWO_PI - 1e-14)) return;
    const double z_last[2] = {z[2 * n - 2], z[2 * n - 1]};
    for (int i = n - 1; i > 0; --i) {
        root[i] = root[i - 1];
        z[2 * i] = z[2 * i - 2];
        z[2 * i + 1] = z[2 * i - 1];
    }
    root[0] = 0.0;
    z[0] = z_last[0];
    z[1] = z_last[1];
}

/* Roots of the trigonometric polynomial f (n_coef) in a period, ascending, and z = exp(i root) (2 for
 * each); return their number, at most 2 n_harm. The samples (n_time) are values and slopes on the
 * grid. Each cell between two samples has one root if the signs at its ends differ, otherwise two or
 * none; an extremum inside the cell decides. A sample that is zero counts once, with the sign of its
 * slope. */
int bd_trig_roots_with_powers(const bd_trig_grid *grid, const double *f, const double *value,
                              const double *slope, double *root, double *z) {
    if (grid->n_harm == 1) return roots_of_one_harmonic(f, root, z);
    const int n_time = grid->n_time;
    const int most = 2 * grid->n_harm; /* number of roots of the polynomial at most */
    const double h = BD_TWO_PI / n_time;
    double size = 0.0; /* bound of the values */
    for (int i = 0; i < bd_n_coef(grid->n_harm); ++i) size += fabs(f[i]);

    int n = 0;
    for (int k = 0; k < n_time && n < most; ++k) {
        const int next = k + 1 < n_time ? k + 1 : 0;
        const double f0 = value[k], f1 = value[next];
        const int zero0 = crosses_here(f0, slope[k], size);
        const int zero1 = crosses_here(f1, slope[next], size);
        if (zero0) {
            /* not before the period */
            const double delta = -f0 / slope[k];
            append_root(grid, k, k == 0 ? fmax(0.0, delta) : delta, root, z, n);
            ++n;
            if (n == most) break;
        }

        /* signs just inside the cell */
        const double sign = (zero0 ? slope[k] : f0) < 0.0 ? -1.0 : 1.0;
        const double sign_end = (zero1 ? -slope[next] : f1) < 0.0 ? -1.0 : 1.0;
        if (sign != sign_end) {
            const double delta = root_in_cell(grid, f, value, slope, k, next, zero0, zero1);
            append_root(grid, k, delta, root, z, n);
            ++n;
            continue;
        }

        /* With a slope that falls to zero in the cell, the extremum is at most h |slope| deep; the
         * factor 2 is a margin. */
        const int has_extremum = sign * slope[k] < 0.0 && sign * slope[next] > 0.0;
        if (!has_extremum) continue;
        if (fabs(f0) > 2.0 * h * fabs(slope[k]) || fabs(f1) > 2.0 * h * fabs(slope[next])) continue;
        if (n + 2 <= most) n = hidden_pair(grid, f, k, sign, root, z, n);
    }
    move_last_root(n, root, z);
    return n;
}

int bd_trig_roots(const bd_trig_grid *grid, const double *f, const double *value,
                  const double *slope, double *root) {
    double z[4 * BD_MAX_HARM];
    return bd_trig_roots_with_powers(grid, f, value, slope, root, z);
}
