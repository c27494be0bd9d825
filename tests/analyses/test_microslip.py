"""First loading of the damper along its axis."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.hysteresis import microslip
from bdamper.util.formatting import amount
from tests.plain import plain_study

LOAD, MU = 1000.0, 0.3
FORCES = np.array([20.0, 60.0, 120.0, 200.0, 260.0, 280.0, 300.0])


def study(contact, **settings):
    model = bd.reference_model("bladed_disk", 9)
    return plain_study(
        model,
        bd.Excitation("tip"),
        5,
        contact_stiffness=contact,
        constraint_planes=False,
        **settings,
    )


def chords(curve):
    """Slopes between neighbouring forces, N/m."""
    moved = curve.array("displacement")
    moved = moved[np.isfinite(moved)]  # it slides under the others
    return np.diff(FORCES[: len(moved) - 1], prepend=0.0) / np.diff(moved)


@pytest.fixture(scope="module")
def curves():
    # stiff combinations with the vectors of partial contact fade out, so that more bring little
    choices = {n: bd.ResidualModes(n, partial_contact=False) for n in (5, 8, 12, "all")}
    choices["unit_traction"] = "unit_traction"
    return {name: microslip(study(choice), LOAD, FORCES) for name, choice in choices.items()}


@pytest.mark.slow
def test_equilibrium_and_softening(curves):
    for curve in curves.values():
        assert np.nanmax(curve.array("residual")) < 1e-9
        assert np.all(chords(curve) > 0.0)
        # the seat keeps friction of its own, so the first chord may be a little softer than the next
        assert np.all(np.diff(chords(curve)) < 0.02 * chords(curve)[0])
        assert chords(curve)[-1] < 0.99 * chords(curve)[0]


def test_more_patterns_come_nearer_to_the_whole_flexibility(curves):
    whole = curves["all"].array("displacement")
    divisor = np.where(whole > 0.0, whole, 1.0)
    relative = [curves[n].array("displacement") / divisor - (whole > 0.0) for n in (5, 8, 12)]
    error = [np.nanmax(np.abs(each)) for each in relative]
    assert error[0] > error[1] > error[2]
    assert error[2] < 4e-3
    assert error[0] > 0.03


def test_with_much_friction_it_is_the_stiffness_of_the_closed_points():
    """Nothing slips: u = d^T (K + G^T diag(k) G)^-1 d per newton."""
    # with all vectors some points have so little normal force that they slip even then
    s = study(bd.ResidualModes(12, partial_contact=False), friction_coefficient=10.0)
    curve = microslip(s, LOAD, (1.0, 2.0))
    np.testing.assert_array_equal(curve.array("slipping"), 0.0)
    closed = np.repeat(s.static(LOAD).status[:, 0] != 3, 3)
    springs = s.problem.point_stiffness.ravel() * closed
    basis = s.problem.bases[0]
    G = basis.G.real.reshape(-1, basis.n_modes)
    d = np.zeros(basis.n_modes)
    modes = s.problem.coupling.location_modes("damper", 0).real
    d[: modes.shape[1]] = modes[2]
    K = np.diag(basis.omega2) + G.T @ (springs[:, None] * G)
    moved = curve.array("displacement")[1:]
    np.testing.assert_allclose(moved, np.array([1.0, 2.0]) * (d @ np.linalg.solve(K, d)), rtol=1e-8)


@pytest.mark.slow
def test_it_slides_when_all_friction_is_used():
    """Along the axis that is mu times the normal force of both faces, each direction having its own limit."""
    s = study("unit_traction")
    limit = MU * sum(s.static(LOAD).normal_force.values())
    curve = microslip(s, LOAD, limit * np.array([0.5, 0.9, 0.97, 1.03, 1.1]))
    last = max(p["force"] for p, status in zip(curve.points, curve.status) if status == "complete")
    assert not curve.complete and 0.96 * limit < last < 1.05 * limit
    assert curve.status_text[-1] == "failed: the damper slides"
    moved = amount(np.nanmax(curve.array("displacement")), "m")
    first = amount(min(p["force"] for p in curve.points if p["force"] > last), "N")
    expected = f"The damper slides at {first}: displacement {moved} at {amount(last, 'N')}"
    assert curve._headline() == expected
    below = microslip(s, LOAD, (1.0, 2.0))
    moved = amount(below.array("displacement")[-1], "m")
    assert below._headline() == f"No sliding up to 2 N: displacement {moved}"
