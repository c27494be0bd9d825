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
 * D holds the 3 x 3 derivatives of the law in the present state of each point. The first correction
 * expects the states of the last step, or the states at the same phase of the last period if these
 * were better in the last step: the motion is nearly periodic. In a known state the law is affine,
 * so this correction is Newton's step with these states. The corrections use GMRES with the
 * preconditioner M = (I + T)^-1 of each sector, where
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

/* Exchange two numbers. */
BD_INLINE void exchange(double *a, double *b) {
    const double x = *a;
    *a = *b;
    *b = x;
}

/* Derivative D (3, 3) of the forces of a point, row-major; its entries are `stride` numbers
 * apart. */
BD_INLINE double *tangent_of(const bd_time *t, size_t sector, size_t point) {
    return t->tangent + BD_N_COMPONENT * BD_N_COMPONENT * t->stride * sector + point;
}

/* A (rank, rank) = (I + V' D V)' of a sector: row j is the unit vector plus V' times the force D
 * V_j of pattern j, V (3, stride, rank) and D (3, 3) for each point. The sum is over points and
 * components of the force. */
static void fill_sector_matrix(const bd_time *t, const bd_time_patterns *patterns, size_t sector,
                               double *A) {
    const size_t rank = (size_t)patterns->rank;
    const size_t stride = t->stride;
    const double *V = patterns->pattern_transposed; /* (3, stride, rank) */
    memset(A, 0, sizeof(double) * rank * rank);
    for (size_t j = 0; j < rank; ++j) A[j * rank + j] = 1.0;

    for (size_t point = 0; point < (size_t)t->n_point; ++point) {
        const double *D = tangent_of(t, sector, point);
        /* patterns of the three components of the motion of this point */
        const double *V0 = V + point * rank;
        const double *V1 = V0 + stride * rank;
        const double *V2 = V1 + stride * rank;
        for (size_t d = 0; d < 3; ++d) {
            /* force component d due to a unit motion along each axis */
            const double D0 = D[3 * d * stride];
            const double D1 = D[(3 * d + 1) * stride];
            const double D2 = D[(3 * d + 2) * stride];
            const int is_free = D0 == 0.0 && D1 == 0.0 && D2 == 0.0;
            if (is_free) continue;

            const double *force_pattern = V + (d * stride + point) * rank;
            for (size_t j = 0; j < rank; ++j) {
                const double force = D0 * V0[j] + D1 * V1[j] + D2 * V2[j];
                add(rank, force, force_pattern, A + j * rank);
            }
        }
    }
}

/* Row at or below the diagonal with the largest entry in a column. */
static size_t find_pivot(size_t n, const double *A, size_t column) {
    size_t best = column;
    for (size_t i = column + 1; i < n; ++i)
        if (fabs(A[i * n + column]) > fabs(A[best * n + column])) best = i;
    return best;
}

/* Replace A (n, n) by its inverse, by Gauss and Jordan with row exchanges. */
static void invert_matrix(size_t n, double *A) {
    size_t pivot[BD_TIME_MAX_RANK];
    for (size_t c = 0; c < n; ++c) {
        pivot[c] = find_pivot(n, A, c);
        if (pivot[c] != c)
            for (size_t j = 0; j < n; ++j) exchange(A + c * n + j, A + pivot[c] * n + j);

        double *pivot_row = A + c * n;
        const double inverse = 1.0 / pivot_row[c];
        /* column c of A is no longer needed: column c of the inverse takes its place */
        pivot_row[c] = 1.0;
        for (size_t j = 0; j < n; ++j) pivot_row[j] *= inverse;
        for (size_t i = 0; i < n; ++i) {
            double *row = A + i * n;
            const double factor = row[c];
            if (i == c || factor == 0.0) continue;
            row[c] = 0.0;
            add(n, -factor, pivot_row, row);
        }
    }
    /* exchanged rows are exchanged columns of the inverse */
    for (size_t c = n; c-- > 0;) {
        if (pivot[c] == c) continue;
        for (size_t i = 0; i < n; ++i) exchange(A + i * n + c, A + i * n + pivot[c]);
    }
}

/* Compute M = (I + V' D V)^-1 of a sector from the transposed matrix. */
static void invert_sector(bd_time *t, const bd_time_patterns *patterns, size_t sector) {
    const size_t rank = (size_t)patterns->rank;
    double *A = t->work;
    double *M = t->preconditioner + sector * rank * rank;
    fill_sector_matrix(t, patterns, sector, A);
    invert_matrix(rank, A);
    /* a row of the transposed matrix is a column of M: store it in blocks of 8 rows of M */
    for (size_t i = 0; i < rank; i += 8) {
        for (size_t j = 0; j < rank; ++j) {
            memcpy(M, A + j * rank + i, 8 * sizeof *M);
            M += 8;
        }
    }
    t->outdated[sector] = 0;
}

/* b = -M' u/divisor, with M (n, n) in blocks of 8 rows. */
static void multiply_blocks_transposed(size_t n, const double *M, const double *u, double divisor,
                                       double *b) {
    for (size_t j = 0; j < n; ++j) {
        const double *column = M + 8 * j; /* its rows in the first block */
        bd_vec sum = bd_all(0.0);
        for (size_t i = 0; i < n; i += 8) {
            for (size_t l = 0; l < 8; l += BD_WIDTH)
                sum += bd_load(u + i + l) * bd_load(column + l);
            column += 8 * n;
        }
        b[j] = -total(sum) / divisor;
    }
}

/* Update M of a sector after a change (3) of one row of D of a point, by the formula of Sherman and
 * Morrison: T changes by v u', hence M by -(M v) (M' u)'/(1 + u' M v). `row` is the row of the
 * motion, d * stride + point. */
static void update_inverse(bd_time *t, const bd_time_patterns *patterns, size_t sector, size_t row,
                           const double *change) {
    const size_t rank = (size_t)patterns->rank;
    const size_t point = row % t->stride;
    const double *V = patterns->pattern_transposed;
    const double *v = V + row * rank;
    double *M = t->preconditioner + sector * rank * rank;
    double u[BD_TIME_MAX_RANK] = {0.0};
    for (size_t d = 0; d < 3; ++d)
        if (change[d] != 0.0) add(rank, change[d], V + (d * t->stride + point) * rank, u);

    double M_v[BD_TIME_MAX_RANK];
    multiply_blocks(rank, M, v, M_v);
    const double denominator = 1.0 + dot(rank, u, M_v);
    /* a small denominator leaves no digits: compute the inverse from the matrix */
    if (!(fabs(denominator) > BD_TIME_SINGULAR)) {
        t->outdated[sector] = 1;
        return;
    }
    double b[BD_TIME_MAX_RANK]; /* -M' u/denominator */
    multiply_blocks_transposed(rank, M, u, denominator, b);
    for (size_t i = 0; i < rank; i += 8) {
        for (size_t j = 0; j < rank; ++j) {
            add(8, b[j], M_v + i, M);
            M += 8;
        }
    }
}

/* Whether D (3, 3) differs from the stored derivatives by more than a small part of their largest
 * entry. */
BD_INLINE int has_changed(const double *D, const double *stored, size_t stride) {
    static const double IGNORED = 0.05;
    double change = 0.0;
    double largest = 0.0;
    for (size_t j = 0; j < 9; ++j) {
        change = larger(fabs(D[j] - stored[j * stride]), change);
        largest = larger(fabs(stored[j * stride]), largest);
    }
    return change > IGNORED * largest;
}

/* Store the derivatives D (3, 3) of a point, and update M with them. */
static void set_tangent(bd_time *t, const bd_time_patterns *patterns, size_t sector, size_t point,
                        const double *D) {
    const size_t stride = t->stride;
    double *stored = tangent_of(t, sector, point);
    for (size_t d = 0; d < 3; ++d) {
        double row_change[3];
        for (size_t e = 0; e < 3; ++e) {
            double *entry = stored + (3 * d + e) * stride;
            row_change[e] = D[3 * d + e] - *entry;
            *entry = D[3 * d + e];
        }
        const int differs = row_change[0] != 0.0 || row_change[1] != 0.0 || row_change[2] != 0.0;
        if (differs && !t->outdated[sector])
            update_inverse(t, patterns, sector, d * stride + point, row_change);
    }
}

/* Update the derivatives of one point to its present state, and M with them; small changes are
 * ignored. */
static void update_point(bd_time *t, const bd_time_patterns *patterns, size_t sector, size_t point,
                         const double *motion, const double *slider) {
    double D[9];
    contact_tangent(t, sector, point, motion, slider, D);
    if (has_changed(D, tangent_of(t, sector, point), t->stride))
        set_tangent(t, patterns, sector, point, D);
}

/* Update those of the BD_WIDTH points from `first` on that differ from their stored state, with
 * motions x (3) and sliders w (2, stride). */
BD_NOT_INLINE void update_points(bd_time *t, const bd_time_patterns *patterns, size_t sector,
                                 size_t first, const bd_vec *x, const double *w, bd_mask differs) {
    for (size_t i = 0; i < BD_WIDTH && first + i < (size_t)t->n_point; ++i) {
        if (!bd_entry_int(differs, i)) continue;
        const double motion[3] = {bd_entry(x[0], i), bd_entry(x[1], i), bd_entry(x[2], i)};
        const double slider[2] = {w[i], w[t->stride + i]};
        update_point(t, patterns, sector, first + i, motion, slider);
    }
}

/* Update states and derivatives of all points at the motion x. */
static void update_states(bd_time *t, const bd_time_patterns *patterns, const double *x) {
    const size_t stride = t->stride;
    const size_t n_sector = (size_t)t->n_sector;
    for (size_t first = 0; first < (size_t)t->n_point; first += BD_WIDTH) {
        const points parameters = load_parameters(t, first);
        for (size_t sector = 0; sector < n_sector; ++sector) {
            const double *w = t->slider + 2 * stride * sector + first;
            double *known_state = t->contact_state + stride * sector + first;
            bd_vec motion[3];
            load_motion(t, x, sector, first, motion);

            const bd_vec state = contact_state_of(t, &parameters, motion, w);
            const bd_mask is_new = bd_differ(state, bd_load(known_state));
            /* the derivatives of slip in the plane change with its direction */
            const bd_mask differs = is_new | bd_at_least(state, bd_all(SLIDES_IN_PLANE));
            bd_store(known_state, state);
            if (bd_any(differs)) update_points(t, patterns, sector, first, motion, w, differs);
        }
    }
    for (size_t sector = 0; sector < n_sector; ++sector)
        if (t->outdated[sector]) invert_sector(t, patterns, sector);
}

static void mark_outdated(bd_time *t) {
    for (int sector = 0; sector < t->n_sector; ++sector) t->outdated[sector] = 1;
}

/* ---- corrections ---- */

/* Number of pattern forces of all sectors. */
BD_INLINE size_t n_pattern_forces(const bd_time *t, const bd_time_patterns *patterns) {
    return (size_t)patterns->rank * (size_t)t->n_sector;
}

/* out = M in, sector by sector. */
BD_INLINE void precondition(const bd_time *t, size_t rank, const double *in, double *out) {
    for (size_t sector = 0; sector < (size_t)t->n_sector; ++sector) {
        const double *M = t->preconditioner + sector * rank * rank;
        multiply_blocks(rank, M, in + sector * rank, out + sector * rank);
    }
}

/* Next Krylov vector M (I + T C) now = C now - M (C now - now), before it is made orthogonal;
 * compliant = C now. */
static void next_vector(bd_time *t, const bd_time_patterns *patterns, double *now,
                        double *compliant, double *next) {
    const size_t n = n_pattern_forces(t, patterns);
    double *difference = t->pattern_correction;
    compliance_times(t, patterns, now, compliant);
    for (size_t i = 0; i < n; ++i) difference[i] = compliant[i] - now[i];
    precondition(t, (size_t)patterns->rank, difference, next);
    for (size_t i = 0; i < n; ++i) next[i] = compliant[i] - next[i];
}

/* Least squares problem of GMRES: the Hessenberg matrix, made triangular by rotations. */
typedef struct {
    double H[BD_TIME_VECTORS + 1][BD_TIME_VECTORS];
    double c[BD_TIME_VECTORS], s[BD_TIME_VECTORS]; /* rotations */
    double g[BD_TIME_VECTORS + 1]; /* rotated right side; the last entry is the residual */
    int m;                         /* columns */
} least_squares;

/* Rotate the new column m of H, whose entry below the diagonal is `length`. Return 0 if the column
 * vanishes, so that it cannot be used. */
BD_INLINE int rotate_column(least_squares *problem, double length) {
    const int m = problem->m;
    double(*H)[BD_TIME_VECTORS] = problem->H;
    double *c = problem->c, *s = problem->s, *g = problem->g;
    for (int i = 0; i < m; ++i) {
        const double x = H[i][m];
        H[i][m] = c[i] * x + s[i] * H[i + 1][m];
        H[i + 1][m] = c[i] * H[i + 1][m] - s[i] * x;
    }
    /* a new rotation removes `length` below the diagonal */
    const double norm = sqrt(H[m][m] * H[m][m] + length * length);
    if (!(norm > 0.0)) return 0;
    c[m] = H[m][m] / norm;
    s[m] = length / norm;
    H[m][m] = norm;
    g[m + 1] = -s[m] * g[m];
    g[m] *= c[m];
    return 1;
}

/* pattern_correction and pattern_motion = sums of the Krylov vectors, and of C times them, with the
 * weights that solve the triangular system H weights = g. */
static void add_krylov_vectors(bd_time *t, size_t n, least_squares *problem) {
    const int m = problem->m;
    double *weight = problem->g;
    memset(t->pattern_correction, 0, sizeof(double) * n);
    memset(t->pattern_motion, 0, sizeof(double) * n);
    for (int i = m - 1; i >= 0; --i) {
        const double *row = problem->H[i];
        for (int j = i + 1; j < m; ++j) weight[i] -= row[j] * weight[j];
        weight[i] /= row[i];
        add(n, weight[i], t->krylov + (size_t)i * n, t->pattern_correction);
        add(n, weight[i], t->krylov_motion + (size_t)i * n, t->pattern_motion);
    }
}

/* Solve (I + T C) change = residual by GMRES to a relative tolerance; pattern_motion = C change. */
static void solve_correction(bd_time *t, const bd_time_patterns *patterns, double tolerance) {
    static const double EXACT = 1e-14; /* length of a vector that is rounding */
    const size_t n = n_pattern_forces(t, patterns);
    double *first = t->krylov;
    precondition(t, (size_t)patterns->rank, t->residual, first);
    const double size = sqrt(dot(n, first, first));
    if (size > 0.0)
        for (size_t i = 0; i < n; ++i) first[i] /= size;

    least_squares problem;
    problem.m = 0;
    problem.g[0] = size;
    while (problem.m < BD_TIME_VECTORS && fabs(problem.g[problem.m]) > tolerance * size) {
        const int m = problem.m;
        double *now = t->krylov + (size_t)m * n;
        double *next = now + n;
        next_vector(t, patterns, now, t->krylov_motion + (size_t)m * n, next);
        for (int i = 0; i <= m; ++i) {
            const double *earlier = t->krylov + (size_t)i * n;
            problem.H[i][m] = dot(n, earlier, next);
            add(n, -problem.H[i][m], earlier, next);
        }
        const double length = sqrt(dot(n, next, next));
        if (!rotate_column(&problem, length)) break;
        ++problem.m;
        const int is_exact = !(length > EXACT * problem.H[m][m]);
        if (is_exact) break;
        for (size_t i = 0; i < n; ++i) next[i] /= length;
    }
    add_krylov_vectors(t, n, &problem);
}

/* Solve (I + T C) change = residual for the correction of the pattern forces to a relative
 * tolerance, and find its motion V C change (n_sector, rows) at the points. */
static void find_correction(bd_time *t, const bd_time_patterns *patterns, double tolerance) {
    const size_t n_sector = (size_t)t->n_sector;
    solve_correction(t, patterns, tolerance);
    multiply(n_sector, t->rows, (size_t)patterns->rank, t->pattern_motion, patterns->pattern,
             t->correction_motion);
}

/* ---- Newton's method for the contact forces of all sectors ---- */

/* Contact forces F (n_sector, rows) at the latest motion, and the residual R = V' F - p (n_sector,
 * rank) of the pattern forces p; return its norm. */
static double pattern_residual(bd_time *t, const bd_time_patterns *patterns) {
    const size_t n = n_pattern_forces(t, patterns);
    all_contact_forces(t, t->motion, t->point_force);
    multiply((size_t)t->n_sector, (size_t)patterns->rank, t->rows, t->point_force,
             patterns->pattern_transposed, t->residual);
    add(n, -1.0, t->pattern_force, t->residual);
    ++t->effort.n_evaluation;
    return sqrt(dot(n, t->residual, t->residual));
}

/* Add a share of the correction (negative: undo) to the motion x (n_sector, rows) and the pattern
 * forces p (n_sector, rank): x -= share V C change, p += share change. Return the norm of the
 * residual. */
static double apply_correction(bd_time *t, const bd_time_patterns *patterns, double share) {
    const size_t n_motion = t->rows * (size_t)t->n_sector;
    add(n_motion, -share, t->correction_motion, t->motion);
    add(n_pattern_forces(t, patterns), share, t->pattern_correction, t->pattern_force);
    return pattern_residual(t, patterns);
}

/* Decrease of the potential per share of the correction: (C change) . R. */
static double descent(const bd_time *t, const bd_time_patterns *patterns) {
    return dot(n_pattern_forces(t, patterns), t->pattern_motion, t->residual);
}

/* Add the whole correction, or the share of it at which the potential along it is least; return the
 * norm of the residual, which was `norm_before`. The whole correction suffices if the potential
 * still falls at its end or hardly rises, or if the residual shrinks enough. Otherwise the descent
 * changes its sign between the shares 0 and 1, and regula falsi (Illinois) finds the minimum. */
static double search_length(bd_time *t, const bd_time_patterns *patterns, double norm_before) {
    const double at_start = descent(t, patterns);
    const double small = BD_TIME_SLOPE * at_start;
    double norm = apply_correction(t, patterns, 1.0);
    const double at_end = descent(t, patterns);
    const int is_minimum_beyond = at_end >= -small;
    const int converges = norm < BD_TIME_CONVERGES * norm_before;
    if (!(at_start > 0.0) || is_minimum_beyond || converges) return norm;

    /* the descent is positive at the share `low` and negative at `high` */
    double low = 0.0, at_low = at_start;
    double high = 1.0, at_high = at_end;
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
    const size_t stride = t->stride;
    for (size_t sector = 0; sector < (size_t)t->n_sector; ++sector) {
        for (size_t first = 0; first < stride; first += BD_WIDTH) {
            bd_vec motion_at_end[3], motion[3], change[3];
            load_motion(t, t->free_motion, sector, first, motion_at_end);
            load_motion(t, t->motion, sector, first, motion);
            for (size_t d = 0; d < 3; ++d) change[d] = motion_at_end[d] - motion[d];

            for (size_t d = 0; d < 3; ++d) {
                const double *D = tangent_of(t, sector, first) + 3 * d * stride;
                const bd_vec D0 = bd_load(D);
                const bd_vec D1 = bd_load(D + stride);
                const bd_vec D2 = bd_load(D + 2 * stride);
                const bd_vec force = D0 * change[0] + D1 * change[1] + D2 * change[2];
                bd_store(t->predicted_force + sector * t->rows + d * stride + first, force);
            }
        }
    }
}

/* Give a point its expected state, with the derivatives and the predicted force in this state at
 * the motion x*. A point whose derivatives change continuously, or whose state is unknown, keeps its
 * derivatives D, and its force is F + D (x* - x) from the last step. */
static void expect_state(bd_time *t, const bd_time_patterns *patterns, size_t sector, size_t point,
                         int state) {
    const size_t stride = t->stride;
    const size_t first = sector * t->rows + point;
    const double *x_at_end = t->free_motion + first;
    double *F = t->predicted_force + first;
    double *known = t->contact_state + sector * stride + point;
    const int is_affine = state != BD_TIME_UNKNOWN && state < SLIDES_IN_PLANE;
    if (!is_affine) {
        const double *D = tangent_of(t, sector, point);
        for (size_t d = 0; d < 3; ++d) {
            F[d * stride] = t->point_force[first + d * stride];
            for (size_t e = 0; e < 3; ++e) {
                const double change = x_at_end[e * stride] - t->motion[first + e * stride];
                F[d * stride] += D[(3 * d + e) * stride] * change;
            }
        }
        return;
    }
    const double motion[3] = {x_at_end[0], x_at_end[stride], x_at_end[2 * stride]};
    const double *w = t->slider + 2 * stride * sector + point;
    double D[9], force[3];
    force_in_state(t, point, state, motion, w, force, D);
    for (size_t d = 0; d < 3; ++d) F[d * stride] = force[d];
    if (*known == (double)state) return;
    *known = (double)state;
    set_tangent(t, patterns, sector, point, D);
}

/* free_motion = the motion at the end of the step with the pattern forces of the last step. */
static void add_motion_of_last_forces(bd_time *t, const bd_time_patterns *patterns) {
    const size_t n_sector = (size_t)t->n_sector;
    compliance_times(t, patterns, t->pattern_force, t->pattern_motion);
    multiply(n_sector, t->rows, (size_t)patterns->rank, t->pattern_motion, patterns->pattern,
             t->correction_motion);
    for (size_t i = 0; i < t->rows * n_sector; ++i) t->free_motion[i] -= t->correction_motion[i];
}

/* First correction of a step, from the change of the motion since the last step: the forces change
 * by D (x* - x), so the residual is V' D (x* - x). */
static void predict_correction(bd_time *t, const bd_time_patterns *patterns) {
    predict_forces(t);
    multiply((size_t)t->n_sector, (size_t)patterns->rank, t->rows, t->predicted_force,
             patterns->pattern_transposed, t->residual);
    find_correction(t, patterns, BD_TIME_LINEAR_TOLERANCE);
}

/* First correction of a step in the states of the last period: the residual is V' F - p, where F
 * are the forces that these states give at the motion x*. */
static void predict_correction_by_period(bd_time *t, const bd_time_patterns *patterns) {
    const size_t n_point = (size_t)t->n_point;
    const signed char *expected = t->period_state;
    for (size_t sector = 0; sector < (size_t)t->n_sector; ++sector) {
        for (size_t point = 0; point < n_point; ++point)
            expect_state(t, patterns, sector, point, expected[sector * n_point + point]);
        if (t->outdated[sector]) invert_sector(t, patterns, sector);
    }
    multiply((size_t)t->n_sector, (size_t)patterns->rank, t->rows, t->predicted_force,
             patterns->pattern_transposed, t->residual);
    add(n_pattern_forces(t, patterns), -1.0, t->pattern_force, t->residual);
    find_correction(t, patterns, BD_TIME_HARD_LINEAR_TOLERANCE);
}

/* Compare the found states with the states of the last step and of the last period, at the end of a
 * step. The next step expects the states of the last period if they were wrong at no more points.
 * While a transient decays the last period is a bad guess. */
static void judge_expectations(bd_time *t) {
    const size_t n_point = (size_t)t->n_point;
    long wrong_of_step = 0, wrong_of_period = 0;
    for (size_t sector = 0; sector < (size_t)t->n_sector; ++sector) {
        const double *found = t->contact_state + sector * t->stride;
        const double *last = t->last_state + sector * t->stride;
        for (size_t point = 0; point < n_point; ++point)
            wrong_of_step += last[point] != found[point];
        if (!t->period_state) continue;
        const signed char *of_period = t->period_state + sector * n_point;
        for (size_t point = 0; point < n_point; ++point)
            wrong_of_period += (double)of_period[point] != found[point];
    }
    t->period_is_better = t->period_state && wrong_of_period <= wrong_of_step;
}

/* Find the contact forces at the end of a step, from the motion x* without them in free_motion.
 * Results are the motion and the forces. Return 0 if they were not found. */
static int solve_contact(bd_time *t, const bd_time_patterns *patterns, double tolerance,
                         int predict) {
    const size_t n_force = n_pattern_forces(t, patterns);
    const size_t n_motion = t->rows * (size_t)t->n_sector;
    add_motion_of_last_forces(t, patterns);
    memcpy(t->last_state, t->contact_state, sizeof(double) * t->stride * (size_t)t->n_sector);
    if (predict && t->period_state && t->period_is_better) {
        predict_correction_by_period(t, patterns);
    } else if (predict) {
        predict_correction(t, patterns);
    } else {
        memset(t->correction_motion, 0, sizeof(double) * n_motion);
        memset(t->pattern_correction, 0, sizeof(double) * n_force);
    }
    memcpy(t->motion, t->free_motion, sizeof(double) * n_motion);

    const double largest_before = t->largest_force;
    double norm = apply_correction(t, patterns, 1.0);
    for (int i = 0;; ++i) {
        update_states(t, patterns, t->motion);
        const double force = sqrt(dot(n_force, t->pattern_force, t->pattern_force));
        t->largest_force = larger(force, t->largest_force);
        /* forces of open contacts are zero: the residual is then relative to the largest so far */
        const double scale = larger(force, 1e-6 * t->largest_force);
        const int is_solved = norm <= tolerance * scale;
        const int is_finite = norm < HUGE_VAL;
        if (is_solved || !is_finite || i == BD_TIME_MAX_ITERATIONS) {
            /* a residual above the tolerance may still serve */
            const int is_usable = force < HUGE_VAL && norm <= BD_TIME_UNSOLVED * scale;
            if (!is_usable) t->largest_force = largest_before;
            if (is_usable) judge_expectations(t);
            return is_usable;
        }
        /* few corrections suffice in most steps; in others the direction decides */
        const int is_hard = i >= BD_TIME_EASY_ITERATIONS;
        const double linear_tolerance =
            is_hard ? BD_TIME_HARD_LINEAR_TOLERANCE : BD_TIME_LINEAR_TOLERANCE;
        find_correction(t, patterns, linear_tolerance);
        norm = search_length(t, patterns, norm);
    }
}

#endif
