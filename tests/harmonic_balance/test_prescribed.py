"""Normal loads of interfaces at rest."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from tests.plain import plain_study


@pytest.fixture(scope="module")
def study():
    return plain_study(
        bd.reference_model("blade_to_ground"),
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", amplitude=1.0),
    )


def test_loads_at_rest_are_the_prescribed_ones(study):
    target = np.linspace(-5.0, 60.0, 24)
    pressed = study.replace(constant_loads={"platform": target})
    state = pressed.static(0.0)
    assert state.ok and np.abs(state.q).max() > 0.0
    assert state.force[:, 2] == pytest.approx(np.maximum(target, 0.0), abs=1e-7)
    kn = pressed.problem.stiffness["platform"].stiffness[:, 2]
    # negative loads are gaps of that size
    assert state.closing[target < 0.0] == pytest.approx((target / kn)[target < 0.0], rel=1e-6)
    friction = np.abs(state.force[:, :2]).max(axis=1)
    assert np.all(friction <= 0.4 * state.force[:, 2] * (1 + 1e-9) + 1e-9)


@pytest.mark.parametrize(
    "settings",
    [
        {}, {"contact_stiffness_factor": 0.5}, {"blade_modes": 5}, {"contact_stiffness": "residual_modes"},
        {"friction_coefficient": 0.2}, {"friction_law": "bonded"},
    ],
)  # fmt: skip
def test_loads_are_those_of_the_assembly_under_all_settings(study, settings, tmp_path):
    """Once 30 N a point became 10 to 140 N without a word: loads were kept as gaps, which alone would still do so."""
    pressed = study.replace(constant_loads={"platform": np.full(24, 30.0)})
    other = pressed.replace(**settings)
    assert other.static(0.0).force[:, 2] == pytest.approx(30.0, rel=1e-7)
    if settings:
        gaps = study.replace(gap={"platform": -pressed.problem.fixed_load[1][:, 2]})
        drifted = gaps.replace(**settings).static(0.0).force[:, 2].sum()
        assert abs(drifted / (24 * 30.0) - 1.0) > 2e-3
    total = study.replace(**settings, constant_loads={"platform": 720.0}).static(0.0).force[:, 2]
    area = study.model.interfaces["platform"].area
    assert total == pytest.approx(720.0 * area / area.sum(), rel=1e-7)


@pytest.mark.parametrize("gap", [1e-5, -1e-6])
@pytest.mark.parametrize("item", ["load_per_preload", "constant_loads"])
def test_gaps_of_interfaces_with_a_load_are_ignored(study, item, gap):
    """A gap of 10 µm reduced a load of 720 N to 204 N, unless both kinds of load were given."""
    load, preload = {"load_per_preload": (2.0, 360.0), "constant_loads": (720.0, 0.0)}[item]
    pressed = study.replace(**{item: {"platform": load}, "gap": {"platform": gap}})
    force = pressed.static(preload).force[:, 2]
    assert force.sum() == pytest.approx(720.0, rel=1e-7)


def test_the_load_of_an_interface_may_be_the_preload(study):
    """Newtons per newton of preload: states scale, and are those under the same fixed load."""
    area = study.model.interfaces["platform"].area
    shared = study.replace(load_per_preload={"platform": 2.0})
    state = shared.static(300.0)
    assert state.force[:, 2] == pytest.approx(600.0 * area / area.sum(), rel=1e-7)
    fixed = study.replace(constant_loads={"platform": 600.0})
    np.testing.assert_allclose(fixed.static(0.0).force, state.force, atol=1e-7 * state.force.max())
    one, other = shared.peak(300.0, (300.0, 400.0)), fixed.peak(0.0, (300.0, 400.0))
    assert one.amplitude == pytest.approx(other.amplitude, rel=1e-7)
    with pytest.raises(
        bd.SettingError, match="preload: expected 0, since no body of the model carries a load"
    ):
        fixed.frequency_response(10.0, (300.0, 400.0))


def test_a_scalar_load_is_spread_by_area(study):
    """Over points of unequal areas, as a fixed load and as the preload: ``N_i = N A_i / A``."""
    area = np.linspace(1.0, 4.0, 24) * 1e-5
    face = replace(study.model.interfaces["platform"], area=area)
    unequal = study.replace(
        model=replace(study.model, interfaces={**study.model.interfaces, "platform": face})
    )
    expected = 720.0 * area / area.sum()
    fixed = unequal.replace(constant_loads={"platform": 720.0}).static(0.0)
    assert fixed.force[:, 2] == pytest.approx(expected, rel=1e-7)
    assert unequal.replace(load_per_preload={"platform": 2.4}).static(300.0).force[
        :, 2
    ] == pytest.approx(expected, rel=1e-7)


def test_other_faces_are_apart_under_loads_and_touch_under_fixed_loads():
    """A mass on k = 1 between two contacts, kn = 4 and 2; the load N = 6 of the first one presses it on the second one.

    Apart from the second one it gives way by N/k, so the surfaces approach by ``e = N/4 + N/1``.  With it, its motion p is
    ``4 (e - p) = (1 + 2) p``.  A fixed load is N although they touch: ``p = N/(1 + 2)``.
    """
    contacts = [
        bd.Contact(1, 0, kt=1.0, kn=4.0, mu=0.5),
        bd.Contact(1, {0: -1.0}, kt=1.0, kn=2.0, mu=0.5),
    ]
    study = bd.lumped([1.0, 1.0], [0.01, 0.01], [1.0, 1.0], contacts=contacts, forces={1: 0.1})
    first = next(iter(study.model.interfaces))
    e = 6.0 / 4.0 + 6.0
    alone = study.replace(load_per_preload={first: 2.0}).static(3.0)
    np.testing.assert_allclose(
        alone.force[:, 2], [4.0 * (e - 4.0 * e / 7.0), 2.0 * 4.0 * e / 7.0], rtol=1e-9
    )
    held = study.replace(constant_loads={first: 6.0}).static(0.0)
    np.testing.assert_allclose(held.force[:, 2], [6.0, 4.0], rtol=1e-9)


def test_derivatives_under_prescribed_loads_hold_the_loads(study):
    pressed = study.replace(constant_loads={"platform": np.full(24, 30.0)})
    peak = pressed.peak(0.0, (300.0, 400.0))
    found = pressed.peak_sensitivities(peak, ["friction_coefficient"])["friction_coefficient"]
    ends = [
        pressed.replace(friction_coefficient=0.4 + h).peak(0.0, (300.0, 400.0)).amplitude
        for h in (1e-5, -1e-5)
    ]
    assert found.amplitude == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-4)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"load_per_preload": {"platfrom": 1.0}},
            r"expected names of loaded bodies, or of friction interfaces .* did you mean platform",
        ),
        (
            {"load_per_preload": {"platform": 0.0}},
            "load_per_preload: expected at least one above 0",
        ),
        (
            {"load_per_preload": {"platform": np.nan}},
            "load_per_preload of 'platform': expected a finite number >= 0",
        ),
        (
            {"constant_loads": {"platform": -1.0}},
            "constant_loads of 'platform': expected a finite number >= 0",
        ),
        (
            {"constant_loads": {"platform": [1.0, 2.0]}},
            "constant_loads of 'platform': expected one or 24 finite numbers",
        ),
        (
            {"constant_loads": {"left": 1.0}},
            "expected names of loaded bodies, or of friction interfaces",
        ),
    ],
)
def test_loads_that_do_not_fit_are_named(study, settings, message):
    with pytest.raises(bd.SettingError, match=message):
        study.replace(**settings)
