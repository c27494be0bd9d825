/* Inner loops of every build on this processor against plain loops, for every
 * remainder of the tiles. */
#include "util/kernels.h"
#include "check.h"

#include <string.h>

static double *random_numbers(size_t n, unsigned long long *seed) {
    double *x = not_numbers(n + BD_KERNEL_PAD);
    for (size_t i = 0; i < n + BD_KERNEL_PAD; ++i) x[i] = uniform(seed);
    return x;
}

static void test_product(const bd_kernel *kernel, size_t m, size_t n, size_t k,
                         unsigned long long *seed) {
    const size_t stride = bd_kernel_stride(n), stride_c = n + 3;
    CHECK(stride >= n + 7 && stride < n + 15 && stride % 8 == 0);
    double *A = random_numbers(k * m, seed), *B = random_numbers(k * stride, seed),
           *C = random_numbers(m * stride_c, seed);
    double *expected = not_numbers(m * stride_c);
    /* the memory between the rows must not change */
    memcpy(expected, C, sizeof(double) * m * stride_c);
    for (size_t i = 0; i < m; ++i)
        for (size_t j = 0; j < n; ++j)
            for (size_t p = 0; p < k; ++p)
                expected[i * stride_c + j] += A[p * m + i] * B[p * stride + j];
    kernel->product(m, n, k, A, B, stride, C, stride_c);
    for (size_t i = 0; i < m * stride_c; ++i) CHECK_NEAR(C[i], expected[i], 1e-13);
    free(A);
    free(B);
    free(C);
    free(expected);
}

static void test_add_product(const bd_kernel *kernel, size_t m, size_t n, size_t k,
                             unsigned long long *seed) {
    const size_t stride_a = k + 2, stride_b = n + 1, stride_c = n + 3;
    double *A = random_numbers(m * stride_a, seed), *B = random_numbers(k * stride_b, seed);
    double *C = random_numbers(m * stride_c, seed), *expected = not_numbers(m * stride_c);
    memcpy(expected, C, sizeof(double) * m * stride_c);
    for (size_t i = 0; i < m; ++i)
        for (size_t j = 0; j < n; ++j)
            for (size_t p = 0; p < k; ++p)
                expected[i * stride_c + j] -= 1.5 * A[i * stride_a + p] * B[p * stride_b + j];
    kernel->add_product(m, n, k, -1.5, A, stride_a, B, stride_b, C, stride_c);
    for (size_t i = 0; i < m * stride_c; ++i) CHECK_NEAR(C[i], expected[i], 1e-13);
    free(A);
    free(B);
    free(C);
    free(expected);
}

/* A permutation plus random numbers a thousand times smaller: rows must be exchanged. */
static void test_invert(const bd_kernel *kernel, int n, unsigned long long *seed) {
    double *A = random_numbers((size_t)(n * n), seed), *inverse = not_numbers((size_t)(n * n));
    double *work = not_numbers(2 * BD_KERNEL_BLOCK * (size_t)(n + 8));
    int *pivot = malloc(sizeof(int) * (size_t)n);
    for (int i = 0; i < n * n; ++i) A[i] *= 1e-3;
    for (int i = 0; i < n; ++i) A[i * n + (i + 1) % n] += i % 2 ? 1.0 : -1.0;
    memcpy(inverse, A, sizeof(double) * (size_t)(n * n));
    const int negative = (n % 2 ? 0 : 1) + (n + 1) / 2; /* a cycle of n, and every other entry */
    CHECK(kernel->invert(n, inverse, pivot, work) == (negative % 2 ? -1 : 1));
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            double sum = 0.0;
            for (int p = 0; p < n; ++p) sum += A[i * n + p] * inverse[p * n + j];
            CHECK_NEAR(sum, i == j ? 1.0 : 0.0, 1e-12);
        }
    /* A column of zeros, a column with a NaN, and a column that is twice the first. */
    for (int lost = 0; lost < 3; ++lost) {
        const int at = lost < 2 ? n / 2 : 1;
        memcpy(inverse, A, sizeof(double) * (size_t)(n * n));
        for (int i = 0; i < n && at < n; ++i)
            inverse[i * n + at] = lost == 0 ? 0.0 : lost == 1 ? NAN : 2.0 * inverse[i * n];
        CHECK(at == n || kernel->invert(n, inverse, pivot, work) == 0);
    }
    free(A);
    free(inverse);
    free(work);
    free(pivot);
}

static void test_vectors(const bd_kernel *kernel, size_t pairs, size_t columns,
                         unsigned long long *seed) {
    const size_t rows = 2 * pairs;
    double *A = random_numbers(rows * columns, seed), *x = random_numbers(columns, seed),
           *y = not_numbers(rows);
    double *z = random_numbers(rows, seed), *t = random_numbers(columns, seed),
           *expected = not_numbers(columns + 1);
    double *turned = random_numbers(columns, seed), *both = not_numbers(rows);
    for (size_t j = 0; j < columns; ++j) {
        expected[j] = t[j];
        for (size_t i = 0; i < rows; ++i) expected[j] += A[i * columns + j] * z[i];
    }
    kernel->multiply(rows, columns, A, x, y);
    kernel->multiply_transposed(rows, columns, A, z, t);
    kernel->multiply_pairs(pairs, columns, A, x, turned, both);
    for (size_t i = 0; i < rows; ++i) {
        double sum = 0.0, sum_turned = 0.0;
        for (size_t j = 0; j < columns; ++j) sum += A[i * columns + j] * x[j];
        for (size_t j = 0; j < columns; ++j) sum_turned += A[i / 2 * 2 * columns + j] * turned[j];
        CHECK_NEAR(y[i], sum, 1e-13);
        CHECK_NEAR(both[i], i % 2 ? sum_turned : y[i], 1e-13);
    }
    for (size_t j = 0; j < columns; ++j) CHECK_NEAR(t[j], expected[j], 1e-13);
    free(A);
    free(x);
    free(y);
    free(z);
    free(t);
    free(expected);
    free(turned);
    free(both);
}

/* Numbers of modes with every remainder, one harmonic without modes. */
static void test_fill(const bd_kernel *kernel, int n_source, unsigned long long *seed) {
    enum { HARM = 3, COEF = 7 };
    const int n_mode[HARM + 1] = {5, 11, 0, 9}, first[HARM + 2] = {0, 5, 27, 27, 45};
    const size_t stride = bd_kernel_stride(45);
    double *block[3], *G[3][HARM + 1], *Z = not_numbers(COEF * stride), *z[COEF];
    const double *g[(HARM + 1) * 3];
    for (int s = 0; s < 3; ++s) {
        block[s] = random_numbers(COEF * COEF, seed);
        for (int m = 0; m <= HARM; ++m) G[s][m] = random_numbers(4 * (size_t)n_mode[m], seed);
    }
    for (int m = 0; m <= HARM; ++m)
        for (int s = 0; s < n_source; ++s) g[m * n_source + s] = G[s][m];
    for (int i = 0; i < COEF; ++i) z[i] = Z + (size_t)i * stride;
    bd_fill fill = {.n_harm = HARM,
                    .n_source = n_source,
                    .n_mode = n_mode,
                    .first = first,
                    .block = {block[0], block[1], block[2]},
                    .g = g,
                    .z = z};
    kernel->fill_rows(&fill);
    for (int i = 0; i < COEF; ++i)
        for (int m = 0; m <= HARM; ++m) {
            const int rows = m == 0 ? 1 : 2, columns = rows * n_mode[m];
            for (int j = 0; j < columns; ++j) {
                double sum = 0.0;
                for (int s = 0; s < n_source; ++s)
                    for (int t = 0; t < rows; ++t)
                        sum += block[s][i * COEF + (m == 0 ? 0 : 2 * m - 1) + t] *
                               G[s][m][t * columns + j];
                CHECK_NEAR(z[i][first[m] + j], sum, 1e-13);
            }
        }
    for (int s = 0; s < 3; ++s) {
        free(block[s]);
        for (int m = 0; m <= HARM; ++m) free(G[s][m]);
    }
    free(Z);
}

static void test_grid(const bd_kernel *kernel, unsigned long long *seed) {
    enum { COEF = 7, TIME = 48, POLY = 3 };
    double *basis = random_numbers(COEF * TIME, seed), *x = random_numbers(POLY * COEF, seed);
    double *value = not_numbers(POLY * TIME), most, least, plain_most = -1e300, plain_least = 1e300;
    for (int k = 0; k < TIME; ++k) basis[k] = 1.0;
    kernel->grid_values(COEF, TIME, basis, POLY, x, value);
    for (int q = 0; q < POLY; ++q)
        for (int k = 0; k < TIME; ++k) {
            double sum = 0.0;
            for (int i = 0; i < COEF; ++i) sum += x[q * COEF + i] * basis[i * TIME + k];
            CHECK_NEAR(value[q * TIME + k], sum, 1e-13);
        }
    kernel->bounds(TIME, 0.7, value, value + TIME, &most, &least);
    for (int k = 0; k < TIME; ++k) {
        plain_most = fmax(plain_most, value[k] - 0.7 * value[TIME + k]);
        plain_least = fmin(plain_least, value[k] + 0.7 * value[TIME + k]);
    }
    CHECK_NEAR(most, plain_most, 1e-15);
    CHECK_NEAR(least, plain_least, 1e-15);
    free(basis);
    free(x);
    free(value);
}

int main(void) {
    const bd_kernel *kernel[BD_MOST_KERNELS];
    const int n = bd_kernel_all(kernel);
    CHECK(n >= 1 && n <= BD_MOST_KERNELS && bd_kernel_get());
    if (!getenv(BD_KERNEL_VARIABLE)) CHECK(kernel[0] == bd_kernel_get());
    for (int v = 0; v < n; ++v) {
        unsigned long long seed = 50;
        for (size_t m = 1; m <= 13; ++m)
            for (size_t columns = 1; columns <= 50; ++columns) {
                test_product(kernel[v], m, columns, (m + columns) % 7, &seed);
                test_add_product(kernel[v], m, columns, (m + columns) % 7, &seed);
            }
        test_product(kernel[v], 33, 112, 72, &seed);
        for (size_t pairs = 1; pairs <= 3; ++pairs)
            for (size_t columns = 1; columns <= 37; ++columns)
                test_vectors(kernel[v], pairs, columns, &seed);
        for (int n_source = 1; n_source <= 3; ++n_source) test_fill(kernel[v], n_source, &seed);
        test_grid(kernel[v], &seed);
        for (int size = 1; size <= 40; ++size) test_invert(kernel[v], size, &seed);
    }
    return check_result();
}
