/* Sampled evaluation of user laws in their steady cycle. */
#ifndef BD_CONTACT_USER_LAW_AFT_H
#define BD_CONTACT_USER_LAW_AFT_H

#include "contact/aft.h"

typedef struct {
    int n_harm, n_time, n_state; /* n_state: the largest of all points */
    const bd_kernel *kernel;
    bd_point_law_derivatives derivatives;
    const double *powers; /* (n_time, n_power), owned by the sampled evaluation */
    double *basis;        /* (n_time, n_coef) */
    /* (9, n_time) derivative of the forces with respect to the motion at the same instant */
    double *motion_force_derivative;
    double *power_sum;                                     /* (n_power) */
    int has_motion_derivative[9], has_state_derivative[3]; /* whether an entry is nonzero */
    double *motion, *force;                                /* (3, n_time) each */
    /* (n_time, n_state) of the latest period */
    double *states;
    /* (3 + n_state) before and after a step */
    double *law_memory[2];
    /* (n_state) state at the start of the period; largest value in the period */
    double *start, *state_scale;
    double *step; /* (n_state) */
    /* (n_state, n_state + 3 n_coef) derivative of the state with respect to its value at
     * the start of the period and to the motion; motion_derivative holds the latter at
     * the start of the period */
    double *state_derivative;
    double *motion_derivative;
    double *next_derivative; /* the same after a step */
    /* (n_time, 3, n_state + 3 n_coef) derivative of the forces through the state */
    double *state_force_derivative;
    double *derivative_coef; /* (n_coef, 3, n_state + 3 n_coef) the rows times the basis */
    double *power, *square;  /* (n_state, n_state) */
    int n_period, n_call;    /* periods of the latest evaluation, and calls of the law */
    double *memory;
} bd_user_work;

/* For laws with up to n_state states. The workspace refers to tables of the sampled evaluation,
 * which must outlive it. */
bd_status bd_user_create(bd_user_work *work, const bd_sampled_work *sampled, int n_state);
void bd_user_destroy(bd_user_work *work);

/* Evaluate one point. The force is NaN if a cycle does not become steady. */
void bd_user_evaluate(const bd_element *element, const double *x, bd_response *out,
                      bd_status_share *share, bd_user_work *work);

#endif
