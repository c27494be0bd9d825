/* Table of the vectorised inner loops. The loops are compiled for several instruction sets; the
 * processor decides at run time. */
#ifndef BD_UTIL_KERNELS_H
#define BD_UTIL_KERNELS_H

#include "util/conventions.h"

enum { BD_LANES = 8 };        /* contact points per group of the sampled evaluation */
enum { BD_KERNEL_PAD = 16 };  /* numbers that may be read beyond the end of a matrix */
enum { BD_KERNEL_BLOCK = 4 }; /* columns per block of `invert` */

/* Input of fill_rows: a tangent times the modes. */
typedef struct {
    int n_harm, n_source;
    const int *n_mode, *first; /* (n_harm + 1) modes and first column of each harmonic */
    const double *block[3];    /* (n_coef, n_coef) of each source */
    /* (n_harm + 1, n_source) first row of G for each harmonic and source;
     * further rows follow in memory */
    const double *const *g;
    double *const *z; /* (n_coef) rows of the result */
} bd_fill;

/* One tangential direction of BD_LANES contact points, sampled; see contact/aft_kernel.c. */
typedef struct {
    int n_harm, n_time, interpolate;
    const double *power;    /* (n_time, n_power) powers of exp(i theta_k) */
    const double *u, *g;    /* (n_time, BD_LANES) displacement; n0 + kn v, or the constant load */
    double slope[BD_LANES]; /* mu/kt: half width of the sticking range per newton */
    double w[BD_LANES];     /* slider at the start; at the end after the call */
    int origin[BD_LANES];   /* sample that last set the slider, -1 if none */
    /* (n_power, BD_LANES) sums of powers over sticking samples; over slipping
     * samples, plus minus minus */
    double *stick, *slip;
    /* (BD_LANES, n_coef) sum of w times the basis over sticking samples */
    double *stick_slider;
    /* (BD_LANES, n_coef, n_coef) its derivatives, or NULL */
    double *stick_slider_u, *stick_slider_g;
    double *saved; /* (n_power, BD_LANES) work */
    /* (n_time, BD_LANES) work: bounds of the slider at each sample */
    double *lo, *hi;
    double *path; /* (n_time, BD_LANES) work: slider after each sample */
    /* (n_time, BD_LANES) bd_state of each sample, or NULL */
    unsigned char *state;
} bd_lanes;

/* Kind of a step of coupled friction. */
enum { BD_STEP_STICK, BD_STEP_SLIP, BD_STEP_OPEN, BD_STEP_CLOSE };

/* Quantities of a whole slip step that do not depend on the slider, as rows of an array
 * (BD_N_CHORD, n_time, BD_LANES): direction, 1 - q and length of the chord; mean of 1/R and its
 * derivatives. */
enum {
    BD_CHORD_A1,
    BD_CHORD_A2,
    BD_CHORD_P,
    BD_CHORD_LENGTH,
    BD_CHORD_L,
    BD_CHORD_L0,
    BD_CHORD_L1,
    BD_N_CHORD
};

/* Slider s (2) after a step and its derivatives A, B0, B1 (2, 2), C0 and C1 (2), as first rows of
 * an array (BD_N_STEP, n_time, BD_LANES). */
enum {
    BD_STEP_S = 0,
    BD_STEP_A = 2,
    BD_STEP_B0 = 6,
    BD_STEP_B1 = 10,
    BD_STEP_C0 = 14,
    BD_STEP_C1 = 16,
    BD_N_STEP = 18
};

/* Coupled friction at BD_LANES contact points; see contact/coupled_kernel.c. */
typedef struct {
    int n_time, interpolate;
    /* (n_time, BD_LANES) kt u; mu times the load; n0 + kn v, or the constant load */
    double *x, *y, *R, *g;
    double *chord; /* (BD_N_CHORD, n_time, BD_LANES) */
    double mu[BD_LANES];
    double s[2 * BD_LANES];   /* (2, BD_LANES) slider at the start of the period */
    double end[2 * BD_LANES]; /* slider at the end of the period */
    /* sum of the slider's movements: more accurate than end - s if the movements are small */
    double net_motion[2 * BD_LANES];
    /* (2, 2, BD_LANES) derivative of the end with respect to the start */
    double period_derivative[4 * BD_LANES];
    double *step;             /* (BD_N_STEP, n_time, BD_LANES) */
    unsigned char *step_kind; /* (n_time, BD_LANES) */
} bd_coupled_lanes;

struct bd_time;
struct bd_time_path;

typedef struct {
    const char *name;
    /* C (m, n) += A^T B with A (k, m), B (k, n); row strides m, stride_b, stride_c. */
    void (*product)(size_t m, size_t n, size_t k, const double *A, const double *B, size_t stride_b,
                    double *C, size_t stride_c);
    /* C (m, n) += alpha A B with A (m, k), B (k, n); row strides. */
    void (*add_product)(size_t m, size_t n, size_t k, double alpha, const double *A,
                        size_t stride_a, const double *B, size_t stride_b, double *C,
                        size_t stride_c);
    /* Replace A (n, n) by its inverse. pivot has one entry per row, work is (2, BD_KERNEL_BLOCK,
     * n + 8). Return the sign of the determinant, 0 if the matrix is singular. */
    int (*invert)(int n, double *A, int *pivot, double *work);
    /* z_i = sum over sources and rows of block_i times the corresponding rows of G, for all
     * coefficients i. Up to 7 numbers beyond the end of a row of z are overwritten. */
    void (*fill_rows)(const bd_fill *fill);
    /* y (rows) = A x, and y (columns) += A^T x. */
    void (*multiply)(size_t rows, size_t columns, const double *A, const double *x, double *y);
    void (*multiply_transposed)(size_t rows, size_t columns, const double *A, const double *x,
                                double *y);
    /* Motion of one harmonic l > 0. Only the first row a of each row pair of A (2 pairs, columns)
     * is read: y_2i = a.x and y_2i+1 = a.x_turned. */
    void (*multiply_pairs)(size_t pairs, size_t columns, const double *A, const double *x,
                           const double *x_turned, double *y);
    /* Values of n_poly polynomials (n_poly, n_coef) on a grid; n_time is a multiple of 16. */
    void (*grid_values)(int n_coef, int n_time, const double *basis, int n_poly, const double *x,
                        double *value);
    /* Largest a - r b and smallest a + r b over n samples; n is a multiple of 8. */
    void (*bounds)(int n, double r, const double *a, const double *b, double *largest,
                   double *smallest);
    /* Two periods: settle finds the slider of the steady cycle and the sample that set it,
     * sum_cycle adds up the cycle. */
    void (*settle)(bd_lanes *lanes);
    void (*sum_cycle)(bd_lanes *lanes);
    /* Values (n_time, BD_LANES) of polynomials (n_coef, BD_LANES). */
    void (*lane_values)(int n_coef, int n_time, const double *power, int n_power, const double *x,
                        double *value);
    /* E (n_power, BD_LANES) = sum of powers over the samples with g > 0. */
    void (*lane_contact)(int n_power, int n_time, const double *power, const double *g, double *E);
    /* One period of coupled friction. With `store` the steps are stored, with `tangent`
     * also their derivatives. */
    void (*coupled_period)(bd_coupled_lanes *lanes, int store, int tangent);
    void (*coupled_chords)(bd_coupled_lanes *lanes, int tangent); /* fills chord; required before */
    /* Time integration, and the contact forces at one instant; see time/generalised_alpha.c. */
    bd_status (*integrate)(struct bd_time *time, const struct bd_time_path *path);
    void (*contact_at_instant)(struct bd_time *time);
    /* Largest |c - s| - R over n disks and its index; n is a multiple of 8. */
    double (*disk_violation)(int n, const double *x, const double *y, const double *R,
                             const double *s, int *which);
} bd_kernel;

/* Row stride of the matrices between fill_rows and product: whole vectors may
 * cross the end of a row. */
static inline size_t bd_kernel_stride(size_t n) { return (n + 14) / 8 * 8; }

/* All builds that run on this processor, fastest first; return their number. */
enum { BD_MOST_KERNELS = 4 };
int bd_kernel_all(const bd_kernel **kernel);

/* The fastest build, or the build named by this environment variable (tests run under each). NULL
 * if this processor has no such build. */
#define BD_KERNEL_VARIABLE "BDAMPER_KERNEL"
const bd_kernel *bd_kernel_get(void);

#endif
