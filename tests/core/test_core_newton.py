"""The corrector in the core: convergence, tangent, undetermined directions, the excitation as parameter."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_array_equal

from bdamper import _core
from tests.cases import evaluate_system, random_arrays
from tests.compare import assert_near

CONVERGED, NOT_CONVERGED, DIVERGED, SINGULAR, NOT_FINITE = range(5)


def solve(
    system, y, normal=None, scale=None, tolerance=1e-11, iterations=60, line_search=True, **options
):
    n = system.n_unknown
    y = np.array(y, float)
    tangent = np.full(n + 1, np.nan)
    row = np.append(np.zeros(n), 1.0) if normal is None else normal
    scale = np.ones(n + 1) if scale is None else scale
    out = system.solve(y, tangent, scale, tolerance, iterations, line_search, row=row, **options)
    return out, y, tangent


def solved_systems(count=8):
    rng = default_rng(1)
    found = 0
    while found < count:
        system = _core.SectorEquations(**random_arrays(rng, (2, 3, 2), 4, constraint_points=1))
        out, y, tangent = solve(
            system, np.append(0.3 * rng.normal(size=system.n_unknown), rng.uniform(0.4, 2.0))
        )
        if out.status == CONVERGED:
            found += 1
            yield system, out, y, tangent


def test_converged_points_satisfy_the_equations():
    for system, out, y, _ in solved_systems():
        r, _, _ = evaluate_system(system, y[:-1], y[-1])
        assert np.abs(r).max() <= 1e-11
        assert out.residual == np.abs(r).max()
        assert out.rank == system.n_unknown + 1


def test_mean_shares_are_those_of_the_points_with_friction():
    """The open share against the load n0 + kn v over the cycle, from the motion alone."""
    theta = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    rng, opened = default_rng(1), 0
    for _ in range(12):
        arrays = random_arrays(rng, (2, 3, 2), 4, constraint_points=1)
        system = _core.SectorEquations(**arrays)
        out, y, _ = solve(
            system, np.append(0.3 * rng.normal(size=system.n_unknown), rng.uniform(0.4, 2.0))
        )
        if out.status != CONVERGED:
            continue
        X, F, each = np.empty((4, 3, 5)), np.empty((4, 3, 5)), np.empty((4, 5))
        assert system.contact(y, X, F, each) == 0
        mean = np.array(out.shares)
        rubs = arrays["mu"] > 0.0
        basis = np.array(
            [
                np.ones_like(theta),
                np.cos(theta),
                np.sin(theta),
                np.cos(2 * theta),
                np.sin(2 * theta),
            ]
        )
        load = arrays["n0"][:, None] + arrays["kn"][:, None] * (X[:, 2] @ basis)
        assert mean[2] == pytest.approx((load[rubs] <= 0.0).mean(), abs=2e-3)
        assert mean[0] == pytest.approx(each[rubs][:, [0, 2]].mean(), abs=1e-12)
        assert mean[1] == pytest.approx(each[rubs][:, [1, 3]].mean(), abs=1e-12)
        opened += mean[2] > 0.1
    assert opened >= 3


def test_tangent_is_the_null_vector():
    for system, _, y, tangent in solved_systems():
        _, J, r_omega = evaluate_system(system, y[:-1], y[-1])
        assert np.linalg.norm(tangent) == pytest.approx(1.0, abs=1e-13)
        assert tangent[-1] > 0.0
        rest = J @ tangent[:-1] + r_omega * tangent[-1]
        assert np.abs(rest).max() < 1e-10 * np.abs(J).max()


def test_correction_stays_in_the_plane_of_scaled_unknowns():
    rng = default_rng(2)
    for system, _, y, tangent in solved_systems(5):
        scale = rng.uniform(0.2, 5.0, len(y))
        normal = tangent / scale
        normal /= np.linalg.norm(normal)
        predicted = y + 0.02 * normal * scale
        out, corrected, turned = solve(system, predicted, normal, scale)
        assert out.status == CONVERGED
        assert abs(normal @ ((corrected - predicted) / scale)) < 1e-12
        assert np.linalg.norm(turned) == pytest.approx(1.0, abs=1e-13)
        assert turned @ normal > 0.0


def test_quadratic_convergence_without_events():
    """The last steps of Newton square the error: a wrong Jacobian would only reduce it by a factor."""
    rng = default_rng(3)
    seen = 0
    for system, _, y, _ in solved_systems():
        start = y.copy()
        start[:-1] += 1e-4 * rng.normal(size=len(y) - 1)
        out, _, _ = solve(system, start, line_search=False)
        if out.status == CONVERGED and out.iterations <= 3:
            seen += 1
    assert seen >= 6


def neutral_arrays(excitation=6.0):
    """One mass on a friction spring that slips; its mean position is held by nothing."""
    G = np.zeros((1, 3, 2), complex)
    G[0, 0] = 1.0
    return {
        "n_mode": np.array([1, 1], np.intc),
        "stiffness": np.array([0.0, 1.0]),
        "mass": np.ones(2),
        "damping": np.array([0.0, 0.02]),
        "G": np.array([1, 0, 0, 1, 0, 0], complex),
        "kt": np.array([[1.0, 0.0]]),
        "kn": np.zeros(1),
        "mu": np.array([0.5]),
        "n0": np.array([2.0]),
        "w": np.zeros((1, 2)),
        "law": np.zeros(1, np.intc),
        "shift": np.zeros((1, 3)),
        "force": np.array([0.0, excitation, 0.0]),
    }


def test_least_norm_leaves_a_neutral_position_alone():
    system = _core.SectorEquations(**neutral_arrays())
    for mean in (-3.0, 0.0, 0.3, 20.0):
        out, y, tangent = solve(system, [mean, -2.0, 0.3, 2.0])
        assert out.status == CONVERGED
        assert out.rank == 3  # one direction short
        assert system.cost.least_norm > 0  # solved by least norm, and counted so
        assert y[0] == pytest.approx(mean, abs=1e-12)
        assert tangent[0] == pytest.approx(0.0, abs=1e-12)


def test_a_mean_row_of_rounding_noise_does_not_steer_newton():
    """Friction of a symmetric cycle has the mean zero up to cancellation, whatever the vibration."""
    for excitation in np.linspace(4.0, 9.0, 11):
        system = _core.SectorEquations(**neutral_arrays(excitation))
        out, y, _ = solve(system, [0.3, -2.0, 0.3, 2.0], iterations=12)
        assert out.status == CONVERGED
        X = np.hypot(y[1], y[2])
        T = np.arccos(1 - 2 / X)
        stiffness, loss = (T - np.sin(2 * T) / 2) / np.pi, 4 / (np.pi * X) * (1 - 1 / X)
        assert np.hypot(1 + stiffness - 4, 0.04 + loss) * X == pytest.approx(excitation, rel=1e-11)


@pytest.mark.parametrize("unit", [2.0**13, 2.0**27, 2.0**33])
def test_a_small_row_that_is_no_rounding_noise_steers_newton(unit):
    """One mode in a unit of its own: its row is small beside the columns, and counts as much as the others."""
    arrays = random_arrays(default_rng(7), (0, 3), 4)
    start, its_own = np.append(np.zeros(6), 0.7), [2, 5]
    expected, y, _ = solve(_core.SectorEquations(**arrays), start)
    assert expected.status == CONVERGED
    for name in ("stiffness", "mass", "damping"):
        arrays[name][-1] /= unit**2
    arrays["G"].reshape(-1, 3)[:, -1] /= unit
    arrays["force"][its_own] /= unit
    scale, row_scale = np.ones(7), np.ones(6)
    scale[its_own], row_scale[its_own] = unit, unit
    out, found, _ = solve(_core.SectorEquations(**arrays, row_scale=row_scale), start, scale=scale)
    assert out.status == CONVERGED
    assert out.rank == 7
    assert out.iterations == expected.iterations
    assert_near(found / scale, y, 1e-12)


def test_newton_gives_up_where_rounding_limits_the_residual():
    """Three iterations in a row that do not halve the residual end it, long before the limit of iterations."""
    rng = default_rng(9)
    for system, _, y, _ in solved_systems():
        start = y + 1e-3 * rng.normal(size=len(y))
        out, _, _ = solve(system, start, tolerance=1e-30, iterations=60, line_search=False)
        assert out.status == NOT_CONVERGED
        assert 0.0 < out.residual < 1e-13
        assert 5 <= out.iterations <= 15


def test_a_rank_deficient_matrix_is_seen_behind_moderate_pivots():
    """A triangular matrix with a least pivot of 6e-7 and a condition of 1e15: each unknown is the sum of all before."""
    n = 30
    empty = random_arrays(default_rng(8), (n, 0), 0)
    for name in ("stiffness", "mass", "damping", "force"):
        empty[name][:] = 0.0
    support = np.eye(n) - np.tri(n, k=-1)
    support[-1, -1] = 6e-7
    assert np.linalg.cond(support, np.inf) > 1e14
    system = _core.Eased(_core.SectorEquations(**empty), 1.0, np.zeros(n), support)
    out, _, _ = solve(system, np.append(np.zeros(n), 0.5))  # where the support counts once
    assert out.status == CONVERGED
    assert out.condition < 1e-14
    assert out.rank == n
    assert system.cost.least_norm == 1


def test_failures_are_statuses():
    rng = default_rng(4)
    system = _core.SectorEquations(**random_arrays(rng, (2, 3), 4))
    n = system.n_unknown
    start = np.append(rng.normal(size=n), 1.0)
    assert solve(system, start, iterations=0)[0].status == NOT_CONVERGED
    out, _, _ = solve(system, np.append(np.full(n, np.nan), 1.0))
    assert out.status == NOT_FINITE
    assert np.isinf(out.residual)
    # infinitely many times no support
    out, _, _ = solve(
        _core.Eased(system, 1.0, np.ones(n), np.zeros((n, n))), np.append(start[:-1], 0.0)
    )
    assert out.status == NOT_FINITE
    assert np.isinf(out.residual)
    empty = random_arrays(rng, (0, 1), 0)
    empty["stiffness"][:] = empty["mass"][:] = empty["damping"][:] = 0.0
    out, _, _ = solve(_core.SectorEquations(**empty), [0.0, 0.0, 1.0])  # 0 x = force
    assert out.status in (SINGULAR, NOT_CONVERGED, DIVERGED)


def test_ramp_is_a_factor_on_part_of_the_excitation():
    rng = default_rng(5)
    arrays = random_arrays(rng, (2, 3), 4)
    n = 8
    ramp = arrays["force"].copy()
    ramp[:2] = 0.0
    omega = 0.7
    system = _core.Eased(_core.SectorEquations(**arrays), omega, ramp)
    for factor in (0.2, 1.0, 1.7):
        out, y, tangent = solve(system, np.append(0.1 * rng.normal(size=n), factor))
        assert out.status == CONVERGED
        assert y[-1] == factor
        scaled = dict(arrays, force=arrays["force"] + (factor - 1.0) * ramp)
        r, J, _ = evaluate_system(_core.SectorEquations(**scaled), y[:-1], omega)
        assert np.abs(r).max() < 1e-10
        # tangent: J du = ramp dfactor
        assert_near(J @ tangent[:-1], ramp * tangent[-1], 1e-9)


def test_support_fades_out():
    rng = default_rng(8)
    arrays = random_arrays(rng, (2, 3), 4)
    n = 8
    system = _core.SectorEquations(**arrays)
    ramp, support, omega = rng.normal(size=n), rng.normal(size=(n, n)), 0.7
    support = support @ support.T  # it pulls back
    eased = _core.Eased(system, omega, ramp, support)
    for s in (0.1, 0.6, 1.0):
        out, y, tangent = solve(eased, np.append(0.1 * rng.normal(size=n), s))
        assert out.status == CONVERGED
        r, J, _ = evaluate_system(system, y[:-1], omega)
        assert np.abs(r + (1.0 - s) * ramp + (1.0 / s - 1.0) * support @ y[:-1]).max() < 1e-10
        by_factor = -ramp - support @ y[:-1] / s**2
        rest = (J + (1.0 / s - 1.0) * support) @ tangent[:-1] + by_factor * tangent[-1]
        assert_near(rest, 0.0, 1e-9)


def test_a_newton_step_beyond_the_reach_ends_a_correction():
    system, _, y, tangent = next(solved_systems(1))
    away = y + 0.05 * tangent
    whole, at, _ = solve(system, away, tangent, line_search=False)
    assert whole.status == CONVERGED
    out, near, _ = solve(system, away, tangent, line_search=False, reach=1.01 * whole.first_step)
    assert out.status == CONVERGED
    assert_array_equal(near, at)
    before = system.cost.evaluations
    out, near, _ = solve(system, away, tangent, line_search=False, reach=0.99 * whole.first_step)
    assert (out.status, out.iterations, system.cost.evaluations - before) == (NOT_CONVERGED, 0, 1)
    assert_array_equal(near, away)
