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

/* Vectors in a block of 8, and number of independent sums for instruction-level parallelism. */
enum { PART = 8 / BD_WIDTH, SUMS = BD_WIDTH == 8 ? 2 : PART };

/* y (2, rows) = G q of one family. */
BD_INLINE void family_motion(const bd_time *t, int f, const double *G, double *y) {
    const size_t m = (size_t)t->n_mode[f], wide = (m + 7) / 8 * 8, rows = t->rows;
    const double *re = t->q_next + t->first_coordinate[f], *im = re + wide;
    for (size_t row = 0; row < rows; row += 8, G += 16 * wide) {
        bd_vec rr[PART], ri[PART], ir[PART], ii[PART];
        for (int v = 0; v < PART; ++v) rr[v] = ri[v] = ir[v] = ii[v] = bd_all(0.0);
        for (size_t j = 0; j < m; ++j) {
            const bd_vec a = bd_all(re[j]), b = bd_all(im[j]);
            for (int v = 0; v < PART; ++v) {
                const bd_vec gr = bd_load(G + 16 * j + v * BD_WIDTH);
                const bd_vec gi = bd_load(G + 16 * j + 8 + v * BD_WIDTH);
                rr[v] += gr * a;
                ii[v] += gi * b;
                ri[v] += gr * b;
                ir[v] += gi * a;
            }
        }
        for (int v = 0; v < PART; ++v) {
            bd_store(y + row + v * BD_WIDTH, rr[v] - ii[v]);
            bd_store(y + rows + row + v * BD_WIDTH, ri[v] + ir[v]);
        }
    }
}

/* Modal force of one family, times N, from the amplitudes z (2, rows) of the forces. */
BD_INLINE void family_force(const bd_time *t, int f, const double *G, const double *z) {
    const size_t m = (size_t)t->n_mode[f], wide = (m + 7) / 8 * 8, rows = t->rows;
    const size_t first = (size_t)t->first_coordinate[f], n_point = (size_t)t->n_point;
    for (size_t j = 0; j < m; j += 8, G += 16 * rows) {
        bd_vec rr[SUMS], ri[SUMS], ir[SUMS], ii[SUMS];
        for (int v = 0; v < SUMS; ++v) rr[v] = ri[v] = ir[v] = ii[v] = bd_all(0.0);
        for (size_t d = 0; d < 3; ++d) {
            const size_t start = d * t->stride;
            for (size_t row = start; row < start + n_point; row += SUMS / PART) {
                /* the padding after the last point has zero force */
                for (size_t v = 0; v < SUMS; ++v) {
                    const size_t point_row = row + v / PART;
                    const double *g = G + 16 * point_row + v % PART * BD_WIDTH;
                    const bd_vec a = bd_all(z[point_row]), b = bd_all(z[rows + point_row]);
                    const bd_vec gr = bd_load(g), gi = bd_load(g + 8);
                    rr[v] += gr * a;
                    ii[v] += gi * b;
                    ri[v] += gr * b;
                    ir[v] += gi * a;
                }
            }
        }
        for (int v = PART; v < SUMS; ++v) {
            rr[v - PART] += rr[v];
            ri[v - PART] += ri[v];
            ir[v - PART] += ir[v];
            ii[v - PART] += ii[v];
        }
        for (int v = 0; v < PART; ++v) {
            double *force = t->contact_force + first + j + (size_t)(v * BD_WIDTH);
            bd_store(force, rr[v] + ii[v]);
            bd_store(force + wide, ri[v] - ir[v]);
        }
    }
}

/* ---- between sectors and nodal diameters, for vectors of n entries, a multiple of 8 ---- */

/* out (n_sector, n) = sum over families of Re[y exp(i k d phi)], y (n_family, 2, n). Sectors k and
 * N - k are computed together: their cosines are equal and their sines opposite. */
BD_INLINE void to_sectors(const bd_time *t, size_t n, const double *y, double *out) {
    const size_t sectors = (size_t)t->n_sector;
    for (size_t k = 0; 2 * k <= sectors; ++k) {
        const size_t other = (sectors - k) % sectors;
        const double *phase = t->phase + 2 * k * (size_t)t->n_family;
        for (size_t i = 0; i < n; i += 8) {
            bd_vec even[PART], odd[PART];
            for (int v = 0; v < PART; ++v) even[v] = odd[v] = bd_all(0.0);
            const double *re = y + i;
            for (int f = 0; f < t->n_family; ++f, re += 2 * n)
                for (int v = 0; v < PART; ++v) {
                    even[v] += bd_all(phase[2 * f]) * bd_load(re + v * BD_WIDTH);
                    odd[v] += bd_all(phase[2 * f + 1]) * bd_load(re + n + v * BD_WIDTH);
                }
            for (int v = 0; v < PART; ++v) {
                bd_store(out + k * n + i + v * BD_WIDTH, even[v] - odd[v]);
                if (other != k) bd_store(out + other * n + i + v * BD_WIDTH, even[v] + odd[v]);
            }
        }
    }
}

/* z (n_family, 2, n) = sum over sectors of x exp(-i k d phi), x (n_sector, n). */
BD_INLINE void to_diameters(const bd_time *t, size_t n, const double *x, double *z) {
    const size_t sectors = (size_t)t->n_sector;
    const bd_vec none = bd_all(0.0);
    for (size_t k = 0; 2 * k <= sectors; ++k) {
        const size_t other = (sectors - k) % sectors;
        const double *phase = t->phase + 2 * k * (size_t)t->n_family;
        for (size_t i = 0; i < n; i += BD_WIDTH) {
            bd_vec even = bd_load(x + k * n + i), odd = even;
            if (other != k) {
                const bd_vec b = bd_load(x + other * n + i);
                odd = even - b;
                even = even + b;
            }
            for (int f = 0; f < t->n_family; ++f) {
                double *re = z + 2 * (size_t)f * n + i, *im = re + n;
                bd_store(re, (k ? bd_load(re) : none) + bd_all(phase[2 * f]) * even);
                bd_store(im, (k ? bd_load(im) : none) - bd_all(phase[2 * f + 1]) * odd);
            }
        }
    }
}

/* ---- products ---- */

/* C (m, n) = A (m, k) B (k, n), n a multiple of 8. */
BD_INLINE void multiply(size_t m, size_t n, size_t k, const double *A, const double *B, double *C) {
    enum { TILE = 4 };
    for (size_t i = 0; i < m; i += TILE) {
        const size_t height = m - i < TILE ? m - i : TILE;
        for (size_t j = 0; j < n; j += 8) {
            bd_vec sum[TILE][PART];
            for (int a = 0; a < TILE; ++a)
                for (int v = 0; v < PART; ++v) sum[a][v] = bd_all(0.0);
            if (height == TILE) {
                /* each vector of B serves all rows of the tile */
                for (size_t l = 0; l < k; ++l) {
                    for (int v = 0; v < PART; ++v) {
                        const bd_vec b = bd_load(B + l * n + j + (size_t)v * BD_WIDTH);
                        for (size_t a = 0; a < TILE; ++a)
                            sum[a][v] += bd_all(A[(i + a) * k + l]) * b;
                    }
                }
            } else {
                for (size_t a = 0; a < height; ++a) {
                    for (size_t l = 0; l < k; ++l) {
                        for (int v = 0; v < PART; ++v) {
                            const bd_vec b = bd_load(B + l * n + j + (size_t)v * BD_WIDTH);
                            sum[a][v] += bd_all(A[(i + a) * k + l]) * b;
                        }
                    }
                }
            }
            for (size_t a = 0; a < height; ++a)
                for (int v = 0; v < PART; ++v)
                    bd_store(C + (i + a) * n + j + (size_t)v * BD_WIDTH, sum[a][v]);
        }
    }
}

/* y (n) = A x, n a multiple of 8, with A in blocks of 8 rows, each stored by columns. */
BD_INLINE void multiply_blocks(size_t n, const double *A, const double *x, double *y) {
    for (size_t i = 0; i < n; i += 8) {
        bd_vec even[PART], odd[PART];
        for (int v = 0; v < PART; ++v) even[v] = odd[v] = bd_all(0.0);
        for (size_t j = 0; j < n; j += 2, A += 16)
            for (int v = 0; v < PART; ++v) {
                even[v] += bd_load(A + v * BD_WIDTH) * bd_all(x[j]);
                odd[v] += bd_load(A + 8 + v * BD_WIDTH) * bd_all(x[j + 1]);
            }
        for (int v = 0; v < PART; ++v) bd_store(y + i + v * BD_WIDTH, even[v] + odd[v]);
    }
}

/* u (n_sector, rank) = C p. */
static void compliance_times(bd_time *t, const bd_time_patterns *patterns, const double *p,
                             double *u) {
    const size_t r = (size_t)patterns->rank;
    const double *C = patterns->compliance;
    to_diameters(t, r, p, t->force_amplitude);
    for (int f = 0; f < t->n_family; ++f) {
        const double *zr = t->force_amplitude + 2 * r * (size_t)f, *zi = zr + r;
        double *y = t->motion_amplitude + 2 * r * (size_t)f;
        for (size_t i = 0; i < r; i += 8) {
            bd_vec rr[PART], ri[PART], ir[PART], ii[PART];
            for (int v = 0; v < PART; ++v) rr[v] = ri[v] = ir[v] = ii[v] = bd_all(0.0);
            for (size_t j = 0; j < r; ++j, C += 16) {
                const bd_vec a = bd_all(zr[j]), b = bd_all(zi[j]);
                for (int v = 0; v < PART; ++v) {
                    const bd_vec cr = bd_load(C + v * BD_WIDTH);
                    const bd_vec ci = bd_load(C + 8 + v * BD_WIDTH);
                    rr[v] += cr * a;
                    ii[v] += ci * b;
                    ri[v] += cr * b;
                    ir[v] += ci * a;
                }
            }
            for (int v = 0; v < PART; ++v) {
                bd_store(y + i + v * BD_WIDTH, rr[v] - ii[v]);
                bd_store(y + r + i + v * BD_WIDTH, ri[v] + ir[v]);
            }
        }
    }
    to_sectors(t, r, t->motion_amplitude, u);
}

/* Sum of the entries, in pairs. */
BD_INLINE double total(bd_vec x) {
    double part[BD_WIDTH];
    bd_store(part, x);
    for (size_t half = BD_WIDTH / 2; half; half /= 2)
        for (size_t i = 0; i < half; ++i) part[i] += part[i + half];
    return part[0];
}

BD_INLINE double dot(size_t n, const double *a, const double *b) {
    bd_vec sum = bd_all(0.0), more = sum;
    size_t i = 0;
    for (; i + 2 * BD_WIDTH <= n; i += 2 * BD_WIDTH) {
        sum += bd_load(a + i) * bd_load(b + i);
        more += bd_load(a + i + BD_WIDTH) * bd_load(b + i + BD_WIDTH);
    }
    for (; i < n; i += BD_WIDTH) sum += bd_load(a + i) * bd_load(b + i);
    return total(sum + more);
}

/* y += c x */
BD_INLINE void add(size_t n, double c, const double *x, double *y) {
    for (size_t i = 0; i < n; i += BD_WIDTH)
        bd_store(y + i, bd_load(y + i) + bd_all(c) * bd_load(x + i));
}

BD_INLINE double larger(double a, double b) { return a > b ? a : b; }

/* Motion x (n_sector, rows) of all points from the coordinates q_next. */
static void find_motion(bd_time *t, double *x) {
    const size_t size = 2 * t->rows, s = t->stride;
    const double *G = t->motion_modes;
    for (int f = 0; f < t->n_family; ++f) {
        family_motion(t, f, G, t->motion_amplitude + (size_t)f * size);
        G += size * (((size_t)t->n_mode[f] + 7) / 8 * 8);
    }
    to_sectors(t, t->rows, t->motion_amplitude, x);
    for (size_t k = 0; k < (size_t)t->n_sector; ++k)
        add(3 * s, 1.0, t->parameters + BD_TIME_SHIFT * s, x + k * t->rows);
}

/* Modal forces of the contact forces F. */
static void find_modal_forces(bd_time *t) {
    const size_t size = 2 * t->rows;
    const double *G = t->force_modes;
    to_diameters(t, t->rows, t->point_force, t->force_amplitude);
    for (int f = 0; f < t->n_family; ++f) {
        family_force(t, f, G, t->force_amplitude + (size_t)f * size);
        G += size * (((size_t)t->n_mode[f] + 7) / 8 * 8);
    }
}

#endif
