"""The estimated change of a peak from one study to another, and the embedding that it rests on."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.error_estimates import estimate_change
from bdamper.response.peak import find_peak
from bdamper.response.richer_peak import Change, embed
from tests import models
from tests.following import changed
from tests.plain import plain_study

INTERVAL = (720.0, 880.0)


@pytest.fixture(scope="module")
def full():
    model = models.wedge_model(1, n_points=6, harmonics=5)
    return plain_study(
        model,
        bd.Excitation("tip"),
        engine_order=2,
        friction_coefficient=0.4,
        harmonics=3,
        damper_modes=1,
        blade_modes=4,
    )


@pytest.fixture(scope="module")
def peak(full):
    return full.peak(40.0, INTERVAL)


def test_estimate_is_the_derivative_of_the_peak(full, peak):
    """A small force in addition: the estimated peak differs from the true one by the square of it."""
    rng = np.random.default_rng(0)
    system = full.problem.system(40.0)
    direction = rng.standard_normal(system.n_unknowns) * np.abs(system.structure.force).max()
    direction[: system.n_mean] = 0.0
    error, defect = [], []
    for size in (4e-4, 2e-4, 1e-4):
        other = changed(system, system.structure.force + size * direction)
        e = estimate_change(other, peak.y)
        true = find_peak(other, peak.y)
        assert true.ok
        change = true.amplitude / peak.amplitude - 1.0
        assert abs(change) > 1e-5
        error.append(abs(e.amplitude - change))
        defect.append(e.uncertainty)
        assert e.amplitude == pytest.approx(change, rel=0.1)
    assert error[0] / error[1] > 3.0 and error[1] / error[2] > 3.0
    # the second residual tells a good part of what is missing; the rest is the phase that the peak need not keep
    assert all(0.1 < d / m < 10.0 for d, m in zip(defect, error)), (defect, error)


def test_a_solution_of_the_system_itself_has_no_change(full, peak):
    e = estimate_change(full.problem.system(40.0), peak.y)
    assert e.size < 1e-7


@pytest.mark.parametrize(
    "changes",
    [
        {"harmonics": 1},
        {"rigid_modes": ("TX", "TY", "TZ", "RX", "RZ")},
        {"damper_modes": 0},
        {"blade_modes": 2},
        {"bias": False},
        {"contact_points": 3},
    ],
    ids=str,
)
def test_embedding_keeps_what_both_have(full, changes):
    cheap = full.replace(**changes)
    a, b = cheap.problem.system(40.0), full.problem.system(40.0)
    rng = np.random.default_rng(1)
    y = np.append(1e-6 * rng.standard_normal(a.n_unknowns), 5000.0)
    z = embed(cheap.problem, full.problem, 40.0, y)
    assert z[-1] == 5000.0
    for l in range(1, a.n_harmonics + 1):
        old = dict(zip(a.structure.bases[l].coordinates, a.layout.amplitudes(y[:-1], l)))
        new = dict(zip(b.structure.bases[l].coordinates, b.layout.amplitudes(z[:-1], l)))
        assert {c: new[c] for c in old} == old
        assert all(value == 0.0 for c, value in new.items() if c not in old)
    mean = z[: b.n_mean] - full.static(40.0).q
    if a.n_mean:
        moved = dict(zip(a.structure.bases[0].coordinates, y[: a.n_mean] - cheap.static(40.0).q))
        np.testing.assert_allclose(
            mean, [moved.get(c, 0.0) for c in b.structure.bases[0].coordinates], atol=1e-18
        )
    else:
        np.testing.assert_array_equal(mean, 0.0)


def test_the_size_of_an_estimate_is_what_it_may_be_at_most():
    assert Change(0.01, -0.02, 0.005).size == pytest.approx(0.025)
    assert Change(np.nan, 0.0, 0.0).size == np.inf


def test_an_estimate_outside_the_equations_is_none(full, peak):
    e = estimate_change(full.problem.system(40.0), np.full_like(peak.y, np.nan))
    assert np.isnan(e.amplitude) and e.size == np.inf
