/* Time integration: preparation, and transfer of the state. The time steps are
 * in generalised_alpha.c. */
#include "time/integration.h"

#include "util/storage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* n rounded up to a multiple of 8, the block of numbers that the vector kernels use. */
static size_t padded(size_t n) { return (n + 7) / 8 * 8; }

/* Sizes of the sectors, points and families. */
static void set_sizes(bd_time *t, const bd_time_input *in) {
    t->n_sector = in->n_sector;
    t->n_point = in->n_point;
    t->n_family = in->n_family;
    t->n_force = in->n_force;
    t->n_row = in->n_row;
    t->stride = padded((size_t)in->n_point);
    t->rows = 3 * t->stride;
    t->max_rank = t->rows < BD_TIME_MAX_RANK ? (int)t->rows : BD_TIME_MAX_RANK;
    for (int f = 0; f < in->n_family; ++f) {
        t->n_total += in->n_mode[f];
        t->n_coordinate += 2 * padded((size_t)in->n_mode[f]);
    }
}

/* Cut the integers from their memory. */
static void assign_integers(bd_time *t) {
    int *rest = t->integers;
    t->n_mode = rest;
    rest += t->n_family;
    t->first_coordinate = rest;
    rest += t->n_family;
    t->is_real = rest;
    rest += t->n_family;
    t->force_order = rest;
    rest += t->n_force;
    t->outdated = rest;
    rest += t->n_sector;
    t->real_index = rest;
    rest += t->n_total;
    t->imaginary_index = rest;
}

/* Modes of each family and the places of their coordinates. */
static void set_families(bd_time *t, const bd_time_input *in) {
    int first = 0; /* coordinate of the family, with padding */
    int total = 0; /* coordinate without padding */
    for (int f = 0; f < in->n_family; ++f) {
        const int n_mode = in->n_mode[f], n_padded = (int)padded((size_t)n_mode);
        t->n_mode[f] = n_mode;
        t->is_real[f] = 2 * in->diameter[f] % in->n_sector == 0;
        t->first_coordinate[f] = first;
        for (int j = 0; j < n_mode; ++j, ++total) {
            t->real_index[total] = first + j;
            t->imaginary_index[total] = first + j + n_padded;
        }
        first += 2 * n_padded;
    }
    if (in->n_force > 0) memcpy(t->force_order, in->force_order, sizeof(int) * (size_t)in->n_force);
}

/* Assign the arrays of patterns to the memory from `first` on, if there is memory already; return
 * their size. */
static size_t assign_patterns(const bd_time *t, size_t first, bd_time_patterns *patterns) {
    const size_t r = (size_t)t->max_rank;
    const size_t of_pattern = padded(r * t->rows);
    const size_t of_compliance = padded(2 * r * r * (size_t)t->n_family);
    if (t->memory) {
        patterns->pattern = t->memory + first;
        patterns->pattern_transposed = patterns->pattern + of_pattern;
        patterns->compliance = patterns->pattern_transposed + of_pattern;
    }
    return 2 * of_pattern + of_compliance;
}

/* Assign the arrays of doubles to the memory, or count their size before allocation. */
static size_t assign_arrays(bd_time *t) {
    const size_t n = t->n_coordinate, stride = t->stride, rows = t->rows;
    const size_t n_family = (size_t)t->n_family, n_sector = (size_t)t->n_sector;
    const size_t n_memory = n_sector * (size_t)(t->n_point * t->n_memory);
    const size_t r = (size_t)t->max_rank, pattern_forces = r * n_sector;
    size_t n_mode = 0; /* of all families, padded */
    for (int i = 0; i < t->n_family; ++i) n_mode += padded((size_t)t->n_mode[i]);
    /* work for the patterns, or for three coordinates of all families */
    const size_t for_patterns = rows * (rows + r + 4) + 2 * r;
    const size_t for_coordinates = 3 * (size_t)t->n_total;
    const size_t work = for_patterns > for_coordinates ? for_patterns : for_coordinates;
    const struct {
        double **array;
        size_t size;
    } part[] = {
        {&t->motion_modes, 2 * rows * n_mode},
        {&t->force_modes, 2 * rows * n_mode},
        {&t->phase, 2 * n_family * n_sector},
        {&t->stiffness, n},
        {&t->mass, n},
        {&t->damping, n},
        {&t->fourier_weight, n},
        {&t->excitation, 2 * n * (size_t)t->n_force},
        {&t->response_row, n * (size_t)t->n_row},
        {&t->parameters, BD_TIME_FIELDS * stride},
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
        {&t->slider, 2 * stride * n_sector},
        {&t->next_slider, 2 * stride * n_sector},
        {&t->law_memory[0], n_memory},
        {&t->law_memory[1], n_memory},
        {&t->derivatives, bd_point_law_work_size(t->n_memory)},
        {&t->motion, rows * n_sector},
        {&t->free_motion, rows * n_sector},
        {&t->correction_motion, rows * n_sector},
        {&t->point_force, rows * n_sector},
        {&t->predicted_force, rows * n_sector},
        {&t->tangent, 9 * stride * n_sector},
        {&t->contact_state, stride * n_sector},
        {&t->last_state, stride * n_sector},
        {&t->motion_amplitude, 2 * rows * n_family},
        {&t->force_amplitude, 2 * rows * n_family},
        {&t->preconditioner, r * pattern_forces},
        {&t->pattern_force, pattern_forces},
        {&t->residual, pattern_forces},
        {&t->pattern_correction, pattern_forces},
        {&t->pattern_motion, pattern_forces},
        {&t->krylov, (BD_TIME_VECTORS + 1) * pattern_forces},
        {&t->krylov_motion, BD_TIME_VECTORS * pattern_forces},
        {&t->work, work},
    };
    size_t used = 0;
    for (size_t i = 0; i < sizeof part / sizeof *part; ++i) {
        if (t->memory) *part[i].array = t->memory + used;
        used += padded(part[i].size);
    }
    used += assign_patterns(t, used, &t->of_instant);
    for (int i = 0; i < BD_TIME_LENGTHS_OF_STEP; ++i)
        used += assign_patterns(t, used, &t->of_step[i]);
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

/* Place of an entry of a complex matrix with n_column columns, in the storage order of
 * modal_motion.h: blocks of 8 rows, column after column, first the 8 real and then the 8 imaginary
 * parts. The imaginary part is 8 numbers behind the real part. */
static size_t place_in_blocks(size_t row, size_t column, size_t n_column) {
    const size_t block = row / 8, row_in_block = row % 8;
    return (block * n_column + column) * 16 + row_in_block;
}

/* Store the amplitude of a row (component of a point) in mode j for both products: the motion of
 * the points (rows, n_padded) and the modal forces (n_padded, rows) of a family. */
static void store_mode(const bd_time *t, size_t row, size_t j, size_t n_padded, double re,
                       double im, double *motion, double *force) {
    double *in_motion = motion + place_in_blocks(row, j, n_padded);
    double *in_force = force + place_in_blocks(j, row, t->rows);
    in_motion[0] = re;
    in_motion[8] = im;
    in_force[0] = re;
    in_force[8] = im;
}

/* Modes of the points for the products of modal_motion.h, from G: complex, family after family
 * (n_point, 3, n_mode). */
static void set_modes(bd_time *t, const bd_time_input *in) {
    const double *g = in->G;
    double *motion = t->motion_modes, *force = t->force_modes;
    for (int f = 0; f < t->n_family; ++f) {
        const size_t n_mode = (size_t)t->n_mode[f], n_padded = padded(n_mode);
        for (size_t p = 0; p < (size_t)t->n_point; ++p) {
            for (size_t d = 0; d < 3; ++d) {
                const size_t row = d * t->stride + p;
                for (size_t j = 0; j < n_mode; ++j, g += 2) {
                    const double imaginary = t->is_real[f] ? 0.0 : g[1];
                    store_mode(t, row, j, n_padded, g[0], imaginary, motion, force);
                }
            }
        }
        motion += 2 * t->rows * n_padded;
        force += 2 * t->rows * n_padded;
    }
}

/* cos and sin(2 pi k d/N) of each sector k and diameter d. */
static void set_phases(bd_time *t, const bd_time_input *in) {
    double *phase = t->phase;
    for (int k = 0; k < t->n_sector; ++k) {
        for (int f = 0; f < t->n_family; ++f, phase += 2) {
            /* an integer reduction of the argument makes it exact */
            const long long reduced = (long long)k * in->diameter[f] % t->n_sector;
            const double angle = BD_TWO_PI * (double)reduced / t->n_sector;
            phase[0] = cos(angle);
            phase[1] = sin(angle);
        }
    }
}

/* Weight of each coordinate in the sum over the sectors: 1/N for a standing wave, whose coordinates
 * are real, and 2/N for other waves, which also represent the opposite direction. */
static void set_fourier_weights(bd_time *t) {
    const size_t n = (size_t)t->n_total;
    double *re = t->work, *im = re + n;
    size_t j = 0;
    for (int f = 0; f < t->n_family; ++f) {
        const double weight = (t->is_real[f] ? 1.0 : 2.0) / t->n_sector;
        const size_t end = j + (size_t)t->n_mode[f];
        for (; j < end; ++j) {
            re[j] = weight;
            im[j] = t->is_real[f] ? 0.0 : weight;
        }
    }
    pad(t, t->work, t->fourier_weight);
}

/* Stiffness, mass and damping of the coordinates, excitation and response rows, with padding. */
static void set_coordinates(bd_time *t, const bd_time_input *in) {
    const size_t n = (size_t)t->n_total, n_force = (size_t)t->n_force, n_row = (size_t)in->n_row;
    double *both = t->work; /* (2, n): real and imaginary parts have the same values */
    const double *values[] = {in->stiffness, in->mass, in->damping};
    double *stored[] = {t->stiffness, t->mass, t->damping};
    for (size_t j = 0; j < t->n_coordinate; ++j) t->stiffness[j] = 1.0; /* value of the padding */
    for (size_t i = 0; i < 3; ++i) {
        for (size_t j = 0; j < 2 * n; ++j) both[j] = values[i][j % n];
        pad(t, both, stored[i]);
    }
    set_fourier_weights(t);
    /* a factor of the cosine and one of the sine for each force */
    for (size_t i = 0; i < 2 * n_force; ++i)
        pad(t, in->excitation + 2 * n * i, t->excitation + t->n_coordinate * i);
    for (size_t i = 0; i < n_row; ++i)
        pad(t, in->response_row + 2 * n * i, t->response_row + t->n_coordinate * i);
}

/* ---- compliance of a step ---- */

/* Weights am and af of the accelerations and forces at the start of a step, and gamma and b of the
 * acceleration at its end, for a spectral radius 0 to 1 at infinite frequency (Chung and Hulbert
 * 1993). */
bd_time_alpha bd_time_weights(double radius) {
    const double am = (2.0 * radius - 1.0) / (radius + 1.0);
    const double af = radius / (radius + 1.0);
    return (bd_time_alpha){
        .am = am,
        .af = af,
        .gamma = 0.5 - am + af,
        .b = 0.25 * (1.0 - am + af) * (1.0 - am + af),
    };
}

/* Displacement beta and acceleration (n_coordinate each) of every coordinate at the end of a step h,
 * due to a unit force there. With h = 0 only coordinates without mass move. */
void bd_time_compliance(const bd_time *t, double h, double radius, double *beta,
                        double *acceleration) {
    const bd_time_alpha w = bd_time_weights(radius);
    for (size_t j = 0; j < t->n_coordinate; ++j) {
        const double mass = t->mass[j], damping = t->damping[j], stiffness = t->stiffness[j];
        /* a coordinate without mass follows its force at once */
        if (!(mass > 0.0)) {
            acceleration[j] = 0.0;
            beta[j] = 1.0 / stiffness;
            continue;
        }
        /* an acceleration a at the end of the step changes velocity by gamma h a, displacement by
         * b h^2 a; equilibrium holds between the ends, with the weights am and af */
        const double by_motion = damping * w.gamma * h + stiffness * w.b * h * h;
        const double inertia = mass * (1.0 - w.am) + (1.0 - w.af) * by_motion;
        acceleration[j] = (1.0 - w.af) / inertia;
        beta[j] = w.b * h * h * acceleration[j];
    }
}

/* Amplitudes g (2, rows), real and imaginary parts, of the points due to mode j of a family, times
 * a factor of each row. `modes` are the motion modes of the family. */
static void mode_of(const bd_time *t, const double *modes, size_t n_padded, size_t j,
                    const double *factor, double *g) {
    for (size_t row = 0; row < t->rows; ++row) {
        const double *amplitude = modes + place_in_blocks(row, j, n_padded);
        g[row] = factor[row] * amplitude[0];
        g[t->rows + row] = factor[row] * amplitude[8];
    }
}

/* Add the lower triangle of size Re(g g^H) to S (rows, rows). */
static void add_dyad(size_t rows, double size, const double *g, double *S) {
    const double *restrict g_re = g, *restrict g_im = g + rows;
    for (size_t i = 0; i < rows; ++i) {
        const double re = size * g_re[i], im = size * g_im[i];
        if (re == 0.0 && im == 0.0) continue;
        double *restrict to = S + i * rows;
        for (size_t l = 0; l <= i; ++l) to[l] += re * g_re[l] + im * g_im[l];
    }
}

/* Add the compliance S (rows, rows; lower triangle) of a sector to its own forces: the mean over
 * the nodal diameters. `beta` is the displacement of each coordinate due to a unit force, `factor`
 * a scale of each row, and g (2, rows) work. */
static void add_sector_compliance(const bd_time *t, const double *beta, const double *factor,
                                  double *g, double *S) {
    const double *modes = t->motion_modes;
    for (int f = 0; f < t->n_family; ++f) {
        const size_t n_mode = (size_t)t->n_mode[f], n_padded = padded(n_mode);
        const size_t first = (size_t)t->first_coordinate[f];
        for (size_t j = 0; j < n_mode; ++j) {
            const double size = t->fourier_weight[first + j] * beta[first + j];
            if (size == 0.0) continue;
            mode_of(t, modes, n_padded, j, factor, g);
            add_dyad(t->rows, size, g, S);
        }
        modes += 2 * t->rows * n_padded;
    }
}

/* Columns (n, rows) of a low-rank factor, S = L' L, by Cholesky factorisation with pivoting; return
 * their number. It ends as soon as the largest diagonal entry of the remainder is at most `bound`,
 * or of the size of rounding while there are few columns. S is a lower triangle, and replaced by
 * the remainder. */
static size_t low_rank(size_t rows, size_t most, double bound, double *S, double *L) {
    static const double ROUNDING = 1e-14;
    for (size_t n = 0; n < most; ++n) {
        size_t pivot = 0;
        for (size_t i = 1; i < rows; ++i)
            if (S[i * rows + i] > S[pivot * rows + pivot]) pivot = i;
        const double largest = S[pivot * rows + pivot];
        const double least = n < BD_TIME_MIN_RANK ? ROUNDING : bound;
        if (!(largest > least)) return n;

        /* column of the pivot from the lower triangle, over the root of its diagonal entry */
        double *column = L + n * rows;
        const double root = sqrt(largest);
        for (size_t i = 0; i < rows; ++i) {
            const double entry = i >= pivot ? S[i * rows + pivot] : S[pivot * rows + i];
            column[i] = entry / root;
        }
        for (size_t i = 0; i < rows; ++i)
            for (size_t l = 0; l <= i; ++l) S[i * rows + l] -= column[i] * column[l];
    }
    return most;
}

static double inner(size_t n, const double *a, const double *b) {
    double sum = 0.0;
    for (size_t i = 0; i < n; ++i) sum += a[i] * b[i];
    return sum;
}

/* Rotate columns a and b until they are orthogonal and a is the longer one; return the cosine of
 * the angle between them before. */
static double rotate_columns(size_t rows, double *restrict a, double *restrict b) {
    static const double ORTHOGONAL = 1e-13;
    const double aa = inner(rows, a, a), bb = inner(rows, b, b), ab = inner(rows, a, b);
    const double size = sqrt(aa * bb);
    const int is_orthogonal = !(fabs(ab) > ORTHOGONAL * size);
    if (is_orthogonal && aa >= bb) return 0.0;

    /* the rotation that diagonalises [aa ab; ab bb], the larger value first */
    const double angle = 0.5 * atan2(2.0 * ab, aa - bb);
    const double c = cos(angle), s = sin(angle);
    for (size_t l = 0; l < rows; ++l) {
        const double x = a[l], y = b[l];
        a[l] = c * x + s * y;
        b[l] = c * y - s * x;
    }
    return size > 0.0 ? fabs(ab) / size : 0.0;
}

/* Make n columns orthogonal (one-sided Jacobi method), the largest first. */
static void make_orthogonal(size_t rows, size_t n, double *L) {
    enum { SWEEPS = 30 };
    double largest_cosine = 1.0;
    for (int sweep = 0; sweep < SWEEPS && largest_cosine > 1e-12; ++sweep) {
        largest_cosine = 0.0;
        for (size_t i = 0; i + 1 < n; ++i)
            for (size_t j = i + 1; j < n; ++j) {
                const double cosine = rotate_columns(rows, L + i * rows, L + j * rows);
                largest_cosine = fmax(largest_cosine, cosine);
            }
    }
}

/* Add size W W^H to the compliance C (r, r) of r patterns, for one mode with the complex amplitudes
 * W (2, r) of the patterns. Storage of C: blocks of 8 rows, column after column, first the real and
 * then the imaginary parts of 8 rows. */
static void add_mode(size_t r, double size, const double *W, double *C) {
    const double *W_re = W, *W_im = W + r;
    for (size_t block = 0; block < r; block += 8) {
        const double *re = W_re + block, *im = W_im + block;
        for (size_t j = 0; j < r; ++j, C += 16) {
            /* (re + i im)(x - i y) */
            const double x = size * W_re[j], y = size * W_im[j];
            for (size_t i = 0; i < 8; ++i) {
                C[i] += re[i] * x + im[i] * y;
                C[8 + i] += im[i] * x - re[i] * y;
            }
        }
    }
}

/* Scale of each row (component of a point): the root of its stiffness, or of the inverse of its
 * compliance S (rows, rows) for cubic springs, whose stiffness varies. A compliance of scaled rows
 * is then a compliance times a stiffness. */
static void set_row_scales(const bd_time *t, const double *S, double *factor) {
    const size_t stride = t->stride;
    for (size_t row = 0; row < t->rows; ++row) {
        /* component 0 and 1 are tangential, 2 is normal */
        const size_t d = row / stride, p = row % stride;
        const double *parameter = t->parameters + p;
        double stiffness = parameter[BD_TIME_KN * stride], cubic = 0.0;
        if (d < 2) {
            stiffness = parameter[(BD_TIME_KT + d) * stride];
            cubic = parameter[(BD_TIME_CUBIC + d) * stride];
        }
        if (cubic == 0.0) {
            factor[row] = sqrt(fabs(stiffness));
            continue;
        }
        const double compliance = S[row * t->rows + row];
        factor[row] = compliance > 0.0 ? 1.0 / sqrt(compliance) : 0.0;
    }
}

/* Compliance of a column: the square of its length. */
static double column_compliance(size_t rows, const double *L, size_t column) {
    const double *entries = L + column * rows;
    return inner(rows, entries, entries);
}

/* Number of the first columns, orthogonal and the largest first, that are patterns. Set the largest
 * neglected compliance. */
static size_t count_patterns(size_t rows, size_t n_found, const double *L, double *neglected) {
    static const double ROUNDING = 1e-14;
    /* columns of the size of rounding have no direction */
    const double rounding = n_found ? ROUNDING * column_compliance(rows, L, 0) : 0.0;
    size_t n_usable = 0;
    while (n_usable < n_found && column_compliance(rows, L, n_usable) > rounding) ++n_usable;

    size_t n = n_usable < BD_TIME_MIN_RANK ? n_usable : BD_TIME_MIN_RANK;
    while (n < n_usable && column_compliance(rows, L, n) > BD_TIME_RANK_TOLERANCE) ++n;
    if (n < n_usable) *neglected = column_compliance(rows, L, n);
    /* fill a block of 8 if there are columns for it */
    return padded(n) < n_usable ? padded(n) : n;
}

/* Patterns V of the motion: the n columns L (n, rows) without the scale of the rows. Patterns up to
 * the rank, a multiple of 8, are zero. */
static void write_patterns(size_t rows, size_t n, const double *L, const double *factor,
                           bd_time_patterns *patterns) {
    const size_t r = (size_t)patterns->rank;
    memset(patterns->pattern, 0, sizeof(double) * r * rows);
    memset(patterns->pattern_transposed, 0, sizeof(double) * r * rows);
    for (size_t j = 0; j < n; ++j) {
        for (size_t i = 0; i < rows; ++i) {
            const double entry = factor[i] > 0.0 ? L[j * rows + i] / factor[i] : 0.0;
            patterns->pattern[j * rows + i] = entry;
            patterns->pattern_transposed[i * r + j] = entry;
        }
    }
}

/* Compliance of n patterns in each family; `inverse` (n, rows) yields the amplitudes of the
 * patterns from the amplitudes of the scaled rows; g and W are work. */
static void write_compliance(const bd_time *t, const double *beta, const double *factor, size_t n,
                             const double *inverse, double *g, double *W,
                             bd_time_patterns *patterns) {
    const size_t rows = t->rows, r = (size_t)patterns->rank;
    const double *modes = t->motion_modes;
    double *C = patterns->compliance;
    memset(C, 0, sizeof(double) * 2 * r * r * (size_t)t->n_family);
    for (int f = 0; f < t->n_family; ++f, C += 2 * r * r) {
        const size_t n_mode = (size_t)t->n_mode[f], n_padded = padded(n_mode);
        const size_t first = (size_t)t->first_coordinate[f];
        for (size_t j = 0; j < n_mode; ++j) {
            const double size = t->fourier_weight[first + j] * beta[first + j];
            mode_of(t, modes, n_padded, j, factor, g);
            memset(W, 0, sizeof(double) * 2 * r);
            for (size_t i = 0; i < n; ++i) {
                W[i] = inner(rows, inverse + i * rows, g);
                W[r + i] = inner(rows, inverse + i * rows, g + rows);
            }
            add_mode(r, size, W, C);
        }
        modes += 2 * rows * n_padded;
    }
}

/* Compute the patterns of the motion of a sector by which contact forces change it in a step of
 * length h (0: an instant). S (rows, rows) is the compliance of the points of a sector to their own
 * forces, times their stiffness (set_row_scales). Few columns L with S = L' L up to a tolerance
 * suffice; made orthogonal, the largest of them are the patterns. Nothing is done if those of h and
 * the spectral radius are known. */
void bd_time_make_patterns(bd_time *t, bd_time_patterns *patterns, double h, double radius) {
    const size_t rows = t->rows, most = (size_t)t->max_rank;
    const int is_available = patterns->rank >= 0 && patterns->length == h;
    if (is_available && patterns->spectral_radius == radius) return;
    patterns->length = h;
    patterns->spectral_radius = radius;
    patterns->rank = 0;
    patterns->neglected = 0.0;
    if (!rows) return;

    double *rest = t->work;
    double *S = bd_take(&rest, rows * rows);
    double *L = bd_take(&rest, most * rows);
    double *g = bd_take(&rest, 2 * rows);
    double *factor = bd_take(&rest, rows);
    double *W = bd_take(&rest, 2 * most);
    double *beta = t->q_next; /* unused before the first step */
    bd_time_compliance(t, h, radius, beta, t->a_next);

    /* first without factors, since those of cubic springs follow from S */
    for (size_t i = 0; i < rows; ++i) factor[i] = 1.0;
    memset(S, 0, sizeof(double) * rows * rows);
    add_sector_compliance(t, beta, factor, g, S);
    set_row_scales(t, S, factor);
    memset(S, 0, sizeof(double) * rows * rows);
    add_sector_compliance(t, beta, factor, g, S);

    /* more columns than needed, so that the orthogonal ones are exact up to the tolerance */
    const double bound = 1e-2 * BD_TIME_RANK_TOLERANCE;
    const size_t n_found = low_rank(rows, most, bound, S, L);
    make_orthogonal(rows, n_found, L);
    const size_t n = count_patterns(rows, n_found, L, &patterns->neglected);
    patterns->rank = (int)padded(n);
    write_patterns(rows, n, L, factor, patterns);

    /* the columns are orthogonal: divided by their squares they are the inverse */
    for (size_t j = 0; j < n; ++j) {
        const double square = inner(rows, L + j * rows, L + j * rows);
        for (size_t i = 0; i < rows; ++i) L[j * rows + i] /= square;
    }
    write_compliance(t, beta, factor, n, L, g, W, patterns);
}

/* Springs and sliders of one point. `parameter` is its first field; the fields of a point are
 * `stride` numbers apart. Cubic springs replace the linear ones in all directions. */
static void set_springs(const bd_time_input *in, size_t p, size_t stride, double *parameter) {
    const bd_law law = (bd_law)in->law[p];
    const int is_cubic = law == BD_LAW_CUBIC;
    for (size_t d = 0; d < 2; ++d) {
        const double kt = in->kt[2 * p + d];
        const int has_spring = !is_cubic && kt > 0.0;
        const int is_fixed = law == BD_LAW_BONDED || in->fixed_slider[2 * p + d];
        parameter[(BD_TIME_KT + d) * stride] = is_cubic ? 0.0 : kt;
        parameter[(BD_TIME_CUBIC + d) * stride] = is_cubic ? kt : 0.0;
        parameter[(BD_TIME_INVERSE_KT + d) * stride] = has_spring ? 1.0 / kt : 0.0;
        parameter[(BD_TIME_FIXED_SLIDER + d) * stride] = is_fixed;
    }
    parameter[BD_TIME_KN * stride] = is_cubic ? 0.0 : in->kn[p];
    parameter[BD_TIME_N0 * stride] = is_cubic ? 0.0 : in->n0[p];
    parameter[BD_TIME_LEAST_N * stride] = bd_law_is_two_sided(law) ? -HUGE_VAL : 0.0;
}

/* Parameters of all points. The friction limit is LIMIT + MU N: under a constant load only the
 * first term is set, otherwise only the second. */
static void set_points(bd_time *t, const bd_time_input *in) {
    const size_t stride = t->stride;
    for (size_t p = 0; p < (size_t)t->n_point; ++p) {
        const bd_law law = (bd_law)in->law[p];
        const int constant_load = bd_law_is_constant(law);
        const double mu = law == BD_LAW_NORMAL ? 0.0 : in->mu[p];
        double *parameter = t->parameters + p;
        set_springs(in, p, stride, parameter);
        for (size_t d = 0; d < 3; ++d)
            parameter[(BD_TIME_SHIFT + d) * stride] = in->shift[3 * p + d];
        parameter[BD_TIME_LIMIT * stride] = constant_load ? mu * fmax(in->load[p], 0.0) : 0.0;
        parameter[BD_TIME_MU * stride] = constant_load ? 0.0 : mu;
        parameter[BD_TIME_COUPLED * stride] = bd_law_is_coupled(law);
        parameter[BD_TIME_USER_LAW * stride] = law == BD_LAW_USER;
        t->has_coupled |= bd_law_is_coupled(law);
        t->has_cubic |= law == BD_LAW_CUBIC;
    }
}

/* Count the points with user laws, and find the largest memory of a law: the motion before the
 * step and the states. */
static void set_laws(bd_time *t) {
    for (int p = 0; p < t->n_point; ++p) {
        if (!t->point_law[p].function) continue;
        const int n_memory = 3 + t->point_law[p].n_state;
        ++t->n_user_law;
        if (n_memory > t->n_memory) t->n_memory = n_memory;
    }
}

/* Copy the input: first integers, whose sums determine the lengths of the arrays of numbers. Patterns
 * follow later, for the length of a step; a rank of -1 means that they are unknown. */
bd_status bd_time_create(bd_time *t, const bd_time_input *in) {
    memset(t, 0, sizeof *t);
    t->kernel = bd_kernel_get();
    if (!t->kernel) return BD_BAD_ARGUMENT;
    set_sizes(t, in);
    const int n_integer = 3 * t->n_family + t->n_force + t->n_sector + 2 * t->n_total + 1;
    t->integers = calloc((size_t)n_integer, sizeof(int));
    t->point_law = bd_point_laws_create(in->n_point, in->point_law);
    if (!t->integers || !t->point_law) {
        bd_time_destroy(t);
        return BD_NO_MEMORY;
    }
    assign_integers(t);
    set_families(t, in);
    set_laws(t);

    const size_t n_double = assign_arrays(t); /* counts them, since there is no memory yet */
    t->memory = calloc(n_double, sizeof(double));
    if (!t->memory) {
        bd_time_destroy(t);
        return BD_NO_MEMORY;
    }
    assign_arrays(t);
    set_modes(t, in);
    set_phases(t, in);
    set_points(t, in);
    set_coordinates(t, in);
    t->of_instant.rank = -1;
    for (int i = 0; i < BD_TIME_LENGTHS_OF_STEP; ++i) t->of_step[i].rank = -1;
    return BD_OK;
}

void bd_time_destroy(bd_time *t) {
    free(t->memory);
    free(t->integers);
    free(t->point_law);
    memset(t, 0, sizeof *t);
}

/* Copy a number from the storage of the time steps (inside) to the caller (outside) if `out` is 1,
 * otherwise from the caller to the storage. */
static void copy_number(double *inside, double *outside, int out) {
    if (out)
        *outside = *inside;
    else
        *inside = *outside;
}

/* Copy sliders and memories w (n_sector, n_point, 2 + n_memory) of the caller into the storage of
 * the time steps, or back if `out` is 1. */
static void copy_sliders(bd_time *t, double *w, int out) {
    const size_t n_memory = (size_t)t->n_memory, n_point = (size_t)t->n_point;
    for (size_t k = 0; k < (size_t)t->n_sector; ++k) {
        for (size_t p = 0; p < n_point; ++p, w += 2 + n_memory) {
            double *slider = t->slider + 2 * k * t->stride + p; /* along t1; t2 is stride behind */
            double *memory = t->law_memory[0] + (k * n_point + p) * n_memory;
            copy_number(slider, w, out);
            copy_number(slider + t->stride, w + 1, out);
            for (size_t i = 0; i < n_memory; ++i) copy_number(memory + i, w + 2 + i, out);
        }
    }
}

void bd_time_reset_states(bd_time *t) {
    const size_t n = (size_t)t->n_sector * t->stride;
    for (size_t i = 0; i < n; ++i) t->contact_state[i] = -1.0; /* no valid state */
    memset(t->tangent, 0, sizeof(double) * 9 * n);
}

/* Clear all data that an earlier integration has left, including the padding. */
static void reset(bd_time *t) {
    const size_t n_slider = 2 * t->stride * (size_t)t->n_sector;
    const size_t n_pattern = (size_t)t->max_rank * (size_t)t->n_sector;
    double *coordinates[] = {t->q, t->v, t->a, t->contact_force, t->q_next, t->a_next, t->load};
    for (size_t i = 0; i < sizeof coordinates / sizeof *coordinates; ++i)
        memset(coordinates[i], 0, sizeof(double) * t->n_coordinate);
    memset(t->slider, 0, sizeof(double) * n_slider);
    memset(t->next_slider, 0, sizeof(double) * n_slider);
    memset(t->pattern_force, 0, sizeof(double) * n_pattern);
    bd_time_reset_states(t);
    t->largest_force = 0.0;
    t->period_state = NULL;
    t->period_is_better = 0;
}

/* Integrate the state of the caller in place: coordinates q, velocities v, accelerations a
 * (2, n_total), and sliders and memories w (n_sector, n_point, 2 + n_memory). The time steps store
 * them padded to multiples of 8 and in another order, so they are copied there and back. */
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

/* Move the sliders and memories w (n_sector, n_point, 2 + n_memory) along the prescribed
 * coordinates q (n_step, 2, n_total), one contact evaluation for each step. */
void bd_time_update_sliders(bd_time *t, long n_step, const double *q, double *w) {
    reset(t);
    copy_sliders(t, w, 0);
    for (long k = 0; k < n_step; ++k) {
        pad(t, q + 2 * (size_t)t->n_total * (size_t)k, t->q);
        t->kernel->contact_at_instant(t);
    }
    copy_sliders(t, w, 1);
}
