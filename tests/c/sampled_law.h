/* The contact law sample by sample, from the equations alone: the reference of both evaluations. */
#ifndef SAMPLED_LAW_H
#define SAMPLED_LAW_H

#include "contact/element.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static inline double series_value(int n_harm, const double *x, double theta) {
    double sum = x[0];
    for (int l = 1; l <= n_harm; ++l)
        sum += x[2 * l - 1] * cos(l * theta) + x[2 * l] * sin(l * theta);
    return sum;
}

/* F (3, n_coef) from n_time samples over two periods; x (3, n_coef). */
static inline void sampled_law(const bd_element *e, int n_harm, const double *x, int n_time,
                               int interpolate, double *F) {
    const int n_coef = bd_n_coef(n_harm);
    memset(F, 0, sizeof(double) * 3 * (size_t)n_coef);
    double *u = malloc(sizeof(double) * (size_t)n_time),
           *g = malloc(sizeof(double) * (size_t)n_time);
    double *f = malloc(sizeof(double) * (size_t)n_time);
    if (!u || !g || !f) abort();
    for (int k = 0; k < n_time; ++k)
        g[k] = e->n0 + e->kn * series_value(n_harm, x + 2 * n_coef, BD_TWO_PI * k / n_time);
    for (int d = 0; d < 3; ++d) {
        if (d < 2 && (e->law == BD_LAW_NORMAL || e->mu == 0.0 || e->kt[d] == 0.0)) continue;
        if (d == 2) {
            for (int k = 0; k < n_time; ++k) f[k] = fmax(g[k], 0.0);
        } else {
            double w = e->w[d];
            for (int k = 0; k < n_time; ++k)
                u[k] = series_value(n_harm, x + d * n_coef, BD_TWO_PI * k / n_time);
            for (int pass = 0; pass < 2 * n_time; ++pass) {
                const int k = pass % n_time, before = (k + n_time - 1) % n_time;
                if (interpolate && pass > 0 && g[before] <= 0.0 && g[k] > 0.0) {
                    const double s = -g[before] / (g[k] - g[before]);
                    w = (1.0 - s) * u[before] + s * u[k];
                }
                const double bound = e->mu * fmax(g[k], 0.0) / e->kt[d];
                w = fmin(fmax(w, u[k] - bound), u[k] + bound);
                f[k] = e->kt[d] * (u[k] - w);
            }
        }
        for (int k = 0; k < n_time; ++k) {
            F[d * n_coef] += f[k] / n_time;
            for (int l = 1; l <= n_harm; ++l) {
                F[d * n_coef + 2 * l - 1] += 2.0 * f[k] * cos(l * BD_TWO_PI * k / n_time) / n_time;
                F[d * n_coef + 2 * l] += 2.0 * f[k] * sin(l * BD_TWO_PI * k / n_time) / n_time;
            }
        }
    }
    free(u);
    free(g);
    free(f);
}

#endif
