/* Sampled evaluation of in-plane coupled Coulomb friction, settled over the period. */
#ifndef BD_COULOMB_H
#define BD_COULOMB_H

#include "bd_disks.h"
#include "bd_element.h"
#include "bd_sampled.h"

/* Where the settled slider can be: (x - c) . Q^-1 (x - c) <= 1. */
typedef struct {
    double c[2], Q[2][2];
} bd_ellipse;

/* The search for the settled slider of one point. */
typedef struct {
    enum { BD_DONE, BD_SEARCHING, BD_SETTLED, BD_LOST } state; /* done: there is nothing to be settled */
    double size;                                               /* of the forces */
    bd_hold centre;
    double s[2];   /* the latest guess */
    double before; /* length of the latest step of Newton's method */
    int n_row;     /* such steps in a row; the first of them may grow, as slips across come after slips along */
    int n_period;
    bd_ellipse around;
} bd_search;

typedef struct {
    int n_harm, n_time, n_padded; /* n_padded: n_time, rounded up to a multiple of 8 */
    const bd_kernel *kernel;
    const double *power; /* (n_time, n_power), owned by the sampled evaluator */
    bd_slide lanes;
    bd_search search[BD_LANES];
    double *motion;        /* (3, n_coef, BD_LANES) kt u and n0 + kn v */
    double *point;         /* (BD_LANES, 4, n_padded) x, y, R, g of each point */
    double *x, *y, *R, *g; /* those of the point at hand */
    double *slider;        /* (2, 3 n_coef + 2) derivative of the slider: u1, u2, v, slider at the start of the period */
    double *next;          /* the same after a step */
    double *held;          /* (2, n_coef, 3 n_coef + 2) sum of the basis times the derivative over samples in contact */
    double *stretch;       /* (n_coef) sum of the basis since the slider was last set */
    double *products;      /* (n_coef, n_coef) */
    double *contact;       /* (n_power) */
    bd_segment *segment;   /* (n_time) parts of the cycle of the latest point; state slip is BD_SLIP_PLUS */
    int n_segment;
    int n_period; /* periods that the latest evaluation marched to settle */
    double *memory;
} bd_coulomb_work;

/* The tables of the sampled evaluator are used, which must outlive this workspace. */
bd_status bd_coulomb_create(bd_coulomb_work *work, const bd_sampled_work *sampled);
void bd_coulomb_destroy(bd_coulomb_work *work);

/* For n <= BD_LANES points, as bd_sampled_evaluate.  Writes the tangential components of coupled laws; the normal direction
 * and other laws are left as they are.  If a cycle did not settle its force would be NaN. */
void bd_coulomb_evaluate(int n, const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                         bd_coulomb_work *work);

#endif
