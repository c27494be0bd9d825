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

static bd_status evaluate_sector(bd_equations *e, const double *y, int derivative) {
    bd_hbm *hbm = &((bd_sector *)e)->hbm;
    return bd_hbm_evaluate(hbm, y, y[e->n], e->r, derivative ? e->J : NULL,
                           derivative ? e->C : NULL);
}

static void destroy_sector(bd_equations *e) {
    bd_sector *sector = (bd_sector *)e;
    bd_hbm_destroy(&sector->hbm);
    bd_dense_destroy(&sector->dense);
    free(sector);
}

static const bd_equations_type SECTOR = {
    evaluate_sector, bd_dense_factor, bd_dense_solve, bd_dense_solve_transposed, NULL,
    destroy_sector};

bd_status bd_sector_create(bd_sector **sector, const bd_hbm_input *input, const double *row_scale,
                           const bd_lapack *lapack) {
    *sector = NULL;
    bd_sector *new_sector = calloc(1, sizeof *new_sector);
    if (!new_sector) return BD_NO_MEMORY;
    bd_status status = bd_hbm_create(&new_sector->hbm, input);
    if (status == BD_OK) {
        status = bd_dense_create(&new_sector->dense, &SECTOR, new_sector->hbm.n_unknown, row_scale,
                                 lapack, &new_sector->hbm.cost);
        if (status != BD_OK) bd_hbm_destroy(&new_sector->hbm);
    }
    if (status == BD_OK)
        *sector = new_sector;
    else
        free(new_sector);
    return status;
}

/* ---- factor on the excitation ---- */

typedef struct {
    bd_dense dense;
    bd_sector *sector;
    double omega;
    double *ramp;    /* (n) */
    double *support; /* (n, n) in the same memory, or NULL */
} eased_equations;

static void add_support(const eased_equations *eased, const double *y, int derivative) {
    const bd_equations *e = &eased->dense.base;
    const size_t n = (size_t)e->n;
    const double s = y[n], share = 1.0 / s - 1.0;
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

static bd_status evaluate_eased(bd_equations *e, const double *y, int derivative) {
    const eased_equations *eased = (const eased_equations *)e;
    const size_t n = (size_t)e->n;
    const bd_status status =
        bd_hbm_evaluate(&eased->sector->hbm, y, eased->omega, e->r, derivative ? e->J : NULL, NULL);
    for (size_t i = 0; i < n; ++i) {
        e->r[i] += (1.0 - y[n]) * eased->ramp[i];
        if (derivative) e->C[i] = -eased->ramp[i];
    }
    if (eased->support) add_support(eased, y, derivative);
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += e->r[i] * 0.0; /* preserves NaN and infinity */
    return status == BD_OK && sum != 0.0 ? BD_NOT_FINITE : status;
}

static void destroy_eased(bd_equations *e) {
    eased_equations *eased = (eased_equations *)e;
    bd_dense_destroy(&eased->dense);
    free(eased->ramp);
    free(eased);
}

static const bd_equations_type EASED = {evaluate_eased, bd_dense_factor,
                                        bd_dense_solve, bd_dense_solve_transposed,
                                        NULL,           destroy_eased};

bd_status bd_eased_create(bd_equations **out, bd_sector *sector, double omega, const double *ramp,
                          const double *support) {
    const size_t n = (size_t)sector->dense.base.n, n_support = support ? n * n : 0;
    *out = NULL;
    eased_equations *eased = calloc(1, sizeof *eased);
    if (!eased) return BD_NO_MEMORY;
    bd_status status = bd_dense_create(&eased->dense, &EASED, (int)n, sector->dense.base.row_scale,
                                       &sector->dense.lapack, sector->dense.base.cost);
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
