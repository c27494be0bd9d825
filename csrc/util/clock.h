/* Clocks. */
#ifndef BD_UTIL_CLOCK_H
#define BD_UTIL_CLOCK_H

/* Seconds since a fixed instant. */
double bd_seconds(void);

/* Processor seconds of this thread, or of the process if the system does not count threads. */
double bd_processor_seconds(void);

#endif
