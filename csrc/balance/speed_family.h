/* A family of harmonic balance equations over rotor speed, along the line of an engine order. */
#ifndef BD_BALANCE_SPEED_FAMILY_H
#define BD_BALANCE_SPEED_FAMILY_H

#include "balance/harmonic_balance.h"

typedef struct {
    bd_variation variation;
    int n_node;
    double order;
    double *squared_speed, *weight,
        *basis;             /* (n_node) squared speeds, weights of the polynomials, their values or slopes */
    double lowest, highest; /* squared speeds between which the polynomials are used */
    size_t n_value;
    double *node_values;      /* (n_node, n_value) all arrays at the nodes, one after another */
    double *interpolated;     /* (n_value) those of one speed, or their derivatives */
    double *speed_derivative; /* (n_unknown) derivative of the residual by what changes with speed */
    bd_hbm derivative;        /* its arrays are the derivatives of those of the equations with respect to omega */
} bd_family;

/* Makes equations, created from the same input as `rate`, those of a family: node (n_node) are equations of the same sizes
 * and laws at the speeds of which square (n_node) are the squares, increasing or decreasing.  Everything is copied.
 * bd_hbm_evaluate() is then along the line, and bd_hbm_destroy() takes the family along. */
bd_status bd_family_create(bd_hbm *hbm, const bd_hbm_input *input, int n_node, const bd_hbm *const *node,
                           const double *square, double order);

#endif
