/* Harmonic balance of a whole wheel as equations: see bd_wheel.c. */
#ifndef BD_BLADED_DISK_WHEEL_EQUATIONS_H
#define BD_BLADED_DISK_WHEEL_EQUATIONS_H

#include "contact/evaluator.h"
#include "solver/equations.h"
#include "bladed_disk/cyclic_elimination.h"

/* Input of bd_wheel_create; everything is copied.  Matrices of waves are those of the nodal diameters 0 ... n_sector/2, complex
 * and Hermitian, interleaved. */
typedef struct {
    int n_sector, n_harm;
    int n_blade, n_damper; /* coordinates of a sector: those of its blade, then those of its damper */
    int n_root, n_kept;    /* the last of a blade, which the disk couples to all others; those of them whose coupling */
                           /* to next neighbours the elimination keeps */
    int n_point;           /* of a sector */
    const unsigned char *on_next;             /* (n_point) 1: the point lies on the next blade */
    const double *motion_rows;                /* (n_point, 3, n_blade + n_damper) motion (u1, u2, v) */
    const unsigned char *active;              /* (n_coef) coefficients that are unknowns; cosine and sine together */
    const unsigned char *pinned;              /* (n_sector) dampers that are missing */
    const double *stiffness;                  /* (n_sector, n_blade, n_blade) */
    const double *mass;                       /* (n_blade, n_blade) */
    const double *disk_stiffness, *disk_mass; /* waves of (n_root, n_root) */
    const double *damping;                    /* waves of (n_blade, n_blade) */
    const double *damper_stiffness, *damper_mass, *damper_damping; /* (n_damper), (n_sector, n_damper), (n_damper) */
    const double *springs;                                         /* (n_sector, n_damper) on the mean of dampers */
    const double *jacobian_springs;                                /* (n_sector, n_damper) the same in the Jacobian alone */
    const double *spring_origin;                                   /* (n_sector, n_damper) where springs are at rest */
    const double *kt, *kn, *mu, *n0, *w, *load, *shift;            /* as in bd_hbm_input, of n_sector n_point points */
    const int *law;
    const double *force, *row_scale; /* (n_unknown) */
    bd_evaluation evaluation;
    int n_time;
} bd_wheel_input;

/* Circulant matrices: of every wave the real and the imaginary part, column by column. */
typedef struct {
    double *stiffness, *mass; /* (n_wave, 2, n_root, n_root) */
    double *damping;          /* (n_wave, 2, n_blade, n_blade) */
} bd_waves;

/* Vectors within are (n_sector, n_coef, n_blade + n_damper), those of the equations (active coefficient, n_sector, ...). */
typedef struct {
    bd_equations base;
    bd_cost cost;
    bd_wheel_input input; /* with copies of its arrays */
    bd_ring ring;
    bd_evaluator evaluator;
    int n_coef, n_wave, sector_size, vector_size; /* waves; coordinates of a sector; numbers of a vector */
    bd_waves waves, remainder;                    /* far: without what the elimination keeps */
    double *sector_part[3],
        *neighbour_part[2]; /* what it keeps of stiffness, mass and damping: (n_blade, n_blade), (n_kept, n_kept) */
    double *cosine, *sine;  /* (n_wave, n_sector), the latter negative */
    bd_element *element;    /* (n_sector n_point) */
    bd_status_share *share;
    double *X, *F, *tangent;  /* of the latest evaluation: motion, force (n_coef), tangents (7, n_coef, n_coef) of points */
    double *x;                /* a point */
    double *shifted, *motion; /* of the sectors one further on; motion or force of one group of points */
    double *blade_motion, *inertia,
        *wave_work;             /* blades' coordinates, their inertia; waves (3, 2, n_wave, n_coef, n_blade) */
    double *matrices, *springs; /* of the ring; springs + neutral */
    double *C, *border, *scale; /* derivative by omega, row of the border over scale, scale: vectors and one number */
    double *column, *b, *product, *work; /* P^-1 C or its transposed counterpart; work */
    double *krylov;
    double omega, border_pivot;
    int transposed; /* of which matrix `column` and `pivot` are */
    double *memory;
} bd_wheel;

bd_status bd_wheel_create(bd_wheel **wheel, const bd_wheel_input *input);

/* ---- parts, for bd_wheel_linear ---- */

enum { BD_WHEEL_KRYLOV = 80 }; /* vectors of GMRES */

void bd_wheel_to_vector(const bd_wheel *w, const double *u, double *x);
void bd_wheel_to_unknowns(const bd_wheel *w, const double *x, double *u);

/* out (a vector) += circulant part times the blades' coordinates (n_sector, n_coef, n_blade), and its derivative by omega
 * added to `by`, if that is not NULL; of the transposed matrix where asked for. */
void bd_wheel_add_waves(bd_wheel *w, const bd_waves *waves, double omega, int transposed, const double *blade, double *out,
                        double *by);

/* out = J x, or J^T x, at the point whose derivatives were asked for last. */
void bd_wheel_multiply(bd_wheel *w, int transposed, const double *x, double *out);

bd_status bd_wheel_factor(bd_equations *equations, const bd_border *border);
bd_status bd_wheel_solve(bd_equations *equations, double tolerance, double *b);
bd_status bd_wheel_solve_transposed(bd_equations *equations, double *b);

#endif
