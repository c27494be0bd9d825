/* Residual and Jacobian of the harmonic balance equations in modal coordinates (paper, Eq. (16)).
 *
 * With the modal amplitudes q_l = c_l - i s_l of harmonic l, the relative motion at the contact
 * points and the residual are
 *
 *     (u1, u2, v)_l = G_l q_l
 *     r_l = (K - (l omega)^2 M + i l omega C) q_l + G_l^H F_l - E_l,
 *
 * with diagonal K, M, C. In real numbers, with one row for the cosine and one for the sine part of
 * each component,
 *
 *     Gr_l = [  Re G   Im G ]     acts on [c; s] and gives (cosine, sine);
 *            [ -Im G   Re G ]     its transpose gives modal forces, since
 *                                 G^H F = (Re G^T Fc - Im G^T Fs, ...).
 *
 * The contact law couples the harmonics at a point by a tangent B = dF/dX, hence J_lm = Gr_l^T B_lm
 * Gr_m + linear part. First Z = B Gr is computed for a chunk of components that fits the cache,
 * then one matrix product for each harmonic.
 *
 * Only components with a full B need these products. A component that sticks (or stays in contact)
 * through the cycle has B = k I and couples no harmonics. The sum K = Gr^T k Gr over all points is
 * computed once for each of the three components of motion. An evaluation either starts from K and
 * subtracts the components that are not linear, or starts from zero and adds the linear ones,
 * depending on which are fewer. Thus open components cost nothing, and without sticking points J
 * contains no rounding error of K - K. */
#include "balance/harmonic_balance.h"

#include "util/clock.h"
#include "contact/force_derivative.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Rows of harmonic l for each component of motion: the mean, or cosine and sine. Z and F hold the
 * rows of all harmonics in this order. */
static int n_row(int l) { return l == 0 ? 1 : 2; }

/* First of these rows: mean 0, then cosine 2 l - 1 and sine 2 l of harmonic l. */
static int first_row(int l) { return l == 0 ? 0 : 2 * l - 1; }

static void copy(double *to, const double *from, size_t n) {
    if (n > 0) memcpy(to, from, sizeof(double) * n);
}

/* Gr_l of each component from the complex interleaved G_l (n_component, n_mode): (2, 2 n_mode),
 *
 *     cosine row   Re G   Im G
 *     sine row    -Im G   Re G,
 *
 * and Re G (1, n_mode) for the mean, l = 0. */
static void expand_modes(double *real, const double *complex_G, size_t n_component, int n_mode,
                         int l) {
    const size_t n = (size_t)n_mode, size = l == 0 ? n : 4 * n;
    for (size_t i = 0; i < n_component; ++i) {
        const double *from = complex_G + 2 * i * n;
        double *cosine_row = real + i * size, *sine_row = cosine_row + 2 * n;
        for (size_t j = 0; j < n; ++j) {
            const double re = from[2 * j], im = from[2 * j + 1];
            cosine_row[j] = re;
            if (l == 0) continue;
            cosine_row[n + j] = im;
            sine_row[j] = -im;
            sine_row[n + j] = re;
        }
    }
}

/* Parameters of each contact point from the arrays of the input. Without an array of constant loads,
 * the load is n0. */
static void set_elements(bd_hbm *hbm, const bd_hbm_input *in) {
    for (int p = 0; p < in->n_point; ++p) {
        hbm->element[p] = (bd_element){
            .law = (bd_law)in->law[p],
            .kt = {in->kt[2 * p], in->kt[2 * p + 1]},
            .kn = in->kn[p],
            .mu = in->mu[p],
            .n0 = in->n0[p],
            .w = {in->w[2 * p], in->w[2 * p + 1]},
            .load = in->load ? in->load[p] : in->n0[p],
            .point_law = hbm->point_law + p,
        };
    }
}

/* Stiffness of the spring of component a (tangential 0 and 1, normal) of a point, 0 if it has
 * none. */
static double spring(const bd_element *element, int a) {
    if (element->law == BD_LAW_USER) return 0.0; /* unknown without a call of the law */
    if (a == BD_NORMAL) return element->kn;
    const int is_bonded = element->law == BD_LAW_BONDED;
    return is_bonded || bd_element_has_friction(element, a) ? element->kt[a] : 0.0;
}

/* Columns of Gr_l: the unknowns of harmonic l, its modes or their cosines and sines. */
static size_t columns_of(const bd_hbm *hbm, int l) { return (size_t)(n_row(l) * hbm->n_mode[l]); }

/* Place of component a of point p among the components of all points. */
static size_t component_of(size_t p, int a) { return BD_N_COMPONENT * p + (size_t)a; }

/* Rows of Gr_l (n_row, columns) of one component of motion. */
static const double *rows_of(const bd_hbm *hbm, int l, size_t component) {
    return hbm->G[l] + component * (size_t)n_row(l) * columns_of(hbm, l);
}

/* K (columns, columns) += sum over points of g^T (k g): stiffness of the springs k of component a,
 * with the rows g (n_row, columns) of Gr_l of this component. `scaled` is work for k g. */
static void sum_springs(const bd_hbm *hbm, int l, int a, double *scaled, double *K) {
    const size_t n = columns_of(hbm, l), rows = (size_t)n_row(l), stride = bd_kernel_stride(n);
    for (size_t p = 0; p < (size_t)hbm->n_point; ++p) {
        const double k = spring(hbm->element + p, a);
        const double *g = rows_of(hbm, l, component_of(p, a));
        for (size_t i = 0; i < rows; ++i)
            for (size_t j = 0; j < n; ++j) scaled[i * stride + j] = k * g[i * n + j];
        hbm->kernel->product(n, n, rows, g, scaled, stride, K, n);
    }
}

/* Modal stiffness of the springs of all points: for each harmonic (3, columns, columns), one matrix
 * for each component of motion. */
static bd_status springs_create(bd_hbm *hbm) {
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t n = columns_of(hbm, l), rows = (size_t)n_row(l), stride = bd_kernel_stride(n);
        hbm->spring_stiffness[l] = calloc(BD_N_COMPONENT * n * n + 1, sizeof(double));
        double *scaled = calloc(rows * stride + BD_KERNEL_PAD, sizeof(double));
        if (!hbm->spring_stiffness[l] || !scaled) {
            free(scaled);
            return BD_NO_MEMORY;
        }
        for (int a = 0; a < BD_N_COMPONENT; ++a)
            sum_springs(hbm, l, a, scaled, hbm->spring_stiffness[l] + (size_t)a * n * n);
        free(scaled);
    }
    return BD_OK;
}

/* Return whether the evaluation supports the laws of all points. */
static int laws_are_valid(const bd_hbm_input *in) {
    for (int p = 0; p < in->n_point; ++p) {
        const int law = in->law[p];
        if (law < 0 || law >= BD_N_LAW) return 0;
        if (!bd_evaluation_supports(in->evaluation, (bd_law)law)) return 0;
        const int has_function = in->point_law && in->point_law[p].function;
        if (law == BD_LAW_USER && !has_function) return 0;
    }
    return 1;
}

static bd_status evaluator_create(bd_hbm *hbm, const bd_hbm_input *in) {
    bd_evaluator *evaluator = &hbm->evaluator;
    bd_status status = bd_evaluator_create(evaluator, in->evaluation, in->n_harm, in->n_time);
    if (status == BD_OK) status = bd_evaluator_add_laws(evaluator, in->n_point, in->point_law);
    if (status != BD_OK) bd_evaluator_destroy(evaluator);
    return status;
}

/* Numbers of modes and unknowns of each harmonic. */
static bd_status layout_create(bd_hbm *hbm, const bd_hbm_input *in) {
    const size_t n_group = (size_t)in->n_harm + 1;
    hbm->n_point = in->n_point;
    hbm->n_harm = in->n_harm;
    hbm->n_coef = bd_n_coef(in->n_harm);
    hbm->n_mode = malloc(sizeof(int) * n_group);
    hbm->first_unknown = malloc(sizeof(int) * (n_group + 1));
    if (!hbm->n_mode || !hbm->first_unknown) return BD_NO_MEMORY;
    hbm->first_unknown[0] = 0;
    for (int l = 0; l <= in->n_harm; ++l) {
        hbm->n_mode[l] = in->n_mode[l];
        hbm->first_unknown[l + 1] = hbm->first_unknown[l] + n_row(l) * in->n_mode[l];
    }
    hbm->n_unknown = hbm->first_unknown[n_group];
    return BD_OK;
}

/* Copies of the input but for the modes. Arrays have one more entry than needed: an allocation of 0
 * bytes may return NULL. */
static bd_status parameters_create(bd_hbm *hbm, const bd_hbm_input *in) {
    const size_t n_point = (size_t)in->n_point, n_component = 3 * n_point;
    const size_t n_unknown = (size_t)hbm->n_unknown;
    size_t n_modes = 0;
    for (int l = 0; l <= in->n_harm; ++l) n_modes += (size_t)in->n_mode[l];
    hbm->stiffness = malloc(sizeof(double) * (n_modes + 1));
    hbm->mass = malloc(sizeof(double) * (n_modes + 1));
    hbm->damping = malloc(sizeof(double) * (n_modes + 1));
    hbm->force = malloc(sizeof(double) * (n_unknown + 1));
    hbm->shift = malloc(sizeof(double) * (n_component + 1));
    hbm->element = malloc(sizeof(bd_element) * (n_point + 1));
    hbm->point_law = bd_point_laws_create(in->n_point, in->point_law);
    if (!hbm->stiffness || !hbm->mass || !hbm->damping) return BD_NO_MEMORY;
    if (!hbm->force || !hbm->shift) return BD_NO_MEMORY;
    if (!hbm->element || !hbm->point_law) return BD_NO_MEMORY;
    copy(hbm->stiffness, in->stiffness, n_modes);
    copy(hbm->mass, in->mass, n_modes);
    copy(hbm->damping, in->damping, n_modes);
    copy(hbm->force, in->force, n_unknown);
    copy(hbm->shift, in->shift, n_component);
    set_elements(hbm, in);
    return BD_OK;
}

/* Results and work of an evaluation, also with one more entry than needed. */
static bd_status workspace_create(bd_hbm *hbm) {
    const size_t n_point = (size_t)hbm->n_point, n_component = 3 * n_point;
    const size_t n_unknown = (size_t)hbm->n_unknown, n_coef = (size_t)hbm->n_coef;
    hbm->share = calloc(n_point + 1, sizeof(bd_status_share));
    hbm->X = calloc(n_component * n_coef + 1, sizeof(double));
    hbm->F = calloc(n_component * n_coef + 1, sizeof(double));
    hbm->harmonic_values = malloc(sizeof(double) * (2 * n_component + 1));
    hbm->shifted_amplitudes = malloc(sizeof(double) * (n_unknown + 1));
    if (!hbm->share || !hbm->X || !hbm->F) return BD_NO_MEMORY;
    if (!hbm->harmonic_values || !hbm->shifted_amplitudes) return BD_NO_MEMORY;

    /* some 256 kB of Z at a time */
    const size_t per_component = n_coef * bd_kernel_stride(n_unknown);
    const size_t chunk = 32768 / per_component + 4;
    size_t n_column = 1; /* of the rows of G of one component, over all harmonics */
    for (int l = 0; l <= hbm->n_harm; ++l) n_column += (size_t)n_row(l) * columns_of(hbm, l);
    hbm->chunk = (int)chunk;
    hbm->tangent_kind = calloc(n_component + 1, 1);
    hbm->tangent_blocks = malloc(sizeof(double) * BD_LANES * BD_N_USER_BLOCK * n_coef * n_coef);
    hbm->tangent_modes = calloc(chunk * per_component + BD_KERNEL_PAD, sizeof(double));
    hbm->chunk_modes = calloc(chunk * n_column + BD_KERNEL_PAD, sizeof(double));
    if (!hbm->tangent_kind || !hbm->tangent_blocks) return BD_NO_MEMORY;
    if (!hbm->tangent_modes || !hbm->chunk_modes) return BD_NO_MEMORY;
    return BD_OK;
}

/* The real modes, and the stiffness of the springs in them. */
static bd_status modes_create(bd_hbm *hbm, const bd_hbm_input *in) {
    const size_t n_component = 3 * (size_t)in->n_point, n_group = (size_t)in->n_harm + 1;
    hbm->G = calloc(n_group, sizeof(double *));
    hbm->spring_stiffness = calloc(n_group, sizeof(double *));
    if (!hbm->G || !hbm->spring_stiffness) return BD_NO_MEMORY;
    const double *G = in->G;
    for (int l = 0; l <= in->n_harm; ++l) {
        const size_t per_component = (size_t)n_row(l) * columns_of(hbm, l);
        hbm->G[l] = calloc(n_component * per_component + BD_KERNEL_PAD, sizeof(double));
        if (!hbm->G[l]) return BD_NO_MEMORY;
        expand_modes(hbm->G[l], G, n_component, in->n_mode[l], l);
        G += 2 * n_component * (size_t)in->n_mode[l];
    }
    return springs_create(hbm);
}

/* Copy the input, and create the workspace of an evaluation. On failure nothing remains. */
bd_status bd_hbm_create(bd_hbm *hbm, const bd_hbm_input *in) {
    memset(hbm, 0, sizeof *hbm);
    hbm->kernel = bd_kernel_get();
    const int valid = in->n_harm >= 1 && in->n_harm <= BD_MAX_HARM && in->n_point >= 0;
    if (!hbm->kernel || !valid || !laws_are_valid(in)) return BD_BAD_ARGUMENT;
    bd_status status = evaluator_create(hbm, in);
    if (status != BD_OK) return status;

    status = layout_create(hbm, in);
    if (status == BD_OK) status = parameters_create(hbm, in);
    if (status == BD_OK) status = workspace_create(hbm);
    if (status == BD_OK) status = modes_create(hbm, in);
    if (status != BD_OK) bd_hbm_destroy(hbm);
    return status;
}

void bd_hbm_destroy(bd_hbm *hbm) {
    if (!hbm) return;
    if (hbm->variation) hbm->variation->destroy(hbm->variation);
    if (hbm->G)
        for (int l = 0; l <= hbm->n_harm; ++l) free(hbm->G[l]);
    if (hbm->spring_stiffness)
        for (int l = 0; l <= hbm->n_harm; ++l) free(hbm->spring_stiffness[l]);
    free(hbm->spring_stiffness);
    free(hbm->shifted_amplitudes);
    free(hbm->tangent_kind);
    free(hbm->chunk_modes);
    free(hbm->G);
    free(hbm->n_mode);
    free(hbm->first_unknown);
    free(hbm->stiffness);
    free(hbm->mass);
    free(hbm->damping);
    free(hbm->force);
    free(hbm->element);
    free(hbm->point_law);
    free(hbm->share);
    free(hbm->shift);
    free(hbm->X);
    free(hbm->F);
    free(hbm->harmonic_values);
    free(hbm->tangent_blocks);
    free(hbm->tangent_modes);
    bd_evaluator_destroy(&hbm->evaluator);
    memset(hbm, 0, sizeof *hbm);
}

/* ---- motion and force ---- */

/* Relative motion X (n_component, n_coef) of the contact points from the unknowns u: X_l = Gr_l
 * q_l harmonic by harmonic, and X_0 = G_0 q_0 + shift. The sine row of Gr_l is (-Im G, Re G).
 * The sine of the motion is therefore a . [s; -c] with the cosine row a = (Re G, Im G), which
 * alone is read. */
void bd_hbm_motion(bd_hbm *hbm, const double *u) {
    const size_t n_component = 3 * (size_t)hbm->n_point, n_coef = (size_t)hbm->n_coef;
    double *value = hbm->harmonic_values, *shifted = hbm->shifted_amplitudes;
    hbm->kernel->multiply(n_component, (size_t)hbm->n_mode[0], hbm->G[0], u, value);
    for (size_t i = 0; i < n_component; ++i) hbm->X[i * n_coef] = value[i] + hbm->shift[i];

    for (int l = 1; l <= hbm->n_harm; ++l) {
        const double *q = u + hbm->first_unknown[l];
        const size_t n_mode = (size_t)hbm->n_mode[l];
        for (size_t j = 0; j < n_mode; ++j) {
            shifted[j] = q[n_mode + j];
            shifted[n_mode + j] = -q[j];
        }
        hbm->kernel->multiply_pairs(n_component, 2 * n_mode, hbm->G[l], q, shifted, value);
        for (size_t i = 0; i < n_component; ++i) {
            double *X = hbm->X + i * n_coef;
            X[2 * l - 1] = value[2 * i];
            X[2 * l] = value[2 * i + 1];
        }
    }
}

/* r_l += Gr_l^T F_l harmonic by harmonic, for contact forces F (n_component, n_coef). */
void bd_hbm_add_force(bd_hbm *hbm, const double *F, double *r) {
    const size_t n_component = 3 * (size_t)hbm->n_point, n_coef = (size_t)hbm->n_coef;
    double *value = hbm->harmonic_values;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t rows = n_component * (size_t)n_row(l);
        for (size_t i = 0; i < n_component; ++i) {
            const double *f = F + i * n_coef;
            if (l == 0) {
                value[i] = f[0];
            } else {
                value[2 * i] = f[2 * l - 1];
                value[2 * i + 1] = f[2 * l];
            }
        }
        hbm->kernel->multiply_transposed(rows, columns_of(hbm, l), hbm->G[l], value,
                                         r + hbm->first_unknown[l]);
    }
}

/* Linear equations of each mode with stiffness k, mass m, damping c and force E. For the mean,
 * r = k u - E. For the cosine a and the sine b of harmonic l, w = l omega,
 *
 *     r_a = (k - w^2 m) u_a + w c u_b - E_a
 *     r_b = (k - w^2 m) u_b - w c u_a - E_b.
 *
 * Set r (n_unknown); add the factors of u to J (n_unknown, n_unknown) and set r_omega, the
 * derivative with respect to omega, unless NULL. */
void bd_hbm_linear_part(const bd_hbm *hbm, const double *u, double omega, double *r, double *J,
                        double *r_omega) {
    const size_t n = (size_t)hbm->n_unknown, n_mode0 = (size_t)hbm->n_mode[0];
    const double *k = hbm->stiffness, *m = hbm->mass, *c = hbm->damping;
    const bd_jacobian_parts *parts = hbm->parts;
    for (size_t a = 0; a < n_mode0; ++a, ++k, ++m, ++c) {
        r[a] = *k * u[a] - hbm->force[a];
        if (J) J[a * n + a] += *k;
        if (parts) parts->dynamic[a] = *k;
        if (parts) parts->loss[a] = 0.0;
        if (r_omega) r_omega[a] = 0.0;
    }
    for (int l = 1; l <= hbm->n_harm; ++l) {
        const size_t n_mode = (size_t)hbm->n_mode[l], first = (size_t)hbm->first_unknown[l];
        const double w = l * omega;
        for (size_t j = 0; j < n_mode; ++j, ++k, ++m, ++c) {
            const size_t a = first + j, b = a + n_mode; /* cosine and sine */
            const double dynamic = *k - w * w * *m, loss = w * *c;
            r[a] = dynamic * u[a] + loss * u[b] - hbm->force[a];
            r[b] = dynamic * u[b] - loss * u[a] - hbm->force[b];
            if (J) {
                J[a * n + a] += dynamic;
                J[a * n + b] += loss;
                J[b * n + b] += dynamic;
                J[b * n + a] -= loss;
            }
            if (parts) {
                parts->dynamic[k - hbm->stiffness] = dynamic;
                parts->loss[k - hbm->stiffness] = loss;
            }
            if (r_omega) {
                const double d_dynamic = -2.0 * l * w * *m, d_loss = l * *c;
                r_omega[a] = d_dynamic * u[a] + d_loss * u[b];
                r_omega[b] = d_dynamic * u[b] - d_loss * u[a];
            }
        }
    }
}

/* ---- Jacobian ---- */

/* Row of Z = B Gr (tangent B of a component of force times the modes) for row `part` (0: mean or
 * cosine, 1: sine) of harmonic l of the component at place `slot` of the chunk. The rows are stored
 * harmonic after harmonic, in each (slot, part); a row has n_unknown numbers and padding. */
static double *z_row(const bd_hbm *hbm, int l, size_t slot, int part) {
    const size_t in_lower_harmonics = (size_t)first_row(l) * (size_t)hbm->chunk;
    const size_t index = in_lower_harmonics + slot * (size_t)n_row(l) + (size_t)part;
    return hbm->tangent_modes + index * bd_kernel_stride((size_t)hbm->n_unknown);
}

/* Rows of Gr_l (slot, n_row, columns) of the components of the chunk. */
static double *chunk_rows(const bd_hbm *hbm, int l) {
    size_t in_lower_harmonics = 0; /* numbers of one component */
    for (int m = 0; m < l; ++m) in_lower_harmonics += (size_t)n_row(m) * columns_of(hbm, m);
    return hbm->chunk_modes + in_lower_harmonics * (size_t)hbm->chunk;
}

/* Add the components of contact force that the chunk has collected to the Jacobian, and empty the
 * chunk. Harmonic l of these forces acts on the modes by Gr_l^T, and depends on all unknowns by
 * Z_l = B_l Gr (B tangent of the contact law), hence
 *
 *     J_l (columns, n_unknown) += Gr_l^T Z_l,   Gr_l (rows, columns),   Z_l (rows, n_unknown),
 *
 * for the rows J_l of harmonic l in J. Each component of the chunk has the row of the mean, or the
 * rows of cosine and sine. */
static void flush_chunk(bd_hbm *hbm, double *J) {
    const size_t n = (size_t)hbm->n_unknown, z_stride = bd_kernel_stride(n);
    if (hbm->n_chunk == 0) return;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t rows = (size_t)(hbm->n_chunk * n_row(l)), columns = columns_of(hbm, l);
        const double *Gr_l = chunk_rows(hbm, l), *Z_l = z_row(hbm, l, 0, 0);
        double *J_l = J + (size_t)hbm->first_unknown[l] * n;
        /* C (m, n) += A^T B with A (k, m) and B (k, n): m, n, k, A, B, stride of B, C, stride */
        hbm->kernel->product(columns, n, rows, Gr_l, Z_l, z_stride, J_l, n);
    }
    hbm->n_chunk = 0;
}

/* Tangent blocks (n_coef, n_coef) of component a of the force that are not zero, and the components
 * of motion on which they act; return their number. The first one acts on the same component. */
static int list_blocks(const bd_response *response, int a, const double *block[3],
                       size_t source[3]) {
    int n = 1;
    if (a == BD_NORMAL) {
        block[0] = response->dN;
        source[0] = BD_NORMAL;
        if (!response->with_tangential) return n;
        for (size_t d = 0; d < 2; ++d, ++n) {
            block[n] = response->dNt[d];
            source[n] = d;
        }
        return n;
    }
    block[0] = response->dT[a];
    source[0] = (size_t)a;
    if (response->with_normal[a]) {
        block[n] = response->dTv[a];
        source[n] = BD_NORMAL;
        ++n;
    }
    if (response->coupled) {
        block[n] = response->dTc[a];
        source[n] = (size_t)(1 - a);
        ++n;
    }
    return n;
}

/* Add component a of the force at point p, whose tangent has full blocks B, to the chunk: its rows
 * of Gr, and the rows
 *
 *     Z (n_coef, n_unknown) = sum over the components s of motion on which it depends of B_s Gr_s.
 *
 * A full chunk is added to J. */
static void add_component(bd_hbm *hbm, size_t p, int a, const bd_response *response, double *J) {
    const double *g[(BD_MAX_HARM + 1) * 3];
    double *z[BD_MAX_COEF];
    size_t source[3];
    bd_fill fill = {
        .n_harm = hbm->n_harm,
        .n_mode = hbm->n_mode,
        .first = hbm->first_unknown,
        .g = g,
        .z = z,
    };
    fill.n_source = list_blocks(response, a, fill.block, source);
    const size_t slot = (size_t)hbm->n_chunk;
    ++hbm->n_chunk;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t size = (size_t)n_row(l) * columns_of(hbm, l);
        double *own_rows = chunk_rows(hbm, l) + slot * size;
        for (int s = 0; s < fill.n_source; ++s)
            g[l * fill.n_source + s] = rows_of(hbm, l, component_of(p, (int)source[s]));
        for (int part = 0; part < n_row(l); ++part)
            z[first_row(l) + part] = z_row(hbm, l, slot, part);
        copy(own_rows, rows_of(hbm, l, component_of(p, a)), size);
    }
    hbm->kernel->fill_rows(&fill);
    if (hbm->n_chunk == hbm->chunk) flush_chunk(hbm, J);
}

/* J_ll (columns, columns) += sign * sum over points of g^T (k g), the springs k of component a with
 * the rows g (n_row, columns) of Gr_l. J_ll is the diagonal block of harmonic l in J. The sum runs
 * over the points whose tangent of this component is linear, or with `linear` 0 over the others. It
 * is added as Gr^T Z for chunks of points, with the rows g in Gr and k g in Z. */
static void add_springs_of_harmonic(bd_hbm *hbm, int l, int a, int linear, double sign, double *J) {
    const size_t n = (size_t)hbm->n_unknown, columns = columns_of(hbm, l);
    const size_t rows = (size_t)n_row(l), stride = bd_kernel_stride(columns);
    const size_t first = (size_t)hbm->first_unknown[l], n_point = (size_t)hbm->n_point;
    double *Gr = hbm->chunk_modes, *Z = hbm->tangent_modes;
    double *J_ll = J + first * n + first;
    size_t slot = 0;
    for (size_t p = 0; p < n_point; ++p) {
        const size_t component = component_of(p, a);
        const double k = sign * spring(hbm->element + p, a);
        const int is_linear = hbm->tangent_kind[component] == BD_BLOCK_LINEAR;
        if (k != 0.0 && is_linear == linear) {
            const double *g = rows_of(hbm, l, component);
            double *z = Z + slot * rows * stride;
            copy(Gr + slot * rows * columns, g, rows * columns);
            for (size_t i = 0; i < rows; ++i)
                for (size_t j = 0; j < columns; ++j) z[i * stride + j] = k * g[i * columns + j];
            ++slot;
        }
        const int is_last = p + 1 == n_point;
        if (slot == (size_t)hbm->chunk || is_last) {
            hbm->kernel->product(columns, columns, slot * rows, Gr, Z, stride, J_ll, n);
            slot = 0;
        }
    }
}

/* Add sign times the springs of component a to J: those of points whose tangent of this component
 * is linear, or with `linear` 0 those of the other points. */
static void add_springs(bd_hbm *hbm, int a, int linear, double sign, double *J) {
    for (int l = 0; l <= hbm->n_harm; ++l) add_springs_of_harmonic(hbm, l, a, linear, sign, J);
}

/* J_ll += K_l (columns, columns), the stiffness of the springs of component a of all points, for
 * the diagonal block J_ll of each harmonic l. */
static void add_all_springs(const bd_hbm *hbm, int a, double *J) {
    const size_t n = (size_t)hbm->n_unknown;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t columns = columns_of(hbm, l), first = (size_t)hbm->first_unknown[l];
        const double *K = hbm->spring_stiffness[l] + (size_t)a * columns * columns;
        for (size_t i = 0; i < columns; ++i) {
            double *row = J + (first + i) * n + first;
            for (size_t j = 0; j < columns; ++j) row[j] += K[i * columns + j];
        }
    }
}

/* Add the components of force that are linear through the cycle, B = k I with the spring k. If most
 * springs of a component are linear, begin with the known sum over the springs of all points, and
 * subtract the others. In a speed family the springs change with the parameter, and this sum is not
 * known. */
static void add_linear_components(bd_hbm *hbm, double *J) {
    enum { OTHERS = 0, LINEAR = 1 };
    for (int a = 0; a < BD_N_COMPONENT; ++a) {
        int n_linear = 0, n_spring = 0;
        for (size_t p = 0; p < (size_t)hbm->n_point; ++p) {
            if (spring(hbm->element + p, a) == 0.0) continue;
            ++n_spring;
            n_linear += hbm->tangent_kind[component_of(p, a)] == BD_BLOCK_LINEAR;
        }
        const int most_are_linear = 2 * n_linear > n_spring;
        if (most_are_linear && !hbm->variation) {
            add_all_springs(hbm, a, J);
            if (n_linear < n_spring) add_springs(hbm, a, OTHERS, -1.0, J);
        } else if (n_linear > 0) {
            add_springs(hbm, a, LINEAR, 1.0, J);
        }
    }
}

/* Where an evaluation writes the force (3, n_coef) of point p and, with a tangent, the blocks
 * (n_coef, n_coef). The points of a group evaluated together, by lane, have their own blocks. */
static bd_response response_of(bd_hbm *hbm, size_t p, size_t lane, int with_tangent) {
    const size_t n_coef = (size_t)hbm->n_coef, block_size = n_coef * n_coef;
    double *block = hbm->tangent_blocks + lane * BD_N_USER_BLOCK * block_size;
    bd_response out = {.F = hbm->F + BD_N_COMPONENT * p * n_coef};
    if (!with_tangent) return out;
    for (size_t d = 0; d < 2; ++d) {
        out.dT[d] = block + (BD_DT1_DU1 + d) * block_size;
        out.dTv[d] = block + (BD_DT1_DV + d) * block_size;
        out.dTc[d] = block + (BD_DT1_DU2 + d) * block_size;
        out.dNt[d] = block + (BD_DN_DU1 + d) * block_size;
    }
    out.dN = block + BD_DN_DV * block_size;
    return out;
}

/* Derivatives dF (3, n_coef) of the forces of n points from `first` on with respect to the
 * parameter of hbm->derivative, which has the derivatives of motion and contact parameters. */
static void find_derivatives(bd_hbm *hbm, size_t first, size_t n, const bd_response *response) {
    const struct bd_hbm *derivative = hbm->derivative;
    for (size_t i = 0; i < n; ++i) {
        const size_t p = first + i, at = BD_N_COMPONENT * p * (size_t)hbm->n_coef;
        bd_force_derivative(hbm->element + p, derivative->element + p, hbm->n_harm, hbm->X + at,
                            derivative->X + at, response + i, derivative->F + at);
    }
}

/* Copy a block (n_coef, n_coef) to the tangent (m, m) of the contact forces in parts, m =
 * components times n_coef: row block `to` (force), column block `from` (motion). */
static void write_block(const bd_hbm *hbm, int to, int from, const double *block) {
    const bd_jacobian_parts *parts = hbm->parts;
    const size_t n_coef = (size_t)hbm->n_coef, m = (size_t)parts->n_component * n_coef;
    double *corner = parts->tangent + (size_t)to * n_coef * m + (size_t)from * n_coef;
    for (size_t i = 0; i < n_coef; ++i) copy(corner + i * m, block + i * n_coef, n_coef);
}

/* Write the tangent of component a of the force at a point to the matrix (m, m) in parts, which has
 * a block row and column for each component that the modes move. */
static void write_tangent(const bd_hbm *hbm, size_t p, int a, const bd_response *response) {
    const bd_jacobian_parts *parts = hbm->parts;
    const size_t n_coef = (size_t)hbm->n_coef, m = (size_t)parts->n_component * n_coef;
    const bd_block kind = a == BD_NORMAL ? response->normal : response->tangential[a];
    const int to = parts->place[component_of(p, a)];
    const int is_moved = to >= 0;
    if (!is_moved) return;
    if (kind == BD_BLOCK_LINEAR) {
        /* k on the diagonal */
        const double k = spring(hbm->element + p, a);
        const size_t next_diagonal = m + 1;
        double *first = parts->tangent + (size_t)to * n_coef * next_diagonal;
        for (size_t i = 0; i < n_coef; ++i) first[i * next_diagonal] = k;
    }
    if (kind != BD_BLOCK_FULL) return;
    const double *block[3];
    size_t source[3];
    const int n_source = list_blocks(response, a, block, source);
    for (int s = 0; s < n_source; ++s) {
        const int from = parts->place[component_of(p, (int)source[s])];
        if (from >= 0) write_block(hbm, to, from, block[s]);
    }
}

static void write_tangents(const bd_hbm *hbm, size_t first, size_t n, const bd_response *response) {
    for (size_t i = 0; i < n; ++i)
        for (int a = 0; a < BD_N_COMPONENT; ++a) write_tangent(hbm, first + i, a, response + i);
}

/* Record the form of the tangents of n points from `first` on, and add the full ones to J. The
 * linear ones follow when all points are known (add_linear_components). */
static void add_tangents(bd_hbm *hbm, size_t first, size_t n, const bd_response *response,
                         double *J) {
    for (size_t i = 0; i < n; ++i) {
        for (int a = 0; a < BD_N_COMPONENT; ++a) {
            const int is_normal = a == BD_NORMAL;
            const bd_block kind = is_normal ? response[i].normal : response[i].tangential[a];
            hbm->tangent_kind[component_of(first + i, a)] = (unsigned char)kind;
            if (kind == BD_BLOCK_FULL) add_component(hbm, first + i, a, response + i, J);
        }
    }
}

/* Compute the contact forces F of all points at the motion X in groups of BD_LANES. Add their
 * contribution to J, unless NULL. If the equations have a derivative or parts of the Jacobian,
 * write these as well. */
static void contact_part(bd_hbm *hbm, double *J) {
    bd_response response[BD_LANES];
    const int with_tangent = J || hbm->derivative || hbm->parts;
    const size_t n_point = (size_t)hbm->n_point;
    double assembly = 0.0;
    const double started = bd_seconds();
    for (size_t first = 0; first < n_point; first += BD_LANES) {
        const size_t left = n_point - first, n = left < BD_LANES ? left : BD_LANES;
        const double *X = hbm->X + 3 * first * (size_t)hbm->n_coef;
        for (size_t i = 0; i < n; ++i) response[i] = response_of(hbm, first + i, i, with_tangent);
        bd_contact_evaluate_many((int)n, hbm->element + first, X, response, hbm->share + first,
                                 &hbm->evaluator);
        if (hbm->derivative) find_derivatives(hbm, first, n, response);
        if (!J && !hbm->parts) continue;
        const double evaluated = bd_seconds();
        if (J) add_tangents(hbm, first, n, response, J);
        if (hbm->parts) write_tangents(hbm, first, n, response);
        assembly += bd_seconds() - evaluated;
    }
    const double evaluated = bd_seconds();
    hbm->cost.contact += evaluated - started - assembly;
    if (J) {
        flush_chunk(hbm, J);
        add_linear_components(hbm, J);
    }
    hbm->cost.assembly += assembly + bd_seconds() - evaluated;
}

static int all_finite(const double *x, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += x[i] * 0.0; /* preserves NaN and infinity */
    return sum == 0.0;
}

static size_t tangent_size(const bd_hbm *hbm) {
    const size_t m = (size_t)hbm->parts->n_component * (size_t)hbm->n_coef;
    return m * m;
}

static void clear_tangent(const bd_hbm *hbm) {
    memset(hbm->parts->tangent, 0, sizeof(double) * tangent_size(hbm));
}

static int parts_are_finite(const bd_hbm *hbm) {
    size_t n_modes = 0;
    for (int l = 0; l <= hbm->n_harm; ++l) n_modes += (size_t)hbm->n_mode[l];
    const bd_jacobian_parts *parts = hbm->parts;
    if (!all_finite(parts->dynamic, n_modes) || !all_finite(parts->loss, n_modes)) return 0;
    return all_finite(parts->tangent, tangent_size(hbm));
}

/* Invalidate motion, forces and shares at a point without evaluation. */
static void set_not_finite(bd_hbm *hbm) {
    const size_t n = 3 * (size_t)hbm->n_point * (size_t)hbm->n_coef;
    for (size_t i = 0; i < n; ++i) hbm->X[i] = hbm->F[i] = NAN;
    for (int p = 0; p < hbm->n_point; ++p)
        hbm->share[p] = (bd_status_share){{NAN, NAN}, {NAN, NAN}, NAN};
}

bd_status bd_hbm_evaluate(bd_hbm *hbm, const double *u, double omega, double *r, double *J,
                          double *r_omega) {
    const bd_variation *variation = hbm->variation;
    if (variation) return variation->evaluate(hbm, u, omega, r, J, r_omega);
    return bd_hbm_evaluate_at(hbm, u, omega, r, J, r_omega);
}

/* Residual r (n) of the equations at the unknowns u (n) and omega: linear part plus contact forces.
 * J (n, n) and the derivative r_omega (n) with respect to omega may be NULL. Condensation needs the
 * parts of the Jacobian instead, hbm->parts. The cost counts evaluations and their times. */
bd_status bd_hbm_evaluate_at(bd_hbm *hbm, const double *u, double omega, double *r, double *J,
                             double *r_omega) {
    const size_t n = (size_t)hbm->n_unknown;
    bd_cost *cost = &hbm->cost;
    if (!all_finite(u, n) || !isfinite(omega)) {
        set_not_finite(hbm);
        return BD_NOT_FINITE;
    }
    const double started = bd_seconds();
    if (J) memset(J, 0, sizeof(double) * n * n);
    if (hbm->parts) clear_tangent(hbm);
    bd_hbm_motion(hbm, u);
    bd_hbm_linear_part(hbm, u, omega, r, J, r_omega);
    cost->assembly += bd_seconds() - started;

    contact_part(hbm, J);

    const double evaluated = bd_seconds();
    bd_hbm_add_force(hbm, hbm->F, r);
    cost->assembly += bd_seconds() - evaluated;
    ++cost->n_evaluation;
    if (J || hbm->parts) ++cost->n_jacobian;
    if (!all_finite(r, n)) return BD_NOT_FINITE;
    if (J && !all_finite(J, n * n)) return BD_NOT_FINITE;
    if (hbm->parts && !parts_are_finite(hbm)) return BD_NOT_FINITE;
    return BD_OK;
}
