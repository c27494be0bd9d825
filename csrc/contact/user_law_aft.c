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
 * throughout) therefore stays constant, although 1 - A is singular.
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

/* Part of n numbers of a block of memory, which begins where the previous part ends. */
static double *next_part(double **memory, size_t n) {
    double *part = *memory;
    *memory += n;
    return part;
}

bd_status bd_user_create(bd_user_work *work, const bd_sampled_work *sampled, int n_state) {
    memset(work, 0, sizeof *work);
    const size_t n_coef = (size_t)bd_n_coef(sampled->n_harm);
    const size_t n_power = (size_t)bd_n_power(sampled->n_harm);
    const size_t n_time = (size_t)sampled->n_time;
    const size_t n = (size_t)n_state;
    const size_t n_col = n + 3 * n_coef;
    const size_t of_law = bd_point_law_work_size(n_state);
    /* at each sample: basis, motion (3), force (3), derivative of the force (3, 3), states */
    const size_t of_samples = n_time * (n_coef + 3 + 3 + 9 + n) + n_power;
    /* memory of the law before and after a step; start, scale and step; two matrices */
    const size_t of_state = 2 * (3 + n) + 3 * n + 2 * n * n;
    /* three derivatives of the state; derivatives of the forces at the samples and their sums */
    const size_t of_derivatives = 3 * n * n_col + 3 * (n_time + n_coef) * n_col;
    const size_t size = of_law + of_samples + of_state + of_derivatives + BD_KERNEL_PAD;
    work->memory = calloc(size, sizeof(double));
    if (!work->memory) return BD_NO_MEMORY;

    double *m = work->memory;
    work->derivatives = bd_point_law_derivatives_in(next_part(&m, of_law), n_state);
    work->basis = next_part(&m, n_time * n_coef);
    work->motion = next_part(&m, 3 * n_time);
    work->force = next_part(&m, 3 * n_time);
    work->states = next_part(&m, n_time * n);
    work->motion_force_derivative = next_part(&m, 9 * n_time);
    work->power_sum = next_part(&m, n_power);
    work->law_memory[0] = next_part(&m, 3 + n);
    work->law_memory[1] = next_part(&m, 3 + n);
    work->start = next_part(&m, n);
    work->state_scale = next_part(&m, n);
    work->step = next_part(&m, n);
    work->state_derivative = next_part(&m, n * n_col);
    work->motion_derivative = next_part(&m, n * n_col);
    work->next_derivative = next_part(&m, n * n_col);
    work->state_force_derivative = next_part(&m, 3 * n_time * n_col);
    work->derivative_coef = next_part(&m, 3 * n_coef * n_col);
    work->power = next_part(&m, n * n);
    work->square = next_part(&m, n * n);

    work->n_harm = sampled->n_harm;
    work->n_time = sampled->n_time;
    work->n_state = n_state;
    work->kernel = sampled->kernel;
    work->powers = sampled->power;
    for (size_t k = 0; k < n_time; ++k) {
        /* the powers of a sample begin 1, 1, cos, sin, ...; the basis has one 1 */
        const double *basis_at_sample = sampled->power + k * n_power + 1;
        memcpy(work->basis + k * n_coef, basis_at_sample, sizeof(double) * n_coef);
    }
    return BD_OK;
}

void bd_user_destroy(bd_user_work *work) {
    if (!work) return;
    free(work->memory);
    memset(work, 0, sizeof *work);
}

static void swap_parts(double **a, double **b) {
    double *former = *a;
    *a = *b;
    *b = former;
}

/* ---- sums of powers ---- */

/* out (n, m) += A (n, n) B (n, m). Rows of B and out are stride and stride_out numbers apart. */
static void add_times(const bd_user_work *work, size_t n, size_t m, const double *A,
                      const double *B, size_t stride, double *out, size_t stride_out) {
    work->kernel->add_product(n, m, n, 1.0, A, n, B, stride, out, stride_out);
}

/* Largest size of an entry of x (n, m); NaN stays. */
static double largest(size_t n, size_t m, size_t stride, const double *x) {
    double most = 0.0;
    for (size_t i = 0; i < n; ++i)
        for (size_t j = 0; j < m; ++j) {
            const double size = fabs(x[i * stride + j]);
            if (!(size <= most)) most = size;
        }
    return most;
}

/* Copy the first n columns of state_derivative, A = dP/ds, to work->power. */
static void copy_period_derivative(bd_user_work *work, size_t n, size_t n_col) {
    for (size_t i = 0; i < n; ++i)
        memcpy(work->power + i * n, work->state_derivative + i * n_col, sizeof(double) * n);
}

/* Replace A (n, n) by A^2; the arrays exchange their places. */
static void square_matrix(const bd_user_work *work, size_t n, double **A, double **square) {
    memset(*square, 0, sizeof(double) * n * n);
    add_times(work, n, n, *A, *A, n, *square, n);
    swap_parts(A, square);
}

/* Replace R (n, m) by (1 + A + A^2 + ...) R, where A is the first n columns of state_derivative.
 * Doubling: if R contains the terms up to A^(p-1), adding A^p R doubles their number, with p = 1, 2,
 * 4, ... next_derivative is overwritten. Return 0 if the sum diverges. */
static int sum_powers(bd_user_work *work, size_t n, size_t n_col, size_t m, double *R,
                      size_t stride) {
    copy_period_derivative(work, n, n_col);
    double *power = work->power, *square = work->square; /* power is A^p */
    double *more = work->next_derivative;                /* (n, m) A^p R */
    for (int k = 0; k < DOUBLINGS; ++k) {
        memset(more, 0, sizeof(double) * n * m);
        add_times(work, n, m, power, R, stride, more, m);
        const double added = largest(n, m, m, more);
        const double present = largest(n, m, stride, R);
        for (size_t i = 0; i < n; ++i)
            for (size_t j = 0; j < m; ++j) R[i * stride + j] += more[i * m + j];
        if (added <= 1e-16 * present) return 1;
        square_matrix(work, n, &power, &square);
    }
    return 0;
}

/* ---- one period ---- */

/* Law of a point with n states at sample k of the period. The derivatives have n_col columns: none,
 * n for the state at the start, or n + 3 n_coef for this state and the coefficients of the motion.
 */
typedef struct {
    const bd_point_law *point_law;
    size_t n, n_coef, n_col;
    int k;
} stage;

/* Basis (n_coef) at a sample; -1 is the last one. */
static const double *basis(const bd_user_work *work, int k) {
    const size_t sample = (size_t)(k >= 0 ? k : work->n_time - 1);
    return work->basis + sample * (size_t)bd_n_coef(work->n_harm);
}

/* Add the derivative of one entry of the state with respect to the coefficients of the motion to a
 * row (n_col). `by` (6) contains its derivatives with respect to the motion at the end and at the
 * start of the step. */
static void add_motion(const bd_user_work *work, const stage *at, const double *by, double *row) {
    const int without_motion = at->n_col <= at->n;
    if (without_motion) return;
    const double *now = basis(work, at->k);
    const double *last = basis(work, at->k - 1);
    for (size_t c = 0; c < 3; ++c) {
        const double by_now = by[c], by_last = by[3 + c];
        if (by_now == 0.0 && by_last == 0.0) continue;
        double *restrict to = row + at->n + c * at->n_coef;
        for (size_t j = 0; j < at->n_coef; ++j) to[j] += by_now * now[j] + by_last * last[j];
    }
}

static int is_diagonal(size_t n, const double *A) {
    for (size_t i = 0; i < n; ++i)
        for (size_t j = 0; j < n; ++j)
            if (i != j && A[i * n + j] != 0.0) return 0;
    return 1;
}

/* Advance the derivative S of the state over a step: S <- ss S + sx dx. The law gives derivatives
 * of the state after the step: ss (n, n) for the state before it, and sx (n, 6) for the motion at
 * both ends. dx is the derivative of this motion for its coefficients, the basis. */
static void advance_derivative(bd_user_work *work, const stage *at) {
    const size_t n = at->n, n_col = at->n_col;
    const double *ss = work->derivatives.ss, *sx = work->derivatives.sx;

    /* a diagonal ss changes the rows in place; constant states need no operation */
    if (is_diagonal(n, ss)) {
        for (size_t i = 0; i < n; ++i) {
            double *restrict row = work->state_derivative + i * n_col;
            const double factor = ss[i * n + i];
            if (factor != 1.0) {
                for (size_t c = 0; c < n_col; ++c) row[c] *= factor;
            }
            add_motion(work, at, sx + 6 * i, row);
        }
        return;
    }

    for (size_t i = 0; i < n; ++i) {
        double *restrict row = work->next_derivative + i * n_col;
        memset(row, 0, sizeof(double) * n_col);
        for (size_t j = 0; j < n; ++j) {
            const double factor = ss[i * n + j];
            if (factor == 0.0) continue;
            const double *restrict from = work->state_derivative + j * n_col;
            for (size_t c = 0; c < n_col; ++c) row[c] += factor * from[c];
        }
        add_motion(work, at, sx + 6 * i, row);
    }
    swap_parts(&work->state_derivative, &work->next_derivative);
}

/* Store the derivative of the forces at a sample: Fx (3, 3) with respect to the motion, and Fs S
 * through the state, where Fs (3, n) belongs to the state and S (n, n_col) is its derivative. */
static void store_force_derivative(bd_user_work *work, const stage *at) {
    const size_t n = at->n, n_col = at->n_col, n_time = (size_t)work->n_time;
    const double *Fx = work->derivatives.Fx, *Fs = work->derivatives.Fs;
    const size_t k = (size_t)at->k;
    for (size_t i = 0; i < 9; ++i) {
        work->motion_force_derivative[i * n_time + k] = Fx[i];
        work->has_motion_derivative[i] |= Fx[i] != 0.0;
    }
    for (size_t a = 0; a < 3; ++a) {
        double *restrict to = work->state_force_derivative + (3 * k + a) * n_col;
        int written = 0; /* whether the row contains a state already */
        for (size_t i = 0; i < n; ++i) {
            const double factor = Fs[a * n + i];
            const double *restrict from = work->state_derivative + i * n_col;
            if (factor == 0.0) continue;
            if (written)
                for (size_t c = 0; c < n_col; ++c) to[c] += factor * from[c];
            else
                for (size_t c = 0; c < n_col; ++c) to[c] = factor * from[c];
            written = 1;
        }
        if (!written) memset(to, 0, sizeof(double) * n_col);
        work->has_state_derivative[a] |= written;
    }
}

/* Begin a period: memory of the law, scale of the state, and derivatives at the start. */
static void start_period(bd_user_work *work, size_t n, size_t n_col) {
    const size_t n_time = (size_t)work->n_time;
    /* periodic motion: the last sample precedes the first */
    double *memory = work->law_memory[0];
    for (size_t d = 0; d < 3; ++d) memory[d] = work->motion[d * n_time + n_time - 1];
    memcpy(memory + 3, work->start, sizeof(double) * n);
    for (size_t i = 0; i < n; ++i) work->state_scale[i] = fabs(work->start[i]);
    const int has_derivatives = n_col > 0, by_motion = n_col > n;
    if (!has_derivatives) return;

    /* with respect to the state at the start it is 1; the columns of the motion continue */
    for (size_t i = 0; i < n; ++i)
        for (size_t j = 0; j < n; ++j) work->state_derivative[i * n_col + j] = i == j;
    if (!by_motion) return;

    /* keep the value at the start, S_0 */
    memcpy(work->motion_derivative, work->state_derivative, sizeof(double) * n * n_col);
    memset(work->has_motion_derivative, 0, sizeof work->has_motion_derivative);
    memset(work->has_state_derivative, 0, sizeof work->has_state_derivative);
}

/* Store the state after sample k; return whether it equals the stored one. */
static int store_state(bd_user_work *work, size_t n, size_t k, const double *state) {
    double *stored = work->states + n * k;
    int same = 1;
    for (size_t i = 0; i < n; ++i) {
        const double size = fabs(state[i]);
        same &= state[i] == stored[i];
        stored[i] = state[i];
        if (!(size <= work->state_scale[i])) work->state_scale[i] = size;
    }
    return same;
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
    const int is_first = work->n_period == 0;
    ++work->n_period;
    /* derivatives need the whole period */
    const int may_recur = !is_first && n_col == 0;
    start_period(work, n, n_col);

    int recurs = 0;
    for (at.k = 0; at.k < work->n_time && !recurs; ++at.k) {
        const size_t k = (size_t)at.k;
        const double *from = work->law_memory[0];
        double *to = work->law_memory[1];
        double x[3], F[3];
        for (size_t d = 0; d < 3; ++d) x[d] = work->motion[d * n_time + k];
        bd_point_law_step(point_law, x, from, to, F, n_col ? &work->derivatives : NULL);
        ++work->n_call;
        for (size_t d = 0; d < 3; ++d) work->force[d * n_time + k] = F[d];
        const int same = store_state(work, n, k, to + 3);
        recurs = may_recur && same;
        if (n_col) advance_derivative(work, &at);
        if (n_col > n) store_force_derivative(work, &at);
        swap_parts(&work->law_memory[0], &work->law_memory[1]);
    }
    return recurs;
}

/* ---- steady state ---- */

/* Largest entry of a change of the state relative to its largest value in the period. */
static double relative_change(const bd_user_work *work, size_t n, const double *change) {
    double most = 0.0;
    for (size_t i = 0; i < n; ++i) {
        const double scale = work->state_scale[i] > 0.0 ? work->state_scale[i] : 1.0;
        const double share = fabs(change[i]) / scale;
        if (!(share <= most)) most = share;
        if (isnan(most)) break;
    }
    return most;
}

/* Repeat periods from the given state until the state recurs; return 0 if it does not. With columns
 * of the motion, advance the derivative of the state. */
static int settle(bd_user_work *work, const bd_point_law *point_law, size_t n_x) {
    const size_t n = (size_t)point_law->n_state; /* columns by the state; n_x by the motion */
    memcpy(work->start, point_law->memory + 3, sizeof(double) * n);
    memset(work->state_derivative, 0, sizeof(double) * n * (n + n_x));
    work->n_period = 0;
    double last_length = INFINITY; /* of a Newton step; infinite after a free period */
    for (int period = 0; period < MOST_PERIODS; ++period) {
        const int newton = period >= FREE;
        const size_t columns_of_state = newton ? n : 0;
        const size_t n_col = n_x ? n + n_x : columns_of_state;
        const int recurs = integrate_period(work, point_law, n_col);
        if (recurs) return 1;

        const double *end = work->law_memory[0] + 3;
        for (size_t i = 0; i < n; ++i) work->step[i] = end[i] - work->start[i];
        double length = relative_change(work, n, work->step);
        if (length <= REPEATS) return 1;

        /* the state at the end of the period replaces the start, unless a Newton step is accepted */
        int accepted = 0;
        if (newton) {
            const int has_sum = sum_powers(work, n, n_col, 1, work->step, 1);
            length = relative_change(work, n, work->step);
            accepted = has_sum && length < 0.5 * last_length;
        }
        if (!accepted) {
            memcpy(work->start, end, sizeof(double) * n);
            last_length = INFINITY;
            continue;
        }
        for (size_t i = 0; i < n; ++i) work->start[i] = work->start[i] + work->step[i];
        last_length = length;
        if (length <= SETTLED) {
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
    copy_period_derivative(work, n, n_col);
    double *A = work->power, *square = work->square;
    for (int k = 0; k < FADES && largest(n, n, n, A) > FADED; ++k)
        square_matrix(work, n, &A, &square);
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

/* Block of the tangent: force a by motion c. */
static double *tangent_block(bd_response *out, size_t a, size_t c) {
    if (a == 2) return c == 2 ? out->dN : out->dNt[c];
    if (c == 2) return out->dTv[a];
    return c == a ? out->dT[a] : out->dTc[a];
}

/* Sum the derivative of the forces through the state over the period, with the basis. */
static void sum_state_derivatives(bd_user_work *work, size_t n, const double *of_steady_state) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_time = (size_t)work->n_time;
    const size_t n_x = 3 * n_coef, n_col = n + n_x;
    memset(work->derivative_coef, 0, sizeof(double) * n_coef * 3 * n_col);
    /* rows of forces after the last one that depends on the state are zero */
    size_t rows = 0;
    for (size_t a = 0; a < 3; ++a)
        if (work->has_state_derivative[a]) rows = a + 1;
    if (rows == 0) return;
    work->kernel->product(n_coef, rows * n_col, n_time, work->basis, work->state_force_derivative,
                          3 * n_col, work->derivative_coef, 3 * n_col);
    work->kernel->add_product(3 * n_coef, n_x, n, 1.0, work->derivative_coef, n_col,
                              of_steady_state, n_col, work->derivative_coef + n, n_col);
}

/* Write the tangent: derivatives of the force coefficients with respect to the motion coefficients,
 * directly and through the state. */
static void write_tangent(bd_user_work *work, size_t n, bd_response *out) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_time = (size_t)work->n_time;
    const size_t n_power = (size_t)bd_n_power(work->n_harm);
    const size_t n_x = 3 * n_coef, n_col = n + n_x;

    /* motion_derivative contains S_0, and then the derivative of the steady state minus S_0:
     * (1 + A + ...) (S_N - S_0), in the columns of the motion */
    const double *S_N = work->state_derivative;
    double *change = work->motion_derivative;
    for (size_t i = 0; i < n; ++i)
        for (size_t j = n; j < n_col; ++j)
            change[i * n_col + j] = S_N[i * n_col + j] - change[i * n_col + j];
    sum_powers(work, n, n_col, n_x, change + n, n_col);
    sum_state_derivatives(work, n, change + n);

    for (size_t a = 0; a < 3; ++a)
        for (size_t c = 0; c < 3; ++c) {
            /* direct factors of the motion */
            double *block = tangent_block(out, a, c);
            const double *factors = work->motion_force_derivative + (3 * a + c) * n_time;
            memset(work->power_sum, 0, sizeof(double) * n_power);
            if (work->has_motion_derivative[3 * a + c])
                work->kernel->multiply_transposed(n_time, n_power, work->powers, factors,
                                                  work->power_sum);
            bd_cycle_products(work->n_harm, work->power_sum, block);

            for (size_t i = 0; i < n_coef; ++i) {
                const double *restrict through_state =
                    work->derivative_coef + (3 * i + a) * n_col + n + c * n_coef;
                double *restrict row = block + i * n_coef;
                /* from a sum over the samples to a Fourier coefficient; the first is the mean */
                const double scale = (i == 0 ? 1.0 : 2.0) / (double)n_time;
                for (size_t j = 0; j < n_coef; ++j) row[j] = scale * (row[j] + through_state[j]);
            }
        }
}

/* Return the number of samples without any force (3, n_time). */
static int count_open(const double *force, size_t n_time) {
    const double *T1 = force, *T2 = force + n_time, *N = force + 2 * n_time;
    int n_open = 0;
    for (size_t k = 0; k < n_time; ++k) n_open += T1[k] == 0.0 && T2[k] == 0.0 && N[k] == 0.0;
    return n_open;
}

/* Force, tangent and shares of a point with a user law, for the motion x (3, n_coef). The law is
 * called at every sample until its states are periodic. Fourier coefficients of the force are sums
 * over the last period: 1/n_time for the mean and 2/n_time for the others. Samples are (3, n_time):
 * t1, t2 and closing. */
void bd_user_evaluate(const bd_element *element, const double *x, bd_response *out,
                      bd_status_share *share, bd_user_work *work) {
    const bd_point_law *point_law = element->point_law;
    const size_t n = (size_t)point_law->n_state, n_time = (size_t)work->n_time;
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm);
    const int tangent = out->dN != NULL;

    /* motion at the samples; the closing is zero when the surfaces touch */
    for (size_t d = 0; d < 3; ++d)
        work->kernel->multiply(n_time, n_coef, work->basis, x + d * n_coef,
                               work->motion + d * n_time);
    const double closing_at_rest = bd_static_closing(element->kn, element->n0);
    for (size_t k = 0; k < n_time; ++k) work->motion[2 * n_time + k] += closing_at_rest;

    work->n_call = 0;
    const int settled = settle(work, point_law, 0);
    if (tangent) differentiate(work, point_law);

    memset(out->F, 0, sizeof(double) * 3 * n_coef);
    for (size_t d = 0; d < 3; ++d) {
        double *F = out->F + d * n_coef;
        work->kernel->multiply_transposed(n_time, n_coef, work->basis, work->force + d * n_time, F);
        /* without a steady cycle there are no forces */
        for (size_t i = 0; i < n_coef; ++i) {
            const double scale = (i == 0 ? 1.0 : 2.0) / (double)n_time;
            F[i] = settled ? F[i] * scale : NAN;
        }
    }

    out->normal = BD_BLOCK_FULL;
    out->coupled = 1;
    out->with_tangential = 1;
    /* a user law does not tell stick from slip: all that is not open counts as slip */
    share->open = (double)count_open(work->force, n_time) / (double)n_time;
    for (int d = 0; d < 2; ++d) {
        out->tangential[d] = BD_BLOCK_FULL;
        out->with_normal[d] = 1;
        share->stick[d] = 0.0;
        share->slip[d] = 1.0 - share->open;
    }
    if (tangent) write_tangent(work, n, out);
}
