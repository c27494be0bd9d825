/* Dense inner loops in vector registers, built for several instruction sets and chosen at run time. */
#ifndef BD_UTIL_KERNELS_H
#define BD_UTIL_KERNELS_H

#include "util/conventions.h"

enum { BD_LANES = 8 };        /* contact points that the sampled evaluation takes together */
enum { BD_KERNEL_PAD = 16 };  /* numbers that may be read behind the end of a matrix */
enum { BD_KERNEL_BLOCK = 4 }; /* columns that `invert` eliminates together */

/* Rows of a tangent times the modes: see fill_rows below. */
typedef struct {
    int n_harm, n_source;
    const int *n_mode, *first; /* (n_harm + 1) modes and first column of each harmonic */
    const double *block[3];    /* (n_coef, n_coef) of each source */
    const double *const *g;    /* (n_harm + 1, n_source) first row of G for that harmonic and source; rows follow */
    double *const *z;          /* (n_coef) rows to write */
} bd_fill;

/* One tangential direction of BD_LANES contact points, sampled: see bd_lanes.c. */
typedef struct {
    int n_harm, n_time, interpolate;
    const double *power;    /* (n_time, n_power) powers of exp(i theta_k) */
    const double *u, *g;    /* (n_time, BD_LANES) displacement; n0 + kn v, or the constant load */
    double slope[BD_LANES]; /* mu/kt: half width of the sticking range for each newton */
    double w[BD_LANES];     /* slider at the start, and at the end */
    int origin[BD_LANES];   /* sample that set the slider, -1 if none did */
    double *stick, *slip;   /* (n_power, BD_LANES) sums of powers over samples that stick, slip plus minus minus */
    double *stick_slider;   /* (BD_LANES, n_coef) sum of w times the basis over samples that stick */
    double *stick_slider_u, *stick_slider_g; /* (BD_LANES, n_coef, n_coef) its derivatives, or NULL */
    double *saved;                           /* (n_power, BD_LANES) work */
    double *lo, *hi;                         /* (n_time, BD_LANES) work: the clip of each sample */
    double *path;                            /* (n_time, BD_LANES) work: the slider after each sample */
    unsigned char *state;                    /* (n_time, BD_LANES) bd_state of each sample, or NULL */
} bd_lanes;

/* What a step of coupled friction was. */
enum { BD_STEP_STICK, BD_STEP_SLIP, BD_STEP_OPEN, BD_STEP_CLOSE };

/* Coupled friction at BD_LANES contact points: see bd_slide.c. */
typedef struct {
    int n_time, interpolate;
    double *x, *y, *R, *g; /* (n_time, BD_LANES) kt u; mu times the load; n0 + kn v, or the constant load */
    double *chord;         /* (7, n_time, BD_LANES) of the whole step to a sample what does not depend on the slider */
    double mu[BD_LANES];
    double s[2 * BD_LANES];                 /* (2, BD_LANES) slider at the start of the period */
    double end[2 * BD_LANES];               /* at its end */
    double net_motion[2 * BD_LANES];        /* sum of its movements: more exact than the difference where these are small */
    double period_derivative[4 * BD_LANES]; /* (2, 2, BD_LANES) derivative of the end with respect to the start */
    double *step;                           /* (18, n_time, BD_LANES) s, A, B0, B1 (2, 2), C0, C1 (2) of each step */
    unsigned char *step_kind;               /* (n_time, BD_LANES) */
} bd_coupled_lanes;

struct bd_time;
struct bd_time_path;

typedef struct {
    const char *name;
    /* C (m, n) += A^T B with A (k, m), B (k, n); row strides m, stride_b, stride_c. */
    void (*product)(size_t m, size_t n, size_t k, const double *A, const double *B, size_t stride_b, double *C,
                    size_t stride_c);
    /* C (m, n) += alpha A B with A (m, k), B (k, n); row strides. */
    void (*add_product)(size_t m, size_t n, size_t k, double alpha, const double *A, size_t stride_a, const double *B,
                        size_t stride_b, double *C, size_t stride_c);
    /* A (n, n) becomes its inverse, with a pivot for every row and work (2, BD_KERNEL_BLOCK, n + 8); the sign of its
     * determinant, 0 if that is singular. */
    int (*invert)(int n, double *A, int *pivot, double *work);
    /* z_i = sum over sources and rows of block_i times the rows of G that belong to them, for all coefficients i.
     * Up to 7 numbers behind the end of a row of z are overwritten. */
    void (*fill_rows)(const bd_fill *fill);
    /* y (rows) = A x, and y (columns) += A^T x. */
    void (*multiply)(size_t rows, size_t columns, const double *A, const double *x, double *y);
    void (*multiply_transposed)(size_t rows, size_t columns, const double *A, const double *x, double *y);
    /* Motion of one harmonic above 0: of every row pair of A (2 pairs, columns) only the first is read, with
     * y_2i = a.x, y_2i+1 = a.x_turned. */
    void (*multiply_pairs)(size_t pairs, size_t columns, const double *A, const double *x, const double *x_turned,
                           double *y);
    /* Values of n_poly polynomials (n_poly, n_coef) on a grid whose n_time is a multiple of 16. */
    void (*grid_values)(int n_coef, int n_time, const double *basis, int n_poly, const double *x, double *value);
    /* Largest of a - r b and smallest of a + r b over n samples, n a multiple of 8. */
    void (*bounds)(int n, double r, const double *a, const double *b, double *largest, double *smallest);
    /* Two periods: the first (settle) finds the slider and what set it, the second sums. */
    void (*settle)(bd_lanes *lanes);
    void (*sum_cycle)(bd_lanes *lanes);
    /* values (n_time, BD_LANES) of polynomials (n_coef, BD_LANES). */
    void (*lane_values)(int n_coef, int n_time, const double *power, int n_power, const double *x, double *value);
    /* E (n_power, BD_LANES) = sum of powers over the samples at which g > 0. */
    void (*lane_contact)(int n_power, int n_time, const double *power, const double *g, double *E);
    /* One period of coupled friction; `kept` stores the steps, with their derivatives if `tangent`. */
    void (*coupled_period)(bd_coupled_lanes *lanes, int kept, int tangent);
    void (*coupled_chords)(bd_coupled_lanes *lanes, int tangent); /* before it: way */
    /* March in time, and the contacts at one instant: see bd_time_loop.c. */
    bd_status (*integrate)(struct bd_time *time, const struct bd_time_path *path);
    void (*contact_at_instant)(struct bd_time *time);
    /* Largest of |c - s| - R over n disks, n a multiple of 8, and which of them has it. */
    double (*disk_violation)(int n, const double *x, const double *y, const double *R, const double *s, int *which);
} bd_kernel;

/* Row stride of the matrices that fill_rows writes and product reads: whole vectors can run over the end of a row. */
static inline size_t bd_kernel_stride(size_t n) { return (n + 14) / 8 * 8; }

/* All builds that this machine runs, fastest first; returns their number. */
enum { BD_MOST_KERNELS = 4 };
int bd_kernel_all(const bd_kernel **kernel);

/* The fastest, or the one that this environment variable names: tests run under each.  NULL if this machine has none of
 * that name. */
#define BD_KERNEL_VARIABLE "BDAMPER_KERNEL"
const bd_kernel *bd_kernel_get(void);

#endif
