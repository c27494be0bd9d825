"""Several forces, modal forces, several engine orders, responses at several places: sums and closed forms."""

import dataclasses

import numpy as np
import pytest

import bdamper as bd
from tests.plain import plain_study

TIP, PLATFORM = bd.Excitation("tip"), bd.Excitation("platform", "axial", 200.0, phase=0.3)
BAND = (310.0, 370.0)


@pytest.fixture(scope="module")
def study():
    return plain_study(bd.reference_model("bladed_disk", 9), TIP, 5, harmonics=3)


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


def test_forces_at_several_places_add_up(study):
    both = study.replace(excitation=TIP + PLATFORM)
    parts = [study.replace(excitation=e, response=bd.Response("tip")) for e in (TIP, PLATFORM)]
    curves = [s.free(BAND) for s in (both, *parts)]
    at = [np.isin(c.frequency, np.linspace(*BAND, 201)) for c in curves]
    whole, one, other = (c.harmonics[on][::20] for c, on in zip(curves, at))
    assert np.abs(other).max() > 0.1 * np.abs(one).max()
    close(whole, one + other)
    assert "beside it" in str(
        both
    ) and "200 N at platform, axial, phase 17.1887 degrees, order 5" in str(both)


def test_a_phase_is_in_radians_and_is_shown_in_degrees(study):
    for phase in (90.0, -10.0, 6.3):
        with pytest.raises(bd.SettingError) as caught:
            bd.Excitation("tip", phase=phase)
        assert str(caught.value) == (
            f"excitation phase: expected a phase in radians from -2 pi to 2 pi, found {phase}; "
            f"possibly given in degrees: use np.deg2rad({phase:g})"
        )
    quarter = study.replace(excitation=bd.Excitation("tip", phase=np.deg2rad(90)))
    assert quarter.excitation.force == pytest.approx(1j, abs=1e-15)
    assert "1 N at tip, tangential, phase 90 degrees" in str(quarter) and "phase" not in str(study)
    assert bd.Excitation("tip", phase=-2.0 * np.pi).force == pytest.approx(1.0)


def test_a_modal_force_is_that_of_its_mode_alone(study):
    """Closed form of one mode without contact, and no other mode moves."""
    alone = study.replace(
        excitation=bd.Excitation("mode 2", amplitude=3e-3, phase=0.7), response=bd.Response("tip")
    )
    basis = alone.problem.bases[1]
    curve = alone.free(BAND)
    omega = 2.0 * np.pi * curve.frequency
    q = 3e-3 * np.exp(0.7j) / (basis.omega2[1] - omega**2 + 1j * omega * basis.damping[1])
    close(curve.harmonics[:, 1], q * alone.problem.location_modes("tip", 1)[0, 1])
    tip = study.problem.location_modes("tip", 1)[0].conj()
    for k in (0, 1, 9):  # a force at a location is the sum of its projections on the modes
        modal = alone.replace(excitation=bd.Excitation(f"mode {k + 1}")).problem.modal_force(1)
        assert (study.problem.modal_force(1) * modal)[k] == tip[k] and np.count_nonzero(modal) == 1


@pytest.mark.parametrize("kind", ["free", "stuck"])
def test_two_engine_orders_superpose_where_nothing_slips(study, kind):
    """Harmonic 2 of a wave of order 5 is that of order 10 alone at twice the frequency."""
    second = bd.Excitation("tip", "axial", 2.0, 0.4, engine_order=10)
    both = study.replace(excitation=TIP + second)
    other = study.replace(
        excitation=dataclasses.replace(second, engine_order=None), engine_order=10, harmonics=1
    )
    springs = {
        name: own.stiffness for name, own in study.problem.stiffness.items()
    }  # springs at nodal diameter 5
    other = other.replace(response=bd.Response("tip"), contact_stiffness=springs)
    curve, first = getattr(both, kind)(BAND), getattr(study, kind)(BAND)
    linear, rows = other.problem.at(1.0).sector.linear, other.problem.response_rows[1]
    springs = None if kind == "free" else other.problem.at(1.0).stuck_springs()
    alone = [linear.response(4.0 * np.pi * f, springs) @ rows for f in curve.frequency]
    assert np.abs(alone).max() > 1e-7
    close(curve.harmonics[:, 2], np.array(alone))
    close(curve.harmonics[:, 1], first.harmonics[:, 1])


def test_two_engine_orders_in_the_balance_of_a_bonded_contact(study):
    """One linear solution of the equations of the harmonic balance; work of both orders equals what damping takes."""
    settings = {"friction_law": "bonded", "constraint_planes": False}
    both = study.replace(
        excitation=TIP + bd.Excitation("tip", "axial", 2.0, 0.4, engine_order=10), **settings
    )
    system, omega = both.problem.system(300.0), 2.0 * np.pi * 350.0
    r, jacobian, _ = system.evaluate(np.zeros(system.n_unknowns), omega)
    u = -np.linalg.solve(jacobian, r)
    springs = both.problem.point_stiffness * both.problem.bonded_points[:, None]
    for harmonic in (1, 2):
        close(
            system.layout.amplitudes(u, harmonic),
            system.structure.linear.response(omega, springs, harmonic),
        )


@pytest.mark.slow
def test_the_response_at_other_places_needs_no_other_solution(study):
    curve, other = (
        study.free(BAND),
        study.replace(response=bd.Response("platform", "radial")).free(BAND),
    )
    close(study.response_at(curve, "tip"), curve.harmonics)
    same = np.isin(curve.frequency, other.frequency)
    assert same.sum() >= 201
    close(
        study.response_at(curve, "platform", "radial")[same],
        other.harmonics[np.isin(other.frequency, curve.frequency)],
    )
    peak = study.peak(300.0, BAND)
    assert abs(study.response_at(peak, "tip")[0, 1]) == pytest.approx(peak.amplitude, rel=1e-12)
    with pytest.raises(bd.SettingError, match="result: expected a result of this study"):
        study.replace(friction_coefficient=0.2).response_at(peak, "tip")
    with pytest.raises(bd.SettingError, match="location: expected one of"):
        study.response_at(peak, "tipp")


@pytest.mark.parametrize(
    ("excitation", "message"),
    [
        (
            bd.Excitation("mode 99"),
            "excitation location: expected one of .* found 'mode 99'; did you mean mode 9",
        ),
        (bd.Excitation("mode 1"), r"response: give a Response\(location, direction\), because"),
        (
            bd.Excitation("mode 1", "axial"),
            "excitation direction: expected none, which 'mode 1' does not have",
        ),
        (
            TIP + bd.Excitation("tip", engine_order=7),
            r"engine_order of an excitation: expected one of \[5, 10, 15\]",
        ),
        (
            bd.Excitation("tip", engine_order=10),
            "excitation: expected a force of the study's own engine_order",
        ),
    ],
)
def test_refusals(study, excitation, message):
    with pytest.raises(bd.SettingError, match=message):
        study.replace(excitation=excitation)
    with pytest.raises(bd.SettingError, match="excitation beside: expected"):
        bd.Excitation("tip", beside=("platform",))
