/* SECTORHEAD */
#ifndef BD_BALANCE_SECTOR_H
#define BD_BALANCE_SECTOR_H

#include "balance/harmonic_balance.h"
#include "solver/dense.h"

/* The harmonic balance of one sector, lambda = omega. */
typedef struct {
    bd_dense dense;
    bd_hbm hbm;
} bd_sector;

bd_status bd_sector_create(bd_sector **sector, const bd_hbm_input *input, const double *row_scale, const bd_lapack *lapack);

/* The same at fixed omega with a factor s, lambda = s, on the part `ramp` (n) of the excitation.  With support (n, n)
 * row-major, not NULL, s also fades out this linear force beside the excitation.  Both are copied; the sector is not, and
 * outlives this. */
bd_status bd_eased_create(bd_equations **eased, bd_sector *sector, double omega, const double *ramp, const double *support);

#endif
