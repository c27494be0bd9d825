"""What every implementation of equations in the core keeps to, whoever solves them: one line for each in ``KINDS``.

J and C against finite differences; solutions with the bordered matrix, its transpose and its orientation against NumPy; the
gradient of what vanishes at a fold or peak against differences along the curve; NaN in, status out; nothing depends on the
call before; nothing depends on units.  The order of the calls is tested in ``tests/c/test_solver.c``.
"""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_array_equal

from bdamper import _core
from tests.cases import random_arrays
from tests.compare import assert_close, assert_near
from tests.each import each

OK, NOT_FINITE = 0, 4
SIZES = {"wheel": (27, 6)}
"""Unknowns and contact points, where they are not 8 and 4."""


def sector(rng, **options):
    return _core.SectorEquations(**random_arrays(rng, (2, 3), 4), **options)


def ramp(rng, **options):
    return _core.Eased(sector(rng, **options), 0.7, rng.normal(size=8))


def support(rng, **options):
    return _core.Eased(sector(rng, **options), 0.7, rng.normal(size=8), rng.normal(size=(8, 8)))


def family(rng, **options):
    arrays = random_arrays(rng, (2, 3), 4)
    nodes = tuple(
        _core.SectorEquations(**{**arrays, "stiffness": arrays["stiffness"] * (1.0 + 0.1 * k)})
        for k in range(3)
    )
    squares = np.array([0.04, 0.25, 0.64])
    return _core.SectorEquations(**arrays, nodes=nodes, squares=squares, order=1.0, **options)


def modes(rng, **options):
    return _core.Modes(
        _core.SectorEquations(**random_arrays(rng, (2, 2), 4)),
        *rng.normal(size=(2, 6)),
        0.8,
        **options,
    )


def wheel(rng, **options):
    """Three blades of two coordinates with dampers of one, of the mean and the first harmonic; or what options ask for."""
    return _core.Wheel(**(wheel_arrays(rng) | options))


def wheel_arrays(rng, sectors=3, harmonics=1):
    """Root coordinates and dampings of all waves couple all sectors; contacts slip and lift."""

    def symmetric(n, size):
        a = rng.normal(size=(n, n))
        return size * (a @ a.T / n + np.eye(n))

    n_coef, points, half = 2 * harmonics + 1, 2 * sectors, sectors // 2 + 1
    n = 3 * sectors * n_coef
    turn = np.exp(2j * np.pi * np.arange(half) / sectors)[:, None, None]
    disk = symmetric(1, 0.4) - 0.1 * (turn + turn.conj())
    loss = symmetric(2, 0.05) - 0.01 * (turn + turn.conj()) * np.eye(2)
    return {
        "n_sector": sectors, "n_harm": harmonics, "n_blade": 2, "n_damper": 1, "n_root": 1, "n_kept": 1, "n_point": 2,
        "next": np.array([False, True]), "rows": rng.normal(size=(2, 3, 3)), "active": np.ones(n_coef, bool),
        "pinned": np.zeros(sectors, bool), "stiffness": np.array([symmetric(2, 1.0) for _ in range(sectors)]),
        "mass": symmetric(2, 0.5), "disk_stiffness": disk.astype(complex), "disk_mass": 0.1 * disk.astype(complex),
        "damping": loss.astype(complex), "damper_stiffness": np.array([0.3]),
        "damper_mass": rng.uniform(0.5, 1.0, (sectors, 1)),
        "damper_damping": np.array([0.1]), "springs": rng.uniform(0.1, 0.2, (sectors, 1)),
        "neutral": np.zeros((sectors, 1)),
        "home": rng.normal(size=(sectors, 1)), "kt": rng.uniform(0.5, 2.0, (points, 2)),
        "kn": rng.uniform(0.5, 2.0, points),
        "mu": rng.uniform(0.1, 0.6, points), "n0": rng.normal(size=points), "w": 0.1 * rng.normal(size=(points, 2)),
        "law": np.zeros(points, np.intc), "load": np.ones(points), "shift": 0.1 * rng.normal(size=(points, 3)),
        "force": rng.normal(size=n), "row_scale": np.ones(n),
    }  # fmt: skip


KINDS = {
    "sector": sector,
    "ramp": ramp,
    "support": support,
    "family": family,
    "modes": modes,
    "wheel": wheel,
}
DENSE = [name for name in KINDS if name != "wheel"]


@pytest.fixture(params=KINDS)
def kind(request):
    return KINDS[request.param]


def size(kind):
    """Unknowns of a kind."""
    return SIZES.get(kind.__name__, (8, 4))[0]


def point(rng, n):
    return np.append(0.5 * rng.normal(size=n), rng.uniform(0.4, 0.7))


def evaluated(equations, y):
    """Outputs are NaN before."""
    N = equations.n_unknown
    r, J, C = np.full(N, np.nan), np.full((N, N), np.nan), np.full(N, np.nan)
    assert equations.evaluate(y, r, J, C) == OK
    return r, J, C


def differences(equations, y, h):
    ends = [[evaluated(equations, y + s * h * e)[0] for s in (1.0, -1.0)] for e in np.eye(len(y))]
    return np.array([(a - b) / (2.0 * h) for a, b in ends]).T


def smooth_points(kind, count=5):
    """Equations and points with no event within the steps of differences."""
    rng, found, N = default_rng(11), 0, size(kind)
    for _ in range(200):
        equations, y = kind(rng), point(rng, N)
        whole = differences(equations, y, 1e-5)
        if np.abs(whole - differences(equations, y, 3e-6)).max() < 1e-7 * np.abs(whole).max():
            yield rng, equations, y, whole
            found += 1
        if found == count:
            return
    raise AssertionError("too few points without events")


def solved(kind):
    """A point of a curve, with its tangent."""
    rng, N = default_rng(12), size(kind)
    for _ in range(60):
        equations, y, tangent = kind(rng), point(rng, N), np.empty(N + 1)
        row = np.append(np.zeros(N), 1.0)
        if equations.solve(y, tangent, np.ones(N + 1), 1e-12, 60, True, row=row).status == OK:
            return rng, equations, y, tangent
    raise AssertionError("no solution")


def bordered_matrix(equations, y, row, scale):
    _, J, C = evaluated(equations, y)
    return np.vstack([np.column_stack([J, C]) * scale, row])


def test_derivatives_are_those_of_the_residual(kind):
    for _, equations, y, expected in smooth_points(kind):
        r, J, C = evaluated(equations, y)
        assert_close(np.column_stack([J, C]), expected, 1e-7)
        alone = np.full(size(kind), np.nan)
        assert equations.evaluate(y, alone) == OK
        assert_array_equal(alone, r)


@each("transposed", [False, True])
def test_bordered_solutions_are_those_of_dense_algebra(kind, transposed):
    rng, N = default_rng(13), size(kind)
    orientations = set()
    for _ in range(12):
        equations, y, row, scale = (
            kind(rng),
            point(rng, N),
            rng.normal(size=N + 1),
            rng.uniform(0.1, 10.0, N + 1),
        )
        B = bordered_matrix(equations, y, row, scale)
        if np.linalg.cond(B) > 1e6:
            continue
        right = rng.normal(size=(3, N + 1))
        found = right.copy()
        status, condition, rank, orientation = equations.bordered(y, row, scale, found, transposed)
        expected = np.linalg.solve(B.T if transposed else B, right.T).T
        assert_close(found, expected, 1e-9)
        assert (status, rank, orientation) == (OK, N + 1, np.sign(np.linalg.det(B)))
        assert 0.0 < condition <= 1.0
        orientations.add(orientation)
    assert orientations == {-1, 1}


@each("kind", [KINDS[name] for name in DENSE])
@each("transposed", [False, True])
def test_a_singular_matrix_gives_the_solution_of_least_norm(kind, transposed):
    """The border repeats a row of the Jacobian."""
    rng, N = default_rng(14), size(kind)
    equations, y, scale = kind(rng), point(rng, N), np.ones(N + 1)
    _, J, C = evaluated(equations, y)
    row = np.append(J, C[:, None], axis=1)[3]
    B = bordered_matrix(equations, y, row, scale)
    sizes = np.diag(1.0 / np.abs(B).max(axis=1))  # least squares are those of rows of unit size
    right = B @ rng.normal(size=N + 1) if not transposed else B.T @ rng.normal(size=N + 1)
    found = right[None].copy()
    status, condition, rank, orientation = equations.bordered(y, row, scale, found, transposed)
    assert (status, rank, orientation) == (OK, N, 0)
    assert condition < 1e-14
    matrix = (sizes @ B).T if transposed else sizes @ B
    expected = np.linalg.lstsq(matrix, right if transposed else sizes @ right, rcond=1e-13)[0]
    expected = sizes @ expected if transposed else expected
    assert_close(found[0], expected, 1e-9)


@each("peak", [True, False])
def test_gradients_are_differences_along_the_curve(kind, peak):
    """A slope at any point is that of the null vector of [J C] there."""
    rng, equations, y, tangent = solved(kind)
    N = size(kind)
    scale = rng.uniform(0.5, 2.0, N + 1)
    t = tangent / scale
    t /= np.linalg.norm(t)
    re, im = rng.normal(size=(2, N))

    def slope(at):
        B = bordered_matrix(equations, at, t, scale)
        v = np.linalg.solve(B, np.append(np.zeros(N), 1.0))
        v /= np.linalg.norm(v)
        x, change = (complex(re @ z[:-1], im @ z[:-1]) for z in (at, v * scale))
        return (x.conjugate() * change).real / abs(x) ** 2 if peak else v[-1]

    row, nu = np.full(N + 1, np.nan), np.full(N, np.nan)
    assert equations.gradient(y, t, scale, row, nu, 1e-5, *((re, im) if peak else ())) == OK
    h = 1e-5
    expected = [
        (slope(y + h * e * scale) - slope(y - h * e * scale)) / (2.0 * h) for e in np.eye(N + 1)
    ]
    assert_close(row, expected, 1e-5)
    # multipliers: another derivative by the parameter
    a = np.append(np.zeros(N), 1.0)
    if peak:
        x = complex(re @ y[:-1], im @ y[:-1])
        a[:-1] = (x.real * re + x.imag * im) * scale[:-1] / abs(x) ** 2
        a[-1] = 0.0
    dual = np.linalg.solve(bordered_matrix(equations, y, t, scale).T, a)
    assert_near(nu, dual[:-1], 1e-9 * np.abs(dual).max())


@each(("place", "value"), [(2, np.nan), (-1, np.nan), (-1, np.inf)])
def test_a_number_that_is_none_gives_a_status(kind, place, value):
    rng, N = default_rng(15), size(kind)
    equations, y = kind(rng), point(rng, N)
    bad = y.copy()
    bad[place] = value
    ones, row, right = np.ones(N + 1), np.append(np.zeros(N), 1.0), np.ones((1, N + 1))
    points = SIZES.get(kind.__name__, (8, 4))[1]
    for given, status in (
        (bad, NOT_FINITE),
        (y, OK),
        (bad, NOT_FINITE),
    ):  # before any other call, and after one
        X, F, share = (
            np.full((points, 3, 3), 7.0),
            np.full((points, 3, 3), 7.0),
            np.full((points, 5), 7.0),
        )
        assert equations.contact(given, X, F, share) == status
        assert all((np.isnan(x) if status else np.isfinite(x)).all() for x in (X, F, share))
    r = np.full(N, 7.0)
    assert equations.evaluate(bad, r) == NOT_FINITE
    assert (r == 7.0).all()
    assert equations.bordered(bad, row, ones, right)[0] == NOT_FINITE
    assert equations.gradient(bad, row, ones, np.empty(N + 1), np.empty(N), 1e-5) == NOT_FINITE
    assert np.isfinite(equations.solve(y.copy(), row.copy(), ones, 1e-9, 10, row=row).shares).all()
    out = equations.solve(bad, row.copy(), ones, 1e-9, 10, row=row)
    assert out.status == NOT_FINITE
    assert np.isinf(out.residual)
    assert np.isnan(out.shares).all()
    # and the next call is as if nothing had been
    fresh = kind(default_rng(15))
    for one, other in zip(evaluated(equations, y), evaluated(fresh, y)):
        assert_array_equal(one, other)


def test_nothing_depends_on_the_call_before(kind):
    rng, N = default_rng(16), size(kind)
    points = SIZES.get(kind.__name__, (8, 4))[1]
    equations, y, scale, row = (
        kind(rng),
        point(rng, N),
        rng.uniform(0.1, 10.0, N + 1),
        rng.normal(size=N + 1),
    )
    elsewhere = [point(rng, N) for _ in range(4)]
    unrelated = (
        lambda: None,
        lambda: equations.evaluate(elsewhere[0], np.empty(N)),
        lambda: equations.solve(
            elsewhere[1], np.zeros(N + 1), np.ones(N + 1), 1e-12, 5, True, row=row
        ),
        lambda: equations.bordered(elsewhere[2], np.zeros(N + 1), scale, np.ones((1, N + 1))),
        lambda: equations.evaluate(np.full(N + 1, np.nan), np.empty(N)),
        lambda: equations.contact(
            elsewhere[3], np.empty((points, 3, 3)), np.empty((points, 3, 3)), np.empty((points, 5))
        ),
    )
    results = []
    for other in unrelated:
        other()
        solution = np.eye(N + 1)[:2].copy()
        out = [*evaluated(equations, y), solution]
        out.append(np.array(equations.bordered(y, row, scale, solution), float))
        other()
        start, tangent = y.copy(), np.zeros(N + 1)
        found = equations.solve(start, tangent, scale, 1e-10, 30, True, row=row)
        results.append(
            [*out, start, tangent, np.array([found.status, found.residual, *found.shares])]
        )
    for result in results[1:]:
        for one, expected in zip(result, results[0]):
            assert_array_equal(one, expected)


def test_units_of_unknowns_and_residuals_change_nothing(kind):
    """The same point is found, with tangents that are the same direction; a power of two is exact in the residual."""
    N = size(kind)
    units = np.append(np.geomspace(1e-3, 1e3, N), 1.0)
    for seed in range(20, 60):
        y, row = point(default_rng(seed), N), np.append(np.zeros(N), 1.0)
        found = []
        for scale, row_scale in ((np.ones(N + 1), np.ones(N)), (units, np.full(N, 2.0**-20))):
            equations, start, tangent = (
                kind(default_rng(seed), row_scale=row_scale),
                y.copy(),
                np.zeros(N + 1),
            )
            out = equations.solve(start, tangent, scale, 1e-11 * row_scale[0], 60, True, row=row)
            found.append(
                (out, start, tangent * scale / (tangent * scale)[-1] if tangent[-1] else tangent)
            )
        if found[0][0].status != OK or found[1][0].status != OK:
            continue
        (one, y_one, t_one), (other, y_other, t_other) = found
        assert one.rank == other.rank == N + 1
        assert_near(y_other, y_one, 1e-8)
        assert_close(t_other, t_one, 1e-7)
        return
    raise AssertionError("no solution")
