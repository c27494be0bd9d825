"""Peaks that are followed to higher preloads wherever the amplitude falls."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import robust_optimum
from bdamper.response import followed_peak, highest_peak, response_curve
from bdamper.response.branches import NO_SOLUTION, LeftOut
from bdamper.response.followed_peak import Followed, follow_upward, followed_peaks
from bdamper.response.highest_peak import FOLLOWED
from bdamper.response.linear_limits import peak_interval
from bdamper.response.peak import coarse_options
from bdamper.response.response_curve_result import NO_STEADY
from tests.printed import said as printed
from tests.util.test_disk import BAND, pressed

FOUND = {1.0: 10.0, 2.0: 9.0, 3.0: 4.0, 4.0: 3.9, 5.0: 3.8}
"""Highest amplitude found at each preload; at 3 N a branch is lost."""


def branch_to(end):
    """Return a stand-in for follow_upward: a peak of 11 m less the preload, up to the preload ``end``."""
    asked = []

    def follow(problem, peak, preload, *, above=0.0, options=None):
        asked.append((peak.parameter, preload))
        height = 11.0 - preload
        if preload > end or height <= above:
            return None
        return SimpleNamespace(parameter=preload, amplitude=height, frequency=1.0)

    return follow, asked


def followed(monkeypatch, end, heights=None, known=lambda p: True, before=None):
    follow, asked = branch_to(end)
    monkeypatch.setattr(followed_peak, "follow_upward", follow)
    peak_at = lambda p: SimpleNamespace(parameter=p, amplitude=11.0 - p)
    return followed_peaks(None, heights or FOUND, known, peak_at, before), asked


def test_a_lost_branch_is_followed_to_its_end(monkeypatch):
    found, asked = followed(monkeypatch, end=4.5)
    assert {p: (f.peak.amplitude, f.start) for p, f in found.items()} == {
        3.0: (8.0, 2.0),
        4.0: (7.0, 3.0),
    }
    assert asked == [(1.0, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, 5.0)]
    assert found[3.0].note.startswith("higher on the peak followed from 2 N: 8 m at 1 Hz")


def test_a_peak_that_vanishes_or_stays_the_highest_is_no_doubt(monkeypatch):
    assert followed(monkeypatch, end=2.5)[0] == {}
    smooth = {p: 11.0 - p for p in FOUND}
    found, asked = followed(monkeypatch, end=9.0, heights=smooth)
    assert found == {} and len(asked) == 4
    rising = {p: 1.0 + p for p in FOUND}
    assert followed(monkeypatch, end=9.0, heights=rising) == ({}, [])


def test_a_branch_that_is_lost_in_small_steps(monkeypatch):
    """No amplitude is a third below its neighbour; from 2.2 N on they are below the branch."""
    heights = {p: 11.0 - p if p < 2.1 else 10.4 - p for p in np.arange(1.0, 5.0, 0.2).round(1)}
    found, _ = followed(monkeypatch, end=9.0, heights=heights)
    # 0.6 m are more than 5 % throughout
    assert set(found) == {p for p in heights if p > 2.1}


def test_a_difference_within_the_tolerance_of_an_amplitude_is_no_doubt(monkeypatch):
    """The peak is followed on, and the same difference is a doubt where it exceeds 5 %."""
    heights = {1.0: 10.0, 2.0: 8.7, 4.0: 6.7, 5.5: 5.2, 6.0: 4.7}
    found, asked = followed(monkeypatch, end=9.0, heights=heights)
    assert set(found) == {5.5, 6.0} and found[5.5].start == 4.0
    assert len(asked) == 4


def test_pairs_that_showed_nothing_are_not_compared_again(monkeypatch):
    follow, asked = branch_to(2.5)
    monkeypatch.setattr(followed_peak, "follow_upward", follow)
    compared = set()
    for _ in range(2):
        followed_peaks(
            None,
            FOUND,
            lambda _: True,
            lambda p: SimpleNamespace(parameter=p, amplitude=11.0 - p),
            compared=compared,
        )
    assert len(asked) == 4 and (2.0, 3.0) in compared


def test_unknown_and_missing_preloads(monkeypatch):
    """A preload without a known amplitude gets none, and the peak is followed across it."""
    found, asked = followed(monkeypatch, end=9.0, known=lambda p: p != 3.0)
    assert set(found) == {4.0, 5.0} and len(asked) == 4
    assert set(followed(monkeypatch, end=9.0, heights=FOUND | {2.0: np.nan})[0]) == {3.0, 4.0, 5.0}


def test_preloads_between_followed_ones_are_followed(monkeypatch):
    """A preload that is added later between two followed ones has the same branch."""
    first, _ = followed(monkeypatch, end=9.0)
    found, asked = followed(monkeypatch, end=9.0, heights=FOUND | {3.5: 3.95}, before=first)
    assert set(found) == {3.0, 3.5, 4.0, 5.0} and isinstance(found[3.5], Followed)
    assert asked == [(1.0, 2.0), (3.0, 3.5)]


def test_a_smooth_peak_is_followed_to_the_peak_of_the_other_preload():
    """Following and an independent search give the same peak; below a given height there is none."""
    study = pressed()
    low, high = (study.peak(p, BAND) for p in (2.0, 3.0))
    there = follow_upward(study.problem, low, 3.0)
    assert (there.amplitude, there.frequency) == pytest.approx(
        (high.amplitude, high.frequency), rel=1e-6
    )
    assert (
        follow_upward(study.problem, low, 3.0, above=1.01 * max(low.amplitude, high.amplitude))
        is None
    )
    assert follow_upward(study.problem, replace(low, corner=True), 3.0) is None


@pytest.fixture(scope="module")
def right():
    return pressed().peak(2.0, BAND).amplitude


class TestAnalyses:
    """Each analysis over preloads: the search at 2 N finds a lower solution than the branch from 1 N has."""

    PLACES, LOST = [1.0, 2.0, 4.0], 2.0

    @pytest.fixture
    def study(self, monkeypatch):
        """Study whose search at 2 N finds 0.3 times the amplitude."""
        whole = highest_peak.highest_of_curve

        def lower(system, curve, *, options=None):
            top = whole(system, curve, options=options)
            if curve.preload != self.LOST:
                return top
            return replace(top, peak=replace(top.peak, amplitude=0.3 * top.peak.amplitude))

        monkeypatch.setattr(highest_peak, "highest_of_curve", lower)
        return pressed()

    def test_optimal_curve(self, study, right):
        curve = study.optimal_curve(self.PLACES, frequency=BAND, check=False)
        i = int(np.flatnonzero(curve.preload == self.LOST)[0])
        assert np.isnan(curve.amplitude[i]) and curve.lower_bound[i] == pytest.approx(
            right, rel=1e-6
        )
        assert curve.status_text[i].startswith("incomplete: higher on the peak followed from ")
        assert curve.optimum.preload != self.LOST

    def test_sweep(self, study, right):
        found = bd.sweep(study, {"preload": self.PLACES[::-1]}, frequency=BAND)
        assert found.status[0] == found.status[2] == "complete"
        assert found.status_text[1].startswith("incomplete: higher on the peak followed from 1 N")
        assert np.isnan(found.array("amplitude")[1]) and found.array("lower_bound")[
            1
        ] == pytest.approx(right, rel=1e-6)
        assert "followed from 1 N" in found.warnings[1]

    def test_robust_optimum(self, study, monkeypatch):
        grid = np.array(self.PLACES)
        monkeypatch.setattr(
            robust_optimum,
            "preload_values",
            lambda ends, n: grid if n > 2 else np.array([1.0, 4.0]),
        )
        found = bd.robust_optimum(
            study, {"friction_coefficient": [0.3]}, (1.0, 4.0), n=5, tolerance=0.9, frequency=BAND
        )
        assert found.preload == 1.0 and found.warnings == 1


def wedge():
    """A wedge of 0.1 kg between two masses of 1 kg, which loses the branch of its peak at 0.8 N."""
    free = [[1393e3, -528e3, -543e3, 0], [-528e3, 1247e3, 0, -461e3],
            [-543e3, 0, 1246e3, -306e3], [0, -461e3, -306e3, 1286e3]]  # fmt: skip
    stiffness = np.zeros((6, 6))
    stiffness[:4, :4] = free
    stiffness[4:, 4:] = 282e3 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    c, s = np.cos(0.595), np.sin(0.595)
    left = bd.Contact(
        {0: -c, 1: -s, 4: c, 5: s}, {0: s, 1: -c, 4: -s, 5: c}, kt=368e3, kn=368e3, mu=0.35
    )
    right = bd.Contact(
        {2: -c, 3: s, 4: c, 5: -s}, {2: -s, 3: -c, 4: s, 5: c}, kt=368e3, kn=368e3, mu=0.35
    )
    mass, damping = [1.02, 1.02, 1.02, 1.02, 0.102, 0.102], [8.0, 8.0, 8.0, 8.0, 0.0, 0.0]
    return bd.lumped(mass, damping, stiffness, contacts=[left, right], forces={0: 1.0},
                     load_per_preload={5: 1.0}, harmonics=1)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("preload", [1.0, 1.26])
def test_a_single_peak_beside_a_lost_branch(preload):
    """Without neighbours the peak is 23 or 29 µm.

    The closed branch through the lower bound has the same highest point.
    """
    study = wedge()
    peak = study.peak(preload)
    assert peak.status_text.startswith("incomplete: higher on the peak followed from ")
    assert np.isnan(peak.amplitude) and np.isnan(peak.half_range)
    case = study.problem.at(preload)
    search = response_curve._search(case, peak_interval(case, None), coarse_options())
    search.both_ways(peak.y)
    path = search.pieces[0].path
    response = study.problem.system(preload).response
    highest = max(abs(response(point.y[:-1])[1]) for point in path.points)
    assert path.status == "closed" and highest == pytest.approx(peak.lower_bound, rel=1e-3)
    found = bd.sweep(study, {"friction_factor": [1.0]}, bd.PeakTask(preload))
    assert found.status_text[0] == peak.status_text and np.isnan(found.array("amplitude")[0])


def test_a_curve_without_folds_costs_nothing_more():
    study = wedge()
    interval = peak_interval(study.problem.at(8.0), None)
    alone = highest_peak.found_at(study.problem, 8.0, interval)
    peak = study.peak(8.0, errors=False)
    assert peak.cost.evaluations == alone.cost.evaluations
    assert (peak.amplitude, peak.status) == (alone.amplitude, alone.ending.status)


@pytest.fixture(scope="module")
def curve():
    return pressed().optimal_curve((0.5, 5.0), 6, frequency=BAND, check=False)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, ""),
        ({"missing_ranges": (LeftOut(0.1, 0.1, NO_SOLUTION),)}, ""),
        (
            {"missing_ranges": (LeftOut(0.1, 0.3, "many folds: why"),)},
            "a path of the response curve broke off near 0.2 Hz",
        ),
        (
            {"reason": f"through; {NO_STEADY} is expected at this preload: why"},
            f"{NO_STEADY} is expected",
        ),
    ],
)
def test_doubts_of_the_curve_at_the_optimum(curve, change, said):
    best = curve.optimum.preload
    curves = tuple(replace(k, **change) if k.preload == best else k for k in curve.curves)
    assert any(k.preload == best for k in curves)
    line = printed(replace(curve, curves=curves))
    assert ("Doubt at " in line) == bool(said) and said in line


@pytest.mark.nightly
@pytest.mark.slow
def test_the_difficult_disk_loses_a_branch_at_90_newtons():
    """The search finds 40 µm at 90 and 91.9 N. The closed branch through the followed peak has the same higher maximum.

    At 85 N no steady response is expected; the peak there leads to the others nevertheless.
    """
    study = bd.Study(bd.reference_model("bladed_disk"), bd.Excitation("tip", direction="tangential"), engine_order=10,
                     friction_coefficient=0.432,
                     # preloads that lose it with the force vectors of bonded faces alone
                     contact_stiffness=bd.ResidualModes(partial_contact=False))  # fmt: skip
    found = study.optimal_curve([85.0, 90.0, 91.9], check=False, errors=False)
    assert NO_STEADY in found.status_text[0] and np.isnan(found.amplitude).all()
    assert all(FOLLOWED in text for text in found.status_text[1:])
    bounds = found.lower_bound
    assert 77e-6 < bounds[1] < 80e-6 and 70e-6 < bounds[2] < 78e-6
    alone = study.peak(91.9)
    assert np.isnan(alone.amplitude) and alone.lower_bound == pytest.approx(bounds[2], rel=0.01)
    interval = peak_interval(study.problem.at(85.0), None)
    start = highest_peak.found_at(study.problem, 85.0, interval).top.peak
    there = follow_upward(study.problem, start, 90.0)
    case = study.problem.at(90.0)
    search = response_curve._search(case, peak_interval(case, None), coarse_options())
    search.both_ways(there.y)
    amplitude = [
        abs(study.problem.system(90.0).response(p.y[:-1])[1]) for p in search.pieces[0].path.points
    ]
    # rounding decides whether the path meets its start or goes round until it has many folds
    assert search.pieces[0].path.status in ("closed", "many folds")
    assert max(amplitude) == pytest.approx(bounds[1], rel=1e-3)
