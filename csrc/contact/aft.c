/* Sampled evaluation of 1-D friction with variable or constant normal load, in two independent
 * directions.
 *
 * The law is the clip of event_driven.c at n_time equidistant instants,
 *
 *     w_k = clip(w_{k-1}, u_k - mu N_k/kt, u_k + mu N_k/kt),
 *     N_k = max(n0 + kn v_k, 0),   T_k = kt (u_k - w_k).
 *
 * Two periods suffice: the period map is a clip, so the second period is steady. Fourier
 * coefficients are sums over the samples, and the formulas of element.c hold with
 * E_n = (2 pi/n_time) sum_k exp(i n theta_k).
 *
 * The plain law takes the slider of a closing contact from the last open sample. This is an error
 * of order h, and its derivative does not converge. With interpolation the slider is the
 * displacement at zero n0 + kn v,
 *
 *     w = (1 - s) u_{k-1} + s u_k,   s = -g_{k-1}/(g_k - g_{k-1}),   g = n0 + kn v.
 *
 * Its derivative with respect to g, through s, is (u_k - u_{k-1}) (-g_k dg_{k-1} + g_{k-1}
 * dg_k)/(g_k - g_{k-1})^2.
 *
 * The loops over samples, for several points at a time, are in aft_kernel.c. */
#include "contact/aft.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

bd_status bd_sampled_create(bd_sampled_work *work, int n_harm, int n_time, int interpolate) {
    memset(work, 0, sizeof *work);
    work->kernel = bd_kernel_get();
    if (!work->kernel || n_harm < 1 || n_harm > BD_MAX_HARM || n_time < 2 * n_harm + 2)
        return BD_BAD_ARGUMENT;
    const size_t n_coef = (size_t)bd_n_coef(n_harm), n_power = (size_t)bd_n_power(n_harm),
                 k = (size_t)n_time;
    const size_t lanes = BD_LANES;
    const size_t n_double = k * n_power + 3 * n_coef * lanes + 6 * k * lanes + 4 * n_power * lanes +
                            3 * n_power + lanes * n_coef + (2 * lanes + 1) * n_coef * n_coef;
    work->memory = calloc(n_double, sizeof(double));
    work->segment[0] = malloc(sizeof(bd_segment) * 2 * k);
    work->state = calloc(k * lanes, 1);
    if (!work->memory || !work->segment[0] || !work->state) {
        bd_sampled_destroy(work);
        return BD_NO_MEMORY;
    }
    work->n_harm = n_harm;
    work->n_time = n_time;
    double *p = work->memory;
    work->power = p, p += k * n_power;
    work->x = p, p += 3 * n_coef * lanes;
    work->u = p, p += k * lanes;
    work->g = p, p += k * lanes;
    work->limit = p, p += k * lanes;
    work->lanes.lo = p, p += k * lanes;
    work->lanes.hi = p, p += k * lanes;
    work->lanes.path = p, p += k * lanes;
    work->contact = p, p += n_power * lanes;
    work->lanes.stick = p, p += n_power * lanes;
    work->lanes.slip = p, p += n_power * lanes;
    work->lanes.saved = p, p += n_power * lanes;
    work->stick = p, p += n_power;
    work->slip = p, p += n_power;
    work->one = p, p += n_power;
    work->lanes.stick_slider = p, p += lanes * n_coef;
    work->stick_slider_u = p, p += lanes * n_coef * n_coef;
    work->stick_slider_g = p, p += lanes * n_coef * n_coef;
    work->scratch = p;
    work->lanes.n_harm = n_harm;
    work->lanes.n_time = n_time;
    work->lanes.interpolate = interpolate;
    work->lanes.power = work->power;
    work->lanes.u = work->u;
    work->segment[1] = work->segment[0] + k;
    /* an integer reduction of the argument makes it exact for every harmonic */
    for (int i = 0; i < n_time; ++i)
        for (int l = 0; l <= 2 * n_harm; ++l) {
            const double angle = BD_TWO_PI * (double)(((long)l * i) % n_time) / n_time;
            double *power = work->power + (size_t)i * n_power + 2 * l;
            power[0] = l == 0 ? 1.0 : cos(angle);
            power[1] = l == 0 ? 1.0 : sin(angle);
        }
    return BD_OK;
}

void bd_sampled_destroy(bd_sampled_work *work) {
    if (!work) return;
    free(work->memory);
    free(work->segment[0]);
    free(work->state);
    memset(work, 0, sizeof *work);
}

/* ---- parts of the cycle, for one point at a time ---- */

static void whole_cycle(bd_sampled_work *work, int d, int state) {
    work->segment[d][0] = (bd_segment){0.0, BD_TWO_PI, state};
    work->n_segment[d] = 1;
}

static void list_parts(bd_sampled_work *work, int d) {
    const double h = BD_TWO_PI / work->n_time;
    int n = 0;
    for (int k = 0; k < work->n_time; ++k) {
        const int state = work->state[k * BD_LANES];
        if (n > 0 && work->segment[d][n - 1].state == state)
            work->segment[d][n - 1].end = (k + 1) * h;
        else
            work->segment[d][n++] = (bd_segment){k * h, (k + 1) * h, state};
    }
    work->n_segment[d] = n;
}

/* ---- lanes ---- */

static void load_lanes(int n, const bd_element *element, const double *x, bd_sampled_work *work) {
    const int n_coef = bd_n_coef(work->n_harm);
    memset(work->x, 0, sizeof(double) * 3 * (size_t)n_coef * BD_LANES);
    for (int lane = 0; lane < n; ++lane) {
        const double *from = x + 3 * (size_t)n_coef * (size_t)lane;
        for (int i = 0; i < 2 * n_coef; ++i) work->x[i * BD_LANES + lane] = from[i];
        for (int i = 2 * n_coef; i < 3 * n_coef; ++i)
            work->x[i * BD_LANES + lane] = element[lane].kn * from[i];
        work->x[2 * n_coef * BD_LANES + lane] += element[lane].n0;
    }
}

static void one_lane(const bd_sampled_work *work, const double *sums, int lane, double *E) {
    const double weight = BD_TWO_PI / work->n_time;
    const int n_power = bd_n_power(work->n_harm);
    for (int n = 0; n < n_power; ++n) E[n] = weight * sums[n * BD_LANES + lane];
}

/* Normal forces; return the number of points that touch during the cycle. */
static int normal_direction(int n, const bd_element *element, const double *x, bd_response *out,
                            bd_status_share *share, bd_sampled_work *work) {
    const int n_coef = bd_n_coef(work->n_harm), n_power = bd_n_power(work->n_harm);
    const double *xg = work->x + 2 * n_coef * BD_LANES;
    int n_contact = 0;
    work->kernel->lane_values(n_coef, work->n_time, work->power, n_power, xg, work->g);
    work->kernel->lane_contact(n_power, work->n_time, work->power, work->g, work->contact);
    for (int lane = 0; lane < n; ++lane) {
        const double *v = x + (3 * (size_t)lane + 2) * (size_t)n_coef;
        const double count = work->contact[lane];
        if (bd_law_is_two_sided(element[lane].law) || count == (double)work->n_time) {
            bd_element_closed(element + lane, work->n_harm, v, out + lane);
            ++n_contact;
            continue;
        }
        share[lane].open = 1.0 - count / work->n_time;
        if (count == 0.0) continue;
        ++n_contact;
        one_lane(work, work->contact, lane, work->one);
        bd_cycle_normal(element + lane, work->n_harm, work->one, v, out + lane, work->scratch);
    }
    return n_contact;
}

/* Load in the friction limit at every sample. */
static const double *find_limit(int n, const bd_element *element, bd_sampled_work *work) {
    int constant = 0;
    for (int lane = 0; lane < n; ++lane) constant |= bd_law_is_constant(element[lane].law);
    if (!constant) return work->g;
    memcpy(work->limit, work->g, sizeof(double) * (size_t)work->n_time * BD_LANES);
    for (int lane = 0; lane < n; ++lane)
        for (int k = 0; k < work->n_time && bd_law_is_constant(element[lane].law); ++k)
            work->limit[k * BD_LANES + lane] = element[lane].load;
    return work->limit;
}

static void finish_lane(const bd_element *element, int d, int lane, const double *x,
                        bd_response *out, bd_status_share *share, bd_sampled_work *work) {
    const size_t n = (size_t)bd_n_coef(work->n_harm), at = (size_t)lane;
    const double weight = BD_TWO_PI / work->n_time;
    const int tangent = work->lanes.stick_slider_u != NULL;
    bd_cycle cycle = {.n_harm = work->n_harm,
                      .stick = work->stick,
                      .slip = work->slip,
                      .stick_slider = work->lanes.stick_slider + at * n,
                      .stick_slider_u = tangent ? work->stick_slider_u + at * n * n : NULL,
                      .stick_slider_v = tangent ? work->stick_slider_g + at * n * n : NULL};
    one_lane(work, work->lanes.stick, lane, work->stick);
    one_lane(work, work->lanes.slip, lane, work->slip);
    for (size_t i = 0; i < n; ++i) cycle.stick_slider[i] *= weight;
    for (size_t i = 0; i < n * n && tangent; ++i) {
        cycle.stick_slider_u[i] *= weight;
        cycle.stick_slider_v[i] *= weight * element->kn;
    }
    share->stick[d] = cycle.stick[0] / BD_TWO_PI;
    share->slip[d] = 1.0 - share->stick[d] - share->open;
    if (share->slip[d] < 1e-12) share->slip[d] = 0.0;
    bd_cycle_friction(element, d, &cycle, x + (size_t)d * n, x + 2 * n, out, work->scratch);
}

static void tangential_direction(int n, const bd_element *element, int d, const double *x,
                                 bd_response *out, bd_status_share *share, bd_sampled_work *work) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm);
    const int n_power = bd_n_power(work->n_harm);
    bd_lanes *lanes = &work->lanes;
    int any_friction = 0;
    for (int lane = 0; lane < BD_LANES; ++lane) {
        const int has_friction = lane < n && bd_element_has_friction(element + lane, d) &&
                                 !bd_law_is_coupled(element[lane].law);
        lanes->slope[lane] = has_friction ? element[lane].mu / element[lane].kt[d] : 0.0;
        lanes->w[lane] = has_friction ? element[lane].w[d] : 0.0;
        lanes->origin[lane] = -1;
        any_friction |= has_friction;
    }
    if (!any_friction) return;
    work->kernel->lane_values((int)n_coef, work->n_time, work->power, n_power,
                              work->x + (size_t)d * n_coef * BD_LANES, work->u);
    work->kernel->settle(lanes);
    int moving = 0;
    for (int lane = 0; lane < n; ++lane)
        moving |= lanes->slope[lane] > 0.0 && lanes->origin[lane] >= 0;
    if (moving) {
        memset(lanes->stick, 0, sizeof(double) * (size_t)n_power * BD_LANES);
        memset(lanes->slip, 0, sizeof(double) * (size_t)n_power * BD_LANES);
        memset(lanes->stick_slider, 0, sizeof(double) * n_coef * BD_LANES);
        if (lanes->stick_slider_u)
            memset(lanes->stick_slider_u, 0, sizeof(double) * n_coef * n_coef * BD_LANES);
        if (lanes->stick_slider_u)
            memset(lanes->stick_slider_g, 0, sizeof(double) * n_coef * n_coef * BD_LANES);
        work->kernel->sum_cycle(lanes);
        if (n == 1) list_parts(work, d);
    }
    for (int lane = 0; lane < n; ++lane) {
        const double *xl = x + 3 * n_coef * (size_t)lane;
        if (lanes->slope[lane] == 0.0) continue;
        if (lanes->origin[lane] >= 0) {
            if (share[lane].open < 1.0)
                finish_lane(element + lane, d, lane, xl, out + lane, share + lane, work);
            continue;
        }
        bd_element_stuck(element + lane, work->n_harm, d, xl + (size_t)d * n_coef, out + lane);
        share[lane].stick[d] = 1.0;
        if (n == 1) whole_cycle(work, d, BD_STICK);
    }
}

void bd_sampled_evaluate(int n, const bd_element *element, const double *x, bd_response *out,
                         bd_status_share *share, bd_sampled_work *work) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm);
    bd_status_share unused[BD_LANES];
    if (!share) share = unused;
    for (int lane = 0; lane < n; ++lane) {
        share[lane] = (bd_status_share){{0.0, 0.0}, {0.0, 0.0}, 0.0};
        bd_element_open(element + lane, work->n_harm, out + lane);
        if (element[lane].law != BD_LAW_BONDED) continue;
        for (int d = 0; d < 2; ++d) {
            bd_element_stuck(element + lane, work->n_harm, d,
                             x + (3 * (size_t)lane + (size_t)d) * n_coef, out + lane);
            share[lane].stick[d] = 1.0;
        }
    }
    work->lanes.stick_slider_u = out->dN ? work->stick_slider_u : NULL;
    work->lanes.stick_slider_g = out->dN ? work->stick_slider_g : NULL;
    work->lanes.state = n == 1 ? work->state : NULL;
    load_lanes(n, element, x, work);
    const int n_contact = normal_direction(n, element, x, out, share, work);
    for (int d = 0; d < 2 && n == 1; ++d) {
        whole_cycle(work, d, n_contact ? BD_STICK : BD_OPEN);
        if (n_contact && !bd_element_has_friction(element, d) && element->law != BD_LAW_BONDED)
            work->n_segment[d] = 0;
    }
    work->lanes.g = find_limit(n, element, work);
    for (int d = 0; d < 2 && n_contact; ++d)
        tangential_direction(n, element, d, x, out, share, work);
}
