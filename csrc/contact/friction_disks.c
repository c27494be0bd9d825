/* Disks in the plane: the point of least violation, and the entry of a line into all disks.
 *
 * Centre. The function phi(s) = max_k |c_k - s| - R_k is convex. Its minimum is shared by one, two
 * or three disks: one disk at its centre, phi = -R; two disks on the line of their centres,
 * phi = (d - R_i - R_j)/2; three disks if their normals enclose the origin. The search starts with
 * one disk. In each round the most violated disk joins the disks that determine the point. The new
 * point is the subset of two or three with the largest value. Values grow from round to round, so
 * no subset occurs twice.
 *
 * Three disks. With the first centre as origin, let d_a be the other centres, r = R_1 + phi and
 * w_a = R_a - R_1. Then |s| = r and |s - d_a| = r + w_a give d_a.s = (d_a^2 - w_a^2)/2 - r w_a,
 * hence s = alpha - r beta and a quadratic equation for r. */
#include "contact/friction_disks.h"

#include <math.h>

enum { MOST_ROUNDS = 60 };

static double norm(double x, double y) { return sqrt(x * x + y * y); }

/* ---- centre ---- */

static bd_disk_point centre_of_one(const bd_disks *disks, int i) {
    return (
        bd_disk_point){.n = 1, .disk = {i}, .s = {disks->x[i], disks->y[i]}, .value = -disks->R[i]};
}

/* Two disks; value -infinity if one of them determines the centre alone. */
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

/* Improve a point at equal distance from three disks by one Newton step. */
static void polish(const bd_disks *disks, bd_disk_point *point) {
    double e[3][2]; /* directions to the centres */
    double f[3];    /* violations beyond the value */
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

    /* e.ds + dphi = f, without dphi by the difference to the first disk */
    const double a0 = e[1][0] - e[0][0];
    const double a1 = e[1][1] - e[0][1];
    const double b0 = e[2][0] - e[0][0];
    const double b1 = e[2][1] - e[0][1];
    const double fa = f[1] - f[0];
    const double fb = f[2] - f[0];
    const double det = a0 * b1 - a1 * b0;
    if (!(fabs(det) > 1e-12)) return;
    const double ds0 = (b1 * fa - a1 * fb) / det;
    const double ds1 = (a0 * fb - b0 * fa) / det;
    point->s[0] += ds0;
    point->s[1] += ds1;
    point->value += f[0] - e[0][0] * ds0 - e[0][1] * ds1;
}

/* Return whether the normals of three disks enclose the origin: no move
 * reduces all three distances. */
static int encloses(const bd_disks *disks, const bd_disk_point *point) {
    double d[3][2];
    for (int a = 0; a < 3; ++a) {
        const int k = point->disk[a];
        d[a][0] = disks->x[k] - point->s[0];
        d[a][1] = disks->y[k] - point->s[1];
    }

    /* each normal turns to the next in the same sense */
    double cross[3];
    for (int a = 0; a < 3; ++a) {
        const int b = (a + 1) % 3;
        cross[a] = d[a][0] * d[b][1] - d[a][1] * d[b][0];
    }
    const int left = cross[0] > 0.0 && cross[1] > 0.0 && cross[2] > 0.0;
    const int right = cross[0] < 0.0 && cross[1] < 0.0 && cross[2] < 0.0;
    return left || right;
}

/* Three disks; value -infinity if fewer of them determine the centre. */
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

    /* s = alpha - r beta */
    const double det = d[0][0] * d[1][1] - d[0][1] * d[1][0];
    if (det == 0.0) return best;
    double alpha[2], beta[2];
    alpha[0] = (d[1][1] * c[0] - d[0][1] * c[1]) / det;
    alpha[1] = (d[0][0] * c[1] - d[1][0] * c[0]) / det;
    beta[0] = (d[1][1] * w[0] - d[0][1] * w[1]) / det;
    beta[1] = (d[0][0] * w[1] - d[1][0] * w[0]) / det;

    /* A r^2 - 2 B r + C = 0 has the roots h/A and C/h; h adds numbers of one sign */
    const double A = beta[0] * beta[0] + beta[1] * beta[1] - 1.0;
    const double B = alpha[0] * beta[0] + alpha[1] * beta[1];
    const double C = alpha[0] * alpha[0] + alpha[1] * alpha[1];
    const double root = sqrt(fmax(B * B - A * C, 0.0));
    const double h = B + (B < 0.0 ? -root : root);
    for (int side = 0; side < 2; ++side) {
        const double r = side ? C / h : h / A;
        if (!isfinite(r) || r < 0.0 || r + w[0] < 0.0 || r + w[1] < 0.0) continue;
        bd_disk_point point = {.n = 3, .disk = {i, j, k}, .value = r - disks->R[i]};
        for (int a = 0; a < 2; ++a) point.s[a] = alpha[a] - r * beta[a];
        point.s[0] += disks->x[i];
        point.s[1] += disks->y[i];
        for (int repeat = 0; repeat < 2; ++repeat) polish(disks, &point);
        if (encloses(disks, &point) && point.value > best.value) best = point;
    }
    return best;
}

/* Point of least violation of at most four disks; the last one is new. */
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

void bd_disks_centre(const bd_disks *disks, double slack, bd_disk_point *point) {
    int least = 0;
    for (int k = 1; k < disks->n; ++k)
        if (disks->R[k] < disks->R[least]) least = k;
    *point = centre_of_one(disks, least);
    for (int round = 0; round < MOST_ROUNDS; ++round) {
        int worst = least;
        const double most = bd_disks_violation(disks, point->s, &worst);
        if (most <= point->value + slack) return;
        int few[4];
        for (int i = 0; i < point->n; ++i) few[i] = point->disk[i];
        few[point->n] = worst;
        const bd_disk_point next = centre_of_few(disks, point->n + 1, few);
        if (!(next.value > point->value)) return; /* rounding */
        *point = next;
    }
}

double bd_disks_entry(const bd_disks *disks, const double *from, const double *to, int *which) {
    const double line[2] = {to[0] - from[0], to[1] - from[1]};
    const double A = line[0] * line[0] + line[1] * line[1];
    double latest = 0.0;
    for (int k = 0; k < disks->n; ++k) {
        /* |x - t line|^2 = R^2: A t^2 - 2 B t + C = 0 */
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
