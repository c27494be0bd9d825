/* In-plane coupled Coulomb friction with variable or constant normal load and separation.
 *
 * In newtons, p_d = kt_d u_d is the displacement and s_d = kt_d w_d the slider.  The friction force T = p - s lies in the
 * disk |T| <= R, R = mu max(n0 + kn v, 0) (or mu load).  Inside of it the slider rests; on its edge it follows,
 *
 *     s' = lambda T/R,   lambda = e . p' - R' >= 0,   e = T/R,      hence     e' = (I - e e^T) p'/R,
 *
 * and in open contact s = p.  (With kt_1 = kt_2 this is slip along the friction force; with kt_1 != kt_2 the return to the
 * disk is radial in the force.)
 *
 * One step.  Between samples p and n0 + kn v are taken as linear in time, and that motion is solved exactly, events
 * inside the step included, which makes the evaluation of second order:
 *
 *   stick    T moves along the chord dp; it leaves the disk at the root of |T + tau dp|^2 = (R + tau dR)^2.
 *   slip     with D = |dp|, a = dp/D, the angle theta between e and a obeys d theta/d tau = -(D/R) sin theta, so
 *            tan(theta/2) shrinks by q = exp(-D int d tau/R).  With c = a.e, x = 1 + c, y = 1 - c, den = x + q^2 y,
 *                e_1 = alpha a + beta (e - c a),  alpha = (x - q^2 y)/den,  beta = 2 q/den.        (tractrix)
 *   closing  R grows from zero: stick if |dp| <= dR over the rest of the step, else slip along a.
 *   opening  s = p.
 *
 * At the onset of slip a perturbation of T is projected on the edge of the disk, so the instant of the onset need not be
 * differentiated.
 *
 * Rest.  A slider that lies in all the disks |p_k - s| <= R_k of the cycle never moves.  If their intersection is not
 * empty, the settled slider is the point of it nearest to the given one (where a transient would end in the intersection
 * depends on its history, which the law leaves open; in one dimension this is the nearer end of the interval).  A nearest
 * point is held by at most two disks: while some disk is violated, the one violated most joins them, and the nearest point
 * of these three is one of few candidates.  If three disks have no point in common, nothing rests (Helly).
 *
 * The cycle.  Otherwise the slider moves, and unlike a 1-D one settles over many periods (thousands for an ellipse that
 * barely slips).  The settled slider is the fixed point of the period map P: Newton's method with the exact 2 x 2 derivative
 * P', and plain periods where Newton does not bring P(s) closer to s.  The derivative of the settled slider follows from
 * (I - P') ds = P_x dx. */
#include "bd_coulomb.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_PERIODS = 400, PLAIN_PERIODS = 3 };
enum { STEP_STICK, STEP_SLIP, STEP_OPEN, STEP_CLOSE };
static const double EDGE = 1e-12;    /* relative distance at which T counts as on the edge of the disk */
static const double SETTLED = 2e-14; /* |P(s) - s| relative to the size of the forces */

/* ds_1 = A ds_0 + B0 dp_0 + B1 dp_1 + C0 dg_0 + C1 dg_1 */
typedef struct {
    int kind;
    double s[2];
    double A[2][2], B0[2][2], B1[2][2], C0[2], C1[2];
} bd_step;

bd_status bd_coulomb_create(bd_coulomb_work *work, const bd_sampled_work *sampled) {
    memset(work, 0, sizeof *work);
    const size_t n_coef = (size_t)bd_n_coef(sampled->n_harm), k = (size_t)sampled->n_time, n_col = 3 * n_coef + 2;
    const size_t n_power = (size_t)bd_n_power(sampled->n_harm);
    work->memory = malloc(sizeof(double) * (3 * k + 4 * n_col + 2 * n_coef * n_col + n_coef + n_coef * n_coef + n_power));
    work->segment = malloc(sizeof(bd_segment) * k);
    if (!work->memory || !work->segment) {
        bd_coulomb_destroy(work);
        return BD_NO_MEMORY;
    }
    work->n_harm = sampled->n_harm;
    work->n_time = sampled->n_time;
    work->interpolate = sampled->lanes.interpolate;
    work->power = sampled->power;
    double *m = work->memory;
    work->p = m, m += 2 * k;
    work->g = m, m += k;
    work->slider = m, m += 2 * n_col;
    work->next = m, m += 2 * n_col;
    work->held = m, m += 2 * n_coef * n_col;
    work->stretch = m, m += n_coef;
    work->products = m, m += n_coef * n_coef;
    work->contact = m;
    return BD_OK;
}

void bd_coulomb_destroy(bd_coulomb_work *work) {
    if (!work) return;
    free(work->memory);
    free(work->segment);
    memset(work, 0, sizeof *work);
}

/* Forces of any sensible size: no need for the care (and time) that hypot takes. */
static inline double norm(double x, double y) { return sqrt(x * x + y * y); }

static const double *basis_at(const bd_coulomb_work *work, int k) {
    return work->power + (size_t)k * (size_t)bd_n_power(work->n_harm) + 1;
}

static int before(const bd_coulomb_work *work, int k) { return k > 0 ? k - 1 : work->n_time - 1; }

/* ---- one step ---- */

static void zero_step(bd_step *o, int kind) {
    memset(o, 0, sizeof *o);
    o->kind = kind;
}

/* (log R1 - log R0)/(R1 - R0) = int d tau/R, and its derivatives. */
static double mean_inverse(double R0, double R1, double *d0, double *d1) {
    const double d = (R1 - R0) / R0;
    double L;
    if (fabs(d) < 1e-3) { /* series of log(1 + d)/d to rounding */
        double sum = 0.0, slope = 0.0;
        for (int n = 6; n >= 0; --n) sum = 1.0 / (n + 1) - d * sum;
        for (int n = 6; n >= 1; --n) slope = (double)n / (n + 1) - d * slope; /* minus the derivative of the series */
        L = sum / R0;
        *d1 = -slope / (R0 * R0);
        *d0 = -L / R0 - *d1 * R1 / R0; /* homogeneous of degree -1 */
        return L;
    }
    L = log1p(d) / (R1 - R0);
    *d1 = (1.0 / R1 - L) / (R1 - R0);
    *d0 = (L - 1.0 / R0) / (R1 - R0);
    return L;
}

/* Slip over the rest 1 - tau of the step, from the force direction e on the edge R_e. */
static void slip_step(bd_step *o, const double *e, double tau, double R_e, double R1, double mu, const double *dp,
                      const double *p1) {
    const double D[2] = {(1.0 - tau) * dp[0], (1.0 - tau) * dp[1]}, length = norm(D[0], D[1]);
    double M_e[2][2] = {{1.0, 0.0}, {0.0, 1.0}}, M_D[2][2] = {{0.0}}, m_e[2] = {0.0}, m_1[2] = {0.0};
    double e1[2] = {e[0], e[1]};
    if (length > 0.0) {
        double L_e, L_1;
        const double L = mean_inverse(R_e, R1, &L_e, &L_1), q = exp(-length * L), a[2] = {D[0] / length, D[1] / length};
        const double c = fmax(a[0] * e[0] + a[1] * e[1], -1.0 + 1e-14), X = 1.0 + c, Y = 1.0 - c, den = X + q * q * Y;
        const double alpha = (X - q * q * Y) / den, beta = 2.0 * q / den;
        const double alpha_c = beta * beta, alpha_q = -4.0 * q * X * Y / (den * den);
        const double beta_c = -2.0 * q * (1.0 - q * q) / (den * den), beta_q = 2.0 * alpha / den;
        for (int i = 0; i < 2; ++i) e1[i] = alpha * a[i] + beta * (e[i] - c * a[i]);
        for (int i = 0; i < 2; ++i) {
            const double side = e[i] - c * a[i];
            const double V_c = a[i] * (alpha_c - beta) + side * beta_c, V_q = a[i] * alpha_q + side * beta_q;
            for (int j = 0; j < 2; ++j) {
                const double across = (i == j ? 1.0 : 0.0) - a[i] * a[j];
                M_e[i][j] = (i == j ? beta : 0.0) + V_c * a[j];
                M_D[i][j] = (alpha - beta * c) * across / length + V_c * (e[j] - c * a[j]) / length - q * L * V_q * a[j];
            }
            m_e[i] = -q * length * L_e * V_q;
            m_1[i] = -q * length * L_1 * V_q;
        }
    }
    double size = norm(e1[0], e1[1]);
    e1[0] /= size;
    e1[1] /= size;
    zero_step(o, STEP_SLIP);
    for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 2; ++j) {
            double turn = 0.0; /* R1 M_e (I - e e^T)/R_e */
            for (int k = 0; k < 2; ++k) turn += M_e[i][k] * ((k == j ? 1.0 : 0.0) - e[k] * e[j]);
            turn *= R1 / R_e;
            o->A[i][j] = turn;
            o->B0[i][j] = (1.0 - tau) * (R1 * M_D[i][j] - turn);
            o->B1[i][j] = (i == j ? 1.0 : 0.0) - tau * turn - (1.0 - tau) * R1 * M_D[i][j];
        }
        o->C0[i] = -R1 * mu * m_e[i] * (1.0 - tau);
        o->C1[i] = -R1 * mu * (m_e[i] * tau + m_1[i]) - mu * e1[i];
        o->s[i] = p1[i] - R1 * e1[i];
    }
}

static void close_step(bd_step *o, double t, double g0, double g1, double mu, const double *dp, const double *p0,
                       const double *p1, int interpolate) {
    const double rest = 1.0 - t, chord = norm(dp[0], dp[1]), R1 = mu * g1, dg = g1 - g0;
    if (rest * chord <= R1) {
        zero_step(o, STEP_CLOSE);
        for (int i = 0; i < 2; ++i) {
            o->s[i] = p0[i] + t * dp[i];
            o->B0[i][i] = rest;
            o->B1[i][i] = t;
            o->C0[i] = interpolate ? -dp[i] * g1 / (dg * dg) : 0.0;
            o->C1[i] = interpolate ? dp[i] * g0 / (dg * dg) : 0.0;
        }
        return;
    }
    zero_step(o, STEP_SLIP);
    for (int i = 0; i < 2; ++i) {
        const double a = dp[i] / chord;
        for (int j = 0; j < 2; ++j) {
            const double across = ((i == j ? 1.0 : 0.0) - a * dp[j] / chord) * R1 / chord;
            o->B0[i][j] = across;
            o->B1[i][j] = (i == j ? 1.0 : 0.0) - across;
        }
        o->C1[i] = -mu * a;
        o->s[i] = p1[i] - R1 * a;
    }
}

/* From sample k0 to the next one, k1. */
static void take_step(const bd_coulomb_work *work, double mu, int k0, int k1, const double *s, bd_step *o) {
    const double *p0 = work->p + 2 * k0, *p1 = work->p + 2 * k1, g0 = work->g[k0], g1 = work->g[k1];
    const double dp[2] = {p1[0] - p0[0], p1[1] - p0[1]};
    if (!(g1 > 0.0)) {
        zero_step(o, STEP_OPEN);
        o->s[0] = p1[0], o->s[1] = p1[1];
        o->B1[0][0] = o->B1[1][1] = 1.0;
        return;
    }
    if (!(g0 > 0.0)) {
        close_step(o, work->interpolate ? -g0 / (g1 - g0) : 0.0, g0, g1, mu, dp, p0, p1, work->interpolate);
        return;
    }
    const double T[2] = {p0[0] - s[0], p0[1] - s[1]}, R0 = mu * g0, R1 = mu * g1, dR = R1 - R0, size = norm(T[0], T[1]);
    const int edge = size >= R0 * (1.0 - EDGE);
    if (edge && T[0] * dp[0] + T[1] * dp[1] > size * dR) {
        const double e[2] = {T[0] / size, T[1] / size};
        slip_step(o, e, 0.0, R0, R1, mu, dp, p1);
        return;
    }
    if (norm(p1[0] - s[0], p1[1] - s[1]) <= R1) {
        zero_step(o, STEP_STICK);
        o->s[0] = s[0], o->s[1] = s[1];
        o->A[0][0] = o->A[1][1] = 1.0;
        return;
    }
    const double a = dp[0] * dp[0] + dp[1] * dp[1] - dR * dR, b = T[0] * dp[0] + T[1] * dp[1] - R0 * dR;
    const double c = edge ? 0.0 : (size - R0) * (size + R0), root = sqrt(fmax(b * b - a * c, 0.0));
    const double tau = fmin(1.0, fmax(0.0, b >= 0.0 ? (b + root > 0.0 ? -c / (b + root) : 0.0) : (root - b) / a));
    const double Te[2] = {T[0] + tau * dp[0], T[1] + tau * dp[1]}, size_e = norm(Te[0], Te[1]);
    const double e[2] = {Te[0] / size_e, Te[1] / size_e};
    slip_step(o, e, tau, R0 + tau * dR, R1, mu, dp, p1);
}

/* ---- rest ---- */

typedef struct {
    int n, sample[3];
    double s[2];
} bd_rest;

static double violation(const bd_coulomb_work *work, double mu, int k, const double *s) {
    return norm(work->p[2 * k] - s[0], work->p[2 * k + 1] - s[1]) - mu * work->g[k];
}

static int inside(const bd_coulomb_work *work, double mu, const bd_rest *set, const double *s, double slack) {
    for (int i = 0; i < set->n; ++i)
        if (violation(work, mu, set->sample[i], s) > slack) return 0;
    return 1;
}

/* The point common to the edges of disks i and j on the given side; returns 0 if there is none. */
static int crossing(const bd_coulomb_work *work, double mu, int i, int j, double side, double *s) {
    const double *a = work->p + 2 * i, *b = work->p + 2 * j, Ri = mu * work->g[i], Rj = mu * work->g[j];
    const double d[2] = {b[0] - a[0], b[1] - a[1]}, D2 = d[0] * d[0] + d[1] * d[1];
    if (!(D2 > 0.0)) return 0;
    const double along = 0.5 * (1.0 + (Ri - Rj) * (Ri + Rj) / D2), height2 = Ri * Ri / D2 - along * along;
    if (height2 < 0.0) return 0;
    const double across = side * sqrt(height2);
    s[0] = a[0] + along * d[0] - across * d[1];
    s[1] = a[1] + along * d[1] + across * d[0];
    return 1;
}

/* The point of at most three disks nearest to `given`, and the one or two that hold it; returns 0 if they are disjoint. */
static int nearest_of_few(const bd_coulomb_work *work, double mu, const double *given, double slack, bd_rest *set) {
    bd_rest best = {0};
    double distance = INFINITY;
    for (int i = 0; i < set->n; ++i)
        for (int j = i; j < set->n; ++j)
            for (double side = -1.0; side <= 1.0; side += 2.0) {
                double s[2];
                const int k = set->sample[i];
                if (j == i) {
                    const double *p = work->p + 2 * k, size = norm(given[0] - p[0], given[1] - p[1]);
                    if (!(size > mu * work->g[k])) continue;
                    for (int d = 0; d < 2; ++d) s[d] = p[d] + (given[d] - p[d]) * (mu * work->g[k] / size);
                } else if (!crossing(work, mu, k, set->sample[j], side, s)) {
                    continue;
                }
                const double far = norm(s[0] - given[0], s[1] - given[1]);
                if (far >= distance || !inside(work, mu, set, s, slack)) continue;
                distance = far;
                best = (bd_rest){.n = i == j ? 1 : 2, .sample = {k, set->sample[j]}, .s = {s[0], s[1]}};
            }
    *set = best;
    return best.n > 0;
}

/* Whether a slider can rest through the cycle; set->s is then the nearest to the given one, n = 0 if it is itself. */
static int find_rest(const bd_coulomb_work *work, double mu, const double *given, double size, bd_rest *set) {
    const double slack = 1e-13 * size;
    *set = (bd_rest){.s = {given[0], given[1]}};
    for (int k = 0; k < work->n_time; ++k)
        if (!(work->g[k] > 0.0)) return 0;
    for (int round = 0; round < 100; ++round) {
        int worst = -1;
        double most = slack;
        for (int k = 0; k < work->n_time; ++k) {
            const double far = violation(work, mu, k, set->s);
            if (far > most) most = far, worst = k;
        }
        if (worst < 0) return 1;
        set->sample[set->n++] = worst;
        if (!nearest_of_few(work, mu, given, slack, set)) return 0;
    }
    return 0;
}

/* Derivative of the slider that one or two disks hold: from |p - s| = R, with the given slider fixed. */
static void derivative_of_rest(bd_coulomb_work *work, const bd_element *element, const double *given, const bd_rest *set) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = 3 * n_coef + 2;
    const double mu = element->mu, kn = bd_law_is_constant(element->law) ? 0.0 : element->kn;
    memset(work->slider, 0, sizeof(double) * 2 * n_col);
    double e[2][2], M[2][2][2] = {{{0.0}}}, m[2][2] = {{0.0}}; /* ds = sum M_i dp_i + m_i dR_i */
    for (int i = 0; i < set->n; ++i) {
        const double *p = work->p + 2 * set->sample[i], size = norm(p[0] - set->s[0], p[1] - set->s[1]);
        for (int d = 0; d < 2; ++d) e[i][d] = (p[d] - set->s[d]) / size;
    }
    if (set->n == 1) {
        const double *p = work->p + 2 * set->sample[0],
                     ratio = mu * work->g[set->sample[0]] / norm(p[0] - given[0], p[1] - given[1]);
        for (int d = 0; d < 2; ++d) {
            for (int c = 0; c < 2; ++c) {
                const double same = c == d ? 1.0 : 0.0;
                M[0][d][c] = same - ratio * (same - e[0][d] * e[0][c]);
            }
            m[0][d] = -e[0][d];
        }
    } else if (set->n == 2) {
        const double det = e[0][0] * e[1][1] - e[0][1] * e[1][0];
        const double inverse[2][2] = {{e[1][1] / det, -e[0][1] / det}, {-e[1][0] / det, e[0][0] / det}};
        for (int i = 0; i < 2; ++i)
            for (int d = 0; d < 2; ++d) {
                for (int c = 0; c < 2; ++c) M[i][d][c] = inverse[d][i] * e[i][c];
                m[i][d] = -inverse[d][i];
            }
    }
    for (int i = 0; i < set->n; ++i) {
        const double *b = basis_at(work, set->sample[i]);
        for (size_t d = 0; d < 2; ++d)
            for (size_t j = 0; j < n_coef; ++j) {
                for (size_t c = 0; c < 2; ++c)
                    work->slider[d * n_col + c * n_coef + j] += M[i][d][c] * element->kt[c] * b[j];
                work->slider[d * n_col + 2 * n_coef + j] += m[i][d] * mu * kn * b[j];
            }
    }
}

/* ---- the period map ---- */

/* The slider as it is admissible at the last sample of the previous period. */
static void admit(const bd_coulomb_work *work, double mu, double *s) {
    const int k = work->n_time - 1;
    const double *p = work->p + 2 * k, R = mu * fmax(work->g[k], 0.0);
    const double T[2] = {p[0] - s[0], p[1] - s[1]}, size = norm(T[0], T[1]);
    if (size <= R) return;
    s[0] = p[0] - T[0] * R / size;
    s[1] = p[1] - T[1] * R / size;
}

/* One period.  dP (2, 2) is the derivative of s at the end with respect to the start. */
static void march(const bd_coulomb_work *work, double mu, double *s, double dP[2][2]) {
    bd_step o;
    dP[0][0] = dP[1][1] = 1.0;
    dP[0][1] = dP[1][0] = 0.0;
    for (int k = 0; k < work->n_time; ++k) {
        take_step(work, mu, before(work, k), k, s, &o);
        if (o.kind == STEP_STICK) continue;
        s[0] = o.s[0], s[1] = o.s[1];
        for (int j = 0; j < 2; ++j) {
            const double d0 = dP[0][j], d1 = dP[1][j];
            dP[0][j] = o.A[0][0] * d0 + o.A[0][1] * d1;
            dP[1][j] = o.A[1][0] * d0 + o.A[1][1] * d1;
        }
    }
}

/* Solves (I - dP) y = b; returns 0 if that is not possible. */
static int solve_period(const double dP[2][2], const double *b, double *y) {
    const double m00 = 1.0 - dP[0][0], m11 = 1.0 - dP[1][1], m01 = -dP[0][1], m10 = -dP[1][0];
    const double det = m00 * m11 - m01 * m10;
    if (!(fabs(det) > 1e-14 * (fabs(m00 * m11) + fabs(m01 * m10)) + 1e-200)) return 0;
    y[0] = (m11 * b[0] - m01 * b[1]) / det;
    y[1] = (m00 * b[1] - m10 * b[0]) / det;
    return 1;
}

/* The settled slider at the end of the period; returns 0 if it was not found. */
static int settle(bd_coulomb_work *work, double mu, double size, double *s) {
    double best[2] = {s[0], s[1]}, gap_best = INFINITY;
    work->n_period = work->n_newton = 0;
    admit(work, mu, s);
    while (work->n_period < MOST_PERIODS) {
        double end[2] = {s[0], s[1]}, dP[2][2], step[2];
        march(work, mu, end, dP);
        const double gap[2] = {end[0] - s[0], end[1] - s[1]}, distance = norm(gap[0], gap[1]);
        ++work->n_period;
        if (distance <= SETTLED * size) {
            s[0] = end[0], s[1] = end[1];
            return 1;
        }
        /* a Newton step that led further away is undone by a plain period from the best point */
        if (distance < gap_best || work->n_period <= PLAIN_PERIODS) {
            gap_best = distance;
            best[0] = end[0], best[1] = end[1];
            if (work->n_period >= PLAIN_PERIODS && solve_period(dP, gap, step) && norm(step[0], step[1]) <= 4.0 * size) {
                s[0] += step[0], s[1] += step[1];
                ++work->n_newton;
                admit(work, mu, s);
                continue;
            }
        }
        s[0] = best[0], s[1] = best[1];
        gap_best = INFINITY;
    }
    return 0;
}

/* ---- force and tangent over the settled period ---- */

static void end_stretch(bd_coulomb_work *work) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = 3 * n_coef + 2;
    for (size_t d = 0; d < 2; ++d)
        for (size_t i = 0; i < n_coef; ++i) {
            double *restrict to = work->held + (d * n_coef + i) * n_col;
            const double *restrict from = work->slider + d * n_col, g = work->stretch[i];
            for (size_t j = 0; j < n_col; ++j) to[j] += g * from[j];
        }
    memset(work->stretch, 0, sizeof(double) * n_coef);
}

/* Derivative of the slider through one step that moved it. */
static void advance(bd_coulomb_work *work, const bd_element *element, const bd_step *o, int k0, int k1) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = 3 * n_coef + 2;
    const double *b0 = basis_at(work, k0), *b1 = basis_at(work, k1);
    const double kn = bd_law_is_constant(element->law) ? 0.0 : element->kn;
    for (size_t d = 0; d < 2; ++d) {
        double *restrict to = work->next + d * n_col;
        const double *restrict s0 = work->slider, *restrict s1 = work->slider + n_col;
        for (size_t j = 0; j < n_col; ++j) to[j] = o->A[d][0] * s0[j] + o->A[d][1] * s1[j];
        for (size_t c = 0; c < 2; ++c) {
            const double kt = element->kt[c], f0 = kt * o->B0[d][c], f1 = kt * o->B1[d][c];
            for (size_t j = 0; j < n_coef; ++j) to[c * n_coef + j] += f0 * b0[j] + f1 * b1[j];
        }
        const double f0 = kn * o->C0[d], f1 = kn * o->C1[d];
        for (size_t j = 0; j < n_coef && kn > 0.0; ++j) to[2 * n_coef + j] += f0 * b0[j] + f1 * b1[j];
    }
    double *swap = work->slider;
    work->slider = work->next;
    work->next = swap;
}

static void push_sample(bd_coulomb_work *work, int k, int state) {
    const double h = BD_TWO_PI / work->n_time;
    if (work->n_segment > 0 && work->segment[work->n_segment - 1].state == state)
        work->segment[work->n_segment - 1].end = (k + 1) * h;
    else
        work->segment[work->n_segment++] = (bd_segment){k * h, (k + 1) * h, state};
}

/* Before the period: the derivative of the slider with respect to itself, or, in open contact, that of p. */
static void start_slider(bd_coulomb_work *work, const bd_element *element) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = 3 * n_coef + 2;
    const int last = work->n_time - 1, open = !(work->g[last] > 0.0);
    memset(work->slider, 0, sizeof(double) * 2 * n_col);
    for (size_t d = 0; d < 2; ++d) {
        if (!open) work->slider[d * n_col + 3 * n_coef + d] = 1.0;
        for (size_t j = 0; open && j < n_coef; ++j)
            work->slider[d * n_col + d * n_coef + j] = element->kt[d] * basis_at(work, last)[j];
    }
}

/* Sums of force, and of the slider's derivative if tangent is asked for. */
static void sum_period(bd_coulomb_work *work, const bd_element *element, double *s, int tangent, bd_response *out,
                       bd_status_share *share) {
    const int n_coef = bd_n_coef(work->n_harm), n_power = bd_n_power(work->n_harm), n_time = work->n_time;
    const double weight = BD_TWO_PI / n_time;
    double *F[2] = {out->F, out->F + n_coef};
    int n_open = 0, n_stick = 0;
    bd_step o;
    memset(out->F, 0, sizeof(double) * 2 * (size_t)n_coef);
    memset(work->contact, 0, sizeof(double) * (size_t)n_power);
    work->n_segment = 0;
    if (tangent) {
        memset(work->held, 0, sizeof(double) * 2 * (size_t)(n_coef * (3 * n_coef + 2)));
        memset(work->stretch, 0, sizeof(double) * (size_t)n_coef);
        start_slider(work, element);
    }
    for (int k = 0; k < n_time; ++k) {
        take_step(work, element->mu, before(work, k), k, s, &o);
        s[0] = o.s[0], s[1] = o.s[1];
        if (tangent && o.kind != STEP_STICK) {
            end_stretch(work);
            advance(work, element, &o, before(work, k), k);
        }
        push_sample(work, k, o.kind == STEP_OPEN ? BD_OPEN : o.kind == STEP_SLIP ? BD_SLIP_PLUS : BD_STICK);
        n_stick += o.kind == STEP_STICK || o.kind == STEP_CLOSE;
        if (o.kind == STEP_OPEN) {
            ++n_open;
            continue;
        }
        const double *b = basis_at(work, k), *power = b - 1;
        for (int d = 0; d < 2; ++d)
            for (int i = 0; i < n_coef; ++i) F[d][i] += weight * (work->p[2 * k + d] - s[d]) * b[i];
        for (int i = 0; i < n_power; ++i) work->contact[i] += weight * power[i];
        for (int i = 0; tangent && i < n_coef; ++i) work->stretch[i] += weight * b[i];
    }
    if (tangent) end_stretch(work);
    for (int d = 0; d < 2; ++d) {
        for (int i = 0; i < n_coef; ++i) F[d][i] *= i == 0 ? 1.0 / BD_TWO_PI : 1.0 / BD_PI;
        share->stick[d] = (double)n_stick / n_time;
        share->slip[d] = (double)(n_time - n_stick - n_open) / n_time;
    }
}

/* Blocks of the tangent from the sums; ds0 (2, 3 n_coef) is the derivative of the settled slider. */
static void write_tangent(bd_coulomb_work *work, const bd_element *element, bd_response *out) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_x = 3 * n_coef, n_col = n_x + 2;
    double *ds0 = work->next;
    const double dP[2][2] = {{work->slider[n_x], work->slider[n_x + 1]},
                             {work->slider[n_col + n_x], work->slider[n_col + n_x + 1]}};
    for (size_t j = 0; j < n_x; ++j) {
        const double b[2] = {work->slider[j], work->slider[n_col + j]};
        double y[2];
        const int solved = solve_period(dP, b, y);
        ds0[j] = solved ? y[0] : 0.0;
        ds0[n_x + j] = solved ? y[1] : 0.0;
    }
    bd_cycle_products(work->n_harm, work->contact, work->products);
    for (size_t d = 0; d < 2; ++d)
        for (size_t i = 0; i < n_coef; ++i) {
            const double *held = work->held + (d * n_coef + i) * n_col, scale = i == 0 ? 1.0 / BD_TWO_PI : 1.0 / BD_PI;
            const double h0 = held[n_x], h1 = held[n_x + 1];
            for (size_t c = 0; c < 3; ++c) {
                double *row = (c == 2 ? out->dTv[d] : c == d ? out->dT[d] : out->dTc[d]) + i * n_coef;
                for (size_t j = 0; j < n_coef; ++j) {
                    const size_t at = c * n_coef + j;
                    double value = -held[at] - h0 * ds0[at] - h1 * ds0[n_x + at];
                    if (c == d) value += element->kt[d] * work->products[i * n_coef + j];
                    row[j] = scale * value;
                }
            }
        }
}

/* A slider at rest at the edge of what is admissible: T = p - s, s depends on the motion through the mean row only. */
static void write_rest(bd_coulomb_work *work, const bd_element *element, bd_response *out) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = 3 * n_coef + 2;
    for (size_t d = 0; d < 2; ++d)
        for (size_t c = 0; c < 3; ++c) {
            double *block = c == 2 ? out->dTv[d] : c == d ? out->dT[d] : out->dTc[d];
            memset(block, 0, sizeof(double) * n_coef * n_coef);
            for (size_t i = 0; c == d && i < n_coef; ++i) block[i * n_coef + i] = element->kt[d];
            for (size_t j = 0; j < n_coef; ++j) block[j] -= work->slider[d * n_col + c * n_coef + j];
        }
    out->tangential[0] = out->tangential[1] = BD_BLOCK_FULL;
    out->coupled = 1;
    out->with_normal[0] = out->with_normal[1] = 1;
}

/* The force of a slider at rest. */
static void rest(bd_coulomb_work *work, const bd_element *element, const double *x, const double *given, const bd_rest *set,
                 bd_response *out, bd_status_share *share) {
    bd_element held = *element;
    for (int d = 0; d < 2; ++d) {
        held.w[d] = element->kt[d] > 0.0 ? set->s[d] / element->kt[d] : 0.0;
        bd_element_stuck(&held, work->n_harm, d, x + d * bd_n_coef(work->n_harm), out);
        share->stick[d] = 1.0;
    }
    work->segment[0] = (bd_segment){0.0, BD_TWO_PI, BD_STICK};
    work->n_segment = 1;
    if (set->n == 0 || !out->dN) return;
    derivative_of_rest(work, element, given, set);
    write_rest(work, element, out);
}

static double sample_motion(bd_coulomb_work *work, const bd_element *element, const double *x) {
    const int n_coef = bd_n_coef(work->n_harm), constant = bd_law_is_constant(element->law);
    double size = 0.0;
    for (int k = 0; k < work->n_time; ++k) {
        const double *b = basis_at(work, k);
        double u[3] = {0.0, 0.0, 0.0};
        for (int a = 0; a < 3; ++a)
            for (int i = 0; i < n_coef; ++i) u[a] += b[i] * x[a * n_coef + i];
        work->p[2 * k] = element->kt[0] * u[0];
        work->p[2 * k + 1] = element->kt[1] * u[1];
        work->g[k] = constant ? element->load : element->n0 + element->kn * u[2];
        size = fmax(size, fmax(fabs(work->p[2 * k]) + fabs(work->p[2 * k + 1]), element->mu * work->g[k]));
    }
    return size;
}

void bd_coulomb_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                         bd_coulomb_work *work) {
    const int n_coef = bd_n_coef(work->n_harm);
    work->n_segment = work->n_period = 0;
    if (!bd_element_rubs(element, 0) && !bd_element_rubs(element, 1)) return;
    const double size = sample_motion(work, element, x);
    int open = 1;
    for (int k = 0; k < work->n_time; ++k) open &= !(work->g[k] > 0.0);
    if (open) {
        work->segment[0] = (bd_segment){0.0, BD_TWO_PI, BD_OPEN};
        work->n_segment = 1;
        return;
    }
    const double given[2] = {element->kt[0] * element->w[0], element->kt[1] * element->w[1]};
    const double scale = size + norm(given[0], given[1]) + 1e-300;
    bd_rest set;
    if (find_rest(work, element->mu, given, scale, &set)) {
        rest(work, element, x, given, &set, out, share);
        return;
    }
    double s[2] = {given[0], given[1]};
    if (!settle(work, element->mu, scale, s)) {
        for (int i = 0; i < 2 * n_coef; ++i) out->F[i] = NAN;
        out->tangential[0] = out->tangential[1] = BD_BLOCK_LINEAR;
        return;
    }
    sum_period(work, element, s, out->dN != NULL, out, share);
    out->tangential[0] = out->tangential[1] = BD_BLOCK_FULL;
    out->coupled = 1;
    out->with_normal[0] = out->with_normal[1] = !bd_law_is_constant(element->law);
    if (out->dN) write_tangent(work, element, out);
}
