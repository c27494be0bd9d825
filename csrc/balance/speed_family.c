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

/* Copy n numbers to `flat`; return the place after them. */
static double *append(double *flat, const double *from, size_t n) {
    if (n > 0) memcpy(flat, from, sizeof(double) * n);
    return flat + n;
}

/* Copy n numbers from `flat`; return the place after them. */
static const double *extract(const double *flat, double *to, size_t n) {
    if (n > 0) memcpy(to, flat, sizeof(double) * n);
    return flat + n;
}

/* Number of modes of all harmonics. */
static size_t count_modes(const bd_hbm *hbm) {
    size_t n = 0;
    for (int l = 0; l <= hbm->n_harm; ++l) n += (size_t)hbm->n_mode[l];
    return n;
}

/* Independent numbers of a row of G: real for the mean, real and imaginary for a harmonic. */
static size_t n_independent(const bd_hbm *hbm, int l) {
    return (size_t)((l == 0 ? 1 : 2) * hbm->n_mode[l]);
}

/* Parameters of a contact point, in the order of their numbers. */
enum { KT1, KT2, KN, MU, N0, W1, W2, LOAD, N_PARAMETER };

/* Numbers of all arrays in one row: stiffness, mass and damping (n_mode each), force (n_unknown),
 * shift (3) and parameters of each point, and the independent numbers of the rows of G. */
static size_t count_values(const bd_hbm *hbm) {
    const size_t n_point = (size_t)hbm->n_point, n_component = BD_N_COMPONENT * n_point;
    size_t n = 3 * count_modes(hbm) + (size_t)hbm->n_unknown;
    n += n_component + N_PARAMETER * n_point;
    for (int l = 0; l <= hbm->n_harm; ++l) n += n_component * n_independent(hbm, l);
    return n;
}

/* Write all arrays of the equations to one row (count_values). */
static void pack(const bd_hbm *hbm, double *flat) {
    const size_t n_mode = count_modes(hbm), n_component = BD_N_COMPONENT * (size_t)hbm->n_point;
    flat = append(flat, hbm->stiffness, n_mode);
    flat = append(flat, hbm->mass, n_mode);
    flat = append(flat, hbm->damping, n_mode);
    flat = append(flat, hbm->force, (size_t)hbm->n_unknown);
    flat = append(flat, hbm->shift, n_component);
    for (int p = 0; p < hbm->n_point; ++p) {
        const bd_element *e = hbm->element + p;
        const double parameter[N_PARAMETER] = {
            [KT1] = e->kt[0], [KT2] = e->kt[1], [KN] = e->kn,   [MU] = e->mu,
            [N0] = e->n0,     [W1] = e->w[0],   [W2] = e->w[1], [LOAD] = e->load,
        };
        flat = append(flat, parameter, N_PARAMETER);
    }
    /* the sine row (-Im G, Re G) follows from the cosine row (Re G, Im G) */
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t n = n_independent(hbm, l);
        const size_t of_component = l == 0 ? n : 2 * n;
        for (size_t i = 0; i < n_component; ++i)
            flat = append(flat, hbm->G[l] + i * of_component, n);
    }
}

/* Read all arrays of the equations from one row (count_values). G has one row Re G for the mean of
 * a component, and two rows for a harmonic: (Re G, Im G), which is stored, and (-Im G, Re G). */
static void unpack(const double *flat, bd_hbm *hbm) {
    const size_t n_mode = count_modes(hbm), n_component = BD_N_COMPONENT * (size_t)hbm->n_point;
    flat = extract(flat, hbm->stiffness, n_mode);
    flat = extract(flat, hbm->mass, n_mode);
    flat = extract(flat, hbm->damping, n_mode);
    flat = extract(flat, hbm->force, (size_t)hbm->n_unknown);
    flat = extract(flat, hbm->shift, n_component);
    for (int p = 0; p < hbm->n_point; ++p) {
        bd_element *e = hbm->element + p;
        e->kt[0] = flat[KT1];
        e->kt[1] = flat[KT2];
        e->kn = flat[KN];
        e->mu = flat[MU];
        e->n0 = flat[N0];
        e->w[0] = flat[W1];
        e->w[1] = flat[W2];
        e->load = flat[LOAD];
        flat += N_PARAMETER;
    }
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t n = n_independent(hbm, l), n_mode_l = (size_t)hbm->n_mode[l];
        const size_t of_component = l == 0 ? n : 2 * n;
        for (size_t i = 0; i < n_component; ++i, flat += n) {
            double *cosine_row = hbm->G[l] + i * of_component, *sine_row = cosine_row + n;
            extract(flat, cosine_row, n);
            if (l == 0) continue;
            const double *re = flat, *im = flat + n_mode_l;
            for (size_t j = 0; j < n_mode_l; ++j) sine_row[j] = -im[j];
            extract(re, sine_row + n_mode_l, n_mode_l);
        }
    }
}

/* ---- polynomials ---- */

/* Values of the Lagrange polynomials of the nodes p_i at the squared speed p,
 *
 *     basis_i = w_i prod_{k != i} (p - p_k),   w_i = 1/prod_{k != i} (p_i - p_k). */
static void set_basis(bd_family *family, double p) {
    for (int i = 0; i < family->n_node; ++i) {
        double product = family->weight[i];
        for (int k = 0; k < family->n_node; ++k)
            if (k != i) product *= p - family->squared_speed[k];
        family->basis[i] = product;
    }
}

/* Derivatives of the Lagrange polynomials at the squared speed p with respect to the frequency,
 *
 *     basis_i = dp/domega w_i sum_{j != i} prod_{k != i, j} (p - p_k),   by_omega = dp/domega. */
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

/* Set the arrays of equations to sum_i basis_i a_i with the arrays a_i at the nodes. Depending on
 * the basis, these are values or derivatives. */
static void interpolate(bd_family *family, bd_hbm *to) {
    memset(family->interpolated, 0, sizeof(double) * family->n_value);
    to->kernel->multiply_transposed((size_t)family->n_node, family->n_value, family->node_values,
                                    family->basis, family->interpolated);
    unpack(family->interpolated, to);
}

/* ---- equations along the line ---- */

/* Evaluate the residual r, and unless NULL J and r_omega, at the speed omega/order. Its square p
 * determines all arrays a. r_omega is the derivative along the line: the derivative at constant
 * arrays plus r_a a'. Outside the range of the nodes, return BD_NOT_FINITE. */
static bd_status family_evaluate(bd_hbm *hbm, const double *u, double omega, double *r, double *J,
                                 double *r_omega) {
    bd_family *family = (bd_family *)hbm->variation;
    const size_t n = (size_t)hbm->n_unknown;
    const double speed = omega / family->order;
    const double p = speed * speed;
    const int within = p >= family->lowest && p <= family->highest;
    if (!within) return bd_hbm_evaluate_at(hbm, u, NAN, r, NULL, NULL); /* not finite */
    set_basis(family, p);
    interpolate(family, hbm);
    if (!r_omega) return bd_hbm_evaluate_at(hbm, u, omega, r, J, NULL);

    /* arrays of `rate` are the derivatives a', its X and F those of motion and contact forces */
    bd_hbm *rate = &family->derivative;
    const double dp_domega = 2.0 * speed / family->order;
    set_basis_derivatives(family, p, dp_domega);
    interpolate(family, rate);
    bd_hbm_motion(rate, u);
    hbm->derivative = rate;
    const bd_status status = bd_hbm_evaluate_at(hbm, u, omega, r, J, r_omega);
    hbm->derivative = NULL;
    if (status != BD_OK) return status;

    /* r_a a' = (K' - (l omega)^2 M' + i l omega C') u - E' + G'^T F + G^T F' */
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

/* Return whether two equations have the same points, harmonics, modes and contact laws, so that
 * their arrays can be interpolated. User laws cannot. */
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

/* Store the nodes: for each, its squared speed p_i, all arrays of its equations in one row, and the
 * barycentric weight w_i = 1/prod_{k != i} (p_i - p_k) of its Lagrange polynomial. Also set the
 * range of squared speeds in which the polynomials are evaluated. Two equal speeds, or arrays that
 * are not finite, are a bad argument. */
static bd_status read_nodes(bd_family *family, const bd_hbm *const *node, const double *square) {
    /* The nodes are Chebyshev points of an interval, whose ends lie beyond the outer nodes: for 4
     * points by 4.1 % of the span of the nodes, for 6 points by 1.8 %. */
    static const double MARGIN = 0.05; /* of the span of the nodes */
    const size_t n = (size_t)family->n_node, n_value = family->n_value;
    double lowest_node = square[0], highest_node = square[0];
    for (size_t i = 0; i < n; ++i) {
        pack(node[i], family->node_values + i * n_value);
        family->squared_speed[i] = square[i];
        lowest_node = fmin(lowest_node, square[i]);
        highest_node = fmax(highest_node, square[i]);

        double differences = 1.0; /* prod_{k != i} (p_i - p_k) */
        for (size_t k = 0; k < n; ++k)
            if (k != i) differences *= square[i] - square[k];
        family->weight[i] = 1.0 / differences;
        if (!isfinite(family->weight[i])) return BD_BAD_ARGUMENT;
    }
    for (size_t i = 0; i < n * n_value; ++i)
        if (!isfinite(family->node_values[i])) return BD_BAD_ARGUMENT;

    const double margin = MARGIN * (highest_node - lowest_node);
    family->lowest = lowest_node - margin;
    family->highest = highest_node + margin;
    return BD_OK;
}

/* Let the equations hbm depend on the rotor speed: their matrices are interpolated between those of
 * n_node equal models at the squared speeds `square` (n_node). The speed follows from omega and the
 * engine order. */
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
