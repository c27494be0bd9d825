/* The corrector of one continuation step, and the peak of the response near a point: Newton on the bordered system, in one
 * call. */
#ifndef BD_NEWTON_H
#define BD_NEWTON_H

#include "bd_hbm.h"
#include "bd_lapack.h"

typedef struct {
    double tolerance; /* on the largest scaled residual */
    int max_iterations;
    int line_search;       /* 1: halve a step that does not reduce the residual */
    int least_norm;        /* 1: a rank-deficient system is solved by least norm instead of failing */
    double rank_tolerance; /* reciprocal condition below which the system counts as rank-deficient */
    const double *ramp;    /* NULL: the last unknown is omega.  Else (n): it is a factor on this part of the excitation, */
    double omega;          /* at this fixed omega, */
    const double *support; /* and with (n, n) row-major, not NULL: it fades out this linear force beside the excitation */
    double reach;          /* a Newton step longer than this in scaled unknowns is not taken: BD_NOT_CONVERGED; 0: any is */
} bd_newton_options;

typedef struct {
    int iterations;
    double residual;              /* largest scaled residual at the returned point */
    double first_step, last_step; /* lengths of the first and last Newton step, in scaled unknowns */
    double condition; /* reciprocal condition of the last factorisation (equilibrated), as far as it was asked */
                      /* for: bd_newton.c, factorise */
    int rank;         /* rank that the least-norm solution found, n + 1 where LU served */
    int orientation;  /* sign of the determinant of the last bordered matrix, 0 where it is rank-deficient */
} bd_newton_report;

typedef struct {
    bd_lapack lapack;
    int n;               /* unknowns without the frequency */
    double *r, *r_omega; /* (n) */
    double *J;           /* (n, n) row-major */
    double *A, *LU;      /* (n + 1, n + 1) row-major bordered system, equilibrated, and its factors */
    double *row;         /* (n + 1) row equilibration */
    double *b, *step;    /* (n + 1); b is scratch */
    double *y_old;       /* (n + 1) */
    double *work;
    int *pivot, *iwork;
    int lwork;
    double *memory;
} bd_newton_work;

bd_status bd_newton_create(bd_newton_work *work, int n_unknown, const bd_lapack *lapack);
void bd_newton_destroy(bd_newton_work *work);

/* y (n + 1) holds unknowns and parameter (frequency, or factor): the prediction on entry, the corrected point
 * on return.  The corrected point lies in the plane through the prediction that is normal to `normal` (n + 1) in scaled
 * unknowns z = y/scale.
 * row_scale (n) multiplies the residual.  On BD_OK tangent (n + 1, unit length in z, normal . tangent > 0) is the
 * direction of the branch; it may be NULL. */
bd_status bd_newton_correct(bd_hbm *hbm, bd_newton_work *work, const bd_newton_options *options, double *y,
                            const double *normal, const double *scale, const double *row_scale, double *tangent,
                            bd_newton_report *report);

typedef struct {
    const double *re, *im; /* (n): real and imaginary part of the response amplitude x are re . u and im . u */
    double tolerance;      /* on the distance to the peak, in scaled unknowns */
    double max_step;
    double curvature; /* d2 ln |x| along the curve, < 0: an estimate on entry, the latest secant on return */
    double slope;     /* d ln |x| at the returned point */
} bd_newton_peak_options;

/* Derivative of ln |x| along a direction (n + 1) in scaled unknowns. */
double bd_newton_slope(const bd_newton_peak_options *peak, const double *y, const double *tangent, const double *scale,
                       size_t n);

/* From a guess y (n + 1) near the curve, with an estimate of its tangent (n + 1, unit length), to the peak of |x|: the
 * curve and the place on it at once.  BD_OK only if both are met; then tangent is that of the curve.  It gives up early
 * where the peak is not near, lies at a corner, or is a minimum. */
bd_status bd_newton_peak(bd_hbm *hbm, bd_newton_work *work, const bd_newton_options *options, bd_newton_peak_options *peak,
                         double *y, double *tangent, const double *scale, const double *row_scale,
                         bd_newton_report *report);

#endif
