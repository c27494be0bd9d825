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

typedef struct {
    bd_vec kt[2], inverse_kt[2], cubic[2], fixed_slider[2], shift[3], kn, n0, least_n, limit, mu,
        coupled, user_law;
} points;

BD_INLINE points load_parameters(const bd_time *t, size_t p) {
    points out;
    const double *x = t->parameters + p;
    const size_t s = t->stride;
    for (size_t d = 0; d < 2; ++d) {
        out.kt[d] = bd_load(x + (BD_TIME_KT + d) * s);
        out.inverse_kt[d] = bd_load(x + (BD_TIME_INVERSE_KT + d) * s);
        out.cubic[d] = bd_load(x + (BD_TIME_CUBIC + d) * s);
        out.fixed_slider[d] = bd_load(x + (BD_TIME_FIXED_SLIDER + d) * s);
    }
    for (size_t d = 0; d < 3; ++d) out.shift[d] = bd_load(x + (BD_TIME_SHIFT + d) * s);
    out.kn = bd_load(x + BD_TIME_KN * s);
    out.n0 = bd_load(x + BD_TIME_N0 * s);
    out.least_n = bd_load(x + BD_TIME_LEAST_N * s);
    out.limit = bd_load(x + BD_TIME_LIMIT * s);
    out.mu = bd_load(x + BD_TIME_MU * s);
    out.coupled = bd_load(x + BD_TIME_COUPLED * s);
    out.user_law = bd_load(x + BD_TIME_USER_LAW * s);
    return out;
}

/* Compute the forces F (3) at the motion x (3); move the sliders from w to next_w. Both are
 * (2, stride) and begin at the first of these points. */
BD_INLINE void contact_forces(const bd_time *t, const points *at, const bd_vec *x, const double *w,
                              double *next_w, bd_vec *F) {
    const bd_vec zero = bd_all(0.0), one = bd_all(1.0);
    const bd_vec normal = bd_max(at->n0 + at->kn * x[2], at->least_n);
    const bd_vec r = at->limit + at->mu * normal;

    /* each slider stays unless the motion moves it */
    bd_vec before[2], next[2];
    for (size_t d = 0; d < 2; ++d) {
        const bd_vec half_width = r * at->inverse_kt[d];
        before[d] = bd_load(w + d * t->stride);
        next[d] = bd_min(bd_max(before[d], x[d] - half_width), x[d] + half_width);
    }
    /* coupled laws: the force returns radially to the disk of radius r */
    if (t->has_coupled) {
        const bd_vec T0 = at->kt[0] * (x[0] - before[0]);
        const bd_vec T1 = at->kt[1] * (x[1] - before[1]);
        const bd_vec size = bd_root(T0 * T0 + T1 * T1);
        const bd_mask slips = bd_above(size, r);
        const bd_vec share = bd_select(slips, r / bd_select(slips, size, one), one);
        for (size_t d = 0; d < 2; ++d) {
            const bd_mask radial = bd_above(at->coupled, zero) & bd_above(at->kt[d], zero);
            next[d] = bd_select(radial, x[d] - share * (x[d] - before[d]), next[d]);
        }
    }
    for (size_t d = 0; d < 2; ++d) {
        next[d] = bd_select(bd_above(at->fixed_slider[d], zero), before[d], next[d]);
        bd_store(next_w + d * t->stride, next[d]);
        F[d] = at->kt[d] * (x[d] - next[d]);
        if (t->has_cubic) F[d] = F[d] + at->cubic[d] * x[d] * x[d] * x[d];
    }
    F[2] = normal;
}

/* Motion (3) of a point of a sector as input of its user law. */
BD_INLINE void user_law_motion(const bd_time *t, size_t p, const double *x, double *now) {
    const double *at = t->parameters + p;
    for (size_t d = 0; d < 3; ++d) now[d] = x[d];
    now[2] += bd_static_closing(at[BD_TIME_KN * t->stride], at[BD_TIME_N0 * t->stride]);
}

/* Forces of the points with user laws, point by point. */
BD_NOT_INLINE void user_law_forces(bd_time *t, const double *x, double *F) {
    const size_t s = t->stride, n = (size_t)t->n_point, m = (size_t)t->n_memory;
    for (size_t p = 0; p < n; ++p) {
        if (!t->point_law[p].function) continue;
        for (size_t k = 0; k < (size_t)t->n_sector; ++k) {
            const double *at = x + k * t->rows + p;
            const double motion[3] = {at[0], at[s], at[2 * s]};
            double now[3], force[3];
            user_law_motion(t, p, motion, now);
            bd_point_law_step(t->point_law + p, now, t->law_memory[0] + (k * n + p) * m,
                              t->law_memory[1] + (k * n + p) * m, force, NULL);
            for (size_t d = 0; d < 3; ++d) F[k * t->rows + d * s + p] = force[d];
        }
    }
}

/* Forces F (n_sector, rows) of all contacts at the motion x; moves the sliders. */
static void all_contact_forces(bd_time *t, const double *x, double *F) {
    const size_t s = t->stride;
    for (size_t p = 0; p < (size_t)t->n_point; p += BD_WIDTH) {
        const points at = load_parameters(t, p);
        for (size_t k = 0; k < (size_t)t->n_sector; ++k) {
            bd_vec now[3], force[3];
            for (size_t d = 0; d < 3; ++d) now[d] = bd_load(x + k * t->rows + d * s + p);
            contact_forces(t, &at, now, t->slider + 2 * s * k + p, t->next_slider + 2 * s * k + p,
                           force);
            for (size_t d = 0; d < 3; ++d) bd_store(F + k * t->rows + d * s + p, force[d]);
        }
    }
    if (t->n_user_law) user_law_forces(t, x, F);
}

/* ---- derivative of the forces ---- */

enum { SLIDES_IN_PLANE = 18 };

/* State of each point: 1 closed, plus 2 or 4 (6 or 12) for slip in the positive or negative
 * direction. Larger values mark a continuously changing derivative. */
BD_INLINE bd_vec contact_state_of(const bd_time *t, const points *at, const bd_vec *x,
                                  const double *w) {
    const bd_vec zero = bd_all(0.0);
    const bd_vec normal = at->n0 + at->kn * x[2];
    const bd_vec r = at->limit + at->mu * bd_max(normal, at->least_n);
    const bd_mask closed = bd_above(normal, at->least_n);
    const bd_mask coupled = bd_above(at->coupled, zero);
    bd_vec state = bd_select(closed, bd_all(1.0), zero), T[2];
    for (size_t d = 0; d < 2; ++d) {
        const bd_vec before = bd_load(w + d * t->stride), half_width = r * at->inverse_kt[d];
        const bd_mask free = closed & ~bd_above(at->fixed_slider[d], zero) & ~coupled;
        const bd_vec plus = bd_all(d ? 6.0 : 2.0), minus = bd_all(d ? 12.0 : 4.0);
        state += bd_select(free & bd_above(x[d] - half_width, before), plus, zero);
        state += bd_select(free & bd_above(before, x[d] + half_width), minus, zero);
        T[d] = at->kt[d] * (x[d] - before);
    }
    const bd_mask slides = closed & coupled & bd_above(T[0] * T[0] + T[1] * T[1], r * r);
    const bd_mask cubic = bd_differ(at->cubic[0], zero) | bd_differ(at->cubic[1], zero);
    const bd_mask changes = slides | cubic | bd_above(at->user_law, zero);
    return state + bd_select(changes, bd_all(SLIDES_IN_PLANE), zero);
}

/* Derivative D (3, 3) of the forces of a point with a user law; overwrites its
 * memory after the step. */
static void user_law_tangent(bd_time *t, size_t k, size_t p, const double *x, double *D) {
    const size_t at = (k * (size_t)t->n_point + p) * (size_t)t->n_memory;
    bd_point_law_derivatives derivatives =
        bd_point_law_derivatives_in(t->derivatives, t->point_law[p].n_state);
    double now[3], force[3];
    user_law_motion(t, p, x, now);
    bd_point_law_step(t->point_law + p, now, t->law_memory[0] + at, t->law_memory[1] + at, force,
                      &derivatives);
    bd_point_law_tangent(t->point_law + p, &derivatives, D);
}

/* Derivative D (3, 3) of the forces of point p in sector k at the motion x with the slider w before
 * the step. */
static void contact_tangent(bd_time *t, size_t k, size_t p, const double *x, const double *w,
                            double *D) {
    if (t->n_user_law && t->point_law[p].function) {
        user_law_tangent(t, k, p, x, D);
        return;
    }
    const size_t s = t->stride;
    const double *c = t->parameters + p, *kt = c + BD_TIME_KT * s;
    const double mu = c[BD_TIME_MU * s], least_n = c[BD_TIME_LEAST_N * s];
    const double normal = c[BD_TIME_N0 * s] + c[BD_TIME_KN * s] * x[2];
    const int is_closed = normal > least_n;
    const double kn = is_closed ? c[BD_TIME_KN * s] : 0.0;
    const double along = mu * kn; /* change of the friction limit with v */
    const double r = c[BD_TIME_LIMIT * s] + mu * (is_closed ? normal : least_n);
    const double T[2] = {kt[0] * (x[0] - w[0]), kt[s] * (x[1] - w[1])};
    const double size = sqrt(T[0] * T[0] + T[1] * T[1]);
    const int is_coupled = c[BD_TIME_COUPLED * s] > 0.0;
    memset(D, 0, 9 * sizeof *D);
    D[8] = kn;
    for (size_t d = 0; d < 2; ++d) {
        const double half_width = r * c[(BD_TIME_INVERSE_KT + d) * s], k_d = kt[d * s];
        const int is_fixed = c[(BD_TIME_FIXED_SLIDER + d) * s] > 0.0;
        const int is_within = w[d] >= x[d] - half_width && w[d] <= x[d] + half_width;
        D[4 * d] = 3.0 * c[(BD_TIME_CUBIC + d) * s] * x[d] * x[d];
        if (is_fixed) {
            D[4 * d] += k_d;
            continue;
        }
        if (!(r > 0.0)) continue; /* open: the slider follows the motion */
        if (is_coupled && size > r) {
            /* slip in the plane: the force r T/size */
            for (size_t e = 0; e < 2; ++e)
                D[3 * d + e] -= r / (size * size * size) * T[d] * T[e] * kt[e * s];
            D[4 * d] += r / size * k_d;
            D[3 * d + 2] += along * T[d] / size;
        } else if (is_coupled || is_within) {
            D[4 * d] += k_d; /* stick */
        } else if (k_d > 0.0) {
            D[3 * d + 2] += w[d] < x[d] ? along : -along; /* slip along one direction */
        }
    }
}

#endif
