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

/* Add factor times a block (n, n) of the tangent times x; a linear block is spring times I. */
static void add_block(int n, bd_block kind, double spring, const double *block, double factor,
                      const double *x, double *to) {
    if (kind == BD_BLOCK_LINEAR) {
        for (int i = 0; i < n; ++i) to[i] += factor * spring * x[i];
    }
    if (kind != BD_BLOCK_FULL) return;
    for (int i = 0; i < n; ++i) {
        const double *row = block + (size_t)i * (size_t)n;
        double sum = 0.0;
        for (int j = 0; j < n; ++j) sum += row[j] * x[j];
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

/* Relative change of the friction limit: of mu and, if it is given, of the load. */
static double relative_change_of_limit(const bd_element *element, const bd_element *rate) {
    const double by_friction = relative_change(rate->mu, element->mu);
    if (!bd_law_is_constant(element->law)) return by_friction;
    return by_friction + relative_change(rate->load, element->load);
}

/* Change of X (3, n) that has the same effect as the changes of motion and parameters, and the
 * stretch u - w (2, n) of the tangential springs. */
static void equivalent_change(const bd_element *element, const bd_element *rate, int n,
                              const double *X, const double *dX, double (*change)[BD_MAX_COEF],
                              double (*stretch)[BD_MAX_COEF]) {
    const size_t bytes = sizeof(double) * (size_t)n;
    for (int a = 0; a < 3; ++a) memcpy(change[a], dX + a * n, bytes);

    for (int d = 0; d < 2; ++d) {
        memcpy(stretch[d], X + d * n, bytes);
        /* a cubic spring has no slider, and its stiffness does not act like a motion */
        if (element->law == BD_LAW_CUBIC) continue;
        stretch[d][0] -= element->w[d];
        const double stiffer = relative_change(rate->kt[d], element->kt[d]);
        for (int i = 0; i < n; ++i) change[d][i] += stiffer * stretch[d][i];
        change[d][0] -= rate->w[d];
    }

    const double *v = X + 2 * n;
    const double stiffer = relative_change(rate->kn, element->kn);
    for (int i = 0; i < n; ++i) change[2][i] += stiffer * v[i];
    change[2][0] += relative_change(rate->n0, element->kn);
}

/* Derivative dF (3, n_coef) of the forces of a point, if its parameters change at `rate` and its
 * motion X (3, n_coef) at dX. `response` has the forces and tangents at X. A change of the stiffness
 * acts like a change of the motion (equivalent_change), so the tangents give its effect. Only a
 * relative change of the friction limit mu N needs more: mu dT/dmu = T - B_u (u - w), where B_u is
 * the tangent dT/du and `stretch` is u - w. */
void bd_force_derivative(const bd_element *element, const bd_element *rate, int n_harm,
                         const double *X, const double *dX, const bd_response *response,
                         double *dF) {
    const int n = bd_n_coef(n_harm);
    double change[3][BD_MAX_COEF], stretch[2][BD_MAX_COEF];
    equivalent_change(element, rate, n, X, dX, change, stretch);
    const double limit = relative_change_of_limit(element, rate);

    memset(dF, 0, sizeof(double) * 3 * (size_t)n);
    for (int d = 0; d < 2; ++d) {
        double *dT = dF + d * n;
        const double *T = response->F + d * n;
        add_friction(element, n, d, response, 1.0, change, dT);
        if (response->tangential[d] == BD_BLOCK_FULL && response->with_normal[d])
            add_block(n, BD_BLOCK_FULL, 0.0, response->dTv[d], 1.0, change[2], dT);

        /* mu dT/dmu = T - B_u (u - w) */
        if (limit != 0.0 && bd_element_has_friction(element, d)) {
            for (int i = 0; i < n; ++i) dT[i] += limit * T[i];
            add_friction(element, n, d, response, -limit, stretch, dT);
        }

        if (element->law == BD_LAW_CUBIC) {
            const double stiffer = relative_change(rate->kt[d], element->kt[d]);
            for (int i = 0; i < n; ++i) dT[i] += stiffer * T[i];
        }
    }
    add_block(n, response->normal, element->kn, response->dN, 1.0, change[2], dF + 2 * n);
}
