"""Viscous damping of free bodies: the same in harmonic balance, stability and time."""

import re
import warnings

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.contact_cycle import energies
from bdamper.harmonic_balance.parameters import vary
from bdamper.plot.motion import rigid_motion
from bdamper.time_domain.integration import AllSectors
from bdamper.util.errors import BdamperWarning
from tests.plain import plain_study


@pytest.fixture(scope="module")
def plain():
    return plain_study(
        bd.reference_model("bladed_disk", 9),
        bd.Excitation("tip"),
        engine_order=5,
        friction_coefficient=0.4,
    )


def of_damper(basis):
    return np.array([c.body == "damper" for c in basis.coordinates])


def test_drag_takes_the_power_of_a_force_on_the_moving_body(plain):
    drag = 40.0
    study = plain.replace(damper_drag=drag)
    curve = study.frequency_response(2000.0, (352.0, 354.0))
    u, omega = curve.unknowns[0], 2 * np.pi * curve.frequency[0]
    # the energy balance holds, and without the damping of blades it is that of the force -drag v on the translation
    balance = energies(study.problem.system(2000.0), u, omega)
    assert balance["excitation"] == pytest.approx(
        balance["damping"] + balance["contact"].sum(), rel=1e-8
    )
    body = study.model.bodies["damper"]
    motion = rigid_motion(study, u).vibratory[0]  # m and rad about principal axes
    rotation = rigid_motion(study, u).modal_vibratory[0, 3:]
    force = np.pi * omega * drag * (np.abs(motion[:3]) ** 2).sum()
    moment = np.pi * omega * drag / body.mass * (np.abs(rotation) ** 2).sum()
    blades = energies(plain.problem.system(2000.0), u, omega)["damping"]
    assert balance["damping"] - blades == pytest.approx(force + moment, rel=1e-10)


def test_a_ratio_is_that_of_a_motion_on_the_closed_contacts(plain):
    study = plain.replace(damper_damping_ratio=0.02)
    basis = study.problem.bases[1]
    own = of_damper(basis)
    springs = study.problem.point_stiffness * study.problem.friction_points[:, None]
    stiffness = np.array(
        [(springs * np.abs(basis.G[..., k]) ** 2).sum() for k in np.flatnonzero(own)]
    )
    np.testing.assert_allclose(basis.damping[own], 2 * 0.02 * np.sqrt(stiffness), rtol=1e-12)
    np.testing.assert_array_equal(basis.damping[~own], plain.problem.bases[1].damping[~own])


def test_a_rate_above_the_frequency_warns(plain):
    with pytest.warns(BdamperWarning, match=r"a rate of up to .* 1/s exceeds omega = .* rad/s"):
        _ = plain.replace(damper_damping_ratio=0.05).problem.bases
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _ = plain.replace(damper_damping_ratio=0.0001).problem.bases


def test_residual_modes_give_way_beside_the_contact_springs():
    study = bd.Study(
        bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), engine_order=5, harmonics=1, rigid_modes=("TY",),
        damper_damping_ratio=0.1,
    )  # fmt: skip
    # static displacement of the damper under a force on it, blades at rest and every contact closed and stuck
    basis, rows = study.problem.static_basis, study.problem.friction_points
    k, blades = (
        study.problem.point_stiffness[rows].ravel(),
        [c.body == "blade" for c in basis.coordinates],
    )
    G = basis.G.real[rows].reshape(len(k), -1)[:, np.logical_not(blades)]
    K = (G.T * k) @ G + np.diag(basis.omega2[np.logical_not(blades)])
    force = np.zeros(len(K))
    force[0] = 1.0
    stiffness = 1.0 / np.linalg.solve(K, force)[0]
    basis = study.problem.bases[1]
    assert basis.damping[of_damper(basis)] == pytest.approx(0.2 * np.sqrt(stiffness), rel=1e-9)


def test_all_analyses_have_the_same_damping(plain):
    study = plain.replace(damper_damping_ratio=0.01, damper_drag=3.0)
    own = of_damper(study.problem.bases[1])
    damping = study.problem.bases[1].damping[own]
    assert damping.min() > 3.0 / study.model.bodies["damper"].mass
    ring = AllSectors(study.problem.system(1000.0), study.model.n_blades, 5)
    for _, coordinates, *_ in ring.blocks:
        np.testing.assert_allclose(ring.damping[coordinates][own], damping, rtol=1e-12)
    # nothing static depends on it
    assert np.array_equal(study.static(1000.0).force, plain.static(1000.0).force)


@pytest.mark.parametrize("settings", [{"damper_drag": 3.0}, {"damper_damping_ratio": 0.01}])
def test_a_study_varied_has_it_as_a_new_one(plain, settings):
    """Parts of a study that are made are handed on, modes with damping not; a heavier damper is damped less by a drag."""
    assert len(plain.problem.bases) and plain.static(1000.0)
    varied, own = vary(plain, settings), of_damper(plain.problem.bases[1])
    damping = plain.replace(**settings).problem.bases[1].damping
    np.testing.assert_array_equal(varied.problem.bases[1].damping, damping)
    assert (damping[own] > 0.0).all() and not plain.problem.bases[1].damping[own].any()
    heavier = vary(varied, {"damper_inertia_factor": 4.0}).problem.bases[1].damping[own]
    np.testing.assert_allclose(
        heavier, damping[own] / (4.0 if "damper_drag" in settings else 2.0), rtol=1e-12
    )


def test_what_does_not_fit_is_refused_and_what_is_set_is_told(plain):
    study = plain.replace(damper_damping_ratio=0.02)
    assert (
        re.search("damper damping ratio +0.02", str(study))
        and study.problem.record()["damper_damping_ratio"] == 0.02
    )
    assert re.search(
        "damper drag +5 N s/m", str(plain.replace(damper_drag=5.0))
    ) and "drag" not in str(plain)
    with pytest.raises(
        bd.BdamperError, match="damper_drag: expected a finite number >= 0 N s/m, found -1"
    ):
        plain.replace(damper_drag=-1.0)
    with pytest.raises(bd.BdamperError, match=r"damper_damping_ratio: expected .* < 1, found 1"):
        plain.replace(damper_damping_ratio=1.0)
    fixed = plain_study(bd.reference_model("blade_to_ground"), bd.Excitation("tip"))
    with pytest.raises(
        bd.BdamperError, match="damper_drag: expected 0, since the model has no free body, found 5"
    ):
        fixed.replace(damper_drag=5.0)
