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

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FREE_STEPS = 3, MOST_PERIODS = 1000 }; /* the ellipse is then smaller than rounding */
/* last Newton step relative to the size of the forces */
static const double SETTLED = 1e-13;
/* |P(s) - s| that counts as zero if Newton's method makes no progress */
static const double STILL = 4e-15;
static const double SLACK = 2e-15; /* violation of a disk by a sticking slider */
/* least violation up to which the slider is the point of least violation */
static const double TOUCH = 1e-14;
/* least violation up to which F is the sum of movements */
static const double BARELY = 1e-4;
/* least violation up to which the derivative is the limit at the onset of slip */
static const double ONSET = 1e-9;

bd_status bd_coulomb_create(bd_coulomb_work *work, const bd_sampled_work *sampled) {
    memset(work, 0, sizeof *work);
    const size_t n_coef = (size_t)bd_n_coef(sampled->n_harm), k = (size_t)sampled->n_time,
                 n_col = 3 * n_coef + 2;
    const size_t n_power = (size_t)bd_n_power(sampled->n_harm), padded = (k + 7) / 8 * 8,
                 lanes = BD_LANES;
    const size_t n_double = 4 * padded * lanes + 29 * k * lanes + 3 * n_coef * lanes + 4 * n_col +
                            2 * n_coef * n_col + n_coef + n_coef * n_coef + n_power;
    work->memory = malloc(sizeof(double) * n_double);
    work->segment = malloc(sizeof(bd_segment) * k);
    work->lanes.step_kind = malloc(k * lanes);
    if (!work->memory || !work->segment || !work->lanes.step_kind) {
        bd_coulomb_destroy(work);
        return BD_NO_MEMORY;
    }
    work->n_harm = sampled->n_harm;
    work->n_time = sampled->n_time;
    work->n_padded = (int)padded;
    work->kernel = sampled->kernel;
    work->power = sampled->power;
    work->lanes.n_time = sampled->n_time;
    work->lanes.interpolate = sampled->lanes.interpolate;
    double *m = work->memory;
    work->point_samples = m, m += 4 * padded * lanes;
    work->lanes.x = m, m += k * lanes;
    work->lanes.y = m, m += k * lanes;
    work->lanes.R = m, m += k * lanes;
    work->lanes.g = m, m += k * lanes;
    work->lanes.chord = m, m += 7 * k * lanes;
    work->lanes.step = m, m += 18 * k * lanes;
    work->motion = m, m += 3 * n_coef * lanes;
    work->slider_derivative = m, m += 2 * n_col;
    work->next_slider = m, m += 2 * n_col;
    work->slider_sums = m, m += 2 * n_coef * n_col;
    work->stick_basis = m, m += n_coef;
    work->products = m, m += n_coef * n_coef;
    work->contact = m;
    return BD_OK;
}

void bd_coulomb_destroy(bd_coulomb_work *work) {
    if (!work) return;
    free(work->memory);
    free(work->segment);
    free(work->lanes.step_kind);
    memset(work, 0, sizeof *work);
}

/* ---- the period map ---- */

/* Move the slider into the disk of the last sample of the previous period. */
static void make_admissible(const bd_coulomb_work *work, double *s) {
    const int k = work->n_time - 1;
    const double T[2] = {work->x[k] - s[0], work->y[k] - s[1]}, size = bd_norm(T[0], T[1]);
    if (size <= work->R[k]) return;
    s[0] = work->x[k] - T[0] * work->R[k] / size;
    s[1] = work->y[k] - T[1] * work->R[k] / size;
}

/* Smallest ellipse around the part of e with F . (x - m) >= 0, with a tolerance
 * `noise` relative to F. */
static void cut_ellipse(bd_ellipse *e, const double *F, const double *m, double noise) {
    const double g[2] = {e->Q[0][0] * F[0] + e->Q[0][1] * F[1],
                         e->Q[1][0] * F[0] + e->Q[1][1] * F[1]};
    const double width = sqrt(F[0] * g[0] + F[1] * g[1]);
    const double depth = (F[0] * (m[0] - e->c[0]) + F[1] * (m[1] - e->c[1])) / width - noise;
    if (!(depth > -0.5 && depth < 0.999)) return; /* no reduction, or rounding */
    const double move = (1.0 + 2.0 * depth) / 3.0, less = 2.0 * move / (1.0 + depth),
                 size = 4.0 / 3.0 * (1.0 - depth * depth);
    for (int i = 0; i < 2; ++i) {
        e->c[i] += move * g[i] / width;
        for (int j = 0; j < 2; ++j)
            e->Q[i][j] = size * (e->Q[i][j] - less * (g[i] / width) * (g[j] / width));
    }
    const double least = 1e-15 * (e->Q[0][0] + e->Q[1][1]); /* positive definite despite rounding */
    e->Q[0][0] += least;
    e->Q[1][1] += least;
    e->Q[1][0] = e->Q[0][1]; /* a difference would grow */
}

static void start_search(bd_coulomb_work *work, const bd_disk_point *centre, double size,
                         bd_slider_search *search) {
    const int last = work->n_time - 1;
    const double radius2 = work->R[last] * work->R[last];
    *search = (bd_slider_search){.state = BD_SEARCHING,
                                 .size = size,
                                 .centre = *centre,
                                 .s = {centre->s[0], centre->s[1]},
                                 .last_length = INFINITY,
                                 .ellipse = {{work->x[last], work->y[last]},
                                             {{radius2, 0.0}, {0.0, radius2}}}};
    make_admissible(work, search->s);
}

/* Next guess, from the period of a lane that began at the latest guess. */
static void next_guess(bd_coulomb_work *work, bd_slider_search *search, int lane) {
    const bd_coupled_lanes *l = &work->lanes;
    const double size = search->size,
                 *from = search->centre.value < BARELY * size ? l->net_motion : l->end;
    double F[2], dP[2][2], step[2] = {0.0, 0.0}, *s = search->s;
    for (int i = 0; i < 2; ++i) {
        F[i] = from[i * BD_LANES + lane] - (from == l->end ? s[i] : 0.0);
        for (int j = 0; j < 2; ++j) dP[i][j] = l->period_derivative[(2 * i + j) * BD_LANES + lane];
    }
    const double far = bd_norm(F[0], F[1]);
    const int solved = bd_coulomb_solve_period(dP, F, step);
    const double length = solved ? bd_norm(step[0], step[1]) : INFINITY;
    const int closer =
        solved && (search->n_newton < FREE_STEPS || length < 0.5 * search->last_length);
    if (far == 0.0 || length <= SETTLED * size || (far <= STILL * size && !closer)) {
        for (int i = 0; i < 2; ++i) s[i] += closer ? step[i] : F[i];
        make_admissible(work, s);
        search->state = BD_SETTLED;
        return;
    }
    if (++search->n_period >= MOST_PERIODS) search->state = BD_LOST;
    const double middle[2] = {s[0] + 0.5 * F[0], s[1] + 0.5 * F[1]};
    cut_ellipse(&search->ellipse, F, middle, STILL * size / far);
    if (closer) {
        search->last_length = length;
        ++search->n_newton;
    } else {
        search->last_length = INFINITY;
        search->n_newton = 0;
    }
    for (int i = 0; i < 2; ++i) s[i] = search->n_newton > 0 ? s[i] + step[i] : search->ellipse.c[i];
    make_admissible(work, s);
}

static void select_lane(bd_coulomb_work *work, int lane) {
    const size_t n = (size_t)work->n_padded;
    work->x = work->point_samples + 4 * n * (size_t)lane;
    work->y = work->x + n;
    work->R = work->y + n;
    work->g = work->R + n;
}

static void set_sliders(bd_coulomb_work *work, int n) {
    memset(work->lanes.s, 0, sizeof work->lanes.s);
    for (int lane = 0; lane < n; ++lane)
        for (int i = 0; i < 2; ++i)
            if (work->search[lane].state != BD_DONE)
                work->lanes.s[i * BD_LANES + lane] = work->search[lane].s[i];
}

/* Find the steady slider of all lanes that slip; return whether there are any. */
static int settle(bd_coulomb_work *work, int n, int tangent) {
    int any = 0;
    for (int searching = 1; searching;) {
        searching = 0;
        for (int lane = 0; lane < n; ++lane) searching |= work->search[lane].state == BD_SEARCHING;
        if (!searching) break;
        if (!any) work->kernel->coupled_chords(&work->lanes, tangent);
        any = 1;
        set_sliders(work, n);
        work->kernel->coupled_period(&work->lanes, 0, 0);
        for (int lane = 0; lane < n; ++lane) {
            if (work->search[lane].state != BD_SEARCHING) continue;
            select_lane(work, lane);
            next_guess(work, work->search + lane, lane);
        }
        ++work->n_period;
    }
    return any;
}

/* ---- force and tangent over the steady period ---- */

static void end_stick_part(bd_coulomb_work *work) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = 3 * n_coef + 2;
    for (size_t d = 0; d < 2; ++d)
        for (size_t i = 0; i < n_coef; ++i) {
            double *restrict to = work->slider_sums + (d * n_coef + i) * n_col;
            const double *restrict from = work->slider_derivative + d * n_col,
                                   g = work->stick_basis[i];
            for (size_t j = 0; j < n_col; ++j) to[j] += g * from[j];
        }
    memset(work->stick_basis, 0, sizeof(double) * n_coef);
}

/* Derivative of the slider through the step of a lane to sample k, in which it moved. */
static void advance(bd_coulomb_work *work, const bd_element *element, int lane, int k) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = 3 * n_coef + 2;
    const size_t stride = (size_t)work->n_time * BD_LANES;
    const double *A = work->lanes.step + 2 * stride + (size_t)k * BD_LANES + (size_t)lane,
                 *B0 = A + 4 * stride;
    const double *B1 = A + 8 * stride, *C = A + 12 * stride,
                 *b0 = bd_coulomb_basis(work, bd_coulomb_before(work, k)),
                 *b1 = bd_coulomb_basis(work, k);
    const double kn = bd_law_is_constant(element->law) ? 0.0 : element->kn;
    for (size_t d = 0; d < 2; ++d) {
        double *restrict to = work->next_slider + d * n_col;
        const double *restrict s0 = work->slider_derivative, *restrict s1 =
                                                                 work->slider_derivative + n_col;
        const double A0 = A[2 * d * stride], A1 = A[(2 * d + 1) * stride];
        for (size_t j = 0; j < n_col; ++j) to[j] = A0 * s0[j] + A1 * s1[j];
        for (size_t c = 0; c < 2; ++c) {
            const double kt = element->kt[c], f0 = kt * B0[(2 * d + c) * stride],
                         f1 = kt * B1[(2 * d + c) * stride];
            for (size_t j = 0; j < n_coef; ++j) to[c * n_coef + j] += f0 * b0[j] + f1 * b1[j];
        }
        const double f0 = kn * C[d * stride], f1 = kn * C[(2 + d) * stride];
        for (size_t j = 0; j < n_coef && kn > 0.0; ++j)
            to[2 * n_coef + j] += f0 * b0[j] + f1 * b1[j];
    }
    double *swap = work->slider_derivative;
    work->slider_derivative = work->next_slider;
    work->next_slider = swap;
}

static void push_sample(bd_coulomb_work *work, int k, int state) {
    const double h = BD_TWO_PI / work->n_time;
    if (work->n_segment > 0 && work->segment[work->n_segment - 1].state == state)
        work->segment[work->n_segment - 1].end = (k + 1) * h;
    else
        work->segment[work->n_segment++] = (bd_segment){k * h, (k + 1) * h, state};
}

/* Start of the period: derivative of the slider with respect to itself, or of p in open contact. */
static void start_slider(bd_coulomb_work *work, const bd_element *element) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = 3 * n_coef + 2;
    const int last = work->n_time - 1, open = !(work->g[last] > 0.0);
    memset(work->slider_derivative, 0, sizeof(double) * 2 * n_col);
    for (size_t d = 0; d < 2; ++d) {
        if (!open) work->slider_derivative[d * n_col + 3 * n_coef + d] = 1.0;
        for (size_t j = 0; open && j < n_coef; ++j)
            work->slider_derivative[d * n_col + d * n_coef + j] =
                element->kt[d] * bd_coulomb_basis(work, last)[j];
    }
}

/* Sums of the force, and of the slider's derivative with a tangent, over the
 * steady period of a lane. */
static void sum_period(bd_coulomb_work *work, const bd_element *element, int lane, int tangent,
                       bd_response *out, bd_status_share *share) {
    const int n_coef = bd_n_coef(work->n_harm), n_power = bd_n_power(work->n_harm),
              n_time = work->n_time;
    const double weight = BD_TWO_PI / n_time, *s = work->lanes.step;
    double *F[2] = {out->F, out->F + n_coef};
    int n_open = 0, n_stick = 0;
    memset(out->F, 0, sizeof(double) * 2 * (size_t)n_coef);
    memset(work->contact, 0, sizeof(double) * (size_t)n_power);
    work->n_segment = 0;
    if (tangent) {
        memset(work->slider_sums, 0, sizeof(double) * 2 * (size_t)(n_coef * (3 * n_coef + 2)));
        memset(work->stick_basis, 0, sizeof(double) * (size_t)n_coef);
        start_slider(work, element);
    }
    for (int k = 0; k < n_time; ++k) {
        const int at = k * BD_LANES + lane, kind = work->lanes.step_kind[at];
        if (tangent && kind != BD_STEP_STICK) {
            end_stick_part(work);
            advance(work, element, lane, k);
        }
        push_sample(work, k,
                    kind == BD_STEP_OPEN   ? BD_OPEN
                    : kind == BD_STEP_SLIP ? BD_SLIP_PLUS
                                           : BD_STICK);
        n_stick += kind == BD_STEP_STICK || kind == BD_STEP_CLOSE;
        if (kind == BD_STEP_OPEN) {
            ++n_open;
            continue;
        }
        const double *b = bd_coulomb_basis(work, k), *power = b - 1;
        const double T[2] = {work->x[k] - s[at], work->y[k] - s[n_time * BD_LANES + at]};
        for (int d = 0; d < 2; ++d)
            for (int i = 0; i < n_coef; ++i) F[d][i] += weight * T[d] * b[i];
        for (int i = 0; tangent && i < n_power; ++i) work->contact[i] += weight * power[i];
        for (int i = 0; tangent && i < n_coef; ++i) work->stick_basis[i] += weight * b[i];
    }
    if (tangent) end_stick_part(work);
    for (int d = 0; d < 2; ++d) {
        for (int i = 0; i < n_coef; ++i) F[d][i] *= i == 0 ? 1.0 / BD_TWO_PI : 1.0 / BD_PI;
        share->stick[d] = (double)n_stick / n_time;
        share->slip[d] = (double)(n_time - n_stick - n_open) / n_time;
    }
}

/* Blocks of the tangent from the sums; ds0 (2, 3 n_coef) is the derivative of the steady slider. */
static void write_tangent(bd_coulomb_work *work, const bd_element *element, bd_response *out) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_x = 3 * n_coef, n_col = n_x + 2;
    double *ds0 = work->next_slider;
    const double dP[2][2] = {{work->slider_derivative[n_x], work->slider_derivative[n_x + 1]},
                             {work->slider_derivative[n_col + n_x],
                              work->slider_derivative[n_col + n_x + 1]}};
    for (size_t j = 0; j < n_x; ++j) {
        const double b[2] = {work->slider_derivative[j], work->slider_derivative[n_col + j]};
        double y[2];
        const int solved = bd_coulomb_solve_period(dP, b, y);
        ds0[j] = solved ? y[0] : 0.0;
        ds0[n_x + j] = solved ? y[1] : 0.0;
    }
    bd_cycle_products(work->n_harm, work->contact, work->products);
    for (size_t d = 0; d < 2; ++d)
        for (size_t i = 0; i < n_coef; ++i) {
            const double *sums = work->slider_sums + (d * n_coef + i) * n_col,
                         scale = i == 0 ? 1.0 / BD_TWO_PI : 1.0 / BD_PI;
            const double h0 = sums[n_x], h1 = sums[n_x + 1];
            for (size_t c = 0; c < 3; ++c) {
                double *row = (c == 2   ? out->dTv[d]
                               : c == d ? out->dT[d]
                                        : out->dTc[d]) +
                              i * n_coef;
                for (size_t j = 0; j < n_coef; ++j) {
                    const size_t at = c * n_coef + j;
                    double value = -sums[at] - h0 * ds0[at] - h1 * ds0[n_x + at];
                    if (c == d) value += element->kt[d] * work->products[i * n_coef + j];
                    row[j] = scale * value;
                }
            }
        }
}

/* Motion and load of all points at the samples, in lanes and point by point. */
static void sample_motion(bd_coulomb_work *work, int n, const bd_element *element,
                          const double *x) {
    const int n_coef = bd_n_coef(work->n_harm), n_power = bd_n_power(work->n_harm);
    bd_coupled_lanes *l = &work->lanes;
    memset(work->motion, 0, sizeof(double) * 3 * (size_t)n_coef * BD_LANES);
    for (int lane = 0; lane < n; ++lane) {
        const bd_element *e = element + lane;
        const int has_friction = work->search[lane].state != BD_DONE;
        const double *from = x + 3 * (size_t)n_coef * (size_t)lane;
        l->mu[lane] = e->mu;
        for (int a = 0; a < 3 && has_friction; ++a) {
            double *to = work->motion + a * n_coef * BD_LANES + lane;
            const double factor = a < 2 ? e->kt[a] : bd_law_is_constant(e->law) ? 0.0 : e->kn;
            for (int i = 0; i < n_coef; ++i) to[i * BD_LANES] = factor * from[a * n_coef + i];
            if (a == 2) to[0] += bd_law_is_constant(e->law) ? e->load : e->n0;
        }
    }
    double *value[3] = {l->x, l->y, l->g};
    for (int a = 0; a < 3; ++a)
        work->kernel->lane_values(n_coef, work->n_time, work->power, n_power,
                                  work->motion + a * n_coef * BD_LANES, value[a]);
    for (int i = 0; i < work->n_time * BD_LANES; ++i)
        l->R[i] = l->mu[i % BD_LANES] * (l->g[i] > 0.0 ? l->g[i] : 0.0);
    for (int lane = 0; lane < n; ++lane) {
        if (work->search[lane].state == BD_DONE) continue;
        select_lane(work, lane);
        for (int k = 0; k < work->n_time; ++k) {
            const int at = k * BD_LANES + lane;
            work->x[k] = l->x[at];
            work->y[k] = l->y[at];
            work->R[k] = l->R[at];
            work->g[k] = l->g[at];
        }
        for (int k = work->n_time; k < work->n_padded; ++k)
            work->x[k] = work->y[k] = 0.0, work->R[k] = INFINITY;
    }
}

/* Handle points that stick or stay open; start the search for the other points. */
static void find_sticking(bd_coulomb_work *work, const bd_element *element, const double *x,
                          bd_response *out, bd_status_share *share, bd_slider_search *search) {
    double size = 0.0;
    int n_open = 0;
    for (int k = 0; k < work->n_time; ++k) {
        n_open += !(work->g[k] > 0.0);
        const double extent = fabs(work->x[k]) + fabs(work->y[k]),
                     most = extent > work->R[k] ? extent : work->R[k];
        size = most > size ? most : size;
    }
    search->state = BD_DONE;
    if (n_open == work->n_time) {
        work->segment[0] = (bd_segment){0.0, BD_TWO_PI, BD_OPEN};
        work->n_segment = 1;
        return;
    }
    const double initial[2] = {element->kt[0] * element->w[0], element->kt[1] * element->w[1]};
    const double scale = size + bd_norm(initial[0], initial[1]) + 1e-300;
    const int tangent = out->dN != NULL;
    const bd_disks disks = {work->n_padded, work->x, work->y, work->R, work->kernel};
    bd_disk_point centre = {.s = {initial[0], initial[1]}, .value = INFINITY};
    int worst = 0;
    if (n_open == 0 && bd_disks_violation(&disks, initial, &worst) <= SLACK * scale) {
        bd_sticking_write(work, element, x, initial, out, share);
        return;
    }
    if (n_open == 0) bd_disks_centre(&disks, SLACK * scale, &centre);
    if (centre.value > TOUCH * scale) {
        start_search(work, &centre, scale, search);
        return;
    }
    if (centre.value >= -TOUCH * scale) {
        bd_sticking_write(work, element, x, centre.s, out, share);
        if (tangent) bd_sticking_write_onset(work, element, &centre, out);
        return;
    }
    const double fraction = bd_disks_entry(&disks, initial, centre.s, &worst);
    const double s[2] = {initial[0] + fraction * (centre.s[0] - initial[0]),
                         initial[1] + fraction * (centre.s[1] - initial[1])};
    bd_sticking_write(work, element, x, s, out, share);
    if (tangent) bd_sticking_write_shifted(work, element, initial, &centre, fraction, worst, out);
}

static void finish(bd_coulomb_work *work, const bd_element *element, int lane, bd_response *out,
                   bd_status_share *share) {
    const bd_slider_search *search = work->search + lane;
    const int tangent = out->dN != NULL, onset = search->centre.value <= ONSET * search->size;
    if (search->state == BD_LOST) {
        for (int i = 0; i < 2 * bd_n_coef(work->n_harm); ++i) out->F[i] = NAN;
        out->tangential[0] = out->tangential[1] = BD_BLOCK_LINEAR;
        return;
    }
    sum_period(work, element, lane, tangent && !onset, out, share);
    out->tangential[0] = out->tangential[1] = BD_BLOCK_FULL;
    out->coupled = 1;
    out->with_normal[0] = out->with_normal[1] = !bd_law_is_constant(element->law);
    if (tangent && onset) bd_sticking_write_onset(work, element, &search->centre, out);
    if (tangent && !onset) write_tangent(work, element, out);
}

void bd_coulomb_evaluate(int n, const bd_element *element, const double *x, bd_response *out,
                         bd_status_share *share, bd_coulomb_work *work) {
    const size_t size = 3 * (size_t)bd_n_coef(work->n_harm);
    int any = 0;
    work->n_segment = work->n_period = 0;
    for (int lane = 0; lane < n; ++lane) {
        const bd_element *e = element + lane;
        const int has_friction = bd_law_is_coupled(e->law) &&
                                 (bd_element_has_friction(e, 0) || bd_element_has_friction(e, 1));
        work->search[lane].state = has_friction ? BD_SEARCHING : BD_DONE;
        any |= has_friction;
    }
    if (!any) return;
    sample_motion(work, n, element, x);
    for (int lane = 0; lane < n; ++lane) {
        if (work->search[lane].state == BD_DONE) continue;
        select_lane(work, lane);
        find_sticking(work, element + lane, x + size * (size_t)lane, out + lane, share + lane,
                      work->search + lane);
    }
    if (!settle(work, n, out->dN != NULL)) return;
    set_sliders(work, n);
    work->kernel->coupled_period(&work->lanes, 1, out->dN != NULL);
    for (int lane = 0; lane < n; ++lane) {
        if (work->search[lane].state == BD_DONE) continue;
        select_lane(work, lane);
        finish(work, element + lane, lane, out + lane, share + lane);
    }
}
