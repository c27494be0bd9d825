/* Contact law of the time integration: forces, states and derivatives at one instant.
 * generalised_alpha.c includes this file, once for each instruction set.
 *
 * The law advances from one instant to the next. The normal force is N = max(n0 + kn v, 0). The
 * slider is clipped to u -+ r/kt with the friction limit r, mu N or mu times a constant load. A
 * coupled law returns the friction force radially to the disk of radius r. */
#ifndef BD_TIME_CONTACT_LAW_H
#define BD_TIME_CONTACT_LAW_H

#include "time/integration.h"
#include "util/vector_types.h"

/* Parameters of BD_WIDTH points, explained in integration.h. */
typedef struct {
    bd_vec kt[2], inverse_kt[2], cubic[2], fixed_slider[2];
    bd_vec shift[3];
    bd_vec kn, n0, least_n, limit, mu, coupled, user_law;
} points;

/* Parameters of the BD_WIDTH points from `first` on; t->parameters has rows of `stride` points. */
BD_INLINE points load_parameters(const bd_time *t, size_t first) {
    points out;
    const double *parameter = t->parameters + first;
    const size_t stride = t->stride;
    for (size_t d = 0; d < 2; ++d) {
        out.kt[d] = bd_load(parameter + (BD_TIME_KT + d) * stride);
        out.inverse_kt[d] = bd_load(parameter + (BD_TIME_INVERSE_KT + d) * stride);
        out.cubic[d] = bd_load(parameter + (BD_TIME_CUBIC + d) * stride);
        out.fixed_slider[d] = bd_load(parameter + (BD_TIME_FIXED_SLIDER + d) * stride);
    }
    for (size_t d = 0; d < 3; ++d) out.shift[d] = bd_load(parameter + (BD_TIME_SHIFT + d) * stride);
    out.kn = bd_load(parameter + BD_TIME_KN * stride);
    out.n0 = bd_load(parameter + BD_TIME_N0 * stride);
    out.least_n = bd_load(parameter + BD_TIME_LEAST_N * stride);
    out.limit = bd_load(parameter + BD_TIME_LIMIT * stride);
    out.mu = bd_load(parameter + BD_TIME_MU * stride);
    out.coupled = bd_load(parameter + BD_TIME_COUPLED * stride);
    out.user_law = bd_load(parameter + BD_TIME_USER_LAW * stride);
    return out;
}

/* Forces F (3) of BD_WIDTH points at the motion x (3), and their sliders, moved from w to next_w.
 * Both are (2, stride) and begin at the first of these points. With the normal force N = max(n0 +
 * kn v, least) and the friction limit r = limit + mu N,
 *
 *     uncoupled   w_d <- clip(w_d, u_d - r/kt_d, u_d + r/kt_d),
 *     coupled     w_d <- u_d - share (u_d - w_d),   share = min(1, r/|T|),   T_d = kt_d (u_d - w_d),
 *     both        T_d = kt_d (u_d - w_d) + cubic_d u_d^3   with the moved slider. */
BD_INLINE void contact_forces(const bd_time *t, const points *at, const bd_vec *x, const double *w,
                              double *next_w, bd_vec *F) {
    const bd_vec zero = bd_all(0.0);
    const bd_vec one = bd_all(1.0);
    const bd_vec normal = bd_max(at->n0 + at->kn * x[2], at->least_n);
    const bd_vec r = at->limit + at->mu * normal; /* friction limit */

    /* each slider stays unless the motion moves it */
    bd_vec before[2], next[2];
    for (size_t d = 0; d < 2; ++d) {
        const bd_vec half_width = r * at->inverse_kt[d];
        const bd_vec lowest = x[d] - half_width;
        const bd_vec highest = x[d] + half_width;
        before[d] = bd_load(w + d * t->stride);
        next[d] = bd_min(bd_max(before[d], lowest), highest);
    }
    /* coupled laws: the force returns radially to the disk of radius r */
    if (t->has_coupled) {
        const bd_vec T0 = at->kt[0] * (x[0] - before[0]);
        const bd_vec T1 = at->kt[1] * (x[1] - before[1]);
        const bd_vec size = bd_root(T0 * T0 + T1 * T1);
        const bd_mask slips = bd_above(size, r);
        /* lanes that stick may have size 0 */
        const bd_vec divisor = bd_select(slips, size, one);
        const bd_vec share = bd_select(slips, r / divisor, one);
        for (size_t d = 0; d < 2; ++d) {
            const bd_mask is_radial = bd_above(at->coupled, zero) & bd_above(at->kt[d], zero);
            const bd_vec radial = x[d] - share * (x[d] - before[d]);
            next[d] = bd_select(is_radial, radial, next[d]);
        }
    }
    for (size_t d = 0; d < 2; ++d) {
        const bd_mask is_fixed = bd_above(at->fixed_slider[d], zero);
        next[d] = bd_select(is_fixed, before[d], next[d]);
        bd_store(next_w + d * t->stride, next[d]);
        F[d] = at->kt[d] * (x[d] - next[d]);
        if (t->has_cubic) F[d] = F[d] + at->cubic[d] * x[d] * x[d] * x[d];
    }
    F[2] = normal;
}

/* Input (3) of the user law of a point at the motion x (3): its normal motion includes the static
 * closing, which the motion of the time integration lacks. */
BD_INLINE void user_law_motion(const bd_time *t, size_t point, const double *x, double *input) {
    const double *parameter = t->parameters + point;
    const double kn = parameter[BD_TIME_KN * t->stride];
    const double n0 = parameter[BD_TIME_N0 * t->stride];
    for (size_t d = 0; d < 3; ++d) input[d] = x[d];
    input[2] += bd_static_closing(kn, n0);
}

/* Forces of the points with user laws, point by point. */
BD_NOT_INLINE void user_law_forces(bd_time *t, const double *x, double *F) {
    const size_t stride = t->stride;
    const size_t n_point = (size_t)t->n_point;
    for (size_t point = 0; point < n_point; ++point) {
        const bd_point_law *law = t->point_law + point;
        if (!law->function) continue;
        for (size_t sector = 0; sector < (size_t)t->n_sector; ++sector) {
            const size_t row = sector * t->rows + point;
            const double motion[3] = {x[row], x[row + stride], x[row + 2 * stride]};
            const size_t first_memory = (sector * n_point + point) * (size_t)t->n_memory;
            double input[3], force[3];
            user_law_motion(t, point, motion, input);
            bd_point_law_step(law, input, t->law_memory[0] + first_memory,
                              t->law_memory[1] + first_memory, force, NULL);
            for (size_t d = 0; d < 3; ++d) F[row + d * stride] = force[d];
        }
    }
}

/* Motion (3) of the BD_WIDTH points from `first` on, out of x (n_sector, rows). */
BD_INLINE void load_motion(const bd_time *t, const double *x, size_t sector, size_t first,
                           bd_vec *motion) {
    const double *of_points = x + sector * t->rows + first;
    for (size_t d = 0; d < 3; ++d) motion[d] = bd_load(of_points + d * t->stride);
}

/* Forces F (n_sector, rows) of all contacts at the motion x; moves the sliders. */
static void all_contact_forces(bd_time *t, const double *x, double *F) {
    const size_t stride = t->stride;
    for (size_t first = 0; first < (size_t)t->n_point; first += BD_WIDTH) {
        const points parameters = load_parameters(t, first);
        for (size_t sector = 0; sector < (size_t)t->n_sector; ++sector) {
            const size_t first_slider = 2 * stride * sector + first;
            bd_vec motion[3], force[3];
            load_motion(t, x, sector, first, motion);
            contact_forces(t, &parameters, motion, t->slider + first_slider,
                           t->next_slider + first_slider, force);
            double *of_points = F + sector * t->rows + first;
            for (size_t d = 0; d < 3; ++d) bd_store(of_points + d * stride, force[d]);
        }
    }
    if (t->n_user_law) user_law_forces(t, x, F);
}

/* ---- derivative of the forces ---- */

/* Parts of the number of a contact state. Stick, slip+ and slip- of direction d are digits 0, 1, 2
 * with the place value 2 or 6, and contact is 1, so the sum below 18 is unique. A derivative that
 * changes continuously adds 18. */
enum { IN_CONTACT = 1, PLACE_OF_1 = 2, PLACE_OF_2 = 6, SLIDES_IN_PLANE = 18 };

/* Number of the contact state of BD_WIDTH points at the motion x (3) with the sliders w (2, stride)
 * before the step: IN_CONTACT, plus the place value of each direction that slips in the positive
 * sense, or twice the value in the negative sense. Two points with equal numbers below
 * SLIDES_IN_PLANE have equal derivatives. */
BD_INLINE bd_vec contact_state_of(const bd_time *t, const points *at, const bd_vec *x,
                                  const double *w) {
    static const double SLIP_PLUS[2] = {PLACE_OF_1, PLACE_OF_2};
    static const double SLIP_MINUS[2] = {2.0 * PLACE_OF_1, 2.0 * PLACE_OF_2};
    const bd_vec zero = bd_all(0.0);
    const bd_vec normal = at->n0 + at->kn * x[2];
    const bd_vec r = at->limit + at->mu * bd_max(normal, at->least_n);
    const bd_mask closed = bd_above(normal, at->least_n);
    const bd_mask coupled = bd_above(at->coupled, zero);
    bd_vec state = bd_select(closed, bd_all(IN_CONTACT), zero);
    bd_vec T[2];
    for (size_t d = 0; d < 2; ++d) {
        const bd_vec before = bd_load(w + d * t->stride);
        const bd_vec half_width = r * at->inverse_kt[d];
        const bd_mask is_fixed = bd_above(at->fixed_slider[d], zero);
        const bd_mask may_slip = closed & ~is_fixed & ~coupled;
        const bd_mask slips_plus = may_slip & bd_above(x[d] - half_width, before);
        const bd_mask slips_minus = may_slip & bd_above(before, x[d] + half_width);
        state += bd_select(slips_plus, bd_all(SLIP_PLUS[d]), zero);
        state += bd_select(slips_minus, bd_all(SLIP_MINUS[d]), zero);
        T[d] = at->kt[d] * (x[d] - before);
    }
    const bd_mask slides = closed & coupled & bd_above(T[0] * T[0] + T[1] * T[1], r * r);
    const bd_mask cubic = bd_differ(at->cubic[0], zero) | bd_differ(at->cubic[1], zero);
    const bd_mask changes = slides | cubic | bd_above(at->user_law, zero);
    return state + bd_select(changes, bd_all(SLIDES_IN_PLANE), zero);
}

/* Derivative D (3, 3) of the forces of a point with a user law; overwrites its
 * memory after the step. */
static void user_law_tangent(bd_time *t, size_t sector, size_t point, const double *x, double *D) {
    const bd_point_law *law = t->point_law + point;
    const size_t n_memory = (size_t)t->n_memory;
    const size_t first_memory = (sector * (size_t)t->n_point + point) * n_memory;
    bd_point_law_derivatives derivatives =
        bd_point_law_derivatives_in(t->derivatives, law->n_state);
    double input[3], force[3];
    user_law_motion(t, point, x, input);
    bd_point_law_step(law, input, t->law_memory[0] + first_memory, t->law_memory[1] + first_memory,
                      force, &derivatives);
    bd_point_law_tangent(law, &derivatives, D);
}

/* Derivative D (3, 3), rows T1, T2, N, of the forces of a point of a sector with respect to the
 * motion x = (u1, u2, v) at the end of a step, with the slider w before it. With the friction limit
 * r, whose derivative with respect to v is mu kn, direction d has
 *
 *     stick            dT_d = kt_d du_d
 *     slip             dT_d = +- mu kn dv                         (T_d = +- r)
 *     slip in plane    dT_d = r/|T| (kt_d du_d - T_d T . kt du/|T|^2) + mu kn T_d/|T| dv
 *     open             dT_d = 0,
 *
 * plus 3 cubic_d u_d^2 du_d; and dN = kn dv in contact. */
static void contact_tangent(bd_time *t, size_t sector, size_t point, const double *x,
                            const double *w, double *D) {
    if (t->n_user_law && t->point_law[point].function) {
        user_law_tangent(t, sector, point, x, D);
        return;
    }
    const size_t stride = t->stride;
    const double *parameter = t->parameters + point;
    const double *kt = parameter + BD_TIME_KT * stride;
    const double mu = parameter[BD_TIME_MU * stride];
    const double least_n = parameter[BD_TIME_LEAST_N * stride];
    const double normal = parameter[BD_TIME_N0 * stride] + parameter[BD_TIME_KN * stride] * x[2];
    const int is_closed = normal > least_n;
    const double kn = is_closed ? parameter[BD_TIME_KN * stride] : 0.0;
    const double limit_slope = mu * kn; /* change of the friction limit with the normal motion */
    const double r = parameter[BD_TIME_LIMIT * stride] + mu * (is_closed ? normal : least_n);
    const double T[2] = {kt[0] * (x[0] - w[0]), kt[stride] * (x[1] - w[1])};
    const double size = sqrt(T[0] * T[0] + T[1] * T[1]);
    const int is_coupled = parameter[BD_TIME_COUPLED * stride] > 0.0;
    const int slips_in_plane = is_coupled && size > r;
    memset(D, 0, BD_N_COMPONENT * BD_N_COMPONENT * sizeof *D);
    D[BD_N_COMPONENT * BD_NORMAL + BD_NORMAL] = kn;
    for (size_t d = 0; d < 2; ++d) {
        const double kt_d = kt[d * stride];
        const double cubic = parameter[(BD_TIME_CUBIC + d) * stride];
        const double half_width = r * parameter[(BD_TIME_INVERSE_KT + d) * stride];
        const int is_fixed = parameter[(BD_TIME_FIXED_SLIDER + d) * stride] > 0.0;
        const int is_within = w[d] >= x[d] - half_width && w[d] <= x[d] + half_width;
        double *row = D + BD_N_COMPONENT * d;
        double *own = row + d;               /* dT_d/du_d */
        double *by_normal = row + BD_NORMAL; /* dT_d/dv */
        *own = 3.0 * cubic * x[d] * x[d];
        if (is_fixed) {
            *own += kt_d;
            continue;
        }
        const int is_open = !(r > 0.0);
        if (is_open) continue; /* the slider follows the motion */
        if (slips_in_plane) {
            /* the force is r T/size, size = |T| */
            for (size_t e = 0; e < 2; ++e)
                row[e] -= r / (size * size * size) * T[d] * T[e] * kt[e * stride];
            *own += r / size * kt_d;
            *by_normal += limit_slope * T[d] / size;
        } else if (is_coupled || is_within) {
            *own += kt_d; /* stick */
        } else if (kt_d > 0.0) {
            /* slip along one direction: the force is the friction limit */
            *by_normal += w[d] < x[d] ? limit_slope : -limit_slope;
        }
    }
}

/* Whether a contact state is an open one. */
BD_INLINE int is_open_state(int state) { return (state & IN_CONTACT) == 0; }

/* Force F (3) and derivative D (3, 3) of a point in a given state below SLIDES_IN_PLANE, at the
 * motion x (3) with the slider w (2, stride) before the step. In such a state the force is affine:
 *
 *     stick   T_d = kt_d (u_d - w_d)        closed   N = n0 + kn v,     r = limit + mu N
 *     slip    T_d = +- r                    open     N = least N,       T_d = 0. */
static void force_in_state(const bd_time *t, size_t point, int state, const double *x,
                           const double *w, double *F, double *D) {
    const size_t stride = t->stride;
    const double *parameter = t->parameters + point;
    const double mu = parameter[BD_TIME_MU * stride];
    const int is_closed = !is_open_state(state);
    const double kn = is_closed ? parameter[BD_TIME_KN * stride] : 0.0;
    /* only points that can open have a finite least force, 0 */
    const double normal = is_closed ? parameter[BD_TIME_N0 * stride] + kn * x[2] : 0.0;
    const double r = parameter[BD_TIME_LIMIT * stride] + mu * normal;
    const int of_both_directions = (state - is_closed * IN_CONTACT) / PLACE_OF_1;
    const int digit[2] = {of_both_directions % 3, of_both_directions / 3};

    memset(D, 0, BD_N_COMPONENT * BD_N_COMPONENT * sizeof *D);
    D[BD_N_COMPONENT * BD_NORMAL + BD_NORMAL] = kn;
    F[BD_NORMAL] = normal;
    for (size_t d = 0; d < 2; ++d) {
        const double kt = parameter[(BD_TIME_KT + d) * stride];
        const int is_fixed = parameter[(BD_TIME_FIXED_SLIDER + d) * stride] > 0.0;
        const int sticks = is_closed && digit[d] == 0;
        F[d] = 0.0;
        if (is_fixed || sticks) {
            F[d] = kt * (x[d] - w[d * stride]);
            D[BD_N_COMPONENT * d + d] = kt;
        } else if (is_closed && kt > 0.0) {
            const double sign = digit[d] == 1 ? 1.0 : -1.0;
            F[d] = sign * r;
            D[BD_N_COMPONENT * d + BD_NORMAL] = sign * mu * kn;
        }
    }
}

#endif
