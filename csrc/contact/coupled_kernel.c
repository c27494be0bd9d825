/* One period of in-plane coupled friction at BD_LANES contact points; compiled once for each
 * instruction set.
 *
 * In newtons, p is the displacement, s the slider and R the limit of the friction force T = p - s.
 * Between samples, p and the load are linear in time. This motion is solved exactly including the
 * events inside a step, so the evaluation is of second order:
 *
 *     stick    T moves along the chord dp; it leaves the disk at the root of
 *              |T + tau dp|^2 = (R + tau dR)^2.
 *     slip     With D = |dp|, a = dp/D, the angle theta between e and a obeys
 *              d theta/d tau = -(D/R) sin theta, so tan(theta/2) shrinks by q = exp(-D L),
 *              L = int d tau/R. With c = a.e, X = 1 + c, Y = 1 - c, den = X + q^2 Y, this is
 *              a tractrix:
 *                  e_1 = alpha a + beta (e - c a),  alpha = (X - q^2 Y)/den,  beta = 2 q/den.
 *     closing  R grows from zero: stick if |dp| <= dR over the remainder of the step, else slip
 *              along a.
 *     opening  s = p.
 *
 * At the onset of slip a perturbation of T is projected on the edge of the disk, so the instant of
 * the onset has no derivative to first order. A step gives ds_1 = A ds_0 + B0 dp_0 + B1 dp_1 + C0
 * dg_0 + C1 dg_1.
 *
 * L = (2/S) atanh(z)/z with S = R_0 + R_1, z = (R_1 - R_0)/S; a power of two first brings the ratio
 * of the two limits near one. */
#include "util/kernels.h"
#include "util/vector_types.h"

enum { N_VEC = BD_LANES / BD_WIDTH };
#define EDGE 1e-12 /* relative distance at which T counts as on the edge of the disk */
#define LN2 0.69314718055994530942

/* Convert small integers to doubles and back, by the bits of a number near 2^52 + 2^51. */
BD_INLINE bd_vec to_double(bd_mask i) {
    return bd_of_bits(i + bd_all_int(0x4338000000000000)) - bd_all(6755399441055744.0);
}
BD_INLINE bd_mask to_int(bd_vec x) {
    return bd_bits(x + bd_all(6755399441055744.0)) - bd_all_int(0x4338000000000000);
}
BD_INLINE bd_vec power_of_two(bd_mask i) { return bd_of_bits((i + bd_all_int(1023)) << 52); }

/* 1 - exp(-x) for x >= 0 with full relative accuracy, from x = k ln 2 - y:
 *
 *     1 - exp(-x) = (1 - 2^-k) - 2^-k (exp(y) - 1). */
BD_INLINE bd_vec one_minus_exp(bd_vec x) {
    x = bd_min(x, bd_all(700.0)); /* beyond, the power of two would underflow */

    /* ln 2 in two parts, of which the first one has trailing zeros: its product with k is exact */
    const bd_mask k = to_int(x * bd_all(1.0 / LN2));
    const bd_vec by_first_part = x - to_double(k) * bd_all(6.93147180369123816490e-01);
    const bd_vec remainder = by_first_part - to_double(k) * bd_all(1.90821492927058770002e-10);
    const bd_vec y = bd_all(0.0) - remainder;

    /* exp(y) - 1 = y + y^2 sum, with the sum of y^(n - 2)/n! up to n = 14 */
    bd_vec sum = bd_all(1.0 / 14.0);
    for (int n = 13; n >= 2; --n) sum = (bd_all(1.0) + y * sum) * bd_all(1.0 / n);
    const bd_vec exp_minus_one = y + y * y * sum;
    const bd_vec power = power_of_two(bd_all_int(0) - k); /* 2^-k */
    return (bd_all(1.0) - power) - power * exp_minus_one;
}

typedef struct {
    bd_vec L, L0, L1; /* int d tau/R and its derivatives with respect to R at both ends */
} inverse_limit;

/* Integral L = int d tau/R of a friction limit R that changes linearly from R0 to R1, tau from 0 to
 * 1, and its derivatives L0 and L1 with respect to R0 and R1. Let S = R0 + near and z = (near -
 * R0)/S, where near = R1/2^n lies within a factor of sqrt(2) from R0. There the series of atanh
 * converges to double precision, and for n = 0 nothing is divided by the difference of the limits,
 * which may vanish. In ln(R1/R0), the power of two counts n ln 2:
 *
 *     n = 0    L = 2 A/S,   A = atanh(z)/z,
 *     other    L = ln(R1/R0)/(R1 - R0),   ln(R1/R0) = n ln 2 + 2 z A. */
BD_INLINE inverse_limit mean_inverse(bd_vec R0, bd_vec R1, const int tangent) {
    const bd_vec one = bd_all(1.0), two = bd_all(2.0), zero = bd_all(0.0);

    /* the power of two nearest to the ratio of the limits */
    const bd_vec ratio = bd_min(bd_max(R1 / R0, bd_all(1e-290)), bd_all(1e290));
    const bd_mask exponent = bd_bits(ratio * bd_all(1.4142135623730951)) >> 52;
    const bd_mask n = (exponent & bd_all_int(0x7ff)) - bd_all_int(1023);
    const bd_vec near = R1 * power_of_two(bd_all_int(0) - n);
    const bd_vec S = R0 + near;
    const bd_vec z = (near - R0) / S;

    /* A = sum z^(2k)/(2k + 1) */
    const bd_vec z2 = z * z;
    bd_vec A = bd_all(1.0 / 25.0);
    for (int k = 11; k >= 0; --k) A = bd_all(1.0 / (2 * k + 1)) + z2 * A;
    const bd_mask same = bd_equal_int(n, bd_all_int(0));
    const bd_vec dR = bd_select(same, one, R1 - R0);
    const bd_vec by_logarithm = (to_double(n) * bd_all(LN2) + two * z * A) / dR;
    inverse_limit o = {.L = bd_select(same, two * A / S, by_logarithm), .L0 = zero, .L1 = zero};
    if (!tangent) return o;

    /* B = A'(z)/z = sum 2k z^(2k - 2)/(2k + 1). For n = 0, dS = dR_0 + dR_1 and S^2 dz =
     * 2 (R_0 dR_1 - R_1 dR_0); for other n, L is a quotient */
    bd_vec B = bd_all(24.0 / 25.0);
    for (int k = 11; k >= 1; --k) B = bd_all(2.0 * k / (2 * k + 1)) + z2 * B;
    const bd_vec slope = bd_all(4.0) * z * B / (S * S * S);
    o.L1 = bd_select(same, R0 * slope - o.L / S, (one / R1 - o.L) / dR);
    o.L0 = bd_select(same, zero - R1 * slope - o.L / S, (o.L - one / R0) / dR);
    return o;
}

/* Slider after a step, its motion, and its derivatives: ds_1 = A ds_0 + B0 dp_0 + B1 dp_1 + C0 dg_0
 * + C1 dg_1. */
typedef struct {
    bd_vec s[2], ds[2], A[2][2], B0[2][2], B1[2][2], C0[2], C1[2];
} step;

/* Motion and load of a step, both linear in time. */
typedef struct {
    bd_vec p0[2], p1[2], dp[2];    /* displacement at both ends, and its change */
    bd_vec g0, g1, R0, R1, dR, mu; /* load at both ends, friction limit and its change */
} motion;

/* Quantities of slip along the part D of the chord dp that do not depend on the slider if D is the
 * whole chord. */
typedef struct {
    bd_vec length, a[2], p; /* |D|, D/|D|, 1 - q */
    inverse_limit inverse;
} chord;

/* Slip along a chord D (2) of the motion while the friction limit changes from R_e to R1: its
 * length |D|, direction a = D/|D|, L = int d tau/R and 1 - q = 1 - exp(-|D| L). */
BD_INLINE chord make_chord(const bd_vec *D, bd_vec R_e, bd_vec R1, const int tangent) {
    chord w;
    w.length = bd_max(bd_root(D[0] * D[0] + D[1] * D[1]), bd_all(1e-300));
    for (int i = 0; i < 2; ++i) w.a[i] = D[i] / w.length;
    w.inverse = mean_inverse(R_e, R1, tangent);
    w.p = one_minus_exp(w.length * w.inverse.L);
    return w;
}

/* Slip over the remainder 1 - tau of the step, from the force direction e on the edge R_e:
 *
 *     s_1 = p_1 - R_1 e_1,   e_1 = alpha a + beta side,   side = e - c a.
 *
 * e_1 depends on e, on the chord D = |D| a and, by q = exp(-|D| L), on both limits. Its derivatives
 * with respect to c = a.e and to q are
 *
 *     d alpha/dc = beta^2,                     d beta/dc = -2 q (1 - q^2)/den^2,
 *     d alpha/dq = -4 q X Y/den^2,             d beta/dq = 2 alpha/den. */
BD_INLINE void slip_step(step *o, const motion *m, const chord *w, const bd_vec *e, bd_vec tau,
                         bd_vec R_e, const int tangent) {
    const bd_vec one = bd_all(1.0), two = bd_all(2.0), zero = bd_all(0.0);
    const bd_vec *dp = m->dp, *p1 = m->p1, R1 = m->R1, mu = m->mu;
    const bd_vec remainder = one - tau;
    const bd_vec D[2] = {remainder * dp[0], remainder * dp[1]};
    const bd_vec length = w->length, *a = w->a;
    const bd_vec p = w->p, q = one - p;
    const inverse_limit inv = w->inverse;

    /* e_1 = alpha a + beta (e - c a) */
    const bd_vec c = bd_min(bd_max(a[0] * e[0] + a[1] * e[1], bd_all(-1.0 + 1e-14)), one);
    const bd_vec X = one + c, Y = one - c, q2 = q * q;
    const bd_vec inverse = one / (X + q2 * Y);
    const bd_vec alpha = (X - q2 * Y) * inverse;
    const bd_vec beta = two * q * inverse;
    bd_vec side[2], e1[2];
    for (int i = 0; i < 2; ++i) {
        side[i] = e[i] - c * a[i];
        e1[i] = alpha * a[i] + beta * side[i];
    }

    /* motion of the slider, without the difference of e_1 and e that nearly cancels: e_1 - e with
     * the common factor p = 1 - q */
    for (int i = 0; i < 2; ++i) {
        const bd_vec de =
            p * inverse * (X * Y * (one + q) * a[i] + (Y * (one + q) - two) * side[i]);
        o->ds[i] = D[i] - R1 * de - (R1 - R_e) * e[i];
        o->s[i] = p1[i] - R1 * e1[i];
    }

    /* V_c = de_1/dc and M_e = de_1/de */
    const bd_vec alpha_c = beta * beta;
    const bd_vec beta_c = zero - two * q * (one - q2) * inverse * inverse;
    bd_vec V_c[2], M_e[2][2];
    for (int i = 0; i < 2; ++i) {
        V_c[i] = a[i] * (alpha_c - beta) + side[i] * beta_c;
        for (int j = 0; j < 2; ++j) M_e[i][j] = V_c[i] * a[j] + (i == j ? beta : zero);
    }
    /* A = R1 M_e (I - e e^T)/R_e: a change of the slider changes e only across e */
    const bd_vec scale = R1 / R_e;
    for (int i = 0; i < 2; ++i) {
        const bd_vec along = M_e[i][0] * e[0] + M_e[i][1] * e[1];
        for (int j = 0; j < 2; ++j) o->A[i][j] = scale * (M_e[i][j] - along * e[j]);
    }
    if (!tangent) return;

    /* V_q = de_1/dq, m_e and m_1 = de_1/dR_e and de_1/dR_1 by q, M_D = R_1 de_1/dD */
    const bd_vec alpha_q = zero - bd_all(4.0) * q * X * Y * inverse * inverse;
    const bd_vec beta_q = two * alpha * inverse;
    for (int i = 0; i < 2; ++i) {
        const bd_vec V_q = a[i] * alpha_q + side[i] * beta_q;
        const bd_vec m_e = zero - q * length * inv.L0 * V_q;
        const bd_vec m_1 = zero - q * length * inv.L1 * V_q;
        for (int j = 0; j < 2; ++j) {
            const bd_vec same = i == j ? one : zero;
            const bd_vec across = same - a[i] * a[j];
            const bd_vec M_D = R1 * ((alpha - beta * c) * across / length +
                                     V_c[i] * side[j] / length - q * inv.L * V_q * a[j]);
            /* the slip starts at remainder p_0 + tau p_1, and D = remainder (p_1 - p_0) */
            o->B0[i][j] = remainder * (M_D - o->A[i][j]);
            o->B1[i][j] = same - tau * o->A[i][j] - remainder * M_D;
        }
        /* R_e = remainder R_0 + tau R_1, and R_1 also scales e_1 */
        o->C0[i] = zero - R1 * mu * m_e * remainder;
        o->C1[i] = zero - R1 * mu * (m_e * tau + m_1) - mu * e1[i];
    }
}

/* Copy the entries of x in the mask to `to`. */
BD_INLINE void choose(bd_vec *to, bd_mask mask, bd_vec x) { *to = bd_select(mask, x, *to); }

/* Place of a quantity (BD_CHORD_...) of the chord that ends at `at`, sample times BD_LANES plus
 * lane. */
BD_INLINE double *chord_part(const bd_coupled_lanes *l, int at, int quantity) {
    return l->chord + quantity * l->n_time * BD_LANES + at;
}

/* Store the quantities of the chord that ends at `at`; some are needed with a tangent only. */
BD_INLINE void save_chord(bd_coupled_lanes *l, int at, const chord *w, const int tangent) {
    bd_store(chord_part(l, at, BD_CHORD_A1), w->a[0]);
    bd_store(chord_part(l, at, BD_CHORD_A2), w->a[1]);
    bd_store(chord_part(l, at, BD_CHORD_P), w->p);
    if (!tangent) return;
    bd_store(chord_part(l, at, BD_CHORD_LENGTH), w->length);
    bd_store(chord_part(l, at, BD_CHORD_L), w->inverse.L);
    bd_store(chord_part(l, at, BD_CHORD_L0), w->inverse.L0);
    bd_store(chord_part(l, at, BD_CHORD_L1), w->inverse.L1);
}

/* Quantities of the chord that ends at `at`, as stored by save_chord. */
BD_INLINE chord load_chord(const bd_coupled_lanes *l, int at, const int tangent) {
    chord w = {.a = {bd_load(chord_part(l, at, BD_CHORD_A1)),
                     bd_load(chord_part(l, at, BD_CHORD_A2))},
               .p = bd_load(chord_part(l, at, BD_CHORD_P))};
    if (!tangent) return w;
    w.length = bd_load(chord_part(l, at, BD_CHORD_LENGTH));
    w.inverse.L = bd_load(chord_part(l, at, BD_CHORD_L));
    w.inverse.L0 = bd_load(chord_part(l, at, BD_CHORD_L0));
    w.inverse.L1 = bd_load(chord_part(l, at, BD_CHORD_L1));
    return w;
}

/* Closing: the load and the limit are zero until the part t of the step. Up to there the slider
 * moves with the surface, then it sticks or slips along the chord:
 *
 *     stick    s_1 = p_0 + t dp,    t = -g_0/dg,   dt = (g_0 dg_1 - g_1 dg_0)/dg^2,
 *     slip     s_1 = p_1 - R_1 a,   a = dp/|dp|,   da = (I - a a^T) (dp_1 - dp_0)/|dp|.
 *
 * A load that is not interpolated acts from the start of the step, t = 0. Return the lanes that
 * slip. */
BD_INLINE bd_mask close_step(step *o, const motion *m, bd_mask closing, const bd_vec *s,
                             int interpolate, const int tangent) {
    const bd_vec one = bd_all(1.0), zero = bd_all(0.0);
    const bd_vec *dp = m->dp, R1 = m->R1;
    const bd_vec dg = m->g1 - m->g0;
    const bd_vec t = bd_all(interpolate ? -1.0 : 0.0) * m->g0 / dg;
    const bd_vec remainder = one - t;
    const bd_vec length = bd_root(dp[0] * dp[0] + dp[1] * dp[1]);
    const bd_mask slips = closing & ~bd_at_least(R1, remainder * length);

    const bd_vec inverse = one / bd_max(length, bd_all(1e-300));
    const bd_vec factor = bd_all(interpolate ? 1.0 : 0.0) / (dg * dg);
    for (int i = 0; i < 2; ++i) {
        const bd_vec a = dp[i] * inverse;
        const bd_vec slipped = m->p1[i] - R1 * a, stuck = m->p0[i] + t * dp[i];
        const bd_vec s1 = bd_select(slips, slipped, stuck);
        choose(&o->s[i], closing, s1);
        choose(&o->ds[i], closing, s1 - s[i]);
        for (int j = 0; j < 2; ++j) {
            choose(&o->A[i][j], closing, zero); /* the former slider has no effect */
            if (!tangent) continue;
            const bd_vec same = i == j ? one : zero;
            const bd_vec turn = (same - a * dp[j] * inverse) * R1 * inverse; /* R_1 da_i/dp_1j */
            choose(&o->B0[i][j], closing, bd_select(slips, turn, remainder * same));
            choose(&o->B1[i][j], closing, bd_select(slips, same - turn, t * same));
        }
        if (!tangent) continue;
        choose(&o->C0[i], closing, bd_select(slips, zero, zero - dp[i] * m->g1 * factor));
        choose(&o->C1[i], closing, bd_select(slips, zero - m->mu * a, dp[i] * m->g0 * factor));
    }
    return slips;
}

/* Opening: the slider moves with the surface. */
BD_INLINE void open_step(step *o, bd_mask open, const bd_vec *s, const bd_vec *p1,
                         const int tangent) {
    const bd_vec one = bd_all(1.0), zero = bd_all(0.0);
    for (int i = 0; i < 2; ++i) {
        choose(&o->s[i], open, p1[i]);
        choose(&o->ds[i], open, p1[i] - s[i]);
        for (int j = 0; j < 2; ++j) {
            choose(&o->A[i][j], open, zero);
            if (!tangent) continue;
            choose(&o->B0[i][j], open, zero);
            choose(&o->B1[i][j], open, i == j ? one : zero);
        }
        if (!tangent) continue;
        choose(&o->C0[i], open, zero);
        choose(&o->C1[i], open, zero);
    }
}

/* Friction force T at the start of a step. */
typedef struct {
    bd_vec T[2], size, along; /* T, |T|, T . dp */
    bd_mask edge;             /* whether T lies on the edge of the disk */
} friction;

BD_INLINE friction friction_at_start(const motion *m, const bd_vec *s) {
    friction f;
    for (int i = 0; i < 2; ++i) f.T[i] = m->p0[i] - s[i];
    f.size = bd_root(f.T[0] * f.T[0] + f.T[1] * f.T[1]);
    f.along = f.T[0] * m->dp[0] + f.T[1] * m->dp[1];
    f.edge = bd_at_least(f.size, m->R0 * bd_all(1.0 - EDGE));
    return f;
}

/* Whether T lies in the disk at the end of the step if the slider stays in place. */
BD_INLINE bd_mask ends_inside(const motion *m, const bd_vec *s) {
    const bd_vec T[2] = {m->p1[0] - s[0], m->p1[1] - s[1]};
    return bd_at_least(m->R1, bd_root(T[0] * T[0] + T[1] * T[1]));
}

/* Part of the step after which T leaves the disk: the root of |T + tau dp|^2 = (R0 + tau dR)^2,
 * that is a tau^2 + 2 b tau + c = 0, without cancellation. */
BD_INLINE bd_vec onset_of_slip(const motion *m, const friction *f) {
    const bd_vec zero = bd_all(0.0);
    const bd_vec *dp = m->dp, R0 = m->R0, dR = m->dR;
    const bd_vec a = dp[0] * dp[0] + dp[1] * dp[1] - dR * dR;
    const bd_vec b = f->along - R0 * dR;
    const bd_vec c = bd_select(f->edge, zero, (f->size - R0) * (f->size + R0));
    const bd_vec h = bd_root(bd_max(b * b - a * c, zero));
    const bd_vec outward = bd_select(bd_above(b + h, zero), (zero - c) / (b + h), zero);
    return bd_select(bd_at_least(b, zero), outward, (h - b) / a);
}

/* Slip over the whole step from the force direction e = T/|T|, along the chord that all_chords has
 * stored for the end of the step, at1 = k1 BD_LANES + lane. */
BD_INLINE void slip_from_start(step *o, const motion *m, const friction *f,
                               const bd_coupled_lanes *l, int at1, const int tangent) {
    const bd_vec e[2] = {f->T[0] / f->size, f->T[1] / f->size};
    const chord w = load_chord(l, at1, tangent);
    slip_step(o, m, &w, e, bd_all(0.0), m->R0, tangent);
}

/* Slip after the part tau of the step at which T reaches the edge of the disk; for lanes in
 * `direct`, tau = 0. Slip begins with T_e = T + tau dp and R_e = R0 + tau dR. It follows the
 * remainder (1 - tau) dp of the chord. */
BD_INLINE void slip_after_stick(step *o, const motion *m, const friction *f, bd_mask direct,
                                const int tangent) {
    const bd_vec zero = bd_all(0.0), one = bd_all(1.0);
    const bd_vec root = onset_of_slip(m, f);
    const bd_vec tau = bd_select(direct, zero, bd_min(one, bd_max(zero, root)));
    const bd_vec remainder = one - tau;
    const bd_vec T_e[2] = {f->T[0] + tau * m->dp[0], f->T[1] + tau * m->dp[1]};
    const bd_vec size = bd_root(T_e[0] * T_e[0] + T_e[1] * T_e[1]);
    const bd_vec e[2] = {T_e[0] / size, T_e[1] / size};
    const bd_vec R_e = m->R0 + tau * m->dR;
    const bd_vec D[2] = {remainder * m->dp[0], remainder * m->dp[1]};
    const chord w = make_chord(D, R_e, m->R1, tangent);
    slip_step(o, m, &w, e, tau, R_e, tangent);
}

/* Motion and load of the lanes of a vector, from the samples at0 and at1 = sample BD_LANES +
 * lane. */
BD_INLINE motion load_motion(const bd_coupled_lanes *l, int at0, int at1, int lane) {
    motion m;
    m.p0[0] = bd_load(l->x + at0);
    m.p0[1] = bd_load(l->y + at0);
    m.p1[0] = bd_load(l->x + at1);
    m.p1[1] = bd_load(l->y + at1);
    for (int i = 0; i < 2; ++i) m.dp[i] = m.p1[i] - m.p0[i];
    m.g0 = bd_load(l->g + at0);
    m.g1 = bd_load(l->g + at1);
    m.R0 = bd_load(l->R + at0);
    m.R1 = bd_load(l->R + at1);
    m.dR = m.R1 - m.R0;
    m.mu = bd_load(l->mu + lane);
    return m;
}

/* Step of the slider s from sample k0 to the next sample k1, for the lanes of vector v. In contact,
 * the slider
 *
 *     slips at once   if T lies on the edge of the disk and moves outward, T . dp > |T| dR,
 *     slips later     if T would leave the disk during the step,
 *     sticks          otherwise.
 *
 * A contact that opens or closes has steps without memory of s. Write the slider after the step and
 * its derivatives to o for lanes that move; those in `sticks` keep their slider. Return the lanes
 * that slip. */
BD_INLINE bd_mask take_step(const bd_coupled_lanes *l, int k0, int k1, int v, const bd_vec *s,
                            step *o, bd_mask *sticks, const int tangent) {
    const bd_vec zero = bd_all(0.0);
    const int lane = v * BD_WIDTH;
    const int at0 = k0 * BD_LANES + lane, at1 = k1 * BD_LANES + lane;
    const motion m = load_motion(l, at0, at1, lane);

    const bd_mask open = ~bd_above(m.g1, zero);
    const bd_mask closing = ~open & ~bd_above(m.g0, zero);
    const bd_mask contact = ~open & ~closing;

    /* slip begins at once if T moves outward from the edge, or later if T would end outside */
    const friction start = friction_at_start(&m, s);
    const bd_mask direct = contact & start.edge & bd_above(start.along, start.size * m.dR);
    const bd_mask slips = direct | (contact & ~ends_inside(&m, s));
    const bd_mask later = slips & ~direct;
    *sticks = contact & ~slips;
    bd_mask slipping = slips;

    if (bd_any(later))
        slip_after_stick(o, &m, &start, direct, tangent);
    else if (bd_any(slips))
        slip_from_start(o, &m, &start, l, at1, tangent);
    if (bd_any(closing)) slipping |= close_step(o, &m, closing, s, l->interpolate, tangent);
    if (bd_any(open)) open_step(o, open, s, m.p1, tangent);
    return slipping;
}

/* Kind of the step of one lane, from masks; neither open, stick nor slip: closing that sticks. */
BD_INLINE unsigned char step_kind(bd_mask open, bd_mask sticks, bd_mask slips, size_t lane) {
    if (bd_entry_int(open, lane)) return BD_STEP_OPEN;
    if (bd_entry_int(sticks, lane)) return BD_STEP_STICK;
    if (bd_entry_int(slips, lane)) return BD_STEP_SLIP;
    return BD_STEP_CLOSE;
}

/* Store the kind of the step to sample k, the slider s after it and, with a tangent, its
 * derivatives A, B0, B1, C0 and C1, for the lanes of vector v. */
BD_INLINE void store_step(bd_coupled_lanes *l, int k, int v, const step *o, const bd_vec *s,
                          bd_mask sticks, bd_mask slips, const int tangent) {
    const int at = k * BD_LANES + v * BD_WIDTH;
    const bd_mask open = ~bd_above(bd_load(l->g + at), bd_all(0.0));
    for (int i = 0; i < BD_WIDTH; ++i)
        l->step_kind[at + i] = step_kind(open, sticks, slips, (size_t)i);

    const int n = l->n_time * BD_LANES;
    double *to = l->step + at;
    for (int i = 0; i < 2; ++i) bd_store(to + (BD_STEP_S + i) * n, s[i]);
    if (!tangent) return;
    for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 2; ++j) {
            const int entry = 2 * i + j;
            bd_store(to + (BD_STEP_A + entry) * n, o->A[i][j]);
            bd_store(to + (BD_STEP_B0 + entry) * n, o->B0[i][j]);
            bd_store(to + (BD_STEP_B1 + entry) * n, o->B1[i][j]);
        }
        bd_store(to + (BD_STEP_C0 + i) * n, o->C0[i]);
        bd_store(to + (BD_STEP_C1 + i) * n, o->C1[i]);
    }
}

/* Constant arguments: the compiler makes one variant of a loop for each of their values. */
enum { DISCARD = 0, STORE = 1, WITHOUT_TANGENT = 0, WITH_TANGENT = 1 };

/* One period of steps from the slider l->s, one vector of lanes after the other. Write the slider
 * at the end, the sum `net` of its movements, and the derivative P (2, 2) of the end with respect
 * to the start: P <- A P in each step that moves the slider. */
BD_INLINE void period(bd_coupled_lanes *l, const int store, const int tangent) {
    const bd_vec zero = bd_all(0.0), one = bd_all(1.0);
    for (int v = 0; v < N_VEC; ++v) {
        const int lane = v * BD_WIDTH;
        bd_vec s[2] = {bd_load(l->s + lane), bd_load(l->s + BD_LANES + lane)};
        bd_vec net[2] = {zero, zero};
        bd_vec P[2][2] = {{one, zero}, {zero, one}};
        for (int k = 0; k < l->n_time; ++k) {
            const int before = k > 0 ? k - 1 : l->n_time - 1;
            step o = {0};
            bd_mask sticks;
            const bd_mask slips = take_step(l, before, k, v, s, &o, &sticks, tangent);
            const bd_mask moves = ~sticks;
            if (bd_any(moves)) {
                for (int i = 0; i < 2; ++i) {
                    choose(&s[i], moves, o.s[i]);
                    net[i] += bd_select(moves, o.ds[i], zero);
                }
                for (int j = 0; j < 2; ++j) {
                    const bd_vec P0 = P[0][j], P1 = P[1][j];
                    choose(&P[0][j], moves, o.A[0][0] * P0 + o.A[0][1] * P1);
                    choose(&P[1][j], moves, o.A[1][0] * P0 + o.A[1][1] * P1);
                }
            }
            if (store) store_step(l, k, v, &o, s, sticks, slips, tangent);
        }

        for (int i = 0; i < 2; ++i) {
            bd_store(l->end + i * BD_LANES + lane, s[i]);
            bd_store(l->net_motion + i * BD_LANES + lane, net[i]);
            for (int j = 0; j < 2; ++j)
                bd_store(l->period_derivative + (2 * i + j) * BD_LANES + lane, P[i][j]);
        }
    }
}

/* Store the quantities of whole slip steps, along the chord from each sample to the next. They do
 * not depend on the slider, so all periods of a search use them. */
BD_INLINE void all_chords(bd_coupled_lanes *l, const int tangent) {
    for (int k = 0; k < l->n_time; ++k)
        for (int v = 0; v < N_VEC; ++v) {
            const int before = k > 0 ? k - 1 : l->n_time - 1;
            const int at0 = before * BD_LANES + v * BD_WIDTH;
            const int at1 = k * BD_LANES + v * BD_WIDTH;
            const bd_vec D[2] = {bd_load(l->x + at1) - bd_load(l->x + at0),
                                 bd_load(l->y + at1) - bd_load(l->y + at0)};
            const bd_vec R0 = bd_load(l->R + at0), R1 = bd_load(l->R + at1);
            const chord w = make_chord(D, R0, R1, tangent);
            save_chord(l, at1, &w, tangent);
        }
}

void BD_JOIN(bd_coupled_chords_, BD_VARIANT)(bd_coupled_lanes *l, int tangent);
void BD_JOIN(bd_coupled_chords_, BD_VARIANT)(bd_coupled_lanes *l, int tangent) {
    if (tangent)
        all_chords(l, WITH_TANGENT);
    else
        all_chords(l, WITHOUT_TANGENT);
}

void BD_JOIN(bd_coupled_period_, BD_VARIANT)(bd_coupled_lanes *l, int store, int tangent);
void BD_JOIN(bd_coupled_period_, BD_VARIANT)(bd_coupled_lanes *l, int store, int tangent) {
    if (!store)
        period(l, DISCARD, WITHOUT_TANGENT);
    else if (!tangent)
        period(l, STORE, WITHOUT_TANGENT);
    else
        period(l, STORE, WITH_TANGENT);
}

/* Return the largest violation |c_k - s| - R_k of n disks by a point s, and the index of this disk.
 * Centres are c_k = (x_k, y_k), and n is a multiple of 8. Each vector entry keeps the largest value
 * of every BD_WIDTH-th disk, and the index of the first disk in that vector. */
double BD_JOIN(bd_disk_violation_, BD_VARIANT)(int n, const double *x, const double *y,
                                               const double *R, const double *s, int *which);
double BD_JOIN(bd_disk_violation_, BD_VARIANT)(int n, const double *x, const double *y,
                                               const double *R, const double *s, int *which) {
    bd_vec most = bd_all(-INFINITY), index = bd_all(0.0);
    for (int k = 0; k < n; k += BD_WIDTH) {
        const bd_vec dx = bd_load(x + k) - bd_all(s[0]);
        const bd_vec dy = bd_load(y + k) - bd_all(s[1]);
        const bd_vec violation = bd_root(dx * dx + dy * dy) - bd_load(R + k);
        const bd_mask more = bd_above(violation, most);
        choose(&most, more, violation);
        choose(&index, more, bd_all((double)k));
    }
    /* largest entry of the vector */
    size_t best = 0;
    for (size_t i = 1; i < BD_WIDTH; ++i)
        if (bd_entry(most, i) > bd_entry(most, best)) best = i;
    *which = (int)bd_entry(index, best) + (int)best;
    return bd_entry(most, best);
}
