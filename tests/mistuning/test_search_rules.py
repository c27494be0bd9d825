"""Rules of the search for the highest blade, each by itself: what counts as one peak, what is promised, what is tried."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bdamper.harmonic_balance.equations import OK
from bdamper.mistuning.peak_search import WEAKER, Climbed, Search

WIDTH = 10.0


def peak(omega=100.0, blade=0, springs=(0.1,), heights=(1.0,)):
    return Climbed(SimpleNamespace(y=np.array([0.0, omega]), tangent=None), blade, springs, heights)


@pytest.mark.parametrize(
    ("other", "known"),
    [
        (peak(100.4), True),
        (peak(99.6, heights=(3.0,)), True),
        (peak(100.6), False),
        (peak(99.4), False),
        (peak(blade=1), False),
        (peak(springs=(0.1, 0.01), heights=(1.0, 1.0)), False),
    ],
)
def test_a_peak_is_known_by_blade_springs_and_frequency(other, known):
    """Within a twentieth of the width; the first of two is the one that is followed."""
    first, search = peak(), Search(None, WIDTH, (0.0, 200.0))
    assert search.different([first, other]) == ([first] if known else [first, other])
    assert search.different([other, first]) == ([other] if known else [other, first])


def test_less_is_promised_the_stronger_the_springs_are():
    """Springs of a tenth may change an amplitude by more than those of a hundredth, and those by more than none."""
    paths = [(0.1,), (0.1, 0.01), (0.1, 0.01, 0.001), (0.1, 0.01, 0.001, 0.0)]
    ways = [peak(springs=springs, heights=len(springs) * (2.0,)) for springs in paths]
    errors, below = [way.error for way in ways], [way.below for way in ways[:-1]]
    assert errors == sorted(errors, reverse=True) and len(set(errors)) == 4 and errors[-1] == 0.0
    assert below == sorted(below, reverse=True) and below[0] > below[1] > 0.0
    assert [way.highest for way in ways] == [2.0 * (1.0 + error) for error in errors]
    assert [way.final for way in ways] == [False, False, False, True] and replace(
        ways[0], last=True
    ).final


def test_what_springs_have_changed_already_may_come_again():
    """From 2 to 1 by weaker springs, so that a last step may double it, or halve it, too."""
    fallen, risen = (
        peak(springs=(0.1, 0.01), heights=heights) for heights in ((2.0, 1.0), (1.0, 2.0))
    )
    assert (fallen.error, fallen.highest, risen.error, risen.highest) == (1.0, 2.0, 0.5, 3.0)


@pytest.mark.parametrize(
    ("reached", "asked"),
    [(("next",), 1), (("nearer",), 2), ((), 2)],
)
def test_springs_that_lose_a_peak_are_weakened_by_less(monkeypatch, reached, asked):
    """From where it stands, along its curve; it keeps all that springs have changed, and is the last if all lose it."""
    tried, before = [], peak(omega=120.0, heights=(1.5,))

    def climb(_, y, blade, springs, tangent=None):
        tried.append(springs)
        assert springs < 0.1, "weaker ones than before"
        way = "next" if springs == WEAKER[1] else "nearer" if springs > WEAKER[1] else ""
        assert y is before.at.y and blade == before.blade and tangent is before.at.tangent
        return peak(omega=121.0, springs=(springs,), heights=(1.4,)) if way in reached else None

    before = replace(before, at=SimpleNamespace(y=before.at.y, tangent=np.array([0.0, 1.0])))
    monkeypatch.setattr(Search, "climb", climb)
    found = Search(None, WIDTH, (0.0, 200.0)).weakened(before)
    assert len(tried) == asked and found.last == (not reached)
    if reached:
        assert (
            found.springs == (0.1, tried[-1])
            and found.heights == (1.5, 1.4)
            and found.at.y[-1] == 121.0
        )
    else:
        assert (found.at, found.springs, found.heights) == (
            before.at,
            before.springs,
            before.heights,
        )


def heights(*rows):
    """A search on blades whose responses are these at each frequency, and what it has swept, None in gaps."""
    structure = SimpleNamespace(
        shape=(len(rows[0]),), responses=lambda u: np.array([[0.0, h] for h in u])
    )
    swept = [None if row is None else np.array([*row, k]) for k, row in enumerate(rows)]
    return Search(SimpleNamespace(structure=structure), WIDTH, (0.0, 200.0)), swept


def test_climbs_begin_at_the_highest_maxima_of_single_blades():
    """Beside a gap a blade may have its maximum within it; two blades may have theirs at one frequency."""
    search, swept = heights(
        (1.0, 0.2), (3.0, 0.1), (2.0, 0.5), None, (2.5, 0.9), (0.5, 4.0), (0.6, 0.3)
    )
    found = [(int(y[-1]), blade) for y, blade in search.candidates(swept, 100)]
    assert found == [(5, 1), (1, 0), (4, 0), (6, 0), (2, 1), (0, 1)]
    assert [(int(y[-1]), blade) for y, blade in search.candidates(swept, 3)] == found[:3]


def test_a_flat_maximum_is_one():
    search, swept = heights((1.0, 1.0), (2.0, 2.0), (2.0, 1.5), (1.0, 1.0))
    assert [(int(y[-1]), blade) for y, blade in search.candidates(swept, 100)] in (
        [(1, 0), (1, 1)],
        [(1, 1), (1, 0)],
    )


@pytest.mark.parametrize("lost", [(), (1,), (0, 2)])
def test_a_sweep_goes_on_from_the_last_solution_or_from_rest(monkeypatch, lost):
    """Where both fail there is a gap, and the next frequency is tried from before it."""
    rest, starts = np.zeros(1), []

    def solve(y, *arguments, **options):
        starts.append(tuple(y))
        return SimpleNamespace(
            status="lost" if y[-1] in lost else OK, y=np.array([y[-1] + 10.0, y[-1]])
        )

    structure = SimpleNamespace(at_rest=rest, units_about=lambda y, width: np.ones(2))
    search = Search(SimpleNamespace(structure=structure, solve=solve), WIDTH, (0.0, 200.0))
    monkeypatch.setattr(Search, "held", lambda self, springs: self.system)
    found = search.sweep(np.arange(4.0))
    assert [y is None for y in found] == [k in lost for k in range(4)]
    expected, last = [], 0.0
    for k in range(4):
        expected += [(last, k), (0.0, k)] if k in lost else [(last, k)]
        last = last if k in lost else k + 10.0
    assert starts == expected
