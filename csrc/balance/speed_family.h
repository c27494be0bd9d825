/* Harmonic balance equations as a function of rotor speed, along an engine order line. */
#ifndef BD_BALANCE_SPEED_FAMILY_H
#define BD_BALANCE_SPEED_FAMILY_H

#include "balance/harmonic_balance.h"

typedef struct {
    bd_variation variation;
    int n_node;
    double order;
    double *squared_speed, *weight; /* (n_node) squared speeds, weights of the polynomials */
    double *basis;                  /* (n_node) values or derivatives of the polynomials */
    double lowest, highest;         /* range of squared speeds for the polynomials */
    size_t n_value;
    double *node_values;  /* (n_node, n_value) all arrays at the nodes, one after another */
    double *interpolated; /* (n_value) arrays at one speed, or their derivatives */
    /* (n_unknown) derivative of the residual through the arrays that change with speed */
    double *speed_derivative;
    bd_hbm derivative; /* equations whose arrays are the derivatives with respect to omega */
} bd_family;

/* Turn equations, created from `input`, into a family. node (n_node) are equations of the
 * same sizes and laws; square (n_node) are their squared speeds, increasing or decreasing.
 * Everything is copied. bd_hbm_evaluate() then acts along the line, and bd_hbm_destroy()
 * also frees the family. */
bd_status bd_family_create(bd_hbm *hbm, const bd_hbm_input *input, int n_node,
                           const bd_hbm *const *node, const double *square, double order);

#endif
