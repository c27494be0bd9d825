/* Sampled evaluation (alternating frequency/time) of the separable law. */
#ifndef BD_SAMPLED_H
#define BD_SAMPLED_H

#include "bd_element.h"
#include "bd_trig.h"

typedef struct {
    int n_harm, n_time;
    int interpolate;    /* 1: the instant of closing is interpolated between samples; 0: plain */
    bd_trig_grid grid;
    double *power;      /* (n_time, n_power) powers of exp(i theta_k) */
    double *u, *v;      /* (n_time) */
    double *contact;    /* (n_power) */
    double *part;       /* (n_power) */
    double *origin_u, *origin_v; /* (n_coef) */
    double *scratch;    /* (n_coef, n_coef) */
    bd_cycle cycle;
    double *held_u, *held_v;
    bd_segment *segment[2]; /* (n_time) */
    int n_segment[2];
    double *memory;
} bd_sampled_work;

bd_status bd_sampled_create(bd_sampled_work *work, int n_harm, int n_time, int interpolate);
void bd_sampled_destroy(bd_sampled_work *work);

/* As bd_event_evaluate. */
void bd_sampled_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                         bd_sampled_work *work);

#endif
