/* Harmonic balance equations: a stuck system in closed form, finite differences, creation and
 * destruction of the workspace. */
#include "balance/harmonic_balance.h"
#include "check.h"

#include <string.h>

enum { POINTS = 3, HARM = 3, MODES = 2 + 3 + 0 + 2 }; /* modes of each harmonic: 2, 3, 0, 2 */
static const int n_mode[HARM + 1] = {2, 3, 0, 2};
enum { UNKNOWN = 2 + 2 * (3 + 0 + 2) };

typedef struct {
    double stiffness[MODES], mass[MODES], damping[MODES], G[2 * 3 * POINTS * MODES];
    double kt[2 * POINTS], kn[POINTS], mu[POINTS], n0[POINTS], w[2 * POINTS], shift[3 * POINTS],
        force[UNKNOWN];
    int law[POINTS];
    bd_hbm_input input;
} structure;

static void make_structure(structure *s, unsigned long long *seed, double mu,
                           bd_evaluation evaluation) {
    for (int i = 0; i < MODES; ++i) {
        s->stiffness[i] = 1.5 + uniform(seed);
        s->mass[i] = i % 3 == 2 ? 0.0 : 1.0;
        s->damping[i] = 0.1 + 0.05 * uniform(seed);
    }
    for (int i = 0; i < 2 * 3 * POINTS * MODES; ++i) s->G[i] = uniform(seed);
    for (int l = 0, k = 0; l <= HARM; ++l)
        for (int i = 0; i < 3 * POINTS * n_mode[l]; ++i, ++k)
            if (l == 0) s->G[2 * k + 1] = 0.0;
    for (int p = 0; p < POINTS; ++p) {
        s->kt[2 * p] = 1.5 + uniform(seed), s->kt[2 * p + 1] = 1.5 + uniform(seed);
        s->kn[p] = 1.5 + uniform(seed);
        s->mu[p] = mu;
        s->n0[p] = 1.0 + uniform(seed);
        s->w[2 * p] = 0.1 * uniform(seed), s->w[2 * p + 1] = 0.1 * uniform(seed);
        for (int a = 0; a < 3; ++a) s->shift[3 * p + a] = 0.2 * uniform(seed);
        s->law[p] = p == 1 ? BD_LAW_NORMAL : BD_LAW_SEPARABLE;
    }
    for (int i = 0; i < UNKNOWN; ++i) s->force[i] = uniform(seed);
    s->input = (bd_hbm_input){.n_point = POINTS,
                              .n_harm = HARM,
                              .n_mode = n_mode,
                              .stiffness = s->stiffness,
                              .mass = s->mass,
                              .damping = s->damping,
                              .G = s->G,
                              .kt = s->kt,
                              .kn = s->kn,
                              .mu = s->mu,
                              .n0 = s->n0,
                              .w = s->w,
                              .law = s->law,
                              .shift = s->shift,
                              .force = s->force,
                              .evaluation = evaluation,
                              .n_time = 64};
}

/* With high friction and preload nothing slips or opens: the contact is a set of springs. */
static void test_stuck_by_hand(void) {
    unsigned long long seed = 60;
    structure s;
    make_structure(&s, &seed, 1e6, BD_EXACT);
    for (int p = 0; p < POINTS; ++p) s.n0[p] = 1e6;
    bd_hbm hbm;
    CHECK(bd_hbm_create(&hbm, &s.input) == BD_OK);
    CHECK(hbm.n_unknown == UNKNOWN);
    double u[UNKNOWN], omega = 0.7;
    for (int i = 0; i < UNKNOWN; ++i) u[i] = uniform(&seed);
    double *r = not_numbers(UNKNOWN), *J = not_numbers(UNKNOWN * UNKNOWN),
           *d = not_numbers(UNKNOWN);
    CHECK(bd_hbm_evaluate(&hbm, u, omega, r, J, d) == BD_OK);
    for (int l = 0, first = 0, mode = 0, place = 0; l <= HARM; ++l) {
        const int n = n_mode[l];
        const double *G = s.G + 2 * place;
        for (int j = 0; j < n; ++j) {
            const double w = l * omega, k = s.stiffness[mode + j] - w * w * s.mass[mode + j];
            const double re = u[first + j], im = l == 0 ? 0.0 : -u[first + n + j];
            double r_re = k * re - w * s.damping[mode + j] * im,
                   r_im = k * im + w * s.damping[mode + j] * re;
            for (int c = 0; c < 3 * POINTS; ++c) {
                const int p = c / 3, a = c % 3;
                double stiffness = a == 2 ? s.kn[p] : s.kt[2 * p + a], constant = 0.0, x_re = 0.0,
                       x_im = 0.0;
                if (a < 2 && s.law[p] == BD_LAW_NORMAL) stiffness = 0.0;
                if (l == 0)
                    constant =
                        a == 2 ? s.n0[p] / stiffness + s.shift[c] : s.shift[c] - s.w[2 * p + a];
                for (int m = 0; m < n; ++m) {
                    const double g_re = G[2 * (c * n + m)], g_im = G[2 * (c * n + m) + 1];
                    const double q_re = u[first + m], q_im = l == 0 ? 0.0 : -u[first + n + m];
                    x_re += g_re * q_re - g_im * q_im;
                    x_im += g_re * q_im + g_im * q_re;
                }
                const double f_re = stiffness * (x_re + constant), f_im = stiffness * x_im;
                const double g_re = G[2 * (c * n + j)], g_im = G[2 * (c * n + j) + 1];
                r_re += g_re * f_re + g_im * f_im;
                r_im += g_re * f_im - g_im * f_re;
            }
            CHECK_NEAR(r[first + j], r_re - s.force[first + j],
                       1e-9 * (l == 0 ? 1e6 : 1.0) * 1e-3 + 1e-12);
            if (l > 0) CHECK_NEAR(r[first + n + j], -r_im - s.force[first + n + j], 1e-12);
        }
        first += (l == 0 ? 1 : 2) * n;
        mode += n;
        place += 3 * POINTS * n;
    }
    free(r);
    free(J);
    free(d);
    bd_hbm_destroy(&hbm);
}

static void test_derivatives(bd_evaluation evaluation) {
    unsigned long long seed = 70;
    int n_compared = 0;
    for (int trial = 0; trial < 5; ++trial) {
        structure s;
        make_structure(&s, &seed, 0.4, evaluation);
        bd_hbm hbm;
        CHECK(bd_hbm_create(&hbm, &s.input) == BD_OK);
        double u[UNKNOWN], plus[UNKNOWN], minus[UNKNOWN];
        for (int i = 0; i < UNKNOWN; ++i) u[i] = uniform(&seed);
        double *r = not_numbers(UNKNOWN), *J = not_numbers(UNKNOWN * UNKNOWN),
               *d = not_numbers(UNKNOWN);
        const double omega = 0.9, h = 1e-6;
        CHECK(bd_hbm_evaluate(&hbm, u, omega, r, J, d) == BD_OK);
        for (int j = 0; j <= UNKNOWN; ++j) {
            double up[UNKNOWN], down[UNKNOWN];
            memcpy(up, u, sizeof up);
            memcpy(down, u, sizeof down);
            if (j < UNKNOWN) up[j] += h, down[j] -= h;
            CHECK(bd_hbm_evaluate(&hbm, up, omega + (j == UNKNOWN ? h : 0.0), plus, NULL, NULL) ==
                  BD_OK);
            CHECK(bd_hbm_evaluate(&hbm, down, omega - (j == UNKNOWN ? h : 0.0), minus, NULL,
                                  NULL) == BD_OK);
            for (int i = 0; i < UNKNOWN; ++i) {
                const double difference = (plus[i] - minus[i]) / (2.0 * h);
                const double exact = j == UNKNOWN ? d[i] : J[i * UNKNOWN + j];
                CHECK_NEAR(exact, difference, 2e-6);
                n_compared += exact != 0.0 && exact != difference;
            }
        }
        CHECK(hbm.cost.n_jacobian == 1 && hbm.cost.n_evaluation == 1 + 2 * (UNKNOWN + 1));
        free(r);
        free(J);
        free(d);
        bd_hbm_destroy(&hbm);
    }
    CHECK(n_compared > 500);
}

/* No contact at all, and many points, so that the assembly takes several chunks. */
static void test_sizes(void) {
    unsigned long long seed = 80;
    structure s;
    make_structure(&s, &seed, 0.4, BD_EXACT);
    bd_hbm hbm;
    s.input.n_point = 0;
    CHECK(bd_hbm_create(&hbm, &s.input) == BD_OK);
    double u[UNKNOWN] = {0.0}, r[UNKNOWN];
    CHECK(bd_hbm_evaluate(&hbm, u, 1.0, r, NULL, NULL) == BD_OK);
    for (int i = 0; i < UNKNOWN; ++i) CHECK(r[i] == -s.force[i]);
    bd_hbm_destroy(&hbm);

    enum { MANY = 5000 }; /* the same three points repeated: forces add up */
    const size_t n_G = 2 * 3 * (size_t)MANY * MODES;
    double *G = malloc(sizeof(double) * n_G), *big = malloc(sizeof(double) * 10 * MANY);
    int *law = malloc(sizeof(int) * MANY);
    if (!G || !big || !law) abort();
    double *kt = big, *kn = kt + 2 * MANY, *mu = kn + MANY, *n0 = mu + MANY, *w = n0 + MANY,
           *shift = w + 2 * MANY;
    for (int l = 0, place = 0; l <= HARM; ++l) {
        const int block = 2 * 3 * n_mode[l];
        for (int p = 0; p < MANY; ++p)
            for (int i = 0; i < block; ++i)
                G[(size_t)place * MANY + (size_t)p * (size_t)block + (size_t)i] =
                    s.G[place * POINTS + (p % POINTS) * block + i];
        place += block;
    }
    for (int p = 0; p < MANY; ++p) {
        const int q = p % POINTS;
        memcpy(kt + 2 * p, s.kt + 2 * q, 2 * sizeof(double));
        memcpy(w + 2 * p, s.w + 2 * q, 2 * sizeof(double));
        memcpy(shift + 3 * p, s.shift + 3 * q, 3 * sizeof(double));
        kn[p] = s.kn[q], mu[p] = s.mu[q], n0[p] = s.n0[q], law[p] = s.law[q];
    }
    bd_hbm one, all;
    s.input.n_point = POINTS;
    bd_hbm_input many = s.input;
    many.n_point = MANY;
    many.G = G, many.kt = kt, many.kn = kn, many.mu = mu, many.n0 = n0, many.w = w,
    many.shift = shift, many.law = law;
    CHECK(bd_hbm_create(&one, &s.input) == BD_OK);
    CHECK(bd_hbm_create(&all, &many) == BD_OK);
    CHECK(all.chunk < MANY);
    double *r1 = not_numbers(UNKNOWN), *r2 = not_numbers(UNKNOWN);
    double *J0 = not_numbers(UNKNOWN * UNKNOWN), *J1 = not_numbers(UNKNOWN * UNKNOWN),
           *J2 = not_numbers(UNKNOWN * UNKNOWN);
    for (int i = 0; i < UNKNOWN; ++i) u[i] = uniform(&seed);
    s.input.n_point = 0;
    CHECK(bd_hbm_create(&hbm, &s.input) == BD_OK);
    CHECK(bd_hbm_evaluate(&hbm, u, 1.0, r, J0, NULL) == BD_OK);
    CHECK(bd_hbm_evaluate(&one, u, 1.0, r1, J1, NULL) == BD_OK);
    CHECK(bd_hbm_evaluate(&all, u, 1.0, r2, J2, NULL) == BD_OK);
    /* 5000 = 3 * 1666 + 2: the contribution of point 2 is the difference, since points 0 and 1
     * occur once more */
    bd_hbm_destroy(&one);
    s.input.n_point = POINTS;
    s.mu[2] = 0.0;
    s.n0[2] = -1e9; /* point 2 never touches */
    CHECK(bd_hbm_create(&one, &s.input) == BD_OK);
    double *r3 = not_numbers(UNKNOWN), *J3 = not_numbers(UNKNOWN * UNKNOWN);
    CHECK(bd_hbm_evaluate(&one, u, 1.0, r3, J3, NULL) == BD_OK);
    for (int i = 0; i < UNKNOWN; ++i)
        CHECK_NEAR(r2[i], r[i] + 1666.0 * (r1[i] - r[i]) + (r3[i] - r[i]), 1e-8);
    for (int i = 0; i < UNKNOWN * UNKNOWN; ++i)
        CHECK_NEAR(J2[i], J0[i] + 1666.0 * (J1[i] - J0[i]) + (J3[i] - J0[i]), 1e-8);
    bd_hbm_destroy(&one);
    bd_hbm_destroy(&all);
    bd_hbm_destroy(&hbm);
    free(r1);
    free(r2);
    free(r3);
    free(J0);
    free(J1);
    free(J2);
    free(J3);
    free(G);
    free(big);
    free(law);
}

static void test_refusals(void) {
    unsigned long long seed = 90;
    structure s;
    make_structure(&s, &seed, 0.4, BD_EXACT);
    bd_hbm hbm;
    s.input.n_harm = 0;
    CHECK(bd_hbm_create(&hbm, &s.input) == BD_BAD_ARGUMENT);
    bd_hbm_destroy(&hbm);
    s.input.n_harm = BD_MAX_HARM + 1;
    CHECK(bd_hbm_create(&hbm, &s.input) == BD_BAD_ARGUMENT);
    bd_hbm_destroy(&hbm);
    s.input.n_harm = HARM;
    CHECK(bd_hbm_create(&hbm, &s.input) == BD_OK);
    double u[UNKNOWN] = {0.0}, r[UNKNOWN];
    u[3] = NAN;
    CHECK(bd_hbm_evaluate(&hbm, u, 1.0, r, NULL, NULL) == BD_NOT_FINITE);
    u[3] = INFINITY;
    CHECK(bd_hbm_evaluate(&hbm, u, 1.0, r, NULL, NULL) == BD_NOT_FINITE);
    u[3] = 0.0;
    CHECK(bd_hbm_evaluate(&hbm, u, NAN, r, NULL, NULL) == BD_NOT_FINITE);
    u[3] = 1e308; /* overflows during the evaluation */
    CHECK(bd_hbm_evaluate(&hbm, u, 1e200, r, NULL, NULL) == BD_NOT_FINITE);
    u[3] = 0.0;
    CHECK(bd_hbm_evaluate(&hbm, u, 1.0, r, NULL, NULL) == BD_OK);
    bd_hbm_destroy(&hbm);
    bd_hbm_destroy(&hbm);
    bd_hbm_destroy(NULL);
}

int main(void) {
    test_stuck_by_hand();
    test_derivatives(BD_EXACT);
    test_derivatives(BD_SAMPLED);
    test_sizes();
    test_refusals();
    return check_result();
}
