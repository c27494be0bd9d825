"""The dual-weighted indicator, the embedding it rests on, and the results that carry it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.continuation.coverage import LeftOut
from bdamper.continuation.curve import crossings
from bdamper.continuation.start import Aids
from bdamper.effects import adaptive
from bdamper.effects.adaptive import LostError, LostPeakError, On, Search, adaptive_peak, surely
from bdamper.effects.advice import fullest, judged
from bdamper.effects.indicator import Estimate, embed, estimate_change, highest_peaks
from bdamper.effects.rivals import NEAR, Place, Rival, excited, point_between, rivals, summits, superharmonics
from bdamper.peaks.carryover import BOTH_WAYS, STAYS_UP, higher_nearby
from bdamper.peaks.newton import coarse_options, find_peak
from tests import models

INTERVAL = (720.0, 880.0)


@pytest.fixture(scope="module")
def full():
    model = models.wedge_model(1, n_points=6, harmonics=5)
    return bd.Study(
        model, bd.Excitation("tip"), engine_order=2, friction_coefficient=0.4, harmonics=3, damper_modes=1, blade_modes=4
    )


def peak_of(study, preload):
    curve = study.track(preload, INTERVAL, options=coarse_options())
    return highest_peaks(study.system(preload), curve)[0]


@pytest.fixture(scope="module")
def peak(full):
    return peak_of(full, 40.0)


def test_estimate_is_the_derivative_of_the_peak(full, peak):
    """A small force in addition: the estimated peak differs from the true one by the square of it."""
    rng = np.random.default_rng(0)
    system = full.system(40.0)
    direction = rng.standard_normal(system.n_unknowns) * np.abs(system.force).max()
    direction[: system.n_mean] = 0.0
    error, defect = [], []
    for size in (4e-4, 2e-4, 1e-4):
        other = system.with_force(system.force + size * direction)
        e = estimate_change(other, peak.y)
        true = find_peak(other, peak.y)
        assert true.converged
        change = true.amplitude / peak.amplitude - 1.0
        assert abs(change) > 1e-5
        error.append(abs(e.amplitude - change))
        defect.append(e.defect)
        assert e.amplitude == pytest.approx(change, rel=0.1)
    assert error[0] / error[1] > 3.0 and error[1] / error[2] > 3.0
    # the second residual tells a good part of what is missing; the rest is the phase that the peak need not keep
    assert all(0.1 < d / m < 10.0 for d, m in zip(defect, error)), (defect, error)


def test_a_solution_of_the_system_itself_has_no_change(full, peak):
    e = estimate_change(full.system(40.0), peak.y)
    assert e.size < 1e-7 and e.reliability(0.01) == "small"


def test_shares_of_the_harmonics_make_up_the_estimate(full):
    cheap = full.with_effects(replace(bd.Effects.of(full), harmonics=1))
    p = peak_of(cheap, 40.0)
    e = estimate_change(full.system(40.0), embed(cheap, full, 40.0, p.y))
    assert abs(e.amplitude) > 1e-3
    assert e.shares.sum() == pytest.approx(e.amplitude, rel=1e-6)
    # the equations of the cheap system are solved: only those of the new harmonics contribute
    assert np.abs(e.shares[:2]).max() < 1e-6 and np.abs(e.shares[2:]).max() > 1e-4


@pytest.mark.parametrize(
    "changes",
    [
        {"harmonics": 1}, {"rotation": ("X", "Z")}, {"damper_modes": 0}, {"blade_modes": 2}, {"bias": False},
        {"contact_points": 3},
    ],
    ids=str,
)
def test_embedding_keeps_what_both_have(full, changes):
    cheap = full.with_effects(replace(bd.Effects.of(full), **changes))
    a, b = cheap.system(40.0), full.system(40.0)
    rng = np.random.default_rng(1)
    y = np.append(1e-6 * rng.standard_normal(a.n_unknowns), 5000.0)
    z = embed(cheap, full, 40.0, y)
    assert z[-1] == 5000.0
    for l in range(1, a.n_harmonics + 1):
        old = dict(zip(a.bases[l].coordinates, a.amplitudes(y[:-1], l)))
        new = dict(zip(b.bases[l].coordinates, b.amplitudes(z[:-1], l)))
        assert {c: new[c] for c in old} == old
        assert all(value == 0.0 for c, value in new.items() if c not in old)
    mean = z[: b.n_mean] - full.static(40.0).q
    if a.n_mean:
        moved = dict(zip(a.bases[0].coordinates, y[: a.n_mean] - cheap.static(40.0).q))
        np.testing.assert_allclose(mean, [moved.get(c, 0.0) for c in b.bases[0].coordinates], atol=1e-18)
    else:
        np.testing.assert_array_equal(mean, 0.0)


@pytest.mark.parametrize(
    ("amplitude", "defect", "expected"),
    [
        (0.002, 0.001, "small"),
        (0.002, 0.009, "must be on"),
        (0.05, 0.01, "significant"),
        (0.05, 0.03, "must be on"),
        (0.2, 0.0, "must be on"),
        (np.nan, 0.0, "must be on"),
    ],
)
def test_reliability(amplitude, defect, expected):
    assert Estimate(amplitude, 0.0, defect, *np.zeros((3, 1))).reliability(0.01) == expected


def synthetic(full, amplitude, branch=None, kind=None, frequency=None):
    """A curve of the study with given amplitudes."""
    n = len(amplitude)
    curve = full.track(1e3, INTERVAL)
    at = np.arange(n)
    harmonics = np.zeros((n, 2), complex)
    harmonics[:, 1] = amplitude
    return replace(
        curve,
        harmonics=harmonics,
        frequency=np.linspace(*INTERVAL, n) if frequency is None else np.array(frequency, float),
        unknowns=np.tile(at[:, None] * 1.0, (1, 3)),
        branch=np.zeros(n, int) if branch is None else np.array(branch),
        point_kind=("regular",) * n if kind is None else kind,
        shares=np.tile([1.0, 0.0, 0.0], (n, 1)),
    )


NOTHING = (0.0, 0.0, 0.0)


def rivals_of(full, amplitude, changes, maxima):
    """Rivals on a synthetic curve; estimates by index, those of maxima too."""
    curve = synthetic(full, amplitude)

    def ask(y):
        return Estimate(*changes.get(int(y[0]), NOTHING), y, *np.zeros((2, 2)))

    def place(i):
        y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
        return Place(y, float(curve.frequency[i]), amplitude[i], ask(y))

    peaks = [find_peak_like(place(i)) for i in maxima]
    out = rivals(curve, peaks, ask, place(maxima[0]), 0.01)
    return [(int(r.place.y[0]), round(r.may_miss, 3), round(r.misses, 3)) for r in out]


def find_peak_like(place):
    return SimpleNamespace(y=place.y, frequency=place.frequency, amplitude=place.amplitude)


def test_superharmonic_resonances_have_the_frequency_width_and_height_of_the_linear_response(full):
    """Half of the power at the half-width, at fractions of the frequency, for harmonics that the cheap system lacks."""
    cheap = full.with_effects(replace(bd.Effects.of(full), harmonics=1))
    rich = full.system(40.0)
    springs = full._stuck_springs(full.static(40.0))
    found = list(superharmonics(cheap.system(40.0), rich, (springs,), 100.0, 1e5))
    assert {r.harmonic for r in found} == {2, 3} and not list(superharmonics(rich, rich, (springs,), 100.0, 1e5))
    for l, omega, half_width, mode in found:

        def height(w, l=l, mode=mode):
            return np.linalg.norm(np.linalg.solve(rich.linear_matrix(w, springs, l), rich.bases[l].mass * mode))

        top = height(omega)
        assert height(omega - half_width) == pytest.approx(top / np.sqrt(2.0), rel=0.05)
        assert height(omega + half_width) == pytest.approx(top / np.sqrt(2.0), rel=0.05)
    r = found[0]
    y = np.zeros(rich.n_unknowns + 1)
    y[: rich.n_mean], y[-1] = full.static(40.0).q, r.omega
    y[rich.slices(1)[0]] = 1e-9  # all sticks: nothing excites the second harmonic but what is put there
    assert excited(rich, y, r) < 1e-6
    force = np.zeros(rich.n_unknowns)
    force[rich.slices(r.harmonic)[0]] = rich.bases[r.harmonic].mass * r.mode.real
    force[rich.slices(r.harmonic)[1]] = -rich.bases[r.harmonic].mass * r.mode.imag
    q = np.linalg.solve(rich.linear_matrix(r.omega, springs, r.harmonic), rich.bases[r.harmonic].mass * r.mode)
    expected = np.abs(rich.bases[r.harmonic].G @ q).max() / np.abs(rich.bases[1].G @ rich.amplitudes(y[:-1], 1)).max()
    assert excited(rich.with_force(rich.force + force), y, r) == pytest.approx(expected, rel=0.05)


def test_a_curve_is_interpolated_on_its_highest_part(full):
    curve = synthetic(full, [0.5, 1.0, 0.6, 0.9, 0.4], branch=[0, 0, 0, 1, 1])
    f = 2.0 * np.pi * curve.frequency
    y = point_between(curve, 0.25 * f[0] + 0.75 * f[1])
    assert y == pytest.approx(np.append(0.25 * curve.unknowns[0] + 0.75 * curve.unknowns[1], 0.25 * f[0] + 0.75 * f[1]))
    assert point_between(curve, 0.5 * (f[2] + f[3])) is None  # no part of a branch passes
    assert point_between(curve, 2.0 * f[-1]) is None


def test_another_maximum_may_overtake_by_the_most_it_can_have(full):
    two = [0.5, 1.0, 0.5, 0.5, 0.95, 0.5]
    assert rivals_of(full, two, {}, [1, 4]) == []
    assert rivals_of(full, two, {4: (0.04, 0.0, 0.0)}, [1, 4]) == []
    found = rivals_of(full, two, {4: (0.04, 0.0, 0.02)}, [1, 4])
    # the peak moves from 752 to 848 Hz
    assert found == [(4, round(848.0 / 752.0 - 1.0, 3), round(848.0 / 752.0 - 1.0, 3))]
    assert rivals_of(full, two, {1: (-0.03, 0.0, 0.03)}, [1, 4])[0][0] == 4  # the least of the peak counts
    assert np.isinf(rivals_of(full, two, {4: (np.nan, np.nan, np.inf)}, [1, 4])[0][1])
    assert rivals_of(full, [0.5, 1.0, 0.5, 0.5, 0.65, 0.5], {4: (np.nan, np.nan, np.inf)}, [1, 4]) == []  # not near the top


def test_points_near_the_top_may_overtake_beyond_the_tolerance(full):
    hill = [0.5, 0.98, 1.0, 0.98, 0.5]
    assert rivals_of(full, hill, {1: (0.025, 0.0, 0.0)}, [2]) == []
    found = rivals_of(full, hill, {1: (0.05, 0.0, 0.0)}, [2])
    assert [f[0] for f in found] == [1] and found[0][1] == found[0][2] > 0.029
    # an estimate that cannot be relied on tells how much may be missed, not how much is
    ((where, may, does),) = rivals_of(full, hill, {1: (0.05, 0.0, 0.04)}, [2])
    assert where == 1 and may > 0.067 and does == 0.0
    raised = dict.fromkeys(range(5), (0.05, 0.0, 0.0))
    assert rivals_of(full, hill, raised, [2]) == []  # all by the same: the estimate of the peak says it


def test_a_rise_beyond_the_peak_may_become_a_maximum_if_its_order_may_change(full):
    rising = [0.5, 1.0, 0.8, 0.9, 1.1, 1.2]
    assert rivals_of(full, rising, {}, [1]) == []
    assert rivals_of(full, rising, {4: (0.05, 0.0, 0.0), 5: (0.05, 0.0, 0.0)}, [1]) == []
    assert [f[0] for f in rivals_of(full, rising, {5: (0.0, 0.0, 0.1)}, [1])] == [4]
    falling = [1.2, 1.1, 0.9, 0.8, 1.0, 0.5]
    assert [f[0] for f in rivals_of(full, falling, {0: (0.0, 0.0, 0.1)}, [4])] == [1]
    # a summit that was no maximum, since the mean position walks there
    summit = [0.5, 1.0, 0.8, 1.2, 1.2, 0.9]
    assert rivals_of(full, summit, {}, [1]) == []
    assert 3 in [f[0] for f in rivals_of(full, summit, {3: (0.001, 0.0, 0.0)}, [1])]


@pytest.mark.parametrize(
    ("estimate", "others", "expected"),
    [
        ((0.002, 0.0, 0.001), [], (0.001, "small", "")),
        ((0.002, 0.0, 0.001), [(0.005, 0.005)], (0.005, "small", "may be higher at 740 Hz")),
        ((0.002, 0.0, 0.001), [(0.02, 0.0), (0.003, 0.0)], (0.02, "must be on", "may be higher at 740 Hz")),
        ((0.05, 0.0, 0.01), [(0.3, 0.0)], (0.3, "significant", "may be higher at 740 Hz")),
        ((0.05, 0.0, 0.01), [(0.3, 0.2)], (0.3, "must be on", "may be higher at 740 Hz")),
        ((0.05, 0.0, 0.01), [(0.3, 0.0), (np.inf, np.inf)], (np.inf, "must be on", "may be higher at 741 Hz")),
        ((0.05, 0.0, 0.01), [(0.005, 0.005)], (0.01, "significant", "")),
    ],
)
def test_a_change_is_small_only_if_no_other_place_may_make_it_larger(estimate, others, expected):
    places = [Place(np.zeros(1), 740.0 + i, 1.0, Estimate(*estimate, *np.zeros((3, 1)))) for i in range(len(others))]
    rivals_found = [Rival(place, *misses) for place, misses in zip(places, others)]
    assert judged(Estimate(*estimate, *np.zeros((3, 1))), rivals_found, 0.01) == expected


def test_advice_prints_plots_and_saves(full, tmp_path):
    cheap = full.with_effects(replace(bd.Effects.of(full), harmonics=1, blade_modes=3))
    advice = cheap.advise(40.0, INTERVAL, against=bd.Effects.of(full))
    assert {e.name for e in advice.effects} == {"harmonics", "blade modes"}
    text = str(advice)
    assert "harmonics" in text and "may miss" in text and advice["harmonics"].reliability in text
    richer = full.with_effects(replace(bd.Effects.of(full), blade_modes=3)).system(40.0)
    assert (advice["harmonics"].unknowns, advice["harmonics"].points) == (richer.n_unknowns, richer.n_points)
    assert set(advice.called_for) <= {"harmonics", "blade modes"}
    with pytest.raises(KeyError, match="no advice on 'separation'"):
        advice["separation"]
    advice.save(tmp_path / "advice.h5")
    assert bd.load(tmp_path / "advice.h5") == advice
    ax = advice.plot()
    assert [t.get_text() for t in ax.get_yticklabels()] == [e.name for e in advice.effects[::-1]]


def test_fullest_asks_for_what_the_model_has(full):
    rich = fullest(full)
    assert rich.harmonics == 5 and rich.damper_modes == 2 and rich.blade_modes == 5
    assert bd.Effects.of(full).missing(rich).keys() == {
        "harmonics", "damper modes", "blade modes", "coupled friction",
    }


def test_harmonics_and_elastic_modes_are_called_for_by_their_shares(full):
    search = Search(full, 40.0, INTERVAL, 0.01)
    search.everything = On((1, 2, 3, 4, 5), 2)

    def asked(on, *shares):
        size = float(np.clip(np.sum(shares), -0.2, 0.2))
        estimate = Estimate(size, 0.0, 0.0, np.zeros(1), np.array(shares), np.zeros(6))
        return search.called_for(estimate, on)

    one, elastic = On((1,), 0), On((1,), 2)
    assert asked(elastic, 0.0, 0.0, 0.05, 1e-4, 1e-5, 1e-6) == On((1, 2), 2)
    assert asked(elastic, 0.0, 0.0, 1e-4, 0.05, 1e-5, 0.02) == On((1, 3, 5), 2)
    assert asked(elastic, 0.0, 0.0, 0.002, 0.002, 0.05, 1e-5) == On((1, 3, 4), 2)  # one of two that matter together
    assert asked(elastic, 0.0, 0.0, 0.1, -0.1, 0.1, 0.1) == On((1, 2, 3, 4, 5), 2)
    # the equations that are on already change with the elastic modes alone
    assert asked(one, 1e-4, 1e-4, 0.05, 1e-4, 1e-5, 1e-6) == On((1, 2), 0)
    assert asked(one, 1e-4, 0.02, 0.05, 1e-4, 1e-5, 1e-6) == On((1, 2), 2)
    assert asked(one, 0.0, 0.02, 1e-4, 1e-4, 1e-5, 1e-6) == On((1,), 2)
    assert search.called_for(Estimate(0.5, 0.0, 0.0, *np.zeros((3, 6))), one) == search.everything
    # nor do shares of an estimate count that may miss more than half of itself
    partly = Estimate(0.05, 0.0, 0.02, np.zeros(1), np.array([0.0, 0.0, 0.05, 0.0, 0.0, 0.0]), np.zeros(6))
    assert search.called_for(partly, elastic) == On((1, 2), 2)
    assert search.called_for(replace(partly, defect=0.03), elastic) == search.everything


@pytest.fixture
def lifting(full, monkeypatch):
    """How a peak with one harmonic is lifted if the estimate misses its change by so much: shares of the walks."""
    search, one = Search(full, 60.0, INTERVAL, 0.01), On((1,), 1)
    _, peaks = search.tracked(one, coarse_options())
    true = search.estimate(peaks[0].y, one)
    walks = []

    def walk(peak, on, share):
        walks.append(share)
        return peak

    monkeypatch.setattr(search, "called_for", lambda estimate, on: search.everything)
    monkeypatch.setattr(search, "higher_nearby", walk)
    change = 0.0

    def lift(beyond, defect=0.0, elsewhere=np.inf):
        estimate = replace(true, amplitude=change + beyond, frequency=0.0, defect=max(defect, 0.006))
        monkeypatch.setattr(search, "estimate", lambda y, on: estimate)
        walks.clear()
        found = search.lift(peaks[0], one, elsewhere * peaks[0].amplitude * (1.0 + change))
        assert found.on == search.everything and found.peak.converged
        return found.peak.amplitude / peaks[0].amplitude - 1.0, tuple(walks)

    change = lift(0.0)[0]
    return lift


def test_a_peak_that_falls_short_of_its_estimate_is_walked_from(lifting):
    """The farther down the more it falls short, as far as the estimate can be relied on."""
    assert lifting(0.0)[1] == () and lifting(0.02)[1] == ()
    assert lifting(-0.1)[1] == ()  # nothing is missing
    change, (share,) = lifting(0.1)
    assert share == pytest.approx(STAYS_UP * (1.0 + change) / (1.1 + change))
    assert lifting(0.25)[1] == (NEAR,)
    assert lifting(0.1, defect=0.5)[1] == (STAYS_UP,)


def test_a_peak_that_surprises_is_walked_from_only_if_the_response_may_be_higher_elsewhere(lifting):
    lifting(0.0)
    assert lifting(0.1, elsewhere=0.99)[1] == () and lifting(0.1, defect=0.5, elsewhere=0.0)[1] == ()
    assert len(lifting(0.1, elsewhere=1.01)[1]) == 1


def test_what_is_expected_elsewhere_is_what_can_be_relied_on(full, monkeypatch):
    """The highest of the points near the top, less half of what the estimate may miss, without those that mean nothing."""
    search, one = Search(full, 60.0, INTERVAL, 0.01), On((1,), 1)
    curve, peaks = search.tracked(one, coarse_options())
    given = []

    def lift(peak, on, expected):
        given.append(expected)
        raise LostError("enough")

    monkeypatch.setattr(search, "lift", lift)
    for change, defect, expected in ((0.1, 0.0, 1.1 * 0.95), (-0.2, 0.05, 0.8 * 0.875), (0.1, 0.5, 0.0)):
        estimate = Estimate(change, 0.0, defect, np.zeros(1), np.zeros(4), np.zeros(4))
        monkeypatch.setattr(search, "estimate", lambda y, on, e=estimate: e)
        with pytest.raises(LostError):
            search.highest(curve, peaks, one)
        assert given[-1] == pytest.approx(expected * peaks[0].amplitude / 0.99, rel=0.02)
        place = Place(peaks[0].y, 800.0, 2.0, estimate)
        assert surely([place, replace(place, amplitude=1.0)]) == pytest.approx(2.0 * expected)
    assert surely([]) == 0.0


@pytest.mark.parametrize(
    ("heights", "climbed"),
    [
        ((0.9, 0.8), False),
        ((0.8, 0.9), True),
        ((0.8, 0.9, 0.85), True),
        ((0.9, 0.0, 0.8), True),
        ((0.9,), True),
        ((0.0, 0.0, 0.9), False),  # not asked any more
    ],
)
def test_the_flank_of_the_best_peak_is_no_superharmonic_resonance(full, monkeypatch, heights, climbed):
    """Solutions that fall away from the best peak are not climbed from; any other order of them may be a resonance."""
    search, one = Search(full, 60.0, INTERVAL, 0.01), On((1,), 1)
    curve, peaks = search.tracked(one, coarse_options())
    search.best = search.in_full(adaptive._Found(peaks[0], one, None))
    best = search.best.peak
    rich = search.variant(search.everything)[1]
    points = [np.append(peaks[0].y[:-1], best.y[-1] * (1.0 + 0.001 * (i + 1))) for i in range(len(heights))]
    order = iter(heights)
    climbs = []

    def correct_at(u, omega, *_):
        height = next(order)
        status = adaptive.OK if height else 1
        return SimpleNamespace(status=status, y=np.append(best.y[:-1] * height, omega))

    def find(system, y, **_):
        climbs.append(y)
        return replace(best, status="nothing there")

    nothing = Estimate(0.0, 0.0, 9.0, np.zeros(1), np.zeros(4), np.zeros(4))
    monkeypatch.setattr(rich, "correct_at", correct_at)
    monkeypatch.setattr(adaptive, "find_peak", find)
    monkeypatch.setattr(adaptive, "superharmonic_points", lambda *_: iter([points[::-1]]))
    monkeypatch.setattr(search, "estimate", lambda *_: nothing)
    assert not search._take_superharmonics(curve, one)
    assert bool(climbs) is climbed


@pytest.mark.parametrize(
    ("change", "defect", "solved"), [(0.0, 0.0, False), (0.0, 0.2, True), (0.2, 0.0, True), (-0.4, 0.0, True)]
)
def test_a_superharmonic_resonance_is_solved_for_unless_reliable_estimates_exclude_it(
    full, monkeypatch, change, defect, solved
):
    search, one = Search(full, 60.0, INTERVAL, 0.01), On((1,), 1)
    curve, peaks = search.tracked(one, coarse_options())
    search.best = adaptive._Found(replace(peaks[0], amplitude=1.05 * peaks[0].amplitude), one, None)
    rich, asked = search.variant(search.everything)[1], []
    estimate = Estimate(change, 0.0, defect, np.zeros(1), np.zeros(4), np.zeros(4))

    def correct_at(u, *_):
        asked.append(u)
        return SimpleNamespace(status=1)

    monkeypatch.setattr(search, "estimate", lambda *_: estimate)
    monkeypatch.setattr(adaptive, "superharmonic_points", lambda *_: iter([[peaks[0].y]]))
    monkeypatch.setattr(rich, "correct_at", correct_at)
    search._take_superharmonics(curve, one)
    assert bool(asked) is solved


@pytest.mark.parametrize(
    ("lost", "followed"),
    [
        (LostPeakError, [((1,), False), ((1, 2, 3), True), ((1, 2, 3, 4), False)]),
        (LostError, [((1,), False), ((1, 2, 3, 4), False)]),
    ],
)
def test_three_harmonics_are_tried_where_a_peak_is_lost(full, monkeypatch, lost, followed):
    """A curve without a maximum is followed with everything on at once, and so is what three harmonics do not reach."""
    search = Search(replace(full, harmonics=4), 60.0, INTERVAL, 0.01)
    seen = []
    tracked, highest = search.tracked, search.highest

    def watched(on, options=None, from_high=False):
        seen.append((on.harmonics, from_high))
        assert options is {1: adaptive.ROUGH, 3: adaptive.SHORT, 4: adaptive.FOLLOWED[0]}[len(on.harmonics)]
        curve, peaks = tracked(on, options, from_high)
        return (replace(curve, status="incomplete") if len(on.harmonics) == 3 else curve), peaks

    def lose(curve, peaks, on):
        if on.harmonics == (1,):
            raise lost("there")
        return highest(curve, peaks, on)

    monkeypatch.setattr(search, "tracked", watched)
    monkeypatch.setattr(search, "highest", lose)
    search.run()
    assert seen == followed and adaptive.SHORT.max_points < adaptive.ROUGH.max_points
    assert search.best is not None and search.best.on == search.everything


def test_curves_with_more_on_go_by_the_first_one(full, monkeypatch):
    """At its ends, and wherever it passes a frequency; not at an end where there is another response."""
    search, one = Search(full, 60.0, INTERVAL, 0.01), On((1,), 1)
    first, _ = search.tracked(one)
    given = []
    tracked = adaptive.track_curve

    def watched(*a, guesses, **k):
        given.append(guesses)
        return tracked(*a, guesses=guesses, **k)

    monkeypatch.setattr(adaptive, "track_curve", watched)
    search.tracked(search.everything)
    low, high = (2.0 * np.pi * f for f in INTERVAL)
    assert given[-1](low) == []
    search.first = first, one
    search.tracked(search.everything)
    for omega in (low, high):
        point = adaptive.point_at(first, omega / (2.0 * np.pi))
        assert point[-1] == pytest.approx(omega, rel=1e-12)
        (u,) = given[-1](omega)
        np.testing.assert_allclose(u, search.moved(point, one, search.everything)[:-1], rtol=1e-9, atol=1e-12)
    omega = 0.5 * (low + high)
    passes = crossings(first, omega)
    assert passes and len(given[-1](omega)) == len(passes)
    for u, (i, t) in zip(given[-1](omega), passes):
        between = (1.0 - t) * first.unknowns[i] + t * first.unknowns[i + 1]
        assert np.array_equal(u, search.moved(np.append(between, omega), one, search.everything)[:-1])
    for end in (104.0, 337.77, INTERVAL[1]):  # some are others when divided by 2 pi again
        search.no_guess_at = 2.0 * np.pi * end
        assert given[-1](2.0 * np.pi * end) == []
    assert given[-1](low)


def test_where_there_is_another_response_its_curve_gets_no_guess(full, monkeypatch):
    search = Search(full, 60.0, INTERVAL, 0.01)
    followed = []
    tracked = search.tracked

    def watched(on, options=None, from_high=False):
        ends = [len(search.guesses(2.0 * np.pi * f, search.everything)) for f in INTERVAL]
        followed.append((on == search.everything, from_high, ends))
        return tracked(on, options, from_high)

    monkeypatch.setattr(search, "tracked", watched)
    monkeypatch.setattr(search, "another_response", lambda *_: True)
    search.run()
    assert followed[0] == (False, False, [0, 0])
    assert followed[1] == (True, True, [1, 0])


def test_a_guess_is_tried_where_linear_responses_do_not_lead_to_a_solution(full):
    """It spares homotopies; one that leads nowhere costs a few iterations."""
    preload, omega, options = 60.0, 2.0 * np.pi * 880.0, bd.ContinuationOptions()

    def found(*given):
        guesses = (lambda at: [u for u in given if at == omega]) if given else None
        start, log = full.find_start(preload, omega, options, adaptive.CostMeter(0.0), Aids(guesses))
        at = [i for i, line in enumerate(log) if "guess given" in line]
        assert all(log[i - 1].startswith("Newton from the stuck response") for i in at)  # others take longer
        return start, [log[i] for i in at], any("raised" in line for line in log)

    alone, said, raised = found()
    assert not said and raised
    start, (said,), raised = found(1.001 * alone[:-1])
    assert "converged" in said and not raised
    assert np.linalg.norm(start - alone) < 1e-9 * np.linalg.norm(alone)
    start, (said,), raised = found(1e9 * alone[:-1])
    assert "not" in said and raised and np.array_equal(start, alone)


def test_adaptive_peaks_neither_ask_for_notes_nor_take_them_away(full, monkeypatch):
    asked = []
    notes = bd.Study.wedge_friction
    monkeypatch.setattr(bd.Study, "wedge_friction", lambda self, *a: asked.append(self) or notes(self, *a))
    study = replace(full)
    study.adaptive_peak(200.0, INTERVAL)
    assert not asked and "self_locking" not in study.__dict__


def test_of_two_peaks_close_in_height_the_full_study_tells_the_higher(full, peak, monkeypatch):
    search, one = Search(full, 40.0, INTERVAL, 0.01), On((1,), 1)

    def found(amplitude, frequency, on=one):
        return adaptive._Found(replace(peak, amplitude=amplitude, frequency=frequency), on, None)

    def taken(*pair):
        search.best = None
        for each in pair:
            search._take(each)
        return search.best.peak.frequency

    def less_at_800(f):
        return found(f.peak.amplitude * (0.995 if f.peak.frequency == 800.0 else 1.0), f.peak.frequency)

    monkeypatch.setattr(search, "in_full", less_at_800)
    assert taken(found(1.0, 800.0), found(0.998, 830.0)) == taken(found(0.998, 830.0), found(1.0, 800.0)) == 830.0
    assert taken(found(1.0, 800.0), found(0.988, 830.0)) == 800.0  # too far apart
    assert taken(found(1.0, 800.0), found(0.998, 801.0)) == 800.0  # the same
    assert taken(found(1.0, 900.0), found(0.9, 830.0)) == 830.0  # outside the interval


def test_a_peak_is_taken_to_the_full_study(full):
    search, one = Search(full, 60.0, INTERVAL, 0.01), On((1,), 1)
    _, peaks = search.tracked(one, coarse_options())
    truth = peak_of(full, 60.0)
    there = search.in_full(adaptive._Found(peaks[0], one, None))
    assert there.on == search.everything and search.in_full(there) is there
    assert there.peak.amplitude == pytest.approx(truth.amplitude, rel=1e-5) != pytest.approx(peaks[0].amplitude, rel=1e-5)


def test_a_point_that_falls_short_of_its_estimate_triggers_a_walk(full, monkeypatch):
    """The full response near the top of the first curve is solved for where it should be higher than the peak."""
    one = On((1,), 1)

    def walked(expected):
        search = Search(full, 60.0, INTERVAL, 0.01)
        curve, peaks = search.tracked(one, coarse_options())
        top = search.lift(peaks[0], one)
        walks, solved = [], []
        near = adaptive.solutions_near
        monkeypatch.setattr(search, "lift", lambda peak, on, expected: top)
        monkeypatch.setattr(search, "walk", lambda *close_by: close_by or walks.append(1))
        monkeypatch.setattr(search, "_take_superharmonics", lambda *_: False)
        true = search.estimate
        monkeypatch.setattr(search, "estimate", lambda y, on: replace(true(y, on), amplitude=expected, defect=0.0))

        def counted(*a, **k):
            solved.append(1)
            return near(*a, **k)

        with monkeypatch.context() as patch:
            patch.setattr(adaptive, "solutions_near", counted)
            search.highest(curve, peaks, one)
        return len(walks), len(solved)

    assert walked(-0.2) == (0, 0)
    walks, solved = walked(0.2)
    assert walks == 1 and solved > 0


def test_the_curve_through_the_peak_is_followed_to_sides_where_the_response_may_be_nearly_as_high(full, monkeypatch):
    search = Search(full, 60.0, INTERVAL, 0.01)
    _, (peak, *_) = search.tracked(On((1,), 1), coarse_options())
    search.best = adaptive._Found(peak, search.everything, None)

    def ways(*places):
        there = [SimpleNamespace(frequency=f * peak.frequency, most=a * peak.amplitude) for f, a in places]
        return search._ways_near_top(there)

    assert ways() == ways((1.0, 1.0), (1.004, 0.99), (0.996, 2.0)) == []  # the peak itself
    assert ways((1.006, 0.91), (0.99, 0.89)) == [True]
    assert ways((1.006, 0.89), (0.99, np.inf)) == [False]
    assert ways((1.02, 0.95), (0.98, 0.95)) == [True, False]
    followed = []
    monkeypatch.setattr(search, "higher_nearby", lambda peak, on, *how: followed.append(how) or peak)
    search.walk(adaptive.CLOSE_BY, [True])
    search.walk(adaptive.CLOSE_BY, BOTH_WAYS)
    search.walk(adaptive.CLOSE_BY, BOTH_WAYS)  # has been done
    search.walk()  # not as far down
    search.walk(adaptive.CLOSE_BY, BOTH_WAYS)
    assert followed == [(adaptive.CLOSE_BY, [True]), (adaptive.CLOSE_BY, BOTH_WAYS), (STAYS_UP, BOTH_WAYS)]


def test_the_curve_through_a_peak_leads_back_to_the_peak_itself(full):
    """To each side by itself, and no search uphill is spent on it."""
    search = Search(full, 60.0, INTERVAL, 0.01)
    _, (peak, *_) = search.tracked(search.everything, coarse_options())
    for ways in ((True,), (False,), BOTH_WAYS):
        paths = []
        assert higher_nearby(search.variant(search.everything)[1], peak, 0.9, 50, paths.append, ways) is peak
        assert len(paths) == len(ways)
        for up, points in zip(ways, paths):
            assert len(points) > 1 and (points[-1].y[-1] > peak.y[-1]) == up


def test_another_response_at_the_end_of_the_interval_is_seen(full):
    one, preload = On((1,), 1), 60.0
    search = Search(full, preload, INTERVAL, 0.01)
    curve, _ = search.tracked(one)
    other = replace(curve, unknowns=1.02 * curve.unknowns)
    assert not search.another_response(curve, one, False) and not search.coexisting
    assert search.another_response(other, one, False)
    assert [(c.low, c.high, c.kind) for c in search.coexisting] == [(INTERVAL[1], INTERVAL[1], "apart")]
    assert search.log[-1] == str(search.coexisting[0]) and "a response apart from the curve" in search.log[-1]
    # at the lower end a curve from above is compared with the first point of the one from below
    three = On((1, 2, 3), 1)
    above, _ = search.tracked(three, from_high=True)
    apart = replace(above, unknowns=1.02 * above.unknowns)
    assert not search.another_response(apart, three, True)  # there is no earlier curve
    search.first = curve, one
    assert not search.another_response(above, three, True)
    assert search.another_response(apart, three, True)
    assert search.coexisting[-1].low == INTERVAL[0]
    search.stuck = True  # the response is linear
    assert not search.another_response(other, one, False)


def test_what_is_lost_counts_unless_it_is_below_the_best(full, peak):
    search = Search(full, 40.0, INTERVAL, 0.01)

    def lost(amplitude, change, defect):
        return LostError("there", Place(peak.y, 800.0, amplitude, Estimate(change, 0.0, defect, peak.y, *np.zeros((2, 4)))))

    for one in (lost(0.1, 0.0, 0.0), LostError("no curve")):
        with pytest.raises(LostError):
            search._lose(one)  # nothing is known yet
    search.best = SimpleNamespace(peak=SimpleNamespace(amplitude=1.0))
    for one in (lost(1.01, 0.0, 9.0), lost(0.9, 0.2, 0.05), LostError("no curve")):
        with pytest.raises(LostError):
            search._lose(one)
    assert not search.log
    search._lose(lost(0.9, 0.2, 9.0))
    assert search.log == ["there; there is a higher one"]
    assert [(c.low, c.high, c.kind) for c in search.coexisting] == [(800.0, 800.0, "not followed")]


@pytest.mark.parametrize(
    ("amplitude", "frequency", "same"), [(1.4, 1.0, True), (1.6, 1.0, False), (0.6, 0.96, True), (1.0, 0.94, False)]
)
def test_a_peak_far_from_the_one_that_led_to_it_is_another(amplitude, frequency, same):
    a, b = (SimpleNamespace(amplitude=x, frequency=f) for x, f in ((amplitude, frequency), (1.0, 1.0)))
    assert adaptive.another(a, b) is not same


def test_adaptive_peak_of_a_stuck_contact_needs_one_harmonic(full):
    gentle = replace(full, excitation=bd.Excitation("tip", amplitude=1e-4))
    found, truth = gentle.adaptive_peak(200.0, INTERVAL), peak_of(gentle, 200.0)
    assert found.converged and found.effects.harmonics == (1,)
    assert found.amplitude == pytest.approx(truth.amplitude, rel=1e-5)
    assert "harmonics 1;" in str(found)
    cost = found.cost
    assert cost.evaluations > 0 and cost.iterations > 0 and 0.0 < cost.core < cost.seconds == found.seconds
    assert str(cost) in str(found)


def test_adaptive_peak_of_a_slipping_contact_is_that_of_the_study(full):
    found, truth = full.adaptive_peak(40.0, INTERVAL), peak_of(full, 40.0)
    assert found.converged and found.error_bound <= 0.005
    assert found.amplitude == pytest.approx(truth.amplitude, rel=0.01)
    tight = full.adaptive_peak(40.0, INTERVAL, tolerance=1e-6)
    assert tight.effects.harmonics == 3 and tight.error_bound == 0.0
    assert tight.amplitude == pytest.approx(truth.amplitude, rel=1e-4)


def test_an_adaptive_peak_tells_of_every_effect_what_is_left(full):
    gentle = replace(full, excitation=bd.Excitation("tip", amplitude=1e-3))
    found = gentle.adaptive_peak(200.0, INTERVAL)
    rows = {r.effect: r for r in found.remaining}
    assert list(rows) == [name for name, _ in bd.Effects.of(full).settings_text()]
    assert rows["harmonics"].state == "off" and rows["rotation"].state == "as in the study"
    assert abs(rows["harmonics"].amplitude) <= found.error_bound
    left = [r for r in found.remaining if r.state != "as in the study"]
    assert sum(r.amplitude for r in left) == pytest.approx(found.amplitude_error, abs=1e-12)
    assert "harmonics: 1 (off, the rest would change it" in str(found) and "rotation: X Y Z (as in the study)" in str(found)
    everything = full.adaptive_peak(40.0, INTERVAL, tolerance=1e-6)
    assert all(r.state == "as in the study" for r in everything.remaining)


def test_summits_are_where_a_branch_falls_to_both_sides(full):

    def at(*amplitudes, branch=None):
        return summits(synthetic(full, amplitudes, branch))

    assert at(1.0, 2.0, 1.0) == [1]
    assert at(1.0, 2.0, 2.0, 2.0, 1.0) == [1]  # the mean walks while the vibration stands still
    assert at(3.0, 2.0, 1.0, 2.0) == [] and at(1.0, 2.0, 2.0) == []
    assert at(1.0, 2.0, 1.0, 3.0, 2.0, branch=[0, 0, 1, 1, 1]) == [3]


def test_an_adaptive_peak_says_whether_it_has_met_other_responses(full):
    gentle = replace(full, excitation=bd.Excitation("tip", amplitude=1e-4))
    stuck = gentle.adaptive_peak(200.0, INTERVAL)
    assert stuck.responses == "stuck" and stuck.coexisting == () and "the response is linear" in str(stuck)
    slips = full.adaptive_peak(60.0, INTERVAL)
    curve = full.track(60.0, INTERVAL)
    assert curve.shares[:, 1].max() > 0.0 and not len(curve.folds) and not curve.notes
    assert slips.responses == "one seen" and slips.coexisting == () and "no other response was seen" in str(slips)
    walks = full.adaptive_peak(40.0, INTERVAL)
    assert full.track(40.0, INTERVAL).notes
    assert walks.responses == "several" and {part.kind for part in walks.coexisting} == {"walk"}
    assert "the highest peak may be another one" in str(walks) and str(walks.coexisting[0]) in str(walks)


def test_what_counts_as_several_responses(full):
    def noticed(**changes):
        search = Search(full, 40.0, INTERVAL, 0.01)
        search.notice(replace(synthetic(full, [1.0, 2.0, 3.0, 2.0, 1.0]), **changes), On((1,), 1))
        return [(c.kind, c.low, c.high) for c in search.coexisting], search.stuck

    assert noticed() == ([], True)
    assert noticed(shares=np.tile([0.999, 0.001, 0.0], (5, 1))) == ([], False)
    assert noticed(frequency=np.array([1.0, 3.0, 4.0, 2.0, 5.0])) == ([("folds", 2.0, 4.0)], True)
    two = {"frequency": np.array([1.0, 3.0, 4.0, 2.0, 5.0]), "branch": np.array([0, 0, 0, 1, 1])}
    assert noticed(**two) == ([], True)  # the next branch sets off elsewhere
    walk = {"frequency": np.array([1.0, 2.0, 2.0, 3.0, 4.0]), "point_kind": ("end", "walk", "walk", "regular", "end")}
    assert noticed(**walk) == ([("walk", 2.0, 2.0)], True)
    assert noticed(left_out=(LeftOut(1.0, 2.0, "tangle"),)) == ([("left out", 1.0, 2.0)], True)
    assert noticed(status="incomplete") == ([("not followed", *INTERVAL)], True)


def test_a_summit_above_all_peaks_is_hidden(full):
    search = Search(full, 40.0, INTERVAL, 0.01)
    curve = synthetic(full, [0.5, 1.0, 0.5, 1.2, 0.5])

    def hidden(*heights):
        return search._hidden_summit(curve, [SimpleNamespace(amplitude=h) for h in heights])

    assert hidden() == 3 and hidden(1.0) == 3
    assert hidden(1.2) is None and hidden(1.195, 1.0) is None  # within the tolerance
    assert search._hidden_summit(synthetic(full, [1.0, 0.5, 1.0]), []) is None


def test_no_peak_is_said_to_be_none(full):
    found = full.adaptive_peak(1e4, (720.0, 760.0))
    assert not found.converged and "no maximum" in found.reason and np.isnan(found.amplitude)
    with pytest.raises(bd.BdamperError, match="no peak between 720 and 760 Hz"):
        full.advise(1e4, (720.0, 760.0))


@pytest.mark.parametrize("tolerance", [0.0, 1.0, -1.0, float("nan")])
def test_tolerance_is_checked(full, tolerance):
    for ask in (adaptive_peak, type(full).advise, lambda *a, **k: full.track(*a[1:], effects="auto", **k)):
        with pytest.raises(bd.SettingError, match=r"tolerance: expected (a number )?between 0 and 1"):
            ask(full, 40.0, INTERVAL, tolerance=tolerance)


def test_effects_of_a_curve_are_all_or_auto(full):
    with pytest.raises(bd.SettingError, match=r"effects: expected one of \('all', 'auto'\), found 'cheap'"):
        full.track(40.0, INTERVAL, effects="cheap")
