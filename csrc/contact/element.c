/* Force coefficients (paper, Eq. (15)) and tangent from the sums over a cycle.
 *
 * At every instant, one tangential direction is in one of the states
 *
 *     stick   T = kt (u - w)                w constant since it was set at theta*
 *     slip+-  T = +- mu N,   N = n0 + kn v
 *     open    T = 0
 *
 * Projection on the basis b needs the integrals of b b^T over the parts in each state. Products of
 * sines and cosines are sums of exponentials. With E_n = int exp(i n theta) over such parts,
 *
 *     int cos_l cos_m = Re(E_{l-m} + E_{l+m})/2
 *     int sin_l sin_m = Re(E_{l-m} - E_{l+m})/2
 *     int cos_l sin_m = Im(E_{l+m} + E_{m-l})/2,      E_{-n} = conj E_n.
 *
 * Let Gs and Gp - Gm be these matrices over the sticking and slipping parts, and gs, gp - gm the
 * integrals of b. Then
 *
 *     T  = kt (Gs u - sum_parts g w) + mu n0 (gp - gm) + mu kn (Gp - Gm) v
 *     dT = kt (Gs - sum_parts g dw/du^T) du + (mu kn (Gp - Gm) - kt sum_parts g dw/dv^T) dv.
 *
 * The force is continuous at a change of state, so moving such an instant has no first-order
 * effect. Rows are scaled by 1/(2 pi) for the mean and 1/pi for the harmonics. A quadrature instead
 * of the integrals yields the sampled evaluation with the same formulas.
 *
 * A cubic spring T = k u^3 has dT = 3 k u^2 du. Its tangent is three times the matrix of products
 * with the weight k u^2, E_n = int k u^2 exp(i n theta). With u = sum_n a_n exp(i n theta), the
 * weight has the coefficients k sum_m a_m a_{n-m}; those beyond 2 n_harm are zero. */
#include "contact/element.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Set all sums of a cycle to zero; a cycle without a tangent has no sums of derivatives. */
void bd_cycle_clear(bd_cycle *cycle) {
    const size_t n_coef = (size_t)bd_n_coef(cycle->n_harm);
    const size_t n_power = (size_t)bd_n_power(cycle->n_harm);
    memset(cycle->stick, 0, sizeof(double) * n_power);
    memset(cycle->slip, 0, sizeof(double) * n_power);
    memset(cycle->stick_slider, 0, sizeof(double) * n_coef);
    if (!cycle->stick_slider_u) return;
    memset(cycle->stick_slider_u, 0, sizeof(double) * n_coef * n_coef);
    memset(cycle->stick_slider_v, 0, sizeof(double) * n_coef * n_coef);
}

/* E_n += sign int exp(i n theta) over [start, end], n = 0 .. 2 n_harm, stored as [E_0, E_0, Re E_1,
 * Im E_1, ...]: (end - start) for n = 0, and (exp(i n end) - exp(i n start))/(i n) from the powers
 * of exp(i theta) at both ends. */
void bd_cycle_integrate(int n_harm, double *E, double length, const double *start,
                        const double *end, double sign) {
    E[0] += sign * length;
    E[1] = E[0];
    for (int n = 1; n <= 2 * n_harm; ++n) {
        const double factor = sign / n;
        E[2 * n] += factor * (end[2 * n + 1] - start[2 * n + 1]);
        E[2 * n + 1] -= factor * (end[2 * n] - start[2 * n]);
    }
}

/* Add a sticking part with the slider w, its derivatives dw/du and dw/dv (n_coef, NULL: constant)
 * and the integral g (n_coef) of the basis: stick_slider += w g, stick_slider_u += g (dw/du)^T,
 * stick_slider_v += g (dw/dv)^T. */
void bd_cycle_add_stick(bd_cycle *cycle, const double *g, double w, const double *du_part,
                        const double *dv_part) {
    const int n_coef = bd_n_coef(cycle->n_harm);
    for (int i = 0; i < n_coef; ++i) cycle->stick_slider[i] += w * g[i];
    if (!cycle->stick_slider_u || !du_part) return;
    for (int i = 0; i < n_coef; ++i) {
        double *restrict row_u = cycle->stick_slider_u + (size_t)i * (size_t)n_coef;
        double *restrict row_v = cycle->stick_slider_v + (size_t)i * (size_t)n_coef;
        for (int j = 0; j < n_coef; ++j) {
            row_u[j] += g[i] * du_part[j];
            row_v[j] += g[i] * dv_part[j];
        }
    }
}

/* Integrals of products of basis functions, products (n_coef, n_coef), from E_n = int exp(i n
 * theta), stored as [E_0, E_0, Re E_1, Im E_1, ...]:
 *
 *     int cos_l cos_m = Re(E_{l-m} + E_{l+m})/2      int cos_l sin_m = Im(E_{l+m} + E_{m-l})/2
 *     int sin_l sin_m = Re(E_{l-m} - E_{l+m})/2      int sin_l cos_m = Im(E_{l+m} - E_{m-l})/2. */
void bd_cycle_products(int n_harm, const double *E, double *products) {
    const size_t n_coef = (size_t)bd_n_coef(n_harm);
    const double *g = E + 1; /* integrals of the basis: products with its constant */
    for (size_t j = 0; j < n_coef; ++j) products[j] = products[j * n_coef] = g[j];
    for (int l = 1; l <= n_harm; ++l) {
        double *cos_row = products + (size_t)(2 * l - 1) * n_coef;
        double *sin_row = cos_row + n_coef;
        for (int m = 1; m <= n_harm; ++m) {
            /* E_{m-l}, from its conjugate if m < l, and E_{l+m} */
            const int d = l > m ? l - m : m - l;
            const int s = l + m;
            const double re_d = E[2 * d];
            double im_d = 0.0;
            if (m > l) im_d = E[2 * d + 1];
            if (m < l) im_d = -E[2 * d + 1];
            const double re_s = E[2 * s], im_s = E[2 * s + 1];
            cos_row[2 * m - 1] = 0.5 * (re_d + re_s);
            cos_row[2 * m] = 0.5 * (im_s + im_d);
            sin_row[2 * m - 1] = 0.5 * (im_s - im_d);
            sin_row[2 * m] = 0.5 * (re_d - re_s);
        }
    }
}

/* Factor from an integral over the period with basis function i to Fourier coefficient i: 1/(2 pi)
 * for the mean, 1/pi for cosines and sines. */
static double row_scale(int i) { return i == 0 ? 1.0 / BD_TWO_PI : 1.0 / BD_PI; }

/* Force and tangent of the parts that stick: kt (Gs u - sum_parts g w). */
static void sticking_part(double kt, const bd_cycle *cycle, const double *u, double *F, double *dT,
                          double *products) {
    const int n_coef = bd_n_coef(cycle->n_harm);
    bd_cycle_products(cycle->n_harm, cycle->stick, products);
    for (int i = 0; i < n_coef; ++i) {
        const double scale = row_scale(i);
        const size_t first = (size_t)i * (size_t)n_coef; /* of row i */
        const double *Gs = products + first;
        double sum = -cycle->stick_slider[i];
        for (int j = 0; j < n_coef; ++j) sum += Gs[j] * u[j];
        F[i] = scale * kt * sum;
        if (!cycle->stick_slider_u) continue;

        const double *slider_u = cycle->stick_slider_u + first;
        for (int j = 0; j < n_coef; ++j) dT[first + (size_t)j] = scale * kt * (Gs[j] - slider_u[j]);
    }
}

/* Add the terms with v: mu kn (Gp - Gm) v, and in the tangent also the slider. */
static void part_of_normal_motion(double kt, double mu_kn, const bd_cycle *cycle, const double *v,
                                  double *F, double *dTv, double *products) {
    const int n_coef = bd_n_coef(cycle->n_harm);
    bd_cycle_products(cycle->n_harm, cycle->slip, products);
    for (int i = 0; i < n_coef; ++i) {
        const double scale = row_scale(i);
        const size_t first = (size_t)i * (size_t)n_coef; /* of row i */
        const double *Gpm = products + first;
        double sum = 0.0;
        for (int j = 0; j < n_coef; ++j) sum += Gpm[j] * v[j];
        F[i] += scale * mu_kn * sum;
        if (!cycle->stick_slider_u) continue;

        const double *slider_v = cycle->stick_slider_v + first;
        for (int j = 0; j < n_coef; ++j)
            dTv[first + (size_t)j] = scale * (mu_kn * Gpm[j] - kt * slider_v[j]);
    }
}

/* Friction force F_d (n_coef) and tangent of direction d from the sums over its cycle,
 *
 *     T = kt (Gs u - sum_parts g w) + mu n0 (gp - gm) + mu kn (Gp - Gm) v,
 *
 * with the products Gs and Gp - Gm of basis functions over parts that stick and slip, and gp - gm
 * the integral of the basis over parts that slip. Under a constant load, it replaces n0, and kn =
 * 0. */
void bd_cycle_friction(const bd_element *element, int d, const bd_cycle *cycle, const double *u,
                       const double *v, bd_response *out, double *scratch) {
    const int n_coef = bd_n_coef(cycle->n_harm);
    const int constant_load = bd_law_is_constant(element->law);
    const double kt = element->kt[d], mu = element->mu;
    double *F = out->F + (size_t)d * (size_t)n_coef;
    out->tangential[d] = BD_BLOCK_FULL;
    sticking_part(kt, cycle, u, F, out->dT[d], scratch);

    /* slip under the load at v = 0, or under the constant load */
    const double load = constant_load ? fmax(element->load, 0.0) : element->n0;
    const double *slip_basis = cycle->slip + 1; /* gp - gm */
    for (int i = 0; i < n_coef; ++i) F[i] += row_scale(i) * mu * load * slip_basis[i];

    const double mu_kn = constant_load ? 0.0 : mu * element->kn;
    out->with_normal[d] = mu_kn > 0.0;
    if (mu_kn == 0.0) return;
    part_of_normal_motion(kt, mu_kn, cycle, v, F, out->dTv[d], scratch);
}

/* Normal force N = n0 g + kn G v in coefficients (n_coef), and its tangent kn G, with the integrals
 * g of the basis and the products G (n_coef, n_coef) over the parts in contact. */
void bd_cycle_normal(const bd_element *element, int n_harm, const double *contact, const double *v,
                     bd_response *out, double *scratch) {
    const int n_coef = bd_n_coef(n_harm);
    const double kn = element->kn;
    const double *basis = contact + 1; /* integrals of the basis over the parts in contact */
    double *N = out->F + BD_NORMAL * (size_t)n_coef;
    bd_cycle_products(n_harm, contact, scratch);
    for (int i = 0; i < n_coef; ++i) {
        const double scale = row_scale(i);
        const size_t first = (size_t)i * (size_t)n_coef; /* of row i */
        const double *G = scratch + first;
        double sum = element->n0 * basis[i];
        for (int j = 0; j < n_coef; ++j) sum += kn * G[j] * v[j];
        N[i] = scale * sum;
        if (!out->dN) continue;
        for (int j = 0; j < n_coef; ++j) out->dN[first + (size_t)j] = scale * kn * G[j];
    }
    out->normal = BD_BLOCK_FULL;
}

/* Normal force of a point that is in contact throughout the cycle, N = n0 + kn v for the motion v
 * (n_coef). The preload n0 belongs to the mean, coefficient 0. The tangent is kn times the identity;
 * its blocks are not written (BD_BLOCK_LINEAR). */
void bd_element_closed(const bd_element *element, int n_harm, const double *v, bd_response *out) {
    const int n_coef = bd_n_coef(n_harm);
    double *N = out->F + BD_NORMAL * (size_t)n_coef;
    for (int i = 0; i < n_coef; ++i) N[i] = element->kn * v[i];
    N[0] += element->n0;
    out->normal = BD_BLOCK_LINEAR;
}

/* Friction force of direction d of a point that sticks throughout the cycle, T = kt (u - w) for the
 * motion u (n_coef). The slider w is constant, so it affects the mean, coefficient 0, only. The
 * tangent is kt times the identity. */
void bd_element_stuck(const bd_element *element, int n_harm, int d, const double *u,
                      bd_response *out) {
    const int n_coef = bd_n_coef(n_harm);
    const double kt = element->kt[d];
    double *T = out->F + (size_t)d * (size_t)n_coef;
    for (int i = 0; i < n_coef; ++i) T[i] = kt * u[i];
    T[0] -= kt * element->w[d];
    out->tangential[d] = BD_BLOCK_LINEAR;
}

/* No forces and no tangent: the point is open throughout the cycle. */
void bd_element_open(const bd_element *element, int n_harm, bd_response *out) {
    (void)element;
    memset(out->F, 0, sizeof(double) * 3 * (size_t)bd_n_coef(n_harm));
    for (int d = 0; d < 2; ++d) {
        out->tangential[d] = BD_BLOCK_ZERO;
        out->with_normal[d] = 0;
    }
    out->normal = BD_BLOCK_ZERO;
    out->coupled = 0;
    out->with_tangential = 0;
}

/* Real part of the complex coefficient a_n of u = sum_n a_n exp(i n theta): a_0 = u_0,
 * a_l = (c_l - i s_l)/2 = conj a_{-l}, zero beyond n_harm. */
static double real_part(const double *u, int n_harm, int n) {
    const int l = abs(n);
    if (l > n_harm) return 0.0;
    return l == 0 ? u[0] : 0.5 * u[2 * l - 1];
}

/* Imaginary part of the complex coefficient a_n of u = sum_n a_n exp(i n theta): -s_l/2 for n = l >
 * 0, s_l/2 for n = -l. */
static double imaginary_part(const double *u, int n_harm, int n) {
    const int l = abs(n);
    if (l > n_harm || l == 0) return 0.0;
    return (n > 0 ? -0.5 : 0.5) * u[2 * l];
}

/* E_n = int k u^2 exp(i n theta), n = 0 .. 2 n_harm: 2 pi k times the conjugate of coefficient n of
 * u^2, sum_m a_m a_{n-m}, with the coefficients a_n of u = sum_n a_n exp(i n theta). */
static void weight_of_cubic(double k, int n_harm, const double *u, double *E) {
    for (int n = 0; n <= 2 * n_harm; ++n) {
        double re = 0.0, im = 0.0;
        for (int m = n - n_harm; m <= n_harm; ++m) {
            const double a = real_part(u, n_harm, m);
            const double b = imaginary_part(u, n_harm, m);
            const double c = real_part(u, n_harm, n - m);
            const double d = imaginary_part(u, n_harm, n - m);
            re += a * c - b * d;
            im += a * d + b * c;
        }
        E[2 * n] = k * BD_TWO_PI * re;
        E[2 * n + 1] = -k * BD_TWO_PI * im;
    }
    E[1] = E[0];
}

/* Coefficients F (n_coef) of the weight k u^2 times u. With conj E_n/(2 pi) the coefficients of the
 * weight and a_n the ones of u, coefficient l of the product is sum_m conj E_{l-m} a_m/(2 pi). */
static void force_of_weight(int n_harm, const double *E, const double *u, double *F) {
    for (int l = 0; l <= n_harm; ++l) {
        double re = 0.0, im = 0.0; /* coefficient l of the product, times 2 pi */
        for (int m = -n_harm; m <= n_harm; ++m) {
            /* coefficient l - m of the weight, conj E_{l-m}; |l - m| is at most 2 n_harm */
            const int k = l - m, at = 2 * abs(k);
            const double a = E[at];
            double b = 0.0;
            if (k > 0) b = -E[at + 1];
            if (k < 0) b = E[at + 1];
            const double c = real_part(u, n_harm, m);
            const double d = imaginary_part(u, n_harm, m);
            re += a * c - b * d;
            im += a * d + b * c;
        }
        if (l == 0) {
            F[0] = re / BD_TWO_PI;
        } else {
            F[2 * l - 1] = re / BD_PI;
            F[2 * l] = -im / BD_PI;
        }
    }
}

/* Force T = k u^3 and tangent of the cubic springs in both tangential directions, for the motion x
 * (3, n_coef). T is the weight k u^2 times u, and its tangent three times the matrix of products
 * with this weight, because dT = 3 k u^2 du. The products are integrals over the cycle, which
 * row_scale turns into coefficients. The normal direction has no force. */
void bd_element_cubic(const bd_element *element, int n_harm, const double *x, bd_response *out) {
    const size_t n = (size_t)bd_n_coef(n_harm);
    double E[4 * BD_MAX_HARM + 2];
    bd_element_open(element, n_harm, out);
    for (int d = 0; d < 2; ++d) {
        const double *u = x + (size_t)d * n;
        double *F = out->F + (size_t)d * n, *dT = out->dT[d];
        if (element->kt[d] == 0.0) continue;
        weight_of_cubic(element->kt[d], n_harm, u, E);
        force_of_weight(n_harm, E, u, F);
        if (!dT) continue;

        bd_cycle_products(n_harm, E, dT);
        for (size_t i = 0; i < n; ++i)
            for (size_t j = 0; j < n; ++j) dT[i * n + j] *= 3.0 * row_scale((int)i);
        out->tangential[d] = BD_BLOCK_FULL;
    }
}

static void set_diagonal(double *block, int n_coef, double value) {
    const size_t n = (size_t)n_coef;
    memset(block, 0, sizeof(double) * n * n);
    for (size_t i = 0; i < n; ++i) block[i * n + i] = value;
}

bd_block bd_element_form(const bd_response *out) {
    const bd_block form = out->normal;
    const int all_equal = out->tangential[0] == form && out->tangential[1] == form;
    return all_equal ? form : BD_BLOCK_FULL;
}

/* Write the tangent blocks (n_coef, n_coef) that an evaluation left out: zero, or the diagonal of a
 * spring. Blocks between components are written by an evaluation only if the direction has a full
 * tangent; dTc and dNt may have no memory (NULL). */
void bd_element_write_blocks(const bd_element *element, int n_harm, bd_response *out) {
    const int n_coef = bd_n_coef(n_harm);
    for (int d = 0; d < 2; ++d) {
        const int is_full = out->tangential[d] == BD_BLOCK_FULL;
        const int is_linear = out->tangential[d] == BD_BLOCK_LINEAR;
        if (!is_full) set_diagonal(out->dT[d], n_coef, is_linear ? element->kt[d] : 0.0);
        if (!is_full || !out->with_normal[d]) set_diagonal(out->dTv[d], n_coef, 0.0);
        /* derivatives with respect to the other direction */
        const int with_other = is_full && out->coupled;
        if (out->dTc[d] && !with_other) set_diagonal(out->dTc[d], n_coef, 0.0);
        if (out->dNt[d] && !out->with_tangential) set_diagonal(out->dNt[d], n_coef, 0.0);
    }
    const int is_linear = out->normal == BD_BLOCK_LINEAR;
    if (out->normal != BD_BLOCK_FULL) set_diagonal(out->dN, n_coef, is_linear ? element->kn : 0.0);
}
