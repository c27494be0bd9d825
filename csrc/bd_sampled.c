/* Sampled evaluation of 1-D friction with variable normal load, in two independent directions.
 *
 * The law is the clip of bd_event.c, applied at n_time equidistant instants,
 *
 *     w_k = clip(w_{k-1}, u_k - mu N_k/kt, u_k + mu N_k/kt),   N_k = max(n0 + kn v_k, 0),   T_k = kt (u_k - w_k),
 *
 * marched over two periods, of which the second is settled (the period map is a clip).  Fourier coefficients are sums
 * over the samples, so the formulas of bd_element.c hold with E_n = (2 pi/n_time) sum_k exp(i n theta_k).
 *
 * The plain law takes the slider of a closing contact from the last open sample, an error of order h whose derivative
 * does not converge.  With interpolation the slider is the displacement where n0 + kn v vanishes,
 *
 *     w = (1 - s) u_{k-1} + s u_k,   s = -g_{k-1}/(g_k - g_{k-1}),   g = n0 + kn v,
 *
 * and its derivative with respect to v, through s, is (u_k - u_{k-1}) (-g_k dg_{k-1} + g_{k-1} dg_k)/(g_k - g_{k-1})^2. */
#include "bd_sampled.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { GIVEN, SET_BY_LO, SET_BY_HI, SET_BY_CLOSING };

typedef struct {
    int kind;
    int sample; /* at which it was set */
    double w;
} slider;

bd_status bd_sampled_create(bd_sampled_work *work, int n_harm, int n_time, int interpolate) {
    memset(work, 0, sizeof *work);
    if (n_harm < 1 || n_harm > BD_MAX_HARM || n_time < 2 * n_harm + 2) return BD_BAD_ARGUMENT;
    const size_t n_coef = (size_t)bd_n_coef(n_harm), n_power = (size_t)bd_n_power(n_harm), k = (size_t)n_time;
    bd_status status = bd_trig_grid_create(&work->grid, n_harm, n_time);
    if (status != BD_OK) return status;
    work->memory = malloc(sizeof(double) * (k * n_power + 2 * k + 4 * n_power + 3 * n_coef + 3 * n_coef * n_coef));
    work->segment[0] = malloc(sizeof(bd_segment) * 2 * k);
    if (!work->memory || !work->segment[0]) {
        bd_sampled_destroy(work);
        return BD_NO_MEMORY;
    }
    work->n_harm = n_harm;
    work->n_time = n_time;
    work->interpolate = interpolate;
    double *p = work->memory;
    work->power = p, p += k * n_power;
    work->u = p, p += k;
    work->v = p, p += k;
    work->contact = p, p += n_power;
    work->part = p, p += n_power;
    work->cycle.stick = p, p += n_power;
    work->cycle.slip = p, p += n_power;
    work->cycle.held = p, p += n_coef;
    work->origin_u = p, p += n_coef;
    work->origin_v = p, p += n_coef;
    work->scratch = p, p += n_coef * n_coef;
    work->held_u = p, p += n_coef * n_coef;
    work->held_v = p;
    work->cycle.n_harm = n_harm;
    work->segment[1] = work->segment[0] + k;
    for (int i = 0; i < n_time; ++i)
        bd_trig_powers(2 * n_harm, BD_TWO_PI * i / n_time, work->power + (size_t)i * n_power);
    return BD_OK;
}

void bd_sampled_destroy(bd_sampled_work *work) {
    if (!work) return;
    bd_trig_grid_destroy(&work->grid);
    free(work->memory);
    free(work->segment[0]);
    memset(work, 0, sizeof *work);
}

static const double *power_at(const bd_sampled_work *work, int k) {
    return work->power + (size_t)k * (size_t)bd_n_power(work->n_harm);
}

static void add_sample(const bd_sampled_work *work, double *E, int k, double sign) {
    const double weight = sign * BD_TWO_PI / work->n_time, *power = power_at(work, k);
    const int n_power = bd_n_power(work->n_harm);
    for (int n = 0; n < n_power; ++n) E[n] += weight * power[n];
}

static void push_sample(bd_sampled_work *work, int d, int k, int state) {
    const double h = BD_TWO_PI / work->n_time;
    const int n = work->n_segment[d];
    bd_segment *segment = work->segment[d];
    if (n > 0 && segment[n - 1].state == state) {
        segment[n - 1].end = (k + 1) * h;
    } else {
        segment[n] = (bd_segment){k * h, (k + 1) * h, state};
        work->n_segment[d] = n + 1;
    }
}

static double level(const bd_element *element, const bd_sampled_work *work, int k) {
    return element->n0 + element->kn * work->v[k];
}

/* The slider after sample k; before is the sample that precedes it. */
static slider step(const bd_element *element, int d, const bd_sampled_work *work, slider s, int before, int k) {
    const double g = level(element, work, k), g_before = level(element, work, before);
    if (!(g > 0.0)) return (slider){SET_BY_CLOSING, k, work->u[k]};
    if (!(g_before > 0.0) && s.kind == SET_BY_CLOSING) {
        const double t = work->interpolate ? -g_before / (g - g_before) : 0.0;
        s = (slider){SET_BY_CLOSING, k, (1.0 - t) * work->u[before] + t * work->u[k]};
    }
    const double bound = element->mu * g / element->kt[d], lo = work->u[k] - bound, hi = work->u[k] + bound;
    if (s.w < lo) return (slider){SET_BY_LO, k, lo};
    if (s.w > hi) return (slider){SET_BY_HI, k, hi};
    return s;
}

/* Derivative of a slider that was set by the contact that closed between the samples before k and k. */
static void closing_derivative(const bd_element *element, bd_sampled_work *work, int k) {
    const int before = k > 0 ? k - 1 : work->n_time - 1, n_coef = bd_n_coef(work->n_harm);
    const double *b0 = power_at(work, before) + 1, *b1 = power_at(work, k) + 1;
    if (!work->interpolate) {
        memcpy(work->origin_u, b0, sizeof(double) * (size_t)n_coef);
        memset(work->origin_v, 0, sizeof(double) * (size_t)n_coef);
        return;
    }
    const double g0 = level(element, work, before), g1 = level(element, work, k), dg = g1 - g0, t = -g0 / dg;
    const double factor = element->kn * (work->u[k] - work->u[before]) / (dg * dg);
    for (int i = 0; i < n_coef; ++i) {
        work->origin_u[i] = (1.0 - t) * b0[i] + t * b1[i];
        work->origin_v[i] = factor * (g0 * b1[i] - g1 * b0[i]);
    }
}

static void end_stick(const bd_element *element, int d, bd_sampled_work *work, slider s) {
    const int n_coef = bd_n_coef(work->n_harm), n_power = bd_n_power(work->n_harm);
    double *part = work->part;
    if (part[0] == 0.0) return;
    for (int n = 0; n < n_power; ++n) work->cycle.stick[n] += part[n];
    if (s.kind == GIVEN || !work->cycle.held_u) {
        bd_cycle_hold(&work->cycle, part + 1, s.w, NULL, NULL);
    } else {
        if (s.kind == SET_BY_CLOSING) {
            closing_derivative(element, work, s.sample);
        } else {
            const double r = element->mu * element->kn / element->kt[d], sign = s.kind == SET_BY_LO ? -r : r;
            const double *b = power_at(work, s.sample) + 1;
            for (int i = 0; i < n_coef; ++i) {
                work->origin_u[i] = b[i];
                work->origin_v[i] = sign * b[i];
            }
        }
        bd_cycle_hold(&work->cycle, part + 1, s.w, work->origin_u, work->origin_v);
    }
    memset(part, 0, sizeof(double) * (size_t)n_power);
}

static void evaluate_direction(const bd_element *element, int d, const double *u, const double *v, bd_response *out,
                               bd_status_share *share, bd_sampled_work *work) {
    const int n_time = work->n_time;
    bd_trig_grid_values(&work->grid, u, work->u);
    bd_cycle_clear(&work->cycle);
    memset(work->part, 0, sizeof(double) * (size_t)bd_n_power(work->n_harm));
    slider s = {GIVEN, -1, element->w[d]};
    for (int k = 0; k < n_time; ++k) s = step(element, d, work, s, k > 0 ? k - 1 : n_time - 1, k);
    for (int k = 0; k < n_time; ++k) {
        const slider after = step(element, d, work, s, k > 0 ? k - 1 : n_time - 1, k);
        if (after.kind != s.kind || after.sample != s.sample) end_stick(element, d, work, s);
        s = after;
        int state = BD_STICK;
        if (!(level(element, work, k) > 0.0)) {
            state = BD_OPEN;
        } else if (s.sample == k && s.kind == SET_BY_LO) {
            state = BD_SLIP_PLUS;
        } else if (s.sample == k && s.kind == SET_BY_HI) {
            state = BD_SLIP_MINUS;
        }
        if (state == BD_STICK) add_sample(work, work->part, k, 1.0);
        if (state == BD_SLIP_PLUS) add_sample(work, work->cycle.slip, k, 1.0);
        if (state == BD_SLIP_MINUS) add_sample(work, work->cycle.slip, k, -1.0);
        if (state == BD_SLIP_PLUS || state == BD_SLIP_MINUS) share->slip[d] += 1.0 / n_time;
        push_sample(work, d, k, state);
    }
    end_stick(element, d, work, s);
    share->stick[d] = work->cycle.stick[0] / BD_TWO_PI;
    bd_cycle_friction(element, d, &work->cycle, u, v, out, work->scratch);
}

void bd_sampled_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                         bd_sampled_work *work) {
    const int n_coef = bd_n_coef(work->n_harm), n_time = work->n_time;
    const double *v = x + 2 * n_coef;
    bd_status_share unused;
    if (!share) share = &unused;
    *share = (bd_status_share){{0.0, 0.0}, {0.0, 0.0}, 0.0};
    work->n_segment[0] = work->n_segment[1] = 0;
    work->cycle.held_u = out->dN ? work->held_u : NULL;
    work->cycle.held_v = out->dN ? work->held_v : NULL;
    bd_element_open(element, work->n_harm, out);

    bd_trig_grid_values(&work->grid, v, work->v);
    memset(work->contact, 0, sizeof(double) * (size_t)bd_n_power(work->n_harm));
    int n_contact = 0;
    for (int k = 0; k < n_time; ++k)
        if (level(element, work, k) > 0.0) {
            add_sample(work, work->contact, k, 1.0);
            ++n_contact;
        }
    share->open = 1.0 - (double)n_contact / n_time;
    if (n_contact == 0) return;
    if (n_contact == n_time)
        bd_element_closed(element, work->n_harm, v, out);
    else
        bd_cycle_normal(element, work->n_harm, work->contact, v, out, work->scratch);
    for (int d = 0; d < 2; ++d)
        if (element->law == BD_LAW_SEPARABLE && element->mu > 0.0 && element->kt[d] > 0.0)
            evaluate_direction(element, d, x + d * n_coef, v, out, share, work);
}
