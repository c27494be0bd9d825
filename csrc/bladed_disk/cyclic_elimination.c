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

#include "util/storage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* C (m, n; ldc) += alpha A B with A (m, k; lda) and B (k, n; ldb). */
static void add_multiple(const bd_ring *w, int m, int n, int k, double alpha, const double *A,
                         int lda, const double *B, int ldb, double *C, int ldc) {
    w->kernel->add_product((size_t)m, (size_t)n, (size_t)k, alpha, A, (size_t)lda, B, (size_t)ldb,
                           C, (size_t)ldc);
}

/* C (m, n; ldc) = A B. */
static void multiply(const bd_ring *w, int m, int n, int k, const double *A, int lda,
                     const double *B, int ldb, double *C, int ldc) {
    for (int i = 0; i < m; ++i) memset(C + i * ldc, 0, sizeof(double) * (size_t)n);
    add_multiple(w, m, n, k, 1.0, A, lda, B, ldb, C, ldc);
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

/* Sort the points into those on the blade of the sector and those on the next blade, and copy their
 * rows in this order, also transposed. */
static void sort_points(bd_ring *w) {
    const bd_ring_input *in = &w->input;
    const int ns = w->sector_size, row_size = 3 * ns;
    int k = 0; /* place in the new order */
    for (int g = 0; g < 2; ++g) {
        const int first = g ? w->n_group[0] : 0, wide = 3 * w->n_group[g];
        double *transposed = w->rows_transposed + first * row_size; /* (ns, wide) */
        for (int p = 0; p < in->n_point; ++p) {
            const int group = in->on_next[p] != 0;
            if (group != g) continue;
            const double *rows = in->rows + p * row_size;
            memcpy(w->rows + k * row_size, rows, sizeof(double) * (size_t)row_size);
            for (int d = 0; d < 3; ++d)
                for (int j = 0; j < ns; ++j)
                    transposed[j * wide + 3 * (k - first) + d] = rows[d * ns + j];
            w->point[k] = p;
            ++k;
        }
    }
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

    const size_t N = (size_t)in->n_sector, n_point = (size_t)in->n_point;
    const size_t inner = (size_t)w->n_inner, ring = (size_t)w->n_ring;
    const size_t outer = ring + (size_t)w->n_damper_unknown;
    const size_t n_row = 3 * n_point * (size_t)w->sector_size;
    const size_t sector = (size_t)(nc * w->sector_size);
    const size_t most = (inner > ring ? inner : ring) + 1;
    const struct {
        double **to;
        size_t n;
    } parts[] = {
        {&w->inverse, N * inner * inner},
        {&w->inner_to_outer, N * inner * outer},
        {&w->outer_to_inner, N * outer * inner},
        {&w->diagonal, N * ring * ring},
        {&w->lower, N * ring * ring},
        {&w->upper, N * ring * ring},
        {&w->last_row, N * ring * ring},
        {&w->next_factor, N * ring * ring},
        {&w->last_factor, N * ring * ring},
        {&w->own_side, sector * sector},
        {&w->next_side, sector * sector},
        {&w->Z, 3 * n_point * sector},
        {&w->rows, n_row},
        {&w->picked_rows, n_row},
        {&w->rows_transposed, n_row},
        {&w->columns, inner * outer},
        {&w->outer, outer * outer + N * (inner + 2 * outer)},
        {&w->product, inner + 2 * outer},
        {&w->work, 3 * most + 2 * sector + 2 * BD_KERNEL_BLOCK * (most + 8)},
    };
    const size_t n_part = sizeof parts / sizeof *parts;
    size_t total = BD_KERNEL_PAD;
    for (size_t i = 0; i < n_part; ++i) total += parts[i].n;
    w->memory = malloc(sizeof(double) * total);
    w->pivot = malloc(sizeof(int) * (most + 2 * n_point));
    if (!w->memory || !w->pivot) {
        bd_ring_destroy(w);
        return BD_NO_MEMORY;
    }
#ifdef BD_POISON
    for (size_t i = 0; i < total; ++i) w->memory[i] = NAN;
#endif
    double *rest = w->memory;
    for (size_t i = 0; i < n_part; ++i) *parts[i].to = bd_take(&rest, parts[i].n);
    w->point = w->pivot + most;
    w->picked = w->point + in->n_point;
    sort_points(w);
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
    const int row = 3 * w->sector_size;
    const int first = g * w->n_group[0], end = first + w->n_group[g];
    int n = 0;
    for (int k = first; k < end; ++k) {
        const int p = w->point[k];
        if (form[p] != wanted) continue;
        memcpy(w->picked_rows + n * row, w->rows + k * row, sizeof(double) * (size_t)row);
        w->picked[n] = p;
        ++n;
    }
    return n;
}

/* out += rows^T T rows for the n picked points with full tangents T. */
static void add_full_tangents(bd_ring *w, int n, const double *T, double *out) {
    const int nc = w->input.n_coef, ns = w->sector_size, wide = nc * ns;
    const size_t nn = (size_t)(nc * nc);
    for (int c = 0; c < nc; ++c) {
        for (int p = 0; p < n; ++p) {
            /* row c of the blocks dT1, dT2, dTv1, dTv2, dTc1, dTc2 and dN */
            const double *t = T + 7 * nn * (size_t)w->picked[p] + (size_t)(c * nc);
            const double *u1 = w->picked_rows + 3 * p * ns, *u2 = u1 + ns, *v = u2 + ns;
            double *z = w->Z + (size_t)(3 * p) * (size_t)wide;
            fill_row(w, (const double *[]){t, t + 2 * nn, t + 4 * nn},
                     (const double *[]){u1, v, u2}, z);
            fill_row(w, (const double *[]){t + nn, t + 3 * nn, t + 5 * nn},
                     (const double *[]){u2, v, u1}, z + wide);
            for (int d = 0; d < nc; ++d) {
                const double dN = t[6 * nn + (size_t)d];
                for (int j = 0; j < ns; ++j) z[2 * wide + d * ns + j] = dN * v[j];
            }
        }
        double *to = out + (size_t)(c * ns) * (size_t)wide;
        w->kernel->product((size_t)ns, (size_t)wide, (size_t)(3 * n), w->picked_rows, w->Z,
                           (size_t)wide, to, (size_t)wide);
    }
}

/* The same for points whose tangents are multiples of the identity: they couple no coefficients. */
static void add_linear_tangents(bd_ring *w, int n, const double *T, double *out) {
    const int nc = w->input.n_coef, ns = w->sector_size, wide = nc * ns;
    const size_t nn = (size_t)(nc * nc);
    const double *rows = w->picked_rows;
    for (int c = 0; c < nc; ++c) {
        const size_t diagonal = (size_t)(c * (nc + 1));
        for (int i = 0; i < 3 * n; ++i) {
            const int block = i % 3 == 2 ? 6 : i % 3; /* dT1, dT2 or dN */
            const double stiffness = T[(size_t)(7 * w->picked[i / 3] + block) * nn + diagonal];
            for (int j = 0; j < ns; ++j) w->Z[i * ns + j] = stiffness * rows[i * ns + j];
        }
        double *to = out + (size_t)(c * ns) * ((size_t)wide + 1);
        w->kernel->product((size_t)ns, (size_t)ns, (size_t)(3 * n), rows, w->Z, (size_t)ns, to,
                           (size_t)wide);
    }
}

/* Tangents of the points of sector k on its blade, or on the next one: (n_coef, sector_size,
 * n_coef, sector_size). */
static void contact_matrix(bd_ring *w, int g, const bd_ring_matrix *m, int k, double *out) {
    const size_t nc = (size_t)w->input.n_coef, wide = nc * (size_t)w->sector_size;
    const size_t first = (size_t)k * (size_t)w->input.n_point;
    const double *T = m->tangent + 7 * nc * nc * first;
    const unsigned char *form = m->form + first;
    memset(out, 0, sizeof(double) * wide * wide);
    const int n_full = pick_points(w, g, form, BD_BLOCK_FULL);
    add_full_tangents(w, n_full, T, out);
    const int n_linear = pick_points(w, g, form, BD_BLOCK_LINEAR);
    add_linear_tangents(w, n_linear, T, out);
}

/* to (rows of length ld) += factor A, for a matrix A (n, n). */
static void add_matrix(size_t n, double factor, const double *A, double *to, size_t ld) {
    for (size_t i = 0; i < n; ++i)
        for (size_t j = 0; j < n; ++j) to[i * ld + j] += factor * A[i * n + j];
}

/* Add the linear parts of one sector to the diagonal blocks of own_side. */
static void add_linear(bd_ring *w, const bd_ring_matrix *m, int n) {
    const bd_ring_input *in = &w->input;
    const size_t nb = (size_t)in->n_blade, nd = (size_t)in->n_damper, ns = (size_t)w->sector_size;
    const size_t wide = (size_t)in->n_coef * ns, blade_size = nb * nb;
    const double *blade = m->blade + (size_t)n * blade_size;
    const double *springs = m->springs + (size_t)n * nd;
    const int has_damper = !in->pinned[n];
    for (int c = 0; c < in->n_coef; ++c) {
        const size_t l = (size_t)(c + 1) / 2;
        double *here = w->own_side + (size_t)c * ns * wide + (size_t)c * ns;
        if (!in->active[c]) {
            for (size_t i = 0; i < ns; ++i) here[i * wide + i] = 1.0;
            continue;
        }
        const double *K = m->common + l * blade_size, *C = m->damping + l * blade_size;
        const double *k = m->damper + 2 * (l * (size_t)in->n_sector + (size_t)n) * nd;
        const double *drag = k + nd;
        for (size_t i = 0; i < nb; ++i)
            for (size_t j = 0; j < nb; ++j) here[i * wide + j] += blade[i * nb + j] + K[i * nb + j];
        for (size_t i = 0; i < nd; ++i) {
            double *to = here + (nb + i) * wide + nb + i;
            *to += k[i] + (c == 0 ? springs[i] : 0.0);
            if (!has_damper) *to = 1.0;
        }
        if (c == 0) continue;

        /* damping couples the cosine to the sine, which follows it */
        const int is_cosine = c % 2;
        const double sign = is_cosine ? 1.0 : -1.0;
        double *other = is_cosine ? here + ns : here - ns;
        add_matrix(nb, sign, C, other, wide);
        if (!has_damper) continue;
        for (size_t i = 0; i < nd; ++i) other[(nb + i) * wide + nb + i] += sign * drag[i];
    }
}

/* Copy the entries of a sector matrix for coordinates [i0, i1) and [j0, j1); `to` has the leading
 * dimension ld. */
static void extract(const bd_ring *w, const double *from, int i0, int i1, int j0, int j1,
                    double *to, int ld) {
    const int nc = w->input.n_coef, ns = w->sector_size, wide = nc * ns;
    const int n_i = i1 - i0, n_j = j1 - j0;
    for (int c = 0; c < nc; ++c) {
        for (int i = 0; i < n_i; ++i) {
            const double *row = from + (size_t)(c * ns + i0 + i) * (size_t)wide + j0;
            double *out = to + (size_t)(c * n_i + i) * (size_t)ld;
            for (int d = 0; d < nc; ++d)
                memcpy(out + d * n_j, row + d * ns, sizeof(double) * (size_t)n_j);
        }
    }
}

/* Add the blade part of next_side to own_side. */
static void add_blade(bd_ring *w) {
    const size_t nc = (size_t)w->input.n_coef, nb = (size_t)w->input.n_blade;
    const size_t ns = (size_t)w->sector_size, wide = nc * ns;
    for (size_t c = 0; c < nc; ++c) {
        for (size_t i = 0; i < nb; ++i) {
            for (size_t d = 0; d < nc; ++d) {
                const size_t at = (c * ns + i) * wide + d * ns;
                for (size_t j = 0; j < nb; ++j) w->own_side[at + j] += w->next_side[at + j];
            }
        }
    }
}

/* Extract the matrix S of the outer unknowns of a sector: the ring unknowns a and y_n, and the
 * damper y_(n-1) of the sector before, in this order. */
static void extract_outer(bd_ring *w, double *S) {
    const int n_blade = w->input.n_blade, sector_size = w->sector_size;
    const int kept = n_blade - w->input.n_kept; /* first coordinate of the ring */
    const int n_damper = w->n_damper_unknown, n_outer = w->n_ring + n_damper;
    const int damper = w->n_ring - n_damper, before = w->n_ring; /* first columns of y */
    const double *own = w->own_side, *next = w->next_side;
    double *of_damper = S + (size_t)damper * (size_t)n_outer;
    double *of_before = S + (size_t)before * (size_t)n_outer;
    memset(S, 0, sizeof(double) * (size_t)n_outer * (size_t)n_outer);
    extract(w, own, kept, n_blade, kept, n_blade, S, n_outer);
    extract(w, own, kept, n_blade, n_blade, sector_size, S + damper, n_outer);
    extract(w, next, kept, n_blade, n_blade, sector_size, S + before, n_outer);
    extract(w, own, n_blade, sector_size, kept, n_blade, of_damper, n_outer);
    extract(w, own, n_blade, sector_size, n_blade, sector_size, of_damper + damper, n_outer);
    extract(w, next, n_blade, sector_size, kept, n_blade, of_before, n_outer);
    extract(w, next, n_blade, sector_size, n_blade, sector_size, of_before + before, n_outer);
}

/* Extract E_n, and its couplings to the outer unknowns: columns (n_inner, n_outer) and couple
 * (n_outer, n_inner). */
static void extract_inner(bd_ring *w, double *inner, double *columns, double *couple) {
    const int n_blade = w->input.n_blade, sector_size = w->sector_size;
    const int kept = n_blade - w->input.n_kept; /* first coordinate of the ring */
    const int n_inner = w->n_inner;
    const int n_damper = w->n_damper_unknown, n_outer = w->n_ring + n_damper;
    const int damper = w->n_ring - n_damper, before = w->n_ring; /* first columns of y */
    const double *own = w->own_side, *next = w->next_side;
    extract(w, own, 0, kept, 0, kept, inner, n_inner);
    extract(w, own, 0, kept, kept, n_blade, columns, n_outer);
    extract(w, own, 0, kept, n_blade, sector_size, columns + damper, n_outer);
    extract(w, next, 0, kept, n_blade, sector_size, columns + before, n_outer);
    double *of_damper = couple + (size_t)damper * (size_t)n_inner;
    double *of_before = couple + (size_t)before * (size_t)n_inner;
    extract(w, own, kept, n_blade, 0, kept, couple, n_inner);
    extract(w, own, n_blade, sector_size, 0, kept, of_damper, n_inner);
    extract(w, next, n_blade, sector_size, 0, kept, of_before, n_inner);
}

/* Add the matrix S of the outer unknowns of sector n to the blocks of the ring. */
static void add_outer(bd_ring *w, int n, const double *S) {
    const int N = w->input.n_sector, before = (n + N - 1) % N;
    const size_t n_ring = (size_t)w->n_ring, block = n_ring * n_ring;
    const size_t n_damper = (size_t)w->n_damper_unknown, n_outer = n_ring + n_damper;
    const size_t damper = n_ring - n_damper; /* first row and column of y in a block */
    double *D = w->diagonal + (size_t)n * block, *D_before = w->diagonal + (size_t)before * block;
    double *L = w->lower + (size_t)n * block, *U_before = w->upper + (size_t)before * block;

    /* rows of the sector: its own unknowns, then the damper before it */
    for (size_t i = 0; i < n_ring; ++i) {
        const double *row = S + i * n_outer;
        for (size_t j = 0; j < n_ring; ++j) D[i * n_ring + j] += row[j];
        for (size_t j = 0; j < n_damper; ++j) L[i * n_ring + damper + j] += row[n_ring + j];
    }
    /* rows of the damper before it */
    for (size_t i = 0; i < n_damper; ++i) {
        const double *row = S + (n_ring + i) * n_outer;
        const size_t first = (damper + i) * n_ring;
        for (size_t j = 0; j < n_ring; ++j) U_before[first + j] += row[j];
        for (size_t j = 0; j < n_damper; ++j) D_before[first + damper + j] += row[n_ring + j];
    }
}

/* Eliminate the inner blade coordinates of sector n and add the remainder to the blocks of the
 * ring. */
static int eliminate_blade(bd_ring *w, int n) {
    const int n_inner = w->n_inner, n_outer = w->n_ring + w->n_damper_unknown;
    const size_t first_row = (size_t)n * (size_t)n_inner;
    double *inverse = w->inverse + first_row * (size_t)n_inner;
    double *back = w->inner_to_outer + first_row * (size_t)n_outer;
    double *couple = w->outer_to_inner + first_row * (size_t)n_outer;
    double *S = w->outer;
    extract_inner(w, inverse, w->columns, couple);
    extract_outer(w, S);
    if (n_inner > 0) {
        if (!invert(w, inverse, n_inner)) return 0;
        multiply(w, n_inner, n_outer, n_inner, inverse, n_inner, w->columns, n_outer, back,
                 n_outer);
        add_multiple(w, n_outer, n_outer, n_inner, -1.0, couple, n_inner, back, n_outer, S,
                     n_outer);
    }
    add_outer(w, n, S);
    return 1;
}

/* ---- the ring ---- */

/* Add the couplings of the disk between neighbours. */
static void add_disk(bd_ring *w, const double *neighbour) {
    const size_t k = (size_t)w->input.n_kept, s = (size_t)w->n_ring, ss = s * s;
    for (size_t n = 0; n < (size_t)w->input.n_sector; ++n) {
        for (int c = 0; c < w->input.n_coef; ++c) {
            if (!w->input.active[c]) continue;
            const double *K = neighbour + (size_t)((c + 1) / 2) * k * k;
            const size_t at = n * ss + (size_t)c * k * s + (size_t)c * k;
            double *L = w->lower + at, *U = w->upper + at;
            for (size_t i = 0; i < k; ++i) {
                for (size_t j = 0; j < k; ++j) {
                    L[i * s + j] += K[i * k + j];
                    U[i * s + j] += K[j * k + i];
                }
            }
        }
    }
}

static int eliminate_ring(bd_ring *w) {
    const int N = w->input.n_sector, s = w->n_ring;
    const size_t ss = (size_t)s * (size_t)s;
    double *D_last = w->diagonal + (size_t)(N - 1) * ss;
    memcpy(w->last_row, w->upper + (size_t)(N - 1) * ss, sizeof(double) * ss);
    double *W = w->lower; /* W of sector 0 is its coupling to the last sector */
    for (int n = 0; n < N - 1; ++n) {
        const size_t at = (size_t)n * ss;
        double *D = w->diagonal + at, *V = w->last_row + at, *U = w->upper + at;
        const double *L_next = w->lower + at + ss;
        double *D_inverse_W = w->last_factor + at, *D_inverse_U = w->next_factor + at;
        const int is_neighbour = n == N - 2; /* L and U of the last sector are also W and V */
        if (is_neighbour) {
            for (size_t i = 0; i < ss; ++i) V[i] += L_next[i];
            for (size_t i = 0; i < ss; ++i) W[i] += U[i];
        }
        if (!invert(w, D, s)) return 0;
        multiply(w, s, s, s, D, s, W, s, D_inverse_W, s);
        add_multiple(w, s, s, s, -1.0, V, s, D_inverse_W, s, D_last, s);
        if (is_neighbour) break;

        multiply(w, s, s, s, D, s, U, s, D_inverse_U, s);
        add_multiple(w, s, s, s, -1.0, L_next, s, D_inverse_U, s, D + ss, s);
        memset(V + ss, 0, sizeof(double) * ss);
        add_multiple(w, s, s, s, -1.0, V, s, D_inverse_U, s, V + ss, s);
        W = U; /* U is not needed any more */
        memset(W, 0, sizeof(double) * ss);
        add_multiple(w, s, s, s, -1.0, L_next, s, D_inverse_W, s, W, s);
    }
    return invert(w, D_last, s);
}

bd_status bd_ring_factor(bd_ring *w, const bd_ring_matrix *m) {
    const int N = w->input.n_sector;
    const size_t s = (size_t)w->n_ring, all = sizeof(double) * (size_t)N * s * s;
    w->sign = 1;
    memset(w->diagonal, 0, all);
    memset(w->lower, 0, all);
    memset(w->upper, 0, all);
    for (int n = 0; n < N; ++n) {
        const int before = (n + N - 1) % N;
        contact_matrix(w, 0, m, n, w->own_side);
        contact_matrix(w, 1, m, before, w->next_side);
        add_blade(w);
        add_linear(w, m, n);
        if (!eliminate_blade(w, n)) return BD_SINGULAR;
    }
    add_disk(w, m->neighbour);
    return eliminate_ring(w) ? BD_OK : BD_SINGULAR;
}

/* ---- solution ---- */

/* y += alpha A x with A (m, n), or alpha A^T x. */
static void add_product(const bd_ring *w, int transposed, int m, int n, double alpha,
                        const double *A, const double *x, double *y) {
    double *t = w->product;
    if (transposed) {
        for (int i = 0; i < m; ++i) t[i] = alpha * x[i];
        w->kernel->multiply_transposed((size_t)m, (size_t)n, A, t, y);
        return;
    }
    w->kernel->multiply((size_t)m, (size_t)n, A, x, t);
    for (int i = 0; i < m; ++i) y[i] += alpha * t[i];
}

/* Multiply x (s) by the inverse on the diagonal. */
static void apply_inverse(const bd_ring *w, int transposed, int n, double *x) {
    const size_t s = (size_t)w->n_ring;
    const double *inverse = w->diagonal + (size_t)n * s * s;
    double *t = w->work;
    memset(t, 0, sizeof(double) * s);
    add_product(w, transposed, w->n_ring, w->n_ring, 1.0, inverse, x, t);
    memcpy(x, t, sizeof(double) * s);
}

/* y -= A x, or A^T x, for a block of sector n. */
static void subtract_block(const bd_ring *w, int transposed, const double *blocks, int n,
                           const double *x, double *y) {
    const int s = w->n_ring;
    const double *A = blocks + (size_t)n * (size_t)s * (size_t)s;
    add_product(w, transposed, s, s, -1.0, A, x, y);
}

/* Solve the ring for the right-hand side b (N, s) in place. */
static void solve_ring(bd_ring *w, double *b) {
    const int N = w->input.n_sector, last = N - 1, s = w->n_ring;
    double *end = b + (size_t)last * (size_t)s;
    for (int n = 0; n < N; ++n) {
        double *here = b + (size_t)n * (size_t)s;
        apply_inverse(w, 0, n, here);
        if (n + 1 < last) subtract_block(w, 0, w->lower, n + 1, here, here + s);
        if (n < last) subtract_block(w, 0, w->last_row, n, here, end);
    }
    for (int n = last - 1; n >= 0; --n) {
        double *here = b + (size_t)n * (size_t)s;
        subtract_block(w, 0, w->last_factor, n, end, here);
        if (n + 1 < last) subtract_block(w, 0, w->next_factor, n, here + s, here);
    }
}

/* The same for the transposed matrix: its factors in reverse order. */
static void solve_ring_transposed(bd_ring *w, double *b) {
    const int N = w->input.n_sector, last = N - 1, s = w->n_ring;
    double *end = b + (size_t)last * (size_t)s;
    for (int n = 0; n < last; ++n) {
        double *here = b + (size_t)n * (size_t)s;
        subtract_block(w, 1, w->last_factor, n, here, end);
        if (n + 1 < last) subtract_block(w, 1, w->next_factor, n, here, here + s);
    }
    for (int n = last; n >= 0; --n) {
        double *here = b + (size_t)n * (size_t)s;
        if (n + 1 < last) subtract_block(w, 1, w->lower, n + 1, here + s, here);
        if (n < last) subtract_block(w, 1, w->last_row, n, end, here);
        apply_inverse(w, 1, n, here);
    }
}

/* Copy the inner right-hand side of a sector to `inner` and add the remainder to `ring`. */
static void split_sector(const bd_ring *w, const double *from, double *inner, double *ring) {
    const int n_kept = w->input.n_kept, n_inner = w->input.n_blade - n_kept;
    const int n_damper = w->input.n_damper;
    double *damper = ring + w->n_ring - w->n_damper_unknown;
    for (int c = 0; c < w->input.n_coef; ++c, from += w->sector_size) {
        const double *kept = from + n_inner, *y = kept + n_kept;
        memcpy(inner + c * n_inner, from, sizeof(double) * (size_t)n_inner);
        for (int i = 0; i < n_kept; ++i) ring[c * n_kept + i] += kept[i];
        for (int i = 0; i < n_damper; ++i) damper[c * n_damper + i] += y[i];
    }
}

/* Copy the inner coordinates and the ring coordinates to the sector. */
static void join_sector(const bd_ring *w, const double *inner, const double *ring, double *to) {
    const int n_kept = w->input.n_kept, n_inner = w->input.n_blade - n_kept;
    const int n_damper = w->input.n_damper;
    const double *damper = ring + w->n_ring - w->n_damper_unknown;
    for (int c = 0; c < w->input.n_coef; ++c, to += w->sector_size) {
        double *kept = to + n_inner, *y = kept + n_kept;
        memcpy(to, inner + c * n_inner, sizeof(double) * (size_t)n_inner);
        memcpy(kept, ring + c * n_kept, sizeof(double) * (size_t)n_kept);
        memcpy(y, damper + c * n_damper, sizeof(double) * (size_t)n_damper);
    }
}

/* Eliminate the inner unknowns from the right-hand side r of sector n. Their part remains in
 * `inner`. `here` and `before` are the right-hand sides of the ring for this sector and for the
 * damper before it. */
static void reduce_sector(bd_ring *w, int transposed, int n, const double *r, double *inner,
                          double *here, double *before) {
    const int n_inner = w->n_inner, n_ring = w->n_ring, n_damper = w->n_damper_unknown;
    const int n_outer = n_ring + n_damper;
    const size_t first_row = (size_t)n * (size_t)n_inner;
    double *work = w->work;
    if (transposed) {
        const double *back = w->inner_to_outer + first_row * (size_t)n_outer;
        split_sector(w, r, inner, here);
        memset(work, 0, sizeof(double) * (size_t)n_outer);
        add_product(w, 1, n_inner, n_outer, -1.0, back, inner, work);
        for (int i = 0; i < n_ring; ++i) here[i] += work[i];
        for (int i = 0; i < n_damper; ++i) before[i] += work[n_ring + i];
        return;
    }
    const double *inverse = w->inverse + first_row * (size_t)n_inner;
    const double *couple = w->outer_to_inner + first_row * (size_t)n_outer;
    const double *couple_before = couple + (size_t)n_ring * (size_t)n_inner;
    split_sector(w, r, work, here);
    add_product(w, 0, n_inner, n_inner, 1.0, inverse, work, inner);
    add_product(w, 0, n_ring, n_inner, -1.0, couple, inner, here);
    add_product(w, 0, n_damper, n_inner, -1.0, couple_before, inner, before);
}

/* Inner unknowns of sector n from the solution of the ring. */
static void solve_inner(bd_ring *w, int transposed, int n, const double *here, const double *before,
                        double *inner) {
    const int n_inner = w->n_inner, n_ring = w->n_ring, n_damper = w->n_damper_unknown;
    const int n_outer = n_ring + n_damper;
    const size_t first_row = (size_t)n * (size_t)n_inner;
    double *outer = w->work; /* (n_outer) */
    memcpy(outer, here, sizeof(double) * (size_t)n_ring);
    memcpy(outer + n_ring, before, sizeof(double) * (size_t)n_damper);
    if (!transposed) {
        const double *back = w->inner_to_outer + first_row * (size_t)n_outer;
        add_product(w, 0, n_inner, n_outer, -1.0, back, outer, inner);
        return;
    }
    const double *couple = w->outer_to_inner + first_row * (size_t)n_outer;
    const double *inverse = w->inverse + first_row * (size_t)n_inner;
    double *right_side = outer + n_outer;
    add_product(w, 1, n_outer, n_inner, -1.0, couple, outer, inner);
    memcpy(right_side, inner, sizeof(double) * (size_t)n_inner);
    memset(inner, 0, sizeof(double) * (size_t)n_inner);
    add_product(w, 1, n_inner, n_inner, 1.0, inverse, right_side, inner);
}

void bd_ring_solve(bd_ring *w, int transposed, const double *r, double *x) {
    const size_t N = (size_t)w->input.n_sector;
    const size_t n_inner = (size_t)w->n_inner, n_ring = (size_t)w->n_ring;
    const size_t damper = n_ring - (size_t)w->n_damper_unknown; /* first damper unknown */
    const size_t sector = (size_t)(w->input.n_coef * w->sector_size);
    double *inner = w->outer;           /* (N, n_inner) */
    double *ring = inner + N * n_inner; /* (N, n_ring) */
    memset(inner, 0, sizeof(double) * N * n_inner);
    memset(ring, 0, sizeof(double) * N * n_ring);
    for (size_t n = 0; n < N; ++n) {
        const size_t before = (n + N - 1) % N;
        reduce_sector(w, transposed, (int)n, r + n * sector, inner + n * n_inner, ring + n * n_ring,
                      ring + before * n_ring + damper);
    }
    if (transposed)
        solve_ring_transposed(w, ring);
    else
        solve_ring(w, ring);
    for (size_t n = 0; n < N; ++n) {
        const size_t before = (n + N - 1) % N;
        solve_inner(w, transposed, (int)n, ring + n * n_ring, ring + before * n_ring + damper,
                    inner + n * n_inner);
        join_sector(w, inner + n * n_inner, ring + n * n_ring, x + n * sector);
    }
}
