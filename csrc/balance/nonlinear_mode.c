/* Nonlinear modes by extended periodic motion: a force proportional to mass times velocity balances
 * the losses of the autonomous system,
 *
 *     M q'' + (C - xi M) q' + K q + f_c(q) = f_static,      xi = 2 omega zeta,
 *
 * with the modal damping zeta (Krack 2015). Let Q_l = a P_l for the harmonics l > 0. Q_0 is not
 * scaled. The equations of l > 0 are divided by a, so small vibration under a large static force
 * loses no digits:
 *
 *     R_0 = K Q_0 + F_0(Q) - f_static,
 *     R_l/a = [K - (l omega)^2 M + i l omega (C - xi M)] P_l + F_l(Q)/a,
 *     weight (re . P - 1) = 0,  weight im . P = 0.
 *
 * The last two equations make a the amplitude of a selected motion and fix its phase. With the
 * Jacobian S + J of the sector at Q,
 *
 *     d(R_l/a)/dP_k = (S + J)_lk          d(R_l/a)/dQ_0 = J_l0/a
 *     dR_0/dP_k = a J_0k                  dR_0/d ln a = a sum_k J_0k P_k
 *     d(R_l/a)/dxi = -i l omega M P_l     d(R_l/a)/d ln a = sum_k (S + J)_lk P_k - R_l/a,  k > 0.
 *
 * d(R_l/a)/domega is the derivative of the sector with C - xi M instead of C, plus 2 zeta
 * d(R_l/a)/dxi. The unknown is zeta. The force does not act on coordinates without mass. */
#include "balance/nonlinear_mode.h"

#include "util/storage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    bd_dense dense;
    bd_sector *sector;
    double weight;
    double *re, *im;   /* (n) */
    double *u;         /* (n) unknowns of the sector */
    double *r, *C;     /* (n) its residual and derivative with respect to omega */
    double *J;         /* (n, n) */
    double *force;     /* (n) its static forces */
    double *by_xi;     /* (n) */
    double *damping;   /* C - xi M for each mode */
    double *vibration; /* (n + 2) unknowns of the vibration, the others 0 */
    double *memory;
    bd_condensation *condensation; /* NULL: dense factors */
} modes_equations;

static double dot(const double *x, const double *y, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += x[i] * y[i];
    return sum;
}

/* Evaluate the sector at Q with the damping C - xi M and without excitation. */
static bd_status evaluate_sector(modes_equations *modes, double omega, double xi, int derivative) {
    bd_hbm *hbm = &modes->sector->hbm;
    double *damping = hbm->damping, *force = hbm->force;
    const int is_dense = !modes->condensation;
    double *J = derivative && is_dense ? modes->J : NULL, *C = derivative ? modes->C : NULL;
    size_t n_mode = 0; /* of all harmonics */
    for (int l = 0; l <= hbm->n_harm; ++l) n_mode += (size_t)hbm->n_mode[l];
    for (size_t j = 0; j < n_mode; ++j) modes->damping[j] = damping[j] - xi * hbm->mass[j];

    /* the sector keeps its own damping and force */
    hbm->damping = modes->damping;
    hbm->force = modes->force;
    hbm->parts = derivative && !is_dense ? &modes->condensation->parts : NULL;
    const bd_status status = bd_hbm_evaluate(hbm, modes->u, omega, modes->r, J, C);
    hbm->parts = NULL;
    hbm->damping = damping;
    hbm->force = force;
    return status;
}

/* Derivative of the residual with respect to xi, by_xi (n): for harmonic l, -i l omega M P_l with
 * P_l = c - i s, which is -l omega M s in the cosine and l omega M c in the sine rows. It is 0 for
 * the mean. */
static void differentiate_by_xi(modes_equations *modes, const double *y, double omega) {
    const bd_hbm *hbm = &modes->sector->hbm;
    const double *mass = hbm->mass + hbm->n_mode[0];
    memset(modes->by_xi, 0, sizeof(double) * (size_t)hbm->n_mode[0]);
    for (int l = 1; l <= hbm->n_harm; ++l) {
        const size_t first = (size_t)hbm->first_unknown[l], n = (size_t)hbm->n_mode[l];
        for (size_t j = 0; j < n; ++j) {
            modes->by_xi[first + j] = -l * omega * mass[j] * y[first + n + j];
            modes->by_xi[first + n + j] = l * omega * mass[j] * y[first + j];
        }
        mass += n;
    }
}

/* Jacobian J (n + 2, n + 2) and derivative C (n + 2) with respect to ln a, from the Jacobian J_s
 * (n, n) and the derivative C_s with respect to omega of the sector. The unknowns are the mean, the
 * vibration P = Q/a, omega and zeta; rows of the vibration are divided by a. With xi = 2 omega
 * zeta,
 *
 *     mean rows   J = [ J_s (mean)   a J_s (vibration)   C_s + 2 zeta r_xi     2 omega r_xi ]
 *     vibration       [ J_s/a        J_s                 C_s/a + 2 zeta r_xi   2 omega r_xi ]
 *     amplitude       [ weight re                        0                     0            ]
 *     phase           [ weight im                        0                     0            ]
 *
 * and C = J (vibration) P, minus r in rows of the vibration; r_xi is modes->by_xi. */
static void fill_jacobian(modes_equations *modes, const double *y, double omega, double zeta,
                          double a) {
    bd_equations *e = &modes->dense.base;
    const size_t n = (size_t)modes->sector->dense.base.n, n2 = n + 2;
    const size_t n_mean = (size_t)modes->sector->hbm.n_mode[0];
    for (size_t i = 0; i < n; ++i) {
        const int is_mean = i < n_mean;
        const double unit = is_mean ? 1.0 : 1.0 / a; /* rows of the vibration are divided by a */
        const double *from = modes->J + i * n;
        double *to = e->J + i * n2;
        for (size_t j = 0; j < n_mean; ++j) to[j] = unit * from[j];
        for (size_t j = n_mean; j < n; ++j) to[j] = unit * a * from[j];
        to[n] = unit * modes->C[i] + 2.0 * zeta * modes->by_xi[i];
        to[n + 1] = 2.0 * omega * modes->by_xi[i];
        e->C[i] = dot(to + n_mean, y + n_mean, n - n_mean) - (is_mean ? 0.0 : e->r[i]);
    }
    double *amplitude = e->J + n * n2, *phase = amplitude + n2;
    memset(amplitude, 0, sizeof(double) * 2 * n2);
    for (size_t j = 0; j < n; ++j) {
        amplitude[j] = modes->weight * modes->re[j];
        phase[j] = modes->weight * modes->im[j];
    }
    e->C[n] = e->C[n + 1] = 0.0;
}

/* Border of the condensed equations: columns of omega and zeta (n each), and the derivative C
 * (n + 2) for the parameter ln a of the amplitude. The vibration is P = Q/a, with rows over a. C_s
 * is the derivative of the sector with respect to omega. The derivative with respect to
 * xi = 2 omega zeta is r_xi = modes->by_xi.
 *
 *     by_omega = C_s (mean rows) or C_s/a, + 2 zeta r_xi,     by_zeta = 2 omega r_xi,
 *     C = J (vibration) P, minus r in rows of the vibration. */
static void fill_border(modes_equations *modes, const double *y, double omega, double zeta,
                        double a) {
    bd_equations *e = &modes->dense.base;
    bd_condensation *condensation = modes->condensation;
    const size_t n = (size_t)modes->sector->dense.base.n;
    const size_t n_mean = (size_t)modes->sector->hbm.n_mode[0];
    double *by_omega = condensation->extra_column, *by_zeta = by_omega + n;
    condensation->amplitude = a;
    for (size_t i = 0; i < n; ++i) {
        const double unit = i < n_mean ? 1.0 : 1.0 / a;
        by_omega[i] = unit * modes->C[i] + 2.0 * zeta * modes->by_xi[i];
        by_zeta[i] = 2.0 * omega * modes->by_xi[i];
    }
    memcpy(modes->vibration + n_mean, y + n_mean, sizeof(double) * (n - n_mean));
    bd_condensation_product(condensation, 0, modes->vibration, e->C);
    for (size_t i = n_mean; i < n; ++i) e->C[i] -= e->r[i];
    e->C[n] = e->C[n + 1] = 0.0;
}

/* Residual at y = (Q_0, P, omega, zeta, ln a): the sector at Q = (Q_0, a P), rows of the vibration
 * divided by a, and the equations weight (re . P - 1) = 0 and weight im . P = 0 that fix amplitude
 * and phase. */
static bd_status evaluate(bd_equations *e, const double *y, int derivative) {
    modes_equations *modes = (modes_equations *)e;
    const size_t n = (size_t)modes->sector->dense.base.n;
    const size_t n_mean = (size_t)modes->sector->hbm.n_mode[0];
    const double omega = y[n], zeta = y[n + 1], a = exp(y[n + 2]);
    for (size_t i = 0; i < n_mean; ++i) modes->u[i] = y[i];
    for (size_t i = n_mean; i < n; ++i) modes->u[i] = a * y[i];
    const bd_status status = evaluate_sector(modes, omega, 2.0 * omega * zeta, derivative);
    if (status != BD_OK) return status;

    for (size_t i = 0; i < n_mean; ++i) e->r[i] = modes->r[i];
    for (size_t i = n_mean; i < n; ++i) e->r[i] = modes->r[i] / a;
    e->r[n] = modes->weight * (dot(modes->re, y, n) - 1.0);
    e->r[n + 1] = modes->weight * dot(modes->im, y, n);
    if (derivative) {
        differentiate_by_xi(modes, y, omega);
        if (modes->condensation)
            fill_border(modes, y, omega, zeta, a);
        else
            fill_jacobian(modes, y, omega, zeta, a);
    }
    double sum = 0.0;
    for (size_t i = 0; i < n + 2; ++i) sum += e->r[i] * 0.0; /* preserves NaN and infinity */
    return sum == 0.0 ? BD_OK : BD_NOT_FINITE;
}

static void destroy(bd_equations *e) {
    modes_equations *modes = (modes_equations *)e;
    bd_condensation_destroy(modes->condensation);
    bd_dense_destroy(&modes->dense);
    free(modes->memory);
    free(modes);
}

static const bd_equations_type MODES = {evaluate,       bd_dense_factor,
                                        bd_dense_solve, bd_dense_solve_transposed,
                                        NULL,           destroy};

static bd_status factor_condensed(bd_equations *e, const bd_border *border) {
    return bd_condensation_factor(((modes_equations *)e)->condensation, border);
}

static bd_status solve_condensed(bd_equations *e, double tolerance, double *b) {
    (void)tolerance;
    return bd_condensation_solve(((modes_equations *)e)->condensation, 0, b);
}

static bd_status solve_condensed_transposed(bd_equations *e, double *b) {
    return bd_condensation_solve(((modes_equations *)e)->condensation, 1, b);
}

static bd_status multiply_condensed(bd_equations *e, int transposed, const double *x, double *out) {
    bd_condensation_product(((modes_equations *)e)->condensation, transposed, x, out);
    return BD_OK;
}

static const bd_equations_type CONDENSED = {
    .evaluate = evaluate,
    .factor = factor_condensed,
    .solve = solve_condensed,
    .solve_transposed = solve_condensed_transposed,
    .product = multiply_condensed,
    .destroy = destroy,
};

/* Amplitude and phase are fixed by rows beyond those of the sector. */
static bd_status condense(modes_equations *modes) {
    const size_t n = (size_t)modes->sector->dense.base.n;
    const bd_status status =
        bd_condensation_create(&modes->condensation, &modes->dense, &modes->sector->hbm, 2);
    if (status != BD_OK) return status;
    double *amplitude = modes->condensation->extra_row, *phase = amplitude + n;
    for (size_t j = 0; j < n; ++j) {
        amplitude[j] = modes->weight * modes->re[j];
        phase[j] = modes->weight * modes->im[j];
    }
    modes->dense.base.type = &CONDENSED;
    return BD_OK;
}

/* Create the equations of a nonlinear mode from a sector, with two more unknowns and equations than
 * the sector: weight (re . P - 1) = 0 and weight im . P = 0 fix amplitude and phase. re and im are
 * rows (n). The sector must exist as long as these equations. */
bd_status bd_modes_create(bd_equations **out, bd_sector *sector, const double *re, const double *im,
                          double weight, const double *row_scale) {
    const bd_hbm *hbm = &sector->hbm;
    const size_t n = (size_t)hbm->n_unknown, n_mean = (size_t)hbm->n_mode[0];
    *out = NULL;
    /* the arrays of a family are undefined before an evaluation */
    if (hbm->variation) return BD_BAD_ARGUMENT;
    modes_equations *modes = calloc(1, sizeof *modes);
    if (!modes) return BD_NO_MEMORY;
    bd_status status = bd_dense_create(&modes->dense, &MODES, (int)n + 2, row_scale,
                                       &sector->dense.lapack, sector->dense.base.cost);
    size_t n_mode = 0;
    for (int l = 0; l <= hbm->n_harm; ++l) n_mode += (size_t)hbm->n_mode[l];
    modes->memory = calloc(8 * n + 2 + n * n + n_mode, sizeof(double));
    if (status == BD_OK && !modes->memory) status = BD_NO_MEMORY;
    if (status != BD_OK) {
        destroy(&modes->dense.base);
        return status;
    }
    modes->sector = sector;
    modes->weight = weight;
    double *rest = modes->memory;
    modes->re = bd_take(&rest, n);
    modes->im = bd_take(&rest, n);
    modes->u = bd_take(&rest, n);
    modes->r = bd_take(&rest, n);
    modes->C = bd_take(&rest, n);
    modes->force = bd_take(&rest, n);
    modes->by_xi = bd_take(&rest, n);
    modes->J = bd_take(&rest, n * n);
    modes->damping = bd_take(&rest, n_mode);
    modes->vibration = bd_take(&rest, n + 2);

    /* the mean has no part in the amplitude, and only its force remains */
    if (n > n_mean) {
        memcpy(modes->re + n_mean, re + n_mean, sizeof(double) * (n - n_mean));
        memcpy(modes->im + n_mean, im + n_mean, sizeof(double) * (n - n_mean));
    }
    if (n_mean > 0) memcpy(modes->force, hbm->force, sizeof(double) * n_mean);
    if (sector->condensation) status = condense(modes);
    if (status != BD_OK) {
        destroy(&modes->dense.base);
        return status;
    }
    *out = &modes->dense.base;
    return BD_OK;
}
