/* Disks in the plane: the point that violates them least, and the nearest point that lies in all of them. */
#ifndef BD_DISKS_H
#define BD_DISKS_H

#include "bd_types.h"

typedef struct {
    int n;
    const double *x, *y, *R; /* (n) centres and radii, which are positive */
} bd_disks;

/* A point of the plane and the disks on whose edges (or at the same distance from them) it lies. */
typedef struct {
    int n, disk[3];
    double s[2];
    double value; /* its distance outside of those disks; negative inside */
} bd_hold;

/* Largest of |c_k - s| - R_k over the disks, and the disk that has it. */
double bd_disks_worst(const bd_disks *disks, const double *s, int *which);

/* The point at which that is least.  It is negative if and only if the disks have common points inside. */
void bd_disks_centre(const bd_disks *disks, double slack, bd_hold *hold);

/* The common point nearest to a given one, held by none (it is the given one), one or two disks.  There must be common
 * points, well beyond the slack that disks may be left by. */
void bd_disks_nearest(const bd_disks *disks, const double *given, double slack, bd_hold *hold);

#endif
