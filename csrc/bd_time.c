/* March in time: what is prepared once, and the way of a state in and out.  The loop itself is in bd_time_loop.c. */
#include "bd_time.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static size_t padded(size_t n) { return (n + 7) / 8 * 8; }

/* Sizes, and the integers that describe the families. */
static void set_sizes(bd_time *t, const bd_time_input *in) {
    const size_t f = (size_t)in->n_family;
    t->n_sector = in->n_sector, t->n_point = in->n_point, t->n_family = in->n_family, t->n_force = in->n_force;
    t->stride = padded((size_t)in->n_point);
    t->n_mode = t->numbers, t->first = t->n_mode + f, t->first_total = t->first + f, t->is_real = t->first_total + f;
    t->order = t->is_real + f;
    for (int i = 0; i < in->n_family; ++i) {
        t->n_mode[i] = in->n_mode[i];
        t->is_real[i] = 2 * in->diameter[i] % in->n_sector == 0;
        t->first[i] = (int)t->n_coordinate;
        t->first_total[i] = t->n_total;
        t->n_coordinate += 2 * padded((size_t)in->n_mode[i]);
        t->n_total += in->n_mode[i];
    }
    if (in->n_force > 0) memcpy(t->order, in->order, sizeof(int) * (size_t)in->n_force);
}

/* Cuts the memory of all arrays of doubles, or counts it if there is none yet. */
static size_t cut(bd_time *t) {
    const size_t n = t->n_coordinate, s = t->stride, f = (size_t)t->n_family;
    size_t used = 0, modes = 0;
    for (int i = 0; i < t->n_family; ++i) modes += padded((size_t)t->n_mode[i]);
    const struct {
        double **array;
        size_t size;
    } part[] = {{&t->out, 6 * s * modes},
                {&t->back, 6 * s * modes},
                {&t->phase, 2 * f * (size_t)t->n_sector},
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
                {&t->w, 2 * s * (size_t)t->n_sector},
                {&t->y, 6 * s * f},
                {&t->z, 6 * s * f},
                {&t->work, 3 * (size_t)t->n_total}};
    for (size_t i = 0; i < sizeof part / sizeof *part; ++i) {
        if (t->memory) *part[i].array = t->memory + used;
        used += padded(part[i].size);
    }
    return used;
}

/* (2, n_total) into padded coordinates, times a factor of each if there is one. */
static void pad(const bd_time *t, const double *x, const double *factor, double *padded_x) {
    for (int f = 0; f < t->n_family; ++f) {
        const size_t m = (size_t)t->n_mode[f], from = (size_t)t->first_total[f];
        double *to = padded_x + t->first[f];
        for (size_t part = 0; part < 2; ++part)
            for (size_t j = 0; j < m; ++j)
                to[part * padded(m) + j] = (factor ? factor[from + j] : 1.0) * x[part * (size_t)t->n_total + from + j];
    }
}

void bd_time_unpad(const bd_time *t, const double *padded_x, double *x) {
    for (int f = 0; f < t->n_family; ++f) {
        const size_t m = (size_t)t->n_mode[f], to = (size_t)t->first_total[f];
        const double *from = padded_x + t->first[f];
        memcpy(x + to, from, sizeof(double) * m);
        memcpy(x + (size_t)t->n_total + to, from + padded(m), sizeof(double) * m);
    }
}

static void set_modes(bd_time *t, const bd_time_input *in) {
    const double *G = in->G;
    double *out = t->out, *back = t->back;
    for (int f = 0; f < t->n_family; ++f) {
        const size_t m = (size_t)t->n_mode[f], wide = padded(m);
        for (size_t p = 0; p < (size_t)t->n_point; ++p)
            for (size_t d = 0; d < 3; ++d)
                for (size_t j = 0; j < m; ++j) {
                    const double *g = G + 2 * ((p * 3 + d) * m + j);
                    const size_t row = d * t->stride + p, at = (row / 8 * wide + j) * 16 + row % 8;
                    const size_t to = (j / 8 * 3 * t->stride + row) * 16 + j % 8;
                    out[at] = back[to] = g[0];
                    out[at + 8] = back[to + 8] = t->is_real[f] ? 0.0 : g[1];
                }
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
    for (size_t j = 0; j < n; ++j) light[j] = 1.0 / in->mass[j];
    for (size_t j = 0; j < 2 * n; ++j) both[j] = in->stiffness[j % n];
    pad(t, both, light, t->omega2);
    for (size_t j = 0; j < 2 * n; ++j) both[j] = in->damping[j % n];
    pad(t, both, light, t->damping);
    for (int f = 0; f < t->n_family; ++f)
        for (int j = t->first_total[f]; j < t->first_total[f] + t->n_mode[f]; ++j) {
            both[j] = (t->is_real[f] ? 1.0 : 2.0) / t->n_sector;
            both[n + (size_t)j] = t->is_real[f] ? 0.0 : both[j];
        }
    pad(t, both, light, t->share);
    for (size_t i = 0; i < 2 * (size_t)t->n_force; ++i)
        pad(t, in->force + 2 * n * i, light, t->force + t->n_coordinate * i);
    pad(t, in->row, NULL, t->row);
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
    if (!(t->numbers = malloc(sizeof(int) * (size_t)(4 * in->n_family + in->n_force + 1)))) return BD_NO_MEMORY;
    set_sizes(t, in);
    if (!(t->memory = calloc(cut(t), sizeof(double)))) {
        bd_time_destroy(t);
        return BD_NO_MEMORY;
    }
    cut(t);
    set_modes(t, in);
    set_points(t, in);
    set_coordinates(t, in);
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

void bd_time_march(bd_time *t, const bd_time_path *path, double *q, double *v, double *w) {
    pad(t, q, NULL, t->q);
    pad(t, v, NULL, t->v);
    turn_sliders(t, w, 0);
    t->kernel->time_march(t, path);
    bd_time_unpad(t, t->q, q);
    bd_time_unpad(t, t->v, v);
    turn_sliders(t, w, 1);
}

void bd_time_follow(bd_time *t, long n_step, const double *q, double *w) {
    turn_sliders(t, w, 0);
    for (long k = 0; k < n_step; ++k) {
        pad(t, q + 2 * (size_t)t->n_total * (size_t)k, NULL, t->q);
        t->kernel->time_press(t);
    }
    turn_sliders(t, w, 1);
}
