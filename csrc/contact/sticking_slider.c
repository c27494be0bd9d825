/* A slider of in-plane coupled friction that sticks or is about to slip; see coupled_friction.c for
 * the law and friction_disks.c for the centre of the disks.
 *
 * Stick. A slider inside all disks |p_k - s| <= R_k of the cycle never moves. If the disks have
 * common points, each of them is admissible: the end of a transient depends on its history, which
 * the law does not determine. The initial slider w is used if it is admissible. Otherwise it is
 * shifted towards the centre c, the point of least violation, until it is admissible: s = w + t
 * (c - w) with the least such t. In one dimension this is the nearer end of the interval. At the
 * onset of slip the common points shrink to c, and s is a Lipschitz continuous function of the
 * motion. The common point nearest to w would instead move like the square root of the distance.
 *
 * Onset of slip. Let phi be the least violation of the disks. At phi = 0 the common points shrink
 * to one, determined by two opposite disks or by three. For phi > 0 the slider moves by a distance
 * of order phi between the edges of these disks. With two disks I - P' is singular in the limit.
 * With e_i = (p_i - s)/|p_i - s| and the derivative D_i of the slider after disk i has set it, the
 * limit is
 *
 *     three   D_i = (I - e_i e_i^T) D_{i-1} + e_i (e_i . dp_i - dR_i), all around,
 *     two     e . D_i = e . dp_i - dR_i (e . e_i),   and across, where the slips by delta = 2 phi
 *             along e_1 and e_2 cancel, the point on the line through the centres halfway through
 *             these slips:
 *             t . D = sum_i (t . dp_i - a_i d delta)/r_i / sum_i 1/r_i,   r_i = |p_i - s|,
 *             a_i = (t . p_i')/(2 (e_i . p_i' - R_i')).
 *
 * This limit replaces the derivative while phi is so small that rounding
 * spoils the general formula.
 *
 * A derivative is (2, n_col): rows of the slider, columns of u1, u2, v and of the slider at the
 * start of the period. The last two columns stay zero here. */
#include "contact/sticking_slider.h"

#include <string.h>

/* Number of columns of a derivative: coefficients of the motions u1, u2, v, and two components of
 * the slider at the start of the period. */
static size_t n_columns(const bd_coulomb_work *work) {
    return 3 * (size_t)bd_n_coef(work->n_harm) + 2;
}

/* Unit vector e (2) from the slider to the centre of disk i of those that determine it; return the
 * distance. At the centre itself, e is the first axis. */
static double direction(const bd_coulomb_work *work, const bd_disk_point *point, int i, double *e) {
    const int k = point->disk[i];
    const double x = work->x[k] - point->s[0];
    const double y = work->y[k] - point->s[1];
    const double distance = bd_norm(x, y);
    e[0] = distance > 0.0 ? x / distance : 1.0;
    e[1] = distance > 0.0 ? y / distance : 0.0;
    return distance;
}

/* Add a . dp + b dR, the change of centre p (2) and radius R of the disk of sample k, to row
 * (n_col), the derivative with respect to the coefficients of u1, u2 and v (n_coef each):
 *
 *     dp_d = kt_d du_d,   dR = mu kn dv,   du_d = sum_j basis_j du_dj.
 *
 * A constant load has a constant radius. */
static void motion_row(const bd_coulomb_work *work, const bd_element *element, int k,
                       const double *a, double b, double *row) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm);
    const double *basis = bd_coulomb_basis(work, k);
    const double kn = bd_law_is_constant(element->law) ? 0.0 : element->kn;
    const double factor[3] = {a[0] * element->kt[0], a[1] * element->kt[1], b * element->mu * kn};
    for (size_t component = 0; component < 3; ++component) {
        double *of_component = row + component * n_coef;
        for (size_t j = 0; j < n_coef; ++j) of_component[j] += factor[component] * basis[j];
    }
}

/* Row e . dp - dR (n_col): motion of the edge of the disk of sample k along e, at a fixed
 * slider. */
static void edge_motion(const bd_coulomb_work *work, const bd_element *element, int k,
                        const double *e, double *row) {
    memset(row, 0, sizeof(double) * n_columns(work));
    motion_row(work, element, k, e, -1.0, row);
}

/* The n disks move the centre c along axis d by dc_d = sum_i f_i (e_i . dp_i - dR_i). The shares
 * f_i follow from e_i . dc + d phi = e_i . dp_i - dR_i for all i:
 *
 *     two     e_2 = -e_1, and across e_1 the disks do not determine c: f_i = e_i,d/2.
 *     three   Differences from the first equation eliminate phi. Cramer's rule gives f_2 and f_3,
 *             and sum_i f_i = 0. */
static void shares_of_disks(int n, double (*e)[2], size_t d, double *f) {
    for (int i = 0; i < 3; ++i) f[i] = 0.0;
    if (n == 2) {
        for (int i = 0; i < 2; ++i) f[i] = 0.5 * e[i][d];
    }
    if (n == 3) {
        const size_t other = 1 - d;
        const double a[2] = {e[1][0] - e[0][0], e[1][1] - e[0][1]};
        const double b[2] = {e[2][0] - e[0][0], e[2][1] - e[0][1]};
        const double det = a[0] * b[1] - a[1] * b[0];
        const double sign = d == 0 ? 1.0 : -1.0;
        f[1] = sign * b[other] / det;
        f[2] = -sign * a[other] / det;
        f[0] = -f[1] - f[2];
    }
}

/* Derivative D (2, n_col) of the common point c of the n = 1, 2 or 3 disks that determine it. Each
 * component d is dc_d = sum_i a_i . dp_i - f_i dR_i with the shares f_i of the disks, and
 *
 *     three   a_i = f_i e_i
 *     two     a_i = f_i e_i, and across the line of both centres c moves with this line: the centre
 *             at a distance r_i moves it by r_j/(r_i + r_j), j the other disk
 *     one     c is the centre of the disk, dc = dp. */
static void derivative_of_centre(const bd_coulomb_work *work, const bd_element *element,
                                 const bd_disk_point *centre, double *D) {
    const size_t n_col = n_columns(work);
    const int n = centre->n;
    double e[3][2] = {{0.0}}, r[3] = {0.0};
    for (int i = 0; i < n; ++i) r[i] = direction(work, centre, i, e[i]);

    /* dc_d = sum_i a_i . dp_i - f_i dR_i */
    memset(D, 0, sizeof(double) * 2 * n_col);
    for (size_t d = 0; d < 2; ++d) {
        double f[3];
        shares_of_disks(n, e, d, f);
        for (int i = 0; i < n; ++i) {
            double a[2];
            for (size_t c = 0; c < 2; ++c) {
                const double same = c == d;
                a[c] = f[i] * e[i][c];
                if (n == 1) a[c] = same;
                if (n == 2) {
                    const double across = same - e[0][d] * e[0][c]; /* entry of I - e e^T */
                    a[c] += r[1 - i] / (r[0] + r[1]) * across;
                }
            }
            motion_row(work, element, centre->disk[i], a, -f[i], D + d * n_col);
        }
    }
}

/* Derivative (2, n_col) of the slider s = w + share (c - w) that was shifted from w towards the
 * centre c, up to the edge of disk k: ds = share dc + (c - w) d share. It stays on this edge,
 * e . ds = e . dp - dR, which determines d share. */
static void derivative_of_shifted(bd_coulomb_work *work, const bd_element *element,
                                  const double *initial, const bd_disk_point *centre, double share,
                                  int k) {
    const size_t n_col = n_columns(work);
    const double line[2] = {centre->s[0] - initial[0], centre->s[1] - initial[1]};
    const bd_disk_point slider = {
        .n = 1, .disk = {k}, .s = {initial[0] + share * line[0], initial[1] + share * line[1]}};
    double e[2];
    direction(work, &slider, 0, e);

    double *D = work->slider_derivative;
    derivative_of_centre(work, element, centre, D);
    double *of_edge = work->next_slider;
    edge_motion(work, element, k, e, of_edge);

    /* change of e . s with the share */
    const double rate = e[0] * line[0] + e[1] * line[1];
    double *D0 = D, *D1 = D + n_col;
    for (size_t j = 0; j + 2 < n_col; ++j) {
        const double by_centre = share * (e[0] * D0[j] + e[1] * D1[j]);
        const double d_share = (of_edge[j] - by_centre) / rate;
        D0[j] = share * D0[j] + line[0] * d_share;
        D1[j] = share * D1[j] + line[1] * d_share;
    }
}

/* Factor a_i of disk i at an onset of slip between two disks (head of the file),
 *
 *     a_i = (t . p')/(2 (e . p' - R')),
 *
 * with the unit vectors e from the slider to the centre of the disk and t across it. At the onset
 * the disk pushes the slider along e at the rate e . p' - R', the slip per time, while its centre
 * moves across at the rate t . p'. Averaged over the short slip, the centre is displaced across by
 * a_i per length of slip. The rates come from the step that ends at sample k of the disk. */
static double across_per_slip(const bd_coulomb_work *work, const bd_disk_point *point, int i,
                              const double *e, const double *t) {
    const int k = point->disk[i];
    const int before = bd_coulomb_before(work, k);
    const double dp[2] = {work->x[k] - work->x[before], work->y[k] - work->y[before]};
    const double dR = work->R[k] - work->R[before];
    const double slip = e[0] * dp[0] + e[1] * dp[1] - dR;
    const double across = t[0] * dp[0] + t[1] * dp[1];
    /* without slip in this step, the edge has reached its last position before, and no ratio exists */
    const int pushes = slip > 1e-6 * bd_norm(dp[0], dp[1]);
    if (!pushes) return 0.0;
    return 0.5 * across / slip;
}

/* Add the row of t . D between two disks, which move the slider across the line of their centres:
 *
 *     t . D = sum_i (r_j t . dp_i - r_j a_i d delta)/(r_1 + r_2),   j the other disk.
 *
 * With delta = 2 phi and e_2 = -e_1, the sum of e_i . dp_i - dR_i over both disks is d delta. */
static void row_across(bd_coulomb_work *work, const bd_element *element, const bd_disk_point *point,
                       double (*e)[2], const double *r, const double *t, double *row) {
    const double a_first = across_per_slip(work, point, 0, e[0], t);
    const double a_second = across_per_slip(work, point, 1, e[1], t);
    const double turn = a_first * r[1] + a_second * r[0]; /* sum_i r_j a_i */
    const double distance = r[0] + r[1];
    for (int i = 0; i < 2; ++i) {
        const double share = r[1 - i];
        const double a[2] = {
            (share * t[0] - turn * e[i][0]) / distance,
            (share * t[1] - turn * e[i][1]) / distance,
        };
        motion_row(work, element, point->disk[i], a, turn / distance, row);
    }
}

/* Set y = (I - e e^T) y: a slip along e sets this component of the slider. */
static void project_across(const double *e, double y[2]) {
    const double along = e[0] * y[0] + e[1] * y[1];
    for (size_t d = 0; d < 2; ++d) y[d] -= e[d] * along;
}

/* Add to the derivatives D_i (3, 2, n_col) after three disks the part of D_0, which recurs after
 * them: D_i += M_i D_0 with M_i = (I - e_i e_i^T) M_{i-1} and D_0 = D_3, so (I - M_3) D_0 is the
 * present D_3. */
static void close_three_disks(double (*e)[2], size_t n_col, double *D) {
    double M[2][2] = {{1.0, 0.0}, {0.0, 1.0}};
    for (size_t i = 0; i < 3; ++i) {
        for (size_t c = 0; c < 2; ++c) {
            double column[2] = {M[0][c], M[1][c]};
            project_across(e[i], column);
            for (size_t d = 0; d < 2; ++d) M[d][c] = column[d];
        }
    }

    for (size_t j = 0; j + 2 < n_col; ++j) {
        const double *D_3 = D + 2 * 2 * n_col + j;
        const double constant_part[2] = {D_3[0], D_3[n_col]};
        double y[2];
        if (!bd_coulomb_solve_period(M, constant_part, y)) continue;
        for (size_t i = 0; i < 3; ++i) {
            project_across(e[i], y);
            for (size_t d = 0; d < 2; ++d) D[(2 * i + d) * n_col + j] += y[d];
        }
    }
}

/* One disk: the load nearly vanishes, and the slider follows the motion, ds = dp. */
static void onset_of_one(const bd_coulomb_work *work, const bd_element *element,
                         const bd_disk_point *point, double *D) {
    const double axes[2][2] = {{1.0, 0.0}, {0.0, 1.0}};
    for (size_t d = 0; d < 2; ++d)
        motion_row(work, element, point->disk[0], axes[d], 0.0, D + d * n_columns(work));
}

/* Two disks: derivatives D (2, 2, n_col) of the slider after either disk,
 *
 *     D_i = e_i (e_i . dp_i - dR_i) + t (t . D),
 *
 * with the unit vectors e (2, 2) and distances r (2) to the centres, and t across e_1. */
static void onset_of_two(bd_coulomb_work *work, const bd_element *element,
                         const bd_disk_point *point, double (*e)[2], const double *r, double *D) {
    const size_t n_col = n_columns(work);
    const double t[2] = {-e[0][1], e[0][0]};
    double *across = work->slider_derivative, *of_edge = work->next_slider;
    memset(across, 0, sizeof(double) * n_col);
    row_across(work, element, point, e, r, t, across);
    for (size_t i = 0; i < 2; ++i) {
        edge_motion(work, element, point->disk[i], e[i], of_edge);
        for (size_t d = 0; d < 2; ++d) {
            double *row = D + (2 * i + d) * n_col;
            for (size_t j = 0; j + 2 < n_col; ++j) row[j] = e[i][d] * of_edge[j] + t[d] * across[j];
        }
    }
}

/* Three disks: derivatives D (3, 2, n_col) of the slider after each disk,
 *
 *     D_i = (I - e_i e_i^T) D_{i-1} + e_i (e_i . dp_i - dR_i), all around.
 *
 * The first pass begins with D_0 = 0 and gives the part that does not depend on D_0;
 * close_three_disks adds the other one. */
static void onset_of_three(bd_coulomb_work *work, const bd_element *element,
                           const bd_disk_point *point, double (*e)[2], double *D) {
    const size_t n_col = n_columns(work);
    double *of_edge = work->next_slider;
    for (size_t i = 0; i < 3; ++i) {
        edge_motion(work, element, point->disk[i], e[i], of_edge);
        double *now = D + 2 * i * n_col;
        const double *before = i > 0 ? now - 2 * n_col : NULL; /* NULL: D_0 = 0 */
        for (size_t d = 0; d < 2; ++d) {
            for (size_t j = 0; j + 2 < n_col; ++j) {
                double along = 0.0; /* e_i . D_{i-1} */
                if (before) along = e[i][0] * before[j] + e[i][1] * before[n_col + j];
                now[d * n_col + j] = e[i][d] * (of_edge[j] - along);
                if (before) now[d * n_col + j] += before[d * n_col + j];
            }
        }
    }
    close_three_disks(e, n_col, D);
}

/* Derivatives (n, 2, n_col) of the slider after each of the disks that determine it at the onset of
 * slip; their equations are at the head of the file. */
static void derivative_of_onset(bd_coulomb_work *work, const bd_element *element,
                                const bd_disk_point *point) {
    double *D = work->slider_sums;
    memset(D, 0, sizeof(double) * (size_t)point->n * 2 * n_columns(work));
    double e[3][2] = {{0.0}}, r[3] = {0.0};
    for (int i = 0; i < point->n; ++i) r[i] = direction(work, point, i, e[i]);
    if (point->n == 1) onset_of_one(work, element, point, D);
    if (point->n == 2) onset_of_two(work, element, point, e, r, D);
    if (point->n == 3) onset_of_three(work, element, point, e, D);
}

/* Sums of the basis over the samples after each of the disks that determine the slider, as factors
 * of the harmonic coefficients of the force: weight 1/n for the mean, 2/n for the others. The
 * samples before the first disk follow the last one of the previous period. */
static void basis_sums_of_onset(const bd_coulomb_work *work, const bd_disk_point *point,
                                double *share) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm);
    memset(share, 0, sizeof(double) * (size_t)point->n * n_coef);
    int latest = point->n - 1; /* disk that has set the slider at sample k */
    for (int k = 0; k < work->n_time; ++k) {
        for (int i = 0; i < point->n; ++i)
            if (point->disk[i] == k) latest = i;
        const double *basis = bd_coulomb_basis(work, k);
        double *sum = share + (size_t)latest * n_coef;
        for (size_t j = 0; j < n_coef; ++j) {
            const double factor = j == 0 ? 1.0 : 2.0;
            sum[j] += basis[j] * factor / work->n_time;
        }
    }
}

/* Tangent of T_d = p_d - s_d for a slider that does not move, but whose derivative D (n_part, 2,
 * n_col) changes from part to part of the cycle. The share (n_part, n_coef) of a part is the sum of
 * the basis over it, as a factor of the harmonic coefficients of the force.
 *
 *     dT_d = kt_d du_d - sum_parts share_part (D_part,d . motion).
 *
 * The displacement gives kt_d on the diagonal of dT_d/du_d; each part of the cycle subtracts its
 * share of the slider. All blocks (n_coef, n_coef) of both directions are written to out. */
static void write_tangent_parts(const bd_coulomb_work *work, const bd_element *element, int n_part,
                                const double *D, const double *share, bd_response *out) {
    const size_t n_coef = (size_t)bd_n_coef(work->n_harm), n_col = n_columns(work);
    for (size_t d = 0; d < 2; ++d) {
        double *of_motion[BD_N_COMPONENT]; /* derivatives of T_d with respect to u1, u2, v */
        of_motion[d] = out->dT[d];
        of_motion[1 - d] = out->dTc[d];
        of_motion[BD_NORMAL] = out->dTv[d];
        for (size_t component = 0; component < BD_N_COMPONENT; ++component) {
            double *block = of_motion[component];
            memset(block, 0, sizeof(double) * n_coef * n_coef);
            if (component == d) {
                for (size_t i = 0; i < n_coef; ++i) block[i * n_coef + i] = element->kt[d];
            }
            for (size_t part = 0; part < (size_t)n_part; ++part) {
                const double *sum = share + part * n_coef;
                const double *ds = D + (2 * part + d) * n_col + component * n_coef;
                for (size_t i = 0; i < n_coef; ++i)
                    for (size_t j = 0; j < n_coef; ++j) block[i * n_coef + j] -= sum[i] * ds[j];
            }
        }
    }
    for (int d = 0; d < 2; ++d) {
        out->tangential[d] = BD_BLOCK_FULL;
        out->with_normal[d] = 1;
    }
    out->coupled = 1;
}

/* Put the disks that determine a point in the order of time. */
static void sort_disks(bd_disk_point *point) {
    for (int i = 0; i < point->n; ++i) {
        for (int j = i + 1; j < point->n; ++j) {
            if (point->disk[j] >= point->disk[i]) continue;
            const int later = point->disk[i];
            point->disk[i] = point->disk[j];
            point->disk[j] = later;
        }
    }
}

/* Tangent of a point at the onset of slip: `found` are the disks that determine the slider, in any
 * order. */
void bd_sticking_write_onset(bd_coulomb_work *work, const bd_element *element,
                             const bd_disk_point *found, bd_response *out) {
    bd_disk_point point = *found;
    sort_disks(&point);
    derivative_of_onset(work, element, &point);
    basis_sums_of_onset(work, &point, work->products);
    write_tangent_parts(work, element, point.n, work->slider_sums, work->products, out);
}

/* Tangent of a sticking point whose slider was shifted from `initial` (2) towards the centre of all
 * disks, by `share` of their distance, up to the edge of disk k. */
void bd_sticking_write_shifted(bd_coulomb_work *work, const bd_element *element,
                               const double *initial, const bd_disk_point *centre, double share,
                               int k, bd_response *out) {
    derivative_of_shifted(work, element, initial, centre, share, k);
    memset(work->stick_basis, 0, sizeof(double) * (size_t)bd_n_coef(work->n_harm));
    work->stick_basis[0] = 1.0; /* affects the mean force only */
    write_tangent_parts(work, element, 1, work->slider_derivative, work->stick_basis, out);
}

/* Force and shares of a point with the motion x (3, n_coef) that sticks at the slider s (2), N,
 * throughout the cycle: springs kt around the position s/kt. */
void bd_sticking_write(bd_coulomb_work *work, const bd_element *element, const double *x,
                       const double *s, bd_response *out, bd_status_share *share) {
    bd_element stuck = *element;
    for (int d = 0; d < 2; ++d) {
        stuck.w[d] = element->kt[d] > 0.0 ? s[d] / element->kt[d] : 0.0;
        bd_element_stuck(&stuck, work->n_harm, d, x + d * bd_n_coef(work->n_harm), out);
        share->stick[d] = 1.0;
    }
    work->segment[0] = (bd_segment){0.0, BD_TWO_PI, BD_STICK};
    work->n_segment = 1;
}
