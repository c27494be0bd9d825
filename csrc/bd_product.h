/* Small dense products of the assembly, on one thread. */
#ifndef BD_PRODUCT_H
#define BD_PRODUCT_H

#include <stddef.h>

enum { BD_PRODUCT_PAD = 24 }; /* rows of B are padded to a multiple of this many columns */

static inline size_t bd_product_stride(size_t n) { return (n + BD_PRODUCT_PAD - 1) / BD_PRODUCT_PAD * BD_PRODUCT_PAD; }

/* C (m, n), row stride n, += A^T B with A (k, m), row stride m, and B (k, n), row stride bd_product_stride(n). */
void bd_product_add(size_t m, size_t n, size_t k, const double *A, const double *B, double *C);

/* y (rows) = A x with A (rows, columns); or y (columns) += A^T x. */
void bd_product_vector(size_t rows, size_t columns, const double *A, const double *x, double *y);
void bd_product_vector_transposed(size_t rows, size_t columns, const double *A, const double *x, double *y);

#endif
