/* Which build of the inner loops this machine runs. */
#include "bd_kernel.h"

extern const bd_kernel bd_kernel_generic;
#ifdef BD_HAVE_X86
extern const bd_kernel bd_kernel_avx2, bd_kernel_avx512;
#endif

int bd_kernel_all(const bd_kernel **kernel) {
    int n = 0;
#ifdef BD_HAVE_X86
    const int avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    if (avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) kernel[n++] = &bd_kernel_avx512;
    if (avx2) kernel[n++] = &bd_kernel_avx2;
#endif
    kernel[n++] = &bd_kernel_generic;
    return n;
}

const bd_kernel *bd_kernel_get(void) {
    const bd_kernel *kernel[3];
    bd_kernel_all(kernel);
    return kernel[0];
}
