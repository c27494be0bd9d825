/* Sampled evaluation (alternating frequency/time) of laws with two independent directions, several
 * points at a time. */
#ifndef BD_CONTACT_AFT_H
#define BD_CONTACT_AFT_H

#include "contact/element.h"
#include "util/kernels.h"
#include "util/trig_polynomial.h"

typedef struct {
    int n_harm, n_time;
    const bd_kernel *kernel;
    double *power; /* (n_time, n_power) powers of exp(i theta_k) */
    double *x;     /* (3, n_coef, BD_LANES) u1, u2, n0 + kn v */
    double *u, *g; /* (n_time, BD_LANES) */
    /* (n_time, BD_LANES) g, or the constant load of the constant-load laws */
    double *limit;
    double *contact;            /* (n_power, BD_LANES) */
    double *stick, *slip, *one; /* (n_power) of one lane */
    double *scratch;            /* (n_coef, n_coef) */
    bd_lanes lanes;
    double *stick_slider_u, *stick_slider_g;
    unsigned char *state;   /* (n_time, BD_LANES) */
    bd_segment *segment[2]; /* (n_time) of the latest point that was evaluated alone */
    int n_segment[2];
    double *memory;
} bd_sampled_work;

bd_status bd_sampled_create(bd_sampled_work *work, int n_harm, int n_time, int interpolate);
void bd_sampled_destroy(bd_sampled_work *work);

/* Like bd_event_evaluate, for n <= BD_LANES points: element (n), x (n, 3, n_coef), out (n), share
 * (n) or NULL. */
void bd_sampled_evaluate(int n, const bd_element *element, const double *x, bd_response *out,
                         bd_status_share *share, bd_sampled_work *work);

#endif
