/* Derivative of the force of a contact point if motion and parameters change together.
 *
 * The laws depend on kt (u - w), n0 + kn v and mu N only, so the tangent B = dF/dX determines all
 * derivatives:
 *
 *     kt dF/dkt = B_u (u - w),   dF/dw = -B_u,   kn dF/dkn = B_v v,   dF/dn0 = B_v/kn.
 *
 * Friction is homogeneous of degree one in kt (u - w) and its limit mu N, hence
 *
 *     mu dT/dmu = T - B_u (u - w).
 *
 * The same holds for the load of the constant-load laws. Cubic springs are proportional to kt. */
#include "contact/force_derivative.h"

#include <string.h>

static void add_block(int n, bd_block kind, double spring, const double *block, double factor,
                      const double *x, double *to) {
    if (kind == BD_BLOCK_LINEAR)
        for (int i = 0; i < n; ++i) to[i] += factor * spring * x[i];
    if (kind == BD_BLOCK_FULL)
        for (int i = 0; i < n; ++i) {
            double sum = 0.0;
            for (int j = 0; j < n; ++j) sum += block[(size_t)i * (size_t)n + (size_t)j] * x[j];
            to[i] += factor * sum;
        }
}

/* Contribution of the tangential motions (2, BD_MAX_COEF) to the change of the friction force in
 * direction d. */
static void add_friction(const bd_element *e, int n, int d, const bd_response *response,
                         double factor, double (*x)[BD_MAX_COEF], double *to) {
    const bd_block kind = response->tangential[d];
    add_block(n, kind, e->kt[d], response->dT[d], factor, x[d], to);
    if (kind == BD_BLOCK_FULL && response->coupled)
        add_block(n, kind, 0.0, response->dTc[d], factor, x[1 - d], to);
}

static double relative_change(double change, double of) { return of != 0.0 ? change / of : 0.0; }

void bd_force_derivative(const bd_element *element, const bd_element *rate, int n_harm,
                         const double *X, const double *dX, const bd_response *response,
                         double *dF) {
    const int n = bd_n_coef(n_harm), springs = element->law != BD_LAW_CUBIC;
    double change[3][BD_MAX_COEF], away[2][BD_MAX_COEF];
    for (int a = 0; a < 3; ++a) memcpy(change[a], dX + a * n, sizeof(double) * (size_t)n);
    for (int d = 0; d < 2; ++d) {
        memcpy(away[d], X + d * n, sizeof(double) * (size_t)n);
        if (!springs) continue;
        away[d][0] -= element->w[d];
        const double stiffer = relative_change(rate->kt[d], element->kt[d]);
        for (int i = 0; i < n; ++i) change[d][i] += stiffer * away[d][i];
        change[d][0] -= rate->w[d];
    }
    for (int i = 0; i < n; ++i)
        change[2][i] += relative_change(rate->kn, element->kn) * X[2 * n + i];
    change[2][0] += relative_change(rate->n0, element->kn);
    const double limit =
        relative_change(rate->mu, element->mu) +
        (bd_law_is_constant(element->law) ? relative_change(rate->load, element->load) : 0.0);
    memset(dF, 0, sizeof(double) * 3 * (size_t)n);
    for (int d = 0; d < 2; ++d) {
        double *to = dF + d * n;
        const double *T = response->F + d * n;
        add_friction(element, n, d, response, 1.0, change, to);
        if (response->tangential[d] == BD_BLOCK_FULL && response->with_normal[d])
            add_block(n, BD_BLOCK_FULL, 0.0, response->dTv[d], 1.0, change[2], to);
        if (limit != 0.0 && bd_element_has_friction(element, d)) {
            for (int i = 0; i < n; ++i) to[i] += limit * T[i];
            add_friction(element, n, d, response, -limit, away, to);
        }
        if (!springs)
            for (int i = 0; i < n; ++i)
                to[i] += relative_change(rate->kt[d], element->kt[d]) * T[i];
    }
    add_block(n, response->normal, element->kn, response->dN, 1.0, change[2], dF + 2 * n);
}
