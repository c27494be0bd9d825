"""The run-up along the line of an engine order: one curve over rotor speed, at the preload of each speed."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.follower import TWO_PI
from bdamper.continuation.path import ContinuationOptions
from bdamper.problem.at_speed import RPM, Conditions, asked_speeds
from bdamper.problem.problem import Problem
from bdamper.speed.crossings import OverSpeed, speed_values
from bdamper.speed.family import SpeedFamily
from bdamper.speed.line import CLOSE, Line, exact, follow_line, interval
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, CostMeter
from bdamper.util.differences import Comparable
from bdamper.util.errors import BdamperError
from bdamper.util.hdf5 import Formerly, Recorded, Storable
from bdamper.util.plotting import Fact, Plottable
from bdamper.util.repr import brief
from bdamper.util.status import COMPLETE, INCOMPLETE, because
from bdamper.util.tables import Hertz, Metres, RadiansPerSecond, Shares, Tabular
from bdamper.util.text import amount, percent

WITHIN = (50.0, 2000.0)
"""Speeds (rad/s) between which a crossing is looked for if none are given."""

BESIDE = ", no peak at fixed speed beside it lies on the line"


@brief
@dataclass(frozen=True)
class RunUp(OverSpeed, Plottable, Comparable, Tabular, Recorded, Storable, kind="bdamper-run-up"):
    """Response along the line of an engine order.

    ``plot`` draws amplitude over speed (:func:`bdamper.plot.plot_run_up`).

    Parameters
    ----------
    engine_order : int
    speed : (n,) float, rad/s
        In the order of the path, through folds.
    amplitude : (n,) float, m
    shares : (n, 3) float
        Stick, slip and open.
    residual : (n,) float
    point_kind : tuple of str
        "maximum", "fold" and others as of a tracking curve.
    peak_speed, peak_amplitude : float, rad/s and m
        The highest point along the line, which is no end of it.
    fixed_speed, fixed_speed_amplitude : float, rad/s and m
        The peak at fixed speed beside it, over frequency alone, where it lies on the line; NaN if there is none.
    interpolation : float
        Residual that interpolation over speed leaves at the highest point, relative to the excitation; the point itself
        solves the equations of its speed.
    status : str
        "complete" if the path reached both ends of the range, otherwise "incomplete" with the reason.
    cost : Cost
    settings : mapping
    model_hash : str
    """

    engine_order: int
    speed: RadiansPerSecond
    amplitude: Metres
    shares: Shares
    residual: NDArray
    point_kind: tuple[str, ...]
    peak_speed: float
    peak_amplitude: float
    fixed_speed: Annotated[float, Formerly("passed_speed")]
    fixed_speed_amplitude: Annotated[float, Formerly("passed_amplitude")]
    interpolation: float
    status: str
    cost: Cost

    @property
    def frequency(self) -> Hertz:
        """(n,) float, Hz."""
        return self.engine_order * self.speed / TWO_PI

    @property
    def difference(self) -> float:
        """Amplitude of the highest point over that of the peak at fixed speed, less one."""
        return self.peak_amplitude / self.fixed_speed_amplitude - 1.0

    @property
    def cut(self) -> bool:
        """Whether the response is higher at an end of the range than at its highest point in between."""
        return bool(max(self.amplitude[[0, -1]]) > self.peak_amplitude)

    def facts(self) -> tuple[Fact, ...]:
        """The highest point, and the peak at fixed speed beside it."""
        return (
            Fact("engine order", self.engine_order),
            Fact("run-up", f"{self.status}, {len(self)} points"),
            Fact("highest amplitude", self.peak_amplitude, "m"),
            Fact("at the speed", self.peak_speed, "rad/s"),
            Fact("peak at fixed speed", self.fixed_speed_amplitude, "m"),
            Fact("on the line at", self.fixed_speed, "rad/s"),
        )

    def bottom_line(self) -> str:
        top = f"{amount(self.peak_amplitude, 'm')} at {self.peak_speed * RPM:.0f} rpm"
        beside = f", {percent(self.difference)} above the peak at fixed speed" if np.isfinite(self.fixed_speed) else BESIDE
        cut = " It is higher still at an end of the range: give a wider one." if self.cut else ""
        return f"Highest response of the run-up along engine order {self.engine_order}: {top}{beside}.{cut}"


@one_thread
def run_up(
    problem: Problem,
    speeds: tuple[float, float] | None = None,
    *,
    rpm: tuple[float, float] | None = None,
    mode: int = 1,
    within: tuple[float, float] | None = None,
    options: ContinuationOptions | None = None,
    **conditions: Any,
) -> RunUp:
    """The response along the line of the study's engine order, through its crossing with a mode.

    Parameters
    ----------
    problem : Problem
        Of that engine order; its model has bases over speed.
    speeds : (low, high), rad/s, optional
        Range of the run-up, which holds the crossing; by default the speeds at which the free and the stuck resonance of
        the mode meet the line, and some way beyond.
    rpm : (low, high), revolutions per minute
        Instead of ``speeds``.
    mode : int
    within : (low, high), rad/s, optional
        What the default range does not leave; 50 to 2000 rad/s by default, as far as tables over speed reach.
    options : ContinuationOptions
        Coarse by default; the highest point is refined.
    **conditions
        As for :meth:`bdamper.Study.crossings`.

    Raises
    ------
    SettingError
        If a setting does not fit, or polynomials over speed do not describe the equations well enough: a shorter range.
    BdamperError
        If there is no crossing in the range.
    """
    validate.instance("study", problem, Problem, "a Study")
    given = Conditions.of(conditions)
    everywhere = np.clip(given.reach(int(problem.engine_order)), *WITHIN)
    if speeds is not None or rpm is not None:
        speeds = asked_speeds(problem, speeds, rpm)
    asked = speed_values(next((r for r in (speeds, within) if r is not None), everywhere))
    mode = validate.whole("mode", mode, least=1)
    meter = CostMeter(time.perf_counter())
    family = SpeedFamily(problem, given)
    low, high = float(asked[0]), float(asked[-1])
    holds = interval(family, low, high, mode)
    line = None if holds is None else follow_line(family, holds if speeds is None else (low, high), mode, meter, options)
    if line is None or line.top is None:
        raise BdamperError(
            f"run-up: expected a crossing of mode {mode} with engine order {problem.engine_order} between {low:.6g} and "
            f"{high:.6g} rad/s, found none{'' if line is None else f': {_why_no_top(line)}'}"
        )
    top, error = exact(family, line)
    between = f"interpolation between {line.speed.min():.6g} and {line.speed.max():.6g} rad/s; give a shorter one"
    found = f"a residual of {error:.2g} after {between}"
    validate.require(error <= CLOSE, "speeds", "a range in which the equations change smoothly", found)
    nan, fixed = float("nan"), line.fixed
    return RunUp(
        engine_order=int(problem.engine_order),
        speed=line.speed,
        amplitude=line.amplitude,
        shares=line.shares,
        residual=line.residual,
        point_kind=line.kinds,
        peak_speed=top.parameter,
        peak_amplitude=top.amplitude,
        fixed_speed=nan if fixed is None else fixed.parameter,
        fixed_speed_amplitude=nan if fixed is None else fixed.amplitude,
        interpolation=error,
        status=COMPLETE if line.status == COMPLETE else because(INCOMPLETE, line.reason),
        cost=meter.read(time.perf_counter()),
        **problem.recorded(),
    )


def _why_no_top(line: Line) -> str:
    """Why a followed line has no highest point but its ends."""
    if not len(line.y):
        return line.reason
    i = int(np.argmax(line.amplitude))
    end = "upper" if line.speed[i] == line.speed.max() else "lower"
    return (
        f"no maximum, the response is highest at the {end} end, {line.amplitude[i]:.4g} m at {line.speed[i]:.6g} rad/s; "
        "give a range that goes further there, or none"
    )
