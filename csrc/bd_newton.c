/* Newton's method on the bordered system
 *
 *     r(u, omega) = 0
 *     normal . (z - z_predicted) = 0,      z = (u, omega)/scale,
 *
 * which is regular at folds of the response curve.  In place of omega the last unknown may be a factor s on the vibratory
 * excitation at fixed omega, which serves to grow a response from the static state, or fade out a linear support B of a
 * free body:
 *
 *     r(u, omega) + (1 - s) ramp + (1/s - 1) B u = 0,      0 < s <= 1.
 *
 * The support goes from as good as rigid at small s to nothing at 1.  The matrix is built in scaled
 * unknowns and its rows are brought to unit size before the LU factorisation, so the condition estimate does not depend on
 * units.  If the estimate says that the system is rank-deficient (a free body whose mean position no contact determines)
 * the least-norm solution of a rank-revealing QR takes the place of the LU solution, which leaves such a position where it
 * is.
 *
 * With the last factorisation the tangent t of the branch is one more solution, with right-hand side (0, ..., 0, 1).
 * The sign of the determinant of the bordered matrix is that of det [J; t], which does not change along a curve, not even
 * at a corner where J jumps: J agrees on both sides along the surface that the curve crosses.  It tells forward from
 * backward where the angle between two tangents does not.
 *
 * A peak of the amplitude |x|, x = (a + i b) . u, lies where the slope of ln |x| along the curve,
 *
 *     phi = Re(conj(x) x') / |x|^2,      x' = (a + i b) . (scale t),
 *
 * falls through zero.  From near by, Newton to the curve and a secant along it are taken in one step: the direction normal
 * to t and s = -phi/kappa along t with one factorisation.  kappa, the slope of phi, is a guess at first; afterwards it is
 * the change of phi over the length of the last step. */
#include "bd_newton.h"

#include "bd_clock.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

bd_status bd_newton_create(bd_newton_work *work, int n_unknown, const bd_lapack *lapack) {
    memset(work, 0, sizeof *work);
    const size_t n = (size_t)n_unknown, n1 = n + 1;
    int m = (int)n1, one = 1, query = -1, rank = 0, info = 0, pivot = 0;
    double a = 0.0, b = 0.0, rcond = 0.0, size = 0.0;
    lapack->dgelsy(&m, &m, &one, &a, &m, &b, &m, &pivot, &rcond, &rank, &size, &query, &info);
    if (info != 0) return BD_BAD_ARGUMENT;
    work->lapack = *lapack;
    work->n = n_unknown;
    work->lwork = (int)size + 1;
    const size_t n_work = (size_t)work->lwork > 4 * n1 ? (size_t)work->lwork : 4 * n1;
    work->memory = malloc(sizeof(double) * (2 * n + n * n + 2 * n1 * n1 + 4 * n1 + n_work));
    work->pivot = malloc(sizeof(int) * 2 * n1);
    if (!work->memory || !work->pivot) {
        bd_newton_destroy(work);
        return BD_NO_MEMORY;
    }
    double *p = work->memory;
    work->r = p, p += n;
    work->r_omega = p, p += n;
    work->J = p, p += n * n;
    work->A = p, p += n1 * n1;
    work->LU = p, p += n1 * n1;
    work->row = p, p += n1;
    work->b = p, p += n1;
    work->step = p, p += n1;
    work->y_old = p, p += n1;
    work->work = p;
    work->iwork = work->pivot + n1;
    return BD_OK;
}

void bd_newton_destroy(bd_newton_work *work) {
    if (!work) return;
    free(work->memory);
    free(work->pivot);
    memset(work, 0, sizeof *work);
}

static double largest(const double *r, const double *row_scale, size_t n) {
    double most = 0.0;
    for (size_t i = 0; i < n; ++i) {
        const double a = fabs(r[i] * row_scale[i]);
        if (isnan(a)) return a;
        if (a > most) most = a;
    }
    return most;
}

/* Rounding noise: entries this much smaller than the largest of their column. */
static const double NOISE = 1e-13;

/* Whether row i is rounding noise in every column (largest entries of the columns: (n + 1)).  Brought to unit size, such a
 * row would ask for arbitrary things. */
static int is_noise(const bd_newton_work *w, const double *column, size_t i) {
    const size_t n = (size_t)w->n;
    for (size_t j = 0; j < n; ++j)
        if (!(fabs(w->J[i * n + j]) <= NOISE * column[j])) return 0;
    return fabs(w->r_omega[i]) <= NOISE * column[n];
}

/* most_j = max(most_j, |x_j|) */
static void raise_to(double *restrict most, const double *restrict x, size_t n) {
    for (size_t j = 0; j < n; ++j) {
        const double size = fabs(x[j]);
        most[j] = size > most[j] ? size : most[j];
    }
}

/* Largest |x_j|; several maxima side by side, since one would wait for itself. */
static double largest_entry(const double *x, size_t n) {
    enum { SIDE_BY_SIDE = 8 };
    double most[SIDE_BY_SIDE] = {0.0};
    size_t j = 0;
    for (; j + SIDE_BY_SIDE <= n; j += SIDE_BY_SIDE) raise_to(most, x + j, SIDE_BY_SIDE);
    raise_to(most, x + j, n - j);
    for (size_t k = 1; k < SIDE_BY_SIDE; ++k) raise_to(most, most + k, 1);
    return most[0];
}

/* to_j = x_j y_j */
static void multiply_entries(double *restrict to, const double *restrict x, const double *restrict y, size_t n) {
    for (size_t j = 0; j < n; ++j) to[j] = x[j] * y[j];
}

static void scale_entries(double *restrict x, double factor, size_t n) {
    for (size_t j = 0; j < n; ++j) x[j] *= factor;
}

/* A and row: the bordered matrix in scaled unknowns with rows of unit size; a row of noise becomes zero. */
static void build_matrix(bd_newton_work *w, const double *normal, const double *scale) {
    const size_t n = (size_t)w->n, n1 = n + 1;
    double *column = w->b;
    memset(column, 0, sizeof(double) * n1);
    for (size_t i = 0; i < n; ++i) raise_to(column, w->J + i * n, n);
    column[n] = largest_entry(w->r_omega, n);
    for (size_t i = 0; i < n1; ++i) {
        double *row = w->A + i * n1;
        if (i < n) {
            multiply_entries(row, w->J + i * n, scale, n);
            row[n] = w->r_omega[i] * scale[n];
        } else {
            memcpy(row, normal, sizeof(double) * n1);
        }
        const double most = largest_entry(row, n1);
        w->row[i] = most > 0.0 ? 1.0 / most : 1.0;
        if (i < n && is_noise(w, column, i)) w->row[i] = 0.0;
        scale_entries(row, w->row[i], n1);
    }
}

/* Estimate of the reciprocal condition of A in the 1-norm of the transpose that Fortran sees: that of row sums here. */
static double estimate_condition(bd_newton_work *w) {
    const size_t n1 = (size_t)w->n + 1;
    int m = (int)n1, info = 0;
    double norm = 0.0, condition = 0.0;
    for (size_t i = 0; i < n1; ++i) {
        double sum = 0.0;
        for (size_t j = 0; j < n1; ++j) sum += fabs(w->A[i * n1 + j]);
        norm = sum > norm ? sum : norm;
    }
    char one = '1';
    w->lapack.dgecon(&one, &m, w->LU, &m, &norm, &condition, w->work, w->iwork, &info);
    return condition;
}

/* Factorises A; report->condition tells how far it is from singular: by the ratio of the smallest pivot to the largest as
 * long as that is far above the rank tolerance, by LAPACK's estimate, which costs half a factorisation, otherwise.  On
 * curves of the reference disk the estimate was smaller than the ratio by up to 1.4e9, and the ratio of one factorisation
 * in 500 was below 1e-5. */
static void factorise(bd_hbm *hbm, bd_newton_work *w, const bd_newton_options *options, bd_newton_report *report) {
    static const double FAR_ABOVE = 1e9;
    const size_t n1 = (size_t)w->n + 1;
    int m = (int)n1, info = 0;
    double least = INFINITY, most = 0.0;
    memcpy(w->LU, w->A, sizeof(double) * n1 * n1);
    w->lapack.dgetrf(&m, &m, w->LU, &m, w->pivot, &info);
    report->orientation = 1;
    for (size_t i = 0; i < n1; ++i) {
        const double pivot = w->LU[i * n1 + i];
        least = fmin(least, fabs(pivot));
        most = fmax(most, fabs(pivot));
        if ((pivot < 0.0) != (w->pivot[i] != (int)i + 1)) report->orientation = -report->orientation;
    }
    report->condition = info == 0 ? least / most : 0.0;
    if (info == 0 && !(report->condition > FAR_ABOVE * options->rank_tolerance)) report->condition = estimate_condition(w);
    if (!(report->condition > 0.0)) report->orientation = 0;
    report->rank = m;
    ++hbm->cost.n_factorisation;
}

/* Solves A x = b in place: by the factors, or by least norm where A is rank-deficient. */
static bd_status solve(bd_hbm *hbm, bd_newton_work *w, const bd_newton_options *options, double *b,
                       bd_newton_report *report) {
    const size_t n1 = (size_t)w->n + 1;
    int m = (int)n1, one = 1, info = 0;
    if (report->condition > options->rank_tolerance) {
        char transposed = 'T';
        w->lapack.dgetrs(&transposed, &m, &one, w->LU, &m, w->pivot, b, &m, &info);
        return info == 0 ? BD_OK : BD_SINGULAR;
    }
    report->orientation = 0;
    if (!options->least_norm) return BD_SINGULAR;
    for (size_t i = 0; i < n1; ++i)
        for (size_t j = 0; j < n1; ++j) w->LU[j * n1 + i] = w->A[i * n1 + j];
    memset(w->pivot, 0, sizeof(int) * n1);
    double cut = options->rank_tolerance * 10.0;
    w->lapack.dgelsy(&m, &m, &one, w->LU, &m, b, &m, w->pivot, &cut, &report->rank, w->work, &w->lwork, &info);
    ++hbm->cost.n_least_norm;
    return info == 0 ? BD_OK : BD_SINGULAR;
}

/* Adds the force of the support and its derivatives. */
static void add_support(bd_newton_work *w, const double *support, const double *y, int with_jacobian) {
    const size_t n = (size_t)w->n;
    const double s = y[n], share = 1.0 / s - 1.0;
    for (size_t i = 0; i < n; ++i) {
        const double *row = support + i * n;
        double force = 0.0;
        for (size_t j = 0; j < n; ++j) force += row[j] * y[j];
        w->r[i] += share * force;
        w->r_omega[i] -= force / (s * s);
        if (with_jacobian)
            for (size_t j = 0; j < n; ++j) w->J[i * n + j] += share * row[j];
    }
}

/* Residual with Jacobian (or neither J nor derivative) at y for the parameter in use. */
static bd_status evaluate(bd_hbm *hbm, bd_newton_work *w, const bd_newton_options *options, const double *y,
                          int with_jacobian) {
    const size_t n = (size_t)w->n;
    const double omega = options->ramp ? options->omega : y[n];
    bd_status status = bd_hbm_evaluate(hbm, y, omega, w->r, with_jacobian ? w->J : NULL, with_jacobian ? w->r_omega : NULL);
    if (options->ramp)
        for (size_t i = 0; i < n; ++i) {
            w->r[i] += (1.0 - y[n]) * options->ramp[i];
            w->r_omega[i] = -options->ramp[i];
        }
    if (options->ramp && options->support) add_support(w, options->support, y, with_jacobian);
    return status;
}

static double length(const double *x, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += x[i] * x[i];
    return sqrt(sum);
}

/* y = y_old + fraction * step * scale */
static void move(const bd_newton_work *w, double *y, double fraction, const double *scale) {
    for (size_t i = 0; i <= (size_t)w->n; ++i) y[i] = w->y_old[i] + fraction * w->step[i] * scale[i];
}

/* Halves the step until the residual shrinks; takes the best fraction if none does. */
static void search_line(bd_hbm *hbm, bd_newton_work *w, const bd_newton_options *options, double *y, double before,
                        const double *scale, const double *row_scale) {
    double best = INFINITY, best_fraction = 1.0, fraction = 1.0;
    for (int i = 0; i < 14; ++i, fraction *= 0.5) {
        move(w, y, fraction, scale);
        if (evaluate(hbm, w, options, y, 0) != BD_OK) continue;
        const double now = largest(w->r, row_scale, (size_t)w->n);
        if (now < best) best = now, best_fraction = fraction;
        if (now <= (1.0 - 1e-3 * fraction) * before) break;
    }
    move(w, y, best_fraction, scale);
}

static bd_status find_tangent(bd_hbm *hbm, bd_newton_work *w, const bd_newton_options *options, double *tangent,
                              bd_newton_report *report) {
    const size_t n1 = (size_t)w->n + 1;
    memset(tangent, 0, sizeof(double) * n1);
    tangent[n1 - 1] = w->row[n1 - 1];
    bd_status status = solve(hbm, w, options, tangent, report);
    const double size = length(tangent, n1);
    if (status != BD_OK || !(size > 0.0) || !isfinite(size)) return BD_SINGULAR;
    for (size_t i = 0; i < n1; ++i) tangent[i] /= size;
    return BD_OK;
}

double bd_newton_slope(const bd_newton_peak_options *peak, const double *y, const double *tangent, const double *scale,
                       size_t n) {
    double re = 0.0, im = 0.0, d_re = 0.0, d_im = 0.0;
    for (size_t i = 0; i < n; ++i) {
        const double d = tangent[i] * scale[i];
        re += peak->re[i] * y[i], im += peak->im[i] * y[i];
        d_re += peak->re[i] * d, d_im += peak->im[i] * d;
    }
    return (re * d_re + im * d_im) / fmax(re * re + im * im, 1e-300);
}

/* ---- Newton's method ---- */

/* One run of Newton's method, to a point of the curve (peak NULL) or to the peak of the response on it. */
typedef struct {
    bd_hbm *hbm;
    bd_newton_work *work;
    const bd_newton_options *options;
    bd_newton_peak_options *peak;
    double *y;            /* (n + 1) */
    const double *normal; /* (n + 1) of the border; that of a peak is the latest tangent */
    const double *scale, *row_scale;
    double *tangent; /* (n + 1), or NULL: not asked for */
    bd_newton_report *report;
    double first_residual, residual_before, step_before; /* of the first and of the previous iteration */
    int stalls;
    int arrived;
    double border;              /* of a curve: normal . (z - z_predicted), carried along */
    double moved, slope_before; /* of a peak: the latest way along the tangent, and phi before it */
    int opposed;                /* how often phi rose along the curve: toward a minimum */
} newton_run;

/* Whether to go on from the point that was just evaluated.  Without line search, three iterations in a row that do not halve
 * the residual end a correction: on 240 ordinary curves this saves 1 % of the evaluations, and far from a solution most. */
static bd_status judge(newton_run *run) {
    const bd_newton_options *options = run->options;
    const double residual = run->report->residual;
    const int converged = residual <= options->tolerance, i = run->report->iterations;
    const int limit =
        run->peak ? options->max_iterations + 1 : options->max_iterations; /* a peak is judged after its step */
    if ((run->peak || !converged) && (i >= limit || isnan(residual))) return BD_NOT_CONVERGED;
    if (!converged && residual > 1e6 * (1.0 + run->first_residual)) return BD_DIVERGED;
    if (!run->peak && !converged && !options->line_search && i > 2) {
        run->stalls = residual > 0.5 * run->residual_before ? run->stalls + 1 : 0;
        if (run->stalls >= 3) return BD_NOT_CONVERGED;
    }
    return BD_OK;
}

/* The Newton step and the tangent, whichever are asked for, from one factorisation. */
static bd_status find_step(newton_run *run, int with_step, int with_tangent) {
    bd_newton_work *w = run->work;
    bd_newton_report *report = run->report;
    const size_t n = (size_t)w->n;
    const double clock = bd_seconds();
    bd_status status = BD_OK;
    build_matrix(w, run->normal, run->scale);
    factorise(run->hbm, w, run->options, report);
    if (with_step) {
        for (size_t j = 0; j < n; ++j) w->step[j] = -w->r[j] * w->row[j];
        w->step[n] = -run->border * w->row[n];
        status = solve(run->hbm, w, run->options, w->step, report);
    }
    if (status == BD_OK && with_tangent) status = find_tangent(run->hbm, w, run->options, run->tangent, report);
    run->hbm->cost.algebra += bd_seconds() - clock;
    if (status != BD_OK || !with_step) return status;
    run->step_before = report->last_step;
    report->last_step = length(w->step, n + 1);
    if (!isfinite(report->last_step)) return BD_SINGULAR;
    if (report->iterations == 0) report->first_step = report->last_step;
    if (run->options->reach > 0.0 && report->last_step > run->options->reach) return BD_NOT_CONVERGED;
    return BD_OK;
}

static void advance_to_curve(newton_run *run) {
    bd_newton_work *w = run->work;
    const size_t n1 = (size_t)w->n + 1;
    memcpy(w->y_old, run->y, sizeof(double) * n1);
    move(w, run->y, 1.0, run->scale);
    if (run->options->line_search)
        search_line(run->hbm, w, run->options, run->y, run->report->residual, run->scale, run->row_scale);
    for (size_t j = 0; j < n1; ++j) run->border += run->normal[j] * (run->y[j] - w->y_old[j]) / run->scale[j];
}

/* The Newton step and a secant step along the tangent, unless the peak is reached. */
static bd_status advance_to_peak(newton_run *run) {
    enum { MOST_STALLS = 4 };
    const bd_newton_work *w = run->work;
    const bd_newton_report *report = run->report;
    bd_newton_peak_options *peak = run->peak;
    const size_t n = (size_t)w->n;
    const double slope = bd_newton_slope(peak, run->y, run->tangent, run->scale, n), moved = run->moved;
    if (fabs(moved) > 1e-7 && fmax(run->step_before, report->last_step) < 0.1 * fabs(moved)) {
        const double secant = (slope - run->slope_before) / moved;
        if (!(secant < 0.0) && ++run->opposed > 1) return BD_NOT_CONVERGED;
        peak->curvature = fmin(0.3 * peak->curvature, fmax(4.0 * peak->curvature, secant));
        if (fabs(slope) > 0.5 * fabs(run->slope_before)) ++run->stalls;
    }
    run->slope_before = slope;
    const int on_curve = report->residual <= run->options->tolerance;
    if (report->iterations > 1 && !on_curve && report->last_step > 0.5 * run->step_before) ++run->stalls;
    if (run->stalls > MOST_STALLS) return BD_NOT_CONVERGED;
    const double way = -slope / peak->curvature;
    if (!isfinite(way)) return BD_NOT_CONVERGED;
    run->arrived = on_curve && fabs(way) <= peak->tolerance;
    if (run->arrived) {
        peak->slope = slope;
        return BD_OK;
    }
    /* far from the curve the slope is not that of the curve */
    run->moved = report->last_step > 0.3 * fabs(way) ? 0.0 : fmax(-peak->max_step, fmin(peak->max_step, way));
    for (size_t j = 0; j <= n; ++j) run->y[j] += (w->step[j] + run->moved * run->tangent[j]) * run->scale[j];
    return BD_OK;
}

/* A point of the curve needs its Newton step until it has arrived, and its tangent then; a peak needs both every time. */
static bd_status iterate(newton_run *run) {
    bd_newton_report *report = run->report;
    const int n = run->work->n;
    *report = (bd_newton_report){.residual = INFINITY, .rank = n + 1};
    for (int i = 0; !run->arrived; ++i) {
        bd_status status = evaluate(run->hbm, run->work, run->options, run->y, 1);
        if (status != BD_OK) return status;
        run->residual_before = report->residual;
        report->residual = largest(run->work->r, run->row_scale, (size_t)n);
        report->iterations = i;
        if (i == 0) run->first_residual = report->residual;
        status = judge(run);
        if (status != BD_OK) return status;
        const int on_curve = report->residual <= run->options->tolerance;
        run->arrived = on_curve && !run->peak;
        if (run->arrived && !run->tangent) return BD_OK;
        status = find_step(run, !run->arrived, run->arrived || run->peak);
        if (status == BD_OK && run->peak) status = advance_to_peak(run);
        if (status != BD_OK) return status;
        if (!run->peak && !run->arrived) advance_to_curve(run);
    }
    return BD_OK;
}

bd_status bd_newton_correct(bd_hbm *hbm, bd_newton_work *work, const bd_newton_options *options, double *y,
                            const double *normal, const double *scale, const double *row_scale, double *tangent,
                            bd_newton_report *report) {
    newton_run run = {.hbm = hbm,
                      .work = work,
                      .options = options,
                      .y = y,
                      .normal = normal,
                      .scale = scale,
                      .row_scale = row_scale,
                      .tangent = tangent,
                      .report = report};
    return iterate(&run);
}

bd_status bd_newton_peak(bd_hbm *hbm, bd_newton_work *work, const bd_newton_options *options, bd_newton_peak_options *peak,
                         double *y, double *tangent, const double *scale, const double *row_scale,
                         bd_newton_report *report) {
    newton_run run = {.hbm = hbm,
                      .work = work,
                      .options = options,
                      .peak = peak,
                      .y = y,
                      .normal = tangent,
                      .scale = scale,
                      .row_scale = row_scale,
                      .tangent = tangent,
                      .report = report};
    return iterate(&run);
}
