/* Harmonic balance of all sectors of a mistuned bladed disk (wheel); see wheel_equations.c. */
#ifndef BD_BLADED_DISK_WHEEL_EQUATIONS_H
#define BD_BLADED_DISK_WHEEL_EQUATIONS_H

#include "contact/evaluator.h"
#include "solver/equations.h"
#include "bladed_disk/cyclic_elimination.h"

/* Input of bd_wheel_create; everything is copied. Wave matrices exist for the nodal diameters 0 ...
 * n_sector/2. They are complex, Hermitian and interleaved. */
typedef struct {
    int n_sector, n_harm;
    int n_blade, n_damper; /* coordinates of a sector: blade, then damper */
    /* root coordinates: the last ones of a blade, coupled by the disk to all other blades; n_kept
     * of them are coupled to the neighbours in the elimination */
    int n_root, n_kept;
    int n_point;                  /* contact points of a sector */
    const unsigned char *on_next; /* (n_point) 1: the point lies on the next blade */
    /* (n_point, 3, n_blade + n_damper) motion (u1, u2, v) */
    const double *motion_rows;
    /* (n_coef) coefficients that are unknowns; cosine and sine together */
    const unsigned char *active;
    const unsigned char *pinned;              /* (n_sector) 1: no damper */
    const double *stiffness;                  /* (n_sector, n_blade, n_blade) */
    const double *mass;                       /* (n_blade, n_blade) */
    const double *disk_stiffness, *disk_mass; /* wave matrices (n_root, n_root) */
    const double *damping;                    /* wave matrices (n_blade, n_blade) */
    /* (n_damper), (n_sector, n_damper), (n_damper) */
    const double *damper_stiffness, *damper_mass, *damper_damping;
    /* (n_sector, n_damper) springs on the mean of dampers */
    const double *springs;
    /* (n_sector, n_damper) springs in the Jacobian only */
    const double *jacobian_springs;
    /* (n_sector, n_damper) position without spring force */
    const double *spring_origin;
    /* see bd_hbm_input; for n_sector n_point points */
    const double *kt, *kn, *mu, *n0, *w, *load, *shift;
    const int *law;
    const double *force, *row_scale; /* (n_unknown) */
    bd_evaluation evaluation;
    int n_time;
} bd_wheel_input;

/* Circulant matrices: real and imaginary part of each wave matrix, by columns. */
typedef struct {
    double *stiffness, *mass; /* (n_wave, 2, n_root, n_root) */
    double *damping;          /* (n_wave, 2, n_blade, n_blade) */
} bd_waves;

/* Internal vectors are (n_sector, n_coef, n_blade + n_damper); vectors of the equations are (active
 * coefficient, n_sector, ...). */
typedef struct {
    bd_equations base;
    bd_cost cost;
    bd_wheel_input input; /* input, with copies of its arrays */
    bd_ring ring;
    bd_evaluator evaluator;
    /* coefficients; waves; coordinates of a sector; entries of a vector */
    int n_coef, n_wave, sector_size, vector_size;
    bd_waves waves, remainder; /* remainder: part outside the elimination */
    /* part in the elimination: stiffness, mass, damping (n_blade, n_blade) of the sector */
    double *sector_part[3];
    double *neighbour_part[2]; /* (n_kept, n_kept) stiffness and mass to a neighbour */
    double *cosine, *sine;     /* (n_wave, n_sector), the sine negative */
    bd_element *element;       /* (n_sector n_point) */
    bd_status_share *share;
    unsigned char *form; /* (n_sector n_point) bd_block of the tangents */
    /* motion, force (n_coef) and tangents (7, n_coef, n_coef) of the points
     * in the latest evaluation */
    double *X, *F, *tangent;
    double *x; /* the current point */
    /* vector with the blades of the next sectors; motion or force of one group of points */
    double *shifted, *motion;
    double *blade_motion, *inertia; /* blade coordinates and their inertia */
    /* waves, products and rates (3, 2, n_wave, n_coef, n_blade), and work of one product (3, 2,
     * n_blade); or a matrix (n_blade, n_blade) */
    double *wave_work;
    double *matrices, *springs; /* matrices of the elimination; springs plus jacobian_springs */
    /* derivative with respect to omega, row of the border over scale, scale:
     * vectors and one number */
    double *C, *border, *scale;
    double *column, *b, *product, *work; /* P^-1 C or its transposed counterpart; work */
    double *krylov;
    double omega, border_pivot;
    int transposed; /* whether column and border_pivot belong to the transposed matrix */
    double *memory;
} bd_wheel;

bd_status bd_wheel_create(bd_wheel **wheel, const bd_wheel_input *input);

/* ---- parts, for bordered_solution.c ---- */

enum { BD_WHEEL_KRYLOV = 80 }; /* vectors of GMRES */

void bd_wheel_to_vector(const bd_wheel *w, const double *u, double *x);
void bd_wheel_to_unknowns(const bd_wheel *w, const double *x, double *u);

/* out (a vector) += circulant part times the blade coordinates (n_sector, n_coef,
 * n_blade). The derivative with respect to omega is added to `by`, unless NULL. Optionally
 * with the transposed matrix. */
void bd_wheel_add_waves(bd_wheel *w, const bd_waves *waves, double omega, int transposed,
                        const double *blade, double *out, double *by);

/* out = J x or J^T x, at the latest point evaluated with derivatives. */
void bd_wheel_multiply(bd_wheel *w, int transposed, const double *x, double *out);

bd_status bd_wheel_factor(bd_equations *equations, const bd_border *border);
bd_status bd_wheel_solve(bd_equations *equations, double tolerance, double *b);
bd_status bd_wheel_solve_transposed(bd_equations *equations, double *b);

#endif
