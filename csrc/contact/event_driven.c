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

#include "util/storage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Rows of work->polynomial (5, n_coef): n0 + kn v, the bounds of the slider, their derivatives. */
enum { NORMAL_LOAD, LO, HI, DLO, DHI, N_POLYNOMIAL };

bd_status bd_event_create(bd_event_work *work, int n_harm) {
    memset(work, 0, sizeof *work);
    work->kernel = bd_kernel_get();
    if (!work->kernel || n_harm < 1 || n_harm > BD_MAX_HARM) return BD_BAD_ARGUMENT;

    const size_t h = (size_t)n_harm;
    const size_t n_coef = (size_t)bd_n_coef(n_harm);
    const size_t n_power = (size_t)bd_n_power(n_harm);
    const size_t n_time = 16 * h + 16;
    const size_t n_event = 6 * h;             /* three polynomials with 2 h roots each */
    const size_t n_segment = 2 * n_event + 4; /* at most one onset of slip between two events */
    const bd_status status = bd_trig_grid_create(&work->grid, n_harm, (int)n_time);
    if (status != BD_OK) return status;

    const size_t n_double =
        11 * n_time + 13 * n_coef + 5 * n_event + 6 * n_power + 3 * n_coef * n_coef;
    work->memory = malloc(sizeof(double) * n_double);
    work->order = malloc(sizeof(int) * 2 * n_event);
    work->segment[0] = malloc(sizeof(bd_segment) * 2 * n_segment);
    if (!work->memory || !work->order || !work->segment[0]) {
        bd_event_destroy(work);
        return BD_NO_MEMORY;
    }
    work->piece = work->order + n_event;
    work->segment[1] = work->segment[0] + n_segment;
    work->n_harm = n_harm;
    work->cycle.n_harm = n_harm;

    double *rest = work->memory;
    work->motion = bd_take(&rest, 3 * n_time);
    work->dmotion = bd_take(&rest, 3 * n_time);
    work->ddmotion = bd_take(&rest, 3 * n_time);
    work->value = bd_take(&rest, n_time);
    work->slope = bd_take(&rest, n_time);
    work->dx = bd_take(&rest, 3 * n_coef);
    work->ddx = bd_take(&rest, 3 * n_coef);
    work->polynomial = bd_take(&rest, N_POLYNOMIAL * n_coef);
    work->event_theta = bd_take(&rest, n_event);
    work->event_z = bd_take(&rest, 2 * n_event);
    work->event_lo = bd_take(&rest, n_event);
    work->event_hi = bd_take(&rest, n_event);
    work->power[0] = bd_take(&rest, n_power);
    work->power[1] = bd_take(&rest, n_power);
    work->contact = bd_take(&rest, n_power);
    work->part_sum = bd_take(&rest, n_power);
    work->cycle.stick = bd_take(&rest, n_power);
    work->cycle.slip = bd_take(&rest, n_power);
    work->cycle.stick_slider = bd_take(&rest, n_coef);
    work->slider_v = bd_take(&rest, n_coef);
    work->scratch = bd_take(&rest, n_coef * n_coef);
    work->stick_slider_u = bd_take(&rest, n_coef * n_coef);
    work->stick_slider_v = bd_take(&rest, n_coef * n_coef);
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

/* Bound h^2/8 max|x''| on the amount by which a trigonometric polynomial x (n_coef) exceeds its
 * samples on the grid of step h between them. |x''| is at most the sum of its amplitudes, l^2 times
 * those of the harmonics l of x. */
static double between_samples(const bd_event_work *work, const double *x) {
    const double h = BD_TWO_PI / work->grid.n_time;
    double bound = 0.0; /* of |x''| */
    for (int l = 1; l <= work->n_harm; ++l) {
        const double c = x[2 * l - 1], s = x[2 * l];
        bound += l * l * sqrt(c * c + s * s);
    }
    return 0.125 * h * h * bound;
}

/* Derivatives of the motion x (3, n_coef), u1, u2 and v: coefficients dx and ddx (3, n_coef), and
 * samples dmotion and ddmotion (3, n_time) on the grid. They are computed when roots are first
 * needed; for one harmonic, roots have a closed form that needs no samples. */
static void find_derivatives(bd_event_work *work, const double *x) {
    if (work->derivatives_known) return;
    const int n_harm = work->n_harm, n_coef = bd_n_coef(n_harm), n_time = work->grid.n_time;
    const double *basis = work->grid.basis;
    for (int a = 0; a < BD_N_COMPONENT; ++a) {
        const int first = a * n_coef;
        bd_trig_derivative(n_harm, x + first, work->dx + first);
        bd_trig_derivative(n_harm, work->dx + first, work->ddx + first);
    }
    work->derivatives_known = 1;
    if (n_harm == 1) return;
    work->kernel->grid_values(n_coef, n_time, basis, BD_N_COMPONENT, work->dx, work->dmotion);
    work->kernel->grid_values(n_coef, n_time, basis, BD_N_COMPONENT, work->ddx, work->ddmotion);
}

/* ---- normal direction ---- */

/* Sign of n0 + kn v over the cycle. */
enum { CLOSED_ALWAYS, OPEN_ALWAYS, CHANGES };

/* State of contact from bounds of n0 + kn v over the cycle: first its mean -+ the sum of its
 * amplitudes. For several harmonics, the samples -+ the bound of between_samples follow. CHANGES if
 * the bounds have different signs, although the function may have one sign. */
static int bound_contact(const bd_element *element, const double *v, bd_event_work *work) {
    const int n_time = work->grid.n_time;
    const double n0 = element->n0, kn = element->kn;
    const double mean = n0 + kn * v[0];
    const double amplitude = kn * bd_trig_amplitude(work->n_harm, v);
    /* n0 = 0 without motion also counts as open: force and tangent are zero */
    if (mean <= -amplitude) return OPEN_ALWAYS;
    if (mean >= amplitude) return CLOSED_ALWAYS;
    if (work->n_harm == 1) return CHANGES; /* the sum of its amplitudes is the exact bound */

    double largest_v, smallest_v;
    const double *v_sample = work->motion + BD_NORMAL * n_time;
    const double margin = kn * between_samples(work, v);
    work->kernel->bounds(n_time, 0.0, v_sample, v_sample, &largest_v, &smallest_v);
    if (n0 + kn * smallest_v > margin) return CLOSED_ALWAYS;
    if (n0 + kn * largest_v < -margin) return OPEN_ALWAYS;
    return CHANGES;
}

/* Lift-offs and closings: the roots of n0 + kn v, with the motion v of x (3, n_coef), become events
 * 0 .. n_lift-1. Return their number. For several harmonics, the root finder needs samples of the
 * polynomial and of its derivative. */
static int find_lifts(const bd_element *element, const double *x, bd_event_work *work) {
    const int n_harm = work->n_harm, n_coef = bd_n_coef(n_harm), n_time = work->grid.n_time;
    const double n0 = element->n0, kn = element->kn;
    const double *v = x + BD_NORMAL * n_coef;
    double *g = work->polynomial + NORMAL_LOAD * n_coef;
    for (int i = 0; i < n_coef; ++i) g[i] = kn * v[i];
    g[0] += n0;
    find_derivatives(work, x);
    if (n_harm > 1) {
        const double *v_sample = work->motion + BD_NORMAL * n_time;
        const double *dv_sample = work->dmotion + BD_NORMAL * n_time;
        for (int k = 0; k < n_time; ++k) {
            work->value[k] = n0 + kn * v_sample[k];
            work->slope[k] = kn * dv_sample[k];
        }
    }
    return bd_trig_roots_with_powers(&work->grid, g, work->value, work->slope, work->event_theta,
                                     work->event_z);
}

/* Angle from event e of the n_lift lift-offs and closings, sorted by angle, to the next event. */
static double lift_length(const bd_event_work *work, int n_lift, int e) {
    const double *theta = work->event_theta;
    const double end = e + 1 < n_lift ? theta[e + 1] : theta[0] + BD_TWO_PI;
    return end - theta[e];
}

/* Return whether the part after the first lift-off or closing is in contact. The parts alternate,
 * so the sign in the middle of the longest part decides: two events may coincide if the contact
 * only touches. */
static int contact_follows_first(const bd_event_work *work, int n_lift) {
    int longest = 0;
    double length = lift_length(work, n_lift, 0);
    for (int e = 1; e < n_lift; ++e) {
        const double l = lift_length(work, n_lift, e);
        if (l > length) {
            length = l;
            longest = e;
        }
    }
    const double *g = work->polynomial; /* n0 + kn v */
    const double start = work->event_theta[longest];
    const int in_contact = bd_clear_value(work->n_harm, g, start, length) > 0.0;
    const int same_as_first = longest % 2 == 0;
    return same_as_first ? in_contact : !in_contact;
}

/* Sums E_n = int exp(i n theta) over the parts in contact (work->contact), and the share of the
 * cycle without contact. Part e reaches from event e of the n_lift lift-offs and closings to the
 * next; every second part is in contact, beginning with part 0 if contact_first. */
static void integrate_contact(bd_event_work *work, int n_lift, int contact_first,
                              bd_status_share *share) {
    const int n_harm = work->n_harm;
    double *start = work->power[0], *end = work->power[1];
    memset(work->contact, 0, sizeof(double) * (size_t)bd_n_power(n_harm));
    for (int e = contact_first ? 0 : 1; e < n_lift; e += 2) {
        const int next = (e + 1) % n_lift;
        const double length = lift_length(work, n_lift, e);
        bd_trig_powers_of(2 * n_harm, work->event_z + 2 * e, start);
        bd_trig_powers_of(2 * n_harm, work->event_z + 2 * next, end);
        bd_cycle_integrate(n_harm, work->contact, length, start, end, 1.0);
    }
    share->open = 1.0 - work->contact[0] / BD_TWO_PI;
}

/* ---- events of one tangential direction ---- */

/* Polynomials of direction d (n_coef each), between which the slider w lies in contact:
 *
 *     lo = u - (shift + r v),   hi = u + (shift + r v),   shift = mu n0/kt,   r = mu kn/kt;
 *
 * under a constant load shift = mu load/kt and r = 0. Return whether max lo <= w <= min hi is
 * certain for the initial slider w, which then never slips. The mean and the sum of the amplitudes
 * bound lo and hi. For several harmonics, samples of u -+ r v and the bound of between_samples are
 * closer. Their derivatives get their places in work->polynomial, but no values. */
static int find_bounds(const bd_element *element, int d, const double *u, const double *v,
                       bd_direction *dir) {
    const int n_harm = dir->n_harm, n_coef = dir->n_coef;
    const int constant_load = bd_law_is_constant(element->law);
    const double kt = element->kt[d], kn = element->kn, mu = element->mu, w = element->w[d];
    bd_event_work *work = dir->work;
    double *lo = work->polynomial + LO * n_coef, *hi = work->polynomial + HI * n_coef;
    dir->lo = lo;
    dir->hi = hi;
    dir->dlo = work->polynomial + DLO * n_coef;
    dir->dhi = work->polynomial + DHI * n_coef;

    const double load = constant_load ? fmax(element->load, 0.0) : element->n0;
    const double shift = mu * load / kt;
    const double r = constant_load ? 0.0 : mu * kn / kt;
    dir->r = r;
    for (int i = 0; i < n_coef; ++i) {
        lo[i] = u[i] - r * v[i];
        hi[i] = u[i] + r * v[i];
    }
    lo[0] -= shift;
    hi[0] += shift;
    if (dir->n_lift > 0) return 0; /* a closing sets the slider */

    const double largest_lo = lo[0] + bd_trig_amplitude(n_harm, lo);
    const double smallest_hi = hi[0] - bd_trig_amplitude(n_harm, hi);
    if (largest_lo <= w && smallest_hi >= w) return 1;
    if (n_harm == 1) return 0; /* the sum of its amplitudes is the exact bound */

    double largest_difference, smallest_sum; /* of u - r v and u + r v */
    const int n_time = work->grid.n_time;
    const double *u_sample = work->motion + d * n_time;
    const double *v_sample = work->motion + BD_NORMAL * n_time;
    work->kernel->bounds(n_time, r, u_sample, v_sample, &largest_difference, &smallest_sum);
    const int above_lo = largest_difference - shift + between_samples(work, lo) <= w;
    const int below_hi = smallest_sum + shift - between_samples(work, hi) >= w;
    return above_lo && below_hi;
}

/* Extrema of the bound u + factor v of the slider (lo with factor -r, hi with r): the roots of
 *
 *     f = u' + factor v'
 *
 * are appended to the events, from dir->n_event on. Return their number. f (n_coef) receives the
 * coefficients. For one harmonic the roots have a closed form; for more, the root finder also needs
 * samples (n_time) of f and of its slope f'. Derivatives are stored as rows for u1, u2 and v, of
 * which u is row d and v row BD_NORMAL. */
static int find_extrema_of_bound(bd_direction *dir, int d, double factor, double *f) {
    bd_event_work *work = dir->work;
    const int n_time = work->grid.n_time, n_coef = dir->n_coef;
    const double *du = work->dx + d * n_coef, *dv = work->dx + BD_NORMAL * n_coef;
    for (int i = 0; i < n_coef; ++i) f[i] = du[i] + factor * dv[i];
    if (dir->n_harm > 1) {
        const double *du_sample = work->dmotion + d * n_time;
        const double *dv_sample = work->dmotion + BD_NORMAL * n_time;
        const double *ddu_sample = work->ddmotion + d * n_time;
        const double *ddv_sample = work->ddmotion + BD_NORMAL * n_time;
        for (int k = 0; k < n_time; ++k) {
            work->value[k] = du_sample[k] + factor * dv_sample[k];
            work->slope[k] = ddu_sample[k] + factor * ddv_sample[k];
        }
    }
    /* angles of the roots, and exp(i theta) as cosine and sine */
    double *theta = work->event_theta + dir->n_event, *z = work->event_z + 2 * dir->n_event;
    return bd_trig_roots_with_powers(&work->grid, f, work->value, work->slope, theta, z);
}

/* Extrema of the bounds lo and hi of the slider become events after the lift-offs and closings,
 * because slip ends where the bound that pushes the slider stops: slip-to-stick is a root of lo' or
 * of hi'. */
static void find_extrema(bd_direction *dir, int d) {
    double *dlo = dir->work->polynomial + DLO * dir->n_coef;
    double *dhi = dir->work->polynomial + DHI * dir->n_coef;
    dir->n_event = dir->n_lift;
    dir->n_lo = find_extrema_of_bound(dir, d, -dir->r, dlo);
    dir->n_event += dir->n_lo;

    /* under a constant load lo and hi differ by a constant */
    dir->common = dir->r == 0.0;
    if (dir->common)
        memcpy(dhi, dlo, sizeof(double) * (size_t)dir->n_coef);
    else
        dir->n_event += find_extrema_of_bound(dir, d, dir->r, dhi);
}

/* ---- one tangential direction ---- */

/* Sticking cycle with constant bounds lo and hi (u and v do not vibrate): the slider is the initial
 * one clipped to [lo, hi]. A clipped slider w = u0 -+ (shift + r v0) has the derivative 1 with
 * respect to the mean u0, and -+ r with respect to the mean v0. */
static void add_constant_bounds(const bd_direction *dir, int d, const bd_element *element,
                                bd_status_share *share) {
    bd_event_work *work = dir->work;
    bd_cycle *cycle = &work->cycle;
    const double lo = dir->lo[0], hi = dir->hi[0];
    double w = element->w[d], dw_dv = 0.0;
    int is_clipped = 1;
    if (w < lo) {
        w = lo;
        dw_dv = -dir->r;
    } else if (w > hi) {
        w = hi;
        dw_dv = dir->r;
    } else {
        is_clipped = 0;
    }

    /* derivatives with respect to the coefficients of u and v, and E_0 = 2 pi */
    double *slider_u = work->power[0], *slider_v = work->slider_v;
    memset(slider_u, 0, sizeof(double) * (size_t)dir->n_coef);
    memset(slider_v, 0, sizeof(double) * (size_t)dir->n_coef);
    slider_u[0] = 1.0;
    slider_v[0] = dw_dv;
    cycle->stick[0] = cycle->stick[1] = BD_TWO_PI;
    bd_cycle_add_stick(cycle, cycle->stick + 1, w, is_clipped ? slider_u : NULL, slider_v);
    bd_slider_whole_cycle(work, d, BD_STICK);
    share->stick[d] = 1.0;
}

/* The slider stays at its initial position. */
static void stay_stuck(const bd_element *element, int d, const double *u, bd_response *out,
                       bd_status_share *share, bd_event_work *work) {
    bd_element_stuck(element, work->n_harm, d, u, out);
    bd_slider_whole_cycle(work, d, BD_STICK);
    share->stick[d] = 1.0;
}

/* Force and tangent of direction d of a point that is in contact during at least a part of the
 * cycle, with the motion x (3, n_coef). Three cases follow from the bounds lo and hi of the slider:
 * they leave the initial slider in place; they are constant; or they have events, between which
 * bd_slider_cycle finds stick and slip. */
static void evaluate_direction(const bd_element *element, int d, int n_lift, const double *x,
                               bd_response *out, bd_status_share *share, bd_event_work *work) {
    const int n_coef = bd_n_coef(work->n_harm);
    const double *u = x + d * n_coef, *v = x + BD_NORMAL * n_coef;
    bd_direction dir = {
        .n_harm = work->n_harm,
        .n_coef = n_coef,
        .n_power = bd_n_power(work->n_harm),
        .n_lift = n_lift,
        .work = work,
    };
    const int stays = find_bounds(element, d, u, v, &dir);
    if (stays) {
        stay_stuck(element, d, u, out, share, work);
        return;
    }
    find_derivatives(work, x);
    find_extrema(&dir, d);
    bd_cycle_clear(&work->cycle);
    if (dir.n_event == 0) {
        add_constant_bounds(&dir, d, element, share);
    } else if (!bd_slider_cycle(&dir, d, element, v, share)) {
        stay_stuck(element, d, u, out, share, work);
        return;
    }
    bd_cycle_friction(element, d, &work->cycle, u, v, out, work->scratch);
}

/* Normal force N = max(n0 + kn v, 0) and its tangent for the motion x (3, n_coef), and the share of
 * the cycle without contact. Return the number of lift-offs and closings, which are events 0, 1,
 * ... */
static int evaluate_normal(const bd_element *element, const double *x, bd_response *out,
                           bd_status_share *share, bd_event_work *work) {
    const int n_harm = work->n_harm;
    const double *v = x + BD_NORMAL * bd_n_coef(n_harm);
    if (bd_law_is_two_sided(element->law)) {
        bd_element_closed(element, n_harm, v, out);
        return 0;
    }
    const int bound = bound_contact(element, v, work);
    const int n_lift = bound == CHANGES ? find_lifts(element, x, work) : 0;
    if (n_lift > 0) {
        integrate_contact(work, n_lift, contact_follows_first(work, n_lift), share);
        bd_cycle_normal(element, n_harm, work->contact, v, out, work->scratch);
        return n_lift;
    }

    /* without events n0 + kn v has one sign, which bounds or else a value decide */
    int is_open = bound == OPEN_ALWAYS;
    if (bound == CHANGES) is_open = bd_clear_value(n_harm, work->polynomial, 0.0, BD_TWO_PI) <= 0.0;
    if (is_open)
        share->open = 1.0;
    else
        bd_element_closed(element, n_harm, v, out);
    return 0;
}

/* Normal direction first, because its lift-offs and closings are events of both tangential ones. A
 * bonded point has springs without friction. */
void bd_event_evaluate(const bd_element *element, const double *x, bd_response *out,
                       bd_status_share *share, bd_event_work *work) {
    const int n_harm = work->n_harm, n_coef = bd_n_coef(n_harm);
    const int is_bonded = element->law == BD_LAW_BONDED;
    const int with_tangent = out->dN != NULL;
    bd_status_share unused;
    if (!share) share = &unused;
    *share = (bd_status_share){{0.0, 0.0}, {0.0, 0.0}, 0.0};
    work->n_segment[0] = work->n_segment[1] = 0;
    work->derivatives_known = 0;
    work->cycle.stick_slider_u = with_tangent ? work->stick_slider_u : NULL;
    work->cycle.stick_slider_v = with_tangent ? work->stick_slider_v : NULL;
    bd_element_open(element, n_harm, out);
    if (n_harm > 1 && !is_bonded)
        work->kernel->grid_values(n_coef, work->grid.n_time, work->grid.basis, BD_N_COMPONENT, x,
                                  work->motion);

    const int n_lift = evaluate_normal(element, x, out, share, work);
    for (int d = 0; d < 2; ++d) {
        const double *u = x + d * n_coef;
        if (is_bonded) stay_stuck(element, d, u, out, share, work);
        if (share->open == 1.0)
            bd_slider_whole_cycle(work, d, BD_OPEN);
        else if (bd_element_has_friction(element, d))
            evaluate_direction(element, d, n_lift, x, out, share, work);
    }
}
