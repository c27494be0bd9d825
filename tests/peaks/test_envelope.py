"""The preload of least resonance amplitude, and what is told of peaks, with peaks given in closed form."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bdamper.peaks import least as search
from bdamper.peaks.envelope import Branch, PeakEnvelope, Scanned
from bdamper.peaks.least import least_peak, verified_optimum
from bdamper.peaks.newton import Peak, PeakOptions, drifted
from bdamper.peaks.optimal import _status
from bdamper.peaks.optimal_curve import OptimumPoint
from bdamper.peaks.scan import Above, Scan, _above
from bdamper.util.cost import CostMeter


def peak(preload, amplitude, frequency=100.0):
    return Peak(
        preload, frequency, amplitude, np.array([amplitude, 2.0 * np.pi * frequency]), np.array([1.0, 0.0]), np.ones(2),
        0.0, -1.0, np.array([1.0, 0.0, 0.0]), 0.0, 1, 1, 0, False, "complete",
    )  # fmt: skip


def known(branches, preload, apart=1.0):
    """All peaks of branches whose ln(amplitude) is a function of ln(preload), with frequencies so many Hz apart."""
    out = PeakEnvelope(None, preload, (50.0, 150.0), PeakOptions(), CostMeter(0.0))
    for number, height in enumerate(branches):
        peaks = {k: peak(p, np.exp(height(np.log(p))), 100.0 + apart * number) for k, p in enumerate(preload)}
        out.branches.append(Branch(number, peaks))
    out.scanned = scans(out, {0: "complete", len(preload) - 1: "complete"})
    return out


def scans(peaks, endings):
    """What scans have told that ended so, by the index of the preload."""
    return {float(peaks.preload[k]): Scanned(ending) for k, ending in endings.items()}


def least(branches, preload, monkeypatch, apart=1.0):
    """The optimum, with peaks between the preloads and sensitivities by the closed form."""

    def of(q):
        return branches[round((q.frequency - 100.0) / apart)]

    def reach(self, near, p):
        return peak(p, np.exp(of(near[0])(np.log(p))), near[0].frequency)

    def sensitivity(q, family, p, options):
        x, h = np.log(p), 1e-6
        return (of(q)(x + h) - of(q)(x - h)) / (2.0 * h) * q.amplitude / p

    monkeypatch.setattr(search._Minimum, "followed", reach)
    monkeypatch.setattr(search, "amplitude_sensitivity", sensitivity)
    return least_peak(known(branches, preload, apart))


def valley(x):
    """Least at x = 0.4."""
    return 0.5 * (x - 0.4) ** 2


def hill(x, share=0.0):
    """Higher than the valley between 0 and 1, lower than a share of it at both."""
    return 0.2 * np.sin(np.pi * x) + share


GRID = np.exp(np.arange(-3.0, 5.0))


def test_least_value_of_one_branch(monkeypatch):
    found = least([valley], GRID, monkeypatch)
    assert found.kind == "smooth"
    assert found.uncertainty < 1e-6
    assert found.preload == pytest.approx(np.exp(0.4), rel=1e-6)


def test_branches_of_two_scans_may_hold_the_same_peaks(monkeypatch):
    """Rounding decides which of them is called the highest; the optimum stays a smooth one."""
    sides = iter([0.0, 1e-12] * 1000)
    found = least([valley, lambda x: valley(x) + next(sides)], GRID, monkeypatch, apart=1e-5)
    assert found.kind == "smooth"
    assert found.uncertainty < 1e-6
    assert found.preload == pytest.approx(np.exp(0.4), rel=1e-6)


def test_no_optimum_where_another_peak_is_higher(monkeypatch):
    """A branch that is low at the preloads on both sides is looked at only where the optimum was found."""
    found = least([valley, lambda x: hill(x, -0.11)], GRID, monkeypatch)
    assert (found.kind, found.status) == ("unknown", "not verified: another peak is higher there")
    assert found.uncertainty == pytest.approx(1.0)


def test_branches_near_the_highest_peak_take_part(monkeypatch):
    """3 % lower than the other at the preload on the left, and higher from there on: the optimum is where they cross."""
    branches = [valley, lambda x: hill(x, 0.05)]
    gap = valley(0.0) - branches[1](0.0)
    assert 0.0 < gap < -np.log(0.95)
    assert branches[1](1.0) < valley(1.0)
    found = least(branches, GRID, monkeypatch)
    assert found.kind == "crossing"
    assert found.uncertainty < 1e-6
    x = np.log(found.preload)
    assert abs(branches[1](x) - valley(x)) < 1e-6


def test_a_peak_off_the_curve_that_a_sweep_follows_is_isolated():
    """Two peaks are known, a complete scan passes one of them: the other is not the one that a sweep meets."""
    peaks = known([lambda x: 1.0 + 0.0 * x, lambda x: 0.0 * x], np.array([1.0, 2.0, 3.0]))
    peaks.scanned = {}
    curve, isolated = peaks.branches[1], peaks.branches[0]
    there = curve.peaks[1]
    peaks.systems = {float(p): SimpleNamespace(n_mean=0) for p in peaks.preload}
    peaks.problem = SimpleNamespace(static=lambda preload: SimpleNamespace(converged=True))

    points = np.array([[0.5, 600.0], there.y, [0.5, 660.0]])
    peaks.peaks_over_frequency = lambda k, whole: (Scan((there,), "complete", points), Scanned("complete"))
    assert peaks.highest(1)[0] is isolated
    peaks.scan(1)
    assert peaks.scan_at(1).isolated == {isolated.number}
    assert peaks.highest(1)[0] is curve
    assert peaks.highest(0)[0] is isolated  # was not looked at there
    assert any("peak of branch 0" in event and "is not connected" in event for event in peaks.events)
    # from there the neighbours ask for a look of their own
    assert next(peaks.suspicious()) == 0
    # an incomplete scan tells nothing
    peaks.peaks_over_frequency = lambda k, whole: (Scan((there,), "stalled", points), Scanned("stalled"))
    peaks.scan(0)
    assert not peaks.isolated(isolated, 0)


def test_guesses_of_a_mean_position_that_nothing_holds():
    """Not displaced along the direction of least stiffness, and displaced either way until the first open point touches."""
    weak, strong = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    K = 1e-3 * np.outer(weak, weak) + 7.0 * np.outer(strong, strong)
    J = np.zeros((4, 4))
    J[:2, :2], J[2:, 2:] = K, np.eye(2)
    rates, closing = np.array([1.0, -2.0, 0.5, 1.0]), np.array([-3.0, -1.0, -9.0, 0.5])

    def touch(u, direction):
        return closing, rates * np.sign(direction @ weak)

    system = SimpleNamespace(
        n_mean=2, evaluate=lambda u, omega: (None, J, None), at=lambda omega: SimpleNamespace(closing=touch)
    )  # fmt: skip
    y = np.array([5.0, 1.0, 0.2, 0.3, 7.0])
    scale = np.full(5, 2.0)
    found = drifted(system, y, scale)
    assert len(found) == 3
    for guess in found:
        np.testing.assert_array_equal(guess[2:], y[2:])
        assert (guess - y)[:2] @ strong == pytest.approx(0.0, abs=1e-12)
    along = [float((guess - y)[:2] @ weak) for guess in found]
    assert found[0][:2] @ weak == pytest.approx(0.0, abs=1e-12)
    assert sorted(along[1:]) == pytest.approx([-0.5 * 1.001, 3.0 * 1.001])
    assert drifted(SimpleNamespace(n_mean=0), y, scale) == []


class TestWhatIsNotKnown:
    """Preloads whose scan over frequency is incomplete, and those at which something fails."""

    @pytest.fixture
    def peaks(self):
        out = known([lambda x: 0.0 * x], np.array([1.0, 2.0, 3.0, 4.0, 5.0]))
        out.scanned = {}
        out.systems = {float(p): SimpleNamespace(n_mean=0) for p in out.preload}
        out.problem = SimpleNamespace(static=lambda preload: SimpleNamespace(converged=True))
        return out

    def scan(self, peaks, ending):
        """Scans that find the one branch, and end as ``ending`` says of each index."""

        def found(k, whole):
            end = ending(k)
            if isinstance(end, Exception):
                raise end
            there = (peaks.branches[0].peaks[k],)
            return Scan(there, end, np.array([[0.5, 600.0], there[0].y, [0.5, 660.0]])), Scanned(end)

        return found

    def test_an_incomplete_scan_gives_a_lower_bound(self, peaks):
        peaks.peaks_over_frequency = self.scan(peaks, lambda k: "incomplete (tangle)" if k == 0 else "complete")
        peaks.find_all()
        # the next one is scanned, so that every value lies between complete scans
        assert sorted(peaks.scanned) == [1.0, 2.0, 5.0]
        assert [peaks.trusted(k) for k in range(5)] == [False, True, True, True, True]
        assert peaks.value(0) is None
        assert peaks.lower_bound(0) == 1.0
        assert _status(peaks, 0) == "lower bound, scan over frequency incomplete (tangle)"
        assert [_status(peaks, k) for k in (1, 2, 4)] == ["scanned", "followed", "scanned"]

    @pytest.mark.parametrize("error", [ZeroDivisionError("float division"), np.linalg.LinAlgError("singular")])
    def test_one_bad_point_does_not_lose_the_others(self, peaks, error):
        peaks.peaks_over_frequency = self.scan(peaks, lambda k: error if k == 0 else "complete")
        peaks.find_all()
        assert _status(peaks, 0) == f"lower bound, scan over frequency failed: {type(error).__name__}: {error}"
        assert all(peaks.value(k) is not None for k in range(1, 5))

    def test_a_point_of_the_curve_above_its_peaks_leaves_no_value(self, peaks):
        top = Above(100.0, 1.5, "where the mean position drifts")
        there = peaks.branches[0].peaks[2]
        found = Scan((there,), "complete", np.array([[0.5, 600.0], there.y]), top)
        peaks.peaks_over_frequency = lambda k, whole: (found, Scanned("complete"))
        peaks.scan(2)
        assert peaks.value(2) is None
        assert peaks.lower_bound(2) == 1.5
        assert "higher where the mean position drifts" in _status(peaks, 2)

    def test_the_corner_at_which_the_mean_position_drifts_is_a_value(self, peaks):
        there, corner = peaks.branches[0].peaks[2], replace(peak(3.0, 1.5, 120.0), corner=True, curvature=-np.inf)
        top = Above(120.0, 1.5, "where the mean position drifts", corner)
        found = Scan((there,), "complete", np.array([[0.5, 600.0], there.y]), top)
        peaks.peaks_over_frequency = lambda k, whole: (found, Scanned("complete"))
        peaks.scan(2)
        assert peaks.value(2)[1] is corner
        assert _status(peaks, 2) == "scanned"
        # it is not followed, so that the neighbours have to be looked at
        assert next(peaks.suspicious()) == 1

    def test_a_high_peak_that_ends_asks_for_a_scan_where_it_is_gone(self, peaks):
        """The one that is left is higher, but the one that is gone might be higher still."""
        peaks.scanned = scans(peaks, {0: "complete", 4: "complete"})
        peaks.branches[0].peaks = {k: peak(p, 1.0, 110.0) for k, p in enumerate(peaks.preload[:2])}
        peaks.branches.append(Branch(1, {k: peak(p, 0.5 + 0.3 * k) for k, p in enumerate(peaks.preload)}))
        assert peaks.highest(2)[1].amplitude > peaks.highest(1)[1].amplitude
        assert next(peaks.suspicious()) == 2

    def test_an_inserted_preload_keeps_what_is_known(self, peaks, monkeypatch):
        monkeypatch.setattr(PeakEnvelope, "follow", lambda *args: None)
        peaks.scanned = {1.0: Scanned("complete"), 4.0: Scanned("lost", bound=2.0, isolated=frozenset([0]))}
        assert peaks.insert(2.5) == 2
        assert peaks.preload.tolist() == [1.0, 2.0, 2.5, 3.0, 4.0, 5.0]
        assert peaks.asked.tolist() == [True, True, False, True, True, True]
        assert [there and there.ending for there in map(peaks.scan_at, range(6))] == ["complete", *3 * [None], "lost", None]
        assert peaks.lower_bound(4) == 2.0 and peaks.isolated(peaks.branches[0], 4)
        assert {k: q.parameter for k, q in peaks.branches[0].peaks.items()} == {0: 1.0, 1: 2.0, 3: 3.0, 4: 4.0, 5: 5.0}
        assert peaks.insert(2.5) == 2


def two_wells(x):
    """Least, -0.1, near x = 2.5 between two points of the grid; 0.1 near x = -0.7, where the lowest of them is."""
    u = (x - 0.9) / 1.6
    return 2.0 * (u**2 - 1.0) ** 2 - 0.1 * u


class TestVerified:
    """The optimum compared with curves that also hold a branch that was not known."""

    def verified(self, monkeypatch, hidden, ending="complete", first=valley):
        branches = [first, hidden]
        monkeypatch.setattr(search, "amplitude_sensitivity", lambda q, family, p, options: slope_of(branches, q, p))
        monkeypatch.setattr(search._Minimum, "followed", lambda self, near, p: at(branches, near[0], p))

        def follow(self, branch, k, step, last=None):
            q = branch.peaks[k]
            for j in [last] if last is not None else range(k, len(self.preload) if step > 0 else -1, step):
                branch.peaks[j] = at(branches, q, self.preload[j])

        def scan(self, k, whole):
            preload = self.preload[k]
            heights = [(peak(preload, np.exp(h(np.log(preload))), 100.0 + i)) for i, h in enumerate(branches)]
            points = np.array([q.y for q in heights])
            return Scan(tuple(sorted(heights, key=lambda q: -q.amplitude)), ending, points), Scanned(ending, whole=True)

        monkeypatch.setattr(PeakEnvelope, "follow", follow)
        monkeypatch.setattr(PeakEnvelope, "peaks_over_frequency", scan)
        out = known([first], GRID)
        out.problem = SimpleNamespace(static=lambda preload: SimpleNamespace(converged=True))
        out.family = lambda preload: SimpleNamespace(n_mean=0)
        return verified_optimum(out), out

    def test_where_the_curve_agrees(self, monkeypatch):
        found, peaks = self.verified(monkeypatch, lambda x: valley(x) - 0.5)
        assert found.status == "verified"
        assert found.preload == pytest.approx(np.exp(0.4), rel=1e-6)
        assert found.preload not in peaks.preload[peaks.asked]

    def test_a_higher_peak_on_the_curve_moves_it(self, monkeypatch):
        found, peaks = self.verified(monkeypatch, lambda x: 0.3 * (x + 1.0))
        assert found.status == "verified"
        assert found.kind == "crossing"
        x = np.log(found.preload)
        assert valley(x) == pytest.approx(0.3 * (x + 1.0), abs=1e-6)
        assert len(peaks.branches) == 2

    def test_a_place_that_is_not_known_closely_is_not_said_to_be_without_comparison(self):
        place = OptimumPoint(1.0, 1.0, 100.0, "smooth", 0.1)
        assert place.status == "not verified: no tracking curve was compared"
        judged = search._judged(None, place)
        assert judged.status == "not verified: a whole tracking curve agrees, but the search did not end"

    def test_a_lower_value_between_others_that_are_higher_is_found(self, monkeypatch):
        assert GRID[np.argmin([two_wells(np.log(p)) for p in GRID])] < 1.0
        found, _ = self.verified(monkeypatch, lambda x: two_wells(x) - 0.5, first=two_wells)
        assert found.verified and found.amplitude == pytest.approx(np.exp(-0.1), rel=1e-3) and found.preload > np.exp(2.0)

    def test_tangents_that_lead_below_the_optimum_are_told(self, monkeypatch):
        monkeypatch.setattr(search, "BETWEEN", 0)
        found, _ = self.verified(monkeypatch, lambda x: two_wells(x) - 0.5, first=two_wells)
        low, high = np.exp(2.0), np.exp(3.0)
        assert found.status == f"not verified: the highest peak could be lower between {low:.6g} and {high:.6g} N"
        assert found.preload < 1.0

    def test_an_incomplete_curve_verifies_nothing(self, monkeypatch):
        found, _ = self.verified(monkeypatch, lambda x: valley(x) - 0.5, ending="incomplete (tangle)")
        assert not found.verified
        assert found.status.startswith("not verified: ")
        assert str(found) == "no optimum, not verified: no preload has a value"


def at(branches, q, p):
    return peak(p, np.exp(branches[round(q.frequency - 100.0)](np.log(p))), q.frequency)


def slope_of(branches, q, p):
    h = 1e-6
    up, down = (at(branches, q, p * np.exp(s)).amplitude for s in (h, -h))
    return (up - down) / (2.0 * h) / p


def test_a_maximum_below_the_flank_of_another_resonance_is_seen():
    """The end of the interval is higher than the maximum that no peak was found at; a plateau on the way down is none."""
    frequency = np.arange(8.0)
    amplitude = np.array([5.0, 2.0, 1.0, 3.0, 2.0, 2.0, 2.0, 1.0])
    kinds = ["end", "regular", "regular", "maximum", "drift", "drift", "regular", "end"]
    i, above = _above((peak(1.0, 2.5),), frequency, amplitude, kinds)
    assert (i, above.amplitude, above.what) == (3, 3.0, "at a maximum without a smooth peak")
    assert _above((peak(1.0, 3.0),), frequency, amplitude, kinds) is None
    assert _above((), frequency[:3], amplitude[:3], kinds[:3]) is None


def test_the_range_ends_where_the_damper_rattles():
    """Scans at the two lowest preloads show it: no value there, nothing to do, and the optimum is not questioned by it."""
    peaks = known([valley], GRID)
    for k in (0, 1):
        peaks.scanned[float(GRID[k])] = Scanned("complete", rattles="12 folds")
    peaks.scanned[float(GRID[2])] = Scanned("complete")
    assert (peaks.no_steady_below, peaks.first) == (GRID[1], 2)
    assert [peaks.value(k) is None for k in range(4)] == [True, True, False, False]
    assert peaks.next_scan(0) is None
    assert _status(peaks, 0) == _status(peaks, 1) == f"no steady periodic response below {GRID[1]:.6g} N: 12 folds"
    least_of_all = peaks.highest(4)[1]
    found = OptimumPoint(1.0, 2.0 * least_of_all.amplitude, 100.0, "smooth", 0.0)
    assert not search._could_be_lower(peaks, found)


def test_a_lower_preload_without_the_sign_contradicts_it():
    peaks = known([valley], GRID)
    peaks.scanned[float(GRID[3])] = Scanned("complete", rattles="12 folds")
    assert (peaks.no_steady_below, peaks.first) == (0.0, 0)
    assert peaks.value(3) is not None


def test_the_edge_is_found_by_halving():
    """The lowest preload rattles, the highest does not; both neighbours of the edge are scanned in the end."""
    peaks, asked = known([valley], GRID), []
    peaks.scanned = scans(peaks, {len(GRID) - 1: "complete"})
    while (k := peaks.next_scan(0)) is not None:
        asked.append(k)
        peaks.scanned[float(GRID[k])] = Scanned("complete", rattles="" if k > 2 else "12 folds")
    assert asked == [0, 3, 1, 2]
    assert peaks.first == 3
