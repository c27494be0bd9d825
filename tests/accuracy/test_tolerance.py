"""More harmonics beside an answer: which are computed, what is claimed, and what the result says."""

import os
import signal
from dataclasses import replace
from threading import Timer
from threading import enumerate as enumerate_threads

import numpy as np
import pytest

import bdamper as bd
from bdamper.accuracy import tolerance
from bdamper.effects import richer
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.ladder import Ladder, Rung
from bdamper.util.status import word
from bdamper.util.text import amount, percent
from tests import models
from tests.plain import plain_study

PLACE = 5000.0, (320.0, 365.0)
"""Preload and interval of a peak with slip and separation."""
INTERVAL = (280.0, 370.0)


@pytest.fixture(scope="module")
def study():
    return plain_study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5)


@pytest.fixture(scope="module")
def optimal(study):
    return study.optimal_curve((1000.0, 5000.0), 3, frequency=INTERVAL, check="harmonics")


def peaks(study, *numbers):
    return [study.with_(harmonics=n).track(*PLACE).peak for n in numbers]


def numbers(result):
    return [r.harmonics for r in result.ladder.rungs]


class TestCurve:
    def test_ends_where_the_last_three_agree(self, study):
        curve = study.track(*PLACE, tolerance=0.02)
        own = peaks(study, 1, 3, 5, 7)
        assert numbers(curve) == [1, 3, 5, 7] and curve.settings["harmonics"] == list(range(1, 8))
        assert [r.amplitude for r in curve.ladder.rungs] == pytest.approx([p.amplitude for p in own], rel=1e-9)
        assert curve.peak.amplitude == pytest.approx(own[-1].amplitude, rel=1e-9)
        last = [p.amplitude for p in own[1:]]
        assert curve.ladder.error == pytest.approx((max(last) - min(last)) / last[-1], rel=1e-6)
        assert curve.ladder.converged and "converged to 2 %: 3, 5 and 7 harmonics differ by" in curve.details()
        whole = [study.with_(harmonics=n).track(*PLACE).cost for n in (1, 3, 5, 7)]
        assert curve.cost.work == pytest.approx(sum(c.work for c in whole), rel=1e-9)
        assert curve.cost.processor == pytest.approx(sum(r.seconds for r in curve.ladder.rungs), rel=1e-6)
        assert min(r.seconds for r in curve.ladder.rungs) > 0.0

    def test_two_in_a_row_that_agree_are_not_enough(self, study, monkeypatch):
        monkeypatch.setattr(tolerance, "MOST_MORE", 4)
        curve = study.track(*PLACE, tolerance=0.02)
        low, high = curve.ladder.range
        assert abs(curve.ladder.rungs[-1].change) < 0.02 and not curve.ladder.converged
        one, three, five = (p.amplitude for p in peaks(study, 1, 3, 5))
        assert (low, high) == pytest.approx((min(three, five), one), rel=1e-9)
        ends = f"{amount(low, 'm', 5)} to {amount(high, 'm', 5)}"
        assert curve.complete and f"not converged to 2 %: {ends} with 1, 3 and 5 harmonics" in curve.details()

    def test_begins_with_the_harmonics_of_the_study(self, study):
        curve = study.with_(harmonics=2).track(*PLACE, tolerance=0.2)
        assert numbers(curve) == [2, 4, 6]
        assert study.of(curve).harmonic_numbers == (1, 2, 3, 4, 5, 6)

    def test_missing_nodal_diameters_end_the_ladder(self):
        model = models.wedge_model(0, n_blades=24, engine_order=2, harmonics=3)
        curve = plain_study(model, bd.Excitation("tip"), 2).track(5.0, (200.0, 450.0), tolerance=0.5)
        assert numbers(curve) == [1, 3] and not curve.ladder.converged
        assert "no 5 harmonics are possible" in curve.ladder.note and "nodal diameter" in curve.ladder.note
        assert "fewer than three answers to compare" in curve.ladder.note

    def test_evaluation_of_the_study_stays_and_limits_the_harmonics(self, study):
        sampled = replace(study, evaluation=bd.Sampled(24))
        curve = sampled.track(*PLACE, tolerance=1e-6)
        assert curve.settings["evaluation"] == {"n_time": 24, "interpolate": True}
        assert numbers(curve) == [1, 3, 5]
        assert "no 7 harmonics are possible with the same settings (evaluation: " in curve.ladder.note
        assert sampled.of(curve).harmonic_numbers == (1, 2, 3, 4, 5)

    def test_stability_is_judged_once_chosen(self, study):
        curve = study.track(*PLACE, tolerance=0.2, stability=True)
        assert curve.stable is not None and len(curve.stable) == len(curve)

    def test_is_kept_in_a_file(self, study, tmp_path):
        curve = study.track(*PLACE, tolerance=0.2)
        curve.save(tmp_path / "curve.h5")
        again = bd.load(tmp_path / "curve.h5")
        assert str(again) == str(curve) and again.ladder.rungs[1:] == curve.ladder.rungs[1:]
        assert study.of(again).harmonic_numbers == (1, 2, 3, 4, 5)

    @pytest.mark.parametrize("wrong", [-1.0, 0.0, 1.0, "small"])
    def test_what_is_refused(self, study, wrong):
        for ask in (study.track, study.peak):
            with pytest.raises(SettingError, match="tolerance"):
                ask(*PLACE, tolerance=wrong)
        with pytest.raises(SettingError, match="tolerance"):
            study.optimal_curve((1000.0, 5000.0), 3, tolerance=wrong)


def answers(study, monkeypatch, statuses):
    """A curve to a tolerance where those of some numbers of harmonics have another status."""
    track = tolerance.track

    def with_status(problem, *arguments, **options):
        curve = track(problem, *arguments, **options)
        status = statuses.get(problem.harmonic_numbers[-1], "complete")
        return replace(curve, status=status, reason="as told")

    monkeypatch.setattr(tolerance, "track", with_status)
    return study.track(*PLACE, tolerance=0.02)


class TestIncompleteRungs:
    def test_are_not_known(self, study, monkeypatch):
        monkeypatch.setattr(tolerance, "MOST_MORE", 4)
        curve = answers(study, monkeypatch, {5: "incomplete"})
        assert curve.complete and curve.settings["harmonics"] == [1, 2, 3]
        assert not curve.ladder.converged and not curve.ladder.rungs[-1].known
        assert "5 harmonics not known (incomplete: as told)" in curve.ladder.note

    def test_of_all_numbers(self, study, monkeypatch):
        monkeypatch.setattr(tolerance, "MOST_MORE", 2)
        curve = answers(study, monkeypatch, {1: "incomplete", 3: "incomplete"})
        assert curve.status == "incomplete" and curve.settings["harmonics"] == [1, 2, 3]
        assert "convergence with harmonics not known" in curve.ladder.note and np.isnan(curve.ladder.error)

    def test_interrupted_curve_is_returned_at_once(self, study, monkeypatch):
        curve = answers(study, monkeypatch, {1: "interrupted"})
        assert curve.status == "interrupted" and numbers(curve) == [1]


class TestPeak:
    def test_to_a_tolerance(self, study):
        peak = study.peak(*PLACE, tolerance=0.02)
        assert study.of(peak).harmonic_numbers == tuple(range(1, 8))
        assert peak.amplitude == pytest.approx(peaks(study, 7)[0].amplitude, rel=1e-6)
        assert "converged to 2 %: 3, 5 and 7 harmonics differ by" in peak.details()
        errors = study.estimate_errors(peak, PLACE[0], sources=["solver"])
        assert errors["solver"].size < 1e-8

    def test_none_in_the_interval(self, study):
        """The end of the interval, which is no maximum, takes part in no comparison of harmonics."""
        peak = study.peak(PLACE[0], (100.0, 150.0), tolerance=0.02)
        assert word(peak.scan) == "incomplete" and peak.frequency == pytest.approx(150.0)
        assert not peak.ladder.converged


class TestOptimalCurve:
    def test_rungs_are_tracking_curves(self, study, optimal):
        best = optimal.optimum
        assert numbers(optimal) == [1, 3, 5, 7] and optimal.ladder.answer == 1
        assert optimal.ladder.rungs[0].amplitude == best.amplitude
        assert optimal.ladder.rungs[0].seconds == optimal.cost.processor
        for rung in optimal.ladder.rungs[1:]:
            own = study.with_(harmonics=rung.harmonics).track(best.preload, INTERVAL)
            assert rung.amplitude == pytest.approx(own.peak.amplitude, rel=1e-9)
        assert optimal.amplitude == pytest.approx(
            study.optimal_curve(optimal.preload, frequency=INTERVAL, check=False).amplitude, rel=1e-12
        )

    def test_error_counts_the_answer(self, optimal):
        """The last three agree to 3 %, the answer itself is off by more."""
        rungs = [r.amplitude for r in optimal.ladder.rungs]
        assert optimal.ladder.error == pytest.approx((max(rungs) - min(rungs)) / rungs[-1], rel=1e-12)
        assert optimal.ladder.range == (min(rungs), max(rungs))

    def test_other_preloads(self, study, optimal):
        others = optimal.ladder.others
        assert [r.harmonics for r in others] == [1, 3] * (len(others) // 2)
        assert {r.preload for r in others} == {float(p) for p in optimal.preload} - {optimal.optimum.preload}
        middle = next(r for r in others if r.harmonics == 3 and r.preload == optimal.preload[1])
        own = study.with_(harmonics=3).track(middle.preload, INTERVAL).peak.amplitude
        assert middle.amplitude == pytest.approx(own, rel=1e-9)
        known = {preload: ends for preload, *ends in optimal.ladder.ranges}
        assert known[middle.preload] == pytest.approx(sorted([own, optimal.amplitude[1]]), rel=1e-9)

    def test_does_not_depend_on_threads(self, study, optimal):
        bare = replace(optimal, ladder=None)
        one = tolerance.with_ladder(study, bare, 0.05, threads=1).ladder
        found = [
            [replace(r, seconds=0.0, change=0.0) for r in (*x.rungs, *x.others)] for x in (one, optimal.ladder)
        ]
        assert found[0] == found[1]

    def test_prints_plots_and_saves(self, optimal, tmp_path):
        optimal.save(tmp_path / "curve.h5")
        again = bd.load(tmp_path / "curve.h5")
        assert again.details() == optimal.details() and "not converged to 5 %" in again.details()
        share = percent(optimal.ladder.error)
        assert (
            f"estimated error {share} (harmonics {share[:-2]}), not estimated: contact points, modes" in optimal.details()
        )
        ax = again.ladder.plot()
        assert "processor time" in ax.get_xlabel() and len(ax.texts) == 4

    def test_interrupted_and_resumed(self, study, monkeypatch, tmp_path):
        """Curves that are finished are kept and not computed again."""
        path, inner, tracked = tmp_path / "search.jsonl", tolerance.track, []
        ask = {"preload": (3000.0, 5000.0), "n": 2, "frequency": INTERVAL, "resume": path, "check": "harmonics"}

        def stopped(problem, preload, *args, **options):
            if len(tracked) == 2:
                raise KeyboardInterrupt
            tracked.append((problem.harmonic_numbers[-1], preload))
            return inner(problem, preload, *args, **options)

        monkeypatch.setattr(tolerance, "MORE_AT_OPTIMUM", 4)
        monkeypatch.setattr(tolerance.os, "cpu_count", lambda: 1)
        monkeypatch.setattr(richer, "track", stopped)
        part = study.optimal_curve(**ask)
        assert tracked == [(5, 3000.0), (3, 3000.0)] and not part.interrupted
        assert numbers(part) == [1, 3, 5] and not part.ladder.others and "interrupted by the user" in part.details()
        del tracked[:]
        whole = study.optimal_curve(**ask)
        assert tracked == [(3, 5000.0)]
        assert whole.ladder.rungs[1:] == part.ladder.rungs[1:] and len(whole.ladder.others) == 2
        assert "interrupted" not in whole.details()

    def test_ctrl_c_ends_the_threads(self, study, optimal, monkeypatch):
        """It reaches the main thread alone; the others leave curves with many harmonics unfinished."""
        inner, endings = tolerance.track, []

        def watched(*args, **options):
            curve = inner(*args, **options)
            endings.append(curve.status)
            return curve

        monkeypatch.setattr(richer, "track", watched)
        bare = replace(optimal, ladder=None)
        timer = Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        part = tolerance.with_ladder(study.with_(harmonics=9), bare, 0.05, threads=2)
        timer.join()
        assert "interrupted by the user" in part.ladder.details()
        assert [t for t in enumerate_threads() if t.name.startswith("ThreadPool")] == []
        assert set(endings) <= {"interrupted"}

    def test_a_file_of_another_interval_is_refused(self, study, optimal, tmp_path):
        path = tmp_path / "search.jsonl"
        study.optimal_curve((3000.0, 5000.0), 2, frequency=(290.0, 370.0), resume=path, check=False)
        with pytest.raises(BdamperError, match="frequency"):
            tolerance.with_ladder(study, replace(optimal, ladder=None), 0.05, resume=path)

    def test_without_check(self, study):
        assert study.optimal_curve((3000.0, 5000.0), 2, frequency=INTERVAL, check=False).ladder is None


@pytest.mark.parametrize(
    ("lower", "expected"),
    [
        ({110.0: 1.0, 100.0: 2.0, 120.0: 2.0}, []),  # nothing is lower than the optimum
        ({110.0: 1.0, 100.0: 0.9, 120.0: 2.0}, [90.0]),
        ({110.0: 1.0, 100.0: 0.9, 90.0: 1.1, 120.0: 2.0}, []),  # it is between two that are known
        ({110.0: 1.0, 100.0: 1.1, 120.0: 1.2, 200.0: 0.5}, [300.0]),  # 180 N is on the way from the optimum to it
        ({110.0: 1.0, 100.0: np.nan, 120.0: 0.9}, [180.0]),
        ({110.0: np.nan, 100.0: 0.9, 120.0: 1.0}, []),  # it is not known whether it is lower
    ],
)
def test_preloads_beside_a_lower_one_follow(lower, expected):
    grid = np.array([90.0, 100.0, 120.0, 180.0, 200.0, 300.0])
    assert tolerance._beyond(grid, 110.0, [Rung(3, p, a, 300.0) for p, a in lower.items()]) == expected


def ladder(*amplitudes, answer=1, others=(), **options):
    rungs = tuple(Rung(2 * i + 1, 100.0, a, 300.0) for i, a in enumerate(amplitudes))
    return Ladder(0.05, 100.0, answer, rungs, tuple(Rung(3, p, a, 300.0) for p, a in others), **options)


class TestClaims:
    """Amplitudes of 3, 5, 7 and 9 harmonics at 125 N and 500 N, and made-up ones."""

    def test_not_converged(self):
        found = ladder(0.0606, 0.0630, 0.0784, 0.0683)
        assert not found.converged and found.range == (0.0606, 0.0784)
        assert found.error == pytest.approx((0.0784 - 0.0606) / 0.0683)

    def test_converged(self):
        assert ladder(0.166, 0.167, 0.168).converged

    def test_answer_far_from_the_last_three(self):
        assert not ladder(0.10, 0.120, 0.121, 0.1205).converged
        assert ladder(0.10, 0.120, 0.121, 0.1205, answer=7).converged

    def test_two_are_too_few(self):
        assert not ladder(0.166, 0.166).converged
        assert not ladder(0.166, float("nan"), 0.166).converged

    def test_frequencies(self):
        rungs = tuple(Rung(n, 100.0, 1.0, f) for n, f in ((1, 300.0), (3, 310.0), (5, 324.0)))
        assert Ladder(0.05, 100.0, 5, rungs).converged
        assert not Ladder(0.05, 100.0, 5, rungs, by_frequency=True).converged

    @pytest.mark.parametrize(
        ("others", "expected"),
        [
            ([(90.0, 1.1), (110.0, 1.2)], None),
            ([(90.0, 0.9), (110.0, 1.2)], (0.0, 100.0)),
            ([(90.0, 1.1), (110.0, 0.9), (300.0, 2.0)], (100.0, 300.0)),
            ([(90.0, 1.1), (110.0, 0.99), (200.0, 0.9), (300.0, 2.0)], (100.0, 300.0)),
            ([(90.0, float("nan")), (110.0, 0.9)], (100.0, float("inf"))),
        ],
    )
    def test_preload_of_the_optimum(self, others, expected):
        found = ladder(1.02, 1.0, 1.0, others=others)
        assert found.preloads == expected
        assert ("the optimum lies" in found.note) == (expected is not None)


class TestSameSettings:
    """Richer answers differ in harmonics alone."""

    @pytest.fixture
    def model(self):
        """The disk without flexibility at the nodal diameter of the fifth harmonic."""
        model = bd.reference_model()
        blade = model.bodies["blade"]
        bases = {d: replace(b, flexibility=None) if d == 25 else b for d, b in blade.bases.items()}
        return replace(model, bodies=model.bodies | {"blade": replace(blade, bases=bases)})

    @pytest.mark.parametrize("method", [None, "residual_modes"])
    def test_contact_stiffness(self, model, method):
        study = bd.Study(model, bd.Excitation("tip"), 5, contact_stiffness=method)
        problems, why = tolerance._richer(study, 6)
        assert [p.harmonic_numbers[-1] for p in problems] == [3]
        assert "no 5 harmonics are possible with the same settings" in why and "flexib" in why


def test_estimates_of_falling_amplitudes():
    rungs = tuple(Rung(n, 1.0, a, 100.0) for n, a in ((1, 1.0), (3, 0.9), (5, 0.82), (7, 0.8)))
    found = Ladder(0.05, 1.0, 7, rungs).estimates([])["harmonics"]
    assert found.amplitude == pytest.approx(-0.125) and found.frequency == 0.0
    assert not Ladder(0.05, 1.0, 3, rungs[:2]).estimates([])["harmonics"].known


def test_a_ladder_by_frequency_tells_its_ends_apart():
    rungs = (Rung(1, 4e3, 1.2340e-3, 360.12), Rung(3, 4e3, 1.2352e-3, 360.31), Rung(5, 4e3, 1.2349e-3, 360.44))
    note = Ladder(0.0005, 4e3, 5, rungs, (), True).note
    assert "1.234 mm to 1.2352 mm" in note and "360.12 Hz to 360.44 Hz" in note
