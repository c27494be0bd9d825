/* Time integration: preparation, and transfer of the state. The time steps are
 * in generalised_alpha.c. */
#include "time/integration.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static size_t padded(size_t n) { return (n + 7) / 8 * 8; }

/* Sizes, and the integers that describe the families. */
static void set_sizes(bd_time *t, const bd_time_input *in) {
    const size_t f = (size_t)in->n_family;
    t->n_sector = in->n_sector, t->n_point = in->n_point, t->n_family = in->n_family,
    t->n_force = in->n_force;
    t->n_row = in->n_row;
    t->stride = padded((size_t)in->n_point), t->rows = 3 * t->stride;
    t->max_rank = t->rows < BD_TIME_MAX_RANK ? (int)t->rows : BD_TIME_MAX_RANK;
    t->n_mode = t->integers, t->first_coordinate = t->n_mode + f,
    t->is_real = t->first_coordinate + f;
    t->force_order = t->is_real + f, t->outdated = t->force_order + in->n_force,
    t->real_index = t->outdated + in->n_sector;
    for (size_t i = 0; i < f; ++i) t->n_total += in->n_mode[i];
    t->imaginary_index = t->real_index + t->n_total;
    int total = 0;
    for (int i = 0; i < in->n_family; ++i) {
        t->n_mode[i] = in->n_mode[i];
        t->is_real[i] = 2 * in->diameter[i] % in->n_sector == 0;
        t->first_coordinate[i] = (int)t->n_coordinate;
        for (int j = 0; j < in->n_mode[i]; ++j, ++total) {
            t->real_index[total] = t->first_coordinate[i] + j;
            t->imaginary_index[total] = t->real_index[total] + (int)padded((size_t)in->n_mode[i]);
        }
        t->n_coordinate += 2 * padded((size_t)in->n_mode[i]);
    }
    if (in->n_force > 0) memcpy(t->force_order, in->force_order, sizeof(int) * (size_t)in->n_force);
}

/* Assign the arrays of doubles to the memory, or count their size before allocation. */
static size_t assign_arrays(bd_time *t) {
    const size_t n = t->n_coordinate, s = t->stride, f = (size_t)t->n_family,
                 k = (size_t)t->n_sector;
    const size_t rows = t->rows, r = (size_t)t->max_rank, making = rows * (rows + r + 4) + 2 * r;
    size_t used = 0, modes = 0;
    for (int i = 0; i < t->n_family; ++i) modes += padded((size_t)t->n_mode[i]);
    const struct {
        double **array;
        size_t size;
    } part[] = {{&t->motion_modes, 2 * rows * modes},
                {&t->force_modes, 2 * rows * modes},
                {&t->phase, 2 * f * k},
                {&t->stiffness, n},
                {&t->mass, n},
                {&t->damping, n},
                {&t->fourier_weight, n},
                {&t->excitation, 2 * n * (size_t)t->n_force},
                {&t->response_row, n * (size_t)t->n_row},
                {&t->parameters, BD_TIME_FIELDS * s},
                {&t->q, n},
                {&t->v, n},
                {&t->a, n},
                {&t->contact_force, n},
                {&t->last_contact_force, n},
                {&t->load, n},
                {&t->next_load, n},
                {&t->q_next, n},
                {&t->a_next, n},
                {&t->displacement_compliance, n},
                {&t->acceleration_compliance, n},
                {&t->slider, 2 * s * k},
                {&t->next_slider, 2 * s * k},
                {&t->law_memory[0], k * (size_t)(t->n_point * t->n_memory)},
                {&t->law_memory[1], k * (size_t)(t->n_point * t->n_memory)},
                {&t->derivatives, bd_point_law_work_size(t->n_memory)},
                {&t->motion, rows * k},
                {&t->free_motion, rows * k},
                {&t->correction_motion, rows * k},
                {&t->point_force, rows * k},
                {&t->predicted_force, rows * k},
                {&t->tangent, 9 * s * k},
                {&t->contact_state, s * k},
                {&t->motion_amplitude, 2 * rows * f},
                {&t->force_amplitude, 2 * rows * f},
                {&t->preconditioner, r * r * k},
                {&t->pattern_force, r * k},
                {&t->residual, r * k},
                {&t->pattern_correction, r * k},
                {&t->pattern_motion, r * k},
                {&t->krylov, (BD_TIME_VECTORS + 1) * r * k},
                {&t->krylov_motion, BD_TIME_VECTORS * r * k},
                {&t->patterns[0].pattern, r * rows},
                {&t->patterns[0].pattern_transposed, r * rows},
                {&t->patterns[0].compliance, 2 * r * r * f},
                {&t->patterns[1].pattern, r * rows},
                {&t->patterns[1].pattern_transposed, r * rows},
                {&t->patterns[1].compliance, 2 * r * r * f},
                {&t->work, making > 3 * (size_t)t->n_total ? making : 3 * (size_t)t->n_total}};
    for (size_t i = 0; i < sizeof part / sizeof *part; ++i) {
        if (t->memory) *part[i].array = t->memory + used;
        used += padded(part[i].size);
    }
    return used;
}

/* Copy coordinates x (2, n_total) into padded coordinates. */
static void pad(const bd_time *t, const double *x, double *padded_x) {
    for (int j = 0; j < t->n_total; ++j) {
        padded_x[t->real_index[j]] = x[j];
        padded_x[t->imaginary_index[j]] = x[t->n_total + j];
    }
}

void bd_time_unpad(const bd_time *t, const double *padded_x, double *x) {
    for (int j = 0; j < t->n_total; ++j) {
        x[j] = padded_x[t->real_index[j]];
        x[t->n_total + j] = padded_x[t->imaginary_index[j]];
    }
}

static void set_modes(bd_time *t, const bd_time_input *in) {
    const double *G = in->G;
    double *out = t->motion_modes, *back = t->force_modes;
    for (int f = 0; f < t->n_family; ++f) {
        const size_t m = (size_t)t->n_mode[f], wide = padded(m);
        for (size_t p = 0; p < (size_t)t->n_point; ++p)
            for (size_t d = 0; d < 3; ++d)
                for (size_t j = 0; j < m; ++j) {
                    const double *g = G + 2 * ((p * 3 + d) * m + j);
                    const size_t row = d * t->stride + p, to = j;
                    const size_t at = (row / 8 * wide + to) * 16 + row % 8;
                    const size_t at_back = (to / 8 * 3 * t->stride + row) * 16 + to % 8;
                    out[at] = back[at_back] = g[0];
                    out[at + 8] = back[at_back + 8] = t->is_real[f] ? 0.0 : g[1];
                }
        G += 6 * (size_t)t->n_point * m;
        out += 2 * t->rows * wide;
        back += 2 * t->rows * wide;
        for (int k = 0; k < t->n_sector; ++k) {
            const double angle =
                BD_TWO_PI * (double)((long long)k * in->diameter[f] % t->n_sector) / t->n_sector;
            double *phase = t->phase + 2 * ((size_t)k * (size_t)t->n_family + (size_t)f);
            phase[0] = cos(angle), phase[1] = sin(angle);
        }
    }
}

static void set_coordinates(bd_time *t, const bd_time_input *in) {
    const size_t n = (size_t)t->n_total;
    double *both = t->work;
    const double *values[] = {in->stiffness, in->mass, in->damping};
    double *stored[] = {t->stiffness, t->mass, t->damping};
    for (size_t j = 0; j < t->n_coordinate; ++j) t->stiffness[j] = 1.0; /* value of the padding */
    for (size_t i = 0; i < 3; ++i) {
        for (size_t j = 0; j < 2 * n; ++j) both[j] = values[i][j % n];
        pad(t, both, stored[i]);
    }
    for (int f = 0, j = 0; f < t->n_family; ++f)
        for (const int end = j + t->n_mode[f]; j < end; ++j) {
            both[j] = (t->is_real[f] ? 1.0 : 2.0) / t->n_sector;
            both[n + (size_t)j] = t->is_real[f] ? 0.0 : both[j];
        }
    pad(t, both, t->fourier_weight);
    for (size_t i = 0; i < 2 * (size_t)t->n_force; ++i)
        pad(t, in->excitation + 2 * n * i, t->excitation + t->n_coordinate * i);
    for (size_t i = 0; i < (size_t)in->n_row; ++i)
        pad(t, in->response_row + 2 * n * i, t->response_row + t->n_coordinate * i);
}

/* ---- compliance of a step ---- */

bd_time_alpha bd_time_weights(double radius) {
    bd_time_alpha out = {.am = (2.0 * radius - 1.0) / (radius + 1.0),
                         .af = radius / (radius + 1.0)};
    out.gamma = 0.5 - out.am + out.af;
    out.b = 0.25 * (1.0 - out.am + out.af) * (1.0 - out.am + out.af);
    return out;
}

void bd_time_compliance(const bd_time *t, double h, double radius, double *beta,
                        double *acceleration) {
    const bd_time_alpha w = bd_time_weights(radius);
    for (size_t j = 0; j < t->n_coordinate; ++j) {
        const double m = t->mass[j], c = t->damping[j], K = t->stiffness[j];
        const double inertia =
            m * (1.0 - w.am) + (1.0 - w.af) * (c * w.gamma * h + K * w.b * h * h);
        acceleration[j] = m > 0.0 ? (1.0 - w.af) / inertia : 0.0;
        beta[j] = m > 0.0 ? w.b * h * h * acceleration[j] : 1.0 / K;
    }
}

/* Amplitudes g (2, rows) of the points due to coordinate j of a family,
 * times a factor of each row. */
static void mode_of(const bd_time *t, const double *out, size_t wide, size_t j,
                    const double *factor, double *g) {
    for (size_t row = 0; row < t->rows; ++row) {
        const double *x = out + (row / 8 * wide + j) * 16 + row % 8;
        g[row] = factor[row] * x[0];
        g[t->rows + row] = factor[row] * x[8];
    }
}

/* Compliance S (rows, rows) of a sector to its own forces: the mean over the nodal diameters. */
static void add_sector_compliance(const bd_time *t, const double *beta, const double *factor,
                                  double *g, double *S) {
    const size_t rows = t->rows;
    const double *out = t->motion_modes;
    for (int f = 0; f < t->n_family; ++f) {
        const size_t m = (size_t)t->n_mode[f], wide = padded(m);
        for (size_t j = 0; j < m; ++j) {
            const double size = t->fourier_weight[(size_t)t->first_coordinate[f] + j] *
                                beta[(size_t)t->first_coordinate[f] + j];
            if (size == 0.0) continue;
            mode_of(t, out, wide, j, factor, g);
            for (size_t i = 0; i < rows; ++i) {
                const double re = size * g[i], im = size * g[rows + i];
                if (re == 0.0 && im == 0.0) continue;
                double *restrict to = S + i * rows;
                const double *restrict a = g, *restrict b = g + rows;
                for (size_t l = 0; l <= i; ++l) to[l] += re * a[l] + im * b[l];
            }
        }
        out += 2 * rows * wide;
    }
}

/* Columns (n, rows) of a low-rank factor, S = L' L, up to a bound on the remaining diagonal; return
 * their number. */
static size_t low_rank(size_t rows, size_t most, double bound, double *S, double *L) {
    size_t n = 0;
    for (; n < most; ++n) {
        size_t top = 0;
        for (size_t i = 1; i < rows; ++i)
            if (S[i * rows + i] > S[top * rows + top]) top = i;
        const double left = S[top * rows + top];
        if (!(left > (n < BD_TIME_MIN_RANK ? 1e-14 : bound))) break;
        double *column = L + n * rows;
        const double root = sqrt(left);
        for (size_t i = 0; i < rows; ++i)
            column[i] = (i >= top ? S[i * rows + top] : S[top * rows + i]) / root;
        for (size_t i = 0; i < rows; ++i)
            for (size_t l = 0; l <= i; ++l) S[i * rows + l] -= column[i] * column[l];
    }
    return n;
}

static double inner(size_t n, const double *a, const double *b) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += a[i] * b[i];
    return sum;
}

/* Make n columns orthogonal (one-sided Jacobi method), the largest first. */
static void make_orthogonal(size_t rows, size_t n, double *L) {
    enum { SWEEPS = 30 };
    double worst = 1.0;
    for (int sweep = 0; sweep < SWEEPS && worst > 1e-12; ++sweep) {
        worst = 0.0;
        for (size_t i = 0; i + 1 < n; ++i)
            for (size_t j = i + 1; j < n; ++j) {
                double *restrict a = L + i * rows, *restrict b = L + j * rows;
                const double aa = inner(rows, a, a), bb = inner(rows, b, b), ab = inner(rows, a, b);
                const double size = sqrt(aa * bb);
                if (!(fabs(ab) > 1e-13 * size) && aa >= bb) continue;
                worst = fmax(worst, size > 0.0 ? fabs(ab) / size : 0.0);
                const double angle = 0.5 * atan2(2.0 * ab, aa - bb), c = cos(angle), s = sin(angle);
                for (size_t l = 0; l < rows; ++l) {
                    const double x = a[l], y = b[l];
                    a[l] = c * x + s * y;
                    b[l] = c * y - s * x;
                }
            }
    }
}

/* Add one coordinate to the compliance of the patterns of its family. Storage: blocks of 8 rows,
 * column after column, first the real and then the imaginary parts of 8 rows. */
static void add_mode(size_t r, double size, const double *W, double *C) {
    const double *re = W, *im = W + r;
    for (size_t block = 0; block < r; block += 8, re += 8, im += 8)
        for (size_t j = 0; j < r; ++j, C += 16) {
            const double x = size * W[j], y = size * W[r + j];
            for (size_t i = 0; i < 8; ++i) {
                C[i] += re[i] * x + im[i] * y;
                C[8 + i] += im[i] * x - re[i] * y;
            }
        }
}

/* Scale of each row of a point: the root of its stiffness, or of its inverse
 * compliance for cubic springs. */
static void set_row_scales(const bd_time *t, const double *S, double *factor) {
    const size_t s = t->stride;
    for (size_t row = 0; row < t->rows; ++row) {
        const size_t d = row / s, p = row % s;
        const double k =
            d < 2 ? t->parameters[(BD_TIME_KT + d) * s + p] : t->parameters[BD_TIME_KN * s + p];
        const double cubic = d < 2 ? t->parameters[(BD_TIME_CUBIC + d) * s + p] : 0.0,
                     point_law = S[row * t->rows + row];
        factor[row] =
            cubic != 0.0 ? (point_law > 0.0 ? 1.0 / sqrt(point_law) : 0.0) : sqrt(fabs(k));
    }
}

void bd_time_make_patterns(bd_time *t, bd_time_patterns *patterns, double h, double radius) {
    const size_t rows = t->rows, most = (size_t)t->max_rank;
    if (patterns->spectral_radius == radius && patterns->length == h && patterns->rank >= 0) return;
    patterns->length = h, patterns->spectral_radius = radius, patterns->rank = 0,
    patterns->neglected = 0.0;
    if (!rows) return;
    double *S = t->work, *L = S + rows * rows, *g = L + rows * most, *factor = g + 2 * rows,
           *W = factor + rows;
    double *beta = t->q_next; /* unused before the first step */
    bd_time_compliance(t, h, radius, beta, t->a_next);
    /* first without factors, which cubic springs require */
    for (int again = 0; again < 2; ++again) {
        if (again)
            set_row_scales(t, S, factor);
        else
            for (size_t i = 0; i < rows; ++i) factor[i] = 1.0;
        memset(S, 0, sizeof(double) * rows * rows);
        add_sector_compliance(t, beta, factor, g, S);
    }
    const size_t found = low_rank(rows, most, 1e-2 * BD_TIME_RANK_TOLERANCE, S, L);
    make_orthogonal(rows, found, L);
    size_t n = 0;
    while (n < found && (n < BD_TIME_MIN_RANK ||
                         inner(rows, L + n * rows, L + n * rows) > BD_TIME_RANK_TOLERANCE))
        ++n;
    if (n < found) patterns->neglected = inner(rows, L + n * rows, L + n * rows);
    n = padded(n) < found ? padded(n) : n;
    const size_t r = padded(n);
    patterns->rank = (int)r;
    memset(patterns->pattern, 0, sizeof(double) * r * rows);
    memset(patterns->pattern_transposed, 0, sizeof(double) * r * rows);
    memset(patterns->compliance, 0, sizeof(double) * 2 * r * r * (size_t)t->n_family);
    for (size_t j = 0; j < n; ++j)
        for (size_t i = 0; i < rows; ++i)
            patterns->pattern[j * rows + i] = patterns->pattern_transposed[i * r + j] =
                factor[i] > 0.0 ? L[j * rows + i] / factor[i] : 0.0;
    for (size_t j = 0; j < n; ++j) { /* the inverse for the amplitudes of the patterns */
        const double size = inner(rows, L + j * rows, L + j * rows);
        for (size_t i = 0; i < rows; ++i) L[j * rows + i] /= size;
    }
    const double *out = t->motion_modes;
    for (int f = 0; f < t->n_family; ++f) {
        const size_t m = (size_t)t->n_mode[f], wide = padded(m);
        for (size_t j = 0; j < m; ++j) {
            const size_t at = (size_t)t->first_coordinate[f] + j;
            mode_of(t, out, wide, j, factor, g);
            memset(W, 0, sizeof(double) * 2 * r);
            for (size_t i = 0; i < n; ++i) {
                W[i] = inner(rows, L + i * rows, g);
                W[r + i] = inner(rows, L + i * rows, g + rows);
            }
            add_mode(r, t->fourier_weight[at] * beta[at], W,
                     patterns->compliance + 2 * r * r * (size_t)f);
        }
        out += 2 * rows * wide;
    }
}

static void set_points(bd_time *t, const bd_time_input *in) {
    const size_t s = t->stride;
    for (size_t p = 0; p < (size_t)t->n_point; ++p) {
        const bd_law law = (bd_law)in->law[p];
        double *x = t->parameters + p;
        for (size_t d = 0; d < 2; ++d) {
            const double kt = in->kt[2 * p + d];
            x[(BD_TIME_KT + d) * s] = law == BD_LAW_CUBIC ? 0.0 : kt;
            x[(BD_TIME_CUBIC + d) * s] = law == BD_LAW_CUBIC ? kt : 0.0;
            x[(BD_TIME_INVERSE_KT + d) * s] = law != BD_LAW_CUBIC && kt > 0.0 ? 1.0 / kt : 0.0;
            x[(BD_TIME_FIXED_SLIDER + d) * s] = law == BD_LAW_BONDED || in->fixed_slider[2 * p + d];
        }
        for (size_t d = 0; d < 3; ++d) x[(BD_TIME_SHIFT + d) * s] = in->shift[3 * p + d];
        x[BD_TIME_KN * s] = law == BD_LAW_CUBIC ? 0.0 : in->kn[p];
        x[BD_TIME_N0 * s] = law == BD_LAW_CUBIC ? 0.0 : in->n0[p];
        x[BD_TIME_LEAST_N * s] = bd_law_is_two_sided(law) ? -HUGE_VAL : 0.0;
        const double mu = law == BD_LAW_NORMAL ? 0.0 : in->mu[p];
        x[BD_TIME_LIMIT * s] = bd_law_is_constant(law) ? mu * fmax(in->load[p], 0.0) : 0.0;
        x[BD_TIME_MU * s] = bd_law_is_constant(law) ? 0.0 : mu;
        x[BD_TIME_COUPLED * s] = bd_law_is_coupled(law);
        x[BD_TIME_USER_LAW * s] = law == BD_LAW_USER;
        t->has_coupled |= bd_law_is_coupled(law);
        t->has_cubic |= law == BD_LAW_CUBIC;
    }
}

static void set_laws(bd_time *t) {
    for (int p = 0; p < t->n_point; ++p) {
        if (!t->point_law[p].function) continue;
        ++t->n_user_law;
        if (3 + t->point_law[p].n_state > t->n_memory) t->n_memory = 3 + t->point_law[p].n_state;
    }
}

bd_status bd_time_create(bd_time *t, const bd_time_input *in) {
    memset(t, 0, sizeof *t);
    if (!(t->kernel = bd_kernel_get())) return BD_BAD_ARGUMENT;
    size_t n = 3 * (size_t)in->n_family + (size_t)in->n_force + (size_t)in->n_sector + 1;
    for (int f = 0; f < in->n_family; ++f) n += 2 * (size_t)in->n_mode[f];
    if (!(t->integers = calloc(n, sizeof(int)))) return BD_NO_MEMORY;
    set_sizes(t, in);
    if (!(t->point_law = bd_point_laws_create(in->n_point, in->point_law))) {
        bd_time_destroy(t);
        return BD_NO_MEMORY;
    }
    set_laws(t);
    if (!(t->memory = calloc(assign_arrays(t), sizeof(double)))) {
        bd_time_destroy(t);
        return BD_NO_MEMORY;
    }
    assign_arrays(t);
    set_modes(t, in);
    set_points(t, in);
    set_coordinates(t, in);
    t->patterns[0].rank = t->patterns[1].rank = -1;
    return BD_OK;
}

void bd_time_destroy(bd_time *t) {
    free(t->memory);
    free(t->integers);
    free(t->point_law);
    memset(t, 0, sizeof *t);
}

/* Copy sliders and memories (n_sector, n_point, 2 + n_memory) into the storage of the time steps,
 * or back. */
static void copy_sliders(bd_time *t, double *w, int out) {
    const size_t m = (size_t)t->n_memory;
    for (size_t k = 0; k < (size_t)t->n_sector; ++k)
        for (size_t p = 0; p < (size_t)t->n_point; ++p)
            for (size_t d = 0; d < 2 + m; ++d) {
                const size_t at = k * (size_t)t->n_point + p;
                double *inside = d < 2 ? t->slider + (2 * k + d) * t->stride + p
                                       : t->law_memory[0] + at * m + d - 2;
                double *outside = w + (2 + m) * at + d;
                if (out)
                    *outside = *inside;
                else
                    *inside = *outside;
            }
}

void bd_time_reset_states(bd_time *t) {
    const size_t n = (size_t)t->n_sector * t->stride;
    for (size_t i = 0; i < n; ++i) t->contact_state[i] = -1.0; /* no valid state */
    memset(t->tangent, 0, sizeof(double) * 9 * n);
}

/* Clear all data that an earlier integration has left, including the padding. */
static void reset(bd_time *t) {
    const size_t k = (size_t)t->n_sector, s = t->stride, size = sizeof(double);
    double *coordinates[] = {t->q, t->v, t->a, t->contact_force, t->q_next, t->a_next, t->load};
    for (size_t i = 0; i < sizeof coordinates / sizeof *coordinates; ++i)
        memset(coordinates[i], 0, size * t->n_coordinate);
    memset(t->slider, 0, size * 2 * s * k);
    memset(t->next_slider, 0, size * 2 * s * k);
    bd_time_reset_states(t);
    memset(t->pattern_force, 0, size * (size_t)t->max_rank * k);
    t->largest_force = 0.0;
}

bd_status bd_time_integrate(bd_time *t, const bd_time_path *path, double *q, double *v, double *a,
                            double *w, bd_time_effort *effort) {
    reset(t);
    pad(t, q, t->q);
    pad(t, v, t->v);
    pad(t, a, t->a);
    copy_sliders(t, w, 0);
    t->effort = *effort;
    bd_status status = t->kernel->integrate(t, path);
    for (size_t j = 0; j < t->n_coordinate; ++j)
        if (!isfinite(t->q[j]) || !isfinite(t->v[j])) status = BD_NOT_FINITE;
    *effort = t->effort;
    bd_time_unpad(t, t->q, q);
    bd_time_unpad(t, t->v, v);
    bd_time_unpad(t, t->a, a);
    copy_sliders(t, w, 1);
    return status;
}

void bd_time_update_sliders(bd_time *t, long n_step, const double *q, double *w) {
    reset(t);
    copy_sliders(t, w, 0);
    for (long k = 0; k < n_step; ++k) {
        pad(t, q + 2 * (size_t)t->n_total * (size_t)k, t->q);
        t->kernel->contact_at_instant(t);
    }
    copy_sliders(t, w, 1);
}
