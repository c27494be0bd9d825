/* Cost of evaluations and solutions. */
#ifndef BD_UTIL_COST_H
#define BD_UTIL_COST_H

typedef struct {
    /* wall-clock seconds; the binding scales them to processor seconds */
    double contact, assembly, algebra;
    double processor; /* processor seconds, measured by the binding */
    long n_evaluation, n_jacobian, n_factorisation, n_least_norm;
    long n_condensed; /* factorisations of condensed matrices, which n_factorisation includes */
} bd_cost;

#endif
