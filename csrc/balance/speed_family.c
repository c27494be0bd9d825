/* Harmonic balance equations along the line omega = EO Omega, if all arrays change with the rotor
 * speed Omega.
 *
 * Each array a (stiffness, mass, damping, modes at the contact points, contact parameters, sliders,
 * static displacement, forces) is a polynomial of the squared speed p = (omega/EO)^2 through nodes
 * p_i in Lagrange form,
 *
 *     a(p) = sum_i l_i(p) a_i,
 *     l_i(p) = w_i prod_{k != i} (p - p_k),    w_i = 1/prod_{k != i} (p_i - p_k).
 *
 * The residual R(u, omega) = r(u, omega; a(p)) has the derivative along the line
 *
 *     R_omega = r_omega + r_a a',     a' = dp/domega sum_i l_i'(p) a_i.
 *
 * The arrays that enter linearly form a residual with a' instead of a. Harmonic by harmonic,
 *
 *     r_a a' = (K' - (l omega)^2 M' + i l omega C') q - E' + G'^H F + G^H F'.
 *
 * F' is the change of the contact force due to the motion X' = G' q + shift' and to the changing
 * contact parameters (contact/force_derivative.c). If J is computed, the tangents of the laws are
 * available, and R_omega costs little more than the polynomials. */
#include "balance/speed_family.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- all arrays in one row ---- */

static double *append(double *flat, const double *from, size_t n) {
    if (n > 0) memcpy(flat, from, sizeof(double) * n);
    return flat + n;
}

static const double *extract(const double *flat, double *to, size_t n) {
    if (n > 0) memcpy(to, flat, sizeof(double) * n);
    return flat + n;
}

static size_t count_modes(const bd_hbm *hbm) {
    size_t n = 0;
    for (int l = 0; l <= hbm->n_harm; ++l) n += (size_t)hbm->n_mode[l];
    return n;
}

/* Independent numbers of a row of G: real for the mean, real and imaginary for a harmonic. */
static size_t n_independent(const bd_hbm *hbm, int l) {
    return (size_t)((l == 0 ? 1 : 2) * hbm->n_mode[l]);
}

enum { OF_POINT = 8 }; /* parameters of a contact point */

static size_t count_values(const bd_hbm *hbm) {
    size_t n =
        3 * count_modes(hbm) + (size_t)hbm->n_unknown + (3 + OF_POINT) * (size_t)hbm->n_point;
    for (int l = 0; l <= hbm->n_harm; ++l) n += 3 * (size_t)hbm->n_point * n_independent(hbm, l);
    return n;
}

static void pack(const bd_hbm *hbm, double *flat) {
    const size_t n_mode = count_modes(hbm), n_component = 3 * (size_t)hbm->n_point;
    flat = append(flat, hbm->stiffness, n_mode);
    flat = append(flat, hbm->mass, n_mode);
    flat = append(flat, hbm->damping, n_mode);
    flat = append(flat, hbm->force, (size_t)hbm->n_unknown);
    flat = append(flat, hbm->shift, n_component);
    for (int p = 0; p < hbm->n_point; ++p) {
        const bd_element *e = hbm->element + p;
        const double parameter[OF_POINT] = {e->kt[0], e->kt[1], e->kn,   e->mu,
                                            e->n0,    e->w[0],  e->w[1], e->load};
        flat = append(flat, parameter, OF_POINT);
    }
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t n = n_independent(hbm, l);
        const size_t stride = l == 0 ? n : 2 * n;
        for (size_t i = 0; i < n_component; ++i) flat = append(flat, hbm->G[l] + i * stride, n);
    }
}

/* A harmonic has a second row of G for each component, (-Im G, Re G) below (Re G, Im G). */
static void unpack(const double *flat, bd_hbm *hbm) {
    const size_t n_mode = count_modes(hbm), n_component = 3 * (size_t)hbm->n_point;
    flat = extract(flat, hbm->stiffness, n_mode);
    flat = extract(flat, hbm->mass, n_mode);
    flat = extract(flat, hbm->damping, n_mode);
    flat = extract(flat, hbm->force, (size_t)hbm->n_unknown);
    flat = extract(flat, hbm->shift, n_component);
    for (int p = 0; p < hbm->n_point; ++p) {
        bd_element *e = hbm->element + p;
        e->kt[0] = flat[0];
        e->kt[1] = flat[1];
        e->kn = flat[2];
        e->mu = flat[3];
        e->n0 = flat[4];
        e->w[0] = flat[5];
        e->w[1] = flat[6];
        e->load = flat[7];
        flat += OF_POINT;
    }
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t n = n_independent(hbm, l), half = n / 2;
        const size_t stride = l == 0 ? n : 2 * n;
        for (size_t i = 0; i < n_component; ++i, flat += n) {
            double *row = hbm->G[l] + i * stride;
            extract(flat, row, n);
            if (l == 0) continue;
            for (size_t j = 0; j < half; ++j) row[n + j] = -flat[half + j];
            extract(flat, row + n + half, half);
        }
    }
}

/* ---- polynomials ---- */

/* Lagrange polynomials of the squared speed p. */
static void set_basis(bd_family *family, double p) {
    for (int i = 0; i < family->n_node; ++i) {
        double product = family->weight[i];
        for (int k = 0; k < family->n_node; ++k)
            if (k != i) product *= p - family->squared_speed[k];
        family->basis[i] = product;
    }
}

/* Derivatives of the polynomials with respect to the frequency; by_omega = dp/domega. */
static void set_basis_derivatives(bd_family *family, double p, double by_omega) {
    for (int i = 0; i < family->n_node; ++i) {
        double sum = 0.0;
        for (int j = 0; j < family->n_node; ++j) {
            if (j == i) continue;
            double product = family->weight[i];
            for (int k = 0; k < family->n_node; ++k)
                if (k != i && k != j) product *= p - family->squared_speed[k];
            sum += product;
        }
        family->basis[i] = by_omega * sum;
    }
}

/* Arrays of equations as sums of the nodes times the basis. */
static void interpolate(bd_family *family, bd_hbm *to) {
    memset(family->interpolated, 0, sizeof(double) * family->n_value);
    to->kernel->multiply_transposed((size_t)family->n_node, family->n_value, family->node_values,
                                    family->basis, family->interpolated);
    unpack(family->interpolated, to);
}

/* ---- equations along the line ---- */

static bd_status family_evaluate(bd_hbm *hbm, const double *u, double omega, double *r, double *J,
                                 double *r_omega) {
    bd_family *family = (bd_family *)hbm->variation;
    const size_t n = (size_t)hbm->n_unknown;
    const double speed = omega / family->order;
    const double p = speed * speed;
    const int within = p >= family->lowest && p <= family->highest;
    if (!within) return bd_hbm_evaluate_at(hbm, u, NAN, r, NULL, NULL);
    set_basis(family, p);
    interpolate(family, hbm);
    if (!r_omega) return bd_hbm_evaluate_at(hbm, u, omega, r, J, NULL);

    /* derivative of the contact forces with the arrays */
    bd_hbm *rate = &family->derivative;
    set_basis_derivatives(family, p, 2.0 * speed / family->order);
    interpolate(family, rate);
    bd_hbm_motion(rate, u);
    hbm->derivative = rate;
    const bd_status status = bd_hbm_evaluate_at(hbm, u, omega, r, J, r_omega);
    hbm->derivative = NULL;
    if (status != BD_OK) return status;

    /* derivative of the remainder: (dK) u + dG^T F + G^T dF */
    bd_hbm_linear_part(rate, u, omega, family->speed_derivative, NULL, NULL);
    bd_hbm_add_force(rate, hbm->F, family->speed_derivative);
    bd_hbm_add_force(hbm, rate->F, family->speed_derivative);
    double sum = 0.0; /* NaN if an entry is not finite */
    for (size_t i = 0; i < n; ++i) {
        r_omega[i] += family->speed_derivative[i];
        sum += 0.0 * r_omega[i];
    }
    return sum == 0.0 ? BD_OK : BD_NOT_FINITE;
}

/* ---- creation ---- */

static void family_destroy(bd_variation *variation) {
    bd_family *family = (bd_family *)variation;
    bd_hbm_destroy(&family->derivative);
    free(family->squared_speed);
    free(family->node_values);
    free(family->interpolated);
    free(family->speed_derivative);
    free(family);
}

static int same_sizes(const bd_hbm *a, const bd_hbm *b) {
    if (a->n_point != b->n_point || a->n_harm != b->n_harm) return 0;
    if (a->variation || b->variation) return 0;
    const size_t n_mode_bytes = sizeof(int) * ((size_t)a->n_harm + 1);
    if (memcmp(a->n_mode, b->n_mode, n_mode_bytes) != 0) return 0;
    for (int p = 0; p < a->n_point; ++p) {
        const bd_law law = a->element[p].law;
        if (law != b->element[p].law || law == BD_LAW_USER) return 0;
    }
    return 1;
}

static bd_status read_nodes(bd_family *family, const bd_hbm *const *node, const double *square) {
    const size_t n = (size_t)family->n_node;
    double low = square[0], high = square[0];
    for (size_t i = 0; i < n; ++i) {
        pack(node[i], family->node_values + i * family->n_value);
        family->squared_speed[i] = square[i];
        low = fmin(low, square[i]);
        high = fmax(high, square[i]);
        double product = 1.0;
        for (size_t k = 0; k < n; ++k)
            if (k != i) product *= square[i] - square[k];
        family->weight[i] = 1.0 / product;
        if (!isfinite(family->weight[i])) return BD_BAD_ARGUMENT;
    }
    for (size_t i = 0; i < n * family->n_value; ++i)
        if (!isfinite(family->node_values[i])) return BD_BAD_ARGUMENT;
    /* Chebyshev nodes lie inside the interval; its ends are closer to the outer nodes than this */
    const double beyond = 0.05 * (high - low);
    family->lowest = low - beyond;
    family->highest = high + beyond;
    return BD_OK;
}

bd_status bd_family_create(bd_hbm *hbm, const bd_hbm_input *input, int n_node,
                           const bd_hbm *const *node, const double *square, double order) {
    if (n_node < 2 || !(order > 0.0) || hbm->variation) return BD_BAD_ARGUMENT;
    for (int i = 0; i < n_node; ++i)
        if (!same_sizes(hbm, node[i])) return BD_BAD_ARGUMENT;
    bd_family *family = calloc(1, sizeof *family);
    if (!family) return BD_NO_MEMORY;
    bd_status status = bd_hbm_create(&family->derivative, input);
    if (status != BD_OK) {
        free(family);
        return status;
    }
    family->variation = (bd_variation){.evaluate = family_evaluate, .destroy = family_destroy};
    const size_t n = (size_t)n_node;
    family->n_node = n_node;
    family->order = order;
    family->n_value = count_values(hbm);
    family->squared_speed = malloc(sizeof(double) * 3 * n);
    family->node_values = malloc(sizeof(double) * (n * family->n_value + BD_KERNEL_PAD));
    family->interpolated = malloc(sizeof(double) * (family->n_value + BD_KERNEL_PAD));
    family->speed_derivative = malloc(sizeof(double) * ((size_t)hbm->n_unknown + BD_KERNEL_PAD));
    if (!family->squared_speed || !family->node_values || !family->interpolated ||
        !family->speed_derivative) {
        family_destroy(&family->variation);
        return BD_NO_MEMORY;
    }
    family->weight = family->squared_speed + n;
    family->basis = family->weight + n;
    status = read_nodes(family, node, square);
    if (status != BD_OK) {
        family_destroy(&family->variation);
        return status;
    }
    hbm->variation = &family->variation;
    return BD_OK;
}
