/* Contact element: its parameters, and the sums over one cycle from which every evaluation
 * assembles the force. */
#ifndef BD_CONTACT_ELEMENT_H
#define BD_CONTACT_ELEMENT_H

#include "contact/user_law.h"

typedef enum {
    /* two independent tangential directions, each 1-D friction with variable normal load */
    BD_LAW_SEPARABLE = 0,
    BD_LAW_NORMAL = 1, /* unilateral normal spring alone: constraint planes, mu = 0 */
    /* like separable, but the constant `load` limits friction and the normal spring is two-sided: a
     * contact that stays closed with nearly constant load */
    BD_LAW_CONSTANT = 2,
    BD_LAW_COUPLED = 3,          /* friction force in a disk of radius mu N */
    BD_LAW_COUPLED_CONSTANT = 4, /* the same with the constant `load` instead of N */
    BD_LAW_BONDED = 5,           /* linear two-sided springs in all directions */
    /* T_d = kt_d u_d^3, kt in N/m3, of either sign; no normal spring, kn and n0 are not read */
    BD_LAW_CUBIC = 6,
    /* a user's function; kt and kn are its springs without slip, n0/kn is the closing at v = 0, mu
     * and load are not read */
    BD_LAW_USER = 7
} bd_law;
enum { BD_N_LAW = 8 };

typedef struct {
    bd_law law;
    double kt[2]; /* N/m */
    double kn;    /* N/m */
    double mu;
    double n0; /* N, normal load at v = 0; negative: a gap of -n0/kn */
    /* m, slider position of a point that never slips; infinite: the corresponding end of the
     * admissible interval */
    double w[2];
    /* N, normal load in the friction limit of the constant-load laws */
    double load;
    const bd_point_law *point_law; /* law of BD_LAW_USER, owned by the equations */
} bd_element;

static inline int bd_law_is_constant(bd_law law) {
    return law == BD_LAW_CONSTANT || law == BD_LAW_COUPLED_CONSTANT;
}
static inline int bd_law_is_coupled(bd_law law) {
    return law == BD_LAW_COUPLED || law == BD_LAW_COUPLED_CONSTANT;
}

/* Return whether the normal spring also pulls. */
static inline int bd_law_is_two_sided(bd_law law) {
    return law == BD_LAW_BONDED || bd_law_is_constant(law);
}

/* Return whether direction d has friction. */
static inline int bd_element_has_friction(const bd_element *e, int d) {
    if (e->law == BD_LAW_NORMAL || e->law == BD_LAW_BONDED || e->law >= BD_LAW_CUBIC) return 0;
    if (!(e->mu > 0.0) || !(e->kt[d] > 0.0)) return 0;
    return !bd_law_is_constant(e->law) || e->load > 0.0;
}

/* Closing of the surfaces at v = 0. */
static inline double bd_static_closing(double kn, double n0) { return kn > 0.0 ? n0 / kn : 0.0; }

/* State of one tangential direction during a part of the cycle. */
typedef enum { BD_STICK = 0, BD_SLIP_PLUS = 1, BD_SLIP_MINUS = 2, BD_OPEN = 3 } bd_state;

typedef struct {
    double start, end; /* angles; end may exceed 2 pi */
    int state;
} bd_segment;

/* Share of the cycle in each state, for the two tangential directions. */
typedef struct {
    double stick[2], slip[2], open;
} bd_status_share;

/* Form of the tangent of one component. */
typedef enum {
    BD_BLOCK_ZERO = 0,  /* no force: the blocks are zero and not written */
    BD_BLOCK_FULL = 1,  /* the blocks are written */
    BD_BLOCK_LINEAR = 2 /* spring only, kt or kn times the identity: the blocks are not written */
} bd_block;

/* Force coefficients and tangent of one point. A block is (n_coef, n_coef) row-major. */
typedef struct {
    double *F;      /* (3, n_coef): T1, T2, N */
    double *dT[2];  /* dT_d/du_d */
    double *dTv[2]; /* dT_d/dv */
    double *dTc[2]; /* dT_d/du of the other direction; NULL unless a law couples them */
    double *dN;     /* dN/dv */
    double *dNt[2]; /* dN/du_d; written by user laws only */
    bd_block tangential[2], normal;
    int coupled;         /* 1: dTc is part of the tangent */
    int with_normal[2];  /* 0: dTv of this direction is zero and not written */
    int with_tangential; /* 0: dNt is zero and not written */
} bd_response;

/* Order of the tangent blocks of a point in arrays (block, n_coef, n_coef). Laws that do not couple
 * N to the tangential motion have the first BD_N_BLOCK; user laws have all BD_N_USER_BLOCK. */
enum {
    BD_DT1_DU1,
    BD_DT2_DU2,
    BD_DT1_DV,
    BD_DT2_DV,
    BD_DT1_DU2,
    BD_DT2_DU1,
    BD_DN_DV,
    BD_N_BLOCK,
    BD_DN_DU1 = BD_N_BLOCK,
    BD_DN_DU2,
    BD_N_USER_BLOCK
};

/* Sums over one cycle of one tangential direction. E_n is the integral of exp(i n theta), stored
 * for n = 0..2 n_harm as [E_0, E_0, Re E_1, Im E_1, ...]. Entry 1 repeats E_0, so that E + 1 holds
 * the integrals of the basis. */
typedef struct {
    int n_harm;
    double *stick;        /* (4 n_harm + 2) over the parts that stick */
    double *slip;         /* over the parts that slip, plus minus minus */
    double *stick_slider; /* (n_coef) integral of w times the basis over the parts that stick */
    /* (n_coef, n_coef) its derivative with respect to u, or NULL without a tangent */
    double *stick_slider_u;
    double *stick_slider_v; /* the same with respect to v */
} bd_cycle;

static inline int bd_n_power(int n_harm) { return 4 * n_harm + 2; }

void bd_cycle_clear(bd_cycle *cycle);

/* E += sign * integral over [start, end], from the powers of exp(i theta) at both ends. */
void bd_cycle_integrate(int n_harm, double *E, double length, const double *start,
                        const double *end, double sign);

/* Add a part that sticks at slider position w with dw = du_part . du + dv_part . dv; g is its
 * (n_coef) integral. */
void bd_cycle_add_stick(bd_cycle *cycle, const double *g, double w, const double *du_part,
                        const double *dv_part);

/* Symmetric matrix of the integrals of products of basis functions
 * (Toeplitz plus Hankel) from E. */
void bd_cycle_products(int n_harm, const double *E, double *products);

/* Force and tangent of tangential direction d from its sums; scratch is (n_coef, n_coef). */
void bd_cycle_friction(const bd_element *element, int d, const bd_cycle *cycle, const double *u,
                       const double *v, bd_response *out, double *scratch);

/* Normal force and tangent from E over the parts in contact. */
void bd_cycle_normal(const bd_element *element, int n_harm, const double *contact, const double *v,
                     bd_response *out, double *scratch);

/* Linear limits without sums: contact or stick throughout the cycle. */
void bd_element_closed(const bd_element *element, int n_harm, const double *v, bd_response *out);
void bd_element_stuck(const bd_element *element, int n_harm, int d, const double *u,
                      bd_response *out);
void bd_element_open(const bd_element *element, int n_harm, bd_response *out);

/* Cubic springs, exact for the truncated motion x (3, n_coef). */
void bd_element_cubic(const bd_element *element, int n_harm, const double *x, bd_response *out);

/* Common form of all blocks; full if they differ. */
bd_block bd_element_form(const bd_response *out);

/* Write the blocks that an evaluation omitted because they are zero or diagonal. */
void bd_element_write_blocks(const bd_element *element, int n_harm, bd_response *out);

#endif
