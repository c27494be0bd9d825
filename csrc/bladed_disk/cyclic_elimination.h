/* Block elimination around a ring of sectors that are coupled to their neighbours only;
 * see cyclic_elimination.c. */
#ifndef BD_BLADED_DISK_CYCLIC_ELIMINATION_H
#define BD_BLADED_DISK_CYCLIC_ELIMINATION_H

#include "contact/element.h"
#include "util/kernels.h"
#include "util/conventions.h"

/* Sizes and rows of motion; the caller owns the arrays. */
typedef struct {
    int n_sector, n_coef;
    int n_blade, n_damper; /* coordinates of a sector */
    /* the last coordinates of a blade, coupled by the disk to the neighbours */
    int n_kept;
    int n_point;
    const unsigned char *on_next; /* (n_point) 1: the point lies on the next blade */
    const double *rows;           /* (n_point, 3, n_blade + n_damper) motion (u1, u2, v) */
    const unsigned char *active;  /* (n_coef) coefficients that are unknowns */
    const unsigned char *pinned;  /* (n_sector) 1: no damper */
} bd_ring_input;

/* Parts of the matrix of the linear equations; some depend on the harmonic l = 0 ... n_harm. */
typedef struct {
    /* (n_sector, n_point, 7, n_coef, n_coef) blocks in the order of bd_response */
    const double *tangent;
    /* (n_sector, n_point) bd_block: zero, full, or linear: multiples of the identity */
    const unsigned char *form;
    const double *blade; /* (n_sector, n_blade, n_blade) */
    /* (n_harm + 1, n_blade, n_blade) common to all blades, added to `blade` */
    const double *common;
    /* (n_harm + 1, n_blade, n_blade) damping matrix times the frequency of the harmonic */
    const double *damping;
    /* (n_harm + 1, n_sector, 2, n_damper) stiffness minus inertia, and damping times frequency */
    const double *damper;
    const double *springs;   /* (n_sector, n_damper) additional stiffness of the mean of dampers */
    const double *neighbour; /* (n_harm + 1, n_kept, n_kept) coupling to the previous sector */
} bd_ring_matrix;

typedef struct {
    bd_ring_input input;
    int sector_size, n_inner, n_ring,
        /* coordinates of a sector; unknowns eliminated in it, remaining in the ring, of a damper */
        n_damper_unknown;
    int sign; /* sign of the determinant of the latest factorisation */
    /* (n_sector) of (inner, inner), (inner, outer), (outer, inner) */
    double *inverse, *inner_to_outer, *outer_to_inner;
    /* (n_sector, n_ring, n_ring): D, L and U, with inverses on the
     * diagonal; V, D^-1 U and D^-1 W */
    double *diagonal, *lower, *upper;
    double *last_row, *next_factor, *last_factor;
    double *own_side, *next_side, *Z, *columns, *outer, *product, *work; /* work */
    /* rows of the points on the blade of the sector, then of the points on the next blade */
    double *rows;
    double *rows_transposed; /* the same transposed, (sector_size, 3 n) of either group */
    int n_group[2], *point;
    double *picked_rows; /* rows of the points of one group and form */
    int *picked;
    double *memory;
    int *pivot;
    const bd_kernel *kernel;
} bd_ring;

bd_status bd_ring_create(bd_ring *ring, const bd_ring_input *input);
void bd_ring_destroy(bd_ring *ring);

/* Return BD_SINGULAR if a block cannot be inverted. */
bd_status bd_ring_factor(bd_ring *ring, const bd_ring_matrix *matrix);

/* Solve for the right-hand side r, optionally with the transposed matrix; r and x (n_sector,
 * n_coef, n_blade + n_damper). */
void bd_ring_solve(bd_ring *ring, int transposed, const double *r, double *x);

#endif
