/* Sampled evaluation of contact laws that are brought along as functions, settled over the period. */
#ifndef BD_CONTACT_USER_LAW_AFT_H
#define BD_CONTACT_USER_LAW_AFT_H

#include "contact/aft.h"

typedef struct {
    int n_harm, n_time, n_state; /* n_state: the most that there is room for */
    const bd_kernel *kernel;
    bd_point_law_derivatives derivatives;
    const double *powers;            /* (n_time, n_power), owned by the sampled evaluator */
    double *basis;                   /* (n_time, n_coef) */
    double *motion_force_derivative; /* (9, n_time) derivative of the forces by the motion at the same instant */
    double *power_sum;               /* (n_power) */
    int has_motion_derivative[9], has_state_derivative[3]; /* whether any of them is not zero */
    double *motion, *force;                                /* (3, n_time) of each */
    double *states;                                        /* (n_time, n_state) of the latest period */
    double *law_memory[2];                                 /* (3 + n_state) before and after a step */
    double *start, *state_scale; /* (n_state) at the start of the period; the largest of the period */
    double *step;                /* (n_state) */
    double *state_derivative,
        *motion_derivative; /* (n_state, n_state + 3 n_coef) derivative of the state by that at the start of the period, and */
                            /* by the motion; the latter at the start of the period */
    double *next_derivative;        /* the same after a step */
    double *state_force_derivative; /* (n_time, 3, n_state + 3 n_coef) derivative of the forces that comes by the state */
    double *derivative_coef;        /* (n_coef, 3, n_state + 3 n_coef) of the rows times the basis */
    double *power, *square;         /* (n_state, n_state) */
    int n_period, n_call;           /* periods that the latest evaluation marched, and steps of the law */
    double *memory;
} bd_user_work;

/* For laws with up to n_state; the tables of the sampled evaluator are used, which must outlive this workspace. */
bd_status bd_user_create(bd_user_work *work, const bd_sampled_work *sampled, int n_state);
void bd_user_destroy(bd_user_work *work);

/* One point.  If a cycle did not settle its force is NaN. */
void bd_user_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                      bd_user_work *work);

#endif
