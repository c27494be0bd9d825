"""Settings of one free body among several: modes, damping, drag and mass."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.error_estimates import richer_study
from bdamper.harmonic_balance.parameters import setting_names, vary
from bdamper.response.sensitivity import setting_family, setting_value
from tests.harmonic_balance.test_loads import split_study, whole_study

SHARES = {"front": 0.3, "rear": 0.7}


@pytest.fixture(scope="module")
def study():
    return split_study("bladed_disk", SHARES, SHARES)


def drag_of(study, body):
    """Damping of the coordinates of one body, rad/s, in their order."""
    basis = study.problem.bases[1]
    return basis.damping[[c.body == body for c in basis.coordinates]]


@pytest.mark.parametrize(
    ("name", "value"), [("damper_modes", 2), ("damper_damping_ratio", 1e-4), ("damper_drag", 20.0)]
)
def test_a_mapping_of_all_bodies_is_one_number(study, name, value):
    one, each = (
        study.replace(**{name: value}),
        study.replace(**{name: dict.fromkeys(SHARES, value)}),
    )
    for own, other in zip(one.problem.bases, each.problem.bases, strict=True):
        np.testing.assert_array_equal(own.omega2, other.omega2)
        np.testing.assert_array_equal(own.G, other.G)
        np.testing.assert_array_equal(own.damping, other.damping)


def test_a_body_has_its_own_elastic_modes_and_the_others_none(study):
    own = study.replace(damper_modes={"rear": 3})
    names = [c.name for c in own.problem.bases[1].coordinates if c.body == "rear"]
    assert names[6:] == ["elastic 1", "elastic 2", "elastic 3"]
    assert sum(c.body == "front" for c in own.problem.bases[1].coordinates) == 6
    assert "rear 3" in str(bd.Effects.of(own))
    assert bd.Effects.of(own).without("damper modes beyond 1")["damper_modes"] == {"rear": 1}


@pytest.mark.parametrize("name", ["damper_damping_ratio", "damper_drag"])
def test_damping_is_that_of_the_body_named(study, name):
    value = {"damper_damping_ratio": 1e-4, "damper_drag": 20.0}[name]
    both, rear = study.replace(**{name: value}), study.replace(**{name: {"rear": value}})
    np.testing.assert_array_equal(drag_of(rear, "rear"), drag_of(both, "rear"))
    np.testing.assert_array_equal(drag_of(rear, "front"), drag_of(study, "front"))
    assert drag_of(both, "front").max() > drag_of(study, "front").max()


def test_a_drag_in_proportion_to_mass_is_that_of_the_whole(study):
    """The same rate on both bodies: 20 N s/m in these shares are the rate of 20 N s/m on the damper in one piece."""
    own = study.replace(damper_drag={name: 20.0 * share for name, share in SHARES.items()})
    np.testing.assert_allclose(drag_of(own, "front"), drag_of(own, "rear"), rtol=1e-12)
    whole = sum(study.model.bodies[name].mass for name in SHARES)
    assert drag_of(own, "rear")[0] == pytest.approx(20.0 / whole)


def test_masses_of_all_bodies_one_by_one_are_the_mass_of_all(study):
    all_at_once = vary(study.problem, {"damper_inertia_factor": 1.5})
    for factor in ("damper_inertia_factor", "damper_mass_factor"):
        one_by_one = vary(study.problem, {f"{factor}.front": 1.5, f"{factor}.rear": 1.5})
        for own, other in zip(all_at_once.bases, one_by_one.bases, strict=True):
            np.testing.assert_allclose(own.G, other.G, rtol=1e-14)
        expected = {
            name: share * (1.5 if factor == "damper_mass_factor" else 1.0)
            for name, share in SHARES.items()
        }
        assert one_by_one.body_loads == pytest.approx(expected)


def test_one_mass_leaves_the_other_body_and_its_load_alone(study):
    light = study.problem.model.bodies["front"]
    own = vary(study.problem, {"damper_inertia_factor.rear": 2.0})
    assert own.model.bodies["rear"].mass == pytest.approx(2.0 * study.model.bodies["rear"].mass)
    assert (
        own.model.bodies["front"].mass == light.mass and own.body_loads == study.problem.body_loads
    )
    # the static load stays: the state of rest is the same
    np.testing.assert_allclose(
        own.static(300.0).force, study.static(300.0).force, rtol=1e-9, atol=1e-7
    )
    assert {"damper_mass_factor.front", "damper_inertia_factor.rear"} <= set(
        setting_names(study.problem)
    )


def test_a_heavier_body_at_a_speed_has_its_load():
    turning = split_study("bladed_disk", SHARES, None).at_speed(300.0)
    problem, preload = turning.problem, turning.preload
    loads = {name: preload * share for name, share in problem.body_loads.items()}
    for name in SHARES:
        heavier = setting_family(problem, f"damper_mass_factor.{name}", preload)(1.5)
        found = vary(problem, {f"damper_mass_factor.{name}": 1.5})
        unit = preload * (1.5 if name == "front" else 1.0)
        expected = {other: (1.5 if other == name else 1.0) * load for other, load in loads.items()}
        assert {other: unit * share for other, share in found.body_loads.items()} == pytest.approx(
            expected
        )
        np.testing.assert_allclose(heavier.structure.force, found.at(unit).sector.force, rtol=1e-10)
        np.testing.assert_allclose(
            heavier.structure.points.n0, found.at(unit).sector.points.n0, rtol=1e-10
        )
    expected = (
        r"damper_inertia_factor\.rear: expected no rotor speed.* vary damper_mass_factor\.rear"
    )
    with pytest.raises(bd.SettingError, match=expected):
        vary(problem, {"damper_inertia_factor.rear": 2.0})


@pytest.mark.slow
def test_sweeps_and_sensitivities_know_single_bodies(study):
    peak = study.replace(harmonics=1).peak(300.0, (310.0, 370.0))
    found = study.replace(harmonics=1).peak_sensitivities(
        peak, ("damper_inertia_factor", "damper_inertia_factor.front", "damper_inertia_factor.rear")
    )
    whole, *parts = (each.amplitude for each in found.values())
    assert sum(parts) == pytest.approx(whole, rel=1e-3)


def test_the_mass_of_the_only_damper_has_its_load():
    """The effect of the mass by name is that of the inertia and that of the preload together."""
    one = whole_study("bladed_disk")[0].replace(harmonics=1)
    assert vary(one.problem, {"damper_mass_factor.damper": 1.5}).body_loads == {"damper": 1.5}
    peak = one.peak(300.0, (310.0, 370.0))
    found = one.peak_sensitivities(
        peak, ("damper_mass_factor.damper", "damper_inertia_factor", "preload")
    )
    named, inertia, by_load = (each.amplitude for each in found.values())
    assert named == pytest.approx(inertia + 300.0 * by_load, rel=1e-3) and abs(
        inertia - named
    ) > 0.1 * abs(named)


@pytest.mark.slow
def test_a_heavier_damper_is_one_with_more_inertia_and_more_preload():
    """The recipe of the manual: 50 % more mass and load is the inertia alone at 1.5 times the preload."""
    one = whole_study("bladed_disk")[0].replace(harmonics=1)
    band = (310.0, 390.0)
    found = bd.compare(
        {"now": one, "heavier": {"damper_mass_factor.damper": 1.5}},
        lambda s: s.frequency_response(500.0, band),
    )
    expected = (
        one.replace(damper_inertia_factor=1.5).peak(750.0, band).amplitude
        / one.peak(500.0, band).amplitude
        - 1.0
    )
    assert found.change("heavier") == pytest.approx(expected, rel=1e-6) and abs(expected) > 0.1


@pytest.mark.slow
def test_a_body_without_load_has_mass_alone(study):
    bare = {name: replace(body, load=None) for name, body in study.model.bodies.items()}
    own = study.replace(model=replace(study.model, bodies=bare), load_per_preload=None)
    assert vary(own.problem, {"damper_mass_factor.rear": 1.3}).body_loads is None
    with pytest.raises(
        bd.SettingError, match=r"damper_mass_factor\.rear: expected a finite number > 0, found -1"
    ):
        vary(own.problem, {"damper_mass_factor.rear": -1.0})


@pytest.mark.slow
def test_richer_modes_are_those_that_bodies_have(study):
    """As far as each body goes, which has its own number of them."""
    front = study.model.bodies["front"]
    basis = front.bases[0]
    fewer = replace(
        basis,
        omega2=basis.omega2[:9],
        damping_ratio=basis.damping_ratio[:9],
        contact_modes=basis.contact_modes[..., :9],
    )
    short = replace(
        front, bases={0: fewer}, load=replace(front.load, generalised=front.load.generalised[:9])
    )
    model = replace(study.model, bodies=study.model.bodies | {"front": short})
    for given in ({"front": 3, "rear": 3}, {"rear": 6}):
        richer, text = richer_study(
            study.replace(model=model, damper_modes=given, blade_modes=40).problem, "modes"
        )
        assert (
            richer.settings.damper_modes == {"front": 3, "rear": 10} and "3 and 10 elastic" in text
        )
    whole = study.replace(model=model, damper_modes={"front": 3, "rear": 10}, blade_modes=40)
    with pytest.raises(bd.BdamperError, match="the model has no more modes"):
        richer_study(whole.problem, "modes")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"damper_modes": {"raer": 1}}, "damper_modes: expected free bodies .* did you mean rear"),
        ({"damper_drag": {"blade": 1.0}}, "damper_drag: expected free bodies"),
        (
            {"damper_drag": {"rear": -1.0}},
            "damper_drag of 'rear': expected a finite number >= 0 N s/m, found -1",
        ),
        (
            {"damper_damping_ratio": {"rear": 1.0}},
            "damper_damping_ratio of 'rear': expected a finite number >= 0 and < 1",
        ),
        ({"damper_modes": {"rear": 0.5}}, "damper_modes of 'rear': expected a whole number"),
        (
            {"damper_modes": {"rear": 99}},
            r"damper_modes: expected 0 to \d+ \(body 'rear'\), found 99",
        ),
    ],
)
def test_wrong_bodies_and_values_are_named(study, settings, message):
    with pytest.raises(bd.SettingError, match=message):
        study.replace(**settings)


def test_single_loads_are_varied_by_name():
    model = bd.reference_model("shrouded_blade")
    own = bd.Study(model, bd.Excitation("tip"), 4, harmonics=1, constant_loads={"shroud": 50.0})
    names = {
        "load_per_preload.front",
        "load_per_preload.rear",
        "constant_loads.shroud",
        "constant_loads.front",
    }
    assert names <= set(setting_names(own.problem))
    assert {name: setting_value(own.problem, name) for name in sorted(names)} == {
        "constant_loads.front": 0.0, "constant_loads.shroud": 50.0, "load_per_preload.front": 1.0,
        "load_per_preload.rear": 1.0,
    }  # fmt: skip
    found = vary(
        own.problem, {"load_per_preload.rear": 0.6, "constant_loads.shroud": 80.0}
    ).settings
    assert found.load_per_preload == {"front": 1.0, "rear": 0.6} and found.constant_loads == {
        "shroud": 80.0
    }
    assert vary(own.problem, {"constant_loads.shroud": 80.0}).static(0.0).normal_force[
        "shroud"
    ] == pytest.approx(80.0)
    with pytest.raises(bd.SettingError, match=r"did you mean constant_loads\.shroud"):
        vary(own.problem, {"constant_loads.shruod": 1.0})
    both = {"damper_mass_factor.rear": 2.0, "load_per_preload.rear": 0.5}
    for order in (both, dict(reversed(both.items()))):  # the load first, then the factor on it
        assert vary(own.problem, order).body_loads == {"front": 1.0, "rear": 1.0}
