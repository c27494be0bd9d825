/* Event-exact evaluation of the separable law: coefficients in, coefficients and exact Jacobian out. */
#ifndef BD_EVENT_H
#define BD_EVENT_H

#include "bd_element.h"
#include "bd_trig.h"

typedef struct {
    int n_harm;
    bd_trig_grid grid;      /* bracketing grid of the root finder */
    double *value, *slope;  /* (n_time) samples handed to the root finder */
    double *dv, *ddv;       /* (n_time) v', v'' */
    double *du, *ddu;       /* (n_time) u', u'' */
    double *poly;           /* (6, n_coef) work polynomials */
    double *theta;          /* (6 n_harm) instants of events */
    double *power;          /* (6 n_harm, n_power) powers of exp(i theta) there */
    double *lo, *hi;        /* (6 n_harm) bounds of the slider there */
    int *order;             /* (6 n_harm) events in ascending order */
    int *piece;             /* (6 n_harm) flags of the piece that follows each of them */
    double *onset_power;    /* (n_power) at the onset of slip inside a piece */
    double *contact;        /* (n_power) sums over the parts in contact */
    double *part;           /* (n_power) sums over the present stretch of sticking */
    double *scratch;        /* (n_coef, n_coef) */
    double *origin_u, *origin_v; /* (n_coef) derivative of the slider position */
    bd_cycle cycle;
    double *held_u, *held_v; /* storage that cycle points to when a tangent is asked for */
    bd_segment *segment[2];  /* (18 n_harm + 2) parts of the cycle, for each direction */
    int n_segment[2];
    double *memory;          /* all of the above */
} bd_event_work;

bd_status bd_event_create(bd_event_work *work, int n_harm);
void bd_event_destroy(bd_event_work *work);

/* x is (3, n_coef): u1, u2, v.  The tangent blocks of out may be NULL (all or none).  share may be NULL.
 * work->segment holds the parts of the cycle afterwards. */
void bd_event_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                       bd_event_work *work);

#endif
