/* Status codes, sizes and the conventions of all files.
 *
 * Units are SI, angles radians, theta = omega t.
 *
 * A periodic signal is a trigonometric polynomial with n_harm harmonics. It is stored as n_coef = 2
 * n_harm + 1 numbers
 *
 *     [x0, c1, s1, c2, s2, ...],   x(theta) = x0 + sum_l c_l cos(l theta) + s_l sin(l theta).
 *
 * The complex amplitude of harmonic l is X_l = c_l - i s_l, hence x = x0 + Re sum_l X_l exp(i l
 * theta).
 *
 * The relative motion of a contact point is (u1, u2, v): two tangential components and the closing
 * v. The closing is positive if the surfaces approach. The contact forces (T1, T2, N) are conjugate
 * to these components. BD_NORMAL is the index of v and N, the tangential directions are 0 and 1. */
#ifndef BD_UTIL_CONVENTIONS_H
#define BD_UTIL_CONVENTIONS_H

#include <stddef.h>

#define BD_PI 3.14159265358979323846
#define BD_TWO_PI 6.28318530717958647692
#define BD_MAX_HARM 64 /* limit of the tables on the stack of the root finder */
#define BD_MAX_COEF (2 * BD_MAX_HARM + 1)

/* Components of the motion (u1, u2, v) and of the force (T1, T2, N) of a contact point. */
enum { BD_NORMAL = 2, BD_N_COMPONENT = 3 };

typedef enum {
    BD_OK = 0,
    BD_NOT_CONVERGED = 1, /* no convergence within the iterations, or no progress */
    BD_DIVERGED = 2,      /* the residual grew without bound */
    BD_SINGULAR = 3,      /* no Newton step exists */
    BD_NOT_FINITE = 4,    /* NaN or infinity in the evaluation */
    BD_BAD_ARGUMENT = 5,
    BD_NO_MEMORY = 6,
    BD_BAD_STATE = 7, /* wrong order of calls: the point has no factorisation */
    BD_TIME_SPENT = 8 /* the processor time is spent */
} bd_status;

static inline int bd_n_coef(int n_harm) { return 2 * n_harm + 1; }

#endif
