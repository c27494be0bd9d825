"""The least of a function with slopes that is costly, in closed form: smooth, with a crossing, with jumps, with gaps."""

import numpy as np
import pytest

from bdamper.response import scalar_search as search
from bdamper.response.scalar_search import GAIN, Sample, find_minimum, lower_bound, on_one_branch

GRID = np.arange(-3.0, 5.0)


@pytest.fixture(autouse=True)
def units(monkeypatch):
    """Places of these functions are one apart; half of it is what a fifth of the preload is."""
    monkeypatch.setattr(search, "MAX_DISTANCE", 1.5)


class Function:
    """A function of x as the highest of branches, each on an interval, with the slope of the highest by differences."""

    def __init__(self, *branches):
        self.branches = [b if isinstance(b, tuple) else (b, -np.inf, np.inf) for b in branches]
        self.asked, self.settled = [], 0

    def place(self, x):
        on = [b for b, low, high in self.branches if low <= x <= high]
        if not on:
            return Sample(x, np.inf)
        top, h = max(on, key=lambda b: b(x)), 1e-6
        return Sample(x, float(top(x)), float(top(x + h) - top(x - h)) / (2.0 * h))

    def ask(self, places):
        self.asked += places
        return [self.place(x) for x in places]

    def settle(self, a, b, x):
        """The minimum of the branch that is the highest at both."""
        self.settled += 1
        fine = np.linspace(a.x, b.x, 20001)
        height = [self.place(p).value for p in fine]
        return float(fine[int(np.argmin(height))])

    def least(self, grid=GRID):
        places, best = find_minimum([self.place(x) for x in grid], self.ask, self.settle)
        return places[best.index], best


def valley(x):
    """Least at x = 0.4."""
    return 0.5 * (x - 0.4) ** 2


def two_wells(x):
    """Least, -0.1, near x = 2.5 between two points of the grid; 0.1 near x = -0.7, where the lowest of them is."""
    u = (x - 0.9) / 1.6
    return 2.0 * (u**2 - 1.0) ** 2 - 0.1 * u


def test_least_value_of_one_branch():
    f = Function(valley)
    place, best = f.least()
    assert (best.kind, best.open) == ("smooth", None) and place.x == pytest.approx(0.4, abs=1e-3)
    assert len(f.asked) == f.settled == 1


def test_a_branch_that_is_not_followed_is_found_by_its_values():
    """Without its minimum settled each place leads nearer to it, by the cubic."""
    f = Function(lambda x: valley(x) + 0.05 * (x - 0.4) ** 3)
    f.settle = lambda a, b, x: None
    place, _ = f.least()
    assert place.value < GAIN and len(f.asked) <= 4


def test_where_two_branches_cross():
    f = Function(lambda x: 0.3 * (x + 1.3), lambda x: -0.7 * (x + 1.3))
    place, best = f.least()
    assert (
        best.kind == "crossing" and place.x == pytest.approx(-1.3, abs=1e-2) and place.value < GAIN
    )


@pytest.mark.slow
def test_the_end_of_a_higher_branch_is_closed_in_on():
    """Above x = 0.37 the branch that falls is gone, and a lower one rises: the least is the limit from above."""
    f = Function((lambda x: 1.0 - 0.2 * x, -np.inf, 0.37), lambda x: 0.1 + 0.4 * x)
    place, best = f.least()
    assert best.kind == "jump" and best.open is None
    assert 0.37 < place.x < 0.37 + 2.0 * GAIN / 0.4 and best.uncertainty < 0.02
    g = Function((lambda x: 1.0 + 0.4 * x, 0.37, np.inf), lambda x: 0.5 - 0.2 * x)
    place, best = g.least()
    assert best.kind == "jump" and 0.36 < place.x < 0.37


def test_a_lower_value_between_others_that_are_higher_is_found():
    assert GRID[np.argmin(two_wells(GRID))] < 0.0
    place, best = Function(two_wells).least()
    assert best.kind == "smooth" and place.x > 2.0 and place.value == pytest.approx(-0.1, abs=1e-3)


def test_a_settled_minimum_that_another_branch_exceeds_is_not_the_least():
    """A hill that no known place has seen stands on the minimum of the valley: the curve there says so."""
    f = Function(valley, (lambda x: 0.03 + 0.01 * x, 0.25, 0.6))
    f.settle = lambda a, b, x: 0.4
    place, best = f.least()
    assert best.kind != "smooth" and place.value < 0.04
    assert 0.4 in f.asked


def test_what_is_left_open_is_told(monkeypatch):
    monkeypatch.setattr(search, "MAX_EVALUATIONS", 0)
    _, best = Function(two_wells).least()
    assert best.open == (2.0, 3.0)


def test_ends_and_gaps_are_named():
    assert Function(lambda x: x).least()[1].kind == "end"
    assert Function(lambda x: -x).least()[1].kind == "end"
    f = Function((lambda x: x, -1.53, np.inf))
    place, best = f.least()
    assert (
        -1.53 <= place.x < -1.53 + search.CORNER
        and best.kind == "unknown"
        and best.uncertainty <= search.CORNER
    )
    assert len(f.asked) == 6  # halved as often as needed
    place, best = Function(
        (lambda x: -x, -np.inf, 1.3), (lambda x: 0.0 * x + 2.0, 1.3, np.inf)
    ).least()
    assert 1.3 - search.CORNER < place.x <= 1.3
    uphill = Function((lambda x: -x, -1.5, np.inf))
    assert (
        uphill.least()[1].kind == "end" and not uphill.asked
    )  # nothing lower lies toward what is not known
    flat = [Sample(0.0, 1.0), Sample(1.0, 0.0), Sample(2.0, 1.0)]  # corners, which have no slope
    _, best = find_minimum(flat, lambda places: [], lambda *_: None)
    assert best.kind == "unknown" and best.uncertainty == 1.0


def test_tangents_agree_along_one_branch_alone():
    f = Function(valley)
    assert all(on_one_branch(f.place(x), f.place(x + 1.0)) for x in GRID)
    assert not on_one_branch(Sample(0.0, 1.0, -0.1), Sample(1.0, 0.5, -0.1))
    assert lower_bound(Sample(0.0, 0.0, 1.0), Sample(1.0, 1.0, 1.0)) is None
    assert lower_bound(Sample(0.0, 0.0, 1.0), Sample(1.0, np.inf)) is None
    for corner in (
        (Sample(0.0, 0.0), Sample(1.0, np.inf)),
        (Sample(0.0, np.inf), Sample(1.0, 0.0)),
    ):
        assert lower_bound(*corner).value < -GAIN  # without a slope it may fall


def test_tangents_of_places_far_apart_prove_nothing(monkeypatch):
    """They agree, or meet above the least value: in between the function may be lower all the same."""
    a, b = Sample(0.0, 0.0, -1.0), Sample(2.0, 0.0, 1.0)
    assert lower_bound(a, Sample(1.0, 0.0, 1.0)).smooth and not lower_bound(a, b).smooth
    assert lower_bound(a, b)[:2] == (-2.0, 1.0)
    monkeypatch.setattr(search, "MAX_DISTANCE", 3.0)
    assert lower_bound(a, b).smooth


@pytest.mark.parametrize("corner", [0.43, 1.9])
def test_places_without_a_slope_are_enclosed_by_halving(corner):
    """Near a corner there is no slope that would lead to it; the places known are 0.1 higher, and more."""
    f = Function(lambda x: abs(x - corner))
    with_slope = f.place
    f.place = lambda x: (
        with_slope(x)._replace(slope=np.nan) if abs(x - corner) < 0.6 else with_slope(x)
    )
    place, best = f.least()
    assert (
        abs(place.x - corner) <= search.CORNER
        and best.kind == "crossing"
        and best.uncertainty <= search.CORNER
    )
    assert len(f.asked) <= search.MAX_EVALUATIONS
