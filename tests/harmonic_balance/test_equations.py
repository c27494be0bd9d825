"""What whoever solves or follows equations relies on, for every kind of them."""

from dataclasses import FrozenInstanceError
from functools import cache

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.nonlinear_mode import mode_system
from bdamper.harmonic_balance.equations import NOT_CONVERGED, Fixed, Layout, Rows
from bdamper.harmonic_balance.rotor_speed import family_equations
from bdamper.harmonic_balance.sector import excitation_ramp, supported_by
from bdamper.mistuning import BladedDisk
from tests.mistuning.test_symmetry import PATTERN
from tests.mistuning.test_symmetry import study as lumped_study
from tests.plain import plain_study

PRELOAD, OMEGA = 200.0, 2.0 * np.pi * 300.0


@cache
def disk():
    excitation = bd.Excitation("tip", "tangential")
    return plain_study(
        bd.reference_model("bladed_disk", 9), excitation, engine_order=5, harmonics=2
    )


def sector():
    return disk().problem.system(PRELOAD), OMEGA


def ramp():
    return excitation_ramp(sector()[0], OMEGA), 0.7


def support():
    return supported_by(sector()[0], OMEGA, 0.1, 0.2), 0.7


def family():
    study = disk()
    stiffer = [
        study.replace(contact_stiffness_factor=factor).problem.system(PRELOAD)
        for factor in (1.2, 1.0, 0.9)
    ]
    return family_equations(stiffer, OMEGA / 5.0 * np.array([1.1, 1.0, 0.9]), 5), OMEGA


def mode():
    system, omega = mode_system(disk().problem, PRELOAD, 1, 1e-6)
    state = disk().static(PRELOAD)
    guess = system.structure.start(state.q, omega, 1e-5)
    return system, guess


def wheel():
    return BladedDisk(lumped_study(), PATTERN).system(1000.0), 900.0


@pytest.fixture(params=[sector, ramp, support, family, mode, wheel], ids=lambda make: make.__name__)
def equations(request):
    system, at = request.param()
    rng = np.random.default_rng(3)
    if request.param is mode:
        return system, at * (1.0 + 1e-3 * rng.normal(size=len(at)))
    return system, np.append(1e-5 * rng.normal(size=system.n_unknowns), at)


def derivative(system, function, y, i):
    """Central difference, extrapolated once, with steps in the units of the point."""
    size = 1e-5 * system.units(y, y[-1])[i]

    def slope(h):
        step = h * np.eye(len(y))[i]
        return (function(y + step) - function(y - step)) / (2.0 * h)

    return (4.0 * slope(size / 2.0) - slope(size)) / 3.0


def test_the_gradient_is_that_of_half_the_squared_response(equations):
    system, y = equations
    gradient, square = system.rows.squared_gradient(y)
    np.testing.assert_allclose(square, system.rows.squared_gradient(y)[1])
    for i in {system.n_mean, system.n_unknowns - 1, int(np.argmax(np.abs(gradient))), len(y) - 1}:
        expected = derivative(system, lambda x: 0.5 * system.rows.squared_gradient(x)[1], y, i)
        assert gradient[i] == pytest.approx(expected, rel=1e-6, abs=1e-9 * np.abs(gradient).max())


def test_rows_give_the_response_and_the_gradient_where_they_change_with_speed():
    """Rows of a parabola in the squared speed, at engine order 5; both rows turn the response into one complex number."""
    rng = np.random.default_rng(5)
    layout = Layout(np.array([2, 3]))
    row = rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3))
    rows = Rows(np.array([layout.parts(r) for r in row]), (90.0, 20.0), 5)
    u, omega = rng.normal(size=layout.n_unknowns), 5.0 * np.sqrt(97.0)
    t = (97.0 - 90.0) / 20.0
    expected = layout.amplitudes(u, 1) @ (row[0] + t * row[1] + (2.0 * t * t - 1.0) * row[2])
    assert rows.value(np.append(u, omega)) == pytest.approx(expected, rel=1e-12)
    gradient, square = rows.squared_gradient(np.append(u, omega))
    assert square == pytest.approx(abs(expected) ** 2, rel=1e-12)
    for i, size in enumerate([*[1e-4] * len(u), 1e-3]):
        step = size * np.eye(len(u) + 1)[i]
        high, low = (
            rows.squared_gradient(np.append(u, omega) + way * step)[1] for way in (1.0, -1.0)
        )
        assert gradient[i] == pytest.approx((high - low) / (4.0 * size), rel=1e-6, abs=1e-9)


def test_the_places_of_harmonics_fill_the_unknowns(equations):
    system, y = equations
    places = [
        np.arange(len(y))[part]
        for l in range(system.n_harmonics + 1)
        for part in system.layout.slices(l)
    ]
    assert np.concatenate(places).tolist() == list(range(system.layout.n_unknowns))
    assert len(system.response(y[: system.layout.n_unknowns])) == system.n_harmonics + 1


def test_units_are_positive_and_a_place_is_words(equations):
    system, y = equations
    scale = system.units(y, 5.0)
    assert scale.shape == y.shape and (scale > 0.0).all() and np.isfinite(scale).all()
    assert system.measure.place(float(y[-1])).split()[1] in ("Hz", "m")


def test_a_budget_ends_corrections_and_belongs_to_a_copy(equations):
    system, y = equations
    poor = system.within(0)
    assert poor.spent and not system.spent and system.left == np.inf
    before = system.core.cost.evaluations
    found = poor.solve(y, Fixed(), np.ones(len(y)), 1e-9, 5)
    assert (
        found.status == NOT_CONVERGED
        and found.iterations == 0
        and system.core.cost.evaluations == before
    )
    half = system.within(100).with_share(0.5)
    assert half.left == 50 and not half.spent
    system.residual(y)
    assert half.left == 49
    with pytest.raises(FrozenInstanceError):
        system.watched = ()
