/* Disks in the plane: the point of least violation, and the entry of a line into all disks. */
#ifndef BD_CONTACT_FRICTION_DISKS_H
#define BD_CONTACT_FRICTION_DISKS_H

#include "util/kernels.h"

typedef struct {
    int n;                   /* a multiple of 8; unused disks have an infinite radius */
    const double *x, *y, *R; /* (n) centres and positive radii */
    const bd_kernel *kernel;
} bd_disks;

/* A point of the plane, and the disks that determine it: it lies on their edges, or at an equal
 * distance from them. */
typedef struct {
    int n, disk[3];
    double s[2];
    double value; /* its distance outside those disks; negative inside */
} bd_disk_point;

/* Largest of |c_k - s| - R_k over the disks, and its disk. */
static inline double bd_disks_violation(const bd_disks *disks, const double *s, int *which) {
    return disks->kernel->disk_violation(disks->n, disks->x, disks->y, disks->R, s, which);
}

/* The point with the least such value. The value is negative if and only if the disks have common
 * interior points. */
void bd_disks_centre(const bd_disks *disks, double slack, bd_disk_point *point);

/* Fraction of the line from a point to a point inside all disks, after which the line is in all of
 * them, and the disk that it enters last. 0 if the line starts inside all disks; `which` is then
 * not written. */
double bd_disks_entry(const bd_disks *disks, const double *from, const double *to, int *which);

#endif
