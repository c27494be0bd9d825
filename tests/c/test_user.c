/* Contact laws as functions: Jenkins elements against the friction law of the core, tangents by
 * differences, time integration. */
#include "contact/evaluator.h"
#include "time/integration.h"
#include "check.h"

#include <string.h>

enum { HARM = 2, COEF = 2 * HARM + 1, TIME = 64, BLOCK = COEF * COEF };

typedef struct {
    double F[3 * COEF], block[9 * BLOCK];
    bd_response out;
    bd_status_share share;
} result;

static void evaluate(bd_evaluator *e, const bd_element *element, const double *x, result *r) {
    double *b = r->block;
    for (int i = 0; i < 9 * BLOCK; ++i) b[i] = NAN;
    r->out = (bd_response){.F = r->F,
                           .dT = {b, b + BLOCK},
                           .dTv = {b + 2 * BLOCK, b + 3 * BLOCK},
                           .dTc = {b + 4 * BLOCK, b + 5 * BLOCK},
                           .dN = b + 6 * BLOCK,
                           .dNt = {b + 7 * BLOCK, b + 8 * BLOCK}};
    bd_contact_evaluate(element, x, &r->out, &r->share, e);
    bd_element_write_blocks(element, HARM, &r->out);
}

static bd_element with_law(const bd_point_law *point_law) {
    return (bd_element){.law = BD_LAW_USER, .kt = {1.0, 1.0}, .point_law = point_law};
}

static void test_one_element_is_ours(void) {
    unsigned long long seed = 3;
    bd_evaluator e;
    const bd_point_law room = {.function = bd_law_jenkins, .n_state = 2};
    CHECK(bd_evaluator_create(&e, BD_SAMPLED, HARM, TIME) == BD_OK &&
          bd_evaluator_add_laws(&e, 1, &room) == BD_OK);
    for (int trial = 0; trial < 200; ++trial) {
        const double k = 1.5 + uniform(&seed), kn = 1.5 + uniform(&seed),
                     mu = 0.5 + 0.4 * uniform(&seed);
        const double n0 = 2.0 * uniform(&seed), w[2] = {uniform(&seed), uniform(&seed)};
        const double p[5] = {1.0, kn, k, 0.0, mu}, memory[5] = {0.0, 0.0, 0.0, w[0], w[1]};
        const bd_point_law point_law = {bd_law_jenkins, NULL, 5, 2, p, memory};
        const bd_element ours = {.kt = {k, k}, .kn = kn, .mu = mu, .n0 = n0, .w = {w[0], w[1]}};
        bd_element user = with_law(&point_law);
        user.kn = kn, user.n0 = n0;
        double x[3 * COEF];
        for (int i = 0; i < 3 * COEF; ++i) x[i] = uniform(&seed);
        result a, b;
        evaluate(&e, &ours, x, &a);
        evaluate(&e, &user, x, &b);
        CHECK(e.user.n_period <= 5 && e.user.n_call <= 5 * TIME);
        for (int i = 0; i < 3 * COEF; ++i) CHECK_NEAR(b.F[i], a.F[i], 1e-13);
        for (int i = 0; i < 9 * BLOCK; ++i) CHECK_NEAR(b.block[i], a.block[i], 1e-13);
    }
    bd_evaluator_destroy(&e);
}

static void test_tangent(const bd_point_law *point_law) {
    unsigned long long seed = 11;
    bd_evaluator e;
    CHECK(bd_evaluator_create(&e, BD_SAMPLED, HARM, TIME) == BD_OK &&
          bd_evaluator_add_laws(&e, 1, point_law) == BD_OK);
    const bd_element element = with_law(point_law);
    double x[3 * COEF], d[3 * COEF], moved[3 * COEF], difference[3 * COEF] = {0.0};
    for (int i = 0; i < 3 * COEF; ++i) x[i] = uniform(&seed), d[i] = uniform(&seed);
    x[2 * COEF] += 8.0;
    result at, side;
    evaluate(&e, &element, x, &at);
    for (int sign = -1; sign <= 1; sign += 2) {
        for (int i = 0; i < 3 * COEF; ++i) moved[i] = x[i] + 1e-6 * sign * d[i];
        evaluate(&e, &element, moved, &side);
        for (int i = 0; i < 3 * COEF; ++i) difference[i] += sign * side.F[i] / 2e-6;
    }
    for (int a = 0; a < 3; ++a)
        for (int i = 0; i < COEF; ++i) {
            double sum = 0.0;
            for (int c = 0; c < 3; ++c) {
                const double *block =
                    a == 2 ? (c == 2 ? at.out.dN : at.out.dNt[c])
                           : (c == 2 ? at.out.dTv[a] : (c == a ? at.out.dT[a] : at.out.dTc[a]));
                for (int j = 0; j < COEF; ++j) sum += block[i * COEF + j] * d[c * COEF + j];
            }
            CHECK_NEAR(sum, difference[a * COEF + i], 1e-6);
        }
    bd_evaluator_destroy(&e);
}

/* One mass on a joint with the given law. Without excitation the energy decreases monotonically,
 * and an integration in two parts equals one at once. */
static void test_time_integration(const bd_point_law *point_law) {
    const int one = 1, none[2] = {0}, user = BD_LAW_USER;
    const double unit[6] = {1.0, 0.0, 0.0, 0.0, 0.0, 0.0}, zero[6] = {0.0};
    const bd_time_input in = {.n_sector = 1,
                              .n_point = 1,
                              .n_family = 1,
                              .n_mode = &one,
                              .diameter = none,
                              .stiffness = unit,
                              .mass = unit,
                              .damping = zero,
                              .G = unit,
                              .kt = unit,
                              .kn = unit,
                              .mu = zero,
                              .n0 = unit,
                              .load = zero,
                              .shift = zero,
                              .law = &user,
                              .fixed_slider = none,
                              .response_row = unit,
                              .point_law = point_law};
    bd_time t;
    CHECK(bd_time_create(&t, &in) == BD_OK && t.n_memory == 3 + point_law->n_state);
    double w[2][2 + 3 + 64] = {{0.0}}, q[2][2] = {{1.0, 0.0}, {1.0, 0.0}}, v[2][2] = {{0.0}},
                        a[2][2] = {{0.0}};
    bd_time_effort effort = {0, 0};
    bd_time_path path = {.n_step = 128,
                         .steps_per_period = 64,
                         .omega = 1.0,
                         .omega_end = 1.0,
                         .spectral_radius = 0.8,
                         .tolerance = 1e-10};
    path.find_acceleration = 1;
    CHECK(bd_time_integrate(&t, &path, q[0], v[0], a[0], w[0], &effort) == BD_OK);
    path.n_step = 64;
    CHECK(bd_time_integrate(&t, &path, q[1], v[1], a[1], w[1], &effort) == BD_OK);
    path.find_acceleration = 0;
    CHECK(bd_time_integrate(&t, &path, q[1], v[1], a[1], w[1], &effort) == BD_OK);
    CHECK_NEAR(q[1][0], q[0][0], 1e-8);
    for (int i = 0; i < 5 + point_law->n_state; ++i) CHECK_NEAR(w[1][i], w[0][i], 1e-8);
    CHECK(q[0][0] * q[0][0] + v[0][0] * v[0][0] < 0.9);
    CHECK_NEAR(w[0][2], q[0][0], 1e-12); /* the memory contains the position */
    bd_time_destroy(&t);
}

int main(void) {
    const double zero[16] = {0.0},
                 joint[11] = {3.0, 1.2, 0.5, 0.05, 0.1, 0.4, 0.2, 0.0, 0.3, 0.4, 0.05};
    const double linear[6] = {1.5, 2.0, 0.1, 0.8, 0.3, 1.0},
                 round[6] = {0.0, 2.0, 0.1, 0.8, -0.3, 2.5};
    const bd_point_law law[3] = {{bd_law_jenkins, NULL, 11, 6, joint, zero},
                                 {bd_law_bouc_wen, NULL, 6, 2, linear, zero},
                                 {bd_law_bouc_wen, NULL, 6, 2, round, zero}};
    test_one_element_is_ours();
    for (int i = 0; i < 3; ++i) {
        test_tangent(law + i);
        test_time_integration(law + i);
    }
    return check_result();
}
