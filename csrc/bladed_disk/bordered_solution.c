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

#include "util/storage.h"

#include <math.h>
#include <string.h>

/* Iterations of GMRES. */
enum { MOST = BD_WHEEL_KRYLOV };

/* Tolerance below which the solution is repeated for the residual, and the least tolerance. */
static const double ACCURATE = 1e-7;
static const double ROUNDING = 1e-12;

/* Number of blade coefficients up to which a loose solution saves nothing. */
static const size_t SMALL = 500;

/* Numbers of the blade part of a vector. */
static size_t n_blade_number(const bd_wheel *w) {
    return (size_t)(w->input.n_sector * w->n_coef * w->input.n_blade);
}

static double dot(const double *x, const double *y, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += x[i] * y[i];
    return sum;
}

/* Prepare solutions with M, the matrix P of the elimination with the border (C: derivative with
 * respect to omega, N: row of the border), or with its transpose, in which C and N exchange roles:
 *
 *     column v = P^-1 C,    border_pivot s = N_omega - N_u . v.
 *
 * Return 0 if s vanishes or is not finite. */
static int find_column(bd_wheel *w, int transposed) {
    const size_t n = (size_t)w->vector_size;
    const double *column = transposed ? w->border : w->C;
    const double *row = transposed ? w->C : w->border;
    bd_ring_solve(&w->ring, transposed, column, w->column);
    w->border_pivot = w->border[n] - dot(row, w->column, n);
    w->transposed = transposed;
    return isfinite(w->border_pivot) && w->border_pivot != 0.0;
}

/* Matrices of the elimination at the present frequency. For each harmonic l, with f = l omega,
 *
 *     common (n_blade, n_blade)       K - f^2 (M + M_blade)     disk and inertia of all blades
 *     damping (n_blade, n_blade)      f C
 *     neighbour (n_kept, n_kept)      K - f^2 M                 coupling of neighbours by the disk
 *     damper (n_sector, 2, n_damper)  k - f^2 m,  f c. */
static bd_ring_matrix fill_matrices(bd_wheel *w) {
    const bd_wheel_input *in = &w->input;
    const int n_group = in->n_harm + 1, N = in->n_sector, nd = in->n_damper;
    const int blade_size = in->n_blade * in->n_blade, kept_size = in->n_kept * in->n_kept;
    double *common = w->matrices;
    double *damping = common + n_group * blade_size;
    double *damper = damping + n_group * blade_size;
    double *neighbour = damper + 2 * n_group * N * nd;
    const double *K = w->sector_part[0], *M = w->sector_part[1], *C = w->sector_part[2];
    const double *near_K = w->neighbour_part[0], *near_M = w->neighbour_part[1];
    const bd_ring_matrix matrix = {
        .tangent = w->tangent,
        .form = w->form,
        .blade = in->stiffness,
        .common = common,
        .damping = damping,
        .damper = damper,
        .springs = w->springs,
        .neighbour = neighbour,
    };
    for (int l = 0; l < n_group; ++l) {
        const double f = l * w->omega;
        for (int i = 0; i < blade_size; ++i) {
            common[i] = K[i] - f * f * (M[i] + in->mass[i]);
            damping[i] = f * C[i];
        }
        common += blade_size;
        damping += blade_size;
        for (int i = 0; i < kept_size; ++i) neighbour[i] = near_K[i] - f * f * near_M[i];
        neighbour += kept_size;
        for (int k = 0; k < N; ++k, damper += 2 * nd) {
            for (int i = 0; i < nd; ++i) {
                const double mass = in->damper_mass[k * nd + i];
                damper[i] = in->damper_stiffness[i] - f * f * mass;
                damper[nd + i] = f * in->damper_damping[i];
            }
        }
    }
    return matrix;
}

/* Factorise the elimination P at the latest point, and prepare the border. The unknowns of the
 * border row are scaled: row/scale belongs to unscaled unknowns. The sign of the determinant is a
 * first value; GMRES completes it in a solution. */
bd_status bd_wheel_factor(bd_equations *e, const bd_border *border) {
    bd_wheel *w = (bd_wheel *)e;
    const size_t n = (size_t)e->n, n_vector = (size_t)w->vector_size;
    const bd_ring_matrix matrix = fill_matrices(w);
    ++w->cost.n_factorisation;
    const bd_status status = bd_ring_factor(&w->ring, &matrix);
    if (status != BD_OK) return status;

    double *row = w->base.scratch + 3 * (n + 1);
    for (size_t i = 0; i < n; ++i) row[i] = border->row[i] / border->scale[i];
    bd_wheel_to_vector(w, row, w->border);
    w->border[n_vector] = border->row[n] / border->scale[n];
    bd_wheel_to_vector(w, border->scale, w->scale);
    w->scale[n_vector] = border->scale[n];
    if (!find_column(w, 0)) return BD_SINGULAR;

    const int sign = w->border_pivot > 0.0 ? 1 : -1;
    e->factored = (bd_factored){
        .condition = 1.0,
        .rank = e->n + 1,
        .orientation = w->ring.sign * sign,
    };
    return BD_OK;
}

/* x = M^-1 b for the bordered elimination, both a vector (n) and one number mu for the border:
 *
 *     mu = (b_n - N_u . P^-1 b)/s,   x = P^-1 b - mu v,   v = P^-1 C,   s = N_omega - N_u . v,
 *
 * where C and N_u exchange roles in the transposed equations. */
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

/* Blade part y (n_sector, n_coef, n_blade) of a vector x (n_sector, n_coef, sector_size), divided
 * by the scale of the unknowns; entries without an unknown have no scale and become zero. */
static void scale_blades(const bd_wheel *w, const double *x, double *y) {
    const size_t nb = (size_t)w->input.n_blade, ns = (size_t)w->sector_size;
    const size_t rows = (size_t)(w->input.n_sector * w->n_coef);
    for (size_t i = 0; i < rows; ++i) {
        for (size_t j = 0; j < nb; ++j) {
            const double scale = w->scale[i * ns + j];
            y[i * nb + j] = scale > 0.0 ? x[i * ns + j] / scale : 0.0;
        }
    }
}

/* Orthogonalise v (n) to the k + 1 orthonormal vectors V (k + 1, n) by classical Gram-Schmidt in
 * two passes: h (k + 1) = V v, v -= V^T h. Return the length of v. */
static double orthogonalise(const bd_wheel *w, const double *V, int k, double *v, size_t n,
                            double *h) {
    enum { PASSES = 2 }; /* the second removes the rounding of the first */
    const size_t rows = (size_t)k + 1;
    double part[MOST + 1];
    memset(h, 0, sizeof(double) * rows);
    for (int pass = 0; pass < PASSES; ++pass) {
        w->ring.kernel->multiply(rows, n, V, v, part);
        for (size_t i = 0; i < rows; ++i) {
            h[i] += part[i];
            part[i] = -part[i];
        }
        w->ring.kernel->multiply_transposed(rows, n, V, part, v);
    }
    return sqrt(dot(v, v, n));
}

/* Make column h (k + 2) of the Hessenberg matrix of GMRES triangular: apply the k previous Givens
 * rotations, and compute the next rotation, which removes its last entry, `size`, and also turns
 * the right-hand side g. Return entry k before this rotation. */
static double rotate_column(double *h, double *cosine, double *sine, double *g, int k,
                            double size) {
    for (int i = 0; i < k; ++i) {
        const double a = h[i], c = h[i + 1];
        h[i] = cosine[i] * a + sine[i] * c;
        h[i + 1] = cosine[i] * c - sine[i] * a;
    }
    const double last = h[k];
    const double r = fmax(hypot(last, size), 1e-300);
    cosine[k] = last / r;
    sine[k] = size / r;
    h[k] = r;
    g[k + 1] = -sine[k] * g[k];
    g[k] = cosine[k] * g[k];
    return last;
}

/* v = u + E M^-1 R E^T u for a blade part u in scaled unknowns; z = -M^-1 R E^T u is a vector and
 * one number. */
static void apply_blade_matrix(bd_wheel *w, const double *u, double *v, double *z) {
    const size_t ny = n_blade_number(w), nb = (size_t)w->input.n_blade, ns = (size_t)w->sector_size;
    double *y = w->blade_motion;
    for (size_t i = 0; i < ny; ++i) y[i] = u[i] * w->scale[i / nb * ns + i % nb];
    apply_remainder(w, y, w->product);
    precondition(w, w->product, z);
    scale_blades(w, z, v);
    for (size_t i = 0; i < ny; ++i) v[i] = u[i] - v[i];
}

/* x = B^-1 b with B = M + R by GMRES to a relative tolerance of the blade part; b and x are a
 * vector and one number. In scaled blade coordinates, with the projection E on the blades,
 *
 *     (1 + E M^-1 R E^T) y = E M^-1 b,    x = M^-1 b - M^-1 R y.
 *
 * V (k + 1, ny) are the orthonormal vectors, H their triangular Hessenberg matrix, g the rotated
 * right-hand side, |g_k| the residual. Z_k = -M^-1 R V_k of every vector is stored, so x = M^-1 b +
 * sum of c_k Z_k with H c = g needs no further solution with M. BD_SINGULAR if the residual has not
 * even halved. */
static bd_status solve_once(bd_wheel *w, double tolerance, const double *b, double *x) {
    const size_t ny = n_blade_number(w), n1 = (size_t)w->vector_size + 1;
    double *rest = w->krylov;
    double *V = bd_take(&rest, (MOST + 1) * ny);
    double *H = bd_take(&rest, (MOST + 1) * MOST); /* by columns of MOST numbers */
    double *cosine = bd_take(&rest, MOST), *sine = bd_take(&rest, MOST);
    double *g = bd_take(&rest, MOST + 1);
    double *Z = rest; /* (MOST, n1) */
    precondition(w, b, x);
    scale_blades(w, x, V);
    const double norm = sqrt(dot(V, V, ny));
    if (!isfinite(norm)) return BD_SINGULAR;
    if (norm == 0.0 || tolerance >= 1.0) return BD_OK;

    for (size_t i = 0; i < ny; ++i) V[i] /= norm;
    g[0] = norm;
    int k = 0, sign = 1; /* sign of the determinant of the unrotated Hessenberg matrix */
    for (int done = 0; k < MOST && !done;) {
        const double *u = V + (size_t)k * ny;
        double *v = V + (size_t)(k + 1) * ny, *h = H + k * MOST;
        apply_blade_matrix(w, u, v, Z + (size_t)k * n1);
        const double size = orthogonalise(w, V, k, v, ny, h);
        const double last = rotate_column(h, cosine, sine, g, k, size);
        if (!isfinite(size)) return BD_SINGULAR;
        sign = last < 0.0 ? -1 : 1;
        ++k;
        done = fabs(g[k]) <= tolerance * norm || size <= 1e-14;
        if (done) break;
        for (size_t i = 0; i < ny; ++i) v[i] /= size;
    }
    if (fabs(g[k]) > 0.5 * norm) return BD_SINGULAR;
    w->base.factored.orientation = w->ring.sign * (w->border_pivot > 0.0 ? sign : -sign);

    /* coefficients of the vectors: solve H g = g, H upper triangular by columns */
    for (int i = k - 1; i >= 0; --i) {
        for (int j = i + 1; j < k; ++j) g[i] -= H[j * MOST + i] * g[j];
        g[i] /= H[i * MOST + i];
    }
    w->ring.kernel->multiply_transposed((size_t)k, n1, Z, g, x);
    return BD_OK;
}

/* Norm of a vector and one number x divided by the scale of the unknowns. */
static double scaled_norm(const bd_wheel *w, const double *x) {
    double sum = 0.0;
    for (int i = 0; i <= w->vector_size; ++i) {
        if (!(w->scale[i] > 0.0)) continue; /* not an unknown */
        const double scaled = x[i] / w->scale[i];
        sum += scaled * scaled;
    }
    return sqrt(sum);
}

/* b -= B x with the full bordered matrix B = [J C; N_u N_omega], or its transpose; b and x are a
 * vector and one number. */
static void subtract_product(bd_wheel *w, const double *x, double *b) {
    const size_t n = (size_t)w->vector_size;
    const double *column = w->transposed ? w->border : w->C;
    const double *row = w->transposed ? w->C : w->border;
    bd_wheel_multiply(w, w->transposed, x, w->product);
    for (size_t i = 0; i < n; ++i) b[i] -= w->product[i] + x[n] * column[i];
    b[n] -= dot(row, x, n) + w->border[n] * x[n];
}

/* Solve B x = b in place; b is a vector and one number. */
static bd_status solve_bordered(bd_wheel *w, double tolerance, double *b) {
    enum { PASSES = 6 };
    const size_t n1 = (size_t)w->vector_size + 1;
    double *x = w->b + n1, *left = x + n1;
    memcpy(left, b, sizeof(double) * n1);
    const bd_status status = solve_once(w, fmax(tolerance, ACCURATE), b, x);
    memcpy(b, x, sizeof(double) * n1);
    if (status != BD_OK || tolerance >= ACCURATE) return status;

    /* add solutions for the residual as long as they shrink */
    double last = INFINITY;
    for (int pass = 0; pass < PASSES; ++pass) {
        subtract_product(w, x, left);
        if (solve_once(w, ACCURATE, left, x) != BD_OK) return BD_OK;
        const double size = scaled_norm(w, x), size_of_all = scaled_norm(w, b);
        if (!(size < 0.5 * last)) return BD_OK;
        for (size_t i = 0; i < n1; ++i) b[i] += x[i];
        if (size <= fmax(tolerance, ROUNDING) * size_of_all) return BD_OK;
        last = size;
    }
    return BD_OK;
}

/* Divide x by its scale; entries without an unknown become zero. */
static void divide_by_scale(const bd_wheel *w, double *x) {
    for (int i = 0; i <= w->vector_size; ++i) x[i] = w->scale[i] > 0.0 ? x[i] / w->scale[i] : 0.0;
}

/* Solve B diag(scale) x = b in place for scaled unknowns, to a tolerance: x = B^-1 b/scale. */
bd_status bd_wheel_solve(bd_equations *e, double tolerance, double *b) {
    bd_wheel *w = (bd_wheel *)e;
    const size_t n = (size_t)e->n;
    if (w->transposed && !find_column(w, 0)) return BD_SINGULAR;
    if (n_blade_number(w) <= SMALL) tolerance = fmin(tolerance, ACCURATE);
    bd_wheel_to_vector(w, b, w->b);
    w->b[w->vector_size] = b[n];
    const bd_status status = solve_bordered(w, tolerance, w->b);
    if (status != BD_OK) return status;
    divide_by_scale(w, w->b);
    bd_wheel_to_unknowns(w, w->b, b);
    b[n] = w->b[w->vector_size];
    return BD_OK;
}

/* Solve (B diag(scale))^T x = b in place: x = B^-T (b/scale). */
bd_status bd_wheel_solve_transposed(bd_equations *e, double *b) {
    bd_wheel *w = (bd_wheel *)e;
    const size_t n = (size_t)e->n;
    if (!w->transposed && !find_column(w, 1)) return BD_SINGULAR;
    bd_wheel_to_vector(w, b, w->b);
    w->b[w->vector_size] = b[n];
    divide_by_scale(w, w->b);
    const bd_status status = solve_bordered(w, 0.0, w->b);
    if (status != BD_OK) return status;
    bd_wheel_to_unknowns(w, w->b, b);
    b[n] = w->b[w->vector_size];
    return BD_OK;
}
