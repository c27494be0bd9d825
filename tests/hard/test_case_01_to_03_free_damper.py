"""Rows 1 to 3: a damper that nothing holds but contact."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.response.response_curve import neutral_directions
from tests.hard.random_studies import oracle_residuals
from tests.plain import plain_study


def study(points=9, **settings):
    settings.setdefault("excitation", bd.Excitation("tip", "tangential", 1.0))
    return plain_study(
        bd.reference_model("bladed_disk", points),
        engine_order=5,
        friction_coefficient=0.4,
        **settings,
    )


def test_case_01_start_at_zero_motion_without_penetration():
    s = study()
    system = s.problem.system(0.0)
    rest = np.zeros(system.n_unknowns)
    _, J, _ = system.evaluate(rest, 2 * np.pi * 250.0)
    rigid = [k for k, c in enumerate(s.problem.bases[0].coordinates) if c.body == "damper"]
    assert len(rigid) == 6
    # no penetration: the mean of the damper is as free as that of a flying body, and the null vectors are its motions
    values = np.linalg.svd(J[:, rigid], compute_uv=False)
    assert values[-1] <= 1e-9 * np.abs(J).max()
    assert neutral_directions(
        system, s.problem.bases[0].coordinates, np.append(rest, 2 * np.pi * 250.0)
    )
    # the chain does not start there, but from the static state, where all six are held
    system, state = s.problem.system(200.0), s.static(200.0)
    start = system.layout.pack(state.q, np.zeros(len(s.problem.bases[1].omega2)))
    r, J, _ = system.evaluate(start, 2 * np.pi * 250.0)
    assert np.linalg.svd(J[:, rigid], compute_uv=False)[-1] > 1e-6 * np.abs(J[:, rigid]).max()
    assert np.abs(r[: system.n_mean] * system.row_scale[: system.n_mean]).max() < 1e-8
    curve = s.frequency_response(200.0, (250.0, 300.0))
    assert curve.complete
    assert "static state: converged" in curve.start_log[0]


def test_case_02_walking_is_reported_and_one_plane_loads():
    s = study()
    curve = s.frequency_response(200.0, (250.0, 400.0))
    assert curve.complete
    walks = [note for note in curve.notes if "drifts along TZ" in note]
    assert walks
    assert "drift" in curve.point_kind
    system = s.problem.system(200.0)
    front, back = s.problem.coupling.rows("front"), s.problem.coupling.rows("back")
    loaded = []
    for u in curve.unknowns:
        _, F, _ = system.contact(u)
        loaded.append([np.abs(F[rows, 2, 0]).max() > 1e-9 for rows in (front, back)])
    loaded = np.array(loaded)
    assert not loaded.all(axis=1).any()  # the planes have clearance: never both
    assert loaded.any()
    # a walk is a stretch of constant frequency and vibration between two planes
    at = [i for i, kind in enumerate(curve.point_kind) if kind == "drift"]
    assert np.ptp(curve.frequency[at[:2]]) < 1e-9 * curve.frequency[at[0]]


@pytest.mark.slow
def test_case_02_without_planes_there_is_no_solution_and_it_says_so():
    curve = study(constraint_planes=False).frequency_response(50.0, (300.0, 310.0))
    # it is tracked as far as it can be, to where the damper walks off along its axis
    assert curve.status == "incomplete"
    assert "no periodic solution after this point" in curve.reason
    assert "no constraint plane carries load" in curve.reason
    assert any("drifts along TZ" in note for note in curve.notes)
    assert curve.frequency.max() < 309.0
    assert study().frequency_response(50.0, (300.0, 310.0)).complete  # with planes there is


@pytest.mark.slow
def test_case_02_the_equations_hold_wherever_a_damper_has_walked():
    """A ten-thousandth of force and preload, 15 nm of vibration: 0.1 mm along TZ change no force, so that a walk does
    not end where rounding of a large displacement exceeds the tolerance."""
    s = study(excitation=bd.Excitation("tip", "tangential", 1e-4))
    curve = s.frequency_response(0.02, (250.0, 400.0))
    system = s.problem.system(0.02)
    walking = curve.unknowns[list(curve.point_kind).index("drift")].copy()
    omega = 2 * np.pi * curve.frequency[list(curve.point_kind).index("drift")]
    (axial,) = (
        k
        for k, c in enumerate(s.problem.bases[0].coordinates)
        if (c.body, c.name) == ("damper", "TZ")
    )
    mass = s.model.bodies["damper"].mass
    for distance in (-1e-9, -3e-5, -1e-4, -1.9e-4):
        walking[axial] = distance * np.sqrt(mass)
        r, _, _ = system.evaluate(walking, omega)
        assert np.abs(r * system.row_scale).max() < 2e-10


@pytest.mark.parametrize("preload", [pytest.param(1.0, marks=pytest.mark.slow), 20.0])
def test_case_03_preload_so_low_that_the_damper_nearly_flies(preload):
    s = study()
    curve = s.frequency_response(preload, (250.0, 400.0))
    assert curve.status in ("complete", "incomplete", "not found")
    assert (curve.residual <= 1e-9).all()
    assert any("excitation ramp" in line for line in curve.start_log)
    if len(curve):
        error, rounding = oracle_residuals(s, preload, curve)
        assert (error <= 1e-9 + rounding).all()
    if preload >= 20.0:
        assert curve.complete, curve.reason
