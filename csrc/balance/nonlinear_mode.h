/* Nonlinear modes of a sector: periodic motions without excitation, of which frequency and damping are unknowns. */
#ifndef BD_BALANCE_NONLINEAR_MODE_H
#define BD_BALANCE_NONLINEAR_MODE_H

#include "balance/sector.h"

/* n + 2 unknowns: the mean, the other n - n_mode[0] unknowns of the sector over the amplitude a, omega, zeta; lambda = ln a.
 * a (re + i im) . u, with rows (n) over the vibration alone, is the amplitude; `weight` is the size of its two equations
 * beside those of motion.  row_scale (n + 2), or NULL: ones.  All is copied but the sector, which outlives this, and of
 * which the excitation of the harmonics is left out, and which is no family. */
bd_status bd_modes_create(bd_equations **modes, bd_sector *sector, const double *re, const double *im, double weight,
                          const double *row_scale);

#endif
