/* Sampled friction of BD_LANES contact points at a time, one tangential direction; compiled once for each instruction set.
 *
 * At every sample k, with g = n0 + kn v (or the constant load) and the half width c = slope max(g, 0) of the sticking range,
 *
 *     open      g_k <= 0                          w = u_k
 *     closing   g_{k-1} <= 0 < g_k                w = (1 - t) u_{k-1} + t u_k,  t = -g_{k-1}/(g_k - g_{k-1})  (plain: t = 0)
 *     clip      w < u_k - c: slip+, w = u_k - c;  w > u_k + c: slip-, w = u_k + c
 *
 * All lanes take the same instructions, choices are masks.  A slider keeps the sample that set it and the weights of the
 * bases there, which is its whole derivative.  Sums over samples that stick are running sums; what a stretch of sticking
 * added is the difference to their value at its beginning, and goes to the derivative when the stretch ends. */
#include "bd_element.h"
#include "bd_kernel.h"
#include "bd_vector.h"

enum { N_VEC = BD_LANES / BD_WIDTH };

typedef struct {
    bd_vec w[N_VEC];
    bd_mask origin[N_VEC];
    bd_vec part[4][N_VEC];
    bd_mask stuck[N_VEC]; /* was sticking at the previous sample */
} lanes_state;

static void save(bd_lanes *l, int lane) {
    const int n_power = bd_n_power(l->n_harm);
    for (int n = 0; n < n_power; ++n) l->saved[n * BD_LANES + lane] = l->stick[n * BD_LANES + lane];
}

/* The stretch of sticking of one lane ends. */
static __attribute__((noinline)) void end_stretch(bd_lanes *l, int lane, double w, int origin, const double *part) {
    const int n_coef = bd_n_coef(l->n_harm), n_power = bd_n_power(l->n_harm);
    const size_t nc = (size_t)n_coef;
    double g[BD_MAX_COEF], du[BD_MAX_COEF], dg[BD_MAX_COEF];
    for (int i = 0; i < n_coef; ++i) g[i] = l->stick[(i + 1) * BD_LANES + lane] - l->saved[(i + 1) * BD_LANES + lane];
    save(l, lane);
    for (int i = 0; i < n_coef; ++i) l->held[(size_t)lane * nc + (size_t)i] += w * g[i];
    if (origin < 0 || !l->held_u) return;
    const double *b1 = l->power + (size_t)origin * (size_t)n_power + 1;
    const double *b0 = l->power + (size_t)(origin > 0 ? origin - 1 : l->n_time - 1) * (size_t)n_power + 1;
    for (int i = 0; i < n_coef; ++i) {
        du[i] = part[0] * b0[i] + part[1] * b1[i];
        dg[i] = part[2] * b0[i] + part[3] * b1[i];
    }
    for (size_t i = 0; i < nc; ++i) {
        double *restrict hu = l->held_u + ((size_t)lane * nc + i) * nc, *restrict hg = l->held_g + ((size_t)lane * nc + i) * nc;
        for (size_t j = 0; j < nc; ++j) {
            hu[j] += g[i] * du[j];
            hg[j] += g[i] * dg[j];
        }
    }
}

static void end_stretches(bd_lanes *l, const lanes_state *s, int vec, bd_mask ending) {
    for (int i = 0; i < BD_WIDTH; ++i)
        if (ending[i]) {
            const double part[4] = {s->part[0][vec][i], s->part[1][vec][i], s->part[2][vec][i], s->part[3][vec][i]};
            end_stretch(l, vec * BD_WIDTH + i, s->w[vec][i], (int)s->origin[vec][i], part);
        }
}

BD_INLINE void sample(bd_lanes *l, lanes_state *s, int k, const int settle) {
    const int before = k > 0 ? k - 1 : l->n_time - 1, n_power = bd_n_power(l->n_harm);
    const double *power = l->power + (size_t)k * (size_t)n_power;
    const bd_vec zero = bd_all(0.0), one = bd_all(1.0);
    bd_vec sticking[N_VEC], slipping[N_VEC];
    for (int v = 0; v < N_VEC; ++v) {
        const bd_vec u = bd_load(l->u + k * BD_LANES + v * BD_WIDTH), g = bd_load(l->g + k * BD_LANES + v * BD_WIDTH);
        const bd_vec u_before = bd_load(l->u + before * BD_LANES + v * BD_WIDTH);
        const bd_vec g_before = bd_load(l->g + before * BD_LANES + v * BD_WIDTH);
        const bd_vec slope = bd_load(l->slope + v * BD_WIDTH);
        const bd_mask contact = (bd_mask)(g > zero), given = (bd_mask)(s->origin[v] < (bd_mask){0});
        const bd_mask closing = contact & ~(bd_mask)(g_before > zero) & ~given;
        bd_vec w = s->w[v];
        if (bd_any(closing)) {
            const bd_vec dg = bd_select(closing, g - g_before, one);
            const bd_vec use = bd_all(l->interpolate ? 1.0 : 0.0);
            const bd_vec t = zero - use * g_before / dg, factor = use * (u - u_before) / (dg * dg);
            w = bd_select(closing, (one - t) * u_before + t * u, w);
            s->origin[v] = (closing & ((bd_mask){0} + k)) | (~closing & s->origin[v]);
            s->part[0][v] = bd_select(closing, one - t, s->part[0][v]);
            s->part[1][v] = bd_select(closing, t, s->part[1][v]);
            s->part[2][v] = bd_select(closing, zero - factor * g, s->part[2][v]);
            s->part[3][v] = bd_select(closing, factor * g_before, s->part[3][v]);
        }
        const bd_vec c = slope * bd_select(contact, g, zero), lo = u - c, hi = u + c;
        const bd_mask plus = contact & (bd_mask)(w < lo), minus = contact & ~plus & (bd_mask)(w > hi);
        const bd_mask set = plus | minus | ~contact;
        const bd_mask stick = ~set;
        if (!settle) {
            const bd_mask ending = s->stuck[v] & set;
            if (bd_any(ending)) end_stretches(l, s, v, ending);
        }
        w = bd_select(plus, lo, bd_select(minus, hi, w));
        w = bd_select(contact, w, u);
        s->w[v] = w;
        s->origin[v] = (set & ((bd_mask){0} + k)) | (~set & s->origin[v]);
        s->part[0][v] = bd_select(set, zero, s->part[0][v]);
        s->part[1][v] = bd_select(set, one, s->part[1][v]);
        s->part[2][v] = bd_select(set, zero, s->part[2][v]);
        s->part[3][v] = bd_select(set, bd_select(plus, zero - slope, bd_select(minus, slope, zero)), s->part[3][v]);
        s->stuck[v] = stick;
        if (settle) continue;
        sticking[v] = bd_select(stick, one, zero);
        slipping[v] = bd_select(plus, one, bd_select(minus, zero - one, zero));
        for (int i = 0; l->state && i < BD_WIDTH; ++i) {
            const int state = stick[i] ? BD_STICK : plus[i] ? BD_SLIP_PLUS : minus[i] ? BD_SLIP_MINUS : BD_OPEN;
            l->state[k * BD_LANES + v * BD_WIDTH + i] = (unsigned char)state;
        }
    }
    if (settle) return;
    for (int n = 0; n < n_power; ++n)
        for (int v = 0; v < N_VEC; ++v) {
            double *stick = l->stick + n * BD_LANES + v * BD_WIDTH, *slip = l->slip + n * BD_LANES + v * BD_WIDTH;
            bd_store(stick, bd_load(stick) + power[n] * sticking[v]);
            bd_store(slip, bd_load(slip) + power[n] * slipping[v]);
        }
}

void BD_JOIN(bd_lanes_march_, BD_VARIANT)(bd_lanes *l, int settle);
void BD_JOIN(bd_lanes_march_, BD_VARIANT)(bd_lanes *l, int settle) {
    lanes_state s;
    for (int v = 0; v < N_VEC; ++v) {
        s.w[v] = bd_load(l->w + v * BD_WIDTH);
        for (int q = 0; q < 4; ++q) s.part[q][v] = bd_load(l->part[q] + v * BD_WIDTH);
        for (int i = 0; i < BD_WIDTH; ++i) s.origin[v][i] = l->origin[v * BD_WIDTH + i];
        s.stuck[v] = (bd_mask){0};
    }
    if (settle)
        for (int k = 0; k < l->n_time; ++k) sample(l, &s, k, 1);
    else {
        for (int lane = 0; lane < BD_LANES; ++lane) save(l, lane);
        for (int k = 0; k < l->n_time; ++k) sample(l, &s, k, 0);
        for (int v = 0; v < N_VEC; ++v) end_stretches(l, &s, v, s.stuck[v]);
    }
    for (int v = 0; v < N_VEC; ++v) {
        bd_store(l->w + v * BD_WIDTH, s.w[v]);
        for (int q = 0; q < 4; ++q) bd_store(l->part[q] + v * BD_WIDTH, s.part[q][v]);
        for (int i = 0; i < BD_WIDTH; ++i) l->origin[v * BD_WIDTH + i] = (int)s.origin[v][i];
    }
}

void BD_JOIN(bd_lanes_values_, BD_VARIANT)(int n_coef, int n_time, const double *power, int n_power, const double *x,
                                           double *value);
void BD_JOIN(bd_lanes_values_, BD_VARIANT)(int n_coef, int n_time, const double *power, int n_power, const double *x,
                                           double *value) {
    for (int k = 0; k < n_time; ++k) {
        const double *b = power + (size_t)k * (size_t)n_power + 1;
        for (int v = 0; v < N_VEC; ++v) {
            bd_vec sum = bd_load(x + v * BD_WIDTH);
            for (int i = 1; i < n_coef; ++i) sum += b[i] * bd_load(x + i * BD_LANES + v * BD_WIDTH);
            bd_store(value + k * BD_LANES + v * BD_WIDTH, sum);
        }
    }
}

void BD_JOIN(bd_lanes_contact_, BD_VARIANT)(int n_power, int n_time, const double *power, const double *g, double *E);
void BD_JOIN(bd_lanes_contact_, BD_VARIANT)(int n_power, int n_time, const double *power, const double *g, double *E) {
    const bd_vec zero = bd_all(0.0), one = bd_all(1.0);
    for (int n = 0; n < n_power * BD_LANES; ++n) E[n] = 0.0;
    for (int k = 0; k < n_time; ++k)
        for (int v = 0; v < N_VEC; ++v) {
            const bd_vec in = bd_select((bd_mask)(bd_load(g + k * BD_LANES + v * BD_WIDTH) > zero), one, zero);
            for (int n = 0; n < n_power; ++n) {
                double *e = E + n * BD_LANES + v * BD_WIDTH;
                bd_store(e, bd_load(e) + power[(size_t)k * (size_t)n_power + (size_t)n] * in);
            }
        }
}
