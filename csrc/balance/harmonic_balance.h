/* Harmonic balance in modal coordinates: residual and Jacobian over all contact points. */
#ifndef BD_BALANCE_HARMONIC_BALANCE_H
#define BD_BALANCE_HARMONIC_BALANCE_H

#include "contact/evaluator.h"
#include "util/cost.h"

/* Input of bd_hbm_create; everything is copied. */
typedef struct {
    int n_point, n_harm;
    const int *n_mode;       /* (n_harm + 1); zero excludes a harmonic */
    const double *stiffness; /* (sum n_mode) modal stiffness, Omega^2 for mass-normalised modes */
    const double *mass;      /* (sum n_mode) modal mass: 1, or 0 for a massless residual mode */
    const double *damping;   /* (sum n_mode) modal damping 2 zeta Omega */
    /* complex, harmonic after harmonic, each (n_point, 3, n_mode[l]), interleaved re, im */
    const double *G;
    const double *kt; /* (n_point, 2) */
    const double *kn; /* (n_point) */
    const double *mu; /* (n_point) */
    const double *n0; /* (n_point) */
    const double *w;  /* (n_point, 2) */
    const int *law;   /* (n_point) bd_law */
    /* (n_point) normal load in the friction limit of the constant-load laws; NULL: n0 */
    const double *load;
    /* (n_point, 3) constant part of (u1, u2, v) in addition to the modes */
    const double *shift;
    const double *force; /* (n_unknown) modal excitation, in the order of the unknowns */
    bd_evaluation evaluation;
    int n_time;
    const bd_point_law *point_law; /* (n_point) user laws, NULL if there are none */
} bd_hbm_input;

/* Dependence of the arrays on omega (speed_family.h); its functions replace
 * those of the equations. */
struct bd_hbm;
typedef struct bd_variation {
    bd_status (*evaluate)(struct bd_hbm *hbm, const double *u, double omega, double *r, double *J,
                          double *r_omega);
    void (*destroy)(struct bd_variation *variation);
} bd_variation;

/* The Jacobian J = D + U^T T U in parts, for few contact points. D is diagonal in the modes. U are
 * their rows for the components of motion that they move. T is the tangent of the contact forces in
 * the coefficients of these components. */
typedef struct {
    int n_component;
    int *component; /* (n_component) 3 point + direction */
    int *place;     /* (3 n_point) its place in this list, or -1 */
    /* (sum n_mode) K - (l omega)^2 M and l omega C */
    double *dynamic, *loss;
    double *tangent; /* (n_component n_coef)^2 row-major */
} bd_jacobian_parts;

/* Unknowns: the n_mode[0] coordinates of harmonic 0, then for each harmonic its cosines followed by
 * its sines. */
typedef struct bd_hbm {
    int n_point, n_harm, n_coef, n_unknown;
    int *n_mode;        /* (n_harm + 1) */
    int *first_unknown; /* (n_harm + 2) first unknown of each harmonic */
    double *stiffness, *mass, *damping;
    /* for each harmonic the real matrix Gr (n_point, 3, rows, columns) of harmonic_balance.c */
    double **G;
    bd_element *element;
    bd_point_law *point_law; /* (n_point) user laws */
    double *shift, *force;
    bd_evaluator evaluator;
    bd_status_share *share;     /* (n_point) of the latest evaluation */
    double *X;                  /* (n_point, 3, n_coef) relative motion of the latest evaluation */
    double *F;                  /* (n_point, 3, n_coef) contact force of the latest evaluation */
    double *harmonic_values;    /* (n_point, 3, 2) one harmonic of X or F */
    double *shifted_amplitudes; /* (2 max n_mode) modal amplitudes, a quarter of a period later */
    const bd_kernel *kernel;
    /* (n_harm + 1) of (3, columns, columns): modal stiffness of the springs of all points, for each
     * component of motion */
    double **spring_stiffness;
    double *tangent_blocks; /* (BD_LANES, 9, n_coef, n_coef) tangents of a group of points */
    /* Z, tangent times G: for each harmonic (rows of the chunk, padded n_unknown) */
    double *tangent_modes;
    /* rows of G for the rows of Z: for each harmonic (rows of the chunk, columns) */
    double *chunk_modes;
    /* largest number of components of contact points in one product of the assembly */
    int chunk;
    int n_chunk;                 /* current number of components */
    unsigned char *tangent_kind; /* (n_point, 3) bd_block of each component */
    bd_variation *variation;     /* NULL, or the speed family of these equations */
    /* NULL, or equations with the derivatives of element and X; an evaluation
     * then also fills their F */
    struct bd_hbm *derivative;
    /* NULL, or where an evaluation writes the parts of the Jacobian */
    bd_jacobian_parts *parts;
    bd_cost cost;
} bd_hbm;

bd_status bd_hbm_create(bd_hbm *hbm, const bd_hbm_input *input);
void bd_hbm_destroy(bd_hbm *hbm);

/* Compute r (n_unknown), J (n_unknown, n_unknown) row-major or NULL, and r_omega (n_unknown) or
 * NULL. Return BD_NOT_FINITE if a value is not finite. X, F and share of hbm then belong to this
 * point; they are NaN if u or omega is not finite. */
bd_status bd_hbm_evaluate(bd_hbm *hbm, const double *u, double omega, double *r, double *J,
                          double *r_omega);

/* ---- parts, for the speed family ---- */

/* Evaluate with the present arrays. */
bd_status bd_hbm_evaluate_at(bd_hbm *hbm, const double *u, double omega, double *r, double *J,
                             double *r_omega);

/* X from the unknowns. */
void bd_hbm_motion(bd_hbm *hbm, const double *u);

/* r = (K - (l omega)^2 M + i l omega C) q - E; its derivatives are added to J and written to
 * r_omega, unless NULL. */
void bd_hbm_linear_part(const bd_hbm *hbm, const double *u, double omega, double *r, double *J,
                        double *r_omega);

/* r += G^H of contact forces F (n_point, 3, n_coef). */
void bd_hbm_add_force(bd_hbm *hbm, const double *F, double *r);

#endif
