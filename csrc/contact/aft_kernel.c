/* Sampled friction of BD_LANES contact points, one tangential direction; compiled once for each
 * instruction set.
 *
 * At sample k, let g = n0 + kn v (or the constant load) and c = slope max(g, 0) be the half width
 * of the sticking range. Then
 *
 *     open      g_k <= 0              w = u_k
 *     closing   g_{k-1} <= 0 < g_k    w = (1 - t) u_{k-1} + t u_k,  t = -g_{k-1}/(g_k - g_{k-1})
 *                                     (without interpolation t = 0)
 *     clip      w < u_k - c: slip+, w = u_k - c;  w > u_k + c: slip-, w = u_k + c
 *
 * All three are clips, w <- min(hi, max(lo, w)), with lo = hi for the first two. Only one maximum
 * and one minimum per sample depend on the previous sample; lo and hi are computed before them, the
 * sums after them.
 *
 * The derivative of a slider depends on the sample that set it only. Sums over sticking samples are
 * running sums: a sticking part adds the difference to their value at its beginning, and enters the
 * derivative when it ends. */
#include "contact/element.h"
#include "util/kernels.h"
#include "util/vector_types.h"

enum { N_VEC = BD_LANES / BD_WIDTH, MOST_KEPT = 14 };

/* Sticking range [lo, hi] of the slider at a sample. */
typedef struct {
    bd_vec lo, hi, inside; /* inside: slider before the clip if the contact closes here */
    bd_mask contact, closing;
} range;

/* Sample before k; the period repeats. */
BD_INLINE int before(const bd_lanes *l, int k) { return k > 0 ? k - 1 : l->n_time - 1; }

/* Sticking range of the lanes of vector v at sample k: u -+ c with c = slope max(g, 0). A contact
 * that closes in the step, g_{k-1} <= 0 < g_k, starts with the slider
 *
 *     inside = (1 - t) u_{k-1} + t u_k,   t = -g_{k-1}/(g_k - g_{k-1}), without interpolation 0. */
BD_INLINE range range_at(const bd_lanes *l, int k, int v) {
    const bd_vec zero = bd_all(0.0);
    const int at = k * BD_LANES + v * BD_WIDTH;
    const int at_before = before(l, k) * BD_LANES + v * BD_WIDTH;
    const bd_vec u = bd_load(l->u + at);
    const bd_vec g = bd_load(l->g + at);
    const bd_vec g_before = bd_load(l->g + at_before);
    const bd_vec c = bd_load(l->slope + v * BD_WIDTH) * bd_max(g, zero);
    range r = {.lo = u - c, .hi = u + c, .inside = u, .contact = bd_above(g, zero)};
    r.closing = r.contact & ~bd_above(g_before, zero);
    if (bd_any(r.closing)) {
        const bd_vec u_before = bd_load(l->u + at_before);
        const bd_vec dg = bd_select(r.closing, g - g_before, bd_all(1.0));
        const bd_vec t = zero - bd_all(l->interpolate ? 1.0 : 0.0) * g_before / dg;
        r.inside = bd_select(r.closing, (bd_all(1.0) - t) * u_before + t * u, u);
    }
    return r;
}

/* Derivatives of a slider w that a sample k has set, with respect to displacement u and load
 * g = n0 + kn v at this sample (now) and at the one before (last). */
typedef struct {
    double u_last, u_now, g_last, g_now;
} slider_derivative;

/* Derivative of the slider w of a lane that sample k has set in one of three ways:
 *
 *     open      w = u_k                       dw = du_k
 *     closing   w = (1 - t) u_{k-1} + t u_k   dw = (1 - t) du_{k-1} + t du_k + (u_k - u_{k-1}) dt,
 *               t = -g_{k-1}/dg,              dt = (g_{k-1} dg_k - g_k dg_{k-1})/dg^2
 *     slip      w = u_k -+ slope g_k          dw = du_k -+ slope dg_k
 *
 * with dg = g_k - g_{k-1}. Without interpolation t = 0 and dt = 0. A closing sets w only inside the
 * sticking range u_k -+ slope g_k. */
static slider_derivative derivative_of_slider(const bd_lanes *l, int lane, int k, double w) {
    const int at = k * BD_LANES + lane;
    const int at_last = before(l, k) * BD_LANES + lane;
    const double u = l->u[at], u_last = l->u[at_last];
    const double g = l->g[at], g_last = l->g[at_last];
    const double slope = l->slope[lane];

    slider_derivative dw = {.u_last = 0.0, .u_now = 1.0, .g_last = 0.0, .g_now = 0.0};
    const int is_open = !(g > 0.0), was_open = !(g_last > 0.0);
    if (is_open) return dw;

    const double half_width = slope * g;
    if (was_open) {
        const double dg = g - g_last;
        const double t = l->interpolate ? -g_last / dg : 0.0;
        const double from_middle = (1.0 - t) * (u_last - u); /* w - u */
        if (from_middle >= -half_width && from_middle <= half_width) {
            const double factor = l->interpolate ? (u - u_last) / (dg * dg) : 0.0;
            dw.u_last = 1.0 - t;
            dw.u_now = t;
            dw.g_last = -factor * g;
            dw.g_now = factor * g_last;
            return dw;
        }
    }

    const int is_lower_end = w - u < 0.0;
    dw.g_now = is_lower_end ? -slope : slope;
    return dw;
}

/* Keep the running sums of one lane at the beginning of a sticking part. At its end, the sums over
 * the part are the differences to them. */
static void save_stick_sums(bd_lanes *l, int lane) {
    const int n_power = bd_n_power(l->n_harm);
    for (int n = 0; n < n_power; ++n) l->saved[n * BD_LANES + lane] = l->stick[n * BD_LANES + lane];
}

/* End a sticking part of one lane, whose slider w was set at sample `origin` (-1: initial slider).
 * With the basis b_k (n_coef) at sample k and its sum B over the samples of the part, add
 *
 *     stick_slider   += w B,
 *     stick_slider_u += B (dw/du)^T,   stick_slider_g += B (dw/dg)^T,     both (n_coef, n_coef).
 *
 * dw depends on u and g at the sample `origin` and the one before; their derivatives with respect
 * to the coefficients of u and g are the basis at these samples. */
BD_NOT_INLINE void end_stick_part(bd_lanes *l, int lane, double w, int origin) {
    const int n_coef = bd_n_coef(l->n_harm), n_power = bd_n_power(l->n_harm);
    const size_t nc = (size_t)n_coef;

    /* the powers from entry 1 on are the basis */
    double basis_sum[BD_MAX_COEF];
    for (int i = 0; i < n_coef; ++i) {
        const int at = (i + 1) * BD_LANES + lane;
        basis_sum[i] = l->stick[at] - l->saved[at];
    }
    save_stick_sums(l, lane);
    double *stick_slider = l->stick_slider + (size_t)lane * nc;
    for (int i = 0; i < n_coef; ++i) stick_slider[i] += w * basis_sum[i];

    const int is_initial = origin < 0; /* its slider has no derivative */
    if (is_initial || !l->stick_slider_u) return;

    /* dw/du and dw/dg in coefficients */
    const slider_derivative dw = derivative_of_slider(l, lane, origin, w);
    const double *basis_now = l->power + (size_t)origin * (size_t)n_power + 1;
    const double *basis_last = l->power + (size_t)before(l, origin) * (size_t)n_power + 1;
    double dw_du[BD_MAX_COEF], dw_dg[BD_MAX_COEF];
    for (int i = 0; i < n_coef; ++i) {
        dw_du[i] = dw.u_last * basis_last[i] + dw.u_now * basis_now[i];
        dw_dg[i] = dw.g_last * basis_last[i] + dw.g_now * basis_now[i];
    }
    for (size_t i = 0; i < nc; ++i) {
        const size_t row = ((size_t)lane * nc + i) * nc;
        double *restrict by_u = l->stick_slider_u + row;
        double *restrict by_g = l->stick_slider_g + row;
        for (size_t j = 0; j < nc; ++j) {
            by_u[j] += basis_sum[i] * dw_du[j];
            by_g[j] += basis_sum[i] * dw_dg[j];
        }
    }
}

/* End the sticking parts of the lanes of vector `vec` in the mask `ending`. */
static void end_stick_parts(bd_lanes *l, int vec, bd_mask ending, bd_vec w, bd_mask origin) {
    for (int i = 0; i < BD_WIDTH; ++i) {
        const size_t at = (size_t)i;
        if (bd_entry_int(ending, at))
            end_stick_part(l, vec * BD_WIDTH + i, bd_entry(w, at), (int)bd_entry_int(origin, at));
    }
}

/* Find the slider w of the steady cycle and the sample that has set it last (origin, -1: none), by
 * one period of clips w <- min(hi, max(lo, w)) from the initial slider. */
void BD_JOIN(bd_lanes_settle_, BD_VARIANT)(bd_lanes *l);
void BD_JOIN(bd_lanes_settle_, BD_VARIANT)(bd_lanes *l) {
    bd_vec w[N_VEC];
    bd_mask origin[N_VEC];
    for (int v = 0; v < N_VEC; ++v) {
        w[v] = bd_load(l->w + v * BD_WIDTH);
        origin[v] = bd_all_int(-1);
    }

    /* ranges; a slider set by closing does not depend on the previous one */
    for (int k = 0; k < l->n_time; ++k)
        for (int v = 0; v < N_VEC; ++v) {
            range r = range_at(l, k, v);
            if (bd_any(r.closing)) {
                const bd_vec fixed = bd_min(r.hi, bd_max(r.lo, r.inside));
                r.lo = bd_select(r.closing, fixed, r.lo);
                r.hi = bd_select(r.closing, fixed, r.hi);
            }
            bd_store(l->lo + k * BD_LANES + v * BD_WIDTH, r.lo);
            bd_store(l->hi + k * BD_LANES + v * BD_WIDTH, r.hi);
        }

    /* slider, and the sample that has set it last */
    for (int k = 0; k < l->n_time; ++k)
        for (int v = 0; v < N_VEC; ++v) {
            const int at = k * BD_LANES + v * BD_WIDTH;
            const bd_vec lo = bd_load(l->lo + at);
            const bd_vec hi = bd_load(l->hi + at);
            const bd_vec next = bd_min(hi, bd_max(lo, w[v]));
            const bd_mask set = bd_differ(next, w[v]) | bd_equal(lo, hi);
            origin[v] = (set & bd_all_int(k)) | (~set & origin[v]);
            w[v] = next;
        }

    for (int v = 0; v < N_VEC; ++v) {
        bd_store(l->w + v * BD_WIDTH, w[v]);
        for (int i = 0; i < BD_WIDTH; ++i)
            l->origin[v * BD_WIDTH + i] = (int)bd_entry_int(origin[v], (size_t)i);
    }
}

/* Slider path_k = min(hi_k, max(lo_k, path_{k-1})) after each sample of the steady period, from the
 * steady slider l->w. Nothing else depends on the previous sample. */
static void slider_path(const bd_lanes *l) {
    bd_vec w[N_VEC];
    for (int v = 0; v < N_VEC; ++v) w[v] = bd_load(l->w + v * BD_WIDTH);
    for (int k = 0; k < l->n_time; ++k)
        for (int v = 0; v < N_VEC; ++v) {
            const int at = k * BD_LANES + v * BD_WIDTH;
            w[v] = bd_min(bd_load(l->hi + at), bd_max(bd_load(l->lo + at), w[v]));
            bd_store(l->path + at, w[v]);
        }
}

/* Vector of BD_WIDTH integers from an array of int. */
BD_INLINE bd_mask load_int(const int *p) {
    int64_t wide[BD_WIDTH];
    bd_mask x;
    for (int i = 0; i < BD_WIDTH; ++i) wide[i] = p[i];
    memcpy(&x, wide, sizeof x);
    return x;
}

/* bd_state of one lane from the masks of a sample. */
BD_INLINE unsigned char state_of(bd_mask stick, bd_mask plus, bd_mask minus, size_t lane) {
    if (bd_entry_int(stick, lane)) return BD_STICK;
    if (bd_entry_int(plus, lane)) return BD_SLIP_PLUS;
    if (bd_entry_int(minus, lane)) return BD_SLIP_MINUS;
    return BD_OPEN;
}

/* Add up the steady period. With the powers p_k (n_power) of exp(i theta_k) at sample k,
 *
 *     stick = sum of p_k over sticking samples,
 *     slip  = sum of p_k over samples that slip+, minus those that slip-.
 *
 * When a sticking part ends, its sums and the slider that it kept enter the derivative
 * (end_stick_part). fixed_power > 0 is n_power as a compile-time constant, whose sums stay in
 * registers; otherwise they are in memory. */
BD_INLINE void sum_samples(bd_lanes *l, const int fixed_power) {
    const int n_power = fixed_power ? fixed_power : bd_n_power(l->n_harm);
    const bd_vec zero = bd_all(0.0), one = bd_all(1.0);
    bd_mask origin[N_VEC], stuck[N_VEC];
    bd_vec w_before[N_VEC], sum_stick[MOST_KEPT][N_VEC], sum_slip[MOST_KEPT][N_VEC];
    for (int v = 0; v < N_VEC; ++v) {
        origin[v] = load_int(l->origin + v * BD_WIDTH);
        stuck[v] = bd_all_int(0);
        w_before[v] = bd_load(l->w + v * BD_WIDTH);
        for (int n = 0; n < fixed_power; ++n) sum_stick[n][v] = sum_slip[n][v] = zero;
    }
    for (int k = 0; k < l->n_time; ++k) {
        const double *power = l->power + (size_t)k * (size_t)n_power;
        for (int v = 0; v < N_VEC; ++v) {
            const int at = k * BD_LANES + v * BD_WIDTH;
            const range r = range_at(l, k, v);

            /* state of the sample: which end of the range pushes the slider */
            const bd_vec start = bd_select(r.closing, r.inside, w_before[v]);
            const bd_mask plus = r.contact & bd_above(r.lo, start);
            const bd_mask minus = r.contact & ~plus & bd_above(start, r.hi);
            const bd_mask stick = r.contact & ~plus & ~minus;

            /* the slider moves after a sticking part */
            const bd_mask ending = stuck[v] & ~stick;
            if (bd_any(ending)) {
                for (int n = 0; n < fixed_power; ++n)
                    bd_store(l->stick + n * BD_LANES + v * BD_WIDTH, sum_stick[n][v]);
                end_stick_parts(l, v, ending, w_before[v], origin[v]);
            }
            const bd_mask set = ~stick | r.closing;
            w_before[v] = bd_load(l->path + at);
            origin[v] = (set & bd_all_int(k)) | (~set & origin[v]);
            stuck[v] = stick;

            /* weights 1 (stick); 1, -1 (slip+, slip-) of the powers */
            const bd_vec sticking = bd_select(stick, one, zero);
            const bd_vec slipping = bd_select(plus, one, bd_select(minus, zero - one, zero));
            for (int n = 0; n < fixed_power; ++n) {
                sum_stick[n][v] += power[n] * sticking;
                sum_slip[n][v] += power[n] * slipping;
            }
            for (int n = 0; n < n_power && !fixed_power; ++n) {
                double *to_stick = l->stick + n * BD_LANES + v * BD_WIDTH;
                double *to_slip = l->slip + n * BD_LANES + v * BD_WIDTH;
                bd_store(to_stick, bd_load(to_stick) + power[n] * sticking);
                bd_store(to_slip, bd_load(to_slip) + power[n] * slipping);
            }
            if (!l->state) continue;
            for (int i = 0; i < BD_WIDTH; ++i)
                l->state[at + i] = state_of(stick, plus, minus, (size_t)i);
        }
    }

    /* sticking parts that reach the end of the period */
    for (int v = 0; v < N_VEC; ++v) {
        for (int n = 0; n < fixed_power; ++n) {
            bd_store(l->stick + n * BD_LANES + v * BD_WIDTH, sum_stick[n][v]);
            bd_store(l->slip + n * BD_LANES + v * BD_WIDTH, sum_slip[n][v]);
        }
        end_stick_parts(l, v, stuck[v], w_before[v], origin[v]);
    }
}

/* Sums over the steady cycle from the steady slider. One harmonic, the usual case, has its own
 * version with the sums in registers. */
void BD_JOIN(bd_lanes_sum_, BD_VARIANT)(bd_lanes *l);
void BD_JOIN(bd_lanes_sum_, BD_VARIANT)(bd_lanes *l) {
    enum { POWERS_OF_ONE_HARMONIC = 6 }; /* bd_n_power(1) */
    for (int lane = 0; lane < BD_LANES; ++lane) save_stick_sums(l, lane);
    slider_path(l);
    if (l->n_harm == 1)
        sum_samples(l, POWERS_OF_ONE_HARMONIC);
    else
        sum_samples(l, 0);
}

/* value (n_time, BD_LANES) = b x with the basis b_k (n_coef), entry 1 onwards of the powers
 * (n_time, n_power), and coefficients x (n_coef, BD_LANES). */
void BD_JOIN(bd_lanes_values_, BD_VARIANT)(int n_coef, int n_time, const double *power, int n_power,
                                           const double *x, double *value);
void BD_JOIN(bd_lanes_values_, BD_VARIANT)(int n_coef, int n_time, const double *power, int n_power,
                                           const double *x, double *value) {
    for (int k = 0; k < n_time; ++k) {
        const double *basis = power + (size_t)k * (size_t)n_power + 1; /* basis[0] = 1 */
        for (int v = 0; v < N_VEC; ++v) {
            bd_vec sum = bd_load(x + v * BD_WIDTH);
            for (int i = 1; i < n_coef; ++i)
                sum += basis[i] * bd_load(x + i * BD_LANES + v * BD_WIDTH);
            bd_store(value + k * BD_LANES + v * BD_WIDTH, sum);
        }
    }
}

/* E (n_power, BD_LANES) = sum of the powers (n_time, n_power) over samples in contact, g > 0. */
void BD_JOIN(bd_lanes_contact_, BD_VARIANT)(int n_power, int n_time, const double *power,
                                            const double *g, double *E);
void BD_JOIN(bd_lanes_contact_, BD_VARIANT)(int n_power, int n_time, const double *power,
                                            const double *g, double *E) {
    const bd_vec zero = bd_all(0.0), one = bd_all(1.0);
    for (int n = 0; n < n_power * BD_LANES; ++n) E[n] = 0.0;
    for (int k = 0; k < n_time; ++k) {
        const double *power_at_sample = power + (size_t)k * (size_t)n_power;
        for (int v = 0; v < N_VEC; ++v) {
            const bd_vec load = bd_load(g + k * BD_LANES + v * BD_WIDTH);
            const bd_vec in_contact = bd_select(bd_above(load, zero), one, zero);
            for (int n = 0; n < n_power; ++n) {
                double *sum = E + n * BD_LANES + v * BD_WIDTH;
                bd_store(sum, bd_load(sum) + power_at_sample[n] * in_contact);
            }
        }
    }
}
