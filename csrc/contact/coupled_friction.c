/* In-plane coupled Coulomb friction with variable or constant normal load and separation.
 *
 * In newtons, p_d = kt_d u_d is the displacement and s_d = kt_d w_d the slider. The friction force
 * T = p - s lies in the disk |T| <= R, R = mu max(n0 + kn v, 0) (or mu load). The slider sticks if
 * T is inside the disk. If T is on the edge, the slider follows
 *
 *     s' = lambda T/R,   lambda = e . p' - R' >= 0,   e = T/R,   hence   e' = (I - e e^T) p'/R.
 *
 * In open contact s = p. For kt_1 = kt_2 this is slip along the friction force; for kt_1 != kt_2
 * the return to the disk is radial in the force.
 *
 * coupled_kernel.c advances the slider from sample to sample and yields the period map P with its
 * derivatives.
 *
 * Stick. A slider inside all disks of the cycle never moves. At the onset of slip it moves by
 * distances below rounding, and the limit of its derivative is used instead (sticking_slider.c).
 *
 * Steady cycle. The period map P does not expand distances, so F(s) = P(s) - s satisfies F(s).(s* -
 * (s + P(s))/2) >= 0 at its fixed point s*. The fixed point is unique: two sliders that move at a
 * constant distance from each other would have to touch their round disks at the same points. Plain
 * periods converge very slowly (thousands for an ellipse that barely slips). Newton's method with
 * the exact 2 x 2 derivative P' needs a few. It starts at the point of least violation, which is
 * near the steady slider if this barely slips. Each evaluation also excludes half of the region of
 * s*, stored as an ellipse. If Newton's method has no step or makes no progress, the centre of the
 * ellipse is the next guess; this converges from any start. If the slider barely moves, F is the
 * sum of its movements, which is more accurate than the difference of positions. The derivative of
 * the steady slider follows from (I - P') ds = P_x dx. */
#include "contact/coupled_friction.h"

#include "util/storage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Newton steps that need not shrink. */
enum { FREE_STEPS = 3 };

/* The ellipse is then smaller than rounding. */
enum { MOST_PERIODS = 1000 };

/* Last Newton step relative to the size of the forces. */
static const double SETTLED = 1e-13;

/* |P(s) - s| that counts as zero if Newton's method makes no progress. */
static const double STILL = 4e-15;

/* Violation of a disk by a sticking slider. */
static const double SLACK = 2e-15;

/* Least violations of the disks up to which the slider is the point of least violation, the
 * derivative is the limit at the onset of slip, and F is the sum of movements. */
static const double TOUCH = 1e-14;
static const double ONSET = 1e-9;
static const double BARELY = 1e-4;

bd_status bd_coulomb_create(bd_coulomb_work *work, const bd_sampled_work *sampled) {
    memset(work, 0, sizeof *work);
    const size_t lanes = BD_LANES;
    const size_t n_coef = (size_t)bd_n_coef(sampled->n_harm);
    const size_t n_power = (size_t)bd_n_power(sampled->n_harm);
    const size_t n_col = BD_N_COMPONENT * n_coef + 2; /* motion, and the slider at the start */
    const size_t n_sample = (size_t)sampled->n_time;
    const size_t n_padded = (n_sample + 7) / 8 * 8;
    /* x, y, R, g; quantities of a chord and of a step */
    const size_t per_sample = 4 + BD_N_CHORD + BD_N_STEP;
    const size_t of_samples = 4 * n_padded * lanes + per_sample * n_sample * lanes;
    const size_t of_coef = 3 * n_coef * lanes + n_coef + n_coef * n_coef + n_power;
    const size_t of_columns = 4 * n_col + 2 * n_coef * n_col;
    work->memory = malloc(sizeof(double) * (of_samples + of_coef + of_columns));
    work->segment = malloc(sizeof(bd_segment) * n_sample);
    work->lanes.step_kind = malloc(n_sample * lanes);
    if (!work->memory || !work->segment || !work->lanes.step_kind) {
        bd_coulomb_destroy(work);
        return BD_NO_MEMORY;
    }
    work->n_harm = sampled->n_harm;
    work->n_time = sampled->n_time;
    work->n_padded = (int)n_padded;
    work->kernel = sampled->kernel;
    work->power = sampled->power;
    work->lanes.n_time = sampled->n_time;
    work->lanes.interpolate = sampled->lanes.interpolate;

    double *rest = work->memory;
    work->point_samples = bd_take(&rest, 4 * n_padded * lanes);
    work->lanes.x = bd_take(&rest, n_sample * lanes);
    work->lanes.y = bd_take(&rest, n_sample * lanes);
    work->lanes.R = bd_take(&rest, n_sample * lanes);
    work->lanes.g = bd_take(&rest, n_sample * lanes);
    work->lanes.chord = bd_take(&rest, BD_N_CHORD * n_sample * lanes);
    work->lanes.step = bd_take(&rest, BD_N_STEP * n_sample * lanes);
    work->motion = bd_take(&rest, 3 * n_coef * lanes);
    work->slider_derivative = bd_take(&rest, 2 * n_col);
    work->next_slider = bd_take(&rest, 2 * n_col);
    work->slider_sums = bd_take(&rest, 2 * n_coef * n_col);
    work->stick_basis = bd_take(&rest, n_coef);
    work->products = bd_take(&rest, n_coef * n_coef);
    work->contact = bd_take(&rest, n_power);
    return BD_OK;
}

void bd_coulomb_destroy(bd_coulomb_work *work) {
    if (!work) return;
    free(work->memory);
    free(work->segment);
    free(work->lanes.step_kind);
    memset(work, 0, sizeof *work);
}

/* Factor from an integral over the period with basis function i to Fourier coefficient i: 1/(2 pi)
 * for the mean, 1/pi for cosines and sines. */
static double row_scale(size_t i) { return i == 0 ? 1.0 / BD_TWO_PI : 1.0 / BD_PI; }

/* Columns of the slider's derivative: n_coef for each of u1, u2 and v, then 2 for the slider at the
 * start of the period. */
static size_t n_motion_column(const bd_coulomb_work *work) {
    return BD_N_COMPONENT * (size_t)bd_n_coef(work->n_harm);
}
static size_t n_column(const bd_coulomb_work *work) { return n_motion_column(work) + 2; }

/* ---- the period map ---- */

/* Move the slider s (newtons) into the disk |p - s| <= R of the last sample, radially: p = (x, y)
 * is the displacement. At the start of a period no other slider is possible. */
static void make_admissible(const bd_coulomb_work *work, double *s) {
    const int last = work->n_time - 1;
    const double x = work->x[last], y = work->y[last], R = work->R[last];
    const double T[2] = {x - s[0], y - s[1]};
    const double size = bd_norm(T[0], T[1]);
    if (size <= R) return;
    s[0] = x - T[0] * R / size;
    s[1] = y - T[1] * R / size;
}

/* Replace the ellipse (x - c) . Q^-1 (x - c) <= 1 by the smallest ellipse around its part with
 * F . (x - m) >= 0 (ellipsoid method with a cut off the centre, in n = 2 dimensions). With the half
 * width |F|_Q = sqrt(F . Q F) and the unit vector b = Q F/|F|_Q, the cut is at the depth
 *
 *     delta = F . (m - c)/|F|_Q - noise,    0: through the centre, 1: touching the far side,
 *
 *     c <- c + tau b,                           tau   = (1 + n delta)/(n + 1)
 *     Q <- scale (Q - sigma b b^T),             sigma = 2 tau/(1 + delta)
 *                                               scale = n^2/(n^2 - 1) (1 - delta^2).
 *
 * A cut with delta <= -1/n reduces nothing. `noise` is the rounding error of F in half widths. */
static void cut_ellipse(bd_ellipse *e, const double *F, const double *m, double noise) {
    const double QF[2] = {
        e->Q[0][0] * F[0] + e->Q[0][1] * F[1],
        e->Q[1][0] * F[0] + e->Q[1][1] * F[1],
    };
    const double half_width = sqrt(F[0] * QF[0] + F[1] * QF[1]);
    const double delta = (F[0] * (m[0] - e->c[0]) + F[1] * (m[1] - e->c[1])) / half_width - noise;
    const int reduces = delta > -0.5 && delta < 0.999; /* a deeper cut is rounding */
    if (!reduces) return;

    const double tau = (1.0 + 2.0 * delta) / 3.0;
    const double sigma = 2.0 * tau / (1.0 + delta);
    const double scale = 4.0 / 3.0 * (1.0 - delta * delta);
    for (int i = 0; i < 2; ++i) {
        e->c[i] += tau * QF[i] / half_width;
        for (int j = 0; j < 2; ++j) {
            const double along = sigma * (QF[i] / half_width) * (QF[j] / half_width);
            e->Q[i][j] = scale * (e->Q[i][j] - along);
        }
    }

    /* positive definite and symmetric despite rounding */
    const double least = 1e-15 * (e->Q[0][0] + e->Q[1][1]);
    e->Q[0][0] += least;
    e->Q[1][1] += least;
    e->Q[1][0] = e->Q[0][1]; /* a difference would grow */
}

/* Begin at the point of least violation, with the disk of the last sample as region. */
static void start_search(bd_coulomb_work *work, const bd_disk_point *centre, double size,
                         bd_slider_search *search) {
    const int last = work->n_time - 1;
    const double radius = work->R[last];
    *search = (bd_slider_search){
        .state = BD_SEARCHING,
        .size = size,
        .centre = *centre,
        .s = {centre->s[0], centre->s[1]},
        .last_length = INFINITY,
        .ellipse.c = {work->x[last], work->y[last]},
        .ellipse.Q = {{radius * radius, 0.0}, {0.0, radius * radius}},
    };
    make_admissible(work, search->s);
}

/* Motion F = P(s) - s of the slider over the latest period of a lane, with the period map P: the
 * sum of its movements if it barely slips, otherwise the difference of its positions. */
static void period_motion(const bd_coupled_lanes *l, const bd_slider_search *search, int lane,
                          double F[2]) {
    /* end and start of a slider that barely slips are nearly equal, so their difference would lose
     * digits */
    const int barely_slips = search->centre.value < BARELY * search->size;
    for (int i = 0; i < 2; ++i) {
        const int at = i * BD_LANES + lane;
        F[i] = barely_slips ? l->net_motion[at] : l->end[at] - search->s[i];
    }
}

/* Derivative P' (2, 2) of the slider at the end of the latest period of a lane with respect to the
 * slider at its start. */
static void period_derivative(const bd_coupled_lanes *l, int lane, double dP[2][2]) {
    for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 2; ++j) dP[i][j] = l->period_derivative[(2 * i + j) * BD_LANES + lane];
    }
}

/* Improve the guess s of the steady slider, from the period of a lane that began at s and moved the
 * slider by F = P(s) - s:
 *
 *     Newton step        s <- s + (I - P')^-1 F
 *     otherwise          s <- centre of the ellipse that contains the steady slider.
 *
 * Newton's method needs a regular I - P', and steps that at least halve after the first ones. Every
 * period also cuts the ellipse: the steady slider satisfies F . (s* - (s + P(s))/2) >= 0. The
 * search settles if the motion, or the step, is rounding; it is lost after too many periods. */
static void next_guess(bd_coulomb_work *work, bd_slider_search *search, int lane) {
    const double size = search->size;
    double *s = search->s;
    double F[2], dP[2][2], step[2] = {0.0, 0.0};
    period_motion(&work->lanes, search, lane, F);
    period_derivative(&work->lanes, lane, dP);
    const double distance = bd_norm(F[0], F[1]);
    const int solved = bd_coulomb_solve_period(dP, F, step);
    const double length = solved ? bd_norm(step[0], step[1]) : INFINITY;
    const int shrinks = search->n_newton < FREE_STEPS || length < 0.5 * search->last_length;
    const int use_newton = solved && shrinks;

    const int is_still = distance <= STILL * size && !use_newton;
    if (distance == 0.0 || length <= SETTLED * size || is_still) {
        const double *last_step = use_newton ? step : F;
        for (int i = 0; i < 2; ++i) s[i] += last_step[i];
        make_admissible(work, s);
        search->state = BD_SETTLED;
        return;
    }
    ++search->n_period;
    if (search->n_period >= MOST_PERIODS) search->state = BD_LOST;

    const double middle[2] = {s[0] + 0.5 * F[0], s[1] + 0.5 * F[1]};
    cut_ellipse(&search->ellipse, F, middle, STILL * size / distance);
    if (use_newton) {
        search->last_length = length;
        ++search->n_newton;
        for (int i = 0; i < 2; ++i) s[i] = s[i] + step[i];
    } else {
        search->last_length = INFINITY;
        search->n_newton = 0;
        for (int i = 0; i < 2; ++i) s[i] = search->ellipse.c[i];
    }
    make_admissible(work, s);
}

/* Let x, y, R and g of the workspace be the samples (n_padded each) of one point: displacement in
 * newtons, friction limit and load. */
static void select_lane(bd_coulomb_work *work, int lane) {
    const size_t n = (size_t)work->n_padded;
    work->x = work->point_samples + 4 * n * (size_t)lane;
    work->y = work->x + n;
    work->R = work->y + n;
    work->g = work->R + n;
}

/* Start the next period of the n lanes at the latest guesses of their sliders; the others start at
 * zero. */
static void set_sliders(bd_coulomb_work *work, int n) {
    double *s = work->lanes.s;
    memset(s, 0, sizeof work->lanes.s);
    for (int lane = 0; lane < n; ++lane) {
        const bd_slider_search *search = work->search + lane;
        if (search->state == BD_DONE) continue;
        for (int i = 0; i < 2; ++i) s[i * BD_LANES + lane] = search->s[i];
    }
}

/* Return whether the steady slider of any of the n lanes is still sought. */
static int any_searching(const bd_coulomb_work *work, int n) {
    for (int lane = 0; lane < n; ++lane)
        if (work->search[lane].state == BD_SEARCHING) return 1;
    return 0;
}

/* Find the steady slider of the n lanes that slip: evaluate periods of all lanes together until
 * each search has ended. Return whether any lane slips. */
static int settle(bd_coulomb_work *work, int n, int with_tangent) {
    if (!any_searching(work, n)) return 0;
    work->kernel->coupled_chords(&work->lanes, with_tangent);
    while (any_searching(work, n)) {
        set_sliders(work, n);
        /* only the end of the period and its derivative: no steps are stored, no tangents */
        work->kernel->coupled_period(&work->lanes, 0, 0);
        for (int lane = 0; lane < n; ++lane) {
            if (work->search[lane].state != BD_SEARCHING) continue;
            select_lane(work, lane);
            next_guess(work, work->search + lane, lane);
        }
        ++work->n_period;
    }
    return 1;
}

/* ---- force and tangent over the steady period ---- */

/* Add the derivative S_d (n_col) of the slider in direction d, which is about to change, over the
 * samples since it was last set, with the sum B (n_coef) of the basis over these:
 *
 *     slider_sums_d (n_coef, n_col) += B S_d^T,    then B = 0. */
static void end_stick_part(bd_coulomb_work *work) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = n_column(work);
    for (size_t d = 0; d < 2; ++d) {
        const double *restrict derivative = work->slider_derivative + d * n_col;
        for (size_t i = 0; i < n_coef; ++i) {
            double *restrict sums = work->slider_sums + (d * n_coef + i) * n_col;
            const double basis_sum = work->stick_basis[i];
            for (size_t j = 0; j < n_col; ++j) sums[j] += basis_sum * derivative[j];
        }
    }
    memset(work->stick_basis, 0, sizeof(double) * n_coef);
}

/* to (n) += factor0 basis0 + factor1 basis1 */
static void add_samples(double *restrict to, size_t n, double factor0, const double *basis0,
                        double factor1, const double *basis1) {
    for (size_t j = 0; j < n; ++j) to[j] += factor0 * basis0[j] + factor1 * basis1[j];
}

/* Advance the derivative of the slider over the step of a lane from sample k - 1 (0) to sample k
 * (1), in which it moved:
 *
 *     ds_1 = A ds_0 + B0 dp_0 + B1 dp_1 + C0 dg_0 + C1 dg_1,    A, B0, B1 (2, 2),   C0, C1 (2).
 *
 * In terms of the coefficients, dp_d = kt_d b . du_d and dg = kn b . dv with the basis b (n_coef)
 * at either sample. The derivative is (2, n_col), with n_coef columns for each of u1, u2 and v. The
 * step stores each entry of A ... C1 for all samples and lanes. */
static void advance(bd_coulomb_work *work, const bd_element *element, int lane, int k) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = n_column(work);
    const size_t entry_size = (size_t)work->n_time * BD_LANES;
    const double *step = work->lanes.step + (size_t)k * BD_LANES + (size_t)lane;
    const double *A = step + BD_STEP_A * entry_size;
    const double *B0 = step + BD_STEP_B0 * entry_size, *B1 = step + BD_STEP_B1 * entry_size;
    const double *C0 = step + BD_STEP_C0 * entry_size, *C1 = step + BD_STEP_C1 * entry_size;
    const double *basis0 = bd_coulomb_basis(work, bd_coulomb_before(work, k));
    const double *basis1 = bd_coulomb_basis(work, k);
    const double kn = bd_law_is_constant(element->law) ? 0.0 : element->kn;
    const double *restrict ds0_first = work->slider_derivative;
    const double *restrict ds0_second = ds0_first + n_col;
    for (size_t d = 0; d < 2; ++d) {
        double *restrict ds1 = work->next_slider + d * n_col;
        const double A_first = A[2 * d * entry_size], A_second = A[(2 * d + 1) * entry_size];
        for (size_t j = 0; j < n_col; ++j)
            ds1[j] = A_first * ds0_first[j] + A_second * ds0_second[j];
        for (size_t c = 0; c < 2; ++c) {
            const double kt = element->kt[c];
            const size_t at = (2 * d + c) * entry_size; /* entry (d, c) */
            add_samples(ds1 + c * n_coef, n_coef, kt * B0[at], basis0, kt * B1[at], basis1);
        }
        if (!(kn > 0.0)) continue;
        const size_t at = d * entry_size;
        add_samples(ds1 + BD_NORMAL * n_coef, n_coef, kn * C0[at], basis0, kn * C1[at], basis1);
    }
    double *swap = work->slider_derivative;
    work->slider_derivative = work->next_slider;
    work->next_slider = swap;
}

/* Append sample k, from 2 pi k/n_time on, to the parts of the cycle; equal states are one part. */
static void push_sample(bd_coulomb_work *work, int k, int state) {
    const double h = BD_TWO_PI / work->n_time;
    const double start = k * h, end = (k + 1) * h;
    bd_segment *part = work->segment;
    const int n = work->n_segment;
    if (n > 0 && part[n - 1].state == state) {
        part[n - 1].end = end;
        return;
    }
    part[n] = (bd_segment){start, end, state};
    work->n_segment = n + 1;
}

/* Derivative (2, n_col) of the slider at the start of the period, after the last sample: I in the
 * columns of the slider at the start. In open contact s = p instead, so ds_d = kt_d b . du_d with
 * the basis b of the last sample. */
static void start_slider(bd_coulomb_work *work, const bd_element *element) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = n_column(work);
    const size_t of_start = n_motion_column(work); /* first column of the slider at the start */
    const int last = work->n_time - 1;
    const int is_open = !(work->g[last] > 0.0);
    const double *basis = bd_coulomb_basis(work, last);
    memset(work->slider_derivative, 0, sizeof(double) * 2 * n_col);
    for (size_t d = 0; d < 2; ++d) {
        double *row = work->slider_derivative + d * n_col;
        if (is_open) {
            for (size_t j = 0; j < n_coef; ++j) row[d * n_coef + j] = element->kt[d] * basis[j];
        } else {
            row[of_start + d] = 1.0;
        }
    }
}

/* State of a sample, from the kind of the step that ends there. */
static int state_of_step(int kind) {
    if (kind == BD_STEP_OPEN) return BD_OPEN;
    return kind == BD_STEP_SLIP ? BD_SLIP_PLUS : BD_STICK;
}

/* Sums over the steady period of a lane. The Fourier coefficients (n_coef) of the force T = p - s
 * are F_d = row_scale 2 pi/n_time sum_k T_d,k b_k with the basis b_k at sample k in contact, and
 * the shares count samples. With a tangent, the derivative of the slider is advanced from sample to
 * sample, and its products with the basis are added up; `contact` are the sums of the powers over
 * samples in contact. */
static void sum_period(bd_coulomb_work *work, const bd_element *element, int lane, int with_tangent,
                       bd_response *out, bd_status_share *share) {
    const int n_coef = bd_n_coef(work->n_harm), n_power = bd_n_power(work->n_harm);
    const int n_time = work->n_time;
    const size_t sums_size = 2 * (size_t)n_coef * n_column(work);
    const double weight = BD_TWO_PI / n_time;
    const double *step = work->lanes.step;
    const double *s[2] = {step, step + n_time * BD_LANES}; /* slider after each step */
    double *F[2] = {out->F, out->F + n_coef};
    int n_open = 0, n_stick = 0;
    memset(out->F, 0, sizeof(double) * 2 * (size_t)n_coef);
    memset(work->contact, 0, sizeof(double) * (size_t)n_power);
    work->n_segment = 0;
    if (with_tangent) {
        memset(work->slider_sums, 0, sizeof(double) * sums_size);
        memset(work->stick_basis, 0, sizeof(double) * (size_t)n_coef);
        start_slider(work, element);
    }
    for (int k = 0; k < n_time; ++k) {
        const int at = k * BD_LANES + lane;
        const int kind = work->lanes.step_kind[at];
        const int state = state_of_step(kind);
        if (with_tangent && kind != BD_STEP_STICK) {
            end_stick_part(work);
            advance(work, element, lane, k);
        }
        push_sample(work, k, state);
        if (state == BD_OPEN) {
            ++n_open;
            continue;
        }
        if (state == BD_STICK) ++n_stick;

        /* the row of powers begins one entry before its part that is the basis */
        const double *basis = bd_coulomb_basis(work, k), *power = basis - 1;
        const double T[2] = {work->x[k] - s[0][at], work->y[k] - s[1][at]};
        for (int d = 0; d < 2; ++d)
            for (int i = 0; i < n_coef; ++i) F[d][i] += weight * T[d] * basis[i];
        if (!with_tangent) continue;
        for (int i = 0; i < n_power; ++i) work->contact[i] += weight * power[i];
        for (int i = 0; i < n_coef; ++i) work->stick_basis[i] += weight * basis[i];
    }
    if (with_tangent) end_stick_part(work);

    const int n_slip = n_time - n_stick - n_open;
    for (int d = 0; d < 2; ++d) {
        for (int i = 0; i < n_coef; ++i) F[d][i] *= row_scale((size_t)i);
        share->stick[d] = (double)n_stick / n_time;
        share->slip[d] = (double)n_slip / n_time;
    }
}

/* Derivative ds (2, n_x) of the steady slider with respect to the motion (n_x = 3 n_coef columns):
 * (I - P') ds = P_x. P_x and P' are the columns of the motion and of the slider at the start in the
 * derivative of the slider at the end of the period. */
static void solve_slider_derivative(const bd_coulomb_work *work, double *ds) {
    const size_t n_x = n_motion_column(work), n_col = n_column(work);
    const double *row0 = work->slider_derivative, *row1 = row0 + n_col;
    const double dP[2][2] = {{row0[n_x], row0[n_x + 1]}, {row1[n_x], row1[n_x + 1]}};
    for (size_t j = 0; j < n_x; ++j) {
        const double b[2] = {row0[j], row1[j]};
        double y[2] = {0.0, 0.0}; /* a singular matrix leaves zero */
        bd_coulomb_solve_period(dP, b, y);
        ds[j] = y[0];
        ds[n_x + j] = y[1];
    }
}

/* Tangent blocks (n_coef, n_coef) of T_d = p_d - s_d for the motions c = u1, u2, v,
 *
 *     block_dc = row_scale (kt_d products if c = d, - S_dc - S_d,start ds_c),
 *
 * with the products of basis functions over samples in contact, the sums S_d (n_coef, n_col) of the
 * basis times the derivative of the slider, and the derivative ds (2, n_x) of the slider at the
 * start of the period. */
static void write_tangent(bd_coulomb_work *work, const bd_element *element, bd_response *out) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm);
    const size_t n_x = n_motion_column(work), n_col = n_column(work);
    double *ds = work->next_slider;
    solve_slider_derivative(work, ds);
    bd_cycle_products(work->n_harm, work->contact, work->products);
    for (size_t d = 0; d < 2; ++d) {
        double *block[BD_N_COMPONENT];
        block[BD_NORMAL] = out->dTv[d];
        block[d] = out->dT[d];
        block[1 - d] = out->dTc[d];
        for (size_t i = 0; i < n_coef; ++i) {
            const double *sums = work->slider_sums + (d * n_coef + i) * n_col;
            const double *products = work->products + i * n_coef;
            const double scale = row_scale(i);
            const double of_start[2] = {sums[n_x], sums[n_x + 1]};
            for (size_t c = 0; c < BD_N_COMPONENT; ++c) {
                for (size_t j = 0; j < n_coef; ++j) {
                    const size_t at = c * n_coef + j;
                    double value = -sums[at] - of_start[0] * ds[at] - of_start[1] * ds[n_x + at];
                    if (c == d) value += element->kt[d] * products[j];
                    block[c][i * n_coef + j] = scale * value;
                }
            }
        }
    }
}

/* Coefficients of p = kt u and of the load n0 + kn v (or the constant load) of one point, from its
 * motion x (3, n_coef), to its lane of work->motion (3, n_coef, BD_LANES). */
static void load_point(bd_coulomb_work *work, int lane, const bd_element *e, const double *x) {
    const int n_coef = bd_n_coef(work->n_harm);
    const int constant_load = bd_law_is_constant(e->law);
    const double factor[BD_N_COMPONENT] = {e->kt[0], e->kt[1], constant_load ? 0.0 : e->kn};
    const double load = constant_load ? e->load : e->n0;
    for (int a = 0; a < BD_N_COMPONENT; ++a) {
        double *to = work->motion + a * n_coef * BD_LANES + lane;
        for (int i = 0; i < n_coef; ++i) to[i * BD_LANES] = factor[a] * x[a * n_coef + i];
        if (a == BD_NORMAL) to[0] += load;
    }
}

/* Copy the samples of a lane to separate rows; padded disks are infinite. */
static void copy_lane(bd_coulomb_work *work, int lane) {
    const bd_coupled_lanes *l = &work->lanes;
    select_lane(work, lane);
    for (int k = 0; k < work->n_time; ++k) {
        const int at = k * BD_LANES + lane;
        work->x[k] = l->x[at];
        work->y[k] = l->y[at];
        work->R[k] = l->R[at];
        work->g[k] = l->g[at];
    }
    for (int k = work->n_time; k < work->n_padded; ++k) {
        work->x[k] = 0.0;
        work->y[k] = 0.0;
        work->R[k] = INFINITY;
    }
}

/* Motion and load of all points at the samples, in lanes and point by point. */
static void sample_motion(bd_coulomb_work *work, int n, const bd_element *element,
                          const double *x) {
    const int n_coef = bd_n_coef(work->n_harm), n_power = bd_n_power(work->n_harm);
    const int n_time = work->n_time;
    bd_coupled_lanes *l = &work->lanes;
    memset(work->motion, 0, sizeof(double) * 3 * (size_t)n_coef * BD_LANES);
    for (int lane = 0; lane < n; ++lane) {
        l->mu[lane] = element[lane].mu;
        if (work->search[lane].state == BD_DONE) continue;
        load_point(work, lane, element + lane, x + 3 * (size_t)n_coef * (size_t)lane);
    }

    double *value[BD_N_COMPONENT] = {l->x, l->y, l->g};
    for (int a = 0; a < BD_N_COMPONENT; ++a) {
        const double *coefficients = work->motion + a * n_coef * BD_LANES;
        work->kernel->lane_values(n_coef, n_time, work->power, n_power, coefficients, value[a]);
    }
    for (int i = 0; i < n_time * BD_LANES; ++i) {
        const double load = l->g[i] > 0.0 ? l->g[i] : 0.0;
        l->R[i] = l->mu[i % BD_LANES] * load;
    }
    for (int lane = 0; lane < n; ++lane)
        if (work->search[lane].state != BD_DONE) copy_lane(work, lane);
}

/* Size of the forces of the selected point: the largest extent of its motion or load. */
static double size_of_forces(const bd_coulomb_work *work) {
    double size = 0.0;
    for (int k = 0; k < work->n_time; ++k) {
        const double extent = fabs(work->x[k]) + fabs(work->y[k]);
        const double most = extent > work->R[k] ? extent : work->R[k];
        size = most > size ? most : size;
    }
    return size;
}

/* Decide how the slider of the selected point behaves. It must lie in the disks |p_k - s| <= R_k of
 * all samples to stick throughout. With the least violation phi of the disks and its point c:
 *
 *     open at all samples               no force
 *     initial slider in all disks       it sticks
 *     phi > 0                           it slips: start the search for the steady slider
 *     phi = 0 (within rounding)         it sticks at c, at the onset of slip
 *     phi < 0                           it sticks: moved from its initial position towards c into
 *                                       the last disk.
 *
 * A point that is open at any sample has phi = infinity: its slider follows the surface there. */
static void find_sticking(bd_coulomb_work *work, const bd_element *element, const double *x,
                          bd_response *out, bd_status_share *share, bd_slider_search *search) {
    const int with_tangent = out->dN != NULL;
    int n_open = 0;
    for (int k = 0; k < work->n_time; ++k) n_open += !(work->g[k] > 0.0);
    search->state = BD_DONE;
    if (n_open == work->n_time) {
        work->segment[0] = (bd_segment){0.0, BD_TWO_PI, BD_OPEN};
        work->n_segment = 1;
        return;
    }

    const double initial[2] = {element->kt[0] * element->w[0], element->kt[1] * element->w[1]};
    const double size = size_of_forces(work) + bd_norm(initial[0], initial[1]) + 1e-300;
    const bd_disks disks = {work->n_padded, work->x, work->y, work->R, work->kernel};
    bd_disk_point centre = {.s = {initial[0], initial[1]}, .value = INFINITY};
    int worst = 0;
    if (n_open == 0) {
        /* the initial slider is inside all disks */
        if (bd_disks_violation(&disks, initial, &worst) <= SLACK * size) {
            bd_sticking_write(work, element, x, initial, out, share);
            return;
        }
        bd_disks_centre(&disks, SLACK * size, &centre);
    }

    const int none_in_common = centre.value > TOUCH * size;
    if (none_in_common) {
        start_search(work, &centre, size, search);
        return;
    }
    const int one_in_common = centre.value >= -TOUCH * size;
    if (one_in_common) {
        bd_sticking_write(work, element, x, centre.s, out, share);
        if (with_tangent) bd_sticking_write_onset(work, element, &centre, out);
        return;
    }
    /* many points in common */
    const double fraction = bd_disks_entry(&disks, initial, centre.s, &worst);
    const double s[2] = {
        initial[0] + fraction * (centre.s[0] - initial[0]),
        initial[1] + fraction * (centre.s[1] - initial[1]),
    };
    bd_sticking_write(work, element, x, s, out, share);
    if (with_tangent)
        bd_sticking_write_shifted(work, element, initial, &centre, fraction, worst, out);
}

/* Force and tangent of a point whose steady slider was searched; NaN if the search has failed. If
 * the least violation of its disks is small, the point barely slips, and the limit at the onset of
 * slip replaces the derivative. */
static void finish(bd_coulomb_work *work, const bd_element *element, int lane, bd_response *out,
                   bd_status_share *share) {
    const bd_slider_search *search = work->search + lane;
    if (search->state == BD_LOST) {
        for (int i = 0; i < 2 * bd_n_coef(work->n_harm); ++i) out->F[i] = NAN;
        out->tangential[0] = out->tangential[1] = BD_BLOCK_LINEAR;
        return;
    }
    const int with_tangent = out->dN != NULL;
    const int is_onset = search->centre.value <= ONSET * search->size;
    sum_period(work, element, lane, with_tangent && !is_onset, out, share);
    for (int d = 0; d < 2; ++d) {
        out->tangential[d] = BD_BLOCK_FULL;
        out->with_normal[d] = !bd_law_is_constant(element->law);
    }
    out->coupled = 1;
    if (!with_tangent) return;
    if (is_onset)
        bd_sticking_write_onset(work, element, &search->centre, out);
    else
        write_tangent(work, element, out);
}

/* Samples of the motion; sliders that stick; search for the steady sliders of the other points; and
 * a last period of these with the steps stored, from which force and tangent follow. */
void bd_coulomb_evaluate(int n, const bd_element *element, const double *x, bd_response *out,
                         bd_status_share *share, bd_coulomb_work *work) {
    const size_t n_x = n_motion_column(work);
    const int with_tangent = out->dN != NULL;
    int any_friction = 0;
    work->n_segment = 0;
    work->n_period = 0;
    for (int lane = 0; lane < n; ++lane) {
        const bd_element *e = element + lane;
        const int in_a_direction = bd_element_has_friction(e, 0) || bd_element_has_friction(e, 1);
        const int has_friction = bd_law_is_coupled(e->law) && in_a_direction;
        work->search[lane].state = has_friction ? BD_SEARCHING : BD_DONE;
        any_friction |= has_friction;
    }
    if (!any_friction) return;

    sample_motion(work, n, element, x);
    for (int lane = 0; lane < n; ++lane) {
        if (work->search[lane].state == BD_DONE) continue;
        const double *x_point = x + n_x * (size_t)lane;
        select_lane(work, lane);
        find_sticking(work, element + lane, x_point, out + lane, share + lane, work->search + lane);
    }
    const int any_slip = settle(work, n, with_tangent);
    if (!any_slip) return;

    set_sliders(work, n);
    work->kernel->coupled_period(&work->lanes, 1, with_tangent);
    for (int lane = 0; lane < n; ++lane) {
        if (work->search[lane].state == BD_DONE) continue;
        select_lane(work, lane);
        finish(work, element + lane, lane, out + lane, share + lane);
    }
}
