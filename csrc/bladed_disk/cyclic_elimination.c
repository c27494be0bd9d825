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
 * Its elimination is the block LU factorisation of a cyclic block-tridiagonal matrix with the last
 * sector as border. W (right column) couples a sector to the last sector, and V (bottom row) the
 * last sector to it. Both fill in from sector to sector:
 *
 *     [ D_0  U_0              W_0    ]      D_(n+1) -= L_(n+1) D_n^-1 U_n,
 *     [ L_1  D_1  U_1         W_1    ]      W_(n+1) = -L_(n+1) D_n^-1 W_n,
 *     [      L_2  D_2  ...    ...    ]      D_last  -= V_n D_n^-1 W_n,
 *     [ V_0  V_1  ...         D_last ]      V_(n+1) = -V_n D_n^-1 U_n.
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

/* Sort the points into two groups: 0 on the blade of the sector, 1 on the next blade. Copy the rows
 * (3, sector_size) of each point in this order to w->rows, and for each group also the transposed
 * matrix (sector_size, 3 points of the group) to w->rows_transposed. */
static void sort_points(bd_ring *w) {
    const bd_ring_input *in = &w->input;
    const int ns = w->sector_size, rows_size = BD_N_COMPONENT * ns;
    int k = 0; /* place in the new order */
    for (int group = 0; group < 2; ++group) {
        const int first = group ? w->n_group[0] : 0;
        const int n_row = BD_N_COMPONENT * w->n_group[group];
        double *transposed = w->rows_transposed + first * rows_size; /* (ns, n_row) */
        for (int p = 0; p < in->n_point; ++p) {
            const int group_of_point = in->on_next[p] != 0;
            if (group_of_point != group) continue;
            const double *rows = in->rows + p * rows_size;
            const int first_row = BD_N_COMPONENT * (k - first);
            memcpy(w->rows + k * rows_size, rows, sizeof(double) * (size_t)rows_size);
            for (int a = 0; a < BD_N_COMPONENT; ++a)
                for (int j = 0; j < ns; ++j)
                    transposed[j * n_row + first_row + a] = rows[a * ns + j];
            w->point[k] = p;
            ++k;
        }
    }
}

/* Copy sizes and rows of the input, and take all arrays from one piece of memory. */
bd_status bd_ring_create(bd_ring *w, const bd_ring_input *in) {
    memset(w, 0, sizeof *w);
    const int nc = in->n_coef;
    w->input = *in;
    for (int p = 0; p < in->n_point; ++p) {
        const int group = in->on_next[p] != 0; /* 0: on the blade of the sector, 1: on the next */
        ++w->n_group[group];
    }
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
    const size_t most = (inner > ring ? inner : ring) + 1; /* size of the largest block */
    const struct {
        double **to;
        size_t n; /* doubles */
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

/* Derivative of one coefficient of a force component with respect to the sector's coordinates,
 *
 *     z (n_coef, sector_size),   z_d = sum_s block_s[d] row_s,
 *
 * if the force depends on three components s of motion: block_s (n_coef) is its row of the tangent
 * block for coefficient d of component s, and row_s (sector_size) maps the coordinates to this
 * component. */
static void fill_row(const bd_ring *w, const double *const block[3], const double *const row[3],
                     double *restrict z) {
    for (int d = 0; d < w->input.n_coef; ++d, z += w->sector_size) {
        const double a = block[0][d], b = block[1][d], c = block[2][d];
        for (int j = 0; j < w->sector_size; ++j)
            z[j] = a * row[0][j] + b * row[1][j] + c * row[2][j];
    }
}

/* Pick the points of a group (0: on the blade of the sector, 1: on the next blade) whose tangents
 * have the wanted form, and copy their rows (3, sector_size) to w->picked_rows; return their
 * number. */
static int pick_points(bd_ring *w, int group, const unsigned char *form, bd_block wanted) {
    const int rows_size = BD_N_COMPONENT * w->sector_size;
    const int first = group == 0 ? 0 : w->n_group[0], end = first + w->n_group[group];
    int n = 0;
    for (int k = first; k < end; ++k) {
        const int p = w->point[k];
        if (form[p] != wanted) continue;
        memcpy(w->picked_rows + n * rows_size, w->rows + k * rows_size,
               sizeof(double) * (size_t)rows_size);
        w->picked[n] = p;
        ++n;
    }
    return n;
}

/* Add the stiffness of the n picked points with full tangents to the matrix of a sector,
 *
 *     out += sum over points of R^T B R,    out (n_coef, sector_size, n_coef, sector_size),
 *
 * with the rows R (3, sector_size) of a point for u1, u2 and v, the same for all coefficients, and
 * its tangent blocks B (n_coef, n_coef) for pairs of components. For the rows of out that belong to
 * coefficient c, Z = B R (3 n, n_coef sector_size) is formed from row c of all blocks, and then
 * out_c += R^T Z in one product. */
static void add_full_tangents(bd_ring *w, int n, const double *tangent, double *out) {
    const int nc = w->input.n_coef, ns = w->sector_size, wide = nc * ns;
    const size_t block_size = (size_t)(nc * nc), point_size = BD_N_BLOCK * block_size;
    for (int c = 0; c < nc; ++c) {
        for (int p = 0; p < n; ++p) {
            const double *blocks = tangent + point_size * (size_t)w->picked[p];
            const double *row[BD_N_BLOCK]; /* row c of each block */
            for (int k = 0; k < BD_N_BLOCK; ++k)
                row[k] = blocks + (size_t)k * block_size + (size_t)(c * nc);
            const double *u1 = w->picked_rows + BD_N_COMPONENT * p * ns;
            const double *u2 = u1 + ns, *v = u2 + ns;
            double *T1 = w->Z + (size_t)(BD_N_COMPONENT * p) * (size_t)wide;
            double *T2 = T1 + wide, *N = T2 + wide;

            const double *of_T1[3] = {row[BD_DT1_DU1], row[BD_DT1_DV], row[BD_DT1_DU2]};
            fill_row(w, of_T1, (const double *[]){u1, v, u2}, T1);
            const double *of_T2[3] = {row[BD_DT2_DU2], row[BD_DT2_DV], row[BD_DT2_DU1]};
            fill_row(w, of_T2, (const double *[]){u2, v, u1}, T2);
            for (int d = 0; d < nc; ++d) {
                const double dN = row[BD_DN_DV][d];
                for (int j = 0; j < ns; ++j) N[d * ns + j] = dN * v[j];
            }
        }
        double *out_c = out + (size_t)(c * ns) * (size_t)wide;
        w->kernel->product((size_t)ns, (size_t)wide, (size_t)(BD_N_COMPONENT * n), w->picked_rows,
                           w->Z, (size_t)wide, out_c, (size_t)wide);
    }
}

/* Add the stiffness of the n picked points whose tangents are springs: each block is k I with
 * k = dT1/du1, dT2/du2 or dN/dv, and blocks between different components are zero. No coefficients
 * are coupled, so only the diagonal blocks (c, c) of the matrix of a sector change,
 *
 *     out_cc += R^T (k R),    out (n_coef, sector_size, n_coef, sector_size),
 *
 * with the rows R (3 n, sector_size) of all points and components, and Z = k R. */
static void add_linear_tangents(bd_ring *w, int n, const double *tangent, double *out) {
    static const int SPRING_OF_COMPONENT[BD_N_COMPONENT] = {BD_DT1_DU1, BD_DT2_DU2, BD_DN_DV};
    const int nc = w->input.n_coef, ns = w->sector_size, wide = nc * ns;
    const int n_row = BD_N_COMPONENT * n;
    const size_t block_size = (size_t)(nc * nc), point_size = BD_N_BLOCK * block_size;
    const double *rows = w->picked_rows;
    for (int c = 0; c < nc; ++c) {
        const size_t diagonal = (size_t)(c * nc + c); /* entry (c, c) of a block */
        for (int i = 0; i < n_row; ++i) {
            const int point = w->picked[i / BD_N_COMPONENT], component = i % BD_N_COMPONENT;
            const size_t block = (size_t)SPRING_OF_COMPONENT[component];
            const double *blocks = tangent + point_size * (size_t)point;
            const double stiffness = blocks[block * block_size + diagonal];
            for (int j = 0; j < ns; ++j) w->Z[i * ns + j] = stiffness * rows[i * ns + j];
        }
        double *out_cc = out + (size_t)(c * ns) * (size_t)wide + c * ns;
        w->kernel->product((size_t)ns, (size_t)ns, (size_t)n_row, rows, w->Z, (size_t)ns, out_cc,
                           (size_t)wide);
    }
}

/* Stiffness of the contact points of sector k in the coordinates of one blade and the damper,
 * out (n_coef, sector_size, n_coef, sector_size), for the points of a group (0: on the blade of the
 * sector, 1: on the next blade). */
static void contact_matrix(bd_ring *w, int group, const bd_ring_matrix *m, int k, double *out) {
    const size_t nc = (size_t)w->input.n_coef, wide = nc * (size_t)w->sector_size;
    const size_t first_point = (size_t)k * (size_t)w->input.n_point;
    const double *tangent = m->tangent + BD_N_BLOCK * nc * nc * first_point;
    const unsigned char *form = m->form + first_point;
    memset(out, 0, sizeof(double) * wide * wide);
    const int n_full = pick_points(w, group, form, BD_BLOCK_FULL);
    add_full_tangents(w, n_full, tangent, out);
    const int n_linear = pick_points(w, group, form, BD_BLOCK_LINEAR);
    add_linear_tangents(w, n_linear, tangent, out);
}

/* to (rows of length ld) += factor A, for a matrix A (n, n). */
static void add_matrix(size_t n, double factor, const double *A, double *to, size_t ld) {
    for (size_t i = 0; i < n; ++i)
        for (size_t j = 0; j < n; ++j) to[i * ld + j] += factor * A[i * n + j];
}

/* Add the linear parts of sector n to w->own_side (n_coef, sector_size, n_coef, sector_size), block
 * row c and block columns c and c', the other coefficient of its harmonic:
 *
 *     (c, c)     blade: blade + common;   damper: stiffness minus inertia, springs on its mean
 *     (c, c')    +C for a cosine c, -C for a sine c,   C = damping times frequency.
 *
 * Rows of inactive coefficients, and of the damper in a sector without one, are unit rows. */
static void add_linear(bd_ring *w, const bd_ring_matrix *m, int n) {
    const bd_ring_input *in = &w->input;
    const size_t nb = (size_t)in->n_blade, nd = (size_t)in->n_damper, ns = (size_t)w->sector_size;
    const size_t wide = (size_t)in->n_coef * ns, blade_size = nb * nb;
    const double *blade = m->blade + (size_t)n * blade_size;
    const double *springs = m->springs + (size_t)n * nd;
    const int has_damper = !in->pinned[n];
    for (int c = 0; c < in->n_coef; ++c) {
        const size_t l = (size_t)(c + 1) / 2; /* harmonic of the coefficient */
        double *block = w->own_side + (size_t)c * ns * wide + (size_t)c * ns;
        if (!in->active[c]) {
            for (size_t i = 0; i < ns; ++i) block[i * wide + i] = 1.0;
            continue;
        }
        const double *K = m->common + l * blade_size, *C = m->damping + l * blade_size;
        const double *damper_stiffness =
            m->damper + 2 * (l * (size_t)in->n_sector + (size_t)n) * nd;
        const double *damper_damping = damper_stiffness + nd;
        for (size_t i = 0; i < nb; ++i)
            for (size_t j = 0; j < nb; ++j)
                block[i * wide + j] += blade[i * nb + j] + K[i * nb + j];
        for (size_t i = 0; i < nd; ++i) {
            double *diagonal = block + (nb + i) * wide + nb + i;
            *diagonal += damper_stiffness[i] + (c == 0 ? springs[i] : 0.0);
            if (!has_damper) *diagonal = 1.0;
        }
        if (c == 0) continue;

        /* the sine of a harmonic follows its cosine */
        const int is_cosine = c % 2;
        const double sign = is_cosine ? 1.0 : -1.0;
        double *other_block = is_cosine ? block + ns : block - ns;
        add_matrix(nb, sign, C, other_block, wide);
        if (!has_damper) continue;
        for (size_t i = 0; i < nd; ++i)
            other_block[(nb + i) * wide + nb + i] += sign * damper_damping[i];
    }
}

/* Copy the entries for the coordinates [i0, i1) and [j0, j1) of a sector matrix (n_coef,
 * sector_size, n_coef, sector_size), for all pairs of coefficients, to `to` (n_coef, n_i, n_coef,
 * n_j) with rows of length ld. */
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

/* Add the blade part of w->next_side to w->own_side, both (n_coef, sector_size, n_coef,
 * sector_size): the damper of the sector before acts on this blade by the points of the group on
 * the next blade. The blade has the first n_blade coordinates of a sector. */
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

/* Extract the matrix S (n_outer, n_outer) of the outer unknowns of sector n: ring coordinates a_n
 * of the blade, dampers y_n and y_(n-1). own_side contains the blade and the damper y_n, next_side
 * the same blade and the damper y_(n-1). No entry couples the dampers:
 *
 *         [ own aa   own ay   next ay ]
 *     S = [ own ya   own yy   0       ]
 *         [ next ya  0        next yy ]. */
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

/* Extract the matrix E_n (n_inner, n_inner) of the inner blade coordinates of sector n and its
 * couplings to the outer unknowns (ring coordinates a_n of the blade, dampers y_n and y_(n-1)):
 * columns (n_inner, n_outer) and couple (n_outer, n_inner). next_side contains the couplings to
 * y_(n-1), own_side the others. */
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

/* Add the matrix S (n_outer, n_outer) of the outer unknowns a_n, y_n and y_(n-1) of sector n to the
 * blocks of the ring. The ring has the unknowns x_n = [a_n, y_n], so y_(n-1) belongs to x_(n-1). S
 * changes D_n and D_(n-1), and by couplings between x_n and y_(n-1) also L_n and U_(n-1). */
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

/* Eliminate the inner blade coordinates of sector n, and add the Schur complement
 *
 *     S - couple E^-1 columns,    E (n_inner, n_inner), columns (n_inner, n_outer),
 *                                 couple (n_outer, n_inner), S (n_outer, n_outer)
 *
 * to the blocks of the ring. The solution also needs E^-1, E^-1 columns and couple: each sector has
 * its own. Return 0 if E is singular. */
static int eliminate_blade(bd_ring *w, int n) {
    const int n_inner = w->n_inner, n_outer = w->n_ring + w->n_damper_unknown;
    const size_t first_row = (size_t)n * (size_t)n_inner;
    double *inverse = w->inverse + first_row * (size_t)n_inner;
    double *inverse_columns = w->inner_to_outer + first_row * (size_t)n_outer;
    double *couple = w->outer_to_inner + first_row * (size_t)n_outer;
    double *S = w->outer;
    extract_inner(w, inverse, w->columns, couple);
    extract_outer(w, S);
    if (n_inner > 0) {
        if (!invert(w, inverse, n_inner)) return 0;
        multiply(w, n_inner, n_outer, n_inner, inverse, n_inner, w->columns, n_outer,
                 inverse_columns, n_outer);
        add_multiple(w, n_outer, n_outer, n_inner, -1.0, couple, n_inner, inverse_columns, n_outer,
                     S, n_outer);
    }
    add_outer(w, n, S);
    return 1;
}

/* ---- the ring ---- */

/* Add the coupling K_l (n_kept, n_kept) of a sector to the previous sector by the disk to L_n, and
 * K_l^T to U_n, for every coefficient of harmonic l. The ring coordinates of the blade are the
 * first unknowns of a block, coefficient after coefficient. */
static void add_disk(bd_ring *w, const double *neighbour) {
    const size_t n_kept = (size_t)w->input.n_kept, n_ring = (size_t)w->n_ring;
    for (size_t n = 0; n < (size_t)w->input.n_sector; ++n) {
        for (int c = 0; c < w->input.n_coef; ++c) {
            if (!w->input.active[c]) continue;
            const size_t harmonic = (size_t)(c + 1) / 2, first = (size_t)c * n_kept;
            const double *K = neighbour + harmonic * n_kept * n_kept;
            const size_t corner = n * n_ring * n_ring + first * n_ring + first;
            double *L = w->lower + corner, *U = w->upper + corner;
            for (size_t i = 0; i < n_kept; ++i) {
                for (size_t j = 0; j < n_kept; ++j) {
                    L[i * n_ring + j] += K[i * n_kept + j];
                    U[i * n_ring + j] += K[j * n_kept + i];
                }
            }
        }
    }
}

/* Block LU factorisation of the ring (cyclic block-tridiagonal, blocks (s, s)): eliminate sectors 0
 * to N - 2 one after the other, with the last sector as border. W_n couples sector n to the last
 * sector (column `last`), V_n the last sector to sector n (row `last`); W_0 = L_0 and V_0 = U_last.
 * Sector n changes
 *
 *     D_(n+1) -= L_(n+1) D_n^-1 U_n,     W_(n+1) = -L_(n+1) D_n^-1 W_n,
 *     D_last  -= V_n D_n^-1 W_n,         V_(n+1) = -V_n D_n^-1 U_n.
 *
 * Sector N - 2 is also a neighbour of the last sector: L_last adds to V, and U_(N-2) to W. D_n^-1
 * replaces D_n. The solution also needs D_n^-1 U_n, D_n^-1 W_n and V_n. W_(n+1) overwrites U_n.
 * Return 0 if a block is singular. */
static int eliminate_ring(bd_ring *w) {
    const int N = w->input.n_sector, s = w->n_ring;
    const size_t ss = (size_t)s * (size_t)s;
    double *D_last = w->diagonal + (size_t)(N - 1) * ss;
    memcpy(w->last_row, w->upper + (size_t)(N - 1) * ss, sizeof(double) * ss);
    double *W = w->lower; /* W_0 = L_0 */
    for (int n = 0; n < N - 1; ++n) {
        const size_t at = (size_t)n * ss;
        double *D = w->diagonal + at, *V = w->last_row + at, *U = w->upper + at;
        double *D_next = D + ss, *V_next = V + ss;
        const double *L_next = w->lower + at + ss;
        double *D_inverse_W = w->last_factor + at, *D_inverse_U = w->next_factor + at;
        const int precedes_last = n == N - 2;
        if (precedes_last) {
            for (size_t i = 0; i < ss; ++i) V[i] += L_next[i];
            for (size_t i = 0; i < ss; ++i) W[i] += U[i];
        }
        if (!invert(w, D, s)) return 0;
        multiply(w, s, s, s, D, s, W, s, D_inverse_W, s);
        add_multiple(w, s, s, s, -1.0, V, s, D_inverse_W, s, D_last, s);
        if (precedes_last) break;

        multiply(w, s, s, s, D, s, U, s, D_inverse_U, s);
        add_multiple(w, s, s, s, -1.0, L_next, s, D_inverse_U, s, D_next, s);
        memset(V_next, 0, sizeof(double) * ss);
        add_multiple(w, s, s, s, -1.0, V, s, D_inverse_U, s, V_next, s);
        double *W_next = U; /* U is not needed any more */
        memset(W_next, 0, sizeof(double) * ss);
        add_multiple(w, s, s, s, -1.0, L_next, s, D_inverse_W, s, W_next, s);
        W = W_next;
    }
    return invert(w, D_last, s);
}

/* Factorise the matrix of all sectors: eliminate the inner blade coordinates sector by sector,
 * which leaves blocks L, D and U of the ring, and then the ring. The matrix of a blade consists of
 * contact points of this sector (own_side), contact points of the sector before (next_side), and
 * linear parts. */
bd_status bd_ring_factor(bd_ring *w, const bd_ring_matrix *m) {
    enum { ON_OWN_BLADE = 0, ON_NEXT_BLADE = 1 };
    const int N = w->input.n_sector;
    const size_t s = (size_t)w->n_ring, all = sizeof(double) * (size_t)N * s * s;
    w->sign = 1;
    memset(w->diagonal, 0, all);
    memset(w->lower, 0, all);
    memset(w->upper, 0, all);
    for (int n = 0; n < N; ++n) {
        const int before = (n + N - 1) % N;
        contact_matrix(w, ON_OWN_BLADE, m, n, w->own_side);
        contact_matrix(w, ON_NEXT_BLADE, m, before, w->next_side);
        add_blade(w);
        add_linear(w, m, n);
        if (!eliminate_blade(w, n)) return BD_SINGULAR;
    }
    add_disk(w, m->neighbour);
    return eliminate_ring(w) ? BD_OK : BD_SINGULAR;
}

/* ---- solution ---- */

/* y (m) += alpha A x (n) with A (m, n), or if transposed y (n) += alpha A^T x (m). */
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

/* x = D_n^-1 x or D_n^-T x for the ring unknowns x (s) of sector n; the factorisation has replaced
 * D_n by its inverse. */
static void apply_inverse(const bd_ring *w, int transposed, int n, double *x) {
    const size_t s = (size_t)w->n_ring;
    const double *inverse = w->diagonal + (size_t)n * s * s;
    double *t = w->work;
    memset(t, 0, sizeof(double) * s);
    add_product(w, transposed, w->n_ring, w->n_ring, 1.0, inverse, x, t);
    memcpy(x, t, sizeof(double) * s);
}

/* y -= A_n x or A_n^T x with the block A_n (s, s) of sector n among the given blocks. */
static void subtract_block(const bd_ring *w, int transposed, const double *blocks, int n,
                           const double *x, double *y) {
    const int s = w->n_ring;
    const double *A = blocks + (size_t)n * (size_t)s * (size_t)s;
    add_product(w, transposed, s, s, -1.0, A, x, y);
}

/* Solve the ring equations in place: b (N, s) is the right-hand side, then the solution x. The ring
 * is cyclic block-tridiagonal, L_n x_(n-1) + D_n x_n + U_n x_(n+1) = b_n. Its block LU factors have
 * the last sector as border: row `last` of the lower factor is filled by V_n, column `last` of the
 * upper one by W_n (eliminate_ring),
 *
 *     forward     y_n = D_n^-1 b_n,   b_(n+1) -= L_(n+1) y_n,   b_last -= V_n y_n
 *     backward    x_last = y_last,    x_n = y_n - D_n^-1 W_n x_last - D_n^-1 U_n x_(n+1).
 *
 * The couplings between sectors N - 2 and `last` are part of V and W. */
static void solve_ring(bd_ring *w, double *b) {
    const int N = w->input.n_sector, last = N - 1, s = w->n_ring;
    double *b_last = b + (size_t)last * (size_t)s;
    /* forward elimination: y replaces b */
    for (int n = 0; n < N; ++n) {
        double *b_n = b + (size_t)n * (size_t)s, *b_next = b_n + s;
        apply_inverse(w, 0, n, b_n);
        if (n + 1 < last) subtract_block(w, 0, w->lower, n + 1, b_n, b_next);
        if (n < last) subtract_block(w, 0, w->last_row, n, b_n, b_last);
    }
    /* backward substitution: x replaces y */
    for (int n = last - 1; n >= 0; --n) {
        double *x_n = b + (size_t)n * (size_t)s, *x_next = x_n + s;
        subtract_block(w, 0, w->last_factor, n, b_last, x_n);
        if (n + 1 < last) subtract_block(w, 0, w->next_factor, n, x_next, x_n);
    }
}

/* Solve the transposed ring equations in place: b (N, s) is the right-hand side, then the solution
 * x. The cyclic block-tridiagonal matrix with blocks L, D, U has block LU factors with the last
 * sector as border, row V and column W (eliminate_ring). Transposed, the upper factor comes first
 * and the lower one last:
 *
 *     forward     b_last -= (D_n^-1 W_n)^T b_n,   b_(n+1) -= (D_n^-1 U_n)^T b_n
 *     backward    x_n = D_n^-T (b_n - L_(n+1)^T x_(n+1) - V_n^T x_last). */
static void solve_ring_transposed(bd_ring *w, double *b) {
    const int N = w->input.n_sector, last = N - 1, s = w->n_ring;
    double *b_last = b + (size_t)last * (size_t)s;
    /* forward elimination with the transposed upper factor */
    for (int n = 0; n < last; ++n) {
        double *b_n = b + (size_t)n * (size_t)s, *b_next = b_n + s;
        subtract_block(w, 1, w->last_factor, n, b_n, b_last);
        if (n + 1 < last) subtract_block(w, 1, w->next_factor, n, b_n, b_next);
    }
    /* backward substitution with the transposed lower factor: x replaces b */
    for (int n = last; n >= 0; --n) {
        double *x_n = b + (size_t)n * (size_t)s, *x_next = x_n + s;
        if (n + 1 < last) subtract_block(w, 1, w->lower, n + 1, x_next, x_n);
        if (n < last) subtract_block(w, 1, w->last_row, n, b_last, x_n);
        apply_inverse(w, 1, n, x_n);
    }
}

/* Split the right-hand side of a sector, `from` (n_coef, sector_size). Its coordinates are the
 * inner and the ring coordinates of the blade, then the damper. Copy the inner ones to inner
 * (n_coef, n_inner); add the others to ring: first those of the blade (n_coef, n_kept), then the
 * damper (n_coef, n_damper). */
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

/* Join the solution of a sector, `to` (n_coef, sector_size), from inner (n_coef, n_inner) and ring:
 * blade coordinates (n_coef, n_kept), then the damper (n_coef, n_damper). The coordinates of a
 * sector are the inner and the ring coordinates of the blade, then the damper. */
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

/* Eliminate the inner unknowns e of sector n from its right-hand side r (n_coef, sector_size). In
 * inner unknowns e and outer unknowns x the equations of the sector are
 *
 *     [ E       columns ] [e]   [r_e]        E (n_inner, n_inner),  columns (n_inner, n_outer),
 *     [ couple  S       ] [x] = [r_x],       couple (n_outer, n_inner),
 *
 * and elimination of e = E^-1 (r_e - columns x) leaves the right-hand side of the ring
 *
 *     r_x - couple E^-1 r_e.
 *
 * On return inner (n_inner), which is zero on entry, is E^-1 r_e; solve_inner completes it to e.
 * The outer right-hand side is added to `here` (n_ring), the ring unknowns of the sector, and
 * `before` (n_damper), the damper of the sector before. */
static void reduce_sector(bd_ring *w, int n, const double *r, double *inner, double *here,
                          double *before) {
    const int n_inner = w->n_inner, n_ring = w->n_ring, n_damper = w->n_damper_unknown;
    const int n_outer = n_ring + n_damper;
    const size_t first_row = (size_t)n * (size_t)n_inner;
    const double *inverse = w->inverse + first_row * (size_t)n_inner;
    const double *couple = w->outer_to_inner + first_row * (size_t)n_outer;
    const double *couple_before = couple + (size_t)n_ring * (size_t)n_inner;
    double *r_e = w->work;
    split_sector(w, r, r_e, here);
    add_product(w, 0, n_inner, n_inner, 1.0, inverse, r_e, inner);
    add_product(w, 0, n_ring, n_inner, -1.0, couple, inner, here);
    add_product(w, 0, n_damper, n_inner, -1.0, couple_before, inner, before);
}

/* The same for the transposed matrix,
 *
 *     [ E^T        couple^T ] [e]   [r_e]
 *     [ columns^T  S^T      ] [x] = [r_x],
 *
 * where elimination of e = E^-T (r_e - couple^T x) leaves the right-hand side of the ring
 *
 *     r_x - columns^T E^-T r_e = r_x - (E^-1 columns)^T r_e.
 *
 * The factorisation has stored E^-1 columns (inner_to_outer), so E^-T r_e is not needed here. On
 * return inner is r_e; solve_inner_transposed multiplies by E^-T. */
static void reduce_sector_transposed(bd_ring *w, int n, const double *r, double *inner,
                                     double *here, double *before) {
    const int n_inner = w->n_inner, n_ring = w->n_ring, n_damper = w->n_damper_unknown;
    const int n_outer = n_ring + n_damper;
    const size_t first_row = (size_t)n * (size_t)n_inner;
    const double *inverse_columns = w->inner_to_outer + first_row * (size_t)n_outer;
    double *change = w->work; /* (n_outer) of the outer right-hand side */
    split_sector(w, r, inner, here);
    memset(change, 0, sizeof(double) * (size_t)n_outer);
    add_product(w, 1, n_inner, n_outer, -1.0, inverse_columns, inner, change);
    for (int i = 0; i < n_ring; ++i) here[i] += change[i];
    for (int i = 0; i < n_damper; ++i) before[i] += change[n_ring + i];
}

/* Copy the outer unknowns of a sector, its ring unknowns `here` (n_ring) and the damper of the
 * sector before (n_damper), to outer (n_outer). */
static void join_outer(const bd_ring *w, const double *here, const double *before, double *outer) {
    const size_t n_ring = (size_t)w->n_ring, n_damper = (size_t)w->n_damper_unknown;
    memcpy(outer, here, sizeof(double) * n_ring);
    memcpy(outer + n_ring, before, sizeof(double) * n_damper);
}

/* Inner unknowns e = E^-1 r_e - E^-1 columns x of sector n from the outer unknowns x: ring unknowns
 * of the sector (`here`) and damper of the sector before (`before`). On entry inner (n_inner) is
 * E^-1 r_e (reduce_sector), on return e. */
static void solve_inner(bd_ring *w, int n, const double *here, const double *before,
                        double *inner) {
    const int n_inner = w->n_inner, n_outer = w->n_ring + w->n_damper_unknown;
    const size_t first_row = (size_t)n * (size_t)n_inner;
    const double *inverse_columns = w->inner_to_outer + first_row * (size_t)n_outer;
    double *outer = w->work; /* (n_outer) */
    join_outer(w, here, before, outer);
    add_product(w, 0, n_inner, n_outer, -1.0, inverse_columns, outer, inner);
}

/* The same for the transposed matrix: e = E^-T (r_e - couple^T x). On entry inner is r_e
 * (reduce_sector_transposed). */
static void solve_inner_transposed(bd_ring *w, int n, const double *here, const double *before,
                                   double *inner) {
    const int n_inner = w->n_inner, n_outer = w->n_ring + w->n_damper_unknown;
    const size_t first_row = (size_t)n * (size_t)n_inner;
    const double *couple = w->outer_to_inner + first_row * (size_t)n_outer;
    const double *inverse = w->inverse + first_row * (size_t)n_inner;
    double *outer = w->work;              /* (n_outer) */
    double *right_side = outer + n_outer; /* (n_inner) */
    join_outer(w, here, before, outer);
    add_product(w, 1, n_outer, n_inner, -1.0, couple, outer, inner);
    memcpy(right_side, inner, sizeof(double) * (size_t)n_inner);
    memset(inner, 0, sizeof(double) * (size_t)n_inner);
    add_product(w, 1, n_inner, n_inner, 1.0, inverse, right_side, inner);
}

/* Solve for the right-hand side r (N, n_coef, sector_size), optionally with the transposed matrix;
 * the solution x has the same shape. Eliminate the inner unknowns of each sector, solve the ring
 * for the others, and return to the inner unknowns. The damper of a sector touches the next blade,
 * so sector n also changes the right-hand side of the damper before it. */
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
        const double *r_n = r + n * sector;
        double *inner_n = inner + n * n_inner, *ring_n = ring + n * n_ring;
        double *damper_before = ring + (n + N - 1) % N * n_ring + damper;
        if (transposed)
            reduce_sector_transposed(w, (int)n, r_n, inner_n, ring_n, damper_before);
        else
            reduce_sector(w, (int)n, r_n, inner_n, ring_n, damper_before);
    }
    if (transposed)
        solve_ring_transposed(w, ring);
    else
        solve_ring(w, ring);
    for (size_t n = 0; n < N; ++n) {
        const double *ring_n = ring + n * n_ring;
        const double *damper_before = ring + (n + N - 1) % N * n_ring + damper;
        double *inner_n = inner + n * n_inner;
        if (transposed)
            solve_inner_transposed(w, (int)n, ring_n, damper_before, inner_n);
        else
            solve_inner(w, (int)n, ring_n, damper_before, inner_n);
        join_sector(w, inner_n, ring_n, x + n * sector);
    }
}
