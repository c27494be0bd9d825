/* Block elimination around a ring of sectors that are coupled to their neighbours only.
 *
 * The unknowns of sector n are the coefficients of blade n, inner coordinates e and ring
 * coordinates a, and of damper n, y, between blades n and n + 1. The disk couples a to the a of the
 * adjacent sectors. The damper y touches both its blades. Hence
 *
 *     E_n e_n = r_n - B_n [a_n, y_n, y_(n-1)]
 *
 * is eliminated sector by sector. A ring of blocks [a, y] remains,
 *
 *     L_n x_(n-1) + D_n x_n + U_n x_(n+1) = b_n,    n modulo N.
 *
 * Its elimination has the last sector as border. W couples a sector to the last one, and V couples
 * the last one to the sector:
 *
 *     D_(n+1) -= L_(n+1) D_n^-1 U_n,     W_(n+1) = -L_(n+1) D_n^-1 W_n,
 *     D_last  -= V_n D_n^-1 W_n,         V_(n+1) = -V_n D_n^-1 U_n.
 *
 * The determinant is the product of the determinants of E_n and D_n at their elimination. The
 * transposed matrix has the same factors in reverse order.
 *
 * Matrices are row-major. Inverses replace factors, since products run several times faster than
 * triangular solutions. */
#include "bladed_disk/cyclic_elimination.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* C (m, n; ldc) = A B, or C += alpha A B if alpha is not 0. */
static void multiply(const bd_ring *w, int m, int n, int k, double alpha, const double *A, int lda,
                     const double *B, int ldb, double *C, int ldc) {
    for (int i = 0; i < m && alpha == 0.0; ++i) memset(C + i * ldc, 0, sizeof(double) * (size_t)n);
    w->kernel->add_product((size_t)m, (size_t)n, (size_t)k, alpha == 0.0 ? 1.0 : alpha, A,
                           (size_t)lda, B, (size_t)ldb, C, (size_t)ldc);
}

/* Replace A (n, n) by its inverse; update the sign of the determinant. */
static int invert(bd_ring *w, double *A, int n) {
    const int sign = w->kernel->invert(n, A, w->pivot, w->work);
    if (sign < 0) w->sign = -w->sign;
    return sign != 0 && isfinite(A[0]);
}

/* ---- storage ---- */

void bd_ring_destroy(bd_ring *w) {
    free(w->memory);
    free(w->pivot);
    memset(w, 0, sizeof *w);
}

bd_status bd_ring_create(bd_ring *w, const bd_ring_input *in) {
    memset(w, 0, sizeof *w);
    const int nc = in->n_coef;
    w->input = *in;
    for (int p = 0; p < in->n_point; ++p) ++w->n_group[in->on_next[p] != 0];
    w->kernel = bd_kernel_get();
    w->sector_size = in->n_blade + in->n_damper;
    w->n_inner = nc * (in->n_blade - in->n_kept);
    w->n_damper_unknown = nc * in->n_damper;
    w->n_ring = nc * in->n_kept + w->n_damper_unknown;
    const size_t N = (size_t)in->n_sector, e = (size_t)w->n_inner, s = (size_t)w->n_ring,
                 q = s + (size_t)w->n_damper_unknown;
    const size_t n_sector_unknown = (size_t)(nc * w->sector_size), most = (e > s ? e : s) + 1;
    const struct {
        double **to;
        size_t n;
    } parts[] = {{&w->inverse, N * e * e},
                 {&w->inner_to_outer, N * e * q},
                 {&w->outer_to_inner, N * q * e},
                 {&w->diagonal, N * s * s},
                 {&w->lower, N * s * s},
                 {&w->upper, N * s * s},
                 {&w->last_row, N * s * s},
                 {&w->next_factor, N * s * s},
                 {&w->last_factor, N * s * s},
                 {&w->own_side, n_sector_unknown * n_sector_unknown},
                 {&w->next_side, n_sector_unknown * n_sector_unknown},
                 {&w->Z, 3 * (size_t)in->n_point * n_sector_unknown},
                 {&w->rows, 3 * (size_t)(in->n_point * w->sector_size)},
                 {&w->picked_rows, 3 * (size_t)(in->n_point * w->sector_size)},
                 {&w->rows_transposed, 3 * (size_t)(in->n_point * w->sector_size)},
                 {&w->columns, e * q},
                 {&w->outer, q * q + N * (e + 2 * q)},
                 {&w->product, e + 2 * q},
                 {&w->work, 3 * most + 2 * n_sector_unknown + 2 * BD_KERNEL_BLOCK * (most + 8)}};
    size_t total = BD_KERNEL_PAD;
    for (size_t i = 0; i < sizeof parts / sizeof *parts; ++i) total += parts[i].n;
    w->memory = malloc(sizeof(double) * total);
    w->pivot = malloc(sizeof(int) * (most + 2 * (size_t)in->n_point));
    if (!w->memory || !w->pivot) {
        bd_ring_destroy(w);
        return BD_NO_MEMORY;
    }
    double *p = w->memory;
    for (size_t i = 0; i < sizeof parts / sizeof *parts; p += parts[i++].n) *parts[i].to = p;
#ifdef BD_POISON
    for (size_t i = 0; i < total; ++i) w->memory[i] = NAN;
#endif
    w->point = w->pivot + most;
    w->picked = w->point + in->n_point;
    int at[2] = {0, w->n_group[0]};
    for (int p = 0; p < in->n_point; ++p) {
        const int k = at[in->on_next[p] != 0]++, row = 3 * w->sector_size;
        w->point[k] = p;
        memcpy(w->rows + k * row, in->rows + p * row, sizeof(double) * (size_t)row);
        const int first = in->on_next[p] ? w->n_group[0] : 0,
                  wide = 3 * w->n_group[in->on_next[p] != 0];
        double *to = w->rows_transposed + first * row + 3 * (k - first);
        for (int i = 0; i < row; ++i)
            to[i % w->sector_size * wide + i / w->sector_size] = in->rows[p * row + i];
    }
    return BD_OK;
}

/* ---- one sector ---- */

/* z (n_coef, sector_size) = sum over c' of three blocks (c, c') times a row of motion each. */
static void fill_row(const bd_ring *w, const double *const block[3], const double *const row[3],
                     double *restrict z) {
    for (int d = 0; d < w->input.n_coef; ++d, z += w->sector_size) {
        const double a = block[0][d], b = block[1][d], c = block[2][d];
        for (int j = 0; j < w->sector_size; ++j)
            z[j] = a * row[0][j] + b * row[1][j] + c * row[2][j];
    }
}

/* Pick the points of a group whose tangents have a form, and copy their
 * rows; return their number. */
static int pick_points(bd_ring *w, int g, const unsigned char *form, bd_block wanted) {
    const int first = g * w->n_group[0], row = 3 * w->sector_size;
    int n = 0;
    for (int p = first; p < first + w->n_group[g]; ++p) {
        if (form[w->point[p]] != wanted) continue;
        memcpy(w->picked_rows + n * row, w->rows + p * row, sizeof(double) * (size_t)row);
        w->picked[n++] = w->point[p];
    }
    return n;
}

/* Tangents of the points of sector k on its blade, or on the next one: (n_coef, sector_size,
 * n_coef, sector_size). */
static void contact_matrix(bd_ring *w, int g, const bd_ring_matrix *m, int k, double *out) {
    const int nc = w->input.n_coef, ns = w->sector_size, wide = nc * ns;
    const size_t nn = (size_t)(nc * nc), first = (size_t)k * (size_t)w->input.n_point;
    const double *T = m->tangent + 7 * nn * first, *rows = w->picked_rows;
    memset(out, 0, sizeof(double) * (size_t)wide * (size_t)wide);
    int n = pick_points(w, g, m->form + first, BD_BLOCK_FULL);
    for (int c = 0; c < nc; ++c) {
        for (int p = 0; p < n; ++p) {
            const double *t = T + ((size_t)w->picked[p] * 7 * (size_t)nc + (size_t)c) * (size_t)nc;
            const double *u = rows + 3 * p * ns, *v = u + ns, *normal = v + ns;
            double *z = w->Z + (size_t)(3 * p) * (size_t)wide;
            fill_row(w, (const double *[]){t, t + 2 * nn, t + 4 * nn},
                     (const double *[]){u, normal, v}, z);
            fill_row(w, (const double *[]){t + nn, t + 3 * nn, t + 5 * nn},
                     (const double *[]){v, normal, u}, z + wide);
            for (int d = 0; d < nc; ++d)
                for (int j = 0; j < ns; ++j)
                    z[2 * wide + d * ns + j] = t[6 * nn + (size_t)d] * normal[j];
        }
        w->kernel->product((size_t)ns, (size_t)wide, (size_t)(3 * n), rows, w->Z, (size_t)wide,
                           out + (size_t)(c * ns) * (size_t)wide, (size_t)wide);
    }
    n = pick_points(w, g, m->form + first, BD_BLOCK_LINEAR);
    for (int c = 0; c < nc; ++c) {
        for (int i = 0; i < 3 * n; ++i) {
            const int block = i % 3 == 2 ? 6 : i % 3;
            const size_t at = (size_t)(7 * w->picked[i / 3] + block) * nn + (size_t)(c * (nc + 1));
            const double stiffness = T[at];
            for (int j = 0; j < ns; ++j) w->Z[i * ns + j] = stiffness * rows[i * ns + j];
        }
        w->kernel->product((size_t)ns, (size_t)ns, (size_t)(3 * n), rows, w->Z, (size_t)ns,
                           out + (size_t)(c * ns) * ((size_t)wide + 1), (size_t)wide);
    }
}

/* Add the linear parts of one sector to the diagonal blocks of own_side. */
static void add_linear(bd_ring *w, const bd_ring_matrix *m, int n) {
    const bd_ring_input *in = &w->input;
    const size_t nb = (size_t)in->n_blade, nd = (size_t)in->n_damper, ns = (size_t)w->sector_size,
                 wide = (size_t)in->n_coef * ns;
    const double *blade = m->blade + (size_t)n * nb * nb;
    for (int c = 0; c < in->n_coef; ++c) {
        const size_t l = (size_t)(c + 1) / 2;
        double *here = w->own_side + (size_t)c * ns * wide + (size_t)c * ns;
        if (!in->active[c]) {
            for (size_t i = 0; i < ns; ++i) here[i * wide + i] = 1.0;
            continue;
        }
        const double *K = m->common + l * nb * nb, *C = m->damping + l * nb * nb;
        const double *k = m->damper + 2 * (l * (size_t)in->n_sector + (size_t)n) * nd, *d = k + nd;
        for (size_t i = 0; i < nb; ++i)
            for (size_t j = 0; j < nb; ++j) here[i * wide + j] += blade[i * nb + j] + K[i * nb + j];
        for (size_t i = 0; i < nd; ++i) {
            double *to = here + (nb + i) * wide + nb + i;
            *to += k[i] + (c == 0 ? m->springs[(size_t)n * nd + i] : 0.0);
            if (in->pinned[n]) *to = 1.0;
        }
        if (c == 0) continue;
        double *other = c % 2 ? here + ns : here - ns;
        const double sign = c % 2 ? 1.0 : -1.0;
        for (size_t i = 0; i < nb; ++i)
            for (size_t j = 0; j < nb; ++j) other[i * wide + j] += sign * C[i * nb + j];
        for (size_t i = 0; i < nd && !in->pinned[n]; ++i)
            other[(nb + i) * wide + nb + i] += sign * d[i];
    }
}

/* Copy the entries of a sector matrix for coordinates [i0, i1) and [j0, j1); `to` has the leading
 * dimension ld. */
static void extract(const bd_ring *w, const double *from, int i0, int i1, int j0, int j1,
                    double *to, int ld) {
    const int wide = w->input.n_coef * w->sector_size;
    for (int c = 0; c < w->input.n_coef; ++c)
        for (int i = i0; i < i1; ++i) {
            const double *row = from + (size_t)(c * w->sector_size + i) * (size_t)wide;
            double *out = to + (size_t)(c * (i1 - i0) + i - i0) * (size_t)ld;
            for (int d = 0; d < w->input.n_coef; ++d)
                memcpy(out + d * (j1 - j0), row + d * w->sector_size + j0,
                       sizeof(double) * (size_t)(j1 - j0));
        }
}

/* Add the blade part of next_side to own_side. */
static void add_blade(bd_ring *w) {
    const size_t ns = (size_t)w->sector_size, wide = (size_t)w->input.n_coef * ns,
                 nb = (size_t)w->input.n_blade;
    for (int c = 0; c < w->input.n_coef; ++c)
        for (size_t i = 0; i < nb; ++i)
            for (int d = 0; d < w->input.n_coef; ++d) {
                const size_t at = ((size_t)c * ns + i) * wide + (size_t)d * ns;
                for (size_t j = 0; j < nb; ++j) w->own_side[at + j] += w->next_side[at + j];
            }
}

/* Eliminate the inner blade coordinates of sector n and add the remainder to
 * the blocks of the ring. */
static int eliminate_blade(bd_ring *w, int n) {
    const int N = w->input.n_sector, e = w->input.n_blade - w->input.n_kept, nb = w->input.n_blade,
              ns = w->sector_size;
    const int E = w->n_inner, s = w->n_ring, side = w->n_damper_unknown, q = s + side, A = s - side;
    double *inverse = w->inverse + (size_t)n * (size_t)E * (size_t)E,
           *back = w->inner_to_outer + (size_t)n * (size_t)E * (size_t)q;
    double *couple = w->outer_to_inner + (size_t)n * (size_t)q * (size_t)E, *S = w->outer;
    double *columns = w->columns;
    memset(S, 0, sizeof(double) * (size_t)q * (size_t)q);
    extract(w, w->own_side, 0, e, 0, e, inverse, E);
    extract(w, w->own_side, 0, e, e, nb, columns, q);
    extract(w, w->own_side, 0, e, nb, ns, columns + A, q);
    extract(w, w->next_side, 0, e, nb, ns, columns + s, q);
    extract(w, w->own_side, e, nb, 0, e, couple, E);
    extract(w, w->own_side, nb, ns, 0, e, couple + (size_t)A * (size_t)E, E);
    extract(w, w->next_side, nb, ns, 0, e, couple + (size_t)s * (size_t)E, E);
    extract(w, w->own_side, e, nb, e, nb, S, q);
    extract(w, w->own_side, e, nb, nb, ns, S + A, q);
    extract(w, w->own_side, nb, ns, e, nb, S + (size_t)A * (size_t)q, q);
    extract(w, w->own_side, nb, ns, nb, ns, S + (size_t)A * (size_t)q + A, q);
    extract(w, w->next_side, e, nb, nb, ns, S + s, q);
    extract(w, w->next_side, nb, ns, e, nb, S + (size_t)s * (size_t)q, q);
    extract(w, w->next_side, nb, ns, nb, ns, S + (size_t)s * (size_t)q + s, q);
    if (E > 0) {
        if (!invert(w, inverse, E)) return 0;
        multiply(w, E, q, E, 0.0, inverse, E, columns, q, back, q);
        multiply(w, q, q, E, -1.0, couple, E, back, q, S, q);
    }
    const size_t ss = (size_t)s * (size_t)s;
    double *D = w->diagonal + (size_t)n * ss,
           *before = w->diagonal + (size_t)((n + N - 1) % N) * ss;
    double *L = w->lower + (size_t)n * ss, *U = w->upper + (size_t)((n + N - 1) % N) * ss;
    for (int i = 0; i < s; ++i) {
        const double *row = S + (size_t)i * (size_t)q;
        for (int j = 0; j < s; ++j) D[(size_t)i * (size_t)s + (size_t)j] += row[j];
        for (int j = 0; j < side; ++j) L[(size_t)i * (size_t)s + (size_t)(A + j)] += row[s + j];
    }
    for (int i = 0; i < side; ++i) {
        const double *row = S + (size_t)(s + i) * (size_t)q;
        const size_t at = (size_t)(A + i) * (size_t)s;
        for (int j = 0; j < s; ++j) U[at + (size_t)j] += row[j];
        for (int j = 0; j < side; ++j) before[at + (size_t)(A + j)] += row[s + j];
    }
    return 1;
}

/* ---- the ring ---- */

static void add_disk(bd_ring *w, const double *neighbour) {
    const size_t k = (size_t)w->input.n_kept, s = (size_t)w->n_ring, ss = s * s;
    for (size_t n = 0; n < (size_t)w->input.n_sector; ++n)
        for (int c = 0; c < w->input.n_coef; ++c) {
            if (!w->input.active[c]) continue;
            const double *K = neighbour + (size_t)((c + 1) / 2) * k * k;
            const size_t at = n * ss + (size_t)c * k * s + (size_t)c * k;
            for (size_t i = 0; i < k; ++i)
                for (size_t j = 0; j < k; ++j) {
                    w->lower[at + i * s + j] += K[i * k + j];
                    w->upper[at + i * s + j] += K[j * k + i];
                }
        }
}

static int eliminate_ring(bd_ring *w) {
    const int N = w->input.n_sector, s = w->n_ring;
    const size_t ss = (size_t)s * (size_t)s;
    double *end = w->diagonal + (size_t)(N - 1) * ss;
    memcpy(w->last_row, w->upper + (size_t)(N - 1) * ss, sizeof(double) * ss);
    double *W = w->lower; /* W of sector 0 is its coupling to the last sector */
    for (int n = 0; n < N - 1; ++n) {
        const size_t at = (size_t)n * ss;
        double *D = w->diagonal + at, *V = w->last_row + at, *fill = w->last_factor + at,
               *onward = w->next_factor + at;
        if (n == N - 2)
            for (size_t i = 0; i < ss; ++i) V[i] += w->lower[at + ss + i], W[i] += w->upper[at + i];
        if (!invert(w, D, s)) return 0;
        multiply(w, s, s, s, 0.0, D, s, W, s, fill, s);
        multiply(w, s, s, s, -1.0, V, s, fill, s, end, s);
        if (n == N - 2) break;
        const double *next = w->lower + at + ss;
        multiply(w, s, s, s, 0.0, D, s, w->upper + at, s, onward, s);
        multiply(w, s, s, s, -1.0, next, s, onward, s, D + ss, s);
        memset(V + ss, 0, sizeof(double) * ss);
        multiply(w, s, s, s, -1.0, V, s, onward, s, V + ss, s);
        W = w->upper + at; /* not needed any more */
        memset(W, 0, sizeof(double) * ss);
        multiply(w, s, s, s, -1.0, next, s, fill, s, W, s);
    }
    return invert(w, end, s);
}

bd_status bd_ring_factor(bd_ring *w, const bd_ring_matrix *m) {
    const size_t N = (size_t)w->input.n_sector,
                 all = sizeof(double) * N * (size_t)w->n_ring * (size_t)w->n_ring;
    w->sign = 1;
    memset(w->diagonal, 0, all), memset(w->lower, 0, all), memset(w->upper, 0, all);
    for (size_t n = 0; n < N; ++n) {
        contact_matrix(w, 0, m, (int)n, w->own_side);
        contact_matrix(w, 1, m, (int)((n + N - 1) % N), w->next_side);
        add_blade(w);
        add_linear(w, m, (int)n);
        if (!eliminate_blade(w, (int)n)) return BD_SINGULAR;
    }
    add_disk(w, m->neighbour);
    return eliminate_ring(w) ? BD_OK : BD_SINGULAR;
}

/* ---- solution ---- */

/* y += alpha A x with A (m, n), or alpha A^T x. */
static void add_product(const bd_ring *w, int transposed, int m, int n, double alpha,
                        const double *A, const double *x, double *y) {
    const int from = transposed ? m : n, to = transposed ? n : m;
    double *t = w->product;
    if (transposed) {
        for (int i = 0; i < from; ++i) t[i] = alpha * x[i];
        w->kernel->multiply_transposed((size_t)m, (size_t)n, A, t, y);
        return;
    }
    w->kernel->multiply((size_t)m, (size_t)n, A, x, t);
    for (int i = 0; i < to; ++i) y[i] += alpha * t[i];
}

/* Multiply x (s) by the inverse on the diagonal. */
static void apply_inverse(const bd_ring *w, int transposed, int n, double *x) {
    const size_t s = (size_t)w->n_ring;
    double *t = w->work;
    memset(t, 0, sizeof(double) * s);
    add_product(w, transposed, w->n_ring, w->n_ring, 1.0, w->diagonal + (size_t)n * s * s, x, t);
    memcpy(x, t, sizeof(double) * s);
}

/* Solve the ring for the right-hand side b (N, s) in place. */
static void solve_ring(bd_ring *w, double *b) {
    const int N = w->input.n_sector, s = w->n_ring;
    const size_t ss = (size_t)s * (size_t)s;
    double *end = b + (size_t)(N - 1) * (size_t)s;
    for (int n = 0; n < N; ++n) {
        double *here = b + (size_t)n * (size_t)s;
        apply_inverse(w, 0, n, here);
        if (n < N - 2)
            add_product(w, 0, s, s, -1.0, w->lower + (size_t)(n + 1) * ss, here, here + s);
        if (n < N - 1) add_product(w, 0, s, s, -1.0, w->last_row + (size_t)n * ss, here, end);
    }
    for (int n = N - 2; n >= 0; --n) {
        double *here = b + (size_t)n * (size_t)s;
        add_product(w, 0, s, s, -1.0, w->last_factor + (size_t)n * ss, end, here);
        if (n < N - 2)
            add_product(w, 0, s, s, -1.0, w->next_factor + (size_t)n * ss, here + s, here);
    }
}

static void solve_ring_transposed(bd_ring *w, double *b) {
    const int N = w->input.n_sector, s = w->n_ring;
    const size_t ss = (size_t)s * (size_t)s;
    double *end = b + (size_t)(N - 1) * (size_t)s;
    for (int n = 0; n < N - 1; ++n) {
        double *here = b + (size_t)n * (size_t)s;
        add_product(w, 1, s, s, -1.0, w->last_factor + (size_t)n * ss, here, end);
        if (n < N - 2)
            add_product(w, 1, s, s, -1.0, w->next_factor + (size_t)n * ss, here, here + s);
    }
    for (int n = N - 1; n >= 0; --n) {
        double *here = b + (size_t)n * (size_t)s;
        if (n < N - 2)
            add_product(w, 1, s, s, -1.0, w->lower + (size_t)(n + 1) * ss, here + s, here);
        if (n < N - 1) add_product(w, 1, s, s, -1.0, w->last_row + (size_t)n * ss, end, here);
        apply_inverse(w, 1, n, here);
    }
}

/* Copy the inner right-hand side of sector n to t and add the remainder to the ring. */
static void split_sector(const bd_ring *w, const double *from, double *t, double *to) {
    const int ns = w->sector_size, k = w->input.n_kept, e = w->input.n_blade - k,
              nd = w->input.n_damper, A = w->n_ring - w->n_damper_unknown;
    for (int c = 0; c < w->input.n_coef; ++c) {
        memcpy(t + c * e, from + c * ns, sizeof(double) * (size_t)e);
        for (int i = 0; i < k; ++i) to[c * k + i] += from[c * ns + e + i];
        for (int i = 0; i < nd; ++i) to[A + c * nd + i] += from[c * ns + e + k + i];
    }
}

void bd_ring_solve(bd_ring *w, int transposed, const double *r, double *x) {
    const int N = w->input.n_sector, nc = w->input.n_coef, ns = w->sector_size, k = w->input.n_kept,
              e = w->input.n_blade - k;
    const int nd = w->input.n_damper, E = w->n_inner, s = w->n_ring, side = w->n_damper_unknown,
              q = s + side, A = s - side;
    const size_t EE = (size_t)E * (size_t)E, Eq = (size_t)E * (size_t)q;
    /* (N, E), (N, s), one sector */
    double *inner = w->outer, *b = inner + (size_t)N * (size_t)E, *t = w->work;
    memset(b, 0, sizeof(double) * (size_t)N * (size_t)s);
    memset(inner, 0, sizeof(double) * (size_t)N * (size_t)E);
    for (int n = 0; n < N; ++n) {
        double *to = b + (size_t)n * (size_t)s,
               *before = b + (size_t)((n + N - 1) % N) * (size_t)s + A;
        double *inner_n = inner + (size_t)n * (size_t)E;
        const double *couple = w->outer_to_inner + (size_t)n * Eq,
                     *back = w->inner_to_outer + (size_t)n * Eq;
        if (!transposed) {
            split_sector(w, r + (size_t)n * (size_t)(nc * ns), t, to);
            add_product(w, 0, E, E, 1.0, w->inverse + (size_t)n * EE, t, inner_n);
            add_product(w, 0, s, E, -1.0, couple, inner_n, to);
            add_product(w, 0, side, E, -1.0, couple + (size_t)s * (size_t)E, inner_n, before);
            continue;
        }
        split_sector(w, r + (size_t)n * (size_t)(nc * ns), inner_n, to);
        memset(t, 0, sizeof(double) * (size_t)q);
        add_product(w, 1, E, q, -1.0, back, inner_n, t);
        for (int i = 0; i < s; ++i) to[i] += t[i];
        for (int i = 0; i < side; ++i) before[i] += t[s + i];
    }
    if (transposed)
        solve_ring_transposed(w, b);
    else
        solve_ring(w, b);
    for (int n = 0; n < N; ++n) {
        const double *here = b + (size_t)n * (size_t)s,
                     *before = b + (size_t)((n + N - 1) % N) * (size_t)s + A;
        double *inner_n = inner + (size_t)n * (size_t)E, *to = x + (size_t)n * (size_t)(nc * ns);
        memcpy(t, here, sizeof(double) * (size_t)s);
        memcpy(t + s, before, sizeof(double) * (size_t)side);
        if (!transposed) {
            add_product(w, 0, E, q, -1.0, w->inner_to_outer + (size_t)n * Eq, t, inner_n);
        } else {
            double *u = t + q;
            add_product(w, 1, q, E, -1.0, w->outer_to_inner + (size_t)n * Eq, t, inner_n);
            memcpy(u, inner_n, sizeof(double) * (size_t)E);
            memset(inner_n, 0, sizeof(double) * (size_t)E);
            add_product(w, 1, E, E, 1.0, w->inverse + (size_t)n * EE, u, inner_n);
        }
        for (int c = 0; c < nc; ++c) {
            memcpy(to + c * ns, inner_n + c * e, sizeof(double) * (size_t)e);
            memcpy(to + c * ns + e, here + c * k, sizeof(double) * (size_t)k);
            memcpy(to + c * ns + e + k, here + A + c * nd, sizeof(double) * (size_t)nd);
        }
    }
}
