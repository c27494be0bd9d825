/* Disks in the plane: the point of least violation, and the entry of a line into all disks.
 *
 * Centre. The function phi(s) = max_k |c_k - s| - R_k is convex. Its minimum is shared by one, two
 * or three disks: one disk at its centre, phi = -R; two disks on the line of their centres,
 * phi = (d - R_i - R_j)/2; three disks if their normals enclose the origin. The search starts with
 * one disk. In each round the most violated disk joins the disks that determine the point. The new
 * point is the subset of two or three with the largest value. Values grow from round to round, so
 * no subset occurs twice.
 *
 * Three disks. The point s has the same distance phi outside each of them, |c_k - s| = R_k + phi.
 * With the first centre as origin, let d_a be the other centres, r = R_1 + phi and w_a = R_a - R_1.
 * Then |s| = r and |s - d_a| = r + w_a give d_a.s = (d_a^2 - w_a^2)/2 - r w_a, hence
 * s = alpha - r beta and a quadratic equation for r. */
#include "contact/friction_disks.h"

#include <math.h>

enum { MOST_ROUNDS = 60 };

static double norm(double x, double y) { return sqrt(x * x + y * y); }

/* ---- centre ---- */

/* Point of least violation of one disk: its centre, which lies R inside. */
static bd_disk_point centre_of_one(const bd_disks *disks, int i) {
    const bd_disk_point point = {
        .n = 1,
        .disk = {i},
        .s = {disks->x[i], disks->y[i]},
        .value = -disks->R[i],
    };
    return point;
}

/* Point of least violation of two disks, on the line between their centres at the same distance
 * phi = (d - R_i - R_j)/2 outside both; d is the distance of the centres. The value is -infinity if
 * one disk lies in the other, so that the smaller one determines the point alone. */
static bd_disk_point centre_of_two(const bd_disks *disks, int i, int j) {
    const double dx = disks->x[j] - disks->x[i];
    const double dy = disks->y[j] - disks->y[i];
    const double d = norm(dx, dy);
    bd_disk_point point = {.n = 2, .disk = {i, j}};
    point.value = 0.5 * (d - disks->R[i] - disks->R[j]);

    /* distance from the first centre */
    const double r = disks->R[i] + point.value;
    if (!(r > 0.0 && r < d)) return (bd_disk_point){.value = -INFINITY};
    point.s[0] = disks->x[i] + dx * (r / d);
    point.s[1] = disks->y[i] + dy * (r / d);
    return point;
}

/* Improve a point at equal distance phi outside three disks, |c_a - s| - R_a = phi, by one Newton
 * step. With the unit vectors e_a from s to the centres and the errors f_a = |c_a - s| - R_a - phi,
 * the step (ds, dphi) satisfies
 *
 *     e_a . ds + dphi = f_a,      a = 0, 1, 2.
 *
 * Differences to the equation of disk 0 leave a 2 x 2 system for ds, which Cramer's rule solves. */
static void polish(const bd_disks *disks, bd_disk_point *point) {
    double e[3][2], f[3];
    for (int a = 0; a < 3; ++a) {
        const int k = point->disk[a];
        const double x = disks->x[k] - point->s[0];
        const double y = disks->y[k] - point->s[1];
        const double distance = norm(x, y);
        if (!(distance > 0.0)) return;
        e[a][0] = x / distance;
        e[a][1] = y / distance;
        f[a] = distance - disks->R[k] - point->value;
    }

    /* (e_1 - e_0) . ds = f_1 - f_0,   (e_2 - e_0) . ds = f_2 - f_0 */
    const double row1[2] = {e[1][0] - e[0][0], e[1][1] - e[0][1]};
    const double row2[2] = {e[2][0] - e[0][0], e[2][1] - e[0][1]};
    const double f1 = f[1] - f[0], f2 = f[2] - f[0];
    const double det = row1[0] * row2[1] - row1[1] * row2[0];
    if (!(fabs(det) > 1e-12)) return; /* centres in line with s */
    const double ds[2] = {(row2[1] * f1 - row1[1] * f2) / det, (row1[0] * f2 - row2[0] * f1) / det};
    const double dphi = f[0] - e[0][0] * ds[0] - e[0][1] * ds[1];
    point->s[0] += ds[0];
    point->s[1] += ds[1];
    point->value += dphi;
}

/* Return whether s lies inside the triangle of the centres of its three disks. Every move then
 * increases the distance from one of them, so s has the least violation of the three. */
static int encloses(const bd_disks *disks, const bd_disk_point *point) {
    double d[3][2]; /* vectors from s to the centres */
    for (int a = 0; a < 3; ++a) {
        const int k = point->disk[a];
        d[a][0] = disks->x[k] - point->s[0];
        d[a][1] = disks->y[k] - point->s[1];
    }

    /* seen from s, the centres follow each other in one sense of rotation, all by less than pi */
    double cross[3];
    for (int a = 0; a < 3; ++a) {
        const int b = (a + 1) % 3;
        cross[a] = d[a][0] * d[b][1] - d[a][1] * d[b][0];
    }
    const int left = cross[0] > 0.0 && cross[1] > 0.0 && cross[2] > 0.0;
    const int right = cross[0] < 0.0 && cross[1] < 0.0 && cross[2] < 0.0;
    return left || right;
}

/* Point s of least violation of three disks, value phi: it lies at the same distance phi outside
 * each of them, |c_a - s| = R_a + phi, inside the triangle of their centres. The value is -infinity
 * if fewer than three disks determine it.
 *
 * Let disk i be at the origin, d_a (a = 0, 1) the centres of the other two, w_a = R_a - R_i and
 * r = R_i + phi the distance |s|. The difference of |s - d_a|^2 = (r + w_a)^2 and |s|^2 = r^2 is
 * linear in s and r,
 *
 *     d_a . s = c_a - r w_a,   c_a = (|d_a|^2 - w_a^2)/2,   so  s = alpha - r beta
 *
 * with D alpha = c, D beta = w and the rows d_a of D (2, 2). Then |s|^2 = r^2 is
 *
 *     A r^2 - 2 B r + C = 0,   A = beta . beta - 1,   B = alpha . beta,   C = alpha . alpha.
 *
 * The minimum is unique, so only one root can lie inside the triangle; if rounding admits both, the
 * larger value counts. */
static bd_disk_point centre_of_three(const bd_disks *disks, int i, int j, int k) {
    bd_disk_point best = {.value = -INFINITY};
    const int other[2] = {j, k};
    double d[2][2], c[2], w[2];
    for (int a = 0; a < 2; ++a) {
        d[a][0] = disks->x[other[a]] - disks->x[i];
        d[a][1] = disks->y[other[a]] - disks->y[i];
        w[a] = disks->R[other[a]] - disks->R[i];
        c[a] = 0.5 * (d[a][0] * d[a][0] + d[a][1] * d[a][1] - w[a] * w[a]);
    }

    /* alpha = D^-1 c, beta = D^-1 w; D is singular if the centres lie on a line */
    const double det = d[0][0] * d[1][1] - d[0][1] * d[1][0];
    if (det == 0.0) return best;
    double alpha[2], beta[2];
    alpha[0] = (d[1][1] * c[0] - d[0][1] * c[1]) / det;
    alpha[1] = (d[0][0] * c[1] - d[1][0] * c[0]) / det;
    beta[0] = (d[1][1] * w[0] - d[0][1] * w[1]) / det;
    beta[1] = (d[0][0] * w[1] - d[1][0] * w[0]) / det;

    /* the roots are h/A and C/h; h adds numbers of one sign, so neither loses digits */
    const double A = beta[0] * beta[0] + beta[1] * beta[1] - 1.0;
    const double B = alpha[0] * beta[0] + alpha[1] * beta[1];
    const double C = alpha[0] * alpha[0] + alpha[1] * alpha[1];
    const double root = sqrt(fmax(B * B - A * C, 0.0));
    const double h = B + (B < 0.0 ? -root : root);
    const double candidate[2] = {h / A, C / h};
    for (int side = 0; side < 2; ++side) {
        /* squaring has added solutions with negative distances R_a + phi */
        const double r = candidate[side];
        if (!isfinite(r) || r < 0.0 || r + w[0] < 0.0 || r + w[1] < 0.0) continue;

        bd_disk_point point = {.n = 3, .disk = {i, j, k}, .value = r - disks->R[i]};
        for (int axis = 0; axis < 2; ++axis) point.s[axis] = alpha[axis] - r * beta[axis];
        point.s[0] += disks->x[i];
        point.s[1] += disks->y[i];
        for (int repeat = 0; repeat < 2; ++repeat) polish(disks, &point);
        if (encloses(disks, &point) && point.value > best.value) best = point;
    }
    return best;
}

/* Point of least violation of n <= 4 disks, of which the last one is new: the others determine the
 * previous point, which violates the new disk most. The point is determined by the new disk alone,
 * or with one or two of the others. More disks only increase the least violation, so the subset
 * with the largest value determines the point. */
static bd_disk_point centre_of_few(const bd_disks *disks, int n, const int *disk) {
    const int new = disk[n - 1];
    bd_disk_point best = centre_of_one(disks, new);
    for (int i = 0; i < n - 1; ++i) {
        const bd_disk_point two = centre_of_two(disks, disk[i], new);
        if (two.value > best.value) best = two;
        for (int j = 0; j < i; ++j) {
            const bd_disk_point three = centre_of_three(disks, disk[i], disk[j], new);
            if (three.value > best.value) best = three;
        }
    }
    return best;
}

/* Find the point s that minimises phi(s) = max_k |c_k - s| - R_k. Begin with the smallest disk. In
 * each round, add the disk that is violated most to the at most three that determine the point,
 * until it exceeds their value by no more than `slack`. */
void bd_disks_centre(const bd_disks *disks, double slack, bd_disk_point *point) {
    int smallest = 0;
    for (int k = 1; k < disks->n; ++k)
        if (disks->R[k] < disks->R[smallest]) smallest = k;
    *point = centre_of_one(disks, smallest);
    for (int round = 0; round < MOST_ROUNDS; ++round) {
        int worst = smallest;
        const double violation = bd_disks_violation(disks, point->s, &worst);
        if (violation <= point->value + slack) return;

        int candidate[4];
        for (int i = 0; i < point->n; ++i) candidate[i] = point->disk[i];
        candidate[point->n] = worst;
        const bd_disk_point next = centre_of_few(disks, point->n + 1, candidate);
        if (!(next.value > point->value)) return; /* values grow but for rounding */
        *point = next;
    }
}

/* Return the largest t at which the line from + t (to - from), which ends inside all disks, enters
 * a disk; 0 if it begins inside all of them. For a disk with the centre x relative to `from`,
 * |x - t line|^2 = R^2 is A t^2 - 2 B t + C = 0. Its smaller root is the entry, in the form
 * C/(B + sqrt(B^2 - A C)) without cancellation. */
double bd_disks_entry(const bd_disks *disks, const double *from, const double *to, int *which) {
    const double line[2] = {to[0] - from[0], to[1] - from[1]};
    const double A = line[0] * line[0] + line[1] * line[1];
    double latest = 0.0;
    for (int k = 0; k < disks->n; ++k) {
        const double x = disks->x[k] - from[0];
        const double y = disks->y[k] - from[1];
        const double B = x * line[0] + y * line[1];
        const double C = x * x + y * y - disks->R[k] * disks->R[k];
        const int begins_inside = !(C > 0.0);
        if (begins_inside) continue;
        const double t = C / (B + sqrt(fmax(B * B - A * C, 0.0)));
        if (t > latest) {
            latest = t;
            *which = k;
        }
    }
    return latest;
}
