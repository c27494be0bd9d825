/* Sticking sliders of coupled friction, and the workspace of the coupled evaluation. */
#ifndef BD_CONTACT_STICKING_SLIDER_H
#define BD_CONTACT_STICKING_SLIDER_H

#include "contact/friction_disks.h"
#include "contact/element.h"
#include "contact/aft.h"

#include <math.h>

/* Region of the steady slider: (x - c) . Q^-1 (x - c) <= 1. */
typedef struct {
    double c[2], Q[2][2];
} bd_ellipse;

/* Search for the steady slider of one point. */
typedef struct {
    enum { BD_DONE, BD_SEARCHING, BD_SETTLED, BD_LOST } state; /* BD_DONE: no search needed */
    double size;                                               /* size of the forces */
    bd_disk_point centre;
    double s[2];        /* latest guess */
    double last_length; /* length of the latest Newton step */
    /* consecutive Newton steps; the first ones may grow, since slip across the chord follows slip
     * along it */
    int n_newton;
    int n_period;
    bd_ellipse ellipse;
} bd_slider_search;

typedef struct {
    int n_harm, n_time, n_padded; /* n_padded: n_time rounded up to a multiple of 8 */
    const bd_kernel *kernel;
    const double *power; /* (n_time, n_power), owned by the sampled evaluation */
    bd_coupled_lanes lanes;
    bd_slider_search search[BD_LANES];
    double *motion;        /* (3, n_coef, BD_LANES) kt u and n0 + kn v */
    double *point_samples; /* (BD_LANES, 4, n_padded) x, y, R, g of each point */
    double *x, *y, *R, *g; /* rows of the current point */
    /* (2, 3 n_coef + 2) derivative of the slider with respect to u1, u2, v and the slider at the
     * start of the period */
    double *slider_derivative;
    double *next_slider; /* the same after a step */
    /* (2, n_coef, 3 n_coef + 2) sum of the basis times the derivative over samples in contact */
    double *slider_sums;
    double *stick_basis; /* (n_coef) sum of the basis since the slider was last set */
    double *products;    /* (n_coef, n_coef) */
    double *contact;     /* (n_power) */
    bd_segment *segment; /* (n_time) parts of the cycle of the point evaluated last; slip in
                          * either direction is stored as BD_SLIP_PLUS */
    int n_segment;
    int n_period; /* periods of the latest search */
    double *memory;
} bd_coulomb_work;

/* Forces have moderate size, so the slower hypot is unnecessary. */
static inline double bd_norm(double x, double y) { return sqrt(x * x + y * y); }

static inline const double *bd_coulomb_basis(const bd_coulomb_work *work, int k) {
    return work->power + (size_t)k * (size_t)bd_n_power(work->n_harm) + 1;
}

static inline int bd_coulomb_before(const bd_coulomb_work *work, int k) {
    return k > 0 ? k - 1 : work->n_time - 1;
}

/* Solve (I - dP) y = b; return 0 if the matrix is singular. */
static inline int bd_coulomb_solve_period(const double dP[2][2], const double *b, double *y) {
    const double m00 = 1.0 - dP[0][0], m11 = 1.0 - dP[1][1], m01 = -dP[0][1], m10 = -dP[1][0];
    const double det = m00 * m11 - m01 * m10;
    if (!(fabs(det) > 1e-14 * (fabs(m00 * m11) + fabs(m01 * m10)) + 1e-200)) return 0;
    y[0] = (m11 * b[0] - m01 * b[1]) / det;
    y[1] = (m00 * b[1] - m10 * b[0]) / det;
    return 1;
}

/* Force and shares of a slider that sticks at s (newtons), with the tangent of a fixed slider. */
void bd_sticking_write(bd_coulomb_work *work, const bd_element *element, const double *x,
                       const double *s, bd_response *out, bd_status_share *share);

/* Tangent of a slider that was shifted by a fraction of the line from its initial position to the
 * centre, into disk k. */
void bd_sticking_write_shifted(bd_coulomb_work *work, const bd_element *element,
                               const double *initial, const bd_disk_point *centre, double share,
                               int k, bd_response *out);

/* Tangent at the onset of slip, from the disks that determine the slider. */
void bd_sticking_write_onset(bd_coulomb_work *work, const bd_element *element,
                             const bd_disk_point *found, bd_response *out);

#endif
