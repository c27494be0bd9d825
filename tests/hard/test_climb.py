"""Solutions by way of fewer harmonics: the equations on the way, and which paths are followed when."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper import _core
from bdamper.balance.system import OK, Correction
from bdamper.continuation import climb, start
from bdamper.continuation import track as tracking
from bdamper.continuation.climb import HELD, Ladder
from bdamper.continuation.curve import crossings
from bdamper.continuation.follower import ContinuationOptions, Path, PathPoint
from bdamper.continuation.search import EVERY_VISIT
from bdamper.continuation.start import LOOSE_TURN, Aids, first_point
from bdamper.continuation.track import find_start
from bdamper.util.cost import Cost, CostMeter
from tests.hard.test_branches import study

OMEGA = 2.0 * np.pi * 300.0


@pytest.mark.parametrize(
    "settings", [{}, {"evaluation": bd.Sampled(64)}, {"friction_axes": "major", "major_frequency": 300.0}]
)
def test_first_harmonics_of_a_system_are_those_of_a_study_with_fewer(settings):
    few, many = (study(harmonics=n, **settings).system(200.0) for n in (2, 4))
    cut = many.with_harmonics(2)
    u = 1e-5 * np.random.default_rng(1).normal(size=few.n_unknowns)
    for ours, theirs in zip(cut.evaluate(u, OMEGA), few.evaluate(u, OMEGA)):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())
    np.testing.assert_array_equal(cut.row_scale, few.row_scale)
    np.testing.assert_allclose(cut.response(u[None]), few.response(u[None]), rtol=1e-14)
    springs = np.random.default_rng(2).uniform(0.0, 1e6, size=(few.n_points, 3))
    np.testing.assert_allclose(cut.linear_response(OMEGA, springs), few.linear_response(OMEGA, springs), rtol=1e-12)


def test_support_is_drag_and_mass_of_the_highest_harmonic():
    system, part, drag, mass = study(harmonics=3).system(200.0), 0.25, 0.7, 0.2
    held = system.letting_in(OMEGA, drag, mass)
    share = 1.0 / part - 1.0
    top = slice(sum(system.n_mode[:3]), None)
    arrays = {name: np.array(value) for name, value in system.arrays.items()}
    arrays["damping"][top] += share * drag * 3.0 * OMEGA
    above = arrays["stiffness"][top] > (3.0 * OMEGA) ** 2
    assert above.any()
    assert not above.all()
    arrays["mass"][top] += np.where(above, 0.0, share * mass)
    arrays["stiffness"][top] += np.where(above, share * mass * (3.0 * OMEGA) ** 2, 0.0)
    other = _core.System(**arrays)
    n = system.n_unknowns
    y = np.append(1e-5 * np.random.default_rng(0).normal(size=n), part)
    r, J = np.empty(n), np.empty((n, n))
    assert other.evaluate(y[:-1], OMEGA, r, J) == OK
    got, by_part = held.derivatives(y)
    np.testing.assert_allclose(got, J, rtol=0, atol=1e-12 * np.abs(J).max())
    support = (J - system.evaluate(y[:-1], OMEGA)[1]) / share
    h = 1e-6
    slope = (1.0 / (part + h) - 1.0 / (part - h)) / (2.0 * h) * support @ y[:-1]
    np.testing.assert_allclose(by_part, slope, rtol=0, atol=1e-6 * np.abs(slope).max())


def test_several_harmonics_are_held_like_each_of_them():
    system, drag, mass = study(harmonics=3).system(200.0), 0.7, 0.2
    y = np.append(1e-5 * np.random.default_rng(0).normal(size=system.n_unknowns), 0.25)

    def support(many, first=None):
        return many.letting_in(OMEGA, drag, mass, first).derivatives(y[-many.n_unknowns - 1 :])[0]

    few = system.with_harmonics(2)
    m = few.n_unknowns
    u = y[:m]
    second = few.letting_in(OMEGA, drag, mass).derivatives(np.append(u, 0.25))[0] - few.evaluate(u, OMEGA)[1]
    third = support(system) - system.evaluate(y[:-1], OMEGA)[1]
    both = support(system, 2) - system.evaluate(y[:-1], OMEGA)[1]
    third[:m, :m] += second
    np.testing.assert_allclose(both, third, rtol=0, atol=1e-9 * np.abs(third).max())
    assert np.abs(second).max() > 0.0


def test_harmonics_that_a_guess_lacks_are_let_in_at_once(monkeypatch):
    """Where Newton does not lead from a guess to a solution; one that lacks none is left."""
    s, preload = study(harmonics=3), 200.0
    system = s.system(preload)
    known, _ = find_start(study(harmonics=1), preload, OMEGA, ContinuationOptions(), CostMeter(0.0))
    guess = np.zeros(system.n_unknowns)
    guess[: len(known) - 1] = known[:-1]
    correct_at, letting_in, held = start.HarmonicSystem.correct_at, start.HarmonicSystem.letting_in, []

    def fails(self, u, omega, scale, *rest):
        c = correct_at(self, u, omega, scale, *rest)
        return c if self._parameter else replace(c, status=1)

    def watched(self, omega, drag, mass, first=None):
        held.append((omega, first))
        return letting_in(self, omega, drag, mass, first)

    monkeypatch.setattr(start.HarmonicSystem, "correct_at", fails)
    monkeypatch.setattr(start.HarmonicSystem, "letting_in", watched)

    def found(*guesses, inside=True):
        aids = Aids(lambda omega: list(guesses), completing=inside)
        return find_start(s, preload, OMEGA, ContinuationOptions(), CostMeter(0.0), aids)

    y, log = found(guess)
    assert held[0] == (OMEGA, 2) and log[-1].startswith("harmonics that a guess lacks let in at once: ")
    r, _, _ = system.evaluate(y[:-1], OMEGA)
    assert np.abs(r * system.row_scale).max() < 1e-9
    held.clear()
    _, log = found(np.ones(system.n_unknowns))
    assert not held and any("let in at once: no solution" in line for line in log)
    for _, log in (found(), found(guess, inside=False)):
        assert not any("at once" in line for line in log)


@pytest.fixture(scope="module")
def tangle():
    """A damper at 20 times the excitation that bounces, within a tangle of folds."""
    s = bd.Study(
        bd.reference_model("bladed_disk", 9),
        engine_order=5,
        harmonics=4,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )
    return s, 20.0, 2.0 * np.pi * 282.45


def ladder_of(tangle):
    s, preload, omega = tangle
    state = s.static(preload)
    options = ContinuationOptions(max_turn=LOOSE_TURN)
    ladder = Ladder(s.system(preload), omega, options, CostMeter(0.0))
    first, _, _ = first_point(ladder.systems[0], state, s.stuck_springs(state), omega, options, CostMeter(0.0))
    ladder.add(0, first[:-1])
    return ladder


@pytest.fixture(scope="module")
def climbed(tangle):
    ladder = ladder_of(tangle)
    return ladder, ladder.climb()


def test_climbs_into_a_tangle(tangle, climbed):
    s, preload, omega = tangle
    ladder, u = climbed
    r, _, _ = s.system(preload).evaluate(u, omega)
    assert np.abs(r * s.system(preload).row_scale).max() < 1e-9
    assert [len(found) > 0 for found in ladder.solutions] == [True] * 4
    for few, found in zip(ladder.systems, ladder.solutions):
        for v in found:
            assert np.abs(few.evaluate(v, omega)[0] * few.row_scale).max() < 1e-9
    assert 100 < ladder.points < 3000


def test_without_supports_there_is_no_way_up(tangle, monkeypatch):
    monkeypatch.setattr(climb, "SUPPORTS", ())
    assert ladder_of(tangle).climb() is None


class Graph:
    """Solutions and paths of a made-up ladder: a solution is its number, a path leads where the table says."""

    def __init__(self, paths):
        self.paths = paths
        self.followed = []

    def __call__(self, held, y, limits, *, options):
        rung, by = held.place
        leads, number, length = self.paths[rung, round(float(y[0])) - 1, by]
        self.followed.append((rung, round(float(y[0])) - 1, by, options.max_points))
        if length > options.max_points:
            return Path(tuple(self.point(0.0, held) for _ in range(options.max_points)), "too many points", "", 0, 0)
        status = "complete" if leads else "turned back"
        return Path(tuple(self.point(number + 1.0, held) for _ in range(length)), status, "", 0, 0)

    @staticmethod
    def point(value, held):
        y = np.full(held.n_unknowns + 1, value)
        return PathPoint(y, y, y, y[:3], 0.0, 1, 0)


class Rung:
    """As much of a system as a ladder asks for."""

    n_mean = 0
    bases = tuple(replace(b, omega2=np.ones(1)) for b in study(harmonics=3).bases)

    def __init__(self, n, place=None):
        self.n_harmonics = self.n_unknowns = n
        self.place = place

    def with_harmonics(self, n):
        return Rung(n)

    def letting_in(self, omega, drag, mass):
        return Rung(self.n_harmonics, (self.n_harmonics - 2, climb.SUPPORTS.index((drag, mass))))

    def correct_at(self, u, *_):
        return Correction(OK, np.append(u, HELD), u, 1, 0.0, 1.0, 0)


class Watch(CostMeter):
    def watch(self, system):
        pass


def made_up(monkeypatch, paths):
    monkeypatch.setattr(climb, "SUPPORTS", ((0.0, 0.0), (1.0, 1.0)))
    graph = Graph(paths)
    monkeypatch.setattr(climb, "follow", graph)
    ladder = Ladder(Rung(3), 1.0, ContinuationOptions(), Watch(0.0))
    ladder.add(0, np.ones(1))
    return ladder, graph


def test_what_comes_back_leads_on_by_another_support(monkeypatch):
    """Supports connect solutions 0 and 1, 2 and 3; 0 and 2; and 1 with one that has more harmonics."""
    ladder, graph = made_up(
        monkeypatch,
        {
            (0, 0, 0): (True, 0, 10),
            (1, 0, 0): (False, 1, 10), (1, 2, 0): (False, 3, 10),
            (1, 0, 1): (False, 2, 10), (1, 1, 1): (True, 0, 10),
        },
    )  # fmt: skip
    np.testing.assert_array_equal(ladder.climb(), np.ones(3))
    # the support by which a path came back leads back: not followed again
    assert [step[:3] for step in graph.followed] == [(0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 2, 0), (1, 1, 1)]
    assert (ladder.paths, ladder.points) == (5, 50)


def test_all_get_few_points_before_any_gets_more(monkeypatch):
    few = climb.POINTS
    ladder, graph = made_up(
        monkeypatch,
        {(0, 0, 0): (True, 0, 5 * few), (0, 0, 1): (True, 0, 2 * few), (1, 0, 0): (True, 0, few), (1, 0, 1): (False, 0, 1)},
    )
    np.testing.assert_array_equal(ladder.climb(), np.ones(3))
    assert graph.followed == [(0, 0, 0, few), (0, 0, 1, few), (0, 0, 0, 4 * few), (0, 0, 1, 4 * few), (1, 0, 0, few)]


def test_ends_after_so_many_points(monkeypatch):
    endless = {(0, 0, by): (True, 0, 10**9) for by in (0, 1)}
    ladder, graph = made_up(monkeypatch, endless)
    monkeypatch.setattr(climb, "MOST_POINTS", 5000)
    assert ladder.climb() is None
    assert 5000 <= ladder.points < 5000 + graph.followed[-1][3]


def only_long_paths(monkeypatch):
    """Newton fails, and homotopies of all harmonics are too long; with one harmonic everything is as it is."""
    correct_at, homotopy = start.HarmonicSystem.correct_at, start._homotopy

    def fails(self, u, omega, scale, *rest):
        c = correct_at(self, u, omega, scale, *rest)
        return c if self.n_harmonics == 1 or self._parameter else replace(c, status=1)

    def long(system, *rest):
        return homotopy(system, *rest) if system.n_harmonics == 1 else Path((), "too many points", "", 0, 0)

    monkeypatch.setattr(start.HarmonicSystem, "correct_at", fails)
    monkeypatch.setattr(start, "_homotopy", long)


def test_the_chain_climbs_where_paths_are_too_long(monkeypatch):
    s, preload = study(harmonics=3), 200.0
    with monkeypatch.context() as patched:
        only_long_paths(patched)
        y, log = find_start(s, preload, OMEGA, ContinuationOptions(), CostMeter(0.0), Aids(climbing=True))
        assert log[-1].startswith("harmonics let in one by one: ")
        none, log = find_start(s, preload, OMEGA, ContinuationOptions(), CostMeter(0.0))
        assert none is None
        assert not any("one by one" in line for line in log)
    curve = s.track(preload, (300.0, 301.0))
    assert curve.frequency[0] == pytest.approx(300.0)
    np.testing.assert_allclose(s.system(preload).response(y[None, :-1])[0], curve.harmonics[0], rtol=1e-6)


def test_given_up_for_a_curve_after_some_vain_climbs(monkeypatch):
    asked = []

    class Search:
        def __init__(self):
            self.log, self.options, self.meter = [], ContinuationOptions(), CostMeter(0.0)
            self.limits = (0.5, 2.0)

    class Study:
        def find_start(self, preload, omega, options, meter, aids):
            assert aids.guesses is None and aids.fewer is None
            asked.append(aids.climbing)
            return None, [f"{start.NOT_CLIMBED} (10 paths)"]

    search = Search()
    for _ in range(tracking.CLIMBS + 2):
        tracking._start(Study(), 1.0, search, 1.0)
    assert asked == [True] * tracking.CLIMBS + [False] * 2


def test_a_curve_with_one_harmonic_has_none_to_let_in(monkeypatch):
    asked = []

    def fails(study, preload, search, omega, guesses=None, fewer=None, visits=None):
        search.log.append("nothing found")
        if visits is not None:  # within a gap
            asked.append(fewer is not None)

    monkeypatch.setattr(tracking, "_start", fails)
    for harmonics in (1, 2):
        curve = study(harmonics=harmonics).track(200.0, (300.0, 301.0), options=ContinuationOptions(searches=1))
        assert curve.status == "no start"
    assert asked == [False, True]


@pytest.mark.parametrize("to_let_in", [True, False])
def test_each_visit_of_a_gap_has_long_ways_of_its_own(to_let_in):
    """Those of a wide gap and of an end are all of them; where no harmonic is left to be let in, the others come sooner."""
    asked = []

    class Study:
        def find_start(self, preload, omega, options, meter, aids):
            assert aids.completing == (omega == 1.0)
            asked.append((list(aids.longer), aids.fewer is not None, aids.climbing))
            return None, []

    search = SimpleNamespace(log=[], options=None, meter=None, limits=(0.5, 2.0))
    fewer = (lambda omega: []) if to_let_in else None
    tracking._start(Study(), 1.0, search, 0.5, None, fewer)
    tracking._start(Study(), 1.0, search, 2.0, None, fewer)
    for visits in (EVERY_VISIT, *(frozenset((visit,)) for visit in sorted(EVERY_VISIT))):
        tracking._start(Study(), 1.0, search, 1.0, None, fewer, visits)
    rest = [by for by in start.SUPPORTS if by not in start.PROMISING]
    assert 0 < len(rest) < len(start.SUPPORTS)
    first, everything = (list(start.PROMISING), False, False), (list(start.SUPPORTS), to_let_in, True)
    later = [([], True, False), (rest, False, True)] if to_let_in else [(rest, False, False), ([], False, True)]
    assert asked == [everything] * 3 + [first, *later]


def test_letting_the_highest_harmonic_in_is_given_up_for_a_curve_after_some_vain_attempts():
    asked = []

    class Study:
        def find_start(self, preload, omega, options, meter, aids):
            asked.append((aids.fewer is not None, len(aids.longer)))
            return None, [f"{start.NOT_LET_IN} (10 paths)"]

    search = SimpleNamespace(log=[], options=None, meter=None, limits=(0.5, 2.0))
    for _ in range(tracking.LETTINGS_IN + 2):
        tracking._start(Study(), 1.0, search, 1.0, None, lambda omega: [], frozenset((tracking.VISIT_FEWER,)))
    rest = len(start.SUPPORTS) - len(start.PROMISING)
    assert asked == [(True, 0)] * tracking.LETTINGS_IN + [(False, rest)] * 2


def test_the_highest_harmonic_is_let_in_from_solutions_without_it(tangle, climbed, monkeypatch):
    s, preload, omega = tangle
    known = climbed[0].solutions[2]
    noise = 1.0 + 1e-4 * np.random.default_rng(0).normal(size=len(known[0]))
    options, system = ContinuationOptions(), s.system(preload)
    log = []
    y = start._let_in(system, [noise * u for u in known], omega, options, CostMeter(0.0), log)
    r, _, _ = system.evaluate(y[:-1], omega)
    assert y[-1] == omega and np.abs(r * system.row_scale).max() < 1e-9
    assert log[0].startswith("highest harmonic let in: ") and f"from {len(known)} solutions" in log[0]
    assert start._let_in(system, [], omega, options, CostMeter(0.0), log) is None
    monkeypatch.setattr(climb, "SUPPORTS", ())
    assert start._let_in(system, known, omega, options, CostMeter(0.0), log) is None
    assert len(log) == 2 and log[1].startswith(start.NOT_LET_IN)


def test_the_chain_asks_for_solutions_without_the_highest_harmonic_where_paths_are_too_long(monkeypatch):
    s, preload = study(harmonics=3), 200.0
    few = s.with_(harmonics=s.harmonic_numbers[:-1])
    assert few.harmonic_numbers == (1, 2) and few.model is s.model
    known, _ = find_start(few, preload, OMEGA, ContinuationOptions(), CostMeter(0.0))
    asked = []

    def fewer(omega):
        asked.append(omega)
        return [known[:-1]]

    y, _ = find_start(s, preload, OMEGA, ContinuationOptions(), CostMeter(0.0), Aids(fewer=fewer))
    assert y is not None and not asked  # Newton leads to a solution
    correct_at = start.HarmonicSystem.correct_at

    def fails(self, u, omega, scale, *rest):
        c = correct_at(self, u, omega, scale, *rest)
        return c if self.n_harmonics == 2 or self._parameter else replace(c, status=1)

    with monkeypatch.context() as patched:
        patched.setattr(start.HarmonicSystem, "correct_at", fails)
        patched.setattr(start, "_homotopy", lambda *_: Path((), "too many points", "", 0, 0))
        y, log = find_start(s, preload, OMEGA, ContinuationOptions(), CostMeter(0.0), Aids(fewer=fewer))
    assert asked == [OMEGA] and log[-1].startswith("highest harmonic let in: ")
    r, _, _ = s.system(preload).evaluate(y[:-1], OMEGA)
    assert np.abs(r * s.system(preload).row_scale).max() < 1e-9


def test_branches_that_pass_a_frequency():
    curve = SimpleNamespace(
        frequency=np.array([1.0, 2.0, 3.0, 2.0, 2.0, 1.0, 3.0]),
        branch=np.array([0, 0, 0, 0, 0, 1, 1]),
    )
    found = crossings(curve, 2.0 * np.pi * 2.5)
    assert [i for i, _ in found] == [1, 2, 5] and [t for _, t in found] == pytest.approx([0.5, 0.5, 0.75])
    assert not crossings(curve, 2.0 * np.pi * 3.5)
    # a point that lies there counts once, also at an end of a branch
    assert [i for i, _ in crossings(curve, 2.0 * np.pi * 1.0)] == [0, 5]
    assert [(i, t) for i, t in crossings(curve, 2.0 * np.pi * 3.0)] == [(2, 0.0), (5, 1.0)]


def test_the_curve_with_one_harmonic_fewer_is_followed_once_and_counts(monkeypatch):
    s, followed = study(harmonics=2), []

    def track(few, preload, frequency, *, from_high, options, progress, ratios):
        followed.append((few.harmonic_numbers, preload, frequency, options.locate))
        return SimpleNamespace(
            frequency=np.array([1.0, 2.0]), unknowns=np.array([[1.0], [2.0]]), branch=np.zeros(2, int),
            cost=Cost(seconds=1.0, iterations=7), status=status,
        )  # fmt: skip

    monkeypatch.setattr(tracking, "track_curve", track)
    status, meter = "incomplete", CostMeter(0.0)
    fewer = tracking._Fewer(s, 50.0, (1.0, 2.0), ContinuationOptions(), meter)
    assert not followed
    np.testing.assert_allclose(fewer(2.0 * np.pi * 1.25), [[1.25]])
    np.testing.assert_allclose(fewer(2.0 * np.pi * 1.5), [[1.5]])
    assert followed == [((1,), 50.0, (1.0, 2.0), False)] and [c.iterations for c in meter.parts] == [7]
    status = "interrupted"
    with pytest.raises(KeyboardInterrupt):
        tracking._Fewer(s, 50.0, (1.0, 2.0), ContinuationOptions(), meter)(7.0)
