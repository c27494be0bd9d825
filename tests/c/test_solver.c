/* Newton's method on systems of one and two modes: a hardening contact, a neutral direction, a
 * peak, bad input; the order of the calls on equations. */
#include "balance/sector.h"
#include "solver/newton.h"
#include "check.h"

#include <limits.h>
#include <string.h>

/* Mode 0 (mean) and mode 1 (first harmonic) of one mass against a preloaded friction spring. */
typedef struct {
    int n_mode[2], law[1];
    double stiffness[2], mass[2], damping[2], G[12], kt[2], kn[1], mu[1], n0[1], w[2], shift[3],
        force[3];
    bd_sector *sector;
    bd_equations *equations; /* of the sector */
} oscillator;

static bd_elimination elimination; /* of all systems */

static void make(oscillator *o, double stiffness_of_mean, double excitation) {
    const oscillator blank = {.n_mode = {1, 1},
                              .law = {BD_LAW_SEPARABLE},
                              .stiffness = {stiffness_of_mean, 1.0},
                              .mass = {1.0, 1.0},
                              .damping = {0.0, 0.02},
                              .G = {1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0},
                              .kt = {1.0, 0.0},
                              .kn = {0.0},
                              .mu = {0.5},
                              .n0 = {2.0},
                              .force = {0.0, excitation, 0.0}};
    *o = blank;
    const bd_hbm_input input = {.n_point = 1,
                                .n_harm = 1,
                                .n_mode = o->n_mode,
                                .stiffness = o->stiffness,
                                .mass = o->mass,
                                .damping = o->damping,
                                .G = o->G,
                                .kt = o->kt,
                                .kn = o->kn,
                                .mu = o->mu,
                                .n0 = o->n0,
                                .w = o->w,
                                .law = o->law,
                                .shift = o->shift,
                                .force = o->force,
                                .evaluation = BD_EXACT};
    const bd_lapack lapack = bd_lapack_system();
    CHECK(bd_sector_create(&o->sector, &input, NULL, &lapack, elimination) == BD_OK);
    o->equations = &o->sector->dense.base;
}

static void finish(oscillator *o) { bd_equations_destroy(o->equations); }

static const double ones[4] = {1.0, 1.0, 1.0, 1.0}, at_frequency[4] = {0.0, 0.0, 0.0, 1.0};
static const bd_solver_options usual = {.tolerance = 1e-12, .max_iterations = 30, .line_search = 1};

static bd_status correct(bd_equations *e, const bd_solver_options *options, double *y,
                         const double *row, const double *scale, double *tangent,
                         bd_solver_report *report) {
    const bd_condition plane = {.kind = BD_LINEAR, .row = row};
    return bd_solve(e, &plane, options, scale, y, tangent, report);
}

static void test_converges(void) {
    oscillator o;
    make(&o, 3.0, 1.0);
    double y[4] = {0.1, 0.5, 1.5, 1.2}, r[3], tangent[4] = {NAN, NAN, NAN, NAN};
    bd_solver_report report;
    CHECK(correct(o.equations, &usual, y, at_frequency, ones, tangent, &report) == BD_OK);
    CHECK(y[3] == 1.2);
    CHECK(report.residual <= 1e-12 && report.iterations >= 2 && report.factored.rank == 4 &&
          report.factored.condition > 1e-6);
    CHECK(bd_hbm_evaluate(&o.sector->hbm, y, y[3], r, NULL, NULL) == BD_OK);
    for (int i = 0; i < 3; ++i) CHECK_NEAR(r[i], 0.0, 1e-12);
    /* closed form of the amplitude at this frequency: the loop force must balance */
    const double X = hypot(y[1], y[2]), T = acos(1.0 - 2.0 / X);
    const double ka = (T - 0.5 * sin(2.0 * T)) / BD_PI, kb = 4.0 / (BD_PI * X) * (1.0 - 1.0 / X);
    CHECK(X > 1.0);
    CHECK_NEAR(hypot(1.0 + ka - 1.44, 0.024 + kb) * X, 1.0, 1e-11);
    /* the tangent has unit length, points along the normal and leads to a solution nearby */
    double length = 0.0;
    for (int i = 0; i < 4; ++i) length += tangent[i] * tangent[i];
    CHECK_NEAR(length, 1.0, 1e-14);
    CHECK(tangent[3] > 0.0);
    double near[4];
    const double h = 1e-5;
    for (int i = 0; i < 4; ++i) near[i] = y[i] + h * tangent[i];
    CHECK(bd_hbm_evaluate(&o.sector->hbm, near, near[3], r, NULL, NULL) == BD_OK);
    for (int i = 0; i < 3; ++i) CHECK_NEAR(r[i], 0.0, 1e3 * h * h);
    /* the corrected point stays in the plane normal to the given vector */
    double moved[4];
    for (int i = 0; i < 4; ++i) moved[i] = y[i] + 0.05 * tangent[i];
    memcpy(near, moved, sizeof near);
    CHECK(correct(o.equations, &usual, moved, tangent, ones, NULL, &report) == BD_OK);
    double across = 0.0;
    for (int i = 0; i < 4; ++i) across += tangent[i] * (moved[i] - near[i]);
    CHECK_NEAR(across, 0.0, 1e-13);
    finish(&o);
}

static void test_scaling_does_not_matter(void) {
    oscillator o;
    make(&o, 3.0, 1.0);
    double a[4] = {0.1, 0.5, 1.5, 1.2}, b[4] = {0.1, 0.5, 1.5, 1.2};
    const double scale[4] = {1e-3, 2.0, 7.0, 50.0};
    bd_solver_report report;
    CHECK(correct(o.equations, &usual, a, at_frequency, ones, NULL, &report) == BD_OK);
    CHECK(correct(o.equations, &usual, b, at_frequency, scale, NULL, &report) == BD_OK);
    for (int i = 0; i < 4; ++i) CHECK_NEAR(a[i], b[i], 1e-10);
    finish(&o);
}

/* Full slip and no spring on the mean: nothing determines its position. */
static void test_singular(void) {
    oscillator o;
    make(&o, 0.0, 6.0);
    double y[4] = {0.3, -2.0, 0.3, 2.0};
    bd_solver_report report;
    double tangent[4];
    CHECK(correct(o.equations, &usual, y, at_frequency, ones, tangent, &report) == BD_OK);
    CHECK(report.factored.rank == 3);
    CHECK_NEAR(y[0], 0.3, 1e-12); /* the least-norm solution does not move it */
    CHECK_NEAR(tangent[0], 0.0, 1e-12);
    finish(&o);
}

static void test_failures(void) {
    oscillator o;
    make(&o, 3.0, 1.0);
    bd_solver_report report;
    bd_solver_options options = usual;
    double y[4] = {0.1, NAN, 0.0, 1.0};
    CHECK(correct(o.equations, &usual, y, at_frequency, ones, NULL, &report) == BD_NOT_FINITE);
    double z[4] = {0.1, 0.5, 1.5, INFINITY};
    CHECK(correct(o.equations, &usual, z, at_frequency, ones, NULL, &report) == BD_NOT_FINITE);
    double few[4] = {0.1, 0.5, 1.5, 1.0};
    options.max_iterations = 1;
    CHECK(correct(o.equations, &options, few, at_frequency, ones, NULL, &report) ==
          BD_NOT_CONVERGED);
    CHECK(report.iterations == 1 && report.residual > 1e-12);
    finish(&o);
}

/* At fixed omega the last unknown is a factor on the excitation. */
static void test_ramp(void) {
    oscillator o;
    make(&o, 3.0, 1.0);
    const double ramp[3] = {0.0, 1.0, 0.0};
    bd_equations *eased;
    CHECK(bd_eased_create(&eased, o.sector, 0.5, ramp, NULL) == BD_OK);
    double y[4] = {0.0, 0.0, 0.0, 0.25}, tangent[4];
    bd_solver_report report;
    CHECK(correct(eased, &usual, y, at_frequency, ones, tangent, &report) == BD_OK);
    CHECK(y[3] == 0.25);
    /* small motion sticks: linear with stiffness 2 */
    CHECK_NEAR(hypot(y[1], y[2]), 0.25 / hypot(2.0 - 0.25, 0.01), 1e-12);
    CHECK_NEAR(tangent[1] / tangent[3], y[1] / 0.25, 1e-10);
    CHECK_NEAR(tangent[2] / tangent[3], y[2] / 0.25, 1e-10);
    bd_equations_destroy(eased);
    finish(&o);
}

/* A spring of stiffness 3 on both amplitudes, times 1/s - 1, and a drag that couples them. */
static void test_support(void) {
    oscillator o;
    make(&o, 3.0, 1.0);
    const double ramp[3] = {0.0, 0.0, 0.0},
                 support[9] = {5.0, 0.0, 0.0, 0.0, 3.0, 0.7, 0.0, -0.7, 3.0};
    bd_equations *eased;
    CHECK(bd_eased_create(&eased, o.sector, 0.5, ramp, support) == BD_OK);
    double y[4] = {0.2, 0.0, 0.0, 0.5}, tangent[4], near[4] = {0.0, 0.0, 0.0, 0.5001};
    bd_solver_report report;
    CHECK(correct(eased, &usual, y, at_frequency, ones, tangent, &report) == BD_OK);
    /* small motion sticks: linear with stiffness 2 + 3 and damping 0.01 + 0.7 */
    CHECK_NEAR(hypot(y[1], y[2]), 1.0 / hypot(5.0 - 0.25, 0.71), 1e-12);
    CHECK(correct(eased, &usual, near, at_frequency, ones, NULL, &report) == BD_OK);
    for (int i = 1; i < 3; ++i) CHECK_NEAR((near[i] - y[i]) / 1e-4, tangent[i] / tangent[3], 1e-3);
    /* no effect at s = 1 */
    double end[4] = {0.0, 0.5, 1.5, 1.0}, plain[4] = {0.0, 0.5, 1.5, 0.5};
    CHECK(correct(eased, &usual, end, at_frequency, ones, NULL, &report) == BD_OK);
    CHECK(correct(o.equations, &usual, plain, at_frequency, ones, NULL, &report) == BD_OK);
    for (int i = 0; i < 3; ++i) CHECK_NEAR(end[i], plain[i], 1e-11);
    bd_equations_destroy(eased);
    finish(&o);
}

/* The peak of a linear oscillator in closed form: |x|^2 has its maximum at the minimum of
 * (k - w^2)^2 + (c w)^2. */
static void test_peak(void) {
    oscillator o;
    make(&o, 3.0, 0.01); /* it sticks: stiffness 2, damping 0.02 */
    const double re[3] = {0.0, 1.0, 0.0}, im[3] = {0.0, 0.0, -1.0},
                 w = sqrt(2.0 - 0.5 * 0.02 * 0.02);
    const double scale[4] = {1.0, 0.3, 0.3, 0.01};
    double y[4] = {0.0, 0.0, 0.3, 0.998 * w}, tangent[4];
    bd_solver_report report;
    CHECK(correct(o.equations, &usual, y, at_frequency, scale, tangent, &report) == BD_OK);
    bd_condition peak = {.kind = BD_STATIONARY,
                         .re = re,
                         .im = im,
                         .curvature = -1.0,
                         .tolerance = 1e-9,
                         .max_step = 0.2};
    double found[4], t[4];
    memcpy(found, y, sizeof y);
    memcpy(t, tangent, sizeof t);
    bd_solver_options unbounded = usual;
    unbounded.max_iterations = INT_MAX;
    CHECK(bd_solve(o.equations, &peak, &unbounded, scale, found, t, &report) == BD_OK);
    CHECK_NEAR(found[3], w, 1e-10);
    memcpy(found, y, sizeof y);
    memcpy(t, tangent, sizeof t);
    CHECK(bd_solve(o.equations, &peak, &usual, scale, found, t, &report) == BD_OK);
    CHECK_NEAR(found[3], w, 1e-10);
    CHECK(report.curvature < 0.0 && fabs(report.slope) < 1e-8 && report.residual <= 1e-12);
    CHECK_NEAR(report.slope, bd_slope(&peak, found, t, scale, 3), 1e-15);
    /* a linear curve has no fold, and no peak with increasing phi */
    const bd_condition fold = {.kind = BD_STATIONARY,
                               .curvature = -1.0,
                               .tolerance = 1e-9,
                               .max_step = 0.2};
    memcpy(found, y, sizeof y);
    memcpy(t, tangent, sizeof t);
    CHECK(bd_solve(o.equations, &fold, &usual, scale, found, t, &report) == BD_NOT_CONVERGED);
    peak.curvature = 1.0;
    memcpy(found, y, sizeof y);
    memcpy(t, tangent, sizeof t);
    CHECK(bd_solve(o.equations, &peak, &usual, scale, found, t, &report) != BD_OK);
    finish(&o);
}

/* Nothing is solved with factors of another point. */
static void test_order(void) {
    oscillator o;
    make(&o, 3.0, 1.0);
    const double y[4] = {0.1, 0.5, 1.5, 1.2}, bad[4] = {0.1, NAN, 1.5, 1.2},
                 wild[4] = {0.0, NAN, 0.0, 1.0};
    const bd_border border = {at_frequency, ones}, no_border = {wild, ones};
    double b[4] = {1.0, 2.0, 3.0, 4.0};
    bd_equations *e = o.equations;
    CHECK(bd_factor(e, &border) == BD_BAD_STATE);
    CHECK(bd_evaluate(e, y, 0) == BD_OK);
    CHECK(bd_factor(e, &border) == BD_BAD_STATE); /* no derivatives */
    CHECK(bd_evaluate(e, y, 1) == BD_OK);
    CHECK(bd_solve_linear(e, 0.0, b) == BD_BAD_STATE);
    CHECK(bd_solve_transposed(e, b) == BD_BAD_STATE);
    CHECK(bd_factor(e, &border) == BD_OK);
    CHECK(bd_solve_linear(e, 0.0, b) == BD_OK);
    CHECK(bd_solve_transposed(e, b) == BD_OK);
    CHECK(bd_factor(e, &no_border) != BD_OK);
    CHECK(bd_solve_linear(e, 0.0, b) == BD_BAD_STATE); /* not with an incomplete factorisation */
    CHECK(bd_factor(e, &border) == BD_OK);             /* but again at the same point */
    CHECK(bd_evaluate(e, bad, 1) == BD_NOT_FINITE);
    CHECK(bd_factor(e, &border) == BD_BAD_STATE);
    CHECK(bd_solve_linear(e, 0.0, b) == BD_BAD_STATE);
    finish(&o);
}

/* A product that fails, as is possible for equations without a stored J. */
static bd_status no_product(bd_equations *e, int transposed, const double *x, double *out) {
    (void)e, (void)transposed, (void)x, (void)out;
    return BD_SINGULAR;
}

static bd_equations_type forming;

/* Provide J for the factors only, not at trial points. */
static bd_status evaluate_once(bd_equations *e, const double *y, int derivative) {
    static double *J = NULL;
    if (e->J) J = e->J;
    e->J = J;
    const bd_status status = forming.evaluate(e, y, derivative);
    if (y[3] != 1.2) e->J = NULL;
    return status;
}

static void test_gradient_that_fails(void) {
    oscillator o;
    make(&o, 3.0, 1.0);
    const double y[4] = {0.1, 0.5, 1.5, 1.2};
    const bd_condition fold = {.kind = BD_STATIONARY,
                               .curvature = -1.0,
                               .tolerance = 1e-9,
                               .max_step = 0.2};
    double row[4], nu[3];
    CHECK(bd_gradient(o.equations, &fold, ones, y, at_frequency, 1e-5, row, nu) == BD_OK);
    forming = *o.equations->type;
    bd_equations_type type = forming;
    type.evaluate = evaluate_once, type.product = no_product;
    o.equations->type = &type;
    CHECK(bd_gradient(o.equations, &fold, ones, y, at_frequency, 1e-5, row, nu) == BD_SINGULAR);
    o.equations->type = &forming;
    finish(&o);
}

static void test_all(void) {
    test_support();
    test_converges();
    test_scaling_does_not_matter();
    test_singular();
    test_failures();
    test_ramp();
    test_peak();
    test_order();
}

int main(void) {
    elimination = BD_FULL;
    test_all();
    test_gradient_that_fails(); /* stores J */
    elimination = BD_CONDENSED;
    test_all();
    bd_equations_destroy(NULL);
    return check_result();
}
