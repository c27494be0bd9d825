"""Several free bodies under one preload: a damper taken apart responds as the whole one."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.static_state import static_state
from tests.plain import plain_study
from tests.split import split_damper

NAMES = {"bladed_disk": (310.0, 370.0), "turbine_blade": (640.0, 700.0)}


def whole_study(name):
    model = bd.reference_model(name, 9)
    study = plain_study(model, bd.Excitation("tip", "tangential"), 5, friction_coefficient=0.3)
    stiffness = {face: c.stiffness for face, c in study.problem.stiffness.items()}
    return study.replace(contact_stiffness=stiffness), stiffness


def split_study(name, shares, load_per_preload):
    whole, stiffness = whole_study(name)
    model = split_damper(whole.model, shares)
    parts = {}
    for face in model.interfaces:
        key = face.rpartition("_")[2]
        own = face.removesuffix(f"_{key}")
        parts[face] = (
            shares[key] * stiffness[own] if own in stiffness and key in shares else stiffness[face]
        )
    return whole.replace(model=model, contact_stiffness=parts, load_per_preload=load_per_preload)


@pytest.mark.parametrize("name", NAMES)
def test_one_damper_with_its_share_is_the_study_without_loads(name):
    """Bit for bit, and half the share at twice the preload."""
    whole, _ = whole_study(name)
    body = next(body.name for body in whole.model.bodies.values() if body.kind == "free")
    own = whole.replace(load_per_preload={body: 1.0})
    expected, found = (
        whole.frequency_response(300.0, NAMES[name]),
        own.frequency_response(300.0, NAMES[name]),
    )
    assert own.problem.system(300.0).n_unknowns == whole.problem.system(300.0).n_unknowns
    assert found.cost.evaluations == expected.cost.evaluations
    np.testing.assert_array_equal(found.frequency, expected.frequency)
    np.testing.assert_array_equal(found.amplitude, expected.amplitude)
    half = whole.replace(load_per_preload={body: 0.5}).frequency_response(600.0, NAMES[name])
    assert half.peak.amplitude == pytest.approx(expected.peak.amplitude, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "shares",
    [
        pytest.param({"front": 0.5, "rear": 0.5}, marks=pytest.mark.slow),
        {"front": 0.3, "rear": 0.7},
    ],
)
def test_a_damper_split_into_shares_responds_as_the_whole(name, shares):
    whole, _ = whole_study(name)
    parts = split_study(name, shares, shares)
    assert parts.static(300.0).ok and set(parts.problem.coupling.modes) >= set(shares)
    expected, found = whole.peak(300.0, NAMES[name]), parts.peak(300.0, NAMES[name])
    assert expected.search_status == found.search_status == "complete"
    assert found.amplitude == pytest.approx(expected.amplitude, rel=1e-5)
    assert found.frequency == pytest.approx(expected.frequency, rel=1e-6)
    other = split_study(name, shares, {"front": shares["rear"] + 0.4, "rear": shares["front"]})
    assert abs(other.peak(300.0, NAMES[name]).amplitude / expected.amplitude - 1.0) > 0.02


@pytest.mark.slow
def test_fixed_loads_of_bodies_are_added_to_those_of_the_preload():
    shares = {"front": 0.3, "rear": 0.7}
    both = split_study("bladed_disk", shares, shares)
    apart = both.replace(load_per_preload={"front": 0.3}, constant_loads={"rear": 210.0})
    ways = [both.static(300.0), apart.static(300.0, (1.0,))]
    total = [state.force[:, 2].sum() for state in ways]
    assert total[1] == pytest.approx(total[0], rel=0.05), "another history of loading"
    alone = apart.static(0.0)
    coupling = both.problem.coupling
    rear = np.char.endswith(np.array(coupling.interface_of), "_rear") & (
        both.problem.friction > 0.0
    )
    assert alone.force[rear, 2].sum() == pytest.approx(total[0] * 0.7, rel=0.05)
    assert alone.force[:, 2].sum() == pytest.approx(alone.force[rear, 2].sum(), rel=1e-9)
    assert apart.wedge_friction(300.0).interfaces == both.wedge_friction(300.0).interfaces


@pytest.mark.slow
def test_the_preload_comes_after_the_assembly():
    """Friction remembers the order: fixed loads and preload that grow together lead to another equilibrium."""
    shares = {"front": 0.3, "rear": 0.7}
    study = split_study("bladed_disk", shares, {"front": 0.3}).replace(
        constant_loads={"rear": 210.0}
    )
    state, system = study.static(300.0), study.problem.static_system(300.0)
    after = static_state(system, 300.0, start=static_state(system, 0.0))
    together = replace(
        system, force=system.force + system.constant_force / 300.0, constant_force=0.0 * system.constant_force,
        shift=system.shift + system.constant_shift / 300.0, constant_shift=0.0,
    )  # fmt: skip
    at_once = static_state(together, 300.0)
    assert state.ok and after.ok and at_once.ok
    largest = np.abs(state.force).max()
    np.testing.assert_allclose(state.force, after.force, rtol=0.0, atol=1e-10 * largest)
    assert np.abs(state.force - at_once.force).max() > 1e-3 * largest


def test_at_a_speed_bodies_are_loaded_by_mass_times_radius():
    shares = {"front": 0.3, "rear": 0.7}
    study = split_study("bladed_disk", shares, None).at_speed(300.0)
    arms = {
        key: b.mass * np.hypot(*b.centre[:2])
        for key, b in study.model.bodies.items()
        if key in shares
    }
    assert study.preload == pytest.approx(arms["front"] * 300.0**2)
    assert study.problem.body_loads == pytest.approx(
        {"front": 1.0, "rear": arms["rear"] / arms["front"]}
    )
    with pytest.raises(
        bd.SettingError, match="load_per_preload: it is not allowed at a rotor speed"
    ):
        study.replace(load_per_preload=shares)
    with pytest.raises(
        bd.SettingError, match="constant_loads: expected only loads of interfaces at a rotor speed"
    ):
        study.replace(constant_loads={"front": 5.0})


def test_loads_of_bodies_superpose():
    """Forces and the displacement that the modes leave out, each in proportion to the load of its body."""
    shares = {"front": 0.3, "rear": 0.7}
    coupling = split_study("bladed_disk", shares, shares).problem.coupling
    both, front, rear = (coupling.load(loads) for loads in (shares, {"front": 1.0}, {"rear": 1.0}))
    for whole, one, other in zip(both, front, rear):
        assert one.any() and other.any()
        np.testing.assert_allclose(
            whole, 0.3 * one + 0.7 * other, rtol=1e-12, atol=1e-12 * np.abs(whole).max()
        )
