"""Factors condensed to the motion at the contact points, beside the factors of the full Jacobian."""

import numpy as np
import pytest
from numpy.random import default_rng

import bdamper as bd
from bdamper import _core
from bdamper.harmonic_balance.sector import SectorData
from tests.cases import evaluate_system, random_arrays

FULL, CONDENSED = 1, 2
LAYOUTS = {
    "H=1": {"n_mode": (12, 15), "n_point": 1},
    "H=3, harmonics without modes": {"n_mode": (9, 12, 0, 8), "n_point": 2},
    "H=3, no mean, massless modes": {"n_mode": (0, 9, 8, 12), "n_point": 1, "massless": 2},
    "H=2, stops": {"n_mode": (14, 16, 12), "n_point": 2, "constraint_points": 1},
    "H=7": {"n_mode": (6,) * 8, "n_point": 1},
    "more contact than modes": {"n_mode": (2, 3), "n_point": 4},
    "without contact": {"n_mode": (4, 5), "n_point": 0},
}


def solved(arrays, y, elimination, transposed=False, seed=0, modes=None):
    """Solution of random bordered equations at y, its data, and the core."""
    core = _core.SectorEquations(**arrays, elimination=elimination)
    if modes:
        core = _core.Modes(core, *modes)
    n_all = core.n_unknown + 1
    rng = default_rng(seed)
    row, scale = rng.normal(size=n_all), rng.uniform(0.5, 2.0, n_all)
    b = rng.normal(size=(3, n_all))
    status, _, rank, orientation = core.bordered(y, row, scale, b, transposed)
    assert status == 0
    return b, rank, orientation, core


def rounding(arrays, y, transposed, modes):
    """Relative rounding of a solution: machine precision times the condition of the bordered matrix."""
    core = _core.SectorEquations(**arrays, elimination=FULL)
    if modes:
        core = _core.Modes(core, *modes)
    n_all = core.n_unknown + 1
    rng = default_rng(0)
    row, scale = rng.normal(size=n_all), rng.uniform(0.5, 2.0, n_all)
    inverse = np.eye(n_all)
    core.bordered(y, row, scale, inverse, transposed)
    return np.finfo(float).eps * np.linalg.cond(inverse)


def assert_same_solutions(arrays, y, modes=None):
    """Condensed solutions agree with full ones to twice their rounding (0.26 times on three processors); return the
    number of condensed factorisations."""
    for transposed in (False, True):
        expected, rank, orientation, _ = solved(arrays, y, FULL, transposed, modes=modes)
        found, *data, core = solved(arrays, y, CONDENSED, transposed, modes=modes)
        assert data == [rank, orientation]
        error = np.abs(found - expected).max(axis=1) / np.abs(expected).max(axis=1)
        assert error.max() < 2.0 * rounding(arrays, y, transposed, modes)
    return core.cost.condensed


@pytest.mark.parametrize("name", LAYOUTS)
def test_solutions_are_those_of_full_factors(name):
    rng = default_rng(5)
    for _ in range(6):
        arrays = random_arrays(rng, **LAYOUTS[name])
        y = np.append(rng.normal(size=len(arrays["force"])), rng.uniform(0.3, 2.0))
        assert assert_same_solutions(arrays, y) == 1


@pytest.mark.parametrize("name", LAYOUTS)
def test_jacobians_are_those_of_full_assembly(name):
    rng = default_rng(6)
    arrays = random_arrays(rng, **LAYOUTS[name])
    u = rng.normal(size=len(arrays["force"]))
    full = evaluate_system(_core.SectorEquations(**arrays, elimination=FULL), u, 0.8)
    condensed = evaluate_system(_core.SectorEquations(**arrays, elimination=CONDENSED), u, 0.8)
    for expected, found in zip(full, condensed):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["H=1", "H=2, stops", "H=7"])
def test_nonlinear_modes_have_the_same_solutions(name):
    rng = default_rng(7)
    arrays = random_arrays(rng, **LAYOUTS[name])
    n = len(arrays["force"])
    modes = rng.normal(size=n), rng.normal(size=n), 2.0
    y = np.append(rng.normal(size=n), [0.9, 0.03, -0.4])
    assert assert_same_solutions(arrays, y, modes) == 1


@pytest.mark.parametrize("n_resonant", [1, 3])
def test_modes_exactly_at_their_resonance(n_resonant):
    """Without damping their dynamic stiffness is zero: a pivot that cannot be eliminated."""
    rng = default_rng(8)
    arrays = random_arrays(rng, (8, 16, 16), 1)
    n_mean, omega = 8, 1.25
    for harmonic in (1, 2):
        first = n_mean + 16 * (harmonic - 1)
        arrays["stiffness"][first : first + n_resonant] = (harmonic * omega) ** 2
        arrays["damping"][first : first + n_resonant] = 0.0
    y = np.append(rng.normal(size=len(arrays["force"])), omega)
    assert assert_same_solutions(arrays, y) == 1


@pytest.mark.parametrize("detuning", [1e-2, 1e-4, 1e-6, 1e-9, 1e-12, 1e-15])
def test_modes_close_to_their_resonance(detuning):
    rng = default_rng(9)
    arrays = random_arrays(rng, (8, 16, 16), 1)
    arrays["stiffness"][8], arrays["damping"][8] = 1.25**2 * (1.0 + detuning), 0.0
    y = np.append(rng.normal(size=len(arrays["force"])), 1.25)
    assert assert_same_solutions(arrays, y) == 1


@pytest.mark.parametrize("stiffness", [0.0, 1e-14, 1e-9, 1e-5])
def test_bodies_that_contact_alone_holds(stiffness):
    """A weak spring to the ground is a small pivot as well."""
    rng = default_rng(10)
    arrays = random_arrays(rng, (10, 12), 1)
    arrays["stiffness"][:2] = stiffness
    # the point sticks through a small motion, so that it holds the mean
    arrays["n0"][:], arrays["mu"][:], arrays["w"][:], arrays["shift"][:] = 100.0, 0.9, 0.0, 0.0
    y = np.append(1e-3 * rng.normal(size=len(arrays["force"])), 0.8)
    assert_same_solutions(arrays, y)


def test_a_position_that_nothing_holds_is_solved_by_least_norm():
    rng = default_rng(11)
    arrays = random_arrays(rng, (10, 12), 1)
    arrays["stiffness"][0] = 0.0
    arrays["G"][[0, 10, 20]] = 0.0  # entries of the first mode of the mean
    y = np.append(rng.normal(size=len(arrays["force"])), 0.8)
    found, rank, _, core = solved(arrays, y, CONDENSED)
    expected, *_ = solved(arrays, y, FULL)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
    assert rank == core.n_unknown and core.cost.condensed == 0 < core.cost.least_norm


def test_the_choice_follows_the_sizes():
    """Condensed if fewer than half of the unknowns are coefficients of motion at contact points."""
    rng = default_rng(12)
    for n_mode, n_point, condensed in (
        ((12, 12), 1, False),  # small
        ((20, 20), 1, True),  # 9 of 60
        ((20, 20), 3, True),  # 27 of 60
        ((20, 20), 4, False),  # 36 of 60
    ):
        arrays = random_arrays(rng, n_mode, n_point)
        y = np.append(rng.normal(size=len(arrays["force"])), 0.8)
        *_, core = solved(arrays, y, 0)
        assert core.cost.condensed == condensed


def test_points_count_only_by_the_components_that_modes_move():
    rng = default_rng(13)
    arrays = random_arrays(rng, (20, 20), 4)
    G = arrays["G"].reshape(2, 4, 3, 20)
    G[:, :, 1:] = 0.0  # a tangential direction alone: 12 of 60
    y = np.append(rng.normal(size=60), 0.8)
    *_, core = solved(arrays, y, 0)
    assert core.cost.condensed == 1
    assert assert_same_solutions(arrays, y) == 1


@pytest.mark.parametrize("elimination", [-1, 3])
def test_other_choices_are_refused(elimination):
    arrays = random_arrays(default_rng(14), (2, 2), 1)
    with pytest.raises(ValueError, match=f"elimination: expected 0, 1 or 2, found {elimination}"):
        _core.SectorEquations(**arrays, elimination=elimination)


# ---- Curves ----


def chain(n, harmonics):
    """Masses in a row with a slider at the eighth."""
    stiffness = 400.0 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    stiffness[-1, -1] = 400.0
    contact = bd.Contact(7, kt=900.0, mu=1.0, preload=1.0)
    return bd.lumped(
        np.eye(n),
        0.02 * np.eye(n),
        stiffness,
        contacts=[contact],
        forces={n - 1: 1.0},
        response=n - 1,
        harmonics=harmonics,
    )


def with_full_factors(monkeypatch, compute):
    """Result of a computation, and of the same with the factors of the full Jacobian."""
    condensed = compute()
    arrays = SectorData.arrays.func
    full_arrays = property(lambda sector: arrays(sector) | {"elimination": FULL})
    monkeypatch.setattr(SectorData, "arrays", full_arrays)
    return condensed, compute()


COUNTS = ("evaluations", "jacobians", "factorisations", "iterations", "failed_steps", "least_norm")


def assert_same_work(condensed, full):
    for name in COUNTS:
        assert getattr(condensed.cost, name) == getattr(full.cost, name)
    n, total = condensed.cost.condensed, condensed.cost.factorisations
    assert 0.99 * total < n <= total  # a nearly singular matrix has full factors
    assert full.cost.condensed == 0 and "condensed" not in str(full.cost)
    assert f"; {n} of {total} factorisations condensed" in str(condensed.cost)


def test_response_curves_are_the_same(monkeypatch):
    condensed, full = with_full_factors(
        monkeypatch, lambda: chain(10, 4).frequency_response(0.0, (0.3, 0.6))
    )
    assert_same_work(condensed, full)
    np.testing.assert_allclose(condensed.frequency, full.frequency, rtol=1e-9)
    np.testing.assert_allclose(condensed.amplitude, full.amplitude, rtol=1e-9)
    assert condensed.point_kind == full.point_kind


def test_nonlinear_modes_are_the_same(monkeypatch):
    """At large amplitudes the force cancels the damping, and the first mode is nearly resonant."""
    condensed, full = with_full_factors(
        monkeypatch, lambda: chain(10, 3).nonlinear_mode(0.0, 1, (1e-4, 1e3))
    )
    assert_same_work(condensed, full)
    assert condensed.complete
    found, expected = (
        np.transpose([np.log(mode.amplitude), np.log(mode.frequency), mode.damping_ratio])
        for mode in (condensed, full)
    )
    # events are located to a tolerance: points may move along the curve, but not away from it
    along = np.gradient(expected, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    difference = found - expected
    assert np.abs(difference).max() < 1e-8
    difference -= (difference * along).sum(axis=1, keepdims=True) * along
    assert np.abs(difference).max() < 1e-9


def test_peaks_and_their_sensitivities_are_the_same(monkeypatch):
    """They need transposed solutions."""

    def compute():
        study = chain(10, 3)
        peak = study.peak(0.0, (0.3, 0.6))
        return peak, study.peak_sensitivities(peak)

    (condensed, found), (full, expected) = with_full_factors(monkeypatch, compute)
    assert condensed.cost.condensed > 0 == full.cost.condensed
    assert condensed.frequency == pytest.approx(full.frequency, rel=1e-9)
    assert condensed.amplitude == pytest.approx(full.amplitude, rel=1e-9)
    assert set(found) == set(expected)
    for name, sensitivity in expected.items():
        assert found[name].amplitude == pytest.approx(sensitivity.amplitude, rel=1e-6)
        assert found[name].frequency == pytest.approx(sensitivity.frequency, rel=1e-6)
