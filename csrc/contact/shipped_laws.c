/* Contact laws that bdamper ships as user laws, and copies of the users' laws.
 *
 * Jenkins elements. Along each tangential direction, n springs k with sliders s in series act in
 * parallel,
 *
 *     s1 = clip(s0, u - r, u + r),   r = (f + mu N)/k,   T = sum k (u - s1),   N = kn max(v, 0).
 *
 * Elements with limits f spread over a range form the model of Iwan (1966). If kn is not zero and v
 * is not positive, the surfaces are apart and the sliders follow u. A contact that closes between
 * two instants starts at the displacement of zero v, u0 + t (u - u0) with t = -v0/(v - v0), as in
 * aft.c.
 *
 * Bouc (1967) and Wen (1976). The state z of each tangential direction obeys
 *
 *     dz = du - beta |du| |z|^(n-1) z - gamma du |z|^n,
 *     T = alpha k u + (1 - alpha) k z,   N = kn max(v, 0).
 *
 * A step of u is divided into STEPS equal parts h of the trapezoidal rule, y - h f(y)/2 = z + h
 * f(z)/2. Here f = dz/du depends on the sign of the step. For |gamma| <= beta the left side has a
 * slope of at least 1, so Newton's method finds the unique solution. */
#include "contact/user_law.h"

#include <math.h>
#include <stdlib.h>

enum { STEPS = 4, MOST_ITERATIONS = 60 };

/* Columns of sx (n_state, 6), the derivative of a state after the step: motion (u1, u2, v) after
 * it, then before it. Fx (3, 3) has rows T1, T2, N. */
enum { AFTER = 0, BEFORE = 3, N_STEP_MOTION = 6 };

/* Place of the derivative of force component a with respect to motion component c in Fx. */
static size_t entry(size_t a, size_t c) { return BD_N_COMPONENT * a + c; }

/* Normal force N = kn max(v, 0) without friction force, and dN/dv unless Fx is NULL. */
static void normal_spring(double kn, const double *x, double *F, double *Fx) {
    const double v = x[BD_NORMAL];
    F[0] = F[1] = 0.0;
    F[BD_NORMAL] = v > 0.0 ? kn * v : 0.0;
    if (Fx) Fx[entry(BD_NORMAL, BD_NORMAL)] = v > 0.0 ? kn : 0.0;
}

/* Jenkins elements in parallel, in each tangential direction n springs k_i with sliders s_i and
 * limits r_i = (f_i + mu_i N)/k_i, the parameters p = (n, kn, then k, f, mu of each element):
 *
 *     s1 = clip(s0, u - r, u + r),   T = sum k (u - s1),   N = kn max(v, 0).
 *
 * An open contact (kn > 0, v <= 0) has s1 = u. A contact that closes at the part t = -v0/(v - v0)
 * of the step begins with s0 = u0 + t (u - u0). The states are (2, n) sliders.
 *
 * The derivatives are written unless Fx is NULL; they are zero on entry. The derivatives of the
 * force are partial: Fx = dF/dx at a fixed new slider s1, Fs = dF/ds1 at a fixed motion. Each
 * element adds k to Fx and has Fs = -k. The motion of s1 is in sx and ss; the caller adds Fs sx to
 * Fx. */
void bd_law_jenkins(const double x[3], const double before[3], const double *p, const double *s0,
                    double *s1, double F[3], double Fx[9], double *Fs, double *sx, double *ss,
                    void *data) {
    (void)data;
    const size_t n = (size_t)p[0], n_state = 2 * n;
    const double kn = p[1], *elements = p + 2;
    const double v = x[BD_NORMAL], v_before = before[BD_NORMAL];
    const int separates = kn > 0.0;
    const int open = separates && !(v > 0.0);
    const double gain = v - v_before;
    const int closes = separates && v > 0.0 && !(v_before > 0.0) && gain > 0.0;
    const double t = closes ? -v_before / gain : 0.0;

    normal_spring(kn, x, F, Fx);
    for (size_t d = 0; d < 2; ++d)
        for (size_t i = 0; i < n; ++i) {
            const size_t at = d * n + i;
            const double k = elements[3 * i], f = elements[3 * i + 1], mu = elements[3 * i + 2];
            const double reach = (f + mu * F[BD_NORMAL]) / k;
            const double start = closes ? before[d] + t * (x[d] - before[d]) : s0[at];

            /* side of the range on which the slider ends; 0 within the range */
            int side = 0;
            if (start > x[d] + reach) side = 1;
            if (start < x[d] - reach) side = -1;
            if (open)
                s1[at] = x[d];
            else
                s1[at] = side ? x[d] + side * reach : start;
            F[d] += k * (x[d] - s1[at]);
            if (!Fx) continue;

            double *ds1 = sx + N_STEP_MOTION * at;
            if (open) {
                /* the slider follows the surface: k and -k would cancel in Fx + Fs sx */
                ds1[AFTER + d] = 1.0;
                continue;
            }
            Fx[entry(d, d)] += k;
            Fs[d * n_state + at] = -k;
            if (side) {
                ds1[AFTER + d] = 1.0;
                ds1[AFTER + BD_NORMAL] = side * mu * kn / k;
            } else if (closes) {
                /* dt = (v0 dv - v dv0)/(v - v0)^2 */
                const double by_t = (x[d] - before[d]) / (gain * gain);
                ds1[AFTER + d] = t;
                ds1[AFTER + BD_NORMAL] = by_t * v_before;
                ds1[BEFORE + d] = 1.0 - t;
                ds1[BEFORE + BD_NORMAL] = -by_t * v;
            } else {
                ss[at * n_state + at] = 1.0;
            }
        }
}

typedef struct {
    double beta, gamma, n;
} bouc_wen;

/* f = dz/du = 1 - c |z|^n of the state z for steps of the sign `sense`, c = gamma + beta if
 * sense z >= 0, otherwise gamma - beta; by_z = df/dz. */
static double rate(const bouc_wen *law, double sense, double z, double *by_z) {
    const double size = fabs(z);
    const double power = law->n == 1.0 ? 1.0 : pow(size, law->n - 1.0);
    const double c = law->gamma + (sense * z < 0.0 ? -law->beta : law->beta);
    *by_z = z < 0.0 ? law->n * power * c : -law->n * power * c;
    return 1.0 - c * power * size;
}

/* State z after a step du of the displacement, and its derivatives with respect to du and to z
 * before the step. The step has STEPS equal parts h of the trapezoidal rule for dz/du = f(z),
 * whose equation y - h/2 f(y) = z + h/2 f(z) for the state y after a part is solved by Newton's
 * method. */
static double evolve(const bouc_wen *law, double du, double z, double *by_u, double *by_z) {
    *by_u = 0.0;
    *by_z = 1.0;
    if (du == 0.0) {
        /* an elastic step in either direction; the one-sided derivatives differ unless z is 0 */
        *by_u = 1.0;
        return z;
    }

    const double h = du / STEPS;
    for (int i = 0; i < STEPS; ++i) {
        double slope, slope_y, y = z;
        const double f = rate(law, du, z, &slope);
        const double target = z + 0.5 * h * f;
        double f_y = rate(law, du, y, &slope_y);
        for (int j = 0; j < MOST_ITERATIONS; ++j) {
            const double change = (y - 0.5 * h * f_y - target) / (1.0 - 0.5 * h * slope_y);
            y -= change;
            f_y = rate(law, du, y, &slope_y);
            if (fabs(change) <= 1e-15 * fabs(y)) break;
        }

        const double below = 1.0 - 0.5 * h * slope_y;
        const double by_z_before = (1.0 + 0.5 * h * slope) / below;
        *by_u = by_z_before * *by_u + 0.5 * (f + f_y) / below / STEPS;
        *by_z *= by_z_before;
        z = y;
    }
    return z;
}

/* Law of Bouc and Wen with the parameters p = (kn, k, alpha, beta, gamma, n) and a state z in each
 * tangential direction: T = alpha k u + (1 - alpha) k z, N = kn max(v, 0). The derivatives of
 * forces and states are written unless Fx is NULL; they are zero on entry. */
void bd_law_bouc_wen(const double x[3], const double before[3], const double *p, const double *s0,
                     double *s1, double F[3], double Fx[9], double *Fs, double *sx, double *ss,
                     void *data) {
    (void)data;
    enum { N_STATE = 2 };
    const double kn = p[0], k = p[1], alpha = p[2];
    const bouc_wen law = {.beta = p[3], .gamma = p[4], .n = p[5]};
    normal_spring(kn, x, F, Fx);
    for (size_t d = 0; d < 2; ++d) {
        double by_u, by_z;
        s1[d] = evolve(&law, x[d] - before[d], s0[d], &by_u, &by_z);
        F[d] = alpha * k * x[d] + (1.0 - alpha) * k * s1[d];
        if (!Fx) continue;
        double *dz = sx + N_STEP_MOTION * d;
        Fx[entry(d, d)] = alpha * k;
        Fs[N_STATE * d + d] = (1.0 - alpha) * k;
        dz[AFTER + d] = by_u;
        dz[BEFORE + d] = -by_u;
        ss[N_STATE * d + d] = by_z;
    }
}

/* ---- laws of points ---- */

/* Return whether the parameters (n, kn, then k, f, mu of n elements) and the 2 n states of a law of
 * Jenkins elements have the right counts and ranges. */
static int jenkins_fits(const bd_point_law *point_law) {
    const double *p = point_law->parameter;
    if (point_law->n_parameter < 2) return 0;
    const double n = p[0], kn = p[1];
    if (point_law->n_state != 2.0 * n || point_law->n_parameter != 2.0 + 3.0 * n) return 0;
    if (!(kn >= 0.0)) return 0;
    for (int i = 2; i < point_law->n_parameter; i += 3) {
        const double k = p[i], f = p[i + 1], mu = p[i + 2];
        if (!(k > 0.0 && f >= 0.0 && mu >= 0.0)) return 0;
    }
    return 1;
}

/* Return whether the parameters (kn, k, alpha, beta, gamma, n) and the two states of a law of Bouc
 * and Wen have the right counts and ranges. */
static int bouc_wen_fits(const bd_point_law *point_law) {
    if (point_law->n_parameter != 6 || point_law->n_state != 2) return 0;
    const double *p = point_law->parameter;
    const double kn = p[0], k = p[1], alpha = p[2], beta = p[3], gamma = p[4], n = p[5];
    const int is_stiffness = kn >= 0.0 && k > 0.0 && alpha >= 0.0 && alpha <= 1.0;
    return is_stiffness && fabs(gamma) <= beta && n >= 1.0;
}

const char *bd_law_parameter_error(const bd_point_law *point_law) {
    if (point_law->function == bd_law_jenkins && !jenkins_fits(point_law))
        return "jenkins: expected the parameters n, kn >= 0, then k > 0, f >= 0, mu >= 0 of n "
               "elements, and 2 n states";
    if (point_law->function == bd_law_bouc_wen && !bouc_wen_fits(point_law))
        return "bouc_wen: expected the parameters kn >= 0, k > 0, alpha from 0 to 1, beta >= 0, "
               "gamma from -beta to beta, "
               "n >= 1, and 2 states";
    return NULL;
}

bd_point_law *bd_point_laws_create(int n, const bd_point_law *from) {
    const size_t of_laws = sizeof(bd_point_law) * (size_t)n;
    size_t n_number = 0;
    for (int p = 0; p < n && from; ++p)
        if (from[p].function) n_number += (size_t)(from[p].n_parameter + 3 + from[p].n_state);
    /* one more byte: an allocation of 0 bytes may return NULL */
    bd_point_law *point_law = malloc(of_laws + sizeof(double) * n_number + 1);
    if (!point_law) return NULL;

    /* the numbers of all laws follow the laws */
    memset(point_law, 0, of_laws);
    double *number = (double *)(void *)(point_law + n);
    for (int p = 0; p < n && from; ++p) {
        if (!from[p].function) continue;
        const size_t n_parameter = (size_t)from[p].n_parameter;
        const size_t n_memory = 3 + (size_t)from[p].n_state;
        point_law[p] = from[p];
        point_law[p].parameter = memcpy(number, from[p].parameter, sizeof(double) * n_parameter);
        number += n_parameter;
        point_law[p].memory = memcpy(number, from[p].memory, sizeof(double) * n_memory);
        number += n_memory;
    }
    return point_law;
}
