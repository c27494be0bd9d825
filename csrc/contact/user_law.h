/* Contact laws as C functions: their signature, one step of a law, and the laws of this form that
 * bdamper ships.
 *
 * A law advances from one instant to the next. Its state s follows from the motion x = (u1, u2, v),
 * the motion `before` and the state s0 at the previous instant. The forces (T1, T2, N) follow from
 * the motion and the new state:
 *
 *     s1 = g(x, before, s0),     F = f(x, s1).
 *
 * Thus the law depends on the path but not on rates. The closing v is zero when the surfaces touch.
 * A step without motion (x = before) must leave the state unchanged. Derivative arrays are zero on
 * entry, so a law writes its nonzero entries only. */
#ifndef BD_CONTACT_USER_LAW_H
#define BD_CONTACT_USER_LAW_H

#include "util/conventions.h"

#include <string.h>

/* Signature of a law. p: parameters. Fx = df/dx (3, 3), Fs = df/ds1 (3, n_state),
 * sx = dg/d(x, before) (n_state, 6), ss = dg/ds0 (n_state, n_state). Fx, Fs, sx and ss are NULL if
 * no derivatives are needed. */
typedef void (*bd_user_law)(const double x[3], const double before[3], const double *p,
                            const double *s0, double *s1, double F[3], double Fx[9], double *Fs,
                            double *sx, double *ss, void *data);

/* Law of one point. The memory of a point has 3 + n_state numbers: its latest motion (closing
 * relative to touching) and the state. All are zero before any load. */
typedef struct {
    bd_user_law function; /* NULL: the point has no law of this kind */
    void *data;
    int n_parameter, n_state;
    const double *parameter;
    const double *memory; /* memory at the start */
} bd_point_law;

typedef struct {
    double Fx[9], *Fs, *sx, *ss;
} bd_point_law_derivatives;

/* Compute the forces F (3) of a point at the motion x (3) and its new memory `to`;
 * optionally the derivatives. */
static inline void bd_point_law_step(const bd_point_law *point_law, const double *x,
                                     const double *from, double *to, double *F,
                                     bd_point_law_derivatives *derivatives) {
    const size_t n = (size_t)point_law->n_state;
    double *Fx = NULL, *Fs = NULL, *sx = NULL, *ss = NULL;
    if (derivatives) {
        Fx = derivatives->Fx;
        Fs = derivatives->Fs;
        sx = derivatives->sx;
        ss = derivatives->ss;
        /* a law writes its nonzero entries only */
        memset(Fx, 0, sizeof derivatives->Fx);
        memset(Fs, 0, sizeof(double) * 3 * n);
        memset(sx, 0, sizeof(double) * 6 * n);
        memset(ss, 0, sizeof(double) * n * n);
    }
    point_law->function(x, from, point_law->parameter, from + 3, to + 3, F, Fx, Fs, sx, ss,
                        point_law->data);
    for (int i = 0; i < 3; ++i) to[i] = x[i];
}

/* D (3, 3): derivative of the forces at the end of a step with respect to the motion there. */
static inline void bd_point_law_tangent(const bd_point_law *point_law,
                                        const bd_point_law_derivatives *derivatives, double *D) {
    const size_t n = (size_t)point_law->n_state;
    for (size_t i = 0; i < 3; ++i)
        for (size_t j = 0; j < 3; ++j) {
            double sum = derivatives->Fx[3 * i + j];
            for (size_t s = 0; s < n; ++s)
                sum += derivatives->Fs[i * n + s] * derivatives->sx[6 * s + j];
            D[3 * i + j] = sum;
        }
}

/* Size of the work array for the derivatives of a law with n_state states, and derivatives that
 * point into it. */
static inline size_t bd_point_law_work_size(int n_state) {
    return (size_t)n_state * (size_t)(n_state + 9) + 1;
}

static inline bd_point_law_derivatives bd_point_law_derivatives_in(double *work, int n_state) {
    const size_t n = (size_t)n_state;
    return (bd_point_law_derivatives){.Fs = work, .sx = work + 3 * n, .ss = work + 9 * n};
}

/* ---- shipped_laws.c ---- */

/* Copies of the laws of n points in one block of memory, which the caller frees;
 * NULL if out of memory. */
bd_point_law *bd_point_laws_create(int n, const bd_point_law *from);

/* Return NULL if a law has the counts that its function reads and writes, and valid parameters.
 * Otherwise return the name of the law with the expected counts and ranges. Laws that bdamper does
 * not ship always pass. */
const char *bd_law_parameter_error(const bd_point_law *point_law);

/* p = (n, kn, then k, f, mu of each of n elements). */
void bd_law_jenkins(const double x[3], const double before[3], const double *p, const double *s0,
                    double *s1, double F[3], double Fx[9], double *Fs, double *sx, double *ss,
                    void *data);

/* p = (kn, k, alpha, beta, gamma, n). */
void bd_law_bouc_wen(const double x[3], const double before[3], const double *p, const double *s0,
                     double *s1, double F[3], double Fx[9], double *Fs, double *sx, double *ss,
                     void *data);

#endif
