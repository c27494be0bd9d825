/* Elimination of a wheel whose sectors meet next neighbours alone: see bd_wheel_ring.c. */
#ifndef BD_BLADED_DISK_CYCLIC_ELIMINATION_H
#define BD_BLADED_DISK_CYCLIC_ELIMINATION_H

#include "util/kernels.h"
#include "util/conventions.h"

/* Sizes and rows of motion; the arrays stay with the caller. */
typedef struct {
    int n_sector, n_coef;
    int n_blade, n_damper; /* coordinates of a sector */
    int n_kept;            /* the last of a blade, which the disk couples to neighbours here */
    int n_point;
    const unsigned char *on_next; /* (n_point) 1: the point lies on the next blade */
    const double *rows;           /* (n_point, 3, n_blade + n_damper) motion (u1, u2, v) */
    const unsigned char *active;  /* (n_coef) coefficients that are unknowns */
    const unsigned char *pinned;  /* (n_sector) dampers that are missing */
} bd_ring_input;

/* The matrix at one point; of harmonic l = 0 ... n_harm where it says so. */
typedef struct {
    const double *tangent;   /* (n_sector, n_point, 7, n_coef, n_coef) blocks as bd_element_write_blocks has them */
    const double *blade;     /* (n_sector, n_blade, n_blade) */
    const double *common;    /* (n_harm + 1, n_blade, n_blade) the same for all blades, added to the former */
    const double *damping;   /* (n_harm + 1, n_blade, n_blade) times the frequency of the harmonic */
    const double *damper;    /* (n_harm + 1, n_sector, 2, n_damper) stiffness less inertia, and damping times frequency */
    const double *springs;   /* (n_sector, n_damper) on the mean of dampers besides */
    const double *neighbour; /* (n_harm + 1, n_kept, n_kept) coupling to the sector before */
} bd_ring_matrix;

typedef struct {
    bd_ring_input input;
    int sector_size, n_inner, n_ring,
        n_damper_unknown; /* coordinates of a sector; unknowns eliminated in it, left of it, of a damper */
    int sign;             /* of the determinant of the matrix factored last */
    double *inverse, *inner_to_outer, *outer_to_inner; /* (n_sector) of (own, own), (own, seen), (seen, own) */
    double *diagonal, *lower, *upper, *last_row, *next_factor,
        *last_factor; /* (n_sector, n_ring, n_ring); inverses on the diagonal */
    double *own_side, *next_side, *Z, *columns, *outer, *product, *work; /* work */
    double *rows;            /* those of the points on the own blade, then of those on the next */
    double *rows_transposed; /* the same transposed, (size, 3 n) of either group */
    int n_group[2], *point;
    double *memory;
    int *pivot;
    const bd_kernel *kernel;
} bd_ring;

bd_status bd_ring_create(bd_ring *ring, const bd_ring_input *input);
void bd_ring_destroy(bd_ring *ring);

/* BD_SINGULAR where a block cannot be inverted. */
bd_status bd_ring_factor(bd_ring *ring, const bd_ring_matrix *matrix);

/* x of the right-hand side r, or with the transposed matrix; both (n_sector, n_coef, n_blade + n_damper). */
void bd_ring_solve(bd_ring *ring, int transposed, const double *r, double *x);

#endif
