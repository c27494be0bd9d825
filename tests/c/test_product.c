/* Matrix products against three loops, for every remainder of the tiles. */
#include "bd_product.h"
#include "check.h"

static double *random_numbers(size_t n, unsigned long long *seed) {
    double *x = not_numbers(n);
    for (size_t i = 0; i < n; ++i) x[i] = uniform(seed);
    return x;
}

static void test_add(size_t m, size_t n, size_t k, unsigned long long *seed) {
    const size_t stride = bd_product_stride(n);
    CHECK(stride >= n && stride < n + BD_PRODUCT_PAD && stride % BD_PRODUCT_PAD == 0);
    double *A = random_numbers(k * m, seed), *B = random_numbers(k * stride, seed), *C = random_numbers(m * n, seed);
    double *expected = not_numbers(m * n);
    for (size_t i = 0; i < m; ++i)
        for (size_t j = 0; j < n; ++j) {
            double sum = C[i * n + j];
            for (size_t p = 0; p < k; ++p) sum += A[p * m + i] * B[p * stride + j];
            expected[i * n + j] = sum;
        }
    bd_product_add(m, n, k, A, B, C);
    for (size_t i = 0; i < m * n; ++i) CHECK_NEAR(C[i], expected[i], 1e-13);
    free(A);
    free(B);
    free(C);
    free(expected);
}

static void test_vectors(size_t rows, size_t columns, unsigned long long *seed) {
    double *A = random_numbers(rows * columns, seed), *x = random_numbers(columns, seed), *y = not_numbers(rows);
    double *z = random_numbers(rows, seed), *t = random_numbers(columns, seed), *expected = not_numbers(columns);
    z[0] = 0.0; /* rows with a zero are skipped */
    for (size_t j = 0; j < columns; ++j) {
        expected[j] = t[j];
        for (size_t i = 0; i < rows; ++i) expected[j] += A[i * columns + j] * z[i];
    }
    bd_product_vector(rows, columns, A, x, y);
    bd_product_vector_transposed(rows, columns, A, z, t);
    for (size_t i = 0; i < rows; ++i) {
        double sum = 0.0;
        for (size_t j = 0; j < columns; ++j) sum += A[i * columns + j] * x[j];
        CHECK_NEAR(y[i], sum, 1e-13);
    }
    for (size_t j = 0; j < columns; ++j) CHECK_NEAR(t[j], expected[j], 1e-13);
    free(A);
    free(x);
    free(y);
    free(z);
    free(t);
    free(expected);
}

int main(void) {
    unsigned long long seed = 50;
    for (size_t m = 1; m <= 9; ++m)
        for (size_t n = 1; n <= 50; ++n) test_add(m, n, (m + n) % 7, &seed);
    test_add(33, 112, 72, &seed);
    test_add(1, 1, 0, &seed);
    for (size_t rows = 1; rows <= 6; ++rows)
        for (size_t columns = 1; columns <= 13; ++columns) test_vectors(rows, columns, &seed);
    return check_result();
}
