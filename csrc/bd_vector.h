/* Vectors of doubles of the width that the present build has in registers. */
#ifndef BD_VECTOR_H
#define BD_VECTOR_H

#include <stdint.h>
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
#define BD_JOIN_(a, b) a##b
#define BD_JOIN(a, b) BD_JOIN_(a, b)

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
/* mask ? a : b */
BD_INLINE bd_vec bd_select(bd_mask mask, bd_vec a, bd_vec b) {
    return (bd_vec)((mask & (bd_mask)a) | (~mask & (bd_mask)b));
}
BD_INLINE bd_vec bd_max(bd_vec a, bd_vec b) {
#if BD_WIDTH == 8
    return (bd_vec)_mm512_max_pd((__m512d)a, (__m512d)b);
#elif BD_WIDTH == 4
    return (bd_vec)_mm256_max_pd((__m256d)a, (__m256d)b);
#elif defined(__SSE2__)
    return (bd_vec)_mm_max_pd((__m128d)a, (__m128d)b);
#else
    return bd_select((bd_mask)(a > b), a, b);
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
    return bd_select((bd_mask)(a < b), a, b);
#endif
}
/* Whether any entry of a mask is set. */
BD_INLINE int bd_any(bd_mask m) {
#if BD_WIDTH == 8
    return _mm512_test_epi64_mask((__m512i)m, (__m512i)m) != 0;
#elif BD_WIDTH == 4
    return _mm256_movemask_pd((__m256d)m) != 0;
#else
    return (m[0] | m[1]) != 0;
#endif
}
BD_INLINE double bd_sum(bd_vec x) {
    double s = 0.0;
    for (int i = 0; i < BD_WIDTH; ++i) s += x[i];
    return s;
}

#endif
