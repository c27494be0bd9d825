/* Condensation of a bordered Jacobian to the motion at the contact points.
 *
 * The Jacobian of harmonic balance is J = D + U^T T U. D is diagonal in the modes, with a block
 *
 *     [  d  c ]      d = K - (l omega)^2 M,  c = l omega C
 *     [ -c  d ]
 *
 * for cosine and sine of a mode; T is the tangent of the contact forces. With x = U q, with border
 * columns C and rows R, and with kept coordinates k and eliminated ones e, a solution satisfies
 *
 *     D_e q_e            + U_e^T T x + C_e p = b_e
 *    -U_e q_e - U_k q_k  + x                 = 0
 *               D_k q_k  + U_k^T T x + C_k p = b_k
 *     R_e q_e + R_k q_k              + E p   = b_p.
 *
 * The first row yields q_e. The others are the reduced equations for z = (x, q_k, p),
 *
 *     [ 1 + F T      -U_k   U_e D^-1 C_e    ]
 *     [ U_k^T T       D_k   C_k             ] z = right-hand side,   F = U_e D_e^-1 U_e^T,
 *     [ -R_e D^-1 U_e^T T  R_k  E - R_e D^-1 C_e ]
 *
 * where F, the receptance at the contact points, couples no harmonics. det D_e is positive, so the
 * determinants of the full and of the reduced matrix have the same sign.
 *
 * An eliminated D is a pivot that no search has chosen. A mode near its resonance has a small one,
 * and a rigid mode has none: these coordinates remain. Each solution is refined once with the
 * residual of the full equations. The dense factors remain for equations whose reduced matrix is
 * close to singular, and for solutions that the refinement changes too much. */
#include "balance/condensation.h"

#include "util/storage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A mode remains in the equations if |D| is below this share of its stiffness and inertia. */
static const double NEAR_RESONANCE = 1e-3;

/* Dense factors are used if the reduced matrix has a smaller estimate of the reciprocal condition,
 * or if a refinement changes a solution by more. */
static const double LEAST_CONDITION = 1e-12;
static const double LARGEST_CORRECTION = 1e-6;

/* Ratio of the smallest to the largest pivot above which the estimate is not needed (dense.c). */
static const double REGULAR = 1e-5;

/* Rounding noise: size of a row relative to the largest entries of its columns (dense.c). */
static const double NOISE = 1e-13;

static size_t n_row(int l) { return l == 0 ? 1 : 2; }

static size_t n_column(const bd_hbm *hbm, int l) { return n_row(l) * (size_t)hbm->n_mode[l]; }

static size_t first_coefficient(int l) { return l == 0 ? 0 : (size_t)(2 * l - 1); }

/* Columns of harmonic l in the row of U for a coefficient of component i. */
static const double *modes_of(const bd_condensation *c, int i, int l, size_t part) {
    const size_t columns = n_column(c->hbm, l);
    const size_t component = (size_t)c->parts.component[i];
    return c->hbm->G[l] + (component * n_row(l) + part) * columns;
}

/* ---- products with the parts of J ---- */

/* x = U q: motion x (n_component, n_coef) at the moved components of the contact points, from modal
 * coordinates q (n_unknown). U couples no harmonics. */
static void to_motion(const bd_condensation *c, const double *q, double *x) {
    const bd_hbm *hbm = c->hbm;
    for (int i = 0; i < c->parts.n_component; ++i) {
        double *of_component = x + (size_t)i * (size_t)hbm->n_coef;
        for (int l = 0; l <= hbm->n_harm; ++l) {
            const double *q_l = q + hbm->first_unknown[l];
            for (size_t part = 0; part < n_row(l); ++part) {
                const double *g = modes_of(c, i, l, part);
                double sum = 0.0;
                for (size_t j = 0; j < n_column(hbm, l); ++j) sum += g[j] * q_l[j];
                of_component[first_coefficient(l) + part] = sum;
            }
        }
    }
}

/* q += factor U^T f: modal forces q (n_unknown) of forces f (n_component, n_coef) on the moved
 * components of the contact points. */
static void add_modal_force(const bd_condensation *c, double factor, const double *f, double *q) {
    const bd_hbm *hbm = c->hbm;
    for (int i = 0; i < c->parts.n_component; ++i) {
        const double *of_component = f + (size_t)i * (size_t)hbm->n_coef;
        for (int l = 0; l <= hbm->n_harm; ++l) {
            double *q_l = q + hbm->first_unknown[l];
            for (size_t part = 0; part < n_row(l); ++part) {
                const double *g = modes_of(c, i, l, part);
                const double scaled = factor * of_component[first_coefficient(l) + part];
                for (size_t j = 0; j < n_column(hbm, l); ++j) q_l[j] += scaled * g[j];
            }
        }
    }
}

/* f = T x or T^T x, with the tangent T (n_motion, n_motion) of the contact forces, n_motion moved
 * components times n_coef. */
static void to_force(const bd_condensation *c, int transposed, const double *x, double *f) {
    const size_t m = (size_t)c->n_motion;
    memset(f, 0, sizeof(double) * m);
    for (size_t i = 0; i < m; ++i) {
        const double *row = c->parts.tangent + i * m;
        if (transposed) {
            for (size_t j = 0; j < m; ++j) f[j] += row[j] * x[i];
        } else {
            for (size_t j = 0; j < m; ++j) f[i] += row[j] * x[j];
        }
    }
}

/* out = D x or D^T x for modal coordinates (n_unknown). For each mode, D is d = K for the mean and
 * [d c; -c d] for cosine and sine of harmonic l, d = K - (l omega)^2 M, c = l omega C. */
static void multiply_diagonal(const bd_condensation *c, int transposed, const double *x,
                              double *out) {
    const bd_hbm *hbm = c->hbm;
    const double *d = c->parts.dynamic, *loss = c->parts.loss;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t n = (size_t)hbm->n_mode[l], first = (size_t)hbm->first_unknown[l];
        for (size_t j = 0; j < n; ++j, ++d, ++loss) {
            const size_t a = first + j, b = a + n; /* cosine and sine */
            if (l == 0) {
                out[a] = *d * x[a];
                continue;
            }
            const double coupling = transposed ? -*loss : *loss;
            const double cosine = x[a], sine = x[b];
            out[a] = *d * cosine + coupling * sine;
            out[b] = *d * sine - coupling * cosine;
        }
    }
}

/* q = D^-1 q or D^-T q for the eliminated coordinates of harmonic l, 0 for the kept coordinates. D
 * is d for the mean and [d c; -c d] for cosine and sine of a mode, whose inverse is [d -c; c
 * d]/(d^2 + c^2). q, d and the loss c begin with this harmonic. */
static void divide_harmonic(const bd_condensation *c, int l, int transposed, const double *d,
                            const double *loss, double *q) {
    const size_t n = (size_t)c->hbm->n_mode[l];
    const unsigned char *is_kept = c->is_kept + c->hbm->first_unknown[l];
    for (size_t j = 0; j < n; ++j) {
        if (is_kept[j]) {
            q[j] = 0.0;
            if (l > 0) q[n + j] = 0.0;
        } else if (l == 0) {
            q[j] /= d[j];
        } else {
            const double square = d[j] * d[j] + loss[j] * loss[j];
            const double coupling = transposed ? -loss[j] : loss[j];
            const double cosine = q[j], sine = q[n + j];
            q[j] = (d[j] * cosine - coupling * sine) / square;
            q[n + j] = (d[j] * sine + coupling * cosine) / square;
        }
    }
}

/* q (n_unknown) = D^-1 q or D^-T q for the eliminated coordinates of all harmonics, 0 for the kept
 * coordinates; D is the diagonal part of the Jacobian in the modes. */
static void divide(const bd_condensation *c, int transposed, double *q) {
    const double *d = c->parts.dynamic, *loss = c->parts.loss;
    for (int l = 0; l <= c->hbm->n_harm; ++l) {
        divide_harmonic(c, l, transposed, d, loss, q + c->hbm->first_unknown[l]);
        d += c->hbm->n_mode[l];
        loss += c->hbm->n_mode[l];
    }
}

/* Multiply the vibration (all unknowns after the mean) in q (n_unknown) by a factor. */
static void scale_vibration(const bd_condensation *c, double factor, double *q) {
    const size_t n = (size_t)c->hbm->n_unknown;
    if (factor == 1.0) return;
    for (size_t i = (size_t)c->hbm->n_mode[0]; i < n; ++i) q[i] *= factor;
}

static double dot(const double *x, const double *y, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += x[i] * y[i];
    return sum;
}

/* out = J x or J^T x for the Jacobian of the equations without the border of the parameter,
 *
 *     J = [ R (D + U^T T U) S   columns ]      R, S: 1 for the mean, 1/a and a for the vibration
 *         [ rows                0       ]
 *
 * with n_extra extra columns and rows, and the amplitude a. Transposed, columns and rows, and R and
 * S, exchange roles. */
void bd_condensation_product(bd_condensation *c, int transposed, const double *x, double *out) {
    const size_t n = (size_t)c->hbm->n_unknown;
    const double *columns = transposed ? c->extra_row : c->extra_column;
    const double *rows = transposed ? c->extra_column : c->extra_row;
    const double before = transposed ? 1.0 / c->amplitude : c->amplitude;
    double *q = c->q;
    memcpy(q, x, sizeof(double) * n);
    scale_vibration(c, before, q);
    multiply_diagonal(c, transposed, q, out);
    to_motion(c, q, c->reduced);
    to_force(c, transposed, c->reduced, c->force);
    add_modal_force(c, 1.0, c->force, out);
    scale_vibration(c, 1.0 / before, out);
    for (size_t i = 0; i < (size_t)c->n_extra; ++i) {
        for (size_t j = 0; j < n; ++j) out[j] += columns[i * n + j] * x[n + i];
        out[n + i] = dot(rows + i * n, x, n);
    }
}

/* ---- the reduced matrix ---- */

/* Choose the kept coordinates: modes near their resonance, whose pivot |D| = hypot(d, l omega C) is
 * small compared with stiffness K and inertia (l omega)^2 M = K - d, with cosine and sine. Return 0
 * if there are too many. */
static int choose_kept(bd_condensation *c) {
    const bd_hbm *hbm = c->hbm;
    const double *d = c->parts.dynamic, *loss = c->parts.loss, *stiffness = hbm->stiffness;
    c->n_kept = 0;
    memset(c->is_kept, 0, (size_t)hbm->n_unknown);
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const int n = hbm->n_mode[l], first = hbm->first_unknown[l];
        for (int j = 0; j < n; ++j, ++d, ++loss, ++stiffness) {
            const double inertia = *stiffness - *d;
            const double size = hypot(*d, *loss);
            if (size > NEAR_RESONANCE * (*stiffness + fabs(inertia))) continue;
            if (c->n_kept + 2 > c->most_kept) return 0;
            for (int part = 0; part < (int)n_row(l); ++part) {
                const int unknown = first + part * n + j;
                c->is_kept[unknown] = 1;
                c->kept[c->n_kept] = unknown;
                ++c->n_kept;
            }
        }
    }
    c->n_reduced = c->n_motion + c->n_kept + c->n_border;
    return 1;
}

/* Fill columns (k, n), rows (k, n) and corner (k, k) of the border, k = n_extra + 1: the extra
 * columns and rows of the equations, then the derivative C with respect to the parameter and the
 * row of the border. They are for the unknowns q of the harmonic balance: q = a y for the vibration
 * with the amplitude a, and row/scale for unscaled unknowns. */
static void fill_border(bd_condensation *c, const bd_border *border) {
    const bd_equations *e = &c->dense->base;
    const size_t n = (size_t)c->hbm->n_unknown, n_extra = (size_t)c->n_extra;
    const size_t k = n_extra + 1;
    double *last_column = c->column + n_extra * n, *last_row = c->row + n_extra * n;
    memcpy(c->column, c->extra_column, sizeof(double) * n_extra * n);
    memcpy(c->row, c->extra_row, sizeof(double) * n_extra * n);
    memcpy(last_column, e->C, sizeof(double) * n);
    for (size_t j = 0; j < n; ++j) last_row[j] = border->row[j] / border->scale[j];
    for (size_t i = 0; i < k; ++i) {
        scale_vibration(c, c->amplitude, c->column + i * n);
        scale_vibration(c, 1.0 / c->amplitude, c->row + i * n);
    }
    memset(c->corner, 0, sizeof(double) * k * k);
    for (size_t i = 0; i < n_extra; ++i) c->corner[i * k + n_extra] = e->C[n + i];
    for (size_t i = 0; i < k; ++i)
        c->corner[n_extra * k + i] = border->row[n + i] / border->scale[n + i];
}

/* Add F T (n_motion, n_motion) to the rows of x in the reduced matrix A. The receptance
 * F = U_e D_e^-1 U_e^T couples no harmonics. For a coefficient of a force (`source`) and of a
 * motion (`to`) of one harmonic, F is U_to D^-1 U_source^T with their rows of U. Row `to` of A gets
 * F times row `source` of T. */
static void add_receptance(bd_condensation *c) {
    const bd_hbm *hbm = c->hbm;
    const size_t m = (size_t)c->n_motion, n_coef = (size_t)hbm->n_coef;
    const double *d = c->parts.dynamic, *loss = c->parts.loss;
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t columns = n_column(hbm, l), first = first_coefficient(l);
        for (size_t source = 0; source < (size_t)c->parts.n_component * n_row(l); ++source) {
            const int i = (int)(source / n_row(l));
            const size_t part = source % n_row(l);
            const double *tangent = c->parts.tangent + ((size_t)i * n_coef + first + part) * m;
            memcpy(c->q, modes_of(c, i, l, part), sizeof(double) * columns);
            divide_harmonic(c, l, 0, d, loss, c->q);
            for (int to = 0; to < c->parts.n_component; ++to) {
                for (size_t to_part = 0; to_part < n_row(l); ++to_part) {
                    const double F = dot(modes_of(c, to, l, to_part), c->q, columns);
                    const size_t at = (size_t)to * n_coef + first + to_part;
                    double *row = c->A + at * (size_t)c->n_reduced;
                    for (size_t j = 0; j < m; ++j) row[j] += F * tangent[j];
                }
            }
        }
        d += hbm->n_mode[l];
        loss += hbm->n_mode[l];
    }
}

/* Rows [U_k^T T, D_k, C_k] and columns -U_k of the kept coordinates in the reduced matrix A, whose
 * unknowns are the motion x, the kept coordinates and the border. */
static void fill_kept(bd_condensation *c) {
    const bd_hbm *hbm = c->hbm;
    const size_t m = (size_t)c->n_motion, n = (size_t)hbm->n_unknown;
    const size_t size = (size_t)c->n_reduced, n_kept = (size_t)c->n_kept;
    for (size_t i = 0; i < n_kept; ++i) {
        double *row = c->A + (m + i) * size;
        const size_t unknown = (size_t)c->kept[i];

        /* column of U */
        memset(c->q, 0, sizeof(double) * n);
        c->q[unknown] = 1.0;
        to_motion(c, c->q, c->reduced);
        for (size_t j = 0; j < m; ++j) c->A[j * size + m + i] = -c->reduced[j];
        to_force(c, 1, c->reduced, row);

        /* row of D */
        multiply_diagonal(c, 1, c->q, c->given);
        for (size_t j = 0; j < n_kept; ++j) row[m + j] = c->given[c->kept[j]];
        for (size_t j = 0; j < (size_t)c->n_border; ++j)
            row[m + n_kept + j] = c->column[j * n + unknown];
    }
}

/* Rows [-R_e D^-1 U_e^T T, R_k, E - R_e D^-1 C_e] and columns U_e D^-1 C_e of the border in the
 * reduced matrix A, whose unknowns are the motion x, the kept coordinates and the border. */
static void fill_border_of_reduced(bd_condensation *c) {
    const size_t m = (size_t)c->n_motion, n = (size_t)c->hbm->n_unknown;
    const size_t size = (size_t)c->n_reduced, n_kept = (size_t)c->n_kept;
    const size_t k = (size_t)c->n_border, first = m + n_kept;
    for (size_t i = 0; i < k; ++i) {
        double *row = c->A + (first + i) * size;

        /* (D^-T R^T)^T U^T T */
        memcpy(c->q, c->row + i * n, sizeof(double) * n);
        divide(c, 1, c->q);
        to_motion(c, c->q, c->reduced);
        to_force(c, 1, c->reduced, row);
        for (size_t j = 0; j < m; ++j) row[j] = -row[j];
        for (size_t j = 0; j < n_kept; ++j) row[m + j] = c->row[i * n + (size_t)c->kept[j]];

        /* D^-1 C */
        memcpy(c->q, c->column + i * n, sizeof(double) * n);
        divide(c, 0, c->q);
        to_motion(c, c->q, c->reduced);
        for (size_t j = 0; j < m; ++j) c->A[j * size + first + i] = c->reduced[j];
        for (size_t j = 0; j < k; ++j) {
            const double eliminated = dot(c->row + j * n, c->q, n);
            c->A[(first + j) * size + first + i] = c->corner[j * k + i] - eliminated;
        }
    }
}

/* Bring the columns and then the rows of the reduced matrix to unit size. Return 0 if a column is
 * empty, or if a row is rounding noise and would impose an arbitrary condition. */
static int scale_reduced(bd_condensation *c) {
    const size_t size = (size_t)c->n_reduced;
    memset(c->column_scale, 0, sizeof(double) * size);
    for (size_t i = 0; i < size; ++i)
        for (size_t j = 0; j < size; ++j)
            c->column_scale[j] = fmax(c->column_scale[j], fabs(c->A[i * size + j]));
    for (size_t j = 0; j < size; ++j) {
        if (!(c->column_scale[j] > 0.0)) return 0;
        c->column_scale[j] = 1.0 / c->column_scale[j];
    }
    for (size_t i = 0; i < size; ++i) {
        double most = 0.0, *row = c->A + i * size;
        for (size_t j = 0; j < size; ++j) {
            row[j] *= c->column_scale[j];
            most = fmax(most, fabs(row[j]));
        }
        if (!(most > NOISE) || !isfinite(most)) return 0;
        c->row_scale[i] = 1.0 / most;
        for (size_t j = 0; j < size; ++j) row[j] /= most;
    }
    return 1;
}

/* LAPACK's estimate of the reciprocal condition of the reduced matrix A (size, size) in the 1-norm
 * of its transpose, because Fortran reads A by columns: the norm is the largest sum over a row. */
static double estimate_condition(bd_condensation *c) {
    const size_t size = (size_t)c->n_reduced;
    double norm = 0.0, condition = 0.0;
    for (size_t i = 0; i < size; ++i) {
        double sum = 0.0;
        for (size_t j = 0; j < size; ++j) sum += fabs(c->A[i * size + j]);
        norm = fmax(norm, sum);
    }
    char one = '1';
    int m = c->n_reduced, info = 0;
    c->dense->lapack.dgecon(&one, &m, c->LU, &m, &norm, &condition, c->condition_work,
                            c->condition_iwork, &info);
    return condition;
}

/* LU factors of the reduced matrix, the sign of its determinant (orientation: negative pivots and
 * exchanges of rows), and its reciprocal condition: the ratio of smallest to largest pivot, or
 * LAPACK's estimate if this is small. Return 0 if the matrix is close to singular. */
static int factor_reduced(bd_condensation *c) {
    const size_t size = (size_t)c->n_reduced;
    int m = c->n_reduced, info = 0;
    memcpy(c->LU, c->A, sizeof(double) * size * size);
    c->dense->lapack.dgetrf(&m, &m, c->LU, &m, c->pivot, &info);
    if (info != 0) return 0;

    bd_factored factored = {.orientation = 1, .rank = c->dense->base.n + 1};
    double least = INFINITY, most = 0.0;
    for (size_t i = 0; i < size; ++i) {
        const double pivot = c->LU[i * size + i];
        if (!isfinite(pivot)) return 0;
        least = fmin(least, fabs(pivot));
        most = fmax(most, fabs(pivot));
        const int exchanged = c->pivot[i] != (int)i + 1;
        if ((pivot < 0.0) != exchanged) factored.orientation = -factored.orientation;
    }
    factored.condition = least / most;
    if (factored.condition < REGULAR) factored.condition = estimate_condition(c);
    if (!(factored.condition > LEAST_CONDITION)) return 0;
    c->dense->base.factored = factored;
    return 1;
}

/* ---- solution ---- */

/* Factorise the full matrix instead of the reduced matrix: column j of the Jacobian is its product
 * with the unit vector j. */
static bd_status use_dense(bd_condensation *c) {
    bd_equations *e = &c->dense->base;
    const size_t n = (size_t)e->n;
    double *unit = c->right, *column = c->product;
    memset(unit, 0, sizeof(double) * n);
    for (size_t j = 0; j < n; ++j) {
        unit[j] = 1.0;
        bd_condensation_product(c, 0, unit, column);
        unit[j] = 0.0;
        for (size_t i = 0; i < n; ++i) c->dense_J[i * n + j] = column[i];
    }
    c->uses_dense = 1;
    e->J = c->dense_J;
    const bd_border border = {.row = c->border_row, .scale = c->border_scale};
    const bd_status status = bd_dense_factor(e, &border);
    e->J = NULL;
    return status;
}

/* Factorise the Jacobian [J C] of n equations with the row of the border below it. Modes far from
 * their resonance are eliminated. The reduced matrix A (n_reduced, n_reduced) has the motion x of
 * the contact points, whose block begins as the identity, then the kept unknowns and the border
 * (head of the file). If A is close to singular, or if too many modes are near their resonance,
 * dense factors replace it. */
bd_status bd_condensation_factor(bd_condensation *c, const bd_border *border) {
    bd_equations *e = &c->dense->base;
    const size_t n_all = (size_t)e->n + 1, m = (size_t)c->n_motion;
    memcpy(c->border_row, border->row, sizeof(double) * n_all);
    memcpy(c->border_scale, border->scale, sizeof(double) * n_all);
    if (!choose_kept(c)) return use_dense(c);

    const size_t size = (size_t)c->n_reduced;
    memset(c->A, 0, sizeof(double) * size * size);
    for (size_t i = 0; i < m; ++i) c->A[i * size + i] = 1.0;
    fill_border(c, border);
    add_receptance(c);
    fill_kept(c);
    fill_border_of_reduced(c);
    if (!scale_reduced(c) || !factor_reduced(c)) return use_dense(c);

    c->uses_dense = 0;
    ++e->cost->n_factorisation;
    ++e->cost->n_condensed;
    return BD_OK;
}

/* Solve the reduced equations, or the transposed ones, in place. */
static void solve_reduced(bd_condensation *c, int transposed) {
    const size_t size = (size_t)c->n_reduced;
    const double *before = transposed ? c->column_scale : c->row_scale;
    const double *after = transposed ? c->row_scale : c->column_scale;
    char which = transposed ? 'N' : 'T'; /* Fortran reads A^T */
    int m = c->n_reduced, one = 1, info = 0;
    for (size_t i = 0; i < size; ++i) c->reduced[i] *= before[i];
    c->dense->lapack.dgetrs(&which, &m, &one, c->LU, &m, c->pivot, c->reduced, &m, &info);
    for (size_t i = 0; i < size; ++i) c->reduced[i] *= after[i];
}

/* Solve with the bordered matrix in unscaled unknowns y, or with its transpose, in place, without
 * refinement. The right-hand side b = (b_u, b_p) has n unknowns of the harmonic balance and k of
 * the border:
 *
 *     1. right-hand side of the reduced equations (x, kept q_k, border p):
 *        U_e D^-1 b_u,   b_k,   b_p - R_e D^-1 b_u      (transposed: -T^T U_e D^-T b_u first)
 *     2. solution of the reduced equations
 *     3. eliminated coordinates q_e = D^-1 (b_u - U_e^T T x - C_e p)
 *        (transposed: D^-T (b_u + U_e^T x - R_e^T p)). */
static void eliminate(bd_condensation *c, int transposed, double *b) {
    const size_t n = (size_t)c->hbm->n_unknown, m = (size_t)c->n_motion;
    const size_t n_kept = (size_t)c->n_kept, k = (size_t)c->n_border;
    const double before = transposed ? 1.0 / c->amplitude : c->amplitude;
    const double *columns = transposed ? c->row : c->column;
    const double *rows = transposed ? c->column : c->row;
    double *z = c->reduced, *z_kept = z + m, *z_border = z_kept + n_kept;

    /* right-hand side of the reduced equations */
    scale_vibration(c, before, b);
    memcpy(c->q, b, sizeof(double) * n);
    divide(c, transposed, c->q);
    to_motion(c, c->q, z);
    if (transposed) {
        memcpy(c->force, z, sizeof(double) * m);
        to_force(c, 1, c->force, z);
        for (size_t i = 0; i < m; ++i) z[i] = -z[i];
    }
    for (size_t i = 0; i < n_kept; ++i) z_kept[i] = b[c->kept[i]];
    for (size_t i = 0; i < k; ++i) z_border[i] = b[n + i] - dot(rows + i * n, c->q, n);

    solve_reduced(c, transposed);

    /* eliminated coordinates */
    if (transposed) {
        add_modal_force(c, 1.0, z, b);
    } else {
        to_force(c, 0, z, c->force);
        add_modal_force(c, -1.0, c->force, b);
    }
    for (size_t i = 0; i < k; ++i)
        for (size_t j = 0; j < n; ++j) b[j] -= columns[i * n + j] * z_border[i];
    divide(c, transposed, b);
    for (size_t i = 0; i < n_kept; ++i) b[c->kept[i]] = z_kept[i];
    for (size_t i = 0; i < k; ++i) b[n + i] = z_border[i];
    scale_vibration(c, 1.0 / before, b);
}

/* residual = right - B x or right - B^T x, with the bordered matrix B = [J C; row/scale] (n + 1, n
 * + 1) in unscaled unknowns. */
static void find_residual(bd_condensation *c, int transposed, const double *x) {
    const bd_equations *e = &c->dense->base;
    const size_t n = (size_t)e->n;
    double *residual = c->residual;
    bd_condensation_product(c, transposed, x, c->product);
    double last = 0.0;
    for (size_t i = 0; i < n; ++i) {
        const double row = c->border_row[i] / c->border_scale[i];
        residual[i] = c->right[i] - c->product[i] - (transposed ? row : e->C[i]) * x[n];
        last += (transposed ? e->C[i] : row) * x[i];
    }
    residual[n] = c->right[n] - last - c->border_row[n] / c->border_scale[n] * x[n];
}

/* Largest entry of x/scale, or of x in the transposed equations, whose unknowns are multipliers of
 * the scaled residuals. */
static double largest(const bd_condensation *c, int transposed, const double *x) {
    double most = 0.0;
    for (size_t i = 0; i <= (size_t)c->dense->base.n; ++i) {
        const double size = fabs(transposed ? x[i] : x[i] / c->border_scale[i]);
        most = size > most || isnan(size) ? size : most;
    }
    return most;
}

/* Solve B x = b or B^T x = b in place, with one refinement x += B^-1 (b - B x). Return 0 if it
 * changes the solution too much. */
static int solve_refined(bd_condensation *c, int transposed, double *x) {
    const size_t n_all = (size_t)c->dense->base.n + 1;
    memcpy(c->right, x, sizeof(double) * n_all);
    eliminate(c, transposed, x);
    find_residual(c, transposed, x);
    eliminate(c, transposed, c->residual);
    const double correction = largest(c, transposed, c->residual);
    for (size_t i = 0; i < n_all; ++i) x[i] += c->residual[i];
    return correction <= LARGEST_CORRECTION * largest(c, transposed, x);
}

/* Replace b (n + 1) by the solution of B x = b or B^T x = b with the bordered matrix B. Its columns
 * belong to scaled unknowns: the solution is divided by border_scale, and for B^T the right-hand
 * side. If refinement changes the solution too much, dense factors replace the reduced ones. */
bd_status bd_condensation_solve(bd_condensation *c, int transposed, double *b) {
    bd_equations *e = &c->dense->base;
    const size_t n_all = (size_t)e->n + 1;
    if (!c->uses_dense) {
        /* the bordered matrix has scaled unknowns */
        double *x = c->given;
        memcpy(x, b, sizeof(double) * n_all);
        for (size_t i = 0; transposed && i < n_all; ++i) x[i] /= c->border_scale[i];
        if (solve_refined(c, transposed, x)) {
            for (size_t i = 0; !transposed && i < n_all; ++i) x[i] /= c->border_scale[i];
            memcpy(b, x, sizeof(double) * n_all);
            return BD_OK;
        }
        const bd_status status = use_dense(c);
        if (status != BD_OK) return status;
    }
    return transposed ? bd_dense_solve_transposed(e, b) : bd_dense_solve(e, 0.0, b);
}

/* ---- creation ---- */

/* Whether a mode moves a component of a contact point. */
static int is_moved(const bd_hbm *hbm, size_t component) {
    for (int l = 0; l <= hbm->n_harm; ++l) {
        const size_t size = n_row(l) * n_column(hbm, l);
        const double *g = hbm->G[l] + component * size;
        for (size_t j = 0; j < size; ++j)
            if (g[j] != 0.0) return 1;
    }
    return 0;
}

static int count_moved(const bd_hbm *hbm) {
    int n = 0;
    for (size_t i = 0; i < 3 * (size_t)hbm->n_point; ++i) n += is_moved(hbm, i);
    return n;
}

int bd_condensation_pays(const bd_hbm *hbm) {
    /* a small system has its costs elsewhere, and a matrix of half the size a third of the work */
    enum { FEWEST_UNKNOWNS = 40 };
    const int n_motion = count_moved(hbm) * hbm->n_coef;
    return hbm->n_unknown >= FEWEST_UNKNOWNS && 2 * n_motion < hbm->n_unknown;
}

static size_t count_modes(const bd_hbm *hbm) {
    size_t n = 0;
    for (int l = 0; l <= hbm->n_harm; ++l) n += (size_t)hbm->n_mode[l];
    return n;
}

static bd_status memory_create(bd_condensation *c) {
    const size_t n = (size_t)c->hbm->n_unknown, m = (size_t)c->n_motion;
    const size_t k = (size_t)c->n_border, n_extra = (size_t)c->n_extra, n_all = n + k;
    const size_t size = m + (size_t)c->most_kept + k, n_modes = count_modes(c->hbm);
    const size_t n_point = (size_t)c->hbm->n_point, n_component = (size_t)c->parts.n_component;
    /* the arrays below, in the same order */
    const size_t parts = 2 * n_modes + m * m;
    const size_t columns_and_rows = 2 * n_extra * n + 2 * k * n, corner = k * k;
    const size_t vectors = 7 * n_all;
    const size_t reduced_matrices = 2 * size * size, reduced_vectors = 3 * size;
    const size_t condition_work = 4 * size, force = m;
    /* and n numbers to spare */
    const size_t total = parts + columns_and_rows + corner + vectors + reduced_matrices +
                         reduced_vectors + condition_work + force + n;
    c->memory = calloc(total, sizeof(double));
    c->kept = malloc(sizeof(int) * ((size_t)c->most_kept + 2 * size));
    /* one more entry than needed: an allocation of 0 bytes may return NULL */
    c->is_kept = malloc(n + 1);
    c->parts.component = malloc(sizeof(int) * (n_component + 3 * n_point + 1));
    if (!c->memory || !c->kept || !c->is_kept || !c->parts.component) return BD_NO_MEMORY;
    c->pivot = c->kept + c->most_kept;
    c->condition_iwork = c->pivot + size;
    c->parts.place = c->parts.component + n_component;
    double *rest = c->memory;
    c->parts.dynamic = bd_take(&rest, n_modes);
    c->parts.loss = bd_take(&rest, n_modes);
    c->parts.tangent = bd_take(&rest, m * m);
    c->extra_column = bd_take(&rest, n_extra * n);
    c->extra_row = bd_take(&rest, n_extra * n);
    c->column = bd_take(&rest, k * n);
    c->row = bd_take(&rest, k * n);
    c->corner = bd_take(&rest, k * k);
    c->border_row = bd_take(&rest, n_all);
    c->border_scale = bd_take(&rest, n_all);
    c->given = bd_take(&rest, n_all);
    c->residual = bd_take(&rest, n_all);
    c->right = bd_take(&rest, n_all);
    c->product = bd_take(&rest, n_all);
    c->q = bd_take(&rest, n_all);
    c->A = bd_take(&rest, size * size);
    c->LU = bd_take(&rest, size * size);
    c->column_scale = bd_take(&rest, size);
    c->row_scale = bd_take(&rest, size);
    c->reduced = bd_take(&rest, size);
    c->condition_work = bd_take(&rest, 4 * size);
    c->force = bd_take(&rest, m);
    return BD_OK;
}

bd_status bd_condensation_create(bd_condensation **out, bd_dense *dense, const bd_hbm *hbm,
                                 int n_extra) {
    *out = NULL;
    bd_condensation *c = calloc(1, sizeof *c);
    if (!c) return BD_NO_MEMORY;
    c->dense = dense;
    c->hbm = hbm;
    c->n_extra = n_extra;
    c->n_border = n_extra + 1;
    c->amplitude = 1.0;
    c->parts.n_component = count_moved(hbm);
    c->n_motion = c->parts.n_component * hbm->n_coef;
    /* with more kept coordinates the dense factors cost little more */
    c->most_kept = hbm->n_unknown / 4 + 2;
    const bd_status status = memory_create(c);
    if (status != BD_OK) {
        bd_condensation_destroy(c);
        return status;
    }
    int n = 0;
    for (int i = 0; i < 3 * hbm->n_point; ++i) {
        const int moved = is_moved(hbm, (size_t)i);
        c->parts.place[i] = moved ? n : -1;
        if (moved) c->parts.component[n] = i;
        n += moved;
    }
    c->dense_J = dense->base.J;
    dense->base.J = NULL;
    *out = c;
    return BD_OK;
}

void bd_condensation_destroy(bd_condensation *c) {
    if (!c) return;
    free(c->memory);
    free(c->kept);
    free(c->is_kept);
    free(c->parts.component);
    free(c);
}
