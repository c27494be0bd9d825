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

static void normal_spring(double kn, const double *x, double *F, double *Fx) {
    F[0] = F[1] = 0.0;
    F[2] = x[2] > 0.0 ? kn * x[2] : 0.0;
    if (Fx) Fx[8] = x[2] > 0.0 ? kn : 0.0;
}

void bd_law_jenkins(const double x[3], const double before[3], const double *p, const double *s0,
                    double *s1, double F[3], double Fx[9], double *Fs, double *sx, double *ss,
                    void *data) {
    (void)data;
    const size_t n = (size_t)p[0], n_state = 2 * n;
    const double kn = p[1];
    const int separates = kn > 0.0;
    const int open = separates && !(x[2] > 0.0);
    /* the contact closes at the part t of the step */
    const double gain = x[2] - before[2];
    const int closes = separates && x[2] > 0.0 && !(before[2] > 0.0) && gain > 0.0;
    const double t = closes ? -before[2] / gain : 0.0;

    normal_spring(kn, x, F, Fx);
    for (size_t d = 0; d < 2; ++d)
        for (size_t i = 0; i < n; ++i) {
            const size_t at = d * n + i;
            const double k = p[2 + 3 * i], f = p[3 + 3 * i], mu = p[4 + 3 * i];
            const double reach = (f + mu * F[2]) / k;
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

            double *by = sx + 6 * at;
            if (open) {
                by[d] = 1.0;
                continue;
            }
            Fx[4 * d] += k;
            Fs[d * n_state + at] = -k;
            if (side) {
                by[d] = 1.0;
                by[2] = side * mu * kn / k;
            } else if (closes) {
                const double by_t = (x[d] - before[d]) / (gain * gain);
                by[d] = t;
                by[2] = by_t * before[2];
                by[3 + d] = 1.0 - t;
                by[5] = -by_t * x[2];
            } else {
                ss[at * n_state + at] = 1.0;
            }
        }
}

typedef struct {
    double beta, gamma, n;
} bouc_wen;

/* f = dz/du for steps of the given sign, and its derivative. */
static double rate(const bouc_wen *law, double sense, double z, double *by_z) {
    const double size = fabs(z);
    const double power = law->n == 1.0 ? 1.0 : pow(size, law->n - 1.0);
    const double c = law->gamma + (sense * z < 0.0 ? -law->beta : law->beta);
    *by_z = z < 0.0 ? law->n * power * c : -law->n * power * c;
    return 1.0 - c * power * size;
}

/* z after a step du, and its derivatives with respect to du and to z before the step. */
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
        /* y - h/2 f(y) = z + h/2 f(z) by Newton's method */
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

void bd_law_bouc_wen(const double x[3], const double before[3], const double *p, const double *s0,
                     double *s1, double F[3], double Fx[9], double *Fs, double *sx, double *ss,
                     void *data) {
    (void)data;
    const double k = p[1], alpha = p[2];
    const bouc_wen law = {p[3], p[4], p[5]};
    normal_spring(p[0], x, F, Fx);
    for (size_t d = 0; d < 2; ++d) {
        double by_u, by_z;
        s1[d] = evolve(&law, x[d] - before[d], s0[d], &by_u, &by_z);
        F[d] = alpha * k * x[d] + (1.0 - alpha) * k * s1[d];
        if (!Fx) continue;
        Fx[4 * d] = alpha * k;
        Fs[2 * d + d] = (1.0 - alpha) * k;
        sx[6 * d + d] = by_u;
        sx[6 * d + 3 + d] = -by_u;
        ss[2 * d + d] = by_z;
    }
}

/* ---- laws of points ---- */

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
