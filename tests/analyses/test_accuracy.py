"""Error estimates by source, ladders of settings: against solutions of richer studies, and each other."""

from dataclasses import fields as dataclass_fields
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import error_estimates as richer_module
from bdamper.analyses.accuracy import make_ladders, varied
from bdamper.analyses.error_estimates import SOURCES, richer_study
from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.harmonic_balance.settings import Settings
from bdamper.model.contact_points import unite_contact_points
from bdamper.response.peak_error import HarmonicPeak, SourceError
from bdamper.response.richer_peak import missing_harmonics, with_stand_ins
from bdamper.response.verification import SETTING_OF, ErrorEstimates
from bdamper.util.errors import SettingError
from tests import accuracy_cases, models
from tests.analyses.test_mode import oscillator
from tests.plain import plain_study
from tests.printed import said
from tests.util.test_disk import BAND, pressed


@pytest.fixture(scope="module")
def study():
    return plain_study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, harmonics=2)


@pytest.fixture(scope="module")
def place():
    """Preload and interval of a peak with slip and separation."""
    return 5000.0, (320.0, 365.0)


@pytest.fixture(scope="module")
def peak(study, place):
    return study.peak(*place)


@pytest.mark.slow
def test_all_sources_of_a_peak(study, place, peak):
    errors = study.estimate_errors(peak)
    told_of = [source for source in SOURCES if source != "contact_forces"]  # exact already
    assert [s.source for s in errors.sources] == told_of
    assert peak.shares[1] + peak.shares[2] > 0.0  # there is something to estimate
    assert not errors.unknown, str(errors)
    coarser = "extrapolated from 6 and 9 contact points on a face"
    assert errors["contact points"].against == coarser
    assert errors.cost.evaluations > 100
    assert errors.total >= max(s.size for s in errors.sources if s.known)
    text = errors.summary()
    told = [
        line.split(maxsplit=2)[2] for line in text.splitlines() if line.startswith("  sources ")
    ]
    assert [line.split(":")[0] for line in told] == told_of
    assert "not estimated" not in errors.line and "\n" not in errors.line
    with pytest.raises(SettingError, match=r"source: expected one of .* found 'friction'"):
        errors["friction"]


@pytest.mark.slow
def test_an_optimal_curve_without_errors_names_the_estimate():
    model = bd.reference_model("turbine_blade", 9)
    study = bd.Study(model, bd.Excitation("tip"), 5, friction_coefficient=0.3, harmonics=1)
    curve = study.optimal_curve((90.0, 120.0), 2, check=False, errors=False)
    assert f"study.estimate_errors(study.peak({curve.recommended_preload:.3g}))" in said(curve)


@pytest.mark.slow
def test_a_model_that_has_no_more_modes_gives_no_number(study, place, peak):
    """Fewer modes say nothing; the contact points have an estimate by a coarser set."""
    rich = richer_study(study.problem, "modes")[0]
    for source in ("modes", "contact points"):
        with pytest.raises(bd.BdamperError, match=f"the model has no more {source}"):
            richer_study(rich, source)
    assert richer_study(rich.replace(damper_modes=2), "modes") is not None
    own = study._with_problem(rich)
    errors = own.estimate_errors(own.peak(*place), sources=["modes", "contact points"])
    assert errors.unknown == ("modes",) and errors["contact points"].known


@pytest.mark.slow
def test_coarser_set_bounds_the_change_by_finer_points(place):
    """The finer points are those of the model from which the examined model was united."""
    fine = plain_study(bd.reference_model("bladed_disk", 24), bd.Excitation("tip"), 5)
    study = plain_study(unite_contact_points(fine.model, 12), bd.Excitation("tip"), 5)
    peak = study.peak(*place)
    estimated = study.estimate_errors(peak, sources=["contact points"])["contact points"]
    true = fine.peak(*place)
    amplitude = true.amplitude / peak.amplitude - 1.0
    frequency = true.frequency / peak.frequency - 1.0
    assert abs(amplitude) > 1e-5
    assert 1.0 < estimated.amplitude / amplitude < 8.0
    assert 1.0 < estimated.frequency / frequency < 8.0


@pytest.mark.slow
def test_two_rows_are_not_compared_with_three(study):
    """Of nine points six are the fewest with three rows along t1; a single row has no coarser set."""
    assert richer_module._fewer_points(study.problem) == 6
    row = study._with_problem(study.problem.replace(model=unite_contact_points(study.model, 3)))
    assert richer_module._fewer_points(row.problem) is None


def test_first_line_names_large_sources_with_their_settings():
    small = SourceError("harmonics", 0.099, 0.0, 0.0, "")
    large = SourceError("modes", -0.27, 0.007, 0.0, "")
    larger = SourceError("residual flexibility", 0.01, 0.3, 0.0, "")
    in_time = SourceError("time", 0.15, 0.0, 0.0, "")
    vague = SourceError("contact points", 0.5, 0.0, 0.6, "")
    estimates = ErrorEstimates(2.0, 300.0, 1e-3, (small, large, larger, in_time, vague))
    first = " ".join(str(estimates).split("\n\n")[0].split())
    named = "residual flexibility 30 % (contact_stiffness=), modes 27 % (blade_modes=), time 15 %:"
    assert first.startswith(f"Estimated error 82 %, {named}")
    assert "Estimated error 9.9 %: peak" in str(ErrorEstimates(2.0, 300.0, 1e-3, (small,)))
    settings = {field.name for field in dataclass_fields(Settings)}
    assert set(SETTING_OF.values()) <= settings and set(SETTING_OF) == set(SOURCES)


def harmonic_estimates(*amplitudes, sources=()):
    peaks = tuple(HarmonicPeak(3 + 2 * i, a, 300.0) for i, a in enumerate(amplitudes))
    return ErrorEstimates(2.0, 300.0, amplitudes[0], sources, peaks)


def test_peaks_that_do_not_approach_each_other_are_not_decided():
    known = SourceError("harmonics", 0.1, 0.0, 0.0, "")
    undecided = harmonic_estimates(614e-6, 637e-6, 673e-6, sources=(known,))
    assert undecided.undecided
    text = str(undecided)
    assert text.startswith("Not decided by harmonic balance; time integration is needed")
    assert "5 harmonics  637 µm" in text and "Remedy: study.time_response(peak)" in text
    missing = harmonic_estimates(692e-6, np.nan, sources=(known,))
    assert missing.undecided and "5 harmonics  no peak" in str(missing)
    in_time = SourceError("time", 0.15, 0.0, 0.0, "time integration, 707 µm")
    assert "Remedy" not in str(harmonic_estimates(692e-6, np.nan, sources=(known, in_time)))
    for decided in (harmonic_estimates(614e-6, 637e-6, 640e-6), harmonic_estimates(1.0, 1.01)):
        assert not decided.undecided and "cannot determine" not in str(decided)
    assert not ErrorEstimates(1.0, 1.0, 1.0, (known,)).undecided


@pytest.mark.slow
def test_harmonics_between_are_computed_after_a_large_change(study, place):
    one = study.replace(harmonics=1, friction_coefficient=0.4)
    peak = one.peak(1000.0, place[1])
    errors = one.estimate_errors(peak, sources=["harmonics"])
    assert [item.harmonics for item in errors.harmonic_peaks] == [1, 3, 5]
    for item in errors.harmonic_peaks:
        true = one.replace(harmonics=item.harmonics).peak(1000.0, place[1])
        assert item.amplitude == pytest.approx(true.amplitude, rel=1e-5)


def test_more_harmonics_without_a_peak_are_not_decided(study, peak, monkeypatch):
    nothing = richer_module.Solution(richer_module.Change(how="no complete response curve"))
    monkeypatch.setattr(richer_module, "solve_other", lambda *args, **options: nothing)
    errors = study.estimate_errors(peak, sources=["harmonics"])
    assert errors.unknown == ("harmonics",) and errors.undecided


@pytest.mark.slow
def test_time_is_the_farther_end_of_the_range_of_time_integration():
    study = pressed()
    peak = study.peak(2.0, BAND)
    errors = study.estimate_errors(peak, sources=["time"])
    response = study.time_response(peak)
    ends = np.array([response.lowest, response.highest]) / peak.amplitude - 1.0
    assert response.ok
    assert errors["time"].amplitude == pytest.approx(ends[np.abs(ends).argmax()], rel=1e-9)
    assert errors.cost.time_integration > 0.0
    assert "Not covered" in str(study.estimate_errors(peak)) and "Not covered" not in str(errors)


@pytest.mark.slow
@pytest.mark.parametrize("source", ["harmonics", "contact points", "modes", "contact_forces"])
def test_estimate_is_the_change_to_the_richer_study(study, place, source):
    changes = {
        "contact points": {"contact_points": 6},
        "contact_forces": {"contact_forces": bd.AFT(64)},
    }.get(source, {})
    own = study.replace(**changes)
    curve = own.frequency_response(*place)
    estimated = own.estimate_errors(curve, sources=[source])[source]
    true = own._with_problem(richer_study(own.problem, source)[0]).peak(*place)
    error = np.array(
        [true.amplitude / curve.peak.amplitude - 1.0, true.frequency / curve.peak.frequency - 1.0]
    )
    assert np.abs(error).max() > 1e-6
    size = max(abs(estimated.amplitude), abs(estimated.frequency))
    assert 0.5 < size / np.abs(error).max() < 2.0, (estimated, error)


@pytest.mark.slow
def test_a_large_change_by_harmonics_is_that_of_a_complete_search(study, place):
    """It falls by 13 %, which Newton's method from the peak finds as well."""
    own = study.replace(harmonics=1, friction_coefficient=0.4)
    peak = own.peak(1000.0, place[1])
    estimated = own.estimate_errors(peak, sources=["harmonics"])["harmonics"]
    assert "Newton's method" in estimated.against
    true = own.replace(harmonics=5).peak(1000.0, place[1])
    assert estimated.amplitude == pytest.approx(true.amplitude / peak.amplitude - 1.0, rel=1e-5)
    assert abs(estimated.amplitude) > 0.05


def test_one_line_says_what_is_known():
    modes, harmonics = (
        SourceError("modes", 0.004, 0.001, 0.0, ""),
        SourceError("harmonics", -0.011, 0.0, 0.001, ""),
    )
    unknown, vague = (
        SourceError("contact points", np.nan, np.nan, np.inf, "why"),
        SourceError("solver", 0.02, 0.0, 0.02, ""),
    )
    assert (
        ErrorEstimates(1.0, 1.0, 1.0, (modes, harmonics)).line
        == "estimated error 1.5 % (harmonics 1.1, modes 0.4)"
    )
    errors = ErrorEstimates(1.0, 1.0, 1.0, (modes, unknown, vague))
    assert errors.line == "estimated error 0.4 % (modes 0.4), not estimated: contact points, solver"
    assert not vague.known and errors.total == 0.004 and "solver: not estimated" in errors.summary()
    assert ErrorEstimates(1.0, 1.0, 1.0, (unknown,)).line == "error not estimated"


def test_top_at_an_end_of_the_interval_is_estimated_at_its_frequency(study, place):
    curve = study.frequency_response(place[0], (350.0, 354.5))  # the response still rises
    estimated = study.estimate_errors(curve, sources=["harmonics"])["harmonics"]
    true = (
        study._with_problem(richer_study(study.problem, "harmonics")[0])
        .frequency_response(place[0], (350.0, 354.5))
        .peak
    )
    assert estimated.frequency == 0.0 and "amplitude recomputed at the end" in estimated.against
    assert estimated.amplitude == pytest.approx(
        true.amplitude / curve.peak.amplitude - 1.0, rel=1e-5
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", [1023, *(pytest.param(n, marks=pytest.mark.slow) for n in (1047, 1070)), 1253]
)
def test_resonance_that_comes_into_the_interval_is_found(number):
    """More modes or points bring another resonance in, or leave a top that is no maximum."""
    compared = accuracy_cases.compare(number)
    assert 0.9 < compared.effectivity < 1.1, compared
    assert np.abs(compared.true).max() > 0.05


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", [*(pytest.param(n, marks=pytest.mark.slow) for n in (61, 173)), 29, 69]
)
def test_resonance_that_leaves_the_interval_is_followed(number):
    """With more points the response is highest at an end."""
    compared = accuracy_cases.compare(number)
    assert compared.text.endswith("computed by a complete response curve, outside the interval")
    assert 0.9 < compared.effectivity < 1.1, compared
    assert compared.estimated == pytest.approx(compared.true, rel=0.01)


@pytest.mark.slow
def test_a_resonance_far_beyond_the_interval_is_not_known():
    compared = accuracy_cases.compare(2071)
    assert np.isnan(compared.estimated).all() and compared.text.endswith(
        "between 556.495 and 1090.11 Hz: the response is highest at an end of the interval"
    )


def test_what_is_refused(study, place, peak):
    with pytest.raises(SettingError, match="sources"):
        study.estimate_errors(peak, sources=["friction"])
    with pytest.raises(SettingError, match="harmonics"):
        study.replace(harmonics=3).estimate_errors(peak)
    with pytest.raises(SettingError, match="converged"):
        study.estimate_errors(replace(peak, status="lost"))
    for wrong in ({"vary": "bearing"}, {"vary": {"model": [1]}}, {"vary": {"harmonics": []}}, {"quantity": "temperature"},
                  {"tolerance": 2.0}):  # fmt: skip
        with pytest.raises(SettingError):
            bd.accuracy_cost(study, *place, **wrong)


def test_stand_ins_leave_present_modes_alone(study):
    assert missing_harmonics(study.problem, 3) == []
    assert missing_harmonics(study.problem, 15) == []
    model = models.wedge_model(0, n_blades=24, engine_order=2, harmonics=3)
    small = plain_study(model, bd.Excitation("tip"), 2, harmonics=2)
    assert missing_harmonics(small.problem, 5) == [4, 5]
    wide = with_stand_ins(small.problem, 5)
    assert wide.harmonic_numbers == (1, 2, 3, 4, 5)
    for l in range(1, 4):
        np.testing.assert_array_equal(wide.bases[l].G, small.problem.coupling.basis(l).G)
    for l in (4, 5):
        np.testing.assert_array_equal(wide.bases[l].omega2, small.problem.bases[1].omega2)


# ---- ladders ----


@pytest.fixture(scope="module")
def result(study, place):
    vary = {"harmonics": [1, 2, 3, 4], "contact_points": [6, 9]}
    return bd.accuracy_cost(study, *place, vary=vary, tolerance=0.06, sources=())


@pytest.mark.slow
def test_errors_are_those_of_the_curves(study, place, result):
    top = study.replace(harmonics=4).frequency_response(*place).peak
    assert (result.richest.values, result.richest.part, result.richest.difference) == (
        ("4", "9"),
        "most detailed",
        0.0,
    )
    assert result.richest.amplitude == pytest.approx(top.amplitude, rel=1e-9)
    poorer = {r.values: r for r in result.runs}
    own = study.replace(harmonics=4, contact_points=6).frequency_response(*place).peak
    change = max(abs(own.amplitude / top.amplitude - 1.0), abs(own.frequency / top.frequency - 1.0))
    assert poorer["4", "6"].difference == pytest.approx(change, rel=1e-6)
    assert result.last_steps["harmonics"] == poorer["3", "9"].difference
    assert result.uncertainty == pytest.approx(poorer["3", "9"].difference + change)


@pytest.mark.slow
def test_each_setting_goes_down_until_it_misses_the_tolerance(study, place, result):
    down = [r for r in result.runs if r.part == "harmonics"]
    assert [r.values[0] for r in down] == ["3", "2", "1"][: len(down)]
    assert all(r.difference <= 0.06 for r in down[:-1])
    strict = bd.accuracy_cost(
        study, *place, vary={"harmonics": [1, 2, 3, 4]}, tolerance=1e-9, sources=()
    )
    assert [r.values for r in strict.runs] == [("4",), ("3",)]
    assert (
        strict.recommended is strict.richest
        and "Not reached: no settings have an error within 1e-07 %" in strict.summary()
    )


def scene(errors):
    """Amplitudes that differ from one by given errors of each harmonics and contact points, and of their combination."""

    def ask(study, preload, interval):
        return 1.0 + errors[
            study.settings.harmonic_numbers[-1], study.settings.contact_points or 9
        ], 300.0

    return ask


def test_combination_that_misses_takes_the_next_richer_value_of_the_worst(study, place):
    errors = {(3, 9): 0.0, (2, 9): 0.01, (1, 9): 0.04, (3, 6): 0.03, (1, 6): 0.07, (2, 6): 0.045}
    found = bd.accuracy_cost(
        study, *place, vary={"harmonics": [1, 2, 3], "contact_points": [6, 9]}, quantity=scene(errors), tolerance=0.09,
        sources=(),
    )  # fmt: skip
    assert [r.values for r in found.runs if r.part == "combination"] == [("1", "6"), ("2", "6")]
    assert all(r.difference == pytest.approx(errors[tuple(map(int, r.values))]) for r in found.runs)
    assert found.uncertainty == pytest.approx(0.01 + 0.03)
    within = [r for r in found.runs[1:] if (1.0 + r.difference) * 1.04 <= 1.09]
    assert (
        found.recommended.seconds == min(r.seconds for r in within) and found.recommended in within
    )


def test_interrupted_runs_are_kept(study, place, tmp_path):
    def ask(study, preload, interval):
        if study.settings.harmonic_numbers[-1] == 1:
            raise KeyboardInterrupt
        return 1.0, 300.0

    vary = {"harmonics": [1, 2, 3]}
    found = bd.accuracy_cost(study, *place, vary=vary, quantity=ask, sources=())
    assert [r.values for r in found.runs] == [("3",), ("2",)] and found.interrupted
    assert "Interrupted: cheaper settings may suffice" in said(found)
    found.save(tmp_path / "cost.h5")
    assert bd.load(tmp_path / "cost.h5").interrupted
    with pytest.raises(KeyboardInterrupt):
        bd.accuracy_cost(study, *place, vary={"harmonics": [1]}, quantity=ask)


def test_unknown_answers_are_not_recommended(study, place):
    errors = {(3, 9): 0.0, (2, 9): float("nan")}
    vary = {"harmonics": [1, 2, 3]}
    found = bd.accuracy_cost(
        study, *place, vary=vary, quantity=scene(errors), tolerance=0.5, sources=()
    )
    assert (
        found.recommended is found.richest
        and "Not known: the settings whose error is within 50 %" in found.summary()
    )
    assert np.isnan(found.uncertainty) and not found.reached
    with pytest.raises(
        bd.BdamperError, match="no peak with the most detailed settings, harmonics = 2"
    ):
        bd.accuracy_cost(study, *place, vary={"harmonics": [1, 2]}, quantity=scene(errors))


def test_runs_that_fail_leave_the_others(study, place, tmp_path):
    """Settings that a study cannot have, and a quantity that raises an error, after the richest was run."""

    def ask(study, preload, interval):
        if study.settings.harmonic_numbers[-1] == 1:
            raise bd.BdamperError("no answer with one harmonic")
        return 1.0, 300.0

    vary = {
        "harmonics": [1, 2, 3],
        "contact_forces": [bd.AFT(8), "event_driven"],
        "rigid_modes": [("TX",), bd.RIGID_NAMES],
    }
    found = bd.accuracy_cost(study, *place, vary=vary, quantity=ask, sources=["harmonics"])
    reasons = {r.part: r.reason for r in found.runs if r.reason}
    assert reasons["harmonics"] == "no answer with one harmonic"
    assert (
        reasons["contact_forces"].startswith("contact_forces: expected")
        and "rigid" in reasons["rigid_modes"]
    )
    assert found.recommended.values == ("2", "event_driven", " ".join(study.settings.rigid_modes))
    assert all(reason in found.summary() for reason in reasons.values())
    found.plot()
    found.save(tmp_path / "cost.h5")
    assert [r.reason for r in bd.load(tmp_path / "cost.h5").runs] == [r.reason for r in found.runs]
    with pytest.raises(
        bd.BdamperError,
        match=r"no peak with the most detailed settings.*no answer with one harmonic",
    ):
        bd.accuracy_cost(study, *place, vary={"harmonics": [1]}, quantity=ask)


HIGHEST, BLADE = 1e-3, 300.0
"""Limits (m, Hz) of :func:`convergent`."""


def convergent(study, preload, interval):
    """A quantity whose limit is known: errors of the second power of harmonics, modes and residual modes."""
    s = study.settings
    method = study.problem.stiffness_method
    method = method if isinstance(method, ResidualModes) else ResidualModes()
    of_vectors = 0.0 if method.n_vectors == "all" else 2.0 / method.n_vectors**2
    error = 0.5 / s.harmonic_numbers[-1] ** 2 + 0.4 / s.blade_modes**2 + of_vectors
    return HIGHEST * (1.0 + error), BLADE


def shipped():
    """A study with residual modes, whose model has more blade modes than it uses."""
    wave = bd.Excitation("tip", direction="tangential")
    return bd.Study(
        bd.reference_model("turbine_blade"), wave, engine_order=5, friction_coefficient=0.35
    )


def error_against_limit(run):
    return abs(run.amplitude / HIGHEST - 1.0)


@pytest.mark.slow
def test_errors_contain_the_error_of_the_reference():
    """Against the limit of the quantity: residual modes, which are not varied, leave 5.6 %."""
    vary = {"harmonics": [1, 3, 5], "blade_modes": [5, 10, 20]}
    found = bd.accuracy_cost(
        shipped(), 200.0, (610.0, 740.0), quantity=convergent, vary=vary, tolerance=0.05
    )
    # 0.02 of harmonics, 0.001 of blade modes, 0.056 of residual modes
    assert error_against_limit(found.richest) == pytest.approx(0.0766, abs=1e-4)
    # twice the detail removes three quarters of an error of the second power
    assert found.uncertainty > 0.7 * error_against_limit(found.richest)
    assert not found.reached
    assert "Not reached: no settings have an error within 5 %" in found._headline()
    unvaried = {error.source: error.size for error in found.sources}["residual flexibility"]
    removed = 2.0 / 36
    assert unvaried == pytest.approx(
        removed / (1.0 + error_against_limit(found.richest) - removed), rel=1e-6
    )


@pytest.mark.slow
def test_settings_within_the_tolerance_have_the_error_of_the_reference_too():
    vary = {"harmonics": [1, 3, 5, 10, 20], "blade_modes": [5, 10, 20]}
    study = shipped().replace(contact_stiffness=ResidualModes(24))
    found = bd.accuracy_cost(
        study, 200.0, (610.0, 740.0), quantity=convergent, vary=vary, tolerance=0.03
    )
    assert found.reached and found.forecast is None
    assert found.recommended is not found.richest
    assert error_against_limit(found.recommended) < 0.03
    for run in found.runs:
        assert 1.0 + found.error(run) == pytest.approx(
            (1.0 + run.difference) * (1.0 + found.uncertainty)
        )
        assert found.columns()["error"].values[found.runs.index(run)] == found.error(run)


@pytest.mark.slow
def test_forecast_meets_a_tolerance_that_was_not_reached():
    """Its settings, computed, are within the tolerance of the limit."""
    vary = {"harmonics": [1, 3, 5], "blade_modes": [5, 10, 20]}
    study = shipped()
    found = bd.accuracy_cost(
        study, 200.0, (610.0, 740.0), quantity=convergent, vary=vary, tolerance=0.04
    )
    forecast = found.forecast
    assert forecast.settings == "all residual modes" and forecast.error < 0.04
    richer = study.replace(harmonics=5, blade_modes=20, contact_stiffness=ResidualModes("all"))
    amplitude, _ = convergent(richer, 200.0, (610.0, 740.0))
    assert amplitude / HIGHEST - 1.0 < 0.04
    # Jacobians, which take most of the time, grow with the square of the unknowns
    richest = study.replace(harmonics=5, blade_modes=20)
    ratio = (richer.problem.n_unknowns / richest.problem.n_unknowns) ** 2
    assert forecast.seconds == pytest.approx(found.richest.seconds * ratio)
    assert "Estimated error with all residual modes: " in said(found)


def test_no_forecast_if_the_model_has_no_more_detail(study, place):
    """The last refinement of the contact points stands for their error, which no setting reduces."""

    def ask(study, preload, interval):
        return 1.0 + (0.1 if study.settings.contact_points == 6 else 0.0), 300.0

    vary = {"contact_points": [6, 9]}
    found = bd.accuracy_cost(
        study, *place, vary=vary, quantity=ask, tolerance=0.05, sources=["contact points"]
    )
    (error,) = found.sources
    assert error.size == pytest.approx(0.1)
    assert (
        error.against
        == "the model has no more contact points; last refinement, from contact points 6"
    )
    assert not found.reached and found.forecast is None
    assert "More detailed settings of this model are not expected to reach it either" in said(found)


def test_a_source_without_a_peak_leaves_the_error_unknown():
    def ask(study, preload, interval):
        if study.settings.harmonic_numbers[-1] > 3:
            raise bd.BdamperError("no answer with more harmonics")
        return 1.0, 300.0

    found = bd.accuracy_cost(
        shipped(), 200.0, (610.0, 740.0), quantity=ask, vary={"blade_modes": [10, 20]}
    )
    assert np.isnan(found.uncertainty) and not found.reached and found.forecast is None
    assert found._headline().startswith("Not known: the settings whose error is within 5 %")
    assert "no answer with more harmonics" in found.summary()


@pytest.mark.nightly
@pytest.mark.slow
def test_uncertainty_of_the_turbine_blade():
    """Truth: the complete curve with 12 harmonics, 20 blade modes and 24 residual modes (90 s)."""
    true = 100.88e-6
    study = shipped().replace(blade_modes=20)
    found = bd.accuracy_cost(
        study, 200.0, (610.0, 740.0), vary={"harmonics": [1, 3, 5]}, tolerance=0.05
    )
    assert abs(found.richest.amplitude / true - 1.0) > 0.05 and not found.reached
    # six more vectors stand for 24, so that the true error may exceed the sum of the changes
    for run in found.runs:
        assert abs(run.amplitude / true - 1.0) < 2.0 * found.error(run)
    change = next(error for error in found.sources if error.source == "harmonics")
    curve = study.replace(harmonics=9).frequency_response(200.0, (610.0, 740.0))
    assert change.size == pytest.approx(
        abs(curve.peak.amplitude / found.richest.amplitude - 1.0), rel=1e-3
    )


@pytest.mark.parametrize("name", models.ALL_MODELS)
def test_default_ladders_suit_every_model(name):
    study = plain_study(
        models.ALL_MODELS[name](0), bd.Excitation("tip"), 1 if name == "acyclic" else 2
    )
    ladders = make_ladders(study.problem, None)
    assert list(ladders) == ["harmonics", "contact_points", "blade_modes"]
    for name, values in ladders.items():
        sizes = [
            varied(study.problem, {name: value}).system(0.0).n_unknowns for value in values.values()
        ]
        assert sizes == sorted(sizes)
    assert list(make_ladders(oscillator(1).problem, None)) == ["harmonics", "contact_points"], (
        "masses have no modes"
    )


# ---- effectivity ----


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", [2, 4, 8, *(pytest.param(n, marks=pytest.mark.slow) for n in (12, 20))]
)
def test_effectivity_on_a_sample(number):
    compared = accuracy_cases.compare(number)
    assert compared is not None
    assert 0.3 < compared.effectivity < 3.0, compared


@pytest.mark.slow
def test_the_peak_is_a_corner_where_the_damper_drifts():
    case = accuracy_cases.draw(153)
    one = accuracy_cases.study_of(case).replace(harmonics=1, damper_modes=0)
    place = accuracy_cases.scene(one, case)
    for study in (one, one.replace(harmonics=3)):  # the first has no smooth maximum at all
        curve, peak = study.frequency_response(*place), study.peak(*place)
        assert peak.corner and curve.point_kind[curve.peak_index] == "drift"
        assert peak.amplitude == pytest.approx(curve.peak.amplitude, rel=1e-6)
        assert peak.frequency == pytest.approx(curve.peak.frequency, rel=1e-6)
