/* Sampled evaluation against the law in plain C, and its convergence to the
 * event-driven evaluation. */
#include "contact/evaluator.h"
#include "check.h"
#include "sampled_law.h"

static bd_element random_element(unsigned long long *seed) {
    bd_element e = {.kt = {1.5 + uniform(seed), 1.5 + uniform(seed)},
                    .kn = 1.5 + uniform(seed),
                    .mu = 0.5 + 0.4 * uniform(seed),
                    .n0 = 2.0 * uniform(seed),
                    .w = {uniform(seed), uniform(seed)}};
    return e;
}

static void evaluate(bd_evaluator *evaluator, const bd_element *element, const double *x, double *F,
                     bd_status_share *share) {
    bd_response out = {.F = F};
    bd_contact_evaluate(element, x, &out, share, evaluator);
}

static void test_against_sampled_law(bd_evaluation evaluation, int n_harm, int n_time) {
    unsigned long long seed = 30 + (unsigned long long)n_time;
    const int n_coef = bd_n_coef(n_harm);
    double x[33], reference[33];
    bd_evaluator evaluator;
    CHECK(bd_evaluator_create(&evaluator, evaluation, n_harm, n_time) == BD_OK);
    for (int trial = 0; trial < 100; ++trial) {
        const bd_element element = random_element(&seed);
        for (int i = 0; i < 3 * n_coef; ++i) x[i] = uniform(&seed);
        double *F = not_numbers(3 * (size_t)n_coef);
        bd_status_share share;
        evaluate(&evaluator, &element, x, F, &share);
        sampled_law(&element, n_harm, x, n_time, evaluation == BD_SAMPLED, reference);
        for (int i = 0; i < 3 * n_coef; ++i) CHECK_NEAR(F[i], reference[i], 1e-12);
        const bd_segment *segment;
        for (int d = 0; d < 2; ++d) {
            CHECK_NEAR(share.stick[d] + share.slip[d] + share.open, 1.0, 1e-12);
            const int n = bd_contact_segments(&evaluator, d, &segment);
            if (share.open < 1.0) CHECK_NEAR(segment[n - 1].end, BD_TWO_PI, 1e-12);
        }
        free(F);
    }
    bd_evaluator_destroy(&evaluator);
}

static void test_approach(void) {
    unsigned long long seed = 40;
    double x[21], exact[21], sampled[21], error[2] = {0.0, 0.0};
    bd_evaluator e[3];
    CHECK(bd_evaluator_create(&e[0], BD_EXACT, 3, 0) == BD_OK);
    CHECK(bd_evaluator_create(&e[1], BD_SAMPLED, 3, 256) == BD_OK);
    CHECK(bd_evaluator_create(&e[2], BD_SAMPLED, 3, 2048) == BD_OK);
    for (int trial = 0; trial < 50; ++trial) {
        const bd_element element = random_element(&seed);
        for (int i = 0; i < 21; ++i) x[i] = uniform(&seed);
        evaluate(&e[0], &element, x, exact, NULL);
        for (int k = 1; k <= 2; ++k) {
            evaluate(&e[k], &element, x, sampled, NULL);
            for (int i = 0; i < 21; ++i) error[k - 1] += fabs(sampled[i] - exact[i]);
        }
    }
    CHECK(error[0] > 0.0);
    CHECK(error[1] < error[0] / 25.0); /* second order would give 64 */
    for (int k = 0; k < 3; ++k) bd_evaluator_destroy(&e[k]);
}

int main(void) {
    test_against_sampled_law(BD_SAMPLED, 1, 32);
    test_against_sampled_law(BD_SAMPLED, 3, 64);
    test_against_sampled_law(BD_SAMPLED, 5, 128);
    test_against_sampled_law(BD_SAMPLED_PLAIN, 3, 64);
    test_approach();
    bd_sampled_work work;
    CHECK(bd_sampled_create(&work, 3, 7, 1) == BD_BAD_ARGUMENT);
    bd_sampled_destroy(&work);
    CHECK(bd_sampled_create(&work, 0, 64, 1) == BD_BAD_ARGUMENT);
    bd_sampled_destroy(&work);
    return check_result();
}
