/* Sampled evaluation of in-plane coupled Coulomb friction, settled over the period. */
#ifndef BD_COULOMB_H
#define BD_COULOMB_H

#include "bd_disks.h"
#include "bd_element.h"
#include "bd_sampled.h"

typedef struct {
    int n_harm, n_time, interpolate;
    const double *power; /* (n_time, n_power), owned by the sampled evaluator */
    double *x, *y;       /* (n_time) kt u, N */
    double *R;           /* (n_time) mu times the normal load, N */
    double *g;           /* (n_time) n0 + kn v, or the constant load, N */
    double *slider;      /* (2, 3 n_coef + 2) derivative of the slider: u1, u2, v, slider at the start of the period */
    double *next;        /* the same after a step */
    double *held;        /* (2, n_coef, 3 n_coef + 2) sum of the basis times the derivative over samples in contact */
    double *stretch;     /* (n_coef) sum of the basis since the slider was last set */
    double *products;    /* (n_coef, n_coef) */
    double *contact;     /* (n_power) */
    bd_segment *segment; /* (n_time) parts of the cycle; state slip is BD_SLIP_PLUS */
    int n_segment;
    int n_period; /* periods that the latest evaluation marched to settle, and how many of them led to */
    int n_newton; /* a Newton step */
    double *memory;
} bd_coulomb_work;

/* The tables of the sampled evaluator are used, which must outlive this workspace. */
bd_status bd_coulomb_create(bd_coulomb_work *work, const bd_sampled_work *sampled);
void bd_coulomb_destroy(bd_coulomb_work *work);

/* Writes the tangential components; the normal direction is left as it is.  If the cycle does not settle the force is NaN. */
void bd_coulomb_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                         bd_coulomb_work *work);

#endif
