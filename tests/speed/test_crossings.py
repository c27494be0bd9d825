"""Crossings over rotor speed, the run-up along a line, and both against each other."""

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.peaks.newton import amplitude_at
from bdamper.problem.at_speed import Conditions
from bdamper.problem.variation import vary
from bdamper.speed.family import SpeedFamily
from bdamper.speed.line import exact, follow_line
from bdamper.util.cost import CostMeter
from tests.plain import plain_study
from tests.turning import turning_disk

SPEEDS = (400.0, 450.0, 500.0, 560.0)


@pytest.fixture(scope="module")
def study():
    return plain_study(turning_disk((0, 5)), bd.Excitation("tip", amplitude=20.0), 5, friction_coefficient=0.3)


@pytest.fixture(scope="module")
def found(study):
    return study.crossings(SPEEDS, [5], damper_mass=(0.999, 1.0, 1.001))


def test_an_order_that_the_model_has_no_modes_for_fails_alone(study, found):
    """The other crossings are there, and what the model neglects is told of them."""
    both = study.crossings(SPEEDS, [4, 5])
    assert both.kind[0].startswith("failed") and "nodal diameter" in both.kind[0] and not both.complete
    assert both.kind[1] == "complete" and both.amplitude[1] == found.amplitude[1] and both.notes == found.notes


def test_a_crossing_is_the_highest_point_of_the_line(study, found):
    """On the line, at the preload of its speed, and solutions on the line beside it are lower, as a maximum has them."""
    assert found.kind == ("complete",) * 3 and found.complete
    i = int(found.of(5, 1.0)[0])
    assert found.speed[i] == pytest.approx(2.0 * np.pi * found.frequency[i] / 5, rel=1e-12)
    assert found.preload[i] == pytest.approx(study.at_speed(float(found.speed[i])).preload, rel=1e-12)
    line = found.lines[i]
    assert len(line.speed) > 10 and line.engine_order == 5
    assert line.amplitude.max() <= (1.0 + 1e-8) * found.amplitude[i]  # points of the line leave a residual of up to 1e-7
    run = study.run_up((400.0, 560.0))
    assert run.peak_speed == pytest.approx(found.speed[i], rel=1e-7)
    assert run.peak_amplitude == pytest.approx(found.amplitude[i], rel=1e-9)
    family = SpeedFamily(study, Conditions())
    top = exact(family, follow_line(family, (400.0, 560.0), 1, CostMeter(0.0)))[0]
    lower = []
    for part in (-4e-4, -2e-4, 2e-4, 4e-4):
        speed = top.parameter * (1.0 + part)
        c = family.system(speed).correct_at(top.y[:-1], 5.0 * speed, top.scale, 1e-10, 30)
        assert c.status == 0
        lower.append(1.0 - amplitude_at(family.system(speed), c.y) / top.amplitude)
    assert min(lower) > 0.0
    assert lower[0] / lower[1] == pytest.approx(4.0, rel=0.1) and lower[3] / lower[2] == pytest.approx(4.0, rel=0.1)


def test_the_peak_at_fixed_speed_is_that_of_the_study_there(study, found):
    i = int(found.of(5, 1.0)[0])
    at = study.at_speed(float(found.fixed_speed[i]))
    peak = at.peak(at.preload)
    assert peak.amplitude == pytest.approx(found.fixed_speed_amplitude[i], rel=1e-6)
    assert 2.0 * np.pi * peak.frequency / 5 == pytest.approx(found.fixed_speed[i], rel=1e-6)
    assert 0.0 < found.amplitude[i] / found.fixed_speed_amplitude[i] - 1.0 < 1e-3


def test_derivatives_by_the_mass_are_those_of_crossings_at_other_masses(found):
    """Load and inertia together; the inertia alone changes a hundredth as much."""
    low, middle, high = range(3)
    amplitude = (found.amplitude[high] - found.amplitude[low]) / 0.002
    speed = (found.speed[high] - found.speed[low]) / 0.002
    assert found.amplitude_by_mass[middle] == pytest.approx(amplitude, rel=1e-4)
    assert found.speed_by_mass[middle] == pytest.approx(speed, rel=1e-4)


def test_run_up(study, found):
    run = study.run_up((420.0, 465.0))
    i = int(found.of(5, 1.0)[0])
    assert run.status == "complete" and not run.cut, str(run)
    assert run.fixed_speed == pytest.approx(found.fixed_speed[i], rel=1e-6)
    assert 0.0 < run.difference < 1e-3
    assert run.speed.min() == pytest.approx(420.0) and run.speed.max() == pytest.approx(465.0)
    assert run.interpolation < 1e-5
    assert "above the peak at fixed speed" in run.details()
    assert len(run.plot().lines) == 3


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "highest", "fixed"), [(1.0, (2.9284e-3, 487.80), (2.9262e-3, 487.49)),
                                                        (0.5, (1.5582e-3, 493.56), (1.5582e-3, 493.56))])  # fmt: skip
def test_where_faces_open_the_highest_point_is_the_end_of_a_plateau(mass, highest, fixed):
    """It meets the line at a higher speed than the highest peak at fixed speed does, under more load, and is higher."""
    shipped = bd.reference_model("bladed_disk", 9)
    study = bd.Study(shipped, bd.Excitation("tip", amplitude=20.0), 5, friction_coefficient=0.3, harmonics=1)
    found = study.crossings((400.0, 600.0), [5], damper_mass=(mass,))
    assert found.kind == ("complete",), str(found)
    assert (found.amplitude[0], found.speed[0]) == pytest.approx(highest, rel=1e-4)
    assert (found.fixed_speed_amplitude[0], found.fixed_speed[0]) == pytest.approx(fixed, rel=1e-4)


@pytest.mark.slow
def test_where_the_response_has_a_shoulder_both_are_named():
    """Three harmonics: no second maximum at fixed speed, and the highest point is 2.4 % above the peak."""
    shipped = bd.reference_model("bladed_disk", 9)
    study = bd.Study(shipped, bd.Excitation("tip", amplitude=20.0), 5, friction_coefficient=0.3)
    run = study.run_up(within=(400.0, 600.0))
    assert 0.02 < run.difference < 0.03, str(run)
    assert "peak at fixed speed" in study.crossings((400.0, 600.0), [5]).details()


def test_a_range_that_ends_on_a_plateau_is_told(study):
    run = study.run_up((420.0, 465.0))
    higher = replace(run, amplitude=np.append(run.amplitude, 1.01 * run.peak_amplitude))
    assert not run.cut and higher.cut and "higher still at an end of the range" in higher.details()
    alone = replace(run, fixed_speed=np.nan, fixed_speed_amplitude=np.nan)
    assert "no peak at fixed speed beside it" in alone.details()


def test_pictures_of_crossings(study, found):
    ax = found.plot()
    assert [text.get_text() for text in ax.texts] == ["EO 5"] and ax.get_ylabel() == "Resonance amplitude (mm)"
    with pytest.raises(bd.SettingError, match="quantity: expected crossings with a margin, found none"):
        found.plot(quantity="margin")
    campbell = study.campbell(SPEEDS, [5], modes=1, damped=found)
    labels = campbell.plot().get_legend_handles_labels()[1]
    assert labels[:2] == ["free, nodal diameter 5", "stuck"] and labels[-1].startswith("damped, ")
    assert campbell.plot_safe(500.0).get_title() == "4775 rpm"


@pytest.fixture(scope="module")
def line(study):
    """A family and its line, with residual modes, friction and excitation that change with speed."""
    turning = plain_study(
        turning_disk((0, 5), spin=True), study.excitation, 5, friction_coefficient=0.3, contact_stiffness="residual_modes"
    )
    conditions = Conditions(friction={300.0: 0.3, 600.0: 0.4}, excitation=lambda omega, order: 0.04 * omega)
    family = SpeedFamily(turning, conditions)
    return family, follow_line(family, (440.0, 500.0), 1, CostMeter(0.0))


def test_the_equations_along_the_line_are_those_of_each_speed(line):
    """The interpolation of NumPy gives the same residual, and its differences the derivative along the line."""
    equations, top = line[1].equations, line[1].top
    y = top.y * (1.0 + 1e-3 * np.random.default_rng(0).standard_normal(len(top.y)))
    y[-1] = 5.0 * 470.0
    r, J, by_line = equations.evaluate_at(y)
    there = equations.at(y[-1])
    np.testing.assert_allclose(r, there.residual(y), rtol=1e-9, atol=1e-12 * np.abs(r).max())
    np.testing.assert_allclose(J, there.evaluate_at(y)[1], rtol=1e-9, atol=1e-12 * np.abs(J).max())

    def difference(h, value):
        return (value(y[-1] + h) - value(y[-1] - h)) / (2.0 * h)

    def residual(omega):
        return equations.at(omega).residual(np.append(y[:-1], omega))

    def height(omega):
        return 0.5 * amplitude_at(equations.at(omega), np.append(y[:-1], omega)) ** 2

    errors = [float(np.abs(difference(h, residual) - by_line).max()) for h in (0.05, 0.15, 0.5)]
    assert min(errors) <= 1e-8 * np.abs(by_line).max(), errors
    assert not np.allclose(by_line, there.evaluate_at(y)[2], rtol=1e-2, atol=0.0), "speed changes more than frequency"
    gradient, square = equations.squared_gradient(y)
    assert square == pytest.approx(2.0 * height(y[-1]), rel=1e-12)
    assert gradient[-1] == pytest.approx(difference(0.5, height), rel=1e-6) and gradient[-1] != 0.0


def test_interpolated_equations_are_those_of_a_speed(line):
    """At a speed that is none of the points; what is left are kinks where the static state changes."""
    family, found = line
    top, error = exact(family, found)
    assert error < 1e-4 and top.residual < 1e-9
    assert top.amplitude == pytest.approx(found.top.amplitude, rel=1e-6)
    made, own = found.equations.at(found.top.y[-1]), family.system(top.parameter)
    np.testing.assert_allclose(made.arrays["stiffness"], own.arrays["stiffness"], rtol=1e-8)
    np.testing.assert_allclose(made.arrays["kn"], own.arrays["kn"], rtol=1e-5)


def test_the_top_is_stationary_with_the_rows_of_each_speed(line):
    equations, top = line[1].equations, line[1].top
    gradient, square = equations.squared_gradient(top.y)
    assert abs(gradient @ (top.tangent * top.scale)) / square <= 2e-8 * abs(top.curvature)


def test_unknowns_of_two_speeds_are_comparable(line):
    """Residual modes have any phase of their own: aligned they change as little as the speed does."""
    a, b = (line[0].problem(omega).bases[1].G for omega in (450.0, 452.0))
    assert np.linalg.norm(a - b) < 1e-2 * np.linalg.norm(a)


def test_corners_of_tables_over_speed_take_a_shorter_range(study):
    """Friction that rises from a speed near the crossing on: polynomials over the whole range are off there."""
    table = {300.0: 0.3, 435.0: 0.3, 600.0: 0.6}
    found = study.crossings((400.0, 500.0), [5], friction=table)
    with pytest.raises(bd.SettingError, match="speeds: expected a range in which the equations change smoothly"):
        study.run_up((400.0, 500.0), friction=table)
    beyond = study.run_up((436.5, 470.0), friction=table)
    assert found.kind == ("complete",), str(found)
    assert found.amplitude[0] == pytest.approx(beyond.peak_amplitude, rel=1e-6)


def test_coupled_friction(study):
    coupled = replace(study, friction_law="coupled", evaluation=bd.Sampled(64))
    found = coupled.crossings((400.0, 500.0), [5])
    assert found.kind == ("complete",), str(found)
    plain = study.crossings((400.0, 500.0), [5])
    assert found.amplitude[0] == pytest.approx(plain.amplitude[0], rel=0.2)


def test_executors_and_files_give_the_same_table(study, found, tmp_path):
    with ThreadPoolExecutor(2) as pool:
        other = study.crossings(SPEEDS, [5], damper_mass=(0.999, 1.0, 1.001), executor=pool, resume=tmp_path / "kept")
    np.testing.assert_allclose(other.amplitude, found.amplitude, rtol=1e-12)
    again = study.crossings(SPEEDS, [5], damper_mass=(0.999, 1.0, 1.001), resume=tmp_path / "kept")
    np.testing.assert_array_equal(again.amplitude, other.amplitude)
    again.save(tmp_path / "table.h5")
    assert str(bd.load(tmp_path / "table.h5")) == str(again)
    with pytest.raises(bd.BdamperError, match="found those of another one"):
        study.crossings((400.0, 500.0), [5], resume=tmp_path / "kept")


def test_answers_of_another_function_are_not_taken_up(study, tmp_path):
    """Two functions of one name, and a search without a crossing, which ends at once."""
    for mu in (0.3, 0.4):
        where = tmp_path / "kept"
        if mu == 0.4:
            with pytest.raises(bd.BdamperError, match="found those of another one"):
                study.crossings((100.0, 200.0), [5], resume=where, friction=lambda omega, mu=mu: mu)
        else:
            study.crossings((100.0, 200.0), [5], resume=where, friction=lambda omega, mu=mu: mu)


def test_nodal_diameters_without_data_over_speed_are_told():
    study = plain_study(turning_disk((0, 5, 10)), bd.Excitation("tip"), 5, harmonics=2, friction_coefficient=0.3)
    blade = study.model.bodies["blade"]
    bases = {d: replace(basis, speed=None if d == 10 else basis.speed) for d, basis in blade.bases.items()}
    study = study.with_(model=replace(study.model, bodies={**study.model.bodies, "blade": replace(blade, bases=bases)}))
    told = "nodal diameters 10: modes of one rotor speed"
    assert told in study.crossings((100.0, 200.0), [5]).details() and told in str(study.at_speed(400.0))
    assert "neglected" not in str(study.with_(harmonics=1).at_speed(400.0))


def test_tables_are_asked_where_they_reach(study):
    with pytest.raises(bd.BdamperError, match="expected a crossing of mode 1 with engine order 5 between 300 and 400"):
        study.run_up(friction={300.0: 0.3, 400.0: 0.3})


def test_a_line_without_a_maximum_is_told(study):
    """The range ends before the highest point."""
    found = study.crossings((400.0, 425.0), [5])
    assert found.kind == ("not found",) and not found.complete and not found.found.any()
    assert re.search("no maximum between .* rad/s: does the excitation move mode 1", found.warnings[0]), str(found)


def test_no_crossing_in_the_range(study):
    found = study.crossings((100.0, 200.0), [5])
    assert found.notes == ()
    assert found.kind == ("none",) and not found.found.any() and found.complete
    with pytest.raises(bd.BdamperError, match="expected a crossing of mode 1 with engine order 5 between 100 and 200"):
        study.run_up((100.0, 200.0))


def test_a_range_whose_end_is_highest_is_named(study):
    end = r"no maximum, the response is highest at the upper end, \S+ m at 425 rad/s; give a range that goes further there"
    with pytest.raises(bd.BdamperError, match=end):
        study.run_up(np.array([400.0, 425.0]))
    with pytest.raises(bd.BdamperError, match="between 100 and 200 rad/s, found none"):
        study.run_up(within=np.array([100.0, 200.0]))


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (((500.0, 400.0), [5]), r"speeds: expected \(low, high\) in rad/s"),
        (((0.0, 400.0), [5]), "speeds: expected a sequence of one or more finite numbers > 0 rad/s"),
        (((400.0, 500.0), []), "engine_orders: expected at least one"),
        (((400.0, 500.0), [0]), "engine_orders: expected a whole number >= 1"),
    ],
)
def test_questions_that_do_not_fit(study, asked, words):
    with pytest.raises(bd.SettingError, match=words):
        study.crossings(*asked)
    with pytest.raises(bd.SettingError, match="damper_mass: expected"):
        study.crossings((400.0, 500.0), [5], damper_mass=(0.0,))


def test_the_mass_factor_alone_scales_inertia(study):
    """At the same preload a heavier damper changes little; with its own load much more."""
    at = study.at_speed(470.0)
    same = vary(at, {"damper_mass_factor": 1.5}).peak(at.preload).amplitude
    own = vary(at, {"damper_mass": 1.5}).peak(1.5 * at.preload).amplitude
    peak = at.peak(at.preload)
    base = peak.amplitude
    found = at.peak_sensitivities(peak, ("preload", "damper_mass_factor", "damper_mass"))
    parts = at.preload * found["preload"].amplitude + found["damper_mass_factor"].amplitude
    assert found["damper_mass"].amplitude == pytest.approx(parts, rel=1e-5), "load and inertia together"
    assert abs(same / base - 1.0) < 0.05 < abs(own / base - 1.0)
