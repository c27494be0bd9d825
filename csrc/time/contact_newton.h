/* Contact forces of all sectors at the end of a step, by Newton's method. generalised_alpha.c
 * includes this file, once for each instruction set.
 *
 * The forces of all sectors are coupled. The motion is x = x* - V C V' F. The columns of V are
 * patterns of the motion of one sector (integration.c), and C couples the sectors through their
 * nodal diameters. The unknowns are the pattern forces p_k = V' F_k, a few in each sector, with the
 * equation
 *
 *     R(p) = V' F(x* - V C p) - p = 0,     with the Jacobian -(I + T C),     T = V' D V.
 *
 * D holds the 3 x 3 derivatives of the law in the present state of each point. The predictor uses
 * the states of the last step. The corrections use GMRES with the preconditioner M = (I + T)^-1 of
 * each sector, where
 *
 *     M (I + T C) x = y - M (y - x),     y = C x.
 *
 * A point that changes its state changes T by terms of rank one, and M by the Sherman-Morrison
 * formula.
 *
 * At stiff contacts that open and close the norm of the residual does not show the length of a
 * correction. With a constant friction limit p is the minimum of a convex potential. Its slope
 * along a change of p is -(C change)' R. A correction ends as soon as this slope is small. */
#ifndef BD_TIME_CONTACT_NEWTON_H
#define BD_TIME_CONTACT_NEWTON_H

#include "time/contact_law.h"
#include "time/modal_motion.h"

/* ---- M = (I + T)^-1 of each sector ---- */

BD_INLINE void exchange(double *a, double *b) {
    const double x = *a;
    *a = *b;
    *b = x;
}

/* A (r, r) = (I + V' D V)' of a sector. */
static void fill_sector_matrix(const bd_time *t, const bd_time_patterns *patterns, size_t k,
                               double *A) {
    const size_t r = (size_t)patterns->rank, s = t->stride;
    const double *V = patterns->pattern_transposed; /* (3, s, r) */
    memset(A, 0, sizeof(double) * r * r);
    for (size_t i = 0; i < r; ++i) A[i * r + i] = 1.0;
    for (size_t p = 0; p < (size_t)t->n_point; ++p) {
        const double *D = t->tangent + 9 * s * k + p;
        const double *V0 = V + p * r, *V1 = V0 + s * r, *V2 = V1 + s * r;
        for (size_t d = 0; d < 3; ++d) {
            const double a = D[3 * d * s], b = D[(3 * d + 1) * s], c = D[(3 * d + 2) * s];
            if (a == 0.0 && b == 0.0 && c == 0.0) continue;
            const double *row_pattern = V + (d * s + p) * r;
            for (size_t j = 0; j < r; ++j)
                add(r, a * V0[j] + b * V1[j] + c * V2[j], row_pattern, A + j * r);
        }
    }
}

/* Replace A (r, r) by its inverse, by Gauss and Jordan with row exchanges. */
static void invert_matrix(size_t r, double *A) {
    size_t pivot[BD_TIME_MAX_RANK];
    for (size_t c = 0; c < r; ++c) {
        size_t best = c;
        for (size_t i = c + 1; i < r; ++i)
            if (fabs(A[i * r + c]) > fabs(A[best * r + c])) best = i;
        pivot[c] = best;
        if (best != c)
            for (size_t j = 0; j < r; ++j) exchange(A + c * r + j, A + best * r + j);

        const double inverse = 1.0 / A[c * r + c];
        A[c * r + c] = 1.0;
        for (size_t j = 0; j < r; ++j) A[c * r + j] *= inverse;
        for (size_t i = 0; i < r; ++i) {
            const double x = A[i * r + c];
            if (i == c || x == 0.0) continue;
            A[i * r + c] = 0.0;
            add(r, -x, A + c * r, A + i * r);
        }
    }
    /* exchanged rows are exchanged columns of the inverse */
    for (size_t c = r; c-- > 0;) {
        if (pivot[c] == c) continue;
        for (size_t i = 0; i < r; ++i) exchange(A + i * r + c, A + i * r + pivot[c]);
    }
}

/* Compute M = (I + V' D V)^-1 of a sector from the transposed matrix. */
static void invert_sector(bd_time *t, const bd_time_patterns *patterns, size_t k) {
    const size_t r = (size_t)patterns->rank;
    double *A = t->work, *M = t->preconditioner + k * r * r;
    fill_sector_matrix(t, patterns, k, A);
    invert_matrix(r, A);
    for (size_t i = 0; i < r; i += 8)
        for (size_t j = 0; j < r; ++j, M += 8) memcpy(M, A + j * r + i, 8 * sizeof *M);
    t->outdated[k] = 0;
}

/* b = -M' u/below, with M in blocks of 8 rows. */
static void multiply_blocks_transposed(size_t r, const double *M, const double *u, double below,
                                       double *b) {
    for (size_t j = 0; j < r; ++j) {
        const double *m = M + 8 * j;
        bd_vec sum = bd_all(0.0);
        for (size_t i = 0; i < r; i += 8, m += 8 * r)
            for (size_t l = 0; l < 8; l += BD_WIDTH) sum += bd_load(u + i + l) * bd_load(m + l);
        b[j] = -total(sum) / below;
    }
}

/* Update M of a sector after a change (3) of one row of D of a point, by the formula of Sherman and
 * Morrison: T changes by v u', hence M by -(M v) (M' u)'/(1 + u' M v). */
static void update_inverse(bd_time *t, const bd_time_patterns *patterns, size_t k, size_t row,
                           const double *change) {
    const size_t r = (size_t)patterns->rank, p = row % t->stride;
    const double *V = patterns->pattern_transposed, *v = V + row * r;
    double *M = t->preconditioner + k * r * r;
    double a[BD_TIME_MAX_RANK], b[BD_TIME_MAX_RANK], u[BD_TIME_MAX_RANK] = {0.0};
    for (size_t d = 0; d < 3; ++d)
        if (change[d] != 0.0) add(r, change[d], V + (d * t->stride + p) * r, u);
    multiply_blocks(r, M, v, a);
    const double below = 1.0 + dot(r, u, a);
    if (!(fabs(below) > BD_TIME_SINGULAR)) {
        t->outdated[k] = 1;
        return;
    }
    multiply_blocks_transposed(r, M, u, below, b);
    for (size_t i = 0; i < r; i += 8)
        for (size_t j = 0; j < r; ++j, M += 8) add(8, b[j], a + i, M);
}

/* Update the derivatives of one point to its present state; changes below a
 * twentieth are ignored. */
static void update_point(bd_time *t, const bd_time_patterns *patterns, size_t k, size_t p,
                         const double *motion, const double *slider) {
    static const double IGNORED = 0.05;
    const size_t s = t->stride;
    double D[9], *stored = t->tangent + 9 * s * k + p;
    double change = 0.0, largest = 0.0;
    contact_tangent(t, k, p, motion, slider, D);
    for (size_t j = 0; j < 9; ++j) {
        change = larger(fabs(D[j] - stored[j * s]), change);
        largest = larger(fabs(stored[j * s]), largest);
    }
    if (!(change > IGNORED * largest)) return;

    for (size_t d = 0; d < 3; ++d) {
        double row_change[3];
        for (size_t e = 0; e < 3; ++e) {
            double *entry = stored + (3 * d + e) * s;
            row_change[e] = D[3 * d + e] - *entry;
            *entry = D[3 * d + e];
        }
        const int differs = row_change[0] != 0.0 || row_change[1] != 0.0 || row_change[2] != 0.0;
        if (differs && !t->outdated[k]) update_inverse(t, patterns, k, d * s + p, row_change);
    }
}

/* Update the points from p on that differ from their stored state. */
BD_NOT_INLINE void update_points(bd_time *t, const bd_time_patterns *patterns, size_t k, size_t p,
                                 const bd_vec *x, const double *w, bd_mask differs) {
    for (size_t i = 0; i < BD_WIDTH && p + i < (size_t)t->n_point; ++i) {
        if (!bd_entry_int(differs, i)) continue;
        const double motion[3] = {bd_entry(x[0], i), bd_entry(x[1], i), bd_entry(x[2], i)};
        const double slider[2] = {w[i], w[t->stride + i]};
        update_point(t, patterns, k, p + i, motion, slider);
    }
}

/* Update states and derivatives of all points at the motion x. */
static void update_states(bd_time *t, const bd_time_patterns *patterns, const double *x) {
    const size_t s = t->stride;
    for (size_t p = 0; p < (size_t)t->n_point; p += BD_WIDTH) {
        const points at = load_parameters(t, p);
        for (size_t k = 0; k < (size_t)t->n_sector; ++k) {
            const double *w = t->slider + 2 * s * k + p;
            double *known = t->contact_state + s * k + p;
            bd_vec now[3];
            for (size_t d = 0; d < 3; ++d) now[d] = bd_load(x + k * t->rows + d * s + p);

            /* the derivatives of slip in the plane change with its direction */
            const bd_vec state = contact_state_of(t, &at, now, w);
            const bd_mask is_new = bd_differ(state, bd_load(known));
            const bd_mask differs = is_new | bd_at_least(state, bd_all(SLIDES_IN_PLANE));
            bd_store(known, state);
            if (bd_any(differs)) update_points(t, patterns, k, p, now, w, differs);
        }
    }
    for (size_t k = 0; k < (size_t)t->n_sector; ++k)
        if (t->outdated[k]) invert_sector(t, patterns, k);
}

static void mark_outdated(bd_time *t) {
    for (int k = 0; k < t->n_sector; ++k) t->outdated[k] = 1;
}

/* ---- Newton's method for the contact forces of all sectors ---- */

/* out = M in, sector by sector. */
BD_INLINE void precondition(const bd_time *t, size_t r, const double *in, double *out) {
    for (size_t k = 0; k < (size_t)t->n_sector; ++k)
        multiply_blocks(r, t->preconditioner + k * r * r, in + k * r, out + k * r);
}

/* Next Krylov vector M (I + T C) now, before it is made orthogonal; compliant = C now. */
static void next_vector(bd_time *t, const bd_time_patterns *patterns, double *now,
                        double *compliant, double *next) {
    const size_t r = (size_t)patterns->rank, n = r * (size_t)t->n_sector;
    double *difference = t->pattern_correction;
    compliance_times(t, patterns, now, compliant);
    for (size_t i = 0; i < n; ++i) difference[i] = compliant[i] - now[i];
    precondition(t, r, difference, next);
    for (size_t i = 0; i < n; ++i) next[i] = compliant[i] - next[i];
}

/* Solve (I + T C) change = residual by GMRES to a relative tolerance; pattern_motion = C change. */
static void solve_correction(bd_time *t, const bd_time_patterns *patterns, double tolerance) {
    enum { M = BD_TIME_VECTORS };
    const size_t r = (size_t)patterns->rank, n = r * (size_t)t->n_sector;
    double H[M + 1][M]; /* triangular after rotations (c, s) */
    double c[M], s[M];
    double g[M + 1]; /* rotated right side; the last entry is the residual */
    double *v = t->krylov, *compliant = t->krylov_motion;
    precondition(t, r, t->residual, v);
    const double size = sqrt(dot(n, v, v));
    if (size > 0.0)
        for (size_t i = 0; i < n; ++i) v[i] /= size;
    g[0] = size;
    int m = 0;
    while (m < M && fabs(g[m]) > tolerance * size) {
        double *now = v + (size_t)m * n, *next = now + n;
        next_vector(t, patterns, now, compliant + (size_t)m * n, next);
        for (int i = 0; i <= m; ++i) {
            const double *earlier = v + (size_t)i * n;
            H[i][m] = dot(n, earlier, next);
            add(n, -H[i][m], earlier, next);
        }
        const double length = sqrt(dot(n, next, next));

        /* earlier rotations, then a new one that removes `length` below the diagonal */
        for (int i = 0; i < m; ++i) {
            const double x = H[i][m];
            H[i][m] = c[i] * x + s[i] * H[i + 1][m];
            H[i + 1][m] = c[i] * H[i + 1][m] - s[i] * x;
        }
        const double norm = sqrt(H[m][m] * H[m][m] + length * length);
        if (!(norm > 0.0)) break;
        c[m] = H[m][m] / norm;
        s[m] = length / norm;
        H[m][m] = norm;
        g[m + 1] = -s[m] * g[m];
        g[m] *= c[m];
        ++m;
        if (!(length > 1e-14 * norm)) break; /* the solution is exact */
        for (size_t i = 0; i < n; ++i) next[i] /= length;
    }

    memset(t->pattern_correction, 0, sizeof(double) * n);
    memset(t->pattern_motion, 0, sizeof(double) * n);
    for (int i = m - 1; i >= 0; --i) {
        for (int j = i + 1; j < m; ++j) g[i] -= H[i][j] * g[j];
        g[i] /= H[i][i];
        add(n, g[i], v + (size_t)i * n, t->pattern_correction);
        add(n, g[i], compliant + (size_t)i * n, t->pattern_motion);
    }
}

/* Forces at the motion x, and the residual of the patterns; return its norm. */
static double pattern_residual(bd_time *t, const bd_time_patterns *patterns) {
    const size_t r = (size_t)patterns->rank, sectors = (size_t)t->n_sector, n = r * sectors;
    all_contact_forces(t, t->motion, t->point_force);
    multiply(sectors, r, t->rows, t->point_force, patterns->pattern_transposed, t->residual);
    add(n, -1.0, t->pattern_force, t->residual);
    ++t->effort.n_evaluation;
    return sqrt(dot(n, t->residual, t->residual));
}

/* Apply a fraction of the correction (negative: undo) and return the norm of the residual. */
static double apply_correction(bd_time *t, const bd_time_patterns *patterns, double share) {
    const size_t sectors = (size_t)t->n_sector, n = (size_t)patterns->rank * sectors;
    add(t->rows * sectors, -share, t->correction_motion, t->motion);
    add(n, share, t->pattern_correction, t->pattern_force);
    return pattern_residual(t, patterns);
}

/* Decrease of the potential per length of the correction, -slope. */
static double descent(const bd_time *t, const bd_time_patterns *patterns) {
    const size_t n = (size_t)patterns->rank * (size_t)t->n_sector;
    return dot(n, t->pattern_motion, t->residual);
}

/* Apply the correction up to its end or to the minimum of the potential; return the norm of the
 * residual. */
static double search_length(bd_time *t, const bd_time_patterns *patterns, double size) {
    const double at_start = descent(t, patterns);
    const double small = BD_TIME_SLOPE * at_start;
    double norm = apply_correction(t, patterns, 1.0);
    double low = 0.0, at_low = at_start, high = 1.0, at_high = descent(t, patterns);
    const int is_minimum_beyond = at_high >= -small;
    if (!(at_start > 0.0) || is_minimum_beyond || norm < BD_TIME_CONVERGES * size) return norm;

    double applied = 1.0;
    for (int i = 0; i < BD_TIME_LENGTHS; ++i) {
        const double share = low + (high - low) * at_low / (at_low - at_high);
        norm = apply_correction(t, patterns, share - applied);
        applied = share;
        const double here = descent(t, patterns);
        if (fabs(here) <= small) return norm;
        /* half of the value at the other end, so that both ends approach the minimum */
        if (here > 0.0) {
            low = share;
            at_low = here;
            at_high *= 0.5;
        } else {
            high = share;
            at_high = here;
            at_low *= 0.5;
        }
    }
    return norm;
}

/* predicted_force = D (x* - x), with the derivatives of the last step. */
static void predict_forces(bd_time *t) {
    const size_t s = t->stride;
    for (size_t k = 0; k < (size_t)t->n_sector; ++k) {
        for (size_t p = 0; p < s; p += BD_WIDTH) {
            const size_t first = k * t->rows + p;
            bd_vec change[3];
            for (size_t d = 0; d < 3; ++d) {
                const size_t row = first + d * s;
                change[d] = bd_load(t->free_motion + row) - bd_load(t->motion + row);
            }
            for (size_t d = 0; d < 3; ++d) {
                const double *D = t->tangent + (9 * k + 3 * d) * s + p;
                const bd_vec force = bd_load(D) * change[0] + bd_load(D + s) * change[1] +
                                     bd_load(D + 2 * s) * change[2];
                bd_store(t->predicted_force + first + d * s, force);
            }
        }
    }
}

/* Solve for a correction and find its motion at the points. */
static void find_correction(bd_time *t, const bd_time_patterns *patterns, double tolerance) {
    solve_correction(t, patterns, tolerance);
    multiply((size_t)t->n_sector, t->rows, (size_t)patterns->rank, t->pattern_motion,
             patterns->pattern, t->correction_motion);
}

/* Find the contact forces at the end of a step, from the motion x* without them in free_motion.
 * Results are the motion and the forces. Return 0 if they were not found. */
static int solve_contact(bd_time *t, const bd_time_patterns *patterns, double tolerance,
                         int predict) {
    const size_t r = (size_t)patterns->rank, sectors = (size_t)t->n_sector, n = r * sectors;
    const size_t rows = t->rows, n_motion = rows * sectors;

    /* begin with the pattern forces of the last step */
    compliance_times(t, patterns, t->pattern_force, t->pattern_motion);
    multiply(sectors, rows, r, t->pattern_motion, patterns->pattern, t->correction_motion);
    for (size_t i = 0; i < n_motion; ++i) t->free_motion[i] -= t->correction_motion[i];

    /* the first correction follows from the change of the motion */
    if (predict) {
        predict_forces(t);
        multiply(sectors, r, rows, t->predicted_force, patterns->pattern_transposed, t->residual);
        find_correction(t, patterns, BD_TIME_LINEAR_TOLERANCE);
    } else {
        memset(t->correction_motion, 0, sizeof(double) * n_motion);
        memset(t->pattern_correction, 0, sizeof(double) * n);
    }
    memcpy(t->motion, t->free_motion, sizeof(double) * n_motion);

    const double largest_before = t->largest_force;
    double size = apply_correction(t, patterns, 1.0);
    for (int i = 0;; ++i) {
        update_states(t, patterns, t->motion);
        const double force = sqrt(dot(n, t->pattern_force, t->pattern_force));
        t->largest_force = larger(force, t->largest_force);
        const double scale = larger(force, 1e-6 * t->largest_force);
        const int is_solved = size <= tolerance * scale;
        const int is_finite = size < HUGE_VAL;
        if (is_solved || !is_finite || i == BD_TIME_MAX_ITERATIONS) {
            const int found = force < HUGE_VAL && size <= BD_TIME_UNSOLVED * scale;
            if (!found) t->largest_force = largest_before;
            return found;
        }
        /* few corrections suffice in most steps; in others the direction decides */
        const int is_hard = i >= BD_TIME_EASY_ITERATIONS;
        find_correction(t, patterns,
                        is_hard ? BD_TIME_HARD_LINEAR_TOLERANCE : BD_TIME_LINEAR_TOLERANCE);
        size = search_length(t, patterns, size);
    }
}

#endif
