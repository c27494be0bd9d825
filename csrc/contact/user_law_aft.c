/* User laws (user_law.h), sampled, in their steady cycle.
 *
 * Let x_k be the motion at n_time equidistant instants. The state advances as
 * s_k = g(x_k, x_k-1, s_k-1), which defines the period map s_N = P(s_0). Periods start from the
 * given state and are repeated until the state recurs, or, without derivatives, until a period
 * agrees with the previous one. After FREE periods, Newton steps with A = dP/ds follow,
 *
 *     s_0 += (1 + A + A^2 + ...) (P(s_0) - s_0),
 *
 * unless the last step was more than half as long as the previous one. The sum is computed by
 * doubling, R += A^m R with m = 1, 2, 4, ... A state that no period changes (a slider that sticks
 * throughout) therefore stays constant, although 1
 * - A is singular.
 *
 * The derivative S = ds/dX with respect to the motion advances through the steady period from
 * S_0 = 0 to S_N. The derivative of the steady state is (1 + A + A^2 + ...) S_N. A state that
 * became constant during the transient depends on the motion through the whole transient. Periods
 * are then repeated from the given state together with S, which has the value S_0 before the steady
 * period. The steady state has the derivative S_0 + (1 + A + ...) (S_N - S_0). The forces
 * F = f(x, s) have dF = f_x dx + f_s ds. */
#include "contact/user_law_aft.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FREE = 3, MOST_PERIODS = 100, DOUBLINGS = 50, FADES = 10 };
/* change of the state relative to its largest value in the period */
static const double REPEATS = 1e-15;
static const double SETTLED = 1e-13; /* last Newton step, relative as above */
static const double FADED = 1e-3;    /* remainder of a change of the state after many periods */

bd_status bd_user_create(bd_user_work *work, const bd_sampled_work *sampled, int n_state) {
    memset(work, 0, sizeof *work);
    const size_t n_coef = (size_t)bd_n_coef(sampled->n_harm), k = (size_t)sampled->n_time,
                 n = (size_t)n_state;
    const size_t n_col = n + 3 * n_coef, n_power = (size_t)bd_n_power(sampled->n_harm);
    const size_t size = bd_point_law_work_size(n_state) + k * (n_coef + 15 + n) + n_power +
                        2 * (3 + n) + 3 * n + 3 * n * n_col + 3 * (k + n_coef) * n_col + 2 * n * n +
                        BD_KERNEL_PAD;
    if (!(work->memory = calloc(size, sizeof(double)))) return BD_NO_MEMORY;
    double *m = work->memory;
    work->derivatives = bd_point_law_derivatives_in(m, n_state),
    m += bd_point_law_work_size(n_state);
    work->basis = m, m += k * n_coef;
    work->motion = m, m += 3 * k;
    work->force = m, m += 3 * k;
    work->states = m, m += k * n;
    work->motion_force_derivative = m, m += 9 * k;
    work->power_sum = m, m += n_power;
    for (int i = 0; i < 2; ++i) work->law_memory[i] = m, m += 3 + n;
    work->start = m, m += n;
    work->state_scale = m, m += n;
    work->step = m, m += n;
    work->state_derivative = m, m += n * n_col;
    work->motion_derivative = m, m += n * n_col;
    work->next_derivative = m, m += n * n_col;
    work->state_force_derivative = m, m += 3 * k * n_col;
    work->derivative_coef = m, m += 3 * n_coef * n_col;
    work->power = m, m += n * n;
    work->square = m;
    work->n_harm = sampled->n_harm;
    work->n_time = sampled->n_time;
    work->n_state = n_state;
    work->kernel = sampled->kernel;
    work->powers = sampled->power;
    for (size_t i = 0; i < k; ++i)
        memcpy(work->basis + i * n_coef, sampled->power + i * (size_t)bd_n_power(work->n_harm) + 1,
               sizeof(double) * n_coef);
    return BD_OK;
}

void bd_user_destroy(bd_user_work *work) {
    if (!work) return;
    free(work->memory);
    memset(work, 0, sizeof *work);
}

/* ---- sums of powers ---- */

/* out (n, m) += A (n, n) B (n, m). */
static void add_times(const bd_user_work *work, size_t n, size_t m, const double *A,
                      const double *B, size_t stride, double *out, size_t stride_out) {
    work->kernel->add_product(n, m, n, 1.0, A, n, B, stride, out, stride_out);
}

static double largest(size_t n, size_t m, size_t stride, const double *x) {
    double most = 0.0;
    for (size_t i = 0; i < n; ++i)
        for (size_t j = 0; j < m; ++j)
            if (!(fabs(x[i * stride + j]) <= most)) most = fabs(x[i * stride + j]);
    return most;
}

/* Replace R (n, m) by (1 + A + A^2 + ...) R; A is the first n columns of state_derivative.
 * next_derivative is overwritten. Return 0 if the sum diverges. */
static int sum_powers(bd_user_work *work, size_t n, size_t n_col, size_t m, double *R,
                      size_t stride) {
    double *A = work->power, *square = work->square, *more = work->next_derivative;
    for (size_t i = 0; i < n; ++i)
        memcpy(A + i * n, work->state_derivative + i * n_col, sizeof(double) * n);
    for (int k = 0; k < DOUBLINGS; ++k) {
        memset(more, 0, sizeof(double) * n * m);
        add_times(work, n, m, A, R, stride, more, m);
        const double added = largest(n, m, m, more), present = largest(n, m, stride, R);
        for (size_t i = 0; i < n; ++i)
            for (size_t j = 0; j < m; ++j) R[i * stride + j] += more[i * m + j];
        if (added <= 1e-16 * present) return 1;
        memset(square, 0, sizeof(double) * n * n);
        add_times(work, n, n, A, A, n, square, n);
        double *swap = A;
        A = square, square = swap;
    }
    return 0;
}

/* ---- one period ---- */

/* Law of the point, number of columns of its derivatives (state, then motion),
 * and sample of the period. */
typedef struct {
    const bd_point_law *point_law;
    size_t n, n_coef, n_col;
    int k;
} stage;

static const double *basis(const bd_user_work *work, int k) {
    return work->basis + (size_t)(k >= 0 ? k : work->n_time - 1) * (size_t)bd_n_coef(work->n_harm);
}

/* Add the derivative of one entry of the state with respect to the motion at both ends of a step to
 * a row. */
static void add_motion(const bd_user_work *work, const stage *at, const double *by, double *row) {
    const double *now = basis(work, at->k), *last = basis(work, at->k - 1);
    for (size_t c = 0; c < 3 && at->n_col > at->n; ++c) {
        if (by[c] == 0.0 && by[3 + c] == 0.0) continue;
        double *restrict to = row + at->n + c * at->n_coef;
        for (size_t j = 0; j < at->n_coef; ++j) to[j] += by[c] * now[j] + by[3 + c] * last[j];
    }
}

static void advance_derivative(bd_user_work *work, const stage *at) {
    const size_t n = at->n, n_col = at->n_col;
    const double *ss = work->derivatives.ss, *sx = work->derivatives.sx;
    int diagonal = 1;
    for (size_t i = 0; i < n && diagonal; ++i)
        for (size_t j = 0; j < n; ++j) diagonal &= i == j || ss[i * n + j] == 0.0;
    /* a diagonal ss changes the rows in place; constant states need no operation */
    for (size_t i = 0; i < n; ++i) {
        double *restrict to =
            (diagonal ? work->state_derivative : work->next_derivative) + i * n_col;
        if (!diagonal) memset(to, 0, sizeof(double) * n_col);
        for (size_t j = 0; j < n && !diagonal; ++j) {
            const double a = ss[i * n + j], *restrict from = work->state_derivative + j * n_col;
            for (size_t c = 0; c < n_col && a != 0.0; ++c) to[c] += a * from[c];
        }
        const double point_law = ss[i * n + i];
        for (size_t c = 0; c < n_col && diagonal && point_law != 1.0; ++c) to[c] *= point_law;
        add_motion(work, at, sx + 6 * i, to);
    }
    if (diagonal) return;
    double *swap = work->state_derivative;
    work->state_derivative = work->next_derivative, work->next_derivative = swap;
}

/* Store the derivative of the forces at a sample: direct factors of the motion, and the part
 * through the state. */
static void store_force_derivative(bd_user_work *work, const stage *at) {
    const size_t n = at->n, n_col = at->n_col, n_time = (size_t)work->n_time;
    for (size_t i = 0; i < 9; ++i) {
        work->motion_force_derivative[i * n_time + (size_t)at->k] = work->derivatives.Fx[i];
        work->has_motion_derivative[i] |= work->derivatives.Fx[i] != 0.0;
    }
    for (size_t a = 0; a < 3; ++a) {
        double *restrict to = work->state_force_derivative + (3 * (size_t)at->k + a) * n_col;
        int written = 0;
        for (size_t i = 0; i < n; ++i) {
            const double f = work->derivatives.Fs[a * n + i], *restrict from =
                                                                  work->state_derivative +
                                                                  i * n_col;
            if (f == 0.0) continue;
            if (written)
                for (size_t c = 0; c < n_col; ++c) to[c] += f * from[c];
            else
                for (size_t c = 0; c < n_col; ++c) to[c] = f * from[c];
            written = 1;
        }
        if (!written) memset(to, 0, sizeof(double) * n_col);
        work->has_state_derivative[a] |= written;
    }
}

/* Integrate one period from the state `start` and store its forces. With columns, advance the
 * derivative of the state; with columns of the motion, also the derivative of the forces. Return 1
 * if a sample agrees with the previous period: the remainder of the period is then equal, and the
 * state is steady. */
static int integrate_period(bd_user_work *work, const bd_point_law *point_law, size_t n_col) {
    const size_t n = (size_t)point_law->n_state, n_time = (size_t)work->n_time;
    stage at = {.point_law = point_law,
                .n = n,
                .n_coef = (size_t)bd_n_coef(work->n_harm),
                .n_col = n_col};
    double *from = work->law_memory[0], *to = work->law_memory[1];
    for (size_t d = 0; d < 3; ++d) from[d] = work->motion[d * n_time + n_time - 1];
    memcpy(from + 3, work->start, sizeof(double) * n);
    for (size_t i = 0; i < n; ++i) work->state_scale[i] = fabs(work->start[i]);
    for (size_t i = 0; i < n && n_col; ++i)
        for (size_t j = 0; j < n; ++j) work->state_derivative[i * n_col + j] = i == j;
    if (n_col > n) {
        memcpy(work->motion_derivative, work->state_derivative, sizeof(double) * n * n_col);
        memset(work->has_motion_derivative, 0, sizeof work->has_motion_derivative);
        memset(work->has_state_derivative, 0, sizeof work->has_state_derivative);
    }
    const int first = work->n_period++ == 0;
    int recurs = 0;
    for (at.k = 0; at.k < work->n_time && !recurs; ++at.k) {
        double x[3], F[3], *path = work->states + n * (size_t)at.k;
        for (size_t d = 0; d < 3; ++d) x[d] = work->motion[d * n_time + (size_t)at.k];
        bd_point_law_step(point_law, x, from, to, F, n_col ? &work->derivatives : NULL);
        ++work->n_call;
        recurs = !first && !n_col;
        for (size_t i = 0; i < n; ++i) {
            const double s = to[3 + i];
            recurs &= s == path[i];
            path[i] = s;
            if (!(fabs(s) <= work->state_scale[i])) work->state_scale[i] = fabs(s);
        }
        for (size_t d = 0; d < 3; ++d) work->force[d * n_time + (size_t)at.k] = F[d];
        if (n_col) advance_derivative(work, &at);
        if (n_col > n) store_force_derivative(work, &at);
        double *swap = from;
        from = to, to = swap;
    }
    work->law_memory[0] = from, work->law_memory[1] = to;
    return recurs;
}

/* ---- steady state ---- */

/* Largest entry of a change of the state relative to its largest value in the period. */
static double relative_change(const bd_user_work *work, size_t n, const double *change) {
    double most = 0.0;
    for (size_t i = 0; i < n; ++i) {
        const double share =
            fabs(change[i]) / (work->state_scale[i] > 0.0 ? work->state_scale[i] : 1.0);
        if (!(share <= most)) most = share;
        if (isnan(most)) break;
    }
    return most;
}

/* Repeat periods from the given state until the state recurs; return 0 if it does not. With columns
 * of the motion, advance the derivative of the state. */
static int settle(bd_user_work *work, const bd_point_law *point_law, size_t n_x) {
    const size_t n = (size_t)point_law->n_state;
    double before = INFINITY;
    memcpy(work->start, point_law->memory + 3, sizeof(double) * n);
    memset(work->state_derivative, 0, sizeof(double) * n * (n + n_x));
    work->n_period = 0;
    for (int period = 0; period < MOST_PERIODS; ++period) {
        int newton = period >= FREE;
        const size_t n_col = n_x ? n + n_x : newton ? n : 0;
        const int recurs = integrate_period(work, point_law, n_col);
        const double *end = work->law_memory[0] + 3;
        if (recurs) return 1;
        for (size_t i = 0; i < n; ++i) work->step[i] = end[i] - work->start[i];
        double length = relative_change(work, n, work->step);
        if (length <= REPEATS) return 1;
        if (newton) {
            newton = sum_powers(work, n, n_col, 1, work->step, 1);
            length = relative_change(work, n, work->step);
        }
        const int steps = newton && length < 0.5 * before;
        before = steps ? length : INFINITY;
        for (size_t i = 0; i < n; ++i)
            work->start[i] = steps ? work->start[i] + work->step[i] : end[i];
        if (steps && length <= SETTLED) {
            integrate_period(work, point_law, n_x ? n + n_x : 0);
            return 1;
        }
    }
    return 0;
}

/* ---- force and tangent ---- */

/* Return whether a change of the state vanishes after many periods: a power of A
 * has no entry above FADED. */
static int decays(bd_user_work *work, size_t n, size_t n_col) {
    double *A = work->power, *square = work->square;
    for (size_t i = 0; i < n; ++i)
        memcpy(A + i * n, work->state_derivative + i * n_col, sizeof(double) * n);
    for (int k = 0; k < FADES && largest(n, n, n, A) > FADED; ++k) {
        memset(square, 0, sizeof(double) * n * n);
        add_times(work, n, n, A, A, n, square, n);
        double *swap = A;
        A = square, square = swap;
    }
    return largest(n, n, n, A) <= FADED;
}

/* Repeat the steady period with derivatives. If a constant state was reached in the transient,
 * repeat the transient for its derivative. */
static void differentiate(bd_user_work *work, const bd_point_law *point_law) {
    const size_t n = (size_t)point_law->n_state, n_x = 3 * (size_t)bd_n_coef(work->n_harm);
    const int has_moved = work->n_period > 1;
    memset(work->state_derivative, 0, sizeof(double) * n * (n + n_x));
    integrate_period(work, point_law, n + n_x);
    if (!has_moved || decays(work, n, n + n_x)) return;
    settle(work, point_law, n_x);
}

/* Derivative of the steady state minus its value at the start of the last
 * period, and the tangent. */
static void write_tangent(bd_user_work *work, size_t n, bd_response *out) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_x = 3 * n_coef, n_col = n + n_x,
                 n_time = (size_t)work->n_time;
    const size_t n_power = (size_t)bd_n_power(work->n_harm);
    /* change of the motion's derivative during the period */
    double *more = work->motion_derivative;
    for (size_t i = 0; i < n; ++i)
        for (size_t j = n; j < n_col; ++j)
            more[i * n_col + j] = work->state_derivative[i * n_col + j] - more[i * n_col + j];
    sum_powers(work, n, n_col, n_x, more + n, n_col);
    memset(work->derivative_coef, 0, sizeof(double) * n_coef * 3 * n_col);
    /* the other rows are zero */
    const size_t rows = work->has_state_derivative[2]   ? 3
                        : work->has_state_derivative[1] ? 2
                                                        : (size_t)work->has_state_derivative[0];
    if (rows > 0) {
        work->kernel->product(n_coef, rows * n_col, n_time, work->basis,
                              work->state_force_derivative, 3 * n_col, work->derivative_coef,
                              3 * n_col);
        work->kernel->add_product(3 * n_coef, n_x, n, 1.0, work->derivative_coef, n_col, more + n,
                                  n_col, work->derivative_coef + n, n_col);
    }
    for (size_t a = 0; a < 3; ++a)
        for (size_t c = 0; c < 3; ++c) {
            double *block = a == 2   ? (c == 2 ? out->dN : out->dNt[c])
                            : c == 2 ? out->dTv[a]
                            : c == a ? out->dT[a]
                                     : out->dTc[a];
            memset(work->power_sum, 0, sizeof(double) * n_power);
            if (work->has_motion_derivative[3 * a + c])
                work->kernel->multiply_transposed(n_time, n_power, work->powers,
                                                  work->motion_force_derivative +
                                                      (3 * a + c) * n_time,
                                                  work->power_sum);
            bd_cycle_products(work->n_harm, work->power_sum, block);
            for (size_t i = 0; i < n_coef; ++i) {
                const double *restrict row =
                    work->derivative_coef + (3 * i + a) * n_col + n + c * n_coef;
                const double scale = (i == 0 ? 1.0 : 2.0) / (double)n_time;
                for (size_t j = 0; j < n_coef; ++j)
                    block[i * n_coef + j] = scale * (block[i * n_coef + j] + row[j]);
            }
        }
}

void bd_user_evaluate(const bd_element *element, const double *x, bd_response *out,
                      bd_status_share *share, bd_user_work *work) {
    const bd_point_law *point_law = element->point_law;
    const size_t n = (size_t)point_law->n_state, n_coef = (size_t)bd_n_coef(work->n_harm),
                 n_time = (size_t)work->n_time;
    const int tangent = out->dN != NULL;
    for (size_t d = 0; d < 3; ++d)
        work->kernel->multiply(n_time, n_coef, work->basis, x + d * n_coef,
                               work->motion + d * n_time);
    for (size_t k = 0; k < n_time; ++k)
        work->motion[2 * n_time + k] += bd_static_closing(element->kn, element->n0);
    work->n_call = 0;
    const int settled = settle(work, point_law, 0);
    if (tangent) differentiate(work, point_law);
    const double *f = work->force;
    int n_open = 0;
    for (size_t k = 0; k < n_time; ++k)
        n_open += f[k] == 0.0 && f[n_time + k] == 0.0 && f[2 * n_time + k] == 0.0;
    memset(out->F, 0, sizeof(double) * 3 * n_coef);
    for (size_t d = 0; d < 3; ++d)
        work->kernel->multiply_transposed(n_time, n_coef, work->basis, f + d * n_time,
                                          out->F + d * n_coef);
    for (size_t i = 0; i < 3 * n_coef; ++i)
        out->F[i] = settled ? out->F[i] * ((i % n_coef == 0 ? 1.0 : 2.0) / (double)n_time) : NAN;
    out->tangential[0] = out->tangential[1] = out->normal = BD_BLOCK_FULL;
    out->coupled = out->with_normal[0] = out->with_normal[1] = out->with_tangential = 1;
    if (tangent) write_tangent(work, n, out);
    share->open = (double)n_open / (double)n_time;
    for (int d = 0; d < 2; ++d) share->stick[d] = 0.0, share->slip[d] = 1.0 - share->open;
}
