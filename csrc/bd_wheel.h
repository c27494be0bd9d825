/* A wheel's Jacobian with the disk cut to next neighbours, eliminated: see bd_wheel.c. */
#ifndef BD_WHEEL_H
#define BD_WHEEL_H

#include "bd_lapack.h"
#include "bd_types.h"

typedef struct {
    int n_sector, n_harm;
    int n_blade, n_damper;       /* coordinates of a sector */
    int n_kept;                  /* the last of a blade, which the disk couples to neighbours here */
    int n_point[2];              /* points of a sector on its own blade, and on the next one */
    const double *rows[2];       /* (n_point, 3, n_blade + n_damper) motion (u1, u2, v); copied */
    const unsigned char *active; /* (n_coef) coefficients that are unknowns; copied */
    const unsigned char *pinned; /* (n_sector) dampers that are missing; copied */
} bd_wheel_input;

/* The matrix at one point. */
typedef struct {
    const double *tangent[2]; /* (n_sector, n_point, 7, n_coef, n_coef), blocks in the order of bd_core.evaluate_points */
    const double *blade;      /* (n_harm + 1, n_sector, n_blade, n_blade) stiffness less inertia */
    const double *damping;    /* (n_harm + 1, n_sector, n_blade, n_blade) times the frequency of the harmonic */
    const double *damper;     /* (n_harm + 1, n_sector, 2, n_damper) stiffness less inertia, and damping times frequency */
    const double *springs;    /* (n_sector, n_damper) on the mean of dampers besides */
    const double *neighbour;  /* (n_harm + 1, n_kept, n_kept) coupling to the sector before */
} bd_wheel_matrix;

typedef struct {
    int n_sector, n_coef, n_blade, n_damper, n_kept, n_point[2];
    int size, n_own, n_ring, n_side; /* coordinates of a sector; unknowns eliminated in it, left of it, of a damper */
    double *rows[2];
    unsigned char *active, *pinned;
    double *inverse, *back, *couple;                         /* (n_sector) of (own, own), (own, seen), (seen, own) */
    double *diagonal, *lower, *upper, *last, *onward, *fill; /* (n_sector, n_ring, n_ring); inverses on the diagonal */
    double *left, *right, *Z, *columns, *seen, *work;        /* work */
    int *pivot;
    long factorisations, factored; /* so many; the number of the matrix whose factors are there, 0 if there is none */
    bd_lapack lapack;
} bd_wheel;

bd_status bd_wheel_create(bd_wheel *wheel, const bd_wheel_input *input, const bd_lapack *lapack);
void bd_wheel_destroy(bd_wheel *wheel);

/* BD_SINGULAR where a block cannot be inverted; the factors that were there before are gone then, too. */
bd_status bd_wheel_factor(bd_wheel *wheel, const bd_wheel_matrix *matrix);

/* x of the right-hand side r, both (n_sector, n_coef, n_blade + n_damper), with the factors of that number; BD_BAD_STATE where
 * they are not there. */
bd_status bd_wheel_solve(bd_wheel *wheel, long factored, const double *r, double *x);

#endif
