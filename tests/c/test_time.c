/* Time integration: an oscillator against its steps in closed form, a slider against the clip,
 * derivatives of the forces against differences, equality of all builds of the loop. */
#define BD_VARIANT of_the_test
#define BD_VARIANT_NAME "of the test"
#include "time/generalised_alpha.c" /* for the derivatives, which are static */
#include "check.h"

#include <string.h>

enum { SECTORS = 5, POINTS = 11, FAMILIES = 2, MODES = 12, FORCES = 2 };

/* A mass on a spring with a unilateral stop, in direct contact or through
 * another spring without mass. */
static void test_oscillator(int with_spring) {
    const int two = 1 + with_spring, zero = 0, law = BD_LAW_NORMAL, held[2] = {0, 0}, order = 1;
    const double ks = 5.0, k[2] = {2.0, ks}, m[2] = {0.5, 0.0}, c[2] = {0.1, 0.0},
                 kt[2] = {0.0, 0.0}, kn = 3.0, none[3] = {0.0};
    double G[12] = {0.0}; /* complex (3, two): the normal motion of each */
    for (int i = 0; i < two; ++i) G[2 * (2 * two + i)] = 1.0;
    const double n0 = 0.2, force[8] = {1.0}, row[4] = {1.0};
    const bd_time_input in = {.n_sector = 1,
                              .n_point = 1,
                              .n_family = 1,
                              .n_mode = &two,
                              .diameter = &zero,
                              .stiffness = k,
                              .mass = m,
                              .damping = c,
                              .G = G,
                              .kt = kt,
                              .kn = &kn,
                              .mu = none,
                              .n0 = &n0,
                              .load = &n0,
                              .shift = none,
                              .law = &law,
                              .fixed_slider = held,
                              .n_force = 1,
                              .force_order = &order,
                              .excitation = force,
                              .n_row = 1,
                              .response_row = row};
    bd_time t;
    CHECK(bd_time_create(&t, &in) == BD_OK);
    double q[4] = {0.3}, v[4] = {-0.2}, a[4] = {0.0}, w[2] = {0.0, 0.0}, X[2 * 2 * 3],
           trace[4 * 150];
    const bd_time_path path = {.n_step = 150,
                               .first_step = 10,
                               .steps_per_period = 70,
                               .n_harm = 2,
                               .omega = 1.7,
                               .omega_end = 1.7,
                               .spectral_radius = 0.6,
                               .tolerance = 1e-12,
                               .find_acceleration = 1,
                               .response_harmonics = X,
                               .coordinates = trace};
    bd_time_effort effort = {0};
    CHECK(bd_time_integrate(&t, &path, q, v, a, w, &effort) == BD_OK);
    CHECK(effort.n_solution == 150 + with_spring && effort.n_evaluation <= 15 * effort.n_solution);
    const double h = BD_TWO_PI / 1.7 / 70, give = with_spring ? 1.0 + kn / ks : 1.0, am = 0.2 / 1.6,
                 af = 0.6 / 1.6, late = 1.0 - af, gamma = 0.5 - am + af,
                 b = 0.25 * (1.0 - am + af) * (1.0 - am + af),
                 inertia = m[0] * (1.0 - am) + late * (c[0] * gamma * h + k[0] * b * h * h);
    double x = 0.3, y = -0.2, mean = 0.0, N = fmax(n0 + kn * x, 0.0) / give;
    double z = (cos(BD_TWO_PI * 10 / 70) - k[0] * x - c[0] * y - N) / m[0];
    int open = 0;
    for (int i = 0; i < 150; ++i) {
        CHECK_NEAR(trace[2 * two * i], x, 1e-9);
        if (with_spring) CHECK_NEAR(trace[2 * two * i + 1], -N / ks, 1e-9);
        if (i >= 70 && i < 140) mean += x / 70;
        open += n0 + kn * x < 0.0;
        const double e = cos(BD_TWO_PI * (10 + i) / 70), next = cos(BD_TWO_PI * (11 + i) / 70);
        const double rest = late * next + af * (e - N) - m[0] * am * z -
                            c[0] * (y + late * h * (1.0 - gamma) * z) -
                            k[0] * (x + late * (h * y + h * h * (0.5 - b) * z));
        const double free_end = x + h * y + h * h * ((0.5 - b) * z + b * rest / inertia),
                     beta = b * h * h * late / inertia;
        N = fmax(n0 + kn * free_end, 0.0) / (give + kn * beta);
        const double faster = (rest - late * N) / inertia;
        x = free_end - beta * N;
        y += h * ((1.0 - gamma) * z + gamma * faster);
        z = faster;
    }
    CHECK(open > 10 && open < 140);
    CHECK_NEAR(q[0], x, 1e-9);
    CHECK_NEAR(v[0], y, 1e-9);
    CHECK_NEAR(a[0], z, 1e-9);
    CHECK_NEAR(X[6], mean, 1e-10);
    CHECK(q[two] == 0.0 && v[two] == 0.0 && w[0] == 0.0);
    bd_time_destroy(&t);
}

/* The slider of a point with a reversing motion is u clipped; a bonded and a
 * fixed slider do not move. */
static void test_sliders(void) {
    const int one = 1, zero = 0, order = 0;
    const int law[POINTS] = {0, BD_LAW_BONDED, 0, BD_LAW_CONSTANT},
              held[2 * POINTS] = {0, 0, 0, 0, 1, 0};
    const double unit = 1.0, row[2] = {1.0, 0.0}, none[3 * POINTS] = {0.0};
    double G[6 * POINTS] = {0.0}, kt[2 * POINTS], kn[POINTS], mu[POINTS], n0[POINTS], load[POINTS];
    for (int p = 0; p < POINTS; ++p) {
        G[6 * p] = 1.0;
        kt[2 * p] = kt[2 * p + 1] = 2.0, kn[p] = 1.0, mu[p] = 0.5, n0[p] = 1.0, load[p] = 4.0;
    }
    const bd_time_input in = {.n_sector = 1,
                              .n_point = POINTS,
                              .n_family = 1,
                              .n_mode = &one,
                              .diameter = &zero,
                              .stiffness = &unit,
                              .mass = &unit,
                              .damping = &unit,
                              .G = G,
                              .kt = kt,
                              .kn = kn,
                              .mu = mu,
                              .n0 = n0,
                              .load = load,
                              .shift = none,
                              .law = law,
                              .fixed_slider = held,
                              .n_force = 0,
                              .force_order = &order,
                              .excitation = none,
                              .n_row = 1,
                              .response_row = row};
    bd_time t;
    CHECK(bd_time_create(&t, &in) == BD_OK);
    const double q[3 * 2] = {0.2, 0.0, 3.0, 0.0, -0.1, 0.0};
    double w[2 * POINTS] = {0.0};
    bd_time_update_sliders(&t, 1, q, w);
    CHECK_NEAR(w[0], 0.0, 1e-15); /* half width mu N/kt = 1/4 */
    bd_time_update_sliders(&t, 2, q, w);
    CHECK_NEAR(w[0], 2.75, 1e-15);
    CHECK_NEAR(w[6], 2.0, 1e-15); /* mu load/kt = 1 */
    bd_time_update_sliders(&t, 3, q, w);
    CHECK_NEAR(w[0], 0.15, 1e-15);
    CHECK_NEAR(w[2 * POINTS - 2], 0.15, 1e-15);
    CHECK_NEAR(w[6], 0.9, 1e-15);
    CHECK(w[2] == 0.0 && w[4] == 0.0 && w[1] == 0.0);
    bd_time_destroy(&t);
}

/* Many points under all laws, on two families. */
static void create_all(bd_time *t, unsigned long long *seed) {
    static double G[2 * 3 * POINTS * MODES], stiffness[MODES], mass[MODES], damping[MODES],
        kt[2 * POINTS], kn[POINTS], mu[POINTS], n0[POINTS], load[POINTS], shift[3 * POINTS],
        force[FORCES * 4 * MODES], row[2 * MODES];
    static int law[POINTS], held[2 * POINTS];
    const int n_mode[FAMILIES] = {3, 9}, diameter[FAMILIES] = {0, 2}, order[FORCES] = {0, 1};
    for (int i = 0; i < 2 * 3 * POINTS * MODES; ++i) G[i] = uniform(seed);
    for (int j = 0; j < MODES; ++j) {
        stiffness[j] = 3.0 + 2.0 * uniform(seed), mass[j] = j % 5 == 1 ? 0.0 : 1.5 + uniform(seed),
        damping[j] = 0.1;
        row[j] = uniform(seed), row[MODES + j] = j < 3 ? 0.0 : uniform(seed);
        for (int i = 0; i < FORCES * 4; ++i)
            force[i * MODES + j] = j < 3 && i % 2 ? 0.0 : uniform(seed);
    }
    for (int p = 0; p < POINTS; ++p) {
        kt[2 * p] = 1.0, kt[2 * p + 1] = 1.5, kn[p] = p % BD_N_LAW == BD_LAW_CUBIC ? 0.0 : 1.2,
               mu[p] = 0.4;
        n0[p] = 0.5 * uniform(seed), load[p] = 0.5 + uniform(seed), law[p] = p % BD_N_LAW;
        held[2 * p] = p == 8;
        for (int d = 0; d < 3; ++d) shift[3 * p + d] = 0.2 * uniform(seed);
    }
    const bd_time_input in = {.n_sector = SECTORS,
                              .n_point = POINTS,
                              .n_family = FAMILIES,
                              .n_mode = n_mode,
                              .diameter = diameter,
                              .stiffness = stiffness,
                              .mass = mass,
                              .damping = damping,
                              .G = G,
                              .kt = kt,
                              .kn = kn,
                              .mu = mu,
                              .n0 = n0,
                              .load = load,
                              .shift = shift,
                              .law = law,
                              .fixed_slider = held,
                              .n_force = FORCES,
                              .force_order = order,
                              .excitation = force,
                              .n_row = 1,
                              .response_row = row};
    CHECK(bd_time_create(t, &in) == BD_OK);
}

static void integrate_all(const bd_kernel *kernel, double *q, double *v, double *w) {
    unsigned long long seed = 11;
    bd_time t;
    create_all(&t, &seed);
    t.kernel = kernel;
    signed char states[200 * SECTORS * POINTS]; /* those of the first period serve in the second */
    const bd_time_path path = {.n_step = 300,
                               .steps_per_period = 200,
                               .omega = 1.1,
                               .omega_end = 1.3,
                               .spectral_radius = 0.5,
                               .tolerance = 1e-12,
                               .find_acceleration = 1,
                               .states = states};
    double a[2 * MODES] = {0.0};
    memset(states, BD_TIME_UNKNOWN, sizeof states);
    for (int j = 0; j < 2 * MODES; ++j)
        q[j] = v[j] = j >= MODES && j < MODES + 3 ? 0.0 : uniform(&seed);
    for (int i = 0; i < 2 * SECTORS * POINTS; ++i) w[i] = 0.1 * uniform(&seed);
    bd_time_effort effort = {0};
    CHECK(bd_time_integrate(&t, &path, q, v, a, w, &effort) == BD_OK);
    bd_time_destroy(&t);
}

/* Motions without a possible step; they have no influence on the next integration. */
static void test_failure(void) {
    unsigned long long seed = 13;
    bd_time t;
    create_all(&t, &seed);
    const bd_time_path path = {.n_step = 20,
                               .steps_per_period = 20,
                               .omega = 1.1,
                               .omega_end = 1.1,
                               .spectral_radius = 0.5,
                               .tolerance = 1e-6,
                               .find_acceleration = 1};
    double end[2][2 * MODES];
    for (int i = 0; i < 4; ++i) {
        double q[2 * MODES] = {0.3}, v[2 * MODES] = {i % 2 ? 1e307 : 0.1}, a[2 * MODES] = {0.0},
                     w[2 * SECTORS * POINTS] = {0.0};
        bd_time_effort effort = {0};
        CHECK((bd_time_integrate(&t, &path, q, v, a, w, &effort) == BD_OK) == (i % 2 == 0));
        if (i % 2 == 0) memcpy(end[i / 2], q, sizeof q);
    }
    CHECK(memcmp(end[0], end[1], sizeof *end) == 0);
    bd_time_destroy(&t);
}

/* Away from changes of state (slip, stick, separation, closing), at which
 * one-sided differences disagree. */
static void test_derivatives(void) {
    const double h = 1e-6;
    unsigned long long seed = 12;
    bd_time t;
    create_all(&t, &seed);
    const size_t s = t.stride;
    int smooth = 0, pressed = 0;
    for (int draw = 0; draw < 200; ++draw) {
        for (size_t i = 0; i < (size_t)SECTORS * t.rows; ++i) t.motion[i] = uniform(&seed);
        for (size_t i = 0; i < (size_t)SECTORS * 2 * s; ++i) t.slider[i] = uniform(&seed);
        for (size_t p = 0; p < POINTS; ++p) {
            double D[9], F[3][3];
            const double x[3] = {t.motion[p], t.motion[s + p], t.motion[2 * s + p]},
                         w[2] = {t.slider[p], t.slider[s + p]};
            contact_tangent(&t, 0, p, x, w, D);
            for (size_t e = 0; e < 3; ++e) {
                for (int side = 0; side < 3; ++side) {
                    t.motion[e * s + p] = x[e] + (side - 1) * h;
                    all_contact_forces(&t, t.motion, t.point_force);
                    for (size_t d = 0; d < 3; ++d) F[side][d] = t.point_force[d * s + p];
                }
                t.motion[e * s + p] = x[e];
                for (size_t d = 0; d < 3; ++d) {
                    if (fabs(F[2][d] - 2.0 * F[1][d] + F[0][d]) > 1e-3 * h) continue;
                    CHECK_NEAR((F[2][d] - F[0][d]) / (2.0 * h), D[3 * d + e], 1e-6);
                    ++smooth;
                    pressed += e == 2 && d < 2 && D[3 * d + e] != 0.0;
                }
            }
        }
    }
    /* nearly everywhere, and often on points that slip */
    CHECK(smooth > 9 * 190 * POINTS && pressed > 500);
    bd_time_destroy(&t);
}

static void test_kernels(void) {
    static double q[BD_MOST_KERNELS][2 * MODES], v[BD_MOST_KERNELS][2 * MODES],
        w[BD_MOST_KERNELS][2 * SECTORS * POINTS];
    const bd_kernel *kernel[BD_MOST_KERNELS];
    const int n = bd_kernel_all(kernel);
    for (int i = 0; i < n; ++i) {
        integrate_all(kernel[i], q[i], v[i], w[i]);
        for (int j = 0; j < 2 * MODES; ++j) {
            CHECK_NEAR(q[i][j], q[0][j], 1e-7);
            CHECK_NEAR(v[i][j], v[0][j], 1e-6);
        }
        for (int j = 0; j < 2 * SECTORS * POINTS; ++j) CHECK_NEAR(w[i][j], w[0][j], 1e-7);
        /* real coordinates stay real */
        for (int j = MODES; j < MODES + 3; ++j) CHECK(q[i][j] == 0.0);
    }
}

int main(void) {
    test_oscillator(0);
    test_oscillator(1);
    test_sliders();
    test_failure();
    test_derivatives();
    test_kernels();
    return check_result();
}
