/* Nonlinear modes of a sector: periodic motions without excitation, with unknown
 * frequency and damping. */
#ifndef BD_BALANCE_NONLINEAR_MODE_H
#define BD_BALANCE_NONLINEAR_MODE_H

#include "balance/sector.h"

/* The n + 2 unknowns are the mean coordinates, the other n - n_mode[0] unknowns of the sector
 * divided by the amplitude a, omega and zeta. The parameter is lambda = ln a. The amplitude is a
 * (re + i im) . u, with rows (n) on the vibration only; `weight` scales its two equations relative
 * to the equations of motion. row_scale (n + 2), or NULL: ones. Everything is copied except the
 * sector, which must outlive these equations. The excitation of the harmonics is ignored. A speed
 * family is not supported. */
bd_status bd_modes_create(bd_equations **modes, bd_sector *sector, const double *re,
                          const double *im, double weight, const double *row_scale);

#endif
