/* Choice of the build of the inner loops at run time. */
#include "util/kernels.h"
#include "util/vector_types.h"

#include <stdlib.h>

extern const bd_kernel bd_kernel_plain;
#ifndef BD_PLAIN
extern const bd_kernel bd_kernel_generic;
#endif
#ifdef BD_HAVE_AVX2
extern const bd_kernel bd_kernel_avx2;
#endif
#ifdef BD_HAVE_AVX512
extern const bd_kernel bd_kernel_avx512;
#endif

int bd_kernel_all(const bd_kernel **kernel) {
    int n = 0;
#ifdef BD_HAVE_AVX512
    if (bd_runs_avx512()) kernel[n++] = &bd_kernel_avx512;
#endif
#ifdef BD_HAVE_AVX2
    if (bd_runs_avx2()) kernel[n++] = &bd_kernel_avx2;
#endif
#ifndef BD_PLAIN
    kernel[n++] = &bd_kernel_generic;
#endif
    kernel[n++] = &bd_kernel_plain;
    return n;
}

const bd_kernel *bd_kernel_get(void) {
    const bd_kernel *kernel[BD_MOST_KERNELS];
    const int n = bd_kernel_all(kernel);
    const char *name = getenv(BD_KERNEL_VARIABLE);
    if (!name || !*name) return kernel[0];
    for (int i = 0; i < n; ++i)
        if (strcmp(kernel[i]->name, name) == 0) return kernel[i];
    return NULL;
}
