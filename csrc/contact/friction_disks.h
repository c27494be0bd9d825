/* Disks in the plane: the point that violates them least, and the way into all of them. */
#ifndef BD_CONTACT_FRICTION_DISKS_H
#define BD_CONTACT_FRICTION_DISKS_H

#include "util/kernels.h"

typedef struct {
    int n;                   /* a multiple of 8; disks beyond those there are have an infinite radius */
    const double *x, *y, *R; /* (n) centres and radii, which are positive */
    const bd_kernel *kernel;
} bd_disks;

/* A point of the plane and the disks on whose edges (or at the same distance from them) it lies. */
typedef struct {
    int n, disk[3];
    double s[2];
    double value; /* its distance outside of those disks; negative inside */
} bd_disk_point;

/* Largest of |c_k - s| - R_k over the disks, and the disk that has it. */
static inline double bd_disks_violation(const bd_disks *disks, const double *s, int *which) {
    return disks->kernel->disk_violation(disks->n, disks->x, disks->y, disks->R, s, which);
}

/* The point at which that is least.  It is negative if and only if the disks have common points inside. */
void bd_disks_centre(const bd_disks *disks, double slack, bd_disk_point *hold);

/* Share of the way from a point to one inside of all disks after which it lies in all of them, and the disk that is entered
 * last; 0 if it lies in all of them from the start (which is not written then). */
double bd_disks_entry(const bd_disks *disks, const double *from, const double *to, int *which);

#endif
