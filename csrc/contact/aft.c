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

#include "util/storage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Fill work->power (n_time, n_power) with the powers exp(i l theta_k), l = 0 .. 2 n_harm, at the
 * samples theta_k = 2 pi k/n_time. Real and imaginary parts of power l are at 2 l and 2 l + 1,
 *
 *     [1, 1, cos theta, sin theta, cos 2 theta, sin 2 theta, ...].
 *
 * Slot 1 is the exception: it holds 1 instead of sin 0 = 0, so that the row from slot 1 on is the
 * Fourier basis [1, cos, sin, ...] of the coefficients. The integer l k modulo n_time keeps the
 * angle below 2 pi, so that it is exact at any sample. */
static void fill_powers(bd_sampled_work *work) {
    const int n_time = work->n_time, n_power = bd_n_power(work->n_harm);
    for (int k = 0; k < n_time; ++k) {
        double *at_sample = work->power + (size_t)k * (size_t)n_power;
        at_sample[0] = 1.0;
        at_sample[1] = 1.0; /* constant of the Fourier basis */
        for (int l = 1; l <= 2 * work->n_harm; ++l) {
            const long reduced = ((long)l * k) % n_time;
            const double angle = BD_TWO_PI * (double)reduced / n_time;
            at_sample[2 * l] = cos(angle);
            at_sample[2 * l + 1] = sin(angle);
        }
    }
}

/* Take all arrays from one piece of memory, and fill the table of powers. Lanes are points that are
 * evaluated together; each array that ends with (BD_LANES) has one entry for each. `interpolate`:
 * the slider of a closing contact is set at the instant of the closing, not at a sample. */
bd_status bd_sampled_create(bd_sampled_work *work, int n_harm, int n_time, int interpolate) {
    memset(work, 0, sizeof *work);
    work->kernel = bd_kernel_get();
    const int valid = n_harm >= 1 && n_harm <= BD_MAX_HARM && n_time >= 2 * n_harm + 2;
    if (!work->kernel || !valid) return BD_BAD_ARGUMENT;

    const size_t n_coef = (size_t)bd_n_coef(n_harm);
    const size_t n_power = (size_t)bd_n_power(n_harm);
    const size_t n_sample = (size_t)n_time;
    const size_t lanes = BD_LANES;
    const size_t per_sample = n_power + 6 * lanes;
    const size_t per_power = 4 * lanes + 3;
    const size_t per_coef = 4 * lanes + (2 * lanes + 1) * n_coef;
    const size_t n_double = n_sample * per_sample + n_power * per_power + n_coef * per_coef;
    work->memory = calloc(n_double, sizeof(double));
    work->segment[0] = malloc(sizeof(bd_segment) * 2 * n_sample);
    work->state = calloc(n_sample * lanes, 1);
    if (!work->memory || !work->segment[0] || !work->state) {
        bd_sampled_destroy(work);
        return BD_NO_MEMORY;
    }
    work->segment[1] = work->segment[0] + n_sample;
    work->n_harm = n_harm;
    work->n_time = n_time;

    double *rest = work->memory;
    work->power = bd_take(&rest, n_sample * n_power);
    work->x = bd_take(&rest, 3 * n_coef * lanes);
    work->u = bd_take(&rest, n_sample * lanes);
    work->g = bd_take(&rest, n_sample * lanes);
    work->limit = bd_take(&rest, n_sample * lanes);
    work->lanes.lo = bd_take(&rest, n_sample * lanes);
    work->lanes.hi = bd_take(&rest, n_sample * lanes);
    work->lanes.path = bd_take(&rest, n_sample * lanes);
    work->contact = bd_take(&rest, n_power * lanes);
    work->lanes.stick = bd_take(&rest, n_power * lanes);
    work->lanes.slip = bd_take(&rest, n_power * lanes);
    work->lanes.saved = bd_take(&rest, n_power * lanes);
    work->stick = bd_take(&rest, n_power);
    work->slip = bd_take(&rest, n_power);
    work->one = bd_take(&rest, n_power);
    work->lanes.stick_slider = bd_take(&rest, lanes * n_coef);
    work->stick_slider_u = bd_take(&rest, lanes * n_coef * n_coef);
    work->stick_slider_g = bd_take(&rest, lanes * n_coef * n_coef);
    work->scratch = bd_take(&rest, n_coef * n_coef);

    work->lanes.n_harm = n_harm;
    work->lanes.n_time = n_time;
    work->lanes.interpolate = interpolate;
    work->lanes.power = work->power;
    work->lanes.u = work->u;
    fill_powers(work);
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

/* The cycle of direction d of a single point consists of one part. */
static void whole_cycle(bd_sampled_work *work, int d, int state) {
    work->segment[d][0] = (bd_segment){0.0, BD_TWO_PI, state};
    work->n_segment[d] = 1;
}

/* Parts of the cycle of direction d of a single point: equal states of consecutive samples, each
 * from its sample to the next. */
static void list_parts(bd_sampled_work *work, int d) {
    const double h = BD_TWO_PI / work->n_time;
    bd_segment *part = work->segment[d];
    int n = 0;
    for (int k = 0; k < work->n_time; ++k) {
        const int state = work->state[k * BD_LANES];
        const double start = k * h, end = (k + 1) * h;
        if (n > 0 && part[n - 1].state == state) {
            part[n - 1].end = end;
        } else {
            part[n] = (bd_segment){start, end, state};
            ++n;
        }
    }
    work->n_segment[d] = n;
}

/* ---- lanes ---- */

/* Copy the coefficients of u1, u2 and n0 + kn v of n points from the motions x (n, 3, n_coef) of
 * u1, u2 and v to work->x (3, n_coef, BD_LANES), where the points lie side by side. Unused lanes
 * are zero. */
static void load_lanes(int n, const bd_element *element, const double *x, bd_sampled_work *work) {
    const int n_coef = bd_n_coef(work->n_harm);
    double *to = work->x;
    memset(to, 0, sizeof(double) * 3 * (size_t)n_coef * BD_LANES);
    for (int lane = 0; lane < n; ++lane) {
        const double *from = x + 3 * (size_t)n_coef * (size_t)lane;
        const double kn = element[lane].kn;
        const int first_v = BD_NORMAL * n_coef, end_v = first_v + n_coef;
        for (int i = 0; i < first_v; ++i) to[i * BD_LANES + lane] = from[i];
        for (int i = first_v; i < end_v; ++i) to[i * BD_LANES + lane] = kn * from[i];
        to[first_v * BD_LANES + lane] += element[lane].n0; /* on the mean */
    }
}

/* Integrals E_n = int exp(i n theta) of one point, E (n_power), from the sums of all points over
 * samples, sums (n_power, BD_LANES): a sample has the weight 2 pi/n_time. */
static void integrals_of_lane(const bd_sampled_work *work, const double *sums, int lane,
                              double *E) {
    const double weight = BD_TWO_PI / work->n_time;
    const int n_power = bd_n_power(work->n_harm);
    for (int n = 0; n < n_power; ++n) E[n] = weight * sums[n * BD_LANES + lane];
}

/* Normal forces N = max(n0 + kn v, 0) of n points with the motion x (n, 3, n_coef): write forces
 * and tangents to out (n), and the shares of the cycle without contact to share (n). Return the
 * number of points that touch during the cycle. There are three kinds of points:
 *
 *     always closed, or two-sided    linear spring
 *     sometimes closed               sums over the closed samples
 *     always open                    no force, as initialised by bd_sampled_evaluate. */
static int normal_direction(int n, const bd_element *element, const double *x, bd_response *out,
                            bd_status_share *share, bd_sampled_work *work) {
    const int n_harm = work->n_harm, n_time = work->n_time;
    const int n_coef = bd_n_coef(n_harm), n_power = bd_n_power(n_harm);
    const double *coefficients = work->x + BD_NORMAL * n_coef * BD_LANES; /* of g = n0 + kn v */
    int n_touching = 0;
    work->kernel->lane_values(n_coef, n_time, work->power, n_power, coefficients, work->g);
    work->kernel->lane_contact(n_power, n_time, work->power, work->g, work->contact);
    for (int lane = 0; lane < n; ++lane) {
        const double *v = x + (BD_N_COMPONENT * (size_t)lane + BD_NORMAL) * (size_t)n_coef;
        /* entry 0 of the sums of powers over samples with g > 0 is the number of these samples */
        const double n_closed = work->contact[lane];
        const int always_closed = n_closed == (double)n_time;
        if (bd_law_is_two_sided(element[lane].law) || always_closed) {
            bd_element_closed(element + lane, n_harm, v, out + lane);
            ++n_touching;
            continue;
        }
        share[lane].open = 1.0 - n_closed / n_time;
        if (n_closed == 0.0) continue;

        ++n_touching;
        integrals_of_lane(work, work->contact, lane, work->one);
        bd_cycle_normal(element + lane, n_harm, work->one, v, out + lane, work->scratch);
    }
    return n_touching;
}

/* Load (n_time, BD_LANES) in the friction limit of n points at every sample: n0 + kn v, or the
 * constant load for laws that have one. */
static const double *find_limit(int n, const bd_element *element, bd_sampled_work *work) {
    int any_constant = 0;
    for (int lane = 0; lane < n; ++lane) any_constant |= bd_law_is_constant(element[lane].law);
    if (!any_constant) return work->g;

    memcpy(work->limit, work->g, sizeof(double) * (size_t)work->n_time * BD_LANES);
    for (int lane = 0; lane < n; ++lane) {
        if (!bd_law_is_constant(element[lane].law)) continue;
        for (int k = 0; k < work->n_time; ++k)
            work->limit[k * BD_LANES + lane] = element[lane].load;
    }
    return work->limit;
}

/* Force, tangent and shares of direction d of one point, whose motion is x (3, n_coef), from the
 * sums over its samples. The weight 2 pi/n_time of a sample turns all sums into integrals over the
 * cycle: integrals_of_lane applies it to the powers over the parts that stick and slip, the
 * statements below to the sums with the slider and its derivatives. The kernel differentiates the
 * slider by g = n0 + kn v; the factor kn gives the derivative by v. */
static void finish_lane(const bd_element *element, int d, int lane, const double *x,
                        bd_response *out, bd_status_share *share, bd_sampled_work *work) {
    static const double NO_SLIP = 1e-12; /* a share below this is rounding */
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_block = n_coef * n_coef;
    const double weight = BD_TWO_PI / work->n_time;
    const double *u = x + (size_t)d * n_coef, *v = x + BD_NORMAL * n_coef;
    bd_cycle cycle = {
        .n_harm = work->n_harm,
        .stick = work->stick,
        .slip = work->slip,
        .stick_slider = work->lanes.stick_slider + (size_t)lane * n_coef,
    };
    integrals_of_lane(work, work->lanes.stick, lane, work->stick);
    integrals_of_lane(work, work->lanes.slip, lane, work->slip);
    for (size_t i = 0; i < n_coef; ++i) cycle.stick_slider[i] *= weight;

    const int with_tangent = work->lanes.stick_slider_u != NULL;
    if (with_tangent) {
        double *slider_u = work->stick_slider_u + (size_t)lane * n_block;
        double *slider_g = work->stick_slider_g + (size_t)lane * n_block;
        for (size_t i = 0; i < n_block; ++i) slider_u[i] *= weight;
        const double weight_v = weight * element->kn; /* dg = kn dv */
        for (size_t i = 0; i < n_block; ++i) slider_g[i] *= weight_v;
        cycle.stick_slider_u = slider_u;
        cycle.stick_slider_v = slider_g; /* now with respect to v */
    }

    /* E_0 is the angle of the cycle over which the point sticks */
    share->stick[d] = cycle.stick[0] / BD_TWO_PI;
    share->slip[d] = 1.0 - share->stick[d] - share->open;
    if (share->slip[d] < NO_SLIP) share->slip[d] = 0.0;
    bd_cycle_friction(element, d, &cycle, u, v, out, work->scratch);
}

/* Prepare the sliders of direction d of n points: slope mu/kt, initial position, and -1 for "no
 * sample has set it". The slope is 0 for points without friction of this kind and for unused
 * lanes. Return whether any point has friction. */
static int load_friction(int n, const bd_element *element, int d, bd_lanes *lanes) {
    int any_friction = 0;
    for (int lane = 0; lane < BD_LANES; ++lane) {
        lanes->slope[lane] = 0.0;
        lanes->w[lane] = 0.0;
        lanes->origin[lane] = -1;
        if (lane >= n) continue;

        /* coupled friction has another kernel */
        const bd_element *e = element + lane;
        if (!bd_element_has_friction(e, d) || bd_law_is_coupled(e->law)) continue;
        lanes->slope[lane] = e->mu / e->kt[d];
        lanes->w[lane] = e->w[d];
        any_friction = 1;
    }
    return any_friction;
}

/* Return whether any sample (origin, -1: none) has set the slider of a point with friction. */
static int any_slider_moves(int n, const bd_lanes *lanes) {
    for (int lane = 0; lane < n; ++lane)
        if (lanes->slope[lane] > 0.0 && lanes->origin[lane] >= 0) return 1;
    return 0;
}

/* Sums over the steady cycle of all lanes: powers over samples that stick and slip, the slider
 * times the basis over samples that stick and, with a tangent, its derivatives. */
static void sum_steady_cycle(bd_sampled_work *work) {
    bd_lanes *lanes = &work->lanes;
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm);
    const size_t n_power = (size_t)bd_n_power(work->n_harm);
    const size_t power_bytes = sizeof(double) * n_power * BD_LANES;
    const size_t coef_bytes = sizeof(double) * n_coef * BD_LANES;
    memset(lanes->stick, 0, power_bytes);
    memset(lanes->slip, 0, power_bytes);
    memset(lanes->stick_slider, 0, coef_bytes);
    if (lanes->stick_slider_u) {
        memset(lanes->stick_slider_u, 0, coef_bytes * n_coef);
        memset(lanes->stick_slider_g, 0, coef_bytes * n_coef);
    }
    work->kernel->sum_cycle(lanes);
}

/* Force, tangent and shares of direction d of n points with the motion x (n, 3, n_coef): settle the
 * sliders in one period, and add up a second one. There are three kinds of points with friction:
 *
 *     a sample sets the slider, touching     sums over the second period
 *     a sample sets the slider, always open  no force, as initialised by bd_sampled_evaluate
 *     no sample sets the slider              it sticks throughout.
 *
 * Every open sample sets the slider, so a point of the last kind is closed throughout. */
static void tangential_direction(int n, const bd_element *element, int d, const double *x,
                                 bd_response *out, bd_status_share *share, bd_sampled_work *work) {
    const int n_power = bd_n_power(work->n_harm);
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm);
    const double *coefficients = work->x + (size_t)d * n_coef * BD_LANES;
    bd_lanes *lanes = &work->lanes;
    const int alone = n == 1; /* parts of the cycle are listed for a point alone */
    if (!load_friction(n, element, d, lanes)) return;

    work->kernel->lane_values((int)n_coef, work->n_time, work->power, n_power, coefficients,
                              work->u);
    work->kernel->settle(lanes);
    if (any_slider_moves(n, lanes)) {
        sum_steady_cycle(work);
        if (alone) list_parts(work, d);
    }
    for (int lane = 0; lane < n; ++lane) {
        const double *x_point = x + 3 * n_coef * (size_t)lane;
        const double *u = x_point + (size_t)d * n_coef;
        /* load_friction sets the slope mu/kt to 0 for points that this function leaves out */
        const int has_friction = lanes->slope[lane] != 0.0;
        /* origin is the sample that has set the slider last, -1 if none has */
        const int slider_was_set = lanes->origin[lane] >= 0;
        const int is_always_open = share[lane].open == 1.0;
        if (!has_friction) continue;

        if (!slider_was_set) {
            bd_element_stuck(element + lane, work->n_harm, d, u, out + lane);
            share[lane].stick[d] = 1.0;
            if (alone) whole_cycle(work, d, BD_STICK);
        } else if (!is_always_open) {
            finish_lane(element + lane, d, lane, x_point, out + lane, share + lane, work);
        }
    }
}

/* Forces and shares of a bonded point with the motion x (3, n_coef): linear springs in both
 * tangential directions. */
static void stick_throughout(const bd_element *element, int n_harm, const double *x,
                             bd_response *out, bd_status_share *share) {
    const size_t n_coef = (size_t)bd_n_coef(n_harm);
    for (int d = 0; d < 2; ++d) {
        bd_element_stuck(element, n_harm, d, x + (size_t)d * n_coef, out);
        share->stick[d] = 1.0;
    }
}

/* Forces, tangents and shares of n <= BD_LANES points with the motion x (n, 3, n_coef): normal
 * direction first, because it gives the load of both tangential directions. All points without
 * contact or friction keep the values that are set at the start. The pieces of the cycle are listed
 * only for a point that is evaluated alone. */
void bd_sampled_evaluate(int n, const bd_element *element, const double *x, bd_response *out,
                         bd_status_share *share, bd_sampled_work *work) {
    const int n_harm = work->n_harm;
    const size_t n_coef = (size_t)bd_n_coef(n_harm);
    const int with_tangent = out->dN != NULL;
    const int alone = n == 1; /* parts of the cycle are listed for a point alone */
    bd_status_share unused[BD_LANES];
    if (!share) share = unused;
    for (int lane = 0; lane < n; ++lane) {
        const double *x_point = x + 3 * n_coef * (size_t)lane;
        share[lane] = (bd_status_share){{0.0, 0.0}, {0.0, 0.0}, 0.0};
        bd_element_open(element + lane, n_harm, out + lane);
        if (element[lane].law == BD_LAW_BONDED)
            stick_throughout(element + lane, n_harm, x_point, out + lane, share + lane);
    }
    work->lanes.stick_slider_u = with_tangent ? work->stick_slider_u : NULL;
    work->lanes.stick_slider_g = with_tangent ? work->stick_slider_g : NULL;
    work->lanes.state = alone ? work->state : NULL;
    load_lanes(n, element, x, work);

    const int n_touching = normal_direction(n, element, x, out, share, work);
    /* one part of the cycle for a point alone; friction replaces it below where the point slips */
    for (int d = 0; d < 2 && alone; ++d) {
        const int has_state = bd_element_has_friction(element, d) || element->law == BD_LAW_BONDED;
        whole_cycle(work, d, n_touching ? BD_STICK : BD_OPEN);
        if (n_touching && !has_state) work->n_segment[d] = 0;
    }
    if (!n_touching) return;
    work->lanes.g = find_limit(n, element, work);
    for (int d = 0; d < 2; ++d) tangential_direction(n, element, d, x, out, share, work);
}
