/* Linear equations of a mistuned bladed disk.
 *
 * The bordered matrix is B = M + R. M contains the border and P: the disk couplings between
 * neighbours and the damping within a sector. With v = P^-1 C and s = N_omega - N_u v,
 *
 *     M^-1 (f, g) = (P^-1 f - v mu, mu),    mu = (g - N_u P^-1 f)/s.
 *
 * The remainder R of disk and damping acts on the blade part y = E x only:
 *
 *     (1 + E M^-1 R E^T) y = E M^-1 b,    x = M^-1 (b - R y).
 *
 * GMRES solves for y. If the tolerance is below the accuracy of P^-1, the solution is repeated for
 * the residual of b.
 *
 * The sign of det B is the product of the signs of the pivots of P, of s and of the GMRES matrix.
 * The Hessenberg matrix of GMRES contains its eigenvalues far from one. */
#include "bladed_disk/wheel_equations.h"

#include <math.h>
#include <string.h>

enum { MOST = BD_WHEEL_KRYLOV }; /* iterations of GMRES */
/* tolerance below which the solution is repeated for the residual */
static const double ACCURATE = 1e-7;
static const double ROUNDING = 1e-12;
/* number of blade coefficients up to which a loose solution saves nothing */
static const size_t SMALL = 500;

static size_t n_blade_number(const bd_wheel *w) {
    return (size_t)(w->input.n_sector * w->n_coef * w->input.n_blade);
}

static double dot(const double *x, const double *y, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += x[i] * y[i];
    return sum;
}

/* Compute column and border_pivot of the matrix or its transpose. */
static int find_column(bd_wheel *w, int transposed) {
    const double *from = transposed ? w->border : w->C, *row = transposed ? w->C : w->border;
    bd_ring_solve(&w->ring, transposed, from, w->column);
    w->border_pivot = w->border[w->vector_size] - dot(row, w->column, (size_t)w->vector_size);
    w->transposed = transposed;
    return isfinite(w->border_pivot) && w->border_pivot != 0.0;
}

bd_status bd_wheel_factor(bd_equations *e, const bd_border *border) {
    bd_wheel *w = (bd_wheel *)e;
    const bd_wheel_input *in = &w->input;
    const size_t n = (size_t)e->n, n_vector = (size_t)w->vector_size;
    const int H = in->n_harm, nb = in->n_blade, nd = in->n_damper, nk = in->n_kept,
              N = in->n_sector;
    double *sector_part = w->matrices, *damping = sector_part + (H + 1) * nb * nb,
           *damper = damping + (H + 1) * nb * nb, *near = damper + 2 * (H + 1) * N * nd;
    for (int l = 0; l <= H; ++l) {
        const double f = l * w->omega;
        for (int i = 0; i < nb * nb; ++i) {
            sector_part[l * nb * nb + i] =
                w->sector_part[0][i] - f * f * (w->sector_part[1][i] + in->mass[i]);
            damping[l * nb * nb + i] = f * w->sector_part[2][i];
        }
        for (int i = 0; i < nk * nk; ++i)
            near[l * nk * nk + i] = w->neighbour_part[0][i] - f * f * w->neighbour_part[1][i];
        for (int k = 0; k < N; ++k)
            for (int i = 0; i < nd; ++i) {
                double *to = damper + 2 * (l * N + k) * nd + i;
                to[0] = in->damper_stiffness[i] - f * f * in->damper_mass[k * nd + i];
                to[nd] = f * in->damper_damping[i];
            }
    }
    ++w->cost.n_factorisation;
    const bd_status status = bd_ring_factor(&w->ring, &(bd_ring_matrix){.tangent = w->tangent,
                                                                        .form = w->form,
                                                                        .blade = in->stiffness,
                                                                        .common = sector_part,
                                                                        .damping = damping,
                                                                        .damper = damper,
                                                                        .springs = w->springs,
                                                                        .neighbour = near});
    if (status != BD_OK) return status;
    double *row = w->base.scratch + 3 * (n + 1);
    for (size_t i = 0; i < n; ++i) row[i] = border->row[i] / border->scale[i];
    bd_wheel_to_vector(w, row, w->border);
    w->border[n_vector] = border->row[n] / border->scale[n];
    bd_wheel_to_vector(w, border->scale, w->scale);
    w->scale[n_vector] = border->scale[n];
    if (!find_column(w, 0)) return BD_SINGULAR;
    e->factored = (bd_factored){.condition = 1.0,
                                .rank = e->n + 1,
                                .orientation = w->ring.sign * (w->border_pivot > 0.0 ? 1 : -1)};
    return BD_OK;
}

/* x = M^-1 b, both a vector and one number. */
static void precondition(bd_wheel *w, const double *b, double *x) {
    const size_t n = (size_t)w->vector_size;
    const double *row = w->transposed ? w->C : w->border;
    bd_ring_solve(&w->ring, w->transposed, b, x);
    const double mu = (b[n] - dot(row, x, n)) / w->border_pivot;
    for (size_t i = 0; i < n; ++i) x[i] -= mu * w->column[i];
    x[n] = mu;
}

/* b (a vector) = -R y for the blade part y. */
static void apply_remainder(bd_wheel *w, const double *y, double *b) {
    memset(b, 0, sizeof(double) * ((size_t)w->vector_size + 1));
    bd_wheel_add_waves(w, &w->remainder, w->omega, w->transposed, y, b, NULL);
    for (int i = 0; i < w->vector_size; ++i) b[i] = -b[i];
}

/* Blade part of x over its scale. */
static void scale_blades(const bd_wheel *w, const double *x, double *y) {
    const size_t nb = (size_t)w->input.n_blade, rows = (size_t)(w->input.n_sector * w->n_coef),
                 ns = (size_t)w->sector_size;
    for (size_t i = 0; i < rows; ++i)
        for (size_t j = 0; j < nb; ++j) {
            const double scale = w->scale[i * ns + j];
            y[i * nb + j] = scale > 0.0 ? x[i * ns + j] / scale : 0.0;
        }
}

/* Orthogonalise v to the preceding vectors V; h (k + 1) are the coefficients.
 * Return the length of v. */
static double orthogonalise(const bd_wheel *w, const double *V, int k, double *v, size_t n,
                            double *h) {
    const size_t rows = (size_t)k + 1;
    double part[MOST + 1];
    memset(h, 0, sizeof(double) * rows);
    for (int pass = 0; pass < 2; ++pass) {
        w->ring.kernel->multiply(rows, n, V, v, part);
        for (size_t i = 0; i < rows; ++i) h[i] += part[i], part[i] = -part[i];
        w->ring.kernel->multiply_transposed(rows, n, V, part, v);
    }
    return sqrt(dot(v, v, n));
}

/* Apply the previous rotations to column k of the Hessenberg matrix, and compute the next one;
 * return the last entry before it. */
static double rotate_column(double *h, double *cosine, double *sine, double *g, int k,
                            double size) {
    for (int i = 0; i < k; ++i) {
        const double a = h[i], c = h[i + 1];
        h[i] = cosine[i] * a + sine[i] * c;
        h[i + 1] = cosine[i] * c - sine[i] * a;
    }
    const double last = h[k], r = fmax(hypot(last, size), 1e-300);
    cosine[k] = last / r, sine[k] = size / r;
    h[k] = r;
    g[k + 1] = -sine[k] * g[k];
    g[k] = cosine[k] * g[k];
    return last;
}

/* x = B^-1 b to a tolerance; b and x are a vector and one number. M^-1 R y is stored for every y,
 * so x needs no further solution. */
static bd_status solve_once(bd_wheel *w, double tolerance, const double *b, double *x) {
    const size_t ny = n_blade_number(w), nb = (size_t)w->input.n_blade, ns = (size_t)w->sector_size;
    double *V = w->krylov, *H = V + (MOST + 1) * ny, *cosine = H + (MOST + 1) * MOST,
           *sine = cosine + MOST, *g = sine + MOST, *Z = g + MOST + 1;
    const size_t n1 = (size_t)w->vector_size + 1;
    double *y = w->blade_motion;
    precondition(w, b, x);
    scale_blades(w, x, V);
    const double norm = sqrt(dot(V, V, ny));
    if (!isfinite(norm)) return BD_SINGULAR;
    if (norm == 0.0 || tolerance >= 1.0) return BD_OK;
    for (size_t i = 0; i < ny; ++i) V[i] /= norm;
    g[0] = norm;
    int k = 0, sign = 1;
    for (int done = 0; k < MOST && !done;) {
        double *v = V + (size_t)(k + 1) * ny;
        const double *u = V + (size_t)k * ny;
        for (size_t i = 0; i < ny; ++i) y[i] = u[i] * w->scale[i / nb * ns + i % nb];
        apply_remainder(w, y, w->product);
        precondition(w, w->product, Z + (size_t)k * n1);
        scale_blades(w, Z + (size_t)k * n1, v);
        for (size_t i = 0; i < ny; ++i) v[i] = u[i] - v[i];
        double *h = H + k * MOST;
        const double size = orthogonalise(w, V, k, v, ny, h),
                     last = rotate_column(h, cosine, sine, g, k, size);
        if (!isfinite(size)) return BD_SINGULAR;
        sign = last < 0.0 ? -1 : 1;
        ++k;
        done = fabs(g[k]) <= tolerance * norm || size <= 1e-14;
        for (size_t i = 0; i < ny && !done; ++i) v[i] /= size;
    }
    if (fabs(g[k]) > 0.5 * norm) return BD_SINGULAR;
    w->base.factored.orientation = w->ring.sign * (w->border_pivot > 0.0 ? sign : -sign);
    for (int i = k - 1; i >= 0; --i) {
        for (int j = i + 1; j < k; ++j) g[i] -= H[j * MOST + i] * g[j];
        g[i] /= H[i * MOST + i];
    }
    w->ring.kernel->multiply_transposed((size_t)k, n1, Z, g, x);
    return BD_OK;
}

/* Norm of x over its scale. */
static double scaled_norm(const bd_wheel *w, const double *x) {
    double sum = 0.0;
    for (int i = 0; i <= w->vector_size; ++i)
        if (w->scale[i] > 0.0) sum += x[i] / w->scale[i] * (x[i] / w->scale[i]);
    return sqrt(sum);
}

/* b = b - B x, with the full matrix. */
static void subtract_product(bd_wheel *w, const double *x, double *b) {
    const size_t n = (size_t)w->vector_size;
    const double *column = w->transposed ? w->border : w->C,
                 *row = w->transposed ? w->C : w->border;
    bd_wheel_multiply(w, w->transposed, x, w->product);
    for (size_t i = 0; i < n; ++i) b[i] -= w->product[i] + x[n] * column[i];
    b[n] -= dot(row, x, n) + w->border[n] * x[n];
}

/* Solve B x = b in place; b is a vector and one number. */
static bd_status solve_bordered(bd_wheel *w, double tolerance, double *b) {
    const size_t n1 = (size_t)w->vector_size + 1;
    enum { PASSES = 6 };
    double *x = w->b + n1, *left = x + n1, last = INFINITY;
    memcpy(left, b, sizeof(double) * n1);
    bd_status status = solve_once(w, fmax(tolerance, ACCURATE), b, x);
    memcpy(b, x, sizeof(double) * n1);
    for (int pass = 0; status == BD_OK && tolerance < ACCURATE && pass < PASSES; ++pass) {
        subtract_product(w, x, left);
        status = solve_once(w, ACCURATE, left, x);
        const double size = scaled_norm(w, x), n_vector = scaled_norm(w, b);
        if (status != BD_OK || !(size < 0.5 * last)) return BD_OK;
        for (size_t i = 0; i < n1; ++i) b[i] += x[i];
        if (size <= fmax(tolerance, ROUNDING) * n_vector) return BD_OK;
        last = size;
    }
    return status;
}

bd_status bd_wheel_solve(bd_equations *e, double tolerance, double *b) {
    bd_wheel *w = (bd_wheel *)e;
    const size_t n = (size_t)e->n;
    if (w->transposed && !find_column(w, 0)) return BD_SINGULAR;
    if (n_blade_number(w) <= SMALL) tolerance = fmin(tolerance, ACCURATE);
    bd_wheel_to_vector(w, b, w->b);
    w->b[w->vector_size] = b[n];
    const bd_status status = solve_bordered(w, tolerance, w->b);
    if (status != BD_OK) return status;
    for (int i = 0; i <= w->vector_size; ++i)
        w->b[i] = w->scale[i] > 0.0 ? w->b[i] / w->scale[i] : 0.0;
    bd_wheel_to_unknowns(w, w->b, b);
    b[n] = w->b[w->vector_size];
    return BD_OK;
}

/* (B diag(scale))^T x = b. */
bd_status bd_wheel_solve_transposed(bd_equations *e, double *b) {
    bd_wheel *w = (bd_wheel *)e;
    const size_t n = (size_t)e->n;
    if (!w->transposed && !find_column(w, 1)) return BD_SINGULAR;
    bd_wheel_to_vector(w, b, w->b);
    w->b[w->vector_size] = b[n];
    for (int i = 0; i <= w->vector_size; ++i)
        w->b[i] = w->scale[i] > 0.0 ? w->b[i] / w->scale[i] : 0.0;
    const bd_status status = solve_bordered(w, 0.0, w->b);
    if (status != BD_OK) return status;
    bd_wheel_to_unknowns(w, w->b, b);
    b[n] = w->b[w->vector_size];
    return BD_OK;
}
