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
 * With a constant normal load the bounds are u -+ mu load/kt, and the contact stays closed.
 *
 * What costs nothing is found first: a swing bounded by the sum of the amplitudes, then by samples, of which a function
 * exceeds the largest by h^2/8 max|f''| at most, shows most of the points that never slip, or never open, without any root.
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
enum { NOTHING = -1 }; /* besides bd_state */

typedef struct {
    int kind;
    int event; /* index of the instant that set it */
    double w;
} slider;

/* One direction of one point, as seen while marching. */
typedef struct {
    int n_harm, n_coef, n_power;
    int n_event;
    int n_lift;            /* events 0 .. n_lift-1 are lift-offs and closings */
    int n_lo;              /* then n_lo extrema of lo, the rest are extrema of hi; */
    int common;            /* 1: lo and hi have the same extrema, listed once */
    double r;              /* mu kn/kt, 0 under a constant load */
    const double *lo, *hi; /* polynomials */
    const double *dlo, *dhi;
    bd_event_work *work;
} direction;

/* The part of the cycle that is being marched through. */
typedef struct {
    int state;
    double start;
    int at; /* work->power[at] belongs to its beginning */
    slider held;
} run;

bd_status bd_event_create(bd_event_work *work, int n_harm) {
    memset(work, 0, sizeof *work);
    work->kernel = bd_kernel_get();
    if (!work->kernel || n_harm < 1 || n_harm > BD_MAX_HARM) return BD_BAD_ARGUMENT;
    const size_t h = (size_t)n_harm, n_coef = (size_t)bd_n_coef(n_harm), n_power = (size_t)bd_n_power(n_harm);
    const size_t n_time = 16 * h + 16, n_event = 6 * h, n_segment = 2 * n_event + 4;
    bd_status status = bd_trig_grid_create(&work->grid, n_harm, (int)n_time);
    if (status != BD_OK) return status;
    const size_t n_double = 11 * n_time + 11 * n_coef + 5 * n_event + 6 * n_power + 3 * n_coef * n_coef + 2 * n_coef;
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
    work->poly = p, p += 5 * n_coef;
    work->theta = p, p += n_event;
    work->z = p, p += 2 * n_event;
    work->lo = p, p += n_event;
    work->hi = p, p += n_event;
    work->power[0] = p, p += n_power;
    work->power[1] = p, p += n_power;
    work->contact = p, p += n_power;
    work->part = p, p += n_power;
    work->cycle.stick = p, p += n_power;
    work->cycle.slip = p, p += n_power;
    work->cycle.held = p, p += n_coef;
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

/* x and y at exp(i theta) = z. */
static void pair_at(int n_harm, const double *x, const double *y, const double *z, double *at_x, double *at_y) {
    const double c = z[0], s = z[1];
    double re = c, im = s, sum_x = x[0], sum_y = y[0];
    for (int l = 1; l <= n_harm; ++l) {
        sum_x += x[2 * l - 1] * re + x[2 * l] * im;
        sum_y += y[2 * l - 1] * re + y[2 * l] * im;
        const double next = re * c - im * s;
        im = re * s + im * c;
        re = next;
    }
    *at_x = sum_x;
    *at_y = sum_y;
}

/* Value of f somewhere between start and start + length, where f does not cross zero: in the middle; if f is small there,
 * because it touches zero, a clearer value is looked for. */
static double clear_value(int n_harm, const double *f, double start, double length) {
    static const double place[4] = {0.29, 0.67, 0.11, 0.87};
    const int n_coef = bd_n_coef(n_harm);
    double size = 0.0, value = bd_trig_value(n_harm, f, start + 0.5 * length);
    for (int i = 0; i < n_coef; ++i) size += fabs(f[i]);
    for (int i = 0; i < 4 && fabs(value) <= 1e-3 * size; ++i) {
        const double other = bd_trig_value(n_harm, f, start + place[i] * length);
        if (fabs(other) > fabs(value)) value = other;
    }
    return value;
}

/* Bound of h^2/8 max|x''| between samples of x. */
static double between_samples(const bd_event_work *work, const double *x) {
    const double h = BD_TWO_PI / work->grid.n_time;
    double sum = 0.0;
    for (int l = 1; l <= work->n_harm; ++l) sum += l * l * sqrt(x[2 * l - 1] * x[2 * l - 1] + x[2 * l] * x[2 * l]);
    return 0.125 * h * h * sum;
}

/* v' and v'' on the grid, then those of u1 and u2, only if roots are to be found at all. */
static void need_derivatives(bd_event_work *work, const double *x) {
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

/* ---- parts of the cycle ---- */

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

static void whole_cycle(bd_event_work *work, int d, int state) {
    work->n_segment[d] = 0;
    push_segment(work, d, 0.0, BD_TWO_PI, state);
}

static void reverse(bd_segment *s, int n) {
    for (int i = 0, j = n - 1; i < j; ++i, --j) {
        const bd_segment swap = s[i];
        s[i] = s[j];
        s[j] = swap;
    }
}

/* Brings starts into [0, 2 pi), ascending: a march may begin anywhere. */
static void arrange_segments(bd_event_work *work, int d) {
    bd_segment *segment = work->segment[d];
    int n = work->n_segment[d];
    if (n > 1 && segment[n - 1].state == segment[0].state) { /* the march began inside a part */
        segment[n - 1].end = segment[0].end + BD_TWO_PI;
        --n;
        memmove(segment, segment + 1, sizeof *segment * (size_t)n);
        work->n_segment[d] = n;
    }
    int turned = 0; /* how many at the end lie in the next period */
    for (int i = 0; i < n; ++i)
        if (segment[i].start >= BD_TWO_PI) {
            segment[i].start -= BD_TWO_PI;
            segment[i].end -= BD_TWO_PI;
            ++turned;
        }
    reverse(segment, n - turned);
    reverse(segment + n - turned, turned);
    reverse(segment, n);
    if (turned > 0 && turned < n) segment[turned - 1].end = segment[turned].start; /* the same instant but for rounding */
}

/* ---- normal direction ---- */

/* Whether n0 + kn v changes sign; where the bounds on the swing and the samples leave it open, -1. */
enum { CLOSED_ALWAYS, OPEN_ALWAYS, CHANGES };

static int bound_contact(const bd_element *element, const double *v, bd_event_work *work) {
    const double level = element->n0 + element->kn * v[0], swing = element->kn * bd_trig_amplitude(work->n_harm, v);
    if (level <= -swing) return OPEN_ALWAYS; /* n0 = 0 without motion counts as open too: force and tangent are zero */
    if (level >= swing) return CLOSED_ALWAYS;
    if (work->n_harm == 1) return CHANGES;
    double most, least;
    const double *sample = work->motion + 2 * work->grid.n_time, margin = element->kn * between_samples(work, v);
    work->kernel->bounds(work->grid.n_time, 0.0, sample, sample, &most, &least);
    if (element->n0 + element->kn * least > margin) return CLOSED_ALWAYS;
    if (element->n0 + element->kn * most < -margin) return OPEN_ALWAYS;
    return CHANGES;
}

/* Roots of n0 + kn v (left in work->poly) as events 0 .. n_lift-1; returns their number. */
static int find_lifts(const bd_element *element, const double *x, bd_event_work *work) {
    const int n_harm = work->n_harm, n_coef = bd_n_coef(n_harm), n_time = work->grid.n_time;
    const double *v = x + 2 * n_coef;
    double *g = work->poly;
    for (int i = 0; i < n_coef; ++i) g[i] = element->kn * v[i];
    g[0] += element->n0;
    need_derivatives(work, x);
    for (int k = 0; k < n_time && n_harm > 1; ++k) {
        work->value[k] = element->n0 + element->kn * work->motion[2 * n_time + k];
        work->slope[k] = element->kn * work->dmotion[2 * n_time + k];
    }
    return bd_trig_roots_with_powers(&work->grid, g, work->value, work->slope, work->theta, work->z);
}

static double lift_length(const bd_event_work *work, int n_lift, int e) {
    return e + 1 < n_lift ? work->theta[e + 1] - work->theta[e] : work->theta[0] + BD_TWO_PI - work->theta[e];
}

/* Whether the part that follows the first lift is in contact: told in the middle of the longest part, where the sign is
 * clearest (two lifts may coincide where the contact only touches), since the parts alternate. */
static int contact_follows_first(const bd_event_work *work, int n_lift) {
    int longest = 0;
    for (int e = 1; e < n_lift; ++e)
        if (lift_length(work, n_lift, e) > lift_length(work, n_lift, longest)) longest = e;
    const double value = clear_value(work->n_harm, work->poly, work->theta[longest], lift_length(work, n_lift, longest));
    return longest % 2 == 0 ? value > 0.0 : !(value > 0.0);
}

/* Sums over the parts in contact, between consecutive lifts; contact_first tells whether part 0 (from event 0) is one. */
static void integrate_contact(bd_event_work *work, int n_lift, int contact_first, bd_status_share *share) {
    memset(work->contact, 0, sizeof(double) * (size_t)bd_n_power(work->n_harm));
    for (int e = contact_first ? 0 : 1; e < n_lift; e += 2) {
        const int next = (e + 1) % n_lift;
        bd_trig_powers_of(2 * work->n_harm, work->z + 2 * e, work->power[0]);
        bd_trig_powers_of(2 * work->n_harm, work->z + 2 * next, work->power[1]);
        bd_cycle_integrate(work->n_harm, work->contact, lift_length(work, n_lift, e), work->power[0], work->power[1], 1.0);
    }
    share->open = 1.0 - work->contact[0] / BD_TWO_PI;
}

/* ---- events of one tangential direction ---- */

/* lo, hi and their derivatives; returns whether bounds on their swing already prove that w stays inside. */
static int make_bounds(const bd_element *element, int d, const double *u, const double *v, direction *dir) {
    const int n_coef = dir->n_coef, constant = bd_law_is_constant(element->law);
    bd_event_work *work = dir->work;
    double *lo = work->poly + n_coef, *hi = lo + n_coef, *dlo = hi + n_coef, *dhi = dlo + n_coef;
    const double shift = element->mu * (constant ? fmax(element->load, 0.0) : element->n0) / element->kt[d];
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
    if (lo[0] + bd_trig_amplitude(dir->n_harm, lo) <= w && hi[0] - bd_trig_amplitude(dir->n_harm, hi) >= w) return 1;
    if (dir->n_harm == 1) return 0;
    double most, least;
    const int n_time = work->grid.n_time;
    work->kernel->bounds(n_time, dir->r, work->motion + d * n_time, work->motion + 2 * n_time, &most, &least);
    return most - shift + between_samples(work, lo) <= w && least + shift - between_samples(work, hi) >= w;
}

/* Extrema of lo and hi become events behind the lifts. */
static void find_extrema(direction *dir, int d) {
    bd_event_work *work = dir->work;
    const int n_time = work->grid.n_time, n_coef = dir->n_coef;
    double *dlo = work->poly + 3 * n_coef, *dhi = dlo + n_coef;
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
    dir->n_lo = bd_trig_roots_with_powers(&work->grid, dlo, work->value, work->slope, work->theta + at, work->z + 2 * at);
    dir->n_event = at + dir->n_lo;
    dir->common = r == 0.0;
    if (dir->common) return;
    for (int k = 0; k < n_time && dir->n_harm > 1; ++k) {
        work->value[k] = su[k] + r * sv[k];
        work->slope[k] = ssu[k] + r * ssv[k];
    }
    dir->n_event += bd_trig_roots_with_powers(&work->grid, dhi, work->value, work->slope, work->theta + dir->n_event,
                                              work->z + 2 * dir->n_event);
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
    const int n = dir->n_event;
    return i + 1 < n ? work->theta[work->order[i + 1]] : work->theta[work->order[0]] + BD_TWO_PI;
}

/* Signs on every piece: evaluated inside the longest one, where they are clearest, and toggled from there at
 * each event, since every event is a change of sign of its own polynomial. */
static void flag_pieces(direction *dir, const bd_element *element, const double *v) {
    bd_event_work *work = dir->work;
    const int n = dir->n_event;
    int longest = 0, flags = 0;
    double length = -1.0;
    for (int i = 0; i < n; ++i) {
        const double l = piece_end(dir, i) - work->theta[work->order[i]];
        if (l > length) length = l, longest = i;
    }
    const double start = work->theta[work->order[longest]];
    if (dir->n_lift == 0) {
        flags |= CONTACT;
    } else {
        double *level = work->poly; /* n0 + kn v */
        for (int i = 0; i < dir->n_coef; ++i) level[i] = element->kn * v[i];
        level[0] += element->n0;
        if (clear_value(dir->n_harm, level, start, length) > 0.0) flags |= CONTACT;
    }
    if (clear_value(dir->n_harm, dir->dlo, start, length) > 0.0) flags |= LO_RISES;
    if (clear_value(dir->n_harm, dir->dhi, start, length) < 0.0) flags |= HI_FALLS;
    work->piece[longest] = flags;
    for (int k = 1; k < n; ++k) {
        const int i = (longest + k) % n, event = work->order[i];
        if (event < dir->n_lift)
            flags ^= CONTACT;
        else if (dir->common)
            flags ^= LO_RISES | HI_FALLS;
        else
            flags ^= event < dir->n_lift + dir->n_lo ? LO_RISES : HI_FALLS;
        work->piece[i] = flags;
    }
}

/* ---- marching ---- */

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
    const int n = dir->n_event;
    slider s = {GIVEN, -1, w};
    for (int i = 0; i < n; ++i) s = clip_at_end(dir, s, work->piece[i], work->order[i + 1 < n ? i + 1 : 0]);
    return s;
}

/* dw of a slider that was set at the beginning of the present part of the cycle. */
static void hold(const direction *dir, const run *part) {
    bd_event_work *work = dir->work;
    const double *b = work->power[part->at] + 1;
    if (!work->cycle.held_u) {
        bd_cycle_hold(&work->cycle, work->part + 1, part->held.w, NULL, NULL);
        return;
    }
    double factor = part->held.kind == SET_BY_LO ? -dir->r : dir->r;
    if (part->held.kind == SET_BY_CLOSING) {
        /* u' = (lo' + hi')/2 and v' = (hi' - lo')/(2 r); sticking after it, |u'/v'| <= r */
        double dlo, dhi;
        pair_at(dir->n_harm, dir->dlo, dir->dhi, work->z + 2 * part->held.event, &dlo, &dhi);
        factor = dhi > dlo ? -dir->r * fmax(-1.0, fmin(1.0, (dhi + dlo) / (dhi - dlo))) : 0.0;
    }
    for (int i = 0; i < dir->n_coef; ++i) work->origin_v[i] = factor * b[i];
    bd_cycle_hold(&work->cycle, work->part + 1, part->held.w, b, work->origin_v);
}

/* The state changes at theta (exp(i theta) = z): sums of the part that ends, beginning of the next. */
static void change(const direction *dir, int d, run *part, int state, double theta, const double *z, slider s,
                   bd_status_share *share) {
    bd_event_work *work = dir->work;
    double *from = work->power[part->at], *to = work->power[!part->at];
    if (part->state == state) return;
    bd_trig_powers_of(2 * dir->n_harm, z, to);
    if (part->state != NOTHING) {
        const double length = theta - part->start;
        push_segment(work, d, part->start, theta, part->state);
        if (part->state == BD_STICK) {
            memset(work->part, 0, sizeof(double) * (size_t)dir->n_power);
            bd_cycle_integrate(dir->n_harm, work->part, length, from, to, 1.0);
            for (int n = 0; n < dir->n_power; ++n) work->cycle.stick[n] += work->part[n];
            hold(dir, part);
        } else if (part->state != BD_OPEN) {
            bd_cycle_integrate(dir->n_harm, work->cycle.slip, length, from, to, part->state == BD_SLIP_PLUS ? 1.0 : -1.0);
            share->slip[d] += length;
        }
    }
    part->at = !part->at;
    part->state = state;
    part->start = theta;
    part->held = s;
}

/* Where lo (hi) first meets w in a piece over which it rises (falls). */
static double find_onset(const direction *dir, int plus, double w, double start, double end, double *z) {
    double *bound = dir->work->poly; /* lo - w or hi - w */
    memcpy(bound, plus ? dir->lo : dir->hi, sizeof(double) * (size_t)dir->n_coef);
    bound[0] -= w;
    if (dir->n_harm > 1) {
        const double onset = bd_trig_bracketed_root(dir->n_harm, bound, start, end);
        z[0] = cos(onset);
        z[1] = sin(onset);
        return onset;
    }
    /* cos(theta - phi) = k on the rising (falling) side */
    const double size = hypot(bound[1], bound[2]), c = bound[1] / size, s = bound[2] / size;
    const double k = fmax(-1.0, fmin(1.0, -bound[0] / size)), m = sqrt((1.0 - k) * (1.0 + k)) * (plus ? -1.0 : 1.0);
    z[0] = c * k - s * m;
    z[1] = s * k + c * m;
    double onset = atan2(z[1], z[0]);
    while (onset < start - 1e-9) onset += BD_TWO_PI;
    while (onset > end + 1e-9) onset -= BD_TWO_PI;
    return fmax(start, fmin(end, onset));
}

/* Walks through one piece and returns the slider at its end. */
static slider march_piece(const direction *dir, int d, int i, double turn, slider s, run *part, bd_status_share *share) {
    bd_event_work *work = dir->work;
    const int n = dir->n_event;
    const int start = work->order[i], end = work->order[i + 1 < n ? i + 1 : 0], flags = work->piece[i];
    const double *z = work->z + 2 * start, theta = work->theta[start] + turn;
    if (!(flags & CONTACT)) {
        change(dir, d, part, BD_OPEN, theta, z, s, share);
        return clip_at_end(dir, s, flags, end);
    }
    const int set_now = s.event == start && s.kind != GIVEN;
    const int plus_now = set_now && s.kind != SET_BY_HI && (flags & LO_RISES);
    const int minus_now = set_now && s.kind != SET_BY_LO && (flags & HI_FALLS);
    if (plus_now || minus_now) {
        change(dir, d, part, plus_now ? BD_SLIP_PLUS : BD_SLIP_MINUS, theta, z, s, share);
        return (slider){plus_now ? SET_BY_LO : SET_BY_HI, end, plus_now ? work->lo[end] : work->hi[end]};
    }
    const slider after = clip_at_end(dir, s, flags, end);
    change(dir, d, part, BD_STICK, theta, z, s, share);
    if (after.kind == s.kind && after.event == s.event) return s; /* nothing pushed it */
    const int plus = after.kind == SET_BY_LO;
    if (plus ? work->lo[start] >= s.w : work->hi[start] <= s.w) { /* at once: the slip had only paused */
        change(dir, d, part, plus ? BD_SLIP_PLUS : BD_SLIP_MINUS, theta, z, after, share);
        return after;
    }
    double at[2];
    const double onset = find_onset(dir, plus, s.w, work->theta[start], piece_end(dir, i), at) + turn;
    change(dir, d, part, plus ? BD_SLIP_PLUS : BD_SLIP_MINUS, onset, at, after, share);
    return after;
}

/* The settled cycle from the event on that set its slider, so that every part begins where its slider was set. */
static void march_cycle(const direction *dir, int d, slider s, bd_status_share *share) {
    bd_event_work *work = dir->work;
    const int n = dir->n_event;
    run part = {.state = NOTHING};
    int first = 0;
    while (work->order[first] != s.event) ++first;
    for (int k = 0; k < n; ++k) {
        const int i = first + k < n ? first + k : first + k - n;
        s = march_piece(dir, d, i, first + k < n ? 0.0 : BD_TWO_PI, s, &part, share);
    }
    const int event = work->order[first];
    change(dir, d, &part, NOTHING, work->theta[event] + BD_TWO_PI, work->z + 2 * event, s, share);
    arrange_segments(work, d);
}

/* Without any event the motion is a constant: the slider is the given one clipped to [lo, hi]. */
static void hold_constant(const direction *dir, int d, const bd_element *element, bd_status_share *share) {
    bd_event_work *work = dir->work;
    slider s = {GIVEN, -1, element->w[d]};
    double factor = 0.0;
    if (s.w < dir->lo[0])
        s.w = dir->lo[0], s.kind = SET_BY_LO, factor = -dir->r;
    else if (s.w > dir->hi[0])
        s.w = dir->hi[0], s.kind = SET_BY_HI, factor = dir->r;
    work->cycle.stick[0] = work->cycle.stick[1] = BD_TWO_PI;
    double *one = work->power[0];
    memset(one, 0, sizeof(double) * (size_t)dir->n_coef);
    memset(work->origin_v, 0, sizeof(double) * (size_t)dir->n_coef);
    one[0] = 1.0;
    work->origin_v[0] = factor;
    bd_cycle_hold(&work->cycle, work->cycle.stick + 1, s.w, s.kind == GIVEN ? NULL : one, work->origin_v);
    whole_cycle(work, d, BD_STICK);
    share->stick[d] = 1.0;
}

static void stay_stuck(const bd_element *element, int d, const double *u, bd_response *out, bd_status_share *share,
                       bd_event_work *work) {
    bd_element_stuck(element, work->n_harm, d, u, out);
    whole_cycle(work, d, BD_STICK);
    share->stick[d] = 1.0;
}

static void evaluate_direction(const bd_element *element, int d, int n_lift, const double *x, bd_response *out,
                               bd_status_share *share, bd_event_work *work) {
    const int n_coef = bd_n_coef(work->n_harm);
    const double *u = x + d * n_coef, *v = x + 2 * n_coef;
    direction dir = {
        .n_harm = work->n_harm, .n_coef = n_coef, .n_power = bd_n_power(work->n_harm), .n_lift = n_lift, .work = work};
    if (make_bounds(element, d, u, v, &dir)) {
        stay_stuck(element, d, u, out, share, work);
        return;
    }
    need_derivatives(work, x);
    find_extrema(&dir, d);
    bd_cycle_clear(&work->cycle);
    if (dir.n_event == 0) {
        hold_constant(&dir, d, element, share);
        bd_cycle_friction(element, d, &work->cycle, u, v, out, work->scratch);
        return;
    }
    sort_events(&dir);
    flag_pieces(&dir, element, v);
    for (int e = 0; e < dir.n_event; ++e) pair_at(dir.n_harm, dir.lo, dir.hi, work->z + 2 * e, work->lo + e, work->hi + e);
    const slider s = settle(&dir, element->w[d]);
    if (s.kind == GIVEN) {
        stay_stuck(element, d, u, out, share, work);
        return;
    }
    march_cycle(&dir, d, s, share);
    share->slip[d] /= BD_TWO_PI;
    share->stick[d] = work->cycle.stick[0] / BD_TWO_PI;
    bd_cycle_friction(element, d, &work->cycle, u, v, out, work->scratch);
}

/* Normal force; returns the number of lifts, which are events 0, 1, ... */
static int evaluate_normal(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                           bd_event_work *work) {
    const double *v = x + 2 * bd_n_coef(work->n_harm);
    if (bd_law_is_two_sided(element->law)) {
        bd_element_closed(element, work->n_harm, v, out);
        return 0;
    }
    const int bound = bound_contact(element, v, work), n_lift = bound == CHANGES ? find_lifts(element, x, work) : 0;
    if (n_lift > 0) {
        integrate_contact(work, n_lift, contact_follows_first(work, n_lift), share);
        bd_cycle_normal(element, work->n_harm, work->contact, v, out, work->scratch);
        return n_lift;
    }
    if (bound == OPEN_ALWAYS || (bound == CHANGES && clear_value(work->n_harm, work->poly, 0.0, BD_TWO_PI) <= 0.0))
        share->open = 1.0;
    else
        bd_element_closed(element, work->n_harm, v, out);
    return 0;
}

void bd_event_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                       bd_event_work *work) {
    const int n_harm = work->n_harm, n_coef = bd_n_coef(n_harm);
    bd_status_share unused;
    if (!share) share = &unused;
    *share = (bd_status_share){{0.0, 0.0}, {0.0, 0.0}, 0.0};
    work->n_segment[0] = work->n_segment[1] = 0;
    work->derivatives_known = 0;
    work->cycle.held_u = out->dN ? work->held_u : NULL;
    work->cycle.held_v = out->dN ? work->held_v : NULL;
    bd_element_open(element, n_harm, out);
    if (n_harm > 1 && element->law != BD_LAW_BONDED)
        work->kernel->grid_values(n_coef, work->grid.n_time, work->grid.basis, 3, x, work->motion);
    const int n_lift = evaluate_normal(element, x, out, share, work);
    for (int d = 0; d < 2; ++d) {
        if (element->law == BD_LAW_BONDED) stay_stuck(element, d, x + d * n_coef, out, share, work);
        if (share->open == 1.0) whole_cycle(work, d, BD_OPEN);
        if (bd_element_rubs(element, d) && share->open < 1.0) evaluate_direction(element, d, n_lift, x, out, share, work);
    }
}
