/* C += A^T B for the modal matrix products.
 *
 * Why not BLAS: a threaded BLAS hands products of this size to its pool, and waking the pool costs many times the product
 * (measured: 20 times, with two threads).  Curves are computed in parallel instead, so one thread is what is wanted, and
 * a process-wide setting of somebody else's library is not ours to change.
 *
 * A tile of 4 rows by PAD columns of C stays in vector registers while k runs; both operands are read along their rows.
 * The same text is compiled for three instruction sets and chosen at run time. */
#include "bd_product.h"

#define TILE_ROWS 4

#if defined(__x86_64__) && defined(__GNUC__)
#define HAVE_X86 1
#else
#define HAVE_X86 0
#endif

/* One tile: rows i .. i+ROWS-1 and VECTORS vectors of columns from j. */
#define DEFINE_PRODUCT(NAME, TARGET, WIDTH, VECTORS)                                                                \
    typedef double NAME##_vector __attribute__((vector_size(8 * WIDTH), aligned(8)));                               \
    TARGET static inline __attribute__((always_inline)) void NAME##_tile(                                           \
        const int n_rows, size_t m, size_t stride, size_t k, const double *restrict A, const double *restrict B,    \
        double *restrict out) {                                                                                     \
        NAME##_vector sum[TILE_ROWS][VECTORS] = {{{0.0}}};                                                          \
        for (size_t p = 0; p < k; ++p) {                                                                            \
            const NAME##_vector *b = (const NAME##_vector *)(B + p * stride);                                       \
            const double *a = A + p * m;                                                                            \
            for (int i = 0; i < n_rows; ++i)                                                                        \
                for (int v = 0; v < VECTORS; ++v) sum[i][v] += a[i] * b[v];                                         \
        }                                                                                                           \
        for (int i = 0; i < n_rows; ++i)                                                                            \
            for (int v = 0; v < VECTORS; ++v)                                                                       \
                for (int c = 0; c < WIDTH; ++c) out[i * (WIDTH * VECTORS) + v * WIDTH + c] = sum[i][v][c];          \
    }                                                                                                               \
    TARGET static void NAME(size_t m, size_t n, size_t k, const double *A, const double *B, double *C) {            \
        const size_t stride = bd_product_stride(n), width = WIDTH * VECTORS;                                        \
        double out[TILE_ROWS * WIDTH * VECTORS];                                                                    \
        for (size_t j = 0; j < n; j += width) {                                                                     \
            const size_t n_columns = n - j < width ? n - j : width;                                                 \
            for (size_t i = 0; i < m; i += TILE_ROWS) {                                                             \
                const size_t n_rows = m - i < TILE_ROWS ? m - i : TILE_ROWS;                                        \
                switch (n_rows) {                                                                                   \
                case 4: NAME##_tile(4, m, stride, k, A + i, B + j, out); break;                                     \
                case 3: NAME##_tile(3, m, stride, k, A + i, B + j, out); break;                                     \
                case 2: NAME##_tile(2, m, stride, k, A + i, B + j, out); break;                                     \
                default: NAME##_tile(1, m, stride, k, A + i, B + j, out); break;                                    \
                }                                                                                                   \
                for (size_t r = 0; r < n_rows; ++r)                                                                 \
                    for (size_t c = 0; c < n_columns; ++c) C[(i + r) * n + j + c] += out[r * width + c];            \
            }                                                                                                       \
        }                                                                                                           \
    }

DEFINE_PRODUCT(product_generic, , 2, 3)
#if HAVE_X86
DEFINE_PRODUCT(product_avx2, __attribute__((target("avx2,fma"))), 4, 3)
DEFINE_PRODUCT(product_avx512, __attribute__((target("avx512f,fma"))), 8, 3)
#endif

void bd_product_add(size_t m, size_t n, size_t k, const double *A, const double *B, double *C) {
#if HAVE_X86
    if (__builtin_cpu_supports("avx512f")) {
        product_avx512(m, n, k, A, B, C);
        return;
    }
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        product_avx2(m, n, k, A, B, C);
        return;
    }
#endif
    product_generic(m, n, k, A, B, C);
}

void bd_product_vector(size_t rows, size_t columns, const double *restrict A, const double *restrict x,
                       double *restrict y) {
    for (size_t i = 0; i < rows; ++i) {
        const double *restrict a = A + i * columns;
        double s0 = 0.0, s1 = 0.0, s2 = 0.0, s3 = 0.0;
        size_t j = 0;
        for (; j + 4 <= columns; j += 4) {
            s0 += a[j] * x[j];
            s1 += a[j + 1] * x[j + 1];
            s2 += a[j + 2] * x[j + 2];
            s3 += a[j + 3] * x[j + 3];
        }
        for (; j < columns; ++j) s0 += a[j] * x[j];
        y[i] = (s0 + s1) + (s2 + s3);
    }
}

void bd_product_vector_transposed(size_t rows, size_t columns, const double *restrict A, const double *restrict x,
                                  double *restrict y) {
    for (size_t i = 0; i < rows; ++i) {
        const double *restrict a = A + i * columns;
        const double xi = x[i];
        if (xi == 0.0) continue;
        for (size_t j = 0; j < columns; ++j) y[j] += xi * a[j];
    }
}
