"""Margins of solutions: one, along a curve and over the preload, with their pictures and files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.fatigue import AISI_1050, MarginCurve, Margins
from bdamper.fatigue.criteria import amplitude_and_mean
from bdamper.fatigue.stress_cycle import _contact_axes, coefficients_of
from bdamper.harmonic_balance.checks import Solutions
from bdamper.model.structure import StressSet
from bdamper.response.verification import TimeResponse
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.formatting import percent
from tests.every_result import result as example
from tests.models import wedge_model
from tests.printed import said


def with_stress(model, n=3, seed=0, static=True):
    """Random stress rows at a few points, complex as modes are, real at nodal diameter 0."""
    rng = np.random.default_rng(seed)
    blade = model.bodies["blade"]

    def rows(d, columns):
        rng = np.random.default_rng([seed, d, columns])
        real = rng.standard_normal((n, 6, columns))
        return real if d == 0 else real + 1j * rng.standard_normal((n, 6, columns))

    forces = 3 * len(blade.bases[0].contact_modes)
    stress = StressSet(
        name="root",
        body="blade",
        points=rng.standard_normal((n, 3)),
        modes={d: 1e11 * rows(d, basis.n_modes) for d, basis in blade.bases.items()},
        contact={d: 1e4 * rows(d, forces) for d in blade.bases},
        static=rng.uniform(200.0, 400.0, (n, 6)) if static else None,
        near_contact=np.arange(n) == n - 1,
    )
    return replace(model, stress={"root": stress})


@pytest.fixture(scope="module")
def study():
    model = with_stress(bd.reference_model("bladed_disk", 9))
    return bd.Study(model, bd.Excitation("tip", "tangential", 2.0), 5, blade_modes=5)


@pytest.fixture(scope="module")
def peak(study):
    return study.peak(200.0)


@pytest.fixture(scope="module")
def curve(study, peak):
    return study.frequency_response(200.0, (285.0, 360.0))


@pytest.mark.slow
def test_margins_of_a_peak(study, peak):
    cycle, margins = study.stress(peak), study.margin(peak, AISI_1050)
    assert isinstance(margins, Margins) and len(margins) == 3 and margins.names[0] == "root point 1"
    np.testing.assert_allclose(margins.amplitude, cycle.amplitude_and_mean().amplitude)
    np.testing.assert_allclose(margins.factor, AISI_1050.factor(margins.amplitude, margins.mean))
    assert (
        margins.critical != 2 and margins.least == margins.factor[:2].min()
    )  # the last is next to a contact
    assert margins.speed == pytest.approx(
        2.0 * np.pi * peak.frequency / study.settings.engine_order
    )
    assert any("contact faces" in warning for warning in margins.warnings)
    again = study.margin(cycle, AISI_1050)
    np.testing.assert_array_equal(again.factor, margins.factor)


@pytest.mark.slow
def test_a_margin_has_the_error_of_its_amplitude(study, peak):
    """The true changes are those of complete searches with two more harmonics and six more vectors."""
    n_harmonics = study.problem.harmonic_numbers[-1] + 2
    richer = study.replace(harmonics=n_harmonics).peak(200.0)
    by_harmonics = abs(richer.amplitude / peak.amplitude - 1.0)
    margins = study.margin(peak, AISI_1050)
    by_source = {item.source: abs(item.amplitude) for item in peak.errors}
    assert by_source["harmonics"] == pytest.approx(by_harmonics, abs=1e-5)
    assert margins.error == pytest.approx(sum(by_source.values()))
    assert f"Amplitude error {percent(margins.error)}" in said(margins)
    plain = study.margin(study.peak(200.0, errors=False), AISI_1050)
    assert np.isnan(plain.error) and "Amplitude error" not in said(plain)


def test_a_margin_curve_has_the_errors_of_its_amplitudes():
    """Of the computed value that is nearest to the refined one; none where they are unknown."""
    curve = replace(example("margin_curve"), error=np.array([0.02, np.nan]))
    assert "Amplitude error 2 %" in said(replace(curve, best_value=1.1e3, best_margin=2.0))
    assert "Amplitude error" not in said(replace(curve, best_value=1.9e3, best_margin=2.0))
    assert "Amplitude error" not in said(replace(curve, error=None))


@pytest.mark.slow
def test_a_table_that_is_cut_keeps_the_worst_points_and_counts_the_others():
    """The highest of ten points was left out where it was one of the last two."""
    model = with_stress(bd.reference_model("bladed_disk", 9), n=10)
    ten = bd.Study(model, bd.Excitation("tip", "tangential", 2.0), 5, blade_modes=5)
    cycle = ten.stress(ten.peak(200.0))
    lines = str(cycle).split("\n")
    table = [line for line in lines if "root " in line and "MPa" not in line]
    high = np.argsort(-np.where(cycle.counted, cycle.amplitude, -1.0))[:8]
    assert [line.split("root point ")[1].split()[0] for line in table] == [
        cycle.names[i].split()[2] for i in high
    ]
    assert "2 further rows in result.summary()" in lines
    factors = ten.margin(cycle, AISI_1050)
    first = next(
        line for line in factors.summary().split("\n") if line.startswith("  ") and "root" in line
    )
    assert f" {factors.names[factors.critical]} " in f"{first} "


@pytest.mark.slow
def test_what_a_blade_keeps_scales_the_vibration(study, peak):
    """The largest period is a fifth above the balance: so is the vibration, and the margin on it a sixth smaller."""
    kept = TimeResponse(1.1e-6, 1e-6, 1.2 * peak.amplitude, peak.frequency, 200.0, peak.amplitude)
    plain, scaled = study.margin(peak, AISI_1050), study.margin(peak, AISI_1050, time_response=kept)
    np.testing.assert_allclose(scaled.amplitude, 1.2 * plain.amplitude)
    np.testing.assert_allclose(scaled.mean, plain.mean)
    assert scaled.least == pytest.approx(plain.least / 1.2) and "Vibration scaled by 1.2" in said(
        scaled
    )
    assert not any("the amplitude by time integration" in note for note in scaled.notes)
    cut = study.margin(peak, AISI_1050, time_response=replace(kept, status="interrupted"))
    assert (
        "the amplitude by time integration is interrupted" in cut.notes
        and "by time integration is interrupted" in said(cut)
    )
    printed = study.margin(
        peak, AISI_1050, time_response=replace(kept, preload=199.51)
    )  # three digits were typed
    assert printed.least == scaled.least
    with pytest.raises(
        SettingError,
        match=r"^time_response: expected a time integration at 200 N, found .* at 100 N",
    ):
        study.margin(peak, AISI_1050, time_response=replace(kept, preload=100.0))
    with pytest.raises(SettingError, match=r"found .* at 202 N"):
        study.margin(peak, AISI_1050, time_response=replace(kept, preload=202.0))


@pytest.mark.slow
def test_all_harmonics_count(study, peak):
    cycle = study.stress(peak)
    theta = np.array([0.3, 2.0])
    expected = sum(
        (cycle.coefficients[..., l, None] * np.exp(1j * l * theta)).real for l in range(4)
    )
    np.testing.assert_allclose(cycle.over_cycle(theta), expected, rtol=1e-12)
    assert np.abs(cycle.coefficients[..., 3]).max() > 0.0


@pytest.mark.slow
def test_along_a_curve_the_margin_is_that_of_each_point_and_continuous_over_folds(study, curve):
    margins = study.margin(curve, AISI_1050)
    assert isinstance(margins, MarginCurve) and len(margins) == len(curve)
    for i in (0, len(curve) // 2):
        assert study.margin(curve, AISI_1050, i).least == pytest.approx(
            margins.margin[i], rel=1e-12
        )
    # the amplitude is a seminorm of the stress: it cannot jump where the solution does not
    cycles = np.array([study.stress(curve, i).coefficients for i in range(0, len(curve), 5)])
    change = amplitude_and_mean(np.diff(cycles, axis=0).reshape(-1, 6, 4)).amplitude.reshape(-1, 3)
    apart = np.abs(np.diff(margins.amplitude[::5], axis=0))
    assert (apart <= change * (1.0 + 1e-9)).all() and apart.max() > 0.3 * change.max()
    assert (
        len(curve.folds)
        and margins.margin[int(curve.amplitude.argmax())] < 2.0 * margins.margin.min()
    )


def test_a_free_curve_has_the_stress_of_all_modes_under_the_excitation_alone(study):
    """Closed form without contact forces and without the mean stress of the dampers."""
    free, root = study.free((200.0, 400.0)), study.model.stress["root"]
    i, basis = free.peak_index, study.model.bodies["blade"].bases[5]
    w, cycle = 2.0 * np.pi * free.frequency[i], study.stress(free, i)
    dynamic = basis.omega2 - w**2 + 2j * basis.damping_ratio * np.sqrt(basis.omega2) * w
    expected = root.modes[5] @ (2.0 * basis.locations["tip"][0].conj() / dynamic)
    np.testing.assert_allclose(
        cycle.coefficients[..., 1], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
    )
    np.testing.assert_allclose(cycle.coefficients[..., 0], cycle.speed**2 * root.static, rtol=1e-12)
    along, one = study.margin(free, AISI_1050), study.margin(free, AISI_1050, i)
    assert along.margin[i] == pytest.approx(one.least, rel=1e-12)
    assert not [
        note for note in one.notes if "preload" in note
    ]  # the centrifugal stress is that without dampers
    gauge = study.gauge_stress(free, "root point 1", (1.0, 0.0, 0.0))
    np.testing.assert_allclose(gauge[i], cycle.coefficients[0, 0], rtol=1e-12)


def test_contact_forces_on_both_ports_of_a_blade_add_their_stress():
    """Springs on the relative motion, turned back from the sector of each port, times unit stresses."""
    order, n_blades, springs = 2, 12, 1e8
    model = with_stress(wedge_model(n_points=1, n_blade_modes=2, harmonics=1, n_damper_modes=1))
    bonded = bd.Study(
        model,
        bd.Excitation("tip"),
        order,
        harmonics=1,
        friction_law="bonded",
        constraint_planes=False,
        contact_stiffness=springs,
    ).problem
    u = 1e-6 * np.random.default_rng(3).standard_normal(bonded.n_unknowns)
    solution = Solutions(u[None], np.array([300.0]), np.array([100.0]), np.array(["response"]))
    found = coefficients_of(bonded, solution, tuple(model.stress.values()))[0, ..., 1]

    # unknowns: mean, cosine and sine of two blade modes and six rigid motions of the damper
    q = u[8:16] - 1j * u[16:]
    left, right = springs * (bonded.bases[1].G @ q)
    # the blade is body b: forces along t1 and t2 pull it back, and N is compression
    on_b = np.array([-1.0, -1.0, 1.0])
    # the right face is on the blade of the next sector, whose motion has this phase lead
    lead = np.exp(2j * np.pi * order / n_blades)
    on_ports = np.concatenate([on_b * left, on_b * right / lead])
    root = model.stress["root"]
    of_contacts = root.contact[order] @ on_ports
    expected = root.modes[order] @ q[:2] + of_contacts
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert np.abs(of_contacts).max() > 0.1 * np.abs(expected).max()


@pytest.mark.slow
def test_a_stuck_curve_has_the_stress_of_a_bonded_contact(study):
    """By the equations of that law; linear in the excitation, the same for all coefficients of friction."""
    bonded = study.replace(friction_law="bonded", constraint_planes=False)
    limit, peak = (
        bonded.stress(x)
        for x in (bonded.stuck((200.0, 400.0), 200.0), bonded.peak(200.0, (200.0, 400.0)))
    )
    tiny = 1e-6 * np.abs(peak.coefficients[..., 1:]).max()
    # a maximum found from its values is known to the square root of the rounding, and the phase turns fast there
    one, other = limit.coefficients[..., 1:], peak.coefficients[..., 1:]
    turn = np.vdot(one, other) / abs(np.vdot(one, other))
    assert abs(np.angle(turn)) < 1e-4
    np.testing.assert_allclose(turn * one, other, rtol=1e-6, atol=tiny)
    # the stiffness of the model depends on the slip at rest
    study = study.replace(contact_stiffness=1e8)
    stuck = study.stuck((200.0, 400.0), 200.0)
    own = study.stress(stuck).coefficients[..., 1:]
    for other, factor in [
        (study.replace(excitation=bd.Excitation("tip", "tangential", 6.0)), 3.0),
        (study.replace(friction_coefficient=0.33), 1.0),
    ]:
        there = other.stress(other.stuck((200.0, 400.0), 200.0)).coefficients[..., 1:]
        np.testing.assert_allclose(there, factor * own, rtol=1e-6, atol=1e-6 * np.abs(own).max())
    resting = study.replace(bias=False)
    still = resting.stress(resting.peak(200.0), speed=0.0).coefficients[..., 0]
    np.testing.assert_allclose(
        study.stress(stuck, speed=0.0).coefficients[..., 0], still, rtol=1e-9
    )


def test_linear_limits_are_refused_where_the_contact_law_is_evaluated(study):
    """A peak does not say that it belongs to a limit, but it does not solve the equations."""
    for limit in (study.free((200.0, 400.0)), study.stuck((200.0, 400.0))):
        with pytest.raises(
            SettingError,
            match=rf"^plot_contacts: expected a response .*, found a {limit.kind} curve",
        ):
            limit.plot_contacts(study)
        for refuses in (
            study.margin,
            study.stress,
            study.hysteresis,
            lambda peak, *_: peak.plot_contacts(study),
        ):
            with pytest.raises(SettingError, match="found a free or stuck response"):
                refuses(limit.peak, *([AISI_1050] if refuses == study.margin else []))


def test_more_speed_leaves_less_margin_and_a_mean_beyond_the_strength_none(study, peak):
    slow, fast, broken = (
        study.margin(peak, AISI_1050, speed=speed) for speed in (0.0, 300.0, 3000.0)
    )
    assert slow.least > fast.least > broken.least == 0.0 and broken.yields
    assert any("yields in the first cycle" in warning for warning in broken.warnings)


@pytest.mark.slow
def test_findley_leads_to_a_margin_of_the_same_size(study, peak):
    plain, other = study.margin(peak, AISI_1050), study.margin(peak, AISI_1050, criterion="findley")
    assert other.least < 20.0 * plain.least


@pytest.mark.slow
def test_points_beside_contact_faces_do_not_count(study):
    """However large their stress; with them alone there is no margin."""
    study, root = study.replace(harmonics=1), study.model.stress["root"]
    scale = np.where(root.near_contact, 1e3, 1.0)[:, None, None]

    def with_root(**changes):
        return study.replace(model=replace(study.model, stress={"root": replace(root, **changes)}))

    rows = {
        name: {d: scale * x for d, x in getattr(root, name).items()}
        for name in ("modes", "contact")
    }
    loud = with_root(**rows)
    own, louder = (of.margin(of.peak(200.0), AISI_1050) for of in (study, loud))
    assert louder.factor[2] < 0.1 * louder.least and louder.critical != 2
    assert louder.least == pytest.approx(own.least, rel=1e-6)
    along = loud.margin(loud.frequency_response(200.0, (285.0, 360.0)), AISI_1050)
    assert (along.factor[:, 2] < along.margin).all() and (along.critical != 2).all()
    np.testing.assert_array_equal(along.margin, along.factor[:, :2].min(axis=1))
    beside = with_root(near_contact=np.ones(3, bool))
    for result in (beside.peak(200.0), beside.frequency_response(200.0, (285.0, 300.0))):
        with pytest.raises(
            SettingError, match=r"^margin: expected points away from contact faces, found none"
        ):
            beside.margin(result, AISI_1050)


@pytest.mark.slow
def test_the_headline_says_what_makes_the_least_margin_doubtful(study):
    """Elements that differ at its point, and smaller factors that are left out; not doubts about other points."""
    one, root = study.replace(harmonics=1, friction_law="bonded"), study.model.stress["root"]

    def printed(**changes):
        other = one.replace(model=replace(one.model, stress={"root": replace(root, **changes)}))
        peak, curve = (
            other.peak(200.0, (285.0, 400.0)),
            other.frequency_response(200.0, (350.0, 375.0)),
        )
        return [other.margin(result, AISI_1050) for result in (peak, curve)]

    plain = printed(near_contact=None)
    for margins in plain:
        assert "Elements" not in said(margins) and "Omitted" not in said(margins)
    factor, critical = plain[0].factor, plain[0].critical
    numbered = {
        "nodes": np.array([215, 7, 88]),
        "spread": np.where(np.arange(3) == critical, 0.597, 0.1),
    }
    name = f"root node {numbered['nodes'][critical]}"
    doubt = f" Elements at {name} differ by 59.7 %: its stress may not have converged with the mesh"
    for margins in printed(near_contact=None, **numbered):
        text = said(margins)
        # the preload belongs to another speed, so that the headline has no margin: a row has it
        assert doubt in text
        assert any(at in text.replace(doubt, "") for at in (f"at {name}", f", {name}"))
    largest = np.arange(3) == factor.argmax()
    for margins in printed(
        near_contact=largest, spread=0.9 * largest
    ):  # the point with the largest factor, not with the least margin
        assert "Elements" not in said(margins) and "Omitted" not in said(margins)
        assert "omitted: 1 point on or next to contact faces" in margins.notes
    in_time = replace(
        plain[0],
        notes=("vibration scaled by 1.2", doubt.strip().replace("E", "e"), *margins.notes),
    )
    assert f"vibration scaled by 1.2;{doubt.replace('E', 'e')}" in said(
        replace(margins, in_time=(in_time,))
    )
    for margins in printed(near_contact=np.arange(3) == critical):
        text = " Omitted: 1 point on or next to contact faces, 1 of them with a smaller factor"
        assert text in said(margins)


def test_a_curve_without_any_margin_says_so(study, curve, tmp_path):
    none = replace(study.margin(curve, AISI_1050), margin=np.full(len(curve), np.nan))
    assert "found at any" in str(none) and not any(
        "margin" in fact.name for fact in none._facts() if fact.known
    )
    assert none._headline().startswith("No fatigue safety factor was found at any of")
    for place in ("least", "greatest"):
        with pytest.raises(
            BdamperError, match=f"^no margin found at any of {len(curve)} values of frequency$"
        ):
            getattr(none, place)
    none.plot()
    none.save(tmp_path / "none.h5")
    assert str(bd.load(tmp_path / "none.h5")) == str(none)


@pytest.mark.slow
def test_what_cannot_be_asked_is_said(study, peak, curve):
    with pytest.raises(SettingError, match="expected a model with stress sets"):
        study.replace(model=replace(study.model, stress={})).stress(peak)
    with pytest.raises(SettingError, match="stress set"):
        study.stress(peak, sets="tip")
    with pytest.raises(SettingError, match="unknowns"):
        study.replace(harmonics=1).stress(peak)
    with pytest.raises(SettingError, match="criterion"):
        study.margin(peak, AISI_1050, criterion="tresca")
    with pytest.raises(SettingError, match="index"):
        study.stress(curve, len(curve))
    with pytest.raises(SettingError, match="material"):
        study.margin(peak, 300e6)
    with pytest.raises(
        SettingError, match="at the rotor speed of this study, 300 rad/s, found none"
    ):
        study.at_speed(300.0).margin(curve, AISI_1050)
    one = study.replace(harmonics=1)
    turning = one.at_speed(300.0).peak(2690.0)  # the load of the damper at this speed
    assert one.at_speed(300.0).margin(turning, AISI_1050).speed == 300.0
    with pytest.raises(
        SettingError, match="at the rotor speed of this study, 310 rad/s, found 300 rad/s"
    ):
        one.at_speed(310.0).margin(turning, AISI_1050)
    with pytest.raises(
        SettingError, match="expected a result of this study, found friction_coefficient = "
    ):
        study.replace(friction_coefficient=0.2).margin(peak, AISI_1050)
    with pytest.raises(
        SettingError,
        match="expected a result of this study's model, found a result of another model",
    ):
        study.replace(model=with_stress(study.model, seed=1)).margin(peak, AISI_1050)
    bare = one.replace(model=replace(one.model, stress={})).peak(200.0)
    assert one.margin(bare, AISI_1050).least == pytest.approx(
        one.margin(one.peak(200.0), AISI_1050).least, rel=1e-9
    )


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{}, {"separation": False}, {"variable_normal_load": False}])
def test_contact_forces_are_those_of_the_equations_in_the_axes_of_the_model(study, settings):
    other = study.replace(**settings)
    system = other.problem.system(200.0)
    force = np.random.default_rng(1).standard_normal((system.n_points, 3))
    in_equations = np.einsum("pdm,pd->m", system.structure.bases[1].G.conj(), force)
    there = np.einsum("pdk,pd->k", _contact_axes(other.problem, 200.0), force).reshape(-1, 3)
    np.testing.assert_allclose(
        np.einsum("pdm,pd->m", other.problem.bases[1].G.conj(), there), in_equations, rtol=1e-9
    )
