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
 * friction, mu N or mu times a given load; a coupled law draws the friction force back radially to the disk of radius r.
 *
 * Coordinates s without mass (residual modes) obey at every instant the contact condition
 *
 *     r(s) = K s + P F(x(q, s), w) - E = 0,
 *
 * P the modal force.  Newton's method starts from s and its velocity at the last step, with the derivative H = K + P D A of the
 * state that each point is in, A the motion by s.  H is kept from step to step: a point that begins to slip, stick, open or
 * close adds the difference of its 3 x 3 derivative D.  As long as no state changes r is linear, and one correction solves it.
 *
 * Where thirty corrections do not (states that change in turn), chord iterations with the matrix C of closed, stuck contacts
 * follow.  For the normal contact, and for friction of a given limit, D lies between 0 and the spring, so that in the norm of C
 * each shortens the distance to the solution, by rho/(1 + rho) at least, rho the largest ratio of contact stiffness to K: a
 * contraction, from wherever it starts, but a slow one (rho is 46 on the shipped disk). */
#include "bd_time.h"
#include "bd_vector.h"

/* Vectors in a block of 8, and those that are summed side by side, so that sums need not wait for each other. */
enum { PART = 8 / BD_WIDTH, SUMS = BD_WIDTH == 8 ? 2 : PART };

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

/* Forces F (3) at motion x (3); moves the sliders from w to moved_w, (2, stride) from the first of these points on. */
BD_INLINE void press(const bd_time *t, const points *at, const bd_vec *x, const double *w, double *moved_w, bd_vec *F) {
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
        bd_store(moved_w + d * t->stride, moved[d]);
        F[d] = at->kt[d] * (x[d] - moved[d]);
        if (t->has_cubic) F[d] = F[d] + at->cubic[d] * x[d] * x[d] * x[d];
    }
    F[2] = normal;
}

/* y = G eta of one family, of its modes from `from` to `to`, besides `start` if there is one. */
BD_INLINE void move_family(const bd_time *t, int f, const double *G, size_t from, size_t to, const double *start,
                           double *y) {
    const size_t wide = ((size_t)t->n_mode[f] + 7) / 8 * 8, rows = 3 * t->stride;
    const double *re = t->q + t->first[f], *im = re + wide;
    for (size_t row = 0; row < rows; row += 8, G += 16 * wide) {
        bd_vec rr[PART], ri[PART], ir[PART], ii[PART];
        for (int v = 0; v < PART; ++v) rr[v] = ri[v] = ir[v] = ii[v] = bd_all(0.0);
        if (start)
            for (int v = 0; v < PART; ++v) {
                rr[v] = bd_load(start + row + v * BD_WIDTH);
                ri[v] = bd_load(start + rows + row + v * BD_WIDTH);
            }
        for (size_t j = from; j < to; ++j) {
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

/* Modal force of one family, N of it, on the modes from `from` to `to` (and others in their blocks of 8), from the amplitudes z
 * of the forces. */
BD_INLINE void press_family(const bd_time *t, int f, const double *G, size_t from, size_t to, const double *z) {
    const size_t wide = ((size_t)t->n_mode[f] + 7) / 8 * 8, rows = 3 * t->stride, first = (size_t)t->first[f];
    G += from / 8 * 16 * rows;
    for (size_t j = from / 8 * 8; j < to; j += 8, G += 16 * rows) {
        bd_vec rr[SUMS], ri[SUMS], ir[SUMS], ii[SUMS];
        for (int v = 0; v < SUMS; ++v) rr[v] = ri[v] = ir[v] = ii[v] = bd_all(0.0);
        for (size_t d = 0; d < 3; ++d)
            for (size_t row = d * t->stride; row < d * t->stride + (size_t)t->n_point; row += SUMS / PART)
                for (size_t v = 0; v < SUMS; ++v) { /* behind the last point there is room, and no force */
                    const double *g = G + 16 * (row + v / PART) + v % PART * BD_WIDTH;
                    const bd_vec a = bd_all(z[row + v / PART]), b = bd_all(z[rows + row + v / PART]);
                    const bd_vec gr = bd_load(g), gi = bd_load(g + 8);
                    rr[v] += gr * a, ii[v] += gi * b;
                    ri[v] += gr * b, ir[v] += gi * a;
                }
        for (int v = PART; v < SUMS; ++v)
            rr[v - PART] += rr[v], ri[v - PART] += ri[v], ir[v - PART] += ir[v], ii[v - PART] += ii[v];
        for (int v = 0; v < PART; ++v) {
            const size_t at = first + j + (size_t)(v * BD_WIDTH);
            bd_store(t->pressed + at, rr[v] + ii[v]);
            bd_store(t->pressed + at + wide, ri[v] - ir[v]);
        }
    }
}

/* ---- derivative of the forces, of which the contact condition has need ---- */

enum { SLIDES_IN_PLANE = 18 };

/* State of each point: 1 if it is closed, 2 or 4 (6 or 12) if it slips in the positive or negative sense; above these if the
 * derivative changes continuously. */
BD_INLINE bd_vec state_of(const bd_time *t, const points *at, const bd_vec *x, const double *w) {
    const bd_vec zero = bd_all(0.0), normal = at->n0 + at->kn * x[2], r = at->r0 + at->r1 * bd_max(normal, at->floor);
    const bd_mask closed = bd_above(normal, at->floor);
    bd_vec state = bd_select(closed, bd_all(1.0), zero), T[2];
    for (size_t d = 0; d < 2; ++d) {
        const bd_vec before = bd_load(w + d * t->stride), reach = r * at->ease[d];
        const bd_mask free = closed & ~bd_above(at->held[d], zero) & ~bd_above(at->coupled, zero);
        const bd_vec plus = bd_all(d ? 6.0 : 2.0), minus = bd_all(d ? 12.0 : 4.0);
        state += bd_select(free & bd_above(x[d] - reach, before), plus, zero);
        state += bd_select(free & bd_above(before, x[d] + reach), minus, zero);
        T[d] = at->kt[d] * (x[d] - before);
    }
    const bd_mask slides = closed & bd_above(at->coupled, zero) & bd_above(T[0] * T[0] + T[1] * T[1], r * r);
    const bd_mask cubic = bd_differ(at->cubic[0], zero) | bd_differ(at->cubic[1], zero);
    return state + bd_select(slides | cubic, bd_all(SLIDES_IN_PLANE), zero);
}

BD_INLINE double larger(double a, double b) { return a > b ? a : b; }

/* Derivative D (3, 3) of the forces of one point at motion x with slider w before. */
static void differentiate(const bd_time *t, size_t p, const double *x, const double *w, double *D) {
    const size_t s = t->stride;
    const double *c = t->point + p, *kt = c + BD_TIME_KT * s;
    const double normal = c[BD_TIME_N0 * s] + c[BD_TIME_KN * s] * x[2], floor = c[BD_TIME_FLOOR * s];
    const double kn = normal > floor ? c[BD_TIME_KN * s] : 0.0, along = c[BD_TIME_R1 * s] * kn;
    const double r = c[BD_TIME_R0 * s] + c[BD_TIME_R1 * s] * (normal > floor ? normal : floor);
    const double T[2] = {kt[0] * (x[0] - w[0]), kt[s] * (x[1] - w[1])}, size = sqrt(T[0] * T[0] + T[1] * T[1]);
    memset(D, 0, 9 * sizeof *D);
    D[8] = kn;
    for (size_t d = 0; d < 2; ++d) {
        const double reach = r * c[(BD_TIME_EASE + d) * s], k = kt[d * s];
        D[4 * d] = 3.0 * c[(BD_TIME_CUBIC + d) * s] * x[d] * x[d];
        if (c[(BD_TIME_HELD + d) * s] > 0.0)
            D[4 * d] += k;
        else if (!(r > 0.0)) /* open: the slider goes along */
            continue;
        else if (c[BD_TIME_COUPLED * s] > 0.0 && size > r) {
            for (size_t e = 0; e < 2; ++e) D[3 * d + e] -= r / (size * size * size) * T[d] * T[e] * kt[e * s];
            D[4 * d] += r / size * k;
            D[3 * d + 2] += along * T[d] / size;
        } else if (c[BD_TIME_COUPLED * s] > 0.0 || (w[d] >= x[d] - reach && w[d] <= x[d] + reach))
            D[4 * d] += k;
        else if (k > 0.0)
            D[3 * d + 2] += w[d] < x[d] ? along : -along;
    }
}

/* Brings the derivative of the points to that of their present state; changes of less than a twentieth are left. */
BD_NOT_INLINE void update_points(bd_time *t, size_t k, size_t p, const bd_vec *x, const double *w, bd_mask differs) {
    for (size_t i = 0; i < BD_WIDTH && p + i < (size_t)t->n_point; ++i) {
        if (!bd_entry_int(differs, i)) continue;
        const double at[3] = {bd_entry(x[0], i), bd_entry(x[1], i), bd_entry(x[2], i)},
                     before[2] = {w[i], w[t->stride + i]};
        double D[9], *known = t->tangent + 9 * (k * (size_t)t->n_point + p + i), change = 0.0, largest = 0.0;
        differentiate(t, p + i, at, before, D);
        for (int j = 0; j < 9; ++j) {
            D[j] -= known[j];
            change = larger(fabs(D[j]), change);
            largest = larger(fabs(known[j]), largest);
        }
        if (!(change > 0.05 * largest)) continue;
        for (int j = 0; j < 9; ++j) known[j] += D[j];
        bd_time_add(t, k, p + i, D, t->H);
        t->has_changed = 1;
    }
}

/* ---- contacts ---- */

/* Contacts of the sectors k and N - k (one sector if they are the same) at the points from p on. */
BD_INLINE void press_pair(bd_time *t, const points *at, size_t p, size_t k, const int implicit) {
    const size_t n = (size_t)t->n_sector, s = t->stride;
    const double *phase = t->phase + 2 * k * (size_t)t->n_family;
    const size_t sector[2] = {k, (n - k) % n};
    bd_vec even[3], odd[3], x[3], F[2][3];
    for (int d = 0; d < 3; ++d) even[d] = at->shift[d], odd[d] = F[1][d] = bd_all(0.0);
    for (int f = 0; f < t->n_family; ++f) {
        const bd_vec c = bd_all(phase[2 * f]), sine = bd_all(phase[2 * f + 1]);
        const double *y = t->y + (size_t)f * 6 * s + p;
        for (size_t d = 0; d < 3; ++d) {
            even[d] += c * bd_load(y + d * s);
            odd[d] += sine * bd_load(y + (3 + d) * s);
        }
    }
    for (size_t i = 0; i < (sector[1] == k ? 1 : 2); ++i) {
        const size_t from = 2 * sector[i] * s + p;
        for (int d = 0; d < 3; ++d) x[d] = i ? even[d] + odd[d] : even[d] - odd[d];
        press(t, at, x, t->w + from, (implicit ? t->moved : t->w) + from, F[i]);
        if (implicit) {
            double *known = t->state + sector[i] * s + p;
            const bd_vec state = state_of(t, at, x, t->w + from);
            const bd_mask differs = bd_differ(state, bd_load(known)) | bd_at_least(state, bd_all(SLIDES_IN_PLANE));
            bd_store(known, state);
            if (bd_any(differs)) update_points(t, sector[i], p, x, t->w + from, differs);
        }
    }
    for (int d = 0; d < 3; ++d) even[d] = F[0][d] + F[1][d], odd[d] = F[0][d] - F[1][d];
    for (int f = 0; f < t->n_family; ++f) {
        const bd_vec c = bd_all(phase[2 * f]), sine = bd_all(phase[2 * f + 1]);
        double *z = t->z + (size_t)f * 6 * s + p;
        for (size_t d = 0; d < 3; ++d) {
            bd_store(z + d * s, bd_load(z + d * s) + c * even[d]);
            bd_store(z + (3 + d) * s, bd_load(z + (3 + d) * s) - sine * odd[d]);
        }
    }
}

/* All contacts at the motion of the amplitudes y: amplitudes z of the forces. */
BD_INLINE void press_points(bd_time *t, const int implicit) {
    memset(t->z, 0, sizeof(double) * 6 * t->stride * (size_t)t->n_family);
    for (size_t p = 0; p < (size_t)t->n_point; p += BD_WIDTH) {
        const points at = load_points(t, p);
        for (size_t k = 0; 2 * k <= (size_t)t->n_sector; ++k) press_pair(t, &at, p, k, implicit);
    }
}

enum { WITH_MASS = 1, WITHOUT_MASS = 2, EVERY_MODE = 3 };

BD_INLINE void move_families(const bd_time *t, int which, const double *start, double *y) {
    const size_t size = 6 * t->stride;
    const double *G = t->out;
    for (int f = 0; f < t->n_family; ++f) {
        const size_t m = (size_t)t->n_mode[f], heavy = (size_t)t->n_heavy[f], at = (size_t)f * size;
        move_family(t, f, G, which & WITH_MASS ? 0 : heavy, which & WITHOUT_MASS ? m : heavy, start ? start + at : NULL,
                    y + at);
        G += size * ((m + 7) / 8 * 8);
    }
}

BD_INLINE void press_families(const bd_time *t, int which) {
    const size_t size = 6 * t->stride;
    const double *G = t->back;
    for (int f = 0; f < t->n_family; ++f) {
        const size_t m = (size_t)t->n_mode[f], heavy = (size_t)t->n_heavy[f];
        press_family(t, f, G, which & WITH_MASS ? 0 : heavy, which & WITHOUT_MASS ? m : heavy, t->z + (size_t)f * size);
        G += size * ((m + 7) / 8 * 8);
    }
}

/* Residual of the contact condition at an angle of the excitation; returns the largest. */
static double condition(bd_time *t, double angle) {
    const size_t n = (size_t)t->n_slack;
    double worst = 0.0;
    for (size_t i = 0; i < n; ++i) {
        const double held = t->stiffness[i] * t->q[t->slack[i]], pressed = t->part[i] * t->pressed[t->slack[i]];
        t->residual[i] = held + pressed;
        t->largest = larger(larger(fabs(held), fabs(pressed)), t->largest);
    }
    for (size_t f = 0; f < (size_t)t->n_force; ++f) {
        const double c = cos(t->order[f] * angle), s = sin(t->order[f] * angle), *C = t->push + 2 * f * n, *S = C + n;
        for (size_t i = 0; i < n; ++i) t->residual[i] -= c * C[i] + s * S[i];
    }
    for (size_t i = 0; i < n; ++i) worst = larger(fabs(t->residual[i]), worst);
    return worst;
}

/* Solves the contact condition for the coordinates without mass, and leaves the forces of the others. */
static void solve(bd_time *t, double angle) {
    const size_t n = (size_t)t->n_slack;
    int trial = 0;
    move_families(t, WITH_MASS, NULL, t->base);
    for (;; ++trial) {
        move_families(t, WITHOUT_MASS, t->base, t->y);
        press_points(t, 1);
        press_families(t, WITHOUT_MASS);
        if (condition(t, angle) <= BD_TIME_TOLERANCE * t->largest || trial == BD_TIME_NEWTON + BD_TIME_CHORD) break;
        if (trial < BD_TIME_NEWTON) {
            if (t->has_changed) {
                memcpy(t->lu, t->H, sizeof(double) * n * n);
                bd_time_factor(t->n_slack, t->lu, t->pivot);
                t->has_changed = 0;
            }
            bd_time_solve(t->n_slack, t->lu, t->pivot, t->residual);
        } else
            bd_time_solve(t->n_slack, t->closed, t->pivot_closed, t->residual);
        for (size_t i = 0; i < n; ++i) t->q[t->slack[i]] -= t->residual[i];
    }
    press_families(t, WITH_MASS);
    t->effort.n_solved += 1;
    t->effort.n_iteration += trial + 1;
    t->effort.n_unsolved += trial == BD_TIME_NEWTON + BD_TIME_CHORD;
    double *w = t->w;
    t->w = t->moved, t->moved = w;
}

static void press_all(bd_time *t, double angle) {
    if (t->n_slack) {
        solve(t, angle);
        return;
    }
    move_families(t, EVERY_MODE, NULL, t->y);
    press_points(t, 0);
    press_families(t, EVERY_MODE);
}

/* ---- march ---- */

/* a = excitation at an angle, over the modal mass. */
BD_INLINE void excite(const bd_time *t, double angle) {
    double *restrict a = t->a;
    memset(a, 0, sizeof(double) * t->n_coordinate);
    for (int i = 0; i < t->n_force; ++i) {
        const double c = cos(t->order[i] * angle), s = sin(t->order[i] * angle);
        const double *restrict C = t->force + 2 * (size_t)i * t->n_coordinate, *restrict S = C + t->n_coordinate;
        for (size_t j = 0; j < t->n_coordinate; ++j) a[j] += c * C[j] + s * S[j];
    }
}

BD_INLINE double angle_of(const bd_time_path *path, long k) {
    return BD_TWO_PI * (double)(k % path->per_period) / path->per_period;
}

/* Coordinates at step k to the trace, and the response to the harmonics of its period. */
BD_INLINE void observe(const bd_time *t, const bd_time_path *path, long k) {
    if (path->trace) bd_time_unpad(t, t->q, path->trace + 2 * (size_t)t->n_total * (size_t)k);
    const long period = k / path->per_period;
    if (!path->harmonic || period >= path->n_step / path->per_period) return;
    const double angle = angle_of(path, path->first + k), c = cos(angle), s = sin(angle);
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

/* Half a step of the velocities and a whole one of the coordinates, which extrapolates those without mass. */
BD_INLINE void drift(bd_time *t, double h) {
    double *restrict q = t->q, *restrict v = t->v;
    const double *restrict a = t->a;
    for (int i = 0; i < t->n_slack; ++i) t->before[i] = q[t->slack[i]];
    for (size_t j = 0; j < t->n_coordinate; ++j) {
        v[j] += 0.5 * h * a[j];
        q[j] += h * v[j];
    }
}

/* The other half of the velocities, and the accelerations, for the excitation in their place. */
BD_INLINE void kick(bd_time *t, double h) {
    double *restrict v = t->v, *restrict a = t->a;
    const double *restrict q = t->q, *restrict pressed = t->pressed, *restrict omega2 = t->omega2,
                           *restrict damping = t->damping, *restrict share = t->share;
    for (size_t j = 0; j < t->n_coordinate; ++j) {
        const double rest = a[j] - omega2[j] * q[j] - share[j] * pressed[j];
        v[j] = (v[j] + 0.5 * h * rest) / (1.0 + 0.5 * h * damping[j]);
        a[j] = rest - damping[j] * v[j];
    }
    for (int i = 0; i < t->n_slack; ++i) v[t->slack[i]] = (q[t->slack[i]] - t->before[i]) / h;
}

void BD_JOIN(bd_time_march_, BD_VARIANT)(bd_time *t, const bd_time_path *path);
void BD_JOIN(bd_time_march_, BD_VARIANT)(bd_time *t, const bd_time_path *path) {
    const double square = path->omega * path->omega;
    const double slope = path->n_step > 0 ? (path->omega_end * path->omega_end - square) / (double)path->n_step : 0.0;
    double omega = path->omega, angle = angle_of(path, path->first);
    if (path->harmonic)
        memset(path->harmonic, 0,
               sizeof(double) * 2 * (size_t)(path->n_harm + 1) * (size_t)(path->n_step / path->per_period));
    press_all(t, angle);
    excite(t, angle);
    for (size_t j = 0; j < t->n_coordinate; ++j)
        t->a[j] -= t->omega2[j] * t->q[j] + t->damping[j] * t->v[j] + t->share[j] * t->pressed[j];
    for (long k = 0; k < path->n_step; ++k) {
        const double next = sqrt(square + slope * (double)(k + 1)), h = 2.0 * BD_TWO_PI / path->per_period / (omega + next);
        omega = next;
        angle = angle_of(path, path->first + k + 1);
        if (path->trace || path->harmonic) observe(t, path, k);
        drift(t, h);
        press_all(t, angle);
        excite(t, angle);
        kick(t, h);
    }
}

void BD_JOIN(bd_time_press_, BD_VARIANT)(bd_time *t);
void BD_JOIN(bd_time_press_, BD_VARIANT)(bd_time *t) {
    move_families(t, EVERY_MODE, NULL, t->y);
    press_points(t, 0);
}
