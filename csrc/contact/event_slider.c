/* Slider between the events of a cycle; see event_driven.c for the law.
 *
 * The events are the roots of n0 + kn v, lo' and hi'. They divide the period into pieces in which
 * contact does not change and lo and hi are monotone. In a piece only one of the bounds can move w,
 * from a single onset on:
 *
 *     lo rises above w       slip+ from the onset to the end of the piece (T = +mu N)
 *     hi falls below w       slip-                                        (T = -mu N)
 *     otherwise              stick
 *
 * The map of w over one period is a composition of clips, hence a clip and idempotent. One period
 * over the ends of the pieces yields the steady slider; a second one adds up the integrals over the
 * pieces.
 *
 * The derivative of the slider depends on the instant theta* that set it (b: basis at theta*):
 *
 *     set by lo (end of slip+)    dw = b.du - (mu kn/kt) b.dv    lo' = 0: shifts of theta* cancel
 *     set by hi (end of slip-)    dw = b.du + (mu kn/kt) b.dv
 *     set by closing              dw = b.du - (u'/v') b.dv       theta* moves by -b.dv/v'
 *     never set                   dw = 0 */
#include "contact/event_slider.h"

#include <math.h>
#include <string.h>

enum { INITIAL, SET_BY_LO, SET_BY_HI, SET_BY_CLOSING };
enum { CONTACT = 1, LO_RISES = 2, HI_FALLS = 4 };
enum { NO_STATE = -1 }; /* before the first part; otherwise a bd_state */

/* Position of the slider and its cause. */
typedef struct {
    int kind;
    int event; /* index of the event that set it */
    double w;
} slider;

/* Current part of the cycle. */
typedef struct {
    int state;
    double start;
    int at; /* work->power[at] belongs to its beginning */
    slider slider;
} cycle_part;

/* x and y at exp(i theta) = z. */
static void values_at(int n_harm, const double *x, const double *y, const double *z, double *at_x,
                      double *at_y) {
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

double bd_clear_value(int n_harm, const double *f, double start, double length) {
    static const double position[4] = {0.29, 0.67, 0.11, 0.87};
    const int n_coef = bd_n_coef(n_harm);
    double size = 0.0, value = bd_trig_value(n_harm, f, start + 0.5 * length);
    for (int i = 0; i < n_coef; ++i) size += fabs(f[i]);
    for (int i = 0; i < 4 && fabs(value) <= 1e-3 * size; ++i) {
        const double other = bd_trig_value(n_harm, f, start + position[i] * length);
        if (fabs(other) > fabs(value)) value = other;
    }
    return value;
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

void bd_slider_whole_cycle(bd_event_work *work, int d, int state) {
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

/* Shift starts into [0, 2 pi), ascending: the cycle may begin at any event. */
static void arrange_segments(bd_event_work *work, int d) {
    bd_segment *segment = work->segment[d];
    int n = work->n_segment[d];
    if (n > 1 && segment[n - 1].state == segment[0].state) { /* the cycle began inside a part */
        segment[n - 1].end = segment[0].end + BD_TWO_PI;
        --n;
        memmove(segment, segment + 1, sizeof *segment * (size_t)n);
        work->n_segment[d] = n;
    }
    int n_shifted = 0; /* parts at the end that lie in the next period */
    for (int i = 0; i < n; ++i)
        if (segment[i].start >= BD_TWO_PI) {
            segment[i].start -= BD_TWO_PI;
            segment[i].end -= BD_TWO_PI;
            ++n_shifted;
        }
    reverse(segment, n - n_shifted);
    reverse(segment + n - n_shifted, n_shifted);
    reverse(segment, n);
    /* the same instant except for rounding */
    if (n_shifted > 0 && n_shifted < n) segment[n_shifted - 1].end = segment[n_shifted].start;
}

/* ---- pieces between events ---- */

static void sort_events(bd_direction *dir) {
    bd_event_work *work = dir->work;
    for (int i = 0; i < dir->n_event; ++i) {
        int j = i;
        for (; j > 0 && work->event_theta[work->order[j - 1]] > work->event_theta[i]; --j)
            work->order[j] = work->order[j - 1];
        work->order[j] = i;
    }
}

static double piece_end(const bd_direction *dir, int i) {
    const bd_event_work *work = dir->work;
    const int n = dir->n_event;
    return i + 1 < n ? work->event_theta[work->order[i + 1]]
                     : work->event_theta[work->order[0]] + BD_TWO_PI;
}

/* Signs in every piece. They are evaluated inside the longest piece, where the values are farthest
 * from zero. Every event is a sign change of one polynomial, so the signs of the other pieces
 * follow by toggling. */
static void flag_pieces(bd_direction *dir, const bd_element *element, const double *v) {
    bd_event_work *work = dir->work;
    const int n = dir->n_event;
    int longest = 0, flags = 0;
    double length = -1.0;
    for (int i = 0; i < n; ++i) {
        const double l = piece_end(dir, i) - work->event_theta[work->order[i]];
        if (l > length) length = l, longest = i;
    }
    const double start = work->event_theta[work->order[longest]];
    if (dir->n_lift == 0) {
        flags |= CONTACT;
    } else {
        double *level = work->polynomial; /* n0 + kn v */
        for (int i = 0; i < dir->n_coef; ++i) level[i] = element->kn * v[i];
        level[0] += element->n0;
        if (bd_clear_value(dir->n_harm, level, start, length) > 0.0) flags |= CONTACT;
    }
    if (bd_clear_value(dir->n_harm, dir->dlo, start, length) > 0.0) flags |= LO_RISES;
    if (bd_clear_value(dir->n_harm, dir->dhi, start, length) < 0.0) flags |= HI_FALLS;
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

/* ---- cycle ---- */

static slider clip_at_end(const bd_direction *dir, slider s, int flags, int event) {
    const bd_event_work *work = dir->work;
    const double lo = work->event_lo[event], hi = work->event_hi[event];
    if (!(flags & CONTACT)) return (slider){SET_BY_CLOSING, event, 0.5 * (lo + hi)};
    if (s.w < lo) return (slider){SET_BY_LO, event, lo};
    if (s.w > hi) return (slider){SET_BY_HI, event, hi};
    return s;
}

/* Slider at the first event of the steady cycle. */
static slider settle(const bd_direction *dir, double w) {
    const bd_event_work *work = dir->work;
    const int n = dir->n_event;
    slider s = {INITIAL, -1, w};
    for (int i = 0; i < n; ++i)
        s = clip_at_end(dir, s, work->piece[i], work->order[i + 1 < n ? i + 1 : 0]);
    return s;
}

/* Add the current sticking part, whose slider was set at its beginning, with the slider's
 * derivative dw. */
static void add_stick(const bd_direction *dir, const cycle_part *part) {
    bd_event_work *work = dir->work;
    const double *b = work->power[part->at] + 1;
    if (!work->cycle.stick_slider_u) {
        bd_cycle_add_stick(&work->cycle, work->part_sum + 1, part->slider.w, NULL, NULL);
        return;
    }
    double factor = part->slider.kind == SET_BY_LO ? -dir->r : dir->r;
    if (part->slider.kind == SET_BY_CLOSING) {
        /* u' = (lo' + hi')/2 and v' = (hi' - lo')/(2 r); the point sticks afterwards, so
         * |u'/v'| <= r */
        double dlo, dhi;
        values_at(dir->n_harm, dir->dlo, dir->dhi, work->event_z + 2 * part->slider.event, &dlo,
                  &dhi);
        factor = dhi > dlo ? -dir->r * fmax(-1.0, fmin(1.0, (dhi + dlo) / (dhi - dlo))) : 0.0;
    }
    for (int i = 0; i < dir->n_coef; ++i) work->slider_v[i] = factor * b[i];
    bd_cycle_add_stick(&work->cycle, work->part_sum + 1, part->slider.w, b, work->slider_v);
}

/* Change the state at theta (exp(i theta) = z): add up the part that ends
 * and begin the next one. */
static void change_state(const bd_direction *dir, int d, cycle_part *part, int state, double theta,
                         const double *z, slider s, bd_status_share *share) {
    bd_event_work *work = dir->work;
    double *from = work->power[part->at], *to = work->power[!part->at];
    if (part->state == state) return;
    bd_trig_powers_of(2 * dir->n_harm, z, to);
    if (part->state != NO_STATE) {
        const double length = theta - part->start;
        push_segment(work, d, part->start, theta, part->state);
        if (part->state == BD_STICK) {
            memset(work->part_sum, 0, sizeof(double) * (size_t)dir->n_power);
            bd_cycle_integrate(dir->n_harm, work->part_sum, length, from, to, 1.0);
            for (int n = 0; n < dir->n_power; ++n) work->cycle.stick[n] += work->part_sum[n];
            add_stick(dir, part);
        } else if (part->state != BD_OPEN) {
            bd_cycle_integrate(dir->n_harm, work->cycle.slip, length, from, to,
                               part->state == BD_SLIP_PLUS ? 1.0 : -1.0);
            share->slip[d] += length;
        }
    }
    part->at = !part->at;
    part->state = state;
    part->start = theta;
    part->slider = s;
}

/* Angle at which lo (hi) first reaches w in a piece over which it rises (falls). */
static double find_onset(const bd_direction *dir, int plus, double w, double start, double end,
                         double *z) {
    double *bound = dir->work->polynomial; /* lo - w or hi - w */
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
    const double k = fmax(-1.0, fmin(1.0, -bound[0] / size)),
                 m = sqrt((1.0 - k) * (1.0 + k)) * (plus ? -1.0 : 1.0);
    z[0] = c * k - s * m;
    z[1] = s * k + c * m;
    double onset = atan2(z[1], z[0]);
    while (onset < start - 1e-9) onset += BD_TWO_PI;
    while (onset > end + 1e-9) onset -= BD_TWO_PI;
    const double within = fmax(start, fmin(end, onset));
    if (within != onset) { /* rounding: recompute z for the same angle */
        z[0] = cos(within);
        z[1] = sin(within);
    }
    return within;
}

/* Advance through one piece and return the slider at its end. */
static slider slider_through_piece(const bd_direction *dir, int d, int i, double shift, slider s,
                                   cycle_part *part, bd_status_share *share) {
    bd_event_work *work = dir->work;
    const int n = dir->n_event;
    const int start = work->order[i], end = work->order[i + 1 < n ? i + 1 : 0],
              flags = work->piece[i];
    const double *z = work->event_z + 2 * start, theta = work->event_theta[start] + shift;
    if (!(flags & CONTACT)) {
        change_state(dir, d, part, BD_OPEN, theta, z, s, share);
        return clip_at_end(dir, s, flags, end);
    }
    const int set_now = s.event == start && s.kind != INITIAL;
    const int plus_now = set_now && s.kind != SET_BY_HI && (flags & LO_RISES);
    const int minus_now = set_now && s.kind != SET_BY_LO && (flags & HI_FALLS);
    if (plus_now || minus_now) {
        change_state(dir, d, part, plus_now ? BD_SLIP_PLUS : BD_SLIP_MINUS, theta, z, s, share);
        return (slider){plus_now ? SET_BY_LO : SET_BY_HI, end,
                        plus_now ? work->event_lo[end] : work->event_hi[end]};
    }
    const slider after = clip_at_end(dir, s, flags, end);
    change_state(dir, d, part, BD_STICK, theta, z, s, share);
    if (after.kind == s.kind && after.event == s.event) return s; /* the slider did not move */
    const int plus = after.kind == SET_BY_LO;
    /* slip resumes at the start of the piece */
    if (plus ? work->event_lo[start] >= s.w : work->event_hi[start] <= s.w) {
        change_state(dir, d, part, plus ? BD_SLIP_PLUS : BD_SLIP_MINUS, theta, z, after, share);
        return after;
    }
    double at[2];
    const double onset =
        find_onset(dir, plus, s.w, work->event_theta[start], piece_end(dir, i), at) + shift;
    change_state(dir, d, part, plus ? BD_SLIP_PLUS : BD_SLIP_MINUS, onset, at, after, share);
    return after;
}

/* Add up the steady cycle. It starts at the event that set the slider, so every part begins where
 * its slider was set. */
static void sum_cycle(const bd_direction *dir, int d, slider s, bd_status_share *share) {
    bd_event_work *work = dir->work;
    const int n = dir->n_event;
    cycle_part part = {.state = NO_STATE};
    int first = 0;
    while (work->order[first] != s.event) ++first;
    for (int k = 0; k < n; ++k) {
        const int i = first + k < n ? first + k : first + k - n;
        s = slider_through_piece(dir, d, i, first + k < n ? 0.0 : BD_TWO_PI, s, &part, share);
    }
    const int event = work->order[first];
    change_state(dir, d, &part, NO_STATE, work->event_theta[event] + BD_TWO_PI,
                 work->event_z + 2 * event, s, share);
    arrange_segments(work, d);
}

int bd_slider_cycle(bd_direction *dir, int d, const bd_element *element, const double *v,
                    bd_status_share *share) {
    bd_event_work *work = dir->work;
    sort_events(dir);
    flag_pieces(dir, element, v);
    for (int e = 0; e < dir->n_event; ++e)
        values_at(dir->n_harm, dir->lo, dir->hi, work->event_z + 2 * e, work->event_lo + e,
                  work->event_hi + e);
    const slider s = settle(dir, element->w[d]);
    if (s.kind == INITIAL) return 0;
    sum_cycle(dir, d, s, share);
    share->slip[d] /= BD_TWO_PI;
    share->stick[d] = work->cycle.stick[0] / BD_TWO_PI;
    return 1;
}
