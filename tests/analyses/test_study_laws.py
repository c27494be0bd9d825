"""Friction laws as settings of a study."""

from __future__ import annotations

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.laws import (
    LAW_BONDED,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_NORMAL,
)
from bdamper.contact.preload_state import STICK
from bdamper.response.response_curve import self_locking
from tests.models import acyclic_model, wedge_model
from tests.plain import plain_study

INTERVAL = (250.0, 400.0)


@pytest.fixture(scope="module")
def study():
    return plain_study(
        bd.reference_model("bladed_disk", 9),
        engine_order=5,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip"),
    )


def test_law_of_each_point(study):
    friction = study.problem.friction_points
    for settings, law in (
        ({"friction_law": "coupled", "contact_forces": bd.AFT(64)}, LAW_COUPLED),
        ({"friction_law": "bonded"}, LAW_BONDED),
        ({"variable_normal_load": False}, LAW_CONSTANT),
        (
            {
                "friction_law": "coupled",
                "contact_forces": bd.AFT(64),
                "variable_normal_load": False,
            },
            LAW_COUPLED_CONSTANT,
        ),
    ):
        points = study.replace(**settings).problem.system(200.0).structure.points
        assert set(points.law[: friction.sum()]) == {law}
        assert set(points.law[friction.sum() :]) <= {LAW_NORMAL}


def test_a_law_for_each_interface(study):
    faces = [name for name, face in study.model.interfaces.items() if face.kind == "friction"]
    mixed = study.replace(friction_law={faces[0]: "bonded", faces[1]: "uncoupled"})
    law = mixed.problem.system(200.0).structure.points.law
    assert (law[mixed.problem.coupling.rows(faces[0])] == LAW_BONDED).all()
    assert (law[mixed.problem.coupling.rows(faces[1])] != LAW_BONDED).all()
    assert mixed.frequency_response(200.0, INTERVAL).complete


def test_bonded_points_have_no_gap(study):
    face = next(name for name, face in study.model.interfaces.items() if face.kind == "friction")
    gap = {face: np.where(np.arange(9) == 3, 2e-6, 0.0)}
    with pytest.raises(
        bd.SettingError,
        match=rf"^gap of '{face}': a bonded interface cannot have a gap, found 2e-06 m",
    ):
        study.replace(friction_law="bonded", gap=gap)
    assert study.replace(gap=gap).problem.point_gaps[3] == 2e-6
    assert (
        study.replace(friction_law="bonded", gap={face: np.zeros(9)}).problem.point_gaps[3] == 0.0
    )


def test_bonded_points_give_the_stuck_response(study):
    bonded, stuck = (
        study.replace(friction_law="bonded").frequency_response(50.0, INTERVAL),
        study.stuck(INTERVAL),
    )
    assert bonded.complete
    assert bonded.shares[:, 0].min() > 0.999
    assert bonded.peak.amplitude == pytest.approx(stuck.peak.amplitude, rel=1e-4)
    assert bonded.peak.frequency == pytest.approx(stuck.peak.frequency, rel=1e-5)


@pytest.mark.parametrize(
    "model",
    [
        acyclic_model(4),
        acyclic_model(1, n_points=4, n_blade_modes=2, n_damper_modes=0),
        wedge_model(3),
        wedge_model(9),
    ],
    ids=["damper modes", "acyclic", "wedge 3", "wedge 9"],
)
def test_the_static_state_of_bonded_points_is_that_of_linear_springs(model):
    """Statics, solved as one linear system: the wedge pulls at points where it would open, and nothing slips."""
    study = plain_study(
        model,
        bd.Excitation("tip", "tangential", 40.0),
        engine_order=2 if model.n_blades > 1 else 0,
        contact_stiffness="model",
        damping_ratio=0.02,
        friction_law="bonded",
        constraint_planes=False,
    )
    load = 2000.0
    state = study.static(load)
    assert state.ok
    basis, (force, shift) = study.problem.static_basis, study.problem.damper_load
    G = basis.G.real.reshape(-1, basis.n_modes)
    k = np.concatenate(
        [study.problem.tangential_stiffness, study.problem.point_stiffness[:, 2:]], axis=1
    ).ravel()
    K = np.diag(basis.omega2) + G.T @ (k[:, None] * G)
    q = np.linalg.solve(K, load * (force - G.T @ (k * shift.ravel())))
    springs = (k * (G @ q + load * shift.ravel())).reshape(-1, 3)
    np.testing.assert_allclose(state.force, springs, atol=1e-8 * np.abs(springs).max())
    assert springs[:, 2].min() < 0.0
    assert (state.status == STICK).all()
    assert self_locking(study.problem) == ()
    curve = study.frequency_response(load, (250.0, 400.0))
    assert curve.complete
    assert curve.shares[:, 0].min() > 0.999


@pytest.mark.slow
def test_comparison_of_laws(study, tmp_path):
    """At high preload nothing slips, and all laws agree; at a low one they differ, most of all from constant load."""
    laws = ("coupled", "uncoupled", "constant_normal_load")

    def under(one):
        coupled = one.replace(friction_law="coupled", contact_forces=bd.AFT(128))
        return dict(zip(laws, (coupled, one, one.replace(variable_normal_load=False))))

    low = bd.compare(under(study), lambda one: one.frequency_response(200.0, INTERVAL))
    assert all(curve.complete for curve in low.curves)
    assert abs(low.change("uncoupled")) < 0.05
    assert abs(low.change("constant_normal_load")) > 0.1
    assert low.change("coupled") == 0.0
    assert "coupled" in low.summary()
    low.save(tmp_path / "laws.h5")
    again = bd.load(tmp_path / "laws.h5")
    assert (
        str(again) == str(low)
        and again.names == laws
        and {curve.preload for curve in again.curves} == {200.0}
    )
    assert [curve.settings["friction_law"] for curve in again.curves] == [
        "coupled",
        "uncoupled",
        "uncoupled",
    ]
    assert [curve.settings["variable_normal_load"] for curve in again.curves] == [True, True, False]
    high = bd.compare(
        under(study.replace(damping_ratio=0.02)),
        lambda one: one.frequency_response(50000.0, INTERVAL),
    )
    for law in ("uncoupled", "constant_normal_load"):
        assert abs(high.change(law)) < 1e-3
