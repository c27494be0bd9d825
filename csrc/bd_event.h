/* Event-exact evaluation of the separable law: coefficients in, coefficients and exact Jacobian out. */
#ifndef BD_EVENT_H
#define BD_EVENT_H

#include "bd_element.h"
#include "bd_kernel.h"
#include "bd_trig.h"

typedef struct {
    int n_harm;
    const bd_kernel *kernel;
    bd_trig_grid grid;     /* bracketing grid of the root finder */
    double *motion;        /* (3, n_time) u1, u2, v */
    double *dmotion;       /* (3, n_time) their derivatives */
    double *ddmotion;      /* (3, n_time) */
    double *value, *slope; /* (n_time) samples handed to the root finder */
    double *dx, *ddx;      /* (3, n_coef) coefficients of the derivatives */
    double *poly;          /* (5, n_coef) work polynomials */
    double *theta;         /* (6 n_harm) instants of events */
    double *z;             /* (6 n_harm, 2) exp(i theta) there */
    double *lo, *hi;       /* (6 n_harm) bounds of the slider there */
    int *order;            /* (6 n_harm) events in ascending order */
    int *piece;            /* (6 n_harm) flags of the piece that follows each of them */
    double *power[2];      /* (n_power) powers at the beginning and at the end of a part of the cycle */
    double *contact;       /* (n_power) sums over the parts in contact */
    double *part;          /* (n_power) sums over the present part */
    double *scratch;       /* (n_coef, n_coef) */
    double *origin_v;      /* (n_coef) derivative of the slider position */
    bd_cycle cycle;
    double *held_u, *held_v; /* storage that cycle points to when a tangent is asked for */
    bd_segment *segment[2];  /* (12 n_harm + 2) parts of the cycle, for each direction, ascending */
    int n_segment[2];
    int derivatives_known;
    double *memory; /* all of the above */
} bd_event_work;

bd_status bd_event_create(bd_event_work *work, int n_harm);
void bd_event_destroy(bd_event_work *work);

/* x is (3, n_coef): u1, u2, v.  The tangent blocks of out may be NULL (all or none).  share may be NULL.
 * work->segment holds the parts of the cycle afterwards. */
void bd_event_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                       bd_event_work *work);

#endif
