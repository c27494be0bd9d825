/* Trigonometric polynomials against sums of sines and cosines, and against polynomials made from
 * their roots. */
#include "util/trig_polynomial.h"
#include "check.h"

#include <string.h>

enum { MOST = 8 };

static double plain_value(int n_harm, const double *x, double theta) {
    double sum = x[0];
    for (int l = 1; l <= n_harm; ++l)
        sum += x[2 * l - 1] * cos(l * theta) + x[2 * l] * sin(l * theta);
    return sum;
}

static double plain_slope(int n_harm, const double *x, double theta) {
    double sum = 0.0;
    for (int l = 1; l <= n_harm; ++l)
        sum += l * (x[2 * l] * cos(l * theta) - x[2 * l - 1] * sin(l * theta));
    return sum;
}

static void random_polynomial(int n_harm, unsigned long long *seed, double *x) {
    for (int i = 0; i < 2 * n_harm + 1; ++i) x[i] = uniform(seed);
}

static void test_values(void) {
    unsigned long long seed = 1;
    for (int n_harm = 1; n_harm <= MOST; ++n_harm) {
        double x[2 * MOST + 1], dx[2 * MOST + 1], power[2 * MOST + 2], value[40];
        random_polynomial(n_harm, &seed, x);
        bd_trig_derivative(n_harm, x, dx);
        CHECK(dx[0] == 0.0);
        bd_trig_grid grid;
        CHECK(bd_trig_grid_create(&grid, n_harm, 40) == BD_OK);
        bd_trig_grid_values(&grid, x, value);
        double most = 0.0;
        for (int k = 0; k < 40; ++k) {
            const double theta = BD_TWO_PI * k / 40;
            CHECK_NEAR(value[k], plain_value(n_harm, x, theta), 1e-13);
            CHECK_NEAR(bd_trig_value(n_harm, x, theta), plain_value(n_harm, x, theta), 1e-13);
            CHECK_NEAR(bd_trig_value(n_harm, dx, theta), plain_slope(n_harm, x, theta), 1e-12);
            bd_trig_powers(n_harm, theta, power);
            CHECK(power[0] == 1.0 && power[1] == 1.0);
            for (int l = 1; l <= n_harm; ++l) {
                CHECK_NEAR(power[2 * l], cos(l * theta), 1e-14);
                CHECK_NEAR(power[2 * l + 1], sin(l * theta), 1e-14);
            }
            most = fmax(most, fabs(value[k] - x[0]));
        }
        CHECK(bd_trig_amplitude(n_harm, x) >= most);
        bd_trig_grid_destroy(&grid);
    }
    const double x[3] = {7.0, 3.0, -4.0};
    CHECK_NEAR(bd_trig_amplitude(1, x), 5.0, 1e-15);
}

/* Coefficients of prod_k sin((theta - root_k)/2), k < 2 n_harm, by the discrete
 * transform of its samples. */
static void polynomial_of_roots(int n_harm, const double *root, double *x) {
    const int n_time = 4 * n_harm + 4;
    memset(x, 0, sizeof(double) * (size_t)(2 * n_harm + 1));
    for (int k = 0; k < n_time; ++k) {
        const double theta = BD_TWO_PI * k / n_time;
        double value = 1.0;
        for (int i = 0; i < 2 * n_harm; ++i) value *= 2.0 * sin(0.5 * (theta - root[i]));
        x[0] += value / n_time;
        for (int l = 1; l <= n_harm; ++l) {
            x[2 * l - 1] += 2.0 * value * cos(l * theta) / n_time;
            x[2 * l] += 2.0 * value * sin(l * theta) / n_time;
        }
    }
}

static int roots_of(int n_harm, const double *f, double *root) {
    const int n_time = 16 * n_harm + 16;
    bd_trig_grid grid;
    CHECK(bd_trig_grid_create(&grid, n_harm, n_time) == BD_OK);
    double *value = not_numbers((size_t)n_time), *slope = not_numbers((size_t)n_time),
           df[BD_MAX_COEF];
    if (n_harm > 1) {
        bd_trig_grid_values(&grid, f, value);
        bd_trig_derivative(n_harm, f, df);
        bd_trig_grid_values(&grid, df, slope);
    }
    const int n = bd_trig_roots(&grid, f, value, slope, root);
    free(value);
    free(slope);
    bd_trig_grid_destroy(&grid);
    return n;
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void test_separate_roots(void) {
    unsigned long long seed = 2;
    for (int trial = 0; trial < 200; ++trial) {
        const int n_harm = 1 + trial % 7, n = 2 * n_harm;
        double root[14], found[14], x[15];
        /* one root in each of n equal parts of the circle, never at the border of a part */
        for (int i = 0; i < n; ++i) root[i] = BD_TWO_PI * (i + 0.5 + 0.3 * uniform(&seed)) / n;
        polynomial_of_roots(n_harm, root, x);
        CHECK(roots_of(n_harm, x, found) == n);
        for (int i = 0; i < n; ++i) CHECK_NEAR(found[i], root[i], 1e-11);
    }
}

/* Two roots within one cell of the bracketing grid, as close as 1e-4 of a cell. */
static void test_close_pairs(void) {
    unsigned long long seed = 3;
    for (int trial = 0; trial < 300; ++trial) {
        const int n_harm = 2 + trial % 5, n = 2 * n_harm;
        const double cell = BD_TWO_PI / (16 * n_harm + 16),
                     distance = cell * pow(10.0, -4.0 * (trial % 50) / 50.0 - 0.1);
        double root[14], found[14], x[15];
        root[0] = cell * (3 + 0.5 * (1.0 + uniform(&seed)) * (1.0 - distance / cell));
        root[1] = root[0] + distance;
        for (int i = 2; i < n; ++i) root[i] = root[1] + (BD_TWO_PI - distance) * (i - 1) / (n - 1);
        for (int i = 0; i < n; ++i) root[i] = fmod(root[i], BD_TWO_PI);
        polynomial_of_roots(n_harm, root, x);
        qsort(root, (size_t)n, sizeof(double), compare);
        CHECK(roots_of(n_harm, x, found) == n);
        /* at a distance d, a rounding error e of the value moves the roots by about e/d */
        for (int i = 0; i < n; ++i) CHECK_NEAR(found[i], root[i], 1e-12 / distance);
    }
}

/* A touch without a crossing yields no root or a pair of roots, in order and finite. */
static void test_exact_double_root(void) {
    for (int n_harm = 2; n_harm <= 6; ++n_harm)
        for (int k = 0; k < 20; ++k) {
            double x[13] = {0.0}, found[12];
            const double at = 0.1 + 0.31 * k;
            /* 1 - cos(theta - at), with negligible higher harmonics */
            x[0] = 1.0, x[1] = -cos(at), x[2] = -sin(at);
            const int n = roots_of(n_harm, x, found);
            CHECK(n == 0 || n == 2);
            for (int i = 0; i < n; ++i) CHECK_NEAR(found[i], fmod(at, BD_TWO_PI), 1e-6);
        }
}

/* (2 s + 1)(s - 1) touches zero on a sample, cos 2 theta - cos theta at the ends of the period: a
 * pair of equal roots or none. */
static void test_double_root_on_a_sample(void) {
    const double touch_at_90[5] = {0.0, 0.0, -1.0, -1.0, 0.0},
                 touch_at_0[5] = {0.0, -1.0, 0.0, 1.0, 0.0};
    for (int sign = -1; sign <= 1; sign += 2) {
        double x[5], found[4];
        for (int i = 0; i < 5; ++i) x[i] = sign * touch_at_90[i];
        int n = roots_of(2, x, found);
        CHECK(n == 2 || n == 4);
        CHECK_NEAR(found[n - 2], 7.0 * BD_PI / 6.0, 1e-14);
        CHECK_NEAR(found[n - 1], 11.0 * BD_PI / 6.0, 1e-14);
        if (n == 4) CHECK_NEAR(found[0], 0.5 * BD_PI, 1e-7);
        if (n == 4) CHECK_NEAR(found[1], 0.5 * BD_PI, 1e-7);
        for (int i = 0; i < 5; ++i) x[i] = sign * touch_at_0[i];
        n = roots_of(2, x, found);
        CHECK(n == 2 || n == 4);
        CHECK_NEAR(found[n - 2], 2.0 * BD_PI / 3.0, 1e-14);
        CHECK_NEAR(found[n - 1], 4.0 * BD_PI / 3.0, 1e-14);
    }
}

static void test_one_harmonic(void) {
    double found[2];
    const double none[3] = {1.1, 0.6, 0.8}, grazing[3] = {1.0, 0.6, 0.8}, flat[3] = {0.0, 0.0, 0.0};
    CHECK(roots_of(1, none, found) == 0);
    CHECK(roots_of(1, flat, found) == 0);
    CHECK(roots_of(1, grazing, found) == 0);
    const double sine[3] = {0.0, 0.0, 1.0}, cosine[3] = {0.5, 1.0, 0.0};
    CHECK(roots_of(1, sine, found) == 2);
    CHECK_NEAR(found[0], 0.0, 1e-15);
    CHECK_NEAR(found[1], BD_PI, 1e-15);
    CHECK(roots_of(1, cosine, found) == 2);
    CHECK_NEAR(found[0], 2.0 * BD_PI / 3.0, 1e-15);
    CHECK_NEAR(found[1], 4.0 * BD_PI / 3.0, 1e-15);
    unsigned long long seed = 4;
    for (int trial = 0; trial < 300; ++trial) {
        double x[3];
        random_polynomial(1, &seed, x);
        const int n = roots_of(1, x, found);
        CHECK(n == (hypot(x[1], x[2]) > fabs(x[0]) ? 2 : 0));
        for (int i = 0; i < n; ++i) {
            CHECK(found[i] >= 0.0 && found[i] < BD_TWO_PI);
            CHECK_NEAR(plain_value(1, x, found[i]), 0.0, 1e-14);
        }
        if (n == 2) CHECK(found[0] < found[1]);
    }
}

/* Roots exactly on the samples, including the ends of the period, are found once. */
static void test_roots_on_samples(void) {
    const double x[5] = {0.0, 0.0, 0.0, 0.0, 1.0}; /* sin 2 theta */
    double found[4];
    CHECK(roots_of(2, x, found) == 4);
    for (int i = 0; i < 4; ++i)
        CHECK_NEAR(remainder(found[i] - (found[0] < 1.0 ? 0.5 * BD_PI * i : 0.5 * BD_PI * (i + 1)),
                             BD_TWO_PI),
                   0.0, 1e-14);
}

/* A root exactly on a sample and another root in an adjacent cell. */
static void test_root_beside_a_sample(void) {
    for (int n_harm = 2; n_harm <= 6; ++n_harm) {
        const int n = 2 * n_harm, n_time = 16 * n_harm + 16;
        for (int k = 0; k < n_time; k += 3)
            for (int side = -1; side <= 1; side += 2) {
                double root[12], found[12], x[13];
                root[0] = BD_TWO_PI * k / n_time;
                root[1] = root[0] + side * 0.4 * BD_TWO_PI / n_time;
                for (int i = 2; i < n; ++i) root[i] = root[0] + BD_TWO_PI * (i - 0.5) / n;
                polynomial_of_roots(n_harm, root, x);
                const int count = roots_of(n_harm, x, found);
                CHECK(count == n);
                for (int i = 0; i < n; ++i) {
                    double nearest = 10.0;
                    for (int j = 0; j < count; ++j)
                        nearest = fmin(nearest, fabs(remainder(found[j] - root[i], BD_TWO_PI)));
                    CHECK_NEAR(nearest, 0.0, 1e-10);
                }
            }
    }
}

static void test_bracketed_root(void) {
    const double x[3] = {0.0, 1.0, 0.0}; /* cos theta */
    CHECK_NEAR(bd_trig_bracketed_root(1, x, 1.0, 2.0), 0.5 * BD_PI, 4e-16);
    CHECK_NEAR(bd_trig_bracketed_root(1, x, 0.0, BD_PI), 0.5 * BD_PI, 4e-16);
    const double sine[3] = {0.0, 0.0, 1.0}; /* ends that are roots except for rounding */
    CHECK_NEAR(bd_trig_bracketed_root(1, sine, 1e-16, 1.0), 0.0, 1e-15);
    CHECK_NEAR(bd_trig_bracketed_root(1, sine, -1.0, -1e-16), 0.0, 1e-15);
    const double shifted[3] = {-1.0, 1.0, 0.0};
    CHECK(bd_trig_bracketed_root(1, shifted, 0.0, 1.0) == 0.0); /* a root at an end is this end */
    /* a triple root, for which Newton's method alone is slow: (1 - cos) sin */
    const double triple[5] = {0.0, 0.0, 1.0, 0.0, -0.5};
    CHECK_NEAR(bd_trig_bracketed_root(2, triple, -1.0, 1.5), 0.0, 1e-5);
}

int main(void) {
    test_values();
    test_separate_roots();
    test_close_pairs();
    test_exact_double_root();
    test_double_root_on_a_sample();
    test_one_harmonic();
    test_roots_on_samples();
    test_root_beside_a_sample();
    test_bracketed_root();
    bd_trig_grid empty = {0};
    bd_trig_grid_destroy(&empty);
    return check_result();
}
