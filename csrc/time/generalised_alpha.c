/* Time steps of all sectors; compiled once for each instruction set.
 *
 * The motion is a superposition of families, one for each nodal diameter d, x_k = shift + sum_d
 * Re[G_d q_d exp(i k d phi)], phi = 2 pi/N, and obeys
 *
 *     m q_d'' + c q_d' + K q_d + g_d = E_d(t),     g_d = (c_d/N) G_d^H sum_k F_k exp(-i k d phi).
 *
 * c_d is 2, or 1 for the real coordinates of d = 0 and d = N/2. A step h uses the generalised alpha
 * method (Chung and Hulbert 1993),
 *
 *     m [(1 - am) a+ + am a] + (1 - af) [c v+ + K q+ + g+ - E+] + af [c v + K q + g - E] = 0,
 *     q+ = q + h v + h^2 [(1/2 - b) a + b a+],     v+ = v + h [(1 - gamma) a + gamma a+].
 *
 * Hence q+ = q* - beta g+, and q* follows from known values. A coordinate without mass has K
 * q+ + g+ = E+, that is beta = 1/K. Products are in modal_motion.h, the law in contact_law.h, the
 * solution for the forces g+ in contact_newton.h. */
#include "time/contact_newton.h"
#include "util/clock.h"

/* Exchange two arrays. */
static void swap(double **a, double **b) {
    double *first = *a;
    *a = *b;
    *b = first;
}

/* Accept the sliders of the latest contact forces. */
static void move_sliders(bd_time *t) {
    swap(&t->slider, &t->next_slider);
    swap(&t->law_memory[0], &t->law_memory[1]);
}

/* Contact forces and modal forces at the end of a step; accepts the sliders. If the forces are not
 * found, return 0 and leave modal forces and sliders unchanged. */
static int contact_at_end(bd_time *t, const bd_time_patterns *patterns, double tolerance,
                          int predict) {
    find_motion(t, t->free_motion);
    if (patterns->rank) {
        ++t->effort.n_solution;
        if (!solve_contact(t, patterns, tolerance, predict)) return 0;
    } else {
        memcpy(t->motion, t->free_motion, sizeof(double) * t->rows * (size_t)t->n_sector);
        all_contact_forces(t, t->motion, t->point_force);
    }
    find_modal_forces(t);
    move_sliders(t);
    return 1;
}

/* Motion and contact forces at the present coordinates; accepts the sliders. */
static void contact_at_start(bd_time *t) {
    memcpy(t->q_next, t->q, sizeof(double) * t->n_coordinate);
    find_motion(t, t->motion);
    all_contact_forces(t, t->motion, t->point_force);
    move_sliders(t);
}

/* ---- integration ---- */

/* Excitation e (n_coordinate) at an angle: sum of C cos(o angle) + S sin(o angle) over the engine
 * orders o. */
BD_INLINE void find_load(const bd_time *t, double angle, double *e) {
    memset(e, 0, sizeof(double) * t->n_coordinate);
    for (int i = 0; i < t->n_force; ++i) {
        const double phase = t->force_order[i] * angle;
        const double c = cos(phase), s = sin(phase);
        const double *restrict C = t->excitation + 2 * (size_t)i * t->n_coordinate;
        const double *restrict S = C + t->n_coordinate;
        for (size_t j = 0; j < t->n_coordinate; ++j) e[j] += c * C[j] + s * S[j];
    }
}

/* Angle at step k plus a fraction of a step. Whole periods are left out: the angle stays exact. */
BD_INLINE double angle_of(const bd_time_path *path, long k, double part) {
    const long within = k % path->steps_per_period;
    return BD_TWO_PI * ((double)within + part) / path->steps_per_period;
}

/* row . q, in independent sums for instruction-level parallelism; n is a multiple of 8. */
BD_INLINE double response(size_t n, const double *restrict row, const double *restrict q) {
    double sums[8] = {0.0};
    for (size_t j = 0; j < n; j += 8)
        for (size_t d = 0; d < 8; ++d) sums[d] += row[j + d] * q[j + d];
    return sums[0] + sums[1] + sums[2] + sums[3] + sums[4] + sums[5] + sums[6] + sums[7];
}

/* Add the responses at step k to the complex harmonics of its period. */
BD_INLINE void add_to_harmonics(const bd_time *t, const bd_time_path *path, long k) {
    const long period = k / path->steps_per_period,
               n_period = path->n_step / path->steps_per_period;
    if (period >= n_period) return; /* incomplete at the end */

    const size_t per_row = 2 * ((size_t)path->n_harm + 1), n = t->n_coordinate;
    const double angle = angle_of(path, path->first_step + k, 0.0);
    const double c = cos(angle), s = sin(angle);
    double *X = path->response_harmonics + (size_t)period * (size_t)t->n_row * per_row;
    for (size_t i = 0; i < (size_t)t->n_row; ++i, X += per_row) {
        const double x = response(n, t->response_row + i * n, t->q);
        const double part = x / path->steps_per_period;
        double re = 2.0, im = 0.0; /* 2 exp(i l theta) */
        X[0] += part;
        for (int l = 1; l <= path->n_harm; ++l) {
            const double next_re = re * c - im * s;
            im = re * s + im * c;
            re = next_re;
            X[2 * l] += part * re;
            X[2 * l + 1] -= part * im;
        }
    }
}

/* Write the coordinates at step k, and add the response to the harmonics of its period. */
BD_INLINE void record(const bd_time *t, const bd_time_path *path, long k) {
    const size_t n_values = 2 * (size_t)t->n_total;
    if (path->coordinates) bd_time_unpad(t, t->q, path->coordinates + n_values * (size_t)k);
    if (path->response_harmonics) add_to_harmonics(t, path, k);
}

/* Contact forces at the first instant, for the excitation at `angle`. With find_acceleration, also
 * the coordinates without mass and the accelerations. Return 0 if the forces were not found.
 *
 * Coordinates q with mass are given. Coordinates without mass depend on the contact forces g,
 *
 *     K q + g = E,    that is q = q* - beta g,    q* = E/K,    beta = 1/K.
 *
 * The end of a step also has q = q* - beta g, for all coordinates. Its solution for the forces g
 * serves here with a step of length 0: the compliance of a coordinate with mass, proportional to
 * h^2, is then 0, so that its q remains the given one, q*. The compliance of a coordinate without
 * mass does not depend on the step. */
static int start(bd_time *t, const bd_time_path *path, double angle) {
    const size_t n = t->n_coordinate;
    const double *m = t->mass, *c = t->damping, *K = t->stiffness;
    if (!path->find_acceleration) {
        find_load(t, angle, t->load);
        contact_at_start(t);
        find_modal_forces(t);
        return 1;
    }

    /* patterns and compliance of a step of length 0: beta is 1/K without mass, 0 with mass */
    const double no_length = 0.0, any_radius = 0.0;
    bd_time_patterns *instant = &t->of_instant;
    double *beta = t->displacement_compliance;
    bd_time_make_patterns(t, instant, no_length, any_radius);
    bd_time_compliance(t, no_length, any_radius, beta, t->acceleration_compliance);

    /* q* */
    find_load(t, angle, t->load);
    memcpy(t->q_next, t->q, sizeof(double) * n);
    for (size_t j = 0; j < n; ++j) {
        const int has_mass = m[j] > 0.0;
        if (!has_mass) t->q_next[j] = t->load[j] / K[j];
    }

    /* more accurate forces than in a step, up to rounding */
    const double tolerance = larger(1e-3 * path->tolerance, 1e-13);
    mark_outdated(t);
    if (!contact_at_end(t, instant, tolerance, 0)) return 0;

    /* q = q* - beta g, and m a = E - c v - K q - g */
    for (size_t j = 0; j < n; ++j) {
        const double g = t->fourier_weight[j] * t->contact_force[j];
        t->q[j] = t->q_next[j] - beta[j] * g;
        const double force = t->load[j] - c[j] * t->v[j] - K[j] * t->q[j] - g;
        t->a[j] = m[j] > 0.0 ? force / m[j] : 0.0;
    }
    return 1;
}

/* Begin steps with these patterns: the pattern forces of the last contact forces, and the
 * states. */
static void use_patterns(bd_time *t, const bd_time_patterns *patterns) {
    multiply((size_t)t->n_sector, (size_t)patterns->rank, t->rows, t->point_force,
             patterns->pattern_transposed, t->pattern_force);
    mark_outdated(t);
    update_states(t, patterns, t->motion);
}

/* Coordinates q* and accelerations a* at the end of a step h without contact forces g+ there, from
 * the generalised alpha method with the weights am, af, b, gamma and the excitation e, e+ (next):
 *
 *     m [(1 - am) a* + am a] + (1 - af) [c v* + K q* - e+] + af [c v + K q + g - e] = 0,
 *     q* = q + h v + h^2 [(1/2 - b) a + b a*],     v* = v + h [(1 - gamma) a + gamma a*].
 *
 * All terms with a* form the acceleration compliance. A coordinate without mass follows K q* =
 * e+. */
static void predict_end(bd_time *t, double h, bd_time_alpha w, const double *restrict next) {
    const double *restrict q = t->q, *restrict v = t->v, *restrict a = t->a;
    const double *restrict m = t->mass, *restrict c = t->damping, *restrict K = t->stiffness;
    const double *restrict beta = t->displacement_compliance;
    const double *restrict compliance_a = t->acceleration_compliance;
    const double *restrict part = t->fourier_weight, *restrict contact = t->contact_force;
    const double *restrict now = t->load;
    double *restrict Q = t->q_next, *restrict A = t->a_next;
    const double weight = 1.0 - w.af; /* of the end of the step */
    for (size_t j = 0; j < t->n_coordinate; ++j) {
        const double displaced = q[j] + weight * (h * v[j] + h * h * (0.5 - w.b) * a[j]);
        const double drag = c[j] * (v[j] + weight * h * (1.0 - w.gamma) * a[j]);
        const double right_side = weight * next[j] + w.af * (now[j] - part[j] * contact[j]) -
                                  m[j] * w.am * a[j] - drag - K[j] * displaced;
        A[j] = compliance_a[j] / weight * right_side;
        Q[j] = m[j] > 0.0 ? q[j] + h * v[j] + h * h * ((0.5 - w.b) * a[j] + w.b * A[j])
                          : beta[j] * next[j];
    }
}

/* Move the state to the end of a step h with its contact forces g+, from the prediction q*, a*
 * without them: q+ = q* - beta g+ and a+ = a* - (acceleration compliance) g+. The speed is v+ = v +
 * h [(1 - gamma) a + gamma a+], or the mean speed of a coordinate without mass. Add up the energies
 * of the step, forces by the trapezoidal rule times the increment of q: work of the excitation,
 * loss in damping, work on the contacts, increase of kinetic and strain energy. */
static void finish_step(bd_time *t, double h, bd_time_alpha w, const double *restrict next) {
    double *restrict q = t->q, *restrict v = t->v, *restrict a = t->a;
    const double *restrict m = t->mass, *restrict c = t->damping, *restrict K = t->stiffness;
    const double *restrict beta = t->displacement_compliance;
    const double *restrict compliance_a = t->acceleration_compliance;
    const double *restrict part = t->fourier_weight, *restrict contact = t->contact_force;
    const double *restrict now = t->load, *restrict before = t->last_contact_force;
    const double *restrict Q = t->q_next, *restrict A = t->a_next;
    for (size_t j = 0; j < t->n_coordinate; ++j) {
        const double g = part[j] * contact[j];
        const double end = Q[j] - beta[j] * g;
        const double faster = A[j] - compliance_a[j] * g;
        const double increment = end - q[j];
        const double speed =
            m[j] > 0.0 ? v[j] + h * ((1.0 - w.gamma) * a[j] + w.gamma * faster) : increment / h;

        /* 1/part is the sum over all sectors, 1/2 the mean over the step */
        const double whole = part[j] > 0.0 ? 0.5 / part[j] : 0.0;
        t->energy[BD_TIME_WORK] += whole * (now[j] + next[j]) * increment;
        t->energy[BD_TIME_LOSS] += whole * c[j] * (v[j] + speed) * increment;
        t->energy[BD_TIME_CONTACT_WORK] += 0.5 * (before[j] + contact[j]) * increment;
        t->energy[BD_TIME_STORED] +=
            whole * (m[j] * (speed * speed - v[j] * v[j]) + K[j] * (end + q[j]) * increment);
        v[j] = speed;
        q[j] = end;
        a[j] = faster;
    }
}

/* Take one step, first without contact forces at its end, then with them; `next` is the excitation
 * there. If the forces are not found, return 0 and leave the state unchanged. */
static int take_step(bd_time *t, const bd_time_path *path, const bd_time_patterns *patterns,
                     double h, const double *restrict next) {
    const bd_time_alpha w = bd_time_weights(path->spectral_radius);
    memcpy(t->last_contact_force, t->contact_force, sizeof(double) * t->n_coordinate);
    predict_end(t, h, w, next);
    if (!contact_at_end(t, patterns, path->tolerance, 1)) return 0;
    finish_step(t, h, w, next);
    return 1;
}

/* Restore motion, forces and states at the start of a step without a solution. */
static void restore(bd_time *t) {
    contact_at_start(t);
    bd_time_reset_states(t);
}

/* Length of the last step, and how often it had been halved. The length is 0 before the first. */
typedef struct {
    double length;
    int n_halving;
} last_step;

/* Return the patterns for steps of length h, and prepare the compliance for it. There are patterns
 * for each number of halvings: further steps often need the same one. */
static const bd_time_patterns *use_length(bd_time *t, const bd_time_path *path, double h,
                                          int n_halving, last_step *last) {
    const double radius = path->spectral_radius;
    bd_time_patterns *patterns = &t->of_step[n_halving];
    const int is_first = last->length == 0.0;
    const int is_unknown = patterns->rank < 0 || patterns->spectral_radius != radius;
    const int has_other_length = fabs(h - patterns->length) > BD_TIME_STEP_CHANGE * h;
    const int is_outdated = is_first || is_unknown || has_other_length;
    if (is_outdated) bd_time_make_patterns(t, patterns, h, radius);
    if (is_outdated || n_halving != last->n_halving) use_patterns(t, patterns);
    if (h != last->length)
        bd_time_compliance(t, h, radius, t->displacement_compliance, t->acceleration_compliance);
    last->length = h;
    last->n_halving = n_halving;
    return patterns;
}

/* States of the path (n_sector, n_point) at the end of step k; NULL if it has none. */
static signed char *states_at_end(const bd_time *t, const bd_time_path *path, long k) {
    if (!path->states) return NULL;
    const size_t per_step = (size_t)t->n_sector * (size_t)t->n_point;
    const long phase = (path->first_step + k + 1) % path->steps_per_period;
    return path->states + per_step * (size_t)phase;
}

/* Store the states that a step has found. */
static void store_states(const bd_time *t, signed char *states) {
    const size_t n_point = (size_t)t->n_point;
    for (size_t sector = 0; sector < (size_t)t->n_sector; ++sector)
        for (size_t point = 0; point < n_point; ++point)
            states[sector * n_point + point] =
                (signed char)t->contact_state[sector * t->stride + point];
}

/* Advance over step k of length h. If the contact forces are not found, the remainder of the step
 * is halved repeatedly. Return 0 if the shortest step also fails. */
static int advance(bd_time *t, const bd_time_path *path, long k, double h, last_step *last) {
    const int whole = 1 << BD_TIME_HALVINGS; /* shortest steps in the step */
    signed char *states = states_at_end(t, path, k);
    int done = 0, n_halving = 0;
    while (done < whole) {
        const int size = whole >> n_halving;
        const double part = h * size / whole;
        const bd_time_patterns *patterns = use_length(t, path, part, n_halving, last);
        if (k % BD_TIME_REFACTOR == BD_TIME_REFACTOR - 1) mark_outdated(t);

        const int end = done + size;
        const long step_at_end = path->first_step + k + end / whole;
        const double angle = angle_of(path, step_at_end, (double)(end % whole) / whole);
        find_load(t, angle, t->next_load);
        /* the states of a whole step say nothing about a part of it */
        t->period_state = n_halving ? NULL : states;
        if (take_step(t, path, patterns, part, t->next_load)) {
            swap(&t->load, &t->next_load);
            done = end;
            continue;
        }
        restore(t);
        if (n_halving == BD_TIME_HALVINGS) return 0;
        ++n_halving;
    }
    if (states) store_states(t, states);
    return 1;
}

/* Forget patterns of halved steps that an earlier integration with steps of another length has
 * left, so that it has no influence. */
static void forget_halved_steps(bd_time *t, double h) {
    for (int i = 1; i < BD_TIME_LENGTHS_OF_STEP; ++i)
        if (t->of_step[i].length != h / (1 << i)) t->of_step[i].rank = -1;
}

/* Integrate n_step steps along a path. The angle advances by 2 pi/steps_per_period in each step,
 * and the square of the frequency changes linearly with it from omega to omega_end. The length of a
 * step is its angle over the mean frequency. Record coordinates, harmonics and the energies of each
 * period. */
bd_status BD_JOIN(bd_time_integrate_, BD_VARIANT)(bd_time *t, const bd_time_path *path);
bd_status BD_JOIN(bd_time_integrate_, BD_VARIANT)(bd_time *t, const bd_time_path *path) {
    const int steps = path->steps_per_period;
    if (path->response_harmonics) {
        const size_t n_period = (size_t)(path->n_step / steps);
        const size_t per_period = 2 * (size_t)t->n_row * (size_t)(path->n_harm + 1);
        memset(path->response_harmonics, 0, sizeof(double) * per_period * n_period);
    }
    if (!start(t, path, angle_of(path, path->first_step, 0.0))) return BD_NOT_CONVERGED;

    /* the square of the frequency is linear in the angle */
    const double square = path->omega * path->omega;
    const double change = path->omega_end * path->omega_end - square;
    const double slope = path->n_step > 0 ? change / (double)path->n_step : 0.0;
    double omega = path->omega;
    last_step last = {0.0, 0};
    for (long k = 0; k < path->n_step; ++k) {
        const double omega_after = sqrt(square + slope * (double)(k + 1));
        const double h = 2.0 * BD_TWO_PI / steps / (omega + omega_after);
        omega = omega_after;
        record(t, path, k);
        if (k % steps == 0) memset(t->energy, 0, sizeof t->energy);
        if (k == 0) forget_halved_steps(t, h);
        if (!advance(t, path, k, h, &last)) return BD_NOT_CONVERGED;
        const int ends_period = (k + 1) % steps == 0;
        if (path->energy && ends_period)
            memcpy(path->energy + BD_TIME_N_ENERGY * (k / steps), t->energy, sizeof t->energy);
        const int is_timed = path->last_second > 0.0 && (k + 1) % BD_TIME_CLOCK_STEPS == 0;
        if (is_timed && bd_processor_seconds() > path->last_second) return BD_TIME_SPENT;
    }
    return BD_OK;
}

/* Contact forces at the present coordinates; the sliders move. */
void BD_JOIN(bd_time_contact_, BD_VARIANT)(bd_time *t);
void BD_JOIN(bd_time_contact_, BD_VARIANT)(bd_time *t) { contact_at_start(t); }
