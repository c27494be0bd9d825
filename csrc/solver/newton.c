/* Newton's method for the bordered system
 *
 *     R(u, lambda) = 0
 *     row . (z - z_predicted) = 0,      z = (u, lambda)/scale,
 *
 * which is regular at folds of the curve. The unit tangent t of the curve is one more solution with
 * the last factors, with the right-hand side (0, ..., 0, 1).
 *
 * At a stationary point of the curve phi = a(y) . t vanishes. It is a fold for a = e_lambda. It is
 * a peak of the amplitude |x|, x = (re + i im) . u, if phi is the slope of ln |x| along the curve,
 *
 *     phi = Re(conj(x) x') / |x|^2,      x' = (re + i im) . (scale t).
 *
 * Near such a point, one step combines Newton's method towards the curve with a secant along it.
 * One factorisation yields the direction normal to t and the step s = -phi/kappa along t. The slope
 * kappa of phi is an estimate at first, then the change of phi over the length of the last step. No
 * second derivative is needed, which jumps at the onset of slip or separation.
 *
 * If the gradient of phi exists, it is
 *
 *     grad phi . w = (a_y w) . t - nu . (D^2 R [t, w]),      B^T (nu, .) = a,
 *
 * with B bordered by t. D^2 R is symmetric: the row nu . D^2 R [t, .] is a difference of nu^T [J C]
 * along t. */
#include "solver/newton.h"

#include "util/clock.h"

#include <math.h>
#include <string.h>

/* Tolerances of iteratively solved linear equations: for a Newton step, a tangent, and the step
 * after a trial. The tolerance of a step is tightened if many steps do not halve the residual: near
 * sharp resonances a loosely solved step is useless. Below 1e-5 there is no gain. With 1e-12, six
 * peaks of the shipped disk (65 blades, 500 N to 2 kN) were the same; at 2 kN the number of
 * solutions by elimination was larger by a quarter. */
static const double STEP_TOLERANCE = 1e-2, TANGENT_TOLERANCE = 1e-3, TRIAL_TOLERANCE = 1.0,
                    TIGHTENING = 0.03, TIGHTEST = 1e-5;

/* One run of Newton's method. */
typedef struct {
    bd_equations *equations;
    const bd_condition *condition;
    const bd_solver_options *options;
    double *y;            /* (n + 1) */
    const double *normal; /* (n + 1) of the border; for a stationary point, the latest tangent */
    const double *scale;
    double *tangent; /* (n + 1), or NULL if not needed */
    bd_solver_report *report;
    double *step, *y_old; /* (n + 1) */
    /* residual or step of the first and of the previous iteration */
    double first_residual, residual_before, step_before;
    int n_stall;
    double stall_residual; /* residual at the first of them */
    int arrived;
    double fraction; /* fraction of the latest step */
    /* whether the latest trial is y, with the data for the next factorisation */
    int derived;
    double linear_tolerance; /* tolerance of the linear equations of a step */
    /* of a linear condition: row . (z - z_predicted), updated in each step */
    double condition_residual;
    /* of a stationary point: the latest step along the tangent, and phi before it */
    double tangent_step, slope_before;
    int n_wrong_sense; /* number of secants with the wrong sign */
} newton_run;

static double largest(const bd_equations *e) {
    double most = 0.0;
    for (size_t i = 0; i < (size_t)e->n; ++i) {
        const double a = fabs(e->r[i] * e->row_scale[i]);
        if (isnan(a)) return a;
        if (a > most) most = a;
    }
    return most;
}

static double length(const double *x, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += x[i] * x[i];
    return sqrt(sum);
}

double bd_slope(const bd_condition *condition, const double *y, const double *tangent,
                const double *scale, size_t n) {
    if (!condition->re) return tangent[n];
    double re = 0.0, im = 0.0, d_re = 0.0, d_im = 0.0;
    for (size_t i = 0; i < n; ++i) {
        const double d = tangent[i] * scale[i];
        re += condition->re[i] * y[i], im += condition->im[i] * y[i];
        d_re += condition->re[i] * d, d_im += condition->im[i] * d;
    }
    return (re * d_re + im * d_im) / fmax(re * re + im * im, 1e-300);
}

/* Decide whether to continue from the latest point. Without line search, three consecutive
 * iterations that do not halve the residual end a correction. On 240 ordinary curves this saves 1 %
 * of the evaluations; far from a solution it saves most of them. */
static bd_status check_progress(newton_run *run) {
    const bd_solver_options *options = run->options;
    const double residual = run->report->residual;
    /* its convergence is checked after the step */
    const int stationary = run->condition->kind == BD_STATIONARY;
    const int converged = residual <= options->tolerance, i = run->report->iterations;
    if ((stationary || !converged) &&
        (i - stationary >= options->max_iterations || isnan(residual)))
        return BD_NOT_CONVERGED;
    if (!converged && residual > 1e6 * (1.0 + run->first_residual)) return BD_DIVERGED;
    if (!stationary && !converged && !options->line_search && i > 2) {
        run->n_stall = residual > 0.5 * run->residual_before ? run->n_stall + 1 : 0;
        if (run->n_stall >= 3) return BD_NOT_CONVERGED;
    }
    return BD_OK;
}

static bd_status find_tangent(newton_run *run) {
    const size_t n1 = (size_t)run->equations->n + 1;
    double *tangent = run->tangent;
    memset(tangent, 0, sizeof(double) * n1);
    tangent[n1 - 1] = 1.0;
    bd_status status = bd_solve_linear(run->equations, TANGENT_TOLERANCE, tangent);
    const double size = length(tangent, n1);
    if (status != BD_OK || !(size > 0.0) || !isfinite(size)) return BD_SINGULAR;
    for (size_t i = 0; i < n1; ++i) tangent[i] /= size;
    return BD_OK;
}

/* Compute the Newton step and the tangent, as requested, from one factorisation. */
static bd_status find_step(newton_run *run, int with_step, int with_tangent) {
    bd_equations *e = run->equations;
    bd_solver_report *report = run->report;
    const size_t n = (size_t)e->n;
    const double clock = bd_seconds();
    bd_status status = bd_factor(e, &(bd_border){.row = run->normal, .scale = run->scale});
    if (status == BD_OK && with_step) {
        for (size_t j = 0; j < n; ++j) run->step[j] = -e->r[j];
        run->step[n] = -run->condition_residual;
        status = bd_solve_linear(e, run->linear_tolerance, run->step);
    }
    if (status == BD_OK && with_tangent) status = find_tangent(run);
    report->factored = e->factored;
    e->cost->algebra += bd_seconds() - clock;
    if (status != BD_OK || !with_step) return status;
    run->step_before = report->last_step;
    report->last_step = length(run->step, n + 1);
    if (!isfinite(report->last_step)) return BD_SINGULAR;
    if (report->iterations == 0) report->first_step = report->last_step;
    if (run->options->max_newton_step > 0.0 && report->last_step > run->options->max_newton_step)
        return BD_NOT_CONVERGED;
    return BD_OK;
}

/* y = y_old + fraction * step * scale */
static void move(newton_run *run, double fraction) {
    for (size_t i = 0; i <= (size_t)run->equations->n; ++i)
        run->y[i] = run->y_old[i] + fraction * run->step[i] * run->scale[i];
}

/* Halve the step until the residual decreases; use the best fraction if it never does. */
static void search_residual(newton_run *run) {
    const double before = run->report->residual;
    double best = INFINITY, best_fraction = 1.0, fraction = 1.0;
    for (int i = 0; i < 14; ++i, fraction *= 0.5) {
        move(run, fraction);
        if (bd_evaluate(run->equations, run->y, 0) != BD_OK) continue;
        const double now = largest(run->equations);
        if (now < best) best = now, best_fraction = fraction;
        if (now <= (1.0 - 1e-3 * fraction) * before) break;
    }
    move(run, best_fraction);
    run->fraction = best_fraction;
}

/* Halve the step until the next step with the same factors is shorter; use the best fraction if
 * none is. Contacts are stiff, so their residuals are a poor measure on the way. */
static void search_step_length(newton_run *run) {
    bd_equations *e = run->equations;
    const size_t n = (size_t)e->n;
    const double full_length = length(run->step, n + 1);
    double *next = e->scratch + 2 * (n + 1), best = INFINITY, fraction = 1.0;
    run->fraction = 1.0;
    for (int i = 0; i < 8; ++i, fraction *= 0.5) {
        move(run, fraction);
        if (bd_trial(e, run->y) != BD_OK) continue;
        for (size_t j = 0; j < n; ++j) next[j] = -e->r[j];
        next[n] = -(1.0 - fraction) * run->condition_residual;
        const double now =
            bd_solve_linear(e, fmin(TRIAL_TOLERANCE, 100.0 * run->linear_tolerance), next) == BD_OK
                ? length(next, n + 1)
                : INFINITY;
        if (now < best) best = now, run->fraction = fraction;
        if (now < (1.0 - 0.25 * fraction) * full_length) break;
    }
    run->derived = !e->J && run->fraction == fraction && e->stage == BD_FACTORED;
    move(run, run->fraction);
}

/* Return whether more than three steps had a fraction of at most 1/32 while the residual was not
 * halved. The check is used if a loose residual suffices, in runs that begin near a loosely
 * converged point. On the shipped disk (65 blades, 500 N), such runs end without a solution after
 * 25 steps, which on the full disk cost as much as the remainder of a search. Runs from a distant
 * start sometimes converge. */
static int oscillates(newton_run *run) {
    enum { MOST_BACK = 3 };
    if (run->report->residual < 0.5 * run->stall_residual) run->n_stall = 0;
    if (run->fraction > 1.0 / 32.0) return 0;
    if (run->n_stall == 0) run->stall_residual = run->report->residual;
    return ++run->n_stall > MOST_BACK;
}

static void advance_to_curve(newton_run *run) {
    const size_t n1 = (size_t)run->equations->n + 1;
    memcpy(run->y_old, run->y, sizeof(double) * n1);
    move(run, 1.0);
    run->fraction = 1.0;
    if (run->options->line_search == 1) search_residual(run);
    if (run->options->line_search == 2) search_step_length(run);
    for (size_t j = 0; j < n1; ++j)
        run->condition_residual += run->normal[j] * (run->y[j] - run->y_old[j]) / run->scale[j];
}

/* Take the Newton step and a secant step along the tangent, unless the point is
 * reached. phi decreases along the curve if the initial curvature is negative, and
 * increases if it is positive. */
static bd_status advance_along(newton_run *run) {
    enum { MOST_STALLS = 4 };
    bd_solver_report *report = run->report;
    const bd_condition *condition = run->condition;
    const size_t n = (size_t)run->equations->n;
    const double sense = condition->curvature > 0.0 ? -1.0 : 1.0;
    const double slope = bd_slope(condition, run->y, run->tangent, run->scale, n),
                 last_tangent_step = run->tangent_step;
    if (fabs(last_tangent_step) > 1e-7 &&
        fmax(run->step_before, report->last_step) < 0.1 * fabs(last_tangent_step)) {
        const double secant = sense * (slope - run->slope_before) / last_tangent_step,
                     kappa = sense * report->curvature;
        if (!(secant < 0.0) && ++run->n_wrong_sense > 1) return BD_NOT_CONVERGED;
        report->curvature = sense * fmin(0.3 * kappa, fmax(4.0 * kappa, secant));
        if (fabs(slope) > 0.5 * fabs(run->slope_before)) ++run->n_stall;
    }
    run->slope_before = slope;
    const int on_curve = report->residual <= run->options->tolerance;
    if (report->iterations > 1 && !on_curve && report->last_step > 0.5 * run->step_before)
        ++run->n_stall;
    if (run->n_stall > MOST_STALLS) return BD_NOT_CONVERGED;
    const double tangent_step = -slope / report->curvature;
    if (!isfinite(tangent_step)) return BD_NOT_CONVERGED;
    run->arrived = on_curve && fabs(tangent_step) <= condition->tolerance;
    if (run->arrived) {
        report->slope = slope;
        return BD_OK;
    }
    /* far from the curve, phi is not the slope of the curve */
    run->tangent_step = report->last_step > 0.3 * fabs(tangent_step)
                            ? 0.0
                            : fmax(-condition->max_step, fmin(condition->max_step, tangent_step));
    for (size_t j = 0; j <= n; ++j)
        run->y[j] += (run->step[j] + run->tangent_step * run->tangent[j]) * run->scale[j];
    return BD_OK;
}

/* A point of the curve needs Newton steps until convergence, then its tangent. A stationary point
 * needs both in every iteration. */
static bd_status iterate(newton_run *run) {
    bd_solver_report *report = run->report;
    const int stationary = run->condition->kind == BD_STATIONARY;
    for (int i = 0; !run->arrived; ++i) {
        bd_status status = run->derived ? BD_OK : bd_evaluate(run->equations, run->y, 1);
        if (status != BD_OK) return status;
        run->derived = 0;
        run->residual_before = report->residual;
        report->residual = largest(run->equations);
        report->iterations = i;
        if (i == 0) run->first_residual = report->residual;
        status = check_progress(run);
        if (status != BD_OK) return status;
        if (i > 8 && report->residual > 0.5 * run->residual_before)
            run->linear_tolerance = fmax(TIGHTENING * run->linear_tolerance, TIGHTEST);
        run->arrived = report->residual <= run->options->tolerance && !stationary;
        if (run->arrived && !run->tangent) return BD_OK;
        status = find_step(run, !run->arrived, run->arrived || stationary);
        if (status == BD_OK && stationary) status = advance_along(run);
        if (status != BD_OK) return status;
        if (stationary || run->arrived) continue;
        advance_to_curve(run);
        if (run->options->accepted_residual > 0.0 && oscillates(run)) return BD_NOT_CONVERGED;
        if (run->fraction < 1.0 || report->last_step >= run->options->step_tolerance) continue;
        if (run->tangent) status = find_tangent(run);
        if (status == BD_OK && !run->derived) status = bd_evaluate(run->equations, run->y, 0);
        if (status != BD_OK) return status;
        report->residual = largest(run->equations);
        if (run->options->accepted_residual == 0.0 ||
            report->residual <= run->options->accepted_residual) {
            ++report->iterations;
            return BD_OK;
        }
    }
    return BD_OK;
}

bd_status bd_solve(bd_equations *equations, const bd_condition *condition,
                   const bd_solver_options *options, const double *scale, double *y,
                   double *tangent, bd_solver_report *report) {
    newton_run run = {.equations = equations,
                      .condition = condition,
                      .options = options,
                      .y = y,
                      .normal = condition->kind == BD_LINEAR ? condition->row : tangent,
                      .scale = scale,
                      .tangent = tangent,
                      .report = report,
                      .linear_tolerance = STEP_TOLERANCE,
                      .step = equations->scratch,
                      .y_old = equations->scratch + equations->n + equations->k};
    *report = (bd_solver_report){.residual = INFINITY,
                                 .factored.rank = equations->n + 1,
                                 .curvature = condition->curvature,
                                 .slope = NAN};
    return iterate(&run);
}

/* ---- gradient ---- */

/* a (n + 1), and the row of (a_y w) . t. */
static void explicit_part(const bd_condition *condition, const double *scale, const double *y,
                          const double *tangent, size_t n, double *a, double *row) {
    memset(a, 0, sizeof(double) * (n + 1));
    memset(row, 0, sizeof(double) * (n + 1));
    if (!condition->re) {
        a[n] = 1.0;
        return;
    }
    double x[2] = {0.0}, d[2] = {0.0}; /* real and imaginary part of x and of x' */
    for (size_t i = 0; i < n; ++i) {
        x[0] += condition->re[i] * y[i], x[1] += condition->im[i] * y[i];
        d[0] += condition->re[i] * scale[i] * tangent[i],
            d[1] += condition->im[i] * scale[i] * tangent[i];
    }
    const double square = fmax(x[0] * x[0] + x[1] * x[1], 1e-300),
                 phi = (x[0] * d[0] + x[1] * d[1]) / square;
    for (size_t i = 0; i < n; ++i) {
        a[i] = (condition->re[i] * x[0] + condition->im[i] * x[1]) * scale[i] / square;
        row[i] = (condition->re[i] * d[0] + condition->im[i] * d[1]) * scale[i] / square -
                 2.0 * phi * a[i];
    }
}

bd_status bd_gradient(bd_equations *e, const bd_condition *condition, const double *scale,
                      const double *y, const double *tangent, double step, double *row,
                      double *nu) {
    const size_t n = (size_t)e->n, n1 = n + 1;
    double *a = e->scratch, *y_shifted = a + n1, *product = y_shifted + n1;
    bd_status status = bd_evaluate(e, y, 1);
    if (status == BD_OK) status = bd_factor(e, &(bd_border){.row = tangent, .scale = scale});
    if (status != BD_OK) return status;
    explicit_part(condition, scale, y, tangent, n, a, row);
    status = bd_solve_transposed(e, a);
    if (status != BD_OK) return status;
    memcpy(nu, a, sizeof(double) * n);
    for (int side = -1; side <= 1; side += 2) {
        for (size_t j = 0; j < n1; ++j) y_shifted[j] = y[j] + side * step * tangent[j] * scale[j];
        status = bd_evaluate(e, y_shifted, 1);
        if (status != BD_OK) return status;
        status = bd_product(e, 1, nu, product);
        if (status != BD_OK) return status;
        for (size_t j = 0; j < n; ++j) row[j] -= side / (2.0 * step) * product[j] * scale[j];
        for (size_t j = 0; j < n; ++j) row[n] -= side / (2.0 * step) * nu[j] * e->C[j] * scale[n];
    }
    return BD_OK;
}
