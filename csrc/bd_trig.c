/* Trigonometric polynomials.
 *
 * x(theta) = x0 + sum_l c_l cos(l theta) + s_l sin(l theta) has the derivative with coefficients
 * c'_l = l s_l, s'_l = -l c_l.  Values come from the powers of z = exp(i theta), which one sine and one cosine and a
 * complex recurrence give for all harmonics.
 *
 * Roots.  A polynomial of degree H has at most 2 H roots in a period.  For H = 1,
 *     x0 + A cos(theta - phi) = 0  <=>  theta = phi +- acos(-x0/A).
 * For H > 1 the period is cut into cells.  A sign change over a cell brackets a root.  Without one the cell may still
 * hide a pair: the polynomial then has an extremum inside that reaches across zero.  It is recognised by a slope that
 * leads toward zero at the left end and away from it at the right end; the extremum is the bracketed root of the
 * derivative, and the sign of the polynomial there decides.
 *
 * A bracketed root is refined by Newton's method, kept inside a shrinking bracket by bisection. */
#include "bd_trig.h"

#include <math.h>
#include <stdlib.h>

bd_status bd_trig_grid_create(bd_trig_grid *grid, int n_harm, int n_time) {
    const int n_coef = bd_n_coef(n_harm);
    grid->n_harm = n_harm;
    grid->n_time = n_time;
    grid->basis = malloc(sizeof(double) * (size_t)n_coef * (size_t)n_time);
    if (!grid->basis) return BD_NO_MEMORY;
    for (int k = 0; k < n_time; ++k) {
        for (int i = 0; i < n_coef; ++i) {
            const int l = (i + 1) / 2;
            /* the argument is reduced with integers, so that the grid is exact for every harmonic */
            const double angle = BD_TWO_PI * (double)(((long)l * k) % n_time) / n_time;
            grid->basis[(size_t)i * (size_t)n_time + (size_t)k] = i == 0 ? 1.0 : (i % 2 ? cos(angle) : sin(angle));
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
    const double c = cos(theta), s = sin(theta);
    double re = 1.0, im = 0.0;
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

/* Value and derivative at once. */
static double value_and_slope(int n_harm, const double *x, double theta, double *slope) {
    const double c = cos(theta), s = sin(theta);
    double re = c, im = s, value = x[0], d = 0.0;
    for (int l = 1; l <= n_harm; ++l) {
        const double cl = x[2 * l - 1], sl = x[2 * l];
        value += cl * re + sl * im;
        d += l * (sl * re - cl * im);
        const double re_next = re * c - im * s;
        im = re * s + im * c;
        re = re_next;
    }
    *slope = d;
    return value;
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
    for (int l = 1; l <= n_harm; ++l) sum += sqrt(x[2 * l - 1] * x[2 * l - 1] + x[2 * l] * x[2 * l]);
    return sum;
}

double bd_trig_bracketed_root(int n_harm, const double *f, double a, double b) {
    double slope;
    double fa = value_and_slope(n_harm, f, a, &slope);
    const double fb = value_and_slope(n_harm, f, b, &slope);
    if (fa == 0.0) return a;
    if (fb == 0.0) return b;
    double x = a + (b - a) * (fa / (fa - fb)); /* the secant is a good start on a small cell */
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
        /* a step below rounding ends the search: next may then be an end of the bracket, which is no reason to bisect */
        if (fabs(next - x) <= 2e-16 * (1.0 + fabs(x))) return x;
        if (!(next > a && next < b)) next = 0.5 * (a + b);
        const double step = fabs(next - x);
        x = next;
        if (step <= 1e-15 * (1.0 + fabs(x)) || b - a <= 2e-16 * (1.0 + fabs(x))) break;
    }
    return x;
}

static double into_period(double theta) {
    double t = fmod(theta, BD_TWO_PI);
    if (t < 0.0) t += BD_TWO_PI;
    return t >= BD_TWO_PI ? 0.0 : t;
}

static int roots_of_one_harmonic(const double *f, double *root) {
    const double amplitude = hypot(f[1], f[2]);
    if (!(amplitude > fabs(f[0]))) return 0; /* a grazing root is no crossing */
    const double phi = atan2(f[2], f[1]), half = acos(-f[0] / amplitude);
    double r0 = into_period(phi - half), r1 = into_period(phi + half);
    if (r0 == r1) return 0;
    root[0] = r0 < r1 ? r0 : r1;
    root[1] = r0 < r1 ? r1 : r0;
    return 2;
}

int bd_trig_roots(const bd_trig_grid *grid, const double *f, const double *value, const double *slope, double *root) {
    const int n_harm = grid->n_harm, n_time = grid->n_time, most = 2 * n_harm;
    if (n_harm == 1) return roots_of_one_harmonic(f, root);
    const double h = BD_TWO_PI / n_time;
    double df[BD_MAX_COEF];
    int df_known = 0, n = 0;
    for (int k = 0; k < n_time && n < most; ++k) {
        const int next = k + 1 < n_time ? k + 1 : 0;
        const double f0 = value[k], f1 = value[next];
        const double a = k * h, b = (k + 1) * h;
        if ((f0 < 0.0) != (f1 < 0.0)) {
            root[n++] = bd_trig_bracketed_root(n_harm, f, a, b);
            continue;
        }
        const double sign = f0 < 0.0 ? -1.0 : 1.0;
        if (!(sign * slope[k] < 0.0 && sign * slope[next] > 0.0)) continue;
        /* with a slope that falls to zero on the way the extremum is no deeper than h |slope|; twice that for safety */
        if (fabs(f0) > 2.0 * h * fabs(slope[k]) || fabs(f1) > 2.0 * h * fabs(slope[next])) continue;
        if (!df_known) {
            bd_trig_derivative(n_harm, f, df);
            df_known = 1;
        }
        const double extremum = bd_trig_bracketed_root(n_harm, df, a, b);
        if (sign * bd_trig_value(n_harm, f, extremum) < 0.0 && n + 2 <= most) {
            root[n++] = bd_trig_bracketed_root(n_harm, f, a, extremum);
            root[n++] = bd_trig_bracketed_root(n_harm, f, extremum, b);
        }
    }
    if (n > 0 && root[n - 1] >= BD_TWO_PI) { /* a root found at the very end of the period is one at its beginning */
        for (int i = n - 1; i > 0; --i) root[i] = root[i - 1];
        root[0] = 0.0;
    }
    return n;
}
