/* March in time: what is prepared once, and the way of a state in and out.  The loop itself is in bd_time_loop.c. */
#include "bd_time.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static size_t padded(size_t n) { return (n + 7) / 8 * 8; }

/* Sizes, and the integers that describe the families; modes without mass come last in theirs. */
static void set_sizes(bd_time *t, const bd_time_input *in) {
    const size_t f = (size_t)in->n_family;
    t->n_sector = in->n_sector, t->n_point = in->n_point, t->n_family = in->n_family, t->n_force = in->n_force;
    t->stride = padded((size_t)in->n_point);
    t->n_mode = t->numbers, t->n_heavy = t->n_mode + f, t->first = t->n_heavy + f, t->is_real = t->first + f;
    t->order = t->is_real + f, t->place = t->order + in->n_force;
    for (size_t i = 0; i < f; ++i) t->n_total += in->n_mode[i];
    t->other = t->place + t->n_total, t->slack = t->other + t->n_total;
    int total = 0;
    for (int i = 0; i < in->n_family; ++i) {
        t->n_mode[i] = in->n_mode[i];
        t->is_real[i] = 2 * in->diameter[i] % in->n_sector == 0;
        t->first[i] = (int)t->n_coordinate;
        for (int light = 0, n = 0; light < 2; ++light) {
            for (int j = total; j < total + in->n_mode[i]; ++j)
                if ((in->mass[j] > 0.0) != light) {
                    t->place[j] = t->first[i] + n++;
                    t->other[j] = t->place[j] + (int)padded((size_t)in->n_mode[i]);
                }
            if (!light) t->n_heavy[i] = n;
        }
        t->n_slack += (t->is_real[i] ? 1 : 2) * (t->n_mode[i] - t->n_heavy[i]);
        t->n_coordinate += 2 * padded((size_t)in->n_mode[i]);
        total += in->n_mode[i];
    }
    t->pivot = t->slack + t->n_slack, t->pivot_closed = t->pivot + t->n_slack;
    if (in->n_force > 0) memcpy(t->order, in->order, sizeof(int) * (size_t)in->n_force);
    for (int i = 0, n = 0; i < t->n_family; ++i)
        for (int half = 0; half < (t->is_real[i] ? 1 : 2); ++half)
            for (int j = t->n_heavy[i]; j < t->n_mode[i]; ++j)
                t->slack[n++] = t->first[i] + j + half * (int)padded((size_t)t->n_mode[i]);
}

/* Cuts the memory of all arrays of doubles, or counts it if there is none yet. */
static size_t cut(bd_time *t) {
    const size_t n = t->n_coordinate, s = t->stride, f = (size_t)t->n_family, k = (size_t)t->n_sector;
    const size_t light = (size_t)t->n_slack, contacts = light ? k * (size_t)t->n_point : 0, amplitudes = 6 * s * f;
    size_t used = 0, modes = 0;
    for (int i = 0; i < t->n_family; ++i) modes += padded((size_t)t->n_mode[i]);
    const struct {
        double **array;
        size_t size;
    } part[] = {{&t->out, 6 * s * modes},
                {&t->back, 6 * s * modes},
                {&t->phase, 2 * f * k},
                {&t->omega2, n},
                {&t->damping, n},
                {&t->share, n},
                {&t->force, 2 * n * (size_t)t->n_force},
                {&t->row, n},
                {&t->point, BD_TIME_FIELDS * s},
                {&t->q, n},
                {&t->v, n},
                {&t->a, n},
                {&t->pressed, n},
                {&t->w, 2 * s * k},
                {&t->moved, light ? 2 * s * k : 0},
                {&t->base, light ? amplitudes : 0},
                {&t->y, amplitudes},
                {&t->z, amplitudes},
                {&t->stiffness, light},
                {&t->part, light},
                {&t->push, 2 * light * (size_t)t->n_force},
                {&t->rows, 3 * contacts * light},
                {&t->tangent, 9 * contacts},
                {&t->state, light ? k * s : 0},
                {&t->H, light * light},
                {&t->lu, light * light},
                {&t->closed, light * light},
                {&t->residual, light},
                {&t->before, light},
                {&t->work, 3 * (size_t)t->n_total}};
    for (size_t i = 0; i < sizeof part / sizeof *part; ++i) {
        if (t->memory) *part[i].array = t->memory + used;
        used += padded(part[i].size);
    }
    return used;
}

/* (2, n_total) into padded coordinates, times a factor of each if there is one. */
static void pad(const bd_time *t, const double *x, const double *factor, double *padded_x) {
    for (int j = 0; j < t->n_total; ++j) {
        padded_x[t->place[j]] = (factor ? factor[j] : 1.0) * x[j];
        padded_x[t->other[j]] = (factor ? factor[j] : 1.0) * x[t->n_total + j];
    }
}

void bd_time_unpad(const bd_time *t, const double *padded_x, double *x) {
    for (int j = 0; j < t->n_total; ++j) {
        x[j] = padded_x[t->place[j]];
        x[t->n_total + j] = padded_x[t->other[j]];
    }
}

static void set_modes(bd_time *t, const bd_time_input *in) {
    const double *G = in->G;
    double *out = t->out, *back = t->back;
    const int *place = t->place;
    for (int f = 0; f < t->n_family; ++f) {
        const size_t m = (size_t)t->n_mode[f], wide = padded(m);
        for (size_t p = 0; p < (size_t)t->n_point; ++p)
            for (size_t d = 0; d < 3; ++d)
                for (size_t j = 0; j < m; ++j) {
                    const double *g = G + 2 * ((p * 3 + d) * m + j);
                    const size_t row = d * t->stride + p, to = (size_t)(place[j] - t->first[f]);
                    const size_t at = (row / 8 * wide + to) * 16 + row % 8;
                    const size_t at_back = (to / 8 * 3 * t->stride + row) * 16 + to % 8;
                    out[at] = back[at_back] = g[0];
                    out[at + 8] = back[at_back + 8] = t->is_real[f] ? 0.0 : g[1];
                }
        place += m;
        G += 6 * (size_t)t->n_point * m;
        out += 6 * t->stride * wide;
        back += 6 * t->stride * wide;
        for (int k = 0; k < t->n_sector; ++k) {
            const double angle = BD_TWO_PI * (double)((long long)k * in->diameter[f] % t->n_sector) / t->n_sector;
            double *phase = t->phase + 2 * ((size_t)k * (size_t)t->n_family + (size_t)f);
            phase[0] = cos(angle), phase[1] = sin(angle);
        }
    }
}

static void set_coordinates(bd_time *t, const bd_time_input *in) {
    const size_t n = (size_t)t->n_total;
    double *both = t->work, *light = both + 2 * n;
    for (size_t j = 0; j < n; ++j) light[j] = in->mass[j] > 0.0 ? 1.0 / in->mass[j] : 0.0;
    for (size_t j = 0; j < 2 * n; ++j) both[j] = in->stiffness[j % n];
    pad(t, both, NULL, t->pressed);
    pad(t, both, light, t->omega2);
    for (size_t j = 0; j < 2 * n; ++j) both[j] = in->damping[j % n];
    pad(t, both, light, t->damping);
    for (int f = 0, j = 0; f < t->n_family; ++f)
        for (const int end = j + t->n_mode[f]; j < end; ++j) {
            both[j] = (t->is_real[f] ? 1.0 : 2.0) / t->n_sector;
            both[n + (size_t)j] = t->is_real[f] ? 0.0 : both[j];
        }
    pad(t, both, NULL, t->a);
    pad(t, both, light, t->share);
    for (int i = 0; i < t->n_slack; ++i) t->stiffness[i] = t->pressed[t->slack[i]], t->part[i] = t->a[t->slack[i]];
    for (size_t i = 0; i < 2 * (size_t)t->n_force; ++i) {
        pad(t, in->force + 2 * n * i, light, t->force + t->n_coordinate * i);
        pad(t, in->force + 2 * n * i, NULL, t->pressed);
        for (int j = 0; j < t->n_slack; ++j) t->push[i * (size_t)t->n_slack + (size_t)j] = t->pressed[t->slack[j]];
    }
    pad(t, in->row, NULL, t->row);
}

/* ---- contact condition ---- */

void bd_time_factor(int n, double *A, int *pivot) {
    for (int c = 0; c < n; ++c) {
        int best = c;
        for (int i = c + 1; i < n; ++i)
            if (fabs(A[i * n + c]) > fabs(A[best * n + c])) best = i;
        pivot[c] = best;
        if (best != c)
            for (int j = 0; j < n; ++j) {
                const double x = A[c * n + j];
                A[c * n + j] = A[best * n + j], A[best * n + j] = x;
            }
        for (int i = c + 1; i < n; ++i) {
            const double x = A[i * n + c] /= A[c * n + c];
            if (x != 0.0)
                for (int j = c + 1; j < n; ++j) A[i * n + j] -= x * A[c * n + j];
        }
    }
}

void bd_time_solve(int n, const double *A, const int *pivot, double *x) {
    for (int c = 0; c < n; ++c) {
        const double swapped = x[pivot[c]];
        x[pivot[c]] = x[c], x[c] = swapped;
    }
    for (int i = 1; i < n; ++i)
        for (int j = 0; j < i; ++j) x[i] -= A[i * n + j] * x[j];
    for (int i = n - 1; i >= 0; --i) {
        for (int j = i + 1; j < n; ++j) x[i] -= A[i * n + j] * x[j];
        x[i] /= A[i * n + i];
    }
}

void bd_time_add(const bd_time *t, size_t k, size_t p, const double *D, double *H) {
    const size_t n = (size_t)t->n_slack;
    const double *a = t->rows + 3 * n * (k * (size_t)t->n_point + p);
    for (size_t d = 0; d < 3; ++d) {
        const double *D_d = D + 3 * d;
        if (D_d[0] == 0.0 && D_d[1] == 0.0 && D_d[2] == 0.0) continue;
        for (size_t i = 0; i < n; ++i) {
            const double x = t->part[i] * a[d * n + i];
            for (size_t j = 0; j < n; ++j) H[i * n + j] += x * (D_d[0] * a[j] + D_d[1] * a[n + j] + D_d[2] * a[2 * n + j]);
        }
    }
}

/* Motion of each point of each sector by the coordinates without mass, and the matrices without and with contact. */
static void set_condition(bd_time *t) {
    const size_t n = (size_t)t->n_slack, s = t->stride;
    if (!n) return;
    for (size_t k = 0; k < (size_t)t->n_sector; ++k)
        for (size_t p = 0; p < (size_t)t->n_point; ++p) {
            double D[9] = {0.0};
            for (size_t d = 0; d < 3; ++d) {
                double *row = t->rows + n * (3 * (k * (size_t)t->n_point + p) + d);
                const double *out = t->out;
                size_t i = 0;
                for (int f = 0; f < t->n_family; ++f) {
                    const size_t m = (size_t)t->n_mode[f], wide = padded(m), at = d * s + p;
                    const double *phase = t->phase + 2 * (k * (size_t)t->n_family + (size_t)f);
                    for (int half = 0; half < (t->is_real[f] ? 1 : 2); ++half)
                        for (size_t j = (size_t)t->n_heavy[f]; j < m; ++j, ++i) {
                            const double *g = out + (at / 8 * wide + j) * 16 + at % 8;
                            row[i] = half ? -g[0] * phase[1] - g[8] * phase[0] : g[0] * phase[0] - g[8] * phase[1];
                        }
                    out += 6 * s * wide;
                }
                D[4 * d] = d < 2 ? t->point[(BD_TIME_KT + d) * s + p] : t->point[BD_TIME_KN * s + p];
            }
            bd_time_add(t, k, p, D, t->closed);
        }
    for (size_t i = 0; i < n; ++i) t->closed[i * n + i] += t->stiffness[i];
    bd_time_factor(t->n_slack, t->closed, t->pivot_closed);
}

static void set_points(bd_time *t, const bd_time_input *in) {
    const size_t s = t->stride;
    for (size_t p = 0; p < (size_t)t->n_point; ++p) {
        const bd_law law = (bd_law)in->law[p];
        double *x = t->point + p;
        for (size_t d = 0; d < 2; ++d) {
            const double kt = in->kt[2 * p + d];
            x[(BD_TIME_KT + d) * s] = law == BD_LAW_CUBIC ? 0.0 : kt;
            x[(BD_TIME_CUBIC + d) * s] = law == BD_LAW_CUBIC ? kt : 0.0;
            x[(BD_TIME_EASE + d) * s] = law != BD_LAW_CUBIC && kt > 0.0 ? 1.0 / kt : 0.0;
            x[(BD_TIME_HELD + d) * s] = law == BD_LAW_BONDED || in->held[2 * p + d];
        }
        for (size_t d = 0; d < 3; ++d) x[(BD_TIME_SHIFT + d) * s] = in->shift[3 * p + d];
        x[BD_TIME_KN * s] = law == BD_LAW_CUBIC ? 0.0 : in->kn[p];
        x[BD_TIME_N0 * s] = law == BD_LAW_CUBIC ? 0.0 : in->n0[p];
        x[BD_TIME_FLOOR * s] = bd_law_is_two_sided(law) ? -HUGE_VAL : 0.0;
        const double mu = law == BD_LAW_NORMAL ? 0.0 : in->mu[p];
        x[BD_TIME_R0 * s] = bd_law_is_constant(law) ? mu * fmax(in->load[p], 0.0) : 0.0;
        x[BD_TIME_R1 * s] = bd_law_is_constant(law) ? 0.0 : mu;
        x[BD_TIME_COUPLED * s] = bd_law_is_coupled(law);
        t->has_coupled |= bd_law_is_coupled(law);
        t->has_cubic |= law == BD_LAW_CUBIC;
    }
}

bd_status bd_time_create(bd_time *t, const bd_time_input *in) {
    memset(t, 0, sizeof *t);
    if (!(t->kernel = bd_kernel_get())) return BD_BAD_ARGUMENT;
    size_t n = 4 * (size_t)in->n_family + (size_t)in->n_force + 1;
    for (int f = 0; f < in->n_family; ++f) n += 8 * (size_t)in->n_mode[f];
    if (!(t->numbers = calloc(n, sizeof(int)))) return BD_NO_MEMORY;
    set_sizes(t, in);
    if (!(t->memory = calloc(cut(t), sizeof(double)))) {
        bd_time_destroy(t);
        return BD_NO_MEMORY;
    }
    cut(t);
    set_modes(t, in);
    set_points(t, in);
    set_coordinates(t, in);
    set_condition(t);
    return BD_OK;
}

void bd_time_destroy(bd_time *t) {
    free(t->memory);
    free(t->numbers);
    memset(t, 0, sizeof *t);
}

/* Sliders (n_sector, n_point, 2) into the layout of the loop, or out of it. */
static void turn_sliders(bd_time *t, double *w, int out) {
    for (size_t k = 0; k < (size_t)t->n_sector; ++k)
        for (size_t p = 0; p < (size_t)t->n_point; ++p)
            for (size_t d = 0; d < 2; ++d) {
                double *inside = t->w + (2 * k + d) * t->stride + p, *outside = w + 2 * (k * (size_t)t->n_point + p) + d;
                if (out)
                    *outside = *inside;
                else
                    *inside = *outside;
            }
}

/* Forgets what was marched before: all that one instant leaves to the next, entries of the padding, too. */
static void forget(bd_time *t) {
    const size_t n = (size_t)t->n_slack, k = (size_t)t->n_sector, s = t->stride, size = sizeof(double);
    double *coordinates[] = {t->q, t->v, t->a, t->pressed};
    for (size_t i = 0; i < 4; ++i) memset(coordinates[i], 0, size * t->n_coordinate);
    memset(t->w, 0, size * 2 * s * k);
    t->largest = 0.0;
    t->has_changed = 1;
    if (!n) return;
    memset(t->moved, 0, size * 2 * s * k);
    memset(t->state, 0, size * k * s); /* open, of which the derivative is none */
    memset(t->tangent, 0, size * 9 * k * (size_t)t->n_point);
    memset(t->H, 0, size * n * n);
    for (size_t i = 0; i < n; ++i) t->H[i * n + i] = t->stiffness[i];
}

void bd_time_march(bd_time *t, const bd_time_path *path, double *q, double *v, double *w, bd_time_effort *effort) {
    forget(t);
    pad(t, q, NULL, t->q);
    pad(t, v, NULL, t->v);
    turn_sliders(t, w, 0);
    t->effort = *effort;
    t->kernel->time_march(t, path);
    *effort = t->effort;
    bd_time_unpad(t, t->q, q);
    bd_time_unpad(t, t->v, v);
    turn_sliders(t, w, 1);
}

void bd_time_follow(bd_time *t, long n_step, const double *q, double *w) {
    forget(t);
    turn_sliders(t, w, 0);
    for (long k = 0; k < n_step; ++k) {
        pad(t, q + 2 * (size_t)t->n_total * (size_t)k, NULL, t->q);
        t->kernel->time_press(t);
    }
    turn_sliders(t, w, 1);
}
