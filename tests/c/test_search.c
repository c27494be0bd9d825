/* Search for the steady slider if Newton's method has no step: the ellipse alone
 * converges, from anywhere. */
#include "../../csrc/contact/coupled_friction.c"
#include "check.h"

/* A period map that turns by an angle about the end and contracts, P(s) - end = q turn(s - end).
 * Newton's method receives the identity as its derivative. */
static void test_ellipse_alone(double q, double angle, const double *end) {
    bd_sampled_work sampled;
    bd_coulomb_work work;
    CHECK(bd_sampled_create(&sampled, 1, 8, 1) == BD_OK &&
          bd_coulomb_create(&work, &sampled) == BD_OK);
    memset(work.point_samples, 0, sizeof(double) * 4 * (size_t)work.n_padded * BD_LANES);
    select_lane(&work, 0);
    for (int k = 0; k < work.n_time; ++k) work.R[k] = 3.0;
    const bd_disk_point centre = {.n = 1, .s = {-1.0, 0.5}, .value = 1.0};
    bd_slider_search search;
    start_search(&work, &centre, 1.0, &search);
    memset(work.lanes.period_derivative, 0, sizeof work.lanes.period_derivative);
    work.lanes.period_derivative[0] = work.lanes.period_derivative[3 * BD_LANES] = 1.0;
    double error = INFINITY;
    for (int period = 0; period < 400 && search.state == BD_SEARCHING; ++period) {
        const double d[2] = {search.s[0] - end[0], search.s[1] - end[1]};
        error = bd_norm(d[0], d[1]);
        work.lanes.end[0] = end[0] + q * (cos(angle) * d[0] - sin(angle) * d[1]);
        work.lanes.end[BD_LANES] = end[1] + q * (sin(angle) * d[0] + cos(angle) * d[1]);
        next_guess(&work, &search, 0);
    }
    CHECK(search.state != BD_LOST);
    CHECK_NEAR(error, 0.0, 1e-10);
    bd_coulomb_destroy(&work);
    bd_sampled_destroy(&sampled);
}

int main(void) {
    const double end[3][2] = {{0.3, -0.2}, {-2.0, 1.5}, {0.0, 2.9}};
    for (int i = 0; i < 3; ++i) {
        test_ellipse_alone(0.0, 0.0, end[i]);
        test_ellipse_alone(0.9, 0.3, end[i]);
        test_ellipse_alone(1.0, 1.0, end[i]);
        test_ellipse_alone(1.0, 3.0, end[i]);
    }
    return check_result();
}
