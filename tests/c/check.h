/* Checks for the C tests. Each failed check prints a line; the program then ends with a nonzero
 * exit code. */
#ifndef CHECK_H
#define CHECK_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static int n_checks, n_failures;

#define CHECK(condition)                                                                           \
    do {                                                                                           \
        ++n_checks;                                                                                \
        if (!(condition)) {                                                                        \
            ++n_failures;                                                                          \
            printf("%s:%d: %s\n", __FILE__, __LINE__, #condition);                                 \
        }                                                                                          \
    } while (0)

/* |value - expected| <= tolerance; a NaN fails. */
#define CHECK_NEAR(value, expected, tolerance)                                                     \
    do {                                                                                           \
        const double check_a = (value), check_b = (expected);                                      \
        ++n_checks;                                                                                \
        if (!(fabs(check_a - check_b) <= (tolerance))) {                                           \
            ++n_failures;                                                                          \
            printf("%s:%d: %s is %.17g, expected %.17g\n", __FILE__, __LINE__, #value, check_a,    \
                   check_b);                                                                       \
        }                                                                                          \
    } while (0)

static inline int check_result(void) {
    printf("%d checks, %d failures\n", n_checks, n_failures);
    return n_failures == 0 && n_checks > 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

/* Reproducible numbers, uniform in [-1, 1]. */
static inline double uniform(unsigned long long *seed) {
    *seed = *seed * 6364136223846793005ULL + 1442695040888963407ULL;
    return (double)(*seed >> 11) / 4503599627370496.0 - 1.0;
}

static inline double *not_numbers(size_t n) {
    double *x = malloc(sizeof(double) * (n > 0 ? n : 1));
    if (!x) abort();
    for (size_t i = 0; i < n; ++i) x[i] = NAN;
    return x;
}

#endif
