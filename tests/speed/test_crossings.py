"""Crossings over rotor speed, the run-up along a line, and both against each other."""

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.peaks.scan import Scan
from bdamper.problem.at_speed import Conditions
from bdamper.problem.variation import vary
from bdamper.speed import crossing
from bdamper.speed.crossing import Search
from bdamper.speed.family import SpeedFamily
from bdamper.speed.run_up import PARTS, TERMS, RunUpSystem
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


def test_the_peak_lies_on_the_line_at_the_preload_of_its_speed(study, found):
    assert found.kind == ("crossing",) * 3 and found.complete
    i = int(found.of(5, 1.0)[0])
    assert found.speed[i] == pytest.approx(2.0 * np.pi * found.frequency[i] / 5, rel=1e-9)
    at = study.at_speed(float(found.speed[i]))
    assert found.preload[i] == pytest.approx(at.preload, rel=1e-12)
    peak = at.peak(at.preload)
    assert peak.amplitude == pytest.approx(found.amplitude[i], rel=1e-8)
    assert peak.frequency == pytest.approx(found.frequency[i], rel=1e-8)
    line = found.lines[i]
    assert found.speed[i] in line.speed and len(line.speed) > 1 and line.engine_order == 5


def test_derivatives_by_the_mass_are_those_of_crossings_at_other_masses(found):
    """Load and inertia together; the inertia alone changes a hundredth as much."""
    low, middle, high = range(3)
    amplitude = (found.amplitude[high] - found.amplitude[low]) / 0.002
    speed = (found.speed[high] - found.speed[low]) / 0.002
    assert found.amplitude_by_mass[middle] == pytest.approx(amplitude, rel=1e-4)
    assert found.speed_by_mass[middle] == pytest.approx(speed, rel=1e-4)


def test_run_up_and_secant_agree(study, found):
    run = study.run_up((420.0, 465.0))
    i = int(found.of(5, 1.0)[0])
    assert run.status == "complete" and run.agrees, str(run)
    assert run.crossing_speed == pytest.approx(found.speed[i], rel=1e-9)
    assert run.peak_amplitude >= run.crossing_amplitude
    assert run.passed_speed == pytest.approx(run.crossing_speed, rel=1e-9)
    assert abs(run.difference) <= max(1e-3, found.excess[i])
    assert run.speed.min() == pytest.approx(420.0) and run.speed.max() == pytest.approx(465.0)
    assert run.interpolation < 1e-5, "both are solutions at their speeds"
    assert "agrees with the peak at fixed speed" in str(run)
    assert len(run.plot().lines) == 3


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "above"), [(1.0, 0.012), (0.5, 0.066)])
def test_where_faces_open_a_run_up_passes_a_second_maximum(mass, above):
    """It meets the line at a higher speed, under more load, and is higher than the crossing of the highest peak."""
    shipped = bd.reference_model("bladed_disk", 9)
    study = bd.Study(shipped, bd.Excitation("tip", amplitude=20.0), 5, friction_coefficient=0.3, harmonics=1)
    study = vary(study, {"damper_mass": mass})
    found = study.crossings((400.0, 600.0), [5])
    run = study.run_up(within=(400.0, 600.0))
    assert run.agrees and run.interpolation < 1e-5, str(run)
    assert run.difference == pytest.approx(above, abs=1e-3), "of another maximum"
    assert run.passed_speed > 1.005 * run.crossing_speed and "another maximum than that of the crossing" in str(run)
    assert not replace(run, passed_amplitude=run.crossing_amplitude).agrees
    assert f"another maximum of the response is higher on the line, {run.passed_amplitude:.6g} m" in found.warnings[0]


@pytest.mark.slow
def test_where_the_response_has_a_shoulder_the_estimate_is_that_of_the_curve():
    """Three harmonics: no second maximum at fixed speed, 2.4 % where a round peak would gain 0.6."""
    shipped = bd.reference_model("bladed_disk", 9)
    run = bd.Study(shipped, bd.Excitation("tip", amplitude=20.0), 5, friction_coefficient=0.3).run_up(within=(400.0, 600.0))
    assert run.passed_speed == pytest.approx(run.crossing_speed, rel=1e-9)
    assert run.agrees and 0.02 < run.difference < run.excess < 0.03, str(run)


def test_a_range_that_ends_on_a_plateau_is_told(study):
    run = study.run_up((420.0, 465.0))
    higher = replace(run, amplitude=np.append(run.amplitude, 1.01 * run.peak_amplitude))
    assert not run.cut and higher.cut and "higher still at an end of the range" in str(higher)
    assert not replace(run, excess=0.03, passed_amplitude=1.01 * run.peak_amplitude).agrees, "no run-up is lower"


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
    """Equations of the run-up, with residual modes, friction and excitation that change with speed, and a point near it."""
    turning = plain_study(
        turning_disk((0, 5), spin=True), study.excitation, 5, friction_coefficient=0.3, contact_stiffness="residual_modes"
    )
    conditions = Conditions(friction={300.0: 0.3, 600.0: 0.4}, excitation=lambda omega, order: 0.04 * omega)
    family = SpeedFamily(turning, conditions)
    peak, _ = Search(family, SPEEDS, 1, CostMeter(0.0)).run()
    u = peak.y[:-1] * (1.0 + 1e-3 * np.random.default_rng(0).standard_normal(len(peak.y) - 1))
    return RunUpSystem(family, (440.0, 500.0)), family, peak, u


@pytest.mark.parametrize("terms", [*((term,) for term in TERMS), TERMS], ids=lambda terms: "+".join(terms))
def test_derivative_by_speed_term_by_term(line, terms):
    """Against central differences of the residual in which the arrays of one term alone are those of another speed."""
    system, _, _, u = line
    omega, h = 470.0, 1e-2

    def residual(other):
        here, there = system.made_at(omega)[0], system.made_at(other)[0]
        arrays = {name: there.arrays[name] for name, term in PARTS.items() if term in terms}
        return here._with(**{**here.arrays, **arrays}).residual(np.append(u, 5 * omega))

    exact = system.speed_rate(u, omega, terms)
    steps = [(residual(omega + d) - residual(omega - d)) / (2.0 * d) for d in (h, 3.0 * h, 10.0 * h)]
    errors = [float(np.abs(step - exact).max()) for step in steps]
    assert np.abs(exact).max() > 0.0
    assert min(errors) <= 1e-8 * np.abs(exact).max(), errors


def test_interpolated_equations_are_those_of_a_speed(line):
    """At a speed that is none of the points; what is left are kinks where the static state changes."""
    system, family, peak, _ = line
    assert np.abs(system.residual(peak.y) * system.row_scale).max() < 1e-4
    made, own = system.made_at(peak.parameter)[0], family.system(peak.parameter)
    np.testing.assert_allclose(made.arrays["stiffness"], own.arrays["stiffness"], rtol=1e-8)
    np.testing.assert_allclose(made.arrays["kn"], own.arrays["kn"], rtol=1e-5)
    assert system.amplitude(peak.y) == pytest.approx(peak.amplitude, rel=1e-6)


def test_unknowns_of_two_speeds_are_comparable(line):
    """Residual modes have any phase of their own: aligned they change as little as the speed does."""
    _, family, _, _ = line
    a, b = (family.problem(omega).bases[1].G for omega in (450.0, 452.0))
    assert np.linalg.norm(a - b) < 1e-2 * np.linalg.norm(a)


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
    assert told in str(study.crossings((100.0, 200.0), [5])) and told in str(study.at_speed(400.0))
    assert "neglected" not in str(study.with_(harmonics=1).at_speed(400.0))


def test_tables_are_asked_where_they_reach(study):
    with pytest.raises(bd.BdamperError, match="expected a crossing of mode 1 with engine order 5 between 300 and 400"):
        study.run_up(friction={300.0: 0.3, 400.0: 0.3})


def test_a_mode_without_a_peak_is_told(study, monkeypatch):
    """Where an excitation hardly moves a mode, the response beside that of others has no maximum."""
    bare = Scan((), "complete", np.zeros((0, 1)))
    monkeypatch.setattr(crossing, "scan", lambda *a, **b: bare)
    found = study.crossings((400.0, 500.0), [5])
    assert found.kind == ("not found",) and not found.complete
    assert re.search("no maximum between .* Hz: does the excitation move mode 1", found.warnings[0]), str(found)


def test_no_crossing_in_the_range(study):
    found = study.crossings((100.0, 200.0), [5])
    assert found.notes == ()
    assert found.kind == ("none",) and not found.found.any() and found.complete
    with pytest.raises(bd.BdamperError, match="expected a crossing of mode 1 with engine order 5 between 100 and 200"):
        study.run_up((100.0, 200.0))


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


def test_a_derivative_by_parameters_of_coupled_friction_is_refused(study):
    coupled = replace(study, friction_law="coupled", evaluation=bd.Sampled(64)).at_speed(450.0)
    system = coupled.system(coupled.preload)
    with pytest.raises(bd.SettingError, match="derivative by parameters: expected separable friction"):
        system.contact_rate(np.zeros(system.n_unknowns), np.zeros((system.n_points, 3, 3)), {})


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
