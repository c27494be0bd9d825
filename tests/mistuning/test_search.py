"""The search for the highest blade: springs that hold dampers, which peaks are freed, errors."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.mistuning import BladedDisk, DiskPeakOptions, Mistuning
from bdamper.mistuning.disk_equations import of_blade
from bdamper.mistuning.peak import MISSED, _status
from bdamper.mistuning.peak_search import TOLERANCE, Climbed, Search, band, uphill
from tests.mistuning.lumped import lumped_study, size, solution
from tests.mistuning.test_symmetry import PATTERN, N, study

FEW = DiskPeakOptions(least=12, most=12, climbs=2)
SIX = np.array([0.001, -0.001, 0.0, 0.0, 0.002, 0.0])
"""Deviations of a wheel whose curve at 300 N goes on through some ninety folds beyond its first maximum."""


@pytest.mark.slow
def test_a_held_peak_solves_the_equations_with_its_springs():
    wheel = BladedDisk(study(), PATTERN)
    top = wheel.peak(300.0, options=FEW)
    assert (
        top.status == "held"
        and top.found
        and not top.ok
        and top.springs > 0.0
        and top.error >= 0.06
    )
    system = wheel.system(300.0)
    y = np.append(system.structure.flat(top.unknowns), 2.0 * np.pi * top.frequency)
    assert size(system, system.structure.held(top.springs).residual(y)) <= TOLERANCE
    assert size(system, system.residual(y)) > 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "preload"), [(9, 300.0), (6, 1000.0), (1, 2000.0)])
def test_the_peak_is_that_of_its_highest_blade(seed, preload):
    wheel = BladedDisk(study(), Mistuning.random(N, 0.03, seed=seed))
    top = wheel.peak(preload)
    system = wheel.system(preload).structure.held(top.springs)
    heights = np.abs(top.response[:, 1])
    assert top.blade == heights.argmax() and top.amplitude == heights.max()
    width, omega = 2.0 * np.pi * band(wheel, preload)[2], 2.0 * np.pi * top.frequency
    y = np.append(system.structure.flat(top.unknowns), omega)
    again = uphill(of_blade(system, top.blade), y, None, system.structure.units_about(y, width))
    assert np.abs(system.structure.responses(again.y[:-1])).max() == pytest.approx(
        top.amplitude, rel=1e-4
    )
    for aside in (-2e-3 * width, 2e-3 * width):  # on either side that blade is lower
        found = solution(system, omega + aside, y[:-1])
        assert found.status == 0
        assert (
            np.abs(system.structure.responses(found.y[:-1])[top.blade, 1])
            < (1.0 + 1e-6) * top.amplitude
        )


@pytest.mark.slow
def test_the_peak_of_a_wheel_with_many_folds_is_its_first_maximum():
    """It is the one that a blade keeps in time; no search may put one further along the curve in its place."""
    top = BladedDisk(study(), SIX).peak(300.0)
    assert top.status == "complete"
    assert top.amplitude == pytest.approx(2.248e-3, rel=1e-3) and top.frequency == pytest.approx(
        235.35, abs=0.01
    )


@pytest.mark.slow
def test_a_tuned_wheel_is_not_amplified_however_coarse_the_sweep():
    top = BladedDisk(study()).peak(300.0, options=DiskPeakOptions(least=3, most=3))
    assert top.amplification == pytest.approx(1.0, abs=1e-4)


@pytest.mark.slow
def test_a_sweep_without_peaks_is_tried_with_weaker_springs():
    """With springs of a tenth this tuned wheel has none, and none of its blades may be higher than its sector."""
    lumped = lumped_study(N, 1, harmonics=1, n_c=2, r=2, seed=2).replace(
        excitation=bd.Excitation("tip", amplitude=100.0)
    )
    top = BladedDisk(lumped).peak(300.0)
    assert top.status == "complete" and top.amplification == pytest.approx(1.0, abs=1e-6)
    assert top.climbs[:, 3].max() < 0.1


@pytest.mark.slow
def test_a_band_without_peaks_is_widened_upward():
    """Dampers held vibrate 13 Hz above the waves of the tuned peak, whose branch comes down from folds up there."""
    wheel = BladedDisk(study(engine_order=2))
    assert band(wheel, 300.0)[1] == pytest.approx(282.2, abs=0.1)
    top = wheel.peak(300.0, options=FEW)
    assert top.amplification == pytest.approx(1.0, abs=1e-6) and top.interval[1] == pytest.approx(
        1.5 * top.frequency
    )
    assert wheel.peak(300.0, (168.9, 282.2), options=FEW).status == "not found"


@pytest.mark.slow
def test_a_disk_whose_tuned_peak_rattles_has_no_peak():
    """Blades apart from their dampers reach a hundred millimetres, without a steady periodic response."""
    wheel = BladedDisk(study(engine_order=2))
    for interval in (None, (210.0, 299.0)):
        top = wheel.peak(100.0, interval)
        assert top.status == "not found" and np.isnan(top.amplitude)
        assert top.reason.startswith("the tuned disk has no peak: not found: no steady periodic")


@pytest.mark.slow
def test_shapes_that_do_not_serve_are_left_out(monkeypatch):
    """Random attachments, whose flexibility twelve shapes do not have: the reduced wheel's peak is a quarter as high."""
    lumped = lumped_study(N, 1, harmonics=1, n_c=4, r=2, n_att=14).replace(
        excitation=bd.Excitation("tip", amplitude=100.0)
    )
    wheel = BladedDisk(lumped, Mistuning.random(N, 0.03, seed=(0, 1)))
    few = DiskPeakOptions(climbs=4)
    asked = wheel.peak(1000.0, options=few)
    monkeypatch.setattr("bdamper.mistuning.peak.SHAPES", 100)  # no blade is reduced
    whole = wheel.peak(1000.0, options=few)
    assert whole.status == asked.status == "complete" and asked.amplitude == pytest.approx(
        whole.amplitude, rel=1e-9
    )
    assert "reduced" not in asked.reason


@pytest.mark.slow
@pytest.mark.parametrize(("climbs", "error"), [(2, MISSED), (100, 0.0)])
def test_a_peak_may_be_missed_where_not_all_maxima_are_climbed(climbs, error):
    options = replace(FEW, climbs=climbs)
    top = BladedDisk(study(), Mistuning.random(N, 0.03, seed=0)).peak(500.0, options=options)
    assert top.error == error + top.harmonics_error
    assert top.lower_error == top.harmonics_error, "a missed peak is higher than the one found"


def test_a_peak_of_the_reduced_wheel_alone_is_held():
    free, sprung = (climbed(0, (0.1, last), (1.0, 1.0)) for last in (0.0, 0.01))
    cases = (free, False, False), (free, False, True), (sprung, False, False), (free, True, True)
    assert [_status(*case) for case in cases] == ["complete", "held", "held", "incomplete"]


def climbed(blade, springs, heights, **more):
    return Climbed(None, blade, springs, heights, **more)


@pytest.mark.parametrize(
    ("heights", "order"),
    [
        (
            {0: (8.6, 8.8), 1: (10.0, 6.0), 2: (9.4, 9.5)},
            [1, 2, 0],
        ),  # the highest falls, and with it what may be above it
        ({0: (9.5, 10.5), 1: (10.0, 10.0), 2: (8.9, 20.0)}, [1, 0]),
    ],
)
def test_what_may_be_the_highest_is_freed_next(monkeypatch, heights, order):
    asked = []

    def weakened(_, peak):
        asked.append(peak.blade)
        return climbed(peak.blade, (0.1, 0.0), heights[peak.blade])

    monkeypatch.setattr(Search, "weakened", weakened)
    held = [climbed(blade, (0.1,), height[:1]) for blade, height in heights.items()]
    freed = Search(None, 0.0, (0.0, 0.0)).freed(held)
    assert asked == order
    assert [peak.height for peak in freed] == [
        height[blade in order] for blade, height in heights.items()
    ]


def test_from_weak_springs_on_only_near_rivals_are_freed_further():
    far, near = (climbed(k, (0.1, 0.01), (9.9, height)) for k, height in enumerate((9.6, 9.75)))
    assert far.below == near.below == 0.03 and climbed(0, (0.1,), (1.0,)).below == 0.1
    asked = []
    search = SimpleNamespace(
        weakened=lambda p: asked.append(p.blade) or replace(p, last=True), different=list
    )
    Search.freed(search, [far, near, climbed(2, (0.1, 0.0), (10.0, 10.0))])
    assert asked == [1]


def test_peaks_that_become_one_are_followed_once(monkeypatch):
    at, asked = SimpleNamespace(y=np.array([0.0, 100.0])), []

    def weakened(_, peak):
        asked.append(peak.heights)
        return Climbed(
            at, 7, (*peak.springs, 0.0 if len(peak.springs) > 1 else 0.01), (*peak.heights, 10.0)
        )

    monkeypatch.setattr(Search, "weakened", weakened)
    freed = Search(None, 1.0, (0.0, 0.0)).freed(
        [climbed(1, (0.1,), (9.9,)), climbed(2, (0.1,), (9.8,))]
    )
    assert asked == [(9.9,), (9.8,), (9.9, 10.0)] and len(freed) == 1


def test_the_error_of_held_peaks_covers_what_freeing_changes(monkeypatch):
    seen, own = [], Search.freed
    monkeypatch.setattr(Search, "freed", lambda self, peaks: seen.extend(own(self, peaks)) or seen)
    top = BladedDisk(study(), Mistuning.random(N, 0.03, seed=0)).peak(500.0, options=FEW)
    highest = max(seen, key=lambda peak: peak.height)
    assert top.ok and top.error == MISSED + top.harmonics_error
    assert (
        highest.heights[0] > 1.1 * top.amplitude
    )  # with springs of a tenth of the stuck stiffness
    for n in range(1, len(highest.heights)):
        part = replace(highest, springs=highest.springs[:n], heights=highest.heights[:n])
        assert abs(top.amplitude / part.height - 1.0) <= part.error < 0.6


def test_a_peak_carries_the_error_of_a_rival_that_could_not_be_freed(monkeypatch):
    own = Search.freed

    def freed(self, peaks):
        free = max(own(self, peaks), key=lambda peak: peak.height)
        return [free, replace(free, springs=(0.1,), heights=(0.99 * free.height,), last=True)]

    monkeypatch.setattr(Search, "freed", freed)
    top = BladedDisk(study(), PATTERN).peak(2000.0, options=FEW)
    of_rival = top.error - top.harmonics_error
    assert top.status == "complete" and abs(of_rival - (0.99 * 1.2 - 1.0)) < 1e-4
    assert top.lower_error == top.harmonics_error


def test_a_climb_that_never_arrives_is_no_peak(monkeypatch):
    monkeypatch.setattr("bdamper.mistuning.peak_search.uphill", lambda *arguments: None)
    top = BladedDisk(study(), Mistuning.random(N, 0.03, seed=0)).peak(2000.0, options=FEW)
    assert top.status == "not found" and np.isnan(top.amplitude)


def test_a_peak_that_is_never_a_solution_is_none(monkeypatch):
    monkeypatch.setattr(Search, "settled", lambda self, peak, y=None: None)
    assert BladedDisk(study(), PATTERN).peak(2000.0, options=FEW).status == "not found"


def test_a_disk_with_contacts_between_blades_is_refused_by_name():
    shrouded = bd.Study(
        bd.reference_model("shrouded_blade"),
        bd.Excitation("tip"),
        engine_order=4,
        constant_loads={"shroud": 20.0},
    )
    with pytest.raises(bd.ModelError, match="found 'shroud' between blades"):
        BladedDisk(shrouded)
