"""Branches apart from the one that is followed, closed ones, and curves that the user stops."""

import os
import signal
import threading
from contextlib import contextmanager
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

import bdamper as bd
from bdamper import _core
from bdamper.harmonic_balance.equations import (
    NOT_CONVERGED,
    OK,
    Correction,
    Fold,
    InFrequency,
    Plane,
)
from bdamper.harmonic_balance.sector import excitation_ramp, reach, supported_by
from bdamper.response import branches, continuation
from bdamper.response import branches as start
from bdamper.response import response_curve as tracking
from bdamper.response.branches import (
    FEWEST_EVALUATIONS,
    MOST_EVALUATIONS,
    OPERATIONS,
    Coverage,
    Piece,
    SearchEnd,
    ending,
    evaluation_budget,
    in_order,
    uncovered,
)
from bdamper.response.continuation import follow
from bdamper.response.events import ContinuationOptions, Path
from bdamper.util.progress import CostMeter, _stop
from tests.following import find_start
from tests.hard.random_studies import oracle_residuals, random_study, tracked_curve
from tests.hard.test_case_04_17_folds_and_peaks import STUCK, followed, two_oscillators
from tests.models import acyclic_model, wedge_model
from tests.plain import plain_study
from tests.printed import said


def study(**settings):
    return plain_study(
        acyclic_model(1),
        engine_order=0,
        contact_stiffness="model",
        damping_ratio=0.02,
        excitation=bd.Excitation("tip", "tangential", 40.0),
        **settings,
    )


@pytest.mark.parametrize("after", [1, 12])
def test_interrupted_curves_keep_what_is_there(monkeypatch, tmp_path, after):
    seen = []

    @contextmanager
    def stop(*_):
        def update(point):
            seen.append(point)
            if len(seen) == after:
                raise KeyboardInterrupt

        yield update

    whole = study().frequency_response(200.0, (250.0, 450.0))
    monkeypatch.setattr(tracking, "progress_bar", stop)
    curve = study().frequency_response(200.0, (250.0, 450.0))
    assert curve.status == "interrupted"
    assert curve.reason == "by the user"
    assert not curve.complete
    assert after <= len(curve) < len(whole)
    np.testing.assert_array_equal(curve.unknowns, whole.unknowns[: len(curve)])
    curve.save(tmp_path / "curve.h5")
    assert bd.load(tmp_path / "curve.h5").status == "interrupted"


class Clock:
    """Ctrl-C at the n-th point that any path of the main thread accepts, where Ctrl-C arrives."""

    def __init__(self, monkeypatch, at):
        self.left = at
        inner = continuation.Follower.record

        def accept(follower, *args, **keywords):
            self.left -= threading.current_thread() is threading.main_thread()
            if self.left == 0:
                raise KeyboardInterrupt
            return inner(follower, *args, **keywords)

        monkeypatch.setattr(continuation.Follower, "record", accept)


@pytest.mark.slow
@pytest.mark.parametrize("at", [1, 30])
@pytest.mark.parametrize(
    "work",
    [
        lambda s: s.peak(200.0, (250.0, 450.0)),
        lambda s: s.effect_significance(200.0, (250.0, 450.0)),
        lambda s: bd.accuracy_cost(s, 200.0, (250.0, 450.0), vary={"harmonics": [1, 2]}),
    ],
    ids=["peak", "advice", "accuracy"],
)
def test_ctrl_c_ends_what_is_made_of_curves(monkeypatch, work, at):
    s = study()
    Clock(monkeypatch, at)
    with pytest.raises(KeyboardInterrupt):
        work(s)


@pytest.mark.parametrize("at", [1, 30])
def test_ctrl_c_ends_a_comparison_with_the_curve_that_it_interrupts(monkeypatch, at):
    one = study()
    Clock(monkeypatch, at)
    found = bd.compare(
        {"a": one, "b": {"friction_coefficient": 0.3}},
        lambda s: s.frequency_response(200.0, (250.0, 450.0)),
    )
    assert found.names == ("a",) and found.curves[0].interrupted


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("at", [1, 30])
def test_ctrl_c_ends_an_optimal_curve_whose_threads_are_at_work(monkeypatch, at):
    """No curve is finished: the signal comes at a point of any thread, and all threads end in their next correction."""
    points, ended, first, inner = count(1), [], threading.Event(), continuation.Follower.record

    def accept(*args, **keywords):
        point = next(points)
        if point == at:
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        if point >= at and _stop.get()[-1].wait(60.0):
            ended.append(point)
            first.set()
        return inner(*args, **keywords)

    monkeypatch.setattr(continuation.Follower, "record", accept)
    with pytest.raises(KeyboardInterrupt):
        study().optimal_curve((100.0, 400.0), 3, frequency=(250.0, 450.0), check=False)
    assert first.wait(60.0)  # a pool interrupted as it starts a thread does not wait for that one
    assert len(ended) <= 3 * (os.cpu_count() or 1)  # points between two corrections of each thread


def test_interrupted_sweep_does_its_points_when_it_is_resumed(monkeypatch, tmp_path):
    over, frequency, file = (
        {"preload": [200.0, 300.0, 400.0]},
        (250.0, 450.0),
        tmp_path / "sweep.jsonl",
    )
    whole = bd.sweep(study(), over, frequency=frequency)
    with monkeypatch.context() as patch:
        Clock(patch, 100)
        stopped = bd.sweep(study(), over, frequency=frequency, resume=file)
    assert "not run" in stopped.status
    resumed = bd.sweep(study(), over, frequency=frequency, resume=file)
    assert resumed.complete
    assert [v["amplitude"] for v in resumed.values] == [v["amplitude"] for v in whole.values]


def test_ctrl_c_in_the_chain_of_a_start_is_not_a_stage_that_failed(monkeypatch):
    """Raising the excitation is interrupted: no other stage may be tried after it."""
    s, preload, interval = random_study(1889)
    Clock(monkeypatch, 1)
    curve = s.frequency_response(preload, interval)
    assert curve.status == "interrupted"
    assert not any("fading supports" in line for line in curve.start_log)


def test_interrupted_before_the_first_point(monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    s = study()
    monkeypatch.setattr("bdamper.response.response_curve.first_point", stop)
    curve = s.frequency_response(200.0, (250.0, 450.0))
    assert curve.status == "interrupted"
    assert len(curve) == 0
    assert "interrupted" in curve.summary()


class Ellipse:
    """Equations of one unknown u whose solutions are ``(u - 2)^2 + (omega - 10)^2/4 = 1``."""

    n_mean, n_unknowns, watched, n_harmonics, supported, spent = 0, 1, (), 1, False, False
    measure = InFrequency(0)
    rows = property(lambda self: self)

    @staticmethod
    def residual(y):
        return (y[0] - 2.0) ** 2 + 0.25 * (y[1] - 10.0) ** 2 - 1.0

    @staticmethod
    def gradient(y):
        return np.array([2.0 * (y[0] - 2.0), 0.5 * (y[1] - 10.0)])

    def with_share(self, share):
        return self

    def squared_gradient(self, y):
        return np.array([y[0], 0.0]), y[0] ** 2

    def on_plane(self, y, normal, scale, tolerance, max_iterations, reach=0.0):
        y = np.array(y, float)
        for iterations in range(max_iterations):
            A = np.array([self.gradient(y) * scale, normal])
            if abs(self.residual(y)) <= tolerance:
                t = np.linalg.solve(A, [0.0, 1.0])
                orientation = int(np.sign(np.linalg.det(np.array([A[0], t]))))
                t /= np.linalg.norm(t)
                return Correction(
                    OK, y, t, scale, iterations, abs(self.residual(y)), 0, orientation=orientation
                )
            step = np.linalg.solve(A, [self.residual(y), 0.0])
            if reach and np.linalg.norm(step) > reach:
                break
            y = y - scale * step
        return Correction(NOT_CONVERGED, y, np.zeros(2), scale, max_iterations, np.inf, 0)

    def correct_at(self, u, omega, scale, tolerance, max_iterations, line_search=False):
        return self.on_plane(
            np.append(u, omega), np.array([0.0, 1.0]), scale, tolerance, max_iterations
        )

    def solve(self, y, condition, scale, tolerance, max_iterations, reach=0.0):
        """To a fold, where the gradient has no part along u, or a peak, where it has none along omega."""
        if isinstance(condition, Plane):
            return self.on_plane(y, condition.normal, scale, tolerance, max_iterations, reach)
        y, along = np.array(y, float), 0 if isinstance(condition, Fold) else 1
        for _ in range(max_iterations):
            gradient = self.gradient(y)
            if max(abs(self.residual(y)), abs(gradient[along])) <= tolerance:
                return self.on_plane(y, condition.tangent, scale, tolerance, max_iterations)
            bend = np.diag([2.0, 0.5])[along]
            y = y - np.linalg.solve(np.array([gradient, bend]), [self.residual(y), gradient[along]])
        return Correction(NOT_CONVERGED, y, np.zeros(2), scale, max_iterations, np.inf, 0)


@pytest.mark.parametrize("up", [True, False])
def test_a_closed_branch_is_followed_once_round(up):
    path = follow(Ellipse(), np.array([2.9, 10.5]), (5.0, 15.0), up=up)
    assert path.status == "closed"
    y = np.array([p.y for p in path.points])
    angle = np.unwrap(np.arctan2(y[:, 0] - 2.0, 0.5 * (y[:, 1] - 10.0)))
    assert abs(abs(angle[-1] - angle[0]) - 2 * np.pi) < 0.3
    assert (np.diff(angle) < 0).all() or (np.diff(angle) > 0).all()
    folds = sorted(p.y[1] for p in path.points if p.kind == "fold")
    np.testing.assert_allclose(folds, [8.0, 12.0], atol=1e-8)
    piece = Piece(path, up, inside=True)
    assert ending([piece], 8.0, 12.0).status == "complete"
    assert ending([piece], 5.0, 15.0).status == "incomplete"


@pytest.mark.parametrize("up", [True, False])
def test_a_path_from_within_makes_progress_to_both_sides(up):
    """It turns soon, and runs on to the other side; all that is no tangle, the rest of the way round is one."""
    start = np.array([2.0 + np.sqrt(1.0 - 0.25 * 1.6**2), 11.6 if up else 8.4])
    whole = follow(Ellipse(), start, (5.0, 15.0), up=up)
    assert whole.status == "closed"
    turned = next(i for i, p in enumerate(whole.points) if p.kind == "fold")
    patience = int(0.6 * (len(whole.points) - turned))
    path = follow(
        Ellipse(), start, (5.0, 15.0), up=up, options=ContinuationOptions(patience=patience)
    )
    assert path.status == "closed" and len(path.points) == len(whole.points)
    assert len(path.points) - turned > patience
    short = follow(
        Ellipse(), start, (5.0, 15.0), up=up, options=ContinuationOptions(patience=patience // 3)
    )
    assert short.status == "many folds"
    assert min(p.y[1] for p in short.points) < 8.1 and max(p.y[1] for p in short.points) > 11.9
    assert short.tangle is not None and 7.99 < short.tangle[0] < short.tangle[1] < 12.01


def test_a_gap_between_known_solutions_is_filled():
    system = two_oscillators(5)
    path = followed(system, 1.0, 3.5, STUCK)
    low = tuple(p for p in path.points if p.y[-1] < 2.5)
    high = tuple(p for p in path.points if p.y[-1] > 2.8)
    pieces = [
        Piece(replace(path, points=points, status="stalled", reason="cut off"), True, branch)
        for branch, points in enumerate((low, high))
    ]
    assert ending(pieces, 1.0, 3.5).status == "incomplete"
    search = Coverage(system, (1.0, 3.5), ContinuationOptions(), CostMeter(), pieces=pieces)
    search.fill(lambda omega: None)
    assert len(search.log) == 1
    assert not uncovered(pieces, 1.0, 3.5)


@pytest.mark.slow
@pytest.mark.parametrize(("gap", "status"), [(0.9e-3, "complete"), (1.1e-3, "incomplete")])
def test_what_was_not_followed_is_data(gap, status, tmp_path):
    """A path that ended in a tangle, a gap beyond it, a path that broke off: each is left out, with its place."""
    path = followed(two_oscillators(5), 1.0, 3.5, STUCK)
    some = path.points[0]
    gap *= 2.5  # width of the interval

    def part(a, b, **how):
        points = tuple(replace(some, y=np.append(some.y[:-1], omega)) for omega in (a, b))
        return replace(path, points=points, reason="told", **how)

    pieces = [
        Piece(part(1.0, 2.0, status="many folds", tangle=(1.7, 1.9)), True),
        Piece(part(2.0 + gap, 3.0, status="stalled"), True, 1, True),
        Piece(part(3.5, 2.9, status="drifted off"), False, 2),
    ]
    end = ending(pieces, 1.0, 3.5)
    assert end.status == status
    left = end.missing_ranges
    hertz = 1.0 / (2.0 * np.pi)
    expected = [
        (1.7, 1.9, "many folds: told"),
        (2.0, 2.0 + gap, "no solution found"),
        (2.9, 2.9, "drifted off: told"),
        (3.0, 3.0, "stalled: told"),
    ]
    assert [entry.why for entry in left] == [why for *_, why in expected]
    np.testing.assert_allclose(
        [entry[:2] for entry in left], [[a * hertz, b * hertz] for a, b, _ in expected], rtol=1e-12
    )
    whole_path = ending([Piece(path, True)], 1.0, 3.5)
    assert whole_path == SearchEnd("complete", path.reason, ())

    whole = study().frequency_response(200.0, (250.0, 450.0))
    assert whole.missing_ranges == ()
    assert "missing range" not in whole.summary()
    curve = replace(whole, missing_ranges=left)
    told = [fact.value for fact in curve._facts() if fact.name.startswith("missing ranges ")]
    assert (
        told == [str(part) for part in left] and f"{2.9 * hertz:.6g} Hz: drifted off: told" in told
    )
    assert all(text in curve.summary() for text in told)
    curve.save(tmp_path / "curve.h5")
    assert bd.load(tmp_path / "curve.h5").missing_ranges == left
    labels = [text.get_text() for text in curve.plot().axes[0].get_legend().get_texts()]
    assert "not computed" in labels
    assert "not computed" not in [
        text.get_text() for text in whole.plot().axes[0].get_legend().get_texts()
    ]


def test_support_is_drag_on_the_vibration_and_spring_on_the_mean_of_free_bodies():
    s = study(harmonics=2)
    system, omega = s.problem.system(200.0), 2.0 * np.pi * 300.0
    drag, spring, part = 0.7, 0.2, 0.25
    held = supported_by(system, omega, drag, spring)
    bases = s.problem.bases
    free = [
        np.array([c.body == "damper" and c.name in bd.RIGID_NAMES for c in b.coordinates])
        for b in bases
    ]
    share = 1.0 / part - 1.0
    arrays = dict(system.structure.arrays)
    arrays["damping"] = arrays["damping"] + share * drag * omega * np.concatenate(
        [0.0 * free[0], *free[1:]]
    )
    arrays["stiffness"] = arrays["stiffness"] + share * spring * omega**2 * np.concatenate(
        [free[0], *(0.0 * f for f in free[1:])]
    )
    other = _core.SectorEquations(**arrays)
    n = system.n_unknowns
    y = np.append(1e-5 * np.random.default_rng(0).normal(size=n), part)
    r, J = np.empty(n), np.empty((n, n))
    assert other.evaluate(np.append(y[:-1], omega), r, J) == OK
    _, got, by_part = held.evaluate_at(y)
    np.testing.assert_allclose(got, J, rtol=0, atol=1e-12 * np.abs(J).max())
    # with respect to the parameter: differences of the residual
    support = held.evaluate_at(np.append(y[:-1], 0.5))[1] - system.evaluate(y[:-1], omega)[1]
    ramp = excitation_ramp(system, omega).evaluate_at(y)[2]
    assert np.abs(ramp).max() > 0.0
    h = 1e-6
    slope = (1.0 / (part + h) - 1.0 / (part - h)) / (2.0 * h) * support @ y[:-1] + ramp
    np.testing.assert_allclose(by_part, slope, rtol=0, atol=1e-6 * np.abs(slope).max())


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "wide"), [(1889, False), (127, True)])
def test_a_support_that_fades_where_nothing_else_starts(seed, wide, monkeypatch):
    """Shrouds that just touch, and a damper thrown about by 16 times its preload."""
    s, preload, interval = random_study(seed, wide)
    curve = tracked_curve(s, preload, interval)
    assert curve.complete
    assert any("fading supports: removed" in line for line in curve.start_log)
    error, rounding = oracle_residuals(s, preload, curve)
    assert (error <= 1e-9 + rounding).all()
    homotopy, cut_off = start._homotopy, Path((), "too many points", "cut off", 0, 0)
    monkeypatch.setattr(
        start,
        "_homotopy",
        lambda system, *args: cut_off if system.supported else homotopy(system, *args),
    )
    assert not tracked_curve(s, preload, interval).complete


def reference_study(**settings):
    settings = {"engine_order": 5, "friction_coefficient": 0.3, **settings}
    return plain_study(
        bd.reference_model(contact_points=24), excitation=bd.Excitation("tip"), **settings
    )


@pytest.mark.slow
@pytest.mark.parametrize(("preload", "interval"), [(25e3, (320.0, 400.0)), (5.0, (340.0, 420.0))])
def test_no_point_runs_backward_where_there_is_no_fold(preload, interval):
    """The last point and walks at one frequency included."""
    curve = reference_study().frequency_response(preload, interval)
    assert curve.complete
    through = [
        b for b in np.unique(curve.branch) if np.ptp(curve.frequency[curve.branch == b]) > 79.9
    ]
    assert len(through) == 1  # at 5 N paths outside may come back with folds of their own
    own = curve.branch == through[0]
    assert "fold" not in np.array(curve.point_kind)[own]
    assert not curve.backward[own].any()


def test_points_run_backward_between_two_folds():
    curve = reference_study().frequency_response(3000.0, (282.6, 424.0))
    at = sorted(i for i, kind in enumerate(curve.point_kind) if kind == "fold")
    assert len(at) == 2
    expected = np.zeros(len(curve), bool)
    expected[at[0] + 1 : at[1]] = True
    regular = np.ones(len(curve), bool)
    regular[at] = False  # at a fold itself the sense is that of rounding
    np.testing.assert_array_equal(curve.backward[regular], expected[regular])


@pytest.mark.slow
def test_maximum_in_the_step_that_leaves_the_interval():
    """The last step goes from 438 to 450 Hz, the maximum lies at 439.4 Hz."""
    s = plain_study(
        wedge_model(4699, 13, 4, n_points=4, n_blade_modes=2),
        bd.Excitation("tip", "tangential", 2.752413022050164),
        engine_order=4,
        friction_coefficient=0.44639773708578157,
        contact_stiffness="model",
        damping_ratio=0.0017428106690244361,
    )
    preload, interval = 11.009652088200657, (200.0, 450.0)
    curve = s.frequency_response(preload, interval)
    assert "maximum" in curve.point_kind
    fine = s.frequency_response(
        preload, interval, options=ContinuationOptions(step=0.01, max_step=0.02)
    )
    assert curve.peak.frequency == pytest.approx(fine.peak.frequency, rel=1e-9)
    assert s.peak(preload, interval).amplitude == pytest.approx(fine.peak.amplitude, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("bound", [353.47, 354.0, 354.3])
def test_a_branch_that_turns_outside_the_interval_comes_back_into_it(bound):
    """At 3 kN the reference model folds at 354.34 Hz; the peak at 353.23 Hz lies behind the fold.

    Within the interval no sweep comes to it: it is named, and no peak.
    """
    s = reference_study()
    whole = s.frequency_response(3000.0, (282.6, 424.0))
    assert whole.frequency[whole.folds[0]] == pytest.approx(354.340, abs=1e-3)
    curve = s.frequency_response(3000.0, (282.6, bound))
    assert curve.complete
    assert curve.frequency.max() <= bound * (1.0 + 1e-12)
    assert curve.amplitude[curve.separate] == pytest.approx([whole.peak.amplitude], rel=1e-9)
    assert curve.peak_at_end and "widen the interval" in said(curve)
    peak = s.peak(3000.0, (282.6, bound))
    assert not peak.ok and peak.status == peak.search_status and "widen the interval" in said(peak)
    assert peak.lower_bound == pytest.approx(whole.peak.amplitude, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "preload", "band", "amplitude"),
    [
        ({"friction_coefficient": 0.4}, 125.0, (295.0, 320.0), 0.20259e-3),
        ({"friction_coefficient": 0.5}, 84.0, (281.0, 303.0), None),
        ({"friction_coefficient": 0.4, "harmonics": 3}, 565.0, (335.7, 345.5), 0.178e-3),
    ],
)
def test_a_narrow_band_shows_the_resonance_that_passes_through_it(
    settings, preload, band, amplitude
):
    """The upper branch enters and leaves at the upper end; the folds that lead to it lie far outside."""
    s = plain_study(
        bd.reference_model(), excitation=bd.Excitation("tip"), engine_order=5, **settings
    )
    whole, narrow = (
        s.frequency_response(preload, (233.0, 407.0)),
        s.frequency_response(preload, band),
    )
    assert band[0] < whole.peak.frequency < band[1]
    assert narrow.complete
    assert (narrow.frequency.min(), narrow.frequency.max()) == pytest.approx(band, rel=1e-12)
    (separate,) = narrow.separate
    height = narrow.amplitude[separate]
    assert height == pytest.approx(whole.peak.amplitude, rel=1e-8)
    assert amplitude is None or height == pytest.approx(amplitude, rel=1e-2)
    assert height > 2.0 * narrow.peak.amplitude and "widen the interval" in said(narrow)
    assert "; folds looked for from 274.59 to 367.37 Hz" in narrow.reason
    assert narrow.reason.endswith("closed branches not")


def test_where_branches_may_turn():
    """Between the free and the stuck resonance of a mode, and a little beyond; modes may shift past each other."""
    free, stuck = [280.0, 600.0], [360.0, 640.0]
    assert reach(free, stuck, 300.0, 320.0) == pytest.approx((0.97 * 280.0, 1.03 * 360.0))
    assert reach(free, stuck, 282.0, 365.0) == pytest.approx((0.97 * 280.0, 1.03 * 360.0))
    assert reach(free, stuck, 275.0, 300.0) == pytest.approx((0.97 * 280.0, 1.03 * 360.0))
    assert reach(free, stuck, 250.0, 400.0) == (250.0, 400.0)
    assert reach(free, stuck, 400.0, 500.0) == (400.0, 500.0)
    assert reach(free, stuck, 400.0, 620.0) == pytest.approx((400.0, 1.03 * 640.0))
    assert reach([], [], 400.0, 500.0) == (400.0, 500.0)
    assert reach([1210.0, 1393.0], [1396.0, 1468.0], 1450.0, 1460.0) == pytest.approx(
        (0.97 * 1393.0, 1.03 * 1468.0)
    )


def test_a_path_that_breaks_off_outside_the_interval_is_told(monkeypatch):
    """It might have come back into it with a higher branch."""
    monkeypatch.setattr(branches, "SIDE_POINTS", 5)
    s = plain_study(
        bd.reference_model(),
        excitation=bd.Excitation("tip"),
        engine_order=5,
        friction_coefficient=0.4,
    )
    curve = s.frequency_response(125.0, (295.0, 320.0))
    assert curve.complete and not len(curve.folds)
    assert [part.why.split(":")[0] for part in curve.missing_ranges] == [
        "outside the interval, too many points"
    ]
    assert not any(295.0 < part.low < 320.0 for part in curve.missing_ranges)


class Unsolvable(Ellipse):
    def correct_at(self, u, omega, *args, **named):
        return Correction(NOT_CONVERGED, np.append(u, omega), np.zeros(2), np.ones(2), 1, np.inf, 0)


def span(low, high, branch):
    points = tuple(
        Correction(OK, np.array([1.0, w]), np.ones(2), np.ones(2), 1, 0.0, 0) for w in (low, high)
    )
    return Piece(Path(points, "many folds", "cut off", 0, 0), True, branch)


def test_places_in_a_gap_are_asked_once_the_widest_gap_first():
    pieces = [span(1.0, 2.0, 0), span(2.05, 3.0, 1), span(3.2, 3.5, 2)]
    search = Coverage(Unsolvable(), (1.0, 3.5), ContinuationOptions(), CostMeter(), pieces=pieces)
    seen = []
    search.fill(seen.append)
    np.testing.assert_allclose(seen, [3.1, 3.04, 3.16, 2.025, 2.01, 2.04])


def test_what_is_found_in_a_gap_makes_other_gaps_of_it(monkeypatch):
    pieces = [span(1.0, 2.0, 0), span(2.1, 3.5, 1)]
    search = Coverage(Unsolvable(), (1.0, 3.5), ContinuationOptions(), CostMeter(), pieces=pieces)
    monkeypatch.setattr(search, "both_ways", lambda y: pieces.append(span(2.05, 2.1, 2)))
    seen = []

    def ask(omega):
        seen.append(omega)
        return np.array([1.0, omega]) if len(seen) == 2 else None

    search.fill(ask)
    np.testing.assert_allclose(seen, [2.05, 2.02, 2.025, 2.01, 2.04])


def test_gaps_are_left_when_the_budget_is_used_up():
    pieces = [span(1.0, 2.0, 0), span(2.05, 3.0, 1), span(3.2, 3.5, 2)]
    system = Unsolvable()
    search = Coverage(system, (1.0, 3.5), ContinuationOptions(), CostMeter(), pieces=pieces)
    seen = []

    def ask(omega):
        seen.append(omega)
        system.spent = True

    search.fill(ask)
    assert 1 <= len(seen) <= 3
    assert max(abs(omega - 3.1) for omega in seen) < 0.1


@pytest.mark.parametrize("budget", [40, 150, 400])
def test_a_curve_ends_with_what_it_has_when_its_budget_is_used_up(budget):
    """It says so, names what is left out and what to do, and takes no more than the correction it was at."""
    s = study()
    curve = s.frequency_response(200.0, (250.0, 450.0), options=ContinuationOptions(budget=budget))
    whole = s.frequency_response(200.0, (250.0, 450.0))
    assert whole.complete and whole.cost.evaluations > 400
    assert curve.status == "incomplete"
    assert 0.9 * budget <= curve.cost.evaluations <= budget + 100
    assert curve.settings["continuation"]["budget"] == budget
    assert f"the budget was {budget} evaluations" in curve.reason
    assert "did not converge" not in curve.reason  # a step that was not tried has not failed
    assert "study.motion_in_time" in curve.reason
    assert "no solution found" in [part.why for part in curve.missing_ranges]
    first = curve.unknowns[curve.branch == 0]
    assert len(first) > 3
    np.testing.assert_array_equal(first, whole.unknowns[: len(first)])


def test_the_budget_is_set_by_the_sizes_of_the_problem_and_stands_in_the_result():
    small, large = study(), study(harmonics=7)
    budgets = [evaluation_budget(s.problem.system(200.0)) for s in (small, large)]
    assert FEWEST_EVALUATIONS <= budgets[1] < budgets[0] <= MOST_EVALUATIONS
    assert (
        small.frequency_response(200.0, (250.0, 260.0)).settings["continuation"]["budget"]
        == budgets[0]
    )
    for s, budget in zip((small, large), budgets):
        work = float(s.problem.system(200.0).work[:3].sum())
        assert budget in (FEWEST_EVALUATIONS, MOST_EVALUATIONS) or budget * work == pytest.approx(
            OPERATIONS, rel=1e-3
        )


def test_the_chain_of_the_first_point_says_what_was_tried(monkeypatch):
    s, preload, _ = random_study(3)
    correct_at = start.Equations.correct_at
    asked = []

    def cut_off(system, y, options, meter):
        asked.append((system.supported, options.patience, options.max_turn))
        return Path((), "too many points", "cut off", 0, 0)

    def only_on_a_support(self, u, omega, scale, *args, **named):
        c = correct_at(self, u, omega, scale, *args, **named)
        return c if self.supported else replace(c, status=NOT_CONVERGED)

    monkeypatch.setattr(start, "_homotopy", cut_off)
    monkeypatch.setattr(start.Equations, "correct_at", only_on_a_support)
    found, log = find_start(
        s.problem, preload, 2.0 * np.pi * 300.0, ContinuationOptions(), CostMeter()
    )
    assert found is None
    assert asked == [(False, 400, 0.45), (True, start.SIDE_POINTS, 0.45)]
    assert [line.split(":")[0] for line in log[1:4]] == [
        "Newton from the stuck response", "Newton with line search from the stuck response", "excitation ramp"
    ]  # fmt: skip
    assert log[4] == "fading supports: not removed after 0 of 1000 points (too many points)"


def test_both_ways_from_a_solution_make_one_branch():
    """Its points follow each other; the solution itself counts once and is no end."""
    path = {
        up: follow(Ellipse(), np.array([3.0, 10.0]), (8.5, 11.0), up=up) for up in (True, False)
    }
    assert {p.status for p in path.values()} == {"complete"}
    other = Piece(path[True], True, branch=0)
    ways = [Piece(path[up], up, branch=1, inside=True) for up in (True, False)]
    ordered = in_order([other, *ways])
    assert [p for p, _ in ordered[: len(path[True].points)]] == list(path[True].points)
    omega = np.array([p.y[1] for p, piece in ordered if piece.branch == 1])
    assert len(omega) == len(path[True].points) + len(path[False].points) - 1
    assert (np.diff(omega) > 0.0).all() and omega[0] == 8.5 and omega[-1] == 11.0
    assert [p.kind for p, piece in ordered if piece.branch == 1 and p.kind == "end"] == [
        "end",
        "end",
    ]
    assert [piece.up for p, piece in ordered if piece.branch == 1 and p.y[1] < 10.0] == [
        False
    ] * int(sum(omega < 10.0))
    assert len(in_order(ways[:1])) == len(path[True].points) and in_order([]) == []
