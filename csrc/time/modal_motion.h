/* Motion of all sectors in time: products between modes and points, between nodal diameters and
 * sectors, and of the contact patterns. generalised_alpha.c includes this file, once for each
 * instruction set.
 *
 *     x_k = shift + sum_d Re[G_d q_d exp(i k d phi)],   phi = 2 pi/N,
 *     g_d = (c_d/N) G_d^H sum_k F_k exp(-i k d phi). */
#ifndef BD_TIME_MODAL_MOTION_H
#define BD_TIME_MODAL_MOTION_H

#include "time/integration.h"
#include "util/vector_types.h"

/* Vectors in a block of 8 numbers, and number of independent sums. With too few of them, the
 * processor waits for each addition before the next. */
enum { PART = 8 / BD_WIDTH, SUMS = BD_WIDTH == 8 ? 2 : PART };

/* Number of modes of a family, padded to a multiple of 8. */
BD_INLINE size_t padded_modes(const bd_time *t, int f) {
    return ((size_t)t->n_mode[f] + 7) / 8 * 8;
}

/* ---- complex products ---- */

/* Sums of the four products of a complex matrix and a complex vector: the first letter is the real
 * (r) or imaginary (i) part of the matrix, the second one that of the vector. */
typedef struct {
    bd_vec rr[SUMS], ri[SUMS], ir[SUMS], ii[SUMS];
} complex_sums;

BD_INLINE void clear_sums(complex_sums *sums, const int n) {
    for (int v = 0; v < n; ++v) sums->rr[v] = sums->ri[v] = sums->ir[v] = sums->ii[v] = bd_all(0.0);
}

/* Add the products of one vector of the matrix with re + i im to sum v. */
BD_INLINE void add_products(complex_sums *sums, size_t v, bd_vec matrix_re, bd_vec matrix_im,
                            bd_vec re, bd_vec im) {
    sums->rr[v] += matrix_re * re;
    sums->ii[v] += matrix_im * im;
    sums->ri[v] += matrix_re * im;
    sums->ir[v] += matrix_im * re;
}

/* y = A x with A (rows, columns), rows a multiple of 8; real and imaginary parts of x and y are
 * separate. A is stored in blocks of 8 rows (stored_columns, 2, 8), of which the first `columns`
 * are used. */
BD_INLINE void multiply_complex(size_t rows, size_t columns, size_t stored_columns, const double *A,
                                const double *x_re, const double *x_im, double *y_re,
                                double *y_im) {
    for (size_t row = 0; row < rows; row += 8, A += 16 * stored_columns) {
        complex_sums sums;
        clear_sums(&sums, PART);
        for (size_t j = 0; j < columns; ++j) {
            const double *column = A + 16 * j;
            const bd_vec re = bd_all(x_re[j]), im = bd_all(x_im[j]);
            for (size_t v = 0; v < PART; ++v) {
                const bd_vec A_re = bd_load(column + v * BD_WIDTH);
                const bd_vec A_im = bd_load(column + 8 + v * BD_WIDTH);
                add_products(&sums, v, A_re, A_im, re, im);
            }
        }
        for (size_t v = 0; v < PART; ++v) {
            bd_store(y_re + row + v * BD_WIDTH, sums.rr[v] - sums.ii[v]);
            bd_store(y_im + row + v * BD_WIDTH, sums.ri[v] + sums.ir[v]);
        }
    }
}

/* Complex motion amplitudes y (2, rows) = G q of one family, from the coordinates q_next. G is
 * stored in blocks of 8 rows (multiply_complex). */
BD_INLINE void family_motion(const bd_time *t, int f, const double *G, double *y) {
    const size_t n_mode = (size_t)t->n_mode[f], n_stored = padded_modes(t, f);
    const double *q_re = t->q_next + t->first_coordinate[f], *q_im = q_re + n_stored;
    multiply_complex(t->rows, n_mode, n_stored, G, q_re, q_im, y, y + t->rows);
}

/* Modal force G^H z of one family, times the number of sectors, from the amplitudes z (2, rows) of
 * the contact forces. G is stored in blocks of 8 modes, each block (rows, 2, 8) with the real and
 * imaginary parts of a row's modes. The points of direction d have the rows d stride ... d stride +
 * n_point - 1.
 *
 * A sum must not wait for its previous addition. Therefore SUMS sums are independent: SUMS/PART
 * successive rows, each with PART vectors for the 8 modes. They are joined at the end. */
BD_INLINE void family_force(const bd_time *t, int f, const double *G, const double *z) {
    const size_t n_mode = (size_t)t->n_mode[f], n_point = (size_t)t->n_point, rows = t->rows;
    const double *z_re = z, *z_im = z + rows;
    double *force_re = t->contact_force + t->first_coordinate[f];
    double *force_im = force_re + padded_modes(t, f);
    for (size_t j = 0; j < n_mode; j += 8, G += 16 * rows) {
        complex_sums sums;
        clear_sums(&sums, SUMS);
        for (size_t d = 0; d < 3; ++d) {
            const size_t start = d * t->stride;
            /* SUMS/PART rows at once; the padding after the last point has zero force */
            for (size_t row = start; row < start + n_point; row += SUMS / PART) {
                for (size_t v = 0; v < SUMS; ++v) {
                    const size_t point_row = row + v / PART;
                    const size_t first_of_modes = v % PART * BD_WIDTH;
                    const double *G_re = G + 16 * point_row + first_of_modes, *G_im = G_re + 8;
                    const bd_vec re = bd_all(z_re[point_row]), im = bd_all(z_im[point_row]);
                    add_products(&sums, v, bd_load(G_re), bd_load(G_im), re, im);
                }
            }
        }
        for (int v = PART; v < SUMS; ++v) {
            sums.rr[v - PART] += sums.rr[v];
            sums.ri[v - PART] += sums.ri[v];
            sums.ir[v - PART] += sums.ir[v];
            sums.ii[v - PART] += sums.ii[v];
        }
        /* G^H has conjugate modes: (G_re - i G_im)(z_re + i z_im) */
        for (size_t v = 0; v < PART; ++v) {
            const size_t mode = j + v * BD_WIDTH;
            bd_store(force_re + mode, sums.rr[v] + sums.ii[v]);
            bd_store(force_im + mode, sums.ri[v] - sums.ir[v]);
        }
    }
}

/* ---- between sectors and nodal diameters, for vectors of n entries, a multiple of 8 ---- */

/* Sectors k and N - k are computed together, for k = 0 ... N/2. With phi = 2 pi/N, exp(i (N - k) d
 * phi) = exp(-i k d phi): the phases of both sectors are conjugate, cos(k d phi) is equal and
 * sin(k d phi) opposite. Sectors 0 and N/2 are their own partners; their sin(k d phi) is 0 except
 * for rounding. The real and imaginary parts of an amplitude are two rows (2, n), of which a
 * processor vector holds BD_WIDTH entries. */

/* Motion of the sectors from the amplitudes y (n_family, 2, n) of all families, one for each nodal
 * diameter d,
 *
 *     out_k       = sum_d Re y_d cos(k d phi) - sum_d Im y_d sin(k d phi),     out (n_sector, n),
 *     out_(N - k) = sum_d Re y_d cos(k d phi) + sum_d Im y_d sin(k d phi). */
BD_INLINE void to_sectors(const bd_time *t, size_t n, const double *y, double *out) {
    const size_t n_sector = (size_t)t->n_sector;
    for (size_t k = 0; 2 * k <= n_sector; ++k) {
        const size_t other = (n_sector - k) % n_sector;
        const double *phase = t->phase + 2 * k * (size_t)t->n_family; /* (n_family, 2) */
        double *out_k = out + k * n, *out_other = out + other * n;
        for (size_t i = 0; i < n; i += 8) {
            bd_vec of_cosine[PART], of_sine[PART];
            for (int v = 0; v < PART; ++v) of_cosine[v] = of_sine[v] = bd_all(0.0);
            const double *re = y + i;
            for (int f = 0; f < t->n_family; ++f, re += 2 * n) {
                const double *im = re + n;
                const bd_vec cosine = bd_all(phase[2 * f]), sine = bd_all(phase[2 * f + 1]);
                for (int v = 0; v < PART; ++v) {
                    of_cosine[v] += cosine * bd_load(re + v * BD_WIDTH);
                    of_sine[v] += sine * bd_load(im + v * BD_WIDTH);
                }
            }
            for (size_t v = 0; v < PART; ++v) {
                const size_t at = i + v * BD_WIDTH;
                bd_store(out_k + at, of_cosine[v] - of_sine[v]);
                if (other != k) bd_store(out_other + at, of_cosine[v] + of_sine[v]);
            }
        }
    }
}

/* Amplitudes z (n_family, 2, n) of all families, one for each nodal diameter d, from the values x
 * (n_sector, n) of the sectors: z_d = sum_k x_k exp(-i k d phi). A pair of sectors adds
 *
 *     Re z_d += (x_k + x_(N - k)) cos(k d phi),    Im z_d -= (x_k - x_(N - k)) sin(k d phi).
 *
 * A sector that is its own partner counts once. It adds x_k cos(k d phi) to the real part, and to
 * the imaginary part a multiple of sin(k d phi), which is 0 except for rounding. */
BD_INLINE void to_diameters(const bd_time *t, size_t n, const double *x, double *z) {
    const size_t n_sector = (size_t)t->n_sector;
    const bd_vec none = bd_all(0.0);
    for (size_t k = 0; 2 * k <= n_sector; ++k) {
        const size_t other = (n_sector - k) % n_sector;
        const double *phase = t->phase + 2 * k * (size_t)t->n_family; /* (n_family, 2) */
        const int has_partner = other != k;
        for (size_t i = 0; i < n; i += BD_WIDTH) {
            const bd_vec x_k = bd_load(x + k * n + i);
            bd_vec sum = x_k;
            bd_vec difference = x_k; /* without a partner its factor sin(k d phi) is 0 */
            if (has_partner) {
                const bd_vec x_other = bd_load(x + other * n + i);
                difference = x_k - x_other;
                sum = x_k + x_other;
            }
            for (int f = 0; f < t->n_family; ++f) {
                double *re = z + 2 * (size_t)f * n + i, *im = re + n;
                const bd_vec cosine = bd_all(phase[2 * f]), sine = bd_all(phase[2 * f + 1]);
                /* the first sector initialises the sums */
                const bd_vec re_before = k ? bd_load(re) : none;
                const bd_vec im_before = k ? bd_load(im) : none;
                bd_store(re, re_before + cosine * sum);
                bd_store(im, im_before - sine * difference);
            }
        }
    }
}

/* ---- real products ---- */

/* C (m, n) = A (m, k) B (k, n), n a multiple of 8, in tiles of 4 rows and 8 columns. */
BD_INLINE void multiply(size_t m, size_t n, size_t k, const double *A, const double *B, double *C) {
    enum { TILE = 4 };
    for (size_t i = 0; i < m; i += TILE) {
        const size_t height = m - i < TILE ? m - i : TILE;
        const double *A_tile = A + i * k;
        for (size_t j = 0; j < n; j += 8) {
            bd_vec sum[TILE][PART];
            for (int a = 0; a < TILE; ++a)
                for (int v = 0; v < PART; ++v) sum[a][v] = bd_all(0.0);
            if (height == TILE) {
                /* each vector of B serves all rows of the tile */
                for (size_t l = 0; l < k; ++l) {
                    for (size_t v = 0; v < PART; ++v) {
                        const bd_vec b = bd_load(B + l * n + j + v * BD_WIDTH);
                        for (size_t a = 0; a < TILE; ++a)
                            sum[a][v] += bd_all(A_tile[a * k + l]) * b;
                    }
                }
            } else {
                /* row by row: a loop over a variable number of rows would not stay in registers */
                for (size_t a = 0; a < height; ++a) {
                    for (size_t l = 0; l < k; ++l) {
                        for (size_t v = 0; v < PART; ++v) {
                            const bd_vec b = bd_load(B + l * n + j + v * BD_WIDTH);
                            sum[a][v] += bd_all(A_tile[a * k + l]) * b;
                        }
                    }
                }
            }
            for (size_t a = 0; a < height; ++a)
                for (size_t v = 0; v < PART; ++v)
                    bd_store(C + (i + a) * n + j + v * BD_WIDTH, sum[a][v]);
        }
    }
}

/* y (n) = A x, n a multiple of 8, with A (n, n) in blocks of 8 rows: (n/8, n, 8), each block stored
 * column by column. */
BD_INLINE void multiply_blocks(size_t n, const double *A, const double *x, double *y) {
    for (size_t i = 0; i < n; i += 8) {
        /* even and odd columns have independent sums */
        bd_vec even[PART], odd[PART];
        for (int v = 0; v < PART; ++v) even[v] = odd[v] = bd_all(0.0);
        for (size_t j = 0; j < n; j += 2, A += 16) {
            const double *even_column = A, *odd_column = A + 8;
            for (int v = 0; v < PART; ++v) {
                even[v] += bd_load(even_column + v * BD_WIDTH) * bd_all(x[j]);
                odd[v] += bd_load(odd_column + v * BD_WIDTH) * bd_all(x[j + 1]);
            }
        }
        for (int v = 0; v < PART; ++v) bd_store(y + i + v * BD_WIDTH, even[v] + odd[v]);
    }
}

/* Pattern motion u (n_sector, rank) = C p due to pattern forces p (n_sector, rank). The compliance
 * C couples the sectors, but not the nodal diameters. Hence p is split into nodal diameters, each
 * is multiplied by its complex compliance (rank, rank), and the motions are superposed. */
static void compliance_times(bd_time *t, const bd_time_patterns *patterns, const double *p,
                             double *u) {
    const size_t rank = (size_t)patterns->rank;
    to_diameters(t, rank, p, t->force_amplitude);
    for (size_t f = 0; f < (size_t)t->n_family; ++f) {
        const double *C = patterns->compliance + 2 * rank * rank * f;
        const double *force = t->force_amplitude + 2 * rank * f;
        double *motion = t->motion_amplitude + 2 * rank * f;
        multiply_complex(rank, rank, rank, C, force, force + rank, motion, motion + rank);
    }
    to_sectors(t, rank, t->motion_amplitude, u);
}

/* Sum of the entries of a vector: add the second half to the first half until a single entry
 * remains. */
BD_INLINE double total(bd_vec x) {
    double part[BD_WIDTH];
    bd_store(part, x);
    for (size_t half = BD_WIDTH / 2; half; half /= 2)
        for (size_t i = 0; i < half; ++i) part[i] += part[i + half];
    return part[0];
}

/* a . b, n a multiple of 8. */
BD_INLINE double dot(size_t n, const double *a, const double *b) {
    /* independent sums over alternate vectors */
    bd_vec even = bd_all(0.0), odd = even;
    size_t i = 0;
    for (; i + 2 * BD_WIDTH <= n; i += 2 * BD_WIDTH) {
        even += bd_load(a + i) * bd_load(b + i);
        odd += bd_load(a + i + BD_WIDTH) * bd_load(b + i + BD_WIDTH);
    }
    for (; i < n; i += BD_WIDTH) even += bd_load(a + i) * bd_load(b + i);
    return total(even + odd);
}

/* y += c x */
BD_INLINE void add(size_t n, double c, const double *x, double *y) {
    for (size_t i = 0; i < n; i += BD_WIDTH)
        bd_store(y + i, bd_load(y + i) + bd_all(c) * bd_load(x + i));
}

BD_INLINE double larger(double a, double b) { return a > b ? a : b; }

/* ---- motion and forces of all families ---- */

/* Motion x (n_sector, rows) of all points from the coordinates q_next: x_k = shift + sum_d Re[G_d
 * q_d exp(i k d phi)]. The shift (3, stride) is the same in all sectors. */
static void find_motion(bd_time *t, double *x) {
    const size_t size = 2 * t->rows; /* complex amplitudes of one family */
    const double *G = t->motion_modes;
    for (int f = 0; f < t->n_family; ++f) {
        family_motion(t, f, G, t->motion_amplitude + (size_t)f * size);
        G += size * padded_modes(t, f);
    }
    to_sectors(t, t->rows, t->motion_amplitude, x);
    const double *shift = t->parameters + BD_TIME_SHIFT * t->stride;
    for (size_t k = 0; k < (size_t)t->n_sector; ++k)
        add(3 * t->stride, 1.0, shift, x + k * t->rows);
}

/* Modal forces G_d^H sum_k F_k exp(-i k d phi) of all families, without their factor c_d/N
 * (fourier_weight), from the contact forces F (n_sector, rows). */
static void find_modal_forces(bd_time *t) {
    const size_t size = 2 * t->rows; /* complex amplitudes of one family */
    const double *G = t->force_modes;
    to_diameters(t, t->rows, t->point_force, t->force_amplitude);
    for (int f = 0; f < t->n_family; ++f) {
        family_force(t, f, G, t->force_amplitude + (size_t)f * size);
        G += size * padded_modes(t, f);
    }
}

#endif
