"""Plain NumPy counterparts of the C kernels, written from the laws alone.

Events come from the roots of companion matrices, integrals from complex exponentials, the slider from the clip law
applied piece by piece, for many states at once: nothing is shared with the code under test but the equations.
"""

import math

import numpy as np


def basis(theta, n_harm):
    """(…, 2 n_harm + 1) values of [1, cos, sin, cos 2, …] at the angles theta."""
    theta = np.asarray(theta, float)[..., None]
    out = np.ones(theta.shape[:-1] + (2 * n_harm + 1,))
    l = np.arange(1, n_harm + 1)
    out[..., 1::2] = np.cos(l * theta)
    out[..., 2::2] = np.sin(l * theta)
    return out


def shift(x, delta):
    """Coefficients of x(theta + delta)."""
    y = np.array(x, float)
    l = np.arange(1, x.shape[-1] // 2 + 1)
    c, s = x[..., 1::2], x[..., 2::2]
    y[..., 1::2] = c * np.cos(l * delta) + s * np.sin(l * delta)
    y[..., 2::2] = s * np.cos(l * delta) - c * np.sin(l * delta)
    return y


def cubic(x, kt):
    """Force coefficients (3, n_coef) of the springs kt u^3 along both tangential directions, to rounding."""
    h = x.shape[1] // 2
    theta = (
        2 * np.pi * np.arange(8 * h + 8) / (8 * h + 8)
    )  # products of four polynomials are integrated exactly
    b = basis(theta, h)
    force = np.zeros_like(x)
    for d in range(2):
        force[d] = 2 * np.mean(kt[d] * (b @ x[d])[:, None] ** 3 * b, axis=0)
    force[:, 0] *= 0.5
    return force


def contact_sampled(x, kt, kn, mu, n0, w, n_time, interpolate, periods=2):
    """The clip law at n_time samples, followed over two periods."""
    h = x.shape[1] // 2
    b = basis(2 * np.pi * np.arange(n_time) / n_time, h)
    u, v = b @ x[:2].T, b @ x[2]
    g = n0 + kn * v
    normal = np.maximum(g, 0.0)
    friction = np.zeros((n_time, 2))
    load = g.tolist()  # numbers of Python: those of NumPy take five times as long one by one
    for d in range(2):
        if mu == 0.0 or kt[d] == 0.0:
            continue
        s, along, bound = float(w[d]), u[:, d].tolist(), (mu * normal / kt[d]).tolist()
        slider = [s] * n_time
        for k in range(periods * n_time):
            i, j = k % n_time, (k - 1) % n_time
            if interpolate and k > 0 and load[j] <= 0.0 < load[i]:
                t = -load[j] / (load[i] - load[j])
                s = (1 - t) * along[j] + t * along[i]
            slider[i] = s = min(max(s, along[i] - bound[i]), along[i] + bound[i])
        friction[:, d] = kt[d] * (u[:, d] - slider)
    scale = np.full(2 * h + 1, 2 / n_time)
    scale[0] = 1 / n_time
    return np.column_stack([friction, normal]).T @ b * scale


def split(u, n_mode):
    """Complex modal amplitudes of each harmonic from the vector of unknowns."""
    out, start = [], 0
    for l, n in enumerate(n_mode):
        if l == 0:
            out.append(u[:n].astype(complex))
            start = n
        else:
            out.append(u[start : start + n] - 1j * u[start + n : start + 2 * n])
            start += 2 * n
    return out


def at_angles(x, theta):
    """Values (R, K) of the signals x (R, M) at the angles theta (R, K), each row at its own."""
    return np.einsum("rkm,rm->rk", basis(theta, x.shape[1] // 2), x)


def derivatives(x):
    """Derivatives of the signals in the rows with respect to the angle."""
    d = np.zeros_like(x)
    l = np.arange(1, x.shape[1] // 2 + 1)
    d[:, 1::2], d[:, 2::2] = l * x[:, 2::2], -l * x[:, 1::2]
    return d


def exponentials(x):
    """(R, 2 H + 1) complex: coefficients of exp(i m theta), m = -H..H."""
    half = 0.5 * (x[:, 1::2] - 1j * x[:, 2::2])
    return np.hstack([half[:, ::-1].conj(), x[:, :1], half])


def roots_of_rows(f):
    """(R, 2 H) angles at which the trigonometric polynomials in the rows cross zero; 2 pi where there is no root."""
    n = f.shape[1] // 2
    out = np.full((len(f), 2 * n), 2 * np.pi)
    amplitude = np.hypot(f[:, 1::2], f[:, 2::2])
    size = np.abs(amplitude).max(axis=1)
    may = (size > 1e-290) & (np.abs(f[:, 0]) <= amplitude.sum(axis=1))
    degree = np.zeros(len(f), int)
    for l in range(1, n + 1):  # without leading coefficients that throw the companion matrix off
        degree[amplitude[:, l - 1] > 1e-10 * size] = l
    for l in range(1, n + 1):
        rows = np.flatnonzero(may & (degree == l))
        z = exponentials(f[rows, : 2 * l + 1])
        companion = np.zeros((len(rows), 2 * l, 2 * l), complex)
        companion[:, 0] = -z[:, -2::-1] / z[:, -1:]
        companion[:, np.arange(1, 2 * l), np.arange(2 * l - 1)] = 1.0
        r = np.linalg.eigvals(companion)
        theta = np.angle(r)
        slopes = derivatives(f[rows])
        for _ in range(3):  # polish on the circle, with all coefficients
            slope = at_angles(slopes, theta)
            theta = theta - np.where(
                slope != 0.0, at_angles(f[rows], theta) / np.where(slope == 0.0, 1.0, slope), 0.0
            )
        out[rows, : 2 * l] = np.where(
            np.abs(np.abs(r) - 1.0) < 1e-6, theta % (2 * np.pi), 2 * np.pi
        )
    return out


def projected(n_rows, row, start, end, f):
    """Fourier coefficients (n_rows, M) of signals that are f (P, M) on pieces (start, end) of the rows ``row``."""
    h = f.shape[1] // 2
    n = np.arange(-2 * h, 2 * h + 1)
    power = np.exp(1j * n * end[:, None]) - np.exp(1j * n * start[:, None])
    integral = power / np.where(n == 0, 1.0, 1j * n)
    integral[:, 2 * h] = end - start
    z = exponentials(f)
    out = np.zeros((n_rows, f.shape[1]))
    for l in range(h + 1):  # int f exp(-i l theta): exp(i m theta) meets n = m - l
        value = (z * integral[:, h - l : 3 * h + 1 - l]).sum(axis=1)
        if l == 0:
            np.add.at(out[:, 0], row, value.real / (2 * np.pi))
        else:
            np.add.at(out[:, 2 * l - 1], row, value.real / np.pi)
            np.add.at(out[:, 2 * l], row, -value.imag / np.pi)
    return out


def friction_of_rows(u, g, kt, mu, w, cuts_of_g):
    """Friction force (R, M) of many settled cycles: motion u, normal load g before it is cut at zero, slider w (R,)."""
    lo, hi = u - (mu / kt)[:, None] * g, u + (mu / kt)[:, None] * g
    everywhere = np.broadcast_to([0.0, 2 * np.pi], (len(u), 2))
    cuts = [cuts_of_g, roots_of_rows(derivatives(lo)), roots_of_rows(derivatives(hi)), everywhere]
    cuts = np.sort(np.hstack(cuts), axis=1)
    opened = at_angles(g, 0.5 * (cuts[:, 1:] + cuts[:, :-1])) <= 0.0
    motion_at, lo_at, hi_at = at_angles(u, cuts), at_angles(lo, cuts), at_angles(hi, cuts)
    before = np.zeros((len(u), cuts.shape[1]))
    for _ in range(3):
        for k in range(cuts.shape[1] - 1):
            before[:, k] = w
            w = np.where(
                opened[:, k],
                motion_at[:, k + 1],
                np.minimum(np.maximum(w, lo_at[:, k + 1]), hi_at[:, k + 1]),
            )
    forces = np.zeros_like(u)
    start, end, before = cuts[:, :-1], cuts[:, 1:], before[:, :-1]
    plus = ~opened & (lo_at[:, 1:] > before)
    minus = ~opened & ~plus & (hi_at[:, 1:] < before)
    onset = np.where(plus | minus, start, end)
    for slips, bound, at, sign in ((plus, lo, lo_at, 1.0), (minus, hi, hi_at, -1.0)):
        row, k = np.nonzero(
            slips & (sign * (before - at[:, :-1]) > 0.0)
        )  # points that stick before they slip
        a, b = start[row, k], end[row, k]
        for _ in range(54):
            middle = 0.5 * (a + b)
            sticks = sign * (before[row, k] - at_angles(bound[row], middle[:, None])[:, 0]) > 0.0
            a, b = np.where(sticks, middle, a), np.where(sticks, b, middle)
        onset[row, k] = 0.5 * (a + b)
        row, k = np.nonzero(slips)
        forces += projected(
            len(u), row, onset[row, k], end[row, k], (sign * mu[row])[:, None] * g[row]
        )
    row, k = np.nonzero(~opened & (onset > start))
    stuck = kt[row, None] * u[row]
    stuck[:, 0] -= kt[row] * before[row, k]
    return forces + projected(len(u), row, start[row, k], onset[row, k], stuck)


def contact(x, kt, kn, mu, n0, w):
    """Force coefficients (3, M) of one point."""
    return contacts(x[None, None], *[np.array([value]) for value in (kt, kn, mu, n0, w)])[0, 0]


def contacts(x, kt, kn, mu, n0, w):
    """Force coefficients of many states of all contact points: x (S, P, 3, M), kt and w (P, 2), kn, mu and n0 (P,)."""
    shape, m = x.shape, x.shape[3]
    force = np.zeros(shape)
    if not x.size:
        return force
    g = kn[:, None] * x[:, :, 2]
    g[..., 0] += n0
    g = g.reshape(-1, m)
    cuts = roots_of_rows(g)
    edges = np.sort(np.hstack([cuts, np.broadcast_to([0.0, 2 * np.pi], (len(g), 2))]), axis=1)
    row, k = np.nonzero(at_angles(g, 0.5 * (edges[:, 1:] + edges[:, :-1])) > 0.0)
    force[:, :, 2] = projected(len(g), row, edges[row, k], edges[row, k + 1], g[row]).reshape(
        *shape[:2], m
    )
    g, cuts = g.reshape(*shape[:2], m), cuts.reshape(*shape[:2], -1)
    for d in range(2):
        p = np.flatnonzero((mu > 0.0) & (kt[:, d] > 0.0))
        repeated = [np.tile(a[p], shape[0]) for a in (kt[:, d], mu, w[:, d])]
        rows = [a[:, p].reshape(-1, a.shape[2]) for a in (x[:, :, d], g, cuts)]
        found = friction_of_rows(rows[0], rows[1], *repeated, rows[2])
        force[:, p, d] = found.reshape(shape[0], len(p), m)
    return force


def motions(u, arrays):
    """(S, n_point, 3, n_coef) relative motion of many states at once."""
    a = arrays
    x = np.zeros((len(u), len(a["kn"]), 3, 2 * len(a["n_mode"]) - 1))
    for l, q in enumerate(split(u.T, a["n_mode"])):
        value = np.einsum("paj,js->spa", a["G"][l], q)
        if l == 0:
            x[..., 0] = value.real + a["shift"]
        else:
            x[..., 2 * l - 1], x[..., 2 * l] = value.real, -value.imag
    return x


def residual(u, omega, arrays, law=None):
    """Harmonic-balance residual of the arrays handed to the core (a dict of its arguments, G as a list).

    The law of a point is the exact separable one unless another is given.
    """
    return residuals(u[None], np.array([omega]), arrays, law)[0]


def residuals(u, omega, arrays, law=None):
    """residual() of many states at once: u (S, n_unknowns), omega (S,)."""
    a = arrays
    n_mode, u = a["n_mode"], np.asarray(u, float)
    x = motions(u, a)
    parameters = [a[name] for name in ("kt", "kn", "mu", "n0", "w")]
    if law is None:
        force = contacts(x, *parameters)
    else:
        force = np.array(
            [[law(*point) for point in zip(state, *parameters)] for state in x]
        ).reshape(x.shape)
    out, first = [], 0
    for l, (q, n) in enumerate(zip(split(u.T, n_mode), n_mode)):
        k, m, c = (a[key][first : first + n, None] for key in ("stiffness", "mass", "damping"))
        first += n
        if l == 0:
            out.append(k * q.real + np.einsum("paj,spa->js", a["G"][0].real, force[..., 0]))
        else:
            f = force[..., 2 * l - 1] - 1j * force[..., 2 * l]
            r = (k - (l * omega) ** 2 * m + 1j * l * omega * c) * q + np.einsum(
                "paj,spa->js", a["G"][l].conj(), f
            )
            out += [r.real, -r.imag]
    return np.concatenate(out).T - a["force"]


def coupled(x, kt, mu, load, w, n_time, periods=3):
    """Force of in-plane coupled friction by the projection method: at every instant the slider is drawn to the disk.

    Of first order in time; two step sizes together give second order.  States advance side by side.

    Parameters
    ----------
    x : (n, 2, n_coef) float
    kt : (n,) float
    load : callable, angles (k,) to (n, k) normal loads, already cut at zero
    w : (n, 2) float
    """
    h = x.shape[2] // 2
    theta = 2 * np.pi * np.arange(n_time) / n_time
    b = basis(theta, h)
    u = np.einsum("ndc,kc->knd", x, b)
    reach = mu[:, None] * load(theta) / kt[:, None]
    force = np.zeros((n_time, *w.shape))
    w = w.copy()
    for _ in range(periods):
        for k in range(n_time):
            away = u[k] - w
            size = np.hypot(away[:, 0], away[:, 1])
            draw = np.where(size > reach[:, k], reach[:, k] / np.where(size > 0, size, 1.0), 1.0)
            w = u[k] - away * draw[:, None]
            force[k] = kt[:, None] * (u[k] - w)
    scale = np.full(2 * h + 1, 2 / n_time)
    scale[0] = 1 / n_time
    return np.einsum("knd,kc->ndc", force, b * scale)


def settled_under_constant_load(x, limit, n_time, tolerance=1e-11):
    """Force (2, n_coef) of the projection method under a constant limit and unit stiffness, followed until it is settled.

    Thousands of periods, of which most are jumped: when the movement over a period shrinks by a steady factor, the slider
    is moved on by the sum of the geometric series, and it goes on from there.
    """
    h = x.shape[1] // 2
    b = basis(2 * np.pi * np.arange(n_time) / n_time, h)
    u = (b @ x[:2].T).tolist()

    def period(s):
        s0, s1 = s
        path = []
        for u0, u1 in u:
            a0, a1 = u0 - s0, u1 - s1
            size = math.hypot(a0, a1)
            if size > limit:
                s0, s1 = u0 - a0 * limit / size, u1 - a1 * limit / size
            path.append((u0 - s0, u1 - s1))
        return (s0, s1), path

    s, force = (0.0, 0.0), None
    for _ in range(200):
        moves = []
        for _ in range(30):
            before = s
            s, force = period(s)
            moves.append((s[0] - before[0], s[1] - before[1]))
        last, previous = (math.hypot(*m) for m in (moves[-1], moves[-2]))
        if last < tolerance:
            scale = np.full(2 * h + 1, 2 / n_time)
            scale[0] = 1 / n_time
            return np.array(force).T @ (b * scale)
        ratio = last / previous
        if ratio < 1.0:
            s = (
                s[0] + moves[-1][0] * ratio / (1.0 - ratio),
                s[1] + moves[-1][1] * ratio / (1.0 - ratio),
            )
    raise AssertionError("the oracle did not settle")
