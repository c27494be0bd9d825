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

/* Tolerances of iteratively solved linear equations: of a Newton step, of a tangent, and of
 * the step after a trial. */
static const double STEP_TOLERANCE = 1e-2;
static const double TANGENT_TOLERANCE = 1e-3;
static const double TRIAL_TOLERANCE = 1.0;

/* The tolerance of a step is tightened if many steps do not halve the residual: near sharp
 * resonances a loosely solved step is useless. Below 1e-5 there is no gain. With 1e-12, six peaks
 * of the shipped disk (65 blades, 500 N to 2 kN) were the same; at 2 kN the number of solutions by
 * elimination was larger by a quarter. */
static const double TIGHTENING = 0.03;
static const double TIGHTEST = 1e-5;

/* |x|^2 is at least this, so that phi exists where the motion vanishes. */
static const double LEAST_SQUARE = 1e-300;

/* One run of Newton's method. */
typedef struct {
    bd_equations *equations;
    const bd_condition *condition;
    const bd_solver_options *options;
    double *y;            /* (n + 1) */
    const double *normal; /* (n + 1) of the border; for a stationary point, the latest tangent */
    const double *scale;  /* (n + 1) */
    double *tangent;      /* (n + 1), or NULL if not needed */
    bd_solver_report *report;
    double *step;            /* (n + 1) latest Newton step, in scaled unknowns */
    double *y_old;           /* (n + 1) point from which it starts */
    double first_residual;   /* of the first iteration */
    double residual_before;  /* of the previous iteration */
    double step_before;      /* length of the step of the previous iteration */
    int n_stall;             /* number of iterations without progress */
    double stall_residual;   /* residual at the first of them */
    int arrived;             /* whether y is the point that was sought */
    double fraction;         /* fraction of the latest step that was taken */
    int derived;             /* whether the latest trial is y, with the data of a factorisation */
    double linear_tolerance; /* of the linear equations of a step */

    /* of a linear condition: row . (z - z_predicted), updated in each step */
    double condition_residual;

    /* of a stationary point */
    double tangent_step; /* latest step along the tangent */
    double slope_before; /* phi before this step */
    int n_wrong_sense;   /* number of secants with the wrong sign */
} newton_run;

/* Largest scaled residual; NaN if one of them is NaN. */
static double largest(const bd_equations *e) {
    double most = 0.0;
    for (size_t i = 0; i < (size_t)e->n; ++i) {
        const double size = fabs(e->r[i] * e->row_scale[i]);
        if (isnan(size)) return size;
        if (size > most) most = size;
    }
    return most;
}

static double length(const double *x, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += x[i] * x[i];
    return sqrt(sum);
}

/* Slope phi along the tangent (n + 1, in units of scale) at the point y (n + 1). Without an
 * amplitude (a fold), it is the component of the parameter. Otherwise it is the relative slope
 * Re(conj x x')/|x|^2 of the complex amplitude x = (re + i im) . y. */
double bd_slope(const bd_condition *condition, const double *y, const double *tangent,
                const double *scale, size_t n) {
    if (!condition->re) return tangent[n];
    double re = 0.0, im = 0.0;     /* x */
    double d_re = 0.0, d_im = 0.0; /* x' */
    for (size_t i = 0; i < n; ++i) {
        const double d_y = tangent[i] * scale[i];
        re += condition->re[i] * y[i];
        im += condition->im[i] * y[i];
        d_re += condition->re[i] * d_y;
        d_im += condition->im[i] * d_y;
    }
    return (re * d_re + im * d_im) / fmax(re * re + im * im, LEAST_SQUARE);
}

/* ---- parts of an iteration ---- */

/* Decide whether to continue from the latest point. Without line search, three consecutive
 * iterations that do not halve the residual end a correction. On 240 ordinary curves this saves 1 %
 * of the evaluations; far from a solution it saves most of them. */
static bd_status check_progress(newton_run *run) {
    enum { MOST_STALLS = 3 };
    static const double DIVERGED = 1e6;
    const bd_solver_options *options = run->options;
    const double residual = run->report->residual;
    const int iteration = run->report->iterations;
    const int stationary = run->condition->kind == BD_STATIONARY;
    const int on_curve = residual <= options->tolerance;

    /* a stationary point is recognised after the step, so it has one iteration more */
    const int arrived = on_curve && !stationary;
    const int n_step = iteration - stationary;
    if (!arrived && n_step >= options->max_iterations) return BD_NOT_CONVERGED;
    if (!arrived && isnan(residual)) return BD_NOT_CONVERGED;
    if (!on_curve && residual > DIVERGED * (1.0 + run->first_residual)) return BD_DIVERGED;

    if (stationary || on_curve || options->line_search || iteration <= 2) return BD_OK;
    const int is_halved = residual <= 0.5 * run->residual_before;
    run->n_stall = is_halved ? 0 : run->n_stall + 1;
    return run->n_stall >= MOST_STALLS ? BD_NOT_CONVERGED : BD_OK;
}

/* Compute the unit tangent from the latest factors: B t = (0, ..., 0, 1). */
static bd_status find_tangent(newton_run *run) {
    const size_t n1 = (size_t)run->equations->n + 1;
    double *tangent = run->tangent;
    memset(tangent, 0, sizeof(double) * n1);
    tangent[n1 - 1] = 1.0;
    const bd_status status = bd_solve_linear(run->equations, TANGENT_TOLERANCE, tangent);
    if (status != BD_OK) return BD_SINGULAR;

    const double size = length(tangent, n1);
    if (!(size > 0.0) || !isfinite(size)) return BD_SINGULAR;
    for (size_t i = 0; i < n1; ++i) tangent[i] /= size;
    return BD_OK;
}

/* Solve the linear equations of a Newton step: B step = -(r, residual of the condition). */
static bd_status solve_step(newton_run *run) {
    bd_equations *e = run->equations;
    const size_t n = (size_t)e->n;
    for (size_t j = 0; j < n; ++j) run->step[j] = -e->r[j];
    run->step[n] = -run->condition_residual;
    return bd_solve_linear(e, run->linear_tolerance, run->step);
}

/* Wanted results of one factorisation. */
enum { STEP = 1, TANGENT = 2 };

/* Compute the Newton step and the tangent, as wanted, from one factorisation. */
static bd_status find_step(newton_run *run, int wanted) {
    const int with_step = wanted & STEP, with_tangent = wanted & TANGENT;
    bd_equations *e = run->equations;
    bd_solver_report *report = run->report;
    const double clock = bd_seconds();
    bd_status status = bd_factor(e, &(bd_border){.row = run->normal, .scale = run->scale});
    if (status == BD_OK && with_step) status = solve_step(run);
    if (status == BD_OK && with_tangent) status = find_tangent(run);
    report->factored = e->factored;
    e->cost->algebra += bd_seconds() - clock;
    if (status != BD_OK || !with_step) return status;

    run->step_before = report->last_step;
    report->last_step = length(run->step, (size_t)e->n + 1);
    if (!isfinite(report->last_step)) return BD_SINGULAR;
    if (report->iterations == 0) report->first_step = report->last_step;

    const double longest = run->options->max_newton_step; /* 0: no limit */
    if (longest > 0.0 && report->last_step > longest) return BD_NOT_CONVERGED;
    return BD_OK;
}

/* y = y_old + fraction * step * scale */
static void move(newton_run *run, double fraction) {
    for (size_t i = 0; i <= (size_t)run->equations->n; ++i)
        run->y[i] = run->y_old[i] + fraction * run->step[i] * run->scale[i];
}

/* Halve the step until the residual decreases; use the best fraction if it never does. */
static void search_residual(newton_run *run) {
    enum { MOST_TRIALS = 14 };
    const double before = run->report->residual;
    double least = INFINITY, best_fraction = 1.0;
    double fraction = 1.0;
    for (int i = 0; i < MOST_TRIALS; ++i, fraction *= 0.5) {
        move(run, fraction);
        if (bd_evaluate(run->equations, run->y, 0) != BD_OK) continue;
        const double now = largest(run->equations);
        if (now < least) {
            least = now;
            best_fraction = fraction;
        }
        if (now <= (1.0 - 1e-3 * fraction) * before) break;
    }
    move(run, best_fraction);
    run->fraction = best_fraction;
}

/* Length of the next Newton step from the latest trial with the factors of this one, infinite if it
 * does not exist. */
static double next_step_length(newton_run *run, double fraction) {
    bd_equations *e = run->equations;
    const size_t n = (size_t)e->n;
    double *next = e->scratch + 2 * (n + 1);
    const double tolerance = fmin(TRIAL_TOLERANCE, 100.0 * run->linear_tolerance);
    for (size_t j = 0; j < n; ++j) next[j] = -e->r[j];
    next[n] = -(1.0 - fraction) * run->condition_residual;
    if (bd_solve_linear(e, tolerance, next) != BD_OK) return INFINITY;
    return length(next, n + 1);
}

/* Halve the step until the next step with the same factors is shorter; use the best fraction if
 * none is. Contacts are stiff, so their residuals are a poor measure on the way. */
static void search_step_length(newton_run *run) {
    enum { MOST_TRIALS = 8 };
    bd_equations *e = run->equations;
    const double full_length = length(run->step, (size_t)e->n + 1);
    double least = INFINITY, fraction = 1.0;
    run->fraction = 1.0;
    for (int i = 0; i < MOST_TRIALS; ++i, fraction *= 0.5) {
        move(run, fraction);
        if (bd_trial(e, run->y) != BD_OK) continue;
        const double now = next_step_length(run, fraction);
        if (now < least) {
            least = now;
            run->fraction = fraction;
        }
        if (now < (1.0 - 0.25 * fraction) * full_length) break;
    }

    /* the latest trial may have computed the data of the next factorisation */
    const int latest_is_best = run->fraction == fraction && e->stage == BD_FACTORED;
    run->derived = e->derives_trials && latest_is_best;
    move(run, run->fraction);
}

/* Return whether more than three steps had a fraction of at most 1/32 while the residual was not
 * halved. The check is used if a loose residual suffices, in runs that begin near a loosely
 * converged point. On the shipped disk (65 blades, 500 N), such runs end without a solution after
 * 25 steps, which on the full disk cost as much as the remainder of a search. Runs from a distant
 * start sometimes converge. */
static int oscillates(newton_run *run) {
    enum { MOST_BACK = 3 };
    const double residual = run->report->residual;
    if (residual < 0.5 * run->stall_residual) run->n_stall = 0;
    if (run->fraction > 1.0 / 32.0) return 0;
    if (run->n_stall == 0) run->stall_residual = residual;
    ++run->n_stall;
    return run->n_stall > MOST_BACK;
}

/* Take a Newton step towards the curve, with line search 1 for a smaller residual or 2 for the
 * length of the step; 0 takes it as it is. Update the residual of the linear condition. */
static void advance_to_curve(newton_run *run) {
    const size_t n1 = (size_t)run->equations->n + 1;
    const int line_search = run->options->line_search;
    const double *normal = run->normal, *scale = run->scale;
    const double *y = run->y, *y_old = run->y_old;
    memcpy(run->y_old, run->y, sizeof(double) * n1);
    move(run, 1.0);
    run->fraction = 1.0;
    if (line_search == 1) search_residual(run);
    if (line_search == 2) search_step_length(run);

    /* a linear condition changes by its row times the step */
    for (size_t j = 0; j < n1; ++j)
        run->condition_residual += normal[j] * (y[j] - y_old[j]) / scale[j];
}

/* ---- a stationary point ---- */

/* Update the curvature kappa by the secant of phi over the latest step along the tangent. Return
 * BD_NOT_CONVERGED if the secant has had the wrong sign twice: phi decreases along the curve if the
 * initial curvature is negative, and increases if it is positive. */
static bd_status update_curvature(newton_run *run, double slope) {
    bd_solver_report *report = run->report;
    const double tangent_step = run->tangent_step;
    const double sense = run->condition->curvature > 0.0 ? -1.0 : 1.0;

    /* phi also changes with the distance from the curve: the secant must be the longest step */
    const double longest_normal_step = fmax(run->step_before, report->last_step);
    const int has_secant =
        fabs(tangent_step) > 1e-7 && longest_normal_step < 0.1 * fabs(tangent_step);
    if (!has_secant) return BD_OK;

    const double secant = sense * (slope - run->slope_before) / tangent_step;
    const double kappa = sense * report->curvature;
    if (!(secant < 0.0)) {
        ++run->n_wrong_sense;
        if (run->n_wrong_sense > 1) return BD_NOT_CONVERGED;
    }
    /* kappa stays negative, and its size changes by a factor of 0.3 to 4 */
    report->curvature = sense * fmin(0.3 * kappa, fmax(4.0 * kappa, secant));
    if (fabs(slope) > 0.5 * fabs(run->slope_before)) ++run->n_stall;
    return BD_OK;
}

/* Take the Newton step and a secant step along the tangent, unless the point is reached. */
static bd_status advance_along(newton_run *run) {
    enum { MOST_STALLS = 4 };
    bd_solver_report *report = run->report;
    const bd_condition *condition = run->condition;
    const double *scale = run->scale;
    const size_t n = (size_t)run->equations->n;
    const double slope = bd_slope(condition, run->y, run->tangent, scale, n);
    const bd_status status = update_curvature(run, slope);
    if (status != BD_OK) return status;
    run->slope_before = slope;

    const int on_curve = report->residual <= run->options->tolerance;
    const int is_halved = report->last_step <= 0.5 * run->step_before;
    if (report->iterations > 1 && !on_curve && !is_halved) ++run->n_stall;
    if (run->n_stall > MOST_STALLS) return BD_NOT_CONVERGED;

    const double tangent_step = -slope / report->curvature;
    if (!isfinite(tangent_step)) return BD_NOT_CONVERGED;
    run->arrived = on_curve && fabs(tangent_step) <= condition->tolerance;
    if (run->arrived) {
        report->slope = slope;
        return BD_OK;
    }

    /* far from the curve, phi is not the slope of the curve */
    const int is_far = report->last_step > 0.3 * fabs(tangent_step);
    const double limited = fmax(-condition->max_step, fmin(condition->max_step, tangent_step));
    run->tangent_step = is_far ? 0.0 : limited;
    for (size_t j = 0; j <= n; ++j) {
        const double step = run->step[j] + run->tangent_step * run->tangent[j];
        run->y[j] += step * scale[j];
    }
    return BD_OK;
}

/* ---- iterations ---- */

/* Evaluate the equations at the latest point, unless its trial has done so, and decide whether to
 * continue from it. */
static bd_status begin_iteration(newton_run *run, int iteration) {
    enum { MANY_STEPS = 8 };
    bd_solver_report *report = run->report;
    if (!run->derived) {
        const bd_status status = bd_evaluate(run->equations, run->y, 1);
        if (status != BD_OK) return status;
    }
    run->derived = 0;
    run->residual_before = report->residual;
    report->residual = largest(run->equations);
    report->iterations = iteration;
    if (iteration == 0) run->first_residual = report->residual;
    const bd_status status = check_progress(run);
    if (status != BD_OK) return status;

    if (iteration > MANY_STEPS && report->residual > 0.5 * run->residual_before)
        run->linear_tolerance = fmax(TIGHTENING * run->linear_tolerance, TIGHTEST);
    return BD_OK;
}

/* After a last step shorter than the tolerance of steps: find the tangent by the factors of this
 * step, and the residual at its end. Set `arrived` if the residual is accepted. */
static bd_status finish_by_short_step(newton_run *run) {
    bd_solver_report *report = run->report;
    const double accepted = run->options->accepted_residual; /* 0: no limit */
    if (run->tangent) {
        const bd_status status = find_tangent(run);
        if (status != BD_OK) return status;
    }
    if (!run->derived) {
        const bd_status status = bd_evaluate(run->equations, run->y, 0);
        if (status != BD_OK) return status;
    }
    report->residual = largest(run->equations);
    run->arrived = accepted == 0.0 || report->residual <= accepted;
    if (run->arrived) ++report->iterations;
    return BD_OK;
}

/* Newton steps to a point of the curve until convergence, then its tangent. */
static bd_status iterate_to_curve(newton_run *run) {
    const bd_solver_options *options = run->options;
    const bd_solver_report *report = run->report;
    for (int i = 0; !run->arrived; ++i) {
        bd_status status = begin_iteration(run, i);
        if (status != BD_OK) return status;
        run->arrived = report->residual <= options->tolerance;
        if (run->arrived) return run->tangent ? find_step(run, TANGENT) : BD_OK;

        status = find_step(run, STEP);
        if (status != BD_OK) return status;
        advance_to_curve(run);
        if (options->accepted_residual > 0.0 && oscillates(run)) return BD_NOT_CONVERGED;

        const int is_short = report->last_step < options->step_tolerance;
        if (run->fraction == 1.0 && is_short) status = finish_by_short_step(run);
        if (status != BD_OK) return status;
    }
    return BD_OK;
}

/* A stationary point needs the Newton step and the tangent in every iteration. */
static bd_status iterate_to_stationary(newton_run *run) {
    for (int i = 0; !run->arrived; ++i) {
        bd_status status = begin_iteration(run, i);
        if (status == BD_OK) status = find_step(run, STEP | TANGENT);
        if (status == BD_OK) status = advance_along(run);
        if (status != BD_OK) return status;
    }
    return BD_OK;
}

/* Solve n equations for the point y (n + 1) by Newton's method, with one further condition: a linear
 * one (condition->row), or a stationary point of the amplitude or of the parameter along the curve.
 * The tangent (n + 1) of the curve is also found. The normal of the plane in which a step ends is the
 * row of the linear condition or, on the way to a stationary point, the latest tangent. */
bd_status bd_solve(bd_equations *equations, const bd_condition *condition,
                   const bd_solver_options *options, const double *scale, double *y,
                   double *tangent, bd_solver_report *report) {
    const int stationary = condition->kind == BD_STATIONARY;
    newton_run run = {
        .equations = equations,
        .condition = condition,
        .options = options,
        .y = y,
        .normal = stationary ? tangent : condition->row,
        .scale = scale,
        .tangent = tangent,
        .report = report,
        .linear_tolerance = STEP_TOLERANCE,
        .step = equations->scratch,
        .y_old = equations->scratch + equations->n + equations->k,
    };
    *report = (bd_solver_report){
        .residual = INFINITY,
        .factored.rank = equations->n + 1,
        .curvature = condition->curvature,
        .slope = NAN,
    };
    return stationary ? iterate_to_stationary(&run) : iterate_to_curve(&run);
}

/* ---- gradient ---- */

/* Fill a (n + 1) with the derivative of phi along the tangent, and row (n + 1) with the part
 * (a_y w) . t of its gradient. */
static void explicit_part(const bd_condition *condition, const double *scale, const double *y,
                          const double *tangent, size_t n, double *a, double *row) {
    const double *re = condition->re, *im = condition->im;
    memset(a, 0, sizeof(double) * (n + 1));
    memset(row, 0, sizeof(double) * (n + 1));
    if (!re) {
        a[n] = 1.0;
        return;
    }
    double x[2] = {0.0}, d[2] = {0.0}; /* real and imaginary part of x and of x' */
    for (size_t i = 0; i < n; ++i) {
        x[0] += re[i] * y[i];
        x[1] += im[i] * y[i];
        d[0] += re[i] * scale[i] * tangent[i];
        d[1] += im[i] * scale[i] * tangent[i];
    }
    const double square = fmax(x[0] * x[0] + x[1] * x[1], LEAST_SQUARE);
    const double phi = (x[0] * d[0] + x[1] * d[1]) / square;
    for (size_t i = 0; i < n; ++i) {
        const double of_numerator = (re[i] * d[0] + im[i] * d[1]) * scale[i] / square;
        a[i] = (re[i] * x[0] + im[i] * x[1]) * scale[i] / square;
        row[i] = of_numerator - 2.0 * phi * a[i];
    }
}

/* row -= factor nu^T [J C] diag(scale) at a point; product is work (n). */
static bd_status subtract_product(bd_equations *e, const double *scale, const double *y,
                                  const double *nu, double factor, double *product, double *row) {
    const size_t n = (size_t)e->n;
    bd_status status = bd_evaluate(e, y, 1);
    if (status == BD_OK) status = bd_product(e, 1, nu, product);
    if (status != BD_OK) return status;
    for (size_t j = 0; j < n; ++j) row[j] -= factor * product[j] * scale[j];
    for (size_t j = 0; j < n; ++j) row[n] -= factor * nu[j] * e->C[j] * scale[n];
    return BD_OK;
}

/* Gradient of the slope phi along the curve at y (n + 1), in units of scale (head of the file):
 *
 *     row . w = (a_y w) . t - nu . (D^2 R [t, w]),      B^T (nu, .) = a,
 *
 * with row (n + 1) and nu (n). B is [J C] with the tangent t below it. The second derivative is a
 * central difference of nu^T [J C] over steps of the given length along t. */
bd_status bd_gradient(bd_equations *e, const bd_condition *condition, const double *scale,
                      const double *y, const double *tangent, double step, double *row,
                      double *nu) {
    const size_t n = (size_t)e->n, n1 = n + 1;
    double *a = e->scratch, *y_shifted = a + n1, *product = y_shifted + n1;
    bd_status status = bd_evaluate(e, y, 1);
    if (status == BD_OK) status = bd_factor(e, &(bd_border){.row = tangent, .scale = scale});
    if (status != BD_OK) return status;

    /* B^T (nu, .) = a */
    explicit_part(condition, scale, y, tangent, n, a, row);
    status = bd_solve_transposed(e, a);
    if (status != BD_OK) return status;
    memcpy(nu, a, sizeof(double) * n);

    /* the change of nu^T [J C] along the tangent is a central difference */
    for (int side = -1; side <= 1; side += 2) {
        const double factor = side / (2.0 * step);
        for (size_t j = 0; j < n1; ++j) y_shifted[j] = y[j] + side * step * tangent[j] * scale[j];
        status = subtract_product(e, scale, y_shifted, nu, factor, product, row);
        if (status != BD_OK) return status;
    }
    return BD_OK;
}
