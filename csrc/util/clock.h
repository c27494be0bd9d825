/* Clocks. */
#ifndef BD_UTIL_CLOCK_H
#define BD_UTIL_CLOCK_H

/* Seconds since some instant. */
double bd_seconds(void);

/* Seconds that a processor has spent on this thread (on this process, where the system counts no threads). */
double bd_processor_seconds(void);

#endif
