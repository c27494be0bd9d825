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
#include "util/storage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* C = A B, or C += A B with `add`: A (m, k), B (k, n), C (m, n) with rows of length lda, ldb,
 * ldc. */
static void multiply(const bd_wheel *w, int m, int n, int k, const double *A, int lda,
                     const double *B, int ldb, int add, double *C, int ldc) {
    if (!add) {
        for (int i = 0; i < m; ++i)
            memset(C + (size_t)i * (size_t)ldc, 0, sizeof(double) * (size_t)n);
    }
    w->ring.kernel->add_product((size_t)m, (size_t)n, (size_t)k, 1.0, A, (size_t)lda, B,
                                (size_t)ldb, C, (size_t)ldc);
}

/* Coefficient c belongs to the mean (0), a cosine (1) or a sine (-1). The other coefficient of its
 * harmonic is c + phase(c). The phase is also the sign of damping, i l omega C (a - i b): the
 * equations of the cosine a have l omega C b, and the equations of the sine b have -l omega C a. */
static int phase(int c) {
    if (c == 0) return 0;
    return c % 2 ? 1 : -1;
}

/* ---- storage ---- */

/* Internal vector x (n_sector, n_coef, sector_size) from the unknowns u of the equations (active
 * coefficients, n_sector, sector_size); inactive coefficients are zero. */
void bd_wheel_to_vector(const bd_wheel *w, const double *u, double *x) {
    const int N = w->input.n_sector, ns = w->sector_size, nc = w->n_coef;
    const size_t sector_bytes = sizeof(double) * (size_t)ns;
    memset(x, 0, sizeof(double) * (size_t)w->vector_size);
    for (int c = 0; c < nc; ++c) {
        if (!w->input.active[c]) continue;
        for (int n = 0; n < N; ++n, u += ns) memcpy(x + (n * nc + c) * ns, u, sector_bytes);
    }
}

/* Unknowns u of the equations (active coefficients, n_sector, sector_size) from an internal vector
 * x (n_sector, n_coef, sector_size). */
void bd_wheel_to_unknowns(const bd_wheel *w, const double *x, double *u) {
    const int N = w->input.n_sector, ns = w->sector_size, nc = w->n_coef;
    const size_t sector_bytes = sizeof(double) * (size_t)ns;
    for (int c = 0; c < nc; ++c) {
        if (!w->input.active[c]) continue;
        for (int n = 0; n < N; ++n, u += ns) memcpy(u, x + (n * nc + c) * ns, sector_bytes);
    }
}

/* Blade coordinates (n_sector, n_coef, n_blade) of a vector. */
static void copy_blades(const bd_wheel *w, const double *x, double *blade) {
    const size_t nb = (size_t)w->input.n_blade, ns = (size_t)w->sector_size;
    const size_t rows = (size_t)(w->input.n_sector * w->n_coef);
    for (size_t i = 0; i < rows; ++i) memcpy(blade + i * nb, x + i * ns, sizeof(double) * nb);
}

/* ---- disk and damping ---- */

/* Real and imaginary part of an array. */
typedef struct {
    const double *re, *im;
} complex_input;

typedef struct {
    double *re, *im;
} complex_array;

/* y (n) += A x (n), complex; A (n, n) is stored by columns, the real part before the imaginary part
 * (bd_waves). */
static void add_complex(int n, const double *A, complex_input x, complex_array y) {
    const double *A_imaginary = A + (size_t)n * (size_t)n;
    double *restrict y_re = y.re, *restrict y_im = y.im;
    for (int j = 0; j < n; ++j) {
        const double *re = A + (size_t)(j * n), *im = A_imaginary + (size_t)(j * n);
        const double x_re = x.re[j], x_im = x.im[j];
        for (int i = 0; i < n; ++i) {
            y_re[i] += re[i] * x_re - im[i] * x_im;
            y_im[i] += re[i] * x_im + im[i] * x_re;
        }
    }
}

/* A wave: nodal diameter, harmonic, frequency, and the sign of the damping, see phase(). */
typedef struct {
    int diameter, harmonic;
    double omega, sign;
} wave_terms;

/* One coefficient x of a wave of harmonic l, whose other coefficient is x':
 * lin = K x - (l omega)^2 M x + sign l omega C x', and rate, its derivative with respect to omega,
 * unless rate.re is NULL. work is (6, n_blade). */
static void wave_product(const bd_wheel *w, const bd_waves *waves, wave_terms wave, complex_input x,
                         complex_input x_other, complex_array lin, complex_array rate,
                         double *work) {
    const int nb = w->input.n_blade, nr = w->input.n_root;
    const int d = wave.diameter, l = wave.harmonic;
    const double f = l * wave.omega, sign = wave.sign;
    const size_t root_matrix = (size_t)(2 * d * nr * nr), blade_matrix = (size_t)(2 * d * nb * nb);
    double *Kx[2] = {work, work + nb};
    double *Mx[2] = {work + 2 * nb, work + 3 * nb};
    double *Cx[2] = {work + 4 * nb, work + 5 * nb}; /* C x' */
    memset(work, 0, sizeof(double) * 6 * (size_t)nb);

    /* stiffness and mass of the disk act on the root, the last coordinates of a blade */
    const int root = nb - nr;
    const complex_input x_root = {x.re + root, x.im + root};
    const complex_array K_root = {Kx[0] + root, Kx[1] + root};
    add_complex(nr, waves->stiffness + root_matrix, x_root, K_root);
    if (l > 0) {
        const complex_array M_root = {Mx[0] + root, Mx[1] + root};
        const complex_array C_blade = {Cx[0], Cx[1]};
        add_complex(nr, waves->mass + root_matrix, x_root, M_root);
        add_complex(nb, waves->damping + blade_matrix, x_other, C_blade);
    }

    double *to_lin[2] = {lin.re, lin.im}, *to_rate[2] = {rate.re, rate.im};
    for (int part = 0; part < 2; ++part) {
        const double *k = Kx[part], *m = Mx[part], *c = Cx[part];
        double *of_lin = to_lin[part], *of_rate = to_rate[part];
        for (int i = 0; i < nb; ++i) of_lin[i] = k[i] - f * f * m[i] + sign * f * c[i];
        if (!of_rate) continue;
        for (int i = 0; i < nb; ++i) of_rate[i] = sign * l * c[i] - 2.0 * l * f * m[i];
    }
}

/* to (a vector) += blade part of all sectors from the waves X (2, n_wave, n_coef, n_blade), real
 * and imaginary parts, in which the weights of the waves are factors:
 *
 *     x_n += sum_d Re[X_d exp(i d n phi)] = sum_d Re X_d cos(d n phi) - Im X_d sin(d n phi). */
static void add_sum_of_waves(bd_wheel *w, const double *wave, double *to) {
    const size_t N = (size_t)w->input.n_sector, D = (size_t)w->n_wave;
    const size_t nc = (size_t)w->n_coef, nb = (size_t)w->input.n_blade, m = nc * nb;
    const bd_kernel *kernel = w->ring.kernel;
    memset(w->motion, 0, sizeof(double) * N * m);
    kernel->product(N, m, D, w->cosine, wave, m, w->motion, m);
    kernel->product(N, m, D, w->sine, wave + D * m, m, w->motion, m);
    for (size_t i = 0; i < N * nc; ++i) {
        double *blade = to + i * (size_t)w->sector_size;
        for (size_t j = 0; j < nb; ++j) blade[j] += w->motion[i * nb + j];
    }
}

/* The nodal diameters d and N - d are conjugate, and only d <= N/2 is stored. Its weight in a mean
 * over all N waves is 2/N, and 1/N for the waves 0 and N/2, which are their own conjugates. */
static double weight_of_wave(int d, int n_sector) {
    const int is_real = d == 0 || 2 * d == n_sector;
    return (is_real ? 1.0 : 2.0) / n_sector;
}

/* Linear forces of the waves of nodal diameter d: for each active coefficient x of harmonic l,
 * whose other coefficient is x',
 *
 *     lin = K x - (l omega)^2 M x + sign l omega C x',   rate = d lin/domega (unless NULL),
 *
 * with sign 1 for a cosine, -1 for a sine, reversed for the transposed matrix. Arrays are (2,
 * n_wave, n_coef, n_blade), real and imaginary parts. */
static void products_of_diameter(const bd_wheel *w, const bd_waves *waves, int d, double omega,
                                 int transposed, const double *x, double *lin, double *rate,
                                 double *work) {
    const int nb = w->input.n_blade, nc = w->n_coef;
    const size_t imaginary = (size_t)(w->n_wave * nc * nb);
    for (int c = 0; c < nc; ++c) {
        if (!w->input.active[c]) continue;
        const size_t own = (size_t)((d * nc + c) * nb);
        const size_t other = (size_t)((d * nc + c + phase(c)) * nb);
        const complex_input x_own = {x + own, x + imaginary + own};
        const complex_input x_other = {x + other, x + imaginary + other};
        const complex_array to = {lin + own, lin + imaginary + own};
        complex_array to_rate = {NULL, NULL};
        if (rate) to_rate = (complex_array){rate + own, rate + imaginary + own};
        const wave_terms wave = {
            .diameter = d,
            .harmonic = (c + 1) / 2,
            .omega = omega,
            .sign = transposed ? -phase(c) : phase(c),
        };
        wave_product(w, waves, wave, x_own, x_other, to, to_rate, work);
    }
}

/* out (a vector) += circulant part times the blade coordinates (n_sector, n_coef, n_blade), and
 * by += its derivative with respect to omega, unless NULL; optionally with the transposed matrix. A
 * circulant matrix is diagonal in the waves over the sectors: X_d = sum_n x_n exp(-i d n phi) with
 * phi = 2 pi/N. After products with the matrices of each wave, x_n = 1/N sum_d Re[X_d exp(i d n
 * phi)]. */
void bd_wheel_add_waves(bd_wheel *w, const bd_waves *waves, double omega, int transposed,
                        const double *blade, double *out, double *by) {
    const int N = w->input.n_sector, D = w->n_wave, m = w->n_coef * w->input.n_blade;
    const size_t part_size = (size_t)(D * m); /* real or imaginary part of all waves */
    /* real and imaginary parts of the waves, their products and rates: (2, n_wave, m) each */
    double *in = w->wave_work;
    double *lin = in + 2 * part_size, *rate = lin + 2 * part_size, *work = rate + 2 * part_size;

    /* Fourier transform over the sectors; the sine is stored negative */
    multiply(w, D, m, N, w->cosine, N, blade, m, 0, in, m);
    multiply(w, D, m, N, w->sine, N, blade, m, 0, in + part_size, m);

    /* lin and rate; coefficients that are not active stay zero */
    memset(lin, 0, sizeof(double) * (2 + 2) * part_size);
    for (int d = 0; d < D; ++d) {
        products_of_diameter(w, waves, d, omega, transposed, in, lin, by ? rate : NULL, work);
        const double weight = weight_of_wave(d, N);
        const size_t first = (size_t)(d * m), end = first + (size_t)m;
        for (size_t i = first; i < end; ++i) {
            lin[i] *= weight;
            lin[part_size + i] *= weight;
            rate[i] *= weight;
            rate[part_size + i] *= weight;
        }
    }
    add_sum_of_waves(w, lin, out);
    if (by) add_sum_of_waves(w, rate, by);
}

/* ---- linear parts ---- */

/* Rows of coefficient c of sector n (harmonic l, f = l omega) in the product of linear part and x:
 *
 *     blade     out -= f^2 (M x), with inertia = M x; out already contains the stiffness
 *     damper    out = (k - f^2 m) y + sign f c y',   y' the other coefficient of the harmonic.
 *
 * sign is 1 for a cosine, -1 for a sine, reversed for the transposed matrix. The derivative with
 * respect to omega is added to `by`, unless NULL. */
static void sector_part(const bd_wheel *w, double omega, int transposed, int n, int c,
                        const double *x, double *out, double *by) {
    const bd_wheel_input *in = &w->input;
    const int n_blade = in->n_blade, n_damper = in->n_damper, sector_size = w->sector_size;
    const int l = (c + 1) / 2;
    const double f = l * omega, sign = transposed ? -phase(c) : phase(c);
    const size_t row = (size_t)(n * w->n_coef + c), first = row * (size_t)sector_size;
    const double *inertia = w->inertia + row * (size_t)n_blade;
    double *blade = out + first;
    for (int i = 0; i < n_blade; ++i) blade[i] -= f * f * inertia[i];

    /* damper: this coefficient y, and the other one of its harmonic */
    const double *mass = in->damper_mass + n * n_damper;
    const double *y = x + first + n_blade, *y_other = y + phase(c) * sector_size;
    double *damper = blade + n_blade;
    for (int i = 0; i < n_damper; ++i) {
        const double damping = sign * in->damper_damping[i];
        const double dynamic = in->damper_stiffness[i] - f * f * mass[i];
        damper[i] = dynamic * y[i] + (l ? f * damping * y_other[i] : 0.0);
    }
    if (!by) return;

    /* derivatives with respect to omega */
    double *blade_rate = by + first, *damper_rate = blade_rate + n_blade;
    for (int i = 0; i < n_blade; ++i) blade_rate[i] -= 2.0 * l * f * inertia[i];
    if (l == 0) return;
    for (int i = 0; i < n_damper; ++i) {
        const double damping = sign * in->damper_damping[i];
        damper_rate[i] = l * damping * y_other[i] - 2.0 * l * f * mass[i] * y[i];
    }
}

/* out (a vector) = linear part times x, by = its derivative with respect to omega, unless NULL;
 * optionally with the transposed matrix. The linear part has individual stiffness of each blade,
 * inertia, dampers, and the circulant disk and damping. Blade matrices are symmetric, so rows of
 * coordinates are multiplied from the right. */
static void linear_part(bd_wheel *w, double omega, int transposed, const double *x, double *out,
                        double *by) {
    const bd_wheel_input *in = &w->input;
    const int N = in->n_sector, nb = in->n_blade, nc = w->n_coef, ns = w->sector_size;
    copy_blades(w, x, w->blade_motion);
    multiply(w, N * nc, nb, nb, w->blade_motion, nb, in->mass, nb, 0, w->inertia, nb);
    memset(out, 0, sizeof(double) * (size_t)w->vector_size);
    if (by) memset(by, 0, sizeof(double) * (size_t)w->vector_size);
    for (int n = 0; n < N; ++n) {
        const double *blade = w->blade_motion + (size_t)(n * nc * nb);
        const double *stiffness = in->stiffness + (size_t)(n * nb * nb);
        double *to = out + (size_t)(n * nc * ns);
        multiply(w, nc, nb, nb, blade, nb, stiffness, nb, 0, to, ns);
        for (int c = 0; c < nc; ++c)
            if (in->active[c]) sector_part(w, omega, transposed, n, c, x, out, by);
    }
    bd_wheel_add_waves(w, &w->waves, omega, transposed, w->blade_motion, out, by);
}

/* Rows of inactive coordinates: out = x, by = 0. */
static void set_inactive_rows(const bd_wheel *w, const double *x, double *out, double *by) {
    const int n_coef = w->n_coef, sector_size = w->sector_size;
    for (int n = 0; n < w->input.n_sector; ++n) {
        const int has_damper = !w->input.pinned[n];
        for (int c = 0; c < n_coef; ++c) {
            const int is_active = w->input.active[c];
            if (is_active && has_damper) continue;
            const size_t first = (size_t)((n * n_coef + c) * sector_size);
            const int from = is_active ? w->input.n_blade : 0; /* the damper alone, or all */
            for (size_t i = first + (size_t)from; i < first + (size_t)sector_size; ++i) {
                out[i] = x[i];
                if (by) by[i] = 0.0;
            }
        }
    }
}

/* out += springs on the mean of dampers times x - origin; origin may be NULL. */
static void add_damper_springs(const bd_wheel *w, const double *springs, const double *origin,
                               const double *x, double *out) {
    const int nd = w->input.n_damper, nb = w->input.n_blade;
    for (int n = 0; n < w->input.n_sector; ++n) {
        const size_t first = (size_t)(n * w->n_coef * w->sector_size + nb);
        for (int i = 0; i < nd; ++i) {
            const double offset = origin ? origin[n * nd + i] : 0.0;
            out[first + (size_t)i] += springs[n * nd + i] * (x[first + (size_t)i] - offset);
        }
    }
}

/* ---- contact ---- */

/* Combine each sector's damper with the blade of the next sector. */
static void shift_blades(const bd_wheel *w, const double *x, double *to) {
    const size_t N = (size_t)w->input.n_sector, nb = (size_t)w->input.n_blade;
    const size_t ns = (size_t)w->sector_size, nc = (size_t)w->n_coef;
    memcpy(to, x, sizeof(double) * (size_t)w->vector_size);
    for (size_t n = 0; n < N; ++n) {
        const size_t next = (n + 1) % N;
        for (size_t c = 0; c < nc; ++c)
            memcpy(to + (n * nc + c) * ns, x + (next * nc + c) * ns, sizeof(double) * nb);
    }
}

/* Place in (n_sector, n_point, 3, n_coef) of a row (sector, coefficient) of a vector and component
 * k (points of a group, 3). */
static size_t place_of(const bd_wheel *w, const int *point, int row, int k) {
    const int nc = w->n_coef, sector = row / nc, coefficient = row % nc;
    const int place_in_group = k / BD_N_COMPONENT, component = k % BD_N_COMPONENT;
    const int p = sector * w->input.n_point + point[place_in_group];
    return (size_t)((BD_N_COMPONENT * p + component) * nc + coefficient);
}

/* Motion X (n_sector, n_point, 3, n_coef) of all points at the vector x. There are two groups of
 * points. With the rows R (3 points, sector_size) of a group, all sectors and coefficients at once,
 *
 *     motion (n_sector n_coef, 3 points) = x R^T     on the blade of the sector (group 0)
 *                                        = x' R^T    on the next blade (group 1),
 *
 * where x' has the blade of the next sector with the damper of the sector. */
static void find_motion(bd_wheel *w, const double *x, double *X) {
    const int rows = w->input.n_sector * w->n_coef, ns = w->sector_size;
    const int *point = w->ring.point;
    const double *R_transposed = w->ring.rows_transposed;
    shift_blades(w, x, w->shifted);
    for (int group = 0; group < 2; ++group) {
        const int n = w->ring.n_group[group], wide = BD_N_COMPONENT * n;
        const double *from = group == 0 ? x : w->shifted;
        multiply(w, rows, wide, ns, from, ns, R_transposed, wide, 0, w->motion, wide);
        for (int row = 0; row < rows; ++row)
            for (int k = 0; k < wide; ++k)
                X[place_of(w, point, row, k)] = w->motion[row * wide + k];
        R_transposed += wide * ns;
        point += n;
    }
}

/* out (a vector) += forces F (n_sector, n_point, 3, n_coef) at the points on the coordinates. A
 * group of points has rows R (3 points, sector_size), and its forces (n_sector n_coef, 3 points)
 * give F R. Group 0 acts on the blade of the sector, group 1 on the blade of the next sector, both
 * on the damper. */
static void add_forces(bd_wheel *w, const double *F, double *out) {
    const int N = w->input.n_sector, ns = w->sector_size, nc = w->n_coef, nb = w->input.n_blade;
    const int rows = N * nc;
    const int *point = w->ring.point;
    const double *R = w->ring.rows;
    for (int group = 0; group < 2; ++group) {
        const int n = w->ring.n_group[group], wide = BD_N_COMPONENT * n;
        const int on_own_blade = group == 0;
        for (int row = 0; row < rows; ++row)
            for (int k = 0; k < wide; ++k)
                w->motion[row * wide + k] = F[place_of(w, point, row, k)];
        double *to = on_own_blade ? out : w->shifted;
        const int add = on_own_blade;
        multiply(w, rows, ns, wide, w->motion, wide, R, ns, add, to, ns);
        R += wide * ns;
        point += n;
    }
    /* group 1 acts on the damper and on the blade of the next sector */
    for (int row = 0; row < rows; ++row) {
        const int next = (row + nc) % rows;
        const double *from = w->shifted + (size_t)(row * ns);
        double *blade = out + (size_t)(next * ns), *damper = out + (size_t)(row * ns);
        for (int i = 0; i < nb; ++i) blade[i] += from[i];
        for (int i = nb; i < ns; ++i) damper[i] += from[i];
    }
}

/* Set rows and columns of inactive coefficients to zero in the tangent (BD_N_BLOCK, n_coef, n_coef)
 * of a point. */
static void clear_inactive(const bd_wheel *w, double *tangent) {
    const size_t nc = (size_t)w->n_coef;
    for (size_t c = 0; c < nc; ++c) {
        if (w->input.active[c]) continue;
        for (size_t k = 0; k < BD_N_BLOCK; ++k) {
            double *block = tangent + k * nc * nc;
            for (size_t d = 0; d < nc; ++d) {
                block[c * nc + d] = 0.0;
                block[d * nc + c] = 0.0;
            }
        }
    }
}

/* Forces (3, n_coef) and optional tangents (BD_N_BLOCK, n_coef, n_coef) of n <= BD_LANES points
 * from `first` on, at the motion w->X. Rows and columns of inactive coefficients are zero in a
 * tangent. */
static void evaluate_points(bd_wheel *w, int first, int n, int derivative) {
    const size_t block_size = (size_t)(w->n_coef * w->n_coef);
    const size_t force_size = (size_t)(BD_N_COMPONENT * w->n_coef);
    const size_t tangent_size = BD_N_BLOCK * block_size;
    const double *X = w->X + force_size * (size_t)first;
    double *F = w->F + force_size * (size_t)first;
    double *tangent = w->tangent + tangent_size * (size_t)first;
    const bd_element *element = w->element + first;
    bd_response out[BD_LANES];
    for (size_t i = 0; i < (size_t)n; ++i) {
        out[i] = (bd_response){.F = F + force_size * i};
        if (!derivative) continue;
        double *block = tangent + tangent_size * i;
        for (size_t d = 0; d < 2; ++d) {
            out[i].dT[d] = block + (BD_DT1_DU1 + d) * block_size;
            out[i].dTv[d] = block + (BD_DT1_DV + d) * block_size;
            out[i].dTc[d] = block + (BD_DT1_DU2 + d) * block_size;
        }
        out[i].dN = block + BD_DN_DV * block_size;
    }
    bd_contact_evaluate_many(n, element, X, out, w->share + first, &w->evaluator);
    if (!derivative) return;
    for (int i = 0; i < n; ++i) {
        w->form[first + i] = (unsigned char)bd_element_form(out + i);
        bd_element_write_blocks(element + i, w->input.n_harm, out + i);
        clear_inactive(w, tangent + tangent_size * (size_t)i);
    }
}

/* Motion, forces and optional tangents of all points at w->x. The static displacement `shift` adds
 * to the mean, coefficient 0 of each component. */
static void evaluate_contact(bd_wheel *w, int derivative) {
    const int n_point = w->input.n_sector * w->input.n_point;
    const int n_component = BD_N_COMPONENT * n_point;
    find_motion(w, w->x, w->X);
    for (int i = 0; i < n_component; ++i) w->X[(size_t)(i * w->n_coef)] += w->input.shift[i];
    for (int first = 0; first < n_point; first += BD_LANES) {
        const int left = n_point - first;
        evaluate_points(w, first, left < BD_LANES ? left : BD_LANES, derivative);
    }
}

/* F = T X or T^T X with the tangents T of all points: F and X (n_sector, n_point, 3, n_coef). T has
 * for each point blocks (n_coef, n_coef), derivatives of a component of force with respect to a
 * component of motion. */
static void apply_tangents(const bd_wheel *w, int transposed, const double *X, double *F) {
    static const struct {
        int force, motion; /* components: tangential 0 and 1, normal */
    } BLOCK[BD_N_BLOCK] = {
        [BD_DT1_DU1] = {0, 0},
        [BD_DT2_DU2] = {1, 1},
        [BD_DT1_DV] = {0, BD_NORMAL},
        [BD_DT2_DV] = {1, BD_NORMAL},
        [BD_DT1_DU2] = {0, 1},
        [BD_DT2_DU1] = {1, 0},
        [BD_DN_DV] = {BD_NORMAL, BD_NORMAL},
    };
    const size_t nc = (size_t)w->n_coef, n_point = (size_t)(w->input.n_sector * w->input.n_point);
    memset(F, 0, sizeof(double) * BD_N_COMPONENT * n_point * nc);
    const double *T = w->tangent;
    for (size_t p = 0; p < n_point; ++p) {
        for (int k = 0; k < BD_N_BLOCK; ++k, T += nc * nc) {
            const size_t force = (BD_N_COMPONENT * p + (size_t)BLOCK[k].force) * nc;
            const size_t motion = (BD_N_COMPONENT * p + (size_t)BLOCK[k].motion) * nc;
            for (size_t c = 0; c < nc; ++c) {
                for (size_t d = 0; d < nc; ++d) {
                    if (transposed)
                        F[motion + d] += T[c * nc + d] * X[force + c];
                    else
                        F[force + c] += T[c * nc + d] * X[motion + d];
                }
            }
        }
    }
}

/* ---- equations ---- */

/* Return whether no number is NaN or infinite. */
static int all_finite(const double *x, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += x[i] * 0.0; /* preserves NaN and infinity */
    return sum == 0.0;
}

/* Residual at the unknowns and omega y (n + 1): linear part + contact forces + springs of dampers -
 * excitation. With `derivative`, keep the tangents of the contact points and the derivative with
 * respect to omega for the factorisation. */
static bd_status evaluate_wheel(bd_equations *e, const double *y, int derivative) {
    bd_wheel *w = (bd_wheel *)e;
    const bd_wheel_input *in = &w->input;
    const size_t n = (size_t)e->n;
    const double omega = y[n];
    if (!all_finite(y, n + 1)) return BD_NOT_FINITE;
    bd_wheel_to_vector(w, y, w->x);
    const double started = bd_seconds();
    evaluate_contact(w, derivative);
    const double evaluated = bd_seconds();
    w->cost.contact += evaluated - started;

    double *r = w->product, *r_omega = derivative ? w->C : NULL;
    linear_part(w, omega, 0, w->x, r, r_omega);
    add_forces(w, w->F, r);
    add_damper_springs(w, in->springs, in->spring_origin, w->x, r);
    set_inactive_rows(w, w->x, r, r_omega);
    bd_wheel_to_unknowns(w, r, e->r);
    if (derivative) {
        w->omega = omega;
        bd_wheel_to_unknowns(w, w->C, e->C);
    }
    for (size_t i = 0; i < n; ++i) e->r[i] -= in->force[i];
    const int is_finite = all_finite(e->r, n);
    w->cost.assembly += bd_seconds() - evaluated;
    ++w->cost.n_evaluation;
    w->cost.n_jacobian += derivative;
    return is_finite ? BD_OK : BD_NOT_FINITE;
}

/* out = J x or J^T x, at the latest point evaluated with derivatives. */
void bd_wheel_multiply(bd_wheel *w, int transposed, const double *x, double *out) {
    const int n_component = BD_N_COMPONENT * w->input.n_sector * w->input.n_point;
    double *X = w->work, *F = X + n_component * w->n_coef; /* (n_component, n_coef) */
    linear_part(w, w->omega, transposed, x, out, NULL);
    find_motion(w, x, X);
    apply_tangents(w, transposed, X, F);
    add_forces(w, F, out);
    add_damper_springs(w, w->springs, NULL, x, out);
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

static const bd_equations_type WHEEL = {
    .evaluate = evaluate_wheel,
    .factor = bd_wheel_factor,
    .solve = bd_wheel_solve,
    .solve_transposed = bd_wheel_solve_transposed,
    .product = product_wheel,
    .destroy = destroy_wheel,
};

/* One array in the common memory: its pointer, its length and its initial values (NULL: none). */
typedef struct {
    double **to;
    size_t n;
    const double *from;
} part;

/* Real and imaginary part of (n, n) wave matrices by columns, from interleaved rows. */
static void split_waves(const double *from, int waves, int n_row, double *to) {
    const size_t n = (size_t)n_row, nn = n * n;
    for (size_t d = 0; d < (size_t)waves; ++d, from += 2 * nn, to += 2 * nn) {
        for (size_t i = 0; i < n; ++i) {
            for (size_t j = 0; j < n; ++j) {
                to[j * n + i] = from[2 * (i * n + j)];
                to[nn + j * n + i] = from[2 * (i * n + j) + 1];
            }
        }
    }
}

/* Coupling B_b (n_kept, n_kept) of a sector to the sector b = `behind` sectors before it, from the
 * last coordinates of the waves A_d:
 *
 *     B_b = 1/N sum_d Re[A_d exp(i d b phi)],   phi = 2 pi/N. */
static void sum_coupling(const bd_wheel *w, int n, int n_kept, int behind, const double *waves,
                         double *coupling) {
    const int N = w->input.n_sector, first = n - n_kept;
    const size_t nn = (size_t)(n * n);
    memset(coupling, 0, sizeof(double) * (size_t)(n_kept * n_kept));
    for (int d = 0; d < w->n_wave; ++d) {
        const double weight = weight_of_wave(d, N);
        const double angle = BD_TWO_PI * d * behind / N, c = cos(angle), s = sin(angle);
        const double *re = waves + 2 * (size_t)d * nn, *im = re + nn;
        for (int i = 0; i < n_kept; ++i) {
            for (int j = 0; j < n_kept; ++j) {
                const size_t at = (size_t)((first + j) * n + first + i); /* by columns */
                coupling[i * n_kept + j] += weight * (re[at] * c - im[at] * s);
            }
        }
    }
}

/* Extract the coupling B_b from the waves: A_d -= B_b exp(-i d b phi) + B_b^T exp(i d b phi). The
 * second part is the coupling of the sector before to this one, which b = 0 does not have. */
static void extract_coupling(const bd_wheel *w, int n, int n_kept, int behind, double *waves,
                             double *coupling) {
    const int N = w->input.n_sector, first = n - n_kept;
    const size_t nn = (size_t)(n * n);
    sum_coupling(w, n, n_kept, behind, waves, coupling);
    for (int d = 0; d < w->n_wave; ++d) {
        const double angle = BD_TWO_PI * d * behind / N, c = cos(angle), s = sin(angle);
        double *re = waves + 2 * (size_t)d * nn, *im = re + nn;
        for (int i = 0; i < n_kept; ++i) {
            for (int j = 0; j < n_kept; ++j) {
                const size_t at = (size_t)((first + j) * n + first + i); /* by columns */
                const double forth = coupling[i * n_kept + j];
                const double back = behind ? coupling[j * n_kept + i] : 0.0;
                re[at] -= (forth + back) * c;
                im[at] -= (back - forth) * s;
            }
        }
    }
}

/* Split the circulant matrices (stiffness, mass, damping) into the couplings of a sector to itself
 * (sector_part, in the coordinates of a blade), to its neighbours (neighbour_part of stiffness and
 * mass, in the kept coordinates), and the remainder. The elimination contains the first two. */
static void split_couplings(bd_wheel *w) {
    const bd_wheel_input *in = &w->input;
    const size_t D = (size_t)w->n_wave, nb = (size_t)in->n_blade;
    const int n_row[3] = {in->n_root, in->n_root, in->n_blade};
    double *full[3] = {w->waves.stiffness, w->waves.mass, w->waves.damping};
    double *far[3] = {w->remainder.stiffness, w->remainder.mass, w->remainder.damping};
    for (int k = 0; k < 3; ++k) {
        const size_t n = (size_t)n_row[k], first = nb - n;
        double *own = w->wave_work; /* (n, n) coupling of a sector to itself */
        memcpy(far[k], full[k], sizeof(double) * 2 * D * n * n);
        extract_coupling(w, n_row[k], n_row[k], 0, far[k], own);
        memset(w->sector_part[k], 0, sizeof(double) * nb * nb);
        for (size_t i = 0; i < n; ++i) {
            double *row = w->sector_part[k] + (first + i) * nb + first;
            for (size_t j = 0; j < n; ++j) row[j] = own[i * n + j];
        }
        /* damping between sectors is part of the remainder */
        if (k < 2) extract_coupling(w, n_row[k], in->n_kept, 1, far[k], w->neighbour_part[k]);
    }
}

/* Allocate the common memory, cut it into parts, and fill those with initial values. */
static bd_status memory_create(bd_wheel *w, const part *parts, size_t n_part) {
    size_t total = BD_KERNEL_PAD;
    for (size_t i = 0; i < n_part; ++i) total += parts[i].n;
    w->memory = malloc(sizeof(double) * total);
    if (!w->memory) return BD_NO_MEMORY;
#ifdef BD_POISON
    for (size_t i = 0; i < total; ++i) w->memory[i] = NAN;
#endif
    double *rest = w->memory;
    for (size_t i = 0; i < n_part; ++i) {
        double *to = bd_take(&rest, parts[i].n);
        *parts[i].to = to;
        if (parts[i].from) memcpy(to, parts[i].from, sizeof(double) * parts[i].n);
    }
    return BD_OK;
}

/* Contact elements of all points of all sectors, from the arrays of the input. */
static void set_elements(bd_wheel *w, const bd_wheel_input *in) {
    const int n_point = in->n_sector * in->n_point;
    for (int p = 0; p < n_point; ++p) {
        w->element[p] = (bd_element){
            .law = (bd_law)in->law[p],
            .kt = {in->kt[2 * p], in->kt[2 * p + 1]},
            .kn = in->kn[p],
            .mu = in->mu[p],
            .n0 = in->n0[p],
            .w = {in->w[2 * p], in->w[2 * p + 1]},
            .load = in->load[p],
        };
    }
}

/* Factors of the Fourier transform over the sectors, exp(-i d n phi) with phi = 2 pi/N for nodal
 * diameter d and sector n: cosine (n_wave, N) and negative sine. */
static void set_transform(bd_wheel *w) {
    const int N = w->input.n_sector;
    for (int d = 0; d < w->n_wave; ++d) {
        for (int n = 0; n < N; ++n) {
            const double angle = BD_TWO_PI * ((d * n) % N) / N;
            w->cosine[d * N + n] = cos(angle);
            w->sine[d * N + n] = -sin(angle);
        }
    }
}

/* Arrays that follow from the input. */
static void set_arrays(bd_wheel *w, const bd_wheel_input *in) {
    set_elements(w, in);
    set_transform(w);
    split_waves(in->disk_stiffness, w->n_wave, in->n_root, w->waves.stiffness);
    split_waves(in->disk_mass, w->n_wave, in->n_root, w->waves.mass);
    split_waves(in->damping, w->n_wave, in->n_blade, w->waves.damping);
    split_couplings(w);
    for (int i = 0; i < in->n_sector * in->n_damper; ++i)
        w->springs[i] = in->springs[i] + in->jacobian_springs[i];
    memset(w->scale, 0, sizeof(double) * ((size_t)w->vector_size + 1));
}

/* Copies of the flags, in one block. */
static bd_status flags_create(bd_wheel *w, const bd_wheel_input *in) {
    const size_t n_point = (size_t)in->n_point, n_coef = (size_t)w->n_coef;
    const size_t n_sector = (size_t)in->n_sector;
    unsigned char *on_next = malloc(n_point + n_coef + n_sector);
    w->input.on_next = on_next;
    if (!on_next) return BD_NO_MEMORY;
    unsigned char *active = on_next + n_point, *pinned = active + n_coef;
    w->input.active = active;
    w->input.pinned = pinned;
    memcpy(on_next, in->on_next, n_point);
    memcpy(active, in->active, n_coef);
    memcpy(pinned, in->pinned, n_sector);
    return BD_OK;
}

static size_t larger(size_t a, size_t b) { return a > b ? a : b; }

/* Lengths of arrays, in numbers. */
typedef struct {
    size_t n_wave, n_coef, n_unknown;
    size_t n_point, n_damper;         /* points and damper coordinates of all sectors */
    size_t sector, vector, blades;    /* coordinates of a sector; a vector; its blade part */
    size_t blade_matrix, kept_matrix; /* matrices of one sector */
    size_t blade_waves, root_waves;   /* matrices of all waves, real and imaginary part */
    size_t forces, tangents;          /* forces and tangents of all points */
    size_t wave_work, elimination, krylov;
} lengths;

/* Lengths of all arrays, in numbers, from the sizes of the input. Some arrays serve several purposes,
 * one after the other, and have the length of the largest. */
static lengths find_lengths(const bd_wheel_input *in, size_t n_unknown) {
    const size_t n_sector = (size_t)in->n_sector, n_blade = (size_t)in->n_blade;
    const size_t n_root = (size_t)in->n_root, n_kept = (size_t)in->n_kept;
    const size_t n_group = (size_t)in->n_harm + 1, n_krylov = BD_WHEEL_KRYLOV;
    lengths n = {
        .n_wave = n_sector / 2 + 1,
        .n_coef = (size_t)bd_n_coef(in->n_harm),
        .n_unknown = n_unknown,
        .n_point = n_sector * (size_t)in->n_point,
        .n_damper = n_sector * (size_t)in->n_damper,
        .sector = n_blade + (size_t)in->n_damper,
        .blade_matrix = n_blade * n_blade,
        .kept_matrix = n_kept * n_kept,
    };
    n.vector = n_sector * n.n_coef * n.sector;
    n.blades = n_sector * n.n_coef * n_blade;
    n.blade_waves = 2 * n.n_wave * n.blade_matrix;
    n.root_waves = 2 * n.n_wave * n_root * n_root;
    n.forces = 3 * n.n_point * n.n_coef;
    n.tangents = BD_N_BLOCK * n.n_point * n.n_coef * n.n_coef;

    /* bd_wheel_add_waves has waves, products and rates there, followed by K x, M x and C x' of one
     * blade for wave_product; all are complex */
    const size_t complex_blade = 2 * n_blade;
    const size_t complex_waves = n.n_wave * n.n_coef * complex_blade;
    const size_t add_waves = 3 * complex_waves, of_product = 3 * complex_blade;
    /* at another time split_couplings has one matrix there */
    n.wave_work = larger(n.blade_matrix, add_waves + of_product);

    /* common, damping, damper and neighbour matrices of each harmonic, in fill_matrices */
    n.elimination = n_group * (2 * n.blade_matrix + 2 * n.n_damper + n.kept_matrix);

    /* arrays of solve_once, in its notation; each Z_k is a solution of the equations with the
     * border, a vector and one number */
    const size_t bordered = n.vector + 1;
    n.krylov = (n_krylov + 1) * n.blades;    /* V */
    n.krylov += (n_krylov + 1) * n_krylov;   /* H */
    n.krylov += 2 * n_krylov + n_krylov + 1; /* cosines and sines, g */
    n.krylov += n_krylov * bordered;         /* Z */
    return n;
}

/* Elements, shares and forms of the contact points, one more than there are: an allocation of 0
 * bytes may return NULL. */
static bd_status points_create(bd_wheel *w, size_t n_point) {
    w->element = malloc(sizeof(bd_element) * (n_point + 1));
    w->share = malloc(sizeof(bd_status_share) * (n_point + 1));
    w->form = malloc(n_point + 1);
    return w->element && w->share && w->form ? BD_OK : BD_NO_MEMORY;
}

/* All arrays of numbers in one block of memory. The arrays of the input are copied, and
 * w->input points to the copies. */
static bd_status arrays_create(bd_wheel *w, const bd_wheel_input *in, const lengths *n) {
    const size_t n_sector = (size_t)in->n_sector, n_damper = (size_t)in->n_damper;
    const size_t bordered = n->vector + 1; /* a vector and the number of the border */
    bd_wheel_input *copies = &w->input;
    const part parts[] = {
        /* input */
        {(double **)&copies->motion_rows, 3 * (size_t)in->n_point * n->sector, in->motion_rows},
        {(double **)&copies->stiffness, n_sector * n->blade_matrix, in->stiffness},
        {(double **)&copies->mass, n->blade_matrix, in->mass},
        {(double **)&copies->damper_stiffness, n_damper, in->damper_stiffness},
        {(double **)&copies->damper_mass, n->n_damper, in->damper_mass},
        {(double **)&copies->damper_damping, n_damper, in->damper_damping},
        {(double **)&copies->springs, n->n_damper, in->springs},
        {(double **)&copies->spring_origin, n->n_damper, in->spring_origin},
        {(double **)&copies->shift, 3 * n->n_point, in->shift},
        {(double **)&copies->force, n->n_unknown, in->force},
        /* equations */
        {&w->base.row_scale, n->n_unknown, in->row_scale},
        {&w->base.r, n->n_unknown, NULL},
        {&w->base.C, n->n_unknown, NULL},
        {&w->base.scratch, 4 * (n->n_unknown + 1), NULL},
        /* circulant matrices, and their parts */
        {&w->waves.stiffness, n->root_waves, NULL},
        {&w->waves.mass, n->root_waves, NULL},
        {&w->waves.damping, n->blade_waves, NULL},
        {&w->remainder.stiffness, n->root_waves, NULL},
        {&w->remainder.mass, n->root_waves, NULL},
        {&w->remainder.damping, n->blade_waves, NULL},
        {&w->sector_part[0], n->blade_matrix, NULL},
        {&w->sector_part[1], n->blade_matrix, NULL},
        {&w->sector_part[2], n->blade_matrix, NULL},
        {&w->neighbour_part[0], n->kept_matrix, NULL},
        {&w->neighbour_part[1], n->kept_matrix, NULL},
        {&w->cosine, n->n_wave * n_sector, NULL},
        {&w->sine, n->n_wave * n_sector, NULL},
        /* contact */
        {&w->X, n->forces, NULL},
        {&w->F, n->forces, NULL},
        {&w->tangent, n->tangents, NULL},
        /* evaluation */
        {&w->x, n->vector, NULL},
        {&w->shifted, n->vector, NULL},
        {&w->motion, larger(n->forces, n->blades), NULL},
        {&w->blade_motion, n->blades, NULL},
        {&w->inertia, n->blades, NULL},
        {&w->wave_work, n->wave_work, NULL},
        /* solution with the border */
        {&w->matrices, n->elimination, NULL},
        {&w->springs, n->n_damper, NULL},
        {&w->C, bordered, NULL},
        {&w->border, bordered, NULL},
        {&w->scale, bordered, NULL},
        {&w->column, bordered, NULL},
        {&w->b, 3 * bordered, NULL},
        {&w->product, bordered, NULL},
        {&w->work, larger(bordered, 2 * n->forces), NULL},
        {&w->krylov, n->krylov, NULL},
    };
    return memory_create(w, parts, sizeof parts / sizeof *parts);
}

/* Sizes, memory and initial values. */
static bd_status parts_create(bd_wheel *w, const bd_wheel_input *in) {
    const lengths n = find_lengths(in, (size_t)w->base.n);
    w->input = *in;
    w->n_coef = (int)n.n_coef;
    w->n_wave = (int)n.n_wave;
    w->sector_size = (int)n.sector;
    w->vector_size = (int)n.vector;
    bd_status status = flags_create(w, in);
    if (status == BD_OK) status = points_create(w, n.n_point);
    if (status == BD_OK) status = arrays_create(w, in, &n);
    if (status == BD_OK) set_arrays(w, in);
    return status;
}

bd_status bd_wheel_create(bd_wheel **out, const bd_wheel_input *in) {
    *out = NULL;
    bd_wheel *w = calloc(1, sizeof *w);
    if (!w) return BD_NO_MEMORY;
    int n_active = 0;
    for (int c = 0; c < bd_n_coef(in->n_harm); ++c) n_active += in->active[c] != 0;
    w->base = (bd_equations){
        .type = &WHEEL,
        .n = n_active * in->n_sector * (in->n_blade + in->n_damper),
        .k = 1,
        .derives_trials = 1,
        .cost = &w->cost,
    };
    bd_status status = parts_create(w, in);
    if (status == BD_OK) {
        const bd_ring_input ring = {
            .n_sector = in->n_sector,
            .n_coef = w->n_coef,
            .n_blade = in->n_blade,
            .n_damper = in->n_damper,
            .n_kept = in->n_kept,
            .n_point = in->n_point,
            .on_next = w->input.on_next,
            .rows = w->input.motion_rows,
            .active = w->input.active,
            .pinned = w->input.pinned,
        };
        status = bd_ring_create(&w->ring, &ring);
    }
    if (status == BD_OK)
        status = bd_evaluator_create(&w->evaluator, in->evaluation, in->n_harm, in->n_time);
    if (status != BD_OK) {
        destroy_wheel(&w->base);
        return status;
    }
    *out = w;
    return BD_OK;
}
