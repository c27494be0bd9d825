/* COSTHEAD */
#ifndef BD_UTIL_COST_H
#define BD_UTIL_COST_H

typedef struct {
    double contact, assembly, algebra; /* seconds of wall-clock time, which the caller scales to those of the processor */
    double processor;                  /* processor seconds, counted by the caller */
    long n_evaluation, n_jacobian, n_factorisation, n_least_norm;
} bd_cost;

#endif
