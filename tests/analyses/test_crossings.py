"""Crossings against rotor speed, the run-up along a line, and both against each other."""

import re
from dataclasses import replace
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import crossings, engine_order_line
from bdamper.analyses.campbell import run_up
from bdamper.analyses.engine_order_line import (
    SpeedFamily,
    exact,
    exact_at_fixed_speed,
    follow_line,
    follow_mode,
)
from bdamper.harmonic_balance.rotor_speed import RPM, Conditions
from bdamper.plot import plot_crossings
from bdamper.response.linear_limits import free_and_stuck, resonance_interval
from bdamper.response.peak import amplitude_at
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util.formatting import amount, peak_text, percent
from bdamper.util.progress import CostMeter
from bdamper.util.records import named_fields, row_of
from tests.plain import plain_study
from tests.printed import said
from tests.turning import turning_disk

SPEEDS = (400.0, 450.0, 500.0, 560.0)
OVER_SPEED = {"friction": {300.0: 0.3, 600.0: 0.4}, "excitation": lambda omega, order: 0.04 * omega}


@pytest.fixture(scope="module")
def study():
    return plain_study(
        turning_disk((0, 5)), bd.Excitation("tip", amplitude=20.0), 5, friction_coefficient=0.3
    )


@pytest.fixture(scope="module")
def found(study):
    return study.resonance_crossings(SPEEDS, [5], damper_mass_factor=(0.999, 1.0, 1.001))


@pytest.mark.slow
def test_an_order_that_the_model_has_no_modes_for_fails_alone(study, found):
    """The other crossings are there, and what the model neglects is told of them."""
    both = study.resonance_crossings(SPEEDS, [4, 5])
    assert (
        both.status[0].startswith("failed")
        and "nodal diameter" in both.reason[0]
        and not both.complete
    )
    assert (
        both.values[1]["kind"] == "complete"
        and both.values[1]["amplitude"] == found.values[1]["amplitude"]
    )
    assert both.warnings == ("", "")


@pytest.mark.slow
def test_the_errors_of_crossings_can_be_left_out(study, found, monkeypatch):
    """The crossing itself stays the same, and no richer peak is computed."""

    def not_asked(*_):
        raise AssertionError("errors are computed")

    monkeypatch.setattr(crossings, "peak_errors", not_asked)
    without = study.resonance_crossings(SPEEDS, [5], errors=False)
    assert without.values[0]["amplitude"] == found.values[1]["amplitude"]
    assert np.isfinite(found.values[1]["error"]) and np.isnan(without.values[0]["error"])
    assert "error about" in str(found) and "error about" not in str(without)


def test_crossings_that_all_failed_are_named_with_the_remedy(study, monkeypatch):
    """No crossing has a speed then, and the list of quantities is empty."""

    def fails(*_):
        raise bd.BdamperError("no static state at 400 rad/s")

    monkeypatch.setattr(crossings, "follow_mode", fails)
    none = study.resonance_crossings(SPEEDS, [5])
    words = (
        r"quantity: expected at least one point whose result contains 'speed', found none "
        r"\(damper mass factor 1, engine order 5: failed: no static state at 400 rad/s\); change"
    )
    with pytest.raises(bd.SettingError, match=words):
        none.array("speed")


NOT_RUN = "Mass factor Order Speed Preload Frequency Peak"


@pytest.mark.slow
def test_the_headline_is_the_highest_crossing_or_says_that_there_is_none(study, found, tmp_path):
    i = int(np.argmax(found.values["amplitude"]))
    top, mass = row_of(found.values, i), found.points[i]["damper_mass_factor"]
    # a source that does not apply has no change
    error = np.nansum(np.abs([top["harmonic_change"], top["vector_change"]]))
    highest = (
        f"Highest crossing {peak_text(top['amplitude'], top['frequency'])}, "
        f"error about {percent(error)}, damper mass factor {mass:g}, engine order 5"
    )
    speed = f"Speed {top['speed'] * RPM:.0f} rpm {top['speed']:.5g} rad/s"
    preload = f"Preload {amount(top['preload'], 'N')}"
    single = replace(
        found,
        points=found.points[[i]],
        values=found.values[[i]],
        status=("complete",),
        shape=(1, 1),
    )
    assert single._headline() == highest
    assert f"{highest} {speed} {preload} {NOT_RUN}" in said(single)
    rows = [
        {**top, "kind": "incomplete", "warning": "why", "margin": 1.25},
        *(row_of(found.values, k) for k in (0, 1)),
    ]
    doubted = {name: [row.get(name) for row in rows] for name in rows[0]}
    one_mass = np.array([(1.0, order) for order in (5, 6, 7)], found.points.dtype)
    doubtful = replace(found, points=one_mass)
    doubted_text = said(replace(doubtful, values=named_fields(doubted, 3)))
    noted = {
        name: ["complete" if name == "kind" else x for x in column]
        for name, column in doubted.items()
    }
    assert " Note: why " in said(replace(doubtful, values=named_fields(noted, 3)))
    least = "Margin 1.25 smallest against fatigue, damper mass factor 1, engine order 5"
    assert least in doubted_text and " There may be a higher point: why " in doubted_text
    none = study.resonance_crossings((10.0, 20.0), [5])
    why = none.warnings[0]
    limits = (
        r"engine order 5 crosses mode 1 at 3601.8 rpm with free contacts and at \S+ rpm with stuck "
        r"contacts; give a range wider than 95.493 to 190.99 rpm"
    )
    assert re.fullmatch(limits, why)
    assert none._headline() == f"No crossing: {why}" and " nan" not in str(none)
    rows = [*(row_of(found.values, k) for k in (0, 1)), row_of(none.values, 0)]
    mixed = replace(
        found, values=named_fields({name: [r.get(name) for r in rows] for name in rows[0]}, 3)
    )
    assert f" No crossing at 1 of 3 points: {why} " in said(mixed)
    none.save(tmp_path / "none.h5")
    assert type(bd.load(tmp_path / "none.h5")) is type(none)


NAN = float("nan")
BY_MASS = {
    "a value everywhere": (
        [(3.0, 1.0), (2.0, 2.5), (1.0, 4.0)],
        "2",
        "2.5 mm",
        "Other masses 3 to 4 mm",
    ),
    "a missing value": (
        [(3.0, 1.0), (2.0, NAN), (1.0, 4.0)],
        "1",
        "3 mm",
        "Other masses 4 mm",
    ),
    "an order without values": (
        [(3.0, NAN), (2.0, NAN), (1.0, NAN)],
        "3",
        "1 mm",
        "Other masses 2 to 3 mm",
    ),
    "one mass with values": ([(3.0, 1.0), (NAN, NAN), (NAN, 4.0)], "", "4 mm", ""),
}


@pytest.mark.parametrize("name", BY_MASS)
def test_a_study_over_the_mass_names_the_best_mass(found, name):
    """Its highest crossing over all engine orders is the lowest among the masses whose crossings are all known."""
    heights, best, highest, others = BY_MASS[name]
    points = [(mass, order) for mass in (1.0, 2.0, 3.0) for order in (5, 6)]
    top = row_of(found.values, 0)
    rows = []
    for height in (1e-3 * height for pair in heights for height in pair):
        known = np.isfinite(height)
        why = "" if known else "why"
        rows.append(
            {
                **top,
                "amplitude": height,
                "kind": "complete" if known else "not found",
                "warning": why,
            }
        )
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    made = replace(
        found, points=np.array(points, found.points.dtype), values=named_fields(columns, 6), status=("complete",) * 6,
        seconds=np.zeros(6), shape=(3, 2), cost=None,
    )  # fmt: skip
    first = "Highest crossing"
    if best:
        end = {"1": ", at the lower end of the range", "3": ", at the upper end of the range"}
        end = end.get(best, "")
        first = f"Lowest crossing peak with {best} times the damper mass{end}:"
    assert made._headline().startswith(f"{first} {highest} at ")
    assert ("Remedy: include damper_mass_factor below 1" in said(made)) == (best == "1")
    assert ("Remedy: include damper_mass_factor above 3" in said(made)) == (best == "3")
    assert others in said(made)


@pytest.mark.slow
def test_the_best_mass_has_the_lower_of_two_crossings(study):
    found = study.resonance_crossings((400.0, 500.0), [5], damper_mass_factor=(0.5, 1.0))
    heights = dict(zip((0.5, 1.0), found.array("amplitude")[:, 0].tolist()))
    best = min(heights, key=heights.get)
    amplitude = amount(heights[best], "m")
    end = "lower" if best == 0.5 else "upper"
    assert found._headline().startswith(
        f"Lowest crossing peak with {best:g} times the damper mass, at the {end} end of the range: {amplitude} "
    )


def test_crossings_of_an_earlier_version_have_the_present_names(found, tmp_path):
    """Files of version 3 call load and inertia "damper_mass", and the inertia alone "damper_mass_factor"."""
    former = {"damper_mass_factor": "damper_mass", "engine_order": "engine_order"}
    points = named_fields({former[name]: found.points[name] for name in former}, len(found))
    old = replace(found, names=tuple(former.values()), points=points)
    inert = replace(found, names=("damper_mass_factor", "engine_order"))
    for result, name in ((old, "damper_mass_factor"), (inert, "damper_inertia_factor")):
        result.save(path := tmp_path / "crossings.h5")
        with h5py.File(path, "r+") as file:
            file.attrs["version"] = 3
        read = bd.load(path)
        assert read.names == read.points.dtype.names == (name, "engine_order")
        np.testing.assert_array_equal(read.points[name], found.points["damper_mass_factor"])
    assert bd.load(path).array("amplitude").tolist() == found.array("amplitude").tolist()
    found.save(path)
    assert bd.load(path).names == found.names


@pytest.mark.slow
def test_a_crossing_is_the_highest_point_of_the_line(study, found):
    """On the line, at the preload of its speed, and solutions on the line beside it are lower, as a maximum has them."""
    assert found.complete and {value["kind"] for value in found.values} == {"complete"}
    assert found.points[1].item() == (1.0, 5)
    value = found.values[1]
    assert value["speed"] == pytest.approx(2.0 * np.pi * value["frequency"] / 5, rel=1e-12)
    assert value["preload"] == pytest.approx(study.at_speed(value["speed"]).preload, rel=1e-12)
    run = study.run_up((400.0, 560.0))
    assert len(run) > 10 and not run.peak_at_end
    assert run.speed[run.peak_index] == pytest.approx(value["speed"], rel=1e-7)
    assert run.peak.amplitude == pytest.approx(value["amplitude"], rel=1e-9)
    family = SpeedFamily(study.problem, Conditions())
    top = exact(family, follow_line(family, (400.0, 560.0), 1, CostMeter())[2].peak)[0]
    lower = []
    for part in (-4e-4, -2e-4, 2e-4, 4e-4):
        speed = top.parameter * (1.0 + part)
        c = family.system(speed).correct_at(top.y[:-1], 5.0 * speed, top.scale, 1e-10, 30)
        assert c.status == 0
        lower.append(1.0 - amplitude_at(family.system(speed), c.y) / top.amplitude)
    assert min(lower) > 0.0
    assert lower[0] / lower[1] == pytest.approx(4.0, rel=0.1) and lower[3] / lower[
        2
    ] == pytest.approx(4.0, rel=0.1)


def test_the_peak_at_fixed_speed_is_that_of_the_study_there(study, found):
    value = found.values[1]
    at = study.at_speed(value["fixed_speed"])
    peak = at.peak(at.preload)
    assert peak.amplitude == pytest.approx(value["fixed_speed_amplitude"], rel=1e-6)
    assert 2.0 * np.pi * peak.frequency / 5 == pytest.approx(value["fixed_speed"], rel=1e-6)
    assert 0.0 < value["amplitude"] / value["fixed_speed_amplitude"] - 1.0 < 1e-3


def test_derivatives_by_the_mass_are_those_of_crossings_at_other_masses(found):
    """Load and inertia together; the inertia alone changes a hundredth as much."""
    low, middle, high = found.values
    for name in ("amplitude", "speed"):
        assert middle[f"{name}_by_mass"] == pytest.approx(
            (high[name] - low[name]) / 0.002, rel=1e-4
        )
    assert high["mass"] / low["mass"] == pytest.approx(1.001 / 0.999, rel=1e-12)


@pytest.mark.slow
def test_a_run_up_is_a_curve_over_speed(study, found, tmp_path):
    """With the highest point and the peak at fixed speed of the crossing; its unknowns are those of no study."""
    run = study.run_up((420.0, 465.0))
    value = found.values[1]
    assert isinstance(run, ResponseCurve) and run.complete and not run.peak_at_end, str(run)
    assert run.speed.min() == pytest.approx(420.0) and run.speed.max() == pytest.approx(465.0)
    np.testing.assert_allclose(2.0 * np.pi * run.frequency, 5.0 * run.speed, rtol=1e-12)
    top = run.peak_index
    assert run.amplitude[top] == pytest.approx(value["amplitude"], rel=1e-9)
    assert run.unknowns.shape == (len(run), 0)
    fixed = f"{1e3 * value['fixed_speed_amplitude']:.4g} mm at {value['fixed_speed']:.5g} rad/s"
    assert f"above the peak at fixed speed, {fixed}" in run.summary()
    assert "interpolation in speed leaves a residual of" in run.summary()
    assert "4208.3 rpm, engine order 5" in run._headline()
    assert (
        run.plot().axes[0].get_xlabel() == "Rotor speed (rpm)"
        and run.columns()["speed"].unit == "rad/s"
    )
    run.save(tmp_path / "run.h5")
    again = bd.load(tmp_path / "run.h5")
    np.testing.assert_array_equal(again.speed, run.speed)
    assert again.summary() == run.summary()
    with pytest.raises(
        bd.SettingError,
        match=r"curve: expected a response curve .study.frequency_response., found a run-up curve",
    ):
        study.hysteresis(run)


def newton_fails(study, monkeypatch):
    """No peak of the interpolated equations at fixed speed is found."""
    peak = replace(study.peak(5800.0), status="not found", reason="tried")
    monkeypatch.setattr(engine_order_line, "find_peak", lambda *_, **__: peak)


@pytest.mark.slow
def test_where_newtons_method_fails_the_peak_at_fixed_speed_is_found_by_a_search(
    study, found, monkeypatch
):
    newton_fails(study, monkeypatch)
    row = study.resonance_crossings(SPEEDS, [5]).values[0]
    assert (row["kind"], row["warning"]) == ("complete", "")
    # the search ends within 0.3 % of the line
    assert row["fixed_speed"] == pytest.approx(found.values[1]["fixed_speed"], rel=3e-3)
    at = study.at_speed(row["fixed_speed"])
    assert row["fixed_speed_amplitude"] == pytest.approx(at.peak(at.preload).amplitude, rel=1e-9)
    assert "above the peak at fixed speed" in study.run_up((420.0, 465.0)).summary()


@pytest.mark.slow
def test_a_missing_peak_at_fixed_speed_has_its_reason(study, monkeypatch):
    """A crossing that is complete otherwise, and a run-up, state why."""
    newton_fails(study, monkeypatch)
    lost = replace(study.peak(5800.0), status="not found", reason="tried")
    monkeypatch.setattr(engine_order_line, "highest_peak", lambda *_, **__: lost)
    row = study.resonance_crossings(SPEEDS, [5]).values[0]
    why = "no peak found at fixed speed, starting from the highest point on the line: not found: tried"
    assert (row["kind"], row["warning"]) == ("complete", why) and np.isnan(row["fixed_speed"])
    assert study.run_up((420.0, 465.0)).summary().count(why) == 1


def test_a_warning_of_all_crossings_is_said_once(found):
    """Rows of the table have the warnings of their own."""
    neglected = "neglected: modes of one rotor speed; frequencies do not change"
    rows = [{**row_of(found.values, k), "warning": neglected} for k in range(3)]
    by_name = {name: [row[name] for row in rows] for name in rows[0]}
    same = replace(found, values=named_fields(by_name, 3))
    assert same.summary().count("modes of one rotor speed") == 1
    assert same.warnings == (neglected,) * 3
    by_name["warning"] = [f"residual; {neglected}", neglected, f"no peak; {neglected}"]
    mixed = replace(found, values=named_fields(by_name, 3))
    text = mixed.summary()
    # the rows of the table do not have the common part
    assert text.count("modes of one rotor speed") == 1
    # the table of three points is turned
    (own,) = [line.split() for line in text.split("\n") if line.startswith("  warning ")]
    assert own == ["warning", "residual", "no", "peak"]


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "highest", "fixed"), [(1.0, (2.9284e-3, 487.80), (2.9262e-3, 487.49)),
                                                        (0.5, (1.5582e-3, 493.56), (1.5582e-3, 493.56))])  # fmt: skip
def test_where_faces_open_the_highest_point_is_the_end_of_a_plateau(mass, highest, fixed):
    """It meets the line at a higher speed than the highest peak at fixed speed does, under more load, and is higher."""
    shipped = bd.reference_model("bladed_disk", 9)
    # the plateau with one harmonic is that of the force vectors of bonded faces alone
    study = bd.Study(
        shipped,
        bd.Excitation("tip", amplitude=20.0),
        5,
        friction_coefficient=0.3,
        harmonics=1,
        contact_stiffness=bd.ResidualModes(partial_contact=False),
    )
    found = study.resonance_crossings((400.0, 600.0), [5], damper_mass_factor=(mass,))
    (value,) = found.values
    assert value["kind"] == "complete", str(found)
    assert (value["amplitude"], value["speed"]) == pytest.approx(highest, rel=1e-4)
    assert (value["fixed_speed_amplitude"], value["fixed_speed"]) == pytest.approx(fixed, rel=1e-4)


def test_a_range_that_ends_higher_than_its_maximum_is_told(study):
    """The same line up to just before its highest maximum: a maximum of its own is no more its highest point."""
    run = study.run_up((420.0, 465.0))
    higher = replace(
        run, harmonics=np.vstack([run.harmonics[:-1], 1.01 * run.harmonics[[run.peak_index]]])
    )
    assert not run.peak_at_end and higher.peak_at_end
    assert "at the upper end of the curve" in higher._headline()


@pytest.mark.slow
def test_pictures_of_crossings(study, found):
    ax = plot_crossings(found)
    assert [text.get_text() for text in ax.texts] == [
        "EO 5"
    ] and ax.get_ylabel() == "Resonance amplitude (mm)"
    with pytest.raises(bd.SettingError, match="quantity: these crossings have no margin"):
        plot_crossings(found, quantity="margin")
    campbell = study.campbell(SPEEDS, [5], modes=1, damped=found)
    labels = campbell.plot().axes[0].get_legend_handles_labels()[1]
    assert labels[:2] == ["free, nodal diameter 5", "stuck"] and labels[-1].startswith("damped, ")
    assert campbell.plot_safe(500.0).axes[0].get_title() == "4775 rpm"
    with pytest.raises(
        bd.SettingError, match=r"damped: expected crossings, as Study\.resonance_crossings"
    ):
        study.campbell(
            SPEEDS, [5], damped=bd.sweep(study, {"preload": [2e3]}, frequency=(340.0, 350.0))
        )


@pytest.fixture(scope="module")
def line(study):
    """A family and its line, with residual modes, friction and excitation that change with speed."""
    turning = plain_study(
        turning_disk((0, 5), spin=True),
        study.excitation,
        5,
        friction_coefficient=0.3,
        contact_stiffness="residual_modes",
    )
    family = SpeedFamily(turning.problem, Conditions(**OVER_SPEED))
    return family, follow_line(family, (440.0, 500.0), 1, CostMeter())


@pytest.mark.slow
def test_the_highest_point_of_a_run_up_is_made_at_its_own_speed(line):
    """Not that of the interpolated equations."""
    family, (_, curve, highest) = line
    run, own = (
        run_up(family.whole, (440.0, 500.0), conditions=Conditions(**OVER_SPEED)),
        exact(family, highest.peak)[0],
    )
    assert len(run) == len(curve) and run.peak_index == highest.index
    assert run.peak.amplitude == pytest.approx(own.amplitude, rel=1e-12)
    assert abs(highest.peak.amplitude / own.amplitude - 1.0) > 1e-11
    assert run.residual[highest.index] < 1e-9


@pytest.mark.slow
def test_the_equations_along_the_line_are_those_of_each_speed(line):
    """The interpolation of NumPy gives the same residual, and its differences the derivative along the line."""
    equations, top = line[1][0], line[1][2].peak
    y = top.y * (1.0 + 1e-3 * np.random.default_rng(0).standard_normal(len(top.y)))
    y[-1] = 5.0 * 470.0
    r, J, by_line = equations.evaluate_at(y)
    there = equations.structure.at(y[-1])
    np.testing.assert_allclose(r, there.residual(y), rtol=1e-9, atol=1e-12 * np.abs(r).max())
    np.testing.assert_allclose(J, there.evaluate_at(y)[1], rtol=1e-9, atol=1e-12 * np.abs(J).max())

    def difference(h, value):
        return (value(y[-1] + h) - value(y[-1] - h)) / (2.0 * h)

    def residual(omega):
        return equations.structure.at(omega).residual(np.append(y[:-1], omega))

    def height(omega):
        return 0.5 * amplitude_at(equations.structure.at(omega), np.append(y[:-1], omega)) ** 2

    errors = [float(np.abs(difference(h, residual) - by_line).max()) for h in (0.05, 0.15, 0.5)]
    assert min(errors) <= 1e-8 * np.abs(by_line).max(), errors
    assert not np.allclose(by_line, there.evaluate_at(y)[2], rtol=1e-2, atol=0.0), (
        "speed changes more than frequency"
    )
    gradient, square = equations.rows.squared_gradient(y)
    assert square == pytest.approx(2.0 * height(y[-1]), rel=1e-12)
    assert gradient[-1] == pytest.approx(difference(0.5, height), rel=1e-6) and gradient[-1] != 0.0


@pytest.mark.slow
def test_corners_of_tables_over_speed_take_a_shorter_range(study):
    """Friction that rises from a speed near the crossing on: polynomials over the whole range are off there."""
    table = {300.0: 0.3, 435.0: 0.3, 600.0: 0.6}
    found = study.resonance_crossings((400.0, 500.0), [5], friction=table)
    run = study.run_up((400.0, 500.0), friction=table)
    assert "incomplete" in str(run) and run.reason.endswith(
        "at the highest point; use a shorter range of speeds"
    )
    assert run.peak.amplitude == pytest.approx(found.values[0]["amplitude"], rel=1e-9)
    beyond = study.run_up((436.5, 470.0), friction=table)
    words = r"interpolation over the range leaves a residual of \S+; use a shorter range"
    assert found.values[0]["kind"] == "incomplete" and re.search(words, found.warnings[0])
    assert found.values[0]["amplitude"] == pytest.approx(beyond.peak.amplitude, rel=1e-6)
    falling = {
        300.0: 0.5,
        420.0: 0.5,
        445.0: 0.1,
        600.0: 0.1,
    }  # another point of the interpolated line is higher
    with pytest.raises(
        bd.SettingError,
        match="speeds: expected a speed range in which the equations change smoothly",
    ):
        study.run_up((400.0, 500.0), friction=falling)
    assert (
        study.resonance_crossings((400.0, 500.0), [5], friction=falling).values[0]["kind"]
        == "incomplete"
    )


def test_answers_of_another_function_are_not_taken_up(study, tmp_path):
    """Two functions of one name, and a search without a crossing, which ends at once."""
    for mu in (0.3, 0.4):
        where = tmp_path / "time_response"
        if mu == 0.4:
            with pytest.raises(bd.BdamperError, match="found results of different settings"):
                study.resonance_crossings(
                    (100.0, 200.0), [5], resume=where, friction=lambda omega, mu=mu: mu
                )
        else:
            study.resonance_crossings(
                (100.0, 200.0), [5], resume=where, friction=lambda omega, mu=mu: mu
            )


def test_nodal_diameters_without_data_over_speed_are_told():
    study = plain_study(
        turning_disk((0, 5, 10)), bd.Excitation("tip"), 5, harmonics=2, friction_coefficient=0.3
    )
    blade = study.model.bodies["blade"]
    bases = {
        d: replace(basis, speed=None if d == 10 else basis.speed)
        for d, basis in blade.bases.items()
    }
    study = study.replace(
        model=replace(
            study.model, bodies={**study.model.bodies, "blade": replace(blade, bases=bases)}
        )
    )
    told = "nodal diameters 10: modes of one rotor speed"
    assert told in study.resonance_crossings((100.0, 200.0), [5]).summary() and told in str(
        study.at_speed(400.0)
    )
    assert "neglected" not in str(study.replace(harmonics=1).at_speed(400.0))


def test_tables_are_asked_where_they_reach(study):
    with pytest.raises(
        bd.BdamperError, match=r"crosses mode 1 .* wider than 2864\.8 to 3819\.7 rpm"
    ):
        study.run_up(friction={300.0: 0.3, 400.0: 0.3})


LIMITS = (r"engine order 5 crosses mode 1 at 36\d\d.* rpm with free contacts and at 4\d\d\d.* rpm with stuck contacts; "
          "give a range wider than ")  # fmt: skip


def test_a_line_without_a_maximum_says_where_the_order_meets_the_mode(study):
    """The range ends before the highest point: the mode with stuck contacts lies above it."""
    found = study.resonance_crossings((400.0, 425.0), [5])
    assert found.values[0]["kind"] == "not found" and np.isnan(found.values[0]["amplitude"])
    assert re.fullmatch(LIMITS + "3819.7 to 4058.5 rpm", found.warnings[0])


@pytest.mark.slow
def test_a_resonance_above_the_stuck_one_is_found(study, found, monkeypatch):
    """Vibration may close contacts that are open at rest; here the first curve is made to end below the resonance."""
    first, followed = engine_order_line.interval, []
    monkeypatch.setattr(engine_order_line, "interval", lambda *args: (first(*args)[0], 425.0))
    follow = engine_order_line.follow_line
    monkeypatch.setattr(
        engine_order_line, "follow_line", lambda *args: followed.append(args[1]) or follow(*args)
    )
    wide = study.resonance_crossings(SPEEDS, [5])
    assert followed == [(400.0, 425.0), (400.0, 560.0)] and wide.values[0]["kind"] == "complete"
    assert wide.values[0]["amplitude"] == pytest.approx(found.values[1]["amplitude"], rel=1e-6)
    followed.clear()
    monkeypatch.setattr(SpeedFamily, "following", lambda self, omega, mode: 5 * 430.0)
    below = study.resonance_crossings(SPEEDS, [5])
    assert (
        followed == [(400.0, 425.0), (400.0, 430.0)] and below.values[0]["kind"] == "not found"
    ), "up to the next mode"


def test_a_wider_run_up_without_a_maximum_does_not_replace_one_with_a_maximum(study, monkeypatch):
    """A flank of the next mode may be higher than the peak."""
    at_end = SimpleNamespace(peak_at_end=True, peak=SimpleNamespace(frequency=1e3))
    runs = iter([("equations", at_end, "peak"), ("other equations", at_end, None)])
    monkeypatch.setattr(engine_order_line, "interval", lambda *_: (400.0, 425.0))
    monkeypatch.setattr(engine_order_line, "follow_line", lambda *_: next(runs))
    assert (
        follow_mode(SpeedFamily(study.problem, Conditions()), (400.0, 560.0), 1, CostMeter())[2]
        == "peak"
    )
    assert not [*runs], "both were followed"


@pytest.mark.parametrize("speed", [300.0, 500.0, 900.0])
def test_the_exact_search_reaches_beyond_the_line_but_not_the_next_mode(study, monkeypatch, speed):
    family, asked = SpeedFamily(study.problem, Conditions()), []
    monkeypatch.setattr(
        engine_order_line,
        "highest_peak",
        lambda problem, preload, band, mode: asked.append(band) or lost,
    )
    lost = replace(
        study.peak(5800.0), status="not found", reason="tried", y=np.array([0.0, 5.0 * speed])
    )
    exact_at_fixed_speed(family, (200.0, 1000.0), 1, lost, CostMeter())
    case = family.problem(speed).at(family.preload(speed))
    low, high = resonance_interval(case, 1)
    following = free_and_stuck(case, 2)[0][1]
    assert asked[0] == pytest.approx(
        (low, max(high, min(1.1 * 5.0 * speed / (2.0 * np.pi), following))), rel=1e-12
    )


def test_the_cost_of_an_exact_crossing_is_that_of_its_searches(study, monkeypatch):
    """Each search at a fixed speed is metered on its own."""
    family, searches = SpeedFamily(study.problem, Conditions()), []
    top = replace(study.peak(5800.0), y=np.array([0.0, 5.0 * 450.0]))
    search = engine_order_line.highest_peak

    def recorded(*args, **settings):
        searches.append(search(*args, **settings))
        return searches[-1]

    monkeypatch.setattr(engine_order_line, "highest_peak", recorded)
    meter = CostMeter()
    exact_at_fixed_speed(family, (400.0, 500.0), 1, top, meter)
    cost, evaluations = meter.read(), [peak.cost.evaluations for peak in searches]
    assert len(searches) > 1 and min(evaluations) > 0
    assert cost.evaluations == sum(evaluations)
    assert cost.iterations == sum(peak.cost.iterations for peak in searches)


@pytest.mark.parametrize(("resonances", "where"), [
    ((0.0, 0.0), "does not cross mode 1 at any speed; choose a different engine order or mode"),
    ((405.0, 420.0), "crosses mode 1 at 3867.5 rpm with free contacts and at 4010.7 rpm with stuck contacts; give a range "
                     "wider than 3819.7 to 4058.5 rpm, or check that excitation and response act on the mode"),
])  # fmt: skip
def test_a_line_without_a_maximum_is_told(study, resonances, where, monkeypatch):
    monkeypatch.setattr(SpeedFamily, "resonances", lambda *_: resonances)
    monkeypatch.setattr(crossings, "follow_mode", lambda *_: (None, None, None))
    found = study.resonance_crossings((400.0, 425.0), [5])
    assert (found.values[0]["kind"], *found.warnings) == (
        "not found",
        f"engine order 5 {where}",
    )
    monkeypatch.setattr(crossings, "follow_mode", lambda *_: None)
    found = study.resonance_crossings((400.0, 425.0), [5])
    assert (found.values[0]["kind"], *found.warnings) == (
        "none",
        f"engine order 5 {where}",
    )


@pytest.mark.parametrize(("speeds", "where"), [
    ((100.0, 200.0), "954.93 to 1909.9 rpm"), ((600.0, 700.0), "5729.6 to 6684.5 rpm"),
])  # fmt: skip
def test_no_crossing_in_the_range(study, speeds, where):
    found = study.resonance_crossings(speeds, [5])
    assert (
        found.values[0]["kind"] == "none" and np.isnan(found.values[0]["speed"]) and found.complete
    )
    assert re.fullmatch(LIMITS + where, found.warnings[0])
    with pytest.raises(bd.BdamperError, match="run-up: mode 1 has no maximum: " + LIMITS):
        study.run_up(speeds)


def test_a_range_whose_end_is_highest_is_named(study):
    end = r"rpm; No peak; highest point .*, at the (upper|lower) end of the curve: 4058.5 rpm, engine order 5"
    with pytest.raises(bd.BdamperError, match=end):
        study.run_up(np.array([400.0, 425.0]))


def test_edge_contact_at_a_crossing_is_noted(study, found, monkeypatch):
    """That of the static state at its speed, in the table and in the headline."""
    at = study.at_speed(found.values[1]["speed"])
    assert not at.static(at.preload).edges and found.warnings == ("", "", "")
    monkeypatch.setattr("bdamper.contact.preload_state.EDGE", 1.1)
    noted = study.resonance_crossings(SPEEDS, [5])
    words = f"edge contact, more blade modes may change it: {at.static(at.preload).edges}"
    assert (
        noted.values[0]["kind"] == "complete"
        and noted.warnings == (words,)
        and f"Note: {words}" in said(noted)
    )


@pytest.mark.slow
def test_where_interpolation_fails_the_peak_at_fixed_speed_is_found_exactly(
    study, found, monkeypatch
):
    """No value of the interpolated equations is shown, no derivative, and no run-up."""
    exact = engine_order_line.exact
    monkeypatch.setattr(engine_order_line, "exact", lambda *args: (exact(*args)[0], 0.1))
    value = study.resonance_crossings(SPEEDS, [5]).values[0]
    words = (
        "interpolation in speed leaves a residual of 0.1 times the excitation at the highest point"
    )
    assert (
        value["warning"]
        == f"{words}; the result is the peak at fixed speed, with its speed accurate to 0.3 %"
    )
    assert value["kind"] == "incomplete" and np.isnan(value["amplitude_by_mass"])
    assert (
        value["speed"]
        == value["fixed_speed"]
        == pytest.approx(found.values[1]["fixed_speed"], rel=3e-3)
    )
    assert value["amplitude"] == pytest.approx(found.values[1]["fixed_speed_amplitude"], rel=1e-3)
    assert value["preload"] == study.at_speed(value["speed"]).preload
    with pytest.raises(
        bd.BdamperError,
        match="speeds: expected a speed range in which the equations change smoothly",
    ):
        study.run_up(SPEEDS)

    searched = engine_order_line.highest_peak
    cut = lambda *args, **given: replace(
        searched(*args, **given), status="incomplete", reason="out of budget"
    )
    monkeypatch.setattr(engine_order_line, "highest_peak", cut)
    doubted = study.resonance_crossings(SPEEDS, [5]).values[0]
    assert "no peak found at fixed speed" in doubted["warning"] and np.isnan(doubted["amplitude"])

    def none_there(*_, **__):
        raise bd.BdamperError("no peak there")

    monkeypatch.setattr(engine_order_line, "highest_peak", none_there)
    value = study.resonance_crossings(SPEEDS, [5]).values[0]
    assert value["kind"] == "not found" and np.isnan(value["amplitude"])
    why = "no peak found at fixed speed, starting from the highest point on the line: not found: no peak there"
    assert value["warning"].startswith(f"{words}; {why}; engine order 5 crosses mode 1 at ")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (((500.0, 400.0), [5]), r"speeds: expected \(low, high\) in rad/s"),
        (
            ((0.0, 400.0), [5]),
            "speeds: expected a sequence of one or more finite numbers > 0 rad/s",
        ),
        (((400.0, 500.0), []), "engine_orders: give at least one"),
        (((400.0, 500.0), [0]), "engine_orders: expected a whole number >= 1"),
    ],
)
def test_questions_that_do_not_fit(study, asked, words):
    with pytest.raises(bd.SettingError, match=words):
        study.resonance_crossings(*asked)
    with pytest.raises(bd.SettingError, match="damper_mass_factor: expected"):
        study.resonance_crossings((400.0, 500.0), [5], damper_mass_factor=(0.0,))
