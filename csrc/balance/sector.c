/* Equations of one sector, with omega or a factor on the excitation as parameter.
 *
 * The factor s multiplies the vibratory excitation at fixed omega. It starts a response from the
 * static state, or fades out a linear support S of a free body:
 *
 *     r(u, omega) + (1 - s) ramp + (1/s - 1) S u = 0,      0 < s <= 1.
 *
 * The support is nearly rigid at small s and vanishes at s = 1. */
#include "balance/sector.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Residual r (n) at y (n + 1), the unknowns and omega. Derivatives are J (n, n) and C (n), with
 * respect to the unknowns and to omega. Condensed equations have the parts of J instead. */
static bd_status evaluate_sector(bd_equations *e, const double *y, int derivative) {
    bd_sector *sector = (bd_sector *)e;
    bd_hbm *hbm = &sector->hbm;
    const double omega = y[e->n];
    double *J = derivative ? e->J : NULL;
    double *r_omega = derivative ? e->C : NULL;
    hbm->parts = derivative && sector->condensation ? &sector->condensation->parts : NULL;
    const bd_status status = bd_hbm_evaluate(hbm, y, omega, e->r, J, r_omega);
    hbm->parts = NULL;
    return status;
}

static void destroy_sector(bd_equations *e) {
    bd_sector *sector = (bd_sector *)e;
    bd_condensation_destroy(sector->condensation);
    bd_hbm_destroy(&sector->hbm);
    bd_dense_destroy(&sector->dense);
    free(sector);
}

static const bd_equations_type SECTOR = {
    .evaluate = evaluate_sector,
    .factor = bd_dense_factor,
    .solve = bd_dense_solve,
    .solve_transposed = bd_dense_solve_transposed,
    .destroy = destroy_sector,
};

static bd_status factor_condensed(bd_equations *e, const bd_border *border) {
    return bd_condensation_factor(((bd_sector *)e)->condensation, border);
}

static bd_status solve_condensed(bd_equations *e, double tolerance, double *b) {
    (void)tolerance;
    return bd_condensation_solve(((bd_sector *)e)->condensation, 0, b);
}

static bd_status solve_condensed_transposed(bd_equations *e, double *b) {
    return bd_condensation_solve(((bd_sector *)e)->condensation, 1, b);
}

static bd_status multiply_condensed(bd_equations *e, int transposed, const double *x, double *out) {
    bd_condensation_product(((bd_sector *)e)->condensation, transposed, x, out);
    return BD_OK;
}

static const bd_equations_type CONDENSED = {
    .evaluate = evaluate_sector,
    .factor = factor_condensed,
    .solve = solve_condensed,
    .solve_transposed = solve_condensed_transposed,
    .product = multiply_condensed,
    .destroy = destroy_sector,
};

static bd_status condense(bd_sector *sector) {
    bd_dense *dense = &sector->dense;
    const bd_status status = bd_condensation_create(&sector->condensation, dense, &sector->hbm, 0);
    if (status == BD_OK) dense->base.type = &CONDENSED;
    return status;
}

/* Create the equations of one sector. They are solved by elimination of the modes if this was chosen
 * (BD_CONDENSED) or pays for their size (BD_BY_SIZE), otherwise as a dense matrix. */
bd_status bd_sector_create(bd_sector **out, const bd_hbm_input *input, const double *row_scale,
                           const bd_lapack *lapack, bd_elimination elimination) {
    *out = NULL;
    bd_sector *sector = calloc(1, sizeof *sector);
    if (!sector) return BD_NO_MEMORY;
    bd_hbm *hbm = &sector->hbm;
    bd_status status = bd_hbm_create(hbm, input);
    if (status != BD_OK) {
        free(sector);
        return status;
    }
    status =
        bd_dense_create(&sector->dense, &SECTOR, hbm->n_unknown, row_scale, lapack, &hbm->cost);
    if (status != BD_OK) {
        bd_hbm_destroy(hbm);
        free(sector);
        return status;
    }
    const int pays = elimination == BD_BY_SIZE && bd_condensation_pays(hbm);
    if (pays || elimination == BD_CONDENSED) status = condense(sector);
    if (status != BD_OK) {
        destroy_sector(&sector->dense.base);
        return status;
    }
    *out = sector;
    return BD_OK;
}

/* ---- factor on the excitation ---- */

typedef struct {
    bd_dense dense;
    bd_sector *sector;
    double omega;
    double *ramp;    /* (n) */
    double *support; /* (n, n) in the same memory, or NULL */
} eased_equations;

/* r += (1/s - 1) S u */
static void add_support(const eased_equations *eased, const double *y, int derivative) {
    const bd_equations *e = &eased->dense.base;
    const size_t n = (size_t)e->n;
    const double s = y[n];
    const double share = 1.0 / s - 1.0;
    for (size_t i = 0; i < n; ++i) {
        const double *row = eased->support + i * n;
        double force = 0.0;
        for (size_t j = 0; j < n; ++j) force += row[j] * y[j];
        e->r[i] += share * force;
        if (!derivative) continue;
        e->C[i] -= force / (s * s);
        for (size_t j = 0; j < n; ++j) e->J[i * n + j] += share * row[j];
    }
}

/* Residual and derivatives at y (n + 1), the unknowns and the factor s on the excitation, at fixed
 * omega: r + (1 - s) ramp + (1/s - 1) S u, where C is the derivative by s. */
static bd_status evaluate_eased(bd_equations *e, const double *y, int derivative) {
    const eased_equations *eased = (const eased_equations *)e;
    const size_t n = (size_t)e->n;
    const double s = y[n];
    double *J = derivative ? e->J : NULL;
    const bd_status status = bd_hbm_evaluate(&eased->sector->hbm, y, eased->omega, e->r, J, NULL);
    for (size_t i = 0; i < n; ++i) {
        e->r[i] += (1.0 - s) * eased->ramp[i];
        if (derivative) e->C[i] = -eased->ramp[i];
    }
    if (eased->support) add_support(eased, y, derivative);
    if (status != BD_OK) return status;

    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += e->r[i] * 0.0; /* preserves NaN and infinity */
    return sum == 0.0 ? BD_OK : BD_NOT_FINITE;
}

static void destroy_eased(bd_equations *e) {
    eased_equations *eased = (eased_equations *)e;
    bd_dense_destroy(&eased->dense);
    free(eased->ramp);
    free(eased);
}

static const bd_equations_type EASED = {
    .evaluate = evaluate_eased,
    .factor = bd_dense_factor,
    .solve = bd_dense_solve,
    .solve_transposed = bd_dense_solve_transposed,
    .destroy = destroy_eased,
};

/* Create equations with the factor s on the excitation as parameter, for the sector at fixed omega:
 * ramp (n) is the vibratory excitation, support (n, n) the matrix S or NULL. The sector must exist
 * as long as these equations. */
bd_status bd_eased_create(bd_equations **out, bd_sector *sector, double omega, const double *ramp,
                          const double *support) {
    const bd_equations *base = &sector->dense.base;
    const size_t n = (size_t)base->n;
    const size_t n_support = support ? n * n : 0;
    *out = NULL;
    eased_equations *eased = calloc(1, sizeof *eased);
    if (!eased) return BD_NO_MEMORY;
    bd_status status = bd_dense_create(&eased->dense, &EASED, base->n, base->row_scale,
                                       &sector->dense.lapack, base->cost);
    eased->sector = sector;
    eased->omega = omega;
    eased->ramp = malloc(sizeof(double) * (n + n_support));
    if (status == BD_OK && !eased->ramp) status = BD_NO_MEMORY;
    if (status != BD_OK) {
        destroy_eased(&eased->dense.base);
        return status;
    }
    memcpy(eased->ramp, ramp, sizeof(double) * n);
    if (support) {
        eased->support = eased->ramp + n;
        memcpy(eased->support, support, sizeof(double) * n_support);
    }
    *out = &eased->dense.base;
    return BD_OK;
}
