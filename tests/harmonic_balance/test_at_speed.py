"""A study at a rotor speed: preload of the damper's mass, faces displaced by rotation, conditions by speed."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.fatigue import AISI_1050
from bdamper.harmonic_balance.parameters import vary
from bdamper.harmonic_balance.rotor_speed import Conditions, preload_at
from bdamper.response.followed_peak import LOWER
from bdamper.response.optimal_curve import Curves
from bdamper.util.errors import PlausibilityWarning
from bdamper.util.formatting import amount
from tests.each import each
from tests.fatigue.test_margins import with_stress
from tests.plain import plain_study
from tests.printed import said
from tests.turning import turning_disk

SPEED = 400.0


@pytest.fixture(scope="module")
def study():
    model = turning_disk((0, 5), spin=True)
    return plain_study(model, bd.Excitation("tip", amplitude=10.0), 5, friction_coefficient=0.3)


def test_the_preload_is_mass_times_radius_times_squared_speed(study):
    damper = study.model.bodies["damper"]
    radius = np.hypot(damper.centre[0], damper.centre[1])
    assert study.at_speed(SPEED).preload == pytest.approx(
        damper.mass * radius * SPEED**2, rel=1e-12
    )
    heavy = vary(study.at_speed(SPEED), {"damper_mass_factor": 2.0})
    assert "neglected" not in str(heavy)
    assert heavy.preload == pytest.approx(2.0 * study.at_speed(SPEED).preload, rel=1e-12), (
        "load and inertia together"
    )
    assert re.search(r"speed +400 rad/s", str(heavy))
    inert = vary(study.at_speed(SPEED), {"damper_inertia_factor": 2.0})
    at = study.at_speed(SPEED)
    same = [one.problem.displacement_by_rotation for one in (at, heavy, inert)]
    assert np.array_equal(same[0], same[1]) and np.array_equal(same[0], same[2]), (
        "faces displaced by speed"
    )
    for one in (at, heavy, inert):
        np.testing.assert_allclose(
            one.problem.damper_load[1], at.problem.damper_load[1], rtol=1e-12, err_msg="by load"
        )


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.7, 1.5])
def test_another_preload_at_a_speed_is_a_lighter_or_heavier_damper(study, factor):
    """Rotation displaces the faces whatever the preload; in proportion to it, forces differ by 15 % at 0.7 of the load."""
    at = study.at_speed(SPEED)
    other = vary(at, {"damper_mass_factor": factor})
    ours, theirs = at.static(factor * at.preload), other.static(other.preload)
    np.testing.assert_allclose(ours.force, theirs.force, rtol=0.0, atol=1e-9 * theirs.force.max())
    assert (at.static(at.preload).force * factor - ours.force).max() > 0.1 * theirs.force.max(), (
        "not in proportion"
    )
    inert = vary(at, {"damper_inertia_factor": factor})
    amplitude = other.peak(other.preload).amplitude
    assert inert.peak(other.preload).amplitude == pytest.approx(amplitude, rel=1e-6)
    with pytest.raises(bd.SettingError, match=r"(needs a|has no) rotor speed"):
        _ = study.preload


def test_an_optimal_curve_takes_no_static_states_beyond_its_preloads(study):
    """Displaced faces have no state in proportion to the load: that at 1 N may take minutes.

    The peak of the lowest preload is followed from 0.9 and 0.6 times its value.
    """
    at = study.at_speed(SPEED)
    with Curves(at.problem, (300.0, 400.0)) as curves:
        assert curves.follow([at.preload])[0].known
    preloads = [key[0] for key in at.problem.static_states if len(key) == 2]
    # linear questions without contact need no state
    assert min(preloads) > 0.99 * min(LOWER) * at.preload


def test_an_imposed_displacement_of_the_faces_is_taken_up_by_springs_and_bodies(study):
    """Forces are those of the contact springs on the motion of the bodies and of the faces by rotation together."""
    at = study.at_speed(SPEED)
    state = at.static(at.preload)
    spin = at.problem.static_system(at.preload).shift - at.problem.coupling.load()[1]
    moved = SPEED**2 * at.model.bodies["blade"].spin.contact
    rows = at.problem.coupling.rows("left")
    port = next(p for p in at.model.bodies["blade"].ports if p[0] == "left")
    sign = (1.0 if port[1] == "b" else -1.0) * np.array([1.0, 1.0, -1.0])
    expected = sign * moved[at.model.port_slice("blade", port)]
    np.testing.assert_allclose(at.preload * spin[rows], expected, rtol=1e-12)
    x = (
        at.problem.static_basis.G.real @ state.q
        + state.load * at.problem.static_system(at.preload).shift
    )
    normal = np.maximum(at.problem.point_stiffness[:, 2] * (x[:, 2] - at.problem.point_gaps), 0.0)
    np.testing.assert_allclose(state.force[:, 2], normal, atol=1e-9 * normal.max())
    still = at.replace(speed=None).static(at.preload)
    assert np.abs(state.force - still.force).max() > 0.1 * np.abs(still.force).max(), (
        "it redistributes the pressure"
    )


def test_without_a_loaded_body_rotation_alone_closes_the_faces(study):
    bodies = {name: replace(body, load=None) for name, body in study.model.bodies.items()}
    at = plain_study(replace(study.model, bodies=bodies), bd.Excitation("tip"), 5).at_speed(SPEED)
    assert at.preload == 0.0
    closing = SPEED**2 * at.problem.coupling.closing_by_rotation()
    np.testing.assert_array_equal(at.problem.static_system(0.0).constant_shift, closing)
    assert at.static(0.0).ok


def test_friction_by_temperature_and_excitation_by_order(study):
    at = study.at_speed(
        SPEED,
        friction={20.0: 0.2, 420.0: 0.4},
        temperature=lambda omega: 0.3 * omega,
        excitation={5: {300.0: 6.0, 500.0: 8.0}},
    )
    assert at.settings.friction_by_interface()["left"] == pytest.approx(0.25)
    assert at.excitation.amplitude == pytest.approx(7.0)
    assert (
        study.at_speed(SPEED, excitation=lambda omega, order: omega / order).excitation.amplitude
        == 80.0
    )
    assert (
        repr(Conditions(friction={1.0: 0.3, 2.0: 0.4}))
        == "Conditions(friction={1.0: 0.3, 2.0: 0.4})"
    )
    assert "0x" not in repr(Conditions(friction=np.sqrt)), "the same from run to run"
    one, other = Conditions(friction=lambda omega: 0.3), Conditions(friction=lambda omega: 0.4)
    assert repr(one) == repr(other) and one.values([SPEED], [5]) != other.values([SPEED], [5]), (
        "known by their values"
    )
    reach = Conditions(
        friction={100.0: 0.3, 500.0: 0.4}, excitation={4: {200.0: 1.0, 900.0: 2.0}, 5: 3.0}
    ).reach
    assert (reach(4), reach(5)) == ((200.0, 500.0), (100.0, 500.0))


@pytest.mark.parametrize(
    ("conditions", "words"),
    [
        (
            {"friction": {100.0: 0.3, 200.0: 0.4}},
            "friction: expected a table that includes 400, found 100 to 200$",
        ),
        (
            {"friction": "0.3"},
            "friction: expected a function, or a mapping of numbers to numbers, found '0.3'",
        ),
        ({"temperature": {0.0: 20.0}}, "temperature: give friction as well"),
        ({"excitation": {4: 10.0}}, "excitation: expected a value for engine order 5"),
        ({"excitation": {5: -1.0}}, "excitation of engine order 5: expected a finite number > 0 N"),
        ({"friktion": {}}, r"at_speed: there is no argument 'friktion'; did you mean friction\?"),
    ],
)
def test_conditions_that_do_not_fit(study, conditions, words):
    with pytest.raises(bd.SettingError, match=words):
        study.at_speed(SPEED, **conditions)


def test_speeds_and_bodies_that_do_not_fit(study):
    for omega in (0.0, -1.0, np.inf, "400"):
        with pytest.raises(
            bd.SettingError, match="rotor speed: expected a finite number > 0 rad/s"
        ):
            study.at_speed(omega)
    with pytest.raises(
        bd.SettingError, match=r"speed: expected a model at 400 rad/s, as study\.at_speed"
    ):
        study.replace(speed=SPEED)
    assert preload_at(study.problem, SPEED) > 0.0


def test_a_study_replaces_the_names_that_a_sweep_varies(study):
    changed = study.replace(
        damper_inertia_factor=1.5, harmonics=1, **{"friction_coefficient.left": 0.2}
    )
    assert (
        changed.settings.harmonics == 1 and changed.settings.friction_by_interface()["left"] == 0.2
    )
    assert (
        changed.model.hash
        == vary(study, {"damper_inertia_factor": 1.5}).model.hash
        != study.model.hash
    )
    with pytest.raises(
        bd.SettingError,
        match="no argument 'friction_coefficent'; did you mean friction_coefficient",
    ):
        study.replace(friction_coefficent=0.2)


def test_the_load_of_a_mass_needs_a_speed(study):
    """Without a speed the load is given, and a factor on the mass of all dampers would change their inertia alone."""
    remedies = r"study\.at_speed\(\.\.\.\)\. At a given preload, vary damper_mass_factor\.damper .* or damper_in"
    heavier = {"damper_mass_factor": 1.5}
    for ask in (
        lambda: study.replace(damper_mass_factor=1.5),
        lambda: vary(study, heavier),
        lambda: bd.sweep(study, {"damper_mass_factor": [1.5]}, preload=LOW),
        lambda: bd.compare(
            {"now": study, "heavier": heavier}, lambda s: s.frequency_response(LOW, BAND)
        ),
    ):
        with pytest.raises(
            bd.SettingError, match=f"damper_mass_factor: it needs a rotor speed.*; use {remedies}"
        ):
            ask()


def test_a_former_name_of_the_mass_leads_to_the_present_one(study):
    with pytest.raises(
        bd.SettingError, match=r"no argument 'damper_mass'; did you mean .*damper_mass_factor\?"
    ):
        study.replace(damper_mass=1.5)
    with pytest.raises(
        bd.SettingError, match=r"found 'damper_mass'; did you mean .*damper_mass_factor\?"
    ):
        vary(study, {"damper_mass": 1.5})
    with pytest.raises(
        bd.SettingError, match=r"no argument 'damper_mass'; did you mean damper_mass_factor\?"
    ):
        study.resonance_crossings((400.0, 500.0), [5], damper_mass=(1.0,))


def test_a_speed_is_varied_with_its_model(study):
    """As sweeps do; the factor on the mass comes with its own preload."""
    found, at = vary(study, {"speed": SPEED, "damper_mass_factor": 2.0}), study.at_speed(SPEED)
    assert (
        found.model.bodies["blade"].bases[5].omega2[0]
        == at.model.bodies["blade"].bases[5].omega2[0]
    )
    assert found.preload == pytest.approx(2.0 * at.preload)


# ---- preloads that contradict the centrifugal load ----

BAND, LOW = (270.0, 380.0), 2000.0


@pytest.fixture(scope="module")
def quick():
    model = with_stress(turning_disk((0, 5), spin=True))
    return plain_study(
        model, bd.Excitation("tip", amplitude=10.0), 5, friction_coefficient=0.3, blade_modes=3
    )


@pytest.fixture(scope="module")
def peak(quick):
    return quick.peak(LOW)


def nothing(study, preload):
    return {}


CONTRADICTIONS = {
    "peak": lambda at, peak: at.peak(LOW, BAND),
    "response curve": lambda at, peak: at.frequency_response(
        LOW, BAND, options=bd.ContinuationOptions(budget=20)
    ),
    "static state": lambda at, peak: at.static(LOW),
    "normal forces": lambda at, peak: at.wedge_friction(LOW),
    "nonlinear mode": lambda at, peak: at.nonlinear_mode(LOW, 1, (1e-7, 2e-7)),
    "flutter": lambda at, peak: at.flutter(LOW, -0.01, amplitude=(1e-6, 2e-6)),
    "optimal curve": lambda at, peak: at.optimal_curve(
        (1000.0, LOW), 2, check=False, frequency=BAND
    ),
    "microslip": lambda at, peak: bd.microslip(at, LOW, [20.0]),
    "sweep": lambda at, peak: bd.sweep(at, {"friction_coefficient": [0.3]}, preload=LOW),
    "sweep of a task": lambda at, peak: bd.sweep(
        at, {"friction_coefficient": [0.3]}, bd.PeakTask(LOW)
    ),
    "sweep of preloads": lambda at, peak: bd.sweep(at, {"preload": [1000.0, LOW]}, nothing),
    "uncertainty": lambda at, peak: bd.optimal_curve_uncertainty(
        at, {"friction_coefficient": [0.3]}, (1e3, LOW), 2
    ),
}
ANOTHER = {
    "of stress": (lambda s, at, peak: s.stress(peak, speed=SPEED), "4782 N", "2000 N; possibly 0.418 times"),
    "of a margin": (lambda s, at, peak: s.margin(peak, AISI_1050, speed=SPEED), "4782 N", "2000 N; possibly 0.418"),
    "of margins over frequency": (
        lambda s, at, peak: s.margin(s.frequency_response(LOW, BAND), AISI_1050, speed=SPEED), "4782 N", "2000 N"
    ),
    "of one speed of a sweep": (
        lambda s, at, peak: bd.sweep(s, {"speed": [300.0, SPEED], "preload": [2500.0, 2700.0]}, nothing), "4782 N", "2500"
    ),
    "of one mass of a sweep": (
        lambda s, at, peak: bd.sweep(at, {"damper_mass_factor": [1.0, 2.0], "preload": [at.preload]}, nothing),
        "9564 N", "4782 N",
    ),
}  # fmt: skip


def doubted(ask, load, found):
    with pytest.warns(PlausibilityWarning) as caught:
        ask()
    expected = (
        f"preload: plausible {load}, the centrifugal load of the damper at 400 rad/s, found {found}"
    )
    assert len(caught) == 1 and str(caught[0].message).startswith(expected)
    assert caught[0].filename == __file__


@pytest.mark.slow
@each("name", CONTRADICTIONS)
def test_a_preload_that_contradicts_the_speed_of_the_study_is_named_once(quick, peak, name):
    found = (
        "1000 to 2000 N"
        if name in ("optimal curve", "sweep of preloads", "uncertainty")
        else "2000 N"
    )
    at = quick.at_speed(SPEED)
    doubted(lambda: CONTRADICTIONS[name](at, peak), "4782 N", f"{found}; possibly 0.418 times")
    with warnings.catch_warnings():
        warnings.simplefilter("error", PlausibilityWarning)
        at.problem.check_preload(LOW)
        at.peak(1.1 * LOW, BAND)


def test_stress_and_margin_of_a_contradiction_repeat_it_in_the_headline(quick):
    """The search has warned at the speed of the study."""
    at = quick.at_speed(SPEED)
    with pytest.warns(PlausibilityWarning, match="2000 N; possibly 0.418 times the damper mass"):
        found = at.peak(LOW, BAND)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        results = at.stress(found), at.margin(found, AISI_1050)
    assert all("2000 N; possibly 0.418 times the damper mass" in said(result) for result in results)


@pytest.mark.slow
def test_an_optimum_that_contradicts_the_speed_of_the_study_is_named_once(quick, peak):
    """The range of preloads contains the load."""
    at, curves = quick.at_speed(SPEED), []
    with pytest.warns(PlausibilityWarning) as caught:
        curves.append(at.optimal_curve((1000.0, 6000.0), 3, check=False, frequency=BAND))
    best = curves[0].optimum.preload
    found = f"found {best:.4g} N; possibly {best / at.preload:.3g} times the damper mass"
    assert len(caught) == 1 and found in str(caught[0].message) and caught[0].filename == __file__


@each("name", ANOTHER)
def test_a_preload_that_contradicts_another_speed_is_named_once(quick, peak, name):
    ask, load, found = ANOTHER[name]
    doubted(lambda: ask(quick, quick.at_speed(SPEED), peak), load, found)


@pytest.mark.slow
def test_a_preload_that_contradicts_the_speed_of_the_engine_order_is_in_the_answer(quick, peak):
    turning = 2.0 * np.pi * peak.frequency / 5.0
    load = preload_at(quick.problem, turning)
    words = f"belongs to a preload of {load:.4g} N, the centrifugal load of the damper at {turning:.4g} rad/s, found "
    curve = quick.optimal_curve((1000.0, LOW), 2, check=False)
    results = quick.stress(peak), quick.margin(peak, AISI_1050), quick.margin(curve, AISI_1050)
    for result in results[:2]:
        assert words in said(result) and "found 2000 N" in said(result)
    assert "found 1000 to 2000 N" in said(results[2])
    # the headline does not say that the margin passes
    verdict = "Not for design: the preload and the centrifugal stress belong to different speeds: "
    for result in results:
        assert said(result).startswith(verdict) and "Centrifugal load FAIL" in said(result)
    presses = f"where this damper presses with {amount(load, 'N')}; "
    mass = f"2 kN requires {LOW / load:.2g} times its mass"
    for result in results[:2]:
        assert f"Remedy: use study.at_speed({turning:.4g}), {presses}{mass}" in said(result)
    assert "Largest safety factor" in said(results[2]) and "times its mass" in said(results[2])
    with pytest.warns(PlausibilityWarning):
        given = quick.margin(peak, AISI_1050, speed=1.05 * turning)
    assert said(given).startswith(verdict), "also at a speed that the user gives"
    # the preload of this speed is no contradiction
    at_load = quick.margin(quick.peak(LOW), AISI_1050, speed=float(np.sqrt(LOW / load)) * turning)
    assert "belong" not in said(at_load)
    bare = replace(quick.model, stress={"root": replace(quick.model.stress["root"], static=None)})
    other = quick.replace(model=bare)
    assert "belongs" not in said(other.stress(other.peak(LOW))), (
        "without centrifugal stress it does not matter"
    )


def test_preloads_that_contain_the_centrifugal_load_are_accepted(quick):
    at = quick.at_speed(SPEED)
    with warnings.catch_warnings():
        warnings.simplefilter("error", PlausibilityWarning)
        at.static(1.04 * at.preload)
        bd.sweep(at, {"preload": [LOW, 8000.0]}, nothing)
        bd.sweep(
            at,
            {"damper_mass_factor": [1.0, 2.0], "preload": [at.preload, 2.0 * at.preload]},
            nothing,
        )
        quick.static(LOW)
