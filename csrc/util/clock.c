/* Clocks of POSIX if available, otherwise clocks of C. */
#define _POSIX_C_SOURCE 199309L
#include "util/clock.h"

#include <time.h>

static double in_seconds(struct timespec t) { return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec; }

double bd_seconds(void) {
    struct timespec now;
#ifdef CLOCK_MONOTONIC
    if (clock_gettime(CLOCK_MONOTONIC, &now) == 0) return in_seconds(now);
#endif
    timespec_get(&now, TIME_UTC);
    return in_seconds(now);
}

double bd_processor_seconds(void) {
#ifdef CLOCK_THREAD_CPUTIME_ID
    struct timespec now;
    if (clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now) == 0) return in_seconds(now);
#endif
    return (double)clock() / CLOCKS_PER_SEC;
}
