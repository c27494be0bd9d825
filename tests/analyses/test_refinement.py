"""Refinement of a study to a tolerance: against much finer studies, and where it cannot succeed."""

import re
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import error_estimates, refinement
from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.util.errors import SettingError
from tests import models

BAND = (0.1, 0.35)


def random_masses(seed):
    """Two masses with a contact of random stiffness and friction, one harmonic."""
    rng = np.random.default_rng(seed)
    kt = rng.uniform(0.5, 2.0)
    kn = rng.uniform(0.5, 2.0)
    contact = bd.Contact((1, 0), normal=1, kt=kt, kn=kn, mu=rng.uniform(0.3, 0.6))
    return bd.lumped(
        [1.0, 0.1],
        [0.02, 0.02],
        [1.0, 0.1],
        contacts=[contact],
        forces={0: 0.1},
        load_per_preload={1: 1.0},
        harmonics=1,
    )


def wedge(seed):
    """A wedge with eight blade modes, of which the study has three."""
    model = models.wedge_model(seed=seed, harmonics=9, n_blade_modes=8, n_damper_modes=0)
    return bd.Study(model, bd.Excitation("tip"), 2, harmonics=1, blade_modes=3)


@pytest.fixture(scope="module")
def masses():
    study = random_masses(61)
    return study, study.peak(1.0, BAND)


@pytest.fixture(scope="module")
def refined(masses):
    study, peak = masses
    return study.refine(peak, tolerance=0.005)


@pytest.mark.parametrize("seed", [61, 62, 63])
def test_refined_peak_is_within_the_tolerance_of_a_much_finer_study(seed):
    study = random_masses(seed)
    peak = study.peak(1.0, BAND)
    result = study.refine(peak, tolerance=0.005)
    finer = study.replace(harmonics=21).peak(1.0, BAND)
    assert result.reached and result.error <= 0.005
    assert abs(peak.amplitude / finer.amplitude - 1.0) > 0.005
    assert result.peak.amplitude == pytest.approx(finer.amplitude, rel=0.005)
    assert result.peak.frequency == pytest.approx(finer.frequency, rel=0.005)


@pytest.mark.nightly
@pytest.mark.slow
def test_the_largest_source_is_refined():
    """The changes by harmonics and by residual modes are almost equal, and each takes one step."""
    study = wedge(21).replace(contact_stiffness=ResidualModes(partial_contact=False))
    peak = study.peak(60.0)
    result = study.refine(peak)
    assert result.reached
    assert [step.largest for step in result.steps[:2]] == ["harmonics", "residual flexibility"]
    assert [step.change for step in result.steps[1:]] == [
        "5 harmonics",
        "6 more residual modes",
    ]
    all_vectors = ResidualModes(n_vectors="all", n_soft=0)
    finer = study.replace(harmonics=3, blade_modes=8, contact_stiffness=all_vectors).peak(60.0)
    assert abs(peak.amplitude / finer.amplitude - 1.0) > 0.05
    assert result.peak.amplitude == pytest.approx(finer.amplitude, rel=0.05)


def test_peak_and_prices_of_the_steps(masses, refined):
    _, peak = masses
    first, last = refined.steps
    assert first.amplitude == peak.amplitude and last.amplitude == refined.peak.amplitude
    assert refined.evaluations == first.evaluations + last.evaluations > 20
    assert refined.seconds == first.seconds + last.seconds > 0.0
    # the peak of the estimate is the peak of the refined study
    searched = refined.study.peak(1.0, BAND)
    assert refined.study.settings.harmonics == 5
    assert refined.peak.amplitude == pytest.approx(searched.amplitude, rel=1e-8)
    assert refined.peak.half_range == pytest.approx(searched.half_range, rel=1e-3)
    assert refined.study.estimate_errors(refined.peak).total == pytest.approx(refined.error)


def test_file_contains_all_but_the_study(masses, refined, tmp_path):
    study, _ = masses
    refined.save(tmp_path / "refined.h5")
    loaded = bd.load(tmp_path / "refined.h5")
    assert loaded.study is None and str(loaded) == str(refined)
    assert loaded.steps == refined.steps
    assert loaded.peak.y == pytest.approx(refined.peak.y)
    again = bd.load_study(tmp_path / "refined.h5", study.model)
    assert again.problem.harmonic_numbers == (1, 2, 3, 4, 5)


@pytest.mark.slow
def test_modes_that_the_model_lacks_are_named():
    """After all modes a part of the last change is left."""
    study = wedge(22)
    result = study.refine(study.peak(60.0))
    assert not result.reached and result.status == "incomplete"
    assert [step.change for step in result.steps] == ["", "8 modes"]
    change = result.steps[1].amplitude / result.steps[0].amplitude - 1.0
    left = next(item for item in result.sources if item.source == "modes")
    assert left.amplitude == pytest.approx(0.125 * change, rel=1e-6)
    assert result.reason.startswith("the model has no more detail for modes")
    # twice the number leaves an eighth; half of the tolerance is allowed
    n_modes = 8.0 * (left.size / (0.5 * 0.05)) ** (1.0 / 3.0)
    assert result.needed == f"a model with about {np.ceil(n_modes):.0f} modes"
    assert np.isfinite(result.needed_seconds)
    text = str(result)
    assert (
        text.startswith("Tolerance of 5 % not reached: estimated error")
        and "Needed: a model with" in text
    )


def test_next_step_beyond_the_limit_is_not_begun(masses, monkeypatch):
    study, peak = masses
    monkeypatch.setattr(refinement._Search, "_seconds_with", lambda *_: 1e6)
    result = study.refine(peak, tolerance=0.005)
    assert not result.reached and len(result.steps) == 1
    assert "the limit for all steps is 600 s" in result.reason
    assert re.match(r"\d+ harmonics", result.needed)
    assert result.needed_seconds % 1e6 == 0.0


def test_step_beyond_the_limit_is_stopped(masses):
    study, peak = masses
    result = study.refine(peak, maximum=1e-6)
    assert result.status == "incomplete" and "was stopped after 1 µs" in result.reason
    (step,) = result.steps
    assert np.isnan(step.error) and step.amplitude == peak.amplitude
    assert "estimated error unknown" in str(result)


def test_lost_harmonics_leave_the_case_to_time_integration(masses, monkeypatch):
    study, peak = masses
    nothing = error_estimates.Solution(error_estimates.Change(how="no complete response curve"))
    monkeypatch.setattr(error_estimates, "solve_other", lambda *args, **options: nothing)
    result = study.refine(peak)
    assert "harmonic balance cannot determine the amplitude" in result.reason
    assert result.needed == "time integration, study.time_response(peak)"


def with_harmonic_peaks(monkeypatch, *ratios):
    """Let the peaks with more harmonics have these amplitudes, relative to the first one."""
    examine = refinement.examine

    def examined(problem, peak, *arguments):
        estimates, enriched = examine(problem, peak, *arguments)
        peaks = tuple(
            replace(item, amplitude=ratio * peak.amplitude)
            for item, ratio in zip(estimates.harmonic_peaks, ratios, strict=True)
        )
        return replace(estimates, harmonic_peaks=peaks), enriched

    monkeypatch.setattr(refinement, "examine", examined)


def test_a_small_error_is_not_reached_while_harmonics_do_not_approach_each_other(
    masses, monkeypatch
):
    """Two equal peaks may lie beside a third one: a step with more harmonics comes first."""
    study, peak = masses
    with_harmonic_peaks(monkeypatch, 1.0, 0.7, 1.01)
    result = study.refine(peak, tolerance=0.9)
    assert result.steps[0].error < 0.9 and len(result.steps) == 2
    assert not result.reached and "harmonic balance cannot determine the amplitude" in result.reason


def test_growing_changes_far_below_the_tolerance_do_not_matter(masses, monkeypatch):
    """Changes of 0.3 and 0.6 % stay below a fifth of 9 %, and exceed a fifth of 1 %."""
    study, peak = masses
    with_harmonic_peaks(monkeypatch, 1.0, 1.003, 1.009)
    result = study.refine(peak, tolerance=0.09)
    assert result.reached and len(result.steps) == 1
    result = study.refine(peak, tolerance=0.01)
    assert not result.reached and "harmonic balance cannot determine the amplitude" in result.reason


def test_plot_shows_steps_tolerance_and_need(refined):
    ax = refined.plot().axes[0]
    _, labels = ax.get_legend_handles_labels()
    assert labels == ["estimated error", "tolerance, 0.5 %"]
    # the first point has the settings of the study, and no name
    assert [text.get_text() for text in ax.texts] == ["5 harmonics"]
    errors = [100.0 * step.error for step in refined.steps]
    assert ax.lines[0].get_ydata() == pytest.approx(errors)
    lacking = replace(refined, needed="a model with about 12 modes", needed_seconds=3.0)
    _, labels = lacking.plot().axes[0].get_legend_handles_labels()
    assert labels[1].startswith("needed:\na model")


def test_wrong_arguments_are_named(masses):
    study, peak = masses
    with pytest.raises(SettingError, match=r"^tolerance: expected"):
        study.refine(peak, tolerance=0.0)
    with pytest.raises(SettingError, match=r"^maximum: expected"):
        study.refine(peak, maximum=0.0)
    with pytest.raises(SettingError, match="of this study"):
        study.replace(harmonics=3).refine(peak)


def test_harmonics_alone_are_added_on_request(masses):
    study, peak = masses
    result = study.refine(peak, tolerance=0.005, sources=["harmonics"])
    assert result.reached and result.examined == ("harmonics",)
    finer = study.replace(harmonics=21).peak(1.0, BAND)
    assert abs(peak.amplitude / finer.amplitude - 1.0) > 0.005
    assert result.peak.amplitude == pytest.approx(finer.amplitude, rel=0.005)
    assert result.study.problem.harmonic_numbers[-1] > 1
    assert [item.source for item in result.sources] == ["harmonics"]
    assert "Not covered  time integration, contact_forces, contact points" in str(result)
    with pytest.raises(SettingError, match=r"^sources"):
        study.refine(peak, sources=["time"])
    # the peak names this call
    assert 'study.refine(peak, sources=["harmonics"])' in str(peak)
