/* Vectors of doubles as wide as the registers of this build, and all other extensions of C17.
 *
 * With BD_PLAIN a vector is a single number and the header is plain C17; files that include it do
 * not change. In a mask, all bits of an entry are equal. */
#ifndef BD_UTIL_VECTOR_TYPES_H
#define BD_UTIL_VECTOR_TYPES_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define BD_JOIN_(a, b) a##b
#define BD_JOIN(a, b) BD_JOIN_(a, b)

#ifdef BD_PLAIN

#define BD_WIDTH 1
#define BD_INLINE static inline
#define BD_NOT_INLINE static

typedef double bd_vec;
typedef int64_t bd_mask;

BD_INLINE bd_vec bd_load(const double *p) { return *p; }
BD_INLINE void bd_store(double *p, bd_vec x) { *p = x; }
BD_INLINE bd_vec bd_all(double x) { return x; }
BD_INLINE bd_mask bd_all_int(int64_t i) { return i; }
BD_INLINE double bd_entry(bd_vec x, size_t i) { return (void)i, x; }
BD_INLINE int64_t bd_entry_int(bd_mask x, size_t i) { return (void)i, x; }
BD_INLINE bd_vec bd_select(bd_mask mask, bd_vec a, bd_vec b) { return mask ? a : b; }
BD_INLINE bd_mask bd_above(bd_vec a, bd_vec b) { return -(bd_mask)(a > b); }
BD_INLINE bd_mask bd_at_least(bd_vec a, bd_vec b) { return -(bd_mask)(a >= b); }
BD_INLINE bd_mask bd_equal(bd_vec a, bd_vec b) { return -(bd_mask)(a == b); }
BD_INLINE bd_mask bd_equal_int(bd_mask a, bd_mask b) { return -(bd_mask)(a == b); }
BD_INLINE bd_vec bd_max(bd_vec a, bd_vec b) { return a > b ? a : b; }
BD_INLINE bd_vec bd_min(bd_vec a, bd_vec b) { return a < b ? a : b; }
BD_INLINE bd_vec bd_root(bd_vec x) { return sqrt(x); }
BD_INLINE int bd_any(bd_mask m) { return m != 0; }
BD_INLINE bd_mask bd_bits(bd_vec x) {
    bd_mask bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}
BD_INLINE bd_vec bd_of_bits(bd_mask bits) {
    bd_vec x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static inline int bd_runs_avx2(void) { return 0; }
static inline int bd_runs_avx512(void) { return 0; }

#else /* vector types of GCC and Clang */

#if defined(__AVX2__)
#include <immintrin.h>
#elif defined(__SSE2__)
#include <emmintrin.h>
#endif

#if defined(__AVX512F__)
#define BD_WIDTH 8
#elif defined(__AVX2__)
#define BD_WIDTH 4
#else
#define BD_WIDTH 2
#endif

#define BD_INLINE static inline __attribute__((always_inline))
#define BD_NOT_INLINE static __attribute__((noinline))

typedef double bd_vec __attribute__((vector_size(8 * BD_WIDTH), aligned(8), may_alias));
typedef int64_t bd_mask __attribute__((vector_size(8 * BD_WIDTH), aligned(8), may_alias));

BD_INLINE bd_vec bd_load(const double *p) { return *(const bd_vec *)p; }
BD_INLINE void bd_store(double *p, bd_vec x) { *(bd_vec *)p = x; }
BD_INLINE bd_vec bd_all(double x) {
#if BD_WIDTH == 8
    return (bd_vec){x, x, x, x, x, x, x, x};
#elif BD_WIDTH == 4
    return (bd_vec){x, x, x, x};
#else
    return (bd_vec){x, x};
#endif
}
BD_INLINE bd_mask bd_all_int(int64_t i) { return (bd_mask){0} + i; }
BD_INLINE double bd_entry(bd_vec x, size_t i) { return x[i]; }
BD_INLINE int64_t bd_entry_int(bd_mask x, size_t i) { return x[i]; }
BD_INLINE bd_mask bd_bits(bd_vec x) { return (bd_mask)x; }
BD_INLINE bd_vec bd_of_bits(bd_mask bits) { return (bd_vec)bits; }
BD_INLINE bd_vec bd_select(bd_mask mask, bd_vec a, bd_vec b) {
    return (bd_vec)((mask & (bd_mask)a) | (~mask & (bd_mask)b));
}
BD_INLINE bd_mask bd_above(bd_vec a, bd_vec b) { return (bd_mask)(a > b); }
BD_INLINE bd_mask bd_at_least(bd_vec a, bd_vec b) { return (bd_mask)(a >= b); }
BD_INLINE bd_mask bd_equal(bd_vec a, bd_vec b) { return (bd_mask)(a == b); }
BD_INLINE bd_mask bd_equal_int(bd_mask a, bd_mask b) { return (bd_mask)(a == b); }
BD_INLINE bd_vec bd_max(bd_vec a, bd_vec b) {
#if BD_WIDTH == 8
    return (bd_vec)_mm512_max_pd((__m512d)a, (__m512d)b);
#elif BD_WIDTH == 4
    return (bd_vec)_mm256_max_pd((__m256d)a, (__m256d)b);
#elif defined(__SSE2__)
    return (bd_vec)_mm_max_pd((__m128d)a, (__m128d)b);
#else
    return bd_select(bd_above(a, b), a, b);
#endif
}
BD_INLINE bd_vec bd_min(bd_vec a, bd_vec b) {
#if BD_WIDTH == 8
    return (bd_vec)_mm512_min_pd((__m512d)a, (__m512d)b);
#elif BD_WIDTH == 4
    return (bd_vec)_mm256_min_pd((__m256d)a, (__m256d)b);
#elif defined(__SSE2__)
    return (bd_vec)_mm_min_pd((__m128d)a, (__m128d)b);
#else
    return bd_select(bd_above(b, a), a, b);
#endif
}
BD_INLINE bd_vec bd_root(bd_vec x) {
#if BD_WIDTH == 8
    return (bd_vec)_mm512_sqrt_pd((__m512d)x);
#elif BD_WIDTH == 4
    return (bd_vec)_mm256_sqrt_pd((__m256d)x);
#elif defined(__SSE2__)
    return (bd_vec)_mm_sqrt_pd((__m128d)x);
#else
    return (bd_vec){sqrt(x[0]), sqrt(x[1])};
#endif
}
/* Return whether any entry of a mask is set. */
BD_INLINE int bd_any(bd_mask m) {
#if BD_WIDTH == 8
    return _mm512_test_epi64_mask((__m512i)m, (__m512i)m) != 0;
#elif BD_WIDTH == 4
    return _mm256_movemask_pd((__m256d)m) != 0;
#else
    return (m[0] | m[1]) != 0;
#endif
}

/* Instruction sets of the processor. */
#if defined(__x86_64__)
static inline int bd_runs_avx2(void) {
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
}
static inline int bd_runs_avx512(void) {
    return bd_runs_avx2() && __builtin_cpu_supports("avx512f") &&
           __builtin_cpu_supports("avx512dq");
}
#else
static inline int bd_runs_avx2(void) { return 0; }
static inline int bd_runs_avx512(void) { return 0; }
#endif

#endif /* BD_PLAIN */

BD_INLINE bd_mask bd_differ(bd_vec a, bd_vec b) { return ~bd_equal(a, b); }
BD_INLINE double bd_sum(bd_vec x) {
    double s = 0.0;
    for (size_t i = 0; i < BD_WIDTH; ++i) s += bd_entry(x, i);
    return s;
}

#endif
