/* Event-driven evaluation of 1-D friction with variable normal load, in two independent directions
 * (the friction model of the paper).
 *
 * N = max(n0 + kn v, 0), T = kt (u - w). Stick, slip and separation follow from one rule for the
 * slider:
 *
 *     in contact   w <- clip(w, lo, hi),
 *                  lo = u - (mu/kt)(n0 + kn v),   hi = u + (mu/kt)(n0 + kn v)
 *     open         w = u
 *
 * lo and hi are trigonometric polynomials. The roots of n0 + kn v, lo' and hi' are the events; they
 * divide the period into pieces (event_slider.c). A point that neither slips nor opens has its
 * initial slider, or, if this lies outside [max lo, min hi], the nearer end of the interval.
 *
 * With a constant normal load the bounds are u -+ mu load/kt, and the contact stays closed.
 *
 * Cheap bounds come first. A function is at most the sum of its amplitudes, and exceeds its samples
 * by at most h^2/8 max|f''|. These bounds identify most points that never slip or never open,
 * without any root. */
#include "contact/event_driven.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

bd_status bd_event_create(bd_event_work *work, int n_harm) {
    memset(work, 0, sizeof *work);
    work->kernel = bd_kernel_get();
    if (!work->kernel || n_harm < 1 || n_harm > BD_MAX_HARM) return BD_BAD_ARGUMENT;
    const size_t h = (size_t)n_harm, n_coef = (size_t)bd_n_coef(n_harm),
                 n_power = (size_t)bd_n_power(n_harm);
    const size_t n_time = 16 * h + 16, n_event = 6 * h, n_segment = 2 * n_event + 4;
    bd_status status = bd_trig_grid_create(&work->grid, n_harm, (int)n_time);
    if (status != BD_OK) return status;
    const size_t n_double =
        11 * n_time + 11 * n_coef + 5 * n_event + 6 * n_power + 3 * n_coef * n_coef + 2 * n_coef;
    work->memory = malloc(sizeof(double) * n_double);
    work->order = malloc(sizeof(int) * 2 * n_event);
    work->segment[0] = malloc(sizeof(bd_segment) * 2 * n_segment);
    if (!work->memory || !work->order || !work->segment[0]) {
        bd_event_destroy(work);
        return BD_NO_MEMORY;
    }
    work->n_harm = n_harm;
    double *p = work->memory;
    work->motion = p, p += 3 * n_time;
    work->dmotion = p, p += 3 * n_time;
    work->ddmotion = p, p += 3 * n_time;
    work->value = p, p += n_time;
    work->slope = p, p += n_time;
    work->dx = p, p += 3 * n_coef;
    work->ddx = p, p += 3 * n_coef;
    work->polynomial = p, p += 5 * n_coef;
    work->event_theta = p, p += n_event;
    work->event_z = p, p += 2 * n_event;
    work->event_lo = p, p += n_event;
    work->event_hi = p, p += n_event;
    work->power[0] = p, p += n_power;
    work->power[1] = p, p += n_power;
    work->contact = p, p += n_power;
    work->part_sum = p, p += n_power;
    work->cycle.stick = p, p += n_power;
    work->cycle.slip = p, p += n_power;
    work->cycle.stick_slider = p, p += n_coef;
    work->slider_v = p, p += n_coef;
    work->scratch = p, p += n_coef * n_coef;
    work->stick_slider_u = p, p += n_coef * n_coef;
    work->stick_slider_v = p;
    work->cycle.n_harm = n_harm;
    work->piece = work->order + n_event;
    work->segment[1] = work->segment[0] + n_segment;
    return BD_OK;
}

void bd_event_destroy(bd_event_work *work) {
    if (!work) return;
    bd_trig_grid_destroy(&work->grid);
    free(work->memory);
    free(work->order);
    free(work->segment[0]);
    memset(work, 0, sizeof *work);
}

/* Bound h^2/8 max|x''| between samples of x. */
static double between_samples(const bd_event_work *work, const double *x) {
    const double h = BD_TWO_PI / work->grid.n_time;
    double sum = 0.0;
    for (int l = 1; l <= work->n_harm; ++l)
        sum += l * l * sqrt(x[2 * l - 1] * x[2 * l - 1] + x[2 * l] * x[2 * l]);
    return 0.125 * h * h * sum;
}

/* Compute the derivatives of u1, u2 and v, and their samples, when roots are first needed. */
static void find_derivatives(bd_event_work *work, const double *x) {
    if (work->derivatives_known) return;
    const int n_harm = work->n_harm, n_coef = bd_n_coef(n_harm), n_time = work->grid.n_time;
    for (int a = 0; a < 3; ++a) {
        bd_trig_derivative(n_harm, x + a * n_coef, work->dx + a * n_coef);
        bd_trig_derivative(n_harm, work->dx + a * n_coef, work->ddx + a * n_coef);
    }
    work->derivatives_known = 1;
    if (n_harm == 1) return;
    work->kernel->grid_values(n_coef, n_time, work->grid.basis, 3, work->dx, work->dmotion);
    work->kernel->grid_values(n_coef, n_time, work->grid.basis, 3, work->ddx, work->ddmotion);
}

/* ---- normal direction ---- */

/* Sign of n0 + kn v over the cycle. */
enum { CLOSED_ALWAYS, OPEN_ALWAYS, CHANGES };

/* State of contact from bounds on the amplitude and from samples; CHANGES if
 * these are inconclusive. */
static int bound_contact(const bd_element *element, const double *v, bd_event_work *work) {
    const double level = element->n0 + element->kn * v[0],
                 swing = element->kn * bd_trig_amplitude(work->n_harm, v);
    /* n0 = 0 without motion also counts as open: force and tangent are zero */
    if (level <= -swing) return OPEN_ALWAYS;
    if (level >= swing) return CLOSED_ALWAYS;
    if (work->n_harm == 1) return CHANGES;
    double most, least;
    const double *sample = work->motion + 2 * work->grid.n_time,
                 margin = element->kn * between_samples(work, v);
    work->kernel->bounds(work->grid.n_time, 0.0, sample, sample, &most, &least);
    if (element->n0 + element->kn * least > margin) return CLOSED_ALWAYS;
    if (element->n0 + element->kn * most < -margin) return OPEN_ALWAYS;
    return CHANGES;
}

/* Roots of n0 + kn v (stored in work->polynomial) as events 0 .. n_lift-1; return their number. */
static int find_lifts(const bd_element *element, const double *x, bd_event_work *work) {
    const int n_harm = work->n_harm, n_coef = bd_n_coef(n_harm), n_time = work->grid.n_time;
    const double *v = x + 2 * n_coef;
    double *g = work->polynomial;
    for (int i = 0; i < n_coef; ++i) g[i] = element->kn * v[i];
    g[0] += element->n0;
    find_derivatives(work, x);
    for (int k = 0; k < n_time && n_harm > 1; ++k) {
        work->value[k] = element->n0 + element->kn * work->motion[2 * n_time + k];
        work->slope[k] = element->kn * work->dmotion[2 * n_time + k];
    }
    return bd_trig_roots_with_powers(&work->grid, g, work->value, work->slope, work->event_theta,
                                     work->event_z);
}

static double lift_length(const bd_event_work *work, int n_lift, int e) {
    return e + 1 < n_lift ? work->event_theta[e + 1] - work->event_theta[e]
                          : work->event_theta[0] + BD_TWO_PI - work->event_theta[e];
}

/* Return whether the part after the first lift-off or closing is in contact. The parts alternate,
 * so the sign in the middle of the longest part decides: two events may coincide if the contact
 * only touches. */
static int contact_follows_first(const bd_event_work *work, int n_lift) {
    int longest = 0;
    for (int e = 1; e < n_lift; ++e)
        if (lift_length(work, n_lift, e) > lift_length(work, n_lift, longest)) longest = e;
    const double value = bd_clear_value(work->n_harm, work->polynomial, work->event_theta[longest],
                                        lift_length(work, n_lift, longest));
    return longest % 2 == 0 ? value > 0.0 : !(value > 0.0);
}

/* Sums over the parts in contact, between consecutive events; contact_first: part 0 (from event 0)
 * is in contact. */
static void integrate_contact(bd_event_work *work, int n_lift, int contact_first,
                              bd_status_share *share) {
    memset(work->contact, 0, sizeof(double) * (size_t)bd_n_power(work->n_harm));
    for (int e = contact_first ? 0 : 1; e < n_lift; e += 2) {
        const int next = (e + 1) % n_lift;
        bd_trig_powers_of(2 * work->n_harm, work->event_z + 2 * e, work->power[0]);
        bd_trig_powers_of(2 * work->n_harm, work->event_z + 2 * next, work->power[1]);
        bd_cycle_integrate(work->n_harm, work->contact, lift_length(work, n_lift, e),
                           work->power[0], work->power[1], 1.0);
    }
    share->open = 1.0 - work->contact[0] / BD_TWO_PI;
}

/* ---- events of one tangential direction ---- */

/* Compute lo, hi and their derivatives; return whether bounds prove that w stays inside. */
static int find_bounds(const bd_element *element, int d, const double *u, const double *v,
                       bd_direction *dir) {
    const int n_coef = dir->n_coef, constant = bd_law_is_constant(element->law);
    bd_event_work *work = dir->work;
    double *lo = work->polynomial + n_coef, *hi = lo + n_coef, *dlo = hi + n_coef,
           *dhi = dlo + n_coef;
    const double shift =
        element->mu * (constant ? fmax(element->load, 0.0) : element->n0) / element->kt[d];
    const double w = element->w[d];
    dir->r = constant ? 0.0 : element->mu * element->kn / element->kt[d];
    for (int i = 0; i < n_coef; ++i) {
        lo[i] = u[i] - dir->r * v[i];
        hi[i] = u[i] + dir->r * v[i];
    }
    lo[0] -= shift;
    hi[0] += shift;
    dir->lo = lo, dir->hi = hi, dir->dlo = dlo, dir->dhi = dhi;
    if (dir->n_lift > 0) return 0;
    if (lo[0] + bd_trig_amplitude(dir->n_harm, lo) <= w &&
        hi[0] - bd_trig_amplitude(dir->n_harm, hi) >= w)
        return 1;
    if (dir->n_harm == 1) return 0;
    double most, least;
    const int n_time = work->grid.n_time;
    work->kernel->bounds(n_time, dir->r, work->motion + d * n_time, work->motion + 2 * n_time,
                         &most, &least);
    return most - shift + between_samples(work, lo) <= w &&
           least + shift - between_samples(work, hi) >= w;
}

/* Extrema of lo and hi become events after the lift-offs and closings. There slip ends: slip to
 * stick is a root of lo' or of hi'. */
static void find_extrema(bd_direction *dir, int d) {
    bd_event_work *work = dir->work;
    const int n_time = work->grid.n_time, n_coef = dir->n_coef;
    double *dlo = work->polynomial + 3 * n_coef, *dhi = dlo + n_coef;
    const double *du = work->dx + d * n_coef, *dv = work->dx + 2 * n_coef, r = dir->r;
    const double *su = work->dmotion + d * n_time, *sv = work->dmotion + 2 * n_time;
    const double *ssu = work->ddmotion + d * n_time, *ssv = work->ddmotion + 2 * n_time;
    for (int i = 0; i < n_coef; ++i) {
        dlo[i] = du[i] - r * dv[i];
        dhi[i] = du[i] + r * dv[i];
    }
    for (int k = 0; k < n_time && dir->n_harm > 1; ++k) {
        work->value[k] = su[k] - r * sv[k];
        work->slope[k] = ssu[k] - r * ssv[k];
    }
    const int at = dir->n_lift;
    dir->n_lo = bd_trig_roots_with_powers(&work->grid, dlo, work->value, work->slope,
                                          work->event_theta + at, work->event_z + 2 * at);
    dir->n_event = at + dir->n_lo;
    dir->common = r == 0.0;
    if (dir->common) return;
    for (int k = 0; k < n_time && dir->n_harm > 1; ++k) {
        work->value[k] = su[k] + r * sv[k];
        work->slope[k] = ssu[k] + r * ssv[k];
    }
    dir->n_event += bd_trig_roots_with_powers(&work->grid, dhi, work->value, work->slope,
                                              work->event_theta + dir->n_event,
                                              work->event_z + 2 * dir->n_event);
}

/* ---- one tangential direction ---- */

/* lo and hi are constant: the slider is the initial one clipped to [lo, hi]. */
static void add_constant_bounds(const bd_direction *dir, int d, const bd_element *element,
                                bd_status_share *share) {
    bd_event_work *work = dir->work;
    const double lo = dir->lo[0], hi = dir->hi[0], initial = element->w[d];
    const double w = initial < lo ? lo : initial > hi ? hi : initial;
    double *one = work->power[0];
    memset(one, 0, sizeof(double) * (size_t)dir->n_coef);
    memset(work->slider_v, 0, sizeof(double) * (size_t)dir->n_coef);
    one[0] = 1.0;
    work->slider_v[0] = initial < lo ? -dir->r : initial > hi ? dir->r : 0.0;
    work->cycle.stick[0] = work->cycle.stick[1] = BD_TWO_PI;
    bd_cycle_add_stick(&work->cycle, work->cycle.stick + 1, w, w == initial ? NULL : one,
                       work->slider_v);
    bd_slider_whole_cycle(work, d, BD_STICK);
    share->stick[d] = 1.0;
}

static void stay_stuck(const bd_element *element, int d, const double *u, bd_response *out,
                       bd_status_share *share, bd_event_work *work) {
    bd_element_stuck(element, work->n_harm, d, u, out);
    bd_slider_whole_cycle(work, d, BD_STICK);
    share->stick[d] = 1.0;
}

static void evaluate_direction(const bd_element *element, int d, int n_lift, const double *x,
                               bd_response *out, bd_status_share *share, bd_event_work *work) {
    const int n_coef = bd_n_coef(work->n_harm);
    const double *u = x + d * n_coef, *v = x + 2 * n_coef;
    bd_direction dir = {.n_harm = work->n_harm,
                        .n_coef = n_coef,
                        .n_power = bd_n_power(work->n_harm),
                        .n_lift = n_lift,
                        .work = work};
    if (find_bounds(element, d, u, v, &dir)) {
        stay_stuck(element, d, u, out, share, work);
        return;
    }
    find_derivatives(work, x);
    find_extrema(&dir, d);
    bd_cycle_clear(&work->cycle);
    if (dir.n_event == 0) {
        add_constant_bounds(&dir, d, element, share);
        bd_cycle_friction(element, d, &work->cycle, u, v, out, work->scratch);
        return;
    }
    if (!bd_slider_cycle(&dir, d, element, v, share)) {
        stay_stuck(element, d, u, out, share, work);
        return;
    }
    bd_cycle_friction(element, d, &work->cycle, u, v, out, work->scratch);
}

/* Normal force; return the number of lift-offs and closings, which are events 0, 1, ... */
static int evaluate_normal(const bd_element *element, const double *x, bd_response *out,
                           bd_status_share *share, bd_event_work *work) {
    const double *v = x + 2 * bd_n_coef(work->n_harm);
    if (bd_law_is_two_sided(element->law)) {
        bd_element_closed(element, work->n_harm, v, out);
        return 0;
    }
    const int bound = bound_contact(element, v, work),
              n_lift = bound == CHANGES ? find_lifts(element, x, work) : 0;
    if (n_lift > 0) {
        integrate_contact(work, n_lift, contact_follows_first(work, n_lift), share);
        bd_cycle_normal(element, work->n_harm, work->contact, v, out, work->scratch);
        return n_lift;
    }
    if (bound == OPEN_ALWAYS ||
        (bound == CHANGES && bd_clear_value(work->n_harm, work->polynomial, 0.0, BD_TWO_PI) <= 0.0))
        share->open = 1.0;
    else
        bd_element_closed(element, work->n_harm, v, out);
    return 0;
}

void bd_event_evaluate(const bd_element *element, const double *x, bd_response *out,
                       bd_status_share *share, bd_event_work *work) {
    const int n_harm = work->n_harm, n_coef = bd_n_coef(n_harm);
    bd_status_share unused;
    if (!share) share = &unused;
    *share = (bd_status_share){{0.0, 0.0}, {0.0, 0.0}, 0.0};
    work->n_segment[0] = work->n_segment[1] = 0;
    work->derivatives_known = 0;
    work->cycle.stick_slider_u = out->dN ? work->stick_slider_u : NULL;
    work->cycle.stick_slider_v = out->dN ? work->stick_slider_v : NULL;
    bd_element_open(element, n_harm, out);
    if (n_harm > 1 && element->law != BD_LAW_BONDED)
        work->kernel->grid_values(n_coef, work->grid.n_time, work->grid.basis, 3, x, work->motion);
    const int n_lift = evaluate_normal(element, x, out, share, work);
    for (int d = 0; d < 2; ++d) {
        if (element->law == BD_LAW_BONDED) stay_stuck(element, d, x + d * n_coef, out, share, work);
        if (share->open == 1.0) bd_slider_whole_cycle(work, d, BD_OPEN);
        if (bd_element_has_friction(element, d) && share->open < 1.0)
            evaluate_direction(element, d, n_lift, x, out, share, work);
    }
}
