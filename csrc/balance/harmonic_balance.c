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

/* Rows for each component of motion: the mean, or cosine and sine. */
static int n_row(int l) { return l == 0 ? 1 : 2; }

static void copy(double *to, const double *from, size_t n) {
    if (n > 0) memcpy(to, from, sizeof(double) * n);
}

/* Gr_l from the complex interleaved G_l (n_component, n_mode). */
static void expand_modes(double *real, const double *complex_G, size_t n_component, int n_mode,
                         int l) {
    const size_t n = (size_t)n_mode, size = l == 0 ? n : 4 * n;
    for (size_t i = 0; i < n_component; ++i) {
        const double *from = complex_G + 2 * i * n;
        double *row = real + i * size;
        for (size_t j = 0; j < n; ++j) {
            const double re = from[2 * j], im = from[2 * j + 1];
            row[j] = re;
            if (l == 0) continue;
            row[n + j] = im;
            row[2 * n + j] = -im;
            row[3 * n + j] = re;
        }
    }
}

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

/* Stiffness of the spring of component a of a point, 0 if it has none. */
static double spring(const bd_element *element, int a) {
    if (element->law == BD_LAW_USER) return 0.0; /* unknown without a call of the law */
    if (a == 2) return element->kn;
    const int is_bonded = element->law == BD_LAW_BONDED;
    return is_bonded || bd_element_has_friction(element, a) ? element->kt[a] : 0.0;
}

static size_t columns_of(const bd_hbm *hbm, int l) { return (size_t)(n_row(l) * hbm->n_mode[l]); }

static const double *rows_of(const bd_hbm *hbm, int l, size_t component) {
    return hbm->G[l] + component * (size_t)n_row(l) * columns_of(hbm, l);
}

/* K += Gr^T k Gr for the springs of component a of all points; `scaled` is work for the rows of one
 * component. */
static void sum_springs(const bd_hbm *hbm, int l, int a, double *scaled, double *K) {
    const size_t n = columns_of(hbm, l), rows = (size_t)n_row(l), stride = bd_kernel_stride(n);
    for (size_t p = 0; p < (size_t)hbm->n_point; ++p) {
        const double k = spring(hbm->element + p, a);
        const double *g = rows_of(hbm, l, 3 * p + (size_t)a);
        for (size_t i = 0; i < rows; ++i)
            for (size_t j = 0; j < n; ++j) scaled[i * stride + j] = k * g[i * n + j];
        hbm->kernel->product(n, n, rows, g, scaled, stride, K, n);
    }
}

/* Modal stiffness of all springs, for each harmonic and component of motion. */
static bd_status springs_create(bd_hbm *hbm) {
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t n = columns_of(hbm, l), rows = (size_t)n_row(l), stride = bd_kernel_stride(n);
        hbm->spring_stiffness[l] = calloc(3 * n * n + 1, sizeof(double));
        double *scaled = calloc(rows * stride + BD_KERNEL_PAD, sizeof(double));
        if (!hbm->spring_stiffness[l] || !scaled) {
            free(scaled);
            return BD_NO_MEMORY;
        }
        for (int a = 0; a < 3; ++a)
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

/* Copies of the input but for the modes. */
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

/* Results and work of an evaluation. */
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
    hbm->tangent_blocks = malloc(sizeof(double) * BD_LANES * 9 * n_coef * n_coef);
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

void bd_hbm_motion(bd_hbm *hbm, const double *u) {
    const size_t n_component = 3 * (size_t)hbm->n_point, n_coef = (size_t)hbm->n_coef;
    double *value = hbm->harmonic_values, *shifted = hbm->shifted_amplitudes;
    hbm->kernel->multiply(n_component, (size_t)hbm->n_mode[0], hbm->G[0], u, value);
    for (size_t i = 0; i < n_component; ++i) hbm->X[i * n_coef] = value[i] + hbm->shift[i];

    for (int l = 1; l <= hbm->n_harm; ++l) {
        const double *q = u + hbm->first_unknown[l];
        const size_t n_mode = (size_t)hbm->n_mode[l];
        /* the sine row of Gr on [c; s] is the cosine row on [s; -c] */
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

/* Row of Z in the chunk. Z and its rows of G hold, harmonic after harmonic, the rows (component of
 * the chunk, cosine/sine). */
static double *z_row(const bd_hbm *hbm, int l, size_t slot, int part) {
    /* rows for each component in lower harmonics */
    const size_t before = l == 0 ? 0 : (size_t)(2 * l - 1);
    const size_t index = before * (size_t)hbm->chunk + slot * (size_t)n_row(l) + (size_t)part;
    return hbm->tangent_modes + index * bd_kernel_stride((size_t)hbm->n_unknown);
}

/* Rows of G of the chunk for one harmonic. */
static double *chunk_rows(const bd_hbm *hbm, int l) {
    size_t before = 0;
    for (int m = 0; m < l; ++m) before += (size_t)n_row(m) * columns_of(hbm, m);
    return hbm->chunk_modes + before * (size_t)hbm->chunk;
}

/* J += Gr^T Z for the components of the chunk, then empty the chunk. */
static void flush_chunk(bd_hbm *hbm, double *J) {
    const size_t n = (size_t)hbm->n_unknown, stride = bd_kernel_stride(n);
    if (hbm->n_chunk == 0) return;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t rows = (size_t)(hbm->n_chunk * n_row(l));
        double *to = J + (size_t)hbm->first_unknown[l] * n;
        hbm->kernel->product(columns_of(hbm, l), n, rows, chunk_rows(hbm, l), z_row(hbm, l, 0, 0),
                             stride, to, n);
    }
    hbm->n_chunk = 0;
}

/* Blocks of the tangent of component a, and the components of motion on which they act; return
 * their number. */
static int list_blocks(const bd_response *response, int a, const double *block[3],
                       size_t source[3]) {
    int n = 1;
    if (a == 2) {
        block[0] = response->dN;
        source[0] = 2;
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
        source[n] = 2;
        ++n;
    }
    if (response->coupled) {
        block[n] = response->dTc[a];
        source[n] = (size_t)(1 - a);
        ++n;
    }
    return n;
}

/* Add component a of point p, whose tangent is full, to the chunk. */
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
        const int first_row = l == 0 ? 0 : 2 * l - 1;
        for (int s = 0; s < fill.n_source; ++s)
            g[l * fill.n_source + s] = rows_of(hbm, l, 3 * p + source[s]);
        for (int part = 0; part < n_row(l); ++part) z[first_row + part] = z_row(hbm, l, slot, part);
        copy(chunk_rows(hbm, l) + slot * size, rows_of(hbm, l, 3 * p + (size_t)a), size);
    }
    hbm->kernel->fill_rows(&fill);
    if (hbm->n_chunk == hbm->chunk) flush_chunk(hbm, J);
}

/* J += sign * k g g^T for one harmonic and the components a whose tangent is linear (or, with
 * `linear` 0, is not). */
static void add_springs_of_harmonic(bd_hbm *hbm, int l, int a, int linear, double sign, double *J) {
    const size_t n = (size_t)hbm->n_unknown, columns = columns_of(hbm, l);
    const size_t rows = (size_t)n_row(l), stride = bd_kernel_stride(columns);
    const size_t first = (size_t)hbm->first_unknown[l], n_point = (size_t)hbm->n_point;
    double *G = hbm->chunk_modes, *Z = hbm->tangent_modes;
    size_t slot = 0;
    for (size_t p = 0; p < n_point; ++p) {
        const size_t component = 3 * p + (size_t)a;
        const double k = sign * spring(hbm->element + p, a);
        const int is_linear = hbm->tangent_kind[component] == BD_BLOCK_LINEAR;
        if (k != 0.0 && is_linear == linear) {
            const double *g = rows_of(hbm, l, component);
            double *z = Z + slot * rows * stride;
            copy(G + slot * rows * columns, g, rows * columns);
            for (size_t i = 0; i < rows; ++i)
                for (size_t j = 0; j < columns; ++j) z[i * stride + j] = k * g[i * columns + j];
            ++slot;
        }
        const int is_last = p + 1 == n_point;
        if (slot == (size_t)hbm->chunk || is_last) {
            double *to = J + first * n + first;
            hbm->kernel->product(columns, columns, slot * rows, G, Z, stride, to, n);
            slot = 0;
        }
    }
}

static void add_springs(bd_hbm *hbm, int a, int linear, double sign, double *J) {
    for (int l = 0; l <= hbm->n_harm; ++l) add_springs_of_harmonic(hbm, l, a, linear, sign, J);
}

/* J += K of component a, harmonic by harmonic. */
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

/* Add the components that are linear through the cycle. In a speed family the sums over all points
 * change with the parameter and are not computed. */
static void add_linear_components(bd_hbm *hbm, double *J) {
    for (int a = 0; a < 3; ++a) {
        int n_linear = 0, n_spring = 0;
        for (size_t p = 0; p < (size_t)hbm->n_point; ++p) {
            if (spring(hbm->element + p, a) == 0.0) continue;
            ++n_spring;
            n_linear += hbm->tangent_kind[3 * p + (size_t)a] == BD_BLOCK_LINEAR;
        }
        const int most_are_linear = 2 * n_linear > n_spring;
        if (most_are_linear && !hbm->variation) {
            add_all_springs(hbm, a, J);
            if (n_linear < n_spring) add_springs(hbm, a, 0, -1.0, J);
        } else if (n_linear > 0) {
            add_springs(hbm, a, 1, 1.0, J);
        }
    }
}

/* Where an evaluation writes the force and, with a tangent, the blocks of a point. */
static bd_response response_of(bd_hbm *hbm, size_t p, size_t lane, int with_tangent) {
    const size_t n_coef = (size_t)hbm->n_coef, block_size = n_coef * n_coef;
    double *block = hbm->tangent_blocks + lane * 9 * block_size;
    bd_response out = {.F = hbm->F + 3 * p * n_coef};
    if (!with_tangent) return out;
    for (size_t d = 0; d < 2; ++d) {
        out.dT[d] = block + d * block_size;
        out.dTv[d] = block + (2 + d) * block_size;
        out.dTc[d] = block + (4 + d) * block_size;
        out.dNt[d] = block + (7 + d) * block_size;
    }
    out.dN = block + 6 * block_size;
    return out;
}

/* Derivatives of the forces of a group of points, from its tangents. */
static void find_derivatives(bd_hbm *hbm, size_t first, size_t n, const bd_response *response) {
    const struct bd_hbm *derivative = hbm->derivative;
    for (size_t i = 0; i < n; ++i) {
        const size_t p = first + i, at = 3 * p * (size_t)hbm->n_coef;
        bd_force_derivative(hbm->element + p, derivative->element + p, hbm->n_harm, hbm->X + at,
                            derivative->X + at, response + i, derivative->F + at);
    }
}

/* Write one block of the tangent of the contact forces. */
static void write_block(const bd_hbm *hbm, int to, int from, const double *block) {
    const bd_jacobian_parts *parts = hbm->parts;
    const size_t n_coef = (size_t)hbm->n_coef, m = (size_t)parts->n_component * n_coef;
    double *corner = parts->tangent + (size_t)to * n_coef * m + (size_t)from * n_coef;
    for (size_t i = 0; i < n_coef; ++i) copy(corner + i * m, block + i * n_coef, n_coef);
}

/* Write the tangent of component a of a point. */
static void write_tangent(const bd_hbm *hbm, size_t p, int a, const bd_response *response) {
    const bd_jacobian_parts *parts = hbm->parts;
    const size_t n_coef = (size_t)hbm->n_coef, m = (size_t)parts->n_component * n_coef;
    const bd_block kind = a < 2 ? response->tangential[a] : response->normal;
    const int to = parts->place[3 * p + (size_t)a];
    if (to < 0) return;
    if (kind == BD_BLOCK_LINEAR) {
        const double k = spring(hbm->element + p, a);
        double *first = parts->tangent + (size_t)to * n_coef * (m + 1);
        for (size_t i = 0; i < n_coef; ++i) first[i * (m + 1)] = k;
    }
    if (kind != BD_BLOCK_FULL) return;
    const double *block[3];
    size_t source[3];
    const int n_source = list_blocks(response, a, block, source);
    for (int s = 0; s < n_source; ++s) {
        const int from = parts->place[3 * p + source[s]];
        if (from >= 0) write_block(hbm, to, from, block[s]);
    }
}

static void write_tangents(const bd_hbm *hbm, size_t first, size_t n, const bd_response *response) {
    for (size_t i = 0; i < n; ++i)
        for (int a = 0; a < 3; ++a) write_tangent(hbm, first + i, a, response + i);
}

/* Record the form of the tangents of a group of points, and add the full ones to J. */
static void add_tangents(bd_hbm *hbm, size_t first, size_t n, const bd_response *response,
                         double *J) {
    for (size_t i = 0; i < n; ++i) {
        for (int a = 0; a < 3; ++a) {
            const bd_block kind = a < 2 ? response[i].tangential[a] : response[i].normal;
            hbm->tangent_kind[3 * (first + i) + (size_t)a] = (unsigned char)kind;
            if (kind == BD_BLOCK_FULL) add_component(hbm, first + i, a, response + i, J);
        }
    }
}

/* Contact forces of all points and their contribution to J. */
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
