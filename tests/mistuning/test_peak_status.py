"""A peak counts only if the sweep has solutions in the whole band."""

from types import SimpleNamespace

import numpy as np
import pytest

from bdamper.mistuning import BladedDisk, DiskPeakOptions
from bdamper.mistuning.peak_search import Search
from bdamper.mistuning.peak_search import band as band_of
from bdamper.util.errors import BdamperWarning
from tests.mistuning.lumped import lumped_study
from tests.mistuning.test_symmetry import PATTERN, study
from tests.printed import said


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [(433.0, 447.0), (470.0, 600.0)])
def test_a_part_of_the_band_without_solutions_leaves_a_lower_bound(monkeypatch, hidden):
    wheel = BladedDisk(study(), mistuning=PATTERN)
    band, options = (425.0, 480.0), DiskPeakOptions(least=12, most=12, climbs=1)
    whole = wheel.peak(2000.0, band, options=options)
    assert whole.ok and whole.reason == "1 peaks from 12 of 12 points", whole.reason
    assert whole.sweep_frequency[0] == pytest.approx(band[0]) and whole.sweep_frequency[
        -1
    ] == pytest.approx(band[1])

    assert whole.interval == band
    own = Search.sweep

    def lost(search, omega):
        return [
            None if hidden[0] < y[-1] / (2.0 * np.pi) < hidden[1] else y for y in own(search, omega)
        ]

    monkeypatch.setattr(Search, "sweep", lost)
    part = wheel.peak(2000.0, band, options=options)
    assert not part.ok and part.status == "incomplete" and part.blade == whole.blade
    assert part.amplitude == pytest.approx(whole.amplitude, rel=1e-5)
    low, high = (float(part.reason.split(" Hz")[0].split()[i]) for i in (-3, -1))
    step = whole.sweep_frequency[1] - whole.sweep_frequency[0]
    assert (
        hidden[0] < low < hidden[0] + step
        and min(hidden[1], band[1] + 1e-9) - step < high < hidden[1]
    )
    assert "no solution found between" in part.reason
    doubt = "Not for design: a blade may have a larger amplitude than "
    assert part._headline().startswith(doubt)
    assert "at least; relative to the tuned" in said(part) and "DiskPeakOptions(least=240)" in said(
        part
    )
    with pytest.warns(
        BdamperWarning, match="amplification: a lower bound, since the peak is incomplete"
    ):
        assert part.amplification == pytest.approx(whole.amplification, rel=1e-5)
    assert (np.diff(part.sweep_frequency) > 0.0).all()
    ends = band_of(wheel, 2000.0)
    hidden = ends[0] + 0.3 * (ends[1] - ends[0]), ends[0] + 0.6 * (ends[1] - ends[0])
    left = wheel.optimal_curve([2000.0], options=options)
    assert left.status_text[0].startswith("failed: incomplete: ") and not left.values[0]


def test_peaks_beyond_the_band_do_not_count():
    wheel = BladedDisk(study(), mistuning=PATTERN)
    top = wheel.peak(2000.0, (170.0, 215.0), options=DiskPeakOptions(least=12, most=12, climbs=1))
    assert (
        top.status == "not found"
        and np.isnan(top.amplitude)
        and top.blade == -1
        and np.isnan(top.error)
    )


def test_candidates_are_of_different_blades_or_frequencies_and_gaps_part_neighbours():
    heights = [[1.0, 1.0], [9.0, 8.5], [7.0, 2.0], None, [6.0, 1.0], [3.0, 5.0], [1.0, 1.0]]
    scene = SimpleNamespace(shape=(2, 3, 1), responses=lambda u: np.column_stack([0.0 * u, u]))
    system = SimpleNamespace(structure=scene)
    swept = [None if h is None else np.array([*h, float(i)]) for i, h in enumerate(heights)]
    found = [(at[-1], blade) for at, blade in Search(system, 1.0, (0.0, 9.0)).candidates(swept, 5)]
    assert found == [(1.0, 0), (1.0, 1), (4.0, 0), (5.0, 1)]


@pytest.mark.slow
@pytest.mark.parametrize("preload", [1500.0, 2000.0])
def test_the_error_covers_more_harmonics(preload):
    """Of the highest blade, and of the tuned disk; the searches with three harmonics are
    independent."""
    options = DiskPeakOptions(least=40, most=60, climbs=60)
    one, three = (
        BladedDisk(study(harmonics=n), mistuning=PATTERN).peak(preload, options=options)
        for n in (1, 3)
    )
    assert one.ok and three.ok and one.blade == three.blade
    change = abs(three.amplitude / one.amplitude - 1.0)
    tuned = abs(three.tuned_amplitude / one.tuned_amplitude - 1.0)
    # all maxima of the sweep were examined, so that no other error remains
    assert one.error == one.lower_error == one.harmonics_error
    assert 0.01 < max(change, tuned) <= 1.001 * one.harmonics_error < 1.5 * max(change, tuned)


def test_without_a_solution_the_error_of_harmonics_is_unknown(monkeypatch):
    monkeypatch.setattr(Search, "change_by_harmonics", lambda *_: np.nan)
    monkeypatch.setattr(BladedDisk, "tuned_change", lambda *_: np.nan)
    options = DiskPeakOptions(least=12, most=12, climbs=60)
    top = BladedDisk(study(), mistuning=PATTERN).peak(2000.0, options=options)
    assert top.error == top.lower_error == 0.0 and np.isnan(top.harmonics_error)
    assert "does not include the effect of more harmonics" in top.reason


@pytest.mark.parametrize(
    ("damping", "amplitude", "words"),
    [(0.0, np.inf, "unbounded"), (1e-8, np.nan, "no significant digits")],
)
def test_a_resonance_without_an_amplitude_is_no_peak(damping, amplitude, words):
    """Bonded contacts dissipate nothing: what limits the amplitude is damping."""
    bonded = lumped_study(6, 1, zeta=damping, friction_law="bonded")
    disk = BladedDisk(bonded, mistuning=PATTERN)
    top = disk.peak(100.0)
    assert top.status == "incomplete" and top.reason.startswith(words)
    np.testing.assert_equal(top.amplitude, amplitude)
    assert top._headline().startswith("No peak of the bladed disk")
    assert disk.optimal_curve([100.0]).status_text[0].startswith(f"failed: incomplete: {words}")


def test_a_peak_sharper_than_rounding_has_no_amplitude(monkeypatch):
    """The tuned peak may lie outside the band."""
    monkeypatch.setattr("bdamper.mistuning.peak._unresolved_tuned", lambda _: "")
    monkeypatch.setattr("bdamper.response.resolution.frequency_rounding", lambda *_: 1e-6)
    options = DiskPeakOptions(least=12, most=12, climbs=1)
    top = BladedDisk(study(), mistuning=PATTERN).peak(2000.0, options=options)
    assert np.isnan(top.amplitude) and top.reason.startswith("no significant digits remain at ")
