/* Time integration of all sectors of a structure with individual contact states and sliders. */
#ifndef BD_TIME_INTEGRATION_H
#define BD_TIME_INTEGRATION_H

#include "contact/element.h"
#include "util/kernels.h"

/* The modal coordinates eta are ordered family after family, n_total altogether; a family is one
 * nodal diameter. A vector is (2, n_total): real and imaginary parts. */
typedef struct {
    int n_sector, n_point, n_family;
    const int *n_mode; /* (n_family) */
    /* (n_family) 0..n_sector-1; families of 0 and n_sector/2 have real coordinates */
    const int *diameter;
    /* (n_total); coordinates with mass 0 follow from the contact condition */
    const double *stiffness, *mass, *damping;
    /* complex, family after family (n_point, 3, n_mode) */
    const double *G;
    const double *kt, *kn, *mu, *n0, *load; /* kt (n_point, 2); the others (n_point) */
    const double *shift;                    /* (n_point, 3) */
    const int *law;                         /* (n_point) */
    const int *fixed_slider;                /* (n_point, 2) 1: the slider does not move */
    const bd_point_law *point_law;          /* (n_point) user laws, NULL if there are none */
    int n_force;
    const int *force_order;   /* (n_force) harmonics of the excitation */
    const double *excitation; /* (n_force, 2, 2, n_total): factors of cos and sin(order theta) */
    int n_row;
    const double *response_row; /* (n_row, 2, n_total): responses = row . (Re eta, Im eta) */
} bd_time_input;

/* Number of solutions for the contact forces of a step, and of evaluations of the law for them. */
typedef struct {
    long n_solution, n_evaluation;
} bd_time_effort;

/* Energies (J) of all sectors in a period. */
enum {
    BD_TIME_WORK,         /* work of the excitation */
    BD_TIME_LOSS,         /* losses in damping */
    BD_TIME_CONTACT_WORK, /* work on the contacts */
    BD_TIME_STORED,       /* increase of kinetic and strain energy */
    BD_TIME_N_ENERGY
};

/* Residual relative to the forces above which a step is unsolved, number of times that such a step
 * is halved, and number of lengths that it then has. */
#define BD_TIME_UNSOLVED 1e-2
enum { BD_TIME_HALVINGS = 6, BD_TIME_LENGTHS_OF_STEP = BD_TIME_HALVINGS + 1 };

/* Compliance of the contacts to their own forces within a step: u = u* - C p for the patterns V of
 * the motion, x = V u, and the pattern forces p = V' F. */
typedef struct {
    /* time step, 0 for an instant; spectral radius at infinite frequency */
    double length, spectral_radius;
    /* number of patterns, a multiple of 8; unused ones are zero */
    int rank;
    double neglected;                     /* largest neglected compliance times stiffness */
    double *pattern, *pattern_transposed; /* (rank, rows) and (rows, rank) */
    /* (n_family, rank/8, rank, 2, 8) real and imaginary parts, times 1/N or 2/N */
    double *compliance;
} bd_time_patterns;

typedef struct bd_time {
    const bd_kernel *kernel;
    /* max_rank: patterns for which memory is available */
    int n_sector, n_point, n_family, n_total, n_force, n_row, max_rank;
    int *n_mode, *first_coordinate, *is_real; /* (n_family) */
    /* (n_total) padded index of the real and imaginary part of a coordinate */
    int *real_index, *imaginary_index;
    int *force_order;
    /* padded: each family has a multiple of 8 modes, first real, then imaginary parts */
    size_t n_coordinate;
    size_t stride, rows; /* number of points, padded to a multiple of 8; 3 stride */
    int has_coupled, has_cubic;
    /* points with user laws; numbers in the memory of each point, 0 without user laws */
    int n_user_law, n_memory;
    /* modes in the storage order of the products for motion and for forces */
    double *motion_modes, *force_modes;
    double *phase; /* (n_sector, n_family, 2) cos and sin(2 pi k d/n) */
    /* (n_coordinate) each; fourier_weight: 1/N or 2/N */
    double *stiffness, *mass, *damping, *fourier_weight;
    /* (n_force, 2, n_coordinate); (n_row, n_coordinate) */
    double *excitation, *response_row;
    double *parameters; /* (BD_TIME_FIELDS, stride) */
    double *q, *v, *a;  /* (n_coordinate) */
    /* (n_coordinate) modal, at the latest instant */
    double *contact_force;
    /* (n_coordinate) modal, at the start of the step */
    double *last_contact_force;
    /* (n_coordinate) excitation at the start and at the end of a step */
    double *load, *next_load;
    /* (n_coordinate) at the end of the step, without its contact forces */
    double *q_next, *a_next;
    /* (n_coordinate) displacement due to a unit force */
    double *displacement_compliance;
    /* (n_coordinate) acceleration due to a unit force */
    double *acceleration_compliance;
    double *slider, *next_slider; /* (n_sector, 2, stride) */
    /* (n_sector, n_point, n_memory) before and after a step */
    double *law_memory[2];
    double *derivatives; /* work for the derivatives of one law */
    /* (n_sector, rows) latest motion, and motion without new forces */
    double *motion, *free_motion;
    double *correction_motion;             /* (n_sector, rows) motion of a correction */
    double *point_force, *predicted_force; /* (n_sector, rows) */
    /* (n_sector, 9, stride) derivative of the forces in the preconditioner */
    double *tangent;
    /* (n_sector, stride) contact state of this derivative */
    double *contact_state;
    /* (n_family, 2, rows) amplitudes of motion and force */
    double *motion_amplitude, *force_amplitude;
    /* (n_sector, rank/8, rank, 8) M, the inverse of I + V' D V */
    double *preconditioner;
    /* (n_sector, max_rank) each: p, residual, change of p, C times the change */
    double *pattern_force, *residual, *pattern_correction, *pattern_motion;
    /* (BD_TIME_VECTORS + 1, n_sector, max_rank) of GMRES; C times them */
    double *krylov, *krylov_motion;
    int *outdated; /* (n_sector) 1: recompute M */
    /* (n_sector, stride) contact states at the end of the last step */
    double *last_state;
    /* (n_sector, n_point) states at the same phase of the last period, BD_TIME_UNKNOWN or a state;
     * NULL if there are none. The path owns them. */
    const signed char *period_state;
    int period_is_better; /* 1: the last period was a better guess in the last step */
    bd_time_patterns of_instant;
    bd_time_patterns of_step[BD_TIME_LENGTHS_OF_STEP]; /* step halved 0, 1, ... times */
    /* energies of the steps since the last reset, see bd_time_path.energy */
    double energy[BD_TIME_N_ENERGY];
    double largest_force; /* largest pattern force so far */
    bd_time_effort effort;
    /* (3 n_total) during creation, (rows (rows + max_rank + 4)) while patterns are computed */
    double *work;
    double *memory;
    int *integers;
    bd_point_law *point_law; /* (n_point) */
} bd_time;

/* Parameters of a point, in the order of bd_time.parameters. Friction limit LIMIT + MU N;
 * INVERSE_KT: 1/kt, 0 without a spring; LEAST_N: least normal force, 0 or minus infinity; masks 1
 * or 0. */
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

/* Newton iterations per step, vectors of GMRES in each, steps until M is recomputed, and
 * denominator of a rank-one update below which M is recomputed. */
enum { BD_TIME_MAX_ITERATIONS = 40, BD_TIME_VECTORS = 8, BD_TIME_REFACTOR = 64 };
#define BD_TIME_SINGULAR 1e-3

/* Steps between two readings of the clock. */
enum { BD_TIME_CLOCK_STEPS = 16 };

/* Tolerance of GMRES in the first iterations of a step, their number, and tolerance in later ones.
 * The later one also applies to the first correction in the states of the last period, which ends the
 * step if they return. With it in all iterations, steps with little numerical damping stall. */
enum { BD_TIME_EASY_ITERATIONS = 2 };
#define BD_TIME_LINEAR_TOLERANCE 0.1
#define BD_TIME_HARD_LINEAR_TOLERANCE 0.01

/* Contact states (contact_law.h) are numbers from 0 to BD_TIME_N_STATE - 1. */
enum { BD_TIME_UNKNOWN = -1, BD_TIME_N_STATE = 36 };

/* Length of a correction: slope of the potential relative to the one at its start that ends the
 * search, largest number of lengths, and ratio of residuals below which the full correction needs
 * no search. */
enum { BD_TIME_LENGTHS = 8 };
#define BD_TIME_SLOPE 0.5
#define BD_TIME_CONVERGES 0.1

/* Patterns: compliance times stiffness below which a pattern is neglected, and
 * largest number of patterns. */
#define BD_TIME_RANK_TOLERANCE 1e-3
enum { BD_TIME_MAX_RANK = 96, BD_TIME_MIN_RANK = 16 };

/* Relative change of the time step in a sweep above which the patterns are recomputed. */
#define BD_TIME_STEP_CHANGE 1e-3

/* Input and output of a time integration. Instants have equal steps of the angle, theta_k = 2 pi
 * k/steps_per_period. The frequency changes from omega to omega_end linearly in time, so its square
 * is linear in the angle. */
typedef struct bd_time_path {
    long n_step, first_step; /* the first step starts at theta_first_step */
    int steps_per_period, n_harm;
    double omega, omega_end;
    double spectral_radius; /* spectral radius at infinite frequency, 0 to 1 */
    double tolerance;       /* relative tolerance of the contact forces */
    /* processor time (s) of the thread at which the integration stops; 0: it does not */
    double last_second;
    /* 1: compute the accelerations and the coordinates without mass from the remaining state */
    int find_acceleration;
    /* complex harmonics (n_step/steps_per_period, n_row, n_harm + 1) of the responses in each
     * period, or NULL */
    double *response_harmonics;
    /* (n_step/steps_per_period, BD_TIME_N_ENERGY) J, energies of each period, or NULL */
    double *energy;
    double *coordinates; /* (n_step, 2, n_total) coordinates at the start of each step, or NULL */
    /* (steps_per_period, n_sector, n_point) contact states at the end of the step that ends at each
     * phase, BD_TIME_UNKNOWN before the first period; or NULL. The steps expect the states of the
     * last period, and store theirs. */
    signed char *states;
} bd_time_path;

bd_status bd_time_create(bd_time *time, const bd_time_input *input);
void bd_time_destroy(bd_time *time);

/* Copy padded coordinates to x (2, n_total). */
void bd_time_unpad(const bd_time *time, const double *padded, double *x);

/* Compute the patterns for a step of length h (0: for an instant), unless they are available. */
void bd_time_make_patterns(bd_time *time, bd_time_patterns *step, double h, double radius);

/* Parameters of the generalised alpha method for a spectral radius at infinite frequency
 * (Chung and Hulbert 1993). */
typedef struct {
    double am, af, b, gamma;
} bd_time_alpha;

bd_time_alpha bd_time_weights(double radius);

/* Invalidate the contact states and derivatives of all points. */
void bd_time_reset_states(bd_time *time);

/* Displacement and acceleration of each coordinate due to a unit force within a step
 * (h = 0: at an instant). */
void bd_time_compliance(const bd_time *time, double h, double radius, double *beta,
                        double *acceleration);

/* Integrate the state q, v, a (2, n_total), w (n_sector, n_point, 2 + n_memory) in place and add to
 * the effort. Earlier integrations have no influence, except through path->states; an integration
 * in parts agrees with one at once to the tolerance of the contact forces. If the contact forces of a step are not found, the
 * step is divided into shorter ones. If these also fail, the integration stops with
 * BD_NOT_CONVERGED. A motion without contact that overflows returns BD_NOT_FINITE. */
bd_status bd_time_integrate(bd_time *time, const bd_time_path *path, double *q, double *v,
                            double *a, double *w, bd_time_effort *effort);

/* Sliders and memories w, as above, after a prescribed motion q (n_step, 2, n_total). */
void bd_time_update_sliders(bd_time *time, long n_step, const double *q, double *w);

#endif
