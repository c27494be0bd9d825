/* Cost of evaluations and solutions. */
#ifndef BD_UTIL_COST_H
#define BD_UTIL_COST_H

typedef struct {
    double contact, assembly, algebra; /* wall-clock seconds; the binding scales them to processor seconds */
    double processor;                  /* processor seconds, measured by the binding */
    long n_evaluation, n_jacobian, n_factorisation, n_least_norm;
} bd_cost;

#endif
