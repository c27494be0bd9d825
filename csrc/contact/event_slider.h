/* Slider between the events of one cycle, and the workspace of the event-driven evaluation. */
#ifndef BD_CONTACT_EVENT_SLIDER_H
#define BD_CONTACT_EVENT_SLIDER_H

#include "contact/element.h"
#include "util/kernels.h"
#include "util/trig_polynomial.h"

typedef struct {
    int n_harm;
    const bd_kernel *kernel;
    bd_trig_grid grid;           /* bracketing grid of the root finder */
    double *motion;              /* (3, n_time) u1, u2, v */
    double *dmotion;             /* (3, n_time) first derivatives */
    double *ddmotion;            /* (3, n_time) second derivatives */
    double *value, *slope;       /* (n_time) samples for the root finder */
    double *dx, *ddx;            /* (3, n_coef) coefficients of the derivatives */
    double *polynomial;          /* (5, n_coef) work polynomials */
    double *event_theta;         /* (6 n_harm) angles of events */
    double *event_z;             /* (6 n_harm, 2) exp(i theta) at events */
    double *event_lo, *event_hi; /* (6 n_harm) bounds of the slider at events */
    int *order;                  /* (6 n_harm) events in ascending order */
    int *piece;                  /* (6 n_harm) flags of the piece after each event */
    /* (n_power) powers at the beginning and the end of a part of the cycle */
    double *power[2];
    double *contact;  /* (n_power) sums over the parts in contact */
    double *part_sum; /* (n_power) sums over the current part */
    double *scratch;  /* (n_coef, n_coef) */
    double *slider_v; /* (n_coef) derivative of the slider position with respect to v */
    bd_cycle cycle;
    double *stick_slider_u, *stick_slider_v; /* storage for the cycle's tangent */
    /* (12 n_harm + 2) parts of the cycle for each direction, ascending */
    bd_segment *segment[2];
    int n_segment[2];
    int derivatives_known;
    double *memory; /* memory of all arrays above */
} bd_event_work;

/* One direction of one point with its events. */
typedef struct {
    int n_harm, n_coef, n_power;
    int n_event;
    int n_lift;            /* events 0 .. n_lift-1 are lift-offs and closings */
    int n_lo;              /* then n_lo extrema of lo; the rest are extrema of hi */
    int common;            /* 1: lo and hi have the same extrema, listed once */
    double r;              /* mu kn/kt, 0 under a constant load */
    const double *lo, *hi; /* polynomials */
    const double *dlo, *dhi;
    bd_event_work *work;
} bd_direction;

/* Find the steady slider of direction d and add up its cycle (work->cycle, segments,
 * shares). Return 0 if no event sets the initial slider: it then stays at its position,
 * and nothing is added up. */
int bd_slider_cycle(bd_direction *dir, int d, const bd_element *element, const double *v,
                    bd_status_share *share);

/* The cycle of direction d consists of one part. */
void bd_slider_whole_cycle(bd_event_work *work, int d, int state);

/* Value of f between start and start + length, in which f does not cross zero. The value is taken
 * in the middle; if f is small there because it touches zero, at another of four positions. */
double bd_clear_value(int n_harm, const double *f, double start, double length);

#endif
