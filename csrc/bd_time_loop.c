/* March in time of all sectors; this file is compiled once for each instruction set.
 *
 * The motion is a superposition of families, one for each nodal diameter d, x_k = shift + sum_d Re[G_d eta_d exp(i k d phi)],
 * phi = 2 pi/N, and obeys
 *
 *     eta_d'' + c eta_d' + omega2 eta_d + (c_d/(N m)) sum_k G_d^H exp(-i k d phi) F_k = E_d(t)/m,     c_d = 2,
 *
 * or 1 with real coordinates where d = 0 or N/2.  One step h of central differences (velocity Verlet) is
 *
 *     v' = v + h/2 a,   q += h v',   F from the law,   v = (v' + h/2 r)/(1 + h/2 c),   a = r - c v,   r = E/m - omega2 q - F .
 *
 * G_d eta_d is formed once for each family and turned by its phase from sector to sector, two sectors k and N - k at a time:
 * their cosines are equal and their sines opposite.  Forces are summed the same way back.
 *
 * The law goes from one instant to the next: N = max(n0 + kn v, 0); the slider is clipped to u -+ r/kt with the limit r of
 * friction, mu N or mu times a given load; a coupled law draws the friction force back radially to the disk of radius r. */
#include "bd_time.h"
#include "bd_vector.h"

enum { PART = 8 / BD_WIDTH }; /* vectors in a block of 8 */

typedef struct {
    bd_vec kt[2], ease[2], cubic[2], held[2], shift[3], kn, n0, floor, r0, r1, coupled;
} points;

BD_INLINE points load_points(const bd_time *t, size_t p) {
    points out;
    const double *x = t->point + p;
    const size_t s = t->stride;
    for (size_t d = 0; d < 2; ++d) {
        out.kt[d] = bd_load(x + (BD_TIME_KT + d) * s);
        out.ease[d] = bd_load(x + (BD_TIME_EASE + d) * s);
        out.cubic[d] = bd_load(x + (BD_TIME_CUBIC + d) * s);
        out.held[d] = bd_load(x + (BD_TIME_HELD + d) * s);
    }
    for (size_t d = 0; d < 3; ++d) out.shift[d] = bd_load(x + (BD_TIME_SHIFT + d) * s);
    out.kn = bd_load(x + BD_TIME_KN * s);
    out.n0 = bd_load(x + BD_TIME_N0 * s);
    out.floor = bd_load(x + BD_TIME_FLOOR * s);
    out.r0 = bd_load(x + BD_TIME_R0 * s);
    out.r1 = bd_load(x + BD_TIME_R1 * s);
    out.coupled = bd_load(x + BD_TIME_COUPLED * s);
    return out;
}

/* Forces F (3) at motion x (3); moves the sliders w, (2, stride) from the first of these points on. */
BD_INLINE void press(const bd_time *t, const points *at, const bd_vec *x, double *w, bd_vec *F) {
    const bd_vec zero = bd_all(0.0), one = bd_all(1.0);
    const bd_vec normal = bd_max(at->n0 + at->kn * x[2], at->floor), r = at->r0 + at->r1 * normal;
    bd_vec before[2], moved[2];
    for (size_t d = 0; d < 2; ++d) {
        const bd_vec reach = r * at->ease[d];
        before[d] = bd_load(w + d * t->stride);
        moved[d] = bd_min(bd_max(before[d], x[d] - reach), x[d] + reach);
    }
    if (t->has_coupled) {
        const bd_vec T0 = at->kt[0] * (x[0] - before[0]), T1 = at->kt[1] * (x[1] - before[1]);
        const bd_vec size = bd_root(T0 * T0 + T1 * T1);
        const bd_mask slips = bd_above(size, r);
        const bd_vec share = bd_select(slips, r / bd_select(slips, size, one), one);
        for (size_t d = 0; d < 2; ++d) {
            const bd_mask radial = bd_above(at->coupled, zero) & bd_above(at->kt[d], zero);
            moved[d] = bd_select(radial, x[d] - share * (x[d] - before[d]), moved[d]);
        }
    }
    for (size_t d = 0; d < 2; ++d) {
        moved[d] = bd_select(bd_above(at->held[d], zero), before[d], moved[d]);
        bd_store(w + d * t->stride, moved[d]);
        F[d] = at->kt[d] * (x[d] - moved[d]);
        if (t->has_cubic) F[d] = F[d] + at->cubic[d] * x[d] * x[d] * x[d];
    }
    F[2] = normal;
}

/* y = G eta of one family. */
BD_INLINE void move_family(const bd_time *t, int f, const double *G, double *y) {
    const size_t m = (size_t)t->n_mode[f], wide = (m + 7) / 8 * 8, rows = 3 * t->stride;
    const double *re = t->q + t->first[f], *im = re + wide;
    for (size_t row = 0; row < rows; row += 8, G += 16 * wide) {
        bd_vec rr[PART], ri[PART], ir[PART], ii[PART];
        for (int v = 0; v < PART; ++v) rr[v] = ri[v] = ir[v] = ii[v] = bd_all(0.0);
        for (size_t j = 0; j < m; ++j) {
            const bd_vec a = bd_all(re[j]), b = bd_all(im[j]);
            for (int v = 0; v < PART; ++v) {
                const bd_vec gr = bd_load(G + 16 * j + v * BD_WIDTH), gi = bd_load(G + 16 * j + 8 + v * BD_WIDTH);
                rr[v] += gr * a, ii[v] += gi * b;
                ri[v] += gr * b, ir[v] += gi * a;
            }
        }
        for (int v = 0; v < PART; ++v) {
            bd_store(y + row + v * BD_WIDTH, rr[v] - ii[v]);
            bd_store(y + rows + row + v * BD_WIDTH, ri[v] + ir[v]);
        }
    }
}

/* Modal force of one family over the modal mass, from the amplitudes z of the forces. */
BD_INLINE void press_family(const bd_time *t, int f, const double *G, const double *z) {
    const size_t wide = ((size_t)t->n_mode[f] + 7) / 8 * 8, rows = 3 * t->stride, first = (size_t)t->first[f];
    for (size_t j = 0; j < wide; j += 8, G += 16 * rows) {
        bd_vec rr[PART], ri[PART], ir[PART], ii[PART];
        for (int v = 0; v < PART; ++v) rr[v] = ri[v] = ir[v] = ii[v] = bd_all(0.0);
        for (size_t d = 0; d < 3; ++d)
            for (size_t row = d * t->stride; row < d * t->stride + (size_t)t->n_point; ++row) {
                const bd_vec a = bd_all(z[row]), b = bd_all(z[rows + row]);
                for (int v = 0; v < PART; ++v) {
                    const bd_vec gr = bd_load(G + 16 * row + v * BD_WIDTH), gi = bd_load(G + 16 * row + 8 + v * BD_WIDTH);
                    rr[v] += gr * a, ii[v] += gi * b;
                    ri[v] += gr * b, ir[v] += gi * a;
                }
            }
        for (int v = 0; v < PART; ++v) {
            const size_t at = first + j + (size_t)(v * BD_WIDTH);
            bd_store(t->pressed + at, bd_load(t->share + at) * (rr[v] + ii[v]));
            bd_store(t->pressed + at + wide, bd_load(t->share + at + wide) * (ri[v] - ir[v]));
        }
    }
}

/* Contacts of the sectors k and N - k (one sector if they are the same) at the points from p on. */
BD_INLINE void press_pair(const bd_time *t, const points *at, size_t p, size_t k) {
    const size_t n = (size_t)t->n_sector, s = t->stride, other = (n - k) % n;
    const double *phase = t->phase + 2 * k * (size_t)t->n_family;
    bd_vec even[3], odd[3], x[3], F[3], H[3];
    for (int d = 0; d < 3; ++d) even[d] = at->shift[d], odd[d] = bd_all(0.0);
    for (int f = 0; f < t->n_family; ++f) {
        const bd_vec c = bd_all(phase[2 * f]), sine = bd_all(phase[2 * f + 1]);
        const double *y = t->y + (size_t)f * 6 * s + p;
        for (size_t d = 0; d < 3; ++d) {
            even[d] += c * bd_load(y + d * s);
            odd[d] += sine * bd_load(y + (3 + d) * s);
        }
    }
    for (int d = 0; d < 3; ++d) x[d] = even[d] - odd[d];
    press(t, at, x, t->w + 2 * k * s + p, F);
    if (other == k)
        for (int d = 0; d < 3; ++d) H[d] = bd_all(0.0);
    else {
        for (int d = 0; d < 3; ++d) x[d] = even[d] + odd[d];
        press(t, at, x, t->w + 2 * other * s + p, H);
    }
    for (int d = 0; d < 3; ++d) even[d] = F[d] + H[d], odd[d] = F[d] - H[d];
    for (int f = 0; f < t->n_family; ++f) {
        const bd_vec c = bd_all(phase[2 * f]), sine = bd_all(phase[2 * f + 1]);
        double *z = t->z + (size_t)f * 6 * s + p;
        for (size_t d = 0; d < 3; ++d) {
            bd_store(z + d * s, bd_load(z + d * s) + c * even[d]);
            bd_store(z + (3 + d) * s, bd_load(z + (3 + d) * s) - sine * odd[d]);
        }
    }
}

static void press_all(bd_time *t) {
    const size_t size = 6 * t->stride;
    const double *out = t->out, *back = t->back;
    for (int f = 0; f < t->n_family; ++f) {
        move_family(t, f, out, t->y + (size_t)f * size);
        out += size * (((size_t)t->n_mode[f] + 7) / 8 * 8);
    }
    memset(t->z, 0, sizeof(double) * size * (size_t)t->n_family);
    for (size_t p = 0; p < (size_t)t->n_point; p += BD_WIDTH) {
        const points at = load_points(t, p);
        for (size_t k = 0; 2 * k <= (size_t)t->n_sector; ++k) press_pair(t, &at, p, k);
    }
    for (int f = 0; f < t->n_family; ++f) {
        press_family(t, f, back, t->z + (size_t)f * size);
        back += size * (((size_t)t->n_mode[f] + 7) / 8 * 8);
    }
}

/* a = excitation at step k, over the modal mass. */
BD_INLINE void excite(const bd_time *t, const bd_time_path *path, long k) {
    double *restrict a = t->a;
    const double angle = BD_TWO_PI * (double)(k % path->per_period) / path->per_period;
    memset(a, 0, sizeof(double) * t->n_coordinate);
    for (int i = 0; i < t->n_force; ++i) {
        const double c = cos(t->order[i] * angle), s = sin(t->order[i] * angle);
        const double *restrict C = t->force + 2 * (size_t)i * t->n_coordinate, *restrict S = C + t->n_coordinate;
        for (size_t j = 0; j < t->n_coordinate; ++j) a[j] += c * C[j] + s * S[j];
    }
}

/* Coordinates at step k to the trace, and the response to the harmonics of its period. */
BD_INLINE void observe(const bd_time *t, const bd_time_path *path, long k) {
    if (path->trace) bd_time_unpad(t, t->q, path->trace + 2 * (size_t)t->n_total * (size_t)k);
    const long period = k / path->per_period;
    if (!path->harmonic || period >= path->n_step / path->per_period) return;
    const double angle = BD_TWO_PI * (double)((path->first + k) % path->per_period) / path->per_period;
    const double c = cos(angle), s = sin(angle);
    double x = 0.0;
    for (size_t j = 0; j < t->n_coordinate; ++j) x += t->row[j] * t->q[j];
    const double part = x / path->per_period;
    double *X = path->harmonic + 2 * (size_t)period * (size_t)(path->n_harm + 1), re = 2.0, im = 0.0;
    X[0] += part;
    for (int l = 1; l <= path->n_harm; ++l) {
        const double turned = re * c - im * s;
        im = re * s + im * c;
        re = turned;
        X[2 * l] += part * re;
        X[2 * l + 1] -= part * im;
    }
}

void BD_JOIN(bd_time_march_, BD_VARIANT)(bd_time *t, const bd_time_path *path);
void BD_JOIN(bd_time_march_, BD_VARIANT)(bd_time *t, const bd_time_path *path) {
    const size_t n = t->n_coordinate;
    double *restrict q = t->q, *restrict v = t->v, *restrict a = t->a;
    const double *restrict pressed = t->pressed, *restrict omega2 = t->omega2, *restrict damping = t->damping;
    const double angle = BD_TWO_PI / path->per_period, square = path->omega * path->omega;
    const double slope = path->n_step > 0 ? (path->omega_end * path->omega_end - square) / (double)path->n_step : 0.0;
    double omega = path->omega;
    if (path->harmonic)
        memset(path->harmonic, 0,
               sizeof(double) * 2 * (size_t)(path->n_harm + 1) * (size_t)(path->n_step / path->per_period));
    press_all(t);
    excite(t, path, path->first);
    for (size_t j = 0; j < n; ++j) a[j] -= omega2[j] * q[j] + damping[j] * v[j] + pressed[j];
    for (long k = 0; k < path->n_step; ++k) {
        const double next = sqrt(square + slope * (double)(k + 1)), h = 2.0 * angle / (omega + next), half = 0.5 * h;
        omega = next;
        if (path->trace || path->harmonic) observe(t, path, k);
        for (size_t j = 0; j < n; ++j) {
            v[j] += half * a[j];
            q[j] += h * v[j];
        }
        press_all(t);
        excite(t, path, path->first + k + 1);
        for (size_t j = 0; j < n; ++j) {
            const double rest = a[j] - omega2[j] * q[j] - pressed[j];
            v[j] = (v[j] + half * rest) / (1.0 + half * damping[j]);
            a[j] = rest - damping[j] * v[j];
        }
    }
}

void BD_JOIN(bd_time_press_, BD_VARIANT)(bd_time *t);
void BD_JOIN(bd_time_press_, BD_VARIANT)(bd_time *t) { press_all(t); }
