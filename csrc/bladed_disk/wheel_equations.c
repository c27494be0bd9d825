/* Harmonic balance of all sectors of a mistuned bladed disk.
 *
 * For every sector, with the coordinates of its blade and its damper and X_l = c_l - i s_l,
 *
 *     (K - (l omega)^2 M + i l omega C) X_l + P^T F_l - E_l = 0.
 *
 * Stiffness and mass of each blade are individual. The disk matrices and the damping C are
 * circulant: one matrix for each nodal diameter, applied by a real Fourier transform over the
 * sectors. Springs can act on the mean position of dampers. */
#include "bladed_disk/wheel_equations.h"

#include "util/clock.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* C (m, n; ldc) = A B with A (m, k; lda), B (k, n; ldb), or C += A B. */
static void multiply(const bd_wheel *w, int m, int n, int k, const double *A, int lda,
                     const double *B, int ldb, int add, double *C, int ldc) {
    for (int i = 0; i < m && !add; ++i)
        memset(C + (size_t)i * (size_t)ldc, 0, sizeof(double) * (size_t)n);
    w->ring.kernel->add_product((size_t)m, (size_t)n, (size_t)k, 1.0, A, (size_t)lda, B,
                                (size_t)ldb, C, (size_t)ldc);
}

/* Coefficient c belongs to the mean (0), a cosine (1) or a sine (-1). */
static int phase(int c) { return c == 0 ? 0 : c % 2 ? 1 : -1; }

/* ---- storage ---- */

void bd_wheel_to_vector(const bd_wheel *w, const double *u, double *x) {
    const int N = w->input.n_sector, ns = w->sector_size, nc = w->n_coef;
    memset(x, 0, sizeof(double) * (size_t)w->vector_size);
    for (int c = 0; c < nc; ++c) {
        if (!w->input.active[c]) continue;
        for (int n = 0; n < N; ++n, u += ns)
            memcpy(x + (n * nc + c) * ns, u, sizeof(double) * (size_t)ns);
    }
}

void bd_wheel_to_unknowns(const bd_wheel *w, const double *x, double *u) {
    const int N = w->input.n_sector, ns = w->sector_size, nc = w->n_coef;
    for (int c = 0; c < nc; ++c) {
        if (!w->input.active[c]) continue;
        for (int n = 0; n < N; ++n, u += ns)
            memcpy(u, x + (n * nc + c) * ns, sizeof(double) * (size_t)ns);
    }
}

/* Blade coordinates (n_sector, n_coef, n_blade) of a vector. */
static void copy_blades(const bd_wheel *w, const double *x, double *blade) {
    const size_t nb = (size_t)w->input.n_blade, rows = (size_t)(w->input.n_sector * w->n_coef);
    for (size_t i = 0; i < rows; ++i)
        memcpy(blade + i * nb, x + i * (size_t)w->sector_size, sizeof(double) * nb);
}

/* ---- disk and damping ---- */

/* y += A x, complex; A stored as in bd_waves. */
static void add_complex(int n, const double *A, const double *re, const double *im,
                        double *restrict y, double *restrict y_imaginary) {
    const double *B = A + (size_t)n * (size_t)n;
    for (int j = 0; j < n; ++j) {
        const double *a = A + (size_t)(j * n), *b = B + (size_t)(j * n), x = re[j], z = im[j];
        for (int i = 0; i < n; ++i) {
            y[i] += a[i] * x - b[i] * z;
            y_imaginary[i] += a[i] * z + b[i] * x;
        }
    }
}

/* One wave of one coefficient of harmonic l: K x - (l omega)^2 M x + l omega C x', with x' from the
 * other coefficient. */
static void wave_product(const bd_wheel *w, const bd_waves *waves, int d, int l, double omega,
                         double sense, const double *x[4], double *lin[2], double *rate[2],
                         double *t) {
    const int nb = w->input.n_blade, nr = w->input.n_root, root = nb - nr;
    const double f = l * omega;
    double *K[2] = {t + root, t + nb + root}, *M[2] = {K[0] + 2 * nb, K[1] + 2 * nb},
           *C[2] = {t + 4 * nb, t + 5 * nb};
    memset(t, 0, sizeof(double) * 6 * (size_t)nb);
    add_complex(nr, waves->stiffness + (size_t)(2 * d * nr * nr), x[0] + root, x[1] + root, K[0],
                K[1]);
    if (l > 0) {
        add_complex(nr, waves->mass + (size_t)(2 * d * nr * nr), x[0] + root, x[1] + root, M[0],
                    M[1]);
        add_complex(nb, waves->damping + (size_t)(2 * d * nb * nb), x[2], x[3], C[0], C[1]);
    }
    for (int part = 0; part < 2; ++part) {
        const double *k = t + part * nb, *m = k + 2 * nb, *c = k + 4 * nb;
        for (int i = 0; i < nb; ++i) {
            lin[part][i] = k[i] - f * f * m[i] + sense * f * c[i];
            if (rate) rate[part][i] = sense * l * c[i] - 2.0 * l * f * m[i];
        }
    }
}

/* out (a vector) += circulant part times the blade coordinates; the derivative with respect to
 * omega is added to `by`, unless NULL. Optionally with the transposed matrix. */
void bd_wheel_add_waves(bd_wheel *w, const bd_waves *waves, double omega, int transposed,
                        const double *blade, double *out, double *by) {
    const int N = w->input.n_sector, D = w->n_wave, nb = w->input.n_blade, nc = w->n_coef,
              m = nc * nb;
    const size_t part_size = (size_t)(D * m);
    double *in = w->wave_work, *lin = in + 2 * part_size, *rate = lin + 2 * part_size,
           *t = rate + 2 * part_size;
    multiply(w, D, m, N, w->cosine, N, blade, m, 0, in, m);
    multiply(w, D, m, N, w->sine, N, blade, m, 0, in + part_size, m);
    memset(lin, 0, sizeof(double) * 4 * part_size);
    for (int d = 0; d < D; ++d) {
        const double weight = (d == 0 || 2 * d == N ? 1.0 : 2.0) / N;
        for (int c = 0; c < nc; ++c) {
            if (!w->input.active[c]) continue;
            const size_t at = (size_t)(d * m + c * nb),
                         other = (size_t)(d * m + (c + phase(c)) * nb);
            const double *x[4] = {in + at, in + part_size + at, in + other, in + part_size + other};
            double *to[2] = {lin + at, lin + part_size + at},
                   *to_rate[2] = {rate + at, rate + part_size + at};
            wave_product(w, waves, d, (c + 1) / 2, omega, transposed ? -phase(c) : phase(c), x, to,
                         by ? to_rate : NULL, t);
        }
        for (size_t i = (size_t)(d * m); i < (size_t)((d + 1) * m); ++i) {
            lin[i] *= weight, lin[part_size + i] *= weight;
            rate[i] *= weight, rate[part_size + i] *= weight;
        }
    }
    for (int which = 0; which < (by ? 2 : 1); ++which) {
        const double *wave = which ? rate : lin;
        double *to = which ? by : out;
        memset(w->motion, 0, sizeof(double) * (size_t)(N * m));
        w->ring.kernel->product((size_t)N, (size_t)m, (size_t)D, w->cosine, wave, (size_t)m,
                                w->motion, (size_t)m);
        w->ring.kernel->product((size_t)N, (size_t)m, (size_t)D, w->sine, wave + part_size,
                                (size_t)m, w->motion, (size_t)m);
        for (int i = 0; i < N * nc; ++i)
            for (int j = 0; j < nb; ++j)
                to[(size_t)i * (size_t)w->sector_size + (size_t)j] += w->motion[i * nb + j];
    }
}

/* ---- linear parts ---- */

/* out = linear part times x, by = its derivative with respect to omega, unless NULL. Optionally
 * with the transposed matrix. */
static void linear_part(bd_wheel *w, double omega, int transposed, const double *x, double *out,
                        double *by) {
    const bd_wheel_input *in = &w->input;
    const int N = in->n_sector, nb = in->n_blade, nd = in->n_damper, nc = w->n_coef,
              ns = w->sector_size;
    copy_blades(w, x, w->blade_motion);
    multiply(w, N * nc, nb, nb, w->blade_motion, nb, in->mass, nb, 0, w->inertia, nb);
    memset(out, 0, sizeof(double) * (size_t)w->vector_size);
    if (by) memset(by, 0, sizeof(double) * (size_t)w->vector_size);
    for (int n = 0; n < N; ++n) {
        const size_t first = (size_t)(n * nc * ns);
        multiply(w, nc, nb, nb, w->blade_motion + (size_t)(n * nc * nb), nb,
                 in->stiffness + (size_t)(n * nb * nb), nb, 0, out + first, ns);
        for (int c = 0; c < nc; ++c) {
            if (!in->active[c]) continue;
            const int l = (c + 1) / 2;
            const double f = l * omega, sense = transposed ? -phase(c) : phase(c);
            double *to = out + first + c * ns, *rate = by ? by + first + c * ns : NULL;
            const double *heavy = w->inertia + (size_t)((n * nc + c) * nb),
                         *y = x + first + c * ns + nb;
            const double *other = y + phase(c) * ns;
            for (int i = 0; i < nb; ++i) {
                to[i] -= f * f * heavy[i];
                if (rate) rate[i] -= 2.0 * l * f * heavy[i];
            }
            for (int i = 0; i < nd; ++i) {
                const double mass = in->damper_mass[n * nd + i],
                             damping = sense * in->damper_damping[i];
                to[nb + i] = (in->damper_stiffness[i] - f * f * mass) * y[i] +
                             (l ? f * damping * other[i] : 0.0);
                if (rate && l) rate[nb + i] = l * damping * other[i] - 2.0 * l * f * mass * y[i];
            }
        }
    }
    bd_wheel_add_waves(w, &w->waves, omega, transposed, w->blade_motion, out, by);
}

/* Rows of inactive coordinates: out = x, by = 0. */
static void set_inactive_rows(const bd_wheel *w, const double *x, double *out, double *by) {
    const int N = w->input.n_sector, nc = w->n_coef, ns = w->sector_size, nb = w->input.n_blade;
    for (int n = 0; n < N; ++n)
        for (int c = 0; c < nc; ++c) {
            if (w->input.active[c] && !w->input.pinned[n]) continue;
            for (int i = w->input.active[c] ? nb : 0; i < ns; ++i) {
                const size_t at = (size_t)((n * nc + c) * ns + i);
                out[at] = x[at];
                if (by) by[at] = 0.0;
            }
        }
}

/* ---- contact ---- */

/* Combine each sector's damper with the blade of the next sector. */
static void shift_blades(const bd_wheel *w, const double *x, double *to) {
    const int N = w->input.n_sector, nb = w->input.n_blade;
    const size_t ns = (size_t)w->sector_size, rows = (size_t)w->n_coef;
    memcpy(to, x, sizeof(double) * (size_t)w->vector_size);
    for (int n = 0; n < N; ++n)
        for (size_t c = 0; c < rows; ++c)
            memcpy(to + ((size_t)n * rows + c) * ns, x + ((size_t)((n + 1) % N) * rows + c) * ns,
                   sizeof(double) * (size_t)nb);
}

/* Motion of all points (n_sector, n_point, 3, n_coef). */
static void find_motion(bd_wheel *w, const double *x, double *X) {
    const int rows = w->input.n_sector * w->n_coef, ns = w->sector_size, nc = w->n_coef,
              *point = w->ring.point;
    const double *R = w->ring.rows_transposed, *from = x;
    for (int g = 0; g < 2; ++g) {
        const int n = w->ring.n_group[g], wide = 3 * n;
        if (g) shift_blades(w, x, w->shifted), from = w->shifted;
        multiply(w, rows, wide, ns, from, ns, R, wide, 0, w->motion, wide);
        for (int row = 0; row < rows; ++row)
            for (int k = 0; k < wide; ++k) {
                const int p = row / nc * w->input.n_point + point[k / 3];
                X[(size_t)((3 * p + k % 3) * nc + row % nc)] = w->motion[row * wide + k];
            }
        R += wide * ns, point += n;
    }
}

/* out += forces at the points (n_sector, n_point, 3, n_coef) on the coordinates. */
static void add_forces(bd_wheel *w, const double *F, double *out) {
    const int N = w->input.n_sector, ns = w->sector_size, nc = w->n_coef, rows = N * nc,
              nb = w->input.n_blade, *point = w->ring.point;
    const double *R = w->ring.rows;
    for (int g = 0; g < 2; ++g) {
        const int n = w->ring.n_group[g], wide = 3 * n;
        for (int row = 0; row < rows; ++row)
            for (int k = 0; k < wide; ++k) {
                const int p = row / nc * w->input.n_point + point[k / 3];
                w->motion[row * wide + k] = F[(size_t)((3 * p + k % 3) * nc + row % nc)];
            }
        double *to = g ? w->shifted : out;
        multiply(w, rows, ns, wide, w->motion, wide, R, ns, !g, to, ns);
        R += wide * ns, point += n;
    }
    for (int row = 0; row < rows; ++row) {
        const double *from = w->shifted + (size_t)(row * ns);
        double *blade = out + (size_t)((row + nc) % rows * ns), *damper = out + (size_t)(row * ns);
        for (int i = 0; i < nb; ++i) blade[i] += from[i];
        for (int i = nb; i < ns; ++i) damper[i] += from[i];
    }
}

/* Forces and optional tangents of n <= BD_LANES points from `first` on. */
static void evaluate_points(bd_wheel *w, int first, int n, int derivative) {
    const size_t nc = (size_t)w->n_coef, nn = nc * nc;
    bd_response out[BD_LANES];
    for (int i = 0; i < n; ++i) {
        out[i] = (bd_response){.F = w->F + 3 * nc * (size_t)(first + i)};
        if (!derivative) continue;
        double *block = w->tangent + 7 * nn * (size_t)(first + i);
        for (int d = 0; d < 2; ++d) {
            out[i].dT[d] = block + (size_t)d * nn;
            out[i].dTv[d] = block + (size_t)(2 + d) * nn;
            out[i].dTc[d] = block + (size_t)(4 + d) * nn;
        }
        out[i].dN = block + 6 * nn;
    }
    bd_contact_evaluate_many(n, w->element + first, w->X + 3 * nc * (size_t)first, out,
                             w->share + first, &w->evaluator);
    for (int i = 0; derivative && i < n; ++i) {
        w->form[first + i] = (unsigned char)bd_element_form(out + i);
        bd_element_write_blocks(w->element + first + i, w->input.n_harm, out + i);
        double *block = w->tangent + 7 * nn * (size_t)(first + i);
        for (size_t c = 0; c < nc; ++c) {
            if (w->input.active[c]) continue;
            for (size_t k = 0; k < 7; ++k)
                for (size_t d = 0; d < nc; ++d)
                    block[k * nn + c * nc + d] = block[k * nn + d * nc + c] = 0.0;
        }
    }
}

static void evaluate_contact(bd_wheel *w, int derivative) {
    const int n = w->input.n_sector * w->input.n_point;
    find_motion(w, w->x, w->X);
    for (int i = 0; i < 3 * n; ++i) w->X[(size_t)(i * w->n_coef)] += w->input.shift[i];
    for (int first = 0; first < n; first += BD_LANES)
        evaluate_points(w, first, n - first < BD_LANES ? n - first : BD_LANES, derivative);
}

/* F = tangents times motions X, or transposed. */
static void apply_tangents(const bd_wheel *w, int transposed, const double *X, double *F) {
    static const int FORCE[7] = {0, 1, 0, 1, 0, 1, 2}, MOTION[7] = {0, 1, 2, 2, 1, 0, 2};
    const int nc = w->n_coef, points = w->input.n_sector * w->input.n_point;
    memset(F, 0, sizeof(double) * (size_t)(3 * points * nc));
    const double *T = w->tangent;
    for (int p = 0; p < points; ++p)
        for (int k = 0; k < 7; ++k, T += nc * nc) {
            const size_t force = (size_t)((3 * p + FORCE[k]) * nc),
                         motion = (size_t)((3 * p + MOTION[k]) * nc);
            for (int c = 0; c < nc; ++c)
                for (int d = 0; d < nc; ++d) {
                    if (transposed)
                        F[motion + (size_t)d] += T[c * nc + d] * X[force + (size_t)c];
                    else
                        F[force + (size_t)c] += T[c * nc + d] * X[motion + (size_t)d];
                }
        }
}

/* ---- equations ---- */

static bd_status evaluate_wheel(bd_equations *e, const double *y, int derivative) {
    bd_wheel *w = (bd_wheel *)e;
    const size_t n = (size_t)e->n;
    const int N = w->input.n_sector, nb = w->input.n_blade, nd = w->input.n_damper, nc = w->n_coef,
              ns = w->sector_size;
    double sum = 0.0;
    for (size_t i = 0; i <= n; ++i) sum += y[i] * 0.0;
    if (sum != 0.0) return BD_NOT_FINITE;
    bd_wheel_to_vector(w, y, w->x);
    double clock = bd_seconds(), *r = w->product;
    evaluate_contact(w, derivative);
    w->cost.contact += bd_seconds() - clock, clock = bd_seconds();
    linear_part(w, y[n], 0, w->x, r, derivative ? w->C : NULL);
    add_forces(w, w->F, r);
    for (int k = 0; k < N; ++k)
        for (int i = 0; i < nd; ++i) {
            const size_t at = (size_t)(k * nc * ns + nb + i);
            r[at] += w->input.springs[k * nd + i] * (w->x[at] - w->input.spring_origin[k * nd + i]);
        }
    set_inactive_rows(w, w->x, r, derivative ? w->C : NULL);
    bd_wheel_to_unknowns(w, r, e->r);
    if (derivative) {
        w->omega = y[n];
        bd_wheel_to_unknowns(w, w->C, e->C);
    }
    for (size_t i = 0; i < n; ++i) {
        e->r[i] -= w->input.force[i];
        sum += e->r[i] * 0.0;
    }
    w->cost.assembly += bd_seconds() - clock;
    ++w->cost.n_evaluation;
    w->cost.n_jacobian += derivative;
    return sum == 0.0 ? BD_OK : BD_NOT_FINITE;
}

/* out = J x or J^T x, at the latest point evaluated with derivatives. */
void bd_wheel_multiply(bd_wheel *w, int transposed, const double *x, double *out) {
    const int N = w->input.n_sector, nb = w->input.n_blade, nd = w->input.n_damper, nc = w->n_coef,
              ns = w->sector_size;
    double *X = w->work, *F = X + 3 * N * w->input.n_point * nc;
    linear_part(w, w->omega, transposed, x, out, NULL);
    find_motion(w, x, X);
    apply_tangents(w, transposed, X, F);
    add_forces(w, F, out);
    for (int k = 0; k < N; ++k)
        for (int i = 0; i < nd; ++i)
            out[k * nc * ns + nb + i] += w->springs[k * nd + i] * x[k * nc * ns + nb + i];
    set_inactive_rows(w, x, out, NULL);
}

static bd_status product_wheel(bd_equations *e, int transposed, const double *x, double *out) {
    bd_wheel *w = (bd_wheel *)e;
    bd_wheel_to_vector(w, x, w->b);
    bd_wheel_multiply(w, transposed, w->b, w->product);
    bd_wheel_to_unknowns(w, w->product, out);
    return BD_OK;
}

/* ---- creation ---- */

static void destroy_wheel(bd_equations *e) {
    bd_wheel *w = (bd_wheel *)e;
    bd_ring_destroy(&w->ring);
    bd_evaluator_destroy(&w->evaluator);
    free(w->memory);
    free(w->element);
    free(w->share);
    free(w->form);
    free((void *)w->input.on_next);
    free(w);
}

static const bd_equations_type WHEEL = {evaluate_wheel, bd_wheel_factor,
                                        bd_wheel_solve, bd_wheel_solve_transposed,
                                        product_wheel,  destroy_wheel};

/* One array in the common memory: its pointer, its length and its initial values (NULL: none). */
typedef struct {
    double **to;
    size_t n;
    const double *from;
} part;

/* Real and imaginary part of (n, n) wave matrices by columns, from interleaved rows. */
static void split_waves(const double *from, int waves, int n, double *to) {
    const size_t nn = (size_t)(n * n);
    for (size_t d = 0; d < (size_t)waves; ++d)
        for (size_t i = 0; i < (size_t)n; ++i)
            for (size_t j = 0; j < (size_t)n; ++j) {
                to[2 * d * nn + j * (size_t)n + i] = from[2 * (d * nn + i * (size_t)n + j)];
                to[(2 * d + 1) * nn + j * (size_t)n + i] =
                    from[2 * (d * nn + i * (size_t)n + j) + 1];
            }
}

/* Extract the coupling (n, n) of a sector to the sector `behind` sectors before it; subtract it and
 * its transpose from the waves. */
static void extract_coupling(const bd_wheel *w, int n, int n_kept, int behind, double *waves,
                             double *kernel) {
    const int N = w->input.n_sector, first = n - n_kept;
    const size_t nn = (size_t)(n * n);
    memset(kernel, 0, sizeof(double) * (size_t)(n_kept * n_kept));
    for (int pass = 0; pass < 2; ++pass)
        for (int d = 0; d < w->n_wave; ++d) {
            const double angle = BD_TWO_PI * d * behind / N,
                         weight = (d == 0 || 2 * d == N ? 1.0 : 2.0) / N;
            double *re = waves + 2 * (size_t)d * nn, *im = re + nn;
            for (int i = 0; i < n_kept; ++i)
                for (int j = 0; j < n_kept; ++j) {
                    const size_t at = (size_t)((first + j) * n + first + i);
                    double *to = kernel + i * n_kept + j;
                    if (pass == 0) {
                        *to += weight * (re[at] * cos(angle) - im[at] * sin(angle));
                    } else {
                        const double back = behind ? kernel[j * n_kept + i] : 0.0;
                        re[at] -= (*to + back) * cos(angle);
                        im[at] -= (back - *to) * sin(angle);
                    }
                }
        }
}

/* Split the circulant matrices into the part in the elimination and the remainder. */
static void split_couplings(bd_wheel *w) {
    const bd_wheel_input *in = &w->input;
    const size_t D = (size_t)w->n_wave, r = (size_t)in->n_root, b = (size_t)in->n_blade,
                 first = b - r;
    double *full[3] = {w->waves.stiffness, w->waves.mass, w->waves.damping};
    double *far[3] = {w->remainder.stiffness, w->remainder.mass, w->remainder.damping};
    for (int k = 0; k < 3; ++k) {
        const int n = k < 2 ? in->n_root : in->n_blade;
        memcpy(far[k], full[k], sizeof(double) * 2 * D * (size_t)(n * n));
        extract_coupling(w, n, n, 0, far[k], w->wave_work);
        memset(w->sector_part[k], 0, sizeof(double) * b * b);
        for (size_t i = 0; i < (size_t)n; ++i)
            for (size_t j = 0; j < (size_t)n; ++j)
                w->sector_part[k][(i + (k < 2 ? first : 0)) * b + j + (k < 2 ? first : 0)] =
                    w->wave_work[i * (size_t)n + j];
        if (k < 2) extract_coupling(w, n, in->n_kept, 1, far[k], w->neighbour_part[k]);
    }
}

static bd_status arrays_create(bd_wheel *w, const bd_wheel_input *in, const part *parts,
                               size_t n_part) {
    size_t total = BD_KERNEL_PAD;
    for (size_t i = 0; i < n_part; ++i) total += parts[i].n;
    if (!(w->memory = malloc(sizeof(double) * total))) return BD_NO_MEMORY;
#ifdef BD_POISON
    for (size_t i = 0; i < total; ++i) w->memory[i] = NAN;
#endif
    double *p = w->memory;
    for (size_t i = 0; i < n_part; p += parts[i++].n) {
        *parts[i].to = p;
        if (parts[i].from) memcpy(p, parts[i].from, sizeof(double) * parts[i].n);
    }
    const int points = in->n_sector * in->n_point;
    for (int i = 0; i < points; ++i)
        w->element[i] = (bd_element){.law = (bd_law)in->law[i],
                                     .kt = {in->kt[2 * i], in->kt[2 * i + 1]},
                                     .kn = in->kn[i],
                                     .mu = in->mu[i],
                                     .n0 = in->n0[i],
                                     .w = {in->w[2 * i], in->w[2 * i + 1]},
                                     .load = in->load[i]};
    split_waves(in->disk_stiffness, w->n_wave, in->n_root, w->waves.stiffness);
    split_waves(in->disk_mass, w->n_wave, in->n_root, w->waves.mass);
    split_waves(in->damping, w->n_wave, in->n_blade, w->waves.damping);
    for (int d = 0; d < w->n_wave; ++d)
        for (int n = 0; n < in->n_sector; ++n) {
            w->cosine[d * in->n_sector + n] =
                cos(BD_TWO_PI * ((d * n) % in->n_sector) / in->n_sector);
            w->sine[d * in->n_sector + n] =
                -sin(BD_TWO_PI * ((d * n) % in->n_sector) / in->n_sector);
        }
    for (int i = 0; i < in->n_sector * in->n_damper; ++i)
        w->springs[i] = in->springs[i] + in->jacobian_springs[i];
    split_couplings(w);
    memset(w->scale, 0, sizeof(double) * ((size_t)w->vector_size + 1));
    return BD_OK;
}

/* Sizes and memory; the arrays of the input are copied, and `input` points to the copies. */
static bd_status parts_create(bd_wheel *w, const bd_wheel_input *in) {
    const size_t N = (size_t)in->n_sector, H = (size_t)in->n_harm + 1,
                 nc = (size_t)bd_n_coef(in->n_harm);
    const size_t b = (size_t)in->n_blade, r = (size_t)in->n_root, k = (size_t)in->n_kept,
                 d = (size_t)in->n_damper;
    const size_t D = N / 2 + 1, ns = b + d, W = N * nc * ns, points = N * (size_t)in->n_point,
                 Y = N * nc * b;
    const size_t n = (size_t)w->base.n, n1 = n + 1, force = 3 * points * nc,
                 most = W + 1 > 2 * force ? W + 1 : 2 * force;
    const size_t M = BD_WHEEL_KRYLOV, hat = 6 * D * nc * b + 6 * b,
                 kernel = b * b > hat ? b * b : hat;
    bd_wheel_input *copies = &w->input;
    *copies = *in;
    w->n_coef = (int)nc, w->n_wave = (int)D, w->sector_size = (int)ns, w->vector_size = (int)W;
    const part parts[] = {
        {(double **)&copies->motion_rows, 3 * (size_t)in->n_point * ns, in->motion_rows},
        {(double **)&copies->stiffness, N * b * b, in->stiffness},
        {(double **)&copies->mass, b * b, in->mass},
        {(double **)&copies->damper_stiffness, d, in->damper_stiffness},
        {(double **)&copies->damper_mass, N * d, in->damper_mass},
        {(double **)&copies->damper_damping, d, in->damper_damping},
        {(double **)&copies->springs, N * d, in->springs},
        {(double **)&copies->spring_origin, N * d, in->spring_origin},
        {(double **)&copies->shift, 3 * points, in->shift},
        {(double **)&copies->force, n, in->force},
        {&w->base.row_scale, n, in->row_scale},
        {&w->base.r, n, NULL},
        {&w->base.C, n, NULL},
        {&w->base.scratch, 4 * n1, NULL},
        {&w->waves.stiffness, 2 * D * r * r, NULL},
        {&w->waves.mass, 2 * D * r * r, NULL},
        {&w->waves.damping, 2 * D * b * b, NULL},
        {&w->remainder.stiffness, 2 * D * r * r, NULL},
        {&w->remainder.mass, 2 * D * r * r, NULL},
        {&w->remainder.damping, 2 * D * b * b, NULL},
        {&w->sector_part[0], b * b, NULL},
        {&w->sector_part[1], b * b, NULL},
        {&w->sector_part[2], b * b, NULL},
        {&w->neighbour_part[0], k * k, NULL},
        {&w->neighbour_part[1], k * k, NULL},
        {&w->cosine, D * N, NULL},
        {&w->sine, D * N, NULL},
        {&w->X, force, NULL},
        {&w->F, force, NULL},
        {&w->tangent, 7 * points * nc * nc, NULL},
        {&w->x, W, NULL},
        {&w->shifted, W, NULL},
        {&w->motion, force > Y ? force : Y, NULL},
        {&w->blade_motion, Y, NULL},
        {&w->inertia, Y, NULL},
        {&w->wave_work, kernel, NULL},
        {&w->matrices, 2 * H * b * b + 2 * H * N * d + H * k * k, NULL},
        {&w->springs, N * d, NULL},
        {&w->C, W + 1, NULL},
        {&w->border, W + 1, NULL},
        {&w->scale, W + 1, NULL},
        {&w->column, W + 1, NULL},
        {&w->b, 3 * (W + 1), NULL},
        {&w->product, W + 1, NULL},
        {&w->work, most, NULL},
        {&w->krylov, (M + 1) * (Y + M + W) + 5 * M, NULL},
    };
    unsigned char *flags = malloc((size_t)in->n_point + nc + N);
    copies->on_next = flags;
    w->element = malloc(sizeof(bd_element) * (points + 1));
    w->share = malloc(sizeof(bd_status_share) * (points + 1));
    w->form = malloc(points + 1);
    if (!flags || !w->element || !w->share || !w->form) return BD_NO_MEMORY;
    copies->active = flags + in->n_point, copies->pinned = copies->active + nc;
    memcpy(flags, in->on_next, (size_t)in->n_point);
    memcpy(flags + in->n_point, in->active, nc);
    memcpy(flags + (size_t)in->n_point + nc, in->pinned, N);
    return arrays_create(w, in, parts, sizeof parts / sizeof *parts);
}

bd_status bd_wheel_create(bd_wheel **out, const bd_wheel_input *in) {
    *out = NULL;
    bd_wheel *w = calloc(1, sizeof *w);
    if (!w) return BD_NO_MEMORY;
    int active = 0;
    for (int c = 0; c < bd_n_coef(in->n_harm); ++c) active += in->active[c] != 0;
    w->base = (bd_equations){.type = &WHEEL,
                             .n = active * in->n_sector * (in->n_blade + in->n_damper),
                             .k = 1,
                             .cost = &w->cost};
    bd_status status = parts_create(w, in);
    const bd_wheel_input *copies = &w->input;
    const bd_ring_input ring = {in->n_sector,   w->n_coef,     in->n_blade,     in->n_damper,
                                in->n_kept,     in->n_point,   copies->on_next, copies->motion_rows,
                                copies->active, copies->pinned};
    if (status == BD_OK) status = bd_ring_create(&w->ring, &ring);
    if (status == BD_OK)
        status = bd_evaluator_create(&w->evaluator, in->evaluation, in->n_harm, in->n_time);
    if (status == BD_OK)
        *out = w;
    else
        destroy_wheel(&w->base);
    return status;
}
