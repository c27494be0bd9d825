/* March in time of all sectors of a structure, each with contacts and sliders of its own. */
#ifndef BD_TIME_INTEGRATION_H
#define BD_TIME_INTEGRATION_H

#include "contact/element.h"
#include "util/kernels.h"

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
    const int *fixed_slider;                  /* (n_point, 2) sliders that stay where they are */
    const bd_point_law *point_law;            /* (n_point) laws of users, NULL if there are none */
    int n_force;
    const int *force_order;   /* (n_force) harmonics of the excitation */
    const double *excitation; /* (n_force, 2, 2, n_total): the factors of cos and of sin(order theta) */
    int n_row;
    const double *response_row; /* (n_row, 2, n_total): responses = row . (Re eta, Im eta) */
} bd_time_input;

/* Steps that were tried, and evaluations of the law for them. */
typedef struct {
    long n_solution, n_evaluation;
} bd_time_effort;

/* How far the contacts give way to their own forces within a step: u = u* - C p for the patterns V of the motion, x = V u,
 * and the forces on them p = V' F. */
typedef struct {
    double length, spectral_radius;       /* length of the step, 0 for an instant; spectral radius at infinite frequency */
    int rank;                             /* patterns, a multiple of 8; those behind the last one are zero */
    double neglected;                     /* largest compliance times stiffness that is left out */
    double *pattern, *pattern_transposed; /* (rank, rows) and (rows, rank) */
    double *compliance;                   /* (n_family, rank/8, rank, 2, 8) real and imaginary parts, times 1/N or 2/N */
} bd_time_patterns;

typedef struct bd_time {
    const bd_kernel *kernel;
    int n_sector, n_point, n_family, n_total, n_force, n_row, max_rank; /* most: patterns for which there is room */
    int *n_mode, *first_coordinate, *is_real;                           /* (n_family) */
    int *real_index, *imaginary_index; /* (n_total) padded coordinates of the real and imaginary part */
    int *force_order;
    size_t n_coordinate; /* padded: each family has room for a multiple of 8 modes, first real then imaginary parts */
    size_t stride, rows; /* points, padded to a multiple of 8; three times as many */
    int has_coupled, has_cubic;
    int n_own, n_memory; /* points with laws of users; numbers that each point remembers for them, 0 without any */
    double *motion_modes, *force_modes;                  /* modes, in the orders in which the two products read them */
    double *phase;                                       /* (n_sector, n_family, 2) cos and sin(2 pi k d/n) */
    double *stiffness, *mass, *damping, *fourier_weight; /* (n_coordinate) of each; part: 1/N or 2/N */
    double *excitation, *response_row;                   /* (n_force, 2, n_coordinate); (n_row, n_coordinate) */
    double *parameters;                                  /* (BD_TIME_FIELDS, stride) */
    double *q, *v, *a, *contact_force,
        *last_contact_force;  /* (n_coordinate); before: what was pressed at the start of a step */
    double *load, *next_load; /* (n_coordinate) excitation at the start and at the end of a step */
    double *q_next, *a_next;  /* (n_coordinate) at the end of the step, without its contact forces */
    double *displacement_compliance,
        *acceleration_compliance; /* (n_coordinate) displacement and acceleration by a unit of force */
    double *slider, *next_slider; /* (n_sector, 2, stride) */
    double *law_memory[2];        /* (n_sector, n_point, n_memory) before and after a step */
    double *derivatives;          /* room for those of one law */
    double *motion, *free_motion,
        *correction_motion;                     /* (n_sector, rows) motion: last, without new forces, of a correction */
    double *point_force, *predicted_force;      /* (n_sector, rows) */
    double *tangent;                            /* (n_sector, 9, stride) derivative of the forces that is in M */
    double *contact_state;                      /* (n_sector, stride) the state to which it belongs */
    double *motion_amplitude, *force_amplitude; /* (n_family, 2, rows) amplitudes of motion and force */
    double *preconditioner;                     /* (n_sector, rank/8, rank, 8) inverse of I + V' D V */
    double *pattern_force, *residual, *pattern_correction, *pattern_motion; /* (n_sector, most) */
    double *krylov, *krylov_motion; /* (BD_TIME_VECTORS + 1, n_sector, most) of GMRES; C times them */
    int *outdated;                  /* (n_sector) M is to be made anew */
    bd_time_patterns patterns[2];   /* of an instant, and of a step */
    double energy[4];               /* of the steps since it was last set to 0, as bd_time_path.energy */
    double largest_force;           /* force on the patterns so far */
    bd_time_effort effort;
    double *work; /* (3 n_total) while it is made, (rows (rows + most + 4)) while a step is */
    double *memory;
    int *integers;
    bd_point_law *point_law; /* (n_point) */
} bd_time;

/* What is known of a point, in the order of bd_time.point.  Limit of friction r0 + r1 N; ease: 1/kt, 0 without spring;
 * floor: the least normal force, 0 or minus infinity; masks 1 or 0. */
enum {
    BD_TIME_KT,
    BD_TIME_INVERSE_KT = 2,
    BD_TIME_CUBIC = 4,
    BD_TIME_FIXED_SLIDER = 6,
    BD_TIME_SHIFT = 8,
    BD_TIME_KN = 11,
    BD_TIME_N0,
    BD_TIME_LEAST_N,
    BD_TIME_LIMIT,
    BD_TIME_MU,
    BD_TIME_COUPLED,
    BD_TIME_USER_LAW,
    BD_TIME_FIELDS
};

/* Newton's corrections in a step, vectors of GMRES for each and its tolerance, steps until M is made anew, and denominator of
 * an update of rank one below which it is. */
enum { BD_TIME_MAX_ITERATIONS = 40, BD_TIME_VECTORS = 8, BD_TIME_REFACTOR = 64 };
#define BD_TIME_LINEAR_TOLERANCE 0.1
#define BD_TIME_SINGULAR 1e-3

/* Residual relative to the forces above which a step counts as unsolved, and how often such a step is halved. */
#define BD_TIME_UNSOLVED 1e-2
enum { BD_TIME_HALVINGS = 6 };

/* Patterns: compliance times stiffness below which one is left out, and how many there are at most. */
#define BD_TIME_RANK_TOLERANCE 1e-3
enum { BD_TIME_MAX_RANK = 96, BD_TIME_MIN_RANK = 16 };

/* Relative change of the step above which its patterns are made anew in a sweep. */
#define BD_TIME_STEP_CHANGE 1e-3

/* Where a march goes.  The instants are those of equal steps of the angle, theta_k = 2 pi k/per_period; the frequency goes
 * from omega to omega_end linearly in time, so that its square is linear in the angle. */
typedef struct bd_time_path {
    long n_step, first_step; /* the first step starts at theta_first */
    int steps_per_period, n_harm;
    double omega, omega_end;
    double spectral_radius; /* spectral radius at infinite frequency, 0 to 1 */
    double tolerance;       /* of the contact forces, relative */
    int find_acceleration;  /* the accelerations follow from the rest of the state, and so do coordinates without mass */
    double *
        response_harmonics; /* complex (n_step/per_period, n_row, n_harm + 1) of the responses in each whole period, or NULL */
    double *energy;         /* (n_step/per_period, 4) of all sectors: work of the excitation, losses in damping, work on the
                       * contacts, and rise of kinetic and strain energy in each whole period; or NULL */
    double *coordinates;    /* (n_step, 2, n_total) coordinates at the start of each step, or NULL */
} bd_time_path;

bd_status bd_time_create(bd_time *time, const bd_time_input *input);
void bd_time_destroy(bd_time *time);

/* Coordinates out of the layout of the loop: x (2, n_total). */
void bd_time_unpad(const bd_time *time, const double *padded, double *x);

/* Makes the patterns of a step of that length, of an instant for 0, if they are not there. */
void bd_time_make_patterns(bd_time *time, bd_time_patterns *step, double h, double radius);

/* Numbers of the generalised alpha method with a spectral radius at infinite frequency (Chung and Hulbert). */
typedef struct {
    double am, af, b, gamma;
} bd_time_alpha;

bd_time_alpha bd_time_weights(double radius);

/* States and derivatives of all points are to be found anew. */
void bd_time_reset_states(bd_time *time);

/* What each coordinate gives way to a unit of force within a step (0: at an instant), and its acceleration. */
void bd_time_compliance(const bd_time *time, double h, double radius, double *beta, double *ease);

/* March from the state q, v, a (2, n_total), w (n_sector, n_point, 2 + n_memory) to another, in place, and count up the effort.
 * Nothing of what was marched before counts; one march in parts agrees with one at once to the tolerance of the contact forces.  A step
 * whose contact forces are not found is taken in shorter steps; where these fail, too, the march ends there with
 * BD_NOT_CONVERGED, and with BD_NOT_FINITE where a motion without contact overflows. */
bd_status bd_time_integrate(bd_time *time, const bd_time_path *path, double *q, double *v, double *a, double *w,
                            bd_time_effort *effort);

/* Sliders and memories w, as above, after a given motion q (n_step, 2, n_total). */
void bd_time_update_sliders(bd_time *time, long n_step, const double *q, double *w);

#endif
