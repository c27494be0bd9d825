/* Equations of one sector by harmonic balance, and the same with a factor on the
 * excitation as parameter. */
#ifndef BD_BALANCE_SECTOR_H
#define BD_BALANCE_SECTOR_H

#include "balance/condensation.h"

/* Harmonic balance of one sector, lambda = omega. */
typedef struct {
    bd_dense dense;
    bd_hbm hbm;
    bd_condensation *condensation; /* NULL: dense factors */
} bd_sector;

/* A speed family needs full elimination. */
bd_status bd_sector_create(bd_sector **out, const bd_hbm_input *input, const double *row_scale,
                           const bd_lapack *lapack, bd_elimination elimination);

/* The same at fixed omega with the parameter lambda = s, a factor on the part `ramp` (n) of the
 * excitation. s also fades out the linear force `support` (n, n) row-major, unless NULL. ramp and
 * support are copied. The sector is not copied and must outlive these equations. */
bd_status bd_eased_create(bd_equations **eased, bd_sector *sector, double omega, const double *ramp,
                          const double *support);

#endif
