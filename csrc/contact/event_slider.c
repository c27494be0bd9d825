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
 * The slip-to-stick event is the end of a slip, lo' = 0 or hi' = 0.
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

/* Cause of the slider's position: initial, an end of slip on lo or hi, a closing of the contact. */
enum { INITIAL, SET_BY_LO, SET_BY_HI, SET_BY_CLOSING };

/* Flags of a piece between two events: in contact; bounds that move towards the slider. */
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

/* Values of two trigonometric polynomials x and y (n_coef) at exp(i theta) = z. exp(i l theta)
 * follows from the previous harmonic by a product with z. */
static void values_at(int n_harm, const double *x, const double *y, const double *z, double *at_x,
                      double *at_y) {
    const double c = z[0], s = z[1];
    double re = c, im = s; /* exp(i l theta) */
    double sum_x = x[0], sum_y = y[0];
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

/* Value of the trigonometric polynomial f (n_coef) inside the interval of this length, where its
 * sign is clear: in the middle or, if this is nearly a double root, at other positions. Return the
 * first value that is not small, otherwise the largest of all. */
double bd_clear_value(int n_harm, const double *f, double start, double length) {
    enum { N_OTHER = 4 };
    static const double other_position[N_OTHER] = {0.29, 0.67, 0.11, 0.87};
    static const double SMALL = 1e-3; /* relative to the sum of the coefficients */
    const int n_coef = bd_n_coef(n_harm);
    double size = 0.0;
    for (int i = 0; i < n_coef; ++i) size += fabs(f[i]);
    double value = bd_trig_value(n_harm, f, start + 0.5 * length);
    for (int i = 0; i < N_OTHER; ++i) {
        const int is_small = fabs(value) <= SMALL * size;
        if (!is_small) return value;
        const double other = bd_trig_value(n_harm, f, start + other_position[i] * length);
        if (fabs(other) > fabs(value)) value = other;
    }
    return value;
}

/* ---- parts of the cycle ---- */

/* Append a part of the cycle, or extend the last one if the state has not changed. */
static void push_segment(bd_event_work *work, int d, double start, double end, int state) {
    bd_segment *segment = work->segment[d];
    const int n = work->n_segment[d];
    const int continues = n > 0 && segment[n - 1].state == state && segment[n - 1].end == start;
    if (continues) {
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

/* Reverse the order of n parts of the cycle. */
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

    /* the cycle began inside a part: its end and its beginning are one part */
    if (n > 1 && segment[n - 1].state == segment[0].state) {
        segment[n - 1].end = segment[0].end + BD_TWO_PI;
        --n;
        memmove(segment, segment + 1, sizeof *segment * (size_t)n);
        work->n_segment[d] = n;
    }

    int n_shifted = 0; /* parts at the end that lie in the next period */
    for (int i = 0; i < n; ++i) {
        if (segment[i].start < BD_TWO_PI) continue;
        segment[i].start -= BD_TWO_PI;
        segment[i].end -= BD_TWO_PI;
        ++n_shifted;
    }

    /* three reversals rotate the shifted parts to the front */
    const int n_unshifted = n - n_shifted;
    reverse(segment, n_unshifted);
    reverse(segment + n_unshifted, n_shifted);
    reverse(segment, n);

    /* the same instant except for rounding */
    if (n_shifted > 0 && n_shifted < n) segment[n_shifted - 1].end = segment[n_shifted].start;
}

/* ---- pieces between events ---- */

/* Insertion sort by angle: the three lists of roots are sorted already. */
static void sort_events(bd_direction *dir) {
    const double *theta = dir->work->event_theta;
    int *order = dir->work->order;
    for (int i = 0; i < dir->n_event; ++i) {
        int j = i;
        while (j > 0 && theta[order[j - 1]] > theta[i]) {
            order[j] = order[j - 1];
            --j;
        }
        order[j] = i;
    }
}

/* Event at the end of piece i: the next one. */
static int event_after(const bd_direction *dir, int i) {
    const int next = i + 1 < dir->n_event ? i + 1 : 0;
    return dir->work->order[next];
}

/* Angle at the end of piece i; the last piece ends in the next period. */
static double piece_end(const bd_direction *dir, int i) {
    const double theta = dir->work->event_theta[event_after(dir, i)];
    const int is_last = i + 1 == dir->n_event;
    return is_last ? theta + BD_TWO_PI : theta;
}

/* Index and length (angle) of the longest piece between two events. Piece i begins at event i in
 * the order of angles. */
static int longest_piece(const bd_direction *dir, double *length) {
    const bd_event_work *work = dir->work;
    int longest = 0;
    *length = -1.0;
    for (int i = 0; i < dir->n_event; ++i) {
        const double start = work->event_theta[work->order[i]];
        const double length_of_piece = piece_end(dir, i) - start;
        if (length_of_piece > *length) {
            *length = length_of_piece;
            longest = i;
        }
    }
    return longest;
}

/* Return whether n0 + kn v is positive in a piece. */
static int is_in_contact(const bd_direction *dir, const bd_element *element, const double *v,
                         double start, double length) {
    if (dir->n_lift == 0) return 1; /* an open point has no slider */
    double *g = dir->work->polynomial;
    for (int i = 0; i < dir->n_coef; ++i) g[i] = element->kn * v[i];
    g[0] += element->n0;
    return bd_clear_value(dir->n_harm, g, start, length) > 0.0;
}

/* Flags whose polynomials change sign at an event. */
static int flags_changed_by(const bd_direction *dir, int event) {
    if (event < dir->n_lift) return CONTACT;
    if (dir->common) return LO_RISES | HI_FALLS;
    return event < dir->n_lift + dir->n_lo ? LO_RISES : HI_FALLS;
}

/* Signs in every piece. They are evaluated inside the longest piece, where the values are farthest
 * from zero. Every event is a sign change of one polynomial, so the signs of the other pieces
 * follow by toggling. */
static void flag_pieces(bd_direction *dir, const bd_element *element, const double *v) {
    bd_event_work *work = dir->work;
    const int n = dir->n_event, n_harm = dir->n_harm;
    double length;
    const int longest = longest_piece(dir, &length);
    const double start = work->event_theta[work->order[longest]];
    int flags = 0;
    if (is_in_contact(dir, element, v, start, length)) flags |= CONTACT;
    if (bd_clear_value(n_harm, dir->dlo, start, length) > 0.0) flags |= LO_RISES;
    if (bd_clear_value(n_harm, dir->dhi, start, length) < 0.0) flags |= HI_FALLS;
    work->piece[longest] = flags;
    for (int k = 1; k < n; ++k) {
        const int i = (longest + k) % n;
        flags ^= flags_changed_by(dir, work->order[i]);
        work->piece[i] = flags;
    }
}

/* ---- cycle ---- */

/* Slider at the event that ends a piece with these flags: s, clipped to the bounds [lo, hi] there.
 * In open contact it follows the displacement u = (lo + hi)/2. */
static slider clip_at_end(const bd_direction *dir, slider s, int flags, int event) {
    const double lo = dir->work->event_lo[event], hi = dir->work->event_hi[event];
    if (!(flags & CONTACT)) return (slider){SET_BY_CLOSING, event, 0.5 * (lo + hi)};
    if (s.w < lo) return (slider){SET_BY_LO, event, lo};
    if (s.w > hi) return (slider){SET_BY_HI, event, hi};
    return s;
}

/* Slider at the first event of the steady cycle: one period of clips at the events from the initial
 * slider w. The map of one period is a clip, so another period would not change it. */
static slider settle(const bd_direction *dir, double w) {
    const int *piece = dir->work->piece;
    slider s = {INITIAL, -1, w};
    for (int i = 0; i < dir->n_event; ++i) s = clip_at_end(dir, s, piece[i], event_after(dir, i));
    return s;
}

/* Factor f in the derivative dw = b.du + f b.dv of the slider at the start of a sticking part, with
 * the basis b at the instant that set it and r = mu kn/kt:
 *
 *     set by lo    f = -r
 *     set by hi    f = r
 *     closing      f = -u'/v',    u' = (lo' + hi')/2,   v' = (hi' - lo')/(2 r). */
static double slider_by_normal_motion(const bd_direction *dir, slider s) {
    if (s.kind == SET_BY_LO) return -dir->r;
    if (s.kind != SET_BY_CLOSING) return dir->r;

    double dlo, dhi;
    const double *z = dir->work->event_z + 2 * s.event;
    values_at(dir->n_harm, dir->dlo, dir->dhi, z, &dlo, &dhi);
    if (!(dhi > dlo)) return 0.0;
    /* the point sticks afterwards, so |u'/v'| <= r */
    const double ratio = fmax(-1.0, fmin(1.0, (dhi + dlo) / (dhi - dlo)));
    return -dir->r * ratio;
}

/* Add the current sticking part, whose slider was set at its beginning, with the slider's
 * derivative dw. */
static void add_stick(const bd_direction *dir, const cycle_part *part) {
    bd_event_work *work = dir->work;
    const double *basis = work->power[part->at] + 1; /* at the beginning of the part */
    const double *basis_integral = work->part_sum + 1;
    if (!work->cycle.stick_slider_u) {
        bd_cycle_add_stick(&work->cycle, basis_integral, part->slider.w, NULL, NULL);
        return;
    }
    const double factor = slider_by_normal_motion(dir, part->slider);
    for (int i = 0; i < dir->n_coef; ++i) work->slider_v[i] = factor * basis[i];
    bd_cycle_add_stick(&work->cycle, basis_integral, part->slider.w, basis, work->slider_v);
}

/* Add up the part of the cycle that ends at theta, whose powers of exp(i theta) are `to`. */
static void end_part(const bd_direction *dir, int d, const cycle_part *part, double theta,
                     const double *to, bd_status_share *share) {
    bd_event_work *work = dir->work;
    const int n_harm = dir->n_harm;
    const double *from = work->power[part->at];
    const double length = theta - part->start;
    push_segment(work, d, part->start, theta, part->state);
    if (part->state == BD_OPEN) return;
    if (part->state == BD_STICK) {
        memset(work->part_sum, 0, sizeof(double) * (size_t)dir->n_power);
        bd_cycle_integrate(n_harm, work->part_sum, length, from, to, 1.0);
        for (int n = 0; n < dir->n_power; ++n) work->cycle.stick[n] += work->part_sum[n];
        add_stick(dir, part);
        return;
    }
    const double sign = part->state == BD_SLIP_PLUS ? 1.0 : -1.0;
    bd_cycle_integrate(n_harm, work->cycle.slip, length, from, to, sign);
    share->slip[d] += length;
}

/* Change the state at theta (exp(i theta) = z): add up the part that ends
 * and begin the next one. */
static void change_state(const bd_direction *dir, int d, cycle_part *part, int state, double theta,
                         const double *z, slider s, bd_status_share *share) {
    if (part->state == state) return;
    double *to = dir->work->power[!part->at];
    bd_trig_powers_of(2 * dir->n_harm, z, to);
    if (part->state != NO_STATE) end_part(dir, d, part, theta, to, share);
    part->at = !part->at;
    part->state = state;
    part->start = theta;
    part->slider = s;
}

/* Solve f = 0 for one harmonic, cos(theta - phi) = k, on the rising (falling) side; z = exp(i
 * theta) of the root. */
static double closed_onset(const double *f, int rises, double start, double end, double *z) {
    const double size = hypot(f[1], f[2]);
    const double c = f[1] / size, s = f[2] / size; /* of phi */
    const double k = fmax(-1.0, fmin(1.0, -f[0] / size));
    const double m = sqrt((1.0 - k) * (1.0 + k)) * (rises ? -1.0 : 1.0); /* sin(theta - phi) */
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

/* Angle at which lo (hi) first reaches w in a piece over which it rises (falls). */
static double find_onset(const bd_direction *dir, int plus, double w, double start, double end,
                         double *z) {
    double *f = dir->work->polynomial; /* lo - w or hi - w */
    memcpy(f, plus ? dir->lo : dir->hi, sizeof(double) * (size_t)dir->n_coef);
    f[0] -= w;
    if (dir->n_harm == 1) return closed_onset(f, plus, start, end, z);

    const double onset = bd_trig_bracketed_root(dir->n_harm, f, start, end);
    z[0] = cos(onset);
    z[1] = sin(onset);
    return onset;
}

/* Advance the slider s through piece i, from event i to the next in order, and return it at the
 * end. Change the state of the current part where stick, slip or separation begins:
 *
 *     no contact                           open
 *     s lies on a bound that pushes it     slip from the start
 *     a bound reaches s in the piece       stick, then slip from this onset
 *     otherwise                            stick.
 *
 * Angles of pieces that begin in the next period are larger by `shift` = 2 pi. */
static slider slider_through_piece(const bd_direction *dir, int d, int i, double shift, slider s,
                                   cycle_part *part, bd_status_share *share) {
    const bd_event_work *work = dir->work;
    const int start = work->order[i], end = event_after(dir, i);
    const int flags = work->piece[i];
    const double *z = work->event_z + 2 * start;
    const double theta = work->event_theta[start] + shift;
    if (!(flags & CONTACT)) {
        change_state(dir, d, part, BD_OPEN, theta, z, s, share);
        return clip_at_end(dir, s, flags, end);
    }

    /* a slider that the first event has set lies on a bound, and follows it if the bound pushes */
    const int is_set_now = s.kind != INITIAL && s.event == start;
    if (is_set_now && s.kind != SET_BY_HI && (flags & LO_RISES)) {
        change_state(dir, d, part, BD_SLIP_PLUS, theta, z, s, share);
        return (slider){SET_BY_LO, end, work->event_lo[end]};
    }
    if (is_set_now && s.kind != SET_BY_LO && (flags & HI_FALLS)) {
        change_state(dir, d, part, BD_SLIP_MINUS, theta, z, s, share);
        return (slider){SET_BY_HI, end, work->event_hi[end]};
    }

    /* no bound pushes: after a slip this is the slip-to-stick event */
    change_state(dir, d, part, BD_STICK, theta, z, s, share);
    const slider after = clip_at_end(dir, s, flags, end);
    const int has_moved = after.kind != s.kind || after.event != s.event;
    if (!has_moved) return s;

    const int plus = after.kind == SET_BY_LO;
    const int slip = plus ? BD_SLIP_PLUS : BD_SLIP_MINUS;
    const int slips_at_start = plus ? work->event_lo[start] >= s.w : work->event_hi[start] <= s.w;
    if (slips_at_start) {
        change_state(dir, d, part, slip, theta, z, after, share);
        return after;
    }
    double z_onset[2];
    const double onset =
        find_onset(dir, plus, s.w, work->event_theta[start], piece_end(dir, i), z_onset);
    change_state(dir, d, part, slip, onset + shift, z_onset, after, share);
    return after;
}

/* Add up the steady cycle. It starts at the event that set the slider, so every part begins where
 * its slider was set. */
static void sum_cycle(const bd_direction *dir, int d, slider s, bd_status_share *share) {
    bd_event_work *work = dir->work;
    const int n = dir->n_event, event = s.event;
    cycle_part part = {.state = NO_STATE};
    int first = 0; /* piece after this event */
    while (work->order[first] != event) ++first;
    for (int i = first; i < n; ++i) s = slider_through_piece(dir, d, i, 0.0, s, &part, share);
    for (int i = 0; i < first; ++i) s = slider_through_piece(dir, d, i, BD_TWO_PI, s, &part, share);

    const double end = work->event_theta[event] + BD_TWO_PI;
    change_state(dir, d, &part, NO_STATE, end, work->event_z + 2 * event, s, share);
    arrange_segments(work, d);
}

/* Sort the events, find the flags of the pieces between them and the bounds of the slider at each
 * event. One period from the initial slider gives the steady slider, and a second one adds up the
 * cycle. */
int bd_slider_cycle(bd_direction *dir, int d, const bd_element *element, const double *v,
                    bd_status_share *share) {
    bd_event_work *work = dir->work;
    sort_events(dir);
    flag_pieces(dir, element, v);
    for (int e = 0; e < dir->n_event; ++e) {
        const double *z = work->event_z + 2 * e;
        values_at(dir->n_harm, dir->lo, dir->hi, z, work->event_lo + e, work->event_hi + e);
    }
    const slider s = settle(dir, element->w[d]);
    if (s.kind == INITIAL) return 0;

    sum_cycle(dir, d, s, share);
    share->slip[d] /= BD_TWO_PI;
    share->stick[d] = work->cycle.stick[0] / BD_TWO_PI;
    return 1;
}
