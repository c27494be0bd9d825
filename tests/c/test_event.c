/* Event-driven evaluation: closed forms at one harmonic, the sampled law at three,
 * and finite differences. */
#include "contact/event_driven.h"
#include "check.h"
#include "sampled_law.h"

#include <string.h>

typedef struct {
    double *F, *block;
    bd_response out;
    bd_status_share share;
} result;

static result make_result(int n_coef) {
    const size_t nn = (size_t)n_coef * (size_t)n_coef;
    result r = {.F = not_numbers(3 * (size_t)n_coef), .block = not_numbers(5 * nn)};
    r.out = (bd_response){.F = r.F,
                          .dT = {r.block, r.block + nn},
                          .dTv = {r.block + 2 * nn, r.block + 3 * nn},
                          .dN = r.block + 4 * nn};
    return r;
}

static void free_result(result *r) {
    free(r->F);
    free(r->block);
}

/* Constant normal load, u = A cos(theta): the elliptic integrals of the Jenkins
 * element are elementary. */
static void test_jenkins(void) {
    const double A = 2.3, kt = 1.7, S = 0.9, T = acos(1.0 - 2.0 * S / (kt * A));
    const bd_element element = {.kt = {kt, kt}, .kn = 0.0, .mu = 0.3, .n0 = S / 0.3};
    /* the second direction: offset, along the sine */
    const double x[9] = {0.0, A, 0.0, 5.0, 0.0, A, 0.0, 0.0, 0.0};
    bd_event_work work;
    CHECK(bd_event_create(&work, 1) == BD_OK);
    result r = make_result(3);
    bd_event_evaluate(&element, x, &r.out, &r.share, &work);
    const double c1 = kt * A / BD_PI * (T - 0.5 * sin(2.0 * T)),
                 s1 = -kt * A / BD_PI * sin(T) * sin(T);
    CHECK_NEAR(r.F[0], 0.0, 1e-15);
    CHECK_NEAR(r.F[1], c1, 1e-14);
    CHECK_NEAR(r.F[2], s1, 1e-14);
    CHECK_NEAR(r.F[3], 0.0, 1e-15);
    CHECK_NEAR(r.F[4], -s1, 1e-14);
    CHECK_NEAR(r.F[5], c1, 1e-14);
    CHECK_NEAR(r.F[6], element.n0, 1e-15);
    CHECK_NEAR(r.share.stick[0], T / BD_PI, 1e-14);
    CHECK_NEAR(r.share.slip[0], 1.0 - T / BD_PI, 1e-14);
    CHECK(r.share.open == 0.0);
    free_result(&r);
    bd_event_destroy(&work);
}

/* v = B sin(theta + phi) with |n0| < kn B. */
static void test_partial_separation(void) {
    const double B = 0.8, phi = 0.7, kn = 3.0;
    for (int i = -4; i <= 4; ++i) {
        const double n0 = 0.2 * i * kn * B, b0 = asin(n0 / (kn * B));
        const bd_element element = {.law = BD_LAW_NORMAL, .kn = kn, .n0 = n0};
        double x[9] = {0.0};
        x[7] = B * sin(phi), x[8] = B * cos(phi);
        bd_event_work work;
        CHECK(bd_event_create(&work, 1) == BD_OK);
        result r = make_result(3);
        bd_event_evaluate(&element, x, &r.out, &r.share, &work);
        const double N1 = kn * B / BD_TWO_PI * (BD_PI + 2.0 * b0 + sin(2.0 * b0));
        CHECK_NEAR(r.F[6], (n0 * (BD_PI + 2.0 * b0) + 2.0 * kn * B * cos(b0)) / BD_TWO_PI, 1e-14);
        CHECK_NEAR(r.F[7], N1 * sin(phi), 1e-14);
        CHECK_NEAR(r.F[8], N1 * cos(phi), 1e-14);
        CHECK_NEAR(r.share.open, 0.5 - b0 / BD_PI, 1e-14);
        for (int k = 0; k < 6; ++k) CHECK(r.F[k] == 0.0);
        free_result(&r);
        bd_event_destroy(&work);
    }
}

static void check_segments(const bd_event_work *work, int d) {
    const bd_segment *s = work->segment[d];
    const int n = work->n_segment[d];
    CHECK(n >= 1);
    if (n == 0) return;
    CHECK_NEAR(s[n - 1].end - s[0].start, BD_TWO_PI, 1e-12);
    for (int i = 0; i < n; ++i) {
        CHECK(s[i].end > s[i].start);
        if (i > 0) CHECK(s[i].start == s[i - 1].end);
        if (i > 0) CHECK(s[i].state != s[i - 1].state);
    }
}

static bd_element random_element(unsigned long long *seed) {
    bd_element e = {.kt = {1.5 + uniform(seed), 1.5 + uniform(seed)},
                    .kn = 1.5 + uniform(seed),
                    .mu = 0.5 + 0.4 * uniform(seed),
                    .n0 = 2.0 * uniform(seed),
                    .w = {uniform(seed), uniform(seed)}};
    return e;
}

static void test_against_sampled_law(int n_harm) {
    enum { FINE = 1 << 16 };
    unsigned long long seed = 10 + (unsigned long long)n_harm;
    const int n_coef = bd_n_coef(n_harm);
    double x[21], reference[21], n_slip = 0.0, n_open = 0.0;
    bd_event_work work;
    CHECK(bd_event_create(&work, n_harm) == BD_OK);
    for (int trial = 0; trial < 30; ++trial) {
        const bd_element element = random_element(&seed);
        for (int i = 0; i < 3 * n_coef; ++i) x[i] = uniform(&seed);
        result r = make_result(n_coef);
        bd_event_evaluate(&element, x, &r.out, &r.share, &work);
        sampled_law(&element, n_harm, x, FINE, 1, reference);
        for (int i = 0; i < 3 * n_coef; ++i) CHECK_NEAR(r.F[i], reference[i], 1e-6);
        for (int d = 0; d < 2; ++d) {
            CHECK_NEAR(r.share.stick[d] + r.share.slip[d] + r.share.open, 1.0, 1e-12);
            check_segments(&work, d);
        }
        n_slip += r.share.slip[0] > 0.0;
        n_open += r.share.open > 0.0;
        /* the force without tangent is equal to the last bit */
        double *alone = not_numbers(3 * (size_t)n_coef);
        bd_response force_only = {.F = alone};
        bd_event_evaluate(&element, x, &force_only, NULL, &work);
        CHECK(memcmp(alone, r.F, sizeof(double) * 3 * (size_t)n_coef) == 0);
        free(alone);
        free_result(&r);
    }
    CHECK(n_slip > 5 && n_open > 5); /* the states occur */
    bd_event_destroy(&work);
}

static void test_tangent(int n_harm) {
    unsigned long long seed = 20 + (unsigned long long)n_harm;
    const int n_coef = bd_n_coef(n_harm);
    double x[21];
    int n_compared = 0;
    bd_event_work work;
    CHECK(bd_event_create(&work, n_harm) == BD_OK);
    for (int trial = 0; trial < 30; ++trial) {
        const bd_element element = random_element(&seed);
        for (int i = 0; i < 3 * n_coef; ++i) x[i] = uniform(&seed);
        result r = make_result(n_coef), plus = make_result(n_coef), minus = make_result(n_coef);
        bd_event_evaluate(&element, x, &r.out, NULL, &work);
        bd_element_write_blocks(&element, n_harm, &r.out);
        for (int c = 0; c < 3; ++c)
            for (int j = 0; j < n_coef; ++j) {
                const double h = 1e-6, kept = x[c * n_coef + j];
                x[c * n_coef + j] = kept + h;
                bd_event_evaluate(&element, x, &plus.out, NULL, &work);
                x[c * n_coef + j] = kept - h;
                bd_event_evaluate(&element, x, &minus.out, NULL, &work);
                x[c * n_coef + j] = kept;
                for (int d = 0; d < 3; ++d)
                    for (int i = 0; i < n_coef; ++i) {
                        const double difference =
                            (plus.F[d * n_coef + i] - minus.F[d * n_coef + i]) / (2.0 * h);
                        double exact = 0.0;
                        if (d < 2 && c == d) exact = r.out.dT[d][i * n_coef + j];
                        if (d < 2 && c == 2) exact = r.out.dTv[d][i * n_coef + j];
                        if (d == 2 && c == 2) exact = r.out.dN[i * n_coef + j];
                        CHECK_NEAR(exact, difference, 1e-6);
                        n_compared += exact != 0.0 && exact != difference;
                    }
            }
        free_result(&r);
        free_result(&plus);
        free_result(&minus);
    }
    CHECK(n_compared > 300); /* neither zero nor a difference itself */
    bd_event_destroy(&work);
}

static void test_refusals(void) {
    bd_event_work work;
    CHECK(bd_event_create(&work, 0) == BD_BAD_ARGUMENT);
    bd_event_destroy(&work);
    CHECK(bd_event_create(&work, BD_MAX_HARM + 1) == BD_BAD_ARGUMENT);
    bd_event_destroy(&work);
    CHECK(bd_event_create(&work, BD_MAX_HARM) == BD_OK);
    bd_event_destroy(&work);
    bd_event_destroy(&work); /* a second call is allowed */
}

int main(void) {
    test_jenkins();
    test_partial_separation();
    for (int n_harm = 1; n_harm <= 3; n_harm += 2) {
        test_against_sampled_law(n_harm);
        test_tangent(n_harm);
    }
    test_refusals();
    return check_result();
}
