"""Static states of dampers next to a shroud that has a load of its own."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd

DAMPER, SHROUD = (0.0, 1.0, 10.0, 100.0, 1000.0, 5000.0, 20000.0), (30.0, 200.0, 500.0, 2000.0)


def shrouded(load, **settings):
    return bd.Study(
        bd.reference_model("shrouded_blade"), bd.Excitation("tip", amplitude=1.0), engine_order=4,
        friction_coefficient=settings.pop("mu", 0.3), constant_loads={"shroud": load}, **settings,
    )  # fmt: skip


def check(study, preload, load):
    """Equilibrium and the limits of friction, from the state alone; the shroud has its load before the dampers have any."""
    state, system = study.static(preload), study.problem.static_system(preload)
    assert state.ok, f"{preload:g} N, {load:g} N: {state.reason}"
    pulled = np.einsum("pdm,pd->m", system.G, state.force) + system.stiffness * state.q
    applied = preload * system.force + system.constant_force
    terms = np.abs(system.G * state.force[..., None]).sum(axis=(0, 1)).max()
    np.testing.assert_allclose(
        pulled, applied, rtol=0.0, atol=1e-9 * max(terms, np.abs(applied).max())
    )
    T, N = np.abs(state.force[:, :2]), state.force[:, 2:]
    assert N.min() >= 0.0 and (T - system.mu[:, None] * N).max() <= 1e-9 * (preload + load)
    if preload == 0.0:
        assert state.normal_force["shroud"] == pytest.approx(load, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["residual_modes", "unit_traction"])
@pytest.mark.parametrize("load", SHROUD)
def test_every_load_of_the_dampers_has_a_state(load, method):
    """With little and much friction in turn, and each with either method."""
    mu = (0.1, 0.5)[(SHROUD.index(load) + (method == "unit_traction")) % 2]
    study = shrouded(load, contact_stiffness=method, mu=mu)
    for preload in DAMPER:
        check(study, preload, load)


@pytest.mark.parametrize("preload", [1.0, 1000.0])
def test_a_small_load_next_to_a_large_one(preload):
    """Residuals are relative to all loads: without the 2,000 N of the shroud rounding exceeds the tolerance at 1 N."""
    check(shrouded(2000.0, mu=0.5, load_per_preload={"front": 1.0, "rear": 0.6}), preload, 2000.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("preload", "load", "mu"), [(0.016244, 235.279, 0.06009), (0.0079246, 49.4295, 0.28008)]
)
def test_every_body_is_in_equilibrium_under_its_own_load(preload, load, mu):
    """Dampers of some mN beside the shroud.

    With one unit of force for all bodies, a first step of 5e-8 N was accepted while the dampers
    carried nothing, and no state followed.  The second case took 7,000 short steps.
    """
    study = shrouded(load, mu=mu, load_per_preload={"front": 1.0, "rear": 0.6}, harmonics=1)
    state, system = study.static(preload), study.problem.static_system(preload)
    assert state.ok, state.reason
    assert state.steps < 300
    applied = preload * system.force + system.constant_force
    contact = np.einsum("pdm,pd->m", system.G, state.force)
    imbalance = np.abs(contact + system.stiffness * state.q - applied)
    bodies = np.array([mode.body for mode in study.problem.static_basis.coordinates])
    for damper in ("front", "rear"):
        own = bodies == damper
        assert imbalance[own].max() < 1e-10 * np.abs(applied[own]).max(), damper
    blade = bodies == "blade"
    assert imbalance[blade].max() < 1e-10 * np.abs(contact[blade]).max()
    motion = np.einsum("pdm,m->pd", system.G, state.q) + system.shift_at(preload)
    normal = np.maximum(system.n0 + system.kn * motion[:, 2], 0.0)
    np.testing.assert_allclose(state.force[:, 2], normal, atol=1e-9 * preload)
    friction = np.abs(state.force[:, :2]).max(axis=1)
    assert np.all(friction <= system.mu * normal + 1e-9 * preload)


@pytest.mark.slow
def test_the_default_interval_comes_from_the_asked_preload(monkeypatch):
    """The free response needs the state without a preload."""
    study = shrouded(500.0, harmonics=1)
    asked, static = [], type(study.problem).static

    def seen(problem, preload, history=None):
        asked.append(preload)
        return static(problem, preload, history)

    monkeypatch.setattr(type(study.problem), "static", seen)
    study.peak(1000.0)
    assert set(asked) <= {0.0, 1000.0}


@pytest.mark.slow
def test_a_loose_damper_takes_a_finite_number_of_steps():
    """The rear damper has no load, so it moves in jumps; shortening steps to follow them took more than 1,500."""
    model = pytest.importorskip("tools.shrouded").shrouded().model
    study = bd.Study(
        model, bd.Excitation("tip", "tangential"), engine_order=4, friction_coefficient=0.1,
        load_per_preload={"front": 1.0},
        constant_loads={"shroud": 200.0}, contact_stiffness="residual_modes",
    )  # fmt: skip
    check(study, 100.0, 200.0)
    assert study.static(100.0).steps < 1000


def test_a_face_that_slips_beyond_its_neighbouring_points_is_named():
    """The points of the shroud are 10 mm apart."""
    state = shrouded(50.0, harmonics=1).static(0.0)
    of_shroud = np.array(state.interface) == "shroud"
    assert state.point_distance["shroud"] == pytest.approx(0.01, rel=1e-6)
    for slip, named in ((0.009, False), (0.011, True)):
        # along both directions, 3 : 4
        slider = np.where(of_shroud[:, None], np.array([0.6, -0.8]) * slip, 0.0)
        moved = replace(state, slider=slider)
        assert moved.static_slip["shroud"] == pytest.approx(slip, rel=1e-12)
        text = " ".join(str(moved).split())
        assert ("the faces would leave each other" in text) == named


def test_the_interference_of_a_load_in_newtons_makes_the_same_forces():
    """As gaps of single points it presses the faces of a frictionless shroud with this load."""
    state = shrouded(50.0, mu=0.0, harmonics=1).static(0.0)
    of_shroud = np.array(state.interface) == "shroud"
    assert np.isnan(state.interference[~of_shroud]).all()
    interference = state.interference[of_shroud]
    assert state.largest_interference == {"shroud": interference.max()}
    by_gap = shrouded(50.0, mu=0.0, harmonics=1).replace(
        constant_loads=None, gap={"shroud": -interference}
    )
    pressed = by_gap.static(0.0)
    assert pressed.normal_force["shroud"] == pytest.approx(50.0, rel=1e-7)
    np.testing.assert_allclose(pressed.force[of_shroud], state.force[of_shroud], rtol=1e-6)
    assert pressed.interference[of_shroud] == pytest.approx(interference, rel=1e-12)
    assert "nm of interference" in " ".join(str(pressed).split())


def test_faces_that_would_leave_each_other_are_warned_of_and_fail():
    study = shrouded(50.0, harmonics=1)
    state = study.static(0.0)
    of_shroud = np.array(state.interface) == "shroud"
    slider = np.where(of_shroud[:, None], np.array([0.6, -0.8]) * 0.011, 0.0)
    study.problem.static_states[0.0, 1.0] = replace(state, slider=slider)
    assert "FAIL" in str(study.static(0.0))
    with pytest.warns(bd.PlausibilityWarning, match="'shroud' slips by 11 mm, farther than"):
        study.first_slip(0.0)


def test_a_gap_beside_a_load_of_the_same_face_is_refused():
    """The load determines the interference, so that a gap would have no effect."""
    with pytest.raises(
        bd.SettingError, match=r"gap\.shroud: expected .*, found constant_loads of 'shroud'"
    ):
        bd.sweep(
            shrouded(50.0, harmonics=1),
            {"gap.shroud": [-1e-6]},
            lambda study, _: {"a": 1.0},
            preload=None,
        )
