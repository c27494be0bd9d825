/* One block of memory cut into arrays. */
#ifndef BD_UTIL_STORAGE_H
#define BD_UTIL_STORAGE_H

#include <stddef.h>

/* Return the next n numbers of a block, and advance to the rest. */
static inline double *bd_take(double **rest, size_t n) {
    double *taken = *rest;
    *rest += n;
    return taken;
}

#endif
