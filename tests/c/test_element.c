/* Sums over a cycle against Gauss-Legendre quadrature, and the linear limits of the element. */
#include "contact/element.h"
#include "util/trig_polynomial.h"
#include "check.h"

enum { HARM = 3, COEF = 2 * HARM + 1, POWER = 4 * HARM + 2 };

static void basis_at(double theta, double *b) {
    b[0] = 1.0;
    for (int l = 1; l <= HARM; ++l) {
        b[2 * l - 1] = cos(l * theta);
        b[2 * l] = sin(l * theta);
    }
}

static void integrate_between(double start, double end, double sign, double *E) {
    double from[POWER], to[POWER];
    bd_trig_powers(2 * HARM, start, from);
    bd_trig_powers(2 * HARM, end, to);
    bd_cycle_integrate(HARM, E, end - start, from, to, sign);
}

/* Four nodes on each of 200 parts: an error below rounding for these products. */
static void plain_products(double start, double end, double *products) {
    static const double node[4] = {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563,
                                   0.8611363115940526};
    static const double weight[4] = {0.3478548451374538, 0.6521451548625461, 0.6521451548625461,
                                     0.3478548451374538};
    double b[COEF];
    const double h = (end - start) / 200;
    for (int i = 0; i < COEF * COEF; ++i) products[i] = 0.0;
    for (int part = 0; part < 200; ++part)
        for (int q = 0; q < 4; ++q) {
            basis_at(start + h * (part + 0.5 + 0.5 * node[q]), b);
            for (int i = 0; i < COEF; ++i)
                for (int j = 0; j < COEF; ++j)
                    products[i * COEF + j] += 0.5 * h * weight[q] * b[i] * b[j];
        }
}

static void test_products(void) {
    unsigned long long seed = 5;
    for (int trial = 0; trial < 30; ++trial) {
        const double start = 6.0 * uniform(&seed), end = start + 3.0 * (1.0 + uniform(&seed));
        double E[POWER] = {0.0}, *products = not_numbers(COEF * COEF), plain[COEF * COEF];
        integrate_between(start, end, 1.0, E);
        bd_cycle_products(HARM, E, products);
        plain_products(start, end, plain);
        for (int i = 0; i < COEF * COEF; ++i) CHECK_NEAR(products[i], plain[i], 1e-12);
        integrate_between(start, end, -1.0, E);
        for (int i = 0; i < POWER; ++i) CHECK_NEAR(E[i], 0.0, 1e-15);
        free(products);
    }
}

/* Parts that fill a period satisfy the orthogonality relations. */
static void test_whole_period(void) {
    double E[POWER] = {0.0}, products[COEF * COEF];
    integrate_between(0.3, 1.7, 1.0, E);
    integrate_between(1.7, 5.0, 1.0, E);
    integrate_between(5.0, 0.3 + BD_TWO_PI, 1.0, E);
    bd_cycle_products(HARM, E, products);
    for (int i = 0; i < COEF; ++i)
        for (int j = 0; j < COEF; ++j)
            CHECK_NEAR(products[i * COEF + j], i != j ? 0.0 : (i == 0 ? BD_TWO_PI : BD_PI), 1e-14);
}

static void test_hold(void) {
    double stick[POWER], slip[POWER], held[COEF], held_u[COEF * COEF], held_v[COEF * COEF];
    double g[COEF], du[COEF], dv[COEF];
    bd_cycle cycle = {HARM, stick, slip, held, held_u, held_v};
    bd_cycle_clear(&cycle);
    for (int i = 0; i < COEF; ++i) g[i] = 1.0 + i, du[i] = 0.1 * i, dv[i] = -0.2 * i;
    bd_cycle_add_stick(&cycle, g, 2.0, du, dv);
    bd_cycle_add_stick(&cycle, g, 3.0, NULL, NULL); /* a slider without derivative */
    for (int i = 0; i < COEF; ++i) {
        CHECK_NEAR(held[i], 5.0 * g[i], 1e-14);
        for (int j = 0; j < COEF; ++j) {
            CHECK_NEAR(held_u[i * COEF + j], g[i] * du[j], 1e-15);
            CHECK_NEAR(held_v[i * COEF + j], g[i] * dv[j], 1e-15);
        }
    }
    bd_cycle without = {HARM, stick, slip, held, NULL, NULL};
    bd_cycle_clear(&without);
    bd_cycle_add_stick(&without, g, 2.0, du, dv);
    CHECK_NEAR(held[1], 4.0, 1e-15);
}

static void test_linear_limits(void) {
    const bd_element element = {
        .kt = {2.0, 3.0}, .kn = 5.0, .mu = 0.4, .n0 = 0.7, .w = {0.25, -0.5}};
    double *F = not_numbers(3 * COEF), *block = not_numbers(5 * COEF * COEF), x[COEF];
    const size_t nn = COEF * COEF;
    bd_response out = {.F = F,
                       .dT = {block, block + nn},
                       .dTv = {block + 2 * nn, block + 3 * nn},
                       .dN = block + 4 * nn};
    for (int i = 0; i < COEF; ++i) x[i] = 0.3 - 0.1 * i;
    bd_element_closed(&element, HARM, x, &out);
    for (int d = 0; d < 2; ++d) bd_element_stuck(&element, HARM, d, x, &out);
    CHECK(out.normal == BD_BLOCK_LINEAR && out.tangential[0] == BD_BLOCK_LINEAR &&
          out.tangential[1] == BD_BLOCK_LINEAR);
    bd_element_write_blocks(&element, HARM, &out);
    for (int i = 0; i < COEF; ++i) {
        CHECK_NEAR(F[i], 2.0 * (x[i] - (i == 0 ? 0.25 : 0.0)), 1e-15);
        CHECK_NEAR(F[COEF + i], 3.0 * (x[i] + (i == 0 ? 0.5 : 0.0)), 1e-15);
        CHECK_NEAR(F[2 * COEF + i], 5.0 * x[i] + (i == 0 ? 0.7 : 0.0), 1e-15);
        for (int j = 0; j < COEF; ++j) {
            CHECK(out.dT[0][i * COEF + j] == (i == j ? 2.0 : 0.0));
            CHECK(out.dT[1][i * COEF + j] == (i == j ? 3.0 : 0.0));
            CHECK(out.dN[i * COEF + j] == (i == j ? 5.0 : 0.0));
            CHECK(out.dTv[0][i * COEF + j] == 0.0 && out.dTv[1][i * COEF + j] == 0.0);
        }
    }
    bd_element_open(&element, HARM, &out);
    CHECK(out.normal == BD_BLOCK_ZERO && out.tangential[0] == BD_BLOCK_ZERO &&
          out.tangential[1] == BD_BLOCK_ZERO);
    for (int i = 0; i < 3 * COEF; ++i) CHECK(F[i] == 0.0);
    bd_element_write_blocks(&element, HARM, &out);
    for (size_t i = 0; i < 5 * nn; ++i) CHECK(block[i] == 0.0);
    free(F);
    free(block);
}

int main(void) {
    test_products();
    test_whole_period();
    test_hold();
    test_linear_limits();
    return check_result();
}
