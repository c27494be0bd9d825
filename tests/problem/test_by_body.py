"""Settings of one free body among several: modes, damping, drag and mass."""

import pickle

import numpy as np
import pytest

import bdamper as bd
from bdamper.accuracy.estimate import richer_study
from bdamper.design.sensitivity import setting_family
from bdamper.problem.settings import settings_of
from bdamper.problem.variation import setting_names, vary
from tests.problem.test_loads import split_study

SHARES = {"front": 0.3, "rear": 0.7}


@pytest.fixture(scope="module")
def study():
    return split_study("bladed_disk", SHARES, SHARES)


def drag_of(study, body):
    """Damping of the coordinates of one body, rad/s, in their order."""
    basis = study.problem.bases[1]
    return basis.damping[[c.body == body for c in basis.coordinates]]


@pytest.mark.parametrize(("name", "value"), [("damper_modes", 2), ("damper_damping_ratio", 1e-4), ("damper_drag", 20.0)])
def test_a_mapping_of_all_bodies_is_one_number(study, name, value):
    one, each = study.with_(**{name: value}), study.with_(**{name: dict.fromkeys(SHARES, value)})
    for own, other in zip(one.problem.bases, each.problem.bases, strict=True):
        np.testing.assert_array_equal(own.omega2, other.omega2)
        np.testing.assert_array_equal(own.G, other.G)
        np.testing.assert_array_equal(own.damping, other.damping)


def test_a_body_has_its_own_elastic_modes_and_the_others_none(study):
    own = study.with_(damper_modes={"rear": 3})
    names = [c.name for c in own.problem.bases[1].coordinates if c.body == "rear"]
    assert names[6:] == ["elastic 1", "elastic 2", "elastic 3"]
    assert sum(c.body == "front" for c in own.problem.bases[1].coordinates) == 6
    assert "rear 3" in bd.Effects.of(own).describe()
    assert bd.Effects.of(own).without("damper modes beyond 1").damper_modes == {"rear": 1}


@pytest.mark.parametrize("name", ["damper_damping_ratio", "damper_drag"])
def test_damping_is_that_of_the_body_named(study, name):
    value = {"damper_damping_ratio": 1e-4, "damper_drag": 20.0}[name]
    both, rear = study.with_(**{name: value}), study.with_(**{name: {"rear": value}})
    np.testing.assert_array_equal(drag_of(rear, "rear"), drag_of(both, "rear"))
    np.testing.assert_array_equal(drag_of(rear, "front"), drag_of(study, "front"))
    assert drag_of(both, "front").max() > drag_of(study, "front").max()


def test_a_drag_in_proportion_to_mass_is_that_of_the_whole(study):
    """The same rate on both bodies: 20 N s/m in these shares are the rate of 20 N s/m on the damper in one piece."""
    own = study.with_(damper_drag={name: 20.0 * share for name, share in SHARES.items()})
    np.testing.assert_allclose(drag_of(own, "front"), drag_of(own, "rear"), rtol=1e-12)
    whole = sum(study.model.bodies[name].mass for name in SHARES)
    assert drag_of(own, "rear")[0] == pytest.approx(20.0 / whole)


def test_masses_of_all_bodies_one_by_one_are_the_mass_of_all(study):
    for factor in ("damper_mass_factor", "damper_mass"):
        all_at_once = vary(study.problem, {factor: 1.5})
        one_by_one = vary(study.problem, {f"{factor}.front": 1.5, f"{factor}.rear": 1.5})
        for own, other in zip(all_at_once.bases, one_by_one.bases, strict=True):
            np.testing.assert_allclose(own.G, other.G, rtol=1e-14)
        expected = {name: share * (1.5 if factor == "damper_mass" else 1.0) for name, share in SHARES.items()}
        assert one_by_one.body_loads == pytest.approx(expected)


def test_one_mass_leaves_the_other_body_and_its_load_alone(study):
    light = study.problem.model.bodies["front"]
    own = vary(study.problem, {"damper_mass_factor.rear": 2.0})
    assert own.model.bodies["rear"].mass == pytest.approx(2.0 * study.model.bodies["rear"].mass)
    assert own.model.bodies["front"].mass == light.mass and own.body_loads == study.problem.body_loads
    # the static load stays: the state of rest is the same
    np.testing.assert_allclose(own.static(300.0).force, study.static(300.0).force, rtol=1e-9, atol=1e-7)
    assert {"damper_mass.front", "damper_mass_factor.rear"} <= set(setting_names(study.problem))


def test_a_heavier_body_at_a_speed_has_its_load():
    turning = split_study("bladed_disk", SHARES, None).at_speed(300.0)
    problem, preload = turning.problem, turning.preload
    loads = {name: preload * share for name, share in problem.body_loads.items()}
    for name in SHARES:
        heavier = setting_family(problem, f"damper_mass.{name}", preload)(1.5)
        found = vary(problem, {f"damper_mass.{name}": 1.5})
        unit = preload * (1.5 if name == "front" else 1.0)
        expected = {other: (1.5 if other == name else 1.0) * load for other, load in loads.items()}
        assert {other: unit * share for other, share in found.body_loads.items()} == pytest.approx(expected)
        np.testing.assert_allclose(heavier.structure.force, found.sector(unit).force, rtol=1e-10)
        np.testing.assert_allclose(heavier.structure.points.n0, found.sector(unit).points.n0, rtol=1e-10)
    with pytest.raises(bd.SettingError, match=r"damper_mass_factor.rear: expected no rotor speed.* vary damper_mass.rear"):
        vary(problem, {"damper_mass_factor.rear": 2.0})


def test_sweeps_and_sensitivities_know_single_bodies(study):
    peak = study.with_(harmonics=1).peak(300.0, (310.0, 370.0))
    found = study.with_(harmonics=1).peak_sensitivities(
        peak, ("damper_mass_factor", "damper_mass_factor.front", "damper_mass_factor.rear")
    )
    whole, *parts = (each.amplitude for each in found.values())
    assert sum(parts) == pytest.approx(whole, rel=1e-3)


def test_settings_by_body_are_kept_with_results_and_copies(study):
    own = study.with_(damper_modes={"rear": 2}, damper_drag={"front": 3.0})
    record = own.problem.record()
    kept = settings_of(record)
    assert kept["damper_modes"] == {"rear": 2} and kept["damper_drag"] == {"front": 3.0}
    assert pickle.loads(pickle.dumps(own)).problem.record() == record


def test_richer_modes_are_those_that_bodies_have(study):
    richer = richer_study(study.with_(damper_modes={"rear": 2}).problem, "modes")
    most = study.problem.settings.most_modes("free")
    assert set(richer.problem.settings.by_body("damper_modes").values()) <= {most, 10}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"damper_modes": {"raer": 1}}, "damper_modes: expected free bodies .* did you mean rear"),
        ({"damper_drag": {"blade": 1.0}}, "damper_drag: expected free bodies"),
        ({"damper_drag": {"rear": -1.0}}, "damper_drag of 'rear': expected a finite number >= 0 N s/m, found -1"),
        ({"damper_damping_ratio": {"rear": 1.0}}, "damper_damping_ratio of 'rear': expected a finite number >= 0 and < 1"),
        ({"damper_modes": {"rear": 0.5}}, "damper_modes of 'rear': expected a whole number"),
        ({"damper_modes": {"rear": 99}}, r"damper_modes: expected 0 to \d+ \(body 'rear'\), found 99"),
    ],
)
def test_wrong_bodies_and_values_are_named(study, settings, message):
    with pytest.raises(bd.SettingError, match=message):
        study.with_(**settings)
