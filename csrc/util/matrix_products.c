/* Small dense products and inverses, compiled once for each instruction set; BD_VARIANT names the
 * build.
 *
 * BLAS is not used for these sizes: a threaded BLAS passes such a product to its thread pool, and
 * waking the pool takes many times longer than the product (measured: 20 times with two threads).
 * Curves run in parallel processes, so one thread suffices, and the number of BLAS threads is a
 * process-wide setting of another library.
 *
 * The product holds a tile of C in registers while k runs. Both operands are
 * read along their rows. */
#include "util/kernels.h"
#include "util/vector_types.h"

enum { MOST_ROWS = BD_WIDTH == 8 ? 8 : 4, MOST_VECTORS = 3 };

/* Element A (i, p) is A[i of_row + p of_column]. */
typedef struct {
    const double *A;
    size_t of_row, of_column;
    double alpha;
} left_factor;

/* Add alpha A B to n_rows rows of C from row i, in n_columns columns: those of n_vec vectors, of
 * which the last one may be incomplete. */
BD_INLINE void tile(const int n_rows, const int n_vec, size_t i, size_t k, const left_factor f,
                    const double *B, size_t stride_b, double *C, size_t stride_c,
                    size_t n_columns) {
    bd_vec sum[MOST_ROWS][MOST_VECTORS];
    for (int r = 0; r < n_rows; ++r)
        for (int v = 0; v < n_vec; ++v) sum[r][v] = bd_all(0.0);
    for (size_t p = 0; p < k; ++p) {
        const double *a = f.A + i * f.of_row + p * f.of_column;
        const double *b = B + p * stride_b;
        bd_vec row[MOST_VECTORS];
        for (int v = 0; v < n_vec; ++v) row[v] = bd_load(b + v * BD_WIDTH);
        for (int r = 0; r < n_rows; ++r) {
            const bd_vec ar = bd_all(a[(size_t)r * f.of_row]);
            for (int v = 0; v < n_vec; ++v) sum[r][v] += ar * row[v];
        }
    }

    for (int r = 0; r < n_rows; ++r) {
        double *c = C + (i + (size_t)r) * stride_c;
        for (int v = 0; v < n_vec; ++v) {
            const size_t from = (size_t)(v * BD_WIDTH);
            if (from + BD_WIDTH <= n_columns) {
                bd_store(c + from, bd_load(c + from) + f.alpha * sum[r][v]);
                continue;
            }
            /* constant indices leave the vector in registers */
            for (size_t j = 0; j + 1 < BD_WIDTH; ++j)
                if (from + j < n_columns) c[from + j] += f.alpha * bd_entry(sum[r][v], j);
        }
    }
}

/* All rows of the columns of one tile; the last ones in smaller tiles of constant sizes, whose sums
 * stay in registers. */
BD_INLINE void strip(const int n_vec, size_t m, size_t k, const left_factor f, const double *B,
                     size_t stride_b, double *C, size_t stride_c, size_t n_columns) {
    size_t i = 0;
    for (; i + MOST_ROWS <= m; i += MOST_ROWS)
        tile(MOST_ROWS, n_vec, i, k, f, B, stride_b, C, stride_c, n_columns);
    if (m - i >= 4) {
        tile(4, n_vec, i, k, f, B, stride_b, C, stride_c, n_columns);
        i += 4;
    }
    if (m - i >= 2) {
        tile(2, n_vec, i, k, f, B, stride_b, C, stride_c, n_columns);
        i += 2;
    }
    if (m - i == 1) tile(1, n_vec, i, k, f, B, stride_b, C, stride_c, n_columns);
}

/* C (m, n) += alpha A B, in strips of three vectors and a narrower last one. */
BD_INLINE void all_strips(size_t m, size_t n, size_t k, const left_factor f, const double *B,
                          size_t stride_b, double *C, size_t stride_c) {
    if (k == 0) return;
    for (size_t j = 0; j < n;) {
        const size_t left = n - j;
        if (left > 2 * BD_WIDTH) {
            const size_t taken = left < 3 * BD_WIDTH ? left : 3 * BD_WIDTH;
            strip(3, m, k, f, B + j, stride_b, C + j, stride_c, taken);
            j += taken;
        } else if (left > BD_WIDTH) {
            strip(2, m, k, f, B + j, stride_b, C + j, stride_c, left);
            j += left;
        } else {
            strip(1, m, k, f, B + j, stride_b, C + j, stride_c, left);
            j += left;
        }
    }
}

static void product(size_t m, size_t n, size_t k, const double *A, const double *B, size_t stride_b,
                    double *C, size_t stride_c) {
    all_strips(m, n, k, (left_factor){A, 1, m, 1.0}, B, stride_b, C, stride_c);
}

static void add_product(size_t m, size_t n, size_t k, double alpha, const double *A,
                        size_t stride_a, const double *B, size_t stride_b, double *C,
                        size_t stride_c) {
    all_strips(m, n, k, (left_factor){A, stride_a, 1, alpha}, B, stride_b, C, stride_c);
}

/* Exchange n entries at a distance of `stride`. */
static void exchange(int n, double *a, double *b, int stride) {
    for (int i = 0; i < n; ++i) {
        const double former = a[i * stride];
        a[i * stride] = b[i * stride];
        b[i * stride] = former;
    }
}

/* Row of the largest entry of a column in row k or below. */
static int pivot_row(int n, int k, const double *column) {
    int p = k;
    for (int i = k + 1; i < n; ++i)
        if (fabs(column[i]) > fabs(column[p])) p = i;
    return p;
}

/* Eliminate b columns of A from `first` by Gauss and Jordan. P (b, stride) holds these columns;
 * pivoting exchanges whole rows of A. For the pivot d of row p and column k,
 *
 *     row p       a_pj / d  in each other column j,
 *     others      a_ij - a_ik (a_pj / d),
 *     column k    -a_ik / d,  and 1/d in row p.
 *
 * Rows p and k are exchanged. Return the sign of the determinant, 0 if a pivot is zero or
 * infinite. */
static int eliminate_columns(int n, int first, int b, double *P, int stride, double *A,
                             int *pivot) {
    int sign = 1;
    for (int k = first; k < first + b; ++k) {
        double *column = P + (k - first) * stride;
        const int p = pivot_row(n, k, column);
        const double d = column[p];
        pivot[k] = p;
        if (!(fabs(d) > 0.0) || isinf(d)) return 0;
        /* an exchange of rows changes the sign, and a negative pivot too */
        const int exchanged = p != k;
        if ((d < 0.0) != exchanged) sign = -sign;
        if (exchanged) exchange(n, A + p * n, A + k * n, 1);

        for (double *other = P; other < P + b * stride; other += stride) {
            if (other == column) continue;
            const double factor = other[p] / d;
            for (int i = 0; i < n; i += BD_WIDTH)
                bd_store(other + i, bd_load(other + i) - factor * bd_load(column + i));
            other[p] = other[k];
            other[k] = factor;
        }
        for (int i = 0; i < n; i += BD_WIDTH) bd_store(column + i, bd_load(column + i) / -d);
        column[p] = column[k];
        column[k] = 1.0 / d;
    }
    return sign;
}

/* Invert by blocks of columns: one product per block updates all other columns. */
static int invert(int n, double *restrict A, int *restrict pivot, double *restrict work) {
    const int stride = (n + 7) / 8 * 8;
    int sign = 1;
    for (int first = 0; first < n; first += BD_KERNEL_BLOCK) {
        const int left = n - first;
        const int b = left < BD_KERNEL_BLOCK ? left : BD_KERNEL_BLOCK;
        const size_t bytes_of_block = sizeof(double) * (size_t)b;
        const size_t bytes_of_rows = bytes_of_block * (size_t)n;
        double *rows = work;           /* (b, n) */
        double *P = work + b * stride; /* (b, stride) */

        /* columns of the block */
        memset(P, 0, bytes_of_block * (size_t)stride);
        for (int j = 0; j < b; ++j)
            for (int i = 0; i < n; ++i) P[j * stride + i] = A[i * n + first + j];
        const int sign_of_block = eliminate_columns(n, first, b, P, stride, A, pivot);
        if (!sign_of_block) return 0;
        sign *= sign_of_block;

        /* rows of the block, with the identity in its columns */
        memcpy(rows, A + first * n, bytes_of_rows);
        for (int i = 0; i < b; ++i) {
            double *own = rows + i * n + first;
            memset(own, 0, bytes_of_block);
            own[i] = 1.0;
        }

        /* the product replaces rows and columns of the block, and updates the remainder */
        for (int i = 0; i < n; ++i) memset(A + i * n + first, 0, bytes_of_block);
        memset(A + first * n, 0, bytes_of_rows);
        const left_factor columns = {P, 1, (size_t)stride, 1.0};
        all_strips((size_t)n, (size_t)n, (size_t)b, columns, rows, (size_t)n, A, (size_t)n);
    }

    /* exchanged rows are columns of the inverse */
    for (int k = n - 1; k >= 0; --k)
        if (pivot[k] != k) exchange(n, A + k, A + pivot[k], n);
    return sign;
}

/* ---- tangent times modes ---- */

/* Columns j .. j + n_vec*BD_WIDTH of harmonic m, all rows. */
BD_INLINE void fill_columns(const bd_fill *f, int m, const int n_row, const int n_source,
                            const int n_vec, size_t columns, size_t j) {
    const size_t n_coef = (size_t)bd_n_coef(f->n_harm);
    const size_t first = (size_t)f->first[m] + j;
    const size_t slot = m == 0 ? 0 : 2 * (size_t)m - 1;

    /* rows of the modes, which stay in registers */
    bd_vec g[6][2];
    for (int s = 0; s < n_source; ++s)
        for (int t = 0; t < n_row; ++t) {
            const double *row = f->g[m * n_source + s] + (size_t)t * columns + j;
            for (int v = 0; v < n_vec; ++v)
                g[s * n_row + t][v] = bd_load(row + (size_t)(v * BD_WIDTH));
        }

    for (size_t i = 0; i < n_coef; ++i) {
        bd_vec sum[2] = {bd_all(0.0), bd_all(0.0)};
        for (int s = 0; s < n_source; ++s)
            for (int t = 0; t < n_row; ++t) {
                const bd_vec tangent = bd_all(f->block[s][i * n_coef + slot + (size_t)t]);
                for (int v = 0; v < n_vec; ++v) sum[v] += tangent * g[s * n_row + t][v];
            }
        for (int v = 0; v < n_vec; ++v) bd_store(f->z[i] + first + (size_t)(v * BD_WIDTH), sum[v]);
    }
}

BD_INLINE void fill_harmonic(const bd_fill *f, int m, const int n_row, const int n_source) {
    const size_t columns = (size_t)(n_row * f->n_mode[m]);
    size_t j = 0;
    for (; j + 2 * BD_WIDTH <= columns; j += 2 * BD_WIDTH)
        fill_columns(f, m, n_row, n_source, 2, columns, j);
    for (; j < columns; j += BD_WIDTH) fill_columns(f, m, n_row, n_source, 1, columns, j);
}

/* All harmonics. The mean has one row for each mode, a harmonic two (cosine and sine); with these
 * numbers constant the compiler unrolls the loops over rows and sources. */
static void fill_rows(const bd_fill *f) {
    for (int m = 0; m <= f->n_harm; ++m) {
        if (m == 0) {
            if (f->n_source == 1) fill_harmonic(f, m, 1, 1);
            if (f->n_source == 2) fill_harmonic(f, m, 1, 2);
            if (f->n_source == 3) fill_harmonic(f, m, 1, 3);
        } else {
            if (f->n_source == 1) fill_harmonic(f, m, 2, 1);
            if (f->n_source == 2) fill_harmonic(f, m, 2, 2);
            if (f->n_source == 3) fill_harmonic(f, m, 2, 3);
        }
    }
}

/* ---- matrix times vector ---- */

/* a.x, with independent sums over alternate vectors. */
BD_INLINE double dot(size_t n, const double *a, const double *x) {
    bd_vec even = bd_all(0.0), odd = bd_all(0.0);
    size_t j = 0;
    for (; j + 2 * BD_WIDTH <= n; j += 2 * BD_WIDTH) {
        even += bd_load(a + j) * bd_load(x + j);
        odd += bd_load(a + j + BD_WIDTH) * bd_load(x + j + BD_WIDTH);
    }
    double sum = bd_sum(even + odd);
    for (; j < n; ++j) sum += a[j] * x[j];
    return sum;
}

/* Like `dot` for several rows with the same x. `last` holds the last BD_WIDTH entries of x; entries
 * that a full vector has covered are zero. */
BD_INLINE void dots(const int n_rows, size_t n, const double *A, const double *x, bd_vec last,
                    double *y) {
    /* two sums for each row, of alternate vectors */
    bd_vec sum[4][2];
    for (int r = 0; r < n_rows; ++r) sum[r][0] = sum[r][1] = bd_all(0.0);
    size_t j = 0;
    for (; j + 2 * BD_WIDTH <= n; j += 2 * BD_WIDTH)
        for (int r = 0; r < n_rows; ++r) {
            const double *a = A + (size_t)r * n + j;
            for (size_t v = 0; v < 2; ++v)
                sum[r][v] += bd_load(a + v * BD_WIDTH) * bd_load(x + j + v * BD_WIDTH);
        }
    if (j + BD_WIDTH <= n) {
        for (int r = 0; r < n_rows; ++r)
            sum[r][0] += bd_load(A + (size_t)r * n + j) * bd_load(x + j);
        j += BD_WIDTH;
    }
    if (j < n) {
        for (int r = 0; r < n_rows; ++r) {
            const double *end = A + (size_t)(r + 1) * n;
            sum[r][1] += bd_load(end - BD_WIDTH) * last;
        }
    }
    for (int r = 0; r < n_rows; ++r) y[r] = bd_sum(sum[r][0] + sum[r][1]);
}

static void multiply(size_t rows, size_t columns, const double *A, const double *x, double *y) {
    size_t i = 0;
    if (columns >= BD_WIDTH) {
        /* the last vector of x, with zeros for entries that full vectors have covered */
        const size_t n_covered = BD_WIDTH - columns % BD_WIDTH;
        const double *end = x + columns - BD_WIDTH;
        double last[BD_WIDTH];
        for (size_t j = 0; j < BD_WIDTH; ++j) last[j] = j < n_covered ? 0.0 : end[j];
        for (; i + 4 <= rows; i += 4) dots(4, columns, A + i * columns, x, bd_load(last), y + i);
    }
    for (; i < rows; ++i) y[i] = dot(columns, A + i * columns, x);
}

static void multiply_pairs(size_t pairs, size_t columns, const double *A, const double *x,
                           const double *x_turned, double *y) {
    for (size_t i = 0; i < pairs; ++i) {
        y[2 * i] = dot(columns, A + 2 * i * columns, x);
        y[2 * i + 1] = dot(columns, A + 2 * i * columns, x_turned);
    }
}

/* Add A^T x to the entries of y in n_vec vectors, which stay in registers; A begins at their first
 * column. */
BD_INLINE void add_columns(const int n_vec, size_t rows, size_t columns, const double *A,
                           const double *x, double *y) {
    bd_vec sum[4];
    for (int v = 0; v < n_vec; ++v) sum[v] = bd_load(y + v * BD_WIDTH);
    for (size_t i = 0; i < rows; ++i) {
        const bd_vec xi = bd_all(x[i]);
        for (int v = 0; v < n_vec; ++v)
            sum[v] += xi * bd_load(A + i * columns + (size_t)(v * BD_WIDTH));
    }
    for (int v = 0; v < n_vec; ++v) bd_store(y + v * BD_WIDTH, sum[v]);
}

static void multiply_transposed(size_t rows, size_t columns, const double *A, const double *x,
                                double *y) {
    size_t j = 0;
    for (; j + 4 * BD_WIDTH <= columns; j += 4 * BD_WIDTH)
        add_columns(4, rows, columns, A + j, x, y + j);
    for (; j + BD_WIDTH <= columns; j += BD_WIDTH) add_columns(1, rows, columns, A + j, x, y + j);
    if (j == columns) return;
    /* fewer columns than a vector has entries */
    for (size_t i = 0; i < rows; ++i)
        for (size_t c = j; c < columns; ++c) y[c] += x[i] * A[i * columns + c];
}

/* ---- values on the grid of the root finder ---- */

enum { GRID_VECTORS = 16 / BD_WIDTH };

static void grid_values(int n_coef, int n_time, const double *basis, int n_poly, const double *x,
                        double *value) {
    for (int q = 0; q < n_poly; ++q) {
        const double *coefficient = x + (size_t)q * (size_t)n_coef;
        double *values = value + (size_t)q * (size_t)n_time;
        for (int k = 0; k < n_time; k += 16) {
            bd_vec sum[GRID_VECTORS];
            /* the first function of the basis is 1 */
            for (int v = 0; v < GRID_VECTORS; ++v) sum[v] = bd_all(coefficient[0]);
            for (int i = 1; i < n_coef; ++i) {
                const double *b = basis + (size_t)i * (size_t)n_time + k;
                const bd_vec c = bd_all(coefficient[i]);
                for (int v = 0; v < GRID_VECTORS; ++v) sum[v] += c * bd_load(b + v * BD_WIDTH);
            }
            for (int v = 0; v < GRID_VECTORS; ++v) bd_store(values + k + v * BD_WIDTH, sum[v]);
        }
    }
}

/* Largest a - r b and smallest a + r b of n entries. */
static void bounds(int n, double r, const double *a, const double *b, double *largest,
                   double *smallest) {
    bd_vec most = bd_load(a) - r * bd_load(b);
    bd_vec least = bd_load(a) + r * bd_load(b);
    for (int k = BD_WIDTH; k < n; k += BD_WIDTH) {
        const bd_vec difference = bd_load(a + k) - r * bd_load(b + k);
        const bd_vec sum = bd_load(a + k) + r * bd_load(b + k);
        most = bd_select(bd_above(difference, most), difference, most);
        least = bd_select(bd_above(least, sum), sum, least);
    }
    *largest = bd_entry(most, 0);
    *smallest = bd_entry(least, 0);
    for (size_t i = 1; i < BD_WIDTH; ++i) {
        if (bd_entry(most, i) > *largest) *largest = bd_entry(most, i);
        if (bd_entry(least, i) < *smallest) *smallest = bd_entry(least, i);
    }
}

void BD_JOIN(bd_lanes_settle_, BD_VARIANT)(bd_lanes *lanes);
void BD_JOIN(bd_lanes_sum_, BD_VARIANT)(bd_lanes *lanes);
void BD_JOIN(bd_lanes_values_, BD_VARIANT)(int n_coef, int n_time, const double *power, int n_power,
                                           const double *x, double *value);
void BD_JOIN(bd_lanes_contact_, BD_VARIANT)(int n_power, int n_time, const double *power,
                                            const double *g, double *E);
void BD_JOIN(bd_coupled_period_, BD_VARIANT)(bd_coupled_lanes *lanes, int store, int tangent);
void BD_JOIN(bd_coupled_chords_, BD_VARIANT)(bd_coupled_lanes *lanes, int tangent);
double BD_JOIN(bd_disk_violation_, BD_VARIANT)(int n, const double *x, const double *y,
                                               const double *R, const double *s, int *which);
bd_status BD_JOIN(bd_time_integrate_, BD_VARIANT)(struct bd_time *time,
                                                  const struct bd_time_path *path);
void BD_JOIN(bd_time_contact_, BD_VARIANT)(struct bd_time *time);

extern const bd_kernel BD_JOIN(bd_kernel_, BD_VARIANT);
const bd_kernel BD_JOIN(bd_kernel_, BD_VARIANT) = {
    .name = BD_VARIANT_NAME,
    .product = product,
    .add_product = add_product,
    .invert = invert,
    .fill_rows = fill_rows,
    .multiply = multiply,
    .multiply_transposed = multiply_transposed,
    .multiply_pairs = multiply_pairs,
    .grid_values = grid_values,
    .bounds = bounds,
    .settle = BD_JOIN(bd_lanes_settle_, BD_VARIANT),
    .sum_cycle = BD_JOIN(bd_lanes_sum_, BD_VARIANT),
    .lane_values = BD_JOIN(bd_lanes_values_, BD_VARIANT),
    .lane_contact = BD_JOIN(bd_lanes_contact_, BD_VARIANT),
    .coupled_period = BD_JOIN(bd_coupled_period_, BD_VARIANT),
    .coupled_chords = BD_JOIN(bd_coupled_chords_, BD_VARIANT),
    .integrate = BD_JOIN(bd_time_integrate_, BD_VARIANT),
    .contact_at_instant = BD_JOIN(bd_time_contact_, BD_VARIANT),
    .disk_violation = BD_JOIN(bd_disk_violation_, BD_VARIANT),
};
