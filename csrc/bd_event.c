/* Event-exact evaluation of 1-D friction with variable normal load, in two independent directions.
 *
 * N = max(n0 + kn v, 0), T = kt (u - w).  Stick, slip and separation are one statement about the slider:
 *
 *     w <- clip(w, lo, hi),   lo = u - (mu/kt)(n0 + kn v),   hi = u + (mu/kt)(n0 + kn v)      in contact
 *     w = u                                                                                open
 *
 * lo and hi are trigonometric polynomials.  The roots of n0 + kn v, of lo' and of hi' cut the period into pieces over
 * which contact does not change and lo and hi are monotone, so that in a piece w can only be pushed by one of them, from
 * a single onset on:
 *
 *     lo rises above w       slip+ from the onset to the end of the piece (T = +mu N)
 *     hi falls below w       slip-                                        (T = -mu N)
 *     otherwise              stick
 *
 * The map of w over one period is a composition of clips, hence itself a clip and idempotent: one period of marching
 * over the ends of the pieces gives the settled slider, a second one visits the pieces and sums the integrals.  A point
 * that neither slips nor opens keeps the slider that it was given, or, where that one is outside of
 * [max lo, min hi], is carried to the nearer end of this interval.
 *
 * The slider remembers the instant theta* that set it, and so does its derivative (b the basis at theta*):
 *
 *     set by lo (end of slip+)    dw = b.du - (mu kn/kt) b.dv        lo' = 0 there, so theta* may move freely
 *     set by hi (end of slip-)    dw = b.du + (mu kn/kt) b.dv
 *     set by closing              dw = b.du - (u'/v') b.dv           theta* moves by -b.dv/v'
 *     never set                   dw = 0
 */
#include "bd_event.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { GIVEN, SET_BY_LO, SET_BY_HI, SET_BY_CLOSING };
enum { CONTACT = 1, LO_RISES = 2, HI_FALLS = 4 };
enum { EVENT_LIFT = 0, EVENT_LO = 1, EVENT_HI = 2 };

typedef struct {
    int kind;
    int event; /* index of the instant that set it */
    double w;
} slider;

/* One direction of one point, as seen while marching. */
typedef struct {
    int n_harm, n_coef, n_power;
    int n_event;
    int n_lift;             /* events 0 .. n_lift-1 are lift-offs and closings */
    int n_lo;               /* then n_lo extrema of lo, the rest are extrema of hi */
    double r;               /* mu kn/kt */
    const double *lo, *hi;  /* polynomials */
    const double *dlo, *dhi;
    bd_event_work *work;
} direction;

bd_status bd_event_create(bd_event_work *work, int n_harm) {
    memset(work, 0, sizeof *work);
    if (n_harm < 1 || n_harm > BD_MAX_HARM) return BD_BAD_ARGUMENT;
    const size_t h = (size_t)n_harm, n_coef = (size_t)bd_n_coef(n_harm), n_power = (size_t)bd_n_power(n_harm);
    const size_t n_time = 16 * h + 16, n_event = 6 * h, n_segment = 3 * n_event + 2;
    bd_status status = bd_trig_grid_create(&work->grid, n_harm, (int)n_time);
    if (status != BD_OK) return status;
    const size_t n_double = 6 * n_time + 6 * n_coef + n_event * (3 + n_power) + 5 * n_power + 3 * n_coef * n_coef +
                            3 * n_coef;
    work->memory = malloc(sizeof(double) * n_double);
    work->order = malloc(sizeof(int) * 2 * n_event);
    work->segment[0] = malloc(sizeof(bd_segment) * 2 * n_segment);
    if (!work->memory || !work->order || !work->segment[0]) {
        bd_event_destroy(work);
        return BD_NO_MEMORY;
    }
    work->n_harm = n_harm;
    double *p = work->memory;
    work->value = p, p += n_time;
    work->slope = p, p += n_time;
    work->dv = p, p += n_time;
    work->ddv = p, p += n_time;
    work->du = p, p += n_time;
    work->ddu = p, p += n_time;
    work->poly = p, p += 6 * n_coef;
    work->theta = p, p += n_event;
    work->lo = p, p += n_event;
    work->hi = p, p += n_event;
    work->power = p, p += n_event * n_power;
    work->onset_power = p, p += n_power;
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

static double dot(int n, const double *a, const double *b) {
    double sum = 0.0;
    for (int i = 0; i < n; ++i) sum += a[i] * b[i];
    return sum;
}

/* Value of f somewhere between start and start + length, where f does not cross zero: b is the basis in the middle; if f
 * is small there, because it touches zero, a clearer value is looked for. */
static double clear_value(int n_harm, const double *f, const double *b, double start, double length) {
    static const double place[4] = {0.29, 0.67, 0.11, 0.87};
    const int n_coef = bd_n_coef(n_harm);
    double size = 0.0, value = dot(n_coef, b, f);
    for (int i = 0; i < n_coef; ++i) size += fabs(f[i]);
    for (int i = 0; i < 4 && fabs(value) <= 1e-3 * size; ++i) {
        const double other = bd_trig_value(n_harm, f, start + place[i] * length);
        if (fabs(other) > fabs(value)) value = other;
    }
    return value;
}

static const double *power_at(const bd_event_work *work, int event) {
    return work->power + (size_t)event * (size_t)bd_n_power(work->n_harm);
}

static const double *basis_at(const bd_event_work *work, int event) { return power_at(work, event) + 1; }

static void add_event_powers(bd_event_work *work, int first, int last) {
    for (int e = first; e < last; ++e)
        bd_trig_powers(2 * work->n_harm, work->theta[e], work->power + (size_t)e * (size_t)bd_n_power(work->n_harm));
}

static void push_segment(bd_event_work *work, int d, double start, double end, int state) {
    bd_segment *segment = work->segment[d];
    const int n = work->n_segment[d];
    if (n > 0 && segment[n - 1].state == state && segment[n - 1].end == start) {
        segment[n - 1].end = end;
    } else if (end > start) {
        segment[n] = (bd_segment){start, end, state};
        work->n_segment[d] = n + 1;
    }
}

/* ---- normal direction ---- */

/* Roots of n0 + kn v (left in work->poly) as events 0 .. n_lift-1; returns their number.  Leaves v', v'' on the grid for n_harm > 1. */
static int find_lifts(const bd_element *element, const double *v, bd_event_work *work) {
    const int n_harm = work->n_harm, n_coef = bd_n_coef(n_harm);
    double *g = work->poly;
    for (int i = 0; i < n_coef; ++i) g[i] = element->kn * v[i];
    g[0] += element->n0;
    if (n_harm > 1) {
        bd_trig_grid_values(&work->grid, g, work->value);
        for (int k = 0; k < work->grid.n_time; ++k) work->slope[k] = element->kn * work->dv[k];
    }
    const int n = bd_trig_roots(&work->grid, g, work->value, work->slope, work->theta);
    add_event_powers(work, 0, n);
    return n;
}

static double lift_length(const bd_event_work *work, int n_lift, int e) {
    return e + 1 < n_lift ? work->theta[e + 1] - work->theta[e] : work->theta[0] + BD_TWO_PI - work->theta[e];
}

/* Whether the part that follows the first lift is in contact: told in the middle of the longest part, where the sign is
 * clearest (two lifts may coincide where the contact only touches), since the parts alternate. */
static int contact_follows_first(bd_event_work *work, int n_lift) {
    int longest = 0;
    for (int e = 1; e < n_lift; ++e)
        if (lift_length(work, n_lift, e) > lift_length(work, n_lift, longest)) longest = e;
    const double start = work->theta[longest], length = lift_length(work, n_lift, longest);
    bd_trig_powers(work->n_harm, start + 0.5 * length, work->onset_power);
    const int contact = clear_value(work->n_harm, work->poly, work->onset_power + 1, start, length) > 0.0;
    return longest % 2 == 0 ? contact : !contact;
}

/* n0 + kn v (in work->poly) somewhere in a period without lifts. */
static double contact_sign(bd_event_work *work) {
    bd_trig_powers(work->n_harm, BD_PI, work->onset_power);
    return clear_value(work->n_harm, work->poly, work->onset_power + 1, 0.0, BD_TWO_PI);
}

/* Sums over the parts in contact, between consecutive lifts; contact_first tells whether part 0 (from event 0) is one. */
static void integrate_contact(bd_event_work *work, int n_lift, int contact_first, bd_status_share *share) {
    memset(work->contact, 0, sizeof(double) * (size_t)bd_n_power(work->n_harm));
    for (int e = contact_first ? 0 : 1; e < n_lift; e += 2) {
        const int next = (e + 1) % n_lift;
        bd_cycle_integrate(work->n_harm, work->contact, lift_length(work, n_lift, e), power_at(work, e), power_at(work, next), 1.0);
    }
    share->open = 1.0 - work->contact[0] / BD_TWO_PI;
}

/* ---- one tangential direction ---- */

/* Extrema of lo and hi become events behind the lifts. */
static void find_extrema(direction *dir) {
    bd_event_work *work = dir->work;
    const int n_time = work->grid.n_time;
    if (dir->n_harm > 1)
        for (int k = 0; k < n_time; ++k) {
            work->value[k] = work->du[k] - dir->r * work->dv[k];
            work->slope[k] = work->ddu[k] - dir->r * work->ddv[k];
        }
    dir->n_lo = bd_trig_roots(&work->grid, dir->dlo, work->value, work->slope, work->theta + dir->n_lift);
    const int first_hi = dir->n_lift + dir->n_lo;
    if (dir->n_harm > 1)
        for (int k = 0; k < n_time; ++k) {
            work->value[k] += 2.0 * dir->r * work->dv[k];
            work->slope[k] += 2.0 * dir->r * work->ddv[k];
        }
    const int n_hi = bd_trig_roots(&work->grid, dir->dhi, work->value, work->slope, work->theta + first_hi);
    dir->n_event = first_hi + n_hi;
    add_event_powers(work, dir->n_lift, dir->n_event);
}

static void sort_events(direction *dir) {
    bd_event_work *work = dir->work;
    for (int i = 0; i < dir->n_event; ++i) {
        int j = i;
        for (; j > 0 && work->theta[work->order[j - 1]] > work->theta[i]; --j) work->order[j] = work->order[j - 1];
        work->order[j] = i;
    }
}

static double piece_end(const direction *dir, int i) {
    const bd_event_work *work = dir->work;
    return i + 1 < dir->n_event ? work->theta[work->order[i + 1]] : work->theta[work->order[0]] + BD_TWO_PI;
}

/* Signs on every piece: evaluated inside the longest one, where they are clearest, and toggled from there at
 * each event, since every event is a change of sign of its own polynomial. */
static void flag_pieces(direction *dir, const bd_element *element, const double *v) {
    bd_event_work *work = dir->work;
    const int n = dir->n_event;
    int longest = 0;
    double length = -1.0;
    for (int i = 0; i < n; ++i) {
        const double l = piece_end(dir, i) - work->theta[work->order[i]];
        if (l > length) length = l, longest = i;
    }
    const double start = work->theta[work->order[longest]];
    double *power = work->onset_power, *level = work->poly; /* n0 + kn v */
    bd_trig_powers(dir->n_harm, start + 0.5 * length, power);
    for (int i = 0; i < dir->n_coef; ++i) level[i] = element->kn * v[i];
    level[0] += element->n0;
    int flags = 0;
    if (clear_value(dir->n_harm, level, power + 1, start, length) > 0.0) flags |= CONTACT;
    if (clear_value(dir->n_harm, dir->dlo, power + 1, start, length) > 0.0) flags |= LO_RISES;
    if (clear_value(dir->n_harm, dir->dhi, power + 1, start, length) < 0.0) flags |= HI_FALLS;
    work->piece[longest] = flags;
    for (int k = 1; k < n; ++k) {
        const int i = (longest + k) % n, event = work->order[i];
        if (event < dir->n_lift)
            flags ^= CONTACT;
        else
            flags ^= event < dir->n_lift + dir->n_lo ? LO_RISES : HI_FALLS;
        work->piece[i] = flags;
    }
}

static slider clip_at_end(const direction *dir, slider s, int flags, int event) {
    const bd_event_work *work = dir->work;
    const double lo = work->lo[event], hi = work->hi[event];
    if (!(flags & CONTACT)) return (slider){SET_BY_CLOSING, event, 0.5 * (lo + hi)};
    if (s.w < lo) return (slider){SET_BY_LO, event, lo};
    if (s.w > hi) return (slider){SET_BY_HI, event, hi};
    return s;
}

/* The slider at the first event once the cycle has settled. */
static slider settle(const direction *dir, double w) {
    const bd_event_work *work = dir->work;
    slider s = {GIVEN, -1, w};
    for (int i = 0; i < dir->n_event; ++i)
        s = clip_at_end(dir, s, work->piece[i], work->order[(i + 1) % dir->n_event]);
    return s;
}

/* Ends a stretch of sticking: its sums go to the cycle together with the slider that held. */
static void end_stick(const direction *dir, slider s) {
    bd_event_work *work = dir->work;
    double *part = work->part;
    if (part[0] == 0.0) return;
    for (int n = 0; n < dir->n_power; ++n) work->cycle.stick[n] += part[n];
    if (s.kind == GIVEN || !work->cycle.held_u) {
        bd_cycle_hold(&work->cycle, part + 1, s.w, NULL, NULL);
    } else {
        const double *b = basis_at(work, s.event);
        double factor = s.kind == SET_BY_LO ? -dir->r : dir->r;
        if (s.kind == SET_BY_CLOSING) {
            /* u' = (lo' + hi')/2 and v' = (hi' - lo')/(2 r); sticking after it, |u'/v'| <= r */
            const double dlo = dot(dir->n_coef, b, dir->dlo), dhi = dot(dir->n_coef, b, dir->dhi);
            factor = dhi > dlo ? -dir->r * fmax(-1.0, fmin(1.0, (dhi + dlo) / (dhi - dlo))) : 0.0;
        }
        for (int i = 0; i < dir->n_coef; ++i) {
            work->origin_u[i] = b[i];
            work->origin_v[i] = factor * b[i];
        }
        bd_cycle_hold(&work->cycle, part + 1, s.w, work->origin_u, work->origin_v);
    }
    memset(part, 0, sizeof(double) * (size_t)dir->n_power);
}

/* Adds one piece to the sums and returns the slider at its end. */
static slider march_piece(const direction *dir, int d, int i, slider s, bd_status_share *share) {
    bd_event_work *work = dir->work;
    const int start = work->order[i], end = work->order[(i + 1) % dir->n_event], flags = work->piece[i];
    const double theta_start = work->theta[start], theta_end = piece_end(dir, i), length = theta_end - theta_start;
    const double *from = power_at(work, start), *to = power_at(work, end);

    if (!(flags & CONTACT)) {
        end_stick(dir, s);
        push_segment(work, d, theta_start, theta_end, BD_OPEN);
        return clip_at_end(dir, s, flags, end);
    }
    const int set_now = s.event == start && s.kind != GIVEN;
    const int sliding = set_now && ((s.kind != SET_BY_HI && (flags & LO_RISES)) || (s.kind != SET_BY_LO && (flags & HI_FALLS)));
    const slider after = clip_at_end(dir, s, flags, end);
    if (sliding) {
        const int plus = s.kind != SET_BY_HI && (flags & LO_RISES);
        end_stick(dir, s);
        bd_cycle_integrate(dir->n_harm, work->cycle.slip, length, from, to, plus ? 1.0 : -1.0);
        push_segment(work, d, theta_start, theta_end, plus ? BD_SLIP_PLUS : BD_SLIP_MINUS);
        share->slip[d] += length;
        return (slider){plus ? SET_BY_LO : SET_BY_HI, end, plus ? work->lo[end] : work->hi[end]};
    }
    if (after.kind == s.kind && after.event == s.event) { /* nothing pushed it */
        bd_cycle_integrate(dir->n_harm, work->part, length, from, to, 1.0);
        push_segment(work, d, theta_start, theta_end, BD_STICK);
        return s;
    }
    /* one onset of slip inside */
    const int plus = after.kind == SET_BY_LO;
    double *bound = work->poly; /* lo - w or hi - w */
    memcpy(bound, plus ? dir->lo : dir->hi, sizeof(double) * (size_t)dir->n_coef);
    bound[0] -= s.w;
    const double onset = bd_trig_bracketed_root(dir->n_harm, bound, theta_start, theta_end);
    bd_trig_powers(2 * dir->n_harm, onset, work->onset_power);
    bd_cycle_integrate(dir->n_harm, work->part, onset - theta_start, from, work->onset_power, 1.0);
    push_segment(work, d, theta_start, onset, BD_STICK);
    end_stick(dir, s);
    bd_cycle_integrate(dir->n_harm, work->cycle.slip, theta_end - onset, work->onset_power, to, plus ? 1.0 : -1.0);
    push_segment(work, d, onset, theta_end, plus ? BD_SLIP_PLUS : BD_SLIP_MINUS);
    share->slip[d] += theta_end - onset;
    return after;
}

/* Without any event the motion is a constant: the slider is the given one clipped to [lo, hi]. */
static void hold_constant(const direction *dir, int d, const bd_element *element, bd_status_share *share) {
    bd_event_work *work = dir->work;
    slider s = {GIVEN, -1, element->w[d]};
    double factor = 0.0;
    if (s.w < dir->lo[0]) s.w = dir->lo[0], s.kind = SET_BY_LO, factor = -dir->r;
    else if (s.w > dir->hi[0]) s.w = dir->hi[0], s.kind = SET_BY_HI, factor = dir->r;
    work->cycle.stick[0] = work->cycle.stick[1] = BD_TWO_PI;
    memset(work->origin_u, 0, sizeof(double) * (size_t)dir->n_coef);
    memset(work->origin_v, 0, sizeof(double) * (size_t)dir->n_coef);
    work->origin_u[0] = 1.0;
    work->origin_v[0] = factor;
    bd_cycle_hold(&work->cycle, work->cycle.stick + 1, s.w, s.kind == GIVEN ? NULL : work->origin_u, work->origin_v);
    push_segment(work, d, 0.0, BD_TWO_PI, BD_STICK);
    share->stick[d] = 1.0;
}

/* lo, hi and their derivatives; returns whether the bounds on their swing already prove that w stays inside. */
static int make_bounds(const bd_element *element, int d, const double *u, const double *v, direction *dir) {
    const int n_coef = dir->n_coef;
    double *lo = dir->work->poly + n_coef, *hi = lo + n_coef, *dlo = hi + n_coef, *dhi = dlo + n_coef;
    const double shift = element->mu * element->n0 / element->kt[d];
    dir->r = element->mu * element->kn / element->kt[d];
    for (int i = 0; i < n_coef; ++i) {
        lo[i] = u[i] - dir->r * v[i];
        hi[i] = u[i] + dir->r * v[i];
    }
    lo[0] -= shift;
    hi[0] += shift;
    dir->lo = lo, dir->hi = hi, dir->dlo = dlo, dir->dhi = dhi;
    if (lo[0] + bd_trig_amplitude(dir->n_harm, lo) <= element->w[d] &&
        hi[0] - bd_trig_amplitude(dir->n_harm, hi) >= element->w[d] && dir->n_lift == 0)
        return 1;
    bd_trig_derivative(dir->n_harm, lo, dlo);
    bd_trig_derivative(dir->n_harm, hi, dhi);
    return 0;
}

static void evaluate_direction(const bd_element *element, int d, int n_lift, const double *u, const double *v,
                               bd_response *out, bd_status_share *share, bd_event_work *work) {
    direction dir = {.n_harm = work->n_harm, .n_coef = bd_n_coef(work->n_harm), .n_power = bd_n_power(work->n_harm),
                     .n_lift = n_lift, .work = work};
    if (make_bounds(element, d, u, v, &dir)) {
        bd_element_stuck(element, work->n_harm, d, u, out);
        push_segment(work, d, 0.0, BD_TWO_PI, BD_STICK);
        share->stick[d] = 1.0;
        return;
    }
    if (dir.n_harm > 1) {
        bd_trig_derivative(dir.n_harm, u, work->poly);
        bd_trig_grid_values(&work->grid, work->poly, work->du);
        bd_trig_derivative(dir.n_harm, work->poly, work->origin_u);
        bd_trig_grid_values(&work->grid, work->origin_u, work->ddu);
    }
    find_extrema(&dir);
    bd_cycle_clear(&work->cycle);
    if (dir.n_event == 0) {
        hold_constant(&dir, d, element, share);
        bd_cycle_friction(element, d, &work->cycle, u, v, out, work->scratch);
        return;
    }
    sort_events(&dir);
    flag_pieces(&dir, element, v);
    for (int e = 0; e < dir.n_event; ++e) {
        work->lo[e] = dot(dir.n_coef, basis_at(work, e), dir.lo);
        work->hi[e] = dot(dir.n_coef, basis_at(work, e), dir.hi);
    }
    slider s = settle(&dir, element->w[d]);
    if (s.kind == GIVEN) {
        bd_element_stuck(element, work->n_harm, d, u, out);
        push_segment(work, d, 0.0, BD_TWO_PI, BD_STICK);
        share->stick[d] = 1.0;
        return;
    }
    memset(work->part, 0, sizeof(double) * (size_t)dir.n_power);
    for (int i = 0; i < dir.n_event; ++i) s = march_piece(&dir, d, i, s, share);
    end_stick(&dir, s);
    share->slip[d] /= BD_TWO_PI;
    share->stick[d] = work->cycle.stick[0] / BD_TWO_PI;
    bd_cycle_friction(element, d, &work->cycle, u, v, out, work->scratch);
}

void bd_event_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                       bd_event_work *work) {
    const int n_harm = work->n_harm, n_coef = bd_n_coef(n_harm);
    const double *v = x + 2 * n_coef;
    const double level = element->n0 + element->kn * v[0], swing = element->kn * bd_trig_amplitude(n_harm, v);
    bd_status_share unused;
    if (!share) share = &unused;
    *share = (bd_status_share){{0.0, 0.0}, {0.0, 0.0}, 0.0};
    work->n_segment[0] = work->n_segment[1] = 0;
    work->cycle.held_u = out->dN ? work->held_u : NULL;
    work->cycle.held_v = out->dN ? work->held_v : NULL;
    bd_element_open(element, n_harm, out);

    if (level <= -swing) { /* n0 = 0 without motion counts as open too: force and tangent are zero */
        share->open = 1.0;
        for (int d = 0; d < 2; ++d) push_segment(work, d, 0.0, BD_TWO_PI, BD_OPEN);
        return;
    }
    if (n_harm > 1) {
        bd_trig_derivative(n_harm, v, work->poly);
        bd_trig_grid_values(&work->grid, work->poly, work->dv);
        bd_trig_derivative(n_harm, work->poly, work->origin_u);
        bd_trig_grid_values(&work->grid, work->origin_u, work->ddv);
    }
    int n_lift = level >= swing ? 0 : find_lifts(element, v, work);
    if (n_lift == 0) {
        if (level < swing && contact_sign(work) <= 0.0) {
            share->open = 1.0; /* the swing was only a bound: open all the time */
            for (int d = 0; d < 2; ++d) push_segment(work, d, 0.0, BD_TWO_PI, BD_OPEN);
            return;
        }
        bd_element_closed(element, n_harm, v, out);
    } else {
        integrate_contact(work, n_lift, contact_follows_first(work, n_lift), share);
        bd_cycle_normal(element, n_harm, work->contact, v, out, work->scratch);
    }
    for (int d = 0; d < 2; ++d)
        if (element->law == BD_LAW_SEPARABLE && element->mu > 0.0 && element->kt[d] > 0.0)
            evaluate_direction(element, d, n_lift, x + d * n_coef, v, out, share, work);
}
