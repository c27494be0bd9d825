"""Aerodynamic damping and stiffness by nodal diameter: closed form of one mode, both senses, influence coefficients."""

import numpy as np
import pytest

import bdamper as bd
from tests.plain import plain_study

BAND = (310.0, 370.0)
FLOW = {5: 0.01 + 0.004j, -5: 0.02j, 10: 0.003}


@pytest.fixture(scope="module")
def study():
    excitation, response = bd.Excitation("mode 1", amplitude=2e-3), bd.Response("tip")
    return plain_study(
        bd.reference_model("bladed_disk", 9), excitation, 5, harmonics=2, response=response
    )


@pytest.mark.parametrize(
    ("engine_order", "z"), [(5, 0.01 + 0.004j), (60, 0.02j)], ids=["forward", "backward"]
)
def test_one_mode_has_the_response_of_its_closed_form(study, engine_order, z):
    study = study.replace(engine_order=engine_order, harmonics=1)
    still, flow = study.problem.bases[1], study.replace(aerodynamic_damping=FLOW)
    curve = flow.free(BAND)
    w, natural = 2.0 * np.pi * curve.frequency, np.sqrt(still.omega2[0])
    q = 2e-3 / (
        natural**2 * (1.0 + 2.0 * z.real)
        - w**2
        + 2j * w * natural * (still.damping_ratio[0] + z.imag)
    )
    expected = q * study.problem.location_modes("tip", 1)[0, 0]
    np.testing.assert_allclose(curve.harmonics[:, 1], expected, rtol=1e-11)


def test_each_harmonic_has_that_of_its_wave_and_dampers_none(study):
    flow = study.replace(aerodynamic_damping=FLOW)
    for before, after, z in zip(
        study.problem.bases, flow.problem.bases, (0.0, 0.01 + 0.004j, 0.003j)
    ):
        blade = np.array([c.body == "blade" for c in before.coordinates])
        np.testing.assert_allclose(
            after.omega2, before.omega2 * (1.0 + 2.0 * np.real(z) * blade), rtol=1e-13
        )
        ratio = (
            0.5
            * (after.damping - before.damping)
            / np.sqrt(np.where(before.omega2 > 0.0, before.omega2, 1.0))
        )
        np.testing.assert_allclose(ratio, np.imag(z) * blade, rtol=0.0, atol=1e-13)


def test_one_number_is_that_of_the_engine_order(study):
    one, mapped = (
        study.replace(aerodynamic_damping=flow).problem.bases for flow in (0.004, {5: 0.004})
    )
    assert np.array_equal(one[1].damping, mapped[1].damping)
    assert not np.array_equal(one[1].damping, study.problem.bases[1].damping)


def test_influence_coefficients_are_a_discrete_transform():
    rng = np.random.default_rng(1)
    given = {k: complex(*rng.normal(size=2)) for k in (-2, -1, 0, 1, 3)}
    around = np.zeros(12, complex)
    for k, z in given.items():
        around[k % 12] += z
    found = bd.influence_coefficients(given, 12)
    np.testing.assert_allclose(list(found.values()), 12 * np.fft.ifft(around), rtol=1e-12)
    assert found[5] != pytest.approx(found[7]), "waves of opposite senses differ"


@pytest.mark.parametrize(
    ("flow", "message"),
    [
        (-0.01, "aerodynamic_damping at nodal diameter 5: some modes have negative damping"),
        ({5: np.nan}, "aerodynamic_damping at nodal diameter 5: expected a finite number"),
        (
            {5: 0.1, -60: 0.1},
            "aerodynamic_damping at nodal diameter -60: expected each wave only once",
        ),
        ({1.5: 0.1}, "aerodynamic_damping, nodal diameter 1.5: expected a whole number"),
    ],
)
def test_refusals(study, flow, message):
    with pytest.raises(bd.SettingError, match=message):
        _ = study.replace(aerodynamic_damping=flow).problem.bases
    with pytest.raises(
        bd.SettingError, match="influence coefficient of blade 1: expected a finite number"
    ):
        bd.influence_coefficients({1: np.inf}, 12)
