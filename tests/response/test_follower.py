"""Single decisions of the continuation on curves that are known in closed form."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.equations import NOT_CONVERGED, OK, Correction, InFrequency, Plane
from bdamper.response.continuation import Follower, follow
from bdamper.response.events import ContinuationOptions, Events
from bdamper.response.response_curve import frequency_response
from tests.plain import plain_study


class Equations:
    """Equations in closed form, with Newton's method in scaled unknowns as the core has it."""

    n_mean, n_unknowns, watched, n_harmonics, supported, spent = 0, 1, (), 1, False, False

    @property
    def measure(self):
        return InFrequency(self.n_mean)

    @property
    def rows(self):
        return self

    def squared_gradient(self, y):
        return y[self.n_mean] * np.eye(len(y))[self.n_mean], y[self.n_mean] ** 2

    def solve(self, y, condition, scale, tolerance, max_iterations, line_search=False, reach=0.0):
        if not isinstance(condition, Plane):
            return Correction(NOT_CONVERGED, y, condition.tangent, scale, 0, np.inf, 0)
        y, n, normal = np.array(y, float), self.n_unknowns, condition.normal
        right = np.append(np.zeros(n), 1.0)
        for iterations in range(max_iterations):
            A = np.vstack([self.jacobian(y) * scale, normal])
            r = self.residual(y)
            if np.abs(r).max() <= tolerance:
                t = np.linalg.solve(A, right)
                t /= np.linalg.norm(t)
                sign = int(np.sign(np.linalg.det(np.vstack([A[:n], t]))))
                return Correction(
                    OK, y, t, scale, iterations, float(np.abs(r).max()), 0, orientation=sign
                )
            step = np.linalg.solve(A, np.append(r, 0.0))
            if reach and np.linalg.norm(step) > reach:
                break
            y = y - scale * step
        return Correction(NOT_CONVERGED, y, np.zeros(n + 1), scale, max_iterations, np.inf, 0)

    def correct_at(self, u, omega, scale, tolerance, max_iterations, line_search=False):
        return self.solve(
            np.append(u, omega),
            Plane(np.eye(self.n_unknowns + 1)[-1]),
            scale,
            tolerance,
            max_iterations,
        )


class Beside(Equations):
    """Two curves, ``u = 2 - (omega - 10)^2/4`` and one above it that runs the other way: ``det J`` has the other sign."""

    def __init__(self, gap):
        self.gap = gap

    def lower(self, omega):
        return 2.0 - 0.25 * (omega - 10.0) ** 2

    def residual(self, y):
        d = y[0] - self.lower(y[1])
        return np.array([d * (d - self.gap)])

    def jacobian(self, y):
        d = y[0] - self.lower(y[1])
        by_d = 2.0 * d - self.gap
        return np.array([[by_d, by_d * 0.5 * (y[1] - 10.0)]])


def test_a_part_of_the_curve_that_runs_the_other_way_is_refused():
    """The step along the tangent ends right on it: near the prediction, in the same direction, and not the same curve."""
    step = 0.1
    system = Beside(0.25 * step**2)
    start = np.array([2.0, 10.0])
    follower = Follower(system, (9.0, 11.0), ContinuationOptions(), None)
    scale = follower.scale_at(start)
    assert scale[-1] == 1.0
    first = system.correct_at(start[:-1], 10.0, scale, 1e-12, 5)
    follower.sign = first.orientation
    here = replace(first, y=start)
    found, why = follower.try_step(here, step)
    assert found.status == OK
    assert found.orientation == -first.orientation
    assert why == "orientation of the curve changed"
    # without a sense of the curve it is taken
    follower.sign = 0
    assert follower.try_step(here, step)[1] == ""


class FarAtTheEnd(Equations):
    """A straight line, and at fixed frequency a solution elsewhere."""

    def __init__(self, distance):
        self.distance = distance

    def residual(self, y):
        return np.array([y[0] - 1.0])

    def jacobian(self, y):
        return np.array([[1.0, 0.0]])

    def correct_at(self, u, omega, scale, tolerance, max_iterations, line_search=False):
        c = super().correct_at(u, omega, scale, tolerance, max_iterations)
        return c if omega < 11.0 else replace(c, y=c.y + [self.distance, 0.0])


@pytest.mark.parametrize(("distance", "ends"), [(0.9, True), (1.1, False)])
def test_the_end_of_the_interval_is_where_the_curve_leads(distance, ends):
    """A solution at the last frequency, farther off than the vibration is large, is no end of this curve."""
    path = follow(FarAtTheEnd(distance), np.array([1.0, 9.0]), (9.0, 11.0))
    assert (path.status == "complete") == ends
    assert (path.points[-1].y[-1] == 11.0) == ends
    if not ends:
        assert path.status == "stalled"
        assert "no solution at" in path.reason


class Drifts(Equations):
    """``u = 1``, ``omega = 2 - exp(-m)``: the mean m moves without bound while the frequency stays."""

    n_mean, n_unknowns = 1, 2

    def residual(self, y):
        return np.array([y[2] - 2.0 + np.exp(-y[0]), y[1] - 1.0])

    def jacobian(self, y):
        return np.array([[-np.exp(-y[0]), 0.0, 1.0], [0.0, 1.0, 0.0]])


def test_a_drift_without_end_is_left_a_million_vibrations_away():
    path = follow(
        Drifts(), np.array([0.0, 1.0, 1.0]), (0.5, 3.0), options=ContinuationOptions(max_points=200)
    )
    assert path.status == "drifted off"
    assert "moves without bound" in path.reason
    away = np.array([abs(p.y[0]) for p in path.points])
    assert away[-1] > 1e6
    assert away[-2] <= 1e6
    assert path.points[-1].kind == "drift"
    assert path.points[-1].y[-1] == pytest.approx(2.0, abs=1e-9)


@pytest.mark.parametrize(
    ("preload", "points", "most_evaluations", "most_factorisations"),
    [(200.0, 97, 611, 600), (2000.0, 83, 413, 402)],
)
def test_points_and_evaluations_of_plain_curves(
    preload, points, most_evaluations, most_factorisations
):
    """Counts, not times: steps grow as they may, the predictor is the tangent, events are located in few trials."""
    study = plain_study(
        bd.reference_model("bladed_disk", 9), engine_order=5, friction_coefficient=0.4,
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )  # fmt: skip
    # without the verdict, which follows curves at lower preloads as well
    curve = frequency_response(study.problem, preload, (250.0, 400.0))
    assert curve.complete
    assert abs(len(curve) - points) <= 3
    assert 0.9 * most_evaluations <= curve.cost.evaluations <= 1.02 * most_evaluations
    assert 0.9 * most_factorisations <= curve.cost.factorisations <= 1.02 * most_factorisations
    assert curve.cost.iterations <= 6.1 * len(curve)


@pytest.mark.parametrize(("off", "refused"), [(0.4, False), (0.6, True)])
def test_a_solution_half_a_step_from_its_prediction_is_refused(off, refused):
    step = 0.1
    system = FarAtTheEnd(0.0)
    follower = Follower(system, (9.0, 11.0), ContinuationOptions())
    y, tangent, scale = np.array([1.0, 10.0]), np.array([0.0, 1.0]), np.ones(2)
    system.solve = lambda guess, *_, **__: Correction(
        OK, guess + [off * step, 0.0], tangent, scale, 1, 0.0, 0
    )
    why = follower.try_step(Correction(OK, y, tangent, scale, 0, 0.0, 0), step)[1]
    assert (why == "solution far from its prediction") == refused


@pytest.mark.parametrize(("off", "refused"), [(0.2, False), (0.3, True)])
def test_a_solution_beyond_a_corner_is_within_half_the_way_from_it(off, refused):
    """Half of the way is 0.25 for the longest one; the corner itself is known to 1/128 of the step."""
    step, corner = 1.0, 10.6
    system = FarAtTheEnd(0.0)
    before, beyond = np.array([0.0, 1.0]), np.array([np.sin(0.9), np.cos(0.9)])
    scale = np.ones(2)

    def solve(guess, condition, *_, tolerance=None, **__):
        """The null vector at any point, or a solution beside the guess."""
        tangent = beyond if guess[1] > corner else before
        beside = 0.0 if tolerance else off
        y = guess + beside * np.array([beyond[1], -beyond[0]])
        return Correction(OK, y, tangent, scale, 1, 0.0, 0, orientation=1)

    system.solve = solve
    here = Correction(OK, np.array([1.0, 10.0]), before, scale, 0, 0.0, 0, orientation=1)
    found = Events(system, ContinuationOptions()).around_corner(here, step, sign=1)
    assert (found is None) == refused


@pytest.mark.parametrize(("beside", "closes"), [(0.04, True), (0.06, False)])
def test_a_path_closes_only_through_its_first_point(beside, closes):
    """A branch that runs beside its first point at a twentieth of the step is another turn of it."""
    follower = Follower(FarAtTheEnd(0.0), (9.0, 11.0), ContinuationOptions())
    first = np.array([1.0, 10.0])
    follower.points = [Correction(OK, first, np.array([0.0, 1.0]), np.ones(2), 1, 0.0, 0)]
    before, after = first + [0.1 * beside, -0.05], first + [0.1 * beside, 0.05]
    new = Correction(OK, after, np.array([0.0, 1.0]), np.ones(2), 1, 0.0, 0)
    assert follower._closes(before, new) == closes


def test_on_a_support_a_drift_ends_a_hundred_vibrations_away():
    system = Drifts()
    system.supported = True
    path = follow(
        system, np.array([0.0, 1.0, 1.0]), (0.5, 3.0), options=ContinuationOptions(max_points=200)
    )
    assert path.status == "drifted off"
    away = np.array([abs(p.y[0]) for p in path.points])
    assert 1e2 < away[-1] < 1e6
    assert away[-2] <= 1e2


@pytest.mark.parametrize(("far", "status"), [(900.0, "stalled"), (1100.0, "drifted off")])
def test_a_drift_that_stops_a_thousand_vibrations_away_has_drifted_off(far, status):
    """Forces of a body so far away are differences of large numbers, in which Newton's method stops."""

    class Stops(Drifts):
        def solve(self, y, *rest, **limits):
            found = super().solve(y, *rest, **limits)
            return found if found.y[0] < far else replace(found, status=NOT_CONVERGED)

    path = follow(
        Stops(), np.array([0.0, 1.0, 1.0]), (0.5, 3.0), options=ContinuationOptions(max_points=200)
    )
    assert path.points[-1].y[0] == pytest.approx(far, rel=1e-4)
    assert path.status == status


@pytest.mark.parametrize("wrong", [{"step": 0.5}, {"min_step": 0.1}])
def test_steps_are_in_order(wrong):
    with pytest.raises(bd.SettingError, match="steps: expected"):
        ContinuationOptions(**wrong)
