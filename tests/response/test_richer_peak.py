"""Peaks of richer studies by Newton's method, against complete searches of these studies."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.accuracy import at_optimum
from bdamper.response import richer_peak
from bdamper.response.highest_peak import found_at, maxima, with_errors
from bdamper.response.optimum_checks import checks
from bdamper.response.peak_error import (
    HarmonicPeak,
    SourceError,
    amplitude_error,
    error_rows,
    error_text,
)
from bdamper.response.richer_peak import (
    NEARLY_HIGHEST,
    Reached,
    embed,
    richer_peaks,
    with_more_harmonics,
    with_motion_of_faces,
    with_soft_vectors,
)
from tests.each import each
from tests.util.test_disk import pressed

INTERVAL = (0.08, 0.4)


def separating(unit=1.0):
    """Two masses, the light one between a friction contact that opens and the preload."""
    contact = bd.Contact((1, 0), normal=1, kt=1.0, kn=1.0, mu=0.5)
    return bd.lumped(
        [1.0, 0.1],
        [0.02, 0.02],
        [1.0, 0.1],
        contacts=[contact],
        forces={0: 0.1 * unit},
        load_per_preload={1: 1.0},
        harmonics=3,
    )


def blade():
    return bd.Study(
        bd.reference_model("turbine_blade"),
        bd.Excitation("tip", direction="tangential", amplitude=1.0),
        engine_order=5,
        friction_coefficient=0.3,
    )


@pytest.fixture(scope="module")
def blade_peak():
    study = blade()
    return study.problem, study.peak(104.0, (620.0, 700.0))


@each("preload", [pytest.param(p, id=f"{p} N") for p in (0.1, 0.2, 0.4, 0.8)])
def compare_with_complete_search(preload):
    """Compare the change of a peak by two more harmonics with a search that starts elsewhere."""
    problem = separating().problem
    richer = with_more_harmonics(problem)
    assert richer.harmonic_numbers == (1, 2, 3, 4, 5)
    own = found_at(problem, preload, INTERVAL)
    peaks = maxima(problem.system(preload), own.curve, NEARLY_HIGHEST)
    found = richer_peaks(problem, richer, preload, peaks)
    true = found_at(richer, preload, INTERVAL)
    change = true.amplitude / own.amplitude - 1.0
    assert abs(change) > 0.005
    assert found.change.amplitude == pytest.approx(change, abs=1e-6)
    assert found.change.uncertainty == 0.0
    assert found.peaks[0].frequency == pytest.approx(true.top.peak.frequency, rel=1e-6)


@pytest.mark.slow
def test_more_harmonics_change_the_peak_as_in_a_complete_search():
    """Changes of 1 to 15 %; the search starts at the ends of the interval, not at the peak."""
    compare_with_complete_search()


@pytest.mark.slow
def test_change_does_not_depend_on_the_unit_of_force():
    """All forces times 1,000: the law is homogeneous, so the motion is 1,000 times larger."""
    changes = []
    for unit in (1.0, 1000.0):
        problem = separating(unit).problem
        peak = found_at(problem, 0.2 * unit, INTERVAL).top.peak
        richer = with_more_harmonics(problem)
        changes.append(richer_peaks(problem, richer, 0.2 * unit, [peak]).change.amplitude)
    assert abs(changes[0]) > 0.1
    assert changes[1] == pytest.approx(changes[0], rel=1e-6)


def test_constant_normal_load_gets_odd_harmonics():
    jenkins = bd.lumped(
        1.0, 0.05, 1.0, contacts=[bd.Contact(0, kt=20.0, mu=1.0, preload=0.6)], forces={0: 1.0}
    )
    odd = jenkins.problem.replace(harmonics=(1, 3), variable_normal_load=False, separation=False)
    assert with_more_harmonics(odd).harmonic_numbers == (1, 3, 5)


@pytest.mark.slow
def test_lower_maximum_that_becomes_the_highest_counts(monkeypatch):
    problem = separating().problem
    peak = found_at(problem, 0.4, INTERVAL).top.peak
    lower = replace(peak, amplitude=0.8 * peak.amplitude)

    def higher(problem, richer, preload, start, *attempts):
        factor = 1.01 if start is peak else 1.3
        top = replace(start, amplitude=factor * start.amplitude)
        return Reached(top, top.amplitude, top.frequency, 0.0)

    monkeypatch.setattr(richer_peak, "reach", higher)
    found = richer_peaks(problem, problem, 0.4, [peak, lower])
    assert found.change.amplitude == pytest.approx(1.3 * 0.8 - 1.0)
    assert [top.amplitude / peak.amplitude for top in found.peaks] == pytest.approx([1.04, 1.01])


@pytest.mark.slow
def test_points_without_convergence_are_read_near_the_solution_only(monkeypatch):
    problem = separating().problem
    peak = found_at(problem, 0.4, INTERVAL).top.peak
    residuals = iter((0.2, 0.6))

    def stalls(*args):
        residual = next(residuals)
        read = residual < richer_peak.READ
        amplitude = 1.1 * peak.amplitude if read else np.nan
        return Reached(None, amplitude, peak.frequency, residual)

    monkeypatch.setattr(richer_peak, "reach", stalls)
    read = richer_peaks(problem, problem, 0.4, [peak])
    assert read.change.amplitude == pytest.approx(0.1) and not read.peaks
    assert read.change.uncertainty == pytest.approx(0.02)
    assert "stalls at 20 % of the excitation" in read.change.how
    unknown = richer_peaks(problem, problem, 0.4, [peak])
    assert not unknown.change.known and unknown.change.size == np.inf


@pytest.mark.slow
def test_a_start_far_from_any_peak_has_no_answer():
    problem = separating().problem
    peak = found_at(problem, 0.4, INTERVAL).top.peak
    far = replace(peak, y=np.append(50.0 * peak.y[:-1], 0.02 * peak.y[-1]))
    assert not richer_peaks(problem, with_more_harmonics(problem), 0.4, [far]).change.known


@pytest.mark.slow
def test_faces_keep_their_motion_in_a_study_with_all_vectors(blade_peak):
    """With a vector for each resolved force the least squares are exact: the elements need the motion
    x + (D' - D) F of each point."""
    problem, peak = blade_peak
    rich = replace(problem.contact.residual.options, n_vectors="all")
    richer = problem.replace(contact_stiffness=rich)
    start = with_motion_of_faces(problem, richer, 104.0, peak.y)
    motion, force, _ = problem.system(104.0).contact(peak.y[:-1])
    added = richer.contact.residual.flexibility - problem.contact.residual.flexibility
    wanted = motion + added[:, :, None] * force
    reached, _, _ = richer.system(104.0).contact(start[:-1])
    scale = np.abs(wanted[:, :, 1:]).max()
    assert np.abs(reached - wanted)[:, :, 1:].max() < 0.05 * scale
    # the same residual modes need no other coordinates
    same = with_motion_of_faces(problem, problem, 104.0, peak.y)
    np.testing.assert_allclose(same, peak.y, atol=1e-9 * np.abs(peak.y[:-1]).max())


@pytest.mark.slow
def test_start_with_the_motion_of_the_faces_is_nearer_than_coordinates_by_name(blade_peak):
    problem, peak = blade_peak
    richer = with_soft_vectors(problem)
    system = richer.system(104.0)
    by_name = system.error(embed(problem, richer, 104.0, peak.y))
    by_motion = system.error(with_motion_of_faces(problem, richer, 104.0, peak.y))
    assert by_motion < 0.2 * by_name


def test_soft_vectors_are_added_to_residual_modes_alone():
    assert with_soft_vectors(separating().problem) is None
    problem = blade().problem
    assert with_soft_vectors(problem).stiffness_method.n_soft == 6
    all_vectors = replace(problem.contact.residual.options, n_vectors="all")
    assert with_soft_vectors(problem.replace(contact_stiffness=all_vectors)) is None


# ---- errors that results carry ----


@pytest.fixture(scope="module")
def pair():
    """A curve with errors, and one without."""
    study = separating()
    ask = {"frequency": INTERVAL, "check": False, "progress": False}
    return [study.optimal_curve((0.1, 0.8), 4, errors=errors, **ask) for errors in (True, False)]


@pytest.mark.slow
def test_an_optimal_curve_carries_the_error_of_each_amplitude(pair):
    with_errors, without = pair
    np.testing.assert_array_equal(with_errors.amplitude, without.amplitude)
    assert without.harmonic_change is None and np.isnan(without.error).all()
    assert with_errors.vector_change is None  # lumped masses have no residual modes
    row = int(np.abs(with_errors.preload - 0.2).argmin())
    richer = separating().replace(harmonics=5).peak(0.2, INTERVAL, errors=False)
    change = richer.amplitude / with_errors.amplitude[row] - 1.0
    assert with_errors.harmonic_change[row] == pytest.approx(change, abs=1e-6)
    assert with_errors.error[row] == pytest.approx(abs(change), abs=1e-6)
    assert "error about" in str(with_errors) and "error about" not in str(without)
    # the evaluations of both curves show the price
    assert with_errors.cost.evaluations <= 1.2 * without.cost.evaluations


@pytest.mark.slow
def test_errors_are_stored_with_a_curve_and_a_peak(pair, tmp_path):
    with_errors, _ = pair
    with_errors.save(tmp_path / "curve.h5")
    loaded = bd.load(tmp_path / "curve.h5")
    np.testing.assert_array_equal(loaded.harmonic_change, with_errors.harmonic_change)
    peak = separating().peak(0.2, INTERVAL)
    peak.save(tmp_path / "peak.h5")
    stored = bd.load(tmp_path / "peak.h5")
    assert stored.errors == peak.errors and stored.harmonic_peaks == peak.harmonic_peaks
    assert stored.error == pytest.approx(0.152, abs=5e-4)


@pytest.mark.slow
def test_a_large_change_is_followed_by_further_harmonics():
    """15 % with five harmonics, as much with seven: the change is below 2 %, and the search ends."""
    peak = separating().peak(0.2, INTERVAL)
    assert [step.harmonics for step in peak.harmonic_peaks] == [5, 7]
    for step in peak.harmonic_peaks:
        true = separating().replace(harmonics=step.harmonics).peak(0.2, INTERVAL, errors=False)
        assert step.amplitude == pytest.approx(true.amplitude, rel=1e-6)


@pytest.mark.slow
def test_rows_of_a_sweep_carry_their_errors():
    study = separating()
    peak = study.peak(0.2, INTERVAL)
    found = bd.sweep(study, {"damping_factor": [1.0]}, bd.PeakTask(0.2, INTERVAL))
    # a single peak takes further steps, which change it less than the first one
    assert found.array("harmonic_change")[0] == pytest.approx(peak.errors[0].amplitude, abs=1e-3)
    assert found.array("error")[0] == pytest.approx(peak.error, abs=1e-3)
    left_out = bd.sweep(study, {"damping_factor": [1.0]}, bd.PeakTask(0.2, INTERVAL, errors=False))
    assert "error" not in left_out.columns()


@pytest.mark.slow
def test_one_harmonic_is_amber_and_never_white():
    study = separating().replace(harmonics=1)
    for errors in (True, False):
        curve = study.optimal_curve(
            (0.2, 0.4), 2, frequency=INTERVAL, check=False, errors=errors, progress=False
        )
        by_name = {check.name: check.colour for check in checks(curve)}
        assert by_name["More harmonics"] == "amber"


def test_unknown_errors_are_named():
    known = SourceError("harmonics", 0.11, 0.001, 0.0, "5 harmonics")
    small = SourceError("residual modes", -0.01, 0.0, 0.0, "6 more residual modes")
    unknown = SourceError("residual modes", np.nan, np.nan, np.inf, "no peak")
    assert error_text([known, small]) == "error about 12 %, compared with two more harmonics"
    assert error_text([known, unknown]) == (
        "error about 11 %, compared with two more harmonics, error from residual modes unknown"
    )
    assert np.isnan(amplitude_error([known, unknown])) and np.isnan(amplitude_error([]))
    assert amplitude_error([known, small]) == pytest.approx(0.12)
    rows = error_rows([known, unknown], 528e-6)
    assert rows[0][:2] == ("Harmonics", "+11 %") and rows[0].remark == "586 µm with 5 harmonics"
    assert rows[1][:2] == ("Residual modes", "unknown")


@pytest.mark.slow
def test_changes_by_harmonics_and_residual_modes_add_up_to_the_change_by_both():
    """Against a complete search with both; residual modes beside three harmonics alone give -2.0 %."""
    problem, interval = blade().problem, (620.0, 720.0)
    own = with_errors(problem, found_at(problem, 200.0, interval)).top.peak
    both = found_at(with_soft_vectors(with_more_harmonics(problem)), 200.0, interval)
    true = both.amplitude / own.amplitude - 1.0
    by_harmonics, by_vectors = own.errors
    assert by_harmonics.amplitude + by_vectors.amplitude == pytest.approx(true, abs=1e-3)
    assert own.error == abs(by_harmonics.amplitude) + abs(by_vectors.amplitude)
    assert by_vectors.against == "5 harmonics and 6 more residual modes"
    alone = richer_peaks(problem, with_soft_vectors(problem), 200.0, [own]).change.amplitude
    assert abs(by_vectors.amplitude - alone) > 0.01
    _, row = error_rows(own.errors, own.amplitude)
    assert row.remark.startswith("with 5 harmonics and 6 more residual modes")


def changes_by_harmonics(peaks):
    """Return the relative change from the first peak for each number of harmonics above its own."""
    own, *others = peaks
    return {peak.harmonics: peak.amplitude / own.amplitude - 1.0 for peak in others}


@pytest.mark.slow
@each("model,points,preload,interval", [
    ("turbine_blade", None, 104.0, (620.0, 700.0)),
    ("turbine_blade", None, 200.0, (620.0, 720.0)),
    ("bladed_disk", 9, 100.4, (260.0, 370.0)),
])  # fmt: skip
def test_one_change_for_one_question(model, points, preload, interval):
    """Errors of a peak, error estimates and convergence compare the same two studies."""
    tip = bd.Excitation("tip", direction="tangential")
    loaded = bd.reference_model(model, points)
    study = bd.Study(loaded, tip, engine_order=5, friction_coefficient=0.3)
    peak = with_errors(study.problem, found_at(study.problem, preload, interval)).top.peak
    own = HarmonicPeak(3, peak.amplitude, peak.frequency)
    of_peak = changes_by_harmonics((own, *peak.harmonic_peaks))
    estimated = study.estimate_errors(peak, sources=["harmonics"])
    of_estimate = changes_by_harmonics(estimated.harmonic_peaks)
    convergence = study.harmonic_convergence(peak, harmonics=(5, 7), progress=False)
    of_convergence = changes_by_harmonics(convergence.peaks)
    assert set(of_estimate) == set(of_convergence) == {5, 7} and 5 in of_peak
    for harmonics in of_convergence:
        assert of_estimate[harmonics] == pytest.approx(of_convergence[harmonics], abs=1e-3)
    for harmonics in set(of_peak) & set(of_convergence):
        assert of_peak[harmonics] == pytest.approx(of_convergence[harmonics], abs=1e-3)


def test_the_check_of_an_optimal_curve_has_the_change_of_its_points():
    """Lumped masses have no other modes in time integration: both compare three with five harmonics."""
    study = separating()
    curve = study.optimal_curve((0.1, 0.8), 4, frequency=INTERVAL, check=False, progress=False)
    optimum = curve.peak_at(curve.optimum.preload)
    change = changes_by_harmonics(at_optimum(study.problem, curve).peaks)[5]
    assert change > 0.05
    assert amplitude_error(optimum.errors) == pytest.approx(change, abs=1e-3)
    peak = study.peak(curve.optimum.preload, INTERVAL, progress=False)
    assert peak.harmonic_peaks[0].amplitude / peak.amplitude - 1.0 == pytest.approx(
        change, abs=1e-3
    )


def test_an_estimate_and_a_peak_state_the_same_error_of_harmonics():
    """Three harmonics change this peak by more than five, so that the error is not that of the last step."""
    study = pressed()
    peak = study.peak(2.0, (0.1, 0.3))
    [estimate] = study.estimate_errors(peak, sources=["harmonics"]).sources
    searched = [
        study.replace(harmonics=n).peak(2.0, (0.1, 0.3), errors=False).amplitude for n in (3, 5)
    ]
    changes = np.array(searched) / peak.amplitude - 1.0
    assert abs(changes[0]) > abs(changes[1]) > 0.0
    assert estimate.amplitude == pytest.approx(changes[0], rel=1e-6)
    assert peak.errors[0].amplitude == pytest.approx(changes[0], rel=1e-6)
