/* Residual and Jacobian of the harmonic balance equations in modal coordinates.
 *
 * With q_l = c_l - i s_l the modal amplitudes of harmonic l, the relative motion at the contact points and the residual
 * are
 *
 *     (u1, u2, v)_l = G_l q_l
 *     r_l = (K - (l omega)^2 M + i l omega C) q_l + G_l^H F_l - E_l,
 *
 * K, M, C diagonal.  In real numbers, one row for the cosine and one for the sine part of each component,
 *
 *     Gr_l = [  Re G   Im G ]        acts on [c; s] and gives (cosine, sine);
 *            [ -Im G   Re G ]        its transpose takes forces back, since G^H F = (Re G^T Fc - Im G^T Fs, ...).
 *
 * The contact law couples harmonics at a point by a tangent B = dF/dX of 3 x 3 blocks, of which five are not zero
 * (T_d with u_d and v, N with v).  Hence J_lm = Gr_l^T B_lm Gr_m + linear part: first Z = B Gr for a chunk of points that
 * fits the cache, then one matrix product for each harmonic.  Zero entries of B are skipped, so a point that sticks
 * (diagonal blocks) or stays open (none) costs little. */
#include "bd_hbm.h"

#include "bd_product.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

double bd_seconds(void) {
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int n_row(int l) { return l == 0 ? 1 : 2; } /* rows for each component of motion */

static void copy(double *to, const double *from, size_t n) {
    if (n > 0) memcpy(to, from, sizeof(double) * n);
}

/* Gr_l from the complex G_l (n_rows, n_mode), interleaved. */
static void expand_modes(double *real, const double *complex_G, size_t n_component, int n_mode, int l) {
    const size_t n = (size_t)n_mode;
    for (size_t i = 0; i < n_component; ++i)
        for (size_t j = 0; j < n; ++j) {
            const double re = complex_G[2 * (i * n + j)], im = complex_G[2 * (i * n + j) + 1];
            if (l == 0) {
                real[i * n + j] = re;
            } else {
                double *row = real + i * 4 * n;
                row[j] = re;
                row[n + j] = im;
                row[2 * n + j] = -im;
                row[3 * n + j] = re;
            }
        }
}

static void set_elements(bd_hbm *hbm, const bd_hbm_input *in) {
    for (int p = 0; p < in->n_point; ++p)
        hbm->element[p] = (bd_element){.law = (bd_law)in->law[p],
                                       .kt = {in->kt[2 * p], in->kt[2 * p + 1]},
                                       .kn = in->kn[p],
                                       .mu = in->mu[p],
                                       .n0 = in->n0[p],
                                       .w = {in->w[2 * p], in->w[2 * p + 1]}};
}

bd_status bd_hbm_create(bd_hbm *hbm, const bd_hbm_input *in) {
    memset(hbm, 0, sizeof *hbm);
    if (in->n_harm < 1 || in->n_harm > BD_MAX_HARM || in->n_point < 0) return BD_BAD_ARGUMENT;
    bd_status status = bd_evaluator_create(&hbm->evaluator, in->evaluation, in->n_harm, in->n_time);
    if (status != BD_OK) return status;
    const size_t n_coef = (size_t)bd_n_coef(in->n_harm), n_component = 3 * (size_t)in->n_point;
    const size_t n_group = (size_t)in->n_harm + 1;
    hbm->n_point = in->n_point;
    hbm->n_harm = in->n_harm;
    hbm->n_coef = (int)n_coef;
    hbm->n_mode = malloc(sizeof(int) * n_group);
    hbm->first = malloc(sizeof(int) * (n_group + 1));
    hbm->G = calloc(n_group, sizeof(double *));
    if (!hbm->n_mode || !hbm->first || !hbm->G) goto no_memory;
    size_t n_modes = 0;
    hbm->first[0] = 0;
    for (int l = 0; l <= in->n_harm; ++l) {
        hbm->n_mode[l] = in->n_mode[l];
        hbm->first[l + 1] = hbm->first[l] + n_row(l) * in->n_mode[l];
        n_modes += (size_t)in->n_mode[l];
    }
    const size_t n_unknown = (size_t)hbm->first[n_group];
    hbm->n_unknown = (int)n_unknown;
    /* some 512 kB of Z at a time */
    const size_t per_point = 3 * n_coef * bd_product_stride(n_unknown);
    hbm->chunk = (int)(65536 / per_point) + 1;
    if (hbm->chunk > in->n_point) hbm->chunk = in->n_point > 0 ? in->n_point : 1;

    hbm->stiffness = malloc(sizeof(double) * (n_modes + 1));
    hbm->mass = malloc(sizeof(double) * (n_modes + 1));
    hbm->damping = malloc(sizeof(double) * (n_modes + 1));
    hbm->force = malloc(sizeof(double) * (n_unknown + 1));
    hbm->element = malloc(sizeof(bd_element) * ((size_t)in->n_point + 1));
    hbm->share = calloc((size_t)in->n_point + 1, sizeof(bd_status_share));
    hbm->shift = malloc(sizeof(double) * (n_component + 1));
    hbm->X = calloc(n_component * n_coef + 1, sizeof(double));
    hbm->F = calloc(n_component * n_coef + 1, sizeof(double));
    hbm->gather = malloc(sizeof(double) * (2 * n_component + 1));
    hbm->block = malloc(sizeof(double) * 5 * n_coef * n_coef);
    hbm->Z = malloc(sizeof(double) * (size_t)hbm->chunk * per_point);
    if (!hbm->stiffness || !hbm->mass || !hbm->damping || !hbm->force || !hbm->element || !hbm->share || !hbm->shift ||
        !hbm->X || !hbm->F || !hbm->gather || !hbm->block || !hbm->Z)
        goto no_memory;
    copy(hbm->stiffness, in->stiffness, n_modes);
    copy(hbm->mass, in->mass, n_modes);
    copy(hbm->damping, in->damping, n_modes);
    copy(hbm->force, in->force, n_unknown);
    copy(hbm->shift, in->shift, n_component);
    set_elements(hbm, in);
    const double *G = in->G;
    for (int l = 0; l <= in->n_harm; ++l) {
        const size_t n = (size_t)in->n_mode[l], rows = (size_t)n_row(l);
        hbm->G[l] = malloc(sizeof(double) * (n_component * rows * rows * n + 1));
        if (!hbm->G[l]) goto no_memory;
        expand_modes(hbm->G[l], G, n_component, in->n_mode[l], l);
        G += 2 * n_component * n;
    }
    return BD_OK;
no_memory:
    bd_hbm_destroy(hbm);
    return BD_NO_MEMORY;
}

void bd_hbm_destroy(bd_hbm *hbm) {
    if (!hbm) return;
    if (hbm->G)
        for (int l = 0; l <= hbm->n_harm; ++l) free(hbm->G[l]);
    free(hbm->G);
    free(hbm->n_mode);
    free(hbm->first);
    free(hbm->stiffness);
    free(hbm->mass);
    free(hbm->damping);
    free(hbm->force);
    free(hbm->element);
    free(hbm->share);
    free(hbm->shift);
    free(hbm->X);
    free(hbm->F);
    free(hbm->gather);
    free(hbm->block);
    free(hbm->Z);
    bd_evaluator_destroy(&hbm->evaluator);
    memset(hbm, 0, sizeof *hbm);
}

/* ---- motion and force ---- */

/* y = Gr_l x, or y += Gr_l^T x. */
static void multiply_modes(bd_hbm *hbm, int l, int transposed, const double *x, double *y) {
    const size_t columns = (size_t)(n_row(l) * hbm->n_mode[l]), rows = 3 * (size_t)hbm->n_point * (size_t)n_row(l);
    if (transposed)
        bd_product_vector_transposed(rows, columns, hbm->G[l], x, y);
    else
        bd_product_vector(rows, columns, hbm->G[l], x, y);
}

static void find_motion(bd_hbm *hbm, const double *u) {
    const size_t n_component = 3 * (size_t)hbm->n_point, n_coef = (size_t)hbm->n_coef;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        multiply_modes(hbm, l, 0, u + hbm->first[l], hbm->gather);
        for (size_t i = 0; i < n_component; ++i) {
            double *X = hbm->X + i * n_coef;
            if (l == 0) {
                X[0] = hbm->gather[i] + hbm->shift[i];
            } else {
                X[2 * l - 1] = hbm->gather[2 * i];
                X[2 * l] = hbm->gather[2 * i + 1];
            }
        }
    }
}

static void add_contact_force(bd_hbm *hbm, double *r) {
    const size_t n_component = 3 * (size_t)hbm->n_point, n_coef = (size_t)hbm->n_coef;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        for (size_t i = 0; i < n_component; ++i) {
            const double *F = hbm->F + i * n_coef;
            if (l == 0) {
                hbm->gather[i] = F[0];
            } else {
                hbm->gather[2 * i] = F[2 * l - 1];
                hbm->gather[2 * i + 1] = F[2 * l];
            }
        }
        multiply_modes(hbm, l, 1, hbm->gather, r + hbm->first[l]);
    }
}

/* (K - (l omega)^2 M + i l omega C) q - E, and its derivatives. */
static void linear_part(const bd_hbm *hbm, const double *u, double omega, double *r, double *J, double *r_omega) {
    const size_t n = (size_t)hbm->n_unknown;
    const double *k = hbm->stiffness, *m = hbm->mass, *c = hbm->damping;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t n_mode = (size_t)hbm->n_mode[l], first = (size_t)hbm->first[l];
        for (size_t j = 0; j < n_mode; ++j, ++k, ++m, ++c) {
            const size_t a = first + j, b = a + n_mode;
            const double w = l * omega, dynamic = *k - w * w * *m, loss = w * *c;
            if (l == 0) {
                r[a] = *k * u[a] - hbm->force[a];
                if (J) J[a * n + a] += *k;
                if (r_omega) r_omega[a] = 0.0;
                continue;
            }
            r[a] = dynamic * u[a] + loss * u[b] - hbm->force[a];
            r[b] = dynamic * u[b] - loss * u[a] - hbm->force[b];
            if (J) {
                J[a * n + a] += dynamic;
                J[a * n + b] += loss;
                J[b * n + b] += dynamic;
                J[b * n + a] -= loss;
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

/* z (n_unknown) += row i of a tangent block times the rows of Gr that belong to component `component`. */
static void add_block_row(const bd_hbm *hbm, const double *block, int i, size_t component, double *restrict z) {
    const double *row = block + (size_t)i * (size_t)hbm->n_coef;
    for (int m = 0; m <= hbm->n_harm; ++m) {
        const size_t columns = (size_t)(n_row(m) * hbm->n_mode[m]);
        double *restrict to = z + hbm->first[m];
        if (m == 0) {
            const double *restrict g = hbm->G[0] + component * columns;
            if (row[0] != 0.0)
                for (size_t j = 0; j < columns; ++j) to[j] += row[0] * g[j];
            continue;
        }
        const double bc = row[2 * m - 1], bs = row[2 * m];
        const double *restrict gc = hbm->G[m] + component * 2 * columns, *restrict gs = gc + columns;
        if (bc != 0.0 && bs != 0.0)
            for (size_t j = 0; j < columns; ++j) to[j] += bc * gc[j] + bs * gs[j];
        else if (bc != 0.0)
            for (size_t j = 0; j < columns; ++j) to[j] += bc * gc[j];
        else if (bs != 0.0)
            for (size_t j = 0; j < columns; ++j) to[j] += bs * gs[j];
    }
}

/* Z holds, harmonic after harmonic, the rows (point of the chunk, component, cosine/sine). */
static double *z_row(const bd_hbm *hbm, int l, int n_in_chunk, size_t component, int part) {
    const size_t before = l == 0 ? 0 : (size_t)(2 * l - 1); /* rows for each component in lower harmonics */
    const size_t index = before * 3 * (size_t)n_in_chunk + component * (size_t)n_row(l) + (size_t)part;
    return hbm->Z + index * bd_product_stride((size_t)hbm->n_unknown);
}

static void fill_z(bd_hbm *hbm, int p, int place, int n_in_chunk, const bd_response *response) {
    for (int l = 0; l <= hbm->n_harm; ++l)
        for (int a = 0; a < 3; ++a)
            for (int part = 0; part < n_row(l); ++part) {
                double *z = z_row(hbm, l, n_in_chunk, 3 * (size_t)place + (size_t)a, part);
                const int i = l == 0 ? 0 : 2 * l - 1 + part;
                memset(z, 0, sizeof(double) * bd_product_stride((size_t)hbm->n_unknown));
                if (a < 2 && response->tangential[a]) {
                    add_block_row(hbm, response->dT[a], i, 3 * (size_t)p + (size_t)a, z);
                    add_block_row(hbm, response->dTv[a], i, 3 * (size_t)p + 2, z);
                } else if (a == 2 && response->normal) {
                    add_block_row(hbm, response->dN, i, 3 * (size_t)p + 2, z);
                }
            }
}

/* J += Gr^T Z for the points of the chunk that starts at first_point. */
static void add_products(bd_hbm *hbm, int first_point, int n_in_chunk, double *J) {
    const size_t n = (size_t)hbm->n_unknown;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t columns = (size_t)(n_row(l) * hbm->n_mode[l]), rows = 3 * (size_t)(n_in_chunk * n_row(l));
        const double *G = hbm->G[l] + 3 * (size_t)first_point * (size_t)n_row(l) * columns;
        bd_product_add(columns, n, rows, G, z_row(hbm, l, n_in_chunk, 0, 0), J + (size_t)hbm->first[l] * n);
    }
}

static bd_response response_of(bd_hbm *hbm, int p, int tangent) {
    const size_t nn = (size_t)hbm->n_coef * (size_t)hbm->n_coef;
    bd_response out = {.F = hbm->F + 3 * (size_t)p * (size_t)hbm->n_coef};
    if (tangent) {
        out.dT[0] = hbm->block;
        out.dT[1] = hbm->block + nn;
        out.dTv[0] = hbm->block + 2 * nn;
        out.dTv[1] = hbm->block + 3 * nn;
        out.dN = hbm->block + 4 * nn;
    }
    return out;
}

/* Contact forces of all points and, chunk by chunk, their share of J. */
static void contact_part(bd_hbm *hbm, double *J) {
    double started = bd_seconds();
    for (int first = 0; first < hbm->n_point; first += hbm->chunk) {
        const int n = first + hbm->chunk < hbm->n_point ? hbm->chunk : hbm->n_point - first;
        for (int place = 0; place < n; ++place) {
            const int p = first + place;
            bd_response response = response_of(hbm, p, J != NULL);
            bd_contact_evaluate(hbm->element + p, hbm->X + 3 * (size_t)p * (size_t)hbm->n_coef, &response,
                                hbm->share + p, &hbm->evaluator);
            if (J) fill_z(hbm, p, place, n, &response);
        }
        const double evaluated = bd_seconds();
        hbm->cost.contact += evaluated - started;
        started = evaluated;
        if (J) {
            add_products(hbm, first, n, J);
            started = bd_seconds();
            hbm->cost.assembly += started - evaluated;
        }
    }
}

static int all_finite(const double *x, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += x[i] * 0.0; /* NaN and infinity survive this */
    return sum == 0.0;
}

bd_status bd_hbm_evaluate(bd_hbm *hbm, const double *u, double omega, double *r, double *J, double *r_omega) {
    const size_t n = (size_t)hbm->n_unknown;
    if (!all_finite(u, n) || !isfinite(omega)) return BD_NOT_FINITE;
    const double started = bd_seconds();
    if (J) memset(J, 0, sizeof(double) * n * n);
    find_motion(hbm, u);
    linear_part(hbm, u, omega, r, J, r_omega);
    hbm->cost.assembly += bd_seconds() - started;
    contact_part(hbm, J);
    const double evaluated = bd_seconds();
    add_contact_force(hbm, r);
    hbm->cost.assembly += bd_seconds() - evaluated;
    ++hbm->cost.n_evaluation;
    if (J) ++hbm->cost.n_jacobian;
    return all_finite(r, n) && (!J || all_finite(J, n * n)) ? BD_OK : BD_NOT_FINITE;
}
