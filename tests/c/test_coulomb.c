/* Coupled friction: steady circular motion, straight lines, the steady cycle of an
 * ellipse, finite differences. */
#include "contact/evaluator.h"
#include "check.h"

#include <string.h>

enum { TIME = 256 };

typedef struct {
    double F[15], block[7 * 25];
    bd_response out;
    bd_status_share share;
} result;

static void evaluate(bd_evaluator *e, const bd_element *element, const double *x, result *r) {
    const int nn = bd_n_coef(e->n_harm) * bd_n_coef(e->n_harm);
    double *b = r->block;
    r->out = (bd_response){.F = r->F,
                           .dT = {b, b + nn},
                           .dTv = {b + 2 * nn, b + 3 * nn},
                           .dTc = {b + 4 * nn, b + 5 * nn},
                           .dN = b + 6 * nn};
    bd_contact_evaluate(element, x, &r->out, &r->share, e);
    bd_element_write_blocks(element, e->n_harm, &r->out);
}

/* Radius R, limit b = mu N/kt < R: the slider moves on the circle of radius sqrt(R^2 - b^2), a
 * quarter turn of force behind it, and the work is 2 pi mu N sqrt(R^2 - b^2) a cycle.  The circle
 * is sampled as a polygon. */
static void test_circle(bd_law law) {
    const double kt = 1.3, R = 0.8, mu = 0.4, N = 2.0, b = mu * N / kt;
    const bd_element element = {
        .law = law, .kt = {kt, kt}, .kn = 5.0, .mu = mu, .n0 = N, .load = N};
    const double x[9] = {0.1, R, 0.0, -0.2, 0.0, R, 0.0, 0.0, 0.0};
    bd_evaluator e;
    result r;
    CHECK(bd_evaluator_create(&e, BD_SAMPLED, 1, TIME) == BD_OK);
    evaluate(&e, &element, x, &r);
    const double radius = sqrt(R * R - b * b),
                 work = BD_PI * (x[1] * r.F[2] * -1.0 + x[5] * r.F[4]);
    CHECK_NEAR(work, BD_TWO_PI * mu * N * radius, 5e-4);
    CHECK_NEAR(hypot(r.F[1], r.F[2]), mu * N, 1e-4);
    CHECK_NEAR(r.F[1], r.F[5], 1e-10);
    CHECK_NEAR(r.F[0], 0.0, 1e-10);
    CHECK_NEAR(r.share.slip[0], 1.0, 1e-12);
    CHECK(r.out.coupled == 1 && r.out.with_normal[0] == (law == BD_LAW_COUPLED));
    bd_evaluator_destroy(&e);
}

/* Along a straight line the coupled law is the 1-D law along this line. */
static void test_line(void) {
    const double c = cos(0.6), s = sin(0.6);
    const double u[5] = {0.1, 1.4, 0.3, 0.2, -0.4}, v[5] = {0.2, 0.5, -0.7, 0.3, 0.1};
    const bd_element coupled = {
        .law = BD_LAW_COUPLED, .kt = {1.3, 1.3}, .kn = 2.0, .mu = 0.5, .n0 = 0.3};
    bd_element line = coupled;
    line.law = BD_LAW_SEPARABLE;
    double x[15], y[15];
    memset(y, 0, sizeof y);
    for (int i = 0; i < 5; ++i) {
        x[i] = c * u[i], x[5 + i] = s * u[i], x[10 + i] = v[i];
        y[i] = u[i], y[10 + i] = v[i];
    }
    bd_evaluator e, exact;
    result r, q;
    CHECK(bd_evaluator_create(&e, BD_SAMPLED, 2, 2048) == BD_OK &&
          bd_evaluator_create(&exact, BD_EXACT, 2, 0) == BD_OK);
    evaluate(&e, &coupled, x, &r);
    evaluate(&exact, &line, y, &q);
    CHECK(q.share.open > 0.0 && q.share.slip[0] > 0.0 && q.share.stick[0] > 0.0);
    for (int i = 0; i < 5; ++i) {
        CHECK_NEAR(r.F[i], c * q.F[i], 1e-5);
        CHECK_NEAR(r.F[5 + i], s * q.F[i], 1e-5);
        CHECK_NEAR(r.F[10 + i], q.F[10 + i], 1e-5);
    }
    bd_evaluator_destroy(&e);
    bd_evaluator_destroy(&exact);
}

/* The ellipse 1 x 0.5 takes thousands of periods to become steady at b = 0.999; Newton's method
 * takes a few. */
static void test_ellipse(void) {
    const double limit[4] = {0.5, 0.9, 0.99, 0.999};
    bd_evaluator e;
    result r, again;
    CHECK(bd_evaluator_create(&e, BD_SAMPLED, 1, TIME) == BD_OK);
    for (int i = 0; i < 4; ++i) {
        bd_element element = {
            .law = BD_LAW_COUPLED, .kt = {1.0, 1.0}, .kn = 0.0, .mu = 1.0, .n0 = limit[i]};
        const double x[9] = {0.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0};
        evaluate(&e, &element, x, &r);
        CHECK(e.coulomb.n_period <= 10);
        CHECK(r.share.slip[0] > 0.0);
        CHECK_NEAR(r.F[0], 0.0, 1e-10); /* the steady cycle is symmetric under half a turn */
        CHECK_NEAR(r.F[3], 0.0, 1e-10);
        element.w[0] = 0.3, element.w[1] = -0.2; /* from any initial slider */
        evaluate(&e, &element, x, &again);
        for (int k = 0; k < 6; ++k) CHECK_NEAR(again.F[k], r.F[k], 1e-10);
    }
    bd_evaluator_destroy(&e);
}

/* Towards the onset of slip the derivative approaches its limit, although the slip distance falls
 * below rounding. */
static void test_tangent_at_onset(void) {
    bd_evaluator e;
    static result near, r;
    CHECK(bd_evaluator_create(&e, BD_SAMPLED, 1, TIME) == BD_OK);
    for (int turned = 0; turned < 2; ++turned) {
        const double x[9] = {0.0, 1.0, 0.0, 0.0, 0.0, turned ? 0.99 : 0.5, 0.0, turned ? 0.1 : 0.0,
                             0.0};
        bd_element element = {
            .law = BD_LAW_COUPLED, .kt = {1.0, 1.0}, .kn = 0.3, .mu = 1.0, .n0 = 1.0 - 1e-8};
        evaluate(&e, &element, x, &near);
        for (double beyond = 1e-10; beyond > 0.5e-13; beyond *= 0.1) {
            element.n0 = 1.0 - beyond;
            evaluate(&e, &element, x, &r);
            CHECK(r.share.slip[0] > 0.0);
            for (int i = 0; i < 7 * 9; ++i) CHECK_NEAR(r.block[i], near.block[i], 5e-4);
        }
    }
    bd_evaluator_destroy(&e);
}

static void test_tangent(bd_law law, bd_evaluation evaluation) {
    unsigned long long seed = 77;
    bd_evaluator e;
    CHECK(bd_evaluator_create(&e, evaluation, 2, 64) == BD_OK);
    int wrong = 0, slipping = 0, opening = 0;
    for (int trial = 0; trial < 200; ++trial) {
        const bd_element element = {.law = law,
                                    .kt = {1.5 + uniform(&seed), 1.5 + uniform(&seed)},
                                    .kn = 1.5 + uniform(&seed),
                                    .mu = 0.6 + 0.4 * uniform(&seed),
                                    .n0 = 0.8 + uniform(&seed),
                                    .load = 1.0};
        double x[15], d[15], plus[15], minus[15];
        for (int i = 0; i < 15; ++i) x[i] = uniform(&seed), d[i] = uniform(&seed);
        const double h = 1e-6;
        result r, p, m;
        for (int i = 0; i < 15; ++i) plus[i] = x[i] + h * d[i], minus[i] = x[i] - h * d[i];
        evaluate(&e, &element, x, &r);
        evaluate(&e, &element, plus, &p);
        evaluate(&e, &element, minus, &m);
        CHECK(e.coulomb.n_period <= 10);
        slipping += r.share.slip[0] > 0.0;
        opening += r.share.open > 0.0;
        double error = 0.0, size = 1.0;
        for (int a = 0; a < 2; ++a)
            for (int i = 0; i < 5; ++i) {
                double exact = 0.0;
                for (int j = 0; j < 5; ++j)
                    exact += r.out.dT[a][i * 5 + j] * d[5 * a + j] +
                             r.out.dTc[a][i * 5 + j] * d[5 * (1 - a) + j] +
                             r.out.dTv[a][i * 5 + j] * d[10 + j];
                error = fmax(error, fabs((p.F[5 * a + i] - m.F[5 * a + i]) / (2.0 * h) - exact));
                size = fmax(size, fabs(exact));
            }
        wrong += error > 1e-6 * size;
    }
    CHECK(slipping > 50 && (opening > 20) == (law == BD_LAW_COUPLED));
    CHECK(wrong <= 3); /* states with an event within the step of the difference */
    bd_evaluator_destroy(&e);
}

/* Eight points together (stick, slip, separation and other laws) equal the
 * same points one by one. */
static void test_lanes(void) {
    unsigned long long seed = 5;
    bd_evaluator e;
    CHECK(bd_evaluator_create(&e, BD_SAMPLED, 2, 64) == BD_OK);
    for (int trial = 0; trial < 40; ++trial) {
        static result many[BD_LANES], one;
        bd_element element[BD_LANES];
        bd_response out[BD_LANES];
        bd_status_share share[BD_LANES];
        double x[BD_LANES * 15];
        for (int i = 0; i < BD_LANES * 15; ++i) x[i] = uniform(&seed);
        for (int lane = 0; lane < BD_LANES; ++lane) {
            const bd_law law[4] = {BD_LAW_COUPLED, BD_LAW_COUPLED_CONSTANT, BD_LAW_COUPLED,
                                   BD_LAW_SEPARABLE};
            element[lane] = (bd_element){.law = law[lane % 4],
                                         .kt = {1.5, 1.5 + uniform(&seed)},
                                         .kn = 1.5 + uniform(&seed),
                                         .mu = 0.5,
                                         .n0 = 3.0 + 4.0 * uniform(&seed),
                                         .load = 2.0 + uniform(&seed)};
            double *b = many[lane].block;
            out[lane] = (bd_response){.F = many[lane].F,
                                      .dT = {b, b + 25},
                                      .dTv = {b + 50, b + 75},
                                      .dTc = {b + 100, b + 125},
                                      .dN = b + 150};
        }
        bd_contact_evaluate_many(BD_LANES, element, x, out, share, &e);
        for (int lane = 0; lane < BD_LANES; ++lane) {
            bd_element_write_blocks(element + lane, 2, out + lane);
            evaluate(&e, element + lane, x + 15 * lane, &one);
            for (int i = 0; i < 15; ++i) CHECK_NEAR(many[lane].F[i], one.F[i], 1e-11);
            for (int i = 0; i < 7 * 25; ++i)
                CHECK_NEAR(many[lane].block[i], one.block[i], 1e-8 * (1.0 + fabs(one.block[i])));
            CHECK_NEAR(share[lane].slip[0], one.share.slip[0], 1e-12);
        }
    }
    bd_evaluator_destroy(&e);
}

/* All builds of the inner loop move the sliders equally, and through whole slip steps as in the
 * closed form. */
static void test_slide(void) {
    enum { N = 64, SIZE = N * BD_LANES };
    static double memory[BD_MOST_KERNELS][(4 + 7 + 18) * SIZE];
    static unsigned char kind[BD_MOST_KERNELS][SIZE];
    bd_coupled_lanes l[BD_MOST_KERNELS];
    const bd_kernel *kernel[BD_MOST_KERNELS];
    const int n = bd_kernel_all(kernel);
    int slips = 0, opens = 0, closes = 0, sticks = 0;
    for (int v = 0; v < n; ++v) {
        unsigned long long seed = 8;
        double *m = memory[v];
        l[v] = (bd_coupled_lanes){.n_time = N,
                                  .interpolate = 1,
                                  .x = m,
                                  .y = m + SIZE,
                                  .R = m + 2 * SIZE,
                                  .g = m + 3 * SIZE};
        l[v].chord = m + 4 * SIZE, l[v].step = m + 11 * SIZE, l[v].step_kind = kind[v];
        for (int lane = 0; lane < BD_LANES; ++lane) {
            const double a = uniform(&seed), b = uniform(&seed), c = 2.0 * uniform(&seed),
                         swing = lane < 2 ? 1e-6 : lane;
            l[v].mu[lane] = 0.4;
            for (int k = 0; k < N; ++k) {
                const double t = BD_TWO_PI * k / N, g = 1.0 + 0.2 * swing * cos(t + c);
                const int at = k * BD_LANES + lane;
                l[v].x[at] = cos(t) + 0.3 * a * sin(2 * t);
                l[v].y[at] = a * sin(t) + b * cos(2 * t);
                l[v].g[at] = g;
                l[v].R[at] = 0.4 * fmax(g, 0.0);
            }
        }
        kernel[v]->coupled_chords(l + v, 1);
        kernel[v]->coupled_period(l + v, 0, 0); /* from zero to the limits */
        memcpy(l[v].s, l[v].end, sizeof l[v].s);
        kernel[v]->coupled_period(l + v, 1, 1);
        for (int i = 0; i < 4 * BD_LANES; ++i) {
            CHECK_NEAR(l[v].period_derivative[i], l[0].period_derivative[i], 1e-12);
            if (i >= 2 * BD_LANES) continue;
            CHECK_NEAR(l[v].end[i], l[0].end[i], 1e-13);
            CHECK_NEAR(l[v].net_motion[i], l[v].end[i] - l[v].s[i], 1e-11);
        }
        for (int i = 0; i < SIZE; ++i) CHECK(kind[v][i] == kind[0][i]);
        for (int part = 0; part < 18; ++part)
            for (int i = 0; i < SIZE; ++i)
                if (part < 2 || kind[v][i] != BD_STEP_STICK)
                    CHECK_NEAR(l[v].step[part * SIZE + i], l[0].step[part * SIZE + i],
                               1e-9 * (1.0 + fabs(l[0].step[part * SIZE + i])));
        for (int lane = 0; lane < BD_LANES; ++lane)
            for (int k = 1; k < N; ++k) {
                const int at = k * BD_LANES + lane, from = at - BD_LANES;
                slips += kind[v][at] == BD_STEP_SLIP, opens += kind[v][at] == BD_STEP_OPEN;
                closes += kind[v][at] == BD_STEP_CLOSE, sticks += kind[v][at] == BD_STEP_STICK;
                const double R0 = l[v].R[from], R1 = l[v].R[at], *s = l[v].step, *r = s + SIZE;
                const double T0 = l[v].x[from] - s[from], T1 = l[v].y[from] - r[from];
                const double d0 = l[v].x[at] - l[v].x[from], d1 = l[v].y[at] - l[v].y[from],
                             D = hypot(d0, d1);
                if (kind[v][at] != BD_STEP_SLIP || !(R0 > 0.0) ||
                    hypot(T0, T1) < R0 * (1.0 - 1e-13))
                    continue;
                if (T0 * d0 + T1 * d1 <= R0 * (R1 - R0)) continue;
                const double before = atan2(d0 * T1 - d1 * T0, d0 * T0 + d1 * T1);
                const double time = R1 == R0 ? 1.0 / R0 : log1p((R1 - R0) / R0) / (R1 - R0);
                const double after = 2.0 * atan(tan(0.5 * before) * exp(-D * time)),
                             turn = atan2(d1, d0) + after;
                CHECK_NEAR(s[at], l[v].x[at] - R1 * cos(turn), 1e-12);
                CHECK_NEAR(r[at], l[v].y[at] - R1 * sin(turn), 1e-12);
            }
    }
    CHECK(slips > 100 * n && opens > 10 * n && closes >= n && sticks > 10 * n);
}

static void test_refusal(void) {
    CHECK(!bd_evaluation_supports(BD_EXACT, BD_LAW_COUPLED) &&
          !bd_evaluation_supports(BD_EXACT, BD_LAW_COUPLED_CONSTANT));
    CHECK(bd_evaluation_supports(BD_EXACT, BD_LAW_BONDED) &&
          bd_evaluation_supports(BD_SAMPLED, BD_LAW_COUPLED));
    bd_coulomb_destroy(NULL);
}

int main(void) {
    test_circle(BD_LAW_COUPLED);
    test_circle(BD_LAW_COUPLED_CONSTANT);
    test_line();
    test_ellipse();
    test_tangent_at_onset();
    test_tangent(BD_LAW_COUPLED, BD_SAMPLED);
    test_tangent(BD_LAW_COUPLED_CONSTANT, BD_SAMPLED);
    test_tangent(BD_LAW_COUPLED, BD_SAMPLED_PLAIN);
    test_lanes();
    test_slide();
    test_refusal();
    return check_result();
}
