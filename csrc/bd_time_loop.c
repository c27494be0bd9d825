/* March in time of all sectors; this file is compiled once for each instruction set.
 *
 * The motion is a superposition of families, one for each nodal diameter d, x_k = shift + sum_d Re[G_d q_d exp(i k d phi)],
 * phi = 2 pi/N, and obeys
 *
 *     m q_d'' + c q_d' + K q_d + g_d = E_d(t),     g_d = (c_d/N) G_d^H sum_k F_k exp(-i k d phi),     c_d = 2,
 *
 * or 1 with real coordinates where d = 0 or N/2.  A step h is that of the generalised alpha method (Chung and Hulbert 1993),
 *
 *     m [(1 - am) a+ + am a] + (1 - af) [c v+ + K q+ + g+ - E+] + af [c v + K q + g - E] = 0,
 *     q+ = q + h v + h^2 [(1/2 - b) a + b a+],     v+ = v + h [(1 - gamma) a + gamma a+],
 *
 * so that q+ = q* - beta g+ with q* from what is known.  A coordinate without mass has K q+ + g+ = E+, that is beta = 1/K.
 *
 * The law goes from one instant to the next: N = max(n0 + kn v, 0); the slider is clipped to u -+ r/kt with the limit r of
 * friction, mu N or mu times a given load; a coupled law draws the friction force back radially to the disk of radius r.
 *
 * The forces of all sectors are found at once.  A motion by contact forces is x = x* - V C V' F, where the columns of V are
 * patterns of the motion of one sector (bd_time.c), and C couples the sectors through their nodal diameters.  The unknowns
 * are p_k = V' F_k, a few in each sector, and their equation is
 *
 *     R(p) = V' F(x* - V C p) - p = 0,     with the Jacobian -(I + T C),     T = V' D V,
 *
 * D the 3 x 3 derivatives of the law in the state that each point is in.  Newton's method: a predictor with the states of the
 * last step; then corrections by GMRES, with M = (I + T)^-1 of each sector in front, in which
 *
 *     M (I + T C) x = y - M (y - x),     y = C x.
 *
 * A point that begins to slip, stick, open or close changes T by terms of rank one, and M by the Sherman-Morrison formula.
 * The best of four lengths of a correction is taken where the whole one makes the residual larger. */
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

/* y (2, rows) = G q of one family. */
BD_INLINE void move_family(const bd_time *t, int f, const double *G, double *y) {
    const size_t m = (size_t)t->n_mode[f], wide = (m + 7) / 8 * 8, rows = t->rows;
    const double *re = t->q_next + t->first[f], *im = re + wide;
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

/* Modal force of one family, N of it, from the amplitudes z (2, rows) of the forces. */
BD_INLINE void press_family(const bd_time *t, int f, const double *G, const double *z) {
    const size_t m = (size_t)t->n_mode[f], wide = (m + 7) / 8 * 8, rows = t->rows, first = (size_t)t->first[f];
    for (size_t j = 0; j < m; j += 8, G += 16 * rows) {
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

/* ---- between sectors and nodal diameters, for vectors of n entries, a multiple of 8 ---- */

/* out (n_sector, n) = sum over families of Re[y exp(i k d phi)], y (n_family, 2, n); two sectors k and N - k at a time: their
 * cosines are equal and their sines opposite. */
BD_INLINE void spread(const bd_time *t, size_t n, const double *y, double *out) {
    const size_t sectors = (size_t)t->n_sector;
    for (size_t k = 0; 2 * k <= sectors; ++k) {
        const size_t other = (sectors - k) % sectors;
        const double *phase = t->phase + 2 * k * (size_t)t->n_family;
        for (size_t i = 0; i < n; i += BD_WIDTH) {
            bd_vec even = bd_all(0.0), odd = even;
            for (int f = 0; f < t->n_family; ++f) {
                even += bd_all(phase[2 * f]) * bd_load(y + 2 * (size_t)f * n + i);
                odd += bd_all(phase[2 * f + 1]) * bd_load(y + (2 * (size_t)f + 1) * n + i);
            }
            bd_store(out + k * n + i, even - odd);
            if (other != k) bd_store(out + other * n + i, even + odd);
        }
    }
}

/* z (n_family, 2, n) = sum over sectors of x exp(-i k d phi), x (n_sector, n). */
BD_INLINE void gather(const bd_time *t, size_t n, const double *x, double *z) {
    const size_t sectors = (size_t)t->n_sector;
    memset(z, 0, sizeof(double) * 2 * n * (size_t)t->n_family);
    for (size_t k = 0; 2 * k <= sectors; ++k) {
        const size_t other = (sectors - k) % sectors;
        const double *phase = t->phase + 2 * k * (size_t)t->n_family;
        for (size_t i = 0; i < n; i += BD_WIDTH) {
            bd_vec even = bd_load(x + k * n + i), odd = even;
            if (other != k) {
                const bd_vec b = bd_load(x + other * n + i);
                odd = even - b, even = even + b;
            }
            for (int f = 0; f < t->n_family; ++f) {
                double *re = z + 2 * (size_t)f * n + i, *im = re + n;
                bd_store(re, bd_load(re) + bd_all(phase[2 * f]) * even);
                bd_store(im, bd_load(im) - bd_all(phase[2 * f + 1]) * odd);
            }
        }
    }
}

/* ---- products ---- */

/* C (m, n) = A (m, k) B (k, n), n a multiple of 8. */
BD_INLINE void multiply(size_t m, size_t n, size_t k, const double *A, const double *B, double *C) {
    enum { TILE = 4 };
    for (size_t i = 0; i < m; i += TILE) {
        const size_t height = m - i < TILE ? m - i : TILE;
        for (size_t j = 0; j < n; j += 8) {
            bd_vec sum[TILE][PART];
            for (int a = 0; a < TILE; ++a)
                for (int v = 0; v < PART; ++v) sum[a][v] = bd_all(0.0);
            if (height == TILE)
                for (size_t l = 0; l < k; ++l)
                    for (int v = 0; v < PART; ++v) {
                        const bd_vec b = bd_load(B + l * n + j + (size_t)v * BD_WIDTH);
                        for (size_t a = 0; a < TILE; ++a) sum[a][v] += bd_all(A[(i + a) * k + l]) * b;
                    }
            else
                for (size_t a = 0; a < height; ++a)
                    for (size_t l = 0; l < k; ++l)
                        for (int v = 0; v < PART; ++v)
                            sum[a][v] += bd_all(A[(i + a) * k + l]) * bd_load(B + l * n + j + (size_t)v * BD_WIDTH);
            for (size_t a = 0; a < height; ++a)
                for (int v = 0; v < PART; ++v) bd_store(C + (i + a) * n + j + (size_t)v * BD_WIDTH, sum[a][v]);
        }
    }
}

/* y (n) = A x, n a multiple of 8, with A in blocks of 8 rows, each column after column. */
BD_INLINE void multiply_blocks(size_t n, const double *A, const double *x, double *y) {
    for (size_t i = 0; i < n; i += 8) {
        bd_vec even[PART], odd[PART];
        for (int v = 0; v < PART; ++v) even[v] = odd[v] = bd_all(0.0);
        for (size_t j = 0; j < n; j += 2, A += 16)
            for (int v = 0; v < PART; ++v) {
                even[v] += bd_load(A + v * BD_WIDTH) * bd_all(x[j]);
                odd[v] += bd_load(A + 8 + v * BD_WIDTH) * bd_all(x[j + 1]);
            }
        for (int v = 0; v < PART; ++v) bd_store(y + i + v * BD_WIDTH, even[v] + odd[v]);
    }
}

/* u (n_sector, rank) = C p. */
static void comply(bd_time *t, const bd_time_step *step, const double *p, double *u) {
    const size_t r = (size_t)step->rank;
    const double *C = step->C;
    gather(t, r, p, t->z);
    for (int f = 0; f < t->n_family; ++f) {
        const double *zr = t->z + 2 * r * (size_t)f, *zi = zr + r;
        double *y = t->y + 2 * r * (size_t)f;
        for (size_t i = 0; i < r; i += 8) {
            bd_vec rr[PART], ri[PART], ir[PART], ii[PART];
            for (int v = 0; v < PART; ++v) rr[v] = ri[v] = ir[v] = ii[v] = bd_all(0.0);
            for (size_t j = 0; j < r; ++j, C += 16) {
                const bd_vec a = bd_all(zr[j]), b = bd_all(zi[j]);
                for (int v = 0; v < PART; ++v) {
                    const bd_vec cr = bd_load(C + v * BD_WIDTH), ci = bd_load(C + 8 + v * BD_WIDTH);
                    rr[v] += cr * a, ii[v] += ci * b;
                    ri[v] += cr * b, ir[v] += ci * a;
                }
            }
            for (int v = 0; v < PART; ++v) {
                bd_store(y + i + v * BD_WIDTH, rr[v] - ii[v]);
                bd_store(y + r + i + v * BD_WIDTH, ri[v] + ir[v]);
            }
        }
    }
    spread(t, r, t->y, u);
}

/* Sum of the entries, in pairs. */
BD_INLINE double total(bd_vec x) {
    double part[BD_WIDTH];
    bd_store(part, x);
    for (size_t half = BD_WIDTH / 2; half; half /= 2)
        for (size_t i = 0; i < half; ++i) part[i] += part[i + half];
    return part[0];
}

BD_INLINE double dot(size_t n, const double *a, const double *b) {
    bd_vec sum = bd_all(0.0), more = sum;
    size_t i = 0;
    for (; i + 2 * BD_WIDTH <= n; i += 2 * BD_WIDTH) {
        sum += bd_load(a + i) * bd_load(b + i);
        more += bd_load(a + i + BD_WIDTH) * bd_load(b + i + BD_WIDTH);
    }
    for (; i < n; i += BD_WIDTH) sum += bd_load(a + i) * bd_load(b + i);
    return total(sum + more);
}

/* y += c x */
BD_INLINE void add(size_t n, double c, const double *x, double *y) {
    for (size_t i = 0; i < n; i += BD_WIDTH) bd_store(y + i, bd_load(y + i) + bd_all(c) * bd_load(x + i));
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

/* M = (I + V' D V)^-1 of a sector, by Gauss and Jordan with row exchanges on the transposed matrix. */
static void renew(bd_time *t, const bd_time_step *step, size_t k) {
    const size_t r = (size_t)step->rank, s = t->stride;
    double *A = t->work, *M = t->M + k * r * r;
    int pivot[BD_TIME_MOST];
    memset(A, 0, sizeof(double) * r * r);
    for (size_t i = 0; i < r; ++i) A[i * r + i] = 1.0;
    for (size_t p = 0; p < (size_t)t->n_point; ++p) {
        const double *D = t->tangent + 9 * s * k + p;
        for (size_t d = 0; d < 3; ++d) {
            const double a = D[3 * d * s], b = D[(3 * d + 1) * s], c = D[(3 * d + 2) * s];
            if (a == 0.0 && b == 0.0 && c == 0.0) continue;
            const double *V0 = step->Vt + p * r, *V1 = V0 + s * r, *V2 = V1 + s * r, *own = step->Vt + (d * s + p) * r;
            for (size_t j = 0; j < r; ++j) add(r, a * V0[j] + b * V1[j] + c * V2[j], own, A + j * r);
        }
    }
    for (size_t c = 0; c < r; ++c) {
        size_t best = c;
        for (size_t i = c + 1; i < r; ++i)
            if (fabs(A[i * r + c]) > fabs(A[best * r + c])) best = i;
        pivot[c] = (int)best;
        for (size_t j = 0; best != c && j < r; ++j) {
            const double x = A[c * r + j];
            A[c * r + j] = A[best * r + j], A[best * r + j] = x;
        }
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
    for (size_t c = r; c-- > 0;)
        for (size_t i = 0; (size_t)pivot[c] != c && i < r; ++i) {
            const double x = A[i * r + c];
            A[i * r + c] = A[i * r + (size_t)pivot[c]], A[i * r + (size_t)pivot[c]] = x;
        }
    for (size_t i = 0; i < r; i += 8)
        for (size_t j = 0; j < r; ++j, M += 8) memcpy(M, A + j * r + i, 8 * sizeof *M);
    t->stale[k] = 0;
}

/* M of a sector after one entry of D, that of two rows of its points, has changed. */
static void update_inverse(bd_time *t, const bd_time_step *step, size_t k, size_t row, size_t column, double change) {
    const size_t r = (size_t)step->rank;
    const double *v = step->Vt + row * r, *u = step->Vt + column * r;
    double *M = t->M + k * r * r, a[BD_TIME_MOST], b[BD_TIME_MOST];
    multiply_blocks(r, M, v, a);
    const double below = 1.0 + change * dot(r, u, a);
    if (!(fabs(below) > BD_TIME_SINGULAR)) {
        t->stale[k] = 1;
        return;
    }
    for (size_t j = 0; j < r; ++j) {
        bd_vec sum = bd_all(0.0);
        for (size_t i = 0; i < r; i += BD_WIDTH) sum += bd_load(u + i) * bd_load(M + i / 8 * 8 * r + j * 8 + i % 8);
        b[j] = -change / below * total(sum);
    }
    for (size_t i = 0; i < r; i += 8)
        for (size_t j = 0; j < r; ++j, M += 8) add(8, b[j], a + i, M);
}

/* Brings the derivative of some points to that of their present state; changes of less than a twentieth are left. */
BD_NOT_INLINE void update_points(bd_time *t, const bd_time_step *step, size_t k, size_t p, const bd_vec *x, const double *w,
                                 bd_mask differs) {
    const size_t s = t->stride;
    for (size_t i = 0; i < BD_WIDTH && p + i < (size_t)t->n_point; ++i) {
        if (!bd_entry_int(differs, i)) continue;
        const double at[3] = {bd_entry(x[0], i), bd_entry(x[1], i), bd_entry(x[2], i)}, before[2] = {w[i], w[s + i]};
        double D[9], *known = t->tangent + 9 * s * k + p + i, change = 0.0, largest = 0.0;
        differentiate(t, p + i, at, before, D);
        for (size_t j = 0; j < 9; ++j) {
            change = larger(fabs(D[j] - known[j * s]), change);
            largest = larger(fabs(known[j * s]), largest);
        }
        if (!(change > 0.05 * largest)) continue;
        for (size_t j = 0; j < 9; ++j) {
            const double by = D[j] - known[j * s];
            known[j * s] = D[j];
            if (by != 0.0 && !t->stale[k]) update_inverse(t, step, k, j / 3 * s + p + i, j % 3 * s + p + i, by);
        }
    }
}

/* ---- contacts ---- */

/* Forces F (n_sector, rows) of all contacts at the motion x; moves the sliders. */
static void press_all(bd_time *t, const double *x, double *F) {
    const size_t s = t->stride;
    for (size_t p = 0; p < (size_t)t->n_point; p += BD_WIDTH) {
        const points at = load_points(t, p);
        for (size_t k = 0; k < (size_t)t->n_sector; ++k) {
            bd_vec now[3], force[3];
            for (size_t d = 0; d < 3; ++d) now[d] = bd_load(x + k * t->rows + d * s + p);
            press(t, &at, now, t->w + 2 * s * k + p, t->moved + 2 * s * k + p, force);
            for (size_t d = 0; d < 3; ++d) bd_store(F + k * t->rows + d * s + p, force[d]);
        }
    }
}

/* Derivatives of the states at the motion x. */
static void update_states(bd_time *t, const bd_time_step *step, const double *x) {
    const size_t s = t->stride;
    for (size_t p = 0; p < (size_t)t->n_point; p += BD_WIDTH) {
        const points at = load_points(t, p);
        for (size_t k = 0; k < (size_t)t->n_sector; ++k) {
            const double *w = t->w + 2 * s * k + p;
            double *known = t->state + s * k + p;
            bd_vec now[3];
            for (size_t d = 0; d < 3; ++d) now[d] = bd_load(x + k * t->rows + d * s + p);
            const bd_vec state = state_of(t, &at, now, w);
            const bd_mask differs = bd_differ(state, bd_load(known)) | bd_at_least(state, bd_all(SLIDES_IN_PLANE));
            bd_store(known, state);
            if (bd_any(differs)) update_points(t, step, k, p, now, w, differs);
        }
    }
    for (size_t k = 0; k < (size_t)t->n_sector; ++k)
        if (t->stale[k]) renew(t, step, k);
}

static void forget_inverse(bd_time *t) {
    for (int k = 0; k < t->n_sector; ++k) t->stale[k] = 1;
}

/* Motion x (n_sector, rows) of all points by the coordinates q_next. */
static void move_points(bd_time *t, double *x) {
    const size_t size = 2 * t->rows, s = t->stride;
    const double *G = t->out;
    for (int f = 0; f < t->n_family; ++f) {
        move_family(t, f, G, t->y + (size_t)f * size);
        G += size * (((size_t)t->n_mode[f] + 7) / 8 * 8);
    }
    spread(t, t->rows, t->y, x);
    for (size_t k = 0; k < (size_t)t->n_sector; ++k) add(3 * s, 1.0, t->point + BD_TIME_SHIFT * s, x + k * t->rows);
}

/* Modal forces of the contact forces F. */
static void press_modes(bd_time *t) {
    const size_t size = 2 * t->rows;
    const double *G = t->back;
    gather(t, t->rows, t->F, t->z);
    for (int f = 0; f < t->n_family; ++f) {
        press_family(t, f, G, t->z + (size_t)f * size);
        G += size * (((size_t)t->n_mode[f] + 7) / 8 * 8);
    }
}

/* ---- Newton's method for the contact forces of all sectors ---- */

/* out = M in, sector by sector. */
BD_INLINE void precondition(const bd_time *t, size_t r, const double *in, double *out) {
    for (size_t k = 0; k < (size_t)t->n_sector; ++k) multiply_blocks(r, t->M + k * r * r, in + k * r, out + k * r);
}

/* change: a solution of (I + T C) change = residual to a tenth, by GMRES. */
static void correct(bd_time *t, const bd_time_step *step) {
    enum { M = BD_TIME_VECTORS };
    const size_t r = (size_t)step->rank, n = r * (size_t)t->n_sector;
    double H[M + 1][M], c[M], s[M], g[M + 1];
    double *v = t->basis;
    memset(t->change, 0, sizeof(double) * n);
    precondition(t, r, t->residual, v);
    const double size = sqrt(dot(n, v, v));
    if (!(size > 0.0)) return;
    for (size_t i = 0; i < n; ++i) v[i] /= size;
    g[0] = size;
    int m = 0;
    while (m < M && fabs(g[m]) > BD_TIME_LINEAR * size) {
        double *now = v + (size_t)m * n, *next = now + n;
        comply(t, step, now, t->given);
        for (size_t i = 0; i < n; ++i) t->change[i] = t->given[i] - now[i];
        precondition(t, r, t->change, next);
        for (size_t i = 0; i < n; ++i) next[i] = t->given[i] - next[i];
        for (int i = 0; i <= m; ++i) {
            H[i][m] = dot(n, v + (size_t)i * n, next);
            add(n, -H[i][m], v + (size_t)i * n, next);
        }
        const double length = sqrt(dot(n, next, next));
        for (int i = 0; i < m; ++i) {
            const double x = H[i][m];
            H[i][m] = c[i] * x + s[i] * H[i + 1][m];
            H[i + 1][m] = c[i] * H[i + 1][m] - s[i] * x;
        }
        const double whole = sqrt(H[m][m] * H[m][m] + length * length);
        if (!(whole > 0.0)) break;
        c[m] = H[m][m] / whole, s[m] = length / whole;
        H[m][m] = whole;
        g[m + 1] = -s[m] * g[m];
        g[m] *= c[m];
        ++m;
        if (!(length > 1e-14 * whole)) break;
        for (size_t i = 0; i < n; ++i) next[i] /= length;
    }
    memset(t->change, 0, sizeof(double) * n);
    for (int i = m - 1; i >= 0; --i) {
        for (int j = i + 1; j < m; ++j) g[i] -= H[i][j] * g[j];
        g[i] /= H[i][i];
        add(n, g[i], v + (size_t)i * n, t->change);
    }
}

/* Forces at the motion x, and the residual of the patterns; returns its size. */
static double evaluate(bd_time *t, const bd_time_step *step) {
    const size_t n = (size_t)step->rank * (size_t)t->n_sector;
    press_all(t, t->x, t->F);
    multiply((size_t)t->n_sector, (size_t)step->rank, t->rows, t->F, step->Vt, t->residual);
    add(n, -1.0, t->p, t->residual);
    ++t->effort.n_iteration;
    return sqrt(dot(n, t->residual, t->residual));
}

/* Goes a share of the correction and back by what was gone before. */
static double go(bd_time *t, const bd_time_step *step, double share) {
    add(t->rows * (size_t)t->n_sector, -share, t->reach, t->x);
    add((size_t)step->rank * (size_t)t->n_sector, share, t->change, t->p);
    return evaluate(t, step);
}

/* The correction, in the best of four lengths; returns the size of the residual there. */
static double search(bd_time *t, const bd_time_step *step, double size) {
    double best = 1.0, gone = 1.0, least = go(t, step, 1.0);
    if (least < size) return least;
    for (double share = 0.5; share > 0.1; share *= 0.5) {
        const double here = go(t, step, share - gone);
        gone = share;
        if (here < least) best = share, least = here;
        if (here < size) break;
    }
    return best == gone ? least : go(t, step, best - gone);
}

/* Contact forces at the end of a step, from the motion x* without them in `base`: their motion x, the forces F. */
static void solve(bd_time *t, const bd_time_step *step, double tolerance, int predict) {
    const size_t r = (size_t)step->rank, sectors = (size_t)t->n_sector, n = r * sectors, rows = t->rows, s = t->stride;
    comply(t, step, t->p, t->given);
    multiply(sectors, rows, r, t->given, step->V, t->reach);
    for (size_t i = 0; i < rows * sectors; ++i) t->base[i] -= t->reach[i];
    if (predict) {
        for (size_t k = 0; k < sectors; ++k)
            for (size_t p = 0; p < s; p += BD_WIDTH) {
                bd_vec by[3];
                for (size_t d = 0; d < 3; ++d) {
                    const size_t at = k * rows + d * s + p;
                    by[d] = bd_load(t->base + at) - bd_load(t->x + at);
                }
                for (size_t d = 0; d < 3; ++d) {
                    const double *D = t->tangent + (9 * k + 3 * d) * s + p;
                    bd_store(t->tried + k * rows + d * s + p,
                             bd_load(D) * by[0] + bd_load(D + s) * by[1] + bd_load(D + 2 * s) * by[2]);
                }
            }
        multiply(sectors, r, rows, t->tried, step->Vt, t->residual);
        correct(t, step);
        comply(t, step, t->change, t->given);
        multiply(sectors, rows, r, t->given, step->V, t->reach);
        memcpy(t->x, t->base, sizeof(double) * rows * sectors);
    } else {
        memcpy(t->x, t->base, sizeof(double) * rows * sectors);
        memset(t->reach, 0, sizeof(double) * rows * sectors);
        memset(t->change, 0, sizeof(double) * n);
    }
    double size = go(t, step, 1.0);
    for (int i = 0;; ++i) {
        update_states(t, step, t->x);
        t->largest = larger(sqrt(dot(n, t->p, t->p)), t->largest);
        const double scale = larger(sqrt(dot(n, t->p, t->p)), 1e-6 * t->largest);
        if (size <= tolerance * scale || !(size < HUGE_VAL) || i == BD_TIME_NEWTON) break;
        correct(t, step);
        comply(t, step, t->change, t->given);
        multiply(sectors, rows, r, t->given, step->V, t->reach);
        size = search(t, step, size);
    }
    t->effort.n_unsolved += !(size <= BD_TIME_ENOUGH * larger(sqrt(dot(n, t->p, t->p)), 1e-6 * t->largest));
}

/* Contact forces and their modal forces at the end of a step; the sliders go along. */
static void meet(bd_time *t, const bd_time_step *step, double tolerance, int predict) {
    move_points(t, t->base);
    if (step->rank) {
        solve(t, step, tolerance, predict);
        ++t->effort.n_solved;
    } else {
        memcpy(t->x, t->base, sizeof(double) * t->rows * (size_t)t->n_sector);
        press_all(t, t->x, t->F);
    }
    press_modes(t);
    double *w = t->w;
    t->w = t->moved, t->moved = w;
}

/* ---- march ---- */

/* Excitation at an angle, added times a share. */
BD_INLINE void excite(const bd_time *t, double angle, double *e) {
    memset(e, 0, sizeof(double) * t->n_coordinate);
    for (int i = 0; i < t->n_force; ++i) {
        const double c = cos(t->order[i] * angle), s = sin(t->order[i] * angle);
        const double *restrict C = t->force + 2 * (size_t)i * t->n_coordinate, *restrict S = C + t->n_coordinate;
        for (size_t j = 0; j < t->n_coordinate; ++j) e[j] += c * C[j] + s * S[j];
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

/* Contact forces at the first instant, and for a fresh start what follows from the coordinates with mass: the others, and the
 * accelerations. */
static void begin(bd_time *t, const bd_time_path *path, double angle) {
    const size_t n = t->n_coordinate;
    if (path->fresh) bd_time_prepare(t, &t->steps[0], 0.0, 0.0);
    excite(t, angle, t->excited);
    memcpy(t->q_next, t->q, sizeof(double) * n);
    if (!path->fresh) {
        move_points(t, t->x);
        press_all(t, t->x, t->F);
        press_modes(t);
        double *w = t->w;
        t->w = t->moved, t->moved = w;
        return;
    }
    bd_time_ease(t, 0.0, 0.0, t->beta, t->ease);
    for (size_t j = 0; j < n; ++j)
        if (!(t->mass[j] > 0.0)) t->q_next[j] = t->excited[j] / t->stiffness[j];
    forget_inverse(t);
    meet(t, &t->steps[0], larger(1e-3 * path->tolerance, 1e-13), 0);
    for (size_t j = 0; j < n; ++j) {
        const double g = t->part[j] * t->pressed[j];
        t->q[j] = t->q_next[j] - t->beta[j] * g;
        t->a[j] =
            t->mass[j] > 0.0 ? (t->excited[j] - t->damping[j] * t->v[j] - t->stiffness[j] * t->q[j] - g) / t->mass[j] : 0.0;
    }
}

/* Patterns for a step, and the forces of the last one on them. */
static void use_step(bd_time *t, double h, double radius) {
    bd_time_step *step = &t->steps[1];
    bd_time_prepare(t, step, h, radius);
    multiply((size_t)t->n_sector, (size_t)step->rank, t->rows, t->F, step->Vt, t->p);
    forget_inverse(t);
    update_states(t, step, t->x);
}

/* What a step comes to without contact forces at its end, and then with them; `next` is the excitation there. */
static void take_step(bd_time *t, const bd_time_path *path, double h, const double *restrict next) {
    const bd_time_alpha w = bd_time_weights(path->radius);
    const size_t n = t->n_coordinate;
    double *restrict q = t->q, *restrict v = t->v, *restrict a = t->a, *restrict Q = t->q_next, *restrict A = t->a_next;
    const double *restrict m = t->mass, *restrict c = t->damping, *restrict K = t->stiffness, *restrict beta = t->beta,
                           *restrict ease = t->ease, *restrict part = t->part, *restrict pressed = t->pressed,
                           *restrict now = t->excited;
    const double late = 1.0 - w.af;
    for (size_t j = 0; j < n; ++j) {
        const double moved = q[j] + late * (h * v[j] + h * h * (0.5 - w.b) * a[j]);
        const double drag = c[j] * (v[j] + late * h * (1.0 - w.gamma) * a[j]);
        const double rest =
            late * next[j] + w.af * (now[j] - part[j] * pressed[j]) - m[j] * w.am * a[j] - drag - K[j] * moved;
        A[j] = ease[j] / late * rest;
        Q[j] = m[j] > 0.0 ? q[j] + h * v[j] + h * h * ((0.5 - w.b) * a[j] + w.b * A[j]) : beta[j] * next[j];
    }
    meet(t, &t->steps[1], path->tolerance, 1);
    for (size_t j = 0; j < n; ++j) {
        const double g = part[j] * pressed[j], end = Q[j] - beta[j] * g, faster = A[j] - ease[j] * g;
        v[j] = m[j] > 0.0 ? v[j] + h * ((1.0 - w.gamma) * a[j] + w.gamma * faster) : (end - q[j]) / h;
        q[j] = end;
        a[j] = faster;
    }
}

void BD_JOIN(bd_time_march_, BD_VARIANT)(bd_time *t, const bd_time_path *path);
void BD_JOIN(bd_time_march_, BD_VARIANT)(bd_time *t, const bd_time_path *path) {
    const double square = path->omega * path->omega;
    const double slope = path->n_step > 0 ? (path->omega_end * path->omega_end - square) / (double)path->n_step : 0.0;
    double omega = path->omega, before = 0.0;
    if (path->harmonic)
        memset(path->harmonic, 0,
               sizeof(double) * 2 * (size_t)(path->n_harm + 1) * (size_t)(path->n_step / path->per_period));
    begin(t, path, angle_of(path, path->first));
    for (long k = 0; k < path->n_step; ++k) {
        const double end = sqrt(square + slope * (double)(k + 1)), h = 2.0 * BD_TWO_PI / path->per_period / (omega + end);
        omega = end;
        if (path->trace || path->harmonic) observe(t, path, k);
        if (k == 0 || fabs(h - t->steps[1].h) > BD_TIME_APART * h) use_step(t, h, path->radius);
        if (h != before) bd_time_ease(t, h, path->radius, t->beta, t->ease);
        before = h;
        if (k % BD_TIME_ANEW == BD_TIME_ANEW - 1) forget_inverse(t);
        excite(t, angle_of(path, path->first + k + 1), t->coming);
        take_step(t, path, h, t->coming);
        double *e = t->excited;
        t->excited = t->coming, t->coming = e;
    }
}

void BD_JOIN(bd_time_press_, BD_VARIANT)(bd_time *t);
void BD_JOIN(bd_time_press_, BD_VARIANT)(bd_time *t) {
    memcpy(t->q_next, t->q, sizeof(double) * t->n_coordinate);
    move_points(t, t->x);
    press_all(t, t->x, t->F);
    double *w = t->w;
    t->w = t->moved, t->moved = w;
}
