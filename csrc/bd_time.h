/* March in time of all sectors of a structure, each with contacts and sliders of its own. */
#ifndef BD_TIME_H
#define BD_TIME_H

#include "bd_element.h"
#include "bd_kernel.h"

/* Coordinates eta of all families, one family after the other; n_total in all.  A vector of them is (2, n_total): real and
 * imaginary parts. */
typedef struct {
    int n_sector, n_point, n_family;
    const int *n_mode;   /* (n_family) */
    const int *diameter; /* (n_family) 0..n_sector-1; families of 0 and n_sector/2 have real coordinates */
    const double *stiffness, *mass, *damping; /* (n_total); coordinates of mass 0 follow the contact condition */
    const double *G;                          /* complex, family after family (n_point, 3, n_mode) */
    const double *kt, *kn, *mu, *n0, *load;   /* (n_point, 2), (n_point) four times */
    const double *shift;                      /* (n_point, 3) */
    const int *law;                           /* (n_point) */
    const int *held;                          /* (n_point, 2) sliders that stay where they are */
    int n_force;
    const int *order;    /* (n_force) harmonics of the excitation */
    const double *force; /* (n_force, 2, 2, n_total): the factors of cos and of sin(order theta) */
    const double *row;   /* (2, n_total): response = row . (Re eta, Im eta) */
} bd_time_input;

/* Instants at which the contact condition was solved, evaluations of the law for them, those left above the tolerance. */
typedef struct {
    long n_solved, n_iteration, n_unsolved;
} bd_time_effort;

typedef struct bd_time {
    const bd_kernel *kernel;
    int n_sector, n_point, n_family, n_total, n_force, n_slack; /* n_slack: real coordinates without mass */
    int *n_mode, *n_heavy, *first,
        *is_real;       /* (n_family) modes, those with mass, which come first; first padded coordinate */
    int *place, *other; /* (n_total) padded coordinates of the real and imaginary part */
    int *slack;         /* (n_slack) padded coordinate */
    int *order;
    size_t n_coordinate; /* padded: each family has room for a multiple of 8 modes, first real then imaginary parts */
    size_t stride;       /* points, padded to a multiple of 8 */
    int has_coupled, has_cubic;
    double *out, *back;               /* modes, in the orders in which the two products read them */
    double *phase;                    /* (n_sector, n_family, 2) cos and sin(2 pi k d/n) */
    double *omega2, *damping, *share; /* (n_coordinate), over the modal mass; share: 1/(N m) or 2/(N m) */
    double *force, *row;              /* (n_force, 2, n_coordinate), over the modal mass; (n_coordinate) */
    double *point;                    /* (BD_TIME_FIELDS, stride) */
    double *q, *v, *a, *pressed;      /* (n_coordinate) */
    double *w, *moved;                /* (n_sector, 2, stride) */
    double *base, *y, *z;             /* (n_family, 2, 3, stride) amplitudes of motion and force; base: with mass alone */
    /* of the contact condition */
    double *stiffness, *part;  /* (n_slack); part: 1/N or 2/N */
    double *push;              /* (n_force, 2, n_slack) excitation */
    double *rows;              /* (n_sector, n_point, 3, n_slack) motion by the coordinates without mass */
    double *tangent;           /* (n_sector, n_point, 9) derivative of the forces that is in H */
    double *state;             /* (n_sector, stride) the state to which it belongs */
    double *H, *lu, *closed;   /* (n_slack, n_slack), its factors, and those with every contact closed and stuck */
    double *residual, *before; /* (n_slack) */
    int *pivot, *pivot_closed; /* (n_slack) */
    int has_changed;           /* H differs from its factors */
    double largest;            /* force so far, to which the residual is compared */
    bd_time_effort effort;
    double *work; /* (3 n_total), while it is made */
    double *memory;
    int *numbers;
} bd_time;

/* What is known of a point, in the order of bd_time.point.  Limit of friction r0 + r1 N; ease: 1/kt, 0 without spring;
 * floor: the least normal force, 0 or minus infinity; masks 1 or 0. */
enum {
    BD_TIME_KT,
    BD_TIME_EASE = 2,
    BD_TIME_CUBIC = 4,
    BD_TIME_HELD = 6,
    BD_TIME_SHIFT = 8,
    BD_TIME_KN = 11,
    BD_TIME_N0,
    BD_TIME_FLOOR,
    BD_TIME_R0,
    BD_TIME_R1,
    BD_TIME_COUPLED,
    BD_TIME_FIELDS
};

/* Largest residual of the contact condition relative to its forces; iterations by Newton's method, and after these. */
#define BD_TIME_TOLERANCE 1e-12
enum { BD_TIME_NEWTON = 30, BD_TIME_CHORD = 2000 };

/* Where a march goes.  The instants are those of equal steps of the angle, theta_k = 2 pi k/per_period; the frequency goes
 * from omega to omega_end linearly in time, so that its square is linear in the angle. */
typedef struct bd_time_path {
    long n_step, first; /* the first step starts at theta_first */
    int per_period, n_harm;
    double omega, omega_end;
    double *harmonic; /* complex (n_step/per_period, n_harm + 1) of the response in each whole period, or NULL */
    double *trace;    /* (n_step, 2, n_total) coordinates at the start of each step, or NULL */
} bd_time_path;

bd_status bd_time_create(bd_time *time, const bd_time_input *input);
void bd_time_destroy(bd_time *time);

/* Coordinates out of the layout of the loop: x (2, n_total). */
void bd_time_unpad(const bd_time *time, const double *padded, double *x);

/* Factors of a matrix (n, n) in place, with row exchanges, and a solution with them.  They suit a handful of unknowns. */
void bd_time_factor(int n, double *A, int *pivot);
void bd_time_solve(int n, const double *A, const int *pivot, double *x);

/* Adds to a matrix (n_slack, n_slack) what forces with the derivative D (3, 3) at a point of a sector contribute. */
void bd_time_add(const bd_time *time, size_t k, size_t p, const double *D, double *H);

/* March from the state q, v (2, n_total), w (n_sector, n_point, 2) to another, in place, and count up the effort.  Nothing of
 * what was marched before counts; one march in parts agrees with one at once to the tolerance of the contact condition. */
void bd_time_march(bd_time *time, const bd_time_path *path, double *q, double *v, double *w, bd_time_effort *effort);

/* Sliders after a given motion q (n_step, 2, n_total). */
void bd_time_follow(bd_time *time, long n_step, const double *q, double *w);

#endif
